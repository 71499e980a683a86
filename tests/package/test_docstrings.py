"""Units that docstrings state are those that the fields declare; ruff checks that docstrings exist."""

import dataclasses
import importlib
import inspect
import pkgutil
import re

import pint
import pytest

import jaxcomp
from jaxcomp._core.fields import POSITIVE, Part, quantity

_units = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
PACKAGES = [m.name for m in pkgutil.walk_packages(jaxcomp.__path__, "jaxcomp.") if m.ispkg]


def parts_of(package):
    module = importlib.import_module(package)
    found = [getattr(module, name) for name in dir(module)]  # some are imported when they are used
    return [one for one in found if inspect.isclass(one) and issubclass(one, Part)]


def entries(cls):
    """What Args and Attributes of a class and its bases say of each name."""
    said = {}
    for base in reversed(cls.__mro__):
        text = inspect.cleandoc(base.__doc__ or "")
        for block in re.findall(r"^(?:Args|Attributes):\n((?: +.*\n?|\n)+)", text, re.MULTILINE):
            for names, rest in re.findall(r"^    ([\w, ]+): (.*)", block, re.MULTILINE):
                said |= {name.strip(): rest for name in names.split(",")}
    return said


def parsed(unit):
    powers = re.sub(r"([A-Za-z])(\d)", r"\1^\2", unit)  # kg m2
    return _units.Unit(re.sub(r"(?<=\w) (?=\w)", " * ", powers))


def wrong_units(cls):
    said = entries(cls)
    for field in dataclasses.fields(cls):
        told = re.match(r"\[([^\]]+)\]", said.get(field.name, ""))
        declared = field.metadata.get("unit")
        if declared is None or told is None or told[1] == "SI":
            continue
        same = (
            declared == "" if told[1] == "-" else declared and parsed(told[1]) == parsed(declared)
        )
        if not same:
            yield f"{cls.__name__}.{field.name}: [{told[1]}] for [{declared or '-'}]"


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_state_the_declared_units(package):
    assert [line for cls in parts_of(package) for line in wrong_units(cls)] == []


def test_a_wrong_unit_is_found():
    class Probe(Part):
        """A probe.

        Args:
            length: [mm] of it.
            mass: [kg] of it.
        """

        length: float = quantity("m", POSITIVE)
        mass: float = quantity("kg", POSITIVE)

    assert list(wrong_units(Probe)) == ["Probe.length: [mm] for [m]"]
