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

    def place(count: int) -> Any:
        with suppress(LookupError):
            return walk(design, steps[:count])

    nodes = getattr(place(max(len(steps) - 2, 0)), "nodes", ())
    if path.startswith("loads.unbalances.") and steps[-1].isdigit():
        quantity = "unbalance" if steps[-2] == "magnitude" else f"{steps[-2]} of the unbalance"
        return f"{quantity} at node {_node(nodes[int(steps[-1])])}"
    # the number is an entry of the last step with a name; what stands before is the part
    name = max((i for i, step in enumerate(steps) if not step.isdigit()), default=0)
    part = []
    for number, step in enumerate(steps[:name]):
        if steps[: number + 2] == ["crankshaft", "main_journal"]:
            continue  # the journal says enough
        if step.isdigit():
            part.append(_part(place(number + 1), step))
        elif step not in _LEFT_OUT or (number and steps[number - 1] in SECTIONS):
            part.append(_word(step))
    entry = [_word(steps[name]), *(str(int(step) + 1) for step in steps[name + 1 :])]
    if len(entry) > 1:
        index = int(steps[-1])
        if "law" in steps and index < len(_DIRECTIONS):
            entry[-1] = _DIRECTIONS[index]
        elif isinstance(nodes, tuple) and index < len(nodes):
            entry[-1] = f"at node {_node(nodes[index])}"
    return " of ".join(" ".join(words) for words in (entry, part) if words)


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
