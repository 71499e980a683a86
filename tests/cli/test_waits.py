"""Whoever waits for the compiler or for many designs is told, on standard error and in pipes as well."""

import json
import re
import sys
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest
from jax._src import compiler

from jaxcomp._core import exported, programs, waits
from jaxcomp._core import progress as _waits
from jaxcomp.rotor import Disks, Link, Mount, RotorModel, ShaftElements, undamped_modes


@pytest.fixture
def told(monkeypatch):
    monkeypatch.setenv("JAXCOMP_WAITS", "on")
    monkeypatch.setenv("JAXCOMP_CACHE", "off")
    monkeypatch.setattr(_waits, "_AFTER", 0.2)
    monkeypatch.setattr(_waits._Compiles, "machine", "")
    monkeypatch.setattr(_waits._Compiles, "total", "")
    monkeypatch.setattr(_waits._Compiles, "task", "")


def rotor(elements):
    nodes = tuple(range(elements + 1))
    shaft = ShaftElements(nodes, 0.2, 0.02, 2.06e11, 7850.0, 0.3)
    links = (Link((0, None), Mount([1e7, 1e7], [100.0, 100.0])),)
    return RotorModel((shaft,), (Disks((1,), 5.0, 6e-3, 12e-3),), links=links)


def test_a_call_that_compiles_says_so_once(told, monkeypatch, capsys):
    model = rotor(7)  # of a size that no other test compiles
    monkeypatch.setattr(_waits._Compiles, "machine", "my-rotor")
    capsys.readouterr()
    undamped_modes(model, 3)
    lines = [line for line in capsys.readouterr().err.splitlines() if "compiling" in line]
    assert len(lines) == 1
    assert re.fullmatch(r"jaxcomp: compiling the modes of my-rotor, about \d+ s", lines[0])
    undamped_modes(model, 3)
    assert "compiling" not in capsys.readouterr().err


@pytest.mark.parametrize("keeps_all", [False, True])
@pytest.mark.parametrize("stored", [False, True])
def test_a_whole_solution_is_told_and_counted_once(
    told, monkeypatch, capsys, tmp_path, stored, keeps_all
):
    """With `keep_programs` as without, and where nothing is kept as well."""
    monkeypatch.setattr(exported, "enabled", stored)
    if stored:
        monkeypatch.setenv("JAXCOMP_CACHE", str(tmp_path))
    model = rotor(8 + 2 * keeps_all + stored)  # of a size that no other test compiles
    if not keeps_all:
        of_jax = compiler.compile_or_get_cached.args[0]
        monkeypatch.setattr(compiler, "compile_or_get_cached", of_jax)
        monkeypatch.setattr(programs, "_replaced", False)
    monkeypatch.setattr(_waits._Compiles, "programs", 0)
    monkeypatch.setattr(_waits.compile_time, "seconds", 0.0)
    capsys.readouterr()
    undamped_modes(model, 3)
    words = "jaxcomp: compiling the modes, about \\d+ s"
    if stored:
        words += "; later starts are quicker"
    assert re.fullmatch(f"{words}\n", capsys.readouterr().err)
    assert _waits._Compiles.programs == 1
    assert _waits.compile_time.seconds > 0


def test_what_is_kept_is_told_and_shown_by_a_spinner(told, monkeypatch, capsys):
    class Status:
        status, seen = "Solving ...", []

        def update(self, text):
            self.status = text
            self.seen.append(text)

    shown = Status()
    monkeypatch.setattr(_waits._Compiles, "announced", True)
    monkeypatch.setattr(_waits._Compiles, "machine", "r290-6cc")
    with _waits.compiling(10**6, cached=True):
        pass
    words = "compiling the results of r290-6cc, about 40 s; later starts are quicker"
    assert capsys.readouterr().err == f"jaxcomp: {words}\n"
    monkeypatch.setattr(_waits._Compiles, "status", shown)
    with _waits.compiling(10**6, cached=True):
        assert shown.status == f"C{words[1:]} ..."
    assert shown.status == "Solving ..."
    assert not capsys.readouterr().err


