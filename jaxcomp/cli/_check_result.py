"""What `jaxcomp check` tells of a scene."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape

from ..design import design_rules, variable_names
from ..gas import PolytropicCycle
from ..machine import machine_of
from ..rotor import AXES, LoadCase, RotorModel, node_names, subset_names, subsets
from ..scene import Scene, SceneError, describe, implausible_values
from ..shaking import Suspension, natural_frequencies
from ._tables import _table


def error_result(file: str, errors: Sequence[SceneError]) -> dict[str, Any]:
    """All errors of a file; the keys are stable."""
    rows = [{"key": e.key, "value": _plain(e.value), "problem": e.problem} for e in errors]
    return {"file": file, "ok": False, "errors": rows}


def check_result(scene: Scene) -> dict[str, Any]:
    """Parts, what follows from them, commands that take the scene, and unusual values."""
    rows = describe(scene)
    words = {row.path[: -len(".type")]: row.value for row in rows if row.path.endswith(".type")}
    names = [name for name in scene.document if isinstance(scene.document[name], dict | list)]
    numbers = [row for row in rows if not row.path.endswith(".type")]
    return {
        "machine": scene.name,
        "description": scene.description,
        "file": scene.file,
        "ok": True,
        "parts": {
            name: {"type": words.get(name, ""), **_counts(numbers, name)}
            for name in names
            if any(row.path.startswith(f"{name}.") for row in numbers)
        },
        "follows": [
            dict(zip(("what", "value", "unit"), row, strict=True)) for row in _follows(scene)
        ],
        "commands": _commands(scene),
        "unusual": [doubt._asdict() for doubt in implausible_values(scene)],
    }


def check_tables(result: dict[str, Any]):
    """Tables of `check_result`."""
    title = escape(f"{result['machine']}: {result['description']}")
    parts = _table(title, "Part", "Type", "Values", "By default", "Without source", numbers=True)
    parts.columns[1].justify = "left"
    for name, part in result["parts"].items():
        counts = [str(part[key]) for key in ("values", "defaults", "without_source")]
        parts.add_row(name, part["type"], *counts)
    yield parts
    follows = _table(None, "What follows", "", "")
    for row in result["follows"]:
        value = row["value"] if isinstance(row["value"], str) else f"{row['value']:.5g}"
        follows.add_row(*map(escape, (row["what"], value, row["unit"])))
    yield follows
    for doubt in result["unusual"]:
        text = escape(f"{doubt['path']}: {doubt['what']}, usual is {doubt['usual']}")
        yield f"[yellow]unusual[/yellow]  {text}"
    verdict = "valid" if not result["unusual"] else "valid; look at the unusual values again"
    yield f"[green]{verdict}[/green]; for jaxcomp {', '.join(result['commands'])}"


def _counts(rows, name: str) -> dict[str, int]:
    own = [row for row in rows if row.path.startswith(f"{name}.")]
    given = [row for row in own if row.given is not None]
    return {
        "values": len(own),
        "defaults": len(own) - len(given),
        "without_source": sum(not row.source for row in given),
    }


def _commands(scene: Scene) -> list[str]:
    """The commands that have something to work on."""
    design = ["compare", "sensitivity", "optimise", "sweep", "tolerance"]
    out = [] if scene.compressor is None else ["run", "animate", *design]
    if "rotor" in scene.parts:
        loads = scene.parts.get("loads")
        out += ["modes"]
        out += ["respond"] if isinstance(loads, LoadCase) and loads.loads else []
        if {"loads", "balancing"} <= set(scene.parts):
            out += ["balance", *design[1:]]
    return list(dict.fromkeys(out))


def _follows(scene: Scene):
    """(what, value, unit) in the units of a drawing."""
    names = variable_names(machine_of(scene))
    rules = ", ".join(name for name in names if name in design_rules)
    yield "Variables for optimise and sweep", len(names), f"by rule: {rules}" if rules else ""
    if scene.compressor is not None:
        mechanism, gas = scene.compressor.mechanism, scene.compressor.gas
        yield "Stroke", 1e3 * float(mechanism.stroke), "mm"
        yield "Swept volume", 1e6 * float(mechanism.swept_volume), "cm3"
        bore = getattr(mechanism, "bore", None)
        if bore is not None:
            yield "Stroke over bore", float(mechanism.stroke / bore), ""
        ratio = getattr(mechanism, "conrod_ratio", None)
        if ratio is not None:
            yield "Crank radius over rod length", float(ratio), ""
        if isinstance(gas, PolytropicCycle):
            yield "Pressure ratio", float(gas.discharge_pressure / gas.suction_pressure), ""
        speed = float(scene.compressor.motor.speed_guess)
        yield "Speed, about", speed * 30 / math.pi, "rpm"
        yield "Mean piston speed, about", float(mechanism.stroke) * speed / math.pi, "m/s"
        yield "Degrees of freedom of the crank", 1, ""
    model = scene.parts.get("rotor")
    if isinstance(model, RotorModel):
        count = len(node_names(model))
        slaved = sum(len(body.nodes) for body in model.bodies)
        yield "Nodes of the rotor model", count, f"{slaved} of them fixed to rigid bodies"
        conditions = [axis for link in model.links if link.held for axis in link.axes]
        held = sum(axis in AXES[model.dof] for axis in conditions)
        less = f", less {held} of pinned and clamped links" if held else ""
        yield (
            "Degrees of freedom",
            (count - slaved) * model.dof - held,
            f"{model.dof} a free node{less}",
        )
        for name, group in zip(subset_names(model), subsets(model), strict=True):
            nodes = ", ".join(str(node) for node in group)
            yield f"Subset {name}", nodes if len(nodes) <= 60 else f"{nodes[:57]}...", "nodes"
    block = scene.parts.get("suspension")
    if isinstance(block, Suspension):
        hertz = np.asarray(natural_frequencies(block)) / (2 * math.pi)
        text = ", ".join(f"{f:.3g}" for f in hertz)
        yield "Block on its springs, 6 degrees of freedom", text, "Hz"


def _plain(value: Any) -> Any:
    return value if isinstance(value, str | int | float | bool | None) else str(value)
