r"""Journal bearings between two nodes: stiffness and damping of the film at its static load.

Source: *Balancing a hermetic single-cylinder refrigeration compressor* (paper 000), Eqs. (6) and (7),
whose number is Someya's with the speed in rev/s.
"""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .._fields import POSITIVE, BadInput, Part, quantity
from ..film import (
    GroovedReynolds,
    JournalBearing,
    Reynolds,
    someya_two_axial_grooves,
    stiffness_damping,
)

_FILMS = {"plain": Reynolds, "grooved": GroovedReynolds}

# [rad/s] Below this speed the coefficients are held, so that a rotor at rest has finite ones.
_REST_SPEED = 1e-3


class JournalFilm(Part):
    """Film of a plain ring or of one with two axial grooves, see `jaxcomp.film.stiffness_damping`.

    Args:
        diameter: [m] of the journal.
        length: [m]
        radial_clearance: [m]
        dynamic_viscosity: [Pa s]
        load: [N] (2,) static load on the journal along x and y.
        ring: "plain" for `Reynolds`, "grooved" for `GroovedReynolds`.

    Raises:
        BadInput: another ring.
    """

    kind: ClassVar[str] = "film"
    size: ClassVar[int] = 2

    diameter: Array = quantity("m", POSITIVE, doc="of the journal")
    length: Array = quantity("m", POSITIVE)
    radial_clearance: Array = quantity("m", POSITIVE)
    dynamic_viscosity: Array = quantity("Pa s", POSITIVE)
    load: Array = quantity("N", shape=(2,), doc="static, on the journal, along x and y")
    ring: Literal["plain", "grooved"] = eqx.field(static=True, default="plain")

    def __check_init__(self):
        if self.ring not in _FILMS:
            raise BadInput("ring", self.ring, f"one of {tuple(_FILMS)}")

    def coefficients(self, spin_speed):
        """Stiffness and damping of the film at a spin speed."""
        bearing = JournalBearing(
            self.diameter / 2,
            self.length,
            self.radial_clearance,
            self.dynamic_viscosity,
            film=_FILMS[self.ring],
        )
        return tuple(stiffness_damping(bearing, self.load, spin_speed))


class GroovedFilm(Part):
    r"""Published coefficients of a bearing with two axial grooves, `someya_two_axial_grooves`.

    $S = (\eta n L D/W)(R/c)^2$ with n in rev/s; the published matrices c K/W and c w C/W have their
    first axis along the load and the second ahead with the rotation. The tables are interpolated
    in ln S and go on along their end slopes.

    Args:
        length_ratio: L/D, "0.5" or "1" as published.
        diameter: [m] of the journal.
        radial_clearance: [m]
        dynamic_viscosity: [Pa s]
        load: [N] (2,) static load on the journal along x and y; not zero.
    """

    kind: ClassVar[str] = "grooved_film"
    size: ClassVar[int] = 2

    length_ratio: Literal["0.5", "1"] = eqx.field(static=True)
    diameter: Array = quantity("m", POSITIVE, doc="of the journal")
    radial_clearance: Array = quantity("m", POSITIVE)
    dynamic_viscosity: Array = quantity("Pa s", POSITIVE)
    load: Array = quantity("N", shape=(2,), doc="static, on the journal, along x and y")

    def conditions(self):
        return {"a bearing with a load": jnp.any(self.load != 0)}

    def sommerfeld_number(self, spin_speed):
        """[-] S at a spin speed."""
        area = float(self.length_ratio) * self.diameter**2
        pressure = jnp.hypot(*self.load) / area
        turns = jnp.sqrt(spin_speed**2 + _REST_SPEED**2) / (2 * jnp.pi)
        half = self.diameter / 2 / self.radial_clearance
        return self.dynamic_viscosity * turns / pressure * half**2

    def coefficients(self, spin_speed):
        """Stiffness and damping of the film at a spin speed."""
        point = someya_two_axial_grooves(
            self.sommerfeld_number(spin_speed), float(self.length_ratio)
        )
        load, pace = jnp.hypot(*self.load), jnp.sqrt(spin_speed**2 + _REST_SPEED**2)
        along = self.load / load
        # Turning the other way is the mirror image: the entries that couple the axes change sign.
        mirror = jnp.eye(2) + (1 - jnp.eye(2)) * spin_speed / pace
        axes = jnp.array([[along[0], -along[1]], [along[1], along[0]]])
        unit = load / self.radial_clearance
        return (
            unit * (axes @ (mirror * point.stiffness) @ axes.T),
            unit / pace * (axes @ (mirror * point.damping) @ axes.T),
        )
