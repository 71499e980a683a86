r"""The model: tables of elements over named nodes, where these are, and the planes of a balance."""

from collections import Counter
from itertools import chain

import equinox as eqx
import numpy as np
from jaxtyping import Array

from .._core.errors import BadInput
from .._core.fields import NONNEGATIVE, POSITIVE, Part, is_traced, quantity
from ._bodies import Disks, ModalDamping, PointMasses, ProportionalDamping, RigidBody
from ._conventions import AXES, check_axes
from ._layout import layout_of
from ._links import Link, MagneticPull
from ._nodes import check_nodes, mentioned, node_names, nodes_of
from ._shaft import Node, ShaftElements


class RotorModel(Part):
    """Rotor, crankcase and housing as tables of elements.

    Nodes are numbers or words; they exist by being mentioned, in the order of the tables below
    unless `nodes` gives another one. Frame and degrees of freedom: see
    `jaxcomp.rotor._conventions`.

    Args:
        shafts: tables of beam elements.
        disks: tables of rigid disks.
        masses: tables of point masses.
        links: bearings, suspensions, grommets.
        magnetic_pulls: unbalanced magnetic pull between rotor and stator.
        bodies: rigid bodies.
        damping: proportional or modal damping of the structure.
        dof: degrees of freedom of a node, 4 (lateral) or 6 (with axial and torsion).
        nodes: order of the nodes.

    Raises:
        BadInput: a node that nothing else joins to the model or that follows two bodies, no node at
            all, or held links of which one follows from the others.
    """

    shafts: tuple[ShaftElements, ...] = ()
    disks: tuple[Disks, ...] = ()
    masses: tuple[PointMasses, ...] = ()
    links: tuple[Link, ...] = ()
    magnetic_pulls: tuple[MagneticPull, ...] = ()
    bodies: tuple[RigidBody, ...] = ()
    damping: ProportionalDamping | ModalDamping | None = None
    dof: int = eqx.field(static=True, default=4)
    nodes: tuple[Node, ...] | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if self.dof not in AXES:
            raise BadInput("dof", self.dof, "4 (lateral) or 6 (with axial and torsion)")
        names = mentioned(self)
        if not names:
            raise BadInput("nodes", "()", "at least one node, mentioned by an element")
        if self.nodes is not None and Counter(self.nodes) != Counter(names):
            raise BadInput("nodes", str(self.nodes), f"an ordering of {sorted(map(str, names))}")
        self._check_joined()
        self._check_lengths()
        slaved: list[Node] = []
        centres = []
        for body in self.bodies:
            slaved += body.nodes
            centres.append(body.centre)
        if len(set(slaved)) != len(slaved) or set(slaved) & set(centres):
            raise BadInput("bodies", str(slaved), "nodes that belong to one body each")
        if len(set(centres)) != len(centres):
            raise BadInput("bodies", str(centres), "bodies with a centre of their own")
        # A condition that the others imply raises where the model is built, not at its first solution.
        if any(link.held for link in self.links):
            layout_of(self)

    def _check_joined(self):
        """A node that stands in one place only is most likely a slip of the pen."""

        def nodes(first, second):
            parts = (*getattr(self, first), *getattr(self, second))
            return list(chain.from_iterable(map(nodes_of, parts)))

        solid = {*nodes("shafts", "bodies"), None}
        # An inertia holds nothing by itself: it needs a neighbour, and is one for the end of a link.
        inertias = {*nodes("disks", "masses")}
        ends = nodes("links", "magnetic_pulls")
        loose = inertias - solid - {*ends}
        hanging = {node for node in ends if ends.count(node) == 1} - solid - inertias
        for name, unjoined, joints in (
            ("disks", loose, "shaft, link or body"),
            ("masses", loose, "shaft, link or body"),
            ("links", hanging, "shaft, disk, mass, body or another link"),
            ("magnetic_pulls", hanging, "shaft, disk, mass, body or link"),
        ):
            for number, part in enumerate(getattr(self, name)):
                for node in nodes_of(part):
                    if node in unjoined:
                        raise BadInput(f"{name}.{number}.nodes", node, f"a node of a {joints}")

    def _check_lengths(self):
        """Elements between the same two nodes have one length, and one direction."""
        lengths: dict = {}
        for number, shaft in enumerate(self.shafts):
            if is_traced(shaft.length):
                continue
            for (a, b), length in zip(shaft.pairs, np.asarray(shaft.length), strict=True):
                # Numbers and words have no order but that of text; turned round, an element leads back.
                key = (a, b)
                if str(a) > str(b):
                    key = (b, a)
                    length = -length
                first_length = lengths.setdefault(key, length)
                if abs(length - first_length) > 1e-6 * abs(first_length):
                    bound = f"{abs(first_length):.6g} m from the first to the second node, as in"
                    bound += f" another element between {key[0]} and {key[1]}"
                    raise BadInput(f"shafts.{number}.length", length, bound)


def rotor_among(parts) -> RotorModel:
    """The rotor among the parts of a scene.

    Raises:
        BadInput: there is none.
    """
    model = parts.get("rotor")
    if not isinstance(model, RotorModel):
        raise BadInput("", "absent", "beside a section [rotor]")
    return model


