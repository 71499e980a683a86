"""The gas that fills a network of pipes, as small waves see it."""

from typing import NamedTuple

from jaxtyping import Array, Float

from ..fluid import AbstractFluid, GasState


class PipeGas(NamedTuple):
    """Gas at rest in a network.

    Attributes:
        pressure: [Pa]
        density: [kg/m^3]
        sound_speed: [m/s]
        heat_capacity_ratio: [-] c_p/c_v.
        viscosity: [Pa s] dynamic.
        prandtl: [-]
    """

    pressure: Float[Array, ""]
    density: Float[Array, ""]
    sound_speed: Float[Array, ""]
    heat_capacity_ratio: Float[Array, ""]
    viscosity: Float[Array, ""]
    prandtl: Float[Array, ""]


def pipe_gas(fluid: AbstractFluid, state: GasState) -> PipeGas:
    """Gas of a network.

    Args:
        fluid: whose viscosity and conductivity damp the waves.
        state: at rest.
    """
    viscosity, conductivity = fluid.transport(state.T, state.rho)
    return PipeGas(
        pressure=state.p,
        density=state.rho,
        sound_speed=state.speed_of_sound,
        heat_capacity_ratio=state.c_p / state.c_v,
        viscosity=viscosity,
        prandtl=state.c_p * viscosity / conductivity,
    )
