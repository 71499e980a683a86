"""The oil films of the journals over a revolution, of those that move and of those that do not.

A journal that moves is where its orbit has it. One with a steady film is, at every instant, where the
load of that instant would hold it for ever: squeeze, which keeps a film thicker where the load turns
quickly, is left out.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.declared import reading
from .._core.each import of_cylinder
from .._core.exported import kept_jit
from .._core.extremes import clip, max_of, maximum, min_of, minimum
from .._core.polynomials import Rule, gauss
from .._core.results import Result
from ..compressor import Compressor
from ..crankshaft._bearings import film_journals
from ..film import AbstractSolvedFilm, JournalBearing, minimum_film
from ..film._bearing import (
    film_unit,
    friction_moment,
    load_number,
    prepare,
    ring_contact,
    squeeze_of,
)
from ..film._film import AbstractCarryingFilm
from ..film._placed import shear_drag
from ..film._running import running_state
from ..film._squeeze import quarter_turn, slopes_along
from ..friction._joint_laws import EachJournal
from ._journals import position_error, rate_shares
from ._orbit import Orbit
from ._panels import farthest, highest

# [J/(m^3 K)] Heat capacity of oil, 860 kg/m^3 times 2000 J/(kg K).
OIL_HEAT_CAPACITY = 1.72e6
# [m] Below counts as a thin film where a bearing names no other.
THIN_FILM = 5e-6
# [m] of both surfaces together where a bearing names no other: less than that of any bearing.
ROUGHNESS = 1e-8


class JournalFilm(Result, eqx.Module):
    """The film of one journal at the n nodes of an orbit.

    Attributes:
        moving: whether the orbit was solved.
        position: [-] (2, n) centre of the journal over the clearance, in the axes of the joint's force.
        load: [N] (2, n) on the journal.
        thickness: [m] (n,) smallest round the ring.
        pressure: [Pa] (n,) largest in the film.
        flow: [m^3/s] (n,) out of both ends of the pressure zone.
        shear_loss, squeeze_loss: [W] (n,) parts of the dissipation. The work of the load in the wedge
            is squeeze here: all that the pressure dissipates.
        minimum_film: [m] over the revolution.
        largest_pressure: [Pa] over the revolution.
        largest_eccentricity: [-] at most 1, also where a coarse orbit leaves its bush.
        film_error: [m] estimated error of the smallest film, by what the last terms of the polynomials
            on the panels of the revolution have left.
        mean_flow: [m^3/s] in time, as all means.
        mean_shear_loss, mean_squeeze_loss: [W]
        temperature_rise: [K] of the oil that flows out, if it carries the whole loss away; infinite
            where none does.
        stiffness: [N/m] (2, 2) mean of the film's along the orbit, dF/d(c e) at a given velocity of the
            centre; of a journal that does not move, at its places.
        damping: [N s/m] (2, 2) likewise, dF/d(c de/dt).
        thin_share: [-] of the time, in which the film is below `thin_film` of its bearing, or 5 µm.
        steady_film, steady_loss: [m], [W] smallest film and mean loss of the same loads carried steadily.
        contact_load: [N] (n,) of the contact of rough surfaces, along the line of centres; the film has
            the rest. Zero without a contact, as the next ones.
        contact_loss: [W] (n,) by their rubbing, beside the losses of the film.
        duration: [s] (n,) quadrature weights over the revolution.
        mean_contact_loss: [W]
    """

    moving: bool = eqx.field(static=True)
    position: Float[Array, "2 n"] = reading("", "axis", "node")
    load: Float[Array, "2 n"] = reading("N", "axis", "node")
    thickness: Float[Array, " n"] = reading("m", "node")
    pressure: Float[Array, " n"] = reading("Pa", "node")
    flow: Float[Array, " n"] = reading("m^3/s", "node")
    shear_loss: Float[Array, " n"] = reading("W", "node")
    squeeze_loss: Float[Array, " n"] = reading("W", "node")
    minimum_film: Float[Array, ""] = reading("m")
    largest_pressure: Float[Array, ""] = reading("Pa")
    largest_eccentricity: Float[Array, ""] = reading("")
    film_error: Float[Array, ""] = reading("m")
    mean_flow: Float[Array, ""] = reading("m^3/s")
    mean_shear_loss: Float[Array, ""] = reading("W")
    mean_squeeze_loss: Float[Array, ""] = reading("W")
    temperature_rise: Float[Array, ""] = reading("K")
    stiffness: Float[Array, "2 2"] = reading("N/m", "force", "motion")
    damping: Float[Array, "2 2"] = reading("N s/m", "force", "motion")
    thin_share: Float[Array, ""] = reading("")
    steady_film: Float[Array, ""] = reading("m")
    steady_loss: Float[Array, ""] = reading("W")
    duration: Float[Array, " n"] = reading("s", "node")
    contact_load: Float[Array, " n"] = reading("N", "node", doc="along the line of centres")
    contact_loss: Float[Array, " n"] = reading("W", "node")
    mean_contact_loss: Float[Array, ""] = reading("W")

    table_dims: ClassVar[tuple[str, ...]] = ("node",)

    def share_below(self, thickness: float | Float[Array, ""]) -> Float[Array, ""]:
        """[-] Share of the revolution's time in which the film is thinner than a thickness [m]."""
        return _share_below(self.thickness, self.duration, thickness)


