"""Functions that draw: each has the option `interactive`, and a result finds those that draw it."""

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Callable
from typing import Any, TypeVar, get_args

from ._interactive import interactive

_Drawing = TypeVar("_Drawing", bound=Callable)
_DRAWINGS: dict[str, Callable] = {}
# By the class of a result: functions that draw it by name, with the parameter that takes it.
_OF_RESULTS: dict[type, dict[str, tuple[Callable, str]]] = {}


def draws(**results: Any) -> Callable[[_Drawing], _Drawing]:
    """Make the decorator of a function that draws: it adds the option `interactive`.

    Args:
        results: classes of results that the function draws, by the parameter that takes them; it is then
            a picture of theirs, such as `orbit.plot.pv_diagram(machine)`.
    """

    def decorate(function: _Drawing) -> _Drawing:
        drawing = _with_interactive(function)
        name = function.__name__
        _DRAWINGS[name] = drawing
        for parameter, kinds in results.items():
            for kind in get_args(kinds) or (kinds,):
                _OF_RESULTS.setdefault(kind, {})[name] = (drawing, parameter)
        return drawing

    return decorate


def _with_interactive(function: _Drawing) -> _Drawing:
    signature = inspect.signature(function)
    option = inspect.Parameter(
        "interactive", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=bool
    )

    @functools.wraps(function)
    def _draw(*arguments, **options):
        as_plotly = options.pop("interactive", False)
        drawn = function(*arguments, **options)
        if not as_plotly:
            return drawn
        if isinstance(drawn, dict):
            return {name: interactive(figure) for name, figure in drawn.items()}
        return interactive(drawn)

    _draw.__doc__ = (
        f"{function.__doc__}\n    With `interactive=True`: figures of plotly, see `interactive`.\n"
    )
    _draw.__signature__ = signature.replace(  # pyright: ignore[reportAttributeAccessIssue]
        parameters=[*signature.parameters.values(), option]
    )
    return _draw  # pyright: ignore[reportReturnType]


def drawings() -> dict[str, Callable]:
    """Functions that draw, by name."""
    package = importlib.import_module(__package__)
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{__package__}.{module.name}")
    return dict(_DRAWINGS)


def drawings_of(kind: type) -> dict[str, tuple[Callable, str]]:
    """Functions that draw results of a class, by name, each with the parameter that takes the result."""
    # a module that nobody has imported yet has registered nothing
    drawings()
    return _OF_RESULTS.get(kind, {})
