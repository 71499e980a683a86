"""`jaxcomp map`: capacity, power and COP over evaporating and condensing temperature."""

from __future__ import annotations

from math import pi
from typing import Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.display import shown
from . import _options as opt
from ._arguments import changed_scene, with_one_unit
from ._output import Output
from ._start import refuse, waiting
from ._sweep import axis_values
from ._tables import number_text, row_table

# Temperatures of a map on each side.
_MOST = 100
# What the gas that comes and the liquid before the expansion are; see `jaxcomp.study.rating.RATINGS`.
Standard = Literal["file", "ashrae", "en12900", "en12900-superheat", "ahri540", "cecomaf"]
Form = Literal["csv", "energyplus", "tespy"]


def rating_map(
    *,
    evaporating: str = "-30:-10:5",
    condensing: str = "35:55:5",
    rating: Standard = "file",
    reference: Literal["dew", "mean"] | None = None,
    coefficients: Literal["10", "20", "30"] = "10",
    speeds: str | None = None,
    solver: opt.Solver = "collocation",
    cycle: opt.CycleOption = None,
    form: Annotated[Form, typer.Option("--format")] = "csv",
    case: opt.Case,
    output: Output,
) -> None:
    """Map a refrigeration compressor with valves over evaporating and condensing temperature.

    Prints capacity, power and COP and the ten coefficients of AHRI 540 for degrees Celsius.

    Example: [bold]jaxcomp map r134a-7cc --evaporating=-30:-10:5 --rating ashrae --out map[/bold]

    Args:
        evaporating (FROM:TO:COUNT): Evaporating temperatures, in degrees Celsius or with a unit, as
            -22degF:14degF:5.
        condensing (FROM:TO:COUNT): Condensing temperatures, likewise.
        rating: Return gas and liquid: those of the file, ASHRAE (both 32.2 C), EN 12900 (return gas 20
            C or superheat 10 K), AHRI 540 (18.3 C) or CECOMAF (32 C).
        reference: What both temperatures are of a blend with glide: those of dew points, or mean ones
            of evaporator and condenser. Absent: as the machine file says.
        coefficients: Of the polynomial in coefficients.csv of --out; 20 and 30 are over --speeds as well.
        speeds (SPEED,SPEED): Mean speeds for 20 and 30 coefficients, at least three; tables and
            pictures are those of the first.
        form: Of the file of coefficients: CSV as in AHRI 540 and EN 12900, objects of EnergyPlus,
            or the polynomials of TESPy's PolynomialCompressor; `identify` reads all of them.
    """
    over = axis(evaporating, "evaporating"), axis(condensing, "condensing")
    from ..scene.map_files import FORMATS, polynomial_text, rating_metadata

    scenes = _at_speeds(case, speeds)
    refuse(
        speeds is None and coefficients != "10",
        f"--coefficients {coefficients}: needs --speeds, at least three",
    )
    scene = scenes[0]
    kind = reference
    if kind is None:
        gas = getattr(scene.compressor, "gas", None)
        kind = getattr(gas, "reference", "dew")
    refuse(
        kind == "mean" and form != "csv",
        f"--format {form}: takes dew temperatures; map with --reference dew",
    )
    options = jc.cylinder.CycleOptions()
    if cycle is not None:
        options = opt.cycle_of(options, cycle)
    method = opt.chosen_solver(solver, scene)
    with waiting("Solving the points (the first time they are compiled as well) ..."):
        # a speed that is named twice is solved once
        by_speed = {_speed(at_speed): at_speed for at_speed in scenes}
        maps = {}
        for speed, at_speed in by_speed.items():
            maps[speed / (2 * pi)] = jc.study.rating.rating_map(
                at_speed, *over, rating, options, method, kind
            )
    points = next(iter(maps.values()))
    files = {}
    if output.out is not None and points.coefficients:
        metadata = rating_metadata(scene, rating, kind)
        files[FORMATS[form]] = polynomial_text(
            maps, int(coefficients), metadata, form, scene.as_compressor()
        )

    def pictures():
        from ..plot._cylinder import rating_figures

        return rating_figures(points, scene.name)

    output.emit(
        points,
        lambda _: map_tables(points, scene.name, glide_text(scene, points)),
        pictures,
        scene,
        {"map": lambda: _columns(points)},
        files=lambda: files,
        metadata={"machine": scene.name, "file": scene.file, **case.changes},
    )


