"""`solve_orbit`: the periodic state, by either solver.

Of a machine with valves pressure and speed follow each from the other, see `_cycle_coupling`.
"""

import dataclasses
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .._core.exported import kept_jit
from .._core.extremes import max_of
from .._core.fields import admissible, clipped, is_any_traced, is_traced, replaced
from .._core.roots import frozen
from .._core.status import SolveFailed, Status, ended_in
from ..compressor import Compressor, HasCompressor, compressor_of
from ..cylinder import CycleOptions, Cylinder
from ..cylinder._climb import climbed, evidence, raise_where_unsolved
from ..cylinder._ends import options_of, with_settings
from ..cylinder._several import of_each
from ..cylinder._waves import is_piped
from ._collocation import Collocation, default_collocation
from ._cycle_coupling import MAX_ITERATIONS, orbit_with_cylinder
from ._films import has_thin_film
from ._orbit import Orbit, Verification

if TYPE_CHECKING:
    from ._integration import TimeIntegration
    from ._shooting import Shooting

# [-] Resolution beyond which a revolution is not resolved. Seen at a conrod ratio of 0.95 without
# edges at the load reversals: 0.21 with 5 nodes on a panel, the fluctuation 3.9 % off; 0.06 with 8,
# 0.8 % off.
_COARSE = 0.1
# [-] Residual of the joint loop, of the work over a revolution, and estimated error of the losses over
# the work of the motor, beyond which nothing counts as solved: rounding, 1e-9 and 1e-7 are usual.
_JOINT_RESIDUAL = 1e-6
_ENERGY_RESIDUAL = 1e-5
_LOSS_ERROR = 1e-2
# [-] Margin of the joints below which a failure is put down to the lock that is near: of the machine of
# Tsuji et al. with more and more friction at the wall the iterations grow from 21 at a margin of 0.12 to
# 104 at 0.017, and the error of the losses from 2e-4 to 6e-3; at 0.009 it is 1e-2.
_NEAR_LOCKING = 0.05


def solve_orbit(
    machine: Compressor | HasCompressor,
    solver: "Shooting | Collocation | None" = None,
    *,
    verify: "bool | TimeIntegration" = False,
    throw: bool = True,
) -> Orbit:
    """Find the periodic state of the crank.

    Args:
        machine: a compressor, a machine or a scene.
        solver: options of the solver. If absent, `default_collocation`: the whole revolution at once,
            with panel edges for as many load reversals as the mechanism has. `Shooting()` integrates it
            with diffrax and shares no more than the laws, at many times the cost.
        verify: march one revolution from the found state with diffrax, independently of the solver:
            `orbit.verification` then has the error of speed, losses, efficiency and peaks. `True` takes
            `diffrax.Dopri8` at 1e-12; for a stiff motor or a narrow transition of friction give
            `TimeIntegration(diffrax.Kvaerno5())`. Of a cylinder the pressure that was found is taken
            as given.
        throw: raise if no periodic state was found. Within `jit` and `vmap` a machine with valves whose
            cycle was not found raises when the program runs, any of a batch; other machines do not
            raise there. `throw=False` leaves it to `status`.

    Returns:
        The orbit with its energy account and its evidence. A design that is out of bounds, that
        locks or that stalls has finite numbers and a status that says so.

    Raises:
        SolveFailed: if `throw` and the status is not `Status.converged`, or the march did not end.

    >>> from jaxcomp import load
    >>> orbit = solve_orbit(load("mayekawa-wbhe"))
    >>> print(f"{100 * orbit.mechanical_efficiency:.2f} %, {orbit.motor_power / 1e3:.2f} kW")
    91.17 %, 5.66 kW
    >>> bool(orbit.converged), bool(abs(orbit.energy.residual) < 1e-9)
    (True, True)
    """
    compressor = compressor_of(machine)
    if isinstance(compressor.gas, Cylinder):
        gas = with_settings(compressor.gas, compressor.crankshaft.count)
        compressor = replaced(compressor, gas=gas)
    if solver is None:
        solver = default_collocation(compressor)
    values = frozen(compressor)
    if is_any_traced(values):
        # within a program that is traced anyway, one of its own would be traced twice for derivatives
        orbit = _solve_traced(compressor, solver)
        if throw and orbit.cycle is not None:
            raise_where_unsolved(orbit.cycle, _cycle_options(compressor, solver))
    else:
        orbit = _orbit_outside(compressor, values, solver, throw)
    if verify is False:
        return orbit
    from ._verify import march_options

    if verify is True:
        verify = march_options()
    orbit = eqx.tree_at(
        lambda o: o.verification,
        orbit,
        _verification(compressor, orbit, verify),
        is_leaf=lambda leaf: leaf is None,
    )
    status = orbit.verification.status
    if throw and not is_traced(status._value) and bool(jnp.any(status != Status.converged)):
        raise SolveFailed(
            status,
            f"the march that verifies the orbit did not end within {verify.max_steps} steps; take "
            "verify=TimeIntegration(diffrax.Kvaerno5(), tolerance=1e-8)",
        )
    return orbit


