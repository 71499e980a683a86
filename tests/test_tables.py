"""Tables on narrow terminals: words wrap, numbers are never cut."""

import io
import re

import pytest
from rich.console import Console
from rich.table import Table

from jaxcomp.cli._tables import _table, fitted

ROWS = (
    ("Main journal of the crankshaft", "0.57013", "28.031", "68.2 %", "of all losses"),
    ("Wall", "0.14017", "-6.8914", "16.8 %", "of all losses together"),
)


def made():
    table = _table("Losses", "Friction loss", "J per revolution", "W", "Share", "", numbers=True)
    for row in ROWS:
        table.add_row(*row)
    table.columns[-1].justify = "left"
    return table


def printed(width):
    out = io.StringIO()
    console = Console(file=out, width=width)
    console.print(fitted(made(), width))
    return out.getvalue()


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
