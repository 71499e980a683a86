"""What a tolerance study has found: its numbers by name, and its answer in sentences."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

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


class Permitted(NamedTuple):
    """Tolerances that keep the rejects below a share.

    Attributes:
        variables: whose tolerances are changed.
        factor: [-] on each of them: below one they have to be tighter. NaN where the limit is broken
            however tight they are.
        rejects: [-] share of the machines that break a limit then, all of them solved again.
        before: [-] as the tolerances stand.
    """

    variables: tuple[str, ...]
    factor: float
    rejects: float
    before: float


def nested(found: Any) -> dict[str, Any]:
    """Variables, quantities and limits of `Tolerances`, nested."""
    ok = found.sampled.ok
    variables = found.problem.variables
    return {
        "corrections": dict(found.problem.design.corrections),
        "variables": {
            one.name: {
                "unit": one.unit,
                "nominal": found.nominal[place],
                "deviation": found.deviation[place],
                **found.scatter.tolerances[one.name]._asdict(),
            }
            for place, one in enumerate(variables)
        },
        "correlations": [{"between": pair, "value": one} for pair, one in found.scatter.given],
        "samples": len(ok),
        "failed": int((~ok).sum()),
        "quantities": {name: _quantity(found, place) for place, name in enumerate(found.names)},
        "limits": [_limit(found, one) for one in found.reliability],
        "remarks": found.remarks,
    }


def _quantity(found: Any, place: int) -> dict[str, Any]:
    sampled = found.sampled
    name = found.names[place]
    levels = [None] * len(_PERCENTILES)
    if sampled.ok.sum() > 1:
        levels = sampled.quantile([*_PERCENTILES.values()])[:, place]
    keys = ("mean", "mean_error", "deviation", "deviation_error", "skewness")
    orders = {key: getattr(found, key) for key in ("first_order", "second_order")}

    def contributor(variable, share):
        low, high = found.swings[:, found.variables.index(variable), place]
        return {"variable": variable, "share": share, "at_low_limit": low, "at_high_limit": high}

    return {
        "unit": found.problem.units[place],
        "nominal": found.value[place],
        **{key: getattr(sampled, key)[place] for key in keys},
        "percentiles": dict(zip(_PERCENTILES, levels, strict=True)),
        **{
            key: one and {"mean": one.mean[place], "deviation": one.deviation[place]}
            for key, one in orders.items()
        },
        "contributors": [contributor(*pair) for pair in found.ranking(name)],
    }


def _limit(found: Any, one: Any) -> dict[str, Any]:
    design = dict(zip(found.variables, one.design, strict=True))
    return {
        "quantity": one.limit.quantity,
        "bound": one.limit.bound,
        "broken_above": one.limit.above,
        **fields_of(one, "sampled", "sampled_interval", "beta", "first_order", "second_order"),
        **fields_of(one, "near_points", "near_points_error"),
        "nearest_points": len(one.points),
        "most_likely_design": design if all(map(math.isfinite, one.design)) else None,
        "importance": dict(zip(found.variables, one.importance, strict=True)),
    }


def sentences(found: Any, permitted: Sequence[Permitted]) -> Iterator[str]:
    """A sentence for each limit and each quantity without one, then for tighter tolerances."""
    limited = {one.limit.quantity for one in found.reliability}
    for one in found.reliability:
        look = found.shown(one.limit.quantity)
        side = "exceed" if one.limit.above else "fall below"
        low, high = (f"{100 * end:.2g}" for end in one.sampled_interval)
        yield (
            f"About {100 * one.sampled:.2g} % of the machines {side} {look.text(one.limit.bound)} "
            f"({look.words.lower()}; {low} to {high} % with 95 % confidence). "
            f"{_causes(found, one.limit.quantity)}"
        )
    for place, name in enumerate(found.names):
        mean = found.sampled.mean[place]
        spread = found.sampled.deviation[place]
        if name not in limited and math.isfinite(spread):
            look = found.shown(name)
            yield (
                f"{look.words}: {look.text(mean)} on average, with a standard deviation of "
                f"{look.difference(spread, 3)}. {_causes(found, name)}"
            )
    for one in permitted:
        whose = "all tolerances"
        if len(one.variables) != len(found.variables):
            whose = f"that of {found.label(one.variables[0])}"
        if not math.isfinite(one.factor):
            yield f"Changing {whose} does not bring the rejects down so far."
            continue
        word = "tightened" if one.factor < 1 else "widened"
        yield (
            f"With {whose} {word} to {one.factor:.3g} times what they are, "
            f"{100 * one.rejects:.2g} % are rejected."
        )


def _causes(found: Any, name: str) -> str:
    ranked = [(one, share) for one, share in found.ranking(name) if math.isfinite(share)]
    if not ranked:
        return ""
    (first, largest), *others = ranked[:3]
    causes = [f"{found.label(first)} causes {100 * min(largest, 1):.0f} % of the variance"]
    causes += [
        f"{found.label(one)} {100 * min(share, 1):.0f} %" for one, share in others if share > 0.05
    ]
    text = ", ".join(causes)
    return f"{text[:1].upper()}{text[1:]}."
