r"""Journal bearings between two nodes: stiffness and damping of the film at its static load.

Source: Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`, Eqs. (6) and (7), whose
number is Someya's with the speed in rev/s.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._fields import BadInput, Part, quantity
from ..film import AbstractSolvedFilm, JournalBearing, NamedBearing, stiffness_damping


class LoadedFilm(Part):
    """The film of a bearing under its static load, see `jaxcomp.film.stiffness_damping`.

    Args:
        bearing: the bearing, or the name of one of the machine.
        load: [N] (2,) static load on the journal along x and y, or (m, 2) at the speeds of `speed`;
            absent: from the crank's periodic state and the statics of the shaft, at every speed.
        speed: [rad/s] (m,) increasing spin speeds of a table of loads, which is interpolated linearly
            and held beyond its ends.

    Raises:
        BadInput: a film model without stiffness and damping, or loads that do not fit the speeds.
    """

    kind: ClassVar[str] = "film"
    size: ClassVar[int] = 2

    bearing: JournalBearing | NamedBearing
    load: Array | None = quantity(
        "N",
        shape=(...,),
        default=None,
        doc="static, on the journal, along x and y; absent: from the crank's periodic state",
    )
    speed: Array | None = quantity(
        "rad/s", shape=(None,), default=None, doc="of the rows of a table of loads"
    )

    def __check_init__(self):
        if isinstance(self.bearing, JournalBearing) and not issubclass(
            self.bearing.model, AbstractSolvedFilm
        ):
            raise BadInput("bearing.film", self.bearing.film, "a film with stiffness and damping")
        wanted = (2,) if self.speed is None else (*self.speed.shape, 2)
        if self.load is not None and self.load.shape != wanted:
            raise BadInput("load", self.load, f"of shape {wanted}")

    def coefficients(self, spin_speed):
        """Stiffness and damping of the film at a spin speed.

        Raises:
            BadInput: a bearing or load that only the whole machine knows.
        """
        if self.load is None or isinstance(self.bearing, NamedBearing):
            what = "bearing" if isinstance(self.bearing, NamedBearing) else "load"
            raise BadInput(what, "open", "resolved by its machine, see `jaxcomp.Machine`")
        load = self.load
        if self.speed is not None:
            at = jnp.abs(spin_speed)
            load = jax.vmap(lambda column: jnp.interp(at, self.speed, column), -1)(load)
        return tuple(stiffness_damping(self.bearing, load, spin_speed))
