"""Loads from the crank's periodic state, and the bundled hermetic compressor."""

from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, Collocation, load, solve_orbit
from jaxcomp.compressor import loads_at
from jaxcomp.rotor import CrankNodes, RotorModel, crankshaft_of, node_index, respond, undamped_modes
from jaxcomp.rotor._loads import load_vector
from jaxcomp.rotor._modes import magnetic_pull_limit
from jaxcomp.rotor._shaft import shaft_mass
from jaxcomp.scene import with_value
from jaxcomp.vibration import shaking_wrench
from jaxcomp.vibration._coupling import crank_forces, crank_loads, loaded_rotor, without

ORDERS = tuple(range(13))
WALL = 0.08  # x of the wall's node in the file: 10 mm to the centre of inertia and 70 mm on


@pytest.fixture(scope="module")
def scene():
    return load("hermetic-68cc")


@pytest.fixture(scope="module")
def orbit(scene):
    return solve_orbit(scene.compressor, Collocation(nodes=24))


# one program, where every operation outside of one is compiled by itself
compiled_crank_forces = eqx.filter_jit(crank_forces)


def forces_of(scene, orbit, orders=ORDERS):
    return compiled_crank_forces(scene.compressor, orbit, scene.parts["loads"].crank, orders)


def harmonics(values, orbit, mechanism, orders=ORDERS):
    """Coefficients a_n - i b_n (orders, k) of values (k, n) in the orbit's own quadrature."""
    share = orbit.weight / orbit.state.speed
    phase = orbit.mean_speed * orbit.time + mechanism.dead_centres()[0]
    waves = np.exp(-1j * np.outer(orders, phase)) * np.where(np.array(orders) == 0, 1, 2)[:, None]
    return (waves * np.asarray(share / jnp.sum(share))) @ np.asarray(values).T


@eqx.filter_jit
def with_loads(compressor, orbit):
    """The orbit with the loads that the joints of a machine have in its motion."""
    return eqx.tree_at(lambda o: o.loads, orbit, loads_at(compressor, orbit.state))


def test_forces_add_up_to_the_inertia_force_alone(scene):
    # Any motion does for a sum of forces: that of the machine without friction is found by a program of a
    # quarter the size, and the loads on the joints are those with friction at each of its nodes.
    smooth = without(scene.compressor, ("friction",))
    motion = solve_orbit(smooth, Collocation(nodes=24, reversals=0, estimate=False))
    orbit = with_loads(scene.compressor, motion)
    found = forces_of(scene, orbit)
    mechanism = scene.compressor.mechanism
    rod, gas, wall, _ = found.forces
    force = sum(f.cosine - 1j * f.sine for f in found.forces[:3])
    # About the crank centre: the wall's node stands WALL ahead of it.
    moment = sum(f.moment_cosine - 1j * f.moment_sine for f in found.forces[:3])[:, 2]
    moment = moment + WALL * (wall.cosine - 1j * wall.sine)[:, 1]
    # Rod and piston without the crank, which carries its own inertia in the rotor model.
    wrench = shaking_wrench(mechanism, orbit.state)
    size = float(jnp.abs(wrench.force).max())
    # Linear in the forces at every node of the orbit: rounding only.
    shaken = harmonics(wrench.force[:2], orbit, mechanism)
    np.testing.assert_allclose(force[:, :2], shaken, atol=1e-11 * size)
    turned = harmonics(wrench.moment[2:], orbit, mechanism)[:, 0]
    np.testing.assert_allclose(moment, turned, atol=1e-11 * size * WALL)
    # What cancels is not small.
    np.testing.assert_array_less(
        2 * np.abs(force[3, 0]), np.abs(gas.cosine[3, 0] - 1j * gas.sine[3, 0])
    )
    assert float(jnp.abs(rod.cosine[0, 0])) > 100