def journal_rates(compressor: Compressor, orbit: Orbit) -> dict[str, Float[Array, " n"]]:
    """[rad/s] Speed of each journal in its bush over the nodes, by joint.

    Args:
        compressor: the machine.
        orbit: its periodic state, or anything with its `state` and `loads`.
    """
    speed = orbit.state.speed
    shares = rate_shares(compressor, orbit.state.angle)
    rates = dict.fromkeys(orbit.loads.forces, speed)
    return rates | {name: share * speed for name, (share, _) in shares.items()}


def thin_film(law: JournalBearing) -> float | Float[Array, ""]:
    """[m] Below which the film of a bearing counts as thin."""
    return THIN_FILM if law.thin_film is None else law.thin_film


def _share_below(values, duration, bound):
    """Share of the time below a bound of what goes in straight lines between the nodes."""
    # Interpolated and not counted node by node: the share is continuous in the design then, and has
    # derivatives.
    after, wide = (jnp.roll(x, -1) for x in (values, duration))
    low = minimum(values, after)
    high = maximum(values, after)
    rise = jnp.where(high > low, high - low, 1.0)
    part = jnp.where(high > low, clip((bound - low) / rise, 0, 1), low < bound)
    return jnp.sum((duration + wide) * part) / jnp.sum(duration + wide)


@kept_jit
def film_thickness(compressor: Compressor, orbit: Orbit) -> dict[str, Float[Array, " n"]]:
    """[m] Smallest thickness of each journal's oil film over the nodes, by joint.

    Args:
        compressor: the machine.
        orbit: its periodic state.
    """
    thickness = {}
    moved = orbit.positions or {}
    rates = journal_rates(compressor, orbit)
    for name, law in oil_films(compressor, orbit):
        if name in moved:
            thickness[name] = law.radial_clearance * (1 - jnp.hypot(*moved[name]))
        elif issubclass(law.model, AbstractCarryingFilm):
            load = jnp.hypot(*orbit.loads.forces[name])
            thickness[name] = minimum_film(law, load, jnp.abs(rates[name]))
    return thickness


def oil_films(compressor: Compressor, orbit: Orbit):
    """Joints with oil films, and their laws."""
    crankshaft = compressor.crankshaft
    friction = compressor.friction
    laws = {} if friction is None else vars(friction)
    for law_name, law in film_journals(friction, crankshaft.main_journal).items():
        if law_name not in laws:
            yield law_name, law
    for number in range(1, crankshaft.count + 1):
        for law_name, law in laws.items():
            bearing = law
            if isinstance(law, EachJournal):
                bearing = law.law_of_cylinder(number)
            if isinstance(bearing, JournalBearing):
                yield crankshaft.joint(law_name, number), of_cylinder(bearing, number)


@kept_jit
def journal_films(compressor: Compressor, orbit: Orbit) -> dict[str, JournalFilm]:
    """The films of all oil-lubricated journals whose film model gives a position, by joint.

    Differentiable.

    Args:
        compressor: the machine.
        orbit: its periodic state.
    """
    speed = orbit.state.speed
    shares = rate_shares(compressor, orbit.state.angle)
    positions = orbit.positions or {}
    films = {}
    for name, law in oil_films(compressor, orbit):
        if not issubclass(law.model, AbstractSolvedFilm):
            continue
        difference, total = shares.get(name, (1.0, 1.0))
        films[name] = read_film(
            law,
            position=positions.get(name),
            # on the journal, where the force of a joint is that on the other part
            load=-orbit.loads.forces[name],
            rates=(difference * speed, total * speed),
            duration=orbit.weight / speed,
            rule=gauss(orbit.panel_nodes),
            width=orbit.panel_width,
        )
    return films


