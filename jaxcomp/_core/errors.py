"""Complaints about what was given: field, value, and what is allowed. Imports no JAX."""

import os
from typing import Any

_LONGEST = 300  # characters of a value in a message
_MOST_ENTRIES = 12  # of an array that a message prints as a whole


class BadInput(ValueError):
    """A value that the machine cannot have.

    Attributes:
        field: dotted name of the field.
        value: the value that was given.
        bound: what was expected, as text.
    """

    def __init__(self, field: str, value: Any, bound: str):
        self.field = field
        self.value = value
        self.bound = bound
        shown = value_text(value)
        # "must be given, but is absent" would say it twice
        obvious = shown == "absent" and bound.startswith("given")
        but = ""
        if shown and not obvious:
            but = f", but is {shown}"
        super().__init__(f"`{field}` must be {bound}{but}.")

    def inside(self, where: str) -> "BadInput":
        """This complaint with the name of the part that holds the field in front."""
        return BadInput(f"{where}.{self.field}", self.value, self.bound)


class MissingPart(BadInput):
    """A quantity that needs a part which the machine does not have."""

    def __init__(self, quantity: str, part: str):
        super().__init__(quantity, "absent", part)
        # Another message than that of `BadInput`, whose attributes stay for those who read them.
        self.args = (f"Quantity '{quantity}' needs {part}; this machine has none.",)


class QuantityFailed(BadInput):
    """A quantity of another package whose function fails, or gives no number."""

    def __init__(self, quantity: str, place: str, problem: str):
        super().__init__(quantity, "absent", problem)
        self.args = (f"Quantity '{quantity}' of {place} fails: {problem.rstrip('.')}.",)


def no_machine(value: Any, part: str = "") -> BadInput:
    """The complaint about an argument that should be a machine, or that `part` of a scene."""
    file = "my.toml"
    problem = f"a {type(value).__name__}"
    if isinstance(value, str | os.PathLike):
        file = os.fspath(value)
        problem = f'"{file}"'
    return BadInput("machine", problem, f'a machine, such as `jaxcomp.load("{file}"){part}`')


def kind_text(part: Any) -> str:
    """Kind of a part of a machine, as the `type` of its section says; the class of anything else."""
    return str(getattr(part, "kind", "") or type(part).__name__)


def value_text(value: Any) -> str:
    """A value as messages name it."""
    if value is None:
        return "absent"
    if isinstance(value, str):
        words = value or "empty"
        if len(words) > _LONGEST:
            return f"{words[: _LONGEST - 3]}..."
        return words
    import numpy as np  # not before it is needed: the command line complains without it

    value = np.asarray(value)
    if value.ndim == 0:
        return f"{value.item():.6g}"
    text = np.array2string(value, precision=6, threshold=_MOST_ENTRIES, edgeitems=3)
    if value.size > _MOST_ENTRIES:
        text += f", {value.size} values"
    return text
