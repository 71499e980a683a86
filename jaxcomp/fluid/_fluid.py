"""What every fluid offers: its state from temperature and density, and what inverts it.

Temperature and density are the independent variables, so a state is explicit; pressure, enthalpy or
entropy as inputs are inverted by Newton's method where a calculation is set up, never within a cycle.
Derivatives of any order follow from the implicit function theorem.
"""

import functools
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from .._core.extremes import clip, maximum
from .._core.fields import Part
from .._core.roots import AbstractRoot, root

_P = ParamSpec("_P")
_R = TypeVar("_R")


def compiled(method: Callable[_P, _R]) -> Callable[_P, _R]:
    """`equinox.filter_jit` of a method, where a number of Python is an argument like an array.

    `filter_jit` takes it for a part of the program: each temperature would be a program of its own.
    """
    program: Any = eqx.filter_jit(method)

    @functools.wraps(method)
    def call(*positional: _P.args, **keywords: _P.kwargs) -> _R:
        numbers = {name: _as_argument(value) for name, value in keywords.items()}
        return program(*map(_as_argument, positional), **numbers)

    return call


def _as_argument(value: Any) -> Any:
    if isinstance(value, float | int):
        return np.float64(value)
    return value


def value_with_slopes(function: Callable[..., Array], unknowns: Array, inputs: Any):
    """Value of a function of unknowns and inputs with its Jacobian by the unknowns."""

    def twice(unknowns):
        # the value comes with the slopes: alone it would be a second evaluation
        value = function(unknowns, inputs)
        return value, value

    jacobian, value = jax.jacfwd(twice, has_aux=True)(unknowns)
    return value, jacobian


class GasState(NamedTuple):
    """A state of equilibrium.

    Attributes:
        T: [K] temperature.
        rho: [kg/m^3] density.
        p: [Pa] pressure.
        u: [J/kg] internal energy.
        s: [J/(kg K)] entropy.
        c_v: [J/(kg K)] heat capacity at constant volume.
        dp_dT: [Pa/K] at constant density.
        dp_drho: [Pa m^3/kg] at constant temperature.
    """

    T: Float[Array, "*n"]
    rho: Float[Array, "*n"]
    p: Float[Array, "*n"]
    u: Float[Array, "*n"]
    s: Float[Array, "*n"]
    c_v: Float[Array, "*n"]
    dp_dT: Float[Array, "*n"]
    dp_drho: Float[Array, "*n"]

    @property
    def h(self) -> Float[Array, "*n"]:
        """[J/kg] enthalpy."""
        return self.u + self.p / self.rho

    @property
    def c_p(self) -> Float[Array, "*n"]:
        """[J/(kg K)] heat capacity at constant pressure."""
        return self.c_v + self.T * self.dp_dT**2 / (self.rho**2 * self.dp_drho)

    @property
    def kappa(self) -> Float[Array, "*n"]:
        """[-] isentropic exponent rho w^2/p, of p v^kappa = const for small changes."""
        return self.rho * self.dp_drho * self.c_p / (self.p * self.c_v)

    @property
    def speed_of_sound(self) -> Float[Array, "*n"]:
        """[m/s]"""
        return jnp.sqrt(self.dp_drho * self.c_p / self.c_v)


