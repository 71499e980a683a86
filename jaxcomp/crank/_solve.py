"""`solve_orbit`: the periodic state, by either solver."""

import equinox as eqx
import jax.numpy as jnp

from .._fields import admissible, clipped, is_traced
from .._status import SolveFailed, Status
from ..compressor import Compressor
from ._collocation import Collocation
from ._orbit import Orbit
from ._shooting import Shooting


def solve_orbit(
    compressor: Compressor, solver: Shooting | Collocation | None = None, *, throw: bool = True
) -> Orbit:
    """Find the periodic state of the crank.

    Args:
        compressor: the machine.
        solver: options of the solver, `Shooting()` if absent. `Collocation()` solves the whole turn
            at once and is much faster, above all in batches.
        throw: raise if no periodic state was found. Within `jit`, `vmap` or `grad` nothing is
            raised; look at `status` there.

    Returns:
        The orbit with its energy account and its evidence. A design that is out of bounds, that
        locks or that stalls has finite numbers and a status that says so.

    Raises:
        SolveFailed: if `throw` and the status is not `Status.converged`.
    """
    solver = Shooting() if solver is None else solver
    orbit = _solve(compressor, solver)
    if throw and not is_traced(orbit.status._value):
        failed = orbit.status != Status.converged
        if bool(jnp.any(failed)):
            raise SolveFailed(
                orbit.status,
                f"residual {float(orbit.residual):.2g} after {int(orbit.iterations)} iterations, "
                f"joint margin {float(orbit.margin):.3g}",
            )
    return orbit


@eqx.filter_jit
def _solve(compressor: Compressor, solver: Shooting | Collocation) -> Orbit:
    good = admissible(compressor)
    orbit = solver.solve(clipped(compressor))
    status = Status.where(orbit.margin > 0, orbit.status, Status.self_locking)
    status = Status.where(good, status, Status.bad_input)
    return eqx.tree_at(lambda o: o.status, orbit, status)
