r"""The analysis of one design: its options, and results that are computed on first access."""

from functools import cached_property
from typing import TYPE_CHECKING, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._fields import BadInput, admissible
from .._registry import Quantity, registered, registered_quantity
from .._words import one_of
from ..balancing import Influence, flexibilities, influence_of, least_squares
from ..coupling import CrankLoads
from ..crank import (
    Collocation,
    JournalFilm,
    Orbit,
    Performance,
    journal_films,
    performance,
    solve_orbit,
)
from ..machine import Assembly, Machine, assembled
from ..shaking import Wrench, shaking_wrench
from ._vibration import (
    KnownResponse,
    RotorExcitation,
    Vibration,
    all_crank_loads,
    known_vibration,
    places_of,
    vibration_of,
)

if TYPE_CHECKING:
    from ..crank import Shooting


class AnalysisOptions(eqx.Module):
    """Options of the analysis of a design; they are fixed while numbers change.

    Attributes:
        solver: of the periodic state. Absent: collocation, with a panel edge for each load reversal
            but where only the forces on the rotor are wanted, see `jaxcomp.coupling.crank_loads`, and
            of several cylinders, see `jaxcomp.crank.default_collocation`; derivatives of these err by
            1e-3 of the largest, which `Collocation(reversals=compressor.load_reversals)` mends.
        excitation: what shakes the rotor: "crank" (the periodic state at each speed, whose mean
            force loads the films as well) or "file" (the forces of the scene). Absent: the forces of
            the scene if it has any, otherwise the crank.
        orders: orders of the spin speed that count in vibrations and mount forces.
        left_out: what the crank's forces on the rotor do without, see `jaxcomp.balancing.without`.
        known: response of a rotor that does not change to unit loads; see `prepared`.

    Raises:
        BadInput: another excitation, or an order below one.
    """

    solver: "Collocation | Shooting | None" = None
    excitation: Literal["crank", "file"] | None = eqx.field(static=True, default=None)
    orders: tuple[int, ...] = eqx.field(static=True, default=(1,))
    left_out: tuple[str, ...] = eqx.field(static=True, default=())
    known: KnownResponse | None = None

    def __check_init__(self):
        if self.excitation not in ("crank", "file", None):
            raise BadInput("excitation", str(self.excitation), "'crank' or 'file'")
        if not self.orders or min(self.orders) < 1:
            raise BadInput("orders", str(self.orders), "whole numbers from 1")