@pytest.mark.slow
def test_coefficients_converge_with_the_orbit_and_truncation_is_reported(scene, orbit):
    fine = solve_orbit(scene.compressor, Collocation(nodes=36))
    for a, b in zip(forces_of(scene, orbit).forces, forces_of(scene, fine).forces, strict=True):
        # Panels end at the kinks, so that Gauss's rule converges exponentially: 4e-12 N seen.
        np.testing.assert_allclose(a.cosine, b.cosine, atol=1e-9)
        np.testing.assert_allclose(a.moment_sine, b.moment_sine, atol=1e-9)
    few, more, many = (forces_of(scene, orbit, tuple(range(n))).missing for n in (3, 6, 13))
    for name in ("rod", "gas", "wall"):
        # Kinks: coefficients fall with n^-2, their tail with n^-1.5.
        assert float(many[name]) < 0.5 * float(more[name]) < 0.3 * float(few[name])
        assert float(many[name]) < 0.05
    # The share of the energy beyond order two, from the values themselves.
    gas = scene.compressor.gas.behind_piston
    values = (orbit.pressure[0] - gas) * scene.compressor.mechanism.piston_area
    share = orbit.weight / orbit.state.speed
    power = float(jnp.sum(share * values**2) / jnp.sum(share))
    c = harmonics(values[None], orbit, scene.compressor.mechanism, (0, 1, 2))[:, 0]
    kept = abs(c[0]) ** 2 + (abs(c[1]) ** 2 + abs(c[2]) ** 2) / 2
    # Parseval's sum, with the waves orthogonal to 1e-12 in this quadrature.
    assert float(few["gas"]) == pytest.approx(np.sqrt(1 - kept / power), rel=1e-9)


@pytest.mark.slow
def test_gas_and_motor_torque_turn_rotor_and_crankcase(scene, orbit):
    six = loaded_rotor(with_value(scene, "rotor.dof", 6).assembly, jnp.array([314.0]))
    found = forces_of(scene, orbit, (1,))
    case, pin, core = (node_index(six, n) for n in ("crankcase", 21, 6))
    f = load_vector(six, found.forces, 1, found.spin_speed)
    motor = load_vector(six, found.forces[3:], 1, found.spin_speed)
    assert complex(motor[core, 5]) == -complex(motor[case, 5]) != 0
    r = respond(six, found.forces, found.spin_speed[None]).checked()
    rotor, block = r.displacement[0, 0, jnp.array([core, case]), 5]
    # The rotor turns freely at this frequency, J w^2 theta = torque, but for the torsion of the shaft
    # with a frequency of a kHz: (50 Hz/1 kHz)^2.
    polar, w = float(scene.compressor.crankshaft.inertia), float(found.spin_speed)
    torque = complex(f[pin, 5] + f[core, 5])
    assert complex(rotor) == pytest.approx(-torque / (polar * w**2), rel=0.01)
    # And the crankcase turns about the vertical, which a lateral model cannot show.
    assert abs(block) > 1e-6


def test_other_mechanisms_are_refused():
    other: Any = SimpleNamespace(mechanism=object(), crankshaft=None)
    orbit: Any = None  # which nothing looks at
    with pytest.raises(BadInput, match="slider-crank or slider-link, but is object"):
        crank_forces(other, orbit, CrankNodes(21, "head", "wall"))


def test_hermetic_machine_has_the_printed_figures(scene):
    model, loads = scene.parts["rotor"], scene.parts["loads"]
    tables = model.shafts
    assert [len(t.nodes) for t in tables] == [2, 6, 6, 6, 11, 4, 6]  # 41 elements
    # Table 1: rings, laminations, laminations with bars, laminations, cast iron (pin and arms massless)
    moduli = [float(t.young_modulus[0]) * 1e-9 for t in tables]
    assert moduli == pytest.approx([70, 5, 37.5, 5, 180, 180, 180])
    densities = [float(t.density[0]) for t in tables]
    assert densities == pytest.approx([2700, 7800, 5250, 7800, 7200, 0, 7200])
    rotor = sum(float(jnp.sum(shaft_mass(t))) for t in tables) + float(model.disks[0].mass.sum())
    # "Roughly" 3.5, 15 and 7 kg, 26 kg with piston and rod.
    assert rotor == pytest.approx(3.5, abs=1e-3)
    assert [float(b.mass) for b in model.bodies] == [15.0, 7.0]
    moving = scene.compressor.mechanism.piston_mass + scene.compressor.mechanism.conrod_mass
    assert rotor + 22 + float(moving) == pytest.approx(26, abs=1e-3)
    assert not np.any(tables[5].density)  # crank pin and arms, elements 32 to 35
    sums = {float(u.phase[0]): float(jnp.sum(u.magnitude)) * 1e6 for u in loads.unbalances}
    assert sums == pytest.approx({np.pi: 4458, 0.0: 3983}, rel=1e-12)
    planes = scene.parts["balancing"]
    assert [p.node for p in planes.planes] == [6, 48]
    assert [t.name for t in planes.targets] == [f"TP{i}" for i in range(1, 8)]
    np.testing.assert_allclose(planes.speeds, np.array([3000, 3600]) * np.pi / 30)
    swept = float(scene.compressor.mechanism.swept_volume)
    assert swept == pytest.approx(68e-6, rel=1e-3)
    # The crankshaft is the rotor: inertia from the mass matrix, mass and balance from the tables.
    described = scene.machine.compressor.crankshaft
    shaft = crankshaft_of(model, described, loads.unbalances, (21,))
    assert float(shaft.inertia) == pytest.approx(_polar(model), rel=1e-12)
    assert float(shaft.mass) == pytest.approx(rotor, rel=1e-12)
    np.testing.assert_allclose(shaft.shaft_unbalance, [-475e-6, 0.0], atol=1e-15)
    assert float(scene.compressor.crankshaft.inertia) == float(shaft.inertia)


