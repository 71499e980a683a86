"""Machine files: values, units, sources, changes and the way back to TOML."""

import math
import subprocess
import sys
from importlib import resources
from typing import Literal, Protocol, runtime_checkable

import equinox as eqx
import numpy as np
import pytest
from jaxtyping import Array

from jaxcomp import Collocation, solve_orbit
from jaxcomp import scene as scenes
from jaxcomp._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from jaxcomp.friction import CoulombSlide, RegularisedSlide
from jaxcomp.gas import CrankAngleTable, PolytropicCycle
from jaxcomp.motor import Kloss, MeanSpeed, SlipLine
from jaxcomp.scene import _units, describe, dump, load, loads, machines, with_value
from jaxcomp.scene import with_values as changed
from jaxcomp.scene._change import with_machine
from jaxcomp.scene._schema import SECTIONS
from jaxcomp.scene._units import to_si

MINIMAL = """
[mechanism]
type = "slider_crank"
bore = "50 mm"
crank_radius = "20 mm"
conrod_length = "10 cm"
piston_mass = "300 g"
conrod_mass = 0.2
[crankshaft]
inertia = "0.01 kg m^2"
[motor]
type = "mean_speed"
mean_speed = "1500 rpm"
""".replace("= 0.2", '= "0.2 kg"')


def test_bundled_machine_has_the_printed_values():
    machine = load("mayekawa-wbhe").compressor
    mechanism, gas, friction = machine.mechanism, machine.gas, machine.friction
    assert mechanism.bore == 0.13
    np.testing.assert_allclose(mechanism.swept_volume, 1327e-6, rtol=1e-9)
    np.testing.assert_allclose(mechanism.conrod_ratio, 0.17, rtol=1e-9)
    np.testing.assert_allclose(machine.motor.mean_speed, 1000 * math.pi / 30, rtol=1e-15)
    assert (gas.suction_pressure, gas.discharge_pressure) == (98000.0, 980000.0)
    assert gas.exponent == 1.05
    assert friction.wall.coefficient == 0.083
    journals = friction.piston_pin, friction.crank_pin, machine.crankshaft.main_journal
    diameters = [one.diameter for one in journals]
    np.testing.assert_allclose(diameters, [0.04, 0.09, 0.092], rtol=1e-15)
    # Eq. (6) of the paper: 3.864 kg for a rod of 300 mm
    np.testing.assert_allclose(mechanism.conrod_mass, 3.864 * mechanism.conrod_length / 0.3, 1e-9)


@pytest.mark.parametrize("machine", machines(), ids=lambda m: m.name)
def test_every_value_of_a_bundled_machine_has_its_source(machine):
    scene = load(machine.name)
    assert scene.name == machine.name
    assert scene.description == machine.description != ""
    words = ("printed", "derived", "fitted", "assumed", "identified", "prior", "similar")
    for path, source in scene.sources.items():
        assert source.startswith(words), path


def test_the_two_readings_differ_in_rod_and_fitted_values_only():
    first, second = (
        {row.path: row.value for row in describe(load(name))}
        for name in ("mayekawa-wbhe", "mayekawa-wbhe-rod-centre")
    )
    differing = {path for path in first if first[path] != second[path]}
    assert {"mechanism.conrod_centre"} <= differing
    fitted = {f"mechanism.{n}" for n in ("conrod_centre", "conrod_inertia")}
    fitted |= {"crankshaft.inertia", "crankshaft.unbalance", "gas.clearance_ratio"}
    assert differing <= fitted


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("130 mm", "m", 0.13),
        ("130mm", "m", 0.13),
        (" -1.5e1 cm ", "m", -0.15),
        ("1000 rpm", "rad/s", 1000 * math.pi / 30),
        ("1000 r/min", "rad/s", 1000 * math.pi / 30),
        ("-3 deg", "rad", -math.pi / 60),
        ("0.98 MPa", "Pa", 0.98e6),
        ("9.8 bar", "Pa", 9.8e5),
        ("8 cm3", "m^3", 8e-6),
        ("0.6 %", "", 0.006),
        (0.02, "", 0.02),
        (2, "", 2.0),
        ("0.02", "", 0.02),
        ("2 N m/(rad/s)", "N m s", 2.0),
        ("4 mPa s", "Pa s", 4e-3),
        ("1200 g cm^2", "kg m^2", 1.2e-4),
        # as catalogues write them
        ("1000 RPM", "rad/s", 1000 * math.pi / 30),
        ("2 bara", "Pa", 2e5),
        ("1 lbm/h", "kg/s", 0.45359237 / 3600),
    ],
)
def test_text_with_unit_becomes_si(text, unit, value):
    np.testing.assert_allclose(to_si(text, unit, "key"), value, rtol=1e-15)


