r"""The page of API 618 of a machine with connecting rods: rod loads, ends of the cylinders, shaking.

Along the piston rod, tension counted positive, act at the crosshead pin

$$F_{gas} = -(p - p_{back})A, \qquad F_{inertia} = -m_{rec}\,\ddot x_p, \qquad F = F_{gas} + F_{inertia}$$

with the pressure difference on the areas of the piston, its acceleration towards the head and all mass
that goes to and fro with it: piston, rod, crosshead and pin (API 618, fifth edition 2007, definitions of
gas load, inertia force and combined rod load). Friction and weights have no part in them. Of a trunk
piston these are the loads of its pin.
"""

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.declared import Record, held, part, reading, records_of, word
from .._core.polynomials import gauss
from .._core.results import Data, Result
from ..compressor import Compressor, of_each_cylinder, piston_strokes
from ..crank import Orbit
from ..crank._orbit import time_harmonics
from ..cylinder import Cycle, Cylinder
from ..cylinder._several import SeveralCycles
from ..gas import DoubleActing, PolytropicCycle, StagedCycle
from ..mechanism import CrankState, SliderCrank

if TYPE_CHECKING:
    from ..vibration import Wrench

# Primary and secondary, as data sheets have them.
ORDERS = (1, 2)
# Points of each panel at which loads are looked at; parabolas through three of them leave 1e-9 of an
# extreme.
_POINTS = 65
# [rad] Panels between kinks that coincide have less.
_NO_WIDTH = 1e-9


class RodForces(NamedTuple):
    """Forces along the rods, tension positive, the harmonics of the shaking and what else a page has.

    All of it is one program with the other numbers of a periodic state.

    Attributes:
        gas, inertia: [N] (k, n) at the nodes of an orbit.
        angle: [rad] (p, m) of many points on each panel, from edge to edge.
        fine_gas, fine_inertia: [N] (k, p, m) there.
        force: [N] (2, h) amplitudes of primary and secondary along x and y, complex.
        couple: [N m] (2, h) about x and y, likewise.
        width: [rad] (p,) of the panels.
        throws: dimensions of each throw by their names in `ThrowData`, each (k,).
        ends: quantities of each end of the cylinders, by end and their names in `EndData`, each (k,).
    """

    gas: Float[Array, "k n"]
    inertia: Float[Array, "k n"]
    angle: Float[Array, "p m"]
    fine_gas: Float[Array, "k p m"]
    fine_inertia: Float[Array, "k p m"]
    force: Complex[Array, "2 h"]
    couple: Complex[Array, "2 h"]
    width: Float[Array, " p"]
    throws: dict[str, Float[Array, " k"]]
    ends: dict[str, dict[str, Float[Array, " k"]]]


def has_rod_forces(compressor: Compressor) -> bool:
    """Whether a machine has rods and a gas that loads them."""
    return isinstance(compressor.mechanism, SliderCrank) and compressor.gas is not None


def rod_forces(
    compressor: Compressor, machine_gas: Any, orbit: Orbit, wrench: "Wrench"
) -> RodForces:
    """Forces along the rods of a solved orbit, and what shakes the block.

    Args:
        compressor: put together, with a slider-crank and gas.
        machine_gas: the gas as the machine has it, before stages have their pressures.
        orbit: its periodic state.
        wrench: of the moving parts at its nodes.
    """
    state = orbit.state
    solved = orbit.under_gas(compressor)
    gas, inertia = _along_rods(solved, state)
    # Between the nodes the laws say what the gas does; the motion is the panels' polynomials.
    rule = gauss(orbit.panel_nodes)
    places = np.linspace(0.0, 1.0, _POINTS)
    edges = orbit.panel_edges
    angle = edges[:-1, None] + orbit.panel_width[:, None] * places
    through = rule.through(places).T

    def interpolated(nodal):
        return (nodal.reshape(-1, orbit.panel_nodes) @ through).ravel()

    speed = interpolated(state.speed)
    acceleration = interpolated(state.acceleration)
    fine = CrankState(angle.ravel(), speed, acceleration)
    fine_gas, fine_inertia = _along_rods(solved, fine)
    duration = orbit.weight / state.speed
    vectors = jnp.concatenate([wrench.force[:2], wrench.moment[:2]])
    amplitudes, _ = time_harmonics(vectors, orbit.time, duration, max(ORDERS))
    return RodForces(
        gas=gas,
        inertia=inertia,
        angle=angle,
        fine_gas=fine_gas.reshape(-1, *angle.shape),
        fine_inertia=fine_inertia.reshape(-1, *angle.shape),
        force=amplitudes[:2],
        couple=amplitudes[2:],
        width=orbit.panel_width,
        throws=_dimensions(compressor, orbit),
        ends=_ends(compressor, machine_gas, orbit),
    )


