"""`jaxcomp list fluids`: pure fluids and blends, with ranges, glide, and how well pairs are known."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from .._core.display import ZERO_CELSIUS
from .._core.errors import BadInput
from ._start import CommandError, start_jax
from ._tables import bold, number_text, row_table

# What the quality of a pair is worth, in words that a report can be judged by.
_QUALITIES = {
    "departure": "departure function: pressures 1 %, densities 0.1 %",
    "generalised departure": "generalised departure function of similar pairs",
    "fit": "fitted to vapour pressures; density and enthalpy not tested",
    "estimated": "estimated, never fitted",
    "none": "no parameters",
}


def list_fluids() -> tuple[dict[str, Any], list[Table]]:
    """All pure fluids, and the blends of ASHRAE 34 that can be computed."""
    from ..fluid import fluids
    from ..fluid._blends import usable_blends
    from ..fluid._helmholtz import fluid_data

    start_jax()
    keys = ("name", "description", "source", "licence")
    pure = []
    rows = []
    for data in map(fluid_data, fluids()):
        limits = data["T_least"], data["T_most"]
        pure.append({key: data[key] for key in keys} | {"lowest": limits[0], "highest": limits[1]})
        rows.append((bold(data["name"]), data["description"], _range(*limits), data["source"]))
    heads = ("Name", "What it is", "Range [degC]", "Equation of state")
    tables = [_words("Fluids", heads, rows)]
    mixed = []
    rows = []
    for blend in usable_blends():
        entry = blend_entry(blend.name)
        mixed.append(entry)
        glide = entry.get("glide")
        composition = _composition(blend.mass_fractions)
        rows.append((bold(blend.name), blend.quality, composition, number_text(glide, ".2f")))
    title = "Blends of ASHRAE 34; A: departure functions for all pairs, B: some pairs are fits"
    heads = ("Name", "Class", "By mass [%]", "Glide at 0 degC [K]")
    tables.append(_words(title, heads, rows))
    return {"fluids": pure, "blends": mixed}, tables


def list_fluid(name: str) -> tuple[dict[str, Any], list[Table]]:
    """One fluid or blend with its sources, of a blend pair by pair.

    Raises:
        CommandError: an unknown name.
    """
    from ..fluid import fluids
    from ..fluid._blends import blends
    from ..fluid._helmholtz import fluid_data
    from ..fluid.real_gas import fluid_named

    start_jax()
    if name not in fluids() and name not in blends():
        try:
            fluid_named(name)
        except BadInput as error:
            raise CommandError(f"list fluids {name}: must be {error.bound}") from None
    if name in fluids():
        data = fluid_data(name)
        entry = {key: data[key] for key in ("name", "description", "source", "licence")}
        rows = list(entry.items())
        entry |= {"lowest": data["T_least"], "highest": data["T_most"]}
        entry |= {"critical_temperature": data["T_critical"], "highest_pressure": data["p_most"]}
        rows.append(("range", f"{_range(entry['lowest'], entry['highest'])} degC"))
        rows.append(("critical temperature", f"{data['T_critical'] - ZERO_CELSIUS:.2f} degC"))
        rows.append(("highest pressure", f"{data['p_most'] / 1e6:g} MPa"))
        return {"fluids": [entry]}, [_words(name, ("", ""), rows)]
    entry = blend_entry(name)
    rows = [("Class", entry["class"]), ("By mass", _composition(entry["mass_fractions"], " %"))]
    if "lowest" in entry:
        rows.append(("Lines", f"{_range(entry['lowest'], entry['highest'])} degC"))
    if "glide" in entry:
        rows.append(("Glide at 0 degC", f"{entry['glide']:.2f} K"))
    if entry["without_equation"]:
        rows.append(("No equation of state", ", ".join(entry["without_equation"])))
    tables = [_words(name, ("", ""), rows)]
    if entry["pairs"]:
        rows = []
        for pair in entry["pairs"]:
            components = "/".join(pair["components"])
            rows.append((components, _QUALITIES[pair["quality"]], pair["source"]))
        tables.append(_words(f"Pairs of {name}", ("Pair", "Parameters", "Source"), rows))
    return {"blends": [entry]}, tables


def blend_entry(name: str) -> dict[str, Any]:
    """Composition, class, glide at 0 degC, range of the lines and pairs of a blend."""
    from ..fluid import Mixture
    from ..fluid._blends import blends, without_equation
    from ..fluid._multi_fluid import pairs_of

    blend = blends()[name]
    entry: dict[str, Any] = {
        "name": name,
        "class": blend.quality,
        "mass_fractions": dict(blend.mass_fractions),
        "without_equation": without_equation(blend),
        "pairs": [],
    }
    if entry["without_equation"]:
        return entry
    pairs = pairs_of(list(blend.mass_fractions))
    for pair in pairs:
        entry["pairs"].append(
            {"components": list(pair.names), "quality": pair.quality, "source": pair.source}
        )
    if any(pair.quality == "none" for pair in pairs):
        return entry
    mixture = Mixture(name=name)
    if mixture.lines is not None:
        low, _, high = np.asarray(mixture.lines.ends).tolist()
        entry |= {"lowest": low, "highest": high}
        if low < ZERO_CELSIUS < high:
            entry["glide"] = ZERO_CELSIUS - float(mixture.bubble_of_dew(ZERO_CELSIUS))
    return entry


def _words(title: str, heads, rows) -> Table:
    return row_table(title, heads, rows, texts=len(heads), unbroken=(0,))


def _composition(fractions, unit: str = "") -> str:
    return ", ".join(f"{name} {100 * share:.4g}{unit}" for name, share in fractions.items())


def _range(low: float, high: float) -> str:
    return f"{low - ZERO_CELSIUS:.0f} to {high - ZERO_CELSIUS:.0f}"
