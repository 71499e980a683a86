"""`jaxcomp simulate`: crank motion in time, from rest or a speed, with the motor on or off."""

import enum
import math
from typing import Annotated, Any

import typer

import jaxcomp as jc

from .._shown import RPM
from ._arguments import assignments, changed_scene
from ._errors import CommandError, reports_errors
from ._json import plain
from ._options import AsJson, Designs, Machine, Out, Sets
from ._output import hand_out
from ._start import start_jax
from ._tables import row_table, words


class Method(enum.StrEnum):
    """Solvers of diffrax: two explicit ones, then two implicit ones."""

    tsit5 = "tsit5"
    dopri8 = "dopri8"
    kvaerno3 = "kvaerno3"
    kvaerno5 = "kvaerno5"


# Instants of a long run with valves, whose files would otherwise grow with it.
_MOST_LISTED = 16384


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
            "narrow transition of friction. Machines with valves have a method of their own."
        ),
    ] = Method.tsit5,
    tolerance: Annotated[
        float, typer.Option(help="Relative and absolute tolerance of a step.")
    ] = 1e-8,
    samples: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Number of instants listed; 501 if absent, with valves some 200 for each revolution.",
        ),
    ] = None,
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
    [bold]constant_torque[/bold]. Cylinders with valves begin with the gas of the suction line.

    Example: [bold]jaxcomp simulate mayekawa-wbhe --duration 3s --power-off 1s --set 'motor={type =
    "kloss", pull_out_torque = "250 N m", pull_out_slip = 0.3, synchronous_speed = "1050 rpm"}' --out
    result[/bold]
    """
    if not 0 < tolerance < 1:
        raise CommandError(f"--tolerance {tolerance:g}: must be > 0 and < 1")
    import diffrax

    from .._waits import spinner

    start_jax(once=True)
    scene = changed_scene(machine, sets or (), designs or ())
    end = float(jc.scene.to_si(duration, "s", "--duration"))
    if not end > 0:
        raise CommandError(f"--duration {duration}: must be > 0")
    off = None if power_off is None else float(jc.scene.to_si(power_off, "s", "--power-off"))
    method = getattr(diffrax, solver.capitalize())()
    compressor = scene.as_compressor()
    valves = isinstance(compressor.gas, jc.cylinder.Cylinder)
    steps, listed = 65536, 501
    if valves:
        # Some hundred steps a revolution, more with every cylinder; powers of two share programs.
        count = 1 if compressor.cylinders is None else compressor.cylinders.count
        turns = end * float(compressor.motor.speed_guess) / (2 * math.pi)
        steps = 2 ** math.ceil(math.log2(2000 + 1000 * count * turns))
        listed = 1 + min(2 ** math.ceil(math.log2(500 + 200 * turns)), _MOST_LISTED)
    with spinner("Integrating (the first time it is compiled as well) ..."):
        found = jc.crank.simulate(
            compressor,
            end,
            angle=float(jc.scene.to_si(angle, "rad", "--angle")),
            speed=float(jc.scene.to_si(speed, "rad/s", "--speed")),
            power_off=off,
            until_rest=not swing_back,
            options=jc.crank.TimeIntegration(method, tolerance, steps, samples or listed),
        )
    result = simulate_result(scene, found) | {
        "solver": "Dormand and Prince, events located" if valves else solver.value,
        "tolerance": tolerance,
        "power_off": off,
        "set": assignments(sets or (), "--set"),
        "design": assignments(designs or (), "--design"),
    }

    def figures():
        made = {"motion": jc.plot.transient_figure(found, scene.name, off)}
        if found.gas is not None:
            made["gas"] = jc.plot.transient_gas_figure(found, scene.name, off)
        return made

    tables = [simulate_table(result)]
    hand_out(result, tables, as_json, out, figures, scene, {"motion": found.columns()})


def simulate_result(scene, found) -> dict[str, Any]:
    """The motion in plain numbers in SI units."""
    import numpy as np

    from .._status import Status

    time, angle, speed = (np.asarray(x) for x in (found.time, found.state.angle, found.state.speed))
    energy = found.energy
    return plain(
        {
            "machine": scene.name,
            "file": scene.file,
            "end_time": found.end_time,
            "stopped": found.stopped,
            "revolutions": (angle[-1] - angle[0]) / (2 * np.pi),
            "end_angle": angle[-1],
            "end_speed": speed[-1],
            "highest_speed": speed.max(),
            "time_of_highest_speed": time[speed.argmax()],
            "motor_work": energy.motor_work[-1],
            "gas_work": energy.gas_work[-1],
            "losses": {name: work[-1] for name, work in energy.losses.items()},
            "kinetic_energy_gained": found.kinetic_energy[-1] - found.kinetic_energy[0],
            "energy_residual": found.residual[-1],
            **_of_gas(found),
            "steps": found.steps,
            "converged": Status[found.status] == "converged",
            "status": Status[found.status],
            "course": {"time": time, "angle": angle, "speed": speed},
        }
    )


def _of_gas(found) -> dict[str, Any]:
    """What came out of cylinders with valves since the start."""
    if found.gas is None:
        return {}
    import numpy as np

    totals, pressure = found.gas.totals, np.asarray(found.gas.pressure)
    return {
        "delivered_mass": np.sum(totals.discharge),
        "highest_pressure": pressure.max(),
        "highest_temperature": np.asarray(found.gas.temperature).max(),
    }


def simulate_table(result: dict[str, Any]):
    """End of the motion, energies, solver."""
    end = "the crank came to rest" if result["stopped"] else "end of the duration"
    closure = f"{result['energy_residual']:.1e}"
    rows = (
        ("End", f"{result['end_time']:.5g} s", end),
        ("Revolutions", f"{result['revolutions']:.5g}", ""),
        ("Speed at the end", f"{result['end_speed'] * RPM:.5g} rpm", ""),
        (
            "Highest speed",
            f"{result['highest_speed'] * RPM:.5g} rpm",
            f"at {result['time_of_highest_speed']:.4g} s",
        ),
        (),
        ("Work of the motor", f"{result['motor_work']:.5g} J", "since the start"),
        ("Work on the gas", f"{result['gas_work']:.5g} J", ""),
        *(
            (f"{words(name)}, friction", f"{loss:.4g} J", "")
            for name, loss in result["losses"].items()
        ),
        ("Gained by the motion", f"{result['kinetic_energy_gained']:.5g} J", ""),
        *(
            (
                (),
                ("Mass delivered", f"{result['delivered_mass'] * 1e3:.5g} g", ""),
                ("Highest pressure", f"{result['highest_pressure'] / 1e5:.5g} bar", "listed"),
                (),
            )
            if "delivered_mass" in result
            else ()
        ),
        ("Energy closure", closure, "work that is none of these, over the work done"),
        (),
        ("Solver", result["solver"], f"{result['steps']} steps at {result['tolerance']:g}"),
    )
    return row_table(f"{result['machine']} in time", ("Motion", "", ""), rows, texts=3)
