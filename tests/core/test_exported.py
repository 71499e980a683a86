"""What was traced is kept for the next process, and nothing that it could not know."""

import gc
import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax._src import compiler

from jaxcomp import load, optimise, problem, sensitivity
from jaxcomp._core import exported, programs
from jaxcomp._core.fields import admissible, clipped
from jaxcomp._core.polynomials import legendre_columns
from jaxcomp.crank._verify import march_options
from jaxcomp.cylinder import solve_cycle
from jaxcomp.gas import PolytropicCycle

X = np.linspace(-1.0, 2.0, 7)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    where = tmp_path / "programs"
    monkeypatch.setenv("JAXCOMP_CACHE", str(where))
    monkeypatch.setattr(exported, "enabled", True)
    return where


@pytest.fixture
def traced(monkeypatch):
    """The functions that were traced."""
    seen, trace = [], exported._Flat._of_arrays

    def telling(flat, *arrays):
        seen.append(flat._function)
        return trace(flat, *arrays)

    monkeypatch.setattr(exported._Flat, "_of_arrays", telling)
    return seen


def gas(**changes):
    values = {"suction_pressure": 1e5, "discharge_pressure": 7e5, "exponent": 1.3}
    return PolytropicCycle(**values | {"clearance_ratio": 0.05} | changes)


def ask(part, *arguments):
    """In a new wrapper, as in a new process: `repaired` of a part, whose result is a part."""
    function = type(part).repaired
    kept, plain = exported.kept_jit(function), eqx.filter_jit(function)
    answer, known = kept(part, *arguments), plain(part, *arguments)
    assert jax.tree.structure(answer) == jax.tree.structure(known)
    for mine, other in zip(jax.tree.leaves(answer), jax.tree.leaves(known), strict=True):
        np.testing.assert_array_equal(mine, other)  # one program, to the last bit


def test_a_traced_program_is_found_again(folder, traced):
    ask(gas())
    assert len(traced) == 1
    ask(gas(exponent=1.2))  # another value
    assert len(traced) == 1
    ask(gas().__class__(1e5, 7e5, 1.3, jnp.asarray(0.05, jnp.float32)))  # another type of a number
    with jax.default_matmul_precision("highest"):  # another setting of JAX
        ask(gas())
    assert len(traced) >= 2


@pytest.mark.parametrize("length", [0, 31, 40, -1])
def test_a_cut_entry_is_traced_again(folder, traced, length):
    ask(gas())
    for path in folder.glob("*/*.program"):
        path.write_bytes(path.read_bytes()[:length])
    ask(gas())
    assert len(traced) == 2


def test_what_others_wrote_is_traced_every_time(folder, traced):
    def own(x):
        return 2 * x

    class Own(PolytropicCycle):
        pass

    for function, argument in (
        (own, jnp.asarray(X)),
        (PolytropicCycle.repaired, Own(1e5, 7e5, 1.3, 0.05)),
    ):
        given = jax.tree.leaves(argument)
        for _ in range(2):
            found = exported.kept_jit(function)(argument)
            scale = 2.0 if function is own else 1.0
            np.testing.assert_array_equal(jax.tree.leaves(found)[0], scale * given[0])
    assert not traced


def test_methods_of_diffrax_are_known_where_they_do_not_call_back(folder, traced, monkeypatch):
    """Their checks call back into Python, which a later process cannot find."""
    for setting, count in (("raise", 0), ("off", 1)):
        monkeypatch.setenv("EQX_ON_ERROR", setting)
        for _ in range(2):
            options = exported.kept_jit(clipped)(march_options())
            assert options.tolerance == march_options().tolerance
        assert len(traced) == count


def test_within_another_program_it_is_the_function(folder, traced):
    kept = exported.kept_jit(PolytropicCycle.repaired)
    slope = jax.grad(lambda n: kept(gas(exponent=n)).exponent ** 2)(1.3)
    assert float(slope) == pytest.approx(2.6, rel=1e-15)  # a product
    assert not traced


def test_the_collector_waits_while_a_program_is_traced():
    """Unless the user has switched it off, and no longer than that."""
    during = []

    @exported.kept_jit
    def twice(x):
        during.append(gc.get_threshold()[0])
        return 2 * x

    usual = gc.get_threshold()
    try:
        for threshold, x in ((700, X), (0, X[:2])):
            gc.set_threshold(threshold, 10, 10)
            jax.jit(twice)(x)
            assert gc.get_threshold() == (threshold, 10, 10)
    finally:
        gc.set_threshold(*usual)
    assert during == [programs.RARELY[0], 0]


