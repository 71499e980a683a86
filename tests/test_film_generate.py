"""The offline solver of the Reynolds equation, and the shipped table against it."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.film import Guembel, Reynolds, film_forces, load_number_at
from jaxcomp.film import _generate as generate

COARSE = generate.GRIDS[:2]


def test_shear_over_the_journal_gives_the_friction_number():
    """Phi_T = pi/sqrt(1 - eps^2) + eps F_t/2 against the shear stress 1/h + h p_theta/2 itself."""
    eps, q = 0.6, 0.8
    sums = []
    for n_theta, n_zeta in generate.GRIDS[1:3]:
        grid = generate.film_grid(eps, q, n_theta, n_zeta)
        film = np.broadcast_to((grid.theta < np.pi)[:, None], grid.shape)
        pressure, _ = generate.solve_pressure(grid, 0.0, film)
        width = (grid.weights / grid.theta_slope[:, None])[0] * n_theta / (2 * np.pi)
        mean = np.concatenate([[0.0], pressure @ width, [0.0]]) * eps
        theta = np.concatenate([[0.0], grid.theta, [2 * np.pi]])
        h = 1 + eps * np.cos(theta)
        middle = (h[1:] + h[:-1]) / 2
        poiseuille = 0.5 * np.sum(middle / 2 * np.diff(mean))
        bush_less = 0.5 * np.sum(-middle / 2 * np.diff(mean))
        couette = np.pi / np.sqrt(1 - eps**2)
        tangential = generate.pressure_forces(grid, pressure)[1] * eps
        sums.append([couette + poiseuille, couette + bush_less, tangential])
    journal, bush, tangential = (4 * np.array(sums[1]) - sums[0]) / 3
    # extrapolated from 120 and 240 cells: 1e-4 of F_t
    assert abs(journal - (np.pi / np.sqrt(1 - eps**2) + eps * tangential / 2)) < 2e-4
    # moment balance: the couple of the offset forces, W e sin(phi), is eps F_t
    assert abs(journal - bush - eps * tangential) < 2e-4


@pytest.mark.parametrize(("eps", "q"), [(0.0, 0.5), (0.3, 1.5), (0.7, 0.3), (0.95, 1.0)])
def test_table_meets_a_coarse_solution(eps, q):
    found = generate.solve_forces(eps, q, COARSE)
    film, x = Reynolds(q), jnp.asarray(eps / (1 - eps))
    load, attitude, damping = generate.tabulated(eps, q, found)
    # 120 x 16 cells after Richardson: 1e-4 in the steady film, 2e-3 in its response, where the
    # staircase of the film's edge shows
    assert abs(film.load(1 / jnp.sqrt(1 + x)) - load) < 3e-4
    assert abs(film.attitude_angle(x) - attitude) < 3e-4
    assert abs(film.damping_series(1 / jnp.sqrt(1 + x)) - damping) < 4e-3


def test_without_cavitation_the_solver_gives_half_sommerfeld():
    """The whole ring, integrated over the positive half: an independent check of both codes."""
    eps, q = 0.5, 1.0
    sums = []
    for n_theta, n_zeta in generate.GRIDS[1:3]:
        grid = generate.film_grid(eps, q, n_theta, n_zeta)
        # By antisymmetry the ring is solved by its positive half with p = 0 at 0 and pi.
        half = (grid.theta < np.pi - 1e-9)[:, None] & np.ones(grid.shape, bool)
        pressure = _on_fixed_film(grid, half)
        sums.append(generate.pressure_forces(grid, pressure) * eps)
    forces = (4 * sums[1] - sums[0]) / 3
    # 1e-5 of the finite volumes, 3e-5 of the series
    np.testing.assert_allclose(forces, film_forces(Guembel(q), eps), rtol=1e-4)


def _on_fixed_film(grid, film):
    rows = int(film[:, 0].sum())
    inner = generate.Grid(
        theta=grid.theta[:rows],
        theta_slope=grid.theta_slope[:rows],
        weights=grid.weights[:rows],
        coupling_theta=grid.coupling_theta[: rows + 1],
        coupling_zeta=grid.coupling_zeta[:rows],
        cells=grid.cells[:rows],
    )
    pressure, solved = generate.solve_pressure(inner, 0.0, film[:rows])
    assert solved.all()
    return np.concatenate([pressure, np.zeros((grid.shape[0] - rows, grid.shape[1]))])


def test_chebyshev_fit_goes_through_its_nodes():
    s = generate.chebyshev_nodes((0.1, 1.0), 5)[:, None]
    t = generate.chebyshev_nodes((-1.0, 2.0), 4)
    coefficients = generate.chebyshev_coefficients(s**3 * t - t**2)
    back = np.polynomial.chebyshev.chebval2d(
        (2 * 0.4 - 1.1) / 0.9, (2 * 0.3 - 1.0) / 3.0, coefficients
    )
    np.testing.assert_allclose(back, 0.4**3 * 0.3 - 0.3**2, atol=1e-13)


# Off the nodes of the table, inside and near its corners.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("s", "q"), [(0.071, 0.1), (0.071, 2.0), (0.3, 0.13), (0.55, 0.7), (0.8, 1.7), (0.999, 0.4)]
)
def test_table_meets_the_generator(s, q):
    eps = 1 - s**2
    found = generate.solve_forces(eps, q)
    film, x = Reynolds(q), jnp.asarray(eps / (1 - eps))
    load = eps * np.hypot(found.radial, found.tangential)
    # measured over 40 random places: 7e-6 in Phi_p and phi; the edge's staircase leaves up to
    # 1.6e-4 in C_rr
    np.testing.assert_allclose(load_number_at(film, eps), load, rtol=2e-5)
    angle = np.arctan2(found.tangential, -found.radial)
    np.testing.assert_allclose(film.attitude_angle(x), angle, atol=2e-5)
    np.testing.assert_allclose(film.damping(x)[0], found.radial_damping, rtol=2.5e-4)


@pytest.mark.slow
def test_stiffness_of_the_table_meets_differences_of_the_solver():
    eps, q, step = 0.6, 0.5, 0.02
    at = [generate.solve_forces(eps + d, q) for d in (-2 * step, -step, step, 2 * step)]
    forces = (
        np.array([[f.radial, f.tangential] for f in at])
        * np.array([eps - 2 * step, eps - step, eps + step, eps + 2 * step])[:, None]
    )
    slopes = (8 * (forces[2] - forces[1]) - forces[3] + forces[0]) / (12 * step)
    import jax

    ours = jax.jacfwd(lambda e: jnp.stack(film_forces(Reynolds(q), e)))(eps)
    # noise of 5e-6 in the forces over the step, and the step's fourth power
    np.testing.assert_allclose(ours, slopes, rtol=5e-4)


@pytest.mark.slow
def test_friction_series_is_that_of_the_shipped_table():
    from jaxcomp.film._reynolds import _table

    table = _table()
    # the file keeps ten digits, which the fit amplifies near u = 1
    np.testing.assert_allclose(generate.fit_friction(table), table["friction"], atol=1e-6)
