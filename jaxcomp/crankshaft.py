r"""The crankshaft of a machine whose rotor is described: what the crank mechanism sees of it.

Inertia about the axis, mass, unbalance and couple follow from the shaft elements, disks and
unbalances of the rotor; nothing of them is typed twice. In the frame of the crank, x towards the pin
and y 90 degrees ahead of it, an unbalance $U$ at phase $\delta$ on a node $z$ from the plane of the
rod counts as

$$\sum U (\cos\delta, \sin\delta), \qquad \sum U z (\cos\delta, \sin\delta) .$$
"""

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._fields import BadInput, replaced
from .film import NamedBearing
from .friction import MainBearings, ShaftBearings
from .rotor import (
    Link,
    LoadedFilm,
    Mount,
    RotorModel,
    Unbalances,
    nodal_load,
    node_names,
    receptance,
    shaft_mass,
    shaft_polar_inertia,
    subsets,
)

Node = int | str


class Crankshaft(NamedTuple):
    """A rotor as the crank mechanism sees it.

    Attributes:
        inertia: [kg m^2] about the axis.
        mass: [kg].
        unbalance: [kg m] (2,) towards the pin and 90 degrees ahead of it.
        couple: [kg m^2] (2,) sum of unbalance times z from the plane of the rod.
    """

    inertia: Float[Array, ""]
    mass: Float[Array, ""]
    unbalance: Float[Array, "2"]
    couple: Float[Array, "2"]


@eqx.filter_jit  # one program where a machine is put together, instead of one for each product
def crankshaft(rotor: RotorModel, unbalances: Iterable[Unbalances], pin: Node) -> Crankshaft:
    """The crankshaft of a rotor, differentiable in all its numbers.

    Args:
        rotor: the model.
        unbalances: on its nodes; those on other parts of the model do not turn and are left out.
        pin: node in the plane of the rod.
    """
    place = axial_positions(rotor, pin)
    inertia = mass = jnp.zeros(())
    for shaft in rotor.shafts:
        own = jnp.array([a in place for a, _ in shaft.pairs], float)
        mass = mass + own @ shaft_mass(shaft)
        inertia = inertia + own @ shaft_polar_inertia(shaft)
    for table in (*rotor.disks, *rotor.masses):
        own = jnp.array([node in place for node in table.nodes], float)
        mass = mass + own @ table.mass
        inertia = inertia + own @ getattr(table, "polar_inertia", jnp.zeros_like(own))
    unbalance = couple = jnp.zeros(2)
    for table in unbalances:
        own = jnp.array([node in place for node in table.nodes], float)
        z = jnp.stack([jnp.asarray(place.get(node, 0.0), float) for node in table.nodes])
        vectors = own * table.magnitude * jnp.stack([jnp.cos(table.phase), jnp.sin(table.phase)])
        unbalance, couple = unbalance + vectors.sum(-1), couple + vectors @ z
    return Crankshaft(inertia, mass, unbalance, couple)


def axial_positions(rotor: RotorModel, origin: Node) -> dict[Node, Float[Array, ""]]:
    """[m] z of every node of the shaft that carries a node, from that node.

    Raises:
        BadInput: the node is not on a shaft.
    """
    members = next((group for group in subsets(rotor) if origin in group), ())
    steps: dict[Node, list] = {node: [] for node in members}
    for shaft in rotor.shafts:
        for number, (a, b) in enumerate(shaft.pairs):
            if a in steps:
                steps[a].append((b, shaft.length[number]))
                steps[b].append((a, -shaft.length[number]))
    if not any(steps.values()):
        raise BadInput("pin", origin, "a node of the shaft")
    found, waiting = {origin: jnp.zeros(())}, [origin]
    while waiting:
        here = waiting.pop(0)
        for there, step in steps[here]:
            if there not in found:
                found[there] = found[here] + step
                waiting.append(there)
    return found


def main_films(rotor: RotorModel, pin: Node) -> list[tuple[int, Float[Array, ""]]]:
    """Number among the links and [m] z from the plane of the rod of every film under the shaft."""
    place = axial_positions(rotor, pin)
    return [(number, place[node]) for number, node in _film_nodes(rotor, place)]


def _film_nodes(rotor: RotorModel, place) -> Iterator[tuple[int, Any]]:
    """Number among the links and node of the shaft of every film under it."""
    for number, link in enumerate(rotor.links):
        nodes = [node for node in link.nodes if node in place]
        if isinstance(link.law, LoadedFilm) and nodes:
            yield number, nodes[0]


def bearing_positions(rotor: RotorModel, pin: Node) -> dict[str, Float[Array, ""]]:
    """[m] z from the plane of the rod, by name, of the bearings that carry the shaft."""
    found = {}
    for number, z in main_films(rotor, pin):
        bearing = getattr(rotor.links[number].law, "bearing", None)
        if isinstance(bearing, NamedBearing):
            found[bearing.name] = z
    return found


@eqx.filter_jit
def shaft_bearings(rotor: RotorModel, support: MainBearings, pin: Node) -> ShaftBearings:
    """Main bearings that share forces as the shaft of a rotor on their films does, quasi-static.

    The reaction of a spring to a force at any node is, by reciprocity, its stiffness times the deflection
    there under a force on the spring.

    Args:
        rotor: the model; of it the shaft's stiffness counts.
        support: with the position and stiffness of every bearing, by the names of the rotor's links.
        pin: node from which places count.

    Raises:
        BadInput: shaft elements that share a section with those of other shafts.
    """
    place = axial_positions(rotor, pin)
    shafts = tuple(
        s for s in rotor.shafts if any(node in place for pair in s.pairs for node in pair)
    )
    for shaft in shafts:
        if not all(node in place for pair in shaft.pairs for node in pair):
            raise BadInput("rotor.shafts", str(shaft.pairs), "of one shaft each")
    laws: Any = [link.law for link in rotor.links]
    nodes = {laws[number].bearing.name: node for number, node in _film_nodes(rotor, place)}
    held = [nodes[name] for name in support.names or ()]
    assert support.stiffness is not None
    links = tuple(
        Link((node, None), replaced(Mount(jnp.ones(2), jnp.zeros(2)), stiffness=jnp.full(2, k)))
        for node, k in zip(held, support.stiffness, strict=True)
    )
    model = RotorModel(shafts, dof=4, links=links)
    names = node_names(model)
    along = jnp.stack([place[name] for name in names])
    force = jnp.stack([nodal_load(model, node, "ux") for node in held])
    lateral, turned = (
        jnp.stack([nodal_load(model, node, axis) for node in names]) for axis in ("ux", "thy")
    )
    still = jnp.zeros(())
    deflections = (receptance(model, force, out, still, still).real for out in (lateral, turned))
    values, slopes = (support.stiffness[:, None] * found.T for found in deflections)
    order = jnp.argsort(along)
    given = {f.name: getattr(support, f.name) for f in dataclasses.fields(support)}
    made = ShaftBearings(**given)
    return eqx.tree_at(
        lambda b: (b.places, b.values, b.slopes),
        made,
        (along[order], values[:, order], slopes[:, order]),
        is_leaf=lambda leaf: leaf is None,
    )
