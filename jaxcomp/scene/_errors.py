"""What is wrong with a scene file, in one line."""

import difflib
from collections.abc import Iterable
from typing import Any


class SceneError(ValueError):
    """A scene that cannot be read, or that describes no machine.

    Attributes:
        file: name of the file, empty if there is none.
        key: dotted path of the entry, empty if the file as a whole is meant.
        value: the value as it was given, `None` if there is none.
        problem: what is wrong with it, and the bound where there is one.
    """

    def __init__(self, key: str, problem: str, value: Any = None, file: str = ""):
        self.key, self.problem, self.value, self.file = key, problem, value, file
        entry = key if value is None else f"{key} = {_short(value)}"
        super().__init__(": ".join(part for part in (file, entry, problem) if part))

    def in_file(self, file: str) -> "SceneError":
        """The same complaint with the name of the file in front."""
        return SceneError(self.key, self.problem, self.value, file)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean "..."?` if something similar is known, and what is known otherwise."""
    known = sorted(known)
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if near:
        return f'; did you mean "{near[0]}"?'
    return f"; known here: {', '.join(known)}" if known else ""


def _short(value: Any) -> str:
    text = f'"{value}"' if isinstance(value, str) else str(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."
