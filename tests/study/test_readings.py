"""Files of rated points: readings, and the polynomials of makers."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import without_drawing
from typer.testing import CliRunner

from jaxcomp import BadInput, load
from jaxcomp.cli._app import app
from jaxcomp.cli._identify import Polynomials, _identified
from jaxcomp.fluid import RealGas
from jaxcomp.scene import SceneError
from jaxcomp.scene.map_files import polynomial_text
from jaxcomp.scene.measured import bundled_maps
from jaxcomp.scene.readings import read_readings
from jaxcomp.study.identification._reading_model import _joined
from jaxcomp.study.identification._readings import terms_of
from jaxcomp.study.identification._result import PredictedReadings
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
        found.measured["capacity"][[first, last]], [7384.09, 16945.0], rtol=3e-6
    )
    np.testing.assert_allclose(
        found.measured["power"][[first, last]], [3336.41, 4500.15], rtol=3e-6
    )
    assert found.polynomial
    assert found.bends == ()
    assert found.fluid == "R22"
    np.testing.assert_allclose(found.gas, ZERO + 18.3)
    np.testing.assert_allclose(found.liquid, found.condensing)
    np.testing.assert_allclose(found.deviation("power", {}), 0.02 * found.measured["power"])
    found.check_points(RealGas("R22"))


def test_the_grid_of_a_polynomial_keeps_off_its_corner(tmp_path):
    found = read(tmp_path, MAP)
    assert found.evaporating.size == 18  # 5 by 4, less those within 15 K of each other
    assert (found.condensing - found.evaporating > 15).all()


def test_polynomials_are_predicted_at_every_speed(tmp_path, monkeypatch):
    """The command once took the first speed alone, without a word."""
    file = tmp_path / "points.csv"
    file.write_text(MAP)
    scene = SimpleNamespace(machine=None)
    files = Polynomials("-15,4", "40,45", "25 Hz,50 Hz").read([file], scene, None)
    turns = [np.unique(readings.speed) / (2 * np.pi) for readings in files]
    np.testing.assert_allclose(turns, [[25.0], [50.0]], rtol=1e-12)

    def predict(*measurements):
        parts = [readings.entries({}) for readings in measurements]
        return PredictedReadings(_joined(parts, np.array([0, 4])), SimpleNamespace())

    identification = SimpleNamespace(predict=predict)
    monkeypatch.setattr("jaxcomp.study.identify", lambda *_, **__: identification)
    _, predicted = _identified(scene, [], {}, {}, {}, files, None)
    assert predicted.points[:2] == ["-15/40 C, 25 1/s", "-15/45 C, 25 1/s"]
    assert predicted.points[-1] == "4/45 C, 50 1/s"


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


def test_a_polynomial_that_bends_the_wrong_way_is_told(tmp_path):
    wrong = MAP.replace("920.4,-228.5", "-920.4,228.5")
    grid = {"evaporating": [ZERO - 15, ZERO + 4], "condensing": [ZERO + 40, ZERO + 45]}
    falls, rises = read(tmp_path, wrong, **grid).bends
    assert "capacity falls with the evaporating temperature at " in falls
    assert "capacity rises with the condensing temperature at " in rises
    assert "bends the wrong way" in falls


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
    np.testing.assert_allclose(found.measured["mass_flow"], [60 / 3600, np.nan])
    np.testing.assert_allclose(found.measured["discharge_temperature"], [353.15, np.nan])
    np.testing.assert_allclose(found.deviation("power", {}), [24, 24])
    assert found.deviation("discharge_temperature", {})[0] == 2.0
    entries = found.entries({"mass_flow": 0.02})
    assert entries.quantity == ("power", "power", "mass_flow", "discharge_temperature")
    np.testing.assert_allclose(entries.sd, [24, 24, 0.02 * 60 / 3600, 2])
    np.testing.assert_array_equal(entries.point, [0, 1, 0, 0])


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
            dataclasses.replace(good, **change).check_points(RealGas("R22"))
    doubled = {
        name: np.tile(getattr(good, name), 2)
        for name in ("evaporating", "condensing", "gas", "liquid", "useful", "speed")
    }
    twice = dataclasses.replace(good, **doubled)
    with pytest.raises(BadInput, match="there once"):
        twice.check_points(RealGas("R22"))


def test_a_capacity_that_contradicts_the_flow(tmp_path):
    # 06DM313 at -5/30: 282.47 kg/h where the whole superheat counts (Helmholtz energy of R22)
    head = f"{HEAD},capacity [W],mass_flow [kg/h]"
    read(tmp_path, f"{head}\n-5,30,18.3,0,14367.3,282.47").check_points(RealGas("R22"))
    wrong = read(tmp_path, f"{head}\n-5,30,5,0,14367.3,282.47")
    with pytest.raises(BadInput, match=r"at most 3%.*subcooling .* leave 0\."):
        wrong.check_points(RealGas("R22"))


def test_readings_beyond_what_the_machine_can_do(tmp_path):
    """Point by point, before anything is fitted; a number in the wrong unit is the usual cause."""
    good, machine = read(tmp_path, MAP), load("carlyle-06dm313").machine
    good.check_limits(machine, [])
    power, capacity = good.measured["power"], good.measured["capacity"]
    weak = dataclasses.replace(good, measured={"capacity": capacity, "power": 0.4 * power})
    with pytest.raises(BadInput, match=r"power \[W\].*the power of isentropic compression of"):
        weak.check_limits(machine, [])
    big = dataclasses.replace(good, measured={"capacity": 3 * capacity})
    with pytest.raises(BadInput, match=r"capacity \[W\].*more than the piston displaces"):
        big.check_limits(machine, [])
    # unless what the pistons displace is to be found, which another bore at the same displacement is not
    for name in ("mechanism.bore", "mechanism.crank_radius", "similar_swept_volume"):
        big.check_limits(machine, [name])
    for name in ("bore_at_displacement", "stroke_bore_ratio"):
        with pytest.raises(BadInput, match="more than the piston displaces"):
            big.check_limits(machine, [name])
    # three standard deviations are granted
    far = dataclasses.replace(weak, sd={"power": power})
    far.check_limits(machine, [])


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
    np.testing.assert_allclose(found.measured["mass_flow"][there], expected[there], rtol=close)
    few = {one: maps[one] for one in speeds[:1]}
    if count > 10:
        with pytest.raises(BadInput, match="four speeds for 20 and three for 30"):
            polynomial_text(few, count, told)


TOLD = {"machine": "X", "fluid": "R22", "return_gas": "18.3 degC", "subcooling": "0 K"}
COMPRESSOR = SimpleNamespace(
    gas=SimpleNamespace(fluid=RealGas("R22")),
    swept_volume=2e-4,
    crankshaft=SimpleNamespace(count=2),
)


def test_a_map_for_energyplus_is_read_back(tmp_path):
    file, one = tmp_path / "map.idf", made_map(50.0)
    text = polynomial_text({50.0: one}, 10, TOLD, "energyplus")
    file.write_text(text)
    s, d = one.evaporating, one.condensing
    found = read_readings(file, s, d)
    for name in ("capacity", "power"):
        expected = one.values[name].ravel()
        there = np.isfinite(expected)
        np.testing.assert_allclose(found.measured[name][there], expected[there], rtol=1e-9)
    np.testing.assert_allclose(found.gas, ZERO + 18.3)
    np.testing.assert_allclose(found.liquid, found.condensing)
    assert found.fluid == "R22"
    # EnergyPlus evaluates the curve with its own order of terms
    lines = text.split("X capacity, !- Name")[1].splitlines()[1:11]
    c = [float(line.split(",")[0]) for line in lines]
    x, y = -20.0, 30.0
    bicubic = np.array([1, x, x**2, y, y**2, x * y, x**3, y**3, x**2 * y, x * y**2]) @ c
    assert bicubic == pytest.approx(one.values["capacity"][0, 0], rel=1e-9)
    # a curve that stands twice: the last before the compressor counts; and two compressors need a name
    twice = text.replace("X capacity, !- Name\n  ", "X capacity, !- Name\n  1", 1) + text
    file.write_text(twice)
    with pytest.raises(SceneError, match="2 compressors; name one"):
        read_readings(file)
    with pytest.raises(SceneError, match="is no compressor of the file, but X"):
        read_readings(f"{file}#Y")
    file.write_text(text.replace("X power, !- Name", "Y power, !- Name"))
    with pytest.raises(
        SceneError, match='"X power": must be the name of a Curve:Bicubic before the compressor X'
    ):
        read_readings(file)


def test_a_map_for_tespy_is_read_back(tmp_path):
    file, one = tmp_path / "map.json", made_map(50.0)
    file.write_text(polynomial_text({50.0: one}, 10, TOLD, "tespy", COMPRESSOR))
    given = json.loads(file.read_text())
    assert given["reference_state"] == {
        "swept_volume": 4e-4, "frequency_poly": 50.0, "T_sc": 0.0
    }  # fmt: skip
    found = read_readings(file, one.evaporating, one.condensing)
    error = max(given[f"largest error of {key}"] for key in ("eta_s_poly", "eta_vol_poly"))
    for name in ("mass_flow", "power"):
        expected = one.values[name].ravel()
        there = np.isfinite(expected)
        # to what cubics of the efficiencies leave, which the file tells; twice, as power has both
        assert 0 < error < 0.03
        np.testing.assert_allclose(found.measured[name][there], expected[there], rtol=2 * error)
    with pytest.raises(BadInput, match="csv for 20 and 30"):
        polynomial_text({30.0: one, 50.0: one}, 20, TOLD, "tespy", COMPRESSOR)
    file.write_text("{}")
    with pytest.raises(SceneError, match=r"fluid.*is missing"):
        read_readings(file)


@pytest.mark.parametrize(
    ("name", "gas", "cold"),
    [("ASHRAE", 32.2, None), ("ARI", 18.3, 0.0), ("cecomaf", 32.0, 0.0), ("en12900", 20.0, 0.0)],
)
def test_a_rating_by_its_name(tmp_path, name, gas, cold):
    head = "evaporating [degC],condensing [degC],power [W]\n-5,40,3000"
    found = read(tmp_path, f"# rating = {name}\n{head}")
    np.testing.assert_allclose(found.gas, ZERO + gas)
    np.testing.assert_allclose(found.liquid, ZERO + (32.2 if cold is None else 40 - cold))
    with pytest.raises(SceneError, match=r"return_gas: is given beside rating"):
        read(tmp_path, f"# rating = {name}\n# return_gas = 20 degC\n{head}")
    with pytest.raises(SceneError, match=r"rating.*did you mean.*ashrae"):
        read(tmp_path, f"# rating = ashrea\n{head}")


def test_curves_that_bend_the_wrong_way_are_told(tmp_path):
    assert read(tmp_path, MAP).bends == ()
    found = read(tmp_path, MAP.replace("-228.5", "228.5"))
    assert any("capacity rises with the condensing temperature at" in text for text in found.bends)
    assert found.warnings([0], [])[0] == found.bends[0]


def test_points_and_speeds_outside_of_those_used_are_told(tmp_path):
    cold, warm = (
        read(tmp_path, MAP, evaporating=[t], condensing=[303.0, 313.0]) for t in (258.0, 268.0)
    )
    fast = dataclasses.replace(warm, speed=np.full(2, 300.0))
    # both at 268 K lie in the hull of three used points, but not at another speed
    assert warm.warnings([0], [(cold, [0, 1])]) == [
        "predicted outside of the points used: -5.15/39.85 C"
    ]
    assert warm.warnings([], [(warm, [0, 1]), (cold, [0, 1])]) == []
    assert fast.warnings([], [(warm, [0, 1]), (cold, [0, 1])]) == [
        "predicted at speeds that were not used: one speed cannot tell the law of speed"
    ]


@pytest.mark.parametrize(
    ("name", "at", "values"),
    [
        ("06dm313_r22", (-15, 40), {"capacity": 7384.09, "power": 3336.41}),
        ("06dr316_r22", (-35, 30), {"capacity": 4276.92, "power": 2590.21}),
        ("06dr316_r134a", (4, 45), {"capacity": 14371.6, "power": 4028.46}),
        ("3db3-1000_r22_60hz", (-5, 30), {"capacity": 33808.0, "power": 7653.15}),
        ("crk3-0325_r22", (4, 45), {"capacity": 11681.3, "power": 3554.82}),
        ("vtz038-g_r134a", (0, 45), {"capacity": 2581.83, "power": 1121.19, "mass_flow": 61.7949 / 3600}),
    ],
)  # fmt: skip
def test_bundled_maps(name, at, values):
    speed = 2 * np.pi * 50 if name.startswith("vtz") else None
    s, d = (np.array([ZERO + x]) for x in at)
    found = read_readings(bundled_maps()[name], s, d, speed)
    for quantity, value in values.items():
        assert found.measured[quantity][0] == pytest.approx(value, rel=1e-5)  # six digits printed
    found.check_points(RealGas(found.fluid))
    text = bundled_maps()[name].read_text()
    assert "# source = public repository" in text
    assert "# licence = see LICENCES.md" in text


def test_the_command_map_writes_coefficients(tmp_path, monkeypatch):
    without_drawing(monkeypatch)

    def made_up(scene, evaporating, condensing, standard, options, solver, reference):
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
    np.testing.assert_allclose(found.measured["power"], 45 * 75, rtol=1e-9)  # rounding of the fit
    np.testing.assert_allclose([found.gas, found.liquid], ZERO + 32.2)
    assert found.fluid == "R134a"
    refused = CliRunner().invoke(app, [*given, "--coefficients", "30"])
    assert "needs --speeds" in refused.output


def test_a_map_by_mean_temperatures_says_so(tmp_path, monkeypatch):
    without_drawing(monkeypatch)

    def made_up(scene, evaporating, condensing, standard, options, solver, reference):
        x, y = evaporating[:, None] - ZERO, condensing - ZERO
        values = {name: 100 + x + 0 * y for name, *_ in QUANTITIES}
        ok = np.ones((x.size, y.size), bool)
        zeros = {"power": np.zeros(10)}
        return RatingMap(
            evaporating, condensing, values, ok, zeros, {"power": 0.0}, standard, reference
        )

    monkeypatch.setattr("jaxcomp.study.rating.rating_map", made_up)
    words = "map r134a-7cc --set gas.fluid.name=R448A --set gas.discharge.liquid_temperature=25degC"
    rating = ["--reference", "mean", "--rating", "en12900-superheat"]
    given = [*words.split(), *rating, "--evaporating=-30:-10:4", "--condensing=35:55:4"]
    result = CliRunner().invoke(app, [*given, "--out", str(tmp_path)], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    # of the glide of 6.1 K at 0 degC
    assert "Temperatures are mean temperatures; glide of R448A: 6.4 K at -30 °C" in result.output
    found = read_readings(tmp_path / "coefficients.csv", [ZERO - 25], [ZERO + 40])
    assert found.reference == "mean"
    assert found.by_superheat
    refused = CliRunner().invoke(app, [*given, "--format", "tespy"])
    assert "takes dew temperatures" in " ".join(refused.output.split())
