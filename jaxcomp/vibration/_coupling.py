r"""The crank and the rotor of one machine: loads, films, and both at a given speed.

The rod pushes the crank pin, the gas the cylinder head, the piston the cylinder wall, and the motor
and the main journal turn rotor and stator against each other. All are real forces on real places, with
the friction of the pins, so that force and moment over the machine are minus those of the inertia of
rod and piston, and nothing else. The crank's own unbalance belongs to `Unbalances`.

The frames are the same: x along the cylinder, the crank turns from x to y; the forces of several
cylinders are turned from the axes of each to those of the machine. The harmonics are those of time,
with the crank at angle zero at W t = 0 on the mean; W is the mean speed.

Source: Levecque et al. (2011), cited in full in `machines/hermetic-68cc.toml`, Eq. (5), where
polynomials are fitted first; here the forces themselves are integrated. Its Eq. (6) takes the mean
force of the rod as the static load of the pin; the bearings carry it by the statics of the shaft. Films
with `linearised="orbit"` take their means along the orbits of their journals instead.
"""

from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import of_cylinder, rebuilt, replaced
from .._core.words import one_of
from ..compressor import Compressor, at_speed, first_top, instants
from ..crank import Collocation, Orbit, journal_films, solve_orbit
from ..crankshaft import shares
from ..film import DynamicCoefficients, NamedBearing, stiffness_damping
from ..machine import Assembly, Machine
from ..mechanism import SliderCrank, SliderLink, Vector, contact_arms, rod_motion
from ..motor import ConstantSpeed
from ..rotor import (
    ConstantLaw,
    CrankNodes,
    LoadedFilm,
    PeriodicForce,
    RotorModel,
    SpeedTable,
    Unbalances,
    main_films,
)

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


class CrankForces(NamedTuple):
    """Loads of one periodic state of the crank.

    Attributes:
        forces: on rod end, head and wall of every cylinder, and of the motor where it was asked for.
        spin_speed: [rad/s] mean speed, at which these forces hold.
        missing: [-] by load, "rod" or "rod_2" of several, what the orders leave out: root mean square of
            the rest over that of the force.
    """

    forces: tuple[PeriodicForce, ...]
    spin_speed: Float[Array, ""]
    missing: dict[str, Float[Array, ""]]


