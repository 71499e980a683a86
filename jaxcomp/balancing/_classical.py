r"""Balancing of the rotor alone, as a balancing machine does it: two planes, a rigid rotor.

The baseline that a balance of the whole machine has to beat. Grades: ISO 21940-11 (formerly
ISO 1940-1).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from .._core.errors import BadInput
from .._core.extremes import clip
from ..machine import Assembly, HasMachine, Machine, assembly_of
from ..mechanism import SliderCrank
from ..rotor import BalancingPlanes, RotorModel, Unbalances
from ..rotor._model import node_positions, subset_names, subsets
from ..rotor._shaft import Node, shaft_mass
from ._balance import Balance
from ._influence import Influence
from ._least_squares import predicted


class PlanePair(NamedTuple):
    """Corrections of the rigid rotor.

    Attributes:
        correction: [kg m] (2,) to add in the planes.
        permissible: [kg m] (2,) what each plane may keep in the grade.
    """

    correction: Complex[Array, "2"]
    permissible: Float[Array, "2"]


def permissible_unbalance(
    grade: Float[Array, ""] | float,
    mass: Float[Array, ""] | float,
    speed: Float[Array, ""] | float,
) -> Float[Array, ""]:
    """[kg m] Residual unbalance of a rotor in a grade of ISO 21940-11: U = G m / W.

    Args:
        grade: [mm/s] number of the grade, 6.3 for G6.3.
        mass: [kg] of the rotor.
        speed: [rad/s] of service.
    """
    return jnp.asarray(grade) * 1e-3 * mass / speed


def rigid_balance(
    unbalances: Sequence[Unbalances],
    places: Mapping[Node, Float[Array, ""] | float],
    planes: tuple[Node, Node],
    *,
    centre: Float[Array, ""] | float,
    mass: Float[Array, ""] | float,
    speed: Float[Array, ""] | float,
    grade: Float[Array, ""] | float = 6.3,
) -> PlanePair:
    """Corrections in two planes that take away the sum and the couple of all unbalances.

    A rigid rotor is balanced at every speed alike, so that the speed of the balancing machine does
    not matter as long as it is far below the first bending critical.

    Args:
        unbalances: of the rotor.
        places: [m] z of every node.
        planes: nodes of the correction planes.
        centre: [m] z of the mass centre; shares the permissible unbalance between the planes.
        mass: [kg] of the rotor.
        speed: [rad/s] of service.
        grade: [mm/s] of ISO 21940-11.

    Raises:
        BadInput: both planes at one place.
    """
    first = jnp.asarray(places[planes[0]], float)
    second = jnp.asarray(places[planes[1]], float)
    if planes[0] == planes[1]:
        raise BadInput("planes", str(planes), "two different nodes")
    # x + iy in the frame that turns with the rotor, for the sum and for the couple
    total = jnp.zeros((), complex)
    couple = jnp.zeros((), complex)
    for table in unbalances:
        vectors = table.magnitude * jnp.exp(1j * table.phase)
        heights = []
        for node in table.nodes:
            heights.append(jnp.asarray(places[node], float))
        z = jnp.stack(heights)
        total = total + jnp.sum(vectors)
        couple = couple + jnp.sum(vectors * (z - first))
    # Moments about the first plane, about which its own correction has none.
    far = -couple / (second - first)
    allowed = permissible_unbalance(grade, mass, speed)
    share = clip((second - centre) / (second - first), 0.3, 0.7)  # 30 to 70 % by the standard
    return PlanePair(jnp.stack([-total - far, far]), allowed * jnp.stack([share, 1 - share]))


def rod_ring(machine: Assembly) -> Unbalances | None:
    r"""The ring that stands on the crank pin for the rotating part of the rod, $m_c r (l - b)/l$.

    A balancing machine turns the rotor without rod and piston. Levecque et al. (2011), cited in full in
    `machines/hermetic-68cc.toml`, put a ring in their place (Section 1) "whose mass is equivalent to the
    rotating masses"; crank pin and arms are on the rotor, so that what it lacks is the rod's share at the
    big end ($m_{ro}$ of Section 3.3).

    Args:
        machine: put together.

    Returns:
        `None` for a machine without a rod whose plane on the rotor is known (`loads.crank`).
    """
    mechanism = getattr(machine.compressor, "mechanism", None)
    crank = None
    if machine.loads is not None:
        crank = machine.loads.crank
    if machine.compressor is None or not isinstance(mechanism, SliderCrank) or crank is None:
        return None
    big_end = 1 - mechanism.conrod_centre / mechanism.conrod_length
    moment = mechanism.conrod_mass * mechanism.crank_radius * big_end
    pins = crank.pins
    crankshaft = machine.compressor.crankshaft
    rings = Unbalances(pins, 0.0, 0.0)
    values = (jnp.broadcast_to(moment, (len(pins),)), crankshaft.throw_angle)
    return eqx.tree_at(lambda u: (u.magnitude, u.phase), rings, values)


def classical_balance(
    model: RotorModel,
    unbalances: Sequence[Unbalances],
    places: BalancingPlanes,
    *,
    speed: Float[Array, ""] | float,
    grade: Float[Array, ""] | float = 6.3,
    ring: Unbalances | None = None,
) -> PlanePair:
    """`rigid_balance` of the rotor of a model, taken out of its crankcase and housing.

    Args:
        model: its numbers have to be concrete.
        unbalances: of the rotor.
        places: with two correction planes.
        speed: [rad/s] of service.
        grade: [mm/s] of ISO 21940-11; the ring does not count in the mass of the rotor.
        ring: on the rotor while it is balanced, see `rod_ring`; the rotor by itself if absent.

    Raises:
        BadInput: another number of planes than two, or no part that spins.
    """
    if len(places.planes) != 2:
        raise BadInput("planes", len(places.planes), "two, for the balance of the rotor alone")
    names = subset_names(model)
    if "rotor" not in names:
        raise BadInput("rotor", str(names), "a model with a shaft that spins")
    rotor_nodes = set(subsets(model)[names.index("rotor")])
    positions = node_positions(model)
    # only what spins: crankcase and housing are not on the balancing machine
    z = {node: float(positions[node][2]) for node in positions.keys() & rotor_nodes}
    mass = 0.0
    moment = 0.0
    for shaft in model.shafts:
        for (a, b), element in zip(shaft.pairs, shaft_mass(shaft), strict=True):
            if a in rotor_nodes:
                # A cone counts at its middle too: only shares of the permissible unbalance hang on
                # the centre.
                mass = mass + element
                moment = moment + element * (z[a] + z[b]) / 2
    for table in (*model.disks, *model.masses):
        for node, element in zip(table.nodes, table.mass, strict=True):
            if node in rotor_nodes:
                mass = mass + element
                moment = moment + element * z[node]
    if ring is not None:
        unbalances = (*unbalances, ring)
    first, second = places.planes
    return rigid_balance(
        unbalances,
        z,
        (first.node, second.node),
        centre=moment / mass,
        mass=mass,
        speed=speed,
        grade=grade,
    )


def balance_rotor_alone(
    influence: Influence,
    machine: Machine | HasMachine,
    *,
    speed: Float[Array, ""] | float | None = None,
    crank: bool = True,
    left_out: tuple[str, ...] = (),
) -> Balance:
    """Vibration of the whole machine that is left by the balance of the rotor alone in two planes.

    Where the forces of the crank act with the inertia of its parts, the rotor carries a ring for the rod
    (`rod_ring`) while it is balanced.

    Args:
        influence: the system of the machine.
        machine: a scene or a machine with rotor, loads and two correction planes.
        speed: [rad/s] of service; the highest of the system if absent.
        crank: whether the forces of the crank shake the system; those of a file have no inertia of a rod.
        left_out: what the crank's forces do without, as in `machine_influence`.

    Raises:
        BadInput: a part that is missing, or as `classical_balance`.
    """
    assembly = assembly_of(machine)
    if assembly.rotor is None or assembly.loads is None or assembly.balancing is None:
        raise BadInput("balancing", "absent", "given with rotor, loads and correction planes")
    if speed is None:
        speed = max(row.speed for row in influence.rows)
    ring = None
    # without the inertia of the crank there is no rod for which a ring could stand
    if crank and "inertia" not in left_out:
        ring = rod_ring(assembly)
    alone = classical_balance(
        assembly.rotor, assembly.loads.unbalances, assembly.balancing, speed=speed, ring=ring
    )
    name = "rotor alone"
    if ring is not None:
        name = "rotor with a ring for the rod"
    return predicted(influence, alone.correction, f"{name}, two planes")
