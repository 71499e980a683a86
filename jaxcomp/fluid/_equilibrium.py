r"""Dew and bubble points of mixtures, on the host and for many temperatures at once.

A dew point is vapour of the mixture's composition $z$ beside a first drop of composition $y$; at a bubble
point liquid and vapour change places. At a given temperature the unknowns $\ln\rho_z, \ln\rho_y, \ln y_i$
solve

$$\ln f_i(T,\rho_z,z) = \ln f_i(T,\rho_y,y),\quad p(T,\rho_z,z) = p(T,\rho_y,y),\quad \sum y_i = 1$$

by Newton's method. Fugacities are analytic (Kunz and Wagner (2012), J. Chem. Eng. Data 57, 3032, Eq. (29)
and Appendix), Jacobians come from complex steps, which round as the values do. Compiled, one such point
would take longer than the program of a whole machine: here nothing is compiled.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._helmholtz import ancillary_pressure, fluid_data
from ._multi_fluid import MultiFluid

_STEP = 1e-40  # of a complex step: far below rounding, so that its square is exactly lost
_FEW = 1e-12  # mole fraction at least, as the fugacity of what is not there has no logarithm
# The same of a first drop or bubble: of water in decane there is less than 1e-20, and Newton's method,
# which changes a logarithm by 0.3 a step, would not get there from far.
_FEW_AT_FIRST = 1e-60
_SETTLED = 1e-11  # largest last change of a logarithm
# Of the densities of both phases, difference over sum: at 0.985 of the critical temperature it is 0.4.
_NEAR_CRITICAL = 0.3
FIRST_T = 210.0  # [K] where lines begin, unless a component is solid there
_MARCH = 10.0  # [K] steps along the lines


class Phase(NamedTuple):
    """A fluid phase in n-component batches of b.

    Attributes:
        log_fugacity: (b, n) of [Pa].
        pressure: [Pa] (b,)
        residual_energy: [-] (b,) internal energy above that of the ideal gas, over R T.
    """

    log_fugacity: NDArray
    pressure: NDArray
    residual_energy: NDArray


class PhaseModel:
    """Pressure and fugacities of a mixture for arrays of NumPy, complex ones as well."""

    def __init__(self, model: MultiFluid):
        self.model = model
        count = len(model.molar_mass)
        # Rows are summed by their weight: of a component, or of a pair with a departure function.
        keys = []
        for weights in model.weights.values():
            for first, second, factor in zip(*weights, strict=True):
                keys.append((int(first), int(second), float(factor)))
        groups = sorted(set(keys))
        place = {key: index for index, key in enumerate(groups)}
        first_places, second_places, factors = zip(*groups, strict=True)
        self._first = np.array(first_places)
        self._second = np.array(second_places)
        self._factor = np.array(factors)
        self._is_pair = self._second < count
        # (pairs, n) from the slopes of pairs to those of their components
        self._of_first, self._of_second = np.eye(count)[model.pairs]
        rows = np.array([place[key] for key in keys])
        # sorted, so that a group is a run of rows: a product with a matrix of ones took most of the time
        self._order = np.argsort(rows, kind="stable")
        self._starts = np.searchsorted(rows[self._order], np.arange(len(groups)))

    def reducing(self, x):
        """[K], [m^3/mol] (b,) reducing values at mole fractions (b, n), and their gradients (b, n)."""
        model = self.model
        i, j = model.pairs
        first = x[:, i]
        second = x[:, j]
        total = first + second

        def mixed(pure, shape, mean):
            denominator = shape * first + second
            term = 2 * mean * first * second * total / denominator
            value = (x**2 * pure).sum(1) + term.sum(1)
            by_first = (
                2 * mean * second * (total + first) / denominator - shape * term / denominator
            )
            by_second = 2 * mean * first * (total + second) / denominator - term / denominator
            gradient = 2 * x * pure + by_first @ self._of_first + by_second @ self._of_second
            return value, gradient

        T_r, T_slope = mixed(model.T_r, model.shape_T, model.mean_T)
        v_r, v_slope = mixed(model.v_r, model.shape_v, model.mean_v)
        return T_r, v_r, T_slope, v_slope

    def phase(self, T, density, x) -> Phase:
        """A phase at temperatures [K] (b,), densities [mol/m^3] (b,) and mole fractions (b, n)."""
        T_r, v_r, T_slope, v_slope = self.reducing(x)
        value, along_d, along_t = self._sums(T_r / T, density * v_r)
        # Rows of a component have the number behind the last one as their second, with a factor of one.
        padded = np.concatenate([x, np.ones_like(x[:, :1])], axis=1)
        weights = self._factor * padded[:, self._first] * padded[:, self._second]
        energy = (weights * value).sum(1)
        delta_slope = (weights * along_d).sum(1)
        tau_slope = (weights * along_t).sum(1)
        # by the composition at the same tau and delta
        gradient = np.zeros_like(x, dtype=np.result_type(x, value))
        by_first = self._factor * padded[:, self._second] * value
        by_second = self._factor * padded[:, self._first] * value
        for group in range(self._first.size):
            gradient[:, self._first[group]] += by_first[:, group]
            if self._is_pair[group]:
                gradient[:, self._second[group]] += by_second[:, group]

        def along_amount(slope):
            return slope - (x * slope).sum(1, keepdims=True)

        potential = energy[:, None] + along_amount(gradient)
        potential = potential + delta_slope[:, None] * (1 + along_amount(v_slope) / v_r[:, None])
        potential = potential + tau_slope[:, None] * along_amount(T_slope) / T_r[:, None]
        ideal = self.model.gas_constant * T * density
        fugacity = np.log(x) + np.log(ideal)[:, None] + potential
        return Phase(fugacity, ideal * (1 + delta_slope), tau_slope)

    def enthalpy(self, T, density, x, phase: Phase):
        """[J/mol] (b,) of a phase, in the reference state of the mixture's ideal part."""
        thermal = self.model.gas_constant * T
        energy = self._ideal_energy(T, x) + phase.residual_energy
        return thermal * energy + phase.pressure / density

    def _ideal_energy(self, T, x):
        """[-] (b,) internal energy of the ideal gas over R T."""
        model = self.model
        tau = (1 / T)[:, None]
        amounts = model.ratio * x
        energy = (amounts * (model.lead[:, 1] * tau + model.log)).sum(1)
        n, t = model.ideal["power"].T
        energy = energy + (amounts[:, model.ideal_of["power"]] * n * t * tau**t).sum(1)
        n, c, d, theta = model.ideal["planck"].T
        exponential = d * np.exp(theta * tau)
        shares = n * theta * tau * exponential / (c + exponential)
        return energy + (amounts[:, model.ideal_of["planck"]] * shares).sum(1)

    def _sums(self, tau, delta):
        """Energy and its slopes along ln(delta) and ln(tau) by group, (b, groups) each."""
        tau = tau[:, None]
        delta = delta[:, None]
        log_tau = np.log(tau)
        log_delta = np.log(delta)
        rows = []
        for family, table in self.model.residual.items():
            rows.append(_RULES[family](table.T, tau, delta, log_tau, log_delta))

        def by_group(parts):
            terms = np.concatenate(parts, axis=1)[:, self._order]
            return np.add.reduceat(terms, self._starts, axis=1)

        return list(map(by_group, zip(*rows, strict=True)))


