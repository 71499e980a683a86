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
    if may_return:
        differs = all(first != second for first, second in pairwise(nodes))
    else:
        differs = len(set(nodes)) == len(nodes)
    if pair:
        bound = "two different names"
        fits = len(nodes) == 2
    else:
        bound = "two names or more, each other than the one before"
        if not may_return:
            bound = "two different names or more"
        fits = len(nodes) >= 2
    if not (fits and differs):
        raise BadInput("nodes", ", ".join(nodes), bound)
