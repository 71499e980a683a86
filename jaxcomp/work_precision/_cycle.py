r"""The cycle of a cylinder with valves at constant speed: its values and their derivatives.

With the inertia of the gas in the ports collocation is compared with the march: they share the laws of
the cylinder, and the sequence of events with which collocation begins. Its derivatives are compared
with differences of the march. With quasi-steady ports the march is all there is; derivatives are refused.
"""

from collections.abc import Sequence
from functools import cache, cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput, of_cylinder, replaced
from ..compressor import Compressor
from ..cylinder import CycleOptions, Cylinder, solve_cycle
from ..design import variable
from ..design import variable_names as names_of
from ..machine import Machine
from ._measure import Program
from ._report import DerivativeCheck, Measurement, Reference
from ._study import Call, Question, Setting, Solved, Study, no_value

# By which derivatives are taken, where the valve has them.
VARIABLES = (
    "gas.suction_valve.stiffness",
    "gas.suction_valve.stop",
    "gas.suction_valve.port_diameter",
    "mechanism.bore",
)
_NODES, _ALL_NODES = (4, 6, 8, 10), (4, 5, 6, 8, 10, 12)
_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-9)
_ALL_TOLERANCES = tuple(10.0**-n for n in range(3, 10))
_STEPS, _ALL_STEPS = (1e-2, 1e-3, 1e-4), (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
# Of references. Events are located within 1e-11, so that a tighter march gains nothing.
_FINE_NODES, _TIGHT, _LESS_TIGHT = 16, 1e-10, 1e-9
_REFERENCE_STEP = 1e-3  # differences of a march of 1e-10 are good to 1e-7 with it
_LONG_MARCH: dict[str, Any] = {"method": "march", "capacity": 8192, "max_passes": 40_000}
_METHODS = (
    f"collocation with {_FINE_NODES} nodes; of quasi-steady ports the march at {_TIGHT:g}",
    f"the march with located events at {_TIGHT:g} and fourth-order differences of it; of quasi-steady "
    f"ports the same at {_LESS_TIGHT:g}",
)


def cycle_study(question: Question, thorough: bool) -> Study:
    """Error against run time of the cycle at constant speed and of its derivatives.

    Values are the indicated work and the volumetric efficiency, each relative to itself. Derivatives are
    elasticities of both by `VARIABLES`, relative to the largest of the same value.

    Args:
        question: of a machine whose gas is a cylinder with valves, of which the first is taken.
        thorough: more nodes, tolerances and steps.

    Raises:
        BadInput: another gas.
    """
    machine = one_cylinder(question.compressor)
    settings = []
    if machine.gas.inert:
        settings += _inert(question, machine, _ALL_NODES if thorough else _NODES, thorough)
    settings += _quasi_steady(question, machine, thorough)
    note = "the cycle at constant speed, with port inertia and quasi-steady"
    name = "indicated work, volumetric efficiency and their elasticities"
    first = settings[0].reference
    return Study(first, tuple(settings), note, name=name, derivatives=derivatives)


def one_cylinder(machine: Compressor | None) -> Any:
    """The machine with the first of its cylinders alone.

    Args:
        machine: whose gas is a cylinder with valves.

    Raises:
        BadInput: another gas.
    """
    gas = None if machine is None else machine.gas
    if machine is None or not isinstance(gas, Cylinder):
        raise BadInput("gas", type(gas).__name__, "a cylinder with valves, for this study")
    return replaced(
        machine, mechanism=of_cylinder(machine.mechanism), gas=of_cylinder(gas), cylinders=None
    )


def derivatives(rows: Sequence[Measurement]) -> DerivativeCheck | None:
    """Errors of value and derivatives at the default options; `None` with quasi-steady ports.

    Args:
        rows: of `cycle_study`.
    """
    label = _label(CycleOptions().nodes)
    found = {row.task: row for row in rows if row.setting == label}
    if "value" not in found or "gradient" not in found:
        return None
    errors = [max(found[task].error, found[task].floor or 0.0) for task in ("value", "gradient")]
    return DerivativeCheck(label, *errors)


def figures(machine: Any, options: CycleOptions, logs: jax.Array) -> Solved:
    """Indicated work [J] and volumetric efficiency with every variable times exp of an entry.

    Args:
        machine: of one cylinder.
        options: of the solver.
        logs: (k,) one for each of the variables that the machine has.
    """
    design = Machine(machine)
    for name, log in zip(variables(machine), logs, strict=True):
        one = variable(design, name)
        design = one.apply(design, one.current(design) * jnp.exp(log))
    made: Any = design.compressor
    speed = made.motor.speed_guess
    cycle = solve_cycle(made.gas, made.mechanism, speed, options, throw=False)
    count = cycle.passes if options.method == "march" else cycle.iterations
    value = jnp.stack([cycle.indicated_work, cycle.volumetric_efficiency])
    return Solved(value, count, cycle.converged, cycle.status)


def elasticities(machine: Any, options: CycleOptions) -> Solved:
    """(2, k) of `figures` by the variables, in forward mode."""

    def logarithms(logs):
        solved = figures(machine, options, logs)
        return jnp.log(solved.value), solved

    slopes, solved = jax.jacfwd(logarithms, has_aux=True)(_none(machine))
    return solved._replace(value=slopes)


def variables(machine: Any) -> tuple[str, ...]:
    """Those of `VARIABLES` that a machine has: a check valve has no stiffness."""
    known = names_of(Machine(machine))
    return tuple(name for name in VARIABLES if name in known)


def _none(machine):
    return jnp.zeros(len(variables(machine)))


def _label(nodes: int) -> str:
    return f"nodes={nodes}"


class _March:
    """The march of a machine, compiled once for all tolerances."""

    def __init__(self, machine: Any):
        self._machine = machine

    @cached_property
    def _program(self) -> Program:
        return Program(figures, *self._arguments(_TIGHT), _none(self._machine))

    def _arguments(self, tolerance: float):
        options = CycleOptions(**_LONG_MARCH, value_tolerance=jnp.asarray(tolerance))
        return self._machine, options

    def call(self, tolerance: float) -> Call:
        """Values at a tolerance."""
        return Call(
            self._program.on(*self._arguments(tolerance), _none(self._machine)), self._program
        )

    def differences(self, tolerance: float, step: float) -> Solved:
        """Elasticities by central differences of a step in the logarithm."""
        columns, passes = [], 0
        for own in step * np.eye(len(_none(self._machine))):
            ends = []
            for logs in (own, -own):
                end = self._program(*self._arguments(tolerance), jnp.asarray(logs))
                if end.why:
                    return end
                ends.append(np.log(end.value))
                passes += int(end.iterations)
            columns.append((ends[0] - ends[1]) / (2 * step))
        return Solved(np.stack(columns, axis=1), passes)

    def fourth_order(self, tolerance: float, step: float) -> Solved:
        """The same without the error of the second order."""
        near, far = (self.differences(tolerance, width * step) for width in (1, 2))
        if near.why or far.why:
            return near if near.why else far
        return near._replace(value=(4 * near.value - far.value) / 3)


def _inert(question, machine, nodes: Sequence[int], thorough: bool) -> list[Setting]:
    marched = _March(machine)
    none = _none(machine)

    def values(count: int) -> Call:
        arguments = machine, CycleOptions(nodes=count), none
        program = Program(figures, *arguments)
        return Call(program.on(*arguments), program)

    def gradient(count: int) -> Call:
        arguments = machine, CycleOptions(nodes=count)
        program = Program(elasticities, *arguments)
        return Call(program.on(*arguments), program)

    @cache
    def of_values():
        return _reference(question, values(_FINE_NODES).run(), marched.call(_TIGHT).run())

    @cache
    def of_gradient():
        other = marched.fourth_order(_TIGHT, _REFERENCE_STEP)
        return _reference(question, gradient(_FINE_NODES).run(), other)

    made = [
        Setting(f"{task}, collocation", _label(count), partial(call, count), (float(count),),
                reference=reference, task=task)
        for task, call, reference in (
            ("value", values, of_values),
            ("gradient", gradient, of_gradient),
        )
        for count in nodes
    ]  # fmt: skip
    return made + _marches(marched, "value", of_values, thorough)


def _quasi_steady(question, machine, thorough: bool) -> list[Setting]:
    valves = {
        name: replaced(getattr(machine.gas, name), port_length=None)
        for name in ("suction_valve", "discharge_valve")
    }
    machine = replaced(machine, gas=replaced(machine.gas, **valves))
    marched = _March(machine)

    @cache
    def of_values():
        ends = (marched.call(tolerance).run() for tolerance in (_TIGHT, _LESS_TIGHT))
        return _reference(question, *ends)

    @cache
    def of_gradient():
        ends = (marched.fourth_order(own, _REFERENCE_STEP) for own in (_TIGHT, _LESS_TIGHT))
        return _reference(question, *ends)

    def refused() -> Call:
        program = Program(elasticities, machine, CycleOptions())
        return Call(program.on(machine, CycleOptions()), program)

    task = "quasi-steady gradient"
    default = float(CycleOptions().value_tolerance)
    differences = [
        Setting(f"{task}, differences", f"tolerance={tolerance:g} step={step:g}",
                lambda tolerance=tolerance, step=step: Call(
                    partial(marched.differences, tolerance, step)),
                candidate=False, reference=of_gradient, task=task)
        for tolerance in (1e-6, default)
        for step in (_ALL_STEPS if thorough else _STEPS)
    ]  # fmt: skip
    forward = Setting(f"{task}, forward mode", "default", refused, reference=of_gradient, task=task)
    return [*_marches(marched, "quasi-steady value", of_values, thorough), forward, *differences]


def _marches(marched: _March, task: str, reference, thorough: bool) -> list[Setting]:
    return [
        Setting(f"{task}, march", f"tolerance={tolerance:g}", partial(marched.call, tolerance),
                (-np.log10(tolerance),), reference=reference, task=task)
        for tolerance in (_ALL_TOLERANCES if thorough else _TOLERANCES)
    ]  # fmt: skip


def _reference(question: Question, first: Solved, second: Solved) -> Reference:
    for end in (first, second):
        if end.why:
            raise no_value(question, end.why)
    return Reference(np.asarray(first.value), np.asarray(second.value), _METHODS, True)
