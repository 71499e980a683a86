"""`jaxcomp accuracy`: tables, JSON, pictures and refusals."""

import numpy as np
import pytest
from helpers import briefly_timed, read_json
from typer.testing import CliRunner

from jaxcomp.cli import app

RUNNER = CliRunner()
PLAIN = ", a plain bearing"


def run(*arguments):
    return RUNNER.invoke(app, ["accuracy", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("accuracy") / "out"


@pytest.fixture(scope="module")
def film(folder):
    """The quickest study: films have no orbit to compile."""
    asked = ("mayekawa-wbhe", "--study", "film", "--error", "1e-3", "--json", "--out", folder)
    with pytest.MonkeyPatch.context() as patch:
        briefly_timed(patch)
        result = run(*asked)
    assert result.exit_code == 0, result.output
    return read_json(result.stdout)


def test_json_has_every_row_with_the_reference_and_the_recommendation(film):
    rows = {row["method"]: row for row in film["rows"]}
    assert {f"finite volumes{PLAIN}", f"Reynolds{PLAIN}", f"Ocvirk{PLAIN}"} <= set(rows)
    assert "GroovedReynolds, grooves" in rows
    assert film["reference"]["floor"] < 1e-4
    best = film["recommended_by_task"]["a plain bearing"]
    assert best["error"] <= 1e-3
    rivals = [r for r in film["rows"] if r["task"] == "a plain bearing" and r["error"] is not None]
    assert best["seconds"] == min(r["seconds"] for r in rivals if r["error"] <= 1e-3)
    # the error of the model: the short bearing of L/D = 0.5 misses Reynolds' equation
    assert rows[f"Ocvirk{PLAIN}"]["error"] > 1e-3 > rows[f"Reynolds{PLAIN}"]["error"]
    assert rows[f"Reynolds{PLAIN}"]["lines"] > rows[f"Ocvirk{PLAIN}"]["lines"] > 0
    assert film["measured_on"]["cores"] >= 1


def test_cheapest_settings_get_slower_with_the_error_asked_for(film):
    for method in (f"finite volumes{PLAIN}", f"Reynolds{PLAIN}"):
        times = [
            at[method] for _, at in sorted(film["cheapest"].items(), key=lambda i: -float(i[0]))
        ]
        times = [t for t in times if t is not None]
        assert times == sorted(times)


def test_folder_has_picture_and_result(film, folder):
    assert (folder / "accuracy-film.png").stat().st_size > 10_000
    assert read_json((folder / "result.json").read_text()) == film


def test_table_names_the_cheapest_setting_and_the_floor(film):
    from jaxcomp.cli._accuracy import accuracy_tables
    from jaxcomp.study.accuracy import Report
    from jaxcomp.study.accuracy._report import Cost, Measurement, Reference

    failed = Measurement("b", "two", np.inf, 1.0, 1.0, why="the joints lock")
    made = Measurement("a", "one", 1e-4, 2e-3, 1.0, lines=5000), failed
    march = {"speed": 1e-8, "mechanical_efficiency": 2e-9, "losses": 3e-9, "peak_forces": 4e-7}
    values = Reference(1.0, 1.0 + 1e-6, ("x", "y"))
    calls = {"value": Cost(3.0, 2e-3, 5000), "value and gradient": Cost(20.0, 8e-3, 15000)}
    report = Report("orbit", "m", "q", "W", values, made, "note", march, calls)
    table, programs, beside, reference, waits, why, marched, best = accuracy_tables(report, 1e-3)
    assert [list(column.cells) for column in programs.columns[:3]] == [
        ["a", "b"], ["1 s", "1 s"], ["5 k", ""]
    ]  # fmt: skip
    cells = [list(column.cells) for column in waits.columns]
    assert cells == [["value", "value and gradient"], ["3 s", "20 s"], ["2 ms", "8 ms"],
                     ["5,000", "15,000"]]  # fmt: skip
    assert why == "Failed: b, two: the joints lock.\n"
    assert "speed off by 1.0e-08, efficiency by 2.0e-09" in marched
    assert list(table.columns[2].cells) == ["1.0e-04", "failed"]
    assert beside.row_count == 2  # errors of 1e-3 and 1e-4
    assert "differs by 1.0e-06" in reference
    assert best == "Cheapest for an error of 0.001: a, one, 2 ms.\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--study", "film", "--excitation", "crank"), "--excitation crank: has no meaning"),
        (("--quantity", "swept_volume"), "the solver of the periodic state has a part in"),
        (("--error", "2"), "--error 2: must be > 0 and < 1"),
        (
            ("--variable", "bore_at_displacement"),
            "--variable bore_at_displacement: has no meaning without --study gradient",
        ),
        (("--study", "extremes", "--quantity", "x"), "--quantity x: has no meaning"),
        (("--study", "response"), "it needs a rotor with its planes"),
        (("--quantity", "eficiency"), "quantity"),
    ],
)
def test_what_makes_no_sense_ends_in_one_line(arguments, words):
    result = run("mayekawa-wbhe", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_help_shows_an_example():
    result = RUNNER.invoke(app, ["accuracy", "--help"], env={"COLUMNS": "200"})
    assert "jaxcomp accuracy mayekawa-wbhe" in result.stdout
