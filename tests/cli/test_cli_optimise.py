"""`jaxcomp optimise`: the optimum, the Pareto front, what it writes, and its refusals."""

import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import Collocation, load, optimise, problem, solve_orbit
from jaxcomp.cli import app
from jaxcomp.scene import optimised_scene

RUNNER = CliRunner()
BORE = (
    "mayekawa-wbhe",
    "--variable",
    "bore_at_displacement=100mm:160mm",
    "--accuracy",
    "fast",
    "--starts",
    "8",
)
SMALL = ("--samples", "32")


def run(*arguments):
    return RUNNER.invoke(app, ["optimise", *map(str, arguments)])


def found(*arguments):
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.output
    return read_json(result.stdout)


@pytest.fixture(scope="module")
def optimum(tmp_path_factory):
    out = tmp_path_factory.mktemp("optimum")
    return found(*BORE, *SMALL, "--set", "motor.mean_speed=1200rpm", "--out", out), out


def test_optimum_and_its_evidence(optimum):
    result, _ = optimum
    (bore,) = result["variables"]
    assert bore["value"] == pytest.approx(
        0.13904, abs=1e-4
    )  # to 0.1 mm; tests/benchmarks/optimise.py
    assert (bore["low"], bore["high"], bore["present"]) == (0.1, 0.16, 0.13)
    assert bore["at_bound"] is None
    goal = result["objective"]
    assert goal["name"] == "mechanical_efficiency"
    assert goal["maximised"]
    assert goal["value"] > goal["present"]
    assert result["status"] == "converged"
    assert result["verdict"] == "no better design among 33 samples"
    assert result["agreeing"] == 8
    assert result["evaluations"] == sum(start["steps"] for start in result["starts"])
    assert all(len(start["objectives"]) == start["steps"] for start in result["starts"])


def test_files_and_the_scene_as_optimised(optimum):
    result, out = optimum
    for name in (
        "path.png",
        "convergence.png",
        "result.json",
        "report.html",
        "machine.toml",
    ):
        assert (out / name).stat().st_size > 500
    scene = load(out / "machine.toml")
    assert float(scene.compressor.mechanism.bore) == result["variables"][0]["value"]
    # at fixed displacement, at the speed that was set
    swept = load("mayekawa-wbhe").compressor.mechanism.swept_volume
    assert float(scene.compressor.mechanism.swept_volume) == pytest.approx(float(swept), rel=1e-12)
    assert float(scene.compressor.motor.mean_speed) == pytest.approx(40 * np.pi)
    assert scene.sources["mechanism.bore"] == "optimised for mechanical_efficiency"
    orbit = solve_orbit(scene.compressor, Collocation(nodes=12, reversals=0, tolerance=1e-10))
    efficiency = float(orbit.mechanical_efficiency)
    # the same solver at the same numbers, but in a batch, whose passes end with its slowest member
    assert efficiency == pytest.approx(result["objective"]["value"], abs=1e-9)


def test_interrupted_search_ends_in_a_word(monkeypatch, optimum):
    def interrupted(*arguments, callback, **options):
        def stop(stage, done, total):
            callback(stage, done, total)
            if (stage, done) == ("descent", 2):
                raise KeyboardInterrupt

        return optimise(*arguments, callback=stop, **options)

    monkeypatch.setattr("jaxcomp.study.optimise", interrupted)
    result = run(*BORE, *SMALL, "--set", "motor.mean_speed=1200rpm")
    assert result.exit_code == 130
    assert "stopped" in result.stderr
    assert result.stdout == ""


def test_tables_show_optimum_starts_and_evidence():
    text = run(*BORE, *SMALL).stdout
    for word in (
        "Optimum",
        "130.77 mm",
        "100 mm to 160 mm",
        "at the optimum",
        "8 of 8",
        "Compared",
    ):
        assert word in text, word


