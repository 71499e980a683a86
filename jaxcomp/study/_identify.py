"""Constants of a machine from its measurements, and the points that were not measured."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.results import Data, Result
from .._core.words import one_of
from ..machine import Machine, machine_of
from ._fit import Fit, Parameter, Prediction, check_problem, fit
from ._measurement import AbstractMeasurement, Entries, Kind
from ._variables import Variable, matching, variable

# Share of the prior's deviation that is left, above which the readings say nothing of a parameter.
_SAY_NOTHING = 0.9
# p-values below which a model is rejected, and above which the deviations were too large.
_REJECTED, _TOO_GOOD = 0.01, 0.99
# Spread of the mean residuals of two speeds, in their deviations, beyond which their law does not fit.
_TOGETHER = 4.0
# Weight that a robust loss leaves to a reading, below which it is named.
_LITTLE = 0.5


class HeldOut(NamedTuple):
    """How a quantity was predicted at points that the fit did not see.

    Attributes:
        count: of points.
        rms, largest: relative, or [K] for temperatures.
        inside: [-] share within the inflated 95 % intervals.
    """

    count: int  # pyright: ignore[reportIncompatibleMethodOverride]  # of points, and no entries
    rms: float
    largest: float
    inside: float


class CommonFactor(NamedTuple):
    """One factor on several numbers of a machine, of which only the product is told.

    Attributes:
        name: pattern that the numbers fit.
        each: the numbers.
        low, high: [-] range of the factor.
    """

    name: str
    each: tuple[Variable, ...]
    low: float
    high: float
    unit: str = ""

    @property
    def bare(self) -> "CommonFactor":
        """Without its range."""
        return self._replace(each=tuple(one.bare for one in self.each), low=0.0, high=0.0)

    def current(self, design: Machine) -> float:
        """1, as the machine stands."""
        del design
        return 1.0

    def apply(self, design: Machine, value) -> Machine:
        """The machine with all numbers times a factor; unchecked."""
        for one in self.each:
            # the current value of a list is already the factor 1 on it
            design = one.apply(design, one.current(design) * value)
        return design


def varied(
    design: Machine, name: str, low: float | None = None, high: float | None = None
) -> Variable | CommonFactor:
    """What a path varies: a number, or for a pattern a common factor on all that fit it.

    Args:
        design: the machine.
        name: as `jaxcomp.study.variable` and `matching` take it.
        low, high: [SI] the range, of the factor for a pattern.

    Raises:
        BadInput: no such number, or a range outside its bounds.
    """
    names = matching(design, name)
    if names == [name]:
        return variable(design, name, low, high)
    each = tuple(variable(design, one) for one in names)
    for one in each:
        for end in (low, high):
            size = None if end is None else float(one.current(design)) * end
            if size is not None and not bool(one.bound.holds(size)):
                raise BadInput(f"{name}: {one.name}", size, str(one.bound))
    if high is None:  # as far as all of them may go
        now = ((one.bound.high, float(one.current(design))) for one in each)
        high = min(2.0, *(most / value for most, value in now if value > 0))
    low = 0.5 if low is None else low
    return CommonFactor(name, each, low, high)


class Identification(Result, eqx.Module):
    """What measurements tell of a machine.

    Attributes:
        parameters: (p,) paths of the constants, then the constants of the measurements themselves.
        units: (p,) SI units.
        estimate: (p,) their values.
        standard_error: (p,)
        covariance: (p, p)
        start: (p,) values of the machine file.
        prior_share: (p,) standard error over that of the prior; not a number without one.
        constants: how many of them are numbers of the machine.
        quantity: (m,) name of every reading.
        kinds: unit of every quantity, and whether its error is relative.
        point: (m,) number of its point, counted over all measurements.
        names: (m,) of its conditions.
        conditions: [SI] (m,) numbers by name; not a number where a reading has none of this name.
        condition_units: their SI units.
        measured, computed: [SI] (m,)
        sd: [SI] (m,) of the readings.
        half_width: [SI] (m,) of the 95 % interval of the prediction, inflated by the fit's scatter.
        used: (m,) whether the fit saw it.
        chi_square, p_value: of the fit.
        freedom: readings and priors less parameters.
        weak: combinations that the readings hardly tell, in words.
        notes: what is not to be trusted, in words.
        source: of the readings.
        fit: with slopes and profiles.
        machine: with the estimates.
        study: predicts other points.
    """

    parameters: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    estimate: Float[Array, " p"]
    standard_error: Float[Array, " p"]
    covariance: Float[Array, "p p"]
    start: Float[Array, " p"]
    prior_share: Float[Array, " p"]
    constants: int = eqx.field(static=True)
    quantity: tuple[str, ...] = eqx.field(static=True)
    kinds: dict[str, Kind] = eqx.field(static=True)
    point: Int[Array, " m"]
    names: tuple[str, ...] = eqx.field(static=True)
    conditions: dict[str, Float[Array, " m"]]
    condition_units: dict[str, str] = eqx.field(static=True)
    measured: Float[Array, " m"]
    computed: Float[Array, " m"]
    sd: Float[Array, " m"]
    half_width: Float[Array, " m"]
    used: Bool[Array, " m"]
    chi_square: Float[Array, ""]
    p_value: Float[Array, ""]
    freedom: Int[Array, ""]
    weak: tuple[str, ...] = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True)
    source: str = eqx.field(static=True)
    fit: Any = eqx.field(static=True, default=None)
    machine: Machine | None = None
    study: Any = eqx.field(static=True, default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("reading",)
    not_saved: ClassVar[tuple[str, ...]] = ("fit", "machine", "study", "kinds", "condition_units")

    def described(self) -> Iterator[Data]:
        """The quantities of this result; readings in the units of their quantities."""
        for n, (name, unit) in enumerate(zip(self.parameters, self.units, strict=True)):
            yield Data(f"estimate.{name}", unit, self.estimate[n])
            yield Data(f"standard_error.{name}", unit, self.standard_error[n])
        yield Data("chi_square", "", self.chi_square)
        yield Data("p_value", "", self.p_value)
        yield Data("freedom", "", self.freedom)
        at, quantities = self.table_dims, self.quantities
        yield Data("point", "", self.point, at)
        numbers = ", ".join(f"{n}: {name}" for n, name in enumerate(quantities))
        yield Data(
            "quantity", "", np.array([quantities.index(q) for q in self.quantity]), at, numbers
        )
        for name, values in self.conditions.items():
            yield Data(f"at.{name}", self.condition_units[name], values, at)
        for name in ("measured", "computed", "sd", "half_width", "used"):
            yield Data(name, "", getattr(self, name), at, "in the SI unit of its quantity")

    def error(self, name: str) -> NDArray:
        """(m of this quantity,) computed less measured: relative, or in the SI unit."""
        mine = self.of(name)
        off = np.asarray(self.computed - self.measured)[mine]
        return off / np.asarray(self.measured)[mine] if self.kinds[name].relative else off

    def of(self, name: str) -> NDArray:
        """(m,) whether a reading is of this quantity."""
        return np.array([one == name for one in self.quantity])

    @property
    def quantities(self) -> list[str]:
        """Names of what was measured."""
        return list(dict.fromkeys(self.quantity))

    @property
    def held_out(self) -> dict[str, HeldOut]:
        """By quantity, how points were predicted that the fit did not see."""
        out = {}
        for name in self.quantities:
            mine = self.of(name)
            left = ~np.asarray(self.used)[mine] & np.isfinite(np.asarray(self.computed)[mine])
            if not left.any():
                continue
            error = self.error(name)[left]
            off = np.abs(np.asarray(self.computed - self.measured))[mine][left]
            inside = off <= np.asarray(self.half_width)[mine][left]
            rms = float(np.sqrt(np.mean(error**2)))
            out[name] = HeldOut(
                int(left.sum()), rms, float(np.abs(error).max()), float(inside.mean())
            )
        return out

    def predict(self, measurement: AbstractMeasurement) -> tuple[Entries, Prediction]:
        """What the identified machine says of other readings, with intervals.

        Args:
            measurement: of which the conditions count, and the standard deviations for the intervals of
                readings; the measured values may be anything.

        Raises:
            BadInput: a result that was loaded.
        """
        if self.study is None:
            raise BadInput("study", "absent", "that of the identification, for predictions")
        blocks = _Blocks(self.study.design, self.study.variables, [measurement], {})
        count = len(self.study.variables)
        at = np.asarray(self.estimate)[:count]
        # constants of the measurement as they were found, where it is of the same source
        known = {name: n for n, name in enumerate(self.parameters)}
        places = [known.get(one.name) for one in blocks.nuisances]
        own = [
            one.start if n is None else float(self.estimate[n])
            for one, n in zip(blocks.nuisances, places, strict=True)
        ]
        value, slope = blocks(np.concatenate([at, own]), range(blocks.count))
        whole = np.zeros((value.size, len(self.parameters)))
        whole[:, :count] = slope[:, :count]
        for n, column in zip(places, slope[:, count:].T, strict=True):
            if n is not None:
                whole[:, n] = column
        return blocks.entries, self.fit.predict(value, whole, blocks.entries.sd)


def identify(
    machine: Any,
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
    for one in given:
        one.check(design)
    known = list(dict.fromkeys(name for one in given for name in one.names_of_sd))
    for name in (sd or {}).keys() - set(known):
        raise BadInput("sd", name, one_of(name, known))
    variables, parameters = _parameters(design, vary, prior)
    blocks = _Blocks(design, tuple(variables), given, sd or {})
    parameters += blocks.nuisances
    for number in hold_out:
        if not 0 <= number < blocks.count:
            raise BadInput("hold_out", number, f"a point from 0 to {blocks.count - 1}")
    entries = blocks.entries
    seen = ~np.isin(entries.point, np.asarray(hold_out, int))
    wanted = sorted(set(entries.point[seen].tolist()))

    check_problem(parameters, entries.measured, entries.sd, seen, loss)

    def readings(p):
        return blocks(p, wanted)

    first, _ = readings(np.array([one.start for one in parameters]))
    bad = np.flatnonzero(seen & ~np.isfinite(first))
    if bad.size:
        failed = sorted({entries.names[row] for row in bad})
        bound = "one with a solution with the machine's values; leave it out or begin elsewhere"
        raise BadInput(f"{blocks.source}: points", ", ".join(failed), bound)
    found = fit(
        readings, parameters, entries.measured, entries.sd,
        weight=seen, loss=loss, starts=starts, seed=seed, progress=progress, keep=keep,
    )  # fmt: skip
    value, slope = blocks(found.estimate, wanted if found.interrupted else range(blocks.count))
    said = found.predict(value, slope, entries.sd)
    for one, number in zip(variables, found.estimate, strict=False):
        design = one.apply(design, jnp.asarray(number))
    notes = [*_notes(found, blocks, value), *blocks.warnings(wanted)]
    arrays = (found.estimate, found.standard_error, found.covariance)
    return Identification(
        tuple(one.name for one in parameters),
        tuple(one.unit for one in parameters),
        *map(jnp.asarray, arrays),
        jnp.asarray([one.start for one in parameters]),
        jnp.asarray(found.prior_share),
        len(variables),
        entries.quantity,
        dict(entries.kinds),
        jnp.asarray(entries.point),
        entries.names,
        {k: jnp.asarray(v) for k, v in entries.conditions.items()},
        dict(entries.units),
        *map(jnp.asarray, (entries.measured, said.value, entries.sd, said.inflated, seen)),
        jnp.asarray(found.chi_square),
        jnp.asarray(found.p_value),
        jnp.asarray(found.freedom),
        tuple(one.words for one in found.directions if one.weak or one.unidentifiable),
        tuple(notes),
        blocks.source,
        found,
        design,
        blocks,
    )


def _names(one: Variable | CommonFactor) -> list[str]:
    return [each.name for each in one.each] if isinstance(one, CommonFactor) else [one.name]


def _parameters(
    design: Machine, vary, prior
) -> tuple[list[Variable | CommonFactor], list[Parameter]]:
    for name in prior.keys() - vary.keys():
        raise BadInput("prior", name, one_of(name, vary) + ", which are varied")
    variables, parameters, taken = [], [], {}
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


@kept_jit
def _solve(measurement, design, variables, parameters, nuisances, point):
    """Values, slopes and status at one point; `measurement` and `variables` are static."""

    def build(p):
        changed = design
        for number, one in enumerate(variables):
            changed = one.apply(changed, p[number])
        return changed

    return measurement.values(build, parameters, nuisances, point)


class _Blocks:
    """All readings of several measurements as one model of the constants."""

    def __init__(self, design, variables, measurements, sd: Mapping[str, float]):
        # without their ranges, which are no part of the program
        self.variables = tuple(one.bare for one in variables)
        self.design, self.measurements = design, measurements
        self.programs = [one.bare for one in measurements]
        parts = [one.entries(sd) for one in measurements]
        self.points = [one.points(design) for one in measurements]
        sizes = [len(jax.tree.leaves(one)[0]) for one in self.points]
        self.first = np.concatenate([[0], np.cumsum(sizes)])
        self.nuisances, self.own = [], []
        for one in measurements:
            begin = len(variables) + len(self.nuisances)
            self.nuisances += [
                each._replace(name=f"{one.source}: {each.name}") for each in one.nuisances
            ]
            self.own.append(slice(begin, begin + len(one.nuisances)))
        self.block = np.repeat(np.arange(len(parts)), [part.measured.size for part in parts])
        names = list(dict.fromkeys(name for part in parts for name in part.conditions))

        def condition(part: Entries, name: str):
            return part.conditions.get(name, np.full(part.measured.size, np.nan))

        def whole(field: str):
            return np.concatenate([getattr(part, field) for part in parts])

        self.entries = Entries(
            tuple(name for part in parts for name in part.quantity),
            {k: v for part in parts for k, v in part.kinds.items()},
            np.concatenate([p.point + n for p, n in zip(parts, self.first[:-1], strict=True)]),
            *map(whole, ("column", "measured", "sd")),
            tuple(name for part in parts for name in part.names),
            {name: np.concatenate([condition(part, name) for part in parts]) for name in names},
            {k: v for part in parts for k, v in part.units.items()},
        )

    @property
    def source(self) -> str:
        """Names of all files."""
        return ", ".join(dict.fromkeys(one.source for one in self.measurements))

    @property
    def count(self) -> int:
        """Of points."""
        return int(self.first[-1])

    def warnings(self, used: Sequence[int]) -> list[str]:
        """What is not to be trusted of points held out."""
        seen = []
        for n, one in enumerate(self.measurements):
            begin, end = self.first[n : n + 2]
            seen.append((one, [int(p - begin) for p in used if begin <= p < end]))
        out = []
        for n, (one, own) in enumerate(seen):
            beside = [pair for k, pair in enumerate(seen) if k != n and type(pair[0]) is type(one)]
            out += one.warnings(own, beside)
        return list(dict.fromkeys(out))

    def __call__(self, p: NDArray, wanted: Sequence[int]) -> tuple[NDArray, NDArray]:
        """(m,) and (m, p); not a number at points that fail or are not wanted."""
        entries = self.entries
        value = np.full(entries.measured.size, np.nan)
        slope = np.full((value.size, len(self.variables) + len(self.nuisances)), np.nan)
        shared = jnp.asarray(p[: len(self.variables)])

        def at(number: int):
            n = int(np.searchsorted(self.first, number, side="right")) - 1
            point = jax.tree.map(lambda a: jnp.asarray(a[number - self.first[n]]), self.points[n])
            own = jnp.asarray(p[self.own[n]])
            found = _solve(self.programs[n], self.design, self.variables, shared, own, point)
            return n, *map(np.asarray, found)

        def put(number: int, n: int, values, slopes, ok):
            mine = (entries.point == number) & (self.block == n)
            if not ok:
                return
            columns = entries.column[mine]
            value[mine] = values[columns]
            slope[mine] = 0.0
            slope[mine, : len(self.variables)] = slopes[columns, : len(self.variables)]
            slope[mine, self.own[n]] = slopes[columns, len(self.variables) :]

        fresh, later, seen = [], [], set()
        for number in wanted:  # the first of each measurement compiles it, not every thread
            n = int(np.searchsorted(self.first, number, side="right"))
            (later if n in seen else fresh).append(number)
            seen.add(n)
        for number in fresh:
            put(number, *at(number))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for number, found in zip(later, pool.map(at, later), strict=True):
                put(number, *found)
        return value, slope


def _law_of_speed(found: Fit, entries: Entries) -> Iterator[str]:
    """Whether readings at some speeds are off together, in words."""
    turns = entries.conditions.get("speed", np.full(found.weight.size, np.nan)) / (2 * np.pi)
    used, off = found.weight > 0, found.residual
    for quantity in dict.fromkeys(entries.quantity):
        mine = used & np.isfinite(turns) & (np.array(entries.quantity) == quantity)
        speeds = np.unique(turns[mine].round(6))
        if speeds.size < 2 or not entries.kinds[quantity].relative:
            continue
        groups = [mine & np.isclose(turns, speed, rtol=1e-4) for speed in speeds]
        # means of n readings, in standard deviations of a mean
        means = [float(off[one].mean() * np.sqrt(one.sum())) for one in groups]
        if max(means) - min(means) > _TOGETHER:
            said = (
                f"{np.mean((found.value / found.measured)[one]) - 1:+.1%} at {speed:.4g} 1/s"
                for speed, one in zip(speeds, groups, strict=True)
            )
            yield (
                f"the law of speed does not fit: {quantity} is off by {', '.join(said)}; factors of "
                "flow and power at each speed (`with_own_factors`, --own-factors) or one speed alone"
            )


def _notes(found: Fit, blocks: _Blocks, value: NDArray) -> Iterator[str]:
    entries = blocks.entries
    used = found.weight > 0
    for one, held in zip(found.parameters, found.at_bound, strict=True):
        if held:
            yield f"{one.name} is held by its bound: it is not identified, its error means nothing"
    for one, share in zip(found.parameters, found.prior_share, strict=True):
        if share > _SAY_NOTHING:
            yield f"the readings say nothing of {one.name}: it stays at its prior"
    silent = np.abs(found.slope[used]).max(axis=0, initial=0.0)
    for one, most in zip(found.parameters, silent, strict=True):
        if most == 0:
            yield f"{one.name} touches nothing that was measured"
    for one in found.directions:
        if one.unidentifiable or one.weak:
            what = "cannot be told" if one.unidentifiable else "is hardly told"
            yield (
                f"a combination {what}: {one.words} changes the residuals by {one.effect:.2g} "
                "standard deviations"
            )
    if used.sum() <= len(found.parameters):
        yield f"{used.sum()} readings for {len(found.parameters)} parameters: the priors decide"
    if found.p_value < _REJECTED:
        yield (
            "the model does not explain the readings within the stated deviations: errors of the "
            f"parameters are too small; intervals of predictions are inflated by {found.scatter:.3g}"
        )
        yield from _law_of_speed(found, entries)
    if found.p_value > _TOO_GOOD:
        yield "the readings fit better than their deviations allow: these are too large"
    for other in found.minima:
        pairs = zip(found.parameters, other.estimate, strict=True)
        where = ", ".join(f"{one.name} {at:.4g}" for one, at in pairs)
        yield f"a second minimum, chi-square {other.chi_square:.4g}: {where}"
    if any(one.polynomial for one in blocks.measurements):
        yield "the points are made from a polynomial and are no readings: chi-square is a hint alone"
    if found.interrupted:
        yield "stopped on the way: these are the best constants so far, and no minimum"
    elif not found.converged:
        yield "the solver did not converge"
    for weight, name, at in zip(found.robust, entries.quantity, entries.names, strict=True):
        if weight < _LITTLE:
            yield f"{name} at {at} counts {weight:.0%}"
    lost = ~np.isfinite(value) & ~(found.interrupted & (found.weight == 0))
    for at in dict.fromkeys(np.array(entries.names)[lost].tolist()):
        yield f"point {at} has no solution with the estimates"
