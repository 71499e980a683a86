"""Double-acting cylinders with valves: against an own program in time, in limits, by differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import plate_valve
from reference_ends import DoubleActing as Reference
from reference_ends import Valve

from jaxcomp import BadInput, Compressor, simulate, solve_orbit
from jaxcomp.crank import TimeIntegration
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import CrankEnd, Cylinder, DischargeLine, LaminarGap, SuctionLine, solve_cycle
from jaxcomp.fluid import PerfectGas
from jaxcomp.machine import Machine
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import ConstantSpeed, SlipLine
from jaxcomp.study import steady_state

BORE, RADIUS, LENGTH, MASS, ROD = 0.2, 0.06, 0.3, 30.0, 0.05
SPEED, AMBIENT = 77.5, 1.1e5
LOW, HIGH, WARM = 1e5, 3.2e5, 300.0
HEAD, CRANK = 0.12, 0.14
SUCTION = Valve(0.15, 60.0, 2e4, 0.0, 3e-3, 0.08, 0.06)
DISCHARGE = Valve(0.12, 60.0, 2.5e4, 3e-4, 2.5e-3, 0.07, 0.05)
NARROW = Valve(0.10, 50.0, 2.5e4, 3e-4, 2.2e-3, 0.06, 0.05)
RINGS = LaminarGap(4e-5, 0.03, 2e-5)
PACKING = LaminarGap(2e-5, 0.06, 2e-5)


def cylinder(**changes):
    """Air, with a smaller discharge valve at the crank end."""
    crank_end = CrankEnd(
        rod_diameter=ROD,
        clearance_ratio=CRANK,
        discharge_valve=plate_valve(NARROW),
        packing=PACKING,
        ambient_pressure=AMBIENT,
    )
    entries = {
        "fluid": PerfectGas(287.0, 1.4),
        "suction": SuctionLine(pressure=LOW, temperature=WARM),
        "discharge": DischargeLine(pressure=HIGH),
        "suction_valve": plate_valve(SUCTION),
        "discharge_valve": plate_valve(DISCHARGE),
        "clearance_ratio": HEAD,
        "leakage": RINGS,
        "crank_end": crank_end,
    }
    return Cylinder(**{**entries, **changes})


def mechanism():
    return SliderCrank(BORE, RADIUS, LENGTH, MASS, 0.0)


def throw(gas):
    return Compressor(mechanism(), Crankshaft(6.0), ConstantSpeed(SPEED), gas)


def reference():
    hot = WARM * (HIGH / LOW) ** (0.4 / 1.4)
    conductance = [
        np.pi * diameter * float(gap.gap) ** 3 / (12 * float(gap.viscosity) * float(gap.length))
        for gap, diameter in ((RINGS, BORE), (PACKING, ROD))
    ]
    return Reference(
        BORE,
        RADIUS,
        LENGTH,
        ROD,
        (HEAD, CRANK),
        ((SUCTION, DISCHARGE), (SUCTION, NARROW)),
        (LOW, WARM),
        (HIGH, hot),
        SPEED,
        *conductance,
    )


def start_of(orbit):
    """States of both ends in SI units where the revolution begins, and the modes of their valves."""
    together = orbit.cycle.together
    states = np.asarray(together.z.left[0]).reshape(2, 8)
    rho = LOW / (287.0 * WARM)
    swept = np.asarray(orbit.cycle.each.case.swept)
    stops = np.array([[SUCTION.stop, DISCHARGE.stop], [SUCTION.stop, NARROW.stop]])
    port = np.sqrt(LOW / rho)
    out = []
    for end in range(2):
        m, T, *valves = states[end]
        out += [m * rho * swept[end], T * WARM]
        for i in range(2):
            x, v, u = valves[3 * i : 3 * i + 3]
            out += [x * stops[end, i], v * stops[end, i] * SPEED, u * port]
    modes = np.asarray(together.mesh.flags[0])[[0, 3, 6, 9]]
    return np.array(out), modes


@pytest.mark.slow  # half a minute of compiling
def test_two_ends_are_those_of_an_own_program_in_time():
    """It marches one revolution from the state that was found, and has to come back to it.

    DOP853 at 1e-11 and the collocation's 1e-9 of the flow are what parts them.
    """
    machine = Machine(throw(cylinder()))
    state = steady_state(machine)
    orbit = state.orbit
    begin, modes = start_of(orbit)
    own = reference()
    end, sums, new_modes, course = own.revolution(begin, modes, -np.pi / 2)
    scale = np.array([1e-3, 300.0, *[1e-3, 1.0, 50.0] * 2] * 2)
    # what stands in the port of a shut valve decides nothing
    shut = np.repeat(np.asarray(modes) == 0, 3).reshape(2, 6)
    counts = np.concatenate([np.ones((2, 2), bool), ~shut], axis=1).ravel()
    assert np.max(np.abs((end - begin) / scale)[counts]) < 1e-7
    assert list(new_modes) == list(modes)

    cycle = orbit.cycle
    totals = cycle.each.totals
    # the package counts the inner energy from 0 degC
    enthalpy = totals.discharge_heat + 287.0 / 0.4 * 273.15 * totals.discharge
    solved = np.array([totals.suction, totals.discharge, enthalpy, totals.work]).T
    np.testing.assert_allclose(solved, sums, rtol=1e-8)
    flow = sums[:, 1].sum() * SPEED / (2 * np.pi)
    np.testing.assert_allclose(cycle.mass_flow, flow, rtol=1e-8)
    power = -sums[:, 3].sum() * SPEED / (2 * np.pi)
    np.testing.assert_allclose(orbit.gas_power, power, rtol=1e-8)

    angle, head, crank = course
    face, around = own.area
    wanted = -(head * face - crank * around - AMBIENT * (face - around))
    sheet = state.api_618
    at_nodes = np.interp(sheet.crank_angle % (2 * np.pi), *sorted_turn(angle, wanted))
    # of chords between the steps of the march, 1e-4 of the load
    np.testing.assert_allclose(sheet.gas[0], at_nodes, atol=2e-3 * np.ptp(wanted))
    solved = along_rod(orbit, machine.compressor, angle)
    np.testing.assert_allclose(solved, wanted, atol=1e-8 * np.ptp(wanted))
    # its extremes lie between steps of the march
    assert 0 <= sheet.throws[0].gas_tension / wanted.max() - 1 < 1e-5
    assert 0 <= sheet.throws[0].gas_compression / -wanted.min() - 1 < 1e-5


def sorted_turn(angle, values):
    """A course over one turn from zero, for linear interpolation."""
    place = angle % (2 * np.pi)
    order = np.argsort(place)
    return place[order], values[order]


def along_rod(orbit, compressor, angle):
    """[N] Gas load along the rod at crank angles, tension positive."""
    from jaxcomp.compressor import gas_force

    return -np.asarray(gas_force(orbit.under_gas(compressor), jnp.asarray(angle)))[0]


@pytest.mark.slow  # half a minute of compiling
def test_a_revolution_in_time_is_that_of_an_own_program():
    """Both ends from the gas of the suction line, on a flywheel that keeps the speed to 1e-7."""
    heavy = Compressor(mechanism(), Crankshaft(1e9), SlipLine(1e-9, SPEED), cylinder())
    begin_angle = -np.pi / 2
    options = TimeIntegration(tolerance=1e-9, samples=21, max_steps=2**14)
    run = simulate(heavy, 2 * np.pi / SPEED, angle=begin_angle, speed=SPEED, options=options)
    begin = []
    for mass in run.gas.mass[:, 0]:
        begin += [float(mass), WARM, *[0.0] * 6]
    end, sums, *_ = reference().revolution(begin, [0] * 4, begin_angle)
    error = 2e-6  # kinks within steps of 1e-9
    np.testing.assert_allclose(run.gas.mass[:, -1], end[[0, 8]], rtol=error)
    np.testing.assert_allclose(run.gas.temperature[:, -1], end[[1, 9]], rtol=error)
    totals = run.gas.totals
    solved = np.array([totals.suction, totals.discharge, totals.work]).T
    np.testing.assert_allclose(solved, sums[:, [0, 1, 3]], rtol=error)
    np.testing.assert_allclose(run.gas.delivered, sums[:, 1].sum(), rtol=error)
    # over whole revolutions the gas beside the rod gives back what it takes
    np.testing.assert_allclose(run.energy.gas_work[-1], -sums[:, 3].sum(), rtol=error)
    assert run.gas.names == ["1.head", "1.crank"]
    assert "pressure.1.crank [Pa]" in run.columns()


@pytest.mark.slow  # as above
def test_a_run_up_of_both_ends_keeps_mass_and_energy():
    run_up = Compressor(mechanism(), Crankshaft(6.0), SlipLine(40.0, SPEED), cylinder())
    run = simulate(run_up, 0.4, options=TimeIntegration(tolerance=1e-9, samples=101))
    assert str(run).startswith("Transient: converged")
    assert float(run.state.speed[-1]) > 0.5 * SPEED
    # works are marched with the motion, to the tolerance of its steps
    assert abs(float(run.residual[-1])) < 1e-7
    totals = run.gas.totals
    gained = totals.suction - totals.discharge - totals.leakage
    mass = run.gas.mass
    np.testing.assert_allclose(gained, mass[:, -1] - mass[:, 0], atol=1e-13)


@pytest.mark.slow  # two programs
def test_tight_ends_are_machines_of_their_own():
    """The head end is a single-acting cylinder; both close mass and energy."""
    tight = cylinder(leakage=None)
    cycle = solve_orbit(throw(tight)).cycle
    alone = solve_cycle(eqx.tree_at(lambda c: c.crank_end, tight, None), mechanism(), SPEED)
    first = jax.tree.map(lambda x: x[0], cycle.each)
    np.testing.assert_allclose(first.delivered, alone.delivered, rtol=1e-9)
    np.testing.assert_allclose(first.indicated_work, alone.indicated_work, rtol=1e-9)
    # with the packing, the rings alone are tight
    assert float(cycle.mass_closure) < 1e-9
    assert float(cycle.energy_closure) < 1e-9


def _logarithms(logs):
    """Flow, work and power by rod, rings, packing and clearance of the crank end, and bore."""
    from jaxcomp.motor import MeanSpeed

    # a speed that the gas moves
    design = Compressor(mechanism(), Crankshaft(6.0), MeanSpeed(SPEED), cylinder())

    def places(compressor):
        end = compressor.gas.crank_end
        return [
            end.rod_diameter,
            compressor.gas.leakage.gap,
            end.packing.gap,
            end.clearance_ratio,
            compressor.mechanism.bore,
        ]

    values = [value * jnp.exp(log) for value, log in zip(places(design), logs, strict=True)]
    orbit = solve_orbit(eqx.tree_at(places, design, values))
    cycle = orbit.cycle
    return jnp.log(jnp.stack([cycle.mass_flow, cycle.indicated_work, orbit.motor_power]))


def _differences(columns):
    """Slopes of `_logarithms` by central differences, and their columns."""
    step = 1e-4
    zero = jnp.zeros(5)
    slopes = []
    for column in columns:
        there = zero.at[column].set(step)
        slopes.append((_logarithms(there) - _logarithms(-there)) / (2 * step))
    return jnp.stack(slopes, axis=1)


# the cycles are known to 1e-10, over the step; and the differences' own curvature
AS_DIFFERENCES = {"rtol": 1e-5, "atol": 3e-7}


@pytest.mark.slow  # compiles values and derivatives
def test_derivatives_of_both_ends_are_those_of_differences():
    slopes = jax.jacfwd(_logarithms)(jnp.zeros(5))
    np.testing.assert_allclose(slopes, _differences(range(5)), **AS_DIFFERENCES)


@pytest.mark.slow  # compiles values and derivatives
def test_reverse_derivatives_of_both_ends_are_those_of_differences():
    slopes = jax.jacrev(_logarithms)(jnp.zeros(5))
    np.testing.assert_allclose(slopes[:, [0, 3]], _differences([0, 3]), **AS_DIFFERENCES)


def test_what_cannot_be_is_refused_by_name():
    from jaxcomp.cylinder import WallNetwork
    from jaxcomp.cylinder.heat.annand import Annand

    with pytest.raises(BadInput, match="one end is solved"):
        solve_cycle(cylinder(), mechanism(), SPEED)
    heat = {"heat": Annand(0.7, 0.7), "wall_temperature": 350.0, "walls": WallNetwork(300.0, 5.0)}
    with pytest.raises(BadInput, match="wall_temperature"):
        cylinder(**heat)
    with pytest.raises(BadInput, match="around its rod"):
        throw(cylinder(discharge_valve=plate_valve(DISCHARGE), crank_end=thick_rod()))


def thick_rod():
    """A rod that leaves less than the ports take."""
    return CrankEnd(rod_diameter=0.19, clearance_ratio=CRANK)
