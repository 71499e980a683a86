"""A plate or reed by its mass and stiffness."""

from dataclasses import KW_ONLY
from typing import ClassVar

from jaxtyping import Array, Float

from .._core.fields import NONNEGATIVE, POSITIVE, quantity
from ._valve import AbstractMovingValve, Oscillator


class PlateValve(AbstractMovingValve):
    """A plate or reed by its mass and stiffness.

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
        unloader: of a suction valve, which acts as far as `unloaded` of the cylinder says.
        mass: [kg] moving.
        stiffness: [N/m]
    """

    kind: ClassVar[str] = "reed"

    _: KW_ONLY
    mass: Float[Array, ""] = quantity("kg", POSITIVE, doc="moving", usual=(1e-6, 2.0))
    stiffness: Float[Array, ""] = quantity("N/m", NONNEGATIVE, usual=(10.0, 1e6))

    @property
    def oscillator(self):
        return Oscillator(self.mass, self.stiffness, self.damping, self.preload, self.stop)
