r"""Waves in the pipes behind the flanges: harmonics of pressure and flow, and what networks answer.

The pressure at a flange is that of its line and a series in time, $\tau = \Omega t$,

$$p(\tau) = p_{line}\left(1 + c_0 + \sum_n a_n\cos n\tau + b_n\sin n\tau\right),$$

its gas isentropic about the line. The series are unknowns; a network gives them back from the flow
through the valves.
"""

from functools import cache
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.extremes import maximum, minimum
from .._core.polynomials import cubic_step
from ..fluid import GasState
from ..piping import PipeGas, Piping, network_of, pipe_gas
from ..piping._network import Drag, Network, harmonic_responses, steady_response
from ..piping.pipe import friction_factor, turbulent_share
from ..valve._flow import Side, enthalpy_drop
from ._cylinder import Case, Cylinder

# [-] of the line's pressure, below which an iterate is not followed.
_LEAST = 0.05
# Instants of a revolution for every harmonic at which square laws are looked at.
_INSTANTS = 6
# The same at which a march finds the pressures, with cubics between: 4e-6 of the last harmonic.
_SAMPLES = 32
_TINY = 1e-9
# Names of the lines, by the number of their side.
LINES = ("suction", "discharge")


class SideWaves(NamedTuple):
    """Unknowns of a network.

    Attributes:
        pressure: [-] (f, 2 N + 1) of each flange over that of the line, less one.
        drops: [-] (o, 2 N + 1) of each orifice with a square law, beyond its linear part, over the same.
        temperature: [-] (1,) of the gas over that in the line, where it follows from the flow; else (0,).
        friction: [-] (2, p) mean flow and mean square of the flow in pipes with turbulent friction, over
            a usual flow.
    """

    pressure: Float[Array, "f h"]
    drops: Float[Array, "o h"]
    temperature: Float[Array, " t"]
    friction: Float[Array, "2 p"]


# of the suction and of the discharge line
Waves = tuple[SideWaves | None, SideWaves | None]


def pipings(cylinder: Cylinder) -> tuple[Piping | None, Piping | None]:
    """Networks of suction and discharge line."""
    return cylinder.suction.piping, cylinder.discharge.piping


def is_piped(cylinder: Cylinder) -> bool:
    """Whether any line is a network of pipes."""
    return any(piping is not None for piping in pipings(cylinder))


def sides_of(cylinder: Cylinder) -> tuple[int, ...]:
    """Numbers of the lines that are networks: 0 suction, 1 discharge."""
    return tuple(side for side, piping in enumerate(pipings(cylinder)) if piping is not None)


def orders_of(cylinder: Cylinder) -> int:
    """Harmonics of all networks: the most that any has."""
    return max(piping.orders for piping in pipings(cylinder) if piping is not None)


def flange_numbers(piping: Piping, count: int) -> np.ndarray:
    """Flange of each of `count` cylinders or ends: one of all, of each, or of both ends of a cylinder."""
    return np.arange(count) // (count // len(piping.flanges))


def has_own_temperature(cylinder: Cylinder, side: int) -> bool:
    """Whether the temperature of the gas in a network is an unknown: that of the gas delivered."""
    piping = pipings(cylinder)[side]
    return side == 1 and piping is not None and piping.follows_delivery


def waves_at_rest(cylinder: Cylinder) -> Waves:
    """Waves before the first round: none."""
    orders = orders_of(cylinder)
    sides = []
    for side, piping in enumerate(pipings(cylinder)):
        if piping is None:
            sides.append(None)
            continue
        squares = sum(not orifice.is_linear for orifice in piping.orifices)
        rough = sum(len(p.nodes) - 1 for p in piping.ducts if p.attenuation is None)
        waves = SideWaves(
            pressure=jnp.zeros((len(piping.flanges), 2 * orders + 1)),
            drops=jnp.zeros((squares, 2 * orders + 1)),
            temperature=jnp.ones(int(has_own_temperature(cylinder, side))),
            friction=jnp.ones((2, rough)),
        )
        sides.append(waves)
    return sides[0], sides[1]


def side_at(line: Side, ratio: Float[Array, ""]) -> Side:
    """The gas at a flange whose pressure is `ratio` of that in the line, isentropic about it."""
    ratio = maximum(ratio, _LEAST)
    # with kappa of the line: the flanges need no equation of state at every instant
    rise = -line.p / line.rho * enthalpy_drop(line.kappa, ratio)
    density = line.rho * ratio ** (1 / line.kappa)
    return line._replace(p=line.p * ratio, rho=density, h=line.h + rise)


