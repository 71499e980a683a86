"""One reader for all files of measurements: settings, separators, decimals, heads and lines."""

import codecs
import json
import os
import threading

import numpy as np
import pytest

from jaxcomp import BadInput, load
from jaxcomp.scene import SceneError
from jaxcomp.scene.load_tables import read_loads
from jaxcomp.scene.map_formats import energyplus_text
from jaxcomp.scene.measured import read_measurement
from jaxcomp.scene.measurements import read_measurements
from jaxcomp.study import Trace, VibrationTest

HEAD = (
    "evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],capacity [W],power [W]\n"
)
POINT = "-15,30,18.3,0,8926,3099\n"
MAP = HEAD + POINT
TRACE = "crank_angle [deg],pressure [bar]\n0,8\n90,2\n180,1\n270,3\n"
TABLE = "motor.mean_speed [rpm],motor_power [kW]\n1400,2\n"
RUNS = (
    "run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg]\n"
    "initial,bearing-1,1490,7.2,238,,\nplane-1,bearing-1,1490,4.9,114,2.5,0\n"
)
LOADS = "angle [deg],W_x [N],W_y [N]\n" + "".join(
    f"{20 * n},{1000 - 90 * abs(n - 9)},{20 * (n % 3)}\n" for n in range(18)
)
VIBRATION = "target,axis,speed [rpm],amplitude [um]\nhousing,ux,1450,3\n"
COEFFICIENTS = {
    "capacity": [
        24800.0,
        920.4,
        -228.5,
        12.57,
        -5.991,
        -0.2729,
        0.06045,
        -0.06974,
        -0.0074,
        0.0031,
    ],
    "power": [767.6, -100.2, 98.72, -2.675, 3.029, -0.2676, -0.01846, 0.02064, 0.00285, -0.00336],
}
METADATA = {
    "machine": "X", "fluid": "R22", "return_gas": "18.3 degC", "subcooling": "0 K",
    "evaporating": "-17.8 to 4.4 degC", "condensing": "10 to 48.9 degC",
}  # fmt: skip
IDF = energyplus_text(METADATA, COEFFICIENTS)
TESPY = METADATA | {
    "eta_s_poly": [0.6, 1e-3, -1e-3, *[1e-7] * 7],
    "eta_vol_poly": [0.8, 1e-3, -2e-3, *[1e-7] * 7],
    "reference_state": {"swept_volume": 4e-4, "frequency_poly": 50.0},
}


@pytest.fixture(scope="module")
def machine():
    """A machine of R22 with one cylinder and valves."""
    return load("semi-hermetic-200cc").machine


@pytest.fixture
def read(tmp_path, machine):
    def read(content, name="points.csv"):
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        if name == "runs.csv":
            return read_measurements(file)
        return read_loads(file) if name == "loads.csv" else read_measurement(file, machine)

    return read


# ------------------------------------------------------------------ settings
@pytest.mark.parametrize(
    "line", ["# Speed = 900 rpm", "#speed=900rpm", "# SPEED : 900 rpm (about)"]
)
def test_a_setting_is_known_without_regard_to_case_and_blanks(read, line):
    np.testing.assert_allclose(read(f"{line}\n{MAP}").speed, 30 * np.pi)


def test_blanks_stand_for_underscores(read):
    points = read(f"# Useful Superheat = 5 K\n{MAP}")
    np.testing.assert_allclose(points.useful, points.evaporating + 5)
    trace = read(f"# Motor.Mean-Speed = 900 rpm\n# Independent = 18\n{TRACE}")
    assert trace.paths == ("motor.mean_speed",)
    assert trace.independent == 18
    heads = "Evaporating [degC],condensing (degC),Return Gas [degC],Sub-cooling [K],Power {W}\n"
    np.testing.assert_allclose(read(f"{heads}-15,30,18.3,0,3099").measured["power"], 3099)


