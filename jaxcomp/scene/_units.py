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

from .._core.display import ZERO_CELSIUS, is_temperature
from .._core.errors import BadInput
from ._text import NUMBER, SceneError

if TYPE_CHECKING:
    import pint

_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*")
_DECIMAL_COMMA = re.compile(r"\s*([+-]?\d*),(\d+\b.*)")
# Names with small powers, products and quotients. Signs that the parser of units would ignore (quotes,
# currency signs) and powers of powers, which it would compute for years, do not reach it.
_POWER = r"\^\s*(?:[+-]?\d{1,2}(?:\.\d{1,3})?|\([+-]?\d{1,2}(?:[./]\d{1,3})?\))(?!\s*[\^\d])"
_PIECE_OF_UNIT = re.compile(rf"[^\W\d]\w*|%|{_POWER}|1(?=\s*/)|[*/·.()\s]")
_POWER_OF_POWER = re.compile(r"\^.*\)\s*\^")
_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_LONGEST_UNIT = 60
_LONGEST_TEXT = 200
_GRADE = re.compile(
    r"\s*(?:ISO[\s-]*)?(VG|SAE)[\s-]*(\d+(?:\.\d+)?)\s*(?:@|at|,)?\s*"
    r"([+-]?\d+(?:\.\d+)?)\s*(degC|°C|C|degF|°F|F|K)\s*",
    re.IGNORECASE,
)
# Summer grades of SAE J300 by the ISO VG whose viscosity at 100 degrees Celsius, as `iso_vg_viscosity`
# has it, lies within their limits there (6.9, 9.3, 12.5, 16.3, 21.9, 26.1 mm^2/s).
SAE_GRADES = {"20": 68.0, "30": 100.0, "40": 150.0, "50": 220.0, "60": 320.0}
# Size and zero [K] of the degrees in which temperatures are given; differences have no zero.
_LEVELS = dict.fromkeys(("degc", "°c", "c", "celsius"), (1.0, ZERO_CELSIUS))
_LEVELS |= dict.fromkeys(("degf", "°f", "f", "fahrenheit"), (5 / 9, 459.67 * 5 / 9))
# What catalogues write for units that the registry has under another name.
_SPELLINGS = {
    "RPM": "rpm", "lbm": "lb", "psia": "psi", "bara": "bar", "kPaa": "kPa", "TR": "refrigeration_ton"
}  # fmt: skip
# Units of pressures over that of the surroundings, by the unit of absolute ones.
_GAUGES = {"barg": "bar", "psig": "psi", "kPag": "kPa", "MPag": "MPa"}
_ATMOSPHERE = 101325.0  # [Pa]
_DEGREES = (*_LEVELS, "k", "kelvin")
_NOT_FINITE = re.compile(r"\s*[+-]?(nan|inf|infinity)\b.*", re.IGNORECASE)
_EXAMPLES = {
    "m": "130 mm",
    "rad": "-3 deg",
    "rad/s": "1000 rpm",
    "Pa": "0.98 MPa",
    "kg": "2.65 kg",
    "N m": "120 N m",
    "Pa s": "4 mPa s",
    "K": "10 K",
}
# What most files use, so that they are read without the registry of units, which takes half a second.
FREQUENT = {
    ("mm", "m"): 1e-3, ("um", "m"): 1e-6, ("g", "kg"): 1e-3, ("g mm", "kg m"): 1e-6,
    ("deg", "rad"): math.radians(1), ("rpm", "rad/s"): 0.10471975511965977, ("%", ""): 0.01,
    ("kPa", "Pa"): 1e3, ("bar", "Pa"): 1e5, ("MPa", "Pa"): 1e6, ("GPa", "Pa"): 1e9,
    ("kN/m", "N/m"): 1e3, ("N/mm", "N/m"): 1e3, ("mPa s", "Pa s"): 1e-3, ("W/m/K", "W/(m K)"): 1.0,
}  # fmt: skip


def to_si(
    written: Any, unit: str, key: str, default_unit: str | None = None, difference: bool = False
) -> np.ndarray:
    """A value of a machine file in SI units.

    A temperature may be given in degrees ("-23.3 degC"), a difference of temperatures in K only.

    Args:
        written: number, text with a unit, or (nested) list of them.
        unit: SI unit of the result, empty for a pure number.
        key: dotted path of the entry, for the message.
        default_unit: unit of bare numbers, where one was given for all of them.
        difference: whether it is one of two values, such as a tolerance, whatever the key.

    Returns:
        [SI] Array in `unit`; of shape () for a single value.

    Raises:
        SceneError: no number, another dimension, a missing unit, or a value that is not finite.
    """
    if isinstance(written, list):
        parts = []
        for i, part in enumerate(written):
            parts.append(to_si(part, unit, f"{key}.{i}", default_unit, difference))
        if len({part.shape for part in parts}) > 1:
            raise SceneError(key, "has rows of different length", written)
        inner_shape = parts[0].shape if parts else ()
        return np.array(parts, dtype=float).reshape(len(parts), *inner_shape)
    level = not difference and is_temperature(key.partition("=")[0], unit)  # of an option
    return np.asarray(_single(written, unit, key, default_unit, level))


