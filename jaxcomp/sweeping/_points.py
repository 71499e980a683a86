r"""The designs of a sweep, block by block: a grid, or samples of which none is kept."""

import warnings
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from .._fields import BadInput
from ._axes import Distribution, Values

SAMPLE = "sample"
SAMPLINGS = ("sobol", "latin_hypercube", "random")
# Rows that one seed of the plain generator serves; fixed, so that rows do not depend on blocks.
_SEEDED = 4096
# Sobol's points have 30 bits; half a step moves them off zero, where a bell has no value.
_HALF_STEP = 2.0**-31

Place: TypeAlias = tuple[slice, ...]
Rows: TypeAlias = Float[np.ndarray, "designs variables"]


class GridPoints(NamedTuple):
    """All combinations of the values of each variable."""

    axes: dict[str, Values]

    @property
    def shape(self) -> tuple[int, ...]:
        """How many values each variable takes."""
        return tuple(values.size for values in self.axes.values())

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(self.axes)

    def rows(self, place: Place) -> Rows:
        """The designs at a place of the grid, the last variable changing first."""
        cut = [values[part] for values, part in zip(self.axes.values(), place, strict=True)]
        return np.stack(np.meshgrid(*cut, indexing="ij"), -1).reshape(-1, len(cut))

    def described(self) -> dict[str, object]:
        """What makes two grids the same."""
        return {name: ["grid", *values.tolist()] for name, values in self.axes.items()}


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
        if count < 1 or count > 2**30:
            raise BadInput("samples", count, ">= 1 and <= 2^30")
        if sampling not in SAMPLINGS:
            raise BadInput("sampling", sampling, f"one of {', '.join(SAMPLINGS)}")
        if seed < 0:
            raise BadInput("seed", seed, ">= 0")
        self.axes, self.count, self.sampling, self.seed = axes, count, sampling, seed
        self._engine, self._next, self._whole = None, 0, None

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of designs."""
        return (self.count,)

    def rows(self, place: Place) -> Rows:
        """The designs from one number to another."""
        start, stop, _ = place[0].indices(self.count)
        share = getattr(self, f"_{self.sampling}")(start, stop)
        columns = [axis.at(share[:, number]) for number, axis in enumerate(self.axes.values())]
        return np.stack(columns, -1)

    def described(self) -> dict[str, object]:
        """What makes two sets of samples the same."""
        axes = {name: list(axis) for name, axis in self.axes.items()}
        return {"samples": self.count, "sampling": self.sampling, "seed": self.seed, **axes}

    def _sobol(self, start, stop):
        from scipy.stats import qmc

        if self._engine is None or self._next > start:
            self._engine, self._next = qmc.Sobol(len(self.axes), rng=self.seed), 0
        if start > self._next:
            self._engine.fast_forward(start - self._next)
        with warnings.catch_warnings():
            # it warns of a first block that is no power of two, whatever the number of all points
            warnings.simplefilter("ignore", UserWarning)
            share = self._engine.random(stop - start)
        self._next = stop
        return share + _HALF_STEP

    def _latin_hypercube(self, start, stop):
        if self._whole is None:
            from scipy.stats import qmc

            self._whole = _inside(
                qmc.LatinHypercube(len(self.axes), rng=self.seed).random(self.count)
            )
        return self._whole[start:stop]

    def _random(self, start, stop):
        parts = []
        for number in range(start // _SEEDED, -(-stop // _SEEDED)):
            rng = np.random.default_rng([self.seed, number])
            first = number * _SEEDED
            share = rng.random((_SEEDED, len(self.axes)))
            parts.append(share[max(start - first, 0) : stop - first])
        return _inside(np.concatenate(parts))


class Layout(NamedTuple):
    """How the designs are cut into blocks, of which each is computed and stored at once.

    Attributes:
        shape: of all designs.
        block: of one block; the last ones along a dimension may be cut short.
    """

    shape: tuple[int, ...]
    block: tuple[int, ...]

    @classmethod
    def of(cls, shape: tuple[int, ...], batch: int) -> "Layout":
        """Blocks of at most `batch` designs, neighbours of a grid together, all nearly alike."""
        left, block = batch, []
        for size in reversed(shape):
            parts = -(-size // max(min(size, left), 1))
            block.append(-(-size // parts))
            left //= block[-1]
        return cls(shape, tuple(reversed(block)))

    @property
    def counts(self) -> tuple[int, ...]:
        """Blocks along each dimension."""
        return tuple(-(-size // part) for size, part in zip(self.shape, self.block, strict=True))

    @property
    def number(self) -> int:
        """Blocks in all."""
        return int(np.prod(self.counts))

    def index(self, number: int) -> tuple[int, ...]:
        """Where a block stands among the blocks."""
        return tuple(int(i) for i in np.unravel_index(number, self.counts))

    def place(self, number: int) -> Place:
        """What a block covers."""
        return tuple(
            slice(i * part, min((i + 1) * part, size))
            for i, part, size in zip(self.index(number), self.block, self.shape, strict=True)
        )


def neighbours_together(rows: Rows, width: int) -> Int[np.ndarray, " designs"]:
    """An order of designs in which those that follow each other are alike.

    All designs of a group take as many passes as the slowest of them, and neighbours take as many.

    Args:
        rows: the designs.
        width: designs in a group.
    """
    span = np.ptp(rows, axis=0)
    rows = (rows - rows.min(axis=0)) / np.where(span > 0, span, 1.0)

    def halved(which):
        if len(which) <= width:
            return [which]
        widest = np.argmax(np.ptp(rows[which], axis=0))
        which = which[np.argsort(rows[which, widest], kind="stable")]
        # whole groups on the left
        middle = -(-len(which) // (2 * width)) * width
        return [*halved(which[:middle]), *halved(which[middle:])]

    return np.concatenate(halved(np.arange(len(rows))))


def _inside(share):
    return np.clip(share, 2.0**-54, 1 - 2.0**-53)
