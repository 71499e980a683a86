"""Public names of the package and what their docstrings begin with, read from the sources alone."""

import ast
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "jaxcomp"


def public_names():
    """Public names by module: {"jaxcomp.film": {"Oil": "jaxcomp.film._oil"}}, where each is defined."""
    found = {"jaxcomp": _imported(PACKAGE / "__init__.pyi", "jaxcomp")}
    for path in sorted(PACKAGE.iterdir()):
        if not path.name.startswith("_") and path.name not in ("cli", "machines"):
            found |= _of_module(path, f"jaxcomp.{path.stem}")
    # modules of a package, such as `jaxcomp.friction._slider_crank_joints`, are no names of their own
    return {name: names for name, names in found.items() if names}


def _of_module(path, name):
    """Public names of a module, or of a package and the modules that it offers."""
    if path.suffix == ".py":
        return {name: _imported(path, name) or _defined(path, name)}
    if not (path / "__init__.py").exists():
        return {}
    stub = path / "__init__.pyi"  # of a package that imports its modules when they are used
    listed = stub if stub.exists() else path / "__init__.py"
    found = {name: _imported(listed, name)}
    for node in ast.parse(listed.read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.level == 1 and not node.module:
            for one in node.names:
                inner = path / one.name
                found |= _of_module(
                    inner if inner.is_dir() else inner.with_suffix(".py"), f"{name}.{one.name}"
                )
    return {
        name: names for name, names in found.items() if not name.rpartition(".")[2].startswith("_")
    }


def _imported(path, module):
    """Names that a module offers, `from .x import y as y`, with the modules that they come from."""
    names = {}
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.level and node.module:
            for one in node.names:
                if one.asname == one.name and not one.name.startswith("_"):
                    names[one.name] = _source(node, path, module)
    return names


def _source(node, path, module):
    """The module that a relative import names."""
    package = module.split(".") if path.stem == "__init__" else module.split(".")[:-1]
    return ".".join([*package[: len(package) - node.level + 1], node.module])


def _defined(path, module):
    tree = ast.parse(path.read_text("utf-8"))
    kinds = ast.FunctionDef | ast.ClassDef
    own = [one.name for one in tree.body if isinstance(one, kinds)]
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            own = ast.literal_eval(node.value)
    return {name: module for name in own if not name.startswith("_")}


def first_sentence(module, name):
    """The first line of the docstring of a name, found in the sources."""
    path = ROOT / Path(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    stub = file.with_suffix(".pyi")
    file = stub if stub.exists() else file
    for node in ast.parse(file.read_text("utf-8")).body:
        if getattr(node, "name", "") == name:
            return (ast.get_docstring(node) or "").partition("\n")[0]
        relative = isinstance(node, ast.ImportFrom) and node.level and node.module
        if relative and any(one.name == name for one in node.names):
            return first_sentence(_source(node, file, module), name)
    return ""
