"""Pictures of the crank: one periodic revolution, and several cylinders.

All of them take what the library computed and return a figure; none shows or saves anything. Crank
angles run from -180 to 180 degrees with the top dead centre at zero (exactly so without an offset).
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .._core.display import RPM, shown
from .._core.each import of_cylinder
from .._core.fields import replaced
from ..compressor import Compressor, instants, of_each_cylinder
from ..crank import CrankTrain, Orbit, journal_films, performance, train_over_speed
from ..crank._films import journal_rates
from ..crank._orbit import time_harmonics
from ..crankshaft import MainBearings
from ..film import JournalBearing
from ..friction import SliderCrankFriction
from ..mechanism import SliderCrank, Vector
from ..study import ProcessSheet, SteadyState
from ..vibration import Suspension, shaking_wrench
from . import _style as style
from ._animate import machine_views
from ._bearings import bearing_loads, journal_films_over_turn, journal_paths
from ._cylinder import cylinder_figures
from ._drawing import draws
from ._fine import EndDiagram, FineTurn, diagrams_of_ends, fine_turn, first_diagram
from ._vibration import free_body_errors, shaking_force, vibration_orbits

_TORQUE = "Torque in the sense of rotation, N m"
_ORDERS = 12


@draws(steady_state=SteadyState)
def steady_state_figures(steady_state: SteadyState) -> dict[str, Figure]:
    """All pictures of a machine's periodic state by name; those of absent parts are left out."""
    parts: Any = steady_state.machine.parts
    figures = orbit_figures(steady_state.compressor, steady_state.orbit, parts.get("suspension"))
    if steady_state.api_618 is not None and steady_state.api_618.crosshead:
        figures["rod_loads"] = rod_loads(steady_state.api_618)
    if "torsion" in parts:
        train = parts["torsion"]
        figures["torsion"] = torsion_over_speed(steady_state.compressor, steady_state.orbit, train)
    return figures


@draws(orbit=Orbit)
def orbit_figures(
    compressor: Compressor, orbit: Orbit, suspension: Suspension | None = None
) -> dict[str, Figure]:
    """All pictures of a revolution by name; those of absent parts are left out."""
    figures = {}
    if orbit.pressure is not None:
        figures["pv_diagram"] = pv_diagram(compressor, orbit)
    if orbit.cycle is not None:
        figures |= cylinder_figures(orbit.cycle, performance(compressor, orbit))
    figures["speed"] = speed_over_turn(compressor, orbit)
    figures["torques"] = crank_torques(compressor, orbit)
    if compressor.crankshaft.count > 1:
        if compressor.gas is not None:
            figures["cylinder_torques"] = cylinder_torques(compressor, orbit)
        figures["machine"] = machine_views(compressor, orbit)
        figures["orders"] = order_spectra(compressor, orbit)
    figures["joint_forces"] = joint_forces(compressor, orbit)
    figures["bearing_loads"] = bearing_loads(compressor, orbit)
    if journal_films(compressor, orbit):
        figures["journal_paths"] = journal_paths(compressor, orbit)
        figures["journal_films"] = journal_films_over_turn(compressor, orbit)
    if orbit.loads.loss_torque:
        figures["joint_friction"] = joint_friction(compressor, orbit)
        figures["losses"] = loss_shares(orbit)
    figures["shaking_force"] = shaking_force(compressor, orbit)
    if suspension is not None:
        figures["vibration_orbits"] = vibration_orbits(compressor, orbit, suspension)
        figures["free_body_errors"] = free_body_errors(compressor, orbit, suspension)
    return figures


# ---------------------------------------------------------------- one revolution


def rod_loads(sheet: ProcessSheet) -> Figure:
    """Gas load, inertia and combined load along each rod, tension upwards."""
    count = len(sheet.throws)
    look = shown("force", "N", sheet.combined)
    figure, axes = style.stacked(count, (7.2, 2.4 * count + 0.8), "Rod loads")
    for number, ax in enumerate(axes):
        curves = {
            "gas": look.factor * sheet.gas[number],
            "inertia": look.factor * sheet.inertia[number],
            "combined": look.factor * sheet.combined[number],
        }
        tension = "Tension"
        if count > 1:
            tension += f" of throw {number + 1}"
        label = f"{tension}, {look.unit}"
        style.turn_curves(ax, sheet.crank_angle, curves, label, angle_label=number + 1 == count)
    style.note(figure, "Tension counts positive; friction and weights have no part.")
    style.legend_above(axes[0])
    return figure


