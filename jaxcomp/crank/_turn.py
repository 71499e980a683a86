"""From a solved motion at panel nodes to the orbit that users see."""

import jax
import jax.numpy as jnp
from jax import lax

from .._implicit import FixedPointReport
from ..compressor import Compressor, conservative_torque, cylinder_pressure, gas_force
from ._orbit import Energy, Orbit
from ._panels import Panels


def orbit_on_panels(
    compressor: Compressor,
    grid: Panels,
    state,
    motor_torque,
    loads,
    energy: Energy,
    status,
    report: FixedPointReport,
    solver: str,
) -> Orbit:
    """Flatten panels to one row of nodes and add time, pressure and the extremes of speed.

    Args:
        compressor: the machine.
        grid: panels of the turn with their nodes.
        state: angle, speed and acceleration at the nodes, (panels, nodes) each.
        motor_torque: [N m] (panels, nodes).
        loads: joint loads at the nodes.
        energy: balance of the turn.
        status: how the solver ended.
        report: residual and iterations of the solver.
        solver: its name.
    """
    elapsed, at_edges = grid.cumulative(1 / state.speed)
    pressure = None if compressor.gas is None else cylinder_pressure(compressor, grid.angle)
    gas = gas_force(compressor, grid.angle)

    def flat(values):
        return values.reshape(*values.shape[:-2], -1)

    return Orbit(
        state=jax.tree.map(flat, state),
        weight=flat(grid.weight),
        time=flat(elapsed),
        pressure=None if pressure is None else flat(pressure),
        gas_torque=flat(conservative_torque(compressor, grid.angle, gas)),
        motor_torque=flat(motor_torque),
        loads=jax.tree.map(flat, loads),
        energy=energy,
        mean_speed=2 * jnp.pi / at_edges[-1],
        lowest_speed=-_highest(grid, -state.speed),
        highest_speed=_highest(grid, state.speed),
        status=status,
        residual=report.change,
        iterations=report.steps,
        solver=solver,
    )


def _highest(grid: Panels, values):
    """Largest value of the panel polynomials.

    Its place needs no derivative: the slope vanishes there.
    """
    fixed = lax.stop_gradient(values)
    x = jnp.linspace(0.0, 1.0, 2 * values.shape[1] + 1)
    samples = grid.evaluate(fixed[:, None, :], jnp.broadcast_to(x, (values.shape[0], x.size)))
    panel, column = jnp.unravel_index(jnp.argmax(samples), samples.shape)
    curve = jax.grad(lambda place: grid.evaluate(fixed[panel], place))
    bend = jax.grad(curve)

    def newton(_, place):
        step = curve(place) / jnp.minimum(bend(place), -1e-300)
        return jnp.clip(place - step, x[column] - x[1], x[column] + x[1])

    place = lax.fori_loop(0, 4, newton, x[column])
    return grid.evaluate(values[panel], lax.stop_gradient(jnp.clip(place, 0.0, 1.0)))
