"""Film models against published tables.

Frame of all tables: x along the load, y 90 degrees ahead with rotation; angles in degrees.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from film.someya import someya_two_axial_grooves

from jaxcomp.film import ExplicitFit, GroovedReynolds, Guembel, Ocvirk, Reynolds, reference_solution
from jaxcomp.film._film import (
    coefficients_per_load,
    convert_load_number,
    film_state,
    friction_at,
    load_number_at,
)

# Raimondi, A. A. and Boyd, J., ASLE Transactions 1 (1958), parts I-III, full bearing:
# eps, S (n in rev/s), phi [deg], (R/c) f.
RAIMONDI_BOYD = {
    1.0: """0.1 1.33 79.5 26.4    0.2 .631 74.02 12.8   0.4 .264 63.10 5.79   0.6 .121 50.58 3.22
            0.8 .0446 36.24 1.70  0.9 .0188 26.45 1.05  0.97 .00474 15.47 .514""",
    0.5: """0.1 4.31 81.62 85.6   0.2 2.03 74.94 40.9   0.4 .779 61.45 17.0   0.6 .319 48.14 8.10
            0.8 .0923 33.31 3.26  0.9 .0313 23.66 1.60  0.97 .00609 13.75 .610""",
    0.25: """0.1 16.2 82.31 322    0.2 7.57 75.18 153    0.4 2.83 60.86 61.1   0.6 1.07 46.72 26.7
             0.8 .261 31.04 8.80   0.9 .0736 21.85 3.50  0.97 .0101 12.22 .922""",
}

# Butenschoen, H.-J., dissertation, Karlsruhe 1976: Phi_p (So) and beta = phi [deg].
BUTENSCHOEN_EPS = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95])
BUTENSCHOEN = {
    1.0: (
        ".1196 .2518 .4091 .6108 .8903 1.3146 2.0432 3.5663 8.4352 18.7895",
        "79.410 73.858 68.264 62.571 56.705 50.536 43.859 36.235 26.482 19.450",
    ),
    0.5: (
        ".0368 .0783 .1304 .2026 .3124 .4982 .8595 1.7339 5.0881 13.3083",
        "81.767 75.142 68.493 61.778 54.993 48.049 40.803 32.938 23.566 17.265",
    ),
    0.25: (
        ".0098 .0210 .0354 .0560 .0888 .1476 .2708 .6043 2.1595 6.9248",
        "82.481 75.287 68.204 61.208 54.069 46.825 39.326 31.249 21.790 15.632",
    ),
}

# Someya, T. (ed.), Journal-Bearing Databook (1989), two axial grooves:
# S, eps, phi, (R/c) f, c K/W and c omega C/W, each xx xy yx yy.
SOMEYA = {
    0.5: """2.07   0.2  71.6  39.5  1.88  5.63  -4.41   2.56  11.2  2.22 2.22 6.43
            0.517  0.5  51.1  11.3  2.89  3.57  -0.924  2.03  6.81  2.10 2.10 2.60
            0.187  0.7  38.2  5.13  4.92  3.88   0.0235 1.83  7.32  2.16 2.16 1.70
            0.0315 0.9  22.7  1.56  13.8  5.76   1.24   1.72  10.6  2.03 2.03 0.846""",
    1.0: """0.689  0.2  69.9  13.2  1.99  5.45  -4.38   2.56  11.3  1.78 1.78 4.39
            0.194  0.5  49.1  4.37  2.67  3.09  -1.00   1.89  6.99  2.00 2.00 2.31
            0.0828 0.7  38.4  2.39  4.16  3.29  -0.0851 1.75  7.07  2.00 2.00 1.59
            0.0195 0.9  25.0  1.04  11.9  5.28   1.32   1.80  10.1  2.06 2.06 0.916""",
}

# L/D: (eps, Phi_p, Phi_T) of our own finite-difference solutions, to four digits.
OWN_SOLUTIONS = [
    (0.5, 0.5, 0.312, 3.692),
    (0.5, 0.9, 5.09, 8.12),
    (1.0, 0.1, 0.1221, 3.163),
    (1.0, 0.5, 0.8885, 3.817),
    (1.0, 0.7, 2.036, 4.901),
    (1.0, 0.9, 8.43, 8.912),
    (4 / 3, 0.5, 1.255, 3.902),
    (4 / 3, 0.9, 9.59, 9.255),
    (1.5, 0.7, 2.884, 5.155),
    (2.0, 0.5, 1.858, 4.049),
]


def rows(text: str, columns: int) -> np.ndarray:
    return np.array(text.split(), float).reshape(-1, columns)


def over(function, *values):
    return np.asarray(jax.jit(jax.vmap(function))(*map(jnp.asarray, values)))


@pytest.mark.parametrize("q", list(RAIMONDI_BOYD))
def test_reynolds_meets_raimondi_boyd(q):
    eps, number, phi, friction = rows(RAIMONDI_BOYD[q], 4).T
    film = Reynolds(q)
    load = over(lambda e: load_number_at(film, e), eps)
    ours = over(lambda p: convert_load_number(p, "load_number", "sommerfeld_number", q), load)
    angle = np.degrees(over(film.attitude_angle, eps / (1 - eps)))
    ratio = over(lambda x: friction_at(film, x), eps / (1 - eps)) / load

    # Their scatter, read off a coarse relaxation grid: 2 % in S, 0.8 degrees, 1.5 % in f up to
    # eps = 0.9; twice that where the thin zone was a few of their cells wide.
    fine = eps <= 0.9
    assert np.all(np.abs(ours / number - 1) < np.where(fine, 0.02, 0.04))
    assert np.all(np.abs(angle - phi)[fine] < 0.8)
    assert np.all(np.abs(ratio / friction - 1) < np.where(fine, 0.015, 0.04))
    # The typical row is much better, which a wrong film end would not survive.
    assert np.median(np.abs(ours / number - 1)) < 0.005
    assert np.median(np.abs(angle - phi)[fine]) < 0.25


@pytest.mark.parametrize("q", list(BUTENSCHOEN))
def test_reynolds_meets_butenschoen(q):
    load, phi = (np.array(column.split(), float) for column in BUTENSCHOEN[q])
    film = Reynolds(q)
    ours = over(lambda e: load_number_at(film, e), BUTENSCHOEN_EPS)
    angle = np.degrees(over(film.attitude_angle, BUTENSCHOEN_EPS / (1 - BUTENSCHOEN_EPS)))
    # Met within 0.27 % and 0.091 degrees; four printed decimals alone are 0.5 % of 0.0098.
    assert np.max(np.abs(ours / load - 1)) < 0.003
    assert np.max(np.abs(angle - phi)) < 0.1


@pytest.mark.parametrize(("q", "eps", "load", "friction"), OWN_SOLUTIONS)
def test_tabulated_solutions_are_met(q, eps, load, friction):
    # These solutions let the film start freely instead of on the line of maximum film, which moves
    # Phi_p at equal eps by up to 3 % at eps = 0.1, 0.6 % at eps >= 0.5 and L/D < 2 and 4.2 % at
    # L/D = 2, and Phi_T at equal load by up to 0.62 % (L/D = 1.5). An independent solver with
    # either start gives both sets of numbers.
    film = Reynolds(q)
    load_bound = 0.045 if q == 2 else 0.03 if eps < 0.5 else 0.006
    assert abs(load_number_at(film, eps) / load - 1) < load_bound
    assert abs(film.friction_number(jnp.asarray(load)) / friction - 1) < 0.0065
    # The bounds of the closed fit: 1.7 % for 0.5 <= q <= 1.5, 2.8 % to q = 2; 2.5 % in Phi_p.
    fit = ExplicitFit(q)
    assert abs(fit.friction_number(jnp.asarray(load)) / friction - 1) < (0.017 if q < 2 else 0.028)
    assert abs(load_number_at(fit, eps) / load - 1) < 0.025


@pytest.mark.parametrize("q", [0.5, 1.0])
def test_explicit_friction_meets_raimondi_boyd(q):
    _, number, _, friction = rows(RAIMONDI_BOYD[q], 4).T
    load = 1 / (2 * np.pi * number)
    # 1.6 %: the error of the fit, 1.7 %, less its luck on these rows
    assert (
        np.max(np.abs(over(ExplicitFit(q).friction_number, load) / (friction * load) - 1)) < 0.016
    )


@pytest.mark.parametrize("q", [0.25, 0.5, 1.0])
def test_film_ends_differ_as_is_known(q):
    """Half-Sommerfeld carries less, at a larger angle; Ocvirk carries more."""
    eps = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    load = {
        f: over(lambda e, f=f: load_number_at(f(q), e), eps) for f in (Reynolds, Guembel, Ocvirk)
    }
    deficit = 1 - load[Guembel] / load[Reynolds]
    assert 0.01 < deficit[2] < 0.12  # 2 to 11 % at eps 0.5, in whole per cent
    assert 0.085 < deficit[4] < 0.175  # 9 to 17 % at eps 0.9
    excess = (load[Ocvirk] / load[Reynolds])[[2, 4]]
    expected = {0.25: (1.06, 1.39), 0.5: (1.20, 2.36), 1.0: (1.68, 5.7)}[q]
    # printed with two digits
    np.testing.assert_allclose(excess, expected, rtol=0.01)
    turned = [over(f(q).attitude_angle, eps / (1 - eps)) for f in (Reynolds, Guembel)]
    assert np.all(turned[1] > turned[0])


@pytest.mark.parametrize("q", list(SOMEYA))
def test_someya_table_is_exact_at_its_points(q):
    for s, eps, phi, friction, *coefficients in rows(SOMEYA[q], 12):
        point = someya_two_axial_grooves(s, q)
        assert bool(point.inside)
        found = [point.eccentricity_ratio, np.degrees(point.attitude_angle)]
        found += [point.friction_number * 2 * np.pi * s, *point.stiffness.ravel()]
        found += [*point.damping.ravel()]
        # rounding of a cubic through four points
        np.testing.assert_allclose(found, [eps, phi, friction, *coefficients], rtol=1e-10)


@pytest.mark.parametrize("q", list(SOMEYA))
def test_someya_interpolation_has_no_overshoot(q):
    """Between its points the cubic keeps the order of the points: no swing of a polynomial."""
    table = rows(SOMEYA[q], 12)
    s = np.exp(np.linspace(np.log(table[-1, 0]), np.log(table[0, 0]), 60))
    points = jax.vmap(lambda s: someya_two_axial_grooves(s, q))(s)
    assert np.all(np.diff(points.eccentricity_ratio) < 0)
    assert np.all(np.diff(points.attitude_angle) > 0)
    assert np.all(np.diff(points.stiffness[:, 1, 0]) < 0)
    outside = someya_two_axial_grooves(2 * table[0, 0], q)
    assert not bool(outside.inside)
    assert bool(jnp.all(jnp.isfinite(outside.stiffness)))


def test_someya_refuses_other_lengths():
    with pytest.raises(ValueError, match=r"`length_ratio` must be 0.5 or 1.*0.75"):
        someya_two_axial_grooves(0.2, 0.75)


# How far a plain ring may be from the grooved bearing at the same S, of the largest entry, and the
# lightest load to which this applies (beyond it the grooves, which cut the film, matter more).
# Known as 10 % and 8 %, 23 % and 14 %; the first is 10.3 % with one more digit.
GROOVES = {0.5: (0.105, 0.08, 0.8), 1.0: (0.23, 0.14, 0.3)}


@pytest.mark.parametrize("q", list(SOMEYA))
def test_plain_ring_is_near_someyas_grooved_bearing(q):
    k_bound, c_bound, lightest = GROOVES[q]
    film = Reynolds(q)
    for row in rows(SOMEYA[q], 12):
        s, stiffness, damping = row[0], row[4:8].reshape(2, 2), row[8:].reshape(2, 2)
        ours = coefficients_per_load(
            film, convert_load_number(s, "sommerfeld_number", "load_number", q)
        )
        if s < lightest:
            assert np.abs(ours.stiffness - stiffness).max() < k_bound * np.abs(stiffness).max()
            assert np.abs(ours.damping - damping).max() < c_bound * np.abs(damping).max()
        else:
            assert 1.2 < ours.damping[1, 1] / damping[1, 1] < 2
        # the grooves take capacity: the plain ring runs less eccentrically
        state = film_state(film, convert_load_number(s, "sommerfeld_number", "load_number", q))
        assert state.eccentricity_ratio < row[1]


@pytest.mark.parametrize("q", list(SOMEYA))
def test_grooved_film_meets_someya(q):
    """Two axial grooves of 10 degrees, at his eccentricity ratios."""
    film = GroovedReynolds(q)
    for s, eps, phi, friction, *coefficients in rows(SOMEYA[q], 12):
        load = load_number_at(film, eps)
        ours = coefficients_per_load(film, load)
        state = film_state(film, load)
        assert abs(1 / (2 * np.pi * load) / s - 1) < 0.015
        stiffness, damping = np.array(coefficients).reshape(2, 2, 2)
        # 5 % of the largest entry; for the last row see the next test
        bound = 0.06 if (q, eps) == (1.0, 0.9) else 0.05
        assert np.abs(ours.stiffness - stiffness).max() < bound * np.abs(stiffness).max()
        assert np.abs(ours.damping - damping).max() < 0.05 * np.abs(damping).max()
        angle = np.degrees(state.attitude_angle) - phi
        # light load and L/D = 1, where the grooves matter most
        assert abs(angle) < (2.6 if (q, eps) == (1.0, 0.2) else 1.1)
        # shear over grooves and cavity is counted here
        assert 0.01 < state.friction_number / load / friction - 1 < 0.07


def test_someyas_stiffness_at_heavy_load_is_neither_our_grid_nor_our_groove():
    """L/D = 1, eps = 0.9: his K_xx is 5.6 % of the largest entry above ours. What moves ours?"""
    eps, q, printed = 0.9, 1.0, 11.9
    coarse, fine = ((60, 4), (120, 8), (240, 16)), ((120, 8), (240, 16), (480, 32))

    def stiffness(eps, grids):
        solved = reference_solution(eps, q, grooved=True, grids=grids)
        return solved.stiffness[0, 0] / solved.load_number

    ours = stiffness(eps, fine)
    # extrapolated, 240 x 16 cells give the same as 480 x 32, and those as 1920 x 64 (11.226)
    np.testing.assert_allclose(stiffness(eps, coarse), ours, rtol=1e-4)
    assert 0.05 < printed / ours - 1 < 0.065
    # grooves of 2 to 30 degrees give 11.14 to 11.50, the plain ring 10.65: none reaches 11.9. His
    # is ours at eps = 0.906, but there S is 7.8 % below his, while at 0.9 it is 0.6 % below. The row
    # itself does not fit together, or his pads differ by more than the grooves' width.
    np.testing.assert_allclose(stiffness(0.906, fine), printed, rtol=2e-3)


def test_revolutions_and_radians_are_not_mixed():
    """L/D = 1: rad/s in place of rev/s turns an eccentricity ratio of 0.6 into 0.17."""
    film = Reynolds(1.0)
    s = convert_load_number(load_number_at(film, 0.6), "load_number", "sommerfeld_number", 1.0)
    assert abs(s / 0.121 - 1) < 0.01  # Raimondi and Boyd, three digits
    mistaken = convert_load_number(2 * np.pi * s, "sommerfeld_number", "load_number", 1.0)
    # "about 0.17", two digits
    assert abs(film_state(film, mistaken).eccentricity_ratio - 0.17) < 0.01
