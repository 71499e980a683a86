"""Dimensioned sketches of the mechanisms: `python notebooks/sketches.py` writes the SVG files."""

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Circle, Polygon

HERE = Path(__file__).parent
INK, PALE, MARK = "#37474f", "#b0bec5", "#c2185b"
mpl.use("svg")
mpl.rcParams |= {"svg.hashsalt": "sketches", "font.size": 12, "mathtext.fontset": "stix"}


def axes_of(width, height, *ratios):
    """Axes beside each other, in which a unit is the same along x and y."""
    figure, axes = plt.subplots(
        1, len(ratios), figsize=(width, height), width_ratios=ratios, squeeze=False, layout="tight"
    )
    for ax in axes.flat:
        ax.set_aspect("equal")
        ax.axis("off")
    return figure, axes[0]


def line(ax, *points, **options):
    ax.plot(*zip(*points, strict=True), **({"color": INK, "lw": 1.6} | options))


def thin(ax, *points):
    line(ax, *points, lw=0.7, ls=(0, (8, 3, 1, 3)))


def box(ax, x, y, width, height, angle=0.0, about=(0.0, 0.0), fill="white"):
    """A box from its lower left corner, turned about a point."""
    corners = np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)]) - about
    c, s = np.cos(angle), np.sin(angle)
    turned = corners @ np.array([[c, s], [-s, c]]) + about
    ax.add_patch(Polygon(turned, closed=True, facecolor=fill, edgecolor=INK, lw=1.4))


def pin(ax, at, size=0.09, fill="white"):
    ax.add_patch(Circle(at, size, facecolor=fill, edgecolor=INK, lw=1.4, zorder=3))


def arrow(ax, start, end, style="<->", colour=MARK):
    ax.plot(*zip(start, end, strict=True), alpha=0)  # arrows alone do not widen the picture
    ax.annotate(
        "",
        end,
        start,
        arrowprops={"arrowstyle": style, "color": colour, "shrinkA": 0, "shrinkB": 0},
    )


def text(ax, at, words, colour=MARK, **options):
    ax.text(*at, words, color=colour, **({"ha": "center", "va": "center"} | options))


def dimension(ax, start, end, words, label=(0.0, 0.0), feet=()):
    """An arrow between two points with its symbol in the middle; thin lines from the feet to it."""
    for foot, tip in zip(feet, (start, end), strict=False):
        line(ax, foot, tip, color=MARK, lw=0.5)
    arrow(ax, start, end)
    middle = (np.array(start) + end) / 2 + label
    ax.text(
        *middle, words, color=MARK, ha="center", va="center",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
    )  # fmt: skip


def angle_mark(ax, centre, size, start, end, words, at=None):
    """An arc with an arrow head, angles in degrees."""
    ax.add_patch(Arc(centre, 2 * size, 2 * size, theta1=start, theta2=end, color=MARK, lw=1.0))
    tip, before = np.deg2rad([end, end - 4])
    point = lambda a: (centre[0] + size * np.cos(a), centre[1] + size * np.sin(a))  # noqa: E731
    arrow(ax, point(before), point(tip), "->")
    middle = np.deg2rad((start + end) / 2 if at is None else at)
    text(
        ax,
        (centre[0] + 1.25 * size * np.cos(middle), centre[1] + 1.25 * size * np.sin(middle)),
        words,
    )


def frame(ax, length, across=None):
    arrow(ax, (0, 0), (length, 0), "->", INK)
    arrow(ax, (0, 0), (0, across or length), "->", INK)
    text(ax, (length + 0.12, 0), "$x$", INK)
    text(ax, (0, (across or length) + 0.14), "$y$", INK)


