"""Constants of machines with blends, found again from maps of perturbed machines."""

import numpy as np
import pytest

from jaxcomp import identify, load
from jaxcomp.scene import with_values
from jaxcomp.study import Readings
from jaxcomp.study.rating import rating_map

ZERO = 273.15
CLEARANCE = "gas.clearance_ratio"
HEATING = "gas.suction.heating"
TRUTH = {CLEARANCE: 0.026, HEATING: 14.0}
SUPERHEAT = 10.0


def perturbed_map(blend: str, reference: str) -> tuple:
    """The machine before, and four points of its map after two constants have changed."""
    scene = with_values(load("r290-6cc"), {"gas.fluid": {"type": "mixture", "name": blend}})
    changed = with_values(scene, {CLEARANCE: TRUTH[CLEARANCE], HEATING: f"{TRUTH[HEATING]} K"})
    S = ZERO + np.array([-25.0, -10.0])
    D = ZERO + np.array([35.0, 45.0])
    found = rating_map(changed, S, D, "en12900-superheat", reference=reference)
    assert found.ok.all()
    evaporating, condensing = (axis.ravel() for axis in np.meshgrid(S, D, indexing="ij"))
    names = ("capacity", "power", "mass_flow")
    readings = Readings(
        source="map.csv",
        evaporating=evaporating,
        condensing=condensing,
        gas=evaporating + SUPERHEAT,
        liquid=condensing,
        useful=evaporating + SUPERHEAT,
        speed=np.full(evaporating.size, np.nan),
        measured={name: np.asarray(found.values[name]).ravel() for name in names},
        fluid=blend,
        by_subcooling=True,
        by_superheat=True,
        by_useful_superheat=True,
        reference=reference,
    )
    return scene, readings


@pytest.mark.slow  # five minutes each: a map and the slopes of a rated point are compiled
@pytest.mark.parametrize(
    ("blend", "reference"),
    [("R404A", "dew"), ("R407C", "dew"), ("R448A", "mean"), ("R454B", "dew")],
)
def test_constants_come_back_from_the_map_of_a_blend(blend, reference):
    scene, readings = perturbed_map(blend, reference)
    bounds = {CLEARANCE: (0.01, 0.05), HEATING: (5.0, 30.0)}
    found = identify(scene, readings, bounds, starts=1)
    # the map has friction under the fluctuating speed, a point has not: 1e-4 of the power
    np.testing.assert_allclose(found.estimate, [TRUTH[CLEARANCE], TRUTH[HEATING]], rtol=1e-3)
    np.testing.assert_allclose(found.computed, found.measured, rtol=1e-4)
