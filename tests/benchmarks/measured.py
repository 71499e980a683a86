"""The table of identify.md: machines by a few points of their maps, and all other points predicted.

    python tests/benchmarks/measured.py [--starts N] [ROW ...]

Rows are 06dm313, 3db3, crk3, vtz-4, vtz-9, vtz-speeds, vtz-factors, 06dr316; with three starts, as by
default, all of them take half an hour of processor time. Printed are, for capacity and power, root mean
square and largest error of the points that were not fitted, and the share of them within the 95 %
intervals; then chi-square, its p-value and time.

By name alone: 06dm316 and 06dr724, machines that are not bundled and by which nothing was chosen, of the
same collection (`maps`); and trap-unit and trap-liquid, maps that are wrong in two of their rows, which
are to be rejected: two of the four that are fitted, or with -12 two of all twelve.
"""

import argparse
import dataclasses
import time
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from jaxcomp import load
from jaxcomp.fluid import RealGas
from jaxcomp.scene import with_value
from jaxcomp.scene.measured import read_measurement
from jaxcomp.study import identify, map_recipe
from jaxcomp.study.identification._reading_model import ReadingModel
from jaxcomp.study.identification._readings import with_own_factors
from jaxcomp.study.rating import capacity_rise

ZERO, TURN = 273.15, 2 * np.pi
MAPS = Path(__file__).parent / "maps"
TEMPLATE = "semi-hermetic-200cc"
# smooth polynomials of makers allow more than what is usual for readings
SD = {"capacity": 0.008, "power": 0.008}
R22 = (-15, -5, 4.4), (20, 30, 40, 48.9)
FOUR = ("-15/48.9 C", "-5/30 C", "4.4/20 C", "4.4/48.9 C")
LOW = (-35, -29, -20), (20, 30, 40, 45)
FOUR_LOW = ("-35/45 C", "-29/30 C", "-20/20 C", "-20/45 C")
R134A = tuple(range(-15, 11, 5)), tuple(range(35, 61, 5))
CORNER = ("-15/55 C", "-15/60 C")  # where a cubic bends as no compressor does
VTZ_4 = ("-15/40 C", "-10/55 C", "5/40 C", "10/60 C")
VTZ_9 = (
    "-15/35 C", "-15/50 C", "-10/60 C", "-5/45 C", "0/35 C", "0/60 C", "5/50 C", "10/35 C", "10/60 C",
)  # fmt: skip
SPEEDS = (-10, 0, 10), (40, 50, 60)
EIGHT = (
    ("-10/40 C", "0/50 C", "10/40 C", "10/60 C"), ("-10/60 C", "10/40 C"), ("-10/40 C", "10/60 C"),
)  # fmt: skip
TOLD = "law of speed", "held by its bound", "no solution", "does not explain"
# Points of FOUR at which the maps of the traps are wrong.
WRONG = FOUR[1], FOUR[3]


def template(**values):
    scene = load(TEMPLATE)
    for path, value in values.items():
        scene = with_value(scene, path.replace("__", "."), value)
    return scene


def points(name, scene, grid, speed=None):
    """Points of a map at a speed [1/s], without the corner."""
    given = [np.array(axis, float) + ZERO for axis in grid]
    found = read_measurement(name, scene.machine, *given, None if speed is None else TURN * speed)
    kept = np.array([one not in CORNER for one in found.names])
    rows = ("evaporating", "condensing", "gas", "liquid", "useful", "speed")
    return dataclasses.replace(
        found,
        **{key: getattr(found, key)[kept] for key in rows},
        measured={key: values[kept] for key, values in found.measured.items()},
    )


def fitted(readings, chosen):
    """Numbers of the points that are left out of the fit, counted over all readings."""
    names = [name for one in readings for name in one.names]
    used, first = [], 0
    for one, mine in zip(readings, chosen, strict=True):
        used += [first + one.names.index(name) for name in mine]
        first += len(one.names)
    return [n for n in range(len(names)) if n not in used]


def row(label, scene, readings, chosen, starts=3):
    """Fit, print, and hand back what was found."""
    begin = time.process_time()
    machine, vary, prior = map_recipe(scene, readings)
    left = fitted(readings, chosen)
    found = identify(machine, readings, vary, prior, sd=SD, hold_out=left, starts=starts)
    show(label, found, time.process_time() - begin)
    return found


def show(label, found, seconds):
    """A row of the table."""
    cells = [
        f"{name} {held.rms:.2%} ({held.largest:.2%}), {held.inside:.0%} of {held.count} inside"
        for name, held in found.held_out.items()
        if name != "mass_flow"
    ]
    p_value = float(found.p_value)
    chi = f"chi-square {float(found.chi_square):.3g} on {int(found.freedom)}, p {p_value:.2g}"
    print(f"{label:12s} {'; '.join(cells)}; {chi}; {seconds:.0f} s", flush=True)
    for note in found.notes:
        if any(words in note for words in TOLD):
            print(f"{'':12s} {note}", flush=True)


