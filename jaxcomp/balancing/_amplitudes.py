r"""Balancing without phase: influence coefficients from amplitudes and several trial positions.

With the trial unbalances $U_{kp}$ of run $k$ in the planes $p$ the amplitude at a reading is
$A_k = |A_0 + \sum_p H_p U_{kp}|$. The phase of the initial vibration is that of a mark nobody sees, so
that it counts as zero; what is sought are the complex $H_p$ of every reading by itself, by least squares
of the amplitudes. Two trial positions in a plane leave two solutions, mirror images of each other about
the line through the centres $-A_0/U_k$ of the circles on which $H$ lies; three or more leave one. (One
plane: method of four runs, by three circles. Two planes: L. J. Everett 1987, Two-plane balancing of a
rotor system without phase response measurements, J. Vibration, Acoustics, Stress and Reliability in
Design 109, 162-167, with seven runs.)
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from .._core.errors import BadInput
from ._balance import Balance
from ._influence import Influence, InfluenceRow, weight_of_rows
from ._least_squares import least_squares

# [-] Amplitudes of instruments repeat to about this, over the root mean square of the readings: what
# fits as well as that cannot be told from the truth.
_REPEATED_WITHIN = 0.02
# Solutions of one plane begin at these phases and sizes of A_0 + H U over A_0; of more planes at all
# combinations. 12 phases find both mirror images of all of 2,000 random pairs of circles.
_PHASES = 12
_SIZES = (0.3, 1.0, 3.0)
_MOST_STARTS = 1500
_STEPS = 80
# [-] Relative distance below which two ends of the descent are one solution: of a pair of mirror
# images that nearly touch, squares of it are left in the amplitudes.
_SAME = 1e-5
# [-] Of the coefficients: the last step of a descent that has come to its end.
_ENDED = 1e-7
# Systems of several readings multiply their solutions.
_MOST_SYSTEMS = 256


def amplitude_influence(
    amplitudes: Float[np.ndarray, "runs rows"],
    weights: Complex[np.ndarray, "runs planes"],
    rows: Sequence[InfluenceRow],
    planes: Sequence[str],
    weight: Float[np.ndarray, " rows"] | None = None,
) -> Influence:
    """Influence coefficients from amplitudes alone, of an initial run and of runs with trial weights.

    Phases of the system count from the initial vibration of each reading. What fits the amplitudes as
    well, to 2 % of them, is among its `alternatives`: all of them with two trial positions in a plane.

    Args:
        amplitudes: [m] of the initial run, and below it of the runs with trial weights.
        weights: [kg m] all unbalance that is on in a run, mass times radius, with its angle; zeros in
            the first run.
        rows, planes: what the rows and columns are.
        weight: [-] of each row; 1 if absent.

    Returns:
        The system that leaves least vibration by least squares, with the others in order.

    Raises:
        BadInput: an initial amplitude of zero, trial weights in the first run, fewer trial positions
            than two for a plane, or so many solutions that none is worth a try.
    """
    amplitudes = np.asarray(amplitudes, float)
    weights = np.asarray(weights, complex)
    if np.any(weights[0] != 0):
        raise BadInput("weights", weights[0], "zero in the first run, as the machine is")
    if not np.all(amplitudes[0] > 0):
        raise BadInput("amplitudes", amplitudes[0], "> 0 in the first run")
    _check_positions(weights[1:], planes)
    solutions = []
    # reading by reading: the coefficients of one are in no amplitude of another
    for column in amplitudes.T:
        solutions.append(_solutions(column, weights[1:]))
    count = math.prod(len(each) for each in solutions)
    if count > _MOST_SYSTEMS:
        needs = f"of three positions in each plane, which leave fewer than the {count} solutions"
        raise BadInput("weights", f"{len(weights) - 1} trial runs", needs)
    row_weight = weight_of_rows(weight, rows)
    systems = []
    for fits in itertools.product(*solutions):
        coefficients = []
        misfit = []
        for fit in fits:
            coefficients.append(fit.coefficients)
            misfit.append(fit.misfit)
        matrix = jnp.asarray(np.stack(coefficients))
        systems.append(
            Influence(
                matrix,
                jnp.asarray(amplitudes[0], complex),
                row_weight,
                tuple(rows),
                tuple(planes),
                misfit=jnp.asarray(misfit),
            )
        )
    # The unbalance that one plane holds alone is seen alike at all readings, so that the right sides
    # leave least; with one reading all leave nothing, and what fits best comes first.
    best, *alternatives = sorted(systems, key=_rank)
    return dataclasses.replace(best, alternatives=tuple(alternatives))


def _rank(system: Influence) -> tuple[float, float]:
    """Vibration that a system leaves, to a millionth, and its misfit."""
    # rounded, so that the misfit decides between systems that all leave nothing
    improvement = round(float(least_squares(system).improvement), 6)
    misfit = np.zeros(1)
    if system.misfit is not None:
        misfit = np.asarray(system.misfit)
    return improvement, float(np.linalg.norm(misfit / np.abs(system.initial)))


def balance_each(
    influence: Influence, method: Callable[[Influence], Balance] = least_squares
) -> Balance:
    """The balance of a system with those of its alternatives, which fit the readings as well.

    Args:
        influence: of `amplitude_influence`.
        method: of balancing, for all of them.
    """
    alternatives = tuple(method(other) for other in influence.alternatives)
    return dataclasses.replace(method(influence), alternatives=alternatives)


class _Fit(NamedTuple):
    """Coefficients of one reading, with what they leave of its amplitudes.

    Attributes:
        coefficients: [m/(kg m)] (planes,)
        misfit: [m] root mean square over the runs with trial weights.
    """

    coefficients: np.ndarray
    misfit: float


def _check_positions(weights: np.ndarray, planes: Sequence[str]) -> None:
    """Refuse trial positions that leave a continuum of solutions, whatever the amplitudes are."""
    count = len(planes)
    need = f"positions at two angles at least in each plane, {2 * count} or more"
    if len(np.unique(np.round(weights / (np.abs(weights).max() + 1e-300), 9), axis=0)) < 2 * count:
        raise BadInput("weights", f"{len(weights)} runs with trial weights", need)
    # At coefficients at random, where the rank is as high as it ever is.
    rng = np.random.default_rng(0)
    draw = rng.normal(size=count) + 1j * rng.normal(size=count)
    units = weights / np.maximum(np.abs(weights).max(axis=0), 1e-300)
    _, jacobian = _amplitude(np.ones(1), units, draw[None])
    if np.linalg.matrix_rank(jacobian[0], tol=1e-6) < 2 * count:
        raise BadInput("weights", "positions that repeat each other", need)


def _amplitude(initial, weights, coefficients) -> tuple[np.ndarray, np.ndarray]:
    """(starts, runs) amplitudes, and their derivatives (starts, runs, 2 planes)."""
    vibration = initial + coefficients @ weights.T
    size = np.abs(vibration)
    # d|v| = Re[conj(v/|v|) U dH]: its real part by Re H, minus its imaginary part by Im H.
    # A vibration of zero has no direction: its row is zero instead of no number.
    direction = vibration / np.maximum(size, 1e-300)
    turned = np.conj(direction)[..., None] * weights
    return size, np.concatenate([turned.real, -turned.imag], axis=-1)


def _solutions(amplitudes: np.ndarray, weights: np.ndarray) -> list[_Fit]:
    """All coefficients that fit the amplitudes of one reading, the best first."""
    initial = amplitudes[0]
    read = amplitudes[1:] / amplitudes[0]
    # In units of the initial amplitude and of each plane's largest trial weight, where H is of order 1.
    unit = np.abs(weights).max(axis=0)
    ends, misfit = _descended(read, weights / unit, _starts(weights.shape[1]))
    scale = np.sqrt(np.mean(read**2))
    # Where even the best fit misses by more than instruments do, what misses by twice as much is as good.
    fits_within = max(_REPEATED_WITHIN * scale, 2 * misfit.min())
    fits: list[_Fit] = []
    distinct: list[np.ndarray] = []
    for place in np.argsort(misfit, kind="stable"):
        end = ends[place]
        if misfit[place] > fits_within:
            break
        size = np.linalg.norm(end)
        if all(np.linalg.norm(end - other) > _SAME * size for other in distinct):
            distinct.append(end)
            fits.append(_Fit(end * initial / unit, float(misfit[place]) * initial))
    return fits


def _starts(planes: int) -> np.ndarray:
    """(starts, planes) coefficients to begin at."""
    phases = np.exp(2j * np.pi * np.arange(_PHASES) / _PHASES)
    coefficients = np.outer(_SIZES, phases).ravel()
    if coefficients.size**planes <= _MOST_STARTS:
        return np.array(list(itertools.product(coefficients, repeat=planes)))
    # all combinations of three planes are too many; the draw is the same every time
    return np.random.default_rng(0).choice(coefficients, (_MOST_STARTS, planes))


def _descended(read, weights, x) -> tuple[np.ndarray, np.ndarray]:
    """Ends of Levenberg's method from all starts at once, and the root mean square misfit of each.

    Those that are still under way are left out, as long as any has ended.
    """
    planes = x.shape[1]
    damping = np.full(len(x), 1e-2)
    size, jacobian = _amplitude(1.0, weights, x)
    misfit = np.sum((size - read) ** 2, axis=1)
    for _ in range(_STEPS):
        # J^T r and J^T J of every start s, over the runs k; p and q are the real unknowns
        gradient = np.einsum("skp,sk->sp", jacobian, size - read)
        normal = np.einsum("skp,skq->spq", jacobian, jacobian)
        normal = normal + damping[:, None, None] * np.eye(2 * planes)
        step = -np.linalg.solve(normal, gradient[..., None])[..., 0]
        tried = x + step[:, :planes] + 1j * step[:, planes:]
        size_tried, jacobian_tried = _amplitude(1.0, weights, tried)
        misfit_tried = np.sum((size_tried - read) ** 2, axis=1)
        better = misfit_tried <= misfit
        x = np.where(better[:, None], tried, x)
        size = np.where(better[:, None], size_tried, size)
        jacobian = np.where(better[:, None, None], jacobian_tried, jacobian)
        misfit = np.where(better, misfit_tried, misfit)
        # Down to where Gauss and Newton's step is taken as it is, which ends quadratically.
        damping = np.clip(np.where(better, damping / 10, damping * 5), 1e-15, 1e6)
    # The step that Gauss and Newton would still take says which descents have come to their end.
    gradient = np.einsum("skp,sk->sp", jacobian, size - read)
    # A trace of damping, because the matrix is singular where two mirror images touch.
    normal = np.einsum("skp,skq->spq", jacobian, jacobian) + 1e-14 * np.eye(2 * planes)
    step = np.linalg.norm(np.linalg.solve(normal, gradient[..., None])[..., 0], axis=1)
    ended = step <= _ENDED * np.linalg.norm(x, axis=1)
    if ended.any():
        x = x[ended]
        misfit = misfit[ended]
    return x, np.sqrt(misfit / len(read))
