r"""A sweep in single numbers, and as a table."""

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._core.results import with_unit
from ._best import best_curve, best_design
from ._store import OK, STATUS, quantity_names, status_words, variable_names

if TYPE_CHECKING:
    import xarray

# Percentiles of every quantity.
_SHARES = (5, 50, 95)


def summary(dataset: "xarray.Dataset", listing_limit: int = 10_000) -> dict[str, Any]:
    """Ranges and best designs of a `sweep`, in SI units.

    Args:
        dataset: of `sweep`.
        listing_limit: designs up to which all of them are listed.
    """
    ok = dataset["ok"].values
    few = ok.size <= listing_limit
    variables = variable_names(dataset)
    quantities = quantity_names(dataset)
    ended = status_words(dataset)
    failed = []
    if ended is not None:
        failed = ended[~ok]
    listed_ok = None
    listed_status = None
    if few:
        listed_ok = ok
        listed_status = ended

    def variable(values):
        low = values.values.min()
        high = values.values.max()
        listed = None
        if few:
            listed = values.values
        return {"unit": values.attrs["units"], "low": low, "high": high, "values": listed}

    return {
        "dimensions": list(map(str, dataset["ok"].dims)),
        "shape": ok.shape,
        "designs": ok.size,
        "failed": ok.size - ok.sum(),
        "failed_by_status": dict(Counter(map(str, failed)).most_common()),
        "variables": {name: variable(dataset[name]) for name in variables},
        "quantities": {name: _quantity(dataset, name, few) for name in quantities},
        "ok": listed_ok,
        "status": listed_status,
    }


def _quantity(dataset, name: str, few: bool) -> dict[str, Any]:
    data = dataset[name].values
    attributes = dataset[name].attrs
    ranked = attributes["better"] in ("more", "less")
    curve = None
    if ranked and data.ndim == 2 and dataset[name].dims != ("sample",):
        keys = ("across", "best", "between", "value")
        columns = []
        for column in best_curve(dataset, name):
            columns.append(np.asarray(column).tolist())
        points = []
        for row in zip(*columns, strict=True):
            points.append(dict(zip(keys, row, strict=True)))
        along_dim, across_dim = map(str, dataset[name].dims)
        curve = {"along": along_dim, "across": across_dim, "points": points}
    good = data[np.isfinite(data)]
    keys = ("lowest", "highest", "mean", "deviation", "percentiles")
    statistics: dict[str, Any] = dict.fromkeys(keys)
    if good.size:
        levels = dict(zip(map(str, _SHARES), np.percentile(good, _SHARES), strict=True))
        numbers = (good.min(), good.max(), good.mean(), good.std(), levels)
        statistics = dict(zip(keys, numbers, strict=True))
    best = None
    if ranked:
        best = best_design(dataset, name)
    listed = None
    if few:
        listed = data
    return {
        "unit": attributes["units"],
        "better": attributes["better"],
        **statistics,
        "best": best,
        "best_curve": curve,
        "values": listed,
    }


def machine_parts(dataset: "xarray.Dataset", dimension: str) -> dict[str, "xarray.Dataset"]:
    """The designs of each of several machines, by its name.

    Args:
        dataset: of `sweep_machines`.
        dimension: along which the machines stand.
    """
    names = map(str, dataset[dimension].values)
    return {name: dataset.sel({dimension: name}, drop=True) for name in names}


def columns(dataset: "xarray.Dataset") -> dict[str, np.ndarray]:
    """Every design of a `sweep` with its quantities, by name and SI unit, and how it ended.

    Args:
        dataset: of `sweep`.
    """
    table = {}
    for name in (*map(str, dataset.coords), *quantity_names(dataset), OK):
        values = dataset[name].broadcast_like(dataset["ok"]).transpose(*dataset["ok"].dims)
        table[with_unit(name, dataset[name].attrs.get("units", ""))] = values.values.ravel()
    ended = status_words(dataset)
    if ended is None:
        return table
    return table | {STATUS: ended.ravel()}
