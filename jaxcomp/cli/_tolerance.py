"""`jaxcomp tolerance`: what the scatter of production does to efficiency, loads and vibration."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from ._balance import Excitation
from ._completion import complete_quantity, complete_variable
from ._errors import CommandError, reports_errors
from ._optimise import Accuracy
from ._options import AsJson, Designs, Machine, Out, Sets
from ._sweep import Sampling


class Curvature(enum.StrEnum):
    """Where the second order comes from."""

    differences = "differences"
    exact = "exact"
    none = "none"


@reports_errors
def tolerance(
    machine: Machine,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            metavar="NAME=TOLERANCE",
            help="Number and its tolerance: '+-0.02 mm', '-0.01 +0.03 mm', '+-5 %', 'sigma 5 um'; normal "
            "with a limit at 3 sigma, or add 'uniform', 'truncated', '2 sigma'. * in a name stands for "
            "any part of it. Repeatable.",
            autocompletion=complete_variable,
        ),
    ] = None,
    tolerances: Annotated[
        Path | None, typer.Option(help="TOML file of tolerances and correlations, see below.")
    ] = None,
    correlate: Annotated[
        list[str] | None,
        typer.Option(metavar="A,B=VALUE", help="Correlation of two deviations. Repeatable."),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="What is asked, e.g. motor_power; efficiency, or "
            "vibration of a rotor, if absent. Repeatable.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY<=VALUE",
            help="Limit, with <= or >=, whose probability of being broken is asked. Repeatable.",
        ),
    ] = None,
    rejects: Annotated[
        str | None,
        typer.Option(
            metavar="SHARE",
            help="With --limit: find tolerances with which no more than this share breaks it, e.g. 1%.",
        ),
    ] = None,
    sets: Sets = None,
    designs: Designs = None,
    balanced: Annotated[
        bool, typer.Option("--balanced", help="Of the machine with its least-squares balance.")
    ] = False,
    excitation: Annotated[
        Excitation | None,
        typer.Option(help="What shakes a rotor: forces of the file, or of the crank."),
    ] = None,
    samples: Annotated[int, typer.Option(help="Machines of the Monte Carlo.")] = 16384,
    sampling: Annotated[Sampling, typer.Option(help="How they are drawn.")] = Sampling.sobol,
    seed: Annotated[int, typer.Option(help="Of the samples.")] = 0,
    curvature: Annotated[
        Curvature,
        typer.Option(help="Second order by differences of slopes, by exact derivatives, or not."),
    ] = Curvature.differences,
    accuracy: Annotated[
        Accuracy,
        typer.Option(help="fast: efficiency to 1e-5, compiles three times as fast."),
    ] = Accuracy.fast,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Scatter of efficiency, losses, loads and vibration from tolerances, and what contributes most.

    Example: [bold]jaxcomp tolerance mayekawa-wbhe --vary mechanism.conrod_length='+-0.1 mm' --vary
    'friction.*.coefficient=+-20 %' --limit 'mechanical_efficiency>=0.9' --out result[/bold]

    Of a balanced machine: [bold]jaxcomp tolerance hermetic-68cc --balanced --vary
    'loads.unbalances.*.magnitude.*=+-5 %' --vary 'corrections.*.magnitude=+-5 %' --limit
    'vibration<=20um'[/bold]

    A file for --tolerances has a table [bold]\\[tolerances][/bold] with lines like "mechanism.bore" =
    "+-0.02 mm" and, where deviations go together, [bold]\\[\\[correlations]][/bold] with between = ["A",
    "B"] and value = 0.3.
    """
    if not vary and tolerances is None:
        raise CommandError("--vary: is missing; e.g. --vary mechanism.bore='+-0.02 mm'")
    if rejects is not None and not limit:
        raise CommandError("--rejects: needs a --limit, by which machines are rejected")
    if samples < 16:
        raise CommandError(f"--samples {samples}: must be >= 16")
    from .._waits import spinner
    from ..design import AnalysisOptions
    from ._arguments import changed_scene
    from ._optimise_search import SOLVERS
    from ._output import show_results, write_results
    from ._start import start_jax
    from ._sweep_options import start_devices
    from ._tolerance_result import (
        asked_tolerances,
        permitted_tolerances,
        tolerance_result,
        tolerance_tables,
    )

    start_devices(None)
    start_jax()
    scene = changed_scene(machine, sets or (), designs or ())
    options = AnalysisOptions(SOLVERS[accuracy.value], excitation and excitation.value)
    asked = asked_tolerances(scene, options, balanced, vary, tolerances, correlate, quantity, limit)
    from ..tolerancing import tolerance as study

    with spinner("Solving (the first time it is compiled as well) ..."):
        found = study(
            asked.design,
            asked.tolerances,
            asked.quantities,
            correlations=asked.correlations,
            limits=asked.limits,
            options=options,
            samples=samples,
            sampling=sampling.value.replace("-", "_"),
            seed=seed,
            curvature=None if curvature is Curvature.none else curvature.value,
        )
        tighter = None if rejects is None else permitted_tolerances(found, rejects)
    result = tolerance_result(found, scene.name, asked)
    if tighter is not None:
        result["permitted"] = [one._asdict() for one in tighter]
    tables = list(tolerance_tables(found, result))
    if out is not None:
        from ..plot import tolerance_figures

        with spinner("Drawing ..."):
            figures = tolerance_figures(found, scene.name)
            write_results(out, figures, result, scene, tables, {"samples": found.columns()})
    show_results(result, tables, as_json, out)
