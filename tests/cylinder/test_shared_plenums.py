"""Cylinders that share their plenums: solved together, against one cylinder, time and differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cylinder.test_cylinder import COLLOCATION, SPEED
from cylinder.test_transient_valves import BEHIND, light_rod, with_plenums

from jaxcomp import Compressor, ConstantSpeed, SlipLine, load, simulate, solve_orbit
from jaxcomp._core.fields import replaced
from jaxcomp.crank import Collocation, TimeIntegration
from jaxcomp.crankshaft import Crankshaft, Throw
from jaxcomp.cylinder import Annand, CycleOptions, WallNetwork, _cylinder, solve_cycle
from jaxcomp.cylinder._cylinder_system import Cylinders
from jaxcomp.scene import with_values

# parts of larger programs, each compiled once for machines of one structure
prepare = eqx.filter_jit(_cylinder.prepare)
initial = eqx.filter_jit(Cylinders.initial)
rates = eqx.filter_jit(Cylinders.rates)


def for_two(rows):
    """Plenums for twice the flow, by the same laws: volume and neck of twice the size."""
    return tuple((2 * v, T, length, 2 * area, loss) for v, T, length, area, loss in rows)


def twin(apart: float, gas=None, mechanism=None) -> Compressor:
    """Two cylinders whose cranks stand `apart` [rad], at constant speed."""
    throws = [Throw(np.zeros(1), angle, 0.1 * place) for place, angle in enumerate((0.0, apart))]
    crankshaft = Crankshaft(8e-4, throws=tuple(throws))
    gas = with_plenums(for_two(BEHIND), for_two(BEHIND)) if gas is None else gas
    return Compressor(mechanism or light_rod(), crankshaft, ConstantSpeed(SPEED), gas)


SOLVER = Collocation(cycle=CycleOptions(panels=48, nodes=8))


def with_walls(gas):
    """Heat to walls whose temperature follows from a balance, with conductances to both plenums."""
    walls = WallNetwork(
        ambient_temperature=300.0,
        ambient_conductance=0.4,
        suction_conductance=0.05,
        discharge_conductance=0.1,
    )
    given = (Annand(), 380.0, walls)

    def get(c):
        return c.heat, c.wall_temperature, c.walls

    return eqx.tree_at(get, gas, given, is_leaf=lambda leaf: leaf is None)


def test_the_jacobian_of_cylinders_is_that_of_their_rates():
    """Unequal cylinders with walls and plenums: assembled from parts, against all at once."""
    gas = with_walls(with_plenums(BEHIND, BEHIND))
    bores = jnp.array([22e-3, 24e-3, 20e-3])
    pistons = jax.vmap(lambda bore: eqx.tree_at(lambda m: m.bore, light_rod(), bore))(bores)
    cases = jax.vmap(lambda piston: prepare(gas, piston, SPEED))(pistons)
    system = Cylinders(cases, jnp.array([0.0, 2.0, 4.5]))
    angle = jnp.asarray(-1.2)
    state, flags = initial(system, angle)
    rng = np.random.default_rng(1)
    state = state + 0.03 * rng.standard_normal(state.size)
    state = state.at[system.columns(2, 5)].set(rng.uniform(0.2, 0.8, 6))
    flags = flags.at[::3].set(1)  # all valves off their seats

    def law(arguments):
        found = system.rates(arguments[-1], arguments[:-1], flags)
        values = found.state, found.events
        return values, values

    value, by_state, by_events = jax.jit(lambda *given: system.jacobian(*given))(
        angle, state, flags
    )
    # along one list of states and angle, so that the law is compiled once
    slopes, (wanted, events) = jax.jit(jax.jacfwd(law, has_aux=True))(jnp.append(state, angle))
    of_state, of_events = map(np.asarray, slopes)
    for got, exact in (
        (value[0], wanted),
        (value[1], events),
        (by_state[0], of_state[:, :-1]),
        (by_state[1], of_state[:, -1]),
        (by_events[0], of_events[:, :-1]),
        (by_events[1], of_events[:, -1]),
    ):
        # rounding of the sums, against the largest entry of each
        np.testing.assert_allclose(got, exact, rtol=0, atol=1e-12 * np.max(np.abs(exact)) + 1e-14)


def test_cylinders_in_step_see_the_plenums_of_one():
    """Rates of two in step with plenums and necks of twice the size are those of one."""
    one = Cylinders(prepare(with_plenums(BEHIND, BEHIND), light_rod(), SPEED), jnp.zeros(1))
    case = prepare(with_plenums(for_two(BEHIND), for_two(BEHIND)), light_rod(), SPEED)
    two = Cylinders(jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), case), jnp.zeros(2))
    state, flags = initial(one, -1.2)
    both, of_both = map(np.asarray, initial(two, -1.2))
    np.testing.assert_array_equal(both, np.concatenate([state[:8], state]))
    # off the guess, so that gas flows in valves and necks; by NumPy, without programs
    state = np.array(state) + 0.02
    state[[2, 5]] = 0.5
    flags = np.array(flags)
    flags[::3] = 1
    both, of_both = np.concatenate([state[:8], state]), np.concatenate([flags, flags])
    wanted, got = rates(one, -1.2, state, flags), rates(two, -1.2, both, of_both)
    np.testing.assert_allclose(got.state[8:], wanted.state, rtol=1e-12)
    np.testing.assert_allclose(got.state[:8], wanted.state[:8], rtol=1e-12)
    np.testing.assert_allclose(got.pressure, np.repeat(wanted.pressure, 2), rtol=1e-12)


@pytest.mark.slow  # a minute of compilation
def test_two_in_step_have_the_cycle_of_one():
    """Every event of the two coincides, and the plenums see twice the flow."""
    one = solve_cycle(with_plenums(BEHIND, BEHIND), light_rod(), SPEED, COLLOCATION)
    orbit = solve_orbit(twin(0.0), Collocation(cycle=COLLOCATION))
    each = orbit.cycle.each
    # the necks ring some twenty times a revolution, which ten nodes on a panel resolve to 1e-5 of their
    # flow; the meshes are not the same: 1.1e-6 seen
    np.testing.assert_allclose(each.delivered, jnp.repeat(one.delivered, 2), rtol=5e-6)
    np.testing.assert_allclose(each.indicated_work, jnp.repeat(one.indicated_work, 2), rtol=5e-6)
    assert abs(orbit.cycle.mass_closure) < 1e-13
    assert abs(orbit.cycle.energy_closure) < 1e-12


@pytest.mark.slow  # a minute of compilation
def test_the_periodic_state_is_where_time_leads():
    """The flow of a late revolution in time, with every cylinder's own share."""
    # a flywheel: the heat transfer sees the speed of the instant in time, and the mean one here, which
    # costs 2e-5 without
    steady = twin(np.pi)
    crankshaft = replaced(steady.crankshaft, inertia=0.08)
    machine = replaced(steady, crankshaft=crankshaft, motor=SlipLine(5.0, 300.0))
    orbit = solve_orbit(machine, SOLVER)
    period, each = 2 * np.pi / float(orbit.mean_speed), orbit.cycle.each
    options = TimeIntegration(tolerance=1e-9, max_steps=80_000)
    early, late = (
        simulate(machine, turns * period, speed=orbit.mean_speed, options=options).gas.totals
        for turns in (30, 31)
    )
    # differences of totals 30 times as large that were marched at 1e-9 a step, and 8 nodes on a panel
    np.testing.assert_allclose(each.delivered, late.discharge - early.discharge, rtol=5e-6)
    np.testing.assert_allclose(each.totals.work, late.work - early.work, rtol=5e-6)


