r"""One machine: every number of it once, and what the parts of the physics make of it.

A `Machine` is the description. Bearings and oils stand in it by name, and friction joints and rotor
links refer to them; the crankshaft follows from the rotor where there is one; correction masses are
unbalances of both. `assembled` puts all this together: a compressor with the laws of its joints, and
a rotor with its films and loads, in which one number of the description acts wherever it belongs.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._fields import BadInput, Part, is_traced, no_machine, printed, replaced
from ._words import one_of
from .compressor import Compressor, staged
from .film import AbstractJournal, AbstractOil, NamedBearing
from .friction import MainBearings
from .mechanism import Cylinders, SliderLink

if TYPE_CHECKING:  # a compressor alone does not import the rotor
    from .rotor import BalancingPlanes, LoadCase, PeriodicForce, RotorModel, Unbalances


# Numbers of the mechanism that follow from the rotor of the same machine.
OF_ROTOR = (
    "crank_inertia",
    "crank_mass",
    "crank_unbalance",
    "crank_unbalance_across",
    "crank_couple",
    "crank_eccentricity",
    "crank_product",
    "crank_product_across",
)
# Those of a slider-link as well where the rotor has its bearings.
OF_ROTOR_BEARINGS = ("overhang", "bearing_span")
# Numbers of several cylinders that do.
OF_ROTOR_CYLINDERS = ("position", "rod_pitch", "throw_pitch", "unbalance", "places", "couple")


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
        made = assembled(self).compressor
        if made is None:
            raise BadInput("compressor", "absent", "given: this machine has none")
        return made


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
        return (*(self.loads.unbalances if self.loads else ()), *self.corrections)

    @property
    def given_loads(self) -> tuple["Unbalances | PeriodicForce", ...]:
        """Unbalances, corrections and the periodic forces that the scene gives."""
        return (*self.unbalances, *(self.loads.forces if self.loads else ()))

    def excitation(self, given: str | None = None) -> Literal["crank", "file"]:
        """What shakes the rotor: the forces of the scene, or those of the crank's periodic state.

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
            raise BadInput("excitation", "crank", "'file' for a scene without loads.crank")
        return "crank"


def follows_rotor(machine: Machine) -> bool:
    """Whether the crankshaft of a machine is that of its rotor: where `loads.crank` joins the two."""
    joined: Any = machine.parts.get("loads")
    return "rotor" in machine.parts and joined is not None and joined.crank is not None


def machine_of(scene: Any) -> Machine:
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


def correction_planes(places: Any) -> tuple[str, ...]:
    """Names of the correction planes of a section `balancing`, which may be absent."""
    return tuple(plane.name for plane in places.planes) if places is not None else ()


def assembled(machine: Machine) -> Assembly:
    """Put a machine together; differentiable in all its numbers.

    Args:
        machine: the description.

    Raises:
        BadInput: a bearing or oil that nobody describes, or a crankshaft that is given twice or not
            at all.
    """
    parts: Any = machine.parts
    names = _Names(
        {name: _filled(one, _Names({}, machine.oils)) for name, one in machine.bearings.items()},
        machine.oils,
    )
    rotor, case, places = (parts.get(name) for name in ("rotor", "loads", "balancing"))
    corrections = tuple(
        correction_unbalance(plane.node, machine.corrections[plane.name])
        for plane in (places.planes if places else ())
        if plane.name in machine.corrections
    )
    compressor = machine.compressor
    if compressor is not None and follows_rotor(machine):
        unbalances = (*case.unbalances, *corrections)
        if isinstance(compressor.mechanism, SliderLink):
            rotor = _with_joints(rotor, compressor.friction)
        compressor = _with_rotor(compressor, rotor, unbalances, case.crank.pins)
    return Assembly(
        None if compressor is None else staged(_filled(compressor, names)),
        None if rotor is None else _filled(rotor, names, "rotor"),
        case,
        corrections,
        places,
    )


def correction_unbalance(node, value: Float[Array, "2"]) -> "Unbalances":
    """The unbalance (x, y) [kg m] of a correction mass on a node.

    Two signed unbalances along x and y: smooth at zero, where magnitude and phase are not.
    """
    from .rotor import Unbalances

    two = Unbalances((node, node), jnp.zeros(2), jnp.array([0.0, jnp.pi / 2]))
    return eqx.tree_at(lambda u: u.magnitude, two, value)


