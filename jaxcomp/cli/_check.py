"""`jaxcomp check`: what a machine file holds, or everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer
from rich.markup import escape

import jaxcomp as jc

from . import _options as opt
from ._output import print_json, show_results
from ._start import show_error
from ._tables import row_table


def check(case: opt.Case, as_json: opt.AsJson = False) -> None:
    """Read a machine file: show its parts and what follows from them, or all its errors.

    Exit code 2 if anything is wrong. Unusual values are pointed at, but are no errors.

    Example: [bold]jaxcomp check my-machine.toml --set mechanism.bore=52mm[/bold]
    """
    try:
        scene = case.scene()
    except jc.scene.SceneError as error:
        errors = [error, *error.others]
        if as_json:
            print_json(error_result(case.machine, errors))
        for problem in errors:
            show_error(problem)
        if len(errors) > 1:
            typer.echo(f"{len(errors)} errors", err=True)
        raise typer.Exit(2) from None
    result = check_result(scene)
    show_results(result, check_tables(result), as_json)


def error_result(file: str, errors: Sequence[jc.scene.SceneError]) -> dict[str, Any]:
    """All errors of a file; the keys are stable."""

    rows = []
    for error in errors:
        value = error.value
        if not isinstance(value, str | int | float | bool | None):
            value = str(value)
        rows.append({"key": error.key, "value": value, "problem": error.problem})
    return {"file": file, "ok": False, "errors": rows}


def check_result(scene: jc.scene.Scene) -> dict[str, Any]:
    """Parts, what follows from them, commands for the scene, what it leaves out, unusual values."""
    from ..scene._describe import left_out
    from ..scene.contents import example_values, part_contents
    from ..scene.follows import follows

    consequences = []
    for what, value, unit in follows(scene):
        consequences.append({"what": what, "value": value, "unit": unit})
    return {
        "machine": scene.name,
        "description": scene.description,
        "file": scene.file,
        "ok": True,
        "parts": part_contents(scene),
        "examples": example_values(scene),
        "follows": consequences,
        "commands": _commands(scene),
        "left_out": list(left_out(scene)),
        "unusual": list(jc.scene.implausible_values(scene)),
    }


def check_tables(result: dict[str, Any]):
    """Tables of `check_result`."""
    title = f"{result['machine']}: {result['description']}"
    heads = ("Part", "Type", "Values", "By default", "Without source")
    parts = [(name, *part.values()) for name, part in result["parts"].items()]
    yield row_table(title, heads, parts, texts=2)
    follows = [tuple(row.values()) for row in result["follows"]]
    yield row_table(None, ("What follows", ("", ".5g"), ""), follows, texts=3)
    for path, what, usual in result["unusual"]:
        yield f"[yellow]unusual[/yellow]  {escape(f'{path}: {what}, usual is {usual}')}"
    if result["examples"]:
        yield (
            f"[yellow]examples[/yellow]  {result['examples']} values are examples: write those of your "
            "machine, each with its source"
        )
    yield f"left out  {escape(', '.join(result['left_out']) or 'nothing')}"
    verdict = "valid; look at the unusual values again" if result["unusual"] else "valid"
    yield f"[green]{verdict}[/green]; for jaxcomp {', '.join(result['commands'])}"


def _commands(scene: jc.scene.Scene) -> list[str]:
    """The commands that have something to work on."""
    design = ["compare", "sensitivity", "optimise", "sweep", "tolerance"]
    out = []
    if scene.compressor is not None:
        out += ["run", "simulate", "animate", *design]
        if hasattr(getattr(scene.compressor.gas, "fluid", None), "saturation"):
            out += ["map"]
    if "rotor" in scene.parts:
        loads = scene.parts.get("loads")
        out += ["modes"]
        if isinstance(loads, jc.rotor.LoadCase) and (loads.loads or loads.crank):
            out += ["respond"]
        if {"loads", "balancing"} <= set(scene.parts):
            out += ["balance", *design[1:]]
    return list(dict.fromkeys(out))