def slider_crank():
    figure, (ax,) = axes_of(8.0, 3.6, 1)
    r, l, e, b, bore, theta = 1.0, 3.2, 0.3, 1.0, 1.3, np.deg2rad(58)
    crank = np.array([r * np.cos(theta), r * np.sin(theta)])
    phi = np.arcsin((crank[1] - e) / l)
    piston = np.array([crank[0] + l * np.cos(phi), e])
    ax.add_patch(Circle((0, 0), r, fill=False, ls="--", color=PALE))
    frame(ax, 1.55)
    thin(ax, (-1.2, e), (6.1, e))
    for side in (-1, 1):
        line(ax, (2.7, e + side * bore / 2), (5.6, e + side * bore / 2), lw=3, color=PALE)
    line(ax, (5.6, e - bore / 2), (5.6, e + bore / 2), lw=3, color=PALE)
    box(ax, piston[0] - 0.45, e - bore / 2 + 0.03, 1.0, bore - 0.06)
    line(ax, (0, 0), crank, lw=5)
    line(ax, crank, piston, lw=3)
    for at in ((0, 0), crank, piston):
        pin(ax, at)
    centre = crank + b / l * (piston - crank)
    ax.plot(*centre, "o", color=INK, ms=5, zorder=4)
    across = 0.34 * np.array([np.sin(phi), np.cos(phi)])
    dimension(ax, crank + across, piston + across, "$l$", feet=(crank, piston))
    dimension(ax, crank - across * 0.8, centre - across * 0.8, "$b$", feet=(crank, centre))
    side = 0.22 * np.array([-np.sin(theta), np.cos(theta)])
    dimension(ax, side, crank + side, "$r$")
    angle_mark(ax, (0, 0), 0.55, 0, np.rad2deg(theta), r"$\theta$")
    angle_mark(ax, piston, 1.15, 180 - np.rad2deg(phi), 180, r"$\phi$", 176)
    dimension(ax, (-0.75, 0), (-0.75, e), "$e$", (-0.2, 0))
    line(ax, (-1.0, 0), (0, 0), color=MARK, lw=0.5)
    dimension(ax, (0, -1.25), (piston[0], -1.25), "$x_p$", feet=((0, 0), piston))
    dimension(ax, (5.95, e - bore / 2), (5.95, e + bore / 2), "$D$")
    text(ax, (-0.35, -0.3), "$O$", INK)
    angle_mark(ax, (0, 0), 1.25, 100, 160, r"$\omega$")
    return figure


def slider_link():
    figure, (ax, side) = axes_of(10.0, 4.2, 5.2, 3.2)
    r, bore, e, size, length = 1.0, 1.3, 0.25, 0.5, 2.6
    angle, crown = np.deg2rad(58), 2.4
    crank = np.array([r * np.cos(angle), r * np.sin(angle)])
    face, top = crown + crank[0], crown + r
    ax.add_patch(Circle((0, 0), r, fill=False, ls="--", color=PALE))
    frame(ax, 1.5, 1.75)
    thin(ax, (-1.1, -e), (4.2, -e))
    for way in (-1, 1):
        line(ax, (top - length, -e + way * bore / 2), (top, -e + way * bore / 2), lw=3, color=PALE)
    line(ax, (top, -e - bore / 2), (top, -e + bore / 2), lw=3, color=PALE)
    box(ax, crank[0] - 0.33, -1.55, 0.66, 3.1)
    box(ax, crank[0] + 0.33, -e - bore / 2 + 0.03, face - crank[0] - 0.33, bore - 0.06)
    box(ax, crank[0] - size / 2, crank[1] - size / 2, size, size, fill="#eceff1")
    line(ax, (0, 0), crank, lw=5)
    pin(ax, (0, 0))
    pin(ax, crank)
    across = 0.22 * np.array([-np.sin(angle), np.cos(angle)])
    dimension(ax, across, crank + across, "$R$")
    angle_mark(ax, (0, 0), 0.5, 0, np.rad2deg(angle), r"$\varphi$")
    dimension(ax, (-0.75, 0), (-0.75, -e), "$e$", (-0.2, 0))
    line(ax, (-1.0, 0), (0, 0), color=MARK, lw=0.5)
    low = -2.0
    dimension(ax, (crank[0], low), (face, low), "$L_p$", feet=((crank[0], -1.4), (face, -0.9)))
    dimension(ax, (top - length, low + 0.5), (top, low + 0.5), "$L_c$",
              feet=((top - length, -0.9), (top, -0.9)))  # fmt: skip
    dimension(ax, (crank[0] + 0.55, crank[1] - size / 2), (crank[0] + 0.55, crank[1] + size / 2),
              "$D_s$", (0.28, 0))  # fmt: skip
    dimension(ax, (3.75, -e - bore / 2), (3.75, -e + bore / 2), "$D$")
    angle_mark(ax, (0, 0), 1.2, 105, 160, r"$\omega$")

    line(side, (0, 1.9), (0, -2.4), lw=9, color=PALE)  # the shaft, z downwards
    box(side, -0.35, -0.35, 0.7, 0.7)
    line(side, (0.35, 1.55), (0.35, 2.0), lw=5)
    line(side, (-0.35, 1.55), (0.45, 1.55), lw=5)
    thin(side, (-0.7, 1.9), (2.2, 1.9))
    thin(side, (-0.7, 0.9), (2.2, 0.9))
    box(side, -0.35, -2.2, 0.7, 0.7)
    arrow(side, (-1.0, 0.9), (-1.0, -2.4), "->", INK)
    text(side, (-1.0, -2.6), "$z$", INK)
    dimension(side, (1.0, 1.9), (1.0, 0.0), "$z_p$", feet=((0.4, 1.9), (0.3, 0.0)))
    dimension(side, (1.0, 0.0), (1.0, -1.85), "$z_b$", feet=((0.3, 0.0), (0.3, -1.85)))
    dimension(side, (1.8, 1.9), (1.8, 0.9), "$z_s$")
    for at, words in ((1.9, "piston plane"), (0.9, "mass centre of the machine")):
        text(side, (2.3, at), words, INK, ha="left", fontsize=10)
    for at, words in ((0.0, "upper bearing"), (-1.85, "lower bearing")):
        text(side, (1.4, at), words, INK, ha="left", fontsize=10)
    side.set_xlim(-1.3, 5.2)
    return figure


