r"""The joint loops of all cylinders, which meet in the main bearings of their crankshaft only.

Given the motion of the crank every rod has its own loop. The forces $S_k$ of the crank on the rods, in
machine axes, load the main bearings together with the pull of the throws' unbalances,

$$Q_i = \sum_k B_i(z_k) S_k + \sum_j B_i(z_j) u_j a_j ,$$

with the influence $B_i$ of a place on each bearing by `MainBearings`; a single journal takes all.
"""

from itertools import chain
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import max_of
from ..film import AbstractJournal
from ..friction import AbstractJointLoop, JointLoads, Marks, joint_loop
from ..mechanism import AbstractKinematics, AbstractMechanism, CrankState, Vector
from ._bearings import MainBearings, along_lines, bearing_names, shaft_losses
from ._crankshaft import Crankshaft


class Carried(NamedTuple):
    """Loads from the joints of the cylinders on the crankshaft, (k, *n) each."""

    loss: Float[Array, "k *n"]  # [N m] loss torque of each cylinder's own joints
    force: Vector  # [N] of the crank on what it drives, in the axes of the cylinders


class MachineLoops(eqx.Module):
    """The joints of a machine at n instants, up to the unknowns (k, n) of the loops of k cylinders.

    Everything else follows from the unknowns, forces [N], explicitly. A solver of the motion carries
    them along and improves them together with the motion.
    """

    # of all cylinders; their arrays have a leading axis of k
    loops: AbstractJointLoop
    crankshaft: Crankshaft
    speed: Float[Array, "*n"]  # [rad/s] of the crank
    shares: Float[Array, "m k"]  # [-] what each main bearing takes of the force of each rod
    pull: tuple[Vector, ...]  # [N] of the crankshaft's inertia and weight on every main bearing

    @property
    def kinks(self) -> int:
        """Number of the quantities that mark reversals which are kinks; the others belong to loads."""
        return self.crankshaft.count * self.loops.kinks

    def balance(self, unknown) -> tuple[Float[Array, "k *n"], tuple[Carried, Marks]]:
        """[N] What is left of the balances; what the shaft carries, and marks of load reversals."""
        excess, loss, force, marks = self.loops.balance(unknown)
        return excess, (Carried(loss, force), marks)

    def finished(self, carried: Carried, marks: Marks):
        """Loss torque [N m] of all joints, and the quantities that mark reversals one by one.

        These are first the kinks; then, of the loads that may come close to zero, the components
        along x, whose sign changes mark the places, and those along y, which tell how close.
        """
        reactions = self._reactions(carried.force)
        loss = jnp.sum(carried.loss, axis=0) + sum(self._shaft_losses(reactions).values(), 0.0)
        shaft = self._near_zero(reactions)
        # each mark has a row for every cylinder
        kinks = tuple(chain.from_iterable(marks.kinks))
        along_x = tuple(chain.from_iterable(marks.along_x))
        along_y = tuple(chain.from_iterable(marks.along_y))
        shaft_x = []
        shaft_y = []
        for force in shaft:
            shaft_x.append(force.x)
            shaft_y.append(force.y)
        return loss, (*kinks, *along_x, *shaft_x, *along_y, *shaft_y)

    def total_loss(self, carried: Carried) -> Float[Array, "*n"]:
        """[N m] Loss torque of all joints."""
        return self.finished(carried, Marks((), (), ()))[0]

    def directions(self, unknown) -> Float[Array, "k k *n"]:
        """Directions of one cylinder's unknown after the other, along a new leading axis."""
        identity = jnp.eye(unknown.shape[0]).reshape(
            unknown.shape[:1] * 2 + (1,) * (unknown.ndim - 1)
        )
        return identity * jnp.ones_like(unknown)

    def _shaft_losses(self, reactions: dict[str, Vector]) -> dict[str, Float[Array, "*n"]]:
        shaft = self.crankshaft
        return shaft_losses(shaft.main_journal, reactions, self.speed, shaft.mass)

    def _near_zero(self, reactions: dict[str, Vector]) -> list[Vector]:
        """The load of the shaft, which marks places where it comes close to zero: that of all bearings.

        Those of the bearings by themselves do so beside it, and that of several cylinders hardly does:
        they would take the places of other joints.
        """
        shaft = self.crankshaft
        if not self.loops.marks_shaft or shaft.main_journal is None or shaft.count > 1:
            return []
        first, *further = reactions.values()
        x = sum((force.x for force in further), first.x)
        y = sum((force.y for force in further), first.y)
        return [Vector(x, y)]

    def _reactions(self, force: Vector) -> dict[str, Vector]:
        """Force of each main bearing on the shaft [N], by name."""
        shaft = self.crankshaft
        turned = shaft.turned(force)
        reactions = {}
        for name, share, pull in zip(bearing_names(shaft), self.shares, self.pull, strict=True):
            share = shaft.along(share, self.speed)
            x = jnp.sum(share * turned.x, axis=0) + pull.x
            y = jnp.sum(share * turned.y, axis=0) + pull.y
            reactions[name] = Vector(x, y)
        return reactions

    def loads(self, unknown, evidence: bool) -> JointLoads:
        """Forces and losses; with residual and margin if `evidence`."""
        each = self.loops.loads(unknown, evidence)
        shaft = self.crankshaft
        reactions = self._reactions(Vector(*each.forces[self.loops.at_crank]))
        forces = {}
        losses = {}
        for place in range(shaft.count):
            for joint, force in each.forces.items():
                forces[shaft.joint(joint, place + 1)] = force[:, place]
            for joint, loss in each.loss_torque.items():
                losses[shaft.joint(joint, place + 1)] = loss[place]
        shape = (-1, *self.speed.shape)
        minima = [each.minima.reshape(shape)]
        for shaft_load in self._near_zero(reactions):
            minima.append(shaft_load.x[None])
        for name, reaction in reactions.items():
            forces[name] = reaction.stacked()
        losses |= self._shaft_losses(reactions)
        residual = None
        if each.residual is not None:
            residual = max_of(jnp.abs(each.residual), axis=0)
        return JointLoads(
            forces=forces,
            loss_torque=losses,
            residual=residual,
            margin=each.margin,
            kinks=each.kinks.reshape(shape),
            minima=jnp.concatenate(minima),
        )


