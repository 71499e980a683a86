"""Cylinders of one machine whose laws differ in kind: groups that are evaluated each at once."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from crank.test_several_cylinders import COARSE, LAYOUTS, several

from jaxcomp import BadInput, SceneError, load, loads, solve_orbit
from jaxcomp.compressor import instants, kink_angles, loads_at
from jaxcomp.crank._films import film_thickness
from jaxcomp.film import JournalBearing
from jaxcomp.friction import CoulombJournal, CoulombSlide, RegularisedJournal, RegularisedSlide
from jaxcomp.friction._joint_laws import EachJournal, EachSlide
from jaxcomp.gas import CrankAngleTable, PolytropicCycle, StagedCycle
from jaxcomp.gas._gas_law import EachGas
from jaxcomp.mechanism import CrankState
from jaxcomp.scene import with_values


class SameCycle(PolytropicCycle):
    """Another kind with the same equations."""

    in_files = False


def same_numbers(made):
    """Two groups by kind of every law, in another order than the cylinders; the same numbers."""
    gas, friction = made.gas, made.friction
    other = SameCycle(
        gas.suction_pressure,
        gas.discharge_pressure,
        gas.exponent,
        gas.clearance_ratio,
        gas.back_pressure,
    )
    count = made.crankshaft.count
    turns = tuple(2 - place % 2 for place in range(count))
    # the transition is over at the slowest node: tanh is 1 there but for rounding
    wall = EachSlide((CoulombSlide(0.083), RegularisedSlide(0.083, 1e-9)), turns)
    journal = EachJournal(
        (CoulombJournal(0.013, 0.09), RegularisedJournal(0.013, 0.09, 1e-9)), turns
    )
    return dataclasses.replace(
        made,
        gas=EachGas((gas, other), turns),
        friction=dataclasses.replace(friction, wall=wall, crank_pin=journal),
    )


ANGLE = jnp.linspace(0.2, 6.1, 23)
STATE = CrankState(ANGLE, 104.0 + jnp.cos(ANGLE), 300.0 * jnp.sin(ANGLE))


@eqx.filter_jit
def at_instants(machine):
    return loads_at(machine, STATE), instants(machine, ANGLE)


def test_groups_with_the_same_numbers_are_one_group():
    made = several(LAYOUTS[4])
    mixed = same_numbers(made)
    kinks_of = eqx.filter_jit(kink_angles)
    np.testing.assert_array_equal(kinks_of(mixed), kinks_of(made))
    (one, at), (other, same) = (at_instants(machine) for machine in (made, mixed))
    # rounding of powers and sums that are vectorised in another way
    np.testing.assert_allclose(at.pressure, same.pressure, rtol=1e-13)
    for joint, loss in one.loss_torque.items():
        np.testing.assert_allclose(other.loss_torque[joint], loss, rtol=1e-11, err_msg=joint)
    assert set(one.loss_torque) == set(other.loss_torque)


@pytest.mark.slow  # two programs
def test_groups_with_the_same_numbers_have_one_orbit():
    made = several(LAYOUTS[4])
    mixed = same_numbers(made)
    one, other = (solve_orbit(machine, COARSE) for machine in (made, mixed))
    # rounding of vectorised sums
    for name in ("mechanical_efficiency", "speed_fluctuation"):
        assert float(getattr(one, name)) == pytest.approx(float(getattr(other, name)), abs=1e-14)
    for joint, loss in one.energy.losses.items():
        assert float(other.energy.losses[joint]) == pytest.approx(float(loss), rel=1e-12), joint


MIXED = """
[gas]
type = "each"
of_cylinder = [1, 2]

[[gas.laws]]
type = "polytropic"
suction_pressure = "0.98 bar"
discharge_pressure = "9.8 bar"
exponent = 1.05
clearance_ratio = "0.76 %"

[[gas.laws]]
type = "crank_angle_table"
angle = ["0 deg", "20 deg", "60 deg", "180 deg", "240 deg", "300 deg", "330 deg"]
cylinder_pressure = ["9.8 bar", "0.9 bar", "0.9 bar", "0.95 bar", "1.5 bar", "5 bar", "9.8 bar"]
back_pressure = "1.1 bar"

[friction]
type = "slider_crank"

[friction.wall]
type = "each"
laws = [
  { type = "coulomb", coefficient = 0.083 },
  { type = "regularised", coefficient = 0.05, transition_speed = "10 mm/s" },
]

[friction.crank_pin]
type = "each"
laws = [{ type = "coulomb", coefficient = 0.013, diameter = "90 mm" }, "big-end"]

