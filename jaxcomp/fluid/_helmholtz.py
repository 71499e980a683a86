r"""The Helmholtz energy of real gases and its derivatives, and the data of the fluids.

$$\frac{a}{RT} = a^0(\tau,\delta) + a^r(\tau,\delta),\quad \tau = T_r/T,\ \delta = \rho/\rho_r$$

Every residual term but the non-analytic ones of carbon dioxide is $x = n\exp(t\ln\tau + d\ln\delta +
f(\delta) + g(\tau))$. With the logarithmic slopes $q = d + \delta f'$ and $r = t + \tau g'$ its
derivatives are $\delta x_\delta = xq$, $\delta^2 x_{\delta\delta} = x(q^2 - q + \delta q')$,
$\delta\tau x_{\delta\tau} = xqr$ and so on: sums over the same exponentials. Higher derivatives are
those of these sums. Coefficients: `data/`, each file with its source.
"""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import maximum
from .._core.words import nearest

# What an unknown name is answered with; all are too many for a sentence.
_USUAL = ("R134a", "R22", "R290", "R32", "R410A", "R600a", "R717", "R744", "air", "nitrogen")


class Saturation(NamedTuple):
    """Liquid and vapour in equilibrium.

    Attributes:
        T: [K] of both; of a pseudo-pure fluid the temperature on the dew and the bubble line.
        p: [Pa] of the vapour, on the dew line.
        liquid: [kg/m^3] density on the bubble line.
        vapour: [kg/m^3] density on the dew line.
        T_bubble: [K] at which liquid boils at `p`: below `T` by the glide of a pseudo-pure fluid.
    """

    T: Float[Array, ""]
    p: Float[Array, ""]
    liquid: Float[Array, ""]
    vapour: Float[Array, ""]
    T_bubble: Float[Array, ""]


def fluids() -> list[str]:
    """Names of the fluids in the library."""
    entries = files(__package__).joinpath("data").iterdir()
    names = []
    for entry in entries:
        if entry.name.endswith(".json"):
            names.append(entry.name.removesuffix(".json"))
    return sorted(names)


@cache
def fluid_data(name: str) -> dict:
    """The data file of a fluid; rows of numbers as arrays.

    Raises:
        BadInput: an unknown name, with those that are known.
    """
    path = files(__package__).joinpath("data", f"{name}.json")
    if not path.is_file():
        raise BadInput("name", f'"{name}"', _known_names(name))
    return arrays(json.loads(path.read_text()))


def _known_names(name: str) -> str:
    """The fluids as the bound of a name, with the one that is near by its name or its chemical name."""
    blends = files(__package__).joinpath("data", "mixtures", "blends.json")
    spellings = {blend.lower(): blend for blend in json.loads(blends.read_text())}
    for fluid in fluids():
        spellings[fluid.lower()] = fluid
    for fluid in fluids():
        spellings[fluid_data(fluid)["description"]] = fluid
    further = f"{len(fluids()) - len(_USUAL)} others, which `jaxcomp list fluids` names, or a blend"
    bound = f"one of {', '.join(_USUAL)}, {further}"
    if near := nearest(name.lower(), spellings):
        bound += f' (did you mean "{spellings[near]}"?)'
    return bound


