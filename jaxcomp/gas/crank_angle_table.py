"""A pressure that is given over the crank angle."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.extremes import max_of, min_of
from .._core.fields import ANY, NONNEGATIVE, quantity
from ._diagram import AbstractDiagram, check_same_length, curve, with_knots

# [rad] Closer than this to a revolution from the first point the last one is the same.
_SAME_ANGLE = 1e-6
# Of the range of a diagram: what both ends of a closed one may differ by, as indicators round and drift.
_SAME_PRESSURE = 0.01


class CrankAngleTable(AbstractDiagram):
    """Pressure over crank angle, joined by a periodic cubic with continuous slope.

    The slopes are those of the parabola through three neighbouring points, so the curve is exact at
    its points and linear in them.

    Indicators repeat the first point at the end, a revolution later. Such a table is closed: both ends
    are one point, whose pressure is the mean of the two.

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        angle: [rad] (n,) rising, within one revolution; the last one may be a revolution after the first.
        cylinder_pressure: [Pa] (n,) absolute, at those angles.
    """

    kind: ClassVar[str] = "crank_angle_table"

    angle: Float[Array, " n"] = quantity(
        "rad", ANY, shape=(None,), doc="rising, within one revolution"
    )
    cylinder_pressure: Float[Array, " n"] = quantity("Pa", NONNEGATIVE, shape=(None,))
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    @property
    def closed(self) -> Bool[Array, ""]:
        """Whether the last point is the first one, a revolution later."""
        return jnp.abs(self.angle[-1] - self.angle[0] - 2 * jnp.pi) < _SAME_ANGLE

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        rising = (self.angle[1:] > self.angle[:-1]).all()
        within = self.angle[-1] - self.angle[0] < 2 * jnp.pi + _SAME_ANGLE
        pressure = self.cylinder_pressure
        step = jnp.abs(pressure[-1] - pressure[0])
        alike = step <= _SAME_PRESSURE * (max_of(pressure) - min_of(pressure))
        return {
            "a table within one revolution (two, as of four strokes, are not modelled)": within,
            "a table with rising angles": rising,
            "a table whose cylinder_pressure is the same at both ends of the revolution": alike
            | ~self.closed,
            "a table of at least three points": jnp.asarray(self.angle.size > 2)
            & (~self.closed | (self.angle.size > 3)),
        }

    def repaired(self):
        return with_knots(self, "angle", jnp.linspace(0, 2 * jnp.pi, self.angle.size, False))

    def __check_init__(self):
        check_same_length(self, "angle", "cylinder_pressure")

    def event_angles(self):
        """Every point: the curve bends there."""
        return self.angle

    def pressure(self, stroke):
        turn = 2 * jnp.pi
        angle = self.angle
        values = self.cylinder_pressure
        closed = self.closed
        joined = jnp.where(closed, (values[0] + values[-1]) / 2, values[jnp.array([0, -1])])
        values = values.at[jnp.array([0, -1])].set(joined)
        # With two points of the revolution before and after, the slopes at both ends are those of inner
        # points. Of a closed table the last point is the first one, and counts once.
        before = jnp.where(closed, jnp.array([-3, -2]), jnp.array([-2, -1]))
        after = jnp.where(closed, jnp.array([1, 2]), jnp.array([0, 1]))
        x = jnp.concatenate([angle[before] - turn, angle, angle[after] + turn])
        y = jnp.concatenate([values[before], values, values[after]])
        start = angle[0]
        return curve(start + jnp.mod(stroke.angle - start, turn), x, y)
