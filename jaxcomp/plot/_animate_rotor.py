"""Rotor, crankcase and housing as they vibrate, before and after balancing.

The plane of x and z: shafts as lines through their nodes, rigid bodies as boxes around theirs, both
moved by their displacement along x times a factor that the picture names; the rest position stays in
grey. Only what follows the speed once a revolution is shown, which is what correction masses act on.
"""

import math
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from .._shown import RPM
from ..rotor import Response, RotorModel, node_names, node_positions, subset_names, subsets
from ._motion import Motion
from ._style import INK, new_figure

_LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
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
    moved = [_first(response)[:, 0] for response in (before, after)]
    places = node_positions(model)
    at = 1e3 * np.array([places[node] for node in node_names(model)])  # mm
    largest = [1e3 * np.abs(motion).max() for motion in moved]  # mm
    factor = _round(_SHARE * np.ptp(at[:, 2]) / max(largest[0], 1e-9))
    rpm = float(np.asarray(before.frequency).reshape(-1)[0]) * RPM
    title = f"Vibration along x at {rpm:.5g} rpm, {factor:,.0f} times exaggerated"
    figure, axes = new_figure(1, 2, (8.4, 4.6), title)
    pictures = []
    pictures = []
    for ax, motion, size, word in zip(axes[0], moved, largest, ("Before", "After"), strict=True):
        text = f"{word}: at most {1e3 * size:.3g} µm"
        ax.set_title(text, fontsize=9.5, loc="left", color=INK)
        outlines = _outlines(model, at, motion)
        pictures.append([(_line(ax, one), one) for one in outlines])
        _limits(ax, outlines)
    handles, words = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, words, frameon=False, fontsize=8.5, loc="outside lower center", ncols=4)

    def show(frame: int) -> None:
        turned = np.exp(2j * np.pi * frame / frames)
        for lines in pictures:
            for line, one in lines:
                moved_to = one.x + 1e3 * factor * (one.motion * turned).real
                line.set_data(moved_to, one.z)

    show(0)
    return Motion(figure, show, frames)


class Outline(NamedTuple):
    """A line that moves: of a shaft or around a body.

    Attributes:
        name: of its subset.
        number: of its subset.
        x, z: [mm] at rest.
        motion: [m] complex amplitude along x.
    """

    name: str
    number: int
    x: np.ndarray
    z: np.ndarray
    motion: np.ndarray


def _first(response: Response) -> np.ndarray:
    """(nodes, dof) at the first order and speed."""
    x = np.asarray(response.displacement)
    return x.reshape(-1, *x.shape[-2:])[0]


def _outlines(model: RotorModel, at: np.ndarray, motion: np.ndarray) -> list[Outline]:
    """Boxes around the bodies, the longest one around the others, and the shafts in front."""
    names = list(node_names(model))
    on_shafts = {node for shaft in model.shafts for pair in shaft.pairs for node in pair}
    groups = list(enumerate(zip(subset_names(model), subsets(model), strict=True)))
    boxes, shafts = [], []
    for number, (word, group) in groups:
        for body in model.bodies:
            if body.centre in group:
                members = [names.index(node) for node in (body.centre, *body.nodes)]
                boxes.append((number, word, members))
        line = sorted((names.index(n) for n in group if n in on_shafts), key=lambda i: at[i, 2])
        if line:
            shafts.append(Outline(word, number, at[line, 0], at[line, 2], motion[line]))
    boxes.sort(key=lambda box: np.ptp(at[box[2], 2]))
    height = np.ptp(at[:, 2])
    out, left, right = [], 0.0, 0.0
    for number, word, members in boxes:
        left = min(left - 0.08 * height, at[members, 0].min())
        right = max(right + 0.08 * height, at[members, 0].max())
        out.append(_box(number, word, at[members], motion[members], (left, right)))
    return [*out[::-1], *shafts]


def _box(number: int, word: str, at: np.ndarray, motion: np.ndarray, sides) -> Outline:
    """A box over the length of a rigid body between two sides [mm]."""
    (left, right), low, high = sides, at[:, 2].min(), at[:, 2].max()
    x = np.array([left, right, right, left, left])
    z = np.array([low, low, high, high, low])
    # of a rigid body u_x is linear in y and z, so that its nodes tell the motion of the corners
    terms = np.stack([np.ones(len(at)), at[:, 1], at[:, 2]], axis=1)
    fit = np.linalg.lstsq(terms, motion, rcond=None)[0]
    return Outline(word, number, x, z, fit[0] + fit[2] * z)


def _line(ax: Axes, one: Outline):
    """The line that moves, with its shadow at rest behind it."""
    ax.plot(one.x, one.z, "-", color="#CCCCCC", linewidth=1.2, zorder=1)
    tint = _LINES[one.number % len(_LINES)]
    (line,) = ax.plot([], [], "-", color=tint, linewidth=2.2, label=one.name)
    return line


def _limits(ax: Axes, outlines: list[Outline]) -> None:
    x, z = (np.concatenate([getattr(one, key) for one in outlines]) for key in "xz")
    room = 1.2 * _SHARE * np.ptp(z)
    ax.set_xlim(x.min() - room, x.max() + room)
    ax.set_ylim(z.max() + room / 2, z.min() - room / 2)  # z runs downwards
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x, mm", fontsize=9)
    ax.set_ylabel("z, mm", fontsize=9)


def _round(value: float) -> float:
    """A factor of one digit, not above the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(1.0, math.floor(value / power) * power)