def _along_rods(
    compressor: Compressor, state: CrankState
) -> tuple[Float[Array, "k n"], Float[Array, "k n"]]:
    """[N] Gas load and inertia along each rod, tension positive."""
    each = of_each_cylinder(compressor, state.angle)
    kinematics: Any = each.kinematics
    acceleration = (
        kinematics.position_1 * state.acceleration + kinematics.position_2 * state.speed**2
    )
    mechanism: Any = compressor.crankshaft.each(compressor.mechanism, state.angle)
    return -each.gas_force, -mechanism.piston_mass * acceleration


def _dimensions(compressor: Compressor, orbit: Orbit) -> dict[str, Float[Array, " k"]]:
    """Dimensions of each throw."""
    mechanism: Any = compressor.mechanism
    _, stroke = piston_strokes(compressor)
    rod = getattr(compressor.gas, "rod_diameter", None)
    columns = {
        "bore": mechanism.bore,
        "stroke": stroke,
        "rod_diameter": jnp.nan if rod is None else rod,
        "piston_speed": stroke * orbit.mean_speed / jnp.pi,
        "reciprocating_mass": mechanism.piston_mass,
    }
    return _of_cylinders(compressor, columns)


def _of_cylinders(compressor: Compressor, columns: dict[str, Any]) -> dict[str, Any]:
    """Numbers of all cylinders, or of each, as one of each (k,)."""
    shape = (compressor.crankshaft.count,)
    return {name: jnp.broadcast_to(value, shape) for name, value in columns.items()}


def _ends(
    compressor: Compressor, machine_gas: Any, orbit: Orbit
) -> dict[str, dict[str, Float[Array, " k"]]]:
    """Quantities of each end of the cylinders; none of gases that have no valves."""
    gas: Any = compressor.gas
    area, stroke = piston_strokes(compressor)
    turns = orbit.mean_speed / (2 * jnp.pi)
    displacement = area * stroke * turns
    if isinstance(gas, PolytropicCycle):
        ends = {"head": _ideal_end(gas, machine_gas, displacement)}
    elif isinstance(gas, DoubleActing):
        source = machine_gas
        if isinstance(machine_gas, DoubleActing):
            source = machine_gas.head_end
        rod = jnp.pi / 4 * gas.rod_diameter**2 * stroke * turns
        ends = {
            "head": _ideal_end(gas.head_end, source, displacement),
            "crank": _ideal_end(gas.crank_end, source, displacement - rod),
        }
    elif isinstance(machine_gas, Cylinder) and orbit.cycle is not None:
        ends = _ends_with_valves(orbit.cycle)
    else:
        return {}
    stages = 1
    if isinstance(machine_gas, StagedCycle) or (
        isinstance(machine_gas, Cylinder) and machine_gas.later_stages
    ):
        stages = machine_gas.stages
    described = {}
    for name, columns in ends.items():
        columns_with_stage = {"stage": jnp.asarray(stages, float), **columns}
        described[name] = _of_cylinders(compressor, columns_with_stage)
    return described


def _ideal_end(cycle: PolytropicCycle, source: Any, displacement) -> dict[str, Any]:
    """An end with ideal valves, whose gas is cooled to the inlet's temperature between the stages."""
    warm = getattr(source, "inlet_temperature", None)
    # of several lines the first cylinder's gas
    inlet = jnp.nan
    if warm is not None:
        inlet = jnp.ravel(warm)[0]
    ratio = cycle.discharge_pressure / cycle.suction_pressure
    return {
        "suction_pressure": cycle.suction_pressure,
        "discharge_pressure": cycle.discharge_pressure,
        "pressure_ratio": ratio,
        "inlet_temperature": inlet,
        "discharge_temperature": inlet * ratio ** (1 - 1 / cycle.exponent),
        "displacement": displacement,
        "clearance_ratio": cycle.clearance_ratio,
        "volumetric_efficiency": cycle.filling,
    }


def _ends_with_valves(cycle: Cycle | SeveralCycles) -> dict[str, dict[str, Any]]:
    """The ends of the cylinders, whose pressures were solved with the crank."""

    def numbers(cycle: Cycle):
        case = cycle.case
        low = case.suction
        high = case.discharge
        return {
            "suction_pressure": low.p,
            "discharge_pressure": high.p,
            "pressure_ratio": high.p / low.p,
            "inlet_temperature": low.T,
            "discharge_temperature": cycle.discharge_temperature,
            "volumetric_efficiency": cycle.volumetric_efficiency,
            "displacement": case.swept * cycle.frequency,
            "clearance_ratio": case.cylinder.clearance_ratio,
        }

    if not isinstance(cycle, SeveralCycles):
        return {"head": numbers(cycle)}
    each = jax.vmap(numbers)(cycle.each)
    sides = ("head", "crank")[: cycle.sides]
    ends = {}
    for number, side in enumerate(sides):
        ends[side] = {name: column[number :: cycle.sides] for name, column in each.items()}
    return ends


