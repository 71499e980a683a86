r"""The coupled joint loop of the slider-crank.

Given the motion, everything follows from the side force $N$ of the cylinder wall: the wall friction
shifts the pin forces, the pin forces give the journal moments, and the rod's moment balance over
$l\cos\phi$ closes the loop,

$$h(N) = T_y + \tan\phi\,T_x(N) + \frac{M_T(N) + M_S(N) + \dots}{l\cos\phi} = 0 .$$

Its slope is $1 \mp \mu\tan\phi$ plus small terms from the journals. As long as the slope is positive
for both signs of $N$ the root is unique and Newton's method reaches rounding in a few steps; where
it is not, the rod jams the piston in the bore. The laws are those of Tsuji et al. (2012) Eq. (4).
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import Part
from ..mechanism import CrankState, SliderCrank, pin_forces, rod_balance, rod_moment
from ._laws import AbstractJournal, AbstractSlide, PistonFilm
from ._loads import JointLoads, joint_loads

# Newton steps on the joint loop, the last two differentiable (which makes derivatives exact up to
# third order). They start from the loop of the wall alone, which is solved at once, so only the
# journals' share of about mu d/l is left, and each step squares it. Residual after three steps: 4e-17
# on the machine of Tsuji et al., 6e-13 with friction raised until the margin is 0.33. Inside a solver,
# where no evidence is asked for, the first step is left out; the losses then change by 2e-16 of the
# largest on that machine, and by 9e-12, 4e-8, 1e-5 at margins of 0.6, 0.33, 0.15, which the solvers
# watch (`JointLoads.agrees`).
_FIRST_STEPS, _POLISH_STEPS = 1, 2


class SliderCrankFriction(Part):
    """Friction laws of a slider-crank. A joint without a law (`None`) has no friction and no cost.

    Args:
        wall: piston and cylinder, under the side force.
        wall_film: oil between piston and cylinder; it needs its wetted length.
        piston_pin: piston pin in the small end.
        crank_pin: crank pin in the big end.
        main_journal: shaft in its main bearing, or in both of an `OverhungSupport`.

    Raises:
        ValueError: a wall film without its length.
    """

    kind: ClassVar[str] = "slider_crank"

    wall: AbstractSlide | None = None
    wall_film: PistonFilm | None = None
    piston_pin: AbstractJournal | None = None
    crank_pin: AbstractJournal | None = None
    main_journal: AbstractJournal | None = None

    def __check_init__(self):
        if self.wall_film is not None and self.wall_film.length is None:
            raise ValueError("`wall_film.length` is needed: a slider-crank has no engaged length.")


def _length(vector: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
    # double where: the slope of the root at a load of exactly zero is infinite
    square = vector[0] ** 2 + vector[1] ** 2
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


@joint_loads.register
def _slider_crank_loads(
    mechanism: SliderCrank, friction, state: CrankState, gas_force, gravity=None, evidence=True
) -> JointLoads:
    friction = SliderCrankFriction() if friction is None else friction
    balance = rod_balance(mechanism, state, gas_force, gravity)
    rod, speed = balance.rod, state.speed
    arm = mechanism.conrod_length * rod.cos_tilt
    slide_speed = rod.position_1 * speed
    film = (
        jnp.zeros_like(speed)
        if friction.wall_film is None
        else friction.wall_film.force(mechanism.bore, friction.wall_film.length, slide_speed)
    )

    def wall_force(side):
        if friction.wall is None:
            return jnp.zeros_like(side)
        return friction.wall.force(jnp.abs(side), slide_speed)

    def pins(side):
        return pin_forces(balance, side, -wall_force(side) - film)

    def journal(law, vector, rate):
        return jnp.zeros_like(rate) if law is None else law.moment(_length(vector), rate)

    def pin_moment(forces):
        return journal(friction.piston_pin, forces.piston_pin, rod.tilt_1 * speed) + journal(
            friction.crank_pin, forces.crank_pin, (1 + rod.tilt_1) * speed
        )

    def loop(side):
        forces = pins(side)
        return rod_moment(mechanism, balance, forces.piston_pin) + pin_moment(forces) / arm

    def value_and_slope(side):
        return jax.jvp(loop, (side,), (jnp.ones_like(side),))

    # Without pin moments the loop is linear in N on either side, with the slope of the wall alone.
    side = -loop(jnp.zeros_like(speed))
    grip = jnp.sign(side) * wall_force(jnp.ones_like(side)) * rod.sin_tilt / rod.cos_tilt
    side = side / jnp.maximum(1 - grip, 1e-3)
    coupled = friction.wall is not None or (friction.piston_pin, friction.crank_pin) != (None, None)
    # beyond this there is no solution: the joints are locked, and the numbers only stay finite
    far = jax.lax.stop_gradient(1e3 * (jnp.abs(side) + jnp.abs(balance.pin_x) + 1.0))
    if coupled:
        for _ in range(_FIRST_STEPS if evidence else 0):
            side = _newton(value_and_slope, jax.lax.stop_gradient(side), far)
        side = jax.lax.stop_gradient(side)
        for _ in range(_POLISH_STEPS):
            side = _newton(value_and_slope, side, far)
    forces = pins(side)
    wall = wall_force(side)
    residual = margin = None
    if evidence:
        residual = loop(side) / (jnp.abs(side) + jnp.abs(balance.pin_x) + 1e-300)
        margin = jnp.ones_like(speed)
        if coupled:
            margin = jnp.minimum(value_and_slope(far)[1], value_and_slope(-far)[1])
    loss = {
        "wall": wall * rod.position_1,
        "wall_film": film * rod.position_1,
        "piston_pin": journal(friction.piston_pin, forces.piston_pin, rod.tilt_1 * speed)
        * rod.tilt_1,
        "crank_pin": journal(friction.crank_pin, forces.crank_pin, (1 + rod.tilt_1) * speed)
        * (1 + rod.tilt_1),
        "main_journal": journal(friction.main_journal, forces.main_journal, speed),
    }
    return JointLoads(
        forces={
            "wall": jnp.stack([-wall - film, side]),
            "piston_pin": forces.piston_pin,
            "crank_pin": forces.crank_pin,
            "main_journal": forces.main_journal,
        },
        loss_torque={name: loss[name] for name in loss if getattr(friction, name) is not None},
        residual=residual,
        margin=margin,
        kinks=side[None],
        pinches=forces.piston_pin[:1],
    )


def _newton(value_and_slope, side, far):
    value, slope = value_and_slope(side)
    # a slope that is not positive belongs to a locked joint, which the margin reports
    return jnp.clip(side - value / jnp.maximum(slope, 1e-3), -far, far)
