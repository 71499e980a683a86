"""Slides and thrust rings on a tapered film with a contact: against quadrature, limits, derivatives."""

import dataclasses as dc

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from jaxcomp import BadInput, SliderLinkFriction, load, solve_orbit
from jaxcomp.crank import Collocation
from jaxcomp.film import AsperityContact
from jaxcomp.friction import MixedSlide, MixedThrust
from jaxcomp.scene import with_value

ROUGH = AsperityContact(0.3e-6, 0.1, 100e9)
SLIDE = MixedSlide(ROUGH, 0.04, 0.05, 5e-6, 30e-6, 5e-3)
RING = MixedThrust(ROUGH, 0.011, 0.008, 3e-6, 50e-6, 4e-3)


@jax.jit
def _pressure(gap):
    return ROUGH.pressure(gap)


@jax.jit
def _parts(load_, speed):
    return SLIDE.parts(load_, speed)


@jax.jit
def _force(load_, speed):
    return SLIDE.force(load_, speed)


def pad(least, speed):
    """Load [N] of film and contact and their drags, by quadrature of Reynolds' equation along the pad.

    The flow to the sides by the share of the module, which is no solution of ours to be checked against.
    """

    def gap(x):
        return least + 5e-6 * x / 0.04

    across = np.pi * 0.05 / (2 * 0.04)
    sides = 1 - np.tanh(across) / across
    whole = [quad(lambda x, n=n: gap(x) ** -n, 0, 0.04, epsrel=1e-12)[0] for n in (2, 3)]
    at = whole[0] / whole[1]  # the thickness where the pressure is highest

    def pressure(x):
        return (
            6 * 5e-3 * speed * quad(lambda s: (gap(s) - at) / gap(s) ** 3, x, 0.04, epsrel=1e-10)[0]
        )

    film = 0.05 * quad(pressure, 0, 0.04, epsrel=1e-8)[0] * sides
    shear = 5e-3 * speed * 0.05 * quad(lambda x: 1 / gap(x), 0, 0.04, epsrel=1e-12)[0]
    touch = 0.05 * quad(lambda x: float(_pressure(gap(x))), 0, 0.04, epsrel=1e-9)[0]
    return film, touch, shear + 5e-6 / (2 * 0.04) * film


