r"""Plenums with necks between the lines and the valves: suction muffler and discharge plenum.

Every plenum has the balances of the cylinder with a constant volume,

$$\dot m = \dot m_{in} - \dot m_{out},\quad
m c_v\dot T = T\left(\frac{\partial p}{\partial T}\right)_\rho\frac{\dot m}{\rho} - h\dot m
  + \dot m_{in} h^* - \dot m_{out} h^* ,$$

or a given temperature. The gas in the neck on its side of the line has inertia and a loss,

$$\frac{L}{A}\,\frac{d\dot m}{dt} = \Delta p
  - \frac{\zeta}{2\rho A^2}\,\dot m\sqrt{\dot m^2 + \dot m_0^2} ,$$

with density and enthalpy of where the gas comes from. Where the flow reverses, what comes first is what
has just gone: both sides count by the weights $(1 \pm \dot m/\sqrt{\dot m^2 + \dot m_0^2})/2$ with
$\dot m_0$ a fifth of the flow of a full cylinder. So the law is smooth, and a muffler that rings
makes no events.
"""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.extremes import clip, maximum
from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from ..fluid import AbstractFluid, GasState
from ..valve._flow import Side

PER_PLENUM = 3  # states: mass, temperature, and flow in the neck
_MIXED = 0.2  # [-] of the flow of a full cylinder: flow in a neck below which both sides mix
_LEAST_PASSED = 1e-3  # [-] of the mass of a full cylinder, by which a plenum is not exchanged
_MOST_SETTLED = 0.3  # [-] change of the temperature of a plenum in one revolution
_IDLE = 1.0  # [1/rad] how fast a given temperature returns to its place, where it is already


class Plenum(Part):
    """A volume of gas with a neck towards the line.

    Args:
        volume: [m^3]
        neck_length: [m] of the gas column, end correction included.
        neck_diameter: [m]
        loss_coefficient: [-] pressure loss over the dynamic pressure in the neck: 1.5 for a sharp
            entrance and a free jet.
        temperature: [K] of the gas; adiabatic if absent.
    """

    kind: ClassVar[str] = "plenum"

    volume: Float[Array, ""] = quantity("m^3", POSITIVE, usual=(1e-7, 10.0))
    neck_length: Float[Array, ""] = quantity(
        "m", POSITIVE, doc="with its end correction", usual=(1e-3, 10.0)
    )
    neck_diameter: Float[Array, ""] = quantity("m", POSITIVE, usual=(1e-3, 1.0))
    loss_coefficient: Float[Array, ""] = quantity(
        "", NONNEGATIVE, default=1.5, doc="of the neck, over its dynamic pressure"
    )
    temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, doc="of the gas; adiabatic if absent"
    )

    @property
    def neck_area(self) -> Float[Array, ""]:
        """[m^2]"""
        return jnp.pi / 4 * self.neck_diameter**2


class PlenumChain(NamedTuple):
    """Plenums between a line and a valve, in the order of the flow."""

    plenums: tuple[Plenum, ...]
    gases: tuple[GasState, ...]  # [-] the gas in each
    flows: tuple[Float[Array, ""], ...]  # [kg/s] through each neck, in the order of the flow
    nodes: tuple[GasState | Side, ...]  # gases before and behind every neck, the line with them
    inward: bool  # whether the necks stand before their plenums


class Scales(NamedTuple):
    """Scales of the states: [kg] of every plenum, [K], and [kg/s] of the flows."""

    mass: tuple[Float[Array, ""], ...]
    temperature: Float[Array, ""]
    flow: Float[Array, ""]


def chain_scales(case) -> Scales:
    """Scales of the plenums of a `Case`."""
    suction = case.cylinder.suction.plenums
    discharge = case.cylinder.discharge.plenums
    # each over what it holds at the state of its line: states are near one, however large the
    # volume
    mass = [p.volume * case.suction.rho for p in suction]
    mass += [p.volume * case.discharge.rho for p in discharge]
    return Scales(tuple(mass), case.suction.T, case.mass_scale * case.speed / (2 * jnp.pi))


