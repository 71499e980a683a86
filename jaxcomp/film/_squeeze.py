r"""Films of a journal that moves: velocity from force and force from velocity, pressure, side flow.

The journal's centre is at $c\,e$ from that of the bush, in axes that do not rotate, and rotation and
motion act through one velocity (Booker 1965),

$$V = \dot e - \tfrac12(\omega_j + \omega_b)\,J e , \qquad J e = (-e_y, e_x) .$$

The film carries the load $F = U\,W(e, V)$ with $U = \eta L D/\psi^2$, and $p \ge 0$ (Reynolds edges, free
on both sides) makes the impedance W the slope of a convex potential. So is its inverse, the mobility,

$$V = M(e, F/U) = \nabla_F\, \tfrac12 F^2 H(x, e\cdot e) , \qquad x = e\cdot F/|F| ,$$

which is why one scalar H, tabulated, gives the whole film: two separately fitted components would
dissipate wrongly. Half of $F^2 H$ is half the power of the squeeze.

Mass is not conserved where a film forms again ($p \ge 0$ lets it re-form full of oil at once).
"""

import math
from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import maximum, minimum
from .._core.roots import AbstractRoot, root
from ._film import Pair, Scalar, as_float, split

# Where a closed film is held, so that an iteration beyond the wall stays finite.
_LAST_SHORT = 1 - 1e-9
_INVERSIONS = 12  # to rounding; 5 to 8 from a start within ten per cent


class AbstractSqueeze(eqx.Module):
    """A film for one L/D under any motion; positions over c, velocities over c [1/s], forces over U."""

    length_ratio: Scalar = eqx.field(converter=as_float)
    limits: ClassVar[str]
    length_ratio_range: ClassVar[tuple[float, float]] = (0.0, math.inf)

    @abstractmethod
    def mobility(self, position: Pair, force: Pair) -> Pair:
        """[1/s] Effective velocity V over c that carries a force F/U [1/s]; none without a force."""

    def mobility_slopes(
        self, position: Pair, force: Pair
    ) -> tuple[Pair, tuple[Float[Array, "2 *n"], Float[Array, "2 *n"]]]:
        """The mobility with its slopes [1/s] along the two axes of the position."""
        return slopes_along(lambda e: self.mobility(e, force), position)

    @abstractmethod
    def impedance(self, position: Pair, velocity: Pair) -> Pair:
        """[1/s] Force F/U that an effective velocity V over c [1/s] carries."""

    @abstractmethod
    def peak_pressure(self, position: Pair, force: Pair, velocity: Pair) -> Float[Array, "*n"]:
        """[1/s] Largest pressure over eta/psi^2, of a force and its effective velocity."""

    @abstractmethod
    def side_flow(self, position: Pair, force: Pair, velocity: Pair) -> Float[Array, "*n"]:
        """[1/s] Flow out of both ends of the pressure zone over R L c."""


def quarter_turn(vector: Pair) -> Pair:
    """J e, turned by +90 degrees."""
    return jnp.stack([-vector[1], vector[0]])


