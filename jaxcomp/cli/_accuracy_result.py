"""What `jaxcomp accuracy` prints."""

import math
import os
import platform
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from rich.markup import escape

from ..work_precision import Extreme, Report, Row, SceneCost
from ._tables import _table

# Errors for which methods are set side by side.
_DECADES = tuple(10.0**-n for n in range(2, 13))


def accuracy_result(report: Report, error: float) -> dict[str, Any]:
    """The report in SI units, with the recommendation and the machine it was measured on."""
    best, reference = report.cheapest(error), report.reference
    return {
        "study": report.study,
        "scene": report.scene,
        "quantity": report.quantity,
        "unit": report.unit,
        "reference": {
            "value": _plain(reference.value),
            "other": _plain(reference.other),
            "methods": list(reference.methods),
            "floor": reference.floor,
        },
        "march": report.march,
        "calls": {name: cost._asdict() for name, cost in report.calls.items()},
        "error": error,
        "recommended": None if best is None else _entry(best),
        "recommended_by_task": {
            task: None if (one := report.cheapest(error, task=task)) is None else _entry(one)
            for task in report.tasks
            if task
        },
        "rows": [_entry(row) for row in report.rows],
        "cheapest": {
            f"{at:g}": {method: _time(report, at, method) for method in report.methods}
            for at in _reachable(report)
        },
        "orders": {
            name: {"expected": order.expected, "observed": _finite(order.observed)}
            for name, order in report.orders.items()
        },
        "measured_on": _measured_on(),
    }


def costs_result(costs: Sequence[SceneCost], scene: str) -> dict[str, Any]:
    """What each scene of the ladder costs."""
    return {
        "study": "scenes",
        "scene": scene,
        "rows": [{k: _finite(v) for k, v in cost._asdict().items()} for cost in costs],
        "measured_on": _measured_on(),
    }


def costs_tables(costs: Sequence[SceneCost], scene: str) -> Iterator[Any]:
    """A row a scene, and how operations and loops are counted."""
    heads = ("Scene", "Operations", "Loops", "Compiling", "Time", "Memory")
    table = _table(escape(f"{scene}: what each part costs"), *heads, numbers=True)
    for column in table.columns[1:]:
        column.no_wrap = True  # the names give way on a narrow terminal
    for cost in costs:
        memory = "" if cost.memory is None else f"{cost.memory / 1e3:,.1f} kB"
        table.add_row(
            cost.name,
            f"{cost.flops:,.0f}",
            str(cost.loops),
            _duration(cost.compile_seconds),
            _duration(cost.seconds),
            memory,
        )
    yield table
    yield "Operations are those of the compiled program, the body of a loop counted once.\n"


def extremes_result(cases: Sequence[Extreme], scene: str) -> dict[str, Any]:
    """What the solvers give at the extremes of a machine."""
    return {
        "study": "extremes",
        "scene": scene,
        "rows": [{k: _finite(v) for k, v in case._asdict().items()} for case in cases],
        "measured_on": _measured_on(),
    }


def extremes_tables(cases: Sequence[Extreme], scene: str) -> Iterator[Any]:
    """A row a case, and what the solvers say of those without a value."""
    heads = ("Extreme", "Setting", "Value", "Error", "Speed", "Margin", "Iter.", "Time")
    table = _table(escape(f"{scene}: at its extremes"), *heads, numbers=True)
    table.columns[1].justify = "left"
    _tight(table)
    for case in cases:
        table.add_row(
            case.family,
            case.setting,
            f"{case.value:.6g}" if case.good else "none",
            f"{case.error:.1e}" if math.isfinite(case.error) else "",
            "" if case.speed_error is None or not case.good else f"{case.speed_error:.1e}",
            "" if case.margin is None else f"{case.margin:.3f}",
            "" if case.iterations is None else str(case.iterations),
            _duration(case.seconds),
        )
    yield table
    yield (
        "Values are mechanical efficiencies with the error that an independent march of one revolution "
        "(diffrax) finds, of the efficiency and of the speed; of responses the largest displacement in m "
        "and the difference of two linear solvers.\n"
    )
    for case in cases:
        if not case.good:
            yield f"{case.family}, {case.setting}: {case.status}.\n"


