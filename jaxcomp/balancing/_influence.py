r"""Influence coefficients: how correction masses move the vibration at the targets.

The model of the balance is linear, V = V_0 + C B, with complex amplitudes: the unbalances B [kg m]
in the correction planes, the vibration V at the targets. Speeds, targets and directions are rows of
one system. Source: Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`, Eqs. (8) to
(11). None of the seed papers couples the crank to it: at every speed its periodic state gives the
Fourier coefficients of the forces and, by the mean force, stiffness and damping of the films.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.declared import Record, reading, word
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import is_traced
from .._core.words import one_of
from ..crank import Collocation
from ..machine import Assembly, HasMachine, Machine, assembly_of
from ..rotor import BalancingPlanes, PeriodicForce, RotorModel, Unbalances, receptance
from ..rotor._loads import load_vector, nodal_load
from ..vibration import crank_loads, running_rotor
from ..vibration._coupling import CrankLoads


@dataclasses.dataclass(frozen=True)
class InfluenceRow(Record):
    """One row of the system.

    Attributes:
        target: name of the target plane or sensor.
        axis: direction of the motion, such as "ux".
        speed: [rad/s]
    """

    target: str = word()
    axis: str = word()
    speed: float = reading("rad/s")


class Trials(eqx.Module):
    """Trial weights of measured runs.

    Attributes:
        weight: [kg m] (runs,) mass times radius with its angle.
        runs: names; static.
        planes: of each run; static.
    """

    weight: Complex[Array, " runs"]
    runs: tuple[str, ...] = eqx.field(static=True)
    planes: tuple[str, ...] = eqx.field(static=True)


class Influence(eqx.Module):
    """The vibration before balancing and what unbalance in each plane adds to it.

    Attributes:
        matrix: [m/(kg m)] (rows, planes) C; of whatever unit the vibration has.
        initial: [m] (rows,) V_0.
        weight: [-] (rows,) of each row in every norm.
        rows: what each row is; static.
        planes: names of the correction planes; static.
        unit: of the vibration; static.
        trial: unit of what is added in a plane, `kg m`, or `kg` at one radius; static.
        radius: [m] (planes,) at which masses are added, NaN where a plane has none; absent if none has.
        trials: weights of the runs that it was measured by; absent otherwise.
        misfit: [m] (rows,) root mean square of what the amplitudes of the runs miss the system by, where
            it was measured without phase; absent otherwise.
        alternatives: other systems that fit such amplitudes as well.

    Raises:
        BadInput: no rows or planes, arrays that do not fit them, or a value that is not finite.
    """

    matrix: Complex[Array, "rows planes"]
    initial: Complex[Array, " rows"]
    weight: Float[Array, " rows"]
    rows: tuple[InfluenceRow, ...] = eqx.field(static=True)
    planes: tuple[str, ...] = eqx.field(static=True)
    unit: str = eqx.field(static=True, default="m")
    trial: str = eqx.field(static=True, default="kg m")
    radius: Float[Array, " planes"] | None = None
    trials: Trials | None = None
    misfit: Float[Array, " rows"] | None = None
    alternatives: tuple["Influence", ...] = ()

    def __check_init__(self):
        for name, entries in (("rows", self.rows), ("planes", self.planes)):
            if not entries:
                raise BadInput(name, "none", "at least one")
        count = (len(self.rows), len(self.planes))
        for name, shape in (("matrix", count), ("initial", count[:1]), ("weight", count[:1])):
            value = getattr(self, name)
            # shapes are known of traced values as well, numbers are not
            if jnp.shape(value) != shape:
                raise BadInput(name, str(jnp.shape(value)), f"of shape {shape}")
            if not is_traced(value) and not np.all(np.isfinite(value)):
                raise BadInput(name, value, "finite")

    def vibration(self, correction: Complex[Array, " planes"]) -> Complex[Array, " rows"]:
        """[m] V = V_0 + C B, Eq. (8)."""
        return self.initial + self.matrix @ correction

    def size(self, correction: Complex[Array, " planes"]) -> Float[Array, ""]:
        """Root of the weighted sum of squares of the vibration, in its unit."""
        return jnp.linalg.norm(self.weight * self.vibration(correction))

    @property
    def weighted(self) -> tuple[Complex[Array, "rows planes"], Complex[Array, " rows"]]:
        """Matrix [m/(kg m)] and initial vibration [m] with every row times its weight."""
        return self.weight[:, None] * self.matrix, self.weight * self.initial


def direct_influence(
    model: RotorModel,
    loads: Sequence[Unbalances | PeriodicForce],
    places: BalancingPlanes,
    speeds: Float[Array, " speeds"] | None = None,
) -> Influence:
    """Influence coefficients as columns of the dynamic flexibility at order 1.

    Differentiable in the model, the loads and the speeds; one factorisation a speed.

    Args:
        model: rotor, crankcase and housing.
        loads: what shakes it before balancing.
        places: correction planes and targets.
        speeds: [rad/s] the speeds to balance at; those of `places` if absent.
    """
    if speeds is None:
        speeds = places.speeds
    speeds = jnp.atleast_1d(jnp.asarray(speeds, float))
    return influence_of(_flexibility(model, tuple(loads), places, speeds), places, speeds)


def influence_of(answer: Complex[Array, "rows columns"], places, speeds) -> Influence:
    """The system whose columns are the vibration before and that of a unit in each plane.

    Args:
        answer: (rows, 1 + planes) complex vibration: before, then what one unit in each plane adds.
        places: correction planes and targets.
        speeds: [rad/s] (speeds,), each with a row for every axis of every target.
    """
    axes = []
    weights = []
    for target in places.targets:
        for axis in target.axes:
            axes.append((target.name, axis))
            weights.append(target.weight)
    names = []
    radii = []
    for plane in places.planes:
        names.append(plane.name)
        has_radius = plane.radius is not None
        radii.append(plane.radius if has_radius else np.nan)
    matrix, initial, weight, radius = _columns(answer, weights, radii, speeds.size)
    # Labels are static, and a traced speed has no number to name its rows by.
    labels: Any = speeds
    if is_traced(speeds):
        labels = np.arange(speeds.size)
    rows = []
    for speed in np.asarray(labels).tolist():
        for target, axis in axes:
            rows.append(InfluenceRow(target, axis, float(speed)))
    return Influence(
        matrix,
        initial,
        weight,
        tuple(rows),
        tuple(names),
        radius=radius,
    )


@eqx.filter_jit
def _columns(answer, weights, radii, speeds: int):
    # Rows go speed by speed, with all targets at each.
    weight = jnp.tile(jnp.asarray(weights, float), speeds)
    return answer[:, 1:], answer[:, 0], weight, jnp.asarray(radii, float)


@kept_jit
def _flexibility(model, loads, places, speeds):
    """(rows, 1 + planes) responses to the loads and to a unit of unbalance in each plane."""
    at_speed = lambda speed: flexibility(model, loads, places, speed)  # noqa: E731
    return jax.lax.map(at_speed, speeds).reshape(-1, 1 + len(places.planes))


def flexibility(model, loads, places, speed) -> Complex[Array, "rows columns"]:
    """[m], [m/(kg m)] Motion of the targets at one speed, by the loads and by each plane's unit."""
    outputs = []
    for target in places.targets:
        for axis in target.axes:
            along = nodal_load(model, target.node, axis).real
            # what a sensor reads that sits on the other node
            if target.relative_to is not None:
                along = along - nodal_load(model, target.relative_to, axis).real
            outputs.append(along)
    # One kg m at angle zero: the complex correction scales and turns it.
    cases = [loads]
    for plane in places.planes:
        cases.append((Unbalances((plane.node,), [1.0], [0.0]),))
    inputs = jnp.stack([load_vector(model, case, 1, speed) for case in cases])
    return receptance(model, inputs, jnp.stack(outputs), speed, speed)


