"""Pictures of a motion in time: speed and works of the crank, and the gas in its cylinders."""

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._core.display import RPM
from ..crank import Transient
from . import _style as style
from ._drawing import draws


@draws(transient=Transient)
def transient_figure(transient: Transient, name: str, power_off: float | None = None) -> Figure:
    """Speed over time, and the work since the start: of the motor, of the gas, of friction, in motion.

    With valves the pressure in the cylinders as well.

    Args:
        transient: of `simulate`.
        name: of the machine, for the title.
        power_off: [s] instant at which the motor was switched off, if it was.
    """
    how = " to rest" if bool(transient.stopped) else ""
    rows = 2 if transient.gas is None else 3
    title = f"{name}: {float(transient.end_time):.4g} s{how}"
    figure, axes = style.stacked(rows, (7.4, 2.8 * rows), title)
    time = np.asarray(transient.time)
    energy = transient.energy
    above = axes[0]
    below = axes[-1]
    above.plot(
        time, np.asarray(transient.state.speed) * RPM, color=style.colour("motor"), linewidth=1.0
    )
    above.set_ylabel("Crank speed, rpm")
    if transient.gas is not None:
        axes[1].plot(time, np.atleast_2d(transient.gas.pressure).T / 1e6, linewidth=0.8)
        axes[1].set_ylabel("Pressure, MPa")
    curves = {
        "motor": ("Motor", energy.motor_work),
        "gas": ("Gas", energy.gas_work),
        "friction": ("Friction", energy.total_loss),
        "crank": ("In motion", transient.kinetic_energy),
    }
    for part, (label, work) in curves.items():
        course = np.broadcast_to(np.asarray(work) / 1e3, time.shape)
        below.plot(time, course, color=style.colour(part), linewidth=1.2, label=label)
    below.set(xlabel="Time, s", ylabel="Work since the start, kJ")
    style.legend_above(below)
    if power_off is not None:
        _motor_off(axes, power_off)
        above.annotate("motor off", (power_off, 0), xytext=(4, 4), textcoords="offset points",
                       color=style.INK, fontsize=8.5)  # fmt: skip
    return figure


@draws(transient=Transient)
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
    angle = np.asarray(transient.state.angle)
    at_end = angle >= angle[-1] - 8 * np.pi  # four revolutions, or what there is
    time = np.asarray(transient.time)[at_end]
    figure, (close, lifts) = style.stacked(2, (7.4, 5.6), f"{name}: gas at the end")
    courses = np.atleast_2d(gas.pressure) / 1e6
    names = ["1"]
    of_first = gas.lift
    lift_label = "Lift, mm"
    if several:
        names = gas.names
        of_first = gas.lift[0]
        lift_label = "Lift of the first cylinder, mm"
    for name_of_end, course in zip(names, courses, strict=True):
        label = f"Cylinder {name_of_end or 1}".replace(".", ", ")
        close.plot(time, course[at_end], linewidth=1.2, label=label)
    for valve, lift in zip(("Suction", "Discharge"), of_first, strict=True):
        lifts.plot(time, 1e3 * np.asarray(lift)[at_end], linewidth=1.2, label=valve)
    close.set_ylabel("Pressure, MPa")
    lifts.set(xlabel="Time, s", ylabel=lift_label)
    if several:
        style.legend_above(close)
    style.legend_above(lifts)
    if power_off is not None and power_off > time[0]:
        _motor_off((close, lifts), power_off)
    return figure


def _motor_off(axes: Iterable[Axes], instant: float) -> None:
    for ax in axes:
        ax.axvline(instant, color=style.INK, linewidth=0.9, linestyle="--")
