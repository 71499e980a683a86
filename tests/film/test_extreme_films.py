"""Oil films from no load to a closed gap, against the laws of their limits.

Values and slopes are finite over twelve decades of load in `test_film_gradients`; here they are
right: the exponents of both ends, and the way there.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import JournalBearing
from jaxcomp.film import (
    ExplicitFit,
    GroovedReynolds,
    Ocvirk,
    Reynolds,
    minimum_film,
    reference_solution,
)
from jaxcomp.film._bearing import friction_moment, prepare
from jaxcomp.film._film import film_ratio, load_number_at
from jaxcomp.film._running import eccentricity_ratio

MODELS = [Reynolds, GroovedReynolds, Ocvirk, ExplicitFit]
LOADS = np.logspace(-5, 7, 49)
HEAVIER = np.logspace(9, 10, 5)
SIZES = (0.04, 0.02, 2e-5, 0.01)  # diameter, length, clearance, viscosity
SPEED = 300.0
CLOSE = np.concatenate([np.linspace(0.0, 0.9, 10), 1 - np.logspace(-2, -9, 8)])


def over_loads(model):
    bearing = prepare(JournalBearing(*SIZES, film=model))
    functions = friction_moment, minimum_film, eccentricity_ratio
    program = jax.jit(jax.vmap(lambda w: [f(bearing, w, SPEED) for f in functions]))
    loads = np.concatenate([LOADS, HEAVIER])
    return loads, *map(np.asarray, program(loads))


@pytest.mark.parametrize("model", MODELS)
def test_load_over_twelve_decades_has_the_exponents_of_its_ends(model):
    loads, moment, gap, eps = over_loads(model)
    slope = lambda y: np.diff(np.log(y)) / np.diff(np.log(loads))  # noqa: E731
    assert np.all((eps >= 0) & (eps < 1))
    assert np.all(np.diff(gap) < 0)
    assert np.all(np.diff(moment) >= -1e-14 * moment[0])
    # light: eps goes with the load and friction is Petroff's; terms of the second order in 1e-6
    np.testing.assert_allclose(slope(eps)[:4], 1.0, atol=1e-5)
    np.testing.assert_allclose(slope(moment)[:4], 0.0, atol=1e-9)
    # heavy: the gap of the short bearing goes with 1/load^(1/2), that of a thin zone with 1/load, and
    # friction with load^(1/2). At a load number of 1e6 what is left of the approach goes with its root.
    power = -0.5 if model is Ocvirk else -1.0
    np.testing.assert_allclose(slope(gap)[-4:], power, atol=0.01)
    if model in (Reynolds, GroovedReynolds):
        np.testing.assert_allclose(slope(moment)[-4:], 0.5, atol=0.01)


@pytest.mark.parametrize("model", MODELS)
def test_position_is_inverted_down_to_a_billionth_of_the_clearance(model):
    film = model(0.5)

    def back(eps):
        x = film_ratio(film, load_number_at(film, eps))
        return x / (1 + x), 1 / (1 + x)

    eps, gap = jax.jit(jax.vmap(back))(jnp.asarray(CLOSE))
    # one rounding of eps is 1e-16/(1 - eps) of the gap
    np.testing.assert_allclose(gap, 1 - CLOSE, rtol=1e-12 + 4e-16 / (1 - CLOSE[-1]))
    np.testing.assert_allclose(eps, CLOSE, rtol=1e-12, atol=1e-15)
    slope = jax.jit(jax.vmap(jax.grad(lambda e: load_number_at(film, e))))(jnp.asarray(CLOSE))
    assert np.all(np.isfinite(slope))
    assert np.all(slope > 0)


@pytest.mark.parametrize("eps", [pytest.param(0.99, marks=pytest.mark.slow), 0.999])
def test_nearly_closed_film_is_that_of_the_finite_volumes(eps):
    """The table and a solution on a grid that crowds in the gap (own work each)."""
    found = float(load_number_at(Reynolds(0.5), eps))
    grids = ((240, 16), (480, 32))
    solution = reference_solution(eps, 0.5, coefficients=False, grids=grids)
    # 1e-5 up to eps = 0.97, and the zone that carries is up to six times narrower here
    assert float(solution.load_number) == pytest.approx(found, rel=2e-3)


@pytest.mark.parametrize("film", ["reynolds", "fit"])
def test_film_journal_of_a_machine_is_finite_where_it_rests(film):
    """The law that the crank meets: no load, no speed, and both at the far ends."""
    law = JournalBearing(0.04, 0.02, 2e-5, 0.01, film=film)
    loads = jnp.asarray([0.0, 1e-300, 1e-12, 1.0, 1e7, 1e12])
    rates = jnp.asarray([0.0, 1e-300, -1e-9, 1e-3, 300.0, 1e6])
    grid = [a.ravel() for a in jnp.meshgrid(loads, rates)]
    value, slopes = jax.jit(jax.vmap(jax.value_and_grad(law.moment, (0, 1))))(*grid)
    for each in (value, *slopes):
        assert np.all(np.isfinite(each))
    # friction resists, and there is none at rest
    assert np.all(value * grid[1] >= 0)
    assert np.all(value[grid[1] == 0] == 0)
