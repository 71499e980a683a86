"""`jaxcomp optimise`: the best design of a machine by gradients, and the front of two objectives."""

import enum
from typing import Annotated

import typer

from ._completion import complete_quantity, complete_variable
from ._errors import CommandError, reports_errors
from ._options import Accuracy, AccuracyOption, AsJson, Machine, Out, Sets


class Method(enum.StrEnum):
    """The optimiser."""

    slsqp = "slsqp"
    least_squares = "least-squares"
    adam = "adam"


@reports_errors
def optimise(
    machine: Machine,
    variables: Annotated[
        list[str] | None,
        typer.Option(
            "--variable",
            metavar="NAME=LOW:HIGH",
            help="What may change and its range, e.g. bore=100mm:160mm (a rule: at fixed displacement) "
            "or mechanism.crank_inertia=0.1kg*m^2:0.3kg*m^2. Repeatable.",
            autocompletion=complete_variable,
        ),
    ] = None,
    objective: Annotated[
        str | None,
        typer.Option(
            metavar="QUANTITY",
            help="What to improve; mechanical_efficiency if absent.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(
            "--target",
            metavar="QUANTITY=VALUE",
            help="Value to meet in the sense of least squares, instead of --objective. Repeatable.",
        ),
    ] = None,
    maximise: Annotated[
        bool | None,
        typer.Option(
            "--maximise/--minimise", help="For objectives that are not better in one direction."
        ),
    ] = None,
    constraints: Annotated[
        list[str] | None,
        typer.Option(
            "--constraint",
            metavar="QUANTITY<=VALUE",
            help="Bound of a quantity, with <=, >= or =, e.g. 'peak_force.crank_pin<=8kN'. Repeatable.",
        ),
    ] = None,
    pareto: Annotated[
        str | None,
        typer.Option(
            metavar="QUANTITY",
            help="Trace the front with this second objective.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    points: Annotated[int, typer.Option(help="Points of the front.")] = 12,
    scatter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=TOLERANCE",
            help="Tolerance that the objective counts, as `jaxcomp tolerance --vary` takes it. "
            "Repeatable.",
        ),
    ] = None,
    sigmas: Annotated[
        float | None,
        typer.Option(
            help="With --scatter: the mean and so many standard deviations to the worse; 3 if absent."
        ),
    ] = None,
    quantile: Annotated[
        float | None,
        typer.Option(help="With --scatter: what this share of the machines keeps, e.g. 0.95."),
    ] = None,
    sets: Sets = None,
    method: Annotated[
        Method | None,
        typer.Option(
            help="slsqp keeps constraints, least-squares is for targets without constraints, adam is of "
            "first order; the one that suits if absent."
        ),
    ] = None,
    starts: Annotated[
        int,
        typer.Option(
            help="Number of starts: the best design of the coarse sample, the present one, and others "
            "spread over the ranges."
        ),
    ] = 8,
    max_steps: Annotated[
        int, typer.Option("--steps", help="Largest number of designs solved from each start.")
    ] = 100,
    tolerance: Annotated[
        float, typer.Option(help="Of the slope that is left, in spreads of the objective.")
    ] = 1e-5,
    samples: Annotated[
        int, typer.Option(help="Designs of the coarse sweep that the optimum is compared with.")
    ] = 256,
    seed: Annotated[int, typer.Option(help="Of starts and samples.")] = 0,
    accuracy: AccuracyOption = Accuracy.fine,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Find the best design by gradients, from several starts, and compare it with a coarse sweep.

    Example: [bold]jaxcomp optimise mayekawa-wbhe --variable bore=100mm:160mm --constraint
    'peak_force.crank_pin<=8kN' --out result[/bold]

    Robust: [bold]jaxcomp optimise mayekawa-wbhe --variable bore=100mm:160mm --scatter
    'friction.*.coefficient=+-20 %' --sigmas 3[/bold]

    Front of two objectives: [bold]jaxcomp optimise mayekawa-wbhe --variable bore=100mm:160mm --pareto
    speed_fluctuation --out result[/bold]
    """
    if not variables:
        raise CommandError("--variable: is missing; e.g. --variable bore=100mm:160mm")
    if targets and (objective or maximise is not None):
        raise CommandError("--target: takes neither --objective nor --maximise beside it")
    if pareto and (targets or method):
        name = "--target" if targets else "--method"
        raise CommandError(f"--pareto: takes no {name} beside it")
    if scatter and targets:
        raise CommandError("--scatter: takes no --target beside it")
    if not scatter and (sigmas is not None or quantile is not None):
        raise CommandError("--sigmas and --quantile: need --scatter")
    if sigmas is not None and quantile is not None:
        raise CommandError("--sigmas: takes no --quantile beside it")
    from ._optimise_search import searched
    from ._start import start_jax

    start_jax()
    asked = {
        "machine": machine,
        "sets": sets or [],
        "variables": variables,
        "objective": None if targets else (objective or "mechanical_efficiency"),
        "targets": targets or [],
        "maximise": maximise,
        "constraints": constraints or [],
        "pareto": pareto,
        "points": points,
        "scatter": scatter or [],
        "sigmas": sigmas,
        "quantile": quantile,
        "method": method and method.value,
        "starts": starts,
        "max_steps": max_steps,
        "tolerance": tolerance,
        "samples": samples,
        "seed": seed,
        "accuracy": accuracy,
    }
    searched(asked, as_json, out)
