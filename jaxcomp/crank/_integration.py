"""How motion is integrated: in time, and through a revolution over the crank angle."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.arguments import counted
from .._core.extremes import clip
from .._core.lookup import interval_of
from ..compressor import Compressor
from ..mechanism import CrankState
from ._crank_motion import Instantaneous
from ._journals import journal_drive

# Their course is kept: some hundred bytes a step.
MOST_STEPS = 2**22


class TimeIntegration(eqx.Module):
    """Options of the time integration.

    Attributes:
        solver: any solver of diffrax; an implicit one (`diffrax.Kvaerno5()`) for a regularised law
            with a narrow transition, a stiff motor or journals that move in their films. Cylinders with
            valves are always marched by Dormand and Prince's method, with located events.
        tolerance: [-] relative and absolute tolerance of a step, in units of the motor's running
            speed and of the kinetic energy there; a radian for the angle. Given as an array, all
            tolerances share one compiled program.
        max_steps: steps after which the result is marked as not converged.
        samples: instants at which the result is listed; `Transient.at` gives any other.
        progress: show a progress bar on the terminal.
        adjoint: how diffrax differentiates.
    """

    solver: diffrax.AbstractSolver = eqx.field(default_factory=diffrax.Tsit5)
    tolerance: float | Float[Array, ""] = 1e-8
    max_steps: int = eqx.field(static=True, default=65536)
    samples: int = eqx.field(static=True, default=2001)
    progress: bool = eqx.field(static=True, default=False)
    adjoint: diffrax.AbstractAdjoint = eqx.field(default_factory=diffrax.RecursiveCheckpointAdjoint)

    def __check_init__(self):
        counted("max_steps", self.max_steps, high=MOST_STEPS)
        counted("samples", self.samples, 2, 10**7)


def rates_over_angle(
    compressor: Compressor, motion: Instantaneous, speed, torques, journals, units
):
    """[1/rad] How speed, time, works and positions of journals change with the crank angle.

    Args:
        compressor: the machine.
        motion: its equation of motion, solved.
        speed: [rad/s] of the crank.
        torques: [N m] whose works are counted.
        journals: [-] (2, k) positions of those that move; `None` without any.
        units: [rad/s] and [J] of speed and works; the time is counted in the inverse of the first.
    """
    rates = {
        "speed": motion.acceleration / speed / units[0],
        "time": units[0] / speed,
        "work": jax.tree.map(lambda torque: torque / units[1], torques),
    }
    if journals is not None:
        state = CrankState(motion.at.angle, speed, motion.acceleration)
        rates["journals"] = journal_drive(compressor, motion.loads.forces, state).rate(journals)
    return rates


def inside_panels(edges: Float[Array, " k"], place: Float[Array, "*n"], moved=None):
    """Crank angle [rad] that belongs to a place between edges that `moved` [rad], and its rate [-].

    A place is first moved off the edges of its panel by more than rounding, because a stage on an edge
    would take the formula of either side, its directions and phases, at random.
    """
    panel = interval_of(edges, place)
    start = edges[panel]
    end = edges[panel + 1]
    at = clip(place, start + 1e-10, end - 1e-10)
    if moved is None:
        return at, jnp.ones(())
    wide = end > start
    moved_width = moved[panel + 1] - moved[panel]
    # Double where: a panel of no width would put 0/0 into the derivatives of the others.
    rate = jnp.where(wide, moved_width / jnp.where(wide, end - start, 1), 1)
    return moved[panel] + (at - start) * rate, rate
