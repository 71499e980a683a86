r"""`accuracy`: error against run time of whatever works a quantity out."""

from collections.abc import Callable
from typing import Any

from .._fields import BadInput
from ..design import quantity
from ..machine import machine_of
from ._film import FILM_QUANTITIES, film_study
from ._friction import friction_study
from ._gradient import gradient_study
from ._mesh import mesh_study
from ._orbit import orbit_study
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
        thorough: all methods and settings instead of the more telling ones.
        tell: called before each piece of the work with its name, its number and how many there are.

    Returns:
        Every setting with its error and time, and the reference.

    Raises:
        BadInput: an unknown study, quantity or variable, or one that the scene does not have.
    """
    if study not in STUDIES:
        raise BadInput("study", study, f"one of {', '.join(STUDIES)}")
    unit = "" if quantity_name in FILM_QUANTITIES else quantity(quantity_name).unit
    design = machine_of(scene)
    plan = STUDIES[study](Question(design, quantity_name, variable), thorough)
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
        quantity_name,
        unit,
        reference,
        tuple(rows),
        plan.orders(rows, reference),
        plan.note,
    )
