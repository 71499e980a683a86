r"""Rating points of a refrigeration compressor, maps over them and their polynomial.

$$X = C_1 + C_2S + C_3D + C_4S^2 + C_5SD + C_6D^2 + C_7S^3 + C_8DS^2 + C_9SD^2 + C_{10}D^3$$

with evaporating and condensing dew temperatures S and D in degrees Celsius (AHRI 540, EN 12900).
"""

import dataclasses as dc
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from .._core.declared import NAMED, Measured, Note, computed, held, reading, word
from .._core.display import ZERO_CELSIUS
from .._core.errors import BadInput, kind_text
from .._core.exported import kept_jit
from .._core.extremes import max_of, min_of
from .._core.fields import rebuilt, replaced
from .._core.results import Data, Result
from .._core.words import one_of
from ..compressor import Compressor, HasCompressor, compressor_of
from ..crank import Collocation, Orbit, orbit_at_constant_speed, performance, solve_orbit
from ..crank._collocation import default_collocation
from ..cylinder import CycleOptions, Cylinder
from ..cylinder._climb import Climb, events_without_room
from ..cylinder._ends import options_of
from ..cylinder._several import of_each
from ..cylinder._waves import is_piped
from ..fluid import AbstractRealGas
from ..fluid._real import has_dew_line
from ..motor import ConstantSpeed

if TYPE_CHECKING:
    from ..crank import Shooting

ZERO = ZERO_CELSIUS
# Of the cycle at a single point, whose program has one size: of two maps of light valves 48 were too few
# for 1 and 3 of 12 points.
_PANELS = 96

# What evaporating and condensing temperatures are.
Reference = Literal["dew", "mean"]

# what users take; the rest is for the packages that are built on this module
__all__ = ["Rating", "RatingMap", "at_rating", "rated", "rating_map"]


class Rating(NamedTuple):
    """Conditions of a standard: the gas that comes, and the liquid before the expansion.

    Attributes:
        return_gas: [K] its temperature; `None` where the superheat is given.
        superheat: [K]
        liquid: [K] its temperature; `None` where the subcooling is given.
        subcooling: [K] below the bubble temperature at the condenser's pressure.
        doc: one sentence.
    """

    return_gas: float | None = None
    superheat: float | None = None
    liquid: float | None = None
    subcooling: float | None = None
    doc: str = ""


RATINGS = {
    "file": Rating(doc="As the machine says."),
    "ashrae": Rating(return_gas=ZERO + 32.2, liquid=ZERO + 32.2, doc="ASHRAE: both at 32.2 C."),
    "en12900": Rating(
        return_gas=ZERO + 20, subcooling=0.0, doc="EN 12900: return gas 20 C, no subcooling."
    ),
    "en12900-superheat": Rating(
        superheat=10.0, subcooling=0.0, doc="EN 12900: superheat 10 K, no subcooling."
    ),
    "ahri540": Rating(
        return_gas=ZERO + 18.3,
        subcooling=0.0,
        doc="AHRI 540, refrigeration: return gas 18.3 C, no subcooling.",
    ),
    "cecomaf": Rating(
        return_gas=ZERO + 32, subcooling=0.0, doc="CECOMAF: return gas 32 C, no subcooling."
    ),
}

# Name, SI unit, and whether it is fitted.
QUANTITIES = (
    ("capacity", "W", True),
    ("power", "W", True),
    ("mass_flow", "kg/s", True),
    ("cop", "", False),
    ("volumetric_efficiency", "", False),
    ("isentropic_efficiency", "", False),
    ("overall_efficiency", "", False),
    ("discharge_temperature", "K", False),
)
# Unit of coefficients.
_BY_CELSIUS = Note("in SI units, temperatures in degrees Celsius")


