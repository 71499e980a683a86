"""Compiled programs kept in the user's cache folder, for the next process that needs them.

Whole solutions are kept always (`jaxcomp._core.exported`). A process that calls `keep_programs` keeps
the other programs of this package as well: those in which a function of it was traced, or that are
compiled while one runs. A user's other programs, and all of them where JAX has a cache of its own
(`JAX_COMPILATION_CACHE_DIR`), are left to JAX.

`JAXCOMP_CACHE` names another folder, or keeps nothing (`off`). A folder is used only where nobody but
its owner may write, and an entry only if its checksum is right, so that a process that was killed, a
full disk or a second process at the same time cost a compilation at most.
"""

import contextlib
import functools
import gc
import hashlib
import inspect
import io
import os
import platform
import re
import stat
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NamedTuple

import jax
from jaxlib.version import __version_info__

from .interrupts import removed_when_stopped
from .progress import compile_time, compiling, count_loaded, remember_in

# Thresholds of Python's collector: tracing makes millions of small objects among which there is little
# to collect, and takes a quarter longer with the usual ones.
RARELY = (100_000, 20, 50)

ENVIRONMENT = "JAXCOMP_CACHE"
# [bytes] All that is kept; what was read longest ago goes first.
_LIMIT = 256 * 2**20
# [bytes] What a process writes before it looks at the size of the folder, which takes time, again.
_LOOK = 16 * 2**20
# Kernels of the largest program that is kept. jaxlib 0.9 links one within another when it loads them, and
# the stack of one worker has been reported as overrun by 2,107. Here the largest program there is, the
# slopes of a machine with valves with 5,305, loaded whenever it was tried, with stacks from 8 MB down to
# 256 kB; an entry that ends a process all the same is not loaded again.
_MOST_KERNELS = 6000 if __version_info__ < (0, 10) else sys.maxsize
_PACKAGE = Path(__file__).parents[1]
_ENTRY = ".program"
_ASIDE = ".aside"
_LOADING = ".loading"
# Names that this module gives; a file of any other name is somebody else's.
_FOLDER = re.compile(r"[0-9a-f]{32}")
_FILE = re.compile(rf"[0-9a-f]{{64}}({_ENTRY}|{_LOADING})|tmp\w{{1,16}}{_ASIDE}")
# [s] What is still written aside after so long was left by a process that was killed.
_ABANDONED = 3600.0
_ARGUMENTS = ["backend", "computation", "devices", "compile_options", "host_callbacks"]


_anew: ContextVar[bool] = ContextVar("anew", default=False)
_by_caller: ContextVar[bool] = ContextVar("by_caller", default=False)
_written: list[int] = []  # since the last look
# Whether the function of JAX that compiles is the one of this module.
_replaced = False


class CacheStatus(NamedTuple):
    """Store of compiled programs.

    Attributes:
        folder: where; `None` if nothing is kept.
        why: why nothing is kept, "" if something is.
        programs: number of them.
        size: of all of them [bytes].
    """

    folder: Path | None
    why: str
    programs: int = 0
    size: int = 0


def cache_status() -> CacheStatus:
    """Folder, number and size of the programs that are kept."""
    if of_jax := _setting("compilation_cache_dir"):
        return CacheStatus(None, f"JAX keeps them in {of_jax}")
    root = _root()
    if root is None:
        return CacheStatus(None, f"{ENVIRONMENT} is off")
    why = _refused(root)
    if why:
        return CacheStatus(None, f"{root} {why}")
    sizes = [status.st_size for path, status in _files(root) if path.suffix == _ENTRY]
    return CacheStatus(root, "", len(sizes), sum(sizes))


def empty_cache() -> None:
    """Remove the programs that are kept, and nothing else that lies in their folder."""
    folder = cache_status().folder
    if folder is not None:
        for path, _ in _files(folder):
            _remove(path)


