"""`jaxcomp tolerance`, and `jaxcomp optimise --scatter`: numbers, files, and refusals."""

import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import load
from jaxcomp.cli import app

RUNNER = CliRunner()
BORE = "mechanism.bore"


def run(*arguments, command="tolerance"):
    return RUNNER.invoke(app, [command, "mayekawa-wbhe", *map(str, arguments)])


VOLUME = ("--quantity", "swept_volume")
VARY = ("--vary", f"{BORE}=+-0.3 mm", "--vary", "mechanism.crank_radius=+-0.1 mm uniform")


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tolerance") / "out"
    result = run(
        *VOLUME, *VARY, "--limit", "swept_volume<=1330 cm^3", "--samples", 4096, "--json", "--out", folder
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    return read_json(result.stdout), folder


def test_json_has_the_distribution_in_si_units(answer):
    found = answer[0]
    bore, radius = 0.13, found["variables"]["mechanism.crank_radius"]["nominal"]
    volume = np.pi / 2 * bore**2 * radius
    entry = found["quantities"]["swept_volume"]
    assert entry["nominal"] == pytest.approx(volume, rel=1e-12)
    deviations = (1e-4, 1e-4 / np.sqrt(3))  # three sigma, and even between the limits
    for name, right in zip((BORE, "mechanism.crank_radius"), deviations, strict=True):
        assert found["variables"][name]["deviation"] == pytest.approx(right, rel=1e-12)
    relative = np.hypot(2 * deviations[0] / bore, deviations[1] / radius)
    # next order 1e-6; 4096 samples of a sequence 1e-3
    assert entry["first_order"]["deviation"] == pytest.approx(relative * volume, rel=1e-5)
    assert entry["deviation"] == pytest.approx(relative * volume, rel=3e-3)
    names = [row["variable"] for row in entry["contributors"]]
    assert names == [BORE, "mechanism.crank_radius"]
    assert found["samples"] == 4096
    assert found["failed"] == 0
    assert found["remarks"] == []
    (limit,) = found["limits"]
    assert limit["bound"] == pytest.approx(1.33e-3)
    assert limit["first_order"] == pytest.approx(limit["sampled"], rel=0.25)


def test_folder_has_pictures_scene_and_result(answer):
    found, folder = answer
    for name in ("histogram-swept_volume", "tornado-swept_volume"):
        assert (folder / f"{name}.png").stat().st_size > 10_000
    assert read_json((folder / "result.json").read_text()) == found
    assert (folder / "machine.toml").exists()


def test_tables_and_files(tmp_path):
    file = tmp_path / "tolerances.toml"
    file.write_text(
        f'[tolerances]\n"{BORE}" = "+-0.3 mm"\n"mechanism.crank_radius" = "+-0.1 mm"\n'
        f'[[correlations]]\nbetween = ["{BORE}", "mechanism.crank_radius"]\nvalue = -0.5\n'
    )
    result = run(*VOLUME, "--tolerances", file, "--samples", 256, "--curvature", "none")
    assert result.exit_code == 0, result.output
    for word in ("256 machines", "Swept volume, cm³", "Contributors", "Bore"):
        assert word in result.output
    # what is typed counts before the file
    result = run(
        *VOLUME, "--tolerances", file, "--vary", f"{BORE}=sigma 0.2 mm", "--samples", 64, "--json",
        "--correlate", f"{BORE},mechanism.crank_radius=0.25",
    )  # fmt: skip
    found = read_json(result.stdout)
    assert found["variables"][BORE]["deviation"] == pytest.approx(2e-4)
    assert found["correlations"][0]["value"] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "--vary: is missing"),
        (("--vary", "mechanism.bored=+-1 mm"), "mechanism.bored"),
        (("--vary", f"{BORE}=1 mm"), "must be written like"),
        (("--vary", f"{BORE}=+-1 kg"), "another dimension"),
        (("--vary", f"{BORE}=+-200 mm"), "at every limit of tolerance"),
        (("--vary", "friction.*.speed=+-1 %"), "must be a pattern that fits a number"),
        ((*VARY, "--limit", "swept_volume=1 m^3"), "QUANTITY<=VALUE"),
        ((*VARY, "--limit", "swept_vol<=1 m^3"), "swept_volume"),
        ((*VARY, "--limit", "mechanical_efficiency>=94.5"), 'is "94.5 %" meant?'),
        ((*VARY, "--correlate", f"{BORE}=0.3"), "A,B=VALUE"),
        ((*VARY, "--correlate", f"{BORE},x=0.3"), "mechanism.bore and x"),
        ((*VARY, "--balanced"), "--balanced: needs a machine with balancing planes"),
        ((*VARY, "--samples", "3"), "--samples 3"),
        (("--tolerances", "nothing.toml"), "nothing.toml"),
    ],
)
def test_refusals_name_what_is_wrong(arguments, complaint):
    result = run(*VOLUME, *arguments)
    assert result.exit_code == 2
    assert complaint in " ".join(result.output.split())


