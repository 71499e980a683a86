r"""Journal bearings between two nodes: stiffness and damping of the film.

They are those at the static load of the film, or the means over a revolution along the orbit that the
journal has in the crank's periodic state.

Source: Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`, Eqs. (6) and (7), whose
number is Someya's with the speed in rev/s.
"""

from typing import ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import BadInput, Part, quantity
from ..film import (
    AbstractSolvedFilm,
    DynamicCoefficients,
    JournalBearing,
    NamedBearing,
    OrbitBearing,
    stiffness_damping,
)


class LoadedFilm(Part):
    """The film of a bearing, linearised; see `jaxcomp.film.stiffness_damping`.

    Args:
        bearing: the bearing, or the name of one of the machine. One whose journal moves in its film is
            taken as the same bearing under a steady load.
        load: [N] (2,) static load on the journal along x and y, or (m, 2) at the speeds of `speed`;
            absent: from the crank's periodic state and the statics of the shaft, at every speed.
        speed: [rad/s] (m,) increasing spin speeds of a table of loads, which is interpolated linearly
            and held beyond its ends.
        linearised: where stiffness and damping are taken: at the "mean_load", or as their means over a
            revolution along the "orbit" of the journal, which the crank's periodic state gives.
        name: of the bearing in the results of the crank; by default its own.

    Raises:
        BadInput: a film model without stiffness and damping, loads that do not fit the speeds, or a
            load beside "orbit".
    """

    kind: ClassVar[str] = "film"
    size: ClassVar[int] = 2

    bearing: JournalBearing | OrbitBearing | NamedBearing
    load: Array | None = quantity(
        "N",
        shape=(...,),
        default=None,
        doc="static, on the journal, along x and y; absent: from the crank's periodic state",
    )
    speed: Array | None = quantity(
        "rad/s", shape=(None,), default=None, doc="of the rows of a table of loads"
    )
    linearised: Literal["mean_load", "orbit"] = eqx.field(static=True, default="mean_load")
    name: str | None = eqx.field(static=True, default=None)

    def __post_init__(self):
        # at the mean load the name stays out, so that films of one kind are traced once
        if self.linearised == "orbit" and isinstance(self.bearing, NamedBearing):
            self.name = self.name or self.bearing.name

    def __check_init__(self):
        if isinstance(self.bearing, JournalBearing) and not issubclass(
            self.bearing.model, AbstractSolvedFilm
        ):
            raise BadInput("bearing.film", self.bearing.film, "a film with stiffness and damping")
        wanted = (2,) if self.speed is None else (*self.speed.shape, 2)
        if self.load is not None and self.load.shape != wanted:
            raise BadInput("load", self.load, f"of shape {wanted}")
        if self.linearised not in ("mean_load", "orbit"):
            raise BadInput("linearised", self.linearised, '"mean_load" or "orbit"')
        if self.linearised == "orbit" and self.load is not None:
            raise BadInput("load", self.load, 'absent beside linearised = "orbit"')

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
        return tuple(steady_coefficients(self.bearing, load, spin_speed))


def steady_coefficients(
    bearing: JournalBearing | OrbitBearing, load: Float[Array, "2"], speed: Float[Array, ""]
) -> DynamicCoefficients:
    """Stiffness [N/m] and damping [N s/m] of a bearing under a steady load [N] at a speed [rad/s]."""
    if isinstance(bearing, JournalBearing):
        return stiffness_damping(bearing, load, speed)
    land = stiffness_damping(bearing.steady, load / bearing.lands, speed)
    return DynamicCoefficients(*(bearing.lands * value for value in land))
