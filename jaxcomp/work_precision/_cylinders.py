"""Cost of several cylinders: the same cylinder once, twice, four and eight times on one crank."""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._fields import BadInput, of_cylinder, replaced
from ..compressor import Compressor, at_speed
from ..crank import Collocation
from ..gas import StagedCycle
from ..machine import Machine
from ..mechanism import Cylinders, SliderCrank
from ..motor import MeanSpeed
from ._orbit import orbit_reference
from ._report import Growth, Measurement
from ._study import Question, SolverProgram, Study

# Layouts that fire evenly but for the twin.
LAYOUTS = {1: "single", 2: "V90", 4: "V90x2", 8: "VV45x2"}
# Throws and rods stand apart by this many bores.
_THROW_PITCH, _ROD_PITCH = 1.5, 0.3
_NODES, _ALL_NODES = (5, 8), (5, 8, 12)


def cylinders_study(question: Question, thorough: bool) -> Study:
    """Error against run time for 1, 2, 4 and 8 cylinders, and how the cost grows with their number.

    Args:
        question: of a machine with a slider-crank, of which the first cylinder is taken.
        thorough: more nodes.
    """
    settings = []
    for count, layout in LAYOUTS.items():
        one = question._replace(design=Machine(with_layout(question.compressor, layout)))
        task = f"{count} cylinder{'s' if count > 1 else ''}"
        options: Any = {"task": task, "reference": cache(partial(orbit_reference, one))}
        for nodes in _ALL_NODES if thorough else _NODES:
            program = SolverProgram(one, Collocation(nodes=nodes, reversals=0))
            label = f"nodes={nodes} reversals=0"
            settings.append(program.setting(f"{task}, collocation", label, 1e-7, nodes, **options))
        program = SolverProgram(one, None)
        settings.append(program.setting(f"{task}, default", "default", 1e-13, **options))
    note = "one cylinder, and more of it on one crank"
    return Study(settings[0].reference, tuple(settings), note, growth=growth)


def growth(rows: Sequence[Measurement]) -> dict[str, Growth]:
    """Cost over the number of cylinders, by setting.

    Args:
        rows: of `cylinders_study`.
    """
    found = {}
    for label in dict.fromkeys(row.setting for row in rows):
        own = {int(row.task.split()[0]): row for row in rows if row.setting == label}
        times = {count: row.seconds for count, row in own.items() if np.isfinite(row.seconds)}
        if len(times) > 1:
            each, fixed = np.polyfit([*times], [*times.values()], 1)
            compiling = {count: own[count].compile_seconds for count in times}
            found[label] = Growth(times, compiling, float(fixed), float(each))
    return found


def with_layout(machine: Compressor | None, layout: str) -> Compressor:
    """The machine with the first of its cylinders in a layout, balanced, at its mean speed.

    Args:
        machine: with a slider-crank; its counterweights do not count.
        layout: as in `Cylinders`.

    Raises:
        BadInput: another mechanism, or stages that share an intermediate pressure.
    """
    mechanism = None if machine is None else machine.mechanism
    if machine is None or not isinstance(mechanism, SliderCrank):
        raise BadInput("mechanism", type(mechanism).__name__, "a slider_crank, for this study")
    if isinstance(machine.gas, StagedCycle):
        raise BadInput("gas", "staged", "the same for every cylinder, for this study")
    one = of_cylinder(mechanism)
    absent = {"crank_unbalance_across": None, "crank_couple": None}
    one = replaced(one, crank_unbalance=jnp.zeros(()), **absent)
    cylinders = Cylinders(
        layout=layout,
        throw_pitch=_THROW_PITCH * one.bore,
        rod_pitch=_ROD_PITCH * one.bore,
        balanced=True,
    )
    made = Compressor(
        one,
        machine.motor,
        of_cylinder(machine.gas),
        of_cylinder(machine.friction),
        machine.gravity,
        cylinders,
    )
    if isinstance(machine.motor, MeanSpeed):
        return made
    return at_speed(made, machine.motor.speed_guess)