def trial_influence(
    initial: Complex[Array, " rows"],
    trials: Complex[Array, "planes rows"],
    masses: Complex[Array, " planes"],
    rows: Sequence[InfluenceRow],
    planes: Sequence[str],
    weight: Float[Array, " rows"] | None = None,
    kept: Sequence[bool] | None = None,
) -> Influence:
    """Influence coefficients from an initial run and one more trial weight in each run, Eqs (10)-(11).

    The corrections of the system count from the initial run: whoever adds them takes all trial weights
    off, kept ones as well.

    Args:
        initial: [m] vibration without a trial weight.
        trials: [m] vibration with the trial weight in each plane, in the order of the runs.
        masses: [kg m] trial unbalance of each plane, mass times radius, with its angle.
        rows, planes: what the rows and columns are.
        weight: [-] of each row; 1 if absent.
        kept: (planes,) whether each trial weight stays on for all later runs; absent: it is taken off
            again before the next one.

    Raises:
        BadInput: a trial unbalance of zero, or another number of `kept` than of planes.

    >>> rows = [InfluenceRow("front", "ux", 314.0), InfluenceRow("rear", "ux", 314.0)]
    >>> trials = [[30e-6 + 10e-6j, 20e-6], [10e-6j, 60e-6]]  # [m] with 100 g mm in either plane
    >>> system = trial_influence([10e-6j, 20e-6], trials, [1e-4, 1e-4], rows, ["top", "weight"])
    >>> from jaxcomp.balancing import least_squares
    >>> for mass in least_squares(system).correction:
    ...     print(f"{1e6 * abs(mass):.1f} g mm at {np.rad2deg(np.angle(mass)):.0f} degrees")
    33.3 g mm at -90 degrees
    50.0 g mm at 180 degrees
    """
    masses = jnp.asarray(masses, complex)
    if not is_traced(masses) and np.any(np.asarray(masses) == 0):
        raise BadInput("masses", masses, "different from zero")
    initial = jnp.asarray(initial, complex)
    trials = jnp.asarray(trials, complex)
    weight = weight_of_rows(weight, rows)
    if kept is None:
        kept = [False] * len(planes)
    stays_on = list(kept)
    if len(stays_on) != len(planes):
        raise BadInput("kept", len(stays_on), f"a truth value for each of {len(planes)} planes")
    # Each run counts from the one before it that still carries the same trial weights.
    before = []
    state = initial
    for trial, stays in zip(trials, stays_on, strict=True):
        before.append(state)
        if stays:
            state = trial
    matrix = ((trials - jnp.stack(before)) / masses[:, None]).T
    return Influence(matrix, initial, weight, tuple(rows), tuple(planes))


