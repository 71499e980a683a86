r"""The periodic state the plain way: `scipy.integrate.solve_ivp` over the compiled law.

One revolution is integrated over crank angle between the kinks that geometry and gas give; load reversals
within a stroke are met unprepared. `scipy.optimize.root` finds the speed at the top dead centre (and
the level of the motor torque) for which the revolution ends as it began.
"""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from .._implicit import FixedPointReport
from .._status import Status
from ..compressor import Compressor, instants, kink_angles, loads_at
from ..crank import Energy, Orbit, acceleration, orbit_on_panels, panels
from ..design import AnalysisOptions, DesignResult, quantity
from ..machine import Machine
from ..mechanism import CrankState
from ..motor import MeanSpeed
from ._study import Call, Question, Setting, Solved

# Nodes on every panel at which speed and forces are reported, as many as the reference has.
_NODES = 24
# Angles of a revolution at constant speed, from which the first level of torque is taken.
_ANGLES = 256
# Revolutions that the search for the periodic state may integrate; it takes 8 to 12 as a rule.
_REVOLUTIONS = 25


def scipy_setting(question: Question, method: str, tolerance: float) -> Setting:
    """A setting of `solve_ivp`.

    Args:
        question: a quantity of the crank.
        method: of `solve_ivp`.
        tolerance: [-] relative tolerance of a step.
    """
    machine = question.compressor
    assert machine is not None

    def prepare():
        laws, edges = (
            _laws(question.design, machine, question.quantity),
            np.asarray(_edges(machine)),
        )
        return Call(lambda: Solved(*_solve(machine, *laws, edges, method, tolerance)))

    label = f"{method} rtol={tolerance:g}"
    return Setting("SciPy", label, prepare, (-np.log10(tolerance),), method)


def _edges(machine: Compressor):
    kinks = kink_angles(machine)
    return jnp.append(kinks, kinks[0] + 2 * jnp.pi)


def _laws(design: Machine, machine: Compressor, name: str):
    """Compiled functions: rates of speed, time and accounts; the value from the accounts."""

    @jax.jit
    def rate(angle, low, high, state, level):
        speed = state[0]
        motor = level * machine.motor.torque(speed)
        # a stage on an edge would pick the formula of either side at random
        inside = jnp.clip(angle, low + 1e-10, high - 1e-10)
        rise, conservative, loads = acceleration(machine, inside, speed, motor)
        accounts = [motor, -conservative, *loads.loss_torque.values()]
        return jnp.stack([rise / speed, 1 / speed, *accounts])

    @jax.jit
    def value(speed, level, accounts):
        found = DesignResult(design, AnalysisOptions())
        found.orbit = _orbit(machine, speed, level, accounts)
        return jnp.asarray(quantity(name).value(found), float)

    return rate, value


def _solve(machine: Compressor, rate, value, edges, method: str, tolerance: float):
    """The quantity, and the number of evaluations of the law."""
    scale = float(machine.motor.speed_guess)
    holds_speed = isinstance(machine.motor, MeanSpeed)
    size = np.asarray(rate(edges[0], edges[0], edges[1], np.array([scale, 0.0]), 1.0)).size
    calls = 0

    def revolution(unknowns, first_level, accounts=False):
        nonlocal calls
        level = first_level * unknowns[1] if holds_speed else 1.0
        state = np.zeros(size if accounts else 2)
        state[0] = unknowns[0] * scale
        # works of a revolution are measured against the motor's, times against the period
        unit = np.full(state.size, max(abs(first_level), 1e-12))
        unit[:2] = scale, 1 / scale
        speeds = []
        for low, high in pairwise(edges):
            if high - low < 1e-12:
                speeds.append(np.full(_NODES, state[0]))
                continue
            done = solve_ivp(
                lambda angle, y, low=low, high=high: np.asarray(rate(angle, low, high, y, level))[
                    : y.size
                ],
                (low, high),
                state,
                method=method,
                rtol=tolerance,
                atol=tolerance * unit,
                dense_output=accounts,
            )
            calls += done.nfev
            if not done.success:
                raise RuntimeError(done.message)
            state = done.y[:, -1]
            if accounts:
                inside = low + (high - low) * (np.polynomial.legendre.leggauss(_NODES)[0] + 1) / 2
                speeds.append(done.sol(inside)[0])
        return state, level, speeds

    def gap(unknowns, first_level):
        end, _, _ = revolution(unknowns, first_level)
        gaps = [end[0] / scale - unknowns[0]]
        if holds_speed:
            gaps.append(end[1] * scale / (2 * np.pi) - 1)
        return gaps

    first_level = _first_level(rate, edges, scale)
    start = np.ones(2) if holds_speed else np.ones(1)
    # The gap carries the error of the integration: its differences need a step well above that, and
    # the search must not go on below it.
    options = {"eps": max(1e-8, tolerance**0.5), "maxfev": _REVOLUTIONS}
    found = root(gap, start, first_level, tol=0.1 * tolerance, options=options)
    end, level, speeds = revolution(found.x, first_level, accounts=True)
    return float(value(np.stack(speeds), level, end[1:])), calls


def _first_level(rate, edges, scale: float) -> float:
    """Level of the motor torque that carries losses and gas at constant speed."""
    angles = np.linspace(edges[0], edges[-1], _ANGLES, endpoint=False)
    at = jax.vmap(rate, (0, None, None, None, None))
    rates = np.asarray(at(angles, edges[0], edges[-1], np.array([scale, 0.0]), 1.0))
    works = rates[:, 2:].sum(0)
    return float(works[1:].sum() / works[0])


def _orbit(machine: Compressor, speed, level, accounts) -> Orbit:
    """The orbit from the speed at the nodes of each panel and the accounts of the revolution."""
    grid = panels(_edges(machine), _NODES)
    motor = level * machine.motor.torque(speed)
    over = jax.vmap(jax.vmap(lambda a, w, m: acceleration(machine, a, w, m)[0]))
    state = CrankState(grid.angle, speed, over(grid.angle, speed, motor))
    loads = loads_at(machine, state)
    losses = dict(zip(loads.loss_torque, accounts[3:], strict=True))
    energy = Energy(accounts[1], accounts[2], losses)
    report = FixedPointReport(jnp.asarray(0), jnp.asarray(0.0), jnp.asarray(True))
    error = {
        name: jnp.zeros(()) for name in losses
    }  # of the tolerance, which SciPy does not report
    orbit = orbit_on_panels(
        grid,
        instants(machine, grid.angle),
        state,
        motor,
        loads,
        energy,
        error,
        Status.converged,
        report,
        "SciPy",
    )
    return eqx.tree_at(lambda o: o.mean_speed, orbit, 2 * jnp.pi / accounts[0])
