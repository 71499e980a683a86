"""Parts, and trees of parts, printed with their values and units."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from .display import shown


def _lines(tree: Any, name: str, indent: str = "") -> Iterator[str]:
    """A part, or whatever holds parts, with values and units; a line for each value."""
    head = f"{indent}{name}: " if name else indent
    if dataclasses.is_dataclass(tree):
        yield head + type(tree).__name__
        for field in dataclasses.fields(tree):
            value = getattr(tree, field.name)
            if not field.repr:  # tables that follow from the other fields
                continue
            if "unit" in field.metadata and value is not None:
                text = _values_text(field.name, field.metadata["unit"], np.asarray(value))
                yield f"{indent}  {field.name}: {text}"
            elif value is not None and value != {} and value != ():
                yield from _lines(value, field.name, f"{indent}  ")
        return
    children: dict[Any, Any] = {}
    if isinstance(tree, dict):
        children = tree
    elif isinstance(tree, tuple):
        children = dict(enumerate(tree))
    # names and numbers in a tuple stand in one line, parts below each other
    if any(map(dataclasses.is_dataclass, children.values())):
        yield head.rstrip()
        for key, value in children.items():
            yield from _lines(value, str(key), f"{indent}  ")
    else:
        yield head + str(tree)


def _values_text(name: str, unit: str, values: np.ndarray) -> str:
    """Values [SI] of a field in the unit that suits them; equal ones stand there once."""
    look = shown(name, unit, values)
    if values.size and np.all(values == values.flat[0]):
        text = look.text(float(values.flat[0]))
        return text if values.size == 1 else f"{text}, each of {values.size}"
    scaled = look.drawn.of(values)
    text = np.array2string(scaled, precision=5, threshold=12, separator=", ")
    return f"{' '.join(text.split())} {look.drawn.unit}".rstrip()


def printed(tree: Any) -> str:
    """A part, or a tree of parts such as a machine, with values and units."""
    # within a program values are symbols, with a shape and a type to print and no number
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree)):
        return eqx.tree_pformat(tree)
    return "\n".join(_lines(tree, ""))