[bearings.big-end]
type = "film"
diameter = "90 mm"
length = "50 mm"
radial_clearance = "45 um"
dynamic_viscosity = "10 mPa s"
"""


def scene_text():
    """The bundled machine with two unlike cylinders in V60."""
    text = load("mayekawa-wbhe").text
    head = text[: text.index("[gas]")]
    lines = [line for line in head.splitlines() if not line.startswith("unbalance")]
    lines.insert(lines.index("[crankshaft]") + 1, 'layout = "V60"')
    return "\n".join(lines) + MIXED


@pytest.fixture(scope="module")
def scene():
    return loads(scene_text())


def test_every_cylinder_has_its_own_law(scene):
    """At any instant forces and losses of a cylinder are those of a machine with its law in both."""
    made = scene.as_compressor()
    found, at = at_instants(made)
    for number in (1, 2):
        alike = dataclasses.replace(
            made,
            gas=made.gas.law_of_cylinder(number),
            friction=dataclasses.replace(
                made.friction,
                wall=made.friction.wall.law_of_cylinder(number),
                crank_pin=made.friction.crank_pin.law_of_cylinder(number),
            ),
        )
        wanted, same = at_instants(alike)
        place = number - 1
        np.testing.assert_allclose(at.pressure[place], same.pressure[place], rtol=1e-14)
        np.testing.assert_allclose(at.gas_force[place], same.gas_force[place], atol=1e-9)
        for joint in (f"wall_{number}", f"crank_pin_{number}"):
            # the films are inverted to rounding in either way
            np.testing.assert_allclose(
                found.loss_torque[joint], wanted.loss_torque[joint], rtol=1e-10
            )
            np.testing.assert_allclose(found.forces[joint], wanted.forces[joint], atol=1e-8)
    assert not np.allclose(at.pressure[0], at.pressure[1])


@pytest.mark.slow  # a program and its derivative
def test_derivatives_to_a_number_of_a_law(scene):
    made = scene.as_compressor()

    def places(c):
        wall, pin = c.friction.wall.laws[1], c.friction.crank_pin.laws[1]
        return wall.coefficient, pin.radial_clearance, c.gas.laws[0].exponent

    start = jnp.stack(places(made))

    def efficiency(share):
        changed = eqx.tree_at(places, made, tuple(start * (1 + share)))
        return solve_orbit(changed, COARSE, throw=False).mechanical_efficiency

    slope = np.asarray(jax.jit(jax.grad(efficiency))(jnp.zeros(3)))
    value, step = jax.jit(efficiency), 1e-4
    for place in range(3):
        shift = step * np.eye(3)[place]
        difference = float(value(shift) - value(-shift)) / (2 * step)
        # central differences: 1e-8 of the second derivative, and kinks between the nodes
        assert slope[place] == pytest.approx(difference, rel=1e-4, abs=1e-9), place
        assert abs(difference) > 1e-5


def test_the_film_of_one_pin_is_told(scene):
    orbit = solve_orbit(scene, COARSE)
    assert abs(orbit.energy.residual) < 1e-12
    made = scene.as_compressor()
    assert set(film_thickness(made, orbit)) == {"crank_pin_2"}
    assert isinstance(made.friction.crank_pin.law_of_cylinder(2), JournalBearing)


def test_what_does_not_go_together_is_named(scene):
    made = several(LAYOUTS[2])
    gas = made.gas
    with pytest.raises(BadInput, match=r"gas.of_cylinder.*one law for each of 2 cylinders"):
        dataclasses.replace(made, gas=EachGas((gas, gas, gas)))
    with pytest.raises(BadInput, match=r"of_cylinder.*numbers from 1 to 2"):
        EachGas((gas, gas), (1, 3))
    with pytest.raises(BadInput, match=r"laws.*one law at least"):
        EachGas(())
    with pytest.raises(BadInput, match=r"laws.1.exponent.*a law of their own"):
        EachGas((gas, dataclasses.replace(gas, exponent=[1.1, 1.2])))
    staged = StagedCycle((1, 2), 1e5, 9e5, 1.3, 0.1)
    with pytest.raises(BadInput, match=r"laws.1.*a law of one cylinder, but is staged"):
        EachGas((gas, staged))
    journal = made.friction.piston_pin
    each = EachJournal((journal, journal))
    shaft = dataclasses.replace(made.crankshaft, main_journal=each)
    with pytest.raises(BadInput, match=r"crankshaft.main_journal.of_cylinder"):
        dataclasses.replace(made, crankshaft=shaft)
    single = load("mayekawa-wbhe").compressor
    wall = EachSlide((CoulombSlide(0.1), CoulombSlide(0.2)))
    friction = dataclasses.replace(single.friction, wall=wall)
    with pytest.raises(
        BadInput, match=r"friction.wall.of_cylinder.*one law for each of 1 cylinders"
    ):
        dataclasses.replace(single, friction=friction)
    with pytest.raises(SceneError, match=r"of_cylinder.*one law for each of 2 cylinders"):
        loads(scene_text().replace("of_cylinder = [1, 2]", "of_cylinder = [1, 2, 1]"))
    changed = with_values(scene, {"friction.wall.laws.1.coefficient": 0.07})
    assert float(changed.compressor.friction.wall.law_of_cylinder(2).coefficient) == pytest.approx(
        0.07
    )
    angle = CrankAngleTable([0.0, 1.0, 2.0], [1e5, 1e5, 1e5], 1e5)
    np.testing.assert_array_equal(
        EachGas((angle, angle)).event_angles(), [angle.event_angles()] * 2
    )