@dataclasses.dataclass(frozen=True)
class ThrowData(Record):
    """Dimensions of a throw, and the loads along its rod.

    Attributes:
        cylinder: its number, from one.
        bore, stroke: [m]
        rod_diameter: [m] of the piston rod; NaN without one.
        piston_speed: [m/s] mean.
        reciprocating_mass: [kg]
        gas_compression, gas_tension: [N] largest of the gas.
        inertia_compression, inertia_tension: [N] largest of the inertia.
        combined_compression, combined_tension: [N] largest of both together.
        combined_compression_at, combined_tension_at: [rad] crank angles of these.
        reversal_angle: [rad] for which the combined load is on its shorter side.
        reversal_share: [-] smaller over larger side of the combined load.
    """

    cylinder: int = reading("")
    bore: float = reading("m")
    stroke: float = reading("m")
    rod_diameter: float = reading("m")
    piston_speed: float = reading("m/s")
    reciprocating_mass: float = reading("kg")
    gas_compression: float = reading("N")
    gas_tension: float = reading("N")
    inertia_compression: float = reading("N")
    inertia_tension: float = reading("N")
    combined_compression: float = reading("N")
    combined_tension: float = reading("N")
    combined_compression_at: float = reading("rad")
    combined_tension_at: float = reading("rad")
    reversal_angle: float = reading("rad")
    reversal_share: float = reading("")


@dataclasses.dataclass(frozen=True)
class EndData(Record):
    """Conditions of a compressing end of a cylinder.

    Attributes:
        cylinder: its number, from one.
        stage: its number, from one.
        end: "head" or "crank".
        suction_pressure, discharge_pressure: [Pa]
        pressure_ratio: [-]
        inlet_temperature, discharge_temperature: [K] NaN where the gas has no temperature.
        displacement: [m^3/s]
        clearance_ratio: [-]
        volumetric_efficiency: [-]
    """

    cylinder: int = reading("")
    stage: int = reading("")
    end: str = word()
    suction_pressure: float = reading("Pa")
    discharge_pressure: float = reading("Pa")
    pressure_ratio: float = reading("")
    inlet_temperature: float = reading("K")
    discharge_temperature: float = reading("K")
    displacement: float = reading("m^3/s")
    clearance_ratio: float = reading("")
    volumetric_efficiency: float = reading("")


@dataclasses.dataclass(frozen=True)
class UnbalancedForces(Record):
    """Amplitudes of the forces and couples of an order that the throws leave.

    Attributes:
        order: 1 of primary and 2 of secondary.
        force_x, force_y: [N]
        couple_x, couple_y: [N m]
    """

    order: int = reading("")
    force_x: float = reading("N")
    force_y: float = reading("N")
    couple_x: float = reading("N m")
    couple_y: float = reading("N m")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ProcessSheet(Result):
    """Data sheet of API 618 of a machine: its throws, the ends of its cylinders, its shaking.

    Attributes:
        crank_angle: [rad] (n,) of the machine.
        gas, inertia, combined: [N] (k, n) loads along the rods, tension positive.
        throws: one record for each rod.
        ends: one record for each compressing end of a cylinder.
        unbalanced: one record for each of primary and secondary.
        crosshead: whether the rods have crossheads; the page is printed of such machines.
    """

    crank_angle: np.ndarray = reading("rad", "crank_angle", table_only=True)
    gas: np.ndarray = held()
    inertia: np.ndarray = held()
    combined: np.ndarray = held()
    throws: tuple[ThrowData, ...] = part(ThrowData)
    ends: tuple[EndData, ...] = part(EndData)
    unbalanced: tuple[UnbalancedForces, ...] = part(UnbalancedForces)
    crosshead: bool = word()

    table_dims: ClassVar[tuple[str, ...]] = ("crank_angle",)

    def described(self) -> Iterator[Data]:
        """The loads along the rods over the crank angle."""
        yield from self.data_of("crank_angle")
        yield from self.curves()

    def curves(self) -> Iterator[Data]:
        """The loads along the rods, of several by their numbers."""
        for kind in ("gas", "inertia", "combined"):
            for number, load in enumerate(getattr(self, kind), 1):
                suffix = ""
                if len(self.throws) > 1:
                    suffix = f".{number}"
                doc = "along the rod, tension positive"
                yield Data(f"{kind}_rod_load{suffix}", "N", load, self.table_dims, doc)


