"""Pictures of the shaking force, of the vibration that it makes, and of a balance."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from .._core.display import RPM, axes_words, shown, small_unit, vibration_unit
from ..balancing import Balance
from ..compressor import Compressor
from ..crank import Orbit
from ..rotor import undamped_modes
from ..vibration import Harmonics, Suspension, block_response, orbit_load, shaking_wrench
from ..vibration._block import free_body_error, free_body_response, point_motion
from ..vibration._suspension import block_points, with_scaled_frequencies
from . import _style as style
from ._drawing import draws
from ._fine import fine_turn

_POINTS = (style.INK, *style.TINTS[:6])
_PLANES = ("#0072B2", "#D55E00", "#009E73", "#56437F", "#E69F00", "#56B4E9")
_HARMONICS = 12
_INSTANTS = 361


@draws(orbit=Orbit)
def shaking_force(compressor: Compressor, orbit: Orbit) -> Figure:
    """Locus of the shaking force on the block, and its moments over the revolution.

    Args:
        compressor: whose orbit it is.
        orbit: of `solve_orbit`.
    """
    turn = fine_turn(compressor, orbit)
    force, moment = map(np.asarray, _wrench(compressor, turn.state))
    look = shown("force", "N", force)
    force_x, force_y = look.factor * force[:2]
    figure, (locus, moments) = style.abreast(2, (8.6, 4.0), "Shaking force and moments")
    locus.plot(force_x, force_y, color=style.TINTS[0], linewidth=1.6)
    style.crank_marks(
        locus, np.rad2deg(np.asarray(turn.state.angle)), force_x, force_y, style.TINTS[0]
    )
    style.zero_line(locus)
    locus.axvline(0, color=style.GREY, linewidth=0.8)
    locus.set_aspect("equal", adjustable="datalim")
    locus.set_xlabel(f"Force along x, {look.unit} ")
    locus.set_ylabel(f"Force along y, {look.unit}")
    axes = axes_words(compressor.crankshaft.bank_angle)
    style.note(figure, f"Dots: every 45° of crank angle from top dead centre. {axes}")
    about = {}
    looks = {}
    for name, row in zip("xyz", moment, strict=True):
        if np.any(row):
            about[name] = row
            looks[name] = {"label": f"about {name}"}
    style.turn_curves(moments, turn.state.angle, about, "Moment, N m", looks=looks)
    moments.set_xticks(range(-180, 181, 90))
    style.legend_above(moments)
    return figure


@draws(orbit=Orbit)
def vibration_orbits(compressor: Compressor, orbit: Orbit, suspension: Suspension) -> Figure:
    """Settled orbits of the mass centre and of the springs' places on the block, in three planes.

    Dashed: the mass centre as a free body, without springs.
    """
    places = block_points(suspension)
    paths, free = _paths(compressor, orbit, suspension, jnp.stack(list(places.values())))
    paths = 1e6 * np.asarray(paths)
    free = 1e6 * np.asarray(free)
    figure, axes = style.abreast(3, (10.4, 4.0), "Vibration of the suspended compressor")
    for ax, (a, b) in zip(axes, ((0, 1), (0, 2), (1, 2)), strict=True):
        for i, name in enumerate(places):
            tint = _POINTS[i % len(_POINTS)]
            ax.plot(paths[i, a], paths[i, b], color=tint, linewidth=1.3, label=style.words(name))
            ax.plot(paths[i, a, 0], paths[i, b, 0], "o", color=tint, markersize=3.2)
        ax.plot(free[a], free[b], "--", color=style.INK, linewidth=1.0, label="Mass centre, free")
        ax.set_aspect("equal", adjustable="datalim")
        ax.tick_params(labelbottom=True)
        ax.set(xlabel=f"{'xyz'[a]}, µm", ylabel=f"{'xyz'[b]}, µm")
    words = axes_words(compressor.crankshaft.bank_angle)
    style.note(figure, f"Dots: time zero of the orbit. {words}")
    style.legend_outside(axes[0], "upper right", 7)
    return figure


@draws(orbit=Orbit)
def free_body_errors(compressor: Compressor, orbit: Orbit, suspension: Suspension) -> Figure:
    """Error of the free-body approximation against the frequency of the suspension.

    The springs are made stiffer and softer together, their damping ratios kept; the ring is the
    suspension as it is.
    """
    places = block_points(suspension)
    factors = jnp.append(jnp.geomspace(0.1, 3.0, 41), 1.0)
    points = jnp.stack(list(places.values()))
    errors, highest = _errors(compressor, orbit, suspension, points, factors)
    ratio = np.asarray(highest) * float(orbit.period) / (2 * np.pi)
    errors = 100 * np.asarray(errors)
    figure, ax = style.single((7.2, 4.2), "Error of the free-body approximation")
    for i, name in enumerate(places):
        tint = _POINTS[i % len(_POINTS)]
        ax.loglog(ratio[:-1], errors[:-1, i], color=tint, linewidth=1.5, label=style.words(name))
        ax.loglog(ratio[-1], errors[-1, i], "o", color=tint, fillstyle="none", markersize=7)
    style.note(figure, "Rings: the suspension as it is.")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("Highest suspension frequency over running speed")
    ax.set_ylabel("Error in the first harmonic, %")
    style.legend(ax, loc="upper left")
    return figure


_wrench = eqx.filter_jit(shaking_wrench)


@eqx.filter_jit
def _paths(compressor, orbit, suspension, points):
    load = orbit_load(compressor, orbit, suspension, _HARMONICS)
    time = jnp.linspace(0.0, 1.0, _INSTANTS) * orbit.period
    response = block_response(suspension, load)
    free = free_body_response(suspension, load)

    def path(answer: Harmonics, point):
        return point_motion(suspension, answer, point).at(time)

    paths = jax.vmap(lambda point: path(response, point))(points)
    return paths, path(free, suspension.mass_centre)


@eqx.filter_jit
def _errors(compressor, orbit, suspension, points, factors):
    load = orbit_load(compressor, orbit, suspension, 1)

    def at_factor(factor):
        other = with_scaled_frequencies(suspension, factor)
        errors = jax.vmap(lambda point: free_body_error(other, load, point)[0])(points)
        return errors, undamped_modes(other.rotor, 6).frequency[-1]

    return jax.vmap(at_factor)(factors)


# ---------------------------------------------------------------- balance


@draws(balance=Balance)
def balance_figures(balance: Balance, title: str = "Vibration") -> dict[str, Figure]:
    """All pictures of a balance, by name."""
    return {"vibration": balance_bars(balance, title), "corrections": balance_polar(balance)}


@draws(balance=Balance)
def balance_bars(balance: Balance, title: str = "Vibration") -> Figure:
    """Amplitude of every reading before and after, a panel for each speed."""
    system = balance.influence
    unit, factor = vibration_unit(system.unit)
    speed_of = np.array([row.speed for row in system.rows])
    speeds, counts = np.unique(speed_of, return_counts=True)
    size = (max(6.0, 0.55 * counts.max() + 2), 2.7 * len(speeds) + 0.4)
    figure, axes = style.stacked(len(speeds), size, f"{title}: before and after balancing")
    before = factor * np.abs(system.initial)
    after = factor * np.abs(balance.residual)
    spread = factor * np.linalg.norm(balance.sensitivity(), axis=1)
    for ax, speed in zip(axes, speeds, strict=True):
        rows = np.flatnonzero(speed_of == speed)
        place = np.arange(len(rows))
        ax.bar(place - 0.2, before[rows], 0.4, color="#BBBBBB", label="before")
        ax.bar(place + 0.2, after[rows], 0.4, color="#0072B2", label="after")
        ax.errorbar(place + 0.2, after[rows], spread[rows], fmt="none", ecolor="#D55E00", capsize=2,
                    label="with 1 % and 1° of error in every plane")  # fmt: skip
        labels = [f"{system.rows[i].target}\n{system.rows[i].axis}" for i in rows]
        ax.set_xticks(place, labels, fontsize=7.5)
        ax.set_ylabel(f"{unit} at {speed * RPM:.5g} rpm", color=style.INK)
        ax.set(xlim=(-0.6, max(len(rows), 4) - 0.4), ylim=(0, None))
    style.legend_above(axes[0])
    return figure


def _weights_note(balance: Balance) -> str:
    """Note on the marks of weights, where there are any."""
    if balance.weights is None:
        return ""
    if balance.weights.removed.any():
        return "\nSquares: weights to add; triangles: to take off."
    return "\nSquares: weights to add."


@draws(balance=Balance)
def balance_polar(balance: Balance) -> Figure:
    """Size and place of the corrections, seen along the shaft; 0 is the crank pin's direction."""
    unit, factor = small_unit(balance.influence.trial)
    correction = np.asarray(balance.correction)
    sizes = np.abs(correction) * factor
    angles = np.angle(correction)
    figure, ((ax,),) = style.new_polar_figure(1, 1, f"Corrections to add, {unit}")
    corrections = zip(balance.influence.planes, sizes, angles, strict=True)
    for number, (name, size, angle) in enumerate(corrections):
        label = f"{name}: {size:.4g} at {np.rad2deg(angle):.1f}°"
        ax.plot([angle, angle], [0, size], "o-", color=_PLANES[number % len(_PLANES)], linewidth=2,
                markersize=4, markevery=[1], label=label)  # fmt: skip
    largest = max(*sizes, 1e-12)
    if balance.weights is not None:
        weights = balance.weights
        each = np.where(np.isfinite(weights.unbalance), weights.unbalance, weights.mass) * factor
        for place, (angle, size, removed) in enumerate(
            zip(weights.angle, each, weights.removed, strict=True)
        ):
            tint = _PLANES[int(weights.plane[place]) % len(_PLANES)]
            marker = "v" if removed else "s"
            ax.plot(angle, size, marker, color=tint, fillstyle="none", markersize=7)
        largest = max(largest, *each, 1e-12)
    ax.set_ylim(0, 1.1 * largest)
    ax.yaxis.set_major_locator(MaxNLocator(4))
    style.note(figure, "Angles with the rotation, from the crank pin;\nof measured runs as those of the "
         "trial weights." + _weights_note(balance))  # fmt: skip
    style.legend(ax, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    return figure