def _polar(model):
    """[kg m2] Of all shafts and disks: their inertia in a rigid torsion."""
    from jaxcomp.rotor import matrices
    from jaxcomp.rotor._nodes import node_names

    free = RotorModel(model.shafts, model.disks, dof=6)
    turn = np.zeros((len(node_names(free)), 6))
    turn[:, 5] = 1.0
    turn = turn.reshape(-1)
    return float(turn @ np.asarray(matrices(free).mass) @ turn)


@pytest.mark.slow
def test_hermetic_machine_is_stable_and_softly_hung(scene):
    model = loaded_rotor(scene.assembly, jnp.array([314.0]))
    assert float(magnetic_pull_limit(model, 314.0)) > 2
    hertz = np.asarray(undamped_modes(model, 9, spin_speed=314.0).frequency) / (2 * np.pi)
    # two bodies with four rigid motions each, below 50 Hz; the fitted springs bring the highest to 49.6
    assert np.all(hertz[:8] < 50)
    assert hertz[8] > 100


@pytest.mark.slow
def test_derivative_through_the_crank(scene, orbit):
    # From the piston's mass to the motion of the housing, with the orbit's own derivative.
    machine, model = scene.compressor, loaded_rotor(scene.assembly, jnp.array([314.0]))

    @jax.jit
    def motion(mass):
        moved = eqx.tree_at(lambda c: c.mechanism.piston_mass, machine, mass)
        state = solve_orbit(moved, Collocation())
        found = crank_forces(moved, state, scene.parts["loads"].crank, (1,))
        r = respond(model, found.forces, found.spin_speed[None], nodes=("housing",))
        return 1e6 * jnp.sum(jnp.abs(r.displacement[0, 0, 0, :2]) ** 2) ** 0.5

    mass, h = float(machine.mechanism.piston_mass), 1e-4
    slope = float(jax.grad(motion)(mass))
    difference = float(motion(mass + h) - motion(mass - h)) / (2 * h)
    # Truncation (3e-4)^2; the orbit is converged to 1e-8, 1e-5 after division by the step.
    assert slope == pytest.approx(difference, rel=1e-5)


@pytest.mark.slow
def test_gas_and_inertia_add_up_at_constant_speed(scene):
    """Without friction and fluctuation the forces are linear in their two causes."""
    speed = jnp.asarray(314.0)

    def rod(*left_out):
        found = crank_loads(
            scene.assembly,
            speed,
            ORDERS,
            Collocation(nodes=24),
            left_out=("friction", "fluctuation", *left_out),
        )
        assert bool(found.ok)
        force = found.forces[0]
        return np.asarray(force.cosine - 1j * force.sine)[:, :2]

    both, gas, inertia = rod(), rod("inertia"), rod("gas")
    size = np.abs(both).max()
    # What is left of inertia and fluctuation is a millionth of each.
    np.testing.assert_allclose(gas + inertia, both, atol=3e-6 * size)
    assert np.abs(gas).max() > 0.1 * size
    assert np.abs(inertia).max() > 0.1 * size
    with pytest.raises(BadInput, match=r"without.*one of.*gas.*oil"):
        rod("oil")
