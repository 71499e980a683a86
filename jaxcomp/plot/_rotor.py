"""Pictures of a rotor with its crankcase and housing: drawing, curves, shapes, orbits, Campbell."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from .._core.display import RPM
from .._core.errors import BadInput
from .._core.words import one_of
from ..rotor import CampbellDiagram, DampedModes, Response, RotorModel, RotorModes, orbit
from ..rotor._model import node_positions, subset_names, subsets
from ..rotor._nodes import node_names
from ..vibration import MotionOverSpeed, RotorMotion
from . import _style as style
from ._drawing import draws

# Curves of a response that still can be read.
_CURVES = 7
# Damping ratio from which on a mode has no peak.
_STRONG = math.sqrt(0.5)
# What the shape of a motion shows.
_SHADE = "Lines: at the instant of the largest. Dots: nodes. Shade: amplitude."
_DISK = {"color": "#56437F", "linewidth": 2.4, "alpha": 0.7}
# Elements of a shaft by whether they have mass.
_EDGE = {"edgecolor": "#666666", "linewidth": 0.5}
_SOLID = {
    True: _EDGE | {"facecolor": "#B8C7D6"},
    False: _EDGE | {"facecolor": "white", "hatch": "///"},
}


@draws()
def rotor_drawing(model: RotorModel) -> Figure:
    """Shafts and disks to scale along z; bodies as bars below, with the links between them."""
    places = node_positions(model)
    bodies = list(model.bodies)
    figure, ax = style.single((8.6, 3.4 + 0.7 * len(bodies)), "Rotor, bodies and links")
    height = _draw_shafts(ax, model, places)
    rows: dict[Any, float] = dict.fromkeys(shaft_nodes(model), 0.0)
    step = 1.1 * height
    for number, body in enumerate(bodies):
        row = -(1.6 * height + number * step)
        members = (body.centre, *body.nodes)
        z = _along(places, members)
        ax.plot([z.min(), z.max()], [row, row], color=style.tint(number), linewidth=5, alpha=0.6)
        ax.plot(z[0], row, "o", color=style.INK, markersize=5)
        ax.text(z.max(), row, f"  {body.centre}, {float(body.mass):.3g} kg", va="center",
                fontsize=8.5, color=style.INK)  # fmt: skip
        rows |= dict.fromkeys(members, row)
    ground = -(1.6 * height + len(bodies) * step)
    if any(link.nodes[1] is None for link in model.links):
        z = _along(places, places)
        ax.plot([z.min(), z.max()], [ground, ground], color=style.INK, linewidth=1)
        ax.text(z.min(), ground, "ground ", ha="right", va="center", fontsize=8.5, color=style.INK)
    for (a, b), paint, dash in _links(model):
        z = places[a][2] * 1e3
        ends = [rows.get(a, 0.0), ground]
        if b is not None:
            ends[1] = rows.get(b, 0.0)
        ax.plot([z, z], ends, color=paint, linestyle=dash, linewidth=1.4, zorder=4)
        if dash == "-":
            _name_link(ax, a, z, ends, height, paint)
    for present, label, look in (
        (model.links, "bearing or mount", {"color": "#D55E00"}),
        (model.magnetic_pulls, "magnetic pull", {"color": "#0072B2", "linestyle": ":"}),
        (model.disks, "disk, by its mass", _DISK),
        (bodies, "centre of mass", {"color": style.INK, "marker": "o", "linestyle": ""}),
    ):
        if present:
            ax.plot([], [], label=label, **look)
    if any(patch.get_hatch() for patch in ax.patches):
        ax.add_patch(Rectangle((0, 0), 0, 0, **_SOLID[False], label="stiff, without mass"))
    style.legend_above(ax)
    ax.grid(False)
    ax.spines["left"].set_visible(False)
    ax.set(xlabel="z, mm", yticks=[], ylim=(ground - 0.4 * height, 1.35 * height))
    return figure


def _along(places, nodes) -> np.ndarray:
    """[mm] Places of nodes along z."""
    return np.array([places[node][2] for node in nodes]) * 1e3


def _links(model: RotorModel) -> list[tuple[Any, str, str]]:
    """Pairs of nodes that a link or a magnetic pull joins, each with its colour and its line."""
    pairs = []
    for link in model.links:
        pairs.append((link.nodes, "#D55E00", "-"))
    for pull in model.magnetic_pulls:
        for pair in pull.nodes:
            pairs.append((pair, "#0072B2", ":"))
    return pairs


def _name_link(ax, node, z: float, ends: list[float], height: float, paint: str) -> None:
    """Name of the first node of a link, in the middle of the link where it can be seen."""
    top = max(ends)
    if top == 0.0:
        top = -height  # below the shaft
    ax.text(z, (top + min(ends)) / 2, f" {node}", fontsize=7.5, va="center", color=paint)


def shaft_nodes(model: RotorModel) -> list[Any]:
    """Nodes of the shafts, element by element, so that most are there twice."""
    nodes = []
    for shaft in model.shafts:
        for pair in shaft.pairs:
            nodes += pair
    return nodes


@draws(rotor_modes=RotorModes)
def rotor_modes_figures(rotor_modes: RotorModes) -> dict[str, Figure]:
    """The rotor, its mode shapes and its Campbell diagram, by name."""
    figures = {"rotor": rotor_drawing(rotor_modes.model), "modes": mode_shapes(rotor_modes)}
    if rotor_modes.campbell is not None:
        figures["campbell"] = campbell_diagram(rotor_modes.campbell)
    return figures


@draws(rotor_motion=RotorMotion)
def rotor_motion_figures(rotor_motion: RotorMotion) -> dict[str, Figure]:
    """The rotor, its deflection, the orbits of watched nodes and curves over the speed, by name."""
    figures = {
        "rotor": rotor_drawing(rotor_motion.model),
        "shape": deflection_shape(rotor_motion.model, rotor_motion.response),
        "orbits": response_orbits(rotor_motion),
    }
    if rotor_motion.curves is not None:
        figures["curves"] = response_curves(rotor_motion)
    return figures


@draws(found=RotorMotion | Response)
def response_curves(found: RotorMotion | Response, nodes: Sequence[str | int] = ()) -> Figure:
    """Major axis of the orbits over the speed, one axes an order.

    Args:
        found: of `respond` over orders and speeds, or of `rotor_motion` over a range of speeds.
        nodes: of a response, by name; those that move most if absent.

    Raises:
        BadInput: a response without orders and speeds, or a node that it does not have.
    """
    if isinstance(found, Response):
        curves = _curves_of(found, [str(node) for node in nodes])
        marks = ()
    elif found.curves is None:
        raise BadInput("found", "at single speeds", "over a range of speeds")
    else:
        curves = found.curves
        marks = found.speeds
    size = (7.2, 1.2 + 2.3 * len(curves.orders))
    figure, axes = style.stacked(len(curves.orders), size, "Response over the speed")
    rpm = np.asarray(curves.speeds) * RPM
    for n, (ax, order) in enumerate(zip(axes, curves.orders, strict=True)):
        for i, (name, values) in enumerate(curves.major_axis.items()):
            dash = "-" if i < len(style.TINTS) else "--"
            ax.semilogy(rpm, values[n] * 1e6, dash, color=style.tint(i), linewidth=1.3, label=name)
        ax.set_ylabel(f"Order {order}, µm")
        for speed in marks:
            if rpm[0] <= speed * RPM <= rpm[-1]:
                ax.axvline(speed * RPM, color="#AAAAAA", linewidth=0.8)
                style.note(figure, "Grey lines: speeds of the tables.")
    axes[-1].set_xlabel("Speed, rpm")
    style.legend(axes[0], ncols=3, loc="lower left", bbox_to_anchor=(0, 1.0))
    return figure


def _curves_of(response: Response, nodes: Sequence[str]) -> MotionOverSpeed:
    x = np.asarray(response.displacement)
    if x.ndim != 4:
        extent = f"with {x.ndim - 2} axes"
        raise BadInput("response", extent, "over orders and speeds, as of `respond`")
    size = np.asarray(orbit(response.displacement[..., 0], response.displacement[..., 1]).major)
    size = np.where(np.asarray(response.ok)[..., None], size, np.nan)
    names = list(response.nodes) or [str(number) for number in range(x.shape[-2])]
    for node in nodes:
        if node not in names:
            raise BadInput("nodes", node, one_of(node, names))
    largest = np.argsort(-np.nanmax(size, axis=(0, 1)), kind="stable")[:_CURVES]
    shown = nodes or [names[i] for i in sorted(largest)]
    spin = np.asarray(response.spin_speed)[0]
    ratio = np.asarray(response.frequency)[:, -1] / spin[-1]
    orders = np.round(ratio).astype(int).tolist()
    major_axis = {}
    for name in shown:
        major_axis[name] = size[..., names.index(name)]
    return MotionOverSpeed(orders, spin, major_axis)


@draws(response=Response)
def deflection_shape(model: RotorModel, response: Response) -> Figure:
    """Motion of all subsets along z at the instant of the largest, with the amplitude around it.

    The first speed and order of the response are shown.
    """
    speed = float(np.asarray(response.frequency).reshape(-1)[0]) * RPM
    title = f"Deflection shape, {speed:.5g} cycles per minute"
    figure, axes = style.stacked(2, (7.2, 5.6), title)
    style.note(figure, _SHADE)
    _shape(axes, model, 1e6 * first_motion(response))
    axes[0].set_ylabel("ux, µm")
    axes[1].set(xlabel="z, mm", ylabel="uy, µm")
    style.legend_above(axes[0])
    return figure


@draws(rotor_modes=RotorModes)
def mode_shapes(rotor_modes: RotorModes) -> Figure:
    """The first modes at the first speed along z, x-plane and y-plane."""
    model = rotor_modes.model
    modes = rotor_modes.modes[0]
    real = np.flatnonzero(np.isfinite(np.asarray(modes.eigenvalue)))[:6]
    rows = max(1, -(-len(real) // 2))
    title = "Mode shapes without links" if rotor_modes.free else "Mode shapes"
    figure, axes = style.new_figure(rows, 2, (8.6, 1.4 + 1.9 * rows), title)
    for ax, i in zip(style.used(axes, len(real)), real, strict=True):
        shape = np.asarray(modes.shape)[i]
        plane = int(np.argmax(np.abs(shape[:, :2]).max(0)))
        _shape((ax,), model, shape[:, [plane]])
        hertz = float(modes.frequency[i]) / (2 * math.pi)
        damping = 100 * float(modes.damping_ratio[i])
        style.heading(ax, f"{i + 1}: {hertz:.4g} Hz, damping {damping:.3g} %, {'xy'[plane]}", 8.5)
        ax.set_yticks([0])
    style.note(figure, f"{_SHADE} Each mode in the plane of its largest motion, x or y.")
    style.legend_outside(axes[0, 0], "upper right", 5)
    for ax in axes[-1]:
        ax.set_xlabel("z, mm")
    return figure


@draws(rotor_motion=RotorMotion)
def response_orbits(rotor_motion: RotorMotion) -> Figure:
    """Orbits of the watched nodes at the first speed, order by order; a dot marks time zero."""
    nodes = dict(list(rotor_motion.motion.items())[:12])
    rows, columns = style.grid_of(len(nodes), 4)
    title = f"Orbits at {rotor_motion.speeds[0] * RPM:.5g} rpm, µm"
    figure, axes = style.new_figure(rows, columns, (2.2 * columns + 0.6, 2.3 * rows + 0.8), title)
    turn = np.linspace(0, 2 * np.pi, 181)
    for ax, (name, motion) in zip(style.used(axes, len(nodes)), nodes.items(), strict=True):
        for n, order in enumerate(rotor_motion.orders[:3]):
            x = _over_turn(motion[n, 0, 0], turn)
            y = _over_turn(motion[n, 0, 1], turn)
            ax.plot(x, y, color=style.tint(n), linewidth=1.4, label=f"order {order}")
            ax.plot(x[0], y[0], "o", color=style.tint(n), markersize=3.5)
        style.heading(ax, name, 8)
        ax.set_aspect("equal", adjustable="datalim")
        ax.tick_params(labelbottom=True)
    for ax in axes[:, 0]:
        ax.set_ylabel("y")
    for ax in axes[-1]:
        ax.set_xlabel("x")
    style.note(figure, "Dots: time zero of the phases.")
    style.legend_outside(axes[0, 0], "upper right", 5)
    return figure


def _over_turn(amplitude, turn: np.ndarray) -> np.ndarray:
    """[µm] Motion over the angles of a revolution, of a complex amplitude [m]."""
    return 1e6 * abs(amplitude) * np.cos(turn + np.angle(amplitude))


# Modes that a Campbell diagram has room for at least.
_SHOWN = 4


def _highest_shown(hertz: np.ndarray, spin: float) -> float:
    """[Hz] Upper end of a Campbell diagram: up to the second order, to some modes at least.

    Args:
        hertz: [Hz] (speeds, modes) frequencies of modes that a response could show, others not numbers.
        spin: [Hz] the highest speed.
    """
    present = hertz[:, np.isfinite(hertz).any(axis=0)]
    if not present.size:
        return 1.3 * 2 * spin
    highest = np.sort(np.where(np.isfinite(present), present, -np.inf).max(axis=0)).tolist()
    some = 1.15 * highest[:_SHOWN][-1]
    every = max(1.15 * highest[-1], 1.15 * spin)
    return min(max(1.3 * 2 * spin, some), every)


@draws(campbell=CampbellDiagram | DampedModes)
def campbell_diagram(
    campbell: CampbellDiagram | DampedModes, speeds: Sequence[float] = ()
) -> Figure:
    """Frequencies over the speed with their whirl, the line of the speed, and what it meets.

    Args:
        campbell: of `rotor_modes` over a range of speeds, or of `jaxcomp.rotor.campbell`, which has no
            critical speeds.
        speeds: [rad/s] of the modes, where they do not say them.

    Raises:
        BadInput: modes at one speed, or as many speeds as there are not.
    """
    if isinstance(campbell, DampedModes):
        if np.shape(campbell.whirl)[:-1] != np.shape(speeds) or np.ndim(speeds) != 1:
            raise BadInput("speeds", np.shape(speeds), "those that `campbell` was given")
        campbell = CampbellDiagram(np.asarray(speeds), campbell)
    rpm = np.array(campbell.speeds) * RPM
    modes = campbell.modes
    hertz, whirl, damping = map(np.array, (modes.frequency, modes.whirl, modes.damping_ratio))
    hertz = hertz / (2 * np.pi)
    strong = damping > _STRONG
    top = _highest_shown(np.where(strong, np.nan, hertz), rpm[-1] / 60)
    above = 0
    if np.isfinite(hertz).any():
        above = int(np.sum(np.nanmin(hertz, axis=0) > top))
    title = "Campbell diagram"
    if above:
        title += f"; {above} modes lie above"
    figure, ax = style.single((7.2, 4.8), title)
    grid = np.broadcast_to(rpm[:, None], hertz.shape)
    senses = (
        ("forward", whirl >= 0.05, "#0072B2", "o"),
        ("backward", whirl <= -0.05, "#D55E00", "s"),
        ("in a plane", np.abs(whirl) < 0.05, "#444444", "D"),
    )
    for label, where, paint, marker in senses:
        for weak, alpha in ((where & ~strong, 1.0), (where & strong, 0.25)):
            entry = label if alpha == 1 and weak.any() else None
            look = {"color": paint, "markersize": 2.6, "alpha": alpha, "label": entry}
            ax.plot(grid[weak], hertz[weak], marker, **look)
    ax.plot(rpm, np.where(strong, np.nan, hertz), color="#BBBBBB", linewidth=0.8, zorder=1)
    for order, dash in ((1, "--"), (2, ":")):
        ax.plot(rpm, order * rpm / 60, dash, color=style.INK, linewidth=1, label=f"{order}x speed")
    peaks = _peaks(campbell)
    if peaks.size:
        ax.plot(peaks, peaks / 60, "o", color=style.INK, fillstyle="none", markersize=9,
                label="critical speed")  # fmt: skip
    ax.set(xlabel="Speed, rpm", ylabel="Natural frequency, Hz (pale: damping above 70 %)")
    ax.set_ylim(0, top)
    style.legend_above(ax)
    return figure


def _peaks(campbell: CampbellDiagram) -> np.ndarray:
    """[rpm] Critical speeds at which a response has a peak."""
    peaks = []
    for critical in campbell.critical_speeds:
        if critical.damping_ratio <= _STRONG:
            peaks.append(critical.speed * RPM)
    return np.array(peaks)


def _draw_shafts(ax, model, places) -> float:
    """Elements and disks; returns the largest radius, mm."""
    height = 1.0
    outline = []
    for shaft in model.shafts:
        outer = np.asarray(shaft.outer_diameter)
        if shaft.outer_diameter_end is not None:  # a cone as the cylinder around it
            outer = np.maximum(outer, shaft.outer_diameter_end)
        inner = shaft.inner_diameter
        if inner is None:
            inner = np.zeros_like(outer)
        for (a, b), do, di, rho in zip(shaft.pairs, outer, inner, shaft.density, strict=True):
            z = sorted((places[a][2], places[b][2]))
            outline.append((float(do) * 1e3, float(di) * 1e3, z[0] * 1e3, z[1] * 1e3, float(rho)))
            height = max(height, float(do) * 500)
    # the widest first, so that narrow elements inside them stay visible
    for do, di, z0, z1, rho in sorted(outline, reverse=True):
        for low in (di / 2, -do / 2):
            ax.add_patch(Rectangle((z0, low), z1 - z0, (do - di) / 2, **_SOLID[bool(rho)]))
    for disks in model.disks:
        largest = max(float(np.max(disks.mass)), 1e-12)
        for node, mass in zip(disks.nodes, np.asarray(disks.mass), strict=True):
            z = places[node][2] * 1e3
            half = height * (0.5 + 0.5 * float(mass) / largest)
            ax.plot([z, z], [-half, half], **_DISK, zorder=3)
    z = _along(places, places)
    room = z.max() - z.min() + 1
    ax.set_xlim(z.min() - 0.12 * room, z.max() + 0.25 * room)
    return height


def first_motion(response: Response) -> np.ndarray:
    """(nodes, dof) at the first order and speed."""
    x = np.asarray(response.displacement)
    return x.reshape(-1, *x.shape[-2:])[0]


def _shape(axes: Sequence, model: RotorModel, x: np.ndarray) -> None:
    """Real part of x (nodes, planes) at the phase of the largest, each subset along z."""
    places = node_positions(model)
    names = list(node_names(model))
    # a mode has any phase: at this one its largest motion is real, and so drawn in full
    largest = x[:, : len(axes)].reshape(-1)
    turn = np.exp(-1j * np.angle(largest[np.argmax(np.abs(largest))]))
    groups = zip(subset_names(model), subsets(model), strict=True)
    for number, (label, group) in enumerate(groups):
        line = sorted(group, key=lambda node: places[node][2])
        at = np.array([names.index(node) for node in line])
        z = _along(places, line)
        for plane, ax in enumerate(axes):
            ax.plot(z, (x[at, plane] * turn).real, "o-", color=style.tint(number), markersize=2.4,
                    linewidth=1.5, label=label)  # fmt: skip
            size = np.abs(x[at, plane])
            ax.fill_between(z, -size, size, color=style.tint(number), alpha=0.08, linewidth=0)
            style.zero_line(ax)
