"""Results of `jaxcomp optimise`: JSON, tables, and the scene as optimised."""

from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from .._shown import shown
from ..crank import solve_orbit
from ..design import Optimum, ParetoFront, compared_designs, quantity
from ..design._design import CORRECTIONS
from ..machine import assembled
from ..scene import Scene, with_machine
from ._json import plain
from ._tables import beside_table, row_table


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
    present = np.asarray(problem.current).tolist()
    now = np.flatnonzero(np.all(sample.values == np.array(present), axis=1))
    before = float(sample.objective[now[0]]) if now.size and sample.ok[now[0]] else None
    units = dict(zip(problem.names, problem.units, strict=True))
    variables = [
        {
            "name": one.name, "unit": one.unit, "low": found.ranges.low[i], "high": found.ranges.high[i],
            "present": present[i], "value": found.values[one.name],
            "gradient": found.gradient[one.name], "at_bound": found.at_bound.get(one.name),
        }
        for i, one in enumerate(problem.variables)
    ]  # fmt: skip
    best = None if sample.best is None else float(sample.objective[sample.best])
    same = (
        "quantities", "status", "feasible", "stationarity", "verdict", "local", "agreeing",
        "evaluations",
    )  # fmt: skip
    return plain({
        "machine": scene.name,
        "asked": asked,
        "variables": variables,
        "objective": {
            "name": found.objective_name, "unit": units.get(found.objective_name, ""),
            "maximised": found.maximised, "present": before, "value": found.objective,
        },
        "constraints": [one._asdict() | {"unit": units[one.name]} for one in found.constraints],
        **{name: getattr(found, name) for name in same},
        "starts": [one._asdict() for one in found.starts],
        "sample": {
            "count": len(sample.ok), "solved": int(sample.ok.sum()),
            "feasible": int(sample.feasible.sum()), "best_objective": best,
        },
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
    designs = problem.design, found.design
    orbits = [
        solve_orbit(assembled(one).compressor, problem.options.solver, throw=False)
        for one in designs
    ]
    return [
        {"name": one.name, "unit": one.unit, "present": one.values[0], "optimum": one.values[1]}
        for one in compared_designs(designs, orbits)
    ]


def front_result(scene: Scene, asked: dict[str, Any], front: ParetoFront, seconds: float) -> dict:
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
    return plain({
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


def optimum_tables(result: dict[str, Any]) -> list[Table]:
    """Variables and objective, comparison with the present design, constraints, starts, search."""
    goal, variables = result["objective"], result["variables"]
    way = "highest" if goal["maximised"] else "lowest"
    way = "met targets" if goal["name"] == "residuals" else way
    name = shown(goal["name"], goal["unit"], goal["value"]).words
    rows = [
        (
            escape(one["name"]),
            _text(one, one["present"]),
            f"[bold]{_text(one, one['value'])}",
            f"{_text(one, one['low'])} to {_text(one, one['high'])}",
            one["at_bound"] and f"on its {one['at_bound']} bound",
        )
        for one in variables
    ]
    rows += [
        (),
        (name, _text(goal, goal["present"], 6), f"[bold]{_text(goal, goal['value'], 6)}", "", ""),
    ]
    title = f"{result['machine']}: {way} {name.lower()}"
    tables = [row_table(title, ("", "Present", "Optimum", "Range", ""), rows)]
    if result.get("comparison"):
        rows = [{**one, "values": [one["present"], one["optimum"]]} for one in result["comparison"]]
        tables.append(beside_table(rows, ["Present", "Optimum"]))
    if result["constraints"]:
        signs = {"upper": "<=", "lower": ">=", "equal": "="}
        rows = [
            (
                escape(one["name"]),
                _text(one, one["value"]),
                f"{signs[one['side']]} {_text(one, one['bound'])}",
                "broken" if one["violation"] else "active" if one["active"] else "slack",
                one["active"] and f"{one['multiplier']:.4g} per {one['unit'] or 'one'}",
            )
            for one in result["constraints"]
        ]
        heads = ("Constraint", "Value", "Bound", "", "Objective per unit of the bound")
        tables.append(row_table(None, heads, rows))
    rows = [
        (
            ", ".join(_text(*pair) for pair in zip(variables, one["start"], strict=True)),
            _text(goal, one["objective"], 6),
            one["steps"],
            one["status"],
            "at the optimum" if one["agrees"] else "elsewhere",
        )
        for one in result["starts"]
    ]
    tables.append(row_table(None, ("Start", "Objective", "Designs solved", "Ended", ""), rows))
    rows = [
        ("Ended", result["status"]),
        ("Slope left", f"{result['stationarity'] or 0:.1e} of the objective's spread"),
        ("Compared", result["verdict"]),
        ("Starts that agree", f"{result['agreeing']} of {len(result['starts'])}"),
        (
            "Designs solved",
            f"{result['evaluations']} with derivatives, {result['sample']['count']} in the sample",
        ),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    return [*tables, row_table(None, ("Search", ""), rows, texts=2)]


def front_tables(result: dict[str, Any]) -> list[Table]:
    """The points of the front, and how they were found."""
    both, variables = result["objectives"], result["variables"]
    names = [shown(one["name"], one["unit"], 1.0).words for one in both]
    rows = [
        (
            *(_text(one, point["objectives"][one["name"]], 6) for one in both),
            *(_text(one, point["values"][one["name"]]) for one in variables),
            "" if point["exchange"] is None else f"{point['exchange']:.3g}",
            "dominated" if point["dominated"] else point["status"],
        )
        for point in result["points"]
    ]
    now = [_text(one, result["present"][one["name"]], 6) for one in both]
    if all(now):
        rows += [(), (*now, *[""] * len(variables), "", "present design")]
    heads = (*names, *(escape(one["name"]) for one in variables), "Exchange", "")
    title = f"{result['machine']}: {names[0]} against {names[1].lower()}"
    count = result["sample"]
    search = [
        ("Dominated points", sum(point["dominated"] for point in result["points"])),
        ("Samples better than the front", f"{result['beaten_by']} of {count['feasible']}"),
        ("Exchange", "change of the first objective per unit of the second, SI"),
        ("Designs solved", f"{result['evaluations']}, {count['count']} in the sample"),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    return [row_table(title, heads, rows), row_table(None, ("Search", ""), search, texts=2)]


def _text(one: dict[str, Any], value: float | None, digits: int = 5) -> str:
    """A value [SI] of something with a name and a unit; empty if there is none."""
    return "" if value is None else shown(one["name"], one["unit"], value).text(value, digits)
