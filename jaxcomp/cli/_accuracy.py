"""`jaxcomp accuracy`: error against run time, and a machine at its extremes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

import jaxcomp as jc

from . import _options as opt
from ._arguments import changed_scene
from ._output import Output, Partial
from ._start import quick_compiles, refuse
from ._tables import Markup, by_column, column_table, number_text, row_table

if TYPE_CHECKING:
    from ..study.accuracy._report import Measurement

Study = Literal[
    "orbit", "quantities", "gradient", "response", "film", "cycle", "extremes",
]  # fmt: skip

# The variable of a derivative if none is named.
_VARIABLE = "mechanism.crank_radius"
_FILM = ("friction_number", "stiffness", "damping")
_WITHOUT_EXCITATION = ("film", "cycle", "extremes")


def accuracy(
    *,
    study: Study = "orbit",
    quantity: opt.Quantity = None,
    variable: str | None = None,
    excitation: opt.ExcitationOption = None,
    error: float = 1e-6,
    case: opt.Case,
    thorough: bool = False,
    output: Output,
) -> None:
    """Measure error against run time and name the cheapest setting for an error.

    Errors are relative to a reference on which two independent methods agree; where they differ is
    the floor below which no error is claimed. Times are those of warm calls, compiling apart.

    Example: [bold]jaxcomp accuracy mayekawa-wbhe --quantity loss_power.wall --error 1e-5
    --out result[/bold]

    Args:
        study: orbit: solvers of the periodic state; quantities: all that the machine has, by the
            default solver; gradient: ways to a derivative; response: solvers by number of speeds;
            film: bearings beside Reynolds' equation; cycle: a cylinder with valves at constant speed,
            values and derivatives; extremes: steep rods, near locking, near stall, thin films, stiff
            motors, valves at low speed, with hard springs, light plates and small clearance,
            near-singular responses.
        quantity (NAME): Quantity of which errors are taken, e.g. loss_power.wall, or friction_number,
            stiffness or damping of films; if absent, mechanical_efficiency or what suits the study.
        variable (NAME): Variable of the derivative; mechanism.crank_radius if absent.
        error: Relative error for which the cheapest setting is named.
        thorough: All methods and settings; takes several times as long.
    """
    refuse(not 0 < error < 1, f"--error {error:g}: must be > 0 and < 1")
    without = f"has no meaning with --study {study}"
    unused = excitation is not None and study in _WITHOUT_EXCITATION
    refuse(unused, f"--excitation {excitation}: {without}")
    unused = variable is not None and study != "gradient"
    refuse(unused, f"--variable {variable}: has no meaning without --study gradient")
    refuse(quantity is not None and study == "extremes", f"--quantity {quantity}: {without}")
    from .._core.programs import keep_programs
    from .._core.progress import progress_of
    from ..study import accuracy as work_precision

    quick_compiles()
    keep_programs()  # what is timed is compiled anew all the same
    scene = changed_scene(case.machine, case.sets)
    partial = Partial(output.out, "settings")

    def keep(rows) -> None:
        columns = {}
        for field in ("method", "setting", "error", "seconds", "compile_seconds"):
            columns[field] = list(map(attrgetter(field), rows))
        partial.keep(columns)

    with progress_of("Measuring", unit="settings") as bar:

        def progress(label, number, total):
            bar.at(number, total, f"Measuring {label}")

        if study == "extremes":
            extremes = work_precision.extremes(scene, None, progress)

            def pictures():
                from ..plot._accuracy import extreme_errors

                return {"extremes": extreme_errors(extremes)}

            shown = (
                extremes,
                lambda _: extremes_tables(extremes),
                pictures,
            )
        else:
            if variable is None and study == "gradient" and quantity not in _FILM:
                variable = _VARIABLE
            options = {"variable": variable, "excitation": excitation, "thorough": thorough}
            options |= {"progress": progress, "keep": keep, "error": error}
            report = work_precision.accuracy(scene, quantity, study, **options)

            def pictures():
                from ..plot._accuracy import accuracy_figures

                return accuracy_figures(report, error)

            shown = (
                report,
                lambda _: accuracy_tables(report, error),
                pictures,
            )
    partial.finish()
    output.emit(*shown, scene)


def extremes_tables(extremes: jc.study.accuracy.Extremes) -> Iterator[Any]:
    """Every case, and the status of those without a value."""
    cases = extremes.cases
    rows = []
    for case in cases:
        value = "none"
        speed_error = None
        if case.good:
            value = f"{case.value:.6g}"
            speed_error = case.speed_error
        rows.append(
            {
                "Extreme": case.family,
                "Setting": case.setting,
                "Value": value,
                "Error": number_text(case.error, ".1e"),
                "Speed": number_text(speed_error, ".1e"),
                "Margin": number_text(case.margin, ".3f"),
                "Iter.": case.iterations,
                "Time": _duration(case.seconds),
            }
        )
    title = f"{extremes.scene}: at its extremes"
    yield _tight(column_table(title, by_column(rows), texts=2))
    yield (
        "Values are mechanical efficiencies with the error that an independent march of one revolution "
        "(diffrax) finds, of the efficiency and of the speed; of cycles with valves (low speed, hard "
        "springs, light plates, small clearance) the volumetric efficiency, with the larger difference "
        "of it and the indicated work from a march with located events; of responses the largest "
        "displacement in m and the difference of two linear solvers.\n"
    )
    if extremes.share_with_valves is not None:
        answered, count = extremes.share_with_valves
        yield f"Cycles with valves that are solved, or have no delivery: {answered} of {count}.\n"
    for case in cases:
        if not case.good:
            yield f"{case.family}, {case.setting}: {case.status}.\n"


def accuracy_tables(report: jc.study.accuracy.Report, error: float) -> Iterator[Any]:
    """Every setting, the methods at equal error, orders, and the recommendation."""
    yield _settings(report)
    yield _programs(report)
    if any(len(methods) > 1 for methods in report.tasks.values()):
        yield _side_by_side(report)
    yield _reference(report)
    if report.calls:
        yield _calls(report)
    yield from _remarks(report, error)


def _settings(report: jc.study.accuracy.Report):
    """Error and time of every setting."""
    rows = []
    for row in report.rows:
        rows.append(
            {
                "Method": row.method,
                "Setting": row.setting.replace("tolerance=", "tol="),
                "Error": _error(report, row),
                "Time": _duration(row.seconds),
                "Iter.": row.iterations,
            }
        )
    title = f"{report.scene}: {report.note}"
    return _tight(column_table(title, by_column(rows), texts=2, unbroken=(1,)))


def _programs(report: jc.study.accuracy.Report):
    """Size of the largest program of each method; methods with the same one share a row."""
    programs: dict[tuple, list[str]] = {}
    for method in report.methods:
        sizes = []
        for row in report.rows:
            if row.method == method:
                sizes.append((row.lines or 0, row.flops or 0, row.compile_seconds))
        programs.setdefault(max(sizes), []).append(method)
    rows = []
    for (lines, flops, seconds), methods in programs.items():
        label = ", ".join(methods)
        if len(methods) >= 4:  # all quantities come from one program
            label = f"all {len(methods)}"
        rows.append((label, _duration(seconds), _count(lines or None), _count(flops or None)))
    heads = ("Method", "Compiling", "Lines", "Operations")
    return row_table("Largest program of each method", heads, rows)


def _calls(report: jc.study.accuracy.Report):
    """Times of the first and the second call of the default solver."""
    rows = []
    for name, cost in report.calls.items():
        rows.append((name, _duration(cost.first), _duration(cost.second), cost.lines))
    heads = ("Call", "First", "Second", ("Program, lines", ","))
    return row_table("First and second call of the default solver", heads, rows)


def _reference(report: jc.study.accuracy.Report) -> str:
    reference = report.reference
    if len(report.tasks) == 1:
        return (
            f"{report.quantity}{_value(reference.value)} {report.unit}".rstrip()
            + f" by {reference.methods[0]}; {reference.methods[1]} differs by {reference.floor:.1e}, "
            "below which no error is claimed.\n"
        )
    return (
        f"Each has its own reference ({', beside '.join(reference.methods)}); no error is "
        "claimed below the difference of its two methods.\n"
    )


def _remarks(report: jc.study.accuracy.Report, error: float) -> Iterator[str]:
    """Derivatives, failures, the independent march, and the cheapest settings."""
    if report.derivatives is not None:
        check = report.derivatives
        side = "at most" if check.holds else "more than"
        yield (
            f"At the default options ({check.setting}) derivatives err by {check.gradient:.1e} and "
            f"values by {check.value:.1e}: {check.ratio:.2g} times as much, {side} ten times.\n"
        )
    for why, settings in report.failures.items():
        yield f"Failed: {'; '.join(settings)}: {why.rstrip('.')}.\n"
    if report.march:
        march = report.march
        yield (
            "The default solver by an independent march of one revolution (diffrax): speed off by "
            f"{march['speed']:.1e}, efficiency by {march['mechanical_efficiency']:.1e}, losses by "
            f"{march['losses']:.1e} of the work, peak forces by at most {march['peak_forces']:.1e}.\n"
        )
    for task, methods in report.tasks.items():
        if len(methods) == 1 and len(report.tasks) > 1 and len(report.curve(methods[0])) < 2:
            continue  # nothing to choose from
        best = report.cheapest(error, task=task)
        of_task = f" of {task}" if task else ""
        if best is None:
            yield (
                f"No setting tried holds an error{of_task} of {error:g} together with all tighter "
                "ones.\n"
            )
        else:
            yield (
                f"Cheapest for an error{of_task} of {error:g}: {best.method}, {best.setting}, "
                f"{_duration(best.seconds)}.\n"
            )


def _side_by_side(report: jc.study.accuracy.Report):
    """The time of the fastest method for an error, and the ratio to it of the others."""

    def cells(at: float) -> Iterator[str]:
        for methods in report.tasks.values():
            times = [report.seconds(at, method) for method in methods]
            best = min(filter(None, times), default=None)
            for seconds in times:
                if seconds is None or best is None:
                    yield ""
                elif seconds == best:
                    yield Markup(f"[bold]{_duration(best)}[/bold]")
                else:
                    yield _times(seconds / best)

    columns = {f"{at:.0e}": list(cells(at)) for at in report.reachable}
    methods = list(chain.from_iterable(report.tasks.values()))
    title = "Time for an error of at most ..., and how many times as long other methods take"
    return _tight(column_table(title, {"Method": methods, **columns}))


def _tight(table):
    """Fit a table of many columns into a terminal of 80."""
    table.columns[0].min_width = len("collocation,")
    table.collapse_padding = True
    table.pad_edge = False
    return table


def _count(operations: float | None) -> str:
    if operations is None:
        return ""
    for scale, unit in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if operations >= scale:
            return f"{operations / scale:.3g}{unit}"
    return f"{operations:.0f}"


def _times(ratio: float) -> str:
    return f"{float(f'{ratio:.3g}'):,.6g}x"


def _error(report: jc.study.accuracy.Report, row: Measurement) -> str:
    if not math.isfinite(row.error):
        return "failed"
    floor = report.floor(row)
    if row.error < floor:
        return f"< {floor:.1e}"
    return f"{row.error:.1e}"


def _value(value: Any) -> str:
    import numpy as np

    value = np.asarray(value)
    if value.ndim == 0:
        return f" = {value:.12g}"
    return f", {value.size} values up to {np.max(np.abs(value)):.6g}"


def _duration(seconds: float) -> str:
    if not math.isfinite(seconds):
        return ""
    for scale, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= scale:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds * 1e6:.3g} µs"
