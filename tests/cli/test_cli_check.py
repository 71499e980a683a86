"""`jaxcomp check`, help and completion: what a newcomer meets first."""

import os
import re
import subprocess
import sys

import pytest
import tomlkit
import typer
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp._core.registry import DESIGN_RULES
from jaxcomp.cli import app
from jaxcomp.cli._options import complete_machine
from jaxcomp.scene import (
    SceneError,
    describe,
    implausible_values,
    load,
    loads,
    machines,
    start,
    with_value,
)
from jaxcomp.scene._annotated import starts
from jaxcomp.study import design_rules

# Five faults in four sections; everything else is as `jaxcomp new` writes it.
FAULTS = {
    'bore = "50 mm"': 'bor = "50 mm"',
    'conrod_mass = "0.20 kg"': 'conrod_mass = "0.20 m"',
    'mean_speed = "1450 rpm"': 'mean_speed = "-1450 rpm"',
    "exponent = 1.3": "exponent = 0.7",
    "[friction.piston_pin]": "[friction.pistonpin]",
}
MESSAGES = {
    "mechanism.bor": 'is an unknown key; did you mean "bore"?',
    "mechanism.conrod_mass": 'has a unit of another dimension, "m"; it must be a text with a unit',
    "motor.mean_speed": "must be > 0 rad/s",
    "gas.exponent": "must be >= 1 and <= 3",
    "friction.pistonpin": 'is an unknown key; did you mean "piston_pin"?',
}


@pytest.fixture
def faulty(tmp_path):
    text = start("slider-crank", "faulty")
    for good, bad in FAULTS.items():
        assert text.count(good) == 1, good
        text = text.replace(good, bad)
    file = tmp_path / "faulty.toml"
    file.write_text(text)
    return str(file)


def invoke(*arguments):
    return CliRunner().invoke(app, list(arguments))


def test_all_errors_of_a_file_are_found(faulty):
    with pytest.raises(SceneError) as caught:
        load(faulty)
    found = {error.key: error for error in (caught.value, *caught.value.others)}
    assert list(found) == list(MESSAGES)
    for key, problem in MESSAGES.items():
        assert found[key].problem.startswith(problem)
        assert found[key].file == faulty
    assert found["mechanism.conrod_mass"].value == "0.20 m"


def test_check_lists_all_errors_and_leaves_with_2(faulty):
    result = invoke("check", faulty)
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert len(lines) == len(MESSAGES) + 1
    for line, (key, problem) in zip(lines, MESSAGES.items(), strict=False):
        assert line.startswith(f"error: {faulty}: {key}"), line
        assert problem in line
    assert lines[-1] == "5 errors"
    answer = read_json(invoke("check", faulty, "--json").stdout)
    assert not answer["ok"]
    assert [error["key"] for error in answer["errors"]] == list(MESSAGES)


def test_other_commands_tell_the_first_error_and_how_many_follow(faulty):
    result = invoke("run", faulty)
    assert result.exit_code == 2
    first, more = result.stderr.splitlines()
    assert "mechanism.bor" in first
    assert more == "and 4 more; `jaxcomp check FILE` lists them"


def test_a_misspelt_key_is_no_missing_key_as_well():
    text = start("slider-crank", "m").replace('bore = "50 mm"', "")
    with pytest.raises(SceneError, match=r"mechanism.bore: is missing") as caught:
        loads(text)
    assert caught.value.others == ()


def test_check_shows_parts_and_what_follows():
    result = invoke("check", "slider-link-8cc")
    assert result.exit_code == 0, result.stderr
    for text in ("friction", "suspension", "Swept volume", "7.9771", "Block on its springs"):
        assert text in result.stdout, text
    found = read_json(invoke("check", "hermetic-68cc", "--json").stdout)
    assert (found["ok"], found["unusual"]) == (True, [])
    crank, rotor = (
        ["run", "simulate", "animate", "compare", "sensitivity", "optimise", "sweep", "tolerance"],
        ["modes", "respond", "balance", "sensitivity", "optimise", "sweep", "tolerance"],
    )
    assert found["commands"] == list(dict.fromkeys(crank + rotor))
    assert "map" in read_json(invoke("check", "r134a-7cc", "--json").stdout)["commands"]
    follows = {row["what"]: row["value"] for row in found["follows"]}
    assert follows["Swept volume"] == pytest.approx(68, abs=0.01)  # printed: 68 cm3
    # 43 nodes, of which 17 follow the two bodies, with 4 each
    assert (follows["Nodes of the rotor model"], follows["Degrees of freedom"]) == (43, 104)
    assert found["parts"]["rotor"]["without_source"] == 0


