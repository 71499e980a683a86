r"""A journal bearing as a machine part: loads and speeds in, moments, positions, stiffness out.

Speed is positive counter-clockwise in the axes (X, Y) of the load vector. The friction moment
follows Eqs. (19)-(23) of Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I).
Mathematical model*, M = eta omega L D R Phi_T/psi.
"""

import math
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from .._core.declared import Record, reading, word
from .._core.errors import BadInput
from .._core.fields import POSITIVE, quantity
from ._contact import LEAST_CLEARANCE, AsperityContact, MixedFilm, MixedSqueeze, RingContact
from ._film import REST_SPEED, AbstractFilm, AbstractSolvedFilm, Scalar, film_ratio, smooth_speed
from ._parts import AbstractJournal, check_oil, oil_viscosity, within
from ._squeeze import AbstractSqueeze, OcvirkSqueeze
from ._squeeze_table import ReynoldsSqueeze
from .explicit_fit import ExplicitFit
from .grooved_reynolds import GroovedReynolds
from .guembel import Guembel
from .loaded_petroff import LoadedPetroff
from .ocvirk import Ocvirk
from .petroff import Petroff
from .reynolds import Reynolds


class _Film(NamedTuple):
    """A film by its name.

    Attributes:
        steady: of a journal that stays where a steady load would hold it.
        moving: of one that moves; `None` for a film without squeeze.
    """

    steady: type[AbstractFilm]
    moving: type[AbstractSqueeze] | None = None


_FILMS = {
    "reynolds": _Film(Reynolds, ReynoldsSqueeze),
    "grooved": _Film(GroovedReynolds),
    "guembel": _Film(Guembel),
    "short": _Film(Ocvirk, OcvirkSqueeze),
    "fit": _Film(ExplicitFit),
    "petroff": _Film(Petroff),
    "loaded_petroff": _Film(LoadedPetroff),
}


def _word(film: str | type[AbstractFilm]) -> str:
    for name, models in _FILMS.items():
        if film in (name, models.steady):
            return name
    raise BadInput("film", str(film), f"one of {', '.join(_FILMS)}")


THIN = "films below count as thin in results; 5 um if absent"
ROUGHNESS = "of both surfaces; a film below it carries nothing; 0.01 um if absent"


