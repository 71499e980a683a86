"""What is wrong with a scene file, in one line."""

from collections.abc import Iterable
from typing import Any


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
        self.key, self.problem, self.value, self.file = key, problem, value, file
        self.others = tuple(others)
        key = key if len(key) <= 200 else key[:197] + "..."
        entry = key if value is None else f"{key} = {_short(value)}"
        super().__init__(visible(": ".join(part for part in (file, entry, problem) if part)))

    def in_file(self, file: str) -> "SceneError":
        """The same complaints with the name of the file in front, unless they name one."""
        others = [other.in_file(file) for other in self.others]
        return SceneError(self.key, self.problem, self.value, self.file or file, others)


def visible(text: str) -> str:
    """A text with escape sequences spelt out, so that they do nothing to a terminal."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


def _short(value: Any) -> str:
    if isinstance(value, str):
        text = f'"{value[:100]}"'
    elif isinstance(value, int) and abs(value) > 10**60:  # Python writes no more than some digits
        text = f"a whole number of {value.bit_length()} bits"
    else:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."
