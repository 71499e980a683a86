"""TOML text of a scene."""

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

_LONGEST_KEPT = 300_000  # characters, for which tomlkit needs seconds
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(document: Mapping[str, Any]) -> str:
    """TOML of nested tables, lists, texts, numbers and truth values; values before sections."""
    return "\n".join(_section(document, ())).strip() + "\n"


def toml_text_like(text: str, document: Mapping[str, Any]) -> str:
    """TOML of the same tables, with the comments, the order and the layout of a text where they agree.

    Args:
        text: TOML as a user wrote it.
        document: what the result has to hold.
    """
    if len(text) > _LONGEST_KEPT:
        return toml_text(document)
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        kept = tomlkit.parse(text)
        _update(kept, document)
        out = tomlkit.dumps(kept)
        same = tomllib.loads(out) == document
    except (TOMLKitError, tomllib.TOMLDecodeError):
        same = False
    return out if same else toml_text(document)


def is_section(value: Any) -> bool:
    """Whether an entry is a table of its own, and not a value with its unit and source."""
    return isinstance(value, Mapping) and "value" not in value


def is_row_of_sections(value: Any) -> bool:
    """Whether an entry is a list of tables."""
    return isinstance(value, list) and bool(value) and all(is_section(item) for item in value)


def _section(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = []
    for key, value in table.items():
        if not is_section(value) and not is_row_of_sections(value):
            lines.append(f"{key_text(key)} = {value_text(value)}")
    for key, value in table.items():
        name = (*path, key)
        title = ".".join(map(key_text, name))
        if is_section(value):
            lines += ["", f"[{title}]", *_section(value, name)]
        elif is_row_of_sections(value):
            for row in value:
                lines += ["", f"[[{title}]]", *_section(row, name)]
    return lines


def _update(kept: Any, document: Mapping[str, Any]) -> None:
    """Make tables of tomlkit hold what a document holds, and touch nothing that agrees."""
    for key in [key for key in kept if key not in document]:
        kept.remove(key)
    olds = kept.unwrap()
    for key, value in document.items():
        old = olds.get(key)
        if old == value and type(old) is type(value):
            continue
        if is_section(value) and is_section(old):
            _update(kept[key], value)
        elif is_row_of_sections(value) and is_row_of_sections(old) and len(old) == len(value):
            for row, wanted in zip(kept[key], value, strict=True):
                _update(row, wanted)
        else:
            kept[key] = _item(key, value)


def _item(key: str, value: Any) -> Any:
    import tomlkit

    return tomlkit.parse(toml_text({key: value}))[key]


def key_text(key: str) -> str:
    """A key, in quotes where it needs them."""
    return key if _BARE.fullmatch(key) else _string(key)


def value_text(value: Any) -> str:
    """A value in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, list):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key_text(k)} = {value_text(v)}" for k, v in value.items()) + " }"
    return str(value)  # dates and times


def _string(text: str) -> str:
    # JSON's escapes are those of TOML, but for one control character
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
