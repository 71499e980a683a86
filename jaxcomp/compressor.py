"""The compressor: mechanism, gas, friction and motor put together.

A part that is absent is `None`, and nothing of it is traced.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._each import AbstractEach
from ._fields import (
    ANY,
    BadInput,
    Part,
    is_traced,
    listed,
    no_machine,
    of_cylinder,
    quantities,
    quantity,
    replaced,
    subparts,
)
from .cylinder import Cylinder
from .cylinder._cylinder import ports_fit
from .friction import (
    AbstractFriction,
    AbstractJointLoop,
    JointLoads,
    closed,
    joint_loop,
    several_loops,
)
from .gas import AbstractGas, DoubleActing, StagedCycle, Stroke
from .mechanism import (
    AbstractKinematics,
    AbstractMechanism,
    CrankState,
    Cylinders,
    SliderCrank,
    SliderLink,
)
from .motor import AbstractMotor, ConstantSpeed, MeanSpeed


class Compressor(Part):
    """A machine as the crank sees it.

    Args:
        mechanism: drives the piston.
        motor: drives the crank.
        gas: loads the piston; `None` for a machine that turns in vacuum.
        friction: the laws of the mechanism's joints; `None` for ideal joints.
        gravity: [m/s^2] field in x and y of the mechanism's frame; without it weights are left out.
        cylinders: how several cylinders stand about the crankshaft; `None` for a single one.

    Raises:
        ValueError: friction of another mechanism's kind.
        BadInput: several cylinders with an unbalance of the crank that is not that of a throw.
    """

    kind: ClassVar[str] = "compressor"

    mechanism: AbstractMechanism
    motor: AbstractMotor
    gas: AbstractGas | None = None
    friction: AbstractFriction | None = None
    gravity: Float[Array, "2"] | None = quantity("m/s^2", ANY, shape=(2,), default=None)
    cylinders: Cylinders | None = None

    def __check_init__(self):
        if self.cylinders is not None:
            _check_single(self.mechanism)
        _check_lists(self)
        _check_ports(self)
        wanted = getattr(self.mechanism, "kind", None)
        if self.friction is not None and getattr(self.friction, "kind", None) != wanted:
            kind = getattr(self.friction, "kind", type(self.friction).__name__)
            raise ValueError(
                f"`friction` must be of the kind of the mechanism, {wanted}, but is {kind}."
            )

    @property
    def swept_volume(self) -> Float[Array, ""]:
        """[m^3] of a cylinder; of several different ones the first."""
        return of_cylinder(self.mechanism).swept_volume

    @property
    def load_reversals(self) -> int:
        """How many contact or pin loads may reverse in the mid-stroke of an ordinary revolution."""
        count = 1 if self.cylinders is None else self.cylinders.count
        return count * self.mechanism.load_reversals


def _check_single(mechanism: AbstractMechanism) -> None:
    """That a mechanism describes one of several cylinders."""
    if not isinstance(mechanism, SliderCrank | SliderLink):
        kind = type(mechanism).__name__
        raise BadInput("mechanism", kind, "a slider_crank or slider_link, for several cylinders")
    for name in (
        "crank_unbalance",
        "crank_unbalance_across",
        "crank_couple",
        "crank_product",
        "crank_product_across",
    ):
        given = getattr(mechanism, name, None)
        if given is not None and not is_traced(given) and bool(jnp.any(given != 0)):
            bound = "0: with several cylinders the throws have the unbalances"
            raise BadInput(f"mechanism.{name}", given, bound)


# Sections in which a number may be a list over the cylinders, and what of them is the crankshaft's.
_LISTED = ("mechanism", "gas", "friction")
_OF_SHAFT = ("crank_inertia", "crank_mass", "main_journal")


def single_numbers(compressor: Compressor) -> dict[str, str]:
    """SI unit of the numbers that are one for all of several cylinders and may be a list over them."""
    return {
        f"{section}.{path}.{name}" if path else f"{section}.{name}": field.metadata["unit"]
        for section in _LISTED
        for path, part in subparts(getattr(compressor, section))
        for name, field in quantities(part)
        if part.for_each_cylinder
        and field.metadata["shape"] == ()
        and not (path or name).startswith(_OF_SHAFT)
        and ".laws." not in f".{path}"
        and getattr(part, name) is not None
        and jnp.ndim(getattr(part, name)) == 0
    }


def _check_lists(compressor: Compressor) -> None:
    """That lists in the place of numbers have one entry a cylinder."""
    count = 0 if compressor.cylinders is None else compressor.cylinders.count
    if isinstance(compressor.gas, StagedCycle) and len(compressor.gas.stages) != count:
        stages = str(compressor.gas.stages)
        raise BadInput("gas.stages", stages, f"one stage for each of {count} cylinders")
    for section in _LISTED:
        for path, part in subparts(getattr(compressor, section)):
            if isinstance(part, AbstractEach) and (
                path.startswith(_OF_SHAFT) or len(part.of_cylinder) != count
            ):
                bound = (
                    f"one law for each of {count} cylinders" if count else "of several cylinders"
                )
                where = f"{section}.{path}".rstrip(".")
                raise BadInput(f"{where}.of_cylinder", str(part.of_cylinder), bound)
        for path, value in listed(getattr(compressor, section)).items():
            of_shaft = path.startswith(_OF_SHAFT)
            if of_shaft or not count or value.shape != (count,):
                several = count and not of_shaft
                bound = f"one number, or one for each of {count} cylinders" if several else ""
                raise BadInput(
                    f"{section}.{path}", value, bound or "a single value, without [cylinders]"
                )


def _check_ports(compressor: Compressor) -> None:
    """That the ports of valves are narrower than the piston."""
    gas, mechanism = compressor.gas, compressor.mechanism
    if not isinstance(gas, Cylinder):
        return
    fits = zip(("suction_valve", "discharge_valve"), ports_fit(gas, mechanism), strict=True)
    for name, fit in fits:
        if not is_traced(fit) and not bool(jnp.all(fit)):
            bore = 2 * jnp.sqrt(jnp.min(mechanism.piston_area) / jnp.pi)
            diameter = getattr(gas, name).port_diameter
            raise BadInput(f"gas.{name}.port_diameter", diameter, f"< {bore:.5g} m, the bore")


def compressor_of(machine: Any) -> Compressor:
    """The compressor of what a verb of the crank was given.

    Args:
        machine: a compressor; or a machine or a scene, which is put together first (anything with a
            method `as_compressor`).

    Raises:
        BadInput: something else, such as the name of a file.
    """
    if isinstance(machine, Compressor):
        return staged(machine)
    if not hasattr(machine, "as_compressor"):
        raise no_machine(machine)
    return machine.as_compressor()


def staged(compressor: Compressor) -> Compressor:
    """The compressor with the gas of every cylinder, where stages share what lies between them."""
    if not isinstance(compressor.gas, StagedCycle):
        return compressor
    mechanism = compressor.mechanism
    top, bottom = mechanism.piston_extremes()
    gas = compressor.gas.of_cylinders(mechanism.piston_area, top - bottom)
    return replaced(compressor, gas=gas)


def at_speed(compressor: Compressor, speed: Float[Array, ""]) -> Compressor:
    """The compressor held at a mean speed [rad/s], whatever its motor."""
    motor = compressor.motor
    if isinstance(motor, MeanSpeed | ConstantSpeed):
        return replaced(compressor, motor=replaced(motor, mean_speed=speed))
    held = replaced(MeanSpeed(1.0), mean_speed=jnp.asarray(speed, float))
    return replaced(compressor, motor=held)


class Instants(eqx.Module):
    """What crank angles alone decide, whatever the speed: prepared once and passed on.

    With k cylinders, kinematics, pressure and gas force have a leading axis of k.

    Attributes:
        angle: [rad] crank angle.
        kinematics: of the mechanism.
        inertia, inertia_1: [kg m^2] J, reduced to the crank, and J' there.
        pressure: [Pa] in the cylinder; `None` without gas.
        gas_force: [N] (p - p_back) A, positive towards the crank.
        conservative: [N m] torque of gas and weights on the crank.
    """

    angle: Float[Array, "*n"]
    kinematics: AbstractKinematics
    inertia: Float[Array, "*n"]
    inertia_1: Float[Array, "*n"]
    pressure: Float[Array, "*n"] | None
    gas_force: Float[Array, "*n"]
    conservative: Float[Array, "*n"]

    def entries(self, *index) -> "Instants":
        """Some of the instants."""
        return jax.tree.map(lambda x: x[index], self)


def instants(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Instants:
    """Everything at crank angles [rad] that does not depend on the motion.

    `sense` is +1 while the crank turns forward, -1 while it turns backward.
    """
    mechanism, cylinders = compressor.mechanism, compressor.cylinders
    if cylinders is not None:
        return _of_several(compressor, cylinders, angle, sense)
    kinematics = mechanism.kinematics(angle)
    pressure, force = None, jnp.zeros_like(angle)
    if compressor.gas is not None:
        area, stroke = mechanism.piston_area, _stroke(mechanism, angle, kinematics, sense)
        pressure, across = compressor.gas.on_piston(stroke, area)
        force = across * area
    torque = -force * kinematics.position_1
    if compressor.gravity is not None:
        torque = torque + mechanism.weight_torque(kinematics, compressor.gravity)
    return Instants(
        angle, kinematics, *mechanism.reduced_inertia(kinematics), pressure, force, torque
    )


def of_each_cylinder(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Instants:
    """The instants of each cylinder of several, by its own crank angle and without the crankshaft.

    All entries have a leading axis of cylinders. Weights are in the torques.

    Args:
        compressor: with several cylinders.
        angle: [rad] of the crank.
        sense: +1 while the crank turns forward, -1 while it turns backward.
    """
    cylinders = compressor.cylinders
    assert cylinders is not None
    one = replaced(compressor, cylinders=None, gravity=None, mechanism=without_crank(compressor))
    laid = (cylinders.each(part, angle) for part in (one.mechanism, one.gas))
    one = eqx.tree_at(
        lambda c: (c.mechanism, c.gas), one, tuple(laid), is_leaf=lambda leaf: leaf is None
    )
    each = instants(one, cylinders.own_angle(angle), sense)
    if compressor.gravity is None:
        return each
    own = cylinders.own_gravity(compressor.gravity, angle)
    weights = one.mechanism.weight_torque(each.kinematics, own)
    return eqx.tree_at(lambda e: e.conservative, each, each.conservative + weights)


def _of_several(compressor: Compressor, cylinders: Cylinders, angle, sense) -> Instants:
    """The instants of each cylinder by its own crank angle; inertias and torques are their sums."""
    each = of_each_cylinder(compressor, angle, sense)
    torque = jnp.sum(each.conservative, axis=0)
    if compressor.gravity is not None:
        torque += cylinders.weight_torque(angle, compressor.gravity, compressor.mechanism)
    inertia = compressor.mechanism.crank_inertia + jnp.sum(each.inertia, axis=0)
    inertia_1 = jnp.sum(each.inertia_1, axis=0)
    return Instants(
        angle, each.kinematics, inertia, inertia_1, each.pressure, each.gas_force, torque
    )


def without_crank(compressor: Compressor) -> AbstractMechanism:
    """The mechanism without inertia and mass of the crankshaft, which several cylinders share."""
    return replaced(compressor.mechanism, crank_inertia=jnp.zeros(()), crank_mass=jnp.zeros(()))


def _stroke(mechanism: AbstractMechanism, angle, kinematics: AbstractKinematics, sense) -> Stroke:
    top, bottom = mechanism.piston_extremes()
    area = mechanism.piston_area
    # rounding must not push the volume below that of the dead centre
    displaced = area * jnp.maximum(top - kinematics.position, 0.0)
    return Stroke(angle, displaced, area * (top - bottom), jnp.sign(kinematics.position_1) * sense)


def stroke_at(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Stroke:
    """Displaced volume and direction of the stroke at crank angles [rad].

    `sense` is +1 while the crank turns forward, -1 while it turns backward.
    """
    mechanism, cylinders = compressor.mechanism, compressor.cylinders
    if cylinders is not None:
        mechanism, angle = cylinders.each(mechanism, angle), cylinders.own_angle(angle)
    return _stroke(mechanism, angle, mechanism.kinematics(angle), sense)


def cylinder_pressure(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0):
    """Absolute pressure [Pa] in the cylinder at crank angles [rad]; needs a gas."""
    gas, cylinders = compressor.gas, compressor.cylinders
    assert gas is not None
    gas = gas if cylinders is None else cylinders.each(gas, angle)
    return gas.pressure(stroke_at(compressor, angle, sense))


def crank_end_pressure(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0):
    """Absolute pressure [Pa] behind double-acting pistons; `None` for a gas on one side only."""
    gas, cylinders = compressor.gas, compressor.cylinders
    if not isinstance(gas, DoubleActing):
        return None
    gas = gas if cylinders is None else cylinders.each(gas, angle)
    return gas.crank_end_pressure(stroke_at(compressor, angle, sense))


def gas_force(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Float[Array, "*n"]:
    """(p - p_back) A [N] at crank angles [rad], positive towards the crank."""
    return instants(compressor, angle, sense).gas_force


def loads_at(
    compressor: Compressor,
    state: CrankState,
    gas: Float[Array, "*n"] | None = None,
    evidence: bool = True,
) -> JointLoads:
    """Joint loads of the compressor at given instants.

    `gas` is the gas force [N] where the caller has it already; without `evidence` the residual and
    the margin of the joint loop are left out.
    """
    if gas is None:
        gas = gas_force(compressor, state.angle, jnp.sign(state.speed))
    loop = loop_of(compressor, state, gas)
    return loop.loads(closed(loop), evidence)


def loop_of(
    compressor: Compressor,
    state: CrankState,
    gas: Float[Array, "*n"],
    kinematics: AbstractKinematics | None = None,
) -> AbstractJointLoop:
    """The joint loop of the compressor at given instants; of all its cylinders if there are several.

    Args:
        compressor: the machine.
        state: angle, speed and acceleration of the crank.
        gas: [N] gas force, of each cylinder if there are several.
        kinematics: of the mechanism at these angles, where the caller has them already.
    """
    mechanism, friction, cylinders = compressor.mechanism, compressor.friction, compressor.cylinders
    if cylinders is None:
        return joint_loop(mechanism, friction, state, gas, compressor.gravity, kinematics)
    single = without_crank(compressor)
    if kinematics is None:
        own = cylinders.own_angle(state.angle)
        kinematics = cylinders.each(single, state.angle).kinematics(own)
    assert isinstance(mechanism, SliderCrank | SliderLink)
    return several_loops(
        single,
        friction,
        cylinders,
        state,
        gas,
        compressor.gravity,
        mechanism.crank_mass,
        kinematics,
    )


def conservative_torque(
    compressor: Compressor, angle: Float[Array, "*n"], gas: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Torque [N m] on the crank of a gas force [N] and of the weights."""
    _, position_1, _ = compressor.mechanism.piston(angle)
    torque = -gas * position_1
    if compressor.gravity is not None:
        torque = torque + compressor.mechanism.gravity_torque(angle, compressor.gravity)
    return torque