def scaled(readings, quantity, factor):
    """Readings whose quantity is a factor too large at the points of WRONG."""
    wrong = np.isin(readings.names, WRONG)
    values = readings.measured[quantity] * np.where(wrong, factor, 1.0)
    return dataclasses.replace(readings, measured={**readings.measured, quantity: values})


def in_btu_per_second(readings):
    """Power that was printed in Btu/s there, and is taken for kW."""
    return scaled(readings, "power", 1 / 1.0550559)


def rated_with_subcooled_liquid(readings):
    """Capacity there rated with liquid that is 8.3 K subcooled, while the file says 0 K."""
    fluid = RealGas(readings.fluid)
    rises = jax.jit(jax.vmap(lambda *point: capacity_rise(fluid, *point)))
    at = readings.evaporating, readings.condensing, readings.useful
    stated = rises(*at, readings.liquid)
    rated = rises(*at, readings.liquid - 8.3)
    return scaled(readings, "capacity", np.asarray(rated / stated))


def main(rows, starts) -> None:
    """Print the rows."""
    slow, fast = template(), template(motor__mean_speed="3500 rpm")
    for label, name, scene in (
        ("06dm313", "06dm313_r22", slow),
        ("3db3", "3db3-1000_r22_60hz", slow),
        ("crk3", "crk3-0325_r22", fast),
        ("06dm316", MAPS / "06dm316_r22.csv", slow),
        ("06dr724", MAPS / "06dr724_r22.csv", slow),
    ):
        if label in rows:
            row(label, scene, [points(name, scene, R22)], [FOUR], starts)
    for label, trap in (
        ("trap-unit", in_btu_per_second),
        ("trap-liquid", rated_with_subcooled_liquid),
    ):
        wrong = trap(points("06dm313_r22", slow, R22))
        if label in rows:
            row(label, slow, [wrong], [FOUR], starts)
        if f"{label}-12" in rows:
            row(f"{label}-12", slow, [wrong], [wrong.names], starts)
    hermetic = template(gas__fluid__name="R134a", motor__mean_speed="3000 rpm")
    for label, chosen in (("vtz-4", VTZ_4), ("vtz-9", VTZ_9)):
        if label in rows:
            row(label, hermetic, [points("vtz038-g_r134a", hermetic, R134A, 50)], [chosen], starts)
    for label in ("vtz-speeds", "vtz-factors"):
        if label in rows:
            given = [points("vtz038-g_r134a", hermetic, SPEEDS, n) for n in (50, 75, 90)]
            if label == "vtz-factors":
                given = with_own_factors(given)
            row(label, hermetic, given, EIGHT, starts)
    if "06dr316" in rows:
        low = [points("06dr316_r22", slow, LOW)]
        found = row("06dr316 R22", slow, low, [FOUR_LOW], starts)
        other = template(gas__fluid__name="R134a")
        ahead = points("06dr316_r134a", other, R22)
        entries, said = carried(found.machine, ahead)
        for name in ("capacity", "power"):
            mine = np.array([one == name for one in entries.quantity])
            error = said[mine] / entries.measured[mine] - 1
            rms, most = np.sqrt(np.mean(error**2)), np.abs(error).max()
            print(f"{'  with R134a':12s} {name} {rms:.2%} ({most:.2%})", flush=True)


def carried(machine, ahead):
    """Readings of another fluid, and what the constants of a machine say of them."""
    place = lambda m: m.compressor.gas.fluid  # noqa: E731
    machine = eqx.tree_at(place, machine, RealGas(ahead.fluid))
    blocks = ReadingModel(machine, (), [ahead], SD)
    values, _ = blocks(np.zeros(0), range(blocks.count))
    return blocks.entries, values


ROWS = ("06dm313", "3db3", "crk3", "vtz-4", "vtz-9", "vtz-speeds", "vtz-factors", "06dr316")
BY_NAME = "06dm316", "06dr724", "trap-unit", "trap-liquid", "trap-unit-12", "trap-liquid-12"

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("rows", nargs="*", metavar="ROW")
    parser.add_argument("--starts", type=int, default=3)
    arguments = parser.parse_args()
    unknown = set(arguments.rows) - {*ROWS, *BY_NAME}
    if unknown:
        parser.error(f"no row {', '.join(unknown)}; there are {', '.join((*ROWS, *BY_NAME))}")
    main(arguments.rows or ROWS, arguments.starts)
