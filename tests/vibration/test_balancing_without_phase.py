"""Balancing by amplitudes alone: published runs, other least squares, mirror images, refusals."""

import numpy as np
import pytest
from scipy import optimize

from jaxcomp import BadInput, SceneError
from jaxcomp.balancing import (
    amplitude_influence,
    balance_each,
    least_squares,
    min_max,
    select,
    with_weights,
)
from jaxcomp.balancing._further_trial import further_trial
from jaxcomp.balancing._influence import InfluenceRow
from jaxcomp.scene.measurements import read_measurements

# "Balancing without phase", reliabilityweb.com: method of four runs, amplitudes in mil.
FOUR_RUNS = """run,target,speed [rpm],amplitude [mil],trial [g],angle [deg]
initial,brg,1800,10,,
T1,brg,1800,7,50,0
T2,brg,1800,12,50,120
T3,brg,1800,18,50,240
"""


def read(tmp_path, text):
    path = tmp_path / "runs.csv"
    path.write_text(text)
    return read_measurements(path)


def rotor(rng, targets, runs, angles=None):
    """Vibration of a random rotor, and the weights of runs: `runs` angles in each plane."""
    planes = len(runs)
    draw = lambda *shape: rng.normal(size=shape) + 1j * rng.normal(size=shape)  # noqa: E731
    initial, matrix = draw(targets), draw(targets, planes)
    weights = np.zeros((1 + sum(runs), planes), complex)
    row = 1
    for plane, count in enumerate(runs):
        for number in range(count):
            angle = 2 * np.pi * (number / count + 0.1 * rng.uniform())
            weights[row, plane] = rng.uniform(0.5, 1.5) * np.exp(1j * angle)
            row += 1
    amplitudes = np.abs(initial + weights @ matrix.T)
    # The mark that nobody sees: phases count from the initial vibration.
    return amplitudes, weights, matrix * np.exp(-1j * np.angle(initial))[:, None]


def system(amplitudes, weights):
    rows = [InfluenceRow(f"t{n}", "ux", 300.0) for n in range(amplitudes.shape[1])]
    planes = [f"p{n}" for n in range(weights.shape[1])]
    return amplitude_influence(amplitudes, weights, rows, planes)


