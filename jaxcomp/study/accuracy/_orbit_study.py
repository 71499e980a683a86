r"""The periodic state: collocation, shooting with methods of diffrax, plain SciPy.

The reference is collocation on 24 nodes a panel, beside shooting with an eighth-order method: the
two share the laws and nothing else. Both place panel edges or stops at as many load reversals as the
mechanism has.

SciPy goes the plain way: `solve_ivp` over the compiled law integrates one revolution over crank angle
between the kinks that geometry and gas give; load reversals within a stroke are met unprepared.
`scipy.optimize.root` finds the speed at the top dead centre (and the level of the motor torque) for
which the revolution ends as it began.
"""

from functools import cache, partial
from itertools import pairwise

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from ..._core.errors import BadInput
from ..._core.extremes import clip
from ..._core.roots import FixedPointReport
from ..._core.status import Status
from ...compressor import Compressor, instants, kink_angles, loads_at
from ...crank import Collocation, Energy, Orbit, Shooting
from ...crank._crank_motion import acceleration
from ...crank._evaluation import orbit_on_panels
from ...crank._journals import orbiting_journals
from ...crank._panels import panels
from ...cylinder import CycleOptions, Cylinder
from ...machine import Machine
from ...mechanism import CrankState
from ...motor import MeanSpeed
from .. import AnalysisOptions, DesignResult, available_quantities
from .._analysis import quantity_named
from ._report import Reference
from ._study import (
    FINE_NODES,
    FINE_TOLERANCE,
    ROTOR_QUANTITIES,
    TIGHT_TOLERANCE,
    Call,
    Question,
    Setting,
    Solved,
    SolverProgram,
    Study,
    computed_once,
    digits,
    median_time,
    series,
)

# Nodes of the second method, at other places: what both read off their nodes shows the difference.
OTHER_NODES = 37
# [-] Two values that differ by less are the same number: of one program, and of two methods.
_ROUNDING = 1e-15
_ROUNDINGS = 1e-12
# [-] A harmonic or a share that is smaller than this part of the largest of its kind is rounding.
_CANCELLED = 1e-12
# The two methods of a reference.
METHODS = f"collocation, {FINE_NODES} nodes", f"shooting, Dopri8 at {TIGHT_TOLERANCE:g}"

# Methods of diffrax: at a tight tolerance those of low order would take tens of thousands of steps.
_DIFFRAX = {
    "Heun": (1e-1, 1e-2, 1e-3),
    "Bosh3": (1e-1, 1e-2, 1e-3, 1e-4),
    "Dopri5": (1e-2, 1e-3, 1e-5, 1e-7, 1e-9),
    "Tsit5": (1e-2, 1e-3, 1e-5, 1e-7, 1e-9),
    "Dopri8": (1e-2, 1e-3, 1e-5, 1e-7, 1e-9),
    "Kvaerno3": (1e-1, 1e-2, 1e-3),
    "Kvaerno5": (1e-2, 1e-3, 1e-5),
}
# Compiling takes most of the time of a study, above all that of implicit methods.
_ORDINARY = ("Tsit5", "Dopri8")
_MAX_STEPS = 65536

# Nodes a panel without panel edges at the load reversals, and with them.
_NODES = {False: (4, 8, 16, 32), True: (3, 5, 8, 12, 16)}
_ORDINARY_NODES = {False: (8, 32), True: (5, 8, 12)}  # four nodes do not resolve the revolution
_TOLERANCES = (1e-5, 1e-7, 1e-10, 1e-13)
_SCIPY = {"RK45": (1e-3, 1e-5, 1e-7), "DOP853": (1e-4, 1e-6, 1e-8, 1e-10)}
# Of SciPy: angles of a revolution at constant speed, from which the first level of torque is taken, and
# revolutions that the search for the periodic state may integrate; it takes 8 to 12 as a rule.
_ANGLES = 256
_REVOLUTIONS = 25


def orbit_study(question: Question, thorough: bool) -> Study:
    """Solvers of the periodic state over tolerances and nodes.

    Args:
        question: of a machine with a crank.
        thorough: all methods, the implicit ones among them.
    """
    machine = question.crank
    moves = bool(orbiting_journals(machine))
    settings: list[Setting] = []
    nodes_by_location = _NODES if thorough else _ORDINARY_NODES
    for located, counts in nodes_by_location.items():
        method = "collocation" if located else "collocation, reversals=0"
        for nodes in counts:
            solver = Collocation(nodes=nodes, reversals=question.load_reversals * located)
            program = SolverProgram(question, solver)
            # The tolerance is an array of the program, which serves all of them.
            for tolerance in _TOLERANCES:
                label = f"nodes={nodes} tolerance={tolerance:g}"
                settings.append(program.setting(method, label, tolerance, nodes))
    other = SolverProgram(question, other_method(question)[0])
    for name, tolerances in _DIFFRAX.items():
        if not moves and (thorough or name in _ORDINARY):
            program = other
            if name != "Dopri8":
                program = SolverProgram(question, shooting(question, name))
            call = program.call
            settings += series(f"shooting, {name}", "tolerance={:g}", call, tolerances, digits)
    of_rotor = question.quantity.partition(".")[0] in ROTOR_QUANTITIES
    if not of_rotor and not moves and not isinstance(machine.gas, Cylinder):
        for name, tolerances in _SCIPY.items():
            if thorough or name == "DOP853":
                call = partial(by_scipy, question, name)
                label = f"{name} rtol={{:g}}"
                settings += series("SciPy", label, call, tolerances, digits, family=name)
    note = "solvers of the periodic state, single designs"
    return Study(partial(orbit_reference, question, other), tuple(settings), note)


