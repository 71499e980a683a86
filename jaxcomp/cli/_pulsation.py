"""`jaxcomp pulsation`: resonances of pipes against the orders of the crank, and the coupled answer."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

import jaxcomp as jc

from .._core.declared import Record, part, reading, word
from .._core.display import RPM
from . import _options as opt
from ._arguments import speeds_of
from ._output import Output, header
from ._start import waiting
from ._tables import row_table

if TYPE_CHECKING:
    from ..cylinder._pulsation import Limit

# [-] Of the motor's speed, to either side of it, where no range is given.
_HALF_RANGE = 0.5
# [-] Distance of a resonance from an order below which API 618 asks for a closer look.
_NEAR = 0.2
# [-] Q beyond which the losses of a network say little about its pulsation: valves damp it, or nothing.
_SHARP = 300.0


def pulsation(
    *,
    case: opt.Case,
    speeds: opt.Speeds = None,
    orders: Annotated[int, typer.Option(min=1, max=64)] = 8,
    solve: bool = False,
    output: Output,
) -> None:
    """Find where the pipes of suction and discharge ring, and at which speeds orders meet that.

    No cycle is solved for this; with [bold]--solve[/bold] it is, at the machine's own speed, and
    pressures, limits of API 618 and shaking forces follow.

    Example: [bold]jaxcomp pulsation my-machine.toml --speeds 600rpm:1800rpm --out result[/bold]

    Args:
        orders: Orders of the crank to look at, from the first.
        solve: Solve the cycle with its pipes as well.
    """
    import numpy as np

    scene = case.scene(once=True)
    from ..cylinder._waves import is_piped

    compressor = scene.as_compressor()
    gas = compressor.gas
    piped = isinstance(gas, jc.cylinder.Cylinder) and is_piped(gas)
    if not piped:
        missing = (
            "the machine file has no pipes, [gas.suction.piping] or [gas.discharge.piping], which "
            "`pulsation` needs"
        )
        raise jc.scene.SceneError("", missing, file=scene.file)
    motor_speed = float(compressor.motor.speed_guess)
    if speeds is None:
        range_ = motor_speed * np.array([1 - _HALF_RANGE, 1 + _HALF_RANGE])
    else:
        range_ = speeds_of(speeds)
    with waiting():
        result = _map(compressor, motor_speed, range_, orders)
        if solve:
            cycle = jc.solve_orbit(compressor).cycle
            assert cycle is not None
            result = replace(result, solved=_solved(cycle.pulsation))

    def pictures():
        from ..plot._pulsation import pulsation_figures

        return pulsation_figures(result.entries())

    output.emit(
        result,
        pulsation_tables,
        pictures,
        scene,
        metadata=header(scene) | case.changes,
    )


@dataclass(frozen=True)
class Crossing(Record):
    """Speed at which an order of the crank meets a resonance."""

    order: int = reading("")
    speed: float = reading("rad/s")


@dataclass(frozen=True)
class ResonanceRow(Record):
    """A resonance of pipes with shut flanges.

    Attributes:
        number: along its line.
        line: "suction" or "discharge".
        frequency: [Hz]
        quality: [-] at most 1e6.
        margin: [-] distance of the nearest order at the speed of the motor, over the frequency.
        nearest_order: that order.
        crossings: speeds at which orders meet it.
    """

    number: int = reading("")
    line: str = word()
    frequency: float = reading("Hz")
    quality: float = reading("")
    margin: float = reading("")
    nearest_order: int = reading("")
    crossings: tuple[Crossing, ...] = part(Crossing)


def _limit() -> type[Record]:
    # help starts without JAX
    from ..cylinder._pulsation import Limit

    return Limit


@dataclass(frozen=True)
class ApproachLimit(Record):
    """A pulsation [-] beside the limit of approach 1."""

    value: float = reading("")
    allowed: float = reading("")


@dataclass(frozen=True)
class SolvedPulsation(Record):
    """Pressures, limits and forces of pipes that answer to the cylinders.

    Attributes:
        pressures: [Pa] by node and kind.
        spectra: [Pa] amplitudes by node, a list over the orders.
        limits: of API 618, approach 2 and 3.
        approach_1: by place.
        shaking: [N] by run.
        pressure_drop: [Pa] mean, by part.
        resolution: [-] last harmonic over the largest.
        status: how the solution ended.
        linear_error: [-] of the flow, as waves are not small.
        mach: [-] largest.
        remarks: sentences.
    """

    pressures: dict[str, Any] = reading("Pa", by_name=True)
    spectra: dict[str, Any] = reading("Pa", by_name=True)
    limits: tuple[Limit, ...] = part(_limit)
    approach_1: dict[str, ApproachLimit] = part(ApproachLimit, by_name=True)
    shaking: dict[str, Any] = reading("N", by_name=True)
    pressure_drop: dict[str, Any] = reading("Pa", by_name=True)
    resolution: float = reading("")
    status: str = word()
    linear_error: float = reading("")
    mach: float = reading("")
    remarks: Sequence[str] = word()


@dataclass(frozen=True)
class PulsationMap(Record):
    """Resonances of the pipes of a machine, and the coupled answer if it was solved.

    Attributes:
        speed: [rad/s] of the motor.
        lowest_speed, highest_speed: [rad/s] between which orders are looked for.
        orders: the highest one.
        resonances: of all lines.
        solved: the coupled answer.
    """

    speed: float = reading("rad/s")
    lowest_speed: float = reading("rad/s")
    highest_speed: float = reading("rad/s")
    orders: int = reading("")
    resonances: tuple[ResonanceRow, ...] = part(ResonanceRow)
    solved: SolvedPulsation | None = part(SolvedPulsation, optional=True, default=None)


def _map(compressor: jc.Compressor, motor_speed: float, speeds, orders: int) -> PulsationMap:
    """Resonances with the speeds at which orders meet them."""
    from .._core.each import of_cylinder

    low = float(min(speeds))
    high = float(max(speeds))
    highest = orders * max(high, motor_speed) / (2 * math.pi)
    resonances = jc.cylinder.line_resonances(
        of_cylinder(compressor.gas),
        of_cylinder(compressor.mechanism),
        motor_speed,
        highest,
        compressor.crankshaft.count,
    )
    rows = []
    numbers = Counter()
    for resonance in resonances:
        numbers[resonance.line] += 1
        frequency = float(resonance.frequency)
        crossings = []
        distances = []
        for order in range(1, orders + 1):
            speed = 2 * math.pi * frequency / order
            distances.append(abs(order * motor_speed / (2 * math.pi) / frequency - 1))
            if low <= speed <= high:
                crossings.append(Crossing(order, speed))
        row = ResonanceRow(
            number=numbers[resonance.line],
            line=resonance.line,
            frequency=frequency,
            quality=min(float(resonance.quality), 1e6),
            margin=min(distances),
            nearest_order=1 + distances.index(min(distances)),
            crossings=tuple(crossings),
        )
        rows.append(row)
    return PulsationMap(
        speed=motor_speed,
        lowest_speed=low,
        highest_speed=high,
        orders=orders,
        resonances=tuple(rows),
    )


def _solved(pulsation) -> SolvedPulsation:
    """The coupled answer."""
    from .._core.status import names_of_codes

    approach_1 = {}
    for name, limit in pulsation.approach_1.items():
        approach_1[name] = ApproachLimit(float(limit.value), float(limit.allowed))
    return SolvedPulsation(
        pressures=pulsation.pressures,
        spectra=pulsation.spectra(),
        limits=tuple(pulsation.limits),
        approach_1=approach_1,
        shaking=pulsation.shaking_forces,
        pressure_drop=pulsation.mean_drops,
        resolution=pulsation.resolution,
        status=str(names_of_codes(int(pulsation.status._value))),
        linear_error=pulsation.linear_error,
        mach=pulsation.mach,
        remarks=pulsation.remarks,
    )


def pulsation_tables(result: dict[str, Any]) -> Iterator[Any]:
    """Resonances with their crossings, and of a solved machine pressures, limits and forces."""
    rows = []
    for resonance in result["resonances"]:
        met = ", ".join(f"{c['speed'] * RPM:.5g} ({c['order']})" for c in resonance["crossings"])
        remarks = []
        if resonance["margin"] < _NEAR:
            remarks.append("near")
        if resonance["quality"] > _SHARP:
            remarks.append("hardly damped")
        margin = f"{100 * resonance['margin']:.3g} % of order {resonance['nearest_order']}"
        row = (
            resonance["number"],
            resonance["line"],
            resonance["frequency"],
            resonance["quality"],
            margin,
            ", ".join(remarks),
            met,
        )
        rows.append(row)
    title = f"{result['machine']}: resonances of pipes, flanges shut, at {result['speed'] * RPM:.5g} rpm"
    heads = ("", "Line", ("Hz", ".5g"), ("Q", ".4g"), "Off", "", "Met at rpm (order)")
    yield row_table(title, heads, rows)
    solved = result.get("solved")
    if solved is None:
        return
    yield _pressures(solved)
    yield _limits(solved)
    if solved["shaking"]:
        yield row_table(None, ("Shaking force of runs", ("N", ".4g")), solved["shaking"].items())
    rows = [("Last harmonic over the largest", f"{solved['resolution']:.2g}")]
    rows.append(
        ("Error of the flow as waves are not small", f"{100 * solved['linear_error']:.2g} %")
    )
    rows += [(remark, "") for remark in solved["remarks"]]
    yield row_table(None, ("Evidence", ""), rows, texts=2)


def _pressures(solved: dict[str, Any]):
    rows = []
    for node, sizes in solved["spectra"].items():
        values = solved["pressures"]
        orders = [f"{size:.4g}" for size in sizes[:4]]
        rows.append((node, values[f"{node}.peak_to_peak"], values[f"{node}.mean"], *orders))
    heads = ("Node", ("Peak to peak, Pa", ".5g"), ("Mean, Pa", ".4g"))
    orders = ("Order 1", "Order 2", "Order 3", "Order 4")
    return row_table(None, (*heads, *orders), rows)


def _percents(limit: dict[str, Any]) -> tuple[str, str]:
    """The pulsation that a limit is for, and the one that it allows."""
    return f"{100 * limit['value']:.4g} %", f"{100 * limit['allowed']:.4g} %"


def _limits(solved: dict[str, Any]):
    rows = []
    for limit in solved["limits"]:
        filter_text = "unfiltered"
        if limit["order"]:
            filter_text = f"order {limit['order']}"
        verdict = "exceeded" if limit["margin"] < 1 else ""
        rows.append(
            (limit["place"], filter_text, *_percents(limit), f"{limit['margin']:.4g}", verdict)
        )
    for place, limit in solved["approach_1"].items():
        margin = limit["allowed"] / max(limit["value"], 1e-12)
        rows.append((place, "unfiltered, approach 1", *_percents(limit), f"{margin:.4g}", ""))
    heads = ("API 618, peak to peak", "", "Pulsation", "Allowed", "Margin", "")
    return row_table(None, heads, rows)
