"""Numbers in the units in which people speak of them: temperatures and their differences."""

import numpy as np
import pytest

from jaxcomp._core.display import SYSTEMS, Shown, shown
from jaxcomp.cli._arguments import si
from jaxcomp.cli._map import axis
from jaxcomp.cli._start import CommandError
from jaxcomp.cli._sweep import axis_values
from jaxcomp.cli._tables import comparison_table
from jaxcomp.scene import SceneError
from jaxcomp.scene._units import to_si
from jaxcomp.scene.tolerances import read_tolerance
from jaxcomp.study import Comparison
from jaxcomp.study._compared import ComparedQuantity
from jaxcomp.study._sensitivity import Influence

ROOM = shown("gas.suction.temperature", "K", 305.35)
RISE = shown("gas.suction.superheat", "K", 10.0)


def test_a_temperature_stands_in_celsius_beside_kelvins():
    """In texts, cells and heads; an axis has degrees Celsius alone."""
    assert ROOM.text(305.35) == "305.35 K (32.2 °C)"
    assert ROOM.number(305.35) == "305.35 (32.2)"
    assert ROOM.units == "K (°C)"
    assert ROOM.label == "Gas suction temperature, K (°C)"
    assert ROOM.drawn.label == "Gas suction temperature, °C"
    np.testing.assert_allclose(ROOM.drawn.of(np.array([273.15, 305.35])), [0, 32.2], atol=1e-12)


def test_the_growth_of_a_mode_is_no_speed_of_rotation():
    """The real part of an eigenvalue: -3 in a second, and not -28.6 turns in a minute."""
    assert shown("growth", "rad/s", -3.0).text(-3.0) == "-3 1/s"
    assert shown("speed", "rad/s", np.pi).text(np.pi) == "30 rpm"


def test_a_difference_of_temperatures_has_no_zero():
    """Neither a superheat nor a deviation of a temperature."""
    assert RISE.text(10.0) == "10 K"
    assert RISE.label == "Gas suction superheat, K"
    assert ROOM.difference(0.5) == "0.5 K"
    looks = [shown("evaporating", "K", 250.0, system) for system in SYSTEMS]
    assert [look.difference(5.0) for look in looks] == ["5 K", "5 °C", "9 °F"]
    assert [look.text(249.85) for look in looks] == ["249.85 K (-23.3 °C)", "-23.3 °C", "-9.94 °F"]


def test_temperatures_are_compared_by_their_difference():
    """A share of an absolute temperature means nothing."""
    rows = (
        ComparedQuantity("discharge_temperature", "K", (400.0, 404.0)),
        ComparedQuantity("capacity", "W", (400.0, 404.0)),
    )
    change = list(comparison_table(Comparison(("First", "Second"), rows)).columns[-1].cells)
    assert change == ["+4.00 K", "+1.00 %"]


def test_sensitivity_of_a_temperature_is_in_kelvins():
    """Per cent of the number, or kelvin of a temperature; per cent stay for others."""
    look = shown("discharge_temperature", "K", 400.0)
    of_speed = Influence("n", "speed", "rad/s", 300.0, 0.15, 0.2, look)
    assert of_speed.change == "+0.6 K per %"  # 0.2 K/(rad/s) times 1 % of 300 rad/s
    of_wall = Influence("wall_temperature", "wall", "K", 370.0, np.nan, 0.47, look)
    assert of_wall.change == "+0.47 K per K"
    power = Influence("n", "speed", "rad/s", 300.0, 0.15, 0.2, Shown("Power", "W", 1.0))
    assert power.change == "+0.15 % per %"


@pytest.mark.parametrize(
    "text",
    ["-23.3 degC", "-23.3 °C", "-23.3 C", "-9.94 degF", "-9.94°F", "249.85 K", "-23.3 celsius"],
)
def test_every_option_reads_a_temperature(text):
    """`--set`, `--over`, `--variable`, `--constraint`, `--prior` and the points of a map."""
    for option in ("--over gas.suction.temperature", "--prior gas.wall_temperature", "evaporating"):
        assert si(text, "K", option) == pytest.approx(249.85, abs=1e-9)
    assert to_si(text, "K", "gas.suction.evaporating") == pytest.approx(249.85, abs=1e-9)
    option = f"--over gas.suction.temperature={text}"
    assert axis_values(text, "K", option, False) == [pytest.approx(249.85, abs=1e-9)]
    np.testing.assert_allclose(axis(f"{text},300 K", "evaporating"), [249.85, 300], atol=1e-9)


def test_temperatures_of_a_map_are_in_celsius_unless_said():
    """Bare numbers, a unit behind the last, and Fahrenheit."""
    np.testing.assert_allclose(axis("-30:-10:3", "evaporating"), [243.15, 253.15, 263.15])
    np.testing.assert_allclose(axis("-22:14 degF:2", "evaporating"), [243.15, 263.15])
    for wrong in ("-200", "400 K,900 K", "-30:-10:101", "warm"):
        with pytest.raises((CommandError, SceneError)):
            axis(wrong, "condensing")


@pytest.mark.parametrize("text", ["5 degC", "5 °C", "9 degF"])
def test_a_difference_refuses_a_temperature(text):
    """With the word and what to write: superheat, tolerance, deviation of samples and of a prior."""
    option = "--over gas.suction.temperature"
    for read in (
        lambda: to_si(text, "K", "gas.suction.superheat"),
        lambda: read_tolerance(f"+-{text}", "K", "gas.suction.temperature"),
        lambda: si(text, "K", "--prior gas.suction.temperature", difference=True),
        lambda: axis_values(f"normal:30degC:{text}", "K", option, True),
    ):
        with pytest.raises(SceneError, match='difference of temperatures is needed; write "5 K"'):
            read()
    assert to_si("9 delta_degF", "K", "gas.suction.superheat") == pytest.approx(5.0)
