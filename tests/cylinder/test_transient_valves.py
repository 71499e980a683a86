"""Crank and gas of cylinders with valves in time, against a program of SciPy and the periodic cycle."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import SPEED, golden, mechanism
from reference_valves import Reference

from jaxcomp import (
    BadInput,
    Compressor,
    JournalBearing,
    SliderCrank,
    SliderCrankFriction,
    Status,
    load,
    simulate,
    solve_orbit,
)
from jaxcomp.crank import TimeIntegration
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import CycleOptions, Plenum, solve_cycle
from jaxcomp.motor import ConstantTorque, SlipLine
from jaxcomp.plot._transient import transient_figure, transient_gas_figure
from jaxcomp.valve import OilFilm

OPTIONS = TimeIntegration(tolerance=1e-9, samples=101, max_steps=2**14)


def light_rod():
    """The golden mechanism with a rod that has no mass to speak of."""
    return SliderCrank(
        bore=22e-3,
        crank_radius=9.5e-3,
        conrod_length=44e-3,
        piston_mass=0.05,
        conrod_mass=1e-12,
    )


def light_machine(gas):
    """The machine of the program of SciPy, with a motor of 0.05 N m s about 300 rad/s."""
    return Compressor(light_rod(), Crankshaft(8e-4), SlipLine(0.05, 300.0), gas)


def state_at_end(found):
    """Angle, speed, mass and temperature of the gas, lifts, delivered mass and enthalpy."""
    gas = jax.tree.map(lambda leaf: leaf[0], found.gas)
    at_end = found.state.angle[-1], found.state.speed[-1], gas.mass[-1], gas.temperature[-1]
    return np.array([*at_end, *gas.lift[:, -1], gas.totals.discharge, gas.totals.discharge_heat])


def test_a_start_from_rest_is_that_of_scipy():
    """Air, from rest at suction pressure through four revolutions with flutter of the valves."""
    found = simulate(light_machine(golden("D")), 0.12, angle=0.7, options=OPTIONS)
    assert bool(found.status == Status.converged)
    wanted = Reference(motor=lambda w: 0.05 * (300.0 - w)).run(0.12, 0.7, 0.0, 300.0)
    assert wanted[0] > 4 * 2 * np.pi
    got = state_at_end(found)
    reference = np.array([*wanted[:4], wanted[4], wanted[7], *wanted[-2:]])
    # enthalpies count from another zero
    reference[-1] -= 287.0 / 0.4 * 273.15 * reference[-2]
    # kinks within steps of 1e-10, twenty contacts in each revolution
    np.testing.assert_allclose(got, reference, rtol=2e-6, atol=1e-9)


def with_plenums(suction=(), discharge=(), name="D"):
    """The golden machine with plenums of (volume, temperature, length, area, loss) of the reference."""
    gas = golden(name)
    for which, rows in (("suction", suction), ("discharge", discharge)):
        made = tuple(
            Plenum(
                volume=volume,
                neck_length=length,
                neck_diameter=np.sqrt(4 / np.pi * area),
                loss_coefficient=loss,
                temperature=given,
            )
            for volume, given, length, area, loss in rows
        )
        gas = eqx.tree_at(lambda g, which=which: getattr(g, which).plenums, gas, made)
    return gas


# two chambers of a muffler, one of them at a given temperature, and an adiabatic discharge plenum
MUFFLER = ((20e-6, None, 0.02, 3e-5, 1.5), (8e-6, 310.0, 0.015, 4e-5, 1.0))
BEHIND = ((10e-6, None, 0.03, 1.2e-5, 1.5),)


OIL = OilFilm(viscosity=0.01, seat_width=1e-3, thickness=3e-5)


def oiled(gas, film=OIL):
    """The gas side with oil on the seats of both valves."""
    for which in ("suction_valve", "discharge_valve"):
        gas = eqx.tree_at(
            lambda g, which=which: getattr(g, which).stiction,
            gas,
            film,
            is_leaf=lambda x: x is None,
        )
    return gas


def test_plenums_pump_up_from_rest_and_oil_holds_the_plates_as_in_scipy():
    """Both in one program: they meet in no equation but that of the pressure between them."""
    machine = light_machine(oiled(with_plenums(MUFFLER, BEHIND)))
    found = simulate(machine, 0.08, angle=0.7, options=OPTIONS)
    films = [(np.pi * d * 0.01 * 1e-9, 3e-5) for d in (7e-3, 5e-3)]
    reference = Reference(MUFFLER, BEHIND, motor=lambda w: 0.05 * (300.0 - w), stiction=films)
    wanted = reference.run(0.08, 0.7, 0.0, 300.0)
    got = state_at_end(found)
    known = np.array([*wanted[:4], wanted[4], wanted[7], *wanted[-2:]])
    known[-1] -= 287.0 / 0.4 * 273.15 * known[-2]
    # kinks within steps of 1e-10, those of the flow in the necks as well
    np.testing.assert_allclose(got, known, rtol=2e-6, atol=1e-9)
    flow_m_T = wanted[10:19].reshape(3, 3)
    T = [flow_m_T[0, 2], 310.0, flow_m_T[2, 2]]
    volume = [20e-6, 8e-6, 10e-6]
    pressure = 287.0 * flow_m_T[:, 1] * T / volume
    np.testing.assert_allclose(found.gas.plenum_pressure[:, -1], pressure, rtol=2e-6)


@pytest.mark.slow  # two structures of their own
def test_oil_on_the_seats_costs_overpressure_and_softens_the_impact():
    options = CycleOptions(nodes=10, panels=48)
    wet = solve_cycle(oiled(golden("D")), light_rod(), SPEED, options)
    dry = solve_cycle(golden("D"), light_rod(), SPEED, options)
    assert wet.peak_pressure > dry.peak_pressure + 1e4
    assert wet.impact_speeds["discharge_seat"] < 0.5 * dry.impact_speeds["discharge_seat"]
    assert abs(wet.energy_closure) < 1e-6


def test_running_on_at_constant_speed_becomes_the_periodic_cycle():
    """A flywheel as heavy as a house: after nine revolutions the gas is that of the golden cycle."""
    heavy = Compressor(light_rod(), Crankshaft(1e6), ConstantTorque(0.0), golden("D"))
    # a motor without torque has no speed of its own to scale by
    heavy = eqx.tree_at(lambda c: c.motor, heavy, SlipLine(1e-9, SPEED))
    turns = 9
    found = simulate(
        heavy, turns * 2 * np.pi / SPEED, angle=-np.pi / 2, speed=SPEED, options=OPTIONS
    )
    # the error shrinks to a tenth with every revolution; ten digits are known
    np.testing.assert_allclose(found.gas.mass[0, -1], 7.8762969e-6, rtol=1e-7)
    np.testing.assert_allclose(found.gas.temperature[0, -1], 397.909279, rtol=1e-7)


def test_each_of_two_cylinders_has_a_cycle_of_its_own():
    """Cranks at 0 and 180 degrees on a flywheel: the same cycle, half a revolution apart."""
    twin = Compressor(
        light_rod(),
        Crankshaft(1e6, layout="in-line-2", throw_pitch=0.1),
        SlipLine(1e-9, SPEED),
        golden("D"),
    )
    found = simulate(twin, 9.5 * 2 * np.pi / SPEED, angle=-np.pi / 2, speed=SPEED,
                     options=TimeIntegration(tolerance=1e-9, samples=20, max_steps=2**15))  # fmt: skip
    np.testing.assert_allclose(found.gas.mass[1, -1], 7.8762969e-6, rtol=1e-7)
    np.testing.assert_allclose(found.gas.temperature[1, -1], 397.909279, rtol=1e-7)
    # within a step, by the cubic between its ends
    np.testing.assert_allclose(found.gas.mass[0, -2], 7.8762969e-6, rtol=1e-5)
    delivered = np.asarray(found.gas.totals.discharge)
    # 10 and 9 discharges since the start, the first of which carries another amount
    assert 1.0 < delivered[0] / delivered[1] < 1.2


def test_mass_and_energy_are_accounted_for_and_power_off_is_felt():
    motor = SlipLine(0.05, 300.0)
    machine = Compressor(mechanism(), Crankshaft(1e-4), motor, golden("D"))
    found = simulate(machine, 5.0, speed=250.0, power_off=0.05, options=OPTIONS)
    assert bool(found.stopped)
    assert abs(float(found.residual[-1])) < 1e-8
    gas = jax.tree.map(lambda leaf: leaf[0], found.gas)
    t, mass = gas.totals, gas.mass
    np.testing.assert_allclose(t.suction - t.discharge - t.leakage, mass[-1] - mass[0], atol=1e-17)
    after = np.asarray(found.time) > 0.05 + 1e-9
    assert np.ptp(np.asarray(found.energy.motor_work)[after]) < 1e-6 * found.energy.motor_work[-1]
    # the gas's work on the crank is the piston's: p dV less what stands behind it
    volume = mass / (gas.pressure / (287.0 * gas.temperature))
    behind = 1e5 * float(volume[-1] - volume[0])
    np.testing.assert_allclose(found.energy.gas_work[-1], behind - t.work, rtol=1e-7)


def test_what_is_not_there_is_refused():
    with pytest.raises(BadInput, match="torque law over speed"):
        simulate(load("r134a-7cc"), 0.1)

    machine = light_machine(golden("D"))
    with pytest.raises(NotImplementedError, match="derivatives"):
        # with respect to a number of the machine
        jax.grad(
            lambda gap: simulate(
                eqx.tree_at(lambda c: c.gas.leakage.gap, machine, gap),
                0.001,
                options=OPTIONS,
                throw=False,
            ).state.speed[-1]
        )(jnp.asarray(5e-6))


def test_pictures_show_the_pressure_and_the_end():
    found = simulate(light_machine(golden("D")), 0.12, angle=0.7, options=OPTIONS)
    motion = transient_figure(found, "air", 0.1)
    course = motion.axes[1].lines[0].get_ydata()
    np.testing.assert_allclose(course, np.asarray(found.gas.pressure[0]) / 1e6)
    close = transient_gas_figure(found, "air", 0.1)
    assert len(close.axes[0].lines) == 2  # the pressure, and the instant of power-off
    lift = close.axes[1].lines[0].get_ydata()
    assert (
        1.2 < lift.max() <= 1.5
    )  # mm: the suction valve's stop, between the instants that are listed
    assert lift.size < 101


@pytest.mark.slow  # two programs with valves and a moving journal to compile
def test_a_journal_that_moves_beside_valves_ends_in_its_periodic_orbit():
    """A flywheel, so that heat transfer sees one speed; the pin as the collocation has it."""
    pin = JournalBearing(
        film="short", motion="orbit", diameter=12e-3, length=10e-3, radial_clearance=10e-6,
        dynamic_viscosity=0.01,
    )  # fmt: skip
    machine = Compressor(
        light_rod(), Crankshaft(0.02), SlipLine(2.0, 310.0), golden("D"),
        friction=SliderCrankFriction(crank_pin=pin),
    )  # fmt: skip
    orbit = solve_orbit(machine)
    options = TimeIntegration(tolerance=1e-7, max_steps=40_000)
    found = simulate(
        machine, 12 * 2 * np.pi / orbit.mean_speed, speed=orbit.mean_speed, options=options
    )
    angle = np.asarray(found.state.angle)
    last = angle > angle[-1] - 2 * np.pi
    nodes = np.asarray(orbit.state.angle)
    at = nodes[0] + np.mod(angle[last] - nodes[0], 2 * np.pi)
    for x, wanted in zip(found.positions["crank_pin"], orbit.positions["crank_pin"], strict=True):
        around = np.interp(at, np.append(nodes, nodes[0] + 2 * np.pi), np.append(wanted, wanted[0]))
        # straight lines between the nodes leave 2e-4
        np.testing.assert_allclose(np.asarray(x)[last], around, atol=1e-3)
