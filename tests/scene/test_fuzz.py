"""Mutated scenes and tables of measurements: read, or refused in one line, and soon."""

import contextlib
import json
import random
import time
from functools import cache

import pytest
from scene.test_measurement_files import COEFFICIENTS, METADATA

from jaxcomp import BadInput
from jaxcomp.scene import SceneError, dump, load, loads, machines, start
from jaxcomp.scene._annotated import starts
from jaxcomp.scene._cells import with_tables
from jaxcomp.scene.load_tables import read_loads
from jaxcomp.scene.map_formats import energyplus_text
from jaxcomp.scene.measured import read_measurement
from jaxcomp.scene.measurements import read_measurements

RUNS = """run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg],kept
initial,bearing-1,1490,7.2,238,,,
initial,bearing-2,1490,13.5,296,,,
plane-1,bearing-1,1490,4.9,114,2.5,0,yes
plane-1,bearing-2,1490,9.2,347,2.5,0,yes
plane-2,bearing-1,1490,4.0,79,2.5,90,
plane-2,bearing-2,1490,12.0,292,2.5,90,
"""
POINTS = """# fluid = R22
# speed = 1450 rpm (as printed)
evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],capacity [W],power [W],sd(power) [%]
-15,30,18.3,0,8926,3099,1
-5,20,18.3,0,16429,2746,
4.4,30,18.3,0,21221,3326,2
"""
POLYNOMIALS = """# fluid = R22
# return_gas = 18.3 degC
# subcooling = 0.0 K
# evaporating = -17.8 to 4.4 degC
# condensing = 10.0 to 48.9 degC; as published
quantity,unit,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10
capacity,W,24800.0,920.4,-228.5,12.57,-5.991,-0.2729,0.06045,-0.06974,-0.007395,0.003095
power,W,767.6,-100.2,98.72,-2.675,3.029,-0.2676,-0.01846,0.02064,0.002852,-0.003362
"""
TRACE = """# motor.mean_speed = 900 rpm
# independent = 18
crank_angle [deg],speed [rpm],sd(speed) [%]
0,900,0.1
10,901,
20,,0.1
"""
QUANTITIES = """# mechanism.bore = 130 mm
motor.mean_speed [rpm],loss_power.wall [W],motor_power [kW],sd(motor_power) [W]
900,100,2,
1000,,2.2,20
"""
MODES = """# support = held
mode,frequency [Hz],sd(frequency) [%],3.ux,12.uy
2,100,1,0.5,-1
1,40,,1,2
"""
VIBRATION = """# order = 2
target,axis,speed [rpm],amplitude [um],phase [deg],sd(amplitude) [um]
housing,ux,1450,3.2,20,0.1
housing,uy,1450,2.2,,
"""
LOADS = "angle [deg],W_x [N],W_y [N],bush_speed [rpm]\n" + "".join(
    f"{20 * n},{1000 - 90 * abs(n - 9)},{20 * (n % 3)},{3 * n}\n" for n in range(18)
)
INDICATOR = """# reading of channel 3
angle [deg],cylinder_pressure [bar]
0,8.0
20,3.1
60,1.0
180,1.0
270,1.9
330,7.2
"""
TESPY = METADATA | {
    "largest error of eta_s_poly": 0.01,
    "eta_s_poly": [0.6, 1e-3, -1e-3, *[1e-7] * 7],
    "eta_vol_poly": [0.8, 1e-3, -2e-3, *[1e-7] * 7],
    "reference_state": {"swept_volume": 4e-4, "frequency_poly": 50.0, "T_sc": 0.0},
}
UFF = """    -1
    55
shape
NONE
NONE
NONE
NONE
         1         2         2         8         2         3
         2         4         1         1
  5.56023e+02  1.00000e+00  5.00000e-03  0.00000e+00
         1
  1.00000e+00  0.00000e+00  0.00000e+00
        12
 -4.23591e-01  0.00000e+00  0.00000e+00
    -1
    -1
  2467
         1         0         0         0         0         0         0         4
left
         8       110         0         0         8       117         0         0
    -1
    -1
    58
bar, hung free
NONE
NONE
NONE
NONE
    4         0    1         0       NONE         1   1       NONE         1   1
         6         6         1  4.00000e+02  2.00000e+00  0.00000e+00
        18    0    0    0 NONE                 NONE
        12    0    0    0 NONE                 NONE
        13    0    0    0 NONE                 NONE
         0    0    0    0 NONE                 NONE
  -4.57149868682e+00   6.32828961070e-02  -4.70435418491e+00   8.45073888577e-02
  -4.79392620859e+00   1.04693643302e-01  -5.00512093592e+00   3.29805704278e-02
  -4.86984548625e+00   4.81662967384e-02  -5.01002205237e+00   8.03297153311e-02
    -1
"""
# What people and programs put in the wrong place.
PIECES = [
    *"\"'[]{}()=,.;:#%$!^*/\\|~_-+ \t\n\r\0\x1b\ufeffµ°²€\u2028",
    *("nan", "inf", "-inf", "1e999", "-0", "1_", "0x10", "1e-320", "9" * 400, "9" * 5000, "true"),
    *("mm", "degC", "Hz", "rpm", "rad", "kg", "1/0 m", "m**m", "m^99^99", "kilo" * 50, "(" * 200),
    *("[" * 400, "]" * 400, "[[gas]]", "[gas.x]", "a." * 500 + "b = 1", "none", "[/x]", "\\u0000"),
    *("{ value = 1 }", "{ value = [], unit = 3 }", '"""', "'''", "1979-05-27", "50,5", "5 mm!", ""),
    *(
        "-273.15",
        "0",
        "-1",
        "1.2.3",
        "6,046",
        "#N/A",
        "#DIV/0!",
        "# ",
        "null",
        "NaN",
        "    -1\n",
        "%",
    ),
    *("type", "value", "unit", "source", "mechanism", "rotor", "nodes", "initial", "plane-1"),
]
# Reading takes some milliseconds, the first time with imports and compilations some seconds.
LONGEST = 5.0
# No message prints a whole table.
LONGEST_MESSAGE = 2000


