"""Several cylinders on one crank: golden values of two independent programs, limits and balances.

The golden values are own ones: Newton-Euler laws in time steps and Gauss panels of the laws of one
cylinder agreed to 1.1e-10 in efficiency, 2e-11 in fluctuation and 2e-9 of a loss.
"""

import dataclasses
import itertools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import (
    BadInput,
    Collocation,
    Compressor,
    SceneError,
    Shooting,
    SolveFailed,
    load,
    loads,
    problem,
    sensitivity,
    solve_orbit,
    sweep,
)
from jaxcomp.compressor import instants
from jaxcomp.crank import (
    CrankTrain,
    TimeIntegration,
    TorsionalChain,
    rod_load_reversal,
    simulate,
    train_over_speed,
    train_torques,
)
from jaxcomp.crank._collocation import _of_count
from jaxcomp.crank._films import film_thickness
from jaxcomp.crank._orbit import time_harmonics
from jaxcomp.crank._torsion import throw_inertias, throw_torques
from jaxcomp.crankshaft import Crankshaft, MainBearings, Throw, counterweights
from jaxcomp.film import JournalBearing
from jaxcomp.friction import (
    CoulombJournal,
    CoulombSlide,
    Packing,
    SliderCrankFriction,
)
from jaxcomp.gas import DoubleActing, PolytropicCycle, StagedCycle
from jaxcomp.machine import Machine
from jaxcomp.mechanism import CrankState, SliderCrank, Vector
from jaxcomp.motor import MeanSpeed, SlipLine
from jaxcomp.plot import order_spectra
from jaxcomp.plot._animate import cylinders_motion
from jaxcomp.rotor import (
    Disks,
    Link,
    Mount,
    PeriodicForce,
    RotorModel,
    ShaftElements,
    node_index,
    respond,
)
from jaxcomp.scene import with_values
from jaxcomp.study import AnalysisOptions, DesignResult
from jaxcomp.study.sweep._run import sweep_machines
from jaxcomp.vibration import crank_forces, shaking_wrench

# rods on throws at 0 and 180 degrees: [deg] of the throw, [m], banks [deg], unbalance [kg m]
FOUR, EIGHT = [-45.0, 45.0], [-67.5, -22.5, 22.5, 67.5]
LAYOUTS = {
    1: [(0.0, 0.0, [0.0], -0.336325)],
    2: [(0.0, 0.0, FOUR, -0.511052925)],
    4: [(0.0, -0.1, FOUR, -0.511052925), (180.0, 0.1, FOUR, -0.511052925)],
    8: [(0.0, -0.1, EIGHT, -1.022105849), (180.0, 0.1, EIGHT, -1.022105849)],
}
# efficiency, fluctuation, motor work, crank pins, main journals, piston pins, walls [J]
GOLDEN = {
    1: (
        0.9115386285,
        0.1051610786,
        326.1805127593,
        13.4814219933,
        10.9025278575,
        0.5439607556,
        3.9264649143,
    ),
    2: (
        0.9200285118,
        0.1566118591,
        646.3411370865,
        26.923037439,
        15.8731649975,
        1.0855875356,
        7.8070726371,
    ),
    4: (
        0.921325437,
        0.032647748,
        1290.8625998513,
        53.727939151,
        29.9339471022,
        2.1587270457,
        15.7374375977,
    ),
    8: (
        0.9237295419,
        0.004326424,
        2575.0059839743,
        107.4163441138,
        52.9026345165,
        4.3185536056,
        31.7593538292,
    ),
}


JOURNAL = CoulombJournal(0.013, 0.092)
TWO = MainBearings((JOURNAL, JOURNAL), jnp.array([-0.25, 0.25]))


def layout(throws, main_journal=TWO, **given):
    rows = tuple(
        Throw(np.deg2rad(banks), np.deg2rad(angle), place, 0.04, unbalance)
        for angle, place, banks, unbalance in throws
    )
    return Crankshaft(0.1566, throws=rows, main_journal=main_journal, **given)


def several(throws, **changes) -> Compressor:
    mechanism = SliderCrank(
        bore=0.130,
        crank_radius=49.98783656e-3,
        conrod_length=294.0460974e-3,
        piston_mass=2.65,
        conrod_mass=3.787313735,
        conrod_centre=0.08399916850e-3,
        conrod_inertia=0.005380,
    )
    friction = SliderCrankFriction(
        wall=CoulombSlide(0.083),
        piston_pin=CoulombJournal(0.013, 0.040),
        crank_pin=CoulombJournal(0.013, 0.090),
    )
    gas = PolytropicCycle(98e3, 980e3, 1.05, 0.0076, 98e3)
    motor = MeanSpeed(1000 * np.pi / 30, "proportional")
    one = Compressor(mechanism, layout(throws), motor, gas, friction)
    return dataclasses.replace(one, **changes)


def losses(orbit, joint):
    return sum(float(v) for name, v in orbit.energy.losses.items() if name.startswith(joint))


def located(made: Compressor) -> Collocation:
    """With panel edges at all load reversals."""
    return Collocation(reversals=made.load_reversals)


@pytest.fixture(scope="module")
def twin():
    return solve_orbit(several(LAYOUTS[2]), located(several(LAYOUTS[2])))


def check_golden(orbit, count):
    efficiency, fluctuation, work, *by_joint = GOLDEN[count]
    # the orbit's own estimate says 6e-8 to 4e-7, most of which is the sixth digit of a loss
    assert orbit.mechanical_efficiency == pytest.approx(efficiency, abs=1e-8)
    # a load reversal that ran out of places costs up to 4e-8
    assert orbit.speed_fluctuation == pytest.approx(fluctuation, abs=1e-7)
    assert orbit.energy.motor_work == pytest.approx(work, rel=1e-8)
    for joint, loss in zip(("crank_pin", "main", "piston_pin", "wall"), by_joint, strict=True):
        assert losses(orbit, joint) == pytest.approx(loss, rel=1e-6), joint


def test_twin_has_the_golden_values(twin):
    check_golden(twin, 2)
    assert abs(twin.energy.residual) < 1e-13  # rounding of sums of a thousand terms