@cache
def _instants(orders: int) -> tuple[np.ndarray, np.ndarray]:
    """Series to values at instants of a revolution, and back."""
    count = _INSTANTS * orders
    tau = 2 * np.pi * np.arange(count) / count
    multiples = np.arange(1, orders + 1) * tau[:, None]
    values = np.concatenate([np.ones((count, 1)), np.cos(multiples), np.sin(multiples)], axis=1)
    # by the trapezoidal rule, which is exact for these harmonics on even instants
    back = 2 * values.T / count
    back[0] /= 2
    return values, back


def complex_of(series: Float[Array, "*f h"], orders: int):
    """Mean and complex amplitudes (..., N) of series, for e^{i n tau}."""
    parts = series[..., 1:]
    # a cos + b sin is the real part of (a - i b) e^{i n tau}
    return series[..., 0], parts[..., :orders] - 1j * parts[..., orders:]


def series_of(mean, amplitudes) -> Float[Array, "*f h"]:
    """The series of a mean and of complex amplitudes."""
    return jnp.concatenate([mean[..., None], amplitudes.real, -amplitudes.imag], axis=-1)


def slope_of(series: Float[Array, "*f h"]) -> Float[Array, "*f h"]:
    """The series of what a series changes by over its angle."""
    orders = series.shape[-1] // 2
    numbers = np.arange(1.0, orders + 1)
    cosine = series[..., 1 : 1 + orders]
    sine = series[..., 1 + orders :]
    # a cos n tau + b sin n tau has the slope n b cos n tau - n a sin n tau
    return jnp.concatenate([0 * series[..., :1], numbers * sine, -numbers * cosine], axis=-1)


class Samples(NamedTuple):
    """Series at even instants of a revolution.

    Attributes:
        values: (f, m)
        slopes: (f, m) over the angle.
    """

    values: Float[Array, "f m"]
    slopes: Float[Array, "f m"]

    def at(self, tau: Float[Array, ""]) -> Float[Array, " f"]:
        """Values at an angle, by cubics through values and slopes."""
        count = self.values.shape[1]
        gap = 2 * np.pi / count
        place = jnp.mod(tau, 2 * np.pi) / gap
        number = minimum(place.astype(int), count - 1)
        around = jnp.stack([number, (number + 1) % count])
        ends = self.values[:, around].T
        slopes = self.slopes[:, around].T
        return cubic_step(place - number, gap, ends, slopes)


def sampled(series: Float[Array, "f h"]) -> Samples:
    """Samples of series, for a march, which asks for them at many thousand angles."""
    orders = series.shape[-1] // 2
    mean, amplitudes = complex_of(jnp.stack([series, slope_of(series)]), orders)
    # a real transform back has the other half of every amplitude at the negative frequency, and
    # divides by the number of values
    spectrum = jnp.concatenate([mean[..., None], amplitudes / 2], axis=-1)
    count = _SAMPLES * orders
    values, slopes = count * jnp.fft.irfft(spectrum, n=count, axis=-1)
    return Samples(values, slopes)


class Observed(NamedTuple):
    """Harmonics of what passes a network's flanges.

    Attributes:
        flow: [kg/s] (f, 2 N + 1) through each flange, forward.
        heat: [W] (2 N + 1,) of enthalpy with it.
    """

    flow: Float[Array, "f h"]
    heat: Float[Array, " h"]


