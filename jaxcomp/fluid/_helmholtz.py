r"""Real gases by their Helmholtz energy.

$$\frac{a}{RT} = a^0(\tau,\delta) + a^r(\tau,\delta),\quad \tau = T_r/T,\ \delta = \rho/\rho_r$$

Every residual term but the non-analytic ones of carbon dioxide is $x = n\exp(t\ln\tau + d\ln\delta +
f(\delta) + g(\tau))$. With the logarithmic slopes $q = d + \delta f'$ and $r = t + \tau g'$ its
derivatives are $\delta x_\delta = xq$, $\delta^2 x_{\delta\delta} = x(q^2 - q + \delta q')$,
$\delta\tau x_{\delta\tau} = xqr$ and so on: sums over the same exponentials. Higher derivatives are
those of these sums. Coefficients: `data/`, each file with its source.
"""

import json
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import Bound, is_traced
from .._core.roots import root
from .._core.words import nearest
from ._base import AbstractFluid, GasState, SmallSystem

_NEAR = 0.5  # [K] by which gas may be colder than saturation, for pressures that are given in few digits


class Saturation(NamedTuple):
    """Liquid and vapour in equilibrium.

    Attributes:
        T: [K] of both; of a pseudo-pure fluid the temperature on the dew and the bubble line.
        p: [Pa] of the vapour, on the dew line.
        liquid: [kg/m^3] density on the bubble line.
        vapour: [kg/m^3] density on the dew line.
    """

    T: Float[Array, ""]
    p: Float[Array, ""]
    liquid: Float[Array, ""]
    vapour: Float[Array, ""]


def fluids() -> list[str]:
    """Names of the fluids in the library."""
    return sorted(f.name[:-5] for f in files(__package__).joinpath("data").iterdir())


@cache
def fluid_data(name: str) -> dict:
    """The data file of a fluid; rows of numbers as arrays.

    Raises:
        BadInput: an unknown name, with those that are known.
    """
    path = files(__package__).joinpath("data", f"{name}.json")
    if not path.is_file():
        raise BadInput("name", f'"{name}"', _known(name))
    return _arrays(json.loads(path.read_text()))


def _known(name: str) -> str:
    """The fluids as the bound of a name, with the one that is near by its name or its chemical name."""
    spelt = {fluid.lower(): fluid for fluid in fluids()}
    spelt |= {fluid_data(fluid)["description"]: fluid for fluid in fluids()}
    near = spelt.get(nearest(name.lower(), spelt) or "")
    return f"one of {', '.join(fluids())}" + (f' (did you mean "{near}"?)' if near else "")


def _arrays(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _arrays(value) for key, value in tree.items()}
    return np.array(tree, float) if isinstance(tree, list) else tree


