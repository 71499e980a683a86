"""`jaxcomp check`: what a machine file holds, or everything that is wrong with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer
from rich.markup import escape

import jaxcomp as jc

from .._core.declared import tree_of
from . import _options as opt
from ._output import print_json, show_results
from ._start import show_error
from ._tables import row_table

if TYPE_CHECKING:
    from ._check_content import FileContent


def check(case: opt.Case, as_json: opt.AsJson = False) -> None:
    """Read a machine file: show its parts and what follows from them, or all its errors.

    Exit code 2 if anything is wrong. Unusual values are pointed at, but are no errors.

    Example: [bold]jaxcomp check my-machine.toml --set mechanism.bore=52mm[/bold]
    """
    from ._check_content import check_result, error_result

    try:
        scene = case.scene()
    except jc.scene.SceneError as error:
        errors = [error, *error.others]
        if as_json:
            print_json(tree_of(error_result(case.machine, errors)))
        for problem in errors:
            show_error(problem)
        if len(errors) > 1:
            typer.echo(f"{len(errors)} errors", err=True)
        raise typer.Exit(2) from None
    content = check_result(scene)
    show_results(content, check_tables(content), as_json)


def check_tables(content: FileContent):
    """Tables of `check_result`."""
    title = f"{content.machine}: {content.description}"
    heads = ("Part", "Type", "Values", "By default", "Without source")
    parts = []
    for name, contents in content.parts.items():
        parts.append((name, *contents.entries().values()))
    yield row_table(title, heads, parts, texts=2)
    follows = [(row.what, row.value, row.unit) for row in content.follows]
    yield row_table(None, ("What follows", ("", ".5g"), ""), follows, texts=3)
    for path, what, usual in content.unusual:
        yield f"[yellow]unusual[/yellow]  {escape(f'{path}: {what}, usual is {usual}')}"
    if content.examples:
        yield (
            f"[yellow]examples[/yellow]  {content.examples} values are examples: write those of your "
            "machine, each with its source"
        )
    yield f"left out  {escape(', '.join(content.left_out) or 'nothing')}"
    verdict = "valid; look at the unusual values again" if content.unusual else "valid"
    yield f"[green]{verdict}[/green]; for jaxcomp {', '.join(content.commands)}"
