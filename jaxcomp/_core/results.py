r"""Results that travel: printed with units, as tables, in files, as pictures.

A result lists its quantities once, in `described`; everything else follows from that list. Files keep
the fields themselves, so that a result that is loaded equals the one that was saved to the last bit.
"""

import csv
import importlib
import inspect
import io
import json
import zipfile
from collections.abc import Iterator, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import numpy as np

from .declared import Declared, Note, Record, declarations, tree_of, with_unit, with_units
from .display import shown
from .errors import BadInput
from .fields import is_any_traced
from .files import regular, write_whole
from .saved import UnknownClass, from_json, to_json
from .status import Status
from .words import hint

if TYPE_CHECKING:
    import pandas
    import xarray

_PACKAGE = __name__.partition(".")[0]
_FORMAT = f"{_PACKAGE} result"
# [bytes] What a file of a result unpacks to at most, of which its structure is a part.
_LARGEST = 2 * 10**9
_LARGEST_HEAD = 2 * 10**8


class Data(NamedTuple):
    """One quantity of a result.

    Attributes:
        name: with dots before the joint, target or variable that it belongs to.
        unit: SI unit, "" for pure numbers and words.
        values: of the shape that `dims` say, behind the dimensions of a batch.
        dims: names of the dimensions; a quantity with the name of a dimension is its coordinate.
        doc: what it is, where the name does not tell.
    """

    name: str
    unit: str
    values: Any
    dims: tuple[str, ...] = ()
    doc: str = ""

    @property
    def header(self) -> str:
        """Name and SI unit, for a column."""
        return with_unit(self.name, self.unit)


