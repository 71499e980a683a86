"""Printed equations of the slider-link machine against the balances of its free bodies.

Forces come from the library; bodies, points of attack and inertia forces are set up here from
positions alone. Where the print of Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I).
Mathematical model*, differs, a test says by how much.
"""

import numpy as np
import pytest
from mechanism.test_slider_link import (
    Printed,
    bearings,
    compressor,
    coulomb_friction,
    crankshaft,
    kinematic_signs,
    loads_at,
    machine,
    product_of_inertia,
    random_states,
    sides,
    substitution,
)

from jaxcomp.mechanism import rotating

MU_C, MU_S = 0.2, 0.15
M = machine(offset=-2e-3, piston_centre_offset=-1.5e-3)
MADE = compressor(M, coulomb_friction(MU_C, MU_S))
STATE, GAS = random_states(300, 50)
# Forces reach 3 kN: rounding leaves 1e-12 N, which solving and arms of 5 cm raise to 1e-10.
TIGHT = dict(atol=1e-9, rtol=0)


@pytest.fixture(scope="module", params=["paper", "balanced"])
def loads(request):
    friction = coulomb_friction(MU_C, MU_S, slider_moment=request.param)
    return request.param, loads_at(compressor(M, friction), STATE, GAS)


@pytest.fixture(scope="module")
def bodies():
    """Positions and accelerations, from Eqs. (2), (3) and the drawing of the machine."""
    direction, second = (np.asarray(x) for x in rotating(*STATE))
    radius = float(M.crank_radius)
    centre = radius * direction  # of the slider
    crown = float(M.crown_to_link) + centre[0]
    edge = float(M.crown_to_link) + radius - float(M.cylinder_length)  # of the cylinder, fixed
    return centre, crown, np.full_like(crown, edge), radius * second


def moment(point, force, about):
    return (point[0] - about[0]) * force[1] - (point[1] - about[1]) * force[0]


def test_piston_with_link_is_in_balance(loads, bodies):
    """Eqs. (8), (9) from the free body, about the moving and about two fixed points."""
    reading, found = loads
    f = {name: np.asarray(force) for name, force in found.forces.items()}
    centre, crown, edge, acceleration = bodies
    axis, half_bore = -float(-M.offset), float(M.bore) / 2
    d3, d4, d5 = sides(found)
    side = d5 * float(M.slider_diameter) / 2
    attacks = [
        # a force of the wall along +y comes from the wall at -y
        (f["wall_crown"], (crown, axis - d3 * half_bore)),
        (f["wall_edge"], (edge, axis - d4 * half_bore)),
        (f["piston_film"], (crown, axis)),
        (np.stack([-np.asarray(GAS), 0 * crown]), (crown, axis)),
        # the slider presses on the face in front of it and drags that face along
        (f["link_slider"], (centre[0] + side, centre[1])),
    ]
    inertia = np.stack([float(M.piston_mass) * acceleration[0], 0 * crown])
    total = sum(force for force, _ in attacks)
    np.testing.assert_allclose(total, inertia, **TIGHT)
    if reading == "balanced":  # the slider's couple on the link, -M_b
        pin = np.asarray(found.loss_torque["crank_pin"])
        couple = pin - side * f["link_slider"][1]
    else:
        couple = 0.0
    at = (0 * crown, 0 * crown + axis + float(M.piston_centre_offset))
    for about in ((centre[0], axis), (0.0, axis), (0.03, 0.7)):
        left = sum(moment(point, force, about) for force, point in attacks)
        left = left + couple - moment(at, inertia, about)
        np.testing.assert_allclose(left, 0, atol=1e-9)
    # (9) has the arms of the walls about the point that moves with the link; about a fixed one, as
    # its text reads, they turn the piston by another moment
    fixed = sum(moment(p, force, (0.0, axis)) for force, p in attacks[:2])
    moving = sum(moment(p, force, (centre[0], axis)) for force, p in attacks[:2])
    assert np.abs(fixed - moving).max() > 1e-2


def test_slider_needs_the_couple_that_the_paper_leaves_out(loads, bodies):
    """Eqs. (16), (17) from the free body; its moments are short of M_b = d2 mu_s N D_s/2 - M_k."""
    _, found = loads
    f = {name: np.asarray(force) for name, force in found.forces.items()}
    _, _, _, acceleration = bodies
    total = f["crank_pin"] - f["link_slider"]
    np.testing.assert_allclose(total, float(M.slider_mass) * acceleration, **TIGHT)
    _, d2 = kinematic_signs(STATE)
    d5 = sides(found)[2]
    face = (d5 * float(M.slider_diameter) / 2, np.zeros_like(d5))  # from the pin's centre
    drag = np.asarray(found.loss_torque["crank_pin"])  # the turning pin drags the slider along
    short = -(moment(face, -f["link_slider"], (0.0, 0.0)) + drag)
    expected = d2 * MU_S * f["link_slider"][0] * float(M.slider_diameter) / 2 - drag
    np.testing.assert_allclose(short, expected, atol=1e-12)
    assert np.abs(expected).max() > 0.1


