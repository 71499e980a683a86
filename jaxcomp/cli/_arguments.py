"""Arguments that several commands share: `--set path=value` and `--design name=value`."""

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


def changed_scene(name_or_path: str, sets: Sequence[str], designs: Sequence[str]):
    """Load a scene, set values, then apply the rules of design variables.

    Raises:
        CommandError, SceneError, BadInput: what cannot be read, set or designed.
    """
    from .. import scene as scenes
    from ..design import design_rules, variable_names

    scene = scenes.load(name_or_path)
    changes = {path: entry(text) for path, text in assignments(sets, "--set").items()}
    if changes:
        scene = scenes.with_values(scene, changes, source="set on the command line")
    for name, text in assignments(designs, "--design").items():
        if name not in design_rules:
            known = [rule for rule in variable_names(scene.machine) if rule in design_rules]
            hint = scenes.did_you_mean(name, known)
            raise CommandError(f"--design {name}={text}: is no design variable{hint}")
        rule = design_rules[name]
        given = entry(text)
        value = scenes.to_si(text if given is None else given, rule.unit, f"--design {name}")
        machine = rule.apply(scene.machine, value)
        scene = scenes.with_machine(scene, machine, f"design rule, {name} = {text}")
    return scene
