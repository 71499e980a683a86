"""Frequencies at which a network rings by itself while its flanges are shut."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Complex, Float

from .._core.extremes import maximum
from ._gas import PipeGas
from ._network import Network, impedances, no_drag, tableau, transfers

# Resonances of a line that have names of their own, from the lowest.
NAMED_RESONANCES = 4
# Places of the search over frequency: peaks nearer than this share of the range may be taken as one.
_PLACES = 4000
_STEPS = 12
# Peaks for which a program has room at first, and peaks that are tried for a resonance that is wanted.
_ROOM = 16
_TRIES = 2
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
def root_near(network: Network, gas: PipeGas, start: Complex[Array, ""]) -> Complex[Array, ""]:
    """Root s [1/s] of the network's free vibration near a start, with its first derivatives.

    These come from the same vectors: s' = -(y^H T' x)/(y^H T_s x).

    Args:
        network: of `network_of`.
        gas: in it.
        start: [1/s]
    """
    fixed = lax.stop_gradient((network, gas))
    return _followed(network, gas, _newton(*fixed, start))


def _followed(network: Network, gas: PipeGas, root: Complex[Array, ""]) -> Complex[Array, ""]:
    """A root that was found, with its first derivatives."""
    fixed = lax.stop_gradient((network, gas))
    s = lax.stop_gradient(root)
    matrix, slope = jax.jvp(lambda s: _matrix(*fixed, s), (s,), (jnp.ones_like(s),))
    x, y = lax.stop_gradient(_null_vectors(matrix))
    weight = lax.stop_gradient(y.conj() @ slope @ x)
    return s - (y.conj() @ _matrix(network, gas, s) @ x) / weight


def _peaks(network: Network, gas: PipeGas, frequency) -> Bool[Array, " f"]:
    """Whether the impedance of any flange has a peak at a frequency."""
    size = jnp.abs(impedances(network, gas, frequency))
    height = jnp.diagonal(size, axis1=1, axis2=2)
    inner = (height[1:-1] >= height[:-2]) & (height[1:-1] > height[2:])
    return jnp.pad(jnp.any(inner, axis=1), 1)


def _lowest(network: Network, gas: PipeGas, highest, room: int) -> tuple[Resonances, Array]:
    """The resonances that as many of the lowest peaks lead to, and the number of all peaks.

    Places that hold none are infinite.
    """
    fixed = lax.stop_gradient((network, gas))
    frequency = lax.stop_gradient(highest) * np.linspace(1 / _PLACES, 1.0, _PLACES)
    peaks = _peaks(*fixed, frequency)
    (places,) = jnp.nonzero(peaks, size=room, fill_value=0)
    has_start = jnp.arange(room) < jnp.sum(peaks)
    # One after the other: singular values of a batch are shared out among the threads of XLA, and where
    # a machine has but one of these the program waited for itself without end.
    roots = lax.map(partial(_newton, *fixed), 2j * np.pi * frequency[places])
    # Newton's method may leave its peak, for a root beyond or for one that another peak leads to
    inside = has_start & (roots.imag > 0) & (roots.imag <= 2 * np.pi * frequency[-1] * (1 + 1e-9))
    distance = jnp.abs(roots[:, None] - roots)
    is_same = distance <= _SAME * jnp.abs(roots[:, None])
    comes_before = np.tri(room, k=-1, dtype=bool)
    distinct = inside & ~jnp.any(is_same & comes_before & inside, axis=1)
    order = jnp.argsort(jnp.where(distinct, roots.imag, jnp.inf))
    is_root = distinct[order]
    # derivatives at a place without a root are those at a root
    followed = lax.map(
        partial(_followed, network, gas), jnp.where(is_root, roots[order], roots[order[0]])
    )
    damping = maximum(jnp.abs(followed.real), 1e-12 * jnp.abs(followed.imag))
    # without losses Q has no bound
    quality = followed.imag / (2 * damping)
    sorted_roots = Resonances(followed.imag / (2 * np.pi), quality, followed)
    lowest = jax.tree.map(lambda values: jnp.where(is_root, values, jnp.inf), sorted_roots)
    return lowest, jnp.sum(peaks)


_lowest_compiled = jax.jit(_lowest, static_argnames="room")


def resonances(network: Network, gas: PipeGas, highest: float) -> Resonances:
    """Resonances of a network with its flanges shut.

    Outside of `jit`, as their number is found by the way; derivatives are those of `root_near`.

    Args:
        network: of `network_of`.
        gas: in it.
        highest: [Hz] up to which they are sought.
    """
    room = _ROOM
    lowest, peaks = _lowest_compiled(network, gas, jnp.asarray(highest, float), room)
    while int(lax.stop_gradient(peaks)) > room:
        room *= 2
        lowest, peaks = _lowest_compiled(network, gas, jnp.asarray(highest, float), room)
    exists = np.isfinite(np.asarray(lax.stop_gradient(lowest.frequency)))
    return jax.tree.map(lambda values: values[exists], lowest)


@partial(jax.jit, static_argnames="count")
def lowest_resonances(network: Network, gas: PipeGas, count: int) -> Resonances:
    """The lowest resonances of a network with its flanges shut, also within `jit`.

    They are sought so far that a network without losses has them all: the pipes between nodes have more
    than $2Lf/c$ of them below f, less one for each pipe.

    Args:
        network: of `network_of`.
        gas: in it.
        count: of resonances; those that the network has not, as damping leaves no peak of them, are
            infinite.
    """
    pipes = network.length.size
    highest = (count + pipes + 1) * gas.sound_speed / (2 * jnp.sum(network.length))
    # each flange may have a peak of its own, a step of the search beside that of another
    room = _TRIES * count * len(network.flanges)
    lowest, _ = _lowest(network, gas, highest, room)
    return jax.tree.map(lambda values: values[:count], lowest)
