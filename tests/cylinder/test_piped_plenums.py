"""Plenums between pipes and valves: by differences, in limits, and against pipes alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from reference_pipes import AIR, SPEED, crank, cylinder, suction_pipe, valves

from jaxcomp import BadInput, Status
from jaxcomp._core.each import stacked
from jaxcomp._core.fields import rebuilt
from jaxcomp.cylinder import (
    CrankEnd,
    CycleOptions,
    Cylinder,
    DischargeLine,
    LaminarGap,
    Plenum,
    SuctionLine,
    _cylinder,
    _solve_cycle,
    solve_cycle,
)
from jaxcomp.cylinder._cylinder_system import Cylinders
from jaxcomp.cylinder._ends import ends_of
from jaxcomp.cylinder._solve_cycle import solve_cycles
from jaxcomp.cylinder._waves import waves_at_rest
from jaxcomp.mechanism import SliderCrank
from jaxcomp.piping import Orifice, Pipes, Piping, Volume

# parts of larger programs, compiled as a whole
prepare = eqx.filter_jit(_cylinder.prepare)
system_of_ends = eqx.filter_jit(_solve_cycle._system_of_ends)
initial = eqx.filter_jit(Cylinders.initial)

BOTTLE = Plenum(0.002, 0.1, 0.025, 0.0)


def machine(suction=None, discharge=None, before=(), behind=()):
    """The machine with networks and plenums in its lines."""
    return Cylinder(
        AIR,
        SuctionLine(pressure=1e5, temperature=300.0, piping=suction, plenums=before),
        DischargeLine(pressure=4e5, temperature=445.8, piping=discharge, plenums=behind),
        *valves(),
        clearance_ratio=0.04,
    )


def delivery(count):
    """A discharge pipe whose gas has the temperature of what is delivered."""
    numbers = [""] if count == 1 else [f"-{number}" for number in range(1, count + 1)]
    pipes = [Pipes((f"flange{number}", "tee"), 0.5, 0.03) for number in numbers]
    pipes.append(Pipes(("tee", "line"), 0.7, 0.03))
    return Piping(tuple(pipes), orders=6)


def check_slopes(system):
    """Compare slopes that Newton's method puts together with those of the law as a whole.

    At a point that solves nothing.
    """
    rng = np.random.default_rng(2)
    sides = []
    for side in waves_at_rest(system.first.cylinder):
        sides.append(side._replace(pressure=0.01 * rng.normal(size=side.pressure.shape)))
    system = system.with_waves((sides[0], sides[1]))
    angle = jnp.asarray(0.3)
    # by NumPy, where every operation of JAX would be a program
    state, flags = map(np.array, initial(system, angle))
    state *= 1 + 0.03 * rng.normal(size=state.size)
    # suction valves on their way, so that gas flows
    count = system.count
    flags.reshape(count, 6)[:, 0] = 1
    state[np.asarray(system.columns(2, 3, 4))] = np.tile([0.4, 0.1, 0.05], count)
    rows = eqx.filter_jit(Cylinders.jacobian_at_flanges)(system, angle, state, flags)
    rows = jax.tree.map(np.asarray, rows)

    none = [np.zeros(side.pressure.shape) for side in system.waves]
    arguments, separate = ravel_pytree((angle, state, none))

    def law(arguments):
        angle, state, pressures = separate(arguments)
        sides = []
        for side, change in zip(system.waves, pressures, strict=True):
            sides.append(side._replace(pressure=side.pressure + change))
        moved = system.with_waves((sides[0], sides[1]))
        at, observed = moved.observe(angle, state, flags)
        values = at.state, at.events, observed
        return values, values

    # along one list of all arguments: the law is compiled once and not for each of the three
    slopes, values = jax.jit(jax.jacfwd(law, has_aux=True))(arguments)
    (state_1, events), (by_state, turned), (events_by_state, events_turned) = rows.panels
    together = (
        (state_1, turned, by_state, rows.state_by_pressure),
        (events, events_turned, events_by_state, rows.events_by_pressure),
        (
            rows.observed,
            rows.observed_by_angle,
            rows.observed_by_state,
            rows.observed_by_pressure,
        ),
    )
    for value, slope, parts in zip(values, slopes, together, strict=True):
        np.testing.assert_allclose(parts[0], value, rtol=1e-12, atol=1e-14)
        slope = np.asarray(slope)
        by_angle = slope[..., 0]
        by_state, by_waves = np.split(slope[..., 1:], [state.size], axis=-1)
        of_law = by_angle, by_state, by_waves.reshape(value.size, -1)
        for own, whole in zip((*parts[1:3], parts[3] @ rows.basis), of_law, strict=True):
            scale = np.abs(whole).max() + 1e-30
            np.testing.assert_allclose(own, whole, rtol=1e-9, atol=1e-12 * scale)
    assert np.abs(rows.observed[0]) > 0


@pytest.mark.parametrize(
    ("count", "behind"),
    [(1, (BOTTLE,)), (2, (BOTTLE,)), (2, ())],
    ids=["one", "two", "two with flanges of their own"],
)
def test_slopes_of_the_law_behind_plenums_and_pipes(count, behind):
    """Those that Newton's method puts together, against those of the law as a whole."""
    gas = machine(suction_pipe(1.8, orders=6), delivery(1 if behind else count), (BOTTLE,), behind)
    cases = stacked([prepare(gas, crank(), SPEED)] * count)
    if count == 1:
        cases = jax.tree.map(lambda leaf: leaf[0], cases)
    check_slopes(Cylinders(cases, jnp.linspace(0.0, 2.0, count)))


