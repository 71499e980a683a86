"""Constants of a machine from its measurements, and the points that were not measured."""

from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._core.errors import BadInput
from ..._core.words import one_of
from ...machine import HasMachine, Machine, machine_of
from .._variables import Variable, changed
from ._common_factor import CommonFactor, varied
from ._fit import Fit, fit
from ._least_squares import Parameter, check_problem
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
    given = measurements if isinstance(measurements, Sequence) else [measurements]
    design, prior = machine_of(machine), dict(prior or {})
    given = [one.for_machine(design) for one in given]
    for one in given:
        one.check(design)
        one.check_limits(design, list(vary))
    known = list(dict.fromkeys(name for one in given for name in one.names_of_sd))
    for name in (sd or {}).keys() - set(known):
        raise BadInput("sd", name, one_of(name, known))
    variables, parameters = _parameters(design, vary, prior)
    model = ReadingModel(design, tuple(variables), given, sd or {})
    parameters += model.nuisances
    for number in hold_out:
        if not 0 <= number < model.count:
            raise BadInput("hold_out", number, f"a point from 0 to {model.count - 1}")
    entries = model.entries
    seen = ~np.isin(entries.point, np.asarray(hold_out, int))
    wanted = sorted(set(entries.point[seen].tolist()))
    check_problem(parameters, entries.measured, entries.sd, seen, loss)
    _check_start(model, parameters, wanted, seen)
    found = fit(
        lambda p: model(p, wanted), parameters, entries.measured, entries.sd,
        weight=seen, loss=loss, starts=starts, seed=seed, progress=progress, keep=keep,
    )  # fmt: skip
    return _identification(found, model, variables, wanted)


def _check_start(
    model: ReadingModel, parameters: list[Parameter], wanted: list[int], seen: NDArray
) -> None:
    """That all points which the fit sees have a solution with the values it begins with."""
    first, _ = model(np.array([one.start for one in parameters]), wanted)
    bad = np.flatnonzero(seen & ~np.isfinite(first))
    if bad.size:
        failed = sorted({model.entries.names[row] for row in bad})
        bound = "one with a solution with the machine's values; leave it out or begin elsewhere"
        raise BadInput(f"{model.source}: points", ", ".join(failed), bound)


def _identification(
    found: Fit, model: ReadingModel, variables: list[Variable | CommonFactor], wanted: list[int]
) -> Identification:
    """The result of a fit, with what the machine says of all points."""
    entries = model.entries
    value, slope = model(found.estimate, wanted if found.interrupted else range(model.count))
    said = found.predict(value, slope, entries.sd)
    return Identification(
        parameters=tuple(one.name for one in found.parameters),
        units=tuple(one.unit for one in found.parameters),
        estimate=jnp.asarray(found.estimate),
        standard_error=jnp.asarray(found.standard_error),
        covariance=jnp.asarray(found.covariance),
        start=jnp.asarray([one.start for one in found.parameters]),
        prior_share=jnp.asarray(found.prior_share),
        constants=len(variables),
        quantity=entries.quantity,
        kinds=dict(entries.kinds),
        point=jnp.asarray(entries.point),
        names=entries.names,
        conditions={k: jnp.asarray(v) for k, v in entries.conditions.items()},
        condition_units=dict(entries.units),
        measured=jnp.asarray(entries.measured),
        computed=jnp.asarray(said.value),
        sd=jnp.asarray(entries.sd),
        half_width=jnp.asarray(said.inflated),
        used=jnp.asarray(found.weight > 0),
        chi_square=jnp.asarray(found.chi_square),
        p_value=jnp.asarray(found.p_value),
        freedom=jnp.asarray(found.freedom),
        weak=tuple(one.words for one in found.directions if one.weak or one.unidentifiable),
        notes=(*notes_of(found, model, value), *model.warnings(wanted)),
        source=model.source,
        fit=found,
        machine=changed(model.design, variables, jnp.asarray(found.estimate)),
        study=model,
        bounds=jnp.asarray([(one.low, one.high) for one in found.parameters], float),
    )


def _names(one: Variable | CommonFactor) -> list[str]:
    return [each.name for each in one.each] if isinstance(one, CommonFactor) else [one.name]


def _parameters(
    design: Machine, vary, prior
) -> tuple[list[Variable | CommonFactor], list[Parameter]]:
    for name in prior.keys() - vary.keys():
        raise BadInput("prior", name, one_of(name, vary) + ", which are varied")
    variables = []
    parameters = []
    taken = {}
    for name, bounds in vary.items():
        if name == "motor.mean_speed":
            raise BadInput(
                name, "varied", "given; vary mechanism.bore, which acts as the speed does"
            )
        whole = varied(design, name)
        now = float(whole.current(design))
        low, high = (0.5 * now, min(2 * now, whole.high)) if bounds is None else bounds
        if bounds is None and not now > 0:
            raise BadInput(name, now, "a value above 0, or bounds as LO:HI")
        one = varied(design, name, low, high)
        for other in _names(one):
            if other in taken:
                raise BadInput(name, other, f"varied once; {taken[other]} has it already")
            taken[other] = name
        mean, width = prior.get(name, (None, None))
        if width is not None and not width > 0:
            raise BadInput(f"prior of {name}", width, "a positive standard deviation")
        log = low > 0 and one.unit not in ("rad", "K")
        begin = float(np.clip(now, low, high))
        variables.append(one)
        parameters.append(Parameter(name, low, high, begin, mean, width, log, one.unit))
    return variables, parameters
