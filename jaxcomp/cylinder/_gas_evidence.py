"""Where gas condenses in a cycle, or leaves the range of its equation of state, in words."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._core.display import ZERO_CELSIUS
from .._core.roots import frozen
from .._core.status import Status
from ..fluid import AbstractRealGas
from ._cycle import Cycle
from ._several import SeveralCycles, of_each


class _Place(NamedTuple):
    """Gas somewhere in a machine."""

    where: str
    T: float  # [K]
    p: float  # [Pa]


def gas_evidence(cycle: Cycle | SeveralCycles) -> str:
    """Temperatures and pressures of gas that is wet or too hot; nothing of other cycles."""
    values = frozen(of_each(cycle))
    codes = np.atleast_1d(np.asarray(values.status._value))
    for status, words in ((Status.wet, _wet), (Status.out_of_range, _beyond_range)):
        rows = np.flatnonzero(codes == int(status._value))
        if not rows.size:
            continue
        row = int(rows[0])
        if not isinstance(cycle, SeveralCycles):
            return words(values, 1)
        return words(_of_row(values, row), cycle.stages[row] if cycle.stages else 1)
    return ""


def _of_row(cycles: Cycle, row: int) -> Cycle:
    return jax.tree.map(lambda leaf: leaf[row], cycles)


def _wet(cycle: Cycle, stage: int) -> str:
    """The gas that is furthest below its dew point, and what that is."""
    case = cycle.case
    fluid = case.cylinder.fluid
    if not isinstance(fluid, AbstractRealGas):
        return ""
    advice = ""
    if bool(fluid.is_wet(case.suction.T, case.suction.rho)):
        place = _Place("the suction line", float(case.suction.T), float(case.suction.p))
        if stage > 1:
            place = place._replace(where=f"the suction line of stage {stage}")
            advice = f"; raise gas.later_stages.{stage - 2}.cooler.outlet_temperature"
    else:
        T = np.asarray(cycle.temperature)
        p = np.asarray(cycle.pressure)
        # gas close to the dew line may be a little below it and not count as wet, by the error of
        # that curve
        is_wet = np.asarray(fluid.is_wet(cycle.temperature, cycle.mass / cycle.volume))
        below = np.where(is_wet, np.asarray(fluid.condensation_temperature(p)) - T, -np.inf)
        worst = int(np.argmax(below))
        place = _Place("a cylinder", float(T[worst]), float(p[worst]))
    words = f"in {place.where} gas of {_degrees(place.T)} at {place.p / 1e5:.4g} bar"
    dew = float(np.asarray(fluid.condensation_temperature(jnp.asarray(place.p))))
    if dew == 0:
        return f"{words} is between its dew and its bubble line{advice}"
    return f"{words} is below its dew point, {_degrees(dew)}{advice}"


def _beyond_range(cycle: Cycle, stage: int) -> str:
    """The hottest gas, its highest pressure, and where the equation ends."""
    del stage
    fluid = cycle.case.cylinder.fluid
    if not isinstance(fluid, AbstractRealGas):
        return ""
    hottest = float(np.max(np.asarray(cycle.temperature)))
    densest = float(np.max(np.asarray(cycle.pressure)))
    _, T_most = fluid.temperature_range
    return (
        f"{_degrees(hottest)} and {densest / 1e5:.4g} bar, where the equation of state of "
        f"{fluid.range_ends_with} was fitted up to {_degrees(T_most)} and that of "
        f"{fluid.pressure_ends_with} up to {fluid.highest_pressure / 1e5:.4g} bar"
    )


def _degrees(T: float) -> str:
    return f"{T - ZERO_CELSIUS:.1f} °C"
