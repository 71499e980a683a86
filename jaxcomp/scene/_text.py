"""The text of machine files: TOML into tables and back, and what is wrong with it, in one line."""

import json
import re
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import resources
from typing import Any, NamedTuple

# How a number is written in a text.
NUMBER = r"[+-]?(?:\d+(?:_\d+)*(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"

# [bytes] A file of a machine has some kilobytes, one with measured diagrams some hundred.
LARGEST = 4_000_000
_DEEPEST = 20
_LONGEST = 1000  # characters of a text
_MOST_ENTRIES = 8  # of a list that a message prints as a whole
_LONGEST_PROBLEM = 1500  # characters of a complaint, which never prints a whole table

_LINE = re.compile(r"line (\d+)")
_TITLE = re.compile(r"\s*\[+\s*([^\[\]]+?)\s*\]+\s*(?:#.*)?")
_PAIR = re.compile(r"\s*([\w.\"'-]+)\s*=\s*(.*?)\s*(?:#.*)?")
_TWICE = re.compile(r"overwrite|twice")
_COMMA = re.compile(r"([+-]?\d+),(\d+)(?:\s*([^\s\d,].*))?")
_NUMBER = re.compile(NUMBER)
_LONGEST_KEPT = 300_000  # characters, for which tomlkit needs seconds
_BARE = re.compile(r"[A-Za-z0-9_-]+")


class SceneError(ValueError):
    """A scene that cannot be read, or that describes no machine.

    Attributes:
        file: name of the file, empty if there is none.
        key: dotted path of the entry, empty if the file as a whole is meant.
        value: the value as it was given, `None` if there is none.
        problem: what is wrong with it, and the bound where there is one.
        others: what else is wrong with the same scene, in the order of reading.
    """

    def __init__(
        self,
        key: str,
        problem: str,
        value: Any = None,
        file: str = "",
        others: Iterable["SceneError"] = (),
    ):
        self.key = key
        self.problem = problem
        self.value = value
        self.file = file
        self.others = tuple(others)
        key = cut(key, 200)
        problem = cut(problem, _LONGEST_PROBLEM)
        entry = key
        if value is not None:
            entry = f"{key} = {short_value(value)}"
        super().__init__(visible(": ".join(filter(None, (file, entry, problem)))))

    def in_file(self, file: str) -> "SceneError":
        """These complaints with the name of the file in front, unless they name one."""
        further = [other.in_file(file) for other in self.others]
        return SceneError(self.key, self.problem, self.value, self.file or file, further)


@contextmanager
def reading(file: str) -> Iterator[None]:
    """Let every complaint name a file, and complain of a file that cannot be read."""
    try:
        yield
    except SceneError as error:
        raise error.in_file(file) from None
    except IsADirectoryError:
        raise SceneError("", "is a folder; name a file in it", file=file) from None
    except OSError as error:
        raise SceneError("", f"cannot be read: {error.strerror}", file=file) from None
    except UnicodeDecodeError:
        raise SceneError("", "is no text in UTF-8", file=file) from None


def cut(text: str, length: int) -> str:
    """A text of at most so many characters, with dots for what is left out."""
    if len(text) <= length:
        return text
    return f"{text[: length - 3]}..."


def visible(text: str) -> str:
    """A text with escape sequences spelt out, so that they do nothing to a terminal."""
    signs = []
    for sign in text:
        if sign.isprintable():
            signs.append(sign)
        else:
            signs.append(repr(sign)[1:-1])
    return "".join(signs)


def short_value(value: Any) -> str:
    """A value as messages print it: in one line of at most 60 characters."""
    if isinstance(value, str):
        text = f'"{value[:100]}"'
    elif isinstance(value, int) and abs(value) > 10**60:  # Python writes no more than some digits
        text = f"a whole number of {value.bit_length()} bits"
    elif isinstance(value, list) and len(value) > _MOST_ENTRIES:
        ends = [cut(str(entry), 12) for entry in (*value[:3], value[-1])]
        text = f"[{', '.join(ends[:3])}, ..., {ends[3]}], {len(value)} values"
    else:
        text = str(value)
    return cut(" ".join(text.split()), 60)