def test_lists_and_a_unit_for_a_whole_list():
    np.testing.assert_allclose(to_si(["1 mm", "2 cm"], "m", "key"), [0.001, 0.02])
    np.testing.assert_allclose(to_si([1, "2 m"], "m", "key", "mm"), [0.001, 2.0])
    assert to_si([[1, 2], [3, 4]], "", "key").shape == (2, 2)


def test_absent_parts_are_none_and_defaults_hold():
    scene = loads(MINIMAL, "small.toml")
    machine = scene.compressor
    assert machine.gas is None
    assert machine.friction is None
    assert machine.gravity is None
    assert machine.mechanism.offset == 0
    assert machine.motor.shape == "constant"
    assert (scene.name, scene.sources["mechanism.bore"]) == ("small", "")


def test_gravity_and_tables_are_read():
    text = 'gravity = ["0 m/s^2", "-9.81 m/s^2"]\n' + MINIMAL
    text += """
    [gas]
    type = "crank_angle_table"
    angle = { value = [0, 90, 180, 270], unit = "deg", source = "measured" }
    cylinder_pressure = ["1 bar", "2 bar", "3 bar", "2 bar"]
    back_pressure = "1 bar"
    """
    scene = loads(text)
    assert isinstance(scene.compressor.gas, CrankAngleTable)
    np.testing.assert_allclose(scene.compressor.gas.angle, np.arange(4) * np.pi / 2)
    np.testing.assert_allclose(scene.compressor.gravity, [0, -9.81])
    assert scene.sources["gas.angle"] == "measured"


def test_source_of_a_section_covers_what_names_none():
    text = 'source = "file"\n' + MINIMAL.replace("[motor]", '[motor]\nsource = "plate"')
    text = text.replace('"50 mm"', '{ value = "50 mm", source = "drawing" }')
    sources = loads(text).sources
    assert sources["mechanism.bore"] == "drawing"
    assert sources["mechanism.crank_radius"] == "file"
    assert sources["motor.mean_speed"] == "plate"


def test_describe_shows_given_and_si_values():
    rows = {row.path: row for row in describe(load("mayekawa-wbhe"))}
    bore = rows["mechanism.bore"]
    assert (bore.given, float(bore.value), bore.unit) == ("130 mm", 0.13, "m")
    assert (bore.source, bore.doc) == ("printed, Table 1", "piston diameter")
    assert rows["mechanism.offset"].source == "default"
    assert rows["friction.wall.type"].value == "coulomb"
    assert rows["motor.shape"].value == "proportional"


def test_set_values_anywhere():
    scene = load("mayekawa-wbhe")
    new = changed(
        scene,
        {
            "motor.mean_speed": "800rpm",
            "friction.wall.coefficient": 0.05,
            "gravity": ["-9.81 m/s^2", "0 m/s^2"],
            "gravity.1": "1 m/s^2",
            "friction.piston_pin": None,
            "friction.crank_pin.type": "regularised",
            "friction.crank_pin.transition_speed": "1 mm/s",
        },
        source="test",
    )
    machine = new.compressor
    np.testing.assert_allclose(machine.motor.mean_speed, 80 * np.pi / 3)
    assert machine.friction.wall.coefficient == 0.05
    assert machine.friction.piston_pin is None
    np.testing.assert_allclose(machine.gravity, [-9.81, 1.0])
    assert machine.friction.crank_pin.diameter == 0.09  # kept: the new law knows it as well
    assert new.sources["motor.mean_speed"] == "test"
    assert scene.compressor.motor.mean_speed > 100  # the first scene is as it was


