"""The load steps of a machine beside each other: what each delivers, and what it costs rods and crank."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .._core.declared import Record, computed_part, declarations, reading, word
from .._core.errors import BadInput
from .._core.fields import replaced
from .._core.results import Data, Result
from ..cylinder import Cylinder, LoadStep
from ..cylinder._ends import with_settings
from ..machine import HasMachine, Machine, machine_of
from ._api_618 import ThrowData
from ._steady_state import SteadyState, steady_state

if TYPE_CHECKING:
    from ..crank import Collocation, Shooting

# The step in which nothing is unloaded and every pocket is shut.
FULL_LOAD = "full load"


@dataclasses.dataclass(frozen=True)
class LoadStepData(Record):
    """Flow, power, torque, rod loads and temperatures at a load step.

    Rod loads are the largest of all rods, gas and inertia together; reversals the least. What a machine
    without connecting rods has none of is NaN.

    Attributes:
        name: of the step.
        mass_flow: [kg/s]
        flow_share: [-] of the flow at full load.
        gas_power, shaft_power: [W]
        mean_torque: [N m] of the motor.
        torque_fluctuation: [-]
        rod_compression, rod_tension: [N]
        reversal_angle: [rad]
        reversal_share: [-]
        discharge_temperature: [K] of the hottest end that delivers.
        stage_pressures: [Pa] behind each stage but the last, by its number.
    """

    name: str = word()
    mass_flow: float = reading("kg/s")
    flow_share: float = reading("")
    gas_power: float = reading("W")
    shaft_power: float = reading("W")
    mean_torque: float = reading("N m")
    torque_fluctuation: float = reading("")
    rod_compression: float = reading("N")
    rod_tension: float = reading("N")
    reversal_angle: float = reading("rad")
    reversal_share: float = reading("")
    discharge_temperature: float = reading("K")
    stage_pressures: dict[str, float] = reading("Pa")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class LoadSteps(Result):
    """Periodic states of a machine at full load and at each of its load steps.

    Attributes:
        names: of the steps, full load first.
        states: of each.
    """

    names: tuple[str, ...]
    states: tuple[SteadyState, ...]

    table_dims: ClassVar[tuple[str, ...]] = ("load_step",)

    def described(self) -> Iterator[Data]:
        """The quantities of every step in SI units."""
        yield Data("load_step", "", np.array(self.names), self.table_dims)
        rows = self.rows()
        for name, declaration in declarations(LoadStepData).items():
            values = [getattr(row, name) for row in rows]
            # neither the name nor pressures, of which a step may have several, make a column
            if isinstance(values[0], float):
                yield Data(name, str(declaration.unit), np.array(values), self.table_dims)

    @computed_part(LoadStepData)
    def steps(self) -> list[LoadStepData]:
        """Numbers of every step."""
        return self.rows()

    def rows(self) -> list[LoadStepData]:
        """One record for every step."""
        full = float(self.states[0].quantities["mass_flow"])
        rows = []
        for name, state in zip(self.names, self.states, strict=True):
            rows.append(_row(name, state, full))
        return rows


def load_steps(
    machine: Machine | HasMachine, solver: "Collocation | Shooting | None" = None
) -> LoadSteps:
    """Solve a machine at full load and at each of its load steps.

    Args:
        machine: a scene or a machine whose gas is a `Cylinder` with `load_steps`.
        solver: as in `solve_orbit`.

    Raises:
        BadInput: a machine without load steps.
        SolveFailed: a step at which no periodic state was found.
    """
    design = machine_of(machine)
    compressor = design.compressor
    gas = None if compressor is None else compressor.gas
    if compressor is None or not isinstance(gas, Cylinder) or not gas.load_steps:
        raise BadInput("gas.load_steps", "absent", "one load step at least")
    steps = (LoadStep(FULL_LOAD), *gas.load_steps)
    states = []
    for step in steps:
        at_step = replaced(gas, unloaded=step.unloaded, pockets=step.pockets)
        # Both are given in every step, so that one program serves all.
        stepped_gas = with_settings(at_step, compressor.crankshaft.count)
        changed = replaced(design, compressor=replaced(compressor, gas=stepped_gas))
        states.append(steady_state(changed, solver))
    return LoadSteps(tuple(step.name for step in steps), tuple(states))


def _of_throws(throws: Sequence[ThrowData], name: str) -> list[float]:
    return [getattr(throw, name) for throw in throws]


def _row(name: str, state: SteadyState, full: float) -> LoadStepData:
    quantities = state.quantities
    sheet = state.api_618
    cycle = state.orbit.cycle
    assert cycle is not None
    throws = ()
    ends = ()
    if sheet is not None:
        throws = sheet.throws
        ends = sheet.ends
    # An end whose valves are held open has no discharge, and so no temperature of it.
    warm = []
    for end in ends:
        if end.volumetric_efficiency > 1e-6:
            warm.append(end.discharge_temperature)
    flow = float(quantities["mass_flow"])
    return LoadStepData(
        name=name,
        mass_flow=flow,
        flow_share=flow / full,
        gas_power=float(quantities["gas_power"]),
        shaft_power=float(quantities["motor_power"]),
        mean_torque=float(quantities["motor_power"]) / float(quantities["mean_speed"]),
        torque_fluctuation=float(quantities["torque_fluctuation"]),
        rod_compression=max(_of_throws(throws, "combined_compression"), default=np.nan),
        rod_tension=max(_of_throws(throws, "combined_tension"), default=np.nan),
        reversal_angle=min(_of_throws(throws, "reversal_angle"), default=np.nan),
        reversal_share=min(_of_throws(throws, "reversal_share"), default=np.nan),
        discharge_temperature=max(warm, default=np.nan),
        stage_pressures=dict(quantities.get("interstage_pressure", {})),
    )
