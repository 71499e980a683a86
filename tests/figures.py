"""Figures that pages state, computed again: `python tests/figures.py [GROUP ...]` prints both.

A statement is a line of a page with a place {} for every number that follows from a run. It holds if the
page has that line and each number is the computed one to its last printed digit. Figures that stand for
the agreement of a whole table ("within 0.29 %") are asserted by the test that the page names beside them.
"""

import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize_scalar
from typer.testing import CliRunner

from jaxcomp import Collocation, load, solve_orbit, with_bore
from jaxcomp.cli import app
from jaxcomp.study import RodDrive, compare_drives, steady_state

ROOT = Path(__file__).parents[1]
RPM = 2 * np.pi / 60
README, CHANGES, VALIDATION = "README.md", "CHANGELOG.md", "notebooks/validation.md"
# The rod drive of the notebook on the slider-link machine; assumed.
ROD = RodDrive(
    conrod_length=0.038,
    conrod_mass=0.025,
    conrod_centre=0.012,
    conrod_inertia=5.6e-6,
    piston_mass=0.045,
    piston_length=0.0244,
    pin_diameter=0.008,
    pin_coefficient=0.08,
)
# Of the unit of the last printed digit: half for rounding, and what solvers differ by.
WITHIN = 0.6


class Statement(NamedTuple):
    """A line of a page, and the numbers in its places."""

    page: str
    line: str
    values: tuple[float, ...]


def tsuji() -> Iterator[Statement]:
    """The machine of Tsuji et al. (2012) over bore and speed."""
    compressor = load("mayekawa-wbhe").compressor
    bores, speeds = np.arange(100, 181, 10), (800, 1000, 1200)

    def orbit_of(speed, bore):
        design = eqx.tree_at(lambda c: c.motor.mean_speed, with_bore(compressor, bore), speed)
        # the settings of the tests of these figures
        return design, solve_orbit(design, Collocation(nodes=12, reversals=0, tolerance=1e-10))

    @jax.jit
    def efficiency_of(speed, bore):
        return orbit_of(speed, bore)[1].mechanical_efficiency

    @jax.jit
    @jax.vmap
    def over(speed, bore):
        design, orbit = orbit_of(speed, bore)
        losses = {name: work / orbit.period for name, work in orbit.energy.losses.items()}
        peaks = [orbit.largest(-one) for one in (orbit.gas_torque, orbit.state.acceleration)]
        powers = orbit.gas_power, orbit.motor_power, design.mechanism.stroke
        return orbit.mechanical_efficiency, orbit.speed_fluctuation, losses, peaks, powers

    at = np.meshgrid(np.array(speeds) * RPM, bores * 1e-3, indexing="ij")
    results = jax.tree.map(
        lambda x: np.asarray(x).reshape(len(speeds), -1), over(*(jnp.ravel(one) for one in at))
    )
    efficiency, fluctuation, losses, (torque, braking), (gas, motor, stroke) = results
    pin, crank_pin, journal, wall = (
        losses[name][1] for name in ("piston_pin", "crank_pin", "main_journal", "wall")
    )
    best = efficiency.argmax(axis=1)
    rated = 100 * efficiency[range(3), [2, 3, 4]]
    # narrow, rated and wide: 100, 130 and 180 mm
    lines = {
        "| smaller, smoother | {} rad/s² at 180 mm, {} at 100 mm |": (
            -braking[1, -1], -braking[1, 0]
        ),
        "| Fig. 3(c), fluctuation at 130 mm, 1000 rpm | 10.4 % | {} % |": (100 * fluctuation[1, 3],),
        "| Fig. 3(c), fluctuation at 100 mm | 8.2 % | {} % |": (100 * fluctuation[1, 0],),
        "| Fig. 3(c), over the bore | falls with the bore | {} to {} % |": (
            100 * fluctuation[1, -1], 100 * fluctuation[1, 0]
        ),
        "| Fig. 3(d), over the bore | independent of it | {} N m at every bore |": (torque[1, 3],),
        "| fall with the bore | {} to {} W and {} to {} W from 180 to 100 mm": (
            pin[-1], pin[0], journal[-1], journal[0]
        ),
        "| smallest near 140 mm | {} and {} W at 130 and 140 mm": (crank_pin[3], crank_pin[4]),
        "| grows gradually as the bore falls | {} to {} W |": (wall[-1], wall[0]),
        "| smallest at 130 mm | smallest at {} mm, {} W |": (
            bores[sum(losses.values())[1].argmin()], sum(losses.values())[1].min()
        ),
        "| curves without numbers | {} W at every bore; motor least at {} mm, {} W |": (
            gas[1, 3], bores[motor[1].argmin()], motor[1].min()
        ),
        "efficiency at 800 rpm and 120 mm | 92.1 % | {} % |": rated[:1],
        "at 1000 rpm and 130 mm | 91.1 % | {} % |": rated[1:2],
        "at 1200 rpm and 140 mm | 90.3 % | {} % |": rated[2:],
        "at 800, 1000, 1200 rpm | 120, 130, 140 mm | {}, {}, {} mm |": bores[best],
        "best stroke over the speed | falls linearly | {}, {}, {} mm on the grid |": (
            1e3 * stroke[range(3), best]
        ),
    }  # fmt: skip
    yield from (Statement(VALIDATION, line, tuple(values)) for line, values in lines.items())
    grid = "| best bore at 800, 1000, 1200 rpm | 120, 130, 140 mm | {}, {}, {} mm |"
    yield Statement(VALIDATION, grid, tuple(bores[best]))
    yield Statement(VALIDATION, "at 1000 rpm, bore 130 mm | 91.1 % | {} % |", tuple(rated[1:2]))
    again = "prints: {} % at the rated point (was 91.15 %), {} and {} % at 800 and 1200 rpm"
    yield Statement(CHANGES, again, tuple(rated[[1, 0, 2]]))
    for speed in speeds:
        found = minimize_scalar(
            lambda bore, speed=speed: -float(efficiency_of(speed * RPM, bore)),
            bounds=(0.10, 0.16),
            method="bounded",
            options={"xatol": 1e-7},
        )
        line, values = f"{speed} rpm: {{}} mm, {{}} %", (1e3 * found.x, -100 * found.fun)
        yield Statement("notebooks/optimal_bore.ipynb", line, values)