def read_film(law, position, load, rates, duration, rule: Rule, width) -> JournalFilm:
    """Film of a journal at given places (`None`: those of a steady film) and loads.

    Args:
        law: the bearing.
        position: (2, n) over the clearance.
        load: [N] (2, n).
        rates: [rad/s] difference and sum of the rates of journal and bush, (n,).
        duration: [s] quadrature weights.
        rule: of the panels that these are the nodes of.
        width: [rad] of the panels, (p,).
    """

    def largest_of(values):
        return highest(rule, width, values.reshape(*width.shape, -1))

    def mean(values):
        return jnp.sum(duration * values, axis=-1) / jnp.sum(duration)

    difference = rates[0]
    gap = law.radial_clearance
    moves = position is not None
    # the same load carried steadily
    size = jnp.hypot(*load)
    resting = minimum_film(law, size, jnp.abs(difference))
    resting_loss = friction_moment(law, size, difference) * difference
    # above zero, as all between which it is sought
    steady_film = jnp.exp(-largest_of(-jnp.log(resting)))

    if position is None:
        position = _steady_position(law, load, difference)
        # the steady film has the sum of the rates in the place of their difference
        rates = difference, difference
    thickness = resting
    if moves:
        thickness = gap * (1 - jnp.hypot(*position))
    at, (stiffness, damping) = _at_nodes(law, position, load, rates, moves, resting_loss)

    on_panels = position.reshape(2, -1, rule.nodes.size)
    # the polynomials of a coarse orbit may leave the bush between their nodes
    largest = minimum(farthest(rule, width, on_panels), 1.0)
    loss = mean(at["shear_loss"] + at["squeeze_loss"] + at["contact_loss"])
    leaving = mean(at["flow"])
    # the coefficients come over the clearance, as the positions do
    force_unit = film_unit(law) / gap
    return JournalFilm(
        moving=moves,
        position=position,
        load=load,
        thickness=thickness,
        **at,
        minimum_film=gap * (1 - largest) if moves else steady_film,
        largest_pressure=largest_of(at["pressure"]),
        largest_eccentricity=largest,
        film_error=gap * position_error(rule, on_panels),
        mean_flow=leaving,
        mean_shear_loss=mean(at["shear_loss"]),
        mean_squeeze_loss=mean(at["squeeze_loss"]),
        temperature_rise=_temperature_rise(loss, leaving),
        stiffness=force_unit * mean(stiffness),
        damping=force_unit * mean(damping),
        thin_share=_share_below(thickness, duration, thin_film(law)),
        steady_film=steady_film,
        steady_loss=mean(resting_loss),
        duration=duration,
        mean_contact_loss=mean(at["contact_loss"]),
    )


def _at_nodes(law, position, load, rates, moves: bool, resting_loss):
    """The entries of `JournalFilm` that places and loads give at every node, and the coefficients there.

    Args:
        law, position, load, rates: as in `read_film`.
        moves: whether the journal moves through the places; else it rests at each.
        resting_loss: [W] where it rests.
    """
    difference, total = rates
    gap = law.radial_clearance
    film = squeeze_of(law)
    unit = film_unit(law)
    contact = ring_contact(law)
    # what rough surfaces carry in contact, the film need not
    push = 0 * load
    rubbing = 0 * difference
    carried = load
    if contact is not None:
        push = contact.push(position)
        carried = load - push
        rubbing = contact.torque(position, difference) * difference
    force = carried / unit

    shear = shear_drag(law, position) * difference**2
    if moves:
        velocity = film.mobility(position, force)
        squeeze = gap * jnp.sum(carried * velocity, axis=0)
    else:  # the wedge of a journal at rest is squeeze in axes that turn at half the rate
        velocity = -0.5 * difference * quarter_turn(position)
        squeeze = resting_loss - shear - rubbing
    scale = law.dynamic_viscosity / law.clearance_ratio**2

    stiffness, damping = _coefficients(film, position, force, 0.5 * total)
    if contact is not None:
        _, columns = slopes_along(contact.push, position)
        stiffness = stiffness + jnp.stack(columns, axis=1) / unit
    at = {
        "pressure": scale * film.peak_pressure(position, force, velocity),
        "flow": law.radius * law.length * gap * film.side_flow(position, force, velocity),
        "shear_loss": shear,
        "squeeze_loss": squeeze,
        # hypot(0, 0) has no derivative: where there is no contact, one of its zeros does
        "contact_load": jnp.hypot(*push) if contact is not None else push[0],
        "contact_loss": rubbing,
    }
    return at, (stiffness, damping)


