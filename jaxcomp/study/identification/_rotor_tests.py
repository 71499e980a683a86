"""Measurements of a rotor: its modes, and the vibration of targets."""

from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from ..._core.errors import BadInput
from ..._core.fields import replaced
from ...machine import Machine, assembled
from ...rotor import AXES, node_index, undamped_modes
from ...rotor.interface import prepare
from .._analysis import DesignResult
from .._options import AnalysisOptions
from ._least_squares import Parameter
from ._measurement import AbstractMeasurement, Entries, Kind, given_or_usual, usual

_DEGREE = np.pi / 180
# Distinct frequencies are further apart than this, relative; closer ones are a pair.
_PAIR = 1e-3
# Squares of modes where a shape was measured below this share of the largest are rounding.
_SEEN = 1e-12
_RIDGE = 1e-10


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
        for number, shape in zip(
            self.modes, [] if self.shape is None else self.shape, strict=False
        ):
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
        found = np.asarray(undamped_modes(model, self._count(model), free=self.free).frequency)
        elastic = np.flatnonzero(found > 1e-3 * found.max())
        apart = np.diff(found[elastic]) > _PAIR * found[elastic][1:]
        return elastic[np.append(True, apart)]

    def entries(self, sd):
        count = self.frequency.size
        deviation = usual("frequency", sd, self.USUAL) * self.frequency
        deviation = given_or_usual(self.sd, deviation)
        shape = np.zeros((count, 0)) if self.shape is None else self._normed()
        rows, columns = np.nonzero(np.isfinite(shape))
        modes = np.array(self.modes)
        names = [f"mode {mode}" for mode in self.modes]
        place = [f"{node} {axis}" for node, axis in zip(self.nodes, self.axes, strict=True)]
        return Entries(
            ("frequency",) * count + ("mode_shape",) * rows.size,
            {"frequency": Kind("rad/s", True), "mode_shape": Kind("", False)},
            np.zeros(count + rows.size, int),
            np.concatenate([np.arange(count), count + rows * shape.shape[1] + columns]),
            np.concatenate([self.frequency, shape[rows, columns]]),
            np.concatenate([deviation, np.full(rows.size, usual("mode_shape", sd, 0.05))]),
            (*names, *(f"{names[r]} at {place[c]}" for r, c in zip(rows, columns, strict=True))),
            {"mode": np.concatenate([modes, modes[rows]]).astype(float)},
            {"mode": ""},
        )

    def _normed(self) -> NDArray:
        """The measured shapes over their largest component."""
        assert self.shape is not None
        size = np.nan_to_num(np.abs(self.shape)).max(axis=1, keepdims=True, initial=0.0)
        return self.shape / np.where(size > 0, size, np.nan)

    def warnings(self, used, beside):
        """Warnings about what the file has and was not read."""
        del used, beside
        return [*self.skipped]

    def points(self, machine):
        numbers = self._distinct(machine)[np.array(self.modes) - 1]
        shape = np.zeros((len(self.modes), 0)) if self.shape is None else self._normed()
        return numbers[None], shape[None]

    def at(self, machine, nuisances, point):
        del nuisances
        model, (numbers, measured) = self._rotor(machine), point
        found = undamped_modes(model, self._count(model), free=self.free)
        at = np.array([node_index(model, node) for node in self.nodes], int)
        axis = np.array([AXES[model.dof].index(name) for name in self.axes], int)
        shapes = found.shape[:, at, axis]
        known = jnp.isfinite(measured)
        given = jnp.where(known, measured, 0.0)
        product = given @ shapes.T  # (k, modes)
        square = known.astype(float) @ (shapes.T**2)
        # Of a mode that does not move where it was measured, as torsion, rounding alone is left.
        seen = square > _SEEN * jnp.max(square, axis=1, keepdims=True)
        if self.nodes:
            # The modal assurance criterion but for the reading's own square, the same for all modes.
            fixed = lax.stop_gradient(product**2 / jnp.where(seen, square, 1.0))
            elastic = found.frequency > 1e-3 * found.frequency[-1]
            best = jnp.argmax(jnp.where(elastic & seen, fixed, -1.0), axis=1)
            numbers = jnp.where(jnp.any(known, axis=1), best, numbers)
        near = jnp.abs(found.frequency / found.frequency[numbers][:, None] - 1) < _PAIR
        projected = jax.vmap(_projected, in_axes=(0, 0, 0, None))(given, known, near & seen, shapes)
        values = jnp.concatenate([found.frequency[numbers], projected.ravel()])
        return values, jnp.all(jnp.isfinite(values))


