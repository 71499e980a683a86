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
from ._study import Question, Setting, SolverProgram, Study, needs_crank

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
    machine = needs_crank(question, "friction")
    if not scaled(machine.friction, ".coefficient", 1.0)[1]:
        raise BadInput("friction", "without", "one with coefficients, for the study of its loops")
    program = SolverProgram(question, _SOLVER)
    left = np.max(np.abs(solve_orbit(machine, question.default_solver).loads.residual))
    settings = []
    for multiple in _MULTIPLES if thorough else _MULTIPLES[:2]:
        design, _ = scaled(question.design, ".coefficient", multiple)

        def reference(design=design):
            value = program.at(design).value(_TOLERANCES[-1])
            return Reference(value, value, ("the tightest tolerance", "the same"))

        own = cache(reference)
        settings += [
            Setting(
                f"friction times {multiple:g}",
                f"tolerance={tolerance:g}",
                lambda design=design, tolerance=tolerance: program.at(design).call(tolerance),
                (-np.log10(tolerance),),
                candidate=multiple == 1.0,
                reference=own,
            )
            for tolerance in _TOLERANCES[:-1]
        ]
    words = f"passes of the friction; the joint loop itself leaves {left:.0e}"
    return Study(partial(orbit_reference, question), tuple(settings), words)


def scaled(tree: Any, end: str, factor: float) -> tuple[Any, int]:
    """The tree with all numbers multiplied whose path ends so, and how many these are."""
    count = 0

    def scale(path, leaf):
        nonlocal count
        if not jax.tree_util.keystr(path).endswith(end):
            return leaf
        count += 1
        return jnp.asarray(leaf) * factor

    return jax.tree_util.tree_map_with_path(scale, tree), count
