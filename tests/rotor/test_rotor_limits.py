"""Rotors at and beyond the limits of what their verbs take: refused, marked, or right."""

import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, load
from jaxcomp.rotor import (
    BalancingPlanes,
    ConstantLaw,
    Disks,
    Link,
    Mount,
    RotorModel,
    ShaftElements,
    SpeedTable,
    Unbalances,
    _campbell,
    campbell,
    critical_speeds,
    damped_modes,
    diagonal,
    mode_derivatives,
    respond,
    undamped_modes,
)
from jaxcomp.rotor._campbell import critical_speeds_between
from jaxcomp.vibration import loaded_rotor

SHAFT = ShaftElements((1, 2, 3), 0.2, 0.02, 2.06e11, 7850.0, 0.3)
DISK = Disks((2,), 5.0, 6e-3, 12e-3)


def rotor(stiffness=1e7, damping=0.0):
    bearing = Mount([stiffness] * 2, [damping] * 2)
    return RotorModel((SHAFT,), (DISK,), links=(Link((1, None), bearing), Link((3, None), bearing)))


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: ConstantLaw([[1e7, 2e6]], [[1.0, 0.0], [0.0, 1.0]]), "stiffness"),
        (lambda: ConstantLaw(np.eye(2), np.eye(3)), "damping"),
        (lambda: SpeedTable([1.0, 2.0], np.ones((2, 1, 2)), np.ones((2, 1, 2))), "stiffness"),
        (lambda: SpeedTable([1.0, 2.0], np.ones((2, 2, 2)), np.ones((2, 3, 3))), "damping"),
        (lambda: Disks((2,), 5.0, 6e-3, 13e-3), "Disks"),
        (lambda: Mount([1e7], [1.0], angular_stiffness=[5.0]), "angular_damping"),
        (lambda: BalancingPlanes((), (), [300.0]), "planes"),
        (lambda: damped_modes(rotor(), jnp.nan, 3), "spin_speed"),
        (lambda: critical_speeds(rotor(), 100), "count"),
        (lambda: RotorModel((SHAFT, ShaftElements((1, 2), 0.1, 0.03, 2e11, 0.0, 0.3))), "length"),
        (lambda: RotorModel((SHAFT, ShaftElements((2, 1), 0.2, 0.03, 2e11, 0.0, 0.3))), "length"),
    ],
)
def test_what_no_rotor_can_have_is_refused_by_name(build, field):
    with pytest.raises(BadInput) as error:
        build()
    assert field in error.value.field
    assert not str(error.value).endswith("but is .")


def test_elements_in_parallel_have_one_length_and_add_up():
    RotorModel((SHAFT, ShaftElements((1, 2), 0.2, 0.03, 2e11, 0.0, 0.3)), (DISK,))
    # two of the same are one of twice the modulus and twice the density
    links, free = rotor().links, (0.2, 0.02)
    single, nodes = (2.06e11, 7850.0, 0.3), (1, 2, 3)
    both = [ShaftElements(nodes, *free, *single)] * 2
    double = ShaftElements(nodes, *free, 2 * single[0], 2 * single[1], single[2])
    found = undamped_modes(RotorModel(tuple(both), (DISK,), links=links), 4).frequency
    one = undamped_modes(RotorModel((double,), (DISK,), links=links), 4).frequency
    np.testing.assert_allclose(found, one, rtol=1e-12)


def test_an_empty_word_is_named():
    assert str(BadInput("ring", "", "one of two")) == "`ring` must be one of two, but is empty."


@pytest.mark.parametrize("stiffness", [1e16, pytest.param(3e16, marks=pytest.mark.slow), 1e18])
def test_critical_speeds_on_stiff_springs_are_those_of_a_pinned_rotor(stiffness):
    """From 1e12 N/m on, the springs are a hundred thousand times as stiff as the shaft."""
    # the number that other tests ask for, which has its program
    pinned, found = (critical_speeds(rotor(k), 6) for k in (1e12, stiffness))
    # the springs of 1e12 N/m still move by 1e-6 of the disk
    np.testing.assert_allclose(found.speed[:2], pinned.speed[:2], rtol=1e-5)
    assert np.all(found.residual[:2] < 1e-10)
    assert bool(damped_modes(rotor(stiffness), 100.0, 4).stable)


