"""What `jaxcomp sweep` prints."""

from pathlib import Path
from typing import Any

import numpy as np

from .._results import with_unit
from ..sweeping import best_design, ridge, shown_column
from ._tables import _table

# Designs up to which JSON has all of them; a table has a row each up to the second.
_IN_JSON = 10_000
_ROWS = 40
_SHARES = (5, 50, 95)


def sweep_result(found, scene: str, out: Path | None) -> dict[str, Any]:
    """The answer in SI units, with all designs if they are few."""
    ok = np.asarray(found["ok"])
    dims = [str(dim) for dim in found["ok"].dims]
    variables = [str(name) for name in found.coords if name != "sample"]
    few = ok.size <= _IN_JSON
    result: dict[str, Any] = {
        "scene": scene,
        "dimensions": dims,
        "shape": list(ok.shape),
        "designs": int(ok.size),
        "failed": int(ok.size - ok.sum()),
        "variables": {name: _variable(found[name], few) for name in variables},
        "quantities": {},
        "ok": ok.tolist() if few else None,
        "store": None if out is None else str(out / "sweep.zarr"),
    }
    for name in (str(n) for n in found.data_vars if n != "ok"):
        result["quantities"][name] = _quantity(found, name, few)
    return result


def _variable(values, few) -> dict[str, Any]:
    data = np.asarray(values)
    return {
        "unit": values.attrs["units"],
        "low": float(data.min()),
        "high": float(data.max()),
        "values": data.tolist() if few else None,
    }


def _quantity(found, name, few) -> dict[str, Any]:
    data, attributes = np.asarray(found[name]), found[name].attrs
    good = data[np.isfinite(data)]
    judged = attributes["better"] in ("more", "less")
    top = None
    if judged and data.ndim == 2 and found[name].dims != ("sample",):
        points = ridge(found, name)
        top = {
            "along": str(found[name].dims[0]),
            "across": str(found[name].dims[1]),
            "points": [
                dict(zip(("across", "best", "between", "value"), map(_finite, row), strict=True))
                for row in zip(points.across, points.along, points.between, points.value, strict=True)
            ],
        }  # fmt: skip
    return {
        "unit": attributes["units"],
        "better": attributes["better"],
        "lowest": _finite(good.min()) if good.size else None,
        "highest": _finite(good.max()) if good.size else None,
        "mean": _finite(good.mean()) if good.size else None,
        "deviation": _finite(good.std()) if good.size else None,
        "percentiles": (
            dict(zip(map(str, _SHARES), np.percentile(good, _SHARES).tolist(), strict=True))
            if good.size
            else None
        ),
        "best": best_design(found, name) if judged else None,
        "ridge": top,
        "values": _listed(data) if few else None,
    }


def _finite(value) -> float | None:
    return float(value) if np.isfinite(value) else None


def _listed(data):
    return [_listed(row) for row in data] if data.ndim else _finite(data)


def sweep_columns(found) -> dict[str, Any]:
    """Every design with its quantities, by name and unit."""
    names = [str(name) for name in (*found.coords, *found.data_vars)]
    columns = {}
    for name in names:
        whole = found[name].broadcast_like(found["ok"]).transpose(*found["ok"].dims)
        columns[with_unit(name, found[name].attrs.get("units", ""))] = np.asarray(whole).ravel()
    return columns


def sweep_tables(found, result: dict[str, Any]):
    """The best designs, the quantities at a glance, and the ridge or the curve where there is one."""
    failed = f", {result['failed']:,} failed" if result["failed"] else ""
    yield _summary(found, result, f"{result['scene']}: {result['designs']:,} designs{failed}")
    if result["failed"] == result["designs"]:
        yield f"No design has a result; `jaxcomp run {result['scene']}` tells why one fails.\n"
        return
    dims = found["ok"].dims
    if len(dims) == 1 and dims[0] != "sample" and found["ok"].size <= _ROWS:
        yield _curve(found, result)
    for name, entry in result["quantities"].items():
        if entry["ridge"] is not None and len(entry["ridge"]["points"]) <= _ROWS:
            yield _ridge(found, name, entry["ridge"])


def _summary(found, result, title):
    table = _table(title, "Quantity", "Lowest", "Median", "Highest", "Best at", numbers=True)
    table.columns[-1].justify = "left"
    for name, entry in result["quantities"].items():
        look = shown_column(found, name)
        cells = [_cell(look, entry[key]) for key in ("lowest", "highest")]
        middle = _cell(look, entry["percentiles"] and entry["percentiles"]["50"])
        best = entry["best"] or {}
        place = ", ".join(
            f"{shown_column(found, v).words.lower()} {shown_column(found, v).text(best[v])}"
            for v in result["variables"]
            if v in best
        )
        table.add_row(look.label, cells[0], middle, cells[1], place)
    return table


def _curve(found, result):
    names = [*result["variables"], *result["quantities"]]
    looks = [shown_column(found, name) for name in names]
    table = _table(None, *(look.label for look in looks), numbers=True)
    table.columns[0].justify = "right"
    for row in zip(*(np.asarray(found[name]) for name in names), strict=True):
        table.add_row(*(_cell(look, x) for look, x in zip(looks, row, strict=True)))
    return table


def _ridge(found, name, top):
    across, along, value = (shown_column(found, n) for n in (top["across"], top["along"], name))
    heads = (across.label, f"Best {along.label[:1].lower()}{along.label[1:]}", value.label)
    table = _table(None, *heads, numbers=True)
    table.columns[0].justify = "right"
    tried = np.asarray(found[top["along"]])
    for point in top["points"]:
        best = _cell(along, point["best"])
        if point["best"] is not None and point["best"] in (tried.min(), tried.max()):
            best += " (end of the range)"
        table.add_row(_cell(across, point["across"]), best, _cell(value, point["value"]))
    return table


def _cell(look, value) -> str:
    return "failed" if value is None or not np.isfinite(value) else f"{value * look.factor:.5g}"
