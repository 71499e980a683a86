"""The periodic state of the crank: its energy account and its evidence."""

from collections.abc import Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from .._core.declared import held, reading, word
from .._core.exported import kept_jit
from .._core.extremes import max_of, maximum, min_of, minimum
from .._core.fields import replaced
from .._core.polynomials import gauss
from .._core.registry import Quantity, offered_values, registered
from .._core.results import Data, Result
from .._core.status import Status
from ..compressor import Compressor
from ..cylinder import Cycle
from ..cylinder._several import SeveralCycles
from ..friction import JointLoads
from ..mechanism import CrankState
from ._panels import farthest, highest

# [-] Work of a revolution over that of the torque's size below which it is rounding.
_NO_WORK = 1e-12


class Energy(eqx.Module):
    """Work over one revolution [J] (Tsuji et al. 2012, Eqs 2, 3 and 5).

    Attributes:
        motor_work: [J] put in by the motor.
        gas_work: [J] taken by the gas.
        losses: [J] by joint.
    """

    motor_work: Float[Array, ""]
    gas_work: Float[Array, ""]
    losses: dict[str, Float[Array, ""]]

    @property
    def total_loss(self) -> Float[Array, ""]:
        """[J]"""
        return sum(self.losses.values(), start=jnp.zeros(()))

    @property
    def mechanical_efficiency(self) -> Float[Array, ""]:
        """[-] gas work over motor work."""
        return self.gas_work / _nonzero(self.motor_work)

    @property
    def residual(self) -> Float[Array, ""]:
        """[-] motor work that is neither gas work nor loss, over the larger of them."""
        size = maximum(jnp.abs(self.motor_work), jnp.abs(self.gas_work) + self.total_loss)
        return (self.motor_work - self.gas_work - self.total_loss) / _nonzero(size)


class Verification(eqx.Module):
    """Errors of an orbit by an independent march of one revolution from the found state.

    All errors are those of the march less those of the orbit, so that the orbit is off by as much
    with the opposite sign, as far as the march itself is exact.

    Attributes:
        speed_error: [-] largest difference of the speeds at the orbit's nodes over the mean speed.
        closure: [-] speed after the revolution less that before it, over the mean speed.
        period_error: [-] of the revolution's duration, relative.
        efficiency_error: [-] of the mechanical efficiency.
        loss_error: [J] of the losses of a revolution, by joint.
        gas_work_error: [J] of the work of gas and weights.
        peak_error: [N] of the peak forces, by joint.
        position_error: [-] largest difference of the positions of moving journals; `None` without any.
        steps: of the integrator.
        status: `Status.converged` if the march reached the end of the revolution.
    """

    speed_error: Float[Array, ""]
    closure: Float[Array, ""]
    period_error: Float[Array, ""]
    efficiency_error: Float[Array, ""]
    loss_error: dict[str, Float[Array, ""]]
    gas_work_error: Float[Array, ""]
    peak_error: dict[str, Float[Array, ""]]
    position_error: Float[Array, ""] | None
    steps: Int[Array, ""]
    status: Status