def test_no_design_that_keeps_its_limits_is_an_optimum(tmp_path):
    # swept volumes from 1.7 to 4.3 litres: no periodic state is asked for
    words = (
        "mayekawa-wbhe",
        "--variable",
        "mechanism.bore=100mm:160mm",
        "--objective",
        "swept_volume",
    )
    words += ("--maximise", *SMALL, "--starts", "2", "--out", tmp_path)
    shown = run(*words, "--constraint", "swept_volume<=500cm^3")
    assert shown.exit_code == 3
    low = float(load("mayekawa-wbhe").compressor.mechanism.swept_volume) * (100 / 130) ** 2
    excess = f"by {1e6 * low - 500:.0f} cm"  # the smallest bore
    first = " ".join(shown.stdout.split())  # however long a line is
    assert "no design found within the ranges keeps its limits" in first
    assert f"the nearest breaks swept_volume <= 500 cm³ {excess}" in first
    assert "ptimum" not in shown.stdout
    assert "the machine of the nearest design" in shown.stdout
    result = read_json((tmp_path / "result.json").read_text())
    assert not result["feasible"]
    assert result["status"] == "no feasible design"
    (limit,) = result["constraints"]
    assert limit["excess"] == pytest.approx(low - 500e-6, rel=1e-9)
    assert result["variables"][0]["value"] == pytest.approx(0.1, rel=1e-9)
    source = load(tmp_path / "machine.toml").sources["mechanism.bore"]
    assert "nearest to the limits" in source
    assert excess in source


def test_the_picture_of_a_nearest_design_has_no_star():
    machine = load("mayekawa-wbhe")
    asked = problem(machine, {"mechanism.bore": (0.1, 0.16)}, ["swept_volume"])
    options = {"maximise": True, "samples": 8, "starts": 1}
    for bound, word in ((5e-4, "nearest design"), (2e-3, "optimum")):
        best = optimise(asked, constraints={"swept_volume": (None, bound)}, **options)
        axes = best.plot.optimum_path().axes[0]
        assert any(word in text.get_text() for text in axes.get_legend().get_texts())
    assert best.feasible
    # found although every start breaks the limit: on it
    assert best.objective == pytest.approx(2e-3, rel=1e-6)


@pytest.mark.slow
def test_front_of_two_objectives(tmp_path):
    out = tmp_path / "front"
    front = found(*BORE, *SMALL, "--pareto", "speed_fluctuation", "--points", "4", "--out", out)
    assert (out / "pareto.png").stat().st_size > 500
    rows = [p["objectives"] for p in front["points"]]
    efficiency = [row["mechanical_efficiency"] for row in rows]
    fluctuation = [row["speed_fluctuation"] for row in rows]
    assert len(rows) == 4
    assert np.all(np.diff(efficiency) < 0)
    assert np.all(np.diff(fluctuation) < 0)
    assert not any(p["dominated"] for p in front["points"])
    assert front["beaten_by"] == 0
    assert front["points"][-1]["values"]["bore_at_displacement"] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.slow
def test_points_of_the_front_are_constrained_optima():
    front = found(*BORE, *SMALL, "--pareto", "speed_fluctuation", "--points", "4")
    # under the level of the fluctuation, whose multiplier the front calls exchange
    middle = front["points"][1]
    level = middle["objectives"]["speed_fluctuation"]
    held = found(*BORE, *SMALL, "--constraint", f"speed_fluctuation<={level!r}")
    assert held["variables"][0]["value"] == pytest.approx(
        middle["values"]["bore_at_displacement"], abs=1e-5
    )
    (one,) = held["constraints"]
    assert one["active"]
    assert one["multiplier"] == pytest.approx(middle["exchange"], rel=1e-2)  # at 1e-5 of the spread


def test_scene_takes_numbers_of_every_section():
    def wanted(found):
        parts = found.design.parts
        mass, law = parts["rotor"].bodies[0].mass, parts["rotor"].links[3].law
        return (mass - 3) ** 2 + (law.stiffness.reshape(-1)[0] / first - 1.2) ** 2

    scene = load("hermetic-68cc")
    stiffness = np.asarray(scene.parts["rotor"].links[3].law.stiffness)
    first = stiffness.reshape(-1)[0]
    names = {
        "rotor.bodies.0.mass": (1.0, 8.0),
        "rotor.links.3.law.stiffness": (0.5, 2.0),
        "corrections.rotor-top.x": (-1e-3, 1e-3),
    }
    made = problem(scene, names, [wanted])
    optimum = optimise(made, starts=2, samples=4)
    new, left = optimised_scene(scene, optimum)
    assert left == ["corrections.rotor-top.x"]
    assert float(new.parts["rotor"].bodies[0].mass) == optimum.values["rotor.bodies.0.mass"]
    factor = optimum.values["rotor.links.3.law.stiffness"]
    assert factor == pytest.approx(1.2, abs=1e-3)
    np.testing.assert_allclose(
        new.parts["rotor"].links[3].law.stiffness, stiffness * factor, rtol=1e-15
    )


