"""The shipped tables against the solver that made them."""

import jax.numpy as jnp
import numpy as np
import pytest
from tools import film_tables as generate

from jaxcomp.film import GroovedReynolds, Reynolds, reference_solution
from jaxcomp.film import _finite_volumes as volumes
from jaxcomp.film import _reference as reference
from jaxcomp.film._film import coefficients_per_load, load_number_at

FAMILIES = [Reynolds, GroovedReynolds]

COARSE = reference.GRIDS[:3]


def test_shear_over_the_journal_gives_the_friction_number():
    """Phi_T = pi/sqrt(1 - eps^2) + eps F_t/2 against the shear stress 1/h + h p_theta/2 itself."""
    eps, q = 0.6, 0.8
    sums = []
    for n_theta, n_zeta in reference.GRIDS[1:3]:
        grid = volumes.film_grid(eps, q, n_theta, n_zeta)
        film = np.broadcast_to((grid.theta < np.pi)[:, None], grid.shape)
        pressure, _ = volumes.solve_pressure(grid, film)
        width = (grid.weights / grid.theta_slope[:, None])[0] * n_theta / (2 * np.pi)
        mean = np.concatenate([[0.0], pressure @ width, [0.0]]) * eps
        theta = np.concatenate([[0.0], grid.theta, [2 * np.pi]])
        h = 1 + eps * np.cos(theta)
        middle = (h[1:] + h[:-1]) / 2
        poiseuille = 0.5 * np.sum(middle / 2 * np.diff(mean))
        bush_less = 0.5 * np.sum(-middle / 2 * np.diff(mean))
        couette = np.pi / np.sqrt(1 - eps**2)
        tangential = volumes.pressure_forces(grid, pressure)[1] * eps
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
    load, attitude, damping, *stiffness = generate.tabulated(eps, q, found)
    # two extrapolations of the solver, on 480 x 32 cells and on the table's, differ by up to 3e-4
    # in damping where the film's edge meets a groove and by 3e-5 elsewhere; the table adds 1e-4
    place = 1 / jnp.sqrt(1 + x)
    assert abs(film.load(place) - load) < 1e-4
    assert abs(film.attitude_angle(x) - attitude) < 1e-4
    assert abs(film.damping_series(place) - damping) < 4e-4
    for series, value in zip(film.stiffness_series, stiffness, strict=False):
        assert abs(series(place) - value) < 2e-4


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
    solved = reference_solution(eps, q, grooved=family is GroovedReynolds)
    film = family(q)
    load = load_number_at(film, eps)
    ours = coefficients_per_load(film, load)
    np.testing.assert_allclose(load, solved.load_number, rtol=1e-4)
    np.testing.assert_allclose(film.friction_number(load), solved.friction_number, rtol=1e-4)
    for found, expected in zip(ours, (solved.stiffness, solved.damping), strict=True):
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found * load / scale, expected / scale, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_friction_series_is_that_of_the_shipped_table(family):
    from jaxcomp.film._tabulated import table_of

    table = table_of(family.table_name)
    # the file keeps ten digits, which the fit amplifies near u = 1
    np.testing.assert_allclose(generate.fit_friction(family, table), table["friction"], atol=1e-6)
