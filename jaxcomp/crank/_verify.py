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

from .._core.extremes import max_of, maximum
from .._core.roots import zeros_of
from .._core.status import Status
from ..compressor import Compressor, instants, kink_angles
from ..friction._joint_loads import magnitude
from ._crank_motion import Instantaneous, closure_of, motion_at
from ._integration import TimeIntegration, inside_panels, rates_over_angle
from ._journals import orbiting_journals, with_journals
from ._orbit import Energy, Orbit, Verification


def march_options() -> TimeIntegration:
    """Options of `verify=True`: an eighth-order method, and forces at 4000 angles.

    Its step errors are far below those of an orbit: measured on the bundled machines, at 1e-12 losses
    agree with those of 24 nodes to 5e-9 of each, at 1e-10 to 3e-6 (the load of the piston pin all but
    vanishes within an angle that steps of 1e-10 pass over).
    """
    return TimeIntegration(diffrax.Dopri8(), tolerance=1e-12, samples=4000)


def verification(compressor: Compressor, orbit: Orbit, options: TimeIntegration) -> Verification:
    """Errors of an orbit by a march of one revolution, without derivatives.

    Args:
        compressor: admissible; where its gas is a cylinder, the gas of the cycle that was found.
        orbit: its periodic state.
        options: of the march; its tolerance is that of a step.
    """
    # derivatives of an error estimate would be those of the march, at many times the cost of the orbit's
    compressor, orbit = lax.stop_gradient((compressor, orbit))
    law = _Law(compressor, orbit.state.speed[0], orbit.motor_torque[0])
    first = orbit.state.angle[0]
    end_angle = first + 2 * jnp.pi
    # kinks of other cylinders may lie between the first dead centre and the first node
    kinks = first + jnp.mod(kink_angles(compressor) - first, 2 * jnp.pi)
    edges = jnp.concatenate([first[None], jnp.sort(kinks), end_angle[None]])
    share = jnp.linspace(0.0, 1.0, max(2, options.samples // (edges.size - 1)))
    fine = edges[:-1, None] + jnp.diff(edges)[:, None] * share
    nodes = jnp.append(orbit.state.angle[1:], end_angle)
    names = [journal.joint for journal in orbiting_journals(compressor)]
    # without journals that move the march has no positions to begin with
    orbit_places = start = None
    if orbit.positions is not None:
        orbit_places = jnp.stack([orbit.positions[name] for name in names], axis=1)
        start = orbit_places[..., 0]
    end, saved, result = _march(law, edges, (nodes, fine.ravel()), options, start)
    (at_nodes, places), (at_fine, fine_places) = saved

    orbit_speed = jnp.append(orbit.state.speed[1:], orbit.state.speed[0])
    angle, _ = inside_panels(edges, fine.ravel())
    forces = law(angle, at_fine, fine_places).loads.forces
    peaks = {name: max_of(magnitude(*force)) for name, force in forces.items()}
    gas = end["work"]["gas"]
    losses = end["work"]["losses"]
    # what the motor gives beyond gas and losses goes into the speed, whose gap is reported by itself
    energy = Energy(gas + sum(losses.values(), start=jnp.zeros(())), gas, losses)
    mean = orbit.mean_speed
    position_error = None
    if orbit_places is not None:
        position_error = max_of(jnp.abs(places - jnp.roll(orbit_places, -1, axis=-1)))
    return Verification(
        speed_error=max_of(jnp.abs(at_nodes - orbit_speed)) / mean,
        closure=(at_nodes[-1] - orbit_speed[-1]) / mean,
        period_error=end["time"] / orbit.period - 1,
        efficiency_error=energy.mechanical_efficiency - orbit.mechanical_efficiency,
        loss_error=jax.tree.map(lambda a, b: a - b, energy.losses, orbit.energy.losses),
        gas_work_error=gas - orbit.energy.gas_work,
        peak_error={name: peak - orbit.peak_forces[name] for name, peak in peaks.items()},
        position_error=position_error,
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

    def __call__(
        self, angle: Float[Array, "*n"], speed: Float[Array, "*n"], journals=None
    ) -> Instantaneous:
        """Acceleration, and loads of the joints, at angles [rad] and speeds [rad/s].

        `journals` are the positions of those that move.
        """
        compressor = with_journals(self.compressor, journals)
        return motion_at(compressor, angle, speed, self.motor(speed))

    def motor(self, speed):
        """[N m] Zero where the motor holds the speed, which asks for no torque."""
        motor = self.compressor.motor
        if not closure_of(motor).integrates:
            return jnp.zeros_like(speed)
        level = 1.0
        if closure_of(motor).level_is_unknown:
            level = self.torque / motor.torque(self.speed)
        return level * motor.torque(speed)


def _march(law: _Law, edges, angles, options: TimeIntegration, journals) -> tuple[Any, Any, Any]:
    """Time [s] and works [J] at the end, speeds [rad/s] and journals at two rows of angles, the solution.

    `journals` are the positions of the moving ones at the start; `None` where none moves.
    """
    scale = law.speed
    # A unit of work that is not zero where the motor gives no torque.
    energy = maximum(jnp.abs(law.torque), instants(law.compressor, edges[0]).inertia * scale**2)

    def rate(angle, y, args):
        del args
        speed = maximum(y["speed"], 1e-6) * scale
        angle = inside_panels(edges, angle)[0]
        places = y.get("journals")
        motion = law(angle, speed, places)
        torques = {"gas": -motion.at.conservative, "losses": motion.loads.loss_torque}
        return rates_over_angle(law.compressor, motion, speed, torques, places, (scale, energy))

    begin: dict[str, Any] = {"speed": jnp.ones_like(scale), "time": jnp.zeros(())}
    if journals is not None:
        begin["journals"] = journals
    start = begin | {"work": zeros_of(rate, edges[0], begin, None)["work"]}

    def speed_and_journals(t, y, args):
        del t, args
        return y["speed"], y.get("journals")

    rows = [diffrax.SubSaveAt(ts=row, fn=speed_and_journals) for row in angles]
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
    end, *at_rows = result.ys
    end = jax.tree.map(lambda x: x[-1], end)
    end["time"] = end["time"] / scale
    end["work"] = jax.tree.map(lambda w: w * energy, end["work"])
    saved = []
    for speed, places in at_rows:
        if places is not None:
            places = jnp.moveaxis(places, 0, -1)
        saved.append((speed * scale, places))
    return end, saved, result