def _with_rotor(compressor: Compressor, rotor, unbalances, pins) -> Compressor:
    """The compressor with the crankshaft that its rotor is, and its bearings where they stand.

    Places along the shaft count from the node of the first rod.
    """
    from .crankshaft import axial_positions, bearing_positions, crankshaft, shaft_bearings

    mechanism, cylinders, pin = compressor.mechanism, compressor.cylinders, pins[0]
    if len(pins) != (1 if cylinders is None else cylinders.count):
        count = "one node" if cylinders is None else f"a list of {cylinders.count} nodes"
        raise BadInput("loads.crank.pin", str(pins), f"{count}, one for each cylinder")
    linked, friction = isinstance(mechanism, SliderLink), compressor.friction
    if not (linked or hasattr(mechanism, "crank_couple")):
        kind = type(mechanism).__name__
        raise BadInput("mechanism", kind, "a slider_crank or slider_link, for the loads of a rotor")
    stand = bearing_positions(rotor, pin)
    on_films = linked and all(name in stand for name in _shaft_bearings(friction))
    for name in reversed(OF_ROTOR + OF_ROTOR_BEARINGS * on_films):
        value = getattr(mechanism, name, None)
        if value is not None and (name == "crank_inertia" or _given(value)):
            bound = "absent: it follows from the rotor that `loads.crank` joins to the crank"
            raise BadInput(f"mechanism.{name}", value, bound)
    shaft = crankshaft(rotor, unbalances, pin)
    mechanism = replaced(mechanism, crank_inertia=shaft.inertia, crank_mass=shaft.mass)
    if on_films:
        upper, lower = (stand[name] for name in _shaft_bearings(friction))
        if not is_traced(lower) and not 0 <= float(upper) < float(lower):
            bound = (
                "the upper bearing behind the pin and the lower one behind that, along the shaft"
            )
            raise BadInput("loads.crank.pin", str(pins), bound)
        mechanism = replaced(mechanism, overhang=upper, bearing_span=lower - upper)
    if cylinders is None and linked:
        mechanism = replaced(
            mechanism,
            crank_eccentricity=-shaft.unbalance[0] / shaft.mass,
            crank_product=shaft.couple[0],
            crank_unbalance_across=shaft.unbalance[1],
            crank_product_across=shaft.couple[1],
        )
    elif cylinders is None:
        mechanism = replaced(
            mechanism,
            crank_unbalance=shaft.unbalance[0],
            crank_unbalance_across=shaft.unbalance[1],
            crank_couple=shaft.couple,
        )
    else:
        along = axial_positions(rotor, pin)
        places = jnp.stack([along[node] for node in pins])
        cylinders = _on_rotor(cylinders, places, shaft)
    support = getattr(friction, "main_journal", None)
    if isinstance(support, MainBearings) and support.position is None:
        for name in support.names or ():
            if len(support.bearings) > 1 and name not in stand:
                bound = one_of(name, stand) + ", the bearings of the rotor's links"
                raise BadInput("friction.main_journal.bearings", name, bound)
        position = jnp.stack([jnp.asarray(stand.get(n, 0.0)) for n in support.names or ()])
        support = replaced(support, position=position)
        if support.shaft == "rotor" and len(support.bearings) > 2:
            support = shaft_bearings(rotor, support, pin)
        friction = _rebuilt(friction, {"main_journal": support})
    return replaced(compressor, mechanism=mechanism, friction=friction, cylinders=cylinders)


def _shaft_bearings(friction) -> tuple[str, ...]:
    """Names of upper and lower bearing of a slider-link machine; "" for one without a name."""
    laws = (getattr(friction, joint, None) for joint in ("upper_bearing", "lower_bearing"))
    return tuple(law.name if isinstance(law, NamedBearing) else "" for law in laws)


def _with_joints(rotor, friction):
    """The rotor, its films named as the joints of a slider-link machine that they are."""
    joints = dict(zip(_shaft_bearings(friction), ("upper_bearing", "lower_bearing"), strict=True))
    links = tuple(
        _rebuilt(link, {"law": _rebuilt(link.law, {"name": joints[link.law.name]})})
        if getattr(link.law, "name", None) in joints
        else link
        for link in rotor.links
    )
    return eqx.tree_at(lambda r: r.links, rotor, links)


def _on_rotor(cylinders: Cylinders, places, shaft) -> Cylinders:
    """The cylinders with the places and unbalances of their rotor."""
    bound = "absent: it follows from the rotor that `loads.crank` joins to the crank"
    for number, throw in enumerate(cylinders.throws):
        for name in ("position", "rod_pitch", "unbalance"):
            if _given(getattr(throw, name)):
                raise BadInput(f"cylinders.throws.{number}.{name}", getattr(throw, name), bound)
    for name in ("throw_pitch", "rod_pitch", "balanced", "places", "unbalance", "couple"):
        value = getattr(cylinders, name)
        if value is not None and _given(value):
            raise BadInput(f"cylinders.{name}", value, bound)
    return replaced(cylinders, places=places, unbalance=shaft.unbalance, couple=shaft.couple)


def _given(value) -> bool:
    return not is_traced(value) and bool(np.any(np.asarray(value) != 0))


class _Names(NamedTuple):
    bearings: Mapping[str, AbstractJournal]
    oils: Mapping[str, AbstractOil]


def _filled(node: Any, names: _Names, path: str = "") -> Any:
    """A part with the bearings and viscosities that it names; itself where it names none."""
    if isinstance(node, NamedBearing):
        if node.name not in names.bearings:
            raise BadInput(path, node.name, one_of(node.name, names.bearings) + " of [bearings]")
        return names.bearings[node.name]
    changes = {}
    for name, child in _children(node):
        new = _filled(child, names, f"{path}.{name}" if path else name)
        if new is not child:
            changes[name] = new
    oil = getattr(node, "oil", None) if isinstance(node, Part) else None
    if oil is not None and getattr(node, "dynamic_viscosity", None) is None:
        if oil not in names.oils:
            raise BadInput(f"{path}.oil", oil, one_of(oil, names.oils) + " of [oils]")
        changes["dynamic_viscosity"] = names.oils[oil].dynamic_viscosity
    if not changes:
        return node
    if isinstance(node, tuple):
        return tuple(changes.get(str(i), child) for i, child in enumerate(node))
    return _rebuilt(node, changes)


def _children(node: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(node, Part):
        yield from ((f.name, getattr(node, f.name)) for f in dataclasses.fields(node))
    elif isinstance(node, tuple):
        yield from ((str(i), child) for i, child in enumerate(node))


def _rebuilt(part: Part, changes: Mapping[str, Any]) -> Part:
    """A copy with other fields, of other types as well, made as JAX makes one from its leaves."""
    new = object.__new__(type(part))
    for field in dataclasses.fields(part):
        value = changes.get(field.name, getattr(part, field.name))
        object.__setattr__(new, field.name, value)
    return new