def fitted_influence(
    initial: Complex[Array, " rows"],
    readings: Complex[Array, "runs rows"],
    weights: Complex[Array, "runs planes"],
    rows: Sequence[InfluenceRow],
    planes: Sequence[str],
    weight: Float[Array, " rows"] | None = None,
) -> Influence:
    """Influence coefficients from any number of runs with trial weights, by least squares.

    The initial run counts as read, because corrections are added to what it is of.

    Args:
        initial: [m] vibration without a trial weight.
        readings: [m] vibration of the runs with trial weights.
        weights: [kg m] all unbalance that is on in a run, mass times radius, with its angle.
        rows, planes: what the rows and columns are.
        weight: [-] of each row; 1 if absent.

    Raises:
        BadInput: weights from which the coefficients of all planes cannot be told.
    """
    on = np.asarray(weights, complex)
    # In units of each plane's largest weight: the rank must not hang on the sizes of the planes.
    units = on / np.maximum(np.abs(on).max(axis=0), 1e-300)
    if np.linalg.matrix_rank(units, tol=1e-9) < len(planes):
        needs = "of at least as many independent runs as planes"
        raise BadInput("weights", f"{len(on)} runs for {len(planes)} planes", needs)
    change = jnp.asarray(readings, complex) - jnp.asarray(initial, complex)
    # runs are rows in both: change = weights C^T
    matrix = jnp.linalg.lstsq(jnp.asarray(on), change)[0].T
    weight = weight_of_rows(weight, rows)
    return Influence(matrix, jnp.asarray(initial, complex), weight, tuple(rows), tuple(planes))


def weight_of_rows(
    weight: Float[Array, " rows"] | None, rows: Sequence[InfluenceRow]
) -> Float[Array, " rows"]:
    """[-] Weight of each row; 1 where none is given."""
    if weight is None:
        return jnp.ones(len(rows))
    return jnp.asarray(weight, float)


def with_weights(influence: Influence, weights: Mapping[str, complex]) -> Influence:
    """The system with weights on: its vibration is theirs as well, and corrections count from there.

    Args:
        influence: the system.
        weights: [kg m] by plane, mass times radius with its angle.

    Raises:
        BadInput: an unknown plane.
    """
    for name in weights:
        if name not in influence.planes:
            raise BadInput(f"weights.{name}", name, one_of(name, influence.planes))
    vector = jnp.asarray([complex(weights.get(name, 0.0)) for name in influence.planes])
    # each alternative has coefficients of its own, by which the same weights move it elsewhere
    alternatives = tuple(with_weights(other, weights) for other in influence.alternatives)
    return dataclasses.replace(
        influence, initial=influence.vibration(vector), alternatives=alternatives
    )


