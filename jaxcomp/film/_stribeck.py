"""Friction of a bearing over its speed at one load: the curve of Stribeck."""

from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.arguments import single_number
from .._core.errors import BadInput
from .._core.results import Data, Result
from ._bearing import SIZES, JournalBearing, film_at, film_unit, load_number, prepare, sizes_of
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
    load: Float[Array, ""]
    speed: Float[Array, " n"]
    friction_torque: Float[Array, " n"]
    contact_torque: Float[Array, " n"]
    minimum_film: Float[Array, " n"]
    contact_load: Float[Array, " n"]

    table_dims: ClassVar[tuple[str, ...]] = ("speed",)
    nested_units: ClassVar[str] = f"""{SIZES}
        load, contact_load [N]; least_friction_speed, speed [rad/s]; minimum_film [m]
        friction_torque, contact_torque [N m]; friction_coefficient, film_over_roughness
    """

    @property
    def friction_coefficient(self) -> Float[Array, " n"]:
        """[-] (n,) Torque over load and radius of the journal."""
        return self.friction_torque / (self.load * self.bearing.radius)

    @property
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

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        at = self.table_dims
        yield Data("load", "N", self.load)
        yield Data("least_friction_speed", "rad/s", self.least_friction_speed)
        yield Data("speed", "rad/s", self.speed, at, "of the journal")
        yield Data("friction_torque", "N m", self.friction_torque, at, "of film and contact")
        yield Data("contact_torque", "N m", self.contact_torque, at, "of the contact")
        yield Data("friction_coefficient", "", self.friction_coefficient, at)
        yield Data("minimum_film", "m", self.minimum_film, at)
        yield Data("contact_load", "N", self.contact_load, at, "along the line of centres")
        if self.bearing.contact is not None:
            over = self.minimum_film / self.bearing.contact.roughness
            yield Data("film_over_roughness", "", over, at)

    def nested(self) -> dict[str, Any]:
        """The bearing, and its friction over the speed."""
        limits = {"limits": self.bearing.model.limits}
        return limits | sizes_of(self.bearing) | {d.name: d.values for d in self.described()}


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
