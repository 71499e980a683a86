"""Tolerances: distributions, moments, samples and probabilities against closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from distributed import Client, LocalCluster
from scipy import stats

from jaxcomp import BadInput, Collocation, load, problem, tolerance, within
from jaxcomp.study import AnalysisOptions
from jaxcomp.study.sweep._design_blocks import default_width
from jaxcomp.study.tolerance import scatter_of
from jaxcomp.study.tolerance._moments import local, sampled, solved_rows
from jaxcomp.study.tolerance._reliability import Limit, reliability

BORE, RADIUS = "mechanism.bore", "mechanism.crank_radius"


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


# ------------------------------------------------------------ distributions
@pytest.mark.parametrize("distribution", ["normal", "uniform", "truncated"])
@pytest.mark.parametrize("sigmas", [1.0, 3.0])
def test_moments_are_those_of_the_distribution(distribution, sigmas):
    one = within((-1e-5, 3e-5), distribution, sigmas=sigmas)
    # the midpoint rule over shares of the normal variable's range; 1e-5 is its error at the ends
    share = (np.arange(400_000) + 0.5) / 400_000
    x = np.asarray(jax.jit(one.at)(stats.norm.ppf(share)))
    assert x.mean() == pytest.approx(one.middle, rel=1e-5)
    assert x.std() == pytest.approx(one.deviation, rel=1e-5)
    assert stats.kurtosis(x) == pytest.approx(one.excess, abs=2e-3)  # its fourth power: 1e-3
    if distribution != "normal":
        assert one.low <= x.min() < x.max() <= one.high


def test_truncated_distribution_is_scipys():
    one = within(2.0, "truncated", sigmas=1.5)
    share = np.array([1e-12, 1e-3, 0.2, 0.5, 0.9, 1 - 1e-9])
    z = stats.norm.ppf(share)
    right = stats.truncnorm(-1.5, 1.5, scale=2.0 / 1.5).ppf(share)
    np.testing.assert_allclose(jax.jit(one.at)(z), right, rtol=1e-9, atol=1e-12)  # SciPy's digits


@pytest.mark.parametrize("distribution", ["normal", "uniform", "truncated"])
def test_deviation_is_smooth_in_the_normal_variable(distribution):
    one = within(1.0, distribution)
    z = jnp.array([-9.0, -3.0, -1e-3, 0.0, 1e-3, 3.0, 9.0])
    at = jax.jit(one.at)
    slope = jax.jit(jax.vmap(jax.grad(lambda x: one.at(x))))(z)
    h = 1e-5
    differences = (at(z + h) - at(z - h)) / (2 * h)
    assert np.all(np.isfinite(slope))
    np.testing.assert_allclose(slope, differences, rtol=1e-6, atol=1e-9)  # h^2 and rounding/h
    np.testing.assert_allclose(at(z), -at(z)[::-1], atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "options", "field"),
    [
        ((0.0,), {}, "tolerance"),
        (((2e-5, -1e-5),), {}, "tolerance"),
        ((np.nan,), {}, "tolerance"),
        ((1e-5, "bell"), {}, "distribution"),
        ((1e-5,), {"sigmas": 0.0}, "sigmas"),
    ],
)
def test_impossible_tolerances_are_refused(arguments, options, field):
    with pytest.raises(BadInput, match=field):
        within(*arguments, **options)


# ------------------------------------------------------------- correlations
@pytest.mark.parametrize(
    ("a", "b"), [("normal", "normal"), ("uniform", "uniform"), ("truncated", "uniform")]
)
@pytest.mark.parametrize("rho", [-0.6, 0.9])
def test_deviations_are_correlated_as_asked(a, b, rho):
    tolerances = {"a": within(1e-3, a, sigmas=1.2), "b": within(0.2, b, relative=True)}
    scatter = scatter_of(tolerances, {("a", "b"): rho})
    nominal = jnp.array([1.0, -50.0])
    # tensor quadrature of 200 x 200 shares: 1e-4 for the uniform ones at their ends
    share = (np.arange(400) + 0.5) / 400
    z = stats.norm.ppf(share)
    u = np.stack(np.meshgrid(z, z, indexing="ij"), -1).reshape(-1, 2)
    found = np.cov(np.asarray(jax.jit(scatter.at)(nominal, u)).T)
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(-rho, abs=2e-3)
    covariance = np.asarray(scatter.covariance(nominal))
    np.testing.assert_allclose(found, covariance, rtol=5e-3)
    np.testing.assert_allclose(scatter.deviation(nominal) ** 2, np.diag(covariance), rtol=1e-12)


def test_impossible_correlations_are_refused():
    three = {name: within(1.0) for name in "abc"}
    with pytest.raises(BadInput, match="positive eigenvalues"):
        scatter_of(three, {("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9})
    with pytest.raises(BadInput, match="a and b"):
        scatter_of(three, {("a", "b"): 1.0})
    with pytest.raises(BadInput, match="a and x"):
        scatter_of(three, {("a", "x"): 0.5})
    # a bell and an even distribution are never wholly alike: at most sqrt(3/pi)
    with pytest.raises(BadInput, match=r"0\.977"):
        scatter_of({"a": within(1.0), "b": within(1.0, "uniform")}, {("a", "b"): 0.98})


def test_tolerances_that_a_scene_cannot_have_are_refused(scene):
    with pytest.raises(BadInput, match="at least one"):
        tolerance(scene, {})
    with pytest.raises(BadInput, match="different from zero"):
        tolerance(scene, {"mechanism.offset": within(0.1, relative=True)}, ["swept_volume"])
    with pytest.raises(BadInput, match=r"mechanism\.bore.*limit of tolerance"):
        tolerance(scene, {BORE: within(1.0)}, ["swept_volume"])
    with pytest.raises(BadInput, match="limits"):
        tolerance(scene, {BORE: within(1e-4)}, limits={"swept_volume": (None, None)})
    with pytest.raises(BadInput, match="samples"):
        tolerance(scene, {BORE: within(1e-4)}, ["swept_volume"], samples=3)


# ------------------------------------------------------------------ moments
@pytest.mark.parametrize("distribution", ["normal", "uniform", "truncated"])
def test_second_order_is_exact_for_a_quadratic(scene, distribution):
    """The swept volume is quadratic in the bore."""
    one = within((-0.02, 0.03), distribution, sigmas=1.0)
    found = tolerance(scene, {BORE: one}, ["swept_volume"], samples=4096, progress=False)
    b, s = float(found.nominal[0]) + one.middle, one.deviation
    factor = np.pi / 4 * float(scene.compressor.mechanism.stroke)
    assert found.first_order.mean[0] == pytest.approx(factor * b**2, rel=1e-12)
    assert found.first_order.deviation[0] == pytest.approx(factor * 2 * b * s, rel=1e-12)
    assert found.second_order.mean[0] == pytest.approx(factor * (b**2 + s**2), rel=1e-9)
    variance = 4 * b**2 * s**2 + s**4 * (one.excess + 2)
    # differences of exact slopes: rounding over the step
    assert found.second_order.deviation[0] == pytest.approx(factor * variance**0.5, rel=1e-9)
    # samples of a sequence: a thousandth of the deviation
    assert found.sampled.mean[0] == pytest.approx(
        found.second_order.mean[0], abs=1e-3 * factor * 2 * b * s
    )
    assert found.sampled.deviation[0] == pytest.approx(found.second_order.deviation[0], rel=3e-3)
    assert found.remarks == ()


@pytest.mark.parametrize("curvature", ["differences", "exact"])
def test_product_of_correlated_variables(scene, curvature):
    """Variance of a product of two normal variables, Goodman (1960)."""

    def area(found):
        return (
            found.design.compressor.mechanism.bore * found.design.compressor.mechanism.crank_radius
        )

    rho = 0.4
    tolerances = {BORE: within(0.03, sigmas=1), RADIUS: within(0.01, sigmas=1)}
    found = tolerance(
        scene, tolerances, [area], correlations={(BORE, RADIUS): rho}, samples=16384,
        curvature=curvature, progress=False,
    )  # fmt: skip
    (a, b), (s, t) = found.nominal, (0.03, 0.01)
    mean, variance = a * b + rho * s * t, (a * t) ** 2 + (b * s) ** 2 + 2 * a * b * rho * s * t
    assert found.first_order.deviation[0] == pytest.approx(variance**0.5, rel=1e-12)
    variance += (s * t) ** 2 * (1 + rho**2)
    assert found.second_order.mean[0] == pytest.approx(mean, rel=1e-9)
    assert found.second_order.deviation[0] == pytest.approx(variance**0.5, rel=1e-9)
    off = abs(found.sampled.deviation[0] / variance**0.5 - 1)
    assert off < 5e-3  # 16384 samples of a sequence; independent ones would have 0.006
    np.testing.assert_allclose(found.shares.sum(-1), 1.0, rtol=1e-12)


def test_shares_and_swings_of_independent_variables(scene):
    tolerances = {BORE: within(1e-4), RADIUS: within(2e-4)}
    found = tolerance(scene, tolerances, ["swept_volume"], samples=64, progress=False)
    b, r = found.nominal
    parts = np.array([(2 * r * 1e-4) ** 2, (b * 2e-4) ** 2])  # of V ~ b^2 r, squared slopes
    # the curvature adds 1e-6 at so small tolerances
    np.testing.assert_allclose(found.shares[0], parts / parts.sum(), rtol=1e-5)
    assert [name for name, _ in found.ranking("swept_volume")] == [RADIUS, BORE]
    volume = np.pi / 2 * b**2 * r
    low = [np.pi / 2 * (b - 1e-4) ** 2 * r, np.pi / 2 * b**2 * (r - 2e-4)]
    np.testing.assert_allclose(found.swings[0, :, 0], low, rtol=1e-13)
    assert found.value[0] == pytest.approx(volume, rel=1e-13)
    with pytest.raises(BadInput, match="swept_volume"):
        found.ranking("efficiency")


def test_machines_that_cannot_be_solved_are_counted_and_left_out(scene):
    bore = float(scene.compressor.mechanism.bore)
    tolerances = {BORE: within(0.9 * bore, sigmas=1.0)}
    found = tolerance(scene, tolerances, ["swept_volume"], samples=8192, progress=False)
    beyond = stats.norm.cdf(-1 / 0.9)  # a bore of zero and less
    lost = np.mean(~found.sampled.ok)
    assert lost == pytest.approx(beyond, abs=2e-3)
    assert np.all(np.isnan(found.sampled.values[~found.sampled.ok]))
    assert np.isfinite(found.sampled.deviation[0])
    assert any("could not be solved" in text for text in found.remarks)


# ------------------------------------------------------------------ samples
def test_standard_errors_tell_how_far_off_the_samples_are(scene):
    made = problem(scene, [BORE], ["swept_volume"])
    scatter = scatter_of({BORE: within(0.01, sigmas=1)})
    bore = np.asarray(made.current)
    factor = np.pi / 4 * float(scene.compressor.mechanism.stroke)
    mean = factor * (bore[0] ** 2 + 1e-4)
    errors = {}
    for kind in ("random", "sobol", "latin_hypercube"):
        off = []
        for seed in range(12):
            one = sampled(made, scatter, bore, 1024, kind, seed, progress=False)
            off.append((one.mean[0] - mean) / one.mean_error[0])
            errors[kind] = float(one.mean_error[0])
        # Student's t of 7 degrees of freedom: root mean square 1.18, of 12 draws 0.5 to 2.2
        assert 0.5 < np.sqrt(np.mean(np.square(off))) < 2.2
    assert errors["sobol"] < 0.2 * errors["random"]  # 1/n against 1/sqrt(n)


def test_samples_do_not_depend_on_the_blocks(scene, monkeypatch):
    made = problem(scene, [BORE], ["swept_volume"])
    scatter = scatter_of({BORE: within(1e-3)})
    whole = sampled(made, scatter, np.asarray(made.current), 1000, progress=False)
    monkeypatch.setattr("jaxcomp.study.tolerance._moments._BLOCK", 96)
    parts = sampled(made, scatter, np.asarray(made.current), 1000, progress=False)
    np.testing.assert_array_equal(whole.values, parts.values)


def _programs_of_worker():
    from jaxcomp.study.sweep import _design_blocks

    return len(_design_blocks._PROGRAMS)


@pytest.mark.slow  # three processes that compile
def test_machines_on_a_cluster_are_those_of_one_process(scene, monkeypatch):
    """Blocks that two workers share, to the last bit in all that follows from them."""
    monkeypatch.setattr("jaxcomp.study.tolerance._moments._BLOCK", 32)
    tolerances = {BORE: within(1e-4), "friction.wall.coefficient": within(0.01, "uniform")}

    def study(client):
        return tolerance(
            scene, tolerances, ["mechanical_efficiency", "loss_power.wall"], samples=256,
            limits={"mechanical_efficiency": (0.9, None)}, progress=False, client=client,
            options=AnalysisOptions(Collocation(nodes=5, reversals=0, tolerance=1e-5)),
        )  # fmt: skip

    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as cluster,
        Client(cluster) as client,
    ):
        there = study(client)
        assert list(client.run(_programs_of_worker).values()) == [1, 1]  # both had a share
    here = study(None)
    assert here.sampled.ok.all()
    assert here.sampled.deviation.min() > 0
    np.testing.assert_array_equal(there.sampled.values, here.sampled.values)
    for one, other in zip(there.described(), here.described(), strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.values, other.values)
    assert there.reliability[0].sampled_interval == here.reliability[0].sampled_interval


# -------------------------------------------------------------- reliability
def _limit_of(scene, function, limit, samples=4096, n=2, around=4096):
    """The probability of a limit of a function of standard normal deviations."""
    names = [BORE, RADIUS][:n]
    size = 1e-3

    def asked(found):
        mechanism = found.design.compressor.mechanism
        now = jnp.stack([mechanism.bore, mechanism.crank_radius])
        return function((now - nominal) / size)

    nominal = np.array([scene.compressor.mechanism.bore, scene.compressor.mechanism.crank_radius])
    made = problem(scene, names, [asked])
    scatter = scatter_of({name: within(size, sigmas=1) for name in names})
    many = sampled(made, scatter, np.asarray(made.current), samples, progress=False)
    return reliability(
        made, scatter, np.asarray(made.current), Limit("asked", *limit), many, around
    )


@pytest.mark.parametrize("limit", [(7.0, True), (-7.0, False)])
def test_first_order_is_exact_for_a_plane(scene, limit):
    found = _limit_of(scene, lambda u: 1.2 * u[0] - 0.9 * u[1], limit)
    assert found.beta == pytest.approx(7 / 1.5, rel=1e-7)
    right = stats.norm.sf(7 / 1.5)  # 1.5e-6: no plain sample gets there
    assert found.first_order == pytest.approx(right, rel=1e-6)
    assert found.second_order == pytest.approx(right, rel=1e-5)
    assert abs(found.near_points - right) < 4 * found.near_points_error
    assert found.near_points_error < 0.1 * right
    np.testing.assert_allclose(found.importance, [0.64, 0.36], atol=1e-6)
    assert found.sampled == 0.0
    assert found.sampled_interval[1] < 2e-3
    assert found.agrees


def test_second_order_follows_the_bend_of_the_limit(scene):
    bend = 0.1
    found = _limit_of(scene, lambda u: u[0] + bend * u[1] ** 2, (3.0, True))
    x, w = np.polynomial.hermite_e.hermegauss(60)
    right = (w / w.sum()) @ stats.norm.sf(3.0 - bend * x**2)
    first, second = (abs(p / right - 1) for p in (found.first_order, found.second_order))
    assert found.beta == pytest.approx(3.0, rel=1e-6)
    assert first > 0.3
    assert second < 0.12  # an expansion for large beta; its next term is of the order 1 / beta^2
    assert abs(found.near_points - right) < 4 * found.near_points_error


def test_a_limit_as_round_as_the_sphere_has_no_second_order(scene):
    found = _limit_of(scene, lambda u: u[0] + 0.15 * u[1] ** 2, (3.0, True))
    assert np.isnan(found.second_order)
    assert not found.agrees  # and says so: 4096 samples tell 0.0013 from 0.0030
    assert abs(found.near_points - 0.002996) < 4 * found.near_points_error


def test_both_sides_of_a_minimum_count(scene):
    found = _limit_of(scene, lambda u: (u[0] + 0.5 * u[1]) ** 2 + 0.05 * u[0], (12.0, True))
    x = np.linspace(-12, 12, 4001)
    inner = np.sqrt(np.maximum(12.0 - 0.05 * x, 0))
    broken = stats.norm.sf((inner - x) / 0.5) + stats.norm.cdf((-inner - x) / 0.5)
    right = np.trapezoid(stats.norm.pdf(x) * broken, x)
    assert len(found.points) == 2
    assert found.first_order == pytest.approx(right, rel=0.01)  # the limits are nearly planes
    assert abs(found.near_points - right) < 4 * found.near_points_error


def test_a_machine_that_breaks_the_limit_as_drawn_has_a_negative_beta(scene):
    found = _limit_of(scene, lambda u: u[0], (-1.0, True))
    assert found.beta == pytest.approx(-1.0, rel=1e-7)
    assert found.first_order == pytest.approx(stats.norm.cdf(1.0), rel=1e-7)
    assert found.second_order == pytest.approx(stats.norm.cdf(1.0), rel=1e-6)
    assert found.agrees


def test_a_limit_out_of_reach_has_no_point_and_no_samples(scene):
    found = _limit_of(scene, lambda u: jnp.tanh(u[0]), (2.0, True))
    assert np.isnan(found.beta)
    assert found.sampled == 0.0
    assert len(found.points) == 0


# ------------------------------------------------------- when methods disagree
def test_the_report_says_where_the_first_order_fails(scene):
    nominal = float(scene.compressor.mechanism.bore)

    def valley(found):
        return (found.design.compressor.mechanism.bore - nominal) ** 2

    found = tolerance(scene, {BORE: within(1e-3)}, [valley], samples=1024, progress=False)
    assert found.first_order.deviation[0] == pytest.approx(0.0, abs=1e-12)
    assert found.second_order.deviation[0] == pytest.approx(np.sqrt(2) * (1e-3 / 3) ** 2, rel=1e-8)
    words = " ".join(found.remarks)
    assert "first-order deviation" in words
    assert "second-order" not in words


def test_slopes_that_cannot_be_had_are_told(scene):
    bore = float(scene.compressor.mechanism.bore)
    made = problem(scene, {BORE: (None, None)}, ["swept_volume"])
    near = local(made, jnp.array([bore]), jnp.array([4 * bore]), "differences")
    assert not near.ok  # half a deviation off there is no bore left


def test_a_problem_takes_its_own_variables(scene):
    made = problem(scene, [BORE, RADIUS], ["swept_volume"])
    with pytest.raises(BadInput, match="in this order"):
        tolerance(made, {BORE: within(1e-4)})
    with pytest.raises(BadInput, match="left to the `Problem`"):
        tolerance(made, {BORE: within(1e-4), RADIUS: within(1e-4)}, ["swept_volume"])
    with pytest.raises(BadInput, match="mechanical_efficiency"):
        tolerance(
            made,
            {BORE: within(1e-4), RADIUS: within(1e-4)},
            limits={"mechanical_efficiency": (0.9, None)},
        )


def test_polar_coordinates_of_a_correction():
    from jaxcomp.machine import machine_of
    from jaxcomp.study import variable

    design = machine_of(load("hermetic-68cc"))
    magnitude, angle = (
        variable(design, f"corrections.rotor-top.{p}") for p in ("magnitude", "angle")
    )
    now = angle.apply(magnitude.apply(design, 8e-4), jnp.deg2rad(120.0))
    right = 8e-4 * np.array([np.cos(np.deg2rad(120)), np.sin(np.deg2rad(120))])
    np.testing.assert_allclose(now.corrections["rotor-top"], right, rtol=1e-14)
    assert float(magnitude.current(now)) == pytest.approx(8e-4, rel=1e-14)
    assert float(angle.current(now)) == pytest.approx(np.deg2rad(120), rel=1e-14)
    # nothing has no angle, and yet finite slopes
    both = lambda d: magnitude.current(d) + angle.current(d)  # noqa: E731
    slope = eqx.filter_jit(eqx.filter_grad(both))(design)
    assert np.all(np.isfinite(slope.corrections["rotor-top"]))


def test_tolerances_that_keep_the_rejects_down_are_those_of_the_normal_distribution():
    from scipy.stats import norm

    from jaxcomp.study.tolerance import permitted

    def bores(found):
        return found.design.compressor.mechanism.bore

    made = problem(load("mayekawa-wbhe"), ["mechanism.bore", "mechanism.crank_radius"], [bores])
    spread = {"mechanism.bore": within(3e-4), "mechanism.crank_radius": within(1e-4)}
    limit = 0.130 + 1.5e-4  # 1.5 standard deviations
    found = tolerance(made, spread, limits={"bores": (None, limit)}, samples=4096, progress=False)
    got = permitted(found, 0.01)
    # the 41 machines beyond the limit, of a Sobol sequence, lie within one of what they should be
    assert got.factor == pytest.approx(1.5 / norm.isf(0.01), rel=0.01)
    assert abs(got.rejects - 0.01) <= 1.5 / 4096
    assert got.before == pytest.approx(norm.sf(1.5), rel=0.03)
    alone = permitted(found, 0.01, ["mechanism.bore"])
    assert alone.factor == pytest.approx(got.factor, rel=1e-3)
    with pytest.raises(BadInput, match=r"mechanism\.offset"):
        permitted(found, 0.01, ["mechanism.offset"])


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("mechanism.bore", "bore"),
        ("friction.crank_pin.coefficient", "friction of crank pin"),
        ("loads.unbalances.0.magnitude.1", "unbalance at node 15"),
        ("rotor.links.4.law.stiffness.1", "stiffness y of link springs to seats"),
        ("corrections.rotor-top.magnitude", "magnitude of correction rotor-top"),
        ("bearings.upper.radial_clearance", "radial clearance of bearing upper"),
    ],
)
def test_parts_have_names_and_not_paths(path, words):
    from jaxcomp.study._labels import variable_label

    assert variable_label(load("hermetic-68cc").machine, path) == words


def test_the_first_machines_come_alone_so_that_a_forecast_is_early(scene):
    options = AnalysisOptions(Collocation(nodes=8, reversals=0, estimate=False))
    made = problem(scene, [BORE], ["mechanical_efficiency"], options)
    width = default_width(made, jax.local_devices())
    rows = np.linspace(0.125, 0.135, 2 * width + 1)[:, None]
    counts = []

    def keep(rows, values, ok):
        counts.append(len(rows))

    values, ok = solved_rows(made, rows, keep=keep)
    assert counts == [width, len(rows)]
    assert ok.all()
    # those of one design at a time, to the tolerance of the solver
    alone, _ = solved_rows(made, rows[-1:])
    np.testing.assert_allclose(values[-1:], alone, rtol=1e-11)
    assert solved_rows(made, rows[:0])[0].shape == (0, 1)
