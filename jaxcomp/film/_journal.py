"""What a journal in its bush is to the rest: a friction moment, or the name of one that has it."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from .._fields import BadInput, Part


class AbstractJournal(Part):
    """Friction of a journal in its bush."""

    @abstractmethod
    def moment(self, load: Float[Array, "*n"], rate: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N m] for a load [N] >= 0 and a relative rate of rotation [rad/s]."""


class NamedBearing(AbstractJournal):
    """A bearing of the machine, by its name among `[bearings.NAME]`.

    `jaxcomp.Machine` puts the bearing itself in its place before anything is computed. In a scene
    file the bare name stands for it: `crank_pin = "big-end"`.

    Args:
        name: of the bearing.
    """

    kind: ClassVar[str] = "bearing"

    name: str = eqx.field(static=True)

    def moment(self, load, rate):
        raise BadInput("bearing", self.name, "resolved by its machine, see `jaxcomp.Machine`")
