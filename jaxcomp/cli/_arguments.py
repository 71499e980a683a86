"""Arguments that several commands share: `--set path=value`."""

import re
import tomllib
from collections.abc import Sequence
from typing import Any

from ._errors import CommandError


def assignments(texts: Sequence[str], option: str) -> dict[str, str]:
    """Split `name=value` texts.

    Raises:
        CommandError: no `=`, an empty side, or the same name twice.
    """
    out: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise CommandError(f'{option} {text}: must have the form "name=value"')
        if name in out:
            raise CommandError(f"{option} {text}: {name} is set twice")
        out[name] = value
    return out


def with_one_unit(parts: Sequence[str]) -> list[str]:
    """The values of a range or list; bare numbers before the last take the unit of the last.

    >>> with_one_unit(["60", "80mm"])
    ['60 mm', '80mm']
    """
    from ..scene import NUMBER

    parts = [part.strip() for part in parts]
    number = re.match(rf"{NUMBER}\s*", parts[-1])
    unit = parts[-1][number.end() :] if number else ""
    return [f"{part} {unit}" if unit and re.fullmatch(NUMBER, part) else part for part in parts]


def entry(text: str) -> Any:
    """The entry of a scene file that a text stands for.

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
    sets: Sequence[str],
    designs: Sequence[str] = (),
    varied: Sequence[str] = (),
):
    """Load a scene and set values: entries of its file, then design rules and correction masses.

    Numbers that `varied`, texts such as "mechanism.bore.2=1mm", names for single cylinders become
    lists over the cylinders.

    Raises:
        CommandError, SceneError, BadInput: what cannot be read or set.
    """
    from ..scene import load, with_lists, with_values

    texts = {**assignments(sets, "--set"), **assignments(designs, "--design")}
    changes = {path: entry(text) for path, text in texts.items()}
    scene = load(name_or_path)
    if changes:
        scene = with_values(scene, changes, "set on the command line")
    return with_lists(scene, (text.partition("=")[0].strip() for text in varied))
