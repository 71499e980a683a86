"""Pictures: what they show, and that they leave matplotlib's state alone."""

import io
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from jaxcomp import Collocation, plot, solve_orbit
from jaxcomp._core.display import shown
from jaxcomp.compressor import compressor_of
from jaxcomp.plot._bearings import bearing_loads
from jaxcomp.plot._crank import (
    crank_torques,
    joint_forces,
    joint_friction,
    loss_shares,
    orbit_figures,
    speed_over_turn,
)
from jaxcomp.plot._fine import fine_turn
from jaxcomp.plot._identified import _pairs
from jaxcomp.plot._rotor import _highest_shown
from jaxcomp.plot._style import (
    bars,
    crank_marks,
    legend_above,
    legend_outside,
    over_turn,
    plain_number,
    single,
)
from jaxcomp.plot._vibration import shaking_force
from jaxcomp.scene import load, with_values
from jaxcomp.vibration import shaking_wrench


@pytest.fixture(scope="module")
def machine():
    return load("mayekawa-wbhe").compressor


@pytest.fixture(scope="module")
def orbit(machine):
    return solve_orbit(machine, Collocation())


def curve(figure, axis=0, line=0):
    return figure.axes[axis].lines[line].get_xydata().T


def test_all_pictures_are_labelled_and_can_be_saved(machine, orbit, tmp_path):
    figures = orbit_figures(machine, orbit)
    assert list(figures) == [
        "pv_diagram",
        "speed",
        "torques",
        "joint_forces",
        "bearing_loads",
        "joint_friction",
        "losses",
        "shaking_force",
    ]
    for name, figure in figures.items():
        for ax in figure.axes:
            polar = name == "bearing_loads"
            assert ax.get_title(loc="left") if polar else ax.get_ylabel() or name == "losses", name
        assert polar or any(ax.get_xlabel() for ax in figure.axes), name
        figure.savefig(tmp_path / f"{name}.png", dpi=60)
        assert (tmp_path / f"{name}.png").stat().st_size > 4000


def test_area_of_the_indicator_diagram_is_the_gas_work(machine, orbit):
    volume, pressure = curve(plot.pv_diagram(machine, orbit))
    assert volume.min() == pytest.approx(0, abs=1e-3)
    assert volume.max() == pytest.approx(1327, rel=1e-5)
    area = abs(np.trapezoid(pressure * 1e6, volume * 1e-6))
    assert area == pytest.approx(float(orbit.energy.gas_work), rel=1e-3)


def test_both_ends_of_double_acting_cylinders_are_drawn():
    """Head end and crank end of both stages; what they enclose is the work of the gas."""
    compressor = compressor_of(load("two-stage-crosshead"))
    # where loads reverse in mid-stroke is nothing to the gas
    orbit = solve_orbit(compressor, Collocation(reversals=0))
    (ax,) = plot.pv_diagram(compressor, orbit).axes
    labels = [line.get_label() for line in ax.lines]
    assert labels == [
        "Cylinder 1, head end",
        "Cylinder 1, crank end",
        "Cylinder 2, head end",
        "Cylinder 2, crank end",
    ]
    areas = [abs(np.trapezoid(line.get_ydata(), line.get_xdata())) for line in ax.lines]
    assert sum(areas) == pytest.approx(float(orbit.energy.gas_work), rel=1e-3)


def test_fine_turn_agrees_with_the_nodes(machine, orbit):
    turn = fine_turn(machine, orbit)
    angle = np.asarray(turn.state.angle)
    assert angle.size > 700
    for fine, coarse, size in [
        (turn.state.speed, orbit.state.speed, 1e-4),
        (turn.state.acceleration, orbit.state.acceleration, 2.0),
        (turn.loads.forces["crank_pin"][1], orbit.loads.forces["crank_pin"][1], 10.0),
        (turn.loads.loss_torque["crank_pin"], orbit.loads.loss_torque["crank_pin"], 0.02),
    ]:
        assert fine.shape == angle.shape
        inner = (orbit.state.angle > angle[0]) & (orbit.state.angle < angle[-1])
        at_nodes = np.interp(orbit.state.angle, angle, fine)
        # straight lines between half a degree of angle, and jumps at the kinks, are the difference
        error = np.abs(at_nodes - coarse)[inner]
        assert np.median(error) < size


