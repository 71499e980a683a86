r"""A sweep in single numbers, and as a table."""

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._core.results import with_unit
from ._best import best_curve, best_design
from ._store import OK, STATUS, quantity_names, status_words

if TYPE_CHECKING:
    import xarray

# Percentiles of every quantity.
_SHARES = (5, 50, 95)


def summary(found: "xarray.Dataset", most: int = 10_000) -> dict[str, Any]:
    """Ranges and best designs of a `sweep`, in SI units.

    Args:
        found: of `sweep`.
        most: designs up to which all of them are listed.
    """
    ok = found["ok"].values
    few = ok.size <= most
    variables = [str(name) for name in found.coords if name != "sample"]
    quantities = quantity_names(found)
    ended = status_words(found)
    failed = ended[~ok] if ended is not None else []

    def variable(values):
        low = values.values.min()
        high = values.values.max()
        listed = values.values if few else None
        return {"unit": values.attrs["units"], "low": low, "high": high, "values": listed}

    return {
        "dimensions": list(map(str, found["ok"].dims)),
        "shape": ok.shape,
        "designs": ok.size,
        "failed": ok.size - ok.sum(),
        "failed_by_status": dict(Counter(map(str, failed)).most_common()),
        "variables": {name: variable(found[name]) for name in variables},
        "quantities": {name: _quantity(found, name, few) for name in quantities},
        "ok": ok if few else None,
        "status": ended if few else None,
    }


def _quantity(found, name: str, few: bool) -> dict[str, Any]:
    data = found[name].values
    attributes = found[name].attrs
    ranked = attributes["better"] in ("more", "less")
    curve = None
    if ranked and data.ndim == 2 and found[name].dims != ("sample",):
        keys = ("across", "best", "between", "value")
        columns = (column.tolist() for column in map(np.asarray, best_curve(found, name)))
        points = [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]
        along, across = map(str, found[name].dims)
        curve = {"along": along, "across": across, "points": points}
    good = data[np.isfinite(data)]
    keys = ("lowest", "highest", "mean", "deviation", "percentiles")
    statistics: dict[str, Any] = dict.fromkeys(keys)
    if good.size:
        levels = dict(zip(map(str, _SHARES), np.percentile(good, _SHARES), strict=True))
        numbers = (good.min(), good.max(), good.mean(), good.std(), levels)
        statistics = dict(zip(keys, numbers, strict=True))
    return {
        "unit": attributes["units"],
        "better": attributes["better"],
        **statistics,
        "best": best_design(found, name) if ranked else None,
        "best_curve": curve,
        "values": data if few else None,
    }


def machine_parts(found: "xarray.Dataset", dimension: str) -> dict[str, "xarray.Dataset"]:
    """The designs of each of several machines, by its name.

    Args:
        found: of `sweep_machines`.
        dimension: along which the machines stand.
    """
    names = map(str, found[dimension].values)
    return {name: found.sel({dimension: name}, drop=True) for name in names}


def columns(found: "xarray.Dataset") -> dict[str, np.ndarray]:
    """Every design of a `sweep` with its quantities, by name and SI unit, and how it ended.

    Args:
        found: of `sweep`.
    """
    made = {}
    for name in (*map(str, found.coords), *quantity_names(found), OK):
        whole = found[name].broadcast_like(found["ok"]).transpose(*found["ok"].dims)
        made[with_unit(name, found[name].attrs.get("units", ""))] = whole.values.ravel()
    ended = status_words(found)
    return made if ended is None else made | {STATUS: ended.ravel()}
