"""What measurements tell of a machine."""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from ..._core.errors import BadInput
from ..._core.nested import fields_of, records
from ..._core.results import Data, Result
from ...machine import Machine
from ._fit import Prediction
from ._measurement import AbstractMeasurement, Entries, Kind
from ._reading_model import ReadingModel


class HeldOut(NamedTuple):
    """Errors of a quantity at points that the fit did not see.

    Attributes:
        count: of points.
        rms, largest: relative, or [K] for temperatures.
        inside: [-] share within the inflated 95 % intervals.
    """

    count: int  # pyright: ignore[reportIncompatibleMethodOverride]  # of points, and no entries
    rms: float
    largest: float
    inside: float


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
    covariance: Float[Array, "p p"]
    start: Float[Array, " p"]
    prior_share: Float[Array, " p"]
    constants: int = eqx.field(static=True)
    quantity: tuple[str, ...] = eqx.field(static=True)
    kinds: dict[str, Kind] = eqx.field(static=True)
    point: Int[Array, " m"]
    names: tuple[str, ...] = eqx.field(static=True)
    conditions: dict[str, Float[Array, " m"]]
    condition_units: dict[str, str] = eqx.field(static=True)
    measured: Float[Array, " m"]
    computed: Float[Array, " m"]
    sd: Float[Array, " m"]
    half_width: Float[Array, " m"]
    used: Bool[Array, " m"]
    chi_square: Float[Array, ""]
    p_value: Float[Array, ""]
    freedom: Int[Array, ""]
    weak: tuple[str, ...] = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True)
    source: str = eqx.field(static=True)
    fit: Any = eqx.field(static=True, default=None)
    machine: Machine | None = None
    study: Any = eqx.field(static=True, default=None)
    bounds: Float[Array, "p 2"] | None = None

    table_dims: ClassVar[tuple[str, ...]] = ("reading",)
    nested_units: ClassVar[str] = """
        parameters: start, estimate, standard_error {beside}; prior_share
        covariance {parameters}; chi_square, freedom, p_value
        held_out: points, error_rms, largest_error, share_inside
    """
    not_saved: ClassVar[tuple[str, ...]] = ("fit", "machine", "study", "kinds", "condition_units")

    def described(self) -> Iterator[Data]:
        """The quantities of this result; readings in the units of their quantities."""
        for n, (name, unit) in enumerate(zip(self.parameters, self.units, strict=True)):
            yield Data(f"estimate.{name}", unit, self.estimate[n])
            yield Data(f"standard_error.{name}", unit, self.standard_error[n])
        yield Data("chi_square", "", self.chi_square)
        yield Data("p_value", "", self.p_value)
        yield Data("freedom", "", self.freedom)
        at = self.table_dims
        quantities = self.quantities
        yield Data("point", "", self.point, at)
        numbers = ", ".join(f"{n}: {name}" for n, name in enumerate(quantities))
        places = np.array([quantities.index(name) for name in self.quantity])
        yield Data("quantity", "", places, at, numbers)
        for name, values in self.conditions.items():
            yield Data(f"at.{name}", self.condition_units[name], values, at)
        for name in ("measured", "computed", "sd", "half_width", "used"):
            yield Data(name, "", getattr(self, name), at, "in the SI unit of its quantity")

    def nested(self) -> dict[str, Any]:
        """Constants, their covariance, the fit and the points held out."""

        columns = fields_of(self, "start", "estimate", "standard_error", "prior_share")
        held_out = []
        for name, errors in self.held_out.items():
            record = {
                "name": name,
                "points": errors.count,
                "error_rms": errors.rms,
                "largest_error": errors.largest,
                "share_inside": errors.inside,
            }
            held_out.append(record)
        return {
            "source": self.source,
            "parameters": records(name=self.parameters, unit=self.units, **columns),
            **fields_of(self, "covariance", "chi_square", "freedom", "p_value", "weak", "notes"),
            "held_out": held_out,
        }

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
