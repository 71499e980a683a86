r"""Pads on a film that a taper builds, and on their asperities where it is thin.

A pad of the length B along the motion and the width L across it stands over its runner at
$h = h_0 + \delta x/B$. At the speed v, with $k = \delta/h_0$, its film carries and shears

$$W_f = \frac{6\eta v L B^2}{\delta^2}\Big(\ln(1+k) - \frac{2k}{2+k}\Big)\,s , \quad
  F_f = \frac{\eta v L B}{\delta}\ln(1+k) + \frac{\delta}{2B} W_f$$

(Reynolds 1886 for the infinitely wide pad). The flow to the sides takes the share
$s = 1 - \frac{2B}{\pi L}\tanh\frac{\pi L}{2B}$ of that, the first harmonic along the pad (our derivation;
0.42 and 0.68 at L = B and 2 B, of which solutions in books have 0.44 and 0.69). The contact adds
$W_c = L B K E^* \frac{2\sigma}{7\delta}(F_{7/2}(h_0/\sigma) - F_{7/2}((h_0+\delta)/\sigma))$ of
Greenwood and Tripp, and rubs with $\mu_b W_c$. The thickness $h_0$ is that at which both carry the load.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import clip
from .._core.roots import AbstractRoot, root
from ..film import AsperityContact

# [-] Thickness over roughness, up to which surfaces touch, and the least one.
_APART = 8.0
_LEAST = 1e-3
_HALVINGS = 14
_STEPS = 5
# [m/s] and below this speed no film is built: the friction passes through rest with a finite slope.
_REST = 1e-6


class PadForces(NamedTuple):
    """Forces and losses of pads.

    Attributes:
        film: [N] drag of the oil, against the motion.
        contact: [N] that of the asperities.
        thickness: [m] smallest, h_0.
    """

    film: Float[Array, "*n"]
    contact: Float[Array, "*n"]
    thickness: Float[Array, "*n"]


@functools.cache
def _excess_series() -> np.ndarray:
    """ln F_{7/2} of Greenwood and Tripp as a polynomial in u/4 - 1, on 0 <= u <= 8, to 1e-9."""
    u = 4 * (1 + np.cos(np.pi * (np.arange(64) + 0.5) / 64))
    r = 0.1 * np.arange(1, 31)  # the trapezoidal rule of `film._contact`, for 7/2
    weight = 0.2 * r**8 / np.sqrt(2 * np.pi)
    # Of the logarithm, because F_{7/2} falls by 17 decades over this range.
    values = np.log(np.sum(weight * np.exp(-0.5 * (u[:, None] + r**2) ** 2), axis=1))
    series = np.polynomial.chebyshev.chebfit(u / 4 - 1, values, 14)
    return np.polynomial.chebyshev.cheb2poly(series)


def _excess(u):
    """F_{7/2}, zero for surfaces that are apart."""
    touches = u < _APART
    # Double where: beyond its range the polynomial, and with it the exponential, runs away.
    x = jnp.where(touches, u, _APART) / 4 - 1
    log = 0.0
    for coefficient in _excess_series()[::-1]:
        log = log * x + coefficient
    return jnp.where(touches, jnp.exp(log), 0.0)


class Pads(eqx.Module):
    """Pads of one size over their runner, at a speed."""

    count: float
    length: Float[Array, ""]
    width: Float[Array, ""]
    taper: Float[Array, ""]
    clearance: Float[Array, ""]
    viscosity: Float[Array, ""]
    contact: AsperityContact
    speed: Float[Array, "*n"]

    def shares(self, thickness):
        """[N] Loads of film and contact at a smallest thickness [m]."""
        k = self.taper / thickness
        sigma = self.contact.roughness
        slender = 0.5 * jnp.pi * self.width / self.length
        sides = 1 - jnp.tanh(slender) / slender
        area = self.count * self.length * self.width
        unit = 6 * self.viscosity * self.speed * area * self.length / self.taper**2
        # ln(1 + k) - 2 k/(2 + k) by its series where the two all but cancel; five terms leave 5e-9
        few = k < 0.02
        series = sum((-1) ** (n + 1) * (1 / n - 2.0 ** (1 - n)) * k**n for n in range(3, 8))
        safe = jnp.where(few, 1.0, k)
        film = jnp.where(few, series, jnp.log1p(safe) - 2 * safe / (2 + safe))
        # dF_n/du = -n F_(n-1): the integral of F_(5/2) along the taper is 2/7 of a difference of
        # F_(7/2)
        stiffness = (
            self.contact.elastic_factor * self.contact.modulus * 2 * sigma / (7 * self.taper)
        )
        touch = _excess(thickness / sigma) - _excess((thickness + self.taper) / sigma)
        return unit * sides * film, area * stiffness * touch

    def forces(self, load) -> PadForces:
        floating, _ = self.shares(self.clearance)
        # pads that no load presses float as far off as their clearance lets them
        pressed = jnp.sqrt(load**2 + floating**2 + 1e-24)
        thickness = jnp.exp(root(_Thickness(self, pressed)))
        film, touch = self.shares(thickness)
        area = self.count * self.length * self.width
        # Both terms of F_f: the shear of the motion, and that of the flow which the pressure drives.
        shear = self.viscosity * self.speed * area / self.taper * jnp.log1p(self.taper / thickness)
        drag = shear + 0.5 * self.taper / self.length * film
        return PadForces(drag, self.contact.coefficient * touch, thickness)


class _Thickness(AbstractRoot):
    """ln h_0 at which film and contact carry a load: both fall with it."""

    pads: Pads
    load: Float[Array, "*n"]

    def residual(self, unknowns):
        # both loads go over decades with the thickness: in logarithms a power of it is a straight line
        return jnp.log(sum(self.pads.shares(jnp.exp(unknowns)))) - jnp.log(self.load)

    def solve(self):
        sigma = self.pads.contact.roughness
        # zero times the load: what a loop carries keeps its shape, so the ends begin with the load's
        low = jnp.log(_LEAST * sigma) + 0 * self.load
        high = jnp.log(self.pads.clearance) + 0 * self.load

        def halve(_, ends):
            low, high = ends
            middle = 0.5 * (low + high)
            thin = self.residual(middle) > 0
            return jnp.where(thin, middle, low), jnp.where(thin, high, middle)

        def improve(_, z):
            residual, slope = jax.jvp(self.residual, (z,), (jnp.ones_like(z),))
            return clip(z - residual / slope, low, high)

        # Halved first: towards thin films the logarithm of the load flattens out, where Newton's
        # method would step far beyond. 14 halvings leave less than 1e-3 of ln h_0.
        near = lax.fori_loop(0, _HALVINGS, halve, (low, high))
        return lax.fori_loop(0, _STEPS, improve, 0.5 * (near[0] + near[1]))


def slow(speed):
    """[m/s] Size of a speed, above zero."""
    return jnp.sqrt(speed**2 + _REST**2)
