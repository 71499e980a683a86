"""How motion is integrated in time."""

import diffrax
import equinox as eqx
from jaxtyping import Array, Float

from .._core.arguments import counted

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
