r"""The analysis of one design: its options, and results that are computed on first access.

The response of a rotor is linear in the loads. Where only loads and correction masses change, the finite
elements need not be solved again: `known_response` keeps what a unit of load on each loaded node does,
and a design costs the product of that with its own loads.
"""

from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from .._core.errors import BadInput
from .._core.fields import admissible
from .._core.registry import Quantity, registered, registered_quantity
from .._core.words import one_of
from ..balancing import Influence, flexibilities, influence_of, least_squares
from ..compressor import Compressor
from ..crank import (
    Collocation,
    JournalFilm,
    Orbit,
    Performance,
    journal_films,
    performance,
    solve_orbit,
    time_harmonics,
)
from ..cylinder.interface import may_lack_panels
from ..friction import magnitude
from ..machine import Assembly, Machine, assembled
from ..rotor import (
    AXES,
    BalancingPlanes,
    harmonic_response,
    load_vector,
    node_index,
    node_names,
    respond,
    transmitted_forces,
)
from ..vibration import CrankLoads, Wrench, crank_loads, running_rotor, shaking_wrench

if TYPE_CHECKING:
    from ..crank import Shooting

SHAKING_ORDERS = (1, 2, 3, 4, 6)  # of the revolution, which shaking forces and couples are told of


class AnalysisOptions(eqx.Module):
    """Options of the analysis of a design; they are fixed while numbers change.

    Attributes:
        solver: of the periodic state. Absent: collocation, with a panel edge for each load reversal
            (`jaxcomp.crank.default_collocation`) but where only the forces on the rotor are wanted, see
            `jaxcomp.vibration.crank_loads`.
        excitation: what shakes the rotor: "crank" (the periodic state at each speed, whose mean
            force loads the films as well) or "file" (the forces of the scene). Absent: the forces of
            the scene if it has any, otherwise the crank.
        orders: orders of the spin speed that count in vibrations and mount forces.
        left_out: what the crank's forces on the rotor do without, see `jaxcomp.balancing.without`.
        known: response of a rotor that does not change to unit loads; see `prepared`.

    Raises:
        BadInput: another excitation, or an order below one.
    """

    solver: "Collocation | Shooting | None" = None
    excitation: Literal["crank", "file"] | None = eqx.field(static=True, default=None)
    orders: tuple[int, ...] = eqx.field(static=True, default=(1,))
    left_out: tuple[str, ...] = eqx.field(static=True, default=())
    known: "KnownResponse | None" = None

    def __check_init__(self):
        if self.excitation not in ("crank", "file", None):
            raise BadInput("excitation", str(self.excitation), "'crank' or 'file'")
        if not self.orders or min(self.orders) < 1:
            raise BadInput("orders", str(self.orders), "whole numbers from 1")


