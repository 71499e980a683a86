r"""Operating point of a journal bearing under a steady load, and the pressure in its film."""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.declared import computed, computed_part, computed_word, forwarded, held, reading
from .._core.results import Data, Result
from ._bearing import (
    BearingSizes,
    JournalBearing,
    film_at,
    load_number,
    moment_unit,
    prepare,
    sizes_of,
)
from ._contact import MixedFilm
from ._film import (
    AbstractCarryingFilm,
    AbstractSolvedFilm,
    DynamicCoefficients,
    dynamic_coefficients_at,
    film_ratio,
    film_state_at,
    split,
    threshold_of,
)
from ._reference import reference_solution
from ._running import bush_moment_at, in_fixed_axes
from .grooved_reynolds import GroovedReynolds
from .guembel import Guembel
from .ocvirk import Ocvirk
from .reynolds import Reynolds

# [-] Least film thickness over the clearance at which the pressure field is solved. The pressure of a
# thinner film follows from its growth with the power -1.5 of the thickness.
_LEAST_THICKNESS = 1e-4
_GRIDS = ((60, 8), (120, 16), (240, 32))
_FRAME = "x along the load on the journal, y = x turned by 90 degrees with rotation"
# Of the force and of the motion that stiffness and damping stand for.
_AXES = ("force", "motion")


class OperatingPoint(Result, eqx.Module):
    """Steady state of a bearing; what the film model does not give is `None`.

    Stiffness and damping have the axes x along the load on the journal and y, x turned by 90 degrees
    with rotation.

    Attributes:
        phi_p: [-] load number $W\\psi^2/(\\eta\\omega L D)$.
        sommerfeld_number: [-] $1/(2\\pi\\Phi_p)$; infinite without a load.
        phi_t: [-] friction number.
        friction_torque: [N m] on the journal.
        eccentricity_ratio: [-] e/c.
        minimum_film: [m]
        attitude_angle: [rad] from the load line to the line of centres.
        bush_torque: [N m] on the bush.
        stiffness: [N/m] (2, 2)
        damping: [N s/m] (2, 2)
        dimensionless_stiffness: [-] (2, 2) times c/W.
        dimensionless_damping: [-] (2, 2) times c omega/W.
        critical_mass: [kg] largest stable mass of a rigid rotor, of one bearing.
        whirl_ratio: [-] whirl frequency at the limit of stability over the speed.
        contact_load: [N] of the contact of rough surfaces, along the line of centres.
        contact_torque: [N m] part of `friction_torque` that the contact makes.
    """

    phi_p: Float[Array, ""] = reading("")
    sommerfeld_number: Float[Array, ""] = reading("")
    phi_t: Float[Array, ""] = reading("")
    friction_torque: Float[Array, ""] = reading("N m")
    eccentricity_ratio: Float[Array, ""] | None = reading("", default=None)
    minimum_film: Float[Array, ""] | None = reading("m", default=None)
    attitude_angle: Float[Array, ""] | None = reading("rad", default=None)
    bush_torque: Float[Array, ""] | None = reading("N m", default=None)
    stiffness: Float[Array, "2 2"] | None = reading("N/m", *_AXES, default=None)
    damping: Float[Array, "2 2"] | None = reading("N s/m", *_AXES, default=None)
    dimensionless_stiffness: Float[Array, "2 2"] | None = reading("", *_AXES, default=None)
    dimensionless_damping: Float[Array, "2 2"] | None = reading("", *_AXES, default=None)
    critical_mass: Float[Array, ""] | None = reading("kg", default=None)
    whirl_ratio: Float[Array, ""] | None = reading("", default=None)
    contact_load: Float[Array, ""] | None = reading("N", default=None)
    contact_torque: Float[Array, ""] | None = reading("N m", default=None)

    table_dims: ClassVar[tuple[str, ...]] = _AXES


