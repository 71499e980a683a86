"""The equations of a network: pressures of nodes and flows of pipes and orifices at one frequency.

Rows are the first equation of every pipe, the law of every orifice and the balance of mass of every
node, so that nothing is divided by a hyperbolic sine: a pipe of half a wave is like any other. All pipes
are one array, so that the program does not grow with the network.
"""

from functools import partial
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.extremes import max_of, maximum
from .._core.fields import is_any_traced, known_values
from ._gas import PipeGas
from ._piping import LINE, Piping
from .pipe import FourPole, WaveLine, attenuated_line, four_pole, walled_line


class Drag(NamedTuple):
    """Turbulent friction of pipes without a given attenuation.

    Attributes:
        mean: [Pa s/kg] (p,) mean pressure drop over mean flow.
        slope: [Pa s/(kg m)] (p,) of Darcy's law at the mean flow, over the length.
    """

    mean: Float[Array, " p"]
    slope: Float[Array, " p"]


class Network(eqx.Module):
    """Network as arrays.

    Attributes:
        nodes: names of the n nodes.
        flanges: which of them are at valves.
        pipe_ends: (p, 2) node at which each pipe begins and ends.
        orifice_ends: (o, 2) of each orifice.
        fixed: (n,) whether the pressure of a node is given.
        anechoic: (n,) whether a node goes on as a pipe without end.
        attenuated: (p,) whether a pipe has a given attenuation.
        linear: (o,) whether the loss of an orifice is proportional to its flow.
        length, diameter, roughness, attenuation: [m] and [1/m] (p,).
        volume: [m^3] (n,)
        resistance: [Pa s/kg] (o,) of the orifices; of those with a square law the one about which it is
            written.
        square: [Pa s^2/kg^2] (o,) of their square law, 0 where linear.
    """

    nodes: tuple[str, ...] = eqx.field(static=True)
    flanges: tuple[int, ...] = eqx.field(static=True)
    pipe_ends: tuple[tuple[int, int], ...] = eqx.field(static=True)
    orifice_ends: tuple[tuple[int, int], ...] = eqx.field(static=True)
    fixed: tuple[bool, ...] = eqx.field(static=True)
    anechoic: tuple[bool, ...] = eqx.field(static=True)
    attenuated: tuple[bool, ...] = eqx.field(static=True)
    linear: tuple[bool, ...] = eqx.field(static=True)
    length: Float[Array, " p"]
    diameter: Float[Array, " p"]
    roughness: Float[Array, " p"]
    attenuation: Float[Array, " p"]
    volume: Float[Array, " n"]
    resistance: Float[Array, " o"]
    square: Float[Array, " o"]

    @property
    def area(self) -> Float[Array, " p"]:
        """[m^2] of the pipes."""
        return np.pi / 4 * self.diameter**2

    @property
    def rough(self) -> tuple[int, ...]:
        """Which pipes have turbulent friction."""
        numbers = []
        for number, is_attenuated in enumerate(self.attenuated):
            if not is_attenuated:
                numbers.append(number)
        return tuple(numbers)

    @property
    def nonlinear(self) -> tuple[int, ...]:
        """Which orifices have a square law."""
        numbers = []
        for number, is_linear in enumerate(self.linear):
            if not is_linear:
                numbers.append(number)
        return tuple(numbers)

    @property
    def size(self) -> int:
        """Number of unknowns at a frequency."""
        return len(self.nodes) + len(self.pipe_ends) + len(self.orifice_ends)


