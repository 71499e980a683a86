"""Sizes of the cycle's program: which one a machine takes, and what happens where none fits."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import SPEED, golden, mechanism

from jaxcomp import Status
from jaxcomp._core.fields import rebuilt
from jaxcomp.cylinder import CrankEnd, CycleOptions, LaminarGap, solve_cycle
from jaxcomp.cylinder._climb import Climb, events_without_room
from jaxcomp.cylinder._cycle_options import may_lack_room
from jaxcomp.cylinder._cylinder import prepare
from jaxcomp.cylinder._cylinder_system import Cylinders
from jaxcomp.cylinder._ends import options_of
from jaxcomp.cylinder._revolutions import march

TOO_MANY = Status.too_many_events


def panels_tried(options, events):
    """Panels of the sizes that a design with these events goes through; -1 events need no room."""
    climb = Climb(options.ladder(by_march=False))
    panels = []
    for size, rows in climb:
        panels.append(size.panel_count)
        climb.note(rows, events)
    return panels


def test_a_machine_takes_the_next_size_with_room_for_its_events():
    options = CycleOptions()
    assert options.panel_count == 48
    assert panels_tried(options, -1) == [48]
    assert panels_tried(options, 0) == [48, 128, 320, 768]
    assert panels_tried(options, 100) == [48, 320, 768]
    assert panels_tried(options, 5000) == [48, 768]
    assert panels_tried(CycleOptions(least_panels=40), 0)[1] == 107


def test_designs_of_a_batch_each_take_the_size_that_they_need():
    climb = Climb(CycleOptions().ladder(), 4)
    sizes = iter(climb)
    first, everyone = next(sizes)
    assert first.panel_count == 48
    climb.note(everyone, np.array([-1, 20, 100, 30]))
    second, rows = next(sizes)
    assert (second.panel_count, [*rows]) == (128, [1, 3])
    climb.note(rows, np.array([-1, 60]))  # the latter has more than were seen before
    third, rows = next(sizes)
    assert (third.panel_count, [*rows]) == (320, [2, 3])
    climb.note(rows, np.array([-1, -1]))
    assert next(sizes, None) is None


def test_designs_that_lack_room_in_the_largest_size_are_marched():
    climb = Climb(CycleOptions().ladder(), 1)
    methods = []
    for size, rows in climb:
        methods.append(size.method)
        climb.note(rows, np.array([100]))
    assert methods == ["collocation"] * 3 + ["march"]


def test_the_march_stands_behind_the_largest_size_alone():
    *sizes, march = CycleOptions().ladder()
    assert [size.panel_count for size in sizes] == [48, 128, 320, 768]
    assert sizes[-1].may_march
    assert march.method == "march"
    assert march.by_march() is None
    assert not CycleOptions().may_march


def test_numbers_that_are_given_are_kept():
    given = CycleOptions(panels=30, capacity=500, max_passes=900)
    assert not given.may_grow
    assert not given.may_march
    assert given.ladder() == (given,)
    # all but one of given panels may end in an event
    assert bool(given.has_room(29, 10))
    assert not bool(given.has_room(30, 10))
    assert not bool(given.has_room(29, 501))


def test_cylinders_that_are_solved_together_have_the_panels_of_each():
    options = CycleOptions(panels=20).of_several(3)
    assert options.panel_count == 60
    assert options.kept_steps == 3 * 768


def test_statuses_for_which_a_larger_size_may_help():
    assert bool(may_lack_room(Status.not_converged))
    assert bool(may_lack_room(TOO_MANY))
    assert not bool(may_lack_room(Status.no_delivery))


def stiff(scale=1.0):
    """The air machine with a suction valve that bounces: it has more events than the first size holds."""
    valve = golden("D").suction_valve
    changed = eqx.tree_at(
        lambda v: (v.stiffness, v.stop), valve, (scale * 40 * valve.stiffness, 0.5 * valve.stop)
    )
    return eqx.tree_at(lambda c: c.suction_valve, golden("D"), changed)


def work(scale, **more):
    return solve_cycle(stiff(scale), mechanism(), 0.5 * SPEED, **more).indicated_work


@pytest.mark.parametrize(
    ("of_machine", "of_cycle", "events"),
    [
        (Status.converged, Status.converged, -1),
        (Status.stalled, Status.converged, -1),
        (Status.not_converged, Status.not_converged, 11),
        (Status.not_converged, Status.converged, 11),
    ],
)
def test_a_machine_that_does_not_settle_has_no_room(of_machine, of_cycle, events):
    cycle = SimpleNamespace(status=of_cycle, event_count=jnp.asarray(11))
    assert events_without_room(cycle, of_machine) == events


@pytest.mark.slow  # two sizes with derivatives, and the first one within `jit`
def test_derivatives_are_taken_at_the_size_that_the_value_took():
    fine = CycleOptions(nodes=10, size=2)
    value, slope = jax.value_and_grad(work)(1.0)
    np.testing.assert_allclose(value, work(1.0), rtol=1e-12)
    np.testing.assert_allclose(value, work(1.0, options=fine), rtol=1e-6)
    step = 1e-3
    difference = (work(1 + step, options=fine) - work(1 - step, options=fine)) / (2 * step)
    # by default to 1e-3, and the difference to the square of its step
    np.testing.assert_allclose(slope, difference, rtol=1e-3)

    # a compiled program has one size, and says so when it runs
    with pytest.raises(Exception, match=r"least_panels=320"):
        jax.block_until_ready(jax.jit(jax.grad(work))(1.0))

    def status(scale):
        return solve_cycle(stiff(scale), mechanism(), 0.5 * SPEED, throw=False).status

    assert bool(jax.jit(status)(1.0) == TOO_MANY)


@pytest.mark.slow  # a march and the Jacobian of a revolution
def test_a_disturbance_shrinks_by_the_multiplier():
    """Of the golden machine with air: two revolutions of the march from a disturbed state."""
    # with much gas left behind a revolution remembers more of the one before
    cylinder = eqx.tree_at(lambda c: c.clearance_ratio, golden("D"), jnp.asarray(0.2))
    cycle = solve_cycle(cylinder, mechanism(), SPEED, CycleOptions(nodes=8, panels=48))
    system = Cylinders(prepare(cylinder, mechanism(), jnp.asarray(SPEED), None), jnp.zeros(1))
    mesh, z, _ = cycle.raw
    options = CycleOptions(size=1)

    @jax.jit
    def turned(state):
        return march(system, options, 1e-10, 0.0, state, mesh.flags[0], jnp.asarray(True), 1).state

    states = z.left[0], z.left[0].at[0].add(1e-4)
    differences = []
    for _ in range(4):
        states = tuple(turned(state) for state in states)
        differences.append(float(states[1][0] - states[0][0]))
    # the other directions are gone after three revolutions, and of 1e-4 the second order is left
    assert differences[3] / differences[2] == pytest.approx(cycle.multiplier, rel=1e-2)
    assert 0.02 < cycle.multiplier < 1


def test_the_events_of_cylinders_that_are_solved_together_count_against_the_panels_of_all():
    single = golden("D")
    ends = rebuilt(single, crank_end=CrankEnd(0.01), leakage=LaminarGap(1e-5, 0.02))
    alone = CycleOptions(least_panels=40)
    together = options_of(ends, 2, alone)
    assert options_of(single, 2, alone) == alone
    assert (together.cylinders, together.panel_count) == (2, 80)
    # 65 of both ends have room on 2 x 107 panels, and would have none on 107
    assert panels_tried(together, 65) == [80, 214, 534, 1280]
    assert panels_tried(alone, 65)[:2] == [40, 267]
