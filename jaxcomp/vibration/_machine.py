r"""The verbs of a rotor for a whole machine: its films under the loads that its own crank gives them.

Each takes a scene or a machine, as `solve_orbit` does, or a rotor model (a `System`) alone, which
then has to know the static load of every film itself.
"""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import rotor
from .._core.arguments import single_number
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import is_any_traced
from ..compressor import Compressor
from ..machine import Assembly, HasMachine, Machine, assembly_of
from ..rotor import BalancingPlanes, Loads, Modes, PeriodicForce, Response, RotorModel
from ..rotor._campbell import critical_speeds_between
from ..rotor._loads import check_loads
from ..rotor._solve import NO_CRANK
from ..rotor._speed_lists import filled, without_filling
from ..rotor._system import System
from ._coupling import crank_loads, loaded_rotor, running_rotor

if TYPE_CHECKING:
    from ..crank import Collocation, Shooting


def rotor_at(
    machine: Machine | HasMachine | RotorModel | System, spin_speeds=()
) -> RotorModel | System:
    """The rotor of what a verb was given, its films under their static loads at these speeds.

    Args:
        machine: a scene, a machine, or a rotor model, which passes as it is.
        spin_speeds: [rad/s] (m,) at which it will be asked; none: films keep open loads.

    Raises:
        BadInput: a machine without a rotor, or films whose load nobody gives.
    """
    if isinstance(machine, RotorModel | System):
        return machine
    assembly = _with_rotor(machine)
    speeds = jnp.ravel(jnp.asarray(spin_speeds, float))
    assert assembly.rotor is not None
    # without a speed nobody asks the films, and no crank is solved for their loads
    if not speeds.size:
        return assembly.rotor
    return loaded_rotor(assembly, speeds)


def excited_orders(loads: Loads) -> tuple[int, ...]:
    """Orders of the spin speed that loads have, the first among them, without the mean."""
    orders = {1}
    for load in loads:
        if isinstance(load, PeriodicForce):
            orders |= set(load.orders)
    # the mean shakes nothing
    return tuple(sorted(orders - {0}))


def respond(
    machine: Machine | HasMachine | RotorModel | System,
    loads: Loads | None = None,
    spin_speeds: Float[Array, " speeds"] | None = None,
    orders: tuple[int, ...] | None = None,
    *,
    excitation: str | None = None,
    crank_solver: "Collocation | Shooting | None" = None,
    **options: Any,
) -> Response:
    """Response of a machine to unbalances and periodic forces at many speeds and orders.

    Args:
        machine: a scene, a machine, or a rotor model.
        loads: unbalances and periodic forces; absent: those of the machine, corrections included.
        spin_speeds: [rad/s] (speeds,); absent: those of the balancing planes, or of the motor.
        orders: orders n of the spin speed; absent: all that are loaded.
        excitation: "file" for the forces that the scene gives, "crank" for those of its crank, which is
            solved at each speed; absent: the scene's if it has any. Without effect beside `loads`.
        crank_solver: of the periodic states that load films and excite the rotor; absent: as in
            `crank_loads`.
        options: `nodes`, `solver` and `batch_size` of `jaxcomp.rotor.respond`.

    Returns:
        Response with the batch (orders, speeds).

    Raises:
        BadInput: no rotor, loads or speeds, another excitation, or what `jaxcomp.rotor.respond` says.

    >>> from jaxcomp import load
    >>> motion = respond(load("hermetic-68cc"), spin_speeds=[314.16], orders=(1,)).checked()
    >>> motion.displacement.shape
    (1, 1, 43, 4)
    """
    if isinstance(machine, RotorModel | System):
        if loads is None or spin_speeds is None:
            missing = "loads" if loads is None else "spin_speeds"
            raise BadInput(missing, "absent", "given, beside a rotor model")
        check_loads(loads)
        return rotor.respond(
            machine, loads, spin_speeds, orders or excited_orders(loads), **options
        )
    assembly = _with_rotor(machine)
    assert assembly.rotor is not None
    if loads is not None:
        check_loads(loads)
    if spin_speeds is None:
        spin_speeds = own_speeds(assembly.balancing, assembly.compressor)
        if spin_speeds is None:
            raise BadInput("spin_speeds", "absent", "given: the machine names no speed of its own")
    speeds = jnp.asarray(spin_speeds, float)
    given_loads = assembly.given_loads
    if loads is None and assembly.excitation(excitation) == "crank":
        return _shaken_by_crank(assembly, speeds, orders or (1,), crank_solver, options)
    if loads is None:
        loads = given_loads
    if not loads:
        raise BadInput("loads", "absent", "given: nothing excites this rotor")
    model = loaded_rotor(assembly, speeds, crank_solver)
    return rotor.respond(model, loads, speeds, orders or excited_orders(loads), **options)


def _shaken_by_crank(assembly: Assembly, speeds, orders, solver, options) -> Response:
    if speeds.ndim != 1 or not speeds.size:
        raise BadInput("spin_speeds", speeds, "a list of speeds")
    count = speeds.size
    if not is_any_traced(assembly, speeds):
        speeds = filled(speeds)
    response = _shaken_at_speeds(assembly, speeds, orders, solver, options)
    if speeds.size > count:
        response = without_filling(response, count, axis=1)
    return response


