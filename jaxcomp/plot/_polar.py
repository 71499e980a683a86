"""Polar diagrams: how the loads of the bearings turn and grow while the crank turns."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..compressor import Compressor
from ..crank import Orbit
from ..friction import joints_of_cylinder
from ..mechanism import SliderLink
from ._fine import fine_turn
from ._style import INK, colour, crank_marks, new_polar_figure, note, words

# Every 45 degrees; the others have the grid alone.
_DIRECTIONS = ("to the\nhead", "", "across", "", "from the\nhead", "", "", "")
_OF_MACHINE = ("x", "", "y", "", "-x", "", "-y", "")


def bearing_loads(compressor: Compressor, orbit: Orbit) -> Figure:
    """Force of the shaft on every bush, by size and direction.

    Directions are those of the machine at rest: 0 towards the head, growing in the sense of
    rotation. Marks stand every 45 degrees of crank angle. A slider-link machine has the two bearings
    of its overhung shaft and their sum, the load of the support; a slider-crank its main journal, or
    with several cylinders every crank pin, in the axes of its cylinder, and every main bearing.
    """
    turn = fine_turn(compressor, orbit)
    loads = _loads(compressor, {k: np.asarray(v) for k, v in turn.loads.forces.items()})
    largest = max(np.hypot(*load).max() for load in loads.values())
    unit, scale = ("kN", 1e3) if largest >= 1e3 else ("N", 1.0)
    figure, axes = new_polar_figure(-(-len(loads) // 2), 2, f"Bearing loads, {unit}")
    for ax in axes.flat[len(loads) :]:
        ax.set_visible(False)
    several = compressor.cylinders is not None
    pins = {name for name in loads if name.startswith("crank_pin")}
    what = "x and y of the machine for its bearings. " if several else ""
    note(figure, f"Dots: every 45° of crank angle from top dead centre. {what}Across: turned with the "
         "rotation from the head.")  # fmt: skip
    degrees = np.rad2deg(np.asarray(turn.state.angle))
    for place, (ax, (name, load)) in enumerate(zip(axes.flat, loads.items(), strict=False)):
        size, tint = np.hypot(*load) / scale, colour(name, place)
        # without jumps of a whole turn, which would draw as circles
        direction = np.unwrap(np.arctan2(load[1], load[0]))
        ax.plot(direction, size, color=tint, linewidth=1.5)
        crank_marks(ax, degrees, direction, size, tint)
        ax.set_ylim(0, 1.08 * max(size.max(), 1e-12))
        ax.yaxis.set_major_locator(MaxNLocator(4))
        ax.set_rlabel_position(67.5)  # away from the loads, which lie along the cylinder
        of_machine = several and name not in pins
        names = _OF_MACHINE if of_machine else _DIRECTIONS
        ax.set_xticks(np.linspace(0, 2 * np.pi, 8, endpoint=False), names)
        ax.set_title(words(name), fontsize=9.5, loc="left", color=INK)
    return figure


def _loads(compressor, forces):
    """Loads on the bushes; the joints report the forces of the bearings on the shaft instead."""
    if compressor.cylinders is not None:
        own = [joints_of_cylinder(k + 1) for k in range(compressor.cylinders.count)]
        pins = {joints["crank_pin"]: forces[joints["crank_pin"]] for joints in own}
        within = {name for joints in own for name in joints.values()}
        return pins | {name: -force for name, force in forces.items() if name not in within}
    if isinstance(compressor.mechanism, SliderLink):
        upper, lower = -forces["upper_bearing"], -forces["lower_bearing"]
        ends = {"upper_bearing": upper, "lower_bearing": lower, "support": upper + lower}
        return {"crank_pin": forces["crank_pin"], **ends}
    signs = {"crank_pin": 1.0, "main_journal": -1.0}
    # a mechanism of another package may have other joints
    return {name: sign * forces[name] for name, sign in signs.items() if name in forces} or forces
