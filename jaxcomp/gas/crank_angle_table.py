"""A pressure that is given over the crank angle."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.fields import ANY, NONNEGATIVE, quantity
from ._diagram import AbstractDiagram, check_same_length, curve, with_knots


class CrankAngleTable(AbstractDiagram):
    """Pressure over crank angle, joined by a periodic cubic with continuous slope.

    The slopes are those of the parabola through three neighbouring points, so the curve is exact at
    its points and linear in them.

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        angle: [rad] (n,) rising, within one revolution.
        cylinder_pressure: [Pa] (n,) absolute, at those angles.
    """

    kind: ClassVar[str] = "crank_angle_table"

    angle: Float[Array, " n"] = quantity(
        "rad", ANY, shape=(None,), doc="rising, within one revolution"
    )
    cylinder_pressure: Float[Array, " n"] = quantity("Pa", NONNEGATIVE, shape=(None,))
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        rising = (self.angle[1:] > self.angle[:-1]).all()
        within = self.angle[-1] - self.angle[0] < 2 * jnp.pi
        return {
            "a table with rising angles within one revolution, the first not again at the end": rising
            & within,
            "a table of at least three points": jnp.asarray(self.angle.size > 2),
        }

    def repaired(self):
        return with_knots(self, "angle", jnp.linspace(0, 2 * jnp.pi, self.angle.size, False))

    def __check_init__(self):
        check_same_length(self, "angle", "cylinder_pressure")

    def pressure(self, stroke):
        turn = 2 * jnp.pi
        # With two points of the turn before and after, the slopes at both ends are those of inner
        # points.
        x = jnp.concatenate([self.angle[-2:] - turn, self.angle, self.angle[:2] + turn])
        y = jnp.concatenate(
            [self.cylinder_pressure[-2:], self.cylinder_pressure, self.cylinder_pressure[:2]]
        )
        start = self.angle[0]
        return curve(start + jnp.mod(stroke.angle - start, turn), x, y)
