"""A motion of the crank in time: speed, and where the work went."""

import numpy as np
from matplotlib.figure import Figure

from .._shown import RPM
from ..crank import Transient
from ._style import INK, colour, legend_above, new_figure, words, ylabel


def transient_figure(transient: Transient, name: str, power_off: float | None = None) -> Figure:
    """Speed over time, and the work since the start: of the motor, of the gas, of friction, in motion.

    Args:
        transient: of `simulate`.
        name: of the machine, for the title.
        power_off: [s] instant at which the motor was switched off, if it was.
    """
    how = " to rest" if bool(transient.stopped) else ""
    title = f"{name}: {float(transient.end_time):.4g} s{how}"
    figure, axes = new_figure(2, 1, (7.4, 5.6), title)
    time, energy = np.asarray(transient.time), transient.energy
    above, below = axes[:, 0]
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
        below.plot(time, np.asarray(work) / 1e3, color=colour(part), linewidth=1.2, label=label)
    ylabel(below, "Work since the start, kJ")
    below.set_xlabel("Time, s", fontsize=9)
    legend_above(below)
    if power_off is not None:
        for ax in (above, below):
            ax.axvline(power_off, color=INK, linewidth=0.9, linestyle="--")
        above.annotate("motor off", (power_off, 0), xytext=(4, 4), textcoords="offset points",
                       color=INK, fontsize=8.5)  # fmt: skip
    return figure
