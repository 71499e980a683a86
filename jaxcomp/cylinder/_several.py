"""Cycles of several cylinders: sums of flows, powers and losses, and the worst of what else there is."""

from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.declared import computed, declarations
from .._core.extremes import clip, max_of
from .._core.fields import replaced
from .._core.results import Data, Result
from .._core.status import Status, ended_in
from ..gas import AbstractGas
from ._cycle import Cycle, nonzero, whole_cycle
from ._cylinder import Case
from ._pulsation import Pulsation
from ._solved_ends import ends_under


def _of_cycle(name: str) -> Any:
    """Declare a property with what `Cycle` declares of it."""
    declaration = declarations(Cycle)[name]
    assert declaration.unit is not None
    return computed(declaration.unit, *declaration.dims)


def _combined(combine, name: str, doc: str) -> Any:
    """A property that combines what the cycles of k cylinders have, with their swept volumes."""

    def read(self):
        each = jax.vmap(lambda cycle: getattr(cycle, name))(self.each)
        swept = self.each.case.swept
        if self.stages and combine in (_delivery, _mean):
            # what later stages draw has been drawn by the first already, and only the last one
            # delivers
            counts = self.of_stage(1 if combine is _mean else max(self.stages))
            swept = swept[counts]
            each = jax.tree.map(lambda x: x[counts], each)
        return jax.tree.map(lambda x: combine(x, swept), each)

    read.__doc__ = doc
    if name in declarations(Cycle):
        return _of_cycle(name)(read)
    return property(read)


def _sum(values, swept):
    del swept
    return jnp.sum(values, axis=0)


def _delivery(values, swept):
    """Sum over the cylinders that deliver: of several stages the last."""
    return _sum(values, swept)


def _largest(values, swept):
    del swept
    return max_of(values, axis=0)


def _furthest(values, swept):
    del swept
    return max_of(jnp.abs(values))


def _nearest(values, swept):
    del swept
    return values[jnp.argmin(jnp.abs(values))]


def _mean(values, swept):
    return jnp.sum(swept / jnp.sum(swept) * values)