def given_options(options: Any) -> AnalysisOptions:
    """The options of an analysis, the usual ones if absent.

    Raises:
        BadInput: something else.
    """
    if isinstance(options, AnalysisOptions | None):
        return options or AnalysisOptions()
    raise BadInput("options", f"a {type(options).__name__}", "`AnalysisOptions(...)`")


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
    """What the crank does to the rotor at the speeds of the balancing planes, along a leading axis.

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

    def at(one: CrankLoads, speed):
        model, loads = running_rotor(machine, one)
        response = respond(model, loads, speed[None], orders)
        read = jax.tree.map(lambda a: a[:, 0], _read(model, places, response))
        return read, one.ok & jnp.all(response.ok)

    return _vibration(*jax.vmap(at)(crank, places.speeds))


def known_vibration(machine: Assembly, options: AnalysisOptions, known: KnownResponse) -> Vibration:
    """The same for a machine whose rotor and fixed forces are those of `known_response`."""
    loads = machine.unbalances if by_crank(machine, options) else machine.given_loads

    def at(speed):
        forces = [load_vector(machine.rotor, loads, n, speed) for n in options.orders]
        return jnp.stack([force[np.array(known.nodes)] for force in forces])

    force = jax.vmap(at)(places_of(machine).speeds)
    read = Read(
        known.fixed.targets + jnp.einsum("sondr,sond->sor", known.unit.targets, force),
        known.fixed.mounts + jnp.einsum("sondla,sond->sola", known.unit.mounts, force),
    )
    return _vibration(read, known.ok)


def _vibration(read: Read, ok) -> Vibration:
    x, y = read.mounts[..., 0], read.mounts[..., 1]
    # the largest length over the revolution of the real vector with these complex amplitudes
    largest = (jnp.abs(x + 1j * y) + jnp.abs(x - 1j * y)) / 2
    return Vibration(read.targets, jnp.sum(largest, -1), ok)


@eqx.filter_jit
def known_response(design: Machine, options: AnalysisOptions) -> KnownResponse:
    """What unit loads do to the rotor of a design, on all nodes whose loads may change.

    With the crank's own forces these stay as they are while corrections and unbalances change: what
    these do to the motion of the crank, through the friction of its bearings, is left out.
    """
    machine = assembled(design)
    places, case, rotor = places_of(machine), machine.loads, machine.rotor
    crank_shakes, orders = by_crank(machine, options), options.orders
    assert case is not None
    assert rotor is not None
    names = [node for table in case.unbalances for node in table.nodes]
    names += [plane.node for plane in places.planes]
    if not crank_shakes:
        names += [node for f in case.forces for node in (f.node, f.reaction) if node is not None]
    nodes = tuple(sorted({node_index(rotor, name) for name in names}))
    units = np.zeros((len(nodes), rotor.dof, len(node_names(rotor)), rotor.dof))
    for row, node in enumerate(nodes):
        units[row, :, node] = np.eye(rotor.dof)

    def at(crank: CrankLoads, speed):
        (loaded, _), ok = running_rotor(machine, crank), crank.ok

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


class DesignResult:
    """Results of one design, computed on first access.

    A function `f(result) -> number` serves as a quantity of a `Problem` beside the named ones.

    Attributes:
        design: the design.
        options: of the analysis.
    """

    def __init__(self, design: Machine, options: AnalysisOptions):
        self.design, self.options = design, options

    @cached_property
    def assembly(self) -> Assembly:
        """The machine put together: laws, crankshaft, films, corrections."""
        return assembled(self.design)

    @property
    def _compressor(self) -> Compressor:
        if self.assembly.compressor is None:
            raise BadInput("compressor", "absent", "given, for a quantity of the crank")
        return self.assembly.compressor

    @cached_property
    def orbit(self) -> Orbit:
        """The periodic state of the crank at the motor of the design.

        Raises:
            BadInput: a scene without a compressor.
        """
        return solve_orbit(self._compressor, self.options.solver, throw=False)

    @cached_property
    def performance(self) -> Performance:
        """Capacity, efficiencies and powers of a compressor with valves."""
        return performance(self._compressor, self.orbit)

    @cached_property
    def wrench(self) -> Wrench:
        """Shaking force and moment over the revolution."""
        return shaking_wrench(self._compressor, self.orbit.state)

    @cached_property
    def crank_loads(self) -> CrankLoads:
        """What the crank does to the rotor at the balancing speeds; it is solved once at each."""
        orders = tuple(dict.fromkeys((*self.options.orders, 1)))
        return all_crank_loads(self.assembly, self.options, orders)

    @cached_property
    def vibration(self) -> Vibration:
        """Harmonic response of the rotor at the speeds of its balancing planes."""
        if self.options.known is not None:
            return known_vibration(self.assembly, self.options, self.options.known)
        return vibration_of(self.assembly, self.crank_loads, self.options.orders)

    @cached_property
    def influence(self) -> Influence:
        """Influence coefficients at order 1, with the vibration as the corrections stand."""
        places = places_of(self.assembly)
        answer = flexibilities(self.assembly, self.crank_loads, places, places.speeds)
        return influence_of(answer, places, places.speeds)

    @property
    def ok(self) -> Bool[Array, ""]:
        """Whether all that was computed so far can be relied on."""
        good = jnp.asarray(True)
        if self.design.compressor is not None:
            good &= admissible(self.design.compressor)
        for part in self.design.parts.values():
            good &= admissible(part)
        if "orbit" in self.__dict__:
            good &= self.orbit.converged
        if "vibration" in self.__dict__:
            good &= jnp.all(self.vibration.ok)
        if "influence" in self.__dict__:
            good &= jnp.all(jnp.isfinite(self.influence.initial))
        return good

    @property
    def short(self) -> Bool[Array, ""]:
        """Whether the cycle may have too few panels for what its valves do."""
        if "orbit" not in self.__dict__ or self.orbit.cycle is None:
            return jnp.asarray(False)
        return may_lack_panels(self.orbit.cycle.status)

    @cached_property
    def journals(self) -> dict[str, JournalFilm]:
        """The oil films of the journals over the revolution."""
        return journal_films(self._compressor, self.orbit)

    @property
    def least_film(self) -> Float[Array, ""]:
        """[m] Smallest of all journals over the revolution."""
        films = [film.minimum_film for film in self.journals.values()]
        return jnp.min(jnp.stack(films)) if films else jnp.asarray(jnp.inf)

    @property
    def peak_shaking_force(self) -> Float[Array, ""]:
        """[N] Largest over the revolution."""
        return self._largest(self.wrench.force)

    @property
    def peak_shaking_moment(self) -> Float[Array, ""]:
        """[N m] Largest over the revolution."""
        return self._largest(self.wrench.moment)

    @property
    def shaking_force(self) -> dict[str, Float[Array, ""]]:
        """[N] Amplitude by order of the revolution, along the long axis of the ellipse that it runs."""
        return self._by_order(self.wrench.force)

    @property
    def shaking_couple(self) -> dict[str, Float[Array, ""]]:
        """[N m] The same of the moment across the shaft."""
        return self._by_order(self.wrench.moment)

    def _by_order(self, vectors: Float[Array, "3 n"]) -> dict[str, Float[Array, ""]]:
        orbit = self.orbit
        duration = orbit.weight / orbit.state.speed
        (x, y), _ = time_harmonics(vectors[:2], orbit.time, duration, max(SHAKING_ORDERS))
        # the parts that turn with the crank and against it add up along the long axis
        turning = jnp.stack([x + 1j * y, x - 1j * y]) / 2
        size = jnp.sum(magnitude(turning.real, turning.imag), axis=0)
        return {str(order): size[order - 1] for order in SHAKING_ORDERS}

    @property
    def vibration_of_all(self) -> Float[Array, ""]:
        """[m] Weighted root mean square amplitude of all targets."""
        return self._root_mean_square()

    @property
    def vibration_of_targets(self) -> dict[str, Float[Array, ""]]:
        """[m] Root mean square amplitude by target."""
        names = np.array([t.name for t in places_of(self.assembly).targets for _ in t.axes])
        rows = {name: np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist())}
        return {name: self._root_mean_square(place) for name, place in rows.items()}

    @property
    def balanced_vibration(self) -> Float[Array, ""]:
        """[m] `vibration_of_all` at order 1 after the least-squares correction of this design."""
        influence = self.influence
        left = influence.weight * influence.vibration(least_squares(influence).correction)
        return jnp.sqrt(jnp.sum(jnp.abs(left) ** 2) / jnp.sum(influence.weight**2))

    @property
    def mount_force(self) -> Float[Array, ""]:
        """[N] Root mean square, over the speeds, of the lateral force into the ground."""
        return jnp.sqrt(jnp.mean(jnp.sum(self.vibration.mount_force**2, -1)))

    @property
    def weights(self) -> Float[Array, " rows"]:
        """[-] of the rows of `vibration.targets`."""
        places = places_of(self.assembly)
        return jnp.stack([jnp.asarray(t.weight) for t in places.targets for _ in t.axes])

    def _largest(self, vector) -> Float[Array, ""]:
        return jnp.sqrt(self.orbit.largest(jnp.sum(vector**2, axis=0)))

    def _root_mean_square(self, rows=slice(None)) -> Float[Array, ""]:
        amplitude, weight = self.vibration.targets[..., rows], self.weights[rows]
        square = jnp.sum((weight * jnp.abs(amplitude)) ** 2)
        return jnp.sqrt(square / (amplitude.shape[0] * jnp.sum(weight**2)))


def balanced_design(design: Machine, options: AnalysisOptions) -> Machine:
    """The design with the corrections in all planes that least squares at order 1 ask for.

    Args:
        design: a machine with a rotor and correction planes.
        options: of the analysis whose vibration is balanced.
    """
    bare = eqx.tree_at(
        lambda d: d.corrections, design, {name: jnp.zeros(2) for name in design.corrections}
    )
    influence = DesignResult(bare, options).influence
    correction = least_squares(influence).correction
    both = jnp.stack([correction.real, correction.imag], -1)
    return eqx.tree_at(
        lambda d: d.corrections, design, dict(zip(influence.planes, both, strict=True))
    )


def quantity_named(name: str) -> Quantity:
    """A quantity by name, see `available_quantities`.

    Raises:
        BadInput: no such quantity.
    """
    found = registered_quantity(name)
    if found is None or "<" in name:
        names = [one.name for one in registered()]
        raise BadInput("quantity", name, one_of(name, names))
    return found


def available_quantities(design: Machine, members: bool = False) -> dict[str, Quantity]:
    """The quantities that a design has, by name.

    Args:
        design: the machine.
        members: list every joint and target by itself; families as `loss_power.<joint>` otherwise.
    """
    known = {one.name: one for one in registered() if not one.missing(design)}
    if not members:
        return known
    traced = [one for one in known.values() if one.family and one.members is None]

    def values(design):
        found = DesignResult(design, AnalysisOptions(Collocation(reversals=0)))
        return {one.name: one.value(found) for one in traced}

    found = eqx.filter_eval_shape(values, design) if traced else {}
    out = {}
    for one in known.values():
        names = one.members(design) if one.members else found.get(one.name, ())
        out |= {f"{one.family}.{n}": quantity_named(f"{one.family}.{n}") for n in names}
        out |= {} if one.family else {one.name: one}
    return out
