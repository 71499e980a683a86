"""Constants of a compressor from its rated points."""

import dataclasses
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from jaxcomp import BadInput, load
from jaxcomp.cli._app import app
from jaxcomp.cylinder import SuctionWarming
from jaxcomp.fluid import RealGas
from jaxcomp.machine import machine_of
from jaxcomp.scene import dump, loads, with_value
from jaxcomp.scene.readings import identified_scene
from jaxcomp.study import RECIPE, Parameter, Readings, fit, identify, map_recipe
from jaxcomp.study.identification._common_factor import varied
from jaxcomp.study.identification._notes import law_of_speed, notes_of
from jaxcomp.study.identification._parameter_words import in_words, with_path
from jaxcomp.study.identification._readings import with_own_factors
from jaxcomp.study.rating import QUANTITIES, rating_map

ZERO = 273.15
CLEARANCE, HEATING, FRICTION = (
    "gas.clearance_ratio",
    "gas.suction.heating",
    "crankshaft.main_journal.coefficient",
)


def points(values):
    S, D = (axis.ravel() for axis in np.meshgrid([250.0, 258.0], [313.0, 323.0], indexing="ij"))
    gas = np.full(4, 305.35)
    return Readings("made.csv", S, D, gas, gas, gas, np.full(4, np.nan), values, fluid="R600a")


@pytest.fixture(scope="module")
def machine():
    return load("r600a-8cc")


@pytest.mark.parametrize(
    ("vary", "options", "message"),
    [
        ({"motor.mean_speed": None}, {}, "vary mechanism.bore"),
        ({"gas.clearence_ratio": None}, {}, "gas.clearance_ratio"),
        ({CLEARANCE: (0.01, 0.04)}, {"prior": {HEATING: (10.0, 3.0)}}, "which are varied"),
        ({CLEARANCE: None}, {"prior": {CLEARANCE: (0.02, 0.0)}}, "positive standard deviation"),
        ({CLEARANCE: None}, {"hold_out": [4]}, "a point from 0 to 3"),
        ({CLEARANCE: None}, {"sd": {"powr": 0.01}}, "power"),
        ({CLEARANCE: None, "gas.clearance*": None}, {}, "varied once"),
        ({"motor.losses.efficiency.*": (0.5, 2.0)}, {}, "efficiency.0. must be > 0 and <= 1"),
        (
            {CLEARANCE: None, HEATING: None},
            {"hold_out": [0, 1, 2]},
            "at least 2, one for each parameter",
        ),
        ({"gas.*_valve.nothing": None}, {}, "a pattern that fits a number"),
    ],
)
def test_what_cannot_be_identified(machine, vary, options, message):
    with pytest.raises(BadInput, match=message):
        identify(machine, points({"power": np.full(4, 100.0)}), vary, **options)


def test_a_pattern_varies_a_common_factor(machine):
    design = machine_of(machine)
    one = varied(design, "gas.*_valve.port_diameter", 0.5, 2.0)
    assert (float(one.current(design)), one.unit) == (1.0, "")
    before, after = design.compressor.gas, one.apply(design, 1.2).compressor.gas
    for valve in ("suction_valve", "discharge_valve"):
        was, now = (float(getattr(gas, valve).port_diameter) for gas in (before, after))
        assert now == pytest.approx(1.2 * was, rel=1e-14)
    lists = varied(design, "motor.losses.*").apply(design, 0.9).compressor.motor.losses
    np.testing.assert_allclose(lists.efficiency, 0.9 * design.compressor.motor.losses.efficiency)


def test_machines_and_points_that_do_not_suit(machine):
    readings = points({"power": np.full(4, 100.0)})
    with pytest.raises(BadInput, match="a cylinder with valves and a real gas"):
        identify(load("mayekawa-wbhe"), readings, {"mechanism.bore": None})
    with pytest.raises(BadInput, match="R600a as the machine"):
        identify(machine, dataclasses.replace(readings, fluid="R22"), {CLEARANCE: None})
    with pytest.raises(BadInput, match="nothing measured"):
        identify(machine, points({}), {CLEARANCE: None})


def test_warming_by_losses_and_by_the_discharge_side():
    gas = RealGas("R22")
    comes = gas.state(jnp.asarray(290.0), jnp.asarray(16.0))
    flow, loss = 0.05, 600.0
    capacity = flow * float(comes.c_p)
    motor = SuctionWarming(0.0, 0.5).heat(comes, 370.0, flow, loss)
    assert float(motor) == pytest.approx(300, rel=1e-12)
    # much conductance warms to the discharge temperature, little in proportion
    most = SuctionWarming(1e3 * capacity, 0.0).heat(comes, 370.0, flow, loss)
    assert float(most) == pytest.approx(80 * capacity, rel=1e-9)
    least = SuctionWarming(1e-6 * capacity, 0.0).heat(comes, 370.0, flow, loss)
    assert float(least) == pytest.approx(80e-6 * capacity, rel=1e-5)