def _quantity(written: Any) -> re.Match | None:
    """Number and unit of a text; `None` for anything else."""
    if not isinstance(written, str):
        return None
    return _QUANTITY.fullmatch(written)


def _single(written: Any, unit: str, key: str, default_unit: str | None, level: bool) -> float:
    expected = _expected(unit, level)
    if isinstance(written, bool) or not isinstance(written, int | float | str):
        raise SceneError(key, f"must be {expected}", written)
    if isinstance(written, str):
        if _NOT_FINITE.fullmatch(written[:_LONGEST_TEXT]):
            raise SceneError(key, "must be finite", written)
        if unit == "Pa s" and (grade := _GRADE.fullmatch(written[:_LONGEST_TEXT])):
            return _oil_viscosity(grade, key, written)
        number, given_unit = _number_and_unit(written, key, expected)
    else:
        # a whole number has as many digits as the file gives it
        number = math.inf
        if abs(written) < 1e308:
            number = float(written)
        given_unit = ""
    if not math.isfinite(number):
        raise SceneError(key, "must be finite", written)
    given_unit = given_unit or default_unit or ""
    if not given_unit and unit:
        raise SceneError(key, f"lacks its unit; it must be {expected}", written)
    size, zero = scale(given_unit, unit, level, key, written)
    value = number * size + zero
    if not math.isfinite(value):
        raise SceneError(key, "must be finite", written)
    return value


def _number_and_unit(text: str, key: str, expected: str) -> tuple[float, str]:
    """Number and unit of a text, of which each must be written as machine files have them.

    Raises:
        SceneError: no number, or one with a decimal comma.
    """
    match = None
    if len(text) <= _LONGEST_TEXT:
        match = _QUANTITY.fullmatch(text)
    # behind a number stands no second point, as in 1.2.3 mm
    if not match or text[match.end(1) :].startswith("."):
        raise SceneError(key, f"is no number; it must be {expected}", text)
    if comma := _DECIMAL_COMMA.fullmatch(text):
        point = f"{comma[1]}.{comma[2]}"
        raise SceneError(key, f'has a decimal comma; write "{point}"', text)
    return float(match[1]), match[2]


def scale(
    given_unit: str, unit: str, level: bool, key: str = "", written: Any = None
) -> tuple[float, float]:
    """Size of one `given_unit` in `unit`, and its zero.

    Args:
        given_unit: of the number.
        unit: SI unit.
        level: whether a temperature is meant, and no difference of temperatures.
        key, written: of the entry, for the message.

    Raises:
        SceneError: as `factor`, and a unit of temperatures for a difference of them.
    """
    degrees = None
    if unit == "K":
        degrees = _LEVELS.get(given_unit.lower())
    if degrees and not level:
        match = _quantity(written)
        advice = "its unit is K or delta_degF"
        if match:
            advice = f'write "{float(match[1]) * degrees[0]:g} K"'
        raise SceneError(
            key,
            f"is a temperature, where a difference of temperatures is needed; {advice}",
            written,
        )
    return degrees or (factor(given_unit, unit, key, written), 0.0)


def factor(given_unit: str, unit: str, key: str = "", written: Any = None) -> float:
    """Size of one `given_unit` in `unit`.

    Raises:
        SceneError: an unknown unit, or one of another dimension.
    """
    if given_unit == unit:
        return 1.0
    if (given_unit, unit) in FREQUENT:
        return FREQUENT[given_unit, unit]
    source = _parsed(given_unit)
    target = _parsed(unit)
    advice = _advice(given_unit, unit, written)
    if advice:
        raise SceneError(key, advice, written)
    if source is None:
        raise SceneError(
            key, f'has the unknown unit "{given_unit}"; it must be {_expected(unit)}', written
        )
    assert target is not None
    needs_angle = _angle(target) and unit.startswith("rad")
    wrong = source.dimensionality != target.dimensionality
    if wrong or (needs_angle and not _angle(source)) or (not unit and _angle(source)):
        raise SceneError(
            key,
            f'has a unit of another dimension, "{given_unit}"; it must be {_expected(unit)}',
            written,
        )
    return float(_registry().Quantity(1.0, source).to(target).magnitude)


def _advice(given_unit: str, unit: str, written: Any) -> str:
    """Advice for units that are often meant and have another dimension."""
    match = _quantity(written)
    if match is None:
        return ""
    number = float(match[1])
    if unit == "rad/s" and given_unit in ("Hz", "hertz"):
        return f'is a frequency, where a speed of rotation is needed; write "{60 * number:g} rpm"'
    if unit == "Pa" and given_unit in _GAUGES:
        absolute = _GAUGES[given_unit]
        pressure = number + _ATMOSPHERE / factor(absolute, "Pa")
        return (
            "is a pressure over that of the surroundings, where an absolute one is needed; at sea level "
            f'that is "{pressure:.6g} {absolute}"'
        )
    if given_unit.lower() not in _DEGREES:
        return ""
    if unit == "Pa":
        return (
            "is a temperature, where a pressure is needed; write the saturation pressure of the "
            f'refrigerant at that temperature, such as "{_EXAMPLES["Pa"]}"'
        )
    if unit == "Pa s":
        return (
            "is a temperature, where a viscosity is needed; write a grade with it, "
            f'such as "VG 46 at {written.strip()}"'
        )
    return ""


