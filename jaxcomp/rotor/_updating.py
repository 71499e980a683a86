r"""Model updating: parameters fitted to measured natural frequencies.

Bounded parameters p = low + (high - low) (1 + sin t)/2 are moved by Levenberg-Marquardt on the
relative errors of the frequencies, with the exact derivatives of the eigenvalues. (A sigmoid would
put the bounds at infinity, where the solver creeps.) The frequencies of a pair
count once: `modes` says which numbers in the list of all modes were measured.

Source of the task: Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`, section 3.2,
where diameters of crank pin and crank arm are fitted.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.errors import BadInput
from ._model import RotorModel
from ._modes import undamped_modes


class Update(NamedTuple):
    """A fitted model.

    Attributes:
        model: the model with the fitted parameters.
        parameters: [SI] (p,) their values.
        frequency: [rad/s] (m,) natural frequencies of the fitted model.
        error: [-] (m,) relative errors against the measured ones.
        steps: [-] number of steps taken.
        converged: whether the solver met its tolerance.
        at_bound: (p,) where a parameter ended within a thousandth of its range from a bound, so that
            the data ask for a value outside of it.
    """

    model: RotorModel
    parameters: Array
    frequency: Array
    error: Array
    steps: Array
    converged: Bool[Array, ""]
    at_bound: Bool[Array, " p"]


def fit_frequencies(
    model: RotorModel,
    insert: Callable[[RotorModel, Float[Array, " p"]], RotorModel],
    start: Float[Array, " p"],
    low: Float[Array, " p"],
    high: Float[Array, " p"],
    measured: Float[Array, " m"],
    modes: tuple[int, ...],
    *,
    free: bool = True,
    regularisation: float = 0.0,
    tolerance: float = 1e-10,
    max_steps: int = 60,
) -> Update:
    """Fit parameters to measured undamped natural frequencies.

    Args:
        model: the model to start from.
        insert: puts the parameters into the model, for example with `equinox.tree_at`.
        start: [SI] (p,) first values, strictly between the bounds.
        low: [SI] (p,) lower bounds.
        high: [SI] (p,) upper bounds.
        measured: [rad/s] (m,)
        modes: numbers of the measured modes, from zero, rigid motions and both of a pair counted.
        free: without bearings, as measured on a hanging rotor.
        regularisation: [-] weight of the distance from the start, in ranges of the parameters,
            against a relative error of the frequencies. With fewer frequencies than parameters it
            chooses among the solutions.
        tolerance: [-] relative and absolute tolerance of the solver.
        max_steps: largest number of steps.

    Raises:
        BadInput: a start outside its bounds, or lists of different length.
    """
    start, low, high = (jnp.asarray(a, float) for a in (start, low, high))
    measured = jnp.asarray(measured, float)
    if not (start.shape == low.shape == high.shape):
        raise BadInput("low", low, f"one bound for each of {start.size} parameters, as `high`")
    if not bool(jnp.all((low < start) & (start < high))):
        raise BadInput("start", start, f"strictly between {np.asarray(low)} and {np.asarray(high)}")
    if measured.shape != (len(modes),) or not bool(jnp.all(measured > 0)):
        raise BadInput("measured", measured, f"a positive frequency for each of modes {modes}")
    weight = jnp.asarray(regularisation, float)
    settings = tuple(int(m) for m in modes), free, float(tolerance), int(max_steps)
    return _fit(model, insert, start, low, high, measured, weight, settings)


@eqx.filter_jit
def _fit(model, insert, start, low, high, measured, weight, settings) -> Update:
    modes, free, tolerance, max_steps = settings
    inside = lambda t: low + (high - low) * (1 + jnp.sin(t)) / 2  # noqa: E731

    def frequencies(t):
        found = undamped_modes(insert(model, inside(t)), max(modes) + 1, free=free).frequency
        return found[np.array(modes)]

    def errors(t, _):
        distance = weight * (inside(t) - start) / (high - low)
        return jnp.concatenate([frequencies(t) / measured - 1, distance])

    import optimistix as optx

    solver = optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    begin = jnp.arcsin(2 * (start - low) / (high - low) - 1)
    answer = optx.least_squares(errors, solver, begin, max_steps=max_steps, throw=False)
    values, found = inside(answer.value), frequencies(answer.value)
    margin = jnp.minimum(values - low, high - values) / (high - low)
    return Update(
        insert(model, values),
        values,
        found,
        found / measured - 1,
        answer.stats["num_steps"],
        answer.result == optx.RESULTS.successful,
        margin < 1e-3,
    )
