r"""Joint forces and losses of the slider-link mechanism.

With the motion given everything is explicit (see `jaxcomp.mechanism.contact`): the contacts of
piston and link, the force of the crank pin, the reactions of the bearings, and with them the
losses. The print omits the couple between slider and link that keeps the slider from turning,
$M_b = m_2 N D_s/2 - M_k$. With `slider_moment="balanced"` it is in: the term with $D_s$ of Eq. (9)
cancels and the moment $M_k$ of the crank pin loads the piston, which closes a weak loop.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eqs. (1)-(18), (29), (31)-(35).
"""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import max_of, minimum
from ..film import AbstractJournal
from ..film._placed import PlacedJournal
from ..mechanism import CrankState, LinkMotion, SliderLink, Vector, contact
from ..mechanism._slider_link import Contact, ContactArms, PistonLoads, contact_arms
from ._joint_laws import AbstractSlide
from ._joint_loads import (
    AbstractFriction,
    AbstractJointLoop,
    Balance,
    JointLoads,
    Marks,
    joint_loop,
    journal_moment,
    relative,
    shaft_loss,
)
from .piston_film import PistonFilm


class SliderLinkFriction(AbstractFriction):
    """Friction laws of a slider-link machine. A place without a law (`None`) is frictionless.

    The laws of `wall` and `link_slider` must be proportional to the load, as Coulomb's is.

    Args:
        wall: piston and cylinder, at both contacts.
        piston_film: oil between piston and cylinder, over the engaged length of the piston.
        link_slider: slider in its link.
        crank_pin: crank pin in the slider.
        slider_moment: "paper" as printed, "balanced" with the couple between slider and link.

    Raises:
        ValueError: another word for `slider_moment`, or a law of `wall` or `link_slider` that is not
            proportional to the load (`BadInput`).
    """

    kind: ClassVar[str] = "slider_link"

    wall: AbstractSlide | None = None
    piston_film: PistonFilm | None = None
    link_slider: AbstractSlide | None = None
    crank_pin: AbstractJournal | None = None
    slider_moment: Literal["paper", "balanced"] = eqx.field(static=True, default="paper")

    def __check_init__(self):
        if self.slider_moment not in ("paper", "balanced"):
            raise ValueError(
                f"`slider_moment` must be 'paper' or 'balanced', but is {self.slider_moment!r}."
            )
        for name in ("wall", "link_slider"):
            for law in getattr(getattr(self, name), "laws", (getattr(self, name),)):
                if law is not None and not getattr(law, "proportional", True):
                    raise BadInput(name, f'"{law.kind}"', "a law that is proportional to the load")


