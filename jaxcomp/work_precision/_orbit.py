r"""The periodic state: collocation, shooting with several methods of diffrax, and plain SciPy.

The reference is collocation on 24 nodes a panel, beside shooting with an eighth-order method: the
two share the laws and nothing else. Both place panel edges or stops at as many load reversals as the
mechanism has.
"""

from collections.abc import Callable
from functools import partial

import diffrax

from ..crank import Collocation, Shooting
from ..cylinder import Cylinder
from ._report import Reference
from ._scipy import scipy_setting
from ._study import (
    FINE_NODES,
    OTHER_NODES,
    TIGHT_TOLERANCE,
    Question,
    SolverProgram,
    Study,
    needs_crank,
    needs_solver,
)

# Families of quantities of the rotor: they are asked for by the periodic states at several speeds.
ROTOR_QUANTITIES = ("vibration", "balanced_vibration", "mount_force")
# The two of a reference.
METHODS = f"collocation, {FINE_NODES} nodes", f"shooting, Dopri8 at {TIGHT_TOLERANCE:g}"

# Methods of diffrax: at a tight tolerance those of low order would take tens of thousands of steps.
_EXPLICIT: dict[str, tuple[Callable[[], diffrax.AbstractSolver], tuple[float, ...]]] = {
    "Heun": (diffrax.Heun, (1e-1, 1e-2, 1e-3)),
    "Bosh3": (diffrax.Bosh3, (1e-1, 1e-2, 1e-3, 1e-4)),
    "Dopri5": (diffrax.Dopri5, (1e-2, 1e-3, 1e-5, 1e-7, 1e-9)),
    "Tsit5": (diffrax.Tsit5, (1e-2, 1e-3, 1e-5, 1e-7, 1e-9)),
    "Dopri8": (diffrax.Dopri8, (1e-2, 1e-3, 1e-5, 1e-7, 1e-9)),
}
_IMPLICIT: dict[str, tuple[Callable[[], diffrax.AbstractSolver], tuple[float, ...]]] = {
    "Kvaerno3": (diffrax.Kvaerno3, (1e-1, 1e-2, 1e-3)),
    "Kvaerno5": (diffrax.Kvaerno5, (1e-2, 1e-3, 1e-5)),
}
_DIFFRAX = _EXPLICIT | _IMPLICIT
# Compiling takes most of the time of a study, above all that of implicit methods.
_ORDINARY = ("Tsit5", "Dopri8")
_MAX_STEPS = 65536

# Nodes a panel without panel edges at the load reversals, and with them.
_NODES = {False: (4, 8, 16, 32), True: (3, 5, 8, 12, 16)}
_ORDINARY_NODES = {False: (8, 32), True: (5, 8, 12)}  # four nodes do not resolve the revolution
_TOLERANCES = (1e-5, 1e-7, 1e-10, 1e-13)
_SCIPY = {"RK45": (1e-3, 1e-5, 1e-7), "DOP853": (1e-4, 1e-6, 1e-8, 1e-10)}


def orbit_study(question: Question, thorough: bool) -> Study:
    """Solvers of the periodic state over tolerances and nodes.

    Args:
        question: of a machine with a crank.
        thorough: all methods, the implicit ones among them.
    """
    machine = needs_crank(question, "orbit")
    shot = SolverProgram(question, shooting(question, "Dopri8"))
    settings = []
    for located, counts in (_NODES if thorough else _ORDINARY_NODES).items():
        method = "collocation" if located else "collocation, reversals=0"
        for nodes in counts:
            solver = Collocation(nodes=nodes, reversals=question.load_reversals * located)
            program = SolverProgram(question, solver)
            settings += [
                program.setting(method, f"nodes={nodes} tolerance={tol:g}", tol, nodes)
                for tol in _TOLERANCES
            ]
    for name, (_, tolerances) in _DIFFRAX.items():
        if thorough or name in _ORDINARY:
            one = shot if name == "Dopri8" else SolverProgram(question, shooting(question, name))
            settings += [
                one.setting(f"shooting, {name}", f"tolerance={tol:g}", tol) for tol in tolerances
            ]
    of_rotor = question.quantity.partition(".")[0] in ROTOR_QUANTITIES
    if not of_rotor and not isinstance(machine.gas, Cylinder):
        settings += [
            scipy_setting(question, name, tolerance)
            for name, tolerances in _SCIPY.items()
            for tolerance in tolerances
            if thorough or name == "DOP853"
        ]
    words = "solvers of the periodic state, single designs"
    return Study(partial(orbit_reference, question, shot), tuple(settings), words)


def orbit_reference(question: Question, shot: SolverProgram | None = None) -> Reference:
    """The quantity by fine collocation, beside tight shooting.

    Args:
        question: of a machine with a crank.
        shot: the program by `diffrax.Dopri8`, if there is one already.

    Raises:
        BadInput: a quantity in which the solver has no part, or without a value.
    """
    shot = SolverProgram(question, shooting(question)) if shot is None else shot
    other = shot.value(TIGHT_TOLERANCE)
    value = needs_solver(question, SolverProgram(question, question.fine_solver), other)
    return Reference(value, other, METHODS)


def shooting(question: Question, name: str = "Dopri8") -> Shooting:
    """The solver with a method of diffrax and outputs denser than those of the reference."""
    make, _ = _DIFFRAX[name]
    return Shooting(
        make(), max_steps=_MAX_STEPS, reversals=question.load_reversals, output_nodes=OTHER_NODES
    )