# Indicator diagrams in one picture: more of them hide each other.
_MOST_DIAGRAMS = 8


@draws(orbit=Orbit)
def pv_diagram(compressor: Compressor, orbit: Orbit) -> Figure:
    """Cylinder pressure over the volume that the piston displaces; of several cylinders the first.

    Double-acting ones have both ends, of every cylinder unless they are alike.

    Args:
        compressor: whose orbit it is.
        orbit: of `solve_orbit`.

    Raises:
        ValueError: the compressor has no gas.
    """
    if compressor.gas is None or orbit.pressure is None:
        raise ValueError("A p-V diagram needs a compressor with gas.")
    turn = fine_turn(compressor, orbit)
    ends = diagrams_of_ends(compressor, orbit, turn)
    figure, ax = style.single((6.4, 4.2), "Indicator diagram")
    if ends:
        _draw_ends(ax, ends)
    else:
        volume, pressure = _closed(*first_diagram(compressor, turn))
        ax.fill(volume, pressure, color=style.colour("gas"), alpha=0.08, linewidth=0)
        look = {"color": style.colour("gas"), "linewidth": 1.8}
        ax.plot(volume, pressure, label="Cylinder, absolute", **look)
        back = float(of_cylinder(compressor.gas).behind_piston) / 1e6
        ax.axhline(back, color=style.INK, linewidth=0.9, linestyle="--", label="Behind the piston")
    ax.set(xlim=(0, None), ylim=(0, None), ylabel="Pressure, MPa")
    ax.set_xlabel("Displaced volume (clearance not counted), cm³")
    count = compressor.crankshaft.count
    of_all = ""
    if count != 1:
        of_all = f" of {count} cylinders"
    work = f"Work on the gas{of_all}\n{float(orbit.energy.gas_work):.4g} J per revolution"
    place = style.free_place(ax, (0.5, 0.45))
    look = {"ha": "center", "va": "center", "fontsize": 9, "color": style.INK}
    ax.text(*place, work, transform=ax.transAxes, **look)
    style.legend(ax)
    return figure


def _closed(volume, pressure) -> tuple[np.ndarray, np.ndarray]:
    """Volume [cm^3] and pressure [MPa] of a diagram, with the first point once more at its end."""
    return 1e6 * np.append(volume, volume[0]), 1e-6 * np.append(pressure, pressure[0])


def _draw_ends(ax, ends: list[EndDiagram]) -> None:
    """Both ends of cylinders that differ, the crank ends dashed."""
    drawn = []
    for head, crank in zip(ends[::2], ends[1::2], strict=True):
        sizes = [float(jnp.max(curve)) for curve in (*head[2:], *crank[2:])]
        alike = any(np.allclose(sizes, other, rtol=1e-3) for other in drawn)
        if alike or 2 * len(drawn) >= _MOST_DIAGRAMS:
            continue
        tint = style.tint(len(drawn))
        drawn.append(sizes)
        for diagram, line in ((head, "-"), (crank, "--")):
            label = f"Cylinder {diagram.cylinder}, {diagram.end} end"
            curve = _closed(diagram.volume, diagram.pressure)
            ax.plot(*curve, color=tint, linestyle=line, linewidth=1.5, label=label)


@draws(orbit=Orbit)
def joint_forces(compressor: Compressor, orbit: Orbit) -> Figure:
    """Magnitude of every joint force, and the side force of the cylinder wall with its sign."""
    turn = fine_turn(compressor, orbit)
    look = shown("force", "N", np.stack(list(turn.loads.forces.values())))
    walls = {}
    sizes = {}
    for name, force in turn.loads.forces.items():
        force = look.factor * np.asarray(force)
        if name.split("_")[0] == "wall":
            walls[name] = force[1]
        else:
            sizes[name] = np.hypot(*force)
    rows = 1
    height = 3.6
    if walls:
        rows = 2
        height = 5.6
    figure, axes = style.stacked(rows, (7.2, height), "Joint forces over one revolution")
    angle = turn.state.angle
    ax = axes[0]
    label = f"Magnitude, {look.unit}"
    wide = {"linewidth": 1.6}
    style.turn_curves(ax, angle, sizes, label, zero=False, angle_label=not walls, **wide)
    ax.set_ylim(0, None)
    style.legend_above(ax)
    if walls:
        ax = axes[1]
        label = f"Side force on the piston, {look.unit}"
        style.turn_curves(ax, angle, walls, label, **wide)
        if len(walls) > 1:
            style.legend_above(ax)
    return figure


