r"""The joint loops of several cylinders, which meet in the main bearings of their crankshaft only.

Given the motion of the crank every rod has its own loop. The forces $S_k$ of the crank on the rods, in
machine axes, load the main bearings together with the pull of the throws' unbalances,

$$Q_i = \sum_k B_i(z_k) S_k + \sum_j B_i(z_j) u_j a_j ,$$

with the influence $B_i$ of a place on each bearing by `MainBearings`; a single journal takes all.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import replaced
from ..mechanism import (
    AbstractKinematics,
    CrankState,
    Cylinders,
    SliderCrank,
    SliderLink,
    Vector,
)
from ._laws import AbstractJournal
from ._loads import AbstractJointLoop, JointLoads, joint_loop
from ._slider_crank import SliderCrankFriction, SliderCrankLoop
from ._slider_link import SliderLinkFriction, SliderLinkLoop
from ._support import MainBearings, shaft_losses

# Joints that each cylinder has for itself.
_OWN = (
    "wall",
    "wall_crown",
    "wall_edge",
    "piston_film",
    "packing",
    "piston_pin",
    "link_slider",
    "crank_pin",
)


def joints_of_cylinder(number: int) -> dict[str, str]:
    """Names in results of the joints that cylinder `number` >= 1 of several has for itself."""
    return {joint: f"{joint}_{number}" for joint in _OWN}


class SeveralLoops(AbstractJointLoop):
    """The joints of k cylinders, with the side force N [N] of each cylinder's wall as unknown (k, n)."""

    # of all cylinders; their arrays have a leading axis of k
    loops: SliderCrankLoop | SliderLinkLoop
    cylinders: Cylinders
    # law of the main bearings; `None` without friction there
    support: AbstractJournal | MainBearings | None
    speed: Float[Array, "*n"]  # [rad/s] of the crank
    shares: Float[Array, "m k"]  # [-] what each main bearing takes of the force of each rod
    pull: tuple[Vector, ...]  # [N] of the crankshaft's inertia and weight on every main bearing

    @property
    def kinks(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.cylinders.count * self.loops.kinks

    @property
    def coupled(self):
        return self.loops.coupled

    def start(self):
        return self.loops.start()

    def size(self):
        return self.loops.size()

    def excess(self, unknown):
        return self.loops.excess(unknown)

    def balance(self, unknown):
        (excess, loss, marks), rod_force = self.loops.balance_and_rod_force(unknown)
        return excess, (loss, rod_force), marks

    def total_loss(self, loss):
        own, rod_force = loss
        shaft = shaft_losses(self.support, self._reactions(rod_force), self.speed)
        return jnp.sum(own, axis=0) + sum(shaft.values(), jnp.zeros_like(self.speed))

    def rows(self, marks):
        return tuple(row for mark in marks for row in mark)

    def directions(self, unknown):
        """Of one cylinder's unknown after the other."""
        one = jnp.eye(unknown.shape[0]).reshape(unknown.shape[:1] * 2 + (1,) * (unknown.ndim - 1))
        return one * jnp.ones_like(unknown)

    def _reactions(self, rod_force: Vector) -> dict[str, Vector]:
        """Force of each main bearing on the shaft [N], by name."""
        force, names = self.cylinders.turned(rod_force), ("main_journal",)
        if isinstance(self.support, MainBearings):
            names = self.support.names or ()
        found = {}
        for name, share, own in zip(names, self.shares, self.pull, strict=True):
            share = self.cylinders.along(share, self.speed)
            found[name] = Vector(
                *(jnp.sum(share * f, axis=0) + p for f, p in zip(force, own, strict=True))
            )
        return found

    def loads(self, unknown, evidence):
        each = self.loops.loads(unknown, evidence)
        reactions = self._reactions(Vector(*each.forces["crank_pin"]))
        forces, losses = {}, {}
        for place in range(self.cylinders.count):
            for joint, name in joints_of_cylinder(place + 1).items():
                if joint in each.forces:
                    forces[name] = each.forces[joint][:, place]
                if joint in each.loss_torque:
                    losses[name] = each.loss_torque[joint][place]
        forces |= {name: force.stacked() for name, force in reactions.items()}
        shape = (-1, *self.speed.shape)
        return JointLoads(
            forces=forces,
            loss_torque=losses | shaft_losses(self.support, reactions, self.speed),
            residual=None if each.residual is None else jnp.max(jnp.abs(each.residual), axis=0),
            margin=each.margin,
            kinks=each.kinks.reshape(shape),
            minima=each.minima.reshape(shape),
        )


def several_loops(
    mechanism: SliderCrank | SliderLink,
    friction: SliderCrankFriction | SliderLinkFriction | None,
    cylinders: Cylinders,
    state: CrankState,
    gas_force: Float[Array, "k *n"],
    gravity: Float[Array, "2"] | None,
    shaft_mass: Float[Array, ""],
    kinematics: AbstractKinematics,
) -> SeveralLoops:
    """The joint loops of several cylinders at given instants.

    Args:
        mechanism: of one cylinder, without inertia and mass of the crank.
        friction: its laws, with those of the main bearings.
        cylinders: how they stand.
        state: angle, speed and acceleration of the crank, shape (n,) or ().
        gas_force: [N] of each cylinder.
        gravity: [m/s^2] field in machine axes; `None` leaves weights out.
        shaft_mass: [kg] of the crankshaft, with its weight in the plane z = 0.
        kinematics: of each cylinder, with a leading axis of k.
    """
    if friction is None:
        linked = isinstance(mechanism, SliderLink)
        friction = SliderLinkFriction() if linked else SliderCrankFriction()
    shape = kinematics.position.shape
    each = CrankState(
        cylinders.own_angle(state.angle),
        jnp.broadcast_to(state.speed, shape),
        jnp.broadcast_to(state.acceleration, shape),
    )
    own_gravity = None if gravity is None else cylinders.own_gravity(gravity, state.angle)
    rods, support = _shaft_apart(mechanism, friction, shaft_mass)
    line, influence = [(1.0, 0.0)], None
    shares = jnp.ones((1, cylinders.count))
    if isinstance(support, MainBearings):
        line, influence = support.line(), support.influence
        shares = influence(cylinders.position)
    pulls = cylinders.crank_pulls(state, mechanism, line, influence)
    if gravity is not None:
        weight = shaft_mass * gravity
        pulls = [
            Vector(p.x - share * weight[0], p.y - share * weight[1])
            for p, (share, _) in zip(pulls, line, strict=True)
        ]
    rods = cylinders.each(rods, state.angle)
    single = cylinders.each(mechanism, state.angle)
    loops = joint_loop(single, rods, each, gas_force, own_gravity, kinematics)
    assert isinstance(loops, SliderCrankLoop | SliderLinkLoop)
    return SeveralLoops(loops, cylinders, support, state.speed, shares, tuple(pulls))


def _shaft_apart(mechanism, friction, shaft_mass):
    """The laws of each cylinder's own joints, and those of the shaft."""
    if isinstance(friction, SliderCrankFriction):
        return replaced(friction, main_journal=None), friction.main_journal
    names = ("upper_bearing", "lower_bearing", "thrust_bearing", "pump")
    upper, lower, thrust, pump = (getattr(friction, name) for name in names)
    present = {name: None for name in names if getattr(friction, name) is not None}
    rods = replaced(friction, **present)
    if upper is None or lower is None:
        return rods, None
    # from the plane z = 0, as from that of the piston of a single cylinder
    places = jnp.stack(mechanism.bearing_places)
    made = MainBearings((upper, lower), jnp.array([0.0, 1.0]), 0.0, thrust, pump, names[:2])
    return rods, replaced(made, position=places, shaft_mass=shaft_mass)
