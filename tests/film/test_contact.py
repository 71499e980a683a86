"""Contact of rough surfaces beside a film: integrals, limits, balance, derivatives, entries of files."""

import dataclasses as dc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from jaxcomp import BadInput, JournalBearing, load
from jaxcomp.film import (
    AsperityContact,
    Reynolds,
    _running,
    minimum_film,
    operating_point,
    stribeck_curve,
)
from jaxcomp.film._bearing import contact_moment, friction_moment, ring_contact
from jaxcomp.film._contact import elastic_factor, mean_excess, mean_excess_halves
from jaxcomp.film._running import running_state
from jaxcomp.scene import SceneError, with_value
from jaxcomp.scene._units import to_si

stiffness_damping = jax.jit(_running.stiffness_damping)

ROUGH = AsperityContact(0.3e-6, 0.1, 60e9)
SMOOTH = JournalBearing(0.0478, 0.0172, 23.9e-6, 6.8e-3)
MIXED = dc.replace(SMOOTH, contact=ROUGH)
BRIEF = dc.replace(MIXED, film="short")  # closed formulas, quick to compile
LOAD = 8222.0


def excess(n, u):
    """The integral of Greenwood and Tripp by SciPy's quadrature."""

    def law(s):
        return (s - u) ** n * np.exp(-s * s / 2) / np.sqrt(2 * np.pi)

    return quad(law, u, u + 12, epsabs=0, epsrel=1e-11, limit=200)[0]


@pytest.mark.parametrize("u", [0.0, 1.0, 3.0, 6.0])
def test_the_integrals_are_those_of_quadrature(u):
    third, fourth = mean_excess(jnp.asarray(u))
    # the recurrence loses four digits at 6 standard deviations, where the contact is 1e-9 of that at 0
    assert float(third) == pytest.approx(excess(3, u), rel=1e-9)
    assert float(fourth) == pytest.approx(excess(4, u), rel=1e-9)
    assert float(mean_excess_halves(jnp.asarray(u))) == pytest.approx(excess(2.5, u), rel=1e-12)


def test_the_elastic_factor_is_that_of_its_formula():
    # density 1e11/m^2, radius 1 um, roughness 0.4 um: eta beta sigma = 0.04, sigma/beta = 0.4
    wanted = 16 * np.sqrt(2) * np.pi / 15 * 0.04**2 * np.sqrt(0.4)
    assert elastic_factor(1e11, 1e-6, 0.4e-6) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("thickness", [0.0, 0.3e-6, 0.9e-6])
def test_the_force_of_a_ring_is_the_integral_of_the_pressure(thickness):
    """Cut after two terms of roughness over clearance: 4e-6 at a clearance of 80 times the roughness."""
    gap, eps = 23.9e-6, 1 - thickness / 23.9e-6
    size = 0.0239 * 0.0172 * 3e-3 * 60e9

    def round_the_ring(weight):
        def law(theta):
            return excess(2.5, gap * (1 - eps * np.cos(theta)) / 0.3e-6) * weight(theta)

        return 2 * size * quad(law, 0, 0.8, epsrel=1e-8, limit=100)[0]

    along, normal = ring_contact(MIXED).forces(jnp.asarray(eps))
    assert float(along) == pytest.approx(round_the_ring(np.cos), rel=1e-5)
    assert float(normal) == pytest.approx(round_the_ring(lambda theta: 1.0), rel=1e-5)


RPM = np.pi / 30
# Load [N] and speed [rpm]: out of touch, then from hardly any film to hardly any contact.
APART = [(0.0, 3000.0), (10.0, 3000.0), (500.0, 3000.0)]
TOUCHING = [(LOAD, rpm) for rpm in (1e-3, 10.0, 100.0, 300.0, 1000.0, 3000.0)]


@pytest.fixture(scope="module")
def points():
    """The steady states of the smooth and of the rough bearing under all loads, in lists."""
    solve = eqx.filter_jit(jax.vmap(operating_point, in_axes=(None, 0, 0)))
    loads, rpm = np.array(APART + TOUCHING).T
    return [solve(one, jnp.asarray(loads), jnp.asarray(rpm) * RPM) for one in (SMOOTH, MIXED)]


def test_out_of_touch_the_film_is_that_of_smooth_surfaces_to_the_last_bit(points):
    smooth, mixed = (jax.tree.map(lambda leaf: np.asarray(leaf)[:3], one) for one in points)
    assert np.all(smooth.minimum_film > 8 * 0.3e-6)
    assert np.all(mixed.contact_load == 0)
    assert np.all(mixed.contact_torque == 0)
    np.testing.assert_array_equal(mixed.minimum_film, smooth.minimum_film)
    np.testing.assert_array_equal(mixed.friction_torque, smooth.friction_torque)
    # the attitude is an arc tangent of the film's own cosine and sine; stiffness follows from both
    np.testing.assert_allclose(mixed.attitude_angle, smooth.attitude_angle, rtol=1e-14)
    for load_ in (10.0, 500.0):
        force = np.array([load_, 0.0])
        own, beside = (
            stiffness_damping(one, force, 300.0) for one in (dc.replace(BRIEF, contact=None), BRIEF)
        )
        np.testing.assert_allclose(beside.stiffness, own.stiffness, rtol=1e-12)
        np.testing.assert_allclose(beside.damping, own.damping, rtol=1e-12)


