"""The periodic state of a machine with all that follows from it: what `jaxcomp run` shows."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import jax
import numpy as np

from .._core.declared import (
    NAMED,
    Measured,
    Record,
    computed,
    computed_part,
    computed_word,
    declarations,
    held,
    part,
    reading,
    word,
)
from .._core.display import ZERO_CELSIUS
from .._core.each import of_cylinder
from .._core.errors import BadInput
from .._core.evidence import Check, ended, is_small
from .._core.exported import kept_jit
from .._core.extremes import max_of
from .._core.registry import Quantity, offered_values, registered
from .._core.results import Data, Result, columns_of
from .._core.status import Status
from ..compressor import Compressor, crank_end_pressure
from ..crank import (
    Collocation,
    JournalFilm,
    Orbit,
    TrainTorques,
    journal_films,
    rod_load_reversal,
    solve_orbit,
    train_torques,
)
from ..crank._films import film_thickness
from ..crank._journal_orbit import moved_films
from ..cylinder import Cycle
from ..cylinder._cycle import GRAZING
from ..cylinder._several import of_each
from ..fluid import AbstractRealGas
from ..gas import PolytropicCycle
from ..machine import Assembly, HasMachine, Machine, assembled, machine_of
from ._api_618 import ProcessSheet, RodForces, has_rod_forces, process_sheet, rod_forces
from ._load_step_data import LoadStepData, load_step_data

# What only some machines need is imported where they do: a start would take longer by a third.
if TYPE_CHECKING:
    from ..crank import Shooting, TimeIntegration
    from ..vibration import BlockVibration

# Families of quantities whose numbers stand under another name in JSON.
_KEYS = {"peak_force": "peak_forces", "mean_force": "mean_forces"}
# What API 618 asks of the load of a crosshead pin: crank angle, and share of the larger side as it is
# usually quoted.
_REVERSAL = math.radians(15)
_REVERSED = 0.03


# SI units of `SteadyState.numbers`.
_UNITS = {
    "motor_work": "J",
    "gas_work": "J",
    "gas_work_error": "J",
    "losses": "J",
    "lowest_speed": "rad/s",
    "highest_speed": "rad/s",
    "period": "s",
    "stroke": "m",
    "energy_residual": "",
    "residual": "",
    "resolution": "",
    "cycle_resolution": "",
}


def _block_vibration() -> "type[BlockVibration]":
    # a machine without a suspension starts without this package
    from ..vibration import BlockVibration

    return BlockVibration


@dataclasses.dataclass(frozen=True)
class RodReversal(Record):
    """Reversal of the load of a crosshead pin.

    Attributes:
        angle: [rad] for which the load is on its shorter side.
        share: [-] smaller over larger side.
    """

    angle: float = reading("rad")
    share: float = reading("")


@dataclasses.dataclass(frozen=True)
class MovedFilm(Record):
    """Film of a journal with a steady film, if it moved.

    Attributes:
        film_thickness: [m] least of a revolution.
        loss: [W] mean of film and contact.
    """

    film_thickness: Any = reading("m")
    loss: Any = reading("W")


@dataclasses.dataclass(frozen=True)
class VerificationErrors(Record):
    """Errors of an orbit by an independent integration: its values less those of the integration.

    Attributes:
        speed: largest, over the mean speed.
        period, mechanical_efficiency, gas_work: of the numbers of these names.
        losses, peak_forces: by joint.
        closure: of the integration: by how much the revolution misses its start.
        steps: of the integration.
        status: how it ended.
    """

    speed: float = reading("")
    period: float = reading("")
    mechanical_efficiency: float = reading("")
    losses: dict[str, float] = reading("")
    gas_work: float = reading("")
    peak_forces: dict[str, float] = reading("")
    closure: float = reading("")
    steps: int = reading("")
    status: str = word()


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class LoadSteps(Result):
    """Periodic states of a machine at full load and at each of its load steps.

    Attributes:
        names: of the steps, full load first.
        states: of each.
    """

    names: tuple[str, ...]
    states: "tuple[SteadyState, ...]"

    table_dims: ClassVar[tuple[str, ...]] = ("load_step",)

    def described(self) -> Iterator[Data]:
        """The quantities of every step in SI units."""
        yield Data("load_step", "", np.array(self.names), self.table_dims)
        # neither the name nor pressures, of which a step may have several, make a column
        names = [*declarations(LoadStepData)][1:-1]
        yield from columns_of(self.rows(), *self.table_dims, names=names)

    @computed_part(LoadStepData)
    def steps(self) -> list[LoadStepData]:
        """Numbers of every step."""
        return self.rows()

    def rows(self) -> list[LoadStepData]:
        """One record for every step."""
        full = float(self.states[0].quantities["mass_flow"])
        rows = []
        for name, state in zip(self.names, self.states, strict=True):
            row = load_step_data(name, state.quantities, state.api_618, full)
            rows.append(row)
        return rows


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class SteadyState(Result):
    """The periodic state of a machine, with all that follows from it.

    Attributes:
        machine: that runs.
        compressor: of it, put together.
        orbit: its periodic state.
        quantities: [SI] of crank and gas, by name, or by name and joint, valve, order ...
        numbers: [SI] stroke, period, works and losses of a revolution, extreme speeds, residuals.
        films: "orbit" or "steady_load", by which each oil film of a journal was solved.
        rod_load_reversal: of `jaxcomp.crank.rod_load_reversal`, by crosshead pin.
        remarks: sentences on numbers that do not mean what their names say.
        moved_films: what journals with steady films would do if they moved, where it was asked for.
        vibration: of the suspended block; `None` without a suspension.
        torsion: of the crank train; `None` without one.
        load_steps: of `load_steps`, where that was asked for.
        api_618: loads of the rods, ends of the cylinders and shaking, as data sheets have them; `None`
            without connecting rods or gas.
    """

    machine: Machine
    compressor: Compressor
    orbit: Orbit
    quantities: dict[str, Any]
    numbers: dict[str, Any]
    films: dict[str, str]
    rod_load_reversal: dict[str, RodReversal]
    remarks: tuple[str, ...] = word()
    moved_films: dict[str, JournalFilm] | None = held(default=None)
    vibration: "BlockVibration | None" = part(_block_vibration, optional=True, default=None)
    torsion: TrainTorques | None = part(TrainTorques, optional=True, default=None)
    api_618: ProcessSheet | None = part(ProcessSheet, optional=True, default=None)
    load_steps: LoadSteps | None = part(LoadSteps, optional=True, default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("crank_angle",)

    @classmethod
    def units_by_name(cls) -> Mapping[str, str]:
        """Units of the registered quantities, and of what else a revolution has."""
        units = {}
        for quantity in registered():
            name = quantity.family or quantity.name
            units[_KEYS.get(name, name)] = quantity.unit
        return units | _UNITS

    @computed(NAMED, inline=True)
    def _numbers_by_key(self) -> dict[str, Measured]:
        """Quantities and numbers by their names in JSON."""
        return {_KEYS.get(name, name): number for name, number in self._measured().items()}

    @computed("W")
    def loss_power(self) -> dict[str, float]:
        """[W] Mean power that each joint loses, also where it has no law of friction."""
        period = self.numbers["period"]
        return {name: loss / period for name, loss in self.numbers["losses"].items()}

    @computed("")
    def loss_share(self) -> dict[str, float]:
        """[-] Share of each joint in all losses."""
        losses = self.numbers["losses"]
        total = sum(losses.values())
        if not total:
            return dict.fromkeys(losses, 0.0)
        return {name: loss / total for name, loss in losses.items()}

    @computed("")
    def iterations(self) -> int:
        """[-] Iterations of the solver."""
        return int(self.orbit.iterations)

    @computed_word()
    def converged(self) -> bool:
        """Whether the solution converged."""
        return bool(self.orbit.converged)

    @property
    def status(self) -> Status:
        """Status of the solution."""
        return self.orbit.status

    @computed_word(key="status")
    def _status_words(self) -> str:
        """Status of the solution in words."""
        return Status[self.orbit.status]

    @computed_word()
    def solver(self) -> str:
        """Name of the solver."""
        return self.orbit.solver

    @computed_word(optional=True)
    def film_law(self) -> dict[str, str] | None:
        """Law by which each oil film of a journal was solved; `None` without oil films."""
        return self.films or None

    @computed_part(RodReversal, by_name=True, optional=True, key="rod_load_reversal")
    def _reversals(self) -> dict[str, RodReversal] | None:
        """Reversal by crosshead pin; `None` without crossheads."""
        return self.rod_load_reversal or None

    @computed_part(VerificationErrors, optional=True)
    def verification(self) -> VerificationErrors | None:
        """Errors by an independent integration, where it was asked for."""
        return _verification(self.orbit)

    @computed_part(MovedFilm, by_name=True, optional=True, key="moved_films")
    def _films_that_move(self) -> dict[str, MovedFilm] | None:
        """Films that journals with steady films would have if they moved, where it was asked for."""
        if self.moved_films is None:
            return None
        return {name: _moved_film(film) for name, film in self.moved_films.items()}

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Checks of the periodic state; `tolerance` is that of its solver."""
        numbers = self.numbers
        checks = [
            ended("Solution", Status[self.orbit.status], bool(self.orbit.converged)),
            is_small("Energy closure", numbers["energy_residual"], tolerance),
            is_small("Residual", numbers["residual"], tolerance),
        ]
        resolution = numbers["resolution"]
        name = "Resolution of the speed"
        checks.append(Check(name, f"{resolution:.1e}", resolution <= 0.01, "at most 1e-02"))
        if self.verification is not None:
            checks.append(_march_check(self.verification, numbers, self.quantities["peak_force"]))
        margin = self.quantities.get("joint_margin")
        if margin is not None:
            name = "Margin against self-locking"
            checks.append(Check(name, f"{margin:.4f}", bool(margin > 0), "above 0"))
        return tuple(checks)

    def _measured(self) -> dict[str, Measured]:
        """Quantities and numbers with their units."""
        units = self.units_by_name()
        measured = {}
        for name, value in {**self.quantities, **self.numbers}.items():
            measured[name] = Measured(value, units[_KEYS.get(name, name)])
        return measured

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units, and the curves over the revolution.

        Beside those of the orbit these are the films of the journals and the pressures behind
        double-acting pistons.
        """
        for name, (value, unit) in self._measured().items():
            if isinstance(value, dict):
                for member, number in value.items():
                    yield Data(f"{name}.{member}", unit, number)
            else:
                yield Data(name, unit, value)
        for entry in self.orbit.described():
            if entry.dims:
                yield entry
        yield from self._film_curves()
        yield from self._crank_end_curves()
        if self.api_618 is not None:
            yield from self.api_618.curves()

    def _film_curves(self) -> Iterator[Data]:
        """Thickness of all films, and the state of those of the journals."""
        at = self.table_dims
        compressor = self.compressor
        for name, thickness in film_thickness(compressor, self.orbit).items():
            yield Data(f"film_thickness.{name}", "m", thickness, at)
        for name, film in journal_films(compressor, self.orbit).items():
            yield Data(f"eccentricity.{name}.x", "", film.position[0], at)
            yield Data(f"eccentricity.{name}.y", "", film.position[1], at)
            curves = {f"film_pressure.{name}": "pressure", f"film_flow.{name}": "flow"}
            for loss in ("shear_loss", "squeeze_loss", "contact_loss"):
                curves[f"{loss}.{name}"] = loss
            yield from film.data_of(dims=at, **curves)

    def _crank_end_curves(self) -> Iterator[Data]:
        """Pressures behind double-acting pistons, of several by their numbers."""
        gas = self.orbit.under_gas(self.compressor)
        behind = crank_end_pressure(gas, self.orbit.state.angle)
        if behind is None:
            return
        for number, pressure in enumerate(behind, 1):
            suffix = ""
            if len(behind) > 1:
                suffix = f".{number}"
            yield Data(f"crank_end_pressure{suffix}", "Pa", pressure, self.table_dims)


def steady_state(
    machine: Machine | HasMachine,
    solver: "Collocation | Shooting | None" = None,
    *,
    orbit: Orbit | None = None,
    verify: "bool | TimeIntegration" = False,
    moving_films: bool = False,
) -> SteadyState:
    """Find the periodic state of a machine, and all that follows from it.

    Args:
        machine: a scene or a machine with a crank.
        solver: as in `solve_orbit`.
        orbit: the periodic state, where it is known already.
        verify: as in `solve_orbit`.
        moving_films: find as well what the journals with steady films would do if they moved.

    Raises:
        BadInput: a machine without a crank.
        SolveFailed: no periodic state was found.

    >>> from jaxcomp import load
    >>> state = steady_state(load("mayekawa-wbhe"))
    >>> print(f"{state.quantities['joint_margin']:.4f}, {state.numbers['motor_work']:.1f} J")
    0.9828, 339.4 J
    """
    design = machine_of(machine)
    assembly = assembled(design)
    compressor = assembly.compressor
    if compressor is None:
        raise BadInput("machine", "without a crank", "one with a mechanism")
    if orbit is None:
        orbit = solve_orbit(compressor, solver, verify=verify)
    offered = crank_quantities(design)
    values, numbers, forces = jax.device_get(_numbers(design, assembly, orbit, offered))
    values = jax.tree.map(float, values)
    numbers = jax.tree.map(float, numbers)
    margins = numbers.pop("turning_margins")
    # a compiled function returns its keys sorted; where no film has a thickness there is no least one
    quantities = {}
    for quantity in offered:
        value = values.get(quantity.name, math.inf)
        if isinstance(value, dict):
            # a line so damped that it does not ring has fewer resonances than names for them
            value = {member: number for member, number in value.items() if number != math.inf}
        if value != math.inf:
            quantities[quantity.family or quantity.name] = value
    rods = _rods(compressor, orbit)
    remarks = (
        *_remarks(compressor, margins, rods),
        *_remarks_on_stability(orbit.cycle),
        *_remarks_on_pipes(orbit.cycle),
        *_remarks_on_range(orbit.cycle),
    )
    moved = None
    if moving_films:
        moved = moved_films(compressor, orbit)
    train: Any = design.parts.get("torsion")
    torsion = None
    if train is not None:
        torsion = train_torques(compressor, orbit, train)
    sheet = None
    if forces is not None:
        sheet = process_sheet(compressor, orbit, forces)
    return SteadyState(
        machine=design,
        compressor=compressor,
        orbit=orbit,
        quantities=quantities,
        numbers=numbers,
        films=_film_laws(compressor, orbit),
        rod_load_reversal=rods,
        remarks=remarks,
        moved_films=moved,
        vibration=_vibration(compressor, orbit, design.parts.get("suspension")),
        torsion=torsion,
        api_618=sheet,
    )


def _film_laws(compressor: Compressor, orbit: Orbit) -> dict[str, str]:
    """Law by which the film of each journal was solved; those that move have positions."""
    laws = dict.fromkeys(film_thickness(compressor, orbit), "steady_load")
    for name in orbit.positions or {}:
        if name in laws:
            laws[name] = "orbit"
    return laws


def _vibration(compressor: Compressor, orbit: Orbit, suspension: Any) -> "BlockVibration | None":
    if suspension is None:
        return None
    from ..vibration import block_vibration

    return block_vibration(compressor, orbit, suspension)


def crank_quantities(machine: Machine) -> tuple[Quantity, ...]:
    """The quantities of the periodic state of crank and gas that a machine has."""
    rotor = {"vibration", "rotor", "balancing"}
    suiting = []
    for quantity in registered():
        if rotor.isdisjoint(quantity.needs) and not quantity.missing(machine):
            suiting.append(quantity)
    return tuple(suiting)


@kept_jit
def _numbers(
    machine: Machine, assembly: Assembly, orbit: Orbit, offered: tuple[Quantity, ...]
) -> tuple[dict[str, Any], dict[str, Any], RodForces | None]:
    """All numbers at once: one compiled program instead of dozens of small ones."""
    from ._analysis import DesignResult
    from ._analysis_options import AnalysisOptions

    result = DesignResult(machine, AnalysisOptions())
    result.assembly = assembly
    result.orbit = orbit
    energy = orbit.energy
    compressor = assembly.compressor
    assert compressor is not None
    # every joint that carries a force and could have friction has an entry; without a law it loses
    # nothing
    joints = dict.fromkeys(orbit.loads.forces, 0.0)
    forces = None
    if has_rod_forces(compressor):
        # stages have their pressures in the compressor that was put together
        machine_gas = None
        if machine.compressor is not None:
            machine_gas = machine.compressor.gas
        forces = rod_forces(compressor, machine_gas, orbit, result.wrench)
    numbers = {
        "motor_work": energy.motor_work,
        "gas_work": energy.gas_work,
        "losses": {**joints, **energy.losses},
        "lowest_speed": orbit.lowest_speed,
        "highest_speed": orbit.highest_speed,
        "period": orbit.period,
        "stroke": of_cylinder(compressor.mechanism).stroke,
        "energy_residual": energy.residual,
        "residual": orbit.residual,
        "resolution": orbit.resolution,
        "turning_margins": {},
    }
    if orbit.gas_work_error is not None:
        numbers["gas_work_error"] = orbit.gas_work_error
    if orbit.cycle is not None:
        numbers["cycle_resolution"] = orbit.cycle.resolution
        numbers["turning_margins"] = orbit.cycle.turning_margins
    return offered_values(offered, result), numbers, forces


def _rods(compressor: Compressor, orbit: Orbit) -> dict[str, RodReversal]:
    """Reversal of the rod load at every crosshead pin; nothing of a machine without crossheads."""
    packed = getattr(compressor.friction, "packing", None) is not None
    double_acting = getattr(compressor.gas, "rod_diameter", None) is not None
    if not (packed or double_acting):
        return {}
    rods = {}
    for name, (angle, share) in rod_load_reversal(orbit).items():
        rods[name] = RodReversal(float(angle), float(share))
    return rods


def _moved_film(film: JournalFilm) -> MovedFilm:
    """Least thickness and mean loss of a journal that moves."""
    loss = film.mean_shear_loss + film.mean_squeeze_loss + film.mean_contact_loss
    return MovedFilm(film.minimum_film, loss)


def _march_check(
    march: VerificationErrors, numbers: dict[str, Any], peak_forces: dict[str, float]
) -> Check:
    """Whether an independent integration finds the same numbers, or has ended at all."""
    if march.status != Status[Status.converged]:
        return Check("Independent march", march.status, False, "ends")
    size = max(numbers["motor_work"], sum(numbers["losses"].values()), key=abs)
    # what is zero, as the work of an ideal machine, has absolute errors
    losses = sum(map(abs, march.losses.values())) / abs(size or 1.0)
    largest = 0.0
    for name, error in march.peak_forces.items():
        largest = max(largest, abs(error) / (peak_forces[name] or 1.0))
    answer = f"speed {march.speed:.1e}, losses {losses:.1e}, peaks {largest:.1e}"
    good = march.speed <= 1e-4 and losses <= 1e-4 and largest <= 1e-2
    return Check("Errors by an independent march", answer, good, "at most 1e-04, 1e-04, 1e-02")


def _verification(orbit: Orbit) -> VerificationErrors | None:
    """Errors by an independent integration: the orbit's value less that of the integration."""
    march = orbit.verification
    if march is None:
        return None
    errors = {
        "speed": march.speed_error,
        "period": -march.period_error,
        "mechanical_efficiency": -march.efficiency_error,
        "losses": {name: -error for name, error in march.loss_error.items()},
        "gas_work": -march.gas_work_error,
        "peak_forces": {name: -error for name, error in march.peak_error.items()},
        "closure": march.closure,
    }
    numbers: dict[str, Any] = jax.tree.map(float, errors)
    return VerificationErrors(**numbers, steps=int(march.steps), status=Status[march.status])


