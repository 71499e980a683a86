"""`jaxcomp bearing`: numbers against the library and published tables, pictures, errors."""

import json
import math

import numpy as np
import pytest
from helpers import drawn_once, read_json
from typer.testing import CliRunner

from jaxcomp import JournalBearing
from jaxcomp.cli import app
from jaxcomp.film import AsperityContact, iso_vg_viscosity, reference_solution, steady_bearing
from jaxcomp.film._bearing import friction_moment

GIVEN = {
    "length": "20 mm",
    "diameter": "40 mm",
    "clearance": "30 um",
    "viscosity": "5 mPa*s",
    "speed": "3000rpm",
    "load": "500 N",
}
REQUIRED = {
    "eccentricity_ratio",
    "attitude_angle",
    "sommerfeld_number",
    "phi_p",
    "phi_t",
    "friction_torque",
    "minimum_film",
    "peak_pressure",
    "stiffness",
    "damping",
    "dimensionless_stiffness",
    "dimensionless_damping",
}


def run(*arguments, **changes):
    options = [
        part
        for name, value in (GIVEN | changes).items()
        if value is not None
        for part in (f"--{name}", value)
    ]
    return CliRunner().invoke(app, ["bearing", *options, *arguments])


def found(*arguments, **changes):
    result = run("--json", *arguments, **changes)
    assert result.exit_code == 0, result.output
    return read_json(result.stdout)


def test_python_gives_what_the_command_prints():
    printed = json.loads(run("--json", "--roughness", "0.3um", "--boundary-friction", "0.1").stdout)
    rough = JournalBearing(0.04, 0.02, 30e-6, 5e-3, contact=AsperityContact(0.3e-6, 0.1))
    made = json.loads(steady_bearing(rough, 500.0, 100 * math.pi).to_json())
    assert printed.pop("model") == made["film"]
    assert printed.keys() == made.keys()
    for key, value in made.items():
        if isinstance(value, float):
            assert printed[key] == pytest.approx(value, rel=1e-9), key


def load_at(sommerfeld):
    """Load [N] of the bearing above at a Sommerfeld number, by its definition."""
    return f"{5e-3 * 50 * 0.02 * 0.04 * (20 / 0.03) ** 2 / sommerfeld!r} N"


def test_numbers_are_those_of_raimondi_and_boyd():
    # L/D = 1/2, eps = 0.6: S = 0.319, phi = 48.14 degrees, (R/c) f = 8.10
    numbers = found(load=load_at(0.319))
    assert numbers.keys() >= REQUIRED
    assert numbers["sommerfeld_number"] == pytest.approx(0.319, rel=1e-12)
    # their scatter: 2 % in S, so 0.005 in eps; 0.8 degrees; 1.5 % in f
    assert numbers["eccentricity_ratio"] == pytest.approx(0.6, abs=0.005)
    assert math.degrees(numbers["attitude_angle"]) == pytest.approx(48.14, abs=0.8)
    assert numbers["phi_t"] / numbers["phi_p"] == pytest.approx(8.10, rel=0.015)
    load, radius, gap = numbers["load"], 0.02, 30e-6
    friction = numbers["friction_torque"] / (load * radius)
    assert friction * radius / gap == pytest.approx(8.10, rel=0.015)
    assert numbers["minimum_film"] == pytest.approx(gap * (1 - numbers["eccentricity_ratio"]))
    # on finer grids: 1e-5 between them
    solved = reference_solution(numbers["eccentricity_ratio"], 0.5, coefficients=False)
    unit = 5e-3 * 100 * math.pi / (gap / radius) ** 2
    assert numbers["peak_pressure"] / unit == pytest.approx(solved.peak_pressure, rel=1e-4)
    flow = solved.side_flow * gap * radius * 100 * math.pi * 0.02
    assert numbers["side_flow"] == pytest.approx(flow, rel=1e-3)
    for name, scale in (("stiffness", load / gap), ("damping", load / gap / (100 * math.pi))):
        parts = np.array(numbers[name]), np.array(numbers[f"dimensionless_{name}"]) * scale
        np.testing.assert_allclose(*parts, rtol=1e-9)
        assert parts[0].shape == (2, 2)
    assert "x along the load" in numbers["frame"]


