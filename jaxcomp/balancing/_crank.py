"""Influence coefficients of a machine whose films, and perhaps loads, its own crank sets.

None of the seed papers couples the two: at every speed the periodic state of the crank gives the
Fourier coefficients of the forces and, by the mean force, stiffness and damping of the films.
"""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from .._fields import BadInput
from ..coupling import CrankLoads, crank_loads, running_rotor
from ..crank import Collocation
from ..machine import Assembly, assembled, machine_of
from ..rotor import BalancingPlanes
from ._influence import Influence, flexibility, influence_of

if TYPE_CHECKING:
    from ..crank import Shooting


def machine_influence(
    machine: Any,
    speeds: Float[Array, " speeds"] | None = None,
    solver: "Collocation | Shooting | None" = None,
    *,
    crank: bool = True,
    left_out: tuple[str, ...] = (),
) -> Influence:
    """Influence coefficients at order 1 of a whole machine, differentiable end to end.

    Args:
        machine: a scene or a machine with rotor, loads and balancing planes; its corrections count.
        speeds: [rad/s] those of the balancing planes if absent.
        solver: of the periodic state.
        crank: take the forces of the crank in the place of those that the scene gives.
        left_out: what the crank's forces do without, see `jaxcomp.coupling.without`.

    Raises:
        BadInput: a part that is missing.
    """
    made = machine if isinstance(machine, Assembly) else assembled(machine_of(machine))
    places = made.balancing
    if made.rotor is None or made.loads is None or places is None or not places.planes:
        raise BadInput("balancing", "absent", "given with rotor, loads and correction planes")
    speeds = jnp.atleast_1d(jnp.asarray(places.speeds if speeds is None else speeds, float))
    answer = _answers(made, places, speeds, solver, crank, left_out)
    return influence_of(answer, places, speeds)


@eqx.filter_jit
def _answers(made, places, speeds, solver, crank, left_out):
    def at(speed):
        return crank_loads(made, speed, (1,), solver, crank=crank, left_out=left_out)

    return flexibilities(made, jax.vmap(at)(speeds), places, speeds)


def flexibilities(
    machine: Assembly, loads: CrankLoads, places: BalancingPlanes, speeds: Float[Array, " speeds"]
) -> Complex[Array, "rows columns"]:
    """[m], [m/(kg m)] Motion of the targets by the loads and by each plane's unit, at all speeds.

    Args:
        machine: put together.
        loads: of the crank, with the speeds along a leading axis.
        places: correction planes and targets.
        speeds: [rad/s]
    """

    def at(one, speed):
        return flexibility(*running_rotor(machine, one), places, speed)

    return jax.vmap(at)(loads, speeds).reshape(-1, 1 + len(places.planes))
