r"""Sums over the terms of a mixture, with derivatives of any order from one set of exponentials.

Nearly every term is $x = c\,e^{\phi(v)}\,e^{\psi(u)}$ with $u = \ln\tau$ and $v = \ln\delta$. With the slopes
$\phi', \phi'', \dots$ its derivatives over $v$ are $x$ times
$Q_{k+1} = \sum_m \binom{k}{m}\phi^{(m+1)} Q_{k-m}$, $Q_0 = 1$, and those over $u$ are $x R_j$ likewise, so that

$$S_{ij} = \sum x\, Q_i R_j$$

are all derivatives of the energy, and $\partial S_{ij}/\partial v = S_{i+1,j}$: a program that wants a
Jacobian takes one order more of the same sums, and the exponentials are not differentiated again.
Terms with the same exponents, of which GERG-2008 has many, are one term with the sum of their
coefficients.
"""

from collections.abc import Iterable, Mapping
from functools import partial
from math import comb
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from numpy.typing import NDArray

# Families of rows whose terms have no such factors; `_helmholtz` sums them.
_OTHER_FAMILIES = ("gao", "non_analytic")


class Exponents(NamedTuple):
    """Exponents of the terms of a family.

    Attributes:
        rule: "power", "exponential" with a power of tau in the exponent, or "gaussian".
        columns: (k, terms) t, d, and those of the rule.
    """

    rule: str
    columns: NDArray


class TermTable:
    """Terms of a mixture by family, and what their coefficients are made of.

    Attributes:
        exponents: of each family.
        mixing: (terms, groups) of each family, from the weights of components and pairs to coefficients.
        first, second: (groups,) components of each weight; one behind the last where there is no pair.
        others: families of rows that are summed elsewhere.
    """

    exponents: tuple[Exponents, ...]
    mixing: tuple[NDArray, ...]
    first: NDArray
    second: NDArray
    others: tuple[str, ...]

    def __init__(self, tables: Mapping[str, NDArray], weights: Mapping):
        groups: dict[tuple[int, int], int] = {}
        terms: dict[str, dict[tuple, dict[int, float]]] = {}
        for family, rows in tables.items():
            if family in _OTHER_FAMILIES:
                continue
            for row, first, second, factor in zip(rows, *weights[family], strict=True):
                group = groups.setdefault((int(first), int(second)), len(groups))
                rule, exponents = _rule_of(family, row)
                shares = terms.setdefault(rule, {}).setdefault(exponents, {})
                shares[group] = shares.get(group, 0.0) + float(factor * row[0])
        self.others = tuple(family for family in tables if family in _OTHER_FAMILIES)
        self.first, self.second = np.array(list(groups), int).reshape(-1, 2).T
        self.exponents = tuple(
            Exponents(rule, np.array(list(rows)).T) for rule, rows in terms.items()
        )
        self.mixing = tuple(_matrix(rows.values(), len(groups)) for rows in terms.values())

    @property
    def size(self) -> int:
        """Number of terms."""
        return sum(len(matrix) for matrix in self.mixing)

    def coefficients(self, x) -> tuple:
        """Coefficients of the terms of each family at mole fractions (n,)."""
        padded = jnp.concatenate([x, jnp.ones_like(x[:1])])
        weights = padded[self.first] * padded[self.second]
        return tuple(matrix @ weights for matrix in self.mixing)

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


def _rule_of(family: str, row: NDArray) -> tuple[str, tuple[float, ...]]:
    """Rule of a row and its exponents, without the coefficient."""
    if family == "gaussian":
        return family, tuple(row[1:])
    if family == "power":
        t, d, power = row[1:]
        # l = 0 marks terms that have no exp(-delta^l)
        return family, (t, d, power, float(power > 0))
    t, d, power, g, m = row[1:]
    # m = 0 marks terms without tau in the exponent
    return ("exponential", (t, d, power, g, m)) if m > 0 else ("power", (t, d, power, g))


def _matrix(rows: Iterable[Mapping[int, float]], groups: int) -> NDArray:
    """(rows, groups) from tables of numbers by group."""
    tables = list(rows)
    matrix = np.zeros((len(tables), groups))
    for place, row in enumerate(tables):
        matrix[place, list(row)] = list(row.values())
    return matrix


