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
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._core.errors import BadInput
from .._core.files import regular
from .._core.words import did_you_mean
from ..fluid import AbstractRealGas
from ..fluid.real_gas import fluid_named
from ..study.rating import RatingMap, capacity_rise, polynomial_errors, polynomial_terms
from ._settings import ERROR_OF, WORDS, known_name, measure_setting
from ._table_text import cell_number
from ._text import LARGEST, SceneError, reading
from ._units import scale

# Places of EnergyPlus' terms in the order of AHRI 540.
_ORDER = (0, 1, 3, 2, 5, 4, 6, 9, 7, 8)
_RATED = ("superheat", "return_gas", "liquid", "subcooling")
_COMPRESSOR = "refrigeration:compressor"
_BICUBIC = "curve:bicubic"
_REMARK = re.compile(r"^!\s*(\w+)\s*=\s*(.*)$", re.MULTILINE)
# Entries of a file of TESPy, beside texts of `_SETTINGS`.
_POLYNOMIALS = ("eta_s_poly", "eta_vol_poly")
_STATE = ("swept_volume", "frequency_poly", "T_sh", "T_sc")
_LARGEST_NUMBER = 1e30
_SETTINGS = (
    *WORDS, *_RATED, "useful_superheat", "evaporating", "condensing", "speed", "rating",
)  # fmt: skip


def energyplus_text(metadata: Mapping[str, str], rows: Mapping[str, Any]) -> str:
    """A map as objects of EnergyPlus.

    Args:
        metadata: machine, fluid, ranges and rating, as in files of polynomials.
        rows: ten coefficients [W] of "capacity" and "power" by name.
    """
    name = metadata.get("machine", "compressor")
    span = [*_span(metadata["evaporating"]), *_span(metadata["condensing"])]
    out = [f"! {key} = {value}" for key, value in metadata.items()]
    terms = ("1", "x", "x^2", "y", "y^2", "x y", "x^3", "y^3", "x^2 y", "x y^2")
    ends = (
        "Minimum Value of x",
        "Maximum Value of x",
        "Minimum Value of y",
        "Maximum Value of y",
    )
    for quantity in ("capacity", "power"):
        # as Python floats, which are written with all of their digits
        values = np.asarray(rows[quantity], float)[list(_ORDER)].tolist()
        out += ["", "Curve:Bicubic,", f"  {name} {quantity}, !- Name"]
        out += _fields(map(repr, values), terms, ",")
        out += _fields([f"{end:.6g}" for end in span], ends, ";")
    heads = ("Rated Superheat", "Rated Return Gas Temperature", "Rated Liquid Temperature",
             "Rated Subcooling")  # fmt: skip
    rated = [metadata.get(key, "").split(" ")[0] for key in _RATED]
    out += ["", "Refrigeration:Compressor,", f"  {name}, !- Name"]
    out += [f"  {name} power, !- Power Curve", f"  {name} capacity, !- Capacity Curve"]
    out += _fields(rated, heads, ";")
    return "\n".join([*out, ""])


