r"""The crank and the rotor of one machine at a given speed: loads of the films, and both together.

The forces are those of `crank_forces`. Eq. (6) of Levecque et al. (2011), cited in full in
`machines/hermetic-68cc.toml`, takes the mean force of the rod as the static load of the pin; the
bearings carry it by the statics of the shaft. Films with `linearised="orbit"` take their means along
the orbits of their journals instead.
"""

from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.extremes import maximum
from .._core.fields import is_any_traced, rebuilt, replaced
from .._core.words import one_of
from ..compressor import Compressor, at_speed
from ..crank import Collocation, Orbit, journal_films, solve_orbit
from ..crankshaft._bearings import shares
from ..film import DynamicCoefficients, NamedBearing
from ..film._running import stiffness_damping
from ..machine import Assembly, Machine
from ..mechanism import SliderLink, Vector
from ..motor import ConstantSpeed
from ..rotor import ConstantLaw, LoadedFilm, PeriodicForce, RotorModel, SpeedTable, Unbalances
from ..rotor._crankshaft_of_rotor import main_films
from ..rotor._speed_lists import filled_length
from ._crank_forces import crank_forces
from ._pipe_forces import pipe_loads

if TYPE_CHECKING:
    from ..crank import Shooting

# [rad/s] Below this speed the static loads of the films are those of this speed.
_SLOWEST = 1.0
# Speeds of a table of static loads, between which these are interpolated.
_LOADED = 16
# Mean forces and low harmonics need no panel edges at the load reversals. Without them the vibration
# of hermetic-68cc changes by 1e-7, its derivatives by 2e-6 to 7e-5 (to the coefficient of the wall, on
# which it hardly depends, by 2e-4), at a fifth of the cost.
_OF_FORCES = Collocation(reversals=0, tolerance=1e-11)


def open_films(rotor: RotorModel | None) -> tuple[int, ...]:
    """Numbers of the links whose film takes its static load from the crank's periodic state."""
    if rotor is None:
        return ()
    numbers = []
    for number, link in enumerate(rotor.links):
        # 0 for the laws that take no load at all
        if getattr(link.law, "load", 0) is None:
            numbers.append(number)
    return tuple(numbers)


def film_coefficients(
    rotor: RotorModel, compressor: Compressor, state: Orbit
) -> dict[int, DynamicCoefficients]:
    """Means of the films' stiffness and damping along their journals' orbits, by number of the link.

    Of the films with `linearised="orbit"`. Along x and y, over the time of a revolution.

    Args:
        rotor: the model, with its bearings.
        compressor: whose periodic state it is.
        state: periodic state of the crank.

    Raises:
        BadInput: a film whose bearing carries no load of the crank.
    """
    names = {}
    for number in open_films(rotor):
        film = _film(rotor, number)
        if film.linearised == "orbit":
            names[number] = film.name
    coefficients: dict[int, DynamicCoefficients] = {}
    if not names:
        return coefficients
    films = journal_films(compressor, state)
    for number, name in names.items():
        if name is None or name not in films:
            where = f"rotor.links.{number}.law.linearised"
            bound = '"mean_load": its bearing is none of `crankshaft.main_journal.bearings`'
            raise BadInput(where, "orbit", bound)
        coefficients[number] = DynamicCoefficients(films[name].stiffness, films[name].damping)
    return coefficients


def with_film_linearisation(machine: Machine, place: Literal["mean_load", "orbit"]) -> Machine:
    """The machine with the films of its rotor linearised at the mean load or along the orbit.

    Of the films of named bearings that take their load from the crank. The difference in vibration
    tells how much the choice matters: `respond(with_film_linearisation(machine, "orbit"))` beside
    `respond(machine)`.

    Args:
        machine: with a rotor, its bearings by name.
        place: "mean_load", or "orbit" for means over a revolution.
    """
    rotor: Any = machine.parts["rotor"]
    links = list(rotor.links)
    for number in open_films(rotor):
        law = _film(rotor, number)
        if isinstance(law.bearing, NamedBearing):
            # built anew, because the constructor sets the name by which an orbit is found
            law = LoadedFilm(law.bearing, linearised=place, name=law.name)
            links[number] = replaced(links[number], law=law)
    parts = machine.parts | {"rotor": eqx.tree_at(lambda r: r.links, rotor, tuple(links))}
    return eqx.tree_at(lambda m: m.parts, machine, parts)


