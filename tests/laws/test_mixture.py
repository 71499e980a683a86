"""Mixtures: stored values of an independent program, NIST's printed point, derivatives, limits.

`mixture_golden.json` was made by a program in NumPy with complex steps, which agrees with CoolProp 8.0.0
in pressures and speeds of sound to 1e-12. CoolProp itself takes the critical temperature of R134a, R600a
and R1234ze(E) for the reducing one in the ideal part of mixtures: no measure for these.
"""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import pick

from jaxcomp._core.errors import BadInput
from jaxcomp.fluid import Mixture, RealGas, fluids
from jaxcomp.fluid._blends import blends, usable_blends
from jaxcomp.fluid._multi_fluid import GERG, REFERENCE, multi_fluid
from jaxcomp.fluid._saturation_lines import (
    DEW_PRESSURE,
    SaturationLines,
    curve,
    solve_lines,
)
from jaxcomp.fluid.real_gas import fluid_named

GOLDEN = json.loads(Path(__file__).with_name("mixture_golden.json").read_text())
BLENDS = [name for name, row in GOLDEN.items() if row["saturation"]]
# "CarbonDioxide" and others are spelt as in analyses of gas
SPELT = {"CarbonDioxide": "R744", "n-Propane": "R290", "IsoButane": "R600a", "n-Butane": "R600"}
SPELT |= {"n-Pentane": "R601", "n-Hexane": "hexane"}
# [K], [kg/m^3] from which the file counts enthalpies and entropies
AT = 300.0, 1.0


@pytest.fixture(scope="module")
def mixtures() -> dict[str, Mixture]:
    return {name: mixture(name) for name in GOLDEN}


def mixture(name: str) -> Mixture:
    row = GOLDEN[name]
    components = [SPELT.get(one, one) for one in row["components"]]
    fractions = dict(zip(components, row["mole_fractions"], strict=True))
    model = GERG if name == "NIST21" else REFERENCE
    known = blends().get(name)
    if known and known.quality in "AB" and name != "R32/R125":
        return Mixture(name=name)
    return Mixture(mole_fractions=fractions, model=model)


@eqx.filter_jit
def states(fluid, T, rho):
    return fluid.state(T, rho)


@eqx.filter_jit
def states_and_slopes(fluid, T, rho):
    """States, and slopes of p, h and s as the first component goes up by mass.

    The others go down in proportion, at constant T and rho. One program gives both.
    """
    w = fluid.mass_fractions
    direction = jnp.concatenate([jnp.ones(1), -w[1:] / (1 - w[0])])

    def state_of(w):
        state = eqx.tree_at(lambda fluid: fluid.mass_fractions, fluid, w).state(T, rho)
        return (state.p, state.h, state.s), state

    _, slopes, state = jax.jvp(state_of, (w,), (direction,), has_aux=True)
    return state, slopes


@eqx.filter_jit
def compressed_to(fluid, T, p, p_2, T_liquid=None):
    """States before and behind an isentropic compression, and of liquid at the higher pressure."""
    start = fluid.state(T, fluid.density(T, p))
    end = fluid.at_entropy(p_2, start.s, start)
    liquid = None if T_liquid is None else fluid.liquid(T_liquid, p_2)
    return start, end, liquid


def beside_reference(T, rho):
    """Temperatures and densities with those behind them from which enthalpies are counted."""
    return jnp.asarray(np.append(T, AT[0])), jnp.asarray(np.append(rho, AT[1]))


def columns(name: str, *keys: str) -> list[np.ndarray]:
    return [np.array([row[key] for row in GOLDEN[name]["states"]]) for key in keys]


@pytest.mark.parametrize("name", GOLDEN)
def test_states_agree_with_the_stored_values(mixtures, name):
    fluid = mixtures[name]
    T, rho, p, dh, du, ds = columns(name, "T", "rho", "p", "dh", "du", "ds")
    everywhere, _ = states_and_slopes(fluid, *beside_reference(T, rho))
    everywhere = jax.tree.map(np.asarray, everywhere)
    zero = pick(everywhere, -1)
    state = pick(everywhere, slice(-1))
    # a liquid's pressure is a difference of terms a thousand times as large
    liquid = np.array([row["kind"] == "liquid" for row in GOLDEN[name]["states"]])
    np.testing.assert_array_less(np.abs(state.p / p - 1), np.where(liquid, 1e-9, 1e-10))
    np.testing.assert_allclose(state.h - zero.h, dh, atol=1e-10 * 1e5, rtol=1e-10)
    np.testing.assert_allclose(state.u - zero.u, du, atol=1e-10 * 1e5, rtol=1e-10)
    np.testing.assert_allclose(state.s - zero.s, ds, atol=1e-10 * 300, rtol=1e-10)
    wanted = columns(name, "cv", "cp", "w", "dp_drho", "dp_dT")
    got = [state.c_v, state.c_p, state.speed_of_sound, state.dp_drho, state.dp_dT]
    np.testing.assert_allclose(got, wanted, rtol=1e-10)