def test_film_and_contact_carry_the_load_and_share_the_friction(points):
    """Against the balance by a bracketing root finder."""
    film, contact = Reynolds(SMOOTH.length_ratio), ring_contact(MIXED)

    @jax.jit
    def parts(x, unit):
        size = unit * x * film.load_gain(x)
        phi, eps = film.attitude_angle(x), x / (1 + x)
        push, normal = contact.forces(eps)
        couette = jnp.pi / jnp.sqrt(1 - eps**2) + 0.5 * eps * size / unit * jnp.sin(phi)
        return jnp.hypot(size * jnp.cos(phi) + push, size * jnp.sin(phi)), couette, normal

    for place, (_, rpm) in enumerate(TOUCHING, len(APART)):
        unit = 6.8e-3 * rpm * RPM * 0.0172 * 0.0478 / 1e-3**2
        log = brentq(lambda z, u=unit: float(parts(np.exp(z), u)[0]) / LOAD - 1, -3, 12, xtol=1e-13)
        _, couette, normal = parts(np.exp(log), unit)
        found = jax.tree.map(
            lambda leaf, i=place: float(leaf[i]) if leaf.ndim == 1 else 0, points[1]
        )
        assert found.minimum_film == pytest.approx(23.9e-6 / (1 + np.exp(log)), rel=1e-10)
        rubbing = 0.1 * 0.0239 * float(normal)
        assert found.contact_torque == pytest.approx(rubbing, rel=1e-8, abs=1e-20)
        # the friction of the film is a fit of its own, within 1e-4 of that at its position
        torque = unit * 0.0239 * 1e-3 * float(couette)
        own = found.friction_torque - found.contact_torque
        assert own == pytest.approx(torque, rel=2e-4), rpm


def test_slow_surfaces_rub_with_the_boundary_coefficient():
    torque = float(contact_moment(BRIEF, LOAD, 1e-9, rest_speed=0.0))
    # no film is left; the pressures beside the line of centres add 0.3 %
    assert torque == pytest.approx(0.1 * LOAD * 0.0239, rel=0.005)
    assert torque > 0.1 * LOAD * 0.0239
    whole = float(friction_moment(BRIEF, LOAD, 1e-2))
    assert float(friction_moment(BRIEF, LOAD, -1e-2)) == -whole
    assert float(friction_moment(BRIEF, LOAD, 0.0)) == 0.0


def test_rubbing_follows_the_sliding_and_pressure_its_own_speed():
    """Of a load that turns with half the speed of the journal; without rubbing and that part alone."""
    rate, slow = 30.0, 15.0
    film = dc.replace(BRIEF, contact=dc.replace(ROUGH, coefficient=jnp.zeros(())))
    parts = friction_moment(film, LOAD, rate, entrainment=slow), contact_moment(BRIEF, LOAD, slow)
    both = float(friction_moment(BRIEF, LOAD, rate, entrainment=slow))
    # the senses of 15 and 30 rad/s are 1 less 2e-9 and 6e-10
    assert both == pytest.approx(float(sum(parts)), rel=1e-8)


def test_stiffness_is_the_slope_of_the_load_over_the_position():
    """K by differences of the position under loads along x and across, by the compliance."""
    rate, step = 5.0, 1e-3 * LOAD

    @jax.jit
    def position(force):
        size, line = jnp.hypot(*force), jnp.arctan2(force[1], force[0])
        state = running_state(BRIEF, size, rate)
        angle = line + state.attitude_angle
        return 23.9e-6 * state.eccentricity_ratio * jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    base = np.array([LOAD, 0.0])
    columns = [(position(base + s) - position(base - s)) / (2 * step) for s in step * np.eye(2)]
    wanted = np.linalg.inv(np.stack(columns, axis=1))
    found = stiffness_damping(BRIEF, base, rate)
    # central differences with a step of 1e-3 of the load, in a contact that stiffens
    np.testing.assert_allclose(found.stiffness, wanted, atol=1e-4 * np.abs(wanted).max())
    assert float(ring_contact(BRIEF).forces(jnp.hypot(*position(base)) / 23.9e-6)[0]) > 0.05 * LOAD


def friction_and_film(p):
    sigma, friction, viscosity, gap, load_, rate = p
    rough = AsperityContact(sigma, friction, 60e9)
    made = JournalBearing(0.0478, 0.0172, gap, viscosity, film="short", contact=rough)
    both = jnp.stack([friction_moment(made, load_, rate), 1e5 * minimum_film(made, load_, rate)])
    return both, both


