r"""The analysis of one design: its options, and results that are computed on first access."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._core.each import of_cylinder
from .._core.errors import BadInput
from .._core.extremes import min_of
from .._core.fields import admissible
from .._core.registry import Quantity, is_external, offered_values, registered, registered_quantity
from .._core.status import Status
from .._core.words import nearest, one_of
from ..compressor import Compressor
from ..crank import (
    Collocation,
    JournalFilm,
    Orbit,
    Performance,
    journal_films,
    performance,
    solve_orbit,
)
from ..crank._orbit import time_harmonics
from ..cylinder import LineResonance
from ..cylinder._climb import events_without_room
from ..cylinder._line_resonances import named_resonances
from ..cylinder._several import of_each
from ..friction._joint_loads import magnitude
from ..machine import Assembly, Machine, assembled
from ..vibration import Wrench, shaking_wrench
from ._analysis_options import AnalysisOptions
from ._ideal_delivery import IdealDelivery, ideal_delivery

# what answers for a rotor is imported where it is used: to import it takes as long as to solve a crank
if TYPE_CHECKING:
    from ..balancing._influence import Influence
    from ..vibration._coupling import CrankLoads
    from ._rotor_response import Vibration

SHAKING_ORDERS = (1, 2, 3, 4, 6)  # of the revolution, which shaking forces and couples are told of


class DesignResult:
    """Results of one design, computed on first access.

    A function `f(result) -> number` serves as a quantity of a `Problem` beside the named ones.

    Attributes:
        design: the design.
        options: of the analysis.
    """

    def __init__(self, design: Machine, options: AnalysisOptions):
        self.design = design
        self.options = options

    @cached_property
    def assembly(self) -> Assembly:
        """The machine put together: laws, crankshaft, films, corrections."""
        return assembled(self.design)

    @property
    def _compressor(self) -> Compressor:
        if self.assembly.compressor is None:
            raise BadInput("compressor", "absent", "given, for a quantity of the crank")
        return self.assembly.compressor

    @cached_property
    def orbit(self) -> Orbit:
        """The periodic state of the crank at the motor of the design.

        Raises:
            BadInput: a scene without a compressor.
        """
        return solve_orbit(self._compressor, self.options.solver, throw=False)

    @cached_property
    def performance(self) -> Performance:
        """Capacity, efficiencies and powers of a compressor with valves."""
        return performance(self._compressor, self.orbit)

    @cached_property
    def delivered(self) -> IdealDelivery:
        """Delivery of a machine with simple cycles."""
        described = self.design.compressor
        machine_gas = None if described is None else described.gas
        return ideal_delivery(self._compressor, machine_gas, self.orbit.mean_speed)

    @cached_property
    def resonances(self) -> dict[str, LineResonance]:
        """The lowest resonances of the pipes, which need no cycle."""
        compressor = self._compressor
        first = of_cylinder(compressor.gas), of_cylinder(compressor.mechanism)
        speed = compressor.motor.speed_guess
        return named_resonances(*first, speed, compressor.crankshaft.count)

    @cached_property
    def wrench(self) -> Wrench:
        """Shaking force and moment over the revolution."""
        return shaking_wrench(self._compressor, self.orbit.state)

    @cached_property
    def crank_loads(self) -> "CrankLoads":
        """Loads of the crank on the rotor at the balancing speeds; it is solved once at each."""
        from ._rotor_response import all_crank_loads

        orders = tuple(dict.fromkeys((*self.options.orders, 1)))
        return all_crank_loads(self.assembly, self.options, orders)

    @cached_property
    def vibration(self) -> "Vibration":
        """Harmonic response of the rotor at the speeds of its balancing planes."""
        from ._rotor_response import known_vibration, vibration_of

        if self.options.known is not None:
            return known_vibration(self.assembly, self.options, self.options.known)
        return vibration_of(self.assembly, self.crank_loads, self.options.orders)

    @cached_property
    def influence(self) -> "Influence":
        """Influence coefficients at order 1, with the vibration as the corrections stand."""
        from ..balancing._influence import flexibilities, influence_of
        from ._rotor_response import places_of

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

    @property
    def status(self) -> Status:
        """Status of what was computed so far of the crank; a design out of bounds is bad input."""
        parts = [self.design.compressor, *self.design.parts.values()]
        good = []
        for part in parts:
            if part is not None:
                good.append(admissible(part))
        status = Status.converged
        if "orbit" in self.__dict__:
            status = self.orbit.status
        if not good:
            return status
        return Status.where(jnp.all(jnp.stack(good)), status, Status.bad_input)

    @property
    def events_without_room(self) -> Int[Array, ""]:
        """Events seen in a cycle that may be found in a larger size; -1 where none is needed."""
        if "orbit" not in self.__dict__ or self.orbit.cycle is None:
            return jnp.asarray(-1)
        return events_without_room(of_each(self.orbit.cycle), self.orbit.status)

    @cached_property
    def journals(self) -> dict[str, JournalFilm]:
        """The oil films of the journals over the revolution."""
        return journal_films(self._compressor, self.orbit)

    @property
    def least_film(self) -> Float[Array, ""]:
        """[m] Smallest of all journals over the revolution."""
        films = [film.minimum_film for film in self.journals.values()]
        if films:
            return min_of(jnp.stack(films))
        return jnp.asarray(jnp.inf)

    @property
    def peak_shaking_force(self) -> Float[Array, ""]:
        """[N] Largest over the revolution."""
        return self.orbit.largest_length(self.wrench.force)

    @property
    def peak_shaking_moment(self) -> Float[Array, ""]:
        """[N m] Largest over the revolution."""
        return self.orbit.largest_length(self.wrench.moment)

    @property
    def shaking_force(self) -> dict[str, Float[Array, ""]]:
        """[N] Amplitude by order of the revolution, along the long axis of the ellipse that it runs."""
        return self._by_order(self.wrench.force)

    @property
    def shaking_couple(self) -> dict[str, Float[Array, ""]]:
        """[N m] The same of the moment across the shaft."""
        return self._by_order(self.wrench.moment)

    def _by_order(self, vectors: Float[Array, "3 n"]) -> dict[str, Float[Array, ""]]:
        orbit = self.orbit
        duration = orbit.weight / orbit.state.speed
        (x, y), _ = time_harmonics(vectors[:2], orbit.time, duration, max(SHAKING_ORDERS))
        # the parts that turn with the crank and against it add up along the long axis
        turning = jnp.stack([x + 1j * y, x - 1j * y]) / 2
        size = jnp.sum(magnitude(turning.real, turning.imag), axis=0)
        return {str(order): size[order - 1] for order in SHAKING_ORDERS}

    @property
    def vibration_of_all(self) -> Float[Array, ""]:
        """[m] Weighted root mean square amplitude of all targets."""
        return self._root_mean_square()

    @property
    def vibration_of_targets(self) -> dict[str, Float[Array, ""]]:
        """[m] Root mean square amplitude by target."""
        from ._rotor_response import places_of

        targets = places_of(self.assembly).targets
        axes = [len(target.axes) for target in targets]
        names = np.repeat([target.name for target in targets], axes)
        amplitudes = {}
        for name in dict.fromkeys(names.tolist()):
            rows = np.flatnonzero(names == name)
            amplitudes[name] = self._root_mean_square(rows)
        return amplitudes

    @property
    def balanced_vibration(self) -> Float[Array, ""]:
        """[m] `vibration_of_all` at order 1 after the least-squares correction of this design."""
        from ..balancing import least_squares

        influence = self.influence
        residual = influence.weight * influence.vibration(least_squares(influence).correction)
        return jnp.sqrt(jnp.sum(jnp.abs(residual) ** 2) / jnp.sum(influence.weight**2))

    @property
    def mount_force(self) -> Float[Array, ""]:
        """[N] Root mean square, over the speeds, of the lateral force into the ground."""
        return jnp.sqrt(jnp.mean(jnp.sum(self.vibration.mount_force**2, -1)))

    @property
    def weights(self) -> Float[Array, " rows"]:
        """[-] of the rows of `vibration.targets`."""
        from ._rotor_response import places_of

        weights = []
        for target in places_of(self.assembly).targets:
            weights += [jnp.asarray(target.weight)] * len(target.axes)
        return jnp.stack(weights)

    def _root_mean_square(self, rows=slice(None)) -> Float[Array, ""]:
        amplitude = self.vibration.targets[..., rows]
        weight = self.weights[rows]
        square = jnp.sum((weight * jnp.abs(amplitude)) ** 2)
        return jnp.sqrt(square / (amplitude.shape[0] * jnp.sum(weight**2)))


def balanced_design(design: Machine, options: AnalysisOptions) -> Machine:
    """The design with the corrections in all planes that least squares at order 1 ask for.

    Args:
        design: a machine with a rotor and correction planes.
        options: of the analysis whose vibration is balanced.
    """
    from ..balancing import least_squares

    # Least squares finds the whole correction, so that none may be in place.
    no_corrections = {name: jnp.zeros(2) for name in design.corrections}
    uncorrected = eqx.tree_at(lambda d: d.corrections, design, no_corrections)
    influence = DesignResult(uncorrected, options).influence
    correction = least_squares(influence).correction
    components = jnp.stack([correction.real, correction.imag], -1)
    return eqx.tree_at(
        lambda d: d.corrections, design, dict(zip(influence.planes, components, strict=True))
    )


def quantity_named(name: str) -> Quantity:
    """A quantity by name, see `available_quantities`.

    Raises:
        BadInput: no such quantity.
    """
    quantity = registered_quantity(name)
    if quantity is None or "<" in name:
        names = [candidate.name for candidate in registered()]
        prefix = f"{name.lower()}."
        members = [member for member in names if member.startswith(prefix)]
        family = nearest(name, members)
        if family is not None:
            bound = f'"{family}"; `jaxcomp list --quantities MACHINE` lists its members'
            raise BadInput("quantity", name, bound)
        raise BadInput("quantity", name, one_of(name, names))
    return quantity


def _needs_trace(quantity: Quantity) -> bool:
    if is_external(quantity):
        return True
    return bool(quantity.family) and quantity.members is None


@eqx.filter_jit
def _values_by_name(design: Machine, quantities: tuple[Quantity, ...]) -> dict[str, Any]:
    """Values of quantities that a design has; designs of one structure are traced once."""
    result = DesignResult(design, AnalysisOptions(Collocation(reversals=0)))
    return offered_values(quantities, result)


def available_quantities(design: Machine, members: bool = False) -> dict[str, Quantity]:
    """The quantities that a design has, by name.

    Args:
        design: the machine.
        members: list every joint and target by itself, without quantities of other packages that fail;
            families as `loss_power.<joint>` otherwise.
    """
    suiting = [quantity for quantity in registered() if not quantity.missing(design)]
    if not members:
        return {quantity.name: quantity for quantity in suiting}
    # Only a trace tells which of these a design has, and the members of a family that lists none.
    traced = [quantity for quantity in suiting if _needs_trace(quantity)]
    shapes = {}
    if traced:
        shapes = eqx.filter_eval_shape(_values_by_name, design, tuple(traced))
    available = {}
    for quantity in suiting:
        if quantity in traced and quantity.name not in shapes:
            continue
        if not quantity.family:
            available[quantity.name] = quantity
            continue
        family = shapes.get(quantity.name, ())
        if quantity.members:
            family = quantity.members(design)
        for member in family:
            name = f"{quantity.family}.{member}"
            available[name] = quantity_named(name)
    return available
