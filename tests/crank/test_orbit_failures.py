"""What cannot run ends in a word, with finite numbers, and spoils no neighbour in a batch."""

import numpy as np
import pytest
from helpers import (
    BAD,
    coulomb,
    every_leaf_finite,
    machine,
    named_leaves,
    solve_many,
    status_of,
    unchecked,
)

from jaxcomp import BadInput, Collocation, Shooting, SolveFailed, solve_orbit
from jaxcomp.motor import ConstantTorque, Kloss, MeanSpeed, SlipLine

FINE = Collocation(nodes=16)
# Without edges at the load reversals: the same words and branches, from a program that compiles in a
# third of the time.
QUICK = Collocation(nodes=12, reversals=0, tolerance=1e-10)


def members():
    """Name -> (machine, status), healthy ones between the bad."""
    cases = {"healthy": (machine(), "converged")}
    for name, changes in BAD.items():
        cases[name] = (unchecked(machine(), **changes), "bad_input")
    for name, speed in {"zero speed": 0.0, "negative speed": -10.0, "nan speed": np.nan}.items():
        cases[name] = (unchecked(machine(), motor__mean_speed=speed), "bad_input")
    cases["healthy with offset"] = (machine(offset=0.03), "converged")
    cases["locked"] = (machine(friction=coulomb(80.0)), "self_locking")
    # 10 rpm store too little energy to get over the compression
    cases["too slow"] = (machine(motor=MeanSpeed(1.0)), "stalled")
    cases["no inertia to speak of"] = (
        machine(inertia=1e-6, conrod_mass=0.01, piston_mass=0.01),
        "stalled",
    )
    cases["healthy and last"] = (machine(clearance_ratio=0.0), "converged")
    return cases


CASES = members()


@pytest.fixture(scope="module")
def batch():
    orbits = solve_many([m for m, _ in CASES.values()], FINE)
    return dict(zip(CASES, orbits, strict=True))


@pytest.mark.parametrize("case", list(CASES))
def test_a_batch_names_each_failure_and_stays_finite(batch, case):
    assert status_of(batch[case]) == CASES[case][1]
    not_finite = [k for k, v in named_leaves(batch[case]).items() if not every_leaf_finite(v)]
    assert not_finite == []


def test_bad_members_leave_their_neighbours_alone(batch):
    healthy = ["healthy", "healthy with offset", "healthy and last"]
    alone = solve_many([CASES[name][0] for name in healthy], FINE)
    for name, other in zip(healthy, alone, strict=True):
        for key, value in named_leaves(batch[name]).items():
            expected = np.asarray(named_leaves(other)[key], float)
            size = np.max(np.abs(expected), initial=1e-12)
            np.testing.assert_allclose(value / size, expected / size, rtol=0, atol=1e-13)


@pytest.mark.parametrize("solver", [QUICK, pytest.param(FINE, marks=pytest.mark.slow)])
def test_values_and_gradients_are_finite_in_a_batch_with_bad_members(solver):
    results = solve_many([m for m, _ in CASES.values()], solver, derivatives=True)
    for (name, (_, status)), (gradient, orbit) in zip(CASES.items(), results, strict=True):
        assert status_of(orbit) == status
        not_finite = [k for k, v in named_leaves(gradient).items() if not every_leaf_finite(v)]
        assert not_finite == [], name


@pytest.mark.slow
def test_shooting_names_each_failure_and_stays_finite():
    results = solve_many([m for m, _ in CASES.values()], Shooting())
    for (name, (_, status)), orbit in zip(CASES.items(), results, strict=True):
        # Where the crank halts, the integration may end before the halt is seen.
        expected = {status, "not_converged"} if status == "stalled" else {status}
        assert status_of(orbit) in expected, name
        not_finite = [k for k, v in named_leaves(orbit).items() if not every_leaf_finite(v)]
        assert not_finite == [], name


# ---------------------------------------------------------------- torque curves
def kloss(pull_out, **changes):
    return machine(motor=Kloss(pull_out, 0.1, 105.0), **changes)


CURVES = {
    "strong": (kloss(150.0), {"converged"}),
    "too weak": (kloss(10.0), {"stalled", "not_converged", "no_periodic_state"}),
    "far too weak": (kloss(1.0), {"stalled", "not_converged", "no_periodic_state"}),
    "hardly any inertia": (
        kloss(150.0, inertia=1e-4, conrod_mass=0.01, piston_mass=0.01),
        {"stalled", "not_converged"},
    ),
    "locked": (kloss(150.0, friction=coulomb(80.0)), {"self_locking"}),
}


@pytest.fixture(scope="module")
def on_curves():
    return dict(zip(CURVES, solve_many([m for m, _ in CURVES.values()], QUICK), strict=True))


@pytest.mark.parametrize("case", list(CURVES))
def test_a_motor_that_cannot_run_the_machine_is_reported(on_curves, case):
    _, expected = CURVES[case]
    orbit = on_curves[case]
    assert status_of(orbit) in expected
    not_finite = [k for k, v in named_leaves(orbit).items() if not every_leaf_finite(v)]
    assert not_finite == []


@pytest.mark.slow
def test_constant_torque_without_friction_has_no_periodic_state():
    """Nothing depends on the speed: either every speed is periodic or none is."""
    motor = lambda level: ConstantTorque(level, 105.0)  # noqa: E731
    machines = [machine(motor=motor(level), friction=coulomb(0.0)) for level in (0.0, 50.0, 1e4)]
    machines += [machine(motor=motor(level)) for level in (0.0, -20.0)]
    for orbit in solve_many(machines, FINE):
        assert status_of(orbit) != "converged"
        not_finite = [k for k, v in named_leaves(orbit).items() if not every_leaf_finite(v)]
        assert not_finite == []


# ---------------------------------------------------------------- alone
@pytest.mark.slow
def test_a_failure_is_raised_with_its_name():
    with pytest.raises(SolveFailed, match="locks the joints"):
        solve_orbit(machine(friction=coulomb(80.0)), FINE)
    orbit = solve_orbit(machine(friction=coulomb(80.0)), FINE, throw=False)
    assert status_of(orbit) == "self_locking"


def test_too_few_passes_are_reported():
    orbit = solve_orbit(machine(), Collocation(nodes=4, reversals=0, max_iterations=1), throw=False)
    assert status_of(orbit) == "not_converged"
    assert every_leaf_finite(orbit)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: MeanSpeed(0.0), "`mean_speed` must be > 0"),
        (lambda: MeanSpeed(np.nan), "`mean_speed` must be > 0 rad/s, but is nan"),
        (lambda: Kloss(0.0, 0.1, 105.0), "`pull_out_torque` must be > 0"),
        (lambda: SlipLine(-1.0, 105.0), "`slope` must be > 0"),
        (lambda: ConstantTorque(np.inf), "`level` must be finite"),
        (lambda: machine(gravity=(np.nan, 0.0)), "`gravity` must be finite"),
    ],
)
def test_bad_motor_or_field_is_refused_by_name(build, words):
    with pytest.raises(BadInput) as caught:
        build()
    assert words in str(caught.value)


def test_unknown_shape_of_torque_is_refused():
    with pytest.raises(ValueError, match="`shape` must be"):
        MeanSpeed(100.0, shape="linear")
