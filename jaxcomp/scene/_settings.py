"""Settings of files of measurements: `# key = value`, one reader for all kinds.

Case, blanks, hyphens and underscores of a key do not count. A key that the kind does not know is refused
with the nearest one, and so is a value without its number.
"""

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from .._core.errors import BadInput
from .._core.words import did_you_mean, nearest
from ._table_text import SettingLine
from ._text import NUMBER, SceneError
from ._units import to_si

if TYPE_CHECKING:  # a machine file with a table beside it imports no studies
    from ..machine import Machine

# What any file may say of itself; nothing follows from it.
WORDS = (
    "machine", "fluid", "source", "form", "licence", "license", "supply", "date", "time", "place",
    "operator", "instrument", "title", "remark", "note", "comment",
)  # fmt: skip
# In front of how far the points of a written file are from its polynomials.
ERROR_OF = "largest error of "
_LONGEST = 200  # characters of a value, behind which a remark may stand
_AFTER_VALUE = re.compile(r"\s+\(|;|,\s")
_WITHOUT_SIGN = re.compile(r"([A-Za-z][A-Za-z_ -]*?)\s+([-+]?\d.*)")
_MEASURE = re.compile(rf"({NUMBER})\s*(.*)")
_RANGE = re.compile(rf"({NUMBER})\s*(\S*?)\s*\bto\b\s*({NUMBER})\s*(\S*)")


class Span(NamedTuple):
    """Two ends of a range with their unit, empty where none is given."""

    low: float
    high: float
    unit: str


def bare_name(name: str) -> str:
    """A name without case, blanks, hyphens and underscores, which do not count."""
    return re.sub(r"[\s_-]+", "", name).lower()


def known_name(name: str, names: Iterable[str]) -> str | None:
    """The one of some names that is meant, `None` if none is."""
    bare = bare_name(name)
    for word in names:
        if bare_name(word) == bare:
            return word
    return None


def settings_of(
    lines: Iterable[SettingLine], names: Iterable[str] = (), machine: "Machine | None" = None
) -> dict[str, str]:
    """Texts of the settings of a file by their names.

    Args:
        lines: as `read_table_text` gives them.
        names: names that this kind of file knows beside `WORDS`.
        machine: whose numbers may be set as well, by their dotted paths.

    Raises:
        SceneError: an unknown setting, one without a value, or one that is given twice.
    """
    names = (*WORDS, *names)
    settings: dict[str, str] = {}
    numbers: dict[str, int] = {}
    for line in lines:
        name = known_name(line.key, names)
        if line.sign == "":
            _refuse_missing_sign(line, names)
        if line.sign != "=" and (name is None or line.sign == ""):
            continue  # a remark
        if name is None and bare_name(line.key).startswith(bare_name(ERROR_OF)):
            continue
        if name is None:
            name = _path_of(line.key[:_LONGEST], names, machine)
        if name not in WORDS and len(line.value) > _LONGEST:
            raise SceneError(f"line {line.number}.{name}", "is too long for a number with its unit")
        if name in settings:
            lines_ = f"lines {numbers[name]} and {line.number}"
            raise SceneError(name, f"is given twice, in {lines_}; keep one of them")
        if not line.value and name not in WORDS:
            problem = 'lacks its value; write it behind the "=", or leave the line out'
            raise SceneError(f"line {line.number}.{name}", problem)
        settings[name] = line.value
        numbers[name] = line.number
    return settings


def _refuse_missing_sign(line: SettingLine, names: Iterable[str]) -> None:
    """Refuse a remark that is a setting without its sign, as "speed 900 rpm".

    Raises:
        SceneError: it is.
    """
    match = _WITHOUT_SIGN.fullmatch(line.key[:_LONGEST])
    if match is None:
        return
    name = known_name(match[1], names)
    if name is not None and name not in WORDS:
        problem = f'lacks its "="; write "# {name} = {match[2]}"'
        raise SceneError(f"line {line.number}.{name}", problem)


def _path_of(key: str, names: Iterable[str], machine: "Machine | None") -> str:
    """Dotted path of the number of a machine that a key names."""
    problem = f"is an unknown setting{_nearest_setting(key, names)}"
    problem += '; a remark has no "="'
    if machine is None:
        raise SceneError(key, problem)
    from ..study import variable
    from ..study._variables import variable_names

    name = known_name(key, variable_names(machine)) or key
    try:
        variable(machine, name)
    except BadInput as error:
        # the error has the nearest path, unless the key is a misspelt word
        if nearest(key, names) is not None:
            raise SceneError(key, problem) from None
        ends = [path for path in variable_names(machine) if _ends_with(path, key)]
        meant = f' did you mean "{ends[0]}"?' if ends else ""
        problem = f'is an unknown setting: {error}{meant} A remark has no "="'
        raise SceneError(key, problem) from None
    return name


