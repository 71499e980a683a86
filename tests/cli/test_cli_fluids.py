"""`jaxcomp list fluids`: what there is, and how well it is known."""

import json

import pytest
from typer.testing import CliRunner

from jaxcomp.cli import app

WIDE = {"COLUMNS": "200"}


def call(*arguments: str):
    return CliRunner().invoke(app, ["list", *arguments], env=WIDE)


def test_all_fluids_and_blends_are_listed():
    found = json.loads(call("fluids", "--json").stdout)
    assert {"R134a", "methane", "R1234ze(E)"} <= {one["name"] for one in found["fluids"]}
    blends = {one["name"]: one for one in found["blends"]}
    assert blends["R404A"]["class"] == "A"
    # as the tables of the blend's makers round it
    assert blends["R404A"]["glide [K]"] == pytest.approx(0.51, abs=0.01)
    assert "R401A" not in blends


def test_a_blend_tells_its_pairs():
    text = call("fluids", "R455A").stdout
    assert "R32 21.5 %" in text
    assert "12.92 K" in text
    assert "R744/R32" in text
    assert "fitted to vapour pressures" in text
    (blend,) = json.loads(call("fluids", "R455A", "--json").stdout)["blends"]
    assert [pair["quality"] for pair in blend["pairs"]] == ["fit", "fit", "departure"]


def test_what_cannot_be_computed_is_told_as_well():
    assert "no parameters" in call("fluids", "R401A").stdout
    assert "R143b" in call("fluids", "R412A").stdout


def test_a_pure_fluid_tells_its_source():
    text = call("fluids", "R125").stdout
    assert "Lemmon, Jacobsen (2005)" in text
    assert "66.02 degC" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("fluids", "R455"), "R455A"), (("mayekawa-wbhe", "R455A"), "behind `fluids`")],
)
def test_mistakes_are_answered(arguments, words):
    result = call(*arguments)
    assert result.exit_code != 0
    assert words in result.stderr