REFUSED = {
    "no variable": (["mayekawa-wbhe"], "--variable: is missing"),
    "unknown variable": (["mayekawa-wbhe", "--variable", "bor=1mm:2mm"], "`bor` must be a design"),
    "no range": (
        ["mayekawa-wbhe", "--variable", "bore_at_displacement=100mm"],
        "must have the form NAME=LOW:HIGH",
    ),
    "no unit": (["mayekawa-wbhe", "--variable", "bore_at_displacement=100:160"], "lacks its unit"),
    "other unit": (
        ["mayekawa-wbhe", "--variable", "bore_at_displacement=1kg:2kg"],
        "unit of another dimension",
    ),
    "empty range": (
        ["mayekawa-wbhe", "--variable", "bore_at_displacement=160mm:100mm"],
        "the lower end first",
    ),
    "out of bounds": (
        ["mayekawa-wbhe", "--variable", "bore_at_displacement=-1mm:100mm"],
        "`bore_at_displacement` must be > 0",
    ),
    "one-sided": (["mayekawa-wbhe", "--variable", "bore_at_displacement=:100mm"], "lacks a value"),
    "unknown objective": ([*BORE, "--objective", "noise"], "one of mechanical_efficiency"),
    "either way": ([*BORE, "--objective", "gas_power"], "better in either direction"),
    "unknown joint": ([*BORE, "--objective", "peak_force.crank"], "one of crank_pin"),
    "bad constraint": (
        [*BORE, "--constraint", "motor_power"],
        "must have the form QUANTITY<=VALUE",
    ),
    "bound of a length": ([*BORE, "--constraint", "motor_power<=3mm"], "another dimension"),
    "a share in per cent": (
        [*BORE, "--constraint", "speed_fluctuation<=8"],
        'speed_fluctuation: 8 would be 800 %; is "8 %" meant?',
    ),
    "bound twice": (
        [*BORE, "--constraint", "motor_power<=3kW", "--constraint", "motor_power<=4kW"],
        "has such a bound already",
    ),
    "crossed bounds": (
        [*BORE, "--constraint", "motor_power<=3kW", "--constraint", "motor_power>=4kW"],
        "a lower bound below the upper",
    ),
    "target and objective": (
        [*BORE, "--target", "motor_power=5kW", "--objective", "motor_power"],
        "cannot be combined with --objective",
    ),
    "front and target": (
        [*BORE, "--target", "motor_power=5kW", "--pareto", "motor_power"],
        "--pareto: takes no --target",
    ),
    "front with itself": ([*BORE, "--pareto", "mechanical_efficiency"], "two different quantities"),
    "least squares of one": ([*BORE, "--method", "least-squares"], "without targets"),
    "no start": (["mayekawa-wbhe", *BORE[1:3], "--starts", "0"], "`starts` must be a number >= 1"),
    "unknown machine": (["mayekawa", *BORE[1:]], "did you mean"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_what_is_wrong(case):
    arguments, words = REFUSED[case]
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output
    assert result.stdout == ""


def test_the_present_design_stands_beside_the_optimum(optimum):
    result, _ = optimum
    rows = {row["name"]: row for row in result["comparison"]}
    bore = rows["mechanism.bore"]
    assert bore["present"] == pytest.approx(0.13)
    assert bore["optimum"] == result["variables"][0]["value"]
    goal = rows["mechanical_efficiency"]
    assert goal["optimum"] == pytest.approx(result["objective"]["value"], rel=1e-5)
    assert {"loss_power.wall", "peak_force.crank_pin", "mechanism.crank_radius"} <= set(rows)
