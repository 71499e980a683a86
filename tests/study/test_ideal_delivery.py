"""What simple cycles deliver, against textbooks and closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import laws, machine

from jaxcomp import BadInput, Collocation, Machine, PolytropicCycle, load
from jaxcomp.gas import DoubleActing, StagedCycle
from jaxcomp.motor import MeanSpeed
from jaxcomp.scene import loads
from jaxcomp.study import AnalysisOptions, available_quantities, problem

RPM = np.pi / 30
ASKED = ["free_air", "ideal_volumetric_efficiency"]
HEATED = ["delivered_mass", "delivery_temperature"]
# What is delivered follows from the cycle and the mean speed alone: the machines rub nowhere, and what a
# load reversal or a node would add, or an estimate of errors, is nothing to it.
SOLVER = Collocation(nodes=8, reversals=0, estimate=False)
SMOOTH = laws()
# Temperature and gas constant of the inlet: all single cylinders have them, and share a program.
INLET = 300.0, 287.0


def quantities(compressor, names):
    asked = problem(Machine(compressor), {}, names, AnalysisOptions(SOLVER))
    return dict(zip(names, np.asarray(asked(jnp.zeros(0)).values), strict=True))


def test_a_single_stage_of_a_textbook():
    """Arasu, Thermal Engineering, example 5.1: 200 x 300 mm, 100 rpm, 1 to 8 bar, n = 1.25, 300 K."""
    gas = PolytropicCycle(1e5, 8e5, 1.25, 0.0, 1e5, *INLET)
    made = machine(gas=gas, bore=0.2, crank_radius=0.15, conrod_length=0.75, inertia=20.0,
                   motor=MeanSpeed(100 * RPM), friction=SMOOTH)  # fmt: skip
    found = quantities(made, [*ASKED, *HEATED])
    # printed to four digits
    assert 60 * found["free_air"] == pytest.approx(0.9425, abs=5e-5)
    assert 60 * found["delivered_mass"] == pytest.approx(1.0946, abs=5e-5)
    assert found["delivery_temperature"] == pytest.approx(454.71, abs=5e-3)
    assert found["ideal_volumetric_efficiency"] == pytest.approx(1.0, abs=1e-12)


def test_clearance_takes_of_the_flow():
    made = machine(gas=PolytropicCycle(98e3, 980e3, 1.05, 0.0028, 98e3, *INLET), friction=SMOOTH)
    filling = 1 + 0.0028 - 0.0028 * 10 ** (1 / 1.05)
    found = quantities(made, ASKED)
    swept = float(made.mechanism.swept_volume)
    turns = float(made.motor.mean_speed) / (2 * np.pi)
    assert found["ideal_volumetric_efficiency"] == pytest.approx(filling, rel=1e-12)
    # the mean speed is that of the orbit, to its tolerance
    assert found["free_air"] == pytest.approx(filling * swept * turns, rel=1e-9)


def test_both_ends_of_a_piston_count():
    end = PolytropicCycle(98e3, 400e3, 1.3, 0.1, 98e3, *INLET)
    made = machine(gas=DoubleActing(end, end, 0.03), friction=SMOOTH)
    one = machine(gas=end, friction=SMOOTH)
    both, single = (
        quantities(made, [*ASKED, "swept_volume"]),
        quantities(one, [*ASKED, "swept_volume"]),
    )
    rod = 1 - (0.03 / float(made.mechanism.bore)) ** 2
    assert both["free_air"] == pytest.approx((1 + rod) * single["free_air"], rel=1e-9)
    assert both["swept_volume"] == pytest.approx((1 + rod) * single["swept_volume"], rel=1e-12)
    efficiency = "ideal_volumetric_efficiency"
    assert both[efficiency] == pytest.approx(single[efficiency], rel=1e-12)


def test_a_cylinder_that_only_squeezes_delivers_nothing():
    made = machine(gas=PolytropicCycle(98e3, 980e3, 1.05, 0.5, 98e3, *INLET), friction=SMOOTH)
    found = quantities(made, ASKED)
    assert found["free_air"] == 0.0


TWO_STAGES = """
[mechanism]
type = "slider_crank"
bore = ["400 mm", "230 mm"]
crank_radius = "200 mm"
conrod_length = "1000 mm"
piston_mass = "30 kg"
conrod_mass = "20 kg"
conrod_centre = "330 mm"
conrod_inertia = "2 kg m^2"
[crankshaft]
inertia = "200 kg m^2"
layout = "in-line-2"
throw_pitch = "600 mm"
[motor]
type = "mean_speed"
mean_speed = "200 rpm"
[gas]
type = "staged"
stages = [1, 2]
suction_pressure = "1.013 bar"
discharge_pressure = "15 bar"
exponent = 1.3
clearance_ratio = ["4 %", "5 %"]
"""


@pytest.fixture(scope="module")
def two_stages():
    return loads(TWO_STAGES).machine.compressor


@pytest.fixture(scope="module")
def passed_on(two_stages):
    return quantities(two_stages, ["stage_pressure.1", "free_air", "gas_power"])


def test_stages_name_the_pressure_between_them(two_stages, passed_on):
    """Equal flows: V1 (1 + c1 - c1 r1^(1/n)) p0 = V2 (1 + c2 - c2 r2^(1/n)) p1."""
    for design in (Machine(two_stages), load("two-stage-crosshead").machine):
        assert "stage_pressure.1" in available_quantities(design, members=True)
    gas, mechanism = two_stages.gas, two_stages.mechanism
    assert isinstance(gas, StagedCycle)
    area, stroke = np.asarray(mechanism.piston_area), np.asarray(mechanism.stroke)
    between = np.asarray(gas.between(area, stroke))
    assert passed_on["stage_pressure.1"] == pytest.approx(between[1], rel=1e-12)


def test_two_stages_pass_on_one_flow(passed_on):
    """Equal flows with clearances of 4 and 5 % by hand: 3.25043 bar, 9.4693 m^3/min, 50,705.92 W."""
    found = passed_on
    assert found["stage_pressure.1"] == pytest.approx(3.25043e5, abs=0.5)
    assert 60 * found["free_air"] == pytest.approx(9.4693, abs=5e-5)
    assert found["gas_power"] == pytest.approx(50_705.92, abs=5e-3)


def test_the_temperature_of_the_inlet_is_asked_for():
    with pytest.raises(BadInput, match="inlet_temperature"):
        problem(Machine(machine()), {}, ["delivered_mass"])
