r"""Single precision: the same solvers in float32 beside float64.

All numbers are cast and JAX's 64-bit mode is off while a program is traced and runs; the reference
is that of the periodic state, in float64.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..crank import Collocation, Shooting
from ._orbit import orbit_study
from ._report import Reference
from ._study import Piece, Question, SolverProgram, Study, needs_crank

_SETTINGS = (
    (Collocation(nodes=8, kinks=0), (1e-4, 1e-6)),
    (Collocation(nodes=32, kinks=0), (1e-4, 1e-6)),
    (Collocation(nodes=8), (1e-4, 1e-6)),
)
_SHOT = (Shooting(kinks=0, max_steps=16384), (1e-1, 1e-2, 1e-3))


def precision_study(question: Question, thorough: bool) -> Study:
    """Collocation (and shooting, if thorough) in either precision."""
    needs_crank(question, "precision")
    settings = (*_SETTINGS, _SHOT) if thorough else _SETTINGS
    pieces = tuple(
        Piece(
            f"{precision}, {_words(solver)}",
            partial(_rows, question, solver, tolerances, precision),
        )
        for solver, tolerances in settings
        for precision in ("float32", "float64")
    )
    return Study(orbit_study(question, False).reference, pieces, "float32 beside float64")


def _words(solver) -> str:
    if isinstance(solver, Collocation):
        return f"collocation nodes={solver.nodes} kinks={solver.kinks}"
    return f"shooting {type(solver.solver).__name__}"


def _rows(question: Question, solver, tolerances, precision: str, reference: Reference):
    with jax.enable_x64(precision == "float64"):
        design = _cast(question.design, precision)
        program = SolverProgram(question._replace(design=design), solver)
        for tolerance in tolerances:
            setting = f"{_words(solver)} tolerance={tolerance:g}"
            yield program.row(reference, precision, setting, tolerance)


def _cast(design, precision: str):
    """Every float of a design in another precision."""

    def cast(leaf):
        if isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating):
            return jnp.asarray(np.asarray(leaf), precision)
        return leaf

    return jax.tree.map(cast, design)
