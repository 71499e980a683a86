"""What a newcomer meets first: help that can be copied, and messages that lead on."""

import subprocess
import sys

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from jaxcomp.cli import app
from jaxcomp.cli._app import _flowing
from jaxcomp.scene import SceneError, load, start, with_values
from jaxcomp.scene.measurements import read_measurements

HEADER = "run,target,speed [rpm],amplitude [um],phase [deg],trial [g mm],angle [deg]"
RUNS = f"""{HEADER}
initial,A,1500,25.6362,8.899,,
front,A,1500,35.2782,-4.743,100,0
"""


def help_of(command: str) -> list[str]:
    shown = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "80"})
    assert shown.exit_code == 0
    return [line.strip() for line in shown.stdout.splitlines()]


def test_a_paragraph_of_help_is_one_line_and_a_table_keeps_its_lines():
    assert _flowing("One.\n\n    a b\n    c\n\n        1,2\n        3,4\n") == (
        "One.\n\na b c\n\n1,2\n3,4"
    )


def test_every_argument_and_option_says_what_it_is():
    """Those of a command alone stand in its docstring, from where they are read."""
    for name, command in get_command(app).commands.items():
        for parameter in command.params:
            assert parameter.help, f"{name}: {parameter.name}"


def test_help_of_balance_shows_the_table_that_it_reads(tmp_path):
    lines = help_of("balance")
    first = next(i for i, line in enumerate(lines) if line.startswith("run,target,"))
    path = tmp_path / "runs.csv"
    path.write_text("\n".join(lines[first : first + 3]))
    measured = read_measurements(path)
    assert measured.planes == ("plane-1",)
    assert measured.unit == "mm/s"


def test_examples_of_help_are_broken_only_by_the_terminal():
    paragraphs = [p for one in app.registered_commands for p in str(one.help).split("\n\n")]
    examples = [p for p in paragraphs if p.startswith("Example")]
    assert len(examples) == len(app.registered_commands)
    assert not [example for example in examples if "\n" in example]


def test_the_package_runs_as_a_module():
    command = [sys.executable, "-m", "jaxcomp", "--version"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True)
    assert shown.stdout.startswith("jaxcomp ")


def test_an_unknown_header_is_answered_with_a_right_one(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text(RUNS.replace("target", "sensor"))
    with pytest.raises(SceneError, match="sensor") as error:
        read_measurements(path)
    header = str(error.value).split('"')[1]
    path.write_text(RUNS.replace(HEADER, header))
    assert read_measurements(path).planes == ("front",)


def test_semicolons_and_decimal_commas_are_read_alike(tmp_path):
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(RUNS)
    other.write_text(RUNS.replace(",", ";").replace(".", ","))
    one, two = (read_measurements(path) for path in (plain, other))
    assert one.rows == two.rows
    # the same digits are read
    np.testing.assert_array_equal(one.matrix, two.matrix)
    np.testing.assert_array_equal(one.initial, two.initial)


def test_a_number_without_its_section_is_recognised():
    scene = load("mayekawa-wbhe")
    with pytest.raises(SceneError, match=r'did you mean "mechanism\.conrod_length"\?'):
        with_values(scene, {"conrod_length": "80 mm"})
    with pytest.raises(SceneError, match=r'"friction\.wall\.coefficient" or "friction\.piston'):
        with_values(scene, {"coefficient": 0.1})


def test_a_file_without_its_ending_is_recognised(tmp_path):
    (tmp_path / "pump.toml").write_text(start("slider-crank", "pump"))
    with pytest.raises(SceneError, match=r'did you mean "\S*pump\.toml"\?'):
        load(tmp_path / "pump")


def test_design_variables_of_other_mechanisms_are_not_offered():
    shown = CliRunner().invoke(app, ["run", "mayekawa-wbhe", "--design", "stroke=60mm"])
    assert shown.exit_code == 2
    assert "stroke_bore_ratio" in shown.stderr
    assert "piston_clearance" not in shown.stderr


def test_names_of_contributors_are_not_broken():
    name = "crankshaft.main_journal.coefficient"
    words = ["mayekawa-wbhe", "--quantity", "swept_volume", "--samples", "64", "--vary"]
    words += [f"{name}=+-10 %", "--vary", "mechanism.bore=+-0.1 mm", "--curvature", "none"]
    shown = CliRunner().invoke(app, ["tolerance", *words], env={"COLUMNS": "80"})
    words = " ".join(shown.stdout.split())  # the name of the part, wrapped between words alone
    assert "friction of main 0.0 %" in words
    assert "journal" in words
    assert max(map(len, shown.stdout.splitlines())) <= 80


def test_help_begins_with_the_commands_that_one_needs_first():
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"}).stdout
    known = set(get_command(app).list_commands(None))  # pyright: ignore
    starts = (line.strip("│ ").partition(" ")[0] for line in shown.splitlines())
    names = [name for name in starts if name in known]
    assert set(names) == known
    assert names[:8] == ["new", "check", "run", "desk", "map", "compare", "optimise", "explain"]
    assert names[-3:] == ["accuracy", "schema", "cache"]
