"""Figures that pages state are those of the program, to their last digit."""

import figures
import pytest

SLOW = {"levecque", "dagilis", "readme"}  # ten to twenty seconds each


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.slow if one in SLOW else ()) for one in figures.GROUPS],
)
def test_figures_of_pages_are_computed_again(name):
    statements = list(figures.GROUPS[name]())
    assert len(statements) >= 5
    assert [words for one in statements for words in figures.disagreements(one)] == []


def test_a_page_that_disagrees_is_noticed():
    line = "corrections in two planes | 824.6 and 456.8 g mm | {} and {} g mm |"
    right = figures.Statement("notebooks/validation.md", line, (829.549, 456.759))
    assert figures.disagreements(right) == []
    found = figures.disagreements(right._replace(values=(829.37, 456.759)))
    assert len(found) == 1
    assert "829.5 stands for 829.37" in found[0]
    gone = figures.disagreements(right._replace(line="corrections in three planes | {} and {} g"))
    assert "validation.md has no line" in gone[0]
