"""Rotors from machine files: reading, refusals, `jaxcomp respond` and `jaxcomp modes`, pictures."""

import subprocess
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import BadInput
from jaxcomp.cli import app
from jaxcomp.plot._rotor import campbell_diagram, rotor_drawing
from jaxcomp.rotor import (
    CampbellDiagram,
    ConstantLaw,
    CriticalSpeeds,
    DampedModes,
    Disks,
    Link,
    LoadedFilm,
    Mount,
    RotorModel,
    ShaftElements,
    SpeedTable,
    Unbalances,
    damped_modes,
    respond,
    undamped_modes,
)
from jaxcomp.rotor._campbell import critical_speeds_between
from jaxcomp.rotor._model import node_positions, subset_names, subsets
from jaxcomp.scene import SceneError, describe, dump, load, loads

RPM = np.pi / 30

ROTOR = """
name = "example"
[rotor]
[[rotor.shafts]]
nodes = [1, 2, 3, "end"]
length = ["100 mm", "10 cm", "80 mm"]
outer_diameter = "20 mm"
young_modulus = "206 GPa"
density = "7800 kg/m^3"
poisson = 0.3
[[rotor.disks]]
nodes = [2, 3]
mass = ["2 kg", "1 kg"]
transverse_inertia = "1e-3 kg m^2"
polar_inertia = "2e-3 kg m^2"
[[rotor.links]]
nodes = [1, "foot"]
[rotor.links.law]
type = "constant"
stiffness = { value = [[1e3, 10], [-10, 2e3]], unit = "N/mm" }
damping = { value = [[100, 0], [0, 100]], unit = "N s/m" }
[[rotor.links]]
nodes = ["end", "case"]
[rotor.links.law]
type = "speed_table"
kind = "linear"
speed = ["1000 rpm", "5000 rpm"]
stiffness = { value = [[[1e6, 0], [0, 1e6]], [[2e6, 0], [0, 2e6]]], unit = "N/m" }
damping = { value = [[[50, 0], [0, 50]], [[50, 0], [0, 50]]], unit = "N s/m" }
[[rotor.links]]
nodes = ["case", "ground"]
axes = ["ux", "uy", "thx", "thy"]
[rotor.links.law]
type = "mount"
stiffness = ["200 N/mm", "200 N/mm"]
damping = ["50 N s/m", "50 N s/m"]
angular_stiffness = ["2e4 N m/rad", "2e4 N m/rad"]
angular_damping = ["5 N m s/rad", "5 N m s/rad"]
[[rotor.bodies]]
centre = "case"
nodes = ["foot"]
arm = [["0 mm", "0 mm", "-280 mm"]]
mass = "10 kg"
inertia = { value = [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], unit = "kg m^2" }
[rotor.damping]
type = "proportional"
stiffness_factor = "1e-5 s"
[[loads.unbalances]]
nodes = [2]
magnitude = "500 g mm"
phase = "30 deg"
[balancing]
speeds = ["3000 rpm"]
[[balancing.planes]]
name = "left"
node = 2
radius = "30 mm"
[[balancing.targets]]
name = "T1"
node = "foot"
[[balancing.targets]]
name = "gap"
node = 3
relative_to = "case"
"""


