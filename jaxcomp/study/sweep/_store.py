r"""Where the results of a sweep go, block by block: a zarr store on disk, or plain arrays.

On disk every block of every quantity is a file of its own, written aside and then renamed, and the
file of `ok` comes last. Its presence says that the block is whole; whatever else a killed run left
behind is written anew. Several processes may write to one store at the same time, and a sweep goes on
in the store of the same sweep only.
"""

import hashlib
import json
import math
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from ..._core.errors import BadInput
from ..._core.status import UNNAMED, names_of_codes, status_names
from .._problem import Problem
from ._points import SAMPLE, Blocks, GridPoints, SamplePoints, extent

if TYPE_CHECKING:  # neither is imported by who does not sweep
    import xarray

OK = "ok"
STATUS = "status"
_OK_HEADING = {"long_name": "whether the quantities can be relied on"}
_KINDS = {OK: "bool", STATUS: "int8"}
_FILLS = {OK: False, STATUS: UNNAMED}
# Numbers of a sweep that is kept in memory: 2 GiB.
_MOST_HELD = 2**28
_HEADER = "jaxcomp_sweep"
_HEADER_KINDS = {"same": dict, "block": list, "width": int, "columns": list, "about": dict}
# How Python shows where in memory an object lies, which is another place in every run.
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")

Headings = dict[str, dict[str, str]]


def heading(unit: str, doc: str, better: str = "") -> dict[str, str]:
    """Heading that `xarray` keeps beside a variable or quantity: SI unit, one line, "more", "less" or
    "".
    """
    return {"units": unit, "better": better, "long_name": doc}


def _status_heading() -> dict[str, Any]:
    """Heading of the codes, with what they mean in the manner of the conventions for climate and
    forecasts.
    """
    names = [*status_names(), "failed"]
    codes = [*range(len(names) - 1), UNNAMED]
    about = "how the design ended"
    return {"long_name": about, "flag_values": codes, "flag_meanings": " ".join(names)}


def status_words(dataset: "xarray.Dataset") -> np.ndarray | None:
    """Status of every design, by names of `Status`; `None` of a store that does not know.

    Args:
        dataset: of `sweep` or `open_sweep`.
    """
    if STATUS not in dataset:
        return None
    *names, _ = dataset[STATUS].attrs["flag_meanings"].split()
    return names_of_codes(dataset[STATUS].values, names)


def quantity_names(dataset: "xarray.Dataset") -> list[str]:
    """The quantities of a sweep, without what tells whether they are known.

    Args:
        dataset: of `sweep` or `open_sweep`.
    """
    names = []
    for name in dataset.data_vars:
        if name not in (OK, STATUS):
            names.append(str(name))
    return names


def variable_names(dataset: "xarray.Dataset") -> list[str]:
    """The variables of a sweep, without the numbers of its samples.

    Args:
        dataset: of `sweep` or `open_sweep`.
    """
    names = []
    for name in dataset.coords:
        if name != SAMPLE:
            names.append(str(name))
    return names