def _power(columns, tau, delta, log_tau, log_delta):
    n, t, d, power = columns
    # l = 0 marks terms that have no exp(-delta^l)
    damping = np.where(power > 0, np.exp(power * log_delta), 0.0)
    x = n * np.exp(t * log_tau + d * log_delta - damping)
    return x, x * (d - power * damping), x * t


def _exponential(columns, tau, delta, log_tau, log_delta):
    n, t, d, power, g, m = columns
    damping = g * np.exp(power * log_delta)
    warmth = np.where(m > 0, np.exp(m * log_tau), 0.0)
    x = n * np.exp(t * log_tau + d * log_delta - damping - warmth)
    return x, x * (d - power * damping), x * (t - m * warmth)


def _gaussian(columns, tau, delta, log_tau, log_delta):
    n, t, d, eta, epsilon, beta, gamma = columns
    off = delta - epsilon
    far = tau - gamma
    x = n * np.exp(t * log_tau + d * log_delta - eta * off**2 - beta * far**2)
    return x, x * (d - 2 * eta * delta * off), x * (t - 2 * beta * tau * far)


def _gao(columns, tau, delta, log_tau, log_delta):
    n, t, d, eta, epsilon, beta, gamma, b = columns
    off = delta - epsilon
    far = tau - gamma
    base = b + beta * far**2
    x = n * np.exp(t * log_tau + d * log_delta + eta * off**2 + 1 / base)
    return x, x * (d + 2 * eta * delta * off), x * (t - 2 * beta * tau * far / base**2)


