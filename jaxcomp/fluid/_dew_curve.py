r"""Dew curve of a gas whose components are far apart: natural gas, process gas, moist air.

Such a curve is retrograde: its temperature has a maximum (the cricondentherm), and above that pressure
gas condenses where it *expands*. Along the curve the density rises all the same, so that the temperature
is a function of it, and gas of any density is wet below that temperature. The curve is solved once for a
composition, on the host, from a low pressure to near its critical point.
"""

from functools import lru_cache
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from ._equilibrium import (
    Line,
    PhaseModel,
    point_near,
    separation,
    solved_at_density,
    wilson_pressures,
)
from ._multi_fluid import multi_fluid

# [Pa] where curves begin, below the suction of all machines but vacuum pumps.
_FIRST_P = 1e4
_STEP = 0.3  # in the logarithm of the density, from point to point
_LEAST_STEP = 0.02
_MOST_POINTS = 80
SAMPLES = 64  # of the stored curve: straight lines between them err by a few hundredths of a kelvin
# Of the densities of both phases, difference over sum, short of the critical point.
_NEAR_CRITICAL = 0.1
# [K] between which the first point is sought.
_COLDEST = 60.0
_HOTTEST = 700.0
_COLDEST_WATER = 250.0
_TRACE = 1e-10  # mole fraction below which water alone makes no drop


class DewCurve(eqx.Module):
    """Temperatures at which a gas begins to condense.

    Attributes:
        log_density: (k,) of [kg/m^3], rising.
        temperature: [K] (k,)
        log_pressure: (k,) of [Pa].
    """

    log_density: Float[Array, " k"]
    temperature: Float[Array, " k"]
    log_pressure: Float[Array, " k"]

    def temperature_at_density(self, rho, tools=jnp):
        """[K] At densities [kg/m^3]; zero beyond both ends, where nothing is known."""
        return self._temperature(self.log_density, rho, tools)

    def temperature_at_pressure(self, p, tools=jnp):
        """[K] At pressures [Pa] up to the highest of the curve; zero beyond both ends."""
        return self._temperature(self.log_pressure, p, tools)

    def _temperature(self, along, value, tools):
        rows = along, self.temperature
        if tools is np:
            rows = [np.asarray(row) for row in rows]
        return tools.interp(tools.log(value), *rows, left=0.0, right=0.0)


@lru_cache(maxsize=128)
def solve_dew_curve(
    components: tuple[str, ...], mass_fractions: tuple[float, ...], model: str
) -> DewCurve | None:
    """Dew curve of a composition; `None` where none is found, so that wet gas is not recognised.

    Where there is water, drops of it are sought beside those of the other components, and the warmer
    curve counts.

    Args:
        components: of the mixture.
        mass_fractions: (n,) of sum one.
        model: by which they mix.
    """
    phases = PhaseModel(multi_fluid(components, model))
    z = np.maximum(phases.model.mole_fractions(np.array(mass_fractions)), 1e-12)
    with np.errstate(all="ignore"):
        curves = []
        for drop in _first_drops(components, z):
            curve = _marched(phases, drop, z)
            if curve is not None:
                curves.append(curve)
    if not curves:
        return None
    return _warmest(phases, curves, z)


class _Drop(NamedTuple):
    """First drop of a gas: temperature [K], pressure [Pa] and mole fractions (n,)."""

    T: float
    p: float
    fractions: NDArray


def _first_drops(components, z) -> list[_Drop]:
    """Drops by Raoult's law, of all but water and of water, at a low pressure.

    The equation of water says nothing below where it freezes, whatever the pressure.
    """
    is_water = np.array([name == "water" for name in components])
    # hardly anything of the one dissolves in the other
    drops = []
    for kind, coldest in ((~is_water, _COLDEST), (is_water, _COLDEST_WATER)):
        if z[kind].sum() < _TRACE:
            continue
        cold = coldest
        hot = _HOTTEST
        for _ in range(40):
            middle = (cold + hot) / 2
            shares = z * _FIRST_P / wilson_pressures(components, middle)
            if shares[kind].sum() > 1:
                cold = middle
            else:
                hot = middle
        shares = z / wilson_pressures(components, hot)
        p = 1 / shares[kind].sum()
        drops.append(_Drop(hot, p, np.where(kind, shares * p, _TRACE)))
    return drops


def _marched(phases: PhaseModel, drop: _Drop, z) -> Line | None:
    """Points of a curve from a first drop; `None` where there is no equilibrium."""
    line, good = point_near(phases, drop.T, drop.p, z, drop.fractions, dew=True)
    if not good[0]:
        return None
    temperatures = [float(line.T[0])]
    points = [line.unknowns[0]]
    step = _STEP
    while step > _LEAST_STEP and len(points) < _MOST_POINTS:
        start = points[-1]
        log_T = np.log(temperatures[-1])
        if len(points) > 1:
            share = step / (points[-1][0] - points[-2][0])
            start = start + share * (points[-1] - points[-2])
            log_T = log_T + share * np.log(temperatures[-1] / temperatures[-2])
        density = np.array([points[-1][0] + step])
        guess = Line(np.exp(np.array([log_T])), start[None])
        point, good = solved_at_density(phases, z[None], density, guess, 12)
        # far from where it was sought, a solution belongs to another branch
        if not good[0] or np.abs(np.log(point.T[0]) - log_T) > 0.1:
            step /= 2
            continue
        temperatures.append(float(point.T[0]))
        points.append(point.unknowns[0])
        if separation(points[-1]) < _NEAR_CRITICAL or point.T[0] > _HOTTEST:
            break
    if len(points) < 5:
        return None
    return Line(np.array(temperatures), np.array(points))


def _warmest(phases: PhaseModel, curves: list[Line], z) -> DewCurve:
    """The warmest of several curves over common densities, up to where its pressure is highest."""
    first = min(curve.unknowns[0, 0] for curve in curves)
    densest = max(curve.unknowns[-1, 0] for curve in curves)
    log_density = np.linspace(first, densest, SAMPLES)
    rows = []
    for curve in curves:
        # smooth along the density, even past the highest temperature
        from scipy.interpolate import CubicSpline  # not for machines without such a gas

        spline = CubicSpline(curve.unknowns[:, 0], curve.T)
        inside = (curve.unknowns[0, 0] <= log_density) & (log_density <= curve.unknowns[-1, 0])
        rows.append(np.where(inside, spline(log_density), 0.0))
    T = np.max(rows, axis=0)
    fractions = np.tile(z, (T.size, 1))
    pressure = phases.phase(T, np.exp(log_density), fractions).pressure
    # beyond the highest pressure the curve comes down to its critical point
    rising = np.maximum.accumulate(np.log(pressure))
    mass = float(z @ phases.model.molar_mass)
    return DewCurve(log_density + np.log(mass), T, rising)
