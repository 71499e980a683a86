"""The shipped tables against the solver that made them."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.film import (
    GroovedReynolds,
    Reynolds,
    coefficients_per_load,
    load_number_at,
    reference_solution,
)
from jaxcomp.film import _generate as generate
from jaxcomp.film import _reference as reference

FAMILIES = [Reynolds, GroovedReynolds]

COARSE = reference.GRIDS[:3]


def test_shear_over_the_journal_gives_the_friction_number():
    """Phi_T = pi/sqrt(1 - eps^2) + eps F_t/2 against the shear stress 1/h + h p_theta/2 itself."""
    eps, q = 0.6, 0.8
    sums = []
    for n_theta, n_zeta in reference.GRIDS[1:3]:
        grid = reference.film_grid(eps, q, n_theta, n_zeta)
        film = np.broadcast_to((grid.theta < np.pi)[:, None], grid.shape)
        pressure, _ = reference.solve_pressure(grid, 0.0, film)
        width = (grid.weights / grid.theta_slope[:, None])[0] * n_theta / (2 * np.pi)
        mean = np.concatenate([[0.0], pressure @ width, [0.0]]) * eps
        theta = np.concatenate([[0.0], grid.theta, [2 * np.pi]])
        h = 1 + eps * np.cos(theta)
        middle = (h[1:] + h[:-1]) / 2
        poiseuille = 0.5 * np.sum(middle / 2 * np.diff(mean))
        bush_less = 0.5 * np.sum(-middle / 2 * np.diff(mean))
        couette = np.pi / np.sqrt(1 - eps**2)
        tangential = reference.pressure_forces(grid, pressure)[1] * eps
        sums.append([couette + poiseuille, couette + bush_less, tangential])
    journal, bush, tangential = (4 * np.array(sums[1]) - sums[0]) / 3
    # extrapolated from 120 and 240 cells: 1e-4 of F_t
    assert abs(journal - (np.pi / np.sqrt(1 - eps**2) + eps * tangential / 2)) < 2e-4
    # moment balance: the couple of the offset forces, W e sin(phi), is eps F_t
    assert abs(journal - bush - eps * tangential) < 2e-4


@pytest.mark.parametrize(("eps", "q"), [(0.0, 0.5), (0.3, 1.5), (0.7, 0.3), (0.95, 1.0)])
@pytest.mark.parametrize("family", FAMILIES)
def test_table_meets_a_coarse_solution(eps, q, family):
    found = generate.solve_forces(eps, q, COARSE, grooved=family is GroovedReynolds)
    film, x = family(q), jnp.asarray(eps / (1 - eps))
    load, attitude, damping, *drift = generate.tabulated(eps, q, found)
    # 240 x 32 cells after Richardson: 1e-5 in the steady film, 2e-3 in its response, where the
    # staircase of the film's edge shows
    assert abs(film.load(1 / jnp.sqrt(1 + x)) - load) < 3e-4
    assert abs(film.attitude_angle(x) - attitude) < 3e-4
    # where the film's edge meets a groove the damping has a corner that polynomials round off
    bound = 8e-3 if family is GroovedReynolds else 4e-3
    assert abs(film.damping_series(1 / jnp.sqrt(1 + x)) - damping) < bound
    for series, value in zip(film.drift, drift, strict=False):
        # differences of forces good to 1e-5 over 0.1 rad; the same corner
        assert abs(series(1 / jnp.sqrt(1 + x)) - value) < 5e-3


def test_chebyshev_fit_goes_through_its_nodes():
    s = generate.chebyshev_nodes((0.1, 1.0), 5)[:, None]
    t = generate.chebyshev_nodes((-1.0, 2.0), 4)
    coefficients = generate.chebyshev_coefficients(s**3 * t - t**2)
    back = np.polynomial.chebyshev.chebval2d(
        (2 * 0.4 - 1.1) / 0.9, (2 * 0.3 - 1.0) / 3.0, coefficients
    )
    np.testing.assert_allclose(back, 0.4**3 * 0.3 - 0.3**2, atol=1e-13)


# Off the nodes of the tables, inside and near the corners of the range that is promised.
PLACES = [(0.01, 0.1), (0.01, 2.0), (0.5, 0.13), (0.7, 0.7), (0.36, 1.7), (0.9, 0.4)]
PLACES += [(0.97, 0.1), (0.97, 1.0), (0.97, 2.0)]


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("eps", "q"), PLACES)
def test_table_meets_the_reference(family, eps, q):
    """Load, friction, stiffness and damping; entries of a matrix over its largest."""
    # 1e-4, but for the coefficients between grooves: they have corners in eps and L/D where the
    # edge of the film meets a groove, most of all in short bearings at eps of 0.04 to 0.2
    stiffness, damping = (2.5e-3, 6e-3) if family is GroovedReynolds else (1e-4, 1e-4)
    solved = reference_solution(eps, q, grooved=family is GroovedReynolds)
    film = family(q)
    load = load_number_at(film, eps)
    ours = coefficients_per_load(film, load)
    np.testing.assert_allclose(load, solved.load_number, rtol=1e-4)
    np.testing.assert_allclose(film.friction_number(load), solved.friction_number, rtol=1e-4)
    for found, expected, bound in (
        (ours.stiffness, solved.stiffness, stiffness),
        (ours.damping, solved.damping, damping),
    ):
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found * load / scale, expected / scale, atol=bound)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_friction_series_is_that_of_the_shipped_table(family):
    from jaxcomp.film._reynolds import _table

    table = _table(family.table_name)
    # the file keeps ten digits, which the fit amplifies near u = 1
    np.testing.assert_allclose(generate.fit_friction(family, table), table["friction"], atol=1e-6)
