"""`jaxcomp list fluids`: pure fluids and blends, with ranges, glide, and how well pairs are known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.table import Table

from .._core.declared import Record, part, reading, word
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


@dataclass(frozen=True)
class ListedFluid(Record):
    """A pure fluid.

    Attributes:
        name, description, source, licence: of its equation of state.
        lowest, highest: [K] range of the equation.
        critical_temperature: [K]
        highest_pressure: [Pa]
    """

    name: str = word()
    description: str = word()
    source: str = word()
    licence: str = word()
    lowest: float = reading("K")
    highest: float = reading("K")
    critical_temperature: float | None = reading("K", optional=True, default=None)
    highest_pressure: float | None = reading("Pa", optional=True, default=None)


@dataclass(frozen=True)
class ListedPair(Record):
    """Two components of a blend, and how well they are known together."""

    components: list[str] = word()
    quality: str = word()
    source: str = word()


@dataclass(frozen=True)
class ListedBlend(Record):
    """A blend of ASHRAE 34.

    Attributes:
        name: such as R410A.
        quality: class, by how well its pairs are known.
        mass_fractions: [-] by component.
        without_equation: components that have no equation of state.
        pairs: of components.
        lowest, highest: [K] range of the lines of saturation.
        glide: [K] at 0 degrees Celsius.
    """

    name: str = word()
    quality: str = word(key="class")
    mass_fractions: dict[str, float] = reading("")
    without_equation: list[str] = word()
    pairs: tuple[ListedPair, ...] = part(ListedPair, default=())
    lowest: float | None = reading("K", optional=True, default=None)
    highest: float | None = reading("K", optional=True, default=None)
    glide: float | None = reading("K", optional=True, default=None)


@dataclass(frozen=True)
class ListedFluids(Record):
    """Pure fluids and blends."""

    fluids: tuple[ListedFluid, ...] | None = part(ListedFluid, optional=True, default=None)
    blends: tuple[ListedBlend, ...] | None = part(ListedBlend, optional=True, default=None)


def list_fluids() -> tuple[ListedFluids, list[Table]]:
    """All pure fluids, and the blends of ASHRAE 34 that can be computed."""
    from ..fluid import fluids
    from ..fluid._blends import usable_blends
    from ..fluid._helmholtz import fluid_data

    start_jax()
    pure = []
    rows = []
    for data in map(fluid_data, fluids()):
        fluid = _listed_fluid(data)
        pure.append(fluid)
        limits = _range(fluid.lowest, fluid.highest)
        rows.append((bold(fluid.name), fluid.description, limits, fluid.source))
    heads = ("Name", "What it is", "Range [degC]", "Equation of state")
    tables = [_words("Fluids", heads, rows)]
    mixed = []
    rows = []
    for blend in usable_blends():
        entry = blend_entry(blend.name)
        mixed.append(entry)
        composition = _composition(blend.mass_fractions)
        glide = number_text(entry.glide, ".2f")
        rows.append((bold(blend.name), blend.quality, composition, glide))
    title = "Blends of ASHRAE 34; A: departure functions for all pairs, B: some pairs are fits"
    heads = ("Name", "Class", "By mass [%]", "Glide at 0 degC [K]")
    tables.append(_words(title, heads, rows))
    return ListedFluids(fluids=tuple(pure), blends=tuple(mixed)), tables


def _listed_fluid(data: dict[str, Any]) -> ListedFluid:
    """A fluid of `fluid_data`, without its critical point."""
    return ListedFluid(
        name=data["name"],
        description=data["description"],
        source=data["source"],
        licence=data["licence"],
        lowest=data["T_least"],
        highest=data["T_most"],
    )


def list_fluid(name: str) -> tuple[ListedFluids, list[Table]]:
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
        rows = [(key, data[key]) for key in ("name", "description", "source", "licence")]
        fluid = replace(
            _listed_fluid(data),
            critical_temperature=data["T_critical"],
            highest_pressure=data["p_most"],
        )
        rows.append(("range", f"{_range(fluid.lowest, fluid.highest)} degC"))
        rows.append(("critical temperature", f"{data['T_critical'] - ZERO_CELSIUS:.2f} degC"))
        rows.append(("highest pressure", f"{data['p_most'] / 1e6:g} MPa"))
        return ListedFluids(fluids=(fluid,)), [_words(name, ("", ""), rows)]
    entry = blend_entry(name)
    rows = [("Class", entry.quality), ("By mass", _composition(entry.mass_fractions, " %"))]
    if entry.lowest is not None and entry.highest is not None:
        rows.append(("Lines", f"{_range(entry.lowest, entry.highest)} degC"))
    if entry.glide is not None:
        rows.append(("Glide at 0 degC", f"{entry.glide:.2f} K"))
    if entry.without_equation:
        rows.append(("No equation of state", ", ".join(entry.without_equation)))
    tables = [_words(name, ("", ""), rows)]
    if entry.pairs:
        rows = []
        for pair in entry.pairs:
            rows.append(("/".join(pair.components), _QUALITIES[pair.quality], pair.source))
        tables.append(_words(f"Pairs of {name}", ("Pair", "Parameters", "Source"), rows))
    return ListedFluids(blends=(entry,)), tables


def blend_entry(name: str) -> ListedBlend:
    """Composition, class, glide at 0 degC, range of the lines and pairs of a blend."""
    from ..fluid import Mixture
    from ..fluid._blends import blends, without_equation
    from ..fluid._multi_fluid import pairs_of

    blend = blends()[name]
    entry = ListedBlend(
        name=name,
        quality=blend.quality,
        mass_fractions=dict(blend.mass_fractions),
        without_equation=without_equation(blend),
    )
    if entry.without_equation:
        return entry
    pairs = pairs_of(list(blend.mass_fractions))
    listed = []
    for pair in pairs:
        listed.append(ListedPair(list(pair.names), pair.quality, pair.source))
    entry = replace(entry, pairs=tuple(listed))
    if any(pair.quality == "none" for pair in pairs):
        return entry
    mixture = Mixture(name=name)
    if mixture.lines is not None:
        low, _, high = np.asarray(mixture.lines.ends).tolist()
        glide = None
        if low < ZERO_CELSIUS < high:
            glide = ZERO_CELSIUS - float(mixture.bubble_of_dew(ZERO_CELSIUS))
        entry = replace(entry, lowest=low, highest=high, glide=glide)
    return entry


def _words(title: str, heads, rows) -> Table:
    return row_table(title, heads, rows, texts=len(heads), unbroken=(0,))


def _composition(fractions, unit: str = "") -> str:
    return ", ".join(f"{name} {100 * share:.4g}{unit}" for name, share in fractions.items())


def _range(low: float, high: float) -> str:
    return f"{low - ZERO_CELSIUS:.0f} to {high - ZERO_CELSIUS:.0f}"