def toml_tables(data: bytes | str, file: str = "") -> dict[str, Any]:
    """Read TOML.

    Args:
        data: the content of a file in UTF-8, with or without a byte order mark, or a text.
        file: its name in messages.

    Raises:
        SceneError: no text in UTF-8, no TOML, or a file that is too large, nested too deep, or holds
            an overlong text or one with control characters.
    """
    with reading(file):
        if len(data) > LARGEST:
            raise SceneError("", f"is larger than {LARGEST / 1e6:.0f} MB")
        if not isinstance(data, str):
            data = data.decode("utf-8")
        text = data.removeprefix("\ufeff")
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise _explained(text, error) from None
        except ValueError:  # Python reads no whole number of more than some thousand digits
            raise SceneError("", "is not valid TOML: a number has too many digits") from None
        except RecursionError:
            raise SceneError("", f"is nested more than {_DEEPEST} deep") from None
        check_tables(tables)
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
                inner_path = f"{path}.{key}" if path else key
                waiting.append((inner_path, depth + 1, entry))
        elif isinstance(value, list):
            for i, entry in enumerate(value):
                waiting.append((f"{path}.{i}", depth + 1, entry))


def _check_text(path: str, text: str) -> None:
    if len(text) > _LONGEST:
        raise SceneError(path, f"has {len(text)} characters; a text has at most {_LONGEST}", text)
    if any(unicodedata.category(sign) == "Cc" and sign not in "\n\t" for sign in text):
        raise SceneError(path, "must be a text without control characters", text)


def _explained(text: str, error: tomllib.TOMLDecodeError) -> SceneError:
    """Explanation of a fault in the line at which reading ended, with its key and what to write."""
    place = _LINE.search(str(error))
    count = 0
    if place:
        count = int(place[1])
    lines = [line[:_LONGEST] for line in text.split("\n")[:count]]
    path, value, title = _key(lines, len(lines) - 1)
    if path:
        for at in range(len(lines) - 1):
            if _key(lines, at)[::2] == (path, title) and _TWICE.search(str(error)):
                lines_ = f"lines {at + 1} and {len(lines)}"
                return SceneError(path, f"is given twice, in {lines_}; keep one of them")
        key = path.rpartition(".")[2]
        if comma := _COMMA.fullmatch(value):
            point = f"{comma[1]}.{comma[2]}"
            if comma[3]:  # with a unit it is a text
                point = f'"{point} {comma[3]}"'
            return SceneError(path, f"has a decimal comma; write {key} = {point}", _Unquoted(value))
        if value and not set(value) & set("\"'[]{}=,") and not _NUMBER.fullmatch(value):
            return SceneError(path, f'lacks its quotes; write {key} = "{value}"', _Unquoted(value))
        if value.count('"') % 2:
            unquoted = value.strip('"')
            return SceneError(path, f'lacks a quote; write {key} = "{unquoted}"', _Unquoted(value))
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
    path = pair[1]
    for line in reversed(lines[:at]):
        if title := _TITLE.fullmatch(line):
            path = f"{title[1]}.{path}"
            break
    return path, pair[2], False


class _Unquoted(NamedTuple):
    """A value as it stands in the file, which messages show without quotes of their own."""

    text: str

    def __str__(self) -> str:
        return self.text


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

    with suppress(TOMLKitError, tomllib.TOMLDecodeError):
        layout = tomlkit.parse(text)
        _update(layout, document)
        out = tomlkit.dumps(layout)
        if tomllib.loads(out) == document:
            return out
    return toml_text(document)


def bundled(*folders: str) -> dict[str, Any]:
    """The TOML files in a folder of the package, by name."""
    files = {}
    for file in resources.files("jaxcomp").joinpath(*folders).iterdir():
        if file.name.endswith(".toml"):
            files[file.name[:-5]] = file
    return dict(sorted(files.items()))


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


def _update(tables: Any, document: Mapping[str, Any]) -> None:
    """Make tables of tomlkit hold what a document holds, and touch nothing that agrees."""
    for key in list(tables):
        if key not in document:
            del tables[key]
    olds = tables.unwrap()
    for key, value in document.items():
        old = olds.get(key)
        if old == value and type(old) is type(value):
            continue
        if is_section(value) and is_section(old):
            _update(tables[key], value)
        elif is_row_of_sections(value) and is_row_of_sections(old) and len(old) == len(value):
            for row, row_document in zip(tables[key], value, strict=True):
                _update(row, row_document)
        else:
            tables[key] = _item(key, value)


def _item(key: str, value: Any) -> Any:
    import tomlkit

    return tomlkit.parse(toml_text({key: value}))[key]


def key_text(key: str) -> str:
    """A key, in quotes where it needs them."""
    if _BARE.fullmatch(key):
        return key
    return _string(key)


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
        pairs = []
        for key, entry in value.items():
            pairs.append(f"{key_text(key)} = {value_text(entry)}")
        return "{ " + ", ".join(pairs) + " }"
    return str(value)  # dates and times


def _string(text: str) -> str:
    # JSON's escapes are those of TOML, but for one control character
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
