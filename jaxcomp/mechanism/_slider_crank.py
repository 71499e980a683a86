r"""Slider-crank with an offset cylinder axis: exact kinematics, reduced inertia, joint forces.

Crank angle $\theta$ is zero when the crank points along the cylinder axis towards the head (top
dead centre if the offset is zero) and grows towards +y. The rod stands at the angle $\phi$,

$$\sin\phi = (r \sin\theta - e)/l, \qquad x_p = r\cos\theta + l\cos\phi .$$

Source: Tsuji et al. (2012), *Calculated Optimal Mechanical Efficiency of a Large Capacity
Reciprocating Compressor*, Purdue paper 2127 ("Tsuji"), Eq. (1), rederived by Newton-Euler for any
offset. Its printed gas torque $-P x_p\tan\phi$ has the opposite sign of $\phi$; here a pressure on
the piston loads the crank with $(p - p_{back}) A x_p'$.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.extremes import maximum
from .._core.fields import ANY, NONNEGATIVE, POSITIVE, quantity, replaced
from ._mechanism import (
    AbstractKinematics,
    AbstractMechanism,
    CrankState,
    Vector,
    crank_direction,
    swing_at,
)


class SliderCrank(AbstractMechanism):
    """Connecting rod and piston on a crank, as rigid bodies.

    The rod's mass centre lies on the line of its eyes, `conrod_centre` from the big end (the
    length b of Tsuji; a = l - b from the small end).

    Args:
        piston_mass: [kg] piston with rings and pin.
        bore: [m] piston diameter.
        crank_radius: [m] half the stroke if the offset is 0.
        conrod_length: [m] l, between the centres of the eyes.
        conrod_mass: [kg] of the rod.
        conrod_centre: [m] b, mass centre of the rod from the big end.
        conrod_inertia: [kg m^2] rod about its own mass centre.
        offset: [m] cylinder axis at y = offset.
    """

    kind: ClassVar[str] = "slider_crank"
    for_each_cylinder: ClassVar[bool] = True

    bore: Float[Array, ""] = quantity("m", POSITIVE, doc="piston diameter", usual=(5e-3, 1.0))
    crank_radius: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="half the stroke if offset is 0", usual=(1e-3, 0.5)
    )
    conrod_length: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="between the centres of the eyes", usual=(5e-3, 3.0)
    )
    piston_mass: Float[Array, ""] = quantity(
        "kg", NONNEGATIVE, doc="piston with rings and pin", usual=(1e-3, 500.0)
    )
    conrod_mass: Float[Array, ""] = quantity("kg", NONNEGATIVE, usual=(1e-3, 1000.0))
    conrod_centre: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="mass centre of the rod from the big end"
    )
    conrod_inertia: Float[Array, ""] = quantity(
        "kg m^2", NONNEGATIVE, default=0.0, doc="rod about its own mass centre", usual=(1e-9, 200.0)
    )
    offset: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="cylinder axis at y = offset", usual=(0.0, 0.1)
    )

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        reach = self.crank_radius + abs(self.offset) < self.conrod_length
        return {"a machine with crank_radius + |offset| < conrod_length": reach}

    def repaired(self):
        reach = self.crank_radius + jnp.abs(self.offset)
        length = jnp.where(reach < self.conrod_length, self.conrod_length, 1.001 * reach)
        return replaced(self, conrod_length=length)

    @property
    def conrod_ratio(self) -> Float[Array, ""]:
        """[-] r/l."""
        return self.crank_radius / self.conrod_length

    @property
    def rod_masses(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """[kg] of the rod that turns with the crank, and that moves with the piston."""
        sliding = self.conrod_mass * (self.conrod_centre / self.conrod_length)
        return self.conrod_mass - sliding, sliding

    @property
    def half_balance(self) -> Float[Array, ""]:
        r"""[kg m] $(m_{rot} + m_{rec}/2)\,r$: all that rotates and half of what reciprocates.

        A counterweight of this size leaves a first-order force that only turns backward.
        """
        rotating, of_rod = self.rod_masses
        return (rotating + (self.piston_mass + of_rod) / 2) * self.crank_radius

    @property
    def piston_area(self) -> Float[Array, ""]:
        return jnp.pi / 4 * self.bore**2

    def kinematics(self, angle):
        return rod_motion(self, angle)

    def reduced_inertia(self, kinematics: "RodMotion"):  # pyright: ignore[reportIncompatibleMethodOverride]
        r"""Tsuji's reduced inertia with its rate, but for that of the crankshaft, I_0.

        $$J - I_0 = m_c \tfrac{a}{l} r^2 + (m_p + m_c \tfrac{b}{l}) x_p'^2
            + (I_c - m_c a b) \phi'^2$$
        """
        rod = kinematics
        b = self.conrod_centre
        rotating_mass, of_rod = self.rod_masses
        reciprocating_mass = self.piston_mass + of_rod
        # What the rod has beside two masses at its eyes: I_c - m_c a b.
        residue = self.conrod_inertia - self.conrod_mass * (self.conrod_length - b) * b
        value = (
            rotating_mass * self.crank_radius**2
            + reciprocating_mass * (rod.position_1 * rod.position_1)
            + residue * (rod.tilt_1 * rod.tilt_1)
        )
        rate = 2 * (
            reciprocating_mass * rod.position_1 * rod.position_2 + residue * rod.tilt_1 * rod.tilt_2
        )
        return value, rate

    def dead_centres(self):
        """Where rod and crank are in one line: asin(e/(l + r)) and pi + asin(e/(l - r))."""
        r, l, e = self.crank_radius, self.conrod_length, self.offset
        return jnp.arcsin(e / (l + r)), jnp.pi + jnp.arcsin(e / (l - r))

    def piston_extremes(self):
        r, l, e = self.crank_radius, self.conrod_length, self.offset
        return jnp.sqrt((l + r) ** 2 - e**2), jnp.sqrt((l - r) ** 2 - e**2)

    def angle_at(self, position, inward):
        """[rad] From x cos(theta) + e sin(theta) = (x^2 + e^2 + r^2 - l^2)/(2 r).

        Args:
            position: [m] x of the piston.
            inward: whether it moves towards the head.
        """
        r, l, e = self.crank_radius, self.conrod_length, self.offset
        # The left side is hypot(x, e) cos(theta - arctan(e/x)).
        distance = jnp.sqrt(position**2 + e**2)
        cosine = (position**2 + e**2 + r**2 - l**2) / (2 * r * distance)
        swing = swing_at(cosine)
        # Towards the head ahead of the top dead centre, away behind it.
        return jnp.arctan2(e, position) + (-swing if inward else swing)

    def reversals(self):
        """The rod swings to the other side where cos(theta) = 0."""
        return jnp.asarray(0.5 * jnp.pi), jnp.asarray(1.5 * jnp.pi)

    def weight_torque(self, kinematics, gravity):
        rod = kinematics
        rotating, of_rod = self.rod_masses
        swinging = rotating * self.crank_radius
        # the derivative of the crank's unit vector is (-sin, cos)
        along_crank = gravity[1] * rod.cosine - gravity[0] * rod.sine
        # The rod by two masses at its eyes again; what slides has no way across the cylinder.
        sliding = (self.piston_mass + of_rod) * gravity[0] * rod.position_1
        return swinging * along_crank + sliding


class RodMotion(AbstractKinematics):
    """Position x_p of the piston and tilt phi of the rod with derivatives to crank angle.

    Attributes:
        cosine, sine, position, position_1, position_2: as of every mechanism.
        sin_tilt: [-] sin(phi).
        cos_tilt: [-] cos(phi).
        tilt_1: [-] phi'.
        tilt_2: [1/rad] phi''.
    """

    sin_tilt: Float[Array, "*n"]
    cos_tilt: Float[Array, "*n"]
    tilt_1: Float[Array, "*n"]
    tilt_2: Float[Array, "*n"]


def rod_motion(mechanism: SliderCrank, angle: Float[Array, "*n"]) -> RodMotion:
    r"""Exact kinematics to second derivatives.

    $\phi' = r\cos\theta/(l\cos\phi)$ and $x_p' = -r\sin\theta - r\cos\theta\tan\phi$, each
    differentiated once more.

    Args:
        mechanism: the slider-crank.
        angle: [rad] theta of the crank.
    """
    r, l, e = mechanism.crank_radius, mechanism.conrod_length, mechanism.offset
    cosine, sine = crank_direction(angle)
    c, s = r * cosine, r * sine
    sin_tilt = (s - e) / l
    # the floor is reached only by a mechanism that cannot turn, which is reported elsewhere
    cos_tilt = jnp.sqrt(maximum(1 - sin_tilt * sin_tilt, 1e-8))
    tan_tilt = sin_tilt / cos_tilt
    reach = l * cos_tilt
    tilt_1 = c / reach
    # By differentiating cos(phi) phi' = (r/l) cos(theta).
    tilt_2 = tan_tilt * (tilt_1 * tilt_1) - s / reach
    return RodMotion(
        cosine=cosine,
        sine=sine,
        position=c + reach,
        position_1=-s - c * tan_tilt,
        position_2=s * tan_tilt - c - c * tilt_1 / (cos_tilt * cos_tilt),
        sin_tilt=sin_tilt,
        cos_tilt=cos_tilt,
        tilt_1=tilt_1,
        tilt_2=tilt_2,
    )


class RodBalance(eqx.Module):
    """The Newton-Euler balances of the instants, waiting for the unknown side force.

    With the side force N of the wall and the friction values given, `pin_forces` finishes them.

    Attributes:
        rod: position and tilt.
        arm: [m] l cos(phi).
        pin_x: [N] T_x without wall friction.
        piston_weight: [N] m_p g_y.
        rod_inertia: [N] m_c (a_G - g).
        moment: [N m] I_c phi_dd + m_c r_M x (a_G - g).
    """

    rod: RodMotion
    arm: Float[Array, "*n"]
    pin_x: Float[Array, "*n"]
    piston_weight: Float[Array, "*each"]
    rod_inertia: Vector
    moment: Float[Array, "*n"]


def rod_balance(
    mechanism: SliderCrank,
    rod: RodMotion,
    state: CrankState,
    gas_force: Float[Array, "*n"],
    gravity: Float[Array, "2 *each"] | None = None,
) -> RodBalance:
    """Collect inertia, weight and gas forces.

    Args:
        mechanism: the slider-crank.
        rod: its position at the angles of the state.
        state: angle, speed and acceleration of the crank.
        gas_force: [N] (p - p_back) A, positive towards the crank.
        gravity: [m/s^2] field in x and y; `None` leaves weights out.
    """
    b = mechanism.conrod_centre
    rotating, small_end = mechanism.rod_masses
    big_end = rotating * mechanism.crank_radius
    square = state.speed * state.speed
    piston = rod.position_1 * state.acceleration + rod.position_2 * square
    tilt = rod.tilt_1 * state.acceleration + rod.tilt_2 * square
    crank_x, crank_y = rod.crank_acceleration(state)
    # m_c a_G by two masses at the eyes: exact, because G lies on the line between them.
    rod_inertia = Vector(big_end * crank_x + small_end * piston, big_end * crank_y)
    # T acts on the rod, hence with the opposite sign on the piston.
    pin_x = -gas_force - mechanism.piston_mass * piston
    piston_weight = jnp.zeros(())
    if gravity is not None:
        pin_x = pin_x + mechanism.piston_mass * gravity[0]
        piston_weight = mechanism.piston_mass * gravity[1]
        weight = mechanism.conrod_mass * gravity
        rod_inertia = Vector(rod_inertia.x - weight[0], rod_inertia.y - weight[1])
    # The big end lies at b (-cos(phi), sin(phi)) from the mass centre of the rod. The inertia has a
    # plus, because phi grows against z; S is eliminated by the balance of forces.
    moment = mechanism.conrod_inertia * tilt - b * (
        rod.cos_tilt * rod_inertia.y + rod.sin_tilt * rod_inertia.x
    )
    return RodBalance(
        rod=rod,
        arm=mechanism.conrod_length * rod.cos_tilt,
        pin_x=pin_x,
        piston_weight=piston_weight,
        rod_inertia=rod_inertia,
        moment=moment,
    )


class PinForces(NamedTuple):
    """Forces that the pins transmit.

    Attributes:
        piston_pin: [N] T, of the piston on the rod.
        crank_pin: [N] S, of the crank on the rod.
    """

    piston_pin: Vector
    crank_pin: Vector


def pin_forces(
    balance: RodBalance, side_force: Float[Array, "*n"], wall_friction: Float[Array, "*n"]
) -> PinForces:
    """The pin forces T and S that go with a side force N and a wall friction f on the piston.

    Args:
        balance: what is known without them.
        side_force: [N] N, of the wall on the piston along y.
        wall_friction: [N] f, on the piston along x.
    """
    piston_pin = Vector(balance.pin_x + wall_friction, side_force + balance.piston_weight)
    crank_pin = Vector(balance.rod_inertia.x - piston_pin.x, balance.rod_inertia.y - piston_pin.y)
    return PinForces(piston_pin, crank_pin)


def rod_moment(balance: RodBalance, piston_pin: Vector) -> Float[Array, "*n"]:
    """Moment on the rod about its mass centre, with inertia, over l cos(phi) [N].

    Zero in the frictionless machine; with friction it equals -(M_T + M_S)/(l cos phi).

    Args:
        balance: of the same instants.
        piston_pin: [N] force of the piston on the rod.
    """
    rod = balance.rod
    return piston_pin.y + rod.sin_tilt / rod.cos_tilt * piston_pin.x + balance.moment / balance.arm
