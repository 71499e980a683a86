"""Scatter of the balance: a rotor solved once, the masses of the paper, robust balances and bores.

Levecque et al. (2011), cited in full in `jaxcomp/machines/hermetic-68cc.toml`, close with the
sensitivity of their balance to tolerances of production: 5 % on the eccentric masses, the counterweight
most.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats.mstats import hdquantiles

from jaxcomp import BadInput, Collocation, load, optimise, problem, robust, tolerance, within
from jaxcomp.machine import machine_of
from jaxcomp.study import AnalysisOptions, DesignResult, balanced_design, prepared
from jaxcomp.study._analysis import quantity_named
from jaxcomp.study.tolerance import scatter_of

pytestmark = pytest.mark.slow  # programs of a rotor and its scatter: a minute and a half
COUNTERWEIGHT = tuple(f"loads.unbalances.0.magnitude.{i}" for i in range(2))
PIN = tuple(f"loads.unbalances.1.magnitude.{i}" for i in range(4))
ADDED = tuple(f"corrections.{plane}.magnitude" for plane in ("rotor-top", "counterweight"))
FIVE = within(0.05, relative=True)


@pytest.fixture(scope="module")
def scene():
    return load("hermetic-68cc")


@pytest.fixture(scope="module")
def balanced(scene):
    return balanced_design(machine_of(scene), AnalysisOptions())


@pytest.fixture(scope="module")
def study(balanced):
    scattered = {name: FIVE for name in (*COUNTERWEIGHT, *PIN, *ADDED)}
    quantities = ["vibration", "vibration.TP1", "mount_force"]
    limits = {"vibration": (None, 8e-6)}
    return tolerance(balanced, scattered, quantities, limits=limits, samples=65536, progress=False)


def test_balance_is_that_of_least_squares(balanced):
    """Table 3 of the paper, to which the machine was fitted; see `test_cli_balance`."""
    both = {name: complex(*xy) for name, xy in balanced.corrections.items()}
    assert abs(both["rotor-top"]) == pytest.approx(829.5e-6, rel=1e-3)
    assert abs(both["counterweight"]) == pytest.approx(456.8e-6, rel=1e-3)


def test_known_response_is_the_response(study, balanced):
    made = study.problem
    assert made.options.known is not None
    plain = problem(balanced, list(study.variables), list(study.names))
    x = made.current * (1 + 0.05 * jnp.linspace(-1, 1, len(study.variables)))
    a, b = eqx.filter_jit(made)(x), eqx.filter_jit(plain)(x)
    assert bool(a.ok & b.ok)
    # two solutions of the same equations, each refined until a correction is below 1e-8
    np.testing.assert_allclose(a.values, b.values, rtol=2e-8)


def test_rotor_that_changes_is_not_taken_for_known(balanced):
    for name in ("rotor.links.0.law.stiffness.0", "balancing.speeds.0"):
        try:
            made = problem(balanced, [name, COUNTERWEIGHT[0]], ["vibration"])
        except BadInput:
            continue
        assert prepared(made).options.known is None
    only = problem(balanced, ["mechanism.bore"], ["swept_volume"])
    assert prepared(only) is only


def test_counterweight_moves_the_housing_most(study):
    """What the paper expects of the tolerance of its eccentric masses."""
    for name in ("vibration", "vibration.TP1"):
        shares = dict(study.ranking(name))
        assert study.ranking(name)[0][0] in COUNTERWEIGHT
        counterweight = sum(shares[name] for name in COUNTERWEIGHT)
        assert counterweight > 0.55
        assert counterweight > sum(shares[name] for name in PIN)
        assert sum(shares[name] for name in ADDED) < 0.05


def test_study_of_the_balance(study):
    """The figures of the notebook."""
    mean, deviation = study.sampled.mean[0] * 1e6, study.sampled.deviation[0] * 1e6
    worst = study.sampled.quantile(0.99)[0] * 1e6
    assert study.value[0] * 1e6 == pytest.approx(5.62, abs=0.01)
    assert (mean, deviation, worst) == (
        pytest.approx(6.35, abs=0.02),
        pytest.approx(0.915, abs=0.02),
        pytest.approx(9.73, abs=0.1),
    )


def test_first_order_fails_at_the_balance_and_says_so(study):
    """The balance is a minimum of the vibration: its slopes there tell nothing of the scatter."""
    assert study.first_order.deviation[0] < 0.05 * study.sampled.deviation[0]
    assert any(text.startswith("Vibration: first-order deviation") for text in study.remarks)


def test_probability_of_the_limit_agrees_with_the_samples(study):
    (one,) = study.reliability
    low, high = one.sampled_interval
    assert len(one.points) == 2  # too much and too little of the same masses
    assert low < one.first_order < high
    assert low < one.second_order < high
    assert abs(one.near_points - one.sampled) < 4 * np.hypot(
        one.near_points_error, (high - low) / 4
    )


# ------------------------------------------------------------------- robust
def test_robust_objective_is_that_of_its_machines(scene):
    """Mean and deviation, and the quantile of Harrell and Davis as SciPy has it."""
    volume = {"mechanism.bore": within(2e-3), "mechanism.crank_radius": within(0.1, relative=True)}
    design = machine_of(scene)
    found = DesignResult(design, AnalysisOptions())
    one = robust(scene, "swept_volume", volume, sigmas=2.0, samples=32)
    values = np.asarray(one.sample(found))
    nominal = [design.compressor.mechanism.bore, design.compressor.mechanism.crank_radius]
    x = scatter_of(volume).at(jnp.array(nominal), one._normals)
    np.testing.assert_allclose(values, np.pi / 2 * x[:, 0] ** 2 * x[:, 1], rtol=1e-13)
    assert float(one(found)) == pytest.approx(values.mean() + 2 * values.std(), rel=1e-13)
    assert one.__name__ == "swept_volume, mean +2 sigma"
    other = robust(scene, "swept_volume", volume, quantile=0.9, samples=32)
    right = float(hdquantiles(np.asarray(other.sample(found)), [0.9])[0])
    assert float(other(found)) == pytest.approx(right, rel=1e-12)
    assert other.changes == tuple(volume)


def test_impossible_robust_objectives_are_refused(scene):
    volume = {"mechanism.bore": within(1e-4)}
    with pytest.raises(BadInput, match="sigmas"):
        robust(scene, "swept_volume", volume)
    with pytest.raises(BadInput, match="sigmas"):
        robust(scene, "swept_volume", volume, sigmas=3.0, quantile=0.9)
    with pytest.raises(BadInput, match="quantile"):
        robust(scene, "swept_volume", volume, quantile=0.999, samples=64)
    with pytest.raises(BadInput, match="samples"):
        robust(scene, "swept_volume", volume, sigmas=3.0, samples=4)


def test_robust_balance_is_least_squares_with_a_penalty(balanced):
    """Where a mass scatters with its size, its mean square vibration is least squares with a penalty:

    E |V_0 + C (B + dB)|^2 = |V_0 + C B|^2 + sum_p s^2 |B_p|^2 |C_p|^2.
    """

    def mean_square(found):
        return quantity_named("vibration").value(found) ** 2

    deviation = 0.2
    scattered = {name: within(deviation, sigmas=1.0, relative=True) for name in ADDED}
    objective = robust(balanced, mean_square, scattered, sigmas=0.0, samples=64)
    ranges = {
        f"corrections.{plane}.{axis}": (-2e-3, 2e-3)
        for plane in ("rotor-top", "counterweight")
        for axis in "xy"
    }
    made = prepared(problem(balanced, ranges, [objective]))
    assert made.options.known is not None
    best = optimise(made, samples=16, starts=1, max_steps=60, tolerance=1e-7)

    bare = eqx.tree_at(
        lambda d: d.corrections, balanced, {name: jnp.zeros(2) for name in balanced.corrections}
    )
    matrix, initial = (
        np.asarray(part) for part in DesignResult(bare, AnalysisOptions()).influence.weighted
    )
    normal = matrix.conj().T @ matrix
    normal += deviation**2 * np.diag(np.diag(normal))
    right = np.linalg.solve(normal, -matrix.conj().T @ initial)
    found = [
        best.values[f"corrections.{plane}.x"] + 1j * best.values[f"corrections.{plane}.y"]
        for plane in ("rotor-top", "counterweight")
    ]
    # 64 points of a sequence have the variance to 1 %, and the penalty moves the masses by 6 %
    np.testing.assert_allclose(found, right, atol=0.01 * np.abs(right).max())
    plain = [complex(*balanced.corrections[p]) for p in ("rotor-top", "counterweight")]
    assert np.abs(np.array(plain) - right).max() > 0.02 * np.abs(right).max()


def test_tolerance_of_one_clearance_needs_no_correlation(scene):
    """The bearing stands once: its clearance scatters loss and vibration together."""
    name = "bearings.upper.radial_clearance"
    options = AnalysisOptions(
        solver=Collocation(nodes=6, reversals=0, tolerance=1e-10), excitation="crank"
    )
    asked = ["mechanical_efficiency", "vibration"]
    found = tolerance(
        scene,
        {name: within(1e-6)},
        asked,
        options=options,
        samples=256,
        curvature=None,
        progress=False,
    )
    slope = found.local.slope[:, 0]
    np.testing.assert_allclose(found.first_order.deviation, abs(slope) * 1e-6 / 3, rtol=1e-9)
    low, high = found.swings[:, 0]
    # the deviation is a thirteenth of the clearance: its third order changes the chord by its square
    np.testing.assert_allclose((high - low) / 2e-6, slope, rtol=0.03)
    assert slope[0] > 1.0  # [1/m] more clearance, less friction
    np.testing.assert_allclose(found.sampled.deviation, found.first_order.deviation, rtol=0.1)
