"""What `jaxcomp balance` solves and shows."""

import dataclasses
import math
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from rich.markup import escape
from rich.table import Table

from .._shown import RPM, rounded, small_unit
from .._status import SolveFailed, Status
from ..balancing import (
    Balance,
    Influence,
    PlanePair,
    bounded,
    classical_balance,
    least_masses,
    least_squares,
    machine_influence,
    min_max,
    predicted,
    rod_ring,
    select,
)
from ..rotor import BalancingPlanes, LoadCase
from ..scene import Scene, SceneError, did_you_mean, to_si
from ..scene.measurements import read_measurements
from ._arguments import assignments, entry
from ._errors import CommandError
from ._tables import _table


class System(NamedTuple):
    """What is to be balanced.

    Attributes:
        name: of the machine or file.
        influence: the system.
        radius: [m] by plane, where one is known.
        excitation: what shakes the machine.
        rotor_alone: corrections of the rotor alone with their permissible rest, of a scene with two
            planes.
        ringed: whether that rotor carried a ring for the rotating part of the rod.
        scene: that it was made from; `None` for measurements.
    """

    name: str
    influence: Influence
    radius: dict[str, float]
    excitation: str
    rotor_alone: PlanePair | None = None
    ringed: bool = False
    scene: Scene | None = None


def measured_system(path: Path) -> System:
    """From a CSV file."""
    return System(path.name, read_measurements(path), {}, "measured")


def model_system(
    name: str | None,
    sets: Sequence[str],
    speeds: str | None,
    crank: bool,
    left_out: Sequence[str] = (),
) -> System:
    """From a scene with a rotor and balancing planes; `left_out` of the crank's forces.

    Raises:
        CommandError: no planes, no loads, or no crank forces to take.
    """
    from ._arguments import changed_scene
    from ._rotor import rotor_of, scene_speeds, speeds_of

    scene = changed_scene(str(name), sets, ())
    model = rotor_of(scene)
    places, case = (scene.parts.get(part) for part in ("balancing", "loads"))
    if not isinstance(places, BalancingPlanes):
        raise CommandError(f"{scene.file}: balancing: is missing; `balance` needs it")
    if not isinstance(case, LoadCase):
        raise CommandError(f"{scene.file}: loads: is missing; `balance` needs it")
    at = speeds_of(speeds) if speeds else scene_speeds(scene)
    if crank and case.crank is None:
        raise CommandError(f"{scene.file}: loads.crank: is missing; --excitation crank needs it")
    influence = machine_influence(scene, jnp.asarray(at), crank=crank, left_out=tuple(left_out))
    radius = {
        plane.name: float(plane.radius) for plane in places.planes if plane.radius is not None
    }
    alone = None
    # A ring stands for a load that acts: the forces of the file are without the inertia of the rod.
    ring = rod_ring(scene.assembly) if crank and "inertia" not in left_out else None
    if len(places.planes) == 2:
        alone = classical_balance(model, case.unbalances, places, speed=max(at), ring=ring)
    word = "crank" if crank else "file"
    return System(scene.name, influence, radius, word, alone, ring is not None, scene)


class Asked(NamedTuple):
    """What is asked of a balance: the options of the command as they were typed."""

    planes: Sequence[str] | None
    targets: Sequence[str] | None
    method: str
    tikhonov: float
    largest: str | None
    limit: str | None
    weights: tuple[str, ...]


def solve(system: System, asked: Asked) -> Balance:
    """Balance the chosen part of a system.

    Raises:
        CommandError: no two planes for the rotor alone, or an option that cannot be read.
        SolveFailed: the method did not converge, or no corrections reach the limit.
    """
    found = _solve(system, asked)
    if not bool(found.converged):
        raise SolveFailed(found.status, f"gap to the proven optimum {float(found.gap):.1e}")
    return found


