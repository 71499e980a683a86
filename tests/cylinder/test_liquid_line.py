"""The liquid behind the condenser: from its bubble point, at the condenser's pressure.

Stored values are those of CoolProp 8.0.0, whose equations of state are those of the data files.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load
from jaxcomp._core.errors import BadInput
from jaxcomp.cylinder import DischargeLine
from jaxcomp.fluid import RealGas
from jaxcomp.scene import with_values
from jaxcomp.scene.map_formats import _states
from jaxcomp.study import Readings
from jaxcomp.study.rating import Rating, at_rating, capacity_rise

# name, T [K] of the liquid, h [J/kg] of the gas (10 K superheat at -10 degC) less that of the liquid
# at a condensing dew temperature of 45 degC: boiling, and 5 K below.
RISES = [
    ("R407C", 313.2584715257567, 152723.47874056696),
    ("R410A", 318.031583143675, 152503.55915965926),
    ("R134a", 318.15, 137237.85534940095),
]
EVAPORATING, CONDENSING, USEFUL = 263.15, 318.15, 273.15


def rise(name: str, liquid: float) -> float:
    columns = (EVAPORATING, CONDENSING, USEFUL, liquid)
    return float(capacity_rise(RealGas(name), *map(jnp.asarray, columns)))


@pytest.mark.parametrize(("name", "boiling", "wanted"), RISES, ids=[row[0] for row in RISES])
def test_liquid_without_subcooling_is_at_its_bubble_point(name, boiling, wanted):
    fluid = RealGas(name)
    # Newton's method in double precision on either side
    np.testing.assert_allclose(fluid.bubble_of_dew(jnp.asarray(CONDENSING)), boiling, rtol=1e-12)
    np.testing.assert_allclose(rise(name, boiling), wanted, rtol=1e-9)
    by_temperature = DischargeLine(condensing=CONDENSING).liquid_enthalpy(fluid)
    pressure = fluid.saturation(T=jnp.asarray(CONDENSING)).p
    by_pressure = DischargeLine(pressure=pressure).liquid_enthalpy(fluid)
    np.testing.assert_allclose(by_temperature, by_pressure, rtol=1e-11)
    # what users see without a program, by straight lines between 400 points of the curve
    np.testing.assert_allclose(fluid.bubble_temperature(float(pressure)), boiling, atol=2e-3)


def test_r407c_has_the_capacity_of_its_mixture():
    """152.81 kJ/kg by its three components; the pseudo-pure fluid is that within 0.06 %."""
    np.testing.assert_allclose(rise("R407C", RISES[0][1]), 152813.214, rtol=1e-3)


# name, h [J/kg] of boiling liquid less that of liquid 20 K colder at the same pressure, and less that of
# liquid that boils at this colder temperature
DROPS = [
    ("R407C", 31294.39286210391, 31241.8623842207),
    ("R134a", 29379.21452264447, 29397.149849593232),
]


@pytest.mark.parametrize(("name", "compressed", "saturated"), DROPS, ids=[row[0] for row in DROPS])
def test_a_subcooled_liquid_is_compressed(name, compressed, saturated):
    fluid = RealGas(name)
    cold = DischargeLine(condensing=CONDENSING, subcooling=20.0).liquid_enthalpy(fluid)
    drop = float(DischargeLine(condensing=CONDENSING).liquid_enthalpy(fluid) - cold)
    # of differences of enthalpies ten times as large
    np.testing.assert_allclose(drop, compressed, rtol=1e-9)
    assert abs(drop - saturated) > 15.0


def points(**columns) -> Readings:
    """A point of a map at which 0.1 kg/s flow."""
    none, gas = np.full(1, np.nan), np.array([USEFUL])
    dew = np.array([EVAPORATING]), np.array([CONDENSING])
    liquid = columns.pop("liquid", np.array([CONDENSING]))
    return Readings("map", *dew, gas, liquid, gas, none, columns.pop("measured"), **columns)


def test_readings_count_subcooling_from_the_bubble_point():
    fluid, (_, boiling, wanted) = RealGas("R407C"), RISES[0]
    measured = {"capacity": np.array([0.1 * wanted]), "mass_flow": np.array([0.1])}
    zero = points(measured=measured, by_subcooling=True)
    np.testing.assert_allclose(zero.liquid_of(fluid), boiling, rtol=1e-12)
    # of an entry that contradicts its flow by 3 % this was one, by 5 %
    zero.check_points(fluid)
    points(measured=measured, liquid=np.array([boiling])).check_points(fluid)
    with pytest.raises(BadInput, match=r"40\.11 C, the bubble temperature"):
        points(measured=measured).check_points(fluid)
    # without glide both are the same
    np.testing.assert_array_equal(zero.liquid_of(RealGas("R134a")), zero.condensing)


def test_files_of_tespy_count_subcooling_from_the_bubble_point():
    at = np.array([EVAPORATING]), np.array([CONDENSING])
    settings = {"superheat": "10 K", "subcooling": "0 K"}
    _, _, worth = _states(settings, RealGas("R407C"), *at)
    np.testing.assert_allclose(worth, RISES[0][2], rtol=1e-9)


def test_a_line_of_two_phases_is_refused():
    """Half a kelvin is room for pressures in few digits; 45 C is 4.9 K above the bubble point."""
    machine = with_values(load("mayekawa-wbhe-r22"), {"gas.fluid.name": "R407C"})
    rating = Rating(None, 10.0, CONDENSING, None)
    with pytest.raises(BadInput, match=r"liquid_temperature.* <= 313\.7"):
        at_rating(machine, EVAPORATING, CONDENSING, rating)
    at_rating(machine, EVAPORATING, CONDENSING, rating._replace(liquid=313.2))


@pytest.mark.parametrize("name", ["R407C", "R134a"])
def test_derivatives_of_the_liquid_agree_with_differences(name):
    fluid = RealGas(name)

    # one program for values and slopes
    @jax.jit
    @jax.value_and_grad
    def enthalpy(condensing):
        return DischargeLine(condensing=condensing, subcooling=3.0).liquid_enthalpy(fluid)

    step = 0.01
    below, at, above = (enthalpy(CONDENSING + change) for change in (-step, 0.0, step))
    difference = (above[0] - below[0]) / (2 * step)
    # the difference errs by step^2 h'''/6, and by rounding of 1e5 J/kg over the step
    np.testing.assert_allclose(at[1], difference, rtol=1e-6)
