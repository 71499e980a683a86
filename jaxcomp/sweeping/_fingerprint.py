r"""What makes two sweeps the same, so that one may go on where the other stopped."""

import hashlib
import re
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..design import Problem

# How Python shows where in memory an object lies, which is another place in every run.
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def fingerprint(problem: Problem, points: Any) -> dict[str, Any]:
    """Everything that the numbers of a sweep depend on, as JSON can hold it.

    A quantity that is a function counts by its name and code; what it takes from its surroundings
    is not looked at.

    Args:
        problem: as it is computed; its machine counts with every bit of its numbers.
        points: the designs.
    """
    described = points.described()
    return {
        "machine": _digest(problem.design),
        "variables": list(points.axes),
        "designs": _short(described),
        "quantities": [_asked(one) for one in problem.quantities],
        "options": _text(problem.options),
    }


def first_difference(here: dict[str, Any], there: dict[str, Any]) -> str:
    """What differs, in words; empty if nothing does."""
    for key, value in here.items():
        if there.get(key) == value:
            continue
        if key in ("machine", "designs"):
            what = "numbers of the machine" if key == "machine" else "values of the variables"
            return f"other {what}"
        return f"{key} {_shown(there.get(key))} where this one has {_shown(value)}"
    return ""


def _digest(tree) -> str:
    """Of all numbers of a tree and of everything that is none."""
    numbers, rest = eqx.partition(tree, eqx.is_array)
    digest = hashlib.sha256(_text(rest).encode())
    for path, leaf in jax.tree_util.tree_leaves_with_path(numbers):
        value = np.asarray(leaf)
        digest.update(f"{jax.tree_util.keystr(path)} {value.dtype} {value.shape}".encode())
        digest.update(value.tobytes())
    return digest.hexdigest()


def _short(described) -> str:
    return hashlib.sha256(repr(described).encode()).hexdigest()


def _asked(one: str | Callable) -> str:
    if isinstance(one, str):
        return one
    code = getattr(one, "__code__", None)
    content = "" if code is None else _code(code)
    mark = hashlib.sha256(content.encode()).hexdigest()[:12]
    return f"{one.__name__} ({mark})"


def _code(code) -> str:
    inner = [_code(c) if hasattr(c, "co_code") else repr(c) for c in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {inner}"


def _text(tree) -> str:
    return _ADDRESS.sub("", eqx.tree_pformat(tree, short_arrays=True, width=10_000))


def _shown(value) -> str:
    return ", ".join(value) if isinstance(value, list) else str(value)
