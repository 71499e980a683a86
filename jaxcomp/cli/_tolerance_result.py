"""What `jaxcomp tolerance` reads from its options, and what it prints."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.markup import escape

from .._shown import shown
from ..design import AnalysisOptions, balanced_design, quantity, variable_label
from ..machine import Machine, machine_of
from ..scene import Scene, to_si
from ..scene.tolerances import read_tolerance_file, tolerances_of
from ..tolerancing import Permitted, Tolerances, Within, permitted
from ._arguments import assignments, entry
from ._constraints import bounds_of
from ._errors import CommandError
from ._sweep_options import default_quantities
from ._tables import _table

_SHARES = (0.00135, 0.05, 0.5, 0.95, 0.99865)
_SHARE_NAMES = ("0.135", "5", "50", "95", "99.865")
# Contributors of a table.
_ROWS = 12


class Asked(NamedTuple):
    """What is asked of a scatter."""

    design: Machine
    tolerances: dict[str, Within]
    texts: dict[str, str]
    correlations: dict[tuple[str, str], float]
    quantities: list[str]
    limits: dict[str, tuple[float | None, float | None]]
    balanced: bool


def asked_tolerances(
    scene: Scene,
    options: AnalysisOptions,
    balanced: bool,
    vary,
    file: Path | None,
    correlate,
    quantities,
    limits,
) -> Asked:
    """Read the options.

    Raises:
        CommandError, SceneError, BadInput: what cannot be read, or a name that fits nothing.
    """
    design, texts, pairs = machine_of(scene), {}, {}
    if balanced:
        if not design.corrections:
            raise CommandError("--balanced: needs a scene with balancing planes")
        design = balanced_design(design, options)
    if file is not None:
        texts, pairs = read_tolerance_file(file)
    # what is typed comes last, and so counts where both fit
    texts = {**texts, **assignments(vary or (), "--vary")}
    for text in correlate or ():
        pairs[_pair(text)] = _correlation(text)
    bounds = bounds_of(limits or (), "--limit", equalities=False)
    asked = list(quantities or (() if bounds else default_quantities(scene)))
    for name in asked:
        quantity(name)
    asked += [name for name in bounds if name not in asked]
    found = tolerances_of(design, texts)
    return Asked(design, found, texts, pairs, asked, bounds, balanced)


def _pair(text: str) -> tuple[str, str]:
    names = [name.strip() for name in text.partition("=")[0].split(",")]
    if len(names) != 2 or not all(names):
        raise CommandError(f"--correlate {text}: must have the form A,B=VALUE")
    return names[0], names[1]


def _correlation(text: str) -> float:
    try:
        return float(text.partition("=")[2])
    except ValueError:
        raise CommandError(f"--correlate {text}: must have the form A,B=VALUE") from None


def tolerance_result(found: Tolerances, scene: str, asked: Asked) -> dict[str, Any]:
    """The answer in SI units. The keys are stable; new ones may join them."""
    sampled = found.sampled
    return {
        "scene": scene,
        "balanced": asked.balanced,
        "corrections": {
            name: [float(x) for x in xy] for name, xy in found.problem.design.corrections.items()
        },
        "variables": {
            one.name: {
                "unit": one.unit,
                "nominal": float(found.nominal[i]),
                "deviation": float(found.deviation[i]),
                **asked.tolerances[one.name]._asdict(),
            }
            for i, one in enumerate(found.problem.variables)
        },
        "correlations": [{"between": list(p), "value": v} for p, v in asked.correlations.items()],
        "samples": len(sampled.ok),
        "failed": int(np.sum(~sampled.ok)),
        "quantities": {
            name: _quantity(found, i, unit)
            for i, (name, unit) in enumerate(zip(found.names, found.problem.units, strict=True))
        },
        "limits": [_limit(one, found) for one in found.reliability],
        "remarks": list(found.remarks),
    }


def _quantity(found: Tolerances, i: int, unit: str) -> dict[str, Any]:
    sampled, second = found.sampled, found.second_order
    good = sampled.ok.sum() > 1
    levels = sampled.quantile(_SHARES)[:, i].tolist() if good else [math.nan] * len(_SHARES)
    return {
        "unit": unit,
        "nominal": _finite(found.value[i]),
        "mean": _finite(sampled.mean[i]),
        "mean_error": _finite(sampled.mean_error[i]),
        "deviation": _finite(sampled.deviation[i]),
        "deviation_error": _finite(sampled.deviation_error[i]),
        "skewness": _finite(sampled.skewness[i]),
        "percentiles": dict(zip(_SHARE_NAMES, map(_finite, levels), strict=True)),
        "first_order": _moments(found.first_order, i),
        "second_order": None if second is None else _moments(second, i),
        "contributors": [
            {
                "variable": name,
                "share": _finite(share),
                "at_low_limit": _finite(found.swings[0, found.variables.index(name), i]),
                "at_high_limit": _finite(found.swings[1, found.variables.index(name), i]),
            }
            for name, share in found.ranking(found.names[i])
        ],
    }


def _moments(moments, i) -> dict[str, float | None]:
    return {"mean": _finite(moments.mean[i]), "deviation": _finite(moments.deviation[i])}


def _limit(one, found: Tolerances) -> dict[str, Any]:
    known = bool(np.all(np.isfinite(one.design)))
    row = dict(zip(found.variables, one.design.tolist(), strict=True)) if known else None
    return {
        "quantity": one.limit.quantity,
        "bound": one.limit.bound,
        "broken_above": one.limit.above,
        "sampled": _finite(one.sampled),
        "sampled_interval": [_finite(x) for x in one.sampled_interval],
        "beta": _finite(one.beta),
        "first_order": _finite(one.first_order),
        "second_order": _finite(one.second_order),
        "near_points": _finite(one.near_points),
        "near_points_error": _finite(one.near_points_error),
        "nearest_points": len(one.points),
        "most_likely_design": row,
        "importance": dict(zip(found.variables, map(_finite, one.importance), strict=True)),
    }


def _finite(value) -> float | None:
    return float(value) if np.isfinite(value) else None


def permitted_tolerances(found: Tolerances, text: str) -> list[Permitted]:
    """How much tighter all tolerances would have to be, and those of the largest contributor alone.

    Raises:
        CommandError: a share that cannot be read or is none.
    """
    share = float(to_si(entry(text), "", "--rejects"))
    if not 0 < share < 1:
        raise CommandError(f"--rejects {text}: must be > 0 and < 1, e.g. 1%")
    first = found.ranking(found.reliability[0].limit.quantity)[0][0]
    return [permitted(found, share), permitted(found, share, [first])]


def tolerance_sentences(found: Tolerances, result: dict[str, Any]) -> Iterator[str]:
    """The answer in a sentence for each limit, or for each quantity where there is none."""
    design, limited = found.problem.design, {one.limit.quantity for one in found.reliability}
    for one in found.reliability:
        place = found.names.index(one.limit.quantity)
        look = shown(one.limit.quantity, found.problem.units[place], found.value[place])
        side = "exceed" if one.limit.above else "fall below"
        low, high = (f"{100 * end:.2g}" for end in one.sampled_interval)
        text = (
            f"About {100 * one.sampled:.2g} % of the machines {side} {look.text(one.limit.bound)} "
            f"({look.words.lower()}; {low} to {high} % with 95 % confidence). "
        )
        yield text + _causes(found, design, one.limit.quantity)
    for place, name in enumerate(found.names):
        spread = found.sampled.deviation[place]
        if name not in limited and np.isfinite(spread):
            look = shown(name, found.problem.units[place], found.value[place])
            text = (
                f"{look.words}: {look.text(found.sampled.mean[place])} on average, with a standard "
            )
            yield f"{text}deviation of {look.text(spread, 3)}. {_causes(found, design, name)}"
    for one in result.get("permitted", ()):
        all_of_them = len(one["variables"]) == len(found.variables)
        whose = (
            "all tolerances"
            if all_of_them
            else f"that of {variable_label(design, one['variables'][0])}"
        )
        if not np.isfinite(one["factor"] or np.nan):
            yield f"Changing {whose} does not bring the rejects down so far."
            continue
        word = "tightened" if one["factor"] < 1 else "widened"
        yield (
            f"With {whose} {word} to {one['factor']:.3g} times what they are, "
            f"{100 * one['rejects']:.2g} % are rejected."
        )


def _causes(found: Tolerances, design, name: str) -> str:
    ranked = [(one, share) for one, share in found.ranking(name) if np.isfinite(share)]
    if not ranked:
        return ""
    causes = [f"{variable_label(design, one)} {100 * min(share, 1):.0f} %" for one, share in ranked[:3]
              if share > 0.05 or one == ranked[0][0]]  # fmt: skip
    causes[0] = (
        f"{variable_label(design, ranked[0][0])} causes "
        f"{100 * min(ranked[0][1], 1):.0f} % of the variance"
    )
    text = ", ".join(causes)
    return f"{text[:1].upper()}{text[1:]}."


def tolerance_tables(found: Tolerances, result: dict[str, Any]) -> Iterator[Any]:
    """The answer in sentences, distributions, contributors, probabilities, and what disagrees."""
    yield from (escape(text) for text in tolerance_sentences(found, result))
    yield _distributions(found, result)
    yield _orders(found, result)
    for name in found.names:
        yield _contributors(found, name)
    if found.reliability:
        yield _probabilities(found)
    for remark in found.remarks:
        yield f"[yellow]Note:[/yellow] {remark}"


def _distributions(found: Tolerances, result):
    lost = f", {result['failed']:,} not solved" if result["failed"] else ""
    title = f"{result['scene']}: {result['samples']:,} machines{lost}"
    heads = ("Quantity", "Nominal", "Mean", "Deviation", "5 %", "95 %")
    table = _table(escape(title), *heads, numbers=True)
    for look, row in _entries(found, result):
        numbers = [row["nominal"], row["mean"], row["deviation"]]
        numbers += [row["percentiles"]["5"], row["percentiles"]["95"]]
        table.add_row(look.label, *(_cell(x, look.factor) for x in numbers))
    return table


def _orders(found: Tolerances, result):
    heads = ("By derivatives", "1st-order mean", "Deviation", "2nd-order mean", "Deviation")
    table = _table(None, *heads, numbers=True)
    for look, row in _entries(found, result):
        nothing = {"mean": None, "deviation": None}
        orders = (row["first_order"], row["second_order"] or nothing)
        cells = [_cell(one[key], look.factor) for one in orders for key in ("mean", "deviation")]
        table.add_row(look.label, *cells)
    return table


def _entries(found: Tolerances, result):
    for i, (name, unit) in enumerate(zip(found.names, found.problem.units, strict=True)):
        yield shown(name, unit, found.value[i]), result["quantities"][name]


def _contributors(found: Tolerances, name: str):
    place = found.names.index(name)
    look = shown(name, found.problem.units[place], found.value[place])
    title = "Contributors to " + look.words[:1].lower() + look.words[1:]
    ends = (f"Low limit, {look.unit}", f"High limit, {look.unit}") if look.unit else ("Low", "High")
    table = _table(title, "Variable", "Share of variance", *ends, numbers=True)
    design = found.problem.design
    ranked = [(variable_label(design, one), one, share) for one, share in found.ranking(name)]
    # a name is broken where it would leave the numbers no room in 80 columns
    table.columns[0].no_wrap = max(len(words) for words, _, _ in ranked[:_ROWS]) <= 45
    table.columns[0].overflow = "fold"
    for words, variable, share in ranked[:_ROWS]:
        swing = found.swings[:, found.variables.index(variable), place]
        cells = (_cell(x, look.factor) for x in swing)
        table.add_row(escape(words), f"{100 * share:.1f} %", *cells)
    if len(ranked) > _ROWS:
        rest = sum(share for _, _, share in ranked[_ROWS:])
        table.add_row(f"{len(ranked) - _ROWS} more", f"{100 * rest:.1f} %", "", "")
    return table


def _probabilities(found: Tolerances):
    heads = ("Limit", "Beta", "1st order", "2nd order", "About the points", "Samples (95 %)")
    table = _table("Probability of breaking a limit", *heads, numbers=True)
    for one in found.reliability:
        place = found.names.index(one.limit.quantity)
        look = shown(one.limit.quantity, found.problem.units[place], found.value[place])
        sign = "<=" if one.limit.above else ">="
        low, high = one.sampled_interval
        near = _cell(one.near_points, 1, 3)
        if near:
            near += f" ± {one.near_points_error:.1g}"
        table.add_row(
            f"{look.words} {sign} {look.text(one.limit.bound)}",
            _cell(one.beta, 1, 4),
            _cell(one.first_order, 1, 3),
            _cell(one.second_order, 1, 3),
            near,
            f"{one.sampled:.3g} ({low:.2g} to {high:.2g})",
        )
    return table


def _cell(value, factor, digits: int = 5) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value * factor:.{digits}g}"
