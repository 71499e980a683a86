r"""Error against run time for 1, 2, 4 and 8 cylinders, and how the cost grows with their number.

`python tests/benchmarks/studies.py cylinders` prints its tables.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jaxcomp import BadInput, Collocation
from jaxcomp._core.each import of_cylinder
from jaxcomp.compressor import Compressor, at_speed
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.gas import StagedCycle
from jaxcomp.machine import Machine
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import MeanSpeed
from jaxcomp.study.accuracy._orbit_study import orbit_reference
from jaxcomp.study.accuracy._report import Measurement
from jaxcomp.study.accuracy._study import Question, SolverProgram, Study, computed_once

# Layouts that fire evenly but for the twin.
LAYOUTS = {1: "single", 2: "V90", 4: "V90x2", 8: "VV45x2"}
# Throws and rods stand apart by this many bores.
_THROW_PITCH, _ROD_PITCH = 1.5, 0.3
_NODES_OF_CYLINDERS = {False: (5, 8), True: (5, 8, 12)}


class Growth(NamedTuple):
    """How the cost of a setting grows with the number of cylinders.

    Attributes:
        seconds, compile_seconds: [s] of a warm call and of compiling, by number of cylinders.
        fixed, each: [s] of the line through the times: what does not depend on the number, and what
            every cylinder adds.
    """

    seconds: dict[int, float]
    compile_seconds: dict[int, float]
    fixed: float
    each: float


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
        options: Any = {"task": task, "reference": computed_once(partial(orbit_reference, one))}
        for nodes in _NODES_OF_CYLINDERS[thorough]:
            program = SolverProgram(one, Collocation(nodes=nodes, reversals=0))
            label = f"nodes={nodes} reversals=0"
            settings.append(program.setting(f"{task}, collocation", label, 1e-7, nodes, **options))
        program = SolverProgram(one, None)
        settings.append(program.setting(f"{task}, default", "default", 1e-13, **options))
    note = "one cylinder, and more of it on one crank"
    return Study(settings[0].reference, tuple(settings), note)


def growth(rows: Sequence[Measurement]) -> dict[str, Growth]:
    """Cost over the number of cylinders, by setting, from the rows of `cylinders_study`."""
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
        layout: as in `Crankshaft`.

    Raises:
        BadInput: another mechanism, or stages that share an intermediate pressure.
    """
    mechanism = None if machine is None else machine.mechanism
    if machine is None or not isinstance(mechanism, SliderCrank):
        raise BadInput("mechanism", type(mechanism).__name__, "a slider_crank, for this study")
    if isinstance(machine.gas, StagedCycle):
        raise BadInput("gas", "staged", "the same for every cylinder, for this study")
    one = of_cylinder(mechanism)
    throw, rod = _THROW_PITCH * one.bore, _ROD_PITCH * one.bore
    shaft = machine.crankshaft
    crankshaft = Crankshaft(
        shaft.inertia,
        shaft.mass,
        layout=layout,
        throw_pitch=throw,
        rod_pitch=rod,
        balanced=True,
        main_journal=shaft.main_journal,
    )
    gas, friction = of_cylinder(machine.gas), of_cylinder(machine.friction)
    made = Compressor(one, crankshaft, machine.motor, gas, friction, machine.gravity)
    if isinstance(machine.motor, MeanSpeed):
        return made
    return at_speed(made, machine.motor.speed_guess)
