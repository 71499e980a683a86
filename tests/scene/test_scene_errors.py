"""Every bad scene is refused in one line with file, key, value and bound."""

import pytest

from jaxcomp.film import iso_vg_viscosity
from jaxcomp.scene import SceneError, load, loads, with_value, with_values
from jaxcomp.scene._units import to_si
from jaxcomp.scene.tolerances import read_tolerance

GOOD = """
name = "m"
[mechanism]
type = "slider_crank"
bore = "50 mm"
crank_radius = "20 mm"
conrod_length = "100 mm"
piston_mass = "0.3 kg"
conrod_mass = "0.2 kg"
[crankshaft]
inertia = "0.01 kg m^2"
[motor]
type = "mean_speed"
mean_speed = "1500 rpm"
[gas]
type = "polytropic"
suction_pressure = "1 bar"
discharge_pressure = "5 bar"
exponent = 1.1
"""


def replaced(old, new):
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)


BAD = {
    "no unit": (
        replaced('"50 mm"', "50"),
        "mechanism.bore = 50: lacks its unit; it must be a text with a unit of the kind [m], such "
        'as "130 mm"',
    ),
    "wrong dimension": (
        replaced('"50 mm"', '"50 kg"'),
        'mechanism.bore = "50 kg": has a unit of another dimension, "kg"',
    ),
    "unknown unit": (
        replaced('"50 mm"', '"50 mmm"'),
        'mechanism.bore = "50 mmm": has the unknown unit "mmm"',
    ),
    "offset unit": (replaced('"50 mm"', '"50 degC"'), 'has the unknown unit "degC"'),
    "no number": (replaced('"50 mm"', '"wide"'), 'mechanism.bore = "wide": is no number'),
    "two points": (replaced('"50 mm"', '"1.2.3 mm"'), 'bore = "1.2.3 mm": is no number'),
    "sum of numbers": (replaced('"50 mm"', '"50 mm + 1"'), "unknown unit"),
    "not finite text": (
        replaced('"50 mm"', '"nan mm"'),
        'mechanism.bore = "nan mm": must be finite',
    ),
    "not finite number": (replaced("= 1.1", "= inf"), "gas.exponent = inf: must be finite"),
    "too large": (replaced('"50 mm"', '"1e999 m"'), "must be finite"),
    "truth value": (replaced("= 1.1", "= true"), "gas.exponent = True: must be a pure number"),
    "unit on pure number": (
        replaced("= 1.1", '= "1.1 m"'),
        'gas.exponent = "1.1 m": has a unit of another dimension, "m"; it must be a pure number',
    ),
    "angle as pure number": (replaced("= 1.1", '= "1.1 rad"'), "another dimension"),
    "hertz as speed": (
        replaced('"1500 rpm"', '"25 Hz"'),
        'motor.mean_speed = "25 Hz": is a frequency, where a speed of rotation is needed; write '
        '"1500 rpm"',
    ),
    "list for one value": (
        replaced('"50 mm"', '["50 mm", "60 mm"]'),
        "mechanism.bore = ['50 mm', '60 mm']: must be a single value, as there is one cylinder",
    ),
    "unknown key": (
        replaced("bore", "bor"),
        'mechanism.bor = "50 mm": is an unknown key; did you mean "bore"?',
    ),
    "unknown section": (
        GOOD + "[frictoin]\n",
        'frictoin: is an unknown section; did you mean "fri',
    ),
    "unknown key at the top": ("colour = 1\n" + GOOD, "colour: is an unknown key; known here: "),
    "missing key": (
        replaced('bore = "50 mm"', ""),
        "mechanism.bore: is missing; it must be a number > 0 [m], piston diameter",
    ),
    "missing part": (
        GOOD.split("[motor]")[0],
        "motor: is missing; it must be a section of type constant_speed or constant_torque or kloss",
    ),
    "missing type": (
        replaced('type = "mean_speed"', ""),
        "motor.type: is missing; it must be one of: constant_speed, constant_torque, kloss, "
        "mean_speed, slip_line",
    ),
    "unknown type": (
        replaced('"polytropic"', '"polytrope"'),
        'gas.type = "polytrope": must be one of: crank_angle_table, cylinder, double_acting, each, '
        'fourier, polytropic, staged, volume_table; did you mean "polytropic"?',
    ),
    "unknown option": (
        GOOD.replace("[gas]", 'shape = "linear"\n[gas]'),
        'motor.shape = "linear": must be one of "constant", "proportional"',
    ),
    "out of bounds": (
        replaced('"0.3 kg"', '"-0.3 kg"'),
        'mechanism.piston_mass = "-0.3 kg": must be >= 0 kg',
    ),
    "zero speed": (
        replaced('"1500 rpm"', '"0 rpm"'),
        'motor.mean_speed = "0 rpm": must be > 0 rad/',
    ),
    "out of an interval": (replaced("= 1.1", "= 0.9"), "gas.exponent = 0.9: must be >= 1 and <= 3"),
    "unreachable crank": (
        replaced('"20 mm"', '"100 mm"'),
        "mechanism: must be a machine with crank_radius + |offset| < conrod_length, but has "
        "crank_radius = 100 mm, conrod_length = 100 mm",
    ),
    "pressures": (
        replaced('"5 bar"', '"0.5 bar"'),
        "gas: must be a cycle with discharge_pressure > suction_pressure, but has suction_pressure "
        "= 1 bar, discharge_pressure = 0.5 bar",
    ),
    "value for a section": (
        "motor = 3\n" + GOOD.split("[motor]")[0],
        "motor = 3: must be a section",
    ),
    "value without value": (
        replaced('"50 mm"', '{ source = "x" }'),
        "mechanism.bore: lacks its `value`",
    ),
    "unknown key of a value": (
        replaced('"50 mm"', '{ value = "50 mm", sorce = "x" }'),
        'mechanism.bore.sorce: is an unknown key of a value; did you mean "source"?',
    ),
    "source is no text": (
        replaced('"50 mm"', '{ value = "50 mm", source = 3 }'),
        "mechanism.bore.source = 3: must be a text",
    ),
    "name is no text": (replaced('name = "m"', "name = 3"), "name = 3: must be a text"),
    "no TOML": (replaced('"50 mm"', "= 50"), "is not valid TOML: "),
    "no quotes": (
        replaced('"50 mm"', "50 mm"),
        'mechanism.bore = 50 mm: lacks its quotes; write bore = "50 mm"',
    ),
    "a word without quotes": (
        replaced('"polytropic"', "polytropic # a comment"),
        'gas.type = polytropic: lacks its quotes; write type = "polytropic"',
    ),
    "decimal comma": (
        replaced("= 1.1", "= 1,1"),
        "gas.exponent = 1,1: has a decimal comma; write exponent = 1.1",
    ),
    "decimal comma and unit": (
        replaced('"50 mm"', "50,5 mm"),
        'mechanism.bore = 50,5 mm: has a decimal comma; write bore = "50.5 mm"',
    ),
    "decimal comma in quotes": (
        replaced('"50 mm"', '"50,5 mm"'),
        'mechanism.bore = "50,5 mm": has a decimal comma; write "50.5 mm"',
    ),
    "section twice": (
        replaced("[gas]", "[motor]"),
        "motor: is given twice, in lines 12 and 15; keep one of them",
    ),
    "key twice": (
        replaced("[crankshaft]", 'bore = "60 mm"\n[crankshaft]'),
        "mechanism.bore: is given twice, in lines 5 and 10; keep one of them",
    ),
    "pressure over that of the surroundings": (
        replaced('"1 bar"', '"1 barg"'),
        'gas.suction_pressure = "1 barg": is a pressure over that of the surroundings, where an '
        'absolute one is needed; at sea level that is "2.01325 bar"',
    ),
    "temperature as pressure": (
        replaced('"1 bar"', '"-23.3 degC"'),
        'gas.suction_pressure = "-23.3 degC": is a temperature, where a pressure is needed; write',
    ),
    "power of a power": (replaced('"50 mm"', '"1 m*10**10**9"'), 'the unknown unit "m*10**10**9"'),
    "power in brackets": (replaced('"50 mm"', '"1 m**(2**(2**30))"'), "has the unknown unit"),
    "power of a power of a unit": (replaced('"50 mm"', '"1 ((km^99)^99)^99"'), "has the unknown"),
    "long unit": (replaced('"50 mm"', f'"1 {"kilo" * 10000}"'), 'mechanism.bore = "1 kilokilo'),
    "rather long unit": (replaced('"50 mm"', f'"1 {"kilo" * 30}"'), "has the unknown unit"),
    "underscore behind a number": (replaced('"50 mm"', '"1_ mm"'), "has the unknown unit"),
    "digits without end": (replaced("= 1.1", f"= {'9' * 400}"), "gas.exponent = a whole number"),
    "more digits without end": (replaced("= 1.1", f"= {'9' * 5000}"), "has too many digits"),
    "sign behind a unit": (replaced('"50 mm"', '"50 mm!"'), 'has the unknown unit "mm!"'),
    "sign before a unit": (replaced('"50 mm"', '"50 $mm"'), 'has the unknown unit "$mm"'),
    "quote in a unit": (replaced('"50 mm"', '"50 \'mm"'), 'has the unknown unit "\'mm"'),
    "comment in a unit": (replaced('"50 mm"', '"50 mm#x"'), 'has the unknown unit "mm#x"'),
    "number behind a unit": (replaced('"50 mm"', '"50 mm 1"'), 'has the unknown unit "mm 1"'),
    "deep list": (replaced("= 1.1", "= " + "[" * 900 + "]" * 900), "is nested more than 20 deep"),
    "deep tables": (GOOD + f"[{'a.' * 3000}a]\n", "is nested more than 20 deep"),
    "escape sequence": (
        replaced('name = "m"', 'name = "\\u001b[2J"'),
        'name = "\\x1b[2J": must be a text without control characters',
    ),
    "overlong name": (replaced('name = "m"', f'name = "{"m" * 1001}"'), "name = "),
    "overlong file": ("#" * 4_000_001, "is larger than 4 MB"),
    "nothing": ("", "is empty; `jaxcomp new FILE` writes"),
    "rule in the code of a part": (
        GOOD
        + '[friction]\ntype = "slider_crank"\n'
        + '[friction.piston_film]\ndynamic_viscosity = "4 mPa s"\nradial_clearance = "6 um"\n',
        "friction: `piston_film.length` is needed",
    ),
    "friction of another mechanism": (
        GOOD + '[friction]\ntype = "slider_link"\n',
        "`friction` must be of the kind of the mechanism, slider_crank",
    ),
    "lists of different length": (
        GOOD.split("[gas]")[0]
        + '[gas]\ntype = "fourier"\nmean = "1 Pa"\ncosine = ["1 Pa"]\nsine = []\n'
        + 'back_pressure = "1 Pa"',
        "gas: `cosine` and `sine` must have the same length",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scene_is_refused(case):
    text, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        loads(text, "bad.toml")
    assert str(caught.value).startswith(f"bad.toml: {message}") or message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.file == "bad.toml"


def test_a_good_scene_passes():
    assert loads(GOOD).compressor is not None


def test_a_vector_needs_all_its_entries():
    with pytest.raises(SceneError, match=r"gravity = .*: must be a list of 2 values"):
        loads('gravity = ["1 m/s^2"]\n' + GOOD)


def test_names_and_files_that_cannot_be_read(tmp_path):
    with pytest.raises(SceneError, match=r'no machine .* "mayekawa"; did you mean "mayekawa-wbhe"'):
        load("mayekawa")
    with pytest.raises(SceneError, match=r"none.toml: cannot be read: No such file"):
        load(tmp_path / "none.toml")
    with pytest.raises(SceneError, match=r"is a folder; name a file"):
        load(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(SceneError, match=r"bytes.toml: is no text in UTF-8"):
        load(tmp_path / "bytes.toml")


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path):
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load(tmp_path / "marked.toml").name == "m"


@pytest.mark.parametrize("junk", ["k{} = 1\n", "[s{}]\n", "[mechanism.s{}]\n"])
def test_a_file_of_junk_is_answered_soon(junk, monkeypatch):
    """Every key is told; the nearest known one, which takes time, is looked up for some alone."""
    looked_up = []

    def counted(word, known):
        looked_up.append(word)
        return ""

    for module in ("_read", "_scene"):
        monkeypatch.setattr(f"jaxcomp.scene.{module}.did_you_mean", counted)
    with pytest.raises(SceneError) as caught:
        loads(GOOD + "".join(junk.format(i) for i in range(3000)))
    assert len(caught.value.others) >= 2999
    assert len(looked_up) <= 20


@pytest.mark.parametrize(
    ("text", "key", "kelvin"),
    [
        ("-23.3 degC", "gas.suction.evaporating", 249.85),
        ("18.3 C", "gas.suction.temperature", 291.45),
        ("-4°F", "--over gas.discharge.condensing=-4°F:3", 253.15),
        ("20 celsius", "gas.wall_temperature.1", 293.15),
        ("249.85 K", "--limit discharge_temperature", 249.85),
        ("10 K", "gas.suction.superheat", 10.0),
    ],
)
def test_temperatures_with_a_zero_of_their_own(text, key, kelvin):
    assert float(to_si(text, "K", key)) == pytest.approx(kelvin, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("10 degC", "gas.suction.superheat", r'difference of temperatures is needed; write "10 K"'),
        (
            "18 °F",
            "gas.discharge.subcooling",
            r'difference of temperatures is needed; write "10 K"',
        ),
        ("2 C", "film_temperature_rise.crank_pin", "difference of temperatures"),
        (
            "10",
            "gas.suction.temperature",
            'lacks its unit; it must be a temperature .* "-23.3 degC"',
        ),
        ("10", "gas.suction.superheat", 'lacks its unit; .* "10 K"'),
        ("10 coulomb", "gas.suction.temperature", "another dimension"),
    ],
)
def test_a_difference_of_temperatures_is_no_temperature(text, key, words):
    with pytest.raises(SceneError, match=words):
        to_si(text, "K", key)


def test_a_tolerance_of_a_temperature_is_a_difference():
    one = read_tolerance("+-2 K", "K", "gas.suction.temperature")
    assert one == read_tolerance("+-2 K", "K", "gas.suction.superheat")
    with pytest.raises(SceneError, match="difference of temperatures"):
        read_tolerance("+-2 degC", "K", "gas.suction.temperature")


def test_oil_by_grade_and_temperature():
    text = (
        GOOD
        + """
[friction]
type = "slider_crank"
[friction.piston_film]
radial_clearance = "6 um"
length = "30 mm"
dynamic_viscosity = "VG 46 at 60 degC"
"""
    )
    film = loads(text).compressor.friction.piston_film
    assert float(film.dynamic_viscosity) == pytest.approx(
        float(iso_vg_viscosity(46, 333.15)), rel=1e-12
    )
    with pytest.raises(
        SceneError, match=r'"60 degC": is a temperature.*such as "VG 46 at 60 degC"'
    ):
        loads(text.replace("VG 46 at ", ""))


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("moter.mean_speed", "8 rpm", 'moter: is an unknown section; did you mean "motor"'),
        ("motor.speed", "8 rpm", 'motor.speed = .*: is an unknown key; did you mean "mean_speed"'),
        ("motor.mean_speed.x", "8 rpm", "leads through motor.mean_speed, which is a single value"),
        ("motor", "8 rpm", r"motor = .*: must be a section \[motor\]"),
        ("motor..mean_speed", "8 rpm", "is no path"),
        ("motor.mean_speed", None, "motor.mean_speed: is missing"),
        ("motor.mean_speed", "8 mm", "another dimension"),
        ("motor.type", "kloss", "motor.pull_out_torque: is missing"),
        (
            "friction.wall.coefficient",
            0.1,
            "friction.type: is missing; .* slider_crank, slider_link",
        ),
    ],
)
def test_values_that_cannot_be_set(path, value, message):
    with pytest.raises(SceneError, match=message):
        with_value(loads(GOOD, "good.toml"), path, value)


