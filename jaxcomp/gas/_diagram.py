"""Prescribed indicator diagrams: measured or computed elsewhere, over crank angle or over volume."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.fields import ANY, NONNEGATIVE, Bound, quantity, replaced
from .._core.polynomials import cubics, inner_slopes
from ._base import AbstractGas, Stroke


class AbstractDiagram(AbstractGas):
    """A pressure that is given, with the pressure behind the piston beside it."""

    back_pressure: eqx.AbstractVar[Float[Array, ""]]

    @property
    def behind_piston(self):
        return self.back_pressure


class CrankAngleTable(AbstractDiagram):
    """Pressure over crank angle, joined by a periodic cubic with continuous slope.

    The slopes are those of the parabola through three neighbouring points, so the curve is exact at
    its points and linear in them.

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        angle: [rad] (n,) rising, within one revolution.
        cylinder_pressure: [Pa] (n,) absolute, at those angles.
    """

    kind: ClassVar[str] = "crank_angle_table"

    angle: Float[Array, " n"] = quantity(
        "rad", ANY, shape=(None,), doc="rising, within one revolution"
    )
    cylinder_pressure: Float[Array, " n"] = quantity("Pa", NONNEGATIVE, shape=(None,))
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        rising = (self.angle[1:] > self.angle[:-1]).all()
        within = self.angle[-1] - self.angle[0] < 2 * jnp.pi
        return {
            "a table with rising angles within one revolution, the first not again at the end": rising
            & within,
            "a table of at least three points": jnp.asarray(self.angle.size > 2),
        }

    def repaired(self):
        return _with_knots(self, "angle", jnp.linspace(0, 2 * jnp.pi, self.angle.size, False))

    def __check_init__(self):
        _check_same_length(self, "angle", "cylinder_pressure")

    def pressure(self, stroke):
        turn = 2 * jnp.pi
        # With two points of the turn before and after, the slopes at both ends are those of inner
        # points.
        x = jnp.concatenate([self.angle[-2:] - turn, self.angle, self.angle[:2] + turn])
        y = jnp.concatenate(
            [self.cylinder_pressure[-2:], self.cylinder_pressure, self.cylinder_pressure[:2]]
        )
        start = self.angle[0]
        return _curve(start + jnp.mod(stroke.angle - start, turn), x, y)


class FourierDiagram(AbstractDiagram):
    r"""Pressure over crank angle by its harmonics.

    $$p = a_0 + \sum_k a_k\cos k\theta + b_k\sin k\theta$$

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        mean: [Pa] a_0, absolute.
        cosine: [Pa] (k,) a_1, a_2, ...
        sine: [Pa] (k,) b_1, b_2, ...
    """

    kind: ClassVar[str] = "fourier"

    mean: Float[Array, ""] = quantity("Pa", ANY, doc="a_0")
    cosine: Float[Array, " n"] = quantity("Pa", ANY, shape=(None,), doc="a_1, a_2, ...")
    sine: Float[Array, " n"] = quantity("Pa", ANY, shape=(None,), doc="b_1, b_2, ...")
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def __check_init__(self):
        _check_same_length(self, "cosine", "sine")

    def pressure(self, stroke):
        order = jnp.arange(1, self.cosine.size + 1)
        phase = stroke.angle[..., None] * order
        return self.mean + jnp.cos(phase) @ self.cosine + jnp.sin(phase) @ self.sine


class VolumeTable(AbstractDiagram):
    """Pressure over displaced volume, one curve for either direction of the stroke.

    `volume` counts the displaced volume as a fraction of the swept volume, from 0 at the top to 1 at
    the bottom dead centre.

    Args:
        back_pressure: [Pa] absolute, behind the piston.
        volume: [-] (n,) displaced over swept volume, rising from 0 to 1.
        inward_pressure: [Pa] (n,) absolute, while the piston moves towards the head.
        outward_pressure: [Pa] (n,) the same while it moves away.
    """

    kind: ClassVar[str] = "volume_table"

    volume: Float[Array, " n"] = quantity(
        "", Bound(0.0, 1.0), shape=(None,), doc="displaced over swept volume, rising from 0 to 1"
    )
    inward_pressure: Float[Array, " n"] = quantity(
        "Pa", NONNEGATIVE, shape=(None,), doc="while the piston moves towards the head"
    )
    outward_pressure: Float[Array, " n"] = quantity("Pa", NONNEGATIVE, shape=(None,))
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def conditions(self) -> dict[str, Bool[Array, ""]]:
        rising = (self.volume[1:] > self.volume[:-1]).all()
        whole = (self.volume[0] == 0) & (self.volume[-1] == 1)
        return {
            "a table with volumes that rise from 0 to 1": rising & whole,
            "a table of at least three points": jnp.asarray(self.volume.size > 2),
        }

    def repaired(self):
        return _with_knots(self, "volume", jnp.linspace(0, 1, self.volume.size))

    def __check_init__(self):
        _check_same_length(self, "volume", "inward_pressure")
        _check_same_length(self, "volume", "outward_pressure")

    def pressure(self, stroke):
        fraction = stroke.displaced / stroke.swept
        return jnp.where(
            stroke.inward > 0,
            _curve(fraction, self.volume, self.inward_pressure),
            _curve(fraction, self.volume, self.outward_pressure),
        )


class CallableDiagram(AbstractDiagram):
    """Any function of the stroke; an `equinox.Module` with a `__call__` keeps its own parameters.

    Args:
        function: takes a `Stroke`, returns the cylinder pressure [Pa] in the shape of its angle.
        back_pressure: [Pa] behind the piston.
    """

    function: Callable[[Stroke], Float[Array, "*n"]]
    back_pressure: Float[Array, ""] = quantity("Pa", NONNEGATIVE, usual=(1e3, 2e7))

    def pressure(self, stroke):
        return self.function(stroke)


def _curve(x, knots, values):
    """Cubics through the points with the slope of the parabola through three neighbours."""
    secant, inner = inner_slopes(knots, values)
    # At an end, the slope there of the parabola through the last three points.
    first, last = 2 * secant[:1] - inner[:1], 2 * secant[-1:] - inner[-1:]
    return cubics(x, knots, values, jnp.concatenate([first, inner, last]))


def _with_knots(part, name: str, even):
    """A table with even knots where its own break its rules, so that its curve is finite."""
    good = jnp.all(jnp.asarray(list(part.conditions().values())))
    return replaced(part, **{name: jnp.where(good, getattr(part, name), even)})


def _check_same_length(part, first: str, second: str) -> None:
    lengths = getattr(part, first).shape, getattr(part, second).shape
    if lengths[0] != lengths[1]:
        raise ValueError(
            f"`{first}` and `{second}` must have the same length, but have {lengths[0]} and "
            f"{lengths[1]}."
        )
