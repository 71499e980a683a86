"""What is not to be trusted of identified constants, in words."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ._fit import Fit
from ._measurement import Entries
from ._parameter_words import with_path
from ._reading_model import ReadingModel

# Share of the prior's deviation that is left, above which the readings say nothing of a parameter.
_SAY_NOTHING = 0.9
# p-values below which a model is rejected, and above which the deviations were too large.
_REJECTED = 0.01
_TOO_GOOD = 0.99
# Spread of the mean residuals of two speeds, in their deviations, beyond which their law does not fit.
_TOGETHER = 4.0
# Weight that a robust loss leaves to a reading, below which it is named.
_LITTLE = 0.5


def notes_of(fit: Fit, model: ReadingModel, value: NDArray) -> Iterator[str]:
    """Warnings about a fit, in words.

    Args:
        fit: the fit.
        model: whose readings were fitted.
        value: (m,) of the model at the estimate.
    """
    yield from _of_parameters(fit)
    yield from _of_fit(fit, model)
    entries = model.entries
    for weight, name, at in zip(fit.robust, entries.quantity, entries.names, strict=True):
        if weight < _LITTLE:
            yield f"{name} at {at} counts {weight:.0%}"
    lost = ~np.isfinite(value) & ~(fit.interrupted & (fit.weight == 0))
    for at in dict.fromkeys(np.array(entries.names)[lost].tolist()):
        yield f"point {at} has no solution with the estimates"


def _of_parameters(fit: Fit) -> Iterator[str]:
    """Parameters and combinations that the readings do not tell."""
    names = [with_path(parameter.name) for parameter in fit.parameters]
    for name, held in zip(names, fit.at_bound, strict=True):
        if held:
            yield f"{name} is held by its bound: it is not identified, its error means nothing"
    for name, share in zip(names, fit.prior_share, strict=True):
        if share > _SAY_NOTHING:
            yield f"the readings say nothing of {name}: it stays at its prior"
    used = fit.weight > 0
    steepest = np.abs(fit.slope[used]).max(axis=0, initial=0.0)
    for name, slope in zip(names, steepest, strict=True):
        if slope == 0:
            yield f"{name} touches nothing that was measured"
    for direction in fit.directions:
        if direction.unidentifiable or direction.weak:
            verdict = "cannot be told" if direction.unidentifiable else "is hardly told"
            yield (
                f"a combination {verdict}: {direction.words} changes the residuals by "
                f"{direction.effect:.2g} standard deviations"
            )
    if used.sum() <= len(fit.parameters):
        yield f"{used.sum()} readings for {len(fit.parameters)} parameters: the priors decide"


def _of_fit(fit: Fit, model: ReadingModel) -> Iterator[str]:
    """Whether the model explains the readings, and whether the fit is the only one."""
    if fit.stuck:
        yield (
            f"the fit never moved: none of {fit.lost_steps} steps from its start has a solution at all "
            "points, nor have those of the other starts; these are the values it began with. Begin "
            "elsewhere, narrow the ranges, or leave out the points at the edge of what the machine does"
        )
    elif fit.p_value < _REJECTED:
        yield (
            "the model does not explain the readings within the stated deviations: errors of the "
            f"parameters are too small; intervals of predictions are inflated by {fit.scatter:.3g}"
        )
        yield from law_of_speed(fit, model.entries)
    if fit.p_value > _TOO_GOOD:
        yield "the readings fit better than their deviations allow: these are too large"
    for other in fit.minima:
        estimates = []
        for parameter, value in zip(fit.parameters, other.estimate, strict=True):
            estimates.append(f"{parameter.name} {value:.4g}")
        where = ", ".join(estimates)
        yield f"a second minimum, chi-square {other.chi_square:.4g}: {where}"
    if any(measurement.polynomial for measurement in model.measurements):
        yield "the points are made from a polynomial and are no readings: chi-square is a hint alone"
    if fit.interrupted:
        yield "stopped on the way: these are the best constants so far, and no minimum"
    elif not fit.converged:
        yield "the solver did not converge"


def law_of_speed(fit: Fit, entries: Entries) -> Iterator[str]:
    """Whether readings at some speeds are off together, in words."""
    turns = entries.conditions.get("speed", np.full(fit.weight.size, np.nan)) / (2 * np.pi)
    used = fit.weight > 0
    off = fit.residual
    for quantity in dict.fromkeys(entries.quantity):
        rows = used & np.isfinite(turns) & (np.array(entries.quantity) == quantity)
        speeds = np.unique(turns[rows].round(6))
        if speeds.size < 2 or not entries.kinds[quantity].relative:
            continue
        groups = []
        means = []
        for speed in speeds:
            group = rows & np.isclose(turns, speed, rtol=1e-4)
            groups.append(group)
            # mean of n readings, in standard deviations of a mean
            means.append(float(off[group].mean() * np.sqrt(group.sum())))
        if max(means) - min(means) > _TOGETHER:
            errors = []
            for speed, group in zip(speeds, groups, strict=True):
                error = np.mean((fit.value / fit.measured)[group]) - 1
                errors.append(f"{error:+.1%} at {speed:.4g} 1/s")
            yield (
                f"the law of speed does not fit: {quantity} is off by {', '.join(errors)}; factors of "
                "flow and power at each speed (`with_own_factors`, --own-factors) or one speed alone"
            )
