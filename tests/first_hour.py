"""A newcomer's first hour: mistakes, each with what a good answer names, and sixteen tasks.

    python tests/first_hour.py             # every mistake, answered well or not
    python tests/first_hour.py --tasks     # times of each task, at the first and at the second start,
                                           # on the clock and of the processors

An answer is good if the mistake is refused (or, where it may be meant, pointed at), without a
traceback, in a few lines that name the entry, its value, and what it must be or what to write.
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from typer.testing import CliRunner

import jaxcomp as jc
from jaxcomp._core import registry
from jaxcomp.cli import app
from jaxcomp.scene import SceneError, start
from jaxcomp.study.tolerance import within

EFFICIENCY = ["mechanical_efficiency"]
CRANK = {"crank_radius": 0.05, "conrod_length": 0.29, "piston_mass": 2.6, "conrod_mass": 3.8}
WAIT = 60  # [s] An answer that takes longer is none.
MOST = 1500  # characters; the first of several errors counts


class File(NamedTuple):
    """A line of a machine file replaced by others, and what `check` must name.

    `kind` is as in `new`, or the name of the process compressor.
    """

    old: str
    new: str
    names: tuple[str, ...]
    kind: str = "slider-crank"
    refused: bool = True


class Command(NamedTuple):
    """Words of a command line, and what the answer must name."""

    words: tuple[str, ...]
    names: tuple[str, ...]
    most: int = MOST  # characters


class Surroundings(NamedTuple):
    """Variables of the environment in which `jaxcomp run` starts, and what the answer must name."""

    environment: dict[str, str]
    names: tuple[str, ...]


class Readings(NamedTuple):
    """A file of measurements that a command is given, and what the answer must name."""

    text: str
    words: tuple[str, ...]
    names: tuple[str, ...]
    file: str = "readings.csv"
    encoding: str = "utf-8"


class Call(NamedTuple):
    """A call from Python with a scene, and what the exception must name."""

    call: Callable[[Any], Any]
    names: tuple[str, ...]


def _file(old: str, new: str, *names: str, kind: str = "slider-crank", refused: bool = True):
    return File(old, new, names, kind, refused)


def _cli(line: str, *names: str) -> Command:
    return Command(tuple(line.split()), names)


def _map(line: str, *names: str, head: str = "", point: str = "") -> Readings:
    """Points of a map of a machine of R22, with a line in front of them."""
    text = f"{line}\n{head or MAP_HEAD}\n{point or MAP_POINT}\n"
    words = f"identify {R22} --data readings.csv --vary mechanism.bore=40mm:80mm"
    return Readings(text, tuple(words.split()), names)


def _readings(
    text: str,
    *names: str,
    line: str = "",
    file: str = "readings.csv",
    encoding: str = "utf-8",
) -> Readings:
    """Readings of another kind, or in a file of another kind."""
    words = line or f"identify {R22} --data {file} --vary mechanism.bore=40mm:80mm"
    return Readings(text, tuple(words.split()), names, file, encoding)


def _py(call: Callable[[Any], Any], *names: str) -> Call:
    return Call(call, names)


R22 = "semi-hermetic-200cc"
STEEL = "rotor.shafts.0.young_modulus=0.5:2"
MAP_HEAD = (
    "evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],capacity [W],power [W]"
)
MAP_POINT = "-15,30,18.3,0,8926,3099"
VIBRATION_HEAD = "target,axis,speed [rpm],amplitude [um]"
# A map as polynomials, without its lines, and a compressor of EnergyPlus without its curves.
POLYNOMIAL_HEAD = (
    "# fluid = R22\n# superheat = 5 K\n# liquid = 20 degC\n# evaporating = -15 to 5 degC\n"
    "# condensing = 30 to 45 degC\nquantity,unit,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10\n"
)
POWER_LINE = "power,W,767.6,-100.2,98.72,-2.675,3.029,-0.2676,-0.01846,0.02064,0.00285,-0.00336\n"
CUT_OBJECT = "Refrigeration:Compressor,\n  pump, !- Name\n  pump power,\n"
TESPY = (
    '{"fluid": "R22", "superheat": "10 K", "subcooling": "5 K", "evaporating": "-15 to 5 degC",'
    ' "condensing": "30 to 45 degC", "eta_s_poly": EFFICIENCY,'
    ' "eta_vol_poly": [0.8, 0, 0, 0, 0, 0, 0, 0, 0, 0],'
    ' "reference_state": {"swept_volume": 2e-4, "frequency_poly": 25}}'
)
# A mode of a modal test, of which the end is missing.
CUT_SET = "    -1\n    55\nbench\nNONE\nNONE\nNONE\nNONE\n         1         2         2\n"
# A function of acceleration over acceleration.
TRANSMISSIBILITY = (
    "    -1\n    58\n" + "bench\nNONE\nNONE\nNONE\nNONE\n"
    "    4         0    0         0 NONE               1   1 NONE               2   1\n"
    "         5         4         1  0.00000e+00  1.00000e+00  0.00000e+00\n"
    "        18    0    0    0 NONE                 Hz\n"
    "        12    0    0    0 NONE                 NONE\n"
    "        12    0    0    0 NONE                 NONE\n"
    "         0    0    0    0 NONE                 NONE\n"
    "  1.00000e+00  0.00000e+00  2.00000e+00  0.00000e+00  1.00000e+00  0.00000e+00\n"
    "  1.00000e+00  0.00000e+00\n    -1\n"
)
RUNS_HEAD = "run,target,speed [rpm],amplitude [mm/s],phase [deg],trial [g mm],angle [deg]"
BORE = 'bore = "50 mm"'
FLUID = 'name = "R290"'
REAL_GAS = f'type = "real_gas"\n{FLUID}'
R290 = "refrigeration"
PROCESS = "process-two-stage"
UNLOADER = "[gas.suction_valve.unloader]"
CRANK_ENDS = "unloaded = [0, 1, 0, 1]"
HEAD_POCKETS = "pockets = [1, 0, 1, 0]"
FLUID_OF_PROCESS = "[gas.fluid]"


def _process(old: str, new: str, *names: str):
    """A mistake in the file of the process compressor."""
    return _file(old, new, *names, kind=PROCESS)


METHANE = 'type = "real_gas"\nname = "methane"'


def _fluid(new: str, *names: str):
    """A mistake in the fluid of the refrigeration compressor."""
    return _file(REAL_GAS, new, *names, kind=R290)


def _mixture(fractions: str, *names: str):
    """A mistake in the mass fractions of its mixture."""
    return _fluid(f'type = "mixture"\nmass_fractions = {{ {fractions} }}', *names)


MIXTURE_MISTAKES = {
    "fractions of sum 1.01": _mixture("R32 = 0.7, R1234yf = 0.31", "fluid.mass_fractions", "1.01"),
    "negative fraction": _mixture("R32 = -0.1, R1234yf = 1.1", "fluid.mass_fractions", "-0.1"),
    "fraction that is no number": _mixture("R32 = nan, R1234yf = 0.3", "mass_fractions", "nan"),
    "fraction above one": _mixture("R32 = 1.5, R1234yf = -0.5", "fluid.mass_fractions", "1.5"),
    "mixture of one component": _mixture("R32 = 1.0", "fluid.components", "pure R32", "real_gas"),
    "ammonia and water": _mixture("R717 = 0.7, R718 = 0.3", "fluid.components", "ammonia-water"),
    "blend within a mixture": _mixture(
        "R410A = 0.7, R1234yf = 0.3", "fluid.components", "R410A is a blend"
    ),
    "mass and amount together": _fluid(
        'type = "mixture"\nmass_fractions = { R32 = 0.5, R125 = 0.5 }\n'
        "mole_fractions = { R32 = 0.5, R125 = 0.5 }",
        *("fluid.mole_fractions", "mass_fractions"),
    ),
    "suction gas beyond the range of a component": _file(
        'superheat = "10 K"',
        'temperature = "250 degC"',
        *("gas.suction.temperature", "250 degC", "which R1234yf ends"),
        kind="blend",
    ),
    "discharge far beyond the range of pressures": _process(
        'pressure = "45 bar"',
        'pressure = "20000 bar"',
        *("gas.discharge.pressure", "20000 bar", "1.2 times", "methane"),
    ),
    "condensing above the end of a dew line": _file(
        'condensing = "45 degC"',
        'condensing = "85 degC"',
        *("discharge.condensing", "85 degC", "end of the dew line", "give pressures"),
        kind="blend",
    ),
    "superheat of a blend above its critical pressure": _file(
        'evaporating = "-10 degC"',
        'pressure = "60 bar"',
        *("gas.suction.pressure", "60 bar", "critical pressure of R32/R1234yf", "no superheat"),
        kind="blend",
    ),
    "suction of a blend below its dew point": _file(
        'superheat = "10 K"',
        'temperature = "-28 degC"',
        *("gas.suction.temperature", "-28 degC", "dew temperature of R32/R1234yf"),
        kind="blend",
    ),
    "natural gas below its dew point": _process(
        METHANE,
        'type = "mixture"\nmole_fractions = { methane = 0.5, R600 = 0.5 }',
        *("gas.suction.temperature", "30 degC", "dew temperature"),
    ),
    "condensate in a cooler": _process(
        f"{FLUID_OF_PROCESS}\n{METHANE}",
        f'interstage_pressure = ["25 bar"]\n{FLUID_OF_PROCESS}\ntype = "mixture"\n'
        "mole_fractions = { methane = 0.7, R600 = 0.3 }",
        *("gas.later_stages.0.cooler.outlet_temperature", "40 degC", "begins to condense"),
    ),
    "mean temperatures of a natural gas": _process(
        f"{FLUID_OF_PROCESS}\n{METHANE}",
        f'reference = "mean"\n{FLUID_OF_PROCESS}\ntype = "mixture"\n'
        "mole_fractions = { methane = 0.9, hydrogen = 0.1 }",
        *("gas.reference", '"mean"', "condenses"),
    ),
}

PROCESS_MISTAKES = {
    "misspelt rod": _process(
        "rod_diameter =", "rod_diamter =", "gas.crank_end.rod_diamter", '"rod_diameter"'
    ),
    "rod thicker than the bore": _process(
        'rod_diameter = { value = "63 mm"',
        'rod_diameter = { value = "300 mm"',
        *("gas.crank_end.rod_diameter", "300 mm", "< 0.26 m", "bore"),
    ),
    "rod of a later stage thicker than its bore": _process(
        'rod_diameter = "63 mm"',
        'rod_diameter = "180 mm"',
        *("gas.later_stages.0.crank_end.rod_diameter", "180 mm", "< 0.17 m"),
    ),
    "port wider than the ring around the rod": _process(
        'rod_diameter = "63 mm"',
        'rod_diameter = "155 mm"',
        *("gas.later_stages.0.suction_valve.port_diameter", "85 mm", "0.069", "around its rod"),
    ),
    "crank end in one stage alone": _process(
        "[gas.later_stages.crank_end",
        "[gas.later_stages.crnk_end",
        *("gas.later_stages.0.crnk_end", '"crank_end"'),
    ),
    "later stages in single brackets": _process(
        "[[gas.later_stages]]", "[gas.later_stages]", "gas.later_stages", "[[gas.later_stages]]"
    ),
    "misspelt cooler": _process(
        "[gas.later_stages.cooler]",
        "[gas.later_stages.coler]",
        *("gas.later_stages.0.coler", '"cooler"'),
    ),
    "cooler that takes all pressure": _process(
        'pressure_drop = "0.4 bar"',
        'pressure_drop = "40 bar"',
        *("gas.later_stages.0.cooler.pressure_drop", "40 bar", "< 3.5e+06 Pa"),
    ),
    "pressure between stages below suction": _process(
        FLUID_OF_PROCESS,
        f'interstage_pressure = ["5 bar"]\n{FLUID_OF_PROCESS}',
        *("gas.interstage_pressure", "5 bar", "> 1e+06 Pa", "< 4.5e+06 Pa"),
    ),
    "a stage that no cylinder has": _process(
        FLUID_OF_PROCESS,
        f"stage_of_cylinder = [1, 3]\n{FLUID_OF_PROCESS}",
        *("gas.stage_of_cylinder", "[1, 3]", "from 1 to 2"),
    ),
    "discharge below suction": _process(
        'pressure = "45 bar"',
        'pressure = "4.5 bar"',
        *("gas.discharge.pressure", "4.5 bar", "above the suction pressure"),
    ),
    "pocket of less than nothing": _process(
        'volume = "1 l"', 'volume = "-1 l"', "gas.later_stages.0.pocket.volume", "-1 l", "> 0"
    ),
    "pocket that an end does not have": _process(
        HEAD_POCKETS, "pockets = [1, 1, 1, 0]", "gas.load_steps.0.pockets", "end 2", "no pocket"
    ),
    "more than the whole pocket": _process(
        HEAD_POCKETS, "pockets = [2, 0, 1, 0]", "gas.load_steps.0.pockets", "2", "<= 1"
    ),
    "misspelt force of an unloader": _process(
        f"{UNLOADER}\nforce", f"{UNLOADER}\nforse", "gas.suction_valve.unloader.forse", '"force"'
    ),
    "release while gas is drawn": _process(
        UNLOADER,
        f'{UNLOADER}\nrelease = "30 deg"',
        *("gas.suction_valve.unloader.release", "30 deg", ">= 3.14159"),
    ),
    "release without its unit": _process(
        UNLOADER, f"{UNLOADER}\nrelease = 250", "gas.suction_valve.unloader.release", "250", "deg"
    ),
    "release that lasts too long": _process(
        UNLOADER,
        f'{UNLOADER}\nrelease = "250 deg"\nduration = "170 deg"',
        *("gas.suction_valve.unloader.duration", "170 deg", "160 deg"),
    ),
    "unloader of a discharge valve": _process(
        "[gas.discharge_valve]",
        '[gas.discharge_valve.unloader]\nforce = "1 kN"\n\n[gas.discharge_valve]',
        *("gas.discharge_valve.unloader", "suction valves"),
    ),
    "load step that unloads everything": _process(
        CRANK_ENDS,
        "unloaded = [1, 1, 1, 1]",
        "gas.load_steps.1.unloaded",
        "stage 1",
        "0 for an end",
    ),
    "load step of a cylinder, not of its ends": _process(
        CRANK_ENDS, "unloaded = [0, 1]", "gas.load_steps.1.unloaded", "2 values", "each of 4 ends"
    ),
    "misspelt setting of a load step": _process(
        CRANK_ENDS, "unload = [0, 1, 0, 1]", "gas.load_steps.1.unload", '"unloaded"'
    ),
    "two load steps of one name": _process(
        'name = "crank ends unloaded"\n',
        'name = "pockets"\n',
        *("gas.load_steps.name", "pockets", "another name"),
    ),
}

FILES = {
    "unit of another dimension": _file(BORE, 'bore = "50 kg"', "mechanism.bore", "50 kg", "m"),
    "volume at a node that no pipe has": _file(
        'node = "bottle"', 'node = "botle"', "volumes.0.node", "botle", "bottle", kind="pipes"
    ),
    "one length too few for pipes": _file(
        'length = ["0.2 m", ', "length = [", "pipes.0.length", "4 gaps", kind="pipes"
    ),
    "misspelt unit": _file(BORE, 'bore = "50 milimeter"', "mechanism.bore", "milimeter", "130 mm"),
    "length in mm without unit": _file(BORE, "bore = 50", "mechanism.bore", "50", "mm"),
    "pressure in bar without unit": _file(
        'discharge_pressure = "8.0 bar"', "discharge_pressure = 8.0", "discharge_pressure", "Pa"
    ),
    "speed in rpm without unit": _file(
        'mean_speed = "1450 rpm"', "mean_speed = 1450", "mean_speed", "rpm", refused=False
    ),
    "speed in Hz": _file(
        'mean_speed = "1450 rpm"', 'mean_speed = "24 Hz"', "mean_speed", "24 Hz", "rpm"
    ),
    "decimal comma": _file(BORE, "bore = 50,5", "mechanism.bore", "decimal comma", "50.5"),
    "decimal comma in a text": _file(BORE, 'bore = "50,5 mm"', "mechanism.bore", "50.5"),
    "no quotes": _file(BORE, "bore = 50 mm", "mechanism.bore", '"50 mm"'),
    "text for a number": _file(BORE, 'bore = "fifty"', "mechanism.bore", "fifty", "number"),
    "truth value for a number": _file(BORE, "bore = true", "mechanism.bore", "130 mm"),
    "not a number": _file(BORE, "bore = nan", "mechanism.bore", "nan"),
    "list for a number of a bearing": _file(
        'diameter = "14 mm"', 'diameter = ["14 mm", "15 mm"]', "diameter", "single value"
    ),
    "list for the one cylinder": _file(
        BORE, 'bore = ["50 mm", "60 mm"]', "mechanism.bore", "cylinder"
    ),
    "section for a number": _file(BORE, "bore = { mm = 50 }", "mechanism.bore", "value"),
    "misspelt key of a value": _file(
        BORE, 'bore = { vlaue = "50 mm" }', "mechanism.bore", '"value"'
    ),
    "number for a source": _file(
        BORE, 'bore = { value = "50 mm", source = 17 }', "mechanism.bore.source", "17", "text"
    ),
    "negative length": _file(
        BORE, 'bore = "-50 mm"', "mechanism.bore", "-50 mm", "> 0 and <= 10 m"
    ),
    "rod shorter than the crank": _file(
        'conrod_length = "100 mm"',
        'conrod_length = "15 mm"',
        "conrod_length",
        "15 mm",
        "crank_radius",
    ),
    "clearance without its per cent": _file(
        'clearance_ratio = "4 %"',
        "clearance_ratio = 4",
        "gas.clearance_ratio",
        "0.1 % to 30 %",
        refused=False,
    ),
    "pressures exchanged": _file(
        'discharge_pressure = "8.0 bar"',
        'discharge_pressure = "0.5 bar"',
        "discharge_pressure",
        "suction_pressure",
    ),
    "piston of 25 kg": _file(
        'piston_mass = "0.25 kg"', 'piston_mass = "25 kg"', "piston_mass", "25 kg", refused=False
    ),
    "friction of 5": _file(
        "coefficient = 0.05",
        "coefficient = 5",
        "friction.wall.coefficient: 5",
        "usual is",
        refused=False,
    ),
    "machine without a gas": _file(
        'type = "polytropic"', 'type = "none"', "gas.type", "polytropic"
    ),
    "misspelt key": _file(BORE, 'bor = "50 mm"', "mechanism.bor", '"bore"'),
    "word of another trade": _file(
        'conrod_length = "100 mm"', 'rod_length = "100 mm"', "mechanism.rod_length", "conrod_length"
    ),
    "stroke instead of radius": _file(
        'crank_radius = "20 mm"', 'stroke = "40 mm"', "mechanism.stroke", "crank_radius"
    ),
    "missing key": _file(BORE, "", "mechanism.bore", "missing", "m"),
    "key in the wrong section": _file(
        "[gas]\n", '[gas]\nbore = "50 mm"\n', "gas.bore", "[mechanism]"
    ),
    "key above all sections": _file(
        "[mechanism]\n", 'bore = "50 mm"\n[mechanism]\n', "bore", "mechanism"
    ),
    "misspelt section": _file("[mechanism]", "[mechanics]", "mechanics", '"mechanism"'),
    "misspelt type": _file(
        '[mechanism]\ntype = "slider_crank"',
        '[mechanism]\ntype = "slidercrank"',
        "mechanism.type",
        "slidercrank",
        "slider_crank",
    ),
    "missing type": _file(
        '[gas]\ntype = "polytropic"\n', "[gas]\n", "gas.type", "missing", "polytropic"
    ),
    "missing section": _file("[motor]\n", "[motr]\n", "motor", '"motor"'),
    "key twice": _file(BORE, f"{BORE}\n{BORE}", "mechanism.bore", "twice"),
    "section twice": _file("[gas]\n", "[mechanism]\n[gas]\n", "mechanism", "twice"),
    "quote not closed": _file(
        BORE, 'bore = "50 mm', "mechanism.bore", "lacks a quote", 'bore = "50 mm"'
    ),
    "unknown layout": _file(
        "[crankshaft]\n", '[crankshaft]\nlayout = "line of 4"\n', "crankshaft.layout", "in-line-4"
    ),
    "missing table": _file(
        'type = "polytropic"', 'type = "crank_angle_table"\ncsv = "indicator.csv"', "indicator.csv"
    ),
    "temperature without unit": _file(
        'evaporating = "-23.3 degC"', "evaporating = -23.3", "evaporating", "degC", kind=R290
    ),
    "difference in degrees": _file(
        'heating = "18 K"', 'heating = "18 degC"', "heating", "K", kind=R290
    ),
    "common name of a fluid": _file(FLUID, 'name = "propan"', "fluid.name", "R290", kind=R290),
    "blend with unknown pairs": _file(
        FLUID, 'name = "R401A"', "fluid.name", "R22/R124", "estimate_pairs", kind=R290
    ),
    "blend in small letters": _file(FLUID, 'name = "r404a"', "fluid.name", "R404A", kind=R290),
    "fractions that do not add up": _file(
        REAL_GAS,
        'type = "mixture"\nmass_fractions = { R32 = 68.9, R1234yf = 31.1 }',
        "fluid.mass_fractions",
        "%",
        kind=R290,
    ),
    "name of a blend on another composition": _file(
        REAL_GAS,
        'type = "mixture"\nname = "R448A"\nmass_fractions = { R32 = "30 %", R1234yf = "70 %" }',
        "fluid.name",
        "another composition",
        kind=R290,
    ),
    "dew temperatures of a process gas": _file(
        REAL_GAS,
        'type = "mixture"\nmole_fractions = { methane = "90 %", hydrogen = "10 %" }',
        "suction.evaporating",
        "no dew line",
        kind=R290,
    ),
    "mean temperatures of a pseudo-pure fluid": _file(
        f"[gas.fluid]\n{REAL_GAS}",
        'reference = "mean"\n[gas.fluid]\ntype = "real_gas"\nname = "R407C"',
        "gas.reference",
        'name = "R407C"',
        kind=R290,
    ),
    **MIXTURE_MISTAKES,
    "unknown component": _file(
        REAL_GAS,
        'type = "mixture"\nmass_fractions = { R32 = 0.7, R1234yx = 0.3 }',
        "R1234yx",
        "R1234yf",
        kind=R290,
    ),
    "unknown fluid": _file(FLUID, 'name = "R1270x"', "fluid.name", "R1270x", "R290", kind=R290),
    "condensing above the critical point": _file(
        'condensing = "54.4 degC"',
        'condensing = "130 degC"',
        "condensing",
        "130 degC",
        "369.89 K",
        kind=R290,
    ),
    "evaporating above condensing": _file(
        'evaporating = "-23.3 degC"',
        'evaporating = "60 degC"',
        "54.4 degC",
        "333.15",
        "evaporating temperature",
        kind=R290,
    ),
    "suction gas below its dew point": _file(
        '\ntemperature = "32.2 degC"',
        '\ntemperature = "-30 degC"',
        "temperature",
        "-30 degC",
        "249.35 K",
        kind=R290,
    ),
    "port wider than the bore": _file(
        'port_diameter = "7 mm"', 'port_diameter = "70 mm"', "port_diameter", "bore", kind=R290
    ),
    "misspelt valve": _file(
        '[gas.suction_valve]\ntype = "reed"',
        '[gas.suction_valve]\ntype = "red"',
        "gas.suction_valve.type",
        "reed",
        kind=R290,
    ),
    **PROCESS_MISTAKES,
}

WBHE = "mayekawa-wbhe"
IDENTIFY = f"identify {R22} --vary mechanism.bore=40mm:80mm --data"
COMMANDS = {
    "pulsation of a machine without pipes": _cli(
        f"pulsation {WBHE}", "gas.suction.piping", "gas.discharge.piping"
    ),
    "a step that does not divide a turn": _cli(
        "run mayekawa-wbhe --step 0.7 --out r", "--step 0.7", "must divide 360"
    ),
    "a step without a folder": _cli("run mayekawa-wbhe --step 1", "--step", "--out FOLDER"),
    "load steps of a machine without any": _cli(
        f"run {WBHE} --load-steps", "--load-steps", "[[gas.load_steps]]"
    ),
    "a run in time of stages without the pressure between them": Command(
        (
            *("simulate", PROCESS, "--duration", "1s", "--set"),
            'motor={type = "slip_line", slope = "200 N m s", synchronous_speed = "600 rpm"}',
        ),
        ("gas.interstage_pressure", "run in time", "jaxcomp run"),
    ),
    "a run-up without its duration": _cli("simulate mayekawa-wbhe", "--duration", "2s"),
    "vibration of a machine without a rotor": _cli("modes slider-link-8cc", "no [rotor]"),
    "a comparison by what none has": _cli(
        "compare mayekawa-wbhe --with bore_at_displacement=120mm --quantity cop", "cop", "valves"
    ),
    "misspelt command": _cli("chek my.toml", "chek", "check"),
    "misspelt machine": _cli("check mayekawa-wbe", "mayekawa-wbe", WBHE),
    "missing file": _cli("run machines/my.toml", "machines/my.toml"),
    "folder for a file": _cli("check .", "folder"),
    "picture for a file": _cli("check picture.png", "picture.png"),
    "empty file": _cli("check empty.toml", "empty.toml", "jaxcomp new"),
    "misspelt option": _cli(f"run {WBHE} --ouput result", "--ouput", "--out"),
    "set without a value": _cli(f"run {WBHE} --set motor.mean_speed", "motor.mean_speed", "="),
    "set of an unknown number": _cli(
        f"run {WBHE} --set mechanism.bor=120mm", "mechanism.bor", '"bore"'
    ),
    "set of a bearing": _cli(
        f"run {WBHE} --set friction.crank_pin=big-end",
        "friction.crank_pin",
        "big-end",
        "[bearings.big-end]",
    ),
    "set of a number without its section": _cli(
        f"run {WBHE} --set conrod_length=80mm", "mechanism.conrod_length"
    ),
    "set with a wrong unit": _cli(
        f"run {WBHE} --set mechanism.bore=120kg", "mechanism.bore", "120kg", "m"
    ),
    "bore without its place": _cli(
        f"run {WBHE} --set bore=120mm", "mechanism.bore", "bore_at_displacement", "displacement"
    ),
    "sweep of a bore without its place": _cli(
        f"sweep {WBHE} --over bore=100mm:150mm:11", "mechanism.bore", "bore_at_displacement"
    ),
    "design rule in bare millimetres": _cli(
        f"run {WBHE} --design bore_at_displacement=120", "bore", "120", "m"
    ),
    "misspelt quantity": _cli(
        f"sensitivity {WBHE} --quantity efficency", "efficency", "mechanical_efficiency"
    ),
    "quantity of another machine": _cli(f"sensitivity {WBHE} --quantity cop", "cop", "valves"),
    "range upside down": _cli(
        f"optimise {WBHE} --variable bore_at_displacement=160mm:100mm",
        "bore",
        "0.16",
        "0.1",
        "lower end first",
    ),
    "range with another sign": _cli(
        f"optimise {WBHE} --variable bore_at_displacement=100mm..160mm", "bore", "100mm:160mm"
    ),
    "nothing to change": _cli(f"optimise {WBHE}", "--variable", "bore_at_displacement=100mm:160mm"),
    "options that do not go together": _cli(
        f"optimise {WBHE} --variable bore_at_displacement=100mm:160mm --objective friction_power "
        "--target motor_power=20kW",
        "--target",
        "--objective",
    ),
    "constraint in an unknown unit": _cli(
        f"optimise {WBHE} --variable mechanism.bore=100mm:160mm --constraint peak_force.crank_pin<=8kp",
        "peak_force.crank_pin",
        "8kp",
        "N",
    ),
    "grid without a count": _cli(
        f"sweep {WBHE} --over bore_at_displacement=100mm:150mm", "bore", "100mm:150mm:", "count"
    ),
    "grid of nothing": _cli(f"sweep {WBHE}", "--over"),
    "tolerance without its sign": _cli(
        f"tolerance {WBHE} --vary mechanism.bore=0.1mm", "mechanism.bore", "+-"
    ),
    "no samples": _cli(
        f"tolerance {WBHE} --vary mechanism.bore=+-0.1mm --samples -5", "--samples", "-5"
    ),
    "map of a machine without valves": _cli(f"map {WBHE}", "gas", "polytropic", "valves"),
    "map without its range": _cli(
        "map r290-6cc --evaporating -30:-10", "--evaporating", "-30:-10:"
    ),
    "map above condensing": _cli(
        "map r290-6cc --evaporating 60 --condensing 40", "evaporating", "condensing"
    ),
    "map above the critical point": _cli(
        "map r290-6cc --evaporating -10 --condensing 120", "condensing", "393.15", "369.89 K"
    ),
    "vibration without a rotor": _cli(f"respond {WBHE}", "[rotor]", "respond"),
    "film by its misspelt author": _cli(
        "bearing --diameter 30mm --length 25mm --clearance 15um --speed 3000rpm --load 2kN "
        "--viscosity 10mPas --model ocvrik",
        *("--model", "'ocvrik'", '"short"'),
    ),
    "balance without a rotor": _cli(f"balance {WBHE}", "[rotor]", "balance"),
    "measurements that are not there": _cli("balance --measured runs.csv", "runs.csv"),
    "measurements without units": _cli("balance --measured bare.csv", "bare.csv", "speed [rpm]"),
    "bearing without its load": _cli("bearing --length 20mm --diameter 40mm", "--"),
    "bearing with a wrong unit": _cli(
        "bearing --length 20mm --diameter 40mm --clearance 30um --viscosity 10mPa*s "
        "--speed 3000rpm --load 2kg",
        "--load",
        "2kg",
        "N",
    ),
    "results into a file": _cli(f"run {WBHE} --out empty.toml", "empty.toml", "folder"),
    "results over a file of one's own": _cli(
        f"run {WBHE} --out mine", "machine.toml", "another folder", "--force"
    ),
    "schema over a file": _cli("schema empty.toml", "empty.toml", "--force"),
    "film by its author": _cli(
        "bearing --length 20mm --diameter 40mm --clearance 30um --viscosity 10mPa*s "
        "--speed 3000rpm --load 2kN --model ocvirk",
        "ocvirk",
        "short",
    ),
    "quantity in capitals": _cli("sensitivity r290-6cc --quantity COP", "COP", '"cop"'),
    "family of quantities": _cli(
        f"sensitivity {WBHE} --quantity peak_force", "peak_force.<joint>", "list --quantities"
    ),
    "new over a file": _cli("new empty.toml", "empty.toml", "--force"),
    "new of an unknown kind": _cli("new one.toml --kind fridge", "fridge", "refrigeration"),
    "new from an unknown machine": _cli("new one.toml --from r290", "r290", "r290-6cc"),
    "explain a misspelt part": _cli("explain slider-cranck", "slider_crank"),
    "list of a misspelt machine": _cli("list r290-6c", "r290-6cc"),
    "duration without unit": _cli(f"simulate {WBHE} --duration 3", "--duration", "3", "s"),
    "duration below zero": _cli(f"simulate {WBHE} --duration -3s", "duration", "-3"),
    "comparison with nothing": _cli(f"compare {WBHE}", "--with"),
    "desk of a misspelt machine": _cli("desk r290-6c", "r290-6cc"),
    "unknown study": _cli(f"accuracy {WBHE} --study everything", "everything", "quantities"),
    "a limit that no design keeps": Command(
        (
            *(
                "optimise",
                WBHE,
                "--variable",
                "mechanism.bore=100mm:160mm",
                "--constraint",
                "motor_power<=1W",
            ),
            *("--accuracy", "coarse", "--samples", "4", "--starts", "1", "--steps", "3"),
        ),
        ("no design", "motor_power <= 0.001 kW", "nearest"),
        most=2 * MOST,  # with the tables of the nearest design
    ),
    "friction that locks": _cli(
        f"run {WBHE} --set friction.wall.coefficient=8", "locks the joints", "lower"
    ),
    "pipe for a map of EnergyPlus": _cli(f"{IDENTIFY} pipe.idf", "pipe.idf", "pipe", "into a file"),
    "pipe for a map of TESPy": _cli(f"{IDENTIFY} pipe.json", "pipe.json", "pipe", "into a file"),
    "pipe for a modal test": _cli(f"{IDENTIFY} pipe.uff", "pipe.uff", "pipe", "into a file"),
}

BALANCE = "balance --measured readings.csv"
MODAL_TEST = f"identify hermetic-68cc --data readings.csv --vary {STEEL}"
READINGS = {
    "misspelt setting": _map("# sped = 900 rpm", "sped", '"speed"'),
    "setting of another kind of file": _map(
        "# motor.mean_speed = 900 rpm", "motor.mean_speed", '"speed"'
    ),
    "setting without a number": _map("# speed = about 900 rpm", "speed", "about", "1450 rpm"),
    "setting without a unit": _map("# speed = 900", "speed", "900", "unit", "1450 rpm"),
    "another fluid": _map("# Fluid = R134a", "fluid", "R134a", "R22"),
    "refrigerant for fluid": _map("# refrigerant = R22", "refrigerant", '"fluid"'),
    "ratings for rating": _map("# ratings = ashrae", "ratings", '"rating"'),
    "rating beside its columns": _map("# rating = ashrae", "return_gas", "column"),
    "heads of one's own": _map(
        "", "te, tc, Q, P", "evaporating [degC]", head="te,tc,Q,P", point="-5,30,1,2"
    ),
    "thousands with a comma": _map(
        "",
        "8,926",
        "18.3",
        "decimal",
        head=MAP_HEAD.replace(",", ";"),
        point=MAP_POINT.replace(",", ";").replace("8926", "8,926"),
    ),
    "formula that failed": _map("", "line 3.evaporating", "#N/A", point="#N/A,30,18,0,8926,3099"),
    "capacity below zero": _map(
        "", "capacity", "-8926", "above 0", point=MAP_POINT.replace("8926", "-8926")
    ),
    "subcooling of 500 K": _map(
        "", "liquid", "at least", point=MAP_POINT.replace("18.3,0", "18.3,500")
    ),
    "return gas of 5000 degC": _map(
        "", "gas", "5000", "at most", point=MAP_POINT.replace("18.3", "5000")
    ),
    "condition in a column and above it": _readings(
        "# motor.mean_speed = 1500 rpm\nmotor.mean_speed [rpm],motor_power [kW]\n1400,2\n",
        "motor.mean_speed",
        "column",
        "above",
    ),
    "trace of zeros": _readings("crank_angle [deg],pressure [bar]\n0,0\n9,0\n", "sd(pressure)"),
    "runs without the first": _readings(
        f"{RUNS_HEAD}\nplane-1,A,1490,7,238,3,0\n", "initial", "plane-1", line=BALANCE
    ),
    "first run by another name": _readings(
        f"{RUNS_HEAD}\nas is,A,1490,7,238,,\n", "line 2.trial", '"initial"', line=BALANCE
    ),
    "transmissibility for a response": _readings(
        TRANSMISSIBILITY,
        *("data type 12 over 12", "motion", "force"),
        line=MODAL_TEST.replace("readings.csv", "frf.uff"),
        file="frf.uff",
    ),
    "blades of another plane": _readings(
        f"{RUNS_HEAD}\ninitial,A,1490,7,238,,\nfan,A,1490,5,200,3,0\n",
        *("--places", "fun", '"fan"'),
        line=f"{BALANCE} --places fun=16",
    ),
    "stock of masses without a radius": _readings(
        f"{RUNS_HEAD}\ninitial,A,1490,7,238,,\nfan,A,1490,5,200,3,0\n",
        *("--stock 5g", "--radius"),
        line=f"{BALANCE} --places 16 --stock 5g",
    ),
    "amplitudes of one trial position": _readings(
        f"{RUNS_HEAD.replace('phase [deg],', '')}\ninitial,A,1490,7,,\nfirst,A,1490,5,3,0\n",
        *("trial", "two angles", "phase"),
        line=BALANCE,
    ),
    "run without its sensor": _readings(
        f"{RUNS_HEAD}\ninitial,,1490,7,238,,\n", "line 2.target", "name", line=BALANCE
    ),
    "gas that is not told": _map(
        "# useful superheat = 5 K",
        "return_gas",
        "superheat",
        "# return_gas = 18.3 degC",
        head=MAP_HEAD.replace("return_gas [degC],", ""),
        point=MAP_POINT.replace("18.3,", ""),
    ),
    "division by zero": _map(
        "", "line 3.evaporating", "#DIV/0!", "number", point="#DIV/0!,30,18,0,8926,3099"
    ),
    "reference to nothing": _map(
        "", "line 3.evaporating", "#REF!", "number", point="#REF!,30,18,0,8926,3099"
    ),
    "power below zero": _map(
        "", "power", "-3099", "above 0", point=MAP_POINT.replace("3099", "-3099")
    ),
    "speed below zero": _map(
        "",
        "speed",
        "above 0",
        head=MAP_HEAD.replace("power [W]", "power [W],speed [rpm]"),
        point=f"{MAP_POINT},-900",
    ),
    "line behind remarks and empty lines": _map(
        "# bench 3\n\n# by night", "line 5.capacity", '"x"', point=MAP_POINT.replace("8926", "x")
    ),
    "number with two points": _map("# speed = 1.2.3 rpm", "speed", "1.2.3 rpm", "1450 rpm"),
    "setting without its value": _map("# speed =", "line 1.speed", "value"),
    "units that a program left out": _map(
        "", "evaporating", "evaporating [degC]", head=MAP_HEAD.replace(" [degC]", "")
    ),
    "signs of another alphabet": _readings(
        f"{MAP_HEAD.replace('degC', '°C')}\n{MAP_POINT}\n", "UTF-8", "save", encoding="cp1252"
    ),
    "heads without a line": _readings(f"{MAP_HEAD}\n", "no points", "line"),
    "no independent samples": _readings(
        "# independent = 0\ncrank_angle [deg],pressure [bar]\n0,8\n", "independent", '"0"', "from 1"
    ),
    "trace without a reading": _readings(
        "crank_angle [deg],pressure [bar]\n0,\n90,\n", "pressure", "one angle at least"
    ),
    "trace without an angle": _readings(
        "crank_angle [deg],pressure [bar]\n,8\n90,2\n", "line 2.crank_angle", "number"
    ),
    "order in words": _readings(
        f"# order = x\n{VIBRATION_HEAD}\nhousing,ux,1450,3\n", "order", '"x"', "from 1"
    ),
    "order without its value": _readings(
        f"# order =\n{VIBRATION_HEAD}\nhousing,ux,1450,3\n", "line 1.order", "value"
    ),
    "order in a column": _readings(
        f"{VIBRATION_HEAD},order\nhousing,ux,1450,3,2\n", "order", "# order = 2"
    ),
    "vibration without its sensor": _readings(
        f"{VIBRATION_HEAD}\n,ux,1450,3\n", "line 2.target", "empty", "write"
    ),
    "mode without its number": _readings(
        "mode,frequency [Hz]\n,100\n", "line 2.mode", "number", line=MODAL_TEST
    ),
    "two runs in one table of modes": _readings(
        "mode,frequency [Hz]\n1,100\n1,100.4\n", "mode = 1", "file of its own", line=MODAL_TEST
    ),
    "polynomials without their lines": _readings(POLYNOMIAL_HEAD, "quantity", "no line", "power"),
    "range that falls": _readings(
        POLYNOMIAL_HEAD.replace("-15 to 5", "5 to -15") + POWER_LINE,
        "evaporating",
        "5 to -15 degC",
        "rises",
    ),
    "empty file of EnergyPlus": _readings("", "Refrigeration:Compressor", file="map.idf"),
    "cut file of EnergyPlus": _readings(CUT_OBJECT, "pump", "Curve:Bicubic", file="map.idf"),
    "number for a file of TESPy": _readings("3", "one JSON object", "TESPy", file="map.json"),
    "nothing for a file of TESPy": _readings("null", "one JSON object", "TESPy", file="map.json"),
    "brackets without end": _readings("[" * 100_000, "no JSON", "TESPy", file="map.json"),
    "efficiency of zero": _readings(
        TESPY.replace("EFFICIENCY", f"{[0] * 10}"), "eta_s_poly", "above 0", file="map.json"
    ),
    "efficiency that is no polynomial": _readings(
        TESPY.replace("EFFICIENCY", "0.7"), "eta_s_poly", "list of ten", file="map.json"
    ),
    "universal file that is cut": _readings(
        CUT_SET,
        "cut",
        "as a whole",
        line=MODAL_TEST.replace("readings.csv", "modes.uff"),
        file="modes.uff",
    ),
}

CALLS = {
    "a name of the command line": _py(lambda scene: jc.run, "steady_state"),
    "samples of a pair": _py(
        lambda scene: jc.sweep(scene, {"mechanism.bore": (0.12, 0.14)}, EFFICIENCY, samples=8),
        "mechanism.bore",
        "jaxcomp.uniform(0.12, 0.14)",
    ),
    "samples without a range": _py(
        lambda scene: jc.sweep(jc.problem(scene, ["mechanism.bore"], EFFICIENCY), samples=8),
        "mechanism.bore",
        "(low, high)",
    ),
    "a quantity of one's own that fails": _py(
        lambda scene: _asked(scene, lambda result: 1 / 0), "mine", "division by zero"
    ),
    "a quantity of one's own of another machine": _py(
        lambda scene: _asked(scene, lambda result: 1.0, ("valves",)), "mine", "valves"
    ),
    "single precision after the import": _py(lambda scene: _in_single(scene), "jax_enable_x64"),
    "a result that unpacks to gigabytes": _py(lambda scene: jc.load_result("large.npz"), "GB"),
    "a need that nobody knows": _py(
        lambda scene: jc.register_quantity("mine", lambda r: r.orbit.margin, needs=("valve",)),
        "needs",
        "valve",
        "valves",
    ),
    "name of a file": _py(lambda s: jc.solve_orbit("my.toml"), '`jaxcomp.load("my.toml")`'),
    "no machine": _py(lambda s: jc.solve_orbit(None), "`jaxcomp.load("),
    "name for a study": _py(lambda s: jc.sensitivity("my.toml"), '`jaxcomp.load("my.toml")`'),
    "text with a unit": _py(lambda s: jc.with_bore(s.machine, "50 mm"), "0.05 for 50 mm"),
    "scene for its machine": _py(
        lambda s: jc.with_bore(s, 0.12), '`jaxcomp.load("my.toml").machine`'
    ),
    "array": _py(lambda s: jc.with_bore(s.machine, np.array([0.12, 0.13])), "`jax.vmap`"),
    "text in a part": _py(lambda s: mechanism("130 mm"), "bore", "a number in SI units"),
    "bore in mm": _py(lambda s: mechanism(130.0), "130 mm are 0.13"),
    "bore below zero": _py(lambda s: mechanism(-0.13), "bore", "> 0 and <= 10 m", "-0.13"),
    "rule in mm": _py(lambda s: jc.with_bore(s.machine, 130.0), "<= 10 m"),
    "range in mm": _py(
        lambda s: jc.problem(s, {"bore_at_displacement": (100, 150)}, EFFICIENCY), "<= 10 m"
    ),
    "sweep in mm": _py(lambda s: jc.sweep(s, {"mechanism.bore": [130.0]}), "<= 10 m"),
    "range with units": _py(
        lambda s: jc.problem(s, {"mechanism.bore": ("100 mm", "150 mm")}, EFFICIENCY),
        "a range of numbers in m",
    ),
    "number for a range": _py(
        lambda s: jc.problem(s, {"bore_at_displacement": 0.2}, EFFICIENCY), "(low, high)"
    ),
    "notation of the command line": _py(
        lambda s: jc.sweep(s, {"mechanism.bore": "0.1:0.2:3"}), "`sweep.grid("
    ),
    "number for a tolerance": _py(
        lambda s: jc.tolerance(s, {"bore_at_displacement": 0.2}), "within(2e-5)"
    ),
    "text for a tolerance": _py(
        lambda s: jc.tolerance(s, {"mechanism.bore": "+-0.2 mm"}), "within(2e-5)"
    ),
    "list of tolerances": _py(lambda s: jc.tolerance(s, ["mechanism.bore"]), "tolerances by name"),
    "text for a list": _py(
        lambda s: jc.sensitivity(s, "mechanical_efficiency"), 'a list, ["mechanical_efficiency"]'
    ),
    "text for variables": _py(
        lambda s: jc.problem(s, "bore_at_displacement", EFFICIENCY),
        'a list, ["bore_at_displacement"]',
    ),
    "scene for a problem": _py(lambda s: jc.optimise(s, "motor_power"), "problem(scene, {"),
    "problem of nothing": _py(lambda s: jc.problem(s), '{"bore_at_displacement": (0.12, 0.14)}'),
    "problem without quantities": _py(
        lambda s: jc.problem(s, ["bore_at_displacement"]),
        'a list such as ["mechanical_efficiency"]',
    ),
    "number for quantities": _py(
        lambda s: jc.problem(s, ["bore_at_displacement"], 5), "a list of names"
    ),
    "range beside its name": _py(
        lambda s: jc.problem(s, [("bore_at_displacement", 0.1, 0.2)], EFFICIENCY), "{name: value}"
    ),
    "dictionary for options": _py(
        lambda s: jc.problem(s, ["bore_at_displacement"], EFFICIENCY, {"orders": 2}),
        "`AnalysisOptions(...)`",
    ),
    "options of sensitivity": _py(
        lambda s: jc.sensitivity(s, EFFICIENCY, options="fine"), "`AnalysisOptions(...)`"
    ),
    "front of nothing": _py(lambda s: jc.pareto(_ranged(s)), "such as ("),
    "front of one": _py(lambda s: jc.pareto(_ranged(s), "motor_power"), "such as ("),
    "one direction for two": _py(
        lambda s: jc.pareto(_ranged(s), (*EFFICIENCY, "motor_power"), maximise=True),
        "(True, False)",
    ),
    "text for points": _py(
        lambda s: jc.pareto(_ranged(s), (*EFFICIENCY, "motor_power"), points="12"), "a number >= 3"
    ),
    "optimum of nothing": _py(lambda s: jc.optimise(), "problem(scene, {"),
    "list of objectives": _py(
        lambda s: jc.optimise(_ranged(s), EFFICIENCY), "one quantity by name"
    ),
    "constraint as text": _py(
        lambda s: jc.optimise(_ranged(s), constraints={"motor_power": "<=5 kW"}),
        "(low, high) in SI units",
    ),
    "constraint as a number": _py(
        lambda s: jc.optimise(_ranged(s), constraints={"motor_power": 5e3}),
        "(low, high) in SI units",
    ),
    "list of constraints": _py(
        lambda s: jc.optimise(_ranged(s), constraints=["motor_power"]),
        '{"motor_power": (None, 5000.0)}',
    ),
    "number for a method": _py(lambda s: jc.optimise(_ranged(s), method=3), "slsqp"),
    "tolerance of nothing": _py(lambda s: jc.tolerance(s), "within(2e-5)"),
    "number for a limit": _py(
        lambda s: jc.tolerance(
            s, {"bore_at_displacement": within(1e-5)}, limits={"motor_power": 0.9}
        ),
        "(low, high) in SI units",
    ),
    "sweep of nothing": _py(lambda s: jc.sweep(s), '{"mechanism.bore": [0.12, 0.13]}'),
    "list for a sweep": _py(
        lambda s: jc.sweep(s, ["bore_at_displacement"]), '{"mechanism.bore": [0.12, 0.13]}'
    ),
    "sweep with units": _py(
        lambda s: jc.sweep(s, {"mechanism.bore": ["120 mm", "130 mm"]}), "numbers in SI units"
    ),
    "something else for a file": _py(jc.load, "name of a bundled machine or of a file"),
    "misspelt quantity in Python": _py(
        lambda s: jc.sensitivity(s, ["efficency"]), "efficency", "mechanical_efficiency"
    ),
    "misspelt variable in Python": _py(
        lambda s: jc.problem(s, {"mechanism.bor": (0.1, 0.2)}, EFFICIENCY),
        "mechanism.bor",
        "mechanism.bore",
    ),
    "misspelt name of the package": _py(
        lambda s: jc.solve_orbits(s), "solve_orbits", '"solve_orbit"'
    ),
    "distribution of another module": _py(lambda s: jc.study.uniform, "uniform", "jaxcomp.uniform"),
    "value that is assigned": _py(
        lambda s: setattr(s.compressor.motor, "mean_speed", 3.0), "mean_speed", "with_value"
    ),
    "machine that is assigned": _py(lambda s: setattr(s, "machine", None), "machine", "with_value"),
    "value in a wrong unit": _py(
        lambda s: jc.scene.with_value(s, "mechanism.bore", "120 kg"), "mechanism.bore", "120 kg"
    ),
    "fluid by another name": _py(lambda s: jc.fluid.RealGas("propan"), "propan", "R290"),
    "results that are not there": _py(lambda s: jc.load_result("none.zarr"), "none.zarr"),
    "vibration without a rotor in Python": _py(lambda s: jc.respond(s, 100.0), "rotor"),
    "map without valves in Python": _py(
        lambda s: jc.study.rating.rating_map(s, [250.0], [320.0]), "valves"
    ),
}

SURROUNDINGS = {
    "a platform that does not exist": Surroundings(
        {"JAX_PLATFORMS": "nonsense"}, ("JAX_PLATFORMS=nonsense", "JAX cannot run on it here")
    ),
    "a platform that is not there": Surroundings(
        {"JAX_PLATFORMS": "rocm"}, ("JAX_PLATFORMS=rocm", "JAX cannot run on it here")
    ),
}

Mistake = File | Command | Readings | Call | Surroundings
MISTAKES: dict[str, Mistake] = {
    **{f"file: {name}": one for name, one in FILES.items()},
    **{f"command: {name}": one for name, one in COMMANDS.items()},
    **{f"readings: {name}": one for name, one in READINGS.items()},
    **{f"Python: {name}": one for name, one in CALLS.items()},
    **{f"surroundings: {name}": one for name, one in SURROUNDINGS.items()},
}

# What a first hour does; commands run one after the other in one folder.
TASKS: dict[str, tuple[str, ...]] = {
    "new machine": ("jaxcomp new my.toml --force", "jaxcomp check my.toml"),
    "run it": ("jaxcomp run my.toml",),
    "run with a report": ("jaxcomp run my.toml --out result",),
    "change a number": ("jaxcomp run my.toml --set motor.mean_speed=1000rpm",),
    "what matters": ("jaxcomp sensitivity my.toml --quantity mechanical_efficiency",),
    "sweep": (
        "jaxcomp sweep my.toml --over bore_at_displacement=45mm:55mm:11"
        " --over motor.mean_speed=900rpm:1500rpm:7",
    ),
    "optimise": ("jaxcomp optimise my.toml --variable bore_at_displacement=40mm:60mm",),
    "tolerance": ("jaxcomp tolerance my.toml --vary mechanism.bore=+-0.1mm --samples 256",),
    "refrigeration map": (
        "jaxcomp new fridge.toml --kind refrigeration --force",
        "jaxcomp map fridge.toml --evaporating -30:-10:3 --condensing 40:50:2",
    ),
    "identify": (
        "jaxcomp identify hermetic-68cc --data modes.csv --vary rotor.shafts.3.young_modulus",
    ),
    "balance": ("jaxcomp balance --measured runs.csv",),
    "bearing": (
        "jaxcomp bearing --length 20mm --diameter 40mm --clearance 30um --viscosity 10mPa*s"
        " --speed 3000rpm --load 2kN",
    ),
    "value and gradient": ("python value.py",),
    "save and load": ("python keep.py",),
    "law of one's own": ("python law.py",),
    "desk": ("python desk.py",),
}
SCRIPTS = {
    "modes.csv": "mode,frequency [Hz]\n1,1318.0\n2,2989.2\n3,5438.0\n",
    "runs.csv": "run,target,speed [rpm],amplitude [um],phase [deg],trial [g mm],angle [deg]\n"
    "initial,A,1490,7.2,238,,\ninitial,B,1490,13.5,294,,\n"
    "drive end,A,1490,4.9,114,7500,270\ndrive end,B,1490,9.2,347,7500,270\n"
    "free end,A,1490,4.0,79,7500,180\nfree end,B,1490,12.0,292,7500,180\n",
    "value.py": """
