"""Random machines with every motor and mechanism against the independent integrator.

`reference_batch.one_turn` starts on the orbit that the package found and integrates one revolution with
other equations and another method: an orbit that is one comes back to where it began, with the same work.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import reference_batch
from helpers import (
    machine,
    pick,
    random_crankshafts,
    random_mechanisms,
    solve_many,
    status_of,
)

from jaxcomp import Collocation, Compressor
from jaxcomp._core.fields import rebuilt
from jaxcomp._core.polynomials import gauss
from jaxcomp.crank._panels import highest
from jaxcomp.crankshaft import Crankshaft, MainBearings
from jaxcomp.friction import (
    CoulombJournal,
    CoulombSlide,
    SliderCrankFriction,
    SliderLinkFriction,
)
from jaxcomp.gas import PolytropicCycle
from jaxcomp.mechanism import SliderLink
from jaxcomp.motor import ConstantSpeed, ConstantTorque, Kloss, MeanSpeed, SlipLine

MOTORS = {
    "mean_speed": lambda speed, torque: MeanSpeed(speed),
    "proportional": lambda speed, torque: MeanSpeed(speed, "proportional"),
    "constant_speed": lambda speed, torque: ConstantSpeed(speed),
    "constant_torque": lambda speed, torque: ConstantTorque(torque, speed),
    "slip_line": lambda speed, torque: SlipLine(8 * torque / speed, speed),
    "kloss": lambda speed, torque: Kloss(4 * torque, 0.2, speed),
}


def crank_design(rng, mechanism, crankshaft):
    """A slider-crank with gas and friction, its speed, and the mean torque of its gas."""
    speed = rng.uniform(60, 200)
    suction, ratio = rng.uniform(0.5e5, 5e5), rng.uniform(2, 12)
    clearance, exponent = rng.uniform(0.005, 0.06), rng.uniform(1.02, 1.4)
    torque = suction * float(mechanism.swept_volume) * np.log(ratio) / (2 * np.pi)
    piston_pin, crank_pin, journal = (
        CoulombJournal(rng.uniform(0.001, 0.03), rng.uniform(0.01, 0.06)) for _ in range(3)
    )
    friction = SliderCrankFriction(
        wall=CoulombSlide(rng.uniform(0.0, 0.15)), piston_pin=piston_pin, crank_pin=crank_pin
    )
    crankshaft = rebuilt(crankshaft, main_journal=journal)
    gas = PolytropicCycle(suction, suction * ratio, exponent, clearance, suction)
    gravity = machine(gravity=(0.0, -9.81)).gravity
    return Compressor(mechanism, crankshaft, MeanSpeed(speed), gas, friction, gravity), torque


def link_design(rng):
    """The same of a slider-link, from the household machine to one five times as large."""
    u, r = rng.uniform, rng.uniform(0.008, 0.05)
    bore = r * u(1.5, 4.0)
    linkage = dict(
        bore=bore,
        crank_radius=r,
        cylinder_length=r * u(2.5, 5.0),
        crown_to_link=r * u(3.5, 7.0),
        slider_diameter=r * u(1.0, 2.0),
        piston_mass=u(50, 300) * bore**2,
        slider_mass=u(10, 100) * bore**2,
    )
    inertia = u(50, 500) * bore**2 * r
    upper, span = r * u(1.0, 4.0), r * u(2.0, 8.0)
    mass = u(500, 3000) * bore**2
    unbalance, couple = mass * r * u(-0.1, 0.1), u(-50, 50) * bore**2 * r**2
    mechanism = SliderLink(
        **linkage, offset=r * u(-0.3, 0.3), piston_centre_offset=r * u(-0.2, 0.2)
    )
    speed, suction, ratio = u(60, 330), u(0.5e5, 3e5), u(2, 12)
    gas = PolytropicCycle(suction, suction * ratio, u(1.02, 1.4), u(0.005, 0.06), suction)
    pin, *journals = (CoulombJournal(u(0.001, 0.03), r * u(0.8, 2.0)) for _ in range(3))
    slides = {name: CoulombSlide(u(0.0, 0.1)) for name in ("wall", "link_slider")}
    torque = suction * float(mechanism.swept_volume) * np.log(ratio) / (2 * np.pi)
    support = MainBearings(
        tuple(journals), [upper, upper + span], names=reference_batch.ManyLinks.names[3:]
    )
    crankshaft = Crankshaft(
        inertia=inertia,
        mass=mass,
        unbalance=-unbalance,
        shaft_couple=[couple, 0.0],
        main_journal=support,
    )
    friction = SliderLinkFriction(**slides, crank_pin=pin)
    return Compressor(mechanism, crankshaft, MeanSpeed(speed), gas, friction), torque


def designs(kind: str, motor: str, count: int, seed: int, part: slice = slice(None)):
    """Machines of all proportions with a motor that carries their load, or a part of so many."""
    rng = np.random.default_rng(seed)
    if kind == "slider_crank":
        mechanisms = random_mechanisms(rng, count)
        shafts = random_crankshafts(rng, count)
        made = [crank_design(rng, pick(mechanisms, n), pick(shafts, n)) for n in range(count)]
    else:
        made = [link_design(rng) for _ in range(count)]
    made = made[part]
    torques = [torque for _, torque in made]
    if motor == "constant_torque":  # only the level of the running machine keeps it running
        orbits = solve_many([one for one, _ in made], solver(kind))
        torques = [float(orbit.motor_torque[0]) for orbit in orbits]
    return [
        dataclasses.replace(one, motor=MOTORS[motor](one.motor.mean_speed, torque))
        for (one, _), torque in zip(made, torques, strict=True)
    ]


def solver(kind):
    return Collocation(reversals=4 if kind == "slider_crank" else 12)


def law_of(motors, orbits):
    """Torque over speed of some of the motors, in NumPy."""
    values = lambda name: np.array([float(getattr(m, name)) for m in motors])  # noqa: E731
    if isinstance(motors[0], SlipLine):
        slope, top = values("slope"), values("synchronous_speed")
        return lambda which, speed: slope[which] * (top[which] - speed)
    if isinstance(motors[0], Kloss):
        pull, ratio, top = map(values, ("pull_out_torque", "pull_out_slip", "synchronous_speed"))

        def kloss(which, speed):
            slip = (top[which] - speed) / top[which]
            return 2 * pull[which] * slip * ratio[which] / (slip**2 + ratio[which] ** 2)

        return kloss
    level = np.array([float(orbit.motor_torque[0]) for orbit in orbits])
    if isinstance(motors[0], MeanSpeed) and motors[0].shape == "proportional":
        first = np.array([float(orbit.state.speed[0]) for orbit in orbits])
        return lambda which, speed: level[which] * speed / first[which]
    return lambda which, speed: level[which] + 0 * speed


def errors(compressors, orbits, steps=1) -> dict[str, np.ndarray]:
    """What the reference finds differently: losses over their sum, everything else relative."""
    many, kinks = reference_batch.many_of(compressors)
    motors = [compressor.motor for compressor in compressors]
    torque = law_of(motors, orbits)
    held = isinstance(motors[0], ConstantSpeed)
    if held:  # a flywheel without end, whose friction the losses are
        many.crank_inertia = many.crank_inertia * 1e10
        torque = lambda which, speed: 0 * speed  # noqa: E731
    fastest = [int(np.argmax(orbit.state.speed)) for orbit in orbits]
    places = zip(orbits, fastest, strict=True)
    angle, speed = np.array([(o.state.angle[i], o.state.speed[i]) for o, i in places], float).T
    gap, mean, work = reference_batch.one_turn(many, kinks, torque, angle, speed, 1e-11, steps)
    losses = {name: np.array([o.energy.losses[name] for o in orbits]) for name in many.names}
    total = sum(losses.values())
    # at a given level the work of the motor is that of the orbit, so what it has to cover is compared
    needed = work["gas"] + sum(work[name] for name in losses)
    efficiency = np.array([o.mechanical_efficiency for o in orbits])
    return {
        "gap": np.abs(gap),
        "mean speed": np.abs(mean / np.array([o.mean_speed for o in orbits]) - 1),
        "efficiency": np.abs(work["gas"] / needed - efficiency),
        **{f"loss {name}": np.abs(work[name] - losses[name]) / total for name in losses},
    }


CASES = [
    (kind, motor, count)
    for kind in ("slider_crank", "slider_link")
    for motor in MOTORS
    for count in (50, 500)
]
ORDINARY = {("slider_crank", "mean_speed", 50)}


# In one piece these take more than a minute.
HALVES = {
    ("slider_link", motor, 500): {"first": slice(250), "second": slice(250, 500)}
    for motor in ("constant_torque", "slip_line")
}


def parameters():
    for case in CASES:
        name = "-".join(map(str, case))
        if case in ORDINARY:
            yield pytest.param(*case, slice(None), id=name)
        elif case in HALVES:
            for half, part in HALVES[case].items():
                yield pytest.param(*case, part, marks=pytest.mark.slow, id=f"{name}-{half}")
        else:
            yield pytest.param(*case, slice(None), marks=pytest.mark.slow, id=name)


# A design takes the reference some 30 ms, a motor 15 s of compiling.
@pytest.mark.parametrize(("kind", "motor", "count", "part"), [*parameters()])
def test_converged_orbits_are_those_of_the_reference(kind, motor, count, part):
    made = designs(kind, motor, count, seed=41, part=part)
    count = len(made)
    found = solve_many(made, solver(kind))
    good = [i for i, orbit in enumerate(found) if status_of(orbit) == "converged"]
    made, found = ([row[i] for i in good] for row in (made, found))
    assert len(good) > 0.9 * count
    # Each loss is right to the sum of the estimated errors; 3e-9 is what the reference is good for.
    efficiency = np.array([o.efficiency_error for o in found]) + 3e-9
    share = [sum(o.loss_error.values()) / sum(o.energy.losses.values()) for o in found]
    losses = np.array(share) + 3e-9
    # The gap and the mean speed by what the orbit tells of its speed, and by what losses that are off put
    # into the kinetic energy: of a motor with a torque curve the level of the speed follows them.
    speed = np.array([o.resolution * o.speed_fluctuation for o in found]) + 1e-8
    kinetic = [
        float(c.crankshaft.inertia * o.mean_speed**2) for c, o in zip(made, found, strict=True)
    ]
    speed += np.array([sum(o.loss_error.values()) for o in found], float) / np.array(kinetic)
    allowed = {"efficiency": efficiency, "gap": speed, "mean speed": speed}

    def beyond(which, steps):
        found_there = errors([made[i] for i in which], [found[i] for i in which], steps)
        return {
            (name, which[at]): error[at] / allowed.get(name, losses)[which[at]]
            for name, error in found_there.items()
            for at in np.flatnonzero(error > allowed.get(name, losses)[which])
        }

    wrong = beyond(np.arange(len(made)), 1)
    # The reference steps over a load reversal unaware now and then, up to 4e-7 off, so what differs is
    # compared once more, in shorter steps.
    suspects = np.array(sorted({design for _, design in wrong}), int)
    if suspects.size:
        wrong = beyond(suspects, 200)
    named = {(name, good[at]): ratio for (name, at), ratio in wrong.items()}
    # Of 24,000 machines one slider-link has an error 1.7 times its estimate, with either torque curve.
    assert len({design for _, design in wrong}) <= count // 500, named
    assert max(wrong.values(), default=0) < 2, named


def test_the_largest_value_may_lie_beside_an_edge_of_two_panels():
    """Of samples that both panels have at their edge either may be the larger by a rounding."""
    rule = gauss(8)
    # a parabola with its top between the last sample and the edge; the next panel falls from there
    first = 1 - (rule.nodes - 0.97) ** 2
    second = (1 - 0.03**2) * (1 + 1e-12) - 0.5 * rule.nodes
    values = jnp.asarray(np.stack([first, second]))
    assert float(highest(rule, jnp.ones(2), values)) == pytest.approx(1.0, abs=1e-13)


@pytest.mark.slow  # half a minute
@pytest.mark.parametrize("light", [False, True])
def test_estimates_are_above_the_errors(light):
    """Of machines of all proportions, also with piston and rod of a milligram, beside 24 nodes.

    The medians of estimate over error are 540 for the fluctuation and 250 for the efficiency.
    """
    made = designs("slider_crank", "mean_speed", 150, seed=7)
    if light:
        masses = lambda c: (c.mechanism.piston_mass, c.mechanism.conrod_mass)  # noqa: E731
        made = [eqx.tree_at(masses, one, [jnp.asarray(1e-6)] * 2) for one in made]
    fine = Collocation(nodes=24, reversals=4, grading=6)
    both = zip(solve_many(made, Collocation()), solve_many(made, fine), strict=True)
    pairs = [(a, b) for a, b in both if status_of(a) == status_of(b) == "converged"]
    assert len(pairs) > 130
    fluctuation = [
        (a.resolution + 1e-11, abs(a.speed_fluctuation / b.speed_fluctuation - 1)) for a, b in pairs
    ]
    efficiency = [
        (a.efficiency_error + 1e-13, abs(a.mechanical_efficiency - b.mechanical_efficiency))
        for a, b in pairs
    ]
    peaks = [
        (a.peak_error[joint] + 1e-9 * force, abs(force - b.peak_forces[joint]))
        for a, b in pairs
        for joint, force in a.peak_forces.items()
    ]
    for rows in (fluctuation, efficiency, peaks):
        stated, true = np.array(rows, float).T
        assert np.mean(true <= stated) > 0.99
