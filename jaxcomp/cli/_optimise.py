"""`jaxcomp optimise`: the best design of a machine by gradients, and the front of two objectives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.display import shown
from .._core.nested import fields_of
from . import _options as opt
from ._arguments import assignments, bounds_of, changed_scene, si, value_of, with_one_unit
from ._output import Output, Partial
from ._start import refuse, start_jax, waiting
from ._tables import beside_table, bold, row_table

# Status of the program where no design keeps the constraints.
_NOT_FEASIBLE = 3

Method = Literal["slsqp", "least-squares", "adam"]


@dataclass(frozen=True)
class Asked:
    """The options of a search, as the result repeats them."""

    machine: opt.Machine
    variables: Annotated[
        list[str] | None, typer.Option("--variable", autocompletion=opt.complete_variable)
    ] = None
    objective: opt.Quantity = None
    targets: Annotated[list[str] | None, typer.Option("--target")] = None
    maximise: Annotated[bool | None, typer.Option("--maximise/--minimise")] = None
    constraints: Annotated[list[str] | None, typer.Option("--constraint")] = None
    pareto: opt.Quantity = None
    points: int = 12
    scatter: list[str] | None = None
    sigmas: float | None = None
    quantile: float | None = None
    sets: opt.Sets = None
    method: Method | None = None
    starts: int = 8
    max_steps: Annotated[int, typer.Option("--steps")] = 100
    tolerance: float = 1e-5
    samples: int = 256
    seed: int = 0
    accuracy: opt.AccuracyOption = "fine"
    solver: opt.Solver = "collocation"
    cycle: opt.CycleOption = None

    def checked(self) -> Asked:
        """These questions with the defaults of those that are not asked; refuses what cannot be
        combined.
        """
        refuse(
            not self.variables,
            "--variable: is missing; e.g. --variable bore_at_displacement=100mm:160mm",
        )
        two = self.targets and (self.objective or self.maximise is not None)
        refuse(two, "--target: cannot be combined with --objective or --maximise")
        other = "--target" if self.targets else "--method"
        beside = self.pareto and (self.targets or self.method)
        refuse(beside, f"--pareto: takes no {other} beside it")
        refuse(self.scatter and self.targets, "--scatter: takes no --target beside it")
        worse = [one for one in (self.sigmas, self.quantile) if one is not None]
        refuse(worse and not self.scatter, "--sigmas and --quantile: need --scatter")
        refuse(len(worse) > 1, "--sigmas: takes no --quantile beside it")
        lists = {name: getattr(self, name) or [] for name in ("sets", "targets", "constraints")}
        goal = None if self.targets else self.objective or "mechanical_efficiency"
        return replace(self, **lists, scatter=self.scatter or [], objective=goal)

    @property
    def maximised(self) -> bool | None:
        """Which way; a robust objective goes the way of what it is made of."""
        if not self.scatter or self.maximise is not None:
            return self.maximise
        better = jc.study.interface.quantity_named(self.objective).better
        refuse(not better, "--maximise: is missing; the objective is not better in one direction")
        return better == "more"


def optimise(asked: Asked, output: Output) -> None:
    """Find the best design by gradients, from several starts, and compare it with a coarse sweep.

    Example: [bold]jaxcomp optimise mayekawa-wbhe --variable bore_at_displacement=100mm:160mm --constraint
    'peak_force.crank_pin<=8kN' --out result[/bold]

    Robust: [bold]jaxcomp optimise mayekawa-wbhe --variable bore_at_displacement=100mm:160mm --scatter
    'friction.*.coefficient=+-20 %' --sigmas 3[/bold]

    Where no design found keeps the constraints, the one that breaks them least is shown, and the
    status of the program is 3.

    Front of two objectives: [bold]jaxcomp optimise mayekawa-wbhe --variable
    bore_at_displacement=100mm:160mm --pareto speed_fluctuation --out result[/bold]

    Args:
        variables (NAME=LOW:HIGH): What may change and its range, e.g.
            bore_at_displacement=100mm:160mm (a rule: the stroke follows) or
            crankshaft.inertia=0.1kg*m^2:0.3kg*m^2. Repeatable.
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
    asked = asked.checked()
    start_jax()
    begun = time.perf_counter()
    varied = [*(asked.variables or ()), *(asked.scatter or ())]
    scene = changed_scene(asked.machine, asked.sets, (), varied)
    options = opt.analysis_options(scene, asked.accuracy, asked.solver, asked.cycle)
    found = _searched(asked, _problem(asked, jc.machine.machine_of(scene), options), output.out)
    said = {"machine": scene.name, "asked": asdict(asked), "seconds": time.perf_counter() - begun}
    if isinstance(found, jc.study.ParetoFront):
        output.emit(
            found,
            front_tables,
            lambda: {"pareto": jc.plot.interface.pareto_front(found)},
            scene,
            {"front": found.columns},
            "Report, picture, result and machine file",
            beside=said,
        )
        return
    with waiting("Comparing with the present design ..."):
        both = found.compare()
    keys, rows = ("name", "unit", "present", "optimum"), both.rows if both else ()
    said["comparison"] = [dict(zip(keys, (*row[:2], *row.values), strict=True)) for row in rows]
    scene, said["not_in_scene"] = jc.scene.optimised_scene(scene, found)
    output.emit(
        found,
        lambda whole: optimum_tables(whole, both),
        lambda: jc.plot.interface.optimum_figures(found),
        scene,
        {"designs": found.columns},
        "Report, pictures, designs, result and "
        + ("optimised machine" if found.feasible else "the machine of the nearest design"),
        beside=said,
    )
    if not found.feasible:
        raise typer.Exit(_NOT_FEASIBLE)