class Result(Declared):
    """Base of results: everything that they can do beside holding their numbers."""

    __slots__ = ()
    # Dimensions of the table that `columns` makes.
    table_dims: ClassVar[tuple[str, ...]] = ()
    # Whether JSON has all quantities of `described` beside each other, and not the declared entries.
    flat: ClassVar[bool] = False
    # Fields that `save` leaves out: what a solver kept for itself.
    not_saved: ClassVar[tuple[str, ...]] = ()

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units: those that it declares."""
        return self.data_of(*declarations(type(self)))

    def tree(self) -> dict[str, Any]:
        """Numbers and words for JSON, as of `tree_of`."""
        # what a solver returns has names that depend on the machine, and no records
        if self.flat:
            return tree_of(self.to_dict())
        return super().tree()

    def data_of(
        self, *names: str, dims: tuple[str, ...] | None = None, **renamed: str
    ) -> Iterator[Data]:
        """Declared numbers by the names of their fields, but for those that are `None`.

        Args:
            names: of the fields.
            dims: dimensions, where those of the declaration are others in the table.
            renamed: names of further fields, by the names that they get.
        """
        declared = declarations(type(self))
        fields = {declared[name].key or name: name for name in names} | renamed
        for key, name in fields.items():
            unit, declared_dims, doc = declared[name][:3]
            values = getattr(self, name)
            # a word has no unit, and that of a note stands elsewhere
            if unit is not None and not isinstance(unit, Note) and values is not None:
                yield Data(key, unit, values, declared_dims if dims is None else dims, doc)

    def members_of(self, *names: str, **renamed: str) -> Iterator[Data]:
        """Declared tables of numbers, as `data_of`, each number behind its name, as `loss.crank_pin`."""
        for data in self.data_of(*names, **renamed):
            for member, values in data.values.items():
                yield data._replace(name=f"{data.name}.{member}", values=values)

    def columns(self) -> dict[str, np.ndarray]:
        """The curves or rows of this result by name and SI unit, each with shape (rows,).

        A result that has neither is one row of its numbers. Complex amplitudes have two columns,
        amplitude and phase [rad].

        Raises:
            BadInput: results of many designs at once, as `vmap` returns them.
        """
        columns: dict[str, np.ndarray] = {}
        shape: dict[str, int] = {}
        parts = []
        for data in self._checked():
            # beside curves stands no single number, and no curve over another dimension
            is_single = not data.dims and bool(self.table_dims)
            if not is_single and set(data.dims) <= set(self.table_dims):
                parts.append(data)
        for data in parts:
            _refuse_many(data)
            shape |= dict(zip(data.dims, np.shape(data.values), strict=True))
        dims = [dim for dim in self.table_dims if dim in shape]
        sizes = [shape[dim] for dim in dims]
        for data in parts:
            # a column that a dimension does not change is repeated along it
            index = []
            for dim in dims:
                index.append(slice(None) if dim in data.dims else None)
            array = np.broadcast_to(np.asarray(data.values)[tuple(index)], sizes)
            for real_part in _real_parts(data._replace(values=array)):
                columns[real_part.header] = real_part.values.ravel()
        return columns

    def to_dict(self) -> dict[str, Any]:
        """All quantities by name and SI unit, as numbers and lists, with how the solution ended.

        Complex amplitudes have two entries, amplitude and phase [rad]. What is not finite is `None`, as
        JSON has no word for it.
        """
        numbers: dict[str, Any] = {"kind": type(self).__name__, **self._words()}
        for data in self._checked():
            for real_part in _real_parts(data):
                numbers[real_part.header] = _finite(np.asarray(real_part.values))
        return numbers

    def to_json(self) -> str:
        """The text that a command prints with `--json`: `entries`, with the SI unit in each key."""
        # JSON has no NaN: `tree_of` has replaced it, and one that it missed raises here
        return json.dumps(with_units(tree_of(self)), indent=2, allow_nan=False, ensure_ascii=False)

    def to_pandas(self) -> "pandas.DataFrame":
        """The curves or rows of this result as a table; see `columns`."""
        import pandas

        return pandas.DataFrame(self.columns())

    def to_xarray(self, *, amplitudes: bool = False) -> "xarray.Dataset":
        """All quantities in SI units, with their units in the attributes.

        Args:
            amplitudes: complex numbers as amplitude and phase [rad], as files in netCDF want them, which
                hold no complex numbers: `result.to_xarray(amplitudes=True).to_netcdf(path)`.
        """
        import xarray

        variables = {}
        coordinates = set()
        described = self._checked()
        if amplitudes:
            described = [part for data in described for part in _real_parts(data)]
        for data in described:
            values = np.asarray(data.values)
            batch = [f"design_{n}" for n in range(values.ndim - len(data.dims))]
            dims = list(data.dims)
            if batch and data.name in dims:
                # of many designs it is no coordinate, which has its own dimension alone
                dims[dims.index(data.name)] = f"{data.name}_number"
            about = {"units": data.unit, "long_name": data.doc or data.name.replace("_", " ")}
            variables[data.name] = ((*batch, *dims), values, about)
            if data.dims == (data.name,) and not batch:
                coordinates.add(data.name)
        dataset = xarray.Dataset(variables, attrs={"kind": type(self).__name__, **self._words()})
        return dataset.set_coords(coordinates)

    def to_csv(self, path: str | Path) -> None:
        """Write `columns` with their units in the header; numbers keep all their digits."""
        write_whole(path, csv_text(self.columns()).encode())

    def save(self, path: str | Path) -> None:
        """Write the whole result; `load_result` reads it back to the same bits.

        Raises:
            BadInput: a result with a function of the user in it, which no file can hold, or one that is
                larger than `load_result` reads.
        """
        arrays: list[np.ndarray] = []
        # the structure is a text, so that reading a file needs no pickle, which could run code
        head = {"format": _FORMAT, "version": version(_PACKAGE), "result": to_json(self, arrays)}
        members = {}
        size = 0
        for number, values in enumerate(arrays):
            members[f"array_{number}"] = values
            size += values.nbytes
        if size > _LARGEST:
            bound = f"of at most {_LARGEST / 1e9:.3g} GB; save parts of it"
            raise BadInput("result", f"{size / 1e9:.3g} GB", bound)
        content = io.BytesIO()
        np.savez_compressed(content, head=np.array(json.dumps(head)), **members)  # pyright: ignore
        write_whole(path, content.getvalue())

    @property
    def plot(self) -> "Plots":
        """Pictures of this result, such as `orbit.plot.pv_diagram(machine)`."""
        return Plots(self)

    def __repr__(self) -> str:
        if self._is_traced():
            return eqx.tree_pformat(self)
        rows = list(self._rows())
        wide = max((len(name) for name, _ in rows), default=0)
        lines = [self._title()]
        for name, text in rows:
            lines.append(f"  {name:<{wide}}  {text}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        cells = ""
        for name, text in self._rows():
            cells += f"<tr><th style='text-align:left'>{escape(name)}</th>"
            cells += f"<td style='text-align:left'>{escape(text)}</td></tr>"
        return f"<p><b>{escape(self._title())}</b></p><table>{cells}</table>"

    def _is_traced(self) -> bool:
        return is_any_traced(self)

    def _checked(self) -> list[Data]:
        if self._is_traced():
            raise BadInput("result", "inside jit, vmap or grad", "taken outside of them")
        checked = []
        for data in self.described():
            checked.append(data._replace(values=jax.device_get(data.values)))
        return checked

    def _words(self) -> dict[str, str]:
        """Words on how the solution ended, and by which solver, where the result knows."""
        words = {}
        status = getattr(self, "status", None)
        if isinstance(status, str):
            words["status"] = status
        elif isinstance(status, eqx.Enumeration) or type(status).__name__ == "EnumerationItem":
            # by name as well, because equinox does not offer the class of these items
            converged = np.asarray(status == Status.converged)
            if converged.ndim:
                words["status"] = f"{converged.sum()} of {converged.size} designs converged"
            else:
                words["status"] = Status[status] or "converged"
        for name in ("solver", "method"):
            if isinstance(getattr(self, name, None), str):
                words[name] = getattr(self, name)
        return words

    def _title(self) -> str:
        return ": ".join(filter(None, (type(self).__name__, ", ".join(self._words().values()))))

    def _rows(self) -> Iterator[tuple[str, str]]:
        for data in self._checked():
            values = np.asarray(data.values)
            shape = ""
            if values.ndim:
                shape = f" ({', '.join(map(str, values.shape))})"
            # words, counts and truth values: each that occurs, once
            if values.dtype.kind not in "fc":
                text = ", ".join(dict.fromkeys(map(str, values.ravel())))
                if len(text) >= 60:
                    text = f"{text[:57]}..."
                yield _sentence(data.name), text + shape
                continue
            size = values
            if np.iscomplexobj(values):
                size = np.abs(values)
            look = shown(data.name, data.unit, size)
            # gaps of a curve are not numbers, and must not hide its range
            good = size[np.isfinite(size)]
            if not good.size:
                yield look.words, "not known" + shape
            elif not values.ndim and np.iscomplexobj(values):
                yield look.words, f"{look.text(float(size))} at {np.angle(values, deg=True):.1f}°"
            elif not values.ndim:
                yield look.words, look.text(float(size))
            else:
                low = look.number(float(good.min()))
                high = look.number(float(good.max()))
                yield look.words, f"{low} to {high} {look.units}".strip() + shape


def _refuse_many(data: Data) -> None:
    """Refuse numbers of many designs at once, as `vmap` returns them.

    Raises:
        BadInput: they are.
    """
    if np.ndim(data.values) != len(data.dims):
        single = "of one; take them apart first, as by jax.tree.map(lambda leaf: leaf[0], result)"
        raise BadInput("result", "of many designs", single)


def _real_parts(data: Data) -> list[Data]:
    """Real numbers as they are; complex ones as amplitude and phase."""
    if not np.iscomplexobj(data.values):
        return [data]
    amplitude = data._replace(name=f"{data.name}.amplitude", values=np.abs(data.values))
    phase = data._replace(name=f"{data.name}.phase", unit="rad", values=np.angle(data.values))
    return [amplitude, phase]


def columns_of(records: Sequence[Record], *dims: str, names: Sequence[str] = ()) -> Iterator[Data]:
    """Declared numbers and words of records as columns, with a row for each record.

    Args:
        records: of one class.
        dims: names of the dimension of the rows, and of further ones of the numbers.
        names: of the fields; all if there are none.
    """
    if not records:
        return
    declared = declarations(type(records[0]))
    for name in names or declared:
        declaration = declared[name]
        values = [getattr(record, name) for record in records]
        if declaration.kind is not None or isinstance(declaration.unit, Note):
            continue
        column = np.array(values)
        if declaration.unit is not None:
            # what one of them lacks is no number
            column = np.array(values, float)
        key = declaration.key or name
        yield Data(key, declaration.unit or "", column, dims, declaration.doc)


class Plots:
    """The functions of `jaxcomp.plot` that draw a result, with the result filled in."""

    def __init__(self, result: Result):
        self._result = result

    def __dir__(self) -> list[str]:
        return sorted(self._functions())

    def _functions(self) -> dict[str, tuple[Any, str]]:
        """Functions by name, each with the parameter that takes the result."""
        # pictures know the results, not results the pictures: these have registered themselves there
        drawing = importlib.import_module(f"{_PACKAGE}.plot._drawing")
        return drawing.drawings_of(type(self._result))

    def __getattr__(self, name: str) -> Any:
        functions = self._functions()
        if name not in functions:
            raise AttributeError(
                f"{type(self._result).__name__}.plot has no `{name}`{hint(name, functions)}; "
                f"it has {', '.join(sorted(functions))}"
            )
        function, place = functions[name]
        # what is passed by position fills the other parameters in their order
        parameters = [p for p in inspect.signature(function).parameters if p != place]

        def draw(*positional, **options):
            named = {place: self._result}
            for parameter, argument in zip(parameters, positional, strict=False):
                # a machine or a scene stands for its compressor
                if hasattr(argument, "as_compressor"):
                    argument = argument.as_compressor()
                named[parameter] = argument
            try:
                return function(**named, **options)
            except BadInput:
                raise
            except (TypeError, ValueError, IndexError):
                # shapes that do not go together are those of many designs, where there are many;
                # some pictures show these
                for data in self._result.described():
                    _refuse_many(data)
                raise

        draw.__doc__ = function.__doc__
        draw.__name__ = name
        return draw


def load_result(path: str | Path) -> Any:
    """Read a result that `Result.save` wrote, with the same bits in every number.

    Args:
        path: the file.

    Only classes of results and parts are made, of jaxcomp, of registered extensions and of the running
    program; nothing else that a file names is looked up.

    Raises:
        BadInput: a file that is damaged or holds no result, or one of another version whose parts are
            not there.
    """
    path = regular(path)
    try:
        _check_size(path)
        with np.load(path) as file:
            head = json.loads(str(file["head"]))
            if head["format"] != _FORMAT:
                raise ValueError
            arrays = {}
            for name in file.files:
                if name != "head":
                    arrays[name] = file[name]
        written = str(head["version"])
        content = head["result"]
    except BadInput:
        # of a file that is too large, which says more than the line below
        raise
    except Exception:  # whatever numpy, zipfile and json make of damaged bytes
        raise BadInput("path", str(path), "a file that `save` of a result wrote") from None
    try:
        result = from_json(content, arrays)
        if not isinstance(result, Result):
            raise UnknownClass(f"{type(result).__name__} is no result")
    except UnknownClass as error:
        problem = f"{path} of jaxcomp {written}, which this version cannot read ({error})"
        raise BadInput("path", problem, f"written by jaxcomp {version(_PACKAGE)}") from None
    except Exception:  # any other structure than `save` writes
        raise BadInput("path", f"{path}, which is damaged", "as `save` wrote it") from None
    return result


def _check_size(path: Path) -> None:
    """Refuse an archive that would fill the memory; what it unpacks to stands in it.

    Raises:
        BadInput: it would.
    """
    with zipfile.ZipFile(path) as archive:
        sizes = {member.filename: member.file_size for member in archive.infolist()}
    head_size = sizes.get("head.npy", 0)
    size = sum(sizes.values())
    if head_size > _LARGEST_HEAD or size > _LARGEST:
        problem = f"{path}, which unpacks to {size / 1e9:.3g} GB"
        raise BadInput("path", problem, f"a result of at most {_LARGEST / 1e9:.3g} GB")


def _finite(values: np.ndarray) -> Any:
    """Values as lists and numbers, `None` for those that are not finite."""
    if values.dtype.kind != "f" or np.isfinite(values).all():
        return values.tolist()
    return np.where(np.isfinite(values), values, None).tolist()


def csv_text(columns: dict[str, Any]) -> str:
    """A table of columns as CSV, with every digit of its numbers."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    # Python's numbers, whose shortest text gives the same bits again
    lists = [np.asarray(values).tolist() for values in columns.values()]
    writer.writerows(zip(*lists, strict=True))
    return text.getvalue()


def _sentence(name: str) -> str:
    return shown(name, "", 0.0).words
