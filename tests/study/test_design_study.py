"""Design rules of the slider-link, studies over a range, slider-link against connecting rod."""

from functools import reduce

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from figures import ROD
from jax.flatten_util import ravel_pytree

from jaxcomp import BadInput, Status, load_result
from jaxcomp.crank import Collocation
from jaxcomp.crankshaft import counterweights
from jaxcomp.mechanism import CrankState
from jaxcomp.scene import load, with_values
from jaxcomp.scene.contents import describe_variables
from jaxcomp.study import (
    compare_drives,
    design_rules,
    design_study,
    with_bore,
    with_stroke_bore_ratio,
    with_swept_volume,
)
from jaxcomp.study._compared import rod_driven
from jaxcomp.vibration import shaking_wrench

# Places where a load changes its side in mid-stroke stay unresolved, which changes the efficiency by
# 5e-5, and so does the film by closed formulas; both halve the time to compile. Nothing here looks at
# estimated errors.
SOLVER = Collocation(reversals=0, estimate=False)
JOURNALS = ("crank-pin", "upper_bearing", "lower_bearing")


@pytest.fixture(scope="module")
def machine():
    changes = {f"bearings.{name}.film": "fit" for name in JOURNALS}
    return with_values(load("slider-link-8cc"), changes).compressor


@pytest.fixture(scope="module")
def study(machine):
    """Five values of every variable, the middle one as it is; one program for all."""
    spans = {
        "stroke_bore_ratio": 2 * 9.6 / 23 * np.linspace(0.6, 1.4, 5),
        "offset": np.linspace(-6e-3, 6e-3, 5),
        "piston_clearance": np.linspace(4e-6, 8e-6, 5),
    }
    return {
        name: (values, design_study(machine, name, values, SOLVER))
        for name, values in spans.items()
    }


@pytest.fixture(scope="module")
def drives(machine):
    return compare_drives(machine, ROD, SOLVER)


def test_bore_rule_of_the_slider_link(machine):
    new, old = with_bore(machine, 0.026).mechanism, machine.mechanism
    np.testing.assert_allclose(new.swept_volume, old.swept_volume, rtol=1e-14)
    np.testing.assert_allclose(new.piston_mass / old.piston_mass, (26 / 23) ** 2, rtol=1e-14)
    # engaged length at the bottom in proportion to the bore, room for the link unchanged
    engaged = [m.cylinder_length - 2 * m.crank_radius for m in (new, old)]
    np.testing.assert_allclose(engaged[0] / engaged[1], 26 / 23, rtol=1e-14)
    beyond = [m.crown_to_link - m.cylinder_length for m in (new, old)]
    np.testing.assert_allclose(*beyond, rtol=1e-14)
    # the machine is half balanced, and stays so, with a typed counterweight as well
    typed = counterweights(old, machine.crankshaft)
    typed = eqx.tree_at(lambda m: m.crankshaft, machine, typed, is_leaf=lambda x: x is None)
    for one in (machine, typed):
        (unbalance,) = with_bore(one, 0.026).crankshaft.unbalances(new)
        np.testing.assert_allclose(unbalance, -new.half_balance, rtol=1e-13)
    assert eqx.tree_equal(with_bore(machine, 0.023), machine, rtol=1e-14)
    back = with_bore(with_bore(machine, 0.026), 0.023)
    assert eqx.tree_equal(back, machine, rtol=1e-14, atol=1e-18)


def test_rules_return_what_they_were_given(machine):
    crank = load("mayekawa-wbhe").compressor
    for name, value in (("stroke_bore_ratio", 0.7), ("offset", 2e-3),
                        ("piston_clearance", 8e-6), ("similar_swept_volume", 1e-5)):  # fmt: skip
        rule = design_rules[name]
        np.testing.assert_allclose(rule.current(rule.apply(machine, value)), value, rtol=1e-14)
    new = with_stroke_bore_ratio(crank, 0.7).mechanism
    np.testing.assert_allclose(2 * new.crank_radius / new.bore, 0.7, rtol=1e-14)
    np.testing.assert_allclose(new.swept_volume, crank.mechanism.swept_volume, rtol=1e-14)
    assert float(design_rules["offset"].apply(crank, 1e-3).mechanism.offset) == 1e-3
    with pytest.raises(BadInput, match="with a film between piston and cylinder"):
        design_rules["piston_clearance"].apply(crank, 1e-5)
    for name in ("stroke_bore_ratio", "piston_clearance"):
        with pytest.raises(BadInput, match="must be > 0"):
            design_rules[name].apply(machine, -1.0)


