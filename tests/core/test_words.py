"""The nearest known word to one that is unknown."""

import numpy as np
import pytest

from jaxcomp import BadInput
from jaxcomp._core.errors import value_text
from jaxcomp._core.words import did_you_mean, nearest
from jaxcomp.study._analysis import quantity_named

NAMES = ["cop", "capacity", "impact_speed.<contact>", "loss_power.wall", "loss_power.pin", "R290"]


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("COP", "cop"),
        ("Capcity", "capacity"),
        ("r290", "R290"),
        ("impact_speed", "impact_speed.<contact>"),
        ("xyz", None),
    ],
)
def test_a_word_is_near_without_regard_to_case_and_by_its_beginning(word, name):
    assert nearest(word, NAMES) == name


def test_a_refrigerant_is_a_fluid():
    assert did_you_mean("refrigerant", ["fluid", "speed"]) == (
        '; did you mean "fluid", by its name, as R22?'
    )


def test_a_family_of_quantities_is_told_how_to_list_it():
    with pytest.raises(BadInput, match=r"impact_speed\.<contact>.*list --quantities MACHINE"):
        quantity_named("impact_speed")
    with pytest.raises(BadInput, match='did you mean "cop"'):
        quantity_named("COP")


def test_messages_print_no_whole_table():
    assert value_text(np.arange(6.0)) == "[0. 1. 2. 3. 4. 5.]"
    text = value_text(np.arange(181.0))
    assert text == "[  0.   1.   2. ... 178. 179. 180.], 181 values"
    assert len(value_text("x" * 10_000)) == 300
