r"""Journals on an oil film, the thrust bearing and the oil pump.

Notation: psi = c/r radial clearance over radius, l length, d = 2 r diameter, q = l/d, eta dynamic
viscosity, w rate of rotation. All moments have the sign of the rate and resist it.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eqs. (19)-(24). Its Eq. (20) prints the length factor as (l/d)^m; short bearings run more
eccentrically and rub more, so the factor is used upside down (see `LoadedPetroffJournal`). The
signs of the rate are added.
"""

from abc import abstractmethod
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, POSITIVE, Part, quantity
from ..film import ExplicitFit, JournalBearing, Reynolds, friction_moment
from ._laws import AbstractJournal

# Standard acceleration of free fall [m/s^2], exact by definition (CGPM 1901).
STANDARD_GRAVITY = 9.80665


class AbstractOilJournal(AbstractJournal):
    """A journal with its film: the four numbers that all film laws share."""

    diameter: eqx.AbstractVar[Float[Array, ""]]
    length: eqx.AbstractVar[Float[Array, ""]]
    radial_clearance: eqx.AbstractVar[Float[Array, ""]]
    dynamic_viscosity: eqx.AbstractVar[Float[Array, ""]]

    @property
    def clearance_ratio(self) -> Float[Array, ""]:
        """[-] psi = c/r."""
        return 2 * self.radial_clearance / self.diameter

    @property
    def drag(self) -> Float[Array, ""]:
        """[N m s] eta l d r/psi, the moment over the rate per unit of friction number."""
        area = self.length * self.diameter
        return self.dynamic_viscosity * area * self.diameter / 2 / self.clearance_ratio


class PetroffJournal(AbstractOilJournal):
    r"""Concentric film, $M = \pi\eta\omega l d r/\psi$ whatever the load (Dagilis et al., Eq. 19).

    Args:
        diameter: [m] d, of pin or journal.
        length: [m] l, of the bearing.
        radial_clearance: [m] radius of the bush minus that of the journal.
        dynamic_viscosity: [Pa s] eta, of the oil in the film.
    """

    kind: ClassVar[str] = "petroff"

    diameter: Float[Array, ""] = quantity("m", POSITIVE)
    length: Float[Array, ""] = quantity("m", POSITIVE)
    radial_clearance: Float[Array, ""] = quantity("m", POSITIVE)
    dynamic_viscosity: Float[Array, ""] = quantity("Pa s", POSITIVE)

    def moment(self, load, rate):
        return jnp.pi * self.drag * rate + jnp.zeros_like(load)


class LoadedPetroffJournal(AbstractOilJournal):
    r"""Petroff's moment with Falz' share of the load (Dagilis et al., Eq. 20, corrected).

    $$M = \pi\eta\omega l d r/\psi + 0.55\,\psi\,\xi F r\,\mathrm{sgn}\,\omega, \qquad
      \xi = (d/l)^{1.5}\ (l < d),\quad 1\ (l \ge d)$$

    Printed with (l/d)^1.5 and l/d in place of xi, which would let short bearings rub less.

    Args:
        diameter: [m] d, of pin or journal.
        length: [m] l, of the bearing.
        radial_clearance: [m] radius of the bush minus that of the journal.
        dynamic_viscosity: [Pa s] eta, of the oil in the film.
    """

    kind: ClassVar[str] = "loaded_petroff"

    diameter: Float[Array, ""] = quantity("m", POSITIVE)
    length: Float[Array, ""] = quantity("m", POSITIVE)
    radial_clearance: Float[Array, ""] = quantity("m", POSITIVE)
    dynamic_viscosity: Float[Array, ""] = quantity("Pa s", POSITIVE)

    def moment(self, load, rate):
        slenderness = jnp.maximum(self.diameter / self.length, 1.0) ** 1.5
        loaded = 0.55 * self.clearance_ratio * slenderness * load * self.diameter / 2
        return jnp.pi * self.drag * rate + loaded * jnp.sign(rate)


