r"""The model: tables of elements over named nodes."""

from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np

from .._fields import BadInput, Part, is_traced
from .._words import hint
from ._bodies import RigidBody
from ._conventions import AXES
from ._damping import ModalDamping, ProportionalDamping
from ._inertia import Disks, PointMasses
from ._links import Link, MagneticPull
from ._shaft import Node, ShaftElements

if TYPE_CHECKING:
    from ._system import System


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
        mentioned = _mentioned(self)
        if not mentioned:
            raise BadInput("nodes", "()", "at least one node, mentioned by an element")
        if self.nodes is not None and (
            set(self.nodes) != set(mentioned) or len(self.nodes) != len(set(self.nodes))
        ):
            raise BadInput(
                "nodes", str(self.nodes), f"an ordering of {sorted(map(str, mentioned))}"
            )
        self._check_joined()
        self._check_lengths()
        slaved = [node for body in self.bodies for node in body.nodes]
        centres = [body.centre for body in self.bodies]
        if len(set(slaved)) != len(slaved) or set(slaved) & set(centres):
            raise BadInput("bodies", str(slaved), "nodes that belong to one body each")
        if len(set(centres)) != len(centres):
            raise BadInput("bodies", str(centres), "bodies with a centre of their own")
        if any(link.held for link in self.links):
            from ._layout import layout_of  # built on this module

            layout_of(self)

    def _check_joined(self):
        """A node that stands in one place only is most likely a slip of the pen."""
        shafts = {node for shaft in self.shafts for pair in shaft.pairs for node in pair}
        bodies = {node for body in self.bodies for node in (body.centre, *body.nodes)}
        inertias = {n for table in (*self.disks, *self.masses) for n in table.nodes}
        ends = [n for link in self.links for n in link.nodes]
        ends += [n for pull in self.magnetic_pulls for pair in pull.nodes for n in pair]
        for name in ("disks", "masses"):
            for number, table in enumerate(getattr(self, name)):
                for node in set(table.nodes) - shafts - bodies - set(ends):
                    raise BadInput(
                        f"{name}.{number}.nodes", node, "a node of a shaft, link or body"
                    )
        held = shafts | bodies | inertias | {None}
        for number, link in enumerate(self.links):
            for node in set(link.nodes) - held:
                if ends.count(node) == 1:
                    bound = "a node of a shaft, disk, mass, body or another link"
                    raise BadInput(f"links.{number}.nodes", node, bound)
        for number, pull in enumerate(self.magnetic_pulls):
            for node in {n for pair in pull.nodes for n in pair} - held:
                if ends.count(node) == 1:
                    bound = "a node of a shaft, disk, mass, body or link"
                    raise BadInput(f"magnetic_pulls.{number}.nodes", node, bound)

    def _check_lengths(self):
        """Elements between the same two nodes have one length, and one direction."""
        known: dict = {}
        for number, shaft in enumerate(self.shafts):
            if is_traced(shaft.length):
                continue
            for (a, b), length in zip(shaft.pairs, np.asarray(shaft.length), strict=True):
                key, length = ((a, b), length) if str(a) <= str(b) else ((b, a), -length)
                other = known.setdefault(key, length)
                if abs(length - other) > 1e-6 * abs(other):
                    bound = f"{abs(other):.6g} m from the first to the second node, as in"
                    bound += f" another element between {key[0]} and {key[1]}"
                    raise BadInput(f"shafts.{number}.length", length, bound)


def node_names(model: "RotorModel | System") -> tuple[Node, ...]:
    """The nodes in the order of every array over nodes."""
    return model.nodes or _mentioned(model)  # pyright: ignore[reportArgumentType]


def node_index(model: "RotorModel | System", node: Node) -> int:
    """Place of a node in arrays over nodes.

    Raises:
        BadInput: there is no such node.
    """
    names = node_names(model)
    if node not in names:
        raise BadInput("node", str(node), f"one of {names}{hint(node, names)}")
    return names.index(node)


def check_node(model: RotorModel, node: Node, field: str) -> None:
    """Refuse a node that the model does not have, under the name of the field that holds it.

    Raises:
        BadInput: there is no such node.
    """
    if node not in node_names(model):
        names = node_names(model)
        raise BadInput(field, node, f"a node of the rotor, one of {names}{hint(node, names)}")


def rotor_among(parts) -> RotorModel:
    """The rotor among the parts of a scene.

    Raises:
        BadInput: there is none.
    """
    model = parts.get("rotor")
    if not isinstance(model, RotorModel):
        raise BadInput("", "absent", "beside a section [rotor]")
    return model


def _mentioned(model: RotorModel) -> tuple[Node, ...]:
    seen: dict[Node, None] = {}
    for shaft in model.shafts:
        for pair in shaft.pairs:
            seen.update(dict.fromkeys(pair))
    for table in (*model.disks, *model.masses):
        seen.update(dict.fromkeys(table.nodes))
    for link in model.links:
        seen.update(dict.fromkeys(link.nodes))
    for pull in model.magnetic_pulls:
        for pair in pull.nodes:
            seen.update(dict.fromkeys(pair))
    for body in model.bodies:
        seen.update(dict.fromkeys((body.centre, *body.nodes)))
    seen.pop(None, None)
    return tuple(seen)