def in_python():
    """The same rotor, built by hand."""
    shaft = ShaftElements(
        ((1, 2), (2, 3), (3, "end")),
        [0.1, 0.1, 0.08],
        [0.02] * 3,
        [206e9] * 3,
        [7800.0] * 3,
        [0.3] * 3,
    )
    disks = Disks((2, 3), [2.0, 1.0], [1e-3] * 2, [2e-3] * 2)
    links = (
        Link((1, "foot"), ConstantLaw([[1e6, 1e4], [-1e4, 2e6]], 100 * jnp.eye(2))),
        Link(
            ("end", "case"),
            SpeedTable(
                jnp.array([1000, 5000]) * RPM,
                jnp.array([1e6, 2e6])[:, None, None] * jnp.eye(2),
                jnp.array([50.0, 50.0])[:, None, None] * jnp.eye(2),
                "linear",
            ),
        ),
        Link(
            ("case", None),
            Mount([2e5] * 2, [50.0] * 2, [2e4] * 2, [5.0] * 2),
            ("ux", "uy", "thx", "thy"),
        ),
    )
    from jaxcomp.rotor import ProportionalDamping, RigidBody

    case = RigidBody("case", ("foot",), [[0, 0, -0.28]], 10.0, 0.1 * jnp.eye(3))
    damping = ProportionalDamping(0.0, 1e-5)
    return RotorModel((shaft,), (disks,), links=links, bodies=(case,), damping=damping)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "rotor.toml"
    path.write_text(ROTOR)
    return str(path)


def invoke(*arguments):
    return CliRunner().invoke(app, list(arguments))


def close(a, b):
    # Rounding of units: 1e3 N/mm and 1e6 N/m.
    return eqx.tree_equal(a, b, rtol=1e-14, atol=0.0)


def test_file_and_python_describe_one_rotor():
    scene = loads(ROTOR)
    assert scene.compressor is None
    assert close(scene.parts["rotor"], in_python())
    unbalance = Unbalances((2,), [5e-4], [np.pi / 6])
    assert close(scene.parts["loads"].loads, (unbalance,))
    planes = scene.parts["balancing"]
    assert (planes.planes[0].name, float(planes.planes[0].radius)) == ("left", 0.03)
    assert planes.targets[1].relative_to == "case"
    again = loads(dump(scene))
    for name, part in scene.parts.items():
        assert eqx.tree_equal(again.parts[name], part)
    rows = {row.path: row for row in describe(scene)}
    np.testing.assert_array_equal(rows["rotor.shafts.0.outer_diameter"].value, [0.02] * 3)
    assert rows["rotor.shafts.0.outer_diameter"].given == "20 mm"


