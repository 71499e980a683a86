"""A fluid by its published equation of state."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import clip, minimum
from .._core.fields import Bound, is_traced
from .._core.roots import root
from ._blends import blends
from ._fluid import SmallSystem, compiled, value_with_slopes
from ._helmholtz import (
    Saturation,
    ancillary,
    fluid_data,
    fluids,
    ideal_terms,
    polynomials,
    residual_terms,
    saturation_curve,
    transport_tables,
)
from ._real import NEAR_SATURATION, AbstractRealGas, state_of_terms, tools_for
from .mixture import Mixture


class RealGas(AbstractRealGas):
    """A fluid by its published equation of state.

    Args:
        name: one of `fluids()`, such as "R134a".

    Raises:
        BadInput: an unknown name, with those that are known.
    """

    kind: ClassVar[str] = "real_gas"

    name: str = eqx.field(static=True)

    def __check_init__(self):
        if self.name not in fluids() and self.name in blends():
            bound = f'a pure fluid; that is a blend, `Mixture(name="{self.name}")`'
            raise BadInput("name", f'"{self.name}"', bound)
        fluid_data(self.name)

    @classmethod
    def of_entries(cls, **entries):
        """The fluid that a section of a file names, which may be a blend of ASHRAE 34."""
        if entries.keys() == {"name"}:
            return fluid_named(**entries)
        return cls(**entries)

    @property
    def data(self) -> dict:
        """Coefficients and their source."""
        return fluid_data(self.name)

    @property
    def specific_gas_constant(self):
        return jnp.asarray(self.data["gas_constant"])

    @property
    def temperature_range(self):
        return self.data["T_least"], self.data["T_most"]

    @property
    def highest_pressure(self):
        return self.data["p_most"]

    @property
    def condenses(self) -> bool:
        return True

    @property
    def lowest_temperature(self) -> float:
        return self.data["T_least"]

    @property
    def critical_temperature(self) -> float:
        """[K]"""
        return self.data["T_critical"]

    @property
    def critical_pressure(self) -> float:
        """[Pa]"""
        return float(self.dew_pressure(self.critical_temperature))

    @property
    def has_glide(self) -> bool:
        return self.data["pseudo_pure"]

    @property
    def _bubble_line(self) -> str:
        """Name of the curve on which liquid boils: a pure fluid has but one."""
        return "bubble" if self.has_glide else "dew"

    def dew_temperature(self, p):
        """[K] Dew temperature at pressures [Pa] by the ancillary curve, to about 0.1 K.

        Beyond the curve that of its end: the critical temperature, or the lowest of the fluid.
        Known pressures give numbers of NumPy, for checks that shall compile nothing.
        """
        return self._temperature(p, "dew")

    def dew_pressure(self, T):
        return self._pressure(T, "dew")

    def bubble_temperature(self, p):
        return self._temperature(p, self._bubble_line)

    def bubble_pressure(self, T):
        return self._pressure(T, self._bubble_line)

    def _pressure(self, T, line: str):
        tools = tools_for(T)
        return tools.exp(tools.interp(T, *saturation_curve(self.name, line)))

    def _temperature(self, p, line: str):
        tools = tools_for(p)
        T, log_p = saturation_curve(self.name, line)
        return tools.interp(tools.log(p), log_p, T)

    def bubble_of_dew(self, T: Float[Array, "*n"]) -> Float[Array, "*n"]:
        if not self.has_glide:
            return T
        return jnp.vectorize(lambda T: self._saturation(T, None).T_bubble)(jnp.asarray(T))

    def dew_of_evaporator(self, T, h):
        del h
        if self.has_glide:
            bound = f'"dew"; or fluid = {{ type = "mixture", name = "{self.name}" }}, whose phases differ'
            raise BadInput("reference", '"mean"', bound)
        return T

    def _state(self, T, rho):
        data = self.data
        R = data["gas_constant"]
        tau = data["T_r"] / T
        delta = rho / data["rho_r"]
        ideal = ideal_terms(data["ideal"], tau, delta)
        residual = residual_terms(data["residual"], tau, delta)
        return state_of_terms(T, rho, R, ideal, residual)

    def transport(self, T, rho):
        data = self.data
        fit = data["transport"]
        # beyond the range of the fit its values at the end: a polynomial is no guide out there
        x = clip(T, *fit["T"]) / data["T_r"]
        y = clip(rho, 0.0, fit["rho_most"]) / data["rho_r"]
        viscosity, conductivity = polynomials(transport_tables(self.name), x, y)
        return viscosity, conductivity

    def is_wet(self, T, rho):
        data = self.data
        # Above 0.98 of the critical temperature, where the dew line gets vertical, nothing is called
        # wet; 2 % is room for the error of the curve.
        theta = minimum(T, 0.98 * data["T_critical"])
        dew = jnp.vectorize(lambda T: ancillary(data["vapour_density"], T))(theta)
        return (theta == T) & (rho > 1.02 * dew)

    def density(self, T, p):
        """Density [kg/m^3] of the gas at a temperature `T` [K] and a pressure `p` [Pa].

        Raises:
            BadInput: a temperature out of the fluid's range, or a pressure at which it is liquid. Within
                `jit` the result is then near the limit of the metastable gas.
        """
        if not is_traced(T) and not is_traced(p):
            self._require("T", T, Bound(*self.temperature_range), "K, the range of")
            highest = self.data["p_most"]
            if np.all(np.less(T, self.critical_temperature)):
                # what a pressure in few digits may be above saturation
                highest = float(self.dew_pressure(np.asarray(T) + NEAR_SATURATION))
            self._require("p", p, Bound(0.0, highest, low_open=True), f"Pa at {T:g} K, for gas of")
        return super().density(T, p)

    def boiling_density(self, T):
        return ancillary(self.data["liquid_density"], T)

    def saturation(
        self, T: Float[Array, ""] | None = None, p: Float[Array, ""] | None = None
    ) -> Saturation:
        ends = self.temperature_range[0], self.critical_temperature
        if T is None and not is_traced(p):
            low = float(self.dew_pressure(ends[0]))
            high = float(self.dew_pressure(ends[1]))
            self._require("p", p, Bound(low, high, high_open=True), "Pa, of liquid and vapour of")
        elif T is not None and not is_traced(T):
            self._require("T", T, Bound(*ends, high_open=True), "K, of liquid and vapour of")
        return self._saturation(T, p)

    @compiled
    def _saturation(self, T, p) -> Saturation:
        """Liquid and vapour in equilibrium.

        A pure fluid's ancillary curves are polished by Newton's method until pressure and Gibbs
        energy of both phases agree. A pseudo-pure fluid has no such equilibrium: its dew and bubble
        pressures are those of the ancillary curves, and the densities fit them.
        """
        data = self.data
        log_input = jnp.log(jnp.asarray(p if T is None else T))

        def misfit(unknowns, log_input):
            T, liquid, vapour = jnp.exp(unknowns)
            liquid = self.state(T, liquid)
            vapour = self.state(T, vapour)
            if data["pseudo_pure"]:
                dew = ancillary(data["dew_pressure"], T)
                bubble = ancillary(data["bubble_pressure"], T)
                balance = [liquid.p / bubble - 1, vapour.p / dew - 1]
            else:
                dew = vapour.p
                gibbs = liquid.h - T * liquid.s - vapour.h + T * vapour.s
                # Energies over the vapour's p/rho, so that all rows are relative.
                balance = [(liquid.p - vapour.p) / dew, gibbs * vapour.rho / dew]
            # the pressure or the temperature that is given closes the system
            closing = unknowns[0] if p is None else jnp.log(dew)
            return jnp.stack([*balance, closing - log_input])

        def solve(log_input):
            curve = data["dew_pressure"]
            # short of the critical point, where both phases are one and the Jacobian is singular
            low = np.log(data["T_least"])
            high = np.log(0.9999 * data["T_critical"])

            def rough(_, x):
                def value(x):
                    return jnp.log(ancillary(curve, jnp.exp(x))) - log_input

                misfit, slope = jax.value_and_grad(value)(x)
                return clip(x - misfit / slope, low, high)

            log_T = log_input
            if p is not None:
                log_T = lax.fori_loop(0, 12, rough, high - 0.25 + 0 * log_input)
            keys = ("liquid_density", "vapour_density")
            guess = [jnp.log(ancillary(data[key], jnp.exp(log_T))) for key in keys]

            def newton(_, unknowns):
                value, jacobian = value_with_slopes(misfit, unknowns, log_input)
                step = jnp.linalg.solve(jacobian, value)
                return unknowns - clip(jnp.nan_to_num(step), -0.1, 0.1)

            return lax.fori_loop(0, 12, newton, jnp.stack([log_T, *guess]))

        T, liquid, vapour = jnp.exp(root(SmallSystem(misfit, solve, log_input)))
        pressure = self.state(T, vapour).p
        boiling = T
        if data["pseudo_pure"]:
            boiling = self._bubble_point(pressure, T)
        return Saturation(T, pressure, liquid, vapour, boiling)

    def _bubble_point(self, p, T):
        """[K] Bubble temperature of a pseudo-pure fluid at a pressure [Pa], sought from its dew point."""
        curve = self.data["bubble_pressure"]
        ends = self.data["T_least"], 0.9999 * self.data["T_critical"]

        def misfit(log_T, log_p):
            return jnp.log(ancillary(curve, jnp.exp(log_T))) - log_p

        def solve(inputs):
            log_p, start = inputs

            def newton(_, log_T):
                excess, slope = jax.value_and_grad(misfit)(log_T, log_p)
                return clip(log_T - excess / slope, *np.log(ends))

            return lax.fori_loop(0, 8, newton, start)

        # the root does not depend on where it was sought from
        inputs = jnp.log(p), lax.stop_gradient(jnp.log(T))
        return jnp.exp(root(SmallSystem(lambda x, inputs: misfit(x, inputs[0]), solve, inputs)))


def fluid_named(name: str) -> AbstractRealGas:
    """A pure fluid, a pseudo-pure one, or a blend of ASHRAE 34.

    Raises:
        BadInput: an unknown name, or a blend with a pair without parameters.
    """
    if name not in fluids() and name in blends():
        return Mixture(name=name)
    return RealGas(name)