@pytest.mark.parametrize("name", GOLDEN)
def test_derivatives_to_the_composition_agree_with_complex_steps(mixtures, name):
    """The first component up by mass, the others down in proportion, at constant T and rho."""
    T, rho = columns(name, "T", "rho")
    _, slopes = states_and_slopes(mixtures[name], *beside_reference(T, rho))
    dp, dh, ds = map(np.asarray, slopes)
    slopes = dp[:-1], dh[:-1] - dh[-1], ds[:-1] - ds[-1]
    for slope, key in zip(slopes, ("dp_dw", "dh_dw", "ds_dw"), strict=True):
        (wanted,) = columns(name, key)
        # derivatives change sign along a column
        np.testing.assert_allclose(slope, wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max())


def test_gerg_2008_has_the_point_that_nist_prints(mixtures):
    """AGA8's test program: 21 components at 400 K and 50 MPa."""
    fluid = mixtures["NIST21"]
    mass = float(fluid.molar_mass)
    np.testing.assert_allclose(mass, 20.5427445016e-3, rtol=1e-12)
    at = jnp.asarray(400.0), jnp.asarray(12.79828626082062e3 * mass)
    state = states(fluid, *at)
    got = [
        state.p,
        state.u * mass,
        state.h * mass,
        state.s * mass,
        state.c_v * mass,
        state.c_p * mass,
    ]
    got += [state.speed_of_sound, state.kappa, state.dp_dT, state.dp_drho * mass]
    wanted = [50e6, -2746.492901212530, 1160.280160510973, -38.57590392409089, 39.02948218156372]
    wanted += [58.45522051000366, 714.4248840596024, 2.683820255058032, 235983.2292593096]
    wanted += [7000.694030193327]
    np.testing.assert_allclose(got, wanted, rtol=1e-12)
    np.testing.assert_allclose(fluid.density(400.0, 50e6), at[1], rtol=1e-12)


@pytest.mark.parametrize("name", BLENDS)
def test_lines_agree_with_the_stored_values(mixtures, name):
    fluid = mixtures[name]
    rows = GOLDEN[name]["saturation"]
    T, dew, bubble, vapour, liquid, boiling = (
        np.array([row[key] for row in rows])
        for key in ("T", "dew", "bubble", "rho_vapour", "rho_liquid", "T_bubble_at_dew_pressure")
    )
    np.testing.assert_allclose(fluid.dew_pressure(T), dew, rtol=1e-8)
    np.testing.assert_allclose(fluid.bubble_pressure(T), bubble, rtol=1e-8)
    np.testing.assert_allclose(fluid.dew_temperature(dew), T, rtol=1e-9)
    np.testing.assert_allclose(fluid.bubble_of_dew(T), boiling, rtol=1e-9)
    # one program for all mixtures of as many components
    saturation = jax.vmap(lambda T: fluid.saturation(T=T))(jnp.asarray(T))
    np.testing.assert_allclose(saturation.vapour, vapour, rtol=1e-8)
    np.testing.assert_allclose(saturation.liquid, liquid, rtol=1e-8)


def test_slopes_of_stored_lines_are_those_of_solved_ones():
    """With eight digits, as they once were stored, the slope of a dew pressure was off by 4e-8."""
    stored = Mixture(name="R454B")
    w = np.asarray(stored.mass_fractions)
    lines = solve_lines(stored.components or (), w, REFERENCE)
    assert lines is not None
    assert stored.lines is not None
    exchange = np.array([1.0, -1.0])
    for T in (243.15, 263.15, 318.15):
        slopes = []
        for solution in (stored.lines, lines):
            series = np.tensordot(exchange, np.asarray(solution.slopes), 1)[:, DEW_PRESSURE]
            value, _ = curve(series, np.asarray(solution.ends), np.asarray(T), np)
            slopes.append(float(value))
        np.testing.assert_allclose(*slopes, rtol=3e-9)


