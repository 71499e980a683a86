r"""The model: tables of elements over named nodes."""

import equinox as eqx

from .._fields import BadInput, Part
from ._bodies import RigidBody
from ._conventions import AXES
from ._damping import ModalDamping, ProportionalDamping
from ._inertia import Disks, PointMasses
from ._links import Link, SidePull
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
        side_pulls: magnetic pull between rotor and stator.
        bodies: rigid bodies.
        damping: proportional or modal damping of the structure.
        dof: degrees of freedom of a node, 4 (lateral) or 6 (with axial and torsion).
        nodes: order of the nodes.

    Raises:
        BadInput: an unknown or doubly slaved node, or no node at all.
    """

    shafts: tuple[ShaftElements, ...] = ()
    disks: tuple[Disks, ...] = ()
    masses: tuple[PointMasses, ...] = ()
    links: tuple[Link, ...] = ()
    side_pulls: tuple[SidePull, ...] = ()
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
        slaved = [node for body in self.bodies for node in body.nodes]
        centres = [body.centre for body in self.bodies]
        if len(set(slaved)) != len(slaved) or set(slaved) & set(centres):
            raise BadInput("bodies", str(slaved), "nodes that belong to one body each")
        if len(set(centres)) != len(centres):
            raise BadInput("bodies", str(centres), "bodies with a centre of their own")


def node_names(model: RotorModel) -> tuple[Node, ...]:
    """The nodes in the order of every array over nodes."""
    return model.nodes or _mentioned(model)


def node_index(model: RotorModel, node: Node) -> int:
    """Place of a node in arrays over nodes.

    Raises:
        BadInput: there is no such node.
    """
    names = node_names(model)
    if node not in names:
        raise BadInput("node", str(node), f"one of {names}")
    return names.index(node)


def _mentioned(model: RotorModel) -> tuple[Node, ...]:
    seen: dict[Node, None] = {}
    for shaft in model.shafts:
        for pair in shaft.nodes:
            seen.update(dict.fromkeys(pair))
    for table in (*model.disks, *model.masses):
        seen.update(dict.fromkeys(table.nodes))
    for link in model.links:
        seen.update(dict.fromkeys(link.nodes))
    for pull in model.side_pulls:
        for pair in pull.nodes:
            seen.update(dict.fromkeys(pair))
    for body in model.bodies:
        seen.update(dict.fromkeys((body.centre, *body.nodes)))
    seen.pop(None, None)
    return tuple(seen)
