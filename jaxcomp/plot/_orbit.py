"""Pictures of one periodic turn: pressure, forces, friction, speed, torques, losses, vibration.

All of them take what the library computed and return a figure; none shows or saves anything. Crank
angles run from -180 to 180 degrees with the top dead centre at zero (exactly so without an offset).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from .._fields import of_cylinder, replaced
from .._shown import RPM
from ..compressor import Compressor, instants
from ..crank import Orbit, journal_films, journal_rates, performance
from ..film import OrbitBearing
from ..friction import MainBearings, SliderCrankFriction
from ..mechanism import SliderCrank, Vector
from ..shaking import Suspension
from ._cylinder import cylinder_figures
from ._fine import FineTurn, fine_turn, first_diagram
from ._journals import journal_films_over_turn, journal_paths
from ._polar import bearing_loads
from ._several import machine_views, order_spectra
from ._shaking import free_body_errors, shaking_force, vibration_orbits
from ._style import (
    INK,
    SPARE_COLOURS,
    colour,
    crank_axis,
    legend,
    legend_above,
    new_figure,
    over_turn,
    words,
    ylabel,
)


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
    if compressor.cylinders is not None and compressor.gas is not None:
        figures["cylinder_torques"] = cylinder_torques(compressor, orbit)
    if compressor.cylinders is not None:
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


def pv_diagram(compressor: Compressor, orbit: Orbit) -> Figure:
    """Cylinder pressure over the volume that the piston displaces; of several cylinders the first.

    Raises:
        ValueError: the compressor has no gas.
    """
    if compressor.gas is None or orbit.pressure is None:
        raise ValueError("A p-V diagram needs a compressor with gas.")
    gas, several = of_cylinder(compressor.gas), compressor.cylinders
    volume, pressure = map(np.asarray, first_diagram(compressor, fine_turn(compressor, orbit)))
    volume, pressure = volume * 1e6, pressure / 1e6
    volume, pressure = (np.append(curve, curve[0]) for curve in (volume, pressure))
    figure, ((ax,),) = new_figure(1, 1, (6.4, 4.2), "Indicator diagram")
    ax.fill(volume, pressure, color=colour("gas"), alpha=0.08, linewidth=0)
    ax.plot(volume, pressure, color=colour("gas"), linewidth=1.8, label="Cylinder, absolute")
    back = float(gas.behind_piston) / 1e6
    ax.axhline(back, color=INK, linewidth=0.9, linestyle="--", label="Behind the piston")
    ax.set_xlim(0, None)
    ax.set_ylim(0, None)
    ax.set_xlabel("Displaced volume (clearance not counted), cm³", fontsize=9)
    ylabel(ax, "Pressure, MPa")
    work = float(orbit.energy.gas_work)
    of_all = "" if several is None else f" of {several.count} cylinders"
    ax.text(
        0.5,
        0.42,
        f"Work on the gas{of_all}\n{work:.4g} J per revolution",
        transform=ax.transAxes,
        ha="center",
        fontsize=9,
        color=INK,
    )
    legend(ax, loc="upper right")
    return figure


def joint_forces(compressor: Compressor, orbit: Orbit) -> Figure:
    """Magnitude of every joint force, and the side force of the cylinder wall with its sign."""
    turn = fine_turn(compressor, orbit)
    angle = turn.state.angle
    largest = max(np.abs(force).max() for force in turn.loads.forces.values())
    unit, scale = ("kN", 1e3) if largest >= 1e3 else ("N", 1.0)
    forces = {name: np.asarray(force) / scale for name, force in turn.loads.forces.items()}
    walls = {name: force for name, force in forces.items() if name.split("_")[0] == "wall"}
    figure, axes = new_figure(
        2 if walls else 1, 1, (7.2, 5.6 if walls else 3.6), "Joint forces over one revolution"
    )
    ax = axes[0, 0]
    curves = [item for item in forces.items() if item[0] not in walls]
    for place, (name, force) in enumerate(curves):
        degrees, size = over_turn(angle, np.hypot(*force))
        # a second round of the colours is dashed, a third dotted
        style = ("-", "--", ":", "-.")[place // SPARE_COLOURS % 4]
        tint = colour(name, place)
        ax.plot(degrees, size, style, color=tint, linewidth=1.6, label=words(name))
    ylabel(ax, f"Magnitude, {unit}")
    ax.set_ylim(0, None)
    crank_axis(ax, label=not walls)
    legend_above(ax)
    for place, (name, force) in enumerate(walls.items()):
        ax = axes[1, 0]
        degrees, side = over_turn(angle, force[1])
        ax.plot(degrees, side, color=colour(name, place), linewidth=1.6, label=words(name))
        ax.axhline(0, color="#888888", linewidth=0.8)
        ylabel(ax, f"Side force on the piston, {unit}")
        crank_axis(ax)
    if len(walls) > 1:
        legend_above(axes[1, 0])
    return figure


def joint_friction(compressor: Compressor, orbit: Orbit) -> Figure:
    """Friction of every joint (Tsuji et al. 2012, Fig. 4).

    For a slider-crank the torque in each pin and the force on the piston; for other mechanisms the
    torque that each joint takes from the crank.
    """
    turn = fine_turn(compressor, orbit)
    curves = _friction_of_slider_crank(compressor, turn) or {
        name: (np.asarray(torque), "Torque on the crank, N m")
        for name, torque in turn.loads.loss_torque.items()
    }
    columns = min(2, len(curves))
    rows = -(-len(curves) // columns)
    figure, axes = new_figure(
        rows, columns, (4.0 * columns + 0.4, 2.5 * rows + 0.5), "Friction of the joints"
    )
    for ax in axes.flat[len(curves) :]:
        ax.set_visible(False)
    for place, (name, (curve, label)) in enumerate(curves.items()):
        ax = axes.flat[place]
        degrees, values = over_turn(turn.state.angle, curve)
        ax.plot(degrees, values, color=colour(name, place), linewidth=1.5)
        ax.axhline(0, color="#888888", linewidth=0.8)
        ax.set_title(words(name), fontsize=9.5, loc="left", color=INK)
        ylabel(ax, label)
        lowest = place >= len(curves) - columns
        crank_axis(ax, label=lowest)
        ax.tick_params(labelbottom=lowest)
        ax.set_xticks(range(-180, 181, 90))
    return figure


def speed_over_turn(compressor: Compressor, orbit: Orbit) -> Figure:
    """Crank speed and acceleration (Tsuji et al. 2012, Fig. 3 a and b)."""
    figure, axes = new_figure(2, 1, (7.2, 5.2), "Crank motion over one revolution")
    angle, speed, rise = fine_turn(compressor, orbit).state
    degrees, speed, rise = over_turn(angle, speed * RPM, rise)
    mean = float(orbit.mean_speed) * RPM
    ax = axes[0, 0]
    ax.plot(degrees, speed, color=colour("motor"), linewidth=1.7)
    ax.axhline(mean, color=INK, linewidth=0.9, linestyle="--", label=f"Mean {mean:.5g} rpm")
    low, high = float(orbit.lowest_speed) * RPM, float(orbit.highest_speed) * RPM
    fluctuation = 100 * float(orbit.speed_fluctuation)
    ax.axhspan(
        low,
        high,
        color=colour("motor"),
        alpha=0.07,
        linewidth=0,
        label=f"{low:.4g} to {high:.4g} rpm, fluctuation {fluctuation:.2f} %",
    )
    ylabel(ax, "Crank speed, rpm")
    legend_above(ax)
    crank_axis(ax, label=False)
    ax = axes[1, 0]
    ax.plot(degrees, rise, color=colour("crank"), linewidth=1.5)
    ax.axhline(0, color="#888888", linewidth=0.8)
    ylabel(ax, "Crank acceleration, rad/s²")
    crank_axis(ax)
    return figure


def crank_torques(compressor: Compressor, orbit: Orbit) -> Figure:
    """Torques on the crank: motor, gas, friction and the inertia of the moving parts.

    Tsuji et al. (2012), Fig. 3 d to f. Inertia torques count as loads of their own, so that all
    curves add up to the inertia of the crankshaft alone.
    """
    turn = fine_turn(compressor, orbit)
    torques = {
        "motor": ("Motor", turn.motor_torque),
        "gas": ("Gas", turn.gas_torque),
        **_inertia_torques(compressor, turn),
    }
    if turn.loads.loss_torque:
        torques["friction"] = ("Friction", -turn.loads.total_loss_torque)
    figure, ((ax,),) = new_figure(1, 1, (7.2, 4.2), "Torques on the crank over one revolution")
    for name, (label, torque) in torques.items():
        degrees, values = over_turn(turn.state.angle, torque)
        ax.plot(degrees, values, color=colour(name), linewidth=1.5, label=label)
    ax.axhline(0, color="#888888", linewidth=0.8)
    ylabel(ax, "Torque in the sense of rotation, N m")
    crank_axis(ax)
    legend_above(ax)
    return figure


def cylinder_torques(compressor: Compressor, orbit: Orbit) -> Figure:
    """Torque of the gas of each cylinder on the crank, and their sum with the weights."""
    turn = fine_turn(compressor, orbit)
    at = instants(orbit.under_gas(compressor), turn.state.angle)
    figure, ((ax,),) = new_figure(1, 1, (7.2, 4.2), "Gas torque of each cylinder")
    for number, torque in enumerate(-at.gas_force * at.kinematics.position_1, 1):
        degrees, values = over_turn(turn.state.angle, torque)
        name = f"cylinder_{number}"
        ax.plot(degrees, values, color=colour(name, number), linewidth=1.0, label=words(name))
    degrees, values = over_turn(turn.state.angle, turn.gas_torque)
    ax.plot(degrees, values, color=colour("gas"), linewidth=2.0, label="Sum")
    ax.axhline(0, color="#888888", linewidth=0.8)
    ylabel(ax, "Torque in the sense of rotation, N m")
    crank_axis(ax)
    legend_above(ax)
    return figure


def loss_shares(orbit: Orbit) -> Figure:
    """Work lost in each joint, with its power and its share of all losses."""
    losses = {name: float(loss) for name, loss in orbit.energy.losses.items()}
    losses = dict(sorted(losses.items(), key=lambda item: item[1]))
    total, period = sum(losses.values()), float(orbit.period)
    efficiency = 100 * float(orbit.mechanical_efficiency)
    title = (
        f"Friction losses, {total:.4g} J per revolution; mechanical efficiency {efficiency:.2f} %"
    )
    figure, ((ax,),) = new_figure(1, 1, (7.2, 0.6 * len(losses) + 1.6), title)
    bars = ax.barh(
        [words(name) for name in losses],
        list(losses.values()),
        color=[colour(name, place) for place, name in enumerate(losses)],
        height=0.62,
    )
    labels = [
        f"{loss:.3g} J   {loss / period:.3g} W   {100 * loss / total if total else 0:.1f} %"
        for loss in losses.values()
    ]
    ax.bar_label(bars, labels, padding=4, fontsize=8.5, color=INK)
    ax.set_xlim(0, 1.45 * max([*losses.values(), 1e-12]))
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("Work lost, J per revolution", fontsize=9)
    return figure


def _friction_of_slider_crank(compressor: Compressor, turn: FineTurn):
    mechanism, friction = compressor.mechanism, compressor.friction
    if not isinstance(friction, SliderCrankFriction) or not isinstance(mechanism, SliderCrank):
        return None
    if compressor.cylinders is not None:
        return None
    speed, forces = turn.state.speed, turn.loads.forces
    rates = journal_rates(compressor, turn)
    curves = {}
    support = friction.main_journal
    if isinstance(support, MainBearings):
        moments = support.moments(
            {name: Vector(*forces[name]) for name in support.names or ()}, speed
        )
        curves = {name: (np.asarray(m), "Torque, N m") for name, m in moments.items()}
    for name in ("piston_pin", "crank_pin", "main_journal"):
        law, rate = getattr(friction, name), rates[name]
        if law is not None and not isinstance(law, MainBearings):
            # of a journal that moves that of its loss: not all of it is a moment on the bush
            moment = (
                turn.loads.loss_torque[name] * speed / rate
                if isinstance(law, OrbitBearing)
                else law.moment(jnp.hypot(*forces[name]), rate)
            )
            curves[name] = (np.asarray(moment), "Torque, N m")
    if friction.wall is not None or getattr(friction, "piston_film", None) is not None:
        curves["wall"] = (np.asarray(forces["wall"][0]), "Force on the piston, N")
    return curves


@eqx.filter_jit
def _reduced(compressor: Compressor, state):
    """Inertia torques [N m] of all moving parts, and of the pistons."""
    # without the gas, which has no pressure of its own where it is solved with its valves
    at = instants(replaced(compressor, gas=None), state.angle)
    whole = at.inertia * state.acceleration + 0.5 * at.inertia_1 * state.speed**2
    position_1, position_2 = at.kinematics.position_1, at.kinematics.position_2
    stroke = position_1 * (position_1 * state.acceleration + position_2 * state.speed**2)
    mass, several = compressor.mechanism.piston_mass, compressor.cylinders
    if several is None:
        return whole, mass * stroke
    mass = jnp.broadcast_to(mass, (several.count,))
    return whole, jnp.sum(several.along(mass, state.angle) * stroke, axis=0)


def _inertia_torques(compressor: Compressor, turn: FineTurn):
    whole, piston = _reduced(compressor, turn.state)
    mechanism = compressor.mechanism
    crank = mechanism.crank_inertia * turn.state.acceleration
    several = compressor.cylinders is not None
    if isinstance(mechanism, SliderCrank):
        return {
            "piston": ("Inertia of the pistons" if several else "Inertia of the piston", -piston),
            "rod": (
                "Inertia of the rods" if several else "Inertia of the rod",
                -(whole - crank - piston),
            ),
        }
    return {"piston": ("Inertia of the moving parts", -(whole - crank))}