def test_crankshaft_is_in_balance_with_the_corrected_moments(loads):
    """Eqs. (25)-(30): forces and moments about x and y; (28) and (30) have wrong signs in print."""
    _, found = loads
    pin, a, b = (
        np.asarray(found.forces[k]) for k in ("crank_pin", "upper_bearing", "lower_bearing")
    )
    _, second = (np.asarray(x) for x in rotating(*STATE))
    shaft = MADE.crankshaft
    zs, (zp, zq) = float(shaft.origin), np.asarray(shaft.main_journal.position)
    zb, unbalance, product = zq - zp, float(shaft.unbalance), float(product_of_inertia(shaft))
    np.testing.assert_allclose(a + b - pin, unbalance * second, **TIGHT)
    # sum of z F over the shaft equals the rate of sum of z m v, which is J_xz times e''
    left = pin * zs - a * (zs - zp) - b * (zs - zp - zb)
    np.testing.assert_allclose(left, product * second, **TIGHT)
    # in the letters of the print, about y: M_Ry = J_xz (w^2 cos + a sin)
    m_ry = -product * second[0]
    corrected = pin[0] * zs - a[0] * (zs - zp) - b[0] * (zs - zp - zb) + m_ry
    printed = pin[0] * zs + a[0] * (zs - zp) + b[0] * (zs - zp - zb) + m_ry
    np.testing.assert_allclose(corrected, 0, atol=1e-9)
    np.testing.assert_allclose(printed, 2 * (pin[0] * zs + m_ry), atol=1e-9)  # by so much
    assert np.abs(printed).max() > 1
    arms = a[0] * (zp - zs) + b[0] * (zp + zb - zs)  # (30), second
    np.testing.assert_allclose(arms, -m_ry - pin[0] * zs, atol=1e-9)
    assert np.abs(arms - (-m_ry + pin[0] * zs)).max() > 1


def test_bracket_of_13():
    """The bracket that (13) lacks can only close where the determinant says."""
    found = loads_at(MADE, STATE, GAS)
    d1, d2 = kinematic_signs(STATE)
    d3, d4, d5 = sides(found)
    p = Printed(MADE, MU_C, MU_S, 4e-3 / 6e-6, STATE, GAS, (d1, d2, d3, d4, d5))
    phi, w, a = (np.asarray(x) for x in STATE)
    R, D, Ds = float(M.crank_radius), float(M.bore), float(M.slider_diameter)
    e, ecl = float(-M.offset), float(M.piston_centre_offset)
    X = -float(M.piston_mass) * R * (w**2 * np.cos(phi) + a * np.sin(phi))
    edge, h = (
        R * (1 - np.cos(phi)) + float(M.crown_to_link - M.cylinder_length),
        R * np.sin(phi) + e,
    )
    front = (D / 2 + ecl * d4) * d1 * MU_C
    gas = (((d1 * MU_C * D / 2 + edge) * d5 - Ds / 2) * d2 * MU_S + h) * p.G
    crown = np.asarray(found.forces["wall_crown"][1])

    def answer(bracket):
        return ((bracket * d2 * MU_S + h - ecl) * X + gas) / p.A

    np.testing.assert_allclose(answer((front + edge) * d5 - Ds / 2), crown, rtol=1e-10, atol=1e-9)
    for other in (front + edge * d5 - Ds / 2, (front + edge - Ds / 2) * d5):
        assert np.abs(answer(other) - crown).max() > 0.1


def test_pump_is_missing_in_the_print_of_35():
    whole = substitution(MADE, STATE, GAS, 0.25).acceleration
    without = compressor(M, MADE.friction, crankshaft(main_journal=bearings(pump=None)))
    printed = substitution(without, STATE, GAS, 0.25).acceleration
    found = loads_at(MADE, STATE, GAS)
    p = Printed(MADE, MU_C, MU_S, 4e-3 / 6e-6, STATE, GAS, (*kinematic_signs(STATE), *sides(found)))
    expected = float(MADE.crankshaft.main_journal.pump.torque) / (p.g4 + p.Jz)
    # both are substitutions from the same acceleration; up to 7e3 rad/s^2 with rounding of the sums
    np.testing.assert_allclose(printed - whole, expected, rtol=1e-8)


def test_direction_of_the_pin_force_needs_both_signs():
    """Eq. (18) prints arctg(F_ky/F_kx), which loses half of the directions."""
    found = loads_at(MADE, STATE, GAS)
    x, y = np.asarray(found.forces["crank_pin"])
    printed, right = np.arctan(y / x), np.arctan2(y, x)
    backwards = x < 0
    assert 10 < backwards.sum() < x.size
    np.testing.assert_allclose(printed[~backwards], right[~backwards], rtol=1e-14)
    np.testing.assert_allclose(np.abs(printed - right)[backwards], np.pi, rtol=1e-12)