@pytest.mark.parametrize("name", GOLDEN)
def test_compression_agrees_with_the_stored_values(mixtures, name):
    fluid = mixtures[name]
    for row in GOLDEN[name]["compression"]:
        keys = [key for key in ("T1", "p1", "p2", "T_bubble") if key in row]
        start, end, liquid = compressed_to(fluid, *(jnp.asarray(row[key]) for key in keys))
        got = [start.rho, start.kappa, start.speed_of_sound, end.T, end.rho, end.h - start.h]
        wanted = [row[key] for key in ("rho1", "kappa1", "w1", "T2", "rho2", "work")]
        np.testing.assert_allclose(got, wanted, rtol=1e-8)
        if "capacity" in row:
            np.testing.assert_allclose(start.h - liquid.h, row["capacity"], rtol=1e-8)


@pytest.mark.parametrize("name", BLENDS)
def test_wet_gas_is_told_by_its_density(mixtures, name):
    fluid = mixtures[name]
    for row in GOLDEN[name]["states"]:
        if row["kind"] in ("wet", "trap"):
            assert bool(fluid.is_wet(jnp.asarray(row["T"]), jnp.asarray(row["rho"])))
        dry = 0.999 * float(fluid.saturation(T=jnp.asarray(263.15)).vapour)
        assert not bool(fluid.is_wet(jnp.asarray(263.15), jnp.asarray(dry)))


@pytest.mark.parametrize(("name", "is_wet"), [("R513A", True), ("R454C", False)])
def test_heat_lost_on_the_way_makes_gas_wet_whose_isentropes_run_along_the_dew_line(name, is_wet):
    """From saturated gas of 0 degC to the dew pressure of 45 degC, less 8 J/(kg K) by a cold wall.

    The entropy of saturated R513A hardly changes between, that of R454C falls by 20 J/(kg K).
    """
    fluid = Mixture(name=name)

    @eqx.filter_jit
    def compressed(fluid, loss):
        start = fluid.state(273.15, fluid.saturation(T=jnp.asarray(273.15)).vapour)
        end = fluid.at_entropy(fluid.dew_pressure(318.15), start.s - loss, start)
        return fluid.is_wet(start.T, start.rho), fluid.is_wet(end.T, end.rho)

    assert compressed(fluid, jnp.asarray(8.0)) == (False, is_wet)
    assert compressed(fluid, jnp.asarray(0.0)) == (False, False)


@pytest.mark.parametrize("name", ["R407C", "R410A"])
def test_a_mixture_is_its_pseudo_pure_fluid(name):
    """They were fitted to the same data: dew pressures to 0.02 %, the work of compression to 0.05 %."""
    mixed, pure = Mixture(name=name), RealGas(name)

    @eqx.filter_jit
    def compressed(fluid):
        low, high = (fluid.saturation(T=jnp.asarray(T)).p for T in (263.15, 318.15))
        start = fluid.state(jnp.asarray(273.15), fluid.density(jnp.asarray(273.15), low))
        return low, high, fluid.at_entropy(high, start.s, start).h - start.h

    first, second = (np.array(compressed(fluid)) for fluid in (mixed, pure))
    np.testing.assert_allclose(first[:2], second[:2], rtol=2e-4)
    np.testing.assert_allclose(first[2], second[2], rtol=5e-4)


def test_nearly_pure_is_pure():
    """1e-5: a mixture has today's gas constant, the equation of the component that of its paper."""
    pure = RealGas("R32")
    mixed = Mixture(mass_fractions={"R32": 1.0, "R1234yf": 0.0})
    T, rho = jnp.array([280.0, 400.0]), jnp.array([5.0, 60.0])
    np.testing.assert_allclose(states(mixed, T, rho).p, states(pure, T, rho).p, rtol=1e-5)
    slope = jax.jit(
        jax.grad(lambda w: eqx.tree_at(lambda f: f.mass_fractions, mixed, w).state(T[0], rho[0]).s)
    )(mixed.mass_fractions)
    assert np.isfinite(slope[0])


def test_lines_move_with_the_composition_as_solved_anew():
    """Central differences of lines that were solved at compositions 1e-4 of a mass fraction away."""
    fluid, step = Mixture(name="R454C"), 1e-4
    p = fluid.dew_pressure(280.0)

    def of(w):
        moved = eqx.tree_at(lambda fluid: fluid.mass_fractions, fluid, w)
        found = moved.saturation(T=jnp.asarray(280.0))
        return jnp.log(
            jnp.stack([found.p, found.vapour, found.liquid, moved.bubble_temperature(p)])
        )

    w = fluid.mass_fractions
    direction = jnp.array([1.0, -1.0])
    _, slopes = jax.jvp(jax.jit(of), (w,), (direction,))

    def solved(change):
        composition = dict(
            zip(fluid.components, np.asarray(w) + change * np.array([1, -1]), strict=True)
        )
        other = Mixture(mass_fractions=composition)
        found = other.saturation(T=jnp.asarray(280.0))
        return np.log([found.p, found.vapour, found.liquid, other.bubble_temperature(p)])

    difference = (solved(step) - solved(-step)) / (2 * step)
    np.testing.assert_allclose(slopes, difference, rtol=1e-6)


