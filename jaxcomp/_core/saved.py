"""Results in files: their fields as JSON and arrays, and back to the same bits."""

import dataclasses
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .errors import BadInput
from .extensions import import_extensions
from .fields import Part
from .status import Status

_PACKAGE = __name__.partition(".")[0]
# Packages that files of former versions name, and where their classes are now.
_MOVED = {
    f"{_PACKAGE}.{before}": f"{_PACKAGE}.{now}"
    for before, now in {
        "design": "study",
        "sweeping": "study.sweep",
        "tolerancing": "study.tolerance",
        "work_precision": "study.accuracy",
        "rating": "study.rating",
        "shaking": "vibration",
        "coupling": "vibration",
        "running": "vibration",
    }.items()
}


class UnknownClass(ValueError):
    """A class or a field that a file names and that is not there."""


def to_json(value: Any, arrays: list[np.ndarray]) -> Any:
    """A value as JSON, with its arrays in a list beside it."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        arrays.append(np.asarray(value))
        kind = "jax" if isinstance(value, jax.Array) else "numpy"
        return {kind: f"array_{len(arrays) - 1}"}
    if isinstance(value, type) or inspect.isfunction(value):
        raise BadInput("result", value.__qualname__, "without functions of the user, to be saved")
    if type(value).__name__ == "EnumerationItem":
        return {"status": to_json(value._value, arrays)}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return {"tuple": [to_json(one, arrays) for one in value]}
    if isinstance(value, list):
        return {"list": [to_json(one, arrays) for one in value]}
    if isinstance(value, dict):
        return {"dict": [[to_json(k, arrays), to_json(v, arrays)] for k, v in value.items()]}
    names = _field_names(type(value))
    if not names:
        raise BadInput(
            "result", type(value).__name__, "of arrays and parts of jaxcomp, to be saved"
        )
    left_out = getattr(value, "not_saved", ())
    fields = {
        name: None if name in left_out else to_json(getattr(value, name), arrays)
        for name in names
        if hasattr(value, name)
    }
    return {"class": class_address(type(value)), "fields": fields}


def from_json(kept: Any, arrays: dict[str, np.ndarray]) -> Any:
    if not isinstance(kept, dict):
        return kept
    if "class" in kept:
        return _object(class_at(kept["class"]), kept["fields"], arrays)
    ((kind, content),) = kept.items()
    if kind in ("jax", "numpy"):
        return jnp.asarray(arrays[content]) if kind == "jax" else arrays[content]
    if kind == "status":
        value = from_json(content, arrays)
        if np.asarray(value).dtype.kind not in "iu" or np.any((value < 0) | (value >= len(Status))):
            raise ValueError(content)
        return eqx.tree_at(lambda s: s._value, Status.converged, value)
    if kind in ("tuple", "list"):
        made = [from_json(one, arrays) for one in content]
        return tuple(made) if kind == "tuple" else made
    if kind == "dict":
        return {from_json(k, arrays): from_json(v, arrays) for k, v in content}
    raise UnknownClass(kind)


def _object(made_of: type, fields: dict[str, Any], arrays: dict[str, np.ndarray]) -> Any:
    values = {name: from_json(value, arrays) for name, value in fields.items()}
    known = _field_names(made_of)
    for name in {*values} ^ {*known}:
        if name in values or not hasattr(made_of, name):
            raise UnknownClass(f"{made_of.__name__}.{name}")
    if issubclass(made_of, tuple):
        return made_of(**values)
    # unchecked, as the fields come from an object that was checked
    made = object.__new__(made_of)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def _field_names(kind: type) -> list[str]:
    """Fields of a dataclass or of a tuple with names; none of any other class."""
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(getattr(kind, "_fields", ()))


def class_address(thing: Any) -> str:
    """Name of a class in the package that offers it: a file outlives the modules of a package."""
    module = _public(thing.__module__)
    name = thing.__qualname__
    package = ".".join(module.split(".")[:2])
    offers = (
        module.startswith(f"{_PACKAGE}.") and getattr(sys.modules[package], name, None) is thing
    )
    return f"{package if offers else module}:{name}"


def _public(module: str) -> str:
    """The package of a private module; that of the core is the whole one."""
    if module.startswith(f"{_PACKAGE}._core."):
        return _PACKAGE
    return ".".join(word for word in module.split(".") if not word.startswith("_"))


def class_at(address: str) -> type:
    """The class of a result or part at an address.

    Raises:
        UnknownClass: no such class; what else a module has is not looked at.
    """
    module, _, name = address.partition(":")
    module = _MOVED.get(_public(module), _public(module))
    if module.partition(".")[0] == _PACKAGE:  # nothing else is imported on a file's word
        for place in _modules(module):
            kind = vars(place).get(name)
            if isinstance(kind, type) and kind.__module__ == place.__name__ and _field_names(kind):
                return kind
    else:
        import_extensions()
        for kind in _below(Part):
            if class_address(kind) == address and not kind.__module__.startswith(f"{_PACKAGE}."):
                return kind
    raise UnknownClass(address)


def _modules(name: str) -> Iterator[ModuleType]:
    """A module of this package and those below it; of the whole package those beside its packages."""
    try:
        package = importlib.import_module(name)
    except ImportError:
        raise UnknownClass(name) from None
    yield package
    for one in pkgutil.iter_modules(getattr(package, "__path__", ())):
        other = name == _PACKAGE and one.ispkg and one.name != "_core"
        if not other and one.name != "__main__":
            yield from _modules(f"{name}.{one.name}")


def _below(kind: type) -> Iterator[type]:
    for one in kind.__subclasses__():
        yield one
        yield from _below(one)