def orbit_reference(question: Question, second: SolverProgram | None = None) -> Reference:
    """The quantity by fine collocation, beside the other method.

    Args:
        question: of a machine with a crank.
        second: the program of the other method, if there is one already.

    Raises:
        BadInput: a quantity without a value, or one in which the solver has no part: the loosest
            tolerance and the other method give the same number, so that no setting has an error.
    """
    solver, tolerance, name = other_method(question)
    fine = SolverProgram(question, question.fine_solver)
    # collocation first: where it finds none, shooting need not compile, which takes several times longer
    value = fine.value(FINE_TOLERANCE)
    other = (second or SolverProgram(question, solver)).value(tolerance)
    loose = float(fine.call(0.1).run().value)
    # both methods have the cycle of valves to 1e-12, of which the settings have errors
    rounding = _ROUNDINGS
    if isinstance(question.crank.gas, Cylinder):
        rounding = 0.0
    same = abs(value - loose) <= _ROUNDING * abs(value)
    if same and abs(value - other) <= rounding * abs(value):
        excited = question.excitation is not None
        cause = ""
        if excited:
            cause = f" (with the excitation '{question.excitation}')"
        bound = f"one that the solver of the periodic state has a part in{cause}"
        raise BadInput("quantity", question.quantity, bound)
    return Reference(value, other, (METHODS[0], name))


def other_method(question: Question) -> tuple[Collocation | Shooting, float, str]:
    """The second method of a reference, its tolerance and its name.

    It is shooting; where journals move, for whose orbits that does not solve, collocation at other
    places. An implicit march of the crank with its journals agrees with collocation to 1e-6 of the loss
    (tests of journal orbits).
    """
    if orbiting_journals(question.crank):
        solver = Collocation(nodes=OTHER_NODES, reversals=question.load_reversals, grading=6)
        return solver, FINE_TOLERANCE, f"collocation, {OTHER_NODES} nodes, graded twice as far"
    return shooting(question), TIGHT_TOLERANCE, METHODS[1]


def shooting(question: Question, name: str = "Dopri8") -> Shooting:
    """The solver with a method of diffrax and outputs denser than those of the reference."""
    return Shooting(
        getattr(diffrax, name)(),
        max_steps=_MAX_STEPS,
        reversals=question.load_reversals,
        output_nodes=OTHER_NODES,
        # shares no point with the default's nor the reference's
        cycle=CycleOptions(panels=64, nodes=10),
    )


def by_scipy(question: Question, method: str, tolerance: float) -> Call:
    """A quantity of the crank by a method of `solve_ivp` with a relative tolerance of its steps."""
    machine = question.crank
    laws = _laws(question.design, machine, question.quantity)
    edges = np.asarray(_edges(machine))
    return Call(lambda: Solved(*_solve(machine, *laws, edges, method, tolerance)))


def _edges(machine: Compressor):
    kinks = kink_angles(machine)
    return jnp.append(kinks, kinks[0] + 2 * jnp.pi)


def _laws(design: Machine, machine: Compressor, name: str):
    """Compiled functions: rates of speed, time and accounts; the value from the accounts."""

    @jax.jit
    def rate(angle, low, high, state, level):
        speed = state[0]
        motor = level * machine.motor.torque(speed)
        # a stage on an edge would pick the formula of either side at random
        inside = clip(angle, low + 1e-10, high - 1e-10)
        rise, conservative, loads = acceleration(machine, inside, speed, motor)
        accounts = [motor, -conservative, *loads.loss_torque.values()]
        return jnp.stack([rise / speed, 1 / speed, *accounts])

    @jax.jit
    def value(speed, level, accounts):
        result = DesignResult(design, AnalysisOptions())
        result.orbit = _orbit(machine, speed, level, accounts)
        return jnp.asarray(quantity_named(name).value(result), float)

    return rate, value


