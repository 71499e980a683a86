"""The face of the package: how many names it has, and that the docstring of each says what is needed."""

import importlib
import inspect
import re
import runpy
from pathlib import Path

import pytest

import jaxcomp
from jaxcomp._core.results import Result
from jaxcomp._core.words import _ELSEWHERE
from jaxcomp.parts import Part

NOTEBOOKS = Path(jaxcomp.__file__).parents[1] / "notebooks"
public_names = runpy.run_path(str(NOTEBOOKS / "public_names.py"))["public_names"]
ERRORS = "BadInput|SceneError|SolveFailed|ExtensionError|ValueError|TypeError|RuntimeError"
# Parts and laws are what machine files are made of, results what functions return; the others are typed.
# 225 before networks of pipes, which have 14; one more for load steps, and `keep_programs`, without
# which an import would have to replace a function of JAX.
MOST_TYPED = 241


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


def test_names_that_people_look_for_say_what_to_use():
    # it is there once it was imported, and the walk below imports it
    importlib.import_module("jaxcomp.desk")
    names = {name: use for name, use in _ELSEWHERE.items() if not hasattr(jaxcomp, name)}
    # the distributions are sought in `jaxcomp.study` alone
    distributions = {"uniform", "log_uniform", "normal", "within"}
    assert len(names) >= len(_ELSEWHERE) - len(distributions) - 1
    for name, use in names.items():
        with pytest.raises(AttributeError, match=re.escape(use)):
            getattr(jaxcomp, name)
        for path in re.findall(r"[a-z_]+(?:\.[a-z_]+)+(?=\()", use):
            here = jaxcomp
            for step in path.split("."):
                here = getattr(here, step)
            assert callable(here), path
    with pytest.raises(AttributeError, match=r"jaxcomp\.study has no run; use study\.steady_state"):
        jaxcomp.study.run  # noqa: B018
    with pytest.raises(AttributeError, match=r'did you mean "tolerance"'):
        jaxcomp.tolerances  # noqa: B018
