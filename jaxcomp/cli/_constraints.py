"""Bounds of quantities as they are typed: `peak_force.crank_pin<=8kN`."""

import re
from collections.abc import Sequence

from ..design import quantity
from ..scene import SceneError, to_si
from ._arguments import entry
from ._errors import CommandError

# No quantity that is shown in per cent gets there.
_LARGEST_SHARE = 2.0
_BOUND = re.compile(r"\s*([\w.-]+)\s*(<=|>=|=)\s*(.+?)\s*")


def bounds_of(
    texts: Sequence[str], option: str, equalities: bool = True
) -> dict[str, tuple[float | None, float | None]]:
    """[SI] (low, high) by quantity, `None` for an open end.

    Raises:
        CommandError, SceneError, BadInput: what cannot be read, or the same bound twice.
    """
    out: dict[str, tuple[float | None, float | None]] = {}
    for text in texts:
        match = _BOUND.fullmatch(text)
        if not match or (match[2] == "=" and not equalities):
            more = ", >= or =" if equalities else " or >="
            raise CommandError(f"{option} {text}: must have the form QUANTITY<=VALUE{more}")
        name, sign, given = match.groups()
        value = value_of(name, given, f"{option} {name}")
        low, high = out.get(name, (None, None))
        if (sign != "<=" and low is not None) or (sign != ">=" and high is not None):
            raise CommandError(f"{option} {text}: {name} has such a bound already")
        out[name] = (low if sign == "<=" else value, high if sign == ">=" else value)
    return out


def value_of(name: str, text: str, option: str) -> float:
    """[SI] A value of a quantity.

    Raises:
        CommandError, SceneError, BadInput: what cannot be read, no such quantity, or a share that
            was meant in per cent.
    """
    one = quantity(name)
    value = si(text, one.unit, option)
    if one.percent and abs(value) > _LARGEST_SHARE:
        raise CommandError(f'{option}: {text} would be {100 * value:g} %; is "{text} %" meant?')
    return value


def si(text: str, unit: str, option: str) -> float:
    """[SI] A number of the command line."""
    if not text:
        raise SceneError(option, "lacks a value")
    given = entry(text)
    return float(to_si(text if given is None else given, unit, option))
