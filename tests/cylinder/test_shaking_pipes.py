"""Forces of waves on runs of pipe and vessels: by momentum, by end plates, and on what holds them.

The waves here are those that given flows make in a network; what a solved cycle makes of them stands in
`test_piped_cycles.py`.
"""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_pipes import SPEED, crank, cylinder

from jaxcomp import BadInput, Compressor, solve_orbit
from jaxcomp.compressor import first_top
from jaxcomp.crankshaft import Crankshaft, Throw
from jaxcomp.cylinder import Pulsation, _cylinder
from jaxcomp.cylinder._event_panels import over_panels
from jaxcomp.cylinder._pulsation import values_of
from jaxcomp.cylinder._waves import Observed, waves_at_rest
from jaxcomp.gas import PolytropicCycle
from jaxcomp.motor import ConstantSpeed, MeanSpeed
from jaxcomp.piping import Orifice, Pipes, Piping, Run, Vessel
from jaxcomp.rotor import LoadCase, PipeNode
from jaxcomp.vibration import PipePoint, Suspension, orbit_load
from jaxcomp.vibration._pipe_forces import pipe_loads, run_forces

prepare = eqx.filter_jit(_cylinder.prepare)

ORDERS = 8
VESSEL = 0.2


def network(**changes):
    """A pipe to a vessel of 0.5 m, with a pipe from its side, and another one behind it."""
    chain = (
        Pipes(("flange", "left"), 0.4, 0.05, attenuation=0.0),
        Pipes(("right", "far"), 0.9, 0.04, attenuation=0.0),
        Pipes(("side", "stub"), 0.3, 0.03, attenuation=0.0),
    )
    parts = {
        "orifices": (Orifice(("far", "line"), resistance=9000.0),),
        "runs": (Run(("flange", "left")), Run(("right", "far"))),
        "vessels": (Vessel(("left", "side", "right"), [0.2, 0.3], VESSEL, attenuation=0.0),),
        "orders": ORDERS,
    }
    return Piping(chain, **{**parts, **changes})


def pulsation_of(piping):
    """Pulsation that flows of all orders make."""
    machine = cylinder(piping)
    series = np.random.default_rng(3).normal(size=(1, 2 * ORDERS + 1)) * 1e-3
    flows = Observed(jnp.asarray(series), jnp.zeros(2 * ORDERS + 1))
    case = prepare(machine, crank(), SPEED)
    # they count their time by the crank of `machine_with`
    return Pulsation(waves_at_rest(machine), (flows,), case, jnp.asarray(-np.deg2rad(40.0)))


def test_forces_behind_each_other_are_those_on_all_end_plates():
    pulsation = pulsation_of(network())
    forces = pulsation.shaking_series()
    assert list(forces) == ["flange-left", "right-far", "left-right"]
    pressure = pulsation.series()
    area = {name: np.pi / 4 * d**2 for name, d in (("in", 0.05), ("bottle", VESSEL), ("out", 0.04))}
    # every wall across the axis, with the gas on one side of it
    plates = (
        -area["in"] * pressure["flange"]
        - (area["bottle"] - area["in"]) * pressure["left"]
        + (area["bottle"] - area["out"]) * pressure["right"]
        + area["out"] * pressure["far"]
    )
    np.testing.assert_allclose(sum(forces.values()), plates, rtol=1e-10, atol=1e-12)


