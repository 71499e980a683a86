"""What files may say wrong about pipes is answered with the entry, its value and what to write."""

import pytest

from jaxcomp.scene import SceneError, loads

MACHINE = """
[mechanism]
type = "slider_crank"
bore = "60 mm"
crank_radius = "26.2 mm"
conrod_length = "110 mm"
piston_mass = "0.2 kg"
conrod_mass = "0.2 kg"
[crankshaft]
inertia = "0.05 kg m^2"
[motor]
type = "mean_speed"
mean_speed = "1450 rpm"
[gas]
type = "cylinder"
clearance_ratio = "4 %"
[gas.fluid]
type = "perfect_gas"
gas_constant = "287 J/(kg K)"
kappa = 1.4
[gas.suction]
pressure = "1 bar"
temperature = "300 K"
[gas.discharge]
pressure = "4 bar"
[gas.suction_valve]
type = "reed"
mass = "2 g"
stiffness = "800 N/m"
damping = "0.3 N s/m"
stop = "2 mm"
port_diameter = "22 mm"
port_length = "20 mm"
[gas.discharge_valve]
type = "reed"
mass = "2 g"
stiffness = "3000 N/m"
damping = "0.4 N s/m"
preload = "0.2 mm"
stop = "1.5 mm"
port_diameter = "18 mm"
port_length = "18 mm"
"""
PIPES = """
[gas.suction.piping]
orders = 64
[[gas.suction.piping.pipes]]
nodes = ["flange", "bottle", "tee", "line"]
length = ["0.1 m", "0.6 m", "1.8 m"]
diameter = "50 mm"
[[gas.suction.piping.pipes]]
nodes = ["tee", "stub"]
length = "0.5 m"
diameter = "30 mm"
[[gas.suction.piping.volumes]]
node = "bottle"
volume = "4 l"
[[gas.suction.piping.orifices]]
nodes = ["tee", "header"]
diameter = "25 mm"
[[gas.suction.piping.pipes]]
nodes = ["header", "line"]
length = "1 m"
diameter = "50 mm"
[[gas.suction.piping.ends]]
node = "stub"
type = "closed"
[[gas.suction.piping.runs]]
nodes = ["tee", "line"]
direction = [0, 0, 1]
[friction]
type = "slider_crank"
"""


def test_pipes_of_a_file_are_read():
    piping = loads(MACHINE + PIPES).compressor.gas.suction.piping
    assert piping.nodes == ("flange", "bottle", "tee", "line", "stub", "header")
    assert piping.flanges == ("flange",)
    assert piping.orders == 64
    assert piping.pipes[0].diameter.shape == (3,)


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ('nodes = ["tee", "stub"]', 'nodes = ["sea", "stub"]', "pipes.1.nodes", "leads nowhere"),
        ('["flange", "bottle", "tee"', '["inlet", "bottle", "tee"', "pipes.0.nodes", '"flange"'),
        ('["0.1 m", "0.6 m", "1.8 m"]', '["0.1 m", "0.6 m"]', "pipes.0.length", "3 gaps"),
        ('["0.1 m", "0.6 m", "1.8 m"]', '["0.1 m", "0 m", "1.8 m"]', "pipes.0.length", "> 0"),
        ('length = "0.5 m"', 'length = "2 km"', "pipes.1.length", "1000"),
        ('diameter = "30 mm"', 'diameter = "0.5 mm"', "pipes.1.diameter", "0.001"),
        ('diameter = "30 mm"', 'diameter = "400 mm"', "pipes.1.diameter", "five times"),
        ('volume = "4 l"', 'volume = "-4 l"', "volumes.0.volume", "> 0"),
        ('node = "bottle"', 'node = "line"', "volumes.0.node", "line"),
        ('node = "bottle"', 'node = "botle"', "volumes.0.node", "bottle"),
        ('node = "stub"', 'node = "flange"', "ends.0.node", "valves"),
        ("orders = 64", "orders = 3", "piping.orders", ">= 4"),
        ("orders = 64", "orders = 500", "piping.orders", "<= 128"),
        (
            'diameter = "30 mm"',
            'diameter = "30 mm"\nroughness = "50 um"\nattenuation = "0.02 1/m"',
            "pipes.1.roughness",
            "one of them",
        ),
        (
            'nodes = ["tee", "header"]\ndiameter = "25 mm"',
            'nodes = ["tee", "header"]',
            "orifices.0",
            "one of them",
        ),
        (
            'type = "closed"',
            'type = "closed"\n[[gas.suction.piping.ends]]\nnode = "stub"\ntype = "open"',
            "ends.1.node",
            "ends.0",
        ),
        ('nodes = ["tee", "line"]\ndirection', 'nodes = ["tee", "lin"]\ndirection', "runs.0", "lin"),
        ('port_length = "20 mm"\n', "", "suction_valve.port_length", "collocation"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(old, new, key, words):
    text = MACHINE + PIPES
    assert old in text
    with pytest.raises(SceneError) as caught:
        loads(text.replace(old, new))
    assert key in str(caught.value)
    assert words in str(caught.value)
    # a name has quotes of its own nowhere
    assert '""' not in str(caught.value)
