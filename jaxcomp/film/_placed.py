r"""A journal whose centre moves in its film over the revolution, as the crank's solvers take it.

With F the load on the journal, $c\,e$ its centre, V the effective velocity of `_squeeze` and
$J_0 = 2\pi\eta R^3 L/(c\sqrt{1-\epsilon^2})$ the film puts against journal and bush the moments

$$M_j = J_0(\omega_j-\omega_b) - \tfrac{c}{2}\,e\times F, \quad
  M_b = -J_0(\omega_j-\omega_b) - \tfrac{c}{2}\,e\times F, \quad
  P = J_0(\omega_j-\omega_b)^2 + c\,F\cdot V .$$

The dissipation P, not $M_j\omega_j$, is what the crank has to pay: the load does the work $F\cdot de$ in
the clearance, which the rigid mechanism does not have. Shear is counted over the whole ring. A contact
(`_contact`) pushes along e: it leaves the film the rest of F in the last term of P, and its friction
joins the moments, and P.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import maximum
from ._bearing import JournalBearing, film_unit, ring_contact, squeeze_of
from ._film import Pair
from ._parts import AbstractJournal

# [rad/s] Of the crank: near rest the dissipation over the speed is no torque, and is left out.
_REST = 0.2


def shear_drag(bearing: JournalBearing, position: Pair) -> Float[Array, "*n"]:
    """[N m s] J_0, moment over the relative rate of rotation, at a position over c."""
    square = position[0] ** 2 + position[1] ** 2
    # An iteration may put the journal beyond the wall.
    room = jnp.sqrt(maximum(1 - square, 1e-9))
    volume = bearing.radius**3 * bearing.length / bearing.radial_clearance
    return 2 * jnp.pi * bearing.dynamic_viscosity * volume / room


class PlacedJournal(AbstractJournal):
    """A moving journal at known positions.

    Args:
        bearing: the bearing.
        position: [-] (2, *n) centre of the journal over c at every instant.
        lossless: whether somebody else counts its loss.
    """

    bearing: JournalBearing
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
        e = self.position
        c = self.bearing.radial_clearance
        turning = e[1] * force[0] - e[0] * force[1]  # e x F of the load on the journal
        # The sign of -M_b: what resists the bush drives it along the rate of the journal in it.
        smooth = shear_drag(self.bearing, e) * rate + 0.5 * c * turning
        contact = self._contact()
        return smooth if contact is None else smooth + contact.torque(e, rate)

    def _contact(self):
        return ring_contact(self.bearing)

    def dissipation(
        self, force: Pair, rate: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """[W] Shear with rubbing, and squeeze, at the same arguments."""
        unit = film_unit(self.bearing)
        load = jnp.stack([-force[0], -force[1]])
        shear = shear_drag(self.bearing, self.position) * rate**2
        contact = self._contact()
        if contact is not None:
            # the film moves by what the contact leaves it of the load
            load = load - contact.push(self.position)
            shear = shear + contact.torque(self.position, rate) * rate
        velocity = squeeze_of(self.bearing).mobility(self.position, load / unit)
        power = load[0] * velocity[0] + load[1] * velocity[1]
        return shear, self.bearing.radial_clearance * power

    def loss_torque(self, force: Pair, rate, speed) -> Float[Array, "*n"]:
        """[N m] Dissipation over the speed of the crank [rad/s]."""
        if self.lossless:
            return jnp.zeros_like(speed)
        # 1/speed with a relative error of (_REST/speed)^4; odd in the speed, and zero at rest.
        return sum(self.dissipation(force, rate)) * speed**3 / (speed**4 + _REST**4)
