r"""Torsion of the crank train: a chain of inertias and springs under the torques of an orbit.

$$M\ddot\vartheta + C\dot\vartheta + K\vartheta = T(t)$$

with an inertia for motor, couplings and every throw, driven harmonic by harmonic by the torques of the
rigid crank, $(K - (n\Omega)^2 M + i n\Omega C)\,\vartheta_n = T_n$. The mean torque passes as it is. The
rigid orbit is right while the lowest torsional frequency lies well above that of the load; the swing of
the inertias with the crank angle is left out.
"""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float

from .._core.declared import computed, reading
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.extremes import max_of, maximum
from .._core.fields import (
    NONNEGATIVE,
    POSITIVE,
    Part,
    is_traced,
    quantity,
    replaced,
    spread_columns,
)
from .._core.polynomials import gauss
from .._core.results import Data, Result
from ..compressor import Compressor, at_speed, of_each_cylinder
from ._collocation import Collocation
from ._orbit import Orbit, time_harmonics
from ._solve_orbit import solve_orbit

# Angles over which the inertia of a cylinder is averaged: its orders end far below.
_SAMPLES = 64
# [-] Highest harmonic over the order of the highest mode, and bounds of the count. Of twenty random
# machines 16 harmonics were up to 24 % off, 2.5 times the order 1.8e-4, these 2.7e-5.
_BEYOND = 3.5
_STEP = 16
_FEWEST = 48
_MOST = 512
_TRACED = 128
# [rad] Phase of the highest harmonic on a part of a panel, for which so many nodes are exact.
_PHASE = 8.0
_NODES = 12


class TorsionalChain(Part):
    """Inertias in a row with torsional springs between neighbours; free at both ends.

    Args:
        inertia: [kg m^2] (n,) about the shaft's axis.
        stiffness: [N m/rad] (n - 1,) between neighbours.
        damping: [N m s/rad] (n - 1,) between neighbours; one value stands for all.

    Raises:
        BadInput: not one spring fewer than inertias.
    """

    kind: ClassVar[str] = "torsional_chain"

    inertia: Float[Array, " n"] = quantity("kg m^2", POSITIVE, shape=(None,))
    stiffness: Float[Array, " s"] = quantity("N m/rad", POSITIVE, shape=(None,))
    damping: Float[Array, " s"] = quantity("N m s/rad", NONNEGATIVE, shape=(None,), default=0.0)

    def __post_init__(self):
        stiffness = jnp.asarray(self.stiffness, float)
        self.damping = jnp.broadcast_to(jnp.asarray(self.damping, float), stiffness.shape)

    def __check_init__(self):
        count = self.inertia.size
        if count < 2 or self.stiffness.shape != (count - 1,):
            raise BadInput("stiffness", self.stiffness, f"{max(count, 2) - 1} values, one a spring")

    def between(self, values: Float[Array, " s"]) -> Float[Array, "n n"]:
        """The matrix of springs or dampers between neighbours."""
        ends = jnp.concatenate([jnp.zeros(1), values, jnp.zeros(1)])
        off_diagonal = jnp.diag(values, 1)
        return jnp.diag(ends[1:] + ends[:-1]) - off_diagonal - off_diagonal.T

    @property
    def natural_frequencies(self) -> Float[Array, " n"]:
        """[rad/s] in rising order; the first is the free rotation, 0."""
        return _natural_frequencies(self)

    def response(
        self, torque: Complex[Array, "n h"], frequency: Float[Array, " h"]
    ) -> Complex[Array, "n h"]:
        """Angles [rad] of the inertias, time factor $e^{+i\\Omega t}$.

        Args:
            torque: [N m] complex amplitudes on every inertia.
            frequency: [rad/s] of each of h harmonics, > 0.
        """
        square = frequency[:, None, None] ** 2
        dynamic = (
            self.between(self.stiffness)
            - square * jnp.diag(self.inertia)
            + 1j * frequency[:, None, None] * self.between(self.damping)
        )
        return jnp.linalg.solve(dynamic, torque.T[..., None])[..., 0].T

    def spring_torque(
        self, angle: Complex[Array, "n h"], frequency: Float[Array, " h"]
    ) -> Complex[Array, "s h"]:
        """[N m] that each spring with its damper carries, from its left to its right end.

        Args:
            angle: [rad] of `response`.
            frequency: [rad/s] of each harmonic.
        """
        rate = self.stiffness[:, None] + 1j * frequency * self.damping[:, None]
        return rate * jnp.diff(angle, axis=0)


