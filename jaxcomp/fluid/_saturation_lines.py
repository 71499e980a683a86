r"""Dew and bubble line of a mixture as polynomials, and how they move with the composition.

Logarithms of pressure and density along both lines are Chebyshev series in $1/T$ on two panels. They are
solved once for a composition, on the host; a program takes their coefficients as arrays, so that another
composition of the same components is the same program. Derivatives to the composition are those of the
coefficients, by the implicit function theorem at each node: exact at the composition that was solved, and
of first order beside it.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ._equilibrium import (
    FIRST_T,
    Line,
    PhaseModel,
    line_slopes,
    march,
    march_beside,
    separation,
    solved,
)
from ._multi_fluid import multi_fluid

# Nodes of a panel: with 16 the density of R404A near its critical point is good to 5e-7, with 24 to 1e-8.
NODES = 24
# Lines end at this share of the critical temperature: beyond, densities have an infinite slope.
_END = 0.985
# Mass fractions from whose multiples others are begun, and the least there: its logarithm is an unknown.
_ROUND = 0.04
_LEAST_ROUND = 0.01
_FEWEST = 5  # points on the way along a line; fewer tell nothing of its end
_STEPS = 4
_SAMPLES = 48  # of the table in which a temperature is first looked up by its pressure

DEW_PRESSURE, BUBBLE_PRESSURE, DEW_DENSITY, BUBBLE_DENSITY = range(4)


class SaturationLines(eqx.Module):
    """The lines of a mixture of n components.

    Attributes:
        ends: [K] (3,) where the first panel begins, where the second does, and where that ends.
        coefficients: (2, 4, nodes) of ln(p'') and ln(p') [Pa], ln(rho'') and ln(rho') [kg/m^3], by panel.
        slopes: (n, 2, 4, nodes) their derivatives to the mass fractions, which are normalised.
        reference: (n,) mass fractions that were solved.
        critical: [K] temperature at which both lines end, to about 0.1 K.
    """

    ends: Float[Array, "3"]
    coefficients: Float[Array, "2 4 nodes"]
    slopes: Float[Array, "n 2 4 nodes"]
    reference: Float[Array, " n"]
    critical: Float[Array, ""]

    def at(self, mass_fractions, tools) -> Any:
        """(2, 4, nodes) coefficients at mass fractions (n,) of sum one near those that were solved."""
        if tools is np:  # known, as the composition is that of the lines
            return np.asarray(self.coefficients)
        return self.coefficients + jnp.tensordot(mass_fractions - self.reference, self.slopes, 1)


def curve(coefficients, ends, T, tools=jnp):
    """Series at temperatures [K] within their ends, and their derivatives [1/K].

    Args:
        coefficients: (2, nodes) of one curve.
        ends: [K] (3,)
        T: [K] of any shape.
        tools: `numpy` or `jax.numpy`.
    """
    T = tools.clip(tools.asarray(T), ends[0], ends[2])
    upper = ends[1] < T
    low = tools.where(upper, ends[1], ends[0])
    high = tools.where(upper, ends[2], ends[1])
    width = 1 / high - 1 / low
    s = 2 * (1 / T - 1 / low) / width - 1
    rate = -2 / (width * T**2)
    # Both panels are evaluated and one is chosen at the end, as a traced temperature may be on either.
    terms = [tools.ones_like(s), s]
    slopes = [tools.zeros_like(s), tools.ones_like(s)]
    for _ in range(coefficients.shape[-1] - 2):
        # of the Chebyshev polynomials and of their derivatives, whose cosines have none at the ends
        slopes.append(2 * terms[-1] + 2 * s * slopes[-1] - slopes[-2])
        terms.append(2 * s * terms[-1] - terms[-2])
    polynomials = tools.stack(terms, axis=-1)
    derivatives = tools.stack(slopes, axis=-1)
    value = tools.where(upper, polynomials @ coefficients[1], polynomials @ coefficients[0])
    slope = tools.where(upper, derivatives @ coefficients[1], derivatives @ coefficients[0])
    return value, slope * rate


def temperature_of(coefficients, ends, logarithm, tools=jnp):
    """[K] Where a rising curve has a value, to rounding; that of its end beyond them."""
    samples = 1 / tools.linspace(1 / ends[0], 1 / ends[2], _SAMPLES)
    values, _ = curve(coefficients, ends, samples, tools)
    T = tools.interp(logarithm, values, samples)

    def step(_, T):
        value, slope = curve(coefficients, ends, T, tools)
        return tools.clip(T - (value - logarithm) / slope, ends[0], ends[2])

    # from a straight line between samples four steps reach rounding
    if tools is jnp:
        # a loop, as a step has a hundred sums and products of terms
        return lax.fori_loop(0, _STEPS, step, T)
    for number in range(_STEPS):
        T = step(number, T)
    return T


# ------------------------------------------------------------------- solving them
def solve_lines(
    components: tuple[str, ...],
    mass_fractions: np.ndarray,
    model: str,
    one_of_many: bool = False,
) -> SaturationLines | None:
    """Both lines of a composition; `None` where the mixture has none, as a gas above its critical point.

    Args:
        components: of the mixture; their vapour pressures give the first guess.
        mass_fractions: (n,) of sum one.
        model: by which they mix.
        one_of_many: whether to begin from the lines of a round composition nearby, which others are
            begun from as well: four times as fast. The result does not depend on what was solved before.
    """
    phases = PhaseModel(multi_fluid(components, model))
    with np.errstate(all="ignore"):
        marched = None
        if one_of_many:
            marched = _marched_beside(components, mass_fractions, model)
        if marched is None:
            marched = _marched(components, tuple(mass_fractions.tolist()), model)
        if marched is None:
            return None
        least = float(marched[0].T[0])
        critical = float(np.mean([_critical(line) for line in marched]))
        top = _END * critical
        if top < least + 20 or any(line.T[-1] < top for line in marched):
            return None
        # Densities have an infinite slope at the critical point, from which series on a panel suffer by
        # its width over its distance: equal ratios of both panels.
        middle = critical - np.sqrt((critical - least) * (critical - top))
        ends = np.array([least, middle, top])
        # (n + 1, panel, 2, nodes): value and slopes, of pressure and density
        dew_line, bubble_line = marched
        dew = _fitted(phases, mass_fractions, dew_line, ends)
        bubble = _fitted(phases, mass_fractions, bubble_line, ends)
    if dew is None or bubble is None:
        return None
    order = np.stack([dew[:, :, 0], bubble[:, :, 0], dew[:, :, 1], bubble[:, :, 1]], axis=2)
    return SaturationLines(
        ends=ends,
        coefficients=order[0],
        slopes=order[1:],
        reference=np.asarray(mass_fractions),
        critical=np.asarray(critical),
    )


@lru_cache(maxsize=128)
def _marched(
    components: tuple[str, ...], mass_fractions: tuple[float, ...], model: str
) -> tuple[Line, Line] | None:
    """Points along the dew and the bubble line; `None` where one is not found."""
    phases = PhaseModel(multi_fluid(components, model))
    z = np.maximum(phases.model.mole_fractions(np.array(mass_fractions)), 1e-12)
    least = max(FIRST_T, np.ceil(phases.model.limits[0] + 0.1))
    with np.errstate(all="ignore"):
        dew = march(phases, components, z, least, dew=True)
        bubble = march(phases, components, z, least, dew=False)
    return _long_enough(dew, bubble)


def _marched_beside(
    components: tuple[str, ...], mass_fractions: np.ndarray, model: str
) -> tuple[Line, Line] | None:
    """Those of a composition near a round one; `None` where they are too far apart."""
    near = np.maximum(_ROUND * np.round(mass_fractions / _ROUND), _LEAST_ROUND)
    near = near / near.sum()
    neighbours = _marched(components, tuple(near.tolist()), model)
    if neighbours is None:
        return None
    phases = PhaseModel(multi_fluid(components, model))
    z = np.maximum(phases.model.mole_fractions(mass_fractions), 1e-12)
    dew_neighbour, bubble_neighbour = neighbours
    dew = march_beside(phases, z, dew_neighbour)
    bubble = march_beside(phases, z, bubble_neighbour)
    return _long_enough(dew, bubble)


def _long_enough(dew: Line | None, bubble: Line | None) -> tuple[Line, Line] | None:
    if dew is None or bubble is None or min(dew.T.size, bubble.T.size) < _FEWEST:
        return None
    return dew, bubble


def _critical(line: Line) -> float:
    """[K] Where the densities of both phases meet: their difference goes with the cube root."""
    cube_before, last_cube = (separation(unknowns) ** 3 for unknowns in line.unknowns[-2:])
    return line.T[-1] + (line.T[-1] - line.T[-2]) * last_cube / (cube_before - last_cube)


def _fitted(phases: PhaseModel, mass_fractions, line: Line, ends) -> np.ndarray | None:
    """(n + 1, panel, 2, nodes) coefficients of ln(p) and ln(rho) and their derivatives along a line."""
    angles = np.pi * (np.arange(NODES) + 0.5) / NODES
    s = np.cos(angles)
    # in 1/T, over which the logarithms of pressure and density are nearly straight
    panels = pairwise(1 / np.asarray(ends))
    nodes = []
    for low, high in panels:
        nodes.append(low + (s + 1) / 2 * (high - low))
    inverse = np.concatenate(nodes)
    T = 1 / inverse
    rows = [np.interp(-inverse, -1 / line.T, column) for column in line.unknowns.T]
    z = np.tile(phases.model.mole_fractions(mass_fractions), (T.size, 1))
    z = np.maximum(z, 1e-12)
    points, good = solved(phases, z, Line(T, np.stack(rows, axis=1)))
    if not good.all():
        return None
    values = line_slopes(phases, mass_fractions, points)
    # (n + 1, 2, panel, nodes) at the nodes; their cosine transform has the coefficients
    values = values.reshape(*values.shape[:2], 2, NODES)
    cosines = np.cos(np.arange(NODES)[:, None] * angles) * 2 / NODES
    cosines[0] /= 2
    return np.moveaxis(values @ cosines.T, 1, 2)
