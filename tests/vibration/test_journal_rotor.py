"""Stiffness and damping along the orbits of journals, in the rotor beside those at the mean load."""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from jaxcomp import BadInput, assembled, load, loads, solve_orbit, with_film_linearisation
from jaxcomp.cli import app
from jaxcomp.compressor import at_speed
from jaxcomp.crank import Collocation, journal_films
from jaxcomp.film import JournalBearing, NamedBearing, minimum_film
from jaxcomp.film._bearing import friction_moment
from jaxcomp.film._running import stiffness_damping
from jaxcomp.rotor import ConstantLaw, LoadedFilm, SpeedTable
from jaxcomp.vibration._coupling import loaded_rotor

GROOVED = (
    'film = { value = "grooved", source = "printed, Eq. (7) with Someya\'s databook: two axial '
    'grooves" }'
)


def moving_text(names=("upper-end", "upper", "lower")):
    """The machine of 68 cm3 with plain bearings; the journals of those that are named move."""
    text = load("hermetic-68cc").text.replace(GROOVED, "")
    for name in names:
        text = text.replace(
            f'[bearings.{name}]\ntype = "film"',
            f'[bearings.{name}]\ntype = "film"\nmotion = "orbit"',
        )
    return text


def test_a_journal_that_moves_is_a_steady_film_at_its_mean_load():
    load_, speed = jnp.array([300.0, -80.0]), jnp.asarray(314.0)
    plain = JournalBearing(0.026, 0.026, 13e-6, 6e-3)
    moving = JournalBearing(0.026, 0.026, 13e-6, 6e-3, motion="orbit")
    one = LoadedFilm(moving, load_).coefficients(speed)
    for found, wanted in zip(one, stiffness_damping(plain, load_, speed), strict=True):
        np.testing.assert_array_equal(found, wanted)
    # two lands of half the length carry half the load each
    half = JournalBearing(0.026, 0.013, 13e-6, 6e-3)
    both = JournalBearing(0.026, 0.026, 13e-6, 6e-3, lands=2)
    two = LoadedFilm(both, load_).coefficients(speed)
    for found, land in zip(two, stiffness_damping(half, load_ / 2, speed), strict=True):
        np.testing.assert_allclose(found, 2 * land, rtol=1e-14)
    moments = (f * friction_moment(b, 300.0 / f, speed) for f, b in ((1, both), (2, half)))
    np.testing.assert_allclose(*moments, rtol=1e-14)
    films = (minimum_film(b, 300.0 / f, speed) for f, b in ((1, both), (2, half)))
    np.testing.assert_allclose(*films, rtol=1e-14)


def test_what_cannot_be_linearised_along_an_orbit_is_named():
    with pytest.raises(BadInput, match="mean_load"):
        LoadedFilm(NamedBearing("upper"), linearised="mean")  # pyright: ignore
    with pytest.raises(BadInput, match="load"):
        LoadedFilm(NamedBearing("upper"), jnp.zeros(2), linearised="orbit")


def test_the_films_of_a_machine_are_linearised_either_way():
    machine = loads(moving_text()).machine
    laws = [link.law for link in with_film_linearisation(machine, "orbit").parts["rotor"].links[:4]]
    assert [getattr(law, "name", None) for law in laws] == ["upper-end", "upper", "lower", None]
    back = with_film_linearisation(with_film_linearisation(machine, "orbit"), "mean_load")
    assert {law.linearised for law in (link.law for link in back.parts["rotor"].links[:3])} == {
        "mean_load"
    }
    text = moving_text().replace('bearing = "upper"', 'bearing = "upper", linearised = "orbit"')
    assert loads(text).machine.parts["rotor"].links[1].law.name == "upper"
    # a bearing without a load of the crank; of the others no journal moves, which takes long to trace
    text = moving_text(("upper",)).replace(
        'bearing = "upper"', 'bearing = "upper", linearised = "orbit"'
    )
    text = text.replace('"upper-end", "upper", "lower"]', '"upper-end", "lower"]')
    with pytest.raises(BadInput, match="none of `crankshaft"):
        jax.eval_shape(lambda s: loaded_rotor(loads(text).assembly, s), jnp.array([314.0]))


@pytest.mark.slow
def test_the_rotor_has_the_means_along_the_orbits():
    machine = with_film_linearisation(loads(moving_text()).machine, "orbit")
    made, speeds = assembled(machine), jnp.array([300.0, 350.0])
    model = loaded_rotor(made, speeds)
    compressor = at_speed(made.compressor, speeds[1])
    orbit = solve_orbit(compressor, Collocation(reversals=0, tolerance=1e-11))
    films = journal_films(compressor, orbit)
    for number, name in enumerate(("upper-end", "upper", "lower")):
        law = model.links[number].law
        assert isinstance(law, SpeedTable)
        stiffness, damping = law.coefficients(speeds[1])
        np.testing.assert_allclose(stiffness, films[name].stiffness, rtol=1e-8)
        np.testing.assert_allclose(damping, films[name].damping, rtol=1e-8)
    at_one_speed = eqx.filter_eval_shape(lambda s: loaded_rotor(made, s), speeds[:1])
    assert isinstance(at_one_speed.links[0].law, ConstantLaw)


@pytest.mark.slow
def test_the_command_line_shows_the_difference_of_either_linearisation(tmp_path: Path):
    path = tmp_path / "machine.toml"
    path.write_text(moving_text())
    arguments = ["respond", str(path), "--speed", "3000rpm", "--orders", "1,2"]
    result = json.loads(
        CliRunner().invoke(app, [*arguments, "--json"]).stdout,
        object_hook=lambda d: {key.split(" [")[0]: value for key, value in d.items()},
    )
    both = result["linearised"]
    assert np.shape(both["orbit"]["films"]["lower"]["stiffness"]) == (1, 2, 2)
    still, along = (
        both[place]["major_axis"]["TP6 (6 from 54)"] for place in ("mean_load", "orbit")
    )
    assert still == result["nodes"]["TP6 (6 from 54)"]["major_axis"]
    # measured: 5.6 % less at order 1, 6.6 % at order 2, where the air gap is watched
    assert along[0][0] / still[0][0] == pytest.approx(0.944, abs=2e-3)
    assert along[1][0] / still[1][0] == pytest.approx(0.934, abs=2e-3)
    shown = CliRunner().invoke(app, arguments).stdout
    assert "Mean load" in shown
    assert "kxx" in shown
