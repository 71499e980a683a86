"""Problems of textbooks by command: the balance of engines of which only the inertia counts.

Neither gas nor friction takes work of these machines. What their pistons do is known in closed form:
forces and couples by order are compared with those of a fine sampling of the piston's acceleration.
"""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from jaxcomp.cli import app

STROKE_RADIUS, ROD, PISTON, SPEED = 0.05, 0.2, 2.0, 2000 * np.pi / 30
MACHINE = """
name = "{name}"
[mechanism]
type = "slider_crank"
bore = "80 mm"
crank_radius = "50 mm"
conrod_length = "200 mm"
piston_mass = "2 kg"
conrod_mass = "0 kg"
conrod_centre = "0 mm"
conrod_inertia = "0 kg m^2"
[crankshaft]
inertia = "1 kg m^2"
origin = "0 mm"
{throws}
[motor]
{motor}
"""
HELD = 'type = "constant_speed"\nmean_speed = "2000 rpm"'
# Position [mm], angle and banks [degrees] of every throw.
ENGINES = {
    # Rattan, Theory of Machines: in line, cranks at 0, 180, 270 and 90 degrees
    "in-line-four": [(-300, 0, [0]), (-100, 180, [0]), (100, 270, [0]), (300, 90, [0])],
    "radial-three": [(0, 0, [0, 120, 240])],
    "boxer-four": [(-150, 0, [0]), (-50, 180, [180]), (50, 180, [0]), (150, 0, [180])],
    "single": [(0, 0, [0])],
}


def machine_file(folder, name, motor=HELD, extra=""):
    throws = "".join(
        f'[[crankshaft.throws]]\nposition = "{z} mm"\nangle = "{angle} deg"\n'
        f"banks = [{', '.join(f'{bank}' for bank in (f'{chr(34)}{b} deg{chr(34)}' for b in banks))}]\n"
        'unbalance = "0 kg m"\n'
        for z, angle, banks in ENGINES[name]
    )
    file = folder / f"{name}.toml"
    file.write_text(MACHINE.format(name=name, throws=throws, motor=motor) + extra)
    return file


def spectra(name):
    """Two-sided spectra [N] and [N m] of force and couple, from 4096 samples of a revolution."""
    turn = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    order = np.fft.fftfreq(turn.size, 1 / turn.size)
    position = STROKE_RADIUS * np.cos(turn)
    position = position + np.sqrt(ROD**2 - (STROKE_RADIUS * np.sin(turn)) ** 2)
    acceleration = -(order**2) * np.fft.fft(position) / turn.size * SPEED**2
    force, couple = np.zeros((2, turn.size), complex)
    for z, angle, banks in ENGINES[name]:
        for bank in banks:
            lead = np.deg2rad(angle - bank)
            own = -PISTON * acceleration * np.exp(1j * order * lead) * np.exp(1j * np.deg2rad(bank))
            force, couple = force + own, couple + 1e-3 * z * own
    return force, couple


def exact(name):
    """Amplitudes [N] and [N m] of the orders 0 to 6."""
    forward, backward = np.arange(7), -np.arange(7)
    return tuple(np.abs(f[forward]) + np.abs(f[backward]) for f in spectra(name))


def ran(*arguments):
    done = CliRunner().invoke(app, ["run", *map(str, arguments)])
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.mark.parametrize("name", ENGINES)
def test_forces_and_couples_by_order_are_exact(tmp_path, name):
    result = json.loads(ran(machine_file(tmp_path, name), "--json"))
    assert "torque_fluctuation" not in result  # its mean is rounding
    force, couple = exact(name)
    size = PISTON * STROKE_RADIUS * SPEED**2
    for told, own, scale in (("force [N]", force, size), ("couple [N m]", couple, 0.3 * size)):
        found = {int(n): value for n, value in result[f"shaking_{told}"].items()}
        # of the force of a single piston: rounding, and what six to eight nodes leave of order 6
        assert found == pytest.approx({n: own[n] for n in found}, rel=0, abs=1e-10 * scale)


def test_the_couples_are_those_of_the_book(tmp_path):
    """Rattan's problem: 1240.7 and, by the two-term formula of the book, 877.3 N m (891.4 exactly)."""
    couple = exact("in-line-four")[1]
    assert couple[1] == pytest.approx(1240.687, abs=1e-3)
    assert couple[2] == pytest.approx(891.423, abs=1e-3)
    assert exact("in-line-four")[0][4] == pytest.approx(71.905, abs=1e-3)


@pytest.mark.parametrize("kind", ["constant_speed", "mean_speed"])
def test_tables_leave_out_what_has_no_meaning(tmp_path, kind):
    text = ran(machine_file(tmp_path, "boxer-four", HELD.replace("constant_speed", kind)))
    assert "no efficiency has a meaning" in " ".join(text.split())  # however long a line is
    assert "Torque fluctuation" not in text
    assert "-0" not in [word for line in text.splitlines() for word in line.split()]


FRICTION = (
    '[friction]\ntype = "slider_crank"\n[friction.wall]\ntype = "coulomb"\ncoefficient = 0.02\n'
)


@pytest.mark.parametrize("extra", ["", FRICTION], ids=["inertia alone", "friction"])
def test_a_held_speed_is_verified(tmp_path, extra):
    """The march has nothing to integrate but the works: they agree with those of the orbit."""
    # the programs without and with friction are those of the tests above and below
    file = machine_file(tmp_path, "in-line-four", extra=extra)
    result = json.loads(ran(file, "--json", "--verify"))
    march = result["verification"]
    assert march["speed"] < 1e-12
    for name, error in march["losses"].items():
        # the wall's load reverses in mid-stroke, where the march has no edge
        assert abs(error) <= 1e-6 * result["losses [J]"][name]


def test_a_force_that_passes_through_zero_has_the_peak_of_its_size(tmp_path):
    """Four forces of 5.5 kN leave 72 N in the main journal, whose size turns sharply at every zero."""
    nearly_smooth = FRICTION.replace("0.02", "1e-6")
    result = json.loads(ran(machine_file(tmp_path, "in-line-four", extra=nearly_smooth), "--json"))
    force = spectra("in-line-four")[0]
    # between two samples the largest is 4 pi / 4096 away at most: 5e-6 of it; friction adds 5e-3 N
    largest = np.max(np.abs(np.fft.ifft(force) * force.size))
    assert result["peak_forces [N]"]["main_journal"] == pytest.approx(largest, rel=1e-5)


@pytest.mark.slow  # draws a dozen pictures: half a minute
def test_a_held_speed_is_reported(tmp_path):
    machine = machine_file(tmp_path, "in-line-four", extra=FRICTION)
    ran(machine, "--out", tmp_path / "results")
    files = {file.name for file in (tmp_path / "results").iterdir()}
    assert {"report.html", "curves.csv", "torques.png", "speed.png", "result.json"} <= files
