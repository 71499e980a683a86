"""Pulsation of the lines of a cycle behind pipes: spectra, limits, shaking forces and losses."""

import dataclasses
from collections.abc import Iterator
from itertools import pairwise
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.declared import Record, computed, reading, word
from .._core.errors import BadInput
from .._core.extremes import max_of, maximum, min_of
from .._core.fields import is_any_traced
from .._core.results import Data, Result
from .._core.status import Status
from ..piping import Run, Vessel, flange_limit, line_limit, line_limit_of_approach_1
from ..piping._network import Network, steady_transfers, transfers
from ._cylinder import Case
from ._waves import LINES, Line, Observed, SideWaves, Waves, complex_of, lines_of, series_of

# Orders that have names of their own.
NAMED_ORDERS = 8
# Instants of a revolution for every harmonic at which extremes are looked for.
_INSTANTS = 24
# [-] Peak to peak over the pressure of the line beyond which waves are no longer small, and what the
# delivered flow is off there, in parts of its square: by Euler's equations, at most 0.35.
LARGE = 0.15
_ERROR = 0.35
# [-] Root of the slope of Bessel's function of order 1: the first wave across a round pipe.
_ACROSS = 1.8412
# [-] Mach number of the mean flow beyond which it carries the waves along.
FAST = 0.15


@dataclasses.dataclass(frozen=True)
class Limit(Record):
    """A limit of API 618 beside what it limits, peak to peak over the mean pressure.

    Attributes:
        place: name of the node.
        order: of the component; 0 for the unfiltered pulsation.
        value: [-]
        allowed: [-]
    """

    place: str = word()
    order: int = reading("")
    value: Float[Array, ""] = reading("")
    allowed: Float[Array, ""] = reading("")

    @computed("")
    def margin(self) -> Float[Array, ""]:
        """[-] What is allowed over what is."""
        return self.allowed / maximum(self.value, 1e-12)


