"""A step of the march that dips beyond an event and out again does not pass over a watched angle."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load, solve_orbit
from jaxcomp.cylinder._march import AbstractLaw, stretch
from jaxcomp.scene import with_value

LOWEST = 0.5  # [rad] angle at which the event function is lowest
DEPTH = 1e-4  # [-] of its dip below zero


class Parabola(AbstractLaw):
    """An event function that dips below zero, as the force on a shut valve may; the event ends that."""

    state_size: int = 1

    def rates(self, angle, state, flags):
        slope = jnp.where(flags[0] == 0, 2 * (angle - LOWEST), 0.0)
        return slope[None], jnp.where(flags[0] == 0, state, 1.0), jnp.zeros(1)

    def towards(self, state, events):
        return jnp.ones(1, bool)

    def after(self, angle, event, state, flags, force):
        return jnp.zeros((), int), state, jnp.where(event == 0, 1, flags)

    def longest(self, flags):
        return jnp.asarray(1.0)

    def passed(self, ends, slopes, width, flags, least):
        return jnp.asarray(jnp.inf)


def marched(*watched: float):
    """A march over the dip, and the events in its record."""
    law = Parabola()
    state = jnp.asarray([LOWEST**2 - DEPTH])
    flags = jnp.zeros(1, int)
    numbers = jnp.zeros(()), jnp.asarray(1.0), state, flags, jnp.asarray(1e-6)
    end = stretch(law, *numbers, 200, 64, watched=tuple(map(jnp.asarray, watched)))
    return end, np.flatnonzero(np.asarray(end.record.event) == 0)


def test_a_step_passes_over_a_dip_that_nobody_watches():
    """The case is one: without it the next test would show nothing."""
    _, events = marched()
    assert events.size == 0


@pytest.mark.parametrize("watched", [(LOWEST,), (np.inf, LOWEST), (LOWEST + 0.5 * DEPTH**0.5,)])
def test_an_event_before_a_watched_angle_is_found(watched):
    end, events = marched(*watched)
    (row,) = events
    record = end.record
    angle = float(record.angle[row] + record.width[row])
    # located where the function is within 1e-9 of nothing, at a slope of twice the root of the depth
    assert angle == pytest.approx(LOWEST - DEPTH**0.5, abs=1e-9 / (2 * DEPTH**0.5) + 1e-12)
    # a watched angle makes no edge of panels
    assert np.all(np.asarray(record.event)[: int(end.steps)] >= -1)


@pytest.mark.slow  # three sizes of the program are compiled
def test_a_shut_valve_that_lifts_for_a_moment_is_found_in_the_next_round():
    """The suction valve lifts by 1e-4 of its preload at the dead centre, within one step of the march.

    Newton's method left its branch in all rounds, the march stood, and derivatives were refused.
    """
    machine = load(Path(__file__).with_name("lifting_valve.toml"))
    machine = with_value(machine, "motor.mean_speed", "900 rpm")
    orbit = solve_orbit(machine)
    assert orbit.cycle.solver == "collocation"
