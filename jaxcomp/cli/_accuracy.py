"""`jaxcomp accuracy`: error against run time, and the cost of each part of a scene."""

import enum
import math
import os
import platform
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._arguments import changed_scene
from ._completion import complete_quantity
from ._errors import CommandError, reports_errors
from ._options import AsJson, ExcitationOption, Machine, Out, Sets
from ._output import show_results, write_results
from ._start import quick_compiles
from ._tables import column_table

if TYPE_CHECKING:
    from ..work_precision import Extreme, Measurement, Report, SceneCost


class Study(enum.StrEnum):
    """Kind of study."""

    orbit = "orbit"
    quantities = "quantities"
    gradient = "gradient"
    simulate = "simulate"
    response = "response"
    film = "film"
    order = "order"
    cylinders = "cylinders"
    cycle = "cycle"
    scenes = "scenes"
    extremes = "extremes"


# The variable of a derivative if none is named.
_VARIABLE = "mechanism.crank_radius"
_FILM = ("friction_number", "stiffness", "damping")
_WITHOUT_EXCITATION = (
    Study.scenes,
    Study.film,
    Study.order,
    Study.cylinders,
    Study.cycle,
    Study.extremes,
    Study.simulate,
)
# Errors at which methods are compared.
_DECADES = tuple(10.0**-n for n in range(2, 13))