def test_names_of_functions_are_those_of_the_package():
    texts = "".join(path.read_text() for path in Path(_waits._PACKAGE).rglob("*.py"))
    for name in _waits._COMPUTES:
        assert f"def {name}(" in texts, name


def test_what_others_compile_is_not_told(told, capsys):
    def slow(x):
        for n in range(300):
            x = jnp.sin(x) + n
        return x

    jax.jit(slow)(1.0)
    assert "jaxcomp" not in capsys.readouterr().err


def test_progress_in_a_pipe_is_a_line_with_the_time_that_is_left(monkeypatch, capsys):
    monkeypatch.setenv("JAXCOMP_WAITS", "on")
    clock = iter(range(0, 10_000, 20))
    monkeypatch.setattr(_waits.time, "monotonic", lambda: next(clock))
    with _waits.progress_of("Sweeping", 400, unit="designs") as progress:
        for done in (100, 200, 300):
            progress.at(done)
    assert capsys.readouterr().err.splitlines() == [
        "jaxcomp: Sweeping: 100 of 400 designs, 1:00 left",
        "jaxcomp: Sweeping: 200 of 400 designs, 0:40 left",
        "jaxcomp: Sweeping: 300 of 400 designs, 0:20 left",
    ]


def test_nothing_is_said_where_nobody_wants_it(monkeypatch, capsys):
    monkeypatch.setenv("JAXCOMP_WAITS", "off")
    clock = iter(range(0, 10_000, 20))
    monkeypatch.setattr(_waits.time, "monotonic", lambda: next(clock))
    with _waits.progress_of("Sweeping", 400) as progress:
        progress.at(100)
    assert not capsys.readouterr().err


