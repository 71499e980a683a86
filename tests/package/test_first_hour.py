"""Mistakes of a first hour: each is answered with what is wrong and what to write."""

from contextlib import chdir

import first_hour
import pytest
from typer.testing import CliRunner

from jaxcomp.cli import app


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("first_hour")
    first_hour.prepare(path)
    return path


# A search compiles for half a minute.
SEARCHED = "command: a limit that no design keeps"
# Calls from Python, and a third of what is read, in the standard run.
QUICK = {*(f"Python: {name}" for name in first_hour.CALLS), *list(first_hour.MISTAKES)[::3]} - {
    SEARCHED
}
NAMES = [
    # half a minute in all
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
    for name in first_hour.MISTAKES
]


@pytest.mark.parametrize("name", NAMES)
def test_a_mistake_is_answered_with_what_to_write(folder, name):
    with chdir(folder):
        seen, wrong = first_hour.answer(first_hour.MISTAKES[name])
    assert not wrong, seen


def test_an_answer_that_does_not_help_is_noticed(folder, monkeypatch):
    names = ("mechanism.bore", "furlong")
    wrong = {
        "does not name furlong": first_hour.File(first_hour.BORE, "bore = 50", names),
        "not noticed": first_hour.File(first_hour.BORE, 'bore = "51 mm"', ()),
        "no answer of this library": first_hour.Call(lambda scene: 1 / 0, ()),
    }
    with chdir(folder):
        assert {first_hour.answer(one)[1]: one for one in wrong.values()} == wrong
        monkeypatch.setattr("jaxcomp.cli._check_content.check_result", lambda scene: 1 / 0)
        crash = first_hour.Command(("check", "mayekawa-wbhe"), ())
        assert first_hour.answer(crash)[1] == "a traceback"


def test_out_at_a_file_is_refused_before_anything_is_solved(tmp_path, monkeypatch):
    file = tmp_path / "results"
    file.write_text("mine")
    monkeypatch.setattr("jaxcomp.study._steady_state.solve_orbit", None)
    found = CliRunner().invoke(app, ["run", "mayekawa-wbhe", "--out", str(file)])
    assert found.exit_code == 2
    assert "is a file; name a folder" in " ".join(found.stderr.split())
    assert file.read_text() == "mine"