def test_force_is_minus_the_rate_of_the_momentum_of_the_gas():
    """The flow along the vessel follows from the pressures along it, by what the gas there stores."""
    pulsation = pulsation_of(network())
    force = np.asarray(pulsation.shaking_series()["left-right"])
    gas = pulsation.lines[0][1].gas(jnp.ones(0))
    area = np.pi / 4 * VESSEL**2
    places = np.linspace(0.0, 0.3, 301)
    at_places = jax.vmap(lambda x: pulsation.series_in_pipe("side", "right", x))
    along = np.asarray(at_places(jnp.asarray(places)))
    amplitudes = along[:, 1 : 1 + ORDERS] - 1j * along[:, 1 + ORDERS :]
    frequency = SPEED * np.arange(1, ORDERS + 1)
    # dm/dx = -i w A/c^2 p and dm/dt = -A dp/dx: the flow at the middle, then what is stored on the way
    step = places[1]
    slope = (amplitudes[151] - amplitudes[149]) / (2 * step)
    middle = -area * slope / (1j * frequency)
    stored = np.cumsum((amplitudes[1:] + amplitudes[:-1]) / 2 * step, axis=0)
    stored = np.concatenate([np.zeros((1, ORDERS)), stored])
    flow = middle - 1j * frequency * area / float(gas.sound_speed) ** 2 * (stored - stored[150])
    momentum_rate = 1j * frequency * np.sum((flow[1:] + flow[:-1]) / 2 * step, axis=0)
    ends = area * (amplitudes[-1] - amplitudes[0])
    # trapezoids of 1 mm: (k h)^2/12 of the rate
    np.testing.assert_allclose(ends, -momentum_rate, atol=1e-5 * np.abs(ends).max())
    left = np.asarray(pulsation.series_in_pipe("left", "side", 0.0))
    np.testing.assert_allclose(force, area * (along[-1] - left), rtol=1e-9, atol=1e-12)


def test_a_vessel_is_a_wide_pipe():
    of_vessel = pulsation_of(network()).spectra()
    wide = Pipes(("left", "side", "right"), [0.2, 0.3], VESSEL, attenuation=0.0)
    piping = Piping((*network().pipes, wide), orifices=network().orifices, orders=ORDERS)
    of_pipe = pulsation_of(piping).spectra()
    for node, sizes in of_vessel.items():
        np.testing.assert_allclose(sizes, of_pipe[node], rtol=1e-10)


def test_limits_in_the_line_are_those_of_the_pipe_at_a_vessel():
    limits = {(lim.place, lim.order): lim for lim in pulsation_of(network()).limits}
    # at equal pressure and frequency the limit goes with the root of one over the diameter: 40 mm at both
    mean = pulsation_of(network()).series()
    pressure = {name: 1e5 + float(mean[name][0]) for name in ("right", "far")}
    ratio = float(limits["right", 2].allowed) / float(limits["far", 2].allowed)
    assert ratio == pytest.approx(np.sqrt(pressure["far"] / pressure["right"]), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"nodes": ("left",)}, "two different names"),
        ({"nodes": ("left", "side", "left")}, "two different names"),
        ({"length": [0.2]}, "2 gaps"),
        ({"diameter": [0.2, 0.1]}, "one diameter"),
        ({"direction": [0.0, 0.0, 0.0]}, "not of length 0"),
    ],
)
def test_what_is_wrong_with_a_vessel_is_named(change, words):
    entries = {"nodes": ("left", "side", "right"), "length": [0.2, 0.3], "diameter": 0.2}
    with pytest.raises(BadInput, match=words):
        Vessel(**{**entries, **change})


def test_a_force_has_one_name():
    with pytest.raises(BadInput, match="left-right is one force"):
        network(runs=(Run(("left", "right")),))


def machine_with(gas, **changes):
    """A machine whose first cylinder has its top dead centre at 40 degrees of the crank."""
    shaft = Crankshaft(0.02, throws=(Throw([np.deg2rad(40.0)]),))
    parts = {"mechanism": crank(), "crankshaft": shaft, "motor": ConstantSpeed(SPEED), "gas": gas}
    return Compressor(**{**parts, **changes})


@pytest.fixture(scope="module")
def pushed():
    """A machine with a directed vessel, and a state of it with known waves."""
    vessel = Vessel(("left", "side", "right"), [0.2, 0.3], VESSEL, direction=[3.0, 0.0, 4.0])
    pulsation = pulsation_of(network(vessels=(vessel,)))
    orbit = SimpleNamespace(cycle=SimpleNamespace(pulsation=pulsation))
    return machine_with(pulsation.case.cylinder), orbit, pulsation


