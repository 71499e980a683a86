"""Published balancing examples, from the tables of their authors.

Vibration and correction are printed as modulus @ degrees; units are the papers' own.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.balancing import bounded, least_squares, min_max, trial_influence
from jaxcomp.balancing._influence import Influence, InfluenceRow


def at(text):
    size, angle = map(float, text.split("@"))
    return size * np.exp(1j * np.deg2rad(angle))


def system(matrix, initial):
    rows = tuple(InfluenceRow(f"sensor {i}", "ux", 1.0) for i in range(len(initial)))
    planes = tuple(f"plane {i}" for i in range(len(matrix[0])))
    table = jnp.array([[at(entry) for entry in row] for row in matrix])
    return Influence(table, jnp.array([at(v) for v in initial]), jnp.ones(len(rows)), rows, planes)


def off(found, printed):
    """Largest distance from the printed corrections, relative to the largest of them."""
    wanted = np.array([at(entry) for entry in printed])
    return np.max(np.abs(np.asarray(found) - wanted)) / np.max(np.abs(wanted))


def test_two_planes_of_bruel_and_kjaer():
    """Bruel & Kjaer application note 17-227, example 6: two trial runs of 1.15 g."""
    rows = (InfluenceRow("sensor 1", "ux", 1.0), InfluenceRow("sensor 2", "ux", 1.0))
    influence = trial_influence(
        np.array([at("170@112"), at("53@78")]),
        np.array([[at("235@94"), at("58@68")], [at("185@115"), at("77@104")]]),
        np.array([1.15, 1.15]),
        rows,
        ("plane 1", "plane 2"),
    )
    coefficients = [["78.433@58.4", "15.34@145.3"], ["9.462@10.2", "32.56@142.4"]]
    for found, printed in zip(np.asarray(influence.matrix), coefficients, strict=True):
        assert off(found, printed) < 1e-3  # printed to a tenth of a degree
    # printed to a tenth of a degree
    assert off(least_squares(influence).correction, ["1.979@236.2", "1.071@121.8"]) < 2e-3


def test_least_squares_of_goodman():
    """T. P. Goodman, A least-squares method for computing balance corrections, ASME 1964."""
    influence = system(
        [["3@0", "2@180"], ["5@0", "2@180"], ["5@0", "3@180"]], ["1@0", "1@180", "0@0"]
    )
    # two printed digits
    assert off(least_squares(influence).correction, ["0.81@0", "1.48@0"]) < 5e-3


def test_four_sensors_of_kelm_and_pavelek():
    """R. Kelm, W. Kelm, D. Pavelek, Rotor balancing tutorial, 45th Turbomachinery Symposium 2016."""
    influence = system(
        [
            ["0.04@58", "0.029@47.9"],
            ["0.034@123.3", "0.051@358"],
            ["0.039@31.8", "0.025@115.4"],
            ["0.046@311.5", "0.034@57.0"],
        ],
        ["0.97@175", "2.2@168", "0.84@327", "0.58@318.5"],
    )
    # The coefficients have two digits: scattered by half a unit of the last, the answer moves by 3 %.
    found = least_squares(influence).correction
    assert abs(abs(found[0]) / 17.5 - 1) < 0.03
    assert abs(np.rad2deg(np.angle(found[0])) + 130) < 3


FOILES = (
    [
        ["9.8@117", "17@124", "7.2@114", "38.5@77"],
        ["2.7@43", "14.3@317", "4.5@213", "14.3@270"],
        ["12.5@323", "25@261", "15.2@158", "30@238"],
        ["22.4@92", "32.6@45", "23.3@315", "27.8@210"],
        ["26@94", "40.3@9", "25@330", "34@213"],
        ["40.3@355", "43@144", "29.6@61", "65.4@322"],
        ["20.6@339", "32.3@152", "36.7@41", "61.8@322"],
        ["12.6@226", "37.6@52", "18.8@153", "26@176"],
        ["13.4@209", "26.9@76", "47.5@98", "71.7@312"],
        ["13.4@154", "22.4@307", "52@299", "102@165"],
        ["5.4@24", "7.2@199", "22.4@2", "27.8@99"],
    ],
    [
        "55@259", "45@118", "124@21", "138@349", "107@349", "90@280", "58@354", "108@201", "88@190",
        "56@48", "73@158",
    ],
)  # fmt: skip


@pytest.fixture(scope="module")
def foiles():
    return system(*FOILES)


def test_min_max_of_foiles_allaire_and_gunter(foiles):
    """Min-max optimum flexible rotor balancing compared to weighted least squares, 2000."""
    printed = ["4.42@88", "2.92@352", "1.588@322", "1.928@304"]
    theirs = jnp.array([at(entry) for entry in printed])
    largest = lambda b: float(jnp.max(jnp.abs(foiles.vibration(b))))  # noqa: E731
    found = min_max(foiles)
    assert float(found.gap) < 1e-5  # proven by its own bound
    # No correction of theirs may beat the proven bound, nor ours be worse than theirs.
    assert float(found.bound) <= largest(theirs)
    assert largest(found.correction) <= largest(theirs)
    # Their optimum is flat: within 10 % of the largest vibration before, which was 138.
    assert largest(theirs) - largest(found.correction) < 0.1 * 138
    assert largest(least_squares(foiles).correction) > largest(found.correction)


def test_masses_that_are_bounded_stay_so(foiles):
    """The same system with at most 3.402 in every plane."""
    found = bounded(foiles, 3.402)
    assert np.all(np.abs(np.asarray(found.correction)) <= 3.402 * (1 + 1e-9))
    assert float(found.objective) >= float(least_squares(foiles).objective)
    assert float(found.gap) < 1e-6
