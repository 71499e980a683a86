"""Points of a map in the sizes of the cycle's program that they need."""

import numpy as np
import pytest

from jaxcomp import load
from jaxcomp.study.rating import rating_map


@pytest.mark.slow  # two programs to compile
def test_every_point_of_a_warmed_machine_is_found():
    """On the panels of the first size the gas of the last point does not settle."""
    evaporating = np.array([258.15, 263.15])
    condensing = np.array([318.15, 323.15])
    points = rating_map(load("danfoss-vtz038-g"), evaporating, condensing)
    assert np.all(points.ok)