def _steady_position(law, load, rate) -> Float[Array, "2 n"]:
    """[-] Where a load [N] (2, n) holds the journal for ever at a rate [rad/s] against its bush."""
    size = jnp.hypot(*load)
    state = running_state(law, size, jnp.abs(rate))
    turn = jnp.sign(rate) * state.attitude_angle
    # without a load there is no direction; the eccentricity is zero there as well
    along = load / jnp.where(size > 0, size, 1.0)
    side = quarter_turn(along)
    return state.eccentricity_ratio * (jnp.cos(turn) * along + jnp.sin(turn) * side)


def _temperature_rise(loss: Float[Array, ""], flow: Float[Array, ""]) -> Float[Array, ""]:
    """[K] Of a flow of oil [m^3/s] that carries a loss [W] away; infinite where none flows."""
    # double where: the quotient of no flow would put a NaN into the derivatives of the other side
    rise = loss / (OIL_HEAT_CAPACITY * jnp.where(flow > 0, flow, 1.0))
    return jnp.where(flow > 0, rise, jnp.full_like(rise, jnp.inf))


def roughness_of(law: JournalBearing) -> float | Float[Array, ""] | None:
    """[m] Below which a film carries nothing; `None` where a contact does."""
    if law.contact is not None:
        return None
    return ROUGHNESS if law.roughness is None else law.roughness


def has_thin_film(compressor: Compressor, orbit: Orbit) -> Bool[Array, ""]:
    """Whether the film of a journal is thinner than its roughness at a node of the orbit.

    Surfaces with a contact carry then. A steady film is asked only where its journal does not come to
    rest: there squeeze holds it up, of which the film knows nothing.
    """
    moved = orbit.positions or {}
    rates = journal_rates(compressor, orbit)
    thin = jnp.asarray(False)
    for name, law in oil_films(compressor, orbit):
        gap = law.radial_clearance
        roughness = roughness_of(law)
        if roughness is None:
            continue
        if name in moved:
            thin |= jnp.any(gap * (1 - jnp.hypot(*moved[name])) < roughness)
        elif issubclass(law.model, AbstractCarryingFilm):
            bearing = prepare(law)
            rate = rates[name]
            film: Any = bearing.film
            # The film ratio c/h - 1 of a film as thick as the roughness: compared by the load that it
            # carries, so that no position of the journal has to be sought.
            ratio = maximum(gap / roughness - 1, 0.0)
            largest_number = ratio * film.load_gain(ratio)
            number = load_number(bearing, jnp.hypot(*orbit.loads.forces[name]), rate)
            # a rate that keeps its sign all the revolution
            turns = min_of(rate) * max_of(rate) > 0
            thin |= turns & jnp.any(number > largest_number)
    return thin


def _coefficients(film, position, force, turning):
    """dF/de at a given de/dt, and dF/d(de/dt), (2, 2, n): from the mobility V = M(e, F)."""
    # V = M(e, F) with F as the unknown: dV = M_e de + M_F dF, so that dF/dV = M_F^-1 and, at a given V,
    # dF/de = -M_F^-1 M_e. The mobility gives V in axes that turn with the mean of the surfaces; in fixed
    # ones `turn` is part of it.
    ones = jnp.ones_like(force[0])
    zeros = jnp.zeros_like(force[0])
    axes = (jnp.stack([ones, zeros]), jnp.stack([zeros, ones]))
    unmoved = jnp.zeros_like(force)

    def slopes(pairs):
        moved = [jax.jvp(film.mobility, (position, force), pair)[1] for pair in pairs]
        return jnp.stack(moved, axis=1)

    by_place = slopes((axis, unmoved) for axis in axes)
    by_force = slopes((unmoved, axis) for axis in axes)
    size = by_force[0, 0] * by_force[1, 1] - by_force[0, 1] * by_force[1, 0]
    swapped = jnp.stack([jnp.stack([by_force[1, 1], -by_force[0, 1]]),
                         jnp.stack([-by_force[1, 0], by_force[0, 0]])])  # fmt: skip
    damping = swapped / jnp.where(size > 0, size, 1.0)
    turn = jnp.array([[0.0, -1.0], [1.0, 0.0]])[..., None] * turning
    stiffness = jnp.einsum("abn,bcn->acn", damping, -by_place - turn)
    return stiffness, damping
