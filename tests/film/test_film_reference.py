"""The reference solver: published flow and pressure, convergence, limits, identities."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from film.test_film import film_forces

from jaxcomp.film import Guembel, Ocvirk, dynamic_coefficients, reference_solution
from jaxcomp.film import _finite_volumes as volumes
from jaxcomp.film import _reference as reference
from jaxcomp.film._film import load_number_at
from jaxcomp.film._reference import GRIDS

MEDIUM = GRIDS[:3]

# Raimondi, A. A. and Boyd, J., ASLE Transactions 1 (1958), part III, full bearing, L/D = 1:
# eps, Q/(R c N L) with N in rev/s, side flow over Q, mean over peak pressure.
FLOW = [
    (0.1, 3.37, 0.150, 0.540),
    (0.2, 3.59, 0.280, 0.529),
    (0.4, 3.99, 0.497, 0.484),
    (0.6, 4.33, 0.680, 0.415),
    (0.8, 4.62, 0.842, 0.313),
    (0.9, 4.74, 0.919, 0.247),
]


@pytest.mark.parametrize(("eps", "flow", "side", "ratio"), FLOW)
def test_flow_and_peak_pressure_meet_raimondi_and_boyd(eps, flow, side, ratio):
    solved = reference_solution(eps, 1.0, coefficients=False, grids=MEDIUM)
    # three printed digits each, and their scatter
    np.testing.assert_allclose(2 * math.pi * solved.side_flow, flow * side, rtol=0.01)
    # 2.2 % at eps = 0.8, where their S scatters as well; 0.5 % elsewhere
    bound = 0.025 if eps == 0.8 else 0.01
    np.testing.assert_allclose(solved.load_number / solved.peak_pressure, ratio, rtol=bound)


@pytest.mark.parametrize("options", [{}, {"cavitation": "guembel"}, {"grooved": True}])
def test_errors_fall_with_the_square_of_the_cells(options):
    """Each doubling of the cells brings the extrapolated load closer, below 1e-5 in the end."""
    eps, q = 0.7, 0.7
    loads = [
        reference_solution(eps, q, coefficients=False, grids=GRIDS[:n], **options).load_number
        for n in (3, 4)
    ]
    # two extrapolations differ by 1e-5; the coarse one is off by 1e-5 at most
    np.testing.assert_allclose(loads[0], loads[1], rtol=2e-5)
    if not options.get("grooved"):
        from jaxcomp.film._reference import _fields, _total, pads

        fields = _fields(eps, q, pads(None), GRIDS, bool(options))
        forces = np.array([_total(field) for field in fields])
        changes = np.linalg.norm(np.diff(forces, axis=0), axis=1)
        # second order: a factor of four, less the jumps of the film's edge
        assert np.all(changes[:-1] / changes[1:] > 3)


@pytest.mark.slow
def test_half_sommerfeld_meets_the_series():
    """Finite volumes on the closed ring against the series: two codes with nothing in common."""
    eps, q = 0.5, 1.0
    solved = reference_solution(eps, q, cavitation="guembel", grids=((120, 16), (240, 32)))
    film = Guembel(q)
    load = load_number_at(film, eps)
    # 1e-6 of the finite volumes, 1e-5 of the modes left out of the series
    np.testing.assert_allclose(solved.load_number, load, rtol=2e-5)
    forces = film_forces(film, eps)
    np.testing.assert_allclose(solved.attitude_angle, np.arctan2(forces[1], -forces[0]), atol=1e-5)
    stiffness, damping = dynamic_coefficients(film, load)
    np.testing.assert_allclose(solved.stiffness, stiffness, atol=5e-5 * np.abs(stiffness).max())
    np.testing.assert_allclose(solved.damping, damping, atol=5e-5 * np.abs(damping).max())


def test_short_bearing_is_ocvirks():
    """Half-Sommerfeld for L/D -> 0, with a correction of the order of L/D squared or smaller."""
    eps, errors = 0.5, []
    for q in (0.2, 0.1, 0.05):
        solved = reference_solution(
            eps, q, cavitation="guembel", coefficients=False, grids=((480, 16), (960, 32))
        )
        film, x = Ocvirk(q), jnp.asarray(1.0)
        peak = np.max(film.pressure(x, np.linspace(0, np.pi, 2001), 0.0))
        # all the oil that the wedge takes in leaves through the ends: side flow -> eps
        found = [solved.load_number, solved.peak_pressure, solved.side_flow]
        errors.append(np.abs(np.array(found) / [load_number_at(film, eps), peak, eps] - 1))
    errors = np.array(errors)
    assert np.all(errors[1:] < 0.6 * errors[:-1])
    assert np.all(errors[-1] < [5e-3, 5e-3, 3e-2])


@pytest.mark.slow
def test_pressure_field_carries_the_load():
    """The field as it is handed out, integrated by the trapezoidal rule."""
    for options in ({}, {"grooved": True}, {"cavitation": "guembel"}):
        solved = reference_solution(0.6, 0.8, coefficients=False, **options)
        mean = np.trapezoid(solved.pressure, solved.zeta, axis=1)
        radial = np.trapezoid(mean * np.cos(solved.theta), solved.theta) / 2
        tangential = np.trapezoid(mean * np.sin(solved.theta), solved.theta) / 2
        # the rule on 240 x 64 to 480 x 64 cells
        np.testing.assert_allclose(np.hypot(radial, tangential), solved.load_number, rtol=1e-3)
        assert abs(np.arctan2(tangential, -radial) - solved.attitude_angle) < 1e-3
        assert np.all(solved.pressure >= 0)
        assert np.all(solved.pressure[:, -1] == 0)
        assert np.all(np.diff(solved.theta) > 0)
        np.testing.assert_allclose(solved.pressure.max(), solved.peak_pressure, rtol=1e-3)


def test_pressure_vanishes_in_the_grooves():
    solved = reference_solution(0.3, 1.0, grooved=True, coefficients=False, grids=MEDIUM)
    angle = solved.theta - np.pi + solved.attitude_angle  # from the load
    for edge in np.radians([-85.0, 85.0, 95.0, 265.0]):
        place = np.argmin(np.abs(angle - edge))
        # the grooves lie where a coarser grid found the attitude angle
        assert abs(angle[place] - edge) < 1e-4
        assert np.all(solved.pressure[place] == 0)
    # and the force points against the load
    mean = np.trapezoid(solved.pressure, solved.zeta, axis=1)
    across = np.trapezoid(mean * np.sin(angle), angle)
    assert abs(across) < 1e-3 * np.trapezoid(mean * np.cos(angle), angle)


def test_coefficients_obey_the_identities():
    for options in ({}, {"grooved": True}):
        solved = reference_solution(0.4, 0.8, grids=MEDIUM, **options)
        assert np.all(np.linalg.eigvalsh(solved.damping) > 0)
        # reciprocity of the linear film, exact; the rotation leaves rounding
        np.testing.assert_allclose(solved.damping[0, 1], solved.damping[1, 0], rtol=1e-12)
        assert solved.stiffness[0, 1] > solved.stiffness[1, 0]


@pytest.mark.parametrize(("eps", "q", "grooved"), [(0.5, 1.0, False), (0.8, 0.3, True)])
def test_linear_response_is_the_slope_of_the_forces(eps, q, grooved, monkeypatch):
    """Against complementarity problems solved anew for other positions and velocities."""
    ring = reference.pads(reference.groove_attitude(eps, q, GRIDS[:2]) if grooved else None)

    def forces(eps):
        fields = reference._fields(eps, q, ring, MEDIUM, False)[-2:]
        return reference._extrapolated(np.array([reference._total(field) for field in fields]))

    fields = reference._fields(eps, q, ring, MEDIUM, False)[-2:]
    slopes = reference._extrapolated(np.array([reference._response(eps, f) for f in fields]))
    # F_t answers a radial velocity as F_r answers a tangential one
    np.testing.assert_allclose(slopes[1, 1], -forces(eps)[0], rtol=2e-5)
    step = 0.02 * (1 - eps)
    weights = np.array([1, -8, 8, -1]) / (12 * step)
    chords = np.array([(e * forces(e)) for e in eps + step * np.array([-2, -1, 1, 2])])
    # noise of the film's edge, 1e-6, over the step
    np.testing.assert_allclose(slopes[0], weights @ chords, rtol=3e-4)

    wedge, slow = volumes._wedge, 0.05 * math.sqrt(1 - eps)
    turned = []
    for turn in slow * np.array([-2, -1, 1, 2]):
        monkeypatch.setattr(
            volumes,
            "_wedge",
            lambda g, t=turn: wedge(g) - 6 * t * np.cos(g.theta)[:, None] * g.weights,
        )
        turned.append(forces(eps))
    weights = np.array([1, -8, 8, -1]) / (12 * slow)
    # the fifth power of the turn, and the same noise
    np.testing.assert_allclose(slopes[1], weights @ turned, rtol=1e-3)


def test_film_ends_within_a_cell():
    """The flow that the first dry cell takes up shows where the film ends: no staircase."""
    eps, q, ends = 0.5, 1.0, []
    for cells in ((60, 8), (120, 16), (240, 32)):
        grid = volumes.film_grid(eps, q, *cells)
        film = np.broadcast_to((np.sin(grid.theta) > 0)[:, None], grid.shape)
        p, film = volumes.solve_pressure(grid, film)
        ends.append(volumes.film_end(grid, p, film)[0] / cells[0])
    # on the mid-plane, of the ring: a cell is 4e-3 on the finest grid
    assert abs(ends[1] - ends[0]) < 2e-3
    assert abs(ends[2] - ends[1]) < 5e-4


@pytest.mark.parametrize("eps", [0.0, 1e-6, 1 - 1e-6])
def test_extreme_positions(eps):
    for options in ({}, {"grooved": True}, {"cavitation": "guembel"}):
        solved = reference_solution(eps, 0.5, coefficients=False, grids=MEDIUM, **options)
        numbers = solved.load_number, solved.friction_number, solved.peak_pressure
        assert np.all(np.isfinite(numbers))
        if eps == 0:
            assert solved.load_number == 0
            np.testing.assert_allclose(solved.friction_number, math.pi)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((1.0, 1.0), {}, "`eccentricity_ratio` must be >= 0 and < 1, but is 1"),
        ((-0.1, 1.0), {}, "`eccentricity_ratio` must be >= 0 and < 1"),
        ((0.5, 0.0), {}, "`length_ratio` must be > 0, but is 0"),
        ((0.5, 1.0), {"cavitation": "elrod"}, "`cavitation` must be one of reynolds, guembel"),
        ((0.5, 1.0), {"cavitation": "guembel", "grooved": True}, "for a bearing with grooves"),
    ],
)
def test_bad_input_is_refused(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        reference_solution(*arguments, **options)
