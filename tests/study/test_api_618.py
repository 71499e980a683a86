"""The page of API 618 against the same loads written down in NumPy."""

import json

import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import Compressor, load
from jaxcomp.cli import app
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.gas import DoubleActing, PolytropicCycle
from jaxcomp.machine import Machine
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import ConstantSpeed
from jaxcomp.study import steady_state

RUNNER = CliRunner()
BORE, RADIUS, LENGTH, MASS, ROD = 0.22, 0.075, 0.36, 48.0, 0.05
LOW, HIGH, EXPONENT = 12e5, 31e5, 1.38
HEAD, CRANK, AMBIENT = 0.14, 0.17, 1.2e5
SPEED = 62.0


def throw(gas):
    """One throw at a speed that nothing changes, of a massless rod."""
    mechanism = SliderCrank(BORE, RADIUS, LENGTH, MASS, 0.0)
    return Machine(Compressor(mechanism, Crankshaft(8.0), ConstantSpeed(SPEED), gas))


def double_acting():
    head = PolytropicCycle(LOW, HIGH, EXPONENT, HEAD, inlet_temperature=305.0)
    crank = PolytropicCycle(LOW, HIGH, EXPONENT, CRANK, inlet_temperature=305.0)
    return DoubleActing(head, crank, ROD, AMBIENT)


def position(angle):
    """[m] Of the piston, from the crank."""
    return RADIUS * np.cos(angle) + np.sqrt(LENGTH**2 - (RADIUS * np.sin(angle)) ** 2)


def acceleration(angle):
    """[m/s^2] Towards the head, by the second derivative of the position."""
    sine, cosine = np.sin(angle), np.cos(angle)
    reach = np.sqrt(LENGTH**2 - (RADIUS * sine) ** 2)
    slope = RADIUS**2 * sine * cosine / reach
    bend = (RADIUS**2 * (cosine**2 - sine**2) + slope**2) / reach
    return SPEED**2 * (-RADIUS * cosine - bend)


def pressure(gone, clearance, inward):
    """[Pa] Of an end by the share of its stroke that is open, and whether it compresses."""
    volume = clearance + gone
    compressed = np.minimum(LOW * ((1 + clearance) / volume) ** EXPONENT, HIGH)
    expanded = np.maximum(HIGH * (clearance / volume) ** EXPONENT, LOW)
    return np.where(inward, compressed, expanded)


def loads(angle, both_ends):
    """[N] Gas load and inertia along the rod, tension positive."""
    gone = (RADIUS + LENGTH - position(angle)) / (2 * RADIUS)
    inward = np.sin(angle) < 0
    area, rod = np.pi / 4 * BORE**2, np.pi / 4 * ROD**2
    head = pressure(gone, HEAD, inward) * area
    if both_ends:
        crank = pressure(1 - gone, CRANK, ~inward) * (area - rod)
        gas = crank + AMBIENT * rod - head
    else:
        gas = LOW * area - head
    return gas, -MASS * acceleration(angle)


@pytest.fixture(scope="module", params=[True, False], ids=["double-acting", "single-acting"])
def case(request):
    single = PolytropicCycle(LOW, HIGH, EXPONENT, HEAD, inlet_temperature=305.0)
    machine = throw(double_acting() if request.param else single)
    return steady_state(machine).api_618, request.param


def test_loads_over_the_crank_angle_are_those_of_numpy(case):
    sheet, both_ends = case
    gas, inertia = loads(sheet.crank_angle, both_ends)
    size = np.abs(gas).max()
    # the pressure beside a valve event, of which rounding may take either side
    np.testing.assert_allclose(sheet.gas[0], gas, atol=1e-9 * size)
    np.testing.assert_allclose(sheet.inertia[0], inertia, atol=1e-9 * size)
    np.testing.assert_allclose(sheet.combined[0], gas + inertia, atol=1e-9 * size)
    curves = dict((data.name, data.unit) for data in sheet.curves())
    assert curves == dict.fromkeys(("gas_rod_load", "inertia_rod_load", "combined_rod_load"), "N")


def test_extremes_and_reversal_are_those_of_numpy(case):
    sheet, both_ends = case
    angle = np.linspace(-np.pi, np.pi, 400_001)
    gas, inertia = loads(angle, both_ends)
    (record,) = sheet.throws
    kinds = {"gas": gas, "inertia": inertia, "combined": gas + inertia}
    for kind, along in kinds.items():
        # between points 1.6e-5 rad apart; corners of the gas load cost the first order
        size = 1e-9 * np.abs(along).max()
        assert getattr(record, f"{kind}_tension") == pytest.approx(along.max(), rel=1e-4, abs=size)
        assert getattr(record, f"{kind}_compression") == pytest.approx(
            -along.min(), rel=1e-4, abs=size
        )
    combined = gas + inertia
    pulled = np.mean(combined[:-1] > 0) * 2 * np.pi
    assert record.reversal_angle == pytest.approx(min(pulled, 2 * np.pi - pulled), abs=1e-4)
    sides = combined.max(), -combined.min()
    assert record.reversal_share == pytest.approx(min(sides) / max(sides), rel=1e-4)
    at = record.combined_tension_at, record.combined_compression_at
    assert loads(np.array(at), both_ends)[0] + loads(np.array(at), both_ends)[1] == pytest.approx(
        [combined.max(), combined.min()], rel=1e-4
    )
    # the largest inertia is m r w^2 (1 + r/l), at the top dead centre
    assert record.inertia_tension == pytest.approx(
        MASS * RADIUS * SPEED**2 * (1 + RADIUS / LENGTH), rel=1e-9
    )
    assert record.piston_speed == pytest.approx(2 * RADIUS * SPEED / np.pi, rel=1e-12)
    assert record.reciprocating_mass == MASS


