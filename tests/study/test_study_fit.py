"""Least squares and its statistics, against closed forms solved by programs of their own.

Volumetric efficiency 1 + c - c r^(1/n) and work f n/(n-1) (r^((n-1)/n) - 1) times it, over the pressure
ratio r, with noise of 0.004 and 1 %; the truth is c 0.05, n 1.12, f 1.25. Expected values were found with
SciPy and Newton's method to rounding, with derivatives by hand.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput
from jaxcomp.study import Parameter, fit
from jaxcomp.study.identification._notes import _of_fit

RATIO = np.array([2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 7, 8, 9])
FILLING = np.array(
    [.9540, .9377, .9091, .9026, .8802, .8573, .8383, .8221, .8013, .7650, .7328, .6965]
)  # fmt: skip
WORK = np.array(
    [.8603, 1.1263, 1.3380, 1.4940, 1.6329, 1.7610, 1.8411, 1.8929, 1.9718, 2.0849, 2.1202, 2.1472]
)  # fmt: skip
MEASURED = np.concatenate([FILLING, WORK])
SD = np.concatenate([0.004 + 0 * FILLING, 0.01 * WORK])
UNKNOWN = (
    Parameter("c", 0.005, 0.5, 0.03),
    Parameter("n", 1.01, 1.6, 1.2),
    Parameter("f", 0.3, 4.0, 1.0),
)
# estimates within 1e-4 of a standard error, standard errors and correlations to the printed digits
DIGITS = 1e-5


def of(function):
    """A model by a function of the parameters, with its exact slopes."""
    both = jax.jit(lambda p: (function(p), jax.jacfwd(function)(p)))
    return lambda p: tuple(np.asarray(a) for a in both(p))


def cylinder(p):
    c, n, f = p
    filling = 1 + c - c * RATIO ** (1 / n)
    work = f * n / (n - 1) * (RATIO ** ((n - 1) / n) - 1) * filling
    return jnp.concatenate([filling, work])


MODEL = of(cylinder)


@pytest.fixture(scope="module")
def found():
    return fit(MODEL, UNKNOWN, MEASURED, SD)


def close(found, expected, error):
    np.testing.assert_array_less(np.abs(found.estimate - expected), 1e-4 * np.array(error))
    np.testing.assert_allclose(found.standard_error, error, rtol=DIGITS)


def test_estimates_and_standard_errors(found):
    # the printed digits of n and f are half a unit of the last, 4e-4 of a standard error
    assert found.converged
    np.testing.assert_allclose(found.estimate, [0.0500046, 1.12138, 1.24601], rtol=4e-6)
    np.testing.assert_allclose(
        found.standard_error, [0.00129794, 0.0128364, 0.0101330], rtol=DIGITS
    )
    off = found.correlation[[0, 0, 1], [1, 2, 2]]
    np.testing.assert_allclose(off, [0.969929, -0.856655, -0.922006], rtol=DIGITS)
    assert found.chi_square == pytest.approx(10.8296, rel=DIGITS)
    assert found.freedom == 21
    assert found.p_value == pytest.approx(0.966003, rel=DIGITS)
    assert found.minima == ()
    low, high = found.interval()
    np.testing.assert_allclose(low, [0.0474606, 1.09622, 1.22615], rtol=5e-6)
    np.testing.assert_allclose(high, [0.0525485, 1.14654, 1.26587], rtol=5e-6)


def test_profiles(found):
    expected = {"c": (0.0475200, 0.0526126), "n": (1.09667, 1.14701), "f": (1.22628, 1.26601)}
    for name, ends in expected.items():
        assert found.profile(name) == pytest.approx(ends, rel=5e-6)
    with pytest.raises(BadInput, match="one of c, n, f"):
        found.profile("m")


def test_the_weakest_direction_in_words(found):
    singular = [one.singular for one in found.directions]
    assert singular == pytest.approx([606.415, 230.205, 34.3136], rel=DIGITS)
    weakest = found.directions[-1]
    assert weakest.entries == pytest.approx([0.888633, 0.386107, -0.247492], abs=2e-6)
    assert weakest.words == "c up 10 % with n up 4.3 % and f down 2.8 %"
    assert not weakest.weak
    # a finite move: 0.1125 times the singular value, less what curvature takes away
    assert weakest.effect == pytest.approx(0.1 / 0.888633 * 34.3136, rel=0.1)


def test_of_a_weak_direction_of_many_parameters_three_are_told():
    """Two sums of eight parameters are all that is measured, so that any may stand for others."""
    names = [f"p{n}" for n in range(8)]
    parameters = tuple(Parameter(name, 0.1, 10.0, 1.0) for name in names)
    weights = jnp.arange(1.0, 9.0)
    model = of(lambda p: jnp.repeat(jnp.stack([weights @ p, weights @ p**2]), 4))
    direction = fit(model, parameters, np.full(8, 36.0), np.full(8, 0.1)).directions[-1]
    assert direction.unidentifiable
    told = [name for name in names if f"{name} " in direction.words]
    assert len(told) <= 3
    assert direction.words.endswith(" others by less")


def test_a_move_without_a_solution_is_told_by_the_slopes():
    """The model ends just beyond the estimate, within the move of 10 % of the weakest direction."""
    parameters = (Parameter("a", 0.1, 10.0, 1.0), Parameter("b", 0.1, 10.0, 1.0))
    inner = of(lambda p: jnp.concatenate([p[:1] * p[1:], 0.01 * p]))

    def model(p):
        value, slope = inner(p)
        return (value if p.max() < 1.02 else np.full(3, np.nan)), slope

    weakest = fit(model, parameters, np.array([1.0, 0.01, 0.01]), np.full(3, 0.01)).directions[-1]
    assert weakest.effect == pytest.approx(0.1 * np.sqrt(2), rel=1e-6)


def test_a_prior_is_a_reading_of_the_parameter():
    known = Parameter("n", 1.01, 1.6, 1.2, 1.15, 0.02, log=False)
    found = fit(MODEL, (UNKNOWN[0], known, UNKNOWN[2]), MEASURED, SD)
    # half a unit of the last printed digit
    np.testing.assert_allclose(found.estimate, [0.0508360, 1.12984, 1.23991], rtol=5e-6)
    np.testing.assert_allclose(
        found.standard_error, [0.00111974, 0.0108956, 0.00872066], rtol=DIGITS
    )
    assert found.chi_square == pytest.approx(12.2743, rel=DIGITS)
    assert found.prior_share[1] == pytest.approx(0.0108956 / 0.02, rel=DIGITS)
    assert np.isnan(found.prior_share[0])


def test_readings_without_weight_are_left_out():
    only = np.repeat([1.0, 0.0], 12)
    found = fit(of(lambda p: cylinder((*p, 1.25))), UNKNOWN[:2], MEASURED, SD, weight=only)
    close(found, found.estimate, [0.00347443, 0.0372582])
    np.testing.assert_allclose(found.estimate, [0.0521294, 1.14454], rtol=5e-6)
    assert found.correlation[0, 1] == pytest.approx(0.995178, rel=DIGITS)


def test_predictions_of_points_held_out():
    held = np.tile(RATIO > 5.5, 2)
    found = fit(MODEL, UNKNOWN, MEASURED, SD, weight=~held)
    np.testing.assert_allclose(found.estimate, [0.0491981, 1.10995, 1.25339], rtol=5e-6)
    np.testing.assert_allclose(
        found.standard_error, [0.00201678, 0.0227279, 0.0153070], rtol=DIGITS
    )
    assert found.chi_square == pytest.approx(9.05858, rel=DIGITS)
    said = found.predict(found.value[held], found.slope[held], SD[held])
    values = [0.802015, 0.765188, 0.728880, 0.693020, 1.970881, 2.058292, 2.109534, 2.132195]
    errors = [0.002314, 0.002871, 0.003521, 0.004254, 0.013815, 0.018828, 0.024050, 0.029376]
    np.testing.assert_allclose(said.value, values, atol=1e-6)
    np.testing.assert_allclose(said.model_sd, errors, atol=6e-7)
    np.testing.assert_allclose(said.half_width, 1.959964 * np.hypot(errors, SD[held]), rtol=1e-3)


def test_orifice_tells_the_product_alone():
    orifice = of(lambda p: 1e-3 * p[0] * p[1] * jnp.ones(6))
    both = (Parameter("flow coefficient", 0.3, 1.2, 0.6), Parameter("area", 50.0, 200.0, 100.0))
    reading = 0.06 * np.ones(6)
    found = fit(orifice, both, reading, 0.01 * reading)
    best, none = found.directions
    assert best.singular == pytest.approx(346.410, rel=DIGITS)  # sqrt(2 times 6) over 1 %
    assert none.unidentifiable
    assert none.entries == pytest.approx([0.5**0.5, -(0.5**0.5)], abs=1e-9) or (
        none.entries == pytest.approx([-(0.5**0.5), 0.5**0.5], abs=1e-9)
    )
    assert sorted(none.words.split(" with ")) in (
        ["area down 10 %", "flow coefficient up 10 %"],
        ["area up 10 %", "flow coefficient down 10 %"],
    )
    assert np.isinf(found.standard_error).all()
    known = (both[0], both[1]._replace(prior=100.0, sd=2.0))
    found = fit(orifice, known, reading, 0.01 * reading)
    relative = found.standard_error / found.estimate
    np.testing.assert_allclose(relative, [0.0204124, 0.02], rtol=DIGITS)
    assert found.correlation[0, 1] == pytest.approx(-0.979796, rel=DIGITS)
    product = found.covariance / np.outer(found.estimate, found.estimate)
    assert np.sqrt(product.sum()) == pytest.approx(0.00408248, rel=DIGITS)


@pytest.mark.parametrize(
    ("load", "singular", "weak", "unidentifiable"),
    [
        ((400.0, 500.0, 600.0, 700.0, 800.0), (224.091, 3.42526), (0.997839, 0.065704), False),
        ((600.0,) * 5, (224.043, 0.0), (0.998053, 0.0623783), True),
    ],
)
def test_friction_and_efficiency(load, singular, weak, unidentifiable):
    load = np.array(load)
    power = (load + 40) / 0.85
    unknown = (Parameter("friction", 10.0, 160.0, 50.0), Parameter("efficiency", 0.5, 1.0, 0.8))
    if unidentifiable:  # no single minimum: look at the truth
        unknown = (unknown[0]._replace(start=40.0), unknown[1]._replace(start=0.85))
    found = fit(of(lambda p: (load + p[0]) / p[1]), unknown, power, 0.01 * power, starts=1)
    assert [one.singular for one in found.directions] == pytest.approx(
        singular, rel=DIGITS, abs=1e-9
    )
    assert found.directions[-1].entries == pytest.approx(weak, abs=2e-6)
    if not unidentifiable:
        np.testing.assert_allclose(found.estimate, [40, 0.85], rtol=1e-6)
        relative = found.standard_error / found.estimate
        np.testing.assert_allclose(relative, [0.291318, 0.0196924], rtol=DIGITS)
        assert found.correlation[0, 1] == pytest.approx(0.973871, rel=DIGITS)
        assert found.directions[-1].words == "friction up 10 % with efficiency up 0.66 %"
    assert found.directions[-1].unidentifiable == unidentifiable


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say():
    truth = np.array([0.05, 1.12, 1.25])
    exact, _ = MODEL(truth)
    deviation = np.concatenate([0.004 + 0 * FILLING, 0.01 * exact[12:]])
    rng = np.random.default_rng(1)
    unknown = [p._replace(start=x) for p, x in zip(UNKNOWN, truth, strict=True)]
    inside = np.zeros(3)
    for _ in range(1000):
        read = exact + deviation * rng.standard_normal(24)
        sd = np.concatenate([deviation[:12], 0.01 * read[12:]])
        found = fit(MODEL, unknown, read, sd, starts=1)
        low, high = found.interval()
        inside += (low < truth) & (truth < high)
    # 1.5 % is 2.2 standard deviations of the share in 1,000
    np.testing.assert_allclose(inside / 1000, 0.95, atol=0.015)


def test_a_missing_law_rejects_the_model():
    wrong = 1 - 0.03 * np.exp(-(RATIO - 2) / 1.5)
    found = fit(MODEL, UNKNOWN, MEASURED * np.tile(wrong, 2), SD)
    assert found.p_value < 0.01
    assert found.scatter > 1.4
    plain, inflated = (found.interval(inflated=kind)[1] for kind in (False, True))
    assert (inflated - found.estimate > 1.4 * (plain - found.estimate)).all()


def test_a_robust_loss_gives_little_to_an_outlier():
    spoilt = MEASURED.copy()
    spoilt[3] += 0.2
    plain = fit(MODEL, UNKNOWN, spoilt, SD)
    robust = fit(MODEL, UNKNOWN, spoilt, SD, loss="soft_l1")
    assert np.argmin(robust.robust) == 3
    assert robust.robust[3] < 0.1
    assert abs(robust.estimate[0] - 0.05) < 0.2 * abs(plain.estimate[0] - 0.05)
    assert fit(MODEL, UNKNOWN, spoilt, SD, loss="huber").robust[3] < 0.1


def test_a_point_without_value_shortens_the_step():
    def fails(p):
        value, slope = MODEL(p)
        return np.where(p[0] > 0.08, np.nan, value), slope

    start = (UNKNOWN[0]._replace(start=0.012), *UNKNOWN[1:])
    found = fit(fails, start, MEASURED, SD)
    assert found.estimate[0] == pytest.approx(0.0500046, rel=4e-6)
    assert found.failed_starts > 0
    with pytest.raises(BadInput, match="have a computed value"):
        fit(fails, (UNKNOWN[0]._replace(start=0.2), *UNKNOWN[1:]), MEASURED, SD, starts=1)


def test_a_fit_that_cannot_move_says_so():
    """Beside a start that has a value nothing has: no step tells of a minimum."""
    start = np.array([one.start for one in UNKNOWN])

    def only_there(p):
        value, slope = MODEL(p)
        return np.where(np.abs(p - start).max() > 1e-7, np.nan, value), slope

    found = fit(only_there, UNKNOWN, MEASURED, SD, starts=1)
    assert found.stuck
    assert not found.converged
    assert found.lost_steps > 0
    np.testing.assert_allclose(found.estimate, start, rtol=1e-6)
    told = [*_of_fit(found, SimpleNamespace(measurements=()))]
    assert "the fit never moved" in told[0]
    assert not any("does not explain" in one for one in told)


def test_a_fit_that_is_stuck_goes_on_from_another_start():
    """An island without a way off it, and the truth elsewhere."""

    def moat(p):
        value, slope = MODEL(p)
        inner, outer = (np.abs(p[0] / 0.03 - 1) < width for width in (1e-7, 0.2))
        return np.where(outer and not inner, np.nan, value), slope

    lone = fit(moat, UNKNOWN, MEASURED, SD, starts=1)
    assert lone.converged
    assert not lone.stuck
    assert lone.estimate[0] == pytest.approx(0.0500046, rel=4e-6)


def test_a_bound_that_holds_a_parameter_is_told():
    found = fit(MODEL, (UNKNOWN[0]._replace(high=0.04), *UNKNOWN[1:]), MEASURED, SD)
    assert found.at_bound.tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"loss": "cauchy"}, "one of linear"),
        ({"sd": 0.0}, "positive"),
        ({"weight": np.arange(24) < 2}, "at least 3, one for each parameter"),
    ],
)
def test_what_cannot_be_fitted(change, text):
    with pytest.raises(BadInput, match=text):
        fit(MODEL, UNKNOWN, MEASURED, **({"sd": SD} | change))
