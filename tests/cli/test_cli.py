"""The command line: tables, JSON, files, errors, the compilation cache."""

import os
import re
import subprocess
import sys

import pytest
import typer
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import Collocation, solve_orbit
from jaxcomp.cli import app
from jaxcomp.cli._arguments import assignments, entry
from jaxcomp.cli._start import CommandError
from jaxcomp.scene import implausible_values, load, with_value
from jaxcomp.study import with_bore

REQUIRED = {
    "mechanical_efficiency": float,
    "motor_work": float,
    "gas_work": float,
    "losses": dict,
    "speed_fluctuation": float,
    "mean_speed": float,
    "energy_residual": float,
    "converged": bool,
    "solver": str,
}


def invoke(*arguments):
    return CliRunner().invoke(app, list(arguments))


def run(*arguments):
    return invoke("run", "mayekawa-wbhe", *arguments)


def test_list_shows_the_machines():
    result = invoke("list")
    assert result.exit_code == 0
    assert "mayekawa-wbhe-rod-centre" in result.stdout
    known = read_json(invoke("list", "--json").stdout)["machines"]
    assert {"mayekawa-wbhe", "mayekawa-wbhe-rod-centre"} <= {m["name"] for m in known}
    assert all(m["description"] for m in known)


def test_lines_in_a_pipe_are_as_long_as_they_need(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    described = {m["description"] for m in read_json(invoke("list", "--json").stdout)["machines"]}
    lines = invoke("list").stdout.splitlines()
    assert max(map(len, described)) > 80
    assert all(any(line.rstrip().endswith(one) for line in lines) for one in described)
    # titles as well, which are wider than their tables
    title = "mayekawa-8wbhe: 8 cylinders of mayekawa-wbhe in VV45 on two throws; layout and shaft assumed"
    assert title in invoke("check", "mayekawa-8wbhe").stdout.splitlines()


def test_list_shows_the_fluids():
    assert "Tillner-Roth, Baehr (1994)" in invoke("list", "fluids").stdout
    known = read_json(invoke("list", "fluids", "--json").stdout)["fluids"]
    assert {"R134a", "R600a", "R717", "air"} <= {fluid["name"] for fluid in known}


def test_list_of_one_machine_shows_values_and_sources():
    result = invoke("list", "mayekawa-wbhe")
    assert result.exit_code == 0
    assert "mechanism.bore" in result.stdout
    values = read_json(invoke("list", "mayekawa-wbhe", "--json").stdout)["values"]
    assert values["mechanism.bore"] == {
        "value": 0.13,
        "unit": "m",
        "given": "130 mm",
        "source": "printed, Table 1",
        "doc": "piston diameter",
    }


def test_json_is_one_object_with_the_numbers_of_the_library():
    result = run(
        "--json", "--set", "motor.mean_speed=800rpm", "--design", "bore_at_displacement=120mm"
    )
    assert result.exit_code == 0, result.stderr
    found = read_json(result.stdout)
    for key, kind in REQUIRED.items():
        assert isinstance(found[key], kind), key
    assert set(found["losses"]) == {"wall", "piston_pin", "crank_pin", "main_journal"}
    machine = with_bore(
        with_value(load("mayekawa-wbhe"), "motor.mean_speed", "800 rpm").compressor, 0.12
    )
    orbit = solve_orbit(machine, Collocation())
    assert found["mechanical_efficiency"] == pytest.approx(float(orbit.mechanical_efficiency))
    assert found["losses"]["wall"] == pytest.approx(float(orbit.energy.losses["wall"]))
    assert found["mean_speed"] == pytest.approx(83.7758, rel=1e-6)
    assert found["gas_work"] + sum(found["losses"].values()) == pytest.approx(found["motor_work"])
    assert abs(found["energy_residual"]) < 1e-10
    assert (found["converged"], found["solver"]) == (True, "collocation")
    assert found["set"] == {"motor.mean_speed": "800rpm"}
    assert found["design"] == {"bore_at_displacement": "120mm"}


@pytest.mark.parametrize(
    ("change", "remark"),
    [("gas.clearance_ratio=2", "No gas flows"), ("gas=none", "There is no gas")],
)
def test_a_machine_that_delivers_nothing_has_no_efficiency(change, remark):
    shown = run("--set", change)
    assert shown.exit_code == 0
    assert remark in shown.stdout
    assert re.search(r"Mechanical efficiency +none", shown.stdout)
    if change != "gas=none":
        checked = read_json(invoke("check", "mayekawa-wbhe", "--json").stdout)
        assert not [d for d in checked["unusual"] if "discharge valve" in d["what"]]
        scene = with_value(load("mayekawa-wbhe"), "gas.clearance_ratio", 2)
        assert [d for d in implausible_values(scene) if "without a discharge valve" in d.what]


def test_table_shows_efficiency_losses_forces_and_evidence():
    result = run()
    assert result.exit_code == 0, result.stderr
    found = read_json(run("--json").stdout)
    for text in (
        f"{100 * found['mechanical_efficiency']:.2f} %",
        f"{found['losses']['crank_pin']:.4g}",
        f"{found['peak_forces']['piston_pin'] / 1e3:.4g}",
        "Energy closure",
        "1000 rpm",
        "130 x 99.98 mm",
    ):
        assert text in result.stdout, text


def test_out_writes_pictures_result_and_scene(tmp_path):
    folder = tmp_path / "a" / "b"
    result = run("--out", str(folder), "--design", "bore_at_displacement=120mm")
    assert result.exit_code == 0, result.stderr
    names = {"pv_diagram", "speed", "torques", "joint_forces", "joint_friction", "losses"}
    names |= {"bearing_loads", "shaking_force"}
    assert {f.stem for f in folder.glob("*.png")} == names
    written = read_json((folder / "result.json").read_text())
    # the scene as it was run gives the same result again
    again = invoke("run", str(folder / "machine.toml"), "--json")
    found = read_json(again.stdout)
    assert found["mechanical_efficiency"] == pytest.approx(written["mechanical_efficiency"], 1e-14)
    assert (
        load(folder / "machine.toml").sources["mechanism.bore"]
        == "design rule, bore_at_displacement = 120mm"
    )


# joints of the cylinder, and the bearing of the shaft
IDEAL = ("--set", "friction=none", "--set", "crankshaft.main_journal=none")


def test_frictionless_joints_lose_nothing():
    found = read_json(run("--json", *IDEAL).stdout)
    assert found["losses"] == dict.fromkeys(found["losses"], 0.0)
    assert len(found["losses"]) == 4
    assert found["mechanical_efficiency"] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "mayekawa"], 'did you mean "mayekawa-wbhe"?'),
        (["run", "nowhere/none.toml"], "nowhere/none.toml: cannot be read: No such file"),
        (["list", "mayekawa"], 'did you mean "mayekawa-wbhe"?'),
        (["run", "mayekawa-wbhe", "--set", "motor.mean_speed"], 'must have the form "name=value"'),
        (
            ["run", "mayekawa-wbhe", "--set", "motor.mean_speed=80"],
            "motor.mean_speed = 80: lacks its",
        ),
        (["run", "mayekawa-wbhe", "--set", "motor.mean_speed=0rpm"], "must be > 0 rad/s"),
        (["run", "mayekawa-wbhe", "--set", "motr.mean_speed=8rpm"], 'did you mean "motor"?'),
        (
            ["run", "mayekawa-wbhe", "--set", "mechanism.stroke=80mm"],
            'did you mean "crank_radius", half the stroke?',
        ),
        (["run", "mayekawa-wbhe", "--set", "mechanism.piston_mass=-1kg"], "must be >= 0 kg"),
        (["run", "mayekawa-wbhe", "--set", "mechanism.offset=300mm"], "crank_radius + |offset| <"),
        (
            ["run", "mayekawa-wbhe", "--set", "gas.discharge_pressure=1kPa"],
            "must be a cycle with discharge_pressure > suction_pressure",
        ),
        (
            ["run", "mayekawa-wbhe", "--design", "bore_at_displacement=-1mm"],
            "`bore_at_displacement` must be > 0 and <= 10 m, but is -0.001",
        ),
        (
            ["run", "mayekawa-wbhe", "--design", "bore_at_displacement=12"],
            "bore_at_displacement = 12: lacks its unit",
        ),
        (
            ["run", "mayekawa-wbhe", "--design", "bor=1mm"],
            'no design rule; did you mean "mechanism.bore", the bore alone, or "bore_at_displacement"',
        ),
        (["run", "mayekawa-wbhe", "--tolerance", "0"], "--tolerance 0: must be > 0 and < 1"),
        (["run", "mayekawa-wbhe", "--tolerance", "nan"], "--tolerance nan: must be > 0 and < 1"),
        (
            [
                "run",
                "mayekawa-wbhe",
                "--solver",
                "collocation",
                "--set",
                "friction.wall.coefficient=9",
            ],
            "the friction locks the joints",
        ),
        (["run", "mayekawa-wbhe", "--solver", "magic"], "--solver magic: must be collocation"),
        (["run"], "Missing argument"),
    ],
)
def test_errors_go_to_stderr_with_code_2(arguments, message):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert message in result.stderr
    assert "Traceback" not in result.output
    if result.stderr.startswith("error: "):
        assert result.stderr.count("\n") == 1