def test_grooved_model_is_someyas():
    # L/D = 0.5, S = 0.517: eps = 0.5, c K/W and c omega C/W within 5 % of the largest entry
    numbers = found("--model", "grooved", load=load_at(0.517))
    assert numbers["eccentricity_ratio"] == pytest.approx(0.5, abs=0.005)
    k, c = numbers["dimensionless_stiffness"], numbers["dimensionless_damping"]
    np.testing.assert_allclose(k, [[2.89, 3.57], [-0.924, 2.03]], atol=0.05 * 3.57)
    np.testing.assert_allclose(c, [[6.81, 2.10], [2.10, 2.60]], atol=0.05 * 6.81)


def test_reverse_rotation_is_the_mirror_image():
    forth, back = found(), found(speed="-3000rpm")
    assert back["friction_torque"] == -forth["friction_torque"]
    # the frame turns with the rotation, so that its numbers stay
    assert back["stiffness"] == forth["stiffness"]
    assert back["eccentricity_ratio"] == forth["eccentricity_ratio"]


@pytest.mark.parametrize("model", ["guembel", "short", "fit", "petroff", "loaded_petroff"])
def test_every_model_has_the_same_keys_and_its_limits(model):
    numbers = found("--model", model)
    assert numbers.keys() >= REQUIRED
    assert numbers["phi_t"] >= math.pi
    table = run("--model", model)
    assert table.exit_code == 0
    words = " ".join(table.stdout.split())
    assert " ".join(numbers["limits"].split()) in words
    if model in ("fit", "petroff", "loaded_petroff"):
        assert numbers["stiffness"] is None
        assert numbers["peak_pressure"] is None
    else:
        # pressure of a film 20 x 40 mm under 500 N: above its mean, far below ten times that
        assert 1 < numbers["peak_pressure"] / (500 / 8e-4) < 10


def test_pictures_and_result(tmp_path):
    folder = tmp_path / "new" / "folder"
    result = run("--out", str(folder))
    assert result.exit_code == 0
    assert "Minimum film" in result.stdout
    names = {path.name for path in folder.iterdir()}
    # what is there only with further packages
    names -= {"interactive.html", "results.xlsx", ".jaxcomp.json"}
    assert names == {"pressure.png", "coefficients.png", "result.json", "report.html"}
    for name in ("pressure.png", "coefficients.png"):
        assert (folder / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert (folder / name).stat().st_size > 10_000
    assert read_json((folder / "result.json").read_text()).keys() >= REQUIRED


@pytest.mark.parametrize("load", ["0 N", "1e-6 N", "1e9 N"])
def test_extreme_loads(load, tmp_path, monkeypatch):
    drawn_once(monkeypatch)
    numbers = found("--out", str(tmp_path), load=load)
    assert 0 <= numbers["eccentricity_ratio"] <= 1
    assert 0 < numbers["minimum_film"] <= 30e-6
    assert np.all(np.isfinite(numbers["stiffness"]))
    assert (tmp_path / "pressure.png").exists()
    if load == "0 N":
        assert numbers["sommerfeld_number"] is None
        assert numbers["dimensionless_stiffness"] is None
        assert numbers["peak_pressure"] == 0
        assert numbers["phi_t"] == pytest.approx(math.pi, rel=1e-12)
    if load == "1e9 N":
        # thin zone: Phi_p (1 - eps) -> 1.2237, its pressure 1.07545/(1 - eps)^1.5, which was solved
        # at 1 - eps = 1e-4; the next terms are of order sqrt(1 - eps)/(L/D), 2e-3 and 2e-2
        closeness = numbers["minimum_film"] / 30e-6
        assert numbers["phi_p"] * closeness == pytest.approx(1.2237, rel=4e-3)
        unit = 5e-3 * 100 * math.pi / (30e-6 / 0.02) ** 2
        assert numbers["peak_pressure"] / unit * closeness**1.5 == pytest.approx(1.07545, rel=4e-3)


def test_viscosity_by_grade_and_temperature():
    expected = float(iso_vg_viscosity(46, 333.15))
    for text in ("VG 46 at 60 degC", "ISO VG 46 @ 60 °C", "vg46 60C", "VG 46, 333.15 K"):
        numbers = found("--model", "petroff", viscosity=text)
        assert numbers["viscosity"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length": "20"}, '--length = "20": lacks its unit'),
        ({"clearance": "3 kg"}, "--clearance"),
        ({"clearance": "-30 um"}, "--clearance -3e-05 m: must be > 0 m"),
        ({"clearance": "20 mm"}, "--clearance 0.02 m: must be < 0.02 m, the radius"),
        ({"viscosity": "0 Pa s"}, "--viscosity 0 Pa s: must be > 0 Pa s"),
        ({"viscosity": "VG 46"}, 'temperature of an oil, as "VG 46 at 60 degC"'),
        (
            {"viscosity": "VG 46 at -120 degC"},
            '--viscosity = "VG 46 at -120 degC": needs a temperature > 178.15',
        ),
        ({"viscosity": "VG 0 at 40 degC"}, '--viscosity = "VG 0 at 40 degC": needs a grade > 0'),
        ({"speed": "0rpm"}, "--speed 0 rad/s: must not be 0 rad/s"),
        ({"speed": "nan rpm"}, "must be finite"),
        ({"load": "-1 N"}, "--load -1 N: must be >= 0 N"),
        ({"length": "100 mm"}, "must be 0.1 to 2 for the model reynolds, but is 2.5"),
        ({"model": "magic"}, "Invalid value for '--model'"),
        ({"model": "reynold"}, 'did you mean "reynolds"'),
        ({"model": "ocvrik"}, 'did you mean "short", Ocvirk'),
        ({"load": None}, "Missing option '--load'"),
    ],
)
def test_errors_go_to_stderr_with_code_2(changes, message):
    result = run(**changes)
    assert result.exit_code == 2
    assert result.stdout == ""
    # within a frame that breaks lines
    assert message in " ".join(result.stderr.replace("│", " ").split())
    assert "Traceback" not in result.output