def test_robust_objective_counts_the_scatter():
    """The largest volume that nearly all machines keep: V (1 + s^2 - 2 sqrt(4 s^2 + 2 s^4))."""
    result = run(
        "--variable", f"{BORE}=100mm:160mm", "--objective", "swept_volume", "--maximise",
        "--scatter", f"{BORE}=+-3 %", "--sigmas", 2, "--starts", 1, "--samples", 8, "--json",
        command="optimise",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    found = read_json(result.stdout)
    best = found["variables"][0]["value"]
    assert best == pytest.approx(0.16, rel=1e-3)  # the end of the range
    s, radius = 0.01, float(load("mayekawa-wbhe").compressor.mechanism.crank_radius)
    volume = np.pi / 2 * best**2 * radius
    right = volume * (1 + s**2 - 2 * np.sqrt(4 * s**2 + 2 * s**4))
    # 64 machines of a sequence have the deviation to 1 %, of which 4 s count
    assert found["objective"]["value"] == pytest.approx(right, rel=6e-4)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--sigmas", "3"), "need --scatter"),
        (("--scatter", f"{BORE}=+-1 %", "--sigmas", "3", "--quantile", "0.9"), "no --quantile"),
        (("--scatter", f"{BORE}=+-1 %", "--target", "swept_volume=1 m^3"), "no --target"),
        (("--scatter", f"{BORE}=1 %"), "must be written like"),
        (("--scatter", f"{BORE}=+-1 %", "--quantile", "0.999"), "quantile"),
    ],
)
def test_robust_refusals(arguments, complaint):
    result = run("--variable", f"{BORE}=100mm:160mm", *arguments, command="optimise")
    assert result.exit_code == 2
    assert complaint in " ".join(result.output.split())


@pytest.mark.slow
def test_the_answer_begins_with_a_sentence_and_offers_the_inverse():
    limit = ("--limit", "swept_volume<=1330 cm^3")
    result = run(*VOLUME, *VARY, *limit, "--samples", 1024, "--rejects", "1%", "--json")
    one, largest = read_json(result.stdout)["permitted"]
    assert one["rejects"] <= 0.01 + 1.5 / 1024
    assert len(largest["variables"]) == 1
    text = " ".join(
        run(*VOLUME, *VARY, *limit, "--samples", 1024, "--rejects", "1%").stdout.split()
    )
    assert text.startswith("About ")
    assert "of the machines exceed 1330 cm³" in text
    assert f"With all tolerances tightened to {one['factor']:.3g} times what they are" in text
    assert "--limit" in run(*VOLUME, *VARY, "--rejects", "1%").output


def test_each_cylinder_has_a_deviation_of_its_own():
    """A number given once for all cylinders: `.*` is a tolerance of each."""
    words = ["--vary", f"{BORE}.*=+-20 um", *VOLUME, "--samples", "64", "--json"]
    result = RUNNER.invoke(app, ["tolerance", "refrigeration-twin", *words])
    assert result.exit_code == 0, result.output
    found = read_json(result.stdout)
    assert list(found["variables"]) == [f"{BORE}.0", f"{BORE}.1"]
    entry = found["quantities"]["swept_volume"]  # that of the first cylinder
    wanted = 2 * 20e-6 / 3 / 60e-3 * entry["nominal"]  # V goes with the square of the bore
    assert entry["first_order"]["deviation"] == pytest.approx(wanted, rel=1e-9)
    shares = {row["variable"]: row["share"] for row in entry["contributors"]}
    assert shares == pytest.approx({f"{BORE}.0": 1.0, f"{BORE}.1": 0.0}, abs=1e-12)
