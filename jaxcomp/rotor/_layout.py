r"""What of a model is known before any number: who is connected to whom, and what follows what.

The nodes are divided into *border* nodes (those with links, bodies or branches) and the rest, which
form *segments*: runs of nodes that are coupled to their two neighbours only. Segments stand one
after the other in the columns of an array as high as the longest of them; empty places hold the
number of a dummy node.

Nodes of rigid bodies follow their centres, x_k = A_k x_c. A pinned or clamped link adds one condition a
coordinate, x_a = x_b or x_a = 0, which is solved for a coordinate that occurs in it with the factor one
or minus one; that coordinate is put into all other relations and is gone. Everything is in the order of
the planes of `_conventions`, where the numbers of a node are its coordinates.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from ._bodies import RigidBody, arm_matrices
from ._conventions import AXES, coordinates
from ._nodes import node_names
from ._shaft import Node


@dataclass(frozen=True, eq=False)
class Layout:
    """Static index arrays of a model; n nodes, b border nodes, e elements, s segments in (m, c).

    Two layouts are equal, and hash alike, if they belong to models of the same construction.

    Attributes:
        key: what the layout follows from.
        names: names of the nodes.
        n: number of nodes.
        dof: degrees of freedom of a node.
        pairs: (e, 2) nodes of all shaft elements in the order of the tables.
        links: (l, 2) nodes of the links, then of the pairs of the magnetic pulls; n for the ground.
        centres: centre nodes of the bodies.
        slaved: (node, centre) of the nodes of bodies, in the order of the bodies.
        ties: coordinates that follow others: slaved nodes, and what held links hold.
        active: (n, dof) whether a degree of freedom exists: its own, and not without any
            stiffness and inertia by construction.
        moving: (n, planes, 2) the same in the order of the planes.
        border: the border nodes.
        touched: (b, planes, 2) whether links or bodies act on that coordinate; a magnetic pull does not
            count, because it is isotropic and stays within the whirl components.
        loose: (b, planes, 2) coordinates without any stiffness and inertia by construction.
        segment: (m, c) interior nodes.
        opening: (m, c) whether a segment begins there.
        left_of: (m, c) border position left of the segment that the node belongs to.
        last: (2, s) position and column of the last node of each segment.
        ends: (2, s) border positions left and right of the segments, b for a free end.
        slots: for each element (kind, position, column, transposed); see `_slots`.
    """

    key: tuple
    names: tuple[Node, ...]
    n: int
    dof: int
    pairs: np.ndarray
    links: np.ndarray
    centres: np.ndarray
    slaved: tuple[tuple[int, int], ...]
    ties: "Ties"
    active: np.ndarray
    moving: np.ndarray
    border: np.ndarray
    touched: np.ndarray
    loose: np.ndarray
    segment: np.ndarray
    opening: np.ndarray
    left_of: np.ndarray
    last: np.ndarray
    ends: np.ndarray
    slots: np.ndarray

    def __hash__(self):
        return hash(self.key)

    def __eq__(self, other):
        return isinstance(other, Layout) and self.key == other.key

    @property
    def own(self) -> np.ndarray:
        """(n, planes, 2) Whether a coordinate follows nothing."""
        return self.ties.own.reshape(self.n, -1, 2)

    @property
    def size(self) -> int:
        """Number of active degrees of freedom."""
        return int(self.active.sum())


NEXT, LEFT, RIGHT, BORDER = range(4)


def layout_of(model: Any) -> Layout:
    """The layout of a model; the same arrays for every model of the same construction.

    Args:
        model: a `RotorModel`, or a `System`, which has its layout.
    """
    if (known := getattr(model, "layout", None)) is not None:
        return known
    names = node_names(model)
    number = {name: i for i, name in enumerate(names)}
    pairs = tuple((number[a], number[b]) for s in model.shafts for a, b in s.pairs)
    links = [(link.nodes, link.axes, link.held) for link in model.links]
    links += [(pair, (), False) for pull in model.magnetic_pulls for pair in pull.nodes]
    link_axes = tuple(
        (tuple(number.get(node, len(names)) for node in nodes), tuple(axes), held)
        for nodes, axes, held in links
    )
    bodies = tuple((number[b.centre], tuple(number[k] for k in b.nodes)) for b in model.bodies)
    disks = tuple(number[k] for d in model.disks for k in d.nodes)
    masses = tuple(number[k] for p in model.masses for k in p.nodes)
    return _layout((names, model.dof, pairs, link_axes, bodies, disks, masses))


@lru_cache(maxsize=64)
def _layout(key) -> Layout:
    names, dof, pairs, link_axes, bodies, disks, masses = key
    n, (in_planes, _) = len(names), coordinates(dof)
    place = {AXES[dof][axis]: at for at, axis in enumerate(in_planes)}
    touched, exists = np.zeros((2, n, dof), bool)
    holds: list[Hold] = []
    for link, (nodes, axes, held) in enumerate(link_axes):
        own = [place[axis] for axis in axes if axis in place]
        for node in set(nodes) - {n}:
            touched[node, own] = True
            exists[node, own] |= not held
        if held:
            holds += [Hold(link, *nodes, at) for at in own]
    slaved = tuple((k, c) for c, nodes in bodies for k in nodes)
    ties = find_ties(n, dof, slaved, tuple(holds))
    centres = [c for c, _ in bodies]
    pulled = {node for nodes, axes, _ in link_axes if not axes for node in nodes} - {n}
    neighbours: list[set[int]] = [set() for _ in range(n)]
    for a, b in pairs:
        neighbours[a].add(b)
        neighbours[b].add(a)
    rigid = [*centres, *(k for k, _ in slaved)]
    touched[rigid] = True
    exists[[*rigid, *disks]] = True
    exists[[i for i in range(n) if neighbours[i]]] = True
    exists[list(pulled), 0] = exists[list(pulled), 2] = True  # ux and uy
    exists[list(masses), ::2] = True  # displacements
    for hold in ties.holds:  # what follows gives its inertia and stiffness to what it follows
        joined = [i for i in (hold.first, hold.second) if i < n]
        exists[joined, hold.coordinate] = exists[joined, hold.coordinate].any()
    active = exists & ties.own
    if not active.any():
        raise BadInput("model", "no degree of freedom", "something that can move")

    border = {i for i in range(n) if touched[i].any() or len(neighbours[i]) not in (1, 2)} | pulled
    runs = _runs(n, neighbours, border)
    order = sorted(border)
    at = {node: k for k, node in enumerate(order)} | {None: len(order)}
    segment, opening, last = _packed(n, runs)
    ends = np.array([(at[a], at[b]) for a, _, b in runs], int).reshape(-1, 2).T
    left_of = np.full(segment.shape, len(order))
    for (left, run, _), (_, column) in zip(runs, last, strict=True):
        if left is not None:
            left_of[np.isin(segment[:, column], run), column] = at[left]
    by_plane = lambda table: table.reshape(len(table), -1, 2)  # noqa: E731
    return Layout(
        key=key,
        names=names,
        n=n,
        dof=dof,
        pairs=np.array(pairs, int).reshape(-1, 2),
        links=np.array([nodes for nodes, _, _ in link_axes], int).reshape(-1, 2),
        centres=np.array(centres, int),
        slaved=slaved,
        ties=ties,
        active=active[:, np.argsort(in_planes)],
        moving=by_plane(active),
        border=np.array(order, int),
        touched=by_plane(touched[order]),
        loose=by_plane((ties.own & ~exists)[order]),
        segment=segment,
        opening=opening,
        left_of=left_of,
        last=last.T,
        ends=ends,
        slots=_slots(pairs, segment, runs, at),
    )


def _runs(n, neighbours, border):
    """Paths of interior nodes as (left border node or None, nodes, right border node or None).

    A closed ring without a border node gets one; so does a model without any border, because the
    elimination ends on a border.
    """
    if not border:
        border.add(0)
    inner = {i: neighbours[i] - border for i in range(n) if i not in border}
    runs, left_over = [], set(inner)
    for tip in [i for i in inner if len(inner[i]) < 2]:
        if tip not in left_over:
            continue
        run = [tip]
        while ahead := inner[run[-1]] - set(run):
            run.append(ahead.pop())
        left_over -= set(run)
        outer = sorted(neighbours[tip] & border)
        if len(run) == 1:
            left, right = (*outer, None, None)[:2]
        else:
            far = sorted(neighbours[run[-1]] & border)
            left, right = (*outer, None)[0], (*far, None)[0]
        runs.append((left, tuple(run), right))
    if left_over:
        border.add(min(left_over))
        return _runs(n, neighbours, border)
    return runs


def _packed(n, runs):
    """Segments in columns: node numbers (m, c), where they begin, (position, column) of the ends."""
    height = max([len(run) for _, run, _ in runs], default=0)
    columns: list[list[int]] = []
    last = np.zeros((len(runs), 2), int)
    for s in sorted(range(len(runs)), key=lambda s: -len(runs[s][1])):
        run = runs[s][1]
        room = [c for c, nodes in enumerate(columns) if len(nodes) + len(run) <= height]
        if not room:
            columns.append([])
            room = [len(columns) - 1]
        columns[room[0]] += run
        last[s] = len(columns[room[0]]) - 1, room[0]
    segment = np.full((height, len(columns)), n)
    for c, nodes in enumerate(columns):
        segment[: len(nodes), c] = nodes
    first = [run[0] for _, run, _ in runs]
    return segment, np.isin(segment, [*first, n]), last


def _slots(pairs, segment, runs, place):
    """Where the off-diagonal block of each element (row node 1, column node 2) belongs.

    kind NEXT: between position - 1 and position of a segment; LEFT: between the first node of a
    segment and its left border node; RIGHT: between the last one of the segment, whose number
    stands in place of the column, and the right border node; BORDER: between two border nodes,
    whose places stand in the two index columns.
    """
    where = {int(node): at for at, node in np.ndenumerate(segment)}
    number = {node: s for s, (_, run, _) in enumerate(runs) for node in run}
    out = []
    for a, b in pairs:
        if a in place and b in place:
            out.append((BORDER, place[a], place[b], 0))
        elif a in where and b in where:
            (ja, c), (jb, _) = where[a], where[b]
            out.append((NEXT, max(ja, jb), c, int(ja > jb)))
        else:
            inner, outer = (a, b) if a in where else (b, a)
            left, run, _ = runs[number[inner]]
            if inner == run[0] and outer == left:
                out.append((LEFT, *where[inner], int(inner == b)))
            else:
                out.append((RIGHT, 0, number[inner], int(inner == b)))
    return np.array(out, int).reshape(-1, 4)


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
        own: (n, dof) coordinates that follow nothing.
        holds: conditions of held links.
    """

    nodes: np.ndarray
    own: np.ndarray
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
    relations, holds, own = _solved(n, dof, slaved, arms, holds)
    pairs = [
        (node, master)
        for node, row in relations.items()
        for master, matrix in row.items()
        if (matrix * ~own[node][:, None]).any()
    ]
    return Ties(np.array(pairs, int).reshape(-1, 2).T, own, holds)


