r"""The inverse of a tolerance study: how wide tolerances may be so that few machines break a limit."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from .._fields import BadInput
from ._monte_carlo import solved_rows
from ._tolerance import Tolerances

# Factors on the tolerances between which is searched.
_LOW, _HIGH = 1e-3, 10.0


class Permitted(NamedTuple):
    """Tolerances that keep the rejects below a share.

    Attributes:
        variables: whose tolerances are changed.
        factor: [-] on each of them: below one they have to be tighter. NaN where the limit is broken
            however tight they are.
        rejects: [-] share of the machines that break a limit then, all of them solved again.
        before: [-] as the tolerances stand.
    """

    variables: tuple[str, ...]
    factor: float
    rejects: float
    before: float


def permitted(
    found: Tolerances, rejects: float, variables: Sequence[str] | None = None
) -> Permitted:
    """The common factor on some tolerances with which a share of the machines breaks a limit.

    The machines of the study are drawn again with scaled deviations. The factor is found with
    value, slope and curvature at the mean machine, corrected for what they miss at the tolerances as
    they stand, and the machines are then solved at that factor.

    Args:
        found: a study with limits.
        rejects: [-] the share that may break any limit.
        variables: whose tolerances change; all if absent.

    Raises:
        BadInput: no limit, a share outside 0 to 1, or an unknown variable.
    """
    if not found.reliability:
        raise BadInput("limits", "none", "at least one, to reject machines by")
    if not 0 < rejects < 1:
        raise BadInput("rejects", rejects, "> 0 and < 1")
    names = tuple(found.variables if variables is None else variables)
    for name in names:
        if name not in found.variables:
            raise BadInput("variables", name, f"one of {', '.join(found.variables)}")
    mean = np.asarray(found.scatter.mean(found.nominal))
    away = np.asarray(found.scatter.at(found.nominal, found.sampled.normals)) - mean
    chosen = np.array([name in names for name in found.variables])
    scaled = chosen[None] * away, ~chosen[None] * away
    near = found.local
    curvature = None if near.curvature is None else np.asarray(near.curvature)

    def series(deviation):
        values = np.asarray(near.value) + deviation @ np.asarray(near.slope).T
        if curvature is not None:
            values = values + np.einsum("si,qij,sj->sq", deviation, curvature, deviation) / 2
        return values

    missed = found.sampled.values - series(away)

    def broken(values):
        bad = np.zeros(len(values), bool)
        for one in found.reliability:
            column = values[:, found.names.index(one.limit.quantity)]
            bad |= column > one.limit.bound if one.limit.above else column < one.limit.bound
        return bad

    good = found.sampled.ok
    before = float(np.mean(broken(found.sampled.values[good])))

    def excess(factor):
        # what the series misses grows at least as the cube of the deviations; linearly is prudent
        values = series(factor * scaled[0] + scaled[1]) + min(factor, 1.0) * missed
        return float(np.mean(broken(values[good]))) - rejects

    if excess(_LOW) > 0:
        return Permitted(names, float("nan"), before, before)
    factor = _HIGH if excess(_HIGH) <= 0 else float(brentq(excess, _LOW, _HIGH, xtol=1e-4))
    values, ok = solved_rows(found.problem, mean + factor * scaled[0] + scaled[1])
    return Permitted(names, factor, float(np.mean(broken(values[ok]))), before)
