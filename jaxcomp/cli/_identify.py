"""`jaxcomp identify`: constants of a machine from its rated points, and the points not measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from .._core.display import shown
from ._arguments import assignments, changed_scene, si
from ._map import axis
from ._options import AsJson, Machine, Out, Sets
from ._output import hand_out, plain
from ._start import CommandError, reports_errors, start_jax, waiting
from ._tables import row_table

Loss = Literal["linear", "soft_l1", "huber"]
# How far a point of --fit-at may lie from one of the data [K].
_SAME = 0.05


@reports_errors
def identify(
    machine: Machine,
    data: Annotated[list[Path], typer.Option()],
    vary: Annotated[list[str], typer.Option()],
    prior: list[str] | None = None,
    sd: list[str] | None = None,
    fit_at: str | None = None,
    hold_out: int = 0,
    evaporating: str | None = None,
    condensing: str | None = None,
    speed: str | None = None,
    loss: Loss = "linear",
    starts: int = 3,
    seed: int = 0,
    sets: Sets = None,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Identify constants of a compressor with valves from its map, and predict the points held out.

    Prints the constants with their standard errors, what cannot be told apart, measured against
    computed, and what is not to be trusted. --out also takes the identified machine, as scene.toml.

    Example: [bold]jaxcomp identify semi-hermetic-200cc map.csv --vary mechanism.bore --vary
    gas.clearance_ratio=1%:10% --prior gas.clearance_ratio=4%+-1% --hold-out 4 --out found[/bold]

    Args:
        data (FILE): CSV of readings, or of a maker's polynomials.
        vary (PATH=LO:HI): Constant and its bounds, half to twice its value if left out; a pattern such as
            gas.*_valve.port_diameter=0.7:1.5 varies a common factor. Repeatable.
        prior (PATH=VALUE+-SD): What is known of a constant beforehand. Repeatable.
        sd (NAME=VALUE): Standard deviation of a quantity, power=1.5% or discharge_temperature=2K.
            Repeatable.
        fit_at (E/C,E/C): Points to fit, degrees Celsius; all others are held out.
        hold_out (N): So many points, drawn at random, are held out.
        evaporating (FROM:TO:COUNT): Where to take polynomials, degrees Celsius, or a list.
        condensing (FROM:TO:COUNT): The same.
        speed (SPEED): At which to take polynomials with speed, such as 50 Hz.
        loss: Of the readings; soft_l1 and huber give little to outliers.
        starts (N): Beginnings of the fit; the first is the machine as it is.
        seed (N): Of what is drawn.
    """
    over = [
        None if text is None else axis(text, name)
        for text, name in ((evaporating, "evaporating"), (condensing, "condensing"))
    ]
    start_jax()
    import numpy as np

    from ..scene.readings import identified_scene, read_readings
    from ..study import identify, joined

    turning = None if speed is None else si(speed.replace("Hz", "turn/s"), "rad/s", "--speed")
    scene = changed_scene(machine, sets, varied=vary)
    readings = [read_readings(one, *over, turning) for one in data]
    bounds, known = _bounds(scene, vary), _priors(scene, prior)
    points = joined(readings)
    held = _held_out(points, fit_at)
    if hold_out:
        if held:
            raise CommandError("--hold-out and --fit-at: give one of the two")
        count = points.evaporating.size
        if not 0 < hold_out < count:
            raise CommandError(
                f"--hold-out {hold_out}: must be from 1 to {count - 1} of the points"
            )
        held = np.random.default_rng(seed).choice(count, hold_out, replace=False).tolist()
    with waiting("Solving the points (the first time they are compiled as well) ..."):
        found = identify(
            scene,
            readings,
            bounds,
            known,
            sd=_deviations(sd),
            hold_out=held,
            loss=loss,
            starts=starts,
            seed=seed,
        )
    result = {"machine": scene.name, "file": scene.file, "source": found.source, **as_dict(found)}

    def figures():
        from ..plot import identification_figures

        return identification_figures(found, scene.name)

    curves = {"readings": found.columns}
    tables = list(identification_tables(found, scene.name))
    hand_out(result, tables, as_json, out, figures, identified_scene(scene, found), curves)


def as_dict(found) -> dict[str, Any]:
    """What an identification found, for JSON."""
    rows = zip(
        found.parameters,
        found.units,
        *(getattr(found, key).tolist() for key in ("start", "estimate", "standard_error")),
        found.prior_share.tolist(),
        strict=True,
    )
    keys = ("name", "unit", "start", "estimate", "standard_error", "prior_share")
    return plain({
        "parameters": [dict(zip(keys, row, strict=True)) for row in rows],
        "covariance": found.covariance,
        "chi_square": float(found.chi_square),
        "freedom": int(found.freedom),
        "p_value": float(found.p_value),
        "weak": list(found.weak),
        "notes": list(found.notes),
        "held_out": [
            {"name": name, "points": one.count, "error_rms": one.rms, "largest_error": one.largest,
             "share_inside": one.inside}
            for name, one in found.held_out.items()
        ],
    })  # fmt: skip


