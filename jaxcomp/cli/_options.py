"""Arguments that several commands declare alike."""

from pathlib import Path
from typing import Annotated

import typer

Machine = Annotated[str, typer.Argument(help="Bundled machine (see `jaxcomp list`) or scene file.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Set a value of the scene. Repeatable."),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in SI units instead of tables.")
]
Out = Annotated[
    Path | None, typer.Option(help="Folder for pictures, result.json and the scene as it was run.")
]
OutWithoutScene = Annotated[Path | None, typer.Option(help="Folder for pictures and result.json.")]
