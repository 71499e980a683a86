"""Paths of numbers in the words of people: `rotor.links.4.law.stiffness.0` and what it belongs to."""

from typing import Any

from ..machine import Machine

# Steps that tell nothing beside what stands around them.
_SILENT = ("rotor", "law", "loads", "balancing", "mechanism", "friction", "motor", "gas")
# What a user gave a name to follows these.
_NAMED = ("corrections", "bearings", "oils")
_SAID = {
    "links": "link", "disks": "disk", "bodies": "body", "shafts": "shaft", "coefficient": "friction",
    "side_pulls": "magnetic pull", "unbalances": "unbalances", "corrections": "correction",
    "bearings": "bearing", "oils": "oil", "targets": "target", "planes": "plane",
}  # fmt: skip
_DIRECTIONS = ("x", "y", "z", "about x", "about y", "about z")


def spoken(design: Machine, path: str) -> str:
    """What a variable is, in words: `conrod length`, `stiffness x of link springs to seats`.

    Args:
        design: whose number it is.
        path: name of a variable, see `Variable`.
    """
    steps, words, place = path.split("."), [], _section(design, path)
    if path.startswith("loads.unbalances.") and steps[-1].isdigit():
        nodes = getattr(_parent(design, steps, len(steps) - 1), "nodes", ())
        what = "unbalance" if steps[-2] == "magnitude" else f"{steps[-2]} of the unbalance"
        return f"{what} at node {_node(nodes[int(steps[-1])])}"
    for number, step in enumerate(steps):
        last = number == len(steps) - 1
        here = _inside(place, step)
        if step.isdigit():
            word = _called(here, step)
            if last and words:
                nodes = getattr(_parent(design, steps, number), "nodes", ())
                many = isinstance(nodes, tuple) and len(nodes) > int(step)
                inside = "law" in steps[:number]
                index = int(step)
                if inside and index < len(_DIRECTIONS):
                    word = _DIRECTIONS[index]
                else:
                    word = f"at node {_node(nodes[index])}" if many else f"{index + 1}"
            words.append(word)
        elif step not in _SILENT or len(steps) == 1 or (number and steps[number - 1] in _NAMED):
            words.append(_SAID.get(step, step.replace("_", " ")))
        place = here
    if len(words) < 2:
        return " ".join(words)
    split = max((i for i, step in enumerate(steps) if not step.isdigit()), default=0)
    tail = len(steps) - split
    head, what = words[: len(words) - tail], words[len(words) - tail :]
    return f"{' '.join(what)} of {' '.join(head)}" if head else " ".join(what)


def _section(design: Machine, path: str) -> Any:
    first = path.partition(".")[0]
    if first in design.parts or first in ("bearings", "oils", "corrections"):
        return {**design.parts, "bearings": design.bearings, "oils": design.oils,
                "corrections": design.corrections}  # fmt: skip
    return design.compressor


def _inside(place: Any, step: str) -> Any:
    if isinstance(place, dict):
        return place.get(step)
    if step.isdigit() and isinstance(place, tuple):
        return place[int(step)] if int(step) < len(place) else None
    return getattr(place, step, None)


def _parent(design: Machine, steps: list[str], number: int) -> Any:
    place = _section(design, ".".join(steps))
    for step in steps[: number - 1]:
        place = _inside(place, step)
    return place


def _called(part: Any, step: str) -> str:
    """A part of a list by its name or its nodes, or by its number from 1."""
    name, nodes = getattr(part, "name", None), getattr(part, "nodes", None)
    if isinstance(name, str):
        return name
    if isinstance(nodes, tuple) and len(nodes) == 2 and not isinstance(nodes[0], tuple):
        return f"{_node(nodes[0])} to {_node(nodes[1])}"
    return str(int(step) + 1)


def _node(node: Any) -> str:
    if node is None:
        return "ground"
    return " to ".join(map(_node, node)) if isinstance(node, tuple) else str(node)
