r"""Flow through a port, with or without the inertia of the gas in it.

Side 1 has the higher pressure, its $\kappa = \rho w^2/p$ is that of the real gas:

$$\Delta h = \frac{\kappa}{\kappa-1}\frac{p_1}{\rho_1}\left(1 - r^{(\kappa-1)/\kappa}\right),\quad
r = \max(p_2/p_1, r_c),\quad r_c = \left(\tfrac{2}{\kappa+1}\right)^{\kappa/(\kappa-1)}$$

Quasi-steady, $\dot m = A\,\rho_1 r^{1/\kappa}\sqrt{2\Delta h}$, the isentropic nozzle. With inertia, the
column of gas of length L has a velocity U of its own,

$$L\dot U = \pm\Delta h - U|U|/2,\quad \dot m = A\,\rho_t U,$$

whose steady state is the nozzle again. Within a few thousandths up to r = 0.7 and one hundredth at
choking this is the exact isentropic nozzle of the real gas. The root of the quasi-steady law makes
derivatives err by per cent where values are right to 1e-7; with inertia both are smooth between the
reversals of pressure and velocity.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import maximum

# [-] Softens the root of the quasi-steady law: relative error of flows 1.6 times as large.
SOFTENING = 1e-9


class Side(NamedTuple):
    """The gas on one side of a port.

    Attributes:
        p: [Pa]
        rho: [kg/m^3]
        kappa: [-] rho w^2/p.
        h: [J/kg]
        critical: [-] pressure ratio at which a nozzle that begins here chokes; computed where absent.
    """

    p: Float[Array, ""]
    rho: Float[Array, ""]
    kappa: Float[Array, ""]
    h: Float[Array, ""]
    critical: Float[Array, ""] | None = None

    @property
    def choking_ratio(self) -> Float[Array, ""]:
        """[-] Pressure ratio at which a nozzle that begins here chokes."""
        return critical_ratio(self.kappa) if self.critical is None else self.critical

    def pressure_ratio(self, low: "Side") -> Float[Array, ""]:
        """[-] Of a nozzle from here to a side of lower pressure, not below that at which it chokes."""
        return maximum(low.p / self.p, self.choking_ratio)


def choose(first, a: Side, b: Side) -> Side:
    """`a` where `first` holds, `b` elsewhere."""
    return jax.tree.map(lambda x, y: jnp.where(first, x, y), a, b)


def quasi_steady_flow(a: Side, b: Side) -> Float[Array, ""]:
    """Mass flow per effective area [kg/(s m^2)] from side `a` to side `b`, negative from `b` to `a`."""
    forward = a.p > b.p
    high = choose(forward, a, b)
    low = choose(forward, b, a)
    r = high.pressure_ratio(low)
    root = 2 * enthalpy_drop(high.kappa, r) * r ** (2 / high.kappa)
    # In the place of sqrt(root), whose slope is infinite where the pressures are equal.
    size = jnp.sqrt(high.p * high.rho) * root / jnp.sqrt(root + SOFTENING)
    return jnp.where(forward, size, -size)


def port_acceleration(a: Side, b: Side, velocity, pressure_sign, velocity_sign):
    """L dU/dt [m^2/s^2] of the gas in a port.

    Args:
        a: side from which U counts positive.
        b: the other side.
        velocity: [m/s] U.
        pressure_sign: +1 while a has the higher pressure, -1 while b has; given, so that the law is
            smooth beyond the reversal at which the sign is changed.
        velocity_sign: the same for U.
    """
    forward = pressure_sign > 0
    high = choose(forward, a, b)
    low = choose(forward, b, a)
    # Beyond the reversal the ratio passes one, and the drop goes on smoothly below zero.
    r = high.pressure_ratio(low)
    drop = high.p / high.rho * enthalpy_drop(high.kappa, r)
    return pressure_sign * drop - 0.5 * velocity_sign * velocity**2


def throat_density(a: Side, b: Side, pressure_sign, velocity_sign) -> Float[Array, ""]:
    """Density [kg/m^3] of the gas in the port, expanded from the side it comes from.

    Gas that flows against the pressure is not compressed: it keeps the density of its side.

    Args:
        a: side from which the velocity counts positive.
        b: the other side.
        pressure_sign: +1 while a has the higher pressure, -1 while b has.
        velocity_sign: the same for the velocity.
    """
    forward = velocity_sign > 0
    up = choose(forward, a, b)
    down = choose(forward, b, a)
    q = up.pressure_ratio(down)
    q = jnp.where(pressure_sign == velocity_sign, q, 1.0)
    return up.rho * q ** (1 / up.kappa)


def choking_margin(a: Side, b: Side) -> Float[Array, ""]:
    """[-] Pressure ratio of a nozzle between two sides, less that at which it chokes."""
    forward = a.p > b.p
    high = choose(forward, a, b)
    low = choose(forward, b, a)
    return low.p / high.p - high.choking_ratio


def critical_ratio(kappa):
    """Pressure ratio at which a nozzle chokes; 1/sqrt(e) for kappa = 1."""
    # r_c = (1 + y)^(-kappa/(2 y)).
    y = 0.5 * (kappa - 1)
    near = jnp.abs(y) < 1e-4
    # Double where: log1p(y)/y is 0/0 at kappa = 1.
    safe = jnp.where(near, 1.0, y)
    slope = jnp.where(near, 1 - y / 2 + y**2 / 3 - y**3 / 4, jnp.log1p(safe) / safe)
    return jnp.exp(-0.5 * kappa * slope)


def enthalpy_drop(kappa: Float[Array, ""], r: Float[Array, ""]) -> Float[Array, ""]:
    """Isentropic enthalpy drop over p_1/rho_1, finite for kappa = 1."""
    log = jnp.log(r)
    z = (kappa - 1) / kappa * log
    near = jnp.abs(z) < 1e-3
    # Double where: expm1(z)/z is 0/0 at zero, and its derivatives cancel beside it, hence 1e-3.
    safe = jnp.where(near, 1.0, z)
    series = 1 + z / 2 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6))))
    return -log * jnp.where(near, series, jnp.expm1(safe) / safe)
