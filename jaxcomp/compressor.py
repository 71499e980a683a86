"""The compressor: mechanism, gas, friction and motor put together.

A part that is absent is `None`, and nothing of it is traced.
"""

from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._core.each import AbstractEach, listed, of_cylinder
from ._core.errors import BadInput, no_machine
from ._core.extremes import max_of, maximum, min_of
from ._core.fields import ANY, Part, is_traced, quantities, quantity, rebuilt, replaced, subparts
from ._core.words import one_of
from .crankshaft import Crankshaft
from .crankshaft._loops import MachineLoops, machine_loops
from .cylinder import Cylinder
from .cylinder._cylinder import ports_fit
from .cylinder._ends import check_settings
from .cylinder._waves import is_piped, pipings
from .friction import AbstractFriction, JointLoads
from .friction._joint_loads import closed
from .gas import AbstractGas, StagedCycle, Stroke
from .mechanism import AbstractKinematics, AbstractMechanism, CrankState
from .motor import AbstractMotor, ConstantSpeed, MeanSpeed

# what users take; the rest is for the packages that are built on this module
__all__ = [
    "Compressor",
    "Instants",
    "at_speed",
    "cylinder_pressure",
    "gas_force",
    "instants",
    "staged",
]


class Compressor(Part):
    """A machine as the crank sees it.

    Args:
        mechanism: the linkage of one cylinder, which drives its piston.
        crankshaft: drives the linkages; with the banks and the main bearings.
        motor: drives the crankshaft.
        gas: loads the piston; `None` for a machine that turns in vacuum.
        friction: the laws of the linkage's joints; `None` for ideal joints.
        gravity: [m/s^2] field in x and y of the machine; without it weights are left out.

    Raises:
        ValueError: friction of another mechanism's kind.
        BadInput: lists or laws that are not one for each cylinder, or a port wider than its bore.
    """

    kind: ClassVar[str] = "compressor"

    mechanism: AbstractMechanism
    crankshaft: Crankshaft
    motor: AbstractMotor
    gas: AbstractGas | None = None
    friction: AbstractFriction | None = None
    gravity: Float[Array, "2"] | None = quantity("m/s^2", ANY, shape=(2,), default=None)

    def __check_init__(self):
        _check_lists(self)
        _check_ports(self)
        _check_pipes(self)
        expected_kind = getattr(self.mechanism, "kind", None)
        if self.friction is not None and getattr(self.friction, "kind", None) != expected_kind:
            kind = getattr(self.friction, "kind", type(self.friction).__name__)
            raise ValueError(
                f"`friction` must be of the kind of the mechanism, {expected_kind}, but is {kind}."
            )

    @property
    def swept_volume(self) -> Float[Array, ""]:
        """[m^3] of a cylinder, on both sides of a double-acting piston; of different ones the first."""
        swept = of_cylinder(self.mechanism).swept_volume
        rod = getattr(self.gas, "rod_diameter", None)
        if rod is None:
            return swept
        area = jnp.pi / 4 * jnp.ravel(rod)[0] ** 2
        return 2 * swept - area * of_cylinder(self.mechanism).stroke

    @property
    def load_reversals(self) -> int:
        """Number of contact or pin loads that may reverse in the mid-stroke of an ordinary revolution."""
        return self.crankshaft.count * self.mechanism.load_reversals

    @property
    def frictionless(self) -> bool:
        """Whether no joint and no bearing of the shaft has a law."""
        return self.friction is None and self.crankshaft.main_journal is None


# Sections in which a number may be a list over the cylinders.
_LISTED = ("mechanism", "gas", "friction")


def single_numbers(compressor: Compressor) -> dict[str, str]:
    """SI unit of the numbers that are one for all of several cylinders and may be a list over them."""
    units = {}
    for section in _LISTED:
        for path, part in subparts(getattr(compressor, section)):
            # a law of a single cylinder has numbers of its own already
            if not part.for_each_cylinder or ".laws." in f".{path}":
                continue
            place = f"{section}.{path}" if path else section
            for name, field in quantities(part):
                value = getattr(part, name)
                single = field.metadata["shape"] == () and value is not None
                if single and jnp.ndim(value) == 0:
                    units[f"{place}.{name}"] = field.metadata["unit"]
    return units


