r"""Slider-link (Scotch-yoke) mechanism: kinematics, reduced inertia, contacts and reactions.

The crank pin carries a slider that runs across a link; the link is one body with the piston. The
crank angle $\varphi$ is zero at the top dead centre and grows from +x towards +y,

$$x_p = L_p + R\cos\varphi, \qquad y_s = R\sin\varphi .$$

Axes: x along the cylinder towards the head, y across, z along the shaft, downwards, with the origin
in the plane of the machine's mass centre. The cylinder axis is the line y = -e, the `offset` is -e as
in the slider-crank.

The piston touches the cylinder at its crown and at the edge of the cylinder (forces $F_1$, $F_2$
along y), the slider presses on the link (force $N$ along x). With $m_1 = d_1\mu_c$ and
$m_2 = d_2\mu_s$, the coefficients of friction with the sign of the force on the piston,

$$N + m_1(|F_1| + |F_2|) = Q, \qquad F_1 + F_2 + m_2|N| + W = 0,$$
$$-L_1F_1 - L_2F_2 - m_1\tfrac{D}{2}(F_1 + F_2) + Nh - m_2\tfrac{D_s}{2}N = \mathcal M .$$

Here $Q = F_g - F_{FG} + m_p\ddot x$ and $\mathcal M = m_p\ddot x\,e_{cl}$; W is the weight of the
piston along y, if any. The sides $d_3, d_4, d_5$ of the three contacts are unknown. For a given
side of N the last two equations give $F_1 = \alpha_1 N - \kappa_1$, $F_2 = -\alpha_2 N + \kappa_2$,
which leaves one scalar, piecewise linear equation in N. If its slope is positive on all pieces the
sides follow without search.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eqs. (1)-(15), (25)-(30); (9) with $L_p$ for the undefined $L_{st}$. The explicit sides are ours.
"""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._fields import ANY, NONNEGATIVE, POSITIVE, BadInput, quantity
from ._base import (
    AbstractKinematics,
    AbstractMechanism,
    Vector,
    crank_direction,
    swing_at,
    turned_with,
)


