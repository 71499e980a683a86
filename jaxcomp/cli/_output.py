"""Output of every command: JSON or tables, and a folder of files.

Every number in JSON has its SI unit in its key, as `mean_speed [rad/s]`.
"""

import io
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import typer

from .._core.declared import Declared, Record, tree_of, with_units, without_units
from .._core.evidence import Check
from .._core.interrupts import words_when_stopped
from ._options import AsJson, Force, Out, OutWithoutScene
from ._start import CommandError, command_line, show_error, waiting
from ._written import FIXED_NAMES, refuse_files_of_user, write_results_of_command

if TYPE_CHECKING:
    from rich.console import Console

    from ..scene import Scene

# [s] Between two writings of what there is so far.
_EVERY = 1.0
# Characters in a line of a file or a pipe, which no screen cuts.
_ENDLESS = 100_000
_WRITTEN = "Report, pictures, curves, result and machine file"


@dataclass(frozen=True)
class Output:
    """The options of a command that say where its result goes."""

    as_json: AsJson = False
    out: Out = None
    force: Force = False
    # Files that are looked for before the work; others when they are written, after the tables.
    names_ahead: ClassVar[tuple[str, ...]] = (*FIXED_NAMES, "machine.toml")

    def __post_init__(self) -> None:
        """Refuse a folder with files of the user before anything is solved."""
        if self.out is None:
            return
        try:
            refuse_files_of_user(self.out, self.names_ahead, self.force)
        except CommandError as error:
            show_error(error)
            raise typer.Exit(2) from None

    def emit(
        self,
        result: Declared,
        tables: Callable[[dict[str, Any]], Iterable[Any]],
        figures: Callable[[], Mapping[str, Any]] = dict,
        scene: "Scene | None" = None,
        curves: Mapping[str, Callable[[], Mapping[str, Any]]] | None = None,
        written: str = _WRITTEN,
        files: Callable[[], Mapping[str, str]] = dict,
        metadata: Mapping[str, Any] | None = None,
        numbers: Record | None = None,
    ) -> None:
        """Write the folder of a command if one is named, and print JSON or tables.

        Args:
            result: what the library found, or a record of it.
            tables: makes of the plain numbers what `rich` prints, one after the other.
            figures: draws the pictures, by name.
            scene: as it was run; `None` where there is none.
            curves: what makes the columns, by the name of the CSV file that takes them.
            written: names of the kinds of files in the folder.
            files: makes the texts of further files, by name.
            metadata: words that stand in JSON in front of the numbers, as the name of the machine.
            numbers: of the command, that stand beside those of the result.
        """
        tree = tree_of(metadata or {}) | tree_of(numbers or {}) | tree_of(result)
        shown = list(tables(without_units(tree)))
        if self.as_json:
            print_json(tree)
        else:
            print_tables(shown)
        if self.out is None:
            return
        # What was found is printed by now, should a file of the user or a full disk be in the way.
        with waiting("Drawing ..."):
            columns = {name: columns_of() for name, columns_of in (curves or {}).items()}
            contents = result_files(
                self.out.name,
                figures(),
                tree,
                scene=scene,
                tables=shown,
                curves=columns,
                texts=files(),
                evidence=result.evidence(getattr(numbers, "tolerance", 0.0)),
            )
            write_results_of_command(self.out, contents, self.force)
        if not self.as_json:
            print_line(f"{written} are in {self.out}")


def header(scene: "Scene") -> dict[str, Any]:
    """Entries in front of the numbers of one machine."""
    from importlib.metadata import version

    return {"machine": scene.name, "file": scene.file, "version": version("jaxcomp")}


@dataclass(frozen=True)
class OutputWithoutScene(Output):
    """Output where no machine is run that a file describes."""

    out: OutWithoutScene = None
    force: Force = False
    names_ahead: ClassVar[tuple[str, ...]] = FIXED_NAMES


class Partial:
    """Store of the pieces of long work, which an interrupt leaves: in a file, or in a word.

    Args:
        out: folder of the command; without one the word says how to keep more.
        unit: what the pieces are.
    """

    def __init__(self, out: Path | None, unit: str):
        self.file = None if out is None else out / "partial.csv"
        self.unit = unit
        self.written = -_EVERY
        self.columns: dict[str, Any] = {}

    def keep(self, columns: Mapping[str, Any], best: str = "") -> None:
        """Keep columns of equal length in the place of what was kept before.

        Args:
            columns: by name with unit.
            best: the best of them in words.
        """
        self.columns = dict(columns)
        count = len(next(iter(self.columns.values()), ()))
        where = "with --out FOLDER they are kept"
        if self.file is not None:
            where = f"they are in {self.file}"
            if time.monotonic() - self.written > _EVERY:
                from .._core.results import csv_text

                contents = {self.file.name: csv_text(self.columns).encode()}
                # that the file is none of the user was seen before the work began
                write_results_of_command(self.file.parent, contents, force=True)
                self.written = time.monotonic()
        words_when_stopped(f"stopped after {count:,} {self.unit}{best and f', {best}'}; {where}")

    def finish(self) -> None:
        """The work has ended: its results stand for what was kept."""
        words_when_stopped()
        if self.file is not None:
            self.file.unlink(missing_ok=True)