def keep_programs() -> None:
    """Keep every compiled program of this package from now on, for later processes.

    Whole solutions (`solve_orbit`, a cycle, a response) are kept without this call, which adds all other
    programs: gradients, batches, your own `jax.jit` around a function of jaxcomp, and the small programs
    of single operations. Words on waits (`JAXCOMP_WAITS=on`, or a notebook) then speak of these as well,
    and the time that is left of a study leaves their compiling out. Commands of `jaxcomp` and the desk
    call it themselves.

    `JAXCOMP_CACHE` names the folder, or keeps nothing (`off`). Programs of yours without a function of
    jaxcomp are left to JAX, and so are all of them where JAX has a cache of its own. A second call
    changes nothing.

    JAX has no public way to keep the programs of one package alone. So its private function
    `jax._src.compiler.compile_or_get_cached` is replaced, for the whole process, by one that calls it for
    all that is not kept. A version of JAX whose function takes other arguments is left as it is.
    """
    global _replaced
    from jax._src import compiler

    # replaced twice, every program would be written and counted twice
    if _replaced:
        return
    compile_one = compiler.compile_or_get_cached
    if list(inspect.signature(compile_one).parameters)[:5] == _ARGUMENTS:
        compiler.compile_or_get_cached = functools.partial(_compiled, compile_one)
        _replaced = True


def sees_compiles() -> bool:
    """Whether `keep_programs` was called, so that whatever JAX compiles passes through this module."""
    # no look at JAX itself: solutions want nothing that is private to it
    return _replaced


def compiled_anew() -> contextlib.AbstractContextManager[None]:
    """Compile what is kept as well, to measure how long that takes."""
    return _set(_anew)


@contextlib.contextmanager
def compiled_by_caller(size: int, cached: bool, purpose: str = "") -> Iterator[None]:
    """Compile what the caller keeps, if anybody does; with words, and with the time counted.

    It is not read where it is kept by its text: jaxlib 0.9 writes down half of a program that it has
    read.

    Args:
        size: [bytes] of the text of the program.
        cached: whether later processes find it compiled.
        purpose: words on what it is compiled for, where that is not the first call.
    """
    with _set(_by_caller), compiling(size, cached, purpose), compile_time:
        yield


def text_of(computation: Any) -> bytes:
    """Text of a module of MLIR, by which programs are known and their waits estimated."""
    text = io.BytesIO()
    computation.operation.write_bytecode(file=text)
    return text.getvalue()


@contextlib.contextmanager
def _set(switch: ContextVar[bool]) -> Iterator[None]:
    token = switch.set(True)
    try:
        yield
    finally:
        switch.reset(token)


def _compiled(
    compile_one: Callable, backend, computation, devices, options, callbacks, *further, **named
):
    """The program of a computation, read where it is kept; stands for the function of JAX."""
    # the caller tells and counts it, see `compiled_by_caller`
    if _by_caller.get():
        return compile_one(backend, computation, devices, options, callbacks, *further, **named)
    code = text_of(computation)
    of_package = _is_ours(code)
    path = None
    if of_package and not callbacks:
        # a program that calls back into Python holds the addresses of this process, and is not kept
        path = _path(computation, devices, options, backend)
    if path is not None and (entry := read(path)):
        to = further[0] if further else named["executable_devices"]
        program = loaded(path, lambda: backend.deserialize_executable(entry, to, options))
        if program is not None:
            count_loaded(len(code))
            return program
    telling = contextlib.nullcontext()
    if of_package:
        telling = compiling(len(code), path is not None)
    with telling, compile_time:
        program = compile_one(backend, computation, devices, options, callbacks, *further, **named)
    if path is not None:
        with contextlib.suppress(Exception):  # a program that XLA cannot write down
            serialized = program.serialize()
            if may_be_loaded(serialized):
                write(path, serialized)
    return program