KINDS = {
    "points.csv": MAP,
    "trace.csv": TRACE,
    "table.csv": TABLE,
    "runs.csv": RUNS,
    "loads.csv": LOADS,
    "vibration.csv": VIBRATION,
    "modes.csv": "frequency [Hz]\n100\n",
}


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_file_takes_remarks_and_words_and_refuses_the_rest(read, name):
    words = "# taken by night\n# Source = bench 3\n# note = second of two, warm\n"
    assert read(words + KINDS[name], name) is not None
    with pytest.raises(SceneError, match=r"operater: is an unknown setting.*operator"):
        read(f"# operater = me\n{KINDS[name]}", name)
    with pytest.raises(SceneError, match=r"source: is given twice, in lines 1 and 3; keep one"):
        read(f"# source = a\n\n# Source = b\n{KINDS[name]}", name)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("# sped = 900 rpm", 'sped: is an unknown setting; did you mean "speed"'),
        ("# motor.mean_speed = 900 rpm", 'unknown setting; did you mean "speed"'),
        ("# refrigerant = R22", 'unknown setting; did you mean "fluid"'),
        ("# ratings = ashrae", 'unknown setting; did you mean "rating"'),
        ("# order = 2", "unknown setting"),
        ("# speed = about 900 rpm", 'must be a number with its unit, as in "speed = 1450 rpm"'),
        ("# speed = 900 rpm or so", "unknown unit"),
        ("# speed = 1.2.3 rpm", 'speed = "1.2.3 rpm": must be a number with its unit'),
        ("# speed = 900", "needs its unit"),
        ("# speed = 18,3 rpm", "decimal comma"),
        ("# speed =", "lacks its value"),
        ("# speed 900 rpm", 'lacks its "="; write "# speed = 900 rpm"'),
        ("# speed = 900 to 1000 rpm", "one value, and no range"),
        ("# rating = ashrae", "given in a column and in the metadata"),
        ("# return_gas = 20 degC", "given in a column and in the metadata"),
    ],
)
def test_settings_of_a_map_that_mean_nothing_are_refused(read, line, message):
    with pytest.raises(SceneError, match=message):
        read(f"{line}\n{MAP}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"# speed = 900 rpm\n{TRACE}", 'did you mean "motor.mean_speed"'),
        (f"# independent = 0\n{TRACE}", "must be a whole number from 1"),
        (f"# independent = many\n{TRACE}", "must be a whole number from 1"),
        (f"# fluid = R134a\n{TRACE}", "fluid.*must be R22 as the machine's"),
        (f"# fluid = R134a\n{TABLE}", "fluid.*must be R22 as the machine's"),
        (f"# motor.mean_speed = 1500 rpm\n{TABLE}", "given in a column and above the table"),
        (f"# order = x\n{VIBRATION}", "must be a whole number from 1"),
        ("# support = hung\nfrequency [Hz]\n100", 'must be "free" or "held"'),
    ],
)
def test_settings_of_other_kinds_that_mean_nothing_are_refused(read, text, message):
    with pytest.raises(SceneError, match=message):
        read(text)


def test_another_fluid_than_the_machines_is_refused(read, machine):
    read(f"# Fluid = R-22\n{MAP}").check(machine)
    with pytest.raises(BadInput, match="must be R22 as the machine"):
        read(f"# Fluid = R134a\n{MAP}").check(machine)


# ------------------------------------------------------------------ text
SEMICOLONS = MAP.replace(",", ";")


@pytest.mark.parametrize(
    "content",
    [
        codecs.BOM_UTF8 + MAP.encode(),
        MAP.encode("utf-16"),
        codecs.BOM_UTF16_BE + MAP.encode("utf-16-be"),
        MAP.replace("\n", "\r\n"),
        SEMICOLONS,
        SEMICOLONS.replace(".", ","),
        "# taken by night, in March\n" + SEMICOLONS,
        "sep=;\n" + SEMICOLONS,
        MAP.replace(",", "\t"),
        MAP.replace(",", "\t").replace(".", ","),
        MAP.replace("\n", ",,,\n") + ",,,,,,,,\n",
        '"# source = bench",,,,,\n' + MAP,
        MAP.replace("[degC]", "(°C)"),
        "evaporating,condensing,return_gas,subcooling,capacity,power\ndegC,degC,degC,K,W,W\n" + POINT,
        "evaporating,condensing,return_gas,subcooling,capacity,power\n"
        "[degC],[degC],[degC],[K],[W],[W]\n" + POINT,
    ],
    ids=range(15),
)  # fmt: skip
def test_a_table_as_programs_write_it(read, content):
    points = read(content)
    np.testing.assert_allclose(points.gas, 273.15 + 18.3)
    np.testing.assert_allclose(points.measured["capacity"], 8926)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (MAP.replace("[degC]", "[°C]").encode("cp1252"), "is no text in UTF-8; save the table as"),
        (MAP.encode("utf-16")[2:], "holds zero bytes; save the table as"),
        (SEMICOLONS.replace("8926", "8,926"), '"8,926".*decimal comma.*"18.3" in line 2'),
        (SEMICOLONS + "-15;31;18,3;0;8926;3099", 'line 3 = "18,3".*"18.3" in line 2'),
        (SEMICOLONS.replace("18.3", "18,3").replace("8926", "8.926,5"), 'capacity = "8.926,5"'),
        (MAP.replace("8926", '"8,926"'), "a comma may part thousands or decimals"),
        (HEAD + "\n# a remark\n\n" + POINT.replace("8926", "x"), "line 5.capacity"),
        (MAP + "#N/A,31,18.3,0,8926,3099\n", 'line 3.evaporating = "#N/A"'),
        (MAP + "#DIV/0!,31,18.3,0,8926,3099\n", 'line 3.evaporating = "#DIV/0!"'),
        (MAP.replace("18.3", ""), "return_gas: must be given at every point"),
        ("te,tc,Q,P\n-5,30,1,2\n", r"te, tc, Q, P.*a map: .evaporating \[degC\]"),
        ("crank_angle [deg],pressure [bar]\n0,8,7\n", "line 2 = 3: must have 2 cells"),
        ("mode,frequency [Hz]\n,3", "line 2.mode"),
        ("mode,frequency [Hz]\n1.5,3", "line 2.mode = 1.5: must be a whole number"),
        (VIBRATION.replace("housing", ""), "line 2.target: is empty; write the target"),
        (VIBRATION.replace("[um]", "[um],order").replace(",3\n", ",3,2\n"), '"# order = 2" above'),
        (VIBRATION.replace("ux", ""), "line 2.axis: is empty"),
        (VIBRATION.replace("1450", "-1450"), "line 2.speed = -.*above 0"),
        (HEAD.replace("power", "power [W],sd(power)") + "-15,30,18.3,0,8926,3099,0", "above 0"),
    ],
)
def test_what_could_be_misread_is_refused(read, content, message):
    with pytest.raises(SceneError, match=message):
        read(content)


