"""`jaxcomp new`: files to start from are valid, explain every entry, and tell true defaults."""

import math
import re

import equinox as eqx
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp.cli import app
from jaxcomp.scene import (
    describe,
    dump,
    implausible_values,
    load,
    loads,
    machines,
    start,
    with_value,
)
from jaxcomp.scene._annotated import start_from, starts
from jaxcomp.scene._schema import SECTIONS, entries

KINDS = list(starts())


def invoke(*arguments):
    return CliRunner().invoke(app, list(arguments))


def test_there_is_a_start_for_both_mechanisms_several_cylinders_and_a_rotor():
    assert sorted(KINDS) == [
        "blend", "muffler", "pipes", "refrigeration", "rotor", "semi-hermetic",
        "slider-crank", "slider-link", "v-twin",
    ]  # fmt: skip
    assert KINDS[0] == "slider-crank"


@pytest.mark.parametrize("kind", KINDS)
def test_file_is_written_valid_and_usual(kind, tmp_path):
    file = tmp_path / "pump.toml"
    result = invoke("new", str(file), "--kind", kind)
    assert result.exit_code == 0, result.stderr
    scene = loads(file.read_text(), "pump.toml")
    assert scene.name == "pump"
    assert implausible_values(scene) == ()
    given = [row for row in describe(scene) if row.given is not None and row.unit]
    assert given
    assert {row.source for row in given} == {"example value, to be replaced"}


@pytest.mark.parametrize("machine", [one.name for one in machines()])
def test_a_file_from_a_machine_is_that_machine_without_its_sources(machine):
    scene = load(machine)
    text = start_from(scene, "mine")
    made = loads(text)
    # -23.3 degC + 273.15 is 249.85 to the last digit but one
    trees = [(one.compressor, dict(one.parts)) for one in (made, scene)]
    assert eqx.tree_equal(*trees, rtol=1e-14, atol=1e-300)
    given = [row for row in describe(made) if row.given is not None and row.unit]
    assert {row.source for row in given} == {f"value of {machine}, to be replaced"}
    assert made.name == "mine"
    assert made.description == f"Started from {machine}"
    for name, part in dict(made.parts).items():  # and every entry is explained
        section = text.split(f"\n[{name}]\n")[1]
        assert all(re.search(rf"{key}\b", section) for key in entries(type(part)))


def test_new_from_a_machine(tmp_path):
    file = tmp_path / "pump.toml"
    result = invoke("new", str(file), "--from", "r290-6cc")
    assert result.exit_code == 0, result.stderr
    text = file.read_text()
    assert 'evaporating = "-23.3 degC"' in text
    assert "# a number >= 0 [K], above the dew point" in text
    assert "ASHRAE" not in text
    assert f"jaxcomp run {file}" in result.stdout
    assert "r290-6cc" in invoke("new", "-", "--from", "r29-6cc").stderr


@pytest.mark.parametrize(
    ("kind", "layout", "count"), [("refrigeration", "in-line-2", 2), ("semi-hermetic", "V90x2", 4)]
)
def test_one_documented_edit_makes_more_cylinders(kind, layout, count):
    text = start(kind, "m")
    assert f'layout = "{layout}"' in " ".join(text.replace("\n# ", " ").split())  # in its head
    more = loads(re.sub(r'^layout = "[^"]*"', f'layout = "{layout}"', text, flags=re.M))
    assert more.compressor.crankshaft.count == count


def test_temperatures_are_in_degrees_and_differences_in_kelvins():
    scene = loads(start("refrigeration", "m"))
    assert float(scene.compressor.gas.suction.evaporating) == pytest.approx(249.85, rel=1e-15)
    assert float(scene.compressor.gas.suction.heating) == 18.0
    assert 'evaporating = "-23.3 degC"' in dump(scene)
    fahrenheit = with_value(scene, "gas.discharge.condensing", "130 °F")
    assert float(fahrenheit.compressor.gas.discharge.condensing) == pytest.approx(
        (130 - 32) / 1.8 + 273.15, rel=1e-15
    )