def network_of(piping: Piping, gas: PipeGas, usual_flow: Float[Array, ""] | float = 0.0) -> Network:
    """Network of a machine.

    Args:
        piping: its elements.
        gas: in it, for the density at orifices.
        usual_flow: [kg/s] about which the square law of orifices is written; 0 leaves a lossless hole.
    """
    nodes = piping.nodes
    at = {name: number for number, name in enumerate(nodes)}
    tools = jnp
    if not is_any_traced(piping, gas, usual_flow):
        # known numbers are put together by NumPy, which compiles nothing
        tools = np
        piping = known_values(piping)
    pipe_ends = []
    attenuated = []
    for duct in piping.ducts:
        gaps = list(pairwise(at[name] for name in duct.nodes))
        pipe_ends += gaps
        attenuated += [duct.attenuation is not None] * len(gaps)
    ends = {end.node: end.kind for end in piping.ends}

    def column(name):
        parts = []
        for duct in piping.ducts:
            values = getattr(duct, name)
            if values is None:
                values = tools.zeros_like(duct.length)
            parts.append(values)
        return tools.concatenate(parts)

    diameter = column("diameter")
    volumes = [np.zeros(())] * len(nodes)
    for element in piping.volumes:
        number = at[element.node]
        volumes[number] = volumes[number] + element.volume
    orifice_ends = []
    for orifice in piping.orifices:
        first, second = orifice.nodes
        orifice_ends.append((at[first], at[second]))
    resistance, square = _orifice_laws(piping, gas, usual_flow, pipe_ends, orifice_ends, diameter)
    fixed = []
    anechoic = []
    for name in nodes:
        fixed.append(name == LINE or ends.get(name) == "open")
        anechoic.append(ends.get(name) == "anechoic")
    return Network(
        nodes=nodes,
        flanges=tuple(at[name] for name in piping.flanges),
        pipe_ends=tuple(pipe_ends),
        orifice_ends=tuple(orifice_ends),
        fixed=tuple(fixed),
        anechoic=tuple(anechoic),
        attenuated=tuple(attenuated),
        linear=tuple(orifice.is_linear for orifice in piping.orifices),
        length=jnp.asarray(column("length")),
        diameter=jnp.asarray(diameter),
        roughness=jnp.asarray(column("roughness")),
        attenuation=jnp.asarray(column("attenuation")),
        volume=_stacked(volumes, tools),
        resistance=_stacked(resistance, tools),
        square=_stacked(square, tools),
    )


def _orifice_laws(
    piping: Piping, gas: PipeGas, usual_flow, pipe_ends, orifice_ends, diameter
) -> tuple[list, list]:
    """Resistances [Pa s/kg] and factors of square laws [Pa s^2/kg^2] of all orifices.

    Args:
        piping: its elements.
        gas: in it, for its density.
        usual_flow: [kg/s] about which square laws are written.
        pipe_ends, orifice_ends: numbers of the nodes of each pipe and orifice.
        diameter: [m] of the pipes.
    """
    resistances = []
    squares = []
    for orifice, ends in zip(piping.orifices, orifice_ends, strict=True):
        if orifice.is_linear:
            resistances.append(orifice.resistance)
            squares.append(np.zeros(()))
            continue
        # without a pipe beside it a hole counts as in a vessel
        pipe_diameter = 1e3 * orifice.diameter
        adjacent = _adjacent_pipes(pipe_ends, ends)
        if adjacent:
            pipe_diameter = max_of(diameter[np.array(adjacent)])
        coefficient = orifice.coefficient(gas.density, pipe_diameter)
        # the slope of c q |q| at the usual flow: by it, and not by the chord, a pulsation is damped that
        # is small beside the mean
        resistances.append(2 * coefficient * usual_flow)
        squares.append(coefficient)
    return resistances, squares


def _adjacent_pipes(pipe_ends, nodes: tuple[int, int]) -> list[int]:
    """Numbers of the pipes that meet one of two nodes."""
    touching = set(nodes)
    adjacent = []
    for number, ends in enumerate(pipe_ends):
        if touching & set(ends):
            adjacent.append(number)
    return adjacent


def _stacked(numbers: list, tools) -> Float[Array, " o"]:
    """Scalars as one array, which is empty without any."""
    if not numbers:
        return jnp.zeros(0)
    return jnp.asarray(tools.stack(numbers))


# [1/m] Least resistance to the mean flow over length and impedance of a wave, in the ratio of inertances.
_LEAST_DRAG = 1e-9


def no_drag(network: Network) -> Drag:
    """Friction of a network without mean flow."""
    none = jnp.zeros_like(network.length)
    return Drag(none, none)


