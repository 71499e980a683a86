r"""Where the results of a sweep go, block by block: a zarr store on disk, or plain arrays.

On disk every block of every quantity is a file of its own, written aside and then renamed, and the
file of `ok` comes last. Its presence says that the block is whole; whatever else a killed run left
behind is written anew. Several processes may write to one store at the same time.
"""

import json
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .._fields import BadInput
from ._fingerprint import first_difference
from ._plan import Plan

if TYPE_CHECKING:  # neither is imported by who does not sweep
    import xarray

OK = "ok"
_HEADER = "jaxcomp_sweep"
_HEADER_KINDS = {"same": dict, "block": list, "width": int, "columns": list, "about": dict}


class Store(Protocol):
    """What keeps the results."""

    def has(self, number: int) -> bool:
        """Whether a block is there, whole."""
        ...

    def write(self, number: int, rows, values, ok) -> None:
        """Keep a block: its designs, their quantities and whether these can be relied on."""
        ...

    def dataset(self) -> "xarray.Dataset":
        """All results; what is not there yet is NaN and not `ok`."""
        ...


class InMemory:
    """Results that are handed out and kept nowhere."""

    def __init__(self, plan: Plan):
        shape = plan.layout.shape
        self._plan = plan
        self._values = {column.name: np.full(shape, np.nan) for column in plan.quantities}
        self._ok = np.zeros(shape, bool)
        self._rows = {c.name: np.empty(shape) for c in plan.variables if plan.sampled}

    def has(self, number: int) -> bool:
        """Nothing is there before it is computed."""
        del number
        return False

    def write(self, number: int, rows, values, ok) -> None:
        """Put a block in its place."""
        place = self._plan.layout.place(number)
        for column, whole in enumerate(self._rows.values()):
            whole[place] = rows[:, column]
        for column, whole in enumerate(self._values.values()):
            whole[place] = values[:, column].reshape(whole[place].shape)
        self._ok[place] = ok.reshape(self._ok[place].shape)

    def dataset(self) -> "xarray.Dataset":
        """The arrays themselves, in a dataset."""
        import xarray

        plan = self._plan
        dims = plan.points.dims
        heads = {column.name: column.attributes for column in plan.variables + plan.quantities}
        data = {name: (dims, value, heads[name]) for name, value in self._values.items()}
        data[OK] = (dims, self._ok, _OK_ATTRIBUTES)
        values: Mapping[str, Any] = self._rows or plan.points.axes
        coords = {n: (dims if self._rows else n, v, heads[n]) for n, v in values.items()}
        return xarray.Dataset(data, coords, dict(plan.about))


class OnDisk:
    """A zarr store, made if it is not there.

    Args:
        path: folder of the store.
        plan: what it is for.

    Raises:
        BadInput: the folder holds something else, or another sweep.
    """

    def __init__(self, path: Path, plan: Plan):
        import zarr

        self._path, self._plan = path, plan
        if not path.exists() or not any(path.iterdir()):
            _make(path, plan)
        there = stored_header(path)
        differs = "no sweep" if there is None else first_difference(plan.fingerprint, there["same"])
        if differs:
            wanted = "a new folder, or the store of this same sweep"
            raise BadInput("out", f"{path}, which holds {differs}", wanted)
        names = (*self._sampled, *self._asked, OK)
        # A block of failures alone is a result like any other; a store forgets this setting.
        with zarr.config.set({"array.write_empty_chunks": True}), _undamaged(path):
            group = zarr.open_group(path, mode="r+")
            self._arrays: Any = {name: group[name] for name in names}

    @property
    def _sampled(self):
        return [c.name for c in self._plan.variables] if self._plan.sampled else []

    @property
    def _asked(self):
        return [c.name for c in self._plan.quantities]

    def has(self, number: int) -> bool:
        """Whether the file that is written last is there, and all others are there and whole."""
        index = [str(at) for at in self._plan.layout.index(number)]
        if not self._path.joinpath(OK, "c", *index).exists():
            return False
        place = self._plan.layout.place(number)
        for name, array in self._arrays.items():
            try:
                if not self._path.joinpath(name, "c", *index).exists():
                    return False
                array[place]
            except (
                Exception
            ):  # a cut file fails in the decoder of its compression, each in its own way
                return False
        return True

    def write(self, number: int, rows, values, ok) -> None:
        """Write the files of a block, `ok` last."""
        place = self._plan.layout.place(number)
        shape = tuple(part.stop - part.start for part in place)
        for column, name in enumerate(self._sampled):
            self._arrays[name][place] = rows[:, column]
        for column, name in enumerate(self._asked):
            self._arrays[name][place] = values[:, column].reshape(shape)
        self._arrays[OK][place] = ok.reshape(shape)

    def dataset(self) -> "xarray.Dataset":
        """Results that are read from disk when they are used."""
        return open_sweep(self._path)


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
        found = xarray.open_zarr(path, consolidated=False, chunks=None)
        found.attrs.pop(_HEADER)
        # A store knows no order, and takes what has no dimension of its name for data.
        variables = {name: found[name].variable for name in header["same"]["variables"]}
        values = found.drop_vars(variables)[header["columns"]]
        sampled = [name for name in variables if name not in values.dims]
        values[OK] = values[OK].copy(data=_whole(Path(path), header, values, sampled))
    return values.assign_coords(variables).assign_attrs(header["about"])


