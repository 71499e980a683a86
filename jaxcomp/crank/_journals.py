r"""Orbits of the journals in their films, on the panels of the crank's revolution.

Over the crank angle the centre $c\,e$ of a journal obeys, with F the load on it in fixed axes,

$$\frac{de}{d\theta} = M\big(e, F/(U\omega)\big) + \frac{\omega_j + \omega_b}{2\omega}\,J e .$$

A step of Newton's method for the periodic solution eliminates the nodes of every panel, joins the maps of
two components that are left over the panels, and closes the revolution. The loads are those of the rigid
mechanism: the clearance is a thousandth of the stroke.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .._core.each import mapped, of_cylinder
from .._core.extremes import max_of, maximum, min_of, minimum
from .._core.fields import rebuilt
from .._core.polynomials import Rule
from .._core.status import Status
from ..compressor import Compressor
from ..crankshaft._bearings import moving_journals, with_journal_positions
from ..film import AbstractSqueeze, JournalBearing
from ..film._bearing import film_unit, moving_film, ring_contact
from ..film._contact import MixedSqueeze
from ..film._placed import shear_drag
from ..film._squeeze import quarter_turn
from ..mechanism import CrankState, SliderCrank, rod_motion
from ._panels import Panels

# Clearance that a step leaves between journal and bush, over that before it.
_ROOM_LEFT = 0.2
# The same where surfaces touch, whose force grows within a third of the roughness: closer than so many
# times the roughness.
_ROOM_IN_CONTACT = 0.6
_TOUCHING = 3.0
# A step below this share of the clearance between journal and bush has come near to the orbit.
_NEAR = 0.3

# Eccentricity ratio beyond which a film counts as closed: no oil film of a machine is that thin.
CLOSED = 0.9999

# [-] Relative error, as estimated, of the smallest clearance between journal and bush beyond which an
# orbit is not resolved.
_COARSE = 0.3
# Panels of the revolution below which thin films are not resolved: on the pin of a compressor, with 8
# nodes, 18 leave 9 % of error in a film of 0.8 µm, 24 leave 1e-4 in one of 0.15 µm.
FEWEST_PANELS = 24

Positions = Float[Array, "2 k *n"]


class MovingJournal(NamedTuple):
    """A journal that moves: name of its law, joint in results, cylinder from 0, bearing."""

    law: str
    joint: str
    cylinder: int | None
    bearing: JournalBearing


def orbiting_journals(compressor: Compressor) -> tuple[MovingJournal, ...]:
    """All journals whose orbits are solved, in the order of their positions."""
    crankshaft = compressor.crankshaft
    journals = []
    laws = vars(compressor.friction) if compressor.friction is not None else {}
    bearings = moving_journals(compressor.friction, crankshaft.main_journal)
    for law, bearing in bearings.items():
        if law in laws:
            for number in range(1, crankshaft.count + 1):
                joint = crankshaft.joint(law, number)
                journals.append(MovingJournal(law, joint, number - 1, of_cylinder(bearing, number)))
        else:
            journals.append(MovingJournal(law, law, None, bearing))
    return tuple(journals)


def with_journals(
    compressor: Compressor, positions: Positions | None, lossless: bool = False
) -> Compressor:
    """The compressor with its moving journals at positions over their clearances.

    Args:
        compressor: the machine.
        positions: (2, k, *n) in the order of `orbiting_journals`; `None` where no journal moves.
        lossless: leave their losses out, for who adds them.
    """
    if positions is None:
        return compressor
    rows: dict[str, list[int]] = {}
    for number, journal in enumerate(orbiting_journals(compressor)):
        rows.setdefault(journal.law, []).append(number)
    several = {
        journal.law for journal in orbiting_journals(compressor) if journal.cylinder is not None
    }
    at = {}
    for law, numbers in rows.items():
        if law in several:
            at[law] = positions[:, jnp.asarray(numbers)]
        else:
            at[law] = positions[:, numbers[0]]
    crankshaft = compressor.crankshaft
    friction, support = with_journal_positions(
        compressor.friction, crankshaft.main_journal, at, lossless
    )
    return rebuilt(
        compressor, friction=friction, crankshaft=rebuilt(crankshaft, main_journal=support)
    )


def by_joint(
    compressor: Compressor, positions: Positions | None
) -> dict[str, Float[Array, "2 n"]] | None:
    """Positions of the moving journals by joint, all instants in one row; `None` where none moves."""
    if positions is None:
        return None
    row = positions.reshape(*positions.shape[:2], -1)
    return {journal.joint: row[:, i] for i, journal in enumerate(orbiting_journals(compressor))}


def position_error(rule: Rule, positions: Float[Array, "2 *k p s"]) -> Float[Array, "*k"]:
    """[-] Estimated error of positions where the film is thinnest.

    The last two Legendre terms on the panel of the largest eccentricity and on the one before it: thin
    films forget within an angle that is shorter than a panel.
    """
    fixed = lax.stop_gradient(positions)
    terms = jnp.hypot(*jnp.sum(jnp.abs(fixed @ rule.to_legendre[-2:].T), axis=-1))
    between = fixed @ rule.through(np.linspace(0.0, 1.0, 2 * rule.nodes.size + 1)).T
    thinnest = jnp.argmax(max_of(jnp.hypot(*between), axis=-1), axis=-1)[..., None]
    nearby_terms = maximum(terms, jnp.roll(terms, 1, axis=-1))
    return jnp.take_along_axis(nearby_terms, thinnest, axis=-1)[..., 0]


def rate_shares(compressor: Compressor, angle: Float[Array, "*n"]) -> dict[str, tuple[Any, Any]]:
    """Difference and sum of the rates of journal and bush over the speed of the crank, by joint.

    Joints that are not listed belong to the shaft: (1, 1).

    Args:
        compressor: the machine.
        angle: [rad] of the crank.
    """
    mechanism = compressor.mechanism
    crankshaft = compressor.crankshaft
    if not isinstance(mechanism, SliderCrank):
        return {}
    # In the crank's sense the rod turns at -phi' times the speed. It is the bush of both pins: the
    # piston pin does not turn, the crank pin turns with the crank.
    tilts = rod_motion(crankshaft.each(mechanism, angle), crankshaft.own_angle(angle)).tilt_1
    shares = {}
    for number, tilt in enumerate(tilts, 1):
        shares[crankshaft.joint("piston_pin", number)] = (tilt, -tilt)
        shares[crankshaft.joint("crank_pin", number)] = (1 + tilt, 1 - tilt)
    return shares


class Drive(NamedTuple):
    """Speeds and loads that move k journals."""

    films: tuple[AbstractSqueeze | MixedSqueeze, ...]  # of all journals
    force: Positions  # load over U and the speed of the crank, (2, k, *n)
    turning: Float[Array, "k *n"]  # half the sum of the rates over the speed, (k, *n)
    over: Float[Array, "1 k *n"] | None = None  # [rad/s] that speed, where surfaces may touch

    def mapped(self, function) -> "Drive":
        """This drive at other instants, by a function of arrays over instants."""
        drive = self._replace(force=function(self.force), turning=function(self.turning))
        if self.over is None:
            return drive
        return drive._replace(over=function(self.over))

    def _of_films(self, function, position: Positions, out_axis: int = 1):
        """Values of a function of film, position, force and speed for all journals."""
        if self.over is None:

            def without_speed(film, e, f):
                return function(film, e, f, None)

            return mapped(
                without_speed, self.films, position, self.force, axis=1, out_axis=out_axis
            )

        def at_speed(film, e, f, over):
            # the speed of the crank is the same for all journals: its axis of journals has one entry
            return function(film, e, f, over[0])

        return mapped(
            at_speed, self.films, position, self.force, self.over, axis=1, out_axis=out_axis
        )

    def rate(self, position: Positions) -> Positions:
        """[1/rad] de/dtheta."""

        def velocity(film, e, f, over):
            if isinstance(film, MixedSqueeze):
                return film.velocity(e, f, over)
            return film.mobility(e, f)

        return self._of_films(velocity, position) + self.turning * quarter_turn(position)

    def film_force(self, position: Positions) -> Positions:
        """Share of the force that the films carry; a contact carries the rest."""
        if self.over is None:
            return self.force

        def of_film(film, e, f, over):
            if isinstance(film, MixedSqueeze):
                return film.film_force(e, f, over)
            return f

        return self._of_films(of_film, position)

    def rate_and_slopes(
        self, position: Positions
    ) -> tuple[Positions, Positions, Float[Array, "2 2 k *n"]]:
        """[1/rad] de/dtheta, the part of it that is the film's, and its slopes along the position."""

        def film(film, e, f, over):
            if isinstance(film, MixedSqueeze):
                value, slopes = film.velocity_slopes(e, f, over)
            else:
                value, slopes = film.mobility_slopes(e, f)
            return jnp.stack([value, *slopes])

        # journals stand on the axis before the last ones, here behind the three and the components
        terms = self._of_films(film, position, 2)
        film_rate, along_x, along_y = terms
        turn = self.turning
        slopes = jnp.stack([
            jnp.stack([along_x[0], along_y[0] - turn]),
            jnp.stack([along_x[1] + turn, along_y[1]]),
        ])  # fmt: skip
        return film_rate + turn * quarter_turn(position), film_rate, slopes


