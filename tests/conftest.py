"""64-bit mode, compiled programs that outlive a run, and none that outlive their module."""

import os

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA prints pages about each program it loads

import jax
import pytest

import jaxcomp  # noqa: F401  (turns on 64-bit mode)
from jaxcomp.cli._cache import keeps_programs


def pytest_configure(config):
    # A second run of the tests reuses the compiled programs of the first.
    if keeps_programs():
        folder = config.cache.mkdir("jax")
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


@pytest.fixture(autouse=True, scope="module")
def _forget_programs():
    # Thousands of programs in one process use up the memory maps that Linux allows it (65,530).
    yield
    jax.clear_caches()