def result_files(
    title: str,
    figures: Mapping[str, Any],
    result: dict[str, Any],
    scene: "Scene | None" = None,
    tables: Iterable[Any] = (),
    curves: Mapping[str, Mapping[str, Any]] | None = None,
    texts: Mapping[str, str] | None = None,
    evidence: Iterable[Check] = (),
) -> dict[str, bytes]:
    """Contents of the files of a command by their names.

    Pictures, numbers, a report of both, and, where there is one, the scene as it was run. Where plotly is
    installed, the pictures are on a page with hover and zoom as well, and where openpyxl is, numbers and
    tables are in a workbook.

    Args:
        title: of that page.
        figures: figures of matplotlib, or the bytes of a GIF, by name.
        result: numbers and words, as of `tree_of`.
        scene: as in `Output.emit`.
        tables: for `rich`; without them the report shows the numbers of `result`.
        curves: columns with their units, by the name of the CSV file that takes them.
        texts: of further files, by name.
        evidence: checks of the result.
    """
    from .._core.results import csv_text
    from ..report import report
    from ..report._page import Provenance
    from ..scene import dump

    contents: dict[str, bytes] = {}
    for name, figure in figures.items():
        if isinstance(figure, bytes):
            contents[f"{name}.gif"] = figure
        else:
            image = io.BytesIO()
            figure.savefig(image, dpi=150)
            contents[f"{name}.png"] = image.getvalue()
    contents["result.json"] = f"{json_text(result)}\n".encode()
    for name, columns in (curves or {}).items():
        contents[f"{name}.csv"] = csv_text(dict(columns)).encode()
    if find_spec("openpyxl"):
        from ._spreadsheet import workbook

        contents["results.xlsx"] = workbook(with_units(result), curves or {})
    if scene is not None:
        contents["machine.toml"] = dump(scene).encode()
    # moving pictures have no hover and no zoom
    images = [name for name, figure in figures.items() if not isinstance(figure, bytes)]
    if images and find_spec("plotly"):
        from ..plot._interactive import interactive_page

        contents["interactive.html"] = interactive_page(figures, title).encode()
    provenance = Provenance.of_this_process(command_line())
    page = report(without_units(result), tables, figures, scene, provenance, evidence)
    contents["report.html"] = page.encode()
    for name, text in (texts or {}).items():
        contents[name] = text.encode()
    return contents


def show_results(
    result: Declared | Mapping[str, Any], tables: Iterable[Any], as_json: bool
) -> None:
    """Print one JSON object of what may become plain numbers and words, or the tables."""
    if as_json:
        print_json(tree_of(result))
    else:
        print_tables(tables)


def _console() -> "Console":
    from rich.console import Console

    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _ENDLESS
    return console


def print_line(text: str) -> None:
    """Print one line of text, wrapped by the terminal alone."""
    _console().print(text, soft_wrap=True, markup=False)


def print_tables(tables: Iterable[Any]) -> None:
    """Print tables and lines of `rich` one after the other."""
    from rich.table import Table
    from rich.text import Text

    from ._tables import fitted

    console = _console()
    for table in tables:
        copyable = isinstance(table, Text) and bool(table.no_wrap)  # to be copied into a file
        if not isinstance(table, Table):
            console.print(table, soft_wrap=copyable)
            continue
        # beside the table: within it they would wrap at its width; a report still needs them in it
        body = copy(table)
        body.title = body.caption = None
        if table.title:
            console.print(f"[bold]{table.title}[/bold]", highlight=False)
        console.print(fitted(body, console.width))
        if table.caption:
            console.print(f"[dim]{table.caption}[/dim]", highlight=False)


# ------------------------------------------------------------------- JSON
def json_text(tree: dict[str, Any], *, ascii_only: bool = False) -> str:
    """One JSON object; a number that is not finite would be a fault and is refused.

    Args:
        tree: numbers and words, as of `tree_of`.
        ascii_only: whether other signs are written as escapes.
    """
    return json.dumps(with_units(tree), indent=2, allow_nan=False, ensure_ascii=ascii_only)


def print_json(tree: dict[str, Any]) -> None:
    """Print one JSON object on standard output, in ASCII where that takes no other signs."""
    utf = (sys.stdout.encoding or "").lower().startswith("utf")
    typer.echo(json_text(tree, ascii_only=not utf))