def _oil_viscosity(grade: re.Match, key: str, written: str) -> float:
    """[Pa s] Viscosity of an oil by its grade and temperature."""
    from ..film import iso_vg_viscosity

    standard, number, temperature, unit = grade.groups()
    if standard.upper() == "SAE":
        if number not in SAE_GRADES:
            grades = ", ".join(SAE_GRADES)
            problem = (
                f"is no grade of SAE J300 for summer; known are {grades}; or write a viscosity"
            )
            raise SceneError(key, problem, written)
        number = SAE_GRADES[number]
    size, zero = _LEVELS.get(unit.lower(), (1.0, 0.0))
    kelvin = float(temperature) * size + zero
    try:
        return float(iso_vg_viscosity(float(number), kelvin))
    except BadInput as error:
        raise SceneError(key, f"needs a {error.field} {error.bound}", written) from None


def as_text(value: Any, unit: str, written: Any = None) -> Any:
    """A number in SI as an entry of a machine file, exact to the last bit; a list for an array.

    Args:
        value: the number, or an array.
        unit: its SI unit; a pure number stays a number.
        written: the entry that it replaces, whose unit is kept where that is exact.
    """
    if np.ndim(value):
        if not isinstance(written, list) or len(written) != len(value):
            written = [None] * len(value)
        texts = []
        for item, written_item in zip(value, written, strict=True):
            texts.append(as_text(item, unit, written_item))
        return texts
    if not unit:
        return float(value)
    match = _quantity(written)
    if match and match[2]:
        size, zero = scale(match[2], unit, True)
        # the shortest that is exact: 17 digits always are, but for the rounding of the unit
        for digits in (12, 15, 17):
            text = f"{(float(value) - zero) / size:.{digits}g}"
            if float(text) * size + zero == value:
                return f"{text} {match[2]}"
    return f"{float(value)!r} {unit}"


def in_celsius(written: Any, key: str) -> Any:
    """An entry of a machine file, in degrees Celsius where it is a temperature in kelvins."""
    if isinstance(written, list):
        return [in_celsius(item, f"{key}.{at}") for at, item in enumerate(written)]
    match = _quantity(written)
    if match is None or match[2] != "K" or not is_temperature(key, "K"):
        return written
    return f"{float(match[1]) - ZERO_CELSIUS:.10g} degC"


@cache
def _registry() -> pint.UnitRegistry:
    import pint  # only who reads a unit pays for it

    return pint.UnitRegistry()


def _is_of_pieces(text: str) -> bool:
    """Whether a text is one piece of a unit after another.

    No possessive repetition of them all: Python before 3.11.5 then takes pieces that do not fit.
    """
    place = 0
    while piece := _PIECE_OF_UNIT.match(text, place):
        place = piece.end()
    return place == len(text)


@cache
def _parsed(unit: str) -> pint.Unit | None:
    """The unit, or `None` if it is unknown; accepts `cm3` for `cm^3` and `r/min` for `rpm`."""
    if len(unit) > _LONGEST_UNIT:
        return None
    text = re.sub("[⁻⁰¹²³⁴-⁹]+", lambda power: f"^{power[0].translate(_LOWERED)}", unit)
    text = re.sub(r"([A-Za-z])(\d)", r"\1^\2", text.replace("**", "^"))
    text = re.sub(r"\b(r|rev)/min\b", "rpm", text)
    text = re.sub(r"[A-Za-z]+", lambda name: _SPELLINGS.get(name[0], name[0]), text)
    if not _is_of_pieces(text) or _POWER_OF_POWER.search(text):
        return None
    if text and (_NOT_FINITE.fullmatch(text) or not re.search(r"[^\W\d]|%", text)):
        return None
    try:
        parsed = _registry().parse_units(text)
        _registry().Quantity(1.0, parsed).to_root_units()
    except Exception:  # the parser of units fails in many ways on text that is none
        return None
    # a scale with an offset (degC) has no factor
    if _registry().Quantity(0.0, parsed).to_root_units().magnitude != 0:
        return None
    return parsed


def _angle(unit: pint.Unit) -> bool:
    return "radian" in str(_registry().get_root_units(unit)[1])


def _expected(unit: str, level: bool = False) -> str:
    if level:
        return 'a temperature with its unit, such as "-23.3 degC" or "249.85 K"'
    if not unit:
        return "a pure number without a unit (% is accepted)"
    if unit == "Pa s":
        return (
            f'a text with a unit of the kind [{unit}], such as "{_EXAMPLES[unit]}", or the grade and '
            'temperature of an oil, as "VG 46 at 60 degC" or "SAE 30 at 80 degC"'
        )
    example = _EXAMPLES.get(unit, f"1.5 {unit}")
    return f'a text with a unit of the kind [{unit}], such as "{example}"'
