"""Periodic orbits of machines at the edge of what turns: values, slopes and words.

Every case has an expected end (a status of `Status`), finite numbers and finite slopes of efficiency
and speed fluctuation to all parameters, and where there is a closed form or the plain integration of
`reference`, that value. Passes are bounded by the solver, so that none can hang.

Bad values and the motors that are too weak stand in `test_orbit_failures`, the piston that wedges in
a slider-link machine in `test_slider_link_orbit`.
"""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
import reference
from helpers import (
    coulomb,
    every_leaf_finite,
    machine,
    named_leaves,
    regularised,
    solve_many,
    status_of,
)
from scipy.optimize import brentq

from jaxcomp import Collocation, Shooting, solve_orbit
from jaxcomp.motor import ConstantTorque, Kloss, MeanSpeed, SlipLine

# Without edges at the load reversals: errors of 1e-5, but one small program for every case.
QUICK = Collocation(nodes=12, reversals=0, tolerance=1e-10)
# The default, with more nodes for machines whose speed and rod turn fast in places.
FINE = Collocation(nodes=16)

PRESSURE, STROKE_VOLUME = 0.098e6, np.pi / 4 * 0.130**2 * 0.100


def cycle(**changes):
    return {
        "discharge_pressure": 10 * PRESSURE,
        "exponent": 1.05,
        "clearance_ratio": 0.006,
    } | changes


# name -> what changes in the cycle
CYCLES = {
    "no clearance": cycle(clearance_ratio=0.0),
    "hardly any clearance": cycle(clearance_ratio=1e-12),
    "clearance of the stroke": cycle(clearance_ratio=1.0),
    "huge clearance": cycle(clearance_ratio=1e6),
    "hardly any pressure": cycle(discharge_pressure=1.0001 * PRESSURE),
    "pressure ratio 100": cycle(discharge_pressure=100 * PRESSURE),
    "isothermal": cycle(exponent=1.0),
    "nearly isothermal": cycle(exponent=1 + 1e-9),
    "monatomic": cycle(exponent=1.67),
    "monatomic at 100": cycle(exponent=1.67, discharge_pressure=100 * PRESSURE),
}
# name -> (machine, status)
OTHERS = {
    "rod ratio 0.8": (machine(conrod_length=0.05 / 0.8), {"converged"}),
    "rod ratio 0.95": (machine(conrod_length=0.05 / 0.95), {"converged"}),
    "swings by 96 %": (machine(inertia=0.01), {"converged"}),
    "swings by 169 %": (machine(inertia=0.002), {"converged"}),
    # the turn takes its time where the crank all but halts, between two nodes
    "all but halts": (machine(motor=MeanSpeed(16.0)), {"unresolved", "stalled"}),
    "halts between the nodes": (machine(motor=MeanSpeed(11.0)), {"unresolved", "stalled"}),
    "friction times 20": (machine(friction=coulomb(20.0)), {"converged"}),
    "friction times 30": (machine(friction=coulomb(30.0)), {"converged"}),
    # margins of 0.056 and 0.006: of the second the steps on the joint loop do not suffice, and the lock
    # that is near is named as the cause
    "close to locking": (machine(friction=coulomb(39.0)), {"converged"}),
    "at locking": (machine(friction=coulomb(40.5)), {"near_locking", "stalled"}),
    "just locked": (machine(friction=coulomb(40.8)), {"self_locking"}),
    "locked": (machine(friction=coulomb(60.0)), {"self_locking"}),
}


def gas_work(discharge_pressure, exponent, clearance_ratio):
    """[J] of a turn, in closed form: polytropic work of the volume that is drawn in."""
    ratio, n = discharge_pressure / PRESSURE, exponent
    drawn = 1 + clearance_ratio - clearance_ratio * ratio ** (1 / n)
    if drawn <= 0:
        return 0.0  # the gas is only squeezed, and gives back what it took
    log = np.log(ratio)
    steep = log if n == 1 else np.expm1((n - 1) / n * log) * n / (n - 1)
    return PRESSURE * STROKE_VOLUME * drawn * steep


@pytest.fixture(scope="module")
def quick():
    """Name -> (gradient, orbit), all by one program."""
    machines = {name: machine(**changes) for name, changes in CYCLES.items()}
    machines |= {name: compressor for name, (compressor, _) in OTHERS.items()}
    results = solve_many(list(machines.values()), QUICK, derivatives=True)
    return dict(zip(machines, results, strict=True))


@pytest.mark.parametrize("case", [*CYCLES, *OTHERS])
def test_every_case_ends_in_a_word_with_finite_numbers_and_slopes(quick, case):
    gradient, orbit = quick[case]
    expected = {"converged"} if case in CYCLES else OTHERS[case][1]
    assert status_of(orbit) in expected
    for tree in (orbit, gradient):
        assert [k for k, v in named_leaves(tree).items() if not every_leaf_finite(v)] == []


