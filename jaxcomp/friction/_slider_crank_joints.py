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

from .._core.extremes import maximum, min_of
from ..film import AbstractJournal
from ..mechanism import CrankState, SliderCrank, rod_motion
from ..mechanism._slider_crank import RodBalance, pin_forces, rod_balance, rod_moment
from ._joint_laws import AbstractSlide
from ._joint_loads import (
    AbstractFriction,
    AbstractJointLoop,
    Balance,
    JointLoads,
    Marks,
    joint_loop,
    journal_loss,
    journal_moment,
    relative,
)
from .packing import Packing
from .piston_film import PistonFilm


class SliderCrankFriction(AbstractFriction):
    """Friction laws of a slider-crank. A joint without a law (`None`) has no friction and no cost.

    Args:
        wall: piston and cylinder, under the side force; of a machine with crosshead its guide.
        piston_film: oil between piston and cylinder; it needs its wetted length.
        piston_pin: piston pin in the small end.
        crank_pin: crank pin in the big end.
        packing: rings about the piston rod of a machine with crosshead.

    Raises:
        ValueError: a wall film without its length.
    """

    kind: ClassVar[str] = "slider_crank"

    wall: AbstractSlide | None = None
    piston_film: PistonFilm | None = None
    piston_pin: AbstractJournal | None = None
    crank_pin: AbstractJournal | None = None
    packing: Packing | None = None

    def __check_init__(self):
        if self.piston_film is not None and self.piston_film.length is None:
            raise ValueError(
                "`piston_film.length` is needed: a slider-crank has no engaged length."
            )


