"""`jaxcomp simulate`: crank motion in time, from rest or a speed, with the motor on or off."""

import enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from ._arguments import assignments, changed_scene
from ._errors import CommandError, reports_errors
from ._options import AsJson, Designs, Machine, Out, Sets
from ._output import show_results, write_results
from ._start import start_jax
from ._tables import _table, words


class Method(enum.StrEnum):
    """Solvers of diffrax: two explicit ones, then two implicit ones."""

    tsit5 = "tsit5"
    dopri8 = "dopri8"
    kvaerno3 = "kvaerno3"
    kvaerno5 = "kvaerno5"


@reports_errors
def simulate(
    machine: Machine,
    duration: Annotated[str, typer.Option(metavar="TIME", help="Time to integrate, e.g. 2s.")],
    speed: Annotated[
        str, typer.Option(metavar="SPEED", help="Speed at the start, e.g. 900rpm.")
    ] = "0 rpm",
    angle: Annotated[
        str, typer.Option(metavar="ANGLE", help="Crank angle at the start, e.g. 90deg.")
    ] = "0 deg",
    power_off: Annotated[
        str | None, typer.Option(metavar="TIME", help="Instant at which the motor is switched off.")
    ] = None,
    solver: Annotated[
        Method,
        typer.Option(
            help="Method of diffrax; an implicit one (kvaerno3, kvaerno5) for a stiff motor or a "
            "narrow transition of friction."
        ),
    ] = Method.tsit5,
    tolerance: Annotated[
        float, typer.Option(help="Relative and absolute tolerance of a step.")
    ] = 1e-8,
    samples: Annotated[int, typer.Option(min=2, help="Number of instants listed.")] = 501,
    swing_back: Annotated[
        bool,
        typer.Option("--swing-back", help="Go on where the crank comes to rest or turns back."),
    ] = False,
    sets: Sets = None,
    designs: Designs = None,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Integrate the crank in time: run-up, running, power-off and stop.

    The motor needs a torque at every speed: [bold]slip_line[/bold], [bold]kloss[/bold] or
    [bold]constant_torque[/bold].

    Example: [bold]jaxcomp simulate mayekawa-wbhe --duration 3s --power-off 1s --set 'motor={type =
    "kloss", pull_out_torque = "250 N m", pull_out_slip = 0.3, synchronous_speed = "1050 rpm"}' --out
    result[/bold]
    """
    if not 0 < tolerance < 1:
        raise CommandError(f"--tolerance {tolerance:g}: must be > 0 and < 1")
    import diffrax

    from .._waits import spinner
    from ..crank import TimeIntegration
    from ..crank import simulate as integrate
    from ..scene import to_si

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), designs or ())
    end = float(to_si(duration, "s", "--duration"))
    if not end > 0:
        raise CommandError(f"--duration {duration}: must be > 0")
    off = None if power_off is None else float(to_si(power_off, "s", "--power-off"))
    methods = {name.lower(): getattr(diffrax, name) for name in
               ("Tsit5", "Dopri8", "Kvaerno3", "Kvaerno5")}  # fmt: skip
    options = TimeIntegration(methods[solver](), tolerance, samples=samples)
    with spinner("Integrating (the first time it is compiled as well) ..."):
        found = integrate(
            scene.as_compressor(),
            end,
            angle=float(to_si(angle, "rad", "--angle")),
            speed=float(to_si(speed, "rad/s", "--speed")),
            power_off=off,
            until_rest=not swing_back,
            options=options,
        )
    result = _result(scene, found) | {
        "solver": solver.value,
        "tolerance": tolerance,
        "power_off": off,
        "set": assignments(sets or (), "--set"),
        "design": assignments(designs or (), "--design"),
    }
    tables = [_table_of(result)]
    if out is not None:
        with spinner("Drawing ..."):
            _write(out, scene, found, off, result, tables, write_results)
    show_results(result, tables, as_json, out)


def _result(scene, found) -> dict[str, Any]:
    """The motion in plain numbers in SI units."""
    import numpy as np

    from .._status import Status

    time, angle, speed = (np.asarray(x) for x in (found.time, found.state.angle, found.state.speed))
    energy, highest = found.energy, float(speed.max())
    return {
        "machine": scene.name,
        "file": scene.file,
        "end_time": float(found.end_time),
        "stopped": bool(found.stopped),
        "revolutions": float((angle[-1] - angle[0]) / (2 * np.pi)),
        "end_angle": float(angle[-1]),
        "end_speed": float(speed[-1]),
        "highest_speed": highest,
        "time_of_highest_speed": float(time[speed.argmax()]),
        "motor_work": float(energy.motor_work[-1]),
        "gas_work": float(energy.gas_work[-1]),
        "losses": {name: float(work[-1]) for name, work in energy.losses.items()},
        "kinetic_energy_gained": float(found.kinetic_energy[-1] - found.kinetic_energy[0]),
        "energy_residual": float(found.residual[-1]),
        "steps": int(found.steps),
        "converged": str(Status[found.status]) == "converged",
        "status": Status[found.status],
        "course": {"time": time.tolist(), "angle": angle.tolist(), "speed": speed.tolist()},
    }


def _table_of(result: dict[str, Any]):
    import math

    table = _table(escape(f"{result['machine']} in time"), "Motion", "", "")
    rpm = 30 / math.pi
    end = "the crank came to rest" if result["stopped"] else "end of the time asked for"
    table.add_row("End", f"{result['end_time']:.5g} s", end)
    table.add_row("Revolutions", f"{result['revolutions']:.5g}", "")
    table.add_row("Speed at the end", f"{result['end_speed'] * rpm:.5g} rpm", "")
    at = f"at {result['time_of_highest_speed']:.4g} s"
    table.add_row("Highest speed", f"{result['highest_speed'] * rpm:.5g} rpm", at)
    table.add_section()
    table.add_row("Work of the motor", f"{result['motor_work']:.5g} J", "since the start")
    table.add_row("Work on the gas", f"{result['gas_work']:.5g} J", "")
    for name, loss in result["losses"].items():
        table.add_row(f"{words(name)}, friction", f"{loss:.4g} J", "")
    table.add_row("Gained by the motion", f"{result['kinetic_energy_gained']:.5g} J", "")
    closure = f"{result['energy_residual']:.1e}"
    table.add_row("Energy closure", closure, "work that is none of these, over the work done")
    table.add_section()
    table.add_row("Solver", result["solver"], f"{result['steps']} steps at {result['tolerance']:g}")
    return table


def _write(folder: Path, scene, found, off, result, tables, write_results) -> None:
    from ..plot import transient_figure

    figures = {"motion": transient_figure(found, scene.name, off)}
    write_results(folder, figures, result, scene, tables, {"motion": found.columns()})