def _check_lists(compressor: Compressor) -> None:
    """That lists in the place of numbers have one entry a cylinder."""
    count = compressor.crankshaft.count
    _check_stages(compressor.gas, count)
    for section in _LISTED:
        for path, part in subparts(getattr(compressor, section)):
            if isinstance(part, AbstractEach) and len(part.of_cylinder) != count:
                where = f"{section}.{path}".rstrip(".")
                bound = f"one law for each of {count} cylinders"
                raise BadInput(f"{where}.of_cylinder", str(part.of_cylinder), bound)
        for path, value in listed(getattr(compressor, section)).items():
            if value.shape != (count,):
                bound = "a single value, as there is one cylinder"
                if count > 1:
                    bound = f"one number, or one for each of {count} cylinders"
                raise BadInput(f"{section}.{path}", value, bound)
    support = compressor.crankshaft.main_journal
    for path, value in listed(support).items():
        raise BadInput(f"crankshaft.main_journal.{path}", value, "a single value")
    for path, part in subparts(support):
        if isinstance(part, AbstractEach):
            where = f"crankshaft.main_journal.{path}".rstrip(".")
            raise BadInput(
                f"{where}.of_cylinder", str(part.of_cylinder), "absent: the shaft is one"
            )


def _check_stages(gas: AbstractGas | None, count: int) -> None:
    """That every cylinder has its stage, and every end its settings."""
    if isinstance(gas, StagedCycle):
        _check_count_of_stages("gas.stages", gas.stages, count)
    if isinstance(gas, Cylinder):
        if gas.later_stages:
            _check_count_of_stages("gas.stage_of_cylinder", gas.stages, count)
        check_settings(gas, count)


def _check_count_of_stages(name: str, stages: tuple[int, ...], count: int) -> None:
    if len(stages) != count:
        raise BadInput(name, str(stages), f"one stage for each of {count} cylinders")


def _check_ports(compressor: Compressor) -> None:
    """That rods and the ports of valves are narrower than the pistons of their stage."""
    gas = compressor.gas
    if not isinstance(gas, Cylinder):
        return
    fits = ports_fit(gas, compressor.mechanism)
    # by NumPy: of JAX every operation on numbers is a program of its own, which a first start compiles
    if any(is_traced(fit) for fit in fits) or bool(np.all(np.stack(fits))):
        return
    areas = jnp.atleast_1d(compressor.mechanism.piston_area)
    stages = gas.stages if gas.later_stages else (1,) * areas.size
    areas = jnp.broadcast_to(areas, (len(stages),))
    for number in sorted(set(stages)):
        where = "gas" if number == 1 else f"gas.later_stages.{number - 2}"
        of_stage = np.flatnonzero(np.array(stages) == number)
        bore = float(2 * jnp.sqrt(min_of(areas[of_stage]) / jnp.pi))
        _check_rod_and_ports(gas.stage(number), where, bore)


def _check_rod_and_ports(stage: Any, where: str, bore: float) -> None:
    """That a stage's rod and ports are narrower than its smallest cylinder, and ports than its ring.

    Args:
        stage: with valves and perhaps a crank end.
        where: the path of its entries.
        bore: [m] of the smallest of its cylinders.
    """
    names = "suction_valve", "discharge_valve"
    for name in names:
        diameter = getattr(stage, name).port_diameter
        if not bool(diameter < bore):
            raise BadInput(f"{where}.{name}.port_diameter", diameter, f"< {bore:.5g} m, the bore")
    end = stage.crank_end
    if end is None:
        return
    rod = end.rod_diameter
    if not bool(rod < bore):
        bound = f"< {bore:.5g} m, the bore of the cylinder through which it goes"
        raise BadInput(f"{where}.crank_end.rod_diameter", rod, bound)
    as_circle = jnp.sqrt(bore**2 - rod**2)
    for name in names:
        valve = getattr(end, name)
        place = f"{where}.{name}" if valve is None else f"{where}.crank_end.{name}"
        diameter = (valve or getattr(stage, name)).port_diameter
        if not bool(diameter < as_circle):
            bound = f"< {as_circle:.5g} m, of a circle as large as the piston around its rod"
            raise BadInput(f"{place}.port_diameter", diameter, bound)


def _check_pipes(compressor: Compressor) -> None:
    """Refuse pipes that are wider than five bores, as of a diameter in millimetres."""
    gas = compressor.gas
    if not isinstance(gas, Cylinder) or not is_piped(gas):
        return
    bore = 2 * jnp.sqrt(max_of(compressor.mechanism.piston_area) / jnp.pi)
    for name, piping in zip(("suction", "discharge"), pipings(gas), strict=True):
        if piping is None:
            continue
        for number, pipes in enumerate(piping.pipes):
            fit = pipes.diameter <= 5 * bore
            if not is_traced(fit) and not bool(jnp.all(fit)):
                bound = f"<= {5 * bore:.5g} m, five times the bore"
                where = f"gas.{name}.piping.pipes.{number}.diameter"
                raise BadInput(where, pipes.diameter, bound)


