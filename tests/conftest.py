"""64-bit mode, and compiled programs that outlive a run."""

import jax

import jaxcomp  # noqa: F401  (turns on 64-bit mode)


def pytest_configure(config):
    # A second run of the tests reuses the compiled programs of the first.
    if config.cache is not None:
        folder = config.cache.mkdir("jax")
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