def levecque() -> Iterator[Statement]:
    """The hermetic machine of Levecque et al. (2011): its balance, and its power."""
    told = CliRunner().invoke(app, ["balance", "hermetic-68cc", "--json"])
    planes = json.loads(told.stdout)["planes"]
    masses, phases = ([one[key] for one in planes] for key in ("unbalance [kg m]", "phase [rad]"))
    (top, weight), (first, second) = 1e6 * np.array(masses), np.rad2deg(phases)
    line = "| Table 3, rotor top | 824.6 g mm at -3° | {} g mm at {}°, fitted |"
    yield Statement(VALIDATION, line, (top, first))
    line = "| Table 3, counterweight | 456.8 g mm at -177° | {} g mm at {}°, fitted |"
    yield Statement(VALIDATION, line, (weight, second))
    line = "| corrections in two planes | 824.6 and 456.8 g mm | {} and {} g mm |"
    yield Statement(VALIDATION, line, (top, weight))
    line = "| rotor, top | {} g mm | {}° |"
    yield Statement("notebooks/vibration.md", line, (top, first))
    line = "| counterweight | {} g mm | {}° |"
    yield Statement("notebooks/vibration.md", line, (weight, second))
    line = "by the statics of the shaft: {} g mm at {}° and {} g mm at {}°"
    yield Statement(CHANGES, line, (top, first, weight, second))
    orbit = solve_orbit(load("hermetic-68cc"), Collocation(reversals=0))
    line = "| Section 2, power input | 2.9 kW | {} kW at the shaft |"
    yield Statement(VALIDATION, line, (float(orbit.motor_power) / 1e3,))