def test_a_forecast_begins_with_the_first_piece_and_leaves_out_compiling(monkeypatch, capsys):
    """Of 100 s the first of four pieces has compiled for 80: the others take 20 s each, then 40 s."""
    monkeypatch.setenv("JAXCOMP_WAITS", "on")
    clock = iter([0.0, 0.0, 80.0, 100.0, 140.0])
    monkeypatch.setattr(_waits.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(_waits.compile_time, "seconds", 0.0)
    with _waits.progress_of("Modes", 4, unit="speeds") as progress:
        with _waits.compile_time:
            pass
        progress.at(1)
        progress.at(2)
    assert capsys.readouterr().err.splitlines() == [
        "jaxcomp: Modes: 1 of 4 speeds, 1:00 left",
        "jaxcomp: Modes: 2 of 4 speeds, 1:20 left",
    ]


@pytest.fixture
def remembered(told, monkeypatch, tmp_path):
    """Where waits are remembered, and a task that begins."""
    monkeypatch.setattr(_waits._Compiles, "folder", staticmethod(lambda: tmp_path))
    monkeypatch.setattr(waits, "usual_waits", list)
    for name in ("announced", "task", "first", "programs", "size", "loaded", "total", "before"):
        monkeypatch.setattr(_waits._Compiles, name, getattr(_waits._Compiles, name))
    _waits.watch_compiles("my-machine", "run")
    return tmp_path


def compile_programs(*sizes):
    """As `programs` does it, without the programs."""
    for size in sizes:
        with _waits.compiling(size, cached=True):
            _waits.compile_time.seconds += size / 10_000


def test_a_wait_is_told_once_for_all_programs_by_what_they_took_before(remembered, capsys):
    compile_programs(566_000, 1_000, 340_000, 90_000)
    _waits.remember_waits()
    assert len(capsys.readouterr().err.splitlines()) == 3  # nobody knows yet how many there are
    _waits.watch_compiles("my-machine", "run")
    compile_programs(580_000, 1_000, 340_000, 90_000)
    assert capsys.readouterr().err.splitlines() == [
        "jaxcomp: compiling 3 programs for the steady state of my-machine, about 2 min in all; "
        "later starts are quicker"
    ]
    _waits.watch_compiles("my-machine", "run")
    # another kind of machine, at the rate of this one: 1e-4 s a byte
    compile_programs(210_000)
    assert "compiling the steady state of my-machine, about 20 s" in capsys.readouterr().err


def test_what_is_left_of_a_task_is_not_taken_for_all_of_it(remembered, capsys):
    compile_programs(566_000, 340_000)
    _waits.remember_waits()
    before = (remembered / "waits.json").read_text()
    _waits.watch_compiles("my-machine", "run")
    capsys.readouterr()
    _waits.count_loaded(340_000)
    compile_programs(566_000)
    _waits.remember_waits()
    assert "compiling the steady state of my-machine, about 60 s" in capsys.readouterr().err
    assert (remembered / "waits.json").read_text() == before


def test_programs_that_were_read_are_left_out_of_what_is_told(remembered, capsys):
    """After another command has kept the first program, there are two: 43 s at 1e-4 s a byte."""
    compile_programs(566_000, 340_000, 90_000)
    _waits.remember_waits()
    _waits.watch_compiles("my-machine", "run")
    capsys.readouterr()
    _waits.count_loaded(566_000)
    compile_programs(340_000, 90_000)
    assert capsys.readouterr().err.splitlines() == [
        "jaxcomp: compiling 2 programs for the steady state of my-machine, about 40 s in all; "
        "later starts are quicker"
    ]


def test_a_first_start_is_told_by_what_usual_tasks_took_elsewhere(remembered, monkeypatch, capsys):
    """At the pace of this machine, once it has done one of them: half as fast."""
    usual = [
        waits.Wait("run", 566_000, 3, 996_000, 60.0),
        waits.Wait("map", 700_000, 2, 1_400_000, 70.0),
    ]
    monkeypatch.setattr(waits, "usual_waits", lambda: usual)
    compile_programs(560_000, 340_000, 90_000)
    _waits.compile_time.seconds += 120.0 - 99.0
    _waits.remember_waits()
    _waits.watch_compiles("my-machine", "map")
    compile_programs(700_000, 700_000)
    words = "of my-machine, about {} in all; later starts are quicker"
    assert capsys.readouterr().err.splitlines() == [
        f"jaxcomp: compiling 3 programs for the steady state {words.format('60 s')}",
        f"jaxcomp: compiling 2 programs for the results {words.format('2 min')}",
    ]


def test_usual_waits_are_those_of_programs_that_take_long():
    rows = json.loads(waits.USUAL.read_text("utf-8"))
    assert len(waits.usual_waits()) == len(rows) > 0
    for wait in waits.usual_waits():
        assert wait.programs >= 1
        assert wait.first <= wait.size
        # a tenth to ten times what a byte takes on the whole
        assert 0.1 < wait.seconds / (waits._PER_BYTE * wait.size) < 10


@pytest.mark.parametrize("text", ["", "{", "[1]", '[["run", 1]]', '[["run", "a", 1, 1, 1]]'])
def test_a_damaged_file_of_waits_is_none(remembered, text, capsys):
    (remembered / "waits.json").write_text(text)
    compile_programs(566_000)
    assert "about 20 s" in capsys.readouterr().err
    _waits.remember_waits()
    assert len(json.loads((remembered / "waits.json").read_text())) == 1


def test_a_notebook_is_told_unasked(monkeypatch, capsys):
    monkeypatch.setenv("JAXCOMP_CACHE", "off")
    monkeypatch.delenv("JAXCOMP_WAITS", raising=False)
    monkeypatch.setattr(_waits._Compiles, "announced", False)
    monkeypatch.setattr(_waits._Compiles, "folder", staticmethod(lambda: None))
    with _waits.compiling(10**6):
        pass
    assert not capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "ipykernel", types.ModuleType("ipykernel"))
    shell = types.SimpleNamespace(kernel=object())
    monkeypatch.setattr("IPython.get_ipython", lambda: shell)
    with _waits.compiling(10**6):
        pass
    assert "compiling" in capsys.readouterr().err