@pytest.mark.slow
def test_stalling_motor_is_an_error():
    motor = ["--set", "motor.type=constant_torque", "--set", "motor.level=1 N m"]
    result = run(*motor)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")


def test_output_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    result = run("--out", str(tmp_path / "file"))
    assert result.exit_code == 2
    assert "error: " in result.stderr


def test_help_has_an_example_for_every_command():
    for command in ("run", "list"):
        result = invoke(command, "--help")
        assert result.exit_code == 0
        assert f"Example: jaxcomp {command} mayekawa-wbhe" in result.stdout
    assert "jaxcomp 0." in invoke("--version").stdout


def test_help_swallows_no_unit():
    """What stands in square brackets in a command's docstring is shown, and not taken as a style."""
    group = typer.main.get_command(app)
    for name, command in group.commands.items():
        texts = [command.help or "", *(getattr(one, "help", None) or "" for one in command.params)]
        for text in texts:
            for style in re.findall(r"(?<!\\)\[([a-z][^\]]*)\]", text):
                assert style in ("bold", "link", "dim"), f"{name}: [{style}] needs a backslash"


def test_entries_of_the_command_line():
    assert entry("800rpm") == "800rpm"
    assert entry("0.02") == 0.02
    assert entry("true") is True
    assert entry('["1 m", "2 m"]') == ["1 m", "2 m"]
    assert entry("none") is None
    assert assignments(["a.b = 1 mm"], "--set") == {"a.b": "1 mm"}
    with pytest.raises(CommandError, match="a is set twice"):
        assignments(["a=1", "a=2"], "--set")