def _columns(points: jc.study.rating.RatingMap) -> dict[str, list[float]]:
    """The points for people: temperatures in degrees Celsius, numbers with the digits that they have."""
    from ..study.rating import ZERO

    columns = {}
    for name, values in points.columns().items():
        if name.endswith(" [K]"):
            name = f"{name.removesuffix(' [K]')} [degC]"
            values = values - ZERO
        columns[name] = values.tolist()
        if values.dtype != bool:
            columns[name] = list(map(_rounded, columns[name]))
    return columns


def _rounded(value: float) -> float:
    """Six digits, of which a map has fewer."""
    return float(f"{value:.6g}")


def _at_speeds(case: opt.Case, speeds: str | None) -> list[jc.scene.Scene]:
    """The machine at every speed of `--speeds`, or as it is."""
    scene = case.scene()
    sets = case.sets or ()
    if speeds is None:
        return [scene]
    texts = with_one_unit(speeds.split(","))
    return [changed_scene(case.machine, [*sets, f"motor.mean_speed={text}"]) for text in texts]


def _speed(scene: jc.scene.Scene) -> float:
    """[rad/s] of the motor, about."""
    return float(scene.as_compressor().motor.speed_guess)


def glide_text(scene: jc.scene.Scene, points) -> str:
    """Glide at the ends of both axes, in words; "" of a fluid without."""
    gas: Any = scene.as_compressor().gas
    fluid = gas.fluid
    if not fluid.has_glide:
        return ""
    from ..study.rating import ZERO

    words = []
    for side, temperatures in (
        ("evaporating", points.evaporating),
        ("condensing", points.condensing),
    ):
        for mean_or_dew in dict.fromkeys((float(temperatures[0]), float(temperatures[-1]))):
            dew = mean_or_dew
            # of the whole line, also in the evaporator
            if points.reference == "mean":
                dew = float(fluid.dew_of_mean(mean_or_dew))
            glide = dew - float(fluid.bubble_of_dew(dew))
            words.append(f"{glide:.3g} K at {mean_or_dew - ZERO:.4g} °C {side}")
    kind = "dew points" if points.reference == "dew" else "mean temperatures"
    return f"Temperatures are {kind}; glide of {fluid.name}: {', '.join(words)}."


def map_tables(points, name: str, glide: str = ""):
    """Capacity, power and COP, and the coefficients."""
    from ..study.rating import QUANTITIES, ZERO

    units = {quantity: unit for quantity, unit, _ in QUANTITIES}
    heads = ("Evaporating, °C", *(f"{t - ZERO:.4g}" for t in points.condensing.tolist()))
    for quantity in ("capacity", "power", "cop"):
        look = shown(quantity, units[quantity], points.values[quantity])
        values = (points.values[quantity] * look.factor).tolist()
        rows: list[Any] = []
        for evaporating, row in zip(points.evaporating.tolist(), values, strict=True):
            cells = (number_text(value, ".4g") for value in row)
            rows.append((f"{evaporating - ZERO:.4g}", *cells))
        yield row_table(f"{name}: {look.label}, over condensing temperature, °C", heads, rows)
    if glide:
        yield glide
    failed = int((~points.ok).sum())
    if failed:
        yield f"[yellow]Note:[/yellow] {failed} of {points.ok.size} points failed and are empty."
    if not points.coefficients:
        yield "No coefficients: they take ten points, with four temperatures on either axis."
        return
    terms = ("1", "S", "D", "S^2", "S D", "D^2", "S^3", "D S^2", "S D^2", "D^3")
    rows = []
    polynomials = zip(terms, *points.coefficients.values(), strict=True)
    for number, (term, *row) in enumerate(polynomials, 1):
        rows.append((f"C{number}", term, *(f"{value:.8g}" for value in row)))
    errors = (f"{100 * float(e):.2g} %" for e in points.fit_error.values())
    worst = (f"{s - ZERO:.4g}, {d - ZERO:.4g}" for s, d in points.worst_point.values())
    rows += [(), ("", "largest error, of the point", *errors), ("", "at S, D", *worst)]
    labels = (f"{quantity}, {units[quantity]}" for quantity in points.coefficients)
    title = "Polynomial of AHRI 540, S evaporating and D condensing in °C"
    yield row_table(title, ("", "Term", *labels), rows, texts=2)


def axis(text: str, name: str):
    """Temperatures [K] from `FROM:TO:COUNT` or a list with commas, of numbers in degrees Celsius."""
    import numpy as np

    from ..study.rating import ZERO

    option = f"--{name}"
    values = np.array(axis_values(text, "K", option, False, "degC"))
    low = ZERO - 150
    high = ZERO + 250
    good = values.size <= _MOST and np.all((values > low) & (values < high))
    refuse(not good, f"{option} {text}: must be at most {_MOST} temperatures from -150 to 250 degC")
    return values
