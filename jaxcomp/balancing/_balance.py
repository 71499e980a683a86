"""What a balance hands back: the corrections, the vibration that they leave, and how good they are."""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from .._core.declared import (
    IN_KEY,
    Measured,
    Record,
    computed,
    computed_part,
    computed_word,
    held,
    part,
    reading,
    records_of,
    word,
)
from .._core.display import RPM, rounded, vibration_unit
from .._core.evidence import Check
from .._core.results import Data, Result, columns_of
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


@dataclasses.dataclass(frozen=True)
class PlaneCorrection(Record):
    """Correction of a plane.

    Attributes:
        name: of the plane.
        correction: size of what is added, in the unit of the trial weights.
        phase: [rad] of its place.
    """

    name: str = word()
    correction: Measured = reading(IN_KEY)
    phase: float = reading("rad")


@dataclasses.dataclass(frozen=True)
class BalancedPlane(Record):
    """Correction of a plane as mass times radius and as a mass.

    Attributes:
        correction: with its plane.
        unbalance: [kg m] of the correction, not a number where the trial weights are masses.
        radius: [m] at which masses are added, not a number where the plane has none.
        mass: [kg] of the correction, not a number without a radius.
    """

    correction: PlaneCorrection = part(PlaneCorrection, inline=True)
    unbalance: float = reading("kg m")
    radius: float = reading("m")
    mass: float = reading("kg")


@dataclasses.dataclass(frozen=True)
class BalancedRow(Record):
    """A reading before and after the balance.

    Attributes:
        label: target, axis and speed.
        weight: [-] in every norm.
        before, after: amplitudes, in the unit of the vibration.
        before_phase, after_phase: [rad]
        sensitivity: by plane, change by an error of its weight, in the unit of the vibration.
    """

    label: InfluenceRow = part(InfluenceRow, inline=True)
    weight: float = reading("")
    before: Measured = reading(IN_KEY)
    before_phase: float = reading("rad")
    after: Measured = reading(IN_KEY)
    after_phase: float = reading("rad")
    sensitivity: Measured = reading(IN_KEY)


@dataclasses.dataclass(frozen=True)
class PlacedWeight(Record):
    """A weight of `PlacedWeights`.

    Attributes:
        name: of the plane.
        phase: [rad] of its place.
        unbalance: [kg m]
        mass: [kg]
        removed: whether it is taken off.
    """

    name: str = word()
    phase: float = reading("rad")
    unbalance: float = reading("kg m")
    mass: float = reading("kg")
    removed: bool = word()


@dataclasses.dataclass(frozen=True)
class AlternativeBalance(Record):
    """Corrections of another system that fits readings without phase as well.

    Attributes:
        planes: with their corrections.
        improvement: [-] weighted root mean square of the vibration after over before.
    """

    planes: tuple[PlaneCorrection, ...] = part(PlaneCorrection)
    improvement: Float[Array, ""] = reading("")


@dataclasses.dataclass(frozen=True)
class DecidingRun(Record):
    """A run that tells alternatives apart.

    Attributes:
        plane: in which a trial weight is set.
        trial: size of the weight, in the unit of the trial weights.
        phase: [rad] of its place.
        label: target, axis and speed of the reading that tells.
        expected: amplitudes that each system expects there, in the unit of the vibration.
    """

    plane: str = word()
    trial: Measured = reading(IN_KEY)
    phase: float = reading("rad")
    label: InfluenceRow = part(InfluenceRow, inline=True)
    expected: Measured = reading(IN_KEY)


