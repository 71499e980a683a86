"""Sums over the terms of mixtures: those of a plain sum of all rows, and derivatives of any order."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.fluid._helmholtz import Weighted, residual_terms
from jaxcomp.fluid._multi_fluid import GERG, REFERENCE, multi_fluid

# Families of all kinds: tau in the exponent (R125), bells (R1234yf), equal rows (GERG-2008), ammonia's
# and carbon dioxide's own.
MIXTURES = [
    (("R32", "R125", "R1234yf", "R134a", "R1234ze(E)"), REFERENCE),
    (("methane", "R170", "R290", "R600", "nitrogen", "R744", "hydrogen"), GERG),
    (("R744", "R32", "R717"), REFERENCE),
]


def amounts(components):
    shares = np.arange(1.0, len(components) + 1)
    return jnp.asarray(shares / shares.sum())


def plain_sums(table, x, tau, delta):
    """Every row by itself, differentiated as it stands."""
    rows = {
        family: Weighted(rows, table.weights[family].at(x))
        for family, rows in table.residual.items()
    }
    return jnp.stack(residual_terms(rows, tau, delta))


def short_sums(table, x, tau, delta):
    return jnp.stack(table.residual_terms(x, tau, delta))


@pytest.mark.parametrize(("components", "model"), MIXTURES)
def test_sums_are_those_of_all_rows(components, model):
    table = multi_fluid(components, model)
    x = amounts(components)
    tau = jnp.linspace(0.8, 1.4, 6).reshape(2, 3)
    delta = jnp.linspace(0.01, 2.1, 6).reshape(2, 3)
    # two programs, so that neither takes anything from the other
    expected, sums = (
        jax.jit(partial(function, table))(x, tau, delta) for function in (plain_sums, short_sums)
    )
    # terms of a liquid are a hundred times their sum
    np.testing.assert_allclose(sums, expected, rtol=1e-12, atol=1e-12)
    if model == GERG:
        assert table.term_table.size < 0.6 * table.terms


@pytest.mark.slow  # half a minute of compiling
@pytest.mark.parametrize(("components", "model"), MIXTURES)
def test_derivatives_of_sums_are_those_of_all_rows(components, model):
    """Forwards, backwards, and of a second order, to the composition and to the state."""
    table = multi_fluid(components, model)
    at = amounts(components), jnp.asarray(1.1), jnp.asarray(0.7)

    def slopes(sums, mode):
        return jax.tree.leaves(jax.jit(mode(lambda *at: sums(table, *at), (0, 1, 2)))(*at))

    def mixed(sums):
        def second(*at):
            return jax.grad(lambda *at: sums(table, *at)[1], (0, 2))(*at)

        return jax.tree.leaves(jax.jit(jax.jacfwd(second, (0, 1)))(*at))

    expected = slopes(plain_sums, jax.jacfwd)
    for mode in (jax.jacfwd, jax.jacrev):
        for slope, plain in zip(slopes(short_sums, mode), expected, strict=True):
            np.testing.assert_allclose(slope, plain, rtol=1e-11, atol=1e-11)
    for slope, plain in zip(mixed(short_sums), mixed(plain_sums), strict=True):
        np.testing.assert_allclose(slope, plain, rtol=1e-10, atol=1e-10)