class CrankTrain(Part):
    """Motor, couplings and the throws of a crankshaft in a row, as the section `torsion` of a machine.

    The crank's inertia of the mechanism is that of all of them; what these leave is shared evenly by
    the throws, each with the mean inertia of its rods and pistons.

    Args:
        inertia: [kg m^2] (m,) before the first throw: motor, coupling halves.
        stiffness: [N m/rad] (m - 1 + throws,) between neighbours.
        damping: [N m s/rad] likewise; one value stands for all.
    """

    kind: ClassVar[str] = "crank_train"

    inertia: Float[Array, " m"] = quantity("kg m^2", POSITIVE, shape=(None,))
    stiffness: Float[Array, " s"] = quantity("N m/rad", POSITIVE, shape=(None,))
    damping: Float[Array, " s"] = quantity(
        "N m s/rad", NONNEGATIVE, shape=(None,), spread=True, default=0.0
    )

    def __post_init__(self):
        spread_columns(self, jnp.size(jnp.asarray(self.stiffness)), "springs")

    def springs(self, compressor: Compressor) -> int:
        """Number of springs between motor and throws.

        Raises:
            BadInput: another number of stiffnesses.
        """
        count = self.inertia.size + len(compressor.crankshaft.rows) - 1
        if self.stiffness.shape != (count,):
            raise BadInput("torsion.stiffness", self.stiffness, f"{count} values, one a spring")
        return count

    def chain(self, compressor: Compressor) -> TorsionalChain:
        """The chain of a machine.

        Raises:
            BadInput: inertias that leave none for the throws, or not one spring fewer than inertias.
        """
        count = self.springs(compressor)
        throws = throw_inertias(compressor)
        total = compressor.crankshaft.inertia
        assert total is not None
        remainder = total - jnp.sum(self.inertia)
        if not is_traced(remainder) and not bool(remainder > 0):
            raise BadInput(
                "torsion.inertia", self.inertia, f"less than the crank's {float(total):g}"
            )
        inertia = jnp.concatenate([self.inertia, remainder / throws.size + throws])
        unit_chain = TorsionalChain(jnp.ones(count + 1), jnp.ones(count))
        return replaced(unit_chain, inertia=inertia, stiffness=self.stiffness, damping=self.damping)


