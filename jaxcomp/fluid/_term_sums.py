r"""Sums over the terms of a mixture, with derivatives of any order from one set of exponentials.

Nearly every term is $x = c\,e^{\phi(v)}\,e^{\psi(u)}$ with $u = \ln\tau$ and $v = \ln\delta$. With the
slopes $\phi', \phi'', \dots$ its derivatives over $v$ are $x$ times
$Q_{k+1} = \sum_m \binom{k}{m}\phi^{(m+1)} Q_{k-m}$, $Q_0 = 1$, and those over $u$ are $x R_j$ likewise.
Therefore

$$S_{ij} = \sum x\, Q_i R_j$$

are all derivatives of the energy, and $\partial S_{ij}/\partial v = S_{i+1,j}$: a program that wants a
Jacobian takes one order more of the same sums, and the exponentials are not differentiated again.
Terms with the same exponents, of which GERG-2008 has many, are one term with the sum of their
coefficients.
"""

from collections.abc import Mapping
from functools import partial
from math import comb
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from numpy.typing import NDArray

# Families of rows whose terms have no such factors; `_helmholtz` sums them.
_INSEPARABLE = ("gao", "non_analytic")


class _Exponents(NamedTuple):
    """Exponents of terms, of which most have but a few.

    A term is tau^t delta^d exp(-g delta^l - b tau^m - eta (delta - epsilon)^2 - beta (tau - gamma)^2).
    """

    t: float | NDArray
    d: float | NDArray
    g: float | NDArray = 0.0
    power: float | NDArray = 0.0  # l
    b: float | NDArray = 0.0
    m: float | NDArray = 0.0
    eta: float | NDArray = 0.0
    epsilon: float | NDArray = 0.0
    beta: float | NDArray = 0.0
    gamma: float | NDArray = 0.0


class TermTable:
    """Terms of a mixture, and what their coefficients are made of.

    Attributes:
        exponents: (terms,) each.
        mixing: (terms, groups) from the weights of components and pairs to the coefficients.
        first, second: (groups,) components of each weight; one behind the last where there is no pair.
        inseparable: families of rows that are summed elsewhere.
    """

    def __init__(self, tables: Mapping[str, NDArray], weights: Mapping):
        groups: dict[tuple[int, int], int] = {}
        terms: dict[_Exponents, dict[int, float]] = {}
        for family, rows in tables.items():
            if family in _INSEPARABLE:
                continue
            for row, first, second, factor in zip(rows, *weights[family], strict=True):
                group = groups.setdefault((int(first), int(second)), len(groups))
                shares = terms.setdefault(_exponents_of(family, row), {})
                shares[group] = shares.get(group, 0.0) + float(factor * row[0])
        self.inseparable = tuple(family for family in tables if family in _INSEPARABLE)
        self.first, self.second = np.array(list(groups), int).reshape(-1, 2).T
        self.exponents = _Exponents(*np.array(list(terms), float).T)
        self.mixing = np.zeros((len(terms), len(groups)))
        for place, shares in enumerate(terms.values()):
            self.mixing[place, list(shares)] = list(shares.values())

    @property
    def size(self) -> int:
        """Number of terms."""
        return len(self.mixing)

    def coefficients(self, x):
        """(terms,) at mole fractions (n,)."""
        padded = jnp.concatenate([x, jnp.ones_like(x[:1])])
        return self.mixing @ (padded[self.first] * padded[self.second])

    def residual(self, tau, delta, coefficients) -> list:
        """Sums as `_helmholtz.residual_terms` gives them."""
        log_tau, log_delta = jnp.broadcast_arrays(jnp.log(tau), jnp.log(delta))
        sums = _sums(self.exponents, 2, log_tau, log_delta, coefficients)
        along = dict(zip(_orders(2), sums, strict=True))
        return [
            along[0, 0],
            along[1, 0],
            along[2, 0] - along[1, 0],
            along[0, 1],
            along[0, 2] - along[0, 1],
            along[1, 1],
        ]


def _exponents_of(family: str, row: NDArray) -> _Exponents:
    """Exponents of a row, without its coefficient."""
    if family == "gaussian":
        t, d, eta, epsilon, beta, gamma = row[1:]
        return _Exponents(t=t, d=d, eta=eta, epsilon=epsilon, beta=beta, gamma=gamma)
    if family == "power":
        t, d, power = row[1:]
        # l = 0 marks terms that have no exp(-delta^l)
        return _Exponents(t=t, d=d, g=float(power > 0), power=power)
    t, d, power, g, m = row[1:]
    # m = 0 marks terms without tau in the exponent
    return _Exponents(t=t, d=d, g=g, power=power, b=float(m > 0), m=m)


