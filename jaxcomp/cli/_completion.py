"""What the shell completes: names of machines and files, and the paths that `--set` takes.

Read off the files themselves, so that no key press waits for JAX.
"""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from .._extensions import ExtensionError
from .._registry import DESIGN_RULES, registered

_MACHINES = Path(__file__).parents[1] / "machines"


def complete_machine(incomplete: str) -> list[tuple[str, str]]:
    """Bundled machines with their descriptions, then scene files and folders."""
    found = []
    for file in sorted(_MACHINES.glob("*.toml")):
        if file.stem.startswith(incomplete):
            found.append((file.stem, _tables(file).get("description", "")))
    folder = Path(incomplete) if incomplete.endswith("/") else Path(incomplete).parent
    for file in sorted(folder.glob("*")) if folder.is_dir() else ():
        name = f"{file}/" if file.is_dir() else str(file)
        if name.startswith(incomplete) and (file.is_dir() or file.suffix == ".toml"):
            found.append((name, "scene file" if file.suffix == ".toml" else "folder"))
    return found


def complete_path(ctx: typer.Context, incomplete: str) -> list[str]:
    """`PATH=` of the values in the machine that stands on the command line."""
    # behind an option that still lacks its value the words before it are not told apart yet
    loose = (word for word in ctx.args if not word.startswith("-"))
    given = ctx.params.get("machine") or next(loose, None)
    if not given or "=" in incomplete:
        return []
    file = _MACHINES / f"{given}.toml"
    tables = _tables(file if file.exists() else Path(given))
    planes = [row.get("name") for row in tables.get("balancing", {}).get("planes", ())]
    corrections = (f"corrections.{p}.{c}" for p in planes for c in ("x", "y", "magnitude", "angle"))
    paths = [*_paths(tables), *corrections]
    return [f"{path}=" for path in paths if path.startswith(incomplete)]


def complete_variable(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """`NAME=` of the design rules, and of the values as for `--set`."""
    paths = [(path, "") for path in complete_path(ctx, incomplete)]
    return [*complete_rule(incomplete), *paths]


def complete_rule(incomplete: str) -> list[tuple[str, str]]:
    """`NAME=` of the design rules."""
    return [(f"{name}=", doc) for name, doc in DESIGN_RULES.items() if name.startswith(incomplete)]


def complete_quantity(incomplete: str) -> list[tuple[str, str]]:
    """The quantities of the registry; those ending in a point want a joint or a target."""
    try:
        known = registered()
    except ExtensionError:  # the command itself tells; a key press in the shell has nowhere to
        return []
    names = ((one.name.partition("<")[0], one.doc) for one in known)
    return [(name, doc) for name, doc in names if name.startswith(incomplete)]


def _tables(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {}


def _paths(table: Mapping[str, Any], above: str = "") -> Iterator[str]:
    for key, value in table.items():
        path = f"{above}{key}"
        if isinstance(value, Mapping) and "value" not in value:
            yield from _paths(value, f"{path}.")
        elif isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
            for index, row in enumerate(value):
                yield from _paths(row, f"{path}.{index}.")
        elif above and key != "source":
            yield path