# ------------------------------------------------------------------- the problem
def _problem(
    asked: Asked, design: jc.machine.Machine, options: jc.AnalysisOptions
) -> jc.study.interface.Problem:
    given = assignments(asked.variables, "--variable")
    ranges = {}
    for name, text in jc.study.interface.by_name(design, given).items():
        unit = jc.study.variable(design, name).unit
        low, colon, high = text.partition(":")
        form = "must have the form NAME=LOW:HIGH, such as bore_at_displacement=100mm:160mm"
        refuse(not colon, f"--variable {name}={text}: {form}")
        ends = (si(end, unit, f"--variable {name}") for end in with_one_unit((low, high)))
        ranges[name] = tuple(ends)
    quantities: list[Any] = list(assignments(asked.targets, "--target"))
    if asked.objective:
        quantities = [_robust(asked, design) if asked.scatter else asked.objective]
    quantities += [asked.pareto] if asked.pareto else []
    return jc.study.problem(design, ranges, quantities, options)


def _searched(
    asked: Asked, problem: jc.study.interface.Problem, out: Path | None
) -> jc.study.Optimum | jc.study.ParetoFront:
    """Search for the best designs of a problem; progress is shown, and solved designs are kept."""
    import numpy as np

    from .._core.progress import progress_of

    partial = Partial(out, "designs")
    solved = []
    options = fields_of(asked, "starts", "max_steps", "tolerance", "samples", "seed")
    options["constraints"] = bounds_of(asked.constraints, "--constraint")
    given = assignments(asked.targets, "--target").items()
    wanted = {name: value_of(name, text, f"--target {name}") for name, text in given}
    goal = problem.quantities[0]
    way = asked.maximised
    with progress_of("Compiling and sampling") as progress:

        def callback(stage: str, done: int, total: int) -> None:
            words = "Sampling the ranges" if stage == "sample" else "Searching, designs"
            # a descent ends as soon as it has converged
            progress.at(done, total, words, most=stage != "sample")

        def keep(problem, designs, found) -> None:
            solved.append((designs, found.values, found.ok))
            points, values, ok = map(np.concatenate, zip(*solved, strict=True))
            columns = {one.header: one.values for one in problem.columns(points, values)}
            partial.keep(columns | {"solved": ok})

        options |= {"callback": callback, "keep": keep}
        if asked.pareto:
            options |= {"maximise": (way, None), "points": asked.points}
            found = jc.study.pareto(problem, (goal, asked.pareto), **options)
        else:
            options |= {"maximise": way, "method": asked.method}
            found = jc.study.optimise(problem, wanted or goal, **options)
    partial.done()
    return found