def test_speed_stays_within_its_extremes(machine, orbit):
    _, speed = curve(speed_over_turn(machine, orbit))
    assert speed.max() == pytest.approx(float(orbit.highest_speed) * 30 / np.pi, rel=1e-5)
    assert speed.min() == pytest.approx(float(orbit.lowest_speed) * 30 / np.pi, rel=1e-5)


def test_torques_add_up_to_the_inertia_of_the_crankshaft(machine, orbit):
    figure = crank_torques(machine, orbit)
    curves = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines[:5]}
    assert set(curves) == {
        "Motor",
        "Gas",
        "Friction",
        "Inertia of the piston",
        "Inertia of the rod",
    }
    state = fine_turn(machine, orbit).state
    _, rise = over_turn(state.angle, state.acceleration)
    expected = float(machine.crankshaft.inertia) * rise
    np.testing.assert_allclose(sum(curves.values()), expected, atol=1e-6 * np.abs(expected).max())


def test_joint_forces_peak_where_the_paper_has_its_peak(machine, orbit):
    """Tsuji et al. (2012), Section 3.2: sharp peak at -35 degrees."""
    figure = joint_forces(machine, orbit)
    names = [line.get_label() for line in figure.axes[0].lines]
    degrees, force = curve(figure, 0, names.index("Piston pin"))
    assert degrees[np.argmax(force)] == pytest.approx(-35, abs=1.0)
    degrees, side = curve(figure, 1)
    assert degrees[np.argmax(np.abs(side))] == pytest.approx(-35, abs=1.0)


def test_polar_loads_are_those_of_the_bearings(machine, orbit):
    figure = bearing_loads(machine, orbit)
    crank_pin, main = (ax.lines[0].get_xydata().T for ax in figure.axes)
    forces = fine_turn(machine, orbit).loads.forces
    for (direction, size), force in (
        (crank_pin, forces["crank_pin"]),
        (main, -forces["main_journal"]),  # the joint reports the force on the shaft
    ):
        drawn = 1e3 * size * np.stack([np.cos(direction), np.sin(direction)])
        np.testing.assert_allclose(drawn, force, atol=1e-6)  # rounding of 50 kN
    # the gas presses the shaft away from the head, so the bearing is loaded on that side
    assert np.cos(main[0][np.argmax(main[1])]) < -0.9


def test_locus_of_the_shaking_force(machine, orbit):
    figure = plot.shaking_force(machine, orbit)
    locus = figure.axes[0].lines[0].get_xydata().T * 1e3
    force = shaking_wrench(machine, orbit.state).force
    # the largest node misses the largest of the curve by less than the curve bends in between
    np.testing.assert_allclose(np.abs(locus).max(axis=1), np.abs(force[:2]).max(axis=1), rtol=2e-3)
    assert len(figure.axes[1].lines) == 3  # about z alone, and the two zero lines
    assert figure.get_supxlabel().endswith("x: along the cylinder towards the head; y: across.")


def test_friction_torques_are_those_of_coulomb(machine, orbit):
    figure = joint_friction(machine, orbit)
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles == ["Piston pin", "Crank pin", "Main journal", "Wall"]
    force = np.hypot(*fine_turn(machine, orbit).loads.forces["main_journal"]).max()
    assert curve(figure, 2)[1].max() == pytest.approx(0.013 * 0.046 * force, rel=1e-9)


def test_loss_bars_are_the_losses(machine, orbit):
    bars = loss_shares(orbit).axes[0].patches
    widths = sorted(bar.get_width() for bar in bars)
    assert widths == pytest.approx(sorted(float(x) for x in orbit.energy.losses.values()))