@pytest.mark.parametrize("flange", ["one flange", "a flange of each end"])
def test_slopes_of_the_law_of_both_ends_of_a_cylinder(flange):
    """With gas past the rings from one to the other."""
    end = CrankEnd(rod_diameter=0.02, packing=LaminarGap(2e-5, 0.06, 2e-5))
    gas = rebuilt(
        machine(suction_pipe(1.8, orders=6), delivery(1 if flange == "one flange" else 2)),
        crank_end=end,
        leakage=LaminarGap(4e-5, 0.03, 2e-5),
    )
    system = system_of_ends(ends_of(gas, [crank()], jnp.zeros(1)), jnp.asarray(SPEED), None)
    assert system.leaks_between
    check_slopes(system)


def test_plenums_share_one_flange():
    laterals = Piping(
        (Pipes(("flange-1", "tee", "line"), 0.4, 0.04), Pipes(("flange-2", "tee"), 0.4, 0.04))
    )
    with pytest.raises(BadInput, match=r"suction\.piping\.pipes"):
        machine(laterals, before=(BOTTLE,))
    machine(discharge=laterals, before=(BOTTLE,))


def solved(gas):
    cycle = solve_cycle(gas, crank(), SPEED)
    assert cycle.status == Status.converged
    assert abs(float(cycle.energy_closure)) < 1e-9
    assert abs(float(cycle.mass_closure)) < 1e-9
    return cycle


# a program of its own for every network, each with a minute of compilation on two busy cores
@pytest.mark.slow
def test_a_short_pipe_behind_plenums_is_none():
    # 1 mm of a pipe 0.2 m wide: an inertance of 0.03 1/m beside 200 1/m of the neck
    short = Piping((Pipes(("flange", "line"), 1e-3, 0.2, attenuation=0.0),), orders=16)
    piped = solved(machine(short, before=(BOTTLE,)))
    alone = solved(machine(before=(BOTTLE,)))
    # the inertance changes the neck's by 1.6e-4, and that the flow by a hundredth of it
    for name in ("indicated_work", "volumetric_efficiency"):
        assert float(getattr(piped, name)) == pytest.approx(float(getattr(alone, name)), rel=1e-5)
    assert float(piped.pulsation.largest) < 1e-3


