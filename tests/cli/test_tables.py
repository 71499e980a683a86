"""Tables on narrow terminals: words wrap, numbers are never cut."""

import io
import re

import pytest
from rich.console import Console
from rich.table import Table

from jaxcomp.cli._output import print_tables
from jaxcomp.cli._run_tables import _power
from jaxcomp.cli._tables import fitted, row_table
from jaxcomp.crank._performance import POWER

ROWS = (
    ("Main journal of the crankshaft", "0.57013", "28.031", "68.2 %", "of all losses"),
    ("Wall", "0.14017", "-6.8914", "16.8 %", "of all losses together"),
)


def made():
    table = row_table("Losses", ("Friction loss", "J per revolution", "W", "Share", ""), ROWS)
    table.columns[-1].justify = "left"
    return table


def printed(width):
    out = io.StringIO()
    console = Console(file=out, width=width)
    console.print(fitted(made(), width))
    return out.getvalue()


def test_tables_keep_their_titles_for_the_report_when_they_are_printed(capsys):
    table = row_table("Losses", ("Friction loss",), [("wall",)], caption="of all")
    for _ in range(2):
        print_tables([table])
        assert "Losses" in capsys.readouterr().out
    assert (table.title, table.caption) == ("Losses", "of all")


@pytest.mark.parametrize("width", [20, 30, 40, 60, 80, 120])
def test_no_number_and_no_word_is_cut(width):
    text = printed(width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    for row in ROWS:
        for number in row[1:4]:
            assert re.search(rf"(?<!\S){re.escape(number)}(?!\S)", text), number
    for word in ["Main", "journal", "of", "the", "crankshaft"]:
        assert word in text


def test_a_table_with_room_stays_a_table():
    assert isinstance(fitted(made(), 120), Table)
    assert isinstance(fitted(made(), 20), str)


def test_decimal_points_stand_below_each_other():
    rows = (
        ("a", "52.4", "5 %", "1258", "5 %"),
        ("b", "0.397", "12.5 %", "3.25", "12.5 W"),
        ("c", "<0.01", "", "", ""),
    )
    table = row_table(None, ("Node", "Amplitude", "Share", "Large", "Mixed"), rows)
    out = io.StringIO()
    Console(file=out, width=60).print(fitted(table, 60))
    head, _, *lines = [line for line in out.getvalue().splitlines() if line.strip()]
    assert len({line.index(".") for line in lines}) == 1
    assert lines[0].index("1258") + 4 == lines[1].index("3.25") + 1
    assert lines[0].index("5 %") == lines[1].index("12.5 %") + 1  # under the 2
    # numbers with several units and headers keep to the right
    assert lines[1].index("12.5 %") + 6 == head.index("Share") + 5
    assert lines[0].rindex("%") == lines[1].index("W") == head.index("Mixed") + 4
    assert head.index("Amplitude") + len("Amplitude") == lines[1].index("0.397") + 5


def test_rows_that_become_lines_say_what_they_belong_to():
    heads = ("Node", "Amplitude of the harmonic", "Velocity of it")
    table = row_table(None, heads, (("first", "1.5", "2"), ("", "0.25", "3")))
    text = fitted(table, 20)
    assert isinstance(text, str)
    assert text.count("first") == 2
    heads = ("Losses, forces, dimensions", "Present value", "Optimum")
    rows = (("Efficiency", "92.2 %", "93.1 %"), ("Shaft power", "4.474 kW", "4.470 kW"))
    table = row_table(None, heads, rows)
    assert fitted(table, 20).count("Losses, forces") == 1


def test_what_rounding_leaves_of_a_use_of_power_is_no_row():
    power = dict.fromkeys(POWER, 0.0) | {"isentropic": 50.0, "friction": -4e-14}
    console = Console(file=io.StringIO(), width=100)
    console.print(_power({"power_use": power, "volume_use": {}}))
    text = console.file.getvalue()
    assert "Isentropic" in text
    assert "Friction" not in text
    assert "Total" in text
