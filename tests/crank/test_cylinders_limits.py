"""Limits of machines with several cylinders: 1/N of everything, swapped cylinders, orders, balances."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.layouts import growth, with_layout
from crank.test_several_cylinders import COARSE, LAYOUTS, TWO, layout, losses, several
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from jaxcomp import BadInput, load, solve_orbit
from jaxcomp.compressor import instants
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.friction import Packing, SliderCrankFriction
from jaxcomp.gas import StagedCycle
from jaxcomp.mechanism import CrankState, rod_motion
from jaxcomp.motor import MeanSpeed
from jaxcomp.study.accuracy._report import Measurement
from jaxcomp.vibration import shaking_wrench

# One program of each layout: outside of a program every operation is compiled by itself.
wrench_of, instants_of = eqx.filter_jit(shaking_wrench), eqx.filter_jit(instants)


def named(layout, **given):
    """The crankshaft of the golden machines in a layout by name."""
    return Crankshaft(0.1566, layout=layout, main_journal=TWO, **given)


# [J] indicated work of a cylinder, closed form
WORK = 297.326137139


def test_cylinders_with_a_share_of_everything_are_one():
    """Three at one place and angle with a third of area, masses and inertias: Coulomb laws are linear."""
    one = several([(0.0, 0.0, [0.0], -0.3)])
    shared = [(0.0, 0.0, [0.0, 0.0, 0.0], -0.3)]
    made = one.mechanism
    names = ("piston_mass", "conrod_mass", "conrod_inertia")
    third = {name: getattr(made, name) / 3 for name in names}
    # a bore of each cylinder, so that they are solved by the program of unequal ones below
    mechanism = dataclasses.replace(made, bore=[made.bore / 3**0.5] * 3, **third)
    throws = layout(shared)
    together = dataclasses.replace(throws.throws[0], rod_pitch=0.0)
    crankshaft = dataclasses.replace(throws, throws=(together,))
    three = dataclasses.replace(one, mechanism=mechanism, crankshaft=crankshaft)
    found, wanted = solve_orbit(three, COARSE), solve_orbit(one, COARSE)
    # the solver converges to 1e-13; areas of three bores sum to one to rounding
    assert float(found.mechanical_efficiency) == pytest.approx(
        float(wanted.mechanical_efficiency), abs=1e-12
    )
    assert float(found.speed_fluctuation) == pytest.approx(
        float(wanted.speed_fluctuation), rel=1e-11
    )
    for joint in ("main", "crank_pin", "piston_pin", "wall"):
        assert losses(found, joint) == pytest.approx(losses(wanted, joint), rel=1e-11), joint


def test_swapped_cylinders_change_nothing():
    """Rods at one place in another order, with a bore each: only the numbers of the cylinders change."""
    banks, bores = np.array([-50.0, 10.0, 65.0]), np.array([0.13, 0.11, 0.12])

    def solved(order):
        shaft = layout([(0.0, 0.0, list(banks[order]), -0.4)])
        throw = dataclasses.replace(shaft.throws[0], rod_pitch=0.0)
        shaft = dataclasses.replace(shaft, throws=(throw,))
        made = several([(0.0, 0.0, list(banks), -0.4)], crankshaft=shaft)
        mechanism = dataclasses.replace(made.mechanism, bore=bores[order])
        return solve_orbit(dataclasses.replace(made, mechanism=mechanism), COARSE)

    one, other = solved([0, 1, 2]), solved([2, 1, 0])
    # sums in another order, and a revolution that begins at another top dead centre
    assert float(one.mechanical_efficiency) == pytest.approx(
        float(other.mechanical_efficiency), abs=1e-13
    )
    assert float(one.speed_fluctuation) == pytest.approx(float(other.speed_fluctuation), rel=1e-11)
    for cylinder, swapped in ((1, 3), (2, 2), (3, 1)):
        for joint in ("crank_pin", "wall"):
            ours, theirs = one.energy.losses, other.energy.losses
            wanted = float(theirs[f"{joint}_{swapped}"])
            assert float(ours[f"{joint}_{cylinder}"]) == pytest.approx(wanted, rel=1e-11)


def test_without_friction_nothing_is_lost():
    orbit = solve_orbit(
        several(LAYOUTS[4], friction=None, crankshaft=layout(LAYOUTS[4], None)), COARSE
    )
    assert float(orbit.mechanical_efficiency) == pytest.approx(1.0, abs=1e-13)
    # quadrature with 6 nodes on a panel
    assert float(orbit.energy.gas_work) == pytest.approx(4 * WORK, rel=1e-5)


def test_moments_about_the_shaft_balance_at_every_instant():
    """Walls, motor and friction of the main bearings are what the moving parts push the frame with."""
    made = several([(0.0, -0.1, [-40.0, 30.0], -0.5), (170.0, 0.1, [-45.0], -0.3)])
    orbit = solve_orbit(made, COARSE)
    rod = rod_motion(made.mechanism, made.crankshaft.own_angle(orbit.state.angle))
    walls = jnp.stack([orbit.loads.forces[f"wall_{k}"][1] for k in (1, 2, 3)])
    lost = orbit.loads.loss_torque
    # the rod turns at minus the rate of its tilt and drags the piston along, which leans on the wall
    pins = jnp.stack([lost[f"piston_pin_{k}"] for k in (1, 2, 3)]) / rod.tilt_1
    friction = sum(m for name, m in lost.items() if name.startswith("main"))
    frame = -jnp.sum(rod.position * walls + pins, axis=0) - orbit.motor_torque + friction
    wrench = wrench_of(made, orbit.state)
    # torques of 1 kN m; the collocation equations hold to 1e-13 of that
    np.testing.assert_allclose(frame, wrench.moment[2], atol=1e-8)


# f and c of order 1 and 2 by section of the throws in pitches, from the closed forms
NAMES = (
    "single", "in-line-2", "in-line-3", "in-line-4", "in-line-6", "boxer-2", "opposed", "V90",
    "V60", "W60", "VV45", "radial-3", "radial-5", "V90x2", "VV45x2", "L70",
)  # fmt: skip
# Amplitudes A_n of -x''/(r w^2) at a crank radius of 0.17 rod lengths, exact.
AMPLITUDES = {1: 1.0, 2: 0.171245174885237, 4: -1.255445766737e-3, 6: 1.0354557670e-5}


@pytest.mark.parametrize("name", NAMES)
def test_orders_of_force_and_couple_are_the_closed_forms(name):
    """By Fourier transform of the exact motion at constant speed; sums against the table elsewhere."""
    speed, count = 100.0, 64
    made = several(LAYOUTS[1], crankshaft=named(name, throw_pitch=0.3, rod_pitch=0.05))
    length = made.mechanism.conrod_length
    # without the rotating mass of the rod, whose mass centre lies in the small end
    mechanism = dataclasses.replace(
        made.mechanism, crank_radius=0.17 * length, conrod_centre=length
    )
    made = dataclasses.replace(made, mechanism=mechanism)
    angle = jnp.asarray(2 * np.pi * np.arange(count) / count)
    wrench = wrench_of(made, CrankState(angle, jnp.full(count, speed), jnp.zeros(count)))
    unit = (
        float((mechanism.piston_mass + mechanism.conrod_mass) * mechanism.crank_radius) * speed**2
    )
    force, moment = (
        np.fft.fft(np.asarray(v[0] + 1j * v[1])) / (count * unit)
        for v in (wrench.force, wrench.moment)
    )
    for order, amplitude in AMPLITUDES.items():
        sums = made.crankshaft.order_sums(order)
        got = force[[order, -order]], moment[[order, -order]]
        ahead, behind = (amplitude * complex(f) for f in sums[:2])
        np.testing.assert_allclose(got[0], (ahead, behind), atol=1e-12, err_msg=str(order))
        # M_x + i M_y = i times the couple
        ahead, behind = (1j * amplitude * complex(c) for c in sums[2:])
        np.testing.assert_allclose(got[1], (ahead, behind), atol=1e-12, err_msg=str(order))


@pytest.mark.parametrize("name", ["V90x2", "W60x2", "VV45x2", "in-line-3"])
def test_even_firing_leaves_the_orders_of_the_number_of_cylinders(name):
    """Of the torque of gas and inertia at constant speed; V90 on one throw keeps its first order."""
    points = 240  # divisible by every number of cylinders
    angle = jnp.asarray(2 * np.pi * np.arange(points) / points)

    def orders(layout):
        made = several(LAYOUTS[1], crankshaft=named(layout))
        found = instants_of(made, angle)
        torque = found.conservative - 0.5 * 100.0**2 * found.inertia_1
        return made.crankshaft.count, np.abs(np.fft.rfft(torque)) / points

    count, spectrum = orders(name)
    rest = np.arange(spectrum.size) % count != 0
    assert spectrum[rest].max() < 1e-12 * spectrum.max()
    _, uneven = orders("V90")
    assert uneven[1] > 0.1 * uneven.max()


def test_cost_over_the_number_of_cylinders():
    """The line through times by setting; layouts of the first cylinder of a machine."""
    rows = [
        Measurement("m", label, 1e-6, scale * (1.0 + 0.5 * count), 2.0, task=f"{count} cylinders")
        for count in (1, 2, 4, 8)
        for label, scale in (("coarse", 1.0), ("fine", 3.0))
    ]
    found = growth(rows)
    assert found["fine"].each == pytest.approx(1.5, rel=1e-12)
    assert found["fine"].fixed == pytest.approx(3.0, rel=1e-12)
    assert found["coarse"].seconds == {1: 1.5, 2: 2.0, 4: 3.0, 8: 5.0}
    several_bores = load("two-stage-crosshead").compressor
    with pytest.raises(BadInput, match="the same for every cylinder"):
        with_layout(
            dataclasses.replace(several_bores, gas=StagedCycle((1, 2), 1e5, 9e5, 1.3, 0.1)), "V90"
        )
    made = with_layout(load("mayekawa-8wbhe").compressor, "V90x2")
    assert made.crankshaft.count == 4
    machine = load("slider-link-8cc").compressor
    with pytest.raises(BadInput, match="slider_crank"):
        with_layout(machine, "V90")


class TwoStages:
    """Double-acting two-stage machine with drag in the packings, in NumPy and SciPy alone.

    The kinetic energy over the crank angle, so that no derivative of the inertia is needed; the
    intermediate pressure by bisection.
    """

    radius, rod, place = 0.06, 0.30, 0.095
    piston_mass, rod_mass, rod_inertia, shaft = 19.0, 9.0, 0.12, 6.0
    bores, piston_rod = np.array([0.25, 0.15]), 0.04
    suction, discharge, exponent, clearance = 1e5, 9e5, 1.35, np.array([0.10, 0.12])
    phase, speed, drag = np.deg2rad([45.0, -45.0]), 77.5, 900.0

    def __init__(self):
        area = np.pi / 4 * self.bores**2
        self.areas = area, area - np.pi / 4 * self.piston_rod**2
        swept = (self.areas[0] + self.areas[1]) * 2 * self.radius

        def drawn(stage, low, high):
            c = self.clearance[stage]
            return swept[stage] * low * (1 + c - c * (high / low) ** (1 / self.exponent))

        def gap(between):
            return drawn(0, self.suction, between) - drawn(1, between, self.discharge)

        self.between = brentq(
            gap, 1.01 * self.suction, 0.99 * self.discharge, xtol=1e-6, rtol=1e-14
        )
        self.low = np.array([self.suction, self.between])
        self.high = np.array([self.between, self.discharge])

    def pressure(self, share, opening):
        """[Pa] Of a chamber at a share of its swept volume, while it opens or closes."""
        volume, n = self.clearance + share, self.exponent
        expanding = np.maximum(self.low, self.high * (self.clearance / volume) ** n)
        closing = np.minimum(self.high, self.low * ((1 + self.clearance) / volume) ** n)
        return np.where(opening, expanding, closing)

    def at(self, angle):
        """Inertia [kg m^2], torque of the gas and of the packings [N m]."""
        own = angle + self.phase
        s, c = np.sin(own), np.cos(own)
        leg = np.sqrt(self.rod**2 - (self.radius * s) ** 2)
        x = self.radius * c + leg
        slope = -self.radius * s * (1 + self.radius * c / leg)
        tilt = self.radius * c / leg
        share = self.place / self.rod
        along = (1 - share) * -self.radius * s + share * slope
        across = (1 - share) * self.radius * c
        inertia = self.piston_mass * slope**2 + self.rod_inertia * tilt**2
        inertia += self.rod_mass * (along**2 + across**2)
        down = np.clip((self.radius + self.rod - x) / (2 * self.radius), 0.0, 1.0)
        head = self.pressure(down, slope < 0) * self.areas[0]
        crank = self.pressure(1 - down, slope > 0) * self.areas[1]
        force = head - crank - self.suction * (self.areas[0] - self.areas[1])
        return self.shaft + inertia.sum(), -(force * slope).sum(), -self.drag * np.abs(slope).sum()

    def solved(self):
        """Efficiency, fluctuation, gas work [J] of the periodic state."""
        points = np.linspace(0.0, 2 * np.pi, 4001)

        def march(energy, level):
            def rate(angle, y):
                inertia, gas, packing = self.at(angle)
                w = np.sqrt(2 * y[0] / inertia)
                motor = level * w / self.speed
                return [motor + gas + packing, 1 / w, motor, gas]

            return solve_ivp(rate, (0, 2 * np.pi), [energy, 0.0, 0.0, 0.0], "DOP853", points,
                             rtol=1e-11, atol=1e-11, max_step=0.01)  # fmt: skip

        scale = 0.5 * self.at(0.0)[0] * self.speed**2

        def misses(unknown):
            end = march(scale * unknown[0], 1e3 * unknown[1]).y[:, -1]
            return [end[0] / scale - unknown[0], end[1] * self.speed / (2 * np.pi) - 1]

        energy, level = np.asarray(fsolve(misses, [1.0, 1.2], xtol=1e-12))
        run = march(scale * energy, 1e3 * level)
        inertia = np.array([self.at(angle)[0] for angle in points])
        speed = np.sqrt(2 * run.y[0] / inertia)
        swing = (speed.max() - speed.min()) / self.speed
        return -run.y[3, -1] / run.y[2, -1], swing, -run.y[3, -1]


@pytest.mark.slow
def test_two_stages_by_an_independent_program():
    program = TwoStages()
    scene = load("two-stage-crosshead").compressor
    friction = SliderCrankFriction(packing=Packing(program.drag))
    made = dataclasses.replace(
        scene,
        crankshaft=Crankshaft(scene.crankshaft.inertia, layout="V90"),
        friction=friction,
        motor=MeanSpeed(program.speed, "proportional"),
    )
    between = float(np.max(np.asarray(made.gas.head_end.suction_pressure)))
    assert between == pytest.approx(program.between, rel=1e-9)
    orbit = solve_orbit(made)
    efficiency, swing, work = program.solved()
    # steps of 0.01 rad over kinks that are not located
    assert float(orbit.mechanical_efficiency) == pytest.approx(efficiency, abs=1e-8)
    assert float(orbit.energy.gas_work) == pytest.approx(work, rel=1e-7)
    # the extremes of the program are those of 4000 points
    assert float(orbit.speed_fluctuation) == pytest.approx(swing, rel=1e-5)
