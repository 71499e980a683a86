r"""One machine: every number of it once, and what the parts of the physics make of it.

A `Machine` is the description. Bearings and oils stand in it by name, and friction joints and rotor
links refer to them; the crankshaft follows from the rotor where there is one; correction masses are
unbalances of both. `assembled` puts all this together: a compressor with the laws of its joints, and
a rotor with its films and loads, in which one number of the description acts wherever it belongs.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._core.errors import BadInput, no_machine
from ._core.fields import Part, names_with_value, rebuilt
from ._core.printed import printed
from ._core.words import one_of
from .compressor import Compressor, staged
from .film import AbstractJournal, AbstractOil, NamedBearing

if TYPE_CHECKING:  # a compressor alone does not import the rotor
    from .rotor import BalancingPlanes, LoadCase, PeriodicForce, RotorModel, Unbalances

# what users take; the rest is for the packages that are built on this module
__all__ = ["Assembly", "Machine", "assembled"]


@names_with_value
class Machine(eqx.Module):
    """All numbers of a machine, each once.

    Attributes:
        compressor: the machine as the crank sees it, with names for bearings and oils, and without
            what follows from the rotor; `None` where there is none.
        parts: rotor, loads, balancing planes, suspension: the other sections of a scene, by name.
        corrections: [kg m] (x, y) unbalance added in each correction plane, by name of the plane.
        bearings: by name.
        oils: by name.
    """

    compressor: Compressor | None
    parts: dict[str, Part] = eqx.field(default_factory=dict)
    corrections: dict[str, Float[Array, "2"]] = eqx.field(default_factory=dict)
    bearings: dict[str, AbstractJournal] = eqx.field(default_factory=dict)
    oils: dict[str, AbstractOil] = eqx.field(default_factory=dict)

    def __repr__(self) -> str:
        return printed(self)

    def as_compressor(self) -> Compressor:
        """The compressor put together, as the solvers of the crank take it.

        Raises:
            BadInput: a machine without one.
        """
        compressor = assembled(self).compressor
        if compressor is None:
            raise BadInput("compressor", "absent", "given: this machine has none")
        return compressor


class Assembly(NamedTuple):
    """A machine as the solvers take it.

    Attributes:
        compressor: with the law of every joint and the crankshaft of the rotor; `None` without one.
        rotor: with the bearing of every film; `None` without one.
        loads: of the rotor; `None` without any.
        corrections: of the correction masses, on the rotor.
        balancing: correction planes and targets; `None` without them.
    """

    compressor: Compressor | None
    rotor: "RotorModel | None"
    loads: "LoadCase | None"
    corrections: tuple["Unbalances", ...]
    balancing: "BalancingPlanes | None"

    @property
    def unbalances(self) -> tuple["Unbalances", ...]:
        """All of them, the corrections with them."""
        if self.loads is None:
            return self.corrections
        return (*self.loads.unbalances, *self.corrections)

    @property
    def given_loads(self) -> tuple["Unbalances | PeriodicForce", ...]:
        """Unbalances, corrections and the periodic forces that the scene gives."""
        if self.loads is None:
            return self.unbalances
        return (*self.unbalances, *self.loads.forces)

    def excitation(self, given: str | None = None) -> Literal["crank", "file"]:
        """Source of the forces on the rotor: those of the file, or those of the crank's periodic state.

        Args:
            given: "file" or "crank"; absent: the scene's if it has any or no crank joined to the rotor.

        Raises:
            BadInput: another word, or the crank where none is joined to the rotor.
        """
        case = self.loads
        joined = case is not None and case.crank is not None and self.compressor is not None
        if given == "file" or (given is None and not (joined and case and not case.forces)):
            return "file"
        if given not in ("crank", None):
            raise BadInput("excitation", given, "'crank' or 'file'")
        if not joined:
            raise BadInput("excitation", "crank", "'file' for a machine without loads.crank")
        return "crank"


def follows_rotor(machine: Machine) -> bool:
    """Whether the crankshaft of a machine is that of its rotor: where `loads.crank` joins the two."""
    joined: Any = machine.parts.get("loads")
    return "rotor" in machine.parts and joined is not None and joined.crank is not None


@runtime_checkable
class HasMachine(Protocol):
    """Protocol of what verbs of a whole machine take beside a machine: a scene of `jaxcomp.load`."""

    @property
    def machine(self) -> Machine:
        """The machine."""
        ...


def machine_of(scene: Machine | HasMachine) -> Machine:
    """The machine of a scene, or a machine itself.

    Args:
        scene: of `jaxcomp.load`; anything with an attribute `machine`; or a machine.

    Raises:
        BadInput: something else, such as the name of a file.
    """
    if isinstance(scene, Machine):
        return scene
    if not hasattr(scene, "machine"):
        raise no_machine(scene)
    return scene.machine


def correction_planes(places: "BalancingPlanes | None") -> tuple[str, ...]:
    """Names of the correction planes of a section `balancing`, which may be absent."""
    if places is None:
        return ()
    return tuple(plane.name for plane in places.planes)


def assembled(machine: Machine) -> Assembly:
    """Put a machine together; differentiable in all its numbers.

    Args:
        machine: the description.

    Raises:
        BadInput: a bearing or oil that nobody describes, or a crankshaft that is given twice or not
            at all.
    """
    parts: Any = machine.parts
    # Bearings first take their oils, then parts take the bearings.
    oils = _Names({}, machine.oils)
    bearings = {name: _resolved(journal, oils) for name, journal in machine.bearings.items()}
    names = _Names(bearings, machine.oils)
    rotor = parts.get("rotor")
    case = parts.get("loads")
    places = parts.get("balancing")
    corrections = _corrections(places, machine.corrections)
    compressor = machine.compressor
    if compressor is not None and follows_rotor(machine):
        from .rotor import crankshaft_of

        unbalances = (*case.unbalances, *corrections)
        # While bearings still have names, by which `crankshaft_of` finds their places on the rotor.
        shaft = crankshaft_of(rotor, compressor.crankshaft, unbalances, case.crank.pins)
        compressor = rebuilt(compressor, crankshaft=shaft)
    if compressor is not None:
        compressor = staged(_resolved(compressor, names))
    if rotor is not None:
        rotor = _resolved(rotor, names, "rotor")
    return Assembly(
        compressor=compressor,
        rotor=rotor,
        loads=case,
        corrections=corrections,
        balancing=places,
    )


def _corrections(
    places: "BalancingPlanes | None", masses: Mapping[str, Float[Array, "2"]]
) -> tuple["Unbalances", ...]:
    """Unbalances of the correction masses that planes of a section `balancing` have."""
    if places is None:
        return ()
    planes = [plane for plane in places.planes if plane.name in masses]
    return tuple(correction_unbalance(plane.node, masses[plane.name]) for plane in planes)


def assembly_of(machine: Machine | HasMachine | Assembly) -> Assembly:
    """The machine of what a verb of a whole machine was given, put together if it is not yet."""
    return machine if isinstance(machine, Assembly) else assembled(machine_of(machine))


def correction_unbalance(node, value: Float[Array, "2"]) -> "Unbalances":
    """The unbalance (x, y) [kg m] of a correction mass on a node.

    Two signed unbalances along x and y: smooth at zero, where magnitude and phase are not.
    """
    from .rotor import Unbalances

    two = Unbalances((node, node), jnp.zeros(2), jnp.array([0.0, jnp.pi / 2]))
    return eqx.tree_at(lambda u: u.magnitude, two, value)


class _Names(NamedTuple):
    bearings: Mapping[str, AbstractJournal]
    oils: Mapping[str, AbstractOil]


def _undescribed(path: str, name: str, kind: str, described: Mapping[str, Any]) -> BadInput:
    """The complaint about a name of a bearing or an oil that no section describes."""
    expected = f"the name of a section [{kind}s.NAME]"
    if described:
        expected = f"{one_of(name, described)} of [{kind}s]"
    return BadInput(path, name, f"{expected}; [{kind}s.{name}] would describe it")


def _resolved(node: Any, names: _Names, path: str = "") -> Any:
    """A part with the bearings and viscosities that it names; itself where it names none."""
    if isinstance(node, NamedBearing):
        if node.name not in names.bearings:
            raise _undescribed(path, node.name, "bearing", names.bearings)
        return names.bearings[node.name]
    changes = {}
    for name, child in _children(node):
        new = _resolved(child, names, f"{path}.{name}" if path else name)
        if new is not child:
            changes[name] = new
    oil = getattr(node, "oil", None) if isinstance(node, Part) else None
    if oil is not None and getattr(node, "dynamic_viscosity", None) is None:
        if oil not in names.oils:
            raise _undescribed(f"{path}.oil", oil, "oil", names.oils)
        changes["dynamic_viscosity"] = names.oils[oil].dynamic_viscosity
    # The same object, by which its holder sees that nothing changed.
    if not changes:
        return node
    if isinstance(node, tuple):
        return tuple(changes.get(str(i), child) for i, child in enumerate(node))
    return rebuilt(node, **changes)


def _children(node: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(node, Part):
        for field in dataclasses.fields(node):
            yield field.name, getattr(node, field.name)
    elif isinstance(node, tuple):
        for place, child in enumerate(node):
            yield str(place), child
