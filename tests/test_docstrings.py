"""The docstrings of the public names are a complete reference.

Public is what the `__init__.py` of a package lists (of `jaxcomp` itself, what it hands on), with the
public methods and properties that those classes define. The rules, checked in the source text:

- Everything has a docstring, except a method that a base class of jaxcomp describes and a property
  that its class lists.
- A function describes its parameters under Args, or in its text: between backquotes, or by name with a
  unit ("a load [N]"). Those named after their type explain themselves (`compressor: Compressor`,
  `model: RotorModel`); where only one other is left, the text may do it in its own words.
- A class does the same for what it is built from, under Args or Attributes, its own or those of a base:
  the parameters of its `__init__` if it has one, otherwise its fields.
- An entry of numbers (its annotation is made of float, complex, Array, Float, Complex or ndarray) has
  a unit in brackets, "[-]" where it has none, "[SI]" where another name decides; so has the docstring
  of what returns them. Only the whole of an annotation counts: in `Array | None` and
  `tuple[Array, Array]` nothing but numbers is left, in `dict[str, float]` and `Callable` there is.
- What a field is declared in is what its entry says.
- What raises BadInput or ValueError in its own body, or on construction, says so under Raises.
"""

import ast
import dataclasses
import functools
import importlib
import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from typing import Any, NamedTuple

import pint
import pytest
from jaxtyping import Array, Float

import jaxcomp
from jaxcomp._fields import Part, quantity

_SECTIONS = ("Args", "Attributes", "Returns", "Yields", "Raises")
_NUMBERS = {"float", "complex", "Array", "ArrayLike", "Scalar", "Float", "Complex", "ndarray"}
# What may stand around or beside a number and leave it a number.
_AROUND = {"tuple", "list", "Sequence", "None", "np", "jax"}
_UNIT = re.compile(r"\[([^\[\]\n]{1,30})\]")
_BUILDERS = ("__check_init__", "__post_init__", "__init__")
_units = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


class Function(NamedTuple):
    """A function in its source: parameters with their annotations as text, and the docstring."""

    parameters: dict[str, str]
    returns: str
    raises: set[str]
    doc: str


def _packages() -> list[str]:
    found = pkgutil.walk_packages(jaxcomp.__path__, "jaxcomp.")
    return [module.name for module in found if module.ispkg]


def _exported(package: str) -> Iterator[tuple[str, Any]]:
    module = importlib.import_module(package)
    for name, thing in vars(module).items():
        home = getattr(inspect.unwrap(thing), "__module__", None) if callable(thing) else None
        if name.startswith("_") or not str(home).startswith("jaxcomp"):
            continue
        if inspect.isclass(thing) or inspect.isfunction(inspect.unwrap(thing)):
            yield name, thing


def _public() -> dict[str, Any]:
    names = {f"jaxcomp.{name}": getattr(jaxcomp, name) for name in jaxcomp.__all__}
    names = {path: thing for path, thing in names.items() if callable(thing)}
    for package in _packages():
        names |= {f"{package}.{name}": thing for name, thing in _exported(package)}
    return names


def _room(thing: Any) -> str:
    """The package that a public name is made in; "jaxcomp" for a file beside the packages."""
    home = inspect.unwrap(thing).__module__.split(".")[1]
    return home if f"jaxcomp.{home}" in _packages() else "jaxcomp"


def _rooms() -> list[str]:
    inner = [package.split(".")[1] for package in _packages()]
    return ["jaxcomp", *(room for room in inner if room != "machines")]  # which are data alone


@functools.cache
def _described() -> dict[str, tuple[Any, type | None]]:
    """Public names once each, with the methods and properties of the classes, and their class."""
    seen, found = set(), {}
    for path, thing in _public().items():
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        found[path] = (thing, None)
        for name, member in vars(thing).items() if inspect.isclass(thing) else ():
            inner = _plain(member)
            if inner is not None and (name == "__call__" or not name.startswith("_")):
                found[f"{path}.{name}"] = (inner, thing)
    return found


def _plain(member: Any) -> Any:
    """The function under a method, property or wrapper; `None` if there is none of jaxcomp's."""
    for name in ("fget", "func", "__func__"):
        member = getattr(member, name, member)
    member = inspect.unwrap(member) if callable(member) else member
    mine = str(getattr(member, "__module__", "")).startswith("jaxcomp")
    return member if inspect.isfunction(member) and mine else None


def _tree(thing: Any) -> Any:
    return ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]


