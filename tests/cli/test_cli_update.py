"""`jaxcomp update`: a modal test made from known numbers gives them back."""

import json
import math

import equinox as eqx
import numpy as np
import pytest
from helpers import read_json
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
    return CliRunner().invoke(app, ["update", "hermetic-68cc", *map(str, arguments)])


def test_a_modulus_is_fitted_to_its_frequencies(modal_test, tmp_path):
    out = tmp_path / "result"
    answer = run(modal_test, "--variable", "rotor.shafts.3.young_modulus", "--json", "--out", out)
    assert answer.exit_code == 0, answer.output
    result = read_json(answer.stdout)
    (variable,) = result["variables"]
    # the modulus moves the frequencies by tenths of its own change, and the fit ends at 1e-10
    assert abs(variable["factor"] - 0.8) < 1e-5
    assert result["converged"]
    assert not variable["at_bound"]
    assert all(abs(mode["error"]) < 1e-7 for mode in result["modes"])
    fitted = load(out / "machine.toml").parts["rotor"].shafts[3].young_modulus
    before = load("hermetic-68cc").parts["rotor"].shafts[3].young_modulus
    np.testing.assert_allclose(fitted, variable["factor"] * before, rtol=1e-12)
    assert (out / "report.html").exists()
    # Python gives the same, and a file keeps it
    scene = load("hermetic-68cc")
    test = read_measurement(modal_test, scene.machine)
    found = update_rotor(scene, test, ["rotor.shafts.3.young_modulus"])
    printed = json.loads(answer.stdout)
    for key, value in json.loads(found.to_json()).items():
        assert printed[key] == value, key
    found.save(tmp_path / "update.npz")
    again = load_result(tmp_path / "update.npz")
    assert again.to_json() == found.to_json()
    assert found.identification.machine.parts["rotor"].shafts[3].young_modulus[0] == fitted[0]
    with pytest.raises(BadInput, match="a number of the rotor"):
        update_rotor(scene, test, ["mechanism.bore"])


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("rotor.shafts.3.nothing", "the dotted path of a number"),
        ("rotor.shafts.3.spins", "the dotted path of a number"),
        ("bore", "must begin with rotor"),
    ],
)
def test_a_path_to_no_number_is_refused(modal_test, path, word):
    answer = run(modal_test, "--variable", path)
    assert answer.exit_code == 2
    assert word in " ".join(answer.stderr.split())


def test_a_table_without_frequencies_is_refused(tmp_path):
    file = tmp_path / "modes.csv"
    file.write_text("f\n100\n")
    answer = run(file, "--variable", "rotor.shafts.3.young_modulus")
    assert answer.exit_code == 2
    assert 'heads = "f": are those of no kind of table' in " ".join(answer.stderr.split())