def crank_forces(
    compressor: Compressor,
    state: Orbit,
    nodes: CrankNodes,
    orders: tuple[int, ...] = (0, 1, 2, 3, 4, 5),
) -> CrankForces:
    """Fourier coefficients of the crank's forces, by the quadrature of its own solver.

    Args:
        compressor: with a slider-crank or slider-link.
        state: its periodic state, from `solve_orbit`; its nodes respect the kinks of the gas, and
            the orders should stay well below half their number.
        nodes: where the forces act.
        orders: harmonics to keep, 0 for the mean.

    Raises:
        BadInput: another mechanism.
    """
    mechanism, crankshaft = compressor.mechanism, compressor.crankshaft
    if not isinstance(mechanism, SliderCrank | SliderLink):
        raise BadInput("mechanism", type(mechanism).__name__, "a slider-crank or slider-link")
    angle, lost = state.state.angle, state.loads.loss_torque
    none = jnp.zeros_like(angle)
    phase = state.mean_speed * state.time + first_top(compressor)
    share = state.weight / state.state.speed
    share = share / jnp.sum(share)
    gas_forces = instants(state.under_gas(compressor), angle).gas_force
    own_angles = crankshaft.own_angle(angle)
    of_joints = _rod_and_wall if isinstance(mechanism, SliderCrank) else _slider_and_wall
    forces, missing, of_pins = [], {}, set()
    for place, own_nodes in enumerate(nodes.of_cylinders):
        number = place + 1
        single, own, gas = of_cylinder(mechanism, number), own_angles[place], gas_forces[place]
        joints = {name: crankshaft.joint(name, number) for name in _OF_CYLINDER}
        of_pins |= set(joints.values())
        at = {
            name: state.loads.forces[joints[name]]
            for name in _PRESSED
            if joints[name] in state.loads.forces
        }
        losses = {name: lost.get(joints[name], none) for name in ("crank_pin", "piston_pin")}
        pin, torque, side, lever = of_joints(single, own, at, losses)
        lever = lever - nodes.wall_position * side[1] - single.offset * side[0]
        wrenches = (
            ("rod", pin[0], pin[1], torque),
            ("gas", gas, none, -single.offset * gas),
            ("wall", side[0], side[1], lever),
        )
        c, s = jnp.cos(crankshaft.bank_angle[place]), jnp.sin(crankshaft.bank_angle[place])
        for node, (name, fx, fy, mz) in zip(own_nodes, wrenches, strict=True):
            along = jnp.stack([c * fx - s * fy, s * fx + c * fy, none])
            table, missing[crankshaft.joint(name, number)] = _harmonics(along, phase, share, orders)
            turning, _ = _harmonics(jnp.stack([none, none, mz]), phase, share, orders)
            forces.append(PeriodicForce(node, None, orders, *table, *turning))
    if nodes.rotor is not None:
        at_shaft = sum((lost[name] for name in lost if name not in of_pins), start=none)
        between = state.motor_torque - at_shaft
        turning = jnp.stack([none, none, between])
        (cosine, sine), missing["motor"] = _harmonics(turning, phase, share, orders)
        zero = jnp.zeros_like(cosine)
        forces.append(PeriodicForce(nodes.rotor, nodes.stator, orders, zero, zero, cosine, sine))
    return CrankForces(tuple(forces), state.mean_speed, missing)


# Joints whose forces act on crank pin and cylinder, and all of a cylinder.
_PRESSED = ("crank_pin", "wall", "wall_crown", "wall_edge", "piston_film")
_OF_CYLINDER = (*_PRESSED, "packing", "piston_pin", "link_slider")


def _rod_and_wall(mechanism: SliderCrank, angle, forces, lost):
    """What a slider-crank does to crank and crankcase, in the axes of its cylinder.

    Returns:
        Force on the pin [N] (2, n), its torque on the crank [N m], force on the wall [N] (2, n), and its
        moment [N m] about the shaft but for that of the force along the axis.
    """
    rod, side = -forces["crank_pin"], -forces["wall"]
    tilt = rod_motion(mechanism, angle).tilt_1
    # Friction turns the pin against the crank, and the piston (so the wall) along with the rod.
    torque = _pin_torque(mechanism, angle, rod) - lost["crank_pin"] / (1 + tilt)
    lever = mechanism.piston(angle)[0] * side[1]
    return rod, torque, side, lever - lost["piston_pin"] / jnp.where(tilt == 0, 1.0, tilt)


def _slider_and_wall(mechanism: SliderLink, angle, forces, lost):
    """The same of a slider-link. The piston touches with opposite sides of its diameter.

    With `slider_moment = "paper"` the couple between slider and link is in none of the forces, and
    missing in the moments.
    """
    pin = -forces["crank_pin"]
    torque = _pin_torque(mechanism, angle, pin) - lost["crank_pin"]
    crown, edge = -forces["wall_crown"], -forces["wall_edge"]
    at_crown = mechanism.piston(angle)[0]
    at_edge = at_crown - contact_arms(mechanism, angle).engaged
    lever = at_crown * crown[1] + at_edge * edge[1]
    for touch in (crown, edge):
        # the wall is pressed along y where y is on the same side of the axis
        lever = lever - 0.5 * mechanism.bore * jnp.sign(touch[1]) * touch[0]
    return pin, torque, crown + edge - forces["piston_film"], lever


def _pin_torque(mechanism: SliderCrank | SliderLink, angle, force):
    return mechanism.crank_radius * (jnp.cos(angle) * force[1] - jnp.sin(angle) * force[0])


