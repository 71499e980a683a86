"""The periodic orbit of one journal alone, under loads that do not depend on where it is."""

import math
from collections.abc import Callable, Iterator
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from .._core.declared import reading
from .._core.each import mapped
from .._core.exported import kept_jit
from .._core.extremes import clip
from .._core.fields import rebuilt
from .._core.results import Data, Result
from .._core.roots import AbstractFixedPoint, fixed_point, frozen, settle
from .._core.status import Status
from ..compressor import Compressor
from ..film import AbstractSolvedFilm, JournalBearing
from ..film._bearing import film_unit, moving_film
from ._films import JournalFilm, oil_films, read_film, thin_film
from ._journals import Drive, improved_positions, orbit_status, rate_shares
from ._orbit import Orbit
from ._panels import Panels, panels

_PANELS = 48  # of a revolution of a journal under a given load


class JournalOrbit(Result, eqx.Module):
    """A periodic orbit of one journal.

    Attributes:
        film: what is read off the orbit.
        status: `Status.film_collapse` where the film closes.
        angle: [rad] (n,) of the nodes.
        residual: [-] last change of the positions.
        iterations: steps of Newton's method.
    """

    film: JournalFilm
    status: Status
    angle: Float[Array, " n"] = reading("rad", "node")
    residual: Float[Array, ""] = reading("")
    iterations: Int[Array, ""] = reading("")

    table_dims: ClassVar[tuple[str, ...]] = ("node",)
    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units, with those of its film."""
        yield from super().described()
        yield from self.film.described()


def journal_orbit(
    bearing: JournalBearing,
    load: Callable[[Float[Array, " n"]], Float[Array, "2 n"]],
    speed: float | Float[Array, ""],
    *,
    journal: float | Callable = 1.0,
    bush: float | Callable = 0.0,
    edges: Float[Array, " e"] | None = None,
    nodes: int = 8,
    period: float = 2 * math.pi,
) -> JournalOrbit:
    """The periodic orbit of one journal under a given load history at constant speed.

    Derivatives follow from the implicit function theorem.

    Args:
        bearing: with its viscosity.
        load: [N] on the journal over the crank angle [rad], in axes that do not rotate.
        speed: [rad/s] of the crank, > 0.
        journal, bush: [-] rates of rotation over that speed, numbers or functions of the crank angle.
        edges: [rad] within the period from the first one, where the load has kinks: they cut the even
            panels that there are anyway, 48 of a revolution. Beside a contact there are 48 more, first
            even ones, then where the journal so moves fastest: surfaces let go within a few degrees.
        nodes: on every panel.
        period: [rad] after which load and rates come again.
    """
    edges = jnp.zeros(1) if edges is None else jnp.asarray(edges, float)
    count = math.ceil(_PANELS * max(period / (2 * math.pi), 1.0) - 1e-9)
    even = edges[0] + jnp.linspace(0, period, count + 1)
    speed = jnp.asarray(speed, float)
    edges = jnp.concatenate([even, clip(edges[1:], even[0], even[-1])])

    def solved(edges) -> JournalOrbit:
        grid = panels(jnp.sort(edges), nodes)
        angle = grid.angle.ravel()
        turns, holds = (
            jnp.broadcast_to(r(angle) if callable(r) else r, angle.shape) for r in (journal, bush)
        )
        rates = jnp.stack([(turns - holds) * speed, (turns + holds) * speed])
        return _solved_journal(bearing, load(angle), rates, speed, grid.edges, nodes)

    if bearing.contact is None:
        return solved(edges)
    # Only to place panels where the journal moves fast, which needs no derivative.
    first = lax.stop_gradient(solved(jnp.concatenate([edges, 0.5 * (even[1:] + even[:-1])])))
    return solved(jnp.concatenate([edges, _where_it_moves(first, count)]))


@kept_jit
def moved_films(compressor: Compressor, orbit: Orbit) -> dict[str, JournalFilm]:
    """Films that carry a steady load at every instant, as they would be if their journals moved, by
    joint.

    The orbits of these journals under the loads that the crank has without them: what they would lose
    less does not act back. Beside `journal_films` this is what `motion = "orbit"` would change.

    Args:
        compressor: the machine.
        orbit: its periodic state.
    """
    shares = rate_shares(compressor, orbit.state.angle)
    names = []
    rows = []
    for name, law in oil_films(compressor, orbit):
        if not law.moves and issubclass(law.model, AbstractSolvedFilm):
            # the others have no squeeze: the finite film stands for them
            film = "short" if law.film == "short" else "reynolds"
            bearing = rebuilt(law, film=film, motion="orbit", thin_film=thin_film(law))
            sums = [s * orbit.state.speed + 0 * orbit.weight for s in shares.get(name, (1.0, 1.0))]
            names.append(name)
            rows.append((bearing, -orbit.loads.forces[name], jnp.stack(sums)))
    if not rows:
        return {}

    over = orbit.state.speed, orbit.panel_edges, orbit.panel_nodes

    def solved(bearing, load, rates):
        return _solved_journal(bearing, load, rates, *over).film

    bearings, loads, rates = zip(*rows, strict=True)
    films = mapped(solved, bearings, jnp.stack(loads), jnp.stack(rates))
    return {name: jax.tree.map(lambda leaf, i=i: leaf[i], films) for i, name in enumerate(names)}


@kept_jit
def _solved_journal(
    bearing: JournalBearing, force, rates, speed, edges, nodes: int
) -> JournalOrbit:
    grid = panels(edges, nodes)
    film = moving_film(bearing)

    drive = Drive(
        films=(film,),
        force=grid.by_panels(force / (film_unit(bearing) * speed))[:, None],
        turning=grid.by_panels(0.5 * rates[1] / speed)[None],
    )
    steps = 60
    if bearing.contact is not None:
        drive = drive._replace(over=speed * jnp.ones((1, 1, *grid.angle.shape)))
        # surfaces that carry most of a load are met in many short steps
        steps = 400
    position, (_, report) = fixed_point(_Periodic(grid, max_iterations=steps), drive)
    position = position[:, 0].reshape(2, -1)

    read = read_film(
        bearing, position, force, rates, grid.weight.ravel() / speed, grid.rule, grid.width
    )
    status = Status.where(report.settled, Status.converged, Status.not_converged)
    status = orbit_status(grid.rule, drive, grid.by_panels(position)[:, None], status)
    return JournalOrbit(read, status, grid.angle.ravel(), report.change, report.steps)


class _Periodic(AbstractFixedPoint):
    """The periodic orbit of a journal on fixed panels; the parameters are its `Drive`."""

    grid: Panels
    tolerance: float | Float[Array, ""] = 1e-13
    max_iterations: int = eqx.field(static=True, default=60)

    def step(self, parameters, data, unknowns):
        return improved_positions(data[0], parameters, unknowns)[0]

    def solve(self, parameters):
        data = self.grid, None

        def step(position, _):
            return self.step(frozen(parameters), data, position), None

        start = jnp.zeros_like(parameters.force)
        position, _, report = settle(step, start, None, self.tolerance, self.max_iterations)
        return position, (self.grid, report)


def _where_it_moves(orbit: JournalOrbit, count: int) -> Float[Array, " count"]:
    """[rad] Places between which a journal moves equally far."""
    position = orbit.film.position
    steps = jnp.hypot(*jnp.diff(position, axis=1, prepend=position[:, :1]))
    distance = jnp.cumsum(steps)
    share = (jnp.arange(count) + 0.5) / count
    return jnp.interp(share * distance[-1], distance, orbit.angle)