# Identified, of ports whose size nobody knows: coefficients up to 1.7 stand for larger ones.
LARGER_PORTS = {
    "carlyle-06dm313": "discharge",
    "copeland-3db3-1000": "discharge",
    "copeland-crk3-0325": "suction",
}


def test_every_bundled_machine_has_usual_numbers():
    for name in (one.name for one in machines()):
        usual = {"mechanism"}
        if name in LARGER_PORTS:
            usual.add(f"gas.{LARGER_PORTS[name]}_valve.flow_coefficient")
        assert {one.path for one in implausible_values(load(name))} <= usual, name


def test_what_a_scene_leaves_out_is_one_line(tmp_path):
    whole = tomlkit.parse(start("slider-crank", "m"))
    assert "friction of all joints" not in said_by_check(tmp_path, whole)
    for section, words in (
        ("gas", "forces of the gas [gas]"),
        ("friction", "friction of all joints [friction]"),
    ):
        lacking = tomlkit.parse(tomlkit.dumps(whole))
        del lacking[section]
        assert words in said_by_check(tmp_path, lacking)
    for section, joint, what in (
        ("friction", "crank_pin", "crank pin"),
        ("crankshaft", "main_journal", "the shaft"),
    ):
        lacking = tomlkit.parse(tomlkit.dumps(whole))
        del lacking[section][joint]
        words = f"friction of {what} [{section}.{joint}]"
        assert words in said_by_check(tmp_path, lacking)
        assert "[gas]" not in said_by_check(tmp_path, lacking)


def said_by_check(folder, document):
    """The line on what is left out, which JSON has as well."""
    file = folder / "m.toml"
    file.write_text(tomlkit.dumps(document))
    lines = " ".join(invoke("check", str(file)).stdout.split())
    found = read_json(invoke("check", str(file), "--json").stdout)["left_out"]
    assert f"left out {', '.join(found)}" in lines
    return ", ".join(found)


def test_an_unusual_value_is_pointed_at_but_no_error():
    """Table 1 of Tsuji et al. has the rod's mass centre at 0.0857 mm, a thousandth of a usual one."""
    result = invoke("check", "mayekawa-wbhe")
    assert result.exit_code == 0
    assert "conrod_centre over rod length is 0.000286" in " ".join(result.stdout.split())
    assert implausible_values(load("mayekawa-wbhe-rod-centre")) == ()


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("mechanism.bore", "5 m"),
        ("motor.mean_speed", "1450 rad/s"),  # 13,800 rpm is usual enough; see the next entry
        ("motor.mean_speed", "14500 rad/s"),
        ("gas.suction_pressure", "1 Pa"),
        ("friction.wall.coefficient", 5.0),
        ("mechanism.conrod_inertia", "250 kg m^2"),
        ("mechanism.piston_mass", "25 kg"),  # in a bore of 50 mm
        ("gas.exponent", 2.5),
        ("gas.clearance_ratio", 5.0),
        ("friction.crank_pin.diameter", "5 m"),
    ],
)
def test_slips_of_a_unit_are_pointed_at(path, value):
    scene = with_value(loads(start("slider-crank", "m")), path, value)
    found = [doubt.path for doubt in implausible_values(scene)]
    assert bool(found) == (value != "1450 rad/s")
    assert all(path.startswith(name) or name == "gas" for name in found)


