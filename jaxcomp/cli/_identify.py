"""`jaxcomp identify`: constants of a machine from its measurements, and the points not measured."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.display import Shown, is_temperature, shown
from .._core.nested import fields_of, plain
from ._arguments import assignments, si, speed_of
from ._map import axis
from ._options import Case, Solver, chosen_solver
from ._output import Output, Partial
from ._start import CommandError, refuse, waiting
from ._tables import row_table

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

        ends = fields_of(self, "evaporating", "condensing").items()
        over = [None if text is None else axis(text, name) for name, text in ends]
        texts = [] if self.speed is None else self.speed.split(",")
        speeds = [speed_of(one, "--speed") for one in texts] or [None]
        return [
            read_measurement(file, scene.machine, *over, speed).solved_by(method)
            for file in files
            for speed in speeds
        ]


@dataclass(frozen=True)
class Split:
    """The points that the fit sees, and those that it predicts."""

    fit_at: str | None = None
    hold_out: int = 0

    def held_out(self, data_sets: Sequence[Any], seed: int) -> list[int]:
        """Points that are not fitted, counted over all files."""
        import numpy as np

        counts = [len(set(one.entries({}).point.tolist())) for one in data_sets]
        if self.fit_at is not None:
            refuse(self.hold_out, "--hold-out and --fit-at: give one of the two")
            return _not_named(data_sets, counts, self.fit_at)
        if not self.hold_out:
            return []
        number = self.hold_out
        total = sum(counts)
        what = f"--hold-out {number}: must be from 1 to {total - 1} of the points"
        refuse(not 0 < number < total, what)
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
    identified machine, as scene.toml, its covariance in identified.json, and tolerances.toml, with which
    `tolerance` draws such machines.

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
        data_sets = jc.study.interface.with_own_factors(data_sets)
    bounds, known = _bounds(scene, vary or ()), {}
    if not vary:
        scene, bounds, known = _by_recipe(scene, data_sets)
    known |= _priors(scene, prior)
    held = split.held_out(data_sets, seed)
    ahead = None if predict is None else polynomials.read([predict], scene, method)[0]
    options = {"sd": _deviations(data_sets, sd), "hold_out": held}
    options |= {"loss": loss, "starts": starts, "seed": seed}
    given = scene, data_sets, bounds, known
    found, said = _identified(*given, options, ahead, output.out)
    curves: dict[str, Any] = {"readings": found.columns}
    beside: dict[str, Any] = {"machine": scene.name, "file": scene.file}
    if said is not None:
        curves["predicted"] = said.columns
        beside["predicted"] = said.columns()

    def tables(_) -> Iterator[Any]:
        yield from identification_tables(found, scene.name)
        yield from () if said is None else prediction_tables(*said)

    output.emit(
        found,
        tables,
        lambda: jc.plot.interface.identification_figures(found, scene.name),
        identified_scene(scene, found),
        curves,
        files=lambda: {
            "identified.json": json.dumps(plain(found.nested()), indent=1),
            "tolerances.toml": identified_tolerances(found),
        },
        beside=beside,
    )


def _identified(scene, data_sets, bounds, known, options: dict[str, Any], ahead, out: Path | None):
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
        found = jc.study.identify(scene, data_sets, bounds, known, **options)
        said = None if ahead is None else found.predict(ahead)
    partial.done()
    return found, said


def identification_tables(found, name: str) -> Iterator[Any]:
    """Constants, readings, points held out, and what is not to be trusted."""
    rows = []
    for one in found.nested()["parameters"]:
        path = one["name"]
        unit = one["unit"]
        share = one["prior_share"]
        level = is_temperature(path, unit)
        look = shown(path, unit, 0.0) if level else Shown(path, unit, 1.0)
        both = (look.number(one[key]) for key in ("start", "estimate"))
        left = "" if share != share else f"{share:.0%}"
        rows.append((path, look.units, *both, f"{one['standard_error']:.5g}", left))
    heads = ("Constant", "Unit", "Before", "Identified", "Standard error", "Left of prior")
    yield row_table(f"{name}: identified from {found.source}", heads, rows, texts=2)
    chi = f"Chi-square {float(found.chi_square):.4g} on {int(found.freedom)}"
    yield f"{chi}, p = {float(found.p_value):.2g}."
    looks = {
        one: shown(one, found.kinds[one].unit, found.measured[found.of(one)])
        for one in found.quantities
    }
    few = [one for one in looks if found.of(one).sum() <= _MOST]
    yield from (_readings(found, one, looks[one]) for one in few)
    for quantity, look in looks.items():
        error = found.error(quantity)[found.used[found.of(quantity)]]
        if error.size > _MOST:
            size = _error(float((error**2).mean() ** 0.5), *found.kinds[quantity], look)
            yield f"{look.label}: {error.size} readings, RMS error {size.lstrip('+')}."
    rows = []
    for quantity, held in found.held_out.items():
        kind = found.kinds[quantity]
        look = looks[quantity]
        size = (_error(x, *kind, look).lstrip("+") for x in (held.rms, held.largest))
        rows.append((quantity, str(held.count), *size, f"{held.inside:.0%}"))
    if rows:
        heads = ("Points not fitted", "Count", "RMS", "Largest", "Inside 95 %")
        yield row_table("Predicted", heads, rows)
    yield from (f"[yellow]Note:[/yellow] {note}." for note in found.notes)


def _readings(found, quantity: str, look: Shown):
    """The readings of a quantity, each with what was computed."""
    mine = found.of(quantity)
    columns = (found.measured, found.computed, found.half_width, found.used)
    names = [name for name, one in zip(found.names, mine, strict=True) if one]
    lists = (one[mine].tolist() for one in columns)
    cells = [
        (at, look.number(m), look.number(c), _error(e, *found.kinds[quantity], look),
         f"{h * look.factor:.2g}", "fitted" if used else "predicted")
        for at, m, c, h, used, e in zip(names, *lists, found.error(quantity).tolist(), strict=True)
    ]  # fmt: skip
    heads = ("Point", "Measured", "Computed", "Error", "95 %, +-", "")
    return row_table(look.label, heads, cells)


def _error(value: float, unit: str, relative: bool, look) -> str:
    if relative:
        return f"{100 * value:+.2f} %"
    return f"{value:+.2f} K" if unit == "K" else f"{value * look.factor:+.3g}"


def prediction_tables(entries, said) -> Iterator[Any]:
    """Predictions with their intervals."""
    rows = []
    for n, name in enumerate(entries.quantity):
        look = shown(name, entries.kinds[name].unit, said.value[n : n + 1])
        cells = (look.number(said.value[n]), look.difference(said.inflated[n]))
        rows.append((entries.names[n], look.label, *cells))
    yield row_table("Predicted", ("Point", "Quantity", "Value", "95 %, +-"), rows, texts=2)


def _by_recipe(scene, data_sets):
    """The scene of a similar machine of the right size, what is varied of it, and priors."""
    maps = [one for one in data_sets if isinstance(one, jc.study.Readings)]
    refuse(not maps, "--vary: is missing; only a map can do without")
    made = jc.study.map_recipe(scene, maps)
    source = f"similar to {scene.name}, of the size that the flow wants"
    return jc.scene.interface.with_machine(scene, made.machine, source), made.vary, made.prior


def _bounds(scene, texts) -> dict[str, tuple[float, float] | None]:
    out = {}
    for text in texts:
        name, equals, given = (part.strip() for part in text.partition("="))
        low, colon, high = given.partition(":")
        refuse(equals and not colon, f"--vary {text}: must be PATH or PATH=LO:HI")
        unit = jc.study.interface.varied(scene.machine, name).unit
        out[name] = (
            tuple(si(one, unit, f"--vary {name}") for one in (low, high)) if equals else None
        )
    return out


def _priors(scene, texts) -> dict[str, tuple[float, float]]:
    out = {}
    for name, given in assignments(texts, "--prior").items():
        mean, sign, width = given.partition("+-")
        refuse(not sign, f"--prior {name}={given}: must be PATH=VALUE+-SD")
        unit = jc.study.interface.varied(scene.machine, name).unit
        both = ((mean, False), (width, True))
        out[name] = tuple(si(one.strip(), unit, f"--prior {name}", sd) for one, sd in both)
    return out


def _deviations(data_sets, texts) -> dict[str, float]:
    from .._core.words import one_of

    known = list(dict.fromkeys(name for one in data_sets for name in one.names_of_sd))
    relative = {
        name: kind.relative for one in data_sets for name, kind in one.entries({}).kinds.items()
    }
    out = {}
    for name, given in assignments(texts, "--sd").items():
        refuse(name not in known, f"--sd {name}: must be {one_of(name, known)}")
        unit = "K" if name.endswith("temperature") and not relative.get(name, True) else ""
        out[name] = si(given, unit, f"--sd {name}", difference=True)
    return out


def _not_named(data_sets: Sequence[Any], counts: Sequence[int], fit_at: str) -> list[int]:
    """Points of maps that `--fit-at` does not name; those of the other kinds are all fitted."""
    import numpy as np

    first = np.cumsum([0, *counts])
    pairs = zip(first[:-1], data_sets, strict=True)
    maps = [pair for pair in pairs if isinstance(pair[1], jc.study.Readings)]
    refuse(not maps, "--fit-at: needs points of a map in --data")
    points = np.concatenate([n + np.arange(one.evaporating.size) for n, one in maps])
    names = [name for _, one in maps for name in one.names]
    used = np.zeros(points.size, bool)
    for text in fit_at.split(","):
        try:
            s, d = (
                si(one, "K", f"--fit-at {side}", default_unit="degC")
                for side, one in zip(("evaporating", "condensing"), text.split("/"), strict=True)
            )
        except ValueError:
            raise CommandError(
                f"--fit-at {text}: must be EVAPORATING/CONDENSING, as -5/30 or 23F/86F"
            ) from None
        away = [np.hypot(one.evaporating - s, one.condensing - d) for _, one in maps]
        away = np.concatenate(away)
        closest = names[int(away.argmin())]
        what = f"--fit-at {text}: is no point of the data; the closest is {closest}"
        refuse(away.min() > _SAME, what)
        used |= away <= _SAME
    return points[~used].tolist()
