r"""`accuracy`: error against run time of whatever works a quantity out."""

from collections.abc import Callable
from typing import Any, Literal

from .._fields import BadInput
from ..crank import solve_orbit
from ..design import quantity
from ..machine import Machine, machine_of
from ..rotor import LoadCase
from ._film import FILM_QUANTITIES, film_study
from ._friction import friction_study
from ._gradient import gradient_study
from ._mesh import mesh_study
from ._orbit import ROTOR_QUANTITIES, orbit_study
from ._order import order_study
from ._report import Report, Row
from ._single import precision_study
from ._study import Question

# By the word a user types.
STUDIES: dict[str, Callable[[Question, bool], Any]] = {
    "orbit": orbit_study,
    "order": order_study,
    "gradient": gradient_study,
    "friction": friction_study,
    "film": film_study,
    "mesh": mesh_study,
    "precision": precision_study,
}


def accuracy(
    scene: Any,
    quantity_name: str = "mechanical_efficiency",
    study: str = "orbit",
    *,
    variable: str | None = None,
    excitation: Literal["crank", "file"] | None = None,
    thorough: bool = False,
    tell: Callable[[str, int, int], None] | None = None,
) -> Report:
    """Measure error against run time.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        quantity_name: what the errors are of: any name of `jaxcomp.design.quantity`; for the film one
            of "friction_number", "stiffness" and "damping".
        study: a word of `STUDIES`.
        variable: what to differentiate by, for the study of gradients; any name of
            `jaxcomp.design.variable`.
        excitation: what shakes the rotor, for its quantities: the periodic state of the crank or the
            forces of the scene. Absent: the crank where the scene joins it to the rotor, so that the
            solver of the crank has a part in the answer.
        thorough: all methods and settings instead of the more telling ones.
        tell: called before each piece of the work with its name, its number and how many there are.

    Returns:
        Every setting with its error and time, the reference, and, for studies of the crank, what an
        independent march of one revolution says of the default solver.

    Raises:
        BadInput: an unknown study, quantity or variable, one that the scene does not have, or one
            that nothing in the study changes.
    """
    if study not in STUDIES:
        raise BadInput("study", study, f"one of {', '.join(STUDIES)}")
    unit = "" if quantity_name in FILM_QUANTITIES else quantity(quantity_name).unit
    design = machine_of(scene)
    if excitation is None:
        excitation = _excitation(design, quantity_name)
    question = Question(design, quantity_name, variable, excitation)
    plan = STUDIES[study](question, thorough)
    tell = tell or (lambda words, number, total: None)
    total = len(plan.pieces) + 1
    tell("reference", 0, total)
    reference = plan.reference()
    rows: list[Row] = []
    for number, piece in enumerate(plan.pieces, 1):
        tell(piece.words, number, total)
        rows += piece.rows(reference)
    return Report(
        study,
        getattr(scene, "name", "design"),
        plan.name or quantity_name,
        unit if plan.unit is None else plan.unit,
        reference,
        tuple(rows),
        plan.orders(rows, reference),
        plan.note,
        _march(question) if study in _OF_THE_CRANK else {},
    )


_OF_THE_CRANK = ("orbit", "gradient", "friction", "precision")


def _excitation(design: Machine, name: str) -> Literal["crank", "file"] | None:
    """What shakes the rotor if nothing is said; `None` for quantities of the crank."""
    if name.partition(".")[0] not in ROTOR_QUANTITIES:
        return None
    case = design.parts.get("loads")
    joined = isinstance(case, LoadCase) and case.crank is not None
    return "crank" if joined and design.compressor is not None else "file"


def _march(question: Question) -> dict[str, float]:
    """Errors of the default solver by an independent march of one revolution."""
    machine = question.compressor
    assert machine is not None
    orbit = solve_orbit(machine, question.default_solver, verify=True)
    march = orbit.verification
    assert march is not None
    work = max(abs(float(orbit.energy.motor_work)), float(orbit.energy.total_loss)) or 1.0
    return {
        "speed": float(march.speed_error),
        "mechanical_efficiency": abs(float(march.efficiency_error)),
        "losses": sum(abs(float(e)) for e in march.loss_error.values()) / work,
        "peak_forces": max(
            abs(float(e)) / (float(orbit.peak_forces[name]) or 1.0)
            for name, e in march.peak_error.items()
        ),
    }
