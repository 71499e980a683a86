"""Fluids that condense: what a pure fluid and a mixture offer beyond the state of a gas."""

from abc import abstractmethod
from typing import Any, TypeGuard

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import Bound, is_any_traced, is_traced
from .._core.roots import root
from ._fluid import AbstractFluid, GasState, SmallSystem, compiled
from ._helmholtz import Saturation

# Of the range of an equation of state, up to which it is extrapolated.
FAR = 1.2
# [K] by which gas may be colder than saturation, for pressures that are given in few digits
NEAR_SATURATION = 0.5
# Half of the glide's slope over temperature, a few per cent, is what each leaves of the error.
_STEPS_OF_MEAN = 16


def tools_for(*numbers) -> Any:
    """`numpy` for known numbers, so that nothing is compiled; `jax.numpy` where one is traced."""
    if any(map(is_traced, numbers)):
        return jnp
    return np


class AbstractRealGas(AbstractFluid):
    """A fluid with a dew line and a liquid: a pure fluid, or a mixture."""

    name: eqx.AbstractVar[str]

    @property
    @abstractmethod
    def condenses(self) -> bool:
        """True with a dew line: that of a natural gas lies below all temperatures of a machine."""

    @property
    @abstractmethod
    def lowest_temperature(self) -> float | Float[Array, ""]:
        """[K] Where its dew line begins."""

    @property
    @abstractmethod
    def critical_temperature(self) -> float | Float[Array, ""]:
        """[K] Where its dew line ends; of a mixture just below the critical point."""

    @property
    @abstractmethod
    def critical_pressure(self) -> float | Float[Array, ""]:
        """[Pa] on the dew line at that temperature."""

    @property
    @abstractmethod
    def highest_pressure(self) -> float:
        """[Pa] Up to which the equation of state holds."""

    def state(self, T, rho):
        if is_any_traced(self, T, rho):
            return self._state(T, rho)
        return self._state_of_known(T, rho)

    @compiled
    def _state_of_known(self, T, rho) -> GasState:
        """The state outside of programs: one program instead of one for each of a hundred operations."""
        return self._state(T, rho)

    @abstractmethod
    def _state(self, T, rho) -> GasState:
        """The state, as a part of programs."""

    def is_beyond_range(self, T, p):
        _, highest = self.temperature_range
        return (FAR * highest < T) | (FAR * self.highest_pressure < p)

    @property
    def range_ends_with(self) -> str:
        """Fluid whose equation of state ends at the highest temperature: of a mixture a component."""
        return self.name

    @property
    def pressure_ends_with(self) -> str:
        """Fluid whose equation of state ends at the highest pressure."""
        return self.name

    @property
    @abstractmethod
    def has_glide(self) -> bool:
        """Whether dew and bubble temperature at a pressure differ, as those of a blend do."""

    @property
    def knows_dew_points(self) -> bool:
        """True where dew points are known, so that wet gas is recognised."""
        return self.condenses

    def condensation_temperature(self, p) -> Any:
        """[K] At which the gas begins to condense at pressures [Pa]; zero where that is not known.

        That of a natural gas is the warmest dew point of all that is in it; it has no bubble points here.
        """
        if not self.condenses:
            return 0.0
        return self.dew_temperature(p)

    @abstractmethod
    def dew_temperature(self, p) -> Any:
        """[K] Dew temperature at pressures [Pa] by a curve, to about 0.1 K.

        Beyond the curve that of its end: the critical temperature, or the lowest of the fluid.
        Known pressures give numbers of NumPy, for checks that shall compile nothing.
        """

    @abstractmethod
    def dew_pressure(self, T) -> Any:
        """[Pa] The inverse of `dew_temperature`."""

    @abstractmethod
    def bubble_temperature(self, p) -> Any:
        """[K] At which liquid begins to boil at pressures [Pa]; else as `dew_temperature`."""

    @abstractmethod
    def bubble_pressure(self, T) -> Any:
        """[Pa] The inverse of `bubble_temperature`."""

    @abstractmethod
    def bubble_of_dew(self, T: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[K] Bubble temperatures at the pressures of dew temperatures `T` [K], to rounding.

        Those of a pure fluid are the dew temperatures themselves, and nothing is computed.
        """

    def dew_of_mean(self, T: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[K] Dew temperatures where they and the bubble temperatures have the mean `T`."""
        if not self.has_glide:
            return T
        if not any(map(is_traced, jax.tree.leaves((self, T)))):
            mean = np.asarray(T, float)
            dew = mean
            for _ in range(_STEPS_OF_MEAN):
                dew = mean + (dew - np.asarray(self.bubble_of_dew(dew))) / 2
            return jnp.asarray(dew)
        return self._dew_of_mean(T)

    @eqx.filter_jit
    def _dew_of_mean(self, T):
        def misfit(dew, inputs):
            fluid, mean = inputs
            return (dew + fluid.bubble_of_dew(dew)) / 2 - mean

        def solve(inputs):
            fluid, mean = inputs

            def step(_, dew):
                return mean + (dew - fluid.bubble_of_dew(dew)) / 2

            return lax.fori_loop(0, _STEPS_OF_MEAN, step, mean)

        def inverse(mean):
            return root(SmallSystem(misfit, solve, (self, mean)))

        return jnp.vectorize(inverse)(jnp.asarray(T, float))

    @abstractmethod
    def dew_of_evaporator(self, T: Float[Array, ""], h: Float[Array, ""]) -> Float[Array, ""]:
        """[K] Dew temperature of an evaporator whose mean temperature is `T` [K].

        The mean is that of the dew temperature and of the temperature behind the expansion valve, at the
        pressure of the evaporator.

        Args:
            T: [K]
            h: [J/kg] of the liquid before the expansion.

        Raises:
            BadInput: a pseudo-pure fluid, whose phases have one composition.
        """

    @abstractmethod
    def saturation(
        self, T: Float[Array, ""] | None = None, p: Float[Array, ""] | None = None
    ) -> Saturation:
        """Saturation at a temperature `T` [K] or at a pressure `p` [Pa] below the critical one.

        Raises:
            BadInput: one that is not on the lines of the fluid; within `jit` it is not seen.
        """

    @abstractmethod
    def boiling_density(self, T: Float[Array, ""]) -> Float[Array, ""]:
        """[kg/m^3] of the boiling liquid at a temperature `T` [K], to about 1 %."""

    @compiled
    def liquid(self, T: Float[Array, ""], p: Float[Array, ""]) -> GasState:
        """The liquid at a temperature `T` [K] and a pressure `p` [Pa], compressed above saturation.

        Sought from the density of the boiling liquid at that temperature, so that a liquid that is
        slightly too warm for its pressure is found as well.
        """

        # p(rho) of a liquid bends up: from any density the second step is on the steep side, and
        # Newton's method comes down to the root without passing it. Near the critical point the slope
        # goes to zero, and a step would leave the liquid.
        density = self._density_from(
            lambda fluid, T, p: fluid.boiling_density(T),
            T,
            p,
            least_slope=1e-2,
            shares=(0.95, 1.05),
            steps=12,
        )
        return self.state(T, density)

    def _require(self, name: str, value, bound: Bound, why: str) -> None:
        if not np.all(bound.inside(np.asarray(value))):
            raise BadInput(name, value, f"{bound} {why} {self.name}")


def state_of_terms(T, rho, R, ideal, residual) -> GasState:
    """The gas at a temperature [K] and density [kg/m^3], from its Helmholtz energy over R T.

    Args:
        T: [K]
        rho: [kg/m^3]
        R: [J/(kg K)] specific gas constant.
        ideal: a0, tau a0_tau, tau^2 a0_tautau, as `ideal_terms` gives them.
        residual: as `residual_terms` gives it.
    """
    a0, a0_t, a0_tt = ideal
    ar, ar_d, ar_dd, ar_t, ar_tt, ar_dt = residual
    return GasState(
        T,
        rho,
        p=rho * R * T * (1 + ar_d),
        u=R * T * (a0_t + ar_t),
        s=R * (a0_t + ar_t - a0 - ar),
        c_v=-R * (a0_tt + ar_tt),
        dp_dT=rho * R * (1 + ar_d - ar_dt),
        dp_drho=R * T * (1 + 2 * ar_d + ar_dd),
    )


def has_dew_line(fluid: object) -> TypeGuard[AbstractRealGas]:
    """Whether a fluid can be at a rating point: neither a perfect gas, nor one that never condenses."""
    return isinstance(fluid, AbstractRealGas) and fluid.condenses
