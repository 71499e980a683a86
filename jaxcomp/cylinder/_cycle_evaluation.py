"""The cycle of what march and Newton's method found: in SI units, with its status and its derivatives."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .._core.extremes import clip
from .._core.polynomials import gauss
from .._core.roots import root
from .._core.status import Status
from ._border import AttachedWaves, Both, harmonic_weights, observed_harmonics
from ._cycle import Cycle, Events
from ._cycle_collocation import Attached
from ._cylinder import Case
from ._cylinder_system import Cylinders
from ._event_panels import Mesh, Unknowns, at_points, highest, point_angles
from ._gas_balance import (
    EVENTS,
    FLAGS,
    FREE,
    SEAT,
    Accounts,
    account_scales,
    temperature_and_density,
    valve_scales,
)
from ._plenum import PER_PLENUM, chains
from ._pulsation import Pulsation
from ._revolutions import START, TURN
from ._several import SeveralCycles
from ._waves import Waves


class CycleSolution(NamedTuple):
    """Solution of march and Newton's method."""

    mesh: Mesh
    z: Unknowns
    marched: Unknowns  # with which Newton's method began
    totals: Float[Array, "k 12"]  # of the march
    solved: Bool[Array, ""]
    residual: Float[Array, ""]
    steps: Int[Array, ""]  # of Newton's method
    revolutions: Int[Array, ""]
    passes: Int[Array, ""]
    events: Int[Array, "2"]  # of suction and discharge valves, in the last revolution marched
    repeats: Bool[Array, ""]  # whether that one was as the one before, within the tolerance
    alternates: Bool[Array, ""]  # whether it was as the one before that, and not as the one before
    waves: Waves | None = None  # at the flanges of pipes


def cycle_of(system: Cylinders, solution, marching: bool) -> Cycle:
    solution, points, pulsation = _followed(system, solution, marching)
    solution = solution._replace(totals=solution.totals[0])
    points = jax.tree.map(lambda values: values[:, :, 0], points)
    cycle = _judged(system.shared, solution, points, marching)
    if pulsation is None:
        return cycle
    return _with_pulsation(cycle, pulsation)


def cycles_of(system: Cylinders, solution, marching: bool) -> SeveralCycles:
    """The cycle of every cylinder, by its own crank angle."""
    together, points, pulsation = _followed(system, solution, marching)

    def cycle_of_cylinder(
        case, phase, number, totals, points, starts, accounts, pressure, *flanges
    ):
        mesh = together.mesh
        z = together.z
        # of an event of another cylinder the panel has an edge, but no event of this one
        event = mesh.event - EVENTS * number
        is_its_event = (event >= 0) & (event < EVENTS)
        flags = lax.dynamic_slice_in_dim(mesh.flags, FLAGS * number, FLAGS, axis=1)
        mesh = Mesh(
            flags,
            jnp.where(is_its_event, event, -1),
            jnp.where(is_its_event, mesh.code, 0),
            mesh.fits,
        )
        z = Unknowns(points, starts, z.edges + phase)
        parts = together._replace(mesh=mesh, z=z, totals=totals)
        return _from_start(_judged(case, parts, (accounts, pressure, *flanges), marching))

    parts = (system.of_cylinder(values) for values in together.z[:2])
    over = (jnp.moveaxis(values, 2, 0) for values in points)
    numbered = jnp.arange(system.count), together.totals
    each = jax.vmap(cycle_of_cylinder)(system.cases, system.phase, *numbered, *parts, *over)
    return SeveralCycles(each, together, pulsation=pulsation)


def _pulsation(system: Cylinders, z: Unknowns, observed) -> Pulsation:
    """Pulsation of cylinders with waves, by the flows at all points."""
    assert system.waves is not None
    flows = observed_harmonics(system, observed[:, :-1], harmonic_weights(system, z))
    return Pulsation(system.waves, flows, system.shared, system.phase[0])


def _with_pulsation(cycle: Cycle, pulsation: Pulsation) -> Cycle:
    return eqx.tree_at(lambda c: c.pulsation, cycle, pulsation, is_leaf=lambda leaf: leaf is None)


