r"""Influence coefficients of a machine that its own crank shakes.

None of the seed papers couples the two: at every speed the periodic state of the crank gives the
Fourier coefficients of the forces and, by the mean force, stiffness and damping of the films.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._fields import BadInput, replaced
from .._words import one_of
from ..compressor import Compressor
from ..crank import Collocation, Shooting, solve_orbit
from ..motor import ConstantSpeed, MeanSpeed
from ..rotor import (
    BalancingPlanes,
    LoadCase,
    PeriodicForce,
    RotorModel,
    Unbalances,
    crank_forces,
    loaded_films,
)
from ._influence import Influence, flexibility, influence_of


def at_speed(compressor: Compressor, speed: Float[Array, ""]) -> Compressor:
    """The compressor held at a mean speed [rad/s], whatever its motor."""
    motor = compressor.motor
    if isinstance(motor, MeanSpeed | ConstantSpeed):
        return replaced(compressor, motor=replaced(motor, mean_speed=speed))
    held = replaced(MeanSpeed(1.0), mean_speed=jnp.asarray(speed, float))
    return replaced(compressor, motor=held)


# What the crank's forces may do without.
LEAVABLE = ("gas", "inertia", "friction", "fluctuation")


def without(compressor: Compressor, left_out: tuple[str, ...]) -> Compressor:
    """The compressor without some of what makes its forces, to see what each of them is worth.

    Args:
        compressor: with a slider-crank.
        left_out: "gas"; "inertia" (of piston and rod); "friction"; "fluctuation" (of the speed,
            by a flywheel a million times as heavy).

    Raises:
        BadInput: another word.
    """
    for word in left_out:
        if word not in LEAVABLE:
            raise BadInput("without", word, one_of(word, LEAVABLE))
    mechanism = compressor.mechanism
    if "inertia" in left_out:
        # Their bounds leave out zero; a millionth is as good.
        names = ("piston_mass", "conrod_mass", "conrod_inertia")
        mechanism = replaced(mechanism, **{n: 1e-6 * getattr(mechanism, n) for n in names})
    if "fluctuation" in left_out:
        mechanism = replaced(mechanism, crank_inertia=1e6 * mechanism.crank_inertia)
    changed = replaced(compressor, mechanism=mechanism)
    for word in ("gas", "friction"):
        if word in left_out and getattr(changed, word) is not None:
            changed = eqx.tree_at(lambda c, word=word: getattr(c, word), changed, None)
    return changed


def crank_case(
    compressor: Compressor,
    model: RotorModel,
    case: LoadCase,
    speed: Float[Array, ""],
    orders: tuple[int, ...] = (1,),
    solver: Collocation | Shooting | None = None,
    left_out: tuple[str, ...] = (),
) -> tuple[RotorModel, tuple[Unbalances | PeriodicForce, ...], Bool[Array, ""]]:
    """Model and loads at one speed, from the periodic state of the crank there.

    Args:
        compressor: with a slider-crank; its motor gives way to the speed.
        model: the rotor.
        case: its unbalances stay; its forces give way to those of the crank.
        speed: [rad/s] mean speed.
        orders: harmonics of the forces.
        solver: of the periodic state.
        left_out: see `without`; the films keep the mean force of the whole machine.

    Returns:
        The model with its films under the mean force of the rod, the loads, and whether the
        periodic state converged.
    """
    assert case.crank is not None
    whole = at_speed(compressor, speed)
    forces, converged = _forces(whole, case.crank, orders, solver)
    loaded = loaded_films(model, case.crank, forces)
    if left_out:
        forces, also = _forces(without(whole, left_out), case.crank, orders, solver)
        converged &= also
    return loaded, (*case.unbalances, *forces.forces), converged


def _forces(machine, nodes, orders, solver):
    orbit = solve_orbit(machine, solver, throw=False)
    kept = tuple(dict.fromkeys((0, *orders)))
    return crank_forces(machine, orbit, nodes, orders=kept), orbit.converged


def crank_influence(
    compressor: Compressor,
    model: RotorModel,
    case: LoadCase,
    places: BalancingPlanes,
    speeds: Float[Array, " speeds"] | None = None,
    solver: Collocation | Shooting | None = None,
    left_out: tuple[str, ...] = (),
) -> Influence:
    """Influence coefficients at order 1 with the crank's own forces, differentiable end to end.

    Args:
        compressor: with a slider-crank; its motor gives way to the speeds.
        model: rotor, crankcase and housing.
        case: unbalances, and where the forces of the crank act.
        places: correction planes and targets.
        speeds: [rad/s] those of `places` if absent.
        solver: of the periodic state.
        left_out: see `without`.
    """
    speeds = jnp.atleast_1d(jnp.asarray(places.speeds if speeds is None else speeds, float))
    answer = _answers(compressor, model, case, places, speeds, solver, left_out)
    return influence_of(answer, places, speeds)


@eqx.filter_jit
def _answers(compressor, model, case, places, speeds, solver, left_out):
    def at(speed):
        loaded, loads, _ = crank_case(compressor, model, case, speed, (1,), solver, left_out)
        return flexibility(loaded, loads, places, speed)

    return jax.vmap(at)(speeds).reshape(-1, 1 + len(places.planes))