def _function(tree: ast.FunctionDef) -> Function:
    arguments = tree.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    every += [extra for extra in (arguments.vararg, arguments.kwarg) if extra is not None]
    parameters = {
        one.arg: ast.unparse(one.annotation) if one.annotation else ""
        for one in every
        if one.arg not in ("self", "cls", "_") and not one.arg.startswith("_")
    }
    returns = ast.unparse(tree.returns) if tree.returns else ""
    return Function(parameters, returns, _raised(tree), ast.get_docstring(tree) or "")


def _raised(tree: ast.AST) -> set[str]:
    calls = (node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise))
    names = {call.func.id for call in calls if _is_named_call(call)}
    return names & {"BadInput", "ValueError"}


def _is_named_call(node: Any) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name)


def _sections(doc: str) -> dict[str, str]:
    """The text under each heading; what stands before the first one under ""."""
    found, heading = {"": ""}, ""
    for line in inspect.cleandoc(doc).splitlines():
        if line.rstrip(":") in _SECTIONS and line.endswith(":"):
            heading = line.rstrip(":")
        elif line and not line.startswith(" "):
            heading = ""
        found[heading] = found.get(heading, "") + line + "\n"
    return found


def _entries(doc: str) -> dict[str, str]:
    """What Args and Attributes say of each name; `x, y: text` speaks of both."""
    sections, found = _sections(doc), {}
    for heading in ("Args", "Attributes"):
        text = textwrap.dedent(re.sub(r"\A.*\n", "", sections.get(heading, "")))
        for entry in re.split(r"\n(?=\S)", text):
            names, _, said = entry.partition(":")
            found |= {name.strip(" *`"): said for name in names.split(",")}
    return found


def _numbers(annotation: str) -> bool:
    """Whether an annotation is made of nothing but numbers."""
    words = set(re.findall(r"[A-Za-z_]\w*", re.sub(r"'[^']*'|\"[^\"]*\"", "", annotation)))
    return bool(words & _NUMBERS) and words <= _NUMBERS | _AROUND


def _explains_itself(name: str, annotation: str) -> bool:
    words = re.findall(r"[A-Z][a-z]+", annotation)
    return bool(words) and "".join(words).lower().endswith(name.replace("_", ""))


def _in_text(name: str, text: str) -> str | None:
    """What a text says of a parameter up to its unit; with backquotes, up to the end of the clause."""
    words = name.replace("_", "[ -]")
    found = re.search(rf"\b{words}\b[^.;,\[\]]*{_UNIT.pattern}|`{name}`[^.;]*", text)
    return found and found[0]


def _unit_complaint(name: str, annotation: str, said: str) -> Iterator[str]:
    if _numbers(annotation) and not _UNIT.search(said):
        yield f"`{name}` is a number without a unit"


def _function_complaints(function: Function) -> Iterator[str]:
    entries, sections = _entries(function.doc), _sections(function.doc)
    if not function.doc:
        yield "no docstring"
        return
    asking = [
        name for name, said in function.parameters.items() if not _explains_itself(name, said)
    ]
    for name in asking:
        said = entries.get(name) or _in_text(name, sections[""])
        if said is None and len(asking) == 1:
            said = sections[""]
        if said is None:
            yield f"parameter `{name}` is not described"
        else:
            yield from _unit_complaint(name, function.parameters[name], said)
    outside = sections[""] + sections.get("Returns", "")
    yield from _unit_complaint("the result", function.returns, outside)
    for error in function.raises:
        if error not in sections.get("Raises", ""):
            yield f"{error} is not under Raises"


def _class_complaints(cls: type) -> Iterator[str]:
    bases = [cls, *(base for base in cls.__mro__[1:] if base.__module__.startswith("jaxcomp"))]
    docs = [ast.get_docstring(_tree(base)) or "" for base in bases]
    if not docs[0]:
        yield "no docstring"
        return
    entries = {name: said for doc in reversed(docs) for name, said in _entries(doc).items()}
    text = "\n".join(_sections(doc)[""] for doc in docs)
    for name, annotation in _built_from(bases).items():
        said = entries.get(name) or _in_text(name, text)
        if said is None:
            yield f"field `{name}` is not described"
        else:
            yield from _unit_complaint(name, annotation, said)
    for name, unit in _declared_units(cls).items():
        said = entries.get(name) or _in_text(name, text) or ""
        if not any(_same_unit(unit, one) for one in _UNIT.findall(said)):
            yield f"`{name}` is declared in [{unit or '-'}]"
    builders = [_function(node) for node in _methods(cls) if node.name in _BUILDERS]
    for error in {error for builder in builders for error in builder.raises}:
        if not any(error in _sections(doc).get("Raises", "") for doc in docs):
            yield f"{error} is not under Raises"


