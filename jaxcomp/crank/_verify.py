"""An independent march of one revolution from a found periodic state, by diffrax over crank angle.

It begins with the speed and the motor torque that were found at the first node and is told nothing
else of the solution: steps end at the kinks that geometry and gas give, load reversals are met
unprepared. What it arrives at tells the error of speed, losses and peaks, which the closure of the
energy cannot: an orbit of too few nodes closes its energy as well as any other.
"""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .._status import Status
from ..compressor import Compressor, instants, kink_angles, loads_at
from ..friction import magnitude
from ..mechanism import CrankState
from ._closure import closure_of
from ._motion import Instantaneous, solve_motion
from ._orbit import Energy, Orbit, Verification
from ._transient import TimeIntegration


def march_options() -> TimeIntegration:
    """What `verify=True` marches with: an eighth-order method, and forces at 4000 angles.

    Its step errors are far below those of an orbit: measured on the bundled machines, at 1e-12 losses
    agree with those of 24 nodes to 5e-9 of each, at 1e-10 to 3e-6 (the load of the piston pin all but
    vanishes within an angle that steps of 1e-10 pass over).
    """
    return TimeIntegration(diffrax.Dopri8(), tolerance=1e-12, samples=4000)


def verification(compressor: Compressor, orbit: Orbit, options: TimeIntegration) -> Verification:
    """What a march of one revolution says of an orbit, without derivatives.

    Args:
        compressor: admissible; where its gas is a cylinder, the gas of the cycle that was found.
        orbit: its periodic state.
        options: of the march; its tolerance is that of a step.
    """
    compressor, orbit = lax.stop_gradient((compressor, orbit))
    law = _Law(compressor, orbit.state.speed[0], orbit.motor_torque[0])
    first = orbit.state.angle[0]
    last = first + 2 * jnp.pi
    kinks = kink_angles(compressor)
    edges = jnp.concatenate([first[None], kinks[1:], (kinks[0] + 2 * jnp.pi)[None], last[None]])
    share = jnp.linspace(0.0, 1.0, max(2, options.samples // (edges.size - 1)))
    fine = edges[:-1, None] + jnp.diff(edges)[:, None] * share
    nodes = jnp.append(orbit.state.angle[1:], last)
    end, speeds, result = _march(law, edges, (nodes, fine.ravel()), options)
    at_nodes, at_fine = speeds

    found = jnp.append(orbit.state.speed[1:], orbit.state.speed[0])
    angle = _inside(edges, fine.ravel())
    forces = law(angle, at_fine).loads.forces
    peaks = {name: jnp.max(magnitude(*force)) for name, force in forces.items()}
    gas, losses = end["work"]["gas"], end["work"]["losses"]
    # what the motor gives beyond gas and losses goes into the speed, whose gap is reported by itself
    energy = Energy(gas + sum(losses.values(), start=jnp.zeros(())), gas, losses)
    mean = orbit.mean_speed
    return Verification(
        speed_error=jnp.max(jnp.abs(at_nodes - found)) / mean,
        closure=(at_nodes[-1] - found[-1]) / mean,
        period_error=end["time"] / orbit.period - 1,
        efficiency_error=energy.mechanical_efficiency - orbit.mechanical_efficiency,
        loss_error=jax.tree.map(lambda a, b: a - b, energy.losses, orbit.energy.losses),
        peak_error={name: peak - orbit.peak_forces[name] for name, peak in peaks.items()},
        steps=result.stats["num_steps"],
        status=Status.where(
            result.result == diffrax.RESULTS.successful, Status.converged, Status.not_converged
        ),
    )


class _Law(eqx.Module):
    """The equation of motion with the motor at the level that was found."""

    compressor: Compressor
    speed: Float[Array, ""]
    torque: Float[Array, ""]

    def __call__(self, angle: Float[Array, "*n"], speed: Float[Array, "*n"]) -> Instantaneous:
        """Acceleration, and loads of the joints, at angles [rad] and speeds [rad/s]."""
        if closure_of(self.compressor.motor).integrates:
            return solve_motion(self.compressor, angle, speed, self.motor(speed))
        at, still = instants(self.compressor, angle), jnp.zeros_like(speed)
        loads = loads_at(self.compressor, CrankState(angle, speed, still), at.gas_force, False)
        return Instantaneous(still, at, loads)

    def motor(self, speed):
        """[N m]"""
        motor = self.compressor.motor
        level = 1.0
        if closure_of(motor).level_is_unknown:
            level = self.torque / motor.torque(self.speed)
        return level * motor.torque(speed)


def _inside(edges, angle):
    """Angles [rad] moved off the edges of their panel, at which directions and phases change."""
    panel = jnp.clip(jnp.searchsorted(edges, angle, side="right") - 1, 0, edges.size - 2)
    return jnp.clip(angle, edges[panel] + 1e-10, edges[panel + 1] - 1e-10)


def _march(law: _Law, edges, angles, options: TimeIntegration) -> tuple[Any, Any, Any]:
    """Time [s] and works [J] at the end, speeds [rad/s] at two rows of angles [rad], and the solution."""
    scale = law.speed
    energy = jnp.maximum(jnp.abs(law.torque), instants(law.compressor, edges[0]).inertia * scale**2)

    def rate(angle, y, args):
        del args
        speed = jnp.maximum(y["speed"], 1e-6) * scale
        now = law(_inside(edges, angle), speed)
        torques = {"gas": -now.at.conservative, "losses": now.loads.loss_torque}
        return {
            "speed": now.acceleration / speed / scale,
            "time": scale / speed,
            "work": jax.tree.map(lambda torque: torque / energy, torques),
        }

    shapes = jax.eval_shape(rate, edges[0], {"speed": jnp.ones(()), "time": 0.0}, None)
    start: dict[str, Any] = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    start["speed"] = jnp.ones_like(scale)
    rows = [diffrax.SubSaveAt(ts=one, fn=lambda t, y, args: y["speed"]) for one in angles]
    result = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        options.solver,
        t0=edges[0],
        t1=edges[-1],
        dt0=0.01,
        y0=start,
        saveat=diffrax.SaveAt(subs=[diffrax.SubSaveAt(t1=True), *rows]),
        stepsize_controller=diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=options.tolerance, atol=options.tolerance),
            jump_ts=edges[1:-1],
        ),
        max_steps=options.max_steps,
        throw=False,
    )
    assert result.ys is not None
    end, *speeds = result.ys
    end = jax.tree.map(lambda x: x[-1], end)
    end["time"] = end["time"] / scale
    end["work"] = jax.tree.map(lambda w: w * energy, end["work"])
    return end, [speed * scale for speed in speeds], result
