"""Compiled programs of whole solutions kept, so that a later process traces and compiles nothing.

To trace a machine with valves takes several times as long as to read its compiled program. `kept_jit`
stands for `equinox.filter_jit` where a whole solution is one program: what XLA makes of it is written
down, and found by the structure, shapes and types of the arguments, by all in them that is no array, by
the settings of JAX, the flags of XLA, and by what a compiled program depends on
(`jaxcomp._core.programs`), the sources of this package among it. Of a program that is too large to be
loaded, what was traced is kept by `jax.export`, which saves the half of the time that tracing takes.

A program is compiled without XLA's optimisations first, as commands compile theirs, in half of the time,
and with them once its calls have taken longer than that costs. The numbers of both differ by rounding.

Programs are written down and read by documented functions of JAX, none of which is replaced.

Arguments with classes or functions of other packages are traced every time, since their code may have
changed. A constant or function of this package that a running process replaces is not noticed:
`JAXCOMP_CACHE=off` keeps nothing.
"""

import contextlib
import functools
import hashlib
import io
import os
import pickle
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import export
from jax.experimental import serialize_executable

from . import programs
from .errors import BadInput
from .fields import is_traced, strongly_typed
from .precision import flags_with, quick_options, single_precision
from .progress import count_loaded

# Whether programs of whole solutions are kept where all others are.
enabled = True

# [s] A quickly compiled program that has run for so long is compiled again, with XLA's optimisations: a
# program with valves takes 10 to 20 s for that and then half of the time of a call.
_UNOPTIMISED_FOR = 20.0

_P = ParamSpec("_P")
_R = TypeVar("_R")
# Packages whose versions are part of the key, as far as arguments hold anything of them.
_KNOWN = ("jaxcomp", "jax", "jaxlib", "equinox", "numpy", "builtins", "collections", "copyreg")

# A package whose programs call back into Python and cannot be kept, unless equinox leaves its checks out
# as commands have it do.
_CHECKED = "diffrax"

# Where in memory an object lies; of a newer JAX the settings hold one, the names of mapped axes.
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


class _Hole(NamedTuple):
    """Stand-in for an array in the structure of arguments and results."""

    shape: tuple[int, ...]
    dtype: str
    weak: bool


class _Refused(Exception):
    """An argument that a later process cannot tell from another."""


