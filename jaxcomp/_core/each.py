"""Parts of different kinds in one row: laws of the cylinders of a machine, films of its journals.

Parts of one kind are one part whose numbers have a leading axis. Where the kinds differ, the row is
sorted into groups: each is evaluated at once, and traced once.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from .errors import BadInput
from .fields import Part, is_listed, quantities, replaced, subparts

_Tree = TypeVar("_Tree")


def listed(tree: Any) -> dict[str, Array]:
    """The numbers of a part, or of a tree of parts, that are lists over cylinders, by dotted path."""
    numbers = {}
    for path, part in subparts(tree):
        for name, field in quantities(part):
            value = getattr(part, name)
            if is_listed(part, field, value):
                numbers[f"{path}.{name}" if path else name] = value
    return numbers


def of_cylinder(tree: _Tree, number: int = 1) -> _Tree:
    """A part with the numbers of one cylinder, from 1, where lists or laws have one for each."""
    return _with_lists(tree, lambda value: value[number - 1], number)


def along_cylinders(tree: _Tree, like: Array) -> _Tree:
    """A part whose lists over k cylinders have a shape (k, 1, ...) that goes with instants."""
    return _with_lists(tree, lambda value: value.reshape(value.shape + (1,) * jnp.ndim(like)))


def _with_lists(tree: _Tree, change: Callable[[Array], Array], number: int | None = None) -> _Tree:
    """A part with every list over cylinders changed by a function, in the parts inside it as well.

    With a number of a cylinder, laws that differ in kind are replaced by that cylinder's.
    """
    if not isinstance(tree, Part):
        return tree
    if isinstance(tree, AbstractEach) and number is not None:
        return tree.law_of_cylinder(number)
    changes = {}
    for field in dataclasses.fields(tree):
        value = getattr(tree, field.name)
        if isinstance(value, Part):
            new = _with_lists(value, change, number)
            # untouched parts stay the same objects, and a tree without lists is returned as it came
            if new is not value:
                changes[field.name] = new
        elif "unit" in field.metadata and is_listed(tree, field, value):
            changes[field.name] = change(value)
    return replaced(tree, **changes)  # pyright: ignore[reportReturnType]


def stacked(parts: Sequence[Any]) -> Any:
    """Parts of one structure as one, whose arrays have a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)


def mapped(
    function: Callable[..., Any], parts: Sequence[Any], *arguments, axis: int = 0, out_axis: int = 0
) -> Any:
    """Values of a function for every part of a row, with an axis of them.

    Args:
        function: of a part, and what is passed on of the arguments.
        parts: of any kinds.
        arguments: trees of arrays with an axis of the parts.
        axis, out_axis: where that axis stands in the arguments and in what is returned.
    """
    if len(parts) == 1:
        # without `vmap`: a program for a single cylinder has no axis that it does not need
        single = partial(lax.index_in_dim, index=0, axis=axis, keepdims=False)
        value = function(parts[0], *jax.tree.map(single, arguments))
        return jax.tree.map(partial(jnp.expand_dims, axis=out_axis), value)
    # parts of one structure and of equal shapes are evaluated as one batch
    groups: dict[Any, list[int]] = {}
    for place, part in enumerate(parts):
        leaves, kind = jax.tree.flatten(part)
        groups.setdefault((kind, *map(jnp.shape, leaves)), []).append(place)
    group_values = []
    for places in groups.values():
        group_arguments = arguments
        if len(groups) > 1:
            # in range, so that a program need not test the places, as JAX does without a mode
            take = partial(jnp.take, indices=np.array(places), axis=axis, mode="clip")
            group_arguments = jax.tree.map(take, arguments)
        in_axes = (0, *[axis] * len(group_arguments))
        batched = jax.vmap(function, in_axes=in_axes, out_axes=out_axis)
        group_values.append(batched(stacked([parts[place] for place in places]), *group_arguments))
    if len(groups) == 1:
        return group_values[0]
    # from the order of the groups back to that of the parts
    order = np.argsort(list(chain.from_iterable(groups.values())))

    def in_order(*values):
        return jnp.take(jnp.concatenate(values, out_axis), order, out_axis, mode="clip")

    return jax.tree.map(in_order, *group_values)


class AbstractEach(Part):
    """A law that is another one for some of the cylinders.

    Attributes:
        laws: the kinds.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.
    """

    # what a law says of itself that none of these may be
    of_whole_machine: ClassVar[bool] = True

    laws: tuple[Any, ...]
    of_cylinder: tuple[int, ...] = eqx.field(static=True, default=())

    def __post_init__(self):
        if not self.of_cylinder and isinstance(self.laws, tuple):
            object.__setattr__(self, "of_cylinder", tuple(range(1, len(self.laws) + 1)))

    def __check_init__(self):
        if not self.laws:
            raise BadInput("laws", "[]", "one law at least")
        if set(self.of_cylinder) != set(range(1, len(self.laws) + 1)):
            bound = f"numbers from 1 to {len(self.laws)}, each of them at least once"
            raise BadInput("of_cylinder", str(self.of_cylinder), bound)
        for number, law in enumerate(self.laws):
            if getattr(law, "of_whole_machine", False):
                raise BadInput(f"laws.{number}", str(law.kind), "a law of one cylinder")
            # a list would have a value for each cylinder of a law that only some of them follow
            for path, value in listed(law).items():
                bound = "a single value: cylinders with other values have a law of their own"
                raise BadInput(f"laws.{number}.{path}", value, bound)

    def law_of_cylinder(self, number: int) -> Any:
        """The law of a cylinder, from 1."""
        return self.laws[self.of_cylinder[number - 1] - 1]

    def each(self, method: Callable[..., Any], *arguments) -> Any:
        """Values of a method of the laws for every cylinder, see `mapped`."""
        return mapped(method, self._laws_of_cylinders(), *arguments)

    def _laws_of_cylinders(self) -> list[Any]:
        """The law of every cylinder, one after the other."""
        # counted from 1, as users count cylinders and laws
        return [self.laws[number - 1] for number in self.of_cylinder]
