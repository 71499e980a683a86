"""Indicator diagrams, and any other lists of a machine file, from CSV."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxcomp import SceneError, dump, load, loads
from jaxcomp.scene import with_values

PAGE = (Path(__file__).parents[2] / "notebooks" / "examples.md").read_text(encoding="utf-8")
TABLE, SECTION = re.search(
    r"### Indicator diagrams.*?```\n(.*?)```.*?```toml\n(.*?)```", PAGE, re.S
).groups()


@pytest.fixture
def scene(tmp_path):
    """A machine with the diagram of the page."""
    text = dump(load("mayekawa-wbhe"))
    gas = re.compile(r"^\[gas\].*?(?=^\[|\Z)", re.M | re.S)
    (tmp_path / "machine.toml").write_text(gas.sub(SECTION + "\n", text))
    (tmp_path / "indicator.csv").write_text(TABLE)
    return lambda: load(tmp_path / "machine.toml")


def test_the_pressure_is_that_of_the_table(scene):
    found = scene()
    gas = found.compressor.gas
    np.testing.assert_allclose(np.rad2deg(gas.angle), [0, 20, 60, 180, 270, 330], rtol=1e-14)
    np.testing.assert_allclose(gas.cylinder_pressure, [8e5, 3.1e5, 1e5, 1e5, 1.9e5, 7.2e5])
    assert found.sources["gas.angle"] == "read from indicator.csv"


def test_a_dump_holds_the_numbers_and_needs_no_table(scene):
    again = loads(dump(scene()))
    np.testing.assert_array_equal(again.compressor.gas.angle, scene().compressor.gas.angle)
    faster = with_values(scene(), {"motor.mean_speed": "500 rpm"})
    assert faster.compressor.gas.angle.size == 6


def test_semicolons_and_decimal_commas(scene, tmp_path):
    text = TABLE.replace(",", ";").replace(".", ",")
    (tmp_path / "indicator.csv").write_text(text, encoding="utf-8-sig")
    assert float(scene().compressor.gas.cylinder_pressure[1]) == pytest.approx(3.1e5)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (TABLE.replace("20,3.1", "20,x"), r"indicator.csv: line 3.cylinder_pressure = .x.*number"),
        (TABLE.replace("20,3.1", "20"), r"line 3 = 1: must have 2 cells"),
        (TABLE.replace("[deg]", "[bar]"), r"gas.angle.*bar"),
        (
            TABLE.replace("angle [deg]", "angel [deg]"),
            r"gas.angel = .*: is an unknown.*did you mean .angle",
        ),
        (
            TABLE.replace("angle [deg]", "angle in deg"),
            r"angle in deg: must be a name with its unit",
        ),
        (
            TABLE.replace("angle [deg]", "back_pressure [bar]"),
            r"back_pressure: is given here and in",
        ),
        (
            TABLE + "360,5.0\n",
            r"gas: must be a table whose cylinder_pressure is the same at both ends.*, 5.0.$",
        ),
        (
            TABLE + "".join(f"{360 + 10 * n},3.0\n" for n in range(37)),
            r"gas: must be a table within one revolution .two, as of four strokes, are not modelled.$",
        ),
        ("angle [deg]\n", r"indicator.csv: needs a header and lines of numbers"),
        (None, r"indicator.csv: cannot be read: No such file"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(scene, tmp_path, table, message):
    if table is None:
        (tmp_path / "indicator.csv").unlink()
    else:
        (tmp_path / "indicator.csv").write_text(table)
    with pytest.raises(SceneError, match=message):
        scene()


def test_the_name_must_be_a_text(tmp_path):
    (tmp_path / "m.toml").write_text("[gas]\ncsv = 3\n")
    with pytest.raises(SceneError, match=r"gas.csv = 3: must be the name of a CSV file"):
        load(tmp_path / "m.toml")


def closed(table):
    """A table of crank angles whose first line stands at its end again, a revolution later."""
    first = table.splitlines()[1].split(",")
    return table + f"{float(first[0]) + 360:g},{first[1]}\n"


FROM_BOTTOM = """angle [deg],cylinder_pressure [bar]
-180,1.0
-90,1.9
-30,7.2
0,8.0
20,3.1
60,1.0
"""


@pytest.mark.parametrize("table", [TABLE, FROM_BOTTOM])
def test_a_diagram_may_repeat_its_first_point_at_the_end(scene, tmp_path, table):
    """The same pressure at every angle, on both sides of the seam as well; rounding of the angles."""
    stroke = SimpleNamespace(angle=np.radians(np.linspace(-400, 400, 1601)))
    (tmp_path / "indicator.csv").write_text(table)
    open_ = scene().compressor.gas.pressure(stroke)
    (tmp_path / "indicator.csv").write_text(closed(table))
    found = scene()
    np.testing.assert_allclose(found.compressor.gas.pressure(stroke), open_, rtol=1e-12)
    again = loads(dump(found)).compressor.gas
    np.testing.assert_array_equal(again.angle, found.compressor.gas.angle)


def test_both_ends_of_a_diagram_are_one_point_whose_pressure_is_their_mean(scene, tmp_path):
    (tmp_path / "indicator.csv").write_text(TABLE + "360,8.05\n")
    gas = scene().compressor.gas
    at = np.array([-1e-9, 0.0, 1e-9, 2 * np.pi])
    np.testing.assert_allclose(gas.pressure(SimpleNamespace(angle=at)), 8.025e5, rtol=1e-7)
