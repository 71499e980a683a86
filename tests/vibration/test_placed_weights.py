"""Weights at places: published blades, exhaustive search on random cases, bounds, what cannot be."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from vibration.test_balancing import system

from jaxcomp import BadInput
from jaxcomp.balancing import Places, least_squares, placed
from jaxcomp.balancing._influence import Influence
from jaxcomp.scene.measurements import read_measurements

# Service page on balancing of fans: 83.5 g at 308.8 deg, on 16 blades 23.3 g and 61.49 g.
FAN = """run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g],angle [deg]
initial,fan,1000,4.81,16.8,,
fan-wheel,fan,1000,4.7628,299.9,103.25,0
"""
BLADES = np.deg2rad(22.5) * np.arange(16)


def in_masses(influence):
    return Influence(*influence_parts(influence), influence.unit, "kg")


def influence_parts(influence):
    names = ("matrix", "initial", "weight", "rows", "planes")
    return (getattr(influence, name) for name in names)


def test_published_correction_on_sixteen_blades(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text(FAN)
    influence = read_measurements(path)
    whole = complex(least_squares(influence).correction[0])
    assert abs(whole) == pytest.approx(83.43e-3, abs=5e-6)
    assert np.angle(whole, deg=True) % 360 == pytest.approx(308.81, abs=0.005)
    balance = placed(influence, Places(BLADES))
    weights = balance.weights
    assert np.rad2deg(weights.angle) == pytest.approx([292.5, 315.0])
    # the law of sines; printed 23.3 and 61.49 g
    between = whole / np.exp(1j * weights.angle[0])
    second = between.imag / np.sin(np.deg2rad(22.5))
    first = between.real - second * np.cos(np.deg2rad(22.5))
    assert weights.mass == pytest.approx([first, second], rel=1e-9)
    assert weights.mass == pytest.approx([23.52e-3, 61.21e-3], abs=5e-6)
    assert not weights.removed.any()
    assert bool(balance.converged)
    assert float(balance.improvement) < 1e-12
    drilled = placed(influence, Places(BLADES, removed=True))
    assert drilled.weights.removed.all()
    assert np.rad2deg(drilled.weights.angle) == pytest.approx([112.5, 135.0])
    assert drilled.weights.mass == pytest.approx(weights.mass, rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_weights_of_any_mass_are_optimal_within_bounds(seed):
    """Against SciPy's bounded quasi-Newton method on the same squares, and by the stated bound."""
    rng = np.random.default_rng(seed)
    planes = int(rng.integers(1, 4))
    influence, _ = system(int(rng.integers(1, 7)), planes, seed=seed)
    # a third of a turn of places, so that most corrections are out of reach
    places = {
        name: Places(
            np.sort(rng.uniform(0, 2.5, 4)),
            radius=rng.uniform(0.05, 0.2),
            removed=bool(rng.integers(2)),
            largest=rng.uniform(0.5, 20.0),
        )
        for name in influence.planes
    }
    balance = placed(influence, places)
    matrix, initial = (np.asarray(x) for x in influence.weighted)
    columns, largest = [], []
    for number, name in enumerate(influence.planes):
        own = places[name]
        arm = (-1 if own.removed else 1) * own.radius * np.exp(1j * own.angles)
        columns.append(matrix[:, [number]] * arm)
        largest += [own.largest] * own.angles.size
    columns, largest = np.hstack(columns), np.array(largest)

    def squares(shares):
        rest = initial + columns @ (shares * largest)
        slope = 2 * np.real(np.conj(columns * largest).T @ rest)
        return np.sum(np.abs(rest) ** 2), slope

    other = minimize(
        squares, np.full(largest.size, 0.3), jac=True, bounds=[(0, 1)] * largest.size,
        method="L-BFGS-B", options={"maxiter": 20_000, "maxfun": 50_000, "ftol": 1e-15, "gtol": 1e-10},
    )  # fmt: skip
    before = float(np.linalg.norm(initial))
    # flat at the optimum: half the digits of the squares
    assert float(balance.objective) <= np.sqrt(other.fun) + 1e-9 * before
    assert float(balance.objective) == pytest.approx(np.sqrt(other.fun), abs=2e-6 * before)
    assert float(balance.bound) == pytest.approx(float(balance.objective), abs=1e-8 * before)
    assert bool(balance.converged)
    for number, name in enumerate(influence.planes):
        own = balance.weights.plane == number
        weights = balance.weights.mass[own]
        assert np.all(weights <= places[name].largest * (1 + 1e-9))
        # a corner of the linear programme: all but two are full
        assert np.sum(weights < places[name].largest * (1 - 1e-6)) <= 2
        sign = -1 if places[name].removed else 1
        total = (
            sign * places[name].radius * np.sum(weights * np.exp(1j * balance.weights.angle[own]))
        )
        assert complex(balance.correction[number]) == pytest.approx(total, rel=1e-9, abs=1e-15)