def test_waves_push_a_node_of_the_rotor_at_their_time(pushed):
    compressor, orbit, pulsation = pushed
    orders = (0, 1, 2, 3, 8, 12)
    at_node = (PipeNode("left-right", "crankcase"),)
    (load,) = pipe_loads(compressor, orbit, at_node, orders)
    assert load.node == "crankcase"
    assert load.reaction is None
    phase = np.linspace(0.0, 6.0, 7)
    waves = phase[:, None] * np.array(orders)
    of_node = np.cos(waves) @ load.cosine + np.sin(waves) @ load.sine
    series = np.asarray(pulsation.shaking_series()["left-right"])
    listed = [order for order in orders if 0 < order <= ORDERS]
    # the crank at angle zero at W t = 0, and that is where the waves begin at constant speed
    expected = series[0]
    for order in listed:
        turned = order * phase
        expected = (
            expected + series[order] * np.cos(turned) + series[ORDERS + order] * np.sin(turned)
        )
    np.testing.assert_allclose(of_node, expected[:, None] * [0.6, 0.0, 0.8], rtol=1e-9, atol=1e-12)


def test_waves_push_and_turn_the_block(pushed):
    compressor, orbit, pulsation = pushed
    gas = PolytropicCycle(1e5, 4e5, 1.2, 0.04)
    still = solve_orbit(machine_with(gas))
    both = SimpleNamespace(
        cycle=orbit.cycle,
        state=still.state,
        weight=still.weight,
        time=still.time,
    )
    where = np.array([0.1, -0.2, 0.05])
    centre = np.array([0.02, 0.0, 0.0])
    block = Suspension(20.0, 0.1, 0.2, 0.3, (), centre)
    holding = Suspension(20.0, 0.1, 0.2, 0.3, (), centre, (PipePoint("left-right", where),))
    count = 5
    difference = (
        orbit_load(compressor, both, holding, count).amplitude
        - orbit_load(compressor, both, block, count).amplitude
    )
    series = pulsation.shaking_series()["left-right"]
    # the time of an orbit begins at the top dead centre of the first cylinder
    time = np.linspace(0.0, 5.0, 9)
    top = float(first_top(compressor))
    assert top == pytest.approx(np.deg2rad(40.0), abs=1e-9)
    orders = np.arange(1, count + 1)
    of_block = np.real(difference @ np.exp(1j * orders[:, None] * time))
    filtered = np.concatenate([[0.0], series[1 : 1 + count], series[1 + ORDERS :][:count]])
    size = values_of(jnp.asarray(filtered), jnp.asarray(time + top))
    force = np.outer([0.6, 0.0, 0.8], size)
    moment = np.cross(where - centre, force.T).T
    np.testing.assert_allclose(of_block, np.concatenate([force, moment]), rtol=1e-8, atol=1e-9)


def test_loads_of_pipes_that_are_not_there_are_named(pushed):
    compressor, orbit, _ = pushed
    with pytest.raises(BadInput, match=r"loads\.pipes\.0\.run"):
        pipe_loads(compressor, orbit, (PipeNode("left-write", "crankcase"),), (1,))
    with pytest.raises(BadInput, match=r"loads\.crank"):
        LoadCase(pipes=(PipeNode("left-right", "crankcase"),))


# a minute of compilation
@pytest.mark.slow
def test_waves_of_an_uneven_revolution_have_the_time_of_the_orbit():
    """At the flange the force on a run to the line is the area times the pressure that valves see."""
    chain = (Pipes(("flange", "line"), 1.8, 0.05, attenuation=0.1),)
    piping = Piping(chain, runs=(Run(("flange", "line")),), orders=16)
    shaft = Crankshaft(0.01, throws=(Throw([np.deg2rad(40.0)]),))
    motor = MeanSpeed(SPEED)
    compressor = machine_with(cylinder(piping), crankshaft=shaft, motor=motor)
    orbit = solve_orbit(compressor)
    assert float(orbit.speed_fluctuation) > 0.05
    cycle = orbit.cycle
    edges = cycle.raw[1].edges
    own_angle = orbit.state.angle + compressor.crankshaft.phase[0]
    turned = edges[0] + jnp.mod(own_angle - edges[0], 2 * np.pi)
    at_valves = over_panels(edges, cycle.flange_pressure[..., 0], turned) - 1e5
    force = run_forces(compressor, orbit)["flange-line"][2]
    orders = np.arange(force.size)
    of_time = np.real(np.exp(1j * np.outer(orbit.mean_speed * orbit.time, orders)) @ force)
    area = np.pi / 4 * 0.05**2
    # by polynomials of degree 6 on the panels of the cycle: 3e-3 where the pressure falls steeply
    np.testing.assert_allclose(-of_time / area, at_valves, atol=5e-3 * float(jnp.max(at_valves)))