def select(
    influence: Influence,
    *,
    planes: Sequence[str] | None = None,
    targets: Sequence[str] | None = None,
    weights: Mapping[str, float] | None = None,
) -> Influence:
    """The part of a system that belongs to some planes and targets.

    Args:
        influence: the system.
        planes: names of those to keep; absent: all.
        targets: the same of the targets.
        weights: [-] by target, with which the weights of its rows are multiplied.

    Raises:
        BadInput: an unknown name, or a weight below zero.
    """
    if planes is None and targets is None and not weights:
        return influence
    all_targets = {row.target for row in influence.rows}
    for field, names, choices in (
        ("planes", planes, influence.planes),
        ("targets", targets, all_targets),
        ("weights", weights, all_targets),
    ):
        for name in names or ():
            if name not in choices:
                raise BadInput(field, name, one_of(name, sorted(choices)))
    weights = weights or {}
    for name, value in weights.items():
        if not value >= 0:
            raise BadInput(f"weights.{name}", value, ">= 0")
    chosen_planes = influence.planes if planes is None else planes
    chosen_targets = all_targets if targets is None else targets
    columns = _numbers_among(influence.planes, chosen_planes)
    row_numbers = _numbers_among([row.target for row in influence.rows], chosen_targets)
    times = np.array([weights.get(row.target, 1.0) for row in influence.rows])
    originals = (influence.matrix, influence.initial, influence.weight, times, influence.radius)
    *arrays, radius = _selected(*originals, np.array(row_numbers, int), np.array(columns, int))
    misfit = influence.misfit
    if misfit is not None:
        misfit = misfit[np.array(row_numbers, int)]
    choice = {"planes": planes, "targets": targets, "weights": weights}
    return Influence(
        *arrays,
        rows=tuple(influence.rows[i] for i in row_numbers),
        planes=tuple(influence.planes[i] for i in columns),
        unit=influence.unit,
        trial=influence.trial,
        radius=radius,
        trials=influence.trials,
        misfit=misfit,
        alternatives=tuple(select(other, **choice) for other in influence.alternatives),
    )


def _numbers_among(names: Sequence[str], choices: Collection[str]) -> list[int]:
    """Numbers of the names that are among the choices."""
    numbers = []
    for number, name in enumerate(names):
        if name in choices:
            numbers.append(number)
    return numbers


if TYPE_CHECKING:
    from ..crank import Shooting


def machine_influence(
    machine: Machine | HasMachine,
    speeds: Float[Array, " speeds"] | None = None,
    solver: "Collocation | Shooting | None" = None,
    *,
    crank: bool = True,
    left_out: tuple[str, ...] = (),
) -> Influence:
    """Influence coefficients at order 1 of a machine whose films, and perhaps loads, its crank sets.

    Differentiable end to end.

    Args:
        machine: a scene or a machine with rotor, loads and balancing planes; its corrections count.
        speeds: [rad/s] those of the balancing planes if absent.
        solver: of the periodic state.
        crank: take the forces of the crank in the place of those that the scene gives.
        left_out: what the crank's forces do without, see `without`.

    Raises:
        BadInput: a part that is missing.
    """
    assembly = assembly_of(machine)
    places = assembly.balancing
    if assembly.rotor is None or assembly.loads is None or places is None or not places.planes:
        raise BadInput("balancing", "absent", "given with rotor, loads and correction planes")
    if speeds is None:
        speeds = places.speeds
    speeds = jnp.atleast_1d(jnp.asarray(speeds, float))
    answer = _answers(assembly, places, speeds, solver, crank, left_out)
    return influence_of(answer, places, speeds)


@kept_jit
def _answers(assembly, places, speeds, solver, crank, left_out):
    # all periodic states as one batch; the first order is all that an unbalance answers to
    at = lambda w: crank_loads(assembly, w, (1,), solver, crank=crank, left_out=left_out)  # noqa: E731
    return flexibilities(assembly, jax.vmap(at)(speeds), places, speeds)


@eqx.filter_jit
def _selected(matrix, initial, weight, times, radius, rows, columns):
    if radius is not None:
        radius = radius[columns]
    return matrix[rows][:, columns], initial[rows], (weight * times)[rows], radius


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
    # the films differ from speed to speed, and with them the model: there is no one rotor for all
    at = lambda load, w: flexibility(*running_rotor(machine, load), places, w)  # noqa: E731
    return jax.vmap(at)(loads, speeds).reshape(-1, 1 + len(places.planes))
