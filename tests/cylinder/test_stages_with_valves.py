"""Stages with valves: the pressure between them against an own program in time, and by differences."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import plate_valve
from reference_ends import DoubleActing as Reference
from reference_ends import Valve

from jaxcomp import BadInput, Compressor, SolveFailed, simulate, solve_orbit
from jaxcomp._core.status import Status
from jaxcomp.crank import TimeIntegration, performance
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import (
    CrankEnd,
    Cylinder,
    DischargeLine,
    Intercooler,
    LaminarGap,
    Plenum,
    Stage,
    SuctionLine,
)
from jaxcomp.fluid import Mixture, PerfectGas, RealGas
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import ConstantSpeed, MeanSpeed, SlipLine

RADIUS, LENGTH, ROD, SPEED = 0.06, 0.3, 0.05, 77.5
RINGS = LaminarGap(4e-5, 0.03, 2e-5)
PACKING = LaminarGap(2e-5, 0.06, 2e-5)
BORES = 0.2, 0.14
LOW, HIGH, WARM, COOLED, DROP = 1e5, 8e5, 300.0, 313.0, 8e3
CLEARANCES = (0.12, 0.14), (0.13, 0.15)
VALVES = (
    (
        Valve(0.15, 60.0, 2e4, 0.0, 3e-3, 0.08, 0.06),
        Valve(0.12, 60.0, 2.5e4, 3e-4, 2.5e-3, 0.07, 0.05),
    ),
    (
        Valve(0.10, 50.0, 2e4, 0.0, 2.5e-3, 0.055, 0.05),
        Valve(0.08, 50.0, 2.5e4, 3e-4, 2.2e-3, 0.05, 0.045),
    ),
)


def crank_end(stage):
    return CrankEnd(rod_diameter=ROD, clearance_ratio=CLEARANCES[stage][1], packing=PACKING)


def cylinder(cooler=None, **changes):
    second = Stage(
        cooler=cooler or Intercooler(COOLED, DROP),
        suction_valve=plate_valve(VALVES[1][0]),
        discharge_valve=plate_valve(VALVES[1][1]),
        clearance_ratio=CLEARANCES[1][0],
        leakage=RINGS,
        crank_end=crank_end(1),
    )
    entries = {
        "fluid": PerfectGas(287.0, 1.4),
        "suction": SuctionLine(pressure=LOW, temperature=WARM),
        "discharge": DischargeLine(pressure=HIGH),
        "suction_valve": plate_valve(VALVES[0][0]),
        "discharge_valve": plate_valve(VALVES[0][1]),
        "clearance_ratio": CLEARANCES[0][0],
        "leakage": RINGS,
        "crank_end": crank_end(0),
        "later_stages": (second,),
    }
    return Cylinder(**{**entries, **changes})


def machine(gas=None, motor=None):
    mechanism = SliderCrank(jnp.asarray(BORES), RADIUS, LENGTH, 30.0, 0.0)
    crankshaft = Crankshaft(6.0, layout="boxer-2")
    return Compressor(mechanism, crankshaft, motor or ConstantSpeed(SPEED), gas or cylinder())


def of_stage(number, pressures):
    """The own program of a stage between two pressures."""
    gaps = [
        np.pi * diameter * float(gap.gap) ** 3 / (12 * float(gap.viscosity) * float(gap.length))
        for gap, diameter in ((RINGS, BORES[number]), (PACKING, ROD))
    ]
    low, high = pressures
    warm = (WARM, COOLED)[number]
    hot = warm * (high / low) ** (0.4 / 1.4)
    valves = (VALVES[number], VALVES[number])
    sizes = BORES[number], RADIUS, LENGTH, ROD, CLEARANCES[number], valves
    return Reference(*sizes, (low, warm), (high, hot), SPEED, *gaps)


@pytest.mark.slow  # a minute of compiling
def test_the_pressure_between_stages_is_that_of_an_own_program():
    """Both stages come back after a revolution in time at the pressure found, and pass on one flow.

    A stage draws about in proportion to the pressure before it: what parts the flows is the pressure's
    error.
    """
    orbit = solve_orbit(machine())
    cycle = orbit.cycle
    between = float(cycle.interstage_pressures[0])
    density = np.array([LOW / WARM, between / COOLED]) / 287.0
    starts = np.asarray(cycle.together.z.left[:, 0]).reshape(2, 2, 8)
    modes = np.asarray(cycle.together.mesh.flags[:, 0])[:, [0, 3, 6, 9]]
    swept = np.asarray(cycle.each.case.swept).reshape(2, 2)
    flows, works = [], []
    lines = ((LOW, between + DROP), (between, HIGH))
    for stage in range(2):
        begin = []
        for end in range(2):
            m, T, *rest = starts[stage, end]
            begin += [m * density[stage] * swept[stage, end], T * (WARM, COOLED)[stage]]
            for i, valve in enumerate(VALVES[stage]):
                x, v, u = rest[3 * i : 3 * i + 3]
                begin += [x * valve.stop, v * valve.stop * SPEED]
                begin.append(u * np.sqrt(287.0 * (WARM, COOLED)[stage]))
        after, sums, *_ = of_stage(stage, lines[stage]).revolution(begin, modes[stage], -np.pi / 2)
        gas = [0, 1, 8, 9]
        np.testing.assert_allclose(after[gas], np.array(begin)[gas], rtol=1e-7)
        flows.append(sums[:, 1].sum())
        works.append(-sums[:, 3].sum())
    assert abs(flows[0] / flows[1] - 1) < 1e-8
    np.testing.assert_allclose(cycle.delivered, flows[1], rtol=1e-8)
    np.testing.assert_allclose(orbit.energy.gas_work, sum(works), rtol=1e-8)

    made = performance(machine(), orbit)
    assert abs(made.heat_closure) < 1e-8
    assert float(made.heat["coolers"]) > 0


@pytest.mark.slow  # compiles values and derivatives
def test_derivatives_of_stages_are_those_of_differences():
    design = machine(motor=MeanSpeed(SPEED))

    def places(compressor):
        stage = compressor.gas.later_stages[0]
        return [compressor.mechanism.bore, stage.cooler.outlet_temperature, stage.clearance_ratio]

    def outputs(logs):
        values = [value * jnp.exp(log) for value, log in zip(places(design), logs, strict=True)]
        orbit = solve_orbit(eqx.tree_at(places, design, values))
        cycle = orbit.cycle
        numbers = (cycle.mass_flow, orbit.motor_power, cycle.interstage_pressures[0])
        return jnp.log(jnp.stack(numbers))

    slopes = jax.jacfwd(outputs)(jnp.zeros(3))
    step = 1e-4
    for column in range(3):
        there = jnp.zeros(3).at[column].set(step)
        wanted = (outputs(there) - outputs(-there)) / (2 * step)
        # flows and pressures agree to 1e-10, over the step
        np.testing.assert_allclose(slopes[:, column], wanted, rtol=1e-5, atol=1e-6)


@pytest.mark.slow  # a minute for each gas
@pytest.mark.parametrize(
    "fluid",
    [RealGas("R744"), Mixture(mole_fractions={"Methane": 0.9, "Ethane": 0.06, "Nitrogen": 0.04})],
    ids=["carbon dioxide", "natural gas"],
)
def test_stages_take_real_gases_and_mixtures(fluid):
    gas = cylinder(fluid=fluid)
    compressor = machine(gas)
    orbit = solve_orbit(compressor)
    cycle = orbit.cycle
    assert np.ptp(cycle.flow_of_stages) < 1e-9 * float(cycle.delivered)
    assert float(cycle.energy_closure) < 1e-7
    assert abs(performance(compressor, orbit).heat_closure) < 1e-7


@pytest.mark.slow  # a minute of compiling
def test_condensate_in_a_cooler_is_refused_with_its_dew_point():
    """The pressure between the stages is found with the crank, and so is what condenses there."""
    fluid = Mixture(mole_fractions={"methane": 0.3, "R290": 0.7})
    with pytest.raises(SolveFailed) as failure:
        solve_orbit(machine(cylinder(Intercooler(230.0, DROP), fluid=fluid)))
    assert failure.value.status == Status.wet
    words = str(failure.value)
    assert re.search(r"suction line of stage 2 gas of -43\.[12] °C", words)
    assert "later_stages.0.cooler.outlet_temperature" in words
    dew = float(re.findall(r"dew point, (-?[\d.]+) °C", words)[0])
    pressure = 1e5 * float(re.findall(r"at ([\d.]+) bar", words)[0])
    # both are printed with few digits
    assert abs(float(fluid.condensation_temperature(pressure)) - 273.15 - dew) < 0.1


@pytest.mark.slow  # a minute of compiling
def test_bottles_and_coolers_hold_the_mean_pressure():
    """Large plenums on all sides leave flow and pressure where they are without, but for their necks."""
    wide = Plenum(0.5, 0.2, 0.3, 0.0)
    bottled = cylinder(
        Intercooler(COOLED, DROP, before=(wide,), behind=(wide,)),
        suction=SuctionLine(pressure=LOW, temperature=WARM, plenums=(wide,)),
        discharge=DischargeLine(pressure=HIGH, plenums=(wide,)),
    )
    cycle = solve_orbit(machine(bottled)).cycle
    bare = solve_orbit(machine()).cycle
    np.testing.assert_allclose(cycle.interstage_pressures, bare.interstage_pressures, rtol=5e-3)
    np.testing.assert_allclose(cycle.mass_flow, bare.mass_flow, rtol=5e-3)
    assert np.ptp(cycle.flow_of_stages) < 1e-9 * float(cycle.delivered)


@pytest.mark.slow  # compiles the motion of four ends
def test_stages_in_time_hold_the_pressure_between_them():
    """From the periodic state's pressure between the stages, flows of a settled revolution are equal."""
    orbit = solve_orbit(machine())
    between = orbit.cycle.interstage_pressures
    gas = cylinder(interstage_pressure=between)
    heavy = Compressor(
        SliderCrank(jnp.asarray(BORES), RADIUS, LENGTH, 30.0, 0.0),
        Crankshaft(1e9, layout="boxer-2"),
        SlipLine(1e-9, SPEED),
        gas,
    )
    turn = 2 * np.pi / SPEED
    options = TimeIntegration(tolerance=1e-9, samples=21, max_steps=2**15)
    runs = [
        simulate(heavy, turns * turn, angle=-np.pi / 2, speed=SPEED, options=options)
        for turns in (9, 10)
    ]
    discharged = np.diff([run.gas.totals.discharge for run in runs], axis=0)[0]
    np.testing.assert_allclose(discharged[:2].sum(), discharged[2:].sum(), rtol=1e-5)
    # what a start leaves of the second stage shrinks to 0.3 with every revolution
    np.testing.assert_allclose(discharged[2:].sum(), orbit.cycle.delivered, rtol=1e-5)
    delivered = float(runs[1].gas.delivered - runs[0].gas.delivered)
    np.testing.assert_allclose(delivered, discharged[2:].sum(), rtol=1e-12)
    assert runs[0].gas.names == ["1.head", "1.crank", "2.head", "2.crank"]