def test_a_new_type_drops_what_it_does_not_know():
    scene = changed(
        load("mayekawa-wbhe"),
        {
            "motor.synchronous_speed": "1500 rpm",
            "motor.slope": "8 N m s",
            "motor.type": "slip_line",
        },
    )
    assert isinstance(scene.compressor.motor, SlipLine)
    assert "mean_speed" not in scene.document["motor"]
    with pytest.raises(scenes.SceneError, match=r"motor.slop: is an unknown key|motor.slop = "):
        changed(
            load("mayekawa-wbhe"),
            {
                "motor.type": "slip_line",
                "motor.slop": "8 N m s",
                "motor.synchronous_speed": "9 rps",
            },
        )


@pytest.mark.parametrize("machine", machines(), ids=lambda m: m.name)
def test_dump_reads_back_to_the_same_scene(machine):
    scene = with_value(load(machine.name), "gravity", ["0 m/s^2", "-9.81 m/s^2"])
    again = loads(dump(scene), scene.file)
    assert eqx.tree_equal(again.compressor, scene.compressor)
    assert (again.name, again.description) == (scene.name, scene.description)
    assert again.sources == scene.sources
    assert dump(again) == dump(scene)


@pytest.mark.parametrize("machine", machines(), ids=lambda m: m.name)
def test_dump_of_a_file_is_the_file(machine):
    scene = load(machine.name)
    assert dump(scene) == (resources.files("jaxcomp.machines") / scene.file).read_text("utf-8")


def test_dump_keeps_comments_and_order():
    text = MINIMAL.replace("[motor]", "# drawing 17\n[motor] # of the workshop", 1)
    text = text.replace('bore = "50 mm"', 'bore   =  "50 mm"  # measured')
    # a section in front of another keeps its place
    head, _, tail = text.partition("[mechanism]")
    mechanism, _, rest = tail.partition("# drawing 17")
    text = f"{head}# drawing 17{rest}\n# last\n[mechanism]{mechanism}"
    scene = loads(text)
    assert dump(scene) == text
    changes = {"mechanism.bore": "51 mm", "friction.type": "slider_crank"}
    changes["friction.wall"] = {"type": "coulomb", "coefficient": 0.1}
    new = changed(scene, changes, source="test")
    out = dump(new)
    assert 'bore   =  { value = "51 mm", source = "test" }  # measured\n' in out
    assert "# drawing 17\n[motor] # of the workshop\n" in out
    assert out.index("[motor]") < out.index("# last\n[mechanism]") < out.index("[friction.wall]")
    assert loads(out).document == new.document


def test_dump_escapes_texts():
    text = MINIMAL.replace("[motor]", "[motor]\nsource = 'a \"b\" \\ µ'")
    assert loads(dump(loads(text))).sources["motor.mean_speed"] == 'a "b" \\ µ'


def test_another_compressor_is_written_with_every_digit():
    scene = load("mayekawa-wbhe")
    machine = eqx.tree_at(
        lambda c: (c.mechanism.bore, c.motor, c.friction.wall, c.gas.back_pressure, c.gravity),
        scene.compressor,
        (
            scene.compressor.mechanism.bore / 3,
            Kloss(300.0, 0.2, 160.0),
            RegularisedSlide(0.1, 1e-3),
            None,
            np.array([1 / 3, 0.0]),
        ),
        is_leaf=lambda x: x is None,
    )
    whole = eqx.tree_at(lambda m: m.compressor, scene.machine, machine)
    new = with_machine(scene, whole, "optimised")
    assert eqx.tree_equal(new.compressor, machine, typematch=False)
    assert new.sources["mechanism.bore"] == "optimised"
    assert new.sources["mechanism.piston_mass"] == "printed, Table 1"
    assert new.document["mechanism"]["bore"]["value"].endswith(" mm")
    again = loads(dump(new))
    assert eqx.tree_equal(again.compressor, new.compressor)


def test_types_are_found_by_their_kind():
    machine = load("mayekawa-wbhe").compressor
    assert isinstance(machine.motor, MeanSpeed)
    assert isinstance(machine.gas, PolytropicCycle)
    assert isinstance(machine.friction.wall, CoulombSlide)


# A section of another shape: tables of parts, names, counts, a protocol in place of a base class.


@runtime_checkable
class HasStiffness(Protocol):
    def coefficient(self): ...


