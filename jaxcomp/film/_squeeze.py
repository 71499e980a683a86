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

import functools
import json
from abc import abstractmethod
from importlib import resources
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._implicit import AbstractRoot, root
from ._chebyshev import collapsed
from ._film import Scalar

TABLE = "squeeze_table.json"
TABLE_RANGE = (0.1, 2.0)  # q = L/D

# Where closed and tabulated films are held, so that an iteration beyond the wall stays finite.
_LAST_SHORT, _LAST = 1 - 1e-9, 0.996
_INVERSIONS = 12  # to rounding; 5 to 8 from a start within ten per cent

Pair = Float[Array, "2 *n"]


class AbstractSqueeze(eqx.Module):
    """A film for one L/D under any motion; positions over c, velocities over c [1/s], forces over U."""

    length_ratio: eqx.AbstractVar[Scalar]
    limits: ClassVar[str]

    @abstractmethod
    def mobility(self, position: Pair, force: Pair) -> Pair:
        """[1/s] Effective velocity V over c that carries a force F/U [1/s]; none without a force."""

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


def film_corner(x, square):
    """Coordinates u and v in [0, 1] that resolve the corner x -> 1, eps -> 1 of the closing film.

    u^4 = (1 - x)/2, v^2 = (1 - eps^2)/(1 - x^2), smooth about the centred journal.
    """
    lib = np if isinstance(x, np.ndarray) else jnp
    return lib.sqrt(lib.sqrt((1 - x) / 2)), lib.sqrt((1 - square) / (1 - x * x))


def resistance_unit(x, length_ratio):
    """H_0: sum of what the short and the long film tend to as they close."""
    short = (1 - x) ** 2.5 / (np.pi * length_ratio**2)
    return short + np.sqrt(2) / (3 * np.pi) * (1 - x) ** 1.5


def peak_unit(x):
    """How the largest pressure over the mean one grows as a film closes."""
    return 1 / ((1 - x) / 2) ** 0.5


class OcvirkSqueeze(AbstractSqueeze):
    r"""Short film, exact: $p = 6 q^2 (V\cdot n)(1 - \zeta^2)/h^3$ on the half circle about V.

    Its impedance is closed by Sommerfeld's substitution (our derivation); the mobility solves for V.
    Booker's (1965) closed mobility is a fit of it, 1 % off at eps = 0.2 and up to 10 % at 0.95.

    Args:
        length_ratio: [-] q = L/D.
    """

    length_ratio: Scalar
    limits: ClassVar[str] = (
        "Short bearing, right for L/D -> 0: films 15 % too thick at L/D = 1/2. Films re-form full of "
        "oil; aligned, isoviscous, laminar, no roughness."
    )

    def __init__(self, length_ratio):
        self.length_ratio = jnp.asarray(length_ratio, dtype=jnp.result_type(float))

    def impedance(self, position, velocity):
        size, along = _split(position)
        eps = jnp.minimum(size, _LAST_SHORT)
        beta = jnp.arctan2(_cross(along, velocity), _dot(along, velocity))
        square = (1 - eps) * (1 + eps)
        root, wide, thin = jnp.sqrt(square), jnp.sqrt(1 + eps), jnp.sqrt(1 - eps)

        def at(theta):
            y = 2 * jnp.arctan2(wide * jnp.sin(theta / 2), thin * jnp.cos(theta / 2))
            sin, cos = jnp.sin(y), jnp.cos(y)
            return jnp.stack([
                ((eps**2 + 0.5) * y + (2 * eps + 0.5 * cos) * sin) / (square**2 * root),
                -(eps + 0.5 * cos) * cos / square**2,
                (0.5 * y - 0.5 * sin * cos) / (square * root),
            ])  # fmt: skip

        cc, sc, ss = 2 * self.length_ratio**2 * (at(beta + jnp.pi / 2) - at(beta - jnp.pi / 2))
        radial, tangential = _dot(along, velocity), _cross(along, velocity)
        return (cc * radial + sc * tangential) * along + (
            sc * radial + ss * tangential
        ) * quarter_turn(along)

    def mobility(self, position, force):
        size, along = _split(force)
        x, y = _dot(position, along), _cross(along, position)
        room = jnp.maximum(1 - x, 1e-9)
        start = room**2.5 / jnp.pi * along - 4 * y * room**1.5 / jnp.pi**2 * quarter_turn(along)
        return size * root(
            _Inverse(_Impedance(self), position, along, start / self.length_ratio**2)
        )

    def peak_pressure(self, position, force, velocity):
        # In Sommerfeld's angle y, 1/(1 - eps cos) = (1 + eps cos y)/s^2: a trigonometric polynomial of
        # degree three, whose highest place needs no derivative.
        size, along = _split(position)
        eps = jnp.minimum(size, _LAST_SHORT)
        square = (1 - eps) * (1 + eps)
        radial, tangential = _dot(along, velocity), _cross(along, velocity)

        def pressure(y, radial, tangential, eps):
            cos, sin = jnp.cos(y), jnp.sqrt((1 - eps) * (1 + eps)) * jnp.sin(y)
            return (radial * (cos + eps) + tangential * sin) * (1 + eps * cos) ** 2

        known = lax.stop_gradient((radial, tangential, eps))
        y = np.linspace(-np.pi, np.pi, 32, endpoint=False).reshape(32, *[1] * eps.ndim)
        y = jnp.take(jnp.asarray(y.ravel()), jnp.argmax(pressure(y, *known), axis=0))
        for _ in range(4):
            slope, bend = _slope_and_bend(lambda y: pressure(y, *known), y)
            y = y - slope / jnp.where(bend < 0, bend, -jnp.inf)
        return 6 * self.length_ratio**2 * pressure(y, radial, tangential, eps) / square**3

    def side_flow(self, position, force, velocity):
        return 2 * _split(velocity)[0]


