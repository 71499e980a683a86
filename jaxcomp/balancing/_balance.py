"""What a balance hands back: the corrections, the vibration that they leave, and how good they are."""

from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from .._core.display import RPM, rounded, vibration_unit
from .._core.nested import fields_of, records
from .._core.results import Data, Result
from .._core.status import Status
from ._further_trial import further_trial
from ._influence import Influence, InfluenceRow


def balance(
    influence: Influence,
    correction: Complex[Array, " planes"],
    objective: Float[Array, ""],
    bound: Float[Array, ""],
    method: str,
    failure: Status | None = None,
    scale: Float[Array, ""] | None = None,
    weights: "PlacedWeights | None" = None,
) -> "Balance":
    """A balance with its status; corrections are NaN where the numbers of the system are not finite.

    `failure` is what the method says of its end, converged if absent; `weights` are what the
    corrections consist of.
    """
    if failure is None:
        failure = Status.converged
    finite = jnp.all(jnp.isfinite(correction)) & jnp.isfinite(objective)
    status = Status.where(finite, failure, Status.bad_input)
    # all of them: the numbers of the other planes were found with the one that is none
    correction = jnp.where(finite, correction, jnp.nan)
    return Balance(influence, correction, objective, bound, method, status, scale, weights=weights)


def condition(matrix: Complex[Array, "rows planes"]) -> Float[Array, ""]:
    """[-] Ratio of the largest to the smallest singular value; infinite for a singular matrix."""
    values = jnp.linalg.svd(matrix, compute_uv=False)
    return values[0] / values[-1]