class DesignResult:
    """Results of one design, computed on first access.

    A function `f(result) -> number` serves as a quantity of a `Study` beside the named ones.

    Attributes:
        design: the design.
        options: of the analysis.
    """

    def __init__(self, design: Machine, options: AnalysisOptions):
        self.design, self.options = design, options

    @cached_property
    def assembly(self) -> Assembly:
        """The machine put together: laws, crankshaft, films, corrections."""
        return assembled(self.design)

    @cached_property
    def orbit(self) -> Orbit:
        """The periodic state of the crank at the motor of the design.

        Raises:
            BadInput: a scene without a compressor.
        """
        compressor = self.assembly.compressor
        if compressor is None:
            raise BadInput("compressor", "absent", "given, for a quantity of the crank")
        return solve_orbit(compressor, self.options.solver, throw=False)

    @cached_property
    def performance(self) -> Performance:
        """Capacity, efficiencies and powers of a compressor with valves."""
        assert self.assembly.compressor is not None
        return performance(self.assembly.compressor, self.orbit)

    @cached_property
    def wrench(self) -> Wrench:
        """Shaking force and moment over the revolution."""
        assert self.assembly.compressor is not None
        return shaking_wrench(self.assembly.compressor, self.orbit.state)

    @cached_property
    def crank_loads(self) -> CrankLoads:
        """What the crank does to the rotor at the balancing speeds; it is solved once at each."""
        excitation = self._excitation()
        orders = tuple(dict.fromkeys((*excitation.orders, 1)))
        return all_crank_loads(self.assembly, excitation._replace(orders=orders))

    @cached_property
    def vibration(self) -> Vibration:
        """Harmonic response of the rotor at the speeds of its balancing planes."""
        if self.options.known is not None:
            return known_vibration(self.assembly, self._excitation(), self.options.known)
        return vibration_of(self.assembly, self.crank_loads, self.options.orders)

    @cached_property
    def influence(self) -> Influence:
        """Influence coefficients at order 1, with the vibration as the corrections stand."""
        places = places_of(self.assembly)
        answer = flexibilities(self.assembly, self.crank_loads, places, places.speeds)
        return influence_of(answer, places, places.speeds)

    @property
    def ok(self) -> Bool[Array, ""]:
        """Whether all that was computed so far can be relied on."""
        good = jnp.asarray(True)
        if self.design.compressor is not None:
            good &= admissible(self.design.compressor)
        for part in self.design.parts.values():
            good &= admissible(part)
        if "orbit" in self.__dict__:
            good &= self.orbit.converged
        if "vibration" in self.__dict__:
            good &= jnp.all(self.vibration.ok)
        if "influence" in self.__dict__:
            good &= jnp.all(jnp.isfinite(self.influence.initial))
        return good

    @cached_property
    def journals(self) -> dict[str, JournalFilm]:
        """The oil films of the journals over the revolution."""
        assert self.assembly.compressor is not None
        return journal_films(self.assembly.compressor, self.orbit)

    @property
    def peak_shaking_force(self) -> Float[Array, ""]:
        """[N] Largest over the revolution."""
        return self._largest(self.wrench.force)

    @property
    def peak_shaking_moment(self) -> Float[Array, ""]:
        """[N m] Largest over the revolution."""
        return self._largest(self.wrench.moment)

    @property
    def vibration_of_all(self) -> Float[Array, ""]:
        """[m] Weighted root mean square amplitude of all targets."""
        return self._root_mean_square()

    @property
    def vibration_of_targets(self) -> dict[str, Float[Array, ""]]:
        """[m] Root mean square amplitude by target."""
        names = np.array([t.name for t in places_of(self.assembly).targets for _ in t.axes])
        rows = {name: np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist())}
        return {name: self._root_mean_square(place) for name, place in rows.items()}

    @property
    def balanced_vibration(self) -> Float[Array, ""]:
        """[m] `vibration_of_all` at order 1 after the least-squares correction of this design."""
        influence = self.influence
        left = influence.weight * influence.vibration(least_squares(influence).correction)
        return jnp.sqrt(jnp.sum(jnp.abs(left) ** 2) / jnp.sum(influence.weight**2))

    @property
    def mount_force(self) -> Float[Array, ""]:
        """[N] Root mean square, over the speeds, of the lateral force into the ground."""
        return jnp.sqrt(jnp.mean(jnp.sum(self.vibration.mount_force**2, -1)))

    @property
    def weights(self) -> Float[Array, " rows"]:
        """[-] of the rows of `vibration.targets`."""
        places = places_of(self.assembly)
        return jnp.stack([jnp.asarray(t.weight) for t in places.targets for _ in t.axes])

    def _excitation(self) -> RotorExcitation:
        return rotor_excitation(self.assembly, self.options)

    def _largest(self, vector) -> Float[Array, ""]:
        return jnp.sqrt(self.orbit.largest(jnp.sum(vector**2, axis=0)))

    def _root_mean_square(self, rows=slice(None)) -> Float[Array, ""]:
        amplitude, weight = self.vibration.targets[..., rows], self.weights[rows]
        square = jnp.sum((weight * jnp.abs(amplitude)) ** 2)
        return jnp.sqrt(square / (amplitude.shape[0] * jnp.sum(weight**2)))


def balanced_design(design: Machine, options: AnalysisOptions) -> Machine:
    """The design with the corrections in all planes that least squares at order 1 ask for."""
    bare = eqx.tree_at(
        lambda d: d.corrections, design, {name: jnp.zeros(2) for name in design.corrections}
    )
    influence = DesignResult(bare, options).influence
    correction = least_squares(influence).correction
    both = jnp.stack([correction.real, correction.imag], -1)
    return eqx.tree_at(
        lambda d: d.corrections, design, dict(zip(influence.planes, both, strict=True))
    )


def rotor_excitation(machine: Assembly, options: AnalysisOptions) -> RotorExcitation:
    """What shakes the rotor of a design.

    Raises:
        BadInput: a part that is missing.
    """
    if machine.rotor is None or machine.loads is None:
        raise BadInput("rotor", "absent", "given with loads and balancing planes")
    by_crank = machine.excitation(options.excitation) == "crank"
    return RotorExcitation(by_crank, options.solver, options.orders, options.left_out)


def quantity(name: str) -> Quantity:
    """A quantity by name, see `available_quantities`.

    Raises:
        BadInput: no such quantity.
    """
    found = registered_quantity(name)
    if found is None or "<" in name:
        names = [one.name for one in registered()]
        raise BadInput("quantity", name, one_of(name, names))
    return found


def available_quantities(design: Machine, members: bool = False) -> dict[str, Quantity]:
    """The quantities that a design has, by name.

    Args:
        design: the machine.
        members: list every joint and target by itself; families as `loss_power.<joint>` otherwise.
    """
    known = {one.name: one for one in registered() if not one.missing(design)}
    if not members:
        return known
    traced = [one for one in known.values() if one.family and one.members is None]

    def values(design):
        found = DesignResult(design, AnalysisOptions(Collocation(reversals=0)))
        return {one.name: one.value(found) for one in traced}

    found = eqx.filter_eval_shape(values, design) if traced else {}
    out = {}
    for one in known.values():
        names = one.members(design) if one.members else found.get(one.name, ())
        out |= {f"{one.family}.{n}": quantity(f"{one.family}.{n}") for n in names}
        out |= {} if one.family else {one.name: one}
    return out