def _solve(system: System, asked: Asked) -> Balance:
    part = _weighted(select(system.influence, planes=asked.planes, targets=asked.targets), asked)
    largest = None if asked.largest is None else _largest(part, asked.largest)
    if asked.limit is not None:
        radii = [system.radius.get(plane) for plane in part.planes]
        cost = None if None in radii else 1 / np.array(radii, float)
        return least_masses(part, _limit(part, asked.limit), cost=cost, largest=largest)
    if asked.method == "classical":
        if system.rotor_alone is None:
            raise CommandError("--method classical: needs a scene with two correction planes")
        name = "rotor with a ring for the rod" if system.ringed else "rotor alone"
        return predicted(part, system.rotor_alone.correction, f"{name}, two planes")
    if asked.method == "min-max":
        return min_max(part)
    if largest is not None:
        return bounded(part, largest)
    return least_squares(part, tikhonov=asked.tikhonov)


def _weighted(part: Influence, asked: Asked) -> Influence:
    """The system with the weights of `--weight` on its readings."""
    weight = np.array(part.weight)
    known = sorted({row.target for row in part.rows})
    for target, text in assignments(asked.weights, "--weight").items():
        if target not in known:
            raise CommandError(f"--weight {target}: is no target{did_you_mean(target, known)}")
        value = float(to_si(entry(text), "", f"--weight {target}"))
        if not value >= 0:
            raise CommandError(f"--weight {target}={text}: must be >= 0")
        weight[[row.target == target for row in part.rows]] *= value
    return dataclasses.replace(part, weight=jnp.asarray(weight))


def _largest(part: Influence, text: str) -> np.ndarray:
    """Bounds of all corrections; a plane that is not named is bounded by a thousand times their sum."""
    if "=" not in text:
        return np.full(len(part.planes), float(to_si(text, part.trial, "--largest")))
    given = assignments([one.strip() for one in text.split(",")], "--largest")
    for plane in given:
        if plane not in part.planes:
            hint = did_you_mean(plane, part.planes)
            raise CommandError(f"--largest {plane}: is no correction plane of this balance{hint}")
    bounds = {name: float(to_si(entry(one), part.trial, f"--largest {name}"))
              for name, one in given.items()}  # fmt: skip
    free = 1e3 * (sum(bounds.values()) + float(np.abs(least_squares(part).correction).max()))
    return np.array([bounds.get(plane, free) for plane in part.planes])


def _limit(part: Influence, text: str) -> float:
    """The limit in the unit of the vibration."""
    units = {"um": "m", "µm": "m"}
    try:
        return float(to_si(text, units.get(part.unit, part.unit), "--limit"))
    except SceneError:
        try:
            return float(text)  # readings of no known unit
        except ValueError:
            raise CommandError(f"--limit {text}: must be a vibration in {part.unit}") from None


def balance_result(system: System, found: Balance) -> dict[str, Any]:
    """The balance in numbers. The keys are stable; new ones may join them."""
    part = found.influence
    before, after = np.asarray(part.initial), np.asarray(found.residual)
    spread = np.asarray(found.sensitivity())
    condition = float(found.condition)
    planes = []
    for name, value in zip(part.planes, np.asarray(found.correction), strict=True):
        radius = system.radius.get(name)
        if part.trial == "kg":
            unbalance, mass = None, abs(value)
        else:
            unbalance, mass = abs(value), None if radius is None else abs(value) / radius
        planes.append(
            {
                "name": name,
                "correction": abs(value),
                "unbalance": unbalance,
                "phase": float(np.angle(value)),
                "radius": radius,
                "mass": mass,
            }
        )
    rows = [
        {
            "target": row.target,
            "axis": row.axis,
            "speed": row.speed,
            "weight": float(weight),
            "before": abs(b),
            "before_phase": float(np.angle(b)),
            "after": abs(a),
            "after_phase": float(np.angle(a)),
            "sensitivity": dict(zip(part.planes, map(float, s), strict=True)),
        }
        for row, weight, b, a, s in zip(
            part.rows, np.asarray(part.weight), before, after, spread, strict=True
        )
    ]
    return {
        "machine": system.name,
        "version": version("jaxcomp"),
        "method": found.method,
        "excitation": system.excitation,
        "vibration_unit": part.unit,
        "correction_unit": part.trial,
        "planes": planes,
        "rows": rows,
        "worse": int(np.sum(found.worse)),
        "improvement": float(found.improvement),
        "condition": condition if math.isfinite(condition) else None,
        "objective": float(found.objective),
        "bound": float(found.bound),
        "gap": float(found.gap),
        "status": Status[found.status],
    }