def test_shaking_forces_and_couples_of_the_twin_by_order(twin):
    """Golden values of an independent program: forward plus backward amplitudes in N and N m."""
    result = DesignResult(Machine(several(LAYOUTS[2])), AnalysisOptions())
    result.orbit = twin
    force, couple = result.shaking_force, result.shaking_couple
    # the golden figures have four digits behind the point, or three
    np.testing.assert_allclose(force["1"], 3.058 + 3.059, atol=2e-3)
    np.testing.assert_allclose(force["2"], 2 * 175.476, atol=2e-3)
    np.testing.assert_allclose(force["3"], 26.229 + 26.227, atol=2e-3)
    np.testing.assert_allclose(couple["1"], 0.0762 + 29.0771, atol=2e-4)
    np.testing.assert_allclose(couple["2"], 3.6818 + 2.8363, atol=2e-4)


def test_torque_fluctuation_is_that_of_the_torques_at_the_nodes(twin):
    """The highest torque stands where a valve opens: at an edge, 1.3 % above the node beside it."""
    load = np.asarray(twin.loads.total_loss_torque - twin.gas_torque)
    weight = np.asarray(twin.weight)
    nodes = (load.max() - load.min()) / (np.sum(weight * load) / (2 * np.pi))
    fluctuation = eqx.filter_jit(lambda orbit: orbit.torque_fluctuation)(twin)
    assert nodes <= fluctuation < 1.02 * nodes
    # at constant mean speed the mean load is the motor's torque
    mean = np.sum(weight * np.asarray(twin.motor_torque))
    np.testing.assert_allclose(np.sum(weight * load), mean, rtol=1e-12)


@pytest.mark.slow  # half a minute of compiling each
@pytest.mark.parametrize("count", [1, 4, 8])
def test_golden_values(count):
    check_golden(solve_orbit(several(LAYOUTS[count]), located(several(LAYOUTS[count]))), count)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "nodes"), [(1, 12), (2, 16), (4, 12), (8, 10)])
def test_golden_values_to_their_digits(count, nodes):
    """With more nodes than by default and more places for load reversals."""
    solver = Collocation(nodes=nodes, reversals=max(6, 4 * count) + 4 * (count == 2))
    orbit = solve_orbit(several(LAYOUTS[count]), solver)
    assert float(orbit.mechanical_efficiency) == pytest.approx(GOLDEN[count][0], abs=1e-9)
    assert float(orbit.speed_fluctuation) == pytest.approx(GOLDEN[count][1], abs=1e-9)


@pytest.mark.slow  # three programs
def test_default_errs_by_a_millionth():
    """Fewer nodes on the narrower panels of more cylinders."""
    for count in (2, 4, 8):
        orbit = solve_orbit(several(LAYOUTS[count]))
        assert orbit.mechanical_efficiency == pytest.approx(GOLDEN[count][0], abs=1e-6)
        assert orbit.speed_fluctuation == pytest.approx(GOLDEN[count][1], abs=1e-6)
        assert abs(orbit.energy.residual) < 1e-12


@pytest.fixture(scope="module")
def over_bank():
    """By default efficiency and fluctuation of the V90 twin, with slopes, over a bank's shift [rad]."""
    made = several(LAYOUTS[2])
    banks = lambda c: c.crankshaft.throws[0].banks  # noqa: E731

    def results(shift):
        moved = eqx.tree_at(banks, made, banks(made) + jnp.stack([0 * shift, shift]))
        orbit = solve_orbit(moved, throw=False)
        return jnp.stack([orbit.mechanical_efficiency, orbit.torque_fluctuation])

    program = jax.jit(lambda shift: jax.jvp(results, (shift,), (jnp.ones(()),)))
    # `float` as the type, or numbers of Python would have a program of their own
    return lambda shift: program(jnp.asarray(shift, float))


def test_default_is_continuous_through_a_symmetric_layout(over_bank):
    """Kinks of both cylinders coincide at 90 degrees between the banks; beside it they are two edges."""
    (here, _), slope = over_bank(0.0)
    for shift in (1e-7, 1e-5, 1e-3):  # the last 0.06 degrees
        (ahead, _), _ = over_bank(shift)
        (behind, _), _ = over_bank(-shift)
        # a slope that takes neither side of coinciding kinks is off by 1e-8 at the last shift
        assert abs(ahead - behind - 2 * shift * slope[0]) < 1e-9, shift
        # the efficiency bends by 5e-3 over the square of the angle
        assert abs(ahead + behind - 2 * here) < 1e-9 + 1e-2 * shift**2, shift


def test_slopes_of_the_default_are_those_of_its_values(over_bank):
    """Without edges at the load reversals that of the efficiency errs by 4 % of itself."""
    step = 2e-3
    (ahead, _), (behind, _) = (over_bank(0.02 + side * step) for side in (1, -1))
    _, slope = over_bank(0.02)
    difference = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-4)


@pytest.mark.slow
def test_shooting_agrees(twin):
    shot = solve_orbit(several(LAYOUTS[2]), Shooting(tolerance=1e-8))
    assert shot.mechanical_efficiency == pytest.approx(float(twin.mechanical_efficiency), abs=2e-8)
    assert shot.speed_fluctuation == pytest.approx(float(twin.speed_fluctuation), abs=1e-7)


COARSE = Collocation(nodes=6, reversals=0)


def test_one_of_several_is_one():
    """At any bank angle, with a single journal: the program of one cylinder to rounding."""
    single = load("mayekawa-wbhe").as_compressor()
    shaft = single.crankshaft
    throw = Throw([0.7], angle=0.2, position=0.3, unbalance=shaft.unbalance)
    turned = dataclasses.replace(shaft, throws=(throw,), unbalance=0.0)
    one = dataclasses.replace(single, crankshaft=turned)
    found, wanted = solve_orbit(one, COARSE), solve_orbit(single, COARSE)
    assert float(found.mechanical_efficiency) == pytest.approx(
        float(wanted.mechanical_efficiency), abs=1e-13
    )
    assert float(found.lowest_speed) == pytest.approx(float(wanted.lowest_speed), rel=1e-12)
    for name, loss in wanted.energy.losses.items():
        other = losses(found, name)
        assert other == pytest.approx(float(loss), rel=1e-11), name


def test_turning_the_machine_turns_nothing_but_the_frame():
    """Unsymmetric banks, so that the sign of the phase shows."""
    base = [(0.0, 0.0, [0.0, 50.0, 120.0], -0.4)]
    solve = lambda throws: solve_orbit(several(throws), COARSE)  # noqa: E731
    one = solve(base)
    both = solve([(50.0, 0.0, [50.0, 100.0, 170.0], -0.4)])
    mirrored = solve([(0.0, 0.0, [0.0, -50.0, -120.0], -0.4)])
    assert float(both.mechanical_efficiency) == pytest.approx(
        float(one.mechanical_efficiency), abs=1e-13
    )
    assert float(both.speed_fluctuation) == pytest.approx(float(one.speed_fluctuation), rel=1e-10)
    # 50 degrees from the first cylinder to the next, or 70
    assert abs(float(mirrored.speed_fluctuation / one.speed_fluctuation) - 1) > 1e-3