class PlacedWeights(eqx.Module):
    """Weights that the corrections consist of.

    Attributes:
        plane: (weights,) number of the plane.
        angle: [rad] (weights,) of its place.
        mass: [kg] (weights,), NaN where neither the plane has a radius nor the trial weights are masses.
        unbalance: [kg m] (weights,), NaN where the trial weights are masses.
        removed: (weights,) whether it is taken off.
    """

    plane: Int[np.ndarray, " weights"]
    angle: Float[np.ndarray, " weights"]
    mass: Float[np.ndarray, " weights"]
    unbalance: Float[np.ndarray, " weights"]
    removed: Bool[np.ndarray, " weights"]


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
        alternatives: balances of the other systems that fit readings without phase as well.
        weights: that the corrections consist of, where places are known for them.
    """

    influence: Influence
    correction: Complex[Array, " planes"]
    objective: Float[Array, ""]
    bound: Float[Array, ""]
    method: str = eqx.field(static=True)
    status: Status
    scale: Float[Array, ""] | None = None
    alternatives: tuple["Balance", ...] = ()
    weights: PlacedWeights | None = None

    table_dims: ClassVar[tuple[str, ...]] = ("row",)
    nested_units: ClassVar[str] = """
        planes: correction {correction_unit}; unbalance [kg m]; phase [rad]; radius [m]; mass [kg]
        rows: speed [rad/s]; weight; before, after, sensitivity {vibration_unit}
        rows: before_phase, after_phase [rad]
        weights: unbalance [kg m]; mass [kg]; phase [rad]
        alternatives.planes: correction {correction_unit}; phase [rad]
        alternatives: improvement
        further_trial: trial {correction_unit}; phase [rad]; speed [rad/s]; expected {vibration_unit}
        misfit, worse, improvement, condition, gap; objective, bound {vibration_unit}
    """

    def described(self) -> Iterator[Data]:
        """The quantities of this result, in SI units; measured vibration as it was read."""
        unit = self.influence.unit
        trial = self.influence.trial
        for number, plane in enumerate(self.influence.planes):
            # many systems at once have their axis in front of that of the planes
            yield Data(f"correction.{plane}", trial, self.correction[..., number])
        yield Data("improvement", "", self.improvement, doc="weighted rms after over before")
        yield Data("condition", "", self.condition)
        for name, si in (("target", ""), ("axis", ""), ("speed", "rad/s")):
            values = np.array([getattr(row, name) for row in self.influence.rows])
            yield Data(name, si, values, ("row",))
        yield Data("weight", "", self.influence.weight, ("row",))
        yield Data("before", unit, self.influence.initial, ("row",))
        yield Data("after", unit, self.residual, ("row",))

    def nested(self) -> dict[str, Any]:
        """Planes with their corrections, and rows with the vibration before and after."""
        part = self.influence
        value = np.asarray(self.correction)
        residual = np.asarray(self.residual)
        size = np.abs(value)
        before = np.asarray(part.initial)
        unknown = np.full(size.shape, np.nan)
        radius = unknown
        if part.radius is not None:
            radius = np.asarray(part.radius)
        # what is added in a plane is a mass at one radius, or mass times radius
        if part.trial == "kg":
            unbalance = unknown
            mass = size
        else:
            unbalance = size
            mass = size / radius
        sensitivity = np.asarray(self.sensitivity()).tolist()
        return {
            "method": self.method,
            "vibration_unit": part.unit,
            "correction_unit": part.trial,
            "planes": records(
                name=part.planes,
                correction=size,
                unbalance=unbalance,
                phase=np.angle(value),
                radius=radius,
                mass=mass,
            ),
            "rows": records(
                # the labels transposed into columns, as `records` takes them
                **dict(zip(InfluenceRow._fields, zip(*part.rows, strict=True), strict=True)),
                weight=part.weight,
                before=np.abs(before),
                before_phase=np.angle(before),
                after=np.abs(residual),
                after_phase=np.angle(residual),
                sensitivity=[dict(zip(part.planes, row, strict=True)) for row in sensitivity],
            ),
            "worse": np.sum(self.worse),
            **fields_of(self, "improvement", "condition", "objective", "bound", "gap", "verdict"),
            "status": Status[self.status],
            **self._placed(),
            **self._without_phase(),
        }

    def _placed(self) -> dict[str, Any]:
        """The weights at their places; nothing where no places are known."""
        weights = self.weights
        if weights is None:
            return {}
        return {
            "weights": records(
                name=[self.influence.planes[number] for number in weights.plane],
                phase=weights.angle,
                unbalance=weights.unbalance,
                mass=weights.mass,
                removed=weights.removed,
            ),
            # a search for places ends converged where its bound has met its objective, and only there
            "certified": bool(self.converged),
        }

    def _without_phase(self) -> dict[str, Any]:
        """Numbers of readings without phase beside the balance; none of others."""
        influence = self.influence
        if influence.misfit is None:
            return {}
        alternatives = []
        for other in self.alternatives:
            planes = records(
                name=influence.planes,
                correction=np.abs(other.correction),
                phase=np.angle(other.correction),
            )
            alternatives.append({"planes": planes, "improvement": other.improvement})
        numbers: dict[str, Any] = {"misfit": self.misfit, "alternatives": alternatives}
        # as large as the trial weights were, or as what the balance adds
        sizes = self.correction
        if influence.trials is not None:
            sizes = influence.trials.weight
        trial = further_trial(influence, float(np.median(np.abs(sizes))))
        if trial is not None:
            row = influence.rows[trial.row]
            numbers["further_trial"] = {
                "plane": trial.plane,
                "trial": abs(trial.weight),
                "phase": np.angle(trial.weight),
                **row._asdict(),
                "expected": list(trial.amplitudes),
            }
        return numbers

    @property
    def verdict(self) -> str:
        """Number of readings that get worse, and the one that does so most, in words."""
        before = np.abs(self.influence.initial)
        after = np.abs(self.residual)
        if not np.any(after > before):
            return "No reading gets worse."
        place = int(np.argmax(after - before))
        worst = self.influence.rows[place]
        unit, factor = vibration_unit(self.influence.unit)
        low = rounded(float(before[place]) * factor, 3)
        high = rounded(float(after[place]) * factor, 3)
        return (
            f"{np.sum(after > before)} of {after.size} readings get worse; most of all {worst.target} "
            f"{worst.axis} at {worst.speed * RPM:.5g} rpm, from {low} to {high} {unit}."
        )

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
        scale = self.scale
        if scale is None:
            # the vibration before; a sum of masses, which is none, brings a scale of its own
            scale = jnp.linalg.norm(self.influence.weighted[1])
        return _share(self.objective - self.bound, scale)

    @property
    def worse(self) -> Bool[Array, " rows"]:
        """Which readings are higher after than before."""
        return jnp.abs(self.residual) > jnp.abs(self.influence.initial)

    @property
    def improvement(self) -> Float[Array, ""]:
        """[-] Weighted root mean square of the vibration after over before."""
        before = jnp.linalg.norm(self.influence.weighted[1])
        return _share(self.influence.size(self.correction), before)

    @property
    def misfit(self) -> Float[Array, ""]:
        """[-] What amplitudes miss the system by, over those of the first run; 0 of others."""
        if self.influence.misfit is None:
            return jnp.zeros(())
        before = jnp.linalg.norm(self.influence.initial)
        return jnp.linalg.norm(self.influence.misfit) / before

    @property
    def condition(self) -> Float[Array, ""]:
        """[-] Ratio of the largest to the smallest singular value of the weighted system."""
        return condition(self.influence.weighted[0])

    @eqx.filter_jit
    def sensitivity(
        self, mass_error: float = 0.01, angle_error: float = np.pi / 180
    ) -> Float[Array, "rows planes"]:
        """[m] Change of each vibration when one plane's mass and angle are off by these errors.

        To first order an error of the mass lies along the correction and one of the angle across it:
        together they have the length |B| sqrt(mass^2 + angle^2).

        Args:
            mass_error: [-] relative error of the mass.
            angle_error: [rad] of its place.
        """
        size = jnp.abs(self.correction) * jnp.hypot(mass_error, angle_error)
        return jnp.abs(self.influence.matrix) * size


def _share(part, total) -> Float[Array, ""]:
    """[-] Of a whole that may be zero, as the part is then."""
    return part / (total + (total == 0))
