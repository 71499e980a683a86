"""Crank and gas that agree where the speed fluctuates much: against a march of both in time."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import golden
from cylinder.test_transient_valves import light_rod

from jaxcomp import Compressor, simulate, solve_orbit
from jaxcomp._core.polynomials import gauss
from jaxcomp.crank import TimeIntegration, orbit_at_constant_speed
from jaxcomp.crank._collocation import default_collocation
from jaxcomp.crank._cycle_coupling import Motion, _combined, _excess_at
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder._cylinder import Pace
from jaxcomp.motor import SlipLine


def light_crank(name):
    """A golden machine whose speed fluctuates by a tenth; adiabatic, since a correlation of heat sees
    the mean speed in the periodic cycle, and the speed of the moment in time."""
    gas = eqx.tree_at(lambda gas: gas.heat, golden(name), None)
    return Compressor(light_rod(), Crankshaft(2e-5), SlipLine(0.05, 300.0), gas)


def delivered_in_time(machine, orbit):
    """[kg] Delivered in the 41st revolution of a march that begins at the mean speed."""
    period = 2 * np.pi / float(orbit.mean_speed)
    options = TimeIntegration(tolerance=1e-9, samples=101, max_steps=2**17)
    masses = []
    for revolutions in (40, 41):
        # from the bottom dead centre on, where nothing is delivered
        march = simulate(
            machine, revolutions * period, angle=np.pi, speed=orbit.mean_speed, options=options
        )
        masses.append(float(jnp.sum(march.gas.totals.discharge)))
    return masses[1] - masses[0]


# By collocation both are known to 1e-9. The march of the cycle repeats within 1e-7, and the speed within
# 1e-6 of what it was in the step before; with the mean speed in its place it delivers 7 % more.
@pytest.mark.slow  # two programs with valves to compile
@pytest.mark.parametrize(("name", "tolerance"), [("D", 1e-9), ("A", 2e-6)])
def test_the_gas_sees_the_fluctuation_of_the_speed(name, tolerance):
    machine = light_crank(name)
    orbit = solve_orbit(machine)
    assert float(orbit.speed_fluctuation) > 0.09
    mass = float(orbit.cycle.mass_flow) * 2 * np.pi / float(orbit.mean_speed)
    np.testing.assert_allclose(mass, delivered_in_time(machine, orbit), rtol=tolerance)
    if name == "A":
        assert orbit.cycle.solver == "march"
        steady = orbit_at_constant_speed(machine, default_collocation(machine))
        assert abs(float(steady.cycle.mass_flow / orbit.cycle.mass_flow) - 1) > 0.05


def pace_of_cubic(edges, factor, nodes=4):
    places = gauss(nodes).nodes
    angle = edges[:-1, None] + np.diff(edges)[:, None] * places
    return Pace(jnp.asarray(edges), jnp.asarray(factor * (angle - 2) ** 3))


@pytest.mark.parametrize("cylinders", [None, 2])
def test_motions_on_different_panels_are_combined_on_the_newest(cylinders):
    """Cubics on four nodes a panel are exact on any panels."""
    first, second = np.linspace(0, 2 * np.pi, 5), np.array([0, 1, 2.5, 6, 2 * np.pi])
    paces = [pace_of_cubic(first, 1.0), pace_of_cubic(second, 3.0)]
    if cylinders:
        paces = [jax.tree.map(lambda leaf: np.stack([leaf] * cylinders), pace) for pace in paces]
    motions = [
        Motion(jnp.asarray(float(k)), pace, jnp.asarray(k + 0.5)) for k, pace in enumerate(paces)
    ]
    angle = jnp.linspace(0.1, 6.0, 17)

    @jax.jit  # as one program: outside of one every operation is compiled by itself
    def combined(motions):
        outputs = jax.tree.map(lambda *leaves: jnp.stack(leaves), *motions)
        mixed = _combined(jnp.array([-0.25, 1.25]), outputs, motions[0])
        return mixed, _excess_at(mixed.pace, angle)

    mixed, found = combined(motions)
    np.testing.assert_allclose(mixed.level, 1.25)
    np.testing.assert_allclose(mixed.rise, 1.75)
    assert mixed.pace.edges.shape == paces[0].edges.shape
    wanted = (-0.25 + 3.75) * (np.asarray(angle) - 2) ** 3
    np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), rtol=1e-12, atol=1e-12)
