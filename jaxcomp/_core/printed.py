"""Parts, and trees of parts, printed with their values and units."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from .display import shown


def _lines(thing: Any, name: str, indent: str = "") -> Iterator[str]:
    """A part, or whatever holds parts, with values and units; a line for each value."""
    head = f"{indent}{name}: " if name else indent
    if dataclasses.is_dataclass(thing):
        yield head + type(thing).__name__
        for field in dataclasses.fields(thing):
            value = getattr(thing, field.name)
            if not field.repr:  # tables that follow from the other fields
                continue
            if "unit" in field.metadata and value is not None:
                look = shown(field.name, field.metadata["unit"], value)
                numbers = np.asarray(value)
                if numbers.size and np.all(numbers == numbers.flat[0]):
                    text = look.text(float(numbers.flat[0]))
                    text += f", each of {numbers.size}" if numbers.size > 1 else ""
                else:
                    scaled = look.drawn.of(numbers)
                    text = np.array2string(scaled, precision=5, threshold=12, separator=", ")
                    text = f"{' '.join(text.split())} {look.drawn.unit}".rstrip()
                yield f"{indent}  {field.name}: {text}"
            elif value is not None and value != {} and value != ():
                yield from _lines(value, field.name, f"{indent}  ")
    elif isinstance(thing, dict | tuple) and any(
        dataclasses.is_dataclass(one)
        for one in (thing.values() if isinstance(thing, dict) else thing)
    ):
        yield head.rstrip()
        for key, value in thing.items() if isinstance(thing, dict) else enumerate(thing):
            yield from _lines(value, str(key), f"{indent}  ")
    else:
        yield head + str(thing)


def printed(thing: Any) -> str:
    """A part, or a tree of parts such as a machine, with values and units."""
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(thing)):
        return eqx.tree_pformat(thing)
    return "\n".join(_lines(thing, ""))
