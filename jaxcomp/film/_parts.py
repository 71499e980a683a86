r"""What bearings share: the oil, by viscosity or by grade and temperature, and the journal."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.display import ZERO_CELSIUS
from .._core.errors import BadInput
from .._core.fields import POSITIVE, Bound, Part, is_traced, quantity
from ._film import Scalar, as_float

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
    celsius = as_float(temperature) - ZERO_CELSIUS
    for name, value, low in (
        ("grade", grade, 0.0),
        ("density", density, 0.0),
        ("temperature", temperature, ZERO_CELSIUS - 95),
    ):
        if not is_traced(value) and not np.all((np.asarray(value) > low) & np.isfinite(value)):
            raise BadInput(name, value, f"> {low:g}")
    # 0.98375: from 15 to 40 degrees the oil loses 6.5e-4 of its density a kelvin.
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

    dynamic_viscosity: Scalar = quantity("Pa s", POSITIVE, usual=(1e-4, 2.0))


class GradedOil(AbstractOil):
    """A mineral oil by its grade and the temperature of the film, see `iso_vg_viscosity`.

    Args:
        grade: [-] ISO VG, the kinematic viscosity at 40 degrees Celsius in mm^2/s.
        temperature: [K] of the film.
        density: [kg/m^3] at 15 degrees Celsius.
    """

    kind: ClassVar[str] = "grade"

    grade: Scalar = quantity(
        "", POSITIVE, doc="ISO VG, in mm^2/s at 40 degrees Celsius", usual=(2.0, 1500.0)
    )
    temperature: Scalar = quantity(
        "K", Bound(low=ZERO_CELSIUS - 95, low_open=True), usual=(250.0, 450.0)
    )
    density: Scalar = quantity(
        "kg/m^3", POSITIVE, default=DENSITY, doc="at 15 degrees Celsius", usual=(600.0, 1300.0)
    )

    @property
    def dynamic_viscosity(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """[Pa s] eta."""
        return iso_vg_viscosity(self.grade, self.temperature, self.density)


class AbstractJournal(Part):
    """Friction of a journal in its bush."""

    @abstractmethod
    def moment(self, load: Float[Array, "*n"], rate: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N m] for a load [N] >= 0 and a relative rate of rotation [rad/s]."""


class NamedBearing(AbstractJournal):
    """A bearing of the machine, by its name among `[bearings.NAME]`.

    `jaxcomp.Machine` puts the bearing itself in its place before anything is computed. In a scene
    file the bare name stands for it: `crank_pin = "big-end"`.

    Args:
        name: of the bearing.
    """

    kind: ClassVar[str] = "bearing"

    name: str = eqx.field(static=True)

    def moment(self, load, rate):
        raise BadInput("bearing", self.name, "resolved by its machine, see `jaxcomp.Machine`")


def oil_viscosity() -> Any:
    """The field of a part's viscosity [Pa s], absent where `oil` names the oil; see `check_oil`."""
    doc = "of the oil; absent where oil names it"
    return quantity("Pa s", POSITIVE, default=None, doc=doc, usual=(1e-4, 2.0))


def check_oil(part) -> None:
    """Refuse a part with neither or both of a viscosity and the name of an oil.

    Raises:
        BadInput: naming `dynamic_viscosity` or `oil`.
    """
    if part.oil is None and part.dynamic_viscosity is None:
        raise BadInput("dynamic_viscosity", "absent", "given, or `oil` the name of an oil")
    if part.oil is not None and part.dynamic_viscosity is not None:
        raise BadInput("oil", part.oil, "absent where `dynamic_viscosity` is given")


def within(length_ratio: Scalar, low: float, high: float) -> Bool[Array, ""]:
    """Whether L/D lies in a range, with a hair of room for a ratio computed to be the bound."""
    return (length_ratio >= low * (1 - 1e-12)) & (length_ratio <= high * (1 + 1e-12))