@draws(orbit=Orbit)
def joint_friction(compressor: Compressor, orbit: Orbit) -> Figure:
    """Friction of every joint (Tsuji et al. 2012, Fig. 4).

    For a slider-crank the torque in each pin and the force on the piston; for other mechanisms the
    torque that each joint takes from the crank.

    Raises:
        ValueError: no joint has friction.
    """
    _check_friction(orbit)
    turn = fine_turn(compressor, orbit)
    curves = _friction_of_slider_crank(compressor, turn)
    if not curves:
        curves = {}
        for name, torque in turn.loads.loss_torque.items():
            curves[name] = (torque, "Torque on the crank, N m")
    rows, columns = style.grid_of(len(curves), 2)
    size = (4.0 * columns + 0.4, 2.5 * rows + 0.5)
    figure, axes = style.new_figure(rows, columns, size, "Friction of the joints")
    drawn = zip(style.used(axes, len(curves)), curves.items(), strict=True)
    for place, (ax, (name, (curve, label))) in enumerate(drawn):
        lowest = place >= len(curves) - columns
        style.turn_curves(
            ax,
            turn.state.angle,
            {name: curve},
            label,
            angle_label=lowest,
            color=style.colour(name, place),
        )
        style.heading(ax, style.words(name))
        ax.tick_params(labelbottom=lowest)
        ax.set_xticks(range(-180, 181, 90))
    return figure


@draws(orbit=Orbit)
def speed_over_turn(compressor: Compressor, orbit: Orbit) -> Figure:
    """Crank speed and acceleration (Tsuji et al. 2012, Fig. 3 a and b)."""
    figure, (above, below) = style.stacked(2, (7.2, 5.2), "Crank motion over one revolution")
    angle, speed, rise = fine_turn(compressor, orbit).state
    look = {"linewidth": 1.7, "label": None, "zero": False, "angle_label": False}
    style.turn_curves(above, angle, {"motor": speed * RPM}, "Crank speed, rpm", **look)
    mean = float(orbit.mean_speed) * RPM
    low = float(orbit.lowest_speed) * RPM
    high = float(orbit.highest_speed) * RPM
    above.axhline(
        mean, color=style.INK, linewidth=0.9, linestyle="--", label=f"Mean {mean:.5g} rpm"
    )
    fluctuation = 100 * float(orbit.speed_fluctuation)
    text = f"{low:.4g} to {high:.4g} rpm, fluctuation {fluctuation:.2f} %"
    above.axhspan(low, high, color=style.colour("motor"), alpha=0.07, linewidth=0, label=text)
    style.legend_above(above)
    style.turn_curves(below, angle, {"crank": rise}, "Crank acceleration, rad/s²")
    return figure


@draws(orbit=Orbit)
def crank_torques(compressor: Compressor, orbit: Orbit) -> Figure:
    """Torques on the crank: motor, gas, friction and the inertia of the moving parts.

    Tsuji et al. (2012), Fig. 3 d to f. Inertia torques count as loads of their own, so that all
    curves add up to the inertia of the crankshaft alone.
    """
    turn = fine_turn(compressor, orbit)
    mechanism = compressor.mechanism
    torques = {"motor": turn.motor_torque, "gas": turn.gas_torque}
    inertia_torque, piston = _inertia_torques(compressor, turn.state)
    moving = inertia_torque - compressor.crankshaft.inertia * turn.state.acceleration
    if isinstance(mechanism, SliderCrank):
        torques |= {"piston": -piston, "rod": -(moving - piston)}
        plural = "" if compressor.crankshaft.count == 1 else "s"
        looks = {
            "piston": {"label": f"Inertia of the piston{plural}"},
            "rod": {"label": f"Inertia of the rod{plural}"},
        }
    else:
        torques["piston"] = -moving
        looks = {"piston": {"label": "Inertia of the moving parts"}}
    if turn.loads.loss_torque:
        torques["friction"] = -turn.loads.total_loss_torque
    figure, ax = style.single((7.2, 4.2), "Torques on the crank over one revolution")
    style.turn_curves(ax, turn.state.angle, torques, _TORQUE, looks=looks)
    style.legend_above(ax)
    return figure


