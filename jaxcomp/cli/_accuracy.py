"""`jaxcomp accuracy`: error against run time, and what each part of a scene costs."""

import enum
from typing import Annotated

import typer

from ._completion import complete_quantity
from ._errors import CommandError, reports_errors
from ._options import AsJson, Machine, Out, Sets


class Of(enum.StrEnum):
    """What is studied."""

    orbit = "orbit"
    quantities = "quantities"
    gradient = "gradient"
    sweep = "sweep"
    tolerance = "tolerance"
    simulate = "simulate"
    response = "response"
    harmonics = "harmonics"
    mesh = "mesh"
    balancing = "balancing"
    film = "film"
    friction = "friction"
    order = "order"
    scenes = "scenes"
    extremes = "extremes"


class Excitation(enum.StrEnum):
    """What shakes the rotor."""

    crank = "crank"
    file = "file"


# What is differentiated by, if nothing is said.
_VARIABLE = {Of.gradient: "mechanism.crank_radius"}
_FILM = ("friction_number", "stiffness", "damping")
_VARYING = (Of.gradient, Of.sweep, Of.tolerance)
_UNSHAKEN = (Of.scenes, Of.film, Of.friction, Of.order, Of.extremes, Of.simulate)


@reports_errors
def accuracy(
    machine: Machine,
    study: Annotated[
        Of,
        typer.Option(
            help="orbit: solvers of the periodic state; quantities: all that the machine has, by the "
            "default solver; gradient: ways to a derivative; sweep: batches; tolerance: samples beside "
            "derivatives; simulate: methods in time; response: solvers by number of speeds; harmonics: "
            "orders kept; mesh: finite elements; balancing: least squares, bounded, min-max; film: "
            "bearings beside Reynolds' equation; friction: its loops; order: fixed steps of diffrax; "
            "scenes: what each part of the machine costs; extremes: steep rods, near locking, near "
            "stall, thin films, stiff motors, near-singular responses."
        ),
    ] = Of.orbit,
    quantity: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What the errors are of, e.g. loss_power.wall, or friction_number, stiffness or damping "
            "of films; if absent, mechanical_efficiency or what suits the study.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    variable: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What to differentiate by, or what varies in sweep and tolerance; there a pattern such "
            "as 'friction.*.coefficient'.",
        ),
    ] = None,
    excitation: Annotated[
        Excitation | None,
        typer.Option(
            help="What shakes the rotor, for quantities of vibration: the crank's periodic state, or "
            "the forces of the file. If absent, the crank where the machine joins it to the rotor."
        ),
    ] = None,
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
    if excitation is not None and study in _UNSHAKEN:
        raise CommandError(f"--excitation {excitation}: has no meaning with --study {study}")
    if variable is not None and study not in _VARYING:
        raise CommandError(
            f"--variable {variable}: has no meaning without --study {', '.join(_VARYING)}"
        )
    from .._waits import progress_of, spinner
    from ._arguments import changed_scene
    from ._output import show_results, write_results
    from ._start import quick_compiles

    quick_compiles()  # nothing is kept, so that compile times are those of a first call
    scene = changed_scene(machine, sets or (), ())
    with progress_of("Measuring", unit="settings") as progress:

        def tell(words, number, total):
            progress.at(number, total, f"Measuring {words}")

        if study is Of.scenes:
            result, tables, draw = _scenes(scene, quantity, tell)
        elif study is Of.extremes:
            result, tables, draw = _extremes(scene, quantity, tell)
        else:
            by = variable or (None if quantity in _FILM else _VARIABLE.get(study))
            shaken = None if excitation is None else excitation.value
            result, tables, draw = _errors(
                scene, quantity, study, by, shaken, thorough, error, tell
            )
    if out is not None:
        with spinner("Drawing ..."):
            write_results(out, draw(), result, scene, tables)
    show_results(result, tables, as_json, out)


def _errors(scene, quantity, study, variable, excitation, thorough, error, tell):
    from ..work_precision import accuracy as measure
    from ._accuracy_result import accuracy_result, accuracy_tables

    report = measure(
        scene,
        quantity,
        study.value,
        variable=variable,
        excitation=excitation,
        thorough=thorough,
        tell=tell,
    )

    def draw():
        from ..plot import accuracy_figures

        return accuracy_figures(report, error)

    return accuracy_result(report, error), list(accuracy_tables(report, error)), draw


def _extremes(scene, quantity, tell):
    if quantity is not None:
        raise CommandError(f"--quantity {quantity}: has no meaning with --study extremes")
    from ..work_precision import extremes
    from ._accuracy_result import extremes_result, extremes_tables

    cases = extremes(scene, None, tell)

    def draw():
        from ..plot import extreme_errors

        return {"extremes": extreme_errors(cases, scene.name)}

    return extremes_result(cases, scene.name), list(extremes_tables(cases, scene.name)), draw


def _scenes(scene, quantity, tell):
    if quantity is not None:
        raise CommandError(f"--quantity {quantity}: has no meaning with --study scenes")
    from ..work_precision import lean_scenes, scene_costs
    from ._accuracy_result import costs_result, costs_tables

    costs = scene_costs(lean_scenes(scene), tell)

    def draw():
        from ..plot import scene_cost_bars

        return {"scenes": scene_cost_bars(costs, scene.name)}

    return costs_result(costs, scene.name), list(costs_tables(costs, scene.name)), draw
