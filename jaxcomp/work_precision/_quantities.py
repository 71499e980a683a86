r"""Every quantity of a machine at once: what the default solver makes of it, beside the reference.

All quantities come from one program a solver, so that the time is that of all of them together.
"""

from functools import cache

import numpy as np

from ..design import available_quantities, quantity
from ..machine import Machine
from ._orbit import METHODS, shooting
from ._report import Reference
from ._study import (
    FINE_TOLERANCE,
    TIGHT_TOLERANCE,
    Call,
    Question,
    Setting,
    SolverProgram,
    Study,
    needs_crank,
    without_error,
)


def quantities_study(question: Question, thorough: bool) -> Study:
    """All that `jaxcomp.problem` can be asked for, each relative to its own reference.

    Raises:
        BadInput: a machine without a crank.
    """
    del thorough
    needs_crank(question, "quantities")
    names = known_quantities(question.design)

    default, fine = (SolverProgram(question, s, names) for s in (None, question.fine_solver))

    @cache
    def values():
        """By the fine solver, at a loose tolerance, and by shooting."""
        shot = SolverProgram(question, shooting(question), names)
        return (fine.value(FINE_TOLERANCE), np.asarray(fine.call(0.1).run().value),
                shot.value(TIGHT_TOLERANCE))  # fmt: skip

    def reference(place):
        value, loose, other = (row[place] for row in values())
        if without_error(value, loose, other):
            raise RuntimeError("the solver of the periodic state has no part in it")
        return Reference(value, other, METHODS)

    def call(place):
        def run():
            found = all_of_them()
            return found._replace(value=found.value[place])

        all_of_them = default.call().run
        return Call(run, default.program)

    settings = tuple(
        Setting(name, f"[{quantity(name).unit or '-'}]", lambda place=place: call(place),
                reference=cache(lambda place=place: reference(place)), task=name)
        for place, name in enumerate(names)
    )  # fmt: skip
    return Study(
        lambda: reference(0), settings, "every quantity by the default solver", name=names[0]
    )


def known_quantities(design: Machine) -> tuple[str, ...]:
    """Names of all quantities of a machine, joint by joint."""
    return tuple(available_quantities(design, members=True))