import jax
import jaxcomp

machine = jaxcomp.load("my.toml").compressor
value = jax.value_and_grad(
    lambda bore: jaxcomp.solve_orbit(jaxcomp.with_bore(machine, bore)).mechanical_efficiency
)
print(value(0.05))
""",
    "keep.py": """
import jaxcomp

orbit = jaxcomp.solve_orbit(jaxcomp.load("my.toml"))
orbit.save("orbit.npz")
assert float(jaxcomp.load_result("orbit.npz").mean_speed) == float(orbit.mean_speed)
""",
    "law.py": """
import jaxcomp
from jaxcomp.friction import AbstractSlide
from jaxcomp.parts import POSITIVE, quantity
from jaxcomp.scene import with_values


class Grease(AbstractSlide):
    kind = "grease"
    drag: float = quantity("N s/m", POSITIVE)

    def force(self, load, speed):
        return self.drag * speed


wall = {"type": "grease", "drag": "20 N s/m"}
print(jaxcomp.solve_orbit(with_values(jaxcomp.load("my.toml"), {"friction.wall": wall})))
""",
    "desk.py": """
import socket
import time
import urllib.request

import jaxcomp
from jaxcomp.desk import serve

with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
server = serve(jaxcomp.load("my.toml"), port=port, show=False, threaded=True)
try:
    for wait in range(300):
        try:
            assert urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=60).status == 200
            break
        except OSError:  # nobody listens yet
            time.sleep(0.1)
    else:
        raise SystemExit("nobody answers")
