"""Random slider-cranks with every motor of free speed, against the independent integrator.

`reference.one_turn` starts on the orbit that the package found and integrates one revolution with other
equations and another method: an orbit that is one comes back to where it began, with the same work.
"""

import numpy as np
import pytest
import reference
from helpers import machine, pick, random_mechanisms, solve_many, status_of

from jaxcomp import Collocation
from jaxcomp.friction import CoulombJournal, CoulombSlide, SliderCrankFriction
from jaxcomp.gas import PolytropicCycle
from jaxcomp.motor import Kloss, MeanSpeed, SlipLine

MOTORS = ("mean_speed", "slip_line", "kloss")
SOLVER = Collocation(reversals=4)


def designs(motor: str, count: int, seed: int):
    """Machines of all proportions at loads that their motors carry."""
    rng = np.random.default_rng(seed)
    mechanisms = random_mechanisms(rng, count)
    made = []
    for number in range(count):
        mechanism = pick(mechanisms, number)
        speed = rng.uniform(60, 200)
        suction, ratio = rng.uniform(0.5e5, 5e5), rng.uniform(2, 12)
        clearance, exponent = rng.uniform(0.005, 0.06), rng.uniform(1.02, 1.4)
        swept = float(mechanism.swept_volume)
        # mean torque of the gas, about
        torque = suction * swept * np.log(ratio) / (2 * np.pi)
        laws = {
            "mean_speed": lambda speed=speed, torque=torque: MeanSpeed(speed),
            "slip_line": lambda speed=speed, torque=torque: SlipLine(8 * torque / speed, speed),
            "kloss": lambda speed=speed, torque=torque: Kloss(4 * torque, 0.2, speed),
        }
        journals = {
            name: CoulombJournal(rng.uniform(0.001, 0.03), rng.uniform(0.01, 0.06))
            for name in ("piston_pin", "crank_pin", "main_journal")
        }
        friction = SliderCrankFriction(wall=CoulombSlide(rng.uniform(0.0, 0.15)), **journals)
        gas = PolytropicCycle(suction, suction * ratio, exponent, clearance, suction)
        one = machine(motor=laws[motor](), gas=gas, friction=friction, gravity=(0.0, -9.81))
        made.append(type(one)(mechanism, one.motor, one.gas, one.friction, one.gravity))
    return made


def errors(compressor, orbit) -> dict[str, float]:
    """What the reference finds differently, relative."""
    fastest = int(np.argmax(orbit.state.speed))
    level = float(orbit.motor_torque[0])
    law = compressor.motor
    torque = lambda speed: level  # noqa: E731
    if isinstance(law, SlipLine):  # in NumPy, since the integrator asks thousands of times
        slope, top = float(law.slope), float(law.synchronous_speed)
        torque = lambda speed: slope * (top - speed)  # noqa: E731
    if isinstance(law, Kloss):
        pull, slip, top = (
            float(x) for x in (law.pull_out_torque, law.pull_out_slip, law.synchronous_speed)
        )
        torque = lambda speed: (  # noqa: E731
            2 * pull * (top - speed) / top * slip / (((top - speed) / top) ** 2 + slip**2)
        )
    gap, mean, work = reference.one_turn(
        reference.from_compressor(compressor),
        torque,
        float(orbit.state.angle[fastest]),
        float(orbit.state.speed[fastest]),
    )
    losses = {name: float(loss) for name, loss in orbit.energy.losses.items()}
    total = sum(losses.values())
    efficiency = float(orbit.mechanical_efficiency)
    return {
        "gap": abs(gap),
        "mean speed": abs(mean / float(orbit.mean_speed) - 1),
        "efficiency": abs(work["gas"] / work["motor"] / efficiency - 1),
        **{f"loss {name}": abs(work[name] - loss) / total for name, loss in losses.items()},
    }


# A design takes the reference 0.3 s, a motor 15 s of compiling.
@pytest.mark.parametrize(
    ("motor", "count"),
    [
        ("mean_speed", 12),
        *(pytest.param(motor, 50, marks=pytest.mark.slow) for motor in MOTORS),
        *(pytest.param(motor, 2000, marks=pytest.mark.slow) for motor in MOTORS),
    ],
)
def test_converged_orbits_are_those_of_the_reference(motor, count):
    made = designs(motor, count, seed=41)
    found = solve_many(made, SOLVER)
    wrong, converged = {}, 0
    for number, (compressor, orbit) in enumerate(zip(made, found, strict=True)):
        if status_of(orbit) != "converged":
            continue
        converged += 1
        # The speed is known to `resolution`; losses carry the error of their quadrature as well, which
        # the orbit does not tell: some 1e-5 where a pin force all but vanishes.
        bound = 1e-5 + float(orbit.resolution)
        far = {name: error for name, error in errors(compressor, orbit).items() if error > bound}
        if far:
            wrong[number] = (bound, far)
    assert not wrong
    assert converged > 0.5 * count