def run_directions(compressor: Compressor | None) -> dict[str, Float[Array, "3"]]:
    """Directions of runs of pipe and vessels by name; none without pipes."""
    if compressor is None or not isinstance(compressor.gas, Cylinder):
        return {}
    return compressor.gas.run_directions


def check_runs(compressor: Compressor | None, loads: tuple, where: str) -> None:
    """Refuse loads of runs that the machine has not.

    Args:
        compressor: with its pipes.
        loads: with the name of a `run` each.
        where: path of the list in a file.

    Raises:
        BadInput: a name that no run or vessel has.
    """
    names = run_directions(compressor)
    for number, load in enumerate(loads):
        if load.run not in names:
            bound = "absent: no pipe of this machine has runs or vessels"
            if names:
                bound = f"{one_of(load.run, names)}, of runs and vessels of its pipes"
            raise BadInput(f"{where}.{number}.run", load.run, bound)


@runtime_checkable
class HasCompressor(Protocol):
    """Protocol of what verbs of the crank take beside a compressor: a machine or a scene."""

    def as_compressor(self) -> Compressor:
        """The compressor put together."""
        ...


def compressor_of(machine: Compressor | HasCompressor) -> Compressor:
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
    """The compressor with the gas of every cylinder, where stages share what lies between them.

    Args:
        compressor: whose gas may be a `StagedCycle`, or have mean temperatures of its heat exchangers.
    """
    if isinstance(compressor.gas, Cylinder) and compressor.gas.reference == "mean":
        return rebuilt(compressor, gas=compressor.gas.by_dew_points())
    if not isinstance(compressor.gas, StagedCycle):
        return compressor
    mechanism = compressor.mechanism
    top, bottom = mechanism.piston_extremes()
    gas = compressor.gas.of_cylinders(mechanism.piston_area, top - bottom)
    return replaced(compressor, gas=gas)


def at_speed(compressor: Compressor, speed: Float[Array, ""]) -> Compressor:
    """The compressor held at a mean speed [rad/s], whatever its motor.

    Args:
        compressor: with any motor.
        speed: [rad/s] the mean over a revolution.
    """
    motor = compressor.motor
    if isinstance(motor, MeanSpeed | ConstantSpeed):
        return replaced(compressor, motor=replaced(motor, mean_speed=speed))
    held = replaced(MeanSpeed(1.0), mean_speed=jnp.asarray(speed, float))
    return replaced(compressor, motor=held)


class Instants(eqx.Module):
    """Quantities that crank angles alone decide, whatever the speed: prepared once and passed on.

    Kinematics, pressure and gas force have a leading axis of the k cylinders.

    Attributes:
        angle: [rad] crank angle.
        kinematics: of the linkages, by the crank angle of each.
        inertia, inertia_1: [kg m^2] J, reduced to the crank, and J' there.
        pressure: [Pa] in the cylinders; `None` without gas.
        gas_force: [N] (p - p_back) A, positive towards the crank.
        conservative: [N m] torque of gas and weights on the crank.
    """

    angle: Float[Array, "*n"]
    kinematics: AbstractKinematics
    inertia: Float[Array, "*n"]
    inertia_1: Float[Array, "*n"]
    pressure: Float[Array, "k *n"] | None
    gas_force: Float[Array, "k *n"]
    conservative: Float[Array, "*n"]

    def entries(self, *index) -> "Instants":
        """Some of the instants."""
        return jax.tree.map(lambda x: x[index], self)


class CylinderInstants(NamedTuple):
    """Quantities of crank angles for every cylinder by itself, without the crankshaft; all are (k,
    *n).
    """

    kinematics: AbstractKinematics
    inertia: Float[Array, "k *n"]
    inertia_1: Float[Array, "k *n"]
    pressure: Float[Array, "k *n"] | None
    gas_force: Float[Array, "k *n"]
    conservative: Float[Array, "k *n"]


