r"""Balances of mass and energy of the gas, and the motion of valves and ports, over the crank angle.

$$m' = (\dot m_s - \dot m_d - \dot m_l)/\omega$$
$$m c_v T' = -T\left(\frac{\partial p}{\partial T}\right)_\rho\left(V' - \frac{m'}{\rho}\right) - h m'
  + (\dot m_s h_s^* - \dot m_d h_d^* - \dot m_l h_l^* + \dot Q)/\omega$$

h* is the enthalpy of where the flow comes from. The state is m, T and for either valve lift x,
velocity v and port velocity U, each over its scale. Between events the law is smooth: where it has
branches, integers say which one holds. For either valve these are its mode (0 on the seat, 1 free, 2 on
the stop), the sign of U and the sign of the forward pressure difference. Plenums add mass, temperature
and flow in the neck each.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._core.each import mapped
from .._core.extremes import clip, max_of, maximum, minimum
from ..fluid import GasState
from ..valve import AbstractValve, Oscillator
from ..valve._flow import (
    Side,
    choking_margin,
    choose,
    port_acceleration,
    quasi_steady_flow,
    throat_density,
)
from ._cylinder import Case, side_of
from ._plenum import PlenumChain, valve_sides
from .heat._heat_transfer import HeatInput

# m, T, then x, v, U of the suction and of the discharge valve; then those of the wall
STATES = 8
FLAGS = 6
SEAT = 0
FREE = 1
STOP = 2
# For either valve: leaves its seat, meets it or leaves its stop; meets its stop; U = 0; dp = 0.
EVENTS = 8
# streams of a cylinder, see `Rates`
STREAMS = 6
# [1/rad] How fast what does not move returns to its place, where it is already.
_IDLE = 1.0


class Accounts(NamedTuple):
    """Rates over the crank angle, in units of mass and energy scale; integrals after a revolution.

    Attributes:
        work: p dV.
        suction, discharge, leakage: mass through the valves (forward) and past the piston (out).
        suction_back, discharge_back: the part of it that flows backward, positive.
        heat: from the wall to the gas.
        suction_heat, discharge_heat, leakage_heat: enthalpy that goes with the masses.
        suction_loss, discharge_loss: work against the pressure difference of an open valve.
    """

    work: Float[Array, "*n"]
    suction: Float[Array, "*n"]
    discharge: Float[Array, "*n"]
    leakage: Float[Array, "*n"]
    suction_back: Float[Array, "*n"]
    discharge_back: Float[Array, "*n"]
    heat: Float[Array, "*n"]
    suction_heat: Float[Array, "*n"]
    discharge_heat: Float[Array, "*n"]
    leakage_heat: Float[Array, "*n"]
    suction_loss: Float[Array, "*n"]
    discharge_loss: Float[Array, "*n"]


class Rates(NamedTuple):
    """Rates of the states at a crank angle."""

    state: Float[Array, " n"]  # d state/d angle
    accounts: Float[Array, " 12"]  # what runs through and out
    # functions that an event makes negative; 1 where the event is not possible
    events: Float[Array, " 8"]
    force: Float[Array, " 2"]  # on the valves at rest, over p_s and force area
    pressure: Float[Array, ""]  # [Pa] in the cylinder
    # [kg/s] and [W] through suction and discharge valve, forward; then [W] from the wall to the gas
    # before the one and behind the other
    streams: Float[Array, " 6"]


class _Valves(NamedTuple):
    """Motion and flows of both valves, suction before discharge."""

    flow: Float[Array, " 2"]
    enthalpy: Float[Array, " 2"]
    rates: Float[Array, "2 3"]
    events: Float[Array, "2 4"]
    force: Float[Array, " 2"]
    is_open: Float[Array, " 2"]


def account_scales(case: Case) -> Float[Array, " 12"]:
    """[kg] or [J] of every account."""
    mass = case.mass_scale
    energy = case.energy_scale
    masses = ("suction", "discharge", "leakage", "suction_back", "discharge_back")
    return jnp.stack([mass if name in masses else energy for name in Accounts._fields])


def gas_in(case: Case, angle, state: Float[Array, " 8"]) -> GasState:
    """The gas in the cylinder."""
    return case.cylinder.fluid.state(*temperature_and_density(case, angle, state))


def temperature_and_density(case: Case, angle, state: Float[Array, " 8"]):
    """[K] and [kg/m^3]; a state that is out of all bounds is brought back to finite values."""
    low, high = case.cylinder.fluid.temperature_range
    # up to twice the range, and not to its end: gas that is hotter than its equation was fitted
    # for must still show in the status
    T = clip(state[1] * case.suction.T, low, 2 * high)
    volume, _ = case.volume(angle)
    rho = maximum(state[0], 1e-6) * case.mass_scale / volume
    return T, rho


def valve_scales(case: Case, which: int):
    """Scales of lift [m], velocity [m/s] and port velocity [m/s] of a valve, by its number."""
    return scales_of(case, case.cylinder.valves[which])


def scales_of(case: Case, valve: AbstractValve):
    """Scales of lift [m], velocity [m/s] and port velocity [m/s] of a valve."""
    moving = valve.oscillator
    # a velocity over `lift * speed` is the rate of the lift over the crank angle; that of the port
    # is over the speed of sound, but for the root of kappa
    lift = jnp.ones(()) if moving is None else moving.stop
    return lift, lift * case.speed, jnp.sqrt(case.suction.p / case.suction.rho)


def rates(
    case: Case,
    angle,
    state: Float[Array, " n"],
    flags: Int[Array, " 6"],
    gas: GasState | None = None,
    speed: Float[Array, ""] | None = None,
    pair: tuple[PlenumChain, PlenumChain] | None = None,
    lines: tuple[Side, Side] | None = None,
) -> Rates:
    """Right-hand side, accounts and event functions.

    Args:
        case: cylinder and lines.
        angle: [rad] crank angle.
        state: (n,) over its scales.
        flags: (6,) mode, sign of U and sign of the pressure difference of either valve.
        gas: the gas at that state; computed if absent.
        speed: [rad/s] of the crank. The rates are then those in time, over the mean speed of the case,
            and the crank may stand; absent: that of the case, and rates over the crank angle.
        pair: the plenums before the suction and behind the discharge valve, which `Cylinders` follows.
        lines: the gas at the flanges, where pipes let it swing; that of the case if absent.
    """
    if gas is None:
        gas = gas_in(case, angle, state)
    cylinder = case.cylinder
    inside = side_of(gas)
    flanges = case.lines if lines is None else lines
    before, behind = _sides_at_valves(case, pair, lines)
    volume, volume_1 = case.volume(angle)
    turning = pace = case.speed_at(angle)
    # correlations with negative powers of the speed have no value at rest
    spin = turning, case.speed
    if speed is not None:
        pace = case.speed
        # dV/dt over the mean speed: nothing is divided by the speed of a crank that stands
        volume_1 = volume_1 * (speed / pace)
        spin = (maximum(jnp.abs(speed), 1e-3 * case.speed),) * 2
    # within a revolution the wall's temperature does not vary
    walls = cylinder.walls if speed is None else None
    wall = cylinder.wall_temperature
    if walls is not None:
        wall = state[STATES] * case.suction.T

    valves = _valves(case, (before, inside, behind), state[2:STATES], flags, pace, angle)
    transport = _transport(cylinder, gas)
    # the sign of the suction valve's difference, where that is the one to the line
    follows = cylinder.inert and pair is None and lines is None
    inward = None
    if follows:
        inward = flags[2] > 0
    # the crankcase has the gas of the line, whatever swings in pipes and plenums before the valve
    leak, leak_enthalpy = _leakage(case, inside, case.lines[0], inward, transport)
    heat = _heat(case, angle, gas, volume, volume_1, spin, valves, transport, wall)

    # the balances of mass and energy, for mass and temperature
    mass = state[0] * case.mass_scale
    carried = valves.flow * valves.enthalpy
    mass_1 = (valves.flow[0] - valves.flow[1] - leak) / pace
    gained = carried[0] - carried[1] - leak * leak_enthalpy + heat
    # with temperature and density as states the equation of state need not be inverted; energy
    # then closes to the error of the collocation, where mass closes to rounding
    energy_1 = (
        -gas.T * gas.dp_dT * (volume_1 - mass_1 / gas.rho) - inside.h * mass_1 + gained / pace
    )
    first = jnp.stack([mass_1 / case.mass_scale, energy_1 / (mass * gas.c_v * case.suction.T)])

    slopes = [first, valves.rates.ravel()]
    # [1/kg] and [1/J] from a flow to its rate over the angle, in units of mass and energy scale
    tiny = 1 / (pace * case.mass_scale)
    small = 1 / (pace * case.energy_scale)
    leaks = leak * tiny, leak * leak_enthalpy * small
    flows = valves.flow * tiny, carried * small
    warmed = heat * small
    scale = case.energy_scale
    accounts = _accounts(flanges, scale, inside, valves.is_open, flows, leaks, warmed, volume_1)
    to_plenums = (jnp.zeros(()),) * 2
    if cylinder.walls is not None:
        to_plenums = cylinder.walls.to_plenums(wall, pair)
    if walls is not None:
        warmed = walls.gained(wall, heat, to_plenums) * small
        slopes.append(jnp.stack([jnp.zeros(()), warmed]))
    through = jnp.stack([valves.flow, carried], axis=1).ravel()
    return Rates(
        jnp.concatenate(slopes),
        jnp.stack(accounts),
        valves.events.ravel(),
        valves.force,
        inside.p,
        jnp.concatenate([through, jnp.stack(to_plenums)]),
    )


def choking_margins(case: Case, angle, state, flags, pair=None, lines=None) -> Float[Array, " 2"]:
    """[-] Of suction and discharge port, as `choking_margin` gives them; 1 where the valve is shut.

    Args:
        case, angle, state, flags, pair, lines: as in `rates`.
    """
    inside = side_of(gas_in(case, angle, state))
    before, behind = _sides_at_valves(case, pair, lines)
    margins = [choking_margin(before, inside), choking_margin(inside, behind)]
    for which, valve in enumerate(case.cylinder.valves):
        if valve.oscillator is not None:
            margins[which] = jnp.where(flags[3 * which] > SEAT, margins[which], 1.0)
    return jnp.stack(margins)


def _sides_at_valves(
    case: Case, pair: tuple[PlenumChain, PlenumChain] | None, lines: tuple[Side, Side] | None
) -> tuple[Side, Side]:
    """The gas before the suction and behind the discharge valve, where either line may have plenums."""
    flanges = case.lines if lines is None else lines
    if pair is None:
        return flanges
    before, behind = map(side_of, valve_sides(pair))
    if lines is None:
        return before, behind
    # a cylinder without plenums of a line has a flange of its own
    return (
        before if pair[0].plenums else flanges[0],
        behind if pair[1].plenums else flanges[1],
    )


def _accounts(
    lines: tuple[Side, Side], energy_scale, inside: Side, is_open, flows, leaks, heat, volume_1
) -> Accounts:
    """Rates of mass and energy through the cylinder over the angle, in units of mass and energy scale.

    Args:
        lines: the gas at the flanges.
        energy_scale: [J]
        inside: the gas in the cylinder.
        is_open: (2,) 1 where suction and discharge valve are open.
        flows: of mass (2,) through them, forward, and of the enthalpy that it carries (2,).
        leaks: of mass past the piston, and of its enthalpy.
        heat: from the wall.
        volume_1: [m^3/rad]
    """
    suction, discharge = lines
    masses, heats = flows
    worked = volume_1 / energy_scale
    back = -minimum(masses, 0.0)
    lost = is_open * worked
    return Accounts(
        # work and losses of the gas: dV is positive while it is drawn and negative while it is
        # pushed out, so that either loss is positive
        work=inside.p * worked,
        suction=masses[0],
        discharge=masses[1],
        leakage=leaks[0],
        suction_back=back[0],
        discharge_back=back[1],
        heat=heat,
        suction_heat=heats[0],
        discharge_heat=heats[1],
        leakage_heat=leaks[1],
        suction_loss=lost[0] * maximum(suction.p - inside.p, 0.0),
        discharge_loss=-lost[1] * maximum(inside.p - discharge.p, 0.0),
    )


def _valves(case: Case, sides: tuple[Side, Side, Side], states, flags, pace, angle) -> _Valves:
    """Motion and flows of the valves between the gas before, in and behind the cylinder.

    Valves of one kind are two entries of one law, which programs then have once.
    """
    # a choice is part of the kernel that needs it, where a stack would be one of its own
    a, b = (choose(np.array([True, False]), *pair) for pair in (sides[:2], sides[1:]))
    # the sign of the suction's difference is that of the leakage as well, with the valve shut too
    known_shut = jnp.array([case.cylinder.leakage is not None, False])
    arguments = a, b, states.reshape(2, 3), flags.reshape(2, 3), known_shut
    return mapped(partial(_valve, case, pace, angle), case.cylinder.valves, *arguments)


def _valve(
    case: Case, pace, angle, valve: AbstractValve, a: Side, b: Side, state, flags, known_shut
) -> _Valves:
    """Motion and flow of one valve: its entries of `_Valves`."""
    x, v, u = state
    mode, u_sign, p_sign = flags
    lift, velocity, port_velocity = scales_of(case, valve)
    difference = (a.p - b.p) / case.suction.p
    unity = jnp.ones(())

    moving = valve.oscillator
    is_open = unity
    force = jnp.zeros(())
    events = [unity] * 4
    # a decay and not zero: a state that never moved would be periodic with any value, and leave
    # the matrix of the revolution singular
    x_1 = -_IDLE * x
    v_1 = -_IDLE * v
    if moving is not None:
        seated = mode == SEAT
        free = mode == FREE
        is_open = 1.0 * (mode > SEAT)
        place = jnp.where(free, x, 1.0 * (mode == STOP))
        area = valve.force_area(place * lift)
        push = _push(valve, moving, place * lift, area * (a.p - b.p), angle)
        # decides whether the valve rests: without the damping, which ends with the motion
        force = push / (area * case.suction.p)
        slowing = moving.damping
        film = getattr(valve, "stiction", None)
        if film is not None:
            slowing = slowing + film.resistance(place * lift, valve.port_diameter)
        pull = push - slowing * v * velocity
        scale = moving.mass * velocity * pace
        x_1 = jnp.where(free, v * case.speed / pace, -_IDLE * (x - 1.0 * (mode == STOP)))
        v_1 = jnp.where(free, pull / scale, v_1)
        # one function for three events: a free plate is back at x = 0, one on the seat is lifted
        # as the force on it turns positive, one on the stop leaves as it turns negative
        first = jnp.where(free, x, jnp.where(seated, -force, force))
        events[:2] = [first, jnp.where(free, 1 - x, unity)]
        x = place

    area = valve.flow_area(maximum(x, 0.0) * lift) * is_open
    if valve.port_length is None:
        flow = area * quasi_steady_flow(a, b)
        if moving is None:
            flow = maximum(flow, 0.0)
        forward = a.p > b.p
        u_1 = -_IDLE * u
    else:
        speed_in_port = u * port_velocity
        push = port_acceleration(a, b, speed_in_port, p_sign, u_sign)
        u_1 = push / (valve.port_length * port_velocity * pace)
        u_1 = jnp.where(is_open > 0, u_1, -_IDLE * u)
        flow = area * throat_density(a, b, p_sign, u_sign) * speed_in_port
        forward = u_sign > 0
        # branches follow these signs and not the values: the laws stay smooth beyond a reversal,
        # until the march has located it and the signs change
        watched = is_open > 0
        events[2] = jnp.where(watched, u_sign * u, unity)
        events[3] = jnp.where(watched | known_shut, p_sign * difference, unity)
    return _Valves(
        flow=flow,
        enthalpy=jnp.where(forward, a.h, b.h),
        rates=jnp.stack([x_1, v_1, u_1]),
        events=jnp.stack(events),
        force=force,
        is_open=is_open,
    )


def _push(valve: AbstractValve, moving: Oscillator, lift, by_gas, angle) -> Float[Array, ""]:
    """[N] On the plate towards its stop, without what slows it: gas, spring and unloader."""
    push = by_gas - moving.stiffness * (lift + moving.preload)
    unloader = getattr(valve, "unloader", None)
    if unloader is None:
        return push
    return push + unloader.force_at(angle)


def _leakage(case: Case, inside: Side, suction: Side, inward, transport):
    """Mass flow [kg/s] past the piston and its enthalpy [J/kg]; `inward` if its sign is known."""
    gap = case.cylinder.leakage
    if gap is None:
        return jnp.zeros(()), inside.h
    viscosity = transport[0] if gap.viscosity is None else gap.viscosity
    if inward is None:
        inward = suction.p > inside.p
    flow = gap.flow(inside, suction, case.sealed_diameter, viscosity)
    return flow, jnp.where(inward, suction.h, inside.h)


def _transport(cylinder, gas: GasState):
    """Viscosity and conductivity of the gas; `None` where every law has its own."""
    heat = cylinder.heat
    gap = cylinder.leakage
    heat_has_its_own = heat is None or (
        heat.viscosity is not None and heat.conductivity is not None
    )
    if heat_has_its_own and (gap is None or gap.viscosity is not None):
        return None, None
    return cylinder.fluid.transport(gas.T, gas.rho)


def _heat(case: Case, angle, gas: GasState, volume, volume_1, spin, valves, transport, wall):
    """Heat from the wall [W]; `spin` is the speed of the crank and the one of the mean piston speed."""
    law = case.cylinder.heat
    if law is None:
        return jnp.zeros(())
    mu = transport[0] if law.viscosity is None else law.viscosity
    conductivity = transport[1] if law.conductivity is None else law.conductivity
    area = case.mechanism.piston_area
    # piston and head, then the bore down to the piston; with the gap D - d of a crank end that is
    # the area of bore and rod together
    wall_area = 2 * area + 4 * volume / case.gap_between_walls
    at = HeatInput(
        rho=gas.rho,
        prandtl=gas.c_p * mu / conductivity,
        viscosity=mu,
        conductivity=conductivity,
        bore=case.bore,
        wall_area=wall_area,
        volume=volume,
        angle=angle,
        speed=spin[0],
        piston_speed=case.mechanism.stroke * spin[1] / jnp.pi,
        outward=jnp.sign(volume_1),
        suction_open=valves.is_open[0],
        discharge_open=valves.is_open[1],
        port_speed=max_of(jnp.abs(valves.flow)) / (gas.rho * area),
    )
    return law.coefficient(at) * wall_area * (wall - gas.T)


def in_angle_and_state(case: Case, law, packed: Float[Array, " m"]):
    """A law of angle and state, and its derivatives in them.

    The equation of state is differentiated in temperature and density alone, everything else in angle,
    state and in the few properties it uses.

    Args:
        case: cylinder and lines.
        law: of `packed` and of the gas in the cylinder, to a vector.
        packed: crank angle, then the state, of which the first two are mass and temperature.

    Returns:
        (a,) and (a, m).
    """
    # what the balances read of a gas: enthalpy, c_p and kappa follow from these, and entropy is
    # not among them
    columns = ("p", "u", "c_v", "dp_dT", "dp_drho")
    fluid = case.cylinder.fluid

    def inputs(packed):
        return jnp.stack(temperature_and_density(case, packed[0], packed[1:]))

    def properties(inputs):
        gas = fluid.state(*inputs)
        values = jnp.stack([getattr(gas, name) for name in columns])
        return values, values

    def with_gas(packed, values):
        T, rho = inputs(packed)
        return law(
            packed, GasState(T=T, rho=rho, s=0 * T, **dict(zip(columns, values, strict=True)))
        )

    in_gas, values = jax.jacfwd(properties, has_aux=True)(inputs(packed))
    # one direction for every column, each with what it does to the gas
    along_gas = (in_gas @ jax.jacfwd(inputs)(packed)).T
    linear_point, push = jax.linearize(with_gas, packed, values)
    return linear_point, jax.vmap(push)(jnp.eye(packed.size), along_gas).T


def initial(case: Case, angle) -> tuple[Float[Array, " n"], Int[Array, " 6"]]:
    """A guess: valves shut, gas of the suction line, compressed as far as the discharge valve lets it."""
    volume, volume_1 = case.volume(angle)
    full = (1 + case.cylinder.clearance_ratio) * case.swept
    # kappa of a real gas is no exponent near saturation, and a guess needs only a plausible one
    squeeze = (full / volume) ** (clip(case.suction.kappa, 1.01, 1.7) - 1)
    high = case.isentropic
    low = case.suction
    # compressed beyond the discharge pressure the valve would have opened: what is left then has
    # the density at the end of the isentropic compression
    mass = minimum(full / case.swept, high.rho / low.rho * volume / case.swept)
    warm = minimum(squeeze, high.T / low.T)
    outward = volume_1 > 0  # the piston draws in
    mass = jnp.where(outward, volume / case.swept, mass)
    warm = jnp.where(outward, 1.0, warm)
    state = jnp.zeros(STATES).at[0].set(mass).at[1].set(warm)
    p = gas_in(case, angle, state).p
    signs = [jnp.where(case.suction.p > p, 1, -1), jnp.where(p > case.discharge.p, 1, -1)]
    flags = jnp.stack([jnp.asarray(f) for f in [0, 1, signs[0], 0, 1, signs[1]]])
    if case.cylinder.walls is None:
        return state, flags
    wall = jnp.stack([case.cylinder.wall_temperature / case.suction.T, jnp.zeros(())])
    return jnp.concatenate([state, wall]), flags
