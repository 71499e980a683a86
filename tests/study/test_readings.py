"""Files of rated points: readings, and the polynomials of makers."""

import dataclasses

import numpy as np
import pytest
from typer.testing import CliRunner

from jaxcomp import BadInput
from jaxcomp.cli._app import app
from jaxcomp.fluid import RealGas
from jaxcomp.scene import SceneError
from jaxcomp.scene.readings import polynomial_text, read_readings
from jaxcomp.study import joined, terms_of
from jaxcomp.study.rating import QUANTITIES, RatingMap

ZERO = 273.15
# Carlyle 06DM313, R22, by EnergyPlus, datasets/RefrigerationCompressorCurves.idf
MAP = """# fluid = R22
# return_gas = 18.3 degC
# subcooling = 0.0 K
# evaporating = -17.8 to 4.4 degC
# condensing = 10.0 to 48.9 degC; as published, from a maker
quantity,unit,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10
capacity,W,24800.0,920.4,-228.5,12.57,-5.991,-0.2729,0.06045,-0.06974,-0.007395,0.003095
power,W,767.6,-100.2,98.72,-2.675,3.029,-0.2676,-0.01846,0.02064,0.002852,-0.003362
"""
HEAD = "evaporating [degC],condensing [degC],return_gas [degC],subcooling [K]"
POINT = "-5,30,18.3,0"


def read(tmp_path, text, **options):
    file = tmp_path / "points.csv"
    file.write_text(text)
    return read_readings(file, **options)


def test_a_polynomial_at_the_points_of_its_maker(tmp_path):
    found = read(
        tmp_path, MAP, evaporating=[ZERO - 15, ZERO + 4], condensing=[ZERO + 40, ZERO + 45]
    )
    at = dict(zip(found.names, range(4), strict=True))
    first, last = at["-15/40 C"], at["4/45 C"]
    # to the six digits printed
    np.testing.assert_allclose(
        found.values["capacity"][[first, last]], [7384.09, 16945.0], rtol=3e-6
    )
    np.testing.assert_allclose(found.values["power"][[first, last]], [3336.41, 4500.15], rtol=3e-6)
    assert found.polynomial
    assert found.fluid == "R22"
    np.testing.assert_allclose(found.gas, ZERO + 18.3)
    np.testing.assert_allclose(found.liquid, found.condensing)
    np.testing.assert_allclose(found.deviation("power", {}), 0.02 * found.values["power"])
    found.check(RealGas("R22"))


def test_the_grid_of_a_polynomial_keeps_off_its_corner(tmp_path):
    found = read(tmp_path, MAP)
    assert found.evaporating.size == 18  # 5 by 4, less those within 15 K of each other
    assert (found.condensing - found.evaporating > 15).all()


@pytest.mark.parametrize("count", [10, 20, 30])
def test_terms_are_a_cubic_of_full_rank(count):
    rng = np.random.default_rng(0)
    s, d, n = (
        ZERO + rng.uniform(-20, 10, 200),
        ZERO + rng.uniform(30, 60, 200),
        rng.uniform(30, 90, 200),
    )
    terms = terms_of(count, s, d, n)
    size = np.linalg.norm(terms, axis=0)
    assert np.linalg.matrix_rank(terms / size, tol=1e-12) == count
    s, d = s - ZERO, d - ZERO
    every = [s**2 * d, s * d**2, s**3, d**3] + [s * d * n, d**2 * n] * (count > 10)
    for one in every:
        left = np.linalg.lstsq(terms / size, one, rcond=None)[0] @ (terms / size).T - one
        assert np.abs(left).max() < 1e-6 * np.abs(one).max()  # rounding of a cubic fit
    with pytest.raises(BadInput, match="10, 20 or 30"):
        terms_of(11, 250.0, 300.0)


def test_readings_with_units_and_gaps(tmp_path):
    text = (
        "# fluid = R134a\n# superheat = 10 K\n# liquid = 25 degC\n"
        "evaporating [degF],condensing [degC],speed [1/s],power [kW],mass_flow [kg/h],"
        "sd(power) [%],discharge_temperature [degC]\n"
        "14,40,50,1.2,60,2,80\n-4,40,30,0.8,,3,\n"
    )
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.evaporating, [263.15, 253.15])
    np.testing.assert_allclose(found.gas, [273.15, 263.15])
    np.testing.assert_allclose(found.liquid, 298.15)
    np.testing.assert_allclose(found.speed, 2 * np.pi * np.array([50, 30]))
    np.testing.assert_allclose(found.values["mass_flow"], [60 / 3600, np.nan])
    np.testing.assert_allclose(found.values["discharge_temperature"], [353.15, np.nan])
    np.testing.assert_allclose(found.deviation("power", {}), [24, 24])
    assert found.deviation("discharge_temperature", {})[0] == 2.0
    both = joined([found, found])
    assert both.evaporating.size == 4
    np.testing.assert_allclose(both.deviation("power", {}), 24)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{HEAD},powr [W]\n{POINT},1", "unknown column.*power"),
        (f"{HEAD},power\n{POINT},1", r"power: needs its unit.*power \[W\]"),
        (f"{HEAD},power [K]\n{POINT},1", "another dimension"),
        (f"{HEAD},superheat [K],power [W]\n{POINT},5,1", "contradicts superheat"),
        (
            f"{HEAD.replace('subcooling [K]', 'subcooling [degC]')},power [W]\n{POINT},1",
            "difference",
        ),
        (f"{HEAD},evaporating [degC],power [W]\n{POINT},1,1", "there twice"),
        ("evaporating [degC],condensing [degC],capacity [W]\n-5,30,1", "superheat must be given"),
        (f"{HEAD},power [W]\n{POINT},x", "must be a number"),
        (f"{HEAD},power [W]\n{POINT}", "must have 5 cells"),
        (HEAD + "\n" + POINT, "measures nothing"),
        (f"{HEAD},sd(power) [W],capacity [W]\n{POINT},1,1", "needs a column power"),
        (MAP.replace("# evaporating = -17.8 to 4.4 degC\n", ""), "no range"),
        (MAP.replace("power,W", "powers,W"), "unknown.*power"),
        (MAP.replace(",C10", ""), "must have 11 cells"),
    ],
)
def test_a_file_that_cannot_be_read(tmp_path, text, message):
    with pytest.raises(SceneError, match=message):
        read(tmp_path, text)


