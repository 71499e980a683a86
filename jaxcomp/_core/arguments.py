"""Arguments of public functions: names, bounds, counts and single numbers, refused by name."""

from collections.abc import Collection, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import precision as precision  # before JAX runs anything
from .errors import BadInput


def listed_names(field: str, names: Any) -> Any:
    """Names in a list, or functions instead of names; `None` is left as it is.

    Raises:
        BadInput: a single text, or something else.
    """
    # a text is a collection as well, of letters, each of which would be refused as a name
    if isinstance(names, str):
        raise BadInput(field, f'"{names}"', f'a list, ["{names}"]')
    if names is None:
        return None
    # a quantity may be a function, and a single one needs no list
    entries = names if isinstance(names, Collection) else [names]
    if not all(isinstance(name, str) or callable(name) for name in entries):
        bound = 'a list of names, such as ["mechanical_efficiency"]'
        raise BadInput(field, str(names), f"{bound}; values go by name, as in {{name: value}}")
    return names


def by_names(field: str, table: Any, example: str) -> Any:
    """Entries by name.

    Raises:
        BadInput: no dictionary, or nothing at all.
    """
    if not isinstance(table, Mapping):
        kind = f"a {type(table).__name__}"
        if table is None:
            kind = "absent"
        raise BadInput(field, kind, f"a dictionary by name, such as {example}, in SI units")
    return table


def bounds_by_names(field: str, bounds: Any) -> Mapping[Any, Any]:
    """Lower and upper bounds by name, `None` for an open end.

    Raises:
        BadInput: no dictionary, or an entry that is no pair of numbers.
    """
    for name, ends in by_names(field, bounds or {}, '{"motor_power": (None, 5000.0)}').items():
        pair = isinstance(ends, tuple | list) and len(ends) == 2
        if not pair or any(isinstance(end, str) or np.ndim(end or 0.0) for end in ends):
            example = "(low, high) in SI units with None for an open end"
            raise BadInput(str(name), str(ends), f"a pair of bounds {example}")
    return bounds or {}


def single_number(field: str, number: Any) -> Float[Array, ""]:
    """[SI] One number, traced or not.

    Raises:
        BadInput: a text, or an array.
    """
    if isinstance(number, str):
        raise BadInput(field, f'"{number}"', "a number in SI units, as 0.05 for 50 mm")
    # as an array, because a Python number would be compiled into every program that takes it
    value = jnp.asarray(number, dtype=jnp.result_type(float))
    if value.ndim:
        bound = "one number; for many designs at once map the function with `jax.vmap`"
        raise BadInput(field, value, bound)
    return value


def counted(field: str, value: int, low: int = 1, high: int = 10**6) -> int:
    """A count, which must not take all time and memory.

    Raises:
        BadInput: a count outside its bounds, or no number.
    """
    if not isinstance(value, int | float | np.number) or not low <= value <= high:
        raise BadInput(field, value, f"a number >= {low} and <= {high}")
    return value