def test_published_runs_give_the_published_weight(tmp_path):
    """59.3 g at 41.7 deg by least squares; 58.8 g by the drawing of three circles."""
    influence = read(tmp_path, FOUR_RUNS)
    balance = balance_each(influence)
    assert influence.trial == "kg"
    assert abs(complex(balance.correction[0])) == pytest.approx(59.3e-3, abs=0.05e-3)
    assert np.angle(balance.correction[0], deg=True) == pytest.approx(41.7, abs=0.05)
    assert balance.alternatives == ()

    def misfit(parts):
        weights = 0.05 * np.exp(1j * np.deg2rad([0, 120, 240]))
        return np.abs(10 + (parts[0] + 1j * parts[1]) * weights) - [7, 12, 18]

    other = optimize.least_squares(misfit, [-100.0, 100.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    expected = -10 / complex(*other.x)
    # both stop where the sum of squares is flat, at half its digits
    assert complex(balance.correction[0]) == pytest.approx(expected, rel=1e-7)
    root_mean_square = np.sqrt(np.mean(misfit(other.x) ** 2))
    assert float(balance.misfit) == pytest.approx(root_mean_square / 10, rel=1e-9)


@pytest.mark.parametrize("runs", [(2,), (3,), (5,), (3, 3), (2, 2)], ids=str)
def test_exact_amplitudes_give_the_rotor_or_have_it_among_the_alternatives(runs):
    for seed in range(10 if len(runs) == 1 else 4):
        amplitudes, weights, matrix = rotor(np.random.default_rng(seed), 2, runs)
        influence = system(amplitudes, weights)
        systems = (influence, *influence.alternatives)
        errors = [np.abs(np.asarray(each.matrix) - matrix).max() for each in systems]
        # exact data: what is left is rounding over the slope where circles touch
        assert min(errors) < 1e-8 * np.abs(matrix).max(), seed
        if min(runs) == 2:
            # two images of each reading, mirrored at the line through the centres
            assert len(systems) >= 4
        for each in systems:
            read_again = np.abs(amplitudes[0] + weights @ np.asarray(each.matrix).T)
            # what repeats within 2 % cannot be told apart
            rms = np.sqrt(np.mean((read_again - amplitudes)[1:] ** 2, axis=0))
            assert np.all(rms <= 0.02 * np.sqrt(np.mean(amplitudes[1:] ** 2, axis=0)))


@pytest.mark.parametrize("runs", [(3,), (4,), (3, 3), (4, 3)], ids=str)
def test_inexact_amplitudes_give_what_another_least_squares_gives(runs):
    """SciPy's trust region from the rotor itself, reading by reading."""
    for seed in range(5):
        rng = np.random.default_rng(100 + seed)
        amplitudes, weights, matrix = rotor(rng, 1, runs)
        noisy = amplitudes * (1 + 0.01 * rng.normal(size=amplitudes.shape))
        influence = system(noisy, weights)
        planes = len(runs)

        def misfit(parts, noisy=noisy, weights=weights, planes=planes):
            coefficients = parts[:planes] + 1j * parts[planes:]
            return np.abs(noisy[0, 0] + weights[1:] @ coefficients) - noisy[1:, 0]

        start = np.concatenate([matrix[0].real, matrix[0].imag])
        other = optimize.least_squares(misfit, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        best = misfit(np.concatenate([np.real(influence.matrix[0]), np.imag(influence.matrix[0])]))
        # never worse than SciPy's, whose start may lie beside the lowest of several minima
        assert np.sum(best**2) <= 2 * other.cost * (1 + 1e-9)
        systems = (influence, *influence.alternatives)
        sums = [len(misfit(start)) * float(each.misfit[0]) ** 2 for each in systems]
        assert min(abs(value - 2 * other.cost) for value in sums) <= 1e-6 * 2 * other.cost


def test_opposite_angles_give_a_choice_of_two_sides(tmp_path):
    truth = 0.0791 * np.exp(1j * np.deg2rad(44.0))
    reads = [float(np.abs(10 - 10 / truth * weight)) for weight in (0.05, -0.05)]
    lines = FOUR_RUNS.splitlines()[:2]
    lines += [f"T1,brg,1800,{reads[0]!r},50,0", f"T2,brg,1800,{reads[1]!r},50,180"]
    balance = balance_each(read(tmp_path, "\n".join(lines)))
    sides = [complex(each.correction[0]) for each in (balance, *balance.alternatives)]
    assert len(sides) == 2
    assert sorted(np.imag(sides)) == pytest.approx([-truth.imag, truth.imag], rel=1e-9)
    np.testing.assert_allclose(np.real(sides), truth.real, rtol=1e-9)
    for method in (least_squares, min_max):
        assert len(balance_each(balance.influence, method).alternatives) == 1
    trial = further_trial(balance.influence, 0.05)
    expected = [abs(10 - 10 / side * trial.weight) for side in sides]
    np.testing.assert_allclose(trial.amplitudes, expected, rtol=1e-9)
    # far beyond what an instrument repeats
    assert abs(np.diff(trial.amplitudes)[0]) > 5


def test_parts_of_such_a_system_keep_their_alternatives():
    amplitudes, weights, _ = rotor(np.random.default_rng(3), 2, (2,))
    influence = system(amplitudes, weights)
    part = select(influence, targets=["t1"])
    assert len(part.alternatives) == len(influence.alternatives) > 0
    assert all(len(each.rows) == 1 for each in part.alternatives)
    on = with_weights(influence, {"p0": 0.3j})
    for before, after in zip(influence.alternatives, on.alternatives, strict=True):
        np.testing.assert_allclose(after.initial, before.vibration(np.array([0.3j])), rtol=1e-14)
    with pytest.raises(BadInput, match="p9"):
        with_weights(influence, {"p9": 1.0})


def test_runs_of_two_planes_with_weights_that_stay_on(tmp_path):
    amplitudes, weights, matrix = rotor(np.random.default_rng(8), 1, (3, 3))
    piled = weights.copy()
    piled[4:] += weights[3]  # the third weight stays
    sizes = np.abs(amplitudes[0, 0] + piled @ matrix[0])
    lines = ["run,plane,target,speed [rpm],amplitude [mm/s],trial [kg m],angle [rad],kept"]
    for run, (size, row) in enumerate(zip(sizes, weights, strict=True)):
        if run == 0:
            lines.append(f"initial,,a,1500,{float(size)!r},,,")
            continue
        plane = int(np.argmax(np.abs(row)))
        trial, angle = float(np.abs(row[plane])), float(np.angle(row[plane]))
        kept = "yes" if run == 3 else "no"
        lines.append(f"r{run},P{plane},a,1500,{float(size)!r},{trial!r},{angle!r},{kept}")
    influence = read(tmp_path, "\n".join(lines))
    assert influence.planes == ("P0", "P1")
    assert influence.trials.runs == ("r1", "r2", "r3", "r4", "r5", "r6")
    systems = (influence, *influence.alternatives)
    assert min(np.abs(np.asarray(each.matrix) - matrix).max() for each in systems) < 1e-8


def test_several_runs_of_a_plane_with_phase_are_averaged(tmp_path):
    rng = np.random.default_rng(4)
    matrix, initial = 2.0 - 1j, 3.0 + 1j
    weights = np.array([1.0, 1j, -1.0, 0.5 - 0.5j])
    read_values = initial + matrix * weights + 0.01 * rng.normal(size=4)
    lines = ["run,plane,target,speed [rpm],amplitude [mm/s],phase [rad],trial [kg m],angle [rad]"]
    lines.append(f"initial,,a,1500,{abs(initial)!r},{float(np.angle(initial))!r},,")
    for number, (value, weight) in enumerate(zip(read_values, weights, strict=True)):
        cells = [float(x) for x in (abs(value), np.angle(value), abs(weight), np.angle(weight))]
        lines.append(f"r{number},top,a,1500,{','.join(map(repr, cells))}")
    influence = read(tmp_path, "\n".join(lines))
    expected = np.vdot(weights, read_values - initial) / np.vdot(weights, weights)
    assert complex(influence.matrix[0, 0]) == pytest.approx(expected, rel=1e-12)
    assert influence.misfit is None


BAD = {
    "one position": ("\n".join(FOUR_RUNS.splitlines()[:3]), "trial.*two angles.*1 in plane"),
    "one angle twice": (
        "\n".join([*FOUR_RUNS.splitlines()[:3], "T2,brg,1800,7.1,50,0"]),
        "trial.*two angles",
    ),
    "nothing to begin with": (FOUR_RUNS.replace("1800,10", "1800,0"), "amplitude.*above 0.*brg"),
    "run-out": (FOUR_RUNS + "run-out,brg,200,1,,\n", "run-out.*phase"),
    "plane left empty": (
        FOUR_RUNS.replace("angle [deg]", "angle [deg],plane").replace(",,\n", ",,,\n")
        .replace(",0\n", ",0,\n").replace(",120\n", ",120,A\n").replace(",240\n", ",240,A\n"),
        "line 3.plane.*empty",
    ),
    "phases of some": (
        FOUR_RUNS.replace("amplitude [mil]", "amplitude [mil],phase [deg]")
        .replace(",10,", ",10,30,").replace(",7,", ",7,,").replace(",12,", ",12,,")
        .replace(",18,", ",18,,"),
        "line 3.phase.*must be a number",
    ),
    "another plane": (
        FOUR_RUNS.replace("angle [deg]", "angle [deg],plane").replace(",,\n", ",,,\n")
        .replace(",0\n", ",0,A\n").replace(",120\n", ",120,A\n").replace(",240\n", ",240,A\n")
        + "T3,brg,1500,18,50,240,B\n",
        "line 6.plane.*differs",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_tables_without_phase_that_say_nothing_are_refused(tmp_path, case):
    text, words = BAD[case]
    with pytest.raises(SceneError, match=words):
        read(tmp_path, text)


def test_a_column_of_empty_phases_is_none(tmp_path):
    text = FOUR_RUNS.replace("amplitude [mil]", "amplitude [mil],phase [deg]")
    for amplitude in (10, 7, 12, 18):
        text = text.replace(f",{amplitude},", f",{amplitude},,")
    assert read(tmp_path, text).misfit is not None