class RatingMap(Result, eqx.Module):
    """A compressor over evaporating and condensing temperature.

    Attributes:
        evaporating: [K] (n,) dew or mean temperature.
        condensing: [K] (m,) dew or mean temperature.
        values: (n, m) by name as in `QUANTITIES`, in SI units; not a number where a point failed.
        ok: (n, m) whether a point converged and delivers dry gas.
        coefficients: (10,) of the polynomial in degrees Celsius, by name; empty where points are too few.
        fit_error: [-] largest error of the polynomial relative to the value of the point, by name.
        rating: key of `RATINGS`.
        reference: what both temperatures are: those of "dew" points, or "mean" ones.
    """

    evaporating: Float[Array, " n"] = reading("K", "evaporating")
    condensing: Float[Array, " m"] = reading("K", "condensing")
    values: dict[str, Float[Array, "n m"]] = held()
    ok: Bool[Array, "n m"] = word()
    coefficients: dict[str, Float[Array, "10"]] = reading(_BY_CELSIUS, "coefficient")
    fit_error: dict[str, Float[Array, ""]] = reading("")
    rating: str = word(static=True)
    reference: Reference = word(static=True, default="dew")

    table_dims: ClassVar[tuple[str, ...]] = ("evaporating", "condensing")

    @computed(NAMED, key="values")
    def _measured_values(self) -> dict[str, Measured]:
        """Values by name."""
        return _measured(self.values)

    @computed(NAMED, key="polynomial_error")
    def _measured_errors(self) -> dict[str, Measured]:
        """Errors of the polynomials by name."""
        return _measured(self.polynomial_error)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        at = self.table_dims
        yield from self.data_of("evaporating", "condensing")
        for name, (values, unit) in _measured(self.values).items():
            yield Data(name, unit, values, at)
        yield Data("ok", "", self.ok, at)
        for name, row in self.coefficients.items():
            yield Data(f"coefficients.{name}", "", row, ("coefficient",))
            yield Data(f"fit_error.{name}", "", self.fit_error[name])
        for name, (errors, unit) in _measured(self.polynomial_error).items():
            yield Data(f"polynomial_error.{name}", unit, errors, at)

    @property
    def polynomial_error(self) -> dict[str, Float[Array, "n m"]]:
        """Polynomial less value at every point, by name in SI units."""
        terms = polynomial_terms(self.evaporating[:, None], self.condensing[None, :])
        errors = {}
        for name, row in self.coefficients.items():
            errors[name] = jnp.asarray(terms @ row) - self.values[name]
        return errors

    @property
    def worst_point(self) -> dict[str, tuple[float, float]]:
        """[K] Evaporating and condensing temperature where each polynomial has its `fit_error`."""
        worst = {}
        for name, errors in self.polynomial_error.items():
            relative = np.abs(errors / self.values[name])
            row, column = np.unravel_index(np.nanargmax(relative), errors.shape)
            worst[name] = float(self.evaporating[row]), float(self.condensing[column])
        return worst


def _measured(values: dict[str, Any]) -> dict[str, Measured]:
    """Numbers by the names of `QUANTITIES`, in their order, with units."""
    measured = {}
    for name, unit, _ in QUANTITIES:
        if name in values:
            measured[name] = Measured(values[name], unit)
    return measured