def _remarks_on_range(cycle: Any) -> Iterator[str]:
    """Remark on gas that is hotter than the range of its equation of state."""
    case = getattr(cycle, "case", None)
    fluid = None if case is None else case.cylinder.fluid
    if not isinstance(fluid, AbstractRealGas):
        return
    if not fluid.knows_dew_points:
        yield f"Whether {fluid.name} condenses is not known: no dew point of it was found."
    densest = float(max_of(of_each(cycle).pressure))
    if densest > fluid.highest_pressure:
        reached = f"The gas reaches {densest / 1e5:.4g} bar"
        end = f"beyond {fluid.highest_pressure / 1e5:.4g} bar, up to which the equation of state of"
        yield f"{reached}, {end} {fluid.pressure_ends_with} was fitted."
    hottest = float(max_of(of_each(cycle).temperature))
    _, highest = fluid.temperature_range
    if hottest > highest:
        reached = f"The gas reaches {hottest - ZERO_CELSIUS:.0f} °C"
        end = f"beyond {highest - ZERO_CELSIUS:.0f} °C, up to which the equation of state of"
        yield f"{reached}, {end} {fluid.range_ends_with} was fitted."


def _remarks_on_pipes(cycle: Any) -> Iterator[str]:
    """Remarks on waves in pipes that are beyond the range of their equations."""
    pulsation = getattr(cycle, "pulsation", None)
    if pulsation is not None:
        yield from pulsation.remarks


