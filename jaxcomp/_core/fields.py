"""Fields of machine parts: unit and bound declared once, checked everywhere.

A part is an `equinox.Module` whose numbers are declared with [`quantity`][]. The declaration
carries the SI unit and the bound of the value. Everything that needs either of them reads it
from there: the constructor (which refuses a bad value by name), the scene reader (which converts
units), the solvers (which mark a traced design outside its bounds) and the printed tables.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool

from . import precision as precision  # before JAX runs anything
from .errors import BadInput, value_text
from .printed import printed

_MISSING = dataclasses.MISSING
_Class = TypeVar("_Class", bound=type)
_Tree = TypeVar("_Tree")


# No number of a machine in SI units comes near; products of some larger ones overflow.
LARGEST = 1e25


class Bound(NamedTuple):
    """An interval, open or closed on either side."""

    low: float = -np.inf
    high: float = np.inf
    low_open: bool = False
    high_open: bool = False

    @property
    def _ends(self) -> tuple[Any, Any]:
        # the ends are clipped, so that infinity lies outside of a bound that is open to that side
        def within(end):  # one that depends on other numbers of a machine may be traced
            return end if isinstance(end, Array) else np.clip(end, -LARGEST, LARGEST)

        return within(self.low), within(self.high)

    def inside(self, x):
        """Whether each entry of `x` lies inside; false for NaN and for sizes beyond `LARGEST`.

        An array of NumPy gives one of NumPy.
        """
        low, high = self._ends
        above = x > low if self.low_open else x >= low
        below = x < high if self.high_open else x <= high
        return above & below

    def holds(self, x):
        """Whether every entry of `x` lies inside. Works on traced values."""
        return jnp.all(self.inside(x))

    def clip(self, x: Array) -> Array:
        """`x` moved to a nearby admissible value, so that a solver can go on with it.

        An admissible `x` passes untouched, however small, with a derivative of one on the bound as
        well. NaN goes to the upper bound, and whatever has no bound on its side to 1 or close to it.
        """
        # constants throughout: a program has this for each of the hundred numbers of a machine
        low, high = self._ends
        at_low = low
        at_high = high
        if self.low_open:
            at_low = low + 1e-6 * max(1.0, abs(low))
        if self.high_open:
            at_high = high - 1e-6 * max(1.0, abs(high))
        # an end that `LARGEST` has set is no size to go on with
        usual = min(max(1.0, at_low), at_high)
        if low != self.low:
            at_low = usual
        if high != self.high:
            at_high = usual
        return jnp.where(self.inside(x), x, jnp.where(x <= low, at_low, at_high))

    def __str__(self) -> str:
        parts = []
        if self.low > -np.inf:
            parts.append(f"{'>' if self.low_open else '>='} {self.low:g}")
        if self.high < np.inf:
            parts.append(f"{'<' if self.high_open else '<='} {self.high:g}")
        return " and ".join(parts) or "finite"


def plausible(bound: Bound, unit: str, usual: tuple[float, float] | None) -> Bound:
    """A bound without the lengths that can only be millimetres taken for metres.

    Args:
        bound: of a number.
        unit: its SI unit.
        usual: [SI] its usual range; one that ends below half a metre says nothing.
    """
    if unit != "m" or usual is None or usual[1] < 0.5:
        return bound
    # ten times leaves room for large machines: millimetres are wrong by a thousand
    return bound._replace(high=min(bound.high, 10 * usual[1]), high_open=False)


ANY = Bound()
POSITIVE = Bound(low=0.0, low_open=True)
NONNEGATIVE = Bound(low=0.0)


def quantity(
    unit: str,
    bound: Bound = ANY,
    *,
    shape: tuple = (),
    default: Any = _MISSING,
    doc: str = "",
    spread: bool = False,
    usual: tuple[float, float] | None = None,
) -> Any:
    """Declare a field that holds a float array in an SI unit.

    Args:
        unit: SI unit in the notation of pint, `""` for a pure number.
        bound: interval of admissible values, checked entry by entry.
        shape: expected shape; `None` stands for any length along that axis, `(...,)` for any shape,
            which the class checks.
        default: value if none is given; `None` makes the field optional.
        doc: one line for the tables of `jaxcomp`.
        spread: a column of a table, for which a single value stands for all rows; the class calls
            `spread_columns` once it knows their number.
        usual: [SI] sizes between which values lie in reciprocating compressors from the smallest
            household machine to large process machines; `check` points at others, but for zero, which
            switches an effect off.
    """
    metadata = {"unit": unit, "bound": bound, "shape": shape, "doc": doc, "spread": spread}
    metadata["usual"] = usual
    options: dict[str, Any] = {"converter": _as_float, "metadata": metadata}
    if default is not _MISSING:
        options["default"] = default
    return eqx.field(**options)


def names_with_value(frozen: _Class) -> _Class:
    """A class whose fields stay as they are, and that says how another value is given."""
    # when a field may be set is still decided there; only the refusal gets other words
    refuse = frozen.__setattr__

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            refuse(self, name, value)
        except dataclasses.FrozenInstanceError:
            raise dataclasses.FrozenInstanceError(
                f"`{name}` stays as it is: a machine is never changed in place. "
                "jaxcomp.scene.with_value(machine, PATH, VALUE) gives another machine, such as "
                'with_value(machine, "motor.mean_speed", "900 rpm")'
            ) from None

    setattr(frozen, "__setattr__", __setattr__)  # noqa: B010, which pyright takes for a method
    return frozen


@names_with_value
class Part(eqx.Module):
    """Base of every machine part: float arrays with a unit and a bound each.

    A subclass may add rules across its fields by overriding `conditions`. The constructor checks
    concrete values and raises `BadInput`; traced values pass, and `admissible` tells a solver
    afterwards whether they were good.
    """

    # Whether a single number may be a list with one value for each of several cylinders.
    for_each_cylinder: ClassVar[bool] = False
    # Lists of numbers that a machine file may have as a table of them by name.
    tables_by_name: ClassVar[tuple[str, ...]] = ()

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        """Rules across fields, as {"what must hold": whether it holds}.

        The constructor asks a copy whose known values are arrays of NumPy: a rule written with
        operators and methods compiles nothing there.
        """
        return {}

    def repaired(self) -> "Part":
        """The nearest part that keeps the rules of `conditions`; only called on traced values."""
        return self

    @classmethod
    def written(cls, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """Entries of a section of a machine file; a class may read what has another form there."""
        return table

    @classmethod
    def of_entries(cls, **entries: Any) -> "Part":
        """The part that these entries of a section describe, which a class may leave to another."""
        return cls(**entries)

    def rewritten(self, old: "Part | None", source: str) -> dict[str, Any] | None:
        """Section of a machine file for this part, where its entries do not show how it differs from
        an old one.

        Args:
            old: the part that the section describes so far.
            source: of values that differ.
        """
        del old, source
        return None

    def __check_init__(self):
        for name, field in quantities(self):
            value = getattr(self, name)
            declared = field.metadata
            if value is None:
                continue
            if isinstance(value, str):
                bound = "a number in SI units; texts with units stand in machine files"
                raise BadInput(name, f'"{value}"', bound)
            bound = plausible(declared["bound"], declared["unit"], declared["usual"])
            listed = is_listed(self, field, value)
            if not listed:
                _check_shape(type(self).__name__, name, value, field.metadata["shape"])
            if not is_traced(value) and not bound.inside(np.asarray(value)).all():
                raise _outside(name, value, bound, declared, listed)
        for rule, holds in known_values(self).conditions().items():
            if not is_traced(holds) and not np.all(holds):
                where = ""
                if np.ndim(holds):
                    where = f" in cylinder {int(np.argmin(holds)) + 1}"
                raise BadInput(type(self).__name__, self._values(), f"{rule}{where}")

    def __repr__(self) -> str:
        return printed(self)

    def _values(self) -> str:
        texts = []
        for name, _ in quantities(self):
            value = getattr(self, name)
            if value is not None and value.ndim == 0:
                texts.append(f"{name} = {value_text(value)}")
        return ", ".join(texts)


def quantities(part: Part | type[Part]) -> Iterator[tuple[str, dataclasses.Field]]:
    """The fields of a part that were declared with `quantity`, by name."""
    for field in dataclasses.fields(part):
        if "unit" in field.metadata:
            yield field.name, field


def is_listed(part: Part | type[Part], field: dataclasses.Field, value: Any) -> bool:
    """Whether a number of a part is given as a list with a value for each of several cylinders."""
    single = part.for_each_cylinder and field.metadata["shape"] == ()
    return single and value is not None and jnp.ndim(value) == 1


def spread_columns(part: Part, rows: int, row_name: str) -> None:
    """Give every `spread` column of a part under construction one value a row.

    Args:
        part: the part, in its `__post_init__`.
        rows: how many.
        row_name: what a row is, for the message.

    Raises:
        BadInput: a column of another length.
    """
    for name, field in quantities(part):
        value = getattr(part, name)
        if not field.metadata["spread"] or value is None or type(value) is object:
            continue
        value = _as_float(value)
        if value.ndim == 0:
            library = jnp if is_traced(value) else np  # by NumPy no program is compiled
            value = _as_float(library.full(rows, value))
        if value.shape != (rows,):
            raise BadInput(name, value, f"one value, or one for each of {rows} {row_name}")
        setattr(part, name, value)


def subparts(tree: Any) -> Iterator[tuple[str, Part]]:
    """A part and all parts inside it, with their dotted paths ("" for the part itself)."""
    if isinstance(tree, Part):
        yield "", tree
        children = [(field.name, getattr(tree, field.name)) for field in dataclasses.fields(tree)]
    elif isinstance(tree, tuple):
        children = [(str(index), child) for index, child in enumerate(tree)]
    else:
        return
    for name, child in children:
        for path, part in subparts(child):
            yield f"{name}.{path}" if path else name, part


def at(tree: Any, path: str | Sequence[str]) -> Any:
    """The object at the end of a path, dotted or in steps, through parts, tables and lists.

    Raises:
        LookupError: a step leads nowhere.
    """
    if isinstance(path, str):
        path = path.split(".")
    for step in path:
        is_sequence = isinstance(tree, tuple | list) or (eqx.is_array(tree) and tree.ndim)
        if isinstance(tree, Mapping):
            tree = tree[step]
        elif is_sequence and step.isdigit() and int(step) < len(tree):
            tree = tree[int(step)]
        elif isinstance(tree, Part) and any(f.name == step for f in dataclasses.fields(tree)):
            tree = getattr(tree, step)
        else:
            raise LookupError(step)
    return tree


def admissible(tree: Part) -> Bool[Array, ""]:
    """Whether every value is inside its bound and every rule holds; for traced values too."""
    # an array, because Python does not know the truth of a traced value
    good = jnp.asarray(True)
    values: dict[Bound, list[Array]] = {}
    for _, part in subparts(tree):
        for name, field in quantities(part):
            value = getattr(part, name)
            if value is not None:
                values.setdefault(field.metadata["bound"], []).append(value)
        for holds in part.conditions().values():
            if jnp.ndim(holds):
                holds = jnp.all(holds)
            good &= holds
    # Values of one bound are compared together, for the sake of the compiler.
    for bound, bounded in values.items():
        good &= bound.holds(jnp.concatenate([jnp.ravel(value) for value in bounded]))
    return good


def clipped(tree: _Tree) -> _Tree:
    """`tree` with every value moved inside its bound and every rule kept.

    A solver works on this copy, so that a design outside its bounds (which `admissible` reports)
    cannot put a NaN into a batch of good ones. A good design passes untouched.
    """
    if isinstance(tree, tuple) and any(isinstance(item, Part) for item in tree):
        return tuple(clipped(item) for item in tree)  # pyright: ignore[reportReturnType]
    if not isinstance(tree, Part):
        return tree
    changes = {}
    for field in dataclasses.fields(tree):
        value = getattr(tree, field.name)
        if isinstance(value, Part | tuple):
            # names and numbers of the structure, for which there is no bound
            if field.metadata.get("static"):
                continue
            changes[field.name] = clipped(value)
        elif "unit" in field.metadata and value is not None:
            changes[field.name] = field.metadata["bound"].clip(value)
    # bounds first: a rule between fields compares numbers that lie within theirs
    return replaced(tree, **changes).repaired()  # pyright: ignore[reportReturnType]


def replaced(part: _Tree, **changes) -> _Tree:
    """A copy of a part with other values in some fields, unchecked as every traced value is."""
    names = list(changes)
    if not names:
        return part
    return eqx.tree_at(
        lambda p: [getattr(p, name) for name in names],
        part,
        list(changes.values()),
        # To JAX `None` is no leaf, but an absent field may get a value.
        is_leaf=lambda leaf: leaf is None,
    )


def rebuilt(part: _Tree, **changes) -> _Tree:
    """A copy with other fields, of other types as well, made as JAX makes one from its leaves."""
    # no constructor, which would check values that have been checked or are traced
    new = object.__new__(type(part))
    for field in dataclasses.fields(part):  # pyright: ignore[reportArgumentType]
        value = changes.get(field.name, getattr(part, field.name))
        object.__setattr__(new, field.name, value)
    return new


def _outside(
    name: str, value: Any, bound: Bound, declared: Mapping[str, Any], listed: bool
) -> BadInput:
    """The complaint about a value outside its bound; of a list it names the first such cylinder."""
    allowed = str(bound)
    if bound != ANY:
        allowed += f" {declared['unit']}".rstrip()
    if np.any(np.abs(value) > LARGEST) and bound.high > LARGEST:
        allowed += ", and at most 1e25 in size"
    else:
        allowed += _in_metres(np.asarray(value), declared["bound"], bound)
    if not listed:
        return BadInput(name, value, allowed)
    # the first false one: false sorts before true
    place = int(np.argmin(bound.inside(np.asarray(value))))
    return BadInput(name, value[place], f"{allowed} in cylinder {place + 1}")


def _in_metres(value: np.ndarray, declared: Bound, plausible_bound: Bound) -> str:
    """Advice for a length that was given in millimetres."""
    if declared.high <= plausible_bound.high or not plausible_bound.high < value.max() <= LARGEST:
        return ""
    largest = float(value.max())
    return f" (lengths are in m; {largest:g} mm are {largest / 1e3:g})"


def _as_float(value: Any) -> Any:
    # `object()` marks a leaf in JAX's own tree tools, and a text is named once its field is known
    if value is None or type(value) is object or isinstance(value, str):
        return value
    return jnp.asarray(value, dtype=jnp.result_type(float))


def known_values(part: _Tree) -> _Tree:
    """A copy whose values are arrays of NumPy, where they are known: comparing them compiles nothing."""

    def concrete(leaf):
        if isinstance(leaf, Array) and not is_traced(leaf):
            return np.asarray(leaf)
        return leaf

    return jax.tree.map(concrete, part)


def is_traced(value: Any) -> bool:
    """Whether a value is known only as a symbol, within `jit`, `vmap` or `grad`."""
    return isinstance(value, Tracer)


def is_any_traced(*trees: Any) -> bool:
    """Whether any number of these structures is known only as a symbol."""
    return any(is_traced(leaf) for leaf in jax.tree.leaves(trees))


def strongly_typed(leaf: Any) -> Any:
    """A leaf of a structure; a weakly typed array with its type made definite.

    `jnp.asarray(0.04)` is weakly typed, and programs of their own are compiled for weak types: a field
    set to it would have a whole solution compiled anew.
    """
    # of a traced one no program of its own is compiled
    if isinstance(leaf, jax.Array) and not is_traced(leaf) and leaf.weak_type:
        return jnp.asarray(leaf, leaf.dtype)
    return leaf


def _check_shape(owner: str, name: str, value: Array, shape: tuple) -> None:
    if shape == (...,):
        return
    fits = len(value.shape) == len(shape)
    for expected, length in zip(shape, value.shape, strict=False):
        fits &= expected is None or expected == length
    if not fits:
        raise ValueError(
            f"`{owner}.{name}` must have shape {shape}, but has shape {value.shape}; "
            "for many designs at once map the function with `jax.vmap`."
        )