@reports_errors
def accuracy(
    machine: Machine,
    study: Annotated[
        Study,
        typer.Option(
            help="orbit: solvers of the periodic state; quantities: all that the machine has, by the "
            "default solver; gradient: ways to a derivative; simulate: methods in time; response: "
            "solvers by number of speeds; film: bearings beside Reynolds' equation; order: fixed steps "
            "of diffrax; cylinders: one to eight on one crank; cycle: a cylinder with valves at constant "
            "speed, values and derivatives; scenes: cost of each part of the machine; "
            "extremes: steep rods, near locking, near stall, thin films, stiff motors, near-singular "
            "responses."
        ),
    ] = Study.orbit,
    quantity: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Quantity of which errors are taken, e.g. loss_power.wall, or friction_number, "
            "stiffness or damping of films; if absent, mechanical_efficiency or what suits the study.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    variable: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=f"Variable of the derivative; {_VARIABLE} if absent."),
    ] = None,
    excitation: ExcitationOption = None,
    error: Annotated[
        float, typer.Option(help="Relative error for which the cheapest setting is named.")
    ] = 1e-6,
    sets: Sets = None,
    thorough: Annotated[
        bool,
        typer.Option("--thorough", help="All methods and settings; takes several times as long."),
    ] = False,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Measure error against run time and name the cheapest setting for an error.

    Errors are relative to a reference on which two independent methods agree; where they differ is
    the floor below which no error is claimed. Times are those of warm calls, compiling apart.

    Example: [bold]jaxcomp accuracy mayekawa-wbhe --quantity loss_power.wall --error 1e-5
    --out result[/bold]
    """
    if not 0 < error < 1:
        raise CommandError(f"--error {error:g}: must be > 0 and < 1")
    without = f"has no meaning with --study {study}"
    if excitation is not None and study in _WITHOUT_EXCITATION:
        raise CommandError(f"--excitation {excitation}: {without}")
    if variable is not None and study is not Study.gradient:
        raise CommandError(f"--variable {variable}: has no meaning without --study gradient")
    if quantity is not None and study in (Study.scenes, Study.extremes):
        raise CommandError(f"--quantity {quantity}: {without}")
    from .. import plot, work_precision
    from .._waits import progress_of, spinner

    quick_compiles()  # nothing is kept, so that compile times are those of a first call
    scene = changed_scene(machine, sets or (), ())
    with progress_of("Measuring", unit="settings") as bar:

        def progress(label, number, total):
            bar.at(number, total, f"Measuring {label}")

        if study is Study.scenes:
            costs = work_precision.scene_costs(work_precision.lean_scenes(scene), progress)
            result, tables = (
                rows_result("scenes", scene.name, costs),
                costs_tables(costs, scene.name),
            )
        elif study is Study.extremes:
            cases = work_precision.extremes(scene, None, progress)
            result = rows_result("extremes", scene.name, cases)
            tables = extremes_tables(cases, scene.name)
        else:
            if variable is None and study is Study.gradient and quantity not in _FILM:
                variable = _VARIABLE
            report = work_precision.accuracy(
                scene,
                quantity,
                study.value,
                variable=variable,
                excitation=None if excitation is None else excitation.value,
                thorough=thorough,
                progress=progress,
            )
            result, tables = accuracy_result(report, error), accuracy_tables(report, error)
    tables = list(tables)
    if out is not None:
        with spinner("Drawing ..."):
            if study is Study.scenes:
                figures = {"scenes": plot.scene_cost_bars(costs, scene.name)}
            elif study is Study.extremes:
                figures = {"extremes": plot.extreme_errors(cases, scene.name)}
            else:
                figures = plot.accuracy_figures(report, error)
            write_results(out, figures, result, scene, tables)
    show_results(result, tables, as_json, out)


def accuracy_result(report: "Report", error: float) -> dict[str, Any]:
    """The report in SI units, with the recommendation and the machine it was measured on."""
    from ._json import plain

    reference = report.reference
    return plain(
        {
            "study": report.study,
            "scene": report.scene,
            "quantity": report.quantity,
            "unit": report.unit,
            "reference": reference._asdict() | {"floor": reference.floor},
            "march": report.march,
            "calls": {name: cost._asdict() for name, cost in report.calls.items()},
            "error": error,
            "recommended": _entry(report.cheapest(error)),
            "recommended_by_task": {
                task: _entry(report.cheapest(error, task=task)) for task in report.tasks if task
            },
            "rows": [_entry(row) for row in report.rows],
            "cheapest": {
                f"{at:g}": {method: _time(report, at, method) for method in report.methods}
                for at in _reachable(report)
            },
            "orders": {name: order._asdict() for name, order in report.orders.items()},
            "by_cylinders": {name: growth._asdict() for name, growth in report.growth.items()},
            "derivatives": _checked(report),
            "measured_on": _measured_on(),
        }
    )


def rows_result(study: str, scene: str, rows: Sequence[Any]) -> dict[str, Any]:
    """Scene costs or extreme cases with the machine they were measured on."""
    from ._json import plain

    rows = [row._asdict() for row in rows]
    return plain({"study": study, "scene": scene, "rows": rows, "measured_on": _measured_on()})


def costs_tables(costs: Sequence["SceneCost"], scene: str) -> Iterator[Any]:
    """Cost of each scene, and how operations and loops are counted."""

    table = column_table(
        f"{scene}: cost of each part",
        {
            "Scene": [cost.name for cost in costs],
            "Operations": [f"{cost.flops:,.0f}" for cost in costs],
            "Loops": [cost.loops for cost in costs],
            "Compiling": [_duration(cost.compile_seconds) for cost in costs],
            "Time": [_duration(cost.seconds) for cost in costs],
            "Memory": [c.memory is not None and f"{c.memory / 1e3:,.1f} kB" for c in costs],
        },
    )
    for column in table.columns[1:]:
        column.no_wrap = True  # the names give way on a narrow terminal
    yield table
    yield "Operations are those of the compiled program, the body of a loop counted once.\n"


def extremes_tables(cases: Sequence["Extreme"], scene: str) -> Iterator[Any]:
    """Every case, and the status of those without a value."""

    def numbers(values, form):
        return [v is not None and math.isfinite(v) and f"{v:{form}}" for v in values]

    table = column_table(
        f"{scene}: at its extremes",
        {
            "Extreme": [case.family for case in cases],
            "Setting": [case.setting for case in cases],
            "Value": [f"{case.value:.6g}" if case.good else "none" for case in cases],
            "Error": numbers((case.error for case in cases), ".1e"),
            "Speed": numbers((case.speed_error if case.good else None for case in cases), ".1e"),
            "Margin": numbers((case.margin for case in cases), ".3f"),
            "Iter.": [case.iterations for case in cases],
            "Time": [_duration(case.seconds) for case in cases],
        },
        texts=2,
    )
    yield _tight(table)
    yield (
        "Values are mechanical efficiencies with the error that an independent march of one revolution "
        "(diffrax) finds, of the efficiency and of the speed; of responses the largest displacement in m "
        "and the difference of two linear solvers.\n"
    )
    for case in cases:
        if not case.good:
            yield f"{case.family}, {case.setting}: {case.status}.\n"


def accuracy_tables(report: "Report", error: float) -> Iterator[Any]:
    """Every setting, the methods at equal error, orders, and the recommendation."""

    reference, rows = report.reference, report.rows
    table = column_table(
        f"{report.scene}: {report.note}",
        {
            "Method": [row.method for row in rows],
            "Setting": [row.setting.replace("tolerance=", "tol=") for row in rows],
            "Error": [_error(report, row) for row in rows],
            "Time": [_duration(row.seconds) for row in rows],
            "Iter.": [row.iterations for row in rows],
        },
        texts=2,
    )
    table.columns[1].no_wrap = True
    yield _tight(table)
    largest = [
        max((row for row in rows if row.method == method),
            key=lambda row: (row.lines or 0, row.flops or 0, row.compile_seconds))
        for method in report.methods
    ]  # fmt: skip
    yield column_table(
        "Largest program of each method",
        {
            "Method": report.methods,
            "Compiling": [_duration(row.compile_seconds) for row in largest],
            "Lines": [_count(row.lines) for row in largest],
            "Operations": [_count(row.flops) for row in largest],
        },
        keep=True,
    )
    if report.orders:
        yield column_table(
            None,
            {
                "Method": list(report.orders),
                "Order": [order.expected for order in report.orders.values()],
                "Observed": [f"{order.observed:.2f}" for order in report.orders.values()],
            },
        )
    elif any(len(methods) > 1 for methods in report.tasks.values()):
        yield _side_by_side(report)
    if report.growth:
        yield _growth(report)
    if len(report.tasks) == 1:
        yield (
            f"{report.quantity}{_value(reference.value)} {report.unit}".rstrip()
            + f" by {reference.methods[0]}; {reference.methods[1]} differs by {reference.floor:.1e}, "
            "below which no error is claimed.\n"
        )
    else:
        yield (
            f"Each has its own reference ({', beside '.join(reference.methods)}); no error is "
            "claimed below the difference of its two methods.\n"
        )
    if report.calls:
        yield column_table(
            "First and second call of the default solver",
            {
                "Call": list(report.calls),
                "First": [_duration(cost.first) for cost in report.calls.values()],
                "Second": [_duration(cost.second) for cost in report.calls.values()],
                "Program, lines": [f"{cost.lines:,}" for cost in report.calls.values()],
            },
        )
    if report.derivatives is not None:
        check = report.derivatives
        yield (
            f"At the default options ({check.setting}) derivatives err by {check.gradient:.1e} and "
            f"values by {check.value:.1e}: {check.ratio:.2g} times as much, "
            f"{'at most' if check.holds else 'more than'} ten times.\n"
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
        best, of = report.cheapest(error, task=task), f" of {task}" if task else ""
        if best is None:
            yield f"No setting tried holds an error{of} of {error:g} together with all tighter ones.\n"
        else:
            yield (
                f"Cheapest for an error{of} of {error:g}: {best.method}, {best.setting}, "
                f"{_duration(best.seconds)}.\n"
            )


def _growth(report: "Report"):
    """Time of a call over the number of cylinders, what each adds, and the compiling beside it."""
    counts = next(iter(report.growth.values())).seconds
    columns = {
        f"{count}": [_duration(one.seconds[count]) for one in report.growth.values()]
        for count in counts
    }
    few, many = min(counts), max(counts)
    compiling = [
        _times(one.compile_seconds[many] / one.compile_seconds[few])
        for one in report.growth.values()
    ]
    each = [_duration(max(one.each, 0.0)) for one in report.growth.values()]
    more = {"A cylinder more": each, f"Compiling, {many} to {few}": compiling}
    title = "Time of a call by number of cylinders"
    return column_table(title, {"Setting": list(report.growth), **columns, **more})


def _side_by_side(report: "Report"):
    """The time of the fastest method for an error, and the ratio to it of the others."""

    def cells(at):
        for methods in report.tasks.values():
            times = [_time(report, at, method) for method in methods]
            best = min((t for t in times if t), default=None)
            for own in times:
                first = "" if best is None else f"[bold]{_duration(best)}[/bold]"
                yield "" if own is None else first if own == best else _times(own / best)

    columns = {f"{at:.0e}": list(cells(at)) for at in _reachable(report)}
    methods = [method for methods in report.tasks.values() for method in methods]
    title = "Time for an error of at most ..., and how many times as long other methods take"
    return _tight(column_table(title, {"Method": methods, **columns}))


def _measured_on() -> dict[str, Any]:
    from importlib.metadata import version

    versions = {name: version(name) for name in ("jax", "diffrax", "scipy", "jaxcomp")}
    load, python = os.getloadavg()[0], platform.python_version()
    return {"cores": os.cpu_count(), "load": load, "python": python, **versions}


def _tight(table):
    """Fit a table of many columns into a terminal of 80."""
    table.columns[0].min_width = len("collocation,")
    table.collapse_padding, table.pad_edge = True, False
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


def _reachable(report: "Report") -> list[float]:
    return [at for at in _DECADES if report.cheapest(at) is not None]


def _time(report: "Report", error: float, method: str) -> float | None:
    best = report.cheapest(error, method)
    return None if best is None else best.seconds


def _entry(row: "Measurement | None") -> dict[str, Any] | None:
    return None if row is None else row._asdict()


def _checked(report: "Report") -> dict[str, Any] | None:
    check = report.derivatives
    return check and check._asdict() | {"ratio": check.ratio, "holds": check.holds}


def _error(report: "Report", row: "Measurement") -> str:
    if not math.isfinite(row.error):
        return "failed"
    floor = report.floor(row)
    return f"< {floor:.1e}" if row.error < floor else f"{row.error:.1e}"


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