class AbstractFluid(Part):
    """A fluid by its equation of state."""

    @abstractmethod
    def state(self, T: Float[Array, "*n"], rho: Float[Array, "*n"]) -> GasState:
        """The state at a temperature `T` [K] and a density `rho` [kg/m^3]."""

    @abstractmethod
    def transport(
        self, T: Float[Array, "*n"], rho: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """Viscosity [Pa s] and thermal conductivity [W/(m K)] of the gas.

        Args:
            T: [K] temperature.
            rho: [kg/m^3] density.
        """

    @property
    @abstractmethod
    def specific_gas_constant(self) -> Float[Array, ""]:
        """[J/(kg K)]"""

    @property
    @abstractmethod
    def temperature_range(self) -> tuple[float, float]:
        """[K] Where the equation of state holds."""

    def is_beyond_range(self, T: Float[Array, "*n"], p: Float[Array, "*n"]) -> Bool[Array, "*n"]:
        """Whether the gas is so far beyond its equation's range that its numbers mean nothing.

        Args:
            T: [K] temperature.
            p: [Pa] pressure.
        """
        del T
        return p < 0

    def is_wet(self, T: Float[Array, "*n"], rho: Float[Array, "*n"]) -> Bool[Array, "*n"]:
        """Whether the gas is denser than on the dew line, beyond the error of that curve.

        Args:
            T: [K] temperature.
            rho: [kg/m^3] density.
        """
        del T
        return rho < 0

    @compiled
    def density(self, T: Float[Array, ""], p: Float[Array, ""]) -> Float[Array, ""]:
        """Density [kg/m^3] of the gas at a temperature `T` [K] and a pressure `p` [Pa].

        Below saturation there is no gas: the result is then near the limit of the metastable gas,
        and its pressure below the one that was given.
        """

        # From the perfect gas, which is thinner: p(rho) of a gas bends down, so the steps come from
        # below and do not overshoot. Beyond the limit of the metastable gas dp/drho < 0 would turn a
        # step round.
        return self._density_from(
            lambda fluid, T, p: p / (fluid.specific_gas_constant * T),
            T,
            p,
            least_slope=1e-3,
            shares=(0.5, 1.3),
            steps=40,
        )

    def _density_from(self, start, T, p, least_slope: float, shares: tuple, steps: int):
        """Density [kg/m^3] at a temperature `T` [K] and a pressure `p` [Pa], by Newton's method.

        Args:
            start: [kg/m^3] function of the fluid, T and p.
            T: [K]
            p: [Pa]
            least_slope: [-] of dp/drho that a step is made with, over that of the perfect gas.
            shares: [-] lowest and highest density after a step, over that before it.
            steps: of the method.
        """
        low, high = shares

        def misfit(rho, inputs):
            fluid, T, p = inputs
            return fluid.state(T, rho).p / p - 1

        def solve(inputs):
            fluid, T, p = inputs

            def newton(_, rho):
                state = fluid.state(T, rho)
                slope = maximum(state.dp_drho, least_slope * fluid.specific_gas_constant * T)
                return clip(rho + (p - state.p) / slope, low * rho, high * rho)

            return lax.fori_loop(0, steps, newton, start(fluid, T, p))

        return root(SmallSystem(misfit, solve, (self, T, p)))

    @compiled
    def at_entropy(self, p: Float[Array, ""], s: Float[Array, ""], start: GasState) -> GasState:
        """The gas at a pressure `p` [Pa] and an entropy `s` [J/(kg K)], sought from a state `start`."""
        return self._at(lambda state: state.s, p, s, start)

    @compiled
    def at_enthalpy(self, p: Float[Array, ""], h: Float[Array, ""], start: GasState) -> GasState:
        """The gas at a pressure `p` [Pa] and an enthalpy `h` [J/kg], sought from a state `start`."""
        return self._at(lambda state: state.h, p, h, start)

    def _at(self, caloric, p, value, start: GasState) -> GasState:
        low, high = self.temperature_range

        def misfit(unknowns, inputs):
            fluid, p, value, scale, _ = inputs
            state = fluid.state(*jnp.exp(unknowns))
            # Both rows are pure numbers of order one, and the logarithms keep T and rho above zero.
            return jnp.stack([jnp.log(state.p / p), (caloric(state) - value) / scale])

        def solve(inputs):
            def newton(_, unknowns):
                value, jacobian = value_with_slopes(misfit, unknowns, inputs)
                # a fifth in the logarithms at most: T and rho stay within what the terms can take
                step = clip(jnp.linalg.solve(jacobian, value), -0.2, 0.2)
                T, rho = unknowns - jnp.where(jnp.isfinite(step), step, 0.0)
                return jnp.stack([clip(T, jnp.log(low), jnp.log(2 * high)), rho])

            return lax.fori_loop(0, 40, newton, inputs[-1])

        # the perfect gas's isentrope is near enough to start from
        ratio = p / start.p
        exponent = clip((start.kappa - 1) / start.kappa, 0.0, 0.4)
        T = clip(start.T * ratio**exponent, low, high)
        guess = jnp.log(jnp.stack([T, start.rho * ratio * start.T / T]))
        # The root depends neither on the scale of a row nor on where it was sought from.
        inputs = (self, p, value, lax.stop_gradient(start.c_v), lax.stop_gradient(guess))
        return self.state(*jnp.exp(root(SmallSystem(misfit, solve, inputs))))


class SmallSystem(AbstractRoot):
    """A small system of equations of inputs, and how its root is found."""

    misfit: Callable = eqx.field(static=True)
    find: Callable = eqx.field(static=True)
    inputs: Any

    def solve(self):
        return self.find(self.inputs)

    def residual(self, unknowns):
        return self.misfit(unknowns, self.inputs)

    def newton_correction(self, unknowns, residual):
        if unknowns.ndim == 0:
            return super().newton_correction(unknowns, residual)
        return -jnp.linalg.solve(jax.jacfwd(self.residual)(unknowns), residual)
