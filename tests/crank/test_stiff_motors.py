"""Motors that leave the speed no room, beside an implicit method that shares nothing with the package."""

import json
import os
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
import reference
from helpers import machine, status_of
from scipy.integrate import solve_ivp

from jaxcomp import Collocation, solve_orbit
from jaxcomp.motor import AbstractMotor, Kloss, SlipLine

SPEED = 105.0
# the load asks for 620 N m at most
TORQUES = (640.0, 1000.0, 1e5)
SLIPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def by_radau(torque, pull_out_slip, rtol=1e-9):
    """Efficiency, slip of the mean speed and fluctuation, both over the pull-out slip.

    The unknown is the slip over the pull-out slip. A stiff motor forgets within a fraction of a
    revolution where it came from, so that the third one is periodic.
    """
    numbers = reference.from_compressor(machine())

    def march(edges, y):
        parts, changes = [], []
        for left, right in pairwise(edges):
            middle = 0.5 * (left + right)
            signs = numbers.piston_rate(middle) > 0, -np.sign(numbers.rod_rate(middle))

            def at(theta, y, signs=signs):
                speed = SPEED * (1 - pull_out_slip * y)
                return speed, *numbers.solve(theta, speed, 2 * torque * y / (1 + y * y), *signs)

            def rate(theta, y, at=at):
                speed, answer, _, _ = at(theta, y[0])
                return [-answer[0] / (speed * SPEED * pull_out_slip)]

            def side(theta, y, at=at):
                return at(theta, y[0])[1][-1]

            found = solve_ivp(
                rate,
                (left, right),
                [y],
                method="Radau",
                rtol=rtol,
                atol=1e-3 * rtol,
                dense_output=True,
                events=side,
            )
            assert found.success
            changes += [a for a in found.t_events[0] if left + 1e-6 < a < right - 1e-6]
            y = found.y[0, -1]
            parts.append((at, found))
        return y, parts, changes

    edges = numbers.kinks()
    y, _, changes = march(edges, 0.1)
    edges = np.unique(np.concatenate([edges, changes]))
    y, _, _ = march(edges, y)
    end, parts, _ = march(edges, y)
    assert end == pytest.approx(y, rel=1e-9)
    gas = loss = lag = 0.0
    seen = []
    nodes, weights = np.polynomial.legendre.leggauss(4)
    for at, found in parts:
        for left, right in pairwise(found.t):
            for x, weight in zip(nodes, 0.5 * (right - left) * weights, strict=True):
                theta = 0.5 * (left + right) + 0.5 * (right - left) * x
                y = found.sol(theta)[0]
                _, _, losses, work = at(theta, y)
                gas, loss = gas + weight * work, loss + weight * sum(losses.values())
                lag += weight * y / (1 - pull_out_slip * y)
        seen.append(found.sol(np.linspace(found.t[0], found.t[-1], 20001))[0])
    seen = np.concatenate(seen)
    # 1/speed is 1/synchronous (1 + s y/(1 - s y)); the motor gives what gas and friction take
    slip = lag / (2 * np.pi + pull_out_slip * lag)
    swing = (seen.max() - seen.min()) / (1 - pull_out_slip * slip)
    return gas / (gas + loss), slip, swing


def numbers_of(orbit, slip):
    assert status_of(orbit) == "converged"
    mean = (1 - float(orbit.mean_speed) / SPEED) / slip
    return float(orbit.mechanical_efficiency), mean, float(orbit.speed_fluctuation) / slip


GRID = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import json
from helpers import machine
from test_stiff_motors import SLIPS, SPEED, TORQUES, numbers_of
from jaxcomp import solve_orbit
from jaxcomp.motor import Kloss
print(json.dumps([numbers_of(solve_orbit(machine(motor=Kloss(torque, slip, SPEED))), slip)
                  for torque in TORQUES for slip in SLIPS]))
