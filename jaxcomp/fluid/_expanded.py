r"""The mixture of liquid and vapour behind an expansion valve, on the host.

Liquid of the enthalpy $h$ expands to the pressure $p$ at constant enthalpy. Temperature, densities,
compositions $x_i$, $y_i$ of liquid and vapour and the share $q$ of vapour solve

$$\ln f_i' = \ln f_i'',\quad p' = p'' = p,\quad (1-q)x_i + q y_i = z_i,\quad \sum x_i = 1,\quad
(1-q)H' + qH'' = Mh$$

by Newton's method. Where an evaporator begins, its *mean* temperature is that of this mixture and of the
dew point, halved (EN 12900 and the guide of ASERCOM count by it beside the dew temperature).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._equilibrium import PhaseModel, first_point
from ._multi_fluid import multi_fluid
from ._saturation_lines import curve

_STEP = 1e-40  # of a complex step
_SETTLED = 1e-10  # largest last change of a logarithm
_STEPS = 40
_FEW = 1e-12  # mole fraction at least
_FIRST_SHARE = 0.2  # of vapour, usual behind an expansion valve


class Expanded(NamedTuple):
    """Temperature behind an expansion and how it moves.

    Attributes:
        T: [K]
        by_pressure: [K/Pa]
        by_enthalpy: [K kg/J]
        by_fractions: [K] (n,) by the mass fractions, which are normalised.
        unknowns: of the equations, from which a state nearby is sought.
    """

    T: float
    by_pressure: float
    by_enthalpy: float
    by_fractions: NDArray
    unknowns: NDArray


class _Inputs(NamedTuple):
    """Known numbers of the equations, complex ones as well."""

    pressure: complex  # [Pa]
    enthalpy: complex  # [J/kg]
    mass_fractions: NDArray


def expanded(
    phases: PhaseModel, mass_fractions: NDArray, p: float, h: float, unknowns: NDArray
) -> Expanded | None:
    """State at a pressure [Pa] and an enthalpy [J/kg]; `None` where there is none of two phases."""
    inputs = _Inputs(p, h, mass_fractions)
    jacobian = np.eye(unknowns.size)
    for _ in range(_STEPS):
        value = _misfit(phases, unknowns, inputs)
        jacobian = _along_unknowns(phases, unknowns, inputs)
        if not (np.isfinite(value).all() and np.isfinite(jacobian).all()):
            return None
        try:
            step = np.linalg.solve(jacobian, value)
        except np.linalg.LinAlgError:
            return None
        # a step of 20 % in a density at most, so that no phase goes over into the other
        unknowns = unknowns - step * min(1.0, 0.2 / np.abs(step).max())
        if np.abs(step).max() < _SETTLED:
            break
    else:
        return None
    if not 0 <= unknowns[-1] <= 1:
        return None
    T = float(np.exp(unknowns[0]))

    def moved(changed: _Inputs) -> float:
        change = np.imag(_misfit(phases, unknowns.astype(complex), changed)) / _STEP
        return float(-T * np.linalg.solve(jacobian, change)[0])

    fractions = []
    for row in np.eye(mass_fractions.size):
        fractions.append(moved(inputs._replace(mass_fractions=mass_fractions + 1j * _STEP * row)))
    return Expanded(
        T=T,
        by_pressure=moved(inputs._replace(pressure=p + 1j * _STEP)),
        by_enthalpy=moved(inputs._replace(enthalpy=h + 1j * _STEP)),
        by_fractions=np.array(fractions),
        unknowns=unknowns,
    )


def _misfit(phases: PhaseModel, unknowns: NDArray, inputs: _Inputs) -> NDArray:
    """(2 n + 4,) what is left of the equations, all of them relative."""
    count = inputs.mass_fractions.size
    T, liquid_density, vapour_density = np.exp(unknowns[:3])
    x, y = np.exp(unknowns[3:-1]).reshape(2, count)
    share = unknowns[-1]
    z = phases.model.mole_fractions(inputs.mass_fractions)
    mass = z @ phases.model.molar_mass
    temperatures = np.array([T, T])
    densities = np.array([liquid_density, vapour_density])
    fractions = np.stack([x, y])
    both_phases = phases.phase(temperatures, densities, fractions)
    enthalpy = phases.enthalpy(temperatures, densities, fractions, both_phases)
    thermal = phases.model.gas_constant * T
    # the liquid's pressure is a difference of large terms: over that of the vapour all the same
    pressures = (both_phases.pressure - inputs.pressure) / (thermal * vapour_density)
    mixed = (1 - share) * enthalpy[0] + share * enthalpy[1]
    return np.concatenate(
        [
            both_phases.log_fugacity[0] - both_phases.log_fugacity[1],
            pressures,
            (1 - share) * x + share * y - z,
            [x.sum() - 1, (mixed - mass * inputs.enthalpy) / thermal],
        ]
    )


def _along_unknowns(phases: PhaseModel, unknowns: NDArray, inputs: _Inputs) -> NDArray:
    columns = []
    for row in np.eye(unknowns.size):
        columns.append(np.imag(_misfit(phases, unknowns + 1j * _STEP * row, inputs)) / _STEP)
    return np.stack(columns, axis=1)


def evaporator(
    components: tuple[str, ...],
    model: str,
    mass_fractions: NDArray,
    dew_line: NDArray,
    ends: NDArray,
    mean: float,
    h: float,
) -> NDArray:
    """Dew temperature of an evaporator by its mean temperature.

    Args:
        components: of the mixture.
        model: by which they mix.
        mass_fractions: (n,) of sum one.
        dew_line: (2, nodes) of the logarithm of the pressure.
        ends: [K] (3,) of its panels.
        mean: [K] of the temperature behind the expansion and of the dew temperature.
        h: [J/kg] of the liquid before the expansion.

    Returns:
        (4 + n,) the dew temperature [K], and the temperature behind the expansion [K] with its
        derivatives to pressure, enthalpy and mass fractions; not a number where there is none.
    """
    no_solution = np.full(4 + mass_fractions.size, np.nan)
    phases = PhaseModel(multi_fluid(components, model))
    z = np.maximum(phases.model.mole_fractions(mass_fractions), _FEW)
    low, _, high = ends
    if not low < mean < high:
        return no_solution
    with np.errstate(all="ignore"):
        bubble, good = first_point(phases, components, mean, z, dew=False)
        if not good[0]:
            return no_solution
        liquid, vapour, *log_y = bubble.unknowns[0]
        ratio = np.exp(log_y) / z
        x = z / (1 + _FIRST_SHARE * (ratio - 1))
        x = x / x.sum()
        y = ratio * x
        unknowns = np.concatenate(
            [[np.log(mean), liquid, vapour], np.log(x), np.log(y / y.sum()), [_FIRST_SHARE]]
        )
        T = mean
        for _ in range(_STEPS):
            logarithm, slope = curve(dew_line, ends, np.asarray(T), np)
            p = float(np.exp(logarithm))
            state = expanded(phases, mass_fractions, p, h, unknowns)
            if state is None:
                return no_solution
            step = (state.T + T - 2 * mean) / (state.by_pressure * p * float(slope) + 1)
            unknowns = state.unknowns
            T = T - step
            if abs(step) < 1e-10 * T:
                return np.array(
                    [T, state.T, state.by_pressure, state.by_enthalpy, *state.by_fractions]
                )
    return no_solution
