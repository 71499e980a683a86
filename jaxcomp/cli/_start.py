"""How a command starts JAX: programs compile quickly and are kept for the next start."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ENVIRONMENT = "JAXCOMP_CACHE_DIR"


def start_jax(*, once: bool = False) -> None:
    """Make ready what every command wants of JAX; call before it runs anything.

    Args:
        once: whether the programs of the command run once.
    """
    quick_compiles()
    if once:
        unoptimised_compiles()
    enable_compilation_cache()


def keeps_programs() -> bool:
    """Whether this jaxlib can load what it kept: 0.9.2 ends in a segmentation fault on some."""
    from jaxlib.version import __version_info__

    return __version_info__ >= (0, 10)


def enable_compilation_cache() -> Path | None:
    """Let JAX keep compiled programs in the user's cache folder.

    The environment variable `JAXCOMP_CACHE_DIR` names another folder, or switches the cache off
    (`off`, `0` or empty). JAX's own `JAX_COMPILATION_CACHE_DIR` goes first.

    Returns:
        The folder in use; `None` if there is none, also if it cannot be written or if kept programs
        cannot be trusted.
    """
    import jax
    import platformdirs

    if not keeps_programs():
        return None
    wanted = os.environ.get("JAX_COMPILATION_CACHE_DIR") or os.environ.get(ENVIRONMENT)
    if wanted is None and ENVIRONMENT not in os.environ:
        wanted = str(platformdirs.user_cache_path("jaxcomp") / "xla")
    if not wanted or wanted.lower() in ("off", "0"):
        return None
    folder = Path(wanted).expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # small programs as well: a command runs dozens of them before its solver
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return folder


def quiet_loader() -> None:
    """Keep XLA from printing pages about tuning flags of kept programs; call before JAX is imported.

    It compares the flags that a program was compiled with, hints to the compiler among them, with
    the features of the processor, and finds the hints missing there on the same machine.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def leave_out_callbacks() -> None:
    """Compile without the checks that call back from a running program; call before JAX is imported.

    JAX never keeps a program with callbacks, and diffrax checks its time grids in this way. What the
    solvers here find wrong they report in the status of their result.
    """
    os.environ.setdefault("EQX_ON_ERROR", "off")


def one_blas_thread() -> None:
    """Let BLAS work in the calling thread; call before SciPy is imported.

    Its matrices here have some dozen rows. On busy cores its threads wait for each other: a response of
    the three-subset rotor then took 160 ms instead of 0.8 ms.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def quick_compiles() -> None:
    """Compile quickly: tracing makes millions of small objects among which there is little to collect.

    A tenth of the time; the package itself tells XLA what saves more (`jaxcomp._precision`).
    """
    gc.set_threshold(100_000, 20, 50)


def unoptimised_compiles() -> None:
    """Compile without XLA's optimisations, for programs that run once; call before JAX runs anything."""
    from .._precision import tell_xla

    tell_xla("--xla_backend_optimization_level", "0")


@contextmanager
def cluster(address: str | None) -> Iterator[Any]:
    """The client of a Dask cluster at an address or in a scheduler file; `None` if none is named.

    Raises:
        CommandError: Dask is not installed, or there is no scheduler.
    """
    from ._errors import CommandError

    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise CommandError("--dask: needs Dask; pip install 'jaxcomp[dask]'") from None
    where = {"scheduler_file" if address.endswith(".json") else "address": address}
    try:
        client = Client(**where, timeout=5)
    except (OSError, ValueError) as error:
        raise CommandError(
            f"--dask {address}: no scheduler answers ({error}); `dask scheduler` starts one, and "
            f"`dask worker {address}` each worker"
        ) from None
    with client:
        yield client
