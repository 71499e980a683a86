"""Dew curves of natural gas, process gas and moist air, and what is wet or beyond a range by them."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp._core.errors import BadInput
from jaxcomp.fluid import Mixture, PerfectGas, RealGas

GOLDEN = json.loads(Path(__file__).with_name("mixture_golden.json").read_text())
SPELT = {"CarbonDioxide": "R744", "n-Propane": "R290", "IsoButane": "R600a", "n-Butane": "R600"}
SPELT |= {"n-Pentane": "R601", "n-Hexane": "hexane"}
MOIST_AIR = {"nitrogen": 0.77, "oxygen": 0.207, "argon": 0.009, "water": 0.014}


@pytest.fixture(scope="module")
def amarillo() -> Mixture:
    row = GOLDEN["Amarillo"]
    names = [SPELT.get(name, name) for name in row["components"]]
    fractions = dict(zip(names, row["mole_fractions"], strict=True))
    return Mixture(mole_fractions=fractions, model="reference equations")


def is_wet(fluid: Mixture, T: float, p: float) -> bool:
    """Of a gas that is sought from thin to dense, be it metastable."""
    rho = jax.jit(lambda T, p: fluid.density(T, p))(T, p)
    return bool(fluid.is_wet(jnp.asarray(T), rho))


def test_a_natural_gas_has_its_retrograde_dew_curve(amarillo):
    """Dew temperatures of an independent program, printed with one digit."""
    pressures = np.array([0.1e6, 1e6, 3e6, 5e6])
    T = amarillo.condensation_temperature(pressures)
    np.testing.assert_allclose(T, [207.8, 232.3, 240.9, 238.8], atol=0.06)
    assert amarillo.knows_dew_points
    assert not amarillo.condenses


def test_a_natural_gas_is_wet_below_its_upper_branch(amarillo):
    assert is_wet(amarillo, 231.5, 1e6)
    assert not is_wet(amarillo, 233.5, 1e6)
    # the same gas is dry at a low pressure, wet at a higher one, and dry again at a still higher one
    at = 239.9
    found = [is_wet(amarillo, at, p) for p in (1e6, 3e6, 5.5e6)]
    assert found == [False, True, False]
    with pytest.raises(BadInput, match="begins to condense"):
        amarillo.density(230.0, 1e6)


def test_moist_air_has_the_dew_point_of_its_water():
    air = Mixture(mole_fractions=MOIST_AIR)
    dew = float(air.condensation_temperature(101325.0))
    water = float(RealGas("water").saturation(p=jnp.asarray(0.014 * 101325.0)).T)
    # GERG's water alone boils at 0.5 % more than that of its own equation, and in air at 0.4 % more yet:
    # 0.08 and 0.07 K
    assert abs(dew - water) < 0.2


def test_water_and_hydrocarbons_have_the_warmer_of_both_curves(amarillo):
    w = np.asarray(amarillo.mass_fractions)
    fractions = dict(zip(amarillo.components, w, strict=True))
    damp = Mixture(mass_fractions=fractions | {"water": 3e-4}, model="reference equations")
    dry = amarillo.condensation_temperature(np.array([1e5, 3e6]))
    found = damp.condensation_temperature(np.array([1e5, 3e6]))
    # water of ten-thousandths is nothing at the lower pressure, and condenses first at the higher
    np.testing.assert_allclose(found[0], dry[0], atol=0.2)
    assert found[1] > dry[1] + 10


def test_the_curve_moves_with_the_composition():
    gas = Mixture(mole_fractions={"methane": 0.9, "ethane": 0.1})

    @jax.jit
    def dew(share):
        moved = gas.with_fractions("mole_fractions", {"methane": share})
        return moved.condensation_temperature(1e6)

    other = Mixture(mole_fractions={"methane": 0.8, "ethane": 0.2})
    expected = float(other.condensation_temperature(1e6))
    np.testing.assert_allclose(float(dew(0.8)), expected, rtol=1e-9)


def test_a_gas_that_never_condenses_is_told():
    gas = Mixture(mole_fractions={"helium": 0.5, "hydrogen": 0.5})
    assert not gas.knows_dew_points
    assert not bool(gas.is_wet(jnp.asarray(100.0), jnp.asarray(10.0)))


def test_far_beyond_a_range_numbers_mean_nothing():
    blend = Mixture(name="R454C")  # R1234yf ends at 410 K
    T = jnp.array([400.0, 480.0, 500.0])
    np.testing.assert_array_equal(blend.is_beyond_range(T, 1e6), [False, False, True])
    highest = blend.highest_pressure
    p = jnp.array([0.9, 1.1, 1.3]) * highest
    np.testing.assert_array_equal(blend.is_beyond_range(400.0, p), [False, False, True])
    assert not bool(PerfectGas(287.0, 1.4).is_beyond_range(jnp.asarray(3000.0), jnp.asarray(1e9)))
