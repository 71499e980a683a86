r"""Joint forces and losses of the slider-link mechanism.

With the motion given everything is explicit (see `jaxcomp.mechanism.contact`): the contacts of
piston and link, the force of the crank pin, the reactions of the bearings, and with them the
losses. The print omits the couple between slider and link that keeps the slider from turning,
$M_b = m_2 N D_s/2 - M_k$. With `slider_moment="balanced"` it is in: the term with $D_s$ of Eq. (9)
cancels and the moment $M_k$ of the crank pin loads the piston, which closes a weak loop.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eqs. (1)-(18), (29), (31)-(35).
"""

from typing import ClassVar, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import Part
from ..mechanism import (
    CrankState,
    PistonLoads,
    SliderLink,
    bearing_reactions,
    contact,
    contact_arms,
)
from ..mechanism._base import rotating
from ._journals import STANDARD_GRAVITY, AbstractDrag
from ._laws import AbstractJournal, AbstractSlide, PistonFilm
from ._loads import JointLoads, joint_loads

# Newton steps on the moment of the crank pin where it loads the piston. The loop gain is of the
# order of mu_c mu_k r_k/L_e, some 1e-3, and piecewise constant for Coulomb's law: three steps reach
# rounding. The two differentiable steps after them give exact first and second derivatives.
_NEWTON_STEPS, _POLISH_STEPS = 3, 2


class SliderLinkFriction(Part):
    """Friction laws of a slider-link machine. A place without a law (`None`) is frictionless.

    The laws of `wall` and `link_slider` must be proportional to the load, as Coulomb's is.

    Args:
        wall: piston and cylinder, at both contacts.
        piston_film: oil between piston and cylinder, over the engaged length of the piston.
        link_slider: slider in its link.
        crank_pin: crank pin in the slider.
        upper_bearing, lower_bearing: of the shaft.
        thrust_bearing, pump: drag on the shaft.
        slider_moment: "paper" as printed, "balanced" with the couple between slider and link.

    Raises:
        ValueError: another word for `slider_moment`.
    """

    kind: ClassVar[str] = "slider_link"

    wall: AbstractSlide | None = None
    piston_film: PistonFilm | None = None
    link_slider: AbstractSlide | None = None
    crank_pin: AbstractJournal | None = None
    upper_bearing: AbstractJournal | None = None
    lower_bearing: AbstractJournal | None = None
    thrust_bearing: AbstractDrag | None = None
    pump: AbstractDrag | None = None
    slider_moment: Literal["paper", "balanced"] = eqx.field(static=True, default="paper")

    def __check_init__(self):
        if self.slider_moment not in ("paper", "balanced"):
            raise ValueError(
                f"`slider_moment` must be 'paper' or 'balanced', but is {self.slider_moment!r}."
            )


@joint_loads.register
def _slider_link_loads(
    mechanism: SliderLink, friction, state: CrankState, gas_force, gravity=None, evidence=True
) -> JointLoads:
    del evidence  # it comes along with the solution
    friction = SliderLinkFriction() if friction is None else friction
    if not isinstance(friction, SliderLinkFriction):
        raise TypeError(
            f"A slider-link mechanism needs `SliderLinkFriction`, not {type(friction).__name__}."
        )
    speed = state.speed
    _, piston_1, _ = mechanism.piston(state.angle)
    slider_1 = mechanism.crank_radius * jnp.cos(state.angle)
    arms = contact_arms(mechanism, state.angle)
    _, pin_acceleration = rotating(*state)
    pin_acceleration = mechanism.crank_radius * pin_acceleration
    if gravity is not None:
        pin_acceleration = pin_acceleration - gravity.reshape(2, *[1] * speed.ndim)
    # Both laws are proportional to the load: the force at 1 N is the coefficient with its sign.
    wall = -_law(friction.wall, "force", piston_1 * speed)
    link = _law(friction.link_slider, "force", slider_1 * speed)
    film = jnp.zeros_like(speed)
    if friction.piston_film is not None:
        film = friction.piston_film.force(mechanism.bore, arms.engaged, piston_1 * speed)

    balanced = friction.slider_moment == "balanced"
    slider_diameter = jnp.zeros(()) if balanced else mechanism.slider_diameter
    inertia = mechanism.piston_mass * pin_acceleration[0]
    weight = jnp.zeros_like(speed)
    if gravity is not None:
        weight = weight + mechanism.piston_mass * gravity[1]
    moment = inertia * mechanism.piston_centre_offset + weight * mechanism.piston_centre_lead

    def solve(couple):
        """Contacts and force of the crank pin for a couple between slider and link."""
        loads = PistonLoads(gas_force + film + inertia, moment + couple, weight)
        touch = contact(mechanism.bore, slider_diameter, arms, wall, link, loads)
        on_link = jnp.stack([touch.slider, link * jnp.abs(touch.slider)])
        return touch, on_link, on_link + mechanism.slider_mass * pin_acceleration

    def pin_moment(pin):
        return _law(friction.crank_pin, "moment", speed, pin)

    couple = jnp.zeros_like(speed)
    coupling = jnp.ones_like(speed)
    if balanced and friction.crank_pin is not None:
        couple, coupling = _close(lambda value: value - pin_moment(solve(value)[2]), couple)
    touch, on_link, pin = solve(couple)
    upper, lower = bearing_reactions(mechanism, state, pin, gravity)

    wall_sum = jnp.abs(touch.crown) + jnp.abs(touch.edge)
    shaft_weight = mechanism.crank_mass * STANDARD_GRAVITY
    loss = {
        "wall": -wall * wall_sum * piston_1,
        "piston_film": film * piston_1,
        "link_slider": on_link[1] * slider_1,
        "crank_pin": pin_moment(pin),
        "upper_bearing": _law(friction.upper_bearing, "moment", speed, upper),
        "lower_bearing": _law(friction.lower_bearing, "moment", speed, lower),
    }
    for name in ("thrust_bearing", "pump"):
        law = getattr(friction, name)
        if law is not None:
            loss[name] = law.moment(speed, shaft_weight)
    # what Eqs. (8), (9) leave over when the magnitudes are taken from the forces themselves
    left = jnp.stack([
        touch.slider + wall * wall_sum - (gas_force + film + inertia),
        touch.crown + touch.edge + on_link[1] + weight,
        (touch.slider * arms.slider - arms.crown * touch.crown - arms.edge * touch.edge
         - wall * mechanism.bore / 2 * (touch.crown + touch.edge)
         - link * slider_diameter / 2 * touch.slider - moment
         - (pin_moment(pin) if balanced else 0.0)) / arms.engaged,
    ])  # fmt: skip
    size = wall_sum + jnp.abs(touch.slider) + jnp.abs(inertia) + jnp.abs(gas_force)
    return JointLoads(
        forces={
            "wall_crown": jnp.stack([wall * jnp.abs(touch.crown), touch.crown]),
            "wall_edge": jnp.stack([wall * jnp.abs(touch.edge), touch.edge]),
            "piston_film": jnp.stack([-film, jnp.zeros_like(film)]),
            "link_slider": on_link,
            "crank_pin": pin,
            "upper_bearing": upper,
            "lower_bearing": lower,
        },
        loss_torque={name: loss[name] for name in loss if getattr(friction, name) is not None},
        residual=jnp.max(jnp.abs(left), axis=0) / (size + 1e-300),
        margin=jnp.minimum(touch.margin, coupling),
        kinks=jnp.stack([touch.crown, touch.edge, touch.slider]),
        pinches=pin[:1],
    )


