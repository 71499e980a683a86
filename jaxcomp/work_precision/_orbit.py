r"""The periodic state: collocation, shooting with several methods of diffrax, and plain SciPy.

The reference is collocation on 24 nodes a panel, beside shooting with an eighth-order method: the
two share the laws and nothing else. Both place panel edges or stops at as many load reversals as the
mechanism has.
"""

from collections.abc import Callable
from functools import cache, partial

import diffrax

from ..crank import Collocation, Shooting
from ..cylinder import Cylinder
from ._report import Reference
from ._scipy import scipy_row
from ._study import Piece, Question, SolverProgram, Study, needs_crank, needs_solver

# Families of quantities of the rotor: they are asked for by the periodic states at several speeds.
ROTOR_QUANTITIES = ("vibration", "balanced_vibration", "mount_force")

_FINE_NODES = 24
_FINE_TOLERANCE, _TIGHT_TOLERANCE = 1e-13, 1e-9

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
    needs_crank(question, "orbit")
    methods = _DIFFRAX if thorough else {name: _DIFFRAX[name] for name in _ORDINARY}
    shooting = cache(partial(_shooting, question))

    pieces = [
        Piece(f"collocation, {nodes} nodes", partial(_collocation_rows, question, nodes, located))
        for located, counts in (_NODES if thorough else _ORDINARY_NODES).items()
        for nodes in counts
    ]
    pieces += [
        Piece(f"shooting, {name}", partial(_shooting_rows, shooting, name, tolerances))
        for name, (_, tolerances) in methods.items()
    ]
    machine = question.compressor
    assert machine is not None
    if question.quantity.partition(".")[0] not in ROTOR_QUANTITIES and not isinstance(
        machine.gas, Cylinder
    ):
        pieces += [
            Piece(f"SciPy, {name}", partial(_scipy_rows, question, name, tolerances))
            for name, tolerances in _SCIPY.items()
            if thorough or name == "DOP853"
        ]
    words = "solvers of the periodic state, single designs"
    return Study(
        partial(orbit_reference, question, lambda: shooting("Dopri8")), tuple(pieces), words
    )


def orbit_reference(
    question: Question, shooting: Callable[[], SolverProgram] | None = None
) -> Reference:
    """The quantity by fine collocation, beside tight shooting.

    Args:
        question: of a machine with a crank.
        shooting: the program by `diffrax.Dopri8`, if there is one already.

    Raises:
        BadInput: a quantity in which the solver has no part, or without a value.
    """
    fine = Collocation(nodes=_FINE_NODES, reversals=question.load_reversals)
    value = needs_solver(question, SolverProgram(question, fine), _FINE_TOLERANCE)
    shot = _shooting(question, "Dopri8") if shooting is None else shooting()
    methods = f"collocation, {_FINE_NODES} nodes", f"shooting, Dopri8 at {_TIGHT_TOLERANCE:g}"
    return Reference(value, shot.value(_TIGHT_TOLERANCE), methods)


def _collocation_rows(question: Question, nodes: int, located: bool, reference: Reference):
    reversals = question.load_reversals if located else 0
    program = SolverProgram(question, Collocation(nodes=nodes, reversals=reversals))
    method = "collocation" if located else "collocation, reversals=0"
    for tolerance in _TOLERANCES:
        setting = f"nodes={nodes} tolerance={tolerance:g}"
        yield program.row(reference, method, setting, tolerance, nodes)


def _shooting(question: Question, name: str) -> SolverProgram:
    make, _ = _DIFFRAX[name]
    solver = Shooting(
        make(),
        max_steps=_MAX_STEPS,
        reversals=question.load_reversals,
        output_nodes=_FINE_NODES,
    )
    return SolverProgram(question, solver)


def _shooting_rows(shooting, name: str, tolerances, reference: Reference):
    program = shooting(name)
    for tolerance in tolerances:
        method = f"shooting, {name}"
        yield program.row(reference, method, f"tolerance={tolerance:g}", tolerance)


def _scipy_rows(question: Question, method: str, tolerances, reference: Reference):
    for tolerance in tolerances:
        yield scipy_row(question, method, tolerance, reference)
