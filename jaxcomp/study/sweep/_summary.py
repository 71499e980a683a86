r"""A sweep in single numbers, and as a table."""

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._core.declared import (
    BESIDE,
    NAMED,
    NUMBER,
    QUANTITY,
    Measured,
    Record,
    part,
    reading,
    records_of,
    with_unit,
    word,
)
from ..._core.evidence import Check, all_solved
from ._best import best_curve, best_design
from ._store import OK, STATUS, quantity_names, status_words, variable_names

if TYPE_CHECKING:
    import xarray

# Percentiles of every quantity.
_SHARES = (5, 50, 95)


@dataclass(frozen=True)
class VariableRange(Record):
    """Values of a variable of a sweep, which are listed where there are few designs."""

    unit: str = word()
    low: float = reading(BESIDE)
    high: float = reading(BESIDE)
    values: np.ndarray | None = reading(BESIDE)


@dataclass(frozen=True)
class BestPoint(Record):
    """The best value of one variable for a value of the other.

    Attributes:
        abscissa: value of the other variable.
        best: of the designs.
        between: of a parabola through the best design and its neighbours.
        value: of the quantity.
    """

    abscissa: float = reading(NUMBER, key="across")
    best: float = reading(NUMBER)
    between: float = reading(NUMBER)
    value: float = reading(QUANTITY)


@dataclass(frozen=True)
class ListedCurve(Record):
    """The best value of one variable over another one."""

    along: str = word()
    abscissa: str = word(key="across")
    points: tuple[BestPoint, ...] = part(BestPoint)


@dataclass(frozen=True)
class QuantitySummary(Record):
    """A quantity over the designs of a sweep that have a result.

    Attributes:
        unit, better: as registered.
        lowest, highest, mean, deviation: [SI]
        percentiles: [SI] by the share of the designs below, in per cent.
        best: variables and quantities of the best design; `None` where neither more nor less is better.
        best_curve: of a grid over two variables.
        values: of all designs where they are few.
    """

    unit: str = word()
    better: str = word()
    lowest: float | None = reading(BESIDE)
    highest: float | None = reading(BESIDE)
    mean: float | None = reading(BESIDE)
    deviation: float | None = reading(BESIDE)
    percentiles: dict[str, float] | None = reading(BESIDE)
    best: dict[str, Any] | None = reading(NAMED)
    best_curve: ListedCurve | None = part(ListedCurve)
    values: np.ndarray | None = reading(BESIDE)


@dataclass(frozen=True)
class SweepSummary(Record):
    """A sweep in single numbers.

    Attributes:
        dimensions, shape: of the grid, or of the samples.
        designs, failed: their numbers.
        failed_by_status: number of designs by the word of their end.
        variables, quantities: by name.
        ok, status: of each design where they are few.
    """

    dimensions: list[str] = word()
    shape: tuple[int, ...] = reading("")
    designs: int = reading("")
    failed: int = reading("")
    failed_by_status: dict[str, int] = reading("")
    variables: dict[str, VariableRange] = part(VariableRange, by_name=True)
    quantities: dict[str, QuantitySummary] = part(QuantitySummary, by_name=True)
    ok: np.ndarray | None = word()
    status: np.ndarray | None = word()

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Whether all designs have a result."""
        del tolerance
        return (all_solved("Designs", int(self.failed), self.designs),)


def summary(dataset: "xarray.Dataset", listing_limit: int = 10_000) -> SweepSummary:
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
        return VariableRange(unit=values.attrs["units"], low=low, high=high, values=listed)

    return SweepSummary(
        dimensions=list(map(str, dataset["ok"].dims)),
        shape=ok.shape,
        designs=ok.size,
        failed=ok.size - ok.sum(),
        failed_by_status=dict(Counter(map(str, failed)).most_common()),
        variables={name: variable(dataset[name]) for name in variables},
        quantities={name: _quantity(dataset, name, few) for name in quantities},
        ok=listed_ok,
        status=listed_status,
    )


def _quantity(dataset, name: str, few: bool) -> QuantitySummary:
    data = dataset[name].values
    attributes = dataset[name].attrs
    ranked = attributes["better"] in ("more", "less")
    curve = None
    if ranked and data.ndim == 2 and dataset[name].dims != ("sample",):
        columns = map(np.asarray, best_curve(dataset, name))
        names = ("abscissa", "best", "between", "value")
        points = records_of(BestPoint, **dict(zip(names, columns, strict=True)))
        along_dim, across_dim = map(str, dataset[name].dims)
        curve = ListedCurve(along=along_dim, abscissa=across_dim, points=points)
    good = data[np.isfinite(data)]
    keys = ("lowest", "highest", "mean", "deviation", "percentiles")
    statistics: dict[str, Any] = dict.fromkeys(keys)
    if good.size:
        levels = dict(zip(map(str, _SHARES), np.percentile(good, _SHARES), strict=True))
        numbers = (good.min(), good.max(), good.mean(), good.std(), levels)
        statistics = dict(zip(keys, numbers, strict=True))
    best = None
    if ranked:
        best = _with_units(dataset, best_design(dataset, name))
    listed = None
    if few:
        listed = data
    return QuantitySummary(
        unit=attributes["units"],
        better=attributes["better"],
        **statistics,
        best=best,
        best_curve=curve,
        values=listed,
    )


def _with_units(dataset, design: dict[str, float] | None) -> dict[str, Measured] | None:
    if design is None:
        return None
    measured = {}
    for name, value in design.items():
        measured[name] = Measured(value, dataset[name].attrs.get("units", ""))
    return measured


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