class RealGas(AbstractFluid):
    """A fluid by its published equation of state.

    Args:
        name: one of `fluids()`, such as "R134a".

    Raises:
        BadInput: an unknown name, with those that are known.
    """

    kind: ClassVar[str] = "real_gas"

    name: str = eqx.field(static=True)

    def __check_init__(self):
        fluid_data(self.name)

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
    def critical_temperature(self) -> float:
        """[K]"""
        return self.data["T_critical"]

    def dew_temperature(self, p):
        """[K] Dew temperature at pressures [Pa] by the ancillary curve, to about 0.1 K.

        Beyond the curve that of its end: the critical temperature, or the lowest of the fluid.
        Known pressures give numbers of NumPy, for checks that shall compile nothing.
        """
        tools = jnp if is_traced(p) else np
        T, log_p = _dew_curve(self.name)
        return tools.interp(tools.log(p), log_p, T)

    def dew_pressure(self, T):
        """[Pa] The inverse of `dew_temperature`."""
        tools = jnp if is_traced(T) else np
        return tools.exp(tools.interp(T, *_dew_curve(self.name)))

    def state(self, T, rho):
        data = self.data
        R, tau, delta = data["gas_constant"], data["T_r"] / T, rho / data["rho_r"]
        a0, a0_t, a0_tt = _ideal(data["ideal"], tau, delta)
        ar, ar_d, ar_dd, ar_t, ar_tt, ar_dt = _residual(data["residual"], tau, delta)
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

    def transport(self, T, rho):
        data = self.data
        fit = data["transport"]
        # beyond the range of the fit its values at the end: a polynomial is no guide out there
        x = jnp.clip(T, *fit["T"]) / data["T_r"]
        y = jnp.clip(rho, 0.0, fit["rho_most"]) / data["rho_r"]
        return _poly(fit["viscosity"], x, y), _poly(fit["conductivity"], x, y)

    def is_wet(self, T, rho):
        data = self.data
        # Above 0.98 of the critical temperature, where the dew line gets vertical, nothing is called
        # wet; 2 % is room for the error of the curve.
        theta = jnp.minimum(T, 0.98 * data["T_critical"])
        dew = jnp.vectorize(lambda T: _ancillary(data["vapour_density"], T))(theta)
        return (theta == T) & (rho > 1.02 * dew)

    def density(self, T, p):
        """Density [kg/m^3] of the gas at a temperature `T` [K] and a pressure `p` [Pa].

        Raises:
            BadInput: a temperature out of the fluid's range, or a pressure at which it is liquid. Within
                `jit` the result is then near the limit of the metastable gas.
        """
        if not is_traced(T) and not is_traced(p):
            self._require("T", T, Bound(*self.temperature_range), "K, the range of")
            most = self.data["p_most"]
            if np.all(np.less(T, self.critical_temperature)):
                # what a pressure in few digits may be above saturation
                most = float(self.dew_pressure(np.asarray(T) + _NEAR))
            self._require("p", p, Bound(0.0, most, low_open=True), f"Pa at {T:g} K, for gas of")
        return super().density(T, p)

    def _require(self, name: str, value, bound: Bound, why: str) -> None:
        if not np.all(bound.inside(np.asarray(value))):
            raise BadInput(name, value, f"{bound} {why} {self.name}")

    def saturation(
        self, T: Float[Array, ""] | None = None, p: Float[Array, ""] | None = None
    ) -> Saturation:
        """Saturation at a temperature `T` [K] or at a pressure `p` [Pa] below the critical one.

        Raises:
            BadInput: one that is not between triple and critical point; within `jit` it is not seen.
        """
        ends = self.temperature_range[0], self.critical_temperature
        if T is None and not is_traced(p):
            low, high = (float(self.dew_pressure(end)) for end in ends)
            self._require("p", p, Bound(low, high, high_open=True), "Pa, of liquid and vapour of")
        elif T is not None and not is_traced(T):
            self._require("T", T, Bound(*ends, high_open=True), "K, of liquid and vapour of")
        return self._saturation(T, p)

    @eqx.filter_jit
    def _saturation(self, T, p) -> Saturation:
        """Liquid and vapour in equilibrium.

        A pure fluid's ancillary curves are polished by Newton's method until pressure and Gibbs
        energy of both phases agree. A pseudo-pure fluid has no such equilibrium: its dew and bubble
        pressures are those of the ancillary curves, and the densities fit them.
        """
        data = self.data
        given = jnp.log(jnp.asarray(p if T is None else T))

        def misfit(unknowns, given):
            T, liquid, vapour = jnp.exp(unknowns)
            liquid, vapour = self.state(T, liquid), self.state(T, vapour)
            if data["pseudo_pure"]:
                dew = _ancillary(data["dew_pressure"], T)
                bubble = _ancillary(data["bubble_pressure"], T)
                balance = [liquid.p / bubble - 1, vapour.p / dew - 1]
            else:
                dew = vapour.p
                gibbs = liquid.h - T * liquid.s - vapour.h + T * vapour.s
                # Energies over the vapour's p/rho, so that all rows are relative.
                balance = [(liquid.p - vapour.p) / dew, gibbs * vapour.rho / dew]
            last = jnp.log(dew) - given if p is not None else unknowns[0] - given
            return jnp.stack([*balance, last])

        def solve(given):
            curve = data["dew_pressure"]
            low, high = np.log(data["T_least"]), np.log(0.9999 * data["T_critical"])

            def rough(_, x):
                def value(x):
                    return jnp.log(_ancillary(curve, jnp.exp(x))) - given

                misfit, slope = jax.value_and_grad(value)(x)
                return jnp.clip(x - misfit / slope, low, high)

            log_T = given
            if p is not None:
                log_T = lax.fori_loop(0, 12, rough, high - 0.25 + 0 * given)
            keys = ("liquid_density", "vapour_density")
            guess = [jnp.log(_ancillary(data[key], jnp.exp(log_T))) for key in keys]

            def newton(_, unknowns):
                jacobian = jax.jacfwd(misfit)(unknowns, given)
                step = jnp.linalg.solve(jacobian, misfit(unknowns, given))
                return unknowns - jnp.clip(jnp.nan_to_num(step), -0.1, 0.1)

            return lax.fori_loop(0, 12, newton, jnp.stack([log_T, *guess]))

        T, liquid, vapour = jnp.exp(root(SmallSystem(misfit, solve, given)))
        return Saturation(T, self.state(T, vapour).p, liquid, vapour)


@cache
def _dew_curve(name: str) -> tuple[np.ndarray, np.ndarray]:
    """[K] and logarithms of [Pa] along the dew line; straight between them it errs by 1 mK."""
    data = fluid_data(name)
    curve = data["dew_pressure"]
    # Even in 1/T, over which the logarithm of the pressure is nearly straight.
    T = 1 / np.linspace(1 / data["T_least"], 1 / data["T_critical"], 400)
    theta = np.maximum(1 - T / curve["T_r"], 0.0)[:, None]
    total = np.sum(curve["n"] * theta ** curve["t"], axis=1)
    if curve["form"] == "sum":
        return T, np.log(curve["reducing_value"] * (1 + total))
    ratio = curve["T_r"] / T if curve["form"] == "exponential of tau" else 1.0
    return T, np.log(curve["reducing_value"]) + ratio * total


def _poly(table: np.ndarray, x, y):
    rows = [jnp.polyval(jnp.asarray(row[::-1]), y) for row in table]
    total = rows[-1]
    for row in rows[-2::-1]:
        total = total * x + row
    return total