def kept_jit(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """`equinox.filter_jit` of a function, whose compiled program is kept for later processes.

    Args:
        function: pure; what it does depends on its arguments and on the sources of this package alone.
    """
    return _kept_jit(function, quick_options)


def kept_optimised_jit(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """`kept_jit` of a function that a search calls many times: optimised from the first call on."""
    return _kept_jit(function, dict)


def _kept_jit(
    function: Callable[_P, _R], first_options: Callable[[], dict[str, str]]
) -> Callable[_P, _R]:
    """`kept_jit`, with options of XLA for the first calls."""
    compiled: Any = eqx.filter_jit(function)
    of_this_process: dict[Any, Callable | None] = {}

    @functools.wraps(function)
    def call(*arguments, **named):
        leaves, structure = jax.tree.flatten((arguments, named))
        # Within another program this one becomes a part of it.
        if any(is_traced(leaf) for leaf in leaves):
            with programs.collected_rarely():
                return compiled(*arguments, **named)
        _refuse_mixed_precision(leaves)
        if any(getattr(leaf, "weak_type", False) for leaf in leaves):
            leaves = [*map(strongly_typed, leaves)]
            arguments, named = structure.unflatten(leaves)
        stored = enabled and programs.keeps()
        sees_compiles = programs.sees_compiles()
        if sees_compiles and not stored:
            return compiled(*arguments, **named)
        template = tuple(_hole(leaf) or leaf for leaf in leaves)
        # equality is enough here; the bytes of a key on disk are made once for each kind of arguments
        key = (stored, structure, template, _settings())
        try:
            is_new = key not in of_this_process
        except TypeError:  # an argument that has no hash
            return compiled(*arguments, **named)
        if is_new:
            with programs.collected_rarely():
                program = None
                if stored:
                    program = _program(function, template, structure, first_options())
                of_this_process[key] = program
                if program is None and not sees_compiles:
                    # the call below finds the program in the caches of JAX, and compiles nothing
                    _compile(compiled.lower(*arguments, **named).lowered, cached=False)
        program = of_this_process[key]
        if program is None:
            return compiled(*arguments, **named)
        return program(leaves)

    return call  # pyright: ignore[reportReturnType]


def _refuse_mixed_precision(leaves: list[Any]) -> None:
    """Refuse numbers in double precision where JAX computes in single precision.

    Raises:
        BadInput: there are some.
    """
    words = single_precision()
    if words and any(getattr(leaf, "dtype", None) == np.float64 for leaf in leaves):
        bound = "left as it was when the machine was made"
        raise BadInput("jax_enable_x64", f"off: {words}", bound)


def _hole(leaf: Any) -> _Hole | None:
    """The stand-in for an array; `None` for anything else."""
    if isinstance(leaf, jax.Array | np.ndarray):
        return _Hole(leaf.shape, leaf.dtype.str, bool(getattr(leaf, "weak_type", False)))
    return None


def _program(
    function: Callable, template: tuple, structure: Any, first_options: dict[str, str]
) -> Callable[[list], Any] | None:
    """The program for arguments of one kind, kept before or compiled now; `None` if it cannot be kept."""
    flat = _Flat(function, template, structure)
    try:
        key = _pickled((function, structure.unflatten(template)), _KeyPickler)
        # an address is another one in every process, and would make each key a new one
        key = f"{hashlib.sha256(key).hexdigest()} {_ADDRESS.sub('', str(_settings()))}"
        program = _Tiers(flat, key, first_options)
    except Exception:  # no structure that can be written down, or nothing that JAX can export
        return None
    out, out_structure = jax.tree.flatten(
        flat.result_template, is_leaf=lambda leaf: isinstance(leaf, _Hole)
    )
    places = _places_of_holes(out)

    def call(leaves):
        filled = list(out)
        numbers = [leaves[i] for i in flat.places]
        try:
            values = program(*numbers)
        except ValueError:  # arrays on another device
            values = flat.jitted(*numbers)
        # what is no array in a result follows from what is part of the key
        for place, value in zip(places, values, strict=True):
            filled[place] = value
        return out_structure.unflatten(filled)

    return call


class _Tiers:
    """A program with options of XLA at first, and without them once its calls have taken long.

    Args:
        flat: what it computes.
        key: by which it is kept.
        first_options: with which it is compiled sooner; none where it is to be optimised at once.

    Raises:
        Exception: it cannot be kept.
    """

    def __init__(self, flat: "_Flat", key: str, first_options: dict[str, str]):
        self._flat = flat
        self._key = key
        self._seconds = 0.0  # in which the program with options ran
        self._options: dict[str, str] = {}
        # optimised by an earlier process, which called it often
        program = self._stored({})
        if program is None and first_options:
            self._options = first_options
            program = self._stored(first_options)
        self._program = program or self._compiled(self._options, "")

    def __call__(self, *numbers) -> list[jax.Array]:
        if not self._options:
            return self._program(*numbers)
        if self._seconds > _UNOPTIMISED_FOR:
            self._optimise()
            return self._program(*numbers)
        begun = time.perf_counter()
        values = jax.block_until_ready(self._program(*numbers))
        self._seconds += time.perf_counter() - begun
        return values

    def _optimise(self) -> None:
        """Have the optimised program from now on; without a folder for it, go on as before."""
        with contextlib.suppress(Exception), programs.collected_rarely():
            purpose = "to run quicker: it has been called often"
            self._program = self._stored({}) or self._compiled({}, purpose)
        self._options = {}

    def _place(self, flags: str = "") -> Path:
        """Where the program is kept: compiled with flags of XLA, or what was traced of it."""
        place = programs.place(f"{self._key} {flags}".strip())
        if place is None:
            raise _Refused("no folder")
        return place

    def _stored(self, options: dict[str, str]) -> Callable | None:
        """The program compiled with these options of XLA by an earlier process."""
        stored = _read_compiled(self._place(flags_with(options)))
        if stored is None:
            return None
        self._flat.result_template, compiled = stored
        return compiled

    def _compiled(self, options: dict[str, str], purpose: str) -> Callable:
        """The program compiled with these options of XLA, for later processes as well."""
        entry = programs.read(self._place())
        lowered = self._flat.lowered(entry)
        # refused before it is compiled, if a result has classes that cannot be written down
        result_text = _pickled(self._flat.result_template, _Pickler)
        compiled = _compile(lowered, cached=True, options=options, purpose=purpose)
        written = _write_compiled(self._place(flags_with(options)), result_text, compiled)
        if not written and entry is None:
            programs.write(self._place(), pickle.dumps((result_text, self._flat.traced())))
        return compiled


def _compile(
    lowered: jax.stages.Lowered,
    *,
    cached: bool,
    options: dict[str, str] | None = None,
    purpose: str = "",
) -> jax.stages.Compiled:
    """The compiled program, of which is told before if that takes long.

    Args:
        lowered: the program.
        cached: whether later processes find it compiled.
        options: of XLA, beside the flags of the process.
        purpose: words on what it is compiled for, where that is not the first call.
    """
    size = len(programs.text_of(lowered.compiler_ir()))
    with programs.compiled_by_caller(size, cached, purpose):
        return lowered.compile(compiler_options=options or None)


def _places_of_holes(leaves: Sequence[Any]) -> list[int]:
    """Places of the stand-ins for arrays among the leaves of a tree."""
    places = []
    for place, leaf in enumerate(leaves):
        if isinstance(leaf, _Hole):
            places.append(place)
    return places


def _tell_of_lapack() -> None:
    """The first lowering of a call of LAPACK tells jaxlib where its functions are."""
    jax.jit(jax.lax.linalg.lu).lower(jax.ShapeDtypeStruct((1, 1), float))


def _write_compiled(path: Path, result_text: bytes, compiled: Any) -> bool:
    """Keep a compiled program; whether XLA can write it down, and jaxlib could load it."""
    with contextlib.suppress(Exception):
        text, *trees = serialize_executable.serialize(compiled)
        if programs.may_be_loaded(text):
            programs.write(path, pickle.dumps((result_text, text, *trees)))
            return True
    return False


def _read_compiled(path: Path) -> tuple[Any, Callable] | None:
    """Structure of the result and the compiled program, if it is kept."""
    entry = programs.read(path)
    if entry is None:
        return None
    result_text, text, *trees = pickle.loads(entry)
    if b"lapack" in text:
        _tell_of_lapack()
    # compiled for the first device; for arrays on another one it is compiled anew
    device = jax.devices()[:1]
    loaded = programs.loaded(
        path, lambda: serialize_executable.deserialize_and_load(text, *trees, None, device)
    )
    if loaded is None:
        return None
    count_loaded(len(text))
    return pickle.loads(result_text), loaded


class _Flat:
    """A function of the arrays among its arguments, which gives the arrays of its result.

    What is traced then knows nothing of the package's classes.

    Attributes:
        places: of the arrays among the arguments.
        result_template: the result with stand-ins for its arrays, known once the function is traced.
        jitted: the function as a program.
    """

    def __init__(self, function: Callable, template: tuple, structure: Any):
        self._function = function
        self._template = template
        self._structure = structure
        self.places = _places_of_holes(template)
        self.result_template: Any = None
        self.jitted = jax.jit(self._of_arrays)

    def _of_arrays(self, *arrays):
        filled = list(self._template)
        for place, array in zip(self.places, arrays, strict=True):
            filled[place] = array
        arguments, named = self._structure.unflatten(filled)
        leaves, out = jax.tree.flatten(self._function(*arguments, **named))
        result_template = []
        result_arrays = []
        for leaf in leaves:
            hole = _traced_hole(leaf)
            result_template.append(hole or leaf)
            if hole:
                # weakly typed it would have the next program that gets it compiled anew
                result_arrays.append(jnp.asarray(leaf, leaf.dtype))
        self.result_template = out.unflatten(result_template)
        return result_arrays

    def _like(self) -> list[jax.ShapeDtypeStruct]:
        """Stand-ins for the arrays, on the device that results belong to as well."""
        placement = _placement()
        like = []
        for place in self.places:
            hole = self._template[place]
            type_of_number = np.dtype(hole.dtype)
            like.append(
                jax.ShapeDtypeStruct(
                    hole.shape, type_of_number, weak_type=hole.weak, sharding=placement
                )
            )
        return like

    def lowered(self, entry: bytes | None) -> jax.stages.Lowered:
        """The program before it is compiled, traced by an earlier process if that is kept, or now."""
        if entry is None:
            # names of source lines would make what is kept larger by a fourth
            with _without_locations():
                return self.jitted.lower(*self._like())
        result_text, text = pickle.loads(entry)
        self.result_template = pickle.loads(result_text)
        if b"lapack" in text:
            _tell_of_lapack()
        return jax.jit(export.deserialize(bytearray(text)).call).lower(*self._like())

    def traced(self) -> bytes:
        """The traced program in a form that a later process can read."""
        return bytes(export.export(self.jitted)(*self._like()).serialize())


def _placement() -> jax.sharding.SingleDeviceSharding:
    """On the device on which programs run by default."""
    name = "jax_default_device"  # which checkers of types do not know
    device = getattr(jax.config, name)
    # a device, a platform by its name, or nothing
    if device is None or isinstance(device, str):
        device = jax.local_devices(backend=device)[0]
    return jax.sharding.SingleDeviceSharding(device)


def _without_locations() -> contextlib.AbstractContextManager[Any]:
    """Programs that are lowered within do not name the lines of the sources they come from."""
    from jax._src import config

    # of this thread alone; the public setting is that of all threads
    return config.traceback_in_locations_limit(0)


def _traced_hole(leaf: Any) -> _Hole | None:
    if eqx.is_array(leaf):
        # what a program returns is strongly typed
        return _Hole(leaf.shape, leaf.dtype.str, False)
    return _hole(leaf)


def _pickled(value: Any, pickler: type[pickle.Pickler]) -> bytes:
    out = io.BytesIO()
    writer = pickler(out, protocol=5)
    # a key must not tell equal things from one thing twice, as a result that was read differs from one
    # that was traced
    writer.fast = pickler is _KeyPickler
    writer.dump(value)
    return out.getvalue()


class _Pickler(pickle.Pickler):
    """Pickler of structures whose classes and functions are all of packages whose versions are known.

    Raises:
        _Refused: one is of another package.
    """

    def reducer_override(self, value: Any) -> Any:
        """Classes and functions are written by their names; of anything else its class is."""
        owner = value if hasattr(value, "__qualname__") else type(value)
        package = str(owner.__module__).partition(".")[0]
        unchecked = package == _CHECKED and os.environ.get("EQX_ON_ERROR") == "off"
        if package not in _KNOWN and not unchecked:
            raise _Refused(repr(owner))
        return NotImplemented


class _KeyPickler(_Pickler):
    """Writes functions without a name of their own as well: they are never read again."""

    def reducer_override(self, value: Any) -> Any:
        """A function by its place in the sources, and by what it holds of where it was made."""
        reduced = super().reducer_override(value)
        if not isinstance(value, FunctionType):
            return reduced
        contents = [cell.cell_contents for cell in value.__closure__ or ()]
        # lambdas of one function have one name: the line tells them apart
        place = (value.__module__, value.__qualname__, value.__code__.co_firstlineno)
        return tuple, ((*place, contents, value.__defaults__, value.__kwdefaults__),)


def _settings() -> tuple[Any, ...]:
    """Settings of JAX on which a traced program depends."""
    from jax._src import config

    # what JAX itself tells its traces apart by; there is no public name for it
    return *config.trace_context(), jax.default_backend()
