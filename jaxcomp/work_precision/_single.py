r"""Single precision: the same solvers in float32 beside float64.

JAX has one precision for a process, so that float32 is measured in a second one (`_worker`), with JAX's
64-bit mode off. The reference is that of the periodic state, in float64.
"""

import json
import math
import os
import pickle
import subprocess
import sys
from functools import partial
from typing import Any

import jax
import numpy as np

from ..crank import Collocation, Shooting
from ._orbit import orbit_reference
from ._report import Reference, Row
from ._study import Piece, Question, SolverProgram, Study, needs_crank

# Of the solver, and the tolerances asked of it.
Setting = tuple[Collocation | Shooting, tuple[float, ...]]

_SETTINGS: tuple[Setting, ...] = (
    (Collocation(nodes=8, reversals=0), (1e-4, 1e-6)),
    (Collocation(nodes=32, reversals=0), (1e-4, 1e-6)),
    (Collocation(nodes=8), (1e-4, 1e-6)),
)
_SHOT: Setting = (Shooting(reversals=0, max_steps=16384), (1e-1, 1e-2, 1e-3))


def precision_study(question: Question, thorough: bool) -> Study:
    """Collocation (and shooting, if thorough) in either precision."""
    needs_crank(question, "precision")
    settings = (*_SETTINGS, _SHOT) if thorough else _SETTINGS
    pieces = [
        Piece(f"{precision}, {_words(setting[0])}", partial(rows, question, setting))
        for setting in settings
        for precision, rows in (("float32", _single_rows), ("float64", _double_rows))
    ]
    reference = partial(orbit_reference, question)
    return Study(reference, tuple(pieces), "float32 beside float64")


def measured(question: Question, setting: Setting) -> list[dict[str, Any]]:
    """Value, time and evidence of each tolerance, in the precision of this process."""
    solver, tolerances = setting
    program = SolverProgram(question, solver)
    found = []
    for tolerance in tolerances:
        solved = program(tolerance)
        found.append(
            {
                "setting": f"{_words(solver)} tolerance={tolerance:g}",
                "value": None if solved.why else float(solved.value),
                "seconds": program.seconds(tolerance),
                "compile_seconds": program.program.seconds,
                "passes": int(solved.passes),
                "flops": program.program.flops,
                "family": _words(solver),
                "tightness": (-math.log10(tolerance),),
                "why": solved.why,
            }
        )
    return found


def _double_rows(question: Question, setting: Setting, reference: Reference):
    return _rows("float64", measured(question, setting), reference)


def _single_rows(question: Question, setting: Setting, reference: Reference):
    plain = jax.tree.map(np.asarray, question.design)
    sent = pickle.dumps((question._replace(design=plain), setting))
    done = subprocess.run(
        [sys.executable, "-m", "jaxcomp.work_precision._worker"],
        input=sent,
        stdout=subprocess.PIPE,
        env=os.environ | {"JAXCOMP_X64": "0", "JAX_ENABLE_X64": "0"},
        check=True,
    )
    return _rows("float32", json.loads(done.stdout), reference)


def _rows(precision: str, found: list[dict[str, Any]], reference: Reference):
    for one in found:
        value = one.pop("value")
        error = float("inf") if value is None else reference.error(value)
        yield Row(precision, error=error, **one | {"tightness": tuple(one["tightness"])})


def _words(solver) -> str:
    if isinstance(solver, Collocation):
        return f"collocation nodes={solver.nodes} reversals={solver.reversals}"
    return f"shooting {type(solver.solver).__name__}"