def _ancillary(curve: dict, T):
    # At the critical point theta to a power below one would have an infinite slope.
    theta = jnp.maximum(1 - T / curve["T_r"], 1e-9)
    total = jnp.sum(curve["n"] * theta ** curve["t"])
    if curve["form"] == "sum":
        return curve["reducing_value"] * (1 + total)
    ratio = curve["T_r"] / T if curve["form"] == "exponential of tau" else 1.0
    return curve["reducing_value"] * jnp.exp(ratio * total)


def _columns(table: np.ndarray, like) -> list:
    """Columns of a table, one entry a term along a new first axis."""
    return [c.reshape((-1,) + (1,) * jnp.ndim(like)) for c in table.T]


def _ideal(ideal: dict, tau, delta):
    """a0, tau a0_tau, tau^2 a0_tautau."""
    (a1, a2), c = ideal["lead"], ideal["log"]
    log = jnp.log(tau)
    value = jnp.log(delta) + a1 + a2 * tau + c * log
    first, second = a2 * tau + c, -c
    if ideal["power"].size:
        n, t = _columns(ideal["power"], tau)
        x = n * jnp.exp(t * log)
        value, first = value + jnp.sum(x, 0), first + jnp.sum(t * x, 0)
        second = second + jnp.sum(t * (t - 1) * x, 0)
    if ideal["planck"].size:
        n, c, d, theta = _columns(ideal["planck"], tau)
        e = d * jnp.exp(theta * tau)
        whole = c + e
        value = value + jnp.sum(n * jnp.log(whole), 0)
        first = first + jnp.sum(n * theta * tau * e / whole, 0)
        second = second + jnp.sum(n * c * (theta * tau) ** 2 * e / whole**2, 0)
    return value, first, second


def _residual(residual: dict, tau, delta):
    """ar, d ar_d, d^2 ar_dd, t ar_t, t^2 ar_tt, d t ar_dt, with d and t for delta and tau."""
    log_tau, log_delta = jnp.log(tau), jnp.log(delta)
    total = []
    for family, table in residual.items():
        columns = _columns(table, tau)
        if family == "non_analytic":
            total.append(_non_analytic(columns, tau, delta))
            continue
        n, t, d = columns[:3]
        if family == "power":
            # delta^l of the few whole numbers l that occur, without an exponential; l = 0 marks terms
            # that have no exp(-delta^l)
            powers, place = np.unique(table[:, 3].astype(int), return_inverse=True)
            x = jnp.stack([delta ** int(l) if l else 0 * delta for l in powers])[place]
            power = columns[3]
            q = d - power * x
            q_1 = -power * power * x
            r, r_1 = t, 0.0
            more = -x
        else:
            eta, epsilon, beta, gamma = columns[3:7]
            off, far = delta - epsilon, tau - gamma
            if family == "gao":
                # the published eta is negative here and stands without a minus sign
                base = columns[7] + beta * far**2
                q, q_1 = d + 2 * eta * delta * off, 2 * eta * delta * (2 * delta - epsilon)
                g_1 = -2 * beta * far / base**2
                g_2 = 8 * beta**2 * far**2 / base**3 - 2 * beta / base**2
                more = eta * off**2 + 1 / base
            else:
                q, q_1 = d - 2 * eta * delta * off, -2 * eta * delta * (2 * delta - epsilon)
                g_1, g_2 = -2 * beta * far, -2 * beta
                more = -eta * off**2 - beta * far**2
            r, r_1 = t + tau * g_1, tau * g_1 + tau**2 * g_2
        x = n * jnp.exp(t * log_tau + d * log_delta + more)
        rows = (x, x * q, x * (q * (q - 1) + q_1), x * r, x * (r * (r - 1) + r_1), x * q * r)
        total.append([jnp.sum(row, 0) for row in rows])
    return [sum(rows) for rows in zip(*total, strict=True)]


def _non_analytic(columns, tau, delta):
    """The terms near the critical point of Span and Wagner (1996), Eq. 6.1, summed."""
    n, a, b, beta, A, B, C, D = columns
    # their second derivatives have no value at the critical density itself
    delta = jnp.where(jnp.abs(delta - 1) < 1e-7, 1 + 1e-7, delta)

    def term(tau, delta):
        off = (delta - 1) ** 2
        theta = 1 - tau + A * off ** (1 / (2 * beta))
        distance = theta**2 + B * off**a
        return jnp.sum(n * distance**b * delta * jnp.exp(-C * off - D * (tau - 1) ** 2), axis=0)

    def along(f, which):
        one = [jnp.zeros_like(tau), jnp.zeros_like(tau)]
        one[which] = jnp.ones_like(tau)
        return lambda tau, delta: jax.jvp(f, (tau, delta), tuple(one))[1]

    f_t, f_d = along(term, 0), along(term, 1)
    return [
        term(tau, delta),
        delta * f_d(tau, delta),
        delta**2 * along(f_d, 1)(tau, delta),
        tau * f_t(tau, delta),
        tau**2 * along(f_t, 0)(tau, delta),
        delta * tau * along(f_d, 0)(tau, delta),
    ]