def _fields(values: Iterable[str], names: Sequence[str], end: str) -> list[str]:
    """Lines of fields with their names as remarks; `end` is the sign behind the last."""
    signs = [","] * (len(names) - 1) + [end]
    rows = zip(values, signs, names, strict=True)
    return [f"  {value}{sign} !- {name}" for value, sign, name in rows]


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
    with reading(os.fspath(path)):
        text = _text_of(path)
        settings = {}
        for key, value in _REMARK.findall(text):
            setting = known_name(key, _SETTINGS)
            if setting is not None:
                settings[setting] = value.strip()
        objects = _objects(text)
        at = _compressor(objects, name)
        compressor = [*objects[at], *[""] * 8]
        curves = {}
        for cells in objects[:at]:
            if _is_curve(cells):
                curves[cells[1].lower()] = cells
        rows = {}
        for quantity, curve_name in (("capacity", compressor[3]), ("power", compressor[2])):
            if curve_name.lower() not in curves:
                problem = (
                    f"must be the name of a Curve:Bicubic before the compressor {compressor[1]}"
                )
                raise SceneError(f"{quantity} curve", problem, curve_name)
            numbers = _curve_numbers(curves[curve_name.lower()])
            rows[quantity] = np.empty(10)
            rows[quantity][list(_ORDER)] = numbers[:10]
            low, high, lowest, highest = numbers[10:]
            settings.setdefault("evaporating", f"{low!r} to {high!r} degC")
            settings.setdefault("condensing", f"{lowest!r} to {highest!r} degC")
        for key, value in zip(_RATED, compressor[4:8], strict=True):
            if value:
                unit = "degC" if key in ("return_gas", "liquid") else "K"
                settings[key] = f"{cell_number(value, key)!r} {unit}"
        return settings | {"machine": compressor[1]}, rows


def _text_of(path: str | os.PathLike) -> str:
    """Text of a file; signs that are not UTF-8 stand in remarks alone, and are passed over."""
    with open(regular(path), "rb") as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise SceneError("", f"is larger than {LARGEST / 1e6:.0f} MB")
    return content.decode("utf-8-sig", "replace")


def _objects(text: str) -> list[list[str]]:
    """Cells of the objects of EnergyPlus, without remarks."""
    bare = re.sub(r"!.*", "", text)
    objects = []
    for text in bare.split(";"):
        objects.append([cell.strip() for cell in text.split(",")])
    return objects


def _compressor(objects: Sequence[Sequence[str]], name: str | None) -> int:
    """Place of a compressor among objects, of the only one where no name is given.

    Raises:
        SceneError: no such compressor, or several without a name.
    """
    places = []
    names = []
    for place, cells in enumerate(objects):
        if cells[0].lower() == _COMPRESSOR and len(cells) > 1:
            places.append(place)
            names.append(cells[1])
    if not names:
        problem = "has no Refrigeration:Compressor; save the compressor with both of its curves"
        raise SceneError("", problem)
    listed = ", ".join(names[:8])
    if name is None and len(names) > 1:
        raise SceneError("", f"has {len(names)} compressors; name one as FILE.idf#NAME: {listed}")
    if name is None:
        return places[0]
    lowered = list(map(str.lower, names))
    if name.lower() not in lowered:
        raise SceneError(name, f"is no compressor of the file, but {listed}")
    return places[lowered.index(name.lower())]


def _is_curve(cells: Sequence[str]) -> bool:
    return cells[0].lower() == _BICUBIC and len(cells) > 1


def _curve_numbers(cells: Sequence[str]) -> list[float]:
    """Ten coefficients of a curve and the ends of its variables.

    Raises:
        SceneError: too few of them, or one that is no number.
    """
    name = cells[1]
    numbers = cells[2:16]
    if len(numbers) < 14:
        problem = "is a Curve:Bicubic with ten coefficients and four ends of its variables, but has"
        raise SceneError(name, f"{problem} {len(numbers)} numbers")
    return [cell_number(number, name) for number in numbers]


