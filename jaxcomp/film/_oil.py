r"""Viscosity of mineral oils by grade and temperature."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._fields import POSITIVE, BadInput, Bound, Part, is_traced, quantity
from ._film import Scalar

ZERO_CELSIUS = 273.15  # [K]
DENSITY = 900.0  # [kg/m^3] at 15 degrees Celsius, ordinary mineral oil


def iso_vg_viscosity(grade: Scalar, temperature: Scalar, density: Scalar = DENSITY) -> Scalar:
    r"""Dynamic viscosity of a mineral oil of an ISO viscosity grade.

    $\eta = a\,e^{b/(T + 95)}$, T in degrees Celsius (Vogel's equation with his 95 degrees for oils), with
    $\eta_{40} = 0.98375\cdot10^{-6}\,\rho_{15}\,\mathrm{VG}$,
    $b = 159.55787 \ln(\eta_{40}/0.00018)$ and $a = \eta_{40} e^{-b/135}$.
    An assumption rather than a standard: the constants are those in use with DIN 31652 and VDI 2204,
    but were not checked against either text. They fix the slope by the grade alone, as for a
    mineral oil of a viscosity index of about 95: what makers print for such oils of grades 10 to
    460 at 100 degrees Celsius is met within 6 %. Trust it from some -10 to 120 degrees Celsius. A
    grade is wide by 10 % either way; other oils follow other curves.

    Args:
        grade: [mm2/s] ISO VG, the kinematic viscosity at 40 degrees Celsius (ISO 3448).
        temperature: [K] of the film.
        density: [kg/m3] at 15 degrees Celsius.

    Returns:
        [Pa s] eta.

    Raises:
        BadInput: for a grade or density that is not positive, or a temperature at or below
            -95 degrees Celsius, where the formula has its pole.
    """
    celsius = jnp.asarray(temperature, dtype=jnp.result_type(float)) - ZERO_CELSIUS
    for name, value, low in (
        ("grade", grade, 0.0),
        ("density", density, 0.0),
        ("temperature", temperature, ZERO_CELSIUS - 95),
    ):
        if not is_traced(value) and not np.all((np.asarray(value) > low) & np.isfinite(value)):
            raise BadInput(name, value, f"> {low:g}")
    at_40 = 0.98375e-6 * density * jnp.asarray(grade, dtype=celsius.dtype)
    steepness = 159.55787 * jnp.log(at_40 / 0.00018)
    return at_40 * jnp.exp(steepness * (1 / (celsius + 95) - 1 / 135))


class AbstractOil(Part):
    """An oil that several bearings share."""

    dynamic_viscosity: eqx.AbstractVar[Scalar]


class Oil(AbstractOil):
    """An oil of known viscosity in the film.

    Args:
        dynamic_viscosity: [Pa s] eta.
    """

    kind: ClassVar[str] = "viscosity"

    dynamic_viscosity: Scalar = quantity("Pa s", POSITIVE)


class GradedOil(AbstractOil):
    """A mineral oil by its grade and the temperature of the film, see `iso_vg_viscosity`.

    Args:
        grade: [-] ISO VG, the kinematic viscosity at 40 degrees Celsius in mm^2/s.
        temperature: [K] of the film.
        density: [kg/m^3] at 15 degrees Celsius.
    """

    kind: ClassVar[str] = "grade"

    grade: Scalar = quantity("", POSITIVE, doc="ISO VG, in mm^2/s at 40 degrees Celsius")
    temperature: Scalar = quantity("K", Bound(low=ZERO_CELSIUS - 95, low_open=True))
    density: Scalar = quantity("kg/m^3", POSITIVE, default=DENSITY, doc="at 15 degrees Celsius")

    @property
    def dynamic_viscosity(self) -> Scalar:
        """[Pa s] eta."""
        return iso_vg_viscosity(self.grade, self.temperature, self.density)
