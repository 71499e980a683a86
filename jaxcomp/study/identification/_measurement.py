"""What every kind of measurement has: readings of points, and what a machine says of a point.

A kind is a class of its own: `Readings` of rated points, `Trace` over the crank angle, `Table` of any
quantities, `ModalTest`, `VibrationTest`. Readings of the same point are solved together. A class has
data, which do not count in comparisons, and numbers that shape its program, which do: measurements
that are equal in these share one compiled program.
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from ...machine import Machine
from ._bounded_least_squares import Parameter

if TYPE_CHECKING:
    from ...crank import Collocation, Shooting

Build = Callable[[Float[Array, " p"]], Machine]


class Kind(NamedTuple):
    """Kind of a measured quantity: its name, unit and deviation.

    Attributes:
        unit: SI unit.
        relative: whether its standard deviation and its error count relative to the reading.
    """

    unit: str
    relative: bool


class Entries(NamedTuple):
    """The m readings of a measurement.

    Attributes:
        quantity: (m,) names.
        kinds: what they are, by name.
        point: (m,) number of the point.
        column: (m,) which of the values of the point.
        measured: [SI] (m,)
        sd: [SI] (m,) standard deviations.
        names: (m,) of the conditions, as "-5/30 C".
        conditions: [SI] (m,) numbers by name, such as the evaporating temperature, for pictures.
        units: SI units of the conditions.
    """

    quantity: tuple[str, ...]
    kinds: Mapping[str, Kind]
    point: NDArray
    column: NDArray
    measured: NDArray
    sd: NDArray
    names: tuple[str, ...]
    conditions: Mapping[str, NDArray]
    units: Mapping[str, str]


class AbstractMeasurement(abc.ABC):
    """Readings of one kind, of one source.

    Attributes:
        source: name of the file, for messages and for the sources of the machine's values.
        polynomial: whether the values are those of a polynomial, and no readings.
        names_of_sd: quantities whose usual standard deviation may be replaced.
        solver: of the periodic states that the readings follow from, where they do; `None`: the usual.
    """

    source: str
    polynomial: bool = False
    names_of_sd: ClassVar[tuple[str, ...]] = ()
    solver: "Collocation | Shooting | None" = None

    @abc.abstractmethod
    def check(self, machine: Machine) -> None:
        """Raise `BadInput` for readings that cannot be, or a machine that does not suit them."""

    def for_machine(self, machine: Machine) -> Self:
        """The measurement with what only the machine tells of it."""
        del machine
        return self

    def check_limits(self, machine: Machine, varied: Sequence[str]) -> None:
        """Raise `BadInput` for readings that the machine cannot have whatever the constants are.

        Args:
            machine: whose numbers hold, but for those that are varied.
            varied: their names.
        """
        del machine, varied

    def solved_by(self, solver: "Collocation | Shooting | None") -> Self:
        """These readings with the periodic states that they follow from found by another solver."""
        names = [field.name for field in dataclasses.fields(cast(Any, self))]
        if "solver" not in names:
            return self
        return dataclasses.replace(cast(Any, self), solver=solver)

    @property
    def without_data(self) -> Self:
        """The measurement without its data: what its program depends on, and what names that program
        where it is kept.
        """
        if not dataclasses.is_dataclass(self):
            return self
        data = [field.name for field in dataclasses.fields(self) if not field.compare]
        return cast(Self, dataclasses.replace(self, **dict.fromkeys(data)))

    @property
    def nuisances(self) -> tuple[Parameter, ...]:
        """Constants of the measurement itself, such as the offset of a sensor, with their priors."""
        return ()

    @abc.abstractmethod
    def entries(self, sd: Mapping[str, float]) -> Entries:
        """All readings, with standard deviations instead of the usual ones by quantity."""

    @abc.abstractmethod
    def points(self, machine: Machine) -> Any:
        """Numbers of the points, as arrays with a leading axis; they are handed to `values`."""

    def warnings(
        self, used: Sequence[int], same_kind: Sequence[tuple[Any, Sequence[int]]]
    ) -> list[str]:
        """Warnings about points that the fit did not see, in words.

        Args:
            used: points that the fit saw.
            same_kind: other measurements of the same kind, with the points that it saw of them.
        """
        del used, same_kind
        return []

    def at(
        self, machine: Machine, nuisances: Float[Array, " q"], point: Any
    ) -> tuple[Float[Array, " k"], Bool[Array, ""]]:
        """Readings of a machine at a point, and whether they can be relied on."""
        raise NotImplementedError

    def values(
        self,
        build: Build,
        parameters: Float[Array, " p"],
        nuisances: Float[Array, " q"],
        point: Any,
    ) -> tuple[Float[Array, " k"], Float[Array, "k r"], Bool[Array, ""]]:
        """Values at a point, their slopes over parameters and nuisances, and whether they hold.

        Args:
            build: the machine of some parameters.
            parameters: (p,)
            nuisances: (q,) in the order of `nuisances`.
            point: one of `points`.
        """
        count = parameters.size

        def readings(constants):
            return self.at(build(constants[:count]), constants[count:], point)

        constants = jnp.concatenate([parameters, nuisances])
        # Not `jacfwd`, for the reason that `_problem` gives: `ok` could get an axis of directions.
        values, push, ok = jax.linearize(readings, constants, has_aux=True)
        slopes = jax.vmap(push, out_axes=-1)(jnp.eye(constants.size))
        return values, slopes, ok & jnp.all(jnp.isfinite(values)) & jnp.all(jnp.isfinite(slopes))


def usual(name: str, replacements: Mapping[str, float], default: float) -> float:
    """The standard deviation of a quantity."""
    return float(replacements.get(name, default))


def stated_or_usual(stated: NDArray | None, usual: NDArray) -> NDArray:
    """Standard deviations of single readings where they are given, the usual ones elsewhere."""
    if stated is None:
        return usual
    return np.where(np.isfinite(stated), stated, usual)
