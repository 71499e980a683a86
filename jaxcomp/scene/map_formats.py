"""Compressor maps in the files of other programs: EnergyPlus and TESPy, written and read.

EnergyPlus: `Refrigeration:Compressor` with two `Curve:Bicubic` of capacity and power, whose terms are 1,
x, x^2, y, y^2, xy, x^3, y^3, x^2 y, x y^2 with x the evaporating and y the condensing temperature in
degrees Celsius (Input Output Reference, Group Refrigeration and Group Performance Curves). Where a file
has a curve twice, the last one before the compressor counts. It does not name the fluid; a line
`! fluid = R22` does.

TESPy: the polynomials of isentropic and volumetric efficiency and the `reference_state` of its
`PolynomialCompressor` (version 0.11), as JSON. The isentropic efficiency is that of the gas that comes
over electric power, the volumetric one counts with the density of this gas.
"""

import json
import os
import re
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..fluid import RealGas
from ..study.rating import ZERO, RatingMap, capacity_rise, polynomial_errors, polynomial_terms
from ._text import SceneError, reading

# Places of EnergyPlus' terms in the order of AHRI 540.
_ORDER = (0, 1, 3, 2, 5, 4, 6, 9, 7, 8)
_RATED = ("superheat", "return_gas", "liquid", "subcooling")
_COMPRESSOR = "refrigeration:compressor"
_BICUBIC = "curve:bicubic"


def energyplus_text(metadata: Mapping[str, str], rows: Mapping[str, Any]) -> str:
    """A map as objects of EnergyPlus.

    Args:
        metadata: machine, fluid, ranges and rating, as in files of polynomials.
        rows: ten coefficients [W] of "capacity" and "power" by name.
    """
    name = metadata.get("machine", "compressor")
    span = [x for key in ("evaporating", "condensing") for x in _span(metadata[key])]
    out = [f"! {key} = {value}" for key, value in metadata.items()]
    for quantity in ("capacity", "power"):
        values = [rows[quantity][n] for n in _ORDER]
        terms = ("1", "x", "x^2", "y", "y^2", "x y", "x^3", "y^3", "x^2 y", "x y^2")
        out += ["", "Curve:Bicubic,", f"  {name} {quantity}, !- Name"]
        out += [f"  {float(v)!r}, !- {t}" for v, t in zip(values, terms, strict=True)]
        ends = (
            "Minimum Value of x",
            "Maximum Value of x",
            "Minimum Value of y",
            "Maximum Value of y",
        )
        signs = (",", ",", ",", ";")
        out += [f"  {v:.6g}{s} !- {t}" for v, s, t in zip(span, signs, ends, strict=True)]
    given = {key: metadata.get(key, "").split(" ")[0] for key in _RATED}
    heads = ("Rated Superheat", "Rated Return Gas Temperature", "Rated Liquid Temperature",
             "Rated Subcooling")  # fmt: skip
    out += ["", "Refrigeration:Compressor,", f"  {name}, !- Name"]
    out += [f"  {name} {q}, !- {q.capitalize()} Curve" for q in ("power", "capacity")]
    pairs = zip(heads, given.values(), (",", ",", ",", ";"), strict=True)
    out += [f"  {value}{sign} !- {head}" for head, value, sign in pairs]
    return "\n".join([*out, ""])


def _span(text: str) -> tuple[float, float]:
    low, _, high = text.partition(" to ")
    return float(low), float(high.split(" ")[0])