class Orbit(Result, eqx.Module):
    """One revolution of the periodic state, at n quadrature nodes in rising crank angle.

    Attributes:
        state: crank angle [rad], speed [rad/s], acceleration [rad/s^2], shape (n,).
        weight: [rad] quadrature weights over the revolution, shape (n,).
        time: [s] since the first dead centre, shape (n,).
        pressure: [Pa] in each of the k cylinders, shape (k, n); `None` without gas.
        gas_torque: [N m] on the crank, of gas and weights, shape (n,).
        motor_torque: [N m] shape (n,).
        loads: forces and friction of the joints at the nodes. With several cylinders the joints are
            numbered, "crank_pin_2", and forces are in the axes of the cylinder; those of the main
            bearings are in the axes of the machine.
        energy: work over the revolution.
        loss_error: [J] estimated error of `energy.losses`, by joint, panel by panel from what twice the
            nodes change and from the decay of the integrand, with what the torques there change in the
            motion. Their sum is for each: of 24,000 random machines one was off by more, by 1.7 times;
            `verification` has the true error.
        peak_forces: [N] largest magnitude of the panel polynomials over the revolution, by joint.
        peak_error: [N] largest size of the highest two terms of these polynomials: an upper estimate
            of the error of the peaks.
        mean_speed: [rad/s] one revolution over its duration.
        lowest_speed, highest_speed: [rad/s] extremes within the revolution.
        status: how the solver ended, a member of `Status`.
        residual: [-] what is left of the periodicity or of the collocation equations.
        resolution: [-] size of the highest two terms of the speed's polynomials over the swing of the
            speed: an upper estimate of the relative error of the fluctuation.
        iterations: passes or Newton steps of the final solve.
        solver: name of the solver.
        panel_nodes: how many nodes in a row are on one panel.
        cycle: of the gas, where it is solved with the crank's motion; else `None`.
        verification: by an independent march, where `solve_orbit` was asked for it; else `None`.
        positions: [-] centres of the journals that move over their clearances, in the axes of the forces,
            (2, n) by joint; `None` where none moves.
        gas_work_error: [J] estimated error of `energy.gas_work`, from what twice the nodes change and
            the decay of the torque; `None` of solvers that do not tell.
    """

    state: CrankState
    weight: Float[Array, " n"]
    time: Float[Array, " n"] = reading("s", "crank_angle")
    pressure: Float[Array, "k n"] | None = reading("Pa", "cylinder", "crank_angle")
    gas_torque: Float[Array, " n"] = reading(
        "N m", "crank_angle", doc="of gas and weights on the crank"
    )
    motor_torque: Float[Array, " n"] = reading("N m", "crank_angle")
    loads: JointLoads = held()
    energy: Energy = held()
    loss_error: dict[str, Float[Array, ""]] = held()
    peak_forces: dict[str, Float[Array, ""]] = held()
    peak_error: dict[str, Float[Array, ""]] = held()
    mean_speed: Float[Array, ""] = held()
    lowest_speed: Float[Array, ""] = held()
    highest_speed: Float[Array, ""] = held()
    status: Status = held()
    residual: Float[Array, ""] = reading("")
    resolution: Float[Array, ""] = held()
    iterations: Int[Array, ""] = held()
    solver: str = word(static=True)
    panel_nodes: int = held(static=True)
    cycle: Cycle | SeveralCycles | None = held(default=None)
    verification: Verification | None = held(default=None)
    positions: dict[str, Float[Array, "2 n"]] | None = held(default=None)
    gas_work_error: Float[Array, ""] | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("crank_angle",)
    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        at = self.table_dims
        yield from self._registered()
        yield Data("energy_residual", "", self.energy.residual)
        yield from self.data_of("residual")
        if self.verification is not None:
            error = self.verification.efficiency_error
            yield Data("efficiency_error", "", -error, doc="by an independent march")
        yield Data("crank_angle", "rad", self.state.angle, at)
        yield from self.data_of("time")
        yield Data("speed", "rad/s", self.state.speed, at)
        yield Data("acceleration", "rad/s^2", self.state.acceleration, at)
        for data in self.data_of("pressure", dims=at):
            every = jnp.moveaxis(data.values, -2, 0)
            for number, pressure in enumerate(every, 1):
                name = data.name if len(every) == 1 else f"{data.name}.{number}"
                yield data._replace(name=name, values=pressure)
        yield from self.data_of("motor_torque", "gas_torque")
        for name, torque in self.loads.loss_torque.items():
            yield Data(f"friction_torque.{name}", "N m", torque, at, "power lost over crank speed")
        for name, force in self.loads.forces.items():
            x = force[..., 0, :]
            y = force[..., 1, :]
            components = {".x": x, ".y": y, "": jnp.hypot(x, y)}
            for suffix, component in components.items():
                yield Data(f"joint_force.{name}{suffix}", "N", component, at)

    def _registered(self) -> Iterator[Data]:
        """The quantities of the registry that an orbit, with its cycle if it has one, is enough for."""
        has = {"orbit"} if self.cycle is None else {"orbit", "cycle"}
        of_orbit = (quantity for quantity in registered() if "orbit" in quantity.needs)
        quantities = tuple(quantity for quantity in of_orbit if set(quantity.needs) <= has)
        values = _values(self, quantities)
        for quantity in quantities:
            if quantity.name not in values:
                continue
            value = values[quantity.name]
            if not quantity.family:
                yield Data(quantity.name, quantity.unit, value)
                continue
            for name, member in value.items():
                yield Data(f"{quantity.family}.{name}", quantity.unit, member)

    def under_gas(self, compressor: Compressor) -> Compressor:
        """The compressor with the pressures of this orbit in the place of a cylinder's own gas.

        Args:
            compressor: whose orbit it is.
        """
        if self.cycle is None:
            return compressor
        return replaced(compressor, gas=self.cycle.gas())

    def speed_at(self, angle: Float[Array, " q"]) -> Float[Array, " q"]:
        """[rad/s] of the crank at angles [rad], by the polynomial of the panel that they are on."""
        x = self.state.angle.reshape(-1, self.panel_nodes)
        y = self.state.speed.reshape(x.shape)
        # The border of two panels is taken halfway between their nearest nodes, which is the
        # edge where both are equally wide.
        start = (x[-1, -1] - 2 * jnp.pi + x[0, 0]) / 2
        at = start + jnp.mod(angle - start, 2 * jnp.pi)
        panel = jnp.searchsorted((x[:-1, -1] + x[1:, 0]) / 2, at, side="right")
        same_node = jnp.eye(self.panel_nodes, dtype=bool)
        # Lagrange's form, for its derivatives along the angle: factors over all nodes but the value's own
        over = jnp.where(same_node, 1.0, (at[:, None] - x[panel])[:, None, :])
        apart = jnp.where(same_node, 1.0, x[panel][:, :, None] - x[panel][:, None, :])
        return jnp.sum(y[panel] * jnp.prod(over / apart, axis=-1), axis=-1)

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the solution can be relied on."""
        return self.status == Status.converged

    @property
    def mechanical_efficiency(self) -> Float[Array, ""]:
        """[-]"""
        return self.energy.mechanical_efficiency

    @property
    def efficiency_error(self) -> Float[Array, ""]:
        """[-] Estimated error of the losses over the work of the motor."""
        size = maximum(jnp.abs(self.energy.motor_work), self.energy.total_loss)
        return sum(self.loss_error.values(), start=jnp.zeros(())) / _nonzero(size)

    @property
    def torque_fluctuation(self) -> Float[Array, ""]:
        """[-] Highest less lowest torque of gas, weights and friction over its mean, on the crank.

        Infinite where the mean is rounding, of a machine whose gas and friction take no work.
        """
        load = self.loads.total_loss_torque - self.gas_torque
        width = self.panel_width
        signed_loads = jnp.stack([load, -load]).reshape(2, *width.shape, self.panel_nodes)
        extremes = jax.vmap(partial(highest, gauss(self.panel_nodes), width))(signed_loads)
        swing = jnp.sum(extremes)
        work = jnp.sum(self.weight * load)
        # what quadrature and rounding leave of a work that cancels is no mean to divide by
        some = jnp.abs(work) > _NO_WORK * jnp.sum(self.weight * jnp.abs(load))
        return jnp.where(some, swing * 2 * jnp.pi / jnp.where(some, work, 1.0), jnp.inf)

    @property
    def speed_fluctuation(self) -> Float[Array, ""]:
        """[-] (highest - lowest speed)/mean speed."""
        return (self.highest_speed - self.lowest_speed) / self.mean_speed

    @property
    def period(self) -> Float[Array, ""]:
        """[s]"""
        return 2 * jnp.pi / self.mean_speed

    @property
    def motor_power(self) -> Float[Array, ""]:
        """[W]"""
        return self.energy.motor_work / self.period

    @property
    def gas_power(self) -> Float[Array, ""]:
        """[W] Indicated power."""
        return self.energy.gas_work / self.period

    @property
    def loss_power(self) -> dict[str, Float[Array, ""]]:
        """[W] Friction power by joint."""
        return {name: work / self.period for name, work in self.energy.losses.items()}

    @property
    def friction_power(self) -> Float[Array, ""]:
        """[W] Friction power of all joints."""
        return self.energy.total_loss / self.period

    @property
    def margin(self) -> Float[Array, ""]:
        """[-] smallest slope of the joint loop over the revolution; joints lock where it reaches zero."""
        assert self.loads.margin is not None
        return min_of(min_of(self.loads.margin, axis=-1), axis=-1)

    @property
    def weakest_cylinder(self) -> Int[Array, ""] | None:
        """Number, from 1, of the cylinder of several with the smallest margin."""
        margin = self.loads.margin
        if margin is None or margin.shape[-2] == 1:
            return None
        return 1 + jnp.argmin(min_of(margin, axis=-1), axis=-1)

    @property
    def mean_forces(self) -> dict[str, Float[Array, ""]]:
        """[N] mean magnitude over crank angle, by joint."""
        total = jnp.sum(self.weight)
        return {
            name: jnp.sum(self.weight * jnp.hypot(*f)) / total
            for name, f in self.loads.forces.items()
        }

    def largest(self, values: Float[Array, " n"]) -> Float[Array, ""]:
        """Largest value over the revolution of a quantity that is known at the nodes.

        That of the panel polynomials: the nodes themselves miss what is largest at a kink. Nodes of no
        weight do not count. The length of a vector is no polynomial, see `largest_length`.

        Args:
            values: at the nodes, (n,), in any unit.
        """
        shape = (-1, self.panel_nodes)
        return highest(gauss(self.panel_nodes), self.panel_width, values.reshape(shape))

    def largest_length(self, vectors: Float[Array, "k n"]) -> Float[Array, ""]:
        """Largest length over the revolution of a vector that is known at the nodes.

        That of the panel polynomials of its components; the length turns sharply near zero.

        Args:
            vectors: components at the nodes, (k, n), in any unit.
        """
        on_panels = vectors.reshape(vectors.shape[0], -1, self.panel_nodes)
        return farthest(gauss(self.panel_nodes), self.panel_width, on_panels)

    @property
    def panel_width(self) -> Float[Array, " p"]:
        """[rad] of the panels, each with `panel_nodes` nodes."""
        return jnp.sum(self.weight.reshape(-1, self.panel_nodes), axis=-1)

    @property
    def panel_edges(self) -> Float[Array, " p_plus_1"]:
        """[rad] of the panels; the last is a revolution after the first."""
        first = self.state.angle.reshape(-1, self.panel_nodes)[:, 0]
        starts = first - self.panel_width * gauss(self.panel_nodes).nodes[0]
        return jnp.append(starts, starts[0] + 2 * jnp.pi)


@kept_jit
def _values(orbit: Orbit, quantities: tuple[Quantity, ...]) -> dict[str, Any]:
    """The quantities of an orbit, or of a batch of them."""

    def read(orbit):
        return offered_values(quantities, SimpleNamespace(orbit=orbit))

    # each axis that a batch has before those of one orbit
    for _ in range(jnp.ndim(orbit.mean_speed)):
        read = eqx.filter_vmap(read)
    return read(orbit)


def _nonzero(value):
    # As a divisor: 0/1 instead of 0/0, in values and derivatives.
    return value + (value == 0)


@kept_jit
def rod_load_reversal(
    orbit: Orbit,
) -> dict[str, tuple[Float[Array, ""], Float[Array, ""]]]:
    """Reversal of the load along the rod at every piston pin or crosshead pin, by joint.

    A pin is oiled only if its load changes sides: API 618 asks for at least 15 degrees of crank, and,
    as it is usually quoted, for 3 % of the load on the other side.

    Args:
        orbit: of a slider-crank; gas and inertia force with friction, at its nodes.

    Returns:
        [rad] the crank angle of the side that is loaded for less of the revolution, the load being a
        straight line between nodes; [-] the largest load of the smaller side over that of the other.
    """
    angle = orbit.state.angle
    step = jnp.diff(jnp.append(angle, angle[0] + 2 * jnp.pi))
    reversals = {}
    for name, force in orbit.loads.forces.items():
        if name.startswith("piston_pin"):
            along_rod = force[0]
            following = jnp.roll(along_rod, -1)
            away = jnp.abs(along_rod) + jnp.abs(following)
            # Part of the step in which a straight line is positive: all of it, none, or up to its zero.
            share = (maximum(along_rod, 0) + maximum(following, 0)) / jnp.where(away > 0, away, 1.0)
            tension = jnp.sum(step * share)
            sides = jnp.stack([max_of(along_rod), -min_of(along_rod)])
            ratio = maximum(min_of(sides), 0.0) / max_of(sides)
            reversals[name] = minimum(tension, 2 * jnp.pi - tension), ratio
    return reversals


def time_harmonics(
    values: Float[Array, "*m t"], time: Float[Array, " t"], duration: Float[Array, " t"], count: int
) -> tuple[Complex[Array, "*m h"], Float[Array, " h"]]:
    r"""Amplitudes of the harmonics 1 to `count` of time over a revolution, with $e^{+i\Omega t}$.

    With an `orbit` of `solve_orbit` that is `time=orbit.time` and
    `duration=orbit.weight / orbit.state.speed`.

    Args:
        values: at t instants.
        time: [s] of the instants.
        duration: [s] quadrature weights of the instants; their sum is the period.
        count: number of harmonics.

    Returns:
        Complex amplitudes in the unit of the values, and their frequencies [rad/s].
    """
    period = jnp.sum(duration)
    frequency = 2 * jnp.pi / period * jnp.arange(1, count + 1)
    turning = jnp.exp(-1j * frequency * time[:, None])
    return 2 / period * (values * duration) @ turning, frequency