def test_stages_in_time_want_the_pressure_between_them():
    design = machine(motor=SlipLine(40.0, SPEED))
    with pytest.raises(BadInput, match=r"interstage_pressure.*jaxcomp run"):
        simulate(design, 0.1)
    wide = Plenum(0.5, 0.2, 0.3, 0.0)
    bottled = cylinder(
        Intercooler(COOLED, DROP, behind=(wide,)), interstage_pressure=jnp.array([2.8e5])
    )
    with pytest.raises(BadInput, match=r"later_stages\.0\.cooler.*without bottles"):
        simulate(machine(bottled, SlipLine(40.0, SPEED)), 0.1)


def test_stages_that_do_not_go_together_are_refused_by_name():
    with pytest.raises(BadInput, match="stage_of_cylinder"):
        cylinder(stage_of_cylinder=(1, 1))
    with pytest.raises(BadInput, match="one stage for each of 2 cylinders"):
        machine(cylinder(stage_of_cylinder=(1, 2, 2)))
    with pytest.raises(BadInput, match="interstage_pressure"):
        cylinder(interstage_pressure=jnp.array([2e5, 3e5]))
    # propane in methane, at 5 bar: 40 % of it condense at 270 K, and none at 313 K
    rich = Mixture(mole_fractions={"methane": 0.3, "R290": 0.7})
    held = {"fluid": rich, "interstage_pressure": jnp.array([5e5])}
    cylinder(**held)
    with pytest.raises(BadInput, match=r"cooler\.outlet_temperature.*begins to condense at 5e\+05"):
        cylinder(Intercooler(262.0, DROP), **held)
    with pytest.raises(BadInput, match="every stage or in none"):
        cylinder(crank_end=None)
    with pytest.raises(BadInput, match="later_stages"):
        cylinder(suction=SuctionLine(pressure=LOW, temperature=WARM, heating=10.0))