def _methods(cls: type) -> list[ast.FunctionDef]:
    return [node for node in _tree(cls).body if isinstance(node, ast.FunctionDef)]


def _built_from(classes: list[type]) -> dict[str, str]:
    """Parameters of the `__init__` of a class, or else its fields, with their annotations."""
    for cls in classes:
        for node in _methods(cls):
            if node.name == "__init__":
                return _function(node).parameters
    return _fields(classes)


def _fields(classes: list[type]) -> dict[str, str]:
    """Fields of the first class with their annotations, where one of the classes declares them."""
    own = classes[0]
    if dataclasses.is_dataclass(own):
        names = {field.name for field in dataclasses.fields(own)}
    else:
        names = set(getattr(own, "_fields", ()))
    found = {}
    for cls in reversed(classes):
        for node in _tree(cls).body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                found[node.target.id] = ast.unparse(node.annotation)
    return {name: said for name, said in found.items() if name in names and name[0] != "_"}


def _declared_units(cls: type) -> dict[str, str]:
    fields = dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ()
    return {field.name: field.metadata["unit"] for field in fields if "unit" in field.metadata}


def _same_unit(declared: str, said: str) -> bool:
    if said in ("-", "SI"):
        return declared == "" or said == "SI"
    try:
        return _parsed(declared) == _parsed(said)
    except Exception:
        return False


def _parsed(unit: str) -> Any:
    powers = re.sub(r"([A-Za-z])(\d)", r"\1^\2", unit)  # kg m2
    return _units.Unit(re.sub(r"(?<=\w) (?=\w)", " * ", powers))


def _described_by_a_base(cls: type, name: str) -> bool:
    bases = (base for base in cls.__mro__[1:] if base.__module__.startswith("jaxcomp"))
    return any(_plain(vars(base).get(name)) is not None for base in bases)


def complaints(thing: Any, owner: type | None = None) -> list[str]:
    """What the docstring of a class, a function or a method (with its class) lacks."""
    if inspect.isclass(thing):
        return list(_class_complaints(thing))
    plain = inspect.unwrap(thing)
    function = _function(_tree(plain))
    if owner is not None and not function.doc:
        if _described_by_a_base(owner, plain.__name__):
            return []
        if plain.__name__ in _entries(ast.get_docstring(_tree(owner)) or ""):
            return []  # a property that the class lists
    return list(_function_complaints(function))


def _function_of(doc: str) -> list[str]:
    text = f'''def law(load: Float[Array, ""], rate: float, name: str) -> Float[Array, ""]:
        """{doc}"""
        if name != "law":
            raise BadInput("name", name, "law")
    '''
    return list(_function_complaints(_function(_parsed_function(text))))


def _parsed_function(text: str) -> Any:
    return ast.parse(text).body[0]


_COMPLETE = """[N m] Moment.

        Args:
            load: [N] as printed.
            rate: [rad/s] of the pin.
            name: of the law.

        Raises:
            BadInput: another name.
        """


@pytest.mark.parametrize(
    ("left_out", "complaint"),
    [
        ("[N m] ", "`the result` is a number without a unit"),
        ("[rad/s] ", "`rate` is a number without a unit"),
        ("name: of the law.", "parameter `name` is not described"),
        ("BadInput: another name.", "BadInput is not under Raises"),
        (_COMPLETE, "no docstring"),
    ],
)
def test_each_rule_sees_what_is_left_out(left_out, complaint):
    assert _function_of(_COMPLETE) == []
    assert _function_of(_COMPLETE.replace(left_out, "")) == [complaint]


class Pipe(Part):
    """A pipe, one of whose units has gone stale.

    Args:
        length: [m] between the flanges.
        bore: [mm] inside.
    """

    length: Float[Array, ""] = quantity("m")
    bore: Float[Array, ""] = quantity("m")


def test_a_unit_that_is_not_the_declared_one_is_seen():
    assert complaints(Pipe) == ["`bore` is declared in [m]"]


@pytest.mark.parametrize("room", _rooms())
def test_public_docstrings_are_complete(room):
    found = {path: pair for path, pair in _described().items() if _room(pair[0]) == room}
    lacking = [
        f"{path}: {complaint}"
        for path, (thing, owner) in found.items()
        for complaint in complaints(thing, owner)
    ]
    assert found
    assert not lacking, f"{len(lacking)} lacks:\n" + "\n".join(lacking)