def chains(
    case, state: Float[Array, " 3p"], lines: tuple[Side, Side] | None = None
) -> tuple[PlenumChain, PlenumChain]:
    """Both chains with their gases, from the states of all plenums.

    Args:
        case: cylinder and lines.
        state: (3 p,) over its scales.
        lines: the gas at the flanges, where pipes let it swing; that of the case if absent.
    """
    if lines is None:
        lines = (case.suction, case.discharge)
    line_before, line_behind = lines
    scales = chain_scales(case)
    fluid = case.cylinder.fluid
    suction = case.cylinder.suction.plenums
    discharge = case.cylinder.discharge.plenums
    gases = []
    flows = []
    for i, plenum in enumerate((*suction, *discharge)):
        m, T, f = state[PER_PLENUM * i : PER_PLENUM * (i + 1)]
        gases.append(_gas(fluid, plenum, m * scales.mass[i], T * scales.temperature))
        flows.append(f * scales.flow)
    cut = len(suction)
    before = tuple(gases[:cut])
    behind = tuple(gases[cut:])
    return (
        PlenumChain(suction, before, tuple(flows[:cut]), (line_before, *before), True),
        PlenumChain(discharge, behind, tuple(flows[cut:]), (*behind, line_behind), False),
    )


def valve_sides(pair: tuple[PlenumChain, PlenumChain]) -> tuple[GasState | Side, GasState | Side]:
    """The gas before the suction valves and behind the discharge valves."""
    return pair[0].nodes[-1], pair[1].nodes[0]


def line_streams(case, pair: tuple[PlenumChain, PlenumChain]) -> Float[Array, " 4"]:
    """Mass flow [kg/s] and enthalpy with it [W] between plenums and line, of suction, then of discharge.

    None where a line has no plenums: what passes the valves is what passes there.
    """
    least = _MIXED * chain_scales(case).flow
    streams = []
    for chain in pair:
        if not chain.plenums:
            streams += [jnp.zeros(()), jnp.zeros(())]
            continue
        # the neck at the line, and the gases on both sides of it
        flow = chain.flows[-1]
        gases = chain.nodes[-2:]
        if chain.inward:
            flow = chain.flows[0]
            gases = chain.nodes[:2]
        gas = _mixed(flow / jnp.sqrt(flow**2 + least**2), *gases)
        streams += [flow, flow * gas.h]
    return jnp.stack(streams)


def chain_rates(case, pair, state, streams: Float[Array, " 6"], pace) -> Float[Array, " 3p"]:
    """Rates of the states over time times `pace`.

    Args:
        case: cylinder and lines.
        pair: of `chains`.
        state: (3 p,) over its scales.
        streams: as in `Rates`, of all cylinders together.
        pace: [rad/s]
    """
    scales = chain_scales(case)
    out = []
    place = 0
    least = _MIXED * scales.flow
    walls = case.cylinder.walls
    sides = zip(pair, (streams[:2], streams[2:4]), streams[4:], strict=True)
    for chain, at_valve, heat in sides:
        count = len(chain.plenums)
        sizes = [jnp.sqrt(flow**2 + least**2) for flow in chain.flows]
        up = [
            _mixed(flow / size, *chain.nodes[i : i + 2])
            for i, (flow, size) in enumerate(zip(chain.flows, sizes, strict=True))
        ]
        necks = [(flow, flow * gas.h) for flow, gas in zip(chain.flows, up, strict=True)]
        # the streams into the first plenum, between plenums, and out of the last
        along = [at_valve, *necks]
        # the wall touches the plenum next to the valve: the last one before it, the first one
        # behind it
        at_wall = 0
        if chain.inward:
            along = [*necks, at_valve]
            at_wall = count - 1
        for i, (plenum, gas) in enumerate(zip(chain.plenums, chain.gases, strict=True)):
            come, with_it = along[i]
            go, away = along[i + 1]
            gained = come - go
            mass = gas.rho * plenum.volume
            # the balance of the cylinder with V' = 0; its rate is in time, and over the angle by
            # the pace below
            energy = gas.T * gas.dp_dT * gained / gas.rho - gas.h * gained + with_it - away
            if walls is not None and i == at_wall:
                energy = energy + heat
            T = state[PER_PLENUM * (place + i) + 1]
            T_1 = energy / (mass * gas.c_v * scales.temperature * pace)
            if plenum.temperature is not None:
                T_1 = -_IDLE * (T - plenum.temperature / scales.temperature)
            area = plenum.neck_area
            flow = chain.flows[i]
            loss = plenum.loss_coefficient / (2 * up[i].rho * area**2) * flow * sizes[i]
            push = (chain.nodes[i].p - chain.nodes[i + 1].p - loss) * area / plenum.neck_length
            out += [gained / (scales.mass[place + i] * pace), T_1, push / (scales.flow * pace)]
        place += count
    return jnp.stack(out)