def test_ends_have_their_ratios_temperatures_and_volumes(case):
    sheet, both_ends = case
    assert [end.end for end in sheet.ends] == (["head", "crank"] if both_ends else ["head"])
    area, rod = np.pi / 4 * BORE**2, np.pi / 4 * ROD**2
    areas, clearances = (area, area - rod), (HEAD, CRANK)
    for end, surface, clearance in zip(sheet.ends, areas, clearances, strict=False):
        ratio = HIGH / LOW
        assert end.pressure_ratio == pytest.approx(ratio, rel=1e-12)
        hot = 305.0 * ratio ** ((EXPONENT - 1) / EXPONENT)
        assert end.discharge_temperature == pytest.approx(hot, rel=1e-12)
        filling = 1 + clearance - clearance * ratio ** (1 / EXPONENT)
        assert end.volumetric_efficiency == pytest.approx(filling, rel=1e-12)
        displacement = surface * 2 * RADIUS * SPEED / (2 * np.pi)
        assert end.displacement == pytest.approx(displacement, rel=1e-12)


def test_unbalanced_forces_are_the_orders_of_the_piston(case):
    sheet, _ = case
    angle = 2 * np.pi * np.arange(4096) / 4096
    force = -MASS * acceleration(angle)
    for record in sheet.unbalanced:
        amplitude = 2 * abs(np.mean(force * np.exp(-1j * record.order * angle)))
        # the quadrature of 32 nodes
        assert record.force_x == pytest.approx(amplitude, rel=1e-6)
        assert record.force_y < 1e-9 * amplitude


def test_stages_have_pages_of_their_own():
    found = steady_state(load("two-stage-crosshead"))
    sheet = found.api_618
    assert sheet.crosshead
    assert [end.stage for end in sheet.ends] == [1, 1, 2, 2]
    between = found.quantities["stage_pressure"]["1"]
    assert sheet.ends[1].discharge_pressure == pytest.approx(between, rel=1e-12)
    assert sheet.ends[2].suction_pressure == pytest.approx(between, rel=1e-12)
    # a boxer's forces cancel, its couples do not
    scale = sheet.throws[0].inertia_compression
    for record in sheet.unbalanced:
        assert max(record.force_x, record.force_y) < 1e-9 * scale
    primary, secondary = sheet.unbalanced
    assert primary.couple_y > secondary.couple_y > 100
    # with friction of crosshead and packing, which the standard leaves out
    for number, record in enumerate(sheet.throws, 1):
        rubbed = found.rod_load_reversal[f"piston_pin_{number}"]
        assert record.reversal_angle == pytest.approx(rubbed.angle, abs=0.02)
        assert record.reversal_share == pytest.approx(rubbed.share, abs=0.02)
    assert {"gas_rod_load.1 [N]", "combined_rod_load.2 [N]"} <= {*found.columns()}


def test_the_page_is_printed():
    text = RUNNER.invoke(app, ["run", "two-stage-crosshead"], env={"COLUMNS": "240"}).stdout
    words = " ".join(text.split())
    for heads in (
        "API 618, rod load, kN",
        "Combined (gas + inertia), comp.",
        "API 618, unbalanced forces and couples",
        "Secondary",
        "Vol. eff., %",
    ):
        assert heads in words, heads


# writes and draws all, and marches a revolution: half a minute
@pytest.mark.slow
def test_the_page_is_written(tmp_path):
    out = tmp_path / "out"
    RUNNER.invoke(app, ["run", "two-stage-crosshead", "--out", str(out)])
    page = (out / "report.html").read_text()
    assert "API 618, rod load, kN" in page
    assert (out / "rod_loads.png").stat().st_size > 5000
    assert "combined_rod_load.1 [N]" in (out / "curves.csv").read_text().splitlines()[0]
    written = read_json((out / "result.json").read_text())["api_618"]
    assert written["throws"][0]["combined_tension"] > 0
    raw = json.loads((out / "result.json").read_text())["api_618"]["throws"][0]
    assert "reversal_angle [rad]" in raw


def test_a_trunk_piston_has_the_numbers_and_no_page():
    result = RUNNER.invoke(app, ["run", "mayekawa-wbhe", "--json"])
    sheet = read_json(result.stdout)["api_618"]
    assert sheet["crosshead"] is False
    assert len(sheet["throws"]) == 1
    assert sheet["throws"][0]["rod_diameter"] is None
    shown = RUNNER.invoke(app, ["run", "mayekawa-wbhe"], env={"COLUMNS": "240"}).stdout
    assert "API 618, rod load" not in shown


def test_machines_without_rods_or_gas_have_none():
    assert steady_state(throw(None)).api_618 is None
    # a mechanism without rods, without friction and rotor, which have no part in it
    link = load("slider-link-8cc").compressor.mechanism
    gas = PolytropicCycle(LOW, HIGH, EXPONENT, HEAD)
    machine = Machine(Compressor(link, Crankshaft(8.0), ConstantSpeed(SPEED), gas))
    assert steady_state(machine).api_618 is None
