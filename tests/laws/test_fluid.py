"""Fluids against CoolProp: stored values in the ordinary run, CoolProp itself where it is installed.

The stored values are CoolProp 8.0.0's, whose equations of state are those of the data files.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from laws import helmholtz_before
from tools.fluid_data import FLUIDS

from jaxcomp.fluid import GasState, PerfectGas, RealGas, fluids
from jaxcomp.fluid._helmholtz import fluid_data

# name, T [K], rho [kg/m^3], p [Pa], u [J/kg], s, c_v, c_p [J/(kg K)], w [m/s]
STATES = """
R134a 300 5 119337.9694 401908.4117 1891.743765 764.8921668 857.3089022 161.5704047
R134a 360 60 1466856.681 438634.4559 1816.534563 917.2105218 1112.548429 155.1936057
R600a 300 1.6 67489.63482 560207.105 2581.876248 1535.636292 1690.02354 213.5727744
R600a 370 20 919583.1799 664595.8805 2553.887536 1910.220765 2173.460643 211.2828281
R290 280 8 388324.0133 541650.2018 2462.010981 1438.511094 1708.818427 229.4286204
R290 350 35 1832503.64 628452.7847 2497.911611 1811.707448 2310.66027 224.7118226
R744 280 70 2914026.179 411691.354 1951.631035 770.9104432 1311.05557 229.7738538
R744 370 250 12047554.04 433263.9447 1843.731256 866.579671 1812.530645 265.2323619
R22 290 20 509388.8075 391670.4461 1791.671206 578.8359095 726.7896357 170.212227
R22 370 80 2326430.802 428453.7707 1787.720558 689.9083097 926.8865353 175.9410551
R717 270 3 370984.2851 1481360.626 6160.473665 1894.940354 2630.192686 400.2648047
R717 390 8 1437766.437 1678690.165 6313.107427 1890.779714 2545.351857 477.3327217
air 300 1.15 99001.71135 340214.5927 3893.388035 717.965952 1006.337253 347.3174191
air 450 6 776736.8736 448146.7197 3710.566043 734.2335233 1025.213958 425.6391322
nitrogen 300 1.1 97927.98512 222175.5027 6851.878843 743.1591305 1041.301408 353.1559212
nitrogen 450 6 803701.6519 333376.8316 6648.503775 753.0488074 1054.018436 433.6363531
R410A 289.15 33.1 930198.9658 407046.2971 1844.773758 799.39377 1065.049679 176.0893506
R32 300 10 452701.6129 508705.0245 2374.510077 719.2696462 933.9939528 235.3230971
R1234yf 300 10 208793.3002 369502.5082 1720.594533 834.0360869 925.0471357 148.5411591
R407C 300 10 276653.3628 409990.1745 1920.552531 750.5644874 872.7450693 175.229936
""".strip().splitlines()
# name, T [degC], p [Pa], density of the vapour [kg/m^3]
SATURATION = [
    ("R134a", -23.3, 114842.64, 5.9171355),
    ("R134a", 54.4, 1469822.3, 74.852774),
    ("R600a", -23.3, 62938.639, 1.8143154),
    ("R290", 54.4, 1883095.5, 43.062208),
    ("R22", -23.3, 215609.15, None),
    ("R717", 54.4, 2275368.3, None),
    ("R744", 20.0, 5729052.6, None),
]
# name, T, rho, viscosity [Pa s], conductivity [W/(m K)]
TRANSPORT = [
    ("R134a", 300, 5, 1.188606722622981e-05, 0.013545091371222244),
    ("R600a", 370, 20, 9.407450126601077e-06, 0.025588969016682006),
    ("R744", 280, 70, 1.456519633204225e-05, 0.01833374091399393),
    ("R717", 390, 8, 1.3509391637815789e-05, 0.0371494095948058),
    ("R410A", 289.15, 33.1, 1.2807552486990505e-05, 0.013729331735741618),
]


MOST_POINTS = 40


@eqx.filter_jit
def states_of(gas, T, rho):
    """One program, where every operation outside of one is compiled by itself."""
    return gas.state(T, rho)


def state_of(gas, T, rho):
    """States at any number of points, filled up so that a gas has one program."""
    states = states_of(gas, np.resize(T, MOST_POINTS), np.resize(rho, MOST_POINTS))
    return jax.tree.map(lambda x: np.asarray(x)[: np.size(T)].reshape(np.shape(T)), states)


@eqx.filter_jit
def saturated(gas, T):
    """Saturation by temperature and back by pressure, and the states of both phases."""
    by_temperature = gas.saturation(T=T)
    by_pressure = gas.saturation(p=by_temperature.p)
    phases = [gas.state(T, rho) for rho in (by_temperature.liquid, by_temperature.vapour)]
    return by_temperature, by_pressure, *phases


@pytest.mark.parametrize("row", STATES, ids=lambda row: row[:10])
def test_states_agree_with_the_stored_values(row):
    name, *numbers = row.split()
    T, rho, *wanted = map(float, numbers)
    state = state_of(RealGas(name), jnp.asarray(T), jnp.asarray(rho))
    got = [state.p, state.u, state.s, state.c_v, state.c_p, state.speed_of_sound]
    np.testing.assert_allclose(got, wanted, rtol=6e-10)  # ten digits are stored


@pytest.mark.parametrize("row", SATURATION, ids=lambda row: f"{row[0]}-{row[1]}")
def test_saturation_agrees_with_the_stored_values(row):
    name, celsius, pressure, vapour = row
    found, back, liquid, gaseous = saturated(RealGas(name), jnp.asarray(celsius + 273.15))
    np.testing.assert_allclose(found.p, pressure, rtol=6e-8)  # eight digits are stored
    if vapour is not None:
        np.testing.assert_allclose(found.vapour, vapour, rtol=6e-8)
    np.testing.assert_allclose(back.T, celsius + 273.15, rtol=1e-12)
    # one in 1e9 of a latent heat of 150 kJ/kg: rounding of entropies
    assert abs((liquid.h - gaseous.h) - found.T * (liquid.s - gaseous.s)) < 1e-4


@pytest.mark.parametrize("row", TRANSPORT, ids=lambda row: row[0])
def test_transport_is_within_a_hundredth(row):
    name, T, rho, *wanted = row
    got = RealGas(name).transport(jnp.asarray(T, float), jnp.asarray(rho, float))
    np.testing.assert_allclose(got, wanted, rtol=0.01)


def test_every_fluid_names_its_source_and_fits_its_transport():
    assert len(fluids()) == 61
    for name in fluids():
        data = fluid_data(name)
        assert data["source"].count(",") >= 2
        assert "MIT" in data["licence"]
        assert data["transport"]["viscosity_misfit"] < 0.01
        assert data["transport"]["conductivity_misfit"] < 0.013  # ammonia beside its dew line


def test_an_unknown_fluid_is_named():
    with pytest.raises(ValueError, match=r"`name` must be one of .*R134a.* but is \"R999\""):
        RealGas("R999")


@pytest.mark.parametrize("gas", [RealGas("R134a"), PerfectGas(287.0, 1.4)], ids=str)
def test_first_law_and_maxwell_hold(gas):
    """c_v, dp/dT and dp/drho are the derivatives of u and p, and T ds = du - p/rho^2 drho."""
    T, rho = jnp.asarray(330.0), jnp.asarray(12.0)
    state = state_of(gas, T, rho)
    along_T, along_rho = (jax.jit(jax.jacfwd(gas.state, axis))(T, rho) for axis in (0, 1))
    np.testing.assert_allclose(state.c_v, along_T.u, rtol=1e-12)
    np.testing.assert_allclose(state.dp_dT, along_T.p, rtol=1e-12)
    np.testing.assert_allclose(state.dp_drho, along_rho.p, rtol=1e-12)
    np.testing.assert_allclose(T * along_T.s, along_T.u, rtol=1e-12)
    # both sides are differences of larger terms
    np.testing.assert_allclose(T * along_rho.s, along_rho.u - state.p / rho**2, rtol=1e-10)


def test_inversions_and_their_derivatives():
    gas = RealGas("R134a")
    T, p = jnp.asarray(328.15), jnp.asarray(114.8e3)
    inlet = gas.state(T, gas.density(T, p))
    np.testing.assert_allclose([inlet.rho, inlet.h], [4.36432995, 450563.829], rtol=2e-9)
    end = gas.at_entropy(jnp.asarray(1.47e6), inlet.s, inlet)
    np.testing.assert_allclose([end.T, end.h - inlet.h], [415.365795, 73437.90696], rtol=1e-9)
    again = gas.at_enthalpy(end.p, end.h, inlet)
    np.testing.assert_allclose(again.T, end.T, rtol=1e-12)

    @jax.jit
    def density(p):
        return gas.density(T, p)

    step = 300.0
    slope = (density(p + step) - density(p - step)) / (2 * step)
    bend = (density(p + step) - 2 * density(p) + density(p - step)) / step**2
    np.testing.assert_allclose(jax.jit(jax.grad(density))(p), slope, rtol=1e-7)
    np.testing.assert_allclose(
        jax.jit(jax.grad(jax.grad(density)))(p), bend, rtol=1e-3
    )  # of the difference


@pytest.mark.parametrize("name", fluids())
def test_states_agree_with_coolprop(name):
    coolprop = pytest.importorskip("CoolProp.CoolProp")
    gas = RealGas(name)
    rng = np.random.default_rng(1)
    T = rng.uniform(max(gas.data["T_least"], 230.0), min(480.0, gas.data["T_most"]), MOST_POINTS)
    rho = rng.uniform(0.002, 0.2, MOST_POINTS) * gas.data["rho_r"]
    state = state_of(gas, jnp.asarray(T), jnp.asarray(rho))
    other = coolprop.AbstractState("HEOS", FLUIDS[name][0])
    other.specify_phase(coolprop.iphase_gas)  # the metastable gas as well
    wanted = []
    for pair in zip(rho, T, strict=True):
        other.update(coolprop.DmassT_INPUTS, *pair)
        w = other.speed_sound() if other.cpmass() > 0 else np.nan
        wanted.append((other.p(), other.umass(), other.smass(), other.cvmass(), w))
    got = np.stack([state.p, state.u, state.s, state.c_v, state.speed_of_sound], 1)
    wanted = np.array(wanted)
    # 1e-12: rounding of sums that cancel where the metastable gas comes near its limit
    np.testing.assert_allclose(got, np.where(np.isnan(wanted), got, wanted), rtol=1e-12)


def test_pure_fluids_are_to_the_bit_those_of_before_mixtures():
    """The sums over terms got weights for mixtures; beside this file stands a copy without them."""
    T, rho = jnp.array([285.0, 350.0, 420.0]), jnp.array([4.0, 30.0, 90.0])

    def before(data, T, rho):
        R, tau, delta = data["gas_constant"], data["T_r"] / T, rho / data["rho_r"]
        a0, a0_t, a0_tt = helmholtz_before.ideal_terms(data["ideal"], tau, delta)
        ar, ar_d, ar_dd, ar_t, ar_tt, ar_dt = helmholtz_before.residual_terms(
            data["residual"], tau, delta
        )
        return GasState(
            T,
            rho,
            p=rho * R * T * (1 + ar_d),
            u=R * T * (a0_t + ar_t),
            s=R * (a0_t + ar_t - a0 - ar),
            c_v=-R * (a0_tt + ar_tt),
            dp_dT=rho * R * (1 + ar_d - ar_dt),
            dp_drho=R * T * (1 + 2 * ar_d + ar_dd),
        )

    for name in ("R134a", "R600a", "R290", "R744", "R22", "R717", "R32", "R1234yf", "R410A", "air"):
        # the program has the coefficients as constants in both
        frozen = jax.jit(lambda T, rho, name=name: before(fluid_data(name), T, rho))
        for now, then in zip(state_of(RealGas(name), T, rho), frozen(T, rho), strict=True):
            np.testing.assert_array_equal(now, then)