def test_lines_that_came_with_the_library_are_those_that_are_solved():
    stored = Mixture(name="R454B")
    fractions = {"R1234yf": 0.311, "R32": 0.689 * (1 + 1e-8)}
    solved = Mixture(mass_fractions=fractions)
    T = np.linspace(215.0, 340.0, 6)
    np.testing.assert_allclose(solved.dew_pressure(T), stored.dew_pressure(T), rtol=1e-7)
    assert isinstance(stored.lines, SaturationLines)
    # the other order of the components is the same blend
    swapped = Mixture(mass_fractions={"R1234yf": 0.311, "R32": 0.689})
    np.testing.assert_array_equal(swapped.lines.coefficients, stored.lines.coefficients)
    np.testing.assert_array_equal(swapped.lines.slopes, stored.lines.slopes[::-1])


def test_another_composition_of_the_same_components_is_the_same_program():
    count = []

    @eqx.filter_jit
    def pressure(fluid):
        count.append(1)
        return fluid.saturation(T=jnp.asarray(280.0)).p

    for name in ("R454A", "R454C"):
        composition = blends()[name].mass_fractions
        pressure(Mixture(mass_fractions=composition))
    assert len(count) == 1


def test_the_bundle_has_its_fluids_and_blends():
    quality = {blend.name: blend.quality for blend in usable_blends()}
    assert len(fluids()) - 3 >= 53  # but for the pseudo-pure ones
    assert sum(one == "A" for one in quality.values()) == 41
    assert sum(one == "B" for one in quality.values()) >= 35
    for name in ("R448A", "R455A", "R454B", "R513A", "R404A"):
        assert fluid_named(name).condenses
    assert isinstance(fluid_named("R410A"), RealGas)
    assert len(multi_fluid(("methane", "hydrogen"), GERG).molar_mass) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mass_fractions": {"R32": 0.7, "R1234yf": 0.31}}, r"sum 1.*sum to 1\.01"),
        ({"mass_fractions": {"R32": 68.9, "R1234yf": 31.1}}, "sum to 100"),
        ({"mass_fractions": {"R32": -0.1, "R1234yf": 1.1}}, "at least 0"),
        ({"mass_fractions": {"R32": np.nan, "R1234yf": 1.0}}, "at least 0"),
        ({"mass_fractions": {"R32": 1.0}}, "pure R32.*real_gas"),
        ({"mass_fractions": {"R32": 0.5, "R1234yx": 0.5}}, "did you mean R1234yf"),
        ({"mass_fractions": {"R410A": 0.5, "R1234yf": 0.5}}, "R410A is a blend"),
        ({"mass_fractions": {"R717": 0.5, "R718": 0.5}}, "ammonia-water"),
        ({"mass_fractions": {"R22": 0.5, "R124": 0.5}}, "R22/R124.*estimate_pairs"),
        ({"name": "R401A"}, "R22/R124 and R152a/R124"),
        ({"name": "R412A"}, "R143b"),
        ({"name": "R404a"}, "R404A"),
        ({}, "name"),
        ({"mass_fractions": {"R32": 1}, "mole_fractions": {"R32": 1}}, "mass_fractions"),
        ({"mass_fractions": {"R32": 0.5, "R125": 0.5}, "model": GERG}, "GERG-2008 is without R32"),
    ],
)
def test_compositions_that_are_none_are_answered(arguments, words):
    with pytest.raises(BadInput, match=words):
        Mixture(**arguments)


def test_a_pair_may_be_estimated():
    assert Mixture(name="R401A", estimate_pairs=True).condenses
    assert [pair.quality for pair in Mixture(name="R448A").pairs].count("fit") == 1


def test_a_gas_without_a_dew_line_is_told():
    gas = Mixture(mole_fractions={"CH4": 0.91, "H2": 0.09})
    assert gas.model == GERG
    assert not gas.condenses
    with pytest.raises(BadInput, match="known dew line"):
        gas.dew_pressure(250.0)