class PressureField(Result, eqx.Module):
    """Pressure of a film over its ring and half its length.

    Attributes:
        angle: [rad] (n,) from the load with rotation.
        zeta: [-] (m,) from the mid-plane (0) to the end (1) of the bearing.
        pressure: [Pa] (n, m)
        peak_pressure: [Pa]
        side_flow: [m^3/s] through both ends.
    """

    angle: np.ndarray = reading("rad", "angle", doc="from the load, with rotation")
    zeta: np.ndarray = reading("", "zeta", doc="from the mid-plane to the end of the bearing")
    pressure: np.ndarray = reading("Pa", "angle", "zeta")
    peak_pressure: float = reading("Pa")
    side_flow: float = reading("m^3/s", doc="through both ends")

    table_dims: ClassVar[tuple[str, ...]] = ("angle", "zeta")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class SteadyBearing(Result):
    """A bearing under a steady load.

    Attributes:
        bearing: with its film model.
        load: [N] on the journal.
        speed: [rad/s] of the journal; negative against the sense in which angles count.
        point: its operating point, at the size of the speed.
        field: the pressure in its film; `None` where the film model gives none.
    """

    bearing: JournalBearing
    load: float = reading("N")
    speed: float = reading("rad/s")
    point: OperatingPoint = held()
    field: PressureField | None = held()

    table_dims: ClassVar[tuple[str, ...]] = _AXES

    @computed_word()
    def limits(self) -> str:
        """Limits of the film model."""
        return self.bearing.model.limits

    @computed_word()
    def frame(self) -> str:
        """Axes of stiffness and damping."""
        return _FRAME

    @computed_part(BearingSizes, inline=True)
    def sizes(self) -> BearingSizes:
        """Dimensions, viscosity and film of the bearing."""
        return sizes_of(self.bearing)

    @computed("")
    def length_ratio(self) -> Any:
        """[-] Length over diameter."""
        return self.bearing.length_ratio

    @computed("")
    def clearance_ratio(self) -> Any:
        """[-] Radial clearance over radius."""
        return self.bearing.clearance_ratio

    @computed_part(OperatingPoint, inline=True)
    def signed_point(self) -> OperatingPoint:
        """The operating point with torques in the sense of the speed.

        A number that is infinite (the Sommerfeld number at no load) is `None` in JSON, and so is a matrix
        of which an entry is missing.
        """
        numbers = vars(self.point).copy()
        for name, value in numbers.items():
            if np.ndim(value) and not np.all(np.isfinite(value)):
                numbers[name] = None
        # The point was found at the size of the speed: torques get the sign back here.
        for name in ("friction_torque", "bush_torque"):
            if numbers[name] is not None:
                numbers[name] = math.copysign(1.0, self.speed) * float(numbers[name])
        return OperatingPoint(**numbers)

    @computed("W")
    def friction_power(self) -> Any:
        """[W] Power that the journal loses in the film."""
        return self.signed_point.friction_torque * self.speed

    peak_pressure = forwarded(PressureField, "field.peak_pressure")
    side_flow = forwarded(PressureField, "field.side_flow")

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; `field` has those of the film."""
        yield from self.data_of("load", "speed")
        yield from self.point.described()
        yield from self.data_of("peak_pressure", "side_flow")


def steady_bearing(bearing: JournalBearing, load: float, speed: float) -> SteadyBearing:
    """Run a bearing under a steady load: its operating point and the pressure in its film.

    Args:
        bearing: with its film model.
        load: [N] on the journal, >= 0.
        speed: [rad/s] of the journal, not 0.

    >>> found = steady_bearing(JournalBearing(0.04, 0.02, 30e-6, 0.02), 2000.0, 300.0)
    >>> print(f"{found.point.eccentricity_ratio:.3f}, {found.field.peak_pressure / 1e6:.2f} MPa")
    0.714, 7.89 MPa
    """
    # Numbers of NumPy, because Python's are static: each load would be a program of its own.
    point = _operating_point(bearing, np.float64(load), np.float64(abs(speed)))
    return SteadyBearing(bearing, load, speed, point, pressure_field(bearing, point, abs(speed)))


def operating_point(
    bearing: JournalBearing, load: Float[Array, ""], speed: Float[Array, ""]
) -> OperatingPoint:
    """Position, friction, stiffness and damping of a bearing under a steady load.

    Args:
        bearing: with its film model.
        load: [N] on the journal, >= 0.
        speed: [rad/s] of the journal, > 0.
    """
    # A steady speed above zero needs no smoothing through rest: rest speeds are zero.
    load = jnp.asarray(load, float)
    speed = jnp.asarray(speed, float)
    prepared = prepare(bearing)
    bearing = prepared.bearing
    # with the contact beside it, if there is one
    film = film_at(prepared, speed, 0.0)
    gap = bearing.radial_clearance
    number = load_number(bearing, load, speed, rest_speed=0.0)
    unit = moment_unit(bearing)
    entries: dict[str, Any] = {}
    # The position is sought once: each search for it is a large part of the program.
    x = None
    if isinstance(film, AbstractCarryingFilm):
        x = film_ratio(film, number)
        entries |= {"eccentricity_ratio": x / (1 + x), "minimum_film": gap / (1 + x)}
    if isinstance(film, MixedFilm):
        entries["contact_load"] = film.contact.forces(entries["eccentricity_ratio"])[0]
        entries["contact_torque"] = unit * speed * film.rubbing(x)
    if isinstance(film, AbstractSolvedFilm):
        phi_t = film.friction_number_at(x, number)
        entries |= _carried(bearing, film, x, number, load, speed)
    else:
        phi_t = film.friction_number(number)
    return OperatingPoint(
        phi_p=number,
        sommerfeld_number=1 / (2 * jnp.pi * number),
        phi_t=phi_t,
        friction_torque=unit * speed * phi_t,
        **entries,
    )


def _carried(
    bearing: JournalBearing, film: AbstractSolvedFilm, x, number, load, speed
) -> dict[str, Any]:
    """Entries of an operating point that follow from the direction of the film's force.

    Args:
        bearing: with its film model.
        film: that model, with the contact beside it.
        x: [-] film ratio.
        number: [-] load number.
        load: [N] on the journal.
        speed: [rad/s] of the journal.
    """
    state = film_state_at(film, x)
    coefficients = dynamic_coefficients_at(film, x)
    # The load along X makes the axes of stiffness and damping those of `_FRAME`.
    _, along = split(jnp.stack([load, 0.0 * load]))
    stiffness, damping = in_fixed_axes(bearing, coefficients, along, speed, 0.0)
    per_load = DynamicCoefficients(coefficients.stiffness / number, coefficients.damping / number)
    threshold = threshold_of(per_load)
    critical_mass = threshold.critical_mass * load / (bearing.radial_clearance * speed**2)
    return {
        "attitude_angle": state.attitude_angle,
        "bush_torque": bush_moment_at(bearing, state, load, speed, 0.0),
        "stiffness": stiffness,
        "damping": damping,
        "dimensionless_stiffness": per_load.stiffness,
        "dimensionless_damping": per_load.damping,
        "critical_mass": critical_mass,
        "whirl_ratio": threshold.whirl_ratio,
    }


_operating_point = eqx.filter_jit(operating_point)


def pressure_field(
    bearing: JournalBearing, point: OperatingPoint, speed: float
) -> PressureField | None:
    """Pressure of the film at an operating point, by finite volumes, or by Ocvirk's closed form.

    The films of `Petroff` and the explicit fit have none. Not differentiable.

    Args:
        bearing: with its film model.
        point: of `operating_point`.
        speed: [rad/s] of the journal, > 0.
    """
    if bearing.model not in (Reynolds, GroovedReynolds, Guembel, Ocvirk):
        return None
    assert point.minimum_film is not None
    assert point.attitude_angle is not None
    gap = float(bearing.radial_clearance)
    length = float(bearing.length)
    radius = float(bearing.diameter / 2)
    unit = float(bearing.dynamic_viscosity) * speed / (gap / radius) ** 2
    thickness = float(point.minimum_film) / gap
    solved_at = max(thickness, _LEAST_THICKNESS)
    eps = float(point.eccentricity_ratio)
    if solved_at > thickness:
        eps = 1 - solved_at
    solved = reference_solution(
        eps,
        float(bearing.length_ratio),
        cavitation="guembel" if bearing.model is Guembel else "reynolds",
        grooved=bearing.model is GroovedReynolds,
        coefficients=False,
        grids=_GRIDS,
    )
    growth = (solved_at / thickness) ** 1.5
    pressure = solved.pressure * growth
    peak = solved.peak_pressure * growth
    flow = solved.side_flow
    if bearing.model is Ocvirk:
        film = Ocvirk(float(bearing.length_ratio))
        e = float(point.eccentricity_ratio)
        x = e / thickness
        # the largest pressure lies where (1 + eps cos) cos = -3 eps sin^2
        cosine = 0.0
        if e:
            cosine = (1 - np.sqrt(1 + 24 * e**2)) / (4 * e)
        top = np.arccos(np.clip(cosine, -1, 1))
        pressure = np.asarray(film.pressure(x, solved.theta[:, None], solved.zeta))
        peak = float(film.pressure(x, top, 0.0))
        flow = e  # all oil between the thickest and the thinnest film leaves through the ends
    # theta counts from the widest gap, which is opposite e_r; e_r is at phi ahead of the load.
    angle = solved.theta - np.pi + float(point.attitude_angle)
    side_flow = flow * gap * radius * speed * length
    return PressureField(angle, solved.zeta, pressure * unit, float(peak * unit), float(side_flow))
