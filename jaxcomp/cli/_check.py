"""`jaxcomp check`: what a scene file holds, or everything that is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import typer
from rich.markup import escape

import jaxcomp as jc

from .._core.display import RPM, axes_words
from . import _options as opt
from ._arguments import changed_scene
from ._output import print_json, show_results
from ._start import reports_errors, show_error, start_jax
from ._tables import row_table


@reports_errors
def check(
    machine: opt.Machine,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
) -> None:
    """Read a scene file: show its parts and what follows from them, or all its errors.

    Exit code 2 if anything is wrong. Unusual values are pointed at, but are no errors.

    Example: [bold]jaxcomp check my-machine.toml --set mechanism.bore=52mm[/bold]
    """
    start_jax()
    try:
        scene = changed_scene(machine, sets)
    except jc.scene.SceneError as error:
        found = [error, *error.others]
        if as_json:
            print_json(error_result(machine, found))
        for one in found:
            show_error(one)
        if len(found) > 1:
            typer.echo(f"{len(found)} errors", err=True)
        raise typer.Exit(2) from None
    result = check_result(scene)
    show_results(result, check_tables(result), as_json)


def error_result(file: str, errors: Sequence[jc.scene.SceneError]) -> dict[str, Any]:
    """All errors of a file; the keys are stable."""

    def plainly(value):
        return value if isinstance(value, str | int | float | bool | None) else str(value)

    rows = [{"key": e.key, "value": plainly(e.value), "problem": e.problem} for e in errors]
    return {"file": file, "ok": False, "errors": rows}


def check_result(scene: jc.scene.Scene) -> dict[str, Any]:
    """Parts, what follows from them, commands for the scene, what it leaves out, unusual values."""
    rows = jc.scene.describe(scene)
    words = {row.path[: -len(".type")]: row.value for row in rows if row.path.endswith(".type")}

    def part(name):
        own = [row for row in rows if row.path.startswith(f"{name}.")]
        own = [row for row in own if not row.path.endswith(".type")]
        given = [row for row in own if row.given is not None]
        return {
            "type": words.get(name, ""),
            "values": len(own),
            "defaults": len(own) - len(given),
            "without_source": sum(not row.source for row in given),
        }

    parts = {name: part(name) for name, x in scene.document.items() if isinstance(x, dict | list)}
    return {
        "machine": scene.name,
        "description": scene.description,
        "file": scene.file,
        "ok": True,
        "parts": {name: counts for name, counts in parts.items() if counts["values"]},
        "follows": [{"what": what, "value": x, "unit": unit} for what, x, unit in _follows(scene)],
        "commands": _commands(scene),
        "left_out": list(jc.scene.left_out(scene)),
        "unusual": [value._asdict() for value in jc.scene.implausible_values(scene)],
    }


def check_tables(result: dict[str, Any]):
    """Tables of `check_result`."""
    title = f"{result['machine']}: {result['description']}"
    heads = ("Part", "Type", "Values", "By default", "Without source")
    yield row_table(title, heads, ((n, *p.values()) for n, p in result["parts"].items()), texts=2)
    follows = (row.values() for row in result["follows"])
    yield row_table(None, ("What follows", ("", ".5g"), ""), map(tuple, follows), texts=3)
    for value in result["unusual"]:
        shown = escape(f"{value['path']}: {value['what']}, usual is {value['usual']}")
        yield f"[yellow]unusual[/yellow]  {shown}"
    yield f"left out  {escape(', '.join(result['left_out']) or 'nothing')}"
    verdict = "valid; look at the unusual values again" if result["unusual"] else "valid"
    yield f"[green]{verdict}[/green]; for jaxcomp {', '.join(result['commands'])}"


def _commands(scene: jc.scene.Scene) -> list[str]:
    """The commands that have something to work on."""
    design = ["compare", "sensitivity", "optimise", "sweep", "tolerance"]
    out = [] if scene.compressor is None else ["run", "simulate", "animate", *design]
    gas = None if scene.compressor is None else scene.compressor.gas
    out += ["map"] if hasattr(getattr(gas, "fluid", None), "saturation") else []
    if "rotor" in scene.parts:
        loads = scene.parts.get("loads")
        out += ["modes"]
        if isinstance(loads, jc.rotor.LoadCase) and (loads.loads or loads.crank):
            out += ["respond"]
        if {"loads", "balancing"} <= set(scene.parts):
            out += ["balance", *design[1:]]
    return list(dict.fromkeys(out))


def _of_cylinders(compressor: jc.Compressor):
    """What follows from how cylinders stand about the crankshaft."""
    import numpy as np

    from .._core.each import AbstractEach
    from .._core.fields import listed, subparts

    crankshaft = compressor.crankshaft
    intervals = np.rad2deg(np.asarray(crankshaft.firing_intervals))
    even = np.ptp(intervals) < 0.01
    shown = f"{intervals[0]:.4g}" if even else ", ".join(f"{x:.4g}" for x in intervals)
    parts = {"gas": compressor.gas, "friction": compressor.friction}
    kinds = [
        f"the kind of {section}.{path}".rstrip(".")
        for section, whole in parts.items()
        for path, part in subparts(whole)
        if isinstance(part, AbstractEach)
    ]
    differing = ", ".join([*listed((compressor.mechanism, compressor.gas)), *kinds])
    yield "Cylinders", crankshaft.count, f"different in {differing}" if differing else ""
    yield "Axes", axes_words(crankshaft.bank_angle), ""
    gas = getattr(compressor.gas, "head_end", compressor.gas)
    suction = np.unique(np.atleast_1d(getattr(gas, "suction_pressure", 0.0)))
    if suction.size > 1:
        between = ", ".join(f"{1e-5 * p:.5g}" for p in suction[1:])
        yield "Pressure between stages", f"{between} bar", ""
    yield "Between top dead centres", f"{shown} deg", "even" if even else "uneven"
    places = getattr(crankshaft.main_journal, "position", None)
    if places is not None:
        rods = np.asarray(crankshaft.position)
        outside = int(np.sum((rods < np.min(places)) | (rods > np.max(places))))
        yield "Rods outside the main bearings", outside, "overhung" if outside else ""


def _of_valves(gas: jc.cylinder.Cylinder, speed: float):
    """What follows from the lines and valves of a cylinder, and what it leaves out."""
    suction = gas.suction.state(gas.fluid)
    behind = gas.discharge.states(gas.fluid, suction)[0]
    yield "Pressure ratio", float(behind.p / suction.p), ""
    for name, valve in zip(("suction", "discharge"), gas.valves, strict=True):
        if valve.oscillator is not None:
            own = math.sqrt(float(valve.oscillator.stiffness / valve.oscillator.mass))
            note = f"{own / speed:.3g} times the crank's speed"
            yield f"Natural frequency of the {name} valve", own / (2 * math.pi), f"Hz, {note}"
    lines = ("suction", suction, gas.suction.plenums), ("discharge", behind, gas.discharge.plenums)
    for name, state, plenums in lines:
        for number, plenum in enumerate(plenums, 1):
            stiffness = plenum.neck_area / (plenum.volume * plenum.neck_length)
            own = float(state.speed_of_sound) * math.sqrt(float(stiffness))
            note = f"Hz, {own / speed:.3g} times the crank's speed"
            yield f"Resonance of {name} plenum {number}", own / (2 * math.pi), note
    if gas.walls is not None:
        total = float(gas.walls.conductance)
        yield "Conductance of the wall", total, "W/K in all; its temperature is an unknown"
    if not gas.inert:
        yield "Flow through the ports", "quasi-steady", "values only: derivatives need port_length"
    yield (
        "Not modelled",
        "stratified gas, pulsation in the lines beyond their plenums",
        "oil in the gas, wet compression",
    )


def _follows(scene: jc.scene.Scene):
    """(name, value, unit) of what follows from the entries, in shown units."""
    from .._core.fields import of_cylinder

    names = jc.study.variable_names(jc.machine.machine_of(scene))
    rules = ", ".join(name for name in names if name in jc.study.design_rules)
    yield "Variables for optimise and sweep", len(names), f"by rule: {rules}" if rules else ""
    if scene.compressor is not None:
        mechanism: Any = of_cylinder(scene.compressor.mechanism)
        gas = of_cylinder(scene.compressor.gas)
        yield "Stroke", 1e3 * float(mechanism.stroke), "mm"
        yield "Swept volume", 1e6 * float(mechanism.swept_volume), "cm3"
        if scene.compressor.crankshaft.count > 1:
            yield from _of_cylinders(scene.compressor)
        bore = getattr(mechanism, "bore", None)
        if bore is not None:
            yield "Stroke over bore", float(mechanism.stroke / bore), ""
        ratio = getattr(mechanism, "conrod_ratio", None)
        if ratio is not None:
            yield "Crank radius over rod length", float(ratio), ""
        if isinstance(gas, jc.gas.PolytropicCycle):
            yield "Pressure ratio", float(gas.discharge_pressure / gas.suction_pressure), ""
        speed = float(scene.compressor.motor.speed_guess)
        if isinstance(gas, jc.cylinder.Cylinder):
            yield from _of_valves(gas, speed)
        yield "Speed, about", speed * RPM, "rpm"
        yield "Mean piston speed, about", float(mechanism.stroke) * speed / math.pi, "m/s"
        yield "Degrees of freedom of the crank", 1, ""
    model = scene.parts.get("rotor")
    if isinstance(model, jc.rotor.RotorModel):
        count = len(jc.rotor.node_names(model))
        slaved = sum(len(body.nodes) for body in model.bodies)
        yield "Nodes of the rotor model", count, f"{slaved} of them fixed to rigid bodies"
        conditions = [axis for link in model.links if link.held for axis in link.axes]
        held = sum(axis in jc.rotor.AXES[model.dof] for axis in conditions)
        less = f", less {held} of pinned and clamped links" if held else ""
        yield (
            "Degrees of freedom",
            (count - slaved) * model.dof - held,
            f"{model.dof} a free node{less}",
        )
        for name, group in zip(jc.rotor.subset_names(model), jc.rotor.subsets(model), strict=True):
            nodes = ", ".join(str(node) for node in group)
            yield f"Subset {name}", nodes if len(nodes) <= 60 else f"{nodes[:57]}...", "nodes"
    block = scene.parts.get("suspension")
    if isinstance(block, jc.vibration.Suspension):
        hertz = jc.rotor.undamped_modes(block.rotor, 6).frequency / (2 * math.pi)
        text = ", ".join(f"{f:.3g}" for f in hertz)
        yield "Block on its springs, 6 degrees of freedom", text, "Hz"
