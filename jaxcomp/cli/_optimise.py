"""`jaxcomp optimise`: the best design of a machine by gradients, and the front of two objectives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.declared import BESIDE, OPTION, Record, part, reading, word
from .._core.display import shown
from . import _options as opt
from ._arguments import assignments, bounds_of, changed_scene, si, value_of, with_one_unit
from ._output import Output, Partial
from ._start import refuse, start_jax, waiting
from ._tables import bold, comparison_table, number_text, row_table

if TYPE_CHECKING:
    from ..study._problem import Problem

# Status of the program where no design keeps the constraints.
_NOT_FEASIBLE = 3

Method = Literal["slsqp", "least-squares", "adam"]


@dataclass(frozen=True)
class SearchOptions:
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

    def checked(self) -> SearchOptions:
        """Options with the defaults of those that are absent.

        Raises:
            CommandError: options that cannot be combined.
        """
        refuse(
            not self.variables,
            "--variable: is missing; e.g. --variable bore_at_displacement=100mm:160mm",
        )
        goals = self.targets and (self.objective or self.maximise is not None)
        refuse(goals, "--target: cannot be combined with --objective or --maximise")
        refuse(self.pareto and self.targets, "--pareto: takes no --target beside it")
        refuse(self.pareto and self.method, "--pareto: takes no --method beside it")
        refuse(self.scatter and self.targets, "--scatter: takes no --target beside it")
        sigmas = self.sigmas is not None
        quantile = self.quantile is not None
        refuse((sigmas or quantile) and not self.scatter, "--sigmas and --quantile: need --scatter")
        refuse(sigmas and quantile, "--sigmas: takes no --quantile beside it")
        goal = None
        if not self.targets:
            goal = self.objective or "mechanical_efficiency"
        return replace(
            self,
            sets=self.sets or [],
            targets=self.targets or [],
            constraints=self.constraints or [],
            scatter=self.scatter or [],
            objective=goal,
        )

    @property
    def maximised(self) -> bool | None:
        """Which way; a robust objective goes the way of what it is made of."""
        from ..study._analysis import quantity_named

        if not self.scatter or self.maximise is not None:
            return self.maximise
        better = quantity_named(self.objective).better
        refuse(not better, "--maximise: is missing; the objective is not better in one direction")
        return better == "more"


def optimise(search: SearchOptions, output: Output) -> None:
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
    search = search.checked()
    start_jax()
    begun = time.perf_counter()
    varied = [*(search.variables or ()), *(search.scatter or ())]
    scene = changed_scene(search.machine, search.sets, (), varied)
    options = opt.analysis_options(scene, search.accuracy, search.solver, search.cycle)
    outcome = _searched(search, _problem(search, jc.machine.machine_of(scene), options), output.out)
    numbers = SearchNumbers(asdict(search), time.perf_counter() - begun)
    if isinstance(outcome, jc.study.ParetoFront):

        def pictures():
            from ..plot._optimise import pareto_front

            return {"pareto": pareto_front(outcome)}

        output.emit(
            outcome,
            front_tables,
            pictures,
            scene,
            {"front": outcome.columns},
            "Report, picture, result and machine file",
            metadata={"machine": scene.name},
            numbers=numbers,
        )
        return
    with waiting("Comparing with the present design ..."):
        comparison = outcome.compare()
    numbers = replace(numbers, comparison=_compared_rows(comparison))
    machine = scene.name
    scene, not_in_scene = jc.scene.optimised_scene(scene, outcome)
    design = "optimised machine" if outcome.feasible else "the machine of the nearest design"

    def pictures():
        from ..plot._optimise import optimum_figures

        return optimum_figures(outcome)

    output.emit(
        outcome,
        lambda result: optimum_tables(result, comparison),
        pictures,
        scene,
        {"designs": outcome.columns},
        f"Report, pictures, designs, result and {design}",
        metadata={"machine": machine, "not_in_scene": not_in_scene},
        numbers=numbers,
    )
    if not outcome.feasible:
        raise typer.Exit(_NOT_FEASIBLE)


@dataclass(frozen=True)
class ComparedRow(Record):
    """A quantity of the present design and of the optimum."""

    name: str = word()
    unit: str = word()
    present: float | None = reading(BESIDE)
    optimum: float | None = reading(BESIDE)


@dataclass(frozen=True)
class SearchNumbers(Record):
    """Options and duration [s] of a search, and the optimum beside the present design."""

    options: dict[str, Any] = reading(OPTION, key="asked")
    seconds: float = reading("s")
    comparison: tuple[ComparedRow, ...] | None = part(ComparedRow, optional=True, default=None)


def _compared_rows(comparison: jc.study.Comparison | None) -> tuple[ComparedRow, ...]:
    if comparison is None:
        return ()
    rows = []
    for row in comparison.rows:
        present, optimum = row.values
        rows.append(ComparedRow(row.name, row.unit, present, optimum))
    return tuple(rows)


# ------------------------------------------------------------------- the problem
def _problem(
    search: SearchOptions, design: jc.machine.Machine, options: jc.AnalysisOptions
) -> Problem:
    from ..study._variables import by_name

    range_texts = assignments(search.variables, "--variable")
    ranges = {}
    for name, text in by_name(design, range_texts).items():
        unit = jc.study.variable(design, name).unit
        low, colon, high = text.partition(":")
        form = "must have the form NAME=LOW:HIGH, such as bore_at_displacement=100mm:160mm"
        refuse(not colon, f"--variable {name}={text}: {form}")
        low, high = with_one_unit((low, high))
        option = f"--variable {name}"
        ranges[name] = (si(low, unit, option), si(high, unit, option))
    quantities: list[Any] = list(assignments(search.targets, "--target"))
    if search.objective and search.scatter:
        quantities = [_robust(search, design)]
    elif search.objective:
        quantities = [search.objective]
    if search.pareto:
        quantities.append(search.pareto)
    return jc.study.problem(design, ranges, quantities, options)


def _searched(
    search: SearchOptions, problem: Problem, out: Path | None
) -> jc.study.Optimum | jc.study.ParetoFront:
    """Search for the best designs of a problem; progress is shown, and solved designs are kept."""
    import numpy as np

    from .._core.progress import progress_of

    store = Partial(out, "designs")
    solved = []
    options: dict[str, Any] = {
        "starts": search.starts,
        "max_steps": search.max_steps,
        "tolerance": search.tolerance,
        "samples": search.samples,
        "seed": search.seed,
        "constraints": bounds_of(search.constraints, "--constraint"),
    }
    targets = {}
    for name, text in assignments(search.targets, "--target").items():
        targets[name] = value_of(name, text, f"--target {name}")
    goal = problem.quantities[0]
    maximised = search.maximised
    with progress_of("Compiling and sampling") as progress:

        def callback(stage: str, count: int, total: int) -> None:
            if stage == "sample":
                progress.at(count, total, "Sampling the ranges", is_limit=False)
            else:
                # a descent ends as soon as it has converged
                progress.at(count, total, "Searching, designs", is_limit=True)

        def keep(problem, designs, evaluation) -> None:
            solved.append((designs, evaluation.values, evaluation.ok))
            points, values, ok = map(np.concatenate, zip(*solved, strict=True))
            columns = {column.header: column.values for column in problem.columns(points, values)}
            store.keep(columns | {"solved": ok})

        options |= {"callback": callback, "keep": keep}
        if search.pareto:
            options |= {"maximise": (maximised, None), "points": search.points}
            outcome = jc.study.pareto(problem, (goal, search.pareto), **options)
        else:
            options |= {"maximise": maximised, "method": search.method}
            outcome = jc.study.optimise(problem, targets or goal, **options)
    store.finish()
    return outcome


def _robust(search: SearchOptions, design: jc.machine.Machine) -> jc.study.tolerance.Robust:
    """The objective at the worse end of its scatter."""
    from ..scene.tolerances import tolerances_of

    tolerances = tolerances_of(design, assignments(search.scatter, "--scatter"))
    robust = partial(jc.study.tolerance.robust, design, search.objective, tolerances)
    sigmas = search.sigmas
    quantile = search.quantile
    if sigmas is None:
        sigmas = 3.0
    # the worse end is below the mean of what is maximised, above it of what is minimised
    maximised = search.maximised
    if quantile is None:
        return robust(sigmas=-sigmas if maximised else sigmas)
    return robust(quantile=1 - quantile if maximised else quantile)


# ------------------------------------------------------------------- tables
def optimum_tables(result: dict[str, Any], comparison: jc.study.Comparison | None) -> Iterator[Any]:
    """Variables and objective, comparison with the present design, constraints, starts, search."""
    goal = result["objective"]
    variables = result["variables"]
    direction = "highest" if goal["maximised"] else "lowest"
    if goal["name"] == "residuals":
        direction = "met targets"
    name = shown(goal["name"], goal["unit"], goal["value"]).words
    feasible = result["feasible"]
    label = "Nearest"
    aim = result["verdict"]
    if feasible:
        label = "Optimum"
        aim = f"{direction} {name.lower()}"
    rows: list[Any] = list(map(_variable_row, variables))
    best = bold(_text(goal, goal["value"], 6))
    rows += [(), (name, _text(goal, goal["present"], 6), best, "", "")]
    yield row_table(f"{result['machine']}: {aim}", ("", "Present", label, "Range", ""), rows)
    if result["constraints"] and not feasible:
        yield _constraints_table(result)
    if comparison is not None:
        yield comparison_table(comparison)
    if result["constraints"] and feasible:
        yield _constraints_table(result)
    rows = []
    for start in result["starts"]:
        values = ", ".join(map(_text, variables, start["start"]))
        objective = _text(goal, start["objective"], 6)
        end = "elsewhere"
        if start["agrees"]:
            end = f"at the {label.lower()}"
        rows.append((values, objective, start["steps"], start["status"], end))
    yield row_table(None, ("Start", "Objective", "Designs solved", "Ended", ""), rows)
    solved = f"{result['evaluations']} with derivatives, {result['sample']['count']} in the sample"
    rows = [("Ended", result["status"])]
    if feasible:
        slope = f"{result['stationarity'] or 0:.1e} of the objective's spread"
        rows += [("Slope left", slope), ("Compared", result["verdict"])]
    rows += [
        ("Starts that agree", f"{result['agreeing']} of {len(result['starts'])}"),
        ("Designs solved", solved),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    yield row_table(None, ("Search", ""), rows, texts=2)


def _variable_row(variable: dict[str, Any]) -> tuple[str | None, ...]:
    """The present and the best value of a variable, its range, and the bound that holds it."""
    low = _text(variable, variable["low"])
    high = _text(variable, variable["high"])
    return (
        variable["name"],
        _text(variable, variable["present"]),
        bold(_text(variable, variable["value"])),
        f"{low} to {high}",
        variable["at_bound"] and f"on its {variable['at_bound']} bound",
    )


def _constraints_table(result: dict[str, Any]) -> Any:
    """Table of the values of each constraint, and by how much it is broken."""
    signs = {"upper": "<=", "lower": ">=", "equal": "="}
    rows = []
    for constraint in result["constraints"]:
        state = "active" if constraint["active"] else "slack"
        if constraint["violation"]:
            look = shown(
                constraint["name"], constraint["unit"], [constraint["bound"], constraint["value"]]
            )
            state = f"broken by {look.difference(constraint['excess'], 3).lstrip('+')}"
        bound = f"{signs[constraint['side']]} {_text(constraint, constraint['bound'])}"
        price = (
            constraint["active"]
            and f"{constraint['multiplier']:.4g} per {constraint['unit'] or 'one'}"
        )
        rows.append(
            (constraint["name"], _text(constraint, constraint["value"]), bound, state, price)
        )
    heads = ("Constraint", "Value", "Bound", "", "Objective per unit of the bound")
    return row_table(None, heads, rows)


def front_tables(result: dict[str, Any]) -> Iterator[Any]:
    """The points of the front, and how they were found."""
    objectives = result["objectives"]
    variables = result["variables"]
    names = [shown(objective["name"], objective["unit"], 1.0).words for objective in objectives]
    rows: list[Any] = []
    dominated = 0
    for point in result["points"]:
        exchange = number_text(point["exchange"], ".3g")
        status = point["status"]
        if point["dominated"]:
            status = "dominated"
            dominated += 1
        values = _texts(objectives, point["objectives"], 6)
        rows.append((*values, *_texts(variables, point["values"]), exchange, status))
    present_values = _texts(objectives, result["present"], 6)
    if all(present_values):
        rows += [(), (*present_values, *[""] * len(variables), "", "present design")]
    heads = (*names, *(variable["name"] for variable in variables), "Exchange", "")
    yield row_table(f"{result['machine']}: {names[0]} against {names[1].lower()}", heads, rows)
    count = result["sample"]
    search = [
        ("Dominated points", dominated),
        ("Samples better than the front", f"{result['beaten_by']} of {count['feasible']}"),
        ("Exchange", "change of the first objective per unit of the second, SI"),
        ("Designs solved", f"{result['evaluations']}, {count['count']} in the sample"),
        ("Time", f"{result['seconds']:.1f} s"),
    ]
    yield row_table(None, ("Search", ""), search, texts=2)


def _texts(
    quantities: list[dict[str, Any]], values: dict[str, float | None], digits: int = 5
) -> list[str]:
    """The values [SI] of some quantities by their names."""
    return [_text(quantity, values[quantity["name"]], digits) for quantity in quantities]


def _text(quantity: dict[str, Any], value: float | None, digits: int = 5) -> str:
    """A value [SI] of something with a name and a unit; empty if there is none."""
    if value is None:
        return ""
    return shown(quantity["name"], quantity["unit"], value).text(value, digits)
