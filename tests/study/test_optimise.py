"""The optimiser on functions of design numbers whose optima are known, and beside SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
import scipy.optimize

from jaxcomp import BadInput, SolveFailed, load, optimise, pareto, problem
from jaxcomp.study._goal import ranges_of
from jaxcomp.study._optimise import even_sample
from jaxcomp.study._pareto import dominated

X, Y = "mechanism.piston_mass", "mechanism.conrod_mass"
# The slope that is left is 1e-5 of the spread over the range. Curvatures here are of order one in
# spreads over ranges but along the valley of Rosenbrock's function, so places are good to 1e-4.
NEAR = 1e-4


def point(found):
    mechanism = found.design.compressor.mechanism
    return mechanism.piston_mass, mechanism.conrod_mass


def rosenbrock_of(x, y):
    return 100 * (y - x**2) ** 2 + (1 - x) ** 2


def bowl_of(x, y):
    return (x - 3) ** 2 / 2 + 2 * (y - 0.7) ** 2


def rosenbrock(found):
    return rosenbrock_of(*point(found))


def bowl(found):
    return bowl_of(*point(found))


def total(found):
    x, y = point(found)
    return x + y


def broken(found):
    """The bowl, which cannot be solved beyond x = 2."""
    x, y = point(found)
    return jnp.where(x > 2, jnp.nan, bowl_of(x, y))


def wells(found):
    """A narrow deep well at (2.5, 2.5) beside a wide one at (0.8, 0.8)."""
    x, y = point(found)
    wide = jnp.exp(-((x - 0.8) ** 2 + (y - 0.8) ** 2))
    return -wide - 2 * jnp.exp(-12 * ((x - 2.5) ** 2 + (y - 2.5) ** 2))


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


def asked(scene, quantity, low=0.0, high=3.0):
    return problem(scene, {X: (low, high), Y: (low, high)}, [quantity])


def by_scipy(function, low, high, start, **options):
    slope = jax.grad(lambda p: function(*p))
    found = scipy.optimize.minimize(
        lambda p: float(function(*p)),
        start,
        jac=lambda p: np.asarray(slope(jnp.asarray(p))),
        bounds=[(low, high)] * 2,
        tol=1e-12,
        **options,
    )
    assert found.success, found.message
    return found.x


def values(found):
    return np.array([found.values[X], found.values[Y]])


def test_rosenbrock_from_all_starts(scene):
    found = optimise(asked(scene, rosenbrock))
    np.testing.assert_allclose(values(found), [1, 1], atol=NEAR)
    np.testing.assert_allclose(
        values(found), by_scipy(rosenbrock_of, 0, 3, [2, 0.5], method="L-BFGS-B"), atol=NEAR
    )
    assert all(start.status == "converged" for start in found.starts)
    assert found.agreeing >= 6  # the valley is so flat that 1e-5 leaves some at 2e-3
    assert found.verdict == "no better design among 256 samples"
    assert (found.at_bound, found.local) == ({}, False)
    assert found.evaluations == sum(start.steps for start in found.starts) < 220  # 167 measured
    # what it says of itself
    x, y = found.values.values()
    assert found.objective == pytest.approx(rosenbrock_of(x, y), rel=1e-9)
    slope = jax.grad(rosenbrock_of, (0, 1))(x, y)
    np.testing.assert_allclose([found.gradient[X], found.gradient[Y]], slope, atol=1e-10)
    assert point(found)[0] == found.values[X]


def test_bounds_hold_throughout_and_are_named(scene):
    found = optimise(asked(scene, bowl, 0.0, 2.0))
    assert found.values[X] == 2  # the bound holds exactly
    # a slope of 1e-5 leaves less; 1e-6 is what SciPy knows its own optimum to
    np.testing.assert_allclose(values(found), [2, 0.7], atol=1e-6)
    np.testing.assert_allclose(
        values(found), by_scipy(bowl_of, 0, 2, [1, 1], method="L-BFGS-B"), atol=1e-6
    )
    assert found.at_bound == {X: "high"}
    assert found.gradient[X] == pytest.approx(-1, rel=1e-6)
    assert found.agreeing == len(found.starts) == 8
    path = np.concatenate([start.path for start in found.starts])
    assert np.all((path >= 0) & (path <= 2))


@pytest.mark.parametrize("interval", [(None, 2.0), (2.0, 2.0)])
def test_constraint_is_met_with_the_known_multiplier(scene, interval):
    """x + y = 2 puts the bowl at (1.64, 0.36), where it falls by 1.36 per unit of the bound."""
    found = optimise(asked(scene, bowl, 0.0, 5.0), constraints={total: interval})
    np.testing.assert_allclose(values(found), [1.64, 0.36], atol=NEAR)
    kind = "eq" if interval[0] else "ineq"
    limit = {"type": kind, "fun": lambda p: 2 - p[0] - p[1]}
    exact = by_scipy(bowl_of, 0, 5, [1, 1], method="SLSQP", constraints=[limit])
    np.testing.assert_allclose(values(found), exact, atol=NEAR)
    (one,) = found.constraints
    assert one.multiplier == pytest.approx(-1.36, abs=NEAR)
    assert (one.active, one.violation, one.name) == (True, 0.0, "total")
    assert one.value == pytest.approx(2, abs=1e-5)  # a millionth of the spread, twice over
    assert all(start.status == "converged" for start in found.starts)
    assert found.agreeing == 8


def test_slack_constraint_has_no_multiplier(scene):
    found = optimise(asked(scene, bowl, 0.0, 5.0), constraints={total: (1.0, 4.5)})
    np.testing.assert_allclose(values(found), [3, 0.7], atol=NEAR)
    assert [(c.side, c.active, c.multiplier) for c in found.constraints] == [
        ("lower", False, 0),
        ("upper", False, 0),
    ]


def other(found):
    x, y = point(found)
    return 2 * x - y


def test_multipliers_of_an_active_and_a_slack_constraint(scene):
    """On 2x - y = 1 the bowl is least at x = 16.6/17, where x + y < 2 is slack.

    Its slope along the line vanishes, (x - 3) + 2 * 4 (2x - 1.7) = 0, and across it (x - 3) = -2 b.
    """
    found = optimise(
        asked(scene, bowl, 0.0, 5.0), constraints={total: (None, 2.0), other: (None, 1.0)}
    )
    x = 16.6 / 17
    np.testing.assert_allclose(values(found), [x, 2 * x - 1], atol=NEAR)
    slack, active = found.constraints
    assert (slack.active, slack.multiplier) == (False, 0)
    assert active.multiplier == pytest.approx(-(3 - x) / 2, abs=NEAR)


def test_impossible_constraint_is_a_status(scene):
    found = optimise(asked(scene, bowl, 0.0, 5.0), constraints={total: (None, -2.0)})
    assert found.status == "no feasible design"
    assert {start.status for start in found.starts} == {"no feasible design"}
    assert found.constraints[0].violation > 0.1
    assert found.verdict == (
        "no design found within the ranges keeps its limits: the nearest breaks total <= -2 by 2"
    )
    assert list(found.values.values()) == [0, 0]  # where the total of both is least
    assert found.constraints[0].excess == pytest.approx(2, rel=1e-9)


def test_targets_are_met_by_least_squares(scene):
    goals = {rosenbrock: 0.0, total: 2.0}
    found = optimise(asked(scene, bowl), goals, tolerance=1e-7)
    assert found.objective < 1e-9  # both can be met, at (1, 1)
    assert found.quantities["total"] == pytest.approx(2, abs=NEAR)
    assert found.objective_name == "residuals"


def test_targets_at_odds_are_the_same_compromise_by_both_methods(scene):
    goals = {bowl: 0.0, total: 2.0}  # the bowl is zero where the total is 3.7
    one = optimise(asked(scene, bowl), goals, method="least-squares")
    other = optimise(asked(scene, bowl), goals, method="slsqp")
    np.testing.assert_allclose(values(one), values(other), atol=NEAR)
    assert one.status == other.status == "converged"
    # with a constraint, which the method then keeps by itself
    assert one.quantities["total"] > 2.15
    held = optimise(asked(scene, bowl), goals, constraints={total: (None, 2.1)})
    assert held.quantities["total"] == pytest.approx(2.1, abs=1e-5)
    # half the squared misses in spreads: its slope in the bound, by differences of the optimum
    near = [
        optimise(asked(scene, bowl), goals, constraints={total: (None, bound)}).objective
        for bound in (2.09, 2.11)
    ]
    slope = (near[1] - near[0]) / 0.02
    assert held.constraints[0].multiplier == pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize("method", ["adam", optax.sgd(0.05, momentum=0.8)])
def test_first_order_methods_end_at_the_same_place(scene, method):
    found = optimise(asked(scene, bowl, 0.0, 5.0), method=method, max_steps=600)
    np.testing.assert_allclose(values(found), [3, 0.7], atol=NEAR)
    assert found.status == "converged"
    np.testing.assert_allclose(
        values(found), values(optimise(asked(scene, bowl, 0.0, 5.0))), atol=NEAR
    )


@pytest.mark.parametrize("method", ["slsqp", "adam", "least-squares"])
def test_designs_that_fail_are_never_accepted(scene, method):
    """The bowl falls towards x = 3, where nothing can be solved beyond 2."""
    goal = {broken: 0.0} if method == "least-squares" else None
    found = optimise(asked(scene, broken, 0.0, 5.0), goal, method=method, max_steps=300)
    assert not np.concatenate([start.solved for start in found.starts]).all()
    assert all(np.all(start.path[:, 0] <= 2) for start in found.starts)
    assert found.values[X] == pytest.approx(2, abs=0.1)
    assert all(np.all(np.diff(start.objectives) <= 0) for start in found.starts)
    assert not found.sample.ok.all()
    assert found.status in ("no better step", "step limit")


def test_start_that_fails_is_a_status_and_spoils_no_other(scene):
    found = optimise(asked(scene, broken, 0.0, 2.5), starts=[[2.4, 1.0]] + 7 * [[0.5, 1.0]])
    assert found.starts[0].status == "start not solvable"
    assert found.starts[0].steps == 1
    assert np.isnan(found.starts[0].objective)
    assert found.values[X] == pytest.approx(2, abs=0.1)


def test_starts_that_all_fail_are_a_status(scene):
    found = optimise(
        asked(scene, broken, 0.0, 2.5),
        starts=[[2.4, 1.0], [2.2, 0.5]],
        constraints={total: (2.0, 2.0)},
    )
    assert found.status == "start not solvable"
    assert not found.feasible
    assert np.isnan(found.objective)
    assert found.verdict == "no start and none of 258 samples keeps all constraints"


def test_a_failing_design_on_the_way_does_not_keep_from_the_optimum(scene):
    """A band that cannot be solved, beyond the optimum at (3, 0.7), meets the first long steps."""

    def banded(found):
        x, y = point(found)
        return jnp.where((x > 3.5) & (x < 4.5), jnp.nan, bowl_of(x, y))

    found = optimise(asked(scene, banded, 0.0, 5.0), starts=[[0.2, 4.5], [1.0, 0.1], [5.0, 3.0]])
    assert not np.concatenate([start.solved for start in found.starts]).all()
    np.testing.assert_allclose(values(found), [3, 0.7], atol=NEAR)
    assert found.status == "converged"


def kinked(found):
    x, y = point(found)
    return jnp.abs(x - 1.2) + (y - 0.7) ** 2


def test_a_kink_is_no_converged_optimum(scene):
    found = optimise(asked(scene, kinked))
    assert found.values[X] == pytest.approx(1.2, abs=1e-2)
    assert found.status in ("no better step", "step limit")
    short = optimise(asked(scene, rosenbrock), max_steps=3)
    assert short.status == "step limit"
    assert max(start.steps for start in short.starts) == 3


def test_a_better_sample_is_told_or_followed(scene):
    given = optimise(asked(scene, wells), starts=8 * [[0.5, 0.6]])
    np.testing.assert_allclose(values(given), [0.8, 0.8], atol=0.01)
    assert given.local
    assert given.verdict.startswith("a local optimum: one of 264 samples is better")
    found = optimise(asked(scene, wells))
    np.testing.assert_allclose(values(found), [2.5, 2.5], atol=0.01)
    assert not found.local
    assert found.agreeing < 8
    # from one start, which is the best of the sample
    alone = optimise(asked(scene, wells), starts=1)
    np.testing.assert_allclose(values(alone), [2.5, 2.5], atol=0.01)


def test_a_start_that_keeps_no_constraint_beside_a_sample_that_does(scene):
    """From a plateau whose constraint has no slope; only the sample knows where it is kept."""

    def step(found):
        x, y = point(found)
        return jnp.where(x > 2.5, 0.0, 1.0) + 0 * y

    found = optimise(
        asked(scene, total), constraints={step: (None, 0.5)}, starts=[[0.5, 0.5], [1.0, 2.0]]
    )
    assert not found.feasible
    assert found.status == "no feasible design"
    assert found.verdict == "no start keeps all constraints, but one of 258 samples does"
    assert found.local
    assert optimise(asked(scene, total), constraints={step: (None, 0.5)}).feasible


def test_what_a_callback_raises_ends_the_search(scene):
    seen = []

    def stop(stage, done, total):
        seen.append((stage, done, total))
        if (stage, done) == ("descent", 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        optimise(asked(scene, rosenbrock), samples=64, max_steps=50, callback=stop)
    most = 8 * 50
    samples = [("sample", count, 64) for count in range(8, 65, 8)]
    assert seen == [*samples, ("descent", 1, most), ("descent", 2, most)]


def test_sample_is_even_and_its_beginning_as_well(scene):
    ranges = ranges_of(asked(scene, bowl).variables)
    points = even_sample(ranges, 256, 0) / 3
    assert np.all((points >= 0) & (points < 1))
    for count in (16, 256):
        boxes = np.floor(points[:count] * np.sqrt(count / 4)).astype(int)
        # a quarter as many boxes as points: a random scatter leaves 2 % of them empty, this none
        assert len(np.unique(boxes, axis=0)) == count // 4
    assert not np.allclose(points, even_sample(ranges, 256, 1) / 3)


def near(found):
    x, y = point(found)
    return (x - 1) ** 2 + y**2


def far(found):
    x, y = point(found)
    return (x - 3) ** 2 + y**2


def test_multipliers_count_the_slope_that_a_bound_of_a_range_holds(scene):
    """Both constraints and the upper bound of x hold: (x - 3, 4 (y - 0.7)) = -(a + c, a) at (1, 0.5)."""
    made = problem(scene, {X: (0.0, 1.0), Y: (0.0, 5.0)}, [bowl])
    found = optimise(made, constraints={total: (None, 1.5)})
    np.testing.assert_allclose(values(found), [1, 0.5], atol=NEAR)
    assert found.at_bound == {X: "high"}
    assert found.status == "converged"
    assert found.constraints[0].multiplier == pytest.approx(4 * (0.5 - 0.7), abs=NEAR)


def test_front_of_two_bowls_is_the_line_between_them(scene):
    """Between the centres (1, 0) and (3, 0): sqrt(a) + sqrt(b) = 2, da/db = -sqrt(a/b)."""
    made = problem(scene, {X: (0.5, 4.0), Y: (0.0, 3.0)}, [near])
    front = pareto(made, (near, far), points=9)
    assert len(front.values) == 9
    assert set(front.status) == {"converged"}
    a, b = front.objectives.T
    # distances whose squares are good to 1e-5 of their spread
    np.testing.assert_allclose(np.sqrt(a) + np.sqrt(b), 2, atol=5e-3)
    np.testing.assert_allclose(front.exchange[1:-1], -np.sqrt(a[1:-1] / b[1:-1]), rtol=2e-3)
    assert np.all(np.isnan(front.exchange[[0, -1]]))
    assert np.all(np.diff(a) > 0)
    assert np.all(np.diff(b) < 0)
    assert not front.dominated.any()
    assert front.beaten_by == 0
    gaps = np.hypot(*np.diff(front.objectives, axis=0).T) / 4
    assert gaps.max() < 0.33  # of the whole range; levels of one objective alone leave 0.4


def test_front_without_conflict_is_one_design(scene):
    front = pareto(asked(scene, bowl, 0.0, 5.0), (bowl, twice), points=5)
    assert len(front.values) == 1
    np.testing.assert_allclose(front.values[0], [3, 0.7], atol=NEAR)


def twice(found):
    return 2 * bowl(found) + 1


def test_dominated_points_are_found():
    points = np.array([[0, 4.0], [1, 2.0], [1.5, 2.0], [2, 1.0], [2, 3.0], [4, 0.0]])
    assert dominated(points, 1e-4).tolist() == [False, False, True, False, True, False]


def refused(scene, quantity=bowl, ranges=None, **options):
    with pytest.raises(BadInput) as caught:
        optimise(problem(scene, ranges or {X: (0.0, 3.0)}, [quantity]), **options)
    return str(caught.value)


def test_refusals_name_field_value_and_bound(scene):
    wanted = "`mechanism.piston_mass` must be given a range with two finite ends"
    assert wanted in refused(scene, ranges=[X])
    assert "range that rises from 2" in refused(scene, ranges={X: (2.0, 2.0)})
    assert "`method` must be one of slsqp" in refused(scene, method="newton")
    held = {"constraints": {total: (None, 2.0)}}
    for method in ("adam", optax.sgd(0.1), "least-squares"):
        assert "`method` must be 'slsqp' with constraints" in refused(scene, method=method, **held)
    assert "without targets" in refused(scene, method="least-squares")
    assert "gas_power is not better in either direction" in refused(scene, "gas_power")
    assert "`total` must be given a lower bound below the upper" in refused(
        scene, constraints={total: (3.0, 2.0)}
    )
    assert "`total` must be given a lower or an upper" in refused(
        scene, constraints={total: (None, None)}
    )
    assert "`total` must be given finite bounds" in refused(
        scene, constraints={total: (None, np.nan)}
    )
    assert "`starts` must be a number >= 1 and <= 10000, but is 0" in refused(scene, starts=0)
    assert f"`starts.{X}` must be >= 0 and <= 3, but is 4" in refused(scene, starts=[[4.0]])
    assert "of shape (starts, 1)" in refused(scene, starts=[[1.0, 2.0]])
    assert "`tolerance` must be > 0 and < 1" in refused(scene, tolerance=0.0)
    assert "`max_steps` must be >= 1" in refused(scene, max_steps=0)
    assert "`objective` must be a quantity" in refused(scene, objective={})
    assert "crank_pin" in refused(scene, constraints={"peak_force.crank_pn": (None, 1.0)})
    with pytest.raises(BadInput, match="two different quantities"):
        pareto(asked(scene, bowl), (bowl, bowl))
    with pytest.raises(BadInput, match="`points` must be a number >= 3"):
        pareto(asked(scene, bowl), (bowl, total), points=2)


def test_nothing_that_can_be_solved_is_an_error(scene):
    with pytest.raises(SolveFailed, match="none of 256 designs could be solved"):
        optimise(problem(scene, {X: (2.7, 3.0)}, [broken]))
