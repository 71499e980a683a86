"""Figures of the page of blends: boiling points, and one machine on several blends."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from jaxcomp import load, problem
from jaxcomp.fluid import Mixture
from jaxcomp.fluid._blends import blends
from jaxcomp.fluid._equilibrium import PhaseModel, first_point
from jaxcomp.scene import with_values

PAGE = (Path(__file__).parents[2] / "notebooks" / "blends.md").read_text("utf-8")
ZERO = 273.15
ATMOSPHERE = 101325.0


def rows_of(first: str) -> dict[str, list[str]]:
    """Cells of the table whose head begins so, by the blend in the first one."""
    _, _, table = PAGE.partition(f"| {first}")
    lines = table.split("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0]: row[1:] for row in cells}


BOILING = rows_of("blend | class")


def extrapolated_bubble_temperature(fluid: Mixture) -> float:
    """[K] At the pressure of the atmosphere, below the lines, where a component alone is solid."""
    phases = PhaseModel(fluid.table)
    z = np.asarray(fluid.table.mole_fractions(np.asarray(fluid.mass_fractions)))

    def excess(T: float) -> float:
        point, good = first_point(phases, fluid.components or (), T, z, dew=False)
        assert good[0]
        liquid = np.exp(point.unknowns[:, 0])
        pressure = phases.phase(np.array([T]), liquid, z[None]).pressure
        return float(np.log(pressure[0] / ATMOSPHERE))

    end = float(fluid.lowest_temperature)
    return float(brentq(excess, end - 10.0, end, xtol=1e-6))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", BOILING)
def test_boiling_points_beside_those_of_ashrae_34(name):
    quality, bubble, own_bubble, bubble_off, dew, own_dew, dew_off = BOILING[name]
    assert quality == blends()[name].quality
    fluid = Mixture(name=name)
    found = [fluid.bubble_temperature(ATMOSPHERE), fluid.dew_temperature(ATMOSPHERE)]
    if float(found[0]) == float(fluid.lowest_temperature):
        found[0] = extrapolated_bubble_temperature(fluid)
    listed = float(bubble), float(dew)
    printed = float(own_bubble), float(own_dew)
    off = float(bubble_off), float(dew_off)
    for place in range(2):
        celsius = float(found[place]) - ZERO
        # half of the last digit
        assert abs(celsius - printed[place]) < 0.0051
        assert abs(celsius - listed[place] - off[place]) < 0.0051
    if quality == "A":
        assert max(map(abs, off)) < 0.65


def test_the_bad_ones_are_shown():
    assert len(BOILING) == 27
    assert BOILING["R417A"][3] == "-1.10"
    assert BOILING["R463A"][3] == "-1.55"


@pytest.mark.slow  # a program for each number of components
@pytest.mark.parametrize("name", ["R404A", "R455A"])
def test_a_machine_on_blends(name):
    printed = [float(re.findall(r"[\d.]+", cell)[0]) for cell in rows_of("| capacity")[name]]
    values = {"gas.fluid.name": name, "gas.suction.evaporating": "-10 degC"}
    values |= {"gas.suction.temperature": "0 degC", "gas.suction.heating": "0 K"}
    values |= {"gas.discharge.condensing": "45 degC"}
    scene = with_values(load("r290-6cc"), values | {"gas.discharge.liquid_temperature": "30 degC"})
    asked = ["capacity", "motor_power", "cop", "mass_flow", "discharge_temperature"]
    study = problem(scene, ["gas.clearance_ratio"], asked)
    answer = study(study.current)
    assert bool(answer.ok)
    capacity, _, cop, flow, discharge = map(float, answer.values)
    # half of the last digit
    assert abs(capacity - printed[0]) < 0.051
    assert abs(cop - printed[2]) < 0.00051
    assert abs(1e3 * flow - printed[3]) < 0.00051
    assert abs(discharge - ZERO - printed[4]) < 0.051