def tespy_text(
    metadata: Mapping[str, str],
    rating_map: RatingMap,
    fluid: AbstractRealGas,
    swept_volume: float,
    speed: float,
) -> str:
    """A map as what TESPy's `PolynomialCompressor` takes.

    Args:
        metadata: machine, fluid, ranges and rating, as in files of polynomials.
        rating_map: the map.
        fluid: of the machine.
        swept_volume: [m^3] of all cylinders.
        speed: [1/s]
    """
    ok = np.asarray(rating_map.ok)
    S, D = np.meshgrid(
        np.asarray(rating_map.evaporating), np.asarray(rating_map.condensing), indexing="ij"
    )
    S = S[ok]
    D = D[ok]
    flow = np.asarray(rating_map.values["mass_flow"])[ok]
    power = np.asarray(rating_map.values["power"])[ok]
    density, rise, _ = _states(metadata, fluid, S, D)
    values = {
        "eta_s_poly": flow * rise / power,
        "eta_vol_poly": flow / (density * swept_volume * speed),
    }
    terms = polynomial_terms(S, D)
    rows = {}
    errors = {}
    for key, value in values.items():
        row, *_ = np.linalg.lstsq(terms, value, rcond=None)
        rows[key] = row.tolist()
        errors[f"largest error of {key}"] = float(polynomial_errors(terms, row, value).max())
    state = {"swept_volume": swept_volume, "frequency_poly": speed}
    for key, tespy_key in (("superheat", "T_sh"), ("subcooling", "T_sc")):
        if key in metadata:
            state[tespy_key] = float(metadata[key].split(" ")[0])
    out = {**metadata, **errors, **rows, "reference_state": state}
    return json.dumps(out, indent=1) + "\n"


def read_tespy(
    path: str | os.PathLike,
) -> tuple[dict[str, str], Callable[..., dict[str, np.ndarray]]]:
    """Metadata of such a file, and what gives (n,) capacity [W], power [W] and flow [kg/s] of points [K].

    Raises:
        SceneError: no JSON, or an entry that is missing.
    """
    with reading(os.fspath(path)):
        try:
            document = json.loads(_text_of(path))
        except json.JSONDecodeError as error:
            raise SceneError("", f"is no JSON: {error}") from None
        except (RecursionError, ValueError):  # numbers of thousands of digits
            raise SceneError("", "is no JSON of TESPy's PolynomialCompressor") from None
        entries = _tespy_entries(document)
        state = entries.state
        settings = dict(entries.settings)
        for key, of_state in (("superheat", "T_sh"), ("subcooling", "T_sc")):
            if of_state in state and not {"return_gas", "liquid"} & settings.keys():
                settings.setdefault(key, f"{state[of_state]!r} K")
        gas = _fluid(settings["fluid"])
        for level, difference in (("return_gas", "superheat"), ("liquid", "subcooling")):
            if level not in settings and difference not in settings:
                raise SceneError(level, f"or {difference} must be given")

        def at(S, D) -> dict[str, np.ndarray]:
            density, rise, worth = _states(settings, gas, S, D)
            terms = polynomial_terms(S, D)
            efficiency = terms @ entries.isentropic
            if not (efficiency > 0).all():
                problem = "must give an efficiency above 0 at all points of the ranges"
                raise SceneError("eta_s_poly", problem, float(efficiency.min()))
            flow = terms @ entries.volumetric * density
            flow *= state["swept_volume"] * state["frequency_poly"]
            power = flow * rise / efficiency
            return {"capacity": flow * worth, "power": power, "mass_flow": flow}

        return settings, at


class _Tespy(NamedTuple):
    """Entries of a file of TESPy: settings, coefficients of efficiencies, and the reference state."""

    settings: Mapping[str, str]
    isentropic: np.ndarray
    volumetric: np.ndarray
    state: Mapping[str, float]


def _tespy_entries(document: Any) -> _Tespy:
    """Entries of the JSON of a file, each of its type.

    Raises:
        SceneError: an entry that is missing, unknown or of another type.
    """
    if not isinstance(document, dict):
        raise SceneError("", "must be one JSON object, as TESPy's PolynomialCompressor takes it")
    for key in ("fluid", *_POLYNOMIALS, "reference_state"):
        if key not in document:
            raise SceneError(key, "is missing in a file of TESPy's PolynomialCompressor")
    isentropic = _coefficients(document["eta_s_poly"], "eta_s_poly")
    volumetric = _coefficients(document["eta_vol_poly"], "eta_vol_poly")
    state = _reference_state(document["reference_state"])
    return _Tespy(
        settings=_tespy_settings(document),
        isentropic=isentropic,
        volumetric=volumetric,
        state=state,
    )


