"""Solvers and their options by name, the same for every command."""

import diffrax
import numpy as np
import pytest

from jaxcomp import Collocation, Shooting, load, respond
from jaxcomp.cli._options import (
    analysis_options,
    chosen_solver,
    cycle_of,
    solver_of,
    with_cycle,
)
from jaxcomp.cli._start import CommandError
from jaxcomp.cylinder import CycleOptions
from jaxcomp.study import ModalTest, Readings, Table
from jaxcomp.study.rating import rating_map


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


def test_a_solver_of_diffrax_is_named_with_its_tolerance(scene):
    compressor = scene.as_compressor()
    assert solver_of("collocation:16", compressor).nodes == 16
    plain = solver_of("shooting", compressor)
    assert isinstance(plain.solver, diffrax.Tsit5)
    assert plain.reversals == compressor.load_reversals
    stiff = solver_of("Kvaerno5:1e-8", compressor)
    assert isinstance(stiff.solver, diffrax.Kvaerno5)
    assert stiff.tolerance == 1e-8
    for wrong in ("Foo", "Tsit5:2", "Tsit5:x", "Euler", "collocation:1", "diffeqsolve", ""):
        with pytest.raises(CommandError, match="--solver"):
            solver_of(wrong, compressor)


def test_studies_take_the_same_solvers(scene):
    assert analysis_options(scene, "fine").solver is None
    assert isinstance(analysis_options(scene, "fast").solver, Collocation)
    assert isinstance(analysis_options(scene, "fast", "Dopri8:1e-9").solver, Shooting)
    rotor = load("hermetic-68cc")
    assert analysis_options(rotor, "coarse", excitation="file").excitation == "file"


def test_the_cycle_has_its_own_options(scene):
    found = cycle_of(CycleOptions(), ["panels=96, nodes=10", "tolerance=1e-12, method=march"])
    assert (found.panels, found.nodes, found.tolerance, found.method) == (96, 10, 1e-12, "march")
    assert with_cycle(Collocation(), ["panels=64"]).cycle.panels == 64
    for wrong in ("panel=3", "panels=1", "panels=1e9", "panels=100000", "tolerance=0", "method=x"):
        with pytest.raises(CommandError, match="--cycle"):
            cycle_of(CycleOptions(), [wrong])
    with pytest.raises(CommandError, match="capacity is set twice"):
        cycle_of(CycleOptions(), ["capacity=6000", "max_passes=60000,capacity=9000"])


def test_where_no_crank_is_solved_there_is_no_solver(scene):
    assert chosen_solver("collocation", scene) is None
    assert isinstance(chosen_solver("shooting", scene), Shooting)


def test_readings_follow_from_the_solver_that_was_chosen(scene):
    solver, none = Shooting(), np.zeros(0)
    rated = Readings("a", *[none] * 6, {})
    table = Table("b", ("mechanical_efficiency",), np.zeros((1, 1)))
    for one in (rated, table):
        assert one.solver is None
        assert one.solved_by(solver).solver is solver
    # modes know no crank
    modes = ModalTest("c", np.array([300.0]), (1,))
    assert modes.solved_by(solver) is modes
    fine, _ = table.at(scene.machine, none, none)
    coarse, _ = table.solved_by(Collocation(4, reversals=0)).at(scene.machine, none, none)
    # four nodes on a panel are seen, and are not far off
    assert 1e-8 < abs(float(coarse[0] / fine[0]) - 1) < 1e-3


@pytest.mark.slow
def test_vibration_is_the_same_by_both_solvers():
    rotor = load("hermetic-68cc")
    given = {"spin_speeds": [314.16], "orders": (1, 2), "excitation": "crank"}
    usual = np.asarray(respond(rotor, **given).checked().displacement)
    shot = np.asarray(respond(rotor, **given, crank_solver=Shooting(tolerance=1e-9)).displacement)
    # the default without edges at load reversals gives the forces to 1e-7; not to the last digit
    assert 0 < np.max(np.abs(shot - usual)) < 1e-5 * np.max(np.abs(usual))


@pytest.mark.slow
def test_maps_are_the_same_by_both_solvers():
    machine = load("r134a-7cc")
    points = [255.0], [318.0]
    usual, shot = (rating_map(machine, *points, solver=one) for one in (None, Shooting()))
    # the losses are a tenth of the power, and shooting closes to 1e-9
    assert 0 < abs(float(shot.values["power"][0, 0] / usual.values["power"][0, 0]) - 1) < 1e-8
    assert float(shot.values["mass_flow"][0, 0]) == float(usual.values["mass_flow"][0, 0])
