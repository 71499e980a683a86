"""What measurements tell of a machine."""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from ..._core.declared import (
    BESIDE,
    Note,
    Record,
    computed_part,
    held,
    reading,
    records_of,
    word,
)
from ..._core.errors import BadInput
from ..._core.results import Data, Result
from ...machine import Machine
from ._fit import Prediction
from ._measurement import AbstractMeasurement, Entries, Kind
from ._reading_model import ReadingModel

# What columns of readings are in.
_OF_QUANTITY = "in the SI unit of its quantity"


@dataclasses.dataclass(frozen=True)
class HeldOut(Record):
    """Errors of a quantity at points that the fit did not see.

    Attributes:
        name: of the quantity.
        count: of points.
        rms, largest: relative, or [K] for temperatures.
        inside: [-] share within the inflated 95 % intervals.
    """

    name: str = word()
    count: int = reading("", key="points")
    rms: float = reading("", key="error_rms")
    largest: float = reading("", key="largest_error")
    inside: float = reading("", key="share_inside")


@dataclasses.dataclass(frozen=True)
class Estimate(Record):
    """A constant that measurements tell.

    Attributes:
        name: its path, or that of a constant of the measurements.
        unit: its SI unit.
        start: [SI] of the machine file.
        estimate, standard_error: [SI]
        prior_share: [-] standard error over that of the prior; not a number without one.
    """

    name: str = word()
    unit: str = word()
    start: float = reading(BESIDE)
    estimate: float = reading(BESIDE)
    standard_error: float = reading(BESIDE)
    prior_share: float = reading("")


class PredictedReadings(NamedTuple):
    """Readings of an identified machine.

    Attributes:
        entries: the readings.
        prediction: values, standard deviations and intervals.
    """

    entries: Entries
    prediction: Prediction

    @property
    def points(self) -> list[str]:
        """Name of the point of every reading, with the speed where points have several."""
        names = list(self.entries.names)
        speed = self.entries.conditions.get("speed", np.zeros(0))
        if np.unique(speed[np.isfinite(speed)].round(6)).size < 2:
            return names
        turns = speed / (2 * np.pi)
        names_with_speed = []
        for name, turn in zip(names, turns, strict=True):
            names_with_speed.append(f"{name}, {turn:.4g} 1/s")
        return names_with_speed

    def columns(self) -> dict[str, Any]:
        """Predictions, a row each; numbers in the SI units of their quantities."""
        entries, prediction = self
        return {
            "quantity": list(entries.quantity),
            "point": self.points,
            "unit": [entries.kinds[name].unit for name in entries.quantity],
            "value": prediction.value,
            "model_sd": prediction.model_sd,
            "half_width": prediction.inflated,
        }


