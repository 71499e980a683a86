"""Tolerances as written on drawings, and files of them."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcomp import BadInput, SceneError, load, within
from jaxcomp.machine import machine_of
from jaxcomp.scene.tolerances import read_tolerance, read_tolerance_file, tolerances_of

DEGREE = np.pi / 180


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("+-0.02 mm", "m", within(2e-5)),
        ("+/- 0.02mm", "m", within(2e-5)),
        ("±20 um", "m", within(2e-5)),
        ("-0.01 +0.03 mm", "m", within((-1e-5, 3e-5))),
        ("+0.03 / -0.01 mm", "m", within((-1e-5, 3e-5))),
        ("0 +0.02 mm", "m", within((0.0, 2e-5))),
        ("-0.03, -0.01 mm uniform", "m", within((-3e-5, -1e-5), "uniform")),
        ("+-5 %", "kg m", within(0.05, relative=True)),
        ("+-5%, uniform", "", within(0.05, "uniform", relative=True)),
        ("+-0.001", "", within(0.001)),
        ("+-2 deg truncated 2 sigma", "rad", within(2 * DEGREE, "truncated", sigmas=2.0)),
        ("+-1 rpm 4 sigma", "rad/s", within(np.pi / 30, sigmas=4.0)),
        ("sigma 5 um", "m", within(1.5e-5)),
        ("sigma 1 %", "m", within(0.03, relative=True)),
    ],
)
def test_notation(text, unit, expected):
    found = read_tolerance(text, unit, "x")
    # decimal fractions and the conversion of units round
    ends = (found.low, found.high), (expected.low, expected.high)
    np.testing.assert_allclose(*ends, rtol=1e-14, atol=1e-22)
    assert found == replace(expected, low=found.low, high=found.high)


@pytest.mark.parametrize(
    ("text", "unit", "complaint"),
    [
        ("0.02 mm", "m", "must be written like"),
        ("+-0.02", "m", "lacks its unit"),
        ("+-0.02 kg", "m", "another dimension"),
        ("+-0.02 mm round", "m", "unknown unit"),
        ("+-0 mm", "m", "range that rises"),
        ("+-1 mm 20 sigma", "m", "sigmas"),
        ("sigma 5 um uniform", "m", "takes no other word"),
        ("h7", "m", "must be written like"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(text, unit, complaint):
    with pytest.raises(SceneError, match=complaint) as caught:
        read_tolerance(text, unit, "mechanism.bore")
    assert "mechanism.bore" in str(caught.value)


def test_patterns_stand_for_single_numbers():
    design = machine_of(load("hermetic-68cc"))
    found = tolerances_of(
        design,
        {
            "loads.unbalances.*.magnitude.*": "+-5 %",
            "loads.unbalances.0.magnitude.1": "+-2 %",
            "corrections.*.angle": "+-1 deg",
            "mechanism.bore": "+-10 um",
        },
    )
    masses = [name for name in found if "magnitude" in name]
    assert masses == [f"loads.unbalances.0.magnitude.{i}" for i in range(2)] + [
        f"loads.unbalances.1.magnitude.{i}" for i in range(4)
    ]
    assert found[masses[1]].high == pytest.approx(0.02)  # the last text counts
    assert found[masses[0]].high == pytest.approx(0.05)
    assert found["corrections.rotor-top.angle"].high == pytest.approx(DEGREE)
    with pytest.raises(BadInput, match=r"friction\.\*\.speed.*pattern that fits a number"):
        tolerances_of(design, {"friction.*.speed": "+-1 %"})
    with pytest.raises(BadInput, match=r"mechanism\.bored"):
        tolerances_of(design, {"mechanism.bored": "+-1 %"})


def test_file_of_tolerances(tmp_path):
    file = tmp_path / "tolerances.toml"
    file.write_text(
        '[tolerances]\n"mechanism.bore" = "+-0.02 mm"\n"mechanism.conrod_length" = "+-0.1 mm"\n'
        '[[correlations]]\nbetween = ["mechanism.bore", "mechanism.conrod_length"]\nvalue = "30 %"\n'
    )
    found = read_tolerance_file(file)
    assert found.tolerances["mechanism.bore"] == "+-0.02 mm"
    assert found.correlations == {("mechanism.bore", "mechanism.conrod_length"): pytest.approx(0.3)}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[tolerance]\n", "tolerance.*must be `tolerances`"),
        ("[tolerances]\n", "at least one"),
        ('[tolerances]\nmechanism.bore = "+-1 mm"\n', "needs quotes"),
        ('[tolerances]\nx = "+-1"\n[[correlations]]\nbetween = ["x"]\nvalue = 1\n', "two names"),
        ('[tolerances]\nx = "+-1"\n[[correlations]]\nbetween = ["x", "y"]\n', "`value`"),
        ("[tolerances\n", "not valid TOML"),
    ],
)
def test_bad_files_are_refused_by_name_and_entry(tmp_path, text, complaint):
    file = tmp_path / "tolerances.toml"
    file.write_text(text)
    with pytest.raises(SceneError, match=complaint) as caught:
        read_tolerance_file(file)
    assert "tolerances.toml" in str(caught.value)
    with pytest.raises(SceneError, match="cannot be read"):
        read_tolerance_file(tmp_path / "nothing.toml")
