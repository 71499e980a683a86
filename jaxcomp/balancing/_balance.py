"""What a balancing method hands back: the corrections with the evidence for them."""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from .._results import Data, Result
from .._status import Status
from ._influence import Influence


def balance(
    influence: Influence,
    correction: Complex[Array, " planes"],
    objective: Float[Array, ""],
    bound: Float[Array, ""],
    method: str,
    failure: Status | None = None,
    scale: Float[Array, ""] | None = None,
) -> "Balance":
    """A balance with its status; corrections are NaN where the numbers of the system are not finite.

    Args:
        influence, correction, objective, bound, method, scale: as in `Balance`.
        failure: what the method says of its end; converged if absent.
    """
    finite = jnp.all(jnp.isfinite(correction)) & jnp.isfinite(objective)
    status = Status.where(
        finite, Status.converged if failure is None else failure, Status.bad_input
    )
    correction = jnp.where(finite, correction, jnp.nan)
    return Balance(influence, correction, objective, bound, method, status, scale)


def condition(matrix: Complex[Array, "rows planes"]) -> Float[Array, ""]:
    """[-] Ratio of the largest to the smallest singular value; infinite for a singular matrix."""
    values = jnp.linalg.svd(matrix, compute_uv=False)
    return values[0] / values[-1]


class Balance(Result, eqx.Module):
    """Corrections and what they do.

    Attributes:
        influence: the system that was balanced.
        correction: [kg m] (planes,) unbalance to add, mass times radius with its angle.
        bound: [m] a value that no admissible correction can get below, in the norm of the method
            (`objective`); equal to the objective where the method is exact.
        objective: [m] what the method makes small, at the correction.
        method: name of the method.
        status: converged; or why the correction is none, or not the best one.
        scale: what the gap is relative to; absent: the vibration before, in that norm.
    """

    influence: Influence
    correction: Complex[Array, " planes"]
    objective: Float[Array, ""]
    bound: Float[Array, ""]
    method: str = eqx.field(static=True)
    status: Status
    scale: Float[Array, ""] | None = None

    table_dims: ClassVar[tuple[str, ...]] = ("row",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result, in SI units; measured vibration as it was read."""
        unit, trial = self.influence.unit, self.influence.trial
        for number, plane in enumerate(self.influence.planes):
            yield Data(f"correction.{plane}", trial, self.correction[..., number])
        yield Data("improvement", "", self.improvement, doc="weighted rms after over before")
        yield Data("condition", "", self.condition)
        for name, si in (("target", ""), ("axis", ""), ("speed", "rad/s")):
            values = np.array([getattr(row, name) for row in self.influence.rows])
            yield Data(name, si, values, ("row",))
        yield Data("weight", "", self.influence.weight, ("row",))
        yield Data("before", unit, self.influence.initial, ("row",))
        yield Data("after", unit, self.residual, ("row",))

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the correction is what the method promises."""
        return self.status == Status.converged

    @property
    def residual(self) -> Complex[Array, " rows"]:
        """[m] Predicted vibration of every row."""
        return self.influence.vibration(self.correction)

    @property
    def gap(self) -> Float[Array, ""]:
        """[-] How far above its bound the objective lies, relative to `scale`."""
        before = jnp.linalg.norm(self.influence.weighted[1]) if self.scale is None else self.scale
        return (self.objective - self.bound) / (before + (before == 0))

    @property
    def worse(self) -> Bool[Array, " rows"]:
        """Which readings are higher after than before."""
        return jnp.abs(self.residual) > jnp.abs(self.influence.initial)

    @property
    def improvement(self) -> Float[Array, ""]:
        """[-] Weighted root mean square of the vibration after over before."""
        weight = self.influence.weight
        before = jnp.linalg.norm(weight * self.influence.initial)
        return jnp.linalg.norm(weight * self.residual) / (before + (before == 0))

    @property
    def condition(self) -> Float[Array, ""]:
        """[-] Ratio of the largest to the smallest singular value of the weighted system."""
        return condition(self.influence.weighted[0])

    def sensitivity(
        self, mass_error: float = 0.01, angle_error: float = np.pi / 180
    ) -> Float[Array, "rows planes"]:
        """[m] Change of each vibration when one plane's mass and angle are off by these errors.

        To first order the error vector has the length |B| sqrt(mass^2 + angle^2) at worst one
        perpendicular to the other.

        Args:
            mass_error: [-] relative error of the mass.
            angle_error: [rad] of its place.
        """
        size = jnp.abs(self.correction) * jnp.hypot(mass_error, angle_error)
        return jnp.abs(self.influence.matrix) * size