@contextlib.contextmanager
def collected_rarely() -> Iterator[None]:
    """Collect objects rarely while a program is traced."""
    usual = gc.get_threshold()
    # a first threshold of zero switches the collector off
    if usual[0]:
        gc.set_threshold(*map(max, usual, RARELY))
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def may_be_loaded(program: bytes) -> bool:
    """Whether a compiled program is not too large for jaxlib to load it."""
    return program.count(b"_kernel") <= _MOST_KERNELS


def loaded(path: Path, load: Callable[[], Any]) -> Any:
    """Result of `load` for an entry that was read; `None` if XLA refuses it, and it is removed."""
    try:
        with _quiet(), _marked(path):
            program = load()
    except Exception:
        _remove(path)
        return None
    jax.monitoring.record_event("/jax/compilation_cache/cache_hits")
    return program


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence XLA's pages on standard error, unless the user listens to JAX.

    It compares the flags that a program was compiled with, hints to the compiler among them, with the
    features of the processor, and finds the hints missing there on the same machine.
    """
    from jax._src.lib import utils

    user_listens = _setting("logging_level") not in (None, "NOTSET")
    if not user_listens:
        utils.absl_set_min_log_level(3)
    try:
        yield
    finally:
        if not user_listens:
            utils.absl_set_min_log_level(int(os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1")))


@contextlib.contextmanager
def _marked(path: Path) -> Iterator[None]:
    """Leave a mark beside an entry while it is loaded, which stays there if that ends the process."""
    mark = path.with_suffix(_LOADING)
    with removed_when_stopped(mark):
        with contextlib.suppress(OSError):  # nothing may be written
            mark.write_text(str(os.getpid()))
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                mark.unlink()


def _has_ended_a_process(path: Path) -> bool:
    """Whether a process that loaded an entry is gone without having finished."""
    try:
        process = int(path.with_suffix(_LOADING).read_text() or 0)
        # signal 0 asks whether the process is there, and does nothing to it
        if process and hasattr(os, "geteuid"):  # Windows has no such question
            os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, ValueError):
        pass
    return False


def _is_ours(code: bytes) -> bool:
    """Whether a function of this package was traced, or runs."""
    place = f"{_PACKAGE}{os.sep}"
    # Above `_compiled`, which is of this package itself.
    frame = sys._getframe(2)
    while frame is not None and not frame.f_code.co_filename.startswith(place):
        frame = frame.f_back
    return frame is not None or place.encode() in code


def _path(computation, devices, options, backend) -> Path | None:
    """Where a compiled program is kept, if it can be."""
    from jax._src import compilation_cache

    if not keeps():
        return None
    try:
        return place(compilation_cache.get_cache_key(computation, devices, options, backend))
    except Exception:  # private to JAX, which may want something else one day
        return None


def keeps() -> bool:
    """Whether programs are kept in a folder of this package."""
    of_jax = _setting("compilation_cache_dir") or not _setting("enable_compilation_cache")
    return not (_anew.get() or of_jax or _root() is None)


def place(key: str) -> Path | None:
    """Where what has a key is kept for the sources and libraries of this process, if it can be."""
    root = _root()
    if root is None or _refused(root):
        return None
    return root / _build() / f"{hashlib.sha256(key.encode()).hexdigest()}{_ENTRY}"


def _setting(name: str) -> Any:
    return getattr(jax.config, f"jax_{name}")


def _root() -> Path | None:
    setting = os.environ.get(ENVIRONMENT)
    if setting is None:
        import platformdirs

        return platformdirs.user_cache_path("jaxcomp") / "programs"
    if setting.strip().lower() in ("off", "0", "no", ""):
        return None
    return Path(setting).expanduser().absolute()


def _usable_root() -> Path | None:
    """Folder of the programs, if they are kept there."""
    root = _root()
    if root is None or not keeps() or _refused(root):
        return None
    return root


def _refused(folder: Path) -> str:
    """Why a folder, which is made if it is not there, is not used; "" if it is."""
    try:
        if not folder.exists():
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
        return _untrusted(folder.stat(), stat.S_ISDIR)
    except OSError as error:
        return f"cannot be used: {error.strerror}"


def _untrusted(status: os.stat_result, is_kind: Callable[[int], bool]) -> str:
    if not is_kind(status.st_mode):
        return "is of another kind"
    # a program that others can change would run with the rights of this user
    if hasattr(os, "geteuid"):  # folders in a profile of Windows are closed to others
        if status.st_uid != os.geteuid():
            return "belongs to somebody else"
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return "may be written by others (`chmod 700` helps)"
    return ""


@functools.cache
def _build() -> str:
    """Identity of everything that a program depends on beside its own text."""
    from importlib.metadata import version

    parts = [sys.version, platform.platform(), _processor()]
    parts += [version(name) for name in ("jax", "jaxlib", "equinox", "diffrax", "numpy")]
    digest = hashlib.sha256("\n".join(parts).encode())
    # all sources: any of them may have been traced, and a program does not say which
    for path in sorted(_PACKAGE.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:32]


def _processor() -> str:
    """Its model and features, as far as the system tells them."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").split("\n\n")[0].splitlines()
    except OSError:
        return platform.processor()
    names = ("vendor_id", "cpu family", "model", "stepping", "flags", "Features", "CPU ")
    return "\n".join(line for line in lines if line.startswith(names))