def _projected(
    reading: Float[Array, " d"],
    known: Bool[Array, " d"],
    chosen: Bool[Array, " modes"],
    shapes: Float[Array, "modes d"],
) -> Float[Array, " d"]:
    """The part of a reading that lies in the plane of some modes, by least squares.

    A pair of equal frequencies has any shape of its plane. Measured along one axis both of its modes are
    the same shape, and least squares does not count that twice.

    Args:
        reading: (d,) shape, zero where it was not measured.
        known: (d,) where it was.
        chosen: (modes,) which modes span the plane.
        shapes: (modes, d)

    Returns:
        (d,) of the model, also where nothing was measured.
    """
    basis = jnp.where(chosen[:, None] & known, shapes, 0.0)
    gram = basis @ basis.T
    size = jnp.trace(gram)
    size = jnp.where(size > 0, size, 1.0)
    # Two modes that are one at these places make it singular; what is added changes 1e-10 of a shape.
    ridge = _RIDGE * size * jnp.eye(gram.shape[0])
    share = jnp.linalg.solve(gram + ridge, basis @ reading)
    return share @ jnp.where(chosen[:, None], shapes, 0.0)


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
                known = ", ".join(f"{name} {axis}" for name, axis in rows)
                raise BadInput(f"{self.source}: target", " ".join(pair), f"one of {known}")

    def _rows(self, machine: Machine) -> list[tuple[str, str]]:
        places: Any = machine.parts.get("balancing")
        if places is None:
            raise BadInput(f"{self.source}: balancing", "absent", "given with its targets")
        return [(one.name, axis) for one in places.targets for axis in one.axes]

    @property
    def nuisances(self):
        """Gain, and with phases the reference angle."""
        out = [Parameter("gain", 0.5, 2.0, 1.0, 1.0, 0.02)]
        if np.isfinite(self.phase).any():
            out.append(Parameter("reference_angle", -0.5, 0.5, 0.0, 0.0, 2 * _DEGREE, False, "rad"))
        return tuple(out)

    def _speeds(self) -> NDArray:
        return np.unique(self.speed.round(9))

    def entries(self, sd):
        # columns of a point: real parts, imaginary parts and sizes of all rows of the machine
        phased = np.isfinite(self.phase)
        own = given_or_usual(self.sd, usual("vibration", sd, 0.05) * self.amplitude)
        # across the direction of the reading it errs by 5 degrees
        whole = np.sqrt((own**2 + (5 * _DEGREE * self.amplitude) ** 2) / 2)
        value = self.amplitude * np.exp(1j * np.where(phased, self.phase, 0.0))
        point = np.searchsorted(self._speeds(), self.speed.round(9))
        pairs = list(dict.fromkeys(zip(self.targets, self.axes, strict=True)))
        row = np.array([pairs.index(p) for p in zip(self.targets, self.axes, strict=True)])
        kinds = {}
        parts = []
        for n, (name, chosen) in enumerate(
            (("vibration.real", phased), ("vibration.imaginary", phased), ("vibration", ~phased))
        ):
            at = np.flatnonzero(chosen)
            kinds |= {name: Kind("m", name == "vibration")} if at.size else {}
            measured = (np.real(value), np.imag(value), self.amplitude)[n][at]
            parts.append((
                [name] * at.size, point[at], n * len(pairs) + row[at], measured,
                (own if n == 2 else whole)[at],
                [f"{self.targets[k]} {self.axes[k]} at {self.speed[k]:.5g} rad/s" for k in at],
                self.speed[at],
            ))  # fmt: skip
        quantity, point, column, measured, deviation, names, speed = zip(*parts, strict=True)
        return Entries(
            tuple(chain.from_iterable(quantity)),
            kinds,
            *map(np.concatenate, (point, column, measured, deviation)),
            tuple(chain.from_iterable(names)),
            {"speed": np.concatenate(speed)},
            {"speed": "rad/s"},
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
        found = DesignResult(machine, AnalysisOptions(orders=(self.order,)))
        own = [*nuisances, 0.0][:2]
        gain = own[0] * jnp.exp(1j * own[1])
        value = gain * found.vibration.targets[0, 0][rows]
        size = jnp.sqrt(value.real**2 + value.imag**2 + 1e-30)  # no kink at zero
        values = jnp.concatenate([value.real, value.imag, size])
        return values, found.ok & jnp.all(jnp.isfinite(values))
