r"""The crankshaft of a machine whose rotor is described: what the crank mechanism sees of it.

Inertia about the axis, mass, unbalance and couple follow from the shaft elements, disks and
unbalances of the rotor; nothing of them is typed twice. In the frame of the crank, x towards the pin
and y 90 degrees ahead of it, an unbalance $U$ at phase $\delta$ on a node $z$ from the plane of the
rod counts as

$$\sum U (\cos\delta, \sin\delta), \qquad \sum U z (\cos\delta, \sin\delta) .$$
"""

from collections.abc import Iterable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._fields import BadInput
from .film import NamedBearing
from .rotor import LoadedFilm, RotorModel, Unbalances, shaft_mass, shaft_polar_inertia, subsets

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
    found = []
    for number, link in enumerate(rotor.links):
        nodes = [node for node in link.nodes if node in place]
        if isinstance(link.law, LoadedFilm) and nodes:
            found.append((number, place[nodes[0]]))
    return found


def bearing_positions(rotor: RotorModel, pin: Node) -> dict[str, Float[Array, ""]]:
    """[m] z from the plane of the rod, by name, of the bearings that carry the shaft."""
    found = {}
    for number, z in main_films(rotor, pin):
        bearing = getattr(rotor.links[number].law, "bearing", None)
        if isinstance(bearing, NamedBearing):
            found[bearing.name] = z
    return found
