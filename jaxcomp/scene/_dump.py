"""TOML text of a scene."""

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(document: Mapping[str, Any]) -> str:
    """TOML of nested tables, lists, texts, numbers and truth values; values before sections."""
    return "\n".join(_section(document, ())).strip() + "\n"


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