def test_points_that_cannot_be(tmp_path):
    good = read(tmp_path, MAP)
    for change, message in [
        ({"fluid": "R134a"}, "gas.fluid.name"),
        ({"gas": good.gas - 60}, "at least the evaporating"),
        ({"condensing": good.condensing + 60}, "condensing below 96"),
        ({"condensing": good.evaporating - 1}, "evaporating below condensing"),
        ({"liquid": good.condensing + 1}, "at most condensing"),
    ]:
        with pytest.raises(BadInput, match=message):
            dataclasses.replace(good, **change).check(RealGas("R22"))
    twice = joined([good, good])
    with pytest.raises(BadInput, match="there twice"):
        twice.check(RealGas("R22"))


def test_a_capacity_that_contradicts_the_flow(tmp_path):
    # 06DM313 at -5/30: 282.47 kg/h where the whole superheat counts (Helmholtz energy of R22)
    head = f"{HEAD},capacity [W],mass_flow [kg/h]"
    read(tmp_path, f"{head}\n-5,30,18.3,0,14367.3,282.47").check(RealGas("R22"))
    wrong = read(tmp_path, f"{head}\n-5,30,5,0,14367.3,282.47")
    with pytest.raises(BadInput, match=r"at most 3%.*subcooling .* leave 0\."):
        wrong.check(RealGas("R22"))


def made_map(speed):
    """A map whose quantities are cubics, with one point that failed."""
    s, d = ZERO + np.linspace(-20, 5, 5), ZERO + np.linspace(30, 55, 5)
    ok = np.ones((5, 5), bool)
    ok[0, 4] = False
    x, y = s[:, None] - ZERO, d - ZERO
    flow = speed * (2 + 0.05 * x - 0.01 * y + 1e-4 * x * y + 1e-6 * y**3) / 1000
    values = {"mass_flow": flow, "capacity": 2e5 * flow, "power": 3e4 * flow + 0 * x}
    values = {name: np.where(ok, one, np.nan) for name, one in values.items()}
    return RatingMap(s, d, values, ok, {}, {}, "file")


@pytest.mark.parametrize(
    ("count", "speeds"), [(10, (50.0,)), (20, (30.0, 50.0, 70.0, 90.0)), (30, (30.0, 50.0, 90.0))]
)
def test_coefficients_that_are_written_are_read_back(tmp_path, count, speeds):
    maps = {one: made_map(one) for one in speeds}
    told = {"fluid": "R22", "return_gas": "18.3 degC", "subcooling": "0 K"}
    text = polynomial_text(maps, count, told)
    assert "# largest error of power = " in text
    s, d = maps[speeds[0]].evaporating, maps[speeds[0]].condensing
    turning = None if count == 10 else 2 * np.pi * speeds[0]
    found = read(tmp_path, text, evaporating=s, condensing=d, speed=turning)
    # rounding of a fit in powers; a term n x y is in 20 coefficients, n y^3 is not: 1e-6 * 55^3 of 2
    close = 1e-9 if count != 20 else 0.03
    expected = made_map(speeds[0]).values["mass_flow"].ravel()
    there = np.isfinite(expected)
    np.testing.assert_allclose(found.values["mass_flow"][there], expected[there], rtol=close)
    few = {one: maps[one] for one in speeds[:1]}
    if count > 10:
        with pytest.raises(BadInput, match="four speeds for 20 and three for 30"):
            polynomial_text(few, count, told)


def test_the_command_map_writes_coefficients(tmp_path, monkeypatch):
    def made_up(scene, evaporating, condensing, standard):
        x, y = evaporating[:, None] - ZERO, condensing - ZERO
        n = float(scene.machine.compressor.motor.mean_speed) / (2 * np.pi)
        values = {name: n * (100 + x + 0 * y) for name, *_ in QUANTITIES}
        ok = np.ones((x.size, y.size), bool)
        return RatingMap(
            evaporating, condensing, values, ok, {"power": np.zeros(10)}, {"power": 0.0}, standard
        )

    monkeypatch.setattr("jaxcomp.study.rating.rating_map", made_up)
    given = [
        "map",
        "r134a-7cc",
        "--evaporating=-30:-10:4",
        "--condensing=35:55:4",
        "--rating",
        "ashrae",
    ]
    more = ["--coefficients", "20", "--speeds", "1500,2000,2500,3000rpm", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, [*given, *more])
    assert result.exit_code == 0, result.output
    at = ([ZERO - 25], [ZERO + 40], 2 * np.pi * 45)
    found = read_readings(tmp_path / "coefficients.csv", *at)
    np.testing.assert_allclose(found.values["power"], 45 * 75, rtol=1e-9)  # rounding of the fit
    np.testing.assert_allclose([found.gas, found.liquid], ZERO + 32.2)
    assert found.fluid == "R134a"
    refused = CliRunner().invoke(app, [*given, "--coefficients", "30"])
    assert "needs --speeds" in refused.output
