"""Constants of a compressor from its rated points, and the points that were not measured."""

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
from scipy.spatial import ConvexHull, QhullError

from .._core.errors import BadInput
from .._core.results import Data, Result
from .._core.words import one_of
from ..cylinder import Cylinder
from ..fluid import RealGas
from ..machine import Machine, assembled, machine_of
from . import Variable, matching, variable
from ._fit import Fit, Parameter, fit
from ._readings import MEASURED, Readings, joined
from .rating import QUANTITIES, RatingPoints, rated

_COLUMN = {name: n for n, (name, *_) in enumerate(QUANTITIES)}
# Share of the prior's deviation that is left, above which the readings say nothing of a parameter.
_SAY_NOTHING = 0.9
# p-values below which a model is rejected, and above which the deviations were too large.
_REJECTED, _TOO_GOOD = 0.01, 0.99
# Weight that a robust loss leaves to a reading, below which it is named.
_LITTLE = 0.5


class HeldOut(NamedTuple):
    """How a quantity was predicted at points that the fit did not see.

    Attributes:
        count: of points.
        rms, largest: relative, or [K] for temperatures.
        inside: [-] share within the inflated 95 % intervals.
    """

    count: int
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
        high = min(2.0, *(one.bound.high / float(one.current(design)) for one in each))
    low = 0.5 if low is None else low
    return CommonFactor(name, each, low, high)


class Identification(Result, eqx.Module):
    """What rated points tell of a machine.

    Attributes:
        parameters: (p,) paths of the constants.
        units: (p,) SI units.
        estimate: (p,) their values.
        standard_error: (p,)
        covariance: (p, p)
        start: (p,) values of the machine file.
        prior_share: (p,) standard error over that of the prior; not a number without one.
        quantity: (m,) name of every reading.
        row: (m,) its point.
        evaporating, condensing: [K] (m,) of the point.
        speed: [rad/s] (m,)
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
    """

    parameters: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    estimate: Float[Array, " p"]
    standard_error: Float[Array, " p"]
    covariance: Float[Array, "p p"]
    start: Float[Array, " p"]
    prior_share: Float[Array, " p"]
    quantity: tuple[str, ...] = eqx.field(static=True)
    row: Int[Array, " m"]
    evaporating: Float[Array, " m"]
    condensing: Float[Array, " m"]
    speed: Float[Array, " m"]
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

    table_dims: ClassVar[tuple[str, ...]] = ("reading",)
    not_saved: ClassVar[tuple[str, ...]] = ("fit", "machine")

    def described(self) -> Iterator[Data]:
        """The quantities of this result; readings in the units of their quantities."""
        for n, (name, unit) in enumerate(zip(self.parameters, self.units, strict=True)):
            yield Data(f"estimate.{name}", unit, self.estimate[n])
            yield Data(f"standard_error.{name}", unit, self.standard_error[n])
        yield Data("chi_square", "", self.chi_square)
        yield Data("p_value", "", self.p_value)
        yield Data("freedom", "", self.freedom)
        at = self.table_dims
        yield Data("row", "", self.row, at)
        yield Data("quantity", "", np.array([_NUMBER[q] for q in self.quantity]), at, _NUMBERS)
        yield Data("evaporating", "K", self.evaporating, at)
        yield Data("condensing", "K", self.condensing, at)
        yield Data("speed", "rad/s", self.speed, at)
        for name in ("measured", "computed", "sd", "half_width", "used"):
            yield Data(name, "", getattr(self, name), at, "in the SI unit of its quantity")

    def error(self, name: str) -> NDArray:
        """(m of this quantity,) computed less measured: relative, or [K] for temperatures."""
        mine = self.of(name)
        off = np.asarray(self.computed - self.measured)[mine]
        return off / np.asarray(self.measured)[mine] if MEASURED[name][1] else off

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


_NUMBER = {name: n for n, name in enumerate(MEASURED)}
_NUMBERS = ", ".join(f"{n}: {name}" for name, n in _NUMBER.items())