def _non_analytic(columns, tau, delta, log_tau, log_delta):
    n, a, b, beta, A, B, C, D = columns
    off = delta - 1
    square = off**2
    theta = 1 - tau + A * square ** (1 / (2 * beta))
    distance = theta**2 + B * square**a
    theta_d = A / beta * off * square ** (1 / (2 * beta) - 1)
    distance_d = 2 * theta * theta_d + 2 * a * B * off * square ** (a - 1)
    x = n * distance**b * delta * np.exp(-C * square - D * (tau - 1) ** 2)
    along_d = 1 + delta * (b * distance_d / distance - 2 * C * off)
    along_t = tau * (-2 * b * theta / distance - 2 * D * (tau - 1))
    return x, x * along_d, x * along_t


_RULES = {
    "power": _power,
    "exponential": _exponential,
    "gaussian": _gaussian,
    "gao": _gao,
    "non_analytic": _non_analytic,
}


# ------------------------------------------------------------------- Newton's method
class Line(NamedTuple):
    """Points of the dew or the bubble line.

    Attributes:
        T: [K] (b,)
        unknowns: (b, n + 2) ln(density) [mol/m^3] of the mixture and of the first of the other phase, and
            logarithms of the mole fractions of the latter.
    """

    T: NDArray
    unknowns: NDArray


def _misfit(model: PhaseModel, T, z, unknowns):
    """(b, n + 2) what is left of the equations."""
    fractions = np.exp(unknowns[:, 2:])
    mixture = model.phase(T, np.exp(unknowns[:, 0]), z)
    other = model.phase(T, np.exp(unknowns[:, 1]), fractions)
    balance = mixture.log_fugacity - other.log_fugacity
    # over the smaller of both scales: a liquid's pressure is a difference of large terms
    scale = model.model.gas_constant * T * np.exp(unknowns[:, :2].real.min(axis=1))
    pressure = (mixture.pressure - other.pressure) / scale
    closure = fractions.sum(1) - 1
    return np.concatenate([balance, pressure[:, None], closure[:, None]], axis=1)


def _misfit_at_density(model: PhaseModel, log_density, z, unknowns):
    """(b, n + 2) of a mixture with known density, whose unknowns begin with ln(T) instead."""
    densities = np.concatenate([log_density[:, None], unknowns[:, 1:]], axis=1)
    return _misfit(model, np.exp(unknowns[:, 0]), z, densities)


def _jacobian(misfit: Callable[..., NDArray], inputs: Sequence[NDArray], unknowns: NDArray):
    # By complex steps: exact to rounding, where differences would lose half of the digits and a rule
    # written out would be a second set of terms. All steps of all points are one batch: of a single
    # point most of the time is that of calling.
    batch, count = unknowns.shape
    moved = np.repeat(unknowns.astype(complex), count, axis=0)
    moved += 1j * _STEP * np.tile(np.eye(count), (batch, 1))
    repeated = [np.repeat(column, count, axis=0) for column in inputs]
    slopes = np.imag(misfit(*repeated, moved)) / _STEP
    return np.swapaxes(slopes.reshape(batch, count, -1), 1, 2)


def solved(model: PhaseModel, z, line: Line, steps: int = 40) -> tuple[Line, NDArray]:
    """Points of equilibrium near those of a line, and (b,) whether Newton's method settled there.

    Args:
        model: of the mixture.
        z: (b, n) mole fractions of the mixture.
        line: where to begin.
        steps: at most.
    """
    T, unknowns = line
    unknowns, settled = _newton(partial(_misfit, model), (T, z), unknowns, steps)
    # two phases of one density are the trivial solution, which satisfies every equation
    apart = np.abs(unknowns[:, 0] - unknowns[:, 1]) > 1e-3
    return Line(T, unknowns), settled & apart


def solved_at_density(
    model: PhaseModel, z, log_density, line: Line, steps: int = 40
) -> tuple[Line, NDArray]:
    """Points of equilibrium of a mixture with known densities, whose temperatures are unknown.

    Along a dew line with a retrograde part the temperature has a maximum, and the density rises.

    Args:
        model: of the mixture.
        z: (b, n) mole fractions of the mixture.
        log_density: (b,) of [mol/m^3].
        line: where to begin.
        steps: at most.
    """
    start = np.concatenate([np.log(line.T)[:, None], line.unknowns[:, 1:]], axis=1)
    misfit = partial(_misfit_at_density, model)
    roots, settled = _newton(misfit, (log_density, z), start, steps)
    unknowns = np.concatenate([log_density[:, None], roots[:, 1:]], axis=1)
    apart = np.abs(unknowns[:, 0] - unknowns[:, 1]) > 1e-3
    return Line(np.exp(roots[:, 0]), unknowns), settled & apart


