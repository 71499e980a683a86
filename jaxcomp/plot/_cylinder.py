"""Pictures of the gas in a cylinder with valves: p-V, log p-h, lifts, power, maps."""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from .._shown import shown
from ..crank import POWER, Performance
from ..cylinder import Cycle, SeveralCycles
from ..fluid import RealGas
from ..rating import QUANTITIES, ZERO, RatingMap
from ._style import INK, crank_axis, legend, legend_above, new_figure, over_turn, words, ylabel

_SUCTION, _DISCHARGE, _GAS = "#0072B2", "#D55E00", "#444444"


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
    if isinstance(cycle.case.cylinder.fluid, RealGas):
        figures["log_p_h"] = log_p_h(cycle)
    if performance is not None:
        figures["power_use"] = power_use(performance)
    return figures


def valve_losses(cycle: Cycle) -> Figure:
    """Pressure over volume; shaded is the work that the valves cost."""
    case, losses = cycle.case, cycle.work_losses
    volume, pressure = np.asarray(cycle.volume) * 1e6, np.asarray(cycle.pressure) / 1e5
    figure, ((ax,),) = new_figure(1, 1, (6.8, 4.4), "Indicator diagram and losses of the valves")
    closed = np.append(np.arange(volume.size), 0)
    ax.plot(volume[closed], pressure[closed], color=_GAS, linewidth=1.6)
    lines = (
        ("suction", case.suction.p, _SUCTION, 1),
        ("discharge", case.discharge.p, _DISCHARGE, -1),
    )
    for number, (name, line, tint, sign) in enumerate(lines):
        line = float(line) / 1e5
        off = sign * (line - pressure)
        lost = (np.asarray(cycle.lift[number]) > 0) & (off > 0)
        work = float(losses[f"{name} valve"])
        ax.fill_between(volume, line, pressure, where=lost, color=tint, alpha=0.35, linewidth=0,
                        label=f"{words(name)} valve, {work:.3g} J")  # fmt: skip
        ax.axhline(line, color=tint, linewidth=0.9, linestyle="--")
    ax.set_xlim(0, None)
    ax.set_ylim(0, None)
    ax.set_xlabel("Volume, cm³", fontsize=9)
    ylabel(ax, "Pressure, bar")
    work = float(cycle.indicated_work)
    legend(ax, title=f"of {work:.4g} J per revolution", title_fontsize=8.5)
    return figure


def valve_motion(cycle: Cycle) -> Figure:
    """Lift of the valves, flow through them and pressure in the plenums over the crank angle."""
    plenums = cycle.plenum_pressure
    rows = 2 if plenums is None else 3
    figure, axes = new_figure(rows, 1, (7.2, 2.6 * rows), "Valves over one revolution")
    for number, (name, tint) in enumerate((("Suction", _SUCTION), ("Discharge", _DISCHARGE))):
        for ax, curve in (
            (axes[0, 0], cycle.lift[number] * 1e3),
            (axes[1, 0], cycle.flow[number] * 1e3),
        ):
            degrees, values = over_turn(cycle.angle, curve)
            ax.plot(degrees, values, color=tint, linewidth=1.5, label=name)
    ylabel(axes[0, 0], "Lift, mm")
    ylabel(axes[1, 0], "Flow, forward positive, g/s")
    axes[1, 0].axhline(0, color="#888888", linewidth=0.8)
    if plenums is not None:
        parts = cycle.case.cylinder
        names = [f"Suction {i + 1}" for i in range(len(parts.suction.plenums))]
        names += [f"Discharge {i + 1}" for i in range(len(parts.discharge.plenums))]
        lines = [cycle.case.suction.p] * len(parts.suction.plenums)
        lines += [cycle.case.discharge.p] * len(parts.discharge.plenums)
        for name, line, course in zip(names, lines, plenums, strict=True):
            degrees, values = over_turn(cycle.angle, 100 * (course / line - 1))
            axes[2, 0].plot(degrees, values, linewidth=1.5, label=name)
        ylabel(axes[2, 0], "Plenums above their line, %")
        legend_above(axes[2, 0])
    for row in range(rows):
        crank_axis(axes[row, 0], label=row == rows - 1)
    legend_above(axes[0, 0])
    return figure