def identify(
    machine: Any,
    readings: Readings | Sequence[Readings],
    vary: Mapping[str, tuple[float, float] | None],
    prior: Mapping[str, tuple[float, float]] | None = None,
    *,
    sd: Mapping[str, float] | None = None,
    hold_out: Sequence[int] = (),
    loss: str = "linear",
    starts: int = 3,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Find constants of a compressor with valves from its rated points, and predict those held out.

    Speeds are taken as constant over the revolution. Every point is one call of one compiled program,
    which hands back the exact slopes over all constants as well, so that further points, starts and
    hold-outs compile nothing.

    Args:
        machine: a machine or a scene; its speed counts for points without one.
        readings: the points, of one source or several.
        vary: [SI] (low, high) by path of the constant, as `jaxcomp.study.variable` takes it, or of the
            common factor by pattern; half to twice the machine's value for `None`.
        prior: [SI] (mean, standard deviation) by path, of those that are varied.
        sd: standard deviations by quantity instead of the usual ones, relative but for temperatures.
        hold_out: rows that the fit does not see.
        loss: as in `fit`.
        starts: as in `fit`.
        seed: as in `fit`.
        progress: is told what is found on the way.

    Raises:
        BadInput: points that cannot be, a machine without valves or a real gas, a constant that does
            not vary alone, fewer readings than constants, or points that have no solution at the start.
    """
    sources = [readings] if isinstance(readings, Readings) else list(readings)
    design, prior = machine_of(machine), dict(prior or {})
    compressor = assembled(design).compressor
    gas = None if compressor is None else compressor.gas
    if compressor is None or not isinstance(gas, Cylinder) or not isinstance(gas.fluid, RealGas):
        raise BadInput("gas", type(gas).__name__, "a cylinder with valves and a real gas")
    if not gas.inert:
        bound = "given on both valves: without, a cycle has no exact slopes"
        raise BadInput("port_length", "absent", bound)
    for one in sources:
        one.check(gas.fluid)
    for name in (sd or {}).keys() - MEASURED.keys():
        raise BadInput("sd", name, one_of(name, MEASURED))
    points = joined(sources)
    count = points.evaporating.size
    for number in hold_out:
        if not 0 <= number < count:
            raise BadInput("hold_out", number, f"a row from 0 to {count - 1}")
    variables, parameters = _parameters(design, vary, prior)
    model = _Model(design, compressor, variables, points)
    kinds = [name for name in MEASURED if name in points.values]
    entries = [
        (row, name)
        for name in kinds
        for row in range(count)
        if np.isfinite(points.values[name][row])
    ]
    if not entries:
        raise BadInput(points.source, "nothing measured", f"one of {', '.join(MEASURED)} at least")
    rows = np.array([row for row, _ in entries])
    columns = np.array([_COLUMN[name] for _, name in entries])
    measured = np.array([points.values[name][row] for row, name in entries])
    deviation = np.array([points.deviation(name, sd or {})[row] for row, name in entries])
    seen = ~np.isin(rows, np.asarray(hold_out, int))
    wanted = sorted(set(rows[seen].tolist()))

    def readings_of(p):
        value, slope = model(p, wanted)
        return value[rows, columns], slope[rows, columns]

    first, _ = readings_of(np.array([one.start for one in parameters]))
    failed = sorted({points.names[row] for row in rows[seen & ~np.isfinite(first)]})
    if failed:
        bound = "one with a solution with the machine's values; leave it out or begin elsewhere"
        raise BadInput(f"{points.source}: points", ", ".join(failed), bound)
    found = fit(
        readings_of,
        parameters,
        measured,
        deviation,
        weight=seen,
        loss=loss,
        starts=starts,
        seed=seed,
        progress=progress,
    )
    value, slope = model(found.estimate, range(count))
    said = found.predict(value[rows, columns], slope[rows, columns], deviation)
    for one, number in zip(variables, found.estimate, strict=True):
        design = one.apply(design, jnp.asarray(number))
    notes = [*_notes(found, points, entries, value, columns), *_outside(points, wanted)]
    arrays = (found.estimate, found.standard_error, found.covariance)
    return Identification(
        tuple(one.name for one in variables),
        tuple(one.unit for one in variables),
        *map(jnp.asarray, arrays),
        jnp.asarray([one.start for one in parameters]),
        jnp.asarray(found.prior_share),
        tuple(name for _, name in entries),
        jnp.asarray(rows),
        jnp.asarray(points.evaporating[rows]),
        jnp.asarray(points.condensing[rows]),
        jnp.asarray(model.speed[rows]),
        *map(jnp.asarray, (measured, said.value, deviation, said.inflated, seen)),
        jnp.asarray(found.chi_square),
        jnp.asarray(found.p_value),
        jnp.asarray(found.freedom),
        tuple(one.words for one in found.directions if one.weak or one.unidentifiable),
        tuple(notes),
        points.source,
        found,
        design,
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


class _Model:
    """Quantities and slopes at points, each solved where it is wanted and kept for the same constants."""

    def __init__(
        self,
        design: Machine,
        compressor,
        variables: list[Variable | CommonFactor],
        points: Readings,
    ):
        nominal = float(compressor.motor.speed_guess)
        self.speed = np.where(np.isfinite(points.speed), points.speed, nominal)
        names = ("evaporating", "condensing", "gas", "liquid", "useful")
        self.points = np.stack([*(getattr(points, name) for name in names), self.speed])
        self.size = len(variables)

        def build(p):
            changed = design
            for one, value in zip(variables, p, strict=True):
                changed = one.apply(changed, value)
            made = assembled(changed).compressor
            assert made is not None
            return made

        self.solve = jax.jit(lambda p, at: rated(build, p, RatingPoints(*at)))

    def __call__(self, p: NDArray, wanted) -> tuple[NDArray, NDArray]:
        """(n, quantities) and (n, quantities, p); not a number at points that fail or are not wanted."""
        count = self.points.shape[1]
        value = np.full((count, len(QUANTITIES)), np.nan)
        slope = np.full((count, len(QUANTITIES), self.size), np.nan)

        def at(row):
            found = self.solve(jnp.asarray(p), jnp.asarray(self.points[:, row : row + 1]))
            return [np.asarray(one)[0] for one in found]

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            wanted = list(wanted)
            first = [at(row) for row in wanted[:1]]  # compiled once, not by every thread
            for row, (here, along, ok) in zip(
                wanted, [*first, *pool.map(at, wanted[1:])], strict=True
            ):
                if ok:
                    value[row], slope[row] = here, along
        return value, slope


def _notes(found: Fit, points: Readings, entries, value, columns) -> Iterator[str]:
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
    if found.p_value > _TOO_GOOD:
        yield "the readings fit better than their deviations allow: these are too large"
    for other in found.minima:
        pairs = zip(found.parameters, other.estimate, strict=True)
        where = ", ".join(f"{one.name} {at:.4g}" for one, at in pairs)
        yield f"a second minimum, chi-square {other.chi_square:.4g}: {where}"
    if points.polynomial:
        yield "the points are made from a polynomial and are no readings: chi-square is a hint alone"
    if not found.converged:
        yield "the solver did not converge"
    for weight, (row, name) in zip(found.robust, entries, strict=True):
        if weight < _LITTLE:
            yield f"{name} at {points.names[row]} counts {weight:.0%}"
    for row in sorted({row for row, _ in entries}):
        if not np.isfinite(value[row]).all():
            yield f"point {points.names[row]} has no solution with the estimates"
    del columns


def _outside(points: Readings, wanted: list[int]) -> Iterator[str]:
    """Names of points held out that lie outside the hull of those used."""
    rest = sorted(set(range(points.evaporating.size)) - set(wanted))
    at = np.stack([points.evaporating, points.condensing], axis=-1)
    try:
        sides = ConvexHull(at[wanted]).equations
        far = [row for row in rest if (sides[:, :2] @ at[row] + sides[:, 2] > 0.5).any()]
    except (QhullError, ValueError):
        far = rest
    if far:
        names = ", ".join(points.names[row] for row in far)
        yield f"predicted outside of the points used: {names}"
    speeds = set(np.nan_to_num(points.speed[wanted]).round(3).tolist())
    if set(np.nan_to_num(points.speed[rest]).round(3).tolist()) - speeds:
        yield "predicted at speeds that were not used: one speed cannot tell the law of speed"