def test_a_template_gets_the_size_that_the_flow_wants():
    template = load("semi-hermetic-200cc")
    fluid, speed = RealGas("R22"), float(template.as_compressor().motor.speed_guess)
    s, gas = np.array([258.0, 268.0]), np.array([291.45, 291.45])
    density = [
        float(fluid.density(t, fluid.saturation(T=e).p)) for t, e in zip(gas, s, strict=True)
    ]
    flow = np.array(density) * 0.8 * 60e-6 * speed / (2 * np.pi)
    conditions = (
        s,
        np.array([313.0, 313.0]),
        gas,
        np.array([313.0, 313.0]),
        gas,
        np.full(2, np.nan),
    )
    made = map_recipe(template, Readings("map", *conditions, {"mass_flow": flow}))
    assert float(made.machine.compressor.mechanism.swept_volume) == pytest.approx(60e-6)
    assert list(made.vary) == list(RECIPE)
    assert set(made.prior) == set(RECIPE) - {"similar_swept_volume"}
    # 500 W of 200 cm3 are 151 W of 60 cm3, and no efficiency exceeds 1
    share = 60e-6 / float(template.as_compressor().mechanism.swept_volume)
    assert made.prior["motor.losses.fixed_power"][0] == pytest.approx(500 * share)
    low, high = made.vary["motor.losses.efficiency"]
    assert (low, high * 0.92 <= 1) == (0.7, True)
    # a common factor reaches as far as the recipe says
    assert made.vary["friction.*.coefficient"] == (0.05, 20.0)
    # a machine without the law of warming has one constant of it less
    plain = map_recipe(load("r600a-8cc"), Readings("map", *conditions, {"mass_flow": flow}))
    assert "gas.suction.warming.loss_share" not in plain.vary
    with pytest.raises(BadInput, match="which tells the size"):
        map_recipe(template, Readings("map", *conditions, {"power": flow}))


def test_one_program_serves_all_ranges():
    design = machine_of(load("r600a-8cc"))
    names = (CLEARANCE, "gas.*_valve.stiffness")
    first, second = (tuple(varied(design, name, *ends).without_range for name in names)
                     for ends in ((0.05, 0.06), (0.07, 0.09)))  # fmt: skip
    assert first == second
    assert hash(first) == hash(second)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--vary", "mechanism.bore=1"], "must be PATH or PATH=LO:HI"),
        (["--vary", "mechanism.bore", "--prior", "mechanism.bore=66mm"], "VALUE+-SD"),
        (["--vary", "mechanism.bore", "--fit-at", "-7/33"], "is no point of the data"),
        (["--vary", "mechanism.bore", "--fit-at", "7"], "EVAPORATING/CONDENSING"),
        (["--vary", "mechanism.bore", "--hold-out", "9"], "from 1 to 1"),
        (["--vary", "mechanism.bore", "--sd", "powr=1%"], "power"),
    ],
)
def test_a_command_that_cannot_run(tmp_path, given, message):
    file = tmp_path / "map.csv"
    heads = "evaporating [degC],condensing [degC],return_gas [degC],subcooling [K],power [W]"
    file.write_text(f"{heads}\n-5,30,18.3,0,3000\n-5,40,18.3,0,3500\n")
    result = CliRunner().invoke(
        app, ["identify", "semi-hermetic-200cc", "--data", str(file), *given]
    )
    assert result.exit_code
    assert message in " ".join(result.output.split())


@pytest.mark.slow
def test_a_machine_is_found_again_from_its_own_map(machine):
    """Four points of the machine itself, three for the fit: what was changed before comes back."""
    found = rating_map(machine, [250.0, 258.0], [313.0, 323.0], "ashrae")
    names = ("capacity", "power", "discharge_temperature")
    readings = points({name: np.asarray(found.values[name]).ravel() for name in names})
    truth = [0.02, 18.0]
    vary = {CLEARANCE: (0.01, 0.05), HEATING: (8.0, 40.0)}
    begin = load("r600a-8cc")
    off = identify(begin, readings, vary, hold_out=[1], starts=1)
    # the map has friction under the fluctuating speed, which is 1e-4 of the power, 0.01 of a deviation
    distance = np.abs(np.asarray(off.estimate) - truth)
    np.testing.assert_array_less(distance, 0.03 * np.asarray(off.standard_error))
    assert off.held_out["power"].largest < 1e-3
    assert off.held_out["capacity"].inside == 1
    again = identified_scene(machine, off)
    assert "identified from made.csv" in again.text or "identified from made.csv" in str(
        again.document
    )