class SliderLinkLoop(AbstractJointLoop):
    """The joints of a slider-link machine up to the couple between slider and link.

    The unknown is the couple over the crank radius [N]. With `slider_moment="paper"` there is none,
    and everything is explicit.
    """

    kinks: ClassVar[int] = 3

    mechanism: SliderLink
    friction: SliderLinkFriction
    # of the crank, and of piston and link
    state: CrankState
    motion: LinkMotion
    arms: ContactArms  # [m] of the contacts
    # [-] coefficients of friction with the sign of the force on the piston
    wall: Float[Array, "*n"]
    link: Float[Array, "*n"]
    film: Float[Array, "*n"]  # [N] drag of the oil on the piston
    # [m/s^2] of the crank pin, without gravity, in x and y
    pin_acceleration: tuple[Float[Array, "*n"], Float[Array, "*n"]]
    gas_force: Float[Array, "*n"]  # [N] (p - p_back) A
    gravity: Float[Array, "2"] | None  # [m/s^2] field in x and y

    @property
    def _balanced(self) -> bool:
        return self.friction.slider_moment == "balanced"

    @property
    def _slider_diameter(self):
        if self._balanced:
            return jnp.zeros(())
        return self.mechanism.slider_diameter

    def _piston_loads(self) -> PistonLoads:
        mechanism = self.mechanism
        inertia = mechanism.piston_mass * self.pin_acceleration[0]
        moment = inertia * mechanism.piston_centre_offset
        weight = jnp.zeros_like(inertia)
        if self.gravity is not None:
            weight = weight + mechanism.piston_mass * self.gravity[1]
            # Eq. (9) counts moments against z, and the weight's has crossed to its right side.
            moment = moment + weight * mechanism.piston_centre_lead
        # Q of Eq. (8): the film's drag has the sign of the speed here, F_FG that of the force.
        return PistonLoads(self.gas_force + self.film + inertia, moment, weight)

    def _contacts(self, couple) -> tuple[Contact, Vector, Vector]:
        """Contacts, force on the link and force of the crank pin."""
        loads = self._piston_loads()
        if self._balanced:
            moment = loads.moment + self.mechanism.crank_radius * couple
            loads = loads._replace(moment=moment)
        touch = contact(
            self.mechanism.bore, self._slider_diameter, self.arms, self.wall, self.link, loads
        )
        # The link feels the slider's friction along the slider's motion; with the slider's inertia
        # it is the force of the pin, Eqs. (16) and (17).
        on_link = Vector(touch.slider, self.link * jnp.abs(touch.slider))
        mass = self.mechanism.slider_mass
        pin_x, pin_y = self.pin_acceleration
        pin = Vector(on_link.x + mass * pin_x, on_link.y + mass * pin_y)
        return touch, on_link, pin

    def _pin_moment(self, pin: Vector):
        # the slider does not turn in its link, so that the pin turns in it at the speed of the crank
        law = self.friction.crank_pin
        if law is None:
            return jnp.zeros_like(pin.x)
        return journal_moment(law, pin, self.state.speed)

    def _imbalance(self, couple, pin_moment):
        """[N] What is left of the balance of the slider; the paper's has no couple."""
        if not self._balanced:
            return couple
        return couple - pin_moment / self.mechanism.crank_radius

    @property
    def coupled(self):
        return self._balanced and self.friction.crank_pin is not None

    def start(self):
        # the pin's moment over R is small against the thrust of the piston, and zero is close enough
        return jnp.zeros_like(self.state.speed)

    def size(self):
        thrust = self.gas_force + self.film
        return jnp.abs(thrust) + jnp.abs(self.mechanism.piston_mass * self.pin_acceleration[0])

    def excess(self, unknown):
        return self._imbalance(unknown, self._pin_moment(self._contacts(unknown)[2]))

    def balance(self, unknown):
        touch, on_link, pin = self._contacts(unknown)
        loss, moment = self._losses(touch, on_link, pin)
        total = sum(loss.values(), jnp.zeros_like(unknown))
        # The bearings' loads come close to zero with that of the pin, too near for places of their own.
        marks = Marks((touch.crown, touch.edge, touch.slider), (pin.x,), (pin.y,))
        return Balance(self._imbalance(unknown, moment), total, pin, marks)

    def _losses(self, touch, on_link, pin):
        """Loss torques [N m] by joint, and the moment of the crank pin."""
        friction = self.friction
        motion = self.motion
        speed = self.state.speed
        moment = self._pin_moment(pin)
        loss = {}
        if friction.wall is not None:
            pressed = jnp.abs(touch.crown) + jnp.abs(touch.edge)
            # m_1 has the sign of the force on the piston, which is against the motion.
            loss["wall"] = -self.wall * pressed * motion.position_1
        if friction.piston_film is not None:
            loss["piston_film"] = self.film * motion.position_1
        if friction.link_slider is not None:
            loss["link_slider"] = on_link.y * self.mechanism.crank_radius * motion.cosine
        if friction.crank_pin is not None:
            loss["crank_pin"] = moment
            # of a moving journal the squeeze is a part, which the moment does not have
            if isinstance(friction.crank_pin, PlacedJournal):
                loss["crank_pin"] = shaft_loss(friction.crank_pin, pin, speed)
        return loss, moment

    def loads(self, unknown, evidence):
        touch, on_link, pin = self._contacts(unknown)
        loss, pin_moment = self._losses(touch, on_link, pin)
        residual = margin = None
        if evidence:
            residual = self._residual(touch, on_link, pin_moment)
            margin = touch.margin
            if self.coupled:
                # only its value: the derivative would be a second one of the law of the pin
                margin = minimum(margin, lax.stop_gradient(self.slope(unknown)))
        wall_1, wall_2 = (self.wall * jnp.abs(side) for side in (touch.crown, touch.edge))
        return JointLoads(
            forces={
                "wall_crown": jnp.stack([wall_1, touch.crown]),
                "wall_edge": jnp.stack([wall_2, touch.edge]),
                "piston_film": jnp.stack([-self.film, jnp.zeros_like(self.film)]),
                "link_slider": on_link.stacked(),
                "crank_pin": pin.stacked(),
            },
            loss_torque=loss,
            residual=residual,
            margin=margin,
            kinks=jnp.stack([touch.crown, touch.edge, touch.slider]),
            minima=pin.x[None],
        )

    def _residual(self, touch, on_link, pin_moment):
        """Residual of Eqs. (8), (9) when the magnitudes are taken from the forces themselves."""
        arms = self.arms
        bore = self.mechanism.bore
        thrust, moment, weight = self._piston_loads()
        pressed = jnp.abs(touch.crown) + jnp.abs(touch.edge)
        # the paper's slider takes no moment from the crank pin
        of_pin = pin_moment if self._balanced else 0.0
        # the moments over the engaged length, so that all three balances are forces
        imbalance = jnp.stack([
            touch.slider + self.wall * pressed - thrust,
            touch.crown + touch.edge + on_link.y + weight,
            (touch.slider * arms.slider - arms.crown * touch.crown - arms.edge * touch.edge
             - self.wall * bore / 2 * (touch.crown + touch.edge)
             - self.link * self._slider_diameter / 2 * touch.slider - moment - of_pin) / arms.engaged,
        ])  # fmt: skip
        inertia = self.mechanism.piston_mass * self.pin_acceleration[0]
        size = pressed + jnp.abs(touch.slider) + jnp.abs(inertia) + jnp.abs(self.gas_force)
        return relative(max_of(jnp.abs(imbalance), axis=0), size)


