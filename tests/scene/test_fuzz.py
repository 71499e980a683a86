"""Mutated scenes and tables of measurements: read, or refused in one line, and soon."""

import random
import time

import pytest

from jaxcomp.scene import SceneError, dump, load, loads, machines, start
from jaxcomp.scene.interface import starts
from jaxcomp.scene.measurements import read_measurements

TABLE = """run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg],kept
initial,bearing-1,1490,7.2,238,,,
initial,bearing-2,1490,13.5,296,,,
plane-1,bearing-1,1490,4.9,114,2.5,0,yes
plane-1,bearing-2,1490,9.2,347,2.5,0,yes
plane-2,bearing-1,1490,4.0,79,2.5,90,
plane-2,bearing-2,1490,12.0,292,2.5,90,
"""
# What people and programs put in the wrong place.
PIECES = [
    *"\"'[]{}()=,.;:#%$!^*/\\|~_-+ \t\n\r\0\x1b\ufeffµ°²€\u2028",
    *("nan", "inf", "-inf", "1e999", "-0", "1_", "0x10", "1e-320", "9" * 400, "9" * 5000, "true"),
    *("mm", "degC", "Hz", "rpm", "rad", "kg", "1/0 m", "m**m", "m^99^99", "kilo" * 50, "(" * 200),
    *("[" * 400, "]" * 400, "[[gas]]", "[gas.x]", "a." * 500 + "b = 1", "none", "[/x]", "\\u0000"),
    *("{ value = 1 }", "{ value = [], unit = 3 }", '"""', "'''", "1979-05-27", "50,5", "5 mm!", ""),
    *("type", "value", "unit", "source", "mechanism", "rotor", "nodes", "initial", "plane-1"),
]
# Reading takes some milliseconds, the first time with imports and compilations some seconds.
LONGEST = 5.0


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


def read_table(text: str, folder) -> None:
    path = folder / "runs.csv"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    assert read_measurements(path).planes


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
        except Exception as error:
            raise AssertionError(f"{number} of seed {seed}: {text!r}") from error
        assert time.process_time() - began < LONGEST, (number, text)
    # a fuzz that breaks nothing, or everything, would find nothing
    assert 0.3 * count < refused < 0.99 * count


def scenes():
    return [
        *(load(machine.name).text for machine in machines()),
        *(start(kind, "m") for kind in starts()),
    ]


@pytest.mark.parametrize(
    "count", [pytest.param(300, id="300"), pytest.param(5000, id="5000", marks=pytest.mark.slow)]
)
def test_mutated_scenes_are_read_or_refused(count, tmp_path):
    check(scenes(), read_scene, count, 19, tmp_path)


@pytest.mark.parametrize(
    "count", [pytest.param(300, id="300"), pytest.param(3000, id="3000", marks=pytest.mark.slow)]
)
def test_mutated_tables_are_read_or_refused(count, tmp_path):
    check([TABLE, TABLE.replace(",", ";").replace(".", ",")], read_table, count, 20, tmp_path)