class SeveralCycles(Result, eqx.Module):
    """Cycles of k cylinders, each by its own crank angle; flows, powers and losses are their sums.

    Attributes:
        each: the cycles; every entry with a leading axis of k.
        together: what was solved of cylinders that share plenums or pipes, and where a similar machine
            may start.
        sides: ends of every cylinder: 2 of double-acting ones, whose cycles are those of head end and
            crank end in turn, each by its own crank angle.
        pulsation: in these pipes; `None` without any.
        stages: number of the stage of every cycle, from 1; empty where there is one. What is delivered
            is what the last one delivers, and volumes are those of the first.
    """

    each: Cycle
    together: Any = None
    sides: int = eqx.field(static=True, default=1)
    pulsation: Pulsation | None = None
    stages: tuple[int, ...] = eqx.field(static=True, default=())

    table_dims: ClassVar[tuple[str, ...]] = ()
    flat: ClassVar[bool] = True

    totals = _combined(_sum, "totals", "[kg] and [J] over the revolution, of all.")
    delivered = _combined(_delivery, "delivered", "[kg] a revolution.")
    mass_flow = _combined(_delivery, "mass_flow", "[kg/s] delivered.")
    capacity = _combined(_delivery, "capacity", "[W] cooling capacity.")
    indicated_work = _combined(_sum, "indicated_work", "[J] put into the gas in a revolution.")
    indicated_power = _combined(_sum, "indicated_power", "[W]")
    work_losses = _combined(
        _sum, "work_losses", "[J] Where the indicated work goes, by name; the values add up to it."
    )
    volumetric_efficiency = _combined(
        _mean,
        "volumetric_efficiency",
        "[-] mass delivered over density in the suction line times all swept volumes.",
    )
    volume_losses = _combined(
        _mean, "volume_losses", "[-] Where the swept volume goes, by name; the values add up to 1."
    )
    peak_pressure = _combined(_largest, "peak_pressure", "[Pa]")
    residual = _combined(_largest, "residual", "[-] The largest.")
    resolution = _combined(_largest, "resolution", "[-] The largest; see `Cycle.resolution`.")
    mass_closure = _combined(_furthest, "mass_closure", "[-] The largest.")
    energy_closure = _combined(_furthest, "energy_closure", "[-] The largest.")
    impact_speeds = _combined(
        _largest,
        "impact_speeds",
        "[m/s] Highest speed at which a valve of any cylinder meets its seat and its stop.",
    )
    turning_margins = _combined(
        _nearest,
        "turning_margins",
        "[-] How far a valve of any cylinder turns beyond its seat and its stop, where it grazes most.",
    )
    grazes = Cycle.grazes

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield from whole_cycle(self)

    def of_stage(self, number: int) -> np.ndarray:
        """Places of the cycles of a stage, from 1."""
        stages = self.stages or (1,) * self.each.residual.shape[0]
        return np.flatnonzero(np.array(stages) == number)

    @property
    def flow_of_stages(self) -> Float[Array, " s"]:
        """[kg] a revolution that every stage delivers."""
        delivered = self.each.totals.discharge
        flows = [jnp.sum(delivered[self.of_stage(n)]) for n in range(1, max(self.stages) + 1)]
        return jnp.stack(flows)

    @property
    def reexpansion_of_stages(self) -> Float[Array, " s"]:
        r"""[-] Share of its flow by which a stage draws less where its pressure ratio rises by its share.

        Estimated by the isentropic expansion of the gas in the clearance of the ends that deliver: of a
        volume $c\,r^{1/n}$, the slope over $\ln r$ is its n-th part.
        """
        case = self.each.case
        density_ratio = case.discharge.rho / case.suction.rho
        rise = jnp.log(case.discharge.p / case.suction.p)
        # an iteration may pass a stage without compression, of which the estimate means nothing
        per_exponent = jnp.log(density_ratio) / jnp.where(rise > 0, rise, 1.0)
        delivered = self.each.totals.discharge
        delivers = delivered > 1e-6 * case.mass_scale
        # 1/n is the logarithm of densities over that of pressures
        slope = case.cylinder.clearance_ratio * density_ratio * per_exponent
        taken_up = jnp.where(delivers, slope * case.mass_scale, 0.0)
        shares = []
        for number in range(1, max(self.stages) + 1):
            ends = self.of_stage(number)
            flow = jnp.sum(delivered[ends])
            share = jnp.sum(taken_up[ends]) / jnp.where(flow > 0, flow, 1.0)
            # of a stage that hardly delivers the estimate means nothing
            shares.append(clip(share, 0.0, 2.0))
        return jnp.stack(shares)

    @property
    def interstage_pressures(self) -> Float[Array, " s"]:
        """[Pa] In the suction line of every later stage."""
        line = self.each.case.suction.p
        later = range(2, max(self.stages) + 1)
        return jnp.stack([line[self.of_stage(n)[0]] for n in later])

    @property
    def pressure_behind_stages(self) -> dict[str, Float[Array, ""]]:
        """[Pa] In the line behind the cooler of every stage but the last, by its number."""
        return {str(n): p for n, p in enumerate(self.interstage_pressures, 1)}

    @property
    def cooler_heat(self) -> Float[Array, ""]:
        """[J] that the coolers take from the gas in a revolution."""
        totals = self.each.totals
        heat = jnp.zeros(())
        for number in range(1, max(self.stages)):
            stage = self.of_stage(number)
            # enthalpy as the gas leaves the stage, less that with which the next one draws it
            cooled = self.each.case.suction.h[self.of_stage(number + 1)[0]]
            heat += jnp.sum(totals.discharge_heat[stage] - totals.discharge[stage] * cooled)
        return heat

    @property
    def first(self) -> Cycle:
        """That of the first cylinder."""
        return jax.tree.map(lambda leaf: leaf[0], self.each)

    @property
    def case(self) -> Case:
        """Case of the first cylinder; the lines are those of all."""
        return self.first.case

    @property
    def status(self) -> Status:
        """That of the first cycle that did not converge, if any."""
        worst = Status.converged
        # from the last to the first, so that the first one that failed is what remains
        for number in reversed(range(self.each.residual.shape[0])):
            of_cylinder = jax.tree.map(lambda leaf, number=number: leaf[number], self.each.status)
            worst = Status.where(of_cylinder == Status.converged, worst, of_cylinder)
        return worst

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether all can be relied on."""
        return self.status == Status.converged

    @property
    def frequency(self) -> Float[Array, ""]:
        """[1/s] revolutions."""
        return self.first.frequency

    @_of_cycle("isentropic_efficiency")
    def isentropic_efficiency(self) -> Float[Array, ""]:
        """[-] isentropic work of the mass delivered over the indicated work."""
        return self.work_losses["isentropic"] / nonzero(self.indicated_work)

    @_of_cycle("discharge_temperature")
    def discharge_temperature(self) -> Float[Array, ""]:
        """[K] of the gas delivered, mixed at the pressure of the line."""
        last_stage = self.of_stage(max(self.stages, default=1))
        # streams mix by enthalpy, not by temperature: one cycle with the sums gives the
        # temperature
        first = jax.tree.map(lambda leaf: leaf[last_stage[0]], self.each)
        heat_and_mass = (jnp.sum(self.each.totals.discharge_heat[last_stage]), self.delivered)
        mixed = eqx.tree_at(
            lambda c: (c.totals.discharge_heat, c.totals.discharge), first, heat_and_mass
        )
        return mixed.discharge_temperature

    @_of_cycle("wall_temperature")
    def wall_temperature(self) -> Float[Array, ""] | None:
        """[K] of the warmest cylinder's wall; `None` without heat transfer."""
        if self.each.case.cylinder.heat is None:
            return None
        return max_of(jax.vmap(lambda cycle: cycle.wall_temperature)(self.each))

    @property
    def closing_angles(self) -> dict[str, Float[Array, ""]]:
        """[rad] Own crank angle at which each valve of the first cylinder shuts for the last time."""
        return self.first.closing_angles

    def gas(self) -> AbstractGas:
        """The pressures as a gas that is prescribed over the crank angle of every cylinder."""
        gas = jax.vmap(lambda cycle: cycle.gas())(self.each)
        if self.together is not None:
            # all of a group have the same edges: each cylinder names some of them
            ends = gas.edges.shape[0]
            edges = self.together.z.edges
            groups = edges.shape[0] if edges.ndim > 1 else 1
            count = ends // groups
            kinks = [gas.edges[i, 1 + i % count :: count] for i in range(ends)]
            gas = replaced(gas, kinks=jnp.stack(kinks))
        if self.stages:
            # The crankcase has the gas that the first stage draws.
            crankcase = gas.back_pressure[self.of_stage(1)[0]]
            gas = replaced(gas, back_pressure=jnp.full_like(gas.back_pressure, crankcase))
        if self.sides == 1:
            return gas
        return ends_under(gas, self.each.case.mechanism)


