"""Harmonics of flows on panels, however wide these are."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_pipes import SPEED, crank, cylinder, suction_pipe
from scipy.special import spherical_jn

from jaxcomp import BadInput, Status
from jaxcomp._core.fields import replaced
from jaxcomp._core.polynomials import gauss
from jaxcomp.cylinder import CycleOptions, _cylinder, _quadrature, _waves, solve_cycle
from jaxcomp.cylinder._cylinder import Pace
from jaxcomp.cylinder._pulsation import Pulsation
from jaxcomp.piping import Pipes

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


@pytest.fixture(scope="module")
def quarter_wave():
    return solve_cycle(cylinder(suction_pipe(0.9)), crank(), SPEED, CycleOptions())


def test_the_first_size_resolves_a_quarter_wave(quarter_wave):
    """P2 of the reference; five times the panels, until flows were exact on wide ones."""
    cycle = quarter_wave
    assert cycle.status == Status.converged
    assert cycle.angle.size == CycleOptions().behind_pipes().panel_count * 6
    # one of two revolutions, and behind the waves of each step one more: four steps
    assert int(cycle.revolutions) <= 6
    # the last Newton's method has one linearisation
    assert int(cycle.iterations) == 1


def test_pressure_at_a_place_of_a_pipe(quarter_wave):
    pulsation = quarter_wave.pulsation
    nodes = pulsation.series()
    # as at the nodes where its ends are, counted from either of them
    for distance, node in ((0.0, "flange"), (0.9, "far")):
        for ends, place in ((("flange", "far"), distance), (("far", "flange"), 0.9 - distance)):
            series = pulsation.series_in_pipe(*ends, place)
            np.testing.assert_allclose(series, nodes[node], rtol=1e-10, atol=1e-8)
    # as at a node that cuts the pipe there: the same waves and flows through another network
    piping = pulsation.case.cylinder.suction.piping
    chain = Pipes(("flange", "cut", "far"), [0.35, 0.55], 0.05, attenuation=0.02)
    suction = replaced(pulsation.case.cylinder.suction, piping=replaced(piping, pipes=(chain,)))
    machine = replaced(pulsation.case.cylinder, suction=suction)
    case = eqx.tree_at(lambda case: case.cylinder, pulsation.case, machine)
    at_cut = Pulsation(pulsation.waves, pulsation.flows, case, pulsation.phase).series()["cut"]
    np.testing.assert_allclose(
        pulsation.series_in_pipe("flange", "far", 0.35), at_cut, rtol=1e-10, atol=1e-8
    )
    with pytest.raises(BadInput, match=r"0\.9 m"):
        pulsation.series_in_pipe("flange", "far", 1.0)
    with pytest.raises(BadInput, match="flange-far"):
        pulsation.series_in_pipe("flange", "line", 0.1)


def test_status_of_waves_beyond_their_range(quarter_wave):
    pulsation = quarter_wave.pulsation
    assert pulsation.status == Status.converged
    # three times the pressures: 17 % peak to peak
    larger = pulsation.waves[0]._replace(pressure=3 * pulsation.waves[0].pressure)
    loud = Pulsation((larger, None), pulsation.flows, pulsation.case, pulsation.phase)
    assert loud.status == Status.large_pulsation
    assert float(loud.linear_error) == pytest.approx(0.35 * float(loud.largest) ** 2)
    assert "large_pulsation" in " ".join(loud.remarks)