def test_places_past_the_end_of_a_list():
    scene = loads('gravity = ["0 m/s^2", "1 m/s^2"]\n' + GOOD)
    with pytest.raises(SceneError, match=r"gravity.2: must name one of the 2 entries of gravity"):
        with_values(scene, {"gravity.2": "1 m/s^2"})
    with pytest.raises(SceneError, match="cannot be taken away alone"):
        with_values(scene, {"gravity.1": None})


@pytest.mark.parametrize(
    ("grade", "least", "most"),
    [(20, 6.9, 9.3), (30, 9.3, 12.5), (40, 12.5, 16.3), (50, 16.3, 21.9), (60, 21.9, 26.1)],
)
def test_grades_of_sae_have_the_viscosity_of_their_standard(grade, least, most):
    """[mm^2/s] Kinematic viscosity at 100 degrees Celsius by SAE J300, of an oil of 900 kg/m^3 at 15."""
    dynamic = float(to_si(f"SAE {grade} at 100 degC", "Pa s", "dynamic_viscosity"))
    density = 900 * (1 - 6.5e-4 * 85)
    assert least < 1e6 * dynamic / density < most


def test_a_grade_that_sae_has_not_is_answered_with_those_that_it_has():
    with pytest.raises(SceneError, match=r"SAE 25.*known are 20, 30, 40, 50, 60"):
        to_si("SAE 25 at 100 degC", "Pa s", "dynamic_viscosity")


def test_a_film_by_its_author_is_answered_with_its_name():
    text = (
        GOOD
        + """
[friction]
type = "slider_crank"
[friction.crank_pin]
type = "film"
film = "ocvirk"
diameter = "24 mm"
length = "20 mm"
radial_clearance = "20 um"
dynamic_viscosity = "SAE 30 at 80 degC"
"""
    )
    with pytest.raises(SceneError, match=r'crank_pin.film.*did you mean "short"'):
        loads(text)
    assert loads(text.replace("ocvirk", "short")).compressor.friction.crank_pin.film == "short"
