r"""Numbers in the units in which people speak of them."""

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from .registry import registered_quantity

# [rpm] in 1 rad/s
RPM = 30 / math.pi
ZERO_CELSIUS = 273.15  # [K]
# Endings of pure numbers that people give in per cent, beside the quantities of the registry.
_SHARES = ("efficiency", "fluctuation", "clearance_ratio")
# (size from which on it is used, factor from SI, name) of units, the largest first.
_UNITS = {
    "m": ((10.0, 1.0, "m"), (2e-3, 1e3, "mm"), (0.0, 1e6, "µm")),
    "m^3": ((0.1, 1.0, "m³"), (0.0, 1e6, "cm³")),
    "rad/s": ((0.0, RPM, "rpm"),),
    "rad": ((0.0, 180 / math.pi, "°"),),
    "s": ((1.0, 1.0, "s"), (0.0, 1e3, "ms")),
    "J": ((1e4, 1e-3, "kJ"), (0.0, 1.0, "J")),
    "Pa": ((1e9, 1e-9, "GPa"), (1e5, 1e-6, "MPa"), (0.0, 1e-3, "kPa")),
    "Pa s": ((0.0, 1e3, "mPa s"),),
    "W": ((1e3, 1e-3, "kW"), (0.0, 1.0, "W")),
    "N": ((1e3, 1e-3, "kN"), (0.0, 1.0, "N")),
    "N/m": ((1e5, 1e-6, "MN/m"), (0.0, 1.0, "N/m")),
    "kg/s": ((0.1, 1.0, "kg/s"), (0.0, 1e3, "g/s")),
    "kg": ((0.1, 1.0, "kg"), (0.0, 1e3, "g")),
    "kg m": ((0.1, 1.0, "kg m"), (0.0, 1e6, "g mm")),
}
# Size of one SI unit in each of these units, by its name; of pure numbers and of flows of oil as well.
SHOWN_FACTORS = {name: factor for units in _UNITS.values() for _, factor, name in units}
SHOWN_FACTORS |= {"%": 100.0, "cm3/min": 6e7}
# The same in units of the United States.
_CUSTOMARY = {
    "m": ((0.0, 1 / 0.0254, "in"),),
    "m^3": ((0.0, 0.0254**-3, "in³"),),
    "Pa": ((0.0, 1 / 6894.757293168361, "psi"),),
    "W": ((100.0, 1 / 745.6998715822702, "hp"), (0.0, 1.0, "W")),
    "N": ((0.0, 1 / 4.4482216152605, "lbf"),),
    "N m": ((0.0, 1 / 1.3558179483314004, "lbf ft"),),
    "N/m": ((0.0, 0.0254 / 4.4482216152605, "lbf/in"),),
    "kg": ((0.0, 1 / 0.45359237, "lb"),),
    "kg m": ((0.0, 1 / (0.45359237 * 0.0254), "lb in"),),
    "kg/s": ((0.0, 3600 / 0.45359237, "lb/h"),),
}
# Units to choose from: SI, the same with temperatures in degrees Celsius, and those of the United States.
SYSTEMS = ("SI", "SI with °C", "US")
# Endings of names of temperatures. Other kelvins are differences: 10 K of superheat are not 283 K.
_TEMPERATURES = ("temperature", "evaporating", "condensing")
# Endings of names of growths of modes, real parts of eigenvalues: rates, and no speeds of rotation.
_GROWTHS = ("growth",)
# Units of small changes.
_SMALL = ("mm", "g mm", "g", "°", "rpm")


class Shown(NamedTuple):
    """Format in which a variable or quantity is shown.

    Attributes:
        words: its name.
        unit: in which it is shown, "" for a pure number.
        factor: [-] from SI to that unit.
        zero: what the unit shows at zero in SI: of degrees, not of others.
        celsius: whether values stand in degrees Celsius as well, beside kelvins.
    """

    words: str
    unit: str
    factor: float
    zero: float = 0.0
    celsius: bool = False

    @property
    def units(self) -> str:
        """The unit, or both, of `number`."""
        return f"{self.unit} (°C)" if self.celsius else self.unit

    @property
    def label(self) -> str:
        """Name and unit, for the head of a column."""
        return f"{self.words}, {self.units}" if self.unit else self.words

    @property
    def level(self) -> bool:
        """Whether values are temperatures, whose ratios mean nothing."""
        return bool(self.zero) or self.celsius

    @property
    def drawn(self) -> "Shown":
        """Format for an axis, which has one unit: that of temperatures is °C."""
        if not self.celsius:
            return self
        return Shown(self.words, "°C", 1.0, -ZERO_CELSIUS)

    def of(self, values: Any) -> Any:
        """Values [SI] in the unit."""
        # a zero has no sign
        return values * self.factor + (self.zero + 0.0)

    def number(self, value: float, digits: int = 5) -> str:
        """A value [SI] without its unit, to so many `digits`."""
        number = f"{self.of(value):.{digits}g}"
        if self.celsius:
            number += f" ({self.drawn.of(value):.{digits}g})"
        return number

    def text(self, value: float, digits: int = 5) -> str:
        """A value [SI] with its unit, to so many `digits`."""
        text = f"{self.of(value):.{digits}g} {self.unit}".strip()
        if self.celsius:
            text += f" ({self.drawn.text(value, digits)})"
        return text

    @property
    def differences(self) -> "Shown":
        """Format for differences of values, such as deviations: they have no zero."""
        return self._replace(zero=0.0, celsius=False)

    def difference(self, value: float, digits: int = 5) -> str:
        """The difference of two values [SI] with its unit, to so many `digits`; of shares in points."""
        text = self.differences.text(value, digits)
        if self.unit == "%":
            text = f"{text.removesuffix('%')}points"
        return text