def _orbit_outside(compressor: Compressor, values: Compressor, solver, throw: bool) -> Orbit:
    """The orbit outside of traced programs, in the size of the cycle that the machine needs.

    Args:
        compressor: perhaps with derivatives.
        values: without.
        solver: of the orbit.
        throw: raise if no periodic state was found.
    """
    with_derivatives = is_any_traced(compressor)
    if not isinstance(compressor.gas, Cylinder):
        orbit = _solve_compiled(compressor, solver)
        if throw:
            _raise_if_failed(orbit, solver)
        return orbit

    def solve(cycle_options):
        return _solve_compiled(values, dataclasses.replace(solver, cycle=cycle_options))

    may_march = not is_piped(compressor.gas)
    orbit, cycle_options = climbed(solve, _cycle_options(values, solver), may_march)
    solver = dataclasses.replace(solver, cycle=cycle_options)
    if throw:
        _raise_if_failed(orbit, solver)
    if not with_derivatives:
        return orbit
    return _solve_compiled(compressor, solver, orbit)


def _cycle_options(compressor: Compressor, solver) -> CycleOptions:
    """Options of the cycle of a machine with valves, by the cylinders that are solved together."""
    assert isinstance(compressor.gas, Cylinder)
    return options_of(compressor.gas, compressor.crankshaft.count, solver.cycle)


def _raise_if_failed(orbit: Orbit, solver) -> None:
    """Raise with what is known of an orbit that was not found."""
    status = orbit.status
    if is_traced(status._value):
        # since its orbit has derivatives; a whole number cannot be taken out of their trace
        code = frozen(jnp.asarray(status._value, float))
        if is_traced(code):
            return
        status = eqx.tree_at(lambda s: s._value, status, code.astype(jnp.int32))
    if np.all(ended_in(status, Status.converged)):
        return
    if orbit.cycle is not None and not bool(of_each(orbit.cycle).converged.all()):
        raise SolveFailed(status, evidence(orbit.cycle, solver.cycle), orbit)
    values = frozen(orbit)
    crank_is_solved = float(values.residual) < _JOINT_RESIDUAL
    if values.cycle is not None and crank_is_solved and bool(status == Status.not_converged):
        raise SolveFailed(
            status,
            f"pressure and speed of the crank did not agree within {MAX_ITERATIONS} iterations: the "
            f"speed fluctuates by {100 * float(values.speed_fluctuation):.3g} % of its mean; more "
            "inertia of the crankshaft or a higher speed makes it steadier",
            orbit,
        )
    worst = values.weakest_cylinder
    where = ""
    if worst is not None:
        where = f" in cylinder {int(worst)}"
    raise SolveFailed(
        status,
        f"residual {float(values.residual):.2g} after {int(values.iterations)} iterations, "
        f"joint margin {float(values.margin):.3g}{where}, energy open by "
        f"{float(values.energy.residual):.2g}, losses known to "
        f"{float(values.efficiency_error):.2g} of the work",
        orbit,
    )


def _solve_traced(
    compressor: Compressor, solver: "Shooting | Collocation", followed_orbit: Orbit | None = None
) -> Orbit:
    """The orbit of what may be out of bounds, which its status says; see `_checked_orbit`."""
    good = admissible(compressor)
    orbit = _checked_orbit(clipped(compressor), solver, followed_orbit)
    status = orbit.status
    failed = (status == Status.unresolved) | (status == Status.not_converged)
    failed |= status == Status.stalled  # as losses beyond all bounds look
    # A later status is nearer to the cause: joints that lock explain a failure, a number out of bounds
    # explains both.
    near = failed & (orbit.margin < _NEAR_LOCKING)
    status = Status.where(near, Status.near_locking, status)
    status = Status.where(orbit.margin <= 0, Status.self_locking, status)
    status = Status.where(good, status, Status.bad_input)
    return eqx.tree_at(lambda o: o.status, orbit, status)


_solve_compiled = kept_jit(_solve_traced)


@kept_jit
def _verification(compressor: Compressor, orbit: Orbit, options: "TimeIntegration") -> Verification:
    from ._verify import verification

    return verification(orbit.under_gas(clipped(compressor)), orbit, options)


def _checked_orbit(
    compressor: Compressor, solver: "Shooting | Collocation", followed_orbit: Orbit | None = None
) -> Orbit:
    """The orbit with the checks that hold for every motor and solver.

    Args:
        compressor: admissible.
        solver: of the orbit.
        followed_orbit: the orbit of a machine with valves, which is not searched for then.
    """
    if isinstance(compressor.gas, Cylinder):
        orbit = orbit_with_cylinder(compressor, solver, followed_orbit=followed_orbit)
    else:
        orbit = solver.solve(compressor)
    values: Orbit = lax.stop_gradient(orbit)
    # what everything else is made of, so that a number that nobody asks for is not computed
    leaves = jax.tree.leaves(
        (values.state, values.loads.forces, values.loads.loss_torque, values.energy)
    )
    finite = jnp.isfinite(sum(jnp.sum(leaf) for leaf in leaves))
    assert values.loads.residual is not None
    # the loop of the joints closes with the motion, to the tolerance that was asked for
    joints = max_of(jnp.abs(values.loads.residual)) <= _JOINT_RESIDUAL + 10 * solver.tolerance
    coarse = values.resolution > _COARSE
    coarse |= ~(jnp.abs(values.energy.residual) <= _ENERGY_RESIDUAL)
    if getattr(solver, "estimate", True):
        coarse |= ~(values.efficiency_error <= _LOSS_ERROR)
        if values.gas_work_error is not None:
            size = jnp.abs(values.energy.gas_work) + values.energy.total_loss
            coarse |= values.gas_work_error > _LOSS_ERROR * size
    good = orbit.status == Status.converged
    thin = has_thin_film(compressor, values)
    status = Status.where(good & thin, Status.thin_film, orbit.status)
    status = Status.where(good & coarse, Status.unresolved, status)
    status = Status.where(good & ~(finite & joints), Status.not_converged, status)
    return eqx.tree_at(lambda o: o.status, orbit, status)