def _orders(order: int) -> list[tuple[int, int]]:
    """Orders of the derivatives over ln(delta) and ln(tau), up to a total."""
    return [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]


def _exponential_slopes(linear, factor, rate, x, order: int) -> tuple:
    """Function `linear x - factor exp(rate x)`, and its slopes up to an order."""
    bent = factor * jnp.exp(rate * x)
    slopes = [linear - rate * bent]
    slopes += [-(rate ** (k + 1)) * bent for k in range(1, order)]
    return linear * x - bent, slopes


def _gaussian_slopes(linear, width, centre, x, order: int) -> tuple:
    """Function `linear x - width (exp(x) - centre)^2`, and its slopes up to an order."""
    e = jnp.exp(x)
    slopes = [linear - 2 * width * e * (e - centre)]
    slopes += [-2 * width * e * (2**k * e - centre) for k in range(1, order)]
    return linear * x - width * (e - centre) ** 2, slopes


def _factors(exponents: Exponents, order: int, log_tau, log_delta) -> tuple:
    """Exponent of all terms of a family, and its slopes over ln(delta) and over ln(tau)."""
    columns = [column.reshape((-1,) + (1,) * log_tau.ndim) for column in exponents.columns]
    if exponents.rule == "gaussian":
        t, d, eta, epsilon, beta, gamma = columns
        along_delta = _gaussian_slopes(d, eta, epsilon, log_delta, order)
        along_tau = _gaussian_slopes(t, beta, gamma, log_tau, order)
    elif exponents.rule == "exponential":
        t, d, power, g, m = columns
        along_delta = _exponential_slopes(d, g, power, log_delta, order)
        along_tau = _exponential_slopes(t, 1.0, m, log_tau, order)
    else:
        t, d, power, g = columns
        along_delta = _exponential_slopes(d, g, power, log_delta, order)
        # a plain power: numbers of NumPy, so that nothing is computed for its slopes
        along_tau = t * log_tau, [t] + [np.zeros_like(t)] * (order - 1)
    return along_delta[0] + along_tau[0], along_delta[1], along_tau[1]


def _over_itself(slopes) -> list:
    """Derivatives of exp(f) over exp(f) itself, from the slopes of f."""
    ratios = [1.0]
    for k in range(len(slopes)):
        ratios.append(sum(comb(k, m) * slopes[m] * ratios[k - m] for m in range(k + 1)))
    return ratios


def _plain_sums(table, order: int, log_tau, log_delta, coefficients) -> tuple:
    """Sums S_ij in the order of `_orders`."""
    families = []
    for exponents, of_terms in zip(table, coefficients, strict=True):
        exponent, *slopes = _factors(exponents, order, log_tau, log_delta)
        x = of_terms.reshape((-1,) + (1,) * log_tau.ndim) * jnp.exp(exponent)
        by_delta, by_tau = map(_over_itself, slopes)
        families.append([jnp.sum(x * (by_delta[i] * by_tau[j]), 0) for i, j in _orders(order)])
    return tuple(sum(rows[1:], rows[0]) for rows in zip(*families, strict=True))


_sums = jax.custom_jvp(_plain_sums, nondiff_argnums=(0, 1))


@partial(_sums.defjvp, symbolic_zeros=True)
def _sums_jvp(table, order: int, primals, tangents):
    log_tau, log_delta, coefficients = primals
    tau_step, delta_step, coefficient_steps = tangents
    sums = _sums(table, order + 1, log_tau, log_delta, coefficients)
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
    if not all(isinstance(step, SymbolicZero) for step in coefficient_steps):
        moved = [
            jnp.zeros_like(plain) if isinstance(step, SymbolicZero) else step
            for step, plain in zip(coefficient_steps, coefficients, strict=True)
        ]
        # the sums are linear in the coefficients
        by_coefficients = _plain_sums(table, order, log_tau, log_delta, moved)
        steps = [step + part for step, part in zip(steps, by_coefficients, strict=True)]
    return tuple(along[orders] for orders in _orders(order)), tuple(steps)
