"""The same sweep of several machines that differ by more than numbers, as by their layout."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .._fields import BadInput
from ..design import variable
from ..machine import machine_of
from ._run import sweep

# Which number takes its own value where nothing but the machine changes.
_HELD = "mechanism.crank_radius"


def sweep_machines(
    machines: Mapping[str, Any],
    over: Mapping[str, Any],
    quantities: Sequence[Any],
    *,
    dimension: str = "machine",
    out: str | Path | None = None,
    **options,
):
    """All designs of a sweep for every one of several machines.

    Args:
        machines: scenes or machines by name.
        over: values of other variables as for `sweep`; empty for the machines alone.
        quantities: as for `sweep`.
        dimension: name of the dimension along which the machines stand.
        out: folder in which every machine has the zarr store of its name; in memory alone if absent.
        options: other arguments of `sweep`.

    Returns:
        `xarray.Dataset` with the machines along its first dimension.

    Raises:
        BadInput: no machine; or as `sweep`.
    """
    import xarray

    if not machines:
        raise BadInput("machines", "none", "at least one")
    found = []
    for name, one in machines.items():
        here = machine_of(one)
        held = {_HELD: [float(variable(here, _HELD).current(here))]}
        store = None if out is None else Path(out) / name
        made = sweep(one, over or held, quantities, out=store, **options)
        found.append(made if over else made.isel({_HELD: 0}, drop=True))
    return xarray.concat(found, xarray.Variable(dimension, list(machines)))