def _tespy_settings(document: Mapping[str, Any]) -> dict[str, str]:
    """Texts among the entries of a file."""
    settings = {}
    for key, value in document.items():
        if key in (*_POLYNOMIALS, "reference_state") or key.startswith(ERROR_OF):
            continue
        name = known_name(key, _SETTINGS)
        if name is None:
            raise SceneError(key, f"is an unknown entry{did_you_mean(key, _SETTINGS)}")
        if not isinstance(value, str):
            raise SceneError(key, 'must be a text, with its unit, as "10 K"', value)
        settings[name] = value
    return settings


def _reference_state(state: Any) -> Mapping[str, float]:
    """Numbers of the state at which the polynomials hold."""
    if not isinstance(state, dict):
        raise SceneError("reference_state", "must be an object", state)
    for key, value in state.items():
        place = f"reference_state.{key}"
        if key not in _STATE:
            raise SceneError(place, f"is an unknown entry{did_you_mean(key, _STATE)}")
        _json_number(value, place)
    for key in ("swept_volume", "frequency_poly"):
        if not state.get(key, 0) > 0:
            raise SceneError(f"reference_state.{key}", "must be a number above 0", state.get(key))
    return state


def _coefficients(numbers: Any, key: str) -> np.ndarray:
    """Ten numbers of a list."""
    if not isinstance(numbers, list) or len(numbers) != 10:
        raise SceneError(key, "must be a list of ten numbers", numbers)
    coefficients = []
    for n, value in enumerate(numbers):
        coefficients.append(_json_number(value, f"{key}.{n}"))
    return np.array(coefficients)


def _json_number(number: Any, key: str) -> float:
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise SceneError(key, "must be a number", number)
    # a whole number may have any number of digits
    if not abs(number) < _LARGEST_NUMBER:
        raise SceneError(key, f"must be a number below {_LARGEST_NUMBER:g}", number)
    return float(number)


def _fluid(name: str) -> AbstractRealGas:
    try:
        return fluid_named(name)
    except BadInput as error:
        raise SceneError("fluid", f"must be {error.bound}", name) from None


def _states(metadata: Mapping[str, str], fluid: AbstractRealGas, S, D):
    """Density of the gas that comes, rise of isentropic compression, and worth of a kilogram."""

    def kelvins(key: str) -> float:
        """[K] Number of a setting, which is a temperature or a difference."""
        level = key in ("return_gas", "liquid")
        example = "18.3 degC" if level else "10 K"
        number, unit = measure_setting(metadata, key, example)
        size, zero = scale(unit, "K", level, key, unit)
        return number * size + zero

    if "return_gas" in metadata:
        return_gas = kelvins("return_gas")
        gas = return_gas + 0 * S
    else:
        gas = S + kelvins("superheat")
    if "liquid" in metadata:
        liquid = kelvins("liquid") + 0 * D
    else:
        liquid = fluid.bubble_of_dew(D) - kelvins("subcooling")
    points = [jnp.asarray(x, float) for x in (S, D, gas, liquid)]
    density, rise, worth = _states_at(fluid, *points)
    return np.asarray(density), np.asarray(rise), np.asarray(worth)


@eqx.filter_jit
def _states_at(fluid: AbstractRealGas, evaporating, condensing, gas, liquid):
    """(n,) of `_states` at n temperatures [K]; one program for all files of a fluid and a size."""

    def at_point(evaporating, condensing, gas, liquid):
        low = fluid.saturation(T=evaporating).p
        high = fluid.saturation(T=condensing).p
        comes = fluid.state(gas, fluid.density(gas, low))
        rise = fluid.at_entropy(high, comes.s, comes).h - comes.h
        return comes.rho, rise, capacity_rise(fluid, evaporating, condensing, gas, liquid)

    return jax.vmap(at_point)(evaporating, condensing, gas, liquid)
