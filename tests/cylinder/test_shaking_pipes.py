"""Forces of waves on runs of pipe and vessels: by the gas's momentum, by end plates, and on what holds them.

The waves here are those that given flows make in a network; what a solved cycle makes of them stands in
`test_piped_cycles.py`.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from reference_pipes import SPEED, crank, cylinder

from jaxcomp import BadInput
from jaxcomp.cylinder import Pulsation
from jaxcomp.cylinder._waves import Observed, waves_at_rest
from jaxcomp.cylinder.interface import prepare
from jaxcomp.piping import Orifice, Pipes, Piping, Run, Vessel

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
    return Pulsation(waves_at_rest(machine), (flows,), prepare(machine, crank(), SPEED))


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
    along = [np.asarray(pulsation.series_in_pipe("side", "right", x)) for x in places]
    amplitudes = np.array([row[1 : 1 + ORDERS] - 1j * row[1 + ORDERS :] for row in along])
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
