r"""A journal under loads from a table over the crank angle: the table as a function, and the orbit.

Between its points a table is the periodic cubic spline through them, or straight lines. Its axes stand
still, or turn with the journal or the bush: $F = R(\beta) W$ with
$\beta = \int_0^\theta \omega_i/\omega\,d\theta$, so that they are the fixed ones at the crank angle zero.
"""

import dataclasses as dc
import math
from collections.abc import Iterator
from functools import partial
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from .._core.arguments import single_number
from .._core.declared import computed, computed_part, computed_word, forwarded, held, reading
from .._core.errors import BadInput
from .._core.fields import rebuilt
from .._core.polynomials import cubics, gauss
from .._core.results import Data, Result
from .._core.status import SolveFailed, Status
from .._core.words import one_of
from ..film import JournalBearing
from ..film._bearing import BearingSizes, sizes_of, squeeze_of
from ._films import JournalFilm, roughness_of
from ._journal_orbit import journal_orbit

TURN = 2 * math.pi
# [rad] Widest step of a table.
WIDEST = math.radians(45)
# A table is even of which so many steps are the same; there a step that is longer lacks a point.
_EVEN = 0.8
_LONGER = 1.5
# [-] Of the largest load: what the last line may differ from the first one a period before.
_CLOSES = 0.01
# [-] Of the smallest film: estimated error beyond which the panels are halved, and how often they may be.
_FINE = 1e-3
_HALVINGS = 3
# of a revolution, as `journal_orbit` has them; on every panel
_EVEN_PANELS = 48
_NODES = 8

Frame = Literal["fixed", "journal", "bush"]
Between = Literal["spline", "lines"]