def accuracy_tables(report: Report, error: float) -> Iterator[Any]:
    """Every setting, the methods at equal error, orders, and the recommendation."""
    reference = report.reference
    title = escape(f"{report.scene}: {report.note}")
    columns: list[tuple[str, list[str]]] = [
        ("Method", [row.method for row in report.rows]),
        ("Setting", [row.setting.replace("tolerance=", "tol=") for row in report.rows]),
        ("Error", [_error(report, row) for row in report.rows]),
        ("Time", [_duration(row.seconds) for row in report.rows]),
        ("Passes", ["" if row.passes is None else str(row.passes) for row in report.rows]),
    ]
    columns = [(head, cells) for head, cells in columns if any(cells)]
    table = _table(title, *(head for head, _ in columns), numbers=True)
    table.columns[1].justify = "left"
    table.columns[1].no_wrap = True
    _tight(table)
    for cells in zip(*(cells for _, cells in columns), strict=True):
        table.add_row(*cells)
    yield table
    yield _programs(report)
    if report.orders:
        orders = _table(None, "Method", "Order", "Observed", numbers=True)
        for name, order in report.orders.items():
            orders.add_row(name, str(order.expected), f"{order.observed:.2f}")
        yield orders
    elif any(len(methods) > 1 for methods in report.tasks.values()):
        yield _side_by_side(report)
    if len(report.tasks) == 1:
        yield (
            f"{report.quantity}{_value(reference.value)} {report.unit}".rstrip()
            + f" by {reference.methods[0]}; {reference.methods[1]} differs by {reference.floor:.1e}, "
            "below which no error is claimed.\n"
        )
    else:
        yield (
            f"Each is judged by its own reference ({', beside '.join(reference.methods)}); no error is "
            "claimed below what its two methods differ by.\n"
        )
    if report.calls:
        calls = _table("What a user waits for, by the default solver", "Call", "First", "Second",
                       "Program, lines", numbers=True)  # fmt: skip
        for name, cost in report.calls.items():
            calls.add_row(name, _duration(cost.first), _duration(cost.second), f"{cost.lines:,}")
        yield calls
    for why, settings in report.failures.items():
        yield f"Failed: {'; '.join(settings)}: {why}.\n"
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


def _measured_on() -> dict[str, Any]:
    versions = {name: version(name) for name in ("jax", "diffrax", "scipy", "jaxcomp")}
    return {
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        **versions,
    }


def _side_by_side(report: Report):
    """The time of the fastest method for an error, and how many times as long the others take."""
    errors = _reachable(report)
    fastest = {
        (at, task): min((t for m in methods if (t := _time(report, at, m))), default=None)
        for at in errors
        for task, methods in report.tasks.items()
    }
    title = "Time for an error of at most ..., and how many times as long other methods take"
    table = _table(title, "Method", *(f"{at:.0e}" for at in errors), numbers=True)
    _tight(table)
    for task, methods in report.tasks.items():
        for method in methods:
            cells = []
            for at in errors:
                own, best = _time(report, at, method), fastest[at, task]
                first = "" if best is None else f"[bold]{_duration(best)}[/bold]"
                cells.append("" if own is None else first if own == best else _times(own / best))
            table.add_row(method, *cells)
    return table


def _programs(report: Report):
    """What compiling takes, and how large the largest program of each method is."""
    heads = ("Method", "Compiling", "Lines", "Operations")
    table = _table("Largest program of each method", *heads, numbers=True)
    for method in report.methods:
        rows = [row for row in report.rows if row.method == method]
        row = max(rows, key=lambda row: (row.lines or 0, row.flops or 0, row.compile_seconds))
        counts = ("" if x is None else _count(x) for x in (row.lines, row.flops))
        table.add_row(method, _duration(row.compile_seconds), *counts)
    return table


def _tight(table) -> None:
    """Fit a table of many columns into a terminal of 80."""
    table.columns[0].min_width = len("collocation,")
    table.collapse_padding, table.pad_edge = True, False


def _count(operations: float) -> str:
    for scale, unit in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if operations >= scale:
            return f"{operations / scale:.3g}{unit}"
    return f"{operations:.0f}"


def _times(ratio: float) -> str:
    return f"{float(f'{ratio:.3g}'):,.6g}x"


def _reachable(report: Report) -> list[float]:
    return [at for at in _DECADES if report.cheapest(at) is not None]


def _time(report: Report, error: float, method: str) -> float | None:
    best = report.cheapest(error, method)
    return None if best is None else best.seconds


def _entry(row: Row) -> dict[str, Any]:
    return {key: _finite(value) for key, value in row._asdict().items()}


def _finite(value):
    return value if not isinstance(value, float) or math.isfinite(value) else None


def _error(report: Report, row: Row) -> str:
    if not math.isfinite(row.error):
        return "failed"
    floor = report.floor(row)
    return f"< {floor:.1e}" if row.error < floor else f"{row.error:.1e}"


def _plain(value: Any) -> Any:
    """Numbers for JSON; of complex ones the magnitudes."""
    value = np.asarray(value)
    return (np.abs(value) if np.iscomplexobj(value) else value).tolist()


def _value(value: Any) -> str:
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