finally:
    server.stop()
""",
}


def mechanism(bore: Any) -> jc.SliderCrank:
    """The mechanism of a bore, as one types it."""
    return jc.SliderCrank(bore=bore, **CRANK)


def _ranged(scene: Any) -> Any:
    """A problem to which the mistake is made."""
    return jc.problem(scene, {"mechanism.bore": (0.12, 0.14)}, EFFICIENCY)


def _asked(scene: Any, value: Callable[[Any], Any], needs: tuple[str, ...] = ()) -> Any:
    """What a quantity of one's own matters, which is forgotten again."""
    registered = dict(registry._registered)
    try:
        jc.register_quantity("mine", value, needs=needs)
        return jc.sensitivity(scene, ["mine"])
    finally:
        registry._registered = registered


def _in_single(scene: Any) -> Any:
    """An orbit in single precision, which is switched on after the import."""
    jax.config.update("jax_enable_x64", False)
    try:
        return jc.solve_orbit(scene)
    finally:
        jax.config.update("jax_enable_x64", True)


def prepare(folder: Path) -> None:
    """The files beside which the commands run."""
    (folder / "empty.toml").touch()
    (folder / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)))
    (folder / "mine").mkdir()
    (folder / "mine" / "machine.toml").write_text("mine")
    for kind in ("idf", "json", "uff"):
        os.mkfifo(folder / f"pipe.{kind}")
    with zipfile.ZipFile(folder / "large.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("orbit.npy", bytes(1000))
        archive.filelist[0].file_size = 3 * 10**9  # as its list of members says
    (folder / "bare.csv").write_text("run,target,speed,amplitude,phase\ninitial,A,1500,25.6,8.9\n")


def answer(mistake: Mistake) -> tuple[str, str]:
    """What one sees, and what is wrong with it; run in a prepared folder."""
    if isinstance(mistake, Call):
        return _raised(mistake)
    if isinstance(mistake, Surroundings):
        return _started(mistake)
    words, refused = getattr(mistake, "words", ()), True
    if isinstance(mistake, Readings):
        Path(mistake.file).write_text(mistake.text, mistake.encoding)
    if isinstance(mistake, File):
        is_bundled = mistake.kind == PROCESS
        text = jc.load(PROCESS).text if is_bundled else start(mistake.kind, "my-machine")
        bare = re.sub(r"(?<=\S) +# .*", "", text)  # as without the remarks behind values
        bare = re.sub(r"^#.*\n", "", bare, flags=re.M)
        assert mistake.old in bare, f"no line {mistake.old!r}"
        Path("my.toml").write_text(bare.replace(mistake.old, mistake.new, 1))
        words, refused = ("check", "my.toml"), mistake.refused
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    seen = " ".join(done.output.split())
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        return f"{type(done.exception).__name__}: {done.exception}", "a traceback"
    if refused and not done.exit_code:
        return seen, "not noticed"
    return seen, _lacking(seen, mistake.names, getattr(mistake, "most", MOST))


def _started(mistake: Surroundings) -> tuple[str, str]:
    """As `answer`, of a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "jaxcomp", "run", WBHE],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])} | mistake.environment,
        capture_output=True,
        text=True,
        check=False,
    )
    seen = " ".join(done.stderr.split())
    if not done.returncode:
        return seen, "not noticed"
    return seen, "a traceback" if "Traceback" in seen else _lacking(seen, mistake.names)


def _raised(mistake: Call) -> tuple[str, str]:
    try:
        mistake.call(jc.load(WBHE))
    except (jc.BadInput, SceneError, AttributeError, jc.SolveFailed) as error:
        return str(error), _lacking(str(error), mistake.names)
    except Exception as error:
        return f"{type(error).__name__}: {error}", "no answer of this library"
    return "", "not noticed"


def _lacking(seen: str, names: tuple[str, ...], most: int = MOST) -> str:
    """What an answer does not say, or that it says too much."""
    missing = [name for name in names if name.lower() not in seen.lower()]
    if missing:
        return f"does not name {', '.join(missing)}"
    return f"{len(seen)} characters" if len(seen) > most else ""


def answers(
    mistakes: dict[str, Mistake],
) -> Iterator[tuple[str, str, str, float]]:
    """Name, answer, what is wrong with it and seconds of each mistake, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder), warnings.catch_warnings():
        prepare(Path(folder))
        for name, mistake in mistakes.items():
            begun = time.perf_counter()
            seen, wrong = answer(mistake)
            taken = time.perf_counter() - begun
            yield name, seen, wrong or ("took too long" if taken > WAIT else ""), taken