def process_sheet(compressor: Compressor, orbit: Orbit, forces: RodForces) -> ProcessSheet:
    """The page of API 618 of a solved machine.

    Args:
        compressor: put together, with a slider-crank and gas.
        orbit: its periodic state.
        forces: of `rod_forces`, as numbers.
    """
    packed = getattr(compressor.friction, "packing", None) is not None
    rod = getattr(compressor.gas, "rod_diameter", None)
    return ProcessSheet(
        crank_angle=np.asarray(orbit.state.angle),
        gas=forces.gas,
        inertia=forces.inertia,
        combined=forces.gas + forces.inertia,
        throws=tuple(_throws(forces)),
        ends=tuple(_rows_of_ends(forces)),
        unbalanced=_unbalanced(forces),
        crosshead=packed or rod is not None,
    )


def _rows_of_ends(forces: RodForces) -> Iterator[EndData]:
    for number in range(len(forces.gas)):
        # a compiled function returns its keys sorted
        for end in ("head", "crank"):
            if end not in forces.ends:
                continue
            columns = forces.ends[end]
            numbers = {name: float(column[number]) for name, column in columns.items()}
            stage = int(numbers.pop("stage"))
            yield EndData(cylinder=number + 1, stage=stage, end=end, **numbers)


class _Sampled(NamedTuple):
    """A load at many angles, panel by panel.

    Attributes:
        angle: [rad] (panels, points) from edge to edge.
        load: [N] (panels, points)
    """

    angle: np.ndarray
    load: np.ndarray

    def largest(self) -> tuple[float, float]:
        """[N] The largest load, and [rad] where it is."""
        panel, place = np.unravel_index(np.argmax(self.load), self.load.shape)
        angles = self.angle[panel]
        loads = self.load[panel]
        if place in (0, loads.size - 1):
            return float(loads[place]), float(angles[place])
        # The vertex of the parabola through the largest load and its neighbours, in steps from it.
        before, top, after = loads[place - 1 : place + 2]
        bend = before - 2 * top + after
        shift = 0.0
        if bend < 0:
            shift = 0.5 * (before - after) / bend
        value = top - 0.25 * (before - after) * shift
        return float(value), float(angles[place] + shift * (angles[1] - angles[0]))

    def negative(self) -> "_Sampled":
        """The load with the opposite sign."""
        return _Sampled(self.angle, -self.load)

    def tension_angle(self) -> float:
        """[rad] Crank angle over which the load is tension: a straight line between points."""
        step = np.diff(self.angle, axis=1)
        first = self.load[:, :-1]
        second = self.load[:, 1:]
        away = np.abs(first) + np.abs(second)
        positive = np.maximum(first, 0) + np.maximum(second, 0)
        share = np.divide(positive, away, out=np.zeros_like(away), where=away > 0)
        return float(np.sum(step * share))


def _throws(forces: RodForces) -> Iterator[ThrowData]:
    wide = forces.width > _NO_WIDTH
    angle = forces.angle[wide]
    for number in range(len(forces.gas)):
        numbers = {name: float(column[number]) for name, column in forces.throws.items()}
        loads = {
            "gas": forces.fine_gas[number, wide],
            "inertia": forces.fine_inertia[number, wide],
        }
        loads["combined"] = loads["gas"] + loads["inertia"]
        for kind, load in loads.items():
            sampled = _Sampled(angle, load)
            compression, compression_at = sampled.negative().largest()
            tension, tension_at = sampled.largest()
            numbers[f"{kind}_compression"] = max(compression, 0.0)
            numbers[f"{kind}_tension"] = max(tension, 0.0)
            if kind == "combined":
                numbers["combined_compression_at"] = _within_turn(compression_at)
                numbers["combined_tension_at"] = _within_turn(tension_at)
                pulled = sampled.tension_angle()
                numbers["reversal_angle"] = min(pulled, 2 * np.pi - pulled)
                sides = numbers["combined_compression"], numbers["combined_tension"]
                numbers["reversal_share"] = min(sides) / max(*sides, 1e-300)
        yield ThrowData(cylinder=number + 1, **numbers)


def _within_turn(angle: float) -> float:
    """[rad] From -pi to pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _unbalanced(forces: RodForces) -> tuple[UnbalancedForces, ...]:
    sizes = np.abs(np.concatenate([forces.force, forces.couple]))
    force_x, force_y, couple_x, couple_y = sizes[:, [order - 1 for order in ORDERS]]
    return records_of(
        UnbalancedForces,
        order=ORDERS,
        force_x=force_x,
        force_y=force_y,
        couple_x=couple_x,
        couple_y=couple_y,
    )
