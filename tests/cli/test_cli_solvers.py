"""Solvers and their options by name, the same for every command."""

import diffrax
import pytest

from jaxcomp import Collocation, Shooting, load
from jaxcomp.cli._options import analysis_options, cycle_of, solver_of, with_cycle
from jaxcomp.cli._start import CommandError
from jaxcomp.cylinder import CycleOptions


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
    found = cycle_of(CycleOptions(), "panels=96, nodes=10, tolerance=1e-12, method=march")
    assert (found.panels, found.nodes, found.tolerance, found.method) == (96, 10, 1e-12, "march")
    assert with_cycle(Collocation(), "panels=64").cycle.panels == 64
    for wrong in ("panel=3", "panels=1", "panels=1e9", "panels=100000", "tolerance=0", "method=x"):
        with pytest.raises(CommandError, match="--cycle"):
            cycle_of(CycleOptions(), wrong)