def tie_matrices(
    ties: Ties, slaved: tuple, arms: Float[Array, "slaved dof dof"]
) -> Float[Array, "t dof dof"]:
    """Motion of following nodes for the entries of `Ties.nodes`, from the arms of the bodies."""
    if not ties.holds:
        return arms
    n, dof = ties.own.shape
    relations, _, own = _solved(n, dof, slaved, arms, ties.holds)
    rows = [relations[a][b] * ~own[a][:, None] for a, b in ties.nodes.T]
    return jnp.stack([jnp.zeros((dof, dof)), *rows])[1:]


def reaction_matrix(
    ties: Ties, slaved: tuple, arms: Float[Array, "slaved dof dof"]
) -> Float[Array, "h h"]:
    """Force of each condition on the second node, from the forces left on the lost coordinates.

    The forces are those on free nodes and centres of bodies.
    """
    of = {node: (centre, arm) for (node, centre), arm in zip(slaved, arms, strict=True)}
    eye = np.eye(ties.own.shape[1])
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
    return jnp.linalg.inv(jnp.stack(table)).T


def _solved(n, dof, slaved, arms, holds):
    """Relations {node: {node: matrix}} of all that does not move by itself, complete holds, `own`."""
    eye = np.eye(dof)
    relations: dict = {
        node: {centre: arm} for (node, centre), arm in zip(slaved, arms, strict=True)
    }
    own = np.ones((n, dof), bool)
    own[[node for node, _ in slaved]] = False
    centres, done = {centre for _, centre in slaved}, []
    for hold in holds:
        gap: dict = {}
        for node, sign in ((hold.first, 1.0), (hold.second, -1.0)):
            for master, matrix in relations.get(node, {node: eye}).items() if node < n else ():
                gap[master] = gap.get(master, 0.0) + sign * matrix[hold.coordinate]
        if hold.node < 0:
            hold = _with_lost(hold, gap, own, centres)
        node, lost = hold.node, hold.coordinate
        others = eye[lost] == 0
        rest = {master: -hold.sign * row for master, row in gap.items()}
        rest[node] = rest[node] * others
        own[node, lost] = False
        relations.setdefault(node, {node: eye})
        for row in relations.values():
            if node not in row:
                continue
            column = row[node][:, lost]
            if isinstance(column, np.ndarray) and not column.any():
                continue
            row[node] = row[node] * others
            for master, part in rest.items():
                row[master] = row.get(master, 0.0) + column[:, None] * part
        done.append(hold)
    return relations, tuple(done), own


def _with_lost(hold: Hold, gap, own, centres) -> Hold:
    """The coordinate that a condition removes: of a node by itself rather than of a body."""
    at = hold.coordinate
    unit = [n for n, row in gap.items() if own[n, at] and abs(abs(row[at]) - 1) < 1e-12]
    if not unit:
        bound = (
            "a condition that nothing else holds yet: not a second pin of the same node, nor one "
        )
        bound += "of a rigid body that is pinned elsewhere (clamp it once, or use a mount)"
        raise BadInput(f"links.{hold.link}", "held", bound)
    node = min(unit, key=lambda node: node in centres)
    return hold._replace(node=node, sign=float(np.sign(gap[node][at])))
