"""Sweeps over the layout of several cylinders, which is a word: a sweep of numbers for each of them."""

from collections.abc import Mapping, Sequence
from typing import Any

from .._fields import BadInput
from ..design import variable
from ..machine import machine_of
from ._run import sweep

LAYOUT = "cylinders.layout"
# Which number takes its own value where nothing but the layout is swept.
_HELD = "mechanism.crank_radius"


def sweep_layouts(
    scene: Any,
    layouts: Sequence[str],
    over: Mapping[str, Any],
    quantities: Sequence[Any],
    **options,
):
    """All designs of a sweep for every layout of the cylinders.

    Args:
        scene: with a section `cylinders`; throws that it gives make room for the layout.
        layouts: names, see `jaxcomp.mechanism.Cylinders`.
        over: values of other variables as for `sweep`; empty for the layouts alone.
        quantities: as for `sweep`.
        options: other arguments of `sweep`.

    Returns:
        `xarray.Dataset` with the layouts along its first dimension.

    Raises:
        BadInput: no layout, or a machine without `cylinders`.
        SceneError: an unknown layout, or one that the scene has no room for.
    """
    import xarray

    from ..scene import with_values

    if not layouts:
        raise BadInput("layouts", "none", "at least one")
    if getattr(machine_of(scene).compressor, "cylinders", None) is None:
        raise BadInput(LAYOUT, "absent", "in a machine with a section [cylinders]")
    held = (
        {} if over else {_HELD: [float(variable(machine_of(scene), _HELD).current(scene.machine))]}
    )
    found = []
    for layout in layouts:
        made = with_values(scene, {LAYOUT: layout, "cylinders.throws": None})
        one = sweep(made, over or held, quantities, **options)
        found.append(one if over else one.isel({_HELD: 0}, drop=True))
    return xarray.concat(found, xarray.Variable(LAYOUT, list(layouts)))
