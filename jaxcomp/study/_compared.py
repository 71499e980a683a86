"""Designs beside each other: a variable over a range, two drives at equal duty, several machines.

Dagilis et al., *Slider-link driven compressor (I)*, ask what the transition to a connecting rod would
gain. Here the same cylinder, gas, motor, shaft and bearings are driven either way.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.declared import BESIDE, Record, computed, part, reading, word
from .._core.errors import BadInput, MissingPart
from .._core.exported import kept_jit
from .._core.fields import (
    ANY,
    NONNEGATIVE,
    POSITIVE,
    Part,
    quantities,
    quantity,
    rebuilt,
    replaced,
    subparts,
)
from .._core.registry import HEADLINES, Quantity, offered_values, registered
from .._core.results import Data, Result
from .._core.status import SolveFailed
from .._core.words import one_of
from ..compressor import Compressor, HasCompressor, compressor_of
from ..crank import Collocation, Orbit, solve_orbit
from ..crankshaft import counterweights
from ..friction import CoulombJournal, SliderCrankFriction, SliderLinkFriction
from ..machine import HasMachine, Machine, machine_of
from ..mechanism import SliderCrank, SliderLink
from ._analysis import DesignResult, quantity_named
from ._analysis_options import AnalysisOptions
from ._rules import design_rules

# What quantities may need that follow from the crank's motion and the gas alone.
_OF_CRANK = {"orbit", "cycle", "refrigerant", "motor.losses", "compressor"}
# The pair of a rod drive that does the work of a pair of the slider-link, where names differ.
_COUNTERPART = {"link_slider": "piston_pin"}


def design_study(
    machine: Compressor | Machine | HasMachine,
    variable: str,
    values: Float[Array, " n"],
    solver: Collocation | None = None,
) -> Orbit:
    """The periodic states of a machine over a range of one design variable, along a leading axis.

    A value that locks, stalls or breaks a bound has its status and spoils no other.

    Args:
        machine: to start from: a compressor, a machine or a scene.
        variable: name of a rule in `design_rules`.
        values: [SI] (n,) in the unit of the rule.
        solver: of the periodic state, as `solve_orbit` takes it.

    Raises:
        BadInput: no such rule, or a mechanism for which it is not made.
    """
    if variable not in design_rules:
        raise BadInput("variable", variable, one_of(variable, design_rules))
    rule = design_rules[variable]
    # The designs are laid out before anything is compiled, so that studies of other variables with
    # as many values run the same program.
    start = machine
    if not isinstance(machine, Compressor):
        start = machine_of(machine)
    designs = jax.vmap(partial(rule.apply, start))(jnp.asarray(values, float))
    return _all(designs, solver)


@eqx.filter_jit
def _all(designs: Compressor | Machine, solver: Collocation | None) -> Orbit:
    return jax.vmap(lambda design: solve_orbit(compressor_of(design), solver, throw=False))(designs)


class RodDrive(Part):
    """Drive in the place of slider and link: a rod, its pin, and a piston without link.

    Args:
        conrod_length: [m] between the centres of the eyes.
        conrod_mass: [kg] of the rod.
        conrod_centre: [m] its mass centre from the big end.
        conrod_inertia: [kg m^2] about that centre.
        piston_mass: [kg] with its pin.
        piston_length: [m] wetted.
        pin_diameter: [m] of the piston pin.
        pin_coefficient: [-] Coulomb's, of that pin.
    """

    conrod_length: Float[Array, ""] = quantity("m", POSITIVE, doc="between the eyes")
    conrod_mass: Float[Array, ""] = quantity("kg", NONNEGATIVE)
    conrod_centre: Float[Array, ""] = quantity("m", ANY, doc="mass centre from the big end")
    conrod_inertia: Float[Array, ""] = quantity("kg m^2", NONNEGATIVE, doc="about that centre")
    piston_mass: Float[Array, ""] = quantity("kg", NONNEGATIVE, doc="with its pin")
    piston_length: Float[Array, ""] = quantity("m", POSITIVE, doc="wetted")
    pin_diameter: Float[Array, ""] = quantity("m", POSITIVE, doc="of the piston pin")
    pin_coefficient: Float[Array, ""] = quantity("", NONNEGATIVE, doc="Coulomb, of that pin")


def rod_driven(machine: Compressor | HasCompressor, rod: RodDrive) -> Compressor:
    """The compressor with a connecting rod in the place of slider and link.

    Bore, stroke, gas, motor, shaft, bearings, thrust bearing, pump, the laws of the cylinder wall
    and of the crank pin stay. The cylinder's axis goes through the crank's. The counterweight takes
    the rotating share of the rod and half of the reciprocating masses, in the plane of the piston.

    Args:
        machine: a slider-link machine: a compressor, a machine or a scene.
        rod: the rod and its piston.

    Raises:
        BadInput: another mechanism.
    """
    compressor = compressor_of(machine)
    mechanism = compressor.mechanism
    friction = compressor.friction
    crankshaft = compressor.crankshaft
    if not isinstance(mechanism, SliderLink) or not isinstance(friction, SliderLinkFriction):
        raise BadInput(
            "mechanism", getattr(mechanism, "kind", "another"), "a slider_link with friction"
        )
    crank = SliderCrank(
        bore=mechanism.bore,
        crank_radius=mechanism.crank_radius,
        conrod_length=rod.conrod_length,
        piston_mass=rod.piston_mass,
        conrod_mass=rod.conrod_mass,
        conrod_centre=rod.conrod_centre,
        conrod_inertia=rod.conrod_inertia,
    )
    crankshaft = rebuilt(counterweights(crank, crankshaft), shaft_unbalance=None, shaft_couple=None)
    film = friction.piston_film
    if film is not None:
        film = replaced(film, length=rod.piston_length)
    laws = SliderCrankFriction(
        wall=friction.wall,
        piston_film=film,
        piston_pin=CoulombJournal(rod.pin_coefficient, rod.pin_diameter),
        crank_pin=friction.crank_pin,
    )
    return Compressor(
        mechanism=crank,
        crankshaft=crankshaft,
        motor=compressor.motor,
        gas=compressor.gas,
        friction=laws,
        gravity=compressor.gravity,
    )


class DriveComparison(Result, eqx.Module):
    """Both drives, and what the rod saves.

    Attributes:
        slider_link, connecting_rod: the periodic states of both machines.
        saving: [W] by pair of the slider-link, at its gas power: the losses of the rod drive are
            taken per unit of work on the gas, because it turns a little faster. What the link's
            sliding pair loses stands against the piston pin.
    """

    slider_link: Orbit = part(Orbit)
    connecting_rod: Orbit = part(Orbit)
    saving: dict[str, Float[Array, "*n"]] = reading(
        "W", "pair", doc="at the gas power of the slider-link"
    )

    table_dims: ClassVar[tuple[str, ...]] = ("pair",)
    flat: ClassVar[bool] = True

    @computed("W", doc="at the shaft")
    def total_saving(self) -> Any:
        """[W] Saving of all pairs at the shaft."""
        return sum(self.saving.values(), start=jnp.zeros_like(self.slider_link.gas_power))

    def described(self) -> Iterator[Data]:
        """Savings by the rod, and the numbers of both periodic states, whose curves are in these."""
        yield Data("pair", "", np.array(list(self.saving)), self.table_dims)
        savings = np.stack([*self.saving.values()], axis=-1)
        for entry in self.data_of("saving"):
            yield entry._replace(values=savings)
        yield from self.data_of("total_saving")
        for drive in ("slider_link", "connecting_rod"):
            for entry in getattr(self, drive).described():
                if not entry.dims:
                    yield entry._replace(name=f"{drive}.{entry.name}")


def compare_drives(
    machine: Compressor | HasCompressor, rod: RodDrive, solver: Collocation | None = None
) -> DriveComparison:
    """Run a slider-link machine and the same with a connecting rod; differentiable.

    Args:
        machine: a slider-link machine, as in `rod_driven`.
        rod: what replaces slider and link.
        solver: of the periodic state, as `solve_orbit` takes it.

    Raises:
        BadInput: as `rod_driven`.
    """
    rod_machine = rod_driven(machine, rod)
    link = solve_orbit(compressor_of(machine), solver, throw=False)
    crank = solve_orbit(rod_machine, solver, throw=False)
    scale = link.gas_power / crank.gas_power
    saving = {}
    for name, loss in link.loss_power.items():
        counterpart = _COUNTERPART.get(name, name)
        saving[name] = loss - scale * crank.loss_power.get(counterpart, 0.0)
    return DriveComparison(link, crank, saving)


@dataclasses.dataclass(frozen=True)
class ComparedQuantity(Record):
    """A quantity or dimension of several designs.

    Attributes:
        name: of the quantity, or the path of the dimension.
        unit: SI unit.
        values: [SI] of each design, `None` where one has no such thing.
    """

    name: str = word()
    unit: str = word()
    values: tuple[float | None, ...] = reading(BESIDE)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """Designs beside each other.

    Attributes:
        labels: of the designs.
        rows: what their cranks give, then the numbers of the compressor in which they differ.
    """

    labels: tuple[str, ...]
    rows: tuple[ComparedQuantity, ...] = part(ComparedQuantity, key="figures")

    table_dims: ClassVar[tuple[str, ...]] = ("design",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units, NaN where a design has no such thing."""
        yield Data("design", "", np.array(self.labels), self.table_dims)
        for row in self.rows:
            yield Data(row.name, row.unit, np.array(row.values, float), self.table_dims)