def open_films(rotor: RotorModel | None) -> tuple[int, ...]:
    """Numbers of the links whose film takes its static load from the crank's periodic state."""
    links = rotor.links if rotor is not None else ()
    return tuple(i for i, link in enumerate(links) if getattr(link.law, "load", 0) is None)


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
    names = {i: _film(rotor, i).name for i in open_films(rotor) if _along_orbit(rotor, i)}
    films = journal_films(compressor, state) if names else {}
    for number, name in names.items():
        if name not in films:
            where = f"rotor.links.{number}.law.linearised"
            bound = '"mean_load": its bearing is none of `crankshaft.main_journal.bearings`'
            raise BadInput(where, "orbit", bound)
    return {i: DynamicCoefficients(films[name].stiffness, films[name].damping)
            for i, name in names.items() if name is not None}  # fmt: skip


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
            law = LoadedFilm(law.bearing, linearised=place, name=law.name)
            links[number] = replaced(links[number], law=law)
    parts = machine.parts | {"rotor": eqx.tree_at(lambda r: r.links, rotor, tuple(links))}
    return eqx.tree_at(lambda m: m.parts, machine, parts)


def _along_orbit(rotor: RotorModel, number: int) -> bool:
    return _film(rotor, number).linearised == "orbit"


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
    share, crankshaft = state.weight / state.state.speed, compressor.crankshaft
    share = share / jnp.sum(share)
    pins = [crankshaft.joint("crank_pin", k + 1) for k in range(crankshaft.count)]
    each = jnp.stack([-(state.loads.forces[pin] @ share) for pin in pins], axis=1)
    each = crankshaft.turned(Vector(*each)).stacked()
    mean, moment = jnp.sum(each, axis=1), each @ crankshaft.position
    bearings = tuple(_film(rotor, number).bearing for number, _ in films)
    position = jnp.stack([z for _, z in films])
    found = shares(bearings, position)
    return {
        number: share * mean + lever * moment
        for (number, _), (share, lever) in zip(films, found, strict=True)
    }


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
    mechanism, crankshaft = compressor.mechanism, compressor.crankshaft
    if "inertia" in left_out:
        # Their bounds leave out zero; a millionth is as good.
        names = ("piston_mass", "conrod_mass", "conrod_inertia")
        if isinstance(mechanism, SliderLink):
            names = ("piston_mass", "slider_mass")
        mechanism = replaced(mechanism, **{n: 1e-6 * getattr(mechanism, n) for n in names})
    if "fluctuation" in left_out:
        assert crankshaft.inertia is not None
        crankshaft = replaced(crankshaft, inertia=1e6 * crankshaft.inertia)
    changes: dict[str, Any] = dict.fromkeys({"gas", "friction"} & {*left_out})
    if "friction" in left_out:
        crankshaft = rebuilt(crankshaft, main_journal=None)
    return rebuilt(compressor, mechanism=mechanism, crankshaft=crankshaft, **changes)


class CrankLoads(NamedTuple):
    """What the crank does to its rotor at one speed; with a leading axis for several.

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
    """What the crank does to its rotor at one speed; it is solved once, and only where it is needed.

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
    rotor, case = machine.rotor, machine.loads
    assert rotor is not None
    assert case is not None
    opened = open_films(rotor)
    if not (opened or crank):
        return CrankLoads({}, (), jnp.asarray(True))
    if machine.compressor is None or case.crank is None:
        need = "the excitation by the crank" if crank else "films without a given load"
        raise BadInput("loads.crank", "absent", f"given beside a compressor, for {need}")
    solver = _OF_FORCES if solver is None else solver
    whole = at_speed(machine.compressor, speed)
    orbit = solve_orbit(whole, solver, throw=False)
    ok, films = orbit.converged, {}
    if opened:
        loads = film_loads(rotor, whole, case.crank.pins, orbit)
        films = {number: loads[number] for number in opened}
        films |= film_coefficients(rotor, whole, orbit)
    if not crank:
        return CrankLoads(films, (), ok)
    if left_out:
        whole = without(whole, left_out)
        orbit = solve_orbit(whole, solver, throw=False)
        ok &= orbit.converged
    forces = crank_forces(whole, orbit, case.crank, tuple(dict.fromkeys((0, *orders))))
    return CrankLoads(films, forces.forces, ok)