@pytest.mark.parametrize("case", list(CYCLES))
def test_gas_work_is_that_of_the_closed_form(quick, case):
    _, orbit = quick[case]
    expected = gas_work(**CYCLES[case])
    # Of the work of a full stroke at the discharge pressure. Panels end at the valve events, so 12
    # nodes leave 1e-9, and 1e-7 of a compression by 80 in volume.
    size = CYCLES[case]["discharge_pressure"] * STROKE_VOLUME
    error = 3e-7 if case.endswith("100") else 1e-8
    assert float(orbit.energy.gas_work) == pytest.approx(expected, abs=error * size)


def test_no_flow_and_no_pressure_are_the_same_machine(quick):
    """A huge clearance and equal pressures both leave inertia and friction alone."""
    clearance, pressure = (quick[k][1] for k in ("huge clearance", "hardly any pressure"))
    # 1e-4 of pressure is 1e-4 of a load that makes four fifths of the fluctuation at ratio 10
    assert float(clearance.speed_fluctuation) == pytest.approx(
        float(pressure.speed_fluctuation), rel=2e-3
    )


def test_friction_takes_more_of_the_motor_up_to_locking(quick):
    names = ("nearly isothermal", "friction times 20", "friction times 30", "close to locking")
    efficiency = [float(quick[name][1].mechanical_efficiency) for name in names]
    margin = [float(quick[name][1].margin) for name in names]
    assert np.all(np.diff(efficiency) < 0)
    assert np.all(np.diff(margin) < 0)
    assert float(quick["just locked"][1].margin) < 0 < float(quick["at locking"][1].margin)


def test_margin_is_that_of_the_rod_where_only_the_wall_rubs():
    """mu tan(phi) = 1 is the limit of a slider-crank in closed form; the status flips there."""
    only_wall = lambda mu: coulomb(0.0, wall=type(coulomb().friction.wall)(mu))  # noqa: E731
    limit = np.sqrt(1 - (0.05 / 0.294) ** 2) / (0.05 / 0.294)
    machines = [machine(friction=only_wall(limit * share)) for share in (0.999, 1.001)]
    (_, below), (_, above) = solve_many(machines, QUICK, derivatives=True)
    # The nodes miss the steepest rod by an angle of 1e-2 at most, its slant by half the square.
    assert float(below.margin) == pytest.approx(1e-3, abs=1e-3)
    assert status_of(below) != "self_locking"
    assert status_of(above) == "self_locking"


# ---------------------------------------------------------------- stiff and soft motors
SLOPES = (1.0, 20.0, 1e3, 1e4, 1e5)
SLIP_LINES = [machine(motor=SlipLine(slope, 105.0)) for slope in (*SLOPES, 0.3, 1e8)]


@pytest.fixture(scope="module")
def on_slip_lines():
    return solve_many(SLIP_LINES, QUICK)


def test_slip_lines_from_soft_to_stiff(on_slip_lines):
    *results, soft, stiff = on_slip_lines
    for orbit in (*results, stiff):
        assert status_of(orbit) == "converged"
        assert abs(float(orbit.energy.residual)) < 1e-10
    # a motor of 31 N m at rest does not turn a machine that asks for 59 N m
    assert status_of(soft) in ("stalled", "no_periodic_state", "not_converged")
    assert every_leaf_finite(on_slip_lines)
    # The softest one's speed swings by half the mean, and the stiff ones' with one over the slope.
    fluctuation = np.array([float(orbit.speed_fluctuation) for orbit in results])
    assert fluctuation[0] > 0.49
    scaled = fluctuation * np.array(SLOPES)
    # the first correction goes with one over the slope too: 3 % at 1e3, 0.3 % at 1e4
    assert scaled[3] == pytest.approx(scaled[4], rel=3e-3)


@pytest.mark.slow
def test_slopes_on_slip_lines_are_finite():
    assert every_leaf_finite(solve_many(SLIP_LINES, QUICK, derivatives=True))


def test_a_synchronous_motor_leaves_the_losses_of_constant_speed(on_slip_lines):
    """At constant speed the accounts are integrals over known forces, which SciPy does too."""
    orbit = on_slip_lines[SLOPES.index(1e5)]
    twin = reference.from_compressor(machine())
    edges, total = twin.kinks(), 0.0
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for left, right in pairwise(edges):
        for x, w in zip(nodes, weights, strict=True):
            angle = 0.5 * (left + right) + 0.5 * (right - left) * x
            total += 0.5 * (right - left) * w * _losses_at_constant_speed(twin, angle, 105.0)
    # the load reversals within panels cost the 12 and the 40 nodes some 1e-4; the speed still
    # swings by 4e-5
    assert float(orbit.energy.total_loss) == pytest.approx(total, rel=3e-4)