def times(tasks: dict[str, tuple[str, ...]]) -> Iterator[tuple[str, list[float], str]]:
    """Name, seconds of clock and processors at either start, and what went wrong, of each task."""
    with tempfile.TemporaryDirectory() as folder:
        for name, script in SCRIPTS.items():
            (Path(folder) / name).write_text(script)
        environment = os.environ | {
            "PYTHONPATH": str(Path(__file__).parents[1]),
            "JAXCOMP_CACHE": f"{folder}/programs",
        }
        for name, lines in tasks.items():
            taken, wrong = [], ""
            for _ in range(2):
                begun, worked = time.perf_counter(), _worked()
                for line in lines:
                    program, *words = line.split()
                    start_of = {"jaxcomp": ["-m", "jaxcomp"], "python": []}[program]
                    done = subprocess.run(
                        [sys.executable, *start_of, *words],
                        cwd=folder,
                        env=environment,
                        capture_output=True,
                        text=True,
                        check=False,
                    )
                    wrong = f"{wrong}{done.stderr[-2000:]}" if done.returncode else wrong
                taken += [time.perf_counter() - begun, _worked() - worked]
            yield name, taken, wrong


def _worked() -> float:
    """[s] Processor time of all commands so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Print the answers, or the times of the tasks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tasks", action="store_true", help="the tasks with their times")
    parser.add_argument("--show", metavar="WORD", help="mistakes with this word, with answers")
    options = parser.parse_args()
    if options.tasks:
        failed = 0
        print("| task | first start | of the processors | second start | of the processors |")
        print("|---|---|---|---|---|")
        for name, taken, wrong in times(TASKS):
            failed += bool(wrong)
            cells = " | ".join(f"{one:.1f} s" for one in taken)
            print(f"| {name} | {cells} |{wrong and f' {wrong}'}", flush=True)
        return bool(failed)
    chosen = {n: m for n, m in MISTAKES.items() if (options.show or "") in n}
    bad, begun = 0, time.perf_counter()
    for name, seen, wrong, taken in answers(chosen):
        bad += bool(wrong)
        print(f"{'NOT ' if wrong else ''}well  {name} ({taken:.1f} s) {wrong}", flush=True)
        if wrong or options.show is not None:
            print(f"      {seen[:700]}")
    print(
        f"{len(chosen) - bad} of {len(chosen)} answered well, {time.perf_counter() - begun:.0f} s"
    )
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main())
