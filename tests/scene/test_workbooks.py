"""Tables of users in workbooks: what a sheet holds is read as the same table in CSV, or refused."""

import numpy as np
import pytest

from jaxcomp.cli._spreadsheet import workbook
from jaxcomp.scene import SceneError
from jaxcomp.scene._table_text import read_table_text
from jaxcomp.scene.load_tables import read_loads
from jaxcomp.scene.measurements import read_measurements

openpyxl = pytest.importorskip("openpyxl")

RUNS = [
    ["# note = before the repair"],
    [
        "run",
        "target",
        "speed [rpm]",
        "amplitude [mm/s]",
        "phase [deg]",
        "trial [g mm]",
        "angle [deg]",
    ],
    ["initial", "bearing-1", 1490, 7.2, 238, None, None],
    [],
    ["plane-1", "bearing-1", 1490, 4.9, 114, 2.5, 0],
]


def saved(folder, sheets):
    """A workbook of rows by the names of its sheets."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    file = folder / "table.xlsx"
    book.save(file)
    return file


def as_csv(folder, rows):
    """The same rows as CSV."""
    file = folder / "table.csv"
    lines = [",".join("" if cell is None else str(cell) for cell in row) for row in rows]
    file.write_text("\n".join(lines))
    return file


def test_a_sheet_is_read_as_the_same_table_in_csv(tmp_path):
    table = read_table_text(saved(tmp_path, {"runs": RUNS, "empty": []}))
    assert table == read_table_text(as_csv(tmp_path, RUNS))
    # rows are counted as the spreadsheet counts them
    assert [row.number for row in table.rows] == [3, 5]


def test_runs_of_balancing_and_loads_are_read(tmp_path):
    found = read_measurements(saved(tmp_path, {"runs": RUNS}))
    wanted = read_measurements(as_csv(tmp_path, RUNS))
    np.testing.assert_array_equal(found.initial, wanted.initial)
    heads = ["angle [deg]", "W_x [N]", "W_y [N]"]
    rows = [heads, *([20 * n, 1000.5 - 90 * abs(n - 9), 0.1 * n] for n in range(18))]
    loads = read_loads(saved(tmp_path, {"loads": rows}))
    same = read_loads(as_csv(tmp_path, rows))
    # openpyxl writes 16 digits of a number
    np.testing.assert_allclose(loads.load, same.load, rtol=1e-15)


def test_a_sheet_is_named_where_there_are_several(tmp_path):
    file = saved(tmp_path, {"notes": [["made on a Monday"]], "runs 1": RUNS})
    with pytest.raises(SceneError, match=r'several sheets \("notes", "runs 1"\).*#notes'):
        read_table_text(file)
    assert len(read_table_text(f"{file}#runs 1").rows) == 2
    with pytest.raises(SceneError, match='it has "notes", "runs 1"'):
        read_table_text(f"{file}#runs 2")


def test_what_a_sheet_shows_and_what_it_holds_may_not_differ(tmp_path):
    """Shares shown in per cent, and formulas that were never calculated."""
    rows = [["speed [rpm]", "efficiency [%]"], [1450, 0.85]]
    file = saved(tmp_path, {"one": rows})
    book = openpyxl.load_workbook(file)
    book["one"]["B2"].number_format = "0.0%"
    book.save(file)
    assert read_table_text(file).rows[0].cells == ["1450", "85 %"]

    book["one"]["B2"] = "=A2/1700"
    book.save(file)
    with pytest.raises(SceneError, match=r"cell B2.*never calculated"):
        read_table_text(file)


def test_damaged_workbooks_are_refused_by_name(tmp_path):
    file = tmp_path / "table.xlsx"
    for content in (b"", b"speed [rpm]\n1450\n", saved(tmp_path, {"one": RUNS}).read_bytes()[:900]):
        file.write_bytes(content)
        with pytest.raises(SceneError, match=r"table\.xlsx.*no workbook"):
            read_table_text(file)


def test_results_are_a_workbook_that_is_read_back(tmp_path):
    numbers = {
        "machine": "=1+1",
        "mean_speed [rad/s]": 104.7,
        "losses": {"wall [W]": 12.5, "why": None},
        "forces [N]": [1.0, float("inf")],
        "cases": [{"value": 1}, {"value": 2}],
    }
    columns = {"angle [deg]": np.array([0.0, 90.0]), "name": ["a", "b"]}
    long = {"angle [deg]": np.zeros(200_001)}
    file = tmp_path / "results.xlsx"
    file.write_bytes(workbook(numbers, {"curves": columns, "a/b": long}))
    book = openpyxl.load_workbook(file)
    assert book.sheetnames == ["result", "curves", "a_b"]
    rows = [list(row) for row in book["result"].iter_rows(values_only=True)]
    by_name = {row[0]: row[1:] for row in rows}
    assert by_name["mean_speed"][:2] == ["rad/s", 104.7]
    assert by_name["losses.wall"][:2] == ["W", 12.5]
    assert by_name["forces"][:2] == ["N", 1.0]
    assert by_name["forces"][2:] in ([], [None])
    assert by_name["cases.1.value"][1] == 2
    # words that begin like a formula are words
    assert book["result"]["C2"].data_type == "s"
    assert by_name["machine"][1] == "=1+1"
    assert read_table_text(f"{file}#curves").rows[1].cells == ["90", "b"]
    assert "a/b.csv" in book["a_b"]["A1"].value
