"""What a command did not write it does not replace; what it writes is whole or not there."""

import json
import os
import resource

import numpy as np
import pytest
from helpers import without_drawing
from typer.testing import CliRunner

import jaxcomp as jc
from jaxcomp._core import programs
from jaxcomp._core.files import write_whole
from jaxcomp.cli import app
from jaxcomp.cli._written import RECORD
from jaxcomp.scene import start

COMMAND = ["bearing", "--length", "45mm", "--diameter", "90mm", "--clearance", "45um",
           "--viscosity", "10 mPa s", "--speed", "1000rpm", "--load", "2 kN"]  # fmt: skip


@pytest.fixture(autouse=True)
def _nothing_drawn(monkeypatch):
    without_drawing(monkeypatch)


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def answer(done):
    return " ".join(done.output.split())


# ------------------------------------------------------------------ schema, new
@pytest.mark.parametrize("options", [(), ("--results",)])
def test_schema_replaces_schemas_alone(tmp_path, options):
    machine, schema = tmp_path / "my-machine.toml", tmp_path / "schema.json"
    machine.write_text(start("slider-crank", "my-machine"))
    before = machine.read_text()
    refused = invoke("schema", machine, *options)
    assert refused.exit_code == 2
    assert "my-machine.toml: is there already" in answer(refused)
    assert machine.read_text() == before
    for _ in range(2):  # its own file is written anew
        assert invoke("schema", schema, *options).exit_code == 0
        assert "jaxcomp" in json.loads(schema.read_text())["title"]
    schema.write_text("[" * 100_000)
    assert invoke("schema", schema, *options).exit_code == 2
    assert invoke("schema", schema, *options, "--force").exit_code == 0


# ------------------------------------------------------------------ folders of results
def test_a_folder_of_results_is_written_anew(tmp_path):
    for _ in range(2):
        done = invoke(*COMMAND, "--out", tmp_path / "out")
        assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "out" / RECORD).read_text())
    assert {"result.json", "report.html"} <= record.keys()
    assert {*record, RECORD} == {file.name for file in (tmp_path / "out").iterdir()}


def test_a_file_of_the_user_is_seen_before_anything_is_solved(tmp_path, monkeypatch):
    monkeypatch.setattr("jaxcomp.study._steady_state.solve_orbit", None)
    scene = tmp_path / "machine.toml"
    scene.write_text(start("slider-crank", "mine"))
    before = scene.read_text()
    refused = invoke("run", scene, "--out", tmp_path)
    assert refused.exit_code == 2
    assert "has machine.toml, which no command wrote" in answer(refused)
    assert "--force" in answer(refused)
    assert scene.read_text() == before
    assert [file.name for file in tmp_path.iterdir()] == ["machine.toml"]


def test_a_file_that_the_command_does_not_write_is_no_hindrance(tmp_path):
    for name in ("machine.toml", "runs.csv", "map.csv"):
        (tmp_path / name).write_text("mine")
    done = invoke(*COMMAND, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    for name in ("machine.toml", "runs.csv", "map.csv"):
        assert (tmp_path / name).read_text() == "mine"


def test_a_result_that_was_changed_since_is_the_users(tmp_path):
    assert invoke(*COMMAND, "--out", tmp_path).exit_code == 0
    report = tmp_path / "report.html"
    report.write_text("with my remarks")
    refused = invoke(*COMMAND, "--out", tmp_path)
    assert refused.exit_code == 2
    assert "has report.html" in answer(refused)
    assert report.read_text() == "with my remarks"
    assert invoke(*COMMAND, "--out", tmp_path, "--force").exit_code == 0
    assert "with my remarks" not in report.read_text()


def test_a_picture_of_the_user_is_left_and_the_result_is_printed(tmp_path):
    assert invoke(*COMMAND, "--out", tmp_path / "first").exit_code == 0
    name = next(file.name for file in (tmp_path / "first").glob("*.png"))
    (tmp_path / "second").mkdir()
    picture = tmp_path / "second" / name
    picture.write_bytes(b"mine")
    refused = invoke(*COMMAND, "--out", tmp_path / "second")
    assert refused.exit_code == 2
    assert f"has {name}" in answer(refused)
    assert "Eccentricity" in answer(refused)  # what was solved is not lost
    assert picture.read_bytes() == b"mine"
    assert [file.name for file in (tmp_path / "second").iterdir()] == [name]


# ------------------------------------------------------------------ programs that are kept
def test_emptying_the_cache_leaves_other_files(tmp_path, monkeypatch):
    monkeypatch.setenv(programs.ENVIRONMENT, str(tmp_path))
    mine = tmp_path / "payroll" / "year.program"
    mine.parent.mkdir()
    mine.write_text("mine")
    own = tmp_path / ("0a" * 16) / f"{'1b' * 32}.program"
    own.parent.mkdir(mode=0o700)
    own.write_text("kept")
    beside = own.with_name("notes.program")
    beside.write_text("mine")
    assert "1" in answer(invoke("cache"))
    done = invoke("cache", "--empty")
    assert done.exit_code == 0, done.output
    assert mine.read_text() == beside.read_text() == "mine"
    assert not own.exists()


# ------------------------------------------------------------------ whole or not at all
def test_a_full_disk_leaves_the_file_that_was_there(tmp_path):
    file = tmp_path / "file"
    write_whole(file, b"first")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(OSError, match="the file is not written"):
            write_whole(file, bytes(4000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert file.read_bytes() == b"first"
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_a_result_that_cannot_be_saved_leaves_the_one_that_was(tmp_path):
    found = jc.film.steady_bearing(jc.JournalBearing(0.04, 0.02, 30e-6, 0.02), 2000.0, 100.0)
    file = tmp_path / "result.npz"
    found.save(file)
    before = file.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, hard))
    try:
        with pytest.raises(OSError, match="the file is not written"):
            found.save(file)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert file.read_bytes() == before
    assert np.isfinite(jc.load_result(file).point.eccentricity_ratio)
    assert os.listdir(tmp_path) == ["result.npz"]
