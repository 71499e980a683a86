"""Moving pictures: what they draw is the machine, its arrows are the forces, its frames are in time."""

import io
import types

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from jaxcomp import Collocation, solve_orbit
from jaxcomp.cli import app
from jaxcomp.mechanism import SliderLink
from jaxcomp.plot import gif
from jaxcomp.plot._animate import Motion, _even_in_time, journal_motion, mechanism_motion
from jaxcomp.plot._fine import fine_turn
from jaxcomp.plot._mechanism import Sketch, sketch
from jaxcomp.plot._rotor_motion import balance_motion
from jaxcomp.rotor import Disks, Link, Mount, RotorModel, ShaftElements, Unbalances, respond
from jaxcomp.rotor._bodies import RigidBody
from jaxcomp.scene import load, loads, start, with_value, with_values

# compiles fast; pictures need no more
SOLVER = Collocation(nodes=10, reversals=0, tolerance=1e-8, estimate=False)


@pytest.fixture(
    scope="module", params=["slider-crank", pytest.param("slider-link", marks=pytest.mark.slow)]
)
def turning(request):
    """A machine of either drive with its turn; the journals of the slider-link by closed formulas."""
    scene = loads(start(request.param, "m"))
    if isinstance(scene.compressor.mechanism, SliderLink):
        shaft = [f"crankshaft.main_journal.bearings.{place}" for place in (0, 1)]
        scene = with_values(scene, {f"{one}.film": "fit" for one in ("friction.crank_pin", *shaft)})
    orbit = solve_orbit(scene.compressor, SOLVER)
    return scene.compressor, orbit, fine_turn(scene.compressor, orbit)


def drawn(turning, degrees) -> Sketch:
    machine, _, turn = turning
    return sketch(machine, turn, np.deg2rad(degrees))


@pytest.mark.parametrize("degrees", [0.0, 70.0, 180.0, 250.0])
def test_links_keep_their_lengths(turning, degrees):
    machine, _, _ = turning
    lines = drawn(turning, degrees).lines
    length = lambda line: np.hypot(*(line[:, 1] - line[:, 0]))  # noqa: E731
    assert length(lines["crank"]) == pytest.approx(float(machine.mechanism.crank_radius))
    height = np.ptp(lines["piston"][1])
    assert height == pytest.approx(float(machine.mechanism.bore))
    if "rod" in lines:
        assert length(lines["rod"]) == pytest.approx(float(machine.mechanism.conrod_length))


def test_piston_moves_by_the_stroke_and_stays_in_the_cylinder(turning):
    machine, _, _ = turning
    top, bottom = drawn(turning, 0.0).lines, drawn(turning, 180.0).lines
    crown = [lines["piston"][0].max() for lines in (top, bottom)]
    assert crown[0] - crown[1] == pytest.approx(float(machine.mechanism.stroke))
    assert crown[0] <= top["cylinder"][0].max() + 1e-9


def test_arrows_are_in_balance(turning):
    """At top dead centre of a turn that is nearly even: gas, inertia and joints along x."""
    machine, orbit, _ = turning
    arrows = drawn(turning, -1.0 % 360).arrows
    pressure = np.asarray(orbit.pressure).max() - float(machine.gas.behind_piston)
    gas = pressure * float(machine.mechanism.piston_area)
    # the gas pushes the piston away from the head; the discharge pressure holds at the dead centre
    np.testing.assert_allclose(arrows["gas"].force, [-gas, 0.0], rtol=1e-3, atol=1e-9)
    names = ("main_journal",) if "main_journal" in arrows else ("upper_bearing", "lower_bearing")
    held = sum(arrows[name].force for name in names)
    # the bearings hold the crank against the gas, less the inertia of what moves (a fifth here)
    assert held[0] == pytest.approx(gas, rel=0.25)
    assert abs(held[1]) < 0.2 * gas


def test_frames_are_even_in_time_and_not_in_angle(turning):
    _, _, turn = turning
    angles = _even_in_time(turn, 400)
    speed = np.interp(angles, turn.state.angle, turn.state.speed)
    steps = np.diff(angles, append=angles[0] + 2 * np.pi)
    # angle a step over speed is one time for all; the trapezoid between 400 frames is good to 1e-3
    between = (speed + np.roll(speed, -1)) / 2
    np.testing.assert_allclose(steps / between, (steps / between).mean(), rtol=2e-3)
    assert np.ptp(steps) > 0.01 * steps.mean()


def test_arrows_in_the_picture_are_scaled_to_the_largest(turning):
    machine, orbit, turn = turning
    motion = mechanism_motion(machine, orbit, frames=8)
    reach = 2.2 * float(machine.mechanism.crank_radius)
    longest = []
    for frame in range(8):
        motion.show(frame)
        tips = [t for t in motion.figure.axes[0].texts if getattr(t, "arrow_patch", None)]
        lengths = [np.hypot(*np.subtract(t.xy, t.get_position())) for t in tips]
        now = sketch(machine, turn, _even_in_time(turn, 8)[frame])
        forces = [np.hypot(*arrow.force) for arrow in now.arrows.values()]
        np.testing.assert_allclose(np.array(lengths) / max(lengths), np.array(forces) / max(forces))
        longest.append(max(lengths))
    assert max(longest) == pytest.approx(reach)