def identification_tables(found, name: str) -> Iterator[Any]:
    """Constants, readings, points held out, and what is not to be trusted."""
    from ..study import MEASURED

    shares = ("" if x != x else f"{x:.0%}" for x in found.prior_share.tolist())
    columns = (found.start, found.estimate, found.standard_error)
    rows = [
        (path, unit, *(f"{x:.5g}" for x in numbers), share)
        for path, unit, *numbers, share in zip(
            found.parameters, found.units, *(c.tolist() for c in columns), shares, strict=True
        )
    ]
    heads = ("Constant", "Unit", "Before", "Identified", "Standard error", "Left of prior")
    yield row_table(f"{name}: identified from {found.source}", heads, rows, texts=2)
    chi = f"Chi-square {float(found.chi_square):.4g} on {int(found.freedom)}"
    yield f"{chi}, p = {float(found.p_value):.2g}."
    for quantity in found.quantities:
        mine, error = found.of(quantity), found.error(quantity)
        unit, relative, *_ = MEASURED[quantity]
        look = shown(quantity, unit, found.measured)
        lines = zip(
            found.evaporating[mine].tolist(),
            found.condensing[mine].tolist(),
            found.measured[mine].tolist(),
            found.computed[mine].tolist(),
            error.tolist(),
            found.half_width[mine].tolist(),
            found.used[mine].tolist(),
            strict=True,
        )
        off = (lambda x: f"{100 * x:+.2f} %") if relative else (lambda x: f"{x:+.2f} K")
        cells = [
            (f"{s - 273.15:.4g}", f"{d - 273.15:.4g}", *(f"{x * look.factor:.5g}" for x in (m, c)),
             off(e), f"{h * look.factor:.2g}", "fitted" if used else "predicted")
            for s, d, m, c, e, h, used in lines
        ]  # fmt: skip
        heads = ("Evap., °C", "Cond., °C", "Measured", "Computed", "Error", "95 %, +-", "")
        yield row_table(look.label, heads, cells)
    rows = []
    for quantity, held in found.held_out.items():
        relative = MEASURED[quantity][1]
        size = [f"{100 * x:.2f} %" if relative else f"{x:.2f} K" for x in (held.rms, held.largest)]
        rows.append((quantity, str(held.count), *size, f"{held.inside:.0%}"))
    if rows:
        heads = ("Points not fitted", "Count", "RMS", "Largest", "Inside 95 %")
        yield row_table("Predicted", heads, rows)
    for note in found.notes:
        yield f"[yellow]Note:[/yellow] {note}."


def _bounds(scene, texts) -> dict[str, tuple[float, float] | None]:
    from ..study import varied

    out = {}
    for text in texts:
        name, equals, given = (part.strip() for part in text.partition("="))
        low, colon, high = given.partition(":")
        if equals and not colon:
            raise CommandError(f"--vary {text}: must be PATH or PATH=LO:HI")
        unit = varied(scene.machine, name).unit
        out[name] = (
            tuple(si(one, unit, f"--vary {name}") for one in (low, high)) if equals else None
        )
    return out


def _priors(scene, texts) -> dict[str, tuple[float, float]]:
    from ..study import varied

    out = {}
    for name, given in assignments(texts, "--prior").items():
        mean, sign, width = given.partition("+-")
        if not sign:
            raise CommandError(f"--prior {name}={given}: must be PATH=VALUE+-SD")
        unit = varied(scene.machine, name).unit
        both = ((mean, False), (width, True))
        out[name] = tuple(si(one.strip(), unit, f"--prior {name}", sd) for one, sd in both)
    return out


def _deviations(texts) -> dict[str, float]:
    from .._core.words import one_of
    from ..study import MEASURED

    out = {}
    for name, given in assignments(texts, "--sd").items():
        if name not in MEASURED:
            raise CommandError(f"--sd {name}: must be {one_of(name, MEASURED)}")
        out[name] = si(given, "" if MEASURED[name][1] else "K", f"--sd {name}", difference=True)
    return out


def _held_out(points, fit_at: str | None) -> list[int]:
    """Rows that are not in the list of points to fit."""
    import numpy as np

    from ..study.rating import ZERO

    if fit_at is None:
        return []
    used = set()
    for text in fit_at.split(","):
        try:
            s, d = (float(one) + ZERO for one in text.split("/"))
        except ValueError:
            raise CommandError(
                f"--fit-at {text}: must be EVAPORATING/CONDENSING, as -5/30"
            ) from None
        near = np.hypot(points.evaporating - s, points.condensing - d)
        if near.min() > _SAME:
            closest = points.names[int(near.argmin())]
            raise CommandError(
                f"--fit-at {text}: is no point of the data; the closest is {closest}"
            )
        used |= set(np.flatnonzero(near <= _SAME).tolist())
    return [row for row in range(points.evaporating.size) if row not in used]
