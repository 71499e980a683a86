"""The face of the package: how many names it has, and that the docstring of each says what is needed."""

import importlib
import inspect
import re
import runpy
from pathlib import Path

import jaxcomp
from jaxcomp._core.results import Result
from jaxcomp.parts import Part

NOTEBOOKS = Path(jaxcomp.__file__).parents[1] / "notebooks"
public_names = runpy.run_path(str(NOTEBOOKS / "public_names.py"))["public_names"]
ERRORS = "BadInput|SceneError|SolveFailed|ExtensionError|ValueError|TypeError|RuntimeError"
# Parts and laws are what machine files are made of, results what functions return; the others are typed.
MOST_TYPED = 220


def faces():
    """Every public name once, as {name: (module, what it is)}."""
    return {
        name: (module, getattr(importlib.import_module(module), name))
        for module, names in public_names().items()
        for name in names
    }


def missing(function):
    """What the docstring of a function leaves out of its arguments, errors and result."""
    said = inspect.getdoc(function) or ""
    signature = inspect.signature(function)
    for name in signature.parameters:
        entry = rf"(^|\n) *\**(\w+, )*\**{name}(, \w+)*( \(.*?\))?:|`\**{name}`"
        if not re.search(entry, said):
            yield f"argument {name}"
    body = inspect.getsource(inspect.unwrap(function))
    for error in sorted(set(re.findall(rf"raise ({ERRORS})\(", body))):
        if error not in said:
            yield f"raises {error}"
    if signature.return_annotation is inspect.Signature.empty:
        yield "annotation of the result"


def test_the_face_stays_small():
    typed = {
        name
        for name, (_, one) in faces().items()
        if not (inspect.isclass(one) and issubclass(one, Part | Result))
    }
    assert len(typed) <= MOST_TYPED, sorted(typed)


def test_docstrings_say_arguments_errors_and_results():
    told = {
        f"{module}.{name}": list(missing(one))
        for name, (module, one) in faces().items()
        if inspect.isfunction(inspect.unwrap(one))
    }
    assert len(told) > 80
    assert {name: lacks for name, lacks in told.items() if lacks} == {}


def test_what_a_docstring_leaves_out_is_found():
    def bare(length, mass):
        """Something.

        Args:
            length: [m]
        """
        raise ValueError(length, mass)

    assert list(missing(bare)) == [
        "argument mass",
        "raises ValueError",
        "annotation of the result",
    ]
