"""Lines keep to the range of their fluid: refused where it is known, a status within a program."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import Status, load
from jaxcomp._core.errors import BadInput
from jaxcomp.cylinder import solve_cycle
from jaxcomp.fluid import RealGas
from jaxcomp.scene import SceneError, with_values
from jaxcomp.study.rating import at_rating, rating_map

HOUSEHOLD = load("r134a-7cc")
# Of propane: critical at 369.89 K, triple point at 85.5 K, gas returns at 305.35 K in this machine.
PROPANE = load("r290-6cc")
LIQUID = "gas.discharge.liquid_temperature"


@pytest.mark.parametrize(
    ("name", "value", "numbers"),
    [
        *(
            (LIQUID, T, "169.85 and <= 328.05")
            for T in ("10 K", "150 K", "370 K", "380 K", "600 K")
        ),
        ("gas.suction.temperature", "600 K", "169.85 and <= 432.2"),
        ("gas.suction.temperature", "240 K", "249.3"),
        ("gas.discharge.pressure", "1 bar", "114800"),
        ("gas.discharge.temperature", "300 K", "327.05"),
    ],
)
def test_a_line_beyond_its_fluid_is_refused_with_the_numbers(name, value, numbers):
    with pytest.raises(SceneError, match=f"{name} = .*{numbers}"):
        with_values(HOUSEHOLD, {name: value})


@pytest.mark.parametrize(
    ("evaporating", "condensing", "numbers"),
    [
        (250.0, 400.0, r"condensing.* > 250 and < 369\.89"),
        (310.0, 300.0, "condensing.* > 310"),
        (50.0, 300.0, r"evaporating.* >= 85\.525"),
        (340.0, 350.0, "suction.temperature.* 339.5"),
    ],
)
def test_rating_points_keep_their_order(evaporating, condensing, numbers):
    with pytest.raises(BadInput, match=numbers):
        at_rating(PROPANE, evaporating, condensing)
    with pytest.raises(BadInput, match=numbers):  # as the one bad point of several
        rating_map(PROPANE, [evaporating, 250.0], [condensing, 320.0])


def test_a_negative_superheat_is_refused():
    with pytest.raises(SceneError, match=r"superheat.* >= 0"):
        with_values(PROPANE, {"gas.suction.temperature": None, "gas.suction.superheat": "-3 K"})


def test_within_a_program_a_line_beyond_its_fluid_has_a_status():
    compressor = HOUSEHOLD.compressor
    # without inertia of the gas in its ports the machine is marched, which is a third of the program
    lengths = lambda gas: [valve.port_length for valve in gas.valves]  # noqa: E731
    marched = eqx.tree_at(lengths, compressor.gas, [None, None])

    @jax.jit
    @jax.vmap
    def solved(liquid):
        cylinder = eqx.tree_at(lambda c: c.discharge.liquid_temperature, marched, liquid)
        cycle = solve_cycle(cylinder, compressor.mechanism, 309.0, throw=False)
        return cycle.status, cycle.capacity

    status, capacity = solved(jnp.array([305.35, 400.0, 10.0]))
    assert (status == Status.converged).tolist() == [True, False, False]
    assert (status == Status.bad_input).tolist() == [False, True, True]
    assert np.all(np.isfinite(capacity))


def test_there_is_no_liquid_above_the_critical_point():
    line = load("r134a-7cc").compressor.gas.discharge
    beyond = eqx.tree_at(lambda one: one.liquid_temperature, line, jnp.asarray(380.0))
    assert np.isnan(beyond.liquid_enthalpy(RealGas("R134a")))


@pytest.mark.parametrize("name", ["R134a", "R290", "R410A", "R717", "R1234yf"])
def test_the_dew_curve_is_that_of_saturation(name):
    fluid = RealGas(name)
    T = 0.8 * fluid.critical_temperature
    # 0.1 K is what the ancillary curves are stated to
    assert fluid.dew_temperature(float(fluid.saturation(T=T).p)) == pytest.approx(T, abs=0.1)
    assert fluid.dew_temperature(fluid.dew_pressure(T)) == pytest.approx(T, rel=1e-12)


def test_a_fluid_states_its_range():
    gas = RealGas("R134a")
    for call, words in (
        (lambda: gas.density(250.0, 5e5), r"`p` must be .* at 250 K, for gas of R134a"),
        (lambda: gas.density(100.0, 1e4), r"`T` must be >= 169\.85 and <= 455 K"),
        (lambda: gas.saturation(T=380.0), r"`T` must be >= 169\.85 and < 374\.21 K"),
        (lambda: gas.saturation(p=5e6), r"`p` must be .* < 4.05\d+e\+06 Pa"),
    ):
        with pytest.raises(BadInput, match=words):
            call()
    # gas above the critical temperature has no dew pressure
    assert RealGas("R744").density(320.0, 9e6) == pytest.approx(312, rel=0.1)


def test_a_port_wider_than_the_bore_is_refused():
    with pytest.raises(SceneError, match=r"port_diameter.* < 0\.022 m, the bore"):
        with_values(HOUSEHOLD, {"gas.discharge_valve.port_diameter": "23 mm"})


@pytest.mark.parametrize("machine", [HOUSEHOLD, PROPANE], ids=lambda one: one.name)
def test_rules_of_known_lines_may_be_asked_within_a_program(machine):
    gas = machine.as_compressor().gas

    @jax.jit
    def kept(x):  # the gas is known, but sums of its numbers are symbols in here
        return x, jnp.all(jnp.stack([jnp.asarray(one) for one in gas.conditions().values()]))

    assert bool(kept(1.0)[1])
