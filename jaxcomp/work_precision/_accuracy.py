r"""`accuracy`: error against run time of whatever works a quantity out."""

import time
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax

from .._fields import BadInput
from ..crank import solve_orbit
from ..design import quantity
from ..machine import Machine, machine_of
from ..rotor import LoadCase
from ._balancing import balancing_study
from ._film import FILM_QUANTITIES, film_study
from ._friction import friction_study
from ._gradient import gradient_study
from ._measure import compile_program
from ._orbit import ROTOR_QUANTITIES, orbit_study
from ._order import order_study
from ._quantities import quantities_study
from ._report import Cost, Report, Row
from ._response import harmonics_study, mesh_study, response_study
from ._study import Question, Study, answer, measured
from ._sweep import sweep_study, tolerance_study
from ._transient import transient_study


class Kind(NamedTuple):
    """A study by its word.

    Attributes:
        make: from question and thoroughness to the study.
        quantity: what the errors are of if nothing is said.
        unit: of that quantity where it is the only one; `None` where another may be asked for.
        varies: whether a variable has a meaning, and the one that is taken if none is named.
    """

    make: Callable[[Question, bool], Study]
    quantity: str = "mechanical_efficiency"
    unit: str | None = None
    varies: tuple[bool, str | None] = (False, None)


# By the word a user types.
STUDIES: dict[str, Kind] = {
    "orbit": Kind(orbit_study),
    "quantities": Kind(quantities_study, "all", ""),
    "gradient": Kind(gradient_study, varies=(True, None)),
    "sweep": Kind(sweep_study, varies=(True, "mechanism.crank_radius")),
    "tolerance": Kind(tolerance_study, varies=(True, None)),
    "simulate": Kind(transient_study, "speed", "rad/s"),
    "response": Kind(response_study, "displacement", "m"),
    "harmonics": Kind(harmonics_study, "vibration"),
    "mesh": Kind(mesh_study, "vibration"),
    "balancing": Kind(balancing_study, "objective", "m"),
    "film": Kind(film_study, "friction_number"),
    "friction": Kind(friction_study),
    "order": Kind(order_study, "mean_speed", "rad/s"),
}
_OF_THE_CRANK = ("orbit", "gradient", "friction", "quantities")


def accuracy(
    scene: Any,
    quantity_name: str | None = None,
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
        quantity_name: what the errors are of: any name of `jaxcomp.design.quantity`; for films one of
            "friction_number", "stiffness" and "damping". Absent: what suits the study.
        study: a word of `STUDIES`.
        variable: what to differentiate by, for the study of gradients, or what varies in sweeps; any
            name of `jaxcomp.design.variable`; for the study of tolerances a pattern of such names.
        excitation: what shakes the rotor, for its quantities: the periodic state of the crank or the
            forces of the scene. Absent: the crank where the scene joins it to the rotor, so that the
            solver of the crank has a part in the answer.
        thorough: all methods and settings instead of the more telling ones.
        tell: called before each setting with its name, its number and how many there are.

    Returns:
        Every setting with its error and time, the reference, and, for studies of the crank, what an
        independent march of one revolution says of the default solver and what its first calls cost.

    Raises:
        BadInput: an unknown study, quantity or variable, one that the scene does not have, or one
            that nothing in the study changes.
    """
    if study not in STUDIES:
        raise BadInput("study", study, f"one of {', '.join(STUDIES)}")
    kind, design = STUDIES[study], machine_of(scene)
    name = quantity_name or kind.quantity
    if kind.unit is not None and name != kind.quantity:
        raise BadInput("quantity", name, f"'{kind.quantity}' for the study '{study}'")
    of_film = study in ("film", "gradient") and name in FILM_QUANTITIES
    unit = kind.unit if kind.unit is not None else "" if of_film else quantity(name).unit
    may_vary, usual = kind.varies
    if variable is not None and (not may_vary or of_film):
        raise BadInput("variable", variable, f"absent for the study '{study}' of {name}")
    if excitation is None:
        excitation = _excitation(design, name, study)
    question = Question(design, name, variable or usual, excitation)
    plan = kind.make(question, thorough)
    tell = tell or (lambda words, number, total: None)
    total = len(plan.settings) + 1
    of_crank = study in _OF_THE_CRANK and design.compressor is not None and not of_film
    tell("reference", 0, total)
    calls = first_calls(question) if of_crank and study != "quantities" else {}
    reference = plan.reference()
    rows: list[Row] = []
    for number, setting in enumerate(plan.settings, 1):
        tell(f"{setting.method}, {setting.words}", number, total)
        rows.append(measured(setting, reference))
    return Report(
        study,
        getattr(scene, "name", "design"),
        plan.name or name,
        unit if plan.unit is None else plan.unit,
        reference,
        tuple(rows),
        plan.orders(rows, reference),
        plan.note,
        _march(question) if of_crank else {},
        calls,
    )


def _excitation(design: Machine, name: str, study: str) -> Literal["crank", "file"] | None:
    """What shakes the rotor if nothing is said; `None` for quantities of the crank."""
    of_rotor = name.partition(".")[0] in ROTOR_QUANTITIES or study in ("balancing", "quantities")
    case = design.parts.get("loads")
    if not of_rotor or not isinstance(case, LoadCase):
        return None
    return "crank" if case.crank is not None and design.compressor is not None else "file"


def first_calls(question: Question) -> dict[str, Cost]:
    """What the default solver costs at the first and at the second call.

    Of the value, and of the value with its gradient over all numbers of the machine.
    """
    arguments = question.design, question.options(None)

    def value(design, options):
        return answer(design, options, question.quantity).value

    def gradient(design, options):
        return eqx.filter_value_and_grad(value)(design, options)

    found = {}
    for name, function in (("value", value), ("value and gradient", gradient)):
        program = compile_program(function, *arguments)
        run = program.on(*arguments)
        start = time.perf_counter()
        jax.block_until_ready(run())
        first = program.seconds + time.perf_counter() - start
        found[name] = Cost(first, program.timed(*arguments), program.lines)
    return found


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
