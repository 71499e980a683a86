"""`jaxcomp identify`: constants of a machine from its measurements, and the points not measured."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.declared import BESIDE, Record, reading
from .._core.display import Shown, is_temperature, shown
from ._arguments import assignments, si, speed_of, split_at
from ._map import axis
from ._options import Case, Solver, chosen_solver
from ._output import Output, Partial
from ._start import CommandError, refuse, waiting
from ._tables import as_note, number_text, row_table

Loss = Literal["linear", "soft_l1", "huber"]
# Readings of a quantity that are printed one by one.
_MOST = 60
# How far a point of --fit-at may lie from one of the data [K].
_SAME = 0.05


@dataclass(frozen=True)
class Polynomials:
    """Where the polynomials of a maker become points."""

    evaporating: str | None = None
    condensing: str | None = None
    speed: str | None = None

    def read(self, files: Sequence[Path], scene, method) -> list[Any]:
        """The measurements of some files, of polynomials at every speed."""
        from ..scene.measured import read_measurement

        evaporating = None
        if self.evaporating is not None:
            evaporating = axis(self.evaporating, "evaporating")
        condensing = None
        if self.condensing is not None:
            condensing = axis(self.condensing, "condensing")
        speeds: list[float | None] = [None]
        if self.speed is not None:
            speeds = [speed_of(text, "--speed") for text in self.speed.split(",")]
        measurements = []
        for file, speed in product(files, speeds):
            measurement = read_measurement(file, scene.machine, evaporating, condensing, speed)
            measurements.append(measurement.solved_by(method))
        return measurements


@dataclass(frozen=True)
class Split:
    """The points that the fit sees, and those that it predicts."""

    fit_at: str | None = None
    hold_out: int = 0

    def held_out(self, data_sets: Sequence[Any], seed: int) -> list[int]:
        """Points that are not fitted, counted over all files."""
        import numpy as np

        counts = [len(set(data_set.entries({}).point.tolist())) for data_set in data_sets]
        if self.fit_at is not None:
            refuse(self.hold_out, "--hold-out and --fit-at: give one of the two")
            return _not_named(data_sets, counts, self.fit_at)
        if not self.hold_out:
            return []
        number = self.hold_out
        total = sum(counts)
        refuse(
            not 0 < number < total,
            f"--hold-out {number}: must be from 1 to {total - 1} of the points",
        )
        return np.random.default_rng(seed).choice(total, number, replace=False).tolist()


def identify(
    *,
    data: Annotated[list[Path], typer.Option()],
    vary: list[str] | None = None,
    prior: list[str] | None = None,
    sd: list[str] | None = None,
    split: Split,
    polynomials: Polynomials,
    own_factors: bool = False,
    predict: Path | None = None,
    loss: Loss = "linear",
    starts: int = 3,
    seed: int = 0,
    solver: Solver = "collocation",
    case: Case,
    output: Output,
) -> None:
    """Identify constants of a machine from measurements, and predict the points held out.

    Measurements are points of a map, readings over the crank angle, tables of any quantities, modal tests
    and vibration, of one kind or several. Prints the constants with their standard errors, what cannot
    be told apart, measured against computed, and what is not to be trusted. --out also takes the
    identified machine, as machine.toml, its covariance in identified.json, and tolerances.toml, with
    which `tolerance` draws such machines.

    Without --vary the machine is taken for one of the same kind that is known by its map alone: a similar
    one of the size that the flow wants, of which size, clearance, flow areas, leakage, heating and losses
    are fitted with wide priors.

    Example: [bold]jaxcomp identify semi-hermetic-200cc --data map.csv --hold-out 4 --out found[/bold]

    Of chosen constants: [bold]jaxcomp identify r600a-8cc --data map.csv --data diagram.csv --vary
    gas.clearance_ratio=1%:10% --prior gas.clearance_ratio=2%+-0.5% --vary
    gas.*_valve.flow_coefficient=0.5:1.5[/bold]

    Args:
        data (FILE): CSV of readings, or of a maker's polynomials; UFF of a modal test; or the name of a
            bundled map, such as 06dm313_r22. Repeatable.
        vary (PATH=LO:HI): Constant and its bounds, half to twice its value if left out; a pattern such as
            gas.*_valve.port_diameter=0.7:1.5 varies a common factor. Repeatable.
        prior (PATH=VALUE+-SD): What is known of a constant beforehand. Repeatable.
        sd (NAME=VALUE): Standard deviation of a quantity, power=1.5% or discharge_temperature=2K.
            Repeatable.
        fit_at (E/C,E/C): Points to fit, in degrees Celsius or with a unit; all others are held out.
        hold_out (N): So many points, drawn at random, are held out.
        evaporating (FROM:TO:COUNT): Where to take polynomials, degrees Celsius, or a list.
        condensing (FROM:TO:COUNT): The same.
        speed (SPEED,SPEED): At which to take polynomials with speed, such as 50 Hz; for others the speed
            of the machine.
        own_factors: Give flow and power a factor of their own at every speed but the first.
        predict (FILE): Points to predict with intervals, in a file as those of the data.
        loss: Of the readings; soft_l1 and huber give little to outliers.
        starts (N): Beginnings of the fit; the first is the machine as it is.
        seed (N): Of what is drawn.
    """
    from ..scene.readings import identified_scene
    from ..scene.tolerances import identified_tolerances

    scene = case.scene(varied=vary)
    method = chosen_solver(solver, scene)
    data_sets = polynomials.read(data, scene, method)
    if own_factors:
        from ..study.identification._readings import with_own_factors

        data_sets = with_own_factors(data_sets)
    if vary:
        bounds = _bounds(scene, vary)
        priors = {}
    else:
        scene, bounds, priors = _by_recipe(scene, data_sets)
    priors |= _priors(scene, prior)
    held_out = split.held_out(data_sets, seed)
    prediction_points = []
    if predict is not None:
        prediction_points = polynomials.read([predict], scene, method)
    options = {"sd": _deviations(data_sets, sd), "hold_out": held_out}
    options |= {"loss": loss, "starts": starts, "seed": seed}
    identification, prediction = _identified(
        scene, data_sets, bounds, priors, options, prediction_points, output.out
    )
    curves: dict[str, Any] = {"readings": identification.columns}
    numbers = None
    if prediction is not None:
        curves["predicted"] = prediction.columns
        numbers = PredictedReadings(prediction.columns())

    def tables(_) -> Iterator[Any]:
        yield from identification_tables(identification, scene.name)
        if prediction is not None:
            yield from prediction_tables(prediction)

    def pictures():
        from ..plot._identified import identification_figures

        return identification_figures(identification, scene.name)

    output.emit(
        identification,
        tables,
        pictures,
        identified_scene(scene, identification),
        curves,
        files=lambda: {
            "identified.json": json.dumps(identification.entries(), indent=1),
            "tolerances.toml": identified_tolerances(identification),
        },
        metadata={"machine": scene.name, "file": scene.file},
        numbers=numbers,
    )


@dataclass(frozen=True)
class PredictedReadings(Record):
    """Readings that are predicted, as columns."""

    predicted: dict[str, Any] = reading(BESIDE)


def _identified(
    scene, data_sets, bounds, priors, options: dict[str, Any], prediction_points, out: Path | None
):
    """The identification, and what it predicts; the best estimate so far is kept."""
    partial = Partial(out, "evaluations")

    def keep(estimate, chi_square):
        names = list(bounds)
        columns = {"constant": names, "value, SI": estimate[: len(names)].tolist()}
        partial.keep(columns, f"chi-square {chi_square:.4g}")

    with waiting("Solving the points (the first time they are compiled as well) ...") as status:

        def progress(text: str) -> None:
            if status is not None:
                status.update(f"{text} ...")

        options |= {"progress": progress, "keep": keep}
        identification = jc.study.identify(scene, data_sets, bounds, priors, **options)
        prediction = None
        if prediction_points:
            prediction = identification.predict(*prediction_points)
    partial.finish()
    return identification, prediction


def identification_tables(identification, name: str) -> Iterator[Any]:
    """Constants, readings, points held out, and what is not to be trusted."""
    yield _constants(identification, name)
    chi = f"Chi-square {float(identification.chi_square):.4g} on {int(identification.freedom)}"
    yield f"{chi}, p = {float(identification.p_value):.2g}."
    looks = {}
    for quantity in identification.quantities:
        measured = identification.measured[identification.of(quantity)]
        looks[quantity] = shown(quantity, identification.kinds[quantity].unit, measured)
        if quantity == "frequency":  # of a mode, which nobody gives in rpm
            looks[quantity] = Shown("Frequency", "Hz", 1 / (2 * math.pi))
        if measured.size <= _MOST:
            yield _readings(identification, quantity, looks[quantity])
    for quantity, look in looks.items():
        error = identification.error(quantity)[identification.used[identification.of(quantity)]]
        if error.size > _MOST:
            size = _error(float((error**2).mean() ** 0.5), *identification.kinds[quantity], look)
            yield f"{look.label}: {error.size} readings, RMS error {size.lstrip('+')}."
    rows = []
    for quantity, statistics in identification.held_out.items():
        kind = identification.kinds[quantity]
        look = looks[quantity]
        rms = _error(statistics.rms, *kind, look).lstrip("+")
        largest = _error(statistics.largest, *kind, look).lstrip("+")
        rows.append((quantity, str(statistics.count), rms, largest, f"{statistics.inside:.0%}"))
    if rows:
        heads = ("Points not fitted", "Count", "RMS", "Largest", "Inside 95 %")
        yield row_table("Predicted", heads, rows)
    for note in identification.notes:
        yield as_note(f"{note}.")


def _constants(identification, name: str):
    """The constants before and after, with their standard errors."""
    rows = []
    for parameter in identification.estimates:
        look = Shown(parameter.name, parameter.unit, 1.0)
        if is_temperature(parameter.name, parameter.unit):
            look = shown(parameter.name, parameter.unit, 0.0)
        rows.append(
            (
                parameter.name,
                look.units,
                look.number(parameter.start),
                look.number(parameter.estimate),
                f"{parameter.standard_error:.5g}",
                number_text(parameter.prior_share, ".0%"),
            )
        )
    heads = ("Constant", "Unit", "Before", "Identified", "Standard error", "Left of prior")
    return row_table(f"{name}: identified from {identification.source}", heads, rows, texts=2)


def _readings(identification, quantity: str, look: Shown):
    """The readings of a quantity, each with what was computed."""
    import numpy as np

    of_quantity = identification.of(quantity)
    kind = identification.kinds[quantity]
    errors = identification.error(quantity).tolist()
    rows = []
    for place, error in zip(np.flatnonzero(of_quantity).tolist(), errors, strict=True):
        half_width = float(identification.half_width[place])
        rows.append(
            (
                identification.names[place],
                look.number(float(identification.measured[place])),
                look.number(float(identification.computed[place])),
                _error(error, *kind, look),
                f"{half_width * look.factor:.2g}",
                "fitted" if identification.used[place] else "predicted",
            )
        )
    heads = ("Point", "Measured", "Computed", "Error", "95 %, +-", "")
    return row_table(look.label, heads, rows)


def _error(value: float, unit: str, relative: bool, look) -> str:
    if relative:
        return f"{100 * value:+.2f} %"
    if unit == "K":
        return f"{value:+.2f} K"
    return f"{value * look.factor:+.3g}"


def prediction_tables(predicted) -> Iterator[Any]:
    """Predictions with their intervals."""
    entries, prediction = predicted
    points = predicted.points
    rows = []
    for n, name in enumerate(entries.quantity):
        look = shown(name, entries.kinds[name].unit, prediction.value[n : n + 1])
        cells = (look.number(prediction.value[n]), look.difference(prediction.inflated[n]))
        rows.append((points[n], look.label, *cells))
    yield row_table("Predicted", ("Point", "Quantity", "Value", "95 %, +-"), rows, texts=2)


def _by_recipe(scene, data_sets):
    """The scene of a similar machine of the right size, what is varied of it, and priors."""
    from ..scene._change import with_machine

    maps = [data_set for data_set in data_sets if isinstance(data_set, jc.study.Readings)]
    refuse(not maps, "--vary: is missing; only a map can do without")
    recipe = jc.study.map_recipe(scene, maps)
    source = f"similar to {scene.name}, of the size that the flow wants"
    return with_machine(scene, recipe.machine, source), recipe.vary, recipe.prior


def _bounds(scene, texts) -> dict[str, tuple[float, float] | None]:
    from ..study.identification._common_factor import varied

    out = {}
    for text in texts:
        name, equals, range_text = split_at("=", text)
        low, colon, high = range_text.partition(":")
        refuse(equals and not colon, f"--vary {text}: must be PATH or PATH=LO:HI")
        unit = varied(scene.machine, name).unit
        out[name] = None
        if equals:
            out[name] = (si(low, unit, f"--vary {name}"), si(high, unit, f"--vary {name}"))
    return out


def _priors(scene, texts) -> dict[str, tuple[float, float]]:
    from ..study.identification._common_factor import varied

    out = {}
    for name, prior_text in assignments(texts, "--prior").items():
        mean, sign, width = prior_text.partition("+-")
        refuse(not sign, f"--prior {name}={prior_text}: must be PATH=VALUE+-SD")
        unit = varied(scene.machine, name).unit
        option = f"--prior {name}"
        # a width is a difference: of a temperature in degrees Celsius no zero is taken off it
        out[name] = (si(mean.strip(), unit, option), si(width.strip(), unit, option, True))
    return out


def _deviations(data_sets, texts) -> dict[str, float]:
    from .._core.words import one_of

    names = []
    relative = {}
    for data_set in data_sets:
        names += data_set.names_of_sd
        for name, kind in data_set.entries({}).kinds.items():
            relative[name] = kind.relative
    names = list(dict.fromkeys(names))
    out = {}
    for name, deviation_text in assignments(texts, "--sd").items():
        refuse(name not in names, f"--sd {name}: must be {one_of(name, names)}")
        unit = ""
        if name.endswith("temperature") and not relative.get(name, True):
            unit = "K"
        out[name] = si(deviation_text, unit, f"--sd {name}", difference=True)
    return out


def _not_named(data_sets: Sequence[Any], counts: Sequence[int], fit_at: str) -> list[int]:
    """Points of maps that `--fit-at` does not name; those of the other kinds are all fitted."""
    import numpy as np

    points = []
    evaporating = []
    condensing = []
    names = []
    first = 0
    for data_set, count in zip(data_sets, counts, strict=True):
        if isinstance(data_set, jc.study.Readings):
            points += range(first, first + data_set.evaporating.size)
            evaporating += data_set.evaporating.tolist()
            condensing += data_set.condensing.tolist()
            names += data_set.names
        first += count
    refuse(not points, "--fit-at: needs points of a map in --data")
    points = np.array(points)
    evaporating = np.array(evaporating)
    condensing = np.array(condensing)
    used = np.zeros(points.size, bool)
    for text in fit_at.split(","):
        try:
            evaporating_text, condensing_text = text.split("/")
            s = si(evaporating_text, "K", "--fit-at evaporating", default_unit="degC")
            d = si(condensing_text, "K", "--fit-at condensing", default_unit="degC")
        except ValueError:
            raise CommandError(
                f"--fit-at {text}: must be EVAPORATING/CONDENSING, as -5/30 or 23F/86F"
            ) from None
        distance = np.hypot(evaporating - s, condensing - d)
        closest = names[int(distance.argmin())]
        refuse(
            distance.min() > _SAME,
            f"--fit-at {text}: is no point of the data; the closest is {closest}",
        )
        used |= distance <= _SAME
    return points[~used].tolist()