def wave_line(network: Network, gas: PipeGas, s, drag: Drag) -> WaveLine:
    """Line constants of all pipes at s [1/s], which is not zero."""
    has_attenuation = np.array(network.attenuated)
    if has_attenuation.all():
        return attenuated_line(gas, network.diameter, network.attenuation, s)
    walled = walled_line(gas, network.diameter, s)
    walled = walled._replace(series=walled.series + drag.slope)
    if not has_attenuation.any():
        return walled
    with_attenuation = attenuated_line(gas, network.diameter, network.attenuation, s)
    return jax.tree.map(lambda a, b: jnp.where(has_attenuation, a, b), with_attenuation, walled)


def transfers(network: Network, gas: PipeGas, s, drag: Drag) -> FourPole:
    """Transfer through every pipe at s [1/s], which is not zero."""
    return four_pole(wave_line(network, gas, s, drag), network.length)


def steady_transfers(network: Network, gas: PipeGas, drag: Drag) -> FourPole:
    """Transfer of the mean: friction alone, but where an attenuation is given, its limit.

    The losses of walls would be those of laminar flow there.
    """
    attenuated = np.array(network.attenuated)
    angle = jnp.where(attenuated, network.attenuation * network.length, 0.0)
    impedance = gas.sound_speed / network.area
    friction = jnp.where(attenuated, impedance * jnp.sinh(angle), drag.mean)
    # of a loop without losses the flow would divide in any way: this is its limit at low frequencies
    return FourPole(
        jnp.cosh(angle),
        maximum(friction, _LEAST_DRAG * network.length * impedance),
        jnp.sinh(angle) / impedance,
    )


def flow_scale(network: Network, gas: PipeGas) -> Float[Array, ""]:
    """[kg/(s Pa)] Admittance of the widest pipe, by which flows and pressures are of one size."""
    return max_of(network.area) / gas.sound_speed


def tableau(network: Network, gas: PipeGas, s, poles: FourPole, is_steady: bool = False):
    """Matrix of the equations, with flows over `flow_scale`.

    Args:
        network: as arrays.
        gas: in it.
        s: [1/s]
        poles: transfer through its pipes at s.
        is_steady: whether these are the equations of the mean, where a pipe without end has the
            pressure of the line.

    Returns:
        (m, m) for the pressures of the nodes, then the flows out of the pipes, then those of orifices.
    """
    nodes = len(network.nodes)
    scale = flow_scale(network, gas)
    identity = np.eye(nodes)
    pipe_ends = np.array(network.pipe_ends, int).reshape(-1, 2)
    orifice_ends = np.array(network.orifice_ends, int).reshape(-1, 2)
    begin = identity[pipe_ends[:, 0]]
    end = identity[pipe_ends[:, 1]]
    first = identity[orifice_ends[:, 0]]
    second = identity[orifice_ends[:, 1]]
    orifices = orifice_ends.shape[0]
    pipes = pipe_ends.shape[0]
    # what a volume takes up, V/a^2 dp/dt
    stored = s * network.volume / gas.sound_speed**2
    if not is_steady:
        # one pipe meets an end: the wave goes on in it
        meeting = begin.T + end.T
        stored = stored + np.array(network.anechoic) * (meeting @ network.area) / gas.sound_speed
    fixed = np.array(network.fixed) | (np.array(network.anechoic) & is_steady)
    balanced = jnp.asarray(~fixed[:, None], float)
    balance = begin.T @ (poles.admittance[:, None] / scale * end) + jnp.diag(stored / scale)
    # Pipes: the pressure at the beginning from pressure and flow at the end. Orifices: their drop.
    # Nodes: what flows in from all sides, or zero where the pressure is that of the line.
    rows = [
        [
            begin - poles.forward[:, None] * end,
            -jnp.diag(poles.impedance * scale),
            np.zeros((pipes, orifices)),
        ],
        [first - second, np.zeros((orifices, pipes)), -jnp.diag(network.resistance * scale)],
        [
            balanced * balance + np.diag(1.0 * fixed),
            balanced * (begin.T * poles.forward - end.T),
            balanced * (first - second).T,
        ],
    ]
    return jnp.block([list(map(jnp.asarray, row)) for row in rows])


