"""`accuracy --study extremes`: values with errors, or a status that names what is wrong."""

import json

import numpy as np
import pytest
from helpers import briefly_timed
from typer.testing import CliRunner

from jaxcomp import BadInput, Collocation, load, load_result, solve_orbit
from jaxcomp.cli import app
from jaxcomp.cli._accuracy import extremes_tables
from jaxcomp.plot._accuracy import extreme_errors
from jaxcomp.study.accuracy import extremes
from jaxcomp.study.accuracy._extremes import FAMILIES, WITH_VALVES, scaled


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        briefly_timed(patch)
        return extremes(load("mayekawa-wbhe"), ["near locking", "steep rod", "near stall"])


@pytest.fixture(scope="module")
def cases(found):
    return found.cases


def test_errors_are_told_up_to_the_edge_and_locking_is_named(cases):
    locking = {case.setting: case for case in cases if case.family == "near locking"}
    margins = [case.margin for case in locking.values()]
    assert margins == sorted(margins, reverse=True)
    for case in locking.values():
        if case.margin <= 0:
            assert "the friction locks the joints" in case.status
            assert not np.isfinite(case.error)
    assert not locking["coefficients x 64"].good
    # a margin of a quarter is still solved to rounding of the march
    close = locking["coefficients x 32"]
    assert close.good
    assert 0 < close.margin < 0.5
    assert close.error < 1e-6


def test_error_that_the_march_tells_is_that_beside_many_nodes(cases):
    steep = next(case for case in cases if case.setting == "r/l = 0.95")
    machine = load("mayekawa-wbhe").compressor
    changed = dict(FAMILIES["steep rod"].machines(machine))["r/l = 0.95"]
    fine = solve_orbit(changed, Collocation(nodes=24, estimate=False))
    true = abs(steep.value - float(fine.mechanical_efficiency))
    # eight nodes on a rod that turns within a few degrees: some 1e-5
    assert 1e-7 < true < 1e-4
    # the march begins at a speed that is off by 4e-5 itself
    assert steep.error == pytest.approx(true, rel=0.5)


def test_milder_cases_have_smaller_errors(cases):
    for family in ("steep rod", "near stall"):
        errors = [case.error for case in cases if case.family == family]
        assert len(errors) == 5
        assert all(np.isfinite(errors))
        assert errors[0] < 0.1 * errors[-1], family


def test_table_picture_and_result_have_every_case(found, cases, tmp_path):
    table, _, *words = extremes_tables(found)
    assert table.row_count == len(cases)
    assert len(words) == sum(not case.good for case in cases) > 0
    result = found.entries()
    assert json.dumps(result, allow_nan=False)
    assert [row["setting"] for row in result["rows"]] == [case.setting for case in cases]
    labels = [t.get_text() for t in extreme_errors(found).axes[0].get_yticklabels()]
    assert len(labels) == len(cases)
    columns = found.columns()
    assert columns["setting"].tolist() == [case.setting for case in cases]
    assert columns["seconds [s]"].tolist() == [case.seconds for case in cases]
    found.save(tmp_path / "extremes.npz")
    assert load_result(tmp_path / "extremes.npz").cases == cases


def test_parts_that_are_absent_have_no_cases():
    # Coulomb joints without films, and no rotor
    assert extremes(load("mayekawa-wbhe"), ["thin film", "near-singular response"]).cases == ()


def test_a_machine_without_valves_has_no_cycles_at_extremes():
    scene = load("mayekawa-wbhe")
    assert extremes(scene, WITH_VALVES).share_with_valves is None


@pytest.mark.slow  # sizes of the cycle's program, and the march
def test_cycles_with_valves_are_solved_at_extremes_and_told_with_errors():
    found = extremes(load("r134a-7cc"), WITH_VALVES)
    assert found.share_with_valves == (12, 12)
    for case in found.cases:
        # the march is at 1e-9 a step, and the smallest size of collocation states 1e-5
        assert case.error < 1e-5, case
        assert 0 < case.value < 1
    words = "".join(word for word in extremes_tables(found) if isinstance(word, str))
    assert "12 of 12" in words


def test_numbers_of_both_valves_are_multiplied_and_of_nothing_else():
    machine = load("r134a-7cc").compressor
    changed = dict(FAMILIES["hard springs"].machines(machine))["stiffness of valves x 4"]
    for valve in ("suction_valve", "discharge_valve"):
        before, after = getattr(machine.gas, valve), getattr(changed.gas, valve)
        np.testing.assert_allclose(after.stiffness, 4 * before.stiffness)
        assert float(after.mass) == float(before.mass)


def test_unknown_families_are_refused():
    with pytest.raises(BadInput, match="near stall"):
        extremes(load("mayekawa-wbhe"), ["steep"])


def test_only_the_numbers_named_are_multiplied():
    friction = load("mayekawa-wbhe").compressor.friction
    twice, count = scaled(friction, ".coefficient", 2.0)
    assert count == 3
    assert float(twice.wall.coefficient) == 2 * float(friction.wall.coefficient)
    assert float(twice.crank_pin.diameter) == float(friction.crank_pin.diameter)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mayekawa-wbhe", "slider-link-8cc", "hermetic-68cc"])
def test_every_bundled_machine_ends_in_a_value_or_in_words(name):
    found = extremes(load(name)).cases
    assert {case.family for case in found} <= set(FAMILIES)
    for case in found:
        assert case.status
        assert np.isfinite(case.value)
        if case.good:
            assert case.error < 1e-3, case
        else:
            assert not np.isfinite(case.error)
    motors = [case for case in found if case.family == "stiff motor"]
    assert len(motors) == 4
    assert all(case.good for case in motors)
    if name == "hermetic-68cc":
        responses = [case for case in found if case.family == "near-singular response"]
        assert len(responses) == 4
        # at a resonance the displacement grows as damping goes
        assert responses[-1].value > 1.1 * responses[0].value


def test_command_refuses_a_quantity():
    result = CliRunner().invoke(
        app, ["accuracy", "mayekawa-wbhe", "--study", "extremes", "--quantity", "x"]
    )
    assert result.exit_code == 2
    assert "--quantity x: has no meaning" in result.stderr