class FilmJournal(AbstractOilJournal):
    r"""Full circular film that carries the load, $M = \eta\omega l d r\,\Phi_T(S, q)/\psi$.

    Eqs. (21), (22) with $S = \psi^2 F/(\eta|\omega| l d)$; the source gives no $\Phi_T$, it is that
    of `jaxcomp.film`. The film is quasi-static (no squeeze) and the load counts as fixed in
    direction, both as in the source. For l/d from 0.1 to 2 (`film="fit"`: 0.4 to 2).

    Args:
        diameter: [m] of pin or journal.
        length: [m] of the bearing.
        radial_clearance: [m] radius of the bush minus that of the journal.
        dynamic_viscosity: [Pa s] of the oil in the film.
        film: "reynolds" for the table of solutions of Reynolds' equation, "fit" for closed formulas
            within 1.7 % of it at l/d from 0.5 to 1.5.

    Raises:
        ValueError: another film.
    """

    kind: ClassVar[str] = "film"

    diameter: Float[Array, ""] = quantity("m", POSITIVE)
    length: Float[Array, ""] = quantity("m", POSITIVE)
    radial_clearance: Float[Array, ""] = quantity("m", POSITIVE)
    dynamic_viscosity: Float[Array, ""] = quantity("Pa s", POSITIVE)
    film: Literal["reynolds", "fit"] = eqx.field(static=True, default="reynolds")

    def __check_init__(self):
        if self.film not in _FILMS:
            raise ValueError(f"`film` must be one of {tuple(_FILMS)}, but is {self.film!r}.")

    def conditions(self):
        low, high = _FILMS.get(self.film, Reynolds).length_ratio_range
        ratio = self.length / self.diameter
        # a hair of room, so that a ratio computed to be the bound is not refused
        inside = (ratio >= low * (1 - 1e-12)) & (ratio <= high * (1 + 1e-12))
        return {f"a journal with length/diameter from {low:g} to {high:g}": inside}

    @property
    def bearing(self) -> JournalBearing:
        """The same bearing for the functions of `jaxcomp.film`, such as `minimum_film`."""
        return JournalBearing(
            self.diameter / 2,
            self.length,
            self.radial_clearance,
            self.dynamic_viscosity,
            _FILMS[self.film],
        )

    def moment(self, load, rate):
        return friction_moment(self.bearing, load, rate)


_FILMS = {"reynolds": Reynolds, "fit": ExplicitFit}


class AbstractDrag(Part):
    """A moment on the shaft that no joint force governs."""

    @abstractmethod
    def moment(self, rate: Float[Array, "*n"], weight: Float[Array, ""]) -> Float[Array, "*n"]:
        """[N m] at a rate of rotation [rad/s], for a weight [N] of shaft and rotor."""


class ThrustBearing(AbstractDrag):
    r"""Flat ring under the weight of the shaft, uniform pressure (Dagilis et al., Eq. 24).

    $$M = \tfrac23\mu\, m_r g\, \frac{R_t^3 - r_t^3}{R_t^2 - r_t^2}$$

    Args:
        coefficient: [-] mu, coefficient of friction.
        outer_radius: [m] R_t.
        inner_radius: [m] r_t.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "thrust"

    coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="coefficient of friction")
    outer_radius: Float[Array, ""] = quantity("m", POSITIVE, doc="R_t")
    inner_radius: Float[Array, ""] = quantity("m", NONNEGATIVE, default=0.0, doc="r_t")
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def conditions(self):
        return {"a ring with inner_radius < outer_radius": self.inner_radius < self.outer_radius}

    @property
    def friction_radius(self) -> Float[Array, ""]:
        """[m] 2/3 (R^3 - r^3)/(R^2 - r^2), with the common factor R - r cancelled."""
        outer, inner = self.outer_radius, self.inner_radius
        return 2 / 3 * (outer**2 + outer * inner + inner**2) / (outer + inner)

    def moment(self, rate, weight):
        level = self.coefficient * weight * self.friction_radius
        return level * _direction(rate, self.transition_rate)


class OilPump(AbstractDrag):
    """A constant torque (M_p of Dagilis et al., Eq. 29), against the rotation.

    Args:
        torque: [N m] M_p.
        transition_rate: [rad/s] smooths the law through rest, for start and stop; absent: none.
    """

    kind: ClassVar[str] = "pump"

    torque: Float[Array, ""] = quantity("N m", NONNEGATIVE)
    transition_rate: Float[Array, ""] | None = quantity(
        "rad/s", POSITIVE, default=None, doc="smooths the law through rest, for start and stop"
    )

    def moment(self, rate, weight):
        del weight
        return self.torque * _direction(rate, self.transition_rate)


def _direction(rate, transition_rate):
    return jnp.sign(rate) if transition_rate is None else jnp.tanh(rate / transition_rate)
