"""Pictures of the gas in a cylinder with valves: p-V, log p-h, lifts, power, maps."""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from .._core.display import shown
from ..crank import Performance
from ..crank._performance import POWER
from ..cylinder import Cycle
from ..cylinder._several import SeveralCycles
from ..fluid._real import has_dew_line
from ..study.rating import QUANTITIES, ZERO, RatingMap
from . import _style as style
from ._drawing import draws

# Points of an indicator diagram beside the nodes of the solver.
_SAMPLES = 720
_SUCTION = style.colour("suction")
_DISCHARGE = style.colour("discharge")
_GAS = "#444444"


@draws(cycle=Cycle | SeveralCycles, performance=Performance)
def cylinder_figures(
    cycle: Cycle | SeveralCycles, performance: Performance | None = None
) -> dict[str, Figure]:
    """All pictures of a cycle by name, of several that of the first cylinder.

    Args:
        cycle: to show.
        performance: for the use of power, of the whole machine.
    """
    if isinstance(cycle, SeveralCycles):
        cycle = cycle.first
    figures = {"valve_losses": valve_losses(cycle), "valve_motion": valve_motion(cycle)}
    if has_dew_line(cycle.case.cylinder.fluid):
        figures["log_p_h"] = log_p_h(cycle)
    if performance is not None:
        figures["power_use"] = power_use(performance)
    return figures


@draws(cycle=Cycle)
def valve_losses(cycle: Cycle) -> Figure:
    """Pressure over volume; shaded is the work that the valves cost."""
    case = cycle.case
    losses = cycle.work_losses
    volume, pressure, lifts = _fine_diagram(cycle)
    figure, ax = style.single((6.8, 4.4), "Indicator diagram and losses of the valves")
    # the first point once more, which closes the diagram
    closed_volume = np.append(volume, volume[0])
    closed_pressure = np.append(pressure, pressure[0])
    ax.plot(closed_volume, closed_pressure, color=_GAS, linewidth=1.6)
    lines = (
        ("suction", case.suction.p, _SUCTION, 1),
        ("discharge", case.discharge.p, _DISCHARGE, -1),
    )
    for number, (name, line, tint, sign) in enumerate(lines):
        line = float(line) / 1e6
        lost = (lifts[number] > 0) & (sign * (line - pressure) > 0)
        label = f"{style.words(name)} valve, {float(losses[f'{name} valve']):.3g} J"
        ax.fill_between(volume, line, pressure, where=lost, color=tint, alpha=0.35, linewidth=0,
                        label=label)  # fmt: skip
        ax.axhline(line, color=tint, linewidth=0.9, linestyle="--")
    ax.set(xlim=(0, None), ylim=(0, None), xlabel="Volume, cm³", ylabel="Pressure, MPa")
    work = float(cycle.indicated_work)
    style.legend(ax, title=f"of {work:.4g} J per revolution", title_fontsize=8.5)
    return figure