class JournalBearing(AbstractJournal):
    """Journal bearing with an oil film: friction, position, stiffness and damping of one part.

    Full (360 degree) ring with p = 0 at its widest gap, aligned, isothermal, isoviscous, laminar,
    unfed. The journal stays where a steady load of each instant would hold it (no squeeze), or
    moves in its film. Films that re-form around a moving journal are full of oil at once, which makes
    them too thick and their loss too low where the feed is starved.

    Args:
        diameter: [m] Journal diameter D.
        length: [m] L of all lands together, without the groove between them.
        radial_clearance: [m] c, bush radius minus journal radius.
        dynamic_viscosity: [Pa s] eta; absent where `oil` names the oil.
        film: Film model by name: "reynolds" for the table of solutions of Reynolds' equation,
            "grooved" for the ring with two axial grooves, "guembel", "short" (Ocvirk); for friction
            and position only "fit" (closed formulas), for friction only "petroff" and "loaded_petroff".
            The attribute `limits` of `model` says where each stops being right. A class of
            `jaxcomp.film` stands for its name. Journals move in "reynolds" and "short" films.
        oil: Name of an oil of the machine, which gives the viscosity.
        thin_film: [m] Films below count as thin in results, such as some times the roughness; absent:
            5 µm.
        roughness: [m] of journal and bush together. A film that is thinner at any time is
            `Status.thin_film`; absent: 0.01 µm, smoother than any bearing.
        contact: of the rough surfaces, which then carry and rub where the film is thin; its roughness
            takes the place of the other one, and no film is too thin.
        lands: Two with a full circumferential groove between them, in parallel, else one.
        motion: "steady", or "orbit" for a journal whose orbit is solved with the crank's motion.

    Raises:
        BadInput: for a value that is not positive, L/D of a land outside the range of the film model,
            another film, one without squeeze beside "orbit" or without a position beside a contact,
            no land, neither or both of `dynamic_viscosity` and `oil`, two roughnesses, or one of a
            contact that is not far below the clearance.

    >>> from jaxcomp.film import minimum_film
    >>> bearing = JournalBearing(0.040, 0.020, 30e-6, 0.02)
    >>> print(f"{1e6 * minimum_film(bearing, 2000.0, 314.0):.2f} um")  # at 2 kN and 314 rad/s
    8.80 um
    >>> print(f"{friction_moment(bearing, 2000.0, 314.0):.4f} N m")
    0.3111 N m
    """

    kind: ClassVar[str] = "film"

    diameter: Scalar = quantity("m", POSITIVE, doc="of the journal", usual=(2e-3, 1.0))
    length: Scalar = quantity("m", POSITIVE, doc="of all lands together", usual=(1e-3, 1.0))
    radial_clearance: Scalar = quantity(
        "m", POSITIVE, doc="bush radius minus journal radius", usual=(1e-6, 1e-3)
    )
    dynamic_viscosity: Scalar | None = oil_viscosity()
    film: Literal["reynolds", "grooved", "guembel", "short", "fit", "petroff", "loaded_petroff"] = (
        eqx.field(static=True, default="reynolds", converter=_word)  # pyright: ignore
    )
    oil: str | None = eqx.field(static=True, default=None)
    thin_film: Scalar | None = quantity("m", POSITIVE, default=None, doc=THIN, usual=(1e-8, 1e-4))
    roughness: Scalar | None = quantity(
        "m", POSITIVE, default=None, doc=ROUGHNESS, usual=(1e-9, 1e-5)
    )
    contact: AsperityContact | None = None
    lands: int = eqx.field(static=True, default=1)
    motion: Literal["steady", "orbit"] = eqx.field(static=True, default="steady")

    def __check_init__(self):
        check_oil(self)
        if self.lands not in (1, 2):
            raise BadInput("lands", self.lands, "1 or 2")
        if self.motion not in ("steady", "orbit"):
            raise BadInput("motion", str(self.motion), '"steady" or "orbit"')
        if self.moves and _FILMS[self.film].moving is None:
            able = ", ".join(word for word, models in _FILMS.items() if models.moving)
            raise BadInput("film", self.film, f'one of {able} beside motion = "orbit"')
        if self.contact is not None:
            films = {word: model.steady for word, model in _FILMS.items()}
            able = ", ".join(
                w for w, model in films.items() if issubclass(model, AbstractSolvedFilm)
            )
            if not issubclass(self.model, AbstractSolvedFilm):
                raise BadInput("film", self.film, f"one of {able} beside a contact")
            if self.roughness is not None:
                raise BadInput("roughness", self.roughness, "absent beside `contact.roughness`")

    @property
    def moves(self) -> bool:
        """Whether the orbit of the journal is solved."""
        return self.motion == "orbit"

    @property
    def model(self) -> type[AbstractFilm]:
        """The class of the film model of a steady load."""
        return _FILMS[self.film].steady

    @property
    def radius(self) -> Scalar:
        """[m] R, of the journal."""
        return self.diameter / 2

    @property
    def clearance_ratio(self) -> Scalar:
        """[-] psi = c/R."""
        return self.radial_clearance / self.radius

    @property
    def length_ratio(self) -> Scalar:
        """[-] q = L/D of a land."""
        return self.length / (self.lands * self.diameter)

    def conditions(self):
        if self.contact is None:
            return self._of_length()
        rough = self.radial_clearance > LEAST_CLEARANCE * self.contact.roughness
        rule = f"of a clearance > {LEAST_CLEARANCE:g} times the roughness of its contact"
        return self._of_length() | {rule: rough}

    def _of_length(self):
        moving = _FILMS[self.film].moving if self.moves else None
        low, high = (moving or self.model).length_ratio_range
        if high == math.inf:
            return {}
        name = (moving or self.model).__name__
        land = " a land" if self.lands > 1 else ""
        rule = f"of length/diameter {low:g} to {high:g}{land} for the film model {name}"
        return {rule: within(self.length_ratio, low, high)}

    def moment(self, load, rate):
        """[N m] Friction moment in the place where a steady load [N] would hold the journal."""
        return friction_moment(self, load, rate)


