"""A motion of the crank in time: speed, and where the work went."""

import numpy as np
from matplotlib.figure import Figure

from .._shown import RPM
from ..crank import Transient
from ._style import INK, colour, legend_above, new_figure, words, ylabel


def transient_figure(transient: Transient, name: str, power_off: float | None = None) -> Figure:
    """Speed over time, and the work since the start: of the motor, of the gas, of friction, in motion.

    With valves the pressure in the cylinders as well.

    Args:
        transient: of `simulate`.
        name: of the machine, for the title.
        power_off: [s] instant at which the motor was switched off, if it was.
    """
    how = " to rest" if bool(transient.stopped) else ""
    title = f"{name}: {float(transient.end_time):.4g} s{how}"
    gas = transient.gas
    rows = 2 if gas is None else 3
    figure, axes = new_figure(rows, 1, (7.4, 2.8 * rows), title)
    time, energy = np.asarray(transient.time), transient.energy
    above, below = axes[0, 0], axes[-1, 0]
    if gas is not None:
        for course in np.atleast_2d(np.asarray(gas.pressure)) / 1e5:
            axes[1, 0].plot(time, course, linewidth=0.8)
        ylabel(axes[1, 0], "Pressure, bar")
    above.plot(time, np.asarray(transient.state.speed) * RPM, color=colour("motor"), linewidth=1.0)
    ylabel(above, "Crank speed, rpm")
    curves = {
        "motor": energy.motor_work,
        "gas": energy.gas_work,
        "friction": energy.total_loss,
        "crank": transient.kinetic_energy,
    }
    labels = {"crank": "In motion"}
    for part, work in curves.items():
        label = labels.get(part, words(part))
        course = np.broadcast_to(np.asarray(work) / 1e3, time.shape)
        below.plot(time, course, color=colour(part), linewidth=1.2, label=label)
    ylabel(below, "Work since the start, kJ")
    below.set_xlabel("Time, s", fontsize=9)
    legend_above(below)
    if power_off is not None:
        for ax in axes[:, 0]:
            ax.axvline(power_off, color=INK, linewidth=0.9, linestyle="--")
        above.annotate("motor off", (power_off, 0), xytext=(4, 4), textcoords="offset points",
                       color=INK, fontsize=8.5)  # fmt: skip
    return figure


def transient_gas_figure(transient: Transient, name: str, power_off: float | None = None) -> Figure:
    """Pressure in the cylinders and lifts of the valves over the last four revolutions.

    Args:
        transient: of `simulate`, with valves.
        name: of the machine, for the title.
        power_off: [s] instant at which the motor was switched off, if it was.

    Raises:
        ValueError: a motion under a prescribed pressure.
    """
    gas = transient.gas
    if gas is None:
        raise ValueError("a picture of the gas needs cylinders with valves.")
    several = gas.pressure.ndim > 1
    time = np.asarray(transient.time)
    angle = np.asarray(transient.state.angle)
    pressure = np.atleast_2d(np.asarray(gas.pressure)) / 1e5
    lift = np.asarray(gas.lift)[0] if several else np.asarray(gas.lift)
    # four revolutions, or what there is
    last = angle >= angle[-1] - 8 * np.pi
    figure, axes = new_figure(2, 1, (7.4, 5.6), f"{name}: gas at the end")
    close, lifts = axes[:, 0]
    for number, course in enumerate(pressure, 1):
        close.plot(time[last], course[last], linewidth=1.2, label=f"Cylinder {number}")
    for place, valve in enumerate(("Suction", "Discharge")):
        lifts.plot(time[last], lift[place][last] * 1e3, linewidth=1.2, label=valve)
    ylabel(close, "Pressure, bar")
    ylabel(lifts, "Lift of the first cylinder, mm" if several else "Lift, mm")
    lifts.set_xlabel("Time, s", fontsize=9)
    if several:
        legend_above(close)
    legend_above(lifts)
    if power_off is not None and power_off > time[last][0]:
        for ax in (close, lifts):
            ax.axvline(power_off, color=INK, linewidth=0.9, linestyle="--")
    return figure