class Identification(Result, eqx.Module):
    """Constants of a machine that measurements tell.

    Attributes:
        parameters: (p,) paths of the constants, then the constants of the measurements themselves.
        units: (p,) SI units.
        estimate: (p,) their values.
        standard_error: (p,)
        covariance: (p, p)
        start: (p,) values of the machine file.
        prior_share: (p,) standard error over that of the prior; not a number without one.
        constants: how many of them are numbers of the machine.
        quantity: (m,) name of every reading.
        kinds: unit of every quantity, and whether its error is relative.
        point: (m,) number of its point, counted over all measurements.
        names: (m,) of its conditions.
        conditions: [SI] (m,) numbers by name; not a number where a reading has none of this name.
        condition_units: their SI units.
        measured, computed: [SI] (m,)
        sd: [SI] (m,) of the readings.
        half_width: [SI] (m,) of the 95 % interval of the prediction, inflated by the fit's scatter.
        used: (m,) whether the fit saw it.
        chi_square, p_value: of the fit.
        freedom: readings and priors less parameters.
        weak: combinations that the readings hardly tell, in words.
        notes: what is not to be trusted, in words.
        source: of the readings.
        fit: with slopes and profiles.
        machine: with the estimates.
        study: predicts other points.
        bounds: (p, 2) ends of the range that each constant was allowed, infinite where there is none.
    """

    parameters: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    estimate: Float[Array, " p"]
    standard_error: Float[Array, " p"]
    covariance: Float[Array, "p p"] = reading(Note("in the units of the parameters"))
    start: Float[Array, " p"] = held()
    prior_share: Float[Array, " p"] = held()
    constants: int = held(static=True)
    quantity: tuple[str, ...] = held(static=True)
    kinds: dict[str, Kind] = held(static=True)
    point: Int[Array, " m"] = reading("", "reading", table_only=True)
    names: tuple[str, ...] = held(static=True)
    conditions: dict[str, Float[Array, " m"]] = held()
    condition_units: dict[str, str] = held(static=True)
    measured: Float[Array, " m"] = reading("", "reading", doc=_OF_QUANTITY, table_only=True)
    computed: Float[Array, " m"] = reading("", "reading", doc=_OF_QUANTITY, table_only=True)
    sd: Float[Array, " m"] = reading("", "reading", doc=_OF_QUANTITY, table_only=True)
    half_width: Float[Array, " m"] = reading("", "reading", doc=_OF_QUANTITY, table_only=True)
    used: Bool[Array, " m"] = reading("", "reading", doc=_OF_QUANTITY, table_only=True)
    chi_square: Float[Array, ""] = reading("")
    p_value: Float[Array, ""] = reading("")
    freedom: Int[Array, ""] = reading("")
    weak: tuple[str, ...] = word(static=True)
    notes: tuple[str, ...] = word(static=True)
    source: str = word(static=True)
    fit: Any = held(static=True, default=None)
    machine: Machine | None = held(default=None)
    study: Any = held(static=True, default=None)
    bounds: Float[Array, "p 2"] | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("reading",)
    not_saved: ClassVar[tuple[str, ...]] = ("fit", "machine", "study", "kinds", "condition_units")

    def described(self) -> Iterator[Data]:
        """The quantities of this result; readings in the units of their quantities."""
        for n, (name, unit) in enumerate(zip(self.parameters, self.units, strict=True)):
            yield Data(f"estimate.{name}", unit, self.estimate[n])
            yield Data(f"standard_error.{name}", unit, self.standard_error[n])
        yield from self.data_of("chi_square", "p_value", "freedom", "point")
        at = self.table_dims
        quantities = self.quantities
        numbers = ", ".join(f"{n}: {name}" for n, name in enumerate(quantities))
        places = np.array([quantities.index(name) for name in self.quantity])
        yield Data("quantity", "", places, at, numbers)
        for name, values in self.conditions.items():
            yield Data(f"at.{name}", self.condition_units[name], values, at)
        yield from self.data_of("measured", "computed", "sd", "half_width", "used")

    @computed_part(Estimate, key="parameters")
    def estimates(self) -> tuple[Estimate, ...]:
        """(p,) Every constant before and after."""
        return records_of(
            Estimate,
            name=self.parameters,
            unit=self.units,
            start=self.start,
            estimate=self.estimate,
            standard_error=self.standard_error,
            prior_share=self.prior_share,
        )

    @computed_part(HeldOut, key="held_out")
    def errors_held_out(self) -> tuple[HeldOut, ...]:
        """Errors of each quantity at points that the fit did not see."""
        return tuple(self.held_out.values())

    def error(self, name: str) -> NDArray:
        """(m of this quantity,) computed less measured: relative, or in the SI unit."""
        rows = self.of(name)
        off = np.asarray(self.computed - self.measured)[rows]
        if not self.kinds[name].relative:
            return off
        return off / np.asarray(self.measured)[rows]

    def of(self, name: str) -> NDArray:
        """(m,) whether a reading is of this quantity."""
        return np.array([quantity == name for quantity in self.quantity])

    @property
    def quantities(self) -> list[str]:
        """Names of what was measured."""
        return list(dict.fromkeys(self.quantity))

    @property
    def held_out(self) -> dict[str, HeldOut]:
        """By quantity, how points were predicted that the fit did not see."""
        out = {}
        for name in self.quantities:
            rows = self.of(name)
            predicted = ~np.asarray(self.used)[rows] & np.isfinite(np.asarray(self.computed)[rows])
            if not predicted.any():
                continue
            error = self.error(name)[predicted]
            off = np.abs(np.asarray(self.computed - self.measured))[rows][predicted]
            inside = off <= np.asarray(self.half_width)[rows][predicted]
            out[name] = HeldOut(
                name=name,
                count=int(predicted.sum()),
                rms=float(np.sqrt(np.mean(error**2))),
                largest=float(np.abs(error).max()),
                inside=float(inside.mean()),
            )
        return out

    def predict(
        self, measurement: AbstractMeasurement, *further: AbstractMeasurement
    ) -> PredictedReadings:
        """Prediction of other readings by the identified machine, with intervals.

        Args:
            measurement: of which the conditions count, and the standard deviations for the intervals of
                readings; the measured values may be anything.
            further: whose readings follow those of the first.

        Raises:
            BadInput: a result that was loaded.
        """
        if self.study is None:
            raise BadInput("study", "absent", "that of the identification, for predictions")
        model = ReadingModel(self.study.design, self.study.variables, [measurement, *further], {})
        count = len(self.study.variables)
        at = np.asarray(self.estimate)[:count]
        # constants of the measurement as they were found, where it is of the same source
        numbers = {name: n for n, name in enumerate(self.parameters)}
        places = []
        nuisances = []
        for parameter in model.nuisances:
            n = numbers.get(parameter.name)
            places.append(n)
            nuisance = parameter.start
            if n is not None:
                nuisance = float(self.estimate[n])
            nuisances.append(nuisance)
        value, slope = model(np.concatenate([at, nuisances]), range(model.count))
        # Constants of other measurements do not move these readings.
        full_slope = np.zeros((value.size, len(self.parameters)))
        full_slope[:, :count] = slope[:, :count]
        for n, column in zip(places, slope[:, count:].T, strict=True):
            if n is not None:
                full_slope[:, n] = column
        prediction = self.fit.predict(value, full_slope, model.entries.sd)
        return PredictedReadings(model.entries, prediction)