def test_help_has_an_example():
    result = CliRunner().invoke(app, ["bearing", "--help"])
    assert result.exit_code == 0
    assert "Example: jaxcomp bearing --length 20mm" in result.stdout


# ---------------------------------------------------------------- rough surfaces, over the speed
ROUGH = ("--roughness", "0.5 um", "--boundary-friction", "0.1")


def test_a_contact_carries_and_rubs():
    smooth, rough = found(speed="100rpm"), found(*ROUGH, speed="100rpm")
    assert smooth["contact_load"] is smooth["contact_torque"] is None
    assert rough["minimum_film"] > smooth["minimum_film"]
    assert 0 < rough["contact_torque"] < rough["friction_torque"]
    assert rough["contact_roughness"] == 0.5e-6
    assert rough["contact_modulus"] == 115e9
    bearing = JournalBearing(0.04, 0.02, 30e-6, 5e-3, contact=AsperityContact(0.5e-6, 0.1))
    torque = float(friction_moment(bearing, 500.0, 100 * math.pi / 30, rest_speed=0.0))
    assert rough["friction_torque"] == pytest.approx(torque, rel=1e-9)


def test_the_curve_of_stribeck_is_printed_drawn_and_written(tmp_path):
    over = ("--over", "speed=log:20rpm:3000rpm:40")
    numbers = found(*ROUGH, *over, "--out", str(tmp_path), speed=None)
    assert len(numbers["speed"]) == 40
    least = numbers["least_friction_speed"]
    assert numbers["speed"][0] < least < numbers["speed"][-1]
    assert (tmp_path / "stribeck.png").stat().st_size > 10_000
    rows = np.genfromtxt(tmp_path / "stribeck.csv", delimiter=",", names=True)
    np.testing.assert_allclose(rows["friction_torque_N_m"], numbers["friction_torque"], rtol=1e-12)
    printed = run(*ROUGH, *over, speed=None)
    assert printed.exit_code == 0, printed.output
    assert f"Least friction at {least * 30 / math.pi:.4g} rpm" in printed.output


@pytest.mark.parametrize(
    ("arguments", "changes", "words"),
    [
        (("--over", "speed=20rpm:3000rpm:4"), {}, "--speed: cannot be combined with --over"),
        ((), {"speed": None}, "Missing option '--speed'"),
        (("--over", "load=1N:2N:3"), {"speed": None}, "form speed=FROM:TO:COUNT"),
        (("--over", "speed=0rpm:300rpm:3"), {"speed": None}, "must be > 0"),
        (("--roughness", "0.5 um"), {}, "Missing option '--boundary-friction'"),
        (("--modulus", "60 GPa"), {}, "Missing option '--roughness'"),
        (("--roughness", "5 um", "--boundary-friction", "0.1"), {}, "12 times the roughness"),
        ((*ROUGH, "--model", "petroff"), {}, "beside a contact"),
    ],
)
def test_what_the_options_of_a_contact_refuse(arguments, changes, words):
    result = run(*arguments, **changes)
    assert result.exit_code != 0
    assert words in " ".join(result.output.split())
