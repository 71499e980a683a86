"""Balancing methods on plain numbers: exact cases, proofs of optimality, stocks, files."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jaxcomp import BadInput, SceneError, Status
from jaxcomp.balancing import (
    bounded,
    discrete,
    least_squares,
    min_max,
    permissible_unbalance,
    rigid_balance,
    select,
    stock,
    trial_influence,
)
from jaxcomp.balancing._discrete import split
from jaxcomp.balancing._influence import Influence, InfluenceRow
from jaxcomp.rotor import Unbalances
from jaxcomp.scene.measurements import read_measurements


def system(rows, planes, seed=0, noise=1.0):
    """A system whose best correction is of order one, with `noise` that no correction removes."""
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.normal(size=shape) + 1j * rng.normal(size=shape)  # noqa: E731
    matrix, planted = draw(rows, planes), draw(planes)
    labels = tuple(InfluenceRow(f"t{i}", "ux", 300.0) for i in range(rows))
    names = tuple(f"p{i}" for i in range(planes))
    weight = jnp.asarray(rng.uniform(0.5, 2.0, rows))
    initial = -matrix @ planted + noise * draw(rows)
    return Influence(jnp.asarray(matrix), jnp.asarray(initial), weight, labels, names), planted


# ---------------------------------------------------------------- sum of squares
def test_planted_unbalance_is_recovered():
    square, planted = system(3, 3, noise=0.0)
    # a condition of about 10 leaves 15 digits
    np.testing.assert_allclose(least_squares(square).correction, planted, rtol=1e-12)
    tall, planted = system(9, 3, noise=0.0)
    balance = least_squares(tall)
    np.testing.assert_allclose(balance.correction, planted, rtol=1e-12)
    assert float(balance.improvement) < 1e-12


def test_least_squares_satisfies_the_normal_equations():
    tall, _ = system(9, 3)
    balance = least_squares(tall)
    matrix, initial = tall.weighted
    left = matrix.conj().T @ (initial + matrix @ balance.correction)
    np.testing.assert_allclose(left, 0.0, atol=1e-12 * float(jnp.linalg.norm(initial)))


def test_minimum_norm_among_many():
    wide, _ = system(2, 4)
    balance = least_squares(wide)
    np.testing.assert_allclose(balance.residual, 0.0, atol=1e-12)
    expected = -np.linalg.pinv(np.asarray(wide.weighted[0])) @ np.asarray(wide.weighted[1])
    np.testing.assert_allclose(balance.correction, expected, atol=1e-12)


def test_planes_that_nearly_coincide_are_cut():
    """Two planes of nearly the same effect: all digits go into their difference, unless it is cut."""
    base, _ = system(6, 1)
    rng = np.random.default_rng(5)
    twin = base.matrix[:, 0] * (1 + 1e-12 * rng.normal(size=6))
    near = Influence(
        jnp.stack([base.matrix[:, 0], twin], 1), base.initial, base.weight, base.rows, ("a", "b")
    )
    cut = least_squares(near, cut=1e-8)
    assert float(least_squares(near, cut=0.0).condition) > 1e11
    # half of the one-plane answer in each
    one = least_squares(base).correction[0]
    np.testing.assert_allclose(cut.correction, [one / 2, one / 2], rtol=1e-6)


def test_tikhonov_trades_vibration_for_mass():
    tall, _ = system(9, 3)
    sizes, rests = [], []
    for penalty in (0.0, 0.3, 1.0, 3.0):
        balance = least_squares(tall, tikhonov=penalty)
        sizes.append(float(jnp.linalg.norm(balance.correction)))
        rests.append(float(balance.objective))
    assert np.all(np.diff(sizes) < 0)
    assert np.all(np.diff(rests) > 0)
    # the penalised normal equations
    penalty = 0.3
    matrix, initial = (np.asarray(x) for x in tall.weighted)
    size = penalty * np.linalg.norm(matrix, 2)
    full = np.vstack([matrix, size * np.eye(3)])
    expected = np.linalg.lstsq(full, -np.append(initial, np.zeros(3)), rcond=None)[0]
    got = least_squares(tall, tikhonov=penalty).correction
    np.testing.assert_allclose(got, expected, rtol=1e-11)


def test_derivative_of_the_balance_equals_differences():
    tall, _ = system(5, 2)

    def residual(shift):
        moved = Influence(
            tall.matrix * (1 + shift), tall.initial, tall.weight, tall.rows, tall.planes
        )
        return jnp.abs(least_squares(moved).correction[0])

    step = 1e-4
    estimate = (residual(step) - residual(-step)) / (2 * step)
    # h^2 of the central difference
    assert float(jax.grad(residual)(0.0)) == pytest.approx(float(estimate), rel=1e-7)


# ---------------------------------------------------------------- bounds and the largest vibration
def test_wide_bounds_change_nothing():
    tall, _ = system(9, 3)
    balance = bounded(tall, 100.0, tolerance=1e-14)
    np.testing.assert_allclose(balance.correction, least_squares(tall).correction, atol=1e-6)


def test_bounded_masses_are_optimal_by_their_own_proof():
    tall, _ = system(9, 3)
    free = np.abs(least_squares(tall).correction)
    largest = 0.6 * free
    balance = bounded(tall, largest, tolerance=1e-10)
    assert np.all(np.abs(balance.correction) <= largest * (1 + 1e-12))
    assert 0 <= float(balance.gap) < 1e-8
    # and no random admissible correction is better
    rng = np.random.default_rng(1)
    for _ in range(200):
        other = largest * np.sqrt(rng.uniform(size=3)) * np.exp(2j * np.pi * rng.uniform(size=3))
        rest = tall.weight * tall.vibration(jnp.asarray(other))
        assert float(jnp.linalg.norm(rest)) >= float(balance.bound)


def slsqp(influence, largest):
    """The least norm within bounds by SciPy, with bounds and vibration of order one."""
    matrix, initial = (np.asarray(x) for x in influence.weighted)
    matrix, size = matrix * largest, np.linalg.norm(initial)
    real = np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]]) / size
    right = np.append(initial.real, initial.imag) / size
    count = matrix.shape[1]
    answer = minimize(
        lambda x: 0.5 * np.sum((real @ x + right) ** 2),
        np.zeros(2 * count),
        jac=lambda x: real.T @ (real @ x + right),
        method="SLSQP",
        constraints={
            "type": "ineq",
            "fun": lambda x: 1 - np.sum(x.reshape(2, count) ** 2, 0),
            "jac": lambda x: -2 * np.tile(np.eye(count), 2) * x,
        },
        options={"ftol": 1e-15, "maxiter": 1000},
    )
    return size * np.sqrt(2 * answer.fun)


@pytest.mark.parametrize(
    "case", [pytest.param(n, marks=pytest.mark.slow) if n >= 7 else n for n in range(20)]
)
def test_bounded_masses_equal_those_of_another_solver(case):
    rng = np.random.default_rng(case)
    rows, planes = int(rng.integers(2, 9)), int(rng.integers(1, 5))
    influence, planted = system(rows, planes, seed=case, noise=10 ** rng.uniform(-3, 0.5))
    largest = np.abs(planted) * 10 ** rng.uniform(-1, 1, planes)
    found = bounded(influence, largest)
    assert found.converged
    assert np.all(np.abs(found.correction) <= largest)
    assert float(found.bound) <= float(found.objective)
    # SLSQP ends some 1e-8 of the vibration before above the optimum
    before = float(jnp.linalg.norm(influence.weighted[1]))
    assert float(found.objective) == pytest.approx(slsqp(influence, largest), abs=1e-7 * before)


def test_bounded_masses_of_nearly_equal_planes_and_planes_of_very_different_effect():
    rng = np.random.default_rng(7)
    solve = jax.jit(bounded)
    for case in range(300):
        base, planted = system(8, 3, seed=case, noise=10 ** rng.uniform(-11, 0.5))
        matrix, scale = np.array(base.matrix), np.ones(3)
        if case % 2:
            scale = 10 ** rng.uniform(-6, 6, 3)
        else:
            matrix[:, 1] = matrix[:, 0] * (1 + 10 ** rng.uniform(-12, -2) * rng.normal(size=8))
        matrix = jnp.asarray(matrix * scale)
        influence = Influence(matrix, base.initial, base.weight, base.rows, base.planes)
        largest = jnp.asarray(np.abs(planted) / scale * 10 ** rng.uniform(-3, 3, 3))
        found = solve(influence, largest)
        assert found.converged, case
        # closed to the tolerance of 1e-10 of the squares, or to rounding
        high, low = float(found.objective), float(found.bound)
        before = float(jnp.linalg.norm(influence.weighted[1]))
        assert high - low <= 0.51e-10 * high + 1.1e-12 * before


def test_a_descent_that_is_stopped_says_so():
    influence, _ = system(9, 3)
    assert bounded(influence, 0.1, max_steps=2).status == Status.not_converged
    assert min_max(influence, max_steps=2).status == Status.not_converged
    assert bounded(influence, 0.1).status == min_max(influence).status == Status.converged


def test_bounded_masses_of_many_bounds_at_once():
    influence, _ = system(9, 3)
    bounds = jnp.asarray([0.1, 1.0, 10.0])
    found = jax.vmap(lambda largest: bounded(influence, largest).objective)(bounds)
    alone = [float(bounded(influence, one).objective) for one in bounds]
    np.testing.assert_allclose(found, alone, rtol=1e-9)


@pytest.mark.parametrize("method", [least_squares, min_max, lambda system: bounded(system, 1.0)])
def test_numbers_that_are_none_are_marked_under_jit(method):
    base, _ = system(3, 3)

    def solved(bad):
        matrix = base.matrix.at[0, 0].set(bad)
        found = method(Influence(matrix, base.initial, base.weight, base.rows, base.planes))
        return found.correction, found.status

    correction, status = jax.jit(solved)(jnp.nan)
    assert status == Status.bad_input
    assert not np.any(np.isfinite(correction))
    assert jax.jit(solved)(1.0)[1] == Status.converged


def test_a_singular_system_is_marked():
    base, _ = system(2, 2)
    for twin in (base.matrix[:, 0], base.matrix[:, 0] * (1 + 1e-15), 0 * base.matrix[:, 0]):
        matrix = jnp.stack([base.matrix[:, 0], twin], 1)
        one = Influence(matrix, base.initial, base.weight, base.rows, base.planes)
        assert least_squares(one).status == Status.converged


def test_a_stock_of_numbers_that_are_none_is_refused():
    influence, _ = system(4, 2)
    for bad in (np.nan, np.inf, 1 + 1j * np.nan):
        with pytest.raises(BadInput, match="finite"):
            discrete(influence, [np.array([0, 1, bad]), np.array([0, 1])])
    with pytest.raises(BadInput, match="finite"):
        split(np.nan, [0.0, 1.0], 0.1)


def test_a_system_needs_planes_and_rows():
    influence, _ = system(4, 2)
    with pytest.raises(BadInput, match="`planes` must be at least one"):
        select(influence, planes=[])
    with pytest.raises(BadInput, match="`rows` must be at least one"):
        select(influence, targets=[])


def test_bound_of_zero_is_refused():
    with pytest.raises(BadInput, match="> 0"):
        bounded(system(4, 2)[0], 0.0)


def test_min_max_is_optimal_by_duality():
    tall, _ = system(9, 2)
    balance = min_max(tall)
    largest = float(jnp.max(tall.weight * jnp.abs(balance.residual)))
    assert largest == pytest.approx(float(balance.objective), rel=1e-12)
    # the tolerance of the method
    assert float(balance.bound) >= float(balance.objective) * (1 - 1.1e-6)
    squares = least_squares(tall)
    assert largest < 0.98 * float(jnp.max(tall.weight * jnp.abs(squares.residual)))
    assert float(squares.objective) < float(jnp.linalg.norm(tall.weight * balance.residual))


def test_min_max_of_a_square_system_vanishes():
    square, planted = system(3, 3, noise=0.0)
    balance = min_max(square)
    np.testing.assert_allclose(balance.correction, planted, rtol=1e-9)


# ---------------------------------------------------------------- stocks
@pytest.mark.parametrize("planes", [1, 2, 3])
def test_discrete_search_equals_enumeration(planes):
    tall, _ = system(7, planes, seed=planes)
    options = [stock([0.5, 1.0, 1.7], np.arange(5) * 2 * np.pi / 5, 1.0)] * planes
    balance = discrete(tall, options)
    matrix, initial = (np.asarray(x) for x in tall.weighted)
    every = [
        np.linalg.norm(initial + matrix @ np.array(choice))
        for choice in itertools.product(*options)
    ]
    assert float(balance.objective) == pytest.approx(min(every), rel=1e-12)
    assert float(balance.gap) == 0.0
    assert float(least_squares(tall).objective) <= float(balance.objective)


def test_discrete_search_that_ends_early_states_its_gap():
    tall, _ = system(7, 3, seed=3)
    options = [stock([0.2, 0.5, 1.0, 1.7], np.arange(12) * np.pi / 6, 1.0)] * 3
    full, early = discrete(tall, options), discrete(tall, options, most=50)
    assert float(full.gap) == 0.0
    assert float(early.bound) <= float(full.objective) <= float(early.objective)
    assert float(early.gap) > 0


def test_split_over_holes_stands_for_the_correction():
    angles = np.arange(8) * np.pi / 4
    parts = split(0.01 * np.exp(0.3j), angles, 0.05)
    assert np.count_nonzero(parts.masses) == 2
    total = np.sum(parts.masses * 0.05 * np.exp(1j * angles))
    # the trace of the mass itself is 1e-7 of the radius
    assert abs(total - 0.01 * np.exp(0.3j)) < 1e-8
    assert abs(parts.error) < 1e-8
    # law of sines
    expected = 0.01 / 0.05 * np.sin(np.pi / 4 - 0.3) / np.sin(np.pi / 4)
    assert parts.masses[0] == pytest.approx(expected, rel=1e-6)


def test_full_holes_hand_over_to_their_neighbours():
    angles = np.arange(8) * np.pi / 4
    parts = split(0.01 * np.exp(0.3j), angles, 0.05, largest=0.1)
    assert np.all(parts.masses <= 0.1 + 1e-12)
    assert np.count_nonzero(parts.masses) > 2
    small = split(0.01, angles, 0.05, largest=0.01)
    assert abs(small.error) > 0.005


# ---------------------------------------------------------------- evidence
def test_sensitivity_is_the_change_of_the_vibration():
    tall, _ = system(5, 2)
    balance = least_squares(tall)
    wrong = balance.correction.at[1].multiply(1.01)
    change = jnp.abs(tall.vibration(wrong) - balance.residual)
    np.testing.assert_allclose(balance.sensitivity(0.01, 0.0)[:, 1], change, rtol=1e-10)


def test_select_keeps_the_right_part():
    tall, _ = system(4, 3)
    part = select(tall, planes=["p2"], targets=["t1", "t3"])
    np.testing.assert_array_equal(part.matrix, tall.matrix[jnp.array([1, 3])][:, 2:])
    with pytest.raises(BadInput, match="p9"):
        select(tall, planes=["p9"])


# ---------------------------------------------------------------- classical
def test_rigid_balance_takes_away_sum_and_couple():
    table = Unbalances(("a", "b", "c"), [0.003, 0.002, 0.004], [0.2, 2.0, 4.0])
    places = {"a": 0.0, "b": 0.1, "c": 0.25, "left": 0.05, "right": 0.3}
    pair = rigid_balance(
        [table], places, ("left", "right"), centre=0.15, mass=3.5, speed=100 * np.pi
    )
    vectors = np.append(
        np.asarray(table.magnitude) * np.exp(1j * np.asarray(table.phase)), pair.correction
    )
    z = np.array([places[n] for n in ("a", "b", "c", "left", "right")])
    assert abs(np.sum(vectors)) < 1e-17
    assert abs(np.sum(vectors * z)) < 1e-17
    # ISO 21940-11: G6.3 at 3000 r/min is 20.05 g mm per kg
    assert float(permissible_unbalance(6.3, 1.0, 100 * np.pi)) == pytest.approx(20.05e-6, rel=1e-3)
    assert float(jnp.sum(pair.permissible)) == pytest.approx(3.5 * 20.05e-6, rel=1e-3)


@pytest.mark.parametrize(("centre", "share"), [(0.04, 0.6), (0.06, 0.4), (0.0, 0.7), (0.09, 0.3)])
def test_the_plane_nearer_to_the_mass_centre_may_keep_more(centre, share):
    """By the levers of a rotor between its bearings, within 30 to 70 % (ISO 21940-11)."""
    places = {"a": 0.0, "b": 0.1}
    pair = rigid_balance((), places, ("a", "b"), centre=centre, mass=2.0, speed=300.0)
    whole = 6.3e-3 * 2.0 / 300.0
    np.testing.assert_allclose(pair.permissible, [share * whole, (1 - share) * whole], rtol=1e-14)


# ---------------------------------------------------------------- measured data
HEADER = "run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg]\n"


def three_runs():
    """Readings of two bearings in three runs, amplitude and phase."""
    deg = np.pi / 180
    polar = lambda r, a: r * np.exp(1j * a * deg)  # noqa: E731
    return {
        "initial": (polar(7.2, 238), polar(13.5, 296)),
        "plane-1": (polar(4.9, 114), polar(9.2, 347)),
        "plane-2": (polar(4.0, 79), polar(12.0, 292)),
    }


def table(runs, trial="2.5", angle="0"):
    lines = [HEADER]
    for run, values in runs.items():
        for number, value in enumerate(values, 1):
            cells = [run, f"bearing-{number}", "1490", repr(float(abs(value)))]
            cells += [repr(float(np.angle(value, deg=True)))]
            cells += ["", ""] if run == "initial" else [trial, angle]
            lines.append(",".join(cells) + "\n")
    return "".join(lines)


def test_trial_weights_of_a_table_are_the_coefficients(tmp_path):
    runs = three_runs()
    path = tmp_path / "runs.csv"
    path.write_text(table(runs))
    influence = read_measurements(path)
    assert influence.unit == "mm/s"
    assert influence.planes == ("plane-1", "plane-2")
    assert [row.target for row in influence.rows] == ["bearing-1", "bearing-2"]
    assert influence.rows[0].speed == pytest.approx(1490 * np.pi / 30, rel=1e-8)
    for p, run in enumerate(influence.planes):
        expected = (np.array(runs[run]) - np.array(runs["initial"])) / 2.5e-6
        np.testing.assert_allclose(influence.matrix[:, p], expected, rtol=1e-12)


BAD = {
    "no initial run": (
        lambda t: "".join(x for x in t.splitlines(True) if "initial" not in x),
        "initial",
    ),
    "unknown column": (lambda t: t.replace("target", "sensor", 1), "sensor"),
    "missing unit": (lambda t: t.replace(" [rpm]", ""), "speed"),
    "wrong dimension": (lambda t: t.replace("[rpm]", "[mm]"), "speed"),
    "no number": (lambda t: t.replace("1490", "fast", 1), "fast"),
    "no trial": (lambda t: t.replace("2.5", "0"), "trial"),
    "missing reading": (lambda t: t[: t.rindex("plane-2")], "bearing-2"),
    "double reading": (lambda t: t + t.splitlines(keepends=True)[-1], "second time"),
    "other trial": (lambda t: t[: t.rindex("2.5")] + "3.5,0\n", "another trial"),
    "empty": (lambda t: "", "empty"),
    "negative amplitude": (lambda t: t.replace("7.2", "-7.2"), "line 2.amplitude.*differs by 180"),
    "huge amplitude": (lambda t: t.replace("7.2", "1e300"), "line 2.amplitude.*1e-30 to 1e\\+30"),
    "tiny amplitude": (lambda t: t.replace("7.2", "1e-200"), "line 2.amplitude.*1e-30 to 1e\\+30"),
    "overlong cell": (lambda t: t.replace("bearing-1", "b" * 200_000, 1), "is no table: field"),
    "zero byte": (lambda t: t.replace("bearing-1", "b\0", 1), "is no table|printable"),
    "word of a kept weight": (
        lambda t: (
            t.replace("\n", ",kept\n", 1).replace("2.5,0", "2.5,0,maybe").replace(",,", ",,,")
        ),
        'line 4.kept = "maybe": must be "yes" or "no"',
    ),
    "kept and not": (
        lambda t: (
            t.replace("\n", ",kept\n", 1)
            .replace("2.5,0", "2.5,0,yes", 1)
            .replace("2.5,0\n", "2.5,0,no\n")
            .replace(",,", ",,,")
        ),
        "line 5.kept: differs",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_tables_are_refused_with_file_and_line(tmp_path, case):
    change, words = BAD[case]
    path = tmp_path / "runs.csv"
    path.write_text(change(table(three_runs())))
    with pytest.raises(SceneError, match=words) as error:
        read_measurements(path)
    assert "runs.csv" in str(error.value)


def test_kept_trial_weights_count_for_the_runs_below(tmp_path):
    """Weights that pile up give the coefficients of weights that were taken off again."""
    coefficients = np.array([[1.0 + 2j, 0.5], [-1j, 2.0 - 1j], [0.3, 1j]])  # rows, planes
    initial, trial = np.array([3.0, 2j, 1.0 + 1j]), 2.5e-6
    moves = 1e6 * trial * coefficients.T
    piled = {
        "initial": initial,
        "plane-1": initial + moves[0],
        "plane-2": initial + moves[0] + moves[1],
    }
    path = tmp_path / "runs.csv"
    path.write_text(
        table(piled)
        .replace("\n", ",kept\n", 1)
        .replace(",,\n", ",,,\n")
        .replace("2.5,0\n", "2.5,0,yes\n")
    )
    found = read_measurements(path)
    np.testing.assert_allclose(found.matrix, 1e6 * coefficients, rtol=1e-12)
    np.testing.assert_allclose(found.initial, initial, rtol=1e-12)
    path.write_text(path.read_text().replace("yes", "no"))
    taken_off = read_measurements(path).matrix[:, 1]
    np.testing.assert_allclose(taken_off, (moves[0] + moves[1]) / trial, rtol=1e-12)
    with pytest.raises(BadInput, match="`kept`"):
        trial_influence([1.0], [[2.0]], [1.0], [InfluenceRow("t", "ux", 1.0)], ["p"], kept=[])


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_tables_of_any_line_end_and_with_a_byte_order_mark(tmp_path, line_end):
    path = tmp_path / "runs.csv"
    path.write_bytes(b"\xef\xbb\xbf" + table(three_runs()).replace("\n", line_end).encode())
    assert read_measurements(path).planes == ("plane-1", "plane-2")


def test_trial_of_zero_is_refused():
    with pytest.raises(BadInput, match="different from zero"):
        trial_influence([1.0], [[2.0]], [0.0], [InfluenceRow("t", "ux", 1.0)], ["p"])


def test_least_masses_are_least_by_another_method():
    """Against sequential quadratic programming on the same problem without its kinks."""
    from scipy.optimize import minimize

    from jaxcomp.balancing import least_masses

    rng = np.random.default_rng(5)
    matrix = rng.normal(size=(8, 3)) + 1j * rng.normal(size=(8, 3))
    initial = rng.normal(size=8) + 1j * rng.normal(size=8)
    rows = tuple(InfluenceRow(f"t{n}", "ux", 100.0) for n in range(8))
    system = Influence(
        jnp.asarray(matrix), jnp.asarray(initial), jnp.ones(8), rows, ("a", "b", "c")
    )
    limit, cost = 1.1 * float(min_max(system).objective), np.array([1.0, 1.2, 0.9])
    found = least_masses(system, limit, cost=cost)
    assert found.converged
    assert np.abs(found.residual).max() <= limit * (1 + 3e-8)
    assert 0 <= float(found.gap) < 1e-7  # cuts stop at 1e-8 of each circle

    def size(y):
        return np.abs(y[:3] + 1j * y[3:])

    def inside(y):
        return 1 - np.abs(initial + matrix @ (y[:3] + 1j * y[3:])) ** 2 / limit**2

    start = np.asarray(min_max(system).correction)
    other = minimize(
        lambda y: np.sum(cost * size(y)),
        np.concatenate([start.real, start.imag]),
        method="SLSQP",
        constraints=[{"type": "ineq", "fun": inside}],
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert other.success
    assert size(other.x).min() > 0.01  # away from the kink of a plane without a correction
    # differences of SciPy, which know the slope to 1e-8, at a flat minimum
    assert float(found.objective) == pytest.approx(other.fun, rel=1e-6)


def test_bounds_of_single_planes_leave_the_others_free(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text(table(three_runs()))
    influence = read_measurements(path)
    first = float(np.abs(least_squares(influence).correction[0])) / 2
    by_name = bounded(influence, {"plane-1": first})
    by_place = bounded(influence, jnp.array([first, 1e3]))
    np.testing.assert_allclose(by_name.correction, by_place.correction, rtol=1e-6)
    assert abs(by_name.correction[0]) == pytest.approx(first, rel=1e-6)
    with pytest.raises(BadInput, match="plane-1"):
        bounded(influence, {"plane_1": first})


def test_weights_of_targets_are_those_of_their_rows(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text(table(three_runs()))
    twice = select(read_measurements(path), weights={"bearing-2": 2.0})
    assert twice.weight.tolist() == [1.0, 2.0]
    alone = least_squares(select(twice, planes=["plane-1"]))
    assert alone.verdict.startswith("No reading") != bool(alone.worse.any())
    for weights in ({"bearing-3": 1.0}, {"bearing-1": -1.0}):
        with pytest.raises(BadInput, match="bearing"):
            select(twice, weights=weights)