def test_derivatives_in_both_modes_through_the_first_touch():
    """At 8 times the roughness, where the contact begins, and on either side of it."""
    # one program for values and slopes: to compile another takes longer than its answers
    forward_mode = jax.jit(jax.jacfwd(friction_and_film, has_aux=True))
    backward_mode = jax.jit(jax.jacrev(friction_and_film, has_aux=True))

    def value(at):
        return np.asarray(forward_mode(at)[1])

    begins = brentq(lambda n: value(np.append(PLACE[:5], n))[1] - 1e5 * 8 * 0.3e-6, 10, 1000)
    for rate in (0.05 * begins, 0.3 * begins, begins, 1.5 * begins):
        at = np.append(PLACE[:5], rate)
        forward, backward = (np.asarray(mode(at)[0]) for mode in (forward_mode, backward_mode))
        np.testing.assert_allclose(backward, forward, rtol=1e-9, atol=1e-12 * np.max(forward))
        for column, size in enumerate(at):
            step = np.zeros(6)
            step[column] = 1e-5 * size
            slope = (value(at + step) - value(at - step)) / (2e-5 * size)
            # rounding over the step of 1e-5, and the square of that step
            noise = 1e-8 * np.max(np.abs(value(at))) / size
            np.testing.assert_allclose(forward[:, column], slope, rtol=1e-6, atol=noise)


PLACE = np.array([0.3e-6, 0.1, 6.8e-3, 23.9e-6, 1000.0, 10.0])


def test_the_curve_of_stribeck_has_its_least_friction_between_film_and_contact():
    speed = np.geomspace(20, 3000, 100) * RPM
    curve = stribeck_curve(BRIEF, 2000.0, speed)
    least, film = float(curve.least_friction_speed), curve.friction_torque - curve.contact_torque
    assert speed[5] < least < speed[-5]
    assert np.all(film > 0)
    assert np.all(np.diff(curve.contact_torque) <= 0)
    assert float(curve.contact_torque[0]) > 0.9 * float(curve.friction_torque[0])
    assert float(curve.contact_torque[-1]) == 0
    for i in (0, 30, 99):
        wanted = friction_moment(BRIEF, 2000.0, speed[i])
        assert float(curve.friction_torque[i]) == pytest.approx(float(wanted), rel=1e-12)
    smooth = stribeck_curve(dc.replace(BRIEF, contact=None), 2000.0, speed)
    assert np.all(smooth.contact_torque == 0)
    assert np.all(np.diff(smooth.friction_torque) > 0)
    finer = stribeck_curve(BRIEF, 2000.0, least * np.linspace(0.9, 1.1, 100))
    best = finer.speed[np.argmin(finer.friction_torque)]
    assert least == pytest.approx(float(best), rel=5e-3)  # of a parabola through steps of 5 %
    with pytest.raises(BadInput, match="rise"):
        stribeck_curve(BRIEF, 2000.0, speed[::-1])


# ---------------------------------------------------------------- parts and files
def test_what_a_bearing_in_contact_may_not_be():
    with pytest.raises(BadInput, match="reynolds, grooved, guembel, short beside a contact"):
        dc.replace(MIXED, film="petroff")
    with pytest.raises(BadInput, match=r"absent beside `contact.roughness`"):
        dc.replace(MIXED, roughness=jnp.asarray(1e-6))
    with pytest.raises(BadInput, match="12 times the roughness"):
        dc.replace(MIXED, contact=dc.replace(ROUGH, roughness=jnp.asarray(3e-6)))
    with pytest.raises(BadInput, match="roughness"):
        AsperityContact(-1e-7, 0.1)


def test_a_machine_file_describes_the_contact_with_units_and_bounds():
    pin = {"type": "film", "diameter": "90 mm", "length": "45 mm", "radial_clearance": "45 um",
           "dynamic_viscosity": "10 mPa s"}  # fmt: skip
    contact = {"roughness": "0.4 um", "coefficient": "12 %", "modulus": "60 GPa"}
    scene = with_value(load("mayekawa-wbhe"), "friction.crank_pin", pin | {"contact": contact})
    found = scene.as_compressor().friction.crank_pin.contact
    assert float(found.roughness) == pytest.approx(to_si("0.4 um", "m", "roughness"))
    assert float(found.coefficient) == pytest.approx(0.12)
    assert float(found.modulus) == pytest.approx(60e9)
    assert float(found.elastic_factor) == 3e-3
    for entry, words in (({"coefficient": -0.1}, ">= 0"), ({"roughness": "0.4 s"}, "dimension"),
                         ({"hardness": 1.0}, "hardness")):  # fmt: skip
        with pytest.raises((SceneError, BadInput), match=words):
            with_value(scene, "friction.crank_pin", pin | {"contact": contact | entry})


def test_a_film_without_contact_is_traced_without_one():
    def program(bearing):
        return jax.make_jaxpr(lambda w: friction_moment(bearing, w, 30.0))(LOAD)

    smooth, mixed = program(SMOOTH), program(MIXED)
    assert "erf" not in str(smooth)
    assert "erf" in str(mixed)
    assert eqx.tree_equal(SMOOTH, dc.replace(MIXED, contact=None))
