r"""The periodic state: collocation, shooting with several methods of diffrax, and plain SciPy.

The reference is collocation on 24 nodes a panel, beside shooting with an eighth-order method: the
two share the laws and nothing else. Both place panel edges or stops at as many load reversals as the
mechanism has.
"""

from functools import cache, partial

import diffrax
import numpy as np

from .._fields import BadInput
from ..crank import Collocation, Shooting, moving
from ..cylinder import Cylinder
from ..design import available_quantities, quantity
from ..machine import Machine
from ._report import Reference
from ._scipy import scipy_setting
from ._study import (
    FINE_NODES,
    FINE_TOLERANCE,
    OTHER_NODES,
    ROTOR_QUANTITIES,
    TIGHT_TOLERANCE,
    Call,
    Question,
    Setting,
    SolverProgram,
    Study,
    without_error,
)

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


def orbit_study(question: Question, thorough: bool) -> Study:
    """Solvers of the periodic state over tolerances and nodes.

    Args:
        question: of a machine with a crank.
        thorough: all methods, the implicit ones among them.
    """
    machine = question.compressor
    assert machine is not None
    moves = bool(moving(machine))
    shot = None if moves else SolverProgram(question, shooting(question))
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
    for name, tolerances in _DIFFRAX.items():
        if not moves and (thorough or name in _ORDINARY):
            if shot is not None and name == "Dopri8":
                one = shot
            else:
                one = SolverProgram(question, shooting(question, name))
            settings += [
                one.setting(f"shooting, {name}", f"tolerance={tol:g}", tol) for tol in tolerances
            ]
    of_rotor = question.quantity.partition(".")[0] in ROTOR_QUANTITIES
    if not of_rotor and not moves and not isinstance(machine.gas, Cylinder):
        settings += [
            scipy_setting(question, name, tolerance)
            for name, tolerances in _SCIPY.items()
            for tolerance in tolerances
            if thorough or name == "DOP853"
        ]
    note = "solvers of the periodic state, single designs"
    return Study(partial(orbit_reference, question, shot), tuple(settings), note)


def orbit_reference(question: Question, shot: SolverProgram | None = None) -> Reference:
    """The quantity by fine collocation, beside tight shooting.

    Args:
        question: of a machine with a crank.
        shot: the program by `diffrax.Dopri8`, if there is one already.

    Raises:
        BadInput: a quantity without a value, or one in which the solver has no part: the loosest
            tolerance and the other method give the same number, so that no setting has an error.
    """
    solver, tolerance, second = other_method(question)
    if shot is None:
        shot = SolverProgram(question, solver)
    fine = SolverProgram(question, question.fine_solver)
    other = shot.value(tolerance)
    value, loose = fine.value(FINE_TOLERANCE), float(fine.call(0.1).run().value)
    if without_error(value, loose, other):
        excited = question.excitation is not None
        cause = f" (with the excitation '{question.excitation}')" if excited else ""
        bound = f"one that the solver of the periodic state has a part in{cause}"
        raise BadInput("quantity", question.quantity, bound)
    return Reference(value, other, (METHODS[0], second))


def other_method(question: Question) -> tuple[Collocation | Shooting, float, str]:
    """The second method of a reference, its tolerance and its name.

    It is shooting; where journals move, collocation at other places.

    Shooting does not solve for the orbits of journals. An implicit march of the crank with its journals
    agrees with collocation to 1e-6 of the loss (tests of journal orbits).
    """
    assert question.compressor is not None
    if moving(question.compressor):
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
    )


def quantities_study(question: Question, thorough: bool) -> Study:
    """Every quantity of the machine by the default solver, each relative to its own reference.

    All quantities come from one program a solver, so that the time is that of all of them together.
    """
    del thorough
    names = known_quantities(question.design)
    default, fine = (SolverProgram(question, s, names) for s in (None, question.fine_solver))

    @cache
    def values():
        """By the fine solver, at a loose tolerance, and by the second method."""
        solver, tolerance, _ = other_method(question)
        return (fine.value(FINE_TOLERANCE), np.asarray(fine.call(0.1).run().value),
                SolverProgram(question, solver, names).value(tolerance))  # fmt: skip

    def reference(place):
        value, loose, other = (row[place] for row in values())
        if without_error(value, loose, other):
            raise RuntimeError("the solver of the periodic state has no part in it")
        return Reference(value, other, (METHODS[0], other_method(question)[2]))

    def call(place):
        def run():
            found = all_of_them()
            return found._replace(value=found.value[place])

        all_of_them = default.call().run
        return Call(run, default.program)

    settings = tuple(
        Setting(name, f"[{quantity(name).unit or '-'}]", partial(call, place),
                reference=cache(partial(reference, place)), task=name)
        for place, name in enumerate(names)
    )  # fmt: skip
    note = "every quantity by the default solver"
    return Study(partial(reference, 0), settings, note, name=names[0])


def known_quantities(design: Machine) -> tuple[str, ...]:
    """Names of all quantities of a machine, joint by joint."""
    return tuple(available_quantities(design, members=True))
