r"""`accuracy`: error against run time of the solvers of a quantity."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import equinox as eqx
import jax

from ..._core.errors import BadInput
from ...crank import solve_orbit
from ...machine import HasMachine, Machine, machine_of
from ...rotor import LoadCase
from .._analysis import quantity_named
from ._cycle_study import cycle_study
from ._gradient import gradient_study
from ._orbit_study import orbit_study, quantities_study
from ._report import Cost, Measurement, Report
from ._rotor_study import FILM_QUANTITIES, film_study, response_study
from ._study import ROTOR_QUANTITIES, Program, Question, Study, answer, measured


class StudyKind(NamedTuple):
    """A kind of study.

    Attributes:
        name: of the study.
        make: from question and thoroughness to the study.
        quantity: of which the errors are, if none is named.
        unit: of that quantity where it is the only one; `None` where others may be named.
        varies: whether a variable may be named.
        variable: the one that is taken if none is named.
        needs: part that the machine must have.
        verified: whether an independent integration verifies the default solver of the crank.
    """

    name: str
    make: Callable[[Question, bool], Study]
    quantity: str = "mechanical_efficiency"
    unit: str | None = None
    varies: bool = False
    variable: str | None = None
    needs: Literal["crank", "rotor"] | None = None
    verified: bool = False


_KINDS = (
    StudyKind("orbit", orbit_study, needs="crank", verified=True),
    StudyKind("quantities", quantities_study, "all", "", needs="crank", verified=True),
    StudyKind("gradient", gradient_study, varies=True, verified=True),
    StudyKind("response", response_study, "displacement", "m", needs="rotor"),
    StudyKind("film", film_study, "friction_number"),
    StudyKind("cycle", cycle_study, "all", "", needs="crank"),
)
STUDIES = {kind.name: kind for kind in _KINDS}


def accuracy(
    scene: Machine | HasMachine,
    quantity_name: str | None = None,
    study: str | StudyKind = "orbit",
    *,
    variable: str | None = None,
    excitation: Literal["crank", "file"] | None = None,
    thorough: bool = False,
    error: float = 1e-6,
    progress: Callable[[str, int, int], None] | None = None,
    keep: Callable[[Sequence[Measurement]], None] | None = None,
) -> Report:
    """Measure error against run time.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        quantity_name: of which the errors are, see `quantity_named`; for films one of
            "friction_number", "stiffness" and "damping". Absent: what suits the study.
        study: a name of `STUDIES`, or a kind of study of your own.
        variable: to differentiate by, for the study of gradients; any name of
            `jaxcomp.study.variable`.
        excitation: forces on the rotor, for its quantities: those of the crank's periodic state or
            those of the scene. Absent: the crank where the scene joins it to the rotor, so that the
            solver of the crank has a part in the answer.
        thorough: all methods and settings instead of the more instructive ones.
        error: [-] relative, for which the cheapest setting is named.
        progress: called before each setting with its name, its number and how many there are.
        keep: called after each setting with all that are measured.

    Returns:
        Every setting with its error and time, the reference, and, for studies of the crank, the errors
        of the default solver by an independent integration of one revolution, and the time of its
        first calls.

    Raises:
        BadInput: an unknown study, quantity or variable, one that the scene does not have, or one
            that nothing in the study changes.
    """
    if not isinstance(study, StudyKind):
        if study not in STUDIES:
            raise BadInput("study", study, f"one of {', '.join(STUDIES)}")
        study = STUDIES[study]
    kind = study
    design = machine_of(scene)
    name = quantity_name or kind.quantity
    if kind.unit is not None and name != kind.quantity:
        raise BadInput("quantity", name, f"'{kind.quantity}' for the study '{kind.name}'")
    of_film = kind.name in ("film", "gradient") and name in FILM_QUANTITIES
    unit = _unit(kind, name, of_film)
    if variable is not None and (not kind.varies or of_film):
        raise BadInput("variable", variable, f"absent for the study '{kind.name}' of {name}")
    if excitation is None:
        excitation = _excitation(design, name, kind)
    question = Question(
        design=design,
        quantity=name,
        variable=variable or kind.variable,
        excitation=excitation,
    )
    _check_parts(question, kind)
    plan = kind.make(question, thorough)
    progress = progress or (lambda label, number, total: None)
    total = len(plan.settings) + 1
    verified = kind.verified and design.compressor is not None and not of_film
    progress("reference", 0, total)
    calls = {}
    if verified and kind.name != "quantities":
        calls = _first_calls(question)
    reference = plan.reference()
    rows = []
    for number, setting in enumerate(plan.settings, 1):
        progress(f"{setting.method}, {setting.label}", number, total)
        rows.append(measured(setting, reference))
        if keep is not None:
            keep(rows)
    march = {}
    if verified:
        march = _verification(question)
    report = Report(
        study=kind.name,
        scene=getattr(scene, "name", "design"),
        quantity=plan.name or name,
        unit=unit if plan.unit is None else plan.unit,
        reference=reference,
        rows=tuple(rows),
        note=plan.note,
        march=march,
        calls=calls,
        error=error,
    )
    return replace(report, **plan.findings(rows, reference))


def _unit(kind: StudyKind, quantity_name: str, of_film: bool) -> str:
    """SI unit of the quantity of which the errors are."""
    if kind.unit is not None:
        return kind.unit
    if of_film:
        return ""
    return quantity_named(quantity_name).unit


def _check_parts(question: Question, kind: StudyKind) -> None:
    """Raise unless the machine has what the study needs."""
    assembly = question.assembly
    lacks = ""
    if kind.needs == "crank" and assembly.compressor is None:
        lacks = "one that a machine without compressor has, such as 'response'"
    if kind.needs == "rotor" and None in (assembly.rotor, assembly.loads, assembly.balancing):
        lacks = "one that the machine has: it needs a rotor with its planes"
    if lacks:
        raise BadInput("study", kind.name, lacks)


def _excitation(
    design: Machine, name: str, kind: StudyKind | None = None
) -> Literal["crank", "file"] | None:
    """Forces on the rotor if none are named; `None` for quantities of the crank."""
    of_rotor = name.partition(".")[0] in ROTOR_QUANTITIES
    if kind is not None:
        of_rotor |= kind.needs == "rotor" or kind.name == "quantities"
    case = design.parts.get("loads")
    if not of_rotor or not isinstance(case, LoadCase):
        return None
    if case.crank is not None and design.compressor is not None:
        return "crank"
    return "file"


def _first_calls(question: Question) -> dict[str, Cost]:
    """Times of the first and the second call of the default solver.

    Of the value, and of the value with its gradient over all numbers of the machine.
    """
    arguments = question.design, question.options(None)

    def value(design, options):
        return answer(design, options, question.quantity).value

    def gradient(design, options):
        return eqx.filter_value_and_grad(value)(design, options)

    costs = {}
    for name, function in (("value", value), ("value and gradient", gradient)):
        program = Program(function, *arguments)
        start = time.perf_counter()
        jax.block_until_ready(program(*arguments))
        first = program.seconds + time.perf_counter() - start
        costs[name] = Cost(first, program.timed(*arguments), program.lines)
    return costs


def _verification(question: Question) -> dict[str, float]:
    """Errors of the default solver by an independent integration of one revolution."""
    orbit = solve_orbit(question.crank, question.default_solver, verify=True)
    march = orbit.verification
    assert march is not None
    # Losses over the work of the motor, or over themselves where it has none to speak of.
    work = max(abs(float(orbit.energy.motor_work)), float(orbit.energy.total_loss)) or 1.0
    peaks = []
    for name, error in march.peak_error.items():
        peaks.append(abs(float(error)) / (float(orbit.peak_forces[name]) or 1.0))
    return {
        "speed": float(march.speed_error),
        "mechanical_efficiency": abs(float(march.efficiency_error)),
        "losses": sum(abs(float(e)) for e in march.loss_error.values()) / work,
        "peak_forces": max(peaks),
    }