def running_rotor(
    machine: Assembly, crank: CrankLoads
) -> tuple[RotorModel, tuple[Unbalances | PeriodicForce, ...]]:
    """The rotor with every film under its static load, and all that shakes it, at one speed.

    Args:
        machine: put together, with rotor and loads.
        crank: of `crank_loads` at this speed.
    """
    assert machine.rotor is not None
    loads = (*machine.unbalances, *crank.forces) if crank.forces else machine.given_loads
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
    rotor, case = machine.rotor, machine.loads
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
    speeds = jnp.maximum(jnp.sort(jnp.ravel(jnp.asarray(speeds, float))), _SLOWEST)
    if speeds.size > _LOADED:
        speeds = jnp.linspace(speeds[0], speeds[-1], _LOADED)
    tables = _load_tables(machine.compressor, rotor, case.crank.pins, speeds, solver)
    return _loaded(rotor, {number: tables[number] for number in opened}, speeds)


@kept_jit
def _load_tables(compressor, rotor, pins, speeds, solver):
    solver = _OF_FORCES if solver is None else solver

    def one(speed):
        orbit = solve_orbit(at_speed(compressor, speed), solver, throw=False)
        held = replaced(ConstantSpeed(1.0), mean_speed=speed)
        steady = eqx.tree_at(
            lambda c: (c.motor, c.friction), compressor, (held, None), is_leaf=lambda x: x is None
        )
        steady = solve_orbit(steady, solver, throw=False)
        found, instead = (film_loads(rotor, compressor, pins, o) for o in (orbit, steady))
        along = film_coefficients(rotor, compressor, orbit)
        held = {i: stiffness_damping(_film(rotor, i).bearing, instead[i], speed) for i in along}
        pair = (found | along, instead | held)
        return jax.tree.map(partial(jnp.where, orbit.converged), *pair)

    return jax.vmap(one)(speeds)


def _loaded(rotor: RotorModel, loads, speeds=None) -> RotorModel:
    links = list(rotor.links)
    for number, load in loads.items():
        if not isinstance(load, DynamicCoefficients):
            law = replaced(links[number].law, load=load)
            law = law if speeds is None else replaced(law, speed=speeds)
        elif speeds is None:
            law = ConstantLaw(*load)
        elif speeds.size == 1:
            law = ConstantLaw(*(value[0] for value in load))
        else:
            law = SpeedTable(speeds, *load, kind="linear")
        links[number] = replaced(links[number], law=law)
    return eqx.tree_at(lambda m: m.links, rotor, tuple(links))


def _harmonics(values: Float[Array, "3 n"], phase, share, orders):
    """Coefficients (orders, 3) of cosine and sine, and the relative size of what is left out."""
    table = [((1.0 if n == 0 else 2.0), n * phase) for n in orders]
    cosine = jnp.stack([f * values @ (share * jnp.cos(p)) for f, p in table])
    sine = jnp.stack([f * values @ (share * jnp.sin(p)) for f, p in table])
    kept = sum(
        a[:, None] * jnp.cos(p) + b[:, None] * jnp.sin(p)
        for a, b, (_, p) in zip(cosine, sine, table, strict=True)
    )
    rest, whole = (jnp.sum(share * v**2) for v in (values - kept, values))
    return (cosine, sine), jnp.sqrt(rest / jnp.where(whole == 0, 1.0, whole))