class SliderCrankLoop(AbstractJointLoop):
    """The joints of a slider-crank up to the side force N [N] of the cylinder wall."""

    marks_shaft: ClassVar[bool] = True

    friction: SliderCrankFriction  # the laws of the joints
    bodies: RodBalance  # inertia, weight and gas forces
    speed: Float[Array, "*n"]  # [rad/s] of the crank
    slide_speed: Float[Array, "*n"]  # [m/s] of the piston
    film: Float[Array, "*n"] | None  # [N] drag of oil and packing on the piston, along x
    packing: Float[Array, "*n"] | None = None  # [N] that of the packing

    def _wall(self, side):
        """Friction of the wall along x, against the motion [N]; and its sum with the film's drag."""
        if self.friction.wall is None:
            if self.film is None:
                return jnp.zeros_like(side)
            return self.film
        # the piston rubs on either side of its bore alike: N has a sign, the load of the law has none
        dry = self.friction.wall.force(jnp.abs(side), self.slide_speed)
        if self.film is None:
            return dry
        return dry + self.film

    def _pins(self, side, wall):
        """Forces of the pins, with their moments [N m] on the rod (`None` without a law)."""
        # Laws have the sign of the motion, the force on the piston the other one.
        forces = pin_forces(self.bodies, side, -wall)
        rod = self.bodies.rod
        return (
            forces,
            # phi grows against the crank's rotation: in the rod the piston pin, which does not
            # turn, goes at phi', and the crank pin at w + phi'.
            journal_moment(self.friction.piston_pin, forces.piston_pin, rod.tilt_1 * self.speed),
            journal_moment(
                self.friction.crank_pin, forces.crank_pin, (1 + rod.tilt_1) * self.speed
            ),
        )

    def _imbalance(self, forces, *moments):
        """[N] Moment on the rod over its arm; `None` of the moments of pins without a law."""
        frictionless = rod_moment(self.bodies, forces.piston_pin)
        of_pins = [moment for moment in moments if moment is not None]
        if not of_pins:
            return frictionless
        return frictionless + sum(of_pins[1:], of_pins[0]) / self.bodies.arm

    @property
    def coupled(self):
        laws = self.friction
        return any(law is not None for law in (laws.wall, laws.piston_pin, laws.crank_pin))

    def start(self):
        # Without pin moments the loop is linear in N on either side, with the slope of the wall alone.
        zero = jnp.zeros_like(self.speed)
        drag = zero if self.film is None else -self.film
        side = -rod_moment(self.bodies, pin_forces(self.bodies, zero, drag).piston_pin)
        if self.friction.wall is None:
            return side
        laws = getattr(self.friction.wall, "laws", (self.friction.wall,))
        if not all(law.proportional for law in laws):
            return side
        rod = self.bodies.rod
        # Per newton of N, with the sign of d|N|/dN. The friction does not turn N round, because the
        # slope is positive.
        grip = self.friction.wall.force(jnp.sign(side), self.slide_speed)
        return side / maximum(1 - grip * rod.sin_tilt / rod.cos_tilt, 1e-3)

    def size(self):
        return jnp.abs(self.start()) + jnp.abs(self.bodies.pin_x)

    def excess(self, unknown):
        return self._imbalance(*self._pins(unknown, self._wall(unknown)))

    def balance(self, unknown):
        wall = self._wall(unknown)
        forces, *moments = self._pins(unknown, wall)
        loss = sum(self._losses(forces, wall, *moments).values(), jnp.zeros_like(wall))
        near_zero = self._near_zero(forces)
        marks = Marks((unknown,), tuple(f.x for f in near_zero), tuple(f.y for f in near_zero))
        return Balance(self._imbalance(forces, *moments), loss, forces.crank_pin, marks)

    def _near_zero(self, forces):
        """Forces of the joints with a law: where one comes close to zero, its magnitude turns."""
        laws = self.friction
        rubbing = [f for name, f in forces._asdict().items() if getattr(laws, name) is not None]
        return rubbing or [forces.piston_pin]

    def _losses(self, forces, wall, piston_pin, crank_pin) -> dict[str, Float[Array, "*n"]]:
        rod = self.bodies.rod
        friction = self.friction
        loss = {}
        if friction.wall is not None:
            # the film's drag, which the sum has, is a loss of its own
            dry = wall if self.film is None else wall - self.film
            loss["wall"] = dry * rod.position_1
        if self.film is not None and friction.piston_film is not None:
            film = self.film
            if self.packing is not None:
                film = film - self.packing
            loss["piston_film"] = film * rod.position_1
        if self.packing is not None:
            loss["packing"] = self.packing * rod.position_1
        if piston_pin is not None:
            loss["piston_pin"] = journal_loss(
                friction.piston_pin, piston_pin, rod.tilt_1, forces.piston_pin, self.speed
            )
        if crank_pin is not None:
            loss["crank_pin"] = journal_loss(
                friction.crank_pin, crank_pin, 1 + rod.tilt_1, forces.crank_pin, self.speed
            )
        return loss

    def loads(self, unknown, evidence):
        side = unknown
        wall = self._wall(unknown)
        forces, *moments = self._pins(side, wall)
        residual = margin = None
        if evidence:
            size = jnp.abs(side) + jnp.abs(self.bodies.pin_x)
            residual = relative(self._imbalance(forces, *moments), size)
            far = self.limit()
            margin = jnp.ones_like(side)
            if self.coupled:
                # Far out on either side |N|, |T| and |S| grow in proportion to N, and the slope is
                # at its limit.
                margin = min_of(jax.vmap(self.slope)(jnp.stack([far, -far])), axis=0)
        return JointLoads(
            # each on the body that it drives: of the wall on the piston, of the piston and of the crank
            # on the rod
            forces={
                "wall": jnp.stack([-wall, side]),
                "piston_pin": forces.piston_pin.stacked(),
                "crank_pin": forces.crank_pin.stacked(),
            },
            loss_torque=self._losses(forces, wall, *moments),
            residual=residual,
            margin=margin,
            kinks=side[None],
            minima=jnp.stack([force.x for force in forces]),
        )


@joint_loop.register
def _slider_crank_loop(
    mechanism: SliderCrank, friction, state: CrankState, gas_force, gravity=None, kinematics=None
) -> SliderCrankLoop:
    if friction is None:
        friction = SliderCrankFriction()
    rod = kinematics
    if rod is None:
        rod = rod_motion(mechanism, state.angle)
    slide_speed = rod.position_1 * state.speed
    law = friction.piston_film
    film = None
    if law is not None:
        film = law.force(mechanism.bore, law.length, slide_speed)
    packing = None
    if friction.packing is not None:
        # like the film's, this drag does not depend on the side force: it takes no part in the loop
        packing = friction.packing.drag * jnp.sign(slide_speed)
        film = packing if film is None else film + packing
    bodies = rod_balance(mechanism, rod, state, gas_force, gravity)
    return SliderCrankLoop(friction, bodies, state.speed, slide_speed, film, packing)