class PreparedBearing(NamedTuple):
    """A bearing with its film model computed for its L/D, to be used many times.

    Attributes:
        bearing: the bearing.
        film: its film model at its L/D.
    """

    bearing: JournalBearing
    film: AbstractFilm


Bearing = JournalBearing | PreparedBearing


def ring_contact(bearing: JournalBearing) -> RingContact | None:
    """The contact of a journal in its ring; `None` for smooth surfaces."""
    contact = bearing.contact
    if contact is None:
        return None
    stiffness = contact.elastic_factor * contact.modulus
    return RingContact(
        bearing.radial_clearance / contact.roughness,
        stiffness * bearing.radius * bearing.length,
        contact.coefficient,
        bearing.radius,
    )


def film_at(
    bearing: Bearing, speed: Scalar, rest_speed=REST_SPEED, sliding: Scalar | None = None
) -> AbstractFilm:
    """The film model of a bearing at a speed, with the contact beside it if there is one.

    Args:
        bearing: Bearing, prepared or not.
        speed: [rad/s] Speed that builds the pressure.
        rest_speed: [rad/s] Speed below which the load number is held.
        sliding: [rad/s] Journal relative to bush if that is another one.
    """
    bearing, film = prepare(bearing)
    contact = ring_contact(bearing)
    if contact is None:
        return film
    assert isinstance(film, AbstractSolvedFilm)
    unit = film_unit(bearing)
    # Pressure follows the speed of the wedge, rubbing that of the surfaces against each other.
    if sliding is None:
        sliding = speed
    return MixedFilm(
        length_ratio=film.length_ratio,
        film=film,
        contact=contact,
        pace=unit * smooth_speed(speed, rest_speed),
        sliding=unit * smooth_speed(sliding, rest_speed),
        clearance_ratio=bearing.clearance_ratio,
    )


def contact_moment(
    bearing: Bearing, load: Scalar, speed: Scalar, *, rest_speed=REST_SPEED
) -> Scalar:
    """[N m] The part of `friction_moment` that the contact of the surfaces makes; zero without one."""
    film = film_at(bearing, speed, rest_speed)
    if not isinstance(film, MixedFilm):
        # zero with the shape of the arguments, which may be batches
        return 0.0 * load * speed
    bearing, _ = prepare(bearing)
    x = film_ratio(film, load_number(bearing, load, speed, rest_speed=rest_speed))
    unit = moment_unit(bearing)
    return unit * speed * film.rubbing(x)


class BearingSizes(Record, eqx.Module):
    """Dimensions, viscosity, film and contact of a bearing, as results show them."""

    film: str = word(static=True)
    lands: Any = reading("")
    length: Any = reading("m")
    diameter: Any = reading("m")
    clearance: Any = reading("m")
    viscosity: Any = reading("Pa s")
    contact_roughness: Any = reading("m", optional=True, default=None)
    contact_modulus: Any = reading("Pa", optional=True, default=None)
    contact_coefficient: Any = reading("", optional=True, default=None)
    contact_elastic_factor: Any = reading("", optional=True, default=None)


def sizes_of(bearing: JournalBearing) -> BearingSizes:
    """Sizes of a bearing for a result."""
    contact = vars(bearing.contact) if bearing.contact else {}
    return BearingSizes(
        film=bearing.film,
        lands=bearing.lands,
        length=bearing.length,
        diameter=bearing.diameter,
        clearance=bearing.radial_clearance,
        viscosity=bearing.dynamic_viscosity,
        **{f"contact_{name}": value for name, value in contact.items()},
    )


def squeeze_of(bearing: JournalBearing) -> AbstractSqueeze:
    """The film of a moving journal in a bearing; one without squeeze gets that of the finite film."""
    return (_FILMS[bearing.film].moving or ReynoldsSqueeze)(bearing.length_ratio)