def film_loads(
    rotor: RotorModel, compressor: Compressor, pins, state: Orbit
) -> dict[int, Float[Array, "2"]]:
    """[N] Static load on the journal of every film of the shaft, by number of the link.

    The mean force of the rods on their pins over time, shared by `MainBearings`: rotating forces have
    no mean. Each film counts as a bearing of the shaft, in proportion to its projected area where there
    are more than two.

    Args:
        rotor: the model, with its bearings.
        compressor: whose periodic state it is.
        pins: nodes in the planes of the rods.
        state: periodic state of the crank.
    """
    films = main_films(rotor, pins[0])
    # The nodes stand in angle; a mean over time weighs them by dt = d(angle)/speed.
    share = state.weight / state.state.speed
    crankshaft = compressor.crankshaft
    share = share / jnp.sum(share)
    pins = [crankshaft.joint("crank_pin", k + 1) for k in range(crankshaft.count)]
    # The joint's force acts on the rod; its opposite presses the pin.
    pin_forces = jnp.stack([-(state.loads.forces[pin] @ share) for pin in pins], axis=1)
    # from the axes of each cylinder into those of the machine, where they add up
    pin_forces = crankshaft.turned(Vector(*pin_forces)).stacked()
    mean = jnp.sum(pin_forces, axis=1)
    # sum of F z about the plane z = 0, with the components x and y of F
    moment = pin_forces @ crankshaft.position
    bearings = []
    positions = []
    for number, z in films:
        bearings.append(_film(rotor, number).bearing)
        positions.append(z)
    position = jnp.stack(positions)
    loads = {}
    for (number, _), (share, lever) in zip(films, shares(tuple(bearings), position), strict=True):
        loads[number] = share * mean + lever * moment
    return loads


def _film(rotor: RotorModel, number: int) -> LoadedFilm:
    law = rotor.links[number].law
    assert isinstance(law, LoadedFilm)
    return law


# What the crank's forces may do without.
LEAVABLE = ("gas", "inertia", "friction", "fluctuation")


def without(compressor: Compressor, left_out: tuple[str, ...]) -> Compressor:
    """The compressor without some of what makes its forces, to see what each of them is worth.

    Args:
        compressor: with a slider-crank or slider-link.
        left_out: "gas"; "inertia" (of piston with rod, or with link and slider); "friction";
            "fluctuation" (of the speed, by a flywheel a million times as heavy).

    Raises:
        BadInput: another word.
    """
    for word in left_out:
        if word not in LEAVABLE:
            raise BadInput("without", word, one_of(word, LEAVABLE))
    mechanism = compressor.mechanism
    crankshaft = compressor.crankshaft
    if "inertia" in left_out:
        # Their bounds leave out zero; a millionth is as good.
        names = ("piston_mass", "conrod_mass", "conrod_inertia")
        if isinstance(mechanism, SliderLink):
            names = ("piston_mass", "slider_mass")
        masses = {name: 1e-6 * getattr(mechanism, name) for name in names}
        mechanism = replaced(mechanism, **masses)
    if "fluctuation" in left_out:
        assert crankshaft.inertia is not None
        # heavy instead of held at its speed: the balance of torques stays among the equations
        crankshaft = replaced(crankshaft, inertia=1e6 * crankshaft.inertia)
    # both are parts that a machine may lack; `rebuilt` takes a `None` in the place of a part
    changes: dict[str, Any] = dict.fromkeys({"gas", "friction"} & {*left_out})
    if "friction" in left_out:
        crankshaft = rebuilt(crankshaft, main_journal=None)
    return rebuilt(compressor, mechanism=mechanism, crankshaft=crankshaft, **changes)


