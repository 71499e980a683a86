"""Measured friction torques of three bearings over speed: predicted, and with a fitted contact.

Source: D. E. Sander, H. Allmaier, H. H. Priebsch, Friction and wear in automotive journal bearings
operating in today's severe conditions, Advances in Tribology, IntechOpen 2016: a test rig with a loaded
bearing of 47.8 x 17.2 mm and a support of 54 x 25 mm on either side of it; torques as listed below, at
second hand. Assumed here, as they are not known to us: a clearance ratio of 1e-3 of all three, one
viscosity of 6.8 mPa s at all speeds and loads, half of the load on each support, one roughness of all,
and the stiffness of the asperities, 0.003 times 60 GPa. The bearings are rigid.
"""

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

from jaxcomp import JournalBearing
from jaxcomp.film import AsperityContact
from jaxcomp.film._bearing import friction_moment

RPM = np.pi / 30
# Specific load [Pa] on the test bearing: speeds [rpm] and torques [N m] of all three bearings.
MEASURED = {
    10e6: ([3000, 1000, 500, 400, 300, 250, 200, 150],
           [1.06, 0.544, 0.43, 0.46, 0.58, 0.747, 1.076, 1.71]),
    5e6: ([3000, 1000, 500, 400, 300, 250], [0.96, 0.46, 0.297, 0.257, 0.243, 0.34]),
}  # fmt: skip
CLEARANCE_RATIO, VISCOSITY, MODULUS = 1e-3, 6.8e-3, 60e9  # assumed; given; assumed


@jax.jit
def torques(roughness, coefficient, pressure, rates):
    rough = AsperityContact(roughness, coefficient, MODULUS)

    def bearing(diameter, length):
        gap = CLEARANCE_RATIO * diameter / 2
        return JournalBearing(diameter, length, gap, VISCOSITY, contact=rough)

    tested, support, load = (
        bearing(0.0478, 0.0172),
        bearing(0.054, 0.025),
        0.0478 * 0.0172 * pressure,
    )
    return friction_moment(tested, load, rates) + 2 * friction_moment(support, load / 2, rates)


def model(contact, pressure, speeds):
    roughness, coefficient = np.exp(contact)
    padded = np.resize(np.asarray(speeds, float), 8) * RPM  # one program for both lists
    return np.asarray(torques(roughness, coefficient, pressure, padded))[: len(speeds)]


@pytest.fixture(scope="module")
def fitted():
    """ln of roughness [m] and boundary coefficient, fitted at 10 MPa alone."""
    speeds, measured = MEASURED[10e6]
    return least_squares(
        lambda x: np.log(model(x, 10e6, speeds) / measured), np.log([0.3e-6, 0.05]), diff_step=1e-4
    ).x


def ratios(contact, pressure):
    speeds, measured = MEASURED[pressure]
    made = model(contact, pressure, speeds) / measured
    return dict(zip(speeds, made, strict=True))


def test_the_full_film_is_predicted_without_a_fit():
    """Within 10 % at six of eight places; 13.7 % too high at 10 MPa and 3000 rpm, and 11 % too low at
    500 rpm there, where the surfaces touch already."""
    smooth = np.log([1e-8, 0.05])  # nothing touches
    five, ten = (ratios(smooth, pressure) for pressure in (5e6, 10e6))
    for rpm in (3000, 1000, 500, 400):
        assert five[rpm] == pytest.approx(1, abs=0.035), rpm
    assert ten[1000] == pytest.approx(1, abs=0.08)
    assert ten[3000] == pytest.approx(1.137, abs=0.01)
    assert ten[500] == pytest.approx(0.89, abs=0.01)
    # and no contact is no explanation of slow running
    assert ten[150] < 0.15


def test_two_numbers_fit_the_mixed_friction_of_one_load(fitted):
    roughness, coefficient = np.exp(fitted)
    assert 0.2e-6 < roughness < 0.3e-6  # run-in surfaces
    assert 0.03 < coefficient < 0.12  # boundary friction
    found = ratios(fitted, 10e6)
    assert found.pop(3000) == pytest.approx(1.137, abs=0.01)  # of the film, which is not fitted
    assert found[1000] == pytest.approx(1, abs=0.08)
    for rpm in (500, 400, 300, 250, 200, 150):
        assert found[rpm] == pytest.approx(1, abs=0.06), rpm


def test_the_other_load_is_predicted(fitted):
    """Within 8 % at five of six places; a third too low at the slowest one, at 250 rpm."""
    found = ratios(fitted, 5e6)
    assert found.pop(250) == pytest.approx(0.66, abs=0.02)
    for rpm, ratio in found.items():
        assert ratio == pytest.approx(1, abs=0.09), rpm


@pytest.mark.parametrize(("pressure", "measured"), [(10e6, 500.0), (5e6, 300.0)])
def test_the_speed_of_least_friction_is_predicted(fitted, pressure, measured):
    """The lowest of the measured points; its neighbours are 20 % and more away."""
    speeds = np.geomspace(measured / 2, 2 * measured, 8)
    for _ in range(3):  # closer about the lowest one
        least = speeds[np.argmin(model(fitted, pressure, speeds))]
        width = speeds[1] / speeds[0]
        speeds = np.geomspace(least / width, least * width, 8)
    assert least == pytest.approx(measured, rel=0.12)
