"""Slider-link machines whose crankshaft is a rotor: what each gives to the other."""

import re

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, Collocation, SceneError, load, loads, solve_orbit
from jaxcomp.compressor import loads_at
from jaxcomp.machine import assembled
from jaxcomp.mechanism import CrankState
from jaxcomp.vibration import crank_forces, shaking_wrench
from jaxcomp.vibration._coupling import film_coefficients, without

SHAFT = """
[rotor]
dof = 4

[[rotor.shafts]]
nodes = ["pin", "pin_2", "upper", "lower", "end"]
length = ["10 mm", "14 mm", "42 mm", "60 mm"]
outer_diameter = "16 mm"
young_modulus = "210 GPa"
density = "7800 kg/m^3"
poisson = 0.3

[[rotor.disks]]
nodes = ["end"]
mass = "0.9 kg"
polar_inertia = "4.5e-4 kg m^2"
transverse_inertia = "4e-4 kg m^2"

[[rotor.links]]
nodes = ["upper", "ground"]
law = { type = "film", bearing = "upper_bearing" }

[[rotor.links]]
nodes = ["lower", "ground"]
law = { type = "film", bearing = "lower_bearing" }

[[rotor.bodies]]
centre = "block"
nodes = ["head", "wall"]
mass = "6 kg"
inertia = { value = [[0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]], unit = "kg m^2" }
arm = { value = [[70, 0, 0], [60, 0, 0]], unit = "mm" }

[[rotor.links]]
nodes = ["block", "ground"]
law = { type = "mount", stiffness = ["40 N/mm", "40 N/mm"], damping = ["40 N s/m", "40 N s/m"] }

[[loads.unbalances]]
nodes = ["pin", "end"]
magnitude = ["500 g mm", "80 g mm"]
phase = ["170 deg", "60 deg"]

[loads.crank]
PINS
wall_position = "20 mm"
"""
ONE = 'pin = "pin"\nhead = "head"\nwall = "wall"'
TWO = 'pin = ["pin", "pin_2"]\nhead = ["head", "head"]\nwall = ["wall", "wall"]'
TWIN = '[[crankshaft.throws]]\nbanks = ["-20 deg", "50 deg"]\n\n'
# what the file has of the crankshaft
DERIVED = "inertia|mass|balanced|position"


def on_rotor(pins, *more, more_text=""):
    """The bundled machine with eccentric cylinder, the couple of the slider, and a shaft of its own."""
    text = load("slider-link-8cc").text.split("# z runs downwards along")[0]
    text = re.sub(rf"(?m)^({DERIVED}) = .*\n", "", text)
    changes = (
        ('slider_moment = { value = "paper"', 'slider_moment = { value = "balanced"'),
        (
            'offset = { value = "0 mm", source = "assumed, neutral" }\npiston',
            'offset = "2 mm"\npiston',
        ),
        *more,
    )
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return loads(text + more_text + SHAFT.replace("PINS", pins))


@pytest.fixture(scope="module")
def single():
    return on_rotor(ONE)


@eqx.filter_jit
def nodal_forces_and_wrench(made, orbit, crank, orders, alone):
    """Of one program, where every operation outside of one is compiled by itself."""
    return crank_forces(made, orbit, crank, orders), shaking_wrench(alone, orbit.state)


@pytest.mark.parametrize("twin", [pytest.param(False, marks=pytest.mark.slow), True])
def test_forces_on_the_nodes_add_up_to_the_inertia_of_piston_and_slider(single, twin):
    scene = on_rotor(TWO, more_text=TWIN) if twin else single
    made, case = scene.compressor, assembled(scene.machine).loads
    orbit = solve_orbit(made, Collocation(nodes=6, reversals=0))
    orders = tuple(range(7))
    # piston and slider alone: a crank without mass
    alone = eqx.tree_at(
        lambda c: (
            c.crankshaft.inertia,
            c.crankshaft.shaft_unbalance,
            c.crankshaft.shaft_couple,
        ),
        made,
        (jnp.asarray(1e-12), jnp.zeros(2), jnp.zeros(2)),
    )
    found, wrench = nodal_forces_and_wrench(made, orbit, case.crank, orders, alone)
    assert len(found.forces) == (6 if twin else 3)
    share = orbit.weight / orbit.state.speed
    phase = orbit.mean_speed * orbit.time - float(made.crankshaft.phase[0])
    waves = np.exp(-1j * np.outer(orders, phase)) * np.where(np.array(orders) == 0, 1, 2)[:, None]
    waves = waves * np.asarray(share / share.sum())
    each = [np.asarray(f.cosine - 1j * f.sine) for f in found.forces]
    force = waves @ np.asarray(wrench.force[:2]).T
    size = float(jnp.abs(orbit.loads.forces["crank_pin_1" if twin else "crank_pin"]).max())
    # linear in the forces at every node of the orbit: rounding only
    np.testing.assert_allclose(sum(each)[:, :2], force, atol=1e-11 * size)
    # about the shaft, with the moments of the forces on the walls; the joints' loop is closed with the
    # motion only, 3e-10 seen
    turning = sum(np.asarray(f.moment_cosine - 1j * f.moment_sine)[:, 2] for f in found.forces)
    for bank, wall in zip(made.crankshaft.bank_angle, each[2::3], strict=True):
        turning += 0.02 * (np.cos(bank) * wall[:, 1] - np.sin(bank) * wall[:, 0])
    np.testing.assert_allclose(
        turning, waves @ np.asarray(wrench.moment[2]), atol=1e-9 * size * 0.0096
    )


