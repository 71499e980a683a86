"""Names of variables in words for people."""

from contextlib import suppress
from typing import Any

from ..machine import Machine
from ._variables import SECTIONS, walk

# Steps of a path that are left out beside what stands around them.
_LEFT_OUT = ("rotor", "law", "loads", "balancing", "mechanism", "friction", "motor", "gas")
_WORDS = {
    "links": "link", "disks": "disk", "bodies": "body", "shafts": "shaft", "coefficient": "friction",
    "magnetic_pulls": "magnetic pull", "unbalances": "unbalances", "corrections": "correction",
    "bearings": "bearing", "oils": "oil", "targets": "target", "planes": "plane",
}  # fmt: skip
_DIRECTIONS = ("x", "y", "z", "about x", "about y", "about z")


def variable_label(design: Machine, path: str) -> str:
    """Name of a variable in words: `conrod length`, `stiffness x of link springs to seats`.

    Args:
        design: whose number it is.
        path: name of a variable, see `Variable`.
    """
    steps = path.split(".")
    holder = _object_at(design, steps[: max(len(steps) - 2, 0)])
    nodes = getattr(holder, "nodes", ())
    if path.startswith("loads.unbalances.") and steps[-1].isdigit():
        quantity = "unbalance"
        if steps[-2] != "magnitude":
            quantity = f"{steps[-2]} of the unbalance"
        return f"{quantity} at node {_node(nodes[int(steps[-1])])}"
    # the number is an entry of the last step with a name; what stands before is the part
    name_at = 0
    for number, step in enumerate(steps):
        if not step.isdigit():
            name_at = number
    label = " ".join(_entry_words(steps, name_at, nodes))
    part = _part_words(design, steps, name_at)
    if part:
        label += f" of {' '.join(part)}"
    return label


def _object_at(design: Machine, steps: list[str]) -> Any:
    """The object at the end of a path; `None` where the path leads nowhere."""
    with suppress(LookupError):
        return walk(design, steps)
    return None


def _part_words(design: Machine, steps: list[str], name_at: int) -> list[str]:
    """Words of the part that has a number, from the steps before that of its name."""
    words = []
    for number, step in enumerate(steps[:name_at]):
        if steps[: number + 2] == ["crankshaft", "main_journal"]:
            continue  # the journal says enough
        if step.isdigit():
            part = _object_at(design, steps[: number + 1])
            words.append(_part(part, step))
        elif step not in _LEFT_OUT or (number and steps[number - 1] in SECTIONS):
            words.append(_word(step))
    return words


def _entry_words(steps: list[str], name_at: int, nodes: Any) -> list[str]:
    """Words of a number from its name on, of an entry of a list with the place in it."""
    words = [_word(steps[name_at])]
    for step in steps[name_at + 1 :]:
        words.append(str(int(step) + 1))
    if len(words) > 1:
        index = int(steps[-1])
        if "law" in steps and index < len(_DIRECTIONS):
            words[-1] = _DIRECTIONS[index]
        elif isinstance(nodes, tuple) and index < len(nodes):
            words[-1] = f"at node {_node(nodes[index])}"
    return words


def _word(step: str) -> str:
    return _WORDS.get(step, step.replace("_", " "))


def _part(part: Any, step: str) -> str:
    """A part of a list by its name or its nodes, or by its number from 1."""
    name = getattr(part, "name", None)
    nodes = getattr(part, "nodes", None)
    if isinstance(name, str):
        return name
    if isinstance(nodes, tuple) and len(nodes) == 2 and not isinstance(nodes[0], tuple):
        return f"{_node(nodes[0])} to {_node(nodes[1])}"
    return str(int(step) + 1)


def _node(node: Any) -> str:
    if node is None:
        return "ground"
    if isinstance(node, tuple):
        return " to ".join(map(_node, node))
    return str(node)