class Response(NamedTuple):
    """Response of a network to its ports at one frequency: q flanges, then o square orifices.

    A flange puts in 1 kg/s, an orifice adds 1 Pa to its pressure drop.

    Attributes:
        pressure: [Pa] (n, q + o) of nodes.
        pipe_flow: [kg/s] (p, q + o) out of the end of each pipe.
        orifice_flow: [kg/s] (all orifices, q + o)
    """

    pressure: Complex[Array, "n c"]
    pipe_flow: Complex[Array, "p c"]
    orifice_flow: Complex[Array, "o c"]


def _ports(network: Network, scale) -> Array:
    """Right sides of all ports."""
    nodes = len(network.nodes)
    pipes = len(network.pipe_ends)
    flanges = np.zeros((network.size, len(network.flanges)))
    flanges[network.size - nodes + np.array(network.flanges), np.arange(len(network.flanges))] = 1
    drops = np.zeros((network.size, len(network.nonlinear)))
    for column, number in enumerate(network.nonlinear):
        drops[pipes + number, column] = 1
    return jnp.concatenate([flanges / scale, jnp.asarray(drops)], axis=1)


def _solved(network: Network, gas: PipeGas, matrix) -> Response:
    scale = flow_scale(network, gas)
    # all ports at once: the matrix is factorised once a frequency
    ports = _ports(network, scale).astype(matrix.dtype)
    unknowns = jnp.linalg.solve(matrix, ports)
    nodes = len(network.nodes)
    pipes = len(network.pipe_ends)
    return Response(
        unknowns[:nodes],
        unknowns[nodes : nodes + pipes] * scale,
        unknowns[nodes + pipes :] * scale,
    )


def response(network: Network, gas: PipeGas, s: Complex[Array, ""], drag: Drag) -> Response:
    """Response at s [1/s], which is not zero."""
    return _solved(network, gas, tableau(network, gas, s, transfers(network, gas, s, drag)))


def steady_response(network: Network, gas: PipeGas, drag: Drag) -> Response:
    """Response of the mean."""
    poles = steady_transfers(network, gas, drag)
    return _solved(network, gas, tableau(network, gas, 0.0, poles, is_steady=True))


def harmonic_responses(
    network: Network, gas: PipeGas, speed: Float[Array, ""], orders: int, drag: Drag
) -> Response:
    """Responses at harmonics 1 to `orders` of a speed [rad/s], with an axis of them."""
    s = 1j * speed * jnp.arange(1, orders + 1)
    return jax.vmap(lambda s: response(network, gas, s, drag))(s)


@jax.jit  # one program instead of fifty
def impedances(
    network: Network, gas: PipeGas, frequency: Float[Array, " f"]
) -> Complex[Array, "f q q"]:
    """Impedances [Pa s/kg] between the flanges of a network.

    Args:
        network: of `network_of`.
        gas: in it.
        frequency: [Hz] above zero.

    Returns:
        Pressure at each flange for the flow that is put in at each other one.
    """
    flanges = np.array(network.flanges)
    drag = no_drag(network)

    def at(frequency):
        of_ports = response(network, gas, 2j * np.pi * frequency, drag)
        return of_ports.pressure[flanges, : flanges.size]

    return jax.vmap(at)(jnp.asarray(frequency))


@partial(jax.jit, static_argnames="source")
def pressures_at_nodes(
    network: Network, gas: PipeGas, frequency: Float[Array, " f"], source: int = 0
) -> Complex[Array, "f n"]:
    """Pressures [Pa] of all nodes for a flow of 1 kg/s that is put in at a flange.

    Args:
        network: of `network_of`.
        gas: in it.
        frequency: [Hz] above zero.
        source: number of the flange.
    """
    drag = no_drag(network)

    def at(frequency):
        return response(network, gas, 2j * np.pi * frequency, drag).pressure[:, source]

    return jax.vmap(at)(jnp.asarray(frequency))