def test_forces_on_the_frame_are_the_shaking_force(twin):
    """Walls, heads and bearings together are what the inertia of all moving parts says."""
    compressor = several(LAYOUTS[2])

    @eqx.filter_jit  # as one program: outside of one every operation is compiled by itself
    def forces_of_cylinders(orbit):
        wall = jnp.stack([orbit.loads.forces[f"wall_{k}"] for k in (1, 2)], axis=1)
        gas = instants(compressor, orbit.state.angle).gas_force
        own = Vector(gas - wall[0], -wall[1])
        return shaking_wrench(compressor, orbit.state), compressor.crankshaft.turned(own).stacked()

    wrench, total = forces_of_cylinders(twin)
    total = np.asarray(total)
    forces = {name: np.asarray(force) for name, force in twin.loads.forces.items()}
    frame = total.sum(axis=1) - forces["main_1"] - forces["main_2"]
    np.testing.assert_allclose(frame, wrench.force[:2], atol=1e-8)  # [N] of forces of 10 kN
    z = np.array([-0.02, 0.02])[:, None]
    levered = (z * total).sum(axis=1) - 0.25 * (forces["main_2"] - forces["main_1"])
    np.testing.assert_allclose(-levered[1], wrench.moment[0], atol=1e-9)
    np.testing.assert_allclose(levered[0], wrench.moment[1], atol=1e-9)


# (|f+|, |f-|) of orders 1 and 2 over one cylinder's force; rods of a throw at one place
BALANCES = {
    "V90": ([(0.0, 0.0, FOUR, 0.0)], (1.0, 0.0), (2**-0.5, 2**-0.5)),
    "V60": ([(0.0, 0.0, [-30.0, 30.0], 0.0)], (1.0, 0.5), (3**0.5 / 2, 0.0)),
    "W60": ([(0.0, 0.0, [-60.0, 0.0, 60.0], 0.0)], (1.5, 0.0), (1.0, 0.5)),
    "VV45": ([(0.0, 0.0, EIGHT, 0.0)], (2.0, 0.0), (1.306562964876, 0.541196100146)),
    "radial 3": ([(0.0, 0.0, [0.0, 120.0, 240.0], 0.0)], (1.5, 0.0), (0.0, 1.5)),
    "in-line 2": ([(0.0, 0.0, [0.0], 0.0), (180.0, 0.0, [0.0], 0.0)], (0.0, 0.0), (1.0, 1.0)),
    "boxer": ([(0.0, 0.0, [0.0], 0.0), (180.0, 0.0, [180.0], 0.0)], (0.0, 0.0), (0.0, 0.0)),
}


@pytest.mark.parametrize("name", BALANCES)
def test_orders_of_the_shaking_force_at_constant_speed(name):
    throws, *wanted = BALANCES[name]
    speed, angle = 100.0, 2 * np.pi * np.arange(64) / 64
    made = several(throws)
    # without the rotating mass of the rod: its mass centre in the small end
    rod = dataclasses.replace(made.mechanism, conrod_centre=made.mechanism.conrod_length)
    made = dataclasses.replace(made, mechanism=rod)
    state = CrankState(jnp.asarray(angle), jnp.full(64, speed), jnp.zeros(64))
    force = np.asarray(shaking_wrench(made, state).force)
    spectrum = np.fft.fft(force[0] + 1j * force[1]) / 64
    mechanism = made.mechanism
    moving = mechanism.piston_mass + mechanism.conrod_mass
    unit = float(moving * mechanism.crank_radius) * speed**2
    lever = 0.17  # crank radius over rod length
    assert float(mechanism.conrod_ratio) == pytest.approx(lever, rel=1e-8)
    # F = m r w^2 sum A_n cos n psi: A_1 = 1; A_2 at 0.17 of the exact motion
    for order, amplitude, (ahead, behind) in zip(
        (1, 2), (1.0, 0.171245174885), wanted, strict=True
    ):
        got = abs(spectrum[order]) / unit, abs(spectrum[-order]) / unit
        np.testing.assert_allclose(got, (amplitude * ahead, amplitude * behind), atol=1e-9)


@eqx.filter_jit
def sums_of(shafts):
    """Sums of the first and second order of several crankshafts, by one program."""
    return {name: (shaft.order_sums(1), shaft.order_sums(2)) for name, shaft in shafts.items()}


