r"""What a design is judged by: named quantities, each computed only if it is asked for."""

from collections.abc import Callable
from functools import cached_property
from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._fields import BadInput, admissible
from .._words import hint, one_of
from ..balancing import Influence, flexibilities, influence_of, least_squares
from ..coupling import CrankLoads
from ..crank import Collocation, Orbit, Shooting, solve_orbit
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


class AnalysisOptions(eqx.Module):
    """Options of the analysis of a design; they are fixed while numbers change.

    Attributes:
        solver: of the periodic state. Absent: collocation, with a panel edge for each load reversal
            but where only the forces on the rotor are wanted, see `jaxcomp.coupling.crank_loads`.
        excitation: what shakes the rotor: "crank" (the periodic state at each speed, whose mean
            force loads the films as well) or "file" (the forces of the scene). Absent: the forces of
            the scene if it has any, otherwise the crank.
        orders: orders of the spin speed that count in vibrations and mount forces.
        left_out: what the crank's forces on the rotor do without, see `jaxcomp.balancing.without`.
        known: response of a rotor that does not change to unit loads; see `prepared`.

    Raises:
        BadInput: another excitation, or an order below one.
    """

    solver: Collocation | Shooting | None = None
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
    def wrench(self) -> Wrench:
        """Shaking force and moment over the revolution."""
        assert self.assembly.compressor is not None
        return shaking_wrench(self.assembly.compressor.mechanism, self.orbit.state)

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

    @property
    def weights(self) -> Float[Array, " rows"]:
        """[-] of the rows of `vibration.targets`."""
        places = places_of(self.assembly)
        return jnp.stack([jnp.asarray(t.weight) for t in places.targets for _ in t.axes])

    def _excitation(self) -> RotorExcitation:
        return rotor_excitation(self.assembly, self.options)


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
    case = machine.loads
    if machine.rotor is None or case is None:
        raise BadInput("rotor", "absent", "given with loads and balancing planes")
    alone = case.crank is None or machine.compressor is None
    chosen = options.excitation or ("file" if case.forces or alone else "crank")
    if chosen == "crank" and alone:
        raise BadInput("excitation", "crank", "'file' for a scene without loads.crank")
    by_crank = chosen == "crank"
    return RotorExcitation(by_crank, options.solver, options.orders, options.left_out)


class Quantity(NamedTuple):
    """A named quantity.

    Attributes:
        name: as typed.
        unit: SI unit.
        better: "more" or "less", which way a design improves; "" where neither.
        doc: one line.
        value: from what is known of a design.
    """

    name: str
    unit: str
    better: str
    doc: str
    value: Callable[[DesignResult], Float[Array, ""]]


def _mean_square(found: DesignResult, rows=slice(None)) -> Float[Array, ""]:
    amplitude = found.vibration.targets[..., rows]
    weight = found.weights[rows]
    return jnp.sum((weight * jnp.abs(amplitude)) ** 2) / (amplitude.shape[0] * jnp.sum(weight**2))


def _orbit_quantities():
    table = [
        ("mechanical_efficiency", "", "more", "gas over motor work", lambda o: o.mechanical_efficiency),
        ("motor_power", "W", "less", "at the shaft", lambda o: o.motor_power),
        ("gas_power", "W", "", "indicated", lambda o: o.energy.gas_work / o.period),
        ("friction_power", "W", "less", "of all joints", lambda o: o.energy.total_loss / o.period),
        ("speed_fluctuation", "", "less", "(highest - lowest)/mean", lambda o: o.speed_fluctuation),
        ("mean_speed", "rad/s", "", "of the crank", lambda o: o.mean_speed),
        ("joint_margin", "", "more", "against self-locking", lambda o: o.margin),
    ]  # fmt: skip
    return {
        name: Quantity(name, unit, better, doc, lambda found, read=read: read(found.orbit))
        for name, unit, better, doc, read in table
    }


def _largest(found: DesignResult, vector) -> Float[Array, ""]:
    return jnp.sqrt(found.orbit.largest(jnp.sum(vector**2, axis=0)))