"""


@pytest.mark.parametrize("slip", [1e-2, 1e-4, 1e-6])
def test_stiff_motors_converge_to_rounding(slip):
    """At any stiffness, also where the load comes within 3 % of the pull-out torque."""
    limit = solve_orbit(machine(motor=Kloss(1e5, 1e-6, SPEED)))
    for torque in TORQUES:
        orbit = solve_orbit(machine(motor=Kloss(torque, slip, SPEED)))
        assert status_of(orbit) == "converged"
        # of 160 times the load's torque the slip is a thousandth of what the motor starts from
        assert float(orbit.residual) < (1e-8 if torque == TORQUES[-1] else 1e-10)
        # what the swing of the speed changes goes with the pull-out slip
        assert float(orbit.mechanical_efficiency) == pytest.approx(
            float(limit.mechanical_efficiency), abs=1e-3 * slip + 1e-10
        )
    # by the slope of the torque at the synchronous speed; the swing is read off the nodes
    swing = np.ptp(limit.motor_torque) / (2 * TORQUES[-1])
    assert float(orbit.speed_fluctuation) / slip == pytest.approx(swing, rel=5e-3)


def test_a_stiff_motor_of_another_law_and_another_grid_agrees():
    """A law that is only told the speed, and few odd nodes, whose rule damps no error by itself."""

    class Line(AbstractMotor):
        kind = "line"

        def torque(self, speed):
            return 2e7 * (SPEED - speed)

        @property
        def speed_guess(self):
            return SPEED

    coarse = solve_orbit(machine(motor=SlipLine(2e7, SPEED)), Collocation(nodes=5))
    own = solve_orbit(machine(motor=Line()), Collocation(nodes=5))
    limit = solve_orbit(machine(motor=Kloss(1e5, 1e-6, SPEED)))
    for orbit in (own, coarse):
        assert status_of(orbit) == "converged"
    # told the speed alone, the law takes the slip as a difference of speeds: 2.3e-11 seen
    efficiency = float(coarse.mechanical_efficiency)
    assert float(own.mechanical_efficiency) == pytest.approx(efficiency, abs=1e-9)
    # what 5 nodes leave; a hundredth of that motor's slope changes the efficiency by 3e-10
    efficiency = float(limit.mechanical_efficiency)
    assert float(coarse.mechanical_efficiency) == pytest.approx(efficiency, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("slip", [1e-1, 1e-3, 1e-6])
def test_stiff_motors_agree_with_radau(slip):
    expected = by_radau(1000.0, slip)
    default, finer = (
        numbers_of(solve_orbit(machine(motor=Kloss(1000.0, slip, SPEED)), solver), slip)
        for solver in (None, Collocation(nodes=16))
    )
    for found in (default, finer):
        assert found[0] == pytest.approx(expected[0], abs=1e-9)
        assert found[1] * slip == pytest.approx(expected[1] * slip, abs=1e-9)
    # the extremes of the speed: 3e-5 at 8 nodes on a panel, 1e-8 at 16, and the rounding of the speed,
    # whose polynomials keep 13 digits
    assert default[2] == pytest.approx(expected[2], rel=1e-4)
    assert finer[2] == pytest.approx(expected[2], rel=1e-7, abs=1e-12 / slip)


@pytest.mark.slow
def test_stiff_motors_are_the_same_on_one_processor():
    """Programs for one processor round differently: what converges must not depend on it."""
    paths = os.pathsep.join([*sys.path, os.path.dirname(__file__)])
    environment = os.environ | {"PYTHONPATH": paths, "XLA_FLAGS": ""}
    ran = subprocess.run(
        [sys.executable, "-c", GRID], capture_output=True, text=True, timeout=110, env=environment
    )
    assert ran.returncode == 0, ran.stderr
    here = [
        numbers_of(solve_orbit(machine(motor=Kloss(torque, slip, SPEED))), slip)
        for torque in TORQUES
        for slip in SLIPS
    ]
    alone = np.asarray(json.loads(ran.stdout))
    np.testing.assert_allclose(alone[:, 0], np.asarray(here)[:, 0], rtol=0, atol=1e-10)
    # a fluctuation of 1e-9 ends in the rounding of the speed
    np.testing.assert_allclose(alone[:, 2], np.asarray(here)[:, 2], rtol=1e-6)
