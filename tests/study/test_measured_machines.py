"""Real machines that four points of their maps identified, at all points: the figures of identify.md.

The constants stand in the bundled machine files; `jaxcomp identify`, with the commands of that page,
finds them. Here they are only evaluated, at the points that the fit did not see.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from jaxcomp import load
from jaxcomp.cylinder import CycleOptions
from jaxcomp.scene.measured import bundled_maps
from jaxcomp.scene.readings import read_readings
from jaxcomp.study.rating import QUANTITIES, rating_map

ZERO = 273.15
PAGE = (Path(__file__).parents[2] / "notebooks" / "identify.md").read_text("utf-8")
EVAPORATING, CONDENSING = np.array([-15, -5, 4.4]) + ZERO, np.array([20, 30, 40, 48.9]) + ZERO
# of the twelve points, by row: -15/48.9, -5/30, 4.4/20 and 4.4/48.9
FITTED = [3, 5, 8, 11]
# Of what the page prints, to 0.01 %: half a unit of the last digit, and 1e-4 of the flow and power, by
# which a crank of fluctuating speed differs from one of constant speed, which the fit has.
CLOSE = 0.03


def stated(name: str, quantity: str) -> list[float]:
    """RMS and largest error [%] of the predicted points on the page."""
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}`"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    cell = cells[{"capacity": 3, "power": 4}[quantity]]
    return [float(x) for x in re.findall(r"[\d.]+", cell)][:2]


def errors(name: str, data: str, evaporating, condensing, speed=None, rating="ahri540"):
    # with the panels that the light valves of one of them need, so that all three share a program
    options = CycleOptions(panels=96)
    found = rating_map(load(name), evaporating, condensing, rating, options)
    assert found.ok.all()
    readings = read_readings(bundled_maps()[data], evaporating, condensing, speed)
    return {
        quantity: 100
        * (np.asarray(found.values[quantity]).ravel() / readings.measured[quantity] - 1)
        for quantity in ("capacity", "power")
    }


@pytest.mark.parametrize(
    ("name", "data"),
    [
        # of all its parts the solution takes half a minute; the others are as well measured
        pytest.param("carlyle-06dm313", "06dm313_r22", marks=pytest.mark.slow),
        pytest.param("copeland-3db3-1000", "3db3-1000_r22_60hz", marks=pytest.mark.slow),
        ("copeland-crk3-0325", "crk3-0325_r22"),
    ],
)
def test_points_that_were_not_fitted(name, data):
    found = errors(name, data, EVAPORATING, CONDENSING)
    left = np.setdiff1d(np.arange(12), FITTED)
    for quantity, error in found.items():
        rms, largest = stated(name, quantity)
        assert np.sqrt(np.mean(error[left] ** 2)) == pytest.approx(rms, abs=CLOSE), quantity
        assert np.abs(error[left]).max() == pytest.approx(largest, abs=CLOSE), quantity
    assert "identified from" in load(name).text


def test_points_without_a_cycle_are_solved_together_in_larger_sizes(monkeypatch):
    """The second point of four fits the second size, the last one the third."""
    tried = []

    def along(compressor, rating, options, solver, evaporating, condensing):
        tried.append((options.panel_count, evaporating.size))
        needs = np.where(condensing > 321, np.where(evaporating > 251, 200, 100), 10)
        fits = options.panel_count >= needs
        events = np.where(fits, -1, needs // 3)
        return {name: evaporating + condensing for name, *_ in QUANTITIES}, fits, events

    monkeypatch.setattr("jaxcomp.study.rating._along", along)
    found = rating_map(load("r134a-7cc"), [250.0, 255.0], [320.0, 325.0])
    assert found.ok.all()
    assert tried == [(48, 4), (128, 1), (320, 1)]  # each goes where its events have room
    np.testing.assert_array_equal(found.values["power"], [[570, 575], [575, 580]])
