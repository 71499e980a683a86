"""Extreme designs of a crank whose journal moves, in one batch; and studies of such a machine."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from crank.test_journal_orbits import PIN
from typer.testing import CliRunner

from jaxcomp import Collocation, Shooting, Status, load, solve_orbit
from jaxcomp.cli import app
from jaxcomp.crank import journal_films
from jaxcomp.scene import with_value
from jaxcomp.study.accuracy._orbit_study import other_method
from jaxcomp.study.accuracy._study import Question

FAST = Collocation(nodes=8, reversals=0, tolerance=1e-9)
SET = (
    'friction.crank_pin={type="film", motion="orbit", diameter="90 mm", length="45 mm", '
    'radial_clearance="45 um", dynamic_viscosity="10 mPa s"}'
)


@pytest.fixture(scope="module")
def coupled():
    scene = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN)
    return scene.as_compressor()


def test_extreme_designs_are_converged_or_flagged_in_one_batch(coupled):
    """(clearance, viscosity, pressures and masses over their own): a film that closes is named."""
    cases = {
        "as it is": (45e-6, 0.01, 1.0),
        "clearance 0.45 um": (0.45e-6, 0.01, 1.0),
        "clearance 4.5 um": (4.5e-6, 0.01, 1.0),
        "clearance 0.45 mm": (450e-6, 0.01, 1.0),
        "clearance 4.5 mm": (4.5e-3, 0.01, 1.0),
        "no viscosity": (45e-6, 1e-12, 1.0),
        "no load": (45e-6, 0.01, 1e-9),
    }

    @jax.jit
    @jax.vmap
    def solve(design):
        clearance, viscosity, load_ = design
        made = eqx.tree_at(
            lambda c: (
                c.friction.crank_pin.radial_clearance,
                c.friction.crank_pin.dynamic_viscosity,
            ),
            coupled,
            (clearance, viscosity),
        )
        made = eqx.tree_at(
            lambda c: (
                c.gas.suction_pressure, c.gas.discharge_pressure, c.gas.back_pressure,
                c.mechanism.piston_mass, c.mechanism.conrod_mass, c.mechanism.conrod_inertia,
                c.crankshaft.unbalance,
            ),
            made,
            replace_fn=lambda value: value * load_,
        )  # fmt: skip
        orbit = solve_orbit(made, FAST, throw=False)
        return orbit, journal_films(made, orbit)["crank_pin"]

    orbit, film = solve(jnp.array(list(cases.values())))
    for leaf in jax.tree.leaves((orbit, film)):
        assert not np.any(np.isnan(leaf))
    converged = np.asarray(orbit.status == Status.converged)
    collapsed = np.asarray(orbit.status == Status.film_collapse)
    unresolved = np.asarray(orbit.status == Status.unresolved)
    assert np.all(converged | collapsed | unresolved), cases
    closing = {name for name, closed in zip(cases, collapsed, strict=True) if closed}
    assert closing == {"no viscosity", "clearance 4.5 mm"}
    # with edges at the load reversals, which `FAST` leaves out, a film of 1.53 µm
    assert {name for name, one in zip(cases, unresolved, strict=True) if one} == {
        "clearance 0.45 mm"
    }
    # without a load the film's own drag on the rod, some tenths of a newton metre, is all that is left
    number = list(cases).index("no load")
    assert 0 < film.largest_eccentricity[number] < 0.01
    assert film.mean_squeeze_loss[number] < 1e-3 * film.mean_shear_loss[number]
    # the wider the gap, the further out the journal
    assert np.all(np.diff(np.asarray(film.largest_eccentricity)[[1, 2, 0]]) > 0)


def test_a_pin_that_does_not_turn_in_the_mean_is_solved(coupled):
    """The piston pin: its bush swings, the journal stands; both pins move."""
    law = eqx.tree_at(lambda b: b.diameter, coupled.friction.crank_pin, jnp.asarray(0.05))
    both = eqx.tree_at(lambda c: c.friction.piston_pin, coupled, law)

    @jax.jit  # as one program, which computes no more than what is looked at
    def solved():
        orbit = solve_orbit(both, FAST, throw=False)
        films = journal_films(both, orbit)
        losses = {
            name: film.mean_shear_loss + film.mean_squeeze_loss for name, film in films.items()
        }
        pin = films["piston_pin"]
        ended = orbit.status, orbit.energy.residual
        return ended, (losses, orbit.loss_power), (pin.minimum_film, pin.steady_film)

    (status, residual), (losses, powers), (least, steady) = solved()
    assert status == Status.converged
    for name in ("piston_pin", "crank_pin"):
        assert float(losses[name]) == pytest.approx(float(powers[name]), rel=1e-9)
    assert abs(residual) < 1e-12
    # squeeze alone carries it: where its load stood still nothing but the swing would
    assert least > 2 * steady


@pytest.mark.slow
def test_a_slope_along_the_counterweight_is_that_of_differences(coupled):
    """The balance weight loads the main journal; its film and loss follow."""
    pin = coupled.friction.crank_pin
    moving = eqx.tree_at(
        lambda c: (c.crankshaft.main_journal, c.friction.crank_pin), coupled,
        (pin, load("mayekawa-wbhe").as_compressor().friction.crank_pin),
    )  # fmt: skip

    @jax.jit
    def read(unbalance):
        made = eqx.tree_at(lambda c: c.crankshaft.unbalance, moving, unbalance)
        orbit = solve_orbit(made, FAST, throw=False)
        film = journal_films(made, orbit)["main_journal"]
        return jnp.stack([1e6 * film.minimum_film, orbit.loss_power["main_journal"],
                          1e-6 * film.largest_pressure])  # fmt: skip

    at = moving.crankshaft.unbalance
    slope = jax.jit(jax.jacfwd(read))(at)
    difference = (read(at + 1e-5) - read(at - 1e-5)) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-5)


def run(*arguments):
    result = CliRunner().invoke(app, [*arguments, "--set", SET, "--json"])
    assert result.exit_code == 0, result.output
    text = result.stdout
    return json.loads(
        text[text.index("{") :],
        object_hook=lambda d: {key.split(" [")[0]: value for key, value in d.items()},
    )


@pytest.mark.slow
def test_a_sweep_of_the_clearance_has_the_films():
    found = run(
        "sweep", "mayekawa-wbhe", "--over", "friction.crank_pin.radial_clearance=20um:80um:4",
        "--quantity", "film_thickness.crank_pin", "--quantity", "thin_film_share.crank_pin",
        "--accuracy", "fast",
    )  # fmt: skip
    assert "film_thickness.crank_pin" in json.dumps(found)


@pytest.mark.slow
def test_an_optimum_keeps_its_film():
    found = run(
        "optimise", "mayekawa-wbhe", "--variable", "friction.crank_pin.radial_clearance=15um:80um",
        "--variable", "friction.crank_pin.length=20mm:80mm", "--objective", "friction_power",
        "--constraint", "film_thickness.crank_pin>=5um", "--samples", "16", "--starts", "1",
        "--accuracy", "fast",
    )  # fmt: skip
    text = json.dumps(found)
    assert "film_thickness.crank_pin" in text


@pytest.mark.slow
def test_a_tolerance_of_the_clearance_scatters_the_film():
    found = run(
        "tolerance", "mayekawa-wbhe", "--vary", "friction.crank_pin.radial_clearance=+-8 um",
        "--quantity", "film_thickness.crank_pin", "--limit", "film_thickness.crank_pin>=10.5um",
        "--samples", "256",
    )  # fmt: skip
    assert "film_thickness.crank_pin" in json.dumps(found)


def test_the_study_of_accuracy_has_a_second_method_where_journals_move(coupled):
    still = load("mayekawa-wbhe").machine
    moving = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN).machine
    assert isinstance(other_method(Question(still, "motor_power"))[0], Shooting)
    second = other_method(Question(moving, "loss_power.crank_pin"))[0]
    assert isinstance(second, Collocation)
    assert second.nodes != Question(moving, "motor_power").fine_solver.nodes