def test_what_is_no_array_is_told_apart(folder, traced):
    for count in (3, 4, 3):
        assert exported.kept_jit(legendre_columns)(jnp.asarray(X), count).shape[0] == count
    assert len(traced) == 2


# First what calls LAPACK, with nothing before it in the process, then a whole solution. Without friction
# that is a small program.
SCRIPT = """
import jax, jax.numpy as jnp
hits = []
jax.monitoring.register_event_listener(lambda event, **_: hits.append(event))
from jax._src import compiler
from jaxcomp import load, solve_orbit
from jaxcomp._core import exported
from jaxcomp.scene import with_values
asked, lowered = [], exported._Flat.lowered
exported._Flat.lowered = lambda *a: asked.append(1) or lowered(*a)
hit = "/jax/compilation_cache/cache_hits"
print(exported.kept_jit(jnp.linalg.inv.__wrapped__)(2 * jnp.eye(3)).tolist(), "|", len(asked))
before = hits.count(hit)
bare = {"friction": None, "crankshaft.main_journal": None}
orbit = solve_orbit(with_values(load("mayekawa-wbhe"), bare))
assert compiler.compile_or_get_cached.__module__ == "jax._src.compiler"
print(float(orbit.highest_speed), "|", hits.count(hit) - before)
"""


@pytest.fixture(scope="module")
def two_scripts(tmp_path_factory):
    """What a script prints and what is kept behind it, of a first process and of a later one."""
    where = tmp_path_factory.mktemp("kept") / "programs"
    environment = os.environ | {"JAXCOMP_CACHE": str(where)}
    told = []
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", SCRIPT], capture_output=True, text=True, env=environment
        )
        assert run.returncode == 0, run.stderr
        told.append([line.split(" | ") for line in run.stdout.splitlines()])
        assert len(list(where.glob("*/*.program"))) == 2
    return told


def test_a_later_process_calls_lapack_without_having_traced_it(two_scripts):
    """A program that is read alone leaves jaxlib without the addresses of LAPACK: a crash."""
    (first, traced), (second, traced_again) = (told[0] for told in two_scripts)
    assert first == second == "[[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]]"
    assert (int(traced), int(traced_again)) == (1, 0)


def test_a_second_script_reads_a_whole_solution_unasked(two_scripts):
    """Without `keep_programs`."""
    (speed, hits), (same_speed, later_hits) = (told[1] for told in two_scripts)
    assert speed == same_speed
    assert (int(hits), int(later_hits)) == (0, 1)


def test_what_cannot_be_kept_compiles_once(folder, monkeypatch):
    """Without `keep_programs` it is compiled for the words before it, and found by the call behind."""
    compile_one = compiler.compile_or_get_cached.args[0]
    compiled = []

    def counting(*arguments, **named):
        compiled.append(arguments)
        return compile_one(*arguments, **named)

    monkeypatch.setattr(compiler, "compile_or_get_cached", counting)
    monkeypatch.setattr(programs, "_replaced", False)
    x = jnp.asarray(X)
    doubled = exported.kept_jit(lambda x: 2 * x)
    compiled.clear()
    for _ in range(2):
        np.testing.assert_array_equal(doubled(x), 2 * X)
    assert len(compiled) == 1
    assert not folder.exists() or not list(folder.glob("*/*"))


def test_a_number_of_another_type_class_is_no_other_program():
    """`jnp.asarray(0.04)` is weakly typed: a field set to it must not have a solution compiled anew."""
    traced = []

    @exported.kept_jit
    def twice(x):
        traced.append(x)
        return 2 * x

    strong, weak = jnp.asarray(np.float64(0.04)), jnp.asarray(0.04)
    assert weak.weak_type
    assert not strong.weak_type
    assert twice(strong) == twice(weak) == 0.08
    assert len(traced) == 1


def test_flags_of_xla_have_a_program_of_their_own(folder, traced, monkeypatch):
    ask(gas())
    ask(gas(exponent=1.2))
    assert len(traced) == 1
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=0")
    ask(gas())
    assert len(traced) == 2


