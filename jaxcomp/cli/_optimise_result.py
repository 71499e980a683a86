"""Results of `jaxcomp optimise`: JSON, tables, and the scene as optimised."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from rich.markup import escape

from .._shown import shown
from ..design import Front, Optimum, compared, quantity
from ..design._design import CORRECTIONS
from ..scene import Scene, with_machine
from ._compare_result import beside_table
from ._tables import _table
from ._tables import words as _words


def optimised_scene(scene: Scene, optimum: Optimum) -> tuple[Scene, list[str]]:
    """The scene with the best design.

    Returns:
        The scene, and the variables that a scene file does not have (correction masses).
    """
    source = f"optimised for {optimum.objective_name}"
    names = [one.name for one in optimum.problem.variables]
    left = [name for name in names if name.split(".")[0] == CORRECTIONS]
    return with_machine(scene, optimum.design, source), left


def optimum_result(scene: Scene, asked: dict[str, Any], found: Optimum, seconds: float) -> dict:
    """JSON of an optimum."""
    problem, sample = found.problem, found.sample
    low, high = (np.asarray(end).tolist() for end in (found.ranges.low, found.ranges.high))
    present = np.asarray(problem.current).tolist()
    now = np.flatnonzero(np.all(sample.values == np.array(present), axis=1))
    before = float(sample.objective[now[0]]) if now.size and sample.ok[now[0]] else None
    units = dict(zip(problem.names, problem.units, strict=True))
    variables = [
        {
            "name": one.name, "unit": one.unit, "low": low[i], "high": high[i],
            "present": present[i], "value": found.values[one.name],
            "gradient": found.gradient[one.name], "at_bound": found.at_bound.get(one.name),
        }
        for i, one in enumerate(problem.variables)
    ]  # fmt: skip
    best = None if sample.best is None else float(sample.objective[sample.best])
    return _finite({
        "machine": scene.name,
        "asked": asked,
        "variables": variables,
        "objective": {
            "name": found.objective_name, "unit": units.get(found.objective_name, ""),
            "maximised": found.maximised, "present": before, "value": found.objective,
        },
        "quantities": found.quantities,
        "constraints": [
            one._asdict() | {"unit": units[one.name]} for one in found.constraints
        ],
        "status": found.status,
        "feasible": found.feasible,
        "stationarity": found.stationarity,
        "verdict": found.verdict,
        "local": found.local,
        "agreeing": found.agreeing,
        "starts": [one._asdict() for one in found.starts],
        "sample": {
            "count": len(sample.ok), "solved": int(sample.ok.sum()),
            "feasible": int(sample.feasible.sum()), "best_objective": best,
        },
        "evaluations": found.evaluations,
        "seconds": seconds,
    })  # fmt: skip


def comparison(found: Optimum) -> list[dict[str, Any]]:
    """Losses, forces and dimensions of the present design beside the optimum, where there is a crank.

    Objectives that need no periodic state are compared by themselves.
    """
    problem = found.problem
    crank = (not isinstance(q, str) or "orbit" in quantity(q).needs for q in problem.quantities)
    if problem.design.compressor is None or not any(crank):
        return []
    rows = compared(problem.design, found.design, problem.options)
    return [
        {"name": one.name, "unit": one.unit, "present": one.before, "optimum": one.after}
        for one in rows
    ]


def front_result(scene: Scene, asked: dict[str, Any], front: Front, seconds: float) -> dict:
    """JSON of a front."""
    points = [
        {
            "values": dict(zip(front.variables, front.values[i].tolist(), strict=True)),
            "objectives": dict(zip(front.names, front.objectives[i].tolist(), strict=True)),
            "exchange": front.exchange[i], "status": front.status[i],
            "dominated": bool(front.dominated[i]),
        }
        for i in range(len(front.values))
    ]  # fmt: skip
    units = [one.unit for one in front.ends[0].problem.variables]
    return _finite({
        "machine": scene.name,
        "asked": asked,
        "objectives": [
            {"name": n, "unit": u, "maximised": m}
            for n, u, m in zip(front.names, front.units, front.maximised, strict=True)
        ],
        "variables": [
            {"name": n, "unit": u} for n, u in zip(front.variables, units, strict=True)
        ],
        "present": dict(zip(front.names, front.present.tolist(), strict=True)),
        "points": points,
        "beaten_by": front.beaten_by,
        "verdicts": [end.verdict for end in front.ends],
        "sample": {"count": len(front.ends[0].sample.ok), "feasible": len(front.sample)},
        "evaluations": front.evaluations,
        "seconds": seconds,
    })  # fmt: skip


def optimum_tables(result: dict[str, Any]) -> list:
    """Variables, objective, constraints, starts, evidence."""
    goal = result["objective"]
    way = (
        "met targets"
        if goal["name"] == "residuals"
        else ("highest" if goal["maximised"] else "lowest")
    )
    title = escape(f"{result['machine']}: {way} {_words(goal['name']).lower()}")
    table = _table(title, "", "Present", "Optimum", "Range", "")
    for one in result["variables"]:
        unit = one["unit"]
        ends = f"{_shown(one['low'], unit)} to {_shown(one['high'], unit)}"
        note = f"on its {one['at_bound']} bound" if one["at_bound"] else ""
        table.add_row(escape(one["name"]), _shown(one["present"], unit),
                      f"[bold]{_shown(one['value'], unit)}", ends, note)  # fmt: skip
    before = "" if goal["present"] is None else _shown(goal["present"], goal["unit"], 6)
    table.add_row(
        _words(goal["name"]), before, f"[bold]{_shown(goal['value'], goal['unit'], 6)}", "", ""
    )
    tables = [table]
    if result.get("comparison"):
        rows = [{**one, "values": [one["present"], one["optimum"]]} for one in result["comparison"]]
        tables.append(beside_table(rows, ["Present", "Optimum"]))
    if result["constraints"]:
        table = _table(None, "Constraint", "Value", "Bound", "", "Objective per unit of the bound")
        for one in result["constraints"]:
            sign = {"upper": "<=", "lower": ">=", "equal": "="}[one["side"]]
            state = "broken" if one["violation"] else ("active" if one["active"] else "slack")
            per = f"{one['multiplier']:.4g} per {one['unit'] or 'one'}" if one["active"] else ""
            table.add_row(escape(one["name"]), _shown(one["value"], one["unit"]),
                          f"{sign} {_shown(one['bound'], one['unit'])}", state, per)  # fmt: skip
        tables.append(table)
    table = _table(None, "Start", "Objective", "Designs solved", "Ended", "")
    for one in result["starts"]:
        units = [v["unit"] for v in result["variables"]]
        begun = ", ".join(_shown(x, u) for x, u in zip(one["start"], units, strict=True))
        same = "at the optimum" if one["agrees"] else "elsewhere"
        value = "" if one["objective"] is None else _shown(one["objective"], goal["unit"], 6)
        table.add_row(begun, value, str(one["steps"]), one["status"], same)
    tables.append(table)
    table = _table(None, "Evidence", "")
    table.add_row("Ended", result["status"])
    table.add_row("Slope left", f"{result['stationarity'] or 0:.1e} of the objective's spread")
    table.add_row("Compared", result["verdict"])
    table.add_row("Starts that agree", f"{result['agreeing']} of {len(result['starts'])}")
    count = f"{result['evaluations']} with derivatives, {result['sample']['count']} in the sample"
    table.add_row("Designs solved", count)
    table.add_row("Time", f"{result['seconds']:.1f} s")
    return [*tables, table]


def front_tables(result: dict[str, Any]) -> list:
    """The points of the front, and the evidence."""
    first, second = result["objectives"]
    names = [one["name"] for one in result["variables"]]
    title = f"{result['machine']}: {_words(first['name'])} against {_words(second['name']).lower()}"
    heads = [_words(first["name"]), _words(second["name"]), *names, "Exchange", ""]
    table = _table(escape(title), *heads)
    for point in result["points"]:
        row = [_shown(point["objectives"][o["name"]], o["unit"], 6) for o in (first, second)]
        row += [_shown(point["values"][v["name"]], v["unit"]) for v in result["variables"]]
        exchange = "" if point["exchange"] is None else f"{point['exchange']:.3g}"
        table.add_row(*row, exchange, "dominated" if point["dominated"] else point["status"])
    now = [result["present"][o["name"]] for o in (first, second)]
    if None not in now:
        texts = [_shown(x, o["unit"], 6) for x, o in zip(now, (first, second), strict=True)]
        table.add_section()
        table.add_row(*texts, *[""] * len(names), "", "present design")
    evidence = _table(None, "Evidence", "")
    count = sum(p["dominated"] for p in result["points"])
    evidence.add_row("Dominated points", str(count))
    beaten = f"{result['beaten_by']} of {result['sample']['feasible']}"
    evidence.add_row("Samples better than the front", beaten)
    evidence.add_row("Exchange", "change of the first objective per unit of the second, SI")
    evidence.add_row(
        "Designs solved", f"{result['evaluations']}, {result['sample']['count']} in the sample"
    )
    evidence.add_row("Time", f"{result['seconds']:.1f} s")
    return [table, evidence]


def _shown(value: float, unit: str, digits: int = 5) -> str:
    return shown("", unit, value).text(value, digits)


def _finite(value: Any) -> Any:
    """Plain lists and numbers, `None` for what is not finite."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | jnp.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
