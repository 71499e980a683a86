"""Entries of the wrong kind end in a sentence that names them, where the file is read."""

import re
from importlib.resources import files

import numpy as np
import pytest

from jaxcomp import load, solve_orbit
from jaxcomp._core.display import shown
from jaxcomp._core.errors import BadInput
from jaxcomp.compressor import Compressor
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import ConstantSpeed
from jaxcomp.scene import SceneError, loads, with_values

STAGED = files("jaxcomp").joinpath("machines/two-stage-crosshead.toml").read_text()
BEARING = "[[crankshaft.main_journal.bearings]]"


@pytest.mark.parametrize("value", ["[]", '["50 mm"]', '["50 mm", "40 mm", "30 mm"]'])
def test_a_list_in_a_row_of_sections_is_named(value):
    head, first, rest = STAGED.partition(BEARING)
    changed = head + first + re.sub(r"diameter = .*", f"diameter = {value}", rest, count=1)
    with pytest.raises(SceneError, match=r"bearings\.0\.diameter = .* must be a single value"):
        loads(changed)


def test_an_empty_list_is_no_number_of_a_single_cylinder():
    with pytest.raises(SceneError, match=r"mechanism\.piston_mass = \[\]"):
        with_values(load("mayekawa-wbhe"), {"mechanism.piston_mass": []})
    given = dict.fromkeys(("bore", "crank_radius", "conrod_length"), 0.1)
    rod = SliderCrank(**given | {"conrod_length": 0.4}, piston_mass=[], conrod_mass=1.0)
    with pytest.raises(BadInput, match=r"mechanism\.piston_mass"):
        Compressor(rod, Crankshaft(0.1), ConstantSpeed(100.0))


def test_rows_of_sections_are_set_at_once():
    plenum = {"volume": "20 cm^3", "neck_length": "30 mm", "neck_diameter": "6 mm"}
    scene = with_values(load("r134a-7cc"), {"gas.suction.plenums": [plenum]})
    assert float(scene.compressor.gas.suction.plenums[0].volume) == pytest.approx(2e-5)


@pytest.mark.parametrize("springs", [1, 4])
def test_springs_of_a_crank_train_are_counted_when_it_is_read(springs):
    stiffness = ", ".join(["2e6"] * springs)
    train = f'[torsion]\ninertia = [1]\nstiffness = {{ value = [{stiffness}], unit = "N m/rad" }}\n'
    train = train.replace("[1]", '["1 kg m^2"]')
    with pytest.raises(SceneError, match=r"torsion\.stiffness.*2 values, one a spring"):
        loads(f"{STAGED}\n{train}")


def test_without_friction_at_constant_speed_the_efficiency_is_one():
    machine = with_values(load("mayekawa-wbhe"), {"friction": None})
    speed = machine.compressor.motor.speed_guess
    here = machine.compressor
    held = Compressor(here.mechanism, Crankshaft(0.1), ConstantSpeed(speed), here.gas)
    assert float(solve_orbit(held).mechanical_efficiency) == 1.0


def test_zero_has_no_sign():
    assert shown("motor_power", "W", np.array(-0.0)).text(-0.0) == "0 W"