NOTHING = {"friction": None, "crankshaft.main_journal": None, "gas": None}


def test_absent_parts_have_no_picture():
    bare = with_values(load("mayekawa-wbhe"), NOTHING).compressor
    orbit = solve_orbit(bare, Collocation())
    names = ["speed", "torques", "joint_forces", "bearing_loads", "shaking_force"]
    assert list(orbit_figures(bare, orbit)) == names
    with pytest.raises(ValueError, match="needs a compressor with gas"):
        plot.pv_diagram(bare, orbit)
    for picture in (orbit.plot.journal_paths, orbit.plot.journal_films_over_turn):
        with pytest.raises(ValueError, match="needs a journal with an oil film"):
            picture(bare)
    with pytest.raises(ValueError, match="needs a joint with friction"):
        joint_friction(bare, orbit)
    with pytest.raises(ValueError, match="needs a joint with friction"):
        loss_shares(orbit)


def test_curves_close_at_both_ends():
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False) + 0.1
    degrees, sine = over_turn(angle, np.sin(angle))
    assert degrees[0] < -180 < degrees[1] < degrees[-2] < 180 < degrees[-1]
    np.testing.assert_allclose(sine, np.sin(np.deg2rad(degrees)), atol=1e-12)


def test_a_quantity_that_no_variable_moves_has_a_histogram_of_one_bar():
    """A hundred equal numbers but for their last digit, between which no ten bars fit."""
    values = np.full(100, 0.1)
    values[::2] = np.nextafter(0.1, 1.0)
    with pytest.raises(ValueError, match="Too many bins"):
        np.histogram(values, 10)
    assert np.histogram(values, bars(values, 10))[0].sum() == 100
    assert bars(np.linspace(1.0, 1.1, 50), 10) == 10


@pytest.mark.parametrize("bounded", [True, False])
def test_ellipses_of_constants_stay_inside_what_was_allowed(bounded):
    """A gap of 5 um, known to 80 um, that was allowed from 1 to 20 um."""
    estimate, error = np.array([5e-6, 1.2]), np.array([80e-6, 0.1])
    bounds = np.array([[1e-6, 20e-6], [-np.inf, np.inf]])
    found = SimpleNamespace(
        parameters=("gas.leakage.gap", "flow_factor"), units=("m", ""), estimate=estimate,
        standard_error=error, covariance=np.outer(error, error) * [[1.0, -0.9], [-0.9, 1.0]],
        bounds=bounds if bounded else None,
    )  # fmt: skip
    ellipse, point = _pairs(found, "machine").axes[0].lines
    x, y = 1e-6 * ellipse.get_xdata(), ellipse.get_ydata()  # drawn in micrometres
    assert point.get_xdata() == pytest.approx(5)
    if not bounded:
        assert x.min() < -100e-6
        return
    assert (x.min(), x.max()) == (pytest.approx(1e-6, rel=1e-9), pytest.approx(20e-6, rel=1e-9))
    # nothing that was not in the ellipse
    away = np.stack([x, y]) - estimate[:, None]
    square = np.sum(away * np.linalg.solve(found.covariance, away), axis=0)
    assert np.all(square <= 5.991 * (1 + 1e-9))
    # along the bounds it is cut, elsewhere it is the ellipse
    inside = (x > 1e-6 * (1 + 1e-9)) & (x < 20e-6 * (1 - 1e-9))
    assert np.allclose(square[inside], 5.991, rtol=1e-2)  # chords of 181 points
    assert (x[0], y[0]) == (x[-1], y[-1])


@pytest.mark.parametrize(
    ("value", "text"),
    [(1700.0, "1700"), (1698.0, "1700"), (232.56, "233"), (8.938, "8.94"), (-12345.0, "-12300")],
)
def test_labels_of_bars_write_their_powers_of_ten_out(value, text):
    assert plain_number(value) == text


