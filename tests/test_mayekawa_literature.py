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
# The paper rounds to 0.1 points; its own quadrature and iteration are unknown. The fit leaves less
# than 0.05 points of efficiency and 0.2 points of fluctuation.
EFFICIENCY, EFFICIENCY_WITHIN = [0.921, 0.911, 0.903], 0.003
FLUCTUATION, FLUCTUATION_WITHIN = [0.104, 0.082], 0.004


def _table(compressor):
    def one(speed, bore):
        design = eqx.tree_at(lambda c: c.motor.mean_speed, with_bore(compressor, bore), speed)
        orbit = solve_orbit(design, Collocation(nodes=12, reversals=0, tolerance=1e-10))
        return orbit.mechanical_efficiency, orbit.speed_fluctuation, orbit.converged

    grid = jax.vmap(jax.vmap(one, (None, 0)), (0, None))
    efficiency, fluctuation, converged = jax.jit(grid)(jnp.asarray(SPEEDS), jnp.asarray(BORES))
    assert bool(converged.all())
    return np.asarray(efficiency), np.asarray(fluctuation)


@pytest.fixture(scope="module")
def as_printed():
    return _table(load("mayekawa-wbhe").compressor)


def test_efficiency_at_the_published_optima(as_printed):
    efficiency, _ = as_printed
    np.testing.assert_allclose(efficiency[range(3), BEST], EFFICIENCY, atol=EFFICIENCY_WITHIN)


def test_best_bore_on_the_grid_of_the_paper(as_printed):
    efficiency, _ = as_printed
    assert list(efficiency.argmax(axis=1)) == BEST


def test_speed_fluctuation_at_1000_rpm(as_printed):
    _, fluctuation = as_printed
    np.testing.assert_allclose(fluctuation[1, [3, 0]], FLUCTUATION, atol=FLUCTUATION_WITHIN)


def test_figures_on_the_page_of_validation(as_printed):
    efficiency, fluctuation = as_printed
    # notebooks/validation.md rounds to 0.01 points
    np.testing.assert_allclose(efficiency[range(3), BEST], [0.9208, 0.9115, 0.9026], atol=0.5e-4)
    np.testing.assert_allclose(fluctuation[1, [3, 0]], [0.1052, 0.0801], atol=0.5e-4)


def test_pins_read_as_radii_miss_the_efficiency():
    machine = load("mayekawa-wbhe").compressor
    pins = lambda c: (  # noqa: E731
        c.friction.piston_pin.diameter,
        c.friction.crank_pin.diameter,
        c.friction.main_journal.diameter,
    )
    efficiency, _ = _table(eqx.tree_at(pins, machine, tuple(2 * d for d in pins(machine))))
    # 84 to 86 % instead of 90 to 92 %: no unprinted constant makes up for six points
    assert np.all(efficiency[range(3), BEST] < np.array(EFFICIENCY) - 0.04)


def test_rod_centre_in_metres_has_the_fluctuation_the_wrong_way_round():
    _, fluctuation = _table(load("mayekawa-wbhe-rod-centre").compressor)
    # published: it falls from 10.4 % at 130 mm to 8.2 % at 100 mm
    assert fluctuation[1, 0] > fluctuation[1, 3]