@pytest.mark.slow
def test_a_plenum_before_a_pipe_is_a_volume_with_a_neck():
    """A network that is all pipes, but for what is linear there and has no length here."""
    chain = (
        Pipes(("flange", "neck"), 0.1, 0.025, attenuation=0.0),
        Pipes(("neck", "far"), 1.2, 0.05, attenuation=0.02),
    )
    hole = (Orifice(("far", "line"), resistance=9000.0),)
    lumps = solved(machine(suction_pipe(1.2), before=(BOTTLE,)))
    pipes = solved(cylinder(Piping(chain, (Volume("flange", 0.002),), hole)))
    for name in ("indicated_work", "volumetric_efficiency"):
        assert float(getattr(lumps, name)) == pytest.approx(float(getattr(pipes, name)), rel=5e-4)
    spectra = lumps.pulsation.spectra()["flange"], pipes.pulsation.spectra()["neck"]
    largest = float(jnp.max(spectra[1]))
    # order 2 resonates; the gas in a plenum is warmer by what comes back, and its neck has no length: 4 %
    np.testing.assert_allclose(spectra[0][:6], spectra[1][:6], atol=0.05 * largest)


@pytest.mark.slow
def test_derivatives_of_a_cycle_between_plenums_and_pipes():
    # Panels are laid anew for every value. Of 64 that moves a difference by up to 4 % of the slopes of
    # the discharge's wave in the suction line's numbers, the more the smaller the step; of 160 by
    # 2.3e-5 of the wave over the number, and by 5e-5 of all other slopes.
    options = CycleOptions(panels=160, capacity=2000, max_passes=20_000)

    def figures(numbers):
        length, volume, neck, speed = numbers
        before = (Plenum(volume, 0.05, neck, 1.5),)
        behind = (Plenum(2e-4, 0.04, 0.015, 1.5),)
        pipes = (Pipes(("flange", "line"), length, 0.04, attenuation=0.05),)
        discharge = (Pipes(("flange", "line"), 0.8, 0.03, attenuation=0.05),)
        gas = machine(Piping(pipes, orders=24), Piping(discharge, orders=24), before, behind)
        cycle = solve_cycle(gas, crank(), speed, options)
        pulsation = cycle.pulsation
        return jnp.stack(
            [
                cycle.indicated_work,
                cycle.volumetric_efficiency,
                pulsation.pressures["suction.flange.order_1"],
                pulsation.pressures["discharge.flange.order_1"],
            ]
        )

    point = jnp.array([1.0, 5e-4, 0.02, SPEED])
    slopes = jax.jacfwd(figures)(point)
    values = np.abs(figures(point))
    for place in range(point.size):
        step = jnp.zeros(point.size).at[place].set(1e-4 * point[place])
        difference = (figures(point + step) - figures(point - step)) / (2e-4 * point[place])
        error = np.abs(slopes[:, place] - difference)
        assert (error <= 1e-4 * np.abs(difference) + 4e-5 * values / point[place]).all()


@pytest.mark.slow
def test_both_ends_of_a_cylinder_are_two_cylinders():
    """With the longest connecting rod and a piston rod as thin as a needle."""
    long = SliderCrank(0.06, 0.0262, 30.0, 0.2, 0.2)
    piping = suction_pipe(1.8, orders=16)
    options = CycleOptions()
    single = cylinder(piping)
    double = rebuilt(single, crank_end=CrankEnd(rod_diameter=1e-4))
    speed = jnp.asarray(SPEED)
    both = solve_cycles(double, [long], jnp.zeros(1), speed, options)
    two = solve_cycles(single, [long, long], jnp.asarray([0.0, np.pi]), speed, options)
    for cycles in (both, two):
        assert cycles.status == Status.converged
        assert abs(float(cycles.energy_closure)) < 1e-9
    # the rod's obliquity is 9e-4 of the stroke, and the needle's area 3e-6 of the piston's
    for name in ("indicated_work", "volumetric_efficiency", "mass_flow"):
        assert float(getattr(both, name)) == pytest.approx(float(getattr(two, name)), rel=1e-3)
    spectra = [cycles.pulsation.spectra()["flange"] for cycles in (both, two)]
    largest = float(jnp.max(spectra[1]))
    np.testing.assert_allclose(spectra[0][:6], spectra[1][:6], atol=5e-3 * largest)
    assert float(jnp.max(spectra[0])) > 500.0
