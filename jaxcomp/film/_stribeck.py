"""Friction of a bearing over its speed at one load: the curve of Stribeck."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.arguments import single_number
from .._core.declared import computed, computed_part, computed_word, reading
from .._core.errors import BadInput
from .._core.results import Result
from ._bearing import (
    BearingSizes,
    JournalBearing,
    film_at,
    film_unit,
    load_number,
    prepare,
    sizes_of,
)
from ._contact import MixedFilm
from ._film import AbstractCarryingFilm, film_ratio


class StribeckCurve(Result, eqx.Module):
    """A bearing under a steady load at n speeds.

    Attributes:
        bearing: with its viscosity.
        load: [N] on the journal.
        speed: [rad/s] (n,) of the journal.
        friction_torque: [N m] (n,) of film and contact together.
        contact_torque: [N m] (n,) part of it that the contact of the surfaces makes.
        minimum_film: [m] (n,)
        contact_load: [N] (n,) of the contact, along the line of centres.
    """

    bearing: JournalBearing
    load: Float[Array, ""] = reading("N")
    speed: Float[Array, " n"] = reading("rad/s", "speed", doc="of the journal")
    friction_torque: Float[Array, " n"] = reading("N m", "speed", doc="of film and contact")
    contact_torque: Float[Array, " n"] = reading("N m", "speed", doc="of the contact")
    minimum_film: Float[Array, " n"] = reading("m", "speed")
    contact_load: Float[Array, " n"] = reading("N", "speed", doc="along the line of centres")

    table_dims: ClassVar[tuple[str, ...]] = ("speed",)

    @computed_word()
    def limits(self) -> str:
        """Limits of the film model."""
        return self.bearing.model.limits

    @computed_part(BearingSizes, inline=True)
    def sizes(self) -> BearingSizes:
        """Dimensions, viscosity, film and contact of the bearing."""
        return sizes_of(self.bearing)

    @computed("", "speed")
    def friction_coefficient(self) -> Float[Array, " n"]:
        """[-] (n,) Torque over load and radius of the journal."""
        return self.friction_torque / (self.load * self.bearing.radius)

    @computed("rad/s")
    def least_friction_speed(self) -> Float[Array, ""]:
        """[rad/s] Where the torque is least: of the parabola through the lowest points in ln speed."""
        x = np.log(np.asarray(self.speed))
        torque = np.asarray(self.friction_torque)
        if x.size < 3:
            return self.speed[np.argmin(torque)]
        place = int(np.clip(np.argmin(torque), 1, x.size - 2))
        near = slice(place - 1, place + 2)
        bend, slope, _ = np.polyfit(x[near] - x[place], torque[near], 2)
        # least at an end of the speeds, or within
        step = x[np.argmin(torque)] - x[place]
        if bend > 0:
            step = -0.5 * slope / bend
        return jnp.asarray(np.exp(np.clip(x[place] + step, x[near][0], x[near][-1])))

    @computed("", "speed", optional=True)
    def film_over_roughness(self) -> Float[Array, " n"] | None:
        """[-] (n,) Smallest film over the roughness of the surfaces; `None` without contact."""
        if self.bearing.contact is None:
            return None
        return self.minimum_film / self.bearing.contact.roughness


@eqx.filter_jit
def _points(bearing, load, speed):
    """Whole friction, that of the contact [N m], thickness [m] and load of the contact [N]."""
    film = film_at(bearing, speed)
    number = load_number(bearing, load, speed)
    part = prepare(bearing).bearing
    unit = film_unit(part) * speed * part.radius * part.clearance_ratio
    x = film_ratio(film, number)
    none = 0 * speed
    rubs = none
    push = none
    if isinstance(film, MixedFilm):
        rubs = unit * film.rubbing(x)
        push = film.contact.forces(x / (1 + x))[0]
        # what the contact carries, the film need not
        number = film.film_number(x, number)
        film = film.film
    smooth = unit * film.friction_number(number)
    return smooth + rubs, rubs, part.radial_clearance / (1 + x), push


def stribeck_curve(
    bearing: JournalBearing,
    load: float | Float[Array, ""],
    speed: Float[Array, " n"],
) -> StribeckCurve:
    """Friction of a bearing under a steady load over its speed.

    Args:
        bearing: with its viscosity, a film that gives a position, and usually a contact.
        load: [N] on the journal, > 0.
        speed: [rad/s] (n,) of the journal, > 0 and rising.

    Raises:
        BadInput: a load or speeds that are not, or a film without a position.
    """
    load = single_number("load", load)
    speed = jnp.asarray(speed, float)
    if not load > 0:
        raise BadInput("load", float(load), "> 0 N")
    if speed.ndim != 1 or not speed.size or not speed[0] > 0 or not jnp.all(jnp.diff(speed) > 0):
        raise BadInput("speed", speed, "a list of speeds > 0 rad/s that rise")
    if not issubclass(bearing.model, AbstractCarryingFilm):
        raise BadInput("film", bearing.film, "one that gives the position of the journal")
    torque, rubs, thickness, push = jax.vmap(_points, (None, None, 0))(bearing, load, speed)
    return StribeckCurve(bearing, load, speed, torque, rubs, thickness, push)