class CrankLoads(NamedTuple):
    """Loads of the crank on its rotor at one speed; with a leading axis for several.

    Attributes:
        films: by number of the link, of the films that leave it open: [N] (2,) static load on the
            journal, or stiffness and damping, of those that are linearised along the orbit.
        forces: periodic forces of the crank; none where those of the scene are taken.
        ok: whether the periodic state converged, where one was needed.
    """

    films: dict[int, Float[Array, "2"] | DynamicCoefficients]
    forces: tuple[PeriodicForce, ...]
    ok: Bool[Array, ""]


def crank_loads(
    machine: Assembly,
    speed: Float[Array, ""],
    orders: tuple[int, ...] = (1,),
    solver: "Collocation | Shooting | None" = None,
    *,
    crank: bool = True,
    left_out: tuple[str, ...] = (),
) -> CrankLoads:
    """Loads of the crank on its rotor at one speed; it is solved once, and only where it is needed.

    Args:
        machine: put together, with rotor and loads.
        speed: [rad/s] mean speed; the motor gives way to it.
        orders: harmonics of the crank's forces.
        solver: of the periodic state. Absent: collocation without panel edges at load reversals, which
            gives the forces to 1e-7.
        crank: take the forces of the crank in the place of those that the scene gives.
        left_out: what the crank's forces do without, see `without`; the films keep the mean force of
            the whole machine.

    Raises:
        BadInput: no crank where one is needed.
    """
    rotor = machine.rotor
    case = machine.loads
    assert rotor is not None
    assert case is not None
    opened = open_films(rotor)
    if not (opened or crank):
        return CrankLoads({}, (), jnp.asarray(True))
    if machine.compressor is None or case.crank is None:
        need = "the excitation by the crank" if crank else "films without a given load"
        raise BadInput("loads.crank", "absent", f"given beside a compressor, for {need}")
    if solver is None:
        solver = _OF_FORCES
    compressor = at_speed(machine.compressor, speed)
    # nothing is raised, because this is mapped over speeds: one without a periodic state must not end
    # the others
    orbit = solve_orbit(compressor, solver, throw=False)
    ok = orbit.converged
    films = {}
    if opened:
        loads = film_loads(rotor, compressor, case.crank.pins, orbit)
        films = {number: loads[number] for number in opened}
        films |= film_coefficients(rotor, compressor, orbit)
    if not crank:
        return CrankLoads(films, (), ok)
    if left_out:
        # After the films, which stand under the loads of the whole machine.
        compressor = without(compressor, left_out)
        orbit = solve_orbit(compressor, solver, throw=False)
        ok &= orbit.converged
    orders = tuple(dict.fromkeys((0, *orders)))
    forces = crank_forces(compressor, orbit, case.crank, orders)
    of_pipes = pipe_loads(compressor, orbit, case.pipes, orders)
    return CrankLoads(films, (*forces.forces, *of_pipes), ok)


def running_rotor(
    machine: Assembly, crank: CrankLoads
) -> tuple[RotorModel, tuple[Unbalances | PeriodicForce, ...]]:
    """The rotor with every film under its static load, and all that shakes it, at one speed.

    Args:
        machine: put together, with rotor and loads.
        crank: of `crank_loads` at this speed.
    """
    assert machine.rotor is not None
    loads = machine.given_loads
    if crank.forces:
        # in the place of the scene's periodic forces; unbalances are the rotor's own
        loads = (*machine.unbalances, *crank.forces)
    return _loaded(machine.rotor, crank.films), loads