def cylinder_torques(compressor: Compressor, orbit: Orbit) -> Figure:
    """Torque of the gas of each cylinder on the crank, and their sum with the weights."""
    turn = fine_turn(compressor, orbit)
    at = instants(orbit.under_gas(compressor), turn.state.angle)
    torques = {"gas": turn.gas_torque}
    for number, torque in enumerate(-at.gas_force * at.kinematics.position_1, 1):
        torques[f"cylinder_{number}"] = torque
    figure, ax = style.single((7.2, 4.2), "Gas torque of each cylinder")
    looks = {"gas": {"label": "Sum", "linewidth": 2.0, "zorder": 2.1}}
    style.turn_curves(ax, turn.state.angle, torques, _TORQUE, looks=looks, linewidth=1.0)
    style.legend_above(ax)
    return figure


@draws(orbit=Orbit)
def loss_shares(orbit: Orbit) -> Figure:
    """Work lost in each joint, with its power and its share of all losses.

    Raises:
        ValueError: no joint has friction.
    """
    _check_friction(orbit)
    losses = {name: float(loss) for name, loss in orbit.energy.losses.items()}
    losses = dict(sorted(losses.items(), key=lambda item: item[1]))
    total = sum(losses.values())
    period = float(orbit.period)
    efficiency = 100 * float(orbit.mechanical_efficiency)
    title = (
        f"Friction losses, {total:.4g} J per revolution; mechanical efficiency {efficiency:.2f} %"
    )
    figure, ax = style.single((7.2, 0.6 * len(losses) + 1.6), title)
    tints = [style.colour(name, place) for place, name in enumerate(losses)]
    bars = ax.barh(range(len(losses)), list(losses.values()), color=tints, height=0.62)
    labels = []
    for loss in losses.values():
        share = 0.0
        if total:
            share = 100 * loss / total
        powers = f"{style.plain_number(loss)} J   {style.plain_number(loss / period)} W"
        labels.append(f"{powers}   {share:.1f} %")
    ax.bar_label(bars, labels, padding=4, fontsize=8.5, color=style.INK)
    style.named_rows(ax, list(map(style.words, losses)), down=False)
    ax.set(xlim=(0, 1.45 * max([*losses.values(), 1e-12])), xlabel="Work lost, J per revolution")
    return figure


def _check_friction(orbit: Orbit) -> None:
    if not orbit.energy.losses:
        raise ValueError("A picture of losses needs a joint with friction.")


def _friction_of_slider_crank(compressor: Compressor, turn: FineTurn):
    mechanism = compressor.mechanism
    friction = compressor.friction
    if not isinstance(friction, SliderCrankFriction) or not isinstance(mechanism, SliderCrank):
        return None
    if compressor.crankshaft.count > 1:
        return None
    speed = turn.state.speed
    forces = turn.loads.forces
    rates = journal_rates(compressor, turn)
    moments = {}
    shaft = compressor.crankshaft
    support = shaft.main_journal
    if isinstance(support, MainBearings):
        loads = {name: Vector(*forces[name]) for name in support.names or ()}
        moments = dict(support.moments(loads, speed, shaft.mass))
    laws = {"piston_pin": friction.piston_pin, "crank_pin": friction.crank_pin}
    for name, law in (laws | {"main_journal": support}).items():
        rate = rates.get(name, speed)
        if isinstance(law, JournalBearing) and law.moves:
            # of a journal that moves that of its loss: not all of it is a moment on the bush
            moments[name] = turn.loads.loss_torque[name] * speed / rate
        elif law is not None and not isinstance(law, MainBearings):
            moments[name] = law.moment(jnp.hypot(*forces[name]), rate)
    curves = {name: (moment, "Torque, N m") for name, moment in moments.items()}
    if friction.wall is not None or getattr(friction, "piston_film", None) is not None:
        curves["wall"] = (forces["wall"][0], "Force on the piston, N")
    return curves


@eqx.filter_jit
def _inertia_torques(compressor: Compressor, state):
    """Inertia torques [N m] of all moving parts, and of the pistons."""
    # without the gas, which has no pressure of its own where it is solved with its valves
    at = instants(replaced(compressor, gas=None), state.angle)
    total = at.inertia * state.acceleration + 0.5 * at.inertia_1 * state.speed**2
    position_1 = at.kinematics.position_1
    position_2 = at.kinematics.position_2
    stroke = position_1 * (position_1 * state.acceleration + position_2 * state.speed**2)
    crankshaft = compressor.crankshaft
    mass = jnp.broadcast_to(compressor.mechanism.piston_mass, (crankshaft.count,))
    return total, jnp.sum(crankshaft.along(mass, state.angle) * stroke, axis=0)


