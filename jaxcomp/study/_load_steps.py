"""The load steps of a machine beside each other: what each delivers, and what it costs rods and crank."""

from typing import TYPE_CHECKING

from .._core.errors import BadInput
from .._core.fields import replaced
from ..cylinder import Cylinder, LoadStep
from ..cylinder._ends import with_settings
from ..machine import HasMachine, Machine, machine_of
from ._steady_state import LoadSteps, steady_state

if TYPE_CHECKING:
    from ..crank import Collocation, Shooting

# The step in which nothing is unloaded and every pocket is shut.
FULL_LOAD = "full load"


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