class TrainTorques(Result, eqx.Module):
    """Torques in the springs of a crank train, from the motor's side to the crank's end.

    Attributes:
        mean: [N m] (s,).
        amplitude: [N m] (s, h) complex amplitudes of the harmonics of time.
        frequency: [rad/s] (h,)
        peak: [N m] (s,) largest size over the revolution.
        natural_frequencies: [rad/s] (s,) of the train, without the free rotation.
        peak_error: [N m] (s,) estimated error of the peaks by the harmonics that are left out: the
            amplitudes of those up to well past the highest mode, and for the others three times those
            of the last quarter of these.
    """

    mean: Float[Array, " s"] = reading("N m", "spring", table_only=True)
    amplitude: Complex[Array, "s h"] = reading("N m", "spring", "harmonic", table_only=True)
    frequency: Float[Array, " h"] = reading("rad/s", "harmonic", table_only=True)
    peak: Float[Array, " s"] = reading("N m", "spring", key="peak_torque")
    natural_frequencies: Float[Array, " s"] = reading("rad/s", "mode")
    peak_error: Float[Array, " s"] | None = reading("N m", "spring", optional=True, default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("spring",)

    @computed("rad/s", "mode")
    def critical_speeds(self) -> dict[str, np.ndarray]:
        """[rad/s] (s,) Mean speeds at which orders 1 to 8 meet the natural frequencies, by order."""
        frequencies = np.asarray(self.natural_frequencies)
        return {str(order): frequencies / order for order in range(1, 9)}

    @computed("N m", "spring")
    def mean_torque(self) -> np.ndarray:
        """[N m] (s,) Mean torque of the motor, towards the crank; `mean` has the other sign."""
        return -np.asarray(self.mean)

    @computed("", "spring")
    def largest_order(self) -> np.ndarray:
        """[-] (s,) Order of the largest amplitude."""
        return 1 + np.argmax(np.abs(self.amplitude), axis=1)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield Data("spring", "", jnp.arange(1, self.mean.shape[-1] + 1), ("spring",))
        yield from self.data_of(mean_torque="mean")
        yield from self.data_of("peak", "peak_error", natural_frequency="natural_frequencies")
        yield from self.data_of("frequency", torque="amplitude")


def train_torques(
    compressor: Compressor, orbit: Orbit, train: CrankTrain, count: int | None = None
) -> TrainTorques:
    """Torques of the springs of a crank train under the torques of an orbit.

    The motor's torque acts on the first inertia, the friction of the main bearings evenly on the throws.

    Args:
        compressor: the machine.
        orbit: its periodic state.
        train: its inertias and springs.
        count: harmonics. Absent: as many as reach well past the highest natural frequency, where what
            is left falls with the fourth power of the order; 512 at most, and 128 where the machine is
            traced.
    """
    chain = train.chain(compressor)
    reached = _count_of_harmonics(chain, orbit.mean_speed)
    count = reached if count is None else count
    # with all that reach as well: what they change is the error of fewer
    counts = count, max(count, reached)
    return _spring_torques(chain, compressor, orbit, counts, _cuts(orbit, counts[1]))


def _count_of_harmonics(chain: TorsionalChain, speed: Float[Array, "*n"]) -> int:
    """Harmonics that reach past the highest mode at the lowest of mean speeds [rad/s]."""
    frequencies = chain.natural_frequencies
    if is_traced(frequencies) or is_traced(speed):
        return _TRACED
    # on the host: operations of JAX would each be a program of their own
    order = np.asarray(frequencies)[-1] / np.min(np.asarray(speed))
    # few counts, since each has a program of its own
    count = _STEP * np.ceil(_BEYOND * order / _STEP)
    return int(min(max(count, _FEWEST), _MOST))


def _cuts(orbit: Orbit, count: int) -> int:
    """Parts of every panel that are short beside a wave of the highest order."""
    width = orbit.panel_width
    # the widest that panels are where a traced width has no number yet
    widest = np.pi / 2
    if not is_traced(width):
        widest = float(np.max(np.asarray(width)))
    return int(np.ceil(count * widest / _PHASE))


@kept_jit
def _natural_frequencies(chain: TorsionalChain) -> Float[Array, " n"]:
    # symmetric with the inertias on both sides, so that no eigenvalue is complex by rounding
    root = jnp.sqrt(chain.inertia)
    values = jnp.linalg.eigvalsh(chain.between(chain.stiffness) / root[:, None] / root)
    return jnp.sqrt(maximum(values, 0.0)).at[0].set(0.0)


@kept_jit
def _spring_torques(
    chain: TorsionalChain, compressor: Compressor, orbit: Orbit, counts: tuple[int, int], cuts: int
) -> TrainTorques:
    """Torques by so many harmonics, and the part that more of them would add."""
    of_throws = throw_torques(compressor, orbit)
    of_shaft = orbit.loads.total_loss_torque - jnp.sum(_own_losses(compressor, orbit), axis=0)
    ahead = chain.inertia.size - of_throws.shape[0]
    before = jnp.zeros((ahead, orbit.time.size)).at[0].set(orbit.motor_torque)
    torque = jnp.concatenate([before, of_throws - of_shaft / of_throws.shape[0]])
    duration = orbit.weight / orbit.state.speed
    count, reached = counts
    harmonic, frequency = _harmonics(torque, orbit, reached, cuts)
    amplitude = chain.spring_torque(chain.response(harmonic, frequency), frequency)
    # what enters on the left of a spring on the mean passes through it, towards the crank's end
    mean = -jnp.cumsum(torque @ duration / jnp.sum(duration))[:-1]
    size = jnp.abs(amplitude)
    error = jnp.sum(size[:, count:], axis=1) + 3 * jnp.sum(size[:, 3 * reached // 4 :], axis=1)
    amplitude = amplitude[:, :count]
    frequency = frequency[:count]
    peak = _peak(mean, amplitude)
    return TrainTorques(mean, amplitude, frequency, peak, chain.natural_frequencies[1:], error)


def _harmonics(torque: Float[Array, "i n"], orbit: Orbit, count: int, cuts: int):
    """Complex amplitudes [N m] of the harmonics of time, and their frequencies [rad/s].

    Panel by panel, of the polynomials through the nodes, on parts so short that the quadrature is exact
    for the highest order: the nodes themselves see no order beyond their own number on a panel.
    """
    rule = gauss(orbit.panel_nodes)
    fine = gauss(_NODES)
    x = ((np.arange(cuts)[:, None] + fine.nodes) / cuts).ravel()
    weight = np.tile(fine.weights / cuts, cuts)
    through = rule.through(x).T

    def finer(row):
        by_panels = row.reshape(*row.shape[:-1], -1, orbit.panel_nodes)
        return (by_panels @ through).reshape(*row.shape[:-1], -1)

    duration = (orbit.panel_width[:, None] * weight).ravel() / finer(orbit.state.speed)
    return time_harmonics(finer(torque), finer(orbit.time), duration, count)


def _peak(mean: Float[Array, " s"], amplitude: Complex[Array, "s h"]) -> Float[Array, " s"]:
    """[N m] Largest size over the revolution, by parabolas through samples and their neighbours."""
    count = amplitude.shape[1]
    samples = 16 * count
    spectrum = jnp.zeros((amplitude.shape[0], samples // 2 + 1), complex)
    # `irfft` adds the conjugate of each amplitude, hence the half, and divides by the samples.
    spectrum = spectrum.at[:, 0].set(mean).at[:, 1 : count + 1].set(amplitude / 2)
    course = jnp.fft.irfft(spectrum, samples, axis=1) * samples
    before = jnp.roll(course, 1, axis=1)
    after = jnp.roll(course, -1, axis=1)
    bend = maximum(jnp.abs(2 * course - before - after), 1e-300)
    top = jnp.abs(course) + (after - before) ** 2 / (8 * bend)
    # only where a sample is no less than its neighbours does the parabola have its top beside it
    local = jnp.abs(course) >= maximum(jnp.abs(before), jnp.abs(after))
    return max_of(jnp.where(local, top, jnp.abs(course)), axis=1)


def train_over_speed(
    compressor: Compressor,
    train: CrankTrain,
    speeds: Float[Array, " n"],
    count: int | None = None,
) -> tuple[Float[Array, " n"], Float[Array, "n s"]]:
    """Mean torque of the first spring [N m] and peak of every spring [N m] at mean speeds [rad/s].

    Args:
        compressor: the machine; its motor gives way to the speed.
        train: its inertias and springs.
        speeds: [rad/s]
        count: harmonics; as many as the lowest speed needs if absent, see `train_torques`.
    """

    speeds = jnp.asarray(speeds, float)
    harmonics = count
    if count is None:
        harmonics = _count_of_harmonics(train.chain(compressor), speeds)

    @eqx.filter_jit
    def all_of(compressor, train, speeds):
        def torques_at(speed):
            held = at_speed(compressor, speed)
            orbit = solve_orbit(
                held, Collocation(nodes=12, reversals=0, tolerance=1e-9), throw=False
            )
            torques = train_torques(held, orbit, train, harmonics)
            mean = jnp.where(orbit.converged, torques.mean[0], jnp.nan)
            peak = jnp.where(orbit.converged, torques.peak, jnp.nan)
            return mean, peak

        # one after the other: batches of orbits would take as many iterations as the slowest
        return lax.map(torques_at, speeds)

    return all_of(compressor, train, speeds)


def throw_torques(compressor: Compressor, orbit: Orbit) -> Float[Array, "t n"]:
    """Torque [N m] of each throw's cylinders on the crank at the nodes of an orbit.

    Gas, weights, friction of the cylinders' own joints, and inertia but for that of the mean inertia
    of each throw (`throw_inertias`), which belongs to the chain.

    Args:
        compressor: the machine.
        orbit: its periodic state.
    """
    each = of_each_cylinder(orbit.under_gas(compressor), orbit.state.angle)
    state = orbit.state
    swing = each.inertia - _mean_inertia(compressor)
    torque = each.conservative - swing * state.acceleration - 0.5 * each.inertia_1 * state.speed**2
    return compressor.crankshaft.of_throws(torque - _own_losses(compressor, orbit))


@kept_jit
def throw_inertias(compressor: Compressor) -> Float[Array, " t"]:
    """[kg m^2] Mean inertia of the rods and pistons of each throw, reduced to the crank."""
    return compressor.crankshaft.of_throws(_mean_inertia(compressor)[:, 0])


def _own_losses(compressor: Compressor, orbit: Orbit) -> Float[Array, "k n"]:
    """[N m] Loss torque of the joints that each cylinder has for itself."""
    losses = orbit.loads.loss_torque
    crankshaft = compressor.crankshaft
    joints = {} if compressor.friction is None else vars(compressor.friction)
    none = jnp.zeros_like(orbit.state.speed)
    rows = []
    for number in range(1, crankshaft.count + 1):
        of_joints = (losses.get(crankshaft.joint(name, number), none) for name in joints)
        rows.append(sum(of_joints, none))
    return jnp.stack(rows)


def _mean_inertia(compressor: Compressor) -> Float[Array, "k 1"]:
    angle = jnp.linspace(0.0, 2 * jnp.pi, _SAMPLES, endpoint=False)
    return jnp.mean(of_each_cylinder(compressor, angle).inertia, axis=-1, keepdims=True)
