r"""Vibration of the suspended block, harmonic by harmonic or in time.

Periodic quantities are $x(t) = \mathrm{Re}\sum_{k=1}^{n} x_k e^{ik\Omega t}$ with time factor
$e^{+i\Omega t}$. The shaking wrench of a periodic motion is the rate of change of a periodic
momentum, so it has no mean and the sums start at one.

Source: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*,
Eqs. (42), (43).
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.declared import Record, computed_part, declarations, held, reading, records_of
from .._core.exported import kept_jit
from .._core.extremes import max_of
from .._core.results import Data, Result
from ..compressor import Compressor, check_runs
from ..crank import Orbit
from ..crank._orbit import time_harmonics
from ..rotor import harmonic_response, undamped_modes
from ._pipe_forces import run_forces
from ._suspension import Suspension, block_points, motion_at
from ._wrench import Wrench, shaking_wrench, wrench_about

# Instants of a revolution at which the peak is looked for.
# One degree apart: they miss the peak of harmonic k by (k pi/360)^2/2 of it at most.
_INSTANTS = 360


class Harmonics(Result, eqx.Module):
    """Complex amplitudes of m quantities in the harmonics 1 to n of a rotation.

    Attributes:
        amplitude: [SI] shape (m, n), in the unit of the quantity.
        speed: [rad/s] of the first harmonic.
    """

    amplitude: Complex[Array, "m n"] = reading(
        "", "quantity", "order", doc="in the quantity's SI unit", key="harmonic"
    )
    speed: Float[Array, ""] = reading("rad/s")

    table_dims: ClassVar[tuple[str, ...]] = ("quantity", "order")
    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result; amplitudes in the units of what they are amplitudes of."""
        yield from self.data_of("speed")
        yield Data("order", "", jnp.arange(1, self.amplitude.shape[-1] + 1), ("order",))
        yield from self.data_of("amplitude")

    @property
    def frequency(self) -> Float[Array, " n"]:
        """[rad/s] of every harmonic."""
        return self.speed * jnp.arange(1, self.amplitude.shape[1] + 1)

    @property
    def rms(self) -> Float[Array, " m"]:
        """[SI] Root of the mean square of every quantity, in its unit."""
        # Over a period harmonics do not mix, and each has half its squared amplitude.
        power = jnp.sum(jnp.abs(self.amplitude) ** 2, axis=1) / 2
        # double where: the root of a quantity that is zero has no slope
        return jnp.where(power > 0, jnp.sqrt(jnp.where(power > 0, power, 1.0)), 0.0)

    def at(self, time: Float[Array, " t"]) -> Float[Array, "m t"]:
        """The quantities at instants [s]."""
        return jnp.real(self.amplitude @ jnp.exp(1j * self.frequency[:, None] * time))


@eqx.filter_jit  # one program instead of forty
def harmonics(
    suspension: Suspension,
    wrench: Wrench,
    time: Float[Array, " t"],
    duration: Float[Array, " t"],
    count: int = 8,
) -> Harmonics:
    r"""Harmonics of a wrench over one revolution, about the mass centre of the block.

    With an `orbit` of `solve_orbit` that is `time=orbit.time` and
    `duration=orbit.weight / orbit.state.speed`.

    Args:
        suspension: gives the mass centre.
        wrench: about the mechanism's origin at t instants.
        time: [s] of the instants.
        duration: [s] quadrature weights of the instants; their sum is the period.
        count: number of harmonics.

    Returns:
        Force [N] and moment [N m] in the order of the degrees of freedom, shape (6, count).
    """
    load = jnp.concatenate(wrench_about(wrench, suspension.mass_centre))
    amplitude, frequency = time_harmonics(load, time, duration, count)
    return Harmonics(amplitude, frequency[0])


def orbit_load(
    compressor: Compressor, orbit: Orbit, suspension: Suspension, count: int
) -> Harmonics:
    """Harmonics of all that shakes a block in a periodic state, about its mass centre.

    That is the shaking wrench of the moving parts, and the forces of the pipes that the block holds.

    Args:
        compressor: that the orbit was found for.
        orbit: the periodic state.
        suspension: gives the mass centre.
        count: number of harmonics.
    """
    wrench = shaking_wrench(compressor, orbit.state)
    # The weights are in angle, the harmonics in time: dt = d(angle)/speed.
    duration = orbit.weight / orbit.state.speed
    load = harmonics(suspension, wrench, orbit.time, duration, count)
    if not suspension.pipes:
        return load
    check_runs(compressor, suspension.pipes, "suspension.pipes")
    of_runs = run_forces(compressor, orbit)
    amplitude = load.amplitude
    for pipe in suspension.pipes:
        # without the mean, which the springs carry; the waves may have fewer orders than the load
        force = of_runs[pipe.run][:, 1 : 1 + count]
        orders = force.shape[1]
        arm = pipe.position - suspension.mass_centre
        moment = jnp.cross(arm.astype(complex), force, axisb=0, axisc=0)
        amplitude = amplitude.at[:, :orders].add(jnp.concatenate([force, moment]))
    return Harmonics(amplitude, load.speed)


