r"""What follows what: nodes of rigid bodies, and coordinates that pinned and clamped links hold.

Nodes of rigid bodies follow their centres, x_k = A_k x_c. A pinned or clamped link adds one condition a
coordinate, x_a = x_b or x_a = 0, which is solved for a coordinate that occurs in it with the factor one
or minus one; that coordinate is put into all other relations and is gone. Everything is in the order of
the planes of `_conventions`, where the numbers of a node are its coordinates.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from ._bodies import RigidBody, arm_matrices


class Hold(NamedTuple):
    """One condition of a held link, and the coordinate that it removes.

    Attributes:
        link: number of the link.
        first: number of its first node.
        second: that of its second node; the number of nodes for the ground.
        coordinate: which of a node is held.
        node: the node that loses a coordinate.
        sign: of its motion in the condition.
    """

    link: int
    first: int
    second: int
    coordinate: int
    node: int = -1
    sign: float = 0.0


class Ties(NamedTuple):
    """Relations between coordinates as far as they are known before any number.

    Attributes:
        nodes: (2, t) nodes that follow, and those that they follow; one pair an entry.
        free: (n, dof) coordinates that follow nothing.
        holds: conditions of held links.
    """

    nodes: np.ndarray
    free: np.ndarray
    holds: tuple[Hold, ...]


def body_arms(bodies: tuple[RigidBody, ...], dof: int) -> Float[Array, "slaved dof dof"]:
    """Motion of the nodes of all bodies from that of their centres."""
    arms = [arm_matrices(body.arm, dof) for body in bodies]
    return jnp.concatenate([jnp.zeros((0, dof, dof)), *arms])


def find_ties(n: int, dof: int, slaved: tuple, holds: tuple[Hold, ...]) -> Ties:
    """The relations of a model of n nodes, from conditions that do not say yet what they remove.

    Raises:
        BadInput: a condition that the others imply, or that would have to be solved for a rotation.
    """
    # Arms of no particular place, so that what is zero or one is so for all of them.
    places = np.random.default_rng(3).uniform(1.0, 2.0, (len(slaved), 3))
    arms = arm_matrices(places, dof)
    relations, holds, free = _relations(n, dof, slaved, arms, holds)
    pairs = []
    for node, row in relations.items():
        # Rows that move by themselves stay out: `follow` takes them from the motion as it is.
        following = ~free[node][:, None]
        for master, matrix in row.items():
            if (matrix * following).any():
                pairs.append((node, master))
    return Ties(np.array(pairs, int).reshape(-1, 2).T, free, holds)


def tie_matrices(
    ties: Ties, slaved: tuple, arms: Float[Array, "slaved dof dof"]
) -> Float[Array, "t dof dof"]:
    """Motion of following nodes for the entries of `Ties.nodes`, from the arms of the bodies."""
    if not ties.holds:
        return arms
    n, dof = ties.free.shape
    relations, _, free = _relations(n, dof, slaved, arms, ties.holds)
    rows = []
    for a, b in ties.nodes.T:
        rows.append(relations[a][b] * ~free[a][:, None])
    # The zeros go again; with them the stack has a shape also where nothing follows.
    return jnp.stack([jnp.zeros((dof, dof)), *rows])[1:]


def reaction_matrix(
    ties: Ties, slaved: tuple, arms: Float[Array, "slaved dof dof"]
) -> Float[Array, "h h"]:
    """Force of each condition on the second node, from the forces left on the lost coordinates.

    The forces are those on free nodes and centres of bodies.
    """
    of = {}
    for (node, centre), arm in zip(slaved, arms, strict=True):
        of[node] = (centre, arm)
    eye = np.eye(ties.free.shape[1])
    table = []
    for hold in ties.holds:
        row = []
        for other in ties.holds:
            entry = 0.0
            for node, sign in ((hold.first, 1.0), (hold.second, -1.0)):
                centre, arm = of.get(node, (node, eye))
                if centre == other.node:
                    entry += sign * arm[hold.coordinate, other.coordinate]
            row.append(jnp.asarray(entry))
        table.append(jnp.stack(row))
    # By virtual work the forces on the lost coordinates are the table's transpose times those of
    # the conditions.
    return jnp.linalg.inv(jnp.stack(table)).T


def _relations(n, dof, slaved, arms, holds):
    """Relations {node: {node: matrix}} of all that does not move by itself, complete holds, `free`."""
    eye = np.eye(dof)
    relations = _body_relations(slaved, arms)
    free = np.ones((n, dof), bool)
    free[list(relations)] = False
    centres = {centre for _, centre in slaved}
    complete = []
    for hold in holds:
        gap: dict = {}
        for node, sign in ((hold.first, 1.0), (hold.second, -1.0)):
            if node == n:  # the ground, which does not move
                continue
            for master, matrix in relations.get(node, {node: eye}).items():
                gap[master] = gap.get(master, 0.0) + sign * matrix[hold.coordinate]
        # Chosen once, for arms of no particular place: the layout must not depend on numbers.
        if hold.node < 0:
            hold = _with_lost(hold, gap, free, centres)
        node = hold.node
        lost = hold.coordinate
        not_lost = eye[lost] == 0
        of_lost = {master: -hold.sign * row for master, row in gap.items()}
        of_lost[node] = of_lost[node] * not_lost
        free[node, lost] = False
        relations.setdefault(node, {node: eye})
        for row in relations.values():
            if node not in row:
                continue
            column = row[node][:, lost]
            # Left out only where it is zero by construction; a traced one is so by chance at most.
            if isinstance(column, np.ndarray) and not column.any():
                continue
            row[node] = row[node] * not_lost
            for master, part in of_lost.items():
                row[master] = row.get(master, 0.0) + column[:, None] * part
        complete.append(hold)
    return relations, tuple(complete), free


def _body_relations(slaved, arms) -> dict:
    """Relations of the nodes of bodies to their centres."""
    relations = {}
    for (node, centre), arm in zip(slaved, arms, strict=True):
        # bodies are rigid: a node moves as its centre does, through the arm between them
        relations[node] = {centre: arm}
    return relations


def _with_lost(hold: Hold, gap, free, centres) -> Hold:
    """The coordinate that a condition removes: of a node by itself rather than of a body."""
    at = hold.coordinate
    # A factor of one needs no division by an arm, which could be zero for other numbers.
    unit = []
    for node, row in gap.items():
        if free[node, at] and abs(abs(row[at]) - 1) < 1e-12:
            unit.append(node)
    if not unit:
        bound = (
            "a condition that nothing else holds yet: not a second pin of the same node, nor one "
        )
        bound += "of a rigid body that is pinned elsewhere (clamp it once, or use a mount)"
        raise BadInput(f"links.{hold.link}", "held", bound)
    node = min(unit, key=lambda node: node in centres)
    return hold._replace(node=node, sign=float(np.sign(gap[node][at])))