@pytest.mark.parametrize(
    ("arguments", "nearest"),
    [
        (["run", "mayekawa-wbeh"], '"mayekawa-wbhe"'),
        (["run", "mayekawa-wbhe", "--sett", "a=1"], "--set"),
        (["rnu", "mayekawa-wbhe"], "run"),
        (["run", "mayekawa-wbhe", "--set", "motr.mean_speed=800rpm"], '"motor"'),
        (["run", "mayekawa-wbhe", "--set", "motor.mean_sped=800rpm"], '"mean_speed"'),
        (["run", "mayekawa-wbhe", "--design", "boer=1m"], '"bore_at_displacement"'),
        (["sweep", "mayekawa-wbhe", "--over", "boer=1m:2m:3"], '"bore_at_displacement"'),
        (["optimise", "mayekawa-wbhe", "--variable", "motor.mean_sped=1rpm:2rpm"], '"motor.mean_'),
        (["respond", "hermetic-68cc", "--node", "gromets"], '"grommets"'),
        (
            [
                "optimise",
                "mayekawa-wbhe",
                "--variable",
                "bore_at_displacement=1cm:2cm",
                "--objective",
                "motor_pwer",
            ],
            '"motor_power"',
        ),
    ],
    ids=lambda value: " ".join(value[:4]) if isinstance(value, list) else "",
)
def test_the_nearest_known_name_is_offered(arguments, nearest):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert nearest in result.stderr


def test_a_missing_file_offers_the_one_beside_it(tmp_path):
    (tmp_path / "pump.toml").write_text(start("slider-crank", "pump"))
    result = invoke("check", str(tmp_path / "pmup.toml"))
    assert result.exit_code == 2
    assert "cannot be read: No such file" in result.stderr
    assert f'did you mean "{tmp_path / "pump.toml"}"?' in result.stderr


def commands():
    return typer.main.get_command(app).commands  # pyright: ignore


@pytest.mark.parametrize("name", sorted(commands()))
def test_help_of_every_command_has_an_example(name):
    text = commands()[name].help
    assert "Example: [bold]jaxcomp " + name in text


def test_every_command_stands_in_a_group_and_the_start_comes_first():
    result = invoke("--help")
    groups = [command.rich_help_panel for command in commands().values()]
    assert all(isinstance(group, str) for group in groups)
    assert result.stdout.index("First") < result.stdout.index("Studies of designs")
    assert "jaxcomp new my-machine.toml" in result.stdout


def complete(words: str, folder=None) -> list[str]:
    """What bash is offered after some words; fails if that starts JAX."""
    code = (
        "import sys, atexit\n"
        "atexit.register(lambda: print('JAX' if 'jax' in sys.modules else '', file=sys.stderr))\n"
        "from jaxcomp.cli import app\n"
        "app(prog_name='jaxcomp')"
    )
    environment = {
        **os.environ,
        "_JAXCOMP_COMPLETE": "complete_bash",
        "COMP_WORDS": f"jaxcomp {words}",
        "COMP_CWORD": str(len(words.split(" "))),
    }
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment, cwd=folder, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert "JAX" not in done.stderr
    return done.stdout.split("\n")[:-1]


def test_completion_knows_what_can_be_asked_and_what_can_be_varied():
    assert set(DESIGN_RULES) == set(design_rules)
    assert complete("run mayekawa-wbhe --design ") == [f"{name}=" for name in DESIGN_RULES]
    assert complete("sweep mayekawa-wbhe --quantity joint") == ["joint_margin"]
    assert complete("run mayekawa-wbhe --design bo") == ["bore_at_displacement="]
    assert "bore_at_displacement=" in complete("optimise mayekawa-wbhe --variable b")
    assert "motor.mean_speed=" in complete("optimise mayekawa-wbhe --variable mo")


def test_completion_knows_commands_machines_files_and_paths(tmp_path):
    (tmp_path / "mine.toml").write_text(start("slider-crank", "mine"))
    assert "optimise" in complete("opt")
    assert "mayekawa-wbhe" in complete("run may")
    assert complete("check mi", tmp_path) == ["mine.toml"]
    assert complete("run mine.toml --set motor.m", tmp_path) == ["motor.mean_speed="]
    assert "rotor.bodies.1.mass=" in complete("respond hermetic-68cc --set rotor.bodies.1.m")


def test_completed_machines_come_with_their_description():
    found = dict(complete_machine("slider-link"))
    assert "8 cm3" in found["slider-link-8cc"]


