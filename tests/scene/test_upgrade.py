"""Machine files of before the section [crankshaft]: refused in one sentence, rewritten by a command."""

import pytest
from typer.testing import CliRunner

from jaxcomp import SceneError, load, loads, solve_orbit
from jaxcomp.cli import app
from jaxcomp.crank import Collocation
from jaxcomp.scene import with_value
from jaxcomp.scene._upgrade import upgraded

COMMON = """
[motor]
type = "mean_speed"
mean_speed = "1000 rpm"

[gas]
type = "polytropic"
suction_pressure = "1 bar"
discharge_pressure = "6 bar"
exponent = 1.3
clearance_ratio = "4 %"
"""
ROD = """name = "old"  # of before

# the linkage
[mechanism]
type = "slider_crank"
bore = "60 mm"
crank_radius = "20 mm"
conrod_length = "80 mm"
piston_mass = "0.5 kg"
conrod_mass = "0.3 kg"
# by the maker
crank_inertia = { value = "8e-3 kg m^2", source = "printed, sheet 2" }
crank_unbalance = "-0.01 kg m"
crank_mass = "4 kg"
"""
SEVERAL = (
    ROD.replace('crank_unbalance = "-0.01 kg m"\n', "")
    + """
[cylinders]  # a vee
balanced = true

[[cylinders.throws]]
banks = [
  "-45 deg",
  "45 deg",
]
rod_pitch = "20 mm"
"""
)
JOURNAL = """
[friction]
type = "slider_crank"

# one bearing
[friction.main_journal]
type = "coulomb"
coefficient = 0.01
diameter = "30 mm"
"""
LINK = """
[mechanism]
type = "slider_link"
bore = "23 mm"
crank_radius = "9.6 mm"
cylinder_length = "34 mm"
crown_to_link = "48 mm"
slider_diameter = "18 mm"
piston_mass = "110 g"
slider_mass = "22 g"
crank_inertia = "4.5e-4 kg m^2"
overhang = { value = "24 mm", source = "assumed" }
bearing_span = "42 mm"
plane_height = "35 mm"
crank_mass = "1.2 kg"
crank_eccentricity = "0.6 mm"
crank_product = "1e-5 kg m^2"

[friction]
type = "slider_link"
upper_bearing = "upper"
lower_bearing = "lower"

[friction.pump]
type = "pump"
torque = "8e-3 N m"

[bearings.upper]
type = "coulomb"
coefficient = 0.01
diameter = "16 mm"

[bearings.lower]
type = "coulomb"
coefficient = 0.01
diameter = "16 mm"
"""


@pytest.mark.parametrize("text", [ROD, SEVERAL, ROD + JOURNAL, LINK])
def test_an_old_file_is_refused_with_the_command_that_rewrites_it(text):
    with pytest.raises(SceneError, match=r"older spelling, today .*; `jaxcomp upgrade mine.toml`"):
        loads(text + COMMON, "mine.toml")
    loads(upgraded(text + COMMON))


def test_an_old_path_names_todays():
    with pytest.raises(SceneError, match=r"mechanism.crank_inertia.*today crankshaft.inertia"):
        with_value(load("mayekawa-wbhe"), "mechanism.crank_inertia", "1 kg m^2")


def test_comments_sources_and_order_stay():
    made = upgraded(SEVERAL + COMMON + JOURNAL)
    for kept in ("# of before", "# the linkage", "# by the maker", "# a vee", "# one bearing"):
        assert made.count(kept) == 1
    scene = loads(made)
    assert scene.sources["crankshaft.inertia"] == "printed, sheet 2"
    assert [line for line in made.splitlines() if line.startswith("[")] == [
        "[mechanism]", "[crankshaft]  # a vee", "[[crankshaft.throws]]", "[motor]", "[gas]",
        "[friction]", "[crankshaft.main_journal]",
    ]  # fmt: skip
    shaft = scene.compressor.crankshaft
    assert (shaft.count, float(shaft.mass), float(shaft.inertia)) == (2, 4.0, 8e-3)
    assert upgraded(made) == made


def test_a_slider_link_keeps_its_numbers():
    shaft = loads(upgraded(LINK + COMMON)).as_compressor().crankshaft
    assert float(shaft.unbalance) == pytest.approx(-1.2 * 0.6e-3, rel=1e-12)
    assert shaft.shaft_couple.tolist() == [1e-5, 0.0]
    assert float(shaft.origin) == 0.035
    assert shaft.main_journal.position.tolist() == pytest.approx([0.024, 0.066])
    assert shaft.main_journal.names == ("upper", "lower")
    assert float(shaft.main_journal.pump.torque) == 8e-3


def test_the_command_rewrites_a_file_and_keeps_the_old_one(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(ROD + COMMON)
    done = CliRunner().invoke(app, ["upgrade", str(file)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "mine.toml.old").read_text() == ROD + COMMON
    orbit = solve_orbit(load(file), Collocation(reversals=0))
    assert bool(orbit.converged)
    again = CliRunner().invoke(app, ["upgrade", str(file)])
    assert "has today's spelling already" in again.output
    inline = tmp_path / "inline.toml"
    inline.write_text('cylinders = { layout = "V90" }\n' + ROD + COMMON)
    refused = CliRunner().invoke(app, ["upgrade", str(inline)])
    assert refused.exit_code == 2
    assert "inline table" in refused.output


def test_a_bearing_with_an_orbit_is_a_film_whose_journal_moves():
    size = 'diameter = "90 mm"\nlength = "45 mm"\nradial_clearance = "45 um"\n'
    old = f'\n[friction.crank_pin]  # measured\ntype = "orbit"  # of 1998\n{size}'
    inline = 'bearings = { big-end = { type = "orbit", lands = 2 } }\n'
    made = upgraded(inline + old)
    assert made == (
        'bearings = { big-end = { type = "film", motion = "orbit", lands = 2 } }\n'
        '\n[friction.crank_pin]  # measured\ntype = "film"\nmotion = "orbit"  # of 1998\n' + size
    )
    assert upgraded(made) == made
    with pytest.raises(SceneError, match=r'friction.crank_pin.type.*"film" with motion = "orbit"'):
        loads(upgraded(ROD + COMMON) + old)
