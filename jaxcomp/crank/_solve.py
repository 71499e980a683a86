"""`solve_orbit`: the periodic state, by either solver."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from .._fields import BadInput, admissible, clipped, is_traced
from .._status import SolveFailed, Status
from ..compressor import Compressor, compressor_of
from ..cylinder import Cylinder
from ._collocation import Collocation, default_collocation
from ._cylinder import solve_with_cylinder
from ._orbit import Orbit, Verification

if TYPE_CHECKING:
    from ._shooting import Shooting
    from ._transient import TimeIntegration

# [-] Resolution beyond which a revolution is not resolved. Seen at a conrod ratio of 0.95 without
# edges at the load reversals: 0.21 with 5 nodes on a panel, the fluctuation 3.9 % off; 0.06 with 8,
# 0.8 % off.
_COARSE = 0.1
# [-] Residual of the joint loop, of the work over a revolution, and estimated error of the losses over
# the work of the motor, beyond which nothing counts as solved: rounding, 1e-9 and 1e-7 are usual.
_JOINT_RESIDUAL = 1e-6
_ENERGY_RESIDUAL = 1e-5
_LOSS_ERROR = 1e-2


def solve_orbit(
    machine: Any,
    solver: "Shooting | Collocation | None" = None,
    *,
    verify: "bool | TimeIntegration" = False,
    throw: bool = True,
) -> Orbit:
    """Find the periodic state of the crank.

    Args:
        machine: a compressor, a machine or a scene.
        solver: options of the solver. If absent, `default_collocation`: the whole revolution at once,
            with panel edges for as many load reversals as the mechanism has; of several cylinders
            without, to 1e-6 in efficiency, and `Collocation(reversals=compressor.load_reversals)` has
            these as well. `Shooting()` integrates it
            with diffrax and shares no more than the laws, at many times the cost.
        verify: march one revolution from the found state with diffrax, independently of the solver:
            `orbit.verification` then has the error of speed, losses, efficiency and peaks. `True` takes
            `diffrax.Dopri8` at 1e-12; for a stiff motor or a narrow transition of friction give
            `TimeIntegration(diffrax.Kvaerno5())`. Of a cylinder the pressure that was found is taken
            as given.
        throw: raise if no periodic state was found. Within `jit`, `vmap` or `grad` nothing is
            raised; look at `status` there.

    Returns:
        The orbit with its energy account and its evidence. A design that is out of bounds, that
        locks or that stalls has finite numbers and a status that says so.

    Raises:
        BadInput: several cylinders with valves that share plenums.
        SolveFailed: if `throw` and the status is not `Status.converged`, or the march did not end.

    >>> from jaxcomp import load
    >>> orbit = solve_orbit(load("mayekawa-wbhe"))
    >>> print(f"{100 * orbit.mechanical_efficiency:.2f} %, {orbit.motor_power / 1e3:.2f} kW")
    91.17 %, 5.66 kW
    >>> bool(orbit.converged), bool(abs(orbit.energy.residual) < 1e-9)
    (True, True)
    """
    compressor = compressor_of(machine)
    if solver is None:
        solver = default_collocation(compressor)
    # within a program that is traced anyway, a program of its own would be traced twice for derivatives
    traced = any(is_traced(leaf) for leaf in jax.tree.leaves(compressor))
    orbit = (_solved if traced else _solve)(compressor, solver)
    if throw and not is_traced(orbit.status._value):
        failed = orbit.status != Status.converged
        if bool(jnp.any(failed)):
            worst = orbit.weakest_cylinder
            where = "" if worst is None else f" in cylinder {int(worst)}"
            raise SolveFailed(
                orbit.status,
                f"residual {float(orbit.residual):.2g} after {int(orbit.iterations)} iterations, "
                f"joint margin {float(orbit.margin):.3g}{where}, energy open by "
                f"{float(orbit.energy.residual):.2g}, losses known to "
                f"{float(orbit.efficiency_error):.2g} of the work",
            )
    if verify is False:
        return orbit
    from ._verify import march_options

    options = march_options() if verify is True else verify
    orbit = eqx.tree_at(
        lambda o: o.verification,
        orbit,
        _verification(compressor, orbit, options),
        is_leaf=lambda leaf: leaf is None,
    )
    status = orbit.verification.status
    if throw and not is_traced(status._value) and bool(jnp.any(status != Status.converged)):
        raise SolveFailed(
            status,
            f"the march that verifies the orbit did not end within {options.max_steps} steps; take "
            "verify=TimeIntegration(diffrax.Kvaerno5(), tolerance=1e-8)",
        )
    return orbit


def _solved(compressor: Compressor, solver: "Shooting | Collocation") -> Orbit:
    good = admissible(compressor)
    orbit = _orbit(clipped(compressor), solver)
    status = Status.where(orbit.margin > 0, orbit.status, Status.self_locking)
    status = Status.where(good, status, Status.bad_input)
    return eqx.tree_at(lambda o: o.status, orbit, status)


_solve = eqx.filter_jit(_solved)


@eqx.filter_jit
def _verification(compressor: Compressor, orbit: Orbit, options: "TimeIntegration") -> Verification:
    from ._verify import verification

    return verification(orbit.under_gas(clipped(compressor)), orbit, options)


def _orbit(compressor: Compressor, solver: "Shooting | Collocation") -> Orbit:
    """The orbit with the checks that hold for every motor and solver."""
    if isinstance(compressor.gas, Cylinder):
        if compressor.cylinders is not None and compressor.gas.plenums:
            which = "suction" if compressor.gas.suction.plenums else "discharge"
            bound = (
                "absent beside several cylinders: only `simulate` follows plenums that they share"
            )
            raise BadInput(f"gas.{which}.plenums", len(compressor.gas.plenums), bound)
        orbit = solve_with_cylinder(compressor, solver)
    else:
        orbit = solver.solve(compressor)
    seen: Orbit = lax.stop_gradient(orbit)
    # what everything else is made of, so that a number that nobody asks for is not computed
    leaves = jax.tree.leaves((seen.state, seen.loads.forces, seen.loads.loss_torque, seen.energy))
    finite = jnp.isfinite(sum(jnp.sum(leaf) for leaf in leaves))
    assert seen.loads.residual is not None
    # the loop of the joints closes with the motion, to the tolerance that was asked for
    joints = jnp.max(jnp.abs(seen.loads.residual)) <= _JOINT_RESIDUAL + 10 * solver.tolerance
    coarse = seen.resolution > _COARSE
    coarse |= ~(jnp.abs(seen.energy.residual) <= _ENERGY_RESIDUAL)
    if getattr(solver, "estimate", True):
        coarse |= ~(seen.efficiency_error <= _LOSS_ERROR)
    good = orbit.status == Status.converged
    status = Status.where(good & coarse, Status.unresolved, orbit.status)
    status = Status.where(good & ~(finite & joints), Status.not_converged, status)
    return eqx.tree_at(lambda o: o.status, orbit, status)