def test_critical_speeds_on_soft_springs_go_with_the_root_of_the_stiffness():
    """Four of a rigid rotor, then the elastic ones, which do not notice the springs."""
    softer, soft = (critical_speeds(rotor(k), 6).speed for k in (1e-6, 1e-4))
    # the springs bend the shaft by 1e-12
    np.testing.assert_allclose(softer[:4], 0.1 * soft[:4], rtol=1e-9)
    np.testing.assert_allclose(softer[4:], soft[4:], rtol=1e-8)
    translation = np.sqrt(2e-6 / (5.0 + 0.4 * np.pi / 4 * 0.02**2 * 7850.0))
    np.testing.assert_allclose(softer[:2], translation, rtol=1e-9)


UNBALANCE = (Unbalances((2,), 1e-4, 0.0),)


@eqx.filter_jit
def traced_status(model):
    """One program for all rotors of a structure."""
    return respond(model, UNBALANCE, jnp.array([100.0])).status


@pytest.mark.parametrize(
    ("what", "value"),
    [("length", -0.2), ("density", -7850.0), ("inner_diameter", 0.03)],
)
def test_a_traced_rotor_out_of_bounds_is_marked(what, value):
    hollow = ShaftElements((1, 2, 3), 0.2, 0.02, 2.06e11, 7850.0, 0.3, inner_diameter=0.004)
    model = eqx.tree_at(lambda m: m.shafts[0], rotor(damping=10.0), hollow)
    place = lambda m: getattr(m.shafts[0], what)  # noqa: E731
    changed = eqx.tree_at(place, model, place(model).at[0].set(value))
    assert int(traced_status(model)[0, 0]) == 0
    assert respond(changed, UNBALANCE, jnp.array([100.0])).words == [["out of bounds"]]
    assert int(traced_status(changed)[0, 0]) != 0


@pytest.mark.slow
def test_modes_of_a_traced_rotor_out_of_bounds_are_not_numbers():
    model = rotor(damping=10.0)
    verbs = {
        "undamped": lambda m: undamped_modes(m, 2).square,
        "derivatives": lambda m: mode_derivatives(m, m, 2).square,
        "damped": lambda m: jnp.append(damped_modes(m, 100.0, 2).eigenvalue.real, 0.0),
        "growth": lambda m: damped_modes(m, 100.0, 2).growth,
        "campbell": lambda m: campbell(m, jnp.array([100.0]), 2).frequency,
        "critical": lambda m: critical_speeds(m, 2).speed,
    }

    @jax.jit
    def all_of(density):
        whole = eqx.tree_at(lambda m: m.shafts[0].density, model, density)
        return {name: verb(whole) for name, verb in verbs.items()}

    density = model.shafts[0].density
    for name, value in all_of(density).items():
        assert np.all(np.isfinite(value)), name
    for name, value in all_of(density.at[0].set(-7850.0)).items():
        assert np.all(np.isnan(np.ravel(value)[:2])), name


def test_motions_too_damped_to_peak_are_no_critical_speeds():
    """The bounce of a rigid rotor on dampers, with a damping ratio just below and above 0.707."""

    def on(damping):
        model = rotor(1e6, damping)
        model = eqx.tree_at(lambda m: m.shafts[0].young_modulus, model, jnp.full(2, 1e16))
        return critical_speeds_between(model, jnp.linspace(10.0, 1000.0, 12), 8)

    mass = 5.0 + 0.4 * np.pi / 4 * 0.02**2 * 7850.0
    edge = np.sqrt(1e6 * mass)  # of each bearing; the bounce has K = 2e6 N/m
    below, above = on(0.9 * edge), on(1.1 * edge)
    np.testing.assert_allclose(
        below.speed, np.sqrt(2e6 / mass) * np.sqrt(1 - 0.9**2 / 2), rtol=1e-3
    )
    assert above.speed.size == 0


def test_a_crossing_at_the_first_speed_of_a_range_counts(monkeypatch):
    model, diagram = rotor(1e6, 1.0), _campbell.campbell
    first = critical_speeds_between(model, jnp.linspace(10.0, 1000.0, 12), 8).speed[0]

    def on_the_line(*given, **options):
        """The diagram with the frequency at the first speed equal to it, to the last bit."""
        modes = diagram(*given, **options)
        lam = modes.eigenvalue
        near = jnp.argmin(jnp.abs(lam[0].imag - first))
        there = lam.at[0, near].set(lam[0, near].real + 1j * first)
        return eqx.tree_at(lambda m: m.eigenvalue, modes, there)

    monkeypatch.setattr(_campbell, "campbell", on_the_line)
    again = critical_speeds_between(model, first + jnp.array([0.0, 50.0, 100.0]), 8).speed
    assert np.isclose(again, first, rtol=1e-9).sum() == 1