@kept_jit
def _shaken_at_speeds(assembly, speeds, orders, solver, options):
    # Each speed has films and forces of its own, so that a batch of rotors is solved at one speed each,
    # where `rotor.respond` has one rotor at all of them.
    def at(speed):
        crank = crank_loads(assembly, speed, orders, solver)
        model, loads = running_rotor(assembly, crank)
        response = rotor.respond(model, loads, speed[None], orders, **options)
        # However well it is solved: without a periodic state its forces mean nothing.
        trusted = jnp.where(crank.ok, response.status, NO_CRANK)
        return eqx.tree_at(lambda r: r.status, response, trusted)

    response = jax.vmap(at)(speeds)
    # from (speeds, orders, 1, ...) to (orders, speeds, ...), as a response of one rotor has it
    return jax.tree.map(lambda leaf: jnp.moveaxis(leaf[:, :, 0], 0, 1), response)


def undamped_modes(
    machine: Machine | HasMachine | RotorModel | System,
    count: int = 12,
    *,
    spin_speed=0.0,
    free: bool = False,
) -> Modes:
    """The lowest undamped modes of a scene, a machine or a rotor, see `jaxcomp.rotor.undamped_modes`.

    Args:
        machine: a scene, a machine, or a rotor model.
        count: of modes.
        spin_speed: [rad/s] at which the films stand.
        free: without the links to the ground.
    """
    film_speeds: Any = spin_speed
    # Without links there are no films, and no crank has to be solved for their loads.
    if free:
        film_speeds = ()
    model = rotor_at(machine, film_speeds)
    return rotor.undamped_modes(model, count, spin_speed=spin_speed, free=free)


def damped_modes(
    machine: Machine | HasMachine | RotorModel | System,
    spin_speed,
    count: int = 12,
    **options: Any,
) -> rotor.DampedModes:
    """The lowest damped modes of a scene, a machine or a rotor, see `jaxcomp.rotor.damped_modes`.

    Args:
        machine: a scene, a machine, or a rotor model.
        spin_speed: [rad/s]
        count: of modes.
        options: of `jaxcomp.rotor.damped_modes`.

    Raises:
        BadInput: as `jaxcomp.rotor.damped_modes`.
    """
    # refused before the crank is solved for the loads of the films
    spin_speed = single_number("spin_speed", spin_speed)
    film_speeds: Any = spin_speed
    # as in `undamped_modes`: without links no crank has to be solved
    if options.get("free", False):
        film_speeds = ()
    return rotor.damped_modes(rotor_at(machine, film_speeds), spin_speed, count, **options)


def rotor_modes(
    machine: Machine | HasMachine | RotorModel,
    spin_speeds: Float[Array, " s"],
    count: int = 12,
    *,
    over: Float[Array, " r"] | None = None,
    free: bool = False,
    damping: bool = True,
) -> rotor.RotorModes:
    """The lowest damped modes of a rotor at some speeds, and over a range of them.

    Args:
        machine: a scene, a machine, or a rotor model.
        spin_speeds: [rad/s] (s,)
        count: of modes.
        over: [rad/s] (r,) rising speeds of a Campbell diagram with its critical speeds.
        free: without links and magnetic pull.
        damping: false leaves out all damping.

    Raises:
        BadInput: a machine without a rotor, or as `jaxcomp.rotor.damped_modes`.

    >>> from jaxcomp import load
    >>> modes = rotor_modes(load("hermetic-68cc"), [314.16], 3)
    >>> for mode in modes.listed(0):
    ...     print(f"{mode.frequency:.3g} rad/s, {mode.subset}")
    28.2 rad/s, rotor
    28.5 rad/s, rotor
    92.6 rad/s, housing
    """
    film_speeds: Any = ()
    if not free:
        speeds = [spin_speeds]
        if over is not None:
            speeds.append(over)
        # one table of film loads for the points and the diagram, so that both show the same rotor
        film_speeds = np.unique(np.concatenate(speeds))
    model = rotor_at(machine, film_speeds)
    assert isinstance(model, RotorModel)
    point_modes = []
    for speed in spin_speeds:
        modes = rotor.damped_modes(model, speed, count, free=free, damping=damping)
        point_modes.append(modes)
    diagram = None
    if over is not None:
        diagram_modes = rotor.campbell(model, over, count, damping=damping)
        critical = critical_speeds_between(
            model, over, count, damping=damping, diagram=diagram_modes
        )
        diagram = rotor.CampbellDiagram(np.asarray(over), diagram_modes, critical)
    return rotor.RotorModes(
        model, np.asarray(spin_speeds), tuple(point_modes), free, damping, diagram
    )


def _with_rotor(machine: Machine | HasMachine | Assembly) -> Assembly:
    assembly = assembly_of(machine)
    if assembly.rotor is None:
        raise BadInput("rotor", "absent", "given, for the vibration of a machine")
    return assembly


def own_speeds(balancing: BalancingPlanes | None, compressor: Compressor | None):
    """[rad/s] (m,) Speeds that a machine runs at: of its balancing planes or its motor; `None` if neither
    names one.
    """
    if balancing is not None:
        return balancing.speeds
    # a motor by its torque curve has no speed before the balance of torques is solved
    mean = getattr(getattr(compressor, "motor", None), "mean_speed", None)
    if mean is None:
        return None
    return jnp.reshape(mean, (1,))