def unsolved(cycle: Cycle | SeveralCycles) -> Cycle | SeveralCycles:
    """A cycle of which nothing has been found."""
    failed = jax.tree.map(jnp.full_like, of_each(cycle).status, Status.not_converged)
    return eqx.tree_at(lambda cycle: of_each(cycle).status, cycle, failed)


def of_each(cycle: Cycle | SeveralCycles) -> Cycle:
    """The cycle, or all of several with an axis of them."""
    return cycle.each if isinstance(cycle, SeveralCycles) else cycle


# [-] Last step of Newton's method within which it has found a root of its equations.
NEAR = 1e-7


def is_near(cycle: Cycle) -> Bool[Array, ""]:
    """Whether the equations of the cycle are solved, though a branch of the valves may be left.

    So it may be at a motion on the way to that of the crank, which is a fair guess all the same.
    """
    is_root = (cycle.status == Status.not_converged) & (cycle.residual < NEAR)
    return jnp.all(is_root | _is_found(cycle))


def is_solved(cycle: Cycle) -> Bool[Array, ""]:
    """Whether Newton's method found the cycle, be it one without delivery or of wet gas."""
    return _is_found(cycle).all()


def _is_found(cycle: Cycle) -> Bool[Array, "*k"]:
    return ~ended_in(cycle.status, Status.not_converged, Status.too_many_events, Status.bad_input)