def of_each_cylinder(
    compressor: Compressor, angle: Float[Array, "*n"], sense=1.0
) -> CylinderInstants:
    """Quantities of crank angles for each cylinder, by its own crank angle, with its weights.

    Args:
        compressor: the machine.
        angle: [rad] of the crank.
        sense: +1 while the crank turns forward, -1 while it turns backward.
    """
    crankshaft = compressor.crankshaft
    gravity = compressor.gravity
    mechanism = crankshaft.each(compressor.mechanism, angle)
    own_angle = crankshaft.own_angle(angle)
    kinematics = mechanism.kinematics(own_angle)
    pressure = None
    force = jnp.zeros_like(own_angle)
    if compressor.gas is not None:
        area = mechanism.piston_area
        stroke = _stroke(mechanism, own_angle, kinematics, sense)
        gas = crankshaft.each(compressor.gas, angle)
        pressure, pressure_difference = gas.on_piston(stroke, area)
        force = pressure_difference * area
    # Virtual work: the force acts towards the crank, the position counts towards the head.
    torque = -force * kinematics.position_1
    if gravity is not None:
        own_gravity = crankshaft.own_gravity(gravity, angle)
        torque = torque + mechanism.weight_torque(kinematics, own_gravity)
    inertia, inertia_1 = mechanism.reduced_inertia(kinematics)
    return CylinderInstants(
        kinematics=kinematics,
        inertia=jnp.broadcast_to(inertia, own_angle.shape),
        inertia_1=jnp.broadcast_to(inertia_1, own_angle.shape),
        pressure=pressure,
        gas_force=force,
        conservative=torque,
    )