def dagilis() -> Iterator[Statement]:
    """The slider-link machine after Dagilis et al.: losses, and what a connecting rod would save."""
    machine = load("slider-link-8cc").compressor
    orbit = solve_orbit(machine, Collocation(reversals=0))
    loss = {name: float(work / orbit.period) for name, work in orbit.energy.losses.items()}
    drives = compare_drives(machine, ROD, Collocation(reversals=0))
    saving = float(drives.total_saving)
    terminals = saving / 0.85, saving / 0.70
    lines = {
        "0.086 to 0.108 | {} W at 0.095 |": (loss["thrust_bearing"],),
        "which the paper assumes | {} W |": (loss["pump"],),
        "saved by a connecting rod | {} W at the shaft, of the pair alone |": (loss["link_slider"],),
        "| {} W at the shaft, {} to {} W at the terminals of a motor of 70 to 85 % |": (
            saving, *terminals
        ),
        "doing the same work would save {} W of {} W": (saving, orbit.motor_power),
    }  # fmt: skip
    yield from (Statement(VALIDATION, line, values) for line, values in lines.items())
    line = "| saving by a connecting rod | at most 4 W at the terminals | {} to {} W: not met |"
    yield Statement(VALIDATION, line, terminals)


def readme() -> Iterator[Statement]:
    """The simple machine beside one with valves, as the README has them."""
    both = [steady_state(load(name)) for name in ("mayekawa-wbhe", "r290-6cc")]
    simple, valves = (one.quantities for one in both)
    crank = [2e3 * float(one.compressor.mechanism.crank_radius) for one in both]
    bore = [1e3 * float(one.compressor.mechanism.bore) for one in both]
    lines = {
        "| bore and stroke | {} x {} mm | {} x {} mm |": (bore[0], crank[0], bore[1], crank[1]),
        "| shaft power, mechanical efficiency | {} kW, {} % | {} W, {} % |": (
            simple["motor_power"] / 1e3, 100 * simple["mechanical_efficiency"],
            valves["motor_power"], 100 * valves["mechanical_efficiency"],
        ),
        "| mass flow, capacity, COP | | {} g/s, {} W, {} |": (
            1e3 * valves["mass_flow"], valves["capacity"], valves["cop"]
        ),
        "| volumetric, overall efficiency | | {} %, {} % |": (
            100 * valves["volumetric_efficiency"], 100 * valves["overall_efficiency"]
        ),
        "| largest loss | crank pin, {} W | motor, {} W |": (
            simple["loss_power"]["crank_pin"], valves["power_use"]["motor"]
        ),
    }  # fmt: skip
    yield from (Statement(README, line, values) for line, values in lines.items())


GROUPS: dict[str, Callable[[], Iterator[Statement]]] = {
    one.__name__: one for one in (tsuji, levecque, dagilis, readme)
}


def printed(statement: Statement) -> list[str] | None:
    """The numbers that a page has in the places of a statement; `None` if it has no such line."""
    text = " ".join((ROOT / statement.page).read_text("utf-8").split())
    parts = map(re.escape, statement.line.split("{}"))
    found = re.search(r"(-?\d[\d,]*(?:\.\d+)?)".join(parts), text)
    return None if found is None else list(found.groups())


def holds(text: str, value: float) -> bool:
    """Whether a printed number is a value to its last digit."""
    unit = 10.0 ** -len(text.partition(".")[2])
    return abs(float(text.replace(",", "")) - value) <= WITHIN * unit


def disagreements(statement: Statement) -> list[str]:
    """What a page has wrong of a statement, in words."""
    texts = printed(statement)
    if texts is None:
        return [f"{statement.page} has no line {statement.line!r}"]
    pairs = zip(texts, map(float, statement.values), strict=True)
    return [
        f"{statement.page}: {text} stands for {value:.6g} in {statement.line!r}"
        for text, value in pairs
        if not holds(text, value)
    ]


def main() -> int:
    """Print every statement as the page has it, with what is computed."""
    wrong = 0
    for name in sys.argv[1:] or GROUPS:
        for one in GROUPS[name]():
            found = disagreements(one)
            wrong += bool(found)
            values = ", ".join(f"{float(value):.6g}" for value in one.values)
            print(f"{one.page}: {one.line.format(*(printed(one) or one.values))}\n    {values}")
            print("".join(f"    WRONG: {words}\n" for words in found), end="", flush=True)
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