def test_a_crankshaft_follows_from_its_rotor(single):
    """Bearings, products and unbalance are those of a machine with the same numbers typed."""
    shaft = single.compressor.crankshaft
    mass = 0.9 + 7800 * np.pi / 4 * 0.016**2 * 0.126
    along = 500e-6 * np.exp(1j * np.deg2rad(170)) + 80e-6 * np.exp(1j * np.deg2rad(60))
    product = 0.126 * 80e-6 * np.exp(1j * np.deg2rad(60))
    assert float(shaft.mass) == pytest.approx(mass, rel=1e-12)
    assert complex(*shaft.shaft_unbalance) == pytest.approx(along, rel=1e-12)
    assert complex(*shaft.shaft_couple) == pytest.approx(product, rel=1e-12)
    np.testing.assert_allclose(shaft.main_journal.position, [0.024, 0.066], rtol=1e-12)
    np.testing.assert_array_equal(shaft.position, [0.0])


@eqx.filter_jit
def forces_and_wrench(compressor, state):
    """Of one program, where every operation outside of one is compiled by itself."""
    return loads_at(compressor, state).forces, shaking_wrench(compressor, state)


def test_one_of_several_on_a_rotor_is_one(single):
    """The unbalance ahead of the pin loads bearings and frame alike by either way."""
    listed = ONE.replace('"pin"\n', '["pin"]\n').replace('"head"\n', '["head"]\n')
    listed = listed.replace('wall = "wall"', 'wall = ["wall"]')
    one = on_rotor(listed, more_text='[[crankshaft.throws]]\nbanks = ["0 deg"]\n\n')
    angle = jnp.linspace(0.1, 6.0, 25)
    state = CrankState(angle, 300.0 + jnp.sin(angle), 500.0 * jnp.cos(angle))
    (first, of_first), (other, of_other) = (
        forces_and_wrench(scene.compressor, state) for scene in (single, one)
    )
    for bearing in ("upper_bearing", "lower_bearing"):
        # explicit but for the couple of the slider, which is closed to rounding
        np.testing.assert_allclose(first[bearing], other[bearing], atol=1e-9)
    for part, same in zip(of_first, of_other, strict=True):
        np.testing.assert_allclose(part, same, atol=1e-10 * np.abs(part).max())


def test_what_follows_from_the_rotor_is_not_typed():
    header = "[crankshaft]\n"
    with pytest.raises(SceneError, match=r"crankshaft.mass.*follows from the rotor"):
        on_rotor(ONE, (header, f'{header}mass = "1 kg"\n'))
    throws = '[[crankshaft.throws]]\nbanks = ["0 deg"]\nunbalance = "1 g mm"\n\n'
    with pytest.raises(SceneError, match=r"crankshaft.throws.0.unbalance.*follows from the rotor"):
        on_rotor(ONE, more_text=throws)
    apart = load("slider-link-8cc").as_compressor()
    apart = eqx.tree_at(lambda c: c.crankshaft.main_journal.position, apart, None)
    with pytest.raises(BadInput, match=r"position.*or a rotor with these bearings in it"):
        solve_orbit(apart)


@pytest.mark.slow  # the journal's orbit is compiled for half a minute
def test_films_of_a_slider_link_along_the_orbits_of_their_journals(single):
    law = '[bearings.upper_bearing]\ntype = "film"'
    orbit = f'{law}\nmotion = "orbit"'
    scene = on_rotor(ONE, (law, orbit))
    scene = loads(
        scene.text.replace(
            'law = { type = "film", bearing = "upper_bearing" }',
            'law = { type = "film", bearing = "upper_bearing", linearised = "orbit" }',
        )
    )
    made = assembled(scene.machine)
    state = solve_orbit(made.compressor, Collocation(nodes=12, reversals=0, tolerance=1e-10))
    assert set(state.positions) == {"upper_bearing"}
    ((number, found),) = film_coefficients(made.rotor, made.compressor, state).items()
    assert number == 0
    stiffness = np.asarray(found.stiffness)
    # of a film of 9 um under some 100 N: both directions are stiff and damped
    assert np.all(np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T)) > 1e5)
    assert np.all(np.linalg.eigvalsh(np.asarray(found.damping)) > 0)


def test_the_inertia_of_a_slider_link_is_left_out(single):
    made = without(single.compressor, ("inertia",))
    assert float(made.mechanism.slider_mass) < 1e-6 * 0.1
