r"""The best designs of a sweep."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from .._fields import BadInput
from .._shown import Shown, shown

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
    """The variables and the quantities of the best design, by name.

    Args:
        found: of `sweep`.
        name: of the quantity that is judged.

    Returns:
        `None` where every design failed.

    Raises:
        BadInput: a quantity that is neither better when larger nor when smaller.
    """
    values = _falling(found, name)
    if not np.any(np.isfinite(values)):
        return None
    place = np.unravel_index(np.nanargmin(values), values.shape)
    there = found.isel(dict(zip(found[name].dims, place, strict=True)))
    names = [*(n for n in there.coords if n != "sample"), *there.data_vars]
    return {str(n): float(there[n]) for n in names if n != "ok"}


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
    along, values = along[order], values[order]
    lost = ~np.any(np.isfinite(values), axis=0)
    filled = np.where(np.isfinite(values), values, np.inf)
    best = np.argmin(filled, axis=0)
    columns = np.arange(across.size)
    between = along[best]
    for column in columns:
        row = best[column]
        if 0 < row < along.size - 1:
            between[column] = _vertex(along[row - 1 : row + 2], filled[row - 1 : row + 2, column])
    sign = -1.0 if found[name].attrs["better"] == "more" else 1.0
    return BestCurve(
        across,
        np.where(lost, np.nan, along[best]),
        np.where(lost, np.nan, between),
        np.where(lost, np.nan, sign * values[best, columns]),
    )


def _falling(found, name) -> np.ndarray:
    """The quantity so that less is better."""
    better = found[name].attrs.get("better", "")
    if better not in ("more", "less"):
        raise BadInput("quantity", name, "one of which more or less is better")
    values = np.asarray(found[name])
    return -values if better == "more" else values


def _vertex(x, y) -> float:
    """Where the parabola through three points is lowest; the middle if it is none."""
    if not np.all(np.isfinite(y)):
        return float(x[1])
    left, right = x[1] - x[0], x[2] - x[1]
    fall, rise = (y[1] - y[0]) / left, (y[2] - y[1]) / right
    if not rise > fall:
        return float(x[1])
    curve = (rise - fall) / (left + right)
    # slope at the middle, which the middle being lowest keeps within one step of zero
    slope = (fall * right + rise * left) / (left + right)
    return float(np.clip(x[1] - slope / (2 * curve), x[0], x[2]))


def shown_column(found: "xarray.Dataset", name: str) -> Shown:
    """How a variable or quantity of a sweep is shown.

    Args:
        found: of `sweep`.
        name: of the variable or quantity.
    """
    return shown(name, found[name].attrs.get("units", ""), found[name].values)
