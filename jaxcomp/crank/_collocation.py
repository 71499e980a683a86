"""Periodic orbit by collocation on Gauss panels: the whole revolution at once.

The panels end at the kinks of the torques, so the error falls exponentially with the number of
nodes, apart from the places in mid-stroke where a load reverses: those are located on a first solution
and become panel edges as well, which move with the solution.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._core.extremes import maximum, minimum
from .._core.roots import FixedPointReport, fixed_point
from .._core.status import Status
from ..compressor import Compressor, instants, kink_angles, loop_of
from ..cylinder import CycleOptions, Cylinder
from ..mechanism import CrankState
from ._crank_motion import closure_of
from ._evaluation import orbit_of_motion, orbit_on_panels
from ._iteration import OrbitParameters, Resolution, motor_steepness, prepare, revolution_edges
from ._journals import FEWEST_PANELS, orbiting_journals
from ._orbit import Energy, Orbit
from ._panels import panels
from ._reversals import CrankSolution, OrbitProblem

# Nodes on every panel and grading by default, by the number of cylinders up to those of all larger ones.
_OF_SEVERAL = {2: (8, 1), 3: (7, 1), 4: (6, 1), 5: (6, 0), 6: (6, 0), 7: (5, 0)}
# Grading where none is given, by the number of cylinders up to that of all larger ones. The edges that
# every cylinder makes for all of them cut the panels beside a near-zero load as well: with 8 nodes the
# derivatives of the efficiency differ by 1e-8 to 6e-8 of the largest from those with a grading of 3; of
# four cylinders with a grading of 1 by 1.1e-7, of eight without by 3e-7.
_GRADING = {1: 3, 2: 2, 3: 2, 4: 2, 5: 1}
# Tolerance by default with several cylinders: a change of 1e-10 leaves an error of 1e-12.
_SEVERAL = 1e-10
# Panels of several cylinders whose load reversals are not located. Of 32 machines with all numbers
# scattered by 5 %, the errors in efficiency are 5e-7, 5e-7 and 1e-6 in the middle for 2, 4 and 8
# cylinders and 9e-6 at most; with 24 panels of 12 nodes, which cost as much, 4e-7, 2e-6 and 2e-6, with
# 24 of 8 nodes 1e-6, 5e-6 and 4e-6.
_PANELS = 36
# Panels without friction and gas, which add kinks and cost most of the time: a single piston alone has
# kinks at its dead centres alone, and on two panels of 8 nodes its forces of orders 4 and 6 were rounding
# of the quadrature, 13 % and 160 times the value; on 12 all orders to 6 are good to 1e-12 of the first.
_FRICTIONLESS_PANELS = 12
# Points of tables of pressures: with so many the panels between them need no more than these nodes; and
# more than these, a diagram of every half degree, are not all edges. Of 180 points of a polytropic cycle
# 4 nodes leave 1e-9 of the gas work, and 12 ms where three points a panel take 4.
_FEW_POINTS = 48
_NODES_OF_TABLE = 4
_MOST_POINTS = 720
# [-] Width over that of another panel below which two edges count as one.
_COINCIDING = 0.02


def default_cycle() -> CycleOptions:
    """Options for the cycle where it is solved with the crank: its panels are those of the crank as
    well.
    """
    return CycleOptions(least_panels=40, first_nodes=8)


class Collocation(eqx.Module):
    """Options of the collocation solver.

    Attributes:
        nodes: Gauss nodes on every panel.
        reversals: how many load reversals in mid-stroke may become panel edges; 0 looks for none.
        grading: how often the panels beside a vanishing pin load are cut again, towards it; `None`:
            thrice with one cylinder, twice with two to four, once with more.
        tolerance: [-] change of the relative kinetic energy at which the iteration stops. Given as an
            array, all tolerances share one compiled program.
        max_iterations: iterations after which the result is marked as not converged.
        panel_count: how many panels the kinks that are known beforehand make, so that the cost does not
            depend on their number. Of more kinks those closest behind another are no edges: of several
            cylinders many coincide, and the error of a kink within a panel goes with the square of its
            distance from the edge. Between fewer kinks the widest panels are halved. `None`: every
            kink is an edge, and there are no others but where journals move, whose thin films need 24.
        estimate: whether everything is evaluated at twice the nodes as well, which tells `loss_error`;
            without, that is NaN, and an orbit of several cylinders takes three quarters of the time.
        follow: whether the load reversals follow the motion in the last iterations; else they stay
            where a motion good to 1e-8 has them, and no panels are cut anew. Derivatives follow them
            in any case. `None`: with one cylinder they do.
        cycle: how the cycle of a gas with valves is solved.
    """

    nodes: int = eqx.field(static=True, default=8)
    reversals: int = eqx.field(static=True, default=4)
    grading: int | None = eqx.field(static=True, default=None)
    tolerance: float | Float[Array, ""] = 1e-13
    max_iterations: int = eqx.field(static=True, default=120)
    panel_count: int | None = eqx.field(static=True, default=None)
    estimate: bool = eqx.field(static=True, default=True)
    follow: bool | None = eqx.field(static=True, default=None)
    cycle: CycleOptions = eqx.field(default_factory=default_cycle)

    name: ClassVar[str] = "collocation"

    def problem(
        self, compressor: Compressor, solution: CrankSolution | None = None
    ) -> OrbitProblem:
        """The fixed-point problem of a compressor, with its solution where that has been found."""
        reversals = 0 if compressor.frictionless else self.reversals
        count = compressor.crankshaft.count
        grading = self.grading
        if grading is None:
            grading = _GRADING[min(count, max(_GRADING))]
        follow = self.follow
        if follow is None:
            follow = count == 1
        resolution = Resolution(self.nodes, reversals, grading)
        return OrbitProblem(
            resolution,
            loop_kinks(compressor),
            self.tolerance,
            self.max_iterations,
            follow,
            solution,
        )

    def solve(self, compressor: Compressor) -> Orbit:
        """The orbit of an admissible compressor."""
        return self.solved(compressor)[0]

    def solved(
        self, compressor: Compressor, solution: CrankSolution | None = None
    ) -> tuple[Orbit, CrankSolution | None]:
        """The orbit of an admissible compressor, and the unknowns of its equations if it has any.

        Args:
            compressor: the machine.
            solution: unknowns of an earlier call with the same numbers, which are not searched for again.
        """
        problem = self.problem(compressor, solution)
        kinks = kink_angles(compressor)
        count = self.panel_count
        if count is None and kinks.size < FEWEST_PANELS and orbiting_journals(compressor):
            count = FEWEST_PANELS
        inertia_alone = compressor.frictionless and compressor.gas is None
        if count is None and kinks.size < _FRICTIONLESS_PANELS and inertia_alone:
            count = _FRICTIONLESS_PANELS
        if count is not None:
            kinks = _of_count(kinks, count)
        parameters = prepare(compressor, revolution_edges(kinks))
        if self.panel_count is None and closure_of(compressor.motor).needs_steepness:
            parameters = _with_layers(parameters)
        if compressor.frictionless and not closure_of(compressor.motor).integrates:
            return _explicit_orbit(parameters, problem.resolution, self.name), None
        # nothing is iterated where the unknowns come with the problem
        unknowns = fixed_point(problem, parameters)
        motion, (_, report) = unknowns
        orbit = orbit_of_motion(
            parameters, problem.resolution, motion, report, self.name, self.estimate
        )
        return orbit, unknowns


def default_collocation(compressor: Compressor) -> Collocation:
    """Solver of `solve_orbit` if it is given none.

    The load reversals in mid-stroke are located. Of several cylinders every one is an edge for all, so
    that more cylinders have narrower panels, which need fewer nodes and no grading; and places that
    follow the motion in every iteration would cut them all anew. Where journals move, or the gas has
    valves, whose events are edges, those of several cylinders are not located: that leaves an error of
    1e-6 in efficiency, rarely 1e-5, and of 1e-3 of the largest in its relative derivatives.
    """
    count = compressor.crankshaft.count
    if points := tabulated_points(compressor):
        return _of_table(compressor, points)
    if count == 1:
        return Collocation(reversals=compressor.load_reversals)
    if isinstance(compressor.gas, Cylinder):
        return Collocation(reversals=0)
    if orbiting_journals(compressor) or compressor.frictionless:
        return Collocation(reversals=0, panel_count=_PANELS)
    nodes, grading = _OF_SEVERAL[min(count, max(_OF_SEVERAL))]
    reversals = compressor.load_reversals
    return Collocation(nodes, reversals, grading, tolerance=_SEVERAL, follow=False)


def _of_table(compressor: Compressor, points: int) -> Collocation:
    """Options for pressures of tables, which bend at every point."""
    narrow = points > _FEW_POINTS
    reversals = compressor.load_reversals if compressor.crankshaft.count == 1 else 0
    return Collocation(
        nodes=_NODES_OF_TABLE if narrow else 8,
        reversals=reversals,
        panel_count=_MOST_POINTS if points > _MOST_POINTS else None,
    )


def tabulated_points(compressor: Compressor) -> int:
    """Number of points that the tables of pressures have in a revolution, all cylinders together."""
    gas = compressor.gas
    if gas is None or isinstance(gas, Cylinder):
        return 0

    def events(gas):
        angles = gas.event_angles()
        shares = gas.event_shares()
        # laws without events answer with an empty tuple
        if isinstance(angles, tuple):
            angles = None
        return angles, shares

    # by their shapes alone, which a traced machine has as well
    angles, shares = eqx.filter_eval_shape(events, gas)
    points = 0
    if angles is not None:
        points += angles.shape[-1]
    if shares is not None:
        # a stroke share is met on the way out and on the way back
        points += 2 * shares.shape[-1]
    return points * compressor.crankshaft.count


def _with_layers(parameters: OrbitParameters) -> OrbitParameters:
    """Kinks with an edge behind each: there the slip of a stiff motor follows a jump of the load.

    It does so within an angle of one over the steepness. With a panel twice as wide the fluctuation of
    the speed is known as well as without jumps, to 3e-5; without, to 4e-3. Behind the jumps of a soft
    motor the panel has no width: a cut would make estimates smaller, and errors at load reversals not.
    Of several cylinders the panels are many, and none is added.
    """
    if parameters.compressor.crankshaft.count > 1:
        return parameters
    kinks = parameters.edges[:-1]
    width = jnp.diff(parameters.edges)
    # in much narrower panels the rounding of their angles would count
    layer = maximum(2 / maximum(motor_steepness(parameters), 1e-3), 1e-4)
    # continuous in the stiffness: wider with the layer, then narrower again
    layer = maximum(minimum(layer, 0.75 * width - layer), 0.0)
    layer = jnp.where(layer < 1e-4, 0.0, layer)
    kinks = jnp.sort(jnp.concatenate([kinks, kinks + layer]))
    return eqx.tree_at(lambda k: k.edges, parameters, revolution_edges(kinks))


def _of_count(kinks: Float[Array, " k"], count: int) -> Float[Array, " count"]:
    """Edges of panels, as many as wanted, from the sorted kinks; see `Collocation`."""
    if count < kinks.size:
        # the first of them, and those that lie farthest behind the one before; which these are has no
        # derivative, their angles have
        _, place = lax.top_k(lax.stop_gradient(jnp.diff(kinks)), count - 1)
        kinks = jnp.concatenate([kinks[:1], kinks[1 + jnp.sort(place)]])
    while kinks.size < count:
        kinks = jnp.sort(jnp.append(kinks, _halves(kinks, min(count - kinks.size, kinks.size))[0]))
    # edges that all but coincide serve better between others
    gap, place = lax.top_k(-lax.stop_gradient(jnp.diff(kinks)), count // 2)
    middle, width = _halves(kinks, count // 2)
    behind_gap = kinks[1 + place]
    return jnp.sort(
        kinks.at[1 + place].set(jnp.where(-gap < _COINCIDING * width, middle, behind_gap))
    )


def _halves(kinks: Float[Array, " k"], count: int):
    """[rad] Middle and width of the widest panels."""
    edges = revolution_edges(kinks)
    width, place = lax.top_k(lax.stop_gradient(jnp.diff(edges)), count)
    return 0.5 * (edges[place] + edges[place + 1]), width


def _explicit_orbit(parameters: OrbitParameters, resolution: Resolution, solver: str) -> Orbit:
    """At a given speed without friction nothing is left to solve."""
    compressor = parameters.compressor
    grid = panels(parameters.edges, resolution.nodes)
    at = instants(compressor, grid.angle)
    speed = jnp.full_like(grid.angle, compressor.motor.speed_guess)
    state = CrankState(grid.angle, speed, jnp.zeros_like(speed))
    loop = loop_of(compressor, state, at.gas_force, at.kinematics)
    loads = loop.loads(loop.loops.start(), True)
    torque = 0.5 * at.inertia_1 * speed**2 - at.conservative
    # over a revolution at constant speed the inertia takes no work
    work = 0.0 - grid.total(at.conservative)  # not -0 without gas
    energy = Energy(work, work, {})
    gas_work_error = None
    # the resolution tells enough of smooth laws; a table bends within the panels
    if tabulated_points(compressor):
        fine = panels(lax.stop_gradient(grid.edges), 2 * resolution.nodes)
        finer = fine.total(lax.stop_gradient(instants(compressor, fine.angle).conservative))
        gas_work_error = jnp.abs(finer + lax.stop_gradient(work))
    return orbit_on_panels(
        grid=grid,
        at=at,
        state=state,
        motor_torque=torque,
        loads=loads,
        energy=energy,
        loss_error={},
        status=Status.converged,
        report=FixedPointReport(jnp.asarray(0), jnp.zeros(()), jnp.asarray(True)),
        solver=solver,
        gas_work_error=gas_work_error,
    )


def loop_kinks(compressor: Compressor) -> int:
    """Number of the quantities that mark load reversals which are kinks."""
    zero = jnp.zeros(())
    state = CrankState(zero, zero, zero)
    gas = jnp.zeros(compressor.crankshaft.count)
    # by the structure alone, which a traced machine has as well
    return eqx.filter_eval_shape(lambda c: loop_of(c, state, gas), compressor).kinks
