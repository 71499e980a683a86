"""The finite film of a journal that moves, from a table of its mobility."""

import functools
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.extremes import maximum, minimum
from .._core.roots import root
from ._film import Pair, as_float, split
from ._squeeze import AbstractSqueeze, Inverse, OcvirkSqueeze, dot, quarter_turn
from ._tabulated import collapsed, table_of

TABLE = "squeeze_table.json"
TABLE_RANGE = (0.1, 2.0)  # q = L/D
_LAST = 0.9995  # eps of the table; beyond, the film is held


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
    """Growth of the largest pressure over the mean one as a film closes."""
    return 1 / ((1 - x) / 2) ** 0.5


class ReynoldsSqueeze(AbstractSqueeze):
    """Finite film with free edges, from a table of H over position, direction and L/D.

    ln(H/H_0) is a Chebyshev series in u and v of `film_corner`, solved up to eps = 0.9995 and held
    beyond, where H_0 has the right powers. The mobility is within 9e-4 of the Reynolds equation, 1e-4
    on the root mean square; the side flow within 0.3 %, the largest pressure within 3 % (0.3 %).

    Args:
        length_ratio: [-] q = L/D, 0.1 to 2; beyond, the tangent in ln q is a guess.
    """

    series: dict[str, Float[Array, "u v"]]
    length_ratio_range: ClassVar[tuple[float, float]] = TABLE_RANGE
    limits: ClassVar[str] = (
        "Table for L/D 0.1 to 2 and eps to 0.9995. Films re-form full of oil; aligned, isoviscous, "
        "laminar, no roughness."
    )

    def __init__(self, length_ratio):
        q = as_float(length_ratio)
        table = _table()
        self.length_ratio = q
        self.series = {}
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
        # An iteration may put the journal beyond the wall, where the power of a negative gap is NaN.
        unit = resistance_unit(minimum(x, 1 - 1e-9), self.length_ratio)
        u, v = film_corner(*_held(x, square)[:2])
        return unit * jnp.exp(_horner(self.series["mobility"], 2 * u - 1, 2 * v - 1, 0)[0])

    def _series(self, name, x, square):
        u, v = film_corner(*_held(x, square)[:2])
        return _horner(self.series[name], 2 * u - 1, 2 * v - 1, 0)[0]

    def mobility(self, position, force):
        return _table_mobility(self, position, force)[0]

    def mobility_slopes(self, position, force):
        return _table_mobility(self, position, force)

    def expanded(self, position, force, order: int):
        """Size and direction of the force, and H over x = e.f with its derivatives, beside x.

        The chain rule from x and eps^2 to u and v is written out: an orbit spends most of its time
        here, and as many operations as there are must be few.

        Returns:
            Size, direction, x, H and its slope along x; with `order` 2 those along eps^2, x x and
            x eps^2 as well.
        """
        size, along = split(force)
        x = dot(position, along)
        square = dot(position, position)
        held, held_square, within = _held(x, square)
        u, v = film_corner(held, held_square)
        p, p_u, p_v, *second = _horner(self.series["mobility"], 2 * u - 1, 2 * v - 1, order)
        complement = 1 - held * held
        # The factors 2 and 4 below are those of 2 u - 1 and 2 v - 1, the polynomial's arguments.
        u_x = -0.125 / u**3
        v_x = v * held / complement
        l_x = 2 * (p_u * u_x + p_v * v_x)
        # of ln(H_0)
        gap = maximum(1 - x, 1e-9)
        root = gap * jnp.sqrt(gap)
        short = root * gap / (np.pi * self.length_ratio**2)
        wide = np.sqrt(2) / (3 * np.pi) * root
        unit = short + wide
        h = unit * jnp.exp(p)
        ln_unit_x = -(2.5 * short + 1.5 * wide) / (unit * gap)
        ln_x = ln_unit_x + within * l_x
        to_first_order = size, along, x, h, h * ln_x
        if order < 2:
            return to_first_order
        p_uu, p_uv, p_vv = second
        u_xx = -3 * u_x**2 / u
        v_xx = v_x * held / complement + v * (1 + held**2) / complement**2
        v_s = -0.5 * v / (1 - held_square)
        l_s = 2 * p_v * v_s
        l_xx = 4 * (p_uu * u_x**2 + 2 * p_uv * u_x * v_x + p_vv * v_x**2)
        l_xx = l_xx + 2 * (p_u * u_xx + p_v * v_xx)
        l_xs = 4 * (p_uv * u_x * v_s + p_vv * v_x * v_s) + 2 * p_v * v_s * held / complement
        # where the table is held, eps acts through x alone
        beyond = square > _LAST**2
        shrinks = -0.5 * within / jnp.where(beyond, square, 1.0)
        ln_s = jnp.where(beyond, l_x * x * shrinks, l_s)
        ln_xs = jnp.where(beyond, shrinks * (l_x + held * l_xx), l_xs)
        ln_unit_xx = (3.75 * short + 0.75 * wide) / (unit * gap**2) - ln_unit_x**2
        ln_xx = ln_unit_xx + within**2 * l_xx
        return *to_first_order, h * ln_s, h * (ln_xx + ln_x**2), h * (ln_xs + ln_x * ln_s)

    def impedance(self, position, velocity):
        size, along = split(velocity)
        # Of this start only the direction counts, see `Inverse`.
        start = OcvirkSqueeze(self.length_ratio).impedance(position, along)
        return size * root(Inverse(_Mobility(self), position, along, start))

    def peak_pressure(self, position, force, velocity):
        size, along = split(force)
        x = dot(position, along)
        log = self._series("peak", x, dot(position, position))
        return size * peak_unit(minimum(x, 1 - 1e-9)) * jnp.exp(log)

    def side_flow(self, position, force, velocity):
        size, along = split(velocity)
        x = dot(position, along)
        return size * jnp.exp(self._series("flow", x, dot(position, position)))


