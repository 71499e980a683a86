r"""The crankshaft of a machine whose rotor is described: what the crank mechanism sees of it.

Inertia about the axis, mass, unbalance and couple follow from the shaft elements, disks and
unbalances of the rotor; nothing of them is typed twice. In the frame of the crank, x towards the pin
and y 90 degrees ahead of it, an unbalance $U$ at phase $\delta$ on a node $z$ from the plane of the
rod counts as

$$\sum U (\cos\delta, \sin\delta), \qquad \sum U z (\cos\delta, \sin\delta) .$$
"""

import dataclasses
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import is_traced, rebuilt, replaced
from .._core.words import one_of
from ..crankshaft import Crankshaft, MainBearings
from ..crankshaft._bearings import ShaftBearings
from ..crankshaft._crankshaft import OF_ROTOR
from ..film import NamedBearing
from ._links import Link, LoadedFilm, Mount
from ._loads import Unbalances, nodal_load
from ._model import RotorModel, subsets
from ._nodes import node_names
from ._response import receptance
from ._shaft import shaft_mass, shaft_polar_inertia

Node = int | str
_FOLLOWS = "absent: it follows from the rotor that `loads.crank` joins to the crank"


def crankshaft_of(
    rotor: RotorModel, described: Crankshaft, unbalances: Iterable[Unbalances], pins: tuple
) -> Crankshaft:
    """The crankshaft that a rotor is; differentiable in all its numbers.

    Inertia, mass, unbalance and places of rods and bearings are the rotor's; throws, banks and the
    laws of the bearings those that are described. Places along the shaft count from the first pin.

    Args:
        rotor: the model.
        described: the crankshaft without what follows from the rotor.
        unbalances: on its nodes; those on other parts of the model do not turn and are left out.
        pins: node in the plane of the rod of every cylinder.

    Raises:
        BadInput: a number that follows from the rotor, pins that are not one a cylinder or not on the
            shaft, or a bearing that the rotor does not have.
    """
    if len(pins) != described.count:
        bound = f"one node for each of {described.count} cylinders"
        raise BadInput("loads.crank.pin", str(pins), bound)
    _check_free(described)
    inertia, mass, unbalance, couple = _of_shaft(rotor, unbalances, pins[0])
    along = axial_positions(rotor, pins[0])
    crankshaft = replaced(
        described,
        inertia=inertia,
        mass=mass,
        shaft_unbalance=unbalance,
        shaft_couple=couple,
        places=jnp.stack([along[node] for node in pins]),
    )
    support = crankshaft.main_journal
    if not isinstance(support, MainBearings):
        return crankshaft
    stand = bearing_positions(rotor, pins[0])
    if support.position is not None:
        if set(support.names or ()) <= set(stand):
            raise BadInput("crankshaft.main_journal.position", support.position, _FOLLOWS)
        return crankshaft
    places = []
    for name in support.names or ():
        if len(support.bearings) > 1 and name not in stand:
            bound = one_of(name, stand) + ", the bearings of the rotor's links"
            raise BadInput("crankshaft.main_journal.bearings", name, bound)
        places.append(jnp.asarray(stand.get(name, 0.0)))
    support = replaced(support, position=jnp.stack(places))
    # Two bearings share a force by the lever alone, however stiff the shaft is; three do not.
    if support.shaft == "rotor" and len(support.bearings) > 2:
        support = shaft_bearings(rotor, support, pins[0])
    return rebuilt(crankshaft, main_journal=support)


def _check_free(described: Crankshaft) -> None:
    """That nothing is given that follows from the rotor."""
    for name in OF_ROTOR:
        value = getattr(described, name)
        if value is not None and (name == "inertia" or _is_set(value)):
            raise BadInput(f"crankshaft.{name}", value, _FOLLOWS)
    for number, throw in enumerate(described.throws):
        for name in ("position", "rod_pitch", "unbalance"):
            if _is_set(getattr(throw, name)):
                where = f"crankshaft.throws.{number}.{name}"
                raise BadInput(where, getattr(throw, name), _FOLLOWS)


def _is_set(value) -> bool:
    return not is_traced(value) and bool(np.any(np.asarray(value) != 0))


@kept_jit  # one program where a machine is put together, instead of one for each product
def _of_shaft(rotor: RotorModel, unbalances: Iterable[Unbalances], pin: Node):
    """Inertia [kg m^2], mass [kg], unbalance [kg m] (2,) and couple [kg m^2] (2,) of a shaft."""
    place = axial_positions(rotor, pin)
    # Tables may hold elements of the crankcase beside those of the shaft: only what is joined to
    # the pin turns with the crank.
    inertia = mass = jnp.zeros(())

    def turns(nodes):
        return jnp.array([node in place for node in nodes], float)

    for shaft in rotor.shafts:
        turning = turns(first for first, _ in shaft.pairs)
        mass = mass + turning @ shaft_mass(shaft)
        inertia = inertia + turning @ shaft_polar_inertia(shaft)
    for table in (*rotor.disks, *rotor.masses):
        turning = turns(table.nodes)
        mass = mass + turning @ table.mass
        # point masses have no inertia about the axis
        inertia = inertia + turning @ getattr(table, "polar_inertia", jnp.zeros_like(turning))
    unbalance = couple = jnp.zeros(2)
    for table in unbalances:
        turning = turns(table.nodes)
        heights = []
        for node in table.nodes:
            heights.append(jnp.asarray(place.get(node, 0.0), float))
        z = jnp.stack(heights)
        # (2, n) in the frame of the crank: first towards the pin, then 90 degrees ahead of it
        vectors = (
            turning * table.magnitude * jnp.stack([jnp.cos(table.phase), jnp.sin(table.phase)])
        )
        unbalance = unbalance + vectors.sum(-1)
        couple = couple + vectors @ z
    return inertia, mass, unbalance, couple