class Substitution(NamedTuple):
    """One substitution of Eq. (35).

    Attributes:
        acceleration: [rad/s^2] G(a).
        contraction: [-] |G'(a)|: the factor by which a substitution shrinks the error.
    """

    acceleration: Float[Array, "*n"]
    contraction: Float[Array, "*n"]


def substitution(
    mechanism: SliderLink,
    friction: SliderLinkFriction,
    state: CrankState,
    gas_force: Float[Array, "*n"],
    motor_torque: Float[Array, "*n"],
    gravity: Float[Array, "2"] | None = None,
) -> Substitution:
    r"""The crank acceleration that Eq. (35) gives for an assumed one, a -> G(a).

    The contacts are piecewise linear in a and enter the denominator $J_z + g_4$; only the moments
    of the journals are taken at the assumed a. The print drops the pump from (35); it is in.

    Args:
        mechanism, friction: the machine.
        state: angle, speed and the assumed acceleration of the crank.
        gas_force: [N] (p - p_back) A.
        motor_torque: [N m].
        gravity: [m/s^2] field in x and y.
    """
    inertia, inertia_1 = mechanism.inertia(state.angle)
    _, piston_1, _ = mechanism.piston(state.angle)
    drive = motor_torque - gas_force * piston_1 - 0.5 * inertia_1 * state.speed**2
    if gravity is not None:
        drive = drive + mechanism.gravity_torque(state.angle, gravity)

    def split(value):
        loads = joint_loads(
            mechanism, friction, state._replace(acceleration=value), gas_force, gravity
        )
        zero = jnp.zeros_like(value)
        contacts = sum((loads.loss_torque.get(k, zero) for k in ("wall", "link_slider")), zero)
        return inertia * value + contacts, loads.total_loss_torque - contacts + zero

    value = state.acceleration
    (contacts, journals), (slope, journal_slope) = jax.jvp(split, (value,), (jnp.ones_like(value),))
    return Substitution(
        value - (contacts + journals - drive) / slope, jnp.abs(journal_slope / slope)
    )


def _law(law, name, rate, vector=None):
    """A law's answer at a load vector, or at 1 N; zero without a law."""
    if law is None:
        return jnp.zeros_like(rate)
    return getattr(law, name)(jnp.ones_like(rate) if vector is None else _length(vector), rate)


def _length(vector):
    # double where: the slope of the root at a load of exactly zero is infinite
    square = vector[0] ** 2 + vector[1] ** 2
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def _close(excess, start):
    """Root of a nearly linear equation, entry by entry, and the slope there (no derivatives)."""

    def slope_at(value):
        return jax.jvp(excess, (value,), (jnp.ones_like(value),))

    def newton(_, value):
        now, slope = slope_at(value)
        return jax.lax.stop_gradient(value - now / jnp.maximum(slope, 1e-3))

    # the loop keeps one copy of the step, which the compiler would otherwise see three times
    value = jax.lax.stop_gradient(jax.lax.fori_loop(0, _NEWTON_STEPS, newton, start))
    slope = jax.lax.stop_gradient(slope_at(value)[1])
    # Steps along the slope of the root: the second derivative of a film at no load is never asked.
    for _ in range(_POLISH_STEPS):
        value = value - excess(value) / jnp.maximum(slope, 1e-3)
    return value, slope
