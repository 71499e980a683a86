"""`jaxcomp balance`: correction masses, from the model of a machine or from measurements."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.markup import escape

import jaxcomp as jc

from .._shown import RPM, rounded, small_unit
from ._arguments import assignments, changed_scene, entry
from ._completion import complete_machine
from ._errors import CommandError, reports_errors
from ._json import plain
from ._options import AsJson, Excitation, ExcitationOption, Out, Sets
from ._output import hand_out
from ._rotor import chosen_excitation, rotor_of, scene_speeds, speeds_of
from ._start import start_jax
from ._tables import column_table, row_table


class Method(enum.StrEnum):
    """Objective of the balance; `classical` balances the rotor alone, as a balancing machine does.

    With the crank's forces it carries a ring for the rotating part of the rod, which is among them.
    """

    least_squares = "least-squares"
    min_max = "min-max"
    classical = "classical"


@reports_errors
def balance(
    machine: Annotated[
        str | None,
        typer.Argument(
            help="Bundled machine or scene file with a rotor; none with --measured.",
            autocompletion=complete_machine,
        ),
    ] = None,
    sets: Sets = None,
    planes: Annotated[
        str | None, typer.Option(metavar="A,B", help="Correction planes; all if absent.")
    ] = None,
    targets: Annotated[
        str | None, typer.Option(metavar="A,B", help="Target planes; all if absent.")
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(
            metavar="SPEEDS",
            help="Speeds, e.g. 3000rpm,3600rpm or 3000rpm:3600rpm:7; the scene's if absent.",
        ),
    ] = None,
    method: Annotated[
        Method, typer.Option(help="Weighted sum of squares, or the largest vibration.")
    ] = Method.least_squares,
    tikhonov: Annotated[
        float, typer.Option(help="Penalty on the masses, 0 for none; least squares only.")
    ] = 0.0,
    largest: Annotated[
        str | None,
        typer.Option(
            metavar="U",
            help="Bound of every correction, e.g. '800 g mm', or of single planes, e.g. "
            "'rotor-top=500 g mm, counterweight=300 g mm'.",
        ),
    ] = None,
    limit: Annotated[
        str | None,
        typer.Option(
            metavar="V",
            help="Find the least masses that keep every vibration at or below this, e.g. 5um.",
        ),
    ] = None,
    weights: Annotated[
        list[str] | None,
        typer.Option(
            "--weight",
            metavar="TARGET=W",
            help="How much the readings of a target count, e.g. TP5=2; 1 if absent. Repeatable.",
        ),
    ] = None,
    excitation: ExcitationOption = None,
    without: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Leave gas, inertia, friction or fluctuation out of the forces of the crank.",
        ),
    ] = None,
    measured: Annotated[
        Path | None,
        typer.Option(help="CSV of an initial run and one run with a trial weight per plane."),
    ] = None,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    r"""Find the masses that balance a machine at its target planes.

    Example: [bold]jaxcomp balance hermetic-68cc --speeds 3000rpm,3600rpm --out result[/bold]

    A file for --measured has a line for each reading: of the initial run, and of a run with a trial
    weight in each plane, which gives the run its name and is taken off again, unless a further column
    "kept" says yes. Corrections count from the initial run. A trial is mass times radius, or a mass
    (trial \[g]) if all weights go to one radius; phase and angle are both measured in the direction of
    rotation (or both against it). A run named "run-out" at low speed is taken off all other readings; a
    column "weight" says how much a reading counts.

        run,target,speed \[rpm],amplitude \[mm/s],phase \[deg],trial \[g mm],angle \[deg]
        initial,bearing-1,3000,7.2,238,,
        plane-1,bearing-1,3000,4.9,114,120,0
    """
    if (machine is None) == (measured is None):
        raise CommandError("balance: needs either a machine or --measured FILE")
    given = {"--set": sets, "--speeds": speeds}
    if measured is not None and any(given.values()):
        name = next(option for option, value in given.items() if value)
        raise CommandError(f"{name}: has no meaning with --measured")
    if without and excitation is Excitation.file:
        raise CommandError("--without: needs --excitation crank")
    if method is Method.classical and (tikhonov or largest or planes or measured or limit):
        raise CommandError(
            "--method classical: takes no --planes, --tikhonov, --largest, --limit or --measured; it "
            "balances the rotor of a scene in both planes"
        )
    if method is Method.min_max and (tikhonov or largest):
        raise CommandError("--method min-max: takes neither --tikhonov nor --largest")
    if tikhonov and largest:
        raise CommandError("--largest: takes no --tikhonov beside it")
    if limit and (tikhonov or method is not Method.least_squares or weights):
        raise CommandError("--limit: takes no --method, --tikhonov or --weight beside it")
    from .._status import SolveFailed
    from .._waits import spinner

    start_jax(once=True)
    with spinner("Solving (the first time it is compiled as well) ..."):
        if measured is not None:
            from ..scene.measurements import read_measurements

            system = System(measured.name, read_measurements(measured), {}, "measured")
        else:
            scene = changed_scene(str(machine), sets or (), ())
            crank = chosen_excitation(scene, excitation) is Excitation.crank
            if without and not crank:
                raise CommandError("--without: needs --excitation crank")
            system = model_system(scene, speeds, crank, _names(without) or ())
        part = jc.balancing.select(system.influence, planes=_names(planes), targets=_names(targets))
        part = _weighted(part, weights or ())
        found = _balanced(system, part, method, tikhonov, largest, limit)
        if not bool(found.converged):
            raise SolveFailed(found.status, f"gap to the proven optimum {float(found.gap):.1e}")
        result = balance_result(system, found)

    def figures():
        return jc.plot.balance_figures(found, system.name)

    curves = None if out is None else {"balance": found.columns()}
    written = f"Report, pictures, curves{', scene' if machine else ''} and result"
    tables = balance_tables(result)
    hand_out(result, tables, as_json, out, figures, system.scene, curves, written)


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


class System(NamedTuple):
    """A system that is balanced.

    Attributes:
        name: of the machine or file.
        influence: its coefficients.
        radius: [m] by plane, where one is known.
        excitation: "file", "crank" or "measured".
        rotor_alone: corrections of the rotor alone with their permissible residual unbalance, of a
            scene with two planes.
        ringed: whether that rotor carried a ring for the rotating part of the rod.
        scene: that it was made from; `None` for measurements.
    """

    name: str
    influence: jc.balancing.Influence
    radius: dict[str, float]
    excitation: str
    rotor_alone: jc.balancing.PlanePair | None = None
    ringed: bool = False
    scene: jc.scene.Scene | None = None


def model_system(
    scene: jc.scene.Scene, speeds: str | None, crank: bool, left_out: Sequence[str] = ()
) -> System:
    """From a scene with a rotor and balancing planes; `left_out` of the crank's forces.

    Raises:
        CommandError: no planes, no loads, or no crank forces to take.
    """
    import jax.numpy as jnp

    model = rotor_of(scene)
    places, case = (scene.parts.get(part) for part in ("balancing", "loads"))
    if not isinstance(places, jc.rotor.BalancingPlanes):
        raise CommandError(f"{scene.file}: balancing: is missing; `balance` needs it")
    if not isinstance(case, jc.rotor.LoadCase):
        raise CommandError(f"{scene.file}: loads: is missing; `balance` needs it")
    at = speeds_of(speeds) if speeds else scene_speeds(scene)
    influence = jc.balancing.machine_influence(
        scene, jnp.asarray(at), crank=crank, left_out=tuple(left_out)
    )
    radius = {
        plane.name: float(plane.radius) for plane in places.planes if plane.radius is not None
    }
    # A ring stands for a load that acts: the forces of the file are without the inertia of the rod.
    ring = jc.balancing.rod_ring(scene.assembly) if crank and "inertia" not in left_out else None
    alone = None
    if len(places.planes) == 2:
        alone = jc.balancing.classical_balance(
            model, case.unbalances, places, speed=max(at), ring=ring
        )
    excitation = "crank" if crank else "file"
    return System(scene.name, influence, radius, excitation, alone, ring is not None, scene)


def _balanced(
    system: System,
    part: jc.balancing.Influence,
    method: Method,
    tikhonov: float,
    largest: str | None,
    limit: str | None,
) -> jc.balancing.Balance:
    """The balance of the chosen part of a system.

    Raises:
        CommandError: no two planes for the rotor alone, or an option that cannot be read.
    """
    import numpy as np

    bounds = None if largest is None else _largest(part, largest)
    if limit is not None:
        radii = [system.radius.get(plane) for plane in part.planes]
        cost = None if None in radii else 1 / np.array(radii, float)
        return jc.balancing.least_masses(part, _limit(part, limit), cost=cost, largest=bounds)
    if method is Method.classical:
        if system.rotor_alone is None:
            raise CommandError("--method classical: needs a scene with two correction planes")
        name = "rotor with a ring for the rod" if system.ringed else "rotor alone"
        return jc.balancing.predicted(part, system.rotor_alone.correction, f"{name}, two planes")
    if method is Method.min_max:
        return jc.balancing.min_max(part)
    if bounds is not None:
        return jc.balancing.bounded(part, bounds)
    return jc.balancing.least_squares(part, tikhonov=tikhonov)


def _weighted(part: jc.balancing.Influence, weights: Sequence[str]) -> jc.balancing.Influence:
    """The system with the weights of `--weight` on its readings."""
    import numpy as np

    weight = np.array(part.weight)
    known = sorted({row.target for row in part.rows})
    for target, text in assignments(weights, "--weight").items():
        if target not in known:
            hint = jc.scene.did_you_mean(target, known)
            raise CommandError(f"--weight {target}: is no target{hint}")
        value = float(jc.scene.to_si(entry(text), "", f"--weight {target}"))
        if not value >= 0:
            raise CommandError(f"--weight {target}={text}: must be >= 0")
        weight[[row.target == target for row in part.rows]] *= value
    return dataclasses.replace(part, weight=weight)


def _largest(part: jc.balancing.Influence, text: str):
    """Bounds of all corrections; a plane that is not named is bounded by a thousand times their sum."""
    import numpy as np

    if "=" not in text:
        return np.full(len(part.planes), float(jc.scene.to_si(text, part.trial, "--largest")))
    given = assignments([one.strip() for one in text.split(",")], "--largest")
    for plane in given:
        if plane not in part.planes:
            hint = jc.scene.did_you_mean(plane, part.planes)
            raise CommandError(f"--largest {plane}: is no correction plane of this balance{hint}")
    bounds = {
        name: float(jc.scene.to_si(entry(one), part.trial, f"--largest {name}"))
        for name, one in given.items()
    }
    most = float(np.abs(jc.balancing.least_squares(part).correction).max())
    free = 1e3 * (sum(bounds.values()) + most)
    return np.array([bounds.get(plane, free) for plane in part.planes])


def _limit(part: jc.balancing.Influence, text: str) -> float:
    """The limit in the unit of the vibration."""
    units = {"um": "m", "µm": "m"}
    try:
        return float(jc.scene.to_si(text, units.get(part.unit, part.unit), "--limit"))
    except jc.scene.SceneError:
        try:
            return float(text)  # readings of no known unit
        except ValueError:
            raise CommandError(f"--limit {text}: must be a vibration in {part.unit}") from None


def balance_result(system: System, found: jc.balancing.Balance) -> dict[str, Any]:
    """The balance in numbers. The keys are stable; new ones may join them."""
    import numpy as np

    from .._status import Status

    part = found.influence

    def plane(name, value):
        radius, size, by_mass = system.radius.get(name), abs(value), part.trial == "kg"
        return {
            "name": name,
            "correction": size,
            "unbalance": None if by_mass else size,
            "phase": np.angle(value),
            "radius": radius,
            "mass": size if by_mass else None if radius is None else size / radius,
        }

    def reading(row, weight, before, after, spread):
        return {
            "target": row.target,
            "axis": row.axis,
            "speed": row.speed,
            "weight": weight,
            "before": abs(before),
            "before_phase": np.angle(before),
            "after": abs(after),
            "after_phase": np.angle(after),
            "sensitivity": dict(zip(part.planes, spread, strict=True)),
        }

    readings = (part.weight, part.initial, found.residual, found.sensitivity())
    return plain(
        {
            "machine": system.name,
            "version": version("jaxcomp"),
            "method": found.method,
            "excitation": system.excitation,
            "vibration_unit": part.unit,
            "correction_unit": part.trial,
            "planes": list(map(plane, part.planes, np.asarray(found.correction))),
            "rows": list(map(reading, part.rows, *map(np.asarray, readings))),
            "worse": np.sum(found.worse),
            "improvement": found.improvement,
            "condition": found.condition,
            "objective": found.objective,
            "bound": found.bound,
            "gap": found.gap,
            "status": Status[found.status],
        }
    )


# [-] Of the vibration before: what is left below this is rounding.
_NOTHING = 1e-9


def shown_vibration(result: dict[str, Any]) -> tuple[str, float]:
    """Unit of the vibration in tables, and its factor."""
    unit = result["vibration_unit"]
    return ("µm", 1e6) if unit == "m" else (unit, 1.0)


def worse_sentence(result: dict[str, Any]) -> str:
    """The readings that get worse, with the one that does so most."""
    unit, factor = shown_vibration(result)
    rows = [row for row in result["rows"] if row["after"] > row["before"]]
    if not rows:
        return "No reading gets worse."
    most = max(rows, key=lambda row: row["after"] - row["before"])
    ends = f"{rounded(most['before'] * factor, 3)} to {rounded(most['after'] * factor, 3)} {unit}"
    return (
        f"[yellow]Note:[/yellow] {len(rows)} of {len(result['rows'])} readings get worse; most of all "
        f"{escape(most['target'])} {most['axis']} at {most['speed'] * RPM:.5g} rpm, from {ends}."
    )


def balance_tables(result: dict[str, Any]) -> Iterator[Any]:
    """Corrections, vibration before and after, quality of the balance."""
    unit, factor = small_unit(result["correction_unit"])
    planes = result["planes"]
    radii = [plane["radius"] and f"{plane['radius'] * 1e3:.4g}" for plane in planes]
    masses = [plane["mass"] and f"{plane['mass'] * 1e3:.4g}" for plane in planes]
    yield column_table(
        f"{result['machine']}: corrections to add",
        {
            "Plane": [escape(plane["name"]) for plane in planes],
            unit: [rounded(plane["correction"] * factor, 4) for plane in planes],
            "°": [f"{math.degrees(plane['phase']):.1f}" for plane in planes],
            **({"mm": radii, "g": masses} if any(radii) else {}),
        },
    )
    yield worse_sentence(result)
    unit, factor = shown_vibration(result)
    rows, last = [], None
    for row in result["rows"]:
        before, after = row["before"], row["after"]
        spread = math.hypot(*row["sensitivity"].values())
        rows.append(
            (
                escape(row["target"]) if row["target"] != last else "",
                row["axis"],
                f"{row['speed'] * RPM:.5g}",
                rounded(before * factor, 3),
                rounded(after * factor if after > _NOTHING * before else 0.0, 3),
                f"{100 * after / before:.0f} %" if before else "",
                f"{spread * factor:.2g}",
            )
        )
        last = row["target"]
    title = f"Vibration at order 1, {unit}; ±: with 1 % and 1° of error in every plane"
    table = row_table(title, ("Target", "Axis", "rpm", "Before", "After", "Share", "±"), rows)
    table.columns[0].no_wrap = True
    yield table
    condition = result["condition"]
    over = "sum" if result["method"] == "least masses" else "rms before"
    rows = (
        ("Method", result["method"], f"excitation: {result['excitation']}"),
        ("Weighted rms", f"{100 * result['improvement']:.3g} %", "after over before, all rows"),
        (
            "Condition",
            "infinite" if condition is None else f"{condition:.4g}",
            "of the weighted system",
        ),
        ("Gap", f"{result['gap']:.1e}", f"to the proven optimum, over the {over}"),
    )
    yield row_table(None, ("Quality", "", ""), rows, texts=3)