def compare(
    machines: Mapping[str, Compressor | HasCompressor],
    solver: Collocation | None = None,
    *,
    quantities: Sequence[str] | None = None,
    throw: bool = True,
) -> Comparison:
    """Solve the periodic states of some designs, and put them beside each other.

    Args:
        machines: compressors, machines or scenes by label.
        solver: of the periodic state, as `solve_orbit` takes it.
        quantities: by name, which are shown alone; if absent what machines of their kind are judged by
            (of machines with valves COP, capacity and electric power among them), losses and forces.
        throw: raise if one does not converge.

    Raises:
        BadInput: an unknown quantity, or one that no design has.
        SolveFailed: no convergence; the message names the design.
    """
    requested = tuple(map(quantity_named, quantities or ()))
    figures = []
    for label, machine in machines.items():
        try:
            orbit = solve_orbit(compressor_of(machine), solver, throw=throw)
        except SolveFailed as error:
            error.args = (f"{label}: {error}",)
            raise
        if requested:
            figures.append(_values_of(machine, orbit, requested, offered=False))
        else:
            figures.append(_figures(machine, orbit))
    for figure in requested:
        if not any(figure.name in table for table in figures):
            first = next(iter(machines.values()))
            missing = figure.missing(_described(first))
            raise MissingPart(figure.name, missing)
    dimensions = _joined([dict(_dimensions(machine)) for machine in machines.values()])
    differing = [row for row in dimensions if len(set(row.values)) > 1]
    return Comparison(tuple(machines), (*_joined(figures), *differing))


