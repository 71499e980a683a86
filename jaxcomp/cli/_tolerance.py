"""`jaxcomp tolerance`: effect of production tolerances on efficiency, loads and vibration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.markup import escape

import jaxcomp as jc

from .._core.display import Shown
from . import _options as opt
from ._arguments import assignments, bounds_of, si
from ._output import Output, Partial
from ._start import CommandError, cluster, refuse, waiting
from ._sweep import default_quantities, start_devices
from ._tables import as_note, number_text, row_table

if TYPE_CHECKING:
    from ..study.tolerance._answer import Permitted
    from ..study.tolerance._scatter import Within

# Contributors of a table.
_ROWS = 12


# Source of the second derivatives.
Curvature = Literal["differences", "exact", "none"]


def tolerance(
    *,
    vary: Annotated[list[str] | None, typer.Option(autocompletion=opt.complete_variable)] = None,
    tolerances: Path | None = None,
    correlate: list[str] | None = None,
    quantity: opt.Quantities = None,
    limit: list[str] | None = None,
    rejects: str | None = None,
    case: opt.DesignCase,
    balanced: bool = False,
    excitation: opt.ExcitationOption = None,
    samples: int | None = None,
    sampling: opt.Sampling = "sobol",
    seed: int = 0,
    curvature: Curvature = "differences",
    analysis: opt.FastAnalysis,
    dask: opt.Dask = None,
    output: Output,
) -> None:
    """Find how efficiency, losses, loads and vibration vary with tolerances, and what causes most.

    Example: [bold]jaxcomp tolerance mayekawa-wbhe --vary mechanism.conrod_length='+-0.1 mm' --vary
    'friction.*.coefficient=+-20 %' --limit 'mechanical_efficiency>=0.9' --out result[/bold]

    Of a balanced machine: [bold]jaxcomp tolerance hermetic-68cc --balanced --vary
    'loads.unbalances.*.magnitude.*=+-5 %' --vary 'corrections.*.magnitude=+-5 %' --limit
    'vibration<=20um'[/bold]

    A file for --tolerances has a table [bold]\\[tolerances][/bold] with lines like "mechanism.bore" =
    "+-0.02 mm" and, where deviations go together, [bold]\\[\\[correlations]][/bold] with between = ["A",
    "B"] and value = 0.3.

    Args:
        vary (NAME=TOLERANCE): Number and its tolerance: '+-0.02 mm', '-0.01 +0.03 mm', '+-5 %', 'sigma
            5 um'; normal with a limit at 3 sigma, or add 'uniform', 'truncated', '2 sigma'. * in a name
            stands for any part of it. Repeatable.
        tolerances: TOML file of tolerances and correlations, see below.
        correlate (A,B=VALUE): Correlation of two deviations. Repeatable.
        quantity (NAME): Quantity, e.g. motor_power; efficiency, or vibration of a rotor, if absent.
            Repeatable.
        limit (QUANTITY<=VALUE): Limit, with <= or >=; the probability of breaking it is computed.
            Repeatable.
        rejects (SHARE): With --limit: find tolerances with which no more than this share breaks it,
            e.g. 1%.
        balanced: Apply the least-squares balance to the machine first.
        samples: Number of Monte Carlo samples; 16384, or 512 of a machine with valves, if absent.
        sampling: Sampling method.
        seed: Seed of the samples.
        curvature: Second order by differences of slopes, by exact derivatives, or not.
    """
    missing = not vary and tolerances is None
    refuse(missing, "--vary: is missing; e.g. --vary mechanism.bore='+-0.02 mm'")
    unlimited = rejects is not None and not limit
    refuse(unlimited, "--rejects: needs a --limit, by which machines are rejected")
    refuse(samples is not None and samples < 16, f"--samples {samples}: must be >= 16")
    start_devices(None)
    scene = case.scene(varied=vary)
    options = analysis.options(scene, excitation)
    design = jc.machine.machine_of(scene)
    if balanced:
        refuse(not design.corrections, "--balanced: needs a machine with balancing planes")
        design = jc.study.balanced_design(design, options)
    variations, correlations = read_tolerances(design, vary, tolerances, correlate)
    limits = bounds_of(limit, "--limit", equalities=False)
    names = list(quantity or ())
    if not names and not limits:
        names = default_quantities(scene)
    from ..study._analysis import quantity_named

    for name in names:
        quantity_named(name)
    quantities = list(dict.fromkeys([*names, *limits]))
    partial = Partial(output.out, "machines")

    def keep(points, values, ok) -> None:
        columns = dict(zip(variations, points.T, strict=True))
        columns |= zip(quantities, values.T, strict=True)
        partial.keep(columns | {"solved": ok})

    drawn = {"samples": samples, "sampling": sampling.replace("-", "_"), "seed": seed}
    drawn["curvature"] = None if curvature == "none" else curvature
    drawn |= {"correlations": correlations, "limits": limits, "options": options, "keep": keep}
    with waiting(), cluster(dask) as client:
        study = jc.study.tolerance.tolerance(design, variations, quantities, client=client, **drawn)
        partial.finish()
        tighter = [] if rejects is None else permitted_tolerances(study, rejects)
    numbers = None
    if rejects is not None:
        from ..study.tolerance._answer import PermittedTolerances

        numbers = PermittedTolerances(tuple(tighter))

    def pictures():
        from ..plot._designs import tolerance_figures

        return tolerance_figures(study, scene.name)

    output.emit(
        study,
        lambda result: tolerance_tables(study, result, tighter),
        pictures,
        scene,
        {"samples": study.columns},
        metadata={"scene": scene.name, "balanced": balanced},
        numbers=numbers,
    )


def read_tolerances(
    design: jc.machine.Machine,
    vary: Sequence[str] | None,
    file: Path | None,
    correlate: Sequence[str] | None,
) -> tuple[dict[str, Within], dict[tuple[str, str], float]]:
    """Tolerances and correlations of the file and of `--vary` and `--correlate`, which go first."""
    from ..scene.tolerances import read_tolerance_file, tolerances_of

    texts = {}
    correlations = {}
    if file is not None:
        texts, correlations = read_tolerance_file(file)
    for text in correlate or ():
        names, _, value = text.partition("=")
        pair = tuple(map(str.strip, names.split(",")))
        try:
            if len(pair) != 2 or not all(pair):
                raise ValueError
            correlations[pair] = float(value)
        except ValueError:
            raise CommandError(f"--correlate {text}: must have the form A,B=VALUE") from None
    # where both fit, the later one counts
    return tolerances_of(design, {**texts, **assignments(vary, "--vary")}), correlations


def permitted_tolerances(study: jc.study.tolerance.Tolerances, text: str) -> list[Permitted]:
    """Factors by which all tolerances would have to be tighter, and those of the largest contributor
    alone.
    """
    share = si(text, "", "--rejects")
    refuse(not 0 < share < 1, f"--rejects {text}: must be > 0 and < 1, e.g. 1%")
    first = study.ranking(study.reliability[0].limit.quantity)[0][0]
    return [jc.study.tolerance.permitted(study, share, names) for names in (None, [first])]


def tolerance_tables(
    study: jc.study.tolerance.Tolerances,
    result: dict[str, Any],
    permitted: Sequence[Permitted],
) -> Iterator[Any]:
    """Sentences, distributions, contributors, probabilities, and remarks on what disagrees."""
    yield from map(escape, study.sentences(*permitted))
    title = f"{result['scene']}: {result['samples']:,} machines"
    if result["failed"]:
        title += f", {result['failed']:,} not solved"
    sampled = []
    by_derivatives = []
    for name in study.names:
        look = study.shown(name)
        row = result["quantities"][name]
        wide = look.differences
        shares = row["percentiles"]
        sampled.append(
            (
                look.label,
                _value(look, row["nominal"]),
                _value(look, row["mean"]),
                _value(wide, row["deviation"]),
                _value(look, shares["5"]),
                _value(look, shares["95"]),
            )
        )
        cells = []
        for key in ("first_order", "second_order"):
            moments = row[key] or {}  # None where this order was not asked for
            cells.append(_value(look, moments.get("mean")))
            cells.append(_value(wide, moments.get("deviation")))
        by_derivatives.append((look.label, *cells))
    yield row_table(title, ("Quantity", "Nominal", "Mean", "Deviation", "5 %", "95 %"), sampled)
    heads = ("By derivatives", "1st-order mean", "Deviation", "2nd-order mean", "Deviation")
    yield row_table(None, heads, by_derivatives)
    for name in study.names:
        yield _contributors(study, name)
    if study.reliability:
        yield _probabilities(study)
    yield from map(as_note, study.remarks)


def _contributors(study: jc.study.tolerance.Tolerances, name: str):
    look = study.shown(name)
    place = study.names.index(name)
    ranking = study.ranking(name)
    rows = []
    for variable, share in ranking[:_ROWS]:
        low, high = study.swings[:, study.variables.index(variable), place]
        share_text = f"{100 * share:.1f} %"
        rows.append((study.label(variable), share_text, _value(look, low), _value(look, high)))
    # a name is broken where it would leave the numbers no space in 80 columns
    unbroken = ()
    if max(len(row[0]) for row in rows) <= 45:
        unbroken = (0,)
    if len(ranking) > _ROWS:
        remaining_share = sum(share for _, share in ranking[_ROWS:])
        rows.append((f"{len(ranking) - _ROWS} more", f"{100 * remaining_share:.1f} %", "", ""))
    ends = ("Low", "High")
    if look.unit:
        ends = (f"Low limit, {look.units}", f"High limit, {look.units}")
    words = look.words
    if not words[:2].isupper():  # but for abbreviations, as COP
        words = words[:1].lower() + words[1:]
    heads = ("Variable", "Share of variance", *ends)
    table = row_table(f"Contributors to {words}", heads, rows, unbroken=unbroken)
    table.columns[0].overflow = "fold"
    return table


def _probabilities(study: jc.study.tolerance.Tolerances):
    rows = []
    for probability in study.reliability:
        look = study.shown(probability.limit.quantity)
        sign = "<=" if probability.limit.above else ">="
        low, high = probability.sampled_interval
        near = number_text(probability.near_points, ".3g")
        rows.append(
            (
                f"{look.words} {sign} {look.text(probability.limit.bound)}",
                number_text(probability.beta, ".4g"),
                number_text(probability.first_order, ".3g"),
                number_text(probability.second_order, ".3g"),
                near and f"{near} ± {probability.near_points_error:.1g}",
                f"{probability.sampled:.3g} ({low:.2g} to {high:.2g})",
            )
        )
    heads = ("Limit", "Beta", "1st order", "2nd order", "About the points", "Samples (95 %)")
    return row_table("Probability of breaking a limit", heads, rows)


def _value(look: Shown, value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return look.number(value)
