"""64-bit mode, programs compiled quickly, and none kept that memory has no room for."""

import json
import os
import time
from pathlib import Path

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA prints pages about each program it loads
# Commands under test keep nothing in the folder of whoever runs them.
os.environ["JAXCOMP_CACHE"] = "off"
os.environ["JAXCOMP_WAITS"] = "off"
os.environ.pop("JAX_COMPILATION_CACHE_DIR", None)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import pytest
from interrupts import Interrupts

import jaxcomp  # noqa: F401  (turns on 64-bit mode)
from jaxcomp._core import exported, programs
from jaxcomp._core.precision import unoptimised_compiles
from jaxcomp.cli._start import quick_compiles

# Most programs of the tests run once: XLA need not optimise them. Programs that the tests start inherit
# this; notebooks, benchmarks and users run optimised programs, and so do the tests with
# `XLA_FLAGS=--xla_backend_optimization_level=3`.
unoptimised_compiles()
quick_compiles()
programs.keep_programs()
# Every worker keeps to a processor of its own: on as many processors as workers, the threads of XLA of
# one would wait for those of the other, a hundred times longer than a small solve takes.
_worker = os.environ.get("PYTEST_XDIST_WORKER", "")
if _worker and hasattr(os, "sched_setaffinity"):
    _processors = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {_processors[int(_worker.removeprefix("gw")) % len(_processors)]})
# Tests replace functions that a program which was traced before would still have.
exported.enabled = False
jax.devices()  # commands find JAX running, and leave the other tests their devices

# Linux allows a process 65,530 memory maps, and every compiled program takes some.
_MAPS = Path("/proc/self/maps")
_MANY_MAPS = 35_000
_counted = time.monotonic()


def pytest_configure(config):
    config.pluginmanager.register(Interrupts())
    # A second run of the tests reuses the compiled programs of the first.
    if hasattr(config, "cache"):
        os.environ["JAXCOMP_CACHE"] = str(config.cache.mkdir("programs"))


@pytest.hookimpl(optionalhook=True)  # absent without pytest-xdist
def pytest_xdist_make_scheduler(config, log):
    from distribution import SchedulingPastCrashes

    return SchedulingPastCrashes(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.fixture(autouse=True)
def _forget_programs():
    yield
    global _counted
    # to compile takes a while, and so does counting
    if time.monotonic() - _counted > 1 and _MAPS.exists():
        if _MAPS.read_bytes().count(b"\n") > _MANY_MAPS:
            jax.clear_caches()
        _counted = time.monotonic()


@pytest.fixture(autouse=True, scope="session")
def _results_fit_their_schema():
    """Whatever a command under test gives as JSON fits the schema of its results."""
    from helpers import results_validator

    from jaxcomp.cli import _output
    from jaxcomp.cli._answers import answers
    from jaxcomp.cli._start import command_name

    def checked(result, *given, **options):
        text = made(result, *given, **options)
        if command_name() in answers():
            results_validator(command_name()).validate(json.loads(text))
        return text

    made = _output.json_text
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_output, "json_text", checked)
        yield
