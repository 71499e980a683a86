"""Journals that touch their bushes along their orbits: a march by SciPy, energy, slopes, the crank."""

import dataclasses as dc

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxcomp import JournalBearing, Status, load, solve_orbit
from jaxcomp.crank import Collocation, journal_films
from jaxcomp.crank._journal_orbit import journal_orbit
from jaxcomp.film import AsperityContact
from jaxcomp.film._bearing import film_unit, squeeze_of
from jaxcomp.film._placed import shear_drag
from jaxcomp.scene import with_value

SPEED = 300.0
SHARES = 1.0, 0.3  # rates of journal and bush over the speed
ROUGH = AsperityContact(0.5e-6, 0.08, 60e9)
BEARING = JournalBearing(0.04, 0.02, 30e-6, 1e-4, "short", contact=ROUGH)


@jax.jit
def pulsing(angle):
    """[N] A steady load with one pulse in a turn."""
    pulse = 2500 * jnp.exp(-4 * (1 - jnp.cos(angle - 2.0)))
    return jnp.stack([600 * jnp.cos(angle) + pulse, 300 + 400 * jnp.sin(angle) - 0.5 * pulse])


def orbit_of(bearing):
    rates = {"journal": SHARES[0], "bush": SHARES[1]}
    return journal_orbit(bearing, pulsing, SPEED, **rates)


@pytest.fixture(scope="module")
def orbit():
    found = orbit_of(BEARING)
    assert found.status == Status.converged
    return found


def push(e):
    """[N] Force of the contact by the trapezoidal rule round the ring, not by its series."""
    # of a smooth periodic pressure: 1e-14 of the force already with these
    theta = jnp.linspace(-np.pi, np.pi, 300, endpoint=False)
    n = jnp.stack([jnp.cos(theta), jnp.sin(theta)])
    pressure = ROUGH.pressure(30e-6 * (1 - e @ n))
    return 0.02 * 0.02 * (2 * np.pi / theta.size) * (n @ pressure)


