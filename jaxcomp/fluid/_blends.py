"""Names: blends of ASHRAE 34, synonyms of components, and the lines that were solved for blends."""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._core.errors import BadInput
from .._core.words import nearest
from ._helmholtz import fluid_data, fluids
from ._multi_fluid import mixture_file, pairs_of
from ._saturation_lines import NODES, SaturationLines

# Of which numbers in the files of lines are whole multiples.
COEFFICIENT_UNIT = 1e-12
SLOPE_UNIT = 1e-10

# What gases and hydrocarbons are called elsewhere: formulas, names of analyses, numbers of ASHRAE 34.
SYNONYMS = {
    **dict.fromkeys(("C1", "CH4", "R50"), "methane"),
    **dict.fromkeys(("C2", "C2H6", "ethane"), "R170"),
    **dict.fromkeys(("C3", "C3H8", "propane", "n_propane"), "R290"),
    **dict.fromkeys(("iC4", "isobutane"), "R600a"),
    **dict.fromkeys(("C4", "nC4", "butane", "n_butane"), "R600"),
    **dict.fromkeys(("iC5", "isopentane"), "R601a"),
    **dict.fromkeys(("C5", "nC5", "pentane", "n_pentane"), "R601"),
    **dict.fromkeys(("C6", "nC6", "n_hexane"), "hexane"),
    **dict.fromkeys(("C7", "nC7", "n_heptane"), "heptane"),
    **dict.fromkeys(("C8", "nC8", "n_octane"), "octane"),
    **dict.fromkeys(("C9", "nC9", "n_nonane"), "nonane"),
    **dict.fromkeys(("C10", "nC10", "n_decane"), "decane"),
    **dict.fromkeys(("N2", "R728"), "nitrogen"),
    **dict.fromkeys(("O2", "R732"), "oxygen"),
    **dict.fromkeys(("H2", "R702"), "hydrogen"),
    **dict.fromkeys(("He", "R704"), "helium"),
    **dict.fromkeys(("Ne", "R720"), "neon"),
    **dict.fromkeys(("Ar", "R740"), "argon"),
    **dict.fromkeys(("Kr", "R784"), "krypton"),
    "Xe": "xenon",
    **dict.fromkeys(("CO2", "carbon_dioxide"), "R744"),
    "CO": "carbon_monoxide",
    **dict.fromkeys(("H2S", "hydrogen_sulphide"), "hydrogen_sulfide"),
    **dict.fromkeys(("H2O", "R718"), "water"),
    **dict.fromkeys(("SO2", "R764", "sulphur_dioxide"), "sulfur_dioxide"),
    **dict.fromkeys(("N2O", "R744A"), "nitrous_oxide"),
    **dict.fromkeys(("SF6", "R7146", "sulphur_hexafluoride"), "sulfur_hexafluoride"),
    **dict.fromkeys(("NH3", "ammonia"), "R717"),
    **dict.fromkeys(("C2H4", "ethylene", "ethene"), "R1150"),
    **dict.fromkeys(("C3H6", "propylene", "propene"), "R1270"),
    "HCl": "hydrogen_chloride",
    "Cl2": "chlorine",
}


class Blend(NamedTuple):
    """A blend of ASHRAE 34.

    Attributes:
        name: as "R454B".
        mass_fractions: by component.
        quality: "A" where every pair has a departure function, "B" where some are fitted to vapour
            pressures only, "C" where some have no parameters, "D" where a component has no equation.
    """

    name: str
    mass_fractions: Mapping[str, float]
    quality: str


@cache
def blends() -> dict[str, Blend]:
    """Blends of ASHRAE 34 by name, also those that cannot be computed."""
    return {name: _blend(name, row) for name, row in mixture_file("blends").items()}


def _blend(name: str, row: Mapping[str, Any]) -> Blend:
    """A blend from its row in the file."""
    fractions = {component: share / 100 for component, share in row["mass_percent"].items()}
    return Blend(name, fractions, row["class"])


def without_equation(mixture: Blend) -> list[str]:
    """Components of a blend that have no equation of state here."""
    return [name for name in mixture.mass_fractions if name not in fluids()]