def first_top(compressor: Compressor) -> Float[Array, ""]:
    """[rad] Crank angle of the top dead centre of the first cylinder, where the revolution begins."""
    top, _ = compressor.mechanism.dead_centres()
    if compressor.cylinders is None:
        return top
    return jnp.ravel(top)[0] - compressor.cylinders.phase[0]


def kink_angles(compressor: Compressor) -> Float[Array, " k"]:
    """Crank angles [rad] in one revolution from the top dead centre where torques have kinks, sorted.

    Dead centres, reversals of a sliding direction and valve events. The first entry is the top dead
    centre; events that do not occur coincide with a dead centre.
    """
    mechanism = compressor.mechanism
    top, bottom = mechanism.dead_centres()
    angles = [bottom]
    if compressor.friction is not None:
        angles += list(mechanism.reversals())
    if compressor.gas is not None:
        highest, lowest = mechanism.piston_extremes()
        area = mechanism.piston_area
        for displaced, inward in compressor.gas.valve_events(area * (highest - lowest)):
            angles.append(mechanism.angle_at(highest - displaced / area, inward))
        angles += compressor.gas.event_angles()
    revolution, rest = 2 * jnp.pi, jnp.stack(jnp.broadcast_arrays(*angles))
    if compressor.cylinders is not None:
        # the first cylinder's top dead centre is the first edge
        phase = compressor.cylinders.phase
        rest = jnp.atleast_2d(rest.T)
        tops = jnp.broadcast_to(top, phase.shape)
        rest = jnp.broadcast_to(rest, (phase.size, rest.shape[1]))
        rest = (jnp.concatenate([rest, tops[:, None]], axis=1) - phase[:, None]).ravel()
        top = tops[0] - phase[0]
    rest = top + jnp.mod(rest - top, revolution)
    return jnp.concatenate([top[None], jnp.sort(rest)])
