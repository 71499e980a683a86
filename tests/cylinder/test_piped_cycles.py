"""Cycles behind pipes against an independent solution in time with exact delay lines.

That is by RK4 with contacts located; 6000 and 16000 steps a turn agree to 5e-8 in work and 7e-8 in flow.
Harmonics up to 64 leave 2e-5 to 4e-5 where pipes are little damped.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_pipes import AIR, SPEED, crank, cylinder, solved, suction_pipe

from jaxcomp import BadInput, Status
from jaxcomp._core.fields import replaced
from jaxcomp.cylinder import (
    CycleOptions,
    Cylinder,
    DischargeLine,
    Intercooler,
    Plenum,
    Stage,
    SuctionLine,
    solve_cycle,
)
from jaxcomp.cylinder._pulsation import Pulsation
from jaxcomp.cylinder._solve_cycle import solve_cycles
from jaxcomp.piping import ClosedEnd, Orifice, Pipes, Piping, Run, Volume

# a program of its own for every network, each with a minute of compilation on two busy cores
OWN_PROGRAM = pytest.mark.slow


def pipe(nodes, length, diameter, attenuation=0.02):
    return Pipes(nodes, length, diameter, attenuation=attenuation)


def resistance(value):
    return (Orifice(("far", "line"), resistance=value),)


def discharge_pipe(temperature=445.8):
    chain = (pipe(("flange", "far"), 1.2, 0.03),)
    return Piping(chain, orifices=resistance(30000.0), temperature=temperature)


def filtered():
    chain = (pipe(("flange", "bottle"), 0.5, 0.03, 0.0), pipe(("bottle", "far"), 0.7, 0.05, 0.0))
    volumes = (Volume("flange", 0.004), Volume("bottle", 0.006))
    return Piping(chain, volumes, resistance(176821.757765))


def branched():
    chain = (pipe(("flange", "tee", "far"), [0.5, 1.3], 0.05), pipe(("tee", "stub"), 1.8, 0.05))
    return Piping(chain, (), resistance(9000.0), (ClosedEnd("stub"),))


def plenum_like():
    chain = (pipe(("flange", "far"), 0.1, 0.025, 0.0),)
    return Piping(chain, (Volume("flange", 0.002),), resistance(500.0))


def with_hole():
    # K = zeta/(2 rho A^2) = 3e6 Pa s^2/kg^2 at the density of the line
    area = np.sqrt(1 / (2 * 1e5 / (287 * 300) * 3e6))
    hole = Orifice(("far", "line"), diameter=np.sqrt(4 / np.pi * area), loss_coefficient=1.0)
    return Piping((pipe(("flange", "far"), 1.8, 0.05),), orifices=(hole,))


# suction, discharge; work [J], volumetric efficiency; mean and amplitudes at the flange [Pa], by order
CASES = {
    "P1": (
        suction_pipe(0.6), None, 27.359027, 0.90498339, -41.8298,
        (299.75, 306.99, 78.65, 356.62, 493.91, 645.26),
    ),
    "P2": (
        suction_pipe(0.9), None, 27.778557, 0.91739189, -46.4333,
        (455.51, 516.69, 317.53, 1694.41, 198.41, 95.55),
    ),
    "P4": (
        suction_pipe(1.8), None, 29.011382, 0.95201563, -60.7097,
        (1102.13, 5058.75, 103.42, 19.69, 98.99, 900.94),
    ),
    "P6": (
        suction_pipe(3.6), None, 28.020336, 0.89835646, -80.8061,
        (8517.34, 54.06, 809.11, 21.36, 623.10, 11.97),
    ),
    "D1": (
        None, discharge_pipe(), 27.626928, 0.91032663, 167.754,
        (2042.54, 4641.33, 11462.07, 15801.91, None, 842.98),
    ),
    "S1": (
        suction_pipe(1.8), discharge_pipe(), 29.274594, 0.95559227, -60.938,
        (1104.06, 5020.58, 104.99, 19.45, None, 900.21),
    ),
    "F1": (
        filtered(), None, 27.31693, 0.90121620, -662.677,
        (420.06, 687.29, 42.40, 56.56, None, 17.15),
    ),
    "B1": (
        branched(), None, 27.871212, 0.91352955, -58.114,
        (2638.30, 246.65, 671.27, 18.13, None, 282.82),
    ),
    "V1": (
        plenum_like(), None, 27.253862, 0.90202369, -1.876,
        (205.79, 272.13, 148.78, 449.70, None, 47.70),
    ),
    "O1": (
        with_hole(), None, 28.069676, 0.92325870, -237.212,
        (1003.21, 1871.20, 224.80, 31.79, None, 196.11),
    ),
}  # fmt: skip
# one program for all lengths of a pipe
QUICK = ("P2",)


@eqx.filter_jit
def impedances(pulsation):
    """Pressure of every order at the flange of each network by the flow there, in one program."""
    by_line = []
    for _, line, _ in pulsation.lines:
        network, _, _, dynamic = line.responses(pulsation.waves[line.side])
        by_line.append(dynamic.pressure[:, network.flanges[0], 0])
    return by_line


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=OWN_PROGRAM) for name in CASES]
)
def test_cycles_behind_pipes(name):
    suction, discharge, work, efficiency, mean, amplitudes = CASES[name]
    cycle = solved(suction, discharge)
    assert cycle.status == Status.converged
    assert float(cycle.indicated_work) == pytest.approx(work, rel=1e-4)
    assert float(cycle.volumetric_efficiency) == pytest.approx(efficiency, rel=1e-4)
    pulsation = cycle.pulsation
    flange = "suction.flange" if suction and discharge else "flange"
    spectrum = pulsation.spectra()[flange]
    largest = max(size for size in amplitudes if size is not None)
    for order, amplitude in enumerate(amplitudes, 1):
        if amplitude is not None:
            assert float(spectrum[order - 1]) == pytest.approx(amplitude, abs=0.005 * largest)
    # 0.5 % of the largest wave, as for the orders
    assert float(pulsation.series()[flange][0]) == pytest.approx(mean, abs=0.005 * largest)
    assert abs(float(cycle.energy_closure)) < 1e-9
    assert abs(float(cycle.mass_closure)) < 1e-9
    # passive networks take power from the flow at their flange and give none
    for impedance in impedances(pulsation):
        series = np.asarray(impedance)
        assert np.min(series.real / np.abs(series)) >= -1e-12


@pytest.fixture(scope="module")
def quarter_wave():
    return solved(suction_pipe(0.9))


def test_the_first_size_resolves_a_quarter_wave(quarter_wave):
    """P2 of the reference; five times the panels, until flows were exact on wide ones."""
    cycle = quarter_wave
    assert cycle.status == Status.converged
    assert cycle.angle.size == CycleOptions().behind_pipes().panel_count * 6
    # one of two revolutions, and behind the waves of each step one more: four steps
    assert int(cycle.revolutions) <= 6
    # the last Newton's method has one linearisation
    assert int(cycle.iterations) == 1


def test_pressure_at_a_place_of_a_pipe(quarter_wave):
    pulsation = quarter_wave.pulsation
    nodes = pulsation.series()
    # as at the nodes where its ends are, counted from either of them
    for distance, node in ((0.0, "flange"), (0.9, "far")):
        for ends, place in ((("flange", "far"), distance), (("far", "flange"), 0.9 - distance)):
            series = pulsation.series_in_pipe(*ends, place)
            np.testing.assert_allclose(series, nodes[node], rtol=1e-10, atol=1e-8)
    # as at a node that cuts the pipe there: the same waves and flows through another network
    piping = pulsation.case.cylinder.suction.piping
    chain = Pipes(("flange", "cut", "far"), [0.35, 0.55], 0.05, attenuation=0.02)
    suction = replaced(pulsation.case.cylinder.suction, piping=replaced(piping, pipes=(chain,)))
    machine = replaced(pulsation.case.cylinder, suction=suction)
    case = eqx.tree_at(lambda case: case.cylinder, pulsation.case, machine)
    at_cut = Pulsation(pulsation.waves, pulsation.flows, case, pulsation.phase).series()["cut"]
    np.testing.assert_allclose(
        pulsation.series_in_pipe("flange", "far", 0.35), at_cut, rtol=1e-10, atol=1e-8
    )
    with pytest.raises(BadInput, match=r"0\.9 m"):
        pulsation.series_in_pipe("flange", "far", 1.0)
    with pytest.raises(BadInput, match="flange-far"):
        pulsation.series_in_pipe("flange", "line", 0.1)


def test_status_of_waves_beyond_their_range(quarter_wave):
    pulsation = quarter_wave.pulsation
    assert pulsation.status == Status.converged
    # three times the pressures: 17 % peak to peak
    larger = pulsation.waves[0]._replace(pressure=3 * pulsation.waves[0].pressure)
    loud = Pulsation((larger, None), pulsation.flows, pulsation.case, pulsation.phase)
    assert loud.status == Status.large_pulsation
    assert float(loud.linear_error) == pytest.approx(0.35 * float(loud.largest) ** 2)
    assert "large_pulsation" in " ".join(loud.remarks)


@OWN_PROGRAM
@pytest.mark.parametrize(
    ("pipes", "end", "work", "efficiency", "amplitudes"),
    [
        (
            (pipe(("flange", "far"), 1.5, 0.06),),
            6000.0,
            55.660269,
            0.91653164,
            (0.00, 2729.58, 0.00, 144.60, 106.22),
        ),
        (
            (
                pipe(("flange-1", "tee"), 0.4, 0.04),
                pipe(("flange-2", "tee"), 0.4, 0.04),
                pipe(("tee", "far"), 1.5, 0.06),
            ),
            6000.0,
            57.168012,
            0.94310111,
            (296.29, 5592.57, 132.00, 87.29, 665.26),
        ),
    ],
    ids=["one flange", "laterals"],
)
def test_two_cylinders_on_a_header(pipes, end, work, efficiency, amplitudes):
    machine = cylinder(Piping(pipes, orifices=resistance(end)))
    two = [crank(), crank()]
    cycles = solve_cycles(
        machine, two, jnp.asarray([0.0, np.pi]), jnp.asarray(SPEED), CycleOptions()
    )
    assert float(cycles.indicated_work) == pytest.approx(work, rel=1e-4)
    assert float(cycles.volumetric_efficiency) == pytest.approx(efficiency, rel=1e-4)
    name = cycles.pulsation.lines[0][1].piping.flanges[0]
    spectrum = cycles.pulsation.spectra()[name]
    for order, amplitude in zip((1, 2, 3, 4, 6), amplitudes, strict=True):
        assert float(spectrum[order - 1]) == pytest.approx(amplitude, abs=0.005 * max(amplitudes))
    header = "tee" if len(pipes) > 1 else name
    odd = cycles.pulsation.spectra()[header][::2]
    # evenly phased cylinders have no odd orders in what they share
    assert float(jnp.max(odd[:3])) < 1e-9 * max(amplitudes) * 10


@OWN_PROGRAM
def test_derivatives_in_the_length_of_a_pipe():
    def figures(length):
        cycle = solve_cycle(cylinder(suction_pipe(length)), crank(), SPEED)
        return jnp.stack([cycle.indicated_work, cycle.volumetric_efficiency])

    slopes = jax.jacfwd(figures)(0.9)
    # of the independent border, at the same order
    np.testing.assert_allclose(slopes, [-7.325769, -0.2562282], rtol=2e-5)
    difference = (figures(0.9 + 1e-4) - figures(0.9 - 1e-4)) / 2e-4
    np.testing.assert_allclose(slopes, difference, rtol=1e-4)


@OWN_PROGRAM
def test_shaking_force_of_a_run():
    piping = suction_pipe(1.8)
    piping = Piping(
        piping.pipes, orifices=piping.orifices, runs=(Run(("flange", "far"), [0, 0, 1.0]),)
    )
    forces = solved(piping).pulsation.shaking_forces
    found = [float(forces[f"flange-far.order_{order}"]) for order in (1, 2, 3, 4)]
    np.testing.assert_allclose(found, [2.1562, 9.9458, 0.2049, 0.0612], atol=0.005 * 9.9458)


@OWN_PROGRAM
def test_uses_of_work_and_volume_add_up():
    cycle = solved(suction_pipe(1.8))
    assert float(sum(cycle.work_losses.values())) == pytest.approx(
        float(cycle.indicated_work), rel=1e-12
    )
    assert float(sum(cycle.volume_losses.values())) == pytest.approx(1.0, rel=1e-12)
    # the pipe fills the cylinder beyond the pressure of the line
    assert float(cycle.volume_losses["piping"]) < -0.03
    assert float(cycle.work_losses["discharge piping"]) == 0.0
    assert cycle.pulsation.remarks == []
    assert float(cycle.pulsation.margin) < 1  # 12 % at a flange that may have 7 %


@OWN_PROGRAM
def test_volume_and_neck_are_a_plenum():
    piped = solved(plenum_like())
    plenum = Plenum(0.002, 0.1, 0.025, 0.0)
    line = SuctionLine(pressure=1e5, temperature=300.0, plenums=(plenum,))
    machine = cylinder()
    lumped = solve_cycle(
        Cylinder(AIR, line, machine.discharge, *machine.valves, clearance_ratio=0.04),
        crank(),
        SPEED,
    )
    # waves are linear, the temperature of the plenum swings and its neck has no length: 2e-4
    for name in ("indicated_work", "volumetric_efficiency"):
        assert float(getattr(piped, name)) == pytest.approx(float(getattr(lumped, name)), rel=5e-4)


def test_what_pipes_do_not_go_with_is_refused():
    machine = cylinder(suction_pipe(1.0))
    second = Stage(Intercooler(310.0), *machine.valves, clearance_ratio=0.05)
    staged = {"discharge": DischargeLine(pressure=4e5), "later_stages": (second,)}
    with pytest.raises(BadInput, match=r"suction\.piping. must be absent with later_stages"):
        dataclasses.replace(machine, **staged)
    with pytest.raises(BadInput, match="method=march"):
        solve_cycle(cylinder(suction_pipe(1.0)), crank(), SPEED, CycleOptions(method="march"))
    numbered = Piping(
        (pipe(("flange-1", "tee", "line"), 0.4, 0.04), pipe(("flange-2", "tee"), 0.4, 0.04))
    )
    with pytest.raises(BadInput, match="flange-1"):
        solve_cycle(cylinder(numbered), crank(), SPEED)


@OWN_PROGRAM
def test_gas_of_the_discharge_pipe_has_the_temperature_of_what_is_delivered():
    cycle = solved(None, discharge_pipe(None))
    assert cycle.status == Status.converged
    temperature = float(cycle.pulsation.waves[1].temperature[0] * cycle.case.discharge.T)
    assert temperature == pytest.approx(float(cycle.discharge_temperature), rel=1e-12)
    given = solved(None, discharge_pipe(temperature))
    # panels laid after other marches: their error of 1e-5 moves by 1e-10
    assert float(given.indicated_work) == pytest.approx(float(cycle.indicated_work), rel=1e-9)


@OWN_PROGRAM
def test_derivatives_in_all_that_a_network_has():
    """Losses of walls, turbulent friction, a bottle and a hole with a square law; speed and a spring."""

    def figures(numbers):
        length, diameter, volume, hole, speed, stiffness = numbers
        chain = Pipes(
            ("flange", "bottle", "far"),
            jnp.stack([0.3 + 0 * length, length]),
            jnp.stack([0.05 + 0 * diameter, diameter]),
        )
        holes = (Orifice(("far", "line"), diameter=hole),)
        piping = Piping((chain,), (Volume("bottle", volume),), holes)
        machine = cylinder(piping)
        valve = replaced(machine.suction_valve, stiffness=stiffness)
        cycle = solve_cycle(replaced(machine, suction_valve=valve), crank(), speed)
        pulsation = cycle.pulsation
        return jnp.stack(
            [
                cycle.indicated_work,
                cycle.volumetric_efficiency,
                pulsation.pressures["flange.order_2"],
                pulsation.mean_drops["flange"],
            ]
        )

    point = jnp.array([1.2, 0.045, 5e-4, 0.03, SPEED, 800.0])
    slopes = jax.jacfwd(figures)(point)
    for place in range(point.size):
        step = jnp.zeros(point.size).at[place].set(1e-4 * point[place])
        difference = (figures(point + step) - figures(point - step)) / (2e-4 * point[place])
        # seen: 3e-5 at most, of the small slope of the work by the speed. Panels are laid after marches
        # of their own, by which values of every difference move by up to 1e-9: with a tenth of this step
        # that is 1e-3 of that slope, and with three times the step the curvature 2e-4
        np.testing.assert_allclose(slopes[:, place], difference, rtol=1e-4)
