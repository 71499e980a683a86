"""Functions that draw: each has the option `interactive`, and a result finds those that draw it."""

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Callable
from typing import TypeVar

from ._interactive import interactive

_Drawing = TypeVar("_Drawing", bound=Callable)
_DRAWINGS: dict[str, Callable] = {}


def drawing(function: _Drawing) -> _Drawing:
    """Decorator of a function that draws: adds the option `interactive`, lists it in `drawings`."""
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
    _DRAWINGS[function.__name__] = _draw
    return _draw  # pyright: ignore[reportReturnType]


def drawings() -> dict[str, Callable]:
    """Functions that draw, by name; those with a parameter of a result's class draw that result."""
    package = importlib.import_module(__package__)
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{__package__}.{module.name}")
    return dict(_DRAWINGS)