_PLAIN = _orbit_quantities() | {
    q.name: q
    for q in (
        Quantity(
            "swept_volume", "m^3", "", "of one stroke",
            lambda f: f.assembly.compressor.mechanism.swept_volume,
        ),
        Quantity(
            "peak_shaking_force", "N", "less", "largest over the turn",
            lambda f: _largest(f, f.wrench.force),
        ),
        Quantity(
            "peak_shaking_moment", "N m", "less", "largest over the turn",
            lambda f: _largest(f, f.wrench.moment),
        ),
        Quantity(
            "vibration", "m", "less",
            "weighted root mean square amplitude of all targets, with the corrections",
            lambda f: jnp.sqrt(_mean_square(f)),
        ),
        Quantity(
            "balanced_vibration", "m", "less",
            "the same at order 1 after the least-squares corrections for this design",
            lambda f: _balanced(f),
        ),
        Quantity(
            "mount_force", "N", "less",
            "root mean square, over the speeds, of the lateral force into the ground",
            lambda f: jnp.sqrt(jnp.mean(jnp.sum(f.vibration.mount_force**2, -1))),
        ),
    )
}  # fmt: skip

_FAMILIES = {
    "loss_power": ("W", "less", "friction power of this joint"),
    "peak_force": ("N", "less", "largest force of this joint over the turn"),
    "mean_force": ("N", "less", "mean magnitude of this joint's force over crank angle"),
    "vibration": ("m", "less", "root mean square amplitude of this target"),
}


def quantity_names(design: Machine) -> dict[str, str]:
    """What `Study` can be asked for, with a line on each; families as `loss_power.<joint>`."""
    names = {}
    for name, entry in _PLAIN.items():
        rotor = name in ("vibration", "balanced_vibration", "mount_force")
        if (
            ("rotor" in design.parts and "balancing" in design.parts)
            if rotor
            else design.compressor
        ):
            names[name] = entry.doc
    if design.compressor is not None:
        for family in ("loss_power", "peak_force", "mean_force"):
            names[f"{family}.<joint>"] = _FAMILIES[family][2]
    if "vibration" in names:
        for target in design.parts["balancing"].targets:  # pyright: ignore[reportAttributeAccessIssue]
            names[f"vibration.{target.name}"] = _FAMILIES["vibration"][2]
    return names


def quantity(name: str) -> Quantity:
    """A quantity by name.

    Raises:
        BadInput: no such quantity.
    """
    if name in _PLAIN:
        return _PLAIN[name]
    family, _, member = name.partition(".")
    if family not in _FAMILIES or not member:
        raise BadInput("quantity", name, f"one of {', '.join(_PLAIN)}, or <family>.<member> of "
                       f"{', '.join(_FAMILIES)}{hint(name, _PLAIN)}")  # fmt: skip
    unit, better, doc = _FAMILIES[family]
    return Quantity(name, unit, better, doc, lambda found: _member(found, family, member))


def _member(found: DesignResult, family: str, member: str):
    if family == "vibration":
        places = places_of(found.assembly)
        numbers = [
            number
            for number, name in enumerate(t.name for t in places.targets for _ in t.axes)
            if name == member
        ]
        if not numbers:
            names = [target.name for target in places.targets]
            raise BadInput("vibration", member, one_of(member, names))
        return jnp.sqrt(_mean_square(found, jnp.array(numbers)))
    orbit = found.orbit
    if family == "loss_power":
        known = {name: work / orbit.period for name, work in orbit.energy.losses.items()}
    else:
        known = orbit.peak_forces if family == "peak_force" else orbit.mean_forces
    if member not in known:
        raise BadInput(family, member, one_of(member, known))
    return known[member]


def _balanced(found: DesignResult):
    influence = found.influence
    left = influence.weight * influence.vibration(least_squares(influence).correction)
    return jnp.sqrt(jnp.sum(jnp.abs(left) ** 2) / jnp.sum(influence.weight**2))