class SliderLink(AbstractMechanism):
    """Crank, slider and piston with link as rigid bodies; the shaft overhangs its two bearings.

    The piston plane lies `plane_height` above the mass centre of the machine, the upper bearing
    `overhang` below the piston plane, the lower bearing `bearing_span` below the upper one. The
    crown is flush with the end of the cylinder at the top dead centre. The crank's product of
    inertia is that of its own mass distribution, about the piston plane, so that a design may move
    the mass centre of the machine without changing the crank.

    Args:
        piston_mass: [kg] m_p, piston with link.
        crank_inertia: [kg m^2] J_z, crankshaft with rotor about the shaft axis.
        bore: [m] D, piston diameter.
        crank_radius: [m] R, half the stroke.
        cylinder_length: [m] L_c.
        crown_to_link: [m] L_p, from the crown to the centre line of the link.
        slider_diameter: [m] D_s.
        slider_mass: [kg] m_s.
        overhang: [m] z_p, from the piston plane to the upper bearing.
        bearing_span: [m] z_b, from the upper to the lower bearing.
        plane_height: [m] z_s, piston plane above the mass centre of the machine.
        crank_mass: [kg] m_r, crankshaft with rotor.
        crank_eccentricity: [m] e_cr, mass centre of the crank, positive opposite the pin.
        crank_product: [kg m^2] sum of m x (z + z_s) over the crank, x towards the pin.
        offset: [m] -e, cylinder axis at y = offset.
        piston_centre_offset: [m] e_cl, mass centre of the piston from the cylinder axis, to +y.
        piston_centre_lead: [m] the same from the link's centre line, to the crown; for weight.
        crank_centre_depth: [m] mass centre of the crank below the piston plane; for weight.
        crank_unbalance_across: [kg m] of the crank alone, 90 degrees ahead of the pin; `None` for none.
        crank_product_across: [kg m^2] as `crank_product`, 90 degrees ahead of the pin.

    Inertia, unbalances and products of the crank, and the places of the bearings, follow from the rotor
    of a machine in which `loads.crank` joins the two.
    """

    kind: ClassVar[str] = "slider_link"
    for_each_cylinder: ClassVar[bool] = True
    load_reversals: ClassVar[int] = 12  # up to ten are seen: of crown, edge, slider and crank pin

    bore: Float[Array, ""] = quantity("m", POSITIVE, doc="piston diameter D", usual=(5e-3, 1.0))
    crank_radius: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="R, half the stroke", usual=(1e-3, 0.5)
    )
    cylinder_length: Float[Array, ""] = quantity("m", POSITIVE, doc="L_c", usual=(5e-3, 2.0))
    crown_to_link: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="L_p, from the crown to the centre line of the link"
    )
    slider_diameter: Float[Array, ""] = quantity("m", NONNEGATIVE, doc="D_s", usual=(2e-3, 0.5))
    piston_mass: Float[Array, ""] = quantity(
        "kg", NONNEGATIVE, doc="m_p, piston with link", usual=(1e-3, 500.0)
    )
    slider_mass: Float[Array, ""] = quantity("kg", NONNEGATIVE, doc="m_s", usual=(1e-4, 200.0))
    crank_inertia: Float[Array, ""] | None = quantity(
        "kg m^2",
        POSITIVE,
        default=None,
        doc="J_z, crankshaft with rotor about the shaft axis; absent where it follows from [rotor]",
    )
    overhang: Float[Array, ""] | None = quantity(
        "m",
        NONNEGATIVE,
        default=None,
        doc="z_p, from the piston plane to the upper bearing; absent where [rotor] has the bearings",
    )
    bearing_span: Float[Array, ""] | None = quantity(
        "m",
        POSITIVE,
        default=None,
        doc="z_b, from the upper to the lower bearing; absent where [rotor] has the bearings",
    )
    plane_height: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="z_s, piston plane above the mass centre of the machine"
    )
    crank_mass: Float[Array, ""] = quantity(
        "kg", NONNEGATIVE, default=0.0, doc="m_r, crankshaft with rotor"
    )
    crank_eccentricity: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="e_cr, mass centre of the crank, positive opposite the pin"
    )
    crank_product: Float[Array, ""] = quantity(
        "kg m^2", ANY, default=0.0, doc="sum of m x (z + z_s) over the crank, x towards the pin"
    )
    offset: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="cylinder axis at y = offset", usual=(0.0, 0.1)
    )
    piston_centre_offset: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="e_cl, mass centre of the piston from the cylinder axis, to +y"
    )
    piston_centre_lead: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="the same from the link's centre line, to the crown; for weight"
    )
    crank_centre_depth: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="mass centre of the crank below the piston plane; for weight"
    )
    crank_unbalance_across: Float[Array, ""] | None = quantity(
        "kg m", ANY, default=None, doc="of the crank alone, 90 degrees ahead of the pin"
    )
    crank_product_across: Float[Array, ""] | None = quantity(
        "kg m^2", ANY, default=None, doc="as crank_product, 90 degrees ahead of the pin"
    )

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        engaged = self.cylinder_length > 2 * self.crank_radius
        return {"a machine with cylinder_length > 2 crank_radius": engaged}

    @property
    def piston_area(self) -> Float[Array, ""]:
        return jnp.pi / 4 * self.bore**2

    @property
    def bearing_places(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """[m] Upper and lower bearing below the piston plane.

        Raises:
            BadInput: not given, as in a machine whose rotor is not put together yet.
        """
        upper, span = self.overhang, self.bearing_span
        if upper is None or span is None:
            name = "overhang" if upper is None else "bearing_span"
            raise BadInput(name, "absent", "given, or a machine with these bearings in its rotor")
        return upper, upper + span

    @property
    def half_balance(self) -> Float[Array, ""]:
        """[kg m] (m_s + m_p/2) R: the slider and half of the piston, see `SliderCrank.half_balance`."""
        return (self.slider_mass + self.piston_mass / 2) * self.crank_radius

    @property
    def crank_unbalance(self) -> Float[Array, ""]:
        """[kg m] Of the crank alone, positive at the pin's side: -m_r e_cr."""
        return -self.crank_mass * self.crank_eccentricity

    @property
    def product_of_inertia(self) -> Float[Array, ""]:
        """[kg m^2] J_xz, the sum of m x z over the crank with z from the machine's mass centre."""
        return self.crank_product - self.plane_height * self.crank_unbalance

    @property
    def product_of_inertia_across(self) -> Float[Array, ""] | None:
        """[kg m^2] J_yz in the axes of the crank; `None` without an unbalance there."""
        if self.crank_unbalance_across is None:
            return self.crank_product_across
        product = 0.0 if self.crank_product_across is None else self.crank_product_across
        return product - self.plane_height * self.crank_unbalance_across

    def kinematics(self, angle):
        cosine, sine = crank_direction(angle)
        along, across = self.crank_radius * cosine, self.crank_radius * sine
        return LinkMotion(cosine, sine, self.crown_to_link + along, -across, -along)

    def reduced_inertia(self, kinematics):
        r"""$J = J_z + m_s R^2 + m_p R^2\sin^2\varphi$ with its rate."""
        across, along = kinematics.position_1, kinematics.position_2
        if self.crank_inertia is None:
            raise BadInput("crank_inertia", "absent", "given, or a machine with a rotor")
        value = (
            self.crank_inertia
            + self.slider_mass * self.crank_radius**2
            + self.piston_mass * (across * across)
        )
        return value, 2 * self.piston_mass * (across * along)

    def dead_centres(self):
        """Zero and pi, for any offset."""
        return jnp.asarray(0.0), jnp.asarray(jnp.pi)

    def piston_extremes(self):
        return self.crown_to_link + self.crank_radius, self.crown_to_link - self.crank_radius

    def angle_at(self, position, inward):
        cosine = (position - self.crown_to_link) / self.crank_radius
        swing = swing_at(cosine)
        return -swing if inward else swing

    def reversals(self):
        """The slider turns back in its link where cos(phi) = 0."""
        return jnp.asarray(0.5 * jnp.pi), jnp.asarray(1.5 * jnp.pi)

    def weight_torque(self, kinematics, gravity):
        across = -kinematics.sine * gravity[0]
        with_pin = self.slider_mass * self.crank_radius + self.crank_unbalance
        torque = with_pin * (across + kinematics.cosine * gravity[1]) + (
            self.piston_mass * self.crank_radius * across
        )
        if self.crank_unbalance_across is not None:
            ahead = kinematics.cosine * gravity[0] + kinematics.sine * gravity[1]
            torque = torque - self.crank_unbalance_across * ahead
        return torque


class LinkMotion(AbstractKinematics):
    """Position x_p of piston and link: nothing else moves."""


class ContactArms(NamedTuple):
    """Arms [m] of the contact forces about the cylinder axis where the link's centre line meets it.

    That point moves with the piston (the print after Eq. (9) reads as if it were fixed).

    Attributes:
        engaged: [m] L_e, length of the piston inside the cylinder.
        crown: [m] L_1, arm of the contact at the crown.
        edge: [m] L_2, arm of the contact at the edge of the cylinder.
        slider: [m] h, arm of the slider's force.
    """

    engaged: Float[Array, "*n"]
    crown: Float[Array, "*n"]
    edge: Float[Array, "*n"]
    slider: Float[Array, "*n"]


def contact_arms(mechanism: SliderLink, angle: Float[Array, "*n"]) -> ContactArms:
    r"""$L_e = L_c - R(1-\cos\varphi)$, $L_1 = L_p$, $L_2 = L_p - L_e$, $h = e + R\sin\varphi$.

    Args:
        mechanism: the geometry.
        angle: [rad] crank angle.
    """
    radius, (cosine, sine) = mechanism.crank_radius, crank_direction(angle)
    engaged = mechanism.cylinder_length - radius * (1 - cosine)
    # the floor is reached only by a piston that leaves its cylinder, which is reported elsewhere
    engaged = jnp.maximum(engaged, 1e-6 * mechanism.cylinder_length)
    return ContactArms(
        engaged,
        crown=jnp.broadcast_to(mechanism.crown_to_link, engaged.shape),
        edge=mechanism.crown_to_link - engaged,
        slider=-mechanism.offset + radius * sine,
    )


class PistonLoads(NamedTuple):
    """What the contacts must balance.

    Attributes:
        thrust: [N] Q.
        moment: [N m] the right side of Eq. (9).
        weight: [N] W, of the piston, along y.
    """

    thrust: Float[Array, "*n"]
    moment: Float[Array, "*n"]
    weight: Float[Array, "*n"]


class Contact(NamedTuple):
    """Forces on piston and link.

    Attributes:
        crown: [N] F_1, along y at the crown.
        edge: [N] F_2, along y at the edge of the cylinder.
        slider: [N] N, along x from the slider.
        margin: [-] smallest slope of the equation for N: where it is not positive the piston wedges
            in the bore and the forces mean nothing.
    """

    crown: Float[Array, "*n"]
    edge: Float[Array, "*n"]
    slider: Float[Array, "*n"]
    margin: Float[Array, "*n"]


def contact(
    bore: Float[Array, ""],
    slider_diameter: Float[Array, ""],
    arms: ContactArms,
    wall: Float[Array, "*n"],
    link: Float[Array, "*n"],
    loads: PistonLoads,
) -> Contact:
    r"""Solve Eq. (10) with the sides of all contacts, explicitly.

    The equation for N is strictly increasing if
    $1 - \mu_c\max_{d_5}(|\alpha_1| + |\alpha_2|) > 0$, so the side of N follows from its value at
    N = 0 and the sides of F_1, F_2 from its values where they vanish.

    Args:
        bore, slider_diameter: [m] D, D_s.
        arms: [m] of the contacts.
        wall, link: [-] m_1, m_2, coefficients of friction with sign.
        loads: to be balanced.
    """
    q, moment, weight = loads
    edge_arm = arms.edge + wall * bore / 2
    crown_arm = arms.crown + wall * bore / 2

    def slopes(side):
        """alpha_1, alpha_2"""
        slider = arms.slider - link * slider_diameter / 2
        return (
            (slider + link * side * edge_arm) / arms.engaged,
            (slider + link * side * crown_arm) / arms.engaged,
        )

    kappa_1 = (moment - edge_arm * weight) / arms.engaged
    kappa_2 = (moment - crown_arm * weight) / arms.engaged
    side = _side(q - wall * (jnp.abs(kappa_1) + jnp.abs(kappa_2)))
    a1, a2 = slopes(side)
    between = wall * jnp.abs(a2 * kappa_1 - a1 * kappa_2)
    crown_side = _side(a1 * q - kappa_1 - jnp.sign(a1) * between)
    edge_side = -_side(a2 * q - kappa_2 - jnp.sign(a2) * between)
    slope = 1 + wall * (crown_side * a1 - edge_side * a2)
    steepest = jnp.maximum(*(sum(map(jnp.abs, slopes(side))) for side in (1.0, -1.0)))
    margin = 1 - jnp.abs(wall) * steepest
    # A piston that wedges is reported by the margin; the floor keeps its forces within some twenty
    # times the thrust, so that an iteration over them stays finite.
    slope = jnp.maximum(slope, jnp.where(margin > 0, 1e-9, 0.05 * (1 + steepest)))
    n = (q + wall * (crown_side * kappa_1 - edge_side * kappa_2)) / slope
    return Contact(a1 * n - kappa_1, -a2 * n + kappa_2, n, margin)


def bearing_reactions(
    mechanism: SliderLink,
    crank_acceleration: tuple[Float[Array, "*n"], Float[Array, "*n"]],
    crank_pin: Vector,
    gravity: Float[Array, "2"] | None = None,
) -> tuple[Vector, Vector]:
    """Forces [N] of the upper and the lower bearing on the shaft (Eqs. 25-30 and Table 2).

    Moments are taken about the lower bearing with the crank's inertia referred to the piston plane,
    so the place of the machine's mass centre drops out. Eq. (28) and (30) have sign slips in the
    print; Table 2 is right and is reproduced.

    Args:
        mechanism: masses and planes.
        crank_acceleration: [1/s^2] second time derivative of the crank's unit vector in x and y.
        crank_pin: [N] force of the crank pin on the slider.
        gravity: [m/s^2] field in x and y.
    """
    weights = (None, None) if gravity is None else mechanism.crank_mass * gravity
    _, reach = mechanism.bearing_places
    upper, lower = [], []
    unbalance = mechanism.crank_unbalance, mechanism.crank_unbalance_across
    product = mechanism.crank_product, mechanism.crank_product_across
    pulls, tilts = (
        turned_with(*vector, Vector(*crank_acceleration)) for vector in (unbalance, product)
    )
    for own, tilt, pin, weight in zip(pulls, tilts, crank_pin, weights, strict=True):
        # forces on the shaft besides those of the bearings, negative
        pull = pin + own
        if weight is not None:
            pull = pull - weight
            tilt = tilt - mechanism.crank_centre_depth * weight
        upper.append((reach * pull - tilt) / mechanism.bearing_span)
        lower.append(pull - upper[-1])
    return Vector(*upper), Vector(*lower)


def _side(value):
    return jnp.where(value >= 0, 1.0, -1.0)
