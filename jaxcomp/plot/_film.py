"""Pictures of one journal bearing: its pressure, and its coefficients over the load.

They take what `jaxcomp bearing` found, as plain numbers, and the class of the film model.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from ..film import (
    AbstractFilm,
    AbstractSolvedFilm,
    PressureField,
    coefficients_per_load,
    film_ratio,
)
from ._style import INK, legend_above, new_figure, note, ylabel

_ENTRIES = {"xx": "#0072B2", "xy": "#D55E00", "yx": "#009E73", "yy": "#56437F"}


def film_figures(
    film: type[AbstractFilm], result: dict[str, Any], field: PressureField | None
) -> dict[str, Figure]:
    """All pictures by name; those that the film model does not give are left out.

    Args:
        film: type of the film model.
        result: what `jaxcomp bearing --json` prints.
        field: of the pressure over angle and length; `None` leaves its picture out.
    """
    figures = {}
    if field is not None:
        figures["pressure"] = film_pressure(result, field)
    if issubclass(film, AbstractSolvedFilm):
        figures["coefficients"] = film_coefficients(film, result)
    return figures


def film_pressure(result: dict[str, Any], field: PressureField) -> Figure:
    """Pressure over the unrolled bearing, and along its mid-plane with the film thickness.

    Args:
        result: the numbers of the bearing in SI units.
        field: pressure over angle and length.
    """
    angle, zeta = np.degrees(field.angle), field.zeta
    pressure = field.pressure / 1e6
    along = np.concatenate([-zeta[:0:-1], zeta]) * result["length"] / 2 * 1e3
    whole = np.concatenate([pressure[:, :0:-1], pressure], axis=1)
    title = (
        f"Film pressure, {result['model']}, eccentricity ratio {result['eccentricity_ratio']:.4g}"
    )
    figure, axes = new_figure(2, 1, (7.2, 5.6), title)
    ax = axes[0, 0]
    if whole.max() > 0:
        shades = ax.contourf(angle, along, whole.T, levels=12, cmap="Blues")
        shades.hover = angle, along, whole.T, "Pressure, MPa"  # pyright: ignore
        bar = figure.colorbar(shades, ax=ax, pad=0.01)
        bar.set_label("Pressure, MPa", fontsize=9)
        bar.ax.tick_params(labelsize=8.5)
    ylabel(ax, "Along the bearing, mm")
    ax = axes[1, 0]
    peak = result["peak_pressure"] / 1e6
    ax.plot(
        angle,
        pressure[:, 0],
        color="#0072B2",
        linewidth=1.7,
        label=f"Pressure, peak {peak:.4g} MPa",
    )
    ylabel(ax, "Pressure in the mid-plane, MPa")
    ax.set_ylim(0, None if peak > 0 else 1)
    ax.set_xlabel("Angle from the load on the journal, with rotation, degrees", fontsize=9)
    other = ax.twinx()
    other.spines[["top"]].set_visible(False)
    other.tick_params(colors=INK, labelsize=8.5)
    closest = np.degrees(result["attitude_angle"])
    gap = result["clearance"] * 1e6
    thickness = gap * (1 - result["eccentricity_ratio"] * np.cos(np.radians(angle - closest)))
    other.plot(angle, thickness, color=INK, linewidth=1.1, linestyle="--")
    other.set_ylim(0, None)
    ylabel(other, "Film thickness, µm")
    for axis in axes[:, 0]:
        axis.axvline(0, color="#AAAAAA", linewidth=0.8, label="Load")
        axis.axvline(closest, color="#D55E00", linewidth=0.9, linestyle=":", label="Thinnest film")
    ax.plot([], [], "--", color=INK, linewidth=1.1, label="Film thickness")
    legend_above(ax)
    return figure


def film_coefficients(film: type[AbstractFilm], result: dict[str, Any]) -> Figure:
    """Dimensionless stiffness and damping over the Sommerfeld number, with the running point.

    Negative entries are drawn dashed, by magnitude: the axes are logarithmic.
    """
    # far enough both ways to show the light load, the heavy load and this one
    here = result["phi_p"] or 1.0
    loads = np.geomspace(min(1e-2, here / 3), max(1e2, 3 * here), 161)
    eccentricity, *curves = _curves(film, jnp.asarray(result["length_ratio"]), jnp.asarray(loads))
    number = 1 / (2 * np.pi * loads)
    title = f"Coefficients over the load, {result['model']}, L/D = {result['length_ratio']:.4g}"
    figure, axes = new_figure(3, 1, (7.2, 7.4), title)
    running = result["sommerfeld_number"]
    points = result["dimensionless_stiffness"], result["dimensionless_damping"]
    names = "c K/W", "c ω C/W"
    for ax, curve, point, name in zip(axes[:2, 0], curves, points, names, strict=True):
        for place, (entry, colour) in enumerate(_ENTRIES.items()):
            values = np.asarray(curve)[:, place // 2, place % 2]
            ax.plot(number, np.where(values > 0, values, np.nan), color=colour, label=entry)
            ax.plot(number, np.where(values < 0, -values, np.nan), color=colour, linestyle="--")
            if running is not None and point is not None:
                mark = abs(point[place // 2][place % 2])
                ax.plot([running], [mark], "o", color=colour, markersize=4.5)
        ax.set_yscale("log")
        ylabel(ax, name)
        legend_above(ax)
    note(figure, "Dashed: negative, by magnitude. Dots: this bearing.")
    ax = axes[2, 0]
    ax.plot(number, np.asarray(eccentricity), color=INK, linewidth=1.5)
    if running is not None:
        ax.plot(
            [running],
            [result["eccentricity_ratio"]],
            "o",
            color="#D55E00",
            markersize=5,
        )
    ax.set_xscale("log")
    ax.set_ylim(0, 1)
    ylabel(ax, "Eccentricity ratio")
    ax.set_xlabel(
        "Sommerfeld number S (revolutions per second); light load to the right", fontsize=9
    )
    return figure


@eqx.filter_jit
def _curves(film, length_ratio, loads):
    model = film(length_ratio)

    def one(number):
        x = film_ratio(model, number)
        return x / (1 + x), *coefficients_per_load(model, number)

    return jax.vmap(one)(loads)
