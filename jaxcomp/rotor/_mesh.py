r"""Building shaft tables: lines of elements, and steps cut into elements."""

import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from ._shaft import Node, ShaftElements


def shaft_line(nodes: tuple[Node, ...], *, length, outer_diameter, **columns) -> ShaftElements:
    """A line of elements through the nodes, every field by its name.

    Args:
        nodes: n + 1 node names in the direction of z.
        length: [m] one value or (n,)
        outer_diameter: [m] one value or (n,)
        **columns: the other fields of `ShaftElements`, arrays by one value or (n,).
    """
    return ShaftElements(nodes, length, outer_diameter, **columns)


def stepped_shaft(
    length, outer_diameter, *, elements: int | tuple[int, ...] = 1, first: int = 1, **columns
) -> ShaftElements:
    """A shaft of cylindrical or conical steps, each cut into elements; nodes are numbered.

    Args:
        length: [m] (steps,)
        outer_diameter: [m] (steps,)
        elements: number of elements of each step.
        first: number of the first node.
        **columns: the other fields, one value or (steps,); end diameters make cones.

    Raises:
        BadInput: numbers of elements that are not one a step, or below one.
    """
    length = jnp.asarray(length, float)
    steps = length.shape[0]
    counts = (elements,) * steps if isinstance(elements, int) else tuple(elements)
    if len(counts) != steps or min(counts) < 1:
        raise BadInput("elements", str(counts), f"a number of at least 1 for each of {steps} steps")
    which = np.repeat(np.arange(steps), counts)
    within = np.concatenate([np.arange(c) for c in counts])
    share = np.repeat(1 / np.array(counts), counts)
    plain = {"theory", "shear_law", "spins"}
    table = {
        name: value if name in plain else _column(value, steps)[which]
        for name, value in columns.items()
        if value is not None
    }
    table |= {"length": length[which] * share}
    table |= {"outer_diameter": _column(outer_diameter, steps)[which]}
    for name in ("outer_diameter", "inner_diameter"):
        if f"{name}_end" in table:
            a = table.get(name, jnp.zeros(len(which)))
            b = table[f"{name}_end"]
            table[name] = a + (b - a) * within * share
            table[f"{name}_end"] = a + (b - a) * (within + 1) * share
    nodes = tuple((first + i, first + i + 1) for i in range(len(which)))
    return ShaftElements(nodes, **table)


def _column(value, n):
    value = jnp.asarray(value, float)
    return jnp.full(n, value) if value.ndim == 0 else value
