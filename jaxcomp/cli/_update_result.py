"""What `jaxcomp update` fits, as objects of plain numbers in SI units, and its tables."""

import csv
import math
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from rich.markup import escape
from rich.table import Table

from .._fields import quantities
from ..rotor import RotorModel, fit_frequencies, undamped_modes
from ..scene import Scene, with_values
from ._errors import CommandError
from ._tables import _table

# Frequencies closer than this, relative, are one pair of an axisymmetric rotor.
_PAIR = 1e-3


def read_frequencies(file: Path) -> tuple[np.ndarray, list[int]]:
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
    return np.array([value for _, value in found]), [mode for mode, _ in found]


def update_result(
    scene: Scene,
    model: RotorModel,
    paths: Sequence[str],
    measured: np.ndarray,
    modes: Sequence[int],
    bounds: tuple[float, float],
    free: bool,
    regularisation: float,
) -> tuple[dict[str, Any], Scene]:
    """The fit, and the scene with the fitted numbers.

    Raises:
        CommandError: a path that leads to no numbers of the rotor, or too few modes.
    """
    places = [_place(model, path) for path in paths]
    many = min(2 * max(modes) + 12, _size(model))
    first = np.asarray(undamped_modes(model, many, free=free).frequency)
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
    fit = fit_frequencies(
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
    return result, with_values(scene, changes, "fitted to measured natural frequencies")


def update_tables(result: dict[str, Any]) -> list[Table]:
    """Frequencies before and after, and the fitted numbers."""
    title = f"{result['machine']}: natural frequencies in Hz"
    modes = _table(escape(title), "Mode", "Measured", "Before", "After", "Error", numbers=True)
    for row in result["modes"]:
        shown = (f"{row[key] / (2 * math.pi):.5g}" for key in ("measured", "before", "after"))
        modes.add_row(str(row["mode"]), *shown, f"{100 * row['error']:.2g} %")
    table = _table(None, "Fitted", "Factor", "")
    for row in result["variables"]:
        word = "at its bound" if row["at_bound"] else ""
        table.add_row(escape(row["path"]), f"{row['factor']:.5g}", word)
    word = "converged" if result["converged"] else "[bold red]not converged"
    table.add_row("Solver", word, f"{result['steps']} steps")
    return [modes, table]


def _size(model) -> int:
    from ..rotor import prepare

    return prepare(model).layout.size


def _entry(model: RotorModel, path: str):
    """Numbers of the rotor as an entry of a scene file, with their unit."""
    part: Any = model
    name = path.rpartition(".")[2]
    for step in path.split(".")[1:-1]:
        part = part[int(step)] if isinstance(part, tuple) else getattr(part, step)  # pyright: ignore[reportIndexIssue]
    unit = dict(quantities(part))[name].metadata["unit"]  # pyright: ignore[reportArgumentType]
    values = np.asarray(getattr(part, name)).tolist()
    return {"value": values, "unit": unit} if unit else values


def _place(model: RotorModel, path: str):
    """Function that picks the numbers of a path out of the rotor, and the index of one of them."""
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
