r"""A journal whose centre moves in its film over the revolution, as the crank's solvers take it.

With F the load on the journal, $c\,e$ its centre, V the effective velocity of `_squeeze` and
$J_0 = 2\pi\eta R^3 L/(c\sqrt{1-\epsilon^2})$ the film puts against journal and bush the moments

$$M_j = J_0(\omega_j-\omega_b) - \tfrac{c}{2}\,e\times F, \quad
  M_b = -J_0(\omega_j-\omega_b) - \tfrac{c}{2}\,e\times F, \quad
  P = J_0(\omega_j-\omega_b)^2 + c\,F\cdot V .$$

The dissipation P, not $M_j\omega_j$, is what the crank has to pay: the load does the work $F\cdot de$ in
the clearance, which the rigid mechanism does not have. Shear is counted over the whole ring.
"""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import POSITIVE, BadInput, quantity
from ._bearing import ROUGHNESS, THIN, JournalBearing, friction_moment
from ._film import Scalar
from ._models import Ocvirk
from ._parts import AbstractJournal, AbstractRing, film_unit, within
from ._squeeze import TABLE_RANGE, AbstractSqueeze, OcvirkSqueeze, Pair, ReynoldsSqueeze

_SQUEEZE: dict[str, type[AbstractSqueeze]] = {"reynolds": ReynoldsSqueeze, "short": OcvirkSqueeze}

# [rad/s] Of the crank: near rest the dissipation over the speed is no torque, and is left out.
_REST = 0.2


class OrbitBearing(AbstractRing):
    """Journal bearing whose journal moves in its film: the orbit is solved with the crank's motion.

    Full ring, aligned, isothermal, isoviscous, laminar, unfed. Films that re-form are full of oil at
    once, which makes films too thick and loss too low where the feed is starved.

    Args:
        diameter: [m] Journal diameter D.
        length: [m] L of all lands together, without the groove between them.
        radial_clearance: [m] c, bush radius minus journal radius.
        dynamic_viscosity: [Pa s] eta; absent where `oil` names the oil.
        film: "reynolds" for the table of finite films with free edges, "short" for the exact short film.
        oil: Name of an oil of the machine, which gives the viscosity.
        lands: Two with a full circumferential groove, in parallel, else one.
        thin_film: [m] Films below count as thin in results, such as some times the roughness; absent:
            5 µm.
        roughness: [m] as in `JournalBearing`.

    Raises:
        BadInput: for a value that is not positive, L/D of a land outside the table, another film, no
            land, or neither or both of `dynamic_viscosity` and `oil`.
    """

    kind: ClassVar[str] = "orbit"

    length: Scalar = quantity("m", POSITIVE, doc="of all lands together")
    film: Literal["reynolds", "short"] = eqx.field(static=True, default="reynolds")
    oil: str | None = eqx.field(static=True, default=None)
    lands: int = eqx.field(static=True, default=1)
    thin_film: Scalar | None = quantity("m", POSITIVE, default=None, doc=THIN, usual=(1e-8, 1e-4))
    roughness: Scalar | None = quantity(
        "m", POSITIVE, default=None, doc=ROUGHNESS, usual=(1e-9, 1e-5)
    )

    def __check_init__(self):
        if self.film not in _SQUEEZE:
            raise BadInput("film", str(self.film), f"one of {', '.join(_SQUEEZE)}")
        if self.lands not in (1, 2):
            raise BadInput("lands", self.lands, "1 or 2")

    @property
    def length_ratio(self) -> Scalar:
        """[-] q = L/D of a land."""
        return self.length / (self.lands * self.diameter)

    def conditions(self):
        if self.film == "short":
            return {}
        low, high = TABLE_RANGE
        rule = f"of length/diameter {low:g} to {high:g} a land"
        return {rule: within(self.length_ratio, low, high)}

    @property
    def steady(self) -> JournalBearing:
        """One land as a bearing that stays where a steady load would hold it."""
        return JournalBearing(
            self.diameter, self.length / self.lands, self.radial_clearance, self.dynamic_viscosity,
            self.film, None if self.dynamic_viscosity is not None else self.oil,
        )  # fmt: skip

    def moment(self, load, rate):
        """[N m] Friction moment in the place where a steady load [N] would hold the journal."""
        return self.lands * friction_moment(self.steady, load / self.lands, rate)


def squeeze_of(bearing: OrbitBearing | JournalBearing) -> AbstractSqueeze:
    """The film of a moving journal in a bearing; of a steady one with the same equations or nearest."""
    if isinstance(bearing, OrbitBearing):
        return _SQUEEZE[bearing.film](bearing.length_ratio)
    short = bearing.model is Ocvirk
    return (OcvirkSqueeze if short else ReynoldsSqueeze)(bearing.length_ratio)


def shear_drag(bearing: OrbitBearing | JournalBearing, position: Pair) -> Float[Array, "*n"]:
    """[N m s] J_0, moment over the relative rate of rotation, at a position over c."""
    square = position[0] ** 2 + position[1] ** 2
    room = jnp.sqrt(jnp.maximum(1 - square, 1e-9))
    volume = bearing.radius**3 * bearing.length / bearing.radial_clearance
    return 2 * jnp.pi * bearing.dynamic_viscosity * volume / room


class PlacedJournal(AbstractJournal):
    """A moving journal at known positions.

    Args:
        bearing: the bearing.
        position: [-] (2, *n) centre of the journal over c at every instant.
        lossless: whether somebody else counts its loss.
    """

    bearing: OrbitBearing
    position: Pair
    lossless: bool = eqx.field(static=True, default=False)

    def moment(self, load, rate):
        raise BadInput("journal", "moving", "given the force vector, not its size")

    def bush_moment(self, force: Pair, rate: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N m] Drag on the bush along the rate, for the bush's force [N] on the journal's partner.

        Args:
            force: [N] on the bush, minus the load on the journal.
            rate: [rad/s] of the journal in the bush.
        """
        e, c = self.position, self.bearing.radial_clearance
        turning = e[1] * force[0] - e[0] * force[1]  # e x F of the load on the journal
        return shear_drag(self.bearing, e) * rate + 0.5 * c * turning

    def dissipation(
        self, force: Pair, rate: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """[W] Shear and squeeze at the same arguments."""
        unit, load = film_unit(self.bearing), jnp.stack([-force[0], -force[1]])
        velocity = squeeze_of(self.bearing).mobility(self.position, load / unit)
        power = load[0] * velocity[0] + load[1] * velocity[1]
        return shear_drag(self.bearing, self.position) * rate**2, (
            self.bearing.radial_clearance * power
        )

    def loss_torque(self, force: Pair, rate, speed) -> Float[Array, "*n"]:
        """[N m] Dissipation over the speed of the crank [rad/s]."""
        if self.lossless:
            return jnp.zeros_like(speed)
        return sum(self.dissipation(force, rate)) * speed**3 / (speed**4 + _REST**4)
