"""A modal test made from known numbers gives them back, by `jaxcomp identify` and by `update_rotor`."""

import json
import math

import equinox as eqx
import numpy as np
import pytest
from helpers import read_json, without_drawing
from typer.testing import CliRunner

from jaxcomp import BadInput, load, load_result
from jaxcomp.cli import app
from jaxcomp.rotor import undamped_modes
from jaxcomp.scene.measured import read_measurement
from jaxcomp.study import update_rotor


@pytest.fixture(scope="module")
def modal_test(tmp_path_factory):
    """Two bending frequencies of the free rotor with its fourth shaft table at 0.8 of its modulus."""
    model = load("hermetic-68cc").parts["rotor"]
    place = lambda m: m.shafts[3].young_modulus  # noqa: E731
    softer = eqx.tree_at(place, model, 0.8 * place(model))
    w = np.asarray(undamped_modes(softer, 60, free=True).frequency)
    elastic = w[w > 1e-3 * w.max()]
    distinct = elastic[np.append(True, np.diff(elastic) > 1e-3 * elastic[1:])][:3]
    lines = [f"{mode},{w / (2 * math.pi)!r}" for mode, w in enumerate(distinct.tolist(), 1)]
    file = tmp_path_factory.mktemp("modal") / "modes.csv"
    file.write_text("\n".join(["mode,frequency [Hz]", *lines]))
    return file


def run(*arguments):
    words = ["identify", "hermetic-68cc", "--data", *map(str, arguments)]
    return CliRunner().invoke(app, words, env={"COLUMNS": "200"})


def test_a_modulus_is_fitted_to_its_frequencies(modal_test, tmp_path, monkeypatch):
    without_drawing(monkeypatch)
    out = tmp_path / "result"
    path = "rotor.shafts.3.young_modulus"
    answer = run(modal_test, "--vary", f"{path}=0.5:2", "--json", "--out", out)
    assert answer.exit_code == 0, answer.output
    (parameter,) = read_json(answer.stdout)["parameters"]
    assert parameter["name"] == path
    fitted = load(out / "machine.toml").parts["rotor"].shafts[3].young_modulus
    before = load("hermetic-68cc").parts["rotor"].shafts[3].young_modulus
    # the modulus moves the frequencies by tenths of its own change, and the fit ends at 1e-10
    np.testing.assert_allclose(fitted, 0.8 * before, rtol=1e-5)
    assert (out / "report.html").exists()


def test_frequencies_are_shown_in_hertz(modal_test):
    answer = run(modal_test, "--vary", "rotor.shafts.3.young_modulus=0.5:2")
    assert "Frequency, Hz" in answer.output
    hertz = float(modal_test.read_text().splitlines()[1].partition(",")[2])
    assert f"{hertz:.5g}" in answer.output


def test_the_same_from_python(modal_test, tmp_path):
    scene = load("hermetic-68cc")
    test = read_measurement(modal_test, scene.machine)
    update = update_rotor(scene, test, ["rotor.shafts.3.young_modulus"])
    result = json.loads(update.to_json())
    (variable,) = result["variables"]
    assert abs(variable["factor"] - 0.8) < 1e-5
    assert result["converged"]
    assert not variable["at_bound"]
    assert all(abs(mode["error"]) < 1e-7 for mode in result["modes"])
    update.save(tmp_path / "update.npz")
    assert load_result(tmp_path / "update.npz").to_json() == update.to_json()
    with pytest.raises(BadInput, match="a number of the rotor"):
        update_rotor(scene, test, ["mechanism.bore"])


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("rotor.shafts.3.nothing", "the dotted path of a number"),
        ("rotor.shafts.3.spins", "the dotted path of a number"),
    ],
)
def test_a_path_to_no_number_is_refused(modal_test, path, word):
    answer = run(modal_test, "--vary", path)
    assert answer.exit_code == 2
    assert word in " ".join(answer.stderr.split())


def test_a_table_without_frequencies_is_refused(tmp_path):
    file = tmp_path / "modes.csv"
    file.write_text("f\n100\n")
    answer = run(file, "--vary", "rotor.shafts.3.young_modulus")
    assert answer.exit_code == 2
    assert 'heads = "f": are those of no kind of table' in " ".join(answer.stderr.split())