def at_rating(
    machine: Compressor | HasCompressor,
    evaporating: Float[Array, ""],
    condensing: Float[Array, ""],
    rating: str | Rating = "file",
    reference: Reference = "dew",
) -> Compressor:
    """A compressor with valves at a rating point.

    The gas that flows back from the discharge line has the temperature of isentropic compression.

    Args:
        machine: a compressor, a machine or a scene.
        evaporating, condensing: [K] dew temperatures, or mean ones.
        rating: of `RATINGS`, or one's own.
        reference: "dew" or "mean", of both temperatures; see `Cylinder`.

    Raises:
        BadInput: a machine without valves or with a perfect gas, an unknown rating, or temperatures that
            are out of order or beyond the fluid's range, see `Cylinder`.
    """
    compressor = compressor_of(machine)
    gas = compressor.gas
    if not isinstance(gas, Cylinder) or not has_dew_line(gas.fluid):
        bound = 'of type "cylinder", with valves and a real gas, for rating points'
        raise BadInput("gas", kind_text(gas), bound)
    if isinstance(rating, str):
        if rating not in RATINGS:
            raise BadInput("rating", rating, one_of(rating, RATINGS))
        rating = RATINGS[rating]
    suction: dict[str, Any] = {"pressure": None, "evaporating": evaporating}
    discharge: dict[str, Any] = {"pressure": None, "condensing": condensing, "temperature": None}
    if rating.return_gas is not None or rating.superheat is not None:
        suction |= {"temperature": rating.return_gas, "superheat": rating.superheat}
    if rating.liquid is not None or rating.subcooling is not None:
        discharge |= {"liquid_temperature": rating.liquid, "subcooling": rating.subcooling}
    # built anew, so that what is known is checked
    suction_line = dc.replace(gas.suction, **suction)
    discharge_line = dc.replace(gas.discharge, **discharge)
    gas = dc.replace(gas, suction=suction_line, discharge=discharge_line, reference=reference)
    return rebuilt(compressor, gas=gas)


def rating_map(
    machine: Compressor | HasCompressor,
    evaporating: Sequence[float] | Float[Array, " n"],
    condensing: Sequence[float] | Float[Array, " m"],
    rating: str = "file",
    options: CycleOptions | None = None,
    solver: "Collocation | Shooting | None" = None,
    reference: Reference = "dew",
) -> RatingMap:
    """Capacity, power, flow and efficiencies over evaporating and condensing temperature.

    The valves work at the constant mean speed, and friction follows from the motion of the crank under
    the pressure so found: 1e-4 of the flow is left out. With a motor that has a torque curve both are
    solved together, which takes some ten times as long.

    Args:
        machine: a compressor, a machine or a scene.
        evaporating, condensing: [K] dew temperatures, or mean ones.
        rating: of `RATINGS`.
        options: how the cycles are solved.
        solver: of the motion of the crank; absent: as `solve_orbit`.
        reference: "dew" or "mean", of both temperatures; see `Cylinder`. The polynomial is over them.

    Raises:
        BadInput: as `at_rating`, of any point.
    """
    options = options or CycleOptions()
    S = jnp.asarray(evaporating, float)
    D = jnp.asarray(condensing, float)
    compressor = at_rating(machine, S[0], D[0], rating, reference)
    # The closest and the widest pair: what is out of order or out of range is so at one of them.
    for ends in ((max_of(S), min_of(D)), (min_of(S), max_of(D))):
        at_rating(compressor, *ends, rating, reference)
    shape = S.size, D.size
    points = jnp.repeat(S, D.size), jnp.tile(D, S.size)
    if reference == "mean":
        points = _dew_points(compressor, rating, *points)
        compressor = at_rating(machine, points[0][0], points[1][0], rating)
    columns, ok = _in_all_sizes(compressor, rating, options, solver, *points)
    ok = ok.reshape(shape)
    values = {}
    for name, *_ in QUANTITIES:
        values[name] = np.where(ok, columns[name].reshape(shape), np.nan)
    coefficients = {}
    errors = {}
    terms = polynomial_terms(S[:, None], D[None, :])[ok]
    # Ten points are not enough where one of the axes has fewer than four. The columns are scaled, for the
    # cubes of temperatures exceed the constant by a factor of 1e5.
    size = np.linalg.norm(terms, axis=0)
    if np.linalg.matrix_rank(terms / np.where(size > 0, size, 1.0), tol=1e-11) == size.size:
        for name, _, fitted in QUANTITIES:
            if not fitted:
                continue
            point_values = values[name][ok]
            row, *_ = np.linalg.lstsq(terms, point_values, rcond=None)
            coefficients[name] = jnp.asarray(row)
            errors[name] = jnp.asarray(polynomial_errors(terms, row, point_values).max())
    arrays = {name: jnp.asarray(column) for name, column in values.items()}
    return RatingMap(
        evaporating=S,
        condensing=D,
        values=arrays,
        ok=jnp.asarray(ok),
        coefficients=coefficients,
        fit_error=errors,
        rating=rating,
        reference=reference,
    )