def arrays(tree: Any) -> Any:
    """A tree of a data file with its lists of numbers as arrays."""
    if isinstance(tree, dict):
        return {key: arrays(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return np.array(tree, float)
    return tree


@cache
def transport_tables(name: str) -> np.ndarray:
    """(2, rows, columns) for `polynomials`: viscosity [Pa s] and conductivity [W/(m K)]."""
    fit = fluid_data(name)["transport"]
    return np.stack([fit["viscosity"], fit["conductivity"]])


@cache
def saturation_curve(name: str, line: str = "dew") -> tuple[np.ndarray, np.ndarray]:
    """[K] and logarithms of [Pa] along the dew or bubble line; straight between them it errs by 1 mK."""
    data = fluid_data(name)
    curve = data[f"{line}_pressure"]
    # Even in 1/T, over which the logarithm of the pressure is nearly straight.
    T = 1 / np.linspace(1 / data["T_least"], 1 / data["T_critical"], 400)
    return T, np.log(ancillary_pressure(curve, T))


def ancillary_pressure(curve: dict, T) -> np.ndarray:
    """[Pa] of an ancillary curve at known temperatures [K], at most its critical one."""
    theta = np.maximum(1 - np.asarray(T) / curve["T_r"], 0.0)[..., None]
    total = np.sum(curve["n"] * theta ** curve["t"], axis=-1)
    if curve["form"] == "sum":
        return curve["reducing_value"] * (1 + total)
    ratio = 1.0
    if curve["form"] == "exponential of tau":
        ratio = curve["T_r"] / T
    return curve["reducing_value"] * np.exp(ratio * total)


def polynomials(tables: np.ndarray, x, y):
    """Values of polynomials in two variables.

    Args:
        tables: (k, rows, columns) coefficients of x to the power of the row and y to that of the column.
        x, y: of one shape.

    Returns:
        (k, *shape)
    """
    # along y for all rows at once: a program is the smaller, and each step is one of a short row
    shape = tables.shape[:2] + (1,) * jnp.ndim(y)
    columns = [tables[..., power].reshape(shape) for power in range(tables.shape[2])]
    rows = columns[-1]
    for column in columns[-2::-1]:
        rows = rows * y + column
    total = rows[:, -1]
    for power in range(tables.shape[1] - 2, -1, -1):
        total = total * x + rows[:, power]
    return total


def ancillary(curve: dict, T):
    # At the critical point theta to a power below one would have an infinite slope.
    theta = maximum(1 - T / curve["T_r"], 1e-9)
    total = jnp.sum(curve["n"] * theta ** curve["t"])
    if curve["form"] == "sum":
        return curve["reducing_value"] * (1 + total)
    ratio = 1.0
    if curve["form"] == "exponential of tau":
        ratio = curve["T_r"] / T
    return curve["reducing_value"] * jnp.exp(ratio * total)


class Weighted(NamedTuple):
    """Rows of terms whose first column is multiplied by weights, as in a mixture."""

    table: np.ndarray
    weights: Float[Array, " rows"]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.table.size


def _columns(rows: np.ndarray | Weighted, like) -> list:
    """Columns of a table, one entry a term along a new first axis."""
    table = rows.table if isinstance(rows, Weighted) else rows
    columns = [c.reshape((-1,) + (1,) * jnp.ndim(like)) for c in table.T]
    if isinstance(rows, Weighted):
        columns[0] = columns[0] * rows.weights.reshape(columns[0].shape)
    return columns


def ideal_terms(ideal: Mapping[str, Any], tau, delta):
    """a0, tau a0_tau, tau^2 a0_tautau."""
    a1, a2 = ideal["lead"]
    c = ideal["log"]
    log = jnp.log(tau)
    value = jnp.log(delta) + a1 + a2 * tau + c * log
    first = a2 * tau + c
    second = -c
    if ideal["power"].size:
        n, t = _columns(ideal["power"], tau)
        x = n * jnp.exp(t * log)
        value = value + jnp.sum(x, 0)
        first = first + jnp.sum(t * x, 0)
        second = second + jnp.sum(t * (t - 1) * x, 0)
    if ideal["planck"].size:
        n, c, d, theta = _columns(ideal["planck"], tau)
        e = d * jnp.exp(theta * tau)
        denominator = c + e
        value = value + jnp.sum(n * jnp.log(denominator), 0)
        first = first + jnp.sum(n * theta * tau * e / denominator, 0)
        second = second + jnp.sum(n * c * (theta * tau) ** 2 * e / denominator**2, 0)
    return value, first, second


def residual_terms(residual: Mapping[str, np.ndarray | Weighted], tau, delta):
    """ar, d ar_d, d^2 ar_dd, t ar_t, t^2 ar_tt, d t ar_dt, with d and t for delta and tau."""
    log_tau = jnp.log(tau)
    log_delta = jnp.log(delta)
    total = []
    for family, rows_of_family in residual.items():
        columns = _columns(rows_of_family, tau)
        if family == "non_analytic":
            total.append(_non_analytic(columns, tau, delta))
            continue
        n, t, d = columns[:3]
        if family == "exponential":
            # exp(-g delta^l - tau^m), with l and m that need not be whole; m = 0 marks terms without tau
            power, g, m = columns[3:6]
            x = g * jnp.exp(power * log_delta)
            y = jnp.where(m > 0, jnp.exp(m * log_tau), 0.0)
            q = d - power * x
            q_1 = -(power**2) * x
            r = t - m * y
            r_1 = -(m**2) * y
            exponent = -x - y
        elif family == "power":
            # delta^l of the few whole numbers l that occur, without an exponential; l = 0 marks terms
            # that have no exp(-delta^l)
            powers, place = np.unique(columns[3].ravel().astype(int), return_inverse=True)
            x = _whole_powers(delta, powers)[place]
            power = columns[3]
            q = d - power * x
            q_1 = -power * power * x
            r = t
            r_1 = 0.0
            exponent = -x
        else:
            eta, epsilon, beta, gamma = columns[3:7]
            off = delta - epsilon
            far = tau - gamma
            if family == "gao":
                # the published eta is negative here and stands without a minus sign
                base = columns[7] + beta * far**2
                q = d + 2 * eta * delta * off
                q_1 = 2 * eta * delta * (2 * delta - epsilon)
                g_1 = -2 * beta * far / base**2
                g_2 = 8 * beta**2 * far**2 / base**3 - 2 * beta / base**2
                exponent = eta * off**2 + 1 / base
            else:
                q = d - 2 * eta * delta * off
                q_1 = -2 * eta * delta * (2 * delta - epsilon)
                g_1 = -2 * beta * far
                g_2 = -2 * beta
                exponent = -eta * off**2 - beta * far**2
            r = t + tau * g_1
            r_1 = tau * g_1 + tau**2 * g_2
        # Each term is exp(f): with q = delta f_delta and q_1 = delta q_delta the derivatives times
        # powers of delta are x q and x (q (q - 1) + q_1), and so r along tau.
        x = n * jnp.exp(t * log_tau + d * log_delta + exponent)
        rows = (x, x * q, x * (q * (q - 1) + q_1), x * r, x * (r * (r - 1) + r_1), x * q * r)
        total.append([jnp.sum(row, 0) for row in rows])
    return [sum(rows) for rows in zip(*total, strict=True)]


def _whole_powers(delta, powers):
    """(powers, *delta) delta^l of whole numbers l; zero, and not one, where l is zero."""
    rows = []
    for l in powers:
        if l:
            rows.append(delta ** int(l))
        else:
            rows.append(0 * delta)
    return jnp.stack(rows)


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
        direction = [jnp.zeros_like(tau), jnp.zeros_like(tau)]
        direction[which] = jnp.ones_like(tau)
        return lambda tau, delta: jax.jvp(f, (tau, delta), tuple(direction))[1]

    f_t = along(term, 0)
    f_d = along(term, 1)
    return [
        term(tau, delta),
        delta * f_d(tau, delta),
        delta**2 * along(f_d, 1)(tau, delta),
        tau * f_t(tau, delta),
        tau**2 * along(f_t, 0)(tau, delta),
        delta * tau * along(f_d, 0)(tau, delta),
    ]
