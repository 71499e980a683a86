"""One registry of quantities and one language of paths, seen from every place that uses them."""

import jax
import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import BadInput, load, problem, register_quantity, solve_orbit, sweep
from jaxcomp._core import registry as registry
from jaxcomp._core.declared import tree_of, without_units
from jaxcomp._core.display import shown
from jaxcomp.cli import app
from jaxcomp.cli._options import complete_quantity
from jaxcomp.cli._output import result_files
from jaxcomp.cli._run import RunSettings
from jaxcomp.cli._run_tables import run_tables
from jaxcomp.scene import SceneError, with_values
from jaxcomp.study import available_quantities, steady_state, variable
from jaxcomp.study._variables import by_name, matching

FAST = ["--accuracy", "coarse"]


def invoke(*arguments):
    result = CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "160"})
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture
def friction_share(monkeypatch):
    """A quantity of the user, for this test alone."""
    monkeypatch.setattr(registry, "_registered", dict(registry._registered))
    return register_quantity(
        "friction_share",
        lambda result: result.orbit.friction_power / result.orbit.gas_power,
        better="less",
        doc="Friction power over indicated power.",
        percent=True,
    )


@pytest.fixture(scope="module")
def mayekawa():
    return load("mayekawa-wbhe")


def test_a_quantity_that_is_registered_once_is_seen_everywhere(friction_share, mayekawa, tmp_path):
    """In run with its report, completion and list, in the unit that people use."""
    orbit = solve_orbit(mayekawa.as_compressor())
    share = float(orbit.friction_power / orbit.gas_power)
    percent = f"{100 * share:.2f} %"
    assert dict(complete_quantity("friction_s")) == {"friction_share": friction_share.doc}
    assert available_quantities(mayekawa.machine)["friction_share"] == friction_share
    assert [float(one.values) for one in orbit.described() if one.name == "friction_share"] == [
        pytest.approx(share, rel=1e-14)
    ]
    assert percent in invoke("run", "mayekawa-wbhe")
    words = {"machine": "m", "set": {}, "design": {}}
    tree = (
        tree_of(words) | tree_of(RunSettings(1e-8)) | tree_of(steady_state(mayekawa, orbit=orbit))
    )
    tables = run_tables(mayekawa, without_units(tree))
    files = result_files("m", {}, tree, mayekawa, tables)
    report = files["report.html"].decode()
    assert percent.replace(" ", "&nbsp;") in report  # a number and its unit stand on one line
    assert "Friction share" in report
    written = read_json(files["result.json"].decode())
    assert written["friction_share"] == pytest.approx(share, rel=1e-14)
    assert "Friction power over indicated power." in invoke("list", "--quantities")


def test_a_registered_quantity_of_the_design_is_swept_and_optimised(friction_share, mayekawa):
    """Beside one of the orbit; that built in ones of the orbit are swept is seen elsewhere."""
    del friction_share  # which puts the registry back
    shape = register_quantity(
        "throw_share",
        lambda result: (
            result.design.compressor.mechanism.crank_radius
            / result.design.compressor.mechanism.bore
        ),
        better="less",
        doc="Crank radius over bore.",
        percent=True,
    )
    assert available_quantities(mayekawa.machine)["throw_share"] == shape
    mechanism = mayekawa.machine.compressor.mechanism
    percent = f"{100 * float(mechanism.crank_radius / mechanism.bore):.4g}"
    over = ("--over", "bore_at_displacement=120mm,130mm", "--quantity", "throw_share")
    text = invoke("sweep", "mayekawa-wbhe", *over, *FAST)
    assert "Throw share, %" in text
    assert percent in text  # the second bore is that of the machine
    text = invoke(
        "optimise", "mayekawa-wbhe", "--variable", "bore_at_displacement=120mm:130mm", "--objective",
        "throw_share", *FAST, "--starts", 1, "--steps", 2, "--samples", 4,
    )  # fmt: skip
    assert "lowest throw share" in text
    assert percent in text  # of the present design


