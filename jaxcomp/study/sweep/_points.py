r"""The designs of a sweep: values of each variable, combined to a grid or drawn, block by block."""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from ..._core.arguments import counted
from ..._core.errors import BadInput

SAMPLE = "sample"
# Designs of a sweep, at most: a day of work on a thousand cores.
MOST = 2**30
SAMPLINGS = ("sobol", "latin_hypercube", "random")
# Rows that one seed of the plain generator serves; fixed, so that rows do not depend on blocks.
_SEEDED = 4096
# Sobol's points have 30 bits; half a step moves them off zero, where a bell has no value.
_HALF_STEP = 2.0**-31

Values: TypeAlias = Float[np.ndarray, " n"]
Place: TypeAlias = tuple[slice, ...]
Rows: TypeAlias = Float[np.ndarray, "designs variables"]


class Distribution(NamedTuple):
    """A scattered variable.

    Attributes:
        kind: "uniform" or "log_uniform" between two ends, or "normal" about a mean.
        first, second: [SI] the ends, or mean and standard deviation.
    """

    kind: Literal["uniform", "log_uniform", "normal"]
    first: float
    second: float

    def at(self, share: Values) -> Values:
        """The values below which these shares (0 to 1, both left out) of all designs lie."""
        if self.kind == "normal":
            from scipy.special import ndtri

            return self.first + self.second * ndtri(share)
        if self.kind == "log_uniform":
            return self.first * (self.second / self.first) ** share
        return self.first + (self.second - self.first) * share

    @property
    def ends(self) -> tuple[float, float]:
        """[SI] What the variable must allow: the ends, of a normal distribution its mean."""
        if self.kind == "normal":
            return (self.first, self.first)
        return (self.first, self.second)


def grid(low: float, high: float, count: int) -> Values:
    """Evenly spaced values [SI], so many, both ends included.

    Args:
        low: [SI] first value.
        high: [SI] last value.
        count: of values, at least two.

    Raises:
        BadInput: a range that does not rise, or fewer than two values.
    """
    return np.linspace(*_rising("grid", low, high, count), count)


def log_grid(low: float, high: float, count: int) -> Values:
    """Values [SI] of a constant ratio, so many, both ends included.

    Args:
        low: [SI] first value.
        high: [SI] last value.
        count: of values, at least two.

    Raises:
        BadInput: as `grid`, or an end that is not above zero.
    """
    return np.geomspace(*_rising("log_grid", low, high, count, positive=True), count)


def uniform(low: float, high: float) -> Distribution:
    """Every value between two ends [SI] is as likely.

    Args:
        low: [SI] lower end.
        high: [SI] upper end.

    Raises:
        BadInput: a range that does not rise.
    """
    return Distribution("uniform", *_rising("uniform", low, high))


def log_uniform(low: float, high: float) -> Distribution:
    """Every ratio between two ends [SI] is as likely.

    Args:
        low: [SI] lower end.
        high: [SI] upper end.

    Raises:
        BadInput: a range that does not rise or is not above zero.
    """
    return Distribution("log_uniform", *_rising("log_uniform", low, high, positive=True))


def normal(mean: float, deviation: float) -> Distribution:
    """Gauss's bell of a mean and a standard deviation [SI]; beyond the variable's bound designs fail.

    Args:
        mean: [SI]
        deviation: [SI] standard deviation.

    Raises:
        BadInput: a deviation that is not above zero.
    """
    if not 0 < deviation < np.inf:
        raise BadInput("deviation", deviation, "> 0")
    if not np.isfinite(mean):
        raise BadInput("mean", mean, "finite")
    return Distribution("normal", float(mean), float(deviation))


def _rising(name, low, high, count=2, positive=False) -> tuple[float, float]:
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise BadInput(name, f"{low:g} to {high:g}", "a finite range that rises")
    if positive and not low > 0:
        raise BadInput(name, low, "> 0")
    counted(f"{name}.count", count, 2, 10**7)
    return float(low), float(high)