def test_help_waits_for_no_library_of_the_edge():
    """Pictures and units are imported by those who draw and read."""
    code = (
        "import sys, jaxcomp.cli;"
        "loaded = {m.partition('.')[0] for m in sys.modules};"
        "sys.exit(bool(loaded & {'matplotlib', 'pint', 'platformdirs'}))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


COUNT = """
import sys, jax.monitoring
events = []
jax.monitoring.register_event_listener(lambda event, **_: events.append(event))
jax.monitoring.register_event_duration_secs_listener(lambda event, *_, **__: events.append(event))
from jaxcomp.cli import main
sys.argv = ["jaxcomp", *sys.argv[1:]]
try:
    main()
except SystemExit as error:
    assert not error.code
print(sum(event.endswith("cache_hits") for event in events), file=sys.stderr)
"""


def started(folder, *arguments):
    """Run the program in a fresh process; programs that it compiled and kept, and found kept."""
    before = {path.name for path in folder.rglob("*") if path.is_file()}
    environment = os.environ | {"JAXCOMP_CACHE": str(folder)}
    environment.pop("EQX_ON_ERROR", None)
    command = [sys.executable, "-c", COUNT, "run", "mayekawa-wbhe", "--json", *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    after = {path.name for path in folder.rglob("*") if path.is_file()}
    return len(after - before), int(done.stderr.split()[-1]), read_json(done.stdout)


def test_second_start_compiles_nothing(tmp_path):
    # without friction the program is small
    options = IDEAL
    compiled, _, first = started(tmp_path, *options)
    assert compiled > 0
    # another value is no other program
    compiled, hits, second = started(tmp_path, *options, "--set", "motor.mean_speed=900rpm")
    assert compiled == 0
    assert hits > 0
    assert first["mean_speed"] > second["mean_speed"]


@pytest.mark.slow
def test_second_start_compiles_nothing_with_shooting(tmp_path):
    first, _, _ = started(tmp_path, "--solver", "shooting")
    assert first > 0
    compiled, hits, found = started(tmp_path, "--solver", "shooting")
    assert compiled == 0
    assert hits > 0
    assert found["solver"] == "shooting"


@pytest.mark.slow
def test_shooting_agrees_with_the_default():
    found = read_json(run("--solver", "shooting", "--json").stdout)
    assert found["solver"] == "shooting"
    other = read_json(run("--json").stdout)
    assert other["solver"] == "collocation"
    assert found["mechanical_efficiency"] == pytest.approx(other["mechanical_efficiency"], abs=1e-6)