def _newton(
    misfit: Callable[..., NDArray], inputs: Sequence[NDArray], unknowns: NDArray, steps: int
) -> tuple[NDArray, NDArray]:
    """Roots (b, k) of a batch of equations near a start, and (b,) whether they settled there.

    Args:
        misfit: of its inputs, each (b, ...), and of the unknowns.
        inputs: of the equations.
        unknowns: (b, k) where to begin.
        steps: at most.
    """
    change = np.full(unknowns.shape[0], np.inf)
    for _ in range(steps):
        value = misfit(*inputs, unknowns)
        jacobian = _jacobian(misfit, inputs, unknowns)
        good = np.isfinite(jacobian).all((1, 2)) & np.isfinite(value).all(1)
        # a point that is lost must not stop the solution of all others, which go through together
        jacobian[~good] = np.eye(value.shape[1])
        value[~good] = np.nan
        try:
            step = np.linalg.solve(jacobian, value[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return unknowns, np.zeros(unknowns.shape[0], bool)
        change = np.abs(step).max(1)
        # a step of 30 % in a density at most, so that no phase goes over into the other
        unknowns = unknowns - step * np.minimum(1.0, 0.3 / np.maximum(change, 1e-300))[:, None]
        if not (change > _SETTLED).any():
            break
    return unknowns, change < 1e3 * _SETTLED


# ------------------------------------------------------------------- the first point
def wilson_pressures(components, T: float) -> NDArray:
    """[Pa] (n,) vapour pressures of components [K], also beyond their critical points.

    Source: Wilson (1968), A modified Redlich-Kwong equation of state, with the acentric factors of the
    vapour pressure curves.
    """
    pressures = []
    for name in components:
        curve = fluid_data(name)["dew_pressure"]
        critical = curve["T_r"]
        reducing = curve["reducing_value"]
        # by its definition, from the vapour pressure at 0.7 of the critical temperature
        acentric = -1 - np.log10(ancillary_pressure(curve, 0.7 * critical) / reducing)
        pressures.append(reducing * np.exp(5.373 * (1 + acentric) * (1 - critical / T)))
    return np.array(pressures)


def _density(model: PhaseModel, T, p, x, liquid: bool):
    """[mol/m^3] of one phase: from far below the gas's density, or from above the liquid's."""
    temperature = np.array([T])
    row = x[None]
    gas_constant = model.model.gas_constant
    _, v_r, *_ = model.reducing(row)
    logarithm = np.log(p / (gas_constant * T))
    longest = -0.5, 0.3
    if liquid:
        # a liquid's pressure rises so steeply that a longer step would leave the phase
        logarithm = np.log(3.2 / v_r[0])
        longest = -0.1, 0.02
    for _ in range(60):
        moved = np.array([logarithm + 1j * _STEP])
        pressure = model.phase(temperature.astype(complex), np.exp(moved), row).pressure[0]
        slope = max(pressure.imag / _STEP, 1e-3 * gas_constant * T * np.exp(logarithm))
        step = np.clip((p - pressure.real) / slope, *longest)
        logarithm += step
        if abs(step) < 1e-9:
            break
    return logarithm


def first_point(model: PhaseModel, components, T: float, z, dew: bool) -> tuple[Line, NDArray]:
    """A dew or bubble point at a temperature [K] from Wilson's and some substitutions."""
    pure = wilson_pressures(components, T)
    # Raoult's law: at the dew point the liquid has x_i = z_i p/p_i, at the bubble point the vapour
    # y_i = z_i p_i/p
    if dew:
        pressure = 1 / (z / pure).sum()
        other = z * pressure / pure
    else:
        pressure = (z * pure).sum()
        other = z * pure / pressure
    return point_near(model, T, pressure, z, other, dew)


def point_near(model: PhaseModel, T: float, pressure, z, other, dew: bool) -> tuple[Line, NDArray]:
    """A dew or bubble point at a temperature [K] from a pressure [Pa] and the other phase's fractions."""
    densities = np.zeros(2)
    for _ in range(12):
        other = np.maximum(other / other.sum(), _FEW_AT_FIRST)
        rows = np.stack([z, other])
        of_mixture = _density(model, T, pressure, z, liquid=not dew)
        of_other = _density(model, T, pressure, other, liquid=dew)
        densities = np.array([of_mixture, of_other])
        phases = model.phase(np.full(2, T), np.exp(densities), rows)
        # f_i = x_i phi_i p in both: what the other phase should have of each component
        ratio = np.exp(phases.log_fugacity[0] - phases.log_fugacity[1])
        other = other * ratio
        total = other.sum()
        pressure = pressure / total if dew else pressure * total
    start = np.concatenate([densities, np.log(np.maximum(other / other.sum(), _FEW_AT_FIRST))])
    return solved(model, z[None], Line(np.array([T]), start[None]))


def march(model: PhaseModel, components, z, least: float, dew: bool) -> Line | None:
    """Points along a line from a temperature [K] to near the critical point, or `None` without any."""
    line, good = first_point(model, components, least, z, dew)
    if not good[0]:
        return None
    return _continued(model, z, line)


def march_beside(model: PhaseModel, z, neighbour: Line) -> Line | None:
    """Points along a line of mole fractions near those of another line, or `None` where that is too far.

    All points of the neighbour are solved at once; only those near the critical point, which moves, are
    marched to.
    """
    rows = np.tile(z, (neighbour.T.size, 1))
    line, good = solved(model, rows, neighbour, 12)
    apart = [separation(unknowns) > _NEAR_CRITICAL for unknowns in line.unknowns]
    near = np.abs(line.unknowns[:, :2] - neighbour.unknowns[:, :2]).max(1) < 0.5
    usable = good & near & np.array(apart)
    # up to the first that is not: a line has no holes
    count = int(np.argmin(np.append(usable, False)))
    if count < 2:
        return None
    return _continued(model, z, Line(line.T[:count], line.unknowns[:count]))


def _continued(model: PhaseModel, z, line: Line) -> Line:
    """A line with further points towards the critical point, in steps that halve where one fails."""
    points = [*line.unknowns]
    T = [*line.T]
    step = _MARCH
    while step > 0.5:
        after = T[-1] + step
        start = points[-1]
        if len(points) > 1:
            # in 1/T, over which all unknowns are nearly straight
            share = (1 / after - 1 / T[-1]) / (1 / T[-1] - 1 / T[-2])
            start = start + share * (points[-1] - points[-2])
        point, good = solved(model, z[None], Line(np.array([after]), start[None]), 12)
        # far from where it was sought, a solution belongs to another branch
        if not good[0] or np.abs(point.unknowns[0, :2] - start[:2]).max() > 0.5:
            step /= 2
            continue
        points.append(point.unknowns[0])
        T.append(after)
        if separation(point.unknowns[0]) < _NEAR_CRITICAL:
            break
    return Line(np.array(T), np.array(points))


def separation(unknowns) -> float:
    """[-] How far the densities of both phases differ: difference over sum."""
    first, second = np.exp(unknowns[:2])
    return abs(first - second) / (first + second)


def line_slopes(model: PhaseModel, mass_fractions, line: Line) -> NDArray:
    """Logarithms of pressure and density of the mixture along a line, and their derivatives.

    By the implicit function theorem: the unknowns move so that the equations stay solved.

    Args:
        model: of the mixture.
        mass_fractions: (n,) that were solved, of sum one.
        line: (b,) points of equilibrium.

    Returns:
        (n + 1, 2, b) the values, and their derivatives to each mass fraction, which are normalised.
    """
    T, unknowns = line
    count = T.size
    mass = model.model.molar_mass

    def mole_fractions(w):
        return np.tile(np.maximum(model.model.mole_fractions(w), _FEW), (count, 1))

    def logarithms(log_density, w):
        x = mole_fractions(w)
        pressure = model.phase(T, np.exp(log_density), x).pressure
        return np.stack([np.log(pressure), log_density + np.log(x @ mass)])

    w = np.asarray(mass_fractions, float)
    jacobian = _jacobian(partial(_misfit, model), (T, mole_fractions(w)), unknowns)
    rows = [logarithms(unknowns[:, 0], w)]
    for component in range(w.size):
        moved = w.astype(complex)
        moved[component] += 1j * _STEP
        # np.maximum orders complex numbers by their real parts, so that the step survives
        change = np.imag(_misfit(model, T, mole_fractions(moved), unknowns)) / _STEP
        motion = -np.linalg.solve(jacobian, change[..., None])[:, 0, 0]
        rows.append(np.imag(logarithms(unknowns[:, 0] + 1j * _STEP * motion, moved)) / _STEP)
    return np.array(rows)
