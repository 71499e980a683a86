"""What a tolerance study has found: its numbers by name, and its answer in sentences."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ..._core.declared import Record, part, reading, word
from ..._core.nested import fields_of

# Percentiles of every quantity: the median, 5 % on either side, and three deviations of a normal one.
_PERCENTILES = {"0.135": 0.00135, "5": 0.05, "50": 0.5, "95": 0.95, "99.865": 0.99865}
UNITS = """
    corrections [kg m]
    variables.*: low, high, nominal, deviation {beside}; sigmas
    correlations: value
    samples, failed
    quantities.*: mean, mean_error, deviation, deviation_error, percentiles, nominal {beside}
    quantities.*: skewness
    quantities.*.first_order|quantities.*.second_order: mean, deviation {quantity}
    quantities.*.contributors: share; at_low_limit, at_high_limit {quantity}
    limits: bound {quantity}; sampled, sampled_interval, beta, first_order, second_order
    limits: near_points, near_points_error, nearest_points, importance
    limits: most_likely_design {named}
"""


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


def nested(study: Any) -> dict[str, Any]:
    """Variables, quantities and limits of `Tolerances`, nested."""
    ok = study.sampled.ok
    variables = {}
    for place, name in enumerate(study.variables):
        variables[name] = _variable(study, place)
    correlations = []
    for pair, value in study.scatter.given:
        correlations.append({"between": pair, "value": value})
    quantities = {}
    for place, name in enumerate(study.names):
        quantities[name] = _quantity(study, place)
    return {
        "corrections": dict(study.problem.design.corrections),
        "variables": variables,
        "correlations": correlations,
        "samples": len(ok),
        "failed": int((~ok).sum()),
        "quantities": quantities,
        "limits": [_limit(study, risk) for risk in study.reliability],
        "remarks": study.remarks,
    }


def _variable(study: Any, place: int) -> dict[str, Any]:
    variable = study.problem.variables[place]
    return {
        "unit": variable.unit,
        "nominal": study.nominal[place],
        "deviation": study.deviation[place],
        **study.scatter.tolerances[variable.name]._asdict(),
    }


def _quantity(study: Any, place: int) -> dict[str, Any]:
    sampled = study.sampled
    name = study.names[place]
    levels = [None] * len(_PERCENTILES)
    if sampled.ok.sum() > 1:
        levels = sampled.quantile([*_PERCENTILES.values()])[:, place]
    statistics = {}
    for key in ("mean", "mean_error", "deviation", "deviation_error", "skewness"):
        statistics[key] = getattr(sampled, key)[place]
    contributors = []
    for variable, share in study.ranking(name):
        low, high = study.swings[:, study.variables.index(variable), place]
        contributors.append(
            {"variable": variable, "share": share, "at_low_limit": low, "at_high_limit": high}
        )
    return {
        "unit": study.problem.units[place],
        "nominal": study.value[place],
        **statistics,
        "percentiles": dict(zip(_PERCENTILES, levels, strict=True)),
        "first_order": _moments(study.first_order, place),
        "second_order": _moments(study.second_order, place),
        "contributors": contributors,
    }


def _moments(moments: Any, place: int) -> dict[str, Any] | None:
    if moments is None:
        return None
    return {"mean": moments.mean[place], "deviation": moments.deviation[place]}


def _limit(study: Any, risk: Any) -> dict[str, Any]:
    design = None
    if all(map(math.isfinite, risk.design)):
        design = dict(zip(study.variables, risk.design, strict=True))
    return {
        "quantity": risk.limit.quantity,
        "bound": risk.limit.bound,
        "broken_above": risk.limit.above,
        **fields_of(risk, "sampled", "sampled_interval", "beta", "first_order", "second_order"),
        **fields_of(risk, "near_points", "near_points_error"),
        "nearest_points": len(risk.points),
        "most_likely_design": design,
        "importance": dict(zip(study.variables, risk.importance, strict=True)),
    }


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