@eqx.filter_jit
def block_response(suspension: Suspension, load: Harmonics) -> Harmonics:
    r"""Settled vibration, $(S - k^2\Omega^2 M + ik\Omega C)X_k = F_k$ (Eq. 42).

    Args:
        suspension: the block and its springs.
        load: about the mass centre, from `harmonics`.

    Returns:
        Displacement [m] and rotation [rad] of the block, shape (6, n).
    """
    block = suspension.rotor
    # the block as such does not spin: Eq. (42) leaves out the gyroscopic moments of the rotor within it
    no_spin = jnp.zeros(())

    def at(force, frequency):
        # the centre is the first node, those of the springs follow it
        forces = jnp.zeros((1 + len(suspension.springs), 6), complex).at[0].set(force)
        return harmonic_response(block, forces, no_spin, frequency).displacement[0]

    return Harmonics(jax.vmap(at)(load.amplitude.T, load.frequency).T, load.speed)


def free_body_response(suspension: Suspension, load: Harmonics) -> Harmonics:
    r"""Response far above the suspension frequencies, $\ddot X = M^{-1}F$ (Eq. 43)."""
    inertias = (suspension.inertia_x, suspension.inertia_y, suspension.inertia_z)
    mass = jnp.stack([*(suspension.mass,) * 3, *inertias])
    # M is diagonal about the mass centre, for the products of inertia are neglected.
    # The sign of d^2/dt^2 of e^{iwt}: far above its springs a block moves against the force.
    amplitude = -load.amplitude / mass[:, None] / load.frequency**2
    return Harmonics(amplitude, load.speed)


def point_motion(
    suspension: Suspension, response: Harmonics, point: Float[Array, "3"]
) -> Harmonics:
    """Displacement [m] of a point of the block, counted from the mechanism's origin.

    Args:
        suspension: the suspension.
        response: of its block, displacement and rotation [m, rad].
        point: [m] of the block.
    """
    matrix = motion_at(suspension, jnp.asarray(point))
    return Harmonics(matrix.astype(response.amplitude.dtype) @ response.amplitude, response.speed)


def free_body_error(
    suspension: Suspension, load: Harmonics, point: Float[Array, "3"]
) -> Float[Array, " n"]:
    """[-] Error of the free-body displacement of a point, over the true amplitude, by harmonic.

    One mass on one spring: the square of suspension frequency over running frequency.

    Args:
        suspension: the suspension.
        load: [N, N m] force and moment on the block.
        point: [m] of the block.
    """
    true = point_motion(suspension, block_response(suspension, load), point)
    free = point_motion(suspension, free_body_response(suspension, load), point)
    return _deviation(free, true)


def _deviation(free: Harmonics, true: Harmonics) -> Float[Array, " n"]:
    """[-] Of one motion from another over the other's amplitude, by harmonic."""
    amplitude = true.amplitude
    # over the three axes together: along one of them the point may not move at all
    return jnp.linalg.norm(free.amplitude - amplitude, axis=0) / jnp.linalg.norm(amplitude, axis=0)


class BlockMotion(eqx.Module):
    """Displacement, rotation and their velocities of the block.

    Attributes:
        displacement: [m, rad] (6,) or (t, 6).
        velocity: [m/s, rad/s] of the same shape.
    """

    displacement: Float[Array, "*t 6"]
    velocity: Float[Array, "*t 6"]


@eqx.filter_jit
def time_response(response: Harmonics, time: Float[Array, " t"]) -> BlockMotion:
    """The settled vibration at instants [s].

    Args:
        response: [m, rad] of the block.
        time: [s] (t,)
    """
    # d/dt of Re x e^{iwt}
    rate = Harmonics(1j * response.frequency * response.amplitude, response.speed)
    return BlockMotion(response.at(time).T, rate.at(time).T)


