"""A rotor with its crankcase and housing in motion, before and after balancing.

The motion is that in the plane of x and z: shafts as lines through their nodes, rigid bodies as boxes
around theirs, both moved by their displacement along x times a factor that the picture names; the rest
position stays in grey. Only what follows the speed once a revolution is shown, which is what correction
masses act on.
"""

import math
from typing import NamedTuple

import numpy as np

from .._core.display import RPM
from ..rotor import Response, RotorModel
from ..rotor._model import node_positions, subset_names, subsets
from ..rotor._nodes import node_names
from . import _style as style
from ._animate import Motion
from ._rotor import first_motion, shaft_nodes

# Share of the machine's height that the largest motion before balancing takes in the picture.
_SHARE = 0.15


def balance_motion(
    model: RotorModel, before: Response, after: Response, frames: int = 36
) -> Motion:
    """One turn before and after balancing, with the same factor of exaggeration.

    Args:
        model: rotor, crankcase and housing.
        before, after: responses of all nodes at order 1; their first speed is shown.
        frames: pictures of the revolution.
    """
    moved = [first_motion(response)[:, 0] for response in (before, after)]
    places = node_positions(model)
    at = 1e3 * np.array([places[node] for node in node_names(model)])  # mm
    largest = [1e3 * np.abs(motion).max() for motion in moved]  # mm
    # of one digit
    factor = _SHARE * np.ptp(at[:, 2]) / max(largest[0], 1e-9)
    power = 10.0 ** math.floor(math.log10(factor))
    factor = max(1.0, math.floor(factor / power) * power)
    rpm = float(np.asarray(before.frequency).reshape(-1)[0]) * RPM
    title = f"Vibration along x at {rpm:.5g} rpm, {factor:,.0f} times exaggerated"
    figure, axes = style.new_figure(1, 2, (8.4, 4.6), title)
    lines = []
    for ax, motion, size, word in zip(axes[0], moved, largest, ("Before", "After"), strict=True):
        style.heading(ax, f"{word}: at most {1e3 * size:.3g} µm")
        outlines = _outlines(model, at, motion)
        for outline in outlines:
            ax.plot(outline.x, outline.z, "-", color="#CCCCCC", linewidth=1.2, zorder=1)
            look = {
                "color": style.tint(outline.number),
                "label": subset_names(model)[outline.number],
            }
            lines.append((ax.plot([], [], "-", linewidth=2.2, **look)[0], outline))
        x = np.concatenate([outline.x for outline in outlines])
        z = np.concatenate([outline.z for outline in outlines])
        room = 1.2 * _SHARE * np.ptp(z)
        ax.set(xlim=(x.min() - room, x.max() + room), xlabel="x, mm", ylabel="z, mm")
        ax.set_ylim(z.max() + room / 2, z.min() - room / 2)  # z runs downwards
        ax.set_aspect("equal", adjustable="box")
    style.legend_outside(axes[0, 0], "lower center", 4)

    def show(frame: int) -> None:
        turned = np.exp(2j * np.pi * frame / frames)
        for line, outline in lines:
            line.set_data(outline.x + 1e3 * factor * (outline.motion * turned).real, outline.z)

    show(0)
    return Motion(figure, show, frames)


class Outline(NamedTuple):
    """A line that moves: of a shaft or around a body.

    Attributes:
        number: of its subset.
        x, z: [mm] at rest.
        motion: [m] complex amplitude along x.
    """

    number: int
    x: np.ndarray
    z: np.ndarray
    motion: np.ndarray


def _outlines(model: RotorModel, at: np.ndarray, motion: np.ndarray) -> list[Outline]:
    """Boxes around the bodies, the longest one around the others, and the shafts in front."""
    names = list(node_names(model))
    on_shafts = set(shaft_nodes(model))
    boxes = []
    shafts = []
    for number, group in enumerate(subsets(model)):
        for body in model.bodies:
            if body.centre in group:
                members = [names.index(node) for node in (body.centre, *body.nodes)]
                boxes.append((number, members))
        line = []
        for node in group:
            if node in on_shafts:
                line.append(names.index(node))
        if line:
            line.sort(key=lambda i: at[i, 2])
            shafts.append(Outline(number, at[line, 0], at[line, 2], motion[line]))
    boxes.sort(key=lambda box: np.ptp(at[box[1], 2]))
    step = 0.08 * np.ptp(at[:, 2])
    x_low = 0.0
    x_high = 0.0
    for number, members in boxes:
        x, y, z = at[members].T
        x_low = min(x_low - step, x.min())
        x_high = max(x_high + step, x.max())
        # of a rigid body u_x is linear in y and z, so that its nodes tell the motion of the corners
        terms = np.stack([np.ones(len(members)), y, z], axis=1)
        fit = np.linalg.lstsq(terms, motion[members], rcond=None)[0]
        z = np.array([z.min(), z.min(), z.max(), z.max(), z.min()])
        x = np.array([x_low, x_high, x_high, x_low, x_low])
        shafts.insert(0, Outline(number, x, z, fit[0] + fit[2] * z))
    return shafts