def test_a_velocity_has_its_deviation(read):
    """1 mm/s at 1450 rpm and order 2, divided by the circular frequency."""
    head = "target,axis,speed [rpm],amplitude [mm/s],sd(amplitude) [mm/s]"
    test = read(f"# order = 2\n{head}\nhousing,ux,1450,3,1\n")
    assert isinstance(test, VibrationTest)
    frequency = 2 * 1450 * np.pi / 30
    np.testing.assert_allclose(test.amplitude, 3e-3 / frequency, rtol=1e-15)
    np.testing.assert_allclose(test.sd, 1e-3 / frequency, rtol=1e-15)


def test_runs_without_the_first_one_are_told_which_it_is(read):
    with pytest.raises(SceneError, match=r'line 2.trial.*write "initial" for "baseline"'):
        read(RUNS.replace("initial", "baseline"), "runs.csv")
    with pytest.raises(SceneError, match=r'no line "initial".*without any trial weight.*plane-1'):
        read(RUNS.replace("initial,bearing-1,1490,7.2,238,,\n", ""), "runs.csv")
    assert read(RUNS.replace("initial", "Initial"), "runs.csv").planes == ("plane-1",)


# ------------------------------------------------------------------ readings
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("8926", "-8926", "capacity.*above 0"),
        ("3099", "0", "power.*above 0"),
        ("18.3,0", "18.3,500", r"liquid \[C\].*at least"),
        ("18.3,0", "5000,0", r"gas \[C\].*at most 185 C"),
        ("power [W]", "speed [rpm]", r"speed.*above 0"),
    ],
)
def test_points_that_no_compressor_has_are_refused(read, machine, old, new, message):
    text = MAP.replace("3099", "-900") if "speed" in new else MAP
    with pytest.raises(BadInput, match=message):
        read(text.replace(old, new)).check(machine)


POLYNOMIAL = (
    "# fluid = R22\n# superheat = 5 K\n# liquid = 20 degC\n# evaporating = -15 to 5 degC\n"
    "# condensing = 30 to 45 degC\nquantity,unit,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10\n"
    "power,W," + ",".join(map(repr, COEFFICIENTS["power"])) + "\n"
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("-15 to 5", "5 to -15", "must be a range that rises"),
        ("-15 to 5", "30 to 31", "leave no point 15 K apart"),
        ("30 to 45", "30 to 4500", "must lie within"),
        ("W,767.6", ",767.6", "line 7.unit: must be a unit"),
        ("power,W," + ",".join(map(repr, COEFFICIENTS["power"])) + "\n", "", "has no line"),
        (",C10", "", "must have 10, 20 or 30 coefficients|must have 11 cells"),
        ("C2,C3", "C3,C2", "C3: stands where C2 must: coefficients are read in their order"),
        ("C2,C3", "C2,S D", "S D: must be a coefficient with its number"),
        ("-15 to 5 degC", "-15..5 degC", 'no range in the metadata, as "# evaporating = -15 to 10'),
    ],
)
def test_polynomials_that_have_no_points_are_refused(read, old, new, message):
    assert read(POLYNOMIAL).evaporating.size
    with pytest.raises(SceneError, match=message):
        read(POLYNOMIAL.replace(old, new))