def test_an_orbit_in_contact_is_that_of_a_march_by_scipy(orbit):
    """Radau from the place of the first node; the contact by quadrature of its pressure."""
    film, unit = squeeze_of(BEARING), float(film_unit(BEARING)) * SPEED

    def rate(e, angle):
        force = (pulsing(angle) - push(e)) / unit
        v = film.mobility(e[:, None], force[:, None])[:, 0]
        rates = v + 0.5 * sum(SHARES) * jnp.stack([-e[1], e[0]])
        return rates, rates

    # values are those beside the slopes: to compile another program takes longer
    both, first = jax.jit(jax.jacfwd(rate, has_aux=True)), float(orbit.angle[0])
    nodes = np.asarray(orbit.angle)[:: orbit.angle.size // 24]
    found = solve_ivp(
        lambda t, e: np.asarray(both(e, np.asarray(t))[1]), (first, first + 2 * np.pi),
        np.asarray(orbit.film.position)[:, 0], method="Radau",
        jac=lambda t, e: np.asarray(both(e, np.asarray(t))[0]), t_eval=[*nodes, first + 2 * np.pi],
        rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    # the series of the ring leaves 1e-6
    np.testing.assert_allclose(found.y[:, -1], found.y[:, 0], atol=1e-5)
    there = np.asarray(orbit.film.position)[:, :: orbit.angle.size // 24]
    np.testing.assert_allclose(found.y[:, :-1], there, atol=1e-5)
    share = orbit.film.contact_load / np.hypot(*orbit.film.load)
    assert 0.2 < share.max() < 0.9
    assert share.min() == 0


def test_the_losses_are_the_work_of_moments_and_load(orbit):
    """Mean of M_j w_j + M_b w_b + c F.de/dt; the push of the contact works nothing over the turn."""
    gap = 30e-6
    journal, bush = (share * SPEED for share in SHARES)

    @jax.jit  # as one program: outside of one every operation is compiled by itself
    def mean_power(film):
        e, load_ = film.position, film.load
        touch = jax.vmap(push, in_axes=1, out_axes=1)(e)
        velocity = squeeze_of(BEARING).mobility(e, (load_ - touch) / film_unit(BEARING))
        moved = velocity + 0.5 * (journal + bush) * jnp.stack([-e[1], e[0]])
        turning = e[0] * load_[1] - e[1] * load_[0]
        rubbing = film.contact_loss / (journal - bush)
        shear = shear_drag(BEARING, e) * (journal - bush) + rubbing
        work = journal * (shear - 0.5 * gap * turning) + bush * (-shear - 0.5 * gap * turning)
        work += gap * jnp.sum(load_ * moved, axis=0)
        return jnp.sum(film.duration * work) / jnp.sum(film.duration)

    film, mean = orbit.film, mean_power(orbit.film)
    parts = film.mean_shear_loss, film.mean_squeeze_loss, film.mean_contact_loss
    # the push works 1e-5 of the loss on the panels of this mesh
    assert float(mean) == pytest.approx(float(sum(parts)), rel=1e-4)
    assert all(float(part) > 0.02 * float(sum(parts)) for part in parts), parts
    assert np.min(film.contact_loss) >= 0


@pytest.mark.slow  # a minute of compilation
def test_derivatives_of_an_orbit_through_touching():
    """Of least film and losses over roughness, boundary coefficient and viscosity, in both modes."""

    def value(p):
        rough = AsperityContact(p[0], p[1], 60e9)
        film = orbit_of(dc.replace(BEARING, contact=rough, dynamic_viscosity=p[2])).film
        return 1e6 * film.minimum_film + film.mean_contact_loss + film.mean_squeeze_loss

    at = jnp.array([0.5e-6, 0.08, 1e-4])
    _, slopes = jax.jit(jax.value_and_grad(value))(at)
    along = jax.jit(lambda way: jax.jvp(value, (at,), (way,)))
    for column, size in enumerate(np.asarray(at)):
        way = np.zeros(3)
        way[column] = size
        base, forward = along(way)
        assert float(forward) == pytest.approx(float(slopes[column] * size), rel=1e-6)
        step = np.zeros(3)
        step[column] = 1e-4 * size
        fall, rise = (float(jax.jit(value)(at + s)) for s in (-step, step))
        # the square of a step of 1e-4, and 1e-10 of the value over it
        assert float(forward) == pytest.approx(
            (rise - fall) / 2e-4, rel=1e-4, abs=1e-5 * float(base)
        )


def test_out_of_touch_the_orbit_is_that_of_smooth_surfaces():
    oil = dc.replace(BEARING, dynamic_viscosity=jnp.asarray(2e-2))
    smooth, rough = (orbit_of(one) for one in (dc.replace(oil, contact=None), oil))
    assert float(smooth.film.minimum_film) > 8 * 0.5e-6
    assert float(rough.film.mean_contact_loss) == 0
    for name in ("minimum_film", "mean_shear_loss", "mean_squeeze_loss"):
        # of other panels beside a contact; 48 even ones leave 4e-7 in the film of the smooth journal
        own, other = (float(getattr(one.film, name)) for one in (rough, smooth))
        assert own == pytest.approx(other, rel=1e-6), name


@pytest.mark.parametrize(
    ("viscosity", "most"), [(1e-4, 0.98), pytest.param(1e-5, 0.999, marks=pytest.mark.slow)]
)
def test_contacts_that_carry_nearly_all_converge(viscosity, most):
    """By default: letting go within a degree takes panels there. Against four times as many panels."""

    @jax.jit
    def pounding(angle):
        pulse = 8000 * jnp.exp(-(((jnp.mod(angle, 2 * np.pi) - 3.3) / 0.35) ** 2))
        return jnp.stack([3000 * jnp.cos(angle) + pulse, 800 * jnp.sin(angle)])

    rough = dc.replace(BEARING, dynamic_viscosity=jnp.asarray(viscosity), contact=ROUGH)
    found = journal_orbit(rough, pounding, 100.0)
    assert found.status == Status.converged
    assert float(jnp.max(found.film.contact_load / jnp.hypot(*found.film.load))) > most
    edges = jnp.linspace(0, 2 * np.pi, 4 * 48 + 1)[:-1]
    finer = journal_orbit(rough, pounding, 100.0, edges=edges)
    error = abs(float(found.film.minimum_film - finer.film.minimum_film))
    # and the tolerance of the iteration, of the clearance
    assert error < 30 * (float(found.film.film_error) + 1e-13 * 30e-6)


PIN = {"type": "film", "film": "short", "diameter": "90 mm", "length": "45 mm",
       "radial_clearance": "45 um", "dynamic_viscosity": "0.2 mPa s",
       "contact": {"roughness": "0.6 um", "coefficient": 0.08}}  # fmt: skip


@pytest.mark.parametrize("motion", [pytest.param("steady", marks=pytest.mark.slow), "orbit"])
def test_the_crank_pays_for_film_and_contact(motion):
    """Its energy closes, and the loss of the pin is that of film and contact together."""
    scene = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN | {"motion": motion})
    machine = scene.as_compressor()

    @jax.jit  # as one program, which computes no more than what is looked at
    def solved():
        orbit = solve_orbit(machine, Collocation(8, reversals=0, tolerance=1e-9), throw=False)
        film = journal_films(machine, orbit)["crank_pin"]
        parts = film.mean_shear_loss, film.mean_squeeze_loss, film.mean_contact_loss
        return orbit.status, orbit.energy, orbit.mean_speed, jnp.stack(parts)

    status, energy, mean_speed, parts = solved()
    assert status == Status.converged
    power = energy.losses["crank_pin"] * mean_speed / (2 * np.pi)
    # means in time and over the angle, by the same nodes
    assert float(power) == pytest.approx(float(parts.sum()), rel=1e-9)
    assert float(parts[2]) > 0.01 * float(power)
    assert abs(float(energy.residual)) < 1e-9