def _dew_points(compressor: Compressor, rating: str, evaporating, condensing):
    """[K] Dew temperatures of points by mean temperatures, computed beside the program of the map."""
    rows = []
    for temperatures in zip(evaporating, condensing, strict=True):
        gas = at_rating(compressor, *temperatures, rating, "mean").gas
        assert isinstance(gas, Cylinder)
        lines = gas.by_dew_points()
        rows.append((lines.suction.evaporating, lines.discharge.condensing))
    dew_points = jnp.asarray(rows)
    return dew_points[:, 0], dew_points[:, 1]


def polynomial_terms(evaporating, condensing) -> np.ndarray:
    """The ten terms of the polynomial (..., 10) at dew temperatures [K].

    Args:
        evaporating: [K] (...)
        condensing: [K] (...)
    """
    s, d = np.broadcast_arrays(np.asarray(evaporating) - ZERO, np.asarray(condensing) - ZERO)
    terms = (1 + 0 * s, s, d, s**2, s * d, d**2, s**3, d * s**2, s * d**2, d**3)
    return np.stack(terms, axis=-1)


def polynomial_errors(terms, row, values) -> Float[np.ndarray, " points"]:
    """[-] How far a polynomial is from the value of each point, relative to that value.

    Args:
        terms: (points, coefficients)
        row: (coefficients,)
        values: (points,)
    """
    return np.abs(terms @ row / values - 1)


class RatingPoint(NamedTuple):
    """Conditions of a point, as numbers.

    Attributes:
        evaporating, condensing: [K] dew temperatures.
        gas: [K] of the gas that comes to the compressor.
        liquid: [K] of the liquid before the expansion.
        useful: [K] of the gas up to which its enthalpy counts as capacity.
        speed: [rad/s]
    """

    evaporating: Float[Array, ""]
    condensing: Float[Array, ""]
    gas: Float[Array, ""]
    liquid: Float[Array, ""]
    useful: Float[Array, ""]
    speed: Float[Array, ""]


def capacity_rise(
    fluid: AbstractRealGas, evaporating, condensing, useful, liquid
) -> Float[Array, ""]:
    """[J/kg] of enthalpy between liquid and useful gas; capacity over mass flow.

    Args:
        fluid: the refrigerant.
        evaporating: [K] dew temperature.
        condensing: [K] dew temperature, whose pressure the liquid has.
        useful: [K] of the gas.
        liquid: [K] of the liquid, at most its bubble temperature.
    """
    low = fluid.saturation(T=evaporating).p
    high = fluid.saturation(T=condensing).p
    gas = fluid.state(useful, fluid.density(useful, low))
    return gas.h - fluid.liquid(liquid, high).h


def rated(
    compressor: Compressor, point: RatingPoint, solver: "Collocation | Shooting | None" = None
) -> tuple[Float[Array, " 8"], Bool[Array, ""]]:
    """Quantities of a compressor with valves at a rating point.

    The point is solved at its speed, which is taken as constant over the revolution.

    Args:
        compressor: whose lines and speed do not count.
        point: the conditions.
        solver: of the motion of the crank; absent: collocation that estimates no errors.

    Returns:
        `QUANTITIES` in their order, and whether the point can be relied on.
    """
    quick = Collocation(reversals=0, estimate=False, cycle=CycleOptions(panels=_PANELS))
    motor = replaced(ConstantSpeed(1.0, losses=compressor.motor.losses), mean_speed=point.speed)
    rating = Rating(return_gas=point.gas, liquid=point.liquid)
    compressor_at_point = replaced(compressor, motor=motor)
    compressor_at_point = at_rating(
        compressor_at_point, point.evaporating, point.condensing, rating
    )
    values, ok, _ = _at_point(compressor_at_point, quick, solver)
    gas = compressor_at_point.gas
    assert isinstance(gas, Cylinder)
    assert isinstance(gas.fluid, AbstractRealGas)
    rise = capacity_rise(gas.fluid, point.evaporating, point.condensing, point.useful, point.liquid)
    capacity = values["mass_flow"] * rise
    values |= {"capacity": capacity, "cop": capacity / values["power"]}
    return jnp.stack([values[name] for name, *_ in QUANTITIES]), ok


