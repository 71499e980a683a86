"""`jaxcomp update`: numbers of a rotor fitted to measured natural frequencies."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

import jaxcomp as jc

from ._arguments import assignments, changed_scene
from ._errors import CommandError, reports_errors
from ._options import AsJson, Machine, Out, Sets
from ._output import hand_out
from ._start import start_jax
from ._tables import row_table


@reports_errors
def update(
    machine: Machine,
    measured: Annotated[
        Path,
        typer.Argument(
            help='CSV with a column "frequency [Hz]" and, where not the lowest ones were measured, '
            '"mode", counted from 1 with every pair of equal frequencies as one.'
        ),
    ],
    variable: Annotated[
        list[str],
        typer.Option(
            "--variable",
            metavar="PATH",
            help="Numbers that get one common factor, e.g. rotor.shafts.5.young_modulus, or one of "
            "a list, e.g. rotor.shafts.5.outer_diameter.0. Repeatable.",
        ),
    ],
    sets: Sets = None,
    within: Annotated[
        str, typer.Option("--range", metavar="LOW:HIGH", help="Bounds of every factor.")
    ] = "0.5:2",
    held: Annotated[
        bool, typer.Option("--held", help="Measured in its bearings, not hanging free.")
    ] = False,
    regularisation: Annotated[
        float, typer.Option(help="Penalty on the distance from the scene's values, 0 for none.")
    ] = 0.0,
    as_json: AsJson = False,
    out: Out = None,
) -> None:
    """Fit numbers of a rotor, such as elastic moduli or springs, to a modal test.

    Example: [bold]jaxcomp update hermetic-68cc modes.csv --variable rotor.shafts.5.outer_diameter
    [/bold]
    """
    from .._waits import spinner
    from ._rotor import rotor_of

    try:
        low, high = (float(part) for part in within.split(":"))
    except ValueError:
        raise CommandError(f"--range {within}: must have the form low:high") from None
    if not 0 < low < 1 < high < float("inf"):
        raise CommandError(f"--range {within}: must be positive and hold the factor 1")
    frequencies, modes = read_frequencies(measured)
    start_jax(once=True)
    scene = changed_scene(machine, sets or (), ())
    model = rotor_of(scene)
    with spinner("Fitting (the first time it is compiled as well) ..."):
        result, scene = update_result(
            scene, model, variable, frequencies, modes, (low, high), not held, regularisation
        )
    result["set"] = assignments(sets or (), "--set")

    def figures():
        return {"rotor": jc.plot.rotor_drawing(rotor_of(scene))}

    hand_out(result, update_tables(result), as_json, out, figures, scene)


# Frequencies closer than this, relative, are one pair of an axisymmetric rotor.
_PAIR = 1e-3


def read_frequencies(file: Path) -> tuple[list[float], list[int]]:
    """[rad/s] Measured frequencies, rising, and which of the distinct ones they are, from 1.

    Raises:
        CommandError: no such column, or a cell that is no positive number.
    """
    with file.open(encoding="utf-8-sig", newline="") as lines:
        rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    header = [cell.strip() for cell in rows[0]] if rows else []
    if "frequency [Hz]" not in header or len(rows) < 2:
        raise CommandError(f'{file}: must have a column "frequency [Hz]" and a line below it')
    found = []
    for number, row in enumerate(rows[1:], 1):
        cells = dict(zip(header, row, strict=False))
        try:
            value = float(cells["frequency [Hz]"])
            mode = int(cells["mode"]) if "mode" in header else number
        except (KeyError, ValueError):
            raise CommandError(f"{file}: line {number + 1}: must hold numbers") from None
        if not (0 < value < 1e12 and mode > 0):
            raise CommandError(f"{file}: line {number + 1}: must be above zero")
        found.append((mode, 2 * math.pi * value))
    if len({mode for mode, _ in found}) < len(found):
        raise CommandError(f"{file}: mode: is named twice")
    found.sort()
    return [value for _, value in found], [mode for mode, _ in found]


def update_result(
    scene: jc.scene.Scene,
    model: jc.rotor.RotorModel,
    paths: Sequence[str],
    measured: Sequence[float],
    modes: Sequence[int],
    bounds: tuple[float, float],
    free: bool,
    regularisation: float,
) -> tuple[dict[str, Any], jc.scene.Scene]:
    """The fit, and the scene with the fitted numbers.

    Raises:
        CommandError: a path that leads to no numbers of the rotor, or too few modes.
    """
    import equinox as eqx
    import jax.numpy as jnp
    import numpy as np

    places = [_place(model, path) for path in paths]
    many = min(2 * max(modes) + 12, _size(model))
    first = np.asarray(jc.rotor.undamped_modes(model, many, free=free).frequency)
    elastic = np.flatnonzero(first > 1e-3 * first.max())
    apart = np.append(True, np.diff(first[elastic]) > _PAIR * first[elastic][1:])
    distinct = elastic[apart]
    if max(modes) > len(distinct):
        raise CommandError(f"mode {max(modes)}: the rotor has {len(distinct)} distinct frequencies")
    numbers = tuple(int(distinct[mode - 1]) for mode in modes)

    def insert(model, factors):
        for (get, index), factor in zip(places, factors, strict=True):
            value = get(model)
            value = value * factor if index is None else value.at[index].multiply(factor)
            model = eqx.tree_at(get, model, value)
        return model

    one = jnp.ones(len(places))
    fit = jc.rotor.fit_frequencies(
        model, insert, one, bounds[0] * one, bounds[1] * one, measured, numbers,
        free=free, regularisation=regularisation,
    )  # fmt: skip
    variables, changes = [], {}
    for path, (get, index), factor, bound in zip(
        paths, places, fit.parameters, fit.at_bound, strict=True
    ):
        before, after = (np.asarray(get(m)) for m in (model, fit.model))
        if index is not None:
            before, after = before[index], after[index]
        field = path if index is None else path.rpartition(".")[0]
        changes[field] = _entry(fit.model, field)
        variables.append(
            {"path": path, "factor": float(factor), "before": before.tolist(),
             "after": after.tolist(), "at_bound": bool(bound)}
        )  # fmt: skip
    result = {
        "machine": scene.name,
        "file": scene.file,
        "version": version("jaxcomp"),
        "free": free,
        "variables": variables,
        "modes": [
            {"mode": mode, "measured": float(m), "before": float(first[i]), "after": float(f),
             "error": float(e)}
            for mode, i, m, f, e in zip(modes, numbers, measured, fit.frequency, fit.error, strict=True)
        ],
        "converged": bool(fit.converged),
        "steps": int(fit.steps),
    }  # fmt: skip
    return result, jc.scene.with_values(scene, changes, "fitted to measured natural frequencies")


def update_tables(result: dict[str, Any]) -> list[Table]:
    """Frequencies before and after, and the fitted numbers."""
    hertz = 1 / (2 * math.pi)
    modes = (
        (
            row["mode"],
            *(f"{row[key] * hertz:.5g}" for key in ("measured", "before", "after")),
            f"{100 * row['error']:.2g} %",
        )
        for row in result["modes"]
    )
    fitted = [
        (escape(row["path"]), f"{row['factor']:.5g}", row["at_bound"] and "at its bound")
        for row in result["variables"]
    ]
    status = "converged" if result["converged"] else "[bold red]not converged"
    heads = ("Mode", "Measured", "Before", "After", "Error")
    return [
        row_table(f"{result['machine']}: natural frequencies in Hz", heads, modes),
        row_table(
            None,
            ("Fitted", "Factor", ""),
            [*fitted, ("Solver", status, f"{result['steps']} steps")],
            texts=3,
        ),
    ]


def _size(model) -> int:
    from ..rotor import prepare

    return prepare(model).layout.size


def _entry(model: jc.rotor.RotorModel, path: str):
    """Numbers of the rotor as an entry of a scene file, with their unit."""
    from .._fields import quantities

    part: Any = model
    name = path.rpartition(".")[2]
    for step in path.split(".")[1:-1]:
        part = part[int(step)] if isinstance(part, tuple) else getattr(part, step)  # pyright: ignore[reportIndexIssue]
    unit = dict(quantities(part))[name].metadata["unit"]  # pyright: ignore[reportArgumentType]
    values = getattr(part, name).tolist()
    return {"value": values, "unit": unit} if unit else values


def _place(model: jc.rotor.RotorModel, path: str):
    """Function that picks the numbers of a path out of the rotor, and the index of one of them."""
    import equinox as eqx

    steps = path.split(".")
    if steps[0] != "rotor" or len(steps) < 2:
        raise CommandError(
            f"--variable {path}: must begin with rotor, such as rotor.shafts.0.length"
        )
    here: Any = model
    index, walked = None, []
    for step in steps[1:]:
        try:
            if eqx.is_array(here):
                if index is not None:
                    raise IndexError
                index = int(step)
                here[index]
                if not 0 <= index < len(here):
                    raise IndexError
                continue
            walked.append(int(step) if isinstance(here, tuple) else step)
            here = here[walked[-1]] if isinstance(here, tuple) else getattr(here, step)
        except (AttributeError, IndexError, ValueError, TypeError):
            raise CommandError(f"--variable {path}: {step} leads to nothing") from None
    if not eqx.is_inexact_array(here):
        raise CommandError(f"--variable {path}: leads to no numbers")

    def get(model):
        for step in walked:
            model = model[step] if isinstance(step, int) else getattr(model, step)
        return model

    return get, index
