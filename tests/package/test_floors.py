"""The order of the floors: a module imports its own floor and lower ones, also within functions.

No module is reached from itself, and a package takes what is not public from the module that defines
it. What a package offers in a stub counts as imported from the module that defines it.
"""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import jaxcomp

PACKAGE = Path(jaxcomp.__file__).parent
# From the ground up, which is `_core`.
FLOORS = [
    {"parts", "mechanism", "gas", "film", "motor", "fluid"},
    {"friction", "valve", "piping"},
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
RANK = {name: rank for rank, floor in enumerate(FLOORS) for name in floor} | {"_core": -1}
# Packages whose files are called after what they show of others.
MIRRORS = {"plot", "report", "cli"}
# Libraries of the edge, and the lowest floor that may import them.
EDGE = {
    "pint": "scene",
    "matplotlib": "plot",
    "panel": "desk",
    "bokeh": "desk",
    "typer": "cli",
    "click": "cli",
}


@cache  # several tests walk through all modules
def _nodes_of_imports(text: str) -> list[ast.Import | ast.ImportFrom]:
    return [
        node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)
    ]


def _imports(path: Path, text: str):
    """(module, name or "", line) of every import, as ("film._film", "Oil", 7) or ("/numpy", "", 3)."""
    above = path.relative_to(PACKAGE).parts[:-1]
    for node in _nodes_of_imports(text):
        if isinstance(node, ast.Import):
            yield from ((f"/{alias.name}", "", node.lineno) for alias in node.names)
        elif not node.level:
            yield f"/{node.module}", "", node.lineno
        else:
            inside = [*above[: len(above) - node.level + 1], *filter(None, [node.module])]
            yield from ((".".join(inside), alias.name, node.lineno) for alias in node.names)


@cache
def _file(module: str) -> Path | None:
    """The file of a module of the package, its stub where it has one."""
    path = PACKAGE / Path(*module.split(".")) if module else PACKAGE
    for one in (path / "__init__.pyi", path / "__init__.py", path.with_suffix(".py")):
        if one.exists():
            return one
    return None


@cache
def _offered(stub: Path) -> dict[str, str]:
    """Names that a stub offers, with the modules that they come from."""
    return {name: module for module, name, _ in _imports(stub, stub.read_text("utf-8"))}


@cache
def _defined(path: Path) -> set[str]:
    """Names that a module defines itself."""
    names = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {
                name.id
                for target in targets
                for name in ast.walk(target)
                if isinstance(name, ast.Name)
            }
    return names


def _source(module: str, name: str) -> Path | None:
    """The file that an import leads to."""
    if (inner := _file(f"{module}.{name}".strip("."))) is not None:
        return inner
    file = _file(module)
    if file is not None and file.suffix == ".pyi" and name in _offered(file):
        return _source(_offered(file)[name], name)
    return file


def _modules():
    """(path, text) of every module, but for the face of the package, which has no floor."""
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.parent != PACKAGE or path.name not in ("__init__.py", "__main__.py"):
            yield path, path.read_text("utf-8")


def _against_the_order(modules):
    for path, text in modules:
        own = path.relative_to(PACKAGE).with_suffix("").parts[0]
        for module, name, line in _imports(path, text):
            where = f"{path.relative_to(PACKAGE)}:{line} imports {module}"
            library = module[1:].partition(".")[0] if module.startswith("/") else ""
            if library in EDGE and RANK[own] < RANK[EDGE[library]]:
                yield where
            if not library and RANK[(module or name).partition(".")[0]] > RANK[own]:
                yield where


def _passed_on(modules):
    """Imports of a name from a private module that has imported the name itself."""
    for path, text in modules:
        for module, name, line in _imports(path, text):
            source = None if module.startswith("/") else _file(module)
            if source is None or not source.stem.startswith("_") or source.stem == "__init__":
                continue
            if _file(f"{module}.{name}") is None and name not in _defined(source):
                yield f"{path.relative_to(PACKAGE)}:{line} imports {name} from {module}"


def _circle(modules):
    """Modules that import each other in a circle; empty if none do."""
    graph = {}
    for path, text in modules:
        found = (_source(m, name) for m, name, _ in _imports(path, text) if not m.startswith("/"))
        graph[path] = {one for one in found if one not in (None, path)}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [str(one.relative_to(PACKAGE)) for one in error.args[1]]
    return []


def test_every_room_has_a_floor():
    rooms = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert rooms - {"__init__", "__main__"} <= set(RANK)
    assert len(rooms) <= 30


def test_no_import_runs_upwards():
    assert list(_against_the_order(_modules())) == []


def test_no_module_is_reached_from_itself():
    assert _circle(_modules()) == []


def test_what_is_not_public_is_imported_from_where_it_is_defined():
    assert list(_passed_on(_modules())) == []


def _repeated_file_names(paths):
    """Names of modules that stand in two packages; commands, pictures and reports mirror others."""
    folders: dict[str, list[str]] = {}
    for path in paths:
        package = path.relative_to(PACKAGE).parts[0]
        if path.parent != PACKAGE and path.name != "__init__.py" and package not in MIRRORS:
            folders.setdefault(path.name, []).append(str(path.parent.relative_to(PACKAGE)))
    return {name: where for name, where in folders.items() if len(where) > 1}


def test_no_file_name_stands_in_two_packages():
    assert _repeated_file_names(path for path, _ in _modules()) == {}
    twins = [PACKAGE / "crank" / "_solve.py", PACKAGE / "rotor" / "_solve.py"]
    assert list(_repeated_file_names(twins)) == ["_solve.py"]


def test_what_breaks_the_order_is_found():
    film, parts, solver = (
        _file(one) for one in ("film._film", "film._parts", "crank._solve_orbit")
    )
    wrong = [(film, "from ..crank import Orbit\nfrom ..crank._solve_orbit import x\nimport pint")]
    assert len(list(_against_the_order(wrong))) == 3
    inner = [(film, "from ._parts import Oil"), (parts, "def f():\n    from . import _film")]
    assert len(_circle(inner)) == 3
    search = (_file("study._optimise"), "from ..crank import solve_orbit")
    stub = [(solver, "from ..study import optimise"), search]
    assert len(_circle(stub)) == 3


def test_the_page_on_architecture_has_the_same_order():
    page = (PACKAGE.parent / "notebooks" / "architecture.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \| ([^|]*) \|", page, re.M)
    assert [int(number) for number, _ in rows] == list(range(1, len(FLOORS) + 1))
    assert [set(re.findall(r"`(\w+)`", names)) for _, names in rows] == FLOORS
