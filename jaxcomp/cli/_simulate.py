"""`jaxcomp simulate`: crank motion in time, from rest or a speed, with the motor on or off."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.declared import Record, reading
from . import _options as opt
from ._output import Output, header
from ._start import CommandError, refuse, waiting
from ._tables import row_table, value_rows, words

# Instants of a long run with valves, whose files would otherwise grow with it.
_MOST_LISTED = 16384


# Solvers of diffrax: two explicit ones, then two implicit ones.
Method = Literal["tsit5", "dopri8", "kvaerno3", "kvaerno5"]


def simulate(
    *,
    duration: str | None = None,
    speed: str = "0 rpm",
    angle: str = "0 deg",
    power_off: str | None = None,
    solver: Method = "tsit5",
    tolerance: float = 1e-8,
    samples: Annotated[int | None, typer.Option(min=2)] = None,
    swing_back: bool = False,
    case: opt.DesignCase,
    output: Output,
) -> None:
    """Integrate the crank in time: run-up, running, power-off and stop.

    The motor needs a torque at every speed: [bold]slip_line[/bold], [bold]kloss[/bold] or
    [bold]constant_torque[/bold]. Cylinders with valves begin with the gas of the suction line.

    Example: [bold]jaxcomp simulate mayekawa-wbhe --duration 3s --power-off 1s --set 'motor={type =
    "kloss", pull_out_torque = "250 N m", pull_out_slip = 0.3, synchronous_speed = "1050 rpm"}' --out
    result[/bold]

    Args:
        duration (TIME): Time to integrate, e.g. 2s. Must be given.
        speed (SPEED): Speed at the start, e.g. 900rpm.
        angle (ANGLE): Crank angle at the start, e.g. 90deg.
        power_off (TIME): Instant at which the motor is switched off.
        solver: Method of diffrax; an implicit one (kvaerno3, kvaerno5) for a stiff motor or a narrow
            transition of friction. Machines with valves have a method of their own.
        tolerance: Relative and absolute tolerance of a step.
        samples: Number of instants listed; 501 if absent, with valves some 200 for each revolution.
        swing_back: Go on where the crank stops or turns back.
    """
    refuse(not 0 < tolerance < 1, f"--tolerance {tolerance:g}: must be > 0 and < 1")
    import diffrax

    from ..scene._units import to_si

    def si(text, unit, option):
        return float(to_si(text, unit, option))

    scene = case.scene(once=True)
    compressor = scene.as_compressor()  # a machine without one is told before the duration
    if duration is None:
        raise CommandError("--duration: is missing; e.g. --duration 2s")
    end = si(duration, "s", "--duration")
    refuse(not end > 0, f"--duration {duration}: must be > 0")
    off = None
    if power_off is not None:
        off = si(power_off, "s", "--power-off")
    steps = 65536
    instants = 501
    valves = isinstance(compressor.gas, jc.cylinder.Cylinder)
    if valves:
        steps, instants = _steps_with_valves(compressor, end, duration)
    method = getattr(diffrax, solver.capitalize())()
    with waiting("Integrating (the first time it is compiled as well) ..."):
        motion = jc.crank.simulate(
            compressor,
            end,
            angle=si(angle, "rad", "--angle"),
            speed=si(speed, "rad/s", "--speed"),
            power_off=off,
            until_rest=not swing_back,
            options=jc.crank.TimeIntegration(method, tolerance, steps, samples or instants),
        )

    def figures():
        from ..plot._transient import transient_figure, transient_gas_figure

        pictures = {"motion": transient_figure(motion, scene.name, off)}
        if motion.gas is not None:
            pictures["gas"] = transient_gas_figure(motion, scene.name, off)
        return pictures

    metadata = {
        **header(scene),
        "solver": "Dormand and Prince, events located" if valves else solver,
        **case.changes,
    }
    settings = SimulationSettings(tolerance, off)
    gas = compressor.gas
    from ..cylinder._waves import is_piped

    if isinstance(gas, jc.cylinder.Cylinder) and is_piped(gas):
        metadata["left_out"] = "pipes: the lines keep their mean pressures in time"
    curves = {"motion": motion.columns}
    output.emit(
        motion, simulate_tables, figures, scene, curves, metadata=metadata, numbers=settings
    )


@dataclass(frozen=True)
class SimulationSettings(Record):
    """Tolerance [-] of the integration, and time [s] at which the motor is switched off."""

    tolerance: float = reading("")
    power_off: float | None = reading("s")


def _steps_with_valves(compressor: jc.Compressor, end: float, duration: str) -> tuple[int, int]:
    """The most steps of a machine with valves up to an end [s], and the instants to list."""
    from ..crank._integration import MOST_STEPS

    # Some hundred steps a revolution, more with every cylinder; powers of two share programs.
    count = compressor.crankshaft.count
    revolutions = end * float(compressor.motor.speed_guess) / (2 * math.pi)
    limit = (MOST_STEPS - 2000) // (1000 * count)
    refuse(
        revolutions > limit,
        f"--duration {duration}: must be at most {limit} revolutions, with valves",
    )
    steps = 2 ** math.ceil(math.log2(2000 + 1000 * count * revolutions))
    return steps, 1 + min(2 ** math.ceil(math.log2(500 + 200 * revolutions)), _MOST_LISTED)


def simulate_tables(result: dict[str, Any]) -> Iterator[Any]:
    """End of the motion, energies, solver."""
    end = "the crank came to rest" if result["stopped"] else "end of the duration"
    losses = []
    for name, loss in result["losses"].items():
        losses.append((f"{words(name)}, friction", f"{loss:.4g} J", ""))
    of_gas = []
    if "delivered_mass" in result:
        pressure = ("Highest pressure", f"{result['highest_pressure'] / 1e5:.5g} bar", "listed")
        delivered = value_rows(result, [("Mass delivered", "delivered_mass", "g", "")])
        of_gas = [(), *delivered, pressure, ()]
    motion = (
        ("End", "end_time", "s", end),
        ("Revolutions", "revolutions", "", ""),
        ("Speed at the end", "end_speed", "rpm", ""),
        ("Highest speed", "highest_speed", "rpm", f"at {result['time_of_highest_speed']:.4g} s"),
        (),
        ("Work of the motor", "motor_work", "J", "since the start"),
        ("Work on the gas", "gas_work", "J", ""),
    )
    gained = (("Gained by the motion", "kinetic_energy_gained", "J", ""),)
    closure = f"{result['energy_residual']:.1e}"
    rows = (
        *value_rows(result, motion),
        *losses,
        *value_rows(result, gained),
        *of_gas,
        ("Energy closure", closure, "work that is none of these, over the work done"),
        (),
        ("Solver", result["solver"], f"{result['steps']} steps at {result['tolerance']:g}"),
    )
    if "left_out" in result:
        rows = (*rows, ("Left out", result["left_out"], ""))
    yield row_table(f"{result['machine']} in time", ("Motion", "", ""), rows, texts=3)