def _figures(machine: Any, orbit: Orbit) -> dict[str, tuple[str, float]]:
    """Unit and value of what a design is judged by: headlines, the single numbers of its orbit, power."""
    candidates = [quantity_named(name) for name in HEADLINES]
    candidates += [quantity for quantity in registered() if quantity.family == "power_use"]
    judged = []
    for candidate in candidates:
        if {*candidate.needs} <= _OF_CRANK:
            judged.append(candidate)
    values = _values_of(machine, orbit, tuple(judged))
    single = {}
    for entry in orbit.described():
        if not entry.dims and not entry.name.endswith("residual"):
            single[entry.name] = entry.unit, float(entry.values)
    first = {name: value for name, value in values.items() if name in HEADLINES}
    # A merged dictionary keeps the first place of a name and its last value: headlines come first, and
    # what the registry knows as well has the registry's value.
    return first | single | values


def _values_of(
    machine: Any, orbit: Orbit, quantities: tuple[Quantity, ...], offered: bool = True
) -> dict[str, tuple[str, float]]:
    """Unit and value of those quantities that a design has, a family member by member."""
    design = _described(machine)
    suiting = tuple(figure for figure in quantities if not figure.missing(design))
    if not suiting:
        return {}
    values = jax.device_get(_evaluated(design, orbit, suiting, offered))
    out = {}
    for figure in suiting:
        if figure.name not in values:
            continue
        members = {"": values[figure.name]}
        if figure.family:
            members = values[figure.name]
        for member, value in members.items():
            name = figure.name
            if member:
                name = f"{figure.family}.{member}"
            out[name] = figure.unit, float(value)
    return out


def _described(machine: Any) -> Machine:
    """The machine of a scene; of a compressor alone one without further sections."""
    if isinstance(machine, Compressor):
        return Machine(machine)
    return machine_of(machine)


@kept_jit
def _evaluated(
    design: Machine, orbit: Orbit, quantities: tuple[Quantity, ...], offered: bool
) -> dict[str, Any]:
    """Quantities of a design whose orbit is known; those that are not offered but asked for may fail."""
    result = DesignResult(design, AnalysisOptions())
    result.orbit = orbit
    if offered:
        return offered_values(quantities, result)
    return {quantity.name: quantity.value(result) for quantity in quantities}


def _joined(tables: Sequence[dict[str, tuple[str, float]]]) -> list[ComparedQuantity]:
    """One row for each name, in the order in which they come first, all `loss_power` together."""
    units = {}
    for table in tables:
        for name, (unit, _) in table.items():
            units[name] = unit
    families = list(dict.fromkeys(map(_family, units)))
    absent = ("", None)
    rows = []
    for name in sorted(units, key=lambda name: families.index(_family(name))):
        values = []
        for table in tables:
            _, value = table.get(name, absent)
            values.append(value)
        rows.append(ComparedQuantity(name, units[name], tuple(values)))
    return rows


def _family(name: str) -> str:
    return name.partition(".")[0]


def _dimensions(machine: Any) -> Iterator[tuple[str, tuple[str, float]]]:
    compressor = _described(machine).compressor
    for path, component in subparts(compressor):
        for name, field in quantities(component):
            value = getattr(component, name)
            if value is not None and not np.ndim(value):
                place = name
                if path:
                    place = f"{path}.{name}"
                yield place, (field.metadata["unit"], float(value))
