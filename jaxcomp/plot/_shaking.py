"""Pictures of the shaking force and of the vibration that it makes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ..compressor import Compressor
from ..crank import Orbit
from ..shaking import (
    Harmonics,
    Suspension,
    block_points,
    free_body_error,
    free_body_response,
    harmonic_response,
    natural_frequencies,
    orbit_load,
    point_motion,
    retuned,
    shaking_wrench,
)
from ._fine import fine_turn
from ._style import (
    crank_axis,
    crank_marks,
    legend,
    legend_above,
    new_figure,
    note,
    over_turn,
    words,
    ylabel,
)

_TINTS = ("#222222", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_HARMONICS = 12
_INSTANTS = 361


def shaking_force(compressor: Compressor, orbit: Orbit) -> Figure:
    """Locus of the shaking force on the block, and its moments over the revolution."""
    turn = fine_turn(compressor, orbit)
    force, moment = (np.asarray(x) for x in _wrench(compressor, turn.state))
    large = np.abs(force).max() >= 1e3
    unit, scale = ("kN", 1e3) if large else ("N", 1.0)
    figure, ((left, right),) = new_figure(1, 2, (8.6, 4.0), "Shaking force and moments", False)
    left.plot(force[0] / scale, force[1] / scale, color="#0072B2", linewidth=1.6)
    degrees = np.rad2deg(np.asarray(turn.state.angle))
    crank_marks(left, degrees, force[0] / scale, force[1] / scale, "#0072B2")
    left.axhline(0, color="#888888", linewidth=0.8)
    left.axvline(0, color="#888888", linewidth=0.8)
    left.set_aspect("equal", adjustable="datalim")
    left.set_xlabel(f"Force along the cylinder, {unit} ", fontsize=9)
    note(figure, "Dots: every 45° of crank angle from top dead centre.")
    ylabel(left, f"Force across, {unit}")
    for name, values, tint in zip("xyz", moment, _TINTS[1:], strict=False):
        if np.any(values):
            axis, curve = over_turn(turn.state.angle, values)
            right.plot(axis, curve, color=tint, linewidth=1.5, label=f"about {name}")
    right.axhline(0, color="#888888", linewidth=0.8)
    ylabel(right, "Moment, N m")
    crank_axis(right)
    right.set_xticks(range(-180, 181, 90))
    legend_above(right)
    return figure


def vibration_orbits(compressor: Compressor, orbit: Orbit, suspension: Suspension) -> Figure:
    """Settled orbits of the mass centre and of the springs' places on the block, in three planes.

    Dashed: the mass centre as a free body, without springs.
    """
    places = block_points(suspension)
    paths, free = _paths(compressor, orbit, suspension, jnp.stack(list(places.values())))
    paths, free = 1e6 * np.asarray(paths), 1e6 * np.asarray(free)
    figure, (axes,) = new_figure(1, 3, (10.4, 4.0), "Vibration of the suspended compressor", False)
    for ax, (a, b) in zip(axes, ((0, 1), (0, 2), (1, 2)), strict=True):
        for i, name in enumerate(places):
            tint = _TINTS[i % len(_TINTS)]
            ax.plot(paths[i, a], paths[i, b], color=tint, linewidth=1.3, label=words(name))
            ax.plot(paths[i, a, 0], paths[i, b, 0], "o", color=tint, markersize=3.2)
        ax.plot(free[a], free[b], "--", color=_TINTS[0], linewidth=1.0, label="Mass centre, free")
        ax.set_aspect("equal", adjustable="datalim")
        ax.tick_params(labelbottom=True)
        ax.set_xlabel(f"{'xyz'[a]}, µm", fontsize=9)
        ylabel(ax, f"{'xyz'[b]}, µm")
    note(figure, "Dots: time zero of the orbit.")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=7, frameon=False, fontsize=8.5)
    return figure


def free_body_errors(compressor: Compressor, orbit: Orbit, suspension: Suspension) -> Figure:
    """Error of the free-body approximation against the frequency of the suspension.

    The springs are made stiffer and softer together, their damping ratios kept; the ring is the
    suspension as it is.
    """
    places = block_points(suspension)
    factors = np.append(np.geomspace(0.1, 3.0, 41), 1.0)
    errors, highest = _errors(
        compressor, orbit, suspension, jnp.stack(list(places.values())), jnp.asarray(factors)
    )
    ratio, errors = np.asarray(highest) * float(orbit.period) / (2 * np.pi), np.asarray(errors)
    figure, ((ax,),) = new_figure(1, 1, (7.2, 4.2), "Error of the free-body approximation")
    for i, name in enumerate(places):
        tint = _TINTS[i % len(_TINTS)]
        ax.loglog(ratio[:-1], 100 * errors[:-1, i], color=tint, linewidth=1.5, label=words(name))
        ax.loglog(ratio[-1], 100 * errors[-1, i], "o", color=tint, fillstyle="none", markersize=7)
    note(figure, "Rings: the suspension as it is.")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("Highest suspension frequency over running speed", fontsize=9)
    ylabel(ax, "Error in the first harmonic, %")
    legend(ax, loc="upper left")
    return figure


_wrench = eqx.filter_jit(shaking_wrench)


@eqx.filter_jit
def _paths(compressor, orbit, suspension, points):
    load = orbit_load(compressor, orbit, suspension, _HARMONICS)
    time = jnp.linspace(0.0, 1.0, _INSTANTS) * orbit.period
    response, free = harmonic_response(suspension, load), free_body_response(suspension, load)

    def path(answer: Harmonics, point):
        return point_motion(suspension, answer, point).at(time)

    paths = jax.vmap(lambda point: path(response, point))(points)
    return paths, path(free, suspension.mass_centre)


@eqx.filter_jit
def _errors(compressor, orbit, suspension, points, factors):
    load = orbit_load(compressor, orbit, suspension, 1)

    def one(factor):
        other = retuned(suspension, factor)
        errors = jax.vmap(lambda point: free_body_error(other, load, point)[0])(points)
        return errors, jnp.max(natural_frequencies(other))

    return jax.vmap(one)(factors)