class Pulsation(Result, eqx.Module):
    """Pulsation in the pipes of a solved cycle.

    Attributes:
        waves: at the flanges, over the pressure of the lines.
        flows: harmonics of what passes the flanges of each network.
        case: a cylinder as large as all together.
        phase: [rad] own angle of the first cylinder less the angle by which waves count their time; 0 of
            a cylinder alone.
    """

    waves: Waves
    flows: tuple[Observed, ...]
    case: Case
    phase: Float[Array, ""]

    flat: ClassVar[bool] = True

    @property
    def lines(self) -> list[tuple[int, Line, Observed]]:
        """Number, network and flows of every line that is one."""
        flows = iter(self.flows)
        return [
            (side, line, next(flows))
            for side, line in enumerate(lines_of(self.case))
            if line is not None
        ]

    def _name(self, side: int, node: str) -> str:
        """Name of a node, with its line where both are networks."""
        return f"{LINES[side]}.{node}" if len(self.flows) > 1 else node

    @eqx.filter_jit  # one program instead of a hundred and fifty
    def series(self) -> dict[str, Float[Array, " h"]]:
        """Series [Pa] of the pressure at every node, beyond that of its line: mean, cosines, sines."""
        series = {}
        for side, line, flows in self.lines:
            waves = self._waves_of_side(side)
            network, _, steady, dynamic = line.responses(waves)
            mean, amplitudes = line.ports(waves, flows)
            of_mean = steady.pressure @ mean
            of_waves = jnp.einsum("nrc,nc->rn", dynamic.pressure, amplitudes)
            rows = series_of(of_mean, of_waves)
            for node, row in zip(network.nodes, rows, strict=True):
                series[self._name(side, node)] = row
        return series

    def series_in_pipe(
        self, begin: str, end: str, distance: float | Float[Array, ""]
    ) -> Float[Array, " h"]:
        """Series [Pa] of the pressure at a place of a pipe, beyond that of its line.

        Args:
            begin, end: names of the nodes at its ends, as in `series`.
            distance: [m] of the place from the first of them.

        Raises:
            BadInput: no pipe from one to the other, or a place beyond its end.
        """
        place = self._pipe(begin, end)
        length = place.length
        is_known = not is_any_traced(distance, length)
        if is_known and not 0 <= float(distance) <= float(length) * (1 + 1e-12):
            bound = f">= 0 and <= {float(length):.6g} m, the pipe's"
            raise BadInput("distance", float(distance), bound)
        before_end = length - jnp.asarray(distance, float)
        if place.is_turned:
            before_end = jnp.asarray(distance, float)
        return self._series_before_end(place.line, place.number, before_end)

    @eqx.filter_jit
    def _series_before_end(self, number_of_line: int, number: int, before_end):
        """Series [Pa] at a place of a pipe, by its distance [m] from the end of the pipe."""
        side, line, flows = self.lines[number_of_line]
        waves = self._waves_of_side(side)
        network, gas, steady, dynamic = line.responses(waves)
        length = network.length[number]
        mean, amplitudes = line.ports(waves, flows)
        drag = line.drag(network, gas, waves.friction)
        # from the end of the pipe back to the place, by the transfer of the piece between: nothing
        # is solved again
        cut = eqx.tree_at(lambda n: n.length, network, network.length.at[number].set(before_end))
        share = before_end / length
        cut_drag = drag._replace(mean=drag.mean.at[number].multiply(share))
        behind = network.pipe_ends[number][1]

        def pressure(poles, response, ports):
            at_end = response.pressure[behind] @ ports
            flow = response.pipe_flow[number] @ ports
            return poles.forward[number] * at_end + poles.impedance[number] * flow

        def of_harmonic(order, response, ports):
            return pressure(transfers(cut, gas, 1j * order * line.speed, drag), response, ports)

        orders = jnp.arange(1.0, line.orders + 1)
        waves_there = jax.vmap(of_harmonic)(orders, dynamic, amplitudes)
        return series_of(pressure(steady_transfers(cut, gas, cut_drag), steady, mean), waves_there)

    def _pipe(self, begin: str, end: str) -> "_Pipe":
        """Place of a pipe among those of all lines."""
        pipes = []
        for number_of_line, (side, line, _) in enumerate(self.lines):
            number = 0
            for duct in line.piping.ducts:
                for gap, pair in enumerate(pairwise(duct.nodes)):
                    names = tuple(self._name(side, node) for node in pair)
                    pipes.append("-".join(names))
                    if names in ((begin, end), (end, begin)):
                        is_turned = names != (begin, end)
                        return _Pipe(number_of_line, number + gap, duct.length[gap], is_turned)
                number += len(duct.nodes) - 1
        raise BadInput("pipe", f"{begin}-{end}", "one of " + ", ".join(pipes))

    def _waves_of_side(self, side: int) -> SideWaves:
        """Waves of a network."""
        waves = self.waves[side]
        assert waves is not None
        return waves

    def over_revolution(self, node: str, tau: Float[Array, " n"]) -> Float[Array, " n"]:
        """Pressure [Pa] at a node, beyond that of its line.

        Args:
            node: its name.
            tau: [rad] time over a revolution, from the top dead centre of the first cylinder.
        """
        return values_of(self.series()[node], tau)

    def spectra(self) -> dict[str, Float[Array, " n"]]:
        """Amplitudes [Pa] of the harmonics at every node, from the first."""
        return _spectra(self.series())

    @computed("Pa", key="pulsation")
    def pressures(self) -> dict[str, Float[Array, ""]]:
        """[Pa] Peak to peak, mean and first orders at every node, by NODE.peak_to_peak and so on."""
        values = {}
        series = self.series()
        spectra = _spectra(series)
        for node, row in series.items():
            values[f"{node}.peak_to_peak"] = peak_to_peak(row)
            values[f"{node}.mean"] = row[0]
            for order in range(1, NAMED_ORDERS + 1):
                if order <= spectra[node].size:
                    values[f"{node}.order_{order}"] = spectra[node][order - 1]
        return values

    @property
    def limits(self) -> list[Limit]:
        """Limits of API 618: of the flanges unfiltered, of all other nodes component by component."""
        limits = []
        ratio = self.case.discharge.p / self.case.suction.p
        series = self.series()
        spectra = _spectra(series)
        for side, line, _ in self.lines:
            waves = self._waves_of_side(side)
            gas = line.gas(waves.temperature)
            network = line.network(gas)
            pressure = line.state.p
            flanges = [network.nodes[number] for number in network.flanges]
            for node in flanges:
                name = self._name(side, node)
                # API 618 counts in parts of the mean absolute pressure at the node, not of that in
                # the line
                value = peak_to_peak(series[name]) / (pressure + series[name][0])
                limits.append(Limit(name, 0, value, flange_limit(ratio)))
            for number, node in enumerate(network.nodes):
                if node in flanges or network.fixed[number]:
                    continue
                name = self._name(side, node)
                touching = [k for k, pair in enumerate(network.pipe_ends) if number in pair]
                # what counts is the line, and the vessel only where there is no other at its node
                pipes = [k for k in touching if k < line.piping.pipe_count]
                touching = pipes or touching
                diameter = max_of(network.diameter[np.array(touching, int)])
                mean = pressure + series[name][0]
                orders = min(NAMED_ORDERS, spectra[name].size)
                for order in range(1, orders + 1):
                    frequency = order * self.case.speed / (2 * np.pi)
                    allowed = line_limit(gas.sound_speed, mean, diameter, frequency)
                    # twice the amplitude, as the limit is one from peak to peak
                    value = 2 * spectra[name][order - 1] / mean
                    limits.append(Limit(name, order, value, allowed))
        return limits

    @property
    def approach_1(self) -> dict[str, Limit]:
        """Limit of approach 1 of API 618 in the lines, unfiltered, at every node behind the flanges."""
        limits = {}
        series = self.series()
        for side, line, _ in self.lines:
            for node in line.piping.nodes:
                name = self._name(side, node)
                if node in line.piping.flanges or node == "line":
                    continue
                mean = line.state.p + series[name][0]
                value = peak_to_peak(series[name]) / mean
                limits[name] = Limit(name, 0, value, line_limit_of_approach_1(mean))
        return limits

    @computed("", key="pulsation_margin")
    def margin(self) -> Float[Array, ""]:
        """[-] The least of all limits of API 618 over its value: below 1 one is exceeded."""
        return min_of(jnp.stack([limit.margin for limit in self.limits]))

    @computed("N", key="shaking")
    def shaking_forces(self) -> dict[str, Float[Array, ""]]:
        """[N] Amplitudes of the forces on runs of pipe and vessels, by RUN.order_1 and so on."""
        forces = {}
        for run, sizes in _spectra(self.shaking_series()).items():
            for order in range(1, min(NAMED_ORDERS, sizes.size) + 1):
                forces[f"{run}.order_{order}"] = sizes[order - 1]
        return forces

    def shaking_series(self) -> dict[str, Float[Array, " h"]]:
        """Series [N] of the force on every run and vessel, along it from its first end to its second."""
        forces = {}
        series = self.series()
        for side, line, _ in self.lines:
            waves = self._waves_of_side(side)
            network = line.network(line.gas(waves.temperature))
            piping = line.piping
            for name, element in zip(piping.run_names, piping.shaken, strict=True):
                area = _area_of(network, element)
                a, b = (series[self._name(side, node)] for node in element.ends)
                # bends and plates close a run at its ends: the pressure at its second one pushes
                # it forward
                forces[self._name(side, name)] = area * (b - a)
        return forces

    @computed("Pa", key="pressure_drop")
    def mean_drops(self) -> dict[str, Float[Array, ""]]:
        """[Pa] Mean loss of pressure between each flange and its line."""
        drops = {}
        series = self.series()
        for side, line, _ in self.lines:
            for node in line.piping.flanges:
                name = self._name(side, node)
                # a loss lowers the mean at a suction flange below that of its line, and raises it
                # at a discharge flange above it
                drops[name] = series[name][0] * (1.0 if side else -1.0)
        return drops

    @computed("", key="pulsation_resolution")
    def resolution(self) -> Float[Array, ""]:
        """[-] Last harmonic at the flanges over the largest: what a sharper edge would still add."""
        shares = []
        for side, _, _ in self.lines:
            waves = self._waves_of_side(side)
            _, amplitudes = complex_of(waves.pressure, (waves.pressure.shape[1] - 1) // 2)
            sizes = jnp.abs(amplitudes)
            shares.append(max_of(sizes[:, -1] / maximum(max_of(sizes, axis=1), 1e-30)))
        return max_of(jnp.stack(shares))

    @property
    @eqx.filter_jit
    def largest(self) -> Float[Array, ""]:
        """[-] Peak to peak at the flanges over the pressure of the line, the largest."""
        sizes = []
        for side, _, _ in self.lines:
            waves = self._waves_of_side(side)
            sizes += [peak_to_peak(row) for row in waves.pressure]
        return max_of(jnp.stack(sizes))

    @computed("", key="pulsation_linear_error")
    def linear_error(self) -> Float[Array, ""]:
        """[-] Estimate of the error of the flow because waves are not small."""
        return _ERROR * self.largest**2

    @property
    @eqx.filter_jit  # one program instead of a hundred
    def mach(self) -> Float[Array, ""]:
        """[-] Largest Mach number of the mean flow in any pipe."""
        numbers = []
        for side, line, flows in self.lines:
            waves = self._waves_of_side(side)
            network, gas, steady, _ = line.responses(waves)
            mean, _ = line.ports(waves, flows)
            flow = jnp.abs(steady.pipe_flow @ mean)
            numbers.append(max_of(flow / (gas.density * gas.sound_speed * network.area)))
        return max_of(jnp.stack(numbers))

    @property
    def status(self):
        """Whether the waves are within the range of their equations, as a `Status`.

        The cycle behind is solved all the same: `linear_error` estimates by how much its flow is off.
        """
        status = Status.converged
        # what stands last says most
        for outcome, exceeds in reversed(self._beyond().items()):
            status = Status.where(exceeds, getattr(Status, outcome), status)
        return status

    def _beyond(self) -> dict[str, Bool[Array, ""]]:
        """Whether the waves are beyond each range of their equations, the worst of them first."""
        return {"large_pulsation": self.largest > LARGE, "fast_flow": self.mach > FAST}

    @property
    def remarks(self) -> list[str]:
        """Where the model is beyond its range, in words; values only."""
        beyond = {
            "large_pulsation": (
                f"{float(self.largest):.0%} peak to peak at a flange; waves are linear here, which "
                f"may err by {float(self.linear_error):.1%} of the flow"
            ),
            "fast_flow": (
                f"Mach {float(self.mach):.2f} in a pipe; mean flow does not carry waves here"
            ),
        }
        words = []
        for outcome, exceeds in self._beyond().items():
            if bool(exceeds):
                words.append(f"{outcome}: {beyond[outcome]}")
        highest = self._highest_plane()
        orders = self.flows[0].heat.size // 2
        if highest < orders:
            words.append(
                f"beyond_plane_waves: from order {highest + 1} on waves across the widest pipe are "
                "possible, which are left out"
            )
        return [*words, *self._doubled()]

    def _doubled(self) -> Iterator[str]:
        """Remarks on volumes at a flange behind plenums, which may be one and the same."""
        cylinder = self.case.cylinder
        for side, line, _ in self.lines:
            plenums = (cylinder.suction, cylinder.discharge)[side].plenums
            if plenums and any(
                volume.node in line.piping.flanges for volume in line.piping.volumes
            ):
                yield (
                    f"doubled_volume: the {LINES[side]} line has plenums and a volume at the flange, "
                    "right behind their neck; take one away if they are the same"
                )

    def _highest_plane(self) -> int:
        """Highest order at which waves in all pipes are plane."""
        limits = []
        for side, line, _ in self.lines:
            waves = self._waves_of_side(side)
            gas = line.gas(waves.temperature)
            widest = max_of(line.network(gas).diameter)
            frequency = _ACROSS * gas.sound_speed / (np.pi * widest)
            limits.append(int(frequency * 2 * np.pi / self.case.speed))
        return min(limits)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield from self.members_of("pressures")
        yield from self.data_of("margin")
        yield from self.members_of("shaking_forces", "mean_drops")
        yield from self.data_of("resolution", "linear_error")


class _Pipe(NamedTuple):
    """Place of a pipe.

    Attributes:
        line: number of its line among those that are networks.
        number: of the pipe in the network.
        length: [m]
        is_turned: whether it runs the other way.
    """

    line: int
    number: int
    length: Float[Array, ""]
    is_turned: bool


def _waves_of(series: Float[Array, " h"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Cosines and sines of a series, without its mean."""
    orders = (series.size - 1) // 2
    return series[1 : 1 + orders], series[1 + orders :]


def values_of(series: Float[Array, " h"], tau: Float[Array, " n"]) -> Float[Array, " n"]:
    """Values of a series at instants.

    Args:
        series: mean, cosines and sines.
        tau: [rad] time over a revolution.
    """
    cosine, sine = _waves_of(series)
    angle = jnp.arange(1, cosine.size + 1) * tau[:, None]
    return series[0] + jnp.cos(angle) @ cosine + jnp.sin(angle) @ sine


def _spectra(series: dict[str, Float[Array, " h"]]) -> dict[str, Float[Array, " n"]]:
    """Amplitudes of the harmonics of every series, from the first."""
    spectra = {}
    for name, row in series.items():
        cosine, sine = _waves_of(row)
        # double where: the root has no slope at zero, as of odd orders of two cylinders
        square = cosine**2 + sine**2
        some = square > 0
        spectra[name] = jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0)
    return spectra


def peak_to_peak(series: Float[Array, " h"]) -> Float[Array, ""]:
    """Highest less lowest value of a series over a revolution."""
    cosine, sine = _waves_of(series)
    orders = cosine.size
    # an extreme between two instants is missed by less than 1 % of the highest harmonic, and by
    # far less of the others
    tau = 2 * np.pi * np.arange(_INSTANTS * orders) / (_INSTANTS * orders)
    # a table of numbers, which is no part of a program
    angle = np.arange(1, orders + 1) * tau[:, None]
    values = np.cos(angle) @ cosine + np.sin(angle) @ sine
    return max_of(values) - min_of(values)


def _area_of(network: Network, element: Run | Vessel) -> Float[Array, ""]:
    """[m^2] Area of the straight piece that a run or vessel is."""
    if isinstance(element, Vessel):
        return np.pi / 4 * element.diameter[0] ** 2
    first, second = (network.nodes.index(node) for node in element.nodes)
    return network.area[_pipe_of_run(network.pipe_ends, first, second)]


def _pipe_of_run(pipe_ends, first: int, second: int) -> int:
    """The pipe whose area a run has: the one that joins both nodes, or the first at its beginning."""
    for number, pair in enumerate(pipe_ends):
        if {first, second} == set(pair):
            return number
    for number, pair in enumerate(pipe_ends):
        if first in pair:
            return number
    return 0