@dataclasses.dataclass(frozen=True)
class WithoutPhase(Record):
    """Numbers of a balance by readings without phase.

    Attributes:
        misfit: [-] of the amplitudes, see `Balance.misfit`.
        alternatives: other balances.
        further_trial: the run that decides; `None` without alternatives.
    """

    misfit: Float[Array, ""] = reading("")
    alternatives: tuple[AlternativeBalance, ...] = part(AlternativeBalance)
    further_trial: DecidingRun | None = part(DecidingRun, optional=True)


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
    method: str = word(static=True)
    status: Status = held()
    scale: Float[Array, ""] | None = held(default=None)
    alternatives: tuple["Balance", ...] = held(default=())
    weights: PlacedWeights | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("row",)

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Checks of the planes and of the optimum."""
        del tolerance
        condition = float(self.condition)
        gap = abs(float(self.gap))
        return (
            # errors of the influence coefficients come out that much larger in the masses
            Check(
                "Condition of the balancing planes",
                f"{condition:.3g}",
                condition < 100,
                "below 100",
            ),
            Check("Gap to the proven optimum", f"{gap:.1e}", gap <= 1e-3, "at most 1e-03"),
        )

    def described(self) -> Iterator[Data]:
        """The quantities of this result, in SI units; measured vibration as it was read."""
        unit = self.influence.unit
        trial = self.influence.trial
        for number, plane in enumerate(self.influence.planes):
            # many systems at once have their axis in front of that of the planes
            yield Data(f"correction.{plane}", trial, self.correction[..., number])
        yield from self.data_of("improvement", "condition")
        yield from columns_of(self.influence.rows, "row")
        yield Data("weight", "", self.influence.weight, ("row",))
        yield Data("before", unit, self.influence.initial, ("row",))
        yield Data("after", unit, self.residual, ("row",))

    @computed_word()
    def vibration_unit(self) -> str:
        """Unit of the vibration."""
        return self.influence.unit

    @computed_word()
    def correction_unit(self) -> str:
        """Unit of what is added in a plane."""
        return self.influence.trial

    @computed_part(BalancedPlane)
    def planes(self) -> tuple[BalancedPlane, ...]:
        """Planes with their corrections."""
        influence = self.influence
        corrections = self._corrections(self.correction)
        size = np.abs(np.asarray(self.correction))
        unknown = np.full(size.shape, np.nan)
        radius = unknown
        if influence.radius is not None:
            radius = np.asarray(influence.radius)
        # what is added in a plane is a mass at one radius, or mass times radius
        if influence.trial == "kg":
            unbalance = unknown
            mass = size
        else:
            unbalance = size
            mass = size / radius
        return records_of(
            BalancedPlane, correction=corrections, unbalance=unbalance, radius=radius, mass=mass
        )

    def _corrections(self, correction: Complex[Array, " planes"]) -> tuple[PlaneCorrection, ...]:
        value = np.asarray(correction)
        sizes = [Measured(size, self.influence.trial) for size in np.abs(value).tolist()]
        return records_of(
            PlaneCorrection, name=self.influence.planes, correction=sizes, phase=np.angle(value)
        )

    @computed_part(BalancedRow)
    def rows(self) -> tuple[BalancedRow, ...]:
        """Readings with the vibration before and after."""
        influence = self.influence
        before = np.asarray(influence.initial)
        after = np.asarray(self.residual)
        sensitivity = []
        for row in np.asarray(self.sensitivity()).tolist():
            by_plane = dict(zip(influence.planes, row, strict=True))
            sensitivity.append(Measured(by_plane, influence.unit))
        return records_of(
            BalancedRow,
            label=influence.rows,
            weight=influence.weight,
            before=[Measured(size, influence.unit) for size in np.abs(before).tolist()],
            before_phase=np.angle(before),
            after=[Measured(size, influence.unit) for size in np.abs(after).tolist()],
            after_phase=np.angle(after),
            sensitivity=sensitivity,
        )

    @computed("", key="worse")
    def worse_count(self) -> np.ndarray:
        """[-] Number of readings that are higher after than before."""
        return np.sum(self.worse)

    @computed(IN_KEY, key="objective")
    def objective_with_unit(self) -> Measured:
        """Objective in the unit of the vibration."""
        return Measured(self.objective, self.influence.unit)

    @computed(IN_KEY, key="bound")
    def bound_with_unit(self) -> Measured:
        """Bound of the objective in the unit of the vibration."""
        return Measured(self.bound, self.influence.unit)

    @computed_word(key="status")
    def status_word(self) -> str:
        """Status in words."""
        return Status[self.status]

    @computed_part(PlacedWeight, key="weights", optional=True)
    def listed_weights(self) -> tuple[PlacedWeight, ...] | None:
        """The weights at their places; `None` where no places are known."""
        weights = self.weights
        if weights is None:
            return None
        return records_of(
            PlacedWeight,
            name=[self.influence.planes[number] for number in weights.plane],
            phase=weights.angle,
            unbalance=weights.unbalance,
            mass=weights.mass,
            removed=weights.removed,
        )

    @computed_word(optional=True)
    def certified(self) -> bool | None:
        """Whether the weights are the best of all combinations; `None` where no places are known."""
        if self.weights is None:
            return None
        # a search for places ends converged where its bound has met its objective, and only there
        return bool(self.converged)

    @computed_part(WithoutPhase, inline=True, optional=True)
    def without_phase(self) -> WithoutPhase | None:
        """Numbers of readings without phase; `None` of others."""
        influence = self.influence
        if influence.misfit is None:
            return None
        alternatives = []
        for other in self.alternatives:
            planes = self._corrections(other.correction)
            alternatives.append(AlternativeBalance(planes, other.improvement))
        return WithoutPhase(self.misfit, tuple(alternatives), self._deciding_run())

    def _deciding_run(self) -> DecidingRun | None:
        influence = self.influence
        # as large as the trial weights were, or as what the balance adds
        sizes = self.correction
        if influence.trials is not None:
            sizes = influence.trials.weight
        trial = further_trial(influence, float(np.median(np.abs(sizes))))
        if trial is None:
            return None
        return DecidingRun(
            plane=trial.plane,
            trial=Measured(abs(trial.weight), influence.trial),
            phase=float(np.angle(trial.weight)),
            label=influence.rows[trial.row],
            expected=Measured(trial.amplitudes, influence.unit),
        )

    @computed_word()
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

    @computed("")
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

    @computed("", doc="weighted rms after over before")
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

    @computed("")
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