def orbit_status(
    rule: Rule, drive: Drive, positions: Float[Array, "2 k p s"], status: Status
) -> Status:
    """A status with what is wrong with the orbits of journals: a film that closes, or coarse panels.

    A film closes that is closed for half of the revolution, or where the load of some instant would halve
    within a radian even the gap that is left at `CLOSED`. An orbit that comes closer without either has
    too few panels.
    """
    size = jnp.hypot(*positions)
    over = (-2, -1)
    line = drive.force / maximum(jnp.hypot(*drive.force), 1e-300)
    sinking = jnp.sum(line * drive.rate(CLOSED * line), axis=0) > 0.5 * (1 - CLOSED)
    closed = size > CLOSED
    closes = (jnp.any(closed, over) & jnp.any(sinking, over)) | (jnp.mean(closed, over) > 0.5)
    room = maximum(1 - max_of(max_of(size, -1), -1), 1 - CLOSED)
    coarse = (position_error(rule, positions) > _COARSE * room) | jnp.any(closed, over)
    status = Status.where(jnp.any(coarse), Status.unresolved, status)
    return Status.where(jnp.any(closes), Status.film_collapse, status)


def journal_drive(
    compressor: Compressor,
    forces: dict[str, Float[Array, "2 *n"]],
    state: CrankState,
    in_time: bool = False,
) -> Drive:
    """Drive of the journals at given joint forces [N] and a given state of the crank.

    Args:
        compressor: the machine.
        forces: by joint.
        state: of the crank.
        in_time: for rates in time [1/s] instead of those over the crank angle.
    """
    over = state.speed
    half = 0.5
    if in_time:
        over = jnp.ones_like(state.speed)
        half = 0.5 * state.speed / over
    journals = orbiting_journals(compressor)
    shares = rate_shares(compressor, state.angle)
    ones = jnp.ones_like(state.angle)
    force = [-forces[journal.joint] / (film_unit(journal.bearing) * over) for journal in journals]
    # joints of the shaft itself are not listed: their bushes do not turn
    sums = [shares.get(journal.joint, (ones, ones))[1] for journal in journals]
    turning = [half * rates for rates in sums]
    films = tuple(moving_film(journal.bearing) for journal in journals)
    drive = Drive(films, jnp.stack(force, axis=1), jnp.stack(turning))
    if not any(isinstance(film, MixedSqueeze) for film in films):
        return drive
    return drive._replace(over=jnp.broadcast_to(over, (1, *drive.turning.shape)))