def _fine_diagram(cycle: Cycle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[cm^3], [MPa] (n,) and [m] (2, n) Volume, pressure and lifts, as smooth as they are.

    The nodes of the solver are chords apart that one sees where the gas expands again.
    """
    even = jnp.linspace(-jnp.pi, jnp.pi, _SAMPLES, endpoint=False)
    nodes = (cycle.angle + jnp.pi) % (2 * jnp.pi) - jnp.pi
    angle = jnp.sort(jnp.concatenate([even, nodes]))
    volume, _ = jax.vmap(cycle.case.volume)(angle)
    lifts = np.stack([cycle.lift_at(angle, False), cycle.lift_at(angle, True)])
    # within the rounding of its polynomials a plate that is shut lifts nothing
    lifts[lifts < 1e-9 * lifts.max(initial=0.0)] = 0.0
    return np.asarray(volume) * 1e6, np.asarray(cycle.pressure_at(angle)) / 1e6, lifts


@draws(cycle=Cycle)
def valve_motion(cycle: Cycle) -> Figure:
    """Lift of the valves, flow through them and pressure in the plenums over the crank angle."""
    plenums = cycle.plenum_pressure
    rows = 2 if plenums is None else 3
    figure, axes = style.stacked(rows, (7.2, 2.6 * rows), "Valves over one revolution")
    upper = axes[0]
    middle = axes[1]
    lowest = axes[-1]
    for ax, courses, label in (
        (upper, cycle.lift, "Lift, mm"),
        (middle, cycle.flow, "Flow, forward positive, g/s"),
    ):
        curves = {"suction": courses[0] * 1e3, "discharge": courses[1] * 1e3}
        style.turn_curves(
            ax, cycle.angle, curves, label, zero=ax is middle, angle_label=ax is lowest
        )
    if plenums is not None:
        case = cycle.case
        courses = iter(plenums)
        above = {}
        for name, line in (("suction", case.suction.p), ("discharge", case.discharge.p)):
            for number in range(len(getattr(case.cylinder, name).plenums)):
                above[f"{name} {number + 1}"] = 100 * (next(courses) / line - 1)
        style.turn_curves(
            lowest, cycle.angle, above, "Plenums above their line, %", zero=False, color=None
        )
        style.legend_above(lowest)
    style.legend_above(upper)
    return figure


@draws(cycle=Cycle)
def log_p_h(cycle: Cycle) -> Figure:
    """The gas in the cylinder over its enthalpy, with the lines and the saturation dome.

    Raises:
        TypeError: a perfect gas, which has no dome.
    """
    fluid = cycle.case.cylinder.fluid
    case = cycle.case
    if not has_dew_line(fluid):
        raise TypeError("a diagram of pressure over enthalpy needs a real gas.")
    end = float(fluid.critical_temperature)
    low = max(float(fluid.lowest_temperature), 0.55 * end)
    T = jnp.linspace(low, 0.995 * end, 120)
    dome = jax.vmap(lambda T: fluid.saturation(T=T))(T)
    liquid = fluid.state(T, dome.liquid)
    vapour = fluid.state(T, dome.vapour)
    inside = fluid.state(cycle.temperature, cycle.mass / cycle.volume)
    figure, ax = style.single((6.8, 4.8), f"{fluid.name}: pressure over enthalpy")
    h = np.concatenate([liquid.h, vapour.h[::-1]]) / 1e3
    p = np.concatenate([liquid.p, vapour.p[::-1]]) / 1e6
    ax.plot(h, p, color=style.GREY, linewidth=1.2, label="Saturation")
    h = np.append(inside.h, inside.h[0]) / 1e3
    p = np.append(inside.p, inside.p[0]) / 1e6
    ax.plot(h, p, color=_GAS, linewidth=1.5, label="Gas in the cylinder")
    marks = (
        ("Suction line", case.comes.h, case.comes.p, _SUCTION, "s"),
        ("At the suction valve", case.suction.h, case.suction.p, _SUCTION, "o"),
        ("Isentropic compression", case.isentropic.h, case.isentropic.p, "#009E73", "^"),
        ("Discharged gas", cycle.discharge_enthalpy, case.discharge.p, _DISCHARGE, "o"),
    )
    for label, x, y, tint, marker in marks:
        ax.plot(float(x) / 1e3, float(y) / 1e6, marker, color=tint, markersize=5, label=label)
    ax.set(yscale="log", xlabel="Enthalpy, kJ/kg", ylabel="Pressure, MPa")
    style.legend(ax)
    return figure


@draws(performance=Performance)
def power_use(performance: Performance) -> Figure:
    """Uses of the power, from the isentropic power up."""
    power = performance.power
    names = [name for name in POWER if name in power and float(power[name])]
    values = np.array([float(performance.power[name]) for name in names])
    starts = np.concatenate([[0.0], np.cumsum(values)[:-1]])
    total = float(performance.electric_power)
    share = 100 * performance.overall_efficiency
    title = f"Use of {style.plain_number(total, 4)} W; overall efficiency {share:.1f} %"
    figure, ax = style.single((7.2, 0.45 * len(names) + 1.4), title)
    tints = [_GAS, *[_DISCHARGE] * (len(names) - 1)]
    ax.barh(range(len(names)), values, left=starts, color=tints, height=0.62)
    ends = np.maximum(starts, starts + values) + 0.01 * total
    for place, (end, value) in enumerate(zip(ends, values, strict=True)):
        text = f"{style.plain_number(value)} W   {100 * value / total:.1f} %"
        ax.text(end, place, text, va="center", fontsize=8.5, color=style.INK)
    style.named_rows(ax, list(map(style.words, names)))
    ax.set(xlim=(0, 1.22 * total), xlabel="Power, W")
    return figure


@draws(rating_map=RatingMap)
def rating_figures(rating_map: RatingMap, name: str) -> dict[str, Figure]:
    """Maps of capacity, power, COP and overall efficiency; none for a map of a single row or column."""
    figures = {}
    x = np.asarray(rating_map.condensing) - ZERO
    y = np.asarray(rating_map.evaporating) - ZERO
    right = np.argsort(x)
    up = np.argsort(y)
    units = {quantity: unit for quantity, unit, _ in QUANTITIES}
    for quantity in ("capacity", "power", "cop", "overall_efficiency"):
        values = np.ma.masked_invalid(np.asarray(rating_map.values[quantity])[np.ix_(up, right)])
        if min(values.shape) < 2 or not values.count():
            continue
        look = shown(quantity, units[quantity], values)
        values = values * look.factor
        figure, ax = style.single((6.6, 4.6), f"{name}, rating {rating_map.rating}")
        ax.grid(False)
        shades = ax.contourf(x[right], y[up], values, 16, cmap="viridis")
        lines = ax.contour(shades, colors="white", linewidths=0.5)
        ax.clabel(lines, fontsize=7.5, fmt="%.4g")
        style.colour_bar(ax, shades, look.label, (x[right], y[up], values.filled(np.nan)))
        ax.set(xlabel="Condensing temperature, °C", ylabel="Evaporating temperature, °C")
        figures[quantity] = figure
    return figures