def _orders(order: int) -> list[tuple[int, int]]:
    """Orders of the derivatives over ln(delta) and ln(tau), up to a total."""
    orders = []
    for i in range(order + 1):
        for j in range(order + 1 - i):
            orders.append((i, j))
    return orders


def _slopes(linear, bent: tuple, bell: tuple, x, order: int) -> tuple:
    """A function of x and its slopes up to an order.

    Args:
        linear: a of `a x - b exp(c x) - d (exp(x) - e)^2`
        bent: b and c.
        bell: d and e.
        x: of any shape.
        order: of the last slope.
    """
    value = linear * x
    # zeros of NumPy: what they are added to is a number of the table, and nothing is computed
    slopes = [linear] + [np.zeros_like(linear)] * (order - 1)
    factor, rate = bent
    if np.any(factor):
        # of the few rates that occur, as exponentials take most of the time at a single point
        rates, place = np.unique(rate, return_inverse=True)
        part = factor * jnp.exp(rates.reshape((-1,) + (1,) * x.ndim) * x)[place.ravel()]
        value = value - part
        for k, slope in enumerate(slopes):
            slopes[k] = slope - rate ** (k + 1) * part
    width, centre = bell
    if np.any(width):
        e = jnp.exp(x)
        value = value - width * (e - centre) ** 2
        for k, slope in enumerate(slopes):
            slopes[k] = slope - 2 * width * e * (2**k * e - centre)
    return value, slopes


def _over_itself(slopes) -> list:
    """Derivatives of exp(f) over exp(f) itself, from the slopes of f."""
    ratios = [1.0]
    for k in range(len(slopes)):
        ratio = 0
        for m in range(k + 1):
            ratio = ratio + comb(k, m) * slopes[m] * ratios[k - m]
        ratios.append(ratio)
    return ratios


def _plain_sums(exponents, order: int, log_tau, log_delta, coefficients) -> tuple:
    """Sums S_ij in the order of `_orders`."""
    shape = (-1,) + (1,) * log_tau.ndim
    column = _Exponents(*(values.reshape(shape) for values in exponents))
    along_delta, delta_slopes = _slopes(
        column.d, (column.g, column.power), (column.eta, column.epsilon), log_delta, order
    )
    along_tau, tau_slopes = _slopes(
        column.t, (column.b, column.m), (column.beta, column.gamma), log_tau, order
    )
    by_delta = _over_itself(delta_slopes)
    by_tau = _over_itself(tau_slopes)
    e = jnp.exp(along_delta + along_tau)
    # Mapped over points, products with one vector take half the time of as many sums.
    sums = []
    for i, j in _orders(order):
        sums.append(jnp.tensordot(coefficients, e * (by_delta[i] * by_tau[j]), 1))
    return tuple(sums)


_sums = jax.custom_jvp(_plain_sums, nondiff_argnums=(0, 1))


@partial(_sums.defjvp, symbolic_zeros=True)
def _sums_jvp(exponents, order: int, primals, tangents):
    log_tau, log_delta, coefficients = primals
    tau_step, delta_step, coefficient_step = tangents
    sums = _sums(exponents, order + 1, log_tau, log_delta, coefficients)
    along = dict(zip(_orders(order + 1), sums, strict=True))
    steps = []
    for i, j in _orders(order):
        # a sum that nothing moves has a zero of its own, as a rule must return arrays
        parts = [jnp.zeros_like(log_tau)]
        if not isinstance(delta_step, SymbolicZero):
            parts.append(along[i + 1, j] * delta_step)
        if not isinstance(tau_step, SymbolicZero):
            parts.append(along[i, j + 1] * tau_step)
        steps.append(sum(parts[1:], parts[0]))
    if not isinstance(coefficient_step, SymbolicZero):
        # the sums are linear in the coefficients
        moved = _plain_sums(exponents, order, log_tau, log_delta, coefficient_step)
        steps = [step + part for step, part in zip(steps, moved, strict=True)]
    return tuple(along[orders] for orders in _orders(order)), tuple(steps)