def _losses_at_constant_speed(twin, angle, speed):
    """[N m] by the torque that holds the speed; the acceleration is linear in it but for its kinks."""
    at = lambda torque: twin.solve(angle, speed, torque)  # noqa: E731
    torque = brentq(lambda torque: at(torque)[0][0], -2e3, 2e3, xtol=1e-10)
    return sum(at(torque)[1].values())


# ---------------------------------------------------------------- the default solver, and SciPy
HARD = {
    "rod ratio 0.9": (machine(conrod_length=0.05 / 0.9), 2e-6),
    "rod ratio 0.95": (machine(conrod_length=0.05 / 0.95), 2e-4),
    "swings by 96 %": (machine(inertia=0.01), 2e-6),
    "swings by 169 %": (machine(inertia=0.002), 2e-5),
    "friction times 30": (machine(friction=coulomb(30.0)), 2e-6),
    "pressure ratio 100": (machine(discharge_pressure=100 * PRESSURE), 2e-6),
    "slow": (machine(motor=MeanSpeed(30.0)), 2e-5),
}


@pytest.fixture(scope="module")
def fine():
    return dict(zip(HARD, solve_many([m for m, _ in HARD.values()], FINE), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("case", list(HARD))
def test_extreme_orbits_close_the_turn_of_the_reference(fine, case):
    """The plain integration comes back to where it began, at the mean speed that was asked for."""
    orbit, (compressor, tolerance) = fine[case], HARD[case]
    assert status_of(orbit) == "converged"
    level, fastest = float(orbit.motor_torque[0]), int(np.argmax(orbit.state.speed))
    gap, mean, work = reference.one_turn(
        reference.from_compressor(compressor),
        lambda speed: level,
        float(orbit.state.angle[fastest]),
        float(orbit.state.speed[fastest]),
    )
    # 16 nodes a panel; the rod of ratio 0.95 turns within a tenth of a radian, and one over the
    # speed is steep where the crank slows down to a tenth
    assert abs(gap) < tolerance
    assert mean == pytest.approx(float(orbit.mean_speed), rel=tolerance)
    assert float(orbit.energy.gas_work) == pytest.approx(work["gas"], rel=1e-6)
    assert float(orbit.energy.total_loss) == pytest.approx(
        sum(work[name] for name in orbit.energy.losses), rel=max(tolerance, 1e-5)
    )


@pytest.mark.slow
def test_a_coarse_turn_says_how_coarse_it_is():
    """The resolution is above the error of the fluctuation; where it is poor the word says so.

    With 8 nodes the losses are not known to a hundredth of the work; with 12 they are.
    """
    steep = machine(conrod_length=0.05 / 0.95)
    exact = solve_orbit(steep, Collocation(nodes=24, reversals=0)).speed_fluctuation
    words = []
    for nodes in (3, 5, 12):
        found = solve_orbit(steep, Collocation(nodes=nodes, reversals=0), throw=False)
        error = abs(found.speed_fluctuation / exact - 1)
        assert 1e-4 < error < found.resolution, nodes  # seen: 0.1 to 0.2 of it
        words.append(status_of(found))
    assert words == ["unresolved", "unresolved", "converged"]


@pytest.mark.slow
def test_default_options_converge_on_steep_rods():
    """Panel edges that follow the load reversals settle, whatever the slant of the rod."""
    ratios = (0.6, 0.75, 0.8, 0.85, 0.9, 0.95)
    machines = [machine(conrod_length=0.05 / ratio) for ratio in ratios]
    orbits = solve_many(machines, Collocation())
    for orbit in orbits:
        # to the tolerance of 1e-13, or where rounding lets the change fall no more: 5e-12 seen
        assert float(orbit.residual) < 1e-11
    # the steepest asks for more than 8 nodes, see above
    assert [status_of(orbit) for orbit in orbits] == ["converged"] * 5 + ["unresolved"]


@pytest.mark.slow
def test_shooting_says_the_same_of_extreme_machines(fine):
    """Two solvers that share the laws only; close to locking as well.

    Shooting starts from constant speed, from where it does not find the orbits of the least inertias.
    """
    names = ["rod ratio 0.95", "swings by 96 %", "friction times 30"]
    machines = [HARD[name][0] for name in names]
    machines += [machine(friction=coulomb(scale)) for scale in (39.0, 40.5, 60.0)]
    *good, near, nearer, locked = solve_many(machines, Shooting())
    for name, orbit in zip(names, good, strict=True):
        assert status_of(orbit) == "converged"
        assert abs(float(orbit.energy.residual)) < 1e-6
        # what 16 nodes leave, as above
        assert float(orbit.mechanical_efficiency) == pytest.approx(
            float(fine[name].mechanical_efficiency), abs=5e-6
        )
    for orbit in (near, nearer):  # margins of 0.056 and 0.0056
        assert status_of(orbit) == "converged"
        assert abs(float(orbit.energy.residual)) < 1e-8
    default = solve_orbit(machine(friction=coulomb(39.0)))
    # what 8 nodes leave: 1e-8 seen
    assert float(near.mechanical_efficiency) == pytest.approx(
        float(default.mechanical_efficiency), abs=5e-8
    )
    assert status_of(locked) == "self_locking"
    assert every_leaf_finite((good, near, nearer, locked))


# ---------------------------------------------------------------- the other motors
KLOSS = {
    # what the machine asks for grows with the depth of slip: stable, unstable, hopeless
    (60.0, 0.1): {"converged"},
    (150.0, 0.1): {"converged"},
    (150.0, 3.0): {"converged"},
    (150.0, 0.02): {"converged"},
    (150.0, 0.01): {"converged"},
    # the swing of the speed throws the motor over its pull-out slip
    (150.0, 1e-3): {"stalled", "not_converged", "no_periodic_state"},
    (10.0, 0.1): {"stalled", "not_converged", "no_periodic_state"},
    (1e4, 1e-3): {"converged"},
    (1e3, 1e-6): {"converged"},
}


@pytest.mark.slow
def test_kloss_motors_from_soft_to_stiff():
    machines = [machine(motor=Kloss(*numbers, 105.0)) for numbers in KLOSS]
    results = solve_many(machines, QUICK, derivatives=True)
    for (numbers, expected), (gradient, orbit) in zip(KLOSS.items(), results, strict=True):
        assert status_of(orbit) in expected, numbers
        assert every_leaf_finite((gradient, orbit)), numbers
        if expected == {"converged"}:
            # as for the slip lines: 2 M/s is the slope over the synchronous speed
            assert abs(float(orbit.energy.residual)) < 1e-10, numbers


@pytest.mark.slow
def test_a_stiff_kloss_motor_is_the_slip_line_that_it_is_near_its_synchronous_speed():
    """Constant energy, whose speed swings by some per cent, lies beyond the pull-out slip."""
    for slip in (0.02, 0.003):
        stiff = machine(motor=Kloss(75 / slip, slip, 105.0))
        line = machine(motor=SlipLine(2 * 75 / slip**2 / 105, 105.0))
        found, expected = solve_orbit(stiff, QUICK), solve_orbit(line, QUICK)
        # the curve leaves its tangent by the square of slip over pull-out slip
        assert float(found.mean_speed) == pytest.approx(float(expected.mean_speed), rel=1e-6)
        assert float(found.speed_fluctuation) == pytest.approx(
            float(expected.speed_fluctuation), rel=0.02
        )


@pytest.mark.slow
def test_constant_torque_from_nothing_to_the_friction_of_high_speed():
    """Below the work of the gas nothing turns; above it the speed rises until friction takes it."""
    levels = (-50.0, 0.0, 50.0, 60.0, 65.0, 100.0, 200.0)
    machines = [machine(motor=ConstantTorque(level, 90.0)) for level in levels]
    results = solve_many(machines, QUICK, derivatives=True)
    words = [status_of(orbit) for _, orbit in results]
    assert every_leaf_finite(results)
    assert "converged" not in words[:3]
    assert words[3:] == ["converged"] * 4
    for level, (_, orbit) in list(zip(levels, results, strict=True))[3:]:
        # eta is the work of the gas over 2 pi times the level
        expected = gas_work(**cycle()) / (2 * np.pi * level)
        assert float(orbit.mechanical_efficiency) == pytest.approx(expected, rel=1e-8)
    assert np.all(np.diff([float(orbit.mean_speed) for _, orbit in results[3:]]) > 0)


@pytest.mark.slow
def test_a_narrow_regularisation_is_coulombs_law():
    """The panels end where the sliding reverses, so no node is within 1e-4 m/s of rest."""
    widths = (1e-3, 1e-6, 1e-8)
    smooth = solve_many([machine(friction=regularised(v0)) for v0 in widths], FINE)
    (sharp,) = solve_many([machine()], FINE)
    for orbit in smooth:
        assert status_of(orbit) == "converged"
        # the first node of a panel slides at 5 mm/s, five transition speeds of the widest law
        assert float(orbit.mechanical_efficiency) == pytest.approx(
            float(sharp.mechanical_efficiency), abs=1e-6
        )
    assert float(smooth[2].mechanical_efficiency) == pytest.approx(
        float(sharp.mechanical_efficiency), abs=1e-13
    )
    assert jnp.isfinite(smooth[2].residual)
