r"""Where the nodes of a model are, and which of them move as one piece."""

import numpy as np

from ._model import RotorModel, node_names
from ._shaft import Node


def node_positions(model: RotorModel) -> dict[Node, np.ndarray]:
    """[m] (x, y, z) of every node, the first node of the first shaft (or body) at the origin.

    Elements lead along z and arms from the centres of bodies; the two nodes of a link are in one
    place. What nothing joins begins at the origin again. The numbers have to be concrete.
    """
    steps: dict[Node, list[tuple[Node, np.ndarray]]] = {node: [] for node in node_names(model)}

    def join(a, b, step):
        steps[a].append((b, step))
        steps[b].append((a, -step))

    for shaft in model.shafts:
        for (a, b), length in zip(shaft.pairs, np.asarray(shaft.length), strict=True):
            join(a, b, np.array([0.0, 0.0, length]))
    for body in model.bodies:
        for node, arm in zip(body.nodes, np.asarray(body.arm), strict=True):
            join(body.centre, node, arm)
    for pair in _linked(model):
        join(*pair, np.zeros(3))
    places: dict[Node, np.ndarray] = {}
    for start in steps:
        if start in places:
            continue
        places[start], waiting = np.zeros(3), [start]
        while waiting:
            here = waiting.pop(0)
            for there, step in steps[here]:
                if there not in places:
                    places[there] = places[here] + step
                    waiting.append(there)
    return places


def subsets(model: RotorModel) -> tuple[tuple[Node, ...], ...]:
    """Nodes that shafts or bodies hold together, such as rotor, crankcase and housing."""
    group = {node: {node} for node in node_names(model)}
    ties = [pair for shaft in model.shafts for pair in shaft.pairs]
    ties += [(body.centre, node) for body in model.bodies for node in body.nodes]
    for a, b in ties:
        if group[a] is not group[b]:
            group[a] |= group[b]
            for node in group[b]:
                group[node] = group[a]
    seen: dict[int, tuple[Node, ...]] = {}
    for node in node_names(model):
        members = group[node]
        seen.setdefault(id(members), tuple(n for n in node_names(model) if n in members))
    return tuple(seen.values())


def subset_names(model: RotorModel) -> tuple[str, ...]:
    """Words for the subsets: the centre of a body, "rotor" for what spins, else the first node."""
    spinning = {n for shaft in model.shafts if shaft.spins for pair in shaft.pairs for n in pair}
    centres = [body.centre for body in model.bodies]
    names = []
    for group in subsets(model):
        own = [str(c) for c in centres if c in group]
        name = own[0] if own else ("rotor" if spinning & set(group) else f"line of {group[0]}")
        names.append(name if name not in names else f"{name} of {group[0]}")
    return tuple(names)


def _linked(model):
    pairs = [link.nodes for link in model.links]
    pairs += [pair for pull in model.magnetic_pulls for pair in pull.nodes]
    return [pair for pair in pairs if pair[1] is not None]