def test_names_that_cannot_be_registered_are_refused(friction_share, monkeypatch):
    def value(result):
        return result.orbit.margin

    for name, words, options in (
        ("motor_power", "built in", {}),
        ("two words", "letters, digits", {}),
        ("a", '"more", "less"', {"better": "higher"}),
        ("a", "unit", {"unit": "W", "percent": True}),
    ):
        with pytest.raises(BadInput, match=words):
            register_quantity(name, value, **options)
    # programs with the first meaning are let go; here only the call is seen, the other tests need theirs
    forgotten = []
    monkeypatch.setattr(jax, "clear_caches", lambda: forgotten.append(True))
    again = register_quantity("friction_share", value)
    assert forgotten == [True]
    assert registry.registered_quantity("friction_share") == again != friction_share


@pytest.mark.slow
def test_a_name_that_is_registered_anew_is_compiled_anew(friction_share, mayekawa):
    def first():
        return float(sweep(mayekawa, {"bore_at_displacement": [0.12]}, ["friction_share"], progress=False)
                     .friction_share[0])  # fmt: skip

    before = first()
    register_quantity("friction_share", lambda r: 2 * r.orbit.friction_power / r.orbit.gas_power)
    assert first() == pytest.approx(2 * before, rel=1e-12)


def test_efficiencies_and_fluctuations_are_shown_in_per_cent():
    for name in ("mechanical_efficiency", "speed_fluctuation", "mean.mechanical_efficiency"):
        assert shown(name, "", 0.9).text(0.9) == "90 %"
    assert shown("joint_margin", "", 0.9).text(0.9) == "0.9"
    assert shown("motor_power", "W", 5000.0).label == "Shaft power, kW"


def test_one_language_of_paths(mayekawa):
    """The same names in `problem`, `sweep`, `with_values` and on the command line."""
    coefficients = matching(mayekawa.machine, "friction.*.coefficient")
    assert coefficients == [f"friction.{joint}.coefficient" for joint in
                            ("wall", "piston_pin", "crank_pin")]  # fmt: skip
    made = problem(mayekawa, ["bore_at_displacement", "friction.*.coefficient"], ["swept_volume"])
    assert [one.name for one in made.variables] == ["bore_at_displacement", *coefficients]
    given = by_name(mayekawa.machine, {"friction.*.coefficient": 1, "friction.wall.coefficient": 2})
    assert list(given.values()) == [2, 1, 1]  # the last that fits counts
    changed = with_values(
        mayekawa, {"friction.*.coefficient": 0.1, "bore_at_displacement": "120 mm"}
    )
    values = [
        float(variable(changed.machine, name).current(changed.machine)) for name in made_names(made)
    ]
    assert values == [pytest.approx(0.12), *[0.1] * 3]
    assert changed.sources["mechanism.bore"] == "design rule, bore_at_displacement = 120 mm"
    once = sweep(mayekawa, {"mechanism.bor?": [0.1, 0.13]}, ["swept_volume"], progress=False)
    assert once.dims == ("mechanism.bore",) or list(once.dims) == ["mechanism.bore"]


def made_names(made):
    return [one.name for one in made.variables]


def test_a_correction_mass_is_set_like_any_other_number():
    scene = load("hermetic-68cc")
    plane = next(iter(scene.machine.corrections))
    masses = {f"corrections.{plane}.x": "3 g*mm", f"corrections.{plane}.y": "-1 g*mm"}
    changed = with_values(scene, {**masses, "mechanism.piston_mass": "0.1 kg"})
    np.testing.assert_allclose(changed.machine.corrections[plane], [3e-6, -1e-6], rtol=1e-12)
    later = with_values(changed, {"mechanism.piston_mass": "0.12 kg"})
    np.testing.assert_allclose(later.machine.corrections[plane], [3e-6, -1e-6], rtol=1e-12)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("bor", 'did you mean "mechanism.bore", the bore alone, or "bore_at_displacement"'),
        ("mechanism.boar", 'did you mean "bore"'),
        ("friction.*.coeficient", 'did you mean "friction'),
        ("corrections.top.x", "corrections.top.x"),
    ],
)
def test_an_unknown_path_names_the_nearest(mayekawa, path, words):
    with pytest.raises((BadInput, SceneError), match=words):
        with_values(mayekawa, {path: "120 mm"})