def node_positions(model: RotorModel) -> dict[Node, np.ndarray]:
    """[m] (x, y, z) of every node, the first node of the first shaft (or body) at the origin.

    Elements lead along z and arms from the centres of bodies; the two nodes of a link are in one
    place. What nothing joins begins at the origin again. The numbers have to be concrete.
    """
    joints: list = []
    for shaft in model.shafts:
        lengths = np.asarray(shaft.length)[:, None] * [0.0, 0.0, 1.0]
        joints += zip(shaft.pairs, lengths, strict=True)
    for body in model.bodies:
        for node, arm in zip(body.nodes, np.asarray(body.arm), strict=True):
            joints.append(((body.centre, node), arm))
    pairs = [link.nodes for link in model.links]
    for pull in model.magnetic_pulls:
        pairs += pull.nodes
    for pair in pairs:
        if pair[1] is not None:
            joints.append((pair, np.zeros(3)))
    positions = {}
    for group in _joined(model, joints):
        positions |= group
    return positions


def subsets(model: RotorModel) -> tuple[tuple[Node, ...], ...]:
    """Nodes that shafts or bodies hold together, such as rotor, crankcase and housing."""
    # places are of no interest here: every joint is a step of zero
    joints = []
    for shaft in model.shafts:
        for pair in shaft.pairs:
            joints.append((pair, 0.0))
    for body in model.bodies:
        for node in body.nodes:
            joints.append(((body.centre, node), 0.0))
    names = node_names(model)
    groups = []
    for group in _joined(model, joints):
        groups.append(tuple(name for name in names if name in group))
    return tuple(groups)


def _joined(model: RotorModel, joints) -> list[dict[Node, np.ndarray]]:
    """Groups of nodes that joints (pair of nodes, step between them) hold together, with places."""
    steps: dict[Node, list] = {node: [] for node in node_names(model)}
    for (a, b), step in joints:
        steps[a].append((b, step))
        steps[b].append((a, -step))
    groups: list[dict[Node, np.ndarray]] = []
    for start in steps:
        if any(start in group for group in groups):
            continue
        places = {start: np.zeros(3)}
        waiting = [start]
        while waiting:
            reached = waiting.pop(0)
            for neighbour, step in steps[reached]:
                # Joints that close a loop are not followed: the way that reached a node first decides.
                if neighbour not in places:
                    places[neighbour] = places[reached] + step
                    waiting.append(neighbour)
        groups.append(places)
    return groups


def subset_names(model: RotorModel) -> tuple[str, ...]:
    """Words for the subsets: the centre of a body, "rotor" for what spins, else the first node."""
    spinning = set()
    for shaft in model.shafts:
        if shaft.spins:
            spinning.update(nodes_of(shaft))
    centres = [body.centre for body in model.bodies]
    names = []
    for group in subsets(model):
        inside = [centre for centre in centres if centre in group]
        if inside:
            name = str(inside[0])
        elif spinning & set(group):
            name = "rotor"
        else:
            name = f"line of {group[0]}"
        # two shafts without a body of their own would both be "rotor"
        if name in names:
            name = f"{name} of {group[0]}"
        names.append(name)
    return tuple(names)


class CorrectionPlane(Part):
    """A plane of the rotor that takes correction masses.

    Args:
        name: of the plane.
        node: of the rotor.
        radius: [m] at which a mass is fixed; absent where only mass times radius is asked for.
    """

    name: str = eqx.field(static=True)
    node: Node = eqx.field(static=True)
    radius: Array | None = quantity("m", POSITIVE, default=None)


class TargetPlane(Part):
    """A node whose vibration counts.

    Args:
        name: of the plane.
        node: of any subset.
        axes: directions in which its motion is judged.
        relative_to: node from which the motion is seen, for example across an air gap; absent for
            the absolute motion.
        weight: [-] of this target among the others.
    """

    name: str = eqx.field(static=True)
    node: Node = eqx.field(static=True)
    axes: tuple[str, ...] = eqx.field(static=True, default=("ux", "uy"))
    relative_to: Node | None = eqx.field(static=True, default=None)
    weight: Array = quantity("", NONNEGATIVE, default=1.0)

    def __check_init__(self):
        check_axes(self.axes)


class BalancingPlanes(Part):
    """Correction and target planes of a machine.

    Args:
        planes: where masses can be added.
        targets: where vibration is judged.
        speeds: [rad/s] (m,) at which the machine runs.

    Raises:
        BadInput: no plane or no target, or two of one name.
    """

    planes: tuple[CorrectionPlane, ...]
    targets: tuple[TargetPlane, ...]
    speeds: Array = quantity("rad/s", POSITIVE, shape=(None,), usual=(0.5, 1e4))

    def __check_init__(self):
        for field in ("planes", "targets"):
            names = [plane.name for plane in getattr(self, field)]
            if not names:
                raise BadInput(field, "empty", f"at least one of the {field}")
            if len(set(names)) != len(names):
                raise BadInput(field, str(names), "of different names")

    def check_beside(self, parts) -> None:
        """Whether the rotor of the same file has the nodes and axes.

        Raises:
            BadInput: naming the plane, and the nodes or axes that exist.
        """
        model = rotor_among(parts)
        for number, plane in enumerate(self.planes):
            check_nodes(model, plane.node, f"planes.{number}.node")
        for number, target in enumerate(self.targets):
            check_nodes(model, target.node, f"targets.{number}.node")
            check_nodes(model, target.relative_to, f"targets.{number}.relative_to")
            if not set(target.axes) <= set(AXES[model.dof]):
                bound = f"out of {AXES[model.dof]} with {model.dof} degrees of freedom"
                raise BadInput(f"targets.{number}.axes", str(target.axes), bound)
