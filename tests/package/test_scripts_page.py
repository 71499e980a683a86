"""The page for programs that call the command line: what it says of JSON, codes and statuses holds."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jaxcomp._core.status import status_names
from jaxcomp.cli import app
from jaxcomp.cli._optimise import _NOT_FEASIBLE
from jaxcomp.cli._start import STOPPED

PAGE = (Path(__file__).parents[2] / "notebooks" / "scripts.md").read_text("utf-8")
COMMANDS = {command.name for command in app.registered_commands}


def call(*arguments):
    return CliRunner().invoke(app, arguments)


def rows(heading):
    """First cells of the table below a heading, as the names in backquotes or as they stand."""
    section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| ")][1:]
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell) or [cell.strip()]]


def test_every_status_has_a_row_and_no_other():
    assert sorted(rows("Statuses")) == sorted([*status_names(), "failed"])


def test_exit_codes_are_those_of_the_program():
    codes = [int(code) for row in rows("Exit codes") for code in row.split(",")]
    assert codes == [0, 2, _NOT_FEASIBLE, STOPPED, 128 + 15]
    assert call("check", "mayekawa-wbhe", "--json").exit_code == 0
    wrong = call("run", "mayekawa-wbhe", "--set", "motor.men_speed=800rpm", "--json")
    assert wrong.exit_code == 2
    assert wrong.stdout == ""
    assert re.fullmatch(r"error: .*did you mean \"mean_speed\"\?\n", wrong.stderr)


def test_a_reader_that_leaves_early_ends_a_command_without_words():
    command = [sys.executable, "-m", "jaxcomp", "list", "mayekawa-wbhe"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as process:
        process.stdout.close()
        assert (process.wait(), process.stderr.read()) == (1, b"")


def test_check_answers_in_json_what_is_wrong(tmp_path):
    good = json.loads(call("check", "mayekawa-wbhe", "--json").stdout)
    assert good["ok"] is True
    assert "unusual" in good
    file = tmp_path / "machine.toml"
    call("new", str(file), "--from", "mayekawa-wbhe")
    file.write_text(file.read_text().replace("bore = ", "boar = ", 1))
    done = call("check", str(file), "--json")
    assert done.exit_code == 2
    bad = json.loads(done.stdout)
    assert bad["ok"] is False
    assert any("boar" in json.dumps(error) for error in bad["errors"])


@pytest.mark.parametrize(
    "arguments",
    [
        ("list",),
        ("list", "mayekawa-wbhe"),
        ("list", "--variables", "mayekawa-wbhe"),
        ("list", "--quantities", "mayekawa-wbhe"),
        ("list", "fluids"),
    ],
)
def test_lists_are_one_json_object(arguments):
    assert isinstance(json.loads(call(*arguments, "--json").stdout), dict)


def test_what_is_run_has_the_keys_that_the_page_names():
    found = json.loads(call("run", "mayekawa-wbhe", "--json").stdout)
    wanted = {"machine", "file", "version", "set", "design", "motor_power [W]", "energy_residual"}
    assert wanted | {"residual", "resolution", "gas_work_error [J]"} <= set(found)
    assert f'"motor_power [W]": {found["motor_power [W]"]:.1f}' in PAGE


def test_commands_that_the_page_names_exist():
    named = set(re.findall(r"^\| [^|]+\| `(\w+) ", PAGE.split("## Many calls")[1], re.M))
    assert named
    assert named <= COMMANDS
