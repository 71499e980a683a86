r"""What of a model is known before any number: who is connected to whom.

The nodes are divided into *border* nodes (those with links, bodies or branches) and the rest, which
form *segments*: runs of nodes that are coupled to their two neighbours only. Segments stand one
after the other in the columns of an array as high as the longest of them; empty places hold the
number of a dummy node.

Everything is in the order of the planes of `_conventions`, where the numbers of a node are its
coordinates.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np

from .._core.errors import BadInput
from ._conventions import AXES, coordinates
from ._nodes import node_names
from ._shaft import Node
from ._ties import Hold, Ties, find_ties


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
        last_nodes: (2, s) position and column of the last node of each segment.
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
    ties: Ties
    active: np.ndarray
    moving: np.ndarray
    border: np.ndarray
    touched: np.ndarray
    loose: np.ndarray
    segment: np.ndarray
    opening: np.ndarray
    left_of: np.ndarray
    last_nodes: np.ndarray
    ends: np.ndarray
    slots: np.ndarray

    def __hash__(self):
        return hash(self.key)

    def __eq__(self, other):
        return isinstance(other, Layout) and self.key == other.key

    @property
    def free(self) -> np.ndarray:
        """(n, planes, 2) Whether a coordinate follows nothing."""
        return self.ties.free.reshape(self.n, -1, 2)

    @property
    def components(self) -> int:
        """Number of whirl components: p and q, and with 6 degrees of freedom the axial one."""
        return self.dof // 2

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
    if (prepared := getattr(model, "layout", None)) is not None:
        return prepared
    names = node_names(model)
    number = {name: i for i, name in enumerate(names)}
    # The ground has the number behind the last node, which `add` leaves out.
    number[None] = len(names)

    def numbers(nodes):
        return tuple(number[node] for node in nodes)

    def numbers_of_tables(tables):
        return numbers(chain.from_iterable(table.nodes for table in tables))

    pairs = []
    for shaft in model.shafts:
        pairs += map(numbers, shaft.pairs)
    links = []
    for link in model.links:
        links.append((numbers(link.nodes), tuple(link.axes), link.held))
    for pull in model.magnetic_pulls:
        for pair in pull.nodes:
            links.append((numbers(pair), (), False))
    bodies = []
    for body in model.bodies:
        bodies.append((number[body.centre], numbers(body.nodes)))
    disks = numbers_of_tables(model.disks)
    masses = numbers_of_tables(model.masses)
    # Names and connections only: models that differ in numbers share one layout, and so programs
    # in which it is static.
    return _layout((names, model.dof, tuple(pairs), tuple(links), tuple(bodies), disks, masses))


@lru_cache(maxsize=64)
def _layout(key) -> Layout:
    names, dof, pairs, link_axes, bodies, _, _ = key
    n = len(names)
    in_planes, _ = coordinates(dof)
    slaved = []
    centres = []
    for centre, nodes in bodies:
        centres.append(centre)
        for node in nodes:
            slaved.append((node, centre))
    slaved = tuple(slaved)
    neighbours: list[set[int]] = [set() for _ in range(n)]
    for a, b in pairs:
        neighbours[a].add(b)
        neighbours[b].add(a)
    # Pulls are the links without axes. Their nodes are border nodes: a segment couples neighbours only.
    pulled = _pulled_nodes(n, link_axes)
    touched, exists, ties = _coordinates_of(key, slaved, neighbours, pulled)
    active = exists & ties.free
    if not active.any():
        raise BadInput("model", "no degree of freedom", "something that can move")

    border = _border_nodes(touched, neighbours, pulled)
    runs = _runs(n, neighbours, border)
    order = sorted(border)
    at = {node: k for k, node in enumerate(order)} | {None: len(order)}
    segment, opening, last_nodes = _packed(n, runs)
    ends = []
    for before, _, behind in runs:
        ends.append((at[before], at[behind]))
    left_of = np.full(segment.shape, len(order))
    for (before, run, _), (_, column) in zip(runs, last_nodes, strict=True):
        if before is not None:
            left_of[np.isin(segment[:, column], run), column] = at[before]
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
        loose=by_plane((ties.free & ~exists)[order]),
        segment=segment,
        opening=opening,
        left_of=left_of,
        last_nodes=last_nodes.T,
        ends=np.array(ends, int).reshape(-1, 2).T,
        slots=_slots(pairs, segment, runs, at),
    )


def _pulled_nodes(n: int, link_axes) -> set[int]:
    """Nodes of the magnetic pulls."""
    pulled = set()
    for nodes, axes, _ in link_axes:
        if not axes:
            pulled.update(nodes)
    return pulled - {n}  # without the ground


def _border_nodes(touched, neighbours, pulled) -> set[int]:
    """Nodes with links, bodies, pulls or branches, and those that stand alone."""
    border = set(pulled)
    for node, around in enumerate(neighbours):
        # a run passes through nodes with one neighbour or two and with nothing else on them
        if touched[node].any() or len(around) not in (1, 2):
            border.add(node)
    return border


def _coordinates_of(key, slaved, neighbours, pulled) -> tuple[np.ndarray, np.ndarray, Ties]:
    """Which coordinates (n, dof) links or bodies touch, which exist, and which follow others."""
    names, dof, _, link_axes, bodies, disks, masses = key
    n = len(names)
    in_planes, _ = coordinates(dof)
    place = {AXES[dof][axis]: at for at, axis in enumerate(in_planes)}
    touched, exists = np.zeros((2, n, dof), bool)
    holds: list[Hold] = []
    for link, (nodes, axes, held) in enumerate(link_axes):
        of_link = [place[axis] for axis in axes if axis in place]
        for node in set(nodes) - {n}:
            touched[node, of_link] = True
            # A held link has no stiffness: it does not bring a coordinate into being.
            exists[node, of_link] |= not held
        if held:
            for at in of_link:
                holds.append(Hold(link, *nodes, at))
    ties = find_ties(n, dof, slaved, tuple(holds))
    # A body joins all coordinates of its nodes, across the whirl components.
    rigid = []
    for centre, nodes in bodies:
        rigid += [centre, *nodes]
    touched[rigid] = True
    exists[[*rigid, *disks]] = True
    exists[np.array([len(around) > 0 for around in neighbours], bool)] = True
    exists[list(pulled), 0] = exists[list(pulled), 2] = True  # ux and uy
    exists[list(masses), ::2] = True  # displacements
    for hold in ties.holds:  # what follows gives its inertia and stiffness to what it follows
        joined = [i for i in (hold.first, hold.second) if i < n]
        exists[joined, hold.coordinate] = exists[joined, hold.coordinate].any()
    return touched, exists, ties


def _runs(n, neighbours, border):
    """Paths of interior nodes as (left border node or None, nodes, right border node or None).

    A closed ring without a border node gets one; so does a model without any border, because the
    elimination ends on a border.
    """
    if not border:
        border.add(0)
    inner = {}
    for node in range(n):
        if node not in border:
            inner[node] = neighbours[node] - border
    runs = []
    left_over = set(inner)
    # A run begins where at most one neighbour is inside; a ring of inner nodes has no such tip.
    for tip in inner:
        if len(inner[tip]) > 1 or tip not in left_over:
            continue
        run = [tip]
        while ahead := inner[run[-1]] - set(run):
            run.append(ahead.pop())
        left_over -= set(run)
        outer = sorted(neighbours[tip] & border)
        # both border nodes, if there are two, stand beside the same node
        if len(run) == 1:
            before, behind = (*outer, None, None)[:2]
        else:
            far_ends = sorted(neighbours[run[-1]] & border)
            before = (*outer, None)[0]
            behind = (*far_ends, None)[0]
        runs.append((before, tuple(run), behind))
    if left_over:
        border.add(min(left_over))
        return _runs(n, neighbours, border)
    return runs


def _packed(n, runs):
    """Segments in columns: node numbers (m, c), where they begin, (position, column) of the ends."""
    height = max([len(run) for _, run, _ in runs], default=0)
    columns: list[list[int]] = []
    last_nodes = np.zeros((len(runs), 2), int)
    # Longest first into the first column with room: few columns, none higher than the longest
    # segment, whose length alone is sequential in the elimination.
    for s in sorted(range(len(runs)), key=lambda s: -len(runs[s][1])):
        run = runs[s][1]
        column = _column_with_room(columns, len(run), height)
        columns[column] += run
        last_nodes[s] = len(columns[column]) - 1, column
    segment = np.full((height, len(columns)), n)
    for c, nodes in enumerate(columns):
        segment[: len(nodes), c] = nodes
    first = [run[0] for _, run, _ in runs]
    # Empty places open as well, so that no sum of the segment above them runs on through them.
    return segment, np.isin(segment, [*first, n]), last_nodes


def _column_with_room(columns: list[list[int]], length: int, height: int) -> int:
    """Number of the first column that takes a run of a length; of a new one where none does."""
    for number, nodes in enumerate(columns):
        if len(nodes) + length <= height:
            return number
    columns.append([])
    return len(columns) - 1


def _slots(pairs, segment, runs, place):
    """Where the off-diagonal block of each element (row node 1, column node 2) belongs.

    kind NEXT: between position - 1 and position of a segment; LEFT: between the first node of a
    segment and its left border node; RIGHT: between the last one of the segment, whose number
    stands in place of the column, and the right border node; BORDER: between two border nodes,
    whose places stand in the two index columns.
    """
    where = {int(node): at for at, node in np.ndenumerate(segment)}
    number = {}
    for s, (_, run, _) in enumerate(runs):
        number |= dict.fromkeys(run, s)
    out = []
    for a, b in pairs:
        if a in place and b in place:
            out.append((BORDER, place[a], place[b], 0))
        elif a in where and b in where:
            ja, c = where[a]
            jb, _ = where[b]
            out.append((NEXT, max(ja, jb), c, int(ja > jb)))
        else:
            inner, outer = (a, b) if a in where else (b, a)
            before, run, _ = runs[number[inner]]
            if inner == run[0] and outer == before:
                out.append((LEFT, *where[inner], int(inner == b)))
            else:
                out.append((RIGHT, 0, number[inner], int(inner == b)))
    return np.array(out, int).reshape(-1, 4)