def test_sums_of_orders_are_those_of_the_closed_forms():
    orders = sums_of({name: layout(throws) for name, (throws, *_) in BALANCES.items()})
    for name, (_, *wanted) in BALANCES.items():
        for sums, (ahead, behind) in zip(orders[name], wanted, strict=True):
            got = abs(complex(sums.forward)), abs(complex(sums.backward))
            np.testing.assert_allclose(got, (ahead, behind), atol=1e-12, err_msg=name)
    # V90 on two throws, the rods of each at one place: couples of order 1 turn forward only
    two = layout([(0.0, -0.5, FOUR, 0.0), (180.0, 0.5, FOUR, 0.0)])
    together = dataclasses.replace(
        two, throws=tuple(dataclasses.replace(t, rod_pitch=0.0) for t in two.throws)
    )
    sums, _ = sums_of({"together": together})["together"]
    couple = abs(complex(sums.forward_couple)), abs(complex(sums.backward_couple))
    np.testing.assert_allclose(couple, (1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(two.firing_intervals), 90.0, atol=1e-9)
    one_throw = layout([(0.0, 0.0, FOUR, 0.0)]).firing_intervals
    np.testing.assert_allclose(np.sort(np.rad2deg(one_throw)), (90.0, 270.0), atol=1e-9)


def test_counterweights_are_those_of_the_golden_machine():
    for count, throws in LAYOUTS.items():
        if count > 1:
            made = several(throws)
            weights = counterweights(made.mechanism, made.crankshaft)
            for throw, (_, _, _, unbalance) in zip(weights.throws, throws, strict=True):
                assert float(throw.unbalance) == pytest.approx(unbalance, rel=2e-9)  # as typed


# Golden: eigenvalues equal Holzer's method to 1e-10.
TRAIN = TorsionalChain([1.20, 0.25, 0.25, 0.05], [6.0e4, 1.5e6, 1.5e6], [200.0, 0.0, 0.0])


def test_torsional_chain_has_the_golden_values():
    wanted = 0.0, 63.090430938, 520.959666927, 973.560790337
    np.testing.assert_allclose(TRAIN.natural_frequencies / (2 * np.pi), wanted, rtol=1e-10)
    two = TorsionalChain([1.20, 0.55], [6.0e4])
    assert two.natural_frequencies[1] / (2 * np.pi) == pytest.approx(63.480861714, rel=1e-10)
    frequency = jnp.array([4 * 1000 * np.pi / 30])
    angle = TRAIN.response(jnp.array([[0.0], [1.0], [1.0], [0.0]]) + 0j, frequency)
    coupling = abs(complex(TRAIN.spring_torque(angle, frequency)[0, 0]))
    assert coupling == pytest.approx(1.70055055790, rel=1e-10)
    with pytest.raises(BadInput, match="3 values, one a spring"):
        TorsionalChain([1.0, 1.0, 1.0, 1.0], [1.0])


def test_a_stiff_crank_train_moves_as_the_rigid_crank(twin):
    """Motor, throw and counterweight on stiff springs: the harmonics of the orbit's own motion."""
    compressor = several(LAYOUTS[2])
    inertia = float(compressor.crankshaft.inertia)
    chain = TorsionalChain(
        [0.6 * inertia, 0.4 * inertia + float(throw_inertias(compressor)[0])], [1e12]
    )

    @eqx.filter_jit  # as one program: outside of one every operation is compiled by itself
    def harmonics(orbit):
        losses = orbit.loads.loss_torque
        bearings = sum(loss for name, loss in losses.items() if name.startswith("main"))
        torques = jnp.stack([orbit.motor_torque - bearings, throw_torques(compressor, orbit)[0]])
        instants_ = orbit.time, orbit.weight / orbit.state.speed
        torque, frequency = time_harmonics(torques, *instants_, 6)
        rise, _ = time_harmonics(orbit.state.acceleration, *instants_, 6)
        return frequency, chain.response(torque, frequency), rise

    frequency, angle, rise = map(np.asarray, harmonics(twin))
    # the springs give by 1e-7 of the motion; quadrature of the harmonics with panels at all kinks
    np.testing.assert_allclose(-(frequency**2) * angle[1], rise, atol=1e-6 * float(abs(rise[0])))


def test_derivatives_to_bank_and_throw_angle():
    # no two dead centres at one angle, where panels vanish and the discrete solution has a corner
    uneven = [(0.0, -0.1, [-45.0, 43.0], -0.5), (170.0, 0.1, [-40.0, 48.0], -0.5)]
    base = several(uneven, motor=MeanSpeed(100.0))
    place = lambda c: (c.crankshaft.throws[0].banks, c.crankshaft.throws[1].angle)  # noqa: E731
    ways = jnp.array([0.3, -1.0]), jnp.array(0.7)

    def efficiency(step):
        moved = tuple(x + step * way for x, way in zip(place(base), ways, strict=True))
        return solve_orbit(eqx.tree_at(place, base, moved), COARSE).mechanical_efficiency

    # value and slope of one program
    along = jax.jit(lambda step: jax.jvp(efficiency, (step,), (jnp.ones(()),)))
    step = 3e-5
    (ahead, _), (_, slope), (back, _) = (along(sign * jnp.array(step)) for sign in (1, 0, -1))
    # of central differences: their truncation; 5.5e-8 seen, 4e-7 at three times the step
    assert float(slope) == pytest.approx(float(ahead - back) / (2 * step), rel=1e-6)


@pytest.mark.slow
def test_torque_curve_and_gravity_close_the_energy():
    made = several(LAYOUTS[2], motor=SlipLine(60.0, 106.0), gravity=jnp.array([0.0, -9.81]))
    orbit = solve_orbit(made, COARSE)
    assert abs(orbit.energy.residual) < 1e-12
    # weights do no work over a revolution: gas work is that of two cylinders, 297.326137139 J each
    assert float(orbit.energy.gas_work) == pytest.approx(2 * 297.326137139, rel=1e-4)


@pytest.mark.parametrize("count", [4, 6, 8])
def test_bundled_machines_balance_their_first_order(count):
    machine = load(f"mayekawa-{count}wbhe").as_compressor()
    assert machine.crankshaft.count == count
    angle = 2 * np.pi * np.arange(64) / 64
    state = CrankState(jnp.asarray(angle), jnp.full(64, 100.0), jnp.zeros(64))
    force = np.asarray(shaking_wrench(machine, state).force)
    first = np.fft.fft(force[0] + 1j * force[1])[[1, -1]] / 64
    one = dataclasses.replace(machine, crankshaft=layout([(0.0, 0.0, [0.0], 0.0)]))
    single = np.asarray(shaking_wrench(one, state).force)
    # the counterweights are typed to nine digits
    assert np.abs(first).max() < 1e-8 * np.abs(single).max()


@pytest.mark.slow  # marches; the march of one cylinder is in the ordinary run
def test_a_run_in_time_closes_its_energy():
    made = several(LAYOUTS[2], motor=SlipLine(60.0, 106.0))
    found = simulate(made, 0.05, speed=100.0, options=TimeIntegration(samples=3))
    work, kinetic = found.energy, found.kinetic_energy
    left = work.motor_work - work.gas_work - work.total_loss - (kinetic[-1] - kinetic[0])
    # 2e-8 seen, of steps at 1e-8 across the kinks
    assert abs(float(left[-1])) < 1e-6 * float(work.motor_work[-1])


@pytest.mark.slow
def test_films_of_every_cylinder_are_told():
    """Films of two pins and two main bearings, of one law each."""
    film = JournalBearing(0.09, 0.05, 4.5e-5, 0.01, film="short")
    made = several(LAYOUTS[2])
    made = dataclasses.replace(
        made,
        friction=dataclasses.replace(made.friction, crank_pin=film),
        crankshaft=layout(LAYOUTS[2], MainBearings((film, film), jnp.array([-0.25, 0.25]))),
    )
    orbit = solve_orbit(made, COARSE)
    thickness = film_thickness(made, orbit)
    assert set(thickness) == {"crank_pin_1", "crank_pin_2", "main_1", "main_2"}
    assert abs(orbit.energy.residual) < 1e-12
    for name, values in thickness.items():
        assert np.all((np.asarray(values) > 0) & (np.asarray(values) < 4.5e-5)), name


TWIN_ON_ROTOR = (
    ("[motor]", "[crankshaft]\n[[crankshaft.throws]]\nbanks = ['-20 deg', '50 deg']\n\n[motor]"),
    ("pin = 21\nhead = \"head\"\nwall = \"wall\"", "pin = [19, 21]\nhead = ['head', 'head']\n"
     "wall = ['wall', 'wall']"),
)  # fmt: skip


def on_rotor(*more):
    text = load("hermetic-68cc").text
    for old, new in (*TWIN_ON_ROTOR, *more):
        assert text.count(old) == 1
        text = text.replace(old, new)
    return loads(text)


def test_forces_of_every_cylinder_on_a_rotor_add_up_to_the_inertia_of_all():
    scene = on_rotor()
    compressor = scene.compressor
    # the places of the rods are those of their nodes, the unbalances those of the rotor
    np.testing.assert_allclose(compressor.crankshaft.position, (0.0, 0.010), atol=1e-12)
    orbit = solve_orbit(compressor, COARSE)
    orders = tuple(range(7))
    found = eqx.filter_jit(crank_forces)(compressor, orbit, scene.parts["loads"].crank, orders)
    assert len(found.forces) == 7
    alone = dataclasses.replace(
        compressor,
        crankshaft=dataclasses.replace(
            compressor.crankshaft, inertia=1e-9, shaft_unbalance=None, shaft_couple=None
        ),
    )
    wrench = eqx.filter_jit(shaking_wrench)(alone, orbit.state)
    share = orbit.weight / orbit.state.speed
    phase = orbit.mean_speed * orbit.time - compressor.crankshaft.phase[0]
    waves = np.exp(-1j * np.outer(orders, phase)) * np.where(np.array(orders) == 0, 1, 2)[:, None]
    waves = waves * np.asarray(share / share.sum())
    each = [np.asarray(f.cosine - 1j * f.sine) for f in found.forces[:6]]
    size = float(np.abs(wrench.force).max())
    # linear in the forces at every node of the orbit: rounding only
    np.testing.assert_allclose(
        sum(each)[:, :2], waves @ np.asarray(wrench.force[:2]).T, atol=1e-11 * size
    )
    places = np.repeat(compressor.crankshaft.position, 3)
    tilting = sum(z * force[:, :2] for z, force in zip(places, each, strict=True))
    wanted = np.stack([wrench.moment[1], -wrench.moment[0]])
    np.testing.assert_allclose(tilting, waves @ wanted.T, atol=1e-13 * size)


def test_a_rotor_gives_what_cylinders_must_leave_open():
    two = "banks = ['-20 deg', '50 deg']"
    with pytest.raises(SceneError, match=r"throws.0.rod_pitch.*follows from the rotor"):
        on_rotor((two, two + "\nrod_pitch = '10 mm'"))
    with pytest.raises(SceneError, match=r"pin.*one node for each of 3 cylinders"):
        on_rotor((two, "banks = ['-20 deg', '50 deg', '90 deg']"))


@pytest.mark.slow
def test_several_slider_links():
    """One of them is the single machine; two do twice the work and close the energy."""
    single = load("slider-link-8cc").as_compressor()
    shaft = single.crankshaft
    one = dataclasses.replace(shaft, throws=(Throw([0.0]),))
    with pytest.raises(BadInput, match=r"unbalance.*absent beside throws, which have theirs"):
        dataclasses.replace(one, unbalance=0.1)
    made = dataclasses.replace(single, crankshaft=one)
    orbit, wanted = solve_orbit(made, COARSE), solve_orbit(single, COARSE)
    # the solver converges to 1e-13 of the energy
    assert float(orbit.mechanical_efficiency) == pytest.approx(
        float(wanted.mechanical_efficiency), abs=1e-12
    )
    for name, loss in wanted.energy.losses.items():
        assert losses(orbit, name) == pytest.approx(float(loss), rel=1e-10), name
    force, other = (shaking_wrench(c, wanted.state).force for c in (made, single))
    np.testing.assert_allclose(force, other, atol=1e-10 * float(jnp.abs(other).max()))
    twin = dataclasses.replace(shaft, throws=(Throw([0.0, 1.2], rod_pitch=0.01),))
    two = solve_orbit(dataclasses.replace(made, crankshaft=twin), COARSE)
    assert abs(two.energy.residual) < 1e-12
    assert float(two.energy.gas_work) == pytest.approx(2 * float(orbit.energy.gas_work), rel=1e-4)


@pytest.mark.slow
def test_equal_lists_are_the_single_numbers():
    made = several(LAYOUTS[2])
    listed = dataclasses.replace(
        made,
        mechanism=dataclasses.replace(made.mechanism, bore=[0.13] * 2, piston_mass=[2.65] * 2),
        gas=dataclasses.replace(made.gas, clearance_ratio=[0.0076] * 2),
        friction=dataclasses.replace(made.friction, wall=CoulombSlide([0.083] * 2)),
    )
    one, other = (solve_orbit(c, COARSE) for c in (made, listed))
    assert float(one.mechanical_efficiency) == pytest.approx(
        float(other.mechanical_efficiency), abs=1e-14
    )


def unequal_twin(discharge_pressure=(980e3, 980e3), wall=(0.083, 0.083)):
    """The twin with a pressure and a coefficient of each cylinder: one program, whatever they are."""
    made = several(LAYOUTS[2])
    gas = dataclasses.replace(made.gas, discharge_pressure=list(discharge_pressure))
    friction = dataclasses.replace(made.friction, wall=CoulombSlide(list(wall)))
    return dataclasses.replace(made, gas=gas, friction=friction)


def test_a_cylinder_that_is_shut_off_does_no_work():
    """Suction valves held open: the gas work is that of the other cylinder alone."""
    orbit = solve_orbit(unequal_twin(discharge_pressure=[980e3, 98.0001e3]), COARSE)
    # quadrature with 6 nodes on a panel, as of all cylinders above
    assert float(orbit.energy.gas_work) == pytest.approx(297.326137139, rel=1e-4)
    assert abs(orbit.energy.residual) < 1e-12


def test_a_bad_cylinder_is_named():
    made = several(LAYOUTS[2])
    with pytest.raises(SolveFailed, match=r"locks.*in cylinder 2"):
        solve_orbit(unequal_twin(wall=[0.083, 8.0]), COARSE)
    with pytest.raises(BadInput, match=r"bore.*> 0 and <= 10 m in cylinder 2, but is -0.1"):
        dataclasses.replace(made.mechanism, bore=[0.1, -0.1])
    with pytest.raises(BadInput, match=r"conrod_length in cylinder 2"):
        dataclasses.replace(made.mechanism, conrod_length=[0.3, 0.03])
    short = dataclasses.replace(made.mechanism, bore=[0.1, 0.1, 0.1])
    with pytest.raises(BadInput, match=r"mechanism.bore.*one for each of 2 cylinders"):
        dataclasses.replace(made, mechanism=short)


@pytest.mark.slow
def test_extreme_layouts_have_an_orbit():
    """Sixteen cylinders, of which some share one angle, pins at 0 and 360, very different bores."""
    throws = [(90.0 * i, 0.1 * i, [-30.0, -30.0, 30.0, 30.0], 0.0) for i in range(3)]
    throws.append((360.0, 0.3, [-30.0, -30.0, 30.0, 30.0], 0.0))
    made = several(throws)
    bores = np.linspace(0.05, 0.15, 16)
    made = dataclasses.replace(made, mechanism=dataclasses.replace(made.mechanism, bore=bores))
    orbit = solve_orbit(made, Collocation(nodes=4, reversals=0))
    assert abs(orbit.energy.residual) < 1e-12
    # as the area of the pistons; four nodes on a panel
    work = 297.326137139 * float(np.sum((bores / 0.13) ** 2))
    assert float(orbit.energy.gas_work) == pytest.approx(work, rel=1e-3)


NAMED = {
    "single": "single",
    "V90": "V90",
    "V60": "V60",
    "W60": "W60",
    "VV45": "VV45",
    "radial-3": "radial 3",
    "in-line-2": "in-line 2",
    "boxer": "boxer",
}


def test_layouts_by_name_have_the_sums_of_the_table():
    orders = sums_of({name: Crankshaft(layout=name) for name in NAMED})
    for name, key in NAMED.items():
        wanted = ((0.5, 0.5), (0.5, 0.5)) if key == "single" else BALANCES[key][1:]
        for sums, (ahead, behind) in zip(orders[name], wanted, strict=True):
            got = abs(complex(sums.forward)), abs(complex(sums.backward))
            np.testing.assert_allclose(got, (ahead, behind), atol=1e-12, err_msg=name)
    # (f+, f- of order 2), then couples of order 1 in pitches
    more = {
        "in-line-4": ((2, 2), (0, 0)),
        "in-line-6": ((0, 0), (0, 0)),
        "opposed": ((0, 0), (0, 0)),
        "radial-5": ((0, 0), (0, 0)),
        "in-line-3": ((0, 0), (0.75**0.5, 0.75**0.5)),
        "boxer-2": ((0, 0), (0.5, 0.5)),
        "V90x2": ((2**0.5, 2**0.5), (1, 0)),
        "VV45 x2": ((2.613125929753, 1.082392200292), (2, 0)),
    }
    orders = sums_of(
        {name: Crankshaft(layout=name.replace(" ", ""), throw_pitch=1.0) for name in more}
    )
    for name, (second, couple) in more.items():
        first, sums = orders[name]
        np.testing.assert_allclose(
            [abs(complex(x)) for x in (sums.forward, sums.backward)], second, atol=1e-12
        )
        got = [abs(complex(x)) for x in (first.forward_couple, first.backward_couple)]
        np.testing.assert_allclose(got, couple, atol=1e-12, err_msg=name)
    with pytest.raises(BadInput, match="a layout such as"):
        Crankshaft(layout="V")


def test_a_balanced_layout_has_the_counterweights():
    made = several(LAYOUTS[4])
    shorthand = Crankshaft(
        made.crankshaft.inertia, layout="V90x2", throw_pitch=0.2, rod_pitch=0.04, balanced=True
    )
    state = CrankState(jnp.linspace(0.0, 6.0, 50), jnp.full(50, 100.0), jnp.full(50, 30.0))
    one, other = (
        shaking_wrench(dataclasses.replace(made, crankshaft=c), state)
        for c in (made.crankshaft, shorthand)
    )
    # unbalances typed to nine digits, of forces of kN
    np.testing.assert_allclose(one.force, other.force, atol=1e-5)
    np.testing.assert_allclose(one.moment, other.moment, atol=1e-6)


def staged(**changes):
    return StagedCycle((1, 1, 1, 1, 2, 2), 98e3, 980e3, 1.05, 0.0076, 98e3, **changes)


def test_two_stages_have_the_golden_pressure_and_work():
    mechanism = several(LAYOUTS[1]).mechanism
    area, stroke = mechanism.piston_area, mechanism.stroke
    between = jax.jit(
        lambda c: dataclasses.replace(staged(), clearance_ratio=c).between(area, stroke)[1]
    )
    pressure = jax.jit(lambda: staged().between(area, stroke))()
    assert float(pressure[1]) == pytest.approx(199937.5289868, abs=1e-6)
    work = []
    for low, high in itertools.pairwise(np.asarray(pressure)):
        r, n, c = high / low, 1.05, 0.0076
        volume = float(area * stroke) * (1 + c - c * r ** (1 / n))
        work.append(n / (n - 1) * low * volume * (r ** ((n - 1) / n) - 1))
    np.testing.assert_allclose(work, (93.62307826, 426.30489344), rtol=1e-10)
    slope = jax.jit(jax.grad(between))
    ahead, back = (between(0.0076 + h) for h in (1e-5, -1e-5))
    assert float(slope(0.0076)) == pytest.approx(float(ahead - back) / 2e-5, rel=1e-8)
    # a tolerance study with exact curvature takes second derivatives; differences leave 1e-7
    bent = jax.jit(jax.grad(jax.grad(between)))(0.0076)
    ahead, back = (slope(0.0076 + h) for h in (1e-4, -1e-4))
    assert float(bent) == pytest.approx(float(ahead - back) / 2e-4, rel=1e-6)
    three = StagedCycle((1, 1, 1, 2, 3), 1e5, 27e5, 1.2, [0.1, 0.1, 0.1, 0.05, 0.0])
    found = np.asarray(three.between(jnp.array([9.0, 9, 9, 9, 3]), jnp.ones(5)))
    ratio = (found[1:] / found[:-1])[[0, 0, 0, 1, 2]] ** (1 / 1.2)
    flow = np.array([9, 9, 9, 9, 3]) * (1 + (c := np.array([0.1] * 3 + [0.05, 0])) - c * ratio)
    flow = flow * found[[0, 0, 0, 1, 2]]
    np.testing.assert_allclose([flow[:3].sum(), flow[3]], flow[4], rtol=1e-12)


def test_stages_share_one_crank():
    throws = [(0.0, -0.1, [-60.0, 0.0, 60.0], -0.5), (180.0, 0.1, [-60.0, 0.0, 60.0], -0.5)]
    orbit = solve_orbit(several(throws, gas=staged()), COARSE)
    assert float(orbit.energy.gas_work) == pytest.approx(1227.10209996, rel=1e-5)
    assert abs(orbit.energy.residual) < 1e-12
    with pytest.raises(BadInput, match="one stage for each of 2 cylinders"):
        several(LAYOUTS[2], gas=staged())


def test_a_double_acting_piston_works_on_both_sides():
    """Work of both ends, and the load of the crosshead pin that reverses."""
    made = several(LAYOUTS[2])
    rod = 0.04
    both = DoubleActing(made.gas, made.gas, rod, 98e3)
    friction = dataclasses.replace(made.friction, packing=Packing(50.0))
    made = dataclasses.replace(made, gas=both, friction=friction)
    orbit = solve_orbit(made, Collocation(nodes=8, reversals=0))
    share = 1 + (1 - (rod / 0.13) ** 2)  # of the areas of both ends
    assert float(orbit.energy.gas_work) == pytest.approx(2 * share * 297.326137139, rel=1e-5)
    packing = losses(orbit, "packing")
    stroke = float(made.mechanism.stroke)
    assert packing == pytest.approx(2 * 50.0 * 2 * stroke, rel=1e-10)
    assert abs(orbit.energy.residual) < 1e-12
    angle, ratio = rod_load_reversal(orbit)["piston_pin_2"]
    force = np.asarray(orbit.loads.forces["piston_pin_2"][0])
    tension = float(orbit.weight[force > 0].sum())
    # nodes are some degrees apart
    smaller = np.rad2deg(min(tension, 2 * np.pi - tension))
    assert np.rad2deg(float(angle)) == pytest.approx(smaller, abs=4.0)
    assert float(ratio) == pytest.approx(force.max() / -force.min(), rel=1e-12)


def test_three_bearings_of_a_beam_have_the_closed_form():
    journal = CoulombJournal(0.013, 0.092)
    beam = MainBearings((journal,) * 3, jnp.array([0.0, 1.0, 2.0]), shaft="beam")
    wanted = (0.69140625, 0.3671875, -0.05859375), (13 / 32, 22 / 32, -3 / 32)
    wanted = (*wanted, (0.16796875, 0.9140625, -0.08203125))
    np.testing.assert_allclose(beam.influence(jnp.array([0.25, 0.5, 0.75])).T, wanted, atol=1e-14)
    # two bearings: the law of the lever, a beam or not
    two = MainBearings((journal,) * 2, jnp.array([0.0, 2.0]), shaft="beam")
    np.testing.assert_allclose(two.influence(jnp.array([0.5])).T, [(0.75, 0.25)], atol=1e-15)
    # four: mirrored loads have mirrored reactions, and force and moment balance
    four = MainBearings((journal,) * 4, jnp.array([-0.3, -0.1, 0.1, 0.3]), shaft="beam")
    table = np.asarray(four.influence(jnp.array([-0.25, 0.25, 0.05])))
    np.testing.assert_allclose(table[:, 0], table[::-1, 1], atol=1e-14)
    np.testing.assert_allclose(table.sum(0), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.asarray(four.position) @ table, (-0.25, 0.25, 0.05), atol=1e-14)


def test_parts_name_what_does_not_go_together(twin):
    made = several(LAYOUTS[2])
    with pytest.raises(BadInput, match=r"unbalance.*absent beside throws, which have theirs"):
        dataclasses.replace(made.crankshaft, unbalance=0.1)
    with pytest.raises(BadInput, match="at least one bank angle"):
        Throw([])
    assert Crankshaft(0.1).count == 1
    assert set(twin.energy.losses) >= {"main_1", "main_2", "crank_pin_1", "wall_2"}


def test_a_layout_by_name_has_its_count_without_numbers():
    """Solvers ask for it while they find out shapes."""
    shapes = eqx.filter_eval_shape(lambda c: c, Crankshaft(layout="V90x2", throw_pitch=0.09))
    assert shapes.count == 4


def test_panels_of_a_fixed_number():
    """The same edges for every number of cylinders; half of the kinks of this machine coincide."""
    made = several(LAYOUTS[4])
    fast = Collocation(nodes=5, reversals=0, tolerance=1e-3, panel_count=14, estimate=False)
    orbit = solve_orbit(made, fast)
    assert orbit.weight.size == 70
    kinks = np.array([0.0, 0.0, 1.0, 1.0 + 1e-9, 2.0, 5.0])
    edges_of = jax.jit(_of_count, static_argnums=1)
    for count in (4, 9, 14):
        edges = np.asarray(edges_of(jnp.asarray(kinks), count))
        assert edges.size == count
        # all kinks are edges, no panel has no width, and the widest were cut
        assert all(np.abs(edges - kink).min() < 1e-8 for kink in kinks[[0, 2, 4, 5]])
        widths = np.diff(np.append(edges, 2 * np.pi))
        assert widths.min() > 0.2
        assert count < 9 or widths.max() < 1.01
    # as of one cylinder with five nodes on a panel; 4e-5 seen
    assert float(orbit.mechanical_efficiency) == pytest.approx(GOLDEN[4][0], abs=1e-4)
    assert np.isnan(float(orbit.efficiency_error))


@pytest.mark.parametrize(
    "name", [pytest.param("two-stage-crosshead", marks=pytest.mark.slow), "refrigeration-twin"]
)
def test_bundled_machines_are_drawn_and_run(name):
    made = load(name).as_compressor()
    orbit = solve_orbit(made, COARSE)
    assert abs(orbit.energy.residual) < 1e-12
    # within the packing, the crosshead pin is loaded on both sides for the 15 degrees of the standard
    if name == "two-stage-crosshead":
        for angle, ratio in rod_load_reversal(orbit).values():
            assert float(angle) > np.deg2rad(15.0)
            assert float(ratio) > 0.03
    motion = cylinders_motion(made, orbit, frames=4)
    front, side = motion.figure.axes
    motion.show(0)
    rods = [np.asarray(line.get_xydata()) for line in front.lines[::3]]
    motion.show(2)
    for before, line in zip(rods, front.lines[::3], strict=True):
        after = np.asarray(line.get_xydata())
        # (y, x) of crank centre, pin and piston: the links keep their lengths
        for points in (before, after):
            lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
            wanted = float(made.mechanism.crank_radius), float(made.mechanism.conrod_length)
            np.testing.assert_allclose(lengths, wanted, rtol=1e-6)
        assert np.abs(after - before).max() > 0.01
    assert side.get_xlabel() == "z, m"
    figure = order_spectra(made, orbit)
    assert len(figure.axes) == 3


@pytest.mark.slow
def test_a_stiff_train_carries_what_the_motor_gives(twin):
    """The coupling of a rigid train: the motor's torque less what turns the motor itself."""
    made = several(LAYOUTS[2])
    train = CrankTrain([0.1], [1e10])
    found = train_torques(made, twin, train, 8)
    rest = twin.motor_torque - 0.1 * twin.state.acceleration
    duration = twin.weight / twin.state.speed
    wanted, _ = time_harmonics(rest, twin.time, duration, 8)
    size = float(jnp.abs(wanted[0]))
    # springs that give by 1e-5 of the motion, quadrature of the orbit
    np.testing.assert_allclose(-found.amplitude[0], wanted, atol=1e-4 * size)
    level = float(twin.motor_torque @ duration / duration.sum())
    assert -float(found.mean[0]) == pytest.approx(level, rel=1e-12)
    _, peaks = train_over_speed(made, train, twin.mean_speed[None], 8)
    # six nodes on a panel against eight and edges at the load reversals
    assert float(peaks[0, 0]) == pytest.approx(float(found.peak[0]), rel=1e-4)
    with pytest.raises(BadInput, match="less than the crank's"):
        CrankTrain([1.0], [1e6]).chain(made)
    with pytest.raises(BadInput, match="1 values, one a spring"):
        CrankTrain([0.1], [1e6, 1e6]).chain(made)


@pytest.mark.slow
def test_the_rotor_has_the_torsion_of_the_chain():
    """Torques of the chain on the torsional freedoms of a 6-DOF rotor: massless shafts and disks."""
    diameter, modulus = 0.05, 210e9
    shear = modulus / 2.6  # Poisson 0.3
    length = shear * np.pi * diameter**4 / 32 / np.asarray(TRAIN.stiffness)
    shaft = ShaftElements(
        (1, 2, 3, 4), length, diameter, young_modulus=modulus, density=0.0, poisson=0.3
    )
    inertia = np.asarray(TRAIN.inertia)
    disks = Disks((1, 2, 3, 4), 10.0, inertia, inertia)
    mounts = tuple(
        Link((node, "ground"), Mount(np.full(3, 1e6), np.zeros(3)), ("ux", "uy", "uz"))
        for node in (1, 4)
    )
    model = RotorModel(shafts=(shaft,), disks=(disks,), links=mounts, dof=6)
    torque = np.array([0.0, 1.0, 1.0, 0.0])
    zero = np.zeros((1, 3))
    forces = tuple(
        PeriodicForce(node, None, (4,), zero, zero, np.array([[0, 0, t]]), zero)
        for node, t in enumerate(torque, 1)
        if t
    )
    speed = jnp.array([1000 * np.pi / 30])
    found = respond(model, forces, speed, (4,)).checked()
    twist = found.displacement[0, 0, jnp.array([node_index(model, n) for n in (1, 2, 3, 4)]), 5]
    bare = dataclasses.replace(TRAIN, damping=jnp.zeros(3))
    angle = bare.response(jnp.asarray(torque)[:, None] + 0j, 4 * speed)[:, 0]
    np.testing.assert_allclose(twist, angle, rtol=1e-9)


@pytest.mark.slow  # a program for each layout
def test_layouts_are_swept():
    scene, layouts = load("refrigeration-twin"), ("in-line-2", "boxer-2")
    found = sweep_machines(
        {name: with_values(scene, {"crankshaft.layout": name}) for name in layouts},
        {},
        ["peak_shaking_force", "speed_fluctuation"],
        dimension="layout",
        options=AnalysisOptions(Collocation(nodes=5, reversals=0)),
    )
    assert float(found["peak_shaking_force"].sel(layout="boxer-2")) < 1e-9  # [N] the boxer has none
    assert found["speed_fluctuation"].shape == (2,)
    assert bool(found["ok"].all())
    with pytest.raises(BadInput, match="machines"):
        sweep_machines({}, {}, ["swept_volume"])


@pytest.mark.slow  # half a minute of compiling each
@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_golden_values_by_shooting(count):
    """Steps of eighth order that stop at as many load reversals as collocation places edges."""
    made = several(LAYOUTS[count])
    solver = Shooting(
        diffrax.Dopri8(), tolerance=1e-9, max_steps=65536, reversals=4 * count, output_nodes=37
    )
    orbit = solve_orbit(made, solver)
    assert float(orbit.mechanical_efficiency) == pytest.approx(GOLDEN[count][0], abs=1e-9)
    assert float(orbit.speed_fluctuation) == pytest.approx(GOLDEN[count][1], abs=1e-9)


@pytest.mark.slow  # a derivative to every number
def test_sensitivities_locate_the_load_reversals():
    """As the default does: differences of its values agree."""
    scene, name = load("refrigeration-twin"), "mechanism.crank_radius"
    found = {one.number: one for one in sensitivity(scene).ranking("mechanical_efficiency")}[name]
    one = problem(scene, [name], ["mechanical_efficiency"])
    value = eqx.filter_jit(lambda x: one(x).values[0])
    step = 1e-4 * one.current
    difference = (value(one.current + step) - value(one.current - step)) / (2 * step[0])
    # the square of the step, and an error of 1e-10 of the values over it
    assert found.derivative == pytest.approx(float(difference), rel=1e-5)


@pytest.mark.slow  # three programs
def test_verbs_share_one_default():
    """The same bits by `solve_orbit` and by a design problem; many in one program differ by rounding."""
    scene, name = load("refrigeration-twin"), "mechanism.bore"
    value = float(solve_orbit(scene).mechanical_efficiency)
    one = problem(scene, [name], ["mechanical_efficiency"])
    assert float(one(one.current).values[0]) == value
    bores = float(one.current[0]) * np.array([1.0, 1.01])
    table = sweep(scene, {name: bores}, ["mechanical_efficiency"])
    assert np.ravel(table["mechanical_efficiency"])[0] == pytest.approx(value, rel=1e-14)