@pytest.mark.slow  # two minutes of compilation
def test_derivatives_are_those_of_differences():
    base = twin(np.pi)

    @jax.jit
    def outputs(change):
        made = eqx.tree_at(
            lambda c: (c.gas.suction.plenums[0].volume, c.crankshaft.throws[1].angle),
            base,
            (2 * BEHIND[0][0] * jnp.exp(change[0]), np.pi + change[1]),
        )
        each = solve_orbit(made, SOLVER, throw=False).cycle.each
        return jnp.log(jnp.concatenate([each.delivered, each.indicated_work]))

    zero, step = jnp.zeros(2), 1e-4
    got = jax.jit(jax.jacfwd(outputs))(zero)
    ways = step * jnp.eye(2)
    wanted = np.stack([(outputs(w) - outputs(-w)) / (2 * step) for w in ways], axis=1)
    # the panels are laid anew after every march, and eight nodes on them resolve the necks to 1e-6
    np.testing.assert_allclose(got, wanted, rtol=1e-4, atol=1e-5 * np.max(np.abs(wanted)))


SHARED = {
    "crankshaft.layout": "in-line-2",
    "crankshaft.throw_pitch": "40 mm",
    "gas.suction.plenums": [{"volume": "50 cm3", "neck_length": "20 mm", "neck_diameter": "9 mm"}],
}


@pytest.mark.slow  # a minute of compilation
def test_a_speed_that_varies_is_that_of_both():
    orbit = solve_orbit(with_values(load("r134a-7cc"), SHARED), verify=True)
    assert orbit.converged
    # cranks half a revolution apart see the same: two events at a time, never at one place
    each = orbit.cycle.each
    np.testing.assert_allclose(each.delivered[0], each.delivered[1], rtol=1e-8)
    np.testing.assert_allclose(orbit.energy.gas_work, orbit.cycle.indicated_work, rtol=1e-9)
    assert abs(orbit.energy.residual) < 1e-12
    assert orbit.verification.speed_error < 1e-7  # of the mean; 6e-9 seen