def machine_loops(
    mechanism: AbstractMechanism,
    friction: Any,
    crankshaft: Crankshaft,
    state: CrankState,
    gas_force: Float[Array, "k *n"],
    gravity: Float[Array, "2"] | None,
    kinematics: AbstractKinematics,
) -> MachineLoops:
    """The joint loops of a machine at given instants.

    Args:
        mechanism: of one cylinder.
        friction: its laws, or `None` for joints without friction.
        crankshaft: what the cylinders sit on.
        state: angle, speed and acceleration of the crank, shape (n,) or ().
        gas_force: [N] of each cylinder.
        gravity: [m/s^2] field in machine axes; `None` leaves weights out.
        kinematics: of each cylinder, with a leading axis of k.
    """
    shape = kinematics.position.shape
    each = CrankState(
        crankshaft.own_angle(state.angle),
        jnp.broadcast_to(state.speed, shape),
        jnp.broadcast_to(state.acceleration, shape),
    )
    own_gravity = None
    if gravity is not None:
        own_gravity = crankshaft.own_gravity(gravity, state.angle)
    support: AbstractJournal | MainBearings | None = crankshaft.main_journal
    # A single journal takes all of the force and none of the moment.
    line = [(1.0, 0.0)]
    influence = None
    shares = jnp.ones((1, crankshaft.count))
    if isinstance(support, MainBearings):
        line = support.line()
        influence = support.influence
        shares = influence(crankshaft.position)
    second = crankshaft.second_rate(kinematics, state)
    pulls = crankshaft.crank_pulls(second, mechanism, line, influence)
    if gravity is not None:
        weight = crankshaft.mass * gravity
        centre = crankshaft.mass_centre
        # The bearings push the shaft: its mass times acceleration, less its weight.
        parts = along_lines(line, centre)
        pulls_without_weight = []
        for pull, part in zip(pulls, parts, strict=True):
            pulls_without_weight.append(
                Vector(pull.x - part * weight[0], pull.y - part * weight[1])
            )
        pulls = pulls_without_weight
    laws = crankshaft.each(friction, state.angle)
    single = crankshaft.each(mechanism, state.angle)
    loops = joint_loop(single, laws, each, gas_force, own_gravity, kinematics)
    return MachineLoops(loops, crankshaft, state.speed, shares, tuple(pulls))