def test_a_film_that_nothing_loads_is_told(tmp_path):
    text = start("rotor", "films")
    mount = text.split("[rotor.links.law]")[1]
    law = mount[: mount.index("[[")]
    film = """
type = "film"
bearing = "front"

"""
    text = (
        text.replace(law, film, 1)
        + """
[bearings.front]
type = "film"
diameter = "24 mm"
length = "20 mm"
radial_clearance = "15 um"
dynamic_viscosity = "VG 32 at 60 degC"
"""
    )
    file = tmp_path / "films.toml"
    file.write_text(text)
    unusual = read_json(invoke("check", str(file), "--json").stdout)["unusual"]
    assert ["rotor.links.0.law.load" in row["path"] for row in unusual] == [True]
    answer = invoke("modes", str(file))
    assert answer.exit_code == 2
    assert "rotor.links.0.law.load` must be given, such as load" in " ".join(answer.output.split())


def test_an_unbalance_of_another_machine_is_unusual(tmp_path):
    text = start("slider-crank", "small")
    file = tmp_path / "small.toml"
    file.write_text(text.replace('"0.25 kg"', '"25 g"').replace('"0.20 kg"', '"20 g"'))
    unusual = read_json(invoke("check", str(file), "--json").stdout)["unusual"]
    assert any("unbalance of a throw" in row["what"] for row in unusual)


@pytest.mark.parametrize(("diameter", "shown"), [("60 mm", ""), ("100 mm", "is 1.25")])
def test_a_hole_wider_than_its_pipe_is_unusual(diameter, shown):
    """It has no loss, and the plate is as good as absent."""
    hole = {"nodes": ["flange", "bottle"], "diameter": diameter}
    scene = with_value(loads(start("pipes", "m")), "gas.suction.piping.orifices", [hole])
    found = [row.what for row in implausible_values(scene) if "orifice" in row.what]
    assert bool(found) == bool(shown)
    assert all(shown in what for what in found)


def test_check_tries_another_value():
    heavy = "check", "mayekawa-wbhe", "--set", "mechanism.piston_mass=2500kg"
    assert "mechanism.piston_mass: 2500kg, usual is" in invoke(*heavy).stdout
    answer = invoke(*heavy[:3], "mechanism.piston_mass=-1kg", "--json")
    assert answer.exit_code == 2
    [error] = read_json(answer.stdout)["errors"]
    assert error["key"] == "mechanism.piston_mass"
    assert error["problem"].startswith("must be >= 0")


def test_check_says_how_several_cylinders_fire():
    result = CliRunner().invoke(app, ["check", "mayekawa-6wbhe"], env={"COLUMNS": "240"})
    assert result.exit_code == 0, result.output
    rows = {
        name: line.split(name, 1)[1].split()
        for line in result.output.splitlines()
        for name in ("Cylinders ", "Between top dead centres", "Rods outside the main bearings")
        if name in line
    }
    assert rows["Cylinders "] == ["6"]
    assert rows["Between top dead centres"] == ["60", "deg", "even"]
    assert rows["Rods outside the main bearings"] == ["0"]
    assert "stand at -60°, 0°, 60° from x, counted with rotation" in result.output
    assert "animate" in result.output


def test_values_that_are_still_those_of_the_template_are_counted(tmp_path):
    file = tmp_path / "m.toml"
    file.write_text(start("slider-crank", "m"))
    rows = [row for row in describe(loads(file.read_text())) if row.given is not None]
    given = len([row for row in rows if not row.path.endswith(".type")])
    found = read_json(invoke("check", str(file), "--json").stdout)
    assert found["examples"] == given
    assert f"{given} values are examples" in invoke("check", str(file)).stdout
    own = file.read_text().replace('"50 mm"', '{ value = "52 mm", source = "drawing 17" }')
    file.write_text(own)
    assert read_json(invoke("check", str(file), "--json").stdout)["examples"] == given - 1
    assert "examples" not in invoke("check", "mayekawa-wbhe").stdout


@pytest.mark.parametrize("kind", starts())
def test_a_template_does_not_tell_sizes_that_are_edited(kind):
    assert not re.search(r"\d", loads(start(kind, "m")).description)
