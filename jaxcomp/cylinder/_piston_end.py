"""One side of a piston as the gas there sees it: the head end, or the crank end around the rod."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanism import AbstractMechanism
from .laminar_gap import LaminarGap


class PistonEnd(eqx.Module):
    r"""The motion of a piston seen from one end of its cylinder.

    The crank end sees the stroke from the other side, on the area less that of the rod,

    $$x_{CE}(\psi) = -x_p(\psi - \pi), \qquad A_{CE} = A - \tfrac\pi4 d^2 ,$$

    and counts its crank angle from half a revolution later, so that either end compresses before its
    own zero.

    Attributes:
        mechanism: the linkage of the cylinder.
        sense: [-] 1 at the head end, -1 at the crank end.
        rod_diameter: [m] of the rod through this end; 0 at the head end.
        ambient_pressure: [Pa] on the rod's other end.
        rings: gap between piston and cylinder, from this end to the other; tight if absent.
    """

    mechanism: AbstractMechanism
    sense: Float[Array, ""]
    rod_diameter: Float[Array, ""]
    ambient_pressure: Float[Array, ""]
    rings: LaminarGap | None = None

    @property
    def turn(self) -> Float[Array, ""]:
        """[rad] Crank angle of this end less that of the cylinder."""
        return jnp.where(self.sense > 0, 0.0, jnp.pi)

    @property
    def piston_area(self) -> Float[Array, ""]:
        """[m^2] on which the gas of this end acts."""
        return self.mechanism.piston_area - jnp.pi / 4 * self.rod_diameter**2

    @property
    def bore(self) -> Float[Array, ""]:
        """[m] of the cylinder, of a round piston of its area."""
        return jnp.sqrt(4 / jnp.pi * self.mechanism.piston_area)

    @property
    def sealed_diameter(self) -> Float[Array, ""]:
        """[m] along which this end leaks to the outside: past the rod, where there is one."""
        return jnp.where(self.sense > 0, self.bore, self.rod_diameter)

    @property
    def stroke(self) -> Float[Array, ""]:
        """[m] Distance between the true dead centres."""
        return self.mechanism.stroke

    @property
    def swept_volume(self) -> Float[Array, ""]:
        """[m^3] of this end."""
        return self.piston_area * self.stroke

    def piston(self, angle: Float[Array, "*n"]):
        """Position [m] towards the cover of this end, and both derivatives, at its crank angles [rad]."""
        # towards the other cover all of position, speed and acceleration change their sign
        return tuple(self.sense * value for value in self.mechanism.piston(angle - self.turn))

    def piston_extremes(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Position [m] next to the cover of this end, and away from it."""
        top, bottom = self.mechanism.piston_extremes()
        # the crank end has its least volume where the piston is furthest from the head
        head = self.sense > 0
        return jnp.where(head, top, -bottom), jnp.where(head, bottom, -top)

    def dead_centres(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Crank angles [rad] of this end where its volume is least, and where it is largest."""
        top, bottom = self.mechanism.dead_centres()
        head = self.sense > 0
        return jnp.where(head, top, bottom + jnp.pi), jnp.where(head, bottom, top + jnp.pi)