def log_p_h(cycle: Cycle) -> Figure:
    """The gas in the cylinder over its enthalpy, with the lines and the saturation dome.

    Raises:
        TypeError: a perfect gas, which has no dome.
    """
    fluid, case = cycle.case.cylinder.fluid, cycle.case
    if not isinstance(fluid, RealGas):
        raise TypeError("a diagram of pressure over enthalpy needs a real gas.")
    low = max(fluid.temperature_range[0], 0.55 * fluid.data["T_critical"])
    T = jnp.linspace(low, 0.995 * fluid.data["T_critical"], 120)
    dome = jax.vmap(lambda T: fluid.saturation(T=T))(T)
    liquid, vapour = fluid.state(T, dome.liquid), fluid.state(T, dome.vapour)
    inside = fluid.state(cycle.temperature, cycle.mass / cycle.volume)
    figure, ((ax,),) = new_figure(1, 1, (6.8, 4.8), f"{fluid.name}: pressure over enthalpy")
    h = np.concatenate([liquid.h, vapour.h[::-1]]) / 1e3
    p = np.concatenate([liquid.p, vapour.p[::-1]]) / 1e5
    ax.plot(h, p, color="#888888", linewidth=1.2, label="Saturation")
    closed = np.append(np.arange(inside.p.size), 0)
    ax.plot(np.asarray(inside.h)[closed] / 1e3, np.asarray(inside.p)[closed] / 1e5, color=_GAS,
            linewidth=1.5, label="Gas in the cylinder")  # fmt: skip
    marks = (
        ("Suction line", case.comes.h, case.comes.p, _SUCTION, "s"),
        ("At the suction valve", case.suction.h, case.suction.p, _SUCTION, "o"),
        ("Isentropic compression", case.isentropic.h, case.isentropic.p, "#009E73", "^"),
        ("Discharged gas", cycle.discharge_enthalpy, case.discharge.p, _DISCHARGE, "o"),
    )
    for label, x, y, tint, marker in marks:
        ax.plot(float(x) / 1e3, float(y) / 1e5, marker, color=tint, markersize=5, label=label)
    ax.set_yscale("log")
    ax.set_xlabel("Enthalpy, kJ/kg", fontsize=9)
    ylabel(ax, "Pressure, bar")
    legend(ax, loc="upper left")
    return figure


def power_use(performance: Performance) -> Figure:
    """What the power is spent on, from the isentropic power up."""
    names = [name for name in POWER if float(performance.power[name])]
    values = np.array([float(performance.power[name]) for name in names])
    left = np.concatenate([[0.0], np.cumsum(values)[:-1]])
    whole = float(performance.electric_power)
    title = f"Use of {whole:.4g} W; overall efficiency {100 * performance.overall_efficiency:.1f} %"
    figure, ((ax,),) = new_figure(1, 1, (7.2, 0.45 * len(names) + 1.4), title)
    tints = [_GAS, *[_DISCHARGE] * (len(names) - 1)]
    ax.barh([words(name) for name in names], values, left=left, color=tints, height=0.62)
    for place, value in enumerate(values):
        text = f"{value:.3g} W   {100 * value / whole:.1f} %"
        ax.text(max(left[place], left[place] + value) + 0.01 * whole, place, text, va="center",
                fontsize=8.5, color=INK)  # fmt: skip
    ax.invert_yaxis()
    ax.set_xlim(0, 1.22 * whole)
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("Power, W", fontsize=9)
    return figure


def rating_figures(found: RatingMap, name: str) -> dict[str, Figure]:
    """Maps of capacity, power, COP and overall efficiency; none for a map of a single row or column."""
    figures = {}
    x, y = np.asarray(found.condensing) - ZERO, np.asarray(found.evaporating) - ZERO
    units = {one: unit for one, unit, _ in QUANTITIES}
    for one in ("capacity", "power", "cop", "overall_efficiency"):
        values = np.ma.masked_invalid(np.asarray(found.values[one]))
        if min(values.shape) < 2 or not values.count():
            continue
        look = shown(one, units[one], values)
        figure, ((ax,),) = new_figure(1, 1, (6.6, 4.6), f"{name}, rating {found.rating}")
        ax.grid(False)
        order = np.ix_(np.argsort(y), np.argsort(x))
        shades = ax.contourf(
            np.sort(x), np.sort(y), (values * look.factor)[order], 16, cmap="viridis"
        )
        lines = ax.contour(shades, colors="white", linewidths=0.5)
        ax.clabel(lines, fontsize=7.5, fmt="%.4g")
        figure.colorbar(shades, ax=ax, pad=0.01).set_label(look.label, fontsize=9)
        ax.set_xlabel("Condensing temperature, °C", fontsize=9)
        ylabel(ax, "Evaporating temperature, °C")
        figures[one] = figure
    return figures