def test_a_campbell_diagram_has_room_for_its_modes():
    spin = 50.0
    # stiff rotors: all modes lie far above twice the speed, the first four are shown
    high = np.array([[400.0, 500.0, 700.0, 900.0, 3000.0]] * 2)
    assert 900 < _highest_shown(high, spin) < 1200
    # soft mounts: all modes lie below the speed, which is shown
    low = np.array([[3.0, 4.0, 8.0], [3.0, 5.0, 9.0]])
    assert _highest_shown(low, spin) == pytest.approx(1.15 * spin)
    # as before where modes lie on either side
    both = np.array([[20.0, 40.0, 60.0, 80.0, 3000.0]] * 2)
    assert _highest_shown(both, spin) == pytest.approx(1.3 * 2 * spin)
    assert _highest_shown(np.full((2, 3), np.nan), spin) == pytest.approx(1.3 * 2 * spin)


def covered(ax, line, words="°"):
    """Texts with some words, as numbers of crank angles have, whose boxes cover a curve as drawn."""
    ax.figure.savefig(io.BytesIO(), format="png")
    points = ax.transData.transform(line.get_xydata())
    points = np.concatenate(
        [points + k / 8 * (np.roll(points, -1, axis=0) - points) for k in range(8)]
    )
    return [
        text.get_text()
        for text in ax.texts
        if words in text.get_text() and text.get_window_extent().count_contains(points)
    ]


def test_numbers_of_crank_angles_stand_beside_their_curves(machine, orbit):
    figures = [
        bearing_loads(machine, orbit),
        shaking_force(machine, orbit),
    ]
    axes = [ax for figure in figures for ax in figure.axes if ax.texts]
    assert len(axes) == 3
    for ax in axes:
        assert len([text for text in ax.texts if text.get_text().endswith("°")]) >= 2
        assert covered(ax, ax.lines[0]) == []


def test_numbers_of_crank_angles_stand_beside_a_thin_loop():
    """A loop as thin as that of a crank pin, whose numbers stood on it."""
    figure, ax = single((4, 4), "loads")
    angle = np.linspace(0, 2 * np.pi, 721)
    x, y = 100 * np.cos(angle) + 80, 4 * np.sin(angle)
    ax.plot(x, y)
    ax.set_aspect("equal", adjustable="datalim")
    crank_marks(ax, np.rad2deg(angle), x, y, "black")
    assert covered(ax, ax.lines[0]) == []
    boxes = [text.get_window_extent() for text in ax.texts]
    assert len(boxes) == 4
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert all(figure.bbox.fully_contains(*corner) for box in boxes for corner in box.corners())


def test_the_work_is_written_beside_the_indicator_diagram(orbit):
    """Of a low pressure ratio, whose expansion the words covered."""
    changes = {"gas.clearance_ratio": 0.25, "gas.discharge_pressure": "0.2 MPa"}
    machine = with_values(load("mayekawa-wbhe"), changes).compressor
    (ax,) = plot.pv_diagram(machine, orbit).axes
    for line in ax.lines[:1]:
        assert covered(ax, line, "Work on the gas") == []


@pytest.mark.parametrize("outside", [False, True])
def test_no_legend_is_wider_than_its_picture(outside):
    figure, ax = single((5, 3), "names")
    for number in range(7):
        ax.plot([0, number], label=f"joint of a rather long name {number}")
    if outside:
        legend_outside(ax, "upper right", 7)
    else:
        legend_above(ax)
    figure.savefig(io.BytesIO(), format="png")
    box = (figure.legends[0] if outside else ax.get_legend()).get_window_extent()
    assert figure.bbox.fully_contains(box.x0, box.y0)
    assert figure.bbox.fully_contains(box.x1, box.y1)


def test_shares_differ_in_points():
    look = shown("mechanical_efficiency", "", 0.91)
    assert look.text(0.91, 3) == "91 %"
    assert look.difference(0.00426, 3) == "0.426 points"
    assert shown("motor_power", "W", 5e3).difference(100.0, 3) == "0.1 kW"
