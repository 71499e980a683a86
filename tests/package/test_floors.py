"""The order of the floors: a module imports its own floor and lower ones, also within functions."""

import ast
import re
from pathlib import Path

import jaxcomp

PACKAGE = Path(jaxcomp.__file__).parent
# From the ground up, which is `_core`.
FLOORS = [
    {"parts", "mechanism", "gas", "film", "motor", "fluid"},
    {"friction", "valve"},
    {"crankshaft"},
    {"cylinder"},
    {"compressor"},
    {"crank"},
    {"rotor"},
    {"machine"},
    {"vibration"},
    {"balancing"},
    {"study"},
    {"scene", "machines"},
    {"plot", "report"},
    {"desk"},
    {"cli"},
]
RANK = {name: rank for rank, floor in enumerate(FLOORS) for name in floor}
# Libraries of the edge, and the lowest floor that may import them.
EDGE = {
    "pint": "scene",
    "matplotlib": "plot",
    "panel": "desk",
    "bokeh": "desk",
    "typer": "cli",
    "click": "cli",
}


def _imports(path: Path):
    """(first name below the package or "", name of the library or "", line) of every import."""
    depth = len(path.relative_to(PACKAGE.parent).parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (("", alias.name.split(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield "", (node.module or "").split(".")[0], node.lineno
        elif isinstance(node, ast.ImportFrom):
            above = path.relative_to(PACKAGE.parent).parts[1 : depth - node.level]
            inside = [*above, *(node.module or "").split(".")] if node.module else [*above]
            names = inside[:1] or [alias.name for alias in node.names]
            yield from ((name, "", node.lineno) for name in names)


def _against_the_order():
    for path in sorted(PACKAGE.rglob("*.py")):
        own = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if own in ("__init__", "__main__"):
            continue
        rank = RANK.get(own, -1)
        for room, library, line in _imports(path):
            where = f"{path.relative_to(PACKAGE)}:{line} imports {room or library}"
            if room and not room.startswith("_") and RANK[room] > rank:
                yield where
            if library in EDGE and rank < RANK[EDGE[library]]:
                yield where


def test_every_room_has_a_floor():
    rooms = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert {room for room in rooms if not room.startswith("_")} <= set(RANK)


def test_no_import_runs_upwards():
    assert list(_against_the_order()) == []


def test_the_page_on_architecture_has_the_same_order():
    page = (PACKAGE.parent / "notebooks" / "architecture.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \| ([^|]*) \|", page, re.M)
    assert [int(number) for number, _ in rows] == list(range(1, len(FLOORS) + 1))
    assert [set(re.findall(r"`(\w+)`", names)) for _, names in rows] == FLOORS