def _in_all_sizes(compressor: Compressor, rating: str, options, solver, evaporating, condensing):
    """All points, each in the size that its cycle needs."""
    assert isinstance(compressor.gas, Cylinder)
    options = options_of(compressor.gas, compressor.crankshaft.count, options)
    climb = Climb(options.ladder(by_march=not is_piped(compressor.gas)), len(evaporating))
    values: dict[str, np.ndarray] = {}
    ok = np.zeros(len(evaporating), bool)
    for size, rows in climb:
        # few numbers of points make few programs
        padded = rows
        if values:
            padded = np.resize(rows, 1 << (len(rows) - 1).bit_length())
        answer = _along(compressor, rating, size, solver, evaporating[padded], condensing[padded])
        columns, holds, events = jax.tree.map(partial(_first, len(rows)), answer)
        climb.note(rows, events)
        if not values:
            values = columns
            ok = holds
            continue
        for name, column in columns.items():
            values[name][rows] = column
        ok[rows] = holds
    return values, ok


def _first(count: int, column) -> np.ndarray:
    """The first entries of a column, as an array of its own."""
    return np.array(column)[:count]


@kept_jit
def _along(compressor: Compressor, rating: str, options, solver, evaporating, condensing):
    """All points, one after the other: each takes as many steps as it needs."""
    plain = Collocation(reversals=compressor.load_reversals, cycle=options)

    def point(temperatures):
        return _at_point(at_rating(compressor, *temperatures, rating), plain, solver)

    return lax.map(point, (evaporating, condensing))


def solve_rated(
    compressor: Compressor, plain: Collocation, solver: "Collocation | Shooting | None" = None
) -> Orbit:
    """Solve a compressor with valves as `rating_map` does.

    Args:
        compressor: the compressor at its conditions.
        plain: of the crank's motion under the pressure that was found, and how that is found.
        solver: of the crank's motion in any case, in the place of the usual ones.
    """
    assert isinstance(compressor.gas, Cylinder)
    crank_solver = None
    if solver is not None:
        crank_solver = replaced(solver, cycle=plain.cycle)
    if (
        compressor.motor.closes == "torque"
        or not compressor.gas.inert
        or compressor.crankshaft.count > 1
    ):
        together = replaced(default_collocation(compressor), cycle=plain.cycle)
        return solve_orbit(compressor, crank_solver or together, throw=False)
    return orbit_at_constant_speed(compressor, crank_solver or plain)


def _at_point(compressor: Compressor, plain: Collocation, solver=None):
    """Quantities at a point, whether they hold, and the events for which its cycle had no room."""
    orbit = solve_rated(compressor, plain, solver)
    result = performance(compressor, orbit)
    cycle = orbit.cycle
    assert cycle is not None
    values = {
        "power": result.electric_power,
        "cop": result.cop,
        "overall_efficiency": result.overall_efficiency,
    }
    for name, *_ in QUANTITIES:
        if name not in values:
            values[name] = getattr(cycle, name)
    finite = jnp.all(jnp.isfinite(jnp.stack([*values.values()])))
    ok = cycle.converged & orbit.converged & finite
    return values, ok, events_without_room(of_each(orbit.cycle), orbit.status)