def read(path: Path) -> bytes | None:
    """An entry whose checksum is right, if there is one; one where it is wrong is removed."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    if _has_ended_a_process(path):
        _remove(path.with_suffix(_LOADING))
        _remove(path)
        return None
    try:
        # What is checked is the open file and not its name, which may lead to another one by then.
        with open(os.open(path, flags), "rb") as file:
            if _untrusted(os.fstat(file.fileno()), stat.S_ISREG):
                return None
            checksum = file.read(32)
            data = file.read()
        if checksum == _sum(path, data):
            with contextlib.suppress(OSError):
                # What was read longest ago goes first, see `_make_room`.
                os.utime(path)
            return zlib.decompress(data)
    except (OSError, zlib.error):
        return None
    _remove(path)
    return None


def write(path: Path, program: bytes) -> None:
    """Keep a program: written aside and renamed, so that nobody reads half of it."""
    data = zlib.compress(program, 1)
    aside = None
    try:
        path.parent.mkdir(mode=0o700, exist_ok=True)
        handle, aside = tempfile.mkstemp(_ASIDE, dir=path.parent)  # nobody else may open it
        with removed_when_stopped(aside), open(handle, "wb") as file:
            file.write(_sum(path, data) + data)
        os.replace(aside, path)
    except OSError:  # no room, or nothing may be written
        if aside is not None:
            _remove(Path(aside))
        return
    _written.append(len(data))
    if len(_written) == 1 or sum(_written) > _LOOK:
        # The zero stays, so that only the first write of a process has a list of one.
        _written[:] = [0]
        _make_room(path.parent.parent)


def _sum(path: Path, data: bytes) -> bytes:
    """The checksum of an entry, which under another name is another."""
    return hashlib.sha256(f"{path.parent.name}/{path.name}".encode() + data).digest()


def _make_room(root: Path) -> None:
    """Remove what was read longest ago, until the rest has room, and what was left half written."""
    size = 0
    old = time.time() - _ABANDONED
    # the newest first, so that the sum passes the limit at those that were read longest ago
    for path, status in sorted(_files(root), key=lambda entry: -entry[1].st_mtime):
        size += status.st_size
        if size > _LIMIT or (path.suffix != _ENTRY and status.st_mtime < old):
            _remove(path)


def _files(root: Path) -> Iterator[tuple[Path, os.stat_result]]:
    for path in list(root.glob("*/*")):
        if _FOLDER.fullmatch(path.parent.name) and _FILE.fullmatch(path.name):
            with contextlib.suppress(OSError):  # another process has removed it
                yield path, path.lstat()


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
        path.parent.rmdir()  # with the last one


# Waits are remembered beside the programs, also where whole solutions alone are kept.
remember_in(_usable_root)
