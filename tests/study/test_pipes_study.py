"""Resonances of pipes as quantities of studies, for which no cycle is solved."""

import sys
from pathlib import Path

import numpy as np

from jaxcomp.scene import loads
from jaxcomp.study import available_quantities, sensitivity

sys.path.insert(0, str(Path(__file__).parents[1] / "scene"))
from test_piping_errors import MACHINE

PIPE = """
[[gas.suction.piping.pipes]]
nodes = ["flange", "line"]
length = "1 m"
diameter = "50 mm"
attenuation = "0.02 1/m"
"""
FRICTION = """
[friction]
type = "slider_crank"
"""


def test_a_quarter_wave_follows_its_length_and_gas():
    names = ["resonance.1.frequency", "resonance.2.frequency", "resonance_quality.1"]
    slopes = sensitivity(loads(MACHINE + PIPE + FRICTION), names)
    sound_speed = np.sqrt(1.4 * 287 * 300)
    # with a given attenuation a wave keeps its shape, so that these are the closed forms
    first = sound_speed / 4
    quality = np.pi * first / (sound_speed * 0.02)
    np.testing.assert_allclose(slopes.value, [first, 3 * first, quality], rtol=1e-9)
    elasticity = dict(zip(slopes.numbers, slopes.elasticity.T, strict=True))
    np.testing.assert_allclose(
        elasticity["gas.suction.piping.pipes.0.length"], [-1, -1, -1], rtol=1e-8
    )
    np.testing.assert_allclose(
        elasticity["gas.suction.piping.pipes.0.attenuation"], [0, 0, -1], atol=1e-8
    )
    np.testing.assert_allclose(elasticity["gas.fluid.gas_constant"], [0.5, 0.5, 0.0], atol=1e-8)


def test_names_tell_the_line_where_both_have_pipes():
    gas = loads(MACHINE + PIPE + PIPE.replace("suction", "discharge") + FRICTION)
    names = [name for name in available_quantities(gas.machine) if name.startswith("resonance")]
    assert names == ["resonance.<number>", "resonance_quality.<number>"]
    assert gas.compressor.gas.resonance_names[3:5] == ["suction.4", "discharge.1"]
    without = loads(MACHINE + FRICTION)
    assert not any(name.startswith("resonance") for name in available_quantities(without.machine))
