r"""The cycle of a cylinder with valves at constant speed: its values and their derivatives.

With the inertia of the gas in the ports collocation is compared with the march: they share the laws of
the cylinder, and the sequence of events with which collocation begins. Its derivatives are compared
with differences of the march. With quasi-steady ports the march is all there is; derivatives are refused.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._core.each import of_cylinder
from ..._core.errors import BadInput, kind_text
from ..._core.fields import replaced
from ...compressor import Compressor
from ...crankshaft import Crankshaft
from ...cylinder import CycleOptions, Cylinder, solve_cycle
from ...machine import Machine
from .. import variable as find_variable
from .._variables import variable_names as names_of
from ._report import DerivativeCheck, Measurement, Reference
from ._study import (
    Call,
    Compiled,
    Question,
    Setting,
    Solved,
    Study,
    digits,
    known_value,
    series,
)

# By which derivatives are taken, where the valve has them.
VARIABLES = (
    "gas.suction_valve.stiffness",
    "gas.suction_valve.stop",
    "gas.suction_valve.port_diameter",
    "mechanism.bore",
)
# The more instructive settings, and with `thorough` all.
_NODES = {False: (4, 6, 8, 10), True: (4, 5, 6, 8, 10, 12)}
_TOLERANCES = {False: (1e-4, 1e-6, 1e-8, 1e-9), True: tuple(10.0**-n for n in range(3, 10))}
_STEPS = {False: (1e-2, 1e-3, 1e-4), True: (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)}
# Of references. Events are located within 1e-11, so that a tighter march gains nothing.
_FINE_NODES = 16
_TIGHT = 1e-10
_LESS_TIGHT = 1e-9
_REFERENCE_STEP = 1e-3  # differences of a march of 1e-10 are good to 1e-7 with it
_LONG_MARCH: dict[str, Any] = {"method": "march", "capacity": 8192, "max_passes": 40_000}
_LABEL = "nodes={}"
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
        settings = _inert(question, machine, thorough)
    settings += _quasi_steady(question, machine, thorough)
    note = "the cycle at constant speed, with port inertia and quasi-steady"
    name = "indicated work, volumetric efficiency and their elasticities"
    return Study(
        reference=settings[0].reference,
        settings=tuple(settings),
        note=note,
        name=name,
        findings=lambda rows, reference: {"derivatives": derivatives(rows)},
    )


def one_cylinder(machine: Compressor | None) -> Any:
    """The machine with the first of its cylinders alone.

    Args:
        machine: whose gas is a cylinder with valves.

    Raises:
        BadInput: another gas.
    """
    gas = None if machine is None else machine.gas
    if machine is None or not isinstance(gas, Cylinder):
        raise BadInput("gas", kind_text(gas), "a cylinder with valves, for this study")
    shaft = machine.crankshaft
    return Compressor(
        mechanism=of_cylinder(machine.mechanism),
        crankshaft=Crankshaft(shaft.inertia, shaft.mass),
        motor=machine.motor,
        gas=of_cylinder(gas),
    )


def derivatives(rows: Sequence[Measurement]) -> DerivativeCheck | None:
    """Errors of value and derivatives at the default options, from the rows of `cycle_study`.

    `None` with quasi-steady ports.
    """
    label = _LABEL.format(CycleOptions().panel_nodes)
    by_task = {row.task: row for row in rows if row.setting == label}
    if "value" not in by_task or "gradient" not in by_task:
        return None

    def claimed(row: Measurement) -> float:
        return max(row.error, row.floor or 0.0)

    return DerivativeCheck(
        setting=label, value=claimed(by_task["value"]), gradient=claimed(by_task["gradient"])
    )


def figures(machine: Any, options: CycleOptions, logs: jax.Array) -> Solved:
    """Indicated work [J] and volumetric efficiency with every variable times exp of an entry.

    Args:
        machine: of one cylinder.
        options: of the solver.
        logs: (k,) one for each of the variables that the machine has.
    """
    design = Machine(machine)
    for name, log in zip(variables(machine), logs, strict=True):
        changed_variable = find_variable(design, name)
        design = changed_variable.apply(design, changed_variable.current(design) * jnp.exp(log))
    compressor: Any = design.compressor
    speed = compressor.motor.speed_guess
    cycle = solve_cycle(compressor.gas, compressor.mechanism, speed, options, throw=False)
    count = cycle.iterations
    if options.method == "march":
        count = cycle.passes
    value = jnp.stack([cycle.indicated_work, cycle.volumetric_efficiency])
    return Solved(value=value, iterations=count, ok=cycle.converged, status=cycle.status)


def elasticities(machine: Any, options: CycleOptions) -> Solved:
    """(2, k) of `figures` by the variables, in forward mode."""

    def logarithms(logs):
        solved = figures(machine, options, logs)
        return jnp.log(solved.value), solved

    slopes, solved = jax.jacfwd(logarithms, has_aux=True)(unchanged(machine))
    return solved._replace(value=slopes)


def variables(machine: Any) -> tuple[str, ...]:
    """Those of `VARIABLES` that a machine has: a check valve has no stiffness."""
    names = names_of(Machine(machine))
    return tuple(name for name in VARIABLES if name in names)


def unchanged(machine: Any) -> jax.Array:
    """Logarithms for `figures` that leave the machine as it is."""
    return jnp.zeros(len(variables(machine)))


class _March:
    """The march of a machine, compiled once for all tolerances."""

    def __init__(self, machine: Any):
        self._machine = machine
        self._figures = Compiled(figures)

    def call(self, tolerance: float, logs: Any = None) -> Call:
        """Values at a tolerance."""
        if logs is None:
            logs = unchanged(self._machine)
        logs = jnp.asarray(logs)
        options = CycleOptions(**_LONG_MARCH, value_tolerance=jnp.asarray(tolerance))
        return self._figures.call(self._machine, options, logs)

    def differences(self, tolerance: float, step: float) -> Solved:
        """Elasticities by central differences of a step in the logarithm."""
        columns = []
        passes = 0
        for shift in step * np.eye(len(variables(self._machine))):
            ahead = self.call(tolerance, shift).run()
            behind = self.call(tolerance, -shift).run()
            for end in (ahead, behind):
                if end.why:
                    return end
                passes += int(end.iterations)
            # In logarithms, as are the variables: a slope is an elasticity.
            columns.append((np.log(ahead.value) - np.log(behind.value)) / (2 * step))
        return Solved(np.stack(columns, axis=1), passes)

    def fourth_order(self, tolerance: float) -> Solved:
        """Elasticities for a reference, without the error of the second order."""
        near = self.differences(tolerance, _REFERENCE_STEP)
        far = self.differences(tolerance, 2 * _REFERENCE_STEP)
        if near.why:
            return near
        if far.why:
            return far
        # The error of central differences goes with the square of the step, which this removes.
        return near._replace(value=(4 * near.value - far.value) / 3)

    def settings(self, task: str, reference: Any, thorough: bool) -> list[Setting]:
        """Its settings by tolerance."""
        return series(
            f"{task}, march",
            "tolerance={:g}",
            self.call,
            _TOLERANCES[thorough],
            digits,
            reference=reference,
            task=task,
        )


def _inert(question: Question, machine: Any, thorough: bool) -> list[Setting]:
    """Collocation for values and derivatives, and the march for values."""
    marched = _March(machine)

    def values(nodes: int) -> Call:
        return Compiled(figures).call(machine, CycleOptions(nodes=nodes), unchanged(machine))

    def gradient(nodes: int) -> Call:
        return Compiled(elasticities).call(machine, CycleOptions(nodes=nodes))

    of_values = _reference(
        question, lambda: values(_FINE_NODES).run(), lambda: marched.call(_TIGHT).run()
    )
    of_gradient = _reference(
        question, lambda: gradient(_FINE_NODES).run(), lambda: marched.fourth_order(_TIGHT)
    )
    settings: list[Setting] = []
    for task, call, reference in (
        ("value", values, of_values),
        ("gradient", gradient, of_gradient),
    ):
        settings += series(
            f"{task}, collocation",
            _LABEL,
            call,
            _NODES[thorough],
            float,
            reference=reference,
            task=task,
        )
    return settings + marched.settings("value", of_values, thorough)


def _quasi_steady(question: Question, machine: Any, thorough: bool) -> list[Setting]:
    """The march for values, and differences of it for derivatives, which forward mode refuses."""
    valves = {}
    for name in ("suction_valve", "discharge_valve"):
        valves[name] = replaced(getattr(machine.gas, name), port_length=None)
    machine = replaced(machine, gas=replaced(machine.gas, **valves))
    marched = _March(machine)

    def value_at(tolerance: float) -> Solved:
        return marched.call(tolerance).run()

    of_values = _reference(question, partial(value_at, _TIGHT), partial(value_at, _LESS_TIGHT))
    of_gradient = _reference(
        question,
        partial(marched.fourth_order, _TIGHT),
        partial(marched.fourth_order, _LESS_TIGHT),
    )
    task = "quasi-steady gradient"
    refused = Setting(
        method=f"{task}, forward mode",
        label="default",
        prepare=lambda: Compiled(elasticities).call(machine, CycleOptions()),
        reference=of_gradient,
        task=task,
    )
    settings = [*marched.settings("quasi-steady value", of_values, thorough), refused]
    for tolerance in (1e-6, float(CycleOptions().value_tolerance)):

        def differences(step, tolerance=tolerance):
            return Call(partial(marched.differences, tolerance, step))

        label = f"tolerance={tolerance:g} step={{:g}}"
        settings += series(
            f"{task}, differences",
            label,
            differences,
            _STEPS[thorough],
            candidate=False,
            reference=of_gradient,
            task=task,
        )
    return settings


def _reference(question: Question, *methods: Callable[[], Solved]) -> Callable[[], Reference]:
    """The reference by two methods, which are run once, when it is first needed."""

    @cache
    def reference() -> Reference:
        first, second = (known_value(question, method()) for method in methods)
        return Reference(value=first, other=second, methods=_METHODS, each=True)

    return reference
