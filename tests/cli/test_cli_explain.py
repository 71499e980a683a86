"""`jaxcomp explain`: what it says about a part is what the reader of a file takes."""

import re
import subprocess
import sys
import tomllib

import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp.cli import app
from jaxcomp.scene import SceneError
from jaxcomp.scene._explain import explained, part_places
from jaxcomp.scene._read import Reader
from jaxcomp.scene._schema import Number, entries

PARTS = list(part_places().items())


def explain(*arguments):
    return CliRunner().invoke(app, ["explain", *arguments])


@pytest.mark.parametrize(("part", "where"), PARTS, ids=[part.__name__ for part, _ in PARTS])
def test_every_line_of_an_example_is_read_as_it_stands(part, where):
    """A wrong unit, a value outside its bound or an unknown word would be refused by the reader."""
    one = next(e for e in explained(where.kind) if e.places == where.titles)
    assert {entry.name for entry in one.entries} == set(entries(part))
    for entry in one.entries:
        if entry.example.startswith("["):
            assert entry.name in entries(part)
            continue
        given = tomllib.loads(entry.example)[entry.name]
        declared = entries(part)[entry.name]
        value = Reader()._entry(declared, given, entry.name, None)
        if isinstance(declared, Number):
            assert declared.bound.holds(value)
    tomllib.loads(one.example)


def test_a_word_that_stands_for_several_parts_shows_all():
    bearing, link = explained("film")
    assert "[bearings.NAME]" in bearing.places
    assert "[friction.crank_pin]" in bearing.places
    assert link.places == ("[rotor.links.law]",)
    mechanism, friction = explained("slider-crank")
    assert (mechanism.places, friction.places) == (("[mechanism]",), ("[friction]",))


def test_the_name_of_a_section_shows_all_that_may_stand_there():
    kinds = {one.kind for one in explained("motor")}
    assert kinds == {"mean_speed", "constant_speed", "constant_torque", "slip_line", "kloss"}
    assert explained("gas.heat") == explained("heat")


@pytest.mark.parametrize(
    ("word", "answer"),
    [
        ("slider_cranck", 'did you mean "slider_crank"?'),
        ("bore", "but an entry of slider_crank, slider_link"),
        ("qqqqq", "known are adair, "),
    ],
)
def test_unknown_words_are_answered_with_near_ones(word, answer):
    result = explain(word)
    assert result.exit_code == 2
    assert answer in result.stderr
    with pytest.raises(SceneError, match="no part of a machine file"):
        explained(word)


def test_unit_bound_default_and_meaning_are_shown():
    found = read_json(explain("slider_crank", "--json").stdout)["parts"][0]
    rows = {row["name"]: row for row in found["entries"]}
    assert rows["bore"] == {
        "name": "bore", "unit": "m", "bound": "> 0", "required": True, "default": "",
        "doc": "piston diameter", "example": rows["bore"]["example"],
    }  # fmt: skip
    assert rows["offset"]["default"] == '"0.0 m"'
    text = explain("slider_crank").stdout
    assert re.search(r"bore +m +> 0 +required +piston diameter", text)
    assert "May stand as [mechanism]" in text


def test_without_a_word_every_part_is_listed():
    listed = read_json(explain("--json").stdout)["parts"]
    assert [row["kind"] for row in listed] == [where.kind for _, where in PARTS]
    assert "kloss" in explain().stdout


def test_nothing_is_compiled():
    code = (
        "import jax, sys\n"
        "seen = []\n"
        "def heard(name, *rest, **more):\n"
        "    seen.append(name)\n"
        "jax.monitoring.register_event_duration_secs_listener(heard)\n"
        "from jaxcomp.cli import app\n"
        "app(['explain', 'film'], standalone_mode=False)\n"
        "sys.exit(any('backend_compile' in name for name in seen))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("kind", "name", "low", "high"),
    [
        ("film", "roughness", 0.05e-6, 2e-6),
        ("film", "radial_clearance", 2e-6, 1e-4),
        ("greenwood_tripp", "roughness", 0.05e-6, 2e-6),
        ("mixed_thrust", "dynamic_viscosity", 1e-3, 0.1),
        ("mixed_thrust", "axial_clearance", 5e-6, 1e-3),
        ("perfect_gas", "gas_constant", 40.0, 4200.0),
        ("plenum", "volume", 1e-6, 1e-2),
        ("reed_beam", "density", 1e3, 2e4),
        ("reed_beam", "elastic_modulus", 1e10, 4e11),
        ("main_bearings", "stiffness", 1e5, 1e10),
        ("disks", "offset", 1e-5, 2e-2),
    ],
)
def test_values_of_examples_are_those_of_machines(kind, name, low, high):
    """A roughness is no centimetre; the ranges are those of compressors of 1 cm3 to 10 l."""
    checked = 0
    for part in explained(kind):
        for entry in part.entries:
            if entry.name == name:
                given = tomllib.loads(entry.example)[name]
                declared = next(
                    entries(one)[name]
                    for one, where in PARTS
                    if where.kind == kind and name in entries(one)
                )
                value = Reader()._entry(declared, given, name, None)
                assert ((low <= value) & (value <= high)).all(), entry.example
                checked += 1
    assert checked
