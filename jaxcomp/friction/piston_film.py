"""The film between piston and cylinder."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.fields import POSITIVE, Part, quantity
from ..film._parts import check_oil, oil_viscosity


class PistonFilm(Part):
    r"""Viscous drag of the oil between piston and cylinder, $\eta\pi D L v/c$.

    Eq. (7) of Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*;
    Petroff's law unrolled. `length` is the wetted length of the piston; a
    mechanism that knows the engaged length at every angle passes it instead.

    Args:
        radial_clearance: [m] c, radius of the cylinder minus that of the piston.
        dynamic_viscosity: [Pa s] eta; absent where `oil` names the oil.
        length: [m] L, wetted, where the mechanism does not give it.
        oil: name of an oil of the machine, which gives the viscosity.

    Raises:
        BadInput: neither or both of `dynamic_viscosity` and `oil`.
    """

    kind: ClassVar[str] = "viscous"
    for_each_cylinder: ClassVar[bool] = True

    radial_clearance: Float[Array, ""] = quantity("m", POSITIVE, usual=(1e-6, 1e-3))
    dynamic_viscosity: Float[Array, ""] | None = oil_viscosity()
    length: Float[Array, ""] | None = quantity(
        "m", POSITIVE, default=None, doc="wetted length, where the mechanism does not give it"
    )
    oil: str | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        check_oil(self)

    def force(
        self, bore: Float[Array, ""], length: Float[Array, "*n"], speed: Float[Array, "*n"]
    ) -> Float[Array, "*n"]:
        """[N] for a bore [m], a wetted length [m] and a piston speed [m/s]."""
        # about a concentric piston: at an eccentricity ratio e the drag is 1/sqrt(1 - e^2) times as
        # large
        return self.dynamic_viscosity * jnp.pi * bore * length * speed / self.radial_clearance