def improved_positions(
    grid: Panels, drive: Drive, position: Float[Array, "2 k p s"]
) -> tuple[Float[Array, "2 k p s"], Float[Array, "k p s"]]:
    """One step of Newton's method for the periodic orbits of all journals.

    In this form, the velocity from the force, it converges from the centred journal under any load: in
    6 steps at a largest eccentricity ratio of 0.75, in 11 at 0.9986.

    Returns:
        Better positions, and the power of the squeeze over c U and the square of the crank's speed.
    """
    rate, film, slopes = drive.rate_and_slopes(position)
    # without derivatives of the slopes: at the solution their error does not count
    change = jax.vmap(_correction, in_axes=(None, 2, 1, 1), out_axes=1)(
        grid, lax.stop_gradient(slopes), rate, position
    )
    new = position + _step_share(drive, position, position + change) * change
    power = jnp.sum(drive.film_force(position) * film, axis=0)
    # far from the orbit the squeeze takes any power: it counts once the journals have come near
    moved, before = (jnp.hypot(*lax.stop_gradient(e)) for e in (new - position, position))
    near = max_of(moved / maximum(1 - before, 1e-12)) < _NEAR
    return new, jnp.where(near, power, 0.0)


def _correction(
    grid: Panels,
    slopes: Float[Array, "2 2 p s"],
    rate: Float[Array, "2 p s"],
    position: Float[Array, "2 p s"],
) -> Float[Array, "2 p s"]:
    """Step of Newton's method for positions, so that they are periodic with their rates.

    On each panel e + d = left + width (integral of rate + slopes d). Derivatives pass through the
    defect of the present positions alone; the matrices are constants to them.
    """
    rule = grid.rule
    fixed = lax.stop_gradient(grid.width)
    count = rule.nodes.size
    panels = fixed.size
    matrix = jnp.eye(2 * count) - jnp.einsum(
        "p,ij,abpj->paibj", fixed, rule.integral, slopes
    ).reshape(panels, 2 * count, 2 * count)
    from_left = jnp.broadcast_to(jnp.kron(jnp.eye(2), jnp.ones((count, 1))), (panels, 2 * count, 2))
    defect = grid.width[:, None] * (rate @ rule.integral.T) - position
    right = jnp.moveaxis(defect, 0, 1).reshape(panels, 2 * count, 1)
    inner = jnp.linalg.solve(matrix, jnp.concatenate([from_left, right], axis=-1))
    # The matrices of all panels are eliminated at once; what is left is a chain of two by two maps.
    # d at the nodes = inner[..., :2] left + inner[..., 2], as inner is (2, 3, p, s)
    inner = jnp.transpose(inner.reshape(panels, 2, count, 3), (1, 3, 0, 2))
    towards = slopes * (fixed[:, None] * rule.weights)
    end = jnp.sum(towards[:, :, None] * inner, axis=(1, -1))  # (2, 3, p)
    through = lax.stop_gradient(end[:, :2]) + jnp.eye(2)[..., None]
    shift = end[:, 2] + grid.width * (rate @ rule.weights)
    maps, shifts = _prefixes(through, shift)
    # periodic: a revolution maps d at its beginning on itself
    first = _two_by_two(jnp.eye(2) - maps[..., -1], shifts[:, -1])
    lefts = _apply(maps, first[:, None]) + shifts
    lefts = jnp.concatenate([first[:, None], lefts[:, :-1]], axis=1)
    homogeneous = lax.stop_gradient(inner[:, :2])
    return (
        homogeneous[:, 0] * lefts[0][:, None] + homogeneous[:, 1] * lefts[1][:, None] + inner[:, 2]
    )


