r"""The best designs of a sweep."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from ..._core.display import Shown, shown
from ..._core.errors import BadInput
from ._store import quantity_names

if TYPE_CHECKING:
    import xarray


class BestCurve(NamedTuple):
    """The best value of one variable for each value of another.

    Attributes:
        across: [SI] (n,) the other variable.
        along: [SI] (n,) the best of the values that were tried; NaN where all designs failed.
        between: [SI] (n,) the vertex of the parabola through it and its two neighbours, which lies
            between the values that were tried; the value itself at an end of them.
        value: [SI] (n,) of the quantity at `along`.
    """

    across: Float[np.ndarray, " n"]
    along: Float[np.ndarray, " n"]
    between: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]


def best_design(found: "xarray.Dataset", name: str) -> dict[str, float] | None:
    """The variables and the quantities of the best design of a `sweep`; `None` where every one failed.

    Args:
        found: of `sweep`.
        name: of the quantity that is judged.

    Raises:
        BadInput: a quantity that is neither better when larger nor when smaller.
    """
    values = _falling(found, name)
    if not np.any(np.isfinite(values)):
        return None
    place = np.unravel_index(np.nanargmin(values), values.shape)
    there = found.isel(dict(zip(found[name].dims, place, strict=True)))
    names = [*(str(n) for n in there.coords if n != "sample"), *quantity_names(there)]
    return {name: float(there[name]) for name in names}


def best_curve(found: "xarray.Dataset", name: str) -> BestCurve:
    """The best value of the first variable for each value of the second.

    Args:
        found: of `sweep`, over two variables.
        name: of the quantity that is judged.

    Raises:
        BadInput: as `best_design`; or other than two dimensions.
    """
    dims = found[name].dims
    if len(dims) != 2:
        raise BadInput(name, f"over {len(dims)} variables", "over two, for a curve of best values")
    values = _falling(found, name)
    along, across = (np.asarray(found[dim]) for dim in dims)
    order = np.argsort(along)
    along = along[order]
    values = values[order]
    lost = ~np.any(np.isfinite(values), axis=0)
    filled = np.where(np.isfinite(values), values, np.inf)
    best = np.argmin(filled, axis=0)
    between = [_vertex(along, filled[:, column], row) for column, row in enumerate(best)]
    sign = -1.0 if found[name].attrs["better"] == "more" else 1.0
    return BestCurve(
        across,
        np.where(lost, np.nan, along[best]),
        np.where(lost, np.nan, between),
        np.where(lost, np.nan, sign * np.min(filled, axis=0)),
    )


def _falling(found, name) -> np.ndarray:
    """The quantity so that less is better."""
    better = found[name].attrs.get("better", "")
    if better not in ("more", "less"):
        raise BadInput("quantity", name, "one of which more or less is better")
    values = np.asarray(found[name])
    return -values if better == "more" else values


def _vertex(x, y, row) -> float:
    """Where the parabola through the lowest point and its neighbours is lowest, or that point."""
    three = slice(row - 1, row + 2)
    if not 0 < row < len(x) - 1 or not np.all(np.isfinite(y[three])):
        return x[row]
    left, right = np.diff(x[three])
    fall, rise = np.diff(y[three]) / (left, right)
    if not rise > fall:
        return x[row]
    curve = (rise - fall) / (left + right)
    # slope at the point, which its being lowest keeps within one step of zero
    slope = (fall * right + rise * left) / (left + right)
    return np.clip(x[row] - slope / (2 * curve), x[row - 1], x[row + 1])


def shown_column(found: "xarray.Dataset", name: str) -> Shown:
    """Format in which a variable or quantity of a `sweep` is shown.

    Args:
        found: what `sweep` returned.
        name: of a variable or quantity.
    """
    return shown(name, found[name].attrs.get("units", ""), found[name].values)
