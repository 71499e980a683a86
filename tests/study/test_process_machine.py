"""The bundled process compressor: its flows, load steps, and what its notebook says."""

import re
from pathlib import Path

import numpy as np
import pytest

from jaxcomp import load, plot, solve_orbit
from jaxcomp.crank import performance
from jaxcomp.scene import with_values
from jaxcomp.study import load_steps

NAME = "process-two-stage"
ENDS = "clearance_ratio", "volumetric_efficiency"
KINDS = "gas", "inertia", "combined"
LOADS = [f"{kind}_{sense}" for kind in KINDS for sense in ("compression", "tension")]
PAGE = (Path(__file__).parents[2] / "notebooks" / "process.md").read_text("utf-8")


@pytest.fixture(scope="module")
def table():
    return load_steps(load(NAME))


@pytest.mark.slow  # compiles the cycles of two stages with two ends each, for a minute
def test_stages_of_the_process_compressor_pass_on_one_flow(table):
    full = table.states[0]
    cycle = full.orbit.cycle
    first, second = cycle.flow_of_stages
    np.testing.assert_allclose(first, second, rtol=1e-8)
    assert 1e6 < float(cycle.interstage_pressures[0]) < 4.5e6


@pytest.mark.slow  # as above
def test_load_steps_of_the_process_compressor_fall_in_flow_and_power(table):
    rows = table.rows()
    flows = [row.mass_flow for row in rows]
    powers = [row.shaft_power for row in rows]
    assert flows == sorted(flows, reverse=True)
    assert powers == sorted(powers, reverse=True)
    # pockets take a sixth, idle crank ends about half of the flow
    shares = [row.flow_share for row in rows]
    assert 0.8 < shares[1] < 0.95
    assert 0.45 < shares[2] < 0.55
    # every step turns the load of the pins around for longer than the standard asks, 15 degrees
    assert all(row.reversal_angle > np.deg2rad(15) for row in rows)


@pytest.mark.slow  # as above
def test_power_is_what_gas_coolers_walls_and_leaks_take_away(table):
    """At every load step: no energy is lost in four ends, the cooler, rings and packings."""
    compressor = load(NAME).compressor
    for state in table.states:
        orbit = state.orbit
        cycle = orbit.cycle
        totals = cycle.each.totals
        carried = totals.discharge_heat + totals.leakage_heat - totals.suction_heat
        # the gas work of the crank, by its own quadrature, against enthalpies of the four ends
        work = float(orbit.energy.gas_work)
        np.testing.assert_allclose(np.sum(carried - totals.heat), work, rtol=1e-8)
        # what passes the rings leaves one end and comes into the other: packings are left
        suction = cycle.each.case.suction.h
        first = np.array(cycle.stages) == 1
        between = cycle.each.case.suction.h[~first][0]
        cooled = np.sum((totals.discharge_heat - totals.discharge * between)[first])
        used = performance(compressor, orbit)
        np.testing.assert_allclose(used.heat["coolers"], cooled * cycle.frequency, rtol=1e-12)
        assert cooled > 0.4 * work
        gained = np.sum((totals.discharge_heat - totals.discharge * suction)[first]) - cooled
        gained += np.sum((totals.discharge_heat - totals.discharge * suction)[~first])
        np.testing.assert_allclose(used.heat["refrigerant"], gained * cycle.frequency, rtol=1e-12)
        # shaft power, and the heat of the last two with friction and leaks
        power = float(orbit.motor_power)
        np.testing.assert_allclose(sum(map(float, used.heat.values())), power, rtol=1e-8)


@pytest.mark.slow  # as above
def test_diagrams_of_all_ends_enclose_the_work_of_the_gas(table):
    orbit = table.states[0].orbit
    (ax,) = plot.pv_diagram(load(NAME).compressor, orbit).axes
    assert len(ax.lines) == 4
    areas = [abs(np.trapezoid(line.get_ydata(), line.get_xdata())) for line in ax.lines]
    # chords between 720 points
    assert sum(areas) == pytest.approx(float(orbit.energy.gas_work), rel=1e-4)


def rows_of(first: str) -> list[list[float]]:
    """Numbers of the rows of the page's table whose head begins so, without the first cell."""
    _, _, text = PAGE.partition(f"| {first}")
    lines = [line for line in text.split("\n\n")[0].splitlines()[2:] if line.startswith("|")]
    rows = [line.strip("|").split("|")[1:] for line in lines]
    return [[float(re.findall(r"[\d.]+", cell)[0]) for cell in row] for row in rows]


def agrees(printed: list[float], computed: list[float]) -> None:
    """Printed numbers are the computed ones to four digits."""
    np.testing.assert_allclose(printed, computed, rtol=6e-4)


@pytest.mark.slow  # as above
def test_the_page_prints_what_is_computed(table):
    for printed, row in zip(rows_of("load step | flow"), table.rows(), strict=True):
        loads = row.rod_compression / 1e3, row.rod_tension / 1e3
        reversal = np.rad2deg(row.reversal_angle), 100 * row.reversal_share
        flow = 1e3 * row.mass_flow, 100 * row.flow_share
        power = row.shaft_power / 1e3, row.mean_torque
        hottest = row.discharge_temperature - 273.15
        # the smallest shares have two digits
        np.testing.assert_allclose(
            printed, [*flow, *power, *loads, *reversal, hottest], rtol=1e-3, atol=0.05
        )
    sheet = table.states[0].api_618
    for printed, end in zip(rows_of("at the stated"), sheet.ends, strict=True):
        bars = end.suction_pressure / 1e5, end.discharge_pressure / 1e5
        warm = end.discharge_temperature - 273.15
        agrees(printed, [*bars, warm, *(100 * getattr(end, name) for name in ENDS)])
    for printed, throw in zip(rows_of("kN"), sheet.throws, strict=True):
        reversal = np.rad2deg(throw.reversal_angle), 100 * throw.reversal_share
        agrees(printed, [*(getattr(throw, name) / 1e3 for name in LOADS), *reversal])
    couples = [row.couple_y / 1e3 for row in sheet.unbalanced]
    couples.append(sheet.unbalanced[0].couple_x / 1e3)
    printed = re.findall(r"([\d.]+) kN m", PAGE)
    agrees([float(number) for number in printed], couples)


@pytest.mark.slow  # as above
def test_work_of_a_kilogram_is_least_with_the_smaller_ratio_in_the_second_stage():
    """What the notebook finds by the bore of the second stage."""
    scene = load(NAME)
    works = []
    ratios = []
    # below 163 mm the valves have more events than the smallest program of the cycle has room for
    for bore in (163, 165, 175, 185):
        orbit = solve_orbit(with_values(scene, {"mechanism.bore": ["260 mm", f"{bore} mm"]}))
        works.append(float(orbit.motor_power / orbit.cycle.mass_flow))
        between = float(orbit.cycle.interstage_pressures[0])
        ratios.append(((between + 0.4e5) / 10e5, 45e5 / between))
    best = int(np.argmin(works))
    assert best == 1
    first, second = ratios[best]
    assert first > second
    # a wider second stage takes more of the whole
    seconds = [second for _, second in ratios]
    assert seconds == sorted(seconds)