@pytest.fixture
def quick_first(monkeypatch):
    """Options with which programs are compiled, as in a process whose flags are the package's."""
    compiled = []
    compile_one = exported._compile

    def telling(lowered, *, options, **named):
        compiled.append(bool(options))
        return compile_one(lowered, options=options, **named)

    monkeypatch.setattr(exported, "_compile", telling)
    monkeypatch.setattr(exported, "quick_options", lambda: {"xla_backend_optimization_level": "0"})
    # another level than that of the options
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=1")
    return compiled


def test_a_solution_is_optimised_once_its_calls_took_long(folder, quick_first, monkeypatch):
    rows = exported.kept_jit(legendre_columns)
    x = jnp.asarray(X)
    first = rows(x, 3)
    rows(x, 3)
    assert quick_first == [True]
    # as if the calls so far had taken longer
    monkeypatch.setattr(exported, "_UNOPTIMISED_FOR", 0.0)
    for _ in range(3):
        np.testing.assert_allclose(rows(x, 3), first, rtol=1e-14)  # a few roundings
    assert quick_first == [True, False]
    # a later process finds the optimised one
    exported.kept_jit(legendre_columns)(x, 3)
    assert quick_first == [True, False]


def test_a_later_process_finds_the_quick_program_and_optimises_it_too(
    folder, quick_first, monkeypatch
):
    x = jnp.asarray(X)
    exported.kept_jit(legendre_columns)(x, 3)
    later = exported.kept_jit(legendre_columns)
    later(x, 3)
    assert quick_first == [True]
    monkeypatch.setattr(exported, "_UNOPTIMISED_FOR", 0.0)
    later(x, 3)
    assert quick_first == [True, False]


def test_of_a_program_too_large_to_be_loaded_what_was_traced_is_kept(folder, traced, monkeypatch):
    monkeypatch.setattr(programs, "may_be_loaded", lambda text: False)
    read, deserialize = [], exported.export.deserialize
    monkeypatch.setattr(
        exported.export, "deserialize", lambda text: read.append(1) or deserialize(text)
    )
    for _ in range(3):
        ask(gas())
    assert len(traced) == 1
    assert len(read) == 2


def test_a_result_that_was_read_is_the_same_argument(folder, traced):
    machine = {"".join(["first ", "stage"]): gas()}  # a key of its own
    for _ in range(2):
        found = exported.kept_jit(clipped)(machine)
        exported.kept_jit(admissible)([machine, found])
    assert len(traced) == 2


def test_on_another_device_it_is_compiled_for_that():
    code = """
import jax, numpy as np
from jaxcomp import load, optimise, problem, sensitivity
from jaxcomp._core import exported
from jaxcomp._core.fields import admissible, clipped
from jaxcomp.gas import PolytropicCycle
gas = PolytropicCycle(1e5, 7e5, 1.3, 0.05)
kept = exported.kept_jit(PolytropicCycle.repaired)
for device in jax.devices()[::-1]:
    there = kept(jax.device_put(gas, device))
    assert there.suction_pressure.devices() == {device}
    assert there.suction_pressure == 1e5
"""
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"
    done = subprocess.run([sys.executable, "-c", code], env=os.environ | {"XLA_FLAGS": flags})
    assert done.returncode == 0


def test_a_cycle_is_asked_of_the_store(folder, monkeypatch):
    """So that a later process, which solves one in Python, traces nothing."""

    class Asked(Exception):
        pass

    def asked(function, *rest):
        raise Asked(function.__name__)

    monkeypatch.setattr(exported, "_program", asked)
    machine = load("r290-6cc").as_compressor()
    with pytest.raises(Asked, match="_solved_if_admissible"):
        solve_cycle(machine.gas, machine.mechanism, machine.motor.speed_guess)


@pytest.mark.slow  # compiles the slopes of a machine twice, half a minute
def test_gains_and_designs_of_a_search_are_kept(folder, traced):
    """So that the desk traces nothing at its second start."""
    scene = load("mayekawa-wbhe")
    sensitivity(scene, ["mechanical_efficiency"])
    ranges = {"bore_at_displacement": (0.12, 0.14)}
    optimise(problem(scene, ranges, ["mechanical_efficiency"]), starts=1, samples=2, max_steps=2)
    functions = {f"{function.__module__}.{function.__name__}" for function in traced}
    assert "jaxcomp.study._sensitivity._solved" in functions
    assert "jaxcomp.study._problem._answers" in functions
    assert len(list(folder.glob("*/*.program"))) >= len(traced)