def _whole(path: Path, header, values, sampled) -> np.ndarray:
    """`ok`, false in blocks of which the file of a quantity is gone."""

    def blocks(name):
        folder = path / name / "c"
        return {file.relative_to(folder).parts for file in folder.rglob("*") if file.is_file()}

    ok, there = values[OK].values, blocks(OK)
    for name in (*header["columns"], *sampled):
        for index in there - blocks(name):
            starts = zip(map(int, index), header["block"], strict=True)
            ok[tuple(slice(i * size, (i + 1) * size) for i, size in starts)] = False
    return ok


def stored_header(path: Path) -> dict[str, Any] | None:
    """What a store says of itself; `None` if there is none at this path."""
    try:
        attributes = json.loads((path / "zarr.json").read_text())["attributes"]
        header = json.loads(attributes[_HEADER])
    except (FileNotFoundError, NotADirectoryError, KeyError, TypeError, ValueError):
        return None
    whole = isinstance(header, dict) and all(
        isinstance(header.get(key), kind) for key, kind in _HEADER_KINDS.items()
    )
    if not whole or not isinstance(header["same"].get("variables"), list | dict):
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
        told = f"{path}, which is damaged ({type(error).__name__}: {error})"
        raise BadInput("out", told, "a store that is whole, or a new folder") from None


_OK_ATTRIBUTES = {"long_name": "whether the quantities can be relied on"}


def _make(path: Path, plan: Plan) -> None:
    """An empty store, made aside and renamed: it is there as a whole or not at all."""
    import zarr

    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    header = {
        "same": plan.fingerprint,
        "block": list(plan.layout.block),
        "width": plan.width,
        "columns": [*(column.name for column in plan.quantities), OK],
        "about": plan.about,
    }
    group = zarr.open_group(aside, mode="w", attributes={_HEADER: json.dumps(header)})
    dims = plan.points.dims

    def blocks(name, dtype, fill, attributes):
        group.create_array(
            name,
            shape=plan.layout.shape,
            chunks=plan.layout.block,
            dtype=dtype,
            fill_value=fill,
            dimension_names=dims,
            attributes=attributes,
        )

    for column in plan.variables:
        if plan.sampled:
            blocks(column.name, "float64", np.nan, column.attributes)
        else:
            values = plan.points.axes[column.name]
            group.create_array(
                column.name,
                data=np.asarray(values),
                dimension_names=(column.name,),
                attributes=column.attributes,
            )
    for column in plan.quantities:
        blocks(column.name, "float64", np.nan, column.attributes)
    blocks(OK, "bool", False, _OK_ATTRIBUTES)
    try:
        os.rename(aside, path)
    except OSError:
        shutil.rmtree(aside)
        if stored_header(path) is None:  # not made meanwhile by another process
            raise
