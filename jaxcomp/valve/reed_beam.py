"""A reed by its dimensions."""

from dataclasses import KW_ONLY
from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import POSITIVE, quantity
from ._valve import AbstractMovingValve, Oscillator


class ReedBeam(AbstractMovingValve):
    r"""A reed by its dimensions: a cantilever that the port loads at a distance a from its root.

    $I = wh^3/12$, $k = 6EI/(a^2(3l - a))$, $m = \rho w h l/3$ (Bell et al., PDSim).

    Args:
        port_diameter: [m]
        flow_coefficient: [-] C_d.
        port_length: [m] of the gas column that has inertia; quasi-steady flow if absent.
        force_coefficient: [-] C_f.
        stop: [m] largest lift.
        damping: [N s/m]
        preload: [m] as a lift.
        restitution: [-] at seat and stop.
        sticking_speed: [m/s] rebound below which the valve rests; absent: see `rest_speed`.
        lift_table: [m] (n,) of the areas beside it.
        flow_area_table: [m^2] (n,) effective.
        force_area_table: [m^2] (n,)
        stiction: oil between plate and seat; none if absent.
        thickness: [m]
        width: [m]
        length: [m] from the root to the tip.
        port_distance: [m] from the root to the middle of the port.
        elastic_modulus: [Pa]
        density: [kg/m^3]
    """

    kind: ClassVar[str] = "reed_beam"

    _: KW_ONLY
    thickness: Float[Array, ""] = quantity("m", POSITIVE)
    width: Float[Array, ""] = quantity("m", POSITIVE, usual=(1e-3, 0.1))
    length: Float[Array, ""] = quantity("m", POSITIVE, doc="root to tip", usual=(2e-3, 0.3))
    port_distance: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="from the root", usual=(1e-3, 0.3)
    )
    elastic_modulus: Float[Array, ""] = quantity("Pa", POSITIVE, default=193e9, usual=(1e9, 1e12))
    density: Float[Array, ""] = quantity("kg/m^3", POSITIVE, default=7800.0, usual=(500.0, 25e3))

    @property
    def oscillator(self):
        second_moment = self.width * self.thickness**3 / 12
        arm = self.port_distance**2 * (3 * self.length - self.port_distance)
        stiffness = 6 * self.elastic_modulus * second_moment / arm
        mass = self.density * self.width * self.thickness * self.length / 3
        return Oscillator(mass, stiffness, self.damping, self.preload, self.stop)