def moving_film(bearing: JournalBearing) -> AbstractSqueeze | MixedSqueeze:
    """The film of a moving journal with the contact beside it, if there is one."""
    film = squeeze_of(bearing)
    contact = ring_contact(bearing)
    return film if contact is None else MixedSqueeze(film, contact, film_unit(bearing))


def film_unit(bearing: JournalBearing) -> Scalar:
    """[N s] U = eta L D/psi^2, the unit of film force over speed.

    Raises:
        BadInput: an oil that is named and not filled in yet.
    """
    if bearing.dynamic_viscosity is None:
        raise BadInput("oil", bearing.oil, "resolved by its machine, see `jaxcomp.Machine`")
    area = bearing.length * bearing.diameter
    return bearing.dynamic_viscosity * area / bearing.clearance_ratio**2


def moment_unit(bearing: JournalBearing) -> Scalar:
    """[N m s] eta L D R/psi, the unit of the moment of film and contact over speed."""
    return film_unit(bearing) * bearing.radius * bearing.clearance_ratio


def prepare(bearing: Bearing) -> PreparedBearing:
    """Work out the film model for the L/D of a bearing.

    Every function of this module takes either. Prepare outside a time loop what is used inside.

    Raises:
        BadInput: a bearing whose oil is named and not filled in yet.
    """
    if isinstance(bearing, PreparedBearing):
        return bearing
    if bearing.dynamic_viscosity is None:
        raise BadInput("oil", bearing.oil, "resolved by its machine, see `jaxcomp.Machine`")
    return PreparedBearing(bearing, bearing.model(bearing.length_ratio))


def load_number(bearing: Bearing, load: Scalar, speed: Scalar, *, rest_speed=REST_SPEED) -> Scalar:
    r"""Load number $\Phi_p = W\psi^2/(\eta|\omega| L D)$.

    Args:
        bearing: Bearing.
        load: [N] W, its magnitude counts.
        speed: [rad/s] Speed omega that builds the pressure, see `entrainment_speed`.
        rest_speed: [rad/s] |omega| is sqrt(omega^2 + rest_speed^2).

    Returns:
        [-] Phi_p >= 0, finite at rest.
    """
    bearing = prepare(bearing).bearing
    unit = film_unit(bearing) * smooth_speed(speed, rest_speed)
    return jnp.abs(load) / unit


def entrainment_speed(journal: Scalar, bush: Scalar, load: Scalar) -> Scalar:
    """Speed that builds the pressure, omega_j + omega_b - 2 omega_load.

    A load that turns with the shaft keeps the capacity of a fixed one; at half its speed there is
    none left. Friction follows omega_j - omega_b instead.

    Args:
        journal: [rad/s] Speed of the journal.
        bush: [rad/s] Speed of the bush.
        load: [rad/s] Speed at which the direction of the load turns.

    Returns:
        [rad/s] To be given as `entrainment` or `speed`.
    """
    return journal + bush - 2 * load


def friction_moment(
    bearing: Bearing,
    load: Scalar,
    speed: Scalar,
    *,
    entrainment: Scalar | None = None,
    rest_speed=REST_SPEED,
) -> Scalar:
    r"""Friction moment on the journal, $M = \eta\omega L D R\,\Phi_T/\psi$.

    It resists: the moment on the journal is -M. Odd and smooth in speed, even in the load, equal to
    Petroff's moment at no load, like sqrt(eta omega W) at high load. Quasi-static: no squeeze film.

    Args:
        bearing: Bearing, prepared or not.
        load: [N] W.
        speed: [rad/s] Journal relative to bush.
        entrainment: [rad/s] Speed that builds the pressure if that is another one.
        rest_speed: [rad/s] Speed below which the load number is held.

    Returns:
        [N m] Positive for positive speed.
    """
    building = speed if entrainment is None else entrainment
    film = film_at(bearing, building, rest_speed, speed)
    bearing, _ = prepare(bearing)
    number = load_number(bearing, load, building, rest_speed=rest_speed)
    unit = moment_unit(bearing)
    # Not by a coefficient of friction M/(W R), which has no value without a load.
    return unit * speed * film.friction_number(number)
