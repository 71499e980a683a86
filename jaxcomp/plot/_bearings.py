"""Pictures of the bearings: their loads, journals in their clearances, and one film by itself."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from .._core.display import RPM, shown
from .._core.errors import BadInput
from ..compressor import Compressor
from ..crank import JournalFilm, LoadedJournal, Orbit, journal_films
from ..crankshaft._bearings import bearing_names
from ..film import AbstractSolvedFilm, SteadyBearing, StribeckCurve
from ..film._film import coefficients_per_load, film_ratio
from ..mechanism import SliderLink
from . import _style as style
from ._drawing import draws
from ._fine import fine_turn

# Every 45 degrees; the others have the grid alone.
_DIRECTIONS = ("to the\nhead", "", "across", "", "from the\nhead", "", "", "")
_OF_MACHINE = ("x", "", "y", "", "-x", "", "-y", "")
_ENTRIES = {"xx": "#0072B2", "xy": "#D55E00", "yx": "#009E73", "yy": "#56437F"}


@draws(orbit=Orbit)
def bearing_loads(compressor: Compressor, orbit: Orbit) -> Figure:
    """Force of the shaft on every bush, by size and direction.

    Directions are those of the machine at rest: 0 towards the head, growing in the sense of
    rotation. Marks stand every 45 degrees of crank angle. A slider-link machine has the two bearings
    of its overhung shaft and their sum, the load of the support; a slider-crank its main journal, or
    with several cylinders every crank pin, in the axes of its cylinder, and every main bearing.
    """
    turn = fine_turn(compressor, orbit)
    forces = {name: np.asarray(force) for name, force in turn.loads.forces.items()}
    loads = _loads(compressor, forces)
    look = shown("load", "N", np.hypot(*np.stack(list(loads.values()), axis=1)))
    figure, axes = style.new_polar_figure(-(-len(loads) // 2), 2, f"Bearing loads, {look.unit}")
    several = compressor.crankshaft.count > 1
    remarks = ["Dots: every 45° of crank angle from top dead centre."]
    if several:
        remarks.append("x and y of the machine for its bearings.")
    remarks.append("Across: turned with the rotation from the head.")
    style.note(figure, " ".join(remarks))
    degrees = np.rad2deg(np.asarray(turn.state.angle))
    drawn = zip(style.used(axes, len(loads)), loads.items(), strict=True)
    for place, (ax, (name, load)) in enumerate(drawn):
        size = look.factor * np.hypot(*load)
        tint = style.colour(name, place)
        # without jumps of a whole turn, which would draw as circles
        direction = np.unwrap(np.arctan2(load[1], load[0]))
        ax.plot(direction, size, color=tint, linewidth=1.5)
        style.crank_marks(ax, degrees, direction, size, tint)
        ax.set_ylim(0, 1.08 * max(size.max(), 1e-12))
        ax.yaxis.set_major_locator(MaxNLocator(4))
        ax.set_rlabel_position(67.5)  # away from the loads, which lie along the cylinder
        of_machine = several and not name.startswith("crank_pin")
        names = _OF_MACHINE if of_machine else _DIRECTIONS
        ax.set_xticks(np.linspace(0, 2 * np.pi, 8, endpoint=False), names)
        style.heading(ax, style.words(name))
    return figure


def _loads(compressor, forces):
    """Loads on the bushes; the joints report the forces of the bearings on the shaft instead."""
    shaft = compressor.crankshaft
    # in their own order: what a compiled program returns is sorted by name
    on_pins = {}
    for k in range(shaft.count):
        pin = shaft.joint("crank_pin", k + 1)
        if pin in forces:
            on_pins[pin] = forces[pin]
    on_shaft = {name: -forces[name] for name in bearing_names(shaft)}
    if isinstance(compressor.mechanism, SliderLink) and len(on_shaft) > 1:
        on_shaft["support"] = sum(on_shaft.values())
    return on_pins | on_shaft


# ---------------------------------------------------------------- journals over a revolution


@draws(orbit=Orbit)
def journal_paths(compressor: Compressor, orbit: Orbit) -> Figure:
    """Path of every journal in its clearance circle, with the load on it as arrows.

    Args:
        compressor: with a journal that has an oil film.
        orbit: its periodic state.

    Raises:
        ValueError: no journal has an oil film.
    """
    films = _films(compressor, orbit)
    rows, columns = style.grid_of(len(films), 3)
    size = (4.0 * columns, 4.1 * rows)
    figure, axes = style.new_figure(rows, columns, size, "Journals in their clearances", False)
    style.note(figure, "Dots: every 45° of crank angle. Arrows: load on the journal.")
    degrees = np.rad2deg(np.asarray(orbit.state.angle))
    drawn = zip(style.used(axes, len(films)), films.items(), strict=True)
    for place, (ax, (name, film)) in enumerate(drawn):
        tint = style.colour(name, place)
        path, load = in_clearance(ax, film, color=tint, linewidth=1.6)
        style.crank_marks(ax, degrees, *path, tint)
        for mark in range(0, 360, 45):
            at = style.nearest_angle(degrees, mark)
            ax.annotate("", path[:, at] + load[:, at], path[:, at],
                        arrowprops={"arrowstyle": "->", "color": "#888888"})  # fmt: skip
        how = "orbit" if film.moving else "steady load at every instant"
        style.heading(ax, f"{style.words(name)}, {how}")
    return figure


def _films(compressor: Compressor, orbit: Orbit) -> dict[str, JournalFilm]:
    films = journal_films(compressor, orbit)
    if not films:
        raise ValueError("A picture of journals in their films needs a journal with an oil film.")
    return films


def in_clearance(ax: Axes, film: JournalFilm, **look: Any) -> tuple[np.ndarray, np.ndarray]:
    """Draw the path of a journal in its clearance circle; path and load as they are drawn, (2, n)."""
    path = np.asarray(film.position)
    load = np.asarray(film.load)
    around = np.linspace(0, 2 * np.pi, 181)
    ax.plot(np.cos(around), np.sin(around), color=style.INK, linewidth=1.0)
    ax.plot(*np.append(path, path[:, :1], axis=1), **look)
    ax.set_aspect("equal")
    ax.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15))
    return path, 0.4 * load / max(np.hypot(*load).max(), 1e-300)


@draws(orbit=Orbit)
def journal_films_over_turn(compressor: Compressor, orbit: Orbit) -> Figure:
    """Smallest film thickness and largest pressure of every journal over the crank angle.

    Args:
        compressor: with a journal that has an oil film.
        orbit: its periodic state.

    Raises:
        ValueError: no journal has an oil film.
    """
    films = _films(compressor, orbit)
    figure, (above, below) = style.stacked(2, (7.2, 5.6), "Films of the journals")
    angle = orbit.state.angle
    thickness = {name: 1e6 * film.thickness for name, film in films.items()}
    pressure = {name: film.pressure / 1e6 for name, film in films.items()}
    style.turn_curves(above, angle, thickness, "Smallest film, µm", zero=False, angle_label=False)
    style.turn_curves(below, angle, pressure, "Largest pressure, MPa", zero=False)
    above.set_ylim(0, None)
    style.legend_above(above)
    return figure


# ---------------------------------------------------------------- one bearing under a table of loads


@draws(journal=LoadedJournal)
def loaded_journal_figures(journal: LoadedJournal) -> dict[str, Figure]:
    """Path of a journal in its clearance, and its film with the diagram of its loads, by name.

    Args:
        journal: under the loads of a table.
    """
    return {"path": loaded_path(journal), "film": loaded_film(journal)}


@draws(journal=LoadedJournal)
def loaded_path(journal: LoadedJournal) -> Figure:
    """Path of a journal in its clearance circle, in the axes of its load table, with its load as arrows.

    Args:
        journal: under the loads of a table.
    """
    figure, ax = style.single((4.6, 4.9), "Journal in its clearance")
    film = eqx.tree_at(
        lambda f: (f.position, f.load), journal.film, (journal.position, journal.load)
    )
    path, load = in_clearance(ax, film, color=style.tint(0), linewidth=1.6)
    period = journal.table.period
    first = float(journal.angle[0])
    numbered = []
    for mark in np.arange(0, period - 1e-9, np.pi / 4):
        at = int(
            np.argmin(np.abs(np.asarray(journal.angle) - first - np.mod(mark - first, period)))
        )
        ax.plot(*path[:, at], "o", color=style.tint(0), markersize=3.2)
        ax.annotate("", path[:, at] + load[:, at], path[:, at],
                    arrowprops={"arrowstyle": "->", "color": "#888888"})  # fmt: skip
        if all(np.hypot(*(path[:, at] - path[:, other])) > 0.2 for other in numbered):
            numbered.append(at)
            ax.annotate(f"{np.rad2deg(mark):.0f}°", path[:, at], xytext=(3, 3), color=style.INK,
                        textcoords="offset points", fontsize=7.5)  # fmt: skip
    style.note(figure, "Axes of the load table. Dots: every 45° of crank angle. Arrows: load.")
    return figure


@draws(journal=LoadedJournal)
def loaded_film(journal: LoadedJournal) -> Figure:
    """Load diagram with the points of the table, smallest film and largest pressure over the period.

    Args:
        journal: under the loads of a table.
    """
    figure, axes = style.stacked(3, (7.2, 7.4), "Film under the loads of the table")
    film = journal.film
    degrees = np.rad2deg(np.asarray(journal.angle))
    look = shown("load", "N", np.hypot(*journal.load))
    marks = np.rad2deg(np.asarray(journal.table.angle))
    for n, name in enumerate(("W_x", "W_y")):
        axes[0].plot(degrees, look.factor * journal.load[n], color=style.tint(n), label=name)
        dots = look.factor * journal.table.load[n]
        axes[0].plot(marks, dots, "o", color=style.tint(n), markersize=2.4)
    size = look.factor * np.hypot(*journal.load)
    axes[0].plot(degrees, size, "--", color=style.INK, linewidth=1.0, label="size")
    axes[1].plot(degrees, 1e6 * film.thickness, color=style.tint(0))
    least = np.rad2deg(journal.minimum_film_angle), 1e6 * film.minimum_film
    axes[1].plot(*least, "o", color=style.tint(1), markersize=4)
    alignment = "right" if least[0] > degrees.mean() else "left"
    axes[1].annotate(f"{least[1]:.3g} µm at {least[0]:.1f}°", least, xytext=(0, 6), fontsize=8,
                     textcoords="offset points", ha=alignment)  # fmt: skip
    axes[2].plot(degrees, film.pressure / 1e6, color=style.tint(0))
    labels = (f"Load, {look.unit}", "Smallest film, µm", "Largest pressure, MPa")
    for ax, label in zip(axes, labels, strict=True):
        ax.set_ylabel(label)
    style.zero_line(axes[0])
    style.legend_above(axes[0])
    axes[1].set_ylim(0, None)
    axes[2].set_ylim(0, None)
    axes[2].set_xlabel("Crank angle, degrees")
    axes[2].set_xlim(degrees[0], degrees[-1])
    style.note(figure, "Dots: points of the table.")
    return figure


# ---------------------------------------------------------------- one bearing under a steady load


@draws(curve=StribeckCurve)
def stribeck(curve: StribeckCurve) -> Figure:
    """Friction torque of film and contact over speed, and the thinnest film beside the roughness.

    Args:
        curve: of a bearing under a steady load.
    """
    load = shown("load", "N", np.asarray(curve.load))
    title = f"Friction over speed at {float(curve.load) * load.factor:.4g} {load.unit}"
    figure, (above, below) = style.stacked(2, (7.2, 6.2), title)
    rpm = np.asarray(curve.speed) * RPM
    total = np.asarray(curve.friction_torque)
    above.plot(rpm, total, color=style.tint(0), label="whole")
    contact = curve.bearing.contact
    if contact is not None:
        rubbing = np.asarray(curve.contact_torque)
        above.plot(rpm, total - rubbing, "--", color=style.tint(1), label="film")
        contact_torque = np.where(rubbing > 1e-3 * total.min(), rubbing, np.nan)
        above.plot(rpm, contact_torque, ":", color=style.tint(2), label="contact")
        least = float(curve.least_friction_speed) * RPM
        if rpm[0] < least < rpm[-1]:
            above.axvline(least, color="#AAAAAA", linewidth=0.8)
            below.axvline(least, color="#AAAAAA", linewidth=0.8)
            style.note(figure, f"Grey: least friction, at {least:.4g} rpm.")
        rough = 1e6 * float(contact.roughness)
        below.axhline(rough, color=style.INK, linewidth=0.9, linestyle=":", label="roughness")
    below.plot(rpm, 1e6 * curve.minimum_film, color=style.tint(0), label="film")
    above.set(yscale="log", ylabel="Friction torque, N m")
    below.set(xscale="log", yscale="log", ylabel="Smallest film, µm", xlabel="Speed, rpm")
    for ax in (above, below):
        style.legend_above(ax)
    for axis in (above.yaxis, below.yaxis, below.xaxis):
        axis.set_major_formatter("{x:g}")
    below.yaxis.set_minor_formatter(NullFormatter())
    return figure


@draws(steady_state=SteadyBearing)
def film_figures(steady_state: SteadyBearing, model: str = "") -> dict[str, Figure]:
    """All pictures by name; those that the film model does not give are left out.

    Args:
        steady_state: of `jaxcomp.film.steady_bearing`.
        model: name of the film model in the titles; the bearing's own if absent.
    """
    figures = {}
    if steady_state.field is not None:
        figures["pressure"] = film_pressure(steady_state, model)
    if issubclass(steady_state.bearing.model, AbstractSolvedFilm):
        figures["coefficients"] = film_coefficients(steady_state, model)
    return figures


@draws(found=SteadyBearing)
def film_pressure(found: SteadyBearing, model: str = "") -> Figure:
    """Pressure over the unrolled bearing, and along its mid-plane with the film thickness.

    Args:
        found: of `jaxcomp.film.steady_bearing`, with a field of pressure.
        model: as in `film_figures`.

    Raises:
        BadInput: a film model that gives no pressure.
    """
    field = found.field
    point = found.point
    bearing = found.bearing
    if field is None or point.eccentricity_ratio is None or point.attitude_angle is None:
        raise BadInput("found", f"of the film {bearing.film}", "with a field of pressure")
    angle = np.degrees(field.angle)
    ratio = float(point.eccentricity_ratio)
    title = f"Film pressure, {model or bearing.film}, eccentricity ratio {ratio:.4g}"
    figure, (above, below) = style.stacked(2, (7.2, 5.6), title)
    # both halves of the bearing, of which the field has one
    half = field.zeta * float(bearing.length) / 2 * 1e3
    along = np.concatenate([-half[:0:-1], half])
    half = field.pressure.T / 1e6
    pressure = np.concatenate([half[:0:-1], half])
    if pressure.max() > 0:
        shades = above.contourf(angle, along, pressure, levels=12, cmap="Blues")
        style.colour_bar(above, shades, "Pressure, MPa", (angle, along, pressure))
    above.set_ylabel("Along the bearing, mm")
    peak = field.peak_pressure / 1e6
    middle = field.pressure[:, 0] / 1e6
    label = f"Pressure, peak {peak:.4g} MPa"
    below.plot(angle, middle, color="#0072B2", linewidth=1.7, label=label)
    top = None if peak > 0 else 1
    below.set(ylim=(0, top), ylabel="Pressure in the mid-plane, MPa",
              xlabel="Angle from the load on the journal, with rotation, degrees")  # fmt: skip
    other = below.twinx()
    other.spines[["top"]].set_visible(False)
    other.tick_params(colors=style.INK, labelsize=8.5)
    closest = np.degrees(float(point.attitude_angle))
    gap = float(bearing.radial_clearance)
    thickness = gap * 1e6 * (1 - ratio * np.cos(np.radians(angle - closest)))
    other.plot(angle, thickness, color=style.INK, linewidth=1.1, linestyle="--")
    other.set_ylim(0, None)
    other.set_ylabel("Film thickness, µm", fontsize=9)
    for ax in (above, below):
        ax.axvline(0, color="#AAAAAA", linewidth=0.8, label="Load")
        ax.axvline(closest, color="#D55E00", linewidth=0.9, linestyle=":", label="Thinnest film")
    below.plot([], [], "--", color=style.INK, linewidth=1.1, label="Film thickness")
    style.legend_above(below)
    return figure


@draws(steady_state=SteadyBearing)
def film_coefficients(steady_state: SteadyBearing, model: str = "") -> Figure:
    """Dimensionless stiffness and damping over the Sommerfeld number, with the running point.

    Negative entries are drawn dashed, by magnitude: the axes are logarithmic.

    Args:
        steady_state: of `jaxcomp.film.steady_bearing`, with a film that gives a position.
        model: as in `film_figures`.
    """
    film = steady_state.bearing.model
    result = steady_state.entries()
    # far enough both ways to show the light load, the heavy load and this one
    running_load = result["phi_p"] or 1.0
    length_ratio = result["length_ratio"]
    loads = np.geomspace(min(1e-2, running_load / 3), max(1e2, 3 * running_load), 161)
    eccentricity, *curves = _curves(film, jnp.asarray(length_ratio), jnp.asarray(loads))
    number = 1 / (2 * np.pi * loads)
    running = result["sommerfeld_number"]
    title = f"Coefficients over the load, {model or result['film']}, L/D = {length_ratio:.4g}"
    figure, axes = style.stacked(3, (7.2, 7.4), title)
    points = result["dimensionless_stiffness"], result["dimensionless_damping"]
    rows = zip(axes[:2], curves, points, ("c K/W", "c ω C/W"), strict=True)
    for ax, curve, point, label in rows:
        for (entry, tint), (i, j) in zip(_ENTRIES.items(), np.ndindex(2, 2), strict=True):
            values = np.asarray(curve)[:, i, j]
            ax.plot(number, np.where(values > 0, values, np.nan), color=tint, label=entry)
            ax.plot(number, np.where(values < 0, -values, np.nan), color=tint, linestyle="--")
            if running is not None and point is not None:
                ax.plot([running], [abs(point[i][j])], "o", color=tint, markersize=4.5)
        ax.set(yscale="log", ylabel=label)
        style.legend_above(ax)
    style.note(figure, "Dashed: negative, by magnitude. Dots: this bearing.")
    ax = axes[2]
    ax.plot(number, np.asarray(eccentricity), color=style.INK, linewidth=1.5)
    if running is not None:
        ax.plot([running], [result["eccentricity_ratio"]], "o", color="#D55E00", markersize=5)
    ax.set(xscale="log", ylim=(0, 1), ylabel="Eccentricity ratio")
    ax.set_xlabel("Sommerfeld number S (revolutions per second); light load to the right")
    return figure


@eqx.filter_jit
def _curves(film, length_ratio, loads):
    model = film(length_ratio)

    def at_load(number):
        x = film_ratio(model, number)
        return x / (1 + x), *coefficients_per_load(model, number)

    return jax.vmap(at_load)(loads)
