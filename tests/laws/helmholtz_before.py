"""Sums over the terms of a Helmholtz energy as they were before mixtures, for pure fluids alone.

A frozen copy, with which `test_fluid.py` compares: weights of rows must not change a bit of a pure fluid.
"""

import jax
import jax.numpy as jnp
import numpy as np


def _columns(table: np.ndarray, like) -> list:
    """Columns of a table, one entry a term along a new first axis."""
    return [c.reshape((-1,) + (1,) * jnp.ndim(like)) for c in table.T]


def ideal_terms(ideal: dict, tau, delta):
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


def residual_terms(residual: dict, tau, delta):
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
