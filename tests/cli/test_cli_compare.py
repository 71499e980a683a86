"""`jaxcomp compare`: figures of designs beside each other."""

import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import solve_orbit
from jaxcomp.cli import app
from jaxcomp.cli._tables import comparison_table
from jaxcomp.plot._designs import compared_losses
from jaxcomp.scene import load, with_value
from jaxcomp.study import Comparison
from jaxcomp.study._compared import ComparedQuantity


def compare(*arguments):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)])


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    out = tmp_path_factory.mktemp("compared") / "out"
    arguments = ("mayekawa-wbhe", "--with", "motor.mean_speed=800rpm", "--json", "--out", out)
    done = compare(*arguments)
    assert done.exit_code == 0, done.output
    return read_json(done.stdout), out


def test_figures_are_those_of_the_machines_alone(found):
    result, _ = found
    rows = {row["name"]: row["values"] for row in result["figures"]}
    scene = load("mayekawa-wbhe")
    speeds = (None, "800 rpm")
    for place, speed in enumerate(speeds):
        one = scene if speed is None else with_value(scene, "motor.mean_speed", speed)
        orbit = solve_orbit(one.compressor)
        # compiled with and without optimisation: the same iteration ends within its tolerance
        close = {"rel": 1e-6}
        losses = orbit.energy.losses
        assert rows["mechanical_efficiency"][place] == pytest.approx(
            float(orbit.mechanical_efficiency), **close
        )
        for joint, loss in losses.items():
            assert rows[f"loss_power.{joint}"][place] == pytest.approx(
                float(loss / orbit.period), **close
            )
        for joint, peak in orbit.peak_forces.items():
            assert rows[f"peak_force.{joint}"][place] == pytest.approx(float(peak), **close)
        for joint, mean in orbit.mean_forces.items():
            assert rows[f"mean_force.{joint}"][place] == pytest.approx(float(mean), **close)
        assert rows["motor_power"][place] == pytest.approx(float(orbit.motor_power), **close)
    assert "speed_fluctuation" in rows


def test_only_the_dimensions_that_differ_are_shown(found):
    result, _ = found
    dotted = {row["name"] for row in result["figures"] if row["name"].startswith("motor.")}
    assert dotted == {"motor.mean_speed"}
    assert not [row for row in result["figures"] if row["name"].startswith("mechanism.")]
    assert [one["label"] for one in result["machines"]] == [
        "mayekawa-wbhe",
        "motor.mean_speed=800rpm",
    ]


def test_the_folder_has_one_picture_and_the_result(found):
    _, out = found
    optional = {"interactive.html", "results.xlsx", ".jaxcomp.json"}
    names = {file.name for file in out.iterdir()} - optional
    assert names == {"losses.png", "result.json", "report.html"}


def test_a_quantity_is_shown_alone(tmp_path):
    words = ("mayekawa-wbhe", "--with", "motor.mean_speed=800rpm", "--out", tmp_path)
    done = compare(*words, "--quantity", "peak_force.crank_pin", "--quantity", "swept_volume")
    assert done.exit_code == 0, done.output
    names = [row["name"] for row in read_json((tmp_path / "result.json").read_text())["figures"]]
    assert names == ["peak_force.crank_pin", "swept_volume", "motor.mean_speed"]
    assert not list(tmp_path.glob("*.png"))
    for name, words_ in (("cop", "needs valves"), ("peak_forc", "did you mean")):
        done = compare(*words[:3], "--quantity", name)
        assert done.exit_code == 2
        assert words_ in done.stderr


@pytest.mark.slow  # compiles the cycle of a machine with valves
def test_machines_with_valves_have_what_they_are_judged_by_first(tmp_path):
    done = compare("r290-6cc", "mayekawa-wbhe", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    rows = read_json((tmp_path / "result.json").read_text())["figures"]
    names = [row["name"] for row in rows]
    assert names[:4] == ["cop", "capacity", "electric_power", "overall_efficiency"]
    values = {row["name"]: row["values"] for row in rows}
    assert values["cop"][1] is None
    use = [one[0] for name, one in values.items() if name.startswith("power_use.")]
    # ten powers, to rounding and the closure of the cycle's balance
    assert sum(use) == pytest.approx(values["electric_power"][0], rel=1e-6)
    assert {file.name for file in tmp_path.glob("*.png")} == {"power_use.png", "losses.png"}


ROWS = (
    ComparedQuantity("mechanical_efficiency", "", (0.9, 0.92, None)),
    ComparedQuantity("loss_power.wall", "W", (200.0, 150.0, None)),
    ComparedQuantity("loss_power.link_slider", "W", (None, None, 50.0)),
)
COMPARISON = Comparison(("a", "b", "c"), ROWS)


def test_changes_are_those_against_the_first_and_absent_ones_stay_empty():
    table = comparison_table(COMPARISON)
    cells = [list(column.cells) for column in table.columns]
    assert cells[1:4] == [
        ["90 %", "200 W", ""],
        ["92 %", "150 W", ""],
        ["+2.00 points", "-25.00 %", ""],
    ]
    assert cells[4:] == [["", "", "50 W"], ["", "", ""]]


def test_the_picture_has_a_bar_for_each_joint_and_design():
    (axes,) = compared_losses(COMPARISON).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["Wall", "Link slider"]
    widths = [bar.get_width() for bar in axes.patches]  # pyright: ignore[reportAttributeAccessIssue]
    assert widths == [200, 0, 150, 0, 0, 50]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mayekawa-wbhe"], "needs a second machine"),
        (
            ["mayekawa-wbhe", "r134a-7cc", "--with", "bore_at_displacement=120mm"],
            "for one machine alone",
        ),
        (["mayekawa-wbhe", "mayekawa-wbeh"], 'did you mean "mayekawa-wbhe"?'),
        (
            [
                "mayekawa-wbhe",
                "--with",
                "bore_at_displacement=120mm",
                "--with",
                "bore_at_displacement=120mm",
            ],
            "is given twice",
        ),
        (["mayekawa-wbhe", "--with", "motor.mean_sped=1rpm"], "mean_sped"),
    ],
)
def test_refusals_name_what_is_wrong(arguments, words):
    done = compare(*arguments)
    assert done.exit_code == 2
    assert words in done.stderr
    assert done.stdout == ""