def _from_start(cycle: Cycle) -> Cycle:
    """A cycle whose crank angle begins anywhere, from `START`."""
    angle = START + jnp.mod(cycle.angle - START, TURN)
    order = jnp.argsort(angle)
    names = ("weight", "volume", "pressure", "temperature", "mass", "lift", "flow", "port_velocity")
    events = START + jnp.mod(cycle.events.angle - START, TURN)

    def parts(cycle):
        # of the flanges the panels keep their own order, as those of the pressure do
        of_nodes = [getattr(cycle, name) for name in names]
        if cycle.plenum_pressure is not None:
            of_nodes.append(cycle.plenum_pressure)
        return tuple(of_nodes)

    values = (values_at_nodes[..., order] for values_at_nodes in parts(cycle))
    cycle = eqx.tree_at(lambda c: (c.angle, c.events.angle), cycle, (angle[order], events))
    return eqx.tree_at(parts, cycle, tuple(values))


def _followed(system: Cylinders, solution: CycleSolution, marching: bool):
    """A solution with its dependence on the system; accounts and pressures at all points, pulsation."""
    waves = solution.waves
    if waves is not None:
        cycle_and_waves = Both(solution.z, waves)
        # panels and waves are one root: either depends on the machine through the other as well
        followed = root(AttachedWaves(system, solution.mesh, cycle_and_waves))
        z = followed.panels
        system = system.with_waves(followed.waves)
        solution = solution._replace(waves=followed.waves)
    elif marching:
        z = solution.z
    else:
        z = root(Attached(system, solution.mesh, solution.z))
    # where Newton's method found nothing, the last march stands
    z = jax.tree.map(lambda new, old: jnp.where(solution.solved, new, old), z, solution.marched)
    solution = solution._replace(z=z)

    def law(angle, state, flags):
        if system.waves is None:
            at = system.rates(angle, state, flags)
            return at.accounts, at.pressure
        at, observed = system.observe(angle, state, flags)
        return at.accounts, at.pressure, system.line_pressures(angle), observed

    points = at_points(law, solution.mesh, z)
    if system.waves is None:
        return solution, points, None
    *points, observed = points
    return solution, tuple(points), _pulsation(system, z, observed)


def _judged(case: Case, solution: CycleSolution, points, marching: bool) -> Cycle:
    """The cycle of one cylinder, with its status."""
    status = Status.where(solution.solved, Status.converged, Status.not_converged)
    status = Status.where(solution.mesh.fits | solution.solved, status, Status.too_many_events)
    alternates = solution.alternates & ~solution.solved
    status = Status.where(alternates, Status.no_periodic_state, status)
    cycle = _cycle(case, solution, points, marching)
    # every check looks only at cycles of which no other has said anything: no delivery, wet gas,
    # then the range of the equation of state
    no_flow = (status == Status.converged) & (cycle.delivered <= 1e-9 * case.mass_scale)
    status = Status.where(no_flow, Status.no_delivery, status)
    fluid = case.cylinder.fluid
    wet = jnp.any(fluid.is_wet(cycle.temperature, cycle.mass / cycle.volume))
    wet |= fluid.is_wet(case.suction.T, case.suction.rho)
    status = Status.where((status == Status.converged) & wet, Status.wet, status)
    far = jnp.any(fluid.is_beyond_range(cycle.temperature, cycle.pressure))
    status = Status.where((status == Status.converged) & far, Status.out_of_range, status)
    return eqx.tree_at(lambda c: c.status, cycle, status)


