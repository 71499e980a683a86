"""Tables of a TOML file, with errors that name the key and say what to write."""

import re
import tomllib
import unicodedata
from typing import Any, NamedTuple

from ._errors import SceneError
from ._units import NUMBER

# A file of a machine has some kilobytes, one with measured diagrams some hundred.
_LARGEST = 4_000_000  # [bytes]
_DEEPEST = 20
_LONGEST = 1000  # characters of a text

_LINE = re.compile(r"line (\d+)")
_TITLE = re.compile(r"\s*\[+\s*([^\[\]]+?)\s*\]+\s*(?:#.*)?")
_PAIR = re.compile(r"\s*([\w.\"'-]+)\s*=\s*(.*?)\s*(?:#.*)?")
_TWICE = re.compile(r"overwrite|twice")
_COMMA = re.compile(r"([+-]?\d+),(\d+)(?:\s*([^\s\d,].*))?")
_NUMBER = re.compile(NUMBER)


def toml_tables(data: bytes | str, file: str = "") -> dict[str, Any]:
    """Read TOML.

    Args:
        data: the content of a file in UTF-8, with or without a byte order mark, or a text.
        file: its name in messages.

    Raises:
        SceneError: no text in UTF-8, no TOML, or a file that is too large, nested too deep, or holds
            an overlong text or one with control characters.
    """
    try:
        if len(data) > _LARGEST:
            raise SceneError("", f"is larger than {_LARGEST / 1e6:.0f} MB")
        try:
            text = data if isinstance(data, str) else data.decode("utf-8")
        except UnicodeDecodeError:
            raise SceneError("", "is no text in UTF-8") from None
        text = text.removeprefix("\ufeff")
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise _explained(text, error) from None
        except ValueError:  # Python reads no whole number of more than some thousand digits
            raise SceneError("", "is not valid TOML: a number has too many digits") from None
        except RecursionError:
            raise SceneError("", f"is nested more than {_DEEPEST} deep") from None
        check_tables(tables)
    except SceneError as error:
        raise error.in_file(file) from None
    return tables


def check_tables(tables: dict[str, Any]) -> None:
    """Refuse what no scene has and what would do harm: deep nesting, overlong texts, control characters.

    Raises:
        SceneError: with the path of the entry.
    """
    waiting: list[tuple[str, int, Any]] = [("", 0, tables)]
    while waiting:
        path, depth, value = waiting.pop()
        if isinstance(value, str):
            _check_text(path, value)
        elif depth > _DEEPEST:
            raise SceneError(path, f"is nested more than {_DEEPEST} deep")
        elif isinstance(value, dict):
            for key, entry in value.items():
                _check_text(path, key)
                waiting.append((f"{path}.{key}" if path else key, depth + 1, entry))
        elif isinstance(value, list):
            waiting += [(f"{path}.{i}", depth + 1, entry) for i, entry in enumerate(value)]


def _check_text(path: str, text: str) -> None:
    if len(text) > _LONGEST:
        raise SceneError(path, f"has {len(text)} characters; a text has at most {_LONGEST}", text)
    if any(unicodedata.category(sign) == "Cc" and sign not in "\n\t" for sign in text):
        raise SceneError(path, "must be a text without control characters", text)


def _explained(text: str, error: tomllib.TOMLDecodeError) -> SceneError:
    """What is wrong in the line at which reading ended, with its key and what to write."""
    place = _LINE.search(str(error))
    lines = [line[:_LONGEST] for line in text.split("\n")[: int(place[1]) if place else 0]]
    given, value, title = _key(lines, len(lines) - 1)
    if given:
        for at in range(len(lines) - 1):
            if _key(lines, at)[::2] == (given, title) and _TWICE.search(str(error)):
                lines_ = f"lines {at + 1} and {len(lines)}"
                return SceneError(given, f"is given twice, in {lines_}; keep one of them")
        last = given.rpartition(".")[2]
        if comma := _COMMA.fullmatch(value):
            point = f"{comma[1]}.{comma[2]}"
            point = f'"{point} {comma[3]}"' if comma[3] else point
            return SceneError(given, f"has a decimal comma; write {last} = {point}", _Bare(value))
        if value and not set(value) & set("\"'[]{}=,") and not _NUMBER.fullmatch(value):
            return SceneError(given, f'lacks its quotes; write {last} = "{value}"', _Bare(value))
    return SceneError("", f"is not valid TOML: {error}")


def _key(lines: list[str], at: int) -> tuple[str, str, bool]:
    """Dotted path that a line gives, its value as it stands there, and whether it is a section."""
    if not 0 <= at < len(lines):
        return "", "", False
    if (head := _TITLE.fullmatch(lines[at])) and not lines[at].lstrip().startswith("[["):
        return head[1], "", True
    pair = _PAIR.fullmatch(lines[at])
    if pair is None:
        return "", "", False
    heads = (_TITLE.fullmatch(line) for line in reversed(lines[:at]))
    title = next((head[1] for head in heads if head), "")
    return f"{title}.{pair[1]}" if title else pair[1], pair[2], False


class _Bare(NamedTuple):
    """A value as it stands in the file, which messages show without quotes of their own."""

    text: str

    def __str__(self) -> str:
        return self.text