def axial_positions(rotor: RotorModel, origin: Node) -> dict[Node, Float[Array, ""]]:
    """[m] z of every node of the shaft that carries a node, from that node.

    Raises:
        BadInput: the node is not on a shaft.
    """
    steps = _shaft_steps(rotor, origin)
    if not any(steps.values()):
        raise BadInput("pin", origin, "a node of the shaft")
    positions: dict[Node, Any] = {origin: np.zeros(())}
    waiting = [origin]
    while waiting:
        reached = waiting.pop(0)
        for neighbour, step in steps[reached]:
            # Parallel elements have one length, so that any way to a node will do.
            if neighbour not in positions:
                positions[neighbour] = positions[reached] + step
                waiting.append(neighbour)
    return positions


def _shaft_steps(rotor: RotorModel, origin: Node) -> dict[Node, list]:
    """Neighbours of every node that is joined to a node, with the steps to them; empty off a shaft."""
    steps: dict[Node, list] = {}
    for group in subsets(rotor):
        if origin in group:
            steps = {node: [] for node in group}
    for shaft in rotor.shafts:
        # Concrete lengths are added up by NumPy, where JAX would run a program for every sum.
        length: Any = shaft.length
        if not is_traced(length):
            length = np.asarray(length)
        for number, (a, b) in enumerate(shaft.pairs):
            if a in steps:
                # a step back has the opposite sign: places grow from the first node to the second
                steps[a].append((b, length[number]))
                steps[b].append((a, -length[number]))
    return steps


def main_films(rotor: RotorModel, pin: Node) -> list[tuple[int, Float[Array, ""]]]:
    """Number among the links and [m] z from the plane of the rod of every film under the shaft."""
    place = axial_positions(rotor, pin)
    films = []
    for number, node in _film_nodes(rotor, place):
        films.append((number, place[node]))
    return films


def _film_nodes(rotor: RotorModel, place) -> Iterator[tuple[int, Any]]:
    """Number among the links and node of the shaft of every film under it."""
    for number, link in enumerate(rotor.links):
        nodes = [node for node in link.nodes if node in place]
        if isinstance(link.law, LoadedFilm) and nodes:
            yield number, nodes[0]


def bearing_positions(rotor: RotorModel, pin: Node) -> dict[str, Float[Array, ""]]:
    """[m] z from the plane of the rod, by name, of the bearings that carry the shaft."""
    positions = {}
    for number, z in main_films(rotor, pin):
        bearing = getattr(rotor.links[number].law, "bearing", None)
        if isinstance(bearing, NamedBearing):
            positions[bearing.name] = z
    return positions


@kept_jit
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
    shafts = []
    for shaft in rotor.shafts:
        nodes = set(chain.from_iterable(shaft.pairs))
        if nodes.isdisjoint(place):
            continue
        if not nodes <= place.keys():
            raise BadInput("rotor.shafts", str(shaft.pairs), "of one shaft each")
        shafts.append(shaft)
    nodes = {}
    for number, node in _film_nodes(rotor, place):
        law: Any = rotor.links[number].law
        nodes[law.bearing.name] = node
    held = [nodes[name] for name in support.names or ()]
    assert support.stiffness is not None
    links = []
    for node, k in zip(held, support.stiffness, strict=True):
        mount = replaced(Mount(jnp.ones(2), jnp.zeros(2)), stiffness=jnp.full(2, k))
        links.append(Link((node, None), mount))
    # The shaft alone on springs: disks, masses and the crankcase have no part in how it shares a force.
    model = RotorModel(tuple(shafts), dof=4, links=tuple(links))
    names = node_names(model)
    along = jnp.stack([place[name] for name in names])

    def unit_loads(nodes, axis):
        return jnp.stack([nodal_load(model, node, axis) for node in nodes])

    force = unit_loads(held, "ux")
    lateral = unit_loads(names, "ux")
    angular = unit_loads(names, "thy")
    zero = jnp.zeros(())
    # At frequency zero nothing but stiffness is left of the model.
    deflection = receptance(model, force, lateral, zero, zero).real
    slope = receptance(model, force, angular, zero, zero).real
    values = support.stiffness[:, None] * deflection.T
    slopes = support.stiffness[:, None] * slope.T
    order = jnp.argsort(along)
    fields = {f.name: getattr(support, f.name) for f in dataclasses.fields(support)}
    bearings = ShaftBearings(**fields)
    return eqx.tree_at(
        lambda b: (b.places, b.values, b.slopes),
        bearings,
        (along[order], values[:, order], slopes[:, order]),
        is_leaf=lambda leaf: leaf is None,
    )
