"""Process gas in a cylinder with valves: natural gas with hydrogen, and moist air that is unsaturated."""

import numpy as np
import pytest

from jaxcomp import SolveFailed, Status, load
from jaxcomp.cylinder import solve_cycle
from jaxcomp.scene import with_values

SPEED = 309.0  # [rad/s]
GASES = {
    "natural gas": {
        "methane": 0.85,
        "ethane": 0.05,
        "nitrogen": 0.03,
        "CO2": 0.02,
        "hydrogen": 0.05,
    },
    # behind the suction valve it is 11 degC at 2.47 bar, where its dew point is 6 degC
    "moist air": {"nitrogen": 0.78, "oxygen": 0.207, "argon": 0.009, "water": 0.004},
}
HUMID = {"nitrogen": 0.77, "oxygen": 0.207, "argon": 0.009, "water": 0.014}


def machine_with(fractions):
    """A small compressor from 3 bar and 30 degC to 8 bar with a gas of these mole fractions."""
    fluid = {"type": "mixture", "mole_fractions": fractions}
    suction = {"pressure": "3 bar", "temperature": "303.15 K"}
    values = {"gas.fluid": fluid, "gas.suction": suction, "gas.discharge": {"pressure": "8 bar"}}
    return with_values(load("r290-6cc"), values).as_compressor()


@pytest.mark.slow  # two programs of valves with GERG-2008
@pytest.mark.parametrize("name", GASES)
def test_heads_and_power_of_a_process_gas(name):
    machine = machine_with(GASES[name])
    gas = machine.gas
    assert gas.fluid.model == "GERG-2008"
    cycle = solve_cycle(gas, machine.mechanism, SPEED)
    assert bool(cycle.converged)
    # what comes and does not leave, over the indicated work
    np.testing.assert_allclose(cycle.energy_closure, 0.0, atol=1e-6)
    # the isentropic head is that between GERG's states of equal entropy
    first = gas.fluid.state(303.15, gas.fluid.density(303.15, 3e5))
    last = gas.fluid.at_entropy(8e5, first.s, first)
    np.testing.assert_allclose(cycle.isentropic_rise, last.h - first.h, rtol=1e-9)
    power = cycle.mass_flow * cycle.isentropic_rise / cycle.isentropic_efficiency
    np.testing.assert_allclose(cycle.indicated_power, power, rtol=1e-12)
    # along the path to the warmer gas that is delivered there is more volume to push
    delivered = cycle.discharged_gas
    path = np.linspace(np.log(3e5), np.log(8e5), 2001)
    density = np.interp(path, [path[0], path[-1]], np.log([first.rho, delivered.rho]))
    head = np.trapezoid(np.exp(path - density), path)
    # of the trapezium rule with 2,000 steps
    np.testing.assert_allclose(cycle.polytropic_rise, head, rtol=1e-6)
    assert cycle.polytropic_rise > cycle.isentropic_rise


@pytest.mark.slow  # a program of valves with GERG-2008
def test_humid_air_that_is_dry_in_the_line_is_wet_behind_the_valve():
    """By hand: its water has a dew point of 26 degC at 2.47 bar, and 2.47 of 3 bar cool it by 16 K."""
    machine = machine_with(HUMID)
    with pytest.raises(SolveFailed, match="below its dew point") as failure:
        solve_cycle(machine.gas, machine.mechanism, SPEED)
    assert failure.value.status == Status.wet
