"""Output of every command: a folder, JSON or tables."""

import io
from collections.abc import Callable, Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._command_line import command_line
from ._json import json_text, print_json

if TYPE_CHECKING:
    from ..scene import Scene


def hand_out(
    result: dict[str, Any],
    tables: Iterable[Any],
    as_json: bool,
    out: Path | None,
    figures: Callable[[], Mapping[str, Any]],
    scene: "Scene | None" = None,
    curves: Mapping[str, Mapping[str, Any]] | None = None,
    written: str = "Report, pictures, curves, result and scene",
) -> None:
    """Write the folder of a command if one is named, and print JSON or tables.

    Args:
        result: of which JSON is made.
        tables: what `rich` prints, one after the other.
        as_json: whether JSON is printed instead of tables.
        out: folder for the files; `None` for none.
        figures: draws the pictures, by name.
        scene: as it was run; `None` where there is none.
        curves: as in `write_results`.
        written: names of the kinds of files in the folder.
    """
    tables = list(tables)
    if out is not None:
        from .._waits import spinner

        with spinner("Drawing ..."):
            write_results(out, figures(), result, scene, tables, curves)
    show_results(result, tables, as_json, out, written)


def write_results(
    folder: Path,
    figures: Mapping[str, Any],
    result: dict[str, Any],
    scene: "Scene | None" = None,
    tables: Iterable[Any] = (),
    curves: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Pictures, numbers, a report of both, and, where there is one, the scene as it was run.

    Where plotly is installed, the pictures are on a page with hover and zoom as well.

    Args:
        folder: is made if it is missing.
        figures: figures of matplotlib, or the bytes of a GIF, by name.
        result: what JSON prints.
        scene: as it was run.
        tables: what the terminal shows; the report shows the numbers of `result` without them.
        curves: columns with their units, by the name of the CSV file that takes them.
    """
    from .._results import csv_text
    from ..report import Made, report
    from ..scene import dump

    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        if isinstance(figure, bytes):
            _write(folder / f"{name}.gif", figure)
        else:
            image = io.BytesIO()
            figure.savefig(image, dpi=150)
            _write(folder / f"{name}.png", image.getvalue())
    _write(folder / "result.json", f"{json_text(result)}\n".encode())
    for name, columns in (curves or {}).items():
        _write(folder / f"{name}.csv", csv_text(dict(columns)).encode())
    if scene is not None:
        _write(folder / "scene.toml", dump(scene).encode())
    if figures and find_spec("plotly"):
        from ..plot import interactive_page

        _write(folder / "interactive.html", interactive_page(figures, folder.name).encode())
    page = report(result, tables, figures, scene, Made.now(command_line()))
    _write(folder / "report.html", page.encode())


def _write(file: Path, content: bytes) -> None:
    """Write a file as a whole or not at all, also where the disk is full."""
    part = file.with_name(f".{file.name}.part")
    try:
        part.write_bytes(content)
        part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OSError(
            error.errno, f"{error.strerror}; the file is not written", str(file)
        ) from None


def show_results(
    result: dict[str, Any],
    tables: Iterable[Any],
    as_json: bool,
    out: Path | None,
    written: str = "Report, pictures, curves, result and scene",
) -> None:
    """Print one JSON object, or the tables and the folder of the files.

    Args:
        result: what JSON prints.
        tables: what `rich` prints, one after the other.
        as_json: whether JSON is printed.
        out: folder that was written, if any.
        written: names of the kinds of files there.
    """
    if as_json:
        print_json(result)
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ._tables import fitted

    console = Console()
    for table in tables:
        typed = isinstance(table, Text) and bool(table.no_wrap)  # to be copied into a file
        shown = fitted(table, console.width) if isinstance(table, Table) else table
        console.print(shown, soft_wrap=typed)
    if out is not None:
        console.print(f"{written} are in {out}", soft_wrap=True, markup=False)