def _prefixes(maps: Float[Array, "2 2 p"], shifts: Float[Array, "2 p"]):
    """The affine maps of two components over the first 1, 2 ... of p panels, by doubling."""
    # log2 p products of whole rows; a scan would be p steps one after the other
    count = shifts.shape[1]
    step = 1
    while step < count:
        none = jnp.zeros((2, step))
        before = jnp.concatenate([none, shifts[:, :-step]], axis=1)
        shifts = _apply(maps, before) + shifts
        unit = jnp.broadcast_to(jnp.eye(2)[..., None], (2, 2, step))
        before = jnp.concatenate([unit, maps[..., :-step]], axis=2)
        maps = maps[:, 0, None] * before[0] + maps[:, 1, None] * before[1]
        step *= 2
    return maps, shifts


def _apply(maps, vector):
    return maps[:, 0] * vector[0] + maps[:, 1] * vector[1]


def _two_by_two(matrix, right):
    size = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    # I - M of a revolution is singular where a journal forgets nothing of where it began
    size = jnp.where(jnp.abs(size) > 1e-12, size, 1e-12)
    first = matrix[1, 1] * right[0] - matrix[0, 1] * right[1]
    return jnp.stack([first, matrix[0, 0] * right[1] - matrix[1, 0] * right[0]]) / size


def _step_share(drive, position, new) -> Float[Array, "k 1 1"]:
    """The share of a step after which no journal has come too near to its bush."""
    before, after = (jnp.hypot(*lax.stop_gradient(e)) for e in (position, new))
    room = maximum(1 - before, 1e-12)
    room_left = _ROOM_LEFT * room
    if drive.over is not None:
        near = []
        for film in drive.films:
            touching = jnp.zeros(())
            if isinstance(film, MixedSqueeze):
                touching = _TOUCHING / film.contact.ratio
            near.append(touching)
        near = lax.stop_gradient(jnp.stack(near))[:, None, None]
        room_left = maximum(room_left, minimum(_ROOM_IN_CONTACT * room, near))
    share = (room - room_left) / maximum(after - before, 1e-300)
    share = jnp.where(after > before, share, 1.0)
    return minimum(min_of(min_of(share, axis=-1), axis=-1)[..., None, None], 1.0)


def journal_torque(
    compressor: Compressor, state: CrankState, position: Positions, power: Float[Array, "k *n"]
) -> Float[Array, "*n"]:
    """[N m] Loss torque of all moving journals.

    Args:
        compressor: the machine.
        state: of the crank at the instants.
        position: of the journals.
        power: of the squeeze, as `improved_positions` gives it.
    """
    shares = rate_shares(compressor, state.angle)
    total = jnp.zeros_like(state.speed)
    for number, journal in enumerate(orbiting_journals(compressor)):
        share, _ = shares.get(journal.joint, (1.0, 1.0))
        squeeze = journal.bearing.radial_clearance * film_unit(journal.bearing) * power[number]
        shear = shear_drag(journal.bearing, position[:, number]) * share**2
        # Dissipation over the crank's speed, whose square both parts of it contain.
        total += (shear + squeeze) * state.speed
        contact = ring_contact(journal.bearing)
        if contact is not None:
            total += contact.torque(position[:, number], share * state.speed) * share
    return total
