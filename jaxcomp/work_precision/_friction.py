r"""Friction loops: how closely losses and motion have to agree.

Two loops close the friction. At an instant the joint loop takes a fixed number of Newton steps and
has no tolerance to vary; what it leaves is told in the note. Over the turn, motion and losses are made
to agree by passes, whose tolerance is varied here, at the friction of the scene and at multiples.
"""

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from ..crank import Collocation, solve_orbit
from ._orbit import orbit_reference
from ._report import Reference
from ._study import Piece, Question, SolverProgram, Study, needs_crank

# From constant speed, without panel edges at load reversals: these would be placed on a solution that
# has settled already.
_SOLVER = Collocation(nodes=32, reversals=0)
_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13)
_MULTIPLES = (1.0, 2.0, 4.0)


def friction_study(question: Question, thorough: bool) -> Study:
    """Tolerance of the passes at several multiples of the coefficients of friction.

    The errors of each multiple are relative to its own value at the tightest tolerance, so that they
    are those of the loop alone.

    Raises:
        BadInput: a machine without coefficients of friction.
    """
    needs_crank(question, "friction")
    machine = question.compressor
    assert machine is not None
    if machine.friction is None or not _coefficients(machine.friction):
        raise BadInput("friction", "without", "one with coefficients, for the study of its loops")
    program = cache(lambda: SolverProgram(question, _SOLVER))
    left = float(
        np.max(np.abs(np.asarray(solve_orbit(machine, question.default_solver).loads.residual)))
    )
    pieces = tuple(
        Piece(f"friction times {multiple:g}", partial(_rows, question, program, multiple))
        for multiple in (_MULTIPLES if thorough else _MULTIPLES[:2])
    )
    words = f"passes of the friction; the joint loop itself leaves {left:.0e}"
    return Study(partial(orbit_reference, question), pieces, words)


def _rows(question: Question, program, multiple: float, reference: Reference):
    del reference
    scaled = program().at(_scaled(question.design, multiple))
    tightest = scaled(_TOLERANCES[-1])
    value = float("nan") if tightest.why else float(tightest.value)
    own = Reference(value, value, ("the tightest tolerance", "the same"))
    method = f"friction times {multiple:g}"
    for tolerance in _TOLERANCES[:-1]:
        row = scaled.row(
            own, method, f"tolerance={tolerance:g}", tolerance, candidate=multiple == 1.0
        )
        yield (
            row
            if np.isfinite(row.error)
            else row._replace(
                error=float("inf"), why=row.why or f"at the tightest tolerance: {tightest.why}"
            )
        )


def _coefficients(tree: Any) -> list[str]:
    paths = jax.tree_util.tree_leaves_with_path(tree)
    return [
        name for path, _ in paths if (name := jax.tree_util.keystr(path)).endswith(".coefficient")
    ]


def _scaled(design, multiple: float):
    """The design with all its coefficients of friction multiplied."""

    def scale(path, leaf):
        named = jax.tree_util.keystr(path).endswith(".coefficient")
        return jnp.asarray(leaf) * multiple if named else leaf

    return jax.tree_util.tree_map_with_path(scale, design)
