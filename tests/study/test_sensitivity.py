"""Sensitivities: every number of a machine, with the derivatives that single variables have."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import (
    BadInput,
    Collocation,
    Compressor,
    Machine,
    Shooting,
    load,
    loads,
    problem,
    sensitivity,
    solve_orbit,
)
from jaxcomp.cli import app
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import Cylinder, DischargeLine, SuctionLine
from jaxcomp.fluid import PerfectGas
from jaxcomp.machine import machine_of
from jaxcomp.motor import ConstantSpeed
from jaxcomp.plot import sensitivity_bars
from jaxcomp.scene import with_values
from jaxcomp.study import AnalysisOptions, _sensitivity
from jaxcomp.study._labels import variable_label


def logarithms(found):
    """A number to which every entry of a design contributes, whatever its size and sign."""
    leaves = [x for x in jax.tree.leaves(found.design) if jnp.issubdtype(x.dtype, jnp.floating)]
    return sum(jnp.sum(jnp.log1p(x**2) + x / (1 + x**2)) for x in leaves)


def test_derivatives_are_those_of_the_single_variables():
    scene = load("hermetic-68cc")
    found = sensitivity(scene, [logarithms])
    assert found.ok
    assert len(set(found.numbers)) == len(found.numbers) > 150
    assert np.count_nonzero(found.derivative) > 0.9 * len(found.numbers)
    some = slice(None, None, 12)  # each of them takes its time to trace
    names = list(found.numbers[some])
    assert {"corrections.rotor-top.x", "loads.unbalances.0.magnitude.0"} <= set(found.numbers)
    made = problem(scene, names, [logarithms])
    expected = jax.jit(jax.grad(lambda x: made(x).values[0]))(made.current)
    # a column that stands for all rows is a common factor among the variables
    factor = np.asarray(made.current) != found.present[some]
    assert factor.any()
    given = found.derivative[0, some] * np.where(factor, found.present[some], 1.0)
    # sums of products of the same numbers, in another order
    np.testing.assert_allclose(given, expected, rtol=1e-9, atol=1e-12)


@pytest.fixture(scope="module")
def swept():
    return sensitivity(load("mayekawa-wbhe"), ["swept_volume"])


def test_elasticities_of_the_swept_volume_are_its_exponents(swept):
    ranked = swept.ranking("swept_volume")
    assert [(one.number, round(one.elasticity, 9)) for one in ranked] == [
        ("mechanism.bore", 2.0),
        ("mechanism.crank_radius", 1.0),
    ]
    assert ranked[0].part == "bore"
    assert (ranked[0].value, ranked[0].change) == ("130 mm", "+2 % per %")
    for text in ("Swept volume", "bore 130 mm", "+2 % per %"):
        assert text in repr(swept)


def test_a_number_that_is_zero_is_changed_by_one_unit(swept):
    place = swept.numbers.index("mechanism.offset")
    assert np.isnan(swept.elasticity[0, place])

    def offset(found):
        return 3.0 * found.design.compressor.mechanism.offset + 1.0

    (one,) = sensitivity(load("mayekawa-wbhe"), [offset]).ranking("offset")
    assert not one.relative
    assert (one.value, one.change) == ("0 mm", "+0.003 per mm")


def test_a_temperature_is_changed_by_a_kelvin():
    """One per cent of 305 K means nothing; of a difference of 23 K it does."""

    def warm(found):
        line = found.design.compressor.gas.suction
        return line.temperature + 2 * line.heating

    level, rise = sensitivity(load("r134a-7cc"), [warm]).ranking("warm")[::-1]
    assert (level.number, level.change) == ("gas.suction.temperature", "+1 per K")
    assert rise.number == "gas.suction.heating"
    assert rise.relative


def test_the_table_has_every_number_with_its_unit(swept):
    table = swept.to_pandas().set_index("number")
    assert table.loc["mechanism.bore", "unit"] == "m"
    assert table.loc["mechanism.bore", "present"] == 0.13
    assert table.loc["mechanism.bore", "elasticity.swept_volume"] == pytest.approx(2.0)
    assert swept.to_xarray().sizes["number"] == len(swept.numbers) == len(table)


def test_an_unknown_quantity_is_answered(swept):
    with pytest.raises(BadInput, match="swept_volume"):
        sensitivity(load("mayekawa-wbhe"), ["swept_volum"])
    with pytest.raises(BadInput, match="one of swept_volume"):
        swept.ranking("motor_power")


def test_bars_name_parts_values_and_directions(swept):
    ax = swept.plot.sensitivity_bars(title="WBHE").axes[0]
    assert [text.get_text() for text in ax.get_yticklabels()] == [
        "bore, 130 mm",
        "crank radius, 49.988 mm",
    ]
    assert [bar.get_width() for bar in ax.patches] == pytest.approx([2.0, 1.0])
    assert "1 %" in ax.get_xlabel()
    with pytest.raises(BadInput, match="one of swept_volume"):
        sensitivity_bars(swept, "motor_power")


def test_a_rotor_without_a_crank_is_rotor_excitation_its_unbalances():
    text = CliRunner().invoke(app, ["new", "-", "--kind", "rotor"]).stdout
    design = loads(text).machine
    made = problem(design, ["rotor.disks.0.mass.0"], ["vibration"])  # traces what it asks for
    assert made.units == ("m",)
    assert variable_label(design, "corrections.rotor.x") == "x of correction rotor"


def test_the_command_writes_what_it_prints(tmp_path):
    asked = ["sensitivity", "mayekawa-wbhe", "--quantity", "swept_volume"]
    done = CliRunner().invoke(app, [*asked, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    for text in ("1327", "bore", "+2 % per %", "other numbers of the machine have"):
        assert text in done.output
    result = read_json((tmp_path / "result.json").read_text())
    first = result["quantities"][0]["numbers"][0]
    assert (first["name"], first["elasticity"]) == ("mechanism.bore", pytest.approx(2.0))
    names = {"report.html", "sensitivity-swept_volume.png", "sensitivity.csv", "machine.toml"}
    assert names <= {path.name for path in tmp_path.iterdir()}
    done = CliRunner().invoke(app, ["sensitivity", "mayekawa-wbhe", "--quantity", "powr"])
    assert done.exit_code == 2
    assert "quantity" in done.output


@pytest.mark.slow  # half a minute: two sizes of derivatives are compiled
def test_stated_errors_of_derivatives_hold():
    scene = load("mayekawa-wbhe")
    stated = sensitivity(scene, ["mechanical_efficiency"], verify=True)
    options = AnalysisOptions(solver=Collocation(nodes=24, reversals=4))
    tight = sensitivity(scene, ["mechanical_efficiency"], options=options)
    deviation = np.abs(stated.derivative - tight.derivative)
    # an error is stated within a factor of thirty; below a share of the value it is rounding
    rounding = 1e-11 * np.abs(stated.derivative)
    assert np.all(deviation <= 30 * stated.derivative_error + rounding)
    # and it is an error, not a bound that is always true: of an elasticity below 1e-6
    share = stated.derivative_error[0] * np.abs(stated.present) / stated.value[0]
    assert 0 < np.max(share) < 1e-6
    influence = stated.ranking("mechanical_efficiency")[0]
    assert influence.error_share == pytest.approx(influence.error / abs(influence.derivative))
    assert "error" in stated.entries()["quantities"][0]["numbers"][0]


def test_errors_of_derivatives_are_refused_where_nothing_has_nodes():
    scene = load("hermetic-68cc")
    loads_of_films = {f"rotor.links.{n}.law.load": ["400 N", "40 N"] for n in (0, 1, 2)}
    scene = with_values(scene, loads_of_films)
    machine = machine_of(scene)
    rotor_alone = eqx.tree_at(lambda m: m.compressor, machine, None)
    with pytest.raises(BadInput, match="machine without a crank"):
        sensitivity(rotor_alone, ["vibration"], verify=True)
    options = AnalysisOptions(solver=Shooting())
    with pytest.raises(BadInput, match="given with collocation"):
        sensitivity(load("mayekawa-wbhe"), options=options, verify=True)


def reeds_of_many_events():
    """The reeds of `r290-6cc` on a perfect gas and at a held speed: programs a third as large.

    At 2400 rpm they touch seats and stops more often than the smallest size of the cycle has room for.
    """
    bundled = load("r290-6cc").compressor
    gas = Cylinder(
        PerfectGas(188.6, 1.13),
        SuctionLine(2.17e5, 323.0),
        DischargeLine(18.8e5),
        *bundled.gas.valves,
        bundled.gas.clearance_ratio,
    )
    shaft = Crankshaft(bundled.crankshaft.inertia)
    return Compressor(bundled.mechanism, shaft, ConstantSpeed(2400 * np.pi / 30), gas)


# Compiles the derivative of a machine with valves in two sizes.
@pytest.mark.slow
def test_a_machine_with_many_events_of_its_valves_has_derivatives(monkeypatch):
    compressor = reeds_of_many_events()
    fits = []

    def recorded(problem):
        solution = solved(problem)
        fits.append(bool(solution.events < 0))
        return solution

    solved = _sensitivity._solved
    monkeypatch.setattr(_sensitivity, "_solved", recorded)
    slopes = sensitivity(Machine(compressor), ["gas_power"])
    assert fits == [False, True]
    assert slopes.ok
    place = slopes.numbers.index("mechanism.crank_radius")
    step = 1e-4 * slopes.present[place]

    def power(radius):
        machine = eqx.tree_at(
            lambda compressor: compressor.mechanism.crank_radius, compressor, radius
        )
        return float(solve_orbit(machine).gas_power)

    radius = slopes.present[place]
    difference = (power(radius + step) - power(radius - step)) / (2 * step)
    # by default options; differences of values known to 1e-8 with steps of 1e-4
    assert slopes.derivative[0, place] == pytest.approx(difference, rel=1e-3)
