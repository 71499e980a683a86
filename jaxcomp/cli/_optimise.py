"""`jaxcomp optimise`: the best design of a machine by gradients, and the front of two objectives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.table import Table

import jaxcomp as jc

from .._core.display import shown
from . import _options as opt
from ._arguments import assignments, bounds_of, changed_scene, si, value_of, with_one_unit
from ._output import Partial, hand_out, plain
from ._start import refuse, reports_errors, start_jax, waiting
from ._tables import beside_table, bold, row_table

Method = Literal["slsqp", "least-squares", "adam"]


@reports_errors
def optimise(
    machine: opt.Machine,
    variables: Annotated[
        list[str] | None, typer.Option("--variable", autocompletion=opt.complete_variable)
    ] = None,
    objective: opt.Quantity = None,
    targets: Annotated[list[str] | None, typer.Option("--target")] = None,
    maximise: Annotated[bool | None, typer.Option("--maximise/--minimise")] = None,
    constraints: Annotated[list[str] | None, typer.Option("--constraint")] = None,
    pareto: opt.Quantity = None,
    points: int = 12,
    scatter: list[str] | None = None,
    sigmas: float | None = None,
    quantile: float | None = None,
    sets: opt.Sets = None,
    method: Method | None = None,
    starts: int = 8,
    max_steps: Annotated[int, typer.Option("--steps")] = 100,
    tolerance: float = 1e-5,
    samples: int = 256,
    seed: int = 0,
    accuracy: opt.AccuracyOption = "fine",
    solver: opt.Solver = "collocation",
    cycle: opt.CycleOption = None,
    as_json: opt.AsJson = False,
    out: opt.Out = None,
) -> None:
    """Find the best design by gradients, from several starts, and compare it with a coarse sweep.

    Example: [bold]jaxcomp optimise mayekawa-wbhe --variable bore=100mm:160mm --constraint
    'peak_force.crank_pin<=8kN' --out result[/bold]

    Robust: [bold]jaxcomp optimise mayekawa-wbhe --variable bore=100mm:160mm --scatter
    'friction.*.coefficient=+-20 %' --sigmas 3[/bold]

    Front of two objectives: [bold]jaxcomp optimise mayekawa-wbhe --variable bore=100mm:160mm --pareto
    speed_fluctuation --out result[/bold]

    Args:
        variables (NAME=LOW:HIGH): What may change and its range, e.g. bore=100mm:160mm (a rule: at
            fixed displacement) or crankshaft.inertia=0.1kg*m^2:0.3kg*m^2. Repeatable.
        objective (QUANTITY): What to improve; mechanical_efficiency if absent.
        targets (QUANTITY=VALUE): Value to meet in the sense of least squares, instead of --objective.
            Repeatable.
        maximise: For objectives that are not better in one direction.
        constraints (QUANTITY<=VALUE): Bound of a quantity, with <=, >= or =, e.g.
            'peak_force.crank_pin<=8kN'. Repeatable.
        pareto (QUANTITY): Trace the front with this second objective.
        points: Points of the front.
        scatter (NAME=TOLERANCE): Tolerance that the objective counts, as `jaxcomp tolerance --vary`
            takes it. Repeatable.
        sigmas: With --scatter: the mean and so many standard deviations to the worse; 3 if absent.
        quantile: With --scatter: what this share of the machines keeps, e.g. 0.95.
        method: slsqp keeps constraints, least-squares is for targets without constraints, adam is of
            first order; the one that suits if absent.
        starts: Number of starts: the best design of the coarse sample, the present one, and others
            spread over the ranges.
        max_steps: Largest number of designs solved from each start.
        tolerance: Of the slope that is left, in spreads of the objective.
        samples: Designs of the coarse sweep that the optimum is compared with.
        seed: Of starts and samples.
    """
    asked = {name: given for name, given in locals().items() if name not in ("as_json", "out")}
    refuse(not variables, "--variable: is missing; e.g. --variable bore=100mm:160mm")
    two = targets and (objective or maximise is not None)
    refuse(two, "--target: cannot be combined with --objective or --maximise")
    other = "--target" if targets else "--method"
    refuse(pareto and (targets or method), f"--pareto: takes no {other} beside it")
    refuse(scatter and targets, "--scatter: takes no --target beside it")
    unscattered = not scatter and (sigmas is not None or quantile is not None)
    refuse(unscattered, "--sigmas and --quantile: need --scatter")
    both = sigmas is not None and quantile is not None
    refuse(both, "--sigmas: takes no --quantile beside it")
    start_jax()
    asked |= {name: asked[name] or [] for name in ("sets", "targets", "constraints", "scatter")}
    asked["objective"] = None if targets else objective or "mechanical_efficiency"
    begun = time.perf_counter()
    scene = changed_scene(machine, sets, (), [*asked["variables"], *asked["scatter"]])
    options = opt.analysis_options(scene, accuracy, solver, cycle)
    found = _searched(asked, _problem(asked, jc.machine.machine_of(scene), options), out)
    seconds = time.perf_counter() - begun
    if isinstance(found, jc.study.ParetoFront):
        result = front_result(scene, asked, found, seconds)
        tables, files = front_tables(result), "front"
        written = "Report, picture, result and scene"
    else:
        result = optimum_result(scene, asked, found, seconds)
        with waiting("Comparing with the present design ..."):
            beside = comparison(found)
        result["comparison"] = [
            {"name": name, "unit": unit, "present": values[0], "optimum": values[1]}
            for name, unit, values in (beside.rows if beside else ())
        ]
        scene, result["not_in_scene"] = optimised_scene(scene, found)
        tables, files = optimum_tables(result, beside), "designs"
        written = "Report, pictures, designs, result and optimised scene"

    def figures():
        if pareto:
            return {"pareto": jc.plot.pareto_front(found)}
        return jc.plot.optimum_figures(found)

    hand_out(result, tables, as_json, out, figures, scene, {files: found.columns}, written)


# ------------------------------------------------------------------- the problem
def _problem(
    asked: dict[str, Any], design: jc.machine.Machine, options: jc.AnalysisOptions
) -> jc.study.Problem:
    ranges = {}
    for name, text in jc.study.by_name(
        design, assignments(asked["variables"], "--variable")
    ).items():
        unit = jc.study.variable(design, name).unit
        low, colon, high = text.partition(":")
        form = "must have the form NAME=LOW:HIGH, such as bore=100mm:160mm"
        refuse(not colon, f"--variable {name}={text}: {form}")
        ends = (si(end, unit, f"--variable {name}") for end in with_one_unit((low, high)))
        ranges[name] = tuple(ends)
    if asked["objective"]:
        quantities = [_robust(asked, design) if asked["scatter"] else asked["objective"]]
    else:
        quantities = list(assignments(asked["targets"], "--target"))
    quantities += [asked["pareto"]] if asked["pareto"] else []
    return jc.study.problem(design, ranges, quantities, options)


def _searched(
    asked: dict[str, Any], problem: jc.study.Problem, out: Path | None
) -> jc.study.Optimum | jc.study.ParetoFront:
    """Search for the best designs of a problem; progress is shown, and solved designs are kept."""
    import numpy as np

    from .._core.progress import progress_of

    partial, solved = Partial(out, "designs"), []
    options = {key: asked[key] for key in ("starts", "max_steps", "tolerance", "samples", "seed")}
    options["constraints"] = bounds_of(asked["constraints"], "--constraint")
    wanted = {
        name: value_of(name, text, f"--target {name}")
        for name, text in assignments(asked["targets"], "--target").items()
    }
    goal, way = problem.quantities[0], _maximise(asked)
    with progress_of("Compiling and sampling") as progress:

        def callback(stage: str, done: int, total: int) -> None:
            words = "Sampling the ranges" if stage == "sample" else "Searching, designs"
            progress.at(done, total, words)

        def keep(problem, designs, found) -> None:
            solved.append((designs, found.values, found.ok))
            points, values, ok = map(np.concatenate, zip(*solved, strict=True))
            columns = {one.header: one.values for one in problem.columns(points, values)}
            partial.keep(columns | {"solved": ok})

        options |= {"callback": callback, "keep": keep}
        if asked["pareto"]:
            options |= {"maximise": (way, None), "points": asked["points"]}
            found = jc.study.pareto(problem, (goal, asked["pareto"]), **options)
        else:
            options |= {"maximise": way, "method": asked["method"]}
            found = jc.study.optimise(problem, wanted or goal, **options)
    partial.done()
    return found


def _maximise(asked: dict[str, Any]) -> bool | None:
    """Which way; a robust objective goes the way of what it is made of."""
    if not asked["scatter"] or asked["maximise"] is not None:
        return asked["maximise"]
    better = jc.study.quantity_named(asked["objective"]).better
    refuse(not better, "--maximise: is missing; the objective is not better in one direction")
    return better == "more"


def _robust(asked: dict[str, Any], design: jc.machine.Machine) -> jc.study.tolerance.Robust:
    """The objective at the worse end of its scatter."""
    from ..scene.tolerances import tolerances_of

    tolerances = tolerances_of(design, assignments(asked["scatter"], "--scatter"))
    largest, share, sigmas = _maximise(asked), asked["quantile"], asked["sigmas"]
    if share is not None:
        share = 1 - share if largest else share
    else:
        sigmas = (-1 if largest else 1) * (3.0 if sigmas is None else sigmas)
    return jc.study.tolerance.robust(
        design, asked["objective"], tolerances, sigmas=sigmas, quantile=share
    )


# ------------------------------------------------------------------- an optimum
def optimised_scene(
    scene: jc.scene.Scene, optimum: jc.study.Optimum
) -> tuple[jc.scene.Scene, list[str]]:
    """The scene with the best design.

    Returns:
        The scene, and the variables that a scene file does not have (correction masses).
    """
    from ..study import CORRECTIONS

    source = f"optimised for {optimum.objective_name}"
    names = [one.name for one in optimum.problem.variables]
    left = [name for name in names if name.split(".")[0] == CORRECTIONS]
    return jc.scene.with_machine(scene, optimum.design, source), left


def optimum_result(
    scene: jc.scene.Scene, asked: dict[str, Any], found: jc.study.Optimum, seconds: float
) -> dict[str, Any]:
    """JSON of an optimum."""
    import numpy as np

    problem, sample = found.problem, found.sample
    present = np.asarray(problem.current)
    now = np.flatnonzero(np.all(sample.values == present, axis=1))
    before = float(sample.objective[now[0]]) if now.size and sample.ok[now[0]] else None
    units = dict(zip(problem.names, problem.units, strict=True))

    def variable(i, one):
        return {
            "name": one.name,
            "unit": one.unit,
            "low": found.ranges.low[i],
            "high": found.ranges.high[i],
            "present": present[i],
            "value": found.values[one.name],
            "gradient": found.gradient[one.name],
            "at_bound": found.at_bound.get(one.name),
        }

    same = (
        "quantities", "status", "feasible", "stationarity", "verdict", "local", "agreeing",
        "evaluations", "starts",
    )  # fmt: skip
    result = {
        "machine": scene.name,
        "asked": asked,
        "variables": [variable(i, one) for i, one in enumerate(problem.variables)],
        "objective": {
            "name": found.objective_name,
            "unit": units.get(found.objective_name, ""),
            "maximised": found.maximised,
            "present": before,
            "value": found.objective,
        },
        "constraints": [one._asdict() | {"unit": units[one.name]} for one in found.constraints],
        **{name: getattr(found, name) for name in same},
        "sample": {
            "count": len(sample.ok),
            "solved": sample.ok.sum(),
            "feasible": sample.feasible.sum(),
            "best_objective": None if sample.best is None else sample.objective[sample.best],
        },
        "seconds": seconds,
    }
    return plain(result)


def comparison(found: jc.study.Optimum) -> jc.study.Comparison | None:
    """The present design beside the optimum, where there is a crank.

    Objectives that need no periodic state are compared by themselves.
    """
    problem = found.problem
    crank = (
        not isinstance(q, str) or "orbit" in jc.study.quantity_named(q).needs
        for q in problem.quantities
    )
    if problem.design.compressor is None or not any(crank):
        return None
    designs = {"Present": problem.design, "Optimum": found.design}
    return jc.study.compare(designs, problem.options.solver, throw=False)


def optimum_tables(result: dict[str, Any], beside: jc.study.Comparison | None) -> Iterator[Table]:
    """Variables and objective, comparison with the present design, constraints, starts, search."""
    goal, variables = result["objective"], result["variables"]
    way = "highest" if goal["maximised"] else "lowest"
    way = "met targets" if goal["name"] == "residuals" else way
    name = shown(goal["name"], goal["unit"], goal["value"]).words
    rows = [
        (
            one["name"],
            _text(one, one["present"]),
            bold(_text(one, one["value"])),
            f"{_text(one, one['low'])} to {_text(one, one['high'])}",
            one["at_bound"] and f"on its {one['at_bound']} bound",
        )
        for one in variables
    ]
    best = bold(_text(goal, goal["value"], 6))
    rows += [(), (name, _text(goal, goal["present"], 6), best, "", "")]
    title = f"{result['machine']}: {way} {name.lower()}"
    yield row_table(title, ("", "Present", "Optimum", "Range", ""), rows)
    if beside is not None:
        yield beside_table(beside)
    if result["constraints"]:
        signs = {"upper": "<=", "lower": ">=", "equal": "="}
        rows = [
            (
                one["name"],
                _text(one, one["value"]),
                f"{signs[one['side']]} {_text(one, one['bound'])}",
                "broken" if one["violation"] else "active" if one["active"] else "slack",
                one["active"] and f"{one['multiplier']:.4g} per {one['unit'] or 'one'}",
            )
            for one in result["constraints"]
        ]
        heads = ("Constraint", "Value", "Bound", "", "Objective per unit of the bound")
        yield row_table(None, heads, rows)
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
    yield row_table(None, ("Start", "Objective", "Designs solved", "Ended", ""), rows)
    solved = f"{result['evaluations']} with derivatives, {result['sample']['count']} in the sample"
    rows = [
        ("Ended", result["status"]),
        ("Slope left", f"{result['stationarity'] or 0:.1e} of the objective's spread"),
        ("Compared", result["verdict"]),
        ("Starts that agree", f"{result['agreeing']} of {len(result['starts'])}"),
        ("Designs solved", solved),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    yield row_table(None, ("Search", ""), rows, texts=2)


# ------------------------------------------------------------------- a front
def front_result(
    scene: jc.scene.Scene, asked: dict[str, Any], front: jc.study.ParetoFront, seconds: float
) -> dict[str, Any]:
    """JSON of a front."""

    def named(names, values):
        return dict(zip(names, values, strict=True))

    variables, sample = front.ends[0].problem.variables, front.ends[0].sample
    keys = ("name", "unit", "maximised")
    columns = (front.values, front.objectives, front.exchange, front.status, front.dominated)
    result = {
        "machine": scene.name,
        "asked": asked,
        "objectives": [
            named(keys, one) for one in zip(front.names, front.units, front.maximised, strict=True)
        ],
        "variables": [
            {"name": name, "unit": one.unit}
            for name, one in zip(front.variables, variables, strict=True)
        ],
        "present": named(front.names, front.present),
        "points": [
            {
                "values": named(front.variables, values),
                "objectives": named(front.names, objectives),
                "exchange": exchange,
                "status": status,
                "dominated": dominated,
            }
            for values, objectives, exchange, status, dominated in zip(*columns, strict=True)
        ],
        "beaten_by": front.beaten_by,
        "verdicts": [end.verdict for end in front.ends],
        "sample": {"count": len(sample.ok), "feasible": len(front.sample)},
        "evaluations": front.evaluations,
        "seconds": seconds,
    }
    return plain(result)


def front_tables(result: dict[str, Any]) -> Iterator[Table]:
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
    heads = (*names, *(one["name"] for one in variables), "Exchange", "")
    yield row_table(f"{result['machine']}: {names[0]} against {names[1].lower()}", heads, rows)
    count = result["sample"]
    search = [
        ("Dominated points", sum(point["dominated"] for point in result["points"])),
        ("Samples better than the front", f"{result['beaten_by']} of {count['feasible']}"),
        ("Exchange", "change of the first objective per unit of the second, SI"),
        ("Designs solved", f"{result['evaluations']}, {count['count']} in the sample"),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    yield row_table(None, ("Search", ""), search, texts=2)


def _text(one: dict[str, Any], value: float | None, digits: int = 5) -> str:
    """A value [SI] of something with a name and a unit; empty if there is none."""
    return "" if value is None else shown(one["name"], one["unit"], value).text(value, digits)
