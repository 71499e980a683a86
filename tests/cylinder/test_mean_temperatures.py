"""Evaporating and condensing temperatures of blends: of dew points, or mean ones of the exchangers."""

import dataclasses as dc

import CoolProp
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, load
from jaxcomp.cylinder import SuctionLine
from jaxcomp.fluid import Mixture, PerfectGas, RealGas
from jaxcomp.scene import SceneError, dump, loads, with_values
from jaxcomp.scene.follows import follows
from jaxcomp.scene.readings import read_readings
from jaxcomp.study.rating import at_rating

ZERO = 273.15
EVAPORATING = ZERO - 10
CONDENSING = ZERO + 45


def boiling_liquid(fluid, dew_temperature):
    """[J/kg] before an expansion, without subcooling."""
    saturated = fluid.saturation(T=dew_temperature)
    return fluid.liquid(saturated.T_bubble, saturated.p).h


@pytest.mark.parametrize("fluid", [Mixture(name="R455A"), RealGas("R407C")], ids=["R455A", "R407C"])
def test_the_mean_of_a_condenser_is_that_of_dew_and_bubble_point(fluid):
    dew = fluid.dew_of_mean(CONDENSING)
    mean = (dew + fluid.bubble_of_dew(dew)) / 2
    np.testing.assert_allclose(mean, CONDENSING, rtol=1e-12)


def test_a_pure_fluid_has_one_temperature():
    fluid = RealGas("R290")
    assert float(fluid.dew_of_mean(CONDENSING)) == CONDENSING
    assert float(fluid.dew_of_evaporator(EVAPORATING, 250e3)) == EVAPORATING


@pytest.mark.parametrize("share", [0.15, 0.3, 0.45])
def test_behind_the_valve_is_the_two_phase_state_of_coolprop(share):
    """R454C, of which CoolProp's enthalpies are right: its components have T_c for T_r."""
    fluid = Mixture(name="R454C")
    p = 3e5
    state = CoolProp.AbstractState("HEOS", "R32&R1234yf")
    state.set_mass_fractions([float(w) for w in fluid.mass_fractions])
    state.update(CoolProp.PQ_INPUTS, p, 1.0)
    dew_temperature = state.T()
    vapour = state.hmass()
    state.update(CoolProp.PQ_INPUTS, p, share)
    own = fluid.state(dew_temperature, fluid.saturation(p=p).vapour).h
    mean = (state.T() + dew_temperature) / 2
    dew = fluid.dew_of_evaporator(mean, own + state.hmass() - vapour)
    # CoolProp's two-phase states of mixtures are converged to about 1e-7 of the temperature
    np.testing.assert_allclose(dew, dew_temperature, rtol=1e-7)


@pytest.mark.slow  # 26 s: a program with two calls of the host, and six points without
def test_derivatives_of_the_evaporator_are_those_of_points_solved_anew():
    fluid = Mixture(name="R454C")
    h = float(boiling_liquid(fluid, CONDENSING))

    def dew(T, h, share):
        moved = fluid.with_fractions("mass_fractions", {"R32": share})
        return moved.dew_of_evaporator(T, h)

    at = (EVAPORATING, h, 0.25)
    slopes = jax.jit(jax.grad(dew, (0, 1, 2)))(*at)
    for place, step in enumerate((0.1, 100.0, 1e-3)):
        rows = [dew(*np.add(at, step * n * np.eye(3)[place])) for n in (-1, 1)]
        difference = (rows[1] - rows[0]) / (2 * step)
        # of differences of second order
        np.testing.assert_allclose(slopes[place], difference, rtol=1e-4)


def machine_of(**changes):
    fluid = {"type": "mixture", "name": "R448A"}
    values = {"gas.fluid": fluid, "gas.suction.evaporating": "-10 degC"}
    values |= {"gas.discharge.condensing": "45 degC", "gas.suction.temperature": None}
    values |= {"gas.suction.superheat": "10 K", "gas.discharge.liquid_temperature": None}
    values |= {"gas.discharge.subcooling": "4 K", "gas.suction.heating": None}
    return with_values(load("r290-6cc"), values | changes)


@pytest.mark.slow  # 35 s: the states of a blend are compiled one by one
def test_a_machine_file_has_mean_temperatures():
    scene = machine_of(**{"gas.reference": "mean"})
    assert loads(dump(scene)).machine.compressor.gas.reference == "mean"
    gas = scene.as_compressor().gas
    fluid = gas.fluid
    assert gas.reference == "dew"
    suction = gas.suction.state(fluid)
    dew = float(gas.suction.evaporating)
    np.testing.assert_allclose(suction.p, fluid.dew_pressure(dew), rtol=1e-9)
    # half of what is left of the glide of 6 K behind the valve, and of 4.9 K in the condenser
    np.testing.assert_allclose(dew - EVAPORATING, 2.2, atol=0.1)
    np.testing.assert_allclose(gas.discharge.condensing - CONDENSING, 2.44, atol=0.01)
    np.testing.assert_allclose(suction.T, dew + 10, rtol=1e-12)
    bubble = fluid.bubble_of_dew(gas.discharge.condensing)
    liquid = fluid.liquid(bubble - 4.0, fluid.dew_pressure(gas.discharge.condensing))
    np.testing.assert_allclose(gas.discharge.liquid_enthalpy(fluid), liquid.h, rtol=1e-9)
    names = [name for name, *_ in follows(scene)]
    assert "Glide at suction pressure" in names


