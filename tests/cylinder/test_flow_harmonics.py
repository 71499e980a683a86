"""Harmonics of flows on panels, however wide these are."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_pipes import SPEED, crank, cylinder
from scipy.special import spherical_jn

from jaxcomp._core.polynomials import gauss
from jaxcomp.cylinder import _cylinder, _quadrature, _waves
from jaxcomp.cylinder._cylinder import Pace

# parts of larger programs, each compiled once for all tests
prepare = eqx.filter_jit(_cylinder.prepare)
harmonics = eqx.filter_jit(_quadrature.harmonics)
quadrature = eqx.filter_jit(_quadrature.quadrature)
spherical_bessel = eqx.filter_jit(_quadrature.spherical_bessel)
sampled = jax.jit(_waves.sampled)


@pytest.mark.parametrize("count", [4, 6, 10])
def test_spherical_bessel_functions(count):
    x = np.linspace(0, 210, 5001)
    values, slopes = spherical_bessel(jnp.asarray(x), count)
    orders = np.arange(count)[:, None]
    # rounding: largest seen 1e-14, of ten functions where the series ends
    np.testing.assert_allclose(values.T, spherical_jn(orders, x), atol=3e-14)
    np.testing.assert_allclose(slopes.T, spherical_jn(orders, x, derivative=True), atol=3e-14)


def test_harmonics_by_sums_of_two_multiples():
    tau = np.linspace(-2, 6, 41)
    for orders in (4, 5, 64, 128):
        multiples = tau[:, None] * np.arange(1, orders + 1)
        expected = [np.ones((41, 1)), np.cos(multiples), np.sin(multiples)]
        # rounding of 128 times an angle
        np.testing.assert_allclose(
            harmonics(jnp.asarray(tau), orders), np.hstack(expected), atol=1e-12
        )


@pytest.fixture(scope="module")
def even():
    return prepare(cylinder(), crank(), SPEED, None)


def test_flows_on_a_panel_of_a_third_of_a_turn(even):
    """With 24 points a panel of 0.63 rad was the widest for 64 orders, and P2 has one of 0.69."""
    edges = np.array([-1.5, -1.4, 0.6, 2.7, 2 * np.pi - 1.5])
    width = np.diff(edges)
    weights = quadrature(even, 0.0, jnp.asarray(edges), 6, 64)
    flow = np.random.default_rng(1).normal(size=(4, 6))
    found = np.einsum("pj,pjh->h", flow, weights.nodes)
    fine = gauss(200)
    values = flow @ gauss(6).through(fine.nodes).T
    multiples = np.arange(1, 65)[:, None, None] * (edges[:-1, None] + width[:, None] * fine.nodes)
    weighted = values * width[:, None] * fine.weights / np.pi
    expected = [[np.sum(weighted) / 2]]
    expected += [np.sum(weighted * wave(multiples), axis=(1, 2)) for wave in (np.cos, np.sin)]
    np.testing.assert_allclose(found, np.concatenate(expected), atol=1e-13)


def test_weights_follow_the_edges(even):
    edges = jnp.asarray([-1.5, -1.4, -0.6, 0.7, 2.7, 2 * np.pi - 1.5])

    def weights(edges):
        at = quadrature(even, 0.0, edges, 6, 16)
        return at.nodes, at

    moved, at = jax.jit(jax.jacfwd(weights, has_aux=True))(edges)
    for panel in range(5):
        np.testing.assert_allclose(moved[panel, ..., panel], at.to_left[panel], atol=1e-12)
        np.testing.assert_allclose(moved[panel, ..., panel + 1], at.to_right[panel], atol=1e-12)


def test_even_speed_is_a_case_of_uneven_speed(even):
    edges = jnp.linspace(-np.pi / 2, 1.5 * np.pi, 49)
    uneven = prepare(cylinder(), crank(), SPEED, Pace(edges, jnp.zeros((48, 6))))
    pairs = zip(
        quadrature(even, 0.0, edges, 6, 64), quadrature(uneven, 0.0, edges, 6, 64), strict=True
    )
    for exact, fine in pairs:
        np.testing.assert_allclose(exact, fine, atol=1e-12)


def test_samples_of_a_march():
    orders = 64
    amplitudes = np.random.default_rng(2).normal(size=(2, 2 * orders + 1))
    series = jnp.asarray(amplitudes / np.concatenate([[1], np.tile(np.arange(1, 65) ** 2, 2)]))
    samples = sampled(series)
    for tau in (-7.0, 0.0, 0.1234, 3.0, 6.2831853):
        # cubics leave 4e-6 of the last harmonic, which is 1/4096 here
        exact = series @ harmonics(jnp.asarray(tau), orders)
        np.testing.assert_allclose(samples.at(jnp.asarray(tau)), exact, atol=1e-8)