class ReynoldsSqueeze(AbstractSqueeze):
    """Finite film with free edges, from a table of H over position, direction and L/D.

    ln(H/H_0) is a Chebyshev series in u and v of `film_corner`, solved up to eps = 0.996 and held
    beyond, where H_0 has the right powers. The mobility is within 6.5e-4 of the Reynolds equation, 9e-5
    on the root mean square; the side flow within 1 %, the largest pressure within 2.4 % (0.3 %).

    Args:
        length_ratio: [-] q = L/D, 0.1 to 2; beyond, the tangent in ln q is a guess.
    """

    length_ratio: Scalar
    series: dict[str, Float[Array, "u v"]]
    limits: ClassVar[str] = (
        "Table for L/D 0.1 to 2 and eps to 0.996. Films re-form full of oil; aligned, isoviscous, "
        "laminar, no roughness."
    )

    def __init__(self, length_ratio):
        q = jnp.asarray(length_ratio, dtype=jnp.result_type(float))
        table, self.length_ratio, self.series = _table(), q, {}
        for name in ("mobility", "peak", "flow"):
            rows = table[name].reshape(-1, table[name].shape[-1])
            series = collapsed(rows, table["ln_q_range"], jnp.log(q))
            self.series[name] = series.reshape(table[name].shape[:2])

    def resistance(self, x: Float[Array, "*n"], square: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[-] H, twice the dual potential over the square of the force.

        Args:
            x: eps times the cosine of the angle from the position to the force.
            square: eps^2.
        """
        unit = resistance_unit(jnp.minimum(x, 1 - 1e-9), self.length_ratio)
        return unit * jnp.exp(self._series("mobility", x, square))

    def _series(self, name, x, square):
        within = jnp.minimum(1.0, _LAST / jnp.sqrt(jnp.maximum(square, _LAST**2)))
        u, v = film_corner(x * within, square * within**2)
        series = self.series[name]
        rows, columns = (_terms(n, 2 * t - 1) for n, t in zip(series.shape, (u, v), strict=True))
        return jnp.sum(rows * jnp.tensordot(series, columns, axes=1), axis=0)

    def mobility(self, position, force):
        size, along = _split(force)
        x, square = _dot(position, along), _dot(position, position)
        h, slope = jax.jvp(lambda x: self.resistance(x, square), (x,), (jnp.ones_like(x),))
        return size * (h * along + 0.5 * slope * (position - x * along))

    def impedance(self, position, velocity):
        size, along = _split(velocity)
        start = OcvirkSqueeze(self.length_ratio).impedance(position, along)
        return size * root(_Inverse(_Mobility(self), position, along, start))

    def peak_pressure(self, position, force, velocity):
        size, along = _split(force)
        x = _dot(position, along)
        log = self._series("peak", x, _dot(position, position))
        return size * peak_unit(jnp.minimum(x, 1 - 1e-9)) * jnp.exp(log)

    def side_flow(self, position, force, velocity):
        size, along = _split(velocity)
        x = _dot(position, along)
        return size * jnp.exp(self._series("flow", x, _dot(position, position)))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _terms(n: int, t: Float[Array, "*b"]) -> Float[Array, "n *b"]:
    """T_0(t) ... T_(n-1)(t); derivatives of every order are sums of the same terms."""
    values = [jnp.ones_like(t), t]
    for _ in range(n - 2):
        values.append(2 * t * values[-1] - values[-2])
    return jnp.stack(values)


@_terms.defjvp
def _terms_jvp(n, primals, tangents):
    values = _terms(n, *primals)
    return values, jnp.tensordot(_slope_matrix(n).T, values, axes=1) * tangents[0]


@functools.cache
def _slope_matrix(n: int) -> np.ndarray:
    """Coefficients of the derivative, as many as those of the series."""
    return np.pad(np.polynomial.chebyshev.chebder(np.eye(n)), ((0, 1), (0, 0)))


class _Impedance(eqx.Module):
    film: OcvirkSqueeze

    def __call__(self, position, velocity):
        return self.film.impedance(position, velocity)


class _Mobility(eqx.Module):
    film: ReynoldsSqueeze

    def __call__(self, position, force):
        return self.film.mobility(position, force)


def _columns(function, value):
    """Slopes of a map of plane vectors along x and y, with its value."""
    one, none = jnp.ones_like(value[0]), jnp.zeros_like(value[0])
    image, linear = jax.linearize(function, value)
    return image, (linear(jnp.stack([one, none])), linear(jnp.stack([none, one])))


def two_by_two(columns, right: Pair) -> Pair:
    """Solve a system of two equations of which the columns are given."""
    (a, c), (b, d) = columns
    size = a * d - b * c
    size = jnp.where(jnp.abs(size) > 0, size, 1.0)
    return jnp.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / size


class _Inverse(AbstractRoot):
    """Where a monotone map, homogeneous of degree one, takes a value; sought from a start.

    The slope times the place is the value: to solve with the last slope is Newton's method.
    """

    map: _Impedance | _Mobility
    position: Pair
    target: Pair
    start: Pair

    def columns(self, place):
        return _columns(lambda p: self.map(self.position, p), place)[1]

    def solve(self):
        def improve(_, place):
            return two_by_two(self.columns(place), self.target)

        return lax.fori_loop(0, _INVERSIONS, improve, self.start)

    def rest(self, unknowns):
        return self.map(self.position, unknowns) - self.target

    def removed(self, unknowns, rest):
        return -two_by_two(self.columns(unknowns), rest)


def _slope_and_bend(function, x):
    one = jnp.ones_like(x)

    def slope(x):
        return jax.jvp(function, (x,), (one,))[1]

    return jax.jvp(slope, (x,), (one,))


def _split(vector: Pair):
    """Length and direction, with finite derivatives where the length vanishes."""
    square = _dot(vector, vector)
    some = square > 0
    size = jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0)
    along = jnp.where(
        some,
        vector / jnp.where(some, size, 1.0),
        jnp.stack([jnp.ones_like(size), jnp.zeros_like(size)]),
    )
    return size, along


def _dot(a: Pair, b: Pair):
    return a[0] * b[0] + a[1] * b[1]


def _cross(a: Pair, b: Pair):
    return a[0] * b[1] - a[1] * b[0]


@functools.cache
def _table() -> dict[str, np.ndarray]:
    text = resources.files(__package__).joinpath(TABLE).read_text()
    return {name: np.asarray(value, float) for name, value in json.loads(text).items()}
