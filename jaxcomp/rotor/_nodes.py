"""Nodes of a model, which exist by being mentioned."""

from itertools import chain
from typing import Any, Protocol, runtime_checkable

from .._core.errors import BadInput
from .._core.words import hint
from ._bodies import RigidBody
from ._shaft import Node


@runtime_checkable
class WithNodes(Protocol):
    """A rotor model, or one that is prepared."""

    @property
    def nodes(self) -> tuple[Node, ...] | None:
        """In order, if an order is given."""


def node_names(model: WithNodes) -> tuple[Node, ...]:
    """The nodes in the order of every array over nodes."""
    return model.nodes or mentioned(model)


def node_index(model: WithNodes, node: Node) -> int:
    """Place of a node in arrays over nodes.

    Args:
        model: a rotor model or a prepared system.
        node: its name.

    Raises:
        BadInput: there is no such node.
    """
    names = node_names(model)
    if node not in names:
        raise BadInput("node", str(node), f"one of {names}{hint(node, names)}")
    return names.index(node)


def check_nodes(model: WithNodes, nodes: Node | tuple[Node | None, ...] | None, field: str) -> None:
    """Refuse a node that the model does not have, under the name of the field that holds it.

    Raises:
        BadInput: there is no such node.
    """
    names = node_names(model)
    if not isinstance(nodes, tuple):
        nodes = (nodes,)
    for node in nodes:
        if node is not None and node not in names:
            raise BadInput(field, node, f"a node of the rotor, one of {names}{hint(node, names)}")


def nodes_of(part) -> list[Any]:
    """The nodes of one table, body or link, `None` for the ground."""
    nodes = [part.centre] if isinstance(part, RigidBody) else []
    for entry in part.nodes:
        # tables and links have pairs, or single nodes
        nodes += entry if isinstance(entry, tuple) else (entry,)
    return nodes


def mentioned(model: Any) -> tuple[Node, ...]:
    """The nodes of all tables, links and bodies of a model, in that order."""
    tables = (*model.shafts, *model.disks, *model.masses)
    parts = (*tables, *model.links, *model.magnetic_pulls, *model.bodies)
    nodes = chain.from_iterable(map(nodes_of, parts))
    return tuple(dict.fromkeys(node for node in nodes if node is not None))