@dataclasses.dataclass(frozen=True)
class PointVibration(Record):
    """Settled vibration of a point of the block; amplitudes are those of the first harmonic.

    Attributes:
        position: [m] (3,) from the mechanism's origin.
        amplitude: [m] (3,)
        rms, peak: [m] of the size of the displacement.
        free_body: [m] (3,) amplitude of the approximation without springs.
        free_body_error: [-] its error over the amplitude.
    """

    position: list[float] = reading("m", "axis")
    amplitude: list[float] = reading("m", "axis")
    rms: float = reading("m")
    peak: float = reading("m")
    free_body: list[float] = reading("m", "axis")
    free_body_error: float = reading("")


def _by_point(name: str) -> Any:
    """Declare a field that has a number of `PointVibration` for every point."""
    declaration = declarations(PointVibration)[name]
    assert declaration.unit is not None
    return reading(declaration.unit, "point", *declaration.dims, table_only=True)


class BlockVibration(Result, eqx.Module):
    """Settled vibration of the block and of points of it; amplitudes are those of the first harmonic.

    Attributes:
        points: their names.
        harmonics: of the excitation, how many were taken.
        natural_frequencies: [rad/s] of the block on its springs.
        block_amplitude: [m, rad] of the six degrees of freedom.
        block_rms: [m, rad] root mean square of these.
        position: [m] (p, 3) of the points, from the mechanism's origin.
        amplitude: [m] (p, 3)
        rms, peak: [m] (p,) of the size of the displacement.
        free_body: [m] (p, 3) amplitude of the approximation without springs.
        free_body_error: [-] (p,) its error over the amplitude.
    """

    points: tuple[str, ...] = held(static=True)
    harmonics: int = reading("", static=True)
    natural_frequencies: Float[Array, "6"] = reading("rad/s", "mode")
    block_amplitude: Float[Array, "6"] = reading(
        "", "freedom", doc="in m along, in rad about x, y, z"
    )
    block_rms: Float[Array, "6"] = reading("", "freedom", doc="in m along, in rad about x, y, z")
    position: Float[Array, "p 3"] = _by_point("position")
    amplitude: Float[Array, "p 3"] = _by_point("amplitude")
    rms: Float[Array, " p"] = _by_point("rms")
    peak: Float[Array, " p"] = _by_point("peak")
    free_body: Float[Array, "p 3"] = _by_point("free_body")
    free_body_error: Float[Array, " p"] = _by_point("free_body_error")

    table_dims: ClassVar[tuple[str, ...]] = ("point", "axis")

    @computed_part(PointVibration, by_name=True, key="points")
    def vibration_of_points(self) -> dict[str, PointVibration]:
        """Vibration of every point by its name."""
        columns = {name: getattr(self, name) for name in declarations(PointVibration)}
        return dict(zip(self.points, records_of(PointVibration, **columns), strict=True))

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each point and axis."""
        yield Data("point", "", np.array(self.points), ("point",))
        yield Data("axis", "", np.array(["x", "y", "z"]), ("axis",))
        yield from super().described()


def block_vibration(
    compressor: Compressor, orbit: Orbit, suspension: Suspension, count: int = 12
) -> BlockVibration:
    """Settled vibration of the block, its springs' ends and its other points under a periodic state.

    Args:
        compressor: that the orbit was found for.
        orbit: the periodic state.
        suspension: the block and its springs.
        count: number of harmonics.
    """
    places = block_points(suspension)
    points = jnp.stack(list(places.values()))
    return _block_vibration(compressor, orbit, suspension, points, tuple(places), count)


@kept_jit
def _block_vibration(
    compressor: Compressor, orbit: Orbit, suspension: Suspension, points, names, count: int
) -> BlockVibration:
    load = orbit_load(compressor, orbit, suspension, count)
    block = block_response(suspension, load)
    free = free_body_response(suspension, load)
    time = jnp.linspace(0.0, 1.0, _INSTANTS, endpoint=False) * orbit.period

    def at(point):
        motion = point_motion(suspension, block, point)
        unsprung = point_motion(suspension, free, point)
        return {
            "position": point,
            "amplitude": jnp.abs(motion.amplitude[:, 0]),
            # mean squares of the axes add up to that of the size of the displacement; its peak has no
            # such rule
            "rms": jnp.linalg.norm(motion.rms),
            "peak": max_of(jnp.linalg.norm(motion.at(time), axis=0)),
            "free_body": jnp.abs(unsprung.amplitude[:, 0]),
            "free_body_error": _deviation(unsprung, motion)[0],
        }

    return BlockVibration(
        points=names,
        harmonics=count,
        natural_frequencies=undamped_modes(suspension.rotor, 6).frequency,
        block_amplitude=jnp.abs(block.amplitude[:, 0]),
        block_rms=block.rms,
        **jax.vmap(at)(points),
    )