def test_no_file_is_overwritten_without_force(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("name = 'mine'\n")
    refused = invoke("new", str(file))
    assert refused.exit_code == 2
    assert "is there already" in refused.stderr
    assert file.read_text() == "name = 'mine'\n"
    assert invoke("new", str(file), "--force").exit_code == 0
    assert loads(file.read_text()).compressor is not None


def test_other_endings_are_refused_and_a_dash_prints(tmp_path):
    assert "must end in .toml" in invoke("new", str(tmp_path / "mine.json")).stderr
    assert loads(invoke("new", "-").stdout).name == "my-machine"


@pytest.mark.parametrize("kind", KINDS)
def test_defaults_in_comments_are_those_of_the_parts(kind):
    """Taking the # away from every default changes nothing; one changed default would."""
    text = start(kind, "m")
    lines = [line for line in text.splitlines() if not re.match(r"#\w+ = \.\.\.", line)]
    written = "\n".join(re.sub(r"^#(\w+ = )", r"\1", line) for line in lines)
    assert written.count("\n#") < text.count("\n#")
    assert same(loads(written), loads(text))
    if kind == "rotor":
        changed, count = re.subn(
            r"^#(spins = )true", r"\1false", "\n".join(lines), count=1, flags=re.M
        )
    else:
        changed, count = re.subn(
            r'^#(offset = ")0\.0 ', r"\g<1>0.001 ", "\n".join(lines), count=1, flags=re.M
        )
    assert count == 1
    assert not same(loads(changed), loads(text))


def same(one, other) -> bool:
    trees = [(scene.compressor, dict(scene.parts)) for scene in (one, other)]
    return bool(eqx.tree_equal(*trees))


@pytest.mark.parametrize("kind", KINDS)
def test_every_entry_of_a_section_stands_in_the_file(kind):
    text = start(kind, "m")
    scene = loads(text)
    parts = {"mechanism": scene.compressor.mechanism} if scene.compressor else dict(scene.parts)
    for name, part in parts.items():
        section = text.split(f"\n[{name}]\n")[1]
        for key in entries(type(part)):
            here = re.search(rf"^#?{key} = |\[+{name}\.{key}\]", section, re.MULTILINE)
            assert here, f"{name}.{key}"


def test_comments_carry_unit_bound_and_meaning():
    text = start("slider-crank", "m")
    assert re.search(r'^bore = "50 mm" +# a number > 0 \[m\], piston diameter$', text, re.MULTILINE)
    assert re.search(r'^#shape = "constant" +# one of "constant", "proportional"$', text, re.M)
    for section in SECTIONS:
        assert f"[{section}]: " in text
    assert "Other types: constant_torque: " not in text.split("[gas]")[1]


@pytest.mark.parametrize(
    "command",
    [
        ["respond", "--kind", "rotor"],
        # that both machines have a periodic state the pictures of test_animate.py show at less cost
        pytest.param(["run", "--kind", "slider-crank"], marks=pytest.mark.slow),
        pytest.param(["run", "--kind", "slider-link"], marks=pytest.mark.slow),
        pytest.param(["balance", "--kind", "rotor"], marks=pytest.mark.slow),
        # compiles the cycle of a machine with valves
        pytest.param(["run", "--kind", "refrigeration"], marks=pytest.mark.slow),
        pytest.param(["run", "--kind", "semi-hermetic"], marks=pytest.mark.slow),
    ],
    ids=lambda words: " ".join(words[:3:2]),
)
def test_a_fresh_file_runs(command, tmp_path):
    verb, option, kind, *rest = command
    file = tmp_path / "fresh.toml"
    assert invoke("new", str(file), option, kind).exit_code == 0
    result = invoke(verb, str(file), "--json", *rest)
    assert result.exit_code == 0, result.stderr
    found = read_json(result.stdout)
    if verb == "run":
        assert found["converged"]
        # small machines lose 3 to 32 % (the household one has 8 W of films and pump); beyond is a slip
        assert 0.6 < found["mechanical_efficiency"] < 0.98
    elif verb == "respond":
        amplitudes = [n["amplitude"]["ux"][0][0] for n in found["nodes"].values()]
        # a g mm of the same order as the file's over the mass of housing and rotor: micrometres
        assert all(1e-7 < a < 1e-3 for a in amplitudes), amplitudes
    else:
        # masses in the planes of the two unbalances undo them: 120 g mm at 0, 60 g mm at 140 degrees
        assert [plane["unbalance"] for plane in found["planes"]] == pytest.approx([12e-5, 6e-5])
        assert found["planes"][1]["phase"] == pytest.approx(math.radians(140 - 180))


def test_lists_of_nodes_are_explained_by_examples():
    text = start("rotor", "m")
    assert "[[1, 2], [2, 3]] or [1, 2]: pairs of node names" in text
    assert "# [1, 2]: node name of each disk" in text
    assert '1 or "name": name of the node at the centre of inertia' in text
    # examples are such values as the reader takes
    read = text.replace(
        "nodes = [1, 2, 3, 4, 5, 6, 7]", "nodes = " + str([[n, n + 1] for n in range(1, 7)])
    )
    assert loads(read).parts["rotor"] is not None