def cylinders():
    figure, (ax, side) = axes_of(10.0, 4.2, 4.4, 4.2)
    frame(ax, 1.75)
    r, l, bank, theta, throw = 0.8, 2.3, 45.0, 20.0, 180.0
    ax.add_patch(Circle((0, 0), r, fill=False, ls="--", color=PALE))
    crank = r * np.array([np.cos(np.deg2rad(theta)), np.sin(np.deg2rad(theta))])
    for sign in (-1, 1):
        along = np.deg2rad(sign * bank)
        axis = np.array([np.cos(along), np.sin(along)])
        across = np.array([-axis[1], axis[0]])
        rest = np.sqrt(l**2 - (crank @ across) ** 2)
        place = (crank @ axis + rest) * axis
        thin(ax, (0, 0), 4.1 * axis)
        for way in (-0.45, 0.45):
            line(ax, 2.2 * axis + way * across, 3.9 * axis + way * across, lw=3, color=PALE)
        box(ax, place[0] - 0.3, place[1] - 0.42, 0.6, 0.84, along, place)
        line(ax, crank, place, lw=2.5)
        pin(ax, place, 0.07)
    line(ax, (0, 0), crank, lw=5)
    line(ax, (0, 0), -crank, lw=5, color=PALE)
    pin(ax, (0, 0))
    pin(ax, crank)
    pin(ax, -crank)
    angle_mark(ax, (0, 0), 1.95, 0, bank, "$b_2$", 32)
    ax.add_patch(Arc((0, 0), 3.9, 3.9, theta1=-bank, theta2=0, color=MARK, lw=1.0))
    text(ax, (2.45, -0.6), "$b_1 < 0$")
    angle_mark(ax, (0, 0), 1.15, 0, theta, r"$\theta$", 9)
    angle_mark(ax, (0, 0), 1.15, theta, theta + throw, "$t$", 120)
    text(ax, (0.3, -1.05), "throw 1", INK, fontsize=10)
    text(ax, (-0.95, -0.62), "throw 2", INK, fontsize=10)

    arrow(side, (-0.3, 0), (5.6, 0), "->", INK)
    text(side, (5.75, 0), "$z$", INK)
    line(side, (0.2, 0), (0.9, 0), (0.9, 0.8), (2.1, 0.8), (2.1, 0), (3.1, 0), (3.1, -0.8),
         (4.3, -0.8), (4.3, 0), (5.1, 0), lw=6, color=PALE)  # fmt: skip
    for z, level in ((1.2, 0.8), (1.8, 0.8), (3.4, -0.8), (4.0, -0.8)):
        line(side, (z, level), (z, 2.0), lw=2)
    for z in (0.35, 4.95):
        box(side, z - 0.15, -0.3, 0.3, 0.15)
        box(side, z - 0.15, 0.15, 0.3, 0.15)
    for number, z in enumerate((1.2, 1.8, 3.4, 4.0), 1):
        text(side, (z, 2.2), str(number), INK, fontsize=10)
    dimension(side, (1.2, 1.5), (1.8, 1.5), "", (0, 0))
    text(side, (0.75, 1.5), "rod_pitch", fontsize=10, ha="right")
    dimension(side, (1.5, -1.5), (3.7, -1.5), "throw_pitch", feet=((1.5, 0.8), (3.7, -0.8)))
    dimension(
        side, (2.6, -0.45), (4.95, -0.45), "position", (0.65, 0.0), feet=((2.6, 0.2), (4.95, 0))
    )
    text(side, (2.6, 0.42), "$z=0$", INK, fontsize=10)
    return figure


if __name__ == "__main__":
    for draw in (slider_crank, slider_link, cylinders):
        draw().savefig(HERE / f"{draw.__name__}.svg", metadata={"Date": None})
