r"""Rating points of a refrigeration compressor, maps over them and their polynomial.

$$X = C_1 + C_2S + C_3D + C_4S^2 + C_5SD + C_6D^2 + C_7S^3 + C_8DS^2 + C_9SD^2 + C_{10}D^3$$

with evaporating and condensing dew temperatures S and D in degrees Celsius (AHRI 540, EN 12900).
"""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ._fields import BadInput, replaced
from ._results import Data, Result
from ._words import one_of
from .compressor import Compressor, compressor_of
from .crank import Collocation, performance, solve_orbit
from .cylinder import Cylinder, solve_cycle
from .fluid import RealGas

ZERO = 273.15  # [K] at 0 degrees Celsius


class Rating(NamedTuple):
    """What a standard says of the gas that comes and of the liquid before the expansion.

    Attributes:
        return_gas: [K] its temperature; `None` where the superheat is given.
        superheat: [K]
        liquid: [K] its temperature; `None` where the subcooling is given.
        subcooling: [K]
        doc: one sentence.
    """

    return_gas: float | None = None
    superheat: float | None = None
    liquid: float | None = None
    subcooling: float | None = None
    doc: str = ""


RATINGS = {
    "file": Rating(doc="As the machine says."),
    "ashrae": Rating(ZERO + 32.2, None, ZERO + 32.2, None, "ASHRAE: both at 32.2 C."),
    "en12900": Rating(ZERO + 20, None, None, 0.0, "EN 12900: return gas 20 C, no subcooling."),
    "en12900-superheat": Rating(None, 10.0, None, 0.0, "EN 12900: superheat 10 K, no subcooling."),
    "ahri540": Rating(
        ZERO + 18.3, None, None, 0.0, "AHRI 540, refrigeration: return gas 18.3 C, no subcooling."
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


class RatingMap(Result, eqx.Module):
    """A compressor over evaporating and condensing temperature.

    Attributes:
        evaporating: [K] (n,) dew temperature.
        condensing: [K] (m,) dew temperature.
        values: (n, m) by name as in `QUANTITIES`, in SI units; not a number where a point failed.
        ok: (n, m) whether a point converged and delivers dry gas.
        coefficients: (10,) of the polynomial in degrees Celsius, by name; empty below ten points.
        fit_error: [-] largest error of the polynomial over the largest value.
        rating: key of `RATINGS`.
    """

    evaporating: Float[Array, " n"]
    condensing: Float[Array, " m"]
    values: dict[str, Float[Array, "n m"]]
    ok: Bool[Array, "n m"]
    coefficients: dict[str, Float[Array, "10"]]
    fit_error: dict[str, Float[Array, ""]]
    rating: str = eqx.field(static=True)

    table_dims: ClassVar[tuple[str, ...]] = ("evaporating", "condensing")

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        at = self.table_dims
        yield Data("evaporating", "K", self.evaporating, at[:1])
        yield Data("condensing", "K", self.condensing, at[1:])
        for name, unit, _ in QUANTITIES:
            yield Data(name, unit, self.values[name], at)
        yield Data("ok", "", self.ok, at)
        for name, row in self.coefficients.items():
            yield Data(f"coefficients.{name}", "", row, ("coefficient",))
            yield Data(f"fit_error.{name}", "", self.fit_error[name])


def at_rating(
    machine: Any,
    evaporating: Float[Array, ""],
    condensing: Float[Array, ""],
    rating: str | Rating = "file",
) -> Compressor:
    """A compressor with valves at a rating point.

    The gas that flows back from the discharge line has the temperature of isentropic compression.

    Args:
        machine: a compressor, a machine or a scene.
        evaporating, condensing: [K] dew temperatures.
        rating: of `RATINGS`, or one's own.

    Raises:
        BadInput: a machine without valves or with a perfect gas, or an unknown rating.
    """
    compressor = compressor_of(machine)
    gas = compressor.gas
    if not isinstance(gas, Cylinder) or not isinstance(gas.fluid, RealGas):
        raise BadInput("gas", type(gas).__name__, "a cylinder with a real gas, for rating points")
    if isinstance(rating, str):
        if rating not in RATINGS:
            raise BadInput("rating", rating, one_of(rating, RATINGS))
        rating = RATINGS[rating]
    suction, discharge = (
        {"pressure": None, "evaporating": jnp.asarray(evaporating, float)},
        {
            "pressure": None,
            "condensing": jnp.asarray(condensing, float),
            "temperature": None,
        },
    )
    if rating.return_gas is not None or rating.superheat is not None:
        suction |= {"temperature": rating.return_gas, "superheat": rating.superheat}
    if rating.liquid is not None or rating.subcooling is not None:
        discharge |= {"liquid_temperature": rating.liquid, "subcooling": rating.subcooling}
    lines = [
        replaced(line, **{k: v if v is None else jnp.asarray(v) for k, v in new.items()})
        for line, new in ((gas.suction, suction), (gas.discharge, discharge))
    ]
    return replaced(compressor, gas=replaced(gas, suction=lines[0], discharge=lines[1]))


def rating_map(
    machine: Any,
    evaporating: Sequence[float] | Float[Array, " n"],
    condensing: Sequence[float] | Float[Array, " m"],
    rating: str = "file",
) -> RatingMap:
    """Capacity, power, flow and efficiencies over evaporating and condensing temperature.

    The valves work at the constant mean speed, and friction follows from the motion of the crank under
    the pressure so found: 1e-4 of the flow is left out. With a motor that has a torque curve both are
    solved together, which takes some ten times as long.

    Args:
        machine: a compressor, a machine or a scene.
        evaporating, condensing: [K] dew temperatures.
        rating: of `RATINGS`.

    Raises:
        BadInput: a machine without valves or with a perfect gas, or an unknown rating.
    """
    S, D = jnp.asarray(evaporating, float), jnp.asarray(condensing, float)
    compressor = at_rating(machine, S[0], D[0], rating)
    shape = S.size, D.size
    found, ok = _along(compressor, rating, jnp.repeat(S, D.size), jnp.tile(D, S.size))
    ok = np.asarray(ok).reshape(shape)
    values = {
        name: np.where(ok, np.asarray(found[name]).reshape(shape), np.nan)
        for name, *_ in QUANTITIES
    }
    coefficients, errors = {}, {}
    if ok.sum() >= 10:
        terms = polynomial_terms(S[:, None], D[None, :])[ok]
        for name in (name for name, _, fitted in QUANTITIES if fitted):
            given = values[name][ok]
            row, *_ = np.linalg.lstsq(terms, given, rcond=None)
            coefficients[name] = jnp.asarray(row)
            errors[name] = jnp.asarray(np.abs(terms @ row - given).max() / np.abs(given).max())
    arrays = {name: jnp.asarray(one) for name, one in values.items()}
    return RatingMap(S, D, arrays, jnp.asarray(ok), coefficients, errors, rating)


def polynomial_terms(evaporating, condensing) -> np.ndarray:
    """The ten terms of the polynomial (..., 10) at dew temperatures [K]."""
    s, d = np.broadcast_arrays(np.asarray(evaporating) - ZERO, np.asarray(condensing) - ZERO)
    terms = (1 + 0 * s, s, d, s**2, s * d, d**2, s**3, d * s**2, s * d**2, d**3)
    return np.stack(terms, axis=-1)


@eqx.filter_jit
def _along(compressor: Compressor, rating: str, evaporating, condensing):
    """All points, one after the other: each takes as many steps as it needs."""
    assert isinstance(compressor.gas, Cylinder)
    together = compressor.motor.closes == "torque" or not compressor.gas.inert
    together |= compressor.cylinders is not None
    solver = Collocation(reversals=compressor.load_reversals)
    speed = compressor.motor.speed_guess

    def point(temperatures):
        here = at_rating(compressor, *temperatures, rating)
        if together:
            orbit = solve_orbit(here, throw=False)
        else:
            cycle = solve_cycle(here.gas, here.mechanism, speed, throw=False)
            orbit = solver.solve(replaced(here, gas=cycle.gas()))
            orbit = eqx.tree_at(lambda o: o.cycle, orbit, cycle, is_leaf=lambda x: x is None)
        cycle, result = orbit.cycle, performance(here, orbit)
        assert cycle is not None
        values = {
            "power": result.electric_power,
            "cop": result.cop,
            "overall_efficiency": result.overall_efficiency,
        }
        own = (name for name, *_ in QUANTITIES if name not in values)
        values |= {name: getattr(cycle, name) for name in own}
        return values, cycle.converged & orbit.converged

    return lax.map(point, (evaporating, condensing))