def test_motions_along_and_about_the_shaft_have_no_whirl():
    """Their lateral part is rounding, whose sense means nothing."""
    bearing = Mount([1e7] * 2, [10.0] * 2)
    along = Link((1, None), diagonal([1e7, 1e3], [10.0, 1.0]), ("uz", "thz"))
    links = (Link((1, None), bearing), Link((3, None), bearing), along)
    modes = damped_modes(RotorModel((SHAFT,), (DISK,), links=links, dof=6), 100.0, 6)
    lateral = np.abs(np.asarray(modes.shape)[..., :2]).max((-2, -1)) > 1e-6
    assert not lateral.all()
    np.testing.assert_array_equal(np.asarray(modes.whirl)[~lateral], 0.0)
    assert np.all(np.abs(np.asarray(modes.whirl)[lateral]) > 1e-3)


@pytest.mark.parametrize("axes", [("ux",), ("uy",), ("ux", "uy")])
def test_a_point_without_mass_between_two_springs_may_move_along_one_axis(axes):
    """Two springs in series behind a bearing: half of the stiffness of one."""
    law = diagonal([2e6] * len(axes), [0.0] * len(axes))
    chain = (Link((2, "f"), law, axes), Link(("f", None), law, axes))
    # one program for all axes: along the others there is a spring without stiffness
    half = diagonal([1e6 * (axis in axes) for axis in ("ux", "uy")], [0.0, 0.0])
    speed = jnp.array([50.0])
    ends = rotor(1e6, 1.0).links
    series, single = (
        respond(RotorModel((SHAFT,), (DISK,), links=(*ends, *more)), UNBALANCE, speed)
        for more in (chain, (Link((2, None), half, ("ux", "uy")),))
    )
    assert series.words == [["ok"]]
    at = [list(series.nodes).index(node) for node in "123"]
    np.testing.assert_allclose(
        series.displacement[:, :, at], single.displacement, rtol=1e-9, atol=1e-18
    )


@pytest.mark.slow
def test_overdamped_motions_stand_behind_the_modes():
    """Stiff bars with stiffness damping creep at -5e5 /s, with a small imaginary part."""
    model = loaded_rotor(load("hermetic-68cc").assembly, jnp.array([314.0]))
    for free in (False, True):
        modes = damped_modes(model, 310.0, 12, free=free)
        assert np.all(np.abs(modes.eigenvalue) < 1e5)
        assert np.all(np.asarray(modes.damping_ratio) < 0.9)
        assert np.all(np.diff(np.abs(modes.eigenvalue)) >= 0)


@pytest.mark.slow
def test_starts_of_close_critical_speeds_lead_to_both():
    """26.63 and 26.69 rad/s on the suspension, forward and backward; one of them was missed."""
    model = loaded_rotor(load("hermetic-68cc").assembly, jnp.array([314.0]))
    both = critical_speeds_between(model, jnp.linspace(20.0, 40.0, 5), 6).speed
    np.testing.assert_allclose(critical_speeds(model, 8).speed[:2], both, rtol=1e-8)
    assert both.shape == (2,)


_DEVICES = """
import jax, jax.numpy as jnp
first, second = jax.devices()
jax.config.update("jax_default_device", second)
from jaxcomp.rotor import *
bearing = Mount([1e7, 1e7], [10.0, 10.0])
shaft = ShaftElements((1, 2), 0.2, 0.02, 2.06e11, 7850.0, 0.3)
rotor = RotorModel((shaft,), links=(Link((1, None), bearing), Link((2, None), bearing)))
assert damped_modes(rotor, 100.0, 2).eigenvalue.devices() == {first}
assert campbell(rotor, jnp.array([100.0, 200.0]), 2).eigenvalue.devices() == {first}
assert undamped_modes(rotor, 2).square.devices() == {second}
"""


@pytest.mark.slow
def test_the_unsymmetric_eigenproblem_runs_on_the_cpu():
    """A second device of the host stands for an accelerator, which may lack `eig`."""
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    subprocess.run(
        [sys.executable, "-c", _DEVICES], check=True, env=os.environ | flags, timeout=120
    )
