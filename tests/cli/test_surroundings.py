"""Settings of the process that a command cannot work with: a sentence each, or passed over."""

import json
import os
import subprocess
import sys

import jax
import pytest
from helpers import COMMANDS

from jaxcomp import BadInput, load, solve_orbit
from jaxcomp._core.status import SolveFailed, Status


def command(*words, **environment):
    return started("-m", "jaxcomp", *words, **environment)


def started(*words, **environment):
    return subprocess.run(
        [sys.executable, *words],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.mark.parametrize("platform", ["nonsense", "cuda"])
def test_a_platform_that_jax_has_not_is_named(platform):
    if platform == "cuda" and jax.default_backend() == "gpu":
        pytest.skip("it is there")
    done = command("run", "mayekawa-wbhe", JAX_PLATFORMS=platform)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert f"JAX_PLATFORMS={platform}: JAX cannot run on it here" in done.stderr


def test_a_width_that_is_none_is_passed_over():
    lines = []
    for columns in ("0", "-3", "wide"):
        lines += [({"COLUMNS": columns}, [word]) for word in ("list", "--help")]
    done = started("-c", COMMANDS, json.dumps(lines), COLUMNS="0")
    assert done.returncode == 0, done.stderr
    shown = done.stdout.split("ended with 0")
    assert len(shown) == 7, done.stdout
    assert all("mayekawa-wbhe" in machines for machines in shown[0:6:2])
    assert all("Usage" in help_text for help_text in shown[1:6:2])


@pytest.fixture
def single():
    jax.config.update("jax_enable_x64", False)
    yield
    jax.config.update("jax_enable_x64", True)


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


def test_single_precision_after_the_import_is_named(scene, single):
    with pytest.raises(BadInput, match=r"jax_enable_x64.*switched on after jaxcomp was imported"):
        solve_orbit(scene)
    failed = SolveFailed(Status.not_converged, "residual 1e-6")
    assert str(failed).startswith("in single precision, which was switched on after jaxcomp")


def test_single_precision_before_the_import_is_what_was_asked_for(single, monkeypatch):
    monkeypatch.setenv("JAXCOMP_X64", "0")
    failed = SolveFailed(Status.not_converged)
    assert str(failed).startswith("in single precision: see JAXCOMP_X64; the iteration did not")
