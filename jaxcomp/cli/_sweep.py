"""`jaxcomp sweep`: efficiency and other quantities over grids and samples of any numbers."""

import enum
from typing import Annotated

import typer

from ._completion import complete_quantity, complete_variable
from ._errors import STOPPED, CommandError, reports_errors
from ._options import AsJson, Designs, Machine, Out, Sets


class Sampling(enum.StrEnum):
    """How samples are drawn."""

    sobol = "sobol"
    latin_hypercube = "latin-hypercube"
    random = "random"


@reports_errors
def sweep(
    machine: Machine,
    over: Annotated[
        list[str],
        typer.Option(
            "--over",
            metavar="NAME=VALUES",
            help="Variable and its values: FROM:TO:COUNT, log:FROM:TO:COUNT or A,B,C; with --samples "
            "FROM:TO, log:FROM:TO or normal:MEAN:DEVIATION. May be repeated; set in this order.",
            autocompletion=complete_variable,
        ),
    ],
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            "--quantity",
            metavar="NAME",
            help="What is asked of each design, e.g. motor_power or loss_power.wall; "
            "mechanical_efficiency if absent. May be repeated.",
            autocompletion=complete_quantity,
        ),
    ] = None,
    sets: Sets = None,
    designs: Designs = None,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="Draw N designs instead of a grid.")
    ] = None,
    sampling: Annotated[Sampling, typer.Option(help="How samples are drawn.")] = Sampling.sobol,
    seed: Annotated[int, typer.Option(help="Of the samples.")] = 0,
    nodes: Annotated[
        int | None,
        typer.Option(
            "--solver-nodes",
            help="Collocation nodes a panel, e.g. 10 with --solver-reversals 0 --solver-tolerance 1e-5 "
            "for many designs; its own default if absent.",
        ),
    ] = None,
    reversals: Annotated[
        int | None,
        typer.Option(
            "--solver-reversals", help="Load reversals that become panel edges; 0 for none."
        ),
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option("--solver-tolerance", help="Change at which the passes stop.")
    ] = None,
    batch: Annotated[
        int | None, typer.Option(help="Designs that are worked out and written at a time.")
    ] = None,
    devices: Annotated[
        int | None, typer.Option(help="Cores (or other devices) to use; all if absent.")
    ] = None,
    coordinator: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Of several processes that share the sweep."),
    ] = None,
    processes: Annotated[int, typer.Option(help="How many processes share the sweep.")] = 1,
    process: Annotated[int, typer.Option(help="Which of them this is, from 0.")] = 0,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Work out all designs of a grid, or samples, and show the best ones.

    With --out everything is kept in OUT/sweep.zarr while it is found. The same command goes on where
    a stopped one ended.

    Example: [bold]jaxcomp sweep mayekawa-wbhe --over bore=100mm:150mm:51 --over
    motor.mean_speed=600rpm:1400rpm:33 --out result[/bold]
    """
    _check(sampling, samples, tolerance, nodes, reversals, coordinator, processes, process, out)
    from .._waits import spinner
    from ._arguments import changed_scene
    from ._output import show_results, write_results
    from ._start import start_jax
    from ._sweep_options import analysis_options, axes_of, default_quantities, start_devices
    from ._sweep_result import sweep_columns, sweep_result, sweep_tables

    start_devices(devices)
    if coordinator is not None:
        import jax

        jax.distributed.initialize(coordinator, processes, process)
    start_jax()
    scene = changed_scene(machine, sets or (), designs or ())
    axes = axes_of(scene, over, samples is not None)
    asked = quantity or default_quantities(scene)
    from ..sweeping import sweep as run

    try:
        found = run(
            scene,
            axes,
            asked,
            samples=samples,
            sampling=sampling.value.replace("-", "_"),
            seed=seed,
            options=analysis_options(scene, nodes, reversals, tolerance),
            out=None if out is None else out / "sweep.zarr",
            batch=batch,
            devices=devices,
        )
    except KeyboardInterrupt:
        kept = (
            f"{out / 'sweep.zarr'} is kept; go on with the same command"
            if out
            else ("nothing was kept; with --out FOLDER a stopped sweep goes on")
        )
        typer.echo(f"stopped; {kept}", err=True)
        raise typer.Exit(STOPPED) from None
    if process > 0:  # the first one shows what all have found
        return
    result = sweep_result(found, scene.name, out)
    tables = list(sweep_tables(found, result))
    if out is not None:
        from ..plot import sweep_figures

        with spinner("Drawing ..."):
            figures = sweep_figures(found, scene.name)
            write_results(out, figures, result, scene, tables, {"designs": sweep_columns(found)})
    show_results(result, tables, as_json, out)


def _check(sampling, samples, tolerance, nodes, reversals, coordinator, processes, process, out):
    if samples is None and sampling is not Sampling.sobol:
        raise CommandError(f"--sampling {sampling}: has no meaning without --samples")
    if samples is not None and samples < 1:
        raise CommandError(f"--samples {samples}: must be >= 1")
    if tolerance is not None and not 0 < tolerance < 1:
        raise CommandError(f"--solver-tolerance {tolerance:g}: must be > 0 and < 1")
    if nodes is not None and not 2 <= nodes <= 200:
        raise CommandError(f"--solver-nodes {nodes}: must be >= 2 and <= 200")
    if reversals is not None and not 0 <= reversals <= 16:
        raise CommandError(f"--solver-reversals {reversals}: must be >= 0 and <= 16")
    if (coordinator is None) != (processes == 1):
        raise CommandError("--coordinator: goes with --processes of 2 or more, and only with them")
    if not 0 <= process < processes:
        raise CommandError(f"--process {process}: must be >= 0 and < {processes}")
    if processes > 1 and out is None:
        raise CommandError("--out: is needed where several processes share a sweep")
