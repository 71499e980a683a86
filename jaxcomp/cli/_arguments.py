"""What is typed behind options: settings, numbers with units, bounds, speeds.

What cannot be read or set ends in a `CommandError`, a `SceneError` or `BadInput`.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jaxcomp as jc

from .._core.progress import watch_compiles
from ._start import CommandError, refuse

if TYPE_CHECKING:
    import numpy as np

# No quantity that is shown in per cent gets there.
_LARGEST_SHARE = 2.0
_BOUND = re.compile(r"\s*([\w.-]+)\s*(<=|>=|=)\s*(.+?)\s*")
# Points of a range of speeds that names none, and the most.
_POINTS = 60
_MOST = 100_000


def split_at(sign: str, text: str) -> tuple[str, str, str]:
    """The text before a sign, the sign, "" if it is absent, and the text behind it.

    >>> split_at("=", "mechanism.bore = 52mm")
    ('mechanism.bore', '=', '52mm')
    """
    before, separator, behind = text.partition(sign)
    return before.strip(), separator.strip(), behind.strip()


def listed(text: str) -> list[str]:
    """The entries of a list with commas."""
    return list(filter(None, map(str.strip, text.split(","))))


def assignments(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """Split `name=value` texts."""
    out: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = split_at("=", text)
        refuse(not (name and equals and value), f'{option} {text}: must have the form "name=value"')
        refuse(name in out, f"{option} {text}: {name} is set twice")
        out[name] = value
    return out


def names_of(text: str | None) -> list[str] | None:
    """The names in a list with commas; `None` for none."""
    if text is None:
        return None
    return listed(text)


def with_one_unit(parts: Sequence[str]) -> list[str]:
    """The values of a range or list; bare numbers before the last take the unit of the last.

    >>> with_one_unit(["60", "80mm"])
    ['60 mm', '80mm']
    """
    from ..scene._text import NUMBER

    parts = list(map(str.strip, parts))
    number = re.match(rf"{NUMBER}\s*", parts[-1])
    if number is None or number.end() == len(parts[-1]):
        return parts
    unit = parts[-1][number.end() :]
    values = []
    for part in parts:
        is_bare = re.fullmatch(NUMBER, part)
        values.append(f"{part} {unit}" if is_bare else part)
    return values


def entry(text: str) -> Any:
    """The entry of a machine file that a text stands for.

    What is valid TOML counts as such (`0.02`, `true`, `[1, 2]`), the word `none` takes an optional
    entry away, and everything else is a text (`800rpm`).
    """
    if text == "none":
        return None
    try:
        return tomllib.loads(f"entry = {text}")["entry"]
    except (ValueError, RecursionError):  # no TOML, or a number or list that is none in earnest
        return text


def changed_scene(
    name_or_path: str,
    sets: Sequence[str] | None = None,
    designs: Sequence[str] | None = None,
    varied: Sequence[str] | None = None,
) -> jc.scene.Scene:
    """Load a scene and set values: entries of its file, then design rules and correction masses.

    Numbers that `varied`, texts such as "mechanism.bore.2=1mm", names for single cylinders become
    lists over the cylinders.
    """
    from ..scene._change import with_lists

    texts = {**assignments(sets, "--set"), **assignments(designs, "--design")}
    changes = {path: entry(text) for path, text in texts.items()}
    scene = jc.scene.load(name_or_path)
    watch_compiles(scene.name)
    if changes:
        scene = jc.scene.with_values(scene, changes, "set on the command line")
    return with_lists(scene, [split_at("=", text)[0] for text in varied or ()])


def si(
    text: str, unit: str, option: str, difference: bool = False, default_unit: str | None = None
) -> float:
    """[SI] A number of the command line, or a difference of two; bare ones have the default unit."""
    from ..scene._units import to_si

    if not text:
        raise jc.scene.SceneError(option, "lacks a value")
    number = entry(text)
    if number is None:
        number = text  # so that the message names the word `none`
    return float(to_si(number, unit, option, default_unit, difference))


def value_of(name: str, text: str, option: str) -> float:
    """[SI] A value of a quantity."""
    from ..study._analysis import quantity_named

    quantity = quantity_named(name)
    value = si(text, quantity.unit, option)
    if quantity.percent and abs(value) > _LARGEST_SHARE:
        raise CommandError(f'{option}: {text} would be {100 * value:g} %; is "{text} %" meant?')
    return value


def bounds_of(
    texts: Sequence[str] | None, option: str, equalities: bool = True
) -> dict[str, tuple[float | None, float | None]]:
    """[SI] (low, high) by quantity, `None` for an open end, of texts as `peak_force.crank_pin<=8kN`."""
    out: dict[str, tuple[float | None, float | None]] = {}
    for text in texts or ():
        match = _BOUND.fullmatch(text)
        if not match or (match[2] == "=" and not equalities):
            signs = "<=VALUE, >= or =" if equalities else "<=VALUE or >="
            raise CommandError(f"{option} {text}: must have the form QUANTITY{signs}")
        name, sign, bound_text = match.groups()
        value = value_of(name, bound_text, f"{option} {name}")
        low, high = out.get(name, (None, None))
        if (sign != "<=" and low is not None) or (sign != ">=" and high is not None):
            raise CommandError(f"{option} {text}: {name} has such a bound already")
        if sign != "<=":
            low = value
        if sign != ">=":
            high = value
        out[name] = (low, high)
    return out


def speed_of(text: str, option: str) -> float:
    """[rad/s] A speed of the command line."""
    from ..scene._units import to_si

    # there a frequency of rotation can be nothing but a speed
    text = re.sub(r"\s*hz\s*$", " turn/s", text.strip(), flags=re.IGNORECASE)
    value = float(to_si(text, "rad/s", option))
    refuse(value < 0, f"{option}: must be >= 0 rad/s")
    return value


def speeds_of(text: str) -> np.ndarray:
    """[rad/s] The speeds of `--speeds a,b,c`, `from:to` or `from:to:count`."""
    import numpy as np

    parts = text.split(":")
    option = f"--speeds {text}"
    if len(parts) == 1 and text.strip():
        texts = [text]
        if "," in text:
            texts = with_one_unit(text.split(","))
        return np.array([speed_of(part, option) for part in texts])
    if len(parts) not in (2, 3):
        raise CommandError(f"{option}: must have the form a,b,c or from:to or from:to:count")
    low, high = (speed_of(part, option) for part in with_one_unit(parts[:2]))
    count = _POINTS
    if len(parts) == 3:
        if not parts[2].strip().isdigit():
            raise CommandError(f"{option}: the number of points must be a whole number")
        count = int(parts[2])
    refuse(not low < high, f"{option}: must rise")
    refuse(not 2 <= count <= _MOST, f"{option}: must have 2 to {_MOST} points")
    return np.linspace(low, high, count)