class OcvirkSqueeze(AbstractSqueeze):
    r"""Short film, exact: $p = 6 q^2 (V\cdot n)(1 - \zeta^2)/h^3$ on the half circle about V.

    Its impedance is closed by Sommerfeld's substitution (our derivation); the mobility solves for V.
    Booker's (1965) closed mobility is a fit of it, 1 % off at eps = 0.2 and up to 10 % at 0.95.

    Args:
        length_ratio: [-] q = L/D.
    """

    limits: ClassVar[str] = (
        "Short bearing, right for L/D -> 0: films 15 % too thick at L/D = 1/2. Films re-form full of "
        "oil; aligned, isoviscous, laminar, no roughness."
    )

    def impedance(self, position, velocity):
        return self.matrix(position, velocity)[0]

    def matrix(self, position, velocity):
        """The impedance, and its matrix over the velocity, which is its slope as well: two columns."""
        size, along = split(position)
        eps = minimum(size, _LAST_SHORT)
        beta = jnp.arctan2(cross(along, velocity), dot(along, velocity))
        # A product, because 1 - eps^2 loses digits as the film closes.
        square = (1 - eps) * (1 + eps)
        root = jnp.sqrt(square)
        wide = jnp.sqrt(1 + eps)
        thin = jnp.sqrt(1 - eps)

        def at(theta):
            # Sommerfeld's angle. theta counts from e, the thinnest film, up to 3 pi/2 either way:
            # arctan2 has no jump there.
            y = 2 * jnp.arctan2(wide * jnp.sin(theta / 2), thin * jnp.cos(theta / 2))
            sin = jnp.sin(y)
            cos = jnp.cos(y)
            return jnp.stack([
                # Integrals of cos^2, sin cos and sin^2 over h^3.
                ((eps**2 + 0.5) * y + (2 * eps + 0.5 * cos) * sin) / (square**2 * root),
                -(eps + 0.5 * cos) * cos / square**2,
                (0.5 * y - 0.5 * sin * cos) / (square * root),
            ])  # fmt: skip

        # 2 q^2 is half of 6 q^2 times the mean of 1 - zeta^2, over the half circle where V n > 0.
        cc, sc, ss = 2 * self.length_ratio**2 * (at(beta + jnp.pi / 2) - at(beta - jnp.pi / 2))
        sideways = quarter_turn(along)
        radial = cc * along + sc * sideways
        tangential = sc * along + ss * sideways
        columns = tuple(along[i] * radial + sideways[i] * tangential for i in range(2))
        return columns[0] * velocity[0] + columns[1] * velocity[1], columns

    def mobility(self, position, force):
        size, along = split(force)
        x, y = dot(position, along), cross(along, position)
        room = maximum(1 - x, 1e-9)
        # Booker's fit is near enough, and a unit force will do, because the map is homogeneous.
        start = room**2.5 / jnp.pi * along - 4 * y * room**1.5 / jnp.pi**2 * quarter_turn(along)
        return size * root(Inverse(_Impedance(self), position, along, start / self.length_ratio**2))

    def peak_pressure(self, position, force, velocity):
        # In Sommerfeld's angle y, 1/(1 - eps cos) = (1 + eps cos y)/s^2: a trigonometric polynomial of
        # degree three, whose highest place needs no derivative.
        size, along = split(position)
        eps = minimum(size, _LAST_SHORT)
        square = (1 - eps) * (1 + eps)
        radial = dot(along, velocity)
        tangential = cross(along, velocity)

        def pressure(y, radial, tangential, eps):
            cos = jnp.cos(y)
            sin = jnp.sqrt((1 - eps) * (1 + eps)) * jnp.sin(y)
            return (radial * (cos + eps) + tangential * sin) * (1 + eps * cos) ** 2

        constants = lax.stop_gradient((radial, tangential, eps))
        y = np.linspace(-np.pi, np.pi, 32, endpoint=False).reshape(32, *[1] * eps.ndim)
        y = jnp.take(jnp.asarray(y.ravel()), jnp.argmax(pressure(y, *constants), axis=0))
        for _ in range(4):
            slope, bend = _slope_and_bend(lambda y: pressure(y, *constants), y)
            # No step where the curve is hollow: Newton's method would seek a lowest place there.
            y = y - slope / jnp.where(bend < 0, bend, -jnp.inf)
        return 6 * self.length_ratio**2 * pressure(y, radial, tangential, eps) / square**3

    def side_flow(self, position, force, velocity):
        # Half a ring closes at the rate V n, and a short film lets all of that oil out at its ends: the
        # integral of V n over the half circle is 2 |V|.
        return 2 * split(velocity)[0]


class _Impedance(eqx.Module):
    film: OcvirkSqueeze

    def __call__(self, position, velocity):
        return self.film.impedance(position, velocity)

    def columns(self, position, velocity):
        return self.film.matrix(position, velocity)[1]


def slopes_along(function, value):
    """Slopes of a map of plane vectors along x and y, with its value."""
    ones = jnp.ones_like(value[0])
    zeros = jnp.zeros_like(value[0])
    image, linear = jax.linearize(function, value)
    return image, (linear(jnp.stack([ones, zeros])), linear(jnp.stack([zeros, ones])))


def two_by_two(columns, right: Pair) -> Pair:
    """Solve a system of two equations of which the columns are given."""
    (a, c), (b, d) = columns
    size = a * d - b * c
    # finite for a singular matrix as well, so that an iteration can go on from it
    size = jnp.where(jnp.abs(size) > 0, size, 1.0)
    return jnp.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / size


class Inverse(AbstractRoot):
    """Where a monotone map, homogeneous of degree one, takes a value; sought from a start.

    The slope times the place is the value: to solve with the last slope is Newton's method.
    """

    map: Any  # (position, place), with the `columns` of its slope along the place
    position: Pair
    target: Pair
    start: Pair

    def columns(self, place):
        return self.map.columns(self.position, place)

    def solve(self):
        def improve(_, place):
            # The slope of a map of degree one depends on the direction alone: the size of the
            # start does not matter.
            return two_by_two(self.columns(place), self.target)

        return lax.fori_loop(0, _INVERSIONS, improve, self.start)

    def residual(self, unknowns):
        return self.map(self.position, unknowns) - self.target

    def newton_correction(self, unknowns, residual):
        return -two_by_two(self.columns(unknowns), residual)


def _slope_and_bend(function, x):
    ones = jnp.ones_like(x)

    def slope(x):
        return jax.jvp(function, (x,), (ones,))[1]

    return jax.jvp(slope, (x,), (ones,))


def dot(a: Pair, b: Pair):
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Pair, b: Pair):
    return a[0] * b[1] - a[1] * b[0]