def mutated(text: str, rng: random.Random) -> str:
    """A text with one to four changes: signs, words, lines or stretches."""
    for _ in range(rng.randint(1, 4)):
        lines = text.split("\n")
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        place = rng.randrange(len(text) + 1)
        match rng.randrange(9):
            case 0:
                text = text[:place] + rng.choice(PIECES) + text[place:]
            case 1:
                text = text[:place] + text[place + rng.randint(1, 12) :]
            case 2:
                lines.insert(at, lines[other])
                text = "\n".join(lines)
            case 3:
                del lines[at]
                text = "\n".join(lines)
            case 4:
                key, equals, _ = lines[at].partition("=")
                lines[at] = f"{key}{equals} {rng.choice(PIECES)}"
                text = "\n".join(lines)
            case 5:
                cells = lines[at].split(",")
                cells[rng.randrange(len(cells))] = rng.choice(PIECES)
                lines[at] = ",".join(cells)
                text = "\n".join(lines)
            case 6:
                words = text.split(" ")
                words[rng.randrange(len(words))] = rng.choice(PIECES)
                text = " ".join(words)
            case 7:
                text = text[:place]
            case 8:
                text = text.replace(rng.choice(text.split() or ["x"]), rng.choice(PIECES))
    return text


def read_scene(text: str, _) -> None:
    assert loads(dump(loads(text))) is not None


def written(text: str, folder, name: str):
    path = folder / name
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return path


def read_runs(text: str, folder) -> None:
    assert read_measurements(written(text, folder, "runs.csv")).planes


def read_load_table(text: str, folder) -> None:
    assert read_loads(written(text, folder, "loads.csv")).angle.size


def read_columns(text: str, folder) -> None:
    written(text, folder, "indicator.csv")
    tables = {"gas": {"type": "crank_angle_table", "csv": "indicator.csv"}}
    assert with_tables(tables, folder)["gas"]["type"] == "crank_angle_table"


@cache
def machine():
    return load("hermetic-68cc").machine


def read_any(name: str):
    """Read a measurement by the ending of its file, and take it apart as a fit does."""

    def read(text: str, folder) -> None:
        measurement = read_measurement(written(text, folder, name), machine())
        with contextlib.suppress(BadInput):
            assert measurement.entries({}).measured.size

    return read


def check(texts, read, count, seed, folder):
    rng = random.Random(seed)
    refused = 0
    for number in range(count):
        text = mutated(rng.choice(texts), rng)
        began = time.process_time()
        try:
            read(text, folder)
        except SceneError as error:
            refused += 1
            for one in (error, *error.others):
                assert "\n" not in str(one), (number, text)
                assert str(one).isprintable(), (number, text)
                assert len(str(one)) < LONGEST_MESSAGE, (number, text)
        except Exception as error:
            raise AssertionError(f"{number} of seed {seed}: {text!r}") from error
        assert time.process_time() - began < LONGEST, (number, text)
    # a fuzz that breaks nothing, or everything, would find nothing
    assert 0.25 * count < refused < count


def scenes():
    return [
        *(load(machine.name).text for machine in machines()),
        *(start(kind, "m") for kind in starts()),
    ]


@pytest.mark.parametrize(
    "count", [pytest.param(300, id="300"), pytest.param(10_000, id="10000", marks=pytest.mark.slow)]
)
def test_mutated_scenes_are_read_or_refused(count, tmp_path):
    check(scenes(), read_scene, count, 19, tmp_path)


def with_semicolons(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


READERS = {
    "runs": ([RUNS, with_semicolons(RUNS)], read_runs),
    "loads": ([LOADS, with_semicolons(LOADS)], read_load_table),
    "columns": ([INDICATOR, with_semicolons(INDICATOR)], read_columns),
    "map": ([POINTS, POLYNOMIALS, with_semicolons(POINTS)], read_any("map.csv")),
    "trace": ([TRACE], read_any("trace.csv")),
    "quantities": ([QUANTITIES], read_any("table.csv")),
    "modes": ([MODES], read_any("modes.csv")),
    "vibration": ([VIBRATION], read_any("vibration.csv")),
    "idf": ([energyplus_text(METADATA, COEFFICIENTS)], read_any("map.idf")),
    "json": ([json.dumps(TESPY, indent=1)], read_any("map.json")),
    "uff": ([UFF, UFF[: UFF.index("    58")] + UFF[UFF.index("    55") :]], read_any("modes.uff")),
}


@pytest.mark.parametrize(
    "count",
    [
        pytest.param(300, id="300"),
        # some minutes for each reader
        pytest.param(10_000, id="10000", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("kind", READERS)
def test_mutated_tables_are_read_or_refused(kind, count, tmp_path):
    texts, read = READERS[kind]
    if kind == "uff":
        pytest.importorskip("pyuff")
    check(texts, read, count, 20, tmp_path)


@pytest.mark.parametrize("kind", READERS)
def test_the_texts_that_are_mutated_are_read(kind, tmp_path):
    texts, read = READERS[kind]
    if kind == "uff":
        pytest.importorskip("pyuff")
    for text in texts:
        read(text, tmp_path)