class Line(eqx.Module):
    """A network with its gas, as the equations of its waves.

    Attributes:
        cylinder: gas side of all cylinders.
        side: 0 suction, 1 discharge.
        state: the gas in the line.
        comes: the gas as it comes, or in the line.
        speed: [rad/s]
        usual_flow: [kg/s] of a full cylinder a revolution.
        orders: harmonics of all networks.
    """

    cylinder: Cylinder
    side: int = eqx.field(static=True)
    state: GasState
    comes: GasState
    speed: Float[Array, ""]
    usual_flow: Float[Array, ""]
    orders: int = eqx.field(static=True)

    @property
    def piping(self) -> Piping:
        """Its elements."""
        piping = pipings(self.cylinder)[self.side]
        assert piping is not None
        return piping

    def gas(self, temperature: Float[Array, " t"]) -> PipeGas:
        """The gas in its pipes."""
        fluid = self.cylinder.fluid
        state = self.comes
        if self.piping.temperature is not None or temperature.size:
            T = self.piping.temperature
            if temperature.size:
                T = temperature[0] * self.state.T
            state = fluid.state(T, fluid.density(T, self.state.p))
        return pipe_gas(fluid, state)

    def network(self, gas: PipeGas) -> Network:
        """Its pipes as arrays."""
        return network_of(self.piping, gas, self.usual_flow)

    def drag(self, network: Network, gas: PipeGas, friction: Float[Array, "2 p"]) -> Drag:
        """Turbulent friction at mean flows and mean squares of flows."""
        rough = np.array(network.rough, int)
        mean = jnp.zeros(network.length.shape)
        slope = jnp.zeros(network.length.shape)
        if not rough.size:
            return Drag(mean, slope)
        flow = friction[0] * self.usual_flow
        # rounded off at no flow, where a Reynolds number of zero would have no friction factor
        size = jnp.sqrt(flow**2 + (_TINY * self.usual_flow) ** 2)
        square = friction[1] * self.usual_flow**2
        diameter = network.diameter[rough]
        area = network.area[rough]
        reynolds = 4 * size / (np.pi * diameter * gas.viscosity)
        factor = friction_factor(reynolds, network.roughness[rough] / diameter)
        law = factor / (gas.density * area**2 * diameter)
        # laminar friction is that of the walls, which the waves have already
        turbulent = turbulent_share(reynolds) * law * size
        # the mean drop goes with the mean of m|m|, which pulsation raises above that of the mean
        # flow
        drop = law / 2 * maximum(square, size**2) / size * network.length[rough]
        return Drag(mean.at[rough].set(drop), slope.at[rough].set(turbulent))

    @property
    def is_fixed(self) -> bool:
        """Whether the responses are the same for all waves: known gas and attenuation."""
        has_friction = any(duct.attenuation is None for duct in self.piping.ducts)
        return not (has_friction or has_own_temperature(self.cylinder, self.side))

    def responses(self, waves: SideWaves):
        """Network, gas and its responses, of the mean and of the harmonics."""
        gas = self.gas(waves.temperature)
        network = self.network(gas)
        drag = self.drag(network, gas, waves.friction)
        steady = steady_response(network, gas, drag)
        return network, gas, steady, harmonic_responses(network, gas, self.speed, self.orders, drag)

    def ports(self, waves: SideWaves, observed: Observed):
        """Mean and harmonics of what is put in at the ports, (c,) and (N, c)."""
        # at a flange the discharge valves put gas into their network, suction valves take it out
        # of theirs
        sign = 1.0 if self.side else -1.0
        mean, amplitudes = complex_of(sign * observed.flow, self.orders)
        mean_drop, drops = complex_of(waves.drops * self.state.p, self.orders)
        return jnp.concatenate([mean, mean_drop]), jnp.concatenate([amplitudes, drops]).T

    def answer_of(self, responses, waves: SideWaves, observed: Observed) -> SideWaves:
        """Waves that known responses of the network make of its flows."""
        network, _, steady, dynamic = responses
        mean, amplitudes = self.ports(waves, observed)
        flanges = np.array(network.flanges)

        def through(name, rows):
            of_mean = getattr(steady, name)[rows] @ mean
            of_waves = jnp.einsum("nrc,nc->rn", getattr(dynamic, name)[:, rows], amplitudes)
            return series_of(of_mean, of_waves)

        pressure = through("pressure", flanges) / self.state.p
        drops = waves.drops
        if network.nonlinear:
            holes = np.array(network.nonlinear)
            values, back = map(jnp.asarray, _instants(self.orders))
            flow = values @ through("orifice_flow", holes).T
            # products of harmonics, so at instants; the linear part is among the responses already
            beyond = network.square[holes] * flow * jnp.abs(flow)
            drops = (back @ (beyond - network.resistance[holes] * flow)).T / self.state.p
        friction = waves.friction
        if network.rough:
            rough = np.array(network.rough)
            series = through("pipe_flow", rough)
            values, _ = map(jnp.asarray, _instants(self.orders))
            flow = (values @ series.T) / self.usual_flow
            # the mean of m|m|, to whose drop fluctuations about the mean flow add
            square = jnp.abs(jnp.mean(flow * jnp.abs(flow), axis=0))
            friction = jnp.stack([series[:, 0] / self.usual_flow, square])
        temperature = waves.temperature
        if temperature.size:
            # where nothing is delivered the gas is that of the line; double where for the quotient
            delivered = jnp.sum(observed.flow[:, 0])
            flows = delivered > _TINY * self.usual_flow
            carried = observed.heat[0] / jnp.where(flows, delivered, 1.0)
            enthalpy = jnp.where(flows, carried, self.state.h)
            T = self.cylinder.fluid.at_enthalpy(self.state.p, enthalpy, self.state).T
            temperature = (T / self.state.T)[None]
        return SideWaves(pressure, drops, temperature, friction)


def lines_of(shared: Case) -> tuple[Line | None, Line | None]:
    """The networks of a machine.

    Args:
        shared: a cylinder as large as all together.
    """
    cylinder = shared.cylinder
    usual = shared.mass_scale * shared.speed / (2 * jnp.pi)
    built = []
    for side, piping in enumerate(pipings(cylinder)):
        state = (shared.suction, shared.discharge)[side]
        # suction pipes have the gas before it is heated on its way to the valve
        comes = (shared.comes, shared.discharge)[side]
        line = Line(cylinder, side, state, comes, shared.speed, usual, orders_of(cylinder))
        built.append(None if piping is None else line)
    return built[0], built[1]
