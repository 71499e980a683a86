"""The cycles of several cylinders on one crank, between the same lines."""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._results import Data, Result
from .._status import Status
from ._balance import Accounts
from ._cycle import Cycle, SolvedPressure, whole_cycle
from ._cylinder import Case


class SeveralCycles(Result, eqx.Module):
    """Cycles of k cylinders, each by its own crank angle; flows, powers and losses are their sums.

    Attributes:
        each: the cycles; every entry with a leading axis of k.
    """

    each: Cycle

    table_dims: ClassVar[tuple[str, ...]] = ()

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield from whole_cycle(self)

    def _of_each(self, name: str):
        return jax.vmap(lambda cycle: getattr(cycle, name))(self.each)

    def _largest(self, name: str):
        return jax.tree.map(lambda x: jnp.max(x, axis=0), self._of_each(name))

    def _sum(self, name: str):
        return jax.tree.map(lambda x: jnp.sum(x, axis=0), self._of_each(name))

    @property
    def first(self) -> Cycle:
        """That of the first cylinder."""
        return jax.tree.map(lambda leaf: leaf[0], self.each)

    @property
    def case(self) -> Case:
        """Of the first cylinder; the lines are those of all."""
        return self.first.case

    @property
    def status(self) -> Status:
        """That of the first cycle that did not converge, if any."""
        found = Status.converged
        for number in reversed(range(self.each.residual.shape[0])):
            own = jax.tree.map(lambda leaf, number=number: leaf[number], self.each.status)
            found = Status.where(own == Status.converged, found, own)
        return found

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether all can be relied on."""
        return self.status == Status.converged

    @property
    def residual(self) -> Float[Array, ""]:
        """[-] The largest."""
        return jnp.max(self.each.residual)

    @property
    def totals(self) -> Accounts:
        """[kg] and [J] over the revolution, of all."""
        return self._sum("totals")

    @property
    def frequency(self) -> Float[Array, ""]:
        """[1/s] revolutions."""
        return self.first.frequency

    @property
    def delivered(self) -> Float[Array, ""]:
        """[kg] a revolution."""
        return self._sum("delivered")

    @property
    def mass_flow(self) -> Float[Array, ""]:
        """[kg/s] delivered."""
        return self._sum("mass_flow")

    @property
    def capacity(self) -> Float[Array, ""]:
        """[W] cooling capacity."""
        return self._sum("capacity")

    @property
    def indicated_work(self) -> Float[Array, ""]:
        """[J] put into the gas in a revolution."""
        return self._sum("indicated_work")

    @property
    def indicated_power(self) -> Float[Array, ""]:
        """[W]"""
        return self._sum("indicated_power")

    @property
    def volumetric_efficiency(self) -> Float[Array, ""]:
        """[-] mass delivered over density in the suction line times all swept volumes."""
        return self._weighted(self._of_each("volumetric_efficiency"))

    def _weighted(self, values):
        """The mean by swept volumes."""
        share = self.each.case.swept / jnp.sum(self.each.case.swept)
        return jax.tree.map(lambda x: jnp.sum(share * x), values)

    @property
    def isentropic_efficiency(self) -> Float[Array, ""]:
        """[-] isentropic work of the mass delivered over the indicated work."""
        work = self.indicated_work
        return self.work_losses["isentropic"] / jnp.where(work == 0, 1.0, work)

    @property
    def discharge_temperature(self) -> Float[Array, ""]:
        """[K] of the gas delivered, mixed at the pressure of the line."""
        first = self.first
        both = (self.totals.discharge_heat, self.delivered)
        mixed = eqx.tree_at(lambda c: (c.totals.discharge_heat, c.totals.discharge), first, both)
        return mixed.discharge_temperature

    @property
    def peak_pressure(self) -> Float[Array, ""]:
        """[Pa]"""
        return jnp.max(self.each.peak_pressure)

    @property
    def wall_temperature(self) -> Float[Array, ""] | None:
        """[K] of the warmest cylinder's wall; `None` without heat transfer."""
        if self.each.case.cylinder.heat is None:
            return None
        return jnp.max(self._of_each("wall_temperature"))

    @property
    def mass_closure(self) -> Float[Array, ""]:
        """[-] The largest."""
        return jnp.max(jnp.abs(self._of_each("mass_closure")))

    @property
    def energy_closure(self) -> Float[Array, ""]:
        """[-] The largest."""
        return jnp.max(jnp.abs(self._of_each("energy_closure")))

    @property
    def work_losses(self) -> dict[str, Float[Array, ""]]:
        """[J] Where the indicated work goes, by name; the values add up to it."""
        return self._sum("work_losses")

    @property
    def volume_losses(self) -> dict[str, Float[Array, ""]]:
        """[-] Where the swept volume goes, by name; the values add up to 1."""
        return self._weighted(self._of_each("volume_losses"))

    @property
    def impact_speeds(self) -> dict[str, Float[Array, ""]]:
        """[m/s] Highest speed at which a valve of any cylinder meets its seat and its stop."""
        return self._largest("impact_speeds")

    @property
    def grazes(self) -> dict[str, Bool[Array, ""]]:
        """Whether a valve of any cylinder just reaches its stop or just does not."""
        return self._largest("grazes")

    @property
    def closing_angles(self) -> dict[str, Float[Array, ""]]:
        """[rad] Own crank angle at which each valve of the first cylinder shuts for the last time."""
        return self.first.closing_angles

    def gas(self) -> SolvedPressure:
        """The pressures as a gas that is prescribed over the crank angle of every cylinder."""
        return jax.vmap(lambda cycle: cycle.gas())(self.each)