def _robust(asked: Asked, design: jc.machine.Machine) -> jc.study.tolerance.Robust:
    """The objective at the worse end of its scatter."""
    from ..scene.tolerances import tolerances_of

    tolerances = tolerances_of(design, assignments(asked.scatter, "--scatter"))
    largest = asked.maximised
    share = asked.quantile
    sigmas = asked.sigmas
    if share is not None:
        share = 1 - share if largest else share
    else:
        sigmas = (-1 if largest else 1) * (3.0 if sigmas is None else sigmas)
    made = jc.study.tolerance.robust
    return made(design, asked.objective, tolerances, sigmas=sigmas, quantile=share)


# ------------------------------------------------------------------- tables
def optimum_tables(result: dict[str, Any], beside: jc.study.Comparison | None) -> Iterator[Any]:
    """Variables and objective, comparison with the present design, constraints, starts, search."""
    goal = result["objective"]
    variables = result["variables"]
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
    feasible = result["feasible"]
    label = "Optimum" if feasible else "Nearest"
    aim = f"{way} {name.lower()}" if feasible else result["verdict"]
    yield row_table(f"{result['machine']}: {aim}", ("", "Present", label, "Range", ""), rows)
    if result["constraints"] and not feasible:
        yield _constraints_table(result)
    if beside is not None:
        yield beside_table(beside)
    if result["constraints"] and feasible:
        yield _constraints_table(result)
    rows = [
        (", ".join(_text(*pair) for pair in zip(variables, one["start"], strict=True)),
         _text(goal, one["objective"], 6), one["steps"], one["status"],
         f"at the {label.lower()}" if one["agrees"] else "elsewhere")
        for one in result["starts"]
    ]  # fmt: skip
    yield row_table(None, ("Start", "Objective", "Designs solved", "Ended", ""), rows)
    solved = f"{result['evaluations']} with derivatives, {result['sample']['count']} in the sample"
    slope = ("Slope left", f"{result['stationarity'] or 0:.1e} of the objective's spread")
    compared = ("Compared", result["verdict"])
    rows = [
        ("Ended", result["status"]),
        *((slope, compared) if feasible else ()),
        ("Starts that agree", f"{result['agreeing']} of {len(result['starts'])}"),
        ("Designs solved", solved),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    yield row_table(None, ("Search", ""), rows, texts=2)


def _constraints_table(result: dict[str, Any]) -> Any:
    """Table of the values of each constraint, and by how much it is broken."""
    signs = {"upper": "<=", "lower": ">=", "equal": "="}
    rows = []
    for one in result["constraints"]:
        state = "active" if one["active"] else "slack"
        if one["violation"]:
            look = shown(one["name"], one["unit"], [one["bound"], one["value"]])
            state = f"broken by {look.difference(one['excess'], 3).lstrip('+')}"
        bound = f"{signs[one['side']]} {_text(one, one['bound'])}"
        price = one["active"] and f"{one['multiplier']:.4g} per {one['unit'] or 'one'}"
        rows.append((one["name"], _text(one, one["value"]), bound, state, price))
    heads = ("Constraint", "Value", "Bound", "", "Objective per unit of the bound")
    return row_table(None, heads, rows)


def front_tables(result: dict[str, Any]) -> Iterator[Any]:
    """The points of the front, and how they were found."""
    both = result["objectives"]
    variables = result["variables"]
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
