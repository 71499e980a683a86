"""Points of a map in the sizes of the cycle's program that they need."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import Status, load
from jaxcomp.study.rating import _events_without_room, rating_map


@pytest.mark.parametrize(
    ("of_orbit", "of_cycle", "events"),
    [
        (Status.converged, Status.converged, -1),
        (Status.stalled, Status.converged, -1),
        (Status.not_converged, Status.not_converged, 11),
        (Status.not_converged, Status.converged, 11),
    ],
)
def test_a_point_that_does_not_settle_has_no_room(of_orbit, of_cycle, events):
    cycle = SimpleNamespace(status=of_cycle, event_count=jnp.asarray(11))
    orbit = SimpleNamespace(status=of_orbit, cycle=cycle)
    assert _events_without_room(orbit) == events


@pytest.mark.slow  # two programs to compile
def test_every_point_of_a_warmed_machine_is_found():
    """On the panels of the first size the gas of the last point does not settle."""
    evaporating = np.array([258.15, 263.15])
    condensing = np.array([318.15, 323.15])
    points = rating_map(load("danfoss-vtz038-g"), evaporating, condensing)
    assert np.all(points.ok)