def first_states(case, at_rest: bool) -> Float[Array, " 3p"]:
    """A start of the plenums.

    Args:
        case: cylinder and lines.
        at_rest: everything at the state of the suction line and without flow; else every plenum as its
            line, with a usual flow.
    """
    scales = chain_scales(case)
    fluid = case.cylinder.fluid
    suction = case.cylinder.suction.plenums
    discharge = case.cylinder.discharge.plenums
    states = []
    for i, plenum in enumerate((*suction, *discharge)):
        line = case.suction if i < len(suction) or at_rest else case.discharge
        if plenum.temperature is None:
            T = line.T
            rho = line.rho
        else:
            T = plenum.temperature
            rho = fluid.density(T, line.p)
        flow = jnp.asarray(0.0 if at_rest else 0.7)
        states += [rho * plenum.volume / scales.mass[i], T / scales.temperature, flow]
    if not states:
        return jnp.zeros(0)
    return jnp.stack(states)


class PassedGas(NamedTuple):
    """Gas that has passed the valves of one line in a revolution, of all cylinders together.

    Attributes:
        mass: [kg] forward less backward.
        back: [kg] backward.
        enthalpy: [J] carried forward, less that carried backward.
    """

    mass: Float[Array, ""]
    back: Float[Array, ""]
    enthalpy: Float[Array, ""]


def settled_states(
    case, state: Float[Array, " 3p"], passed: tuple[PassedGas, PassedGas]
) -> Float[Array, " 3p"]:
    r"""States of plenums whose gas has been exchanged as often as it takes, at the pressure they have.

    A volume of fifty strokes takes a hundred revolutions until its gas has the temperature at which as
    much enthalpy leaves as comes. Of a line at h, a suction plenum from which the valves take
    $m^+ h_p - m^- h^- = H$ has that with $m h = H$, a discharge plenum with $H = m h_p$:

    $$h_p' = h_p + \frac{m h - H}{m + m^-},\qquad h_p' = h_p + \frac{H - m h_p}{m + m^-}.$$

    Heat of walls and what the necks mix are left out: this is a start, no solution.

    Args:
        case: cylinder and lines.
        state: (3 p,) over its scales.
        passed: through the suction and the discharge valves.
    """
    columns = state.reshape(-1, PER_PLENUM)
    pair = chains(case, state)
    factors = []
    for chain, gas_passed in zip(pair, passed, strict=True):
        for plenum, gas in zip(chain.plenums, chain.gases, strict=True):
            leaving = case.suction.h if chain.inward else gas.h
            # enthalpy through the valves, less that of the same mass as the line brings it before
            # the suction valve, and as the plenum gives it away behind the discharge valve
            lack = gas_passed.enthalpy - gas_passed.mass * leaving
            rise = lack / maximum(
                gas_passed.mass + gas_passed.back, _LEAST_PASSED * case.mass_scale
            )
            if chain.inward:
                # warmer suction gas carries more away
                rise = -rise
            change = rise / (gas.c_p * gas.T)
            factor = 1 + clip(change, -_MOST_SETTLED, _MOST_SETTLED)
            if plenum.temperature is not None:
                factor = jnp.ones(())
            factors.append(factor)
    if not factors:
        return state
    factor = jnp.stack(factors)
    # at constant pressure a warmer plenum holds less gas, by about the same factor
    masses = columns[:, 0] / factor
    temperatures = columns[:, 1] * factor
    return jnp.stack([masses, temperatures, columns[:, 2]], axis=1).ravel()


def _gas(fluid: AbstractFluid, plenum: Plenum, mass, T) -> GasState:
    low, high = fluid.temperature_range
    temperature = plenum.temperature
    if temperature is None:
        temperature = clip(T, low, 2 * high)
    return fluid.state(temperature, maximum(mass / plenum.volume, 1e-9))


def _mixed(forward, a: GasState | Side, b: GasState | Side) -> "_Carried":
    def mix(x, y):
        return 0.5 * ((1 + forward) * x + (1 - forward) * y)

    return _Carried(mix(a.rho, b.rho), mix(a.h, b.h))


class _Carried(NamedTuple):
    """[kg/m^3] and [J/kg] of the gas that flows."""

    rho: Float[Array, ""]
    h: Float[Array, ""]