def instants(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Instants:
    """Everything at crank angles [rad] that does not depend on the motion.

    Args:
        compressor: a machine's, put together.
        angle: [rad] crank angles, of any shape.
        sense: +1 while the crank turns forward, -1 while it turns backward.

    Raises:
        BadInput: no inertia of the crankshaft, as in a machine that is not put together yet.
    """
    crankshaft = compressor.crankshaft
    gravity = compressor.gravity
    if crankshaft.inertia is None:
        raise BadInput("crankshaft.inertia", "absent", "given, or a machine with a rotor")
    each = of_each_cylinder(compressor, angle, sense)
    torque = jnp.sum(each.conservative, axis=0)
    if gravity is not None:
        torque += crankshaft.weight_torque(angle, gravity, compressor.mechanism)
    return Instants(
        angle=angle,
        kinematics=each.kinematics,
        inertia=crankshaft.inertia + jnp.sum(each.inertia, axis=0),
        inertia_1=jnp.sum(each.inertia_1, axis=0),
        pressure=each.pressure,
        gas_force=each.gas_force,
        conservative=torque,
    )


def _stroke(mechanism: AbstractMechanism, angle, kinematics: AbstractKinematics, sense) -> Stroke:
    top, bottom = mechanism.piston_extremes()
    area = mechanism.piston_area
    # rounding must not push the volume below that of the dead centre
    displaced = area * maximum(top - kinematics.position, 0.0)
    return Stroke(angle, displaced, area * (top - bottom), jnp.sign(kinematics.position_1) * sense)


def piston_strokes(compressor: Compressor) -> tuple[Float[Array, "*k"], Float[Array, "*k"]]:
    """[m^2] and [m] Areas and strokes of the pistons, of every cylinder or of all."""
    top, bottom = compressor.mechanism.piston_extremes()
    return compressor.mechanism.piston_area, top - bottom


def stroke_at(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Stroke:
    """Displaced volume and direction of the stroke of each cylinder, (k, *n), at crank angles [rad].

    `sense` is +1 while the crank turns forward, -1 while it turns backward.
    """
    crankshaft = compressor.crankshaft
    mechanism = crankshaft.each(compressor.mechanism, angle)
    own_angle = crankshaft.own_angle(angle)
    return _stroke(mechanism, own_angle, mechanism.kinematics(own_angle), sense)


def cylinder_pressure(
    compressor: Compressor, angle: Float[Array, "*n"], sense=1.0
) -> Float[Array, "k *n"]:
    """Absolute pressure [Pa] in the cylinders, (k, *n), at crank angles [rad]; needs a gas.

    Args:
        compressor: of k cylinders.
        angle: [rad] crank angles, of any shape.
        sense: +1 while the crank turns forward, -1 while it turns backward.
    """
    assert compressor.gas is not None
    gas = compressor.crankshaft.each(compressor.gas, angle)
    return gas.pressure(stroke_at(compressor, angle, sense))


def crank_end_pressure(
    compressor: Compressor, angle: Float[Array, "*n"], sense=1.0
) -> Float[Array, "k *n"] | None:
    """That behind double-acting pistons; `None` for a gas on one side only."""
    if not hasattr(compressor.gas, "crank_end_pressure"):
        return None
    gas: Any = compressor.crankshaft.each(compressor.gas, angle)
    return gas.crank_end_pressure(stroke_at(compressor, angle, sense))


def gas_force(compressor: Compressor, angle: Float[Array, "*n"], sense=1.0) -> Float[Array, "k *n"]:
    """(p - p_back) A [N] of each cylinder at crank angles [rad], positive towards the crank.

    Args:
        compressor: of k cylinders; without a gas the force is zero.
        angle: [rad] crank angles, of any shape.
        sense: +1 while the crank turns forward, -1 while it turns backward.
    """
    return instants(compressor, angle, sense).gas_force


def loads_at(
    compressor: Compressor,
    state: CrankState,
    gas: Float[Array, "k *n"] | None = None,
    evidence: bool = True,
) -> JointLoads:
    """Joint loads of the compressor at given instants.

    `gas` is the gas force [N] where the caller has it already; without `evidence` the residual and
    the margin of the joint loop are left out.
    """
    if gas is None:
        gas = gas_force(compressor, state.angle, jnp.sign(state.speed))
    loop = loop_of(compressor, state, gas)
    return loop.loads(closed(loop.loops), evidence)


def loop_of(
    compressor: Compressor,
    state: CrankState,
    gas: Float[Array, "k *n"],
    kinematics: AbstractKinematics | None = None,
) -> MachineLoops:
    """The joint loops of the compressor at given instants.

    Args:
        compressor: the machine.
        state: angle, speed and acceleration of the crank.
        gas: [N] gas force of each cylinder.
        kinematics: of the linkages at these angles, where the caller has them already.
    """
    crankshaft = compressor.crankshaft
    mechanism = compressor.mechanism
    if kinematics is None:
        own_angle = crankshaft.own_angle(state.angle)
        kinematics = crankshaft.each(mechanism, state.angle).kinematics(own_angle)
    return machine_loops(
        mechanism, compressor.friction, crankshaft, state, gas, compressor.gravity, kinematics
    )


def mechanisms_of(compressor: Compressor) -> list[AbstractMechanism]:
    """The mechanism of every cylinder; cylinders that are alike have one and the same."""
    mechanism = compressor.mechanism
    count = compressor.crankshaft.count
    if not listed(mechanism):
        return [of_cylinder(mechanism)] * count
    return [of_cylinder(mechanism, number) for number in range(1, count + 1)]


def first_top(compressor: Compressor) -> Float[Array, ""]:
    """[rad] Crank angle of the top dead centre of the first cylinder, where the revolution begins."""
    top, _ = compressor.mechanism.dead_centres()
    # The own angle of a cylinder is the crank's plus its phase.
    return jnp.ravel(top)[0] - compressor.crankshaft.phase[0]


def kink_angles(compressor: Compressor) -> Float[Array, " k"]:
    """Crank angles [rad] in one revolution from the top dead centre where torques have kinks, sorted.

    Dead centres, reversals of a sliding direction, valve events and points of tables of every cylinder.
    The first entry is the top dead centre of the first; events that do not occur coincide with a dead
    centre.
    """
    mechanism = compressor.mechanism
    top, bottom = mechanism.dead_centres()
    phase = compressor.crankshaft.distinct_phase
    angles = [bottom]
    tabulated = []
    if not compressor.frictionless:
        angles += list(mechanism.reversals())
    if compressor.gas is not None:
        highest, lowest = mechanism.piston_extremes()
        area = mechanism.piston_area
        for displaced, inward in compressor.gas.valve_events(area * (highest - lowest)):
            angles.append(mechanism.angle_at(highest - displaced / area, inward))
        events = compressor.gas.event_angles()
        if isinstance(events, tuple):
            angles += events
        else:
            tabulated.append(events)
        shares = compressor.gas.event_shares()
        if shares is not None:
            # (k, cylinders) or (k, 1)
            displaced = jnp.atleast_2d(shares).T * (highest - lowest)
            tabulated.append(mechanism.angle_at(highest - displaced, True).T)
            tabulated.append(mechanism.angle_at(highest - displaced, False).T)
    first = jnp.ravel(top)[0] - phase[0]
    own_angles = jnp.stack(
        [jnp.broadcast_to(angle, phase.shape) for angle in (*angles, top)], axis=1
    )
    for events in tabulated:
        own_angles = jnp.concatenate(
            [own_angles, jnp.broadcast_to(events, (phase.size, events.shape[-1]))], axis=1
        )
    # From the angles of each cylinder's own crank to that of the machine.
    crank_angles = (own_angles - phase[:, None]).ravel()
    # the first cylinder's top dead centre is the first edge
    crank_angles = jnp.delete(crank_angles, len(angles), assume_unique_indices=True)
    crank_angles = first + jnp.mod(crank_angles - first, 2 * jnp.pi)
    return jnp.concatenate([first[None], jnp.sort(crank_angles)])