def loaded_rotor(
    machine: Assembly, speeds: Float[Array, " m"], solver: "Collocation | Shooting | None" = None
) -> RotorModel:
    """The rotor with a table of static loads over the speed in every film that leaves them open.

    A film that is linearised along its journal's orbit becomes a table of its mean stiffness and
    damping.

    Args:
        machine: put together.
        speeds: [rad/s] (m,) at which the rotor will be asked; the crank is solved at them, or at 16
            between the first and the last where they are more. Where it has no periodic state, such
            as below the speed that its flywheel needs, the forces at constant speed count.
        solver: of the periodic states; absent: as in `crank_loads`.

    Raises:
        BadInput: no crank beside a film that needs it.
    """
    rotor = machine.rotor
    case = machine.loads
    assert rotor is not None
    opened = open_films(rotor)
    if not opened:
        return rotor
    if machine.compressor is None or case is None or case.crank is None:
        bound = (
            'given, such as load = ["80 N", "0 N"] along x and y; only a machine with a compressor and '
            "`loads.crank` has it from the crank"
        )
        raise BadInput(f"rotor.links.{opened[0]}.law.load", None, bound)
    # At rest there is no revolution over which a force has a mean.
    # Sorted, because the films interpolate over them.
    speeds = maximum(jnp.sort(jnp.ravel(jnp.asarray(speeds, float))), _SLOWEST)
    if speeds.size > _LOADED:
        speeds = jnp.linspace(speeds[0], speeds[-1], _LOADED)
    solved = speeds
    if speeds.size > 1 and not is_any_traced(rotor, machine.compressor, speeds):
        speeds, solved = _filled_in_front(np.asarray(speeds))
    tables = _load_tables(machine.compressor, rotor, case.crank.pins, solved, solver)
    return _loaded(rotor, {number: tables[number] for number in opened}, speeds)


def _filled_in_front(speeds: np.ndarray) -> tuple[Array, Array]:
    """[rad/s] Speeds of a table of one of few lengths, and those at which its entries are taken."""
    # The rotor's programs know the length of its tables as well. Slower speeds with the values of the
    # first one change nothing, since the ends of a table hold beyond it; behind the last one they would
    # make its slope zero.
    missing = filled_length(len(speeds), _LOADED) - len(speeds)
    slower = np.linspace(0.0, speeds[0], missing, endpoint=False)
    solved = np.pad(speeds, (missing, 0), mode="edge")
    return jnp.asarray(np.concatenate([slower, speeds])), jnp.asarray(solved)


@kept_jit
def _load_tables(compressor, rotor, pins, speeds, solver):
    if solver is None:
        solver = _OF_FORCES

    def loads_at(speed):
        orbit = solve_orbit(at_speed(compressor, speed), solver, throw=False)
        # Held at its speed the crank has a periodic state even where the machine has none.
        motor = replaced(ConstantSpeed(1.0), mean_speed=speed)
        # Motor or friction may be `None`, which counts as a leaf only where `is_leaf` says so.
        held_compressor = eqx.tree_at(
            lambda c: (c.motor, c.friction), compressor, (motor, None), is_leaf=lambda x: x is None
        )
        held_orbit = solve_orbit(held_compressor, solver, throw=False)
        loads = film_loads(rotor, compressor, pins, orbit)
        held_loads = film_loads(rotor, compressor, pins, held_orbit)
        # Where there is no periodic state there is no orbit to average along: there the films that ask
        # for it are linearised at the load of the crank at constant speed.
        for number, means in film_coefficients(rotor, compressor, orbit).items():
            bearing = _film(rotor, number).bearing
            held_loads[number] = stiffness_damping(bearing, held_loads[number], speed)
            loads[number] = means
        return jax.tree.map(partial(jnp.where, orbit.converged), loads, held_loads)

    return jax.vmap(loads_at)(speeds)


def _loaded(rotor: RotorModel, loads, speeds=None) -> RotorModel:
    links = list(rotor.links)
    for number, load in loads.items():
        if not isinstance(load, DynamicCoefficients):
            law = replaced(links[number].law, load=load)
            if speeds is not None:
                law = replaced(law, speed=speeds)
        elif speeds is None:
            law = ConstantLaw(*load)
        elif speeds.size == 1:
            # A table needs two speeds.
            law = ConstantLaw(*(value[0] for value in load))
        else:
            law = SpeedTable(speeds, *load, kind="linear")
        links[number] = replaced(links[number], law=law)
    return eqx.tree_at(lambda m: m.links, rotor, tuple(links))