def test_the_mean_moves_with_the_subcooling():
    """Colder liquid leaves less vapour behind the valve, whose temperature is then lower."""
    dews = [
        float(machine_of(**{"gas.reference": "mean", "gas.discharge.subcooling": text})
              .as_compressor().gas.suction.evaporating)
        for text in ("0 K", "10 K")
    ]  # fmt: skip
    assert dews[1] - dews[0] > 0.1


def test_a_rating_point_by_mean_temperatures_is_one_by_its_dew_temperatures():
    scene = machine_of()
    mean = at_rating(scene, EVAPORATING, CONDENSING, "en12900-superheat", "mean").gas
    lines = mean.by_dew_points()
    evaporating, condensing = lines.suction.evaporating, lines.discharge.condensing
    dew = at_rating(scene, evaporating, condensing, "en12900-superheat").gas
    assert float(mean.behind_piston) == float(dew.behind_piston)


def test_mean_temperatures_of_a_machine_that_has_none_are_refused():
    gas = machine_of().machine.compressor.gas
    perfect = PerfectGas(gas_constant=287.0, kappa=1.4)
    suction = SuctionLine(pressure=1e5, temperature=300.0)
    discharge = dc.replace(gas.discharge, condensing=None, pressure=5e5, subcooling=None)
    with pytest.raises(BadInput, match="reference"):
        dc.replace(gas, fluid=perfect, suction=suction, discharge=discharge, reference="mean")
    pressures = dc.replace(gas.suction, evaporating=None, pressure=3e5)
    discharge = dc.replace(gas.discharge, condensing=None, pressure=1.8e6)
    with pytest.raises(BadInput, match="reference"):
        dc.replace(gas, suction=pressures, discharge=discharge, reference="mean")
    with pytest.raises(BadInput, match='type = "mixture", name = "R407C"'):
        dc.replace(gas, fluid=RealGas("R407C"), reference="mean")
    with pytest.raises(SceneError, match="reference"):
        machine_of(**{"gas.reference": "middle"})


def test_readings_by_mean_temperatures(tmp_path):
    path = tmp_path / "map.csv"
    path.write_text(
        "# fluid = R448A\n# reference = mean\n"
        "evaporating [degC],condensing [degC],superheat [K],subcooling [K],capacity [W]\n"
        "-10,45,10,2,500\n-25,35,10,2,300\n"
    )
    readings = read_readings(path)
    scene = machine_of()
    found = readings.for_machine(scene.machine)
    assert found.names == ["-10/45 C", "-25/35 C"]
    gas = at_rating(scene, EVAPORATING, CONDENSING, "en12900-superheat", "mean").gas
    cold = dc.replace(gas, discharge=dc.replace(gas.discharge, subcooling=2.0)).by_dew_points()
    np.testing.assert_allclose(found.evaporating[0], cold.suction.evaporating, rtol=1e-9)
    np.testing.assert_allclose(found.condensing[0], cold.discharge.condensing, rtol=1e-12)
    np.testing.assert_allclose(found.gas, found.evaporating + 10, rtol=1e-12)
    np.testing.assert_allclose(found.useful, found.evaporating + 10, rtol=1e-12)
    bubble = np.asarray(cold.fluid.bubble_of_dew(found.condensing))
    np.testing.assert_allclose(found.liquid_of(cold.fluid), bubble - 2, rtol=1e-10)
    text = path.read_text().replace("= mean", "= middle")
    path.write_text(text)
    with pytest.raises(SceneError, match='"dew" or "mean"'):
        read_readings(path)


def test_the_program_of_a_machine_works_the_mean_out_as_well():
    """Where a study moves the evaporating temperature, beside a program."""
    gas = machine_of(**{"gas.reference": "mean"}).machine.compressor.gas

    @jax.jit
    def dew(T):
        moved = dc.replace(gas, suction=dc.replace(gas.suction, evaporating=T))
        return moved.by_dew_points().suction.evaporating

    known = dc.replace(gas, suction=dc.replace(gas.suction, evaporating=jnp.asarray(260.0)))
    np.testing.assert_allclose(dew(260.0), known.by_dew_points().suction.evaporating, rtol=1e-12)
