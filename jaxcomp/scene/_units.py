"""Units at the edge: text with a unit becomes a number in SI, and back.

Angles count as a dimension of their own here, although the unit system calls them pure numbers:
a speed in Hz would otherwise be taken for the same number of rad/s.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import SceneError

if TYPE_CHECKING:
    import pint

# How a number is written in a text.
NUMBER = r"[+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*")
_NOT_FINITE = re.compile(r"\s*[+-]?(nan|inf|infinity)\b.*", re.IGNORECASE)
_EXAMPLES = {
    "m": "130 mm",
    "rad": "-3 deg",
    "rad/s": "1000 rpm",
    "Pa": "0.98 MPa",
    "kg": "2.65 kg",
    "N m": "120 N m",
    "Pa s": "4 mPa s",
}


def to_si(given: Any, unit: str, key: str, default_unit: str | None = None) -> np.ndarray:
    """A value of a scene file in SI units.

    Args:
        given: number, text with a unit, or (nested) list of them.
        unit: SI unit of the result, empty for a pure number.
        key: dotted path of the entry, for the message.
        default_unit: unit of bare numbers, where one was given for all of them.

    Returns:
        [SI] Array in `unit`; of shape () for a single value.

    Raises:
        SceneError: no number, another dimension, a missing unit, or a value that is not finite.
    """
    if isinstance(given, list):
        parts = [to_si(part, unit, f"{key}.{i}", default_unit) for i, part in enumerate(given)]
        if len({part.shape for part in parts}) > 1:
            raise SceneError(key, "has rows of different length", given)
        return np.array(parts, dtype=float).reshape(len(parts), *(parts[0].shape if parts else ()))
    return np.asarray(_single(given, unit, key, default_unit))


def _single(given: Any, unit: str, key: str, default_unit: str | None) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float | str):
        raise SceneError(key, f"must be {_wanted(unit)}", given)
    if isinstance(given, str):
        if _NOT_FINITE.fullmatch(given):
            raise SceneError(key, "must be finite", given)
        match = _QUANTITY.fullmatch(given)
        if not match:
            raise SceneError(key, f"is no number; it must be {_wanted(unit)}", given)
        number, given_unit = float(match[1]), match[2]
    else:
        number, given_unit = float(given), ""
    if not math.isfinite(number):
        raise SceneError(key, "must be finite", given)
    given_unit = given_unit or default_unit or ""
    if not given_unit and unit:
        raise SceneError(key, f"lacks its unit; it must be {_wanted(unit)}", given)
    value = number * factor(given_unit, unit, key, given)
    if not math.isfinite(value):
        raise SceneError(key, "must be finite", given)
    return value


def factor(given_unit: str, unit: str, key: str = "", given: Any = None) -> float:
    """Size of one `given_unit` in `unit`.

    Raises:
        SceneError: an unknown unit, or one of another dimension.
    """
    source, target = _parsed(given_unit), _parsed(unit)
    if source is None:
        raise SceneError(
            key, f'has the unknown unit "{given_unit}"; it must be {_wanted(unit)}', given
        )
    assert target is not None
    needs_angle = _angle(target) and unit.startswith("rad")
    wrong = source.dimensionality != target.dimensionality
    if wrong or (needs_angle and not _angle(source)) or (not unit and _angle(source)):
        raise SceneError(
            key,
            f'has a unit of another dimension, "{given_unit}"; it must be {_wanted(unit)}',
            given,
        )
    return float(_registry().Quantity(1.0, source).to(target).magnitude)


def as_text(value: float, unit: str, given: Any = None) -> str | float:
    """A number in SI as an entry of a scene file, exact to the last bit.

    Args:
        value: the number.
        unit: its SI unit; a pure number stays a number.
        given: the entry that it replaces, whose unit is kept where that is exact.
    """
    if not unit:
        return float(value)
    match = _QUANTITY.fullmatch(given) if isinstance(given, str) else None
    if match and match[2]:
        scale = factor(match[2], unit)
        for digits in (12, 15, 17):
            text = f"{float(value) / scale:.{digits}g}"
            if float(text) * scale == value:
                return f"{text} {match[2]}"
    return f"{float(value)!r} {unit}"


@cache
def _registry() -> pint.UnitRegistry:
    import pint  # only who reads a unit pays for it

    return pint.UnitRegistry()


@cache
def _parsed(unit: str) -> pint.Unit | None:
    """The unit, or `None` if it is unknown; accepts `cm3` for `cm^3` and `r/min` for `rpm`."""
    text = re.sub(r"([A-Za-z])(\d)", r"\1^\2", unit)
    text = re.sub(r"\b(r|rev)/min\b", "rpm", text)
    if text and (_NOT_FINITE.fullmatch(text) or not re.search(r"[^\W\d]|%", text)):
        return None
    try:
        parsed = _registry().parse_units(text)
        _registry().Quantity(1.0, parsed).to_root_units()
    except Exception:  # the parser of units fails in many ways on text that is none
        return None
    # a scale with an offset (degC) has no factor
    return parsed if _registry().Quantity(0.0, parsed).to_root_units().magnitude == 0 else None


def _angle(unit: pint.Unit) -> bool:
    return "radian" in str(_registry().get_root_units(unit)[1])


def _wanted(unit: str) -> str:
    if not unit:
        return "a pure number without a unit (% is accepted)"
    example = _EXAMPLES.get(unit, f"1.5 {unit}")
    return f'a text with a unit of the kind [{unit}], such as "{example}"'