def _remarks_on_stability(cycle: Any) -> Iterator[str]:
    """Whether a cycle whose march did not repeat is one that a machine runs in."""
    if not isinstance(cycle, Cycle) or cycle.repeats is None or bool(cycle.repeats):
        return
    multiplier = cycle.multiplier
    if multiplier < -1:
        yield (
            f"The periodic state is unstable: a disturbance is times {multiplier:.3g} in a revolution. "
            "The machine alternates between two revolutions, and this one lies between them."
        )
    elif multiplier > 1:
        yield (
            f"The periodic state is unstable: a disturbance is times {multiplier:.3g} in a revolution."
        )


def _remarks(
    compressor: Compressor, margins: dict[str, float], rods: dict[str, RodReversal]
) -> Iterator[str]:
    """Reasons why numbers of a result do not mean what their names say."""
    for name, rod in rods.items():
        if rod.angle < _REVERSAL or rod.share < _REVERSED:
            yield (
                f"The load of {name.replace('_', ' ')} is reversed for "
                f"{math.degrees(rod.angle):.3g} degrees with {100 * rod.share:.2g} % of its larger "
                "side: the pin may run dry (API 618 asks for 15 degrees and 3 %)."
            )
    if compressor.frictionless:
        yield "There is no friction: nothing is lost, and the efficiency is 100 % by assumption."
    for name, margin in margins.items():
        if abs(margin) < GRAZING:
            valve, place = name.split("_")
            contact = "misses"
            validity = "misses"
            if margin > 0:
                contact = "touches"
                validity = "touches, and are steep there"
            yield (
                f"The {valve} valve just {contact} its {place} "
                f"({100 * abs(margin):.2g} % of its stop): derivatives hold only for designs in which it "
                f"still {validity}. Move the stop, or let an optimiser search by values."
            )
    if compressor.gas is None:
        yield "There is no gas: all work of the motor is friction, and no efficiency has a meaning."
    elif isinstance(compressor.gas, PolytropicCycle) and not compressor.gas.delivers.any():
        yield (
            "No gas flows: with this clearance the compression never reaches the discharge pressure, and "
            "no efficiency has a meaning."
        )