def _solve(machine: Compressor, rate, value, edges, method: str, tolerance: float):
    """The quantity, and the number of evaluations of the law."""
    scale = float(machine.motor.speed_guess)
    holds_speed = isinstance(machine.motor, MeanSpeed)
    size = np.asarray(rate(edges[0], edges[0], edges[1], np.array([scale, 0.0]), 1.0)).size
    first_level = _first_level(rate, edges, scale)
    calls = 0

    def revolution(unknowns, accounts=False):
        """State at the end, level of the torque, and speeds at the nodes if accounts are kept."""
        nonlocal calls
        level = 1.0
        if holds_speed:
            level = first_level * unknowns[1]
        state = np.zeros(size if accounts else 2)
        state[0] = unknowns[0] * scale
        # works of a revolution are measured against the motor's, times against the period
        unit = np.full(state.size, max(abs(first_level), 1e-12))
        unit[:2] = scale, 1 / scale
        speeds = []
        for low, high in pairwise(edges):
            if high - low < 1e-12:
                speeds.append(np.full(FINE_NODES, state[0]))
                continue

            def law(angle, y, low=low, high=high):
                return np.asarray(rate(angle, low, high, y, level))[: y.size]

            march = solve_ivp(
                law,
                (low, high),
                state,
                method=method,
                rtol=tolerance,
                atol=tolerance * unit,
                dense_output=accounts,
            )
            calls += march.nfev
            if not march.success:
                raise RuntimeError(march.message)
            state = march.y[:, -1]
            if accounts:
                nodes, _ = np.polynomial.legendre.leggauss(FINE_NODES)
                inside = low + (high - low) * (nodes + 1) / 2
                speeds.append(march.sol(inside)[0])
        return state, level, speeds

    def gap(unknowns):
        end, _, _ = revolution(unknowns)
        gaps = [end[0] / scale - unknowns[0], end[1] * scale / (2 * np.pi) - 1]
        return gaps if holds_speed else gaps[:1]

    # The gap carries the error of the integration: its differences need a step well above that, and
    # the search must not go on below it.
    options = {"eps": max(1e-8, tolerance**0.5), "maxfev": _REVOLUTIONS}
    solution = root(gap, np.ones(1 + holds_speed), tol=0.1 * tolerance, options=options)
    end, level, speeds = revolution(solution.x, accounts=True)
    return float(value(np.stack(speeds), level, end[1:])), calls


def _first_level(rate, edges, scale: float) -> float:
    """Level of the motor torque that carries losses and gas at constant speed."""
    angles = np.linspace(edges[0], edges[-1], _ANGLES, endpoint=False)
    at = jax.vmap(rate, (0, None, None, None, None))
    rates = np.asarray(at(angles, edges[0], edges[-1], np.array([scale, 0.0]), 1.0))
    works = rates[:, 2:].sum(0)
    return float(works[1:].sum() / works[0])


def _orbit(machine: Compressor, speed, level, accounts) -> Orbit:
    """The orbit from the speed at the nodes of each panel and the accounts of the revolution."""
    grid = panels(_edges(machine), FINE_NODES)
    motor = level * machine.motor.torque(speed)
    over = jax.vmap(jax.vmap(lambda a, w, m: acceleration(machine, a, w, m)[0]))
    state = CrankState(grid.angle, speed, over(grid.angle, speed, motor))
    loads = loads_at(machine, state)
    losses = dict(zip(loads.loss_torque, accounts[3:], strict=True))
    energy = Energy(accounts[1], accounts[2], losses)
    report = FixedPointReport(jnp.asarray(0), jnp.asarray(0.0), jnp.asarray(True))
    unknown = dict.fromkeys(losses, jnp.zeros(()))  # errors that SciPy does not report
    at = instants(machine, grid.angle)
    orbit = orbit_on_panels(
        grid, at, state, motor, loads, energy, unknown, Status.converged, report, "SciPy"
    )
    return eqx.tree_at(lambda o: o.mean_speed, orbit, 2 * jnp.pi / accounts[0])


def quantities_study(question: Question, thorough: bool) -> Study:
    """Every quantity of the machine by the default solver, each relative to its own reference.

    All quantities come from one program a solver, so that the time is that of all of them together.
    """
    del thorough
    names = known_quantities(question.design)
    solver, tolerance, second = other_method(question)
    default = SolverProgram(question, None, names)
    fine = SolverProgram(question, question.fine_solver, names)
    other = SolverProgram(question, solver, names)

    @computed_once
    def values():
        """By the fine solver, and by the second method; what cancels in a balanced machine is zero."""
        table = np.array([fine.value(FINE_TOLERANCE), other.value(tolerance)])
        families = np.array([name.partition(".")[0] for name in names])
        largest = []
        for family in families:
            largest.append(np.abs(table[0, families == family]).max())
        table[0, np.abs(table[0]) < _CANCELLED * np.array(largest)] = 0.0
        return table

    def reference(place):
        by_fine_solver, by_other_method = values()[:, place]
        return Reference(by_fine_solver, by_other_method, (METHODS[0], second))

    @cache
    def once():
        call = default.call()
        return call._replace(run=cache(call.run), seconds=median_time(call.run))

    def call(place):
        together = once()
        result = together.run()
        return together._replace(run=lambda: result._replace(value=result.value[place]))

    settings = []
    for place, name in enumerate(names):
        setting = Setting(
            method=name,
            label=f"[{quantity_named(name).unit or '-'}]",
            prepare=partial(call, place),
            reference=cache(partial(reference, place)),
            task=name,
        )
        settings.append(setting)
    note = "every quantity by the default solver"
    return Study(partial(reference, 0), tuple(settings), note, name=names[0])


def known_quantities(design: Machine) -> tuple[str, ...]:
    """Names of all quantities of a machine, joint by joint."""
    return tuple(available_quantities(design, members=True))