def _ends_with(path: str, key: str) -> bool:
    """Whether the last word of a dotted path ends with a key."""
    return bool(bare_name(key)) and bare_name(path).rpartition(".")[2].endswith(bare_name(key))


def _nearest_setting(key: str, names: Iterable[str]) -> str:
    """The nearest known setting, also to the last word of a dotted path; else what is known."""
    names = list(names)
    plain = key.strip().lower().replace(" ", "_")
    last_word = plain.rpartition(".")[2]
    word = plain if nearest(plain, names) else last_word
    return did_you_mean(word, names)


def machine_settings(settings: Mapping[str, str], machine: "Machine", of_kind: Iterable[str] = ()):
    """[SI] Numbers of a machine that settings give, by their paths.

    Args:
        settings: as `settings_of` gives them.
        machine: whose numbers are meant.
        of_kind: settings of the kind, which are no numbers of the machine.
    """
    from ..study import variable

    values: dict[str, float] = {}
    for name, text in settings.items():
        if name not in WORDS and name not in of_kind:
            values[name] = float(to_si(_without_remark(text), variable(machine, name).unit, name))
    return values


def count_setting(settings: Mapping[str, str], name: str, default: int) -> int:
    """A whole number from 1, `default` where it is not given.

    Raises:
        SceneError: no such number.
    """
    if name not in settings:
        return default
    text = _without_remark(settings[name])
    if not re.fullmatch(r"[0-9]{1,6}", text) or int(text) < 1:
        raise SceneError(name, "must be a whole number from 1", settings[name])
    return int(text)


def measure_setting(settings: Mapping[str, str], name: str, example: str) -> tuple[float, str]:
    """Number and unit of a setting.

    Args:
        settings: as `settings_of` gives them.
        name: of the setting.
        example: a right value, for the message.

    Raises:
        SceneError: no number, or one without its unit.
    """
    text = _without_remark(settings[name])
    match = _MEASURE.fullmatch(text)
    advice = f'as in "{name} = {example}"'
    if match is None or match[2].startswith("."):
        raise SceneError(name, f"must be a number with its unit, {advice}", settings[name])
    if re.match(r",\d", match[2]):
        raise SceneError(name, f"has a decimal comma; write a point, {advice}", settings[name])
    if not match[2]:
        raise SceneError(name, f"needs its unit, {advice}", settings[name])
    return float(match[1]), match[2]


def word_setting(settings: Mapping[str, str], name: str) -> str:
    """Word of a setting without a remark behind it, "" where it is not given."""
    return _without_remark(settings.get(name, ""))


def span_setting(settings: Mapping[str, str], name: str) -> Span | None:
    """A range such as "-15 to 10 degC"; `None` for anything else."""
    match = _RANGE.fullmatch(_without_remark(settings.get(name, "")))
    if match is None:
        return None
    return Span(float(match[1]), float(match[3]), match[4] or match[2])


def _without_remark(text: str) -> str:
    """A value without what follows it in brackets, behind a semicolon or a comma with a blank."""
    return _AFTER_VALUE.split(text, maxsplit=1)[0].strip()


def same_fluid(name: str, other_name: str) -> bool:
    """Whether two names are of one fluid: R22 and R-22 are."""
    return bare_name(name) == bare_name(other_name)


def fluid_of(machine: "Machine") -> str:
    """Name of the fluid that a machine compresses, "" of one that has none."""
    compressor: Any = machine.compressor
    gas = getattr(compressor, "gas", None)
    return str(getattr(getattr(gas, "fluid", None), "name", ""))


def check_fluid(settings: Mapping[str, str], machine: "Machine") -> None:
    """Refuse readings of another fluid than the machine's.

    Raises:
        SceneError: they are.
    """
    of_machine = fluid_of(machine)
    of_file = word_setting(settings, "fluid")
    if of_machine and of_file and not same_fluid(of_file, of_machine):
        problem = f"must be {of_machine} as the machine's; set gas.fluid.name to take another"
        raise SceneError("fluid", problem, of_file)
