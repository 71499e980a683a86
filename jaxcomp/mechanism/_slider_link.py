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

from .._core.extremes import maximum
from .._core.fields import ANY, NONNEGATIVE, POSITIVE, quantity
from ._mechanism import AbstractKinematics, AbstractMechanism, crank_direction, swing_at


class SliderLink(AbstractMechanism):
    """Slider and piston with link on a crank, as rigid bodies.

    The crown is flush with the end of the cylinder at the top dead centre.

    Args:
        piston_mass: [kg] m_p, piston with link.
        bore: [m] D, piston diameter.
        crank_radius: [m] R, half the stroke.
        cylinder_length: [m] L_c.
        crown_to_link: [m] L_p, from the crown to the centre line of the link.
        slider_diameter: [m] D_s.
        slider_mass: [kg] m_s.
        offset: [m] -e, cylinder axis at y = offset.
        piston_centre_offset: [m] e_cl, mass centre of the piston from the cylinder axis, to +y.
        piston_centre_lead: [m] the same from the link's centre line, to the crown; for weight.
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
    offset: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="cylinder axis at y = offset", usual=(0.0, 0.1)
    )
    piston_centre_offset: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="e_cl, mass centre of the piston from the cylinder axis, to +y"
    )
    piston_centre_lead: Float[Array, ""] = quantity(
        "m", ANY, default=0.0, doc="the same from the link's centre line, to the crown; for weight"
    )

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        engaged = self.cylinder_length > 2 * self.crank_radius
        return {"a machine with cylinder_length > 2 crank_radius": engaged}

    @property
    def piston_area(self) -> Float[Array, ""]:
        return jnp.pi / 4 * self.bore**2

    @property
    def half_balance(self) -> Float[Array, ""]:
        """[kg m] (m_s + m_p/2) R: the slider and half of the piston, see `SliderCrank.half_balance`."""
        return (self.slider_mass + self.piston_mass / 2) * self.crank_radius

    def kinematics(self, angle):
        cosine, sine = crank_direction(angle)
        x = self.crank_radius * cosine
        y = self.crank_radius * sine
        return LinkMotion(cosine, sine, self.crown_to_link + x, -y, -x)

    def reduced_inertia(self, kinematics):
        r"""$m_s R^2 + m_p R^2\sin^2\varphi$ with its rate."""
        x_1 = kinematics.position_1
        x_2 = kinematics.position_2
        value = self.slider_mass * self.crank_radius**2 + self.piston_mass * (x_1 * x_1)
        return value, 2 * self.piston_mass * (x_1 * x_2)

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
        along_x = -kinematics.sine * gravity[0]
        slider = self.slider_mass * (along_x + kinematics.cosine * gravity[1])
        return (slider + self.piston_mass * along_x) * self.crank_radius


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
    radius = mechanism.crank_radius
    cosine, sine = crank_direction(angle)
    engaged = mechanism.cylinder_length - radius * (1 - cosine)
    # the floor is reached only by a piston that leaves its cylinder, which is reported elsewhere
    engaged = maximum(engaged, 1e-6 * mechanism.cylinder_length)
    return ContactArms(
        engaged,
        crown=jnp.broadcast_to(mechanism.crown_to_link, engaged.shape),
        edge=mechanism.crown_to_link - engaged,
        slider=-mechanism.offset + radius * sine,
    )


class PistonLoads(NamedTuple):
    """Loads that the contacts must balance.

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
    # Q less what the left side of the equation for N is at N = 0.
    side = _side(q - wall * (jnp.abs(kappa_1) + jnp.abs(kappa_2)))
    a1, a2 = slopes(side)
    # The same where F_1 = 0 (N = kappa_1/alpha_1) and where F_2 = 0, both times their alpha: no
    # division by one that vanishes.
    between = wall * jnp.abs(a2 * kappa_1 - a1 * kappa_2)
    crown_side = _side(a1 * q - kappa_1 - jnp.sign(a1) * between)
    edge_side = -_side(a2 * q - kappa_2 - jnp.sign(a2) * between)
    slope = 1 + wall * (crown_side * a1 - edge_side * a2)
    # on either side of N, whichever it is: the margin must not jump where N turns round
    steepest = maximum(*(sum(map(jnp.abs, slopes(side))) for side in (1.0, -1.0)))
    margin = 1 - jnp.abs(wall) * steepest
    # A piston that wedges is reported by the margin; the floor keeps its forces within some twenty
    # times the thrust, so that an iteration over them stays finite.
    slope = maximum(slope, jnp.where(margin > 0, 1e-9, 0.05 * (1 + steepest)))
    n = (q + wall * (crown_side * kappa_1 - edge_side * kappa_2)) / slope
    return Contact(a1 * n - kappa_1, -a2 * n + kappa_2, n, margin)


def _side(value):
    # Never zero, unlike `jnp.sign`: a contact without a force has a side all the same.
    return jnp.where(value >= 0, 1.0, -1.0)
