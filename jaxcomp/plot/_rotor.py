"""Pictures of a rotor with its crankcase and housing: drawing, curves, shapes, orbits, Campbell."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from .._fields import BadInput
from .._shown import RPM
from .._words import one_of
from ..rotor import (
    DampedModes,
    Response,
    RotorModel,
    node_names,
    node_positions,
    orbit,
    subset_names,
    subsets,
)
from ._style import INK, legend, legend_above, new_figure, note, ylabel

_LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#444444")
# What the shape of a motion shows.
_SHADE = "Lines: at the instant of the largest. Dots: nodes. Shade: amplitude."
_STEEL, _HOLLOW, _DISK = "#B8C7D6", "#FFFFFF", "#56437F"


def rotor_drawing(model: RotorModel) -> Figure:
    """Shafts and disks to scale along z; bodies as bars below, with the links between them."""
    places = node_positions(model)
    bodies = list(model.bodies)
    figure, ((ax,),) = new_figure(1, 1, (8.6, 3.4 + 0.7 * len(bodies)), "Rotor, bodies and links")
    height = _draw_shafts(ax, model, places)
    rows: dict[Any, float] = {
        node: 0.0 for shaft in model.shafts for p in shaft.pairs for node in p
    }
    step = 1.1 * height
    for number, body in enumerate(bodies):
        row = -(1.6 * height + number * step)
        members = (body.centre, *body.nodes)
        z = np.array([places[node][2] for node in members]) * 1e3
        ax.plot([z.min(), z.max()], [row, row], color=_LINES[number % 7], linewidth=5, alpha=0.6)
        ax.plot(z[0], row, "o", color=INK, markersize=5)
        ax.text(z.max(), row, f"  {body.centre}, {float(body.mass):.3g} kg", va="center",
                fontsize=8.5, color=INK)  # fmt: skip
        rows |= dict.fromkeys(members, row)
    ground = -(1.6 * height + len(bodies) * step)
    if any(link.nodes[1] is None for link in model.links):
        z = np.array([p[2] for p in places.values()]) * 1e3
        ax.plot([z.min(), z.max()], [ground, ground], color=INK, linewidth=1)
        ax.text(z.min(), ground, "ground ", ha="right", va="center", fontsize=8.5, color=INK)
    pairs = [(link.nodes, "#D55E00", "-") for link in model.links]
    pairs += [(pair, "#0072B2", ":") for pull in model.magnetic_pulls for pair in pull.nodes]
    for (a, b), tint, style in pairs:
        z = places[a][2] * 1e3
        ends = rows.get(a, 0.0), ground if b is None else rows.get(b, 0.0)
        ax.plot([z, z], ends, color=tint, linestyle=style, linewidth=1.4, zorder=4)
        if style == "-":
            top = -height if max(ends) == 0.0 else max(ends)  # below the shaft
            ax.text(z, (top + min(ends)) / 2, f" {a}", fontsize=7.5, va="center", color=tint)
    for present, label, look in (
        (model.links, "bearing or mount", {"color": "#D55E00"}),
        (model.magnetic_pulls, "magnetic pull", {"color": "#0072B2", "linestyle": ":"}),
        (model.disks, "disk, by its mass", {"color": _DISK, "linewidth": 2.4, "alpha": 0.7}),
        (bodies, "centre of mass", {"color": INK, "marker": "o", "linestyle": ""}),
    ):
        if present:
            ax.plot([], [], label=label, **look)
    if any(patch.get_hatch() for patch in ax.patches):
        label = "stiff, without mass"
        ax.add_patch(Rectangle((0, 0), 0, 0, facecolor=_HOLLOW, edgecolor="#666666", linewidth=0.5,
                               hatch="///", label=label))  # fmt: skip
    legend_above(ax)
    ax.grid(False)
    ax.set_xlabel("z, mm", fontsize=9)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_ylim(ground - 0.4 * height, 1.35 * height)
    return figure


def response_curves(
    result: Mapping[str, Any] | Response, nodes: Sequence[str | int] = ()
) -> Figure:
    """Major axis of the orbits over the speed, one axes an order.

    Args:
        result: of `respond` over orders and speeds, or of `jaxcomp respond` with its curves.
        nodes: of the response, by name; those that move most if absent.

    Raises:
        BadInput: a response without orders and speeds, or a node that it does not have.
    """
    if isinstance(result, Response):
        result = _curves_of(result, [str(node) for node in nodes])
    orders, curves = result["orders"], result["curves"]
    title = "Response over the speed"
    figure, axes = new_figure(len(orders), 1, (7.2, 1.2 + 2.3 * len(orders)), title)
    rpm = np.array(curves["speeds"]) * RPM
    for n, order in enumerate(orders):
        ax = axes[n, 0]
        for i, (name, values) in enumerate(curves["major_axis"].items()):
            y = np.array(values[n], float) * 1e6
            dash = "-" if i < len(_LINES) else "--"
            ax.semilogy(rpm, y, dash, color=_LINES[i % 7], linewidth=1.3, label=name)
        ylabel(ax, f"Order {order}, µm")
        for speed in result["speeds"]:
            if rpm[0] <= speed * RPM <= rpm[-1]:
                ax.axvline(speed * RPM, color="#AAAAAA", linewidth=0.8)
                note(figure, "Grey lines: speeds of the tables.")
    axes[-1, 0].set_xlabel("Speed, rpm", fontsize=9)
    legend(axes[0, 0], ncols=3, loc="lower left", bbox_to_anchor=(0, 1.0))
    return figure


def _curves_of(response: Response, nodes: Sequence[str]) -> dict[str, Any]:
    x = np.asarray(response.displacement)
    if x.ndim != 4:
        raise BadInput(
            "response", f"with {x.ndim - 2} axes", "over orders and speeds, as of `respond`"
        )
    size = np.asarray(orbit(response.displacement[..., 0], response.displacement[..., 1]).major)
    size = np.where(np.asarray(response.ok)[..., None], size, np.nan)
    known = list(response.nodes) or [str(number) for number in range(x.shape[-2])]
    missing = [node for node in nodes if node not in known]
    if missing:
        raise BadInput("nodes", missing[0], one_of(missing[0], known))
    most = np.argsort(-np.nanmax(size, axis=(0, 1)), kind="stable")[: len(_LINES)]
    shown = nodes or [known[i] for i in sorted(most)]
    spin = np.asarray(response.spin_speed)[0]
    ratio = np.asarray(response.frequency)[:, -1] / spin[-1]
    return {
        "speeds": [],
        "orders": np.round(ratio).astype(int).tolist(),
        "curves": {
            "speeds": spin,
            "major_axis": {name: size[..., known.index(name)] for name in shown},
        },
    }


def deflection_shape(model: RotorModel, response: Response) -> Figure:
    """Motion of all subsets along z at the instant of the largest, with the amplitude around it.

    The first speed and order of the response are shown.
    """
    x = np.asarray(response.displacement).reshape(-1, *response.displacement.shape[-2:])[0]
    speed = float(np.asarray(response.frequency).reshape(-1)[0]) * RPM
    title = f"Deflection shape, {speed:.5g} cycles per minute"
    figure, axes = new_figure(2, 1, (7.2, 5.6), title)
    note(figure, _SHADE)
    _shape(axes[:, 0], model, x * 1e6)
    for ax, axis in zip(axes[:, 0], "xy", strict=True):
        ylabel(ax, f"u{axis}, µm")
    axes[1, 0].set_xlabel("z, mm", fontsize=9)
    legend_above(axes[0, 0])
    return figure


def mode_shapes(model: RotorModel, modes: DampedModes, result: Mapping[str, Any]) -> Figure:
    """The first modes along z, x-plane and y-plane."""
    real = np.flatnonzero(np.isfinite(np.asarray(modes.eigenvalue)))[:6]
    rows = max(1, -(-len(real) // 2))
    figure, axes = new_figure(rows, 2, (8.6, 1.4 + 1.9 * rows), "Mode shapes")
    for ax in axes.flat[len(real) :]:
        ax.set_visible(False)
    for ax, i in zip(axes.flat, real, strict=False):
        shape = np.asarray(modes.shape)[i]
        plane = int(np.argmax(np.abs(shape[:, :2]).max(0)))
        _shape((ax,), model, shape[:, [plane]])
        hertz = float(modes.frequency[i]) / (2 * math.pi)
        damping = 100 * float(modes.damping_ratio[i])
        text = f"{i + 1}: {hertz:.4g} Hz, damping {damping:.3g} %, {'xy'[plane]}"
        ax.set_title(text, fontsize=8.5, loc="left", color=INK)
        ax.set_yticks([0])
    note(figure, f"{_SHADE} Each mode in the plane of its largest motion, x or y.")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=5, frameon=False, fontsize=8.5)
    for ax in axes[-1]:
        ax.set_xlabel("z, mm", fontsize=9)
    if result["free"]:
        figure.suptitle("Mode shapes without links", fontsize=11, color=INK, x=0.01, ha="left")
    return figure


def response_orbits(result: Mapping[str, Any]) -> Figure:
    """Orbits of the watched nodes at the first speed, order by order; a dot marks time zero."""
    nodes = dict(list(result["nodes"].items())[:12])
    columns = min(4, len(nodes))
    rows = -(-len(nodes) // columns)
    rpm = result["speeds"][0] * RPM
    figure, axes = new_figure(rows, columns, (2.2 * columns + 0.6, 2.3 * rows + 0.8),
                              f"Orbits at {rpm:.5g} rpm, µm")  # fmt: skip
    turn = np.linspace(0, 2 * np.pi, 181)
    for ax in axes.flat[len(nodes) :]:
        ax.set_visible(False)
    for ax, (name, motion) in zip(axes.flat, nodes.items(), strict=False):
        for n, order in enumerate(result["orders"][:3]):
            size, angle = motion["amplitude"], motion["phase"]
            x, y = (1e6 * size[a][n][0] * np.cos(turn + angle[a][n][0]) for a in ("ux", "uy"))
            ax.plot(x, y, color=_LINES[n], linewidth=1.4, label=f"order {order}")
            ax.plot(x[0], y[0], "o", color=_LINES[n], markersize=3.5)
        ax.set_title(name, fontsize=8, loc="left", color=INK)
        ax.set_aspect("equal", adjustable="datalim")
        ax.tick_params(labelbottom=True)
    for ax in axes[:, 0]:
        ylabel(ax, "y")
    for ax in axes[-1]:
        ax.set_xlabel("x", fontsize=9)
    note(figure, "Dots: time zero of the phases.")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=5, frameon=False, fontsize=8.5)
    return figure


def campbell_diagram(
    campbell: Mapping[str, Any] | DampedModes, speeds: Sequence[float] = ()
) -> Figure:
    """Frequencies over the speed with their whirl, the line of the speed, and what it meets.

    Args:
        campbell: of `jaxcomp.rotor.campbell`, or of `jaxcomp modes` with a range of speeds, which has
            the critical speeds as well.
        speeds: [rad/s] of the modes, where they do not say them.

    Raises:
        BadInput: modes at one speed, or as many speeds as there are not.
    """
    if isinstance(campbell, DampedModes):
        if np.shape(campbell.whirl)[:-1] != np.shape(speeds) or np.ndim(speeds) != 1:
            raise BadInput("speeds", np.shape(speeds), "those that `campbell` was given")
        campbell = {
            "speeds": speeds,
            "frequency": campbell.frequency,
            "whirl": campbell.whirl,
            "damping_ratio": campbell.damping_ratio,
            "critical_speeds": [],
        }
    figure, ((ax,),) = new_figure(1, 1, (7.2, 4.8), "Campbell diagram")
    rpm = np.array(campbell["speeds"]) * RPM
    hertz, whirl, damping = (
        np.array(campbell[key], float) for key in ("frequency", "whirl", "damping_ratio")
    )
    hertz = hertz / (2 * np.pi)
    grid = np.broadcast_to(rpm[:, None], hertz.shape)
    strong = damping > math.sqrt(0.5)
    senses = (
        ("forward", whirl >= 0.05, "#0072B2", "o"),
        ("backward", whirl <= -0.05, "#D55E00", "s"),
        ("in a plane", np.abs(whirl) < 0.05, "#444444", "D"),
    )
    for label, where, tint, marker in senses:
        for weak, alpha in ((where & ~strong, 1.0), (where & strong, 0.25)):
            ax.plot(grid[weak], hertz[weak], marker, color=tint, markersize=2.6, alpha=alpha,
                    label=label if alpha == 1 and weak.any() else None)  # fmt: skip
    for mode in np.where(strong, np.nan, hertz).T:
        ax.plot(rpm, mode, color="#BBBBBB", linewidth=0.8, zorder=1)
    for order, dash in ((1, "--"), (2, ":")):
        ax.plot(
            rpm, order * rpm / 60, color=INK, linewidth=1, linestyle=dash, label=f"{order}x speed"
        )
    top = 1.3 * 2 * rpm[-1] / 60
    above = int(np.sum(np.nanmin(hertz, axis=0) > top)) if np.isfinite(hertz).any() else 0
    if above:
        figure.suptitle(f"Campbell diagram; {above} modes lie above", fontsize=11, color=INK, x=0.01,
                        ha="left")  # fmt: skip
    peaks = [
        c["speed"] * RPM
        for c in campbell["critical_speeds"]
        if c["damping_ratio"] <= math.sqrt(0.5)
    ]
    if peaks:
        ax.plot(peaks, np.array(peaks) / 60, "o", color=INK, fillstyle="none", markersize=9,
                label="critical speed")  # fmt: skip
    ylabel(ax, "Natural frequency, Hz (pale: damping above 70 %)")
    ax.set_xlabel("Speed, rpm", fontsize=9)
    ax.set_ylim(0, top)
    legend_above(ax)
    return figure


def _draw_shafts(ax, model, places) -> float:
    """Elements and disks; returns the largest radius, mm."""
    height = 1.0
    outline = []
    for shaft in model.shafts:
        end = shaft.outer_diameter_end
        outer = np.maximum(shaft.outer_diameter, shaft.outer_diameter if end is None else end)
        inner = np.zeros_like(outer) if shaft.inner_diameter is None else shaft.inner_diameter
        for (a, b), do, di, rho in zip(shaft.pairs, outer, inner, shaft.density, strict=True):
            z = sorted((places[a][2], places[b][2]))
            outline.append((float(do) * 1e3, float(di) * 1e3, z[0] * 1e3, z[1] * 1e3, float(rho)))
            height = max(height, float(do) * 500)
    for do, di, z0, z1, rho in sorted(outline, reverse=True):
        face = _STEEL if rho else _HOLLOW
        hatch = None if rho else "///"
        for low, high in ((di / 2, do / 2), (-do / 2, -di / 2)):
            ax.add_patch(
                Rectangle((z0, low), z1 - z0, high - low, facecolor=face, edgecolor="#666666",
                          linewidth=0.5, hatch=hatch)
            )  # fmt: skip
    for disks in model.disks:
        largest = max(float(np.max(disks.mass)), 1e-12)
        for node, mass in zip(disks.nodes, np.asarray(disks.mass), strict=True):
            z, half = places[node][2] * 1e3, height * (0.5 + 0.5 * float(mass) / largest)
            ax.plot([z, z], [-half, half], color=_DISK, linewidth=2.4, alpha=0.7, zorder=3)
    z = [p[2] * 1e3 for p in places.values()]
    ax.set_xlim(min(z) - 0.12 * (max(z) - min(z) + 1), max(z) + 0.25 * (max(z) - min(z) + 1))
    return height


def _shape(axes: Sequence, model: RotorModel, x: np.ndarray) -> None:
    """Real part of x (nodes, planes) at the phase of the largest, each subset along z."""
    places, names = node_positions(model), list(node_names(model))
    largest = x[:, : len(axes)].reshape(-1)
    turn = np.exp(-1j * np.angle(largest[np.argmax(np.abs(largest))]))
    groups = zip(subset_names(model), subsets(model), strict=True)
    for number, (label, group) in enumerate(groups):
        line = sorted(group, key=lambda node: places[node][2])
        at = np.array([names.index(node) for node in line])
        z = np.array([places[node][2] for node in line]) * 1e3
        tint = _LINES[number % 7]
        for plane, ax in enumerate(axes):
            ax.plot(z, (x[at, plane] * turn).real, "o-", color=tint, markersize=2.4,
                    linewidth=1.5, label=label)  # fmt: skip
            size = np.abs(x[at, plane])
            ax.fill_between(z, -size, size, color=tint, alpha=0.08, linewidth=0)
            ax.axhline(0, color="#888888", linewidth=0.8)
