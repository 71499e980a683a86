"""Laws of different kinds for the cylinders of one machine.

Laws of one kind are one law whose numbers are lists over the cylinders. Where the kinds differ, the
cylinders are sorted into groups: each is evaluated at once, and its law traced once.
"""

from collections.abc import Callable
from operator import itemgetter
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ._fields import BadInput, Part, listed


class AbstractEach(Part):
    """A law that is another one for some of the cylinders.

    Attributes:
        laws: the kinds.
        of_cylinder: number of its law, from 1, for every cylinder; absent: one law for each in turn.
    """

    # what a law says of itself that none of these may be
    of_whole_machine: ClassVar[bool] = True

    laws: eqx.AbstractVar[tuple[Any, ...]]
    of_cylinder: eqx.AbstractVar[tuple[int, ...]]

    def __post_init__(self):
        if not self.of_cylinder and isinstance(self.laws, tuple):
            object.__setattr__(self, "of_cylinder", tuple(range(1, len(self.laws) + 1)))

    def __check_init__(self):
        if not self.laws or set(self.of_cylinder) != set(range(1, len(self.laws) + 1)):
            bound = f"numbers from 1 to {len(self.laws)}, each of them at least once"
            raise BadInput("of_cylinder", str(self.of_cylinder), bound)
        for number, law in enumerate(self.laws):
            if getattr(law, "of_whole_machine", False):
                raise BadInput(f"laws.{number}", str(law.kind), "a law of one cylinder")
            for path, value in listed(law).items():
                bound = "a single value: cylinders with other values have a law of their own"
                raise BadInput(f"laws.{number}.{path}", value, bound)

    def one(self, number: int) -> Any:
        """The law of a cylinder, from 1."""
        return self.laws[self.of_cylinder[number - 1] - 1]

    def each(self, method: Callable[..., Any], *arguments) -> Any:
        """What a method gives for every cylinder, with a leading axis of them.

        Args:
            method: of a law, and what is passed on of the arguments.
            arguments: trees of arrays with a leading axis of cylinders.
        """
        groups: dict[Any, list[int]] = {}
        for place in range(len(self.of_cylinder)):
            leaves, kind = jax.tree.flatten(self.one(place + 1))
            groups.setdefault((kind, *(jnp.shape(leaf) for leaf in leaves)), []).append(place)
        parts = []
        for places in groups.values():
            laws = [self.one(place + 1) for place in places]
            stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *laws)
            taken = [jax.tree.map(itemgetter(np.array(places)), one) for one in arguments]
            parts.append(jax.vmap(method)(stacked, *taken))
        back = np.argsort([place for places in groups.values() for place in places])
        return jax.tree.map(lambda *x: jnp.concatenate(x)[back], *parts)
