"""Constants of a machine from its measurements, and the points that were not measured."""

from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._core.errors import BadInput
from ..._core.words import one_of
from ...machine import HasMachine, Machine, machine_of
from .._variables import Variable, changed
from ._bounded_least_squares import Parameter, check_problem
from ._common_factor import CommonFactor, varied
from ._fit import Fit, fit
from ._measurement import AbstractMeasurement
from ._notes import notes_of
from ._reading_model import ReadingModel
from ._result import Identification


def identify(
    machine: Machine | HasMachine,
    measurements: AbstractMeasurement | Sequence[AbstractMeasurement],
    vary: Mapping[str, tuple[float, float] | None],
    prior: Mapping[str, tuple[float, float]] | None = None,
    *,
    sd: Mapping[str, float] | None = None,
    hold_out: Sequence[int] = (),
    loss: str = "linear",
    starts: int = 3,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    keep: Callable[[NDArray, float], None] | None = None,
) -> Identification:
    """Find constants of a machine from its measurements, and predict the points held out.

    Every point is one call of a compiled program, which hands back the exact slopes over all constants
    as well, so that further points, starts, hold-outs and repetitions compile nothing. An interrupt
    (Ctrl-C) ends the fit with the best constants so far.

    Args:
        machine: a machine or a scene; its speed counts for points without one.
        measurements: of one kind or several; the points of all are counted one after the other.
        vary: [SI] (low, high) by path of the constant, as `jaxcomp.study.variable` takes it, or of the
            common factor by pattern; half to twice the machine's value for `None`.
        prior: [SI] (mean, standard deviation) by path, of those that are varied.
        sd: standard deviations by quantity instead of the usual ones, relative but for temperatures.
        hold_out: points that the fit does not see.
        loss: as in `fit`.
        starts: as in `fit`.
        seed: as in `fit`.
        progress: is told every better fit on the way.
        keep: is given the best values and their chi-square whenever there are better ones.

    Raises:
        BadInput: points that cannot be, a machine that does not suit the measurements, a constant that
            does not vary alone, fewer readings than constants, or points that have no solution at the
            start.
    """
    if not isinstance(measurements, Sequence):
        measurements = [measurements]
    design = machine_of(machine)
    measurements = [measurement.for_machine(design) for measurement in measurements]
    quantities = {}
    for measurement in measurements:
        measurement.check(design)
        measurement.check_limits(design, list(vary))
        quantities |= dict.fromkeys(measurement.names_of_sd)
    for name in (sd or {}).keys() - quantities.keys():
        raise BadInput("sd", name, one_of(name, list(quantities)))
    variables, parameters = _parameters(design, vary, dict(prior or {}))
    model = ReadingModel(design, tuple(variables), measurements, sd or {})
    parameters += model.nuisances
    for number in hold_out:
        if not 0 <= number < model.count:
            raise BadInput("hold_out", number, f"a point from 0 to {model.count - 1}")
    entries = model.entries
    fitted = ~np.isin(entries.point, np.asarray(hold_out, int))
    points = sorted(set(entries.point[fitted].tolist()))
    check_problem(parameters, entries.measured, entries.sd, fitted, loss)
    _check_start(model, parameters, points, fitted)
    result = fit(
        lambda p: model(p, points),
        parameters,
        entries.measured,
        entries.sd,
        weight=fitted,
        loss=loss,
        starts=starts,
        seed=seed,
        progress=progress,
        keep=keep,
    )
    return _identification(result, model, variables, points)


def _check_start(
    model: ReadingModel, parameters: list[Parameter], points: list[int], fitted: NDArray
) -> None:
    """That all points which the fit sees have a solution with the values it begins with."""
    start = np.array([parameter.start for parameter in parameters])
    first, _ = model(start, points)
    bad = np.flatnonzero(fitted & ~np.isfinite(first))
    if bad.size:
        failed = sorted({model.entries.names[row] for row in bad})
        bound = "one with a solution with the machine's values; leave it out or begin elsewhere"
        raise BadInput(f"{model.source}: points", ", ".join(failed), bound)