@pytest.mark.slow  # every design by itself; sweeps are compared with single designs as well
def test_study_equals_single_designs(machine, study, drives):
    """The middle of every range is the machine as it is."""
    single = drives.slider_link
    for values, figures in study.values():
        assert values.size == 5
        assert np.all(figures.status._value == Status.converged._value)
        # a batch passes until its slowest member settles, to 1e-13
        np.testing.assert_allclose(
            figures.mechanical_efficiency[2], single.mechanical_efficiency, rtol=1e-10
        )
        total = sum(figures.loss_power.values())
        np.testing.assert_allclose(
            figures.motor_power, figures.gas_power + total, rtol=1e-10
        )  # collocation closes to rounding


def test_what_the_studies_say(study):
    """A short stroke and a wide clearance rub less; the best offset is near -4 mm."""
    for name, sign in (("stroke_bore_ratio", -1), ("piston_clearance", 1)):
        assert np.all(sign * np.diff(study[name][1].mechanical_efficiency) > 0)
    # with the drag in proportion to 1/c, apart from the speed, which hardly changes
    values, figures = study["piston_clearance"]
    product = values * figures.loss_power["piston_film"]
    np.testing.assert_allclose(product, product[2], rtol=5e-3)
    values, figures = study["offset"]
    assert np.argmax(figures.mechanical_efficiency) == 1
    wall = figures.loss_power["wall"]
    assert np.argmin(wall) == 1
    # the lever arm of the compression shrinks: 4.6 to about 4.2 W
    assert wall[2] - wall[1] == pytest.approx(0.43, abs=0.03)


def test_a_design_out_of_bounds_spoils_no_other(machine, study):
    values = np.array([0.5, 0.8, 3.0, 0.8, 60.0])  # at 60 the stroke is a metre long
    figures = design_study(machine, "stroke_bore_ratio", values, SOLVER)
    assert np.all(np.isfinite(figures.mechanical_efficiency))
    good = np.array([0, 1, 3])
    assert np.all(figures.status._value[good] == Status.converged._value)
    np.testing.assert_allclose(figures.motor_power[1], figures.motor_power[3], rtol=1e-14)
    assert figures.status._value[4] != Status.converged._value


def test_rod_drive_has_the_same_duty(machine):
    rod = rod_driven(machine, ROD)
    assert eqx.tree_equal((rod.gas, rod.motor), (machine.gas, machine.motor))
    np.testing.assert_allclose(rod.mechanism.swept_volume, machine.mechanism.swept_volume)
    assert (
        rod.friction.piston_film.radial_clearance == machine.friction.piston_film.radial_clearance
    )
    with pytest.raises(BadInput, match="a slider_link with friction"):
        rod_driven(rod, ROD)


def test_crankshaft_of_the_rod_drive_is_that_of_the_slider_link(machine):
    """The same bearings at the same places, hence the same moments; the balance is the rod's own."""
    rod = rod_driven(machine, ROD)
    for name in ("inertia", "mass", "main_journal", "mass_centre", "origin"):
        pair = (getattr(one.crankshaft, name) for one in (rod, machine))
        assert eqx.tree_equal(*pair), name
    angle = jnp.linspace(0, 2 * jnp.pi, 64, endpoint=False)
    state = CrankState(angle, jnp.full(64, 300.0), jnp.zeros(64))
    force = np.fft.rfft(np.asarray(shaking_wrench(rod, state).force[:2]), axis=-1)[:, 1]
    # what is left of the first order turns backward: as large along y, and a quarter ahead there
    np.testing.assert_allclose(force[1], 1j * force[0], rtol=1e-12)


