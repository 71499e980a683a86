"""Measurements over the crank angle, and tables of quantities at several conditions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, cast

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._core.display import shown
from ..._core.errors import BadInput, kind_text
from ...crank import Collocation, solve_orbit
from ...cylinder import Cylinder
from ...machine import Machine, assembled
from .._analysis import DesignResult, quantity_named
from .._analysis_options import AnalysisOptions
from .._problem import values_of
from .._variables import variable
from ..rating import solve_rated
from ._bounded_least_squares import Parameter
from ._measurement import AbstractMeasurement, Entries, Kind, stated_or_usual, usual

if TYPE_CHECKING:
    from ...crank import Shooting

_DEGREE = np.pi / 180
# Samples over a revolution that count as independent: every five degrees.
_INDEPENDENT = 72


def _conditioned(machine: Machine, paths: tuple[str, ...], values) -> Machine:
    """The machine at the conditions of a point, unchecked."""
    for path, value in zip(paths, values, strict=True):
        machine = variable(machine, path).apply(machine, value)
    return machine


@dataclass(frozen=True)
class Trace(AbstractMeasurement):
    """Readings over the crank angle of a revolution: of pressure, valve lifts or the crank's speed.

    Samples are not independent: their standard deviations grow so that they count as `independent` ones.
    Sensors have an offset, a gain and an angle of their own, which are fitted with priors.

    Attributes:
        quantities: of `Trace.MEASURED`, in the order of `measured`.
        paths: of the numbers of the machine that the test bed set.
        settings: [SI] their values.
        angle: [rad] (n,) of the crank from the top dead centre, positive with the rotation.
        measured: [SI] (quantities, n)
        sd: [SI] (quantities, n) standard deviations of a sample; the usual ones if absent.
        independent: samples that count as independent.
    """

    MEASURED: ClassVar[dict[str, str]] = {
        "pressure": "Pa", "suction_lift": "m", "discharge_lift": "m", "speed": "rad/s",
    }  # fmt: skip
    INDEPENDENT: ClassVar[int] = _INDEPENDENT
    names_of_sd: ClassVar[tuple[str, ...]] = tuple(MEASURED)

    source: str = field(compare=False)
    quantities: tuple[str, ...]
    angle: NDArray = field(compare=False)
    measured: NDArray = field(compare=False)
    paths: tuple[str, ...] = ()
    settings: tuple[float, ...] = field(compare=False, default=())
    sd: NDArray | None = field(compare=False, default=None)
    independent: int = field(compare=False, default=_INDEPENDENT)
    solver: "Collocation | Shooting | None" = None

    def check(self, machine):
        """Refuse a machine without these quantities, and settings that are none of its numbers."""
        compressor = assembled(machine).compressor
        if compressor is None:
            raise BadInput(
                f"{self.source}: compressor", "absent", "given, for readings over the angle"
            )
        gas = compressor.gas
        valves = isinstance(gas, Cylinder)
        if (not valves and self.quantities != ("speed",)) or (valves and not gas.inert):
            bound = "a cylinder with valves that have a `port_length`; without, speed alone"
            raise BadInput(f"{self.source}: gas", kind_text(gas), bound)
        for path, value in zip(self.paths, self.settings, strict=True):
            variable(machine, path, value, value)
        if "speed" in self.quantities:
            speed = self.measured[self.quantities.index("speed")]
            if (speed <= 0).any():
                raise BadInput(f"{self.source}: speed", float(np.nanmin(speed)), "above 0")
        if compressor.crankshaft.count > 1:
            raise BadInput(
                f"{self.source}: cylinders", compressor.crankshaft.count, "1 for a trace"
            )

    @property
    def nuisances(self):
        """Angle of the top dead centre; offset and gain of the pressure; gain of the lifts."""
        out = [
            Parameter(
                name="top_dead_centre",
                low=-0.1,
                high=0.1,
                start=0.0,
                prior=0.0,
                sd=0.3 * _DEGREE,
                log=False,
                unit="rad",
            ),
        ]
        if "pressure" in self.quantities:
            offset = Parameter(
                name="pressure_offset",
                low=-1e5,
                high=1e5,
                start=0.0,
                prior=0.0,
                sd=1e3,
                log=False,
                unit="Pa",
            )
            gain = Parameter("pressure_gain", low=0.8, high=1.25, start=1.0, prior=1.0, sd=0.01)
            out += [offset, gain]
        if any("lift" in name for name in self.quantities):
            out.append(Parameter("lift_gain", low=0.5, high=2.0, start=1.0, prior=1.0, sd=0.02))
        return tuple(out)

    def entries(self, sd):
        shape = self.measured.shape
        deviations = []
        for row in range(shape[0]):
            deviations.append(self._usual_deviation(row, sd))
        size = np.array(deviations)
        # Neighbours on a trace err alike: wider deviations let it count as `independent` readings.
        many = np.sqrt(np.maximum(1.0, shape[1] / self.independent))
        deviation = stated_or_usual(self.sd, np.broadcast_to(size[:, None], shape)) * many
        rows, columns = np.nonzero(np.isfinite(self.measured))
        kinds = {}
        for name in self.quantities:
            kinds[name] = Kind(self.MEASURED[name], name == "speed")
        names = []
        for angle in self.angle[columns]:
            names.append(f"{angle / _DEGREE:.4g} deg")
        return Entries(
            quantity=tuple(self.quantities[row] for row in rows),
            kinds=kinds,
            point=np.zeros(rows.size, int),
            column=rows * shape[1] + columns,
            measured=self.measured[rows, columns],
            sd=deviation[rows, columns],
            names=tuple(names),
            conditions={"crank_angle": self.angle[columns]},
            units={"crank_angle": "rad"},
        )

    def _usual_deviation(self, row: int, sd: Mapping[str, float]) -> float:
        """[SI] Standard deviation of the samples of a quantity that give none.

        Raises:
            BadInput: nothing was measured, or zero alone, of which no share is a deviation.
        """
        name = self.quantities[row]
        measured = np.isfinite(self.measured[row])
        samples = self.measured[row][measured]
        if not samples.size:
            raise BadInput(f"{self.source}: {name}", "empty", "measured at one angle at least")
        if self.sd is not None and np.isfinite(self.sd[row][measured]).all():
            return np.nan  # every sample has its own
        if name == "speed":
            share = usual(name, sd, 0.001)
            size = np.mean(samples)
        else:
            share = usual(name, sd, 0.01)
            size = np.ptp(samples)
        if size == 0:
            # a flat line has no range; a sensor errs by a share of what it shows all the same
            size = np.abs(samples).max()
        if not size > 0:
            bound = f"other than 0 somewhere, or with a column sd({name})"
            raise BadInput(f"{self.source}: {name}", float(size), bound)
        return share * float(size)

    def points(self, machine):
        del machine
        return self.angle[None], tuple(np.array([value]) for value in self.settings)

    def at(self, machine, nuisances, point):
        angles, settings = point
        names = [parameter.name for parameter in self.nuisances]
        constants = dict(zip(names, nuisances, strict=True))
        compressor = _conditioned(machine, self.paths, settings).as_compressor()
        if isinstance(compressor.gas, Cylinder):
            orbit = solve_rated(compressor, Collocation(reversals=0, estimate=False), self.solver)
        else:
            orbit = solve_orbit(compressor, self.solver, throw=False)
        # The zero of the sensor lies at this angle of the crank.
        at = angles - constants["top_dead_centre"]
        cycle = cast(Any, orbit.cycle)
        out = []
        for name in self.quantities:
            if name == "speed":
                out.append(orbit.speed_at(at))
            elif name == "pressure":
                gain = constants["pressure_gain"]
                offset = constants["pressure_offset"]
                out.append(offset + gain * cycle.pressure_at(at))
            else:
                out.append(constants["lift_gain"] * cycle.lift_at(at, name == "discharge_lift"))
        ok = orbit.converged
        if cycle is not None:
            ok = ok & cycle.converged
        return jnp.concatenate(out), ok


@dataclass(frozen=True)
class Table(AbstractMeasurement):
    """Readings of any quantities of `jaxcomp quantities` at several conditions.

    Such as losses by joint, shaft power, vibration or efficiencies, over speed or pressures.

    Attributes:
        quantities: names, as `jaxcomp.quantity_named` takes them.
        paths: of the numbers of the machine that are different from point to point.
        settings: [SI] (n, paths) their values.
        measured: [SI] (n, quantities); not a number where nothing was measured.
        sd: [SI] (n, quantities) standard deviations; 1 % where absent, 2 K, 1 degree.
        units: SI units of the paths, for names of the points.
    """

    source: str = field(compare=False)
    quantities: tuple[str, ...]
    measured: NDArray = field(compare=False)
    paths: tuple[str, ...] = ()
    settings: NDArray = field(compare=False, default_factory=lambda: np.zeros((1, 0)))
    sd: NDArray | None = field(compare=False, default=None)
    units: tuple[str, ...] = field(compare=False, default=())
    solver: "Collocation | Shooting | None" = None

    @property
    def names_of_sd(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        """All quantities of the table."""
        return self.quantities

    def check(self, machine):
        """Refuse quantities that the machine has not, and settings that are none of its numbers."""
        for name in self.quantities:
            if missing := quantity_named(name).missing(machine):
                raise BadInput(f"{self.source}: {name}", "measured", f"of a machine with {missing}")
        for path, values in zip(self.paths, self.settings.T, strict=True):
            for value in values:
                variable(machine, path, value, value)

    def entries(self, sd):
        kinds = {}
        deviation = np.empty(self.measured.shape)
        for n, name in enumerate(self.quantities):
            unit = quantity_named(name).unit
            kinds[name] = Kind(unit, unit not in ("K", "rad"))
            if unit == "K":
                deviation[:, n] = usual(name, sd, 2.0)
            elif unit == "rad":
                deviation[:, n] = usual(name, sd, _DEGREE)
            else:
                deviation[:, n] = usual(name, sd, 0.01) * np.abs(self.measured[:, n])
        deviation = stated_or_usual(self.sd, deviation)
        rows, columns = np.nonzero(np.isfinite(self.measured))
        units = self.units or ("",) * len(self.paths)
        looks = list(map(shown, self.paths, units, self.settings.T))
        labels = []
        for row in self.settings:
            settings = []
            for value, look in zip(row, looks, strict=True):
                settings.append(look.drawn.text(value))
            labels.append(", ".join(settings) or "the machine")
        conditions = {}
        for number, path in enumerate(self.paths):
            conditions[path] = self.settings[rows, number]
        return Entries(
            quantity=tuple(self.quantities[n] for n in columns),
            kinds=kinds,
            point=rows,
            column=columns,
            measured=self.measured[rows, columns],
            sd=deviation[rows, columns],
            names=tuple(labels[n] for n in rows),
            conditions=conditions,
            units=dict(zip(self.paths, units, strict=True)),
        )

    def points(self, machine):
        del machine
        return self.settings

    def at(self, machine, nuisances, point):
        del nuisances
        options = AnalysisOptions(self.solver)
        result = DesignResult(_conditioned(machine, self.paths, point), options)
        values = values_of(self.quantities, result)
        return values, result.ok & jnp.all(jnp.isfinite(values))