def _identification(
    result: Fit, model: ReadingModel, variables: list[Variable | CommonFactor], points: list[int]
) -> Identification:
    """The result of a fit, with what the machine says of all points."""
    entries = model.entries
    # who interrupts waits for no further points
    computed = points
    if not result.interrupted:
        computed = range(model.count)
    value, slope = model(result.estimate, computed)
    directions = result.directions
    hardly_known = [each for each in directions if each.weak or each.unidentifiable]
    prediction = result.predict(value, slope, entries.sd)
    names = []
    units = []
    start = []
    bounds = []
    for parameter in result.parameters:
        names.append(parameter.name)
        units.append(parameter.unit)
        start.append(parameter.start)
        bounds.append((parameter.low, parameter.high))
    conditions = {}
    for name, numbers in entries.conditions.items():
        conditions[name] = jnp.asarray(numbers)
    return Identification(
        parameters=tuple(names),
        units=tuple(units),
        estimate=jnp.asarray(result.estimate),
        standard_error=jnp.asarray(result.standard_error),
        covariance=jnp.asarray(result.covariance),
        start=jnp.asarray(start),
        prior_share=jnp.asarray(result.prior_share),
        constants=len(variables),
        quantity=entries.quantity,
        kinds=dict(entries.kinds),
        point=jnp.asarray(entries.point),
        names=entries.names,
        conditions=conditions,
        condition_units=dict(entries.units),
        measured=jnp.asarray(entries.measured),
        computed=jnp.asarray(prediction.value),
        sd=jnp.asarray(entries.sd),
        half_width=jnp.asarray(prediction.inflated),
        used=jnp.asarray(result.weight > 0),
        chi_square=jnp.asarray(result.chi_square),
        p_value=jnp.asarray(result.p_value),
        freedom=jnp.asarray(result.freedom),
        weak=tuple(direction.words for direction in hardly_known),
        notes=(*notes_of(result, model, value), *model.warnings(points)),
        source=model.source,
        fit=result,
        machine=changed(model.design, variables, jnp.asarray(result.estimate)),
        study=model,
        bounds=jnp.asarray(bounds, float),
    )


def _names(unknown: Variable | CommonFactor) -> list[str]:
    if isinstance(unknown, CommonFactor):
        return [number.name for number in unknown.each]
    return [unknown.name]


def _parameters(
    design: Machine, vary, prior
) -> tuple[list[Variable | CommonFactor], list[Parameter]]:
    for name in prior.keys() - vary.keys():
        raise BadInput("prior", name, one_of(name, vary) + ", which are varied")
    variables = []
    parameters = []
    owners = {}
    for name, bounds in vary.items():
        if name == "motor.mean_speed":
            raise BadInput(
                name, "varied", "given; vary mechanism.bore, which acts as the speed does"
            )
        unbounded = varied(design, name)
        present = float(unbounded.current(design))
        if bounds is None:
            if not present > 0:
                raise BadInput(name, present, "a value above 0, or bounds as LO:HI")
            bounds = 0.5 * present, min(2 * present, unbounded.high)
        low, high = bounds
        unknown = varied(design, name, low, high)
        for path in _names(unknown):
            if path in owners:
                raise BadInput(name, path, f"varied once; {owners[path]} has it already")
            owners[path] = name
        mean, width = prior.get(name, (None, None))
        if width is not None and not width > 0:
            raise BadInput(f"prior of {name}", width, "a positive standard deviation")
        parameter = Parameter(
            name=name,
            low=low,
            high=high,
            start=float(np.clip(present, low, high)),
            prior=mean,
            sd=width,
            # angles and temperatures have no zero that a ratio could count from
            log=low > 0 and unknown.unit not in ("rad", "K"),
            unit=unknown.unit,
        )
        variables.append(unknown)
        parameters.append(parameter)
    return variables, parameters