class ProbeSpring(Part):
    stiffness: Array = quantity("N/m", POSITIVE, shape=(None,))

    def coefficient(self):
        return self.stiffness


class ProbeMount(Part):
    nodes: tuple[int | str, int | str | None] = eqx.field(static=True)
    law: HasStiffness
    axes: tuple[str, ...] = eqx.field(static=True, default=("ux", "uy"))


class ProbeHousing(Part):
    mass: Array = quantity("kg", NONNEGATIVE, doc="all of it")
    mounts: tuple[ProbeMount, ...] = ()
    dof: int = eqx.field(static=True, default=4)
    theory: Literal["beam", "bar"] = eqx.field(static=True, default="beam")
    spins: bool = eqx.field(static=True, default=True)


HOUSING = """
[housing]
mass = "7 kg"
dof = 6
theory = "bar"
spins = false
[[housing.mounts]]
nodes = ["case", "none"]
law = { type = "probe_spring", stiffness = ["2.5 N/mm", "6 N/mm"] }
[[housing.mounts]]
nodes = [1, 2]
axes = ["uz"]
[housing.mounts.law]
type = "probe_spring"
stiffness = ["1 kN/m"]
"""


@pytest.fixture
def housing(monkeypatch):
    monkeypatch.setitem(SECTIONS, "housing", ProbeHousing)


def test_a_registered_section_is_read_without_code_of_its_own(housing):
    scene = loads(HOUSING)
    assert scene.compressor is None
    part = scene.parts["housing"]
    assert (part.dof, part.theory, part.spins) == (6, "bar", False)
    assert part.mounts[0].nodes == ("case", None)
    assert part.mounts[1].nodes == (1, 2)
    assert part.mounts[1].axes == ("uz",)
    np.testing.assert_allclose(part.mounts[0].law.stiffness, [2500, 6000])
    assert loads(HOUSING + MINIMAL).compressor is not None
    with pytest.raises(scenes.SceneError, match="this machine file describes no compressor"):
        scene.as_compressor()


def test_a_registered_section_is_set_described_and_dumped(housing):
    scene = changed(loads(HOUSING), {"housing.mounts.0.law.stiffness.1": "7 N/mm"})
    np.testing.assert_allclose(scene.parts["housing"].mounts[0].law.stiffness, [2500, 7000])
    assert eqx.tree_equal(loads(dump(scene)).parts["housing"], scene.parts["housing"])
    rows = {row.path: row for row in describe(scene)}
    assert rows["housing.mounts.1.nodes"].value == (1, 2)
    assert rows["housing.mass"].doc == "all of it"


@pytest.mark.slow
def test_slider_link_machine_runs_from_its_scene():
    orbit = solve_orbit(load("slider-link-8cc").compressor, Collocation(reversals=12))
    # the household machine as computed by an independent RK4 integration in time (tests of the
    # mechanism have the parts): rounding of the figures as they are kept there
    np.testing.assert_allclose(float(orbit.motor_power), 75.9, atol=0.05)
    np.testing.assert_allclose(float(orbit.mean_speed) * 30 / np.pi, 2907, atol=0.5)


def test_frequent_units_are_those_of_the_registry(monkeypatch):
    frequent = dict(_units.FREQUENT)
    monkeypatch.setattr(_units, "FREQUENT", {})
    for (given, unit), size in frequent.items():
        assert _units.factor(given, unit) == size, f"{given} in {unit}"


def test_a_command_does_not_import_what_it_does_not_use():
    """Half a second each: the registry of units for frequent units, diffrax for what is not marched."""
    program = (
        "import sys, jaxcomp, jaxcomp.study; jaxcomp.load('mayekawa-wbhe'); jaxcomp.solve_orbit; "
        "assert not {'pint', 'diffrax', 'optax', 'optimistix'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_section_is_taken_away_from_a_table_in_several_places():
    """Between `[crankshaft]` and `[crankshaft.main_journal]` the file has other sections."""
    lean = with_value(load("mayekawa-wbhe"), "crankshaft.main_journal", None)
    written = dump(lean)
    assert "[crankshaft]" in written
    assert "main_journal]" not in written
    assert loads(written).compressor.crankshaft.main_journal is None