class GridPoints:
    """All combinations of the values of each variable.

    Raises:
        BadInput: no value, more than one dimension, a repeated value, or one that is not finite.
    """

    def __init__(self, axes: Mapping[str, Sequence[float] | Values]):
        for name, numbers in axes.items():
            if np.asarray(numbers).dtype.kind in "USO":
                bound = "numbers in SI units, such as [0.12, 0.13] or `sweep.grid(0.12, 0.14, 5)`"
                text = str(numbers)
                if isinstance(numbers, str):
                    text = f'"{numbers}"'
                raise BadInput(name, text, bound)
        self.axes = {name: np.asarray(numbers, dtype=float) for name, numbers in axes.items()}
        for name, values in self.axes.items():
            if values.ndim != 1 or values.size == 0:
                raise BadInput(name, values, "a list of at least one value")
            if not np.all(np.isfinite(values)):
                raise BadInput(name, values, "finite")
            if np.unique(values).size != values.size:
                raise BadInput(name, values, "a list without repeated values")
        counted("over", math.prod(self.shape), 1, MOST)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values that each variable takes."""
        return tuple(values.size for values in self.axes.values())

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(self.axes)

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """[SI] The lowest and the highest value of each variable."""
        ends = {}
        for name, values in self.axes.items():
            ends[name] = (float(np.min(values)), float(np.max(values)))
        return ends

    def rows(self, place: Place) -> Rows:
        """The designs at a place of the grid, the last variable changing first."""
        cut = []
        for values, part in zip(self.axes.values(), place, strict=True):
            cut.append(values[part])
        return np.stack(np.meshgrid(*cut, indexing="ij"), -1).reshape(-1, len(cut))

    def described(self) -> dict[str, object]:
        """Description by which two grids are the same."""
        axes = {}
        for name, values in self.axes.items():
            axes[name] = ["grid", *values.tolist()]
        return axes


class SamplePoints:
    """Draws from the distribution of each variable.

    Sobol's points are scrambled, so that any number of them serves. Blocks are drawn when they are
    asked for; only a Latin hypercube, which is one whole, is kept, with 8 bytes a number.

    Attributes:
        axes: the distributions by name.
        count: how many designs.
        sampling: one of `SAMPLINGS`.
        seed: of the draws.
    """

    dims: ClassVar[tuple[str, ...]] = (SAMPLE,)

    def __init__(self, axes: dict[str, Distribution], count: int, sampling: str, seed: int):
        if sampling not in SAMPLINGS:
            raise BadInput("sampling", sampling, f"one of {', '.join(SAMPLINGS)}")
        # A Latin hypercube is drawn and held at once.
        limit = MOST
        if sampling == "latin_hypercube":
            limit = 2**24
        counted("samples", count, 1, limit)
        if seed < 0:
            raise BadInput("seed", seed, ">= 0")
        self.axes = axes
        self.count = count
        self.sampling = sampling
        self.seed = seed
        self._engine = None
        self._hypercube = None

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of designs."""
        return (self.count,)

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """[SI] What each variable must allow."""
        return {name: axis.ends for name, axis in self.axes.items()}

    def rows(self, place: Place) -> Rows:
        """The designs from one number to another."""
        start, stop, _ = place[0].indices(self.count)
        share = getattr(self, f"_{self.sampling}")(start, stop)
        # Off zero and one, where a normal distribution has no value.
        share = np.clip(share, 2.0**-54, 1 - 2.0**-53)
        columns = []
        for number, axis in enumerate(self.axes.values()):
            columns.append(axis.at(share[:, number]))
        return np.stack(columns, -1)

    def described(self) -> dict[str, object]:
        """Description by which two sets of samples are the same."""
        axes = {name: list(axis) for name, axis in self.axes.items()}
        return {"samples": self.count, "sampling": self.sampling, "seed": self.seed, **axes}

    def _sobol(self, start, stop):
        from scipy.stats import qmc

        # A sequence runs forwards only: what lies behind is drawn from its beginning.
        if self._engine is None or self._engine.num_generated > start:
            self._engine = qmc.Sobol(len(self.axes), rng=self.seed)
        if start > self._engine.num_generated:
            self._engine.fast_forward(start - self._engine.num_generated)
        with warnings.catch_warnings():
            # it warns of a first block that is no power of two, whatever the number of all points
            warnings.simplefilter("ignore", UserWarning)
            return self._engine.random(stop - start) + _HALF_STEP

    def _latin_hypercube(self, start, stop):
        if self._hypercube is None:
            from scipy.stats import qmc

            self._hypercube = qmc.LatinHypercube(len(self.axes), rng=self.seed).random(self.count)
        return self._hypercube[start:stop]

    def _random(self, start, stop):
        parts = []
        for number in range(start // _SEEDED, -(-stop // _SEEDED)):
            rng = np.random.default_rng([self.seed, number])
            first = number * _SEEDED
            share = rng.random((_SEEDED, len(self.axes)))
            parts.append(share[max(start - first, 0) : stop - first])
        return np.concatenate(parts)


class Blocks(NamedTuple):
    """Cut of the designs into blocks, of which each is computed and stored at once.

    Attributes:
        shape: of all designs.
        block: of one block; the last ones along a dimension may be cut short.
    """

    shape: tuple[int, ...]
    block: tuple[int, ...]

    @classmethod
    def of(cls, shape: tuple[int, ...], batch: int) -> "Blocks":
        """Blocks of at most `batch` designs, neighbours of a grid together, all nearly alike."""
        remaining = batch
        block = []
        # From the last variable, which changes first among the rows.
        for size in reversed(shape):
            parts = -(-size // max(min(size, remaining), 1))
            block.append(-(-size // parts))
            remaining //= block[-1]
        return cls(shape, tuple(reversed(block)))

    @property
    def counts(self) -> tuple[int, ...]:
        """Blocks along each dimension."""
        counts = []
        for size, part in zip(self.shape, self.block, strict=True):
            counts.append(-(-size // part))
        return tuple(counts)

    @property
    def number(self) -> int:
        """Blocks in all."""
        return int(np.prod(self.counts))

    def where(self, number: int) -> tuple[int, ...]:
        """Where a block stands among the blocks."""
        return tuple(int(i) for i in np.unravel_index(number, self.counts))

    def place(self, number: int) -> Place:
        """Designs that a block covers."""
        place = []
        for i, part, size in zip(self.where(number), self.block, self.shape, strict=True):
            place.append(slice(i * part, min((i + 1) * part, size)))
        return tuple(place)


def extent(place: Place) -> tuple[int, ...]:
    """The shape of a block."""
    return tuple(part.stop - part.start for part in place)


def neighbours_together(rows: Rows, width: int) -> Int[np.ndarray, " designs"]:
    """An order of designs in which those that follow each other are alike.

    All designs of a group, `width` in number, take as many passes as the slowest of them, and
    neighbours take as many.
    """
    span = np.ptp(rows, axis=0)
    rows = (rows - rows.min(axis=0)) / np.where(span > 0, span, 1.0)

    def halved(group):
        if len(group) <= width:
            return [group]
        widest = np.argmax(np.ptp(rows[group], axis=0))
        # Stable: designs that are alike stay in the order in which they came.
        group = group[np.argsort(rows[group, widest], kind="stable")]
        # whole groups on the left
        middle = -(-len(group) // (2 * width)) * width
        return [*halved(group[:middle]), *halved(group[middle:])]

    return np.concatenate(halved(np.arange(len(rows))))