def spelled(name: str) -> tuple[str, bool]:
    """The words of a variable or quantity, and whether it is shown in per cent as a pure number."""
    ending = name.rpartition(".")[2]
    quantity = registered_quantity(name) or registered_quantity(ending)
    words = re.sub(r"[._-]", " ", name)
    if quantity is None:
        percent = ending.endswith(_SHARES)
    else:
        percent = quantity.percent
        # words of a quantity do not say of which part it is, as a dotted name does
        if quantity.words and quantity.name == name:
            words = quantity.words
    return words[:1].upper() + words[1:], percent


def is_temperature(name: str, unit: str) -> bool:
    """Whether a number is a temperature, and no difference of temperatures."""
    # a number of a list ends with its place in it, as inlet_temperature.1
    return unit == "K" and re.sub(r"(\.\d+)+$", "", name).endswith(_TEMPERATURES)


def shown(name: str, unit: str, values, system: str = "SI") -> Shown:
    """The unit that suits the size of some values.

    Args:
        name: of the variable or quantity.
        unit: SI unit of the values.
        values: [SI], of any shape; those that are not finite do not count.
        system: one of `SYSTEMS`.
    """
    words, percent = spelled(name)
    if not unit and percent:
        return Shown(words, "%", 100.0)
    if not unit:
        return Shown(words, "", 1.0)
    if name.endswith(_GROWTHS):
        return Shown(words, unit.replace("rad/s", "1/s"), 1.0)
    if is_temperature(name, unit):
        kelvin = Shown(words, unit, 1.0, celsius=True)
        # 32 °F at 273.15 K, carried back to 0 K
        fahrenheit = Shown(words, "°F", 1.8, 32 - 1.8 * ZERO_CELSIUS)
        return {"SI": kelvin, "US": fahrenheit}.get(system, kelvin.drawn)
    units = _UNITS
    if system == "US":
        units = _UNITS | _CUSTOMARY
    import numpy as np  # not before it is needed: help and completion start without it

    values = np.abs(np.asarray(values, dtype=float))
    values = values[np.isfinite(values)]
    size = 0.0
    if values.size:
        size = values.max()
    for least, factor, name_of_unit in units.get(unit, ()):
        # Zeros have no size to choose a unit by and stay in SI, but for angles and speeds, whose units
        # do not go by size.
        if size >= least and (size or unit.startswith("rad")):
            return Shown(words, name_of_unit, factor)
    return Shown(words, unit, 1.0)


def units_of(unit: str, percent: bool = False) -> str:
    """The units in which values of an SI unit are shown, as `kW, W`."""
    if percent:
        return "%"
    return ", ".join(name for _, _, name in _UNITS.get(unit, ((0.0, 1.0, unit),)))


def small_unit(unit: str) -> tuple[str, float]:
    """The unit of small changes and of corrections, with the factor from the SI unit to it."""
    for _, factor, name in _UNITS.get(unit, ()):
        if name in _SMALL:
            return name, factor
    return unit, 1.0


def vibration_unit(unit: str) -> tuple[str, float]:
    """The unit in which a vibration is shown, micrometres of displacements, with the factor to it."""
    if unit == "m":
        return "µm", 1e6
    return unit, 1.0


def axes_words(banks: Sequence[float]) -> str:
    """Names of the axes x and y of a machine, by the directions of its cylinders [rad]."""
    # rounded, so that banks that differ in the last digits are one direction
    degrees = sorted({round(math.degrees(bank), 6) for bank in banks})
    if not any(degrees):
        return "x: along the cylinder towards the head; y: across."
    directions = ", ".join(f"{degree:.4g}°" for degree in degrees)
    return (
        f"x, y: axes of the machine; its cylinders stand at {directions} from x, counted with "
        "rotation."
    )


def rounded(value: float, digits: int) -> str:
    """A number to so many digits, and to whole ones where it has more of them before the point."""
    if abs(value) >= 10**digits:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


_ALIGNED = re.compile(
    r"[<+±-]?[\d,]*\d(?P<decimals>\.\d+)?(?P<power>e[+-]\d+)?(?P<unit> ?[^\s\d]\S*)?"
)


def behind(texts: Sequence[str]) -> list[str]:
    """Padding behind numbers for their points to stand in a column: as wide as digits, and never to be
    read.

    All numbers must have the same unit, or none; otherwise they stay as they are, as texts do.

    >>> behind(["74.8", "6.079", "0", ""])
    ['00', '', '.000', '']
    >>> behind(["5.6 kW", "12 kW"])
    ['', '.0']
    """
    matches = [_ALIGNED.fullmatch(text) for text in texts]
    numbers = [match for match in matches if match is not None]
    units = set()
    longest = ""
    power = ""
    for match in numbers:
        units.add(match["unit"])
        longest = max(longest, match["decimals"] or "", key=len)
        power = max(power, match["power"] or "", key=len)
    if len(numbers) < sum(map(bool, texts)) or len(units) > 1:
        return [""] * len(texts)

    def lacking(match: re.Match | None) -> str:
        if match is None:
            return ""
        decimals = match["decimals"] or ""
        return longest[len(decimals) :] + power[len(match["power"] or "") :]

    return [re.sub(r"\d", "0", lacking(match)) for match in matches]
