"""Machines: the optimal bore of Tsuji et al. (2012), Fig. 6; locked joints; balancing."""

import dataclasses

import numpy as np
import pytest
import scipy.optimize

from jaxcomp import Collocation, load, optimise, problem
from jaxcomp.scene import with_value
from jaxcomp.study import AnalysisOptions
from jaxcomp.study._goal import goal_of
from jaxcomp.study._problem import solved

# Without panel edges at the load reversals: a third of the time to compile, 1e-5 of the efficiency.
FAST = Collocation(nodes=12, reversals=0, tolerance=1e-10)
SPEEDS = (800, 1000, 1200)
RANGE = (0.100, 0.160)
CLOSE = 1e-4  # [m] 0.1 mm


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


def bore_problem(scene, rpm, solver=FAST):
    changed = with_value(scene, "motor.mean_speed", f"{rpm} rpm")
    return problem(
        changed,
        {"bore_at_displacement": RANGE},
        ["mechanical_efficiency"],
        AnalysisOptions(solver=solver),
    )


def swept(made, bores):
    return np.asarray(solved(made, np.reshape(bores, (-1, 1)), 8).values)[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("rpm", SPEEDS)
def test_optimal_bore_from_any_start_is_that_of_a_sweep(scene, rpm):
    made = bore_problem(scene, rpm)
    ends = [[0.1], [0.16], [0.11], [0.15], [0.12], [0.13], [0.14], [0.145]]
    found = optimise(made, starts=ends)
    made = goal_of(made, None, None, None).problem  # the same without ranges, compiled already
    bores = np.linspace(*RANGE, 601)  # 0.1 mm
    sweep = swept(made, bores)
    best = float(bores[np.argmax(sweep)])
    assert abs(found.values["bore_at_displacement"] - best) < CLOSE
    # the published optima, on a grid of 10 mm
    assert (
        round(found.values["bore_at_displacement"], 2) == {800: 0.12, 1000: 0.13, 1200: 0.14}[rpm]
    )
    assert found.objective >= sweep.max() - 1e-9
    assert {start.status for start in found.starts} == {"converged"}
    assert found.agreeing == 8
    assert max(start.steps for start in found.starts) <= 20  # of 601 designs for the same answer
    assert found.maximised
    # without derivatives, by SciPy's bounded scalar search
    scalar = scipy.optimize.minimize_scalar(
        lambda bore: -float(swept(made, bore)[0]), bounds=RANGE, method="bounded",
        options={"xatol": 1e-6},
    )  # fmt: skip
    # Its optimum is that of values, which the solver's grid roughens by 2e-7: 0.05 mm of a flat top.
    assert abs(found.values["bore_at_displacement"] - scalar.x) < CLOSE


@pytest.mark.slow  # compiles for a minute
@pytest.mark.parametrize("rpm", SPEEDS)
def test_optimal_bore_is_that_of_the_default_solver(scene, rpm):
    fast, fine = (optimise(bore_problem(scene, rpm, s), samples=16) for s in (FAST, None))
    assert abs(fast.values["bore_at_displacement"] - fine.values["bore_at_displacement"]) < CLOSE
    assert fine.status == "converged"


@pytest.mark.slow  # a search of its own; failed designs of a batch are in the ordinary run
def test_locked_joints_are_rejected_and_not_fatal(scene):
    """The least efficient bore of a machine whose crank pin locks all wide ones: at the edge of it."""
    rough = with_value(scene, "friction.crank_pin.coefficient", 4.0)
    made = bore_problem(rough, 1000)
    bore = made.variables[0]._replace(low=0.112)  # narrower ones are less efficient still
    made = dataclasses.replace(made, variables=(bore,))
    found = optimise(made, maximise=False, samples=64)
    assert 0 < found.sample.ok.sum() < len(found.sample.ok)
    assert not np.concatenate([start.solved for start in found.starts]).all()
    # every design that was accepted can be solved, and the last is as good as any that can
    kept = goal_of(made, None, False, None).problem
    accepted = np.concatenate([start.path[:, 0] for start in found.starts])
    # by the program of the search: at the edge the rounding of another one decides otherwise
    assert np.all(np.asarray(solved(kept, np.unique(accepted)[:, None], 1).ok))
    assert not found.local
    assert found.objective <= found.sample.objective[found.sample.ok].min() + 1e-5
    assert "converged" not in {s.status for s in found.starts if s.agrees}


@pytest.mark.slow
def test_balance_of_a_rotor_is_least_squares():
    """Gradients over four correction components against the closed solution of the same problem."""
    scene = load("hermetic-68cc")
    names = [
        f"corrections.{plane.name}.{axis}"
        for plane in scene.parts["balancing"].planes
        for axis in "xy"
    ]
    made = problem(
        scene, dict.fromkeys(names, (-3e-3, 3e-3)), ["vibration", "balanced_vibration"],
        AnalysisOptions(excitation="file"),
    )  # fmt: skip
    found = optimise(made, starts=2, samples=16)
    assert found.status == "converged"
    assert found.objective == pytest.approx(found.quantities["balanced_vibration"], rel=1e-6)
