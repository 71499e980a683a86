"""Panels of a revolution: where their edges stand, and whether they resolve what is on them."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load
from jaxcomp._core.fields import replaced
from jaxcomp.cylinder import _event_panels, solve_cycle
from jaxcomp.cylinder._event_panels import Unknowns
from jaxcomp.cylinder._march import Record
from jaxcomp.cylinder._revolutions import START, TURN
from jaxcomp.cylinder._rounds import ConstantLines

STEPS = 24
PANELS = 12
# where a valve has an event, at the end of a step
EVENT_STEP = 9


@pytest.fixture
def record():
    """A march in steps of one width, of a state that is the angle itself."""
    angle = START + TURN * jnp.arange(STEPS) / STEPS
    width = jnp.full(STEPS, TURN / STEPS)
    ones = jnp.ones((STEPS, 1))
    event = jnp.full(STEPS, -1).at[EVENT_STEP].set(0)
    return Record(
        angle=angle,
        width=width,
        begin=angle[:, None],
        end=(angle + width)[:, None],
        begin_rate=ones,
        end_rate=ones,
        flags=jnp.zeros((STEPS, 6), int),
        event=event,
        code=jnp.zeros(STEPS, int),
    )


# one program for all meshes with as many kinks
lay_mesh = eqx.filter_jit(_event_panels.lay_mesh)


class Kinks(eqx.Module):
    """Functions that vanish at angles."""

    places: jax.Array

    def __call__(self, angle, state, flags):
        return state[0] - self.places


def at_angles(*places):
    return Kinks(jnp.asarray(places))


def test_kinks_are_edges(record):
    places = START + TURN * np.array([0.137, 0.72])
    mesh, z, _ = lay_mesh(record, PANELS, 4, at_angles(*places))
    edges = np.asarray(z.edges)
    # straight lines, whose zeros are known to rounding
    np.testing.assert_allclose([np.min(np.abs(edges - place)) for place in places], 0, atol=1e-13)
    assert np.all(np.diff(edges) > 0)
    # the state at the left edges is that of the march
    np.testing.assert_allclose(z.left[:, 0], edges[:-1], rtol=1e-13)
    event_edge = edges[1:][np.asarray(mesh.event) == 0]
    np.testing.assert_allclose(event_edge, record.angle[EVENT_STEP + 1], rtol=1e-15)


def test_a_second_kink_of_a_panel_is_told(record):
    plain = np.asarray(lay_mesh(record, PANELS, 4)[1].edges)
    left, right = plain[2:4]
    first, second = left + (right - left) * np.array([0.3, 0.6])
    alone = lay_mesh(record, PANELS, 4, at_angles(first))
    assert alone.kink_distance < 1e-13
    both = lay_mesh(record, PANELS, 4, at_angles(first, second))
    edges = np.asarray(both.unknowns.edges)
    assert np.min(np.abs(edges - first)) < 1e-13
    # the right edge stays, and is further from the second kink than that which stands at the first
    assert float(both.kink_distance) == pytest.approx(second - first, rel=1e-12)


def test_events_stay_where_they_are(record):
    event = float(record.angle[EVENT_STEP + 1])
    plain = lay_mesh(record, PANELS, 4)[1].edges
    before = np.max(plain[plain < event - 1e-9])
    # nearer to the event than to the other end of its panel
    place = event - 0.2 * (event - before)
    edges = np.asarray(lay_mesh(record, PANELS, 4, at_angles(place))[1].edges)
    assert np.min(np.abs(edges - event)) < 1e-14
    assert np.min(np.abs(edges - place)) < 1e-13
    assert np.min(np.abs(edges - before)) > 1e-3  # it is the other end that moved


def test_states_at_moved_edges_are_of_the_steps_they_stand_in(record):
    angle = record.angle[:, None]
    after = angle + record.width[:, None]
    record = record._replace(
        begin=jnp.sin(angle), end=jnp.sin(after), begin_rate=jnp.cos(angle), end_rate=jnp.cos(after)
    )
    places = START + TURN * np.array([0.137, 0.72])

    def kinks(angle, state, flags):
        return angle - jnp.asarray(places)

    _, z, _ = lay_mesh(record, PANELS, 4, kinks)
    # the cubic of a step errs by its width to the fourth over 384; that of another step by 50 times that
    np.testing.assert_allclose(z.left[:, 0], np.sin(z.edges[:-1]), atol=(TURN / STEPS) ** 4 / 384)


def test_without_kinks_no_edge_moves(record):
    plain = lay_mesh(record, PANELS, 4)[1].edges
    np.testing.assert_array_equal(lay_mesh(record, PANELS, 4, at_angles(99.0))[1].edges, plain)


@pytest.mark.slow  # a value and a gradient of a machine with valves, half a minute
def test_slopes_where_a_port_chokes():
    compressor = load("mayekawa-wbhe-r22").as_compressor()

    def work(factor):
        radius = compressor.mechanism.crank_radius * factor
        mechanism = replaced(compressor.mechanism, crank_radius=radius)
        clearance = compressor.gas.clearance_ratio * factor
        gas = replaced(compressor.gas, clearance_ratio=clearance)
        return solve_cycle(gas, mechanism, 200 * np.pi).indicated_work  # 6,000 rpm

    slope = jax.grad(work)(1.0)
    step = 3e-4  # leaves 1e-7
    difference = (work(1 + step) - work(1 - step)) / (2 * step)
    # 1.2e-4 on the panels of the first size; with the kinks within panels 1e-3
    np.testing.assert_allclose(slope, difference, rtol=3e-4)


@pytest.mark.parametrize("rough", [0, 1], ids=["first", "second"])
def test_panels_that_are_too_few_for_one_of_two_cylinders_are_coarse(rough):
    stride = 8
    points = np.ones((PANELS, 5, 2 * stride))
    z = Unknowns(points, points[:, 0], START + TURN * np.linspace(0, 1, PANELS + 1))

    def columns(*places):
        return (stride * np.arange(2)[:, None] + np.array(places)).ravel()

    system = SimpleNamespace(columns=columns)
    assert not ConstantLines().is_coarse(system, z)
    # a lift that goes up and down from node to node
    points[3, :, stride * rough + 2] = [0.0, 0.1, 0.0, 0.1, 0.0]
    assert ConstantLines().is_coarse(system, z)
    # a velocity that does so says little
    points[3, :, stride * rough + 2] = 1.0
    points[3, :, stride * rough + 3] = [0.0, 0.1, 0.0, 0.1, 0.0]
    assert not ConstantLines().is_coarse(system, z)