def every_combination(influence, places, masses, counts, per_place, most_weights):
    """Least root of the sum of squares over all combinations, one after the other."""
    matrix, initial = (np.asarray(x) for x in influence.weighted)
    per_plane = []
    for name in influence.planes:
        own = places[name]
        arm = (-1 if own.removed else 1) * (own.radius or 1.0)
        options = []
        weights = [(j, k) for j in range(own.angles.size) for k in range(len(masses))]
        for size in range(most_weights + 1):
            for picks in itertools.combinations_with_replacement(weights, size):
                load = np.bincount([j for j, _ in picks], minlength=own.angles.size)
                if np.any(load > per_place):
                    continue
                used = np.bincount([k for _, k in picks], minlength=len(masses))
                total = sum(arm * masses[k] * np.exp(1j * own.angles[j]) for j, k in picks)
                options.append((complex(total), used))
        per_plane.append(options)
    lowest = np.inf
    for choice in itertools.product(*per_plane):
        if counts is not None and np.any(sum(used for _, used in choice) > np.array(counts)):
            continue
        correction = np.array([total for total, _ in choice])
        lowest = min(lowest, float(np.linalg.norm(initial + matrix @ correction)))
    return lowest


@pytest.mark.parametrize("seed", range(24))
def test_weights_of_a_stock_are_the_best_of_all_combinations(seed):
    rng = np.random.default_rng(seed)
    planes = 1 + seed % 3
    influence, planted = system(int(rng.integers(1, 5)), planes, seed=seed)
    count = (6, 4, 3)[planes - 1]
    places = {
        name: Places(
            rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count,
            radius=rng.uniform(0.1, 0.3),
            removed=bool(rng.integers(2)),
        )
        for name in influence.planes
    }
    size = np.abs(planted).mean() / 0.2
    masses = size * rng.uniform(0.1, 1.0, int(rng.integers(1, 4 - planes // 2)))
    counts = rng.integers(0, 3, masses.size).tolist() if seed % 2 else None
    options = {"per_place": 1 + seed % 2, "most_weights": (3, 2, 2)[planes - 1]}
    balance = placed(influence, places, masses, counts=counts, **options)
    expected = every_combination(influence, places, masses, counts, **options)
    assert float(balance.objective) == pytest.approx(expected, rel=1e-9)
    assert bool(balance.converged)
    assert float(balance.bound) == float(balance.objective)
    used = np.bincount(
        [int(np.argmin(np.abs(masses - mass))) for mass in balance.weights.mass],
        minlength=masses.size,
    )
    assert counts is None or np.all(used <= counts)
    for number, name in enumerate(influence.planes):
        own = balance.weights.plane == number
        assert own.sum() <= options["most_weights"]
        sign = -1 if places[name].removed else 1
        total = sign * np.sum(
            balance.weights.unbalance[own] * np.exp(1j * balance.weights.angle[own])
        )
        assert complex(balance.correction[number]) == pytest.approx(total, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("counts", [None, (2, 1, 2)])
def test_pairs_of_sums_give_the_same_as_a_list_of_all(monkeypatch, counts):
    """Where all sums are too many to list, pairs of those of half the weights are looked at."""
    from jaxcomp.balancing import _weight_places

    for seed in range(6):
        # with little that no weight removes, or every pair of planes would have to be looked at
        influence, planted = system(4, 1 + seed % 2, seed=seed, noise=0.1)
        masses = np.abs(planted).mean() * np.array([0.2, 0.55, 0.9])
        places = Places(2 * np.pi * np.arange(6) / 6 + 0.1)
        options = {"counts": counts, "per_place": 1, "most_weights": 4}
        listed = placed(influence, places, masses, **options)
        with monkeypatch.context() as patch:
            patch.setattr(_weight_places, "_MOST_SUMS", 400)
            paired = placed(influence, places, masses, **options)
        assert float(paired.objective) == pytest.approx(float(listed.objective), rel=1e-12)
        assert bool(paired.converged)
        # of equal sums both take the lightest
        weights = listed.weights.unbalance.sum()
        assert paired.weights.unbalance.sum() == pytest.approx(weights, rel=1e-12)


def test_what_is_not_proven_says_so(monkeypatch):
    from jaxcomp.balancing import _weight_places

    influence, planted = system(5, 2, seed=3)
    masses = np.abs(planted).mean() * np.array([0.2, 0.5])
    places = Places(2 * np.pi * np.arange(8) / 8)
    whole = placed(influence, places, masses, most_weights=4)
    assert bool(whole.converged)
    with monkeypatch.context() as patch:
        patch.setattr(_weight_places, "_MOST_SUMS", 20)
        early = placed(influence, places, masses, most_weights=4)
    assert not bool(early.converged)
    assert float(early.bound) <= float(whole.objective) <= float(early.objective) * (1 + 1e-12)
    assert float(early.gap) > 0
    proven = []
    for seed in range(10):
        influence, planted = system(2, 2, seed=seed, noise=0.0)
        masses = np.abs(planted).mean() * np.array([0.3, 0.7])
        whole = placed(influence, Places(BLADES[::4]), masses, most_weights=2)
        with monkeypatch.context() as patch:
            patch.setattr(_weight_places, "_MOST_POINTS", 0)
            early = placed(influence, Places(BLADES[::4]), masses, most_weights=2)
        assert float(early.bound) <= float(whole.objective) * (1 + 1e-12)
        assert float(whole.objective) <= float(early.objective) * (1 + 1e-12)
        proven.append(bool(early.converged))
    # a search that stops at once proves some, where the first combination is seen to be the best
    assert not all(proven)


def test_opposite_weights_that_do_nothing_are_left_out():
    """Equal weights face to face have no sum: the lightest combination has none of them."""
    influence, _ = system(1, 1, seed=1, noise=0.0)
    wanted = complex(least_squares(influence).correction[0])
    angles = np.angle(wanted) + np.pi / 2 * np.arange(4)
    balance = placed(influence, Places(angles), [abs(wanted)], most_weights=4)
    assert balance.weights.unbalance == pytest.approx([abs(wanted)])
    assert float(balance.improvement) < 1e-12


def test_masses_and_radii_of_planes():
    influence, _ = system(3, 2, seed=5)
    in_kilograms = in_masses(influence)
    unit = placed(in_kilograms, Places(BLADES))
    assert np.isnan(unit.weights.unbalance).all()
    with pytest.raises(BadInput, match="radius"):
        placed(in_kilograms, Places(BLADES, radius=0.1))
    radius = jnp.asarray([0.1, np.nan])
    with_radius = Influence(*influence_parts(influence), "m", "kg m", radius)
    weights = placed(with_radius, Places(BLADES)).weights
    first = weights.plane == 0
    assert weights.mass[first] * 0.1 == pytest.approx(weights.unbalance[first], rel=1e-12)
    assert np.isnan(weights.mass[~first]).all()
    only = placed(influence, {"p1": Places(BLADES)})
    assert complex(only.correction[0]) == 0
    assert set(only.weights.plane) == {1}


REFUSED = {
    "no such plane": (lambda s: placed(s, {"p9": Places([0.0])}), "p9"),
    "no plane": (lambda s: placed(s, {}), "`places` must be of at least one"),
    "no places": (lambda s: placed(s, Places([])), "at least one"),
    "angle that is none": (lambda s: placed(s, Places([np.nan])), "finite"),
    "radius of zero": (lambda s: placed(s, Places([0.0], radius=0.0)), "radius"),
    "no room": (lambda s: placed(s, Places([0.0], largest=-1.0)), "largest"),
    "no mass": (lambda s: placed(s, Places([0.0]), [0.0]), "masses"),
    "no masses": (lambda s: placed(s, Places([0.0]), []), "masses"),
    "counts of others": (lambda s: placed(s, Places([0.0]), [1.0], counts=[1, 2]), "counts"),
    "negative count": (lambda s: placed(s, Places([0.0]), [1.0], counts=[-1]), "counts"),
    "no weights": (lambda s: placed(s, Places([0.0]), [1.0], most_weights=0), "most_weights"),
    "none in a place": (lambda s: placed(s, Places([0.0]), [1.0], per_place=0), "per_place"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_places_and_stocks_that_cannot_be_are_refused(case):
    call, words = REFUSED[case]
    with pytest.raises(BadInput, match=words):
        call(system(2, 2)[0])
