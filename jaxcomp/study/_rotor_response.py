r"""The vibration of a rotor by its crank, solved anew or known beforehand.

The response of a rotor is linear in the loads. Where only loads and correction masses change, the finite
elements need not be solved again: `known_response` keeps what a unit of load on each loaded node does,
and a design costs the product of that with its own loads.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from .._core.errors import BadInput
from ..machine import Assembly, Machine, assembled
from ..rotor import (
    AXES,
    BalancingPlanes,
    harmonic_response,
    node_index,
    respond,
    transmitted_forces,
)
from ..rotor._loads import load_vector
from ..rotor._nodes import node_names
from ..vibration import crank_loads, running_rotor
from ..vibration._coupling import CrankLoads
from ._analysis_options import AnalysisOptions, KnownResponse, Reading


class Vibration(NamedTuple):
    """Harmonic response at the balancing planes' speeds.

    Attributes:
        targets: [m], [rad] (speeds, orders, rows) complex amplitudes; the rows are the targets and
            their axes in the order of the scene.
        mount_force: [N] (speeds, orders) largest lateral force, over the revolution, that the links to
            the ground pass on, each link added in amplitude.
        ok: (speeds,) whether the periodic state and the responses can be relied on.
    """

    targets: Complex[Array, "speeds orders rows"]
    mount_force: Float[Array, "speeds orders"]
    ok: Bool[Array, " speeds"]


def by_crank(machine: Assembly, options: AnalysisOptions) -> bool:
    """Whether the crank shakes the rotor, and not the forces of the scene.

    Raises:
        BadInput: no rotor, or no loads.
    """
    if machine.rotor is None or machine.loads is None:
        raise BadInput("rotor", "absent", "given with loads and balancing planes")
    return machine.excitation(options.excitation) == "crank"


def all_crank_loads(
    machine: Assembly, options: AnalysisOptions, orders: tuple[int, ...]
) -> CrankLoads:
    """Loads of the crank on the rotor at the speeds of the balancing planes, along a leading axis.

    Raises:
        BadInput: no rotor, loads or balancing planes.
    """
    crank = by_crank(machine, options)

    def at(speed):
        left_out = options.left_out
        return crank_loads(machine, speed, orders, options.solver, crank=crank, left_out=left_out)

    return jax.vmap(at)(places_of(machine).speeds)


def places_of(machine: Assembly) -> BalancingPlanes:
    """Correction planes and targets of a machine; raises `BadInput` where it has none."""
    if machine.balancing is None:
        raise BadInput("balancing", "absent", "given: the planes and targets of this machine")
    return machine.balancing


def vibration_of(machine: Assembly, crank: CrankLoads, orders: tuple[int, ...]) -> Vibration:
    """The vibration of a machine with its correction masses, under `all_crank_loads`."""
    places = places_of(machine)

    def at(crank_at_speed: CrankLoads, speed):
        model, loads = running_rotor(machine, crank_at_speed)
        response = respond(model, loads, speed[None], orders)
        read = jax.tree.map(lambda a: a[:, 0], _read(model, places, response))
        return read, crank_at_speed.ok & jnp.all(response.ok)

    return _vibration(*jax.vmap(at)(crank, places.speeds))


def known_vibration(
    machine: Assembly, options: AnalysisOptions, unit_response: KnownResponse
) -> Vibration:
    """Vibration of a machine whose rotor and fixed forces are those of `known_response`."""
    loads = machine.given_loads
    if by_crank(machine, options):
        loads = machine.unbalances

    def at(speed):
        forces = [load_vector(machine.rotor, loads, n, speed) for n in options.orders]
        return jnp.stack([force[np.array(unit_response.nodes)] for force in forces])

    # Letters: speed, order, node and its direction d, row of a target, link and its axis a.
    force = jax.vmap(at)(places_of(machine).speeds)
    read = Reading(
        unit_response.fixed.targets
        + jnp.einsum("sondr,sond->sor", unit_response.unit.targets, force),
        unit_response.fixed.mounts
        + jnp.einsum("sondla,sond->sola", unit_response.unit.mounts, force),
    )
    return _vibration(read, unit_response.ok)


def _vibration(read: Reading, ok) -> Vibration:
    x, y = read.mounts[..., 0], read.mounts[..., 1]
    # the largest length over the revolution of the real vector with these complex amplitudes
    largest = (jnp.abs(x + 1j * y) + jnp.abs(x - 1j * y)) / 2
    return Vibration(read.targets, jnp.sum(largest, -1), ok)


@eqx.filter_jit
def known_response(design: Machine, options: AnalysisOptions) -> KnownResponse:
    """Response of the rotor of a design to unit loads, on all nodes whose loads may change.

    With the crank's own forces these stay as they are while corrections and unbalances change: what
    these do to the motion of the crank, through the friction of its bearings, is left out.
    """
    machine = assembled(design)
    places = places_of(machine)
    case = machine.loads
    rotor = machine.rotor
    crank_shakes = by_crank(machine, options)
    orders = options.orders
    assert case is not None
    assert rotor is not None
    names = [plane.node for plane in places.planes]
    for table in case.unbalances:
        names += table.nodes
    forces = case.forces
    if crank_shakes:
        forces = ()
    for force in forces:
        for name in (force.node, force.reaction):
            if name is not None:
                names.append(name)
    nodes = tuple(sorted({node_index(rotor, name) for name in names}))
    units = np.zeros((len(nodes), rotor.dof, len(node_names(rotor)), rotor.dof))
    for row, node in enumerate(nodes):
        units[row, :, node] = np.eye(rotor.dof)

    def at(crank: CrankLoads, speed):
        loaded, _ = running_rotor(machine, crank)
        ok = crank.ok

        def of_order(n):
            answer = jax.vmap(jax.vmap(lambda f: harmonic_response(loaded, f, speed, n * speed)))
            return answer(jnp.asarray(units, complex))

        answers = [of_order(n) for n in orders]
        reads = [_read(loaded, places, answer) for answer in answers]
        unit = jax.tree.map(lambda *a: jnp.stack(a), *reads)
        ok &= jnp.all(jnp.stack([answer.ok for answer in answers]))
        if not crank_shakes:  # all forces are loads that may change
            return unit, jax.tree.map(lambda a: jnp.zeros_like(a[:, 0, 0]), unit), ok
        response = respond(loaded, crank.forces, speed[None], orders)
        fixed = jax.tree.map(lambda a: a[:, 0], _read(loaded, places, response))
        return unit, fixed, ok & jnp.all(response.ok)

    unit, fixed, ok = jax.vmap(at)(all_crank_loads(machine, options, orders), places.speeds)
    return KnownResponse(unit, fixed, ok, nodes)


def _read(model, places, response) -> Reading:
    rows = []
    for target in places.targets:
        x = response.displacement[..., node_index(model, target.node), :]
        if target.relative_to is not None:
            x = x - response.displacement[..., node_index(model, target.relative_to), :]
        for axis in target.axes:
            rows.append(x[..., AXES[model.dof].index(axis)])
    grounded = np.flatnonzero([None in link.nodes for link in model.links])
    force = transmitted_forces(model, response)[..., grounded, :2]
    return Reading(jnp.stack(rows, -1), force)
