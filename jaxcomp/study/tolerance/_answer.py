"""What a tolerance study has found: its numbers by name, and its answer in sentences."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ..._core.declared import (
    BESIDE,
    NAMED,
    QUANTITY,
    Measured,
    Record,
    part,
    reading,
    word,
)
from .._problem import measured_by_name
from ._reliability import Reliability
from ._scatter import Within

# Percentiles of every quantity: the median, 5 % on either side, and three deviations of a normal one.
_PERCENTILES = {"0.135": 0.00135, "5": 0.05, "50": 0.5, "95": 0.95, "99.865": 0.99865}


@dataclass(frozen=True)
class ScatteredVariable(Record):
    """A variable and its tolerance.

    Attributes:
        unit: SI unit of the variable.
        nominal, deviation: [SI] nominal value and standard deviation.
        tolerance: of it.
    """

    unit: str = word()
    nominal: float = reading(BESIDE)
    deviation: float = reading(BESIDE)
    tolerance: Within = part(Within, inline=True)


@dataclass(frozen=True)
class Correlation(Record):
    """A correlation of two deviations.

    Attributes:
        between: names of the two variables.
        value: [-]
    """

    between: tuple[str, ...] = word()
    value: float = reading("")


@dataclass(frozen=True)
class Contributor(Record):
    """A variable and what it does to a quantity.

    Attributes:
        variable: name.
        share: [-] of the variance.
        at_low_limit, at_high_limit: [SI] the quantity with the variable there and the others at their
            means; NaN where it cannot be solved.
    """

    variable: str = word()
    share: float = reading("")
    at_low_limit: float = reading(QUANTITY)
    at_high_limit: float = reading(QUANTITY)


@dataclass(frozen=True)
class QuantityMoments(Record):
    """Mean and standard deviation of a quantity by derivatives.

    Attributes:
        mean, deviation: [SI]
    """

    mean: float = reading(QUANTITY)
    deviation: float = reading(QUANTITY)


@dataclass(frozen=True)
class ScatteredQuantity(Record):
    """A quantity and its scatter.

    Attributes:
        unit: its SI unit.
        nominal: [SI] of the nominal machine.
        mean, mean_error, deviation, deviation_error: [SI] by the samples, with standard errors.
        skewness: [-] by the samples.
        percentiles: [SI] by their names; `None` where too few samples were solved.
        first_order, second_order: by derivatives; the second `None` without curvature.
        contributors: every variable, that with the largest share first.
    """

    unit: str = word()
    nominal: float = reading(BESIDE)
    mean: float = reading(BESIDE)
    mean_error: float = reading(BESIDE)
    deviation: float = reading(BESIDE)
    deviation_error: float = reading(BESIDE)
    skewness: float = reading("")
    percentiles: dict[str, float | None] = reading(BESIDE)
    first_order: QuantityMoments | None = part(QuantityMoments)
    second_order: QuantityMoments | None = part(QuantityMoments)
    contributors: tuple[Contributor, ...] = part(Contributor)


@dataclass(frozen=True)
class BrokenLimit(Record):
    """A limit, and how probable and by which machine it is broken.

    Attributes:
        risk: its reliability.
        most_likely_design: [SI] variables by name of the most likely machine that breaks it; `None`
            where none was found.
        importance: [-] squared direction cosines of the nearest point, by variable.
    """

    risk: Reliability = part(Reliability, inline=True)
    most_likely_design: dict[str, Measured] | None = reading(NAMED)
    importance: dict[str, float] = reading("")


@dataclass(frozen=True)
class Permitted(Record):
    """Tolerances that keep the rejects below a share.

    Attributes:
        variables: whose tolerances are changed.
        factor: [-] on each of them: below one they have to be tighter. NaN where the limit is broken
            however tight they are.
        rejects: [-] share of the machines that break a limit then, all of them solved again.
        before: [-] as the tolerances stand.
    """

    variables: tuple[str, ...] = word()
    factor: float = reading("")
    rejects: float = reading("")
    before: float = reading("")


@dataclass(frozen=True)
class PermittedTolerances(Record):
    """Tolerances that keep the rejects below a share, of all variables and of each."""

    permitted: tuple[Permitted, ...] = part(Permitted)


def scattered_variable(study: Any, place: int) -> ScatteredVariable:
    """A variable of `Tolerances`."""
    variable = study.problem.variables[place]
    return ScatteredVariable(
        unit=variable.unit,
        nominal=study.nominal[place],
        deviation=study.deviation[place],
        tolerance=study.scatter.tolerances[variable.name],
    )


def scattered_quantity(study: Any, place: int) -> ScatteredQuantity:
    """A quantity of `Tolerances`."""
    sampled = study.sampled
    name = study.names[place]
    levels = [None] * len(_PERCENTILES)
    if sampled.ok.sum() > 1:
        levels = sampled.quantile([*_PERCENTILES.values()])[:, place]
    contributors = []
    for variable, share in study.ranking(name):
        low, high = study.swings[:, study.variables.index(variable), place]
        contributors.append(Contributor(variable, share, at_low_limit=low, at_high_limit=high))
    return ScatteredQuantity(
        unit=study.problem.units[place],
        nominal=study.value[place],
        mean=sampled.mean[place],
        mean_error=sampled.mean_error[place],
        deviation=sampled.deviation[place],
        deviation_error=sampled.deviation_error[place],
        skewness=sampled.skewness[place],
        percentiles=dict(zip(_PERCENTILES, levels, strict=True)),
        first_order=_moments(study.first_order, place),
        second_order=_moments(study.second_order, place),
        contributors=tuple(contributors),
    )


def _moments(moments: Any, place: int) -> QuantityMoments | None:
    if moments is None:
        return None
    return QuantityMoments(moments.mean[place], moments.deviation[place])


def broken_limit(study: Any, risk: Reliability) -> BrokenLimit:
    """A limit of `Tolerances`."""
    design = None
    if all(map(math.isfinite, risk.design)):
        units = study.problem.variable_units
        design = measured_by_name(study.variables, units, risk.design)
    importance = dict(zip(study.variables, risk.importance, strict=True))
    return BrokenLimit(risk, design, importance)


def sentences(study: Any, permitted: Sequence[Permitted]) -> Iterator[str]:
    """A sentence for each limit and each quantity without risk, then for tighter tolerances."""
    limited = {risk.limit.quantity for risk in study.reliability}
    for risk in study.reliability:
        look = study.shown(risk.limit.quantity)
        side = "exceed" if risk.limit.above else "fall below"
        low, high = risk.sampled_interval
        yield (
            f"About {100 * risk.sampled:.2g} % of the machines {side} {look.text(risk.limit.bound)} "
            f"({look.words.lower()}; {100 * low:.2g} to {100 * high:.2g} % with 95 % confidence). "
            f"{_causes(study, risk.limit.quantity)}"
        )
    for place, name in enumerate(study.names):
        mean = study.sampled.mean[place]
        spread = study.sampled.deviation[place]
        if name not in limited and math.isfinite(spread):
            look = study.shown(name)
            yield (
                f"{look.words}: {look.text(mean)} on average, with a standard deviation of "
                f"{look.difference(spread, 3)}. {_causes(study, name)}"
            )
    for tolerances in permitted:
        whose = "all tolerances"
        if len(tolerances.variables) != len(study.variables):
            whose = f"that of {study.label(tolerances.variables[0])}"
        if not math.isfinite(tolerances.factor):
            yield f"Changing {whose} does not bring the rejects down so far."
            continue
        word = "tightened" if tolerances.factor < 1 else "widened"
        yield (
            f"With {whose} {word} to {tolerances.factor:.3g} times what they are, "
            f"{100 * tolerances.rejects:.2g} % are rejected."
        )


def _causes(study: Any, name: str) -> str:
    ranked = []
    for variable, share in study.ranking(name):
        if math.isfinite(share):
            ranked.append((variable, share))
    if not ranked:
        return ""
    (first, largest), *following = ranked[:3]
    causes = [f"{study.label(first)} causes {100 * min(largest, 1):.0f} % of the variance"]
    for variable, share in following:
        if share > 0.05:
            causes.append(f"{study.label(variable)} {100 * min(share, 1):.0f} %")
    text = ", ".join(causes)
    return f"{text[:1].upper()}{text[1:]}."
