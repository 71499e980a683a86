"""Pictures of several cylinders on one crankshaft: the machine from two sides, and its orders."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._fields import of_cylinder
from .._shown import RPM
from ..compressor import Compressor, of_each_cylinder
from ..crank import CrankTrain, Orbit, time_harmonics, train_over_speed
from ..friction import MainBearings
from ..mechanism import Cylinders, SliderCrank
from ..shaking import shaking_wrench
from ._fine import fine_turn
from ._motion import Motion
from ._style import INK, legend, new_figure, ylabel

_TINTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999933", "#56437F")
_ORDERS = 12


def cylinders_motion(compressor: Compressor, orbit: Orbit, frames: int = 48) -> Motion:
    """One revolution of a machine with several cylinders, from the front and from the side.

    The arrows are the loads on the main bearings in machine axes; from the side, the crank in the plane
    of the first throw with rods, counterweights and bearings at their places.

    Args:
        compressor: with several cylinders.
        orbit: its periodic state.
        frames: pictures of the revolution, even in time.
    """
    cylinders = compressor.cylinders
    assert cylinders is not None
    turn = fine_turn(compressor, orbit)
    at = np.asarray(turn.state.angle)
    gaps = np.diff(at) / (0.5 * np.asarray(turn.state.speed[1:] + turn.state.speed[:-1]))
    time = np.concatenate([[0.0], np.cumsum(gaps)])
    angles = np.interp(np.linspace(0, time[-1], frames, endpoint=False), time, at)
    loads = {
        name: -np.asarray(force)
        for name, force in turn.loads.forces.items()
        if name in _bearing_names(compressor)
    }
    largest = max(float(np.hypot(*load).max()) for load in loads.values())
    figure, ((front, side),) = new_figure(1, 2, (9.6, 5.2), "Front and side", share=False)
    mechanism: Any = compressor.mechanism
    parts = [of_cylinder(mechanism, k + 1) for k in range(cylinders.count)]
    reach = max(float(m.piston_extremes()[0] + 0.5 * m.bore) for m in parts)
    lines = [_lines(front, side, _TINTS[k % len(_TINTS)]) for k in range(cylinders.count)]
    front.set_xlim(-1.05 * reach, 1.05 * reach)
    front.set_ylim(-1.05 * reach, 1.05 * reach)
    front.set_aspect("equal")
    front.set_xlabel("y, m", fontsize=9)
    ylabel(front, "x, m")
    places = _bearing_places(compressor)
    ends = np.concatenate([np.asarray(cylinders.position), places])
    margin = 0.15 * max(np.ptp(ends), 2 * float(parts[0].bore))
    side.set_xlim(ends.min() - margin, ends.max() + margin)
    side.set_ylim(-1.05 * reach, 1.05 * reach)
    side.set_xlabel("z, m", fontsize=9)
    ylabel(side, "x, m")
    side.plot(places, np.zeros_like(places), "^", color=INK, markersize=9, label="Main bearings")
    (shaft,) = side.plot([], [], "-", color=INK, linewidth=2.5)
    (weights,) = side.plot([], [], "s", color="#888888", markersize=8, label="Counterweights")
    legend(side, loc="lower right")
    tips = [
        front.annotate("", (0, 0), (0, 0), arrowprops={
            "arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0})
        for _ in loads
    ]  # fmt: skip
    told = front.text(0.0, 1.01, "", transform=front.transAxes, fontsize=8.5, color=INK)
    unbalances = np.array([float(u) for u in cylinders.unbalances(parts[0])])

    def show(frame: int) -> None:
        angle = angles[frame % frames]
        for number, (single, drawn) in enumerate(zip(parts, lines, strict=True)):
            _draw(cylinders, number, single, angle, drawn)
        z, x = _crank_line(cylinders, float(parts[0].crank_radius), angle)
        shaft.set_data(np.concatenate([[side.get_xlim()[0]], z, [side.get_xlim()[1]]]),
                       np.concatenate([[0.0], x, [0.0]]))  # fmt: skip
        turned = angle + np.array([float(t.angle) for t in cylinders.rows])
        heavy = np.sign(unbalances) * float(parts[0].crank_radius)
        weights.set_data(
            np.array([float(t.position) for t in cylinders.rows])[unbalances != 0],
            (heavy * np.cos(turned))[unbalances != 0],
        )
        for tip, load in zip(tips, loads.values(), strict=True):
            now = np.array([np.interp(angle, at, c) for c in load]) * 0.6 * reach / largest
            tip.xy = (now[1], now[0])
        speed = RPM * np.interp(angle, at, turn.state.speed)
        shown = round(np.rad2deg(angle)) % 360
        told.set_text(f"{shown}°, {speed:.1f} rpm; longest arrow {largest / 1e3:.3g} kN")

    show(0)
    return Motion(figure, show, frames)


def machine_views(compressor: Compressor, orbit: Orbit) -> Figure:
    """Front and side of the machine at the first top dead centre."""
    return cylinders_motion(compressor, orbit, 1).figure


def order_spectra(compressor: Compressor, orbit: Orbit) -> Figure:
    """Orders of time of the torque of gas and weights, the shaking force and its couples."""
    assert compressor.cylinders is not None
    instants = orbit.time, orbit.weight / orbit.state.speed
    each = of_each_cylinder(orbit.under_gas(compressor), orbit.state.angle).conservative
    torque, _ = time_harmonics(jnp.stack([jnp.sum(each, axis=0), each[0]]), *instants, _ORDERS)
    wrench = shaking_wrench(compressor, orbit.state)
    force, _ = time_harmonics(wrench.force[:2], *instants, _ORDERS)
    moment, _ = time_harmonics(wrench.moment, *instants, _ORDERS)
    figure, axes = new_figure(3, 1, (7.2, 7.4), "Orders of the revolution", share=True)
    at = np.arange(1, _ORDERS + 1)
    ahead, behind = (0.5 * jnp.abs(force[0] + sign * force[1]) for sign in (1j, -1j))
    rows = (
        ("Torque, N m", {"All cylinders": torque[0], "The first": torque[1]}),
        ("Shaking force, N", {"Forward": ahead, "Backward": behind}),
        ("Moment, N m", {f"About {name}": row for name, row in zip("xyz", moment, strict=True)}),
    )
    for (ax,), (label, bars) in zip(axes, rows, strict=True):
        width = 0.8 / len(bars)
        for place, (name, values) in enumerate(bars.items()):
            shift = (place - 0.5 * (len(bars) - 1)) * width
            ax.bar(at + shift, np.abs(values), width, color=_TINTS[place], label=name)
        ylabel(ax, label)
        legend(ax, loc="upper right")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[-1, 0].set_xlabel("Order of time", fontsize=9)
    return figure


def torsion_over_speed(compressor: Compressor, orbit: Orbit, train: CrankTrain) -> Figure:
    """Peak torque of every spring of the crank train against speed, with its critical speeds.

    Args:
        compressor: with several cylinders.
        orbit: its periodic state, whose speed is the middle of the range.
        train: inertias and springs.
    """
    speeds = float(orbit.mean_speed) * np.linspace(0.5, 1.5, 41)
    _, peaks = train_over_speed(compressor, train, jnp.asarray(speeds))
    figure, ((ax,),) = new_figure(1, 1, (7.2, 3.8), "Torque of the springs of the crank train")
    for number, peak in enumerate(np.asarray(peaks).T):
        tint = _TINTS[number % len(_TINTS)]
        ax.plot(RPM * speeds, peak, color=tint, linewidth=1.6, label=f"Spring {number + 1}")
    for frequency in np.asarray(train.chain(compressor).natural_frequencies)[1:]:
        for order in range(1, 13):
            if speeds[0] < frequency / order < speeds[-1]:
                ax.axvline(RPM * frequency / order, color="#AAAAAA", linewidth=0.8, linestyle="--")
                ax.annotate(f"{order}", (RPM * frequency / order, 1), xycoords=("data", "axes fraction"),
                            fontsize=8, ha="center", va="bottom", color=INK)  # fmt: skip
    ax.set_ylim(0, None)
    ax.set_xlabel("Mean speed, rpm; dashed: an order meets a torsional frequency", fontsize=9)
    ylabel(ax, "Peak over the revolution, N m")
    legend(ax, loc="upper right")
    return figure


def by_number_of_cylinders(results: Mapping[str, Orbit]) -> Figure:
    """Efficiency and fluctuation of machines with different cylinders.

    Args:
        results: orbit by what stands below its bar, such as the number of cylinders or the layout.
    """
    figure, axes = new_figure(1, 2, (8.6, 3.4), "Cylinders on one crank", share=False)
    values = (
        ("Mechanical efficiency, %", [100 * float(o.mechanical_efficiency) for o in results.values()]),
        ("Speed fluctuation, %", [100 * float(o.speed_fluctuation) for o in results.values()]),
    )  # fmt: skip
    for ax, (label, heights), tint in zip(axes[0], values, _TINTS, strict=False):
        bars = ax.bar(list(results), heights, color=tint, width=0.6)
        ax.bar_label(bars, [f"{h:.4g}" for h in heights], fontsize=8.5, color=INK)
        if label.startswith("Mech"):
            ax.set_ylim(min(heights) - 0.5 * np.ptp(heights) - 0.1, max(heights) + 0.1)
        ylabel(ax, label)
    return figure


def _bearing_names(compressor: Compressor) -> tuple[str, ...]:
    support = getattr(compressor.friction, "main_journal", None)
    return (support.names or ()) if isinstance(support, MainBearings) else ("main_journal",)


def _bearing_places(compressor: Compressor) -> np.ndarray:
    support = getattr(compressor.friction, "main_journal", None)
    position = support.position if isinstance(support, MainBearings) else None
    return np.zeros(1) if position is None else np.asarray(position)


def _lines(front, side, tint):
    kinds = {"linewidth": 1.8, "color": tint, "solid_capstyle": "round"}
    return [ax.plot([], [], **kinds)[0] for ax in (front, front, front, side, side)]


def _draw(cylinders: Cylinders, number: int, single: SliderCrank, angle: float, drawn) -> None:
    """Crank and rod, piston and cylinder from the front; rod and piston from the side."""
    bank, phase = float(cylinders.bank_angle[number]), float(cylinders.phase[number])
    radius, bore, offset = (float(getattr(single, n)) for n in ("crank_radius", "bore", "offset"))
    own, place = angle + phase, float(cylinders.position[number])
    position = float(single.piston(jnp.asarray(own))[0])
    top, bottom = (float(x) for x in single.piston_extremes())
    half, skirt = 0.5 * bore, 0.4 * bore
    rod = [(0, 0), (radius * np.cos(own), radius * np.sin(own)), (position, offset)]
    box = [(-skirt, -half), (skirt, -half), (skirt, half), (-skirt, half), (-skirt, -half)]
    piston = [(position + x, offset + y) for x, y in box]
    head = top + skirt + 0.05 * bore
    wall = [(bottom - skirt, -half), (head, -half), (head, half), (bottom - skirt, half)]
    turn = np.array([[np.cos(bank), -np.sin(bank)], [np.sin(bank), np.cos(bank)]])
    shown = [turn @ np.array(path).T for path in (rod, piston, [(x, offset + y) for x, y in wall])]
    for line, path in zip(drawn[:3], shown, strict=True):
        line.set_data(path[1], path[0])
    drawn[2].set_linewidth(0.9)
    drawn[3].set_data([place, place], shown[0][0, 1:])
    drawn[4].set_data(place + np.array([-0.08, 0.08]) * bore, [shown[0][0, 2]] * 2)


def _crank_line(cylinders: Cylinders, radius: float, angle: float):
    """The crank from the side: z and x of its axis, throw by throw."""
    z, x, places = [], [], np.asarray(cylinders.position)
    first = 0
    for throw in cylinders.rows:
        own = places[first : first + throw.banks.size]
        first += throw.banks.size
        room = 0.25 * radius
        height = radius * np.cos(angle + float(throw.angle))
        z += [own.min() - room, own.min() - room, own.max() + room, own.max() + room]
        x += [0.0, height, height, 0.0]
    return np.array(z), np.array(x)
