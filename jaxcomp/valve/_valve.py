r"""What every valve offers: what moves in it, and its areas for flow and force over the lift.

$$m\ddot x = C_f A_{port}(p_{up} - p_{down}) - k(x + x_0) - b\dot x,\quad 0 \le x \le x_{stop}$$

Effective flow area: curtain and port in series,
$A_e = C_d A_l/\sqrt{1 + (A_l/A_{port})^2}$ with $A_l = \pi d x$ (Soedel, Sound and Vibrations of
Positive Displacement Compressors, 2007), or a table over the lift.
"""

from abc import abstractmethod
from dataclasses import KW_ONLY
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.extremes import clip
from .._core.fields import NONNEGATIVE, POSITIVE, Bound, Part, quantity
from .._core.polynomials import cubics, inner_slopes
from .oil_film import OilFilm
from .unloader import Unloader


class Oscillator(NamedTuple):
    """Moving part of a valve: mass [kg], stiffness [N/m], damping [N s/m], preload and stop [m]."""

    mass: Float[Array, ""]
    stiffness: Float[Array, ""]
    damping: Float[Array, ""]
    preload: Float[Array, ""]
    stop: Float[Array, ""]


class AbstractValve(Part):
    """A valve with its port.

    Args:
        port_diameter: [m]
        flow_coefficient: [-] C_d.
        port_length: [m] of the gas column that has inertia; quasi-steady flow if absent.
    """

    _: KW_ONLY
    port_diameter: Float[Array, ""] = quantity("m", POSITIVE, usual=(5e-4, 0.3))
    flow_coefficient: Float[Array, ""] = quantity(
        "", POSITIVE, default=0.65, doc="C_d", usual=(0.2, 1.2)
    )
    port_length: Float[Array, ""] | None = quantity(
        "m",
        POSITIVE,
        default=None,
        doc="of the gas column that has inertia: plate thickness and about 0.8 port diameters; "
        "quasi-steady flow if absent",
    )

    @property
    def port_area(self) -> Float[Array, ""]:
        """[m^2]"""
        return jnp.pi / 4 * self.port_diameter**2

    @property
    @abstractmethod
    def oscillator(self) -> Oscillator | None:
        """Moving part; `None` for an ideal check valve."""

    @abstractmethod
    def flow_area(self, lift: Float[Array, ""]) -> Float[Array, ""]:
        """Effective flow area [m^2] at a lift [m]."""

    @abstractmethod
    def force_area(self, lift: Float[Array, ""]) -> Float[Array, ""]:
        """Area [m^2] on which the pressure difference acts at a lift [m]."""


class AbstractMovingValve(AbstractValve):
    """Base of the moving valves."""

    _: KW_ONLY
    stop: Float[Array, ""] = quantity("m", POSITIVE, doc="largest lift", usual=(5e-5, 0.02))
    force_coefficient: Float[Array, ""] = quantity(
        "", POSITIVE, default=1.1, doc="C_f", usual=(0.2, 3.0)
    )
    damping: Float[Array, ""] = quantity("N s/m", NONNEGATIVE, default=0.0, usual=(0.0, 1e4))
    preload: Float[Array, ""] = quantity("m", NONNEGATIVE, default=0.0, doc="as a lift")
    restitution: Float[Array, ""] = quantity(
        "", Bound(0.0, 1.0, high_open=True), default=0.0, doc="at seat and stop"
    )
    sticking_speed: Float[Array, ""] | None = quantity(
        "m/s",
        POSITIVE,
        default=None,
        doc="rebound below which the valve rests; absent: by its scales",
    )
    lift_table: Float[Array, " n"] | None = quantity(
        "m", NONNEGATIVE, shape=(None,), default=None, doc="rising from 0, of the areas beside it"
    )
    flow_area_table: Float[Array, " n"] | None = quantity(
        "m^2", NONNEGATIVE, shape=(None,), default=None, doc="effective, in place of the formula"
    )
    force_area_table: Float[Array, " n"] | None = quantity(
        "m^2", POSITIVE, shape=(None,), default=None, doc="in place of C_f times the port"
    )
    stiction: OilFilm | None = None
    unloader: Unloader | None = None

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        if self.lift_table is None:
            return {}
        rising = (self.lift_table[1:] > self.lift_table[:-1]).all() & (self.lift_table[0] == 0)
        return {"a table with lifts that rise from 0": rising}

    def __check_init__(self):
        for table in (self.flow_area_table, self.force_area_table):
            if table is not None and (
                self.lift_table is None or table.shape != self.lift_table.shape
            ):
                raise ValueError("a table of areas needs a `lift_table` of the same length.")

    def rest_speed(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Rebound [m/s] below which the valve rests on seat or stop.

        If it is not given, 5e-4 of the speed at which spring and crank move it over its lift. What lower
        bounces would add, which are many, is 1e-8 of the flow.

        Args:
            speed: [m/s] of the lift within a radian of the crank.
        """
        if self.sticking_speed is not None:
            return self.sticking_speed
        moving: Any = self.oscillator
        return 5e-4 * (moving.stop * jnp.sqrt(moving.stiffness / moving.mass) + speed)

    def flow_area(self, lift):
        if self.flow_area_table is not None:
            return _curve(lift, self.lift_table, self.flow_area_table)
        curtain = jnp.pi * self.port_diameter * lift
        return self.flow_coefficient * curtain / jnp.sqrt(1 + (curtain / self.port_area) ** 2)

    def force_area(self, lift):
        if self.force_area_table is not None:
            return _curve(lift, self.lift_table, self.force_area_table)
        return self.force_coefficient * self.port_area + 0 * lift


def _curve(x, knots, values):
    """Cubics with continuous slope through the points, constant beyond the last."""
    secant, inner = inner_slopes(knots, values)
    # No slope at the last point, so that the constant beyond joins without a kink.
    slopes = jnp.concatenate([secant[:1], inner, jnp.zeros(1)])
    return cubics(clip(x, knots[0], knots[-1]), knots, values, slopes)