def _cycle(case: Case, solution: CycleSolution, points, marching: bool) -> Cycle:
    """The result in SI units; where only the march stands, its totals replace the quadrature."""
    mesh, z = solution[:2]
    accounts, pressure, *flanges = points
    flange_pressure = flanges[0] if flanges else None
    nodes = z.points.shape[1] - 1
    angle, width = point_angles(z.edges, nodes)
    weight = width[:, None] * gauss(nodes).weights
    by_quadrature = jnp.einsum("ps,psa->a", weight, accounts[:, :-1])
    totals = solution.totals
    if not marching:
        totals = jnp.where(solution.solved, by_quadrature, totals)
    scales = account_scales(case)

    def flat(values):
        return values[:, :-1].reshape(-1)

    flows = accounts * scales * case.speed  # over the angle, times the speed: a second
    scale = [valve_scales(case, which) for which in range(2)]
    T, rho = jax.vmap(jax.vmap(lambda a, y: temperature_and_density(case, a, y)))(angle, z.points)
    volume = jax.vmap(jax.vmap(lambda a: case.volume(a)[0]))(angle)
    free = mesh.flags[:, jnp.asarray([0, 3])] == FREE
    which = mesh.event
    scale_of = jnp.stack([velocity for _, velocity, _ in scale])
    valve = clip(which, 0, 7) // 4
    slot = jnp.where(which >= 0, which % 4, 4)
    # velocities v of both valves among the states; at the end of a panel that is the one before
    # the jump
    column = jnp.where(valve == 0, 3, 6)
    speed = jnp.take_along_axis(z.points[:, -1], column[:, None], axis=1)[:, 0]
    moving = jnp.take_along_axis(free, valve[:, None], axis=1)[:, 0]
    meets = moving & (slot < 2)
    sits = mesh.code == 1
    # code 1 is onto or off the seat: the branch of the panel says which
    shuts = meets & sits
    opens = ~moving & (slot == 0) & sits
    events = Events(which, z.edges[1:], speed * scale_of[valve], meets, shuts, opens)
    return Cycle(
        angle=flat(angle),
        weight=weight.reshape(-1),
        volume=flat(volume),
        pressure=flat(pressure),
        temperature=flat(T),
        mass=flat(rho * volume),
        lift=jnp.stack([flat(z.points[..., 2 + 3 * i]) * scale[i][0] for i in range(2)]),
        flow=jnp.stack([flat(flows[..., 1 + i]) for i in range(2)]),
        port_velocity=jnp.stack([flat(z.points[..., 4 + 3 * i]) * scale[i][2] for i in range(2)]),
        totals=Accounts(*(totals * scales)),
        events=events,
        leakage_work=jnp.sum(weight * accounts[:, :-1, 3] * _rise(case, pressure[:, :-1]))
        * case.mass_scale,
        peak_pressure=highest(pressure),
        status=Status.converged,
        residual=solution.residual,
        iterations=solution.steps,
        revolutions=solution.revolutions,
        passes=solution.passes,
        case=case,
        solver="march" if marching else "collocation",
        raw=(mesh, z, pressure),
        plenum_pressure=_plenum_pressures(case, z.points),
        valve_events=solution.events,
        repeats=solution.repeats,
        flange_pressure=flange_pressure,
        piping_work=_piping_work(case, mesh, weight, angle, flange_pressure),
    )


def _piping_work(case: Case, mesh: Mesh, weight, angle, flanges: Float[Array, "p s+1 2"] | None):
    """[J] Work that the pipes of suction and discharge cost, by what their flange is off its line.

    `None` without any.
    """
    if flanges is None:
        return None

    def rate(angle):
        return case.volume(angle)[1]

    volume_1 = jax.vmap(jax.vmap(rate))(angle[:, :-1])
    works = []
    for which, line in enumerate(case.lines):
        is_open = 1.0 * (mesh.flags[:, 3 * which] > SEAT)
        if case.cylinder.valves[which].oscillator is None:
            is_open = jnp.ones_like(is_open)
        # times dV positive on either side: gas is drawn below the pressure of its line, and pushed
        # out, with dV < 0, above it
        missing = line.p - flanges[:, :-1, which]
        works.append(jnp.sum(weight * is_open[:, None] * missing * volume_1))
    return jnp.stack(works)


def _rise(case: Case, pressure):
    """[J/kg] of isentropic compression from suction to a pressure, exact at those of the lines."""
    a = 1 - 1 / case.suction.kappa
    # the rise of a perfect gas, scaled by that of the real one between both lines
    full_rise = (case.discharge.p / case.suction.p) ** a - 1
    share = ((pressure / case.suction.p) ** a - 1) / jnp.where(full_rise > 1e-9, full_rise, jnp.inf)
    return share * (case.isentropic.h - case.suction.h)


def _plenum_pressures(case: Case, points: Float[Array, "p s+1 n"]):
    """[Pa] At the nodes, (plenums, n); `None` without any."""
    if not case.cylinder.plenums:
        return None

    # plenums stand at the end of the states, behind those of the cylinder and of its wall
    of_plenums = -PER_PLENUM * len(case.cylinder.plenums)

    def at(state):
        sides = chains(case, state[of_plenums:])
        pressures = []
        for chain in sides:
            pressures += [gas.p for gas in chain.gases]
        return jnp.stack(pressures)

    states = points[:, :-1].reshape(-1, points.shape[-1])
    return jax.vmap(at)(states).T