# [-] Of the vibration before: what is left below this is rounding.
_NOTHING = 1e-9


def shown(result: dict[str, Any]) -> tuple[str, float]:
    """Unit of the vibration in tables and pictures, and its factor."""
    unit = result["vibration_unit"]
    return ("µm", 1e6) if unit == "m" else (unit, 1.0)


def worse_sentence(result: dict[str, Any]) -> str:
    """What gets worse, with the one that does so most."""
    unit, factor = shown(result)
    rows = [row for row in result["rows"] if row["after"] > row["before"]]
    if not rows:
        return "No reading gets worse."
    most = max(rows, key=lambda row: row["after"] - row["before"])
    ends = f"{rounded(most['before'] * factor, 3)} to {rounded(most['after'] * factor, 3)} {unit}"
    return (
        f"[yellow]Note:[/yellow] {len(rows)} of {len(result['rows'])} readings get worse; most of all "
        f"{escape(most['target'])} {most['axis']} at {most['speed'] * RPM:.5g} rpm, from {ends}."
    )


def balance_tables(result: dict[str, Any]) -> list[Table | str]:
    """Corrections, vibration before and after, evidence."""
    unit, factor = small_unit(result["correction_unit"])
    with_radius = any(plane["radius"] is not None for plane in result["planes"])
    masses = _table(
        escape(f"{result['machine']}: corrections to add"),
        *("Plane", unit, "°"),
        *(("mm", "g") if with_radius else ()),
        numbers=True,
    )
    for plane in result["planes"]:
        size, place = plane["correction"] * factor, math.degrees(plane["phase"])
        row = [escape(plane["name"]), rounded(size, 4), f"{place:.1f}"]
        if with_radius:
            radius, mass = plane["radius"], plane["mass"]
            row.append("" if radius is None else f"{radius * 1e3:.4g}")
            row.append("" if mass is None else f"{mass * 1e3:.4g}")
        masses.add_row(*row)
    unit, factor = shown(result)
    rows = _table(
        escape(f"Vibration at order 1, {unit}; ±: with 1 % and 1° of error in every plane"),
        "Target",
        "Axis",
        "rpm",
        "Before",
        "After",
        "Share",
        "±",
        numbers=True,
    )
    rows.columns[0].no_wrap = True
    last = None
    for row in result["rows"]:
        spread = math.sqrt(sum(s**2 for s in row["sensitivity"].values()))
        rows.add_row(
            escape(row["target"]) if row["target"] != last else "",
            row["axis"],
            f"{row['speed'] * RPM:.5g}",
            rounded(row["before"] * factor, 3),
            rounded(row["after"] * factor if row["after"] > _NOTHING * row["before"] else 0.0, 3),
            f"{100 * row['after'] / row['before']:.0f} %" if row["before"] else "",
            f"{spread * factor:.2g}",
        )
        last = row["target"]
    evidence = _table(None, "Evidence", "", "")
    evidence.add_row("Method", result["method"], f"excitation: {result['excitation']}")
    share = f"{100 * result['improvement']:.3g} %"
    evidence.add_row("Weighted rms", share, "after over before, all rows")
    condition = result["condition"]
    text = "infinite" if condition is None else f"{condition:.4g}"
    evidence.add_row("Condition", text, "of the weighted system")
    over = "sum" if result["method"] == "least masses" else "rms before"
    evidence.add_row("Gap", f"{result['gap']:.1e}", f"to the proven optimum, over the {over}")
    return [masses, worse_sentence(result), rows, evidence]