def test_what_a_connecting_rod_would_gain(drives):
    """About 4.9 W of 75.9 W: the piston no longer tilts, and a pin turns less than a slider slides."""
    link, rod = drives.slider_link, drives.connecting_rod
    assert link.status == Status.converged
    assert rod.status == Status.converged
    for figures in (link, rod):
        total = sum(figures.loss_power.values())
        np.testing.assert_allclose(figures.motor_power - figures.gas_power, total, rtol=1e-10)
    saving = drives.saving
    # at the gas power of the slider-link
    expected = link.gas_power * (1 / link.mechanical_efficiency - 1 / rod.mechanical_efficiency)
    np.testing.assert_allclose(drives.total_saving, expected, rtol=1e-9)
    assert drives.total_saving == pytest.approx(4.87, abs=0.02)
    assert saving["wall"] == pytest.approx(3.52, abs=0.02)
    assert saving["link_slider"] == pytest.approx(1.44, abs=0.02)
    for name in ("crank_pin", "upper_bearing", "lower_bearing", "thrust_bearing", "pump"):
        assert abs(saving[name]) < 0.03


def test_both_drives_are_a_result_with_a_row_for_each_pair(drives, tmp_path):
    assert drives.columns()["pair"].tolist() == list(drives.saving)
    np.testing.assert_array_equal(drives.columns()["saving [W]"], [*drives.saving.values()])
    assert drives.to_dict()["slider_link.motor_power [W]"] == drives.slider_link.motor_power
    assert "Total saving" in repr(drives)
    drives.save(tmp_path / "drives.npz")
    assert load_result(tmp_path / "drives.npz").saving == drives.saving


def test_half_the_friction_at_the_wall_would_meet_the_measured_saving(machine):
    """At most 4 W at the terminals, some 3 W at the shaft; the coefficient at the wall is assumed."""
    half = eqx.tree_at(lambda m: m.friction.wall.coefficient, machine, jnp.asarray(0.04))
    found = compare_drives(half, ROD, SOLVER)
    assert found.total_saving == pytest.approx(3.07, abs=0.02)
    assert found.saving["wall"] == pytest.approx(1.73, abs=0.02)


def test_a_similar_machine_follows_its_swept_volume():
    design = load("semi-hermetic-200cc").machine
    whole = design.compressor
    twice = with_swept_volume(design, 8 * whole.mechanism.swept_volume).compressor
    for path, power in {
        "mechanism.bore": 1, "mechanism.conrod_mass": 3, "crankshaft.inertia": 5,
        "gas.suction_valve.mass": 3, "gas.suction_valve.stiffness": 1, "gas.discharge_valve.damping": 2,
        "gas.suction.warming.discharge_conductance": 2, "motor.losses.fixed_power": 3,
        "gas.clearance_ratio": 0, "motor.mean_speed": 0, "gas.leakage.gap": 0, "gas.leakage.length": 1,
        "crankshaft.main_journal.radial_clearance": 1, "gas.suction.temperature": 0,
    }.items():  # fmt: skip
        before, after = (reduce(getattr, path.split("."), one) for one in (whole, twice))
        np.testing.assert_allclose(after, 2.0**power * before, rtol=1e-14, err_msg=path)
    with pytest.raises(BadInput, match="with a rotor"):
        with_swept_volume(load("hermetic-68cc").machine, 1e-5)


def test_a_similar_machine_with_stages_has_one_factor_of_length():
    scene = load("two-stage-crosshead")
    first, second = scene.machine.compressor.mechanism.swept_volume
    assert float(design_rules["similar_swept_volume"].current(scene.machine)) == float(first)
    twice = with_swept_volume(scene.machine, 2 * first).compressor
    # of both cylinders alike; rounding of a cube root
    np.testing.assert_allclose(twice.mechanism.swept_volume, [2 * first, 2 * second], rtol=1e-14)
    shown = describe_variables(scene)["similar_swept_volume"]
    assert shown.value == float(first)


def test_derivatives_of_the_rules_equal_differences(machine):
    names = (
        "bore_at_displacement",
        "stroke_bore_ratio",
        "offset",
        "piston_clearance",
        "similar_swept_volume",
    )
    for name in names:
        rule = design_rules[name]

        def numbers(value, rule=rule):
            return ravel_pytree(rule.apply(machine, value))[0]

        value = rule.current(machine)
        step = 1e-5 * jnp.maximum(value, 1e-3)
        slope = jax.jit(jax.jacfwd(numbers))(value) * step
        finite = (numbers(value + step) - numbers(value - step)) / 2
        # h^2 = 1e-10 of numbers up to 1, rounding of as much as 1e-16 of them
        np.testing.assert_allclose(slope, finite, rtol=1e-8, atol=1e-10, err_msg=name)
        assert np.any(slope != 0)
