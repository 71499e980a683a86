"""Valves that bounce and valves that just touch their stop, against SciPy with located events.

`tests/reference_valves.py` marches one revolution, from the state that the package found, with the
equations written a second time, every lift followed to where it turns. A cycle with an event too few or
too many delivers something else and does not return to its beginning.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import GOLDEN_OPTIONS, SPEED, golden, mechanism, with_values
from reference_valves import Reference

from jaxcomp import SolveFailed, Status
from jaxcomp.cylinder import CycleOptions, solve_cycle
from jaxcomp.cylinder._cycle import GRAZING

# [m] to which the suction valve of the air machine lifts without a stop: the reference's own
FREE_LIFT = 0.0032359564048


def solve(**values):
    return solve_cycle(with_values(golden("D"), **values), mechanism(), SPEED, GOLDEN_OPTIONS)


def revolution(cycle, **changes):
    """Volumetric efficiency, the largest change of the state over its scales, touches of the stops."""
    reference = Reference(inertia=1e9, motor=lambda speed: 0.0, **changes)
    cylinder = cycle.case.cylinder
    valves = [list(one) for one in reference.valves]
    for own, valve in zip(valves, cylinder.valves, strict=True):
        own[4] = float(valve.stop)
    reference.valves = tuple(map(tuple, valves))
    angle, y = -np.pi / 2, np.asarray(cycle.raw[1].left[0])
    x, _ = reference.piston(angle)
    volume = reference.area * x + reference.c * reference.swept
    scales = np.array([float(cycle.case.mass_scale), 300.0])
    start = [*(y[:2] * scales), *[0.0] * 6]
    end = reference.run(2 * np.pi / SPEED, angle, SPEED, SPEED, rtol=1e-11, start=start)
    del x, volume
    back = np.max(np.abs(end[2:4] / start[:2] - 1))
    return end[-2] / float(cycle.case.mass_scale), back, [one[1] for one in reference.touches]


# [-] by which the suction valve would pass its stop, down to what is not seen as a touch any more
@pytest.mark.parametrize("excess", [1e-2, 1e-3, 3e-4, 1e-5, 1e-6, -1e-4])
def test_a_valve_that_just_touches_its_stop(excess):
    cycle = solve(suction_valve__stop=FREE_LIFT / (1 + excess))
    efficiency, back, (touches, _) = revolution(cycle)
    assert touches == (excess > 0)
    # a wrong sequence is 1e-5 off at 1e-5 of excess, 1e-4 at 1e-3
    np.testing.assert_allclose(cycle.volumetric_efficiency, efficiency, rtol=1e-6)
    assert back < 1e-6
    margin = float(cycle.turning_margins["suction_stop"])
    # to the part of a parabola in the turn
    np.testing.assert_allclose(margin, excess, rtol=0.1, atol=1e-7)
    assert bool(cycle.grazes["suction_stop"]) == (abs(margin) < GRAZING)


@pytest.mark.parametrize("restitution", [0.05, 0.1, 0.2, 0.3, 0.5, 0.6])
def test_a_valve_that_bounces(restitution):
    values = {f"{one}_valve__restitution": restitution for one in ("suction", "discharge")}
    values |= {f"{one}_valve__sticking_speed": 2e-3 for one in ("suction", "discharge")}
    cycle = solve(**values)
    efficiency, back, touches = revolution(cycle, restitution=restitution, rest_speed=2e-3)
    meets = cycle.events.meets & (cycle.events.which % 4 == 1)
    found = [int(jnp.sum(meets & (cycle.events.which // 4 == valve))) for valve in range(2)]
    assert found == touches
    np.testing.assert_allclose(cycle.volumetric_efficiency, efficiency, rtol=1e-6)
    assert back < 1e-6
    # most bounces are pressed on: no change of the design takes them away
    assert not all(bool(one) for one in jax.tree.leaves(cycle.grazes))


@pytest.mark.slow  # three programs
def test_panels_that_are_given_have_room_or_say_so():
    """Seventeen events, those of choking ports with them, have none on twelve panels."""
    few = CycleOptions(nodes=8, panels=12)
    with pytest.raises(SolveFailed, match=r"leave panels.*\(17 events"):
        solve_cycle(golden("D"), mechanism(), SPEED, few)
    enough = CycleOptions(nodes=8, panels=24)
    found = solve_cycle(golden("D"), mechanism(), SPEED, enough)
    assert found.raw[0].event.size == 24
    wanted = solve_cycle(golden("D"), mechanism(), SPEED, GOLDEN_OPTIONS).volumetric_efficiency
    # 8 nodes on the few panels between the events
    np.testing.assert_allclose(found.volumetric_efficiency, wanted, rtol=1e-6)
    traced = jax.jit(lambda speed: solve_cycle(golden("D"), mechanism(), speed, few, throw=False))
    assert bool(traced(SPEED).status == Status.too_many_events)