# The slopes along position and force are at hand in the value; by automatic differentiation the
# table would be read again for each. Only those along the film's own numbers are taken so.
@eqx.filter_custom_jvp
def _table_mobility(film: ReynoldsSqueeze, position: Pair, force: Pair):
    """V = |F| (H f + dH/dx/2 t) with t = e - x f, and its slopes along e, constants to derivatives."""
    value, slopes, _ = _mobility_and_slopes(film, position, force)
    return value, slopes


@_table_mobility.def_jvp
def _table_mobility_jvp(primals, tangents):
    film, position, force = primals
    film_dot, position_dot, force_dot = tangents
    value, slopes, by_force = _mobility_and_slopes(film, position, force)

    def by_film(film):
        size, along, x, h, h_x = film.expanded(position, force, 1)
        return size * (h * along + 0.5 * h_x * (position - x * along))

    _, moved = eqx.filter_jvp(by_film, (film,), (film_dot,))
    # `None` of a film without derivatives of its own
    if moved is None:
        moved = jnp.zeros_like(value)
    for columns, change in ((slopes, position_dot), (by_force, force_dot)):
        if change is not None:
            moved = moved + columns[0] * change[0] + columns[1] * change[1]
    # Slopes serve steps of Newton's method; their own derivatives would be third ones of the table.
    return (value, slopes), (moved, jax.tree.map(jnp.zeros_like, slopes))


def _mobility_and_slopes(film, position, force):
    """The mobility with its slopes along position and force."""
    size, f, x, h, h_x, h_s, h_xx, h_xs = film.expanded(position, force, 2)
    t = position - x * f
    value = size * (h * f + 0.5 * h_x * t)
    # dV/de = |F| (h_x/2 (1 + f f) + (2 h_s f + h_xs t) e + h_xx/2 t f)
    by_place = size * (2 * h_s * f + h_xs * t)
    by_line = 0.5 * size * (h_x * f + h_xx * t)
    unit = [np.eye(2)[i].reshape(2, *[1] * x.ndim) for i in range(2)]
    by_position = tuple(
        by_place * position[i] + by_line * f[i] + 0.5 * size * h_x * unit[i] for i in range(2)
    )
    # dV/dF = (h f + h_x/2 t) f + (h_x/2 y f + (h - h_x/2 x + h_xx/2 y^2) g) g with g = J f, y = e.g
    g = quarter_turn(f)
    y = dot(position, g)
    along = h * f + 0.5 * h_x * t
    sideways = 0.5 * h_x * y * f + (h - 0.5 * h_x * x + 0.5 * h_xx * y**2) * g
    by_force = tuple(along * f[i] + sideways * g[i] for i in range(2))
    return value, by_position, by_force


class _Mobility(eqx.Module):
    film: ReynoldsSqueeze

    def __call__(self, position, force):
        return self.film.mobility(position, force)

    def columns(self, position, force):
        return _mobility_and_slopes(self.film, position, force)[2]


def _held(x, square):
    """x and eps^2 moved to the largest eps of the table, along their ray, and the share that does it."""
    within = minimum(1.0, _LAST / jnp.sqrt(maximum(square, _LAST**2)))
    return x * within, square * within**2, within


def _horner(
    series: Float[Array, "a b"], u: Float[Array, "*n"], v: Float[Array, "*n"], order: int = 2
) -> tuple[Float[Array, "*n"], ...]:
    """Sum of c_ij u^i v^j; with its slopes along u and v; and the second ones along uu, uv and vv.

    Unrolled, which XLA fuses into two kernels: along v for all rows at once, then along u. The order of
    the derivatives is 0, 1 or 2.
    """
    columns = [series[:, j].reshape(-1, *[1] * u.ndim) for j in range(series.shape[1])]
    p = columns[-1] + 0 * v
    p_v = 0 * p
    p_vv = 0 * p
    # From the highest derivative down, since each takes the value below it from before its step.
    for column in columns[-2::-1]:
        if order > 1:
            p_vv = p_vv * v + p_v
        if order:
            p_v = p_v * v + p
        p = p * v + column
    f = p[-1]
    f_v = p_v[-1]
    f_vv = p_vv[-1]
    f_u = 0 * f
    f_uu = 0 * f
    f_uv = 0 * f
    for i in range(series.shape[0] - 2, -1, -1):
        if order > 1:
            f_uu = f_uu * u + f_u
            f_uv = f_uv * u + f_v
            f_vv = f_vv * u + p_vv[i]
        if order:
            f_u = f_u * u + f
            f_v = f_v * u + p_v[i]
        f = f * u + p[i]
    if order == 0:
        return (f,)
    if order == 1:
        return f, f_u, f_v
    # Horner's recurrence leaves half of a second derivative.
    return f, f_u, f_v, 2 * f_uu, f_uv, 2 * f_vv


@functools.cache
def _table() -> dict[str, np.ndarray]:
    """The tables, in powers of 2 u - 1 and 2 v - 1 instead of Chebyshev polynomials of these."""
    tables = dict(table_of(TABLE))
    for name in ("mobility", "peak", "flow"):
        rows, columns = (_powers(n) for n in tables[name].shape[:2])
        tables[name] = np.einsum("ia,jb,ijk->abk", rows, columns, tables[name])
    return tables


def _powers(n: int) -> np.ndarray:
    """Coefficients in powers of each of n Chebyshev polynomials."""
    each = (np.polynomial.chebyshev.cheb2poly(row) for row in np.eye(n))
    return np.stack([np.pad(row, (0, n - row.size)) for row in each])