def blend(name: str) -> Blend:
    """A blend of ASHRAE 34.

    Raises:
        BadInput: an unknown name, or a component without an equation of state.
    """
    if name not in blends():
        bound = "a blend of ASHRAE 34, as `jaxcomp list fluids` names them"
        if near := nearest(name.upper(), blends()):
            bound += f' (did you mean "{near}"?)'
        raise BadInput("name", f'"{name}"', bound)
    mixture = blends()[name]
    if missing := without_equation(mixture):
        bound = f"a blend of fluids with an equation of state: there is none here for {missing[0]}"
        raise BadInput("name", f'"{name}"', bound)
    return mixture


def usable_blends() -> list[Blend]:
    """Blends whose components have equations and whose pairs have parameters."""
    return list(filter(_is_usable, blends().values()))


def _is_usable(mixture: Blend) -> bool:
    if without_equation(mixture):
        return False
    pairs = pairs_of(list(mixture.mass_fractions))
    return all(pair.quality != "none" for pair in pairs)


def component_name(name: str) -> str:
    """The name of a fluid here, of one of its synonyms.

    Raises:
        BadInput: an unknown fluid, a blend, or a pseudo-pure fluid, which is a blend.
    """
    spellings = {fluid.lower(): fluid for fluid in fluids()}
    for synonym, fluid in SYNONYMS.items():
        spellings[synonym.lower()] = fluid
    for fluid in fluids():
        chemical_name = fluid_data(fluid)["description"].replace(" ", "_").lower()
        spellings[chemical_name] = fluid
    fluid_name = spellings.get(name.lower())
    if name in blends() or (fluid_name and fluid_data(fluid_name)["pseudo_pure"]):
        raise BadInput("components", name, f"pure fluids: {name} is a blend, give its components")
    if fluid_name is None:
        bound = "pure fluids, as `jaxcomp list fluids` names them"
        if near := nearest(name.lower(), spellings):
            bound += f" (did you mean {spellings[near]}?)"
        raise BadInput("components", name, bound)
    return fluid_name


# ------------------------------------------------------------------- lines
@cache
def _lines_by_components() -> dict[frozenset[str], list[str]]:
    folder = files(__package__).joinpath("data", "mixtures", "lines")
    by_components: dict[frozenset[str], list[str]] = {}
    if not folder.is_dir():
        return by_components
    names = [entry.name.removesuffix(".json") for entry in folder.iterdir()]
    for name in names:
        by_components.setdefault(frozenset(blends()[name].mass_fractions), []).append(name)
    return by_components


def stored_lines(components: tuple[str, ...], mass_fractions: np.ndarray) -> SaturationLines | None:
    """Lines of a blend with this composition, if they came with the library."""
    for name in _lines_by_components().get(frozenset(components), ()):
        fractions = blends()[name].mass_fractions
        listed = [fractions[component] for component in components]
        if np.allclose(listed, mass_fractions, rtol=0, atol=1e-9):
            return _lines(name, components)
    return None


def _lines(name: str, components: tuple[str, ...]) -> SaturationLines:
    path = files(__package__).joinpath("data", "mixtures", "lines", f"{name}.json")
    row = json.loads(path.read_text())
    listed = blends()[name].mass_fractions
    fractions = np.array([*listed.values()])
    fractions = fractions / fractions.sum()
    coefficients = COEFFICIENT_UNIT * padded(row["coefficients"])
    slopes = SLOPE_UNIT * padded(row["slopes"])
    # fractions are normalised: one in proportion with all others changes nothing
    last_slope = -np.tensordot(fractions[:-1], slopes, 1) / fractions[-1]
    listed_components = list(listed)
    order = [listed_components.index(component) for component in components]
    return SaturationLines(
        ends=jnp.asarray(row["ends"]),
        coefficients=jnp.asarray(coefficients),
        slopes=jnp.asarray(np.concatenate([slopes, last_slope[None]])[order]),
        reference=jnp.asarray(fractions[order]),
        critical=jnp.asarray(row["critical"]),
    )


def padded(tree: list) -> np.ndarray:
    """Series of a file with the zeros that it leaves out at their ends."""
    if tree and isinstance(tree[0], list):
        return np.stack([padded(row) for row in tree])
    return np.pad(np.array(tree, float), (0, NODES - len(tree)))
