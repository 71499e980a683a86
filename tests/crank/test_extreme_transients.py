"""Motion in time through rest: swinging back, and friction laws that are all but a step.

Start from rest and coast-down to a halt stand in `test_transient`.
"""

import dataclasses
import time

import diffrax
import numpy as np
import pytest
from helpers import every_leaf_finite, machine, regularised, status_of
from scipy.special import ellipk

from jaxcomp import Compressor
from jaxcomp.crank import TimeIntegration, simulate
from jaxcomp.motor import ConstantTorque

FIELD, UNBALANCE = 9.81, 0.05


@pytest.fixture(scope="module")
def pendulum():
    """A crank without piston and rod, out of balance: a rigid pendulum."""
    whole = machine(
        motor=ConstantTorque(0.0),
        piston_mass=0.0,
        conrod_mass=0.0,
        conrod_inertia=0.0,
        unbalance=UNBALANCE,
        mass=0.0,
        gravity=(-FIELD, 0.0),
    )
    shaft = dataclasses.replace(whole.crankshaft, main_journal=None)
    return Compressor(whole.mechanism, shaft, whole.motor, gravity=whole.gravity)


@pytest.mark.parametrize("lifted", [0.1, 1.0, 3.0, np.pi - 1e-3])
def test_a_crank_swings_back_with_the_period_of_the_pendulum(pendulum, lifted):
    """From rest, through rest and back: T = 4 sqrt(J/(m e g)) K(sin(lifted/2))."""
    inertia = float(pendulum.crankshaft.inertia)
    period = 4 * np.sqrt(inertia / (UNBALANCE * FIELD)) * ellipk(np.sin(lifted / 2) ** 2)
    swung = simulate(
        pendulum,
        period,
        angle=np.pi - lifted,
        until_rest=False,
        options=TimeIntegration(tolerance=1e-10, samples=41),
    )
    assert status_of(swung) == "converged"
    angle, speed = np.asarray(swung.state.angle), np.asarray(swung.state.speed)
    # it has been on the other side, and is back; close to the top an error of the start grows by e
    # to the sqrt(m e g/J) T
    error = 1e-7 * np.exp(min(period * np.sqrt(UNBALANCE * FIELD / inertia), 23.0) - 2 * np.pi)
    assert np.max(angle) == pytest.approx(np.pi + lifted, abs=1e-3 + error)
    assert np.min(speed) < 0 < np.max(speed)
    assert angle[-1] == pytest.approx(np.pi - lifted, abs=error)
    energy = np.asarray(swung.kinetic_energy) + UNBALANCE * FIELD * np.cos(angle)
    # 1e-10 a step, and the dense output in between
    np.testing.assert_allclose(energy, energy[0], atol=1e-6 * UNBALANCE * FIELD)


# ---------------------------------------------------------------- a law that is all but a step
WIDTHS = (1e-1, 1e-3, 1e-5, 1e-8)
SOLVERS = {"Tsit5": diffrax.Tsit5(), "Kvaerno5": diffrax.Kvaerno5()}


def creeping(width):
    """Without a motor into the compression, to a halt there, and back through a law that is a step."""
    return machine(
        motor=ConstantTorque(0.0, 20.0),
        friction=regularised(width, scale=10.0),
        discharge_pressure=1.2 * 0.098e6,
        clearance_ratio=1.0,
    )


def stopped(solver, width, max_steps=4096):
    return simulate(
        creeping(width),
        1.0,
        angle=3.3,
        speed=20.0,
        until_rest=False,
        options=TimeIntegration(solver=solver, tolerance=1e-6, max_steps=max_steps, samples=11),
        throw=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SOLVERS))
def test_narrow_laws_end_in_time_with_an_answer_or_a_word(name):
    """Cost and end of an explicit and an implicit solver; `-s` shows the table.

    How long the crank hangs about its halt depends on the width, so the ends differ among widths.
    """
    for width in WIDTHS:
        start = time.perf_counter()
        result = stopped(SOLVERS[name], width)
        seconds = time.perf_counter() - start
        word = status_of(result)
        assert every_leaf_finite((result.time, result.state, result.energy))
        assert int(result.steps) <= 4096
        print(f"{name:9} v0 {width:7.0e} m/s  {word:14} {int(result.steps):5} steps "
              f"{seconds:7.2f} s  to t = {float(result.end_time):.4f} s  "
              f"angle {float(result.state.angle[-1]):.8f}")  # fmt: skip
        assert word == "converged"
        # work that is neither motion nor loss: a step is allowed 1e-6, and there are hundreds
        assert abs(float(result.residual[-1])) < 1e-3


@pytest.mark.slow
def test_a_solver_that_runs_out_of_steps_says_so():
    """Bounded work: 32 steps of 68 end at once, with finite numbers up to where they got."""
    result = stopped(diffrax.Tsit5(), 1e-8, max_steps=32)
    assert status_of(result) == "not_converged"
    assert every_leaf_finite((result.time, result.state, result.energy))
    assert 0 < float(result.end_time) < 1.0
