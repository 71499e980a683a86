r"""The best designs of a sweep."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from ..._core.display import Shown, shown
from ..._core.errors import BadInput
from ._store import quantity_names, variable_names

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
    values = _minimised(found, name)
    if not np.any(np.isfinite(values)):
        return None
    place = np.unravel_index(np.nanargmin(values), values.shape)
    design = found.isel(dict(zip(found[name].dims, place, strict=True)))
    names = [*variable_names(design), *quantity_names(design)]
    return {name: float(design[name]) for name in names}


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
    values = _minimised(found, name)
    along = np.asarray(found[dims[0]])
    across = np.asarray(found[dims[1]])
    order = np.argsort(along)
    along = along[order]
    values = values[order]
    all_failed = ~np.any(np.isfinite(values), axis=0)
    # A design that failed is never the best one, and a column of such designs still has a row.
    filled = np.where(np.isfinite(values), values, np.inf)
    best = np.argmin(filled, axis=0)
    between = []
    for column, row in enumerate(best):
        between.append(_vertex(along, filled[:, column], row))
    sign = 1.0
    if found[name].attrs["better"] == "more":
        sign = -1.0
    return BestCurve(
        across=across,
        along=np.where(all_failed, np.nan, along[best]),
        between=np.where(all_failed, np.nan, between),
        value=np.where(all_failed, np.nan, sign * np.min(filled, axis=0)),
    )


def _minimised(dataset, name) -> np.ndarray:
    """The quantity so that less is better."""
    better = dataset[name].attrs.get("better", "")
    if better not in ("more", "less"):
        raise BadInput("quantity", name, "one of which more or less is better")
    values = np.asarray(dataset[name])
    if better == "more":
        return -values
    return values


def _vertex(x, y, row) -> float:
    """Where the parabola through the lowest point and its neighbours is lowest, or that point."""
    neighbours = slice(row - 1, row + 2)
    if not 0 < row < len(x) - 1 or not np.all(np.isfinite(y[neighbours])):
        return x[row]
    left_step, right_step = np.diff(x[neighbours])
    fall, rise = np.diff(y[neighbours]) / (left_step, right_step)
    # Three points on a line have no vertex; what is not a number ends here as well.
    if not rise > fall:
        return x[row]
    curve = (rise - fall) / (left_step + right_step)
    # slope at the point, which its being lowest keeps within one step of zero
    slope = (fall * right_step + rise * left_step) / (left_step + right_step)
    return np.clip(x[row] - slope / (2 * curve), x[row - 1], x[row + 1])


def shown_column(dataset: "xarray.Dataset", name: str) -> Shown:
    """Format in which a variable or quantity of a `sweep` is shown.

    Args:
        dataset: what `sweep` returned.
        name: of a variable or quantity.
    """
    return shown(name, dataset[name].attrs.get("units", ""), dataset[name].values)
