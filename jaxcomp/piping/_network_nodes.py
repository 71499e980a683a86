"""The rule for the nodes of all that stands between two or more of them."""

from itertools import pairwise

from .._core.errors import BadInput


def check_nodes(nodes: tuple[str, ...], *, pair: bool = False, may_return: bool = False) -> None:
    """Check the nodes of an element.

    Args:
        nodes: their names, in order.
        pair: whether there are two and no more.
        may_return: whether a chain may come back to a node that it has left.

    Raises:
        BadInput: too few names or too many, or a name twice, but for a chain that comes back later.
    """
    if pair:
        fits = len(nodes) == 2 and nodes[0] != nodes[1]
        bound = "two different names"
    elif may_return:
        fits = len(nodes) >= 2 and all(first != second for first, second in pairwise(nodes))
        bound = "two names or more, each other than the one before"
    else:
        fits = len(nodes) >= 2 and len(set(nodes)) == len(nodes)
        bound = "two different names or more"
    if not fits:
        raise BadInput("nodes", ", ".join(nodes), bound)
