"""A cylinder with valves on a blend: derivatives to its composition, one program for all of them."""

import dataclasses as dc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load
from jaxcomp._core.status import Status
from jaxcomp.cylinder import solve_cycle
from jaxcomp.cylinder._gas_evidence import gas_evidence
from jaxcomp.fluid import Mixture

SPEED = 309.0  # [rad/s]


def cylinder(machine, fluid: Mixture):
    """At evaporating -10 and condensing 45 degC, superheat 10 K, no subcooling."""
    suction = dc.replace(
        machine.gas.suction, pressure=None, temperature=None, evaporating=263.15, superheat=10.0
    )
    discharge = dc.replace(
        machine.gas.discharge,
        pressure=None,
        temperature=None,
        condensing=318.15,
        liquid_temperature=None,
        subcooling=0.0,
    )
    return dc.replace(machine.gas, fluid=fluid, suction=suction, discharge=discharge)


@pytest.mark.slow  # a minute and a half of compilation
def test_derivatives_to_the_composition_agree_with_blends_solved_anew():
    """Of work, capacity and their ratio, through valves, rating point and both lines of R454B."""
    machine, fluid = load("r134a-7cc").as_compressor(), Mixture(name="R454B")
    gas = cylinder(machine, fluid)
    programs = []

    def results(gas):
        cycle = solve_cycle(gas, machine.mechanism, SPEED, throw=False)
        ratio = cycle.capacity / cycle.indicated_work
        return jnp.stack([cycle.indicated_work, cycle.capacity, ratio, cycle.mass_flow])

    @eqx.filter_jit
    def solved(gas):
        programs.append(1)
        return results(gas)

    w = np.asarray(fluid.mass_fractions)
    # the first up, the other down
    direction = np.array([1.0, -1.0])

    def other(change):
        composition = dict(zip(fluid.components, w + change * direction, strict=True))
        return np.asarray(
            solved(cylinder(machine, Mixture(mass_fractions=composition, name="R454B")))
        )

    # From 3e-5 to 3e-3 the differences are the same but for 4e-7 of the slope of the flow, by sequences
    # of 14 and 15 events that differ in a bounce.
    step = 1e-3
    near = other(step) - other(-step)
    far = other(2 * step) - other(-2 * step)
    differences = (8 * near - far) / (12 * step)
    assert len(programs) == 1

    @jax.jit
    def along(change):
        moved = jnp.asarray(w) + change * jnp.asarray(direction)
        return results(eqx.tree_at(lambda gas: gas.fluid.mass_fractions, gas, moved))

    slopes = jax.jit(jax.jacfwd(along))(0.0)
    # Of the flow as well, which hardly follows the composition: the slopes of pressure and density nearly
    # cancel in it, and what is rounded in the file of the lines would show forty times as large.
    np.testing.assert_allclose(slopes, differences, rtol=1e-6)


def saturated_suction(machine, fluid: Mixture, wall: float):
    """Cylinder that draws saturated gas of 0 degC and whose wall has a temperature [K]."""
    gas = machine.gas
    suction = dc.replace(
        gas.suction, pressure=None, temperature=None, evaporating=273.15, superheat=0.0, heating=0.0
    )
    discharge = dc.replace(
        gas.discharge, pressure=None, condensing=318.15, liquid_temperature=None, subcooling=0.0
    )
    return dc.replace(gas, fluid=fluid, suction=suction, discharge=discharge, wall_temperature=wall)


@pytest.mark.slow  # the program of a machine with valves
def test_a_cold_wall_makes_r513a_wet():
    """Its isentropes run along the dew line, and saturated gas of 0 degC meets it where it is cooled."""
    machine = load("r134a-7cc").as_compressor()
    for wall, status in ((293.15, Status.wet), (301.15, Status.converged)):
        cold = saturated_suction(machine, Mixture(name="R513A"), wall)
        cycle = solve_cycle(cold, machine.mechanism, SPEED, throw=False)
        assert cycle.status == status
        assert ("below its dew point" in gas_evidence(cycle)) == bool(status == Status.wet)


@pytest.mark.slow  # the program of a machine with valves
def test_a_cold_wall_makes_the_clearance_gas_of_r454c_wet_and_no_other():
    """Its isentropes leave the dew line upwards, so that what is compressed is dry.

    The gas in the clearance is hot when it gives heat to the wall of 20 degC, and expands below its dew
    point. At a wall of 40 degC it does not.
    """
    machine = load("r134a-7cc").as_compressor()
    fluid = Mixture(name="R454C")
    wet, dry = (
        solve_cycle(saturated_suction(machine, fluid, wall), machine.mechanism, SPEED, throw=False)
        for wall in (293.15, 313.15)
    )
    assert dry.status == Status.converged
    assert wet.status == Status.wet
    is_wet = fluid.is_wet(wet.temperature, wet.mass / wet.volume)
    most = float(jnp.max(wet.mass))
    # a tenth of the gas is left in the clearance, and the first gas drawn mixes with it
    assert float(jnp.max(jnp.where(is_wet, wet.mass, 0.0))) < 0.2 * most
    assert not bool(jnp.any(is_wet & (wet.mass > 0.9 * most)))
