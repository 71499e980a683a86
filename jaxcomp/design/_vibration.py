r"""Vibration of a design at its targets and the forces into its mounts, at the balancing speeds.

The response is linear in the loads. Where only loads and correction masses change, the finite elements
need not be solved again: `known_response` keeps what a unit of load on each loaded node does, and a
design costs the product of that with its own loads.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from .._fields import BadInput
from ..balancing import crank_case
from ..crank import Collocation, Shooting
from ..rotor import (
    AXES,
    BalancingPlanes,
    LoadCase,
    RotorModel,
    Unbalances,
    harmonic_response,
    load_vector,
    node_index,
    node_names,
    respond,
    transmitted_forces,
)
from ._design import Design


class Vibration(NamedTuple):
    """Harmonic response at the balancing planes' speeds.

    Attributes:
        targets: [m], [rad] (speeds, orders, rows) complex amplitudes; the rows are the targets and
            their axes in the order of the scene.
        mount_force: [N] (speeds, orders) largest lateral force, over the turn, that the links to the
            ground pass on, each link added in amplitude.
        ok: (speeds,) whether the periodic state and the responses can be relied on.
    """

    targets: Complex[Array, "speeds orders rows"]
    mount_force: Float[Array, "speeds orders"]
    ok: Bool[Array, " speeds"]


class Read(NamedTuple):
    """What is read off a response, linear in it.

    Attributes:
        targets: [m], [rad] (*batch, rows)
        mounts: [N] (*batch, links, 2) lateral forces of the links to the ground.
    """

    targets: Complex[Array, "*batch rows"]
    mounts: Complex[Array, "*batch links 2"]


class KnownResponse(eqx.Module):
    """What loads do to a rotor that itself does not change.

    Attributes:
        unit: `Read` with the batch (speeds, orders, nodes, dof), of one newton (newton metre) each.
        fixed: `Read` with the batch (speeds, orders), of the forces that do not change either.
        ok: (speeds,)
        nodes: numbers of the nodes that are loaded; static.
    """

    unit: Read
    fixed: Read
    ok: Bool[Array, " speeds"]
    nodes: tuple[int, ...] = eqx.field(static=True)


class Rotor(NamedTuple):
    """The parts of a scene that vibrate."""

    model: RotorModel
    case: LoadCase
    places: BalancingPlanes


class Shaken(NamedTuple):
    """What shakes the rotor, see `Chain`."""

    by_crank: bool
    solver: Collocation | Shooting | None
    orders: tuple[int, ...]
    left_out: tuple[str, ...]


def rotor_of(design: Design) -> Rotor:
    """The rotor of a design with its loads and planes.

    Raises:
        BadInput: one of them is missing.
    """
    parts: Any = design.parts
    try:
        return Rotor(parts["rotor"], parts["loads"], parts["balancing"])
    except KeyError:
        raise BadInput(
            "rotor", "without", "a scene with rotor, loads and balancing planes"
        ) from None


def vibration_of(design: Design, shaken: Shaken, known: KnownResponse | None) -> Vibration:
    """The vibration of a design with its correction masses.

    Args:
        design: the design.
        shaken: by what.
        known: for a design whose rotor and fixed forces are those of `known_response`.
    """
    rotor = rotor_of(design)
    added = tuple(
        _unbalance(plane.node, design.corrections[plane.name]) for plane in rotor.places.planes
    )
    if known is None:
        read, ok = _solved(design, rotor, shaken, added)
    else:
        loads = (*rotor.case.unbalances, *added)
        loads += () if shaken.by_crank else rotor.case.forces
        read, ok = _superposed(known, rotor, loads, shaken.orders), known.ok
    into = jnp.sum(_major_axis(read.mounts[..., 0], read.mounts[..., 1]), -1)
    return Vibration(read.targets, into, ok)


@eqx.filter_jit
def known_response(design: Design, shaken: Shaken) -> KnownResponse:
    """What unit loads do to the rotor of a design, on all nodes whose loads may change."""
    rotor = rotor_of(design)
    model, case, places = rotor
    names = [node for table in case.unbalances for node in table.nodes]
    names += [plane.node for plane in places.planes]
    if not shaken.by_crank:
        names += [node for f in case.forces for node in (f.node, f.reaction) if node is not None]
    nodes = tuple(sorted({node_index(model, name) for name in names}))
    units = np.zeros((len(nodes), model.dof, len(node_names(model)), model.dof))
    for row, node in enumerate(nodes):
        units[row, :, node] = np.eye(model.dof)
    bare = eqx.tree_at(lambda d: d.parts["loads"].unbalances, design, ())

    def at(speed):
        loaded, forces, ok = _loads(bare, Rotor(model, bare.parts["loads"], places), shaken, speed)

        def of_order(n):
            answer = jax.vmap(jax.vmap(lambda f: harmonic_response(loaded, f, speed, n * speed)))
            return answer(jnp.asarray(units, complex))

        answers = [of_order(n) for n in shaken.orders]
        reads = [_read(loaded, places, answer) for answer in answers]
        unit = jax.tree.map(lambda *a: jnp.stack(a), *reads)
        ok &= jnp.all(jnp.stack([answer.ok for answer in answers]))
        if not shaken.by_crank:  # all forces are loads that may change
            return unit, jax.tree.map(lambda a: jnp.zeros_like(a[:, 0, 0]), unit), ok
        response = respond(loaded, forces, speed[None], shaken.orders)
        fixed = jax.tree.map(lambda a: a[:, 0], _read(loaded, places, response))
        return unit, fixed, ok & jnp.all(response.ok)

    unit, fixed, ok = jax.vmap(at)(places.speeds)
    return KnownResponse(unit, fixed, ok, nodes)


def _solved(design, rotor, shaken, added) -> tuple[Read, Bool[Array, " speeds"]]:
    def at(speed):
        loaded, loads, ok = _loads(design, rotor, shaken, speed)
        response = respond(loaded, (*loads, *added), speed[None], shaken.orders)
        read = jax.tree.map(lambda a: a[:, 0], _read(loaded, rotor.places, response))
        return read, ok & jnp.all(response.ok)

    return jax.vmap(at)(rotor.places.speeds)


def _superposed(known, rotor, loads, orders) -> Read:
    def at(speed):
        forces = [load_vector(rotor.model, loads, n, speed) for n in orders]
        return jnp.stack([force[np.array(known.nodes)] for force in forces])

    force = jax.vmap(at)(rotor.places.speeds)
    return Read(
        known.fixed.targets + jnp.einsum("sondr,sond->sor", known.unit.targets, force),
        known.fixed.mounts + jnp.einsum("sondla,sond->sola", known.unit.mounts, force),
    )


def _loads(design, rotor, shaken, speed):
    if not shaken.by_crank:
        return rotor.model, rotor.case.loads, jnp.asarray(True)
    return crank_case(
        design.compressor,
        rotor.model,
        rotor.case,
        speed,
        shaken.orders,
        shaken.solver,
        shaken.left_out,
    )


def _read(model, places, response) -> Read:
    rows = []
    for target in places.targets:
        x = response.displacement[..., node_index(model, target.node), :]
        if target.relative_to is not None:
            x = x - response.displacement[..., node_index(model, target.relative_to), :]
        rows += [x[..., AXES[model.dof].index(axis)] for axis in target.axes]
    grounded = np.flatnonzero([None in link.nodes for link in model.links])
    force = transmitted_forces(model, response)[..., grounded, :2]
    return Read(jnp.stack(rows, -1), force)


def _unbalance(node, value) -> Unbalances:
    # two signed unbalances along x and y: smooth at zero, where magnitude and phase are not
    two = Unbalances((node, node), jnp.zeros(2), jnp.array([0.0, jnp.pi / 2]))
    return eqx.tree_at(lambda u: u.magnitude, two, value)


def _major_axis(x, y):
    """Largest length over the turn of the real vector with the complex amplitudes x and y."""
    forward, backward = jnp.abs(x + 1j * y), jnp.abs(x - 1j * y)
    return (forward + backward) / 2