def test_an_empty_cell_of_a_trace_leaves_the_other_deviations(read):
    """1 % of the range of the samples that are there, 72 of which would count as independent."""
    trace = read(TRACE.replace("90,2", "90,"))
    entries = trace.entries({})
    assert entries.measured.size == 3
    np.testing.assert_allclose(entries.sd, 0.01 * 7e5)


def test_a_constant_column_has_a_deviation(read):
    entries = read("crank_angle [deg],pressure [bar]\n0,2\n90,2\n").entries({})
    np.testing.assert_allclose(entries.sd, 0.01 * 2e5)
    flat = "crank_angle [deg],pressure [bar]\n0,0\n90,0\n"
    with pytest.raises(BadInput, match=r"sd\(pressure\)"):
        read(flat).entries({})
    given = flat.replace("[bar]\n", "[bar],sd(pressure) [bar]\n").replace(",0\n", ",0,0.1\n")
    np.testing.assert_allclose(read(given).entries({}).sd, 1e4)


def test_a_speed_over_the_revolution_is_above_zero(machine):
    trace = Trace("made", ("speed",), np.array([0.0, 1.0]), np.array([[90.0, -90.0]]))
    with pytest.raises(BadInput, match=r"speed.*above 0"):
        trace.check(machine)


# ------------------------------------------------------------------ other programs
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: "", "has no Refrigeration:Compressor"),
        (lambda text: "Refrigeration:Compressor;", "has no Refrigeration:Compressor"),
        (lambda text: text.replace("24800.0,", ""), "ten coefficients and four ends.*13 numbers"),
        (lambda text: text.replace("24800.0", "x"), "must be a number"),
        (
            lambda text: text.replace("Curve:Bicubic,", "Curve:Bicubic;"),
            "must be the name of a Curve",
        ),
    ],
)
def test_objects_of_energyplus_that_are_cut_are_refused(read, change, message):
    assert read(IDF, "map.idf").polynomial
    with pytest.raises(SceneError, match=message):
        read(change(IDF), "map.idf")


def test_a_compressor_of_a_file_is_named_behind_a_sign(tmp_path, machine):
    (tmp_path / "map.idf").write_text(IDF)
    assert read_measurement(f"{tmp_path}/map.idf#x", machine).polynomial
    with pytest.raises(SceneError, match="is no compressor of the file, but X"):
        read_measurement(f"{tmp_path}/map.idf#y", machine)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("3", "must be one JSON object"),
        ("null", "must be one JSON object"),
        ("[" * 100_000, "is no JSON"),
        (TESPY | {"eta_s_poly": 3}, "eta_s_poly = 3: must be a list of ten numbers"),
        (TESPY | {"eta_s_poly": [1.0] * 9}, "must be a list of ten numbers"),
        (
            TESPY | {"eta_s_poly": [0] * 10},
            "eta_s_poly.*must give an efficiency above 0 at all points",
        ),
        (TESPY | {"eta_vol_poly": [None] * 10}, "eta_vol_poly.0: must be a number"),
        (TESPY | {"eta_vol_poly": [10**400] * 10}, "must be a number below"),
        (TESPY | {"fluid": 22}, "fluid = 22: must be a text"),
        (TESPY | {"fluid": "R2222"}, "fluid"),
        (TESPY | {"superheat": 10}, "superheat = 10: must be a text"),
        (TESPY | {"speeed": "1 rpm"}, 'unknown entry; did you mean "speed"'),
        (TESPY | {"return_gas": "warm"}, "return_gas.*must be a number with its unit"),
        (TESPY | {"reference_state": []}, "reference_state.*must be an object"),
        (TESPY | {"reference_state": {"frequency_poly": 50}}, "swept_volume: must be a number"),
        (TESPY | {"reference_state": {"swept": 3}}, "unknown entry.*swept_volume"),
    ],
)
def test_json_of_another_kind_is_refused(read, content, message):
    text = content if isinstance(content, str) else json.dumps(content)
    with pytest.raises(SceneError, match=message):
        read(text, "map.json")


@pytest.mark.parametrize("name", ["map.idf", "map.json", "modes.uff", "points.csv"])
def test_a_pipe_is_refused(tmp_path, machine, name):
    if name == "modes.uff":
        pytest.importorskip("pyuff")
    os.mkfifo(tmp_path / name)
    complaints = []

    def read():
        try:
            read_measurement(tmp_path / name, machine)
        except SceneError as error:
            complaints.append(str(error))

    # a thread of its own, so that a reader that waits for the pipe ends the test and not the suite
    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    thread.join(60)
    assert complaints
    assert "pipe or a device" in complaints[0]
