"""Measurements of a rotor: its modes, and the vibration of targets."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from ..._core.errors import BadInput
from ..._core.extremes import max_of
from ..._core.fields import replaced
from ...machine import Machine, assembled
from ...rotor import AXES, node_index, undamped_modes
from ...rotor._prepare import prepare
from .._analysis import DesignResult
from .._analysis_options import AnalysisOptions
from ._bounded_least_squares import Parameter
from ._measurement import AbstractMeasurement, Entries, Kind, stated_or_usual, usual

_DEGREE = np.pi / 180
# Distinct frequencies are further apart than this, relative; closer ones are a pair.
_PAIR = 1e-3
# Squares of modes where a shape was measured below this share of the largest are rounding.
_SEEN = 1e-12
_REGULARISATION = 1e-10


@dataclass(frozen=True)
class ModalTest(AbstractMeasurement):
    """Natural frequencies, and shapes, of a rotor that hangs free or lies in its bearings.

    A mode with a shape is that of the model with the largest MAC, another one goes by its number. Of a
    pair of equal frequencies both shapes count together.

    Attributes:
        frequency: [rad/s] (k,)
        modes: (k,) numbers from 1, every pair of equal frequencies and no rigid motion counted.
        free: hanging, without bearings.
        nodes, axes: (d,) where and along which axis ("ux") the shapes were measured.
        shape: (k, d) in any unit; not a number for a mode without.
        sd: [rad/s] (k,) standard deviations of the frequencies; 0.5 % if absent.
        skipped: what the file has and is not read, in words.
    """

    USUAL: ClassVar[float] = 0.005
    names_of_sd: ClassVar[tuple[str, ...]] = ("frequency", "mode_shape")

    source: str = field(compare=False)
    frequency: NDArray = field(compare=False)
    modes: tuple[int, ...]
    free: bool = True
    nodes: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    shape: NDArray | None = field(compare=False, default=None)
    sd: NDArray | None = field(compare=False, default=None)
    skipped: tuple[str, ...] = field(compare=False, default=())

    def _rotor(self, machine: Machine):
        rotor = assembled(machine).rotor
        if rotor is None:
            raise BadInput(f"{self.source}: rotor", "absent", "given, for a modal test")
        return rotor

    def check(self, machine):
        """Refuse a machine without a rotor, too high modes and nodes that it has not."""
        model = self._rotor(machine)
        distinct = self._distinct(machine)
        if max(self.modes) > len(distinct):
            bound = f"at most {len(distinct)}, the distinct frequencies of the rotor"
            raise BadInput(f"{self.source}: mode", max(self.modes), bound)
        shapes = () if self.shape is None else self.shape
        for number, shape in zip(self.modes, shapes, strict=False):
            measured = shape[np.isfinite(shape)]
            if measured.size and not measured.any():
                raise BadInput(
                    f"{self.source}: shape of mode {number}", 0, "other than 0 somewhere"
                )
        for node, axis in zip(self.nodes, self.axes, strict=True):
            node_index(model, node)
            if axis not in AXES[model.dof]:
                raise BadInput(f"{self.source}: axis", axis, f"one of {', '.join(AXES[model.dof])}")

    def _count(self, model) -> int:
        return min(2 * max(self.modes) + 12, prepare(model).layout.size)

    def _distinct(self, machine) -> NDArray:
        """Numbers of the elastic modes, one of each pair."""
        model = self._rotor(machine)
        frequency = np.asarray(undamped_modes(model, self._count(model), free=self.free).frequency)
        # Rigid motions of a rotor that hangs free have frequencies of rounding size.
        elastic = np.flatnonzero(frequency > 1e-3 * frequency.max())
        apart = np.diff(frequency[elastic]) > _PAIR * frequency[elastic][1:]
        return elastic[np.append(True, apart)]

    def entries(self, sd):
        count = self.frequency.size
        deviation = usual("frequency", sd, self.USUAL) * self.frequency
        deviation = stated_or_usual(self.sd, deviation)
        shape = np.zeros((count, 0))
        if self.shape is not None:
            shape = self._normed()
        rows, columns = np.nonzero(np.isfinite(shape))
        modes = np.array(self.modes)
        names = [f"mode {mode}" for mode in self.modes]
        place = []
        for node, axis in zip(self.nodes, self.axes, strict=True):
            place.append(f"{node} {axis}")
        of_shapes = []
        for row, column in zip(rows, columns, strict=True):
            of_shapes.append(f"{names[row]} at {place[column]}")
        sd_of_shapes = np.full(rows.size, usual("mode_shape", sd, 0.05))
        return Entries(
            quantity=("frequency",) * count + ("mode_shape",) * rows.size,
            kinds={"frequency": Kind("rad/s", True), "mode_shape": Kind("", False)},
            point=np.zeros(count + rows.size, int),
            column=np.concatenate([np.arange(count), count + rows * shape.shape[1] + columns]),
            measured=np.concatenate([self.frequency, shape[rows, columns]]),
            sd=np.concatenate([deviation, sd_of_shapes]),
            names=(*names, *of_shapes),
            conditions={"mode": np.concatenate([modes, modes[rows]]).astype(float)},
            units={"mode": ""},
        )

    def _normed(self) -> NDArray:
        """The measured shapes over their largest component."""
        assert self.shape is not None
        size = np.nan_to_num(np.abs(self.shape)).max(axis=1, keepdims=True, initial=0.0)
        return self.shape / np.where(size > 0, size, np.nan)

    def warnings(self, used, same_kind):
        """Warnings about what the file has and was not read."""
        del used, same_kind
        return [*self.skipped]

    def points(self, machine):
        numbers = self._distinct(machine)[np.array(self.modes) - 1]
        shape = np.zeros((len(self.modes), 0))
        if self.shape is not None:
            shape = self._normed()
        return numbers[None], shape[None]

    def at(self, machine, nuisances, point):
        del nuisances
        model = self._rotor(machine)
        numbers, measured = point
        modes = undamped_modes(model, self._count(model), free=self.free)
        at = np.array([node_index(model, node) for node in self.nodes], int)
        axis = np.array([AXES[model.dof].index(name) for name in self.axes], int)
        shapes = modes.shape[:, at, axis]
        is_measured = jnp.isfinite(measured)
        reading = jnp.where(is_measured, measured, 0.0)
        product = reading @ shapes.T  # (k, modes)
        square = is_measured.astype(float) @ (shapes.T**2)
        # Of a mode that does not move where it was measured, as torsion, rounding alone is left.
        moves = square > _SEEN * max_of(square, axis=1)[:, None]
        if self.nodes:
            # The modal assurance criterion but for the reading's own square, the same for all modes.
            fixed = lax.stop_gradient(product**2 / jnp.where(moves, square, 1.0))
            elastic = modes.frequency > 1e-3 * modes.frequency[-1]
            best = jnp.argmax(jnp.where(elastic & moves, fixed, -1.0), axis=1)
            numbers = jnp.where(jnp.any(is_measured, axis=1), best, numbers)
        near = jnp.abs(modes.frequency / modes.frequency[numbers][:, None] - 1) < _PAIR
        projected = jax.vmap(_projected, in_axes=(0, 0, 0, None))(
            reading, is_measured, near & moves, shapes
        )
        values = jnp.concatenate([modes.frequency[numbers], projected.ravel()])
        return values, jnp.all(jnp.isfinite(values))


def _projected(
    reading: Float[Array, " d"],
    is_measured: Bool[Array, " d"],
    in_plane: Bool[Array, " modes"],
    shapes: Float[Array, "modes d"],
) -> Float[Array, " d"]:
    """The part of a reading that lies in the plane of some modes, by least squares.

    A pair of equal frequencies has any shape of its plane. Measured along one axis both of its modes are
    the same shape, and least squares does not count that twice.

    Args:
        reading: (d,) shape, zero where it was not measured.
        is_measured: (d,) where it was.
        in_plane: (modes,) which modes span the plane.
        shapes: (modes, d)

    Returns:
        (d,) of the model, also where nothing was measured.
    """
    basis = jnp.where(in_plane[:, None] & is_measured, shapes, 0.0)
    gram = basis @ basis.T
    size = jnp.trace(gram)
    size = jnp.where(size > 0, size, 1.0)
    # Two modes that are one at these places make it singular; what is added changes 1e-10 of a shape.
    regularisation = _REGULARISATION * size * jnp.eye(gram.shape[0])
    share = jnp.linalg.solve(gram + regularisation, basis @ reading)
    return share @ jnp.where(in_plane[:, None], shapes, 0.0)


@dataclass(frozen=True)
class VibrationTest(AbstractMeasurement):
    """Amplitudes, with phases where given, of the targets of a machine at several speeds.

    A reading with a phase counts as a complex number. The chain of measurement has a gain and a
    reference angle, which are fitted with priors.

    Attributes:
        targets: (n,) names of targets of the machine's `balancing`.
        axes: (n,) "ux" or "uy".
        order: of the revolution.
        speed: [rad/s] (n,)
        amplitude: [m] (n,)
        phase: [rad] (n,) as `respond` counts it; not a number where it was not measured.
        sd: [m] (n,) standard deviations of the amplitudes; 5 % if absent.
    """

    names_of_sd: ClassVar[tuple[str, ...]] = ("vibration",)

    source: str = field(compare=False)
    targets: tuple[str, ...] = field(compare=False)
    axes: tuple[str, ...] = field(compare=False)
    speed: NDArray = field(compare=False)
    amplitude: NDArray = field(compare=False)
    phase: NDArray = field(compare=False)
    order: int = 1
    sd: NDArray | None = field(compare=False, default=None)

    def check(self, machine):
        """Refuse a machine without these targets."""
        rows = self._rows(machine)
        for pair in zip(self.targets, self.axes, strict=True):
            if pair not in rows:
                choices = ", ".join(f"{name} {axis}" for name, axis in rows)
                raise BadInput(f"{self.source}: target", " ".join(pair), f"one of {choices}")

    def _rows(self, machine: Machine) -> list[tuple[str, str]]:
        places: Any = machine.parts.get("balancing")
        if places is None:
            raise BadInput(f"{self.source}: balancing", "absent", "given with its targets")
        rows = []
        for target in places.targets:
            for axis in target.axes:
                rows.append((target.name, axis))
        return rows

    @property
    def nuisances(self):
        """Gain, and with phases the reference angle."""
        gain = Parameter("gain", low=0.5, high=2.0, start=1.0, prior=1.0, sd=0.02)
        if not np.isfinite(self.phase).any():
            return (gain,)
        angle = Parameter(
            name="reference_angle",
            low=-0.5,
            high=0.5,
            start=0.0,
            prior=0.0,
            sd=2 * _DEGREE,
            log=False,
            unit="rad",
        )
        return gain, angle

    def _speeds(self) -> NDArray:
        return np.unique(self.speed.round(9))

    def entries(self, sd):
        # columns of a point: real parts, imaginary parts and sizes of all rows of the machine
        phased = np.isfinite(self.phase)
        along = stated_or_usual(self.sd, usual("vibration", sd, 0.05) * self.amplitude)
        # across the direction of the reading it errs by 5 degrees
        component = np.sqrt((along**2 + (5 * _DEGREE * self.amplitude) ** 2) / 2)
        value = self.amplitude * np.exp(1j * np.where(phased, self.phase, 0.0))
        point = np.searchsorted(self._speeds(), self.speed.round(9))
        pairs = list(dict.fromkeys(zip(self.targets, self.axes, strict=True)))
        places = []
        labels = []
        for target, axis, speed in zip(self.targets, self.axes, self.speed, strict=True):
            places.append(pairs.index((target, axis)))
            labels.append(f"{target} {axis} at {speed:.5g} rad/s")
        row = np.array(places)
        # Readings with a phase count by both parts, those without by their size.
        groups = (
            ("vibration.real", phased, np.real(value), component),
            ("vibration.imaginary", phased, np.imag(value), component),
            ("vibration", ~phased, self.amplitude, along),
        )
        kinds = {}
        quantity = []
        column = []
        measured = []
        deviation = []
        order = []
        for n, (name, mask, numbers, errors) in enumerate(groups):
            at = np.flatnonzero(mask)
            if at.size:
                kinds[name] = Kind("m", name == "vibration")
            quantity += [name] * at.size
            column.append(n * len(pairs) + row[at])
            measured.append(numbers[at])
            deviation.append(errors[at])
            order.append(at)
        rows = np.concatenate(order)
        return Entries(
            quantity=tuple(quantity),
            kinds=kinds,
            point=point[rows],
            column=np.concatenate(column),
            measured=np.concatenate(measured),
            sd=np.concatenate(deviation),
            names=tuple(labels[n] for n in rows),
            conditions={"speed": self.speed[rows]},
            units={"speed": "rad/s"},
        )

    def points(self, machine):
        rows = self._rows(machine)
        pairs = list(dict.fromkeys(zip(self.targets, self.axes, strict=True)))
        of = np.array([rows.index(pair) for pair in pairs])
        speeds = self._speeds()
        return speeds, np.tile(of, (speeds.size, 1))

    def at(self, machine, nuisances, point):
        speed, rows = point
        places: Any = replaced(machine.parts["balancing"], speeds=speed[None])
        machine = replace(machine, parts={**machine.parts, "balancing": places})
        result = DesignResult(machine, AnalysisOptions(orders=(self.order,)))
        constants = [*nuisances, 0.0][:2]
        gain = constants[0] * jnp.exp(1j * constants[1])
        value = gain * result.vibration.targets[0, 0][rows]
        size = jnp.sqrt(value.real**2 + value.imag**2 + 1e-30)  # no kink at zero
        values = jnp.concatenate([value.real, value.imag, size])
        return values, result.ok & jnp.all(jnp.isfinite(values))