class LoadTable(eqx.Module):
    """The load on a journal at n crank angles of a period, and how it goes on between them.

    Derivatives pass to the crank angles, and none to the numbers of the table.

    Args:
        angle: [rad] (n,) of the crank, rising. The last may be a period after the first.
        load: [N] (2, n) on the journal.
        period: [rad] of the table; absent, the least number of whole revolutions that hold it.
        journal_speed, bush_speed: [rad/s] (n,) rates of rotation of journal and bush, where they are not
            constant, such as that of a connecting rod.
        frame: what the axes of the load turn with: "fixed", "journal" or "bush". They are the fixed ones
            at the crank angle zero.
        between: "spline", the periodic cubic one, or "lines".

    Raises:
        BadInput: angles that do not rise or leave a gap, a load that is not periodic or not finite, lists
            of different lengths, or an unknown word. It names the entry, from 0.
    """

    angle: Float[Array, " n"]
    load: Float[Array, "2 n"]
    journal_speed: Float[Array, " n"] | None
    bush_speed: Float[Array, " n"] | None
    period: float = eqx.field(static=True)
    frame: Frame = eqx.field(static=True)
    between: Between = eqx.field(static=True)

    def __init__(
        self,
        angle,
        load,
        period: float | None = None,
        *,
        journal_speed=None,
        bush_speed=None,
        frame: Frame = "fixed",
        between: Between = "spline",
    ):
        x = np.asarray(angle, float)
        speeds = {"journal_speed": journal_speed, "bush_speed": bush_speed}
        speeds = {name: np.asarray(s, float) for name, s in speeds.items() if s is not None}
        components = list(np.asarray(load, float))
        if x.ndim != 1 or len(components) != 2:
            raise BadInput("load", f"of shape {np.shape(load)}", "(2, n), for n angles")
        rows = [*components, *speeds.values()]
        names = ["W_x", "W_y", *speeds]
        for word, field, allowed in ((frame, "frame", _FRAMES), (between, "between", _BETWEEN)):
            if word not in allowed:
                raise BadInput(field, word, one_of(word, allowed))
        for name, row in zip(["angle", *names], [x, *rows], strict=True):
            if row.shape != x.shape:
                raise BadInput(name, f"{row.size} numbers", f"{x.size}, one for each angle")
            if not np.all(np.isfinite(row)):
                place = int(np.argmin(np.isfinite(row)))
                raise BadInput(f"{name}[{place}]", row[place], "finite")
        self.period, closed = _period(x, np.stack(rows[:2]), period)
        count = x.size - closed
        self.angle = jnp.asarray(x[:count])
        self.load = jnp.asarray(np.stack(rows[:2])[:, :count])
        # a last point that closes the period repeats the first one
        speeds = {name: jnp.asarray(row[:count]) for name, row in speeds.items()}
        self.journal_speed = speeds.get("journal_speed")
        self.bush_speed = speeds.get("bush_speed")
        self.frame = frame
        self.between = between

    @property
    def edges(self) -> Float[Array, " n_plus_1"]:
        """[rad] The angles of the table and the end of its period, for `journal_orbit`."""
        return jnp.append(self.angle, self.angle[0] + self.period)

    def over(self, values: Float[Array, " n"], angle: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Function with these values at the points of the table, at other crank angles [rad]."""
        knots = self.edges
        closed = jnp.append(values, values[0])
        if self.between == "lines":
            return jnp.interp(self._within(angle), knots, closed)
        spline = CubicSpline(np.asarray(knots), np.asarray(closed), bc_type="periodic")
        slopes = jnp.asarray(spline(np.asarray(knots), 1))
        return cubics(self._within(angle), knots, closed, slopes)

    def shares(self, speed, journal=1.0, bush=0.0) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """[-] Rates of journal and bush over the speed of the crank [rad/s] at the points of the table.

        Args:
            speed: [rad/s] of the crank.
            journal, bush: [-] of those that the table does not have.
        """

        def share(of_table, constant):
            if of_table is None:
                return 0 * self.angle + constant
            return of_table / speed

        return share(self.journal_speed, journal), share(self.bush_speed, bush)

    def turned(
        self, vectors: Float[Array, "2 m"], angle: Float[Array, " m"], shares, back: bool = False
    ) -> Float[Array, "2 m"]:
        """Vectors in the table's axes as they are in fixed ones, or `back`.

        Args:
            vectors: at the angles.
            angle: [rad] of the crank.
            shares: as of the method of that name.
            back: from fixed axes to those of the table.

        Raises:
            BadInput: axes that do not turn by whole revolutions in the period.
        """
        if self.frame == "fixed":
            return vectors
        share = np.broadcast_to(shares[self.frame == "bush"], self.angle.shape)
        knots = np.asarray(self.edges)
        closed = np.append(share, share[0])
        steps = CubicSpline(knots, closed, bc_type="periodic").antiderivative()
        turns = steps(knots) / TURN
        excess = turns[-1] - round(turns[-1])
        # a table of rounded speeds misses whole revolutions by some digits of its last place
        if abs(excess) > 2e-3:
            bound = "such that the axes of the load turn by whole revolutions in the period"
            raise BadInput("frame", f'"{self.frame}", which makes {turns[-1]:.4g}', bound)
        # What exceeds whole revolutions is spread evenly, so that after a period the axes coincide.
        drift = excess / self.period
        at = jnp.asarray(TURN * (turns - drift * (knots - knots[0])))
        slopes = jnp.asarray(closed - TURN * drift)
        at_zero = cubics(self._within(jnp.zeros(())), jnp.asarray(knots), at, slopes)
        at_angle = cubics(self._within(angle), jnp.asarray(knots), at, slopes)
        beta = at_angle - at_zero
        if back:
            beta = -beta
        cos = jnp.cos(beta)
        sin = jnp.sin(beta)
        return jnp.stack([cos * vectors[0] - sin * vectors[1], sin * vectors[0] + cos * vectors[1]])

    def load_at(self, angle: Float[Array, " m"], shares=(1.0, 0.0)) -> Float[Array, "2 m"]:
        """[N] Load on the journal at crank angles [rad], in axes that do not rotate.

        Args:
            angle: of the crank.
            shares: [-] rates of journal and bush over the speed of the crank; absent, those of a turning
                journal in a standing bush.
        """
        in_frame = jnp.stack([self.over(row, angle) for row in self.load])
        return self.turned(in_frame, angle, shares)

    def _within(self, angle):
        return self.angle[0] + jnp.mod(angle - self.angle[0], self.period)


_FRAMES = ("fixed", "journal", "bush")
_BETWEEN = ("spline", "lines")


def _degrees(angle) -> str:
    return f"{math.degrees(angle):.6g}°"


def _period(x: np.ndarray, load: np.ndarray, stated: float | None) -> tuple[float, bool]:
    """[rad] The period, and whether the last point is the first one again."""
    if x.size < 3:
        raise BadInput("angle", f"{x.size} points", "at least one for each 45° of the period")
    steps = np.diff(x)
    if np.any(steps <= 0):
        place = int(np.argmax(steps <= 0)) + 1
        bound = f"greater than {_degrees(x[place - 1])}, the angle before"
        raise BadInput(f"angle[{place}]", _degrees(x[place]), bound)
    span = x[-1] - x[0]
    # a table in degrees to some digits may overrun the revolution by its rounding
    revolutions = math.ceil(span / TURN - 1e-9)
    period = TURN * revolutions if stated is None else float(stated)
    last_index = x.size - 1
    if not period > 0 or span > period * (1 + 1e-9):
        raise BadInput("period", _degrees(period), f">= {_degrees(span)}, what the angles span")
    closed = bool(span > period * (1 - 1e-9))
    size = np.hypot(*load)
    largest = size.max()
    jump = np.hypot(*(load[:, -1] - load[:, 0]))
    periodic = f"periodic: {_degrees(x[-1])} must have the load of {_degrees(x[0])}"
    if closed and jump > _CLOSES * largest:
        raise BadInput(f"W_x[{last_index}]", f"{jump:.4g} N away from it", periodic)
    changes = np.hypot(*np.diff(load))
    if not closed and jump > max(3 * changes.max(), 0.2 * largest):
        bound = f"periodic: from it to {_degrees(x[0])} the load changes most of all steps"
        raise BadInput(f"W_x[{last_index}]", f"{jump:.4g} N away from there", bound)
    if not closed:
        steps = np.append(steps, period - span)
    _check_steps(x, steps, period, stated)
    return period, closed


def _check_steps(x: np.ndarray, steps: np.ndarray, period: float, stated: float | None) -> None:
    """Refuse a table with a gap between its points.

    Args:
        x: [rad] angles of the points.
        steps: [rad] from each point to the next one, where the table is open also from the last one
            to the end of the period.
        period: [rad]
        stated: [rad] the period, where the table states it.
    """
    usual = np.median(steps)
    even = np.mean(np.abs(steps - usual) < 1e-3 * usual) > _EVEN
    longest = _LONGER * usual if even else math.inf
    widest = min(WIDEST * (1 + 1e-9), longest)
    if np.any(steps > widest):
        last_index = x.size - 1
        place = int(np.argmax(steps > widest))
        following = x[0] + period
        if place < last_index:
            following = x[place + 1]
        allowed = f"at most {_degrees(WIDEST)}"
        if even:
            allowed = f"the others are {_degrees(usual)} wide"
        bound = f"without a gap: no point follows up to {_degrees(following)} ({allowed})"
        if place == last_index and stated is None:
            bound += (
                f", the end of a period of {_degrees(period)}; give the period if it is another"
            )
        raise BadInput(f"angle[{place}]", _degrees(x[place]), bound)


class LoadedJournal(Result, eqx.Module):
    """The periodic orbit of a journal under the loads of a table.

    Attributes:
        bearing: with its viscosity.
        table: of the loads.
        speed: [rad/s] of the crank.
        angle: [rad] (n,) of the nodes, over a period.
        load: [N] (2, n) on the journal, in the axes of the table.
        position: [-] (2, n) centre of the journal over the clearance, in the axes of the table.
        film: the film at the nodes and over the period, in fixed axes.
        minimum_film_angle: [rad] crank angle of the smallest film, to 0.02 degrees.
        table_error: [m] by how much the smallest film differs with straight lines, or with a spline where
            lines were taken, between the points: what the table leaves open.
        status: how the solution ended.
    """

    bearing: JournalBearing
    table: LoadTable
    speed: Float[Array, ""] = reading("rad/s", doc="of the crank")
    angle: Float[Array, " n"] = reading("rad", "angle", doc="of the crank", table_only=True)
    load: Float[Array, "2 n"] = held()
    position: Float[Array, "2 n"] = held()
    film: JournalFilm = held()
    minimum_film_angle: Float[Array, ""] = reading("rad")
    table_error: Float[Array, ""] = reading("m", doc="of the interpolation, estimated")
    status: Status = held()

    table_dims: ClassVar[tuple[str, ...]] = ("angle",)

    minimum_film = forwarded(JournalFilm, "film.minimum_film")
    film_error = forwarded(JournalFilm, "film.film_error", doc="of the solution, estimated")
    peak_pressure = forwarded(JournalFilm, "film.largest_pressure")
    mean_shear_loss = forwarded(JournalFilm, "film.mean_shear_loss")
    mean_squeeze_loss = forwarded(JournalFilm, "film.mean_squeeze_loss")
    mean_contact_loss = forwarded(JournalFilm, "film.mean_contact_loss", doc="by surfaces that rub")
    mean_side_flow = forwarded(JournalFilm, "film.mean_flow")
    temperature_rise_of_oil = forwarded(JournalFilm, "film.temperature_rise")
    thin_share = forwarded(JournalFilm, "film.thin_share", doc="of the time below `thin_film`")
    steady_film = forwarded(JournalFilm, "film.steady_film", doc="smallest of the loads at rest")

    @computed_word()
    def limits(self) -> str:
        """Limits of the film model."""
        return squeeze_of(self.bearing).limits

    @computed_word()
    def frame(self) -> str:
        """Axes of the table."""
        return self.table.frame

    @computed_word()
    def between(self) -> str:
        """Interpolation between the points of the table."""
        return self.table.between

    @computed_part(BearingSizes, inline=True)
    def sizes(self) -> BearingSizes:
        """Dimensions, viscosity, film and contact of the bearing."""
        return sizes_of(self.bearing)

    @computed("rad")
    def table_period(self) -> np.ndarray:
        """[rad] Period of the table."""
        return np.asarray(self.table.period)

    @computed("W")
    def mean_loss(self) -> Float[Array, ""]:
        """[W] Mean loss of the film and of surfaces that rub."""
        film = self.film
        return film.mean_shear_loss + film.mean_squeeze_loss + film.mean_contact_loss

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        film = self.film
        at = self.table_dims
        yield from self.data_of("speed", "table_period", "minimum_film", "minimum_film_angle")
        yield from self.data_of("film_error", "table_error", "peak_pressure", "mean_loss")
        yield from self.data_of("mean_shear_loss", "mean_squeeze_loss", "mean_contact_loss")
        yield from self.data_of("mean_side_flow", "temperature_rise_of_oil")
        yield from self.data_of("thin_share", "steady_film", "angle")
        for n, axis in enumerate("xy"):
            yield Data(f"W_{axis}", "N", self.load[n], at, "load, in the axes of the table")
            yield Data(
                f"e_{axis}", "", self.position[n], at, "position over the clearance, likewise"
            )
        yield from film.data_of(
            film_thickness="thickness", film_pressure="pressure", side_flow="flow", dims=at
        )
        yield from film.data_of("shear_loss", "squeeze_loss", dims=at)
        if self.bearing.contact is not None:
            yield from film.data_of("contact_load", "contact_loss", dims=at)


def loaded_journal(
    bearing: JournalBearing,
    table: LoadTable,
    speed: float | Float[Array, ""],
    *,
    journal: float = 1.0,
    bush: float = 0.0,
    throw: bool = True,
) -> LoadedJournal:
    """Solve the periodic orbit of a journal under the loads of a table at constant speed.

    Panels end at the points of the table, and are halved until the estimated error of the smallest film
    is below 1e-3 of it, three times at most.

    Args:
        bearing: with its viscosity, and a film with squeeze ("reynolds" or "short").
        table: of the loads.
        speed: [rad/s] of the crank, > 0.
        journal, bush: [-] rates of rotation of journal and bush over that speed, where the table has none
            of its own. A bush that turns in a standing pin: `journal=0.0, bush=1.0`.
        throw: raise if the orbit does not converge, instead of returning its status.

    Raises:
        BadInput: a film without squeeze, L/D outside of its range, a speed that is not positive, or axes
            of the table that do not turn by whole revolutions in its period.
        SolveFailed: no convergence, a film that closes, or one thinner than the roughness.
    """
    bearing = dc.replace(bearing, motion="orbit")
    speed = single_number("speed", speed)
    if not speed > 0:
        raise BadInput("speed", float(speed), "> 0 rad/s")
    shares = table.shares(speed, journal, bush)

    def solved(table: LoadTable, even: int):
        further = jnp.linspace(table.edges[0], table.edges[-1], even + 1)[1:-1]
        return journal_orbit(
            bearing,
            lambda angle: table.load_at(angle, shares),
            speed,
            journal=partial(table.over, shares[0]),
            bush=partial(table.over, shares[1]),
            edges=jnp.append(table.edges, further),
            nodes=_NODES,
            period=table.period,
        )

    even = 1
    orbit = solved(table, even)
    for halving in range(1, _HALVINGS + 1):
        film = orbit.film
        good = orbit.status == Status.converged and film.film_error < _FINE * film.minimum_film
        if good or orbit.status == Status.film_collapse:
            break
        even = math.ceil(_EVEN_PANELS * 2**halving * table.period / TURN)
        orbit = solved(table, even)
    film = orbit.film
    other: Between = "lines" if table.between == "spline" else "spline"
    other_orbit = solved(rebuilt(table, between=other), even)
    least = roughness_of(bearing)
    below = film.minimum_film < (0.0 if least is None else least)
    thin = (orbit.status == Status.converged) & below
    status = Status.where(thin, Status.thin_film, orbit.status)
    if throw and status != Status.converged:
        raise SolveFailed(status, f"smallest film {1e6 * float(film.minimum_film):.3g} µm")
    return LoadedJournal(
        bearing=bearing,
        table=table,
        speed=speed,
        angle=orbit.angle,
        load=table.turned(film.load, orbit.angle, shares, back=True),
        position=table.turned(film.position, orbit.angle, shares, back=True),
        film=film,
        minimum_film_angle=_thinnest(orbit.angle, film.position),
        table_error=jnp.abs(film.minimum_film - other_orbit.film.minimum_film),
        status=status,
    )


def _thinnest(angle, position):
    """[rad] Where the panel polynomials come nearest to the bush, of 400 places on each panel."""
    rule = gauss(_NODES)
    x = np.linspace(0, 1, 401)
    size = np.hypot(*(np.asarray(position).reshape(2, -1, _NODES) @ rule.through(x).T))
    panel, place = np.unravel_index(np.argmax(size), size.shape)
    nodes = np.asarray(angle).reshape(-1, _NODES)[panel]
    share = (x[place] - rule.nodes[0]) / (rule.nodes[-1] - rule.nodes[0])
    return jnp.asarray(nodes[0] + share * (nodes[-1] - nodes[0]))
