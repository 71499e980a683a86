"""Files of polynomials of the points of maps, which `read_readings` reads."""

from collections.abc import Mapping
from typing import cast

import numpy as np

from .._core.errors import BadInput
from ..compressor import Compressor
from ..cylinder import Cylinder
from ..fluid import AbstractRealGas
from ..study.identification._readings import MEASURED, terms_of
from ..study.rating import QUANTITIES, RATINGS, ZERO, Rating, RatingMap, polynomial_errors
from ._scene import Scene
from .map_formats import energyplus_text, tespy_text

# Temperatures, and differences of temperatures, which no zero point shifts.
from .readings import metadata_of

FORMATS = {
    "csv": "coefficients.csv",
    "energyplus": "coefficients.idf",
    "tespy": "coefficients.json",
}


def rating_metadata(scene: Scene, rating: str, reference: str = "dew") -> dict[str, str]:
    """Machine, fluid and rating conditions of a map, as a file of polynomials has them.

    Args:
        scene: of a compressor with valves.
        rating: of `jaxcomp.study.rating.RATINGS`.
        reference: of the temperatures, "dew" or "mean".
    """
    gas = scene.as_compressor().gas
    assert isinstance(gas, Cylinder)
    assert isinstance(gas.fluid, AbstractRealGas)
    conditions = RATINGS[rating]
    line = gas.discharge
    if rating == "file":
        heads = gas.suction.temperature, gas.suction.superheat
        conditions = Rating(*heads, line.liquid_temperature, line.subcooling)
    if conditions.liquid is None and conditions.subcooling is None:
        conditions = conditions._replace(subcooling=0.0)
    settings = {"machine": scene.name, "fluid": gas.fluid.name, **metadata_of(conditions)}
    if reference != "dew":
        settings["reference"] = reference
    return settings


def polynomial_text(
    maps: Mapping[float, RatingMap],
    count: int,
    metadata: Mapping[str, str],
    form: str = "csv",
    machine: Compressor | None = None,
) -> str:
    """A file of polynomials of the points of maps, which `read_readings` reads.

    Args:
        maps: by speed [1/s]; a single one for ten coefficients.
        count: 10, 20 or 30.
        metadata: of the lines with `#`: fluid, return gas, liquid.
        form: of `FORMATS`.
        machine: a compressor, whose swept volume TESPy needs.

    Raises:
        BadInput: fewer points than coefficients, speeds that do not tell the terms of the speed, or 20
            and 30 coefficients in another form than CSV.
    """
    if count > 10 and form != "csv":
        raise BadInput("form", form, "csv for 20 and 30 coefficients")
    points = []
    quantities: dict[str, list] = {name: [] for name, _, fitted in QUANTITIES if fitted}
    for speed, rating_map in maps.items():
        ok = np.asarray(rating_map.ok)
        axes = (np.asarray(rating_map.evaporating), np.asarray(rating_map.condensing))
        S, D = np.meshgrid(*axes, indexing="ij")
        points.append(np.stack([S[ok], D[ok], np.full(ok.sum(), speed)]))
        for name, values in quantities.items():
            values.append(np.asarray(rating_map.values[name])[ok])
    S, D, n = np.concatenate(points, axis=1)
    terms = terms_of(count, S, D, n)
    # terms of degree 0 to 3 differ by powers of ten, in which a rank would be lost
    size = np.linalg.norm(terms, axis=0)
    rank = np.linalg.matrix_rank(terms / np.where(size > 0, size, 1.0), tol=1e-11)
    if rank < count:
        bound = f"enough for {count} coefficients, at least four speeds for 20 and three for 30"
        raise BadInput("points of the map", f"{S.size}, which tell {rank}", bound)
    rows = {}
    settings = dict(metadata)
    for key, x in (("evaporating", S), ("condensing", D)):
        settings[key] = f"{x.min() - ZERO:.6g} to {x.max() - ZERO:.6g} degC"
    for name, values in quantities.items():
        value = np.concatenate(values)
        rows[name] = np.linalg.lstsq(terms / size, value, rcond=None)[0] / size
        error = polynomial_errors(terms, rows[name], value)
        worst = int(error.argmax())
        at = f"{S[worst] - ZERO:.4g}/{D[worst] - ZERO:.4g} C"
        settings[f"largest error of {name}"] = f"{error[worst]:.2%} at {at}"
    if form == "energyplus":
        return energyplus_text(settings, rows)
    if form == "tespy":
        assert machine is not None
        return _tespy_text(settings, maps, machine)
    return _csv_text(settings, rows, count)


def _tespy_text(
    settings: Mapping[str, str], maps: Mapping[float, RatingMap], machine: Compressor
) -> str:
    """The first of some maps as a file of TESPy."""
    speed, rating_map = next(iter(maps.items()))
    fluid = cast(AbstractRealGas, cast(Cylinder, machine.gas).fluid)
    swept_volume = float(machine.swept_volume) * machine.crankshaft.count
    # TESPy fits efficiencies, which have errors of their own
    without_errors = {}
    for key, text in settings.items():
        if "error" not in key:
            without_errors[key] = text
    return tespy_text(without_errors, rating_map, fluid, swept_volume, speed)


def _csv_text(settings: Mapping[str, str], rows: Mapping[str, np.ndarray], count: int) -> str:
    """A map as a file of polynomials in CSV, with `count` coefficients a line."""
    lines = [f"# {key} = {text}" for key, text in settings.items()]
    first = 1 if count == 10 else 0
    heads = [f"C{k}" for k in range(first, count + first)]
    lines.append(",".join(["quantity", "unit", *heads]))
    for name, row in rows.items():
        lines.append(",".join([name, MEASURED[name][0], *map(repr, row.tolist())]))
    return "\n".join([*lines, ""])
