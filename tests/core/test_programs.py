"""Compiled programs are kept for the next process, and nothing that goes wrong with them is noticed."""

import os
import resource
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp._core import programs as _programs
from jaxcomp._core.fields import Bound

X = np.linspace(-1.0, 2.0, 7)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    where = tmp_path / "programs"
    monkeypatch.setenv("JAXCOMP_CACHE", str(where))
    monkeypatch.setattr(_programs, "_written", [])
    return where


@pytest.fixture
def hits():
    found = []

    def hear(event, **_):
        if event.endswith("cache_hits"):
            found.append(event)

    jax.monitoring.register_event_listener(hear)
    yield found
    jax.monitoring.unregister_event_listener(hear)


def ask(scale=1.0):
    """A program with a function of the package, compiled or found anew."""
    bound = Bound(0.0, 1.0)
    found = jax.jit(lambda x: jnp.sum(bound.clip(x)) * scale)(X)
    assert float(found) == pytest.approx(scale * np.clip(X, 0.0, 1.0).sum(), rel=1e-12)  # rounding


def entries(folder):
    return sorted(folder.glob("*/*"))


def test_a_program_is_found_again(folder, hits):
    ask()
    assert not hits
    assert len(entries(folder)) == 1
    ask()
    assert len(hits) == 1
    with _programs.compiled_anew():
        ask()
    assert len(hits) == 1
    state = _programs.cache_status()
    assert (state.folder, state.programs) == (folder, 1)
    assert state.size == entries(folder)[0].stat().st_size
    assert folder.stat().st_mode & 0o777 == 0o700
    _programs.empty_cache()
    assert not entries(folder)


def test_programs_of_others_are_not_kept(folder):
    jax.jit(lambda x: jnp.sin(x) + 3.25)(X)
    assert not folder.exists()


@pytest.mark.parametrize("length", [0, 1, 31, 32, 40, -1])
def test_a_cut_entry_is_replaced(folder, hits, length):
    ask()
    (path,) = entries(folder)
    whole = path.read_bytes()
    path.write_bytes(whole[:length])
    ask()
    assert not hits
    assert len(path.read_bytes()) > 32
    ask()
    assert len(hits) == 1


def test_a_foreign_entry_is_replaced(folder, hits):
    ask()
    (first,) = entries(folder)
    ask(2.0)
    (second,) = set(entries(folder)) - {first}
    second.write_bytes(first.read_bytes())  # whole, but of another program
    ask(2.0)
    assert not hits
    second.write_bytes(os.urandom(5000))
    ask(2.0)
    assert not hits


def test_an_entry_that_ended_a_process_is_not_loaded_again(folder, hits):
    ask()
    (path,) = entries(folder)
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                           capture_output=True, text=True, check=True)  # fmt: skip
    mark = path.with_suffix(".loading")
    mark.write_text(str(os.getpid()))  # this one has not ended
    ask()
    assert len(hits) == 1
    assert not mark.exists()
    mark.write_text(ended.stdout)
    ask()
    assert len(hits) == 1
    ask()
    assert len(hits) == 2


def test_a_program_of_too_many_kernels_is_not_kept(folder, monkeypatch):
    monkeypatch.setattr(_programs, "_MOST_KERNELS", -1)
    ask()
    assert not entries(folder)


def test_another_processor_or_version_is_another_entry(folder, hits, monkeypatch):
    ask()
    monkeypatch.setattr(_programs, "_build", lambda: "another")
    ask()
    assert not hits
    assert len(entries(folder)) == 2


@pytest.mark.parametrize("value", ["off", "OFF", "0", "no", ""])
def test_keeping_is_switched_off(folder, monkeypatch, value):
    monkeypatch.setenv("JAXCOMP_CACHE", value)
    ask()
    assert not folder.exists()
    assert _programs.cache_status() == (None, "JAXCOMP_CACHE is off", 0, 0)


def test_a_folder_that_others_may_write_is_not_used(folder, hits, monkeypatch):
    ask()
    folder.chmod(0o770)
    ask()
    assert not hits
    assert "may be written by others" in _programs.cache_status().why
    folder.chmod(0o700)
    entries(folder)[0].chmod(0o666)
    ask()
    assert not hits
    entries(folder)[0].chmod(0o600)
    ask()
    assert len(hits) == 1
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    ask()
    assert len(hits) == 1
    assert "belongs to somebody else" in _programs.cache_status().why


def test_a_file_where_the_folder_should_be(folder):
    folder.write_text("")
    ask()
    assert "is of another kind" in _programs.cache_status().why


def test_a_full_disk_keeps_nothing_and_leaves_nothing(folder):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, hard))
    try:
        ask()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not entries(folder)


def test_what_was_not_read_for_long_goes_first(folder, monkeypatch, hits):
    monkeypatch.setattr(_programs, "_LOOK", 0)
    ask(1.0)
    ask(2.0)
    first, second = sorted(entries(folder), key=lambda path: path.stat().st_mtime_ns)
    for path, age in ((first, 100), (second, 200)):
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    left = first.parent / "tmpleft.aside"
    left.write_bytes(b"")
    os.utime(left, (0, 0))
    monkeypatch.setattr(_programs, "_LIMIT", 5 * first.stat().st_size // 2)
    ask(3.0)
    assert first in entries(folder)
    assert len(entries(folder)) == 2
    assert second not in entries(folder)


KEEPING = """
import jax, jax.numpy as jnp, numpy as np
import jaxcomp
from jax._src import compiler
from jaxcomp._core.fields import Bound
of_jax = compiler.compile_or_get_cached
for _ in range({calls}):
    jaxcomp.keep_programs()
if {calls}:
    assert compiler.compile_or_get_cached.args == (of_jax,)
bound = Bound(0.0, 1.0)
jax.jit(lambda x: jnp.sum(bound.clip(x)))(np.linspace(-1.0, 2.0, 7))
"""


def test_a_script_keeps_small_programs_from_its_call_on(folder):
    """A second call changes nothing: JAX's function is replaced once."""
    subprocess.run([sys.executable, "-c", KEEPING.format(calls=0)], check=True)
    assert not folder.exists()
    subprocess.run([sys.executable, "-c", KEEPING.format(calls=2)], check=True)
    assert len(entries(folder)) == 1