# ---------------------------------------------------------------- several cylinders


@draws(orbit=Orbit)
def order_spectra(compressor: Compressor, orbit: Orbit) -> Figure:
    """Orders of time of the torque of gas and weights, the shaking force and its couples.

    Args:
        compressor: whose orbit it is.
        orbit: of `solve_orbit`.
    """
    instants = orbit.time, orbit.weight / orbit.state.speed
    each = of_each_cylinder(orbit.under_gas(compressor), orbit.state.angle).conservative
    wrench = shaking_wrench(compressor, orbit.state)
    torques = jnp.stack([jnp.sum(each, axis=0), each[0]])
    torque, _ = time_harmonics(torques, *instants, _ORDERS)
    force, _ = time_harmonics(wrench.force[:2], *instants, _ORDERS)
    moment, _ = time_harmonics(wrench.moment, *instants, _ORDERS)
    # an ellipse is the sum of two circles, one with and one against the rotation
    ahead = 0.5 * jnp.abs(force[0] + 1j * force[1])
    behind = 0.5 * jnp.abs(force[0] - 1j * force[1])
    rows = (
        ("Torque, N m", {"All cylinders": torque[0], "The first": torque[1]}),
        ("Shaking force, N", {"Forward": ahead, "Backward": behind}),
        ("Moment, N m", {"About x": moment[0], "About y": moment[1], "About z": moment[2]}),
    )
    figure, axes = style.stacked(3, (7.2, 7.4), "Orders of the revolution")
    for ax, (label, bars) in zip(axes, rows, strict=True):
        shifts, width = style.side_by_side(len(bars))
        for place, (name, values) in enumerate(bars.items()):
            at = np.arange(1, _ORDERS + 1) + shifts[place]
            ax.bar(at, np.abs(values), width, color=style.tint(place), label=name)
        ax.set_ylabel(label)
        style.legend(ax, loc="upper right")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[-1].set_xlabel("Order of time")
    return figure


@draws(orbit=Orbit)
def torsion_over_speed(compressor: Compressor, orbit: Orbit, train: CrankTrain) -> Figure:
    """Peak torque of every spring of the crank train against speed, with its critical speeds.

    Args:
        compressor: with several cylinders.
        orbit: its periodic state, whose speed is the middle of the range.
        train: inertias and springs.
    """
    speeds = float(orbit.mean_speed) * np.linspace(0.5, 1.5, 41)
    _, peaks = train_over_speed(compressor, train, jnp.asarray(speeds))
    figure, ax = style.single((7.2, 3.8), "Torque of the springs of the crank train")
    for number, peak in enumerate(np.asarray(peaks).T):
        ax.plot(
            RPM * speeds,
            peak,
            color=style.tint(number),
            linewidth=1.6,
            label=f"Spring {number + 1}",
        )
    for frequency in np.asarray(train.chain(compressor).natural_frequencies)[1:]:
        for order in range(1, 13):
            if speeds[0] < frequency / order < speeds[-1]:
                critical = RPM * frequency / order
                ax.axvline(critical, color="#AAAAAA", linewidth=0.8, linestyle="--")
                ax.annotate(f"{order}", (critical, 1), xycoords=("data", "axes fraction"),
                            fontsize=8, ha="center", va="bottom", color=style.INK)  # fmt: skip
    ax.set(ylim=(0, None), ylabel="Peak over the revolution, N m")
    ax.set_xlabel("Mean speed, rpm; dashed: an order meets a torsional frequency")
    style.legend(ax, loc="upper right")
    return figure


@draws()
def by_number_of_cylinders(results: Mapping[str, Orbit]) -> Figure:
    """Efficiency and fluctuation of machines with different cylinders.

    Args:
        results: orbit by what stands below its bar, such as the number of cylinders or the layout.
    """
    figure, axes = style.abreast(2, (8.6, 3.4), "Cylinders on one crank")
    keys = "mechanical_efficiency", "speed_fluctuation"
    for place, (ax, key) in enumerate(zip(axes, keys, strict=True)):
        heights = [100 * float(getattr(orbit, key)) for orbit in results.values()]
        bars = ax.bar(list(results), heights, color=style.tint(place), width=0.6)
        ax.bar_label(bars, fmt="%.4g", fontsize=8.5, color=style.INK)
        ax.set_ylabel(f"{style.words(key)}, %")
        if place == 0:
            ax.set_ylim(min(heights) - 0.5 * np.ptp(heights) - 0.1, max(heights) + 0.1)
    return figure