def read_energyplus(
    path: str | os.PathLike, name: str | None = None
) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Metadata and coefficients [W], in the order of AHRI 540, of a compressor of EnergyPlus.

    Args:
        path: of the file.
        name: of the compressor; the only one of the file if absent.

    Raises:
        SceneError: no such compressor, several without a name, or a curve that is missing.
    """
    with reading(os.fspath(path)), open(path, encoding="utf-8") as file:
        text = file.read(4_000_000)
        plain = re.findall(r"^!\s*(\w+)\s*=\s*(.*)$", text, re.MULTILINE)
        metadata = {key: value.strip() for key, value in plain}
        bare = re.sub(r"!.*", "", text)
        objects = [[cell.strip() for cell in one.split(",")] for one in bare.split(";")]
        compressors = [n for n, one in enumerate(objects) if one[0].lower() == _COMPRESSOR]
        names = [objects[n][1] for n in compressors]
        if not names:
            raise SceneError("", "has no Refrigeration:Compressor")
        if name is None and len(names) > 1:
            listed = ", ".join(names[:8])
            raise SceneError(
                "", f"has {len(names)} compressors; name one as FILE.idf#NAME: {listed}"
            )
        if name is not None and name.lower() not in [one.lower() for one in names]:
            raise SceneError(name, f"is no compressor of the file, but {', '.join(names[:8])}")
        at = compressors[0 if name is None else [one.lower() for one in names].index(name.lower())]
        cells = [*objects[at], *[""] * 8]
        curves = {
            one[1].lower(): one for one in objects[:at] if one[0].lower() == _BICUBIC
        }  # the last of a name counts
        rows = {}
        for quantity, key in (("capacity", cells[3]), ("power", cells[2])):
            if key.lower() not in curves:
                raise SceneError(key, "is a Curve:Bicubic that is missing before the compressor")
            curve = curves[key.lower()]
            own = np.empty(10)
            own[list(_ORDER)] = [float(x) for x in curve[2:12]]
            rows[quantity] = own
            for side, low, high in (("evaporating", *curve[12:14]), ("condensing", *curve[14:16])):
                metadata.setdefault(side, f"{low} to {high} degC")
        for key, value in zip(_RATED, cells[4:8], strict=True):
            if value:
                unit = "degC" if key in ("return_gas", "liquid") else "K"
                metadata[key] = f"{value} {unit}"
        return metadata | {"machine": cells[1]}, rows


def tespy_text(
    metadata: Mapping[str, str], found: RatingMap, fluid: RealGas, swept_volume: float, speed: float
) -> str:
    """A map as what TESPy's `PolynomialCompressor` takes.

    Args:
        metadata: machine, fluid, ranges and rating, as in files of polynomials.
        found: the map.
        fluid: of the machine.
        swept_volume: [m^3] of all cylinders.
        speed: [1/s]
    """
    ok = np.asarray(found.ok)
    S, D = np.meshgrid(np.asarray(found.evaporating), np.asarray(found.condensing), indexing="ij")
    S, D = S[ok], D[ok]
    flow, power = (np.asarray(found.values[key])[ok] for key in ("mass_flow", "power"))
    density, rise, _ = _states(metadata, fluid, S, D)
    values = {
        "eta_s_poly": flow * rise / power,
        "eta_vol_poly": flow / (density * swept_volume * speed),
    }
    terms = polynomial_terms(S, D)
    rows = {key: np.linalg.lstsq(terms, value, rcond=None)[0] for key, value in values.items()}
    errors = {
        f"largest error of {key}": float(polynomial_errors(terms, rows[key], value).max())
        for key, value in values.items()
    }
    state = {"swept_volume": swept_volume, "frequency_poly": speed}
    for key, own in (("superheat", "T_sh"), ("subcooling", "T_sc")):
        if key in metadata:
            state[own] = float(metadata[key].split(" ")[0])
    out = {
        **metadata,
        **errors,
        **{k: v.tolist() for k, v in rows.items()},
        "reference_state": state,
    }
    return json.dumps(out, indent=1) + "\n"


def read_tespy(
    path: str | os.PathLike,
) -> tuple[dict[str, str], Callable[..., dict[str, np.ndarray]]]:
    """Metadata of such a file, and what gives (n,) capacity [W], power [W] and flow [kg/s] of points [K].

    Raises:
        SceneError: no JSON, or an entry that is missing.
    """
    with reading(os.fspath(path)), open(path, encoding="utf-8") as file:
        try:
            given = json.load(file)
        except json.JSONDecodeError as error:
            raise SceneError("", f"is no JSON: {error}") from None
        for key in ("fluid", "eta_s_poly", "eta_vol_poly", "reference_state"):
            if key not in given:
                raise SceneError(key, "is missing in a file of TESPy's PolynomialCompressor")
        state = given["reference_state"]
        metadata = {key: value for key, value in given.items() if isinstance(value, str)}
        for key, own in (("superheat", "T_sh"), ("subcooling", "T_sc")):
            if own in state and not {"return_gas", "liquid"} & metadata.keys():
                metadata.setdefault(key, f"{state[own]} K")
        gas = RealGas(given["fluid"])

        def at(S, D) -> dict[str, np.ndarray]:
            density, rise, worth = _states(metadata, gas, S, D)
            terms = polynomial_terms(S, D)
            flow = terms @ np.array(given["eta_vol_poly"]) * density
            flow *= state["swept_volume"] * state["frequency_poly"]
            power = flow * rise / (terms @ np.array(given["eta_s_poly"]))
            return {"capacity": flow * worth, "power": power, "mass_flow": flow}

        return metadata, at


def _states(metadata: Mapping[str, str], fluid: RealGas, S, D):
    """Density of the gas that comes, rise of isentropic compression, and worth of a kilogram."""

    def number(key: str):
        return float(metadata[key].split(" ")[0])

    gas = (
        number("return_gas") + ZERO + 0 * S if "return_gas" in metadata else S + number("superheat")
    )
    liquid = number("liquid") + ZERO + 0 * D if "liquid" in metadata else D - number("subcooling")

    def one(s, d, gas, liquid):
        low, high = fluid.saturation(T=s).p, fluid.saturation(T=d).p
        comes = fluid.state(gas, fluid.density(gas, low))
        rise = fluid.at_entropy(high, comes.s, comes).h - comes.h
        return comes.rho, rise, capacity_rise(fluid, s, gas, liquid)

    points = (jnp.asarray(x, float) for x in (S, D, gas, liquid))
    return tuple(np.asarray(x) for x in jax.jit(jax.vmap(one))(*points))
