"""The JSON schema of machine files takes what `load` takes, and names what an editor should mark."""

import json
import tomllib
from copy import deepcopy

import pytest
from jsonschema import Draft7Validator
from jsonschema.exceptions import best_match
from typer.testing import CliRunner

from jaxcomp.cli import app
from jaxcomp.scene import json_schema, machines, start
from jaxcomp.scene._annotated import starts
from jaxcomp.scene._explain import part_places
from jaxcomp.scene._schema import entries
from jaxcomp.scene._text import bundled

FILES = {
    **{one.name: bundled("machines")[one.name].read_text("utf-8") for one in machines()},
    **{kind: start(kind, kind) for kind in starts()},
}


@pytest.fixture(scope="module")
def schema():
    return Draft7Validator(json_schema())


def test_it_is_a_schema(schema):
    Draft7Validator.check_schema(schema.schema)


@pytest.mark.parametrize("name", FILES)
def test_machines_and_templates_are_valid(schema, name):
    assert best_match(schema.iter_errors(tomllib.loads(FILES[name]))) is None


WRONG = {
    "key": ("mechanism", {"bor": "50 mm"}),
    "number without unit": ("mechanism", {"bore": 50}),
    "sign": ("mechanism", {"bore": "-50 mm"}),
    "bound of a pure number": ("gas", {"exponent": 4.0}),
    "text": ("mechanism", {"bore": "fifty"}),
    "decimal comma": ("mechanism", {"bore": "50,5 mm"}),
    "type": ("mechanism", {"type": "slider"}),
    "key of a value": ("mechanism", {"bore": {"vlaue": "50 mm"}}),
    "list in the wrong place": ("friction", {"wall": ["50 mm"]}),
    "section": ("mechanics", {}),
}


@pytest.mark.parametrize(("section", "change"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_fails(schema, section, change):
    document = deepcopy(tomllib.loads(FILES["slider-crank"]))
    document[section] = document.get(section, {}) | change
    assert not schema.is_valid(document)


def test_missing_keys_and_sections_fail(schema):
    document = tomllib.loads(FILES["slider-crank"])
    assert not schema.is_valid({k: v for k, v in document.items() if k != "motor"})
    del document["mechanism"]["bore"]
    assert not schema.is_valid(document)


@pytest.mark.parametrize(
    "bore", ["1.5 in", ["50 mm", "60 mm"], {"value": 50, "unit": "mm", "source": "drawing 17"}]
)
def test_the_ways_to_give_a_number_are_valid(schema, bore):
    document = tomllib.loads(FILES["slider-crank"])
    document["mechanism"]["bore"] = bore
    assert best_match(schema.iter_errors(document)) is None


def test_every_part_is_there_with_all_its_keys(schema):
    parts = schema.schema["definitions"]
    for part in part_places():
        ways = [parts[n] for end in ("", ".only") if (n := f"{part.__name__}{end}") in parts]
        assert ways
        for way in ways:
            assert set(entries(part)) <= set(way["properties"])


def test_the_command_prints_and_writes_it(schema, tmp_path):
    file = tmp_path / "jaxcomp.schema.json"
    assert json.loads(CliRunner().invoke(app, ["schema"]).stdout) == schema.schema
    assert CliRunner().invoke(app, ["schema", str(file)]).exit_code == 0
    assert json.loads(file.read_text("utf-8")) == schema.schema
