"""Frequencies at which a network rings by itself while its flanges are shut."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float

from .._core.extremes import maximum
from ._gas import PipeGas
from ._network import Network, impedances, no_drag, tableau, transfers

# Places of the search over frequency: peaks nearer than this share of the range may be taken as one.
_PLACES = 4000
_STEPS = 12
# [-] Roots nearer than this are one.
_SAME = 1e-6


class Resonances(NamedTuple):
    """Resonances of a network with its flanges shut, from the lowest.

    Attributes:
        frequency: [Hz] (r,) natural.
        quality: [-] (r,) Q, frequency over the width of the peak.
        root: [1/s] (r,) s of the free vibration.
    """

    frequency: Float[Array, " r"]
    quality: Float[Array, " r"]
    root: Complex[Array, " r"]


def _matrix(network: Network, gas: PipeGas, s):
    return tableau(network, gas, s, transfers(network, gas, s, no_drag(network)))


def _null_vectors(matrix):
    """Right and left vector of the smallest singular value."""
    left_vectors, _, right_vectors = jnp.linalg.svd(matrix)
    return right_vectors[-1].conj(), left_vectors[:, -1]


def _newton(network: Network, gas: PipeGas, start):
    """Root near a start, by Newton's method on y^H T(s) x."""

    def advance(_, s):
        matrix, slope = jax.jvp(lambda s: _matrix(network, gas, s), (s,), (jnp.ones_like(s),))
        x, y = _null_vectors(matrix)
        return s - (y.conj() @ matrix @ x) / (y.conj() @ slope @ x)

    return lax.fori_loop(0, _STEPS, advance, start)


@jax.jit
def _roots(network: Network, gas: PipeGas, starts: Complex[Array, " r"]) -> Complex[Array, " r"]:
    """Roots near all starts.

    One after the other: singular values of a batch are shared out among the threads of XLA, and where a
    machine has but one of these the program waited for itself without end.
    """
    return lax.map(partial(_newton, network, gas), starts)


def root_near(network: Network, gas: PipeGas, start: Complex[Array, ""]) -> Complex[Array, ""]:
    """Root s [1/s] of the network's free vibration near a start, with its first derivatives.

    These come from the same vectors: s' = -(y^H T' x)/(y^H T_s x).

    Args:
        network: of `network_of`.
        gas: in it.
        start: [1/s]
    """
    fixed = lax.stop_gradient((network, gas))
    s = lax.stop_gradient(_newton(*fixed, start))
    matrix, slope = jax.jvp(lambda s: _matrix(*fixed, s), (s,), (jnp.ones_like(s),))
    x, y = lax.stop_gradient(_null_vectors(matrix))
    weight = lax.stop_gradient(y.conj() @ slope @ x)
    return s - (y.conj() @ _matrix(network, gas, s) @ x) / weight


@jax.jit
def _followed(network: Network, gas: PipeGas, roots: Complex[Array, " r"]) -> Complex[Array, " r"]:
    """Roots that were found, with their derivatives."""
    return lax.map(partial(root_near, network, gas), roots)


def resonances(network: Network, gas: PipeGas, highest: float) -> Resonances:
    """Resonances of a network with its flanges shut.

    Outside of `jit`, as their number is found by the way; derivatives are those of `root_near`.

    Args:
        network: of `network_of`.
        gas: in it.
        highest: [Hz] up to which they are sought.
    """
    frequency = np.linspace(highest / _PLACES, highest, _PLACES)
    fixed = lax.stop_gradient((network, gas))
    size = np.abs(np.asarray(jax.jit(impedances)(*fixed, frequency)))
    peaks = []
    for flange in range(size.shape[1]):
        height = size[:, flange, flange]
        inner = (height[1:-1] >= height[:-2]) & (height[1:-1] > height[2:])
        peaks += list(frequency[1:-1][inner])
    if not peaks:
        none = jnp.zeros(0)
        return Resonances(none, none, none + 0j)
    starts = 2j * np.pi * jnp.asarray(sorted(peaks))
    roots = np.asarray(_roots(*fixed, starts))
    distinct = []
    for root in sorted(roots, key=lambda root: root.imag):
        # Newton's method may leave its peak, for a root beyond or for one that another peak leads to
        inside = 0 < root.imag <= 2 * np.pi * highest * (1 + 1e-9)
        if inside and all(abs(root - other) > _SAME * abs(root) for other in distinct):
            distinct.append(root)
    followed = _followed(network, gas, jnp.asarray(distinct))
    damping = jnp.abs(followed.real)
    # without losses Q has no bound
    quality = followed.imag / (2 * maximum(damping, 1e-12 * followed.imag))
    return Resonances(followed.imag / (2 * np.pi), quality, followed)