@pytest.mark.parametrize(("load_", "speed"), [(100.0, 1.0), (3000.0, 0.1), (3000.0, 1e-2)])
def test_a_pad_carries_by_film_and_contact(load_, speed):
    found = jax.tree.map(float, _parts(load_, speed))
    film, touch, drag = pad(found.thickness, speed)
    # what holds it at its clearance without a load, 1e-4 of 100 N at 1 m/s
    assert film + touch == pytest.approx(load_, rel=2e-2 if load_ < 1e3 else 1e-6)
    assert found.film == pytest.approx(drag, rel=1e-6)
    assert found.contact == pytest.approx(0.1 * touch, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("k", [0.005, 0.0199, 0.0201])
def test_a_nearly_parallel_pad_carries_by_the_same_law(k):
    """The load of a wide pad, ln(1 + k) - 2 k/(2 + k), in long numbers where its terms cancel."""
    across = np.pi * 0.05 / (2 * 0.04)
    least, ratio = 10e-6, np.longdouble(k)
    size = float(np.log1p(ratio) - 2 * ratio / (2 + ratio))
    unit = 6 * 5e-3 * 0.05 * 0.04**2 / (k * least) ** 2 * (1 - np.tanh(across) / across)
    made = dc.replace(SLIDE, taper=k * least, radial_clearance=1e-2)
    # 2e-8 of the thickness are left of the series and of the load that holds it at its clearance
    assert float(made.parts(unit * size, 1.0).thickness) == pytest.approx(least, rel=2e-8)


def test_the_pressure_of_the_wide_pad_is_highest_at_the_known_taper():
    """Rayleigh: k = 1.189 carries most, 0.1602 eta v L B^2/h_0^2 (times the sides' share)."""
    across = np.pi * 0.05 / (2 * 0.04)
    unit = 5e-3 * 0.05 * 0.04**2 * (1 - np.tanh(across) / across)

    @jax.jit
    def thickness(k, carried):  # of a pad with this taper over its least film of 5 um
        made = dc.replace(SLIDE, taper=k * 5e-6, radial_clearance=jnp.asarray(1e-3))
        return made.parts(carried, 1.0).thickness

    most = 0.160249 * unit / 5e-6**2
    assert float(thickness(1.18875, most)) == pytest.approx(5e-6, rel=1e-4)
    for k in (1.1, 1.3):  # carries less, so that it comes nearer
        assert float(thickness(k, most)) < 5e-6 * (1 - 1e-4)


def test_limits_of_a_slide():
    force = _force
    # no load: the drag of the film at the clearance, with a finite slope over the load
    drag = 5e-3 * 1.0 * 0.05 * 0.04 / 5e-6 * np.log1p(5 / 30)
    assert float(force(0.0, 1.0)) == pytest.approx(drag, rel=0.02)
    assert abs(float(jax.grad(_force)(0.0, 1.0))) < 1e-9
    # slow: Coulomb's law with the boundary coefficient; odd in the speed
    assert float(force(3000.0, 1e-5)) == pytest.approx(300.0, rel=0.01)
    assert float(force(3000.0, -1e-5)) == -float(force(3000.0, 1e-5))
    assert float(force(3000.0, 0.0)) == 0.0
    # Stribeck: least between
    speeds = np.geomspace(1e-3, 10, 200)
    curve = np.asarray(jax.vmap(_force, (None, 0))(1000.0, speeds))
    least = np.argmin(curve)
    assert np.all(np.diff(curve[: least + 1]) < 0)
    assert np.all(np.diff(curve[least:]) > 0)
    assert 1e-2 < speeds[least] < 1.0


def test_a_thrust_ring_is_six_pads_at_its_mean_radius():
    rate, weight = jnp.asarray(30.0), jnp.asarray(40.0)
    one = MixedSlide(ROUGH, 2 * np.pi * 0.0095 / 6, 0.003, 3e-6, 50e-6, 4e-3)
    wanted = 6 * 0.0095 * float(one.force(weight / 6, rate * 0.0095))
    assert float(RING.moment(rate, weight)) == pytest.approx(wanted, rel=1e-9)
    slow = float(RING.moment(jnp.asarray(1e-2), weight))
    assert slow == pytest.approx(0.1 * 40 * 0.0095, rel=0.01)


def test_derivatives_of_a_slide_through_the_first_touch():
    def force(p):
        rough = AsperityContact(p[0], p[1], 100e9)
        return dc.replace(SLIDE, contact=rough, dynamic_viscosity=p[2]).force(p[3], p[4])

    at = 0.3e-6, 0.1, 5e-3, 1000.0
    # one program for values and both modes
    program = jax.jit(lambda p: (*jax.value_and_grad(force)(p), jax.jacfwd(force)(p)))
    first = brentq(lambda v: float(_parts(1000.0, v).thickness) - 8 * 0.3e-6, 0.01, 10)
    for speed in (0.05 * first, 0.4 * first, first, 2 * first):
        here = np.array([*at, speed])
        value, backward, forward = program(here)
        np.testing.assert_allclose(backward, forward, rtol=1e-9, atol=1e-12)
        for column, size in enumerate(here):
            step = np.zeros(5)
            step[column] = 1e-5 * size
            (rise, *_), (fall, *_) = (program(here + side * step) for side in (1, -1))
            slope = float(rise - fall) / (2e-5 * size)
            scale = 1e-8 * float(value) / size
            assert float(forward[column]) == pytest.approx(slope, rel=1e-6, abs=scale)


def test_machines_with_mixed_slides():
    """A piston on its film and its asperities; a slider-link wants laws that go with the load."""
    wall = {"type": "mixed", "length": "80 mm", "width": "60 mm", "taper": "10 um",
            "radial_clearance": "50 um", "dynamic_viscosity": "0.2 mPa s",
            "contact": {"roughness": "0.4 um", "coefficient": 0.1}}  # fmt: skip
    machine = with_value(load("mayekawa-wbhe"), "friction.wall", wall).as_compressor()

    @jax.jit  # which computes no more than this
    def solved():
        orbit = solve_orbit(machine, Collocation(8, reversals=0, tolerance=1e-9), throw=False)
        return orbit.energy, orbit.loads.forces["wall"], orbit.state.angle, orbit.weight

    energy, force, angle, weight = solved()
    assert abs(float(energy.residual)) < 1e-9
    # what the dry piston of the file would lose under the same forces
    motion = jax.jit(lambda angle: machine.mechanism.kinematics(angle).position_1)
    path = np.asarray(weight) * np.abs(motion(angle))
    dry = load("mayekawa-wbhe").as_compressor().friction.wall.coefficient
    rubbing = float(dry * np.hypot(*np.asarray(force)) @ path)
    assert 0 < float(energy.losses["wall"]) < rubbing
    with pytest.raises(BadInput, match="proportional to the load"):
        SliderLinkFriction(wall=SLIDE)
    with pytest.raises(BadInput, match="inner_radius < outer_radius"):
        dc.replace(RING, inner_radius=jnp.asarray(0.02))