@joint_loop.register
def _slider_link_loop(
    mechanism: SliderLink, friction, state: CrankState, gas_force, gravity=None, kinematics=None
) -> SliderLinkLoop:
    if friction is None:
        friction = SliderLinkFriction()
    if not isinstance(friction, SliderLinkFriction):
        raise TypeError(
            f"A slider-link mechanism needs `SliderLinkFriction`, not {type(friction).__name__}."
        )
    motion = kinematics
    if motion is None:
        motion = mechanism.kinematics(state.angle)
    arms = contact_arms(mechanism, state.angle)
    pin_x, pin_y = motion.crank_acceleration(state)
    pin_x = mechanism.crank_radius * pin_x
    pin_y = mechanism.crank_radius * pin_y
    if gravity is not None:
        # Weights enter as an acceleration the other way. Across the cylinder the piston has none,
        # so that its weight along y stands by itself as W.
        pin_x = pin_x - gravity[0]
        pin_y = pin_y - gravity[1]
    slide_speed = motion.position_1 * state.speed
    film = jnp.zeros_like(state.speed)
    if friction.piston_film is not None:
        film = friction.piston_film.force(mechanism.bore, arms.engaged, slide_speed)
    # m_1 = d_1 mu_c with d_1 against the piston's motion, m_2 = d_2 mu_s with d_2 along the slider's.
    wall = -_coefficient(friction.wall, slide_speed)
    slider_speed = mechanism.crank_radius * motion.cosine * state.speed
    return SliderLinkLoop(
        mechanism=mechanism,
        friction=friction,
        state=state,
        motion=motion,
        arms=arms,
        wall=wall,
        link=_coefficient(friction.link_slider, slider_speed),
        film=film,
        pin_acceleration=(pin_x, pin_y),
        gas_force=gas_force,
        gravity=gravity,
    )


def _coefficient(law, speed):
    """[-] with the sign of the sliding speed: the law is proportional to the load."""
    if law is None:
        return jnp.zeros_like(speed)
    return law.force(jnp.ones_like(speed), speed)
