"""The published results of Tsuji et al. (2012), Figs 3(c), 5(c) and 6, on the bundled machine.

Source: Tsuji, Oku, Ishii, Anami, Knisely, Maeda, Yamamoto (2012), "Calculated Optimal Mechanical
Efficiency of a Large Capacity Reciprocating Compressor", Purdue paper 2127. The unprinted constants
are fitted (notebooks/identify_constants.ipynb), so agreement shows that one set of them serves all
the published figures, not that they are the machine's.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import Collocation, load, solve_orbit, with_bore

RPM = 2 * np.pi / 60
BORES = np.arange(100, 181, 10) * 1e-3
SPEEDS = np.array([800, 1000, 1200]) * RPM
BEST = [2, 3, 4]  # 120, 130, 140 mm
# The paper rounds to 0.1 points; its own quadrature and iteration are unknown. The fit leaves up to 0.27
# points of efficiency (at 1200 rpm) and 0.07 points of fluctuation: what meets the efficiencies to 0.05
# contradicts the sentences on Fig. 5(a), see notebooks/identify_constants.ipynb.
EFFICIENCY, EFFICIENCY_WITHIN = [0.921, 0.911, 0.903], 0.003
FLUCTUATION, FLUCTUATION_WITHIN = [0.104, 0.082], 0.001


@jax.jit
def _grid(compressor, speeds, bores):
    """Results over speeds and bores, by one program for all these machines."""

    def at(speed, bore):
        design = eqx.tree_at(lambda c: c.motor.mean_speed, with_bore(compressor, bore), speed)
        orbit = solve_orbit(design, Collocation(nodes=12, reversals=0, tolerance=1e-10))
        losses = {name: work / orbit.period for name, work in orbit.energy.losses.items()}
        return orbit.mechanical_efficiency, orbit.speed_fluctuation, losses, orbit.converged

    return jax.vmap(jax.vmap(at, (None, 0)), (0, None))(speeds, bores)


def _table(compressor):
    results = _grid(compressor, jnp.asarray(SPEEDS), jnp.asarray(BORES))
    efficiency, fluctuation, losses, converged = results
    assert bool(converged.all())
    at_1000 = {name: np.asarray(loss)[1] for name, loss in losses.items()}
    return np.asarray(efficiency), np.asarray(fluctuation), at_1000


@pytest.fixture(scope="module")
def as_printed():
    return _table(load("mayekawa-wbhe").compressor)


def test_efficiency_at_the_published_optima(as_printed):
    efficiency, _, _ = as_printed
    np.testing.assert_allclose(efficiency[range(3), BEST], EFFICIENCY, atol=EFFICIENCY_WITHIN)


def test_best_bore_on_the_grid_of_the_paper(as_printed):
    efficiency, _, _ = as_printed
    assert list(efficiency.argmax(axis=1)) == BEST


def test_speed_fluctuation_at_1000_rpm(as_printed):
    _, fluctuation, _ = as_printed
    np.testing.assert_allclose(fluctuation[1, [3, 0]], FLUCTUATION, atol=FLUCTUATION_WITHIN)


def test_fluctuation_falls_with_the_bore(as_printed):
    _, fluctuation, _ = as_printed
    assert np.all(np.diff(fluctuation[1]) > 0)
    np.testing.assert_allclose(fluctuation[1, [0, -1]], [0.081, 0.122], atol=1e-3)


def test_sentences_on_the_losses_of_fig_5a(as_printed):
    _, _, loss = as_printed
    # "E_MS, E_MQ and E_MT decrease with decreasing piston diameter": W, from 100 to 180 mm; the journal's
    # loss is flat to 0.1 W between 100 and 110 mm
    assert np.all(np.diff(loss["piston_pin"]) > 0)
    assert np.all(np.diff(loss["main_journal"]) > -0.1)
    assert loss["main_journal"][-1] > 2 * loss["main_journal"][0]
    # "E_MS exhibits its minimum near d = 140 mm and then increases": 130 and 140 mm differ by 0.8 W
    pin = loss["crank_pin"]
    assert pin[3:5].max() < 1.005 * pin[3:5].min()
    assert np.all(np.diff(pin[:4]) < 0)
    assert np.all(np.diff(pin[4:]) > 0)
    # "In contrast, E_f increases gradually with decreasing piston diameter"
    assert np.all(np.diff(loss["wall"]) < 0)
    # "the net loss E_F exhibits a minimum at d = 130 mm"
    total = sum(loss.values())
    assert BORES[total.argmin()] == pytest.approx(0.130)
    # "relatively large, while E_MT at the piston pin is comparatively small"
    others = np.min([loss[name] for name in ("crank_pin", "main_journal", "wall")], axis=0)
    assert np.all(loss["piston_pin"] < 0.25 * others)
    # as the page of validation has them, at 100 and 180 mm
    ends = {"piston_pin": [6, 16], "main_journal": [109, 268], "wall": [229, 69]}
    for name, watts in ends.items():
        np.testing.assert_allclose(loss[name][[0, -1]], watts, atol=0.6)
    np.testing.assert_allclose(pin[3:5], [232.6, 233.4], atol=0.1)
    assert total[3] == pytest.approx(499, abs=0.6)


def test_figures_on_the_page_of_validation(as_printed):
    efficiency, fluctuation, _ = as_printed
    # notebooks/validation.md rounds to 0.01 points
    np.testing.assert_allclose(efficiency[range(3), BEST], [0.9232, 0.9117, 0.9003], atol=0.5e-4)
    np.testing.assert_allclose(fluctuation[1, [3, 0]], [0.1045, 0.0813], atol=0.5e-4)


def test_pins_read_as_radii_miss_the_efficiency():
    machine = load("mayekawa-wbhe").compressor
    pins = lambda c: (  # noqa: E731
        c.friction.piston_pin.diameter,
        c.friction.crank_pin.diameter,
        c.crankshaft.main_journal.diameter,
    )
    efficiency, _, _ = _table(eqx.tree_at(pins, machine, tuple(2 * d for d in pins(machine))))
    # 84 to 86 % instead of 90 to 92 %: no unprinted constant makes up for six points
    assert np.all(efficiency[range(3), BEST] < np.array(EFFICIENCY) - 0.04)


def test_rod_centre_in_metres_has_the_fluctuation_the_wrong_way_round():
    _, fluctuation, _ = _table(load("mayekawa-wbhe-rod-centre").compressor)
    # published: it falls from 10.4 % at 130 mm to 8.2 % at 100 mm
    assert fluctuation[1, 0] > fluctuation[1, 3]