def test_an_identified_machine_says_what_it_is_and_no_longer_what_it_began_as():
    template = load("semi-hermetic-200cc")
    found = SimpleNamespace(
        parameters=(CLEARANCE,),
        constants=1,
        estimate=[0.04],
        standard_error=[0.002],
        prior_share=[0.3],
        units=("",),
        source="map.csv",
    )
    scene = with_value(template, "gas.fluid.name", "R134a")
    identified = identified_scene(scene, found)
    words = "Identified from map.csv, beginning with semi-hermetic-200cc, with R134a"
    assert identified.description == words
    assert loads(dump(identified)).description == words
    assert "unknown valves" not in identified.description


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("gas.suction_valve.flow_coefficient", "flow coefficient of the suction valve"),
        ("gas.*_valve.stop", "stop of both valves"),
        ("gas.clearance_ratio", "clearance"),
        ("rotor.shafts.3.young_modulus", "rotor.shafts.3.young_modulus"),
    ],
)
def test_constants_go_by_the_words_of_an_engineer(path, words):
    assert in_words(path) == words


def test_every_constant_of_the_recipe_has_words():
    for path in RECIPE:
        assert in_words(path) != path
        assert with_path(path).endswith(f" ({path})")


def at_speeds(speeds, **values):
    count = len(speeds)
    S, D, gas = (np.full(count, t) + np.arange(count) for t in (250.0, 313.0, 305.35))
    return Readings("map", S, D, gas, D, gas, np.array(speeds, float), values, fluid="R600a")


def test_flow_and_power_have_factors_of_their_own_at_further_speeds(machine, monkeypatch):
    first, second = with_own_factors([
        at_speeds([300.0, 300.0], power=np.ones(2)), at_speeds([300.0, 450.0], power=np.ones(2)),
    ])  # fmt: skip
    assert first.nuisances == ()
    assert [one.name for one in second.nuisances] == [
        "flow_factor at 71.62 1/s", "power_factor at 71.62 1/s",
    ]  # fmt: skip
    plain = dict.fromkeys(("capacity", "power", "mass_flow", "cop", "discharge_temperature"), 10.0)
    row = jnp.array([plain.get(name, 1.0) for name, *_ in QUANTITIES])
    monkeypatch.setattr(
        "jaxcomp.study.identification._readings.rated", lambda *_: (row, jnp.asarray(True))
    )
    where, own = second.points(machine_of(machine))
    for n, factors in enumerate([(1.0, 1.0), (1.1, 0.8)]):
        point = type(where)(*(x[n] for x in where)), own[n]
        values, ok = second.at(machine_of(machine), jnp.array([1.1, 0.8]), point)
        said = dict(zip((name for name, *_ in QUANTITIES), values, strict=True))
        assert ok
        assert said["capacity"] == pytest.approx(10 * factors[0])
        assert said["mass_flow"] == pytest.approx(10 * factors[0])
        assert said["power"] == pytest.approx(10 * factors[1])
        assert said["cop"] == pytest.approx(10 * factors[0] / factors[1])
        assert said["discharge_temperature"] == 10
    with pytest.raises(BadInput, match="two at least"):
        with_own_factors([at_speeds([300.0, 300.0], power=np.ones(2))])


def test_a_law_of_speed_that_does_not_fit_is_said():
    """Flow over the speed by a law without its exponent: off by as much at either end."""
    speeds = np.repeat([200.0, 300.0, 400.0], 3)
    given = at_speeds(speeds, power=(speeds / 300) ** 1.2)
    entries = given.entries({})

    def said(exponent):
        def model(p):
            value = p[0] * (speeds / 300) ** exponent
            return value, value[:, None] / p[0]

        found = fit(model, [Parameter("size", 0.5, 2.0, 1.0)], entries.measured, entries.sd)
        return list(law_of_speed(found, entries))

    (words,) = said(1.0)
    assert words.startswith("the law of speed does not fit: power is off by +")
    assert "at 31.83 1/s" in words
    assert said(1.2) == []


def test_a_constant_that_touches_nothing_measured_is_named():
    given = at_speeds([300.0, 300.0, 300.0], power=np.full(3, 2.0))

    def model(p):
        return np.full(3, p[0]), np.stack([np.ones(3), np.zeros(3)], axis=-1)

    entries = given.entries({})
    parameters = [Parameter("size", 0.5, 5.0, 1.0), Parameter("spring", 0.5, 2.0, 1.0, 1.0, 0.1)]
    found = fit(model, parameters, entries.measured, entries.sd)
    blocks = SimpleNamespace(entries=entries, measurements=[given])
    words = list(notes_of(found, blocks, found.value))
    assert "spring touches nothing that was measured" in words
    assert not any(one.startswith("size touches") for one in words)
