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
    # by name, as equinox does not offer the class
    if type(value).__name__ == "EnumerationItem":
        return {"status": to_json(value._value, arrays)}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return {"tuple": [to_json(entry, arrays) for entry in value]}
    if isinstance(value, list):
        return {"list": [to_json(entry, arrays) for entry in value]}
    if isinstance(value, dict):
        # pairs, because a key of JSON is a text
        pairs = []
        for key, entry in value.items():
            pairs.append([to_json(key, arrays), to_json(entry, arrays)])
        return {"dict": pairs}
    if not _field_names(type(value)):
        raise BadInput(
            "result", type(value).__name__, "of arrays and parts of jaxcomp, to be saved"
        )
    return {"class": class_address(type(value)), "fields": _fields_to_json(value, arrays)}


def _fields_to_json(value: Any, arrays: list[np.ndarray]) -> dict[str, Any]:
    """Fields of an object as JSON; `None` for those that its class does not save."""
    fields = {}
    for name in _field_names(type(value)):
        if name in getattr(value, "not_saved", ()):
            fields[name] = None
        elif hasattr(value, name):
            fields[name] = to_json(getattr(value, name), arrays)
    return fields


def from_json(document: Any, arrays: dict[str, np.ndarray]) -> Any:
    if not isinstance(document, dict):
        return document
    if "class" in document:
        return _object(class_at(document["class"]), document["fields"], arrays)
    # exactly one entry: another structure than `to_json` writes is told as damaged
    ((kind, content),) = document.items()
    if kind == "numpy":
        return arrays[content]
    if kind == "jax":
        return jnp.asarray(arrays[content])
    if kind == "status":
        value = from_json(content, arrays)
        # a code that no outcome has would fail much later, where its words are looked up
        if np.asarray(value).dtype.kind not in "iu" or np.any((value < 0) | (value >= len(Status))):
            raise ValueError(content)
        return eqx.tree_at(lambda s: s._value, Status.converged, value)
    if kind == "list":
        return [from_json(entry, arrays) for entry in content]
    if kind == "tuple":
        return tuple(from_json(entry, arrays) for entry in content)
    if kind == "dict":
        return {from_json(k, arrays): from_json(v, arrays) for k, v in content}
    raise UnknownClass(kind)


def _object(kind: type, fields: dict[str, Any], arrays: dict[str, np.ndarray]) -> Any:
    values = {name: from_json(value, arrays) for name, value in fields.items()}
    names = _field_names(kind)
    # a field that the file lacks may have a default; one that the class lacks is of another version
    for name in {*values} ^ {*names}:
        if name in values or not hasattr(kind, name):
            raise UnknownClass(f"{kind.__name__}.{name}")
    if issubclass(kind, tuple):
        return kind(**values)
    # unchecked, as the fields come from an object that was checked
    new = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(new, name, value)
    return new


def _field_names(kind: type) -> list[str]:
    """Fields of a dataclass or of a tuple with names; none of any other class."""
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(getattr(kind, "_fields", ()))


def class_address(kind: Any) -> str:
    """Name of a class in the package that offers it: a file outlives the modules of a package."""
    module = _public(kind.__module__)
    name = kind.__qualname__
    package = ".".join(module.split(".")[:2])
    if module.startswith(f"{_PACKAGE}.") and getattr(sys.modules[package], name, None) is kind:
        module = package
    return f"{module}:{name}"


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
    module = _public(module)
    if module.partition(".")[0] == _PACKAGE:  # nothing else is imported on a file's word
        for place in _modules(module):
            kind = vars(place).get(name)
            if isinstance(kind, type) and kind.__module__ == place.__name__ and _field_names(kind):
                return kind
    else:
        import_extensions()
        for kind in _below(Part):
            # a private module of this package has the address of its package
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
    for module in pkgutil.iter_modules(getattr(package, "__path__", ())):
        other = name == _PACKAGE and module.ispkg and module.name != "_core"
        if not other and module.name != "__main__":
            yield from _modules(f"{name}.{module.name}")


def _below(kind: type) -> Iterator[type]:
    for subclass in kind.__subclasses__():
        yield subclass
        yield from _below(subclass)