def test_a_compressor_alone_does_not_import_the_rotor():
    code = (
        "import sys; from jaxcomp.scene import load; load('mayekawa-wbhe');"
        "sys.exit('jaxcomp.rotor' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_films_are_the_film_models_at_their_load():
    from jaxcomp.film import JournalBearing
    from jaxcomp.film._running import stiffness_damping

    load_, spin = jnp.array([300.0, -400.0]), jnp.asarray(314.0)
    found = {}
    for film in ("reynolds", "grooved"):
        bearing = JournalBearing(0.026, 0.026, 13e-6, 6e-3, film)
        found[film] = LoadedFilm(bearing, load_).coefficients(spin)
        for a, b in zip(found[film], stiffness_damping(bearing, load_, spin), strict=True):
            np.testing.assert_array_equal(a, b)
    k = found["grooved"][0]
    assert float(jnp.abs(k - found["reynolds"][0]).max()) > 0.02 * float(jnp.abs(k).max())
    # Turning backwards with the load mirrored is the mirror image.
    mirror = np.diag([1.0, -1.0])
    back = LoadedFilm(bearing, mirror @ load_).coefficients(-spin)[0]
    np.testing.assert_allclose(mirror @ back @ mirror, k, rtol=1e-12)
    # A table of loads over the speed is linear between its rows, and held beyond.
    table = LoadedFilm(bearing, jnp.stack([load_, 3 * load_]), jnp.array([214.0, 414.0]))
    np.testing.assert_allclose(
        table.coefficients(spin)[0],
        LoadedFilm(bearing, 2 * load_).coefficients(spin)[0],
        rtol=1e-12,
    )
    np.testing.assert_array_equal(
        table.coefficients(jnp.asarray(100.0))[1],
        LoadedFilm(bearing, load_).coefficients(jnp.asarray(100.0))[1],
    )
    with pytest.raises(BadInput, match=r"load.*machine"):
        LoadedFilm(bearing).coefficients(spin)
    with pytest.raises(BadInput, match=r"film.*stiffness"):
        LoadedFilm(JournalBearing(0.026, 0.026, 13e-6, 6e-3, "petroff"), load_)


def changed(old, new):
    assert ROTOR.count(old) == 1, old
    return ROTOR.replace(old, new)


BAD = {
    "no unit": (
        changed('"20 mm"', "20"),
        "rotor.shafts.0.outer_diameter = 20: lacks its unit; it must be a text with a unit",
    ),
    "column of another length": (
        changed('"20 mm"', '["20 mm", "30 mm"]'),
        "rotor.shafts.0.outer_diameter = ['20 mm', '30 mm']: must be one value, or one for each of "
        "3 elements",
    ),
    "out of bounds": (
        changed('"20 mm"', '"-20 mm"'),
        'rotor.shafts.0.outer_diameter = "-20 mm": must be > 0 and <= 20',
    ),
    "one node": (changed('[1, 2, 3, "end"]', "[1]"), "rotor.shafts.0.nodes = [1]: must be at least"),
    "disk on no node": (
        changed("nodes = [2, 3]", "nodes = [2, 33]"),
        "rotor.disks.0.nodes = 33: must be a node of a shaft, link or body",
    ),
    "link to no node": (
        changed('["end", "case"]', '["end", "cas"]'),
        'rotor.links.1.nodes = "cas": must be a node of a shaft, disk, mass, body or another link',
    ),
    "same node twice": (
        changed('[1, "foot"]', "[1, 1]"),
        "rotor.links.0.nodes = [1, 1]: must be two different nodes",
    ),
    "matrices of another size": (
        changed('axes = ["ux", "uy", "thx", "thy"]', 'axes = ["ux", "uy"]'),
        "rotor.links.2.axes = ['ux', 'uy']: must be 4 axes",
    ),
    "unknown axis": (
        changed('["ux", "uy", "thx", "thy"]', '["ux", "uy", "thx", "th"]'),
        "rotor.links.2.axes = ",
    ),
    "unknown law": (
        changed('"mount"', '"mout"'),
        'rotor.links.2.law.type = "mout": must be one of: clamped, constant, film, mount, pinned, '
        'speed_table; did you mean "mount"?',
    ),
    "table that falls": (
        changed('["1000 rpm", "5000 rpm"]', '["5000 rpm", "1000 rpm"]'),
        "rotor.links.1.law: must be a table with increasing speeds",
    ),
    "matrix of another unit": (
        changed('unit = "N/mm"', 'unit = "N s/m"'),
        "rotor.links.0.law.stiffness.0.0 = 1000.0: has a unit of another dimension",
    ),
    "arm for each node": (
        changed('[["0 mm", "0 mm", "-280 mm"]]', '{ value = [], unit = "m" }'),
        "rotor.bodies.0.arm = []: must be one arm for each of 1 nodes",
    ),
    "degrees of freedom": (changed("[rotor]\n", "[rotor]\ndof = 5\n"), "rotor.dof = 5: must be 4"),
    "load on no node": (
        changed('nodes = [2]\nmagnitude', 'nodes = [7]\nmagnitude'),
        "loads.unbalances.0.nodes = 7: must be a node of the rotor, one of (1, 2, 3, 'end'",
    ),
    "target on no node": (
        changed('node = "foot"', 'node = "food"'),
        'balancing.targets.0.node = "food": must be a node of the rotor',
    ),
    "two targets of one name": (
        changed('name = "gap"', 'name = "T1"'),
        "balancing.targets = ",
    ),
    "axis that the rotor lacks": (
        changed('relative_to = "case"', 'relative_to = "case"\naxes = ["thz"]'),
        "balancing.targets.1.axes = ",
    ),
    "loads without a rotor": (
        "[loads]\n[[loads.unbalances]]" + ROTOR.split("[[loads.unbalances]]")[1].split("[bal")[0],
        "loads: must be beside a section [rotor]",
    ),
    "unknown section": (changed("[balancing]", "[balacing]\n[balancing]"), "balacing: is an unknown"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_rotor_is_refused(case):
    text, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        loads(text, "bad.toml")
    assert str(caught.value).startswith(f"bad.toml: {message}")
    assert "\n" not in str(caught.value)


def test_places_and_subsets_follow_the_joints():
    model = in_python()
    places = node_positions(model)
    np.testing.assert_allclose(places["end"], [0, 0, 0.28])
    np.testing.assert_allclose(places["case"], places["end"], atol=1e-15)
    np.testing.assert_allclose(places["foot"], [0, 0, 0], atol=1e-15)
    assert subsets(model) == ((1, 2, 3, "end"), ("foot", "case"))
    assert subset_names(model) == ("rotor", "case")
    hermetic = load("hermetic-68cc").parts["rotor"]
    places = node_positions(hermetic)
    # Along the shaft, through a bearing, the crankcase and the springs to the foot of the housing:
    # 215 mm to the lower bearing, 5 mm back to the springs, 60 mm on to the grommets.
    np.testing.assert_allclose(places[65], [0, 0, 0.215], atol=1e-12)
    np.testing.assert_allclose(places["grommets"], [0, 0, 0.27], atol=1e-12)
    np.testing.assert_allclose(places["head"], [0.11, 0, 0.169], atol=1e-12)
    assert subset_names(hermetic) == ("rotor", "crankcase", "housing")


def test_respond_prints_what_the_library_finds(file, tmp_path):
    folder = tmp_path / "out"
    arguments = ("respond", file, "--speed", "3000rpm", "--speeds", "600rpm:6000rpm:64")
    result = invoke(*arguments, "--json", "--out", str(folder))
    assert result.exit_code == 0, result.stderr
    found = read_json(result.stdout)
    scene = load(file)
    model, loads_ = scene.parts["rotor"], scene.parts["loads"].loads
    x = np.asarray(respond(model, loads_, jnp.array([3000 * RPM])).displacement)[0, 0]
    names = [1, 2, 3, "end", "foot", "case"]
    foot, gap = x[names.index("foot")], x[names.index(3)] - x[names.index("case")]
    assert set(found["nodes"]) == {"T1 (foot)", "gap (3 from case)"}
    for name, value in (("T1 (foot)", foot), ("gap (3 from case)", gap)):
        motion = found["nodes"][name]
        for k, axis in enumerate(found["axes"]):
            wave = motion["amplitude"][axis][0][0] * np.exp(1j * motion["phase"][axis][0][0])
            assert wave == pytest.approx(complex(value[k]), rel=1e-9, abs=1e-16)
    # The peak of the curve is where it is, and the value at a solved speed is on the curve.
    curve = np.array(found["curves"]["major_axis"]["T1 (foot)"][0])
    speeds = np.array(found["curves"]["speeds"])
    assert curve.shape == (64,)
    nearest = np.interp(3000 * RPM, speeds, curve)
    assert nearest == pytest.approx(found["nodes"]["T1 (foot)"]["major_axis"][0][0], rel=0.02)
    assert (found["status"], found["orders"], found["degrees_of_freedom"]) == ("ok", [1], 4)
    # The mount's force: what the law makes of the case's motion.
    case = x[names.index("case"), 0]
    force = abs((2e5 + 50j * 3000 * RPM) * case)
    assert found["links"]["2: case to ground"]["ux"][0][0] == pytest.approx(force, rel=1e-9)
    assert {f.stem for f in folder.glob("*.png")} == {"rotor", "shape", "orbits", "curves"}
    assert all(f.stat().st_size > 8000 for f in folder.glob("*.png"))
    assert read_json((folder / "result.json").read_text()) == found
    assert close(load(folder / "machine.toml").parts["rotor"], model)
    table = invoke(*arguments)
    assert table.exit_code == 0
    for text in (
        "example at 3000 rpm",
        "gap (3 from case)",
        f"{1e6 * found['nodes']['T1 (foot)']['major_axis'][0][0]:.3g}",
        "forward",
        "Largest major axis",
    ):
        assert text in table.stdout, text


@pytest.mark.slow
def test_modes_prints_what_the_library_finds(file, tmp_path):
    folder = tmp_path / "out"
    arguments = ("modes", file, "--count", "6", "--speeds", "300rpm:9000rpm:12")
    result = invoke(*arguments, "--json", "--out", str(folder))
    assert result.exit_code == 0, result.stderr
    found = read_json(result.stdout)
    model = load(file).parts["rotor"]
    modes = damped_modes(model, 3000 * RPM, 6)  # the speed of the scene
    listed = [m["frequency"] for m in found["modes"][0]]
    np.testing.assert_allclose(listed, modes.frequency, rtol=1e-9)
    assert found["stable"] == [True]
    table = found["campbell"]
    for i in (0, 7):
        own = damped_modes(model, table["speeds"][i], 6)
        np.testing.assert_allclose(table["frequency"][i], own.frequency, rtol=1e-9)
        np.testing.assert_allclose(table["whirl"][i], own.whirl, atol=1e-6)
    critical = critical_speeds_between(model, table["speeds"], 6)
    np.testing.assert_allclose(
        [c["speed"] for c in table["critical_speeds"]], critical.speed, rtol=1e-9
    )
    assert {f.stem for f in folder.glob("*.png")} == {"rotor", "modes", "campbell"}
    shown = invoke("modes", file, "--count", "6")
    assert shown.exit_code == 0
    for text in ("example: modes at 3000 rpm", f"{listed[0] / (2 * np.pi):.5g}", "stable", "case"):
        assert text in shown.stdout, text


def test_modes_hanging_free():
    """Bearings whose static load only the running crank knows are no part of a rotor that hangs free."""
    result = invoke("modes", "hermetic-68cc", "--free", "--undamped", "--speed", "0rpm", "--json")
    assert result.exit_code == 0, result.stderr
    found = read_json(result.stdout)
    assert found["magnetic_pull_limit"] is None
    assert found["free"]
    rotor = load("hermetic-68cc").parts["rotor"]
    alone = RotorModel(rotor.shafts, rotor.disks)  # four rigid motions, then pairs
    bending = np.asarray(undamped_modes(alone, 12, free=True).frequency)[4:]
    listed = [mode["frequency"] for mode in found["modes"][0]]
    elastic = [w for w in listed if w > 0.5 * bending[0]]
    assert len(elastic) >= 8
    np.testing.assert_allclose(elastic[:8], bending[:8], rtol=1e-6)


@pytest.mark.slow
def test_all_critical_speeds_of_a_range_are_found():
    # Every crossing of a fine diagram: the number of modes below the line n W changes there.
    model, speeds = in_python(), np.linspace(30.0, 900.0, 12)
    found = critical_speeds_between(model, speeds, 6)
    assert np.all(np.diff(found.speed) >= 0)
    for w, growth in zip(found.speed, found.growth, strict=True):
        value = damped_modes(model, w, 6).eigenvalue
        # The Newton step ends at 1e-8 of the speed, its square is left.
        assert float(jnp.min(jnp.abs(value - (growth + 1j * w)))) < 1e-6 * float(w)
    below = [int(jnp.sum(damped_modes(model, w, 6).frequency < w)) for w in (speeds[0], speeds[-1])]
    assert len(found.speed) == below[1] - below[0] > 3
    # Half-order and double-order lines are lines of their own.
    twice = critical_speeds_between(model, speeds, 6, order=2)
    value = damped_modes(model, twice.speed[0], 6).eigenvalue
    target = twice.growth[0] + 2j * twice.speed[0]
    assert float(jnp.min(jnp.abs(value - target))) < 1e-6 * float(twice.speed[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["respond", "mayekawa-wbhe"], "has no [rotor], which `respond` needs"),
        (["modes", "mayekawa-wbhe"], "has no [rotor], which `modes` needs"),
        (["respond", "FILE", "--speed", "3000"], '--speed 3000 = "3000": lacks its unit'),
        (["respond", "FILE", "--speed", "-1rpm"], "--speed -1rpm: must be >= 0 rad/s"),
        (["respond", "FILE", "--speeds", "1rpm:2rpm:3:4"], "must have the form a,b,c or from:to"),
        (["respond", "FILE", "--speeds", "2rpm:1rpm"], "--speeds 2rpm:1rpm: must rise"),
        (["modes", "FILE", "--speeds", "1rpm:2rpm:x"], "must be a whole number"),
        (["modes", "FILE", "--speeds", "1rpm:2rpm:1"], "must have 2 to 100000 points"),
        (["respond", "FILE", "--orders", "0"], '--orders 0: must be whole numbers above zero'),
        (["respond", "FILE", "--node", "foo"], '--node foo: is no node; did you mean "foot"?'),
        (["respond", "FILE", "--set", "loads=none"], "loads: is missing; nothing excites this rotor"),
        (["modes", "FILE", "--free", "--speeds", "1rpm:2rpm"], "has no Campbell diagram"),
        (["modes", "FILE", "--count", "900"], "`count` must be between 1 and the"),
    ],
)  # fmt: skip
def test_bad_arguments_end_in_one_line(arguments, message, file):
    result = invoke(*[file if a == "FILE" else a for a in arguments])
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert not result.stdout


def test_a_response_without_an_answer_ends_in_one_line(tmp_path):
    # The undamped resonance of a mass on a spring: 2 kg, 5 kN/m, 50 rad/s.
    text = """
    [[rotor.masses]]
    nodes = ["m"]
    mass = "2 kg"
    [[rotor.links]]
    nodes = ["m", "ground"]
    law = { type = "mount", stiffness = ["5 N/mm", "5 N/mm"], damping = ["0 N s/m", "0 N s/m"] }
    [[loads.unbalances]]
    nodes = ["m"]
    magnitude = "1 g m"
    phase = "0 deg"
    """
    path = tmp_path / "spring.toml"
    path.write_text(text)
    result = invoke("respond", str(path), "--speed", "50 rad/s")
    assert result.exit_code == 2
    assert "at 1 of 1 frequencies, first at 50 rad/s" in result.stderr


def test_pictures_show_the_numbers(file):
    model = load(file).parts["rotor"]
    figure = rotor_drawing(model)
    labels = " ".join(t.get_text() for t in figure.axes[0].texts)
    assert "case, 10 kg" in labels
    assert "ground" in labels
    none = np.nan
    frequency = np.array([[15.0, none], [16.0, 30.0]])
    damping = np.array([[0.1, none], [0.1, 0.9]])
    eigenvalue = frequency * (1j - damping / np.sqrt(1 - damping**2))
    whirl = np.array([[1.0, none], [1.0, -1.0]])
    modes = DampedModes(eigenvalue, np.zeros((2, 2, 1, 4)), whirl, np.zeros(2))
    critical = CriticalSpeeds(np.array([15.5]), np.array([-0.93]), np.zeros(1))
    campbell = CampbellDiagram(np.array([10.0, 20.0]), modes, critical)
    ax = campbell_diagram(campbell).axes[0]
    circle = next(line for line in ax.lines if line.get_label() == "critical speed")
    np.testing.assert_allclose(circle.get_xydata(), [[15.5 / RPM, 15.5 / (2 * np.pi)]])
    forward = next(line for line in ax.lines if line.get_label() == "forward")
    np.testing.assert_allclose(forward.get_ydata() * 2 * np.pi, [15.0, 16.0])


@pytest.mark.parametrize("command", ["modes", "respond"])
def test_a_rotor_that_lacks_is_told_before_a_speed_that_lacks(command):
    # its motor has a torque curve: the machine names no speed
    done = CliRunner().invoke(app, [command, "slider-link-8cc"])
    assert done.exit_code == 2
    assert f"the machine file has no [rotor], which `{command}` needs" in done.stderr