def _empty(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """The column of a sweep before anything is known."""
    return np.full(shape, _FILLS.get(name, np.nan), _KINDS.get(name, "float64"))


class Plan(NamedTuple):
    """Plan of a sweep: what it is to find, and how its results are laid out.

    Attributes:
        points: the designs.
        layout: how they are cut into blocks.
        width: designs that are computed in step.
        variables, quantities: their headings by name, in the order of their columns.
        fingerprint: see `fingerprint`.
        about: versions and the like, which are kept and not compared.
        with_status: whether it is kept how designs ended; the stores of versions before do not know.
    """

    points: GridPoints | SamplePoints
    layout: Blocks
    width: int
    variables: Headings
    quantities: Headings
    fingerprint: dict[str, Any]
    about: dict[str, str]
    with_status: bool = True

    @property
    def sampled(self) -> bool:
        """Whether every design has values of its own, and not those of a grid."""
        return self.points.dims == (SAMPLE,)

    @property
    def axes(self) -> dict[str, Any]:
        """[SI] Values of each variable of a grid; none of samples, which have them in columns."""
        if self.sampled:
            return {}
        return self.points.axes

    @property
    def columns(self) -> Headings:
        """Columns of every design: its own variables, quantities, status and, last, `ok`."""
        variables = {}
        if self.sampled:
            variables = self.variables
        status = {}
        if self.with_status:
            status = {STATUS: _status_heading()}
        return variables | self.quantities | status | {OK: _OK_HEADING}


class _Store:
    """Store of the results of a plan, in an array for each column."""

    plan: Plan
    arrays: dict[str, Any]

    def write(self, number: int, rows, values, status, ok) -> None:
        """Keep a block: its designs, their quantities, how they ended, whether they can be relied on."""
        place = self.plan.layout.place(number)
        columns = []
        if self.plan.sampled:
            columns += [*rows.T]
        columns += [*values.T]
        if self.plan.with_status:
            columns.append(status)
        # `ok` last, whose presence says that the block is whole.
        columns.append(ok)
        for array, column in zip(self.arrays.values(), columns, strict=True):
            array[place] = column.reshape(extent(place))


class InMemory(_Store):
    """Results that are handed out and kept nowhere."""

    def __init__(self, plan: Plan):
        shape = plan.layout.shape
        self.plan = plan
        size = math.prod(shape) * len(plan.columns)
        if size > _MOST_HELD:
            bound = f"at most {_MOST_HELD} in memory; give a folder `out` to keep more"
            raise BadInput("numbers of this sweep", size, bound)
        self.arrays = {name: _empty(name, shape) for name in plan.columns}

    def has(self, number: int) -> bool:
        """Nothing is there before it is computed."""
        del number
        return False

    def dataset(self) -> "xarray.Dataset":
        """The arrays themselves, in a dataset."""
        import xarray

        plan = self.plan
        dims = self.plan.points.dims
        heads = plan.variables | plan.columns
        data = {}
        for name, value in self.arrays.items():
            data[name] = (dims, value, heads[name])
        for name, value in plan.axes.items():
            data[name] = (name, value, heads[name])
        coords = {}
        for name in plan.variables:
            coords[name] = data.pop(name)
        return xarray.Dataset(data, coords, dict(plan.about))


class OnDisk(_Store):
    """A zarr store, made if it is not there.

    Args:
        path: folder of the store.
        plan: what it is for.

    Raises:
        BadInput: the folder holds something else, or another sweep.
    """

    def __init__(self, path: Path, plan: Plan):
        import zarr

        self._path = path
        self.plan = plan
        if not path.exists() or not any(path.iterdir()):
            _make(path, plan)
        header = stored_header(path)
        differs = "no sweep"
        if header is not None:
            differs = first_difference(plan.fingerprint, header["same"])
        if differs:
            bound = "a new folder, or the store of this same sweep"
            raise BadInput("out", f"{path}, which holds {differs}", bound)
        # A block of failures alone is a result like any other; a store forgets this setting.
        with zarr.config.set({"array.write_empty_chunks": True}), _undamaged(path):
            group = zarr.open_group(path, mode="r+")
            self.arrays = {name: group[name] for name in plan.columns}

    def has(self, number: int) -> bool:
        """Whether the file that is written last is there, and all others are there and whole."""
        index = [str(at) for at in self.plan.layout.where(number)]
        place = self.plan.layout.place(number)
        # From `ok`, which is the one that an unfinished block lacks.
        for name, array in reversed(self.arrays.items()):
            if not self._path.joinpath(name, "c", *index).exists():
                return False
            try:
                array[place]
            except Exception:  # a cut file fails in the decoder of its compression, each in its way
                return False
        return True

    def dataset(self) -> "xarray.Dataset":
        """Results that are read from disk when they are used."""
        return open_sweep(self._path)


def _make(path: Path, plan: Plan) -> None:
    """An empty store, made aside and renamed: it is there as a whole or not at all."""
    import zarr

    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    header = {
        "same": plan.fingerprint,
        "block": list(plan.layout.block),
        "width": plan.width,
        "columns": [*plan.quantities, STATUS, OK],
        "about": plan.about,
    }
    group = zarr.open_group(aside, mode="w", attributes={_HEADER: json.dumps(header)})
    for name, attributes in plan.columns.items():
        group.create_array(
            name,
            shape=plan.layout.shape,
            chunks=plan.layout.block,
            dtype=_KINDS.get(name, "float64"),
            fill_value=_FILLS.get(name, np.nan),
            dimension_names=plan.points.dims,
            attributes=attributes,
        )
    for name, values in plan.axes.items():
        about = plan.variables[name]
        group.create_array(name, data=values, dimension_names=(name,), attributes=about)
    try:
        os.rename(aside, path)
    except OSError:
        shutil.rmtree(aside)
        if stored_header(path) is None:  # not made meanwhile by another process
            raise


def open_sweep(path: str | Path) -> "xarray.Dataset":
    """The results in a store, also of a run that stopped or still goes on.

    Args:
        path: the `out` of a sweep.

    Returns:
        As `sweep` does; what is not there yet, or no longer, is NaN and not `ok`. Quantities are read
        from disk when they are used.

    Raises:
        BadInput: there is no such store.
    """
    import xarray

    header = stored_header(Path(path))
    if header is None:
        raise BadInput("path", str(path), "the store of a sweep")
    with _undamaged(Path(path)):
        stored = xarray.open_zarr(path, consolidated=False, chunks=None)
        stored.attrs.pop(_HEADER)
        # A store knows no order, and takes what has no dimension of its name for data.
        variables = {name: stored[name].variable for name in header["same"]["variables"]}
        values = stored.drop_vars(variables)[header["columns"]]
        sampled = [name for name in variables if name not in values.dims]
        values[OK] = values[OK].copy(data=_ok_where_complete(Path(path), header, values, sampled))
    return values.assign_coords(variables).assign_attrs(header["about"])


def _ok_where_complete(path: Path, header, values, sampled) -> np.ndarray:
    """`ok`, false in blocks of which the file of a quantity is gone."""

    def blocks(name):
        folder = path / name / "c"
        indices = set()
        for file in folder.rglob("*"):
            if file.is_file():
                indices.add(file.relative_to(folder).parts)
        return indices

    ok = values[OK].values
    written = blocks(OK)
    for name in (*header["columns"], *sampled):
        for index in written - blocks(name):
            place = []
            for i, size in zip(map(int, index), header["block"], strict=True):
                place.append(slice(i * size, (i + 1) * size))
            ok[tuple(place)] = False
    return ok


def stored_header(path: Path) -> dict[str, Any] | None:
    """Header of a store; `None` if there is none at this path."""
    try:
        attributes = json.loads((path / "zarr.json").read_text())["attributes"]
        header = json.loads(attributes[_HEADER])
    # Whatever else the folder holds, it holds no sweep.
    except (FileNotFoundError, NotADirectoryError, KeyError, TypeError, ValueError):
        return None
    if not isinstance(header, dict):
        return None
    for key, kind in _HEADER_KINDS.items():
        if not isinstance(header.get(key), kind):
            return None
    if not isinstance(header["same"].get("variables"), list | dict):
        return None
    return header


@contextmanager
def _undamaged(path: Path) -> Iterator[None]:
    """Say of a store that cannot be opened that it is damaged, and how to go on.

    Raises:
        BadInput: zarr or xarray cannot read it.
    """
    try:
        yield
    except Exception as error:  # damaged files fail in zarr and in its codecs, each in its own way
        text = f"{path}, which is damaged ({type(error).__name__}: {error})"
        raise BadInput("out", text, "a store that is whole, or a new folder") from None


def fingerprint(problem: Problem, points: Any) -> dict[str, Any]:
    """Everything that the numbers of a sweep depend on, as JSON can hold it.

    The machine counts with every bit of its numbers. A quantity that is a function counts by its name
    and code; what it takes from its surroundings is not looked at.
    """
    return {
        "machine": _digest(problem.design),
        "variables": list(points.axes),
        "designs": hashlib.sha256(repr(points.described()).encode()).hexdigest(),
        "quantities": [_quantity_mark(quantity) for quantity in problem.quantities],
        "options": _text(problem.options),
    }


def first_difference(header: dict[str, Any], stored: dict[str, Any]) -> str:
    """First difference of two headers, in words; empty if there is none."""
    hashed = {"machine": "numbers of the machine", "designs": "values of the variables"}
    for key, value in header.items():
        if stored.get(key) != value:
            if key in hashed:
                return f"other {hashed[key]}"
            return f"{key} {_listed(stored.get(key))} where this one has {_listed(value)}"
    return ""


def _listed(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(value)
    return str(value)


def _digest(tree) -> str:
    """Digest of all numbers of a tree and of everything that is none."""
    numbers, static = eqx.partition(tree, eqx.is_array)
    digest = hashlib.sha256(_text(static).encode())
    for path, leaf in jax.tree_util.tree_leaves_with_path(numbers):
        value = np.asarray(leaf)
        digest.update(f"{jax.tree_util.keystr(path)} {value.dtype} {value.shape}".encode())
        digest.update(value.tobytes())
    return digest.hexdigest()


def _quantity_mark(quantity: str | Callable) -> str:
    if isinstance(quantity, str):
        return quantity
    code = getattr(quantity, "__code__", None)
    content = ""
    if code is not None:
        content = _code(code)
    mark = hashlib.sha256(content.encode()).hexdigest()[:12]
    return f"{quantity.__name__} ({mark})"


def _code(code) -> str:
    inner = []
    for constant in code.co_consts:
        if hasattr(constant, "co_code"):
            inner.append(_code(constant))
        else:
            inner.append(repr(constant))
    return f"{code.co_code.hex()} {code.co_names} {inner}"


def _text(tree) -> str:
    return _ADDRESS.sub("", eqx.tree_pformat(tree, short_arrays=True, width=10_000))