def moving(frames=3):
    """A dot that moves."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2, 1))
    (dot,) = figure.subplots().plot([0], [0], "o")
    return Motion(figure, lambda n: dot.set_data([n], [0]) or dot.axes.set_xlim(-1, 4), frames)


def test_gif_has_all_frames_and_they_differ():
    image = Image.open(io.BytesIO(gif(moving())))
    assert image.n_frames == 3
    frames = []
    for number in range(3):
        image.seek(number)
        frames.append(np.asarray(image.convert("L"), float))
    assert all(np.abs(frames[0] - other).max() > 50 for other in frames[1:])


@pytest.fixture(scope="module")
def spinning():
    """A shaft with a disk, its two bearings in a housing on a mount, and an unbalance."""
    shaft = ShaftElements(
        nodes=(1, 2, 3), length=0.1, outer_diameter=0.02, young_modulus=2e11, density=7800.0, poisson=0.3
    )  # fmt: skip
    bearing, mount = (
        Mount([1e7, 1e7], [500.0, 500.0]),
        Mount([1e5, 1e5], [200.0, 200.0], [800.0, 800.0], [2.0, 2.0]),
    )
    model = RotorModel(
        shafts=(shaft,),
        disks=(Disks((2,), 2.0, 1e-3, 2e-3),),
        links=(
            Link((1, "a"), bearing),
            Link((3, "b"), bearing),
            Link(("m", None), mount, ("ux", "uy", "thx", "thy")),
        ),
        bodies=(
            RigidBody("housing", ("a", "b", "m"), [[0, 0, -0.1], [0, 0, 0.1], [0, 0, 0.0]], 5.0,
                      np.diag([0.05, 0.05, 0.03])),
        ),
    )  # fmt: skip
    speeds = jnp.array([300.0])
    before = respond(model, (Unbalances((2,), 1e-4, 0.0),), speeds)
    after = respond(model, (Unbalances((2,), 2e-5, 0.0),), speeds)
    return model, before, after


@pytest.mark.slow
def test_balance_picture_exaggerates_by_the_factor_it_names(spinning):
    model, before, after = spinning
    motion = balance_motion(model, before, after, frames=4)
    title = motion.figure.get_suptitle()
    factor = float(title.split(", ")[1].split(" times")[0].replace(",", ""))
    assert factor > 100
    motion.show(0)
    axes = motion.figure.axes
    for ax, response in zip(axes, (before, after), strict=True):
        x = np.asarray(response.displacement)[0, 0, :, 0]
        rotor = next(line for line in ax.lines if line.get_label() == "rotor")
        moved = np.asarray(rotor.get_xdata())
        np.testing.assert_allclose(moved, 1e3 * factor * x[:3].real, atol=1e-6)
        housing = next(line for line in ax.lines if line.get_label() == "housing")
        rest = ax.lines[0]  # drawn behind it
        shift = np.asarray(housing.get_xdata()) - np.asarray(rest.get_xdata())
        place = np.asarray(rest.get_ydata())
        # the corners stand at the height of the bushes "a" and "b" and move as they do
        names = [1, 2, 3, "housing", "a", "b", "m"]
        for z, node in ((place.min(), "a"), (place.max(), "b")):
            want = 1e3 * factor * x[names.index(node)].real
            np.testing.assert_allclose(shift[place == z], want, atol=1e-6)
    largest = 1e6 * np.abs(np.asarray(after.displacement)[..., 0]).max()
    assert f"at most {largest:.3g} µm" in axes[1].get_title(loc="left")


def test_a_mechanism_that_nobody_has_drawn_is_refused(turning):
    _, _, turn = turning
    odd = types.SimpleNamespace(
        mechanism=types.SimpleNamespace(piston=lambda angle: (angle, angle, angle)), gas=None
    )
    with pytest.raises(TypeError, match="no drawing"):
        sketch(odd, turn, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "pictures"),
    [("hermetic-68cc", {"mechanism", "balance"}), ("slider-link-8cc", {"mechanism"})],
)
def test_command_writes_small_pictures_and_a_report(machine, pictures, tmp_path):
    done = CliRunner().invoke(app, ["animate", machine, "--out", str(tmp_path), "--frames", "24"])
    assert done.exit_code == 0, done.stderr
    written = {file.stem: file for file in tmp_path.glob("*.gif")}
    assert set(written) == pictures
    for file in written.values():
        assert file.stat().st_size < 1_000_000  # goes by mail
        assert Image.open(file).n_frames == 24
    page = (tmp_path / "report.html").read_text("utf-8")
    assert page.count("data:image/gif") == len(pictures)
    # moving pictures have no hover: an interactive page would be empty
    assert not (tmp_path / "interactive.html").exists()


def test_frames_out_of_range_are_refused(tmp_path):
    words = ["animate", "mayekawa-wbhe", "--out", str(tmp_path), "--frames", "2"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert "must be >= 4 and <= 360" in done.stderr


def test_journals_move_in_their_clearances():
    """Dots lie within the circle, on the path, and the cursor is at the crank angle of the frame."""
    scene = with_value(
        load("mayekawa-wbhe"), "friction.crank_pin",
        {"type": "film", "motion": "orbit", "diameter": "90 mm", "length": "45 mm",
         "radial_clearance": "45 um", "dynamic_viscosity": "10 mPa s"},
    )  # fmt: skip
    solver = Collocation(nodes=8, reversals=0, tolerance=1e-6, estimate=False)
    orbit = solve_orbit(scene, solver)
    motion = journal_motion(scene.as_compressor(), orbit, frames=8)
    above = motion.figure.axes[0]
    dot = above.lines[-1]
    places = []
    for frame in range(8):
        motion.show(frame)
        places.append([float(x[0]) for x in dot.get_data()])
    assert np.all(np.hypot(*np.transpose(places)) < 1)
    path = np.asarray(orbit.positions["crank_pin"])
    # a dot lies on the line between two nodes
    steps = np.hypot(*np.diff(path, axis=1, append=path[:, :1]))
    away = [np.min(np.hypot(path[0] - x, path[1] - y)) for x, y in places]
    assert np.max(away) <= 0.5 * steps.max() + 1e-12
    assert len({tuple(place) for place in places}) == 8
