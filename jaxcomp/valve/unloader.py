"""Unloader of a suction valve: fingers that hold its plate away from the seat."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.extremes import clip, minimum
from .._core.fields import NONNEGATIVE, Bound, Part, is_traced, quantity

# [rad] Angles of the end at which the force may begin to fall, while gas is pushed back, and to rise.
_RELEASED = Bound(np.pi, 2 * np.pi)
_ENGAGED = Bound(0.0, np.pi)


class Unloader(Part):
    """Fingers that press the plate of a suction valve towards its stop.

    Held over the whole revolution, the end of the cylinder takes gas in and pushes it back. With a
    release the plate is held until then alone, and what is in the cylinder by then is compressed. A
    force that the gas on its way back overcomes lets the valve shut by itself, earlier.

    Args:
        force: [N] of the fingers.
        release: [rad] crank angle from the top dead centre of the end at which the force begins to
            fall, between half a revolution and a whole one; held over the whole revolution if absent.
        engagement: [rad] crank angle at which the force begins to rise again, while gas is drawn.
        duration: [rad] within which the force rises and falls.

    Raises:
        BadInput: a duration that does not fit between engagement and release.
    """

    kind: ClassVar[str] = "unloader"

    force: Float[Array, ""] = quantity(
        "N", NONNEGATIVE, doc="of the fingers on the plate", usual=(1.0, 1e4)
    )
    release: Float[Array, ""] | None = quantity(
        "rad",
        _RELEASED,
        default=None,
        doc="from the top dead centre of the end, at which the force begins to fall; absent: never",
    )
    engagement: Float[Array, ""] = quantity(
        "rad",
        _ENGAGED,
        default=np.pi / 2,
        doc="from there, at which the force begins to rise again",
    )
    duration: Float[Array, ""] = quantity(
        "rad",
        Bound(0.0, np.pi, True),
        default=np.pi / 18,
        doc="within which the force rises and falls",
    )

    def __check_init__(self):
        if self.release is None or any(map(is_traced, (self.release, self.engagement))):
            return
        if not bool(_RELEASED.inside(self.release) & _ENGAGED.inside(self.engagement)):
            return  # which its bound says
        # The force has risen before it falls, and fallen before it rises again.
        held = self.release - self.engagement
        longest = minimum(held, 2 * np.pi - held)
        if not is_traced(self.duration) and bool(self.duration > longest):
            size = f"{longest:.5g} rad ({np.rad2deg(longest):.4g} deg)"
            bound = f"<= {size}, between engagement and release"
            raise BadInput("duration", self.duration, bound)

    def force_at(self, angle: Float[Array, ""]) -> Float[Array, ""]:
        """[N] At a crank angle [rad] of the end.

        It rises and falls with two continuous derivatives.
        """
        if self.release is None:
            return self.force
        turn = 2 * np.pi
        since = jnp.mod(angle - self.engagement, turn)
        held = jnp.mod(self.release - self.engagement, turn)
        rise = _smooth_step(since / self.duration)
        fall = _smooth_step((since - held) / self.duration)
        return self.force * (rise - fall)

    def bends(self) -> Float[Array, "4 *n"]:
        """[rad] Crank angles at which the force begins and ceases to rise and to fall.

        Of an unloader with a release.
        """
        assert self.release is not None
        begins = [self.engagement, self.release]
        return jnp.stack([*begins, *(angle + self.duration for angle in begins)])


def _smooth_step(share: Float[Array, ""]) -> Float[Array, ""]:
    x = clip(share, 0.0, 1.0)
    return x**3 * (10 + x * (6 * x - 15))
