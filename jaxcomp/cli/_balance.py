"""`jaxcomp balance`: correction masses, from the model of a machine or from measurements."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.markup import escape

import jaxcomp as jc

from .._core.display import RPM, rounded, small_unit, vibration_unit
from . import _options as opt
from ._arguments import (
    assignments,
    changed_scene,
    listed,
    names_of,
    si,
    speeds_of,
    split_at,
    with_one_unit,
)
from ._output import Output
from ._rotor import chosen_excitation, rotor_of, scene_speeds
from ._start import CommandError, refuse, refuse_unknown, start_jax, waiting
from ._tables import by_column, column_table, percent_text, row_table

if TYPE_CHECKING:
    from ..balancing._influence import Influence

# [-] Of the vibration before: what is left below this is rounding.
_NOTHING = 1e-9
# A number of even places, perhaps from an angle on; and a weight, perhaps with how many there are.
_EVEN_PLACES = re.compile(r"(\d+)(?:\s+from\s+(.+))?")
_PIECES = re.compile(r"(?:(\d+)\s*[x*]\s*)?(.+)")
_MOST_PLACES = 360
# Corrections that a table lists of those that fit readings without phase.
_SHOWN = 6
# [-] Misfit of amplitudes, over those before, above which no reading is that wrong.
_LARGE_MISFIT = 0.1
_NEEDS_CRANK = "--without: needs --excitation crank"


# Objective of the balance; `classical` balances the rotor alone, as a balancing machine does. With the
# crank's forces it carries a ring for the rotating part of the rod, which is among them.
Method = Literal["least-squares", "min-max", "classical"]


@dataclass(frozen=True)
class Objective:
    """Aim of the masses: the readings that they make small, and the bounds that they keep."""

    method: Method = "least-squares"
    tikhonov: float = 0.0
    largest: str | None = None
    limit: str | None = None
    weights: Annotated[list[str] | None, typer.Option("--weight")] = None

    def check(self, planes: str | None, measured: Path | None) -> None:
        """Refuse options that cannot be combined."""
        bounded = self.tikhonov or self.largest
        refuse(
            self.method == "classical" and (bounded or planes or measured or self.limit),
            "--method classical: takes no --planes, --tikhonov, --largest, --limit or --measured; it "
            "balances the rotor of a machine in both planes",
        )
        refuse(
            self.method == "min-max" and bounded,
            "--method min-max cannot be combined with --tikhonov or --largest",
        )
        refuse(self.tikhonov and self.largest, "--largest: takes no --tikhonov beside it")
        refuse(
            self.limit and (self.tikhonov or self.method != "least-squares" or self.weights),
            "--limit: takes no --method, --tikhonov or --weight beside it",
        )

    def met(self, part: Influence) -> jc.balancing.Balance:
        """The balance of the chosen part of a system."""
        import numpy as np

        bounds = None
        if self.largest is not None:
            bounds = _largest(part, self.largest)
        if self.limit is not None:
            cost = None
            if part.radius is not None and np.isfinite(part.radius).all():
                cost = 1 / part.radius  # so that masses are least, and not masses times radius
            limit = _limit(part, self.limit)
            return jc.balancing.least_masses(part, limit, cost=cost, largest=bounds)
        if self.method == "min-max":
            return jc.balancing.min_max(part)
        if bounds is not None:
            return jc.balancing.bounded(part, bounds)
        return jc.balancing.least_squares(part, tikhonov=self.tikhonov)


@dataclass(frozen=True)
class Setting:
    """Places and stock of weights."""

    places: Annotated[list[str] | None, typer.Option("--places")] = None
    stock: str | None = None
    most_weights: int = 4
    per_place: int = 1
    each: str | None = None
    radius: str | None = None
    remove: str | None = None
    left_on: str | None = None

    def check(self, objective: Objective) -> None:
        """Refuse options that cannot be combined."""
        for option, value in (("--stock", self.stock), ("--each", self.each)):
            refuse(value and not self.places, f"{option}: needs --places beside it")
        refuse(self.stock and self.each, "--each: bounds weights of any mass, not those of --stock")
        for option, value in (
            ("--most-weights", self.most_weights),
            ("--per-place", self.per_place),
        ):
            refuse(value < 1, f"{option} {value}: must be >= 1")
        other = objective.method != "least-squares" or objective.tikhonov or objective.largest
        refuse(
            self.places and (other or objective.limit),
            "--places: takes no --method, --tikhonov, --largest or --limit beside it; weights at places "
            "are those of least squares",
        )
        refuse(
            self.radius and not self.places and not self.remove,
            "--radius: needs --places or --remove beside it",
        )

    def with_trials_left_on(self, influence: Influence) -> Influence:
        """The system with the trial weights on that stay on."""
        if self.left_on is None:
            return influence
        trials = influence.trials
        if trials is None:
            raise CommandError("--left-on: has a meaning with --measured alone")
        weights: dict[str, complex] = {}
        for run in self.runs_left_on(influence):
            refuse_unknown(f"--left-on {run}", run, trials.runs, "run with a trial weight")
            number = trials.runs.index(run)
            plane = trials.planes[number]
            weights[plane] = weights.get(plane, 0) + complex(trials.weight[number])
        return jc.balancing.with_weights(influence, weights)

    def runs_left_on(self, influence: Influence) -> list[str]:
        """Names of the runs whose trial weights stay on."""
        names = names_of(self.left_on) or []
        if names == ["all"] and influence.trials is not None:
            return list(influence.trials.runs)
        return names

    def method(self, part: Influence, objective: Objective) -> Any:
        """The method of balancing that sets weights where they can go."""
        from ..balancing._weight_places import as_weights

        removed = self._removed(part)
        radii = self._radii(part)
        if self.places is None:
            if not removed and self.radius is None:
                return objective.met
            return lambda system: as_weights(objective.met(system), radii, removed)
        largest = math.inf
        if self.each is not None:
            largest = self._mass(part, self.each, "--each", radii)
        places = {}
        for name, angles in _angles(part, self.places).items():
            places[name] = jc.balancing.Places(
                angles,
                radius=radii.get(name),
                removed=name in removed,
                largest=largest,
            )
        if self.stock is None:
            return lambda system: jc.balancing.placed(system, places)
        masses, counts = self._stock(part, radii)
        return lambda system: jc.balancing.placed(
            system,
            places,
            masses,
            counts=counts,
            per_place=self.per_place,
            most_weights=self.most_weights,
        )

    def _removed(self, part: Influence) -> tuple[str, ...]:
        """Planes in which mass is taken off."""
        names = names_of(self.remove) or []
        if names == ["all"]:
            return part.planes
        for name in names:
            kind = "correction plane of this balance"
            refuse_unknown(f"--remove {name}", name, part.planes, kind)
        return tuple(names)

    def _radii(self, part: Influence) -> dict[str, float]:
        """[m] Radii that are given by plane."""
        if self.radius is None:
            return {}
        refuse(
            part.trial == "kg",
            "--radius: has no meaning where trial weights are masses, at the radius of all weights",
        )
        if "=" not in self.radius:
            value = si(self.radius, "m", "--radius")
            refuse(not value > 0, f"--radius {self.radius}: must be > 0")
            return dict.fromkeys(part.planes, value)
        radii = {}
        for name, text in assignments(listed(self.radius), "--radius").items():
            kind = "correction plane of this balance"
            refuse_unknown(f"--radius {name}", name, part.planes, kind)
            radii[name] = si(text, "m", f"--radius {name}")
            refuse(not radii[name] > 0, f"--radius {name}={text}: must be > 0")
        return radii

    def _stock(
        self, part: Influence, radii: dict[str, float]
    ) -> tuple[list[float], list[int] | None]:
        """Masses of the stock, and how many there are of each; `None` for any number."""
        masses = []
        counts = []
        for text in listed(self.stock or ""):
            match = _PIECES.fullmatch(text)
            refuse(match is None, f"--stock {text}: must be a mass, or a number of it as in 4x10g")
            if match is not None:
                counts.append(int(match[1]) if match[1] else None)
                masses.append(self._mass(part, match[2], "--stock", radii))
        refuse(not masses, "--stock: needs at least one mass, such as 5g,10g,20g")
        without_limit = counts.count(None)
        refuse(
            0 < without_limit < len(counts),
            f"--stock {self.stock}: must say of all masses how many there are, or of none",
        )
        if without_limit:
            return masses, None
        return masses, counts

    def _mass(
        self,
        part: Influence,
        text: str,
        option: str,
        radii: dict[str, float],
    ) -> float:
        """[kg] A mass; [kg m] where the planes have no radius."""
        has_radii = part.radius is not None and bool((part.radius > 0).all())
        by_mass = part.trial == "kg" or has_radii or {*radii} >= {*part.planes}
        unit = "kg" if by_mass else "kg m"
        try:
            value = si(text, unit, f"{option} {text}")
        except jc.scene.SceneError:
            needs = "needs --radius for masses where trial weights are masses times radius"
            refuse(not by_mass, f"{option} {text}: {needs}")
            raise
        refuse(not value > 0, f"{option} {text}: must be > 0")
        return value


def balance(
    *,
    machine: Annotated[str | None, typer.Argument(autocompletion=opt.complete_machine)] = None,
    sets: opt.Sets = None,
    planes: str | None = None,
    targets: str | None = None,
    speeds: str | None = None,
    objective: Objective,
    setting: Setting,
    excitation: opt.ExcitationOption = None,
    solver: opt.Solver = "collocation",
    without: str | None = None,
    measured: Path | None = None,
    output: Output,
) -> None:
    r"""Find the masses that balance a machine at its target planes.

    Example: [bold]jaxcomp balance hermetic-68cc --speeds 3000rpm,3600rpm --out result[/bold]

    A file for --measured has a line for each reading: of the initial run, and of a run with a trial
    weight in each plane, which gives the run its name and is taken off again, unless a further column
    "kept" says yes. Corrections count from the initial run. A trial is mass times radius, or a mass
    (trial \[g]) if all weights go to one radius; phase and angle are both measured in the direction of
    rotation (or both against it). A run named "run-out" at low speed is taken off all other readings; a
    column "weight" says how much a reading counts. A column "plane" names the plane of a run, of which
    it may then have several. Without a column "phase" each plane takes two trial positions at least,
    three to leave no choice.

    Weights of --places and --stock are the best of all combinations; where these are too many to prove
    it, a note says so.

        run,target,speed \[rpm],amplitude \[mm/s],phase \[deg],trial \[g mm],angle \[deg]
        initial,bearing-1,3000,7.2,238,,
        plane-1,bearing-1,3000,4.9,114,120,0

    Args:
        machine: Bundled machine or machine file with a rotor; none with --measured.
        planes (A,B): Correction planes; all if absent.
        targets (A,B): Target planes; all if absent.
        speeds (SPEEDS): Speeds, e.g. 3000rpm,3600rpm or 3000rpm:3600rpm:7; the machine's if absent.
        method: Weighted sum of squares, or the largest vibration.
        tikhonov: Penalty on the masses, 0 for none; least squares only.
        largest (U): Bound of every correction, e.g. '800 g mm', or of single planes, e.g.
            'rotor-top=500 g mm, counterweight=300 g mm'.
        limit (V): Find the least masses that keep every vibration at or below this, e.g. 5um.
        weights (TARGET=W): How much the readings of a target count, e.g. TP5=2; 1 if absent.
            Repeatable.
        places (P): Where weights can go, in all planes or of single ones: a number of even places, or
            angles, e.g. 16, 'fan=12 from 10deg' or 'rear=0deg,90deg,200deg'. Repeatable.
        stock (M,M): Weights that there are, e.g. 5g,10g,20g, or with their numbers 4x5g,2x10g for
            all planes; of any mass if absent.
        most_weights: Weights of the stock in one plane.
        per_place: Weights of the stock in one place.
        each (M): Largest mass in one place, without --stock.
        radius (R): Of the weights in all planes, e.g. 120mm, or of single planes, e.g.
            'fan=120 mm, rear=90 mm'; those of the machine's planes if absent.
        remove (A,B): Planes in which mass is taken off, as by drilling; all for every plane.
        left_on (A,B): Runs whose trial weights stay on, with --measured; all for every one.
        without (A,B): Leave gas, inertia, friction or fluctuation out of the forces of the crank.
        measured: CSV of an initial run and one run with a trial weight per plane.
    """
    refuse(
        (machine is None) == (measured is None),
        "balance: needs either a machine or --measured FILE",
    )
    for option, value in (("--set", sets), ("--speeds", speeds)):
        refuse(measured and value, f"{option}: has no meaning with --measured")
    refuse(without and excitation == "file", _NEEDS_CRANK)
    objective.check(planes, measured)
    setting.check(objective)
    from .._core.status import SolveFailed

    start_jax(once=True)
    with waiting():
        scene = None
        crank = {}
        shaken_by = "measured"
        if measured is not None:
            from ..scene.measurements import read_measurements

            name = measured.name
            influence = read_measurements(measured)
        else:
            scene = changed_scene(str(machine), sets)
            name = scene.name
            shaken_by = chosen_excitation(scene, excitation)
            crank = {"crank": shaken_by == "crank", "left_out": tuple(names_of(without) or ())}
            refuse(without and not crank["crank"], _NEEDS_CRANK)
            at = _speeds(scene, speeds)
            method = opt.chosen_solver(solver, scene)
            influence = jc.balancing.machine_influence(scene, at, method, **crank)
        selection = {"planes": names_of(planes), "targets": names_of(targets)}
        influence = setting.with_trials_left_on(influence)
        part = _weighted(jc.balancing.select(influence, **selection), objective.weights)
        if scene is not None and objective.method == "classical":
            needs = "--method classical: needs a machine with two correction planes"
            refuse(len(influence.planes) != 2, needs)
            solution = jc.balancing.balance_rotor_alone(part, scene, **crank)
        else:
            solution = jc.balancing.balance_each(part, setting.method(part, objective))
        if not bool(solution.converged) and not setting.places:
            raise SolveFailed(
                solution.status, f"gap to the proven optimum {float(solution.gap):.1e}"
            )
    metadata = {"machine": name, "version": version("jaxcomp"), "excitation": shaken_by}
    if setting.left_on is not None:
        metadata["left_on"] = setting.runs_left_on(influence)

    def pictures():
        from ..plot._vibration import balance_figures

        return balance_figures(solution, name)

    written = "Report, pictures, curves and result"
    if machine:
        written = "Report, pictures, curves, machine file and result"
    output.emit(
        solution,
        balance_tables,
        pictures,
        scene,
        {"balance": solution.columns},
        written,
        metadata=metadata,
    )


def _angles(part: Influence, texts: Sequence[str]) -> dict[str, Sequence[float]]:
    """[rad] Angles of the places by plane."""
    angles: dict[str, Sequence[float]] = {}
    for text in texts:
        name, equals, places = split_at("=", text)
        planes = [name]
        if equals:
            kind = "correction plane of this balance"
            refuse_unknown(f"--places {name}", name, part.planes, kind)
        else:
            planes = part.planes
            places = text.strip()
        for plane in planes:
            refuse(plane in angles, f"--places {text}: the places of {plane} are given twice")
            angles[plane] = _places_of(places, f"--places {text}")
    return angles


def _places_of(text: str, option: str) -> list[float]:
    """[rad] Angles of even places, or of those that are listed."""
    even = _EVEN_PLACES.fullmatch(text)
    if even is None:
        form = f"{option}: must be a number of places, or angles such as 0deg,90deg"
        try:
            return [si(angle, "rad", option) for angle in with_one_unit(listed(text))]
        except (jc.scene.SceneError, IndexError) as error:
            raise CommandError(form) from error
    count = int(even[1])
    refuse(not 1 <= count <= _MOST_PLACES, f"{option}: must be from 1 to {_MOST_PLACES} places")
    start = 0.0
    if even[2]:
        start = si(even[2], "rad", option)
    return [start + 2 * math.pi * place / count for place in range(count)]


def _speeds(scene: jc.scene.Scene, speeds: str | None):
    """[rad/s] Speeds at which a machine with a rotor, planes and loads is balanced."""
    import jax.numpy as jnp

    rotor_of(scene)
    for part in ("balancing", "loads"):
        refuse(part not in scene.parts, f"{scene.file}: {part}: is missing; `balance` needs it")
    if speeds:
        return jnp.asarray(speeds_of(speeds))
    return jnp.asarray(scene_speeds(scene))


def _weighted(part: Influence, texts: Sequence[str] | None) -> Influence:
    """The system with the weights of `--weight` on its readings."""
    targets = sorted({row.target for row in part.rows})
    weights = {}
    for target, text in assignments(texts, "--weight").items():
        refuse_unknown(f"--weight {target}", target, targets, "target")
        weights[target] = si(text, "", f"--weight {target}")
        refuse(not weights[target] >= 0, f"--weight {target}={text}: must be >= 0")
    return jc.balancing.select(part, weights=weights)


def _largest(part: Influence, text: str) -> Any:
    """[kg m] A bound of all corrections, or of those that are named."""
    from ..scene._units import to_si

    if "=" not in text:
        return float(to_si(text, part.trial, "--largest"))
    bounds = {}
    for plane, bound in assignments(list(map(str.strip, text.split(","))), "--largest").items():
        kind = "correction plane of this balance"
        refuse_unknown(f"--largest {plane}", plane, part.planes, kind)
        bounds[plane] = si(bound, part.trial, f"--largest {plane}")
    return bounds


def _limit(part: Influence, text: str) -> float:
    """The limit in the unit of the vibration; a bare number where that is of no known unit."""
    from ..scene._units import to_si

    unit = part.unit
    if unit in ("um", "µm"):
        unit = "m"
    with suppress(jc.scene.SceneError):
        return float(to_si(text, unit, "--limit"))
    with suppress(ValueError):
        return float(text)
    raise CommandError(f"--limit {text}: must be a vibration in {part.unit}")


def balance_tables(result: dict[str, Any]) -> Iterator[Any]:
    """Corrections, vibration before and after, quality of the balance."""
    unit, factor = small_unit(result["correction_unit"])
    yield _corrections(result, unit, factor)
    if result.get("left_on"):
        runs = escape(", ".join(result["left_on"]))
        yield f"They count with the trial weights left on of {runs}; so does the vibration before."
    yield from _weights(result, unit, factor)
    verdict = escape(result["verdict"])
    if result["worse"]:
        verdict = f"[yellow]Note:[/yellow] {verdict}"
    yield verdict
    yield from _alternatives(result)
    yield _vibration(result)
    yield from _quality(result)


def _corrections(result: dict[str, Any], unit: str, factor: float):
    """The correction of each plane, with radius and mass where a plane has a radius."""
    planes = result["planes"]
    has_radii = any(plane["radius"] for plane in planes)
    rows = []
    for plane in planes:
        row = {
            "Plane": plane["name"],
            unit: rounded(plane["correction"] * factor, 4),
            "°": f"{math.degrees(plane['phase']):.1f}",
        }
        if has_radii:
            row["mm"] = _milli(plane["radius"])
            row["g"] = _milli(plane["mass"])
        rows.append(row)
    return column_table(f"{result['machine']}: corrections to add", by_column(rows))


def _vibration(result: dict[str, Any]):
    """Vibration of every target, before and after."""
    unit, factor = vibration_unit(result["vibration_unit"])
    rows = []
    previous_target = None
    for row in result["rows"]:
        before = row["before"]
        after = row["after"]
        target = row["target"]
        rows.append(
            (
                "" if target == previous_target else target,
                row["axis"],
                row["speed"] * RPM,
                rounded(before * factor, 3),
                rounded(_unless_rounding(after, before) * factor, 3),
                percent_text(after, before, ".0f"),
                math.hypot(*row["sensitivity"].values()) * factor,
            )
        )
        previous_target = target
    title = f"Vibration at order 1, {unit}; ±: with 1 % and 1° of error in every plane"
    heads = ("Target", "Axis", ("rpm", ".5g"), "Before", "After", "Share", ("±", ".2g"))
    return row_table(title, heads, rows, unbroken=(0,))


def _unless_rounding(size: float, before: float) -> float:
    """A size; 0 where it is rounding beside the one before."""
    if size > _NOTHING * before:
        return size
    return 0.0


def _quality(result: dict[str, Any]) -> Iterator[Any]:
    """Method, condition and distance from the optimum, and how well amplitudes fit."""
    condition = "infinite"
    if result["condition"] is not None:
        condition = f"{result['condition']:.4g}"
    over = "sum" if result["method"] == "least masses" else "rms before"
    rows = (
        ("Method", result["method"], f"excitation: {result['excitation']}"),
        ("Weighted rms", f"{100 * result['improvement']:.3g} %", "after over before, all rows"),
        ("Condition", condition, "of the weighted system"),
        ("Gap", f"{result['gap']:.1e}", f"to the proven optimum, over the {over}"),
    )
    if "misfit" in result:
        misfit = f"{100 * result['misfit']:.3g} %"
        if result["misfit"] > _LARGE_MISFIT:
            yield (
                f"[yellow]Note:[/yellow] the amplitudes miss the corrections by {misfit}: a reading is "
                "wrong, the machine is not linear, or the weights were in several planes, which a "
                'column "plane" names.'
            )
        rows = (*rows, ("Misfit", misfit, "of the amplitudes without phase, over those before"))
    yield row_table(None, ("Quality", "", ""), rows, texts=3)


def _milli(value: float | None) -> Any:
    """A radius [m] in mm, or a mass [kg] in g; what is unknown or zero stays as it is."""
    return value and f"{value * 1e3:.4g}"


def _weights(result: dict[str, Any], unit: str, factor: float) -> Iterator[Any]:
    """Weights at their places, and whether they are the best of all combinations."""
    weights = result.get("weights")
    if weights is None:
        return
    if not weights:
        yield "No weights: every one that can be set makes it worse."
        return
    rows = []
    for weight in weights:
        size = weight["unbalance"]
        mass = weight["mass"]
        row = {
            "Plane": weight["name"],
            "": "take off" if weight["removed"] else "add",
            "°": f"{math.degrees(weight['phase']) % 360:.1f}",
            unit: size and rounded(size * factor, 4),
            "g": _milli(mass),
        }
        if unit == "g":
            row["g"] = rounded(mass * factor, 4)
        rows.append(row)
    yield column_table("Weights to set", by_column(rows), texts=2)
    if result["certified"]:
        if "stock" in result["method"]:
            yield "Proven: no other combination of these weights leaves less."
        return
    share = 100 * result["bound"] / result["objective"]
    yield (
        "[yellow]Note:[/yellow] not proven to be the best of all combinations, which are too many; none "
        f"leaves less than {share:.3g} % of what this one leaves."
    )


def _alternatives(result: dict[str, Any]) -> Iterator[Any]:
    """The other corrections that fit readings without phase, and the run that decides."""
    alternatives = result.get("alternatives")
    if not alternatives:
        return
    unit, factor = small_unit(result["correction_unit"])
    sides = [{"planes": result["planes"], "improvement": result["improvement"]}, *alternatives]
    rows = []
    for number, side in enumerate(sides[:_SHOWN], 1):
        remaining_share = _unless_rounding(side["improvement"], 1.0)
        # the number and the share stand in the row of the first plane alone
        label = str(number)
        share_text = f"{100 * remaining_share:.3g} %"
        for plane in side["planes"]:
            correction = rounded(plane["correction"] * factor, 4)
            angle = f"{math.degrees(plane['phase']):.1f}"
            rows.append((label, plane["name"], correction, angle, share_text))
            label = share_text = ""
    yield (
        f"[yellow]Note:[/yellow] {len(sides)} corrections fit the amplitudes, because without phase "
        "each reading has a mirror image. Set the first; if the vibration does not fall as foretold, "
        "set the next one."
    )
    yield row_table(None, ("No.", "Plane", unit, "°", "Rms left"), rows, texts=2)
    if len(sides) > _SHOWN:
        yield f"{len(sides) - _SHOWN} more are in --json."
    trial = result["further_trial"]
    vibration, vibration_factor = vibration_unit(result["vibration_unit"])
    levels = (rounded(value * vibration_factor, 3) for value in trial["expected"][:_SHOWN])
    yield escape(
        f"A run with {rounded(trial['trial'] * factor, 4)} {unit} at "
        f"{math.degrees(trial['phase']) % 360:.0f}° in {trial['plane']} tells them apart: "
        f"{trial['target']} would read {' or '.join(levels)} {vibration}, in the order above."
    )
