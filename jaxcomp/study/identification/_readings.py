"""Rated points of a compressor as they were measured, or as the polynomials of a maker give them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ..._core.errors import BadInput, kind_text
from ..._core.exported import kept_jit
from ..._core.extremes import maximum
from ...compressor import Compressor, mechanisms_of
from ...cylinder import Cylinder
from ...fluid import AbstractRealGas
from ...fluid._real import has_dew_line
from ...machine import Machine, assembled
from ..rating import QUANTITIES, ZERO, RatingPoint, capacity_rise, rated
from ._bounded_least_squares import Parameter
from ._measurement import AbstractMeasurement, Entries, Kind, stated_or_usual

# What a map measures: unit, whether the deviation is relative, and deviation by default, of readings and
# of points that a polynomial gives.
MEASURED = {
    "capacity": ("W", True, 0.01, 0.015),
    "mass_flow": ("kg/s", True, 0.01, 0.015),
    "power": ("W", True, 0.01, 0.02),
    "discharge_temperature": ("K", False, 2.0, 2.0),
}
# Root mean square difference of capacity over flow from the rise of enthalpy, beyond which they
# contradict each other.
_CONTRADICTION = 0.03
# [K] Gas that is hotter, or liquid that is colder, comes to no compressor.
_MOST_SUPERHEAT = 200.0
_MOST_SUBCOOLING = 100.0
# Numbers that change what the pistons displace.
_OF_DISPLACEMENT = ("mechanism.", "similar_swept_volume", "crankshaft.")
# Speeds closer together than this are one.
_SAME_SPEED = 1e-3

_OUT = {name: n for n, (name, *_) in enumerate(QUANTITIES)}


@dataclass(frozen=True)
class Readings(AbstractMeasurement):
    """n rated points.

    Speeds are taken as constant over the revolution.

    Attributes:
        source: name of the file, for messages and for the sources of the machine's values.
        evaporating, condensing: [K] (n,) dew temperatures, or as `reference` says.
        gas: [K] (n,) that comes to the compressor.
        liquid: [K] (n,) before the expansion.
        useful: [K] (n,) of the gas up to which capacity counts.
        speed: [rad/s] (n,); not a number for that of the machine.
        measured: [SI] (n,) by names of `MEASURED`; not a number where nothing was measured.
        sd: [SI] (n,) standard deviations, by name; those by default where absent.
        polynomial: whether the points are those of a polynomial, and no readings.
        fluid: as the source names it; "" where it does not.
        bends: where a polynomial bends as no compressor does, in words.
        factors: [rad/s] speeds at which flow and power have factors of their own.
        by_subcooling: whether `liquid` is the condensing temperature less a subcooling, which counts from
            the bubble temperature: `liquid_of` takes the glide of the machine's fluid off.
        by_superheat: whether `gas` is the evaporating temperature plus a superheat, which counts from the
            dew temperature.
        by_useful_superheat: the same of `useful`.
        reference: "dew", or "mean" for temperatures in the middle of the glide of evaporator and
            condenser, which `by_dew_points` turns into dew temperatures of the machine's fluid.
        labels: (n,) names of the points, where they are not those of the temperatures.
    """

    source: str = field(compare=False)
    evaporating: NDArray = field(compare=False)
    condensing: NDArray = field(compare=False)
    gas: NDArray = field(compare=False)
    liquid: NDArray = field(compare=False)
    useful: NDArray = field(compare=False)
    speed: NDArray = field(compare=False)
    measured: Mapping[str, NDArray] = field(compare=False)
    sd: Mapping[str, NDArray] = field(compare=False, default_factory=dict)
    polynomial: bool = field(compare=False, default=False)
    fluid: str = field(compare=False, default="")
    bends: tuple[str, ...] = field(compare=False, default=())
    factors: tuple[float, ...] = field(compare=False, default=())
    by_subcooling: bool = field(compare=False, default=False)
    by_superheat: bool = field(compare=False, default=False)
    by_useful_superheat: bool = field(compare=False, default=False)
    reference: str = field(compare=False, default="dew")
    labels: tuple[str, ...] = field(compare=False, default=())
    solver: Any = None

    names_of_sd: ClassVar[tuple[str, ...]] = tuple(MEASURED)

    @property
    def names(self) -> list[str]:
        """(n,) such as "-5/30 C", by the temperatures of the source."""
        if self.labels:
            return list(self.labels)
        names = []
        for s, d in zip(self.evaporating - ZERO, self.condensing - ZERO, strict=True):
            names.append(f"{s:.4g}/{d:.4g} C")
        return names

    def liquid_of(self, fluid: AbstractRealGas) -> NDArray:
        """[K] (n,) temperature of the liquid of a fluid before the expansion.

        Subcooling counts from the bubble point, which a file of readings cannot know: the machine has
        the fluid.
        """
        if not self.by_subcooling:
            return self.liquid
        glide = self.condensing - np.asarray(fluid.bubble_of_dew(self.condensing))
        return self.liquid - glide

    def by_dew_points(self, fluid: AbstractRealGas) -> "Readings":
        """The readings with dew temperatures of a fluid; they themselves where they have these.

        Raises:
            BadInput: a pseudo-pure fluid, or a mean temperature that the fluid has at no pressure.
        """
        if self.reference == "dew":
            return self
        condensing = np.asarray(fluid.dew_of_mean(jnp.asarray(self.condensing)))
        shifted = replace(
            self, condensing=condensing, liquid=self.liquid + condensing - self.condensing
        )
        liquid = self.liquid
        liquid_or_subcooling = self.liquid
        if self.by_subcooling:
            liquid = shifted.liquid_of(fluid)
            liquid_or_subcooling = shifted.liquid
        pressure = fluid.dew_pressure(condensing)
        evaporating = []
        for place, name in enumerate(self.names):
            enthalpy = fluid.liquid(jnp.asarray(liquid[place]), jnp.asarray(pressure[place])).h
            evaporating.append(float(fluid.dew_of_evaporator(self.evaporating[place], enthalpy)))
            if not np.isfinite(evaporating[-1]):
                bound = (
                    f"mean temperatures that {fluid.name} has on its lines, with liquid that boils"
                )
                raise BadInput(f"{self.source}: point {name}", name, bound)
        warmer = np.array(evaporating) - self.evaporating
        return replace(
            shifted,
            evaporating=np.array(evaporating),
            gas=self.gas + warmer * self.by_superheat,
            useful=self.useful + warmer * self.by_useful_superheat,
            liquid=liquid_or_subcooling,
            reference="dew",
            labels=tuple(self.names),
        )

    def for_machine(self, machine):
        if machine.compressor is None:
            return self
        fluid = getattr(machine.as_compressor().gas, "fluid", None)
        if not has_dew_line(fluid):
            return self
        return self.by_dew_points(fluid)

    def deviation(self, name: str, sd: Mapping[str, float]) -> NDArray:
        """[SI] (n,) standard deviations of a quantity.

        Args:
            name: of `MEASURED`.
            sd: instead of those by default, by name; relative for all but temperatures.
        """
        _, relative, plain, fitted = MEASURED[name]
        default = fitted if self.polynomial else plain
        usual = sd.get(name, default)
        measured = self.measured[name]
        deviation = usual + 0 * measured
        if relative:
            deviation = usual * np.abs(measured)
        return stated_or_usual(self.sd.get(name), deviation)

    def check(self, machine: Machine) -> None:
        """Refuse points that cannot be.

        Raises:
            BadInput: a machine without valves or a real gas, another fluid, temperatures outside its
                range or in the wrong order, a point that is there twice, nothing that was measured, or
                a capacity that contradicts the mass flow.
        """
        compressor = assembled(machine).compressor
        gas = None if compressor is None else compressor.gas
        if not isinstance(gas, Cylinder) or not has_dew_line(gas.fluid):
            raise BadInput("gas", kind_text(gas), "a cylinder with valves and a real gas")
        if not gas.inert:
            bound = "given on both valves: without, a cycle has no exact slopes"
            raise BadInput("port_length", "absent", bound)
        if not self.measured:
            raise BadInput(
                self.source, "nothing measured", f"one of {', '.join(MEASURED)} at least"
            )
        self.check_points(gas.fluid)

    def check_points(self, fluid: AbstractRealGas) -> None:
        """Refuse points that cannot be with a fluid, see `check`."""
        if self.fluid and _plain_name(self.fluid) != _plain_name(fluid.name):
            bound = f"{fluid.name} as the machine; set gas.fluid.name to identify with another"
            raise BadInput(f"{self.source}: fluid", self.fluid, bound)
        top = float(fluid.critical_temperature)
        for n, name in enumerate(self.names):
            at = f"{self.source}: point {name}"
            if not ZERO - 100 < self.evaporating[n] < self.condensing[n] < top:
                bound = f"evaporating below condensing below {top - ZERO:.4g} C"
                raise BadInput(at, name, bound)
            if self.gas[n] < self.evaporating[n] or self.useful[n] < self.evaporating[n]:
                bound = f"at least the evaporating temperature, {self.evaporating[n] - ZERO:.4g} C"
                raise BadInput(f"{at}: gas [C]", self.gas[n] - ZERO, bound)
            hottest = min(self.evaporating[n] + _MOST_SUPERHEAT, fluid.temperature_range[1])
            if self.gas[n] > hottest or self.useful[n] > hottest:
                bound = f"at most {hottest - ZERO:.4g} C"
                raise BadInput(f"{at}: gas [C]", max(self.gas[n], self.useful[n]) - ZERO, bound)
        rows = np.stack([self.evaporating, self.condensing, self.gas, np.nan_to_num(self.speed)])
        _, first, count = np.unique(rows.round(6), axis=1, return_index=True, return_counts=True)
        if (count > 1).any():
            twice = ", ".join(self.names[n] for n in sorted(first[count > 1]))
            raise BadInput(
                f"{self.source}: points", twice, "there once; give the mean of repeated ones"
            )
        self._check_liquid(fluid)
        self._check_measured()
        if {"capacity", "mass_flow"} <= set(self.measured):
            self._check_capacity(fluid)

    def _check_liquid(self, fluid: AbstractRealGas) -> None:
        """Refuse liquid that boils at its pressure, or is colder than any condenser leaves it."""
        boiling = np.asarray(fluid.bubble_of_dew(self.condensing))
        liquid = self.liquid_of(fluid)
        for n, name in enumerate(self.names):
            at = f"{self.source}: point {name}: liquid [C]"
            if liquid[n] > boiling[n] + 1e-9:
                bound = "at most condensing"
                if boiling[n] < self.condensing[n]:
                    bound = f"at most {boiling[n] - ZERO:.4g} C, the bubble temperature at that pressure"
                raise BadInput(at, liquid[n] - ZERO, bound)
            coldest = max(boiling[n] - _MOST_SUBCOOLING, float(fluid.lowest_temperature))
            if liquid[n] < coldest:
                raise BadInput(at, liquid[n] - ZERO, f"at least {coldest - ZERO:.4g} C")

    def check_limits(self, machine, varied):
        """Refuse flows above what the piston displaces, and powers below that of isentropic compression.

        By the gas that comes, without leakage, heat or loss: no constants of a machine reach them. Three
        standard deviations of the readings are granted.
        """
        compressor: Any = machine.as_compressor()
        fluid = compressor.gas.fluid
        liquid = self.liquid_of(fluid)
        columns = []
        for column in (self.evaporating, self.condensing, self.gas, self.useful, liquid):
            columns.append(jnp.asarray(column, float))
        limits = _limits(fluid, *columns)
        density, work, worth = map(np.asarray, limits)
        none = np.full(self.evaporating.size, np.nan)
        turns, _ = self.points(machine)
        displaced = density * displacement(compressor) * turns.speed / (2 * np.pi)
        flows = {"mass_flow": 1.0, "capacity": worth}
        sized = any(name.startswith(_OF_DISPLACEMENT) for name in varied)
        for name, per_flow in flows.items():
            largest = displaced * per_flow
            measured = self.measured.get(name, none)
            room = 0.0
            if name in self.measured:
                room = 3 * self.deviation(name, {})
            for n in np.flatnonzero(measured - room > largest):
                if not sized:
                    bound = (
                        f"at most {largest[n]:.4g}: more than the piston displaces of the gas "
                        "that comes"
                    )
                    raise BadInput(self._place(n, name), measured[n], bound)
        flow = self.measured.get("mass_flow", none)
        flow = np.where(np.isfinite(flow), flow, self.measured.get("capacity", none) / worth)
        power = self.measured.get("power", none)
        share = 3 * _deviation_of_flow(self) * flow * work
        room = 0.0
        if "power" in self.measured:
            room = np.hypot(share, 3 * self.deviation("power", {}))
        for n in np.flatnonzero(power + room < flow * work):
            bound = (
                f"at least {flow[n] * work[n]:.4g}, the power of isentropic compression of "
                f"{flow[n]:.4g} kg/s"
            )
            raise BadInput(self._place(n, "power"), power[n], bound)

    def _place(self, n: int, name: str) -> str:
        return f"{self.source}: point {self.names[n]}: {name} [{MEASURED[name][0]}]"

    def _check_measured(self) -> None:
        """Refuse speeds and readings that no compressor has."""
        least = {name: np.zeros(self.evaporating.size) for name in self.measured}
        if "discharge_temperature" in least:
            least["discharge_temperature"] = self.evaporating
        for name, values in {**self.measured, "speed": self.speed}.items():
            low = least.get(name, np.zeros(self.evaporating.size))
            for n in np.flatnonzero(values <= low):
                at = f"{self.source}: point {self.names[n]}: speed [rad/s]"
                if name in MEASURED:
                    at = self._place(n, name)
                raise BadInput(at, values[n], f"above {low[n]:.4g}")

    def entries(self, sd):
        quantity = []
        points = []
        measured = []
        deviations = []
        for name, values in self.measured.items():
            rows = np.flatnonzero(np.isfinite(values))
            quantity += [name] * rows.size
            points += rows.tolist()
            measured += values[rows].tolist()
            deviations += self.deviation(name, sd)[rows].tolist()
        kinds = {}
        for name in self.measured:
            unit, relative, *_ = MEASURED[name]
            kinds[name] = Kind(unit, relative)
        names = self.names
        at = np.array(points, int)
        units = {"evaporating": "K", "condensing": "K", "speed": "rad/s"}
        return Entries(
            quantity=tuple(quantity),
            kinds=kinds,
            point=at,
            column=np.array([_OUT[name] for name in quantity], int),
            measured=np.array(measured),
            sd=np.array(deviations),
            names=tuple(names[row] for row in points),
            conditions={name: getattr(self, name)[at] for name in units},
            units=units,
        )

    @property
    def nuisances(self):
        """Factors of flow and of power at each speed that has its own."""
        factors = []
        for speed in self.factors:
            for kind in ("flow", "power"):
                name = f"{kind}_factor at {speed / (2 * np.pi):.4g} 1/s"
                factors.append(Parameter(name, low=0.5, high=2.0, start=1.0, prior=1.0, sd=0.1))
        return tuple(factors)

    def points(self, machine):
        nominal = float(machine.as_compressor().motor.speed_guess)
        speed = np.where(np.isfinite(self.speed), self.speed, nominal)
        has_factor = np.zeros((speed.size, len(self.factors)))
        for n, other in enumerate(self.factors):
            has_factor[:, n] = np.isclose(speed, other, rtol=_SAME_SPEED)
        gas: Any = machine.as_compressor().gas
        liquid = self.liquid_of(gas.fluid)
        point = RatingPoint(
            evaporating=self.evaporating,
            condensing=self.condensing,
            gas=self.gas,
            liquid=liquid,
            useful=self.useful,
            speed=speed,
        )
        return point, has_factor

    def at(self, machine, nuisances, point):
        conditions, has_factor = point
        values, ok = rated(machine.as_compressor(), conditions, self.solver)
        if not nuisances.size:
            return values, ok
        # none at the speeds without factors
        flow, power = jnp.exp(has_factor @ jnp.log(nuisances).reshape(-1, 2))
        factor = {"capacity": flow, "mass_flow": flow, "power": power, "cop": flow / power}
        factors = []
        for name in _OUT:
            factors.append(factor.get(name, jnp.ones(())))
        return values * jnp.stack(factors), ok

    def warnings(self, used, same_kind):
        """Points held out that lie outside the hull of those used, and speeds that were not used."""
        held_out = sorted(set(range(self.evaporating.size)) - set(used))
        out = [*self.bends]
        if not held_out:
            return out
        conditions = np.stack([self.evaporating, self.condensing], axis=-1)
        fitted = []
        speeds = set()
        for readings, points in ((self, used), *same_kind):
            rows = list(points)
            fitted.append(np.stack([readings.evaporating, readings.condensing], axis=-1)[rows])
            speeds |= set(np.nan_to_num(readings.speed[rows]).round(3).tolist())
        region = np.concatenate(fitted)
        try:
            sides = ConvexHull(np.unique(region, axis=0)).equations
            far = []
            for row in held_out:
                if (sides[:, :2] @ conditions[row] + sides[:, 2] > 0.5).any():
                    far.append(row)
        except (QhullError, ValueError):
            far = held_out
        if far:
            names = ", ".join(self.names[row] for row in far)
            out.append(f"predicted outside of the points used: {names}")
        if set(np.nan_to_num(self.speed[held_out]).round(3).tolist()) - speeds:
            text = "predicted at speeds that were not used: "
            out.append(text + "one speed cannot tell the law of speed")
        return out

    def _check_capacity(self, fluid: AbstractRealGas) -> None:
        ratio = self.measured["capacity"] / self.measured["mass_flow"]
        measured = np.isfinite(ratio)
        rise = jax.jit(jax.vmap(lambda s, d, u, liquid: capacity_rise(fluid, s, d, u, liquid)))
        dew = jnp.asarray(self.evaporating), jnp.asarray(self.condensing)
        boiling = np.asarray(fluid.bubble_of_dew(self.condensing))

        def misfit(useful, liquid):
            computed = np.asarray(rise(*dew, useful, liquid))
            return float(np.sqrt(np.mean((ratio[measured] / computed[measured] - 1) ** 2)))

        stated_misfit = misfit(jnp.asarray(self.useful), jnp.asarray(self.liquid_of(fluid)))
        if not measured.any() or stated_misfit < _CONTRADICTION:
            return
        # Conditions that standards and makers use, one of which the source may mean.
        pairs = {}
        for heat in (0, 5, 8.3, 10, 11.1, 15, 20, 30):
            for cold in (0, 3, 5, 8.3, 10, 15):
                text = f"useful superheat {heat:g} K and subcooling {cold:g} K"
                useful = jnp.asarray(self.evaporating + heat)
                pairs[text] = misfit(useful, jnp.asarray(boiling - cold))
        best = min(pairs, key=lambda text: pairs[text])
        bound = (
            f"at most {_CONTRADICTION:.0%} between capacity and mass flow times the rise of enthalpy; "
            f"{best} leave {pairs[best]:.1%}"
        )
        raise BadInput(f"{self.source}: capacity over mass flow", f"{stated_misfit:.1%} off", bound)


@kept_jit
def _limits(fluid: AbstractRealGas, evaporating, condensing, gas, useful, liquid):
    """[kg/m^3] Of the gas that comes, [J/kg] of its isentropic compression, [J/kg] of capacity; (n,)."""

    def at(evaporating, condensing, gas, useful, liquid):
        low = fluid.saturation(T=evaporating).p
        high = fluid.saturation(T=condensing).p
        suction = fluid.state(gas, fluid.density(gas, low))
        warm = maximum(gas, condensing) + 20.0
        behind = fluid.at_entropy(high, suction.s, fluid.state(warm, fluid.density(warm, high)))
        worth = capacity_rise(fluid, evaporating, condensing, useful, liquid)
        return suction.rho, behind.h - suction.h, worth

    return jax.vmap(at)(evaporating, condensing, gas, useful, liquid)


def displacement(compressor: Compressor) -> float:
    """[m^3] that all pistons displace in a revolution."""
    return sum(float(mechanism.swept_volume) for mechanism in mechanisms_of(compressor))


def _deviation_of_flow(readings: Readings) -> NDArray:
    """[-] (n,) relative, of the flow or else of the capacity."""
    for name in ("mass_flow", "capacity"):
        if name in readings.measured:
            return np.nan_to_num(readings.deviation(name, {}) / readings.measured[name])
    return np.zeros(readings.evaporating.size)


def _plain_name(fluid: str) -> str:
    """Name of a fluid without what does not tell fluids apart: R22 is R-22."""
    return re.sub(r"[\s_-]+", "", fluid).lower()


def with_own_factors(readings: Sequence[AbstractMeasurement]) -> list[AbstractMeasurement]:
    """Measurements of which the points at further speeds have factors of flow and power of their own.

    Makers publish maps that are one of a speed times a factor of speed, and no machine explains both.
    The speed of the first point keeps its flow and power; every other one has two factors, 1 within 10 %
    beforehand, which are fitted with the constants.

    Args:
        readings: of any kind; those without rated points stay as they are.

    Raises:
        BadInput: all points at one speed.
    """
    speeds: list[float] = []
    for measurement in readings:
        if not isinstance(measurement, Readings):
            continue
        for speed in np.nan_to_num(measurement.speed).tolist():
            if not np.isclose(speed, speeds, rtol=_SAME_SPEED).any():
                speeds.append(speed)
    if len(speeds) < 2 or 0 in speeds:
        raise BadInput(
            "speeds", speeds, "two at least, all of them given, for factors of their own"
        )
    out = []
    for measurement in readings:
        if isinstance(measurement, Readings):
            factors = []
            for speed in speeds[1:]:
                if np.isclose(measurement.speed, speed, rtol=_SAME_SPEED).any():
                    factors.append(speed)
            measurement = replace(measurement, factors=tuple(factors))
        out.append(measurement)
    return out


def terms_of(count: int, evaporating, condensing, speed=0.0) -> NDArray:
    """The terms (..., count) of a polynomial.

    Ten: cubic in S and D in the order of AHRI 540 and EN 12900. Twenty: cubic in S, D and n. Thirty: the
    ten, in the order of variable-speed compressors, times 1, n and n^2.

    Args:
        count: 10, 20 or 30.
        evaporating, condensing: [K] dew temperatures.
        speed: [1/s]

    Raises:
        BadInput: another count.
    """
    e, c, n = np.broadcast_arrays(
        np.asarray(evaporating) - ZERO, np.asarray(condensing) - ZERO, np.asarray(speed, float)
    )
    if count == 10:
        rows = (1 + 0 * e, e, c, e**2, e * c, c**2, e**3, c * e**2, e * c**2, c**3)
    elif count == 20:
        rows = (1 + 0 * e, e, c, n, e * c, e * n, c * n, e**2, c**2, n**2, e * c * n, e**2 * c,
                e**2 * n, e**3, e * c**2, c**2 * n, c**3, e * n**2, c * n**2, n**3)  # fmt: skip
    elif count == 30:
        m = n**2
        rows = (1 + 0 * e, e, c, e**2, c**2, e * c * m, e**2 * c * m, e * c**2 * m, e * c * n,
                e**2 * c * n, e * c**2 * n, e * c, e**2 * c, e * c**2, e**3, c**3, n, e * n, c * n,
                e**2 * n, c**2 * n, e**3 * n, c**3 * n, m, e * m, c * m, e**2 * m, c**2 * m,
                e**3 * m, c**3 * m)  # fmt: skip
    else:
        raise BadInput("coefficients", count, "10, 20 or 30")
    return np.stack(rows, axis=-1)
