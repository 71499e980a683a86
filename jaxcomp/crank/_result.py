"""From a solved motion at panel nodes to the orbit that users see."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._implicit import FixedPointReport
from ..compressor import Instants
from ..friction import magnitude
from ._orbit import Energy, Orbit
from ._panels import Panels, highest


def orbit_on_panels(
    grid: Panels,
    at: Instants,
    state,
    motor_torque,
    loads,
    energy: Energy,
    loss_error: dict[str, Float[Array, ""]],
    status,
    report: FixedPointReport,
    solver: str,
) -> Orbit:
    """Flatten panels to one row of nodes and add time and the extremes of speed.

    Args:
        grid: panels of the revolution with their nodes.
        at: what the crank angle decides at the nodes, (panels, nodes) each.
        state: angle, speed and acceleration at the nodes.
        motor_torque: [N m] at the nodes.
        loads: joint loads at the nodes.
        energy: balance of the revolution.
        loss_error: [J] estimated error of the losses, by joint.
        status: how the solver ended.
        report: residual and iterations of the solver.
        solver: its name.
    """
    elapsed, at_edges = grid.cumulative(1 / state.speed)
    find = jax.vmap(partial(highest, grid.rule, grid.width))
    extremes = find(jnp.stack([-state.speed, state.speed]))

    sizes = magnitude(*jnp.stack(list(loads.forces.values()), axis=1))
    peaks = find(sizes)
    terms = jnp.abs(lax.stop_gradient(sizes) @ grid.rule.to_legendre.T)
    error = jnp.max(terms[..., -2] + terms[..., -1], axis=-1)

    def flat(values):
        # sizes in full: a mechanism may have no near-zero loads, and -1 has no meaning then
        return values.reshape(*values.shape[:-2], values.shape[-2] * values.shape[-1])

    return Orbit(
        state=jax.tree.map(flat, state),
        weight=flat(grid.weight),
        time=flat(elapsed),
        pressure=None if at.pressure is None else flat(at.pressure),
        gas_torque=flat(at.conservative),
        motor_torque=flat(motor_torque),
        loads=jax.tree.map(flat, loads),
        energy=energy,
        loss_error=loss_error,
        peak_forces=dict(zip(loads.forces, peaks, strict=True)),
        peak_error=dict(zip(loads.forces, error, strict=True)),
        mean_speed=2 * jnp.pi / at_edges[-1],
        lowest_speed=-extremes[0],
        highest_speed=extremes[1],
        status=status,
        residual=report.change,
        resolution=_resolution(grid, lax.stop_gradient(state.speed)),
        iterations=report.steps,
        solver=solver,
        panel_nodes=grid.rule.nodes.size,
    )


def _resolution(grid: Panels, speed: Float[Array, "p s"]) -> Float[Array, ""]:
    terms = jnp.abs(speed @ grid.rule.to_legendre.T)
    swing = jnp.max(speed) - jnp.min(speed)
    # a swing below a millionth of the speed is of no interest, and ends in rounding
    return jnp.max(terms[:, -2] + terms[:, -1]) / (swing + 1e-6 * jnp.max(speed))
