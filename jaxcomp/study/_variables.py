r"""The numbers of a machine that a study changes: by name, by pattern, and in words for people."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import ANY, NONNEGATIVE, Bound, Part, at, plausible, quantities, rebuilt
from .._core.words import hint
from ..crankshaft._crankshaft import OF_ROTOR
from ..fluid import Mixture
from ..machine import Machine, follows_rotor
from ._rules import design_rules

_Entry = TypeVar("_Entry")

CORRECTIONS = "corrections"
# Sections of parts that have names, and those with names that the user gave.
_NAMED = ("bearings", "oils")
SECTIONS = (CORRECTIONS, *_NAMED)
# Of a component of a mixture: one alone would leave nothing for the others.
_SHARE = Bound(0.0, 1.0, high_open=True)
# Polar coordinates of a correction, with unit and bound.
_POLAR = {"magnitude": ("kg m", NONNEGATIVE), "angle": ("rad", ANY)}


class Variable(NamedTuple):
    """One number of a design, with the range it may take.

    Attributes:
        name: of a rule in `design_rules` (the machine follows as a whole), or the dotted path of a
            number as in a machine file ("mechanism.conrod_length", "rotor.links.3.law.stiffness.0",
            "corrections.rotor-top.x", or .y, .magnitude, .angle; "gas.fluid.mass_fractions.R32", whose
            rise lowers those of the other components in proportion). A path to a list of numbers is
            a common factor on all of them, which is 1 as the design stands.
        low, high: [SI] in the unit of the number.
        unit: SI unit, `""` for pure numbers and factors.
        bound: what the number must keep in any case.
    """

    name: str
    low: float
    high: float
    unit: str
    bound: Bound

    @property
    def without_range(self) -> "Variable":
        """The variable without its range, as programs of any range share it."""
        return self._replace(low=0.0, high=0.0, bound=ANY)

    def current(self, design: Machine) -> Float[Array, ""]:
        """[SI] The value in a design."""
        if self.name in design_rules:
            return design_rules[self.name].current(design)
        plane, polar = _polar(self.name)
        if polar:
            return _polar_of(design.corrections[plane])[polar == "angle"]
        if (fraction := _fraction(design, self.name)) is not None:
            return fraction.fluid.fraction(fraction.kind, fraction.component)
        value = walk(design, _steps(self.name))
        if jnp.ndim(value) == 0:
            return value
        return jnp.ones(())

    def apply(self, design: Machine, value: Float[Array, ""]) -> Machine:
        """The design with another value [SI]; unchecked, as everything that may run inside `jit`."""
        if self.name in design_rules:
            return design_rules[self.name].apply(design, value)
        plane, polar = _polar(self.name)
        if polar:
            magnitude, angle = _polar_of(design.corrections[plane])
            if polar == "angle":
                angle = value
            else:
                magnitude = value
            new = magnitude * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
            return eqx.tree_at(lambda d: d.corrections[plane], design, new)
        if _fraction(design, self.name) is not None:
            return changed(design, [self], [value])
        steps = _steps(self.name)
        place = steps
        is_entry = steps[-1].isdigit() and eqx.is_array(walk(design, steps[:-1]))
        if is_entry:
            place = steps[:-1]
        old = walk(design, place)
        if is_entry:
            new = old.at[int(steps[-1])].set(value)
        elif jnp.ndim(old) == 0:
            new = jnp.asarray(value, float)
        else:
            new = old * value
        return eqx.tree_at(lambda d: walk(d, place), design, new)


@runtime_checkable
class Changes(Protocol):
    """Change of a design by one number: a variable, or a factor common to several."""

    def apply(self, design: Machine, value: Float[Array, ""]) -> Machine:
        """The design with another value."""
        ...


def changed(
    design: Machine, variables: Sequence[Changes], values: Float[Array, " variables"] | Sequence
) -> Machine:
    """The design with values [SI] of some variables, set in their order; unchecked.

    Fractions of one mixture are set together, and those of its other components go in proportion.

    Args:
        design: the design.
        variables: what is changed.
        values: [SI] one for each of them; more are not looked at.
    """
    mixtures: dict[tuple[str, ...], dict[str, Any]] = {}
    kinds: dict[tuple[str, ...], str] = {}
    for number, change in enumerate(variables):
        fraction = None
        if isinstance(change, Variable):
            fraction = _fraction(design, change.name)
        if fraction is None:
            design = change.apply(design, values[number])
        else:
            place = fraction.place
            if kinds.setdefault(place, fraction.kind) != fraction.kind:
                bound = f"{kinds[place]}, as the other fractions of the mixture"
                raise BadInput(fraction.component, fraction.kind, bound)
            mixtures.setdefault(place, {})[fraction.component] = values[number]
    for place, fractions in mixtures.items():
        fluid = walk(design, place).with_fractions(kinds[place], fractions)
        design = _with_part(design, place, fluid)
    return design


def current_values(design: Machine, variables: Sequence[Variable]) -> Float[Array, " variables"]:
    """[SI] Values of some variables in a design.

    Args:
        design: the design.
        variables: in the order of their values.
    """
    values = []
    for variable in variables:
        values.append(jnp.asarray(variable.current(design), float))
    return jnp.stack(values)


def _with_part(design: Machine, place: Sequence[str], part: Part) -> Machine:
    """The design with another part of the same type, whose static fields may differ."""
    *above, name = place
    owner = walk(design, above)
    # Built anew, because `tree_at` would keep the static fields of the part that was there.
    owner = rebuilt(owner, **{name: part})
    if above:
        return _with_part(design, above, owner)
    return rebuilt(design, compressor=owner)


def variable(
    design: Machine, name: str, low: float | None = None, high: float | None = None
) -> Variable:
    """A variable of a design, looked up and checked.

    Args:
        design: the design it belongs to.
        name: as in `Variable`.
        low, high: [SI] the range; the bounds of the number itself if absent.

    Raises:
        BadInput: no such number, or a range that is empty or outside the number's bounds.
    """
    if name in design_rules:
        rule = design_rules[name]
        unit = rule.unit
        bound = rule.bound
        rule.current(design)  # refuses a machine for which it is not made
        steps = rule.entry.split(".")
    else:
        unit, bound = _declared(design, name)
        steps = _steps(name)
        if _follows(design, name):
            raise BadInput(
                name, "derived", "a number that is given: this one follows from the rotor"
            )
    limit = plausible(bound, unit, _usual(design, steps))
    for end in (low, high):
        if isinstance(end, str):
            raise BadInput(name, f'"{end}"', f"a range of numbers in {unit or 'SI units'}")
        if end is not None and not bool(limit.holds(end)):
            raise BadInput(name, end, f"{limit} {unit}".rstrip())
    low = bound.low if low is None else float(low)
    high = bound.high if high is None else float(high)
    if not low <= high:
        raise BadInput(name, f"({low:g}, {high:g})", "a range (low, high), the lower end first")
    return Variable(name=name, low=low, high=high, unit=unit, bound=limit)


def variable_names(design: Machine) -> list[str]:
    """All names that `variable` takes, but for the single entries of lists."""
    names = []
    for name, rule in design_rules.items():
        try:
            rule.current(design)
        except BadInput:
            continue
        names.append(name)
    for path, tree in _roots(design).items():
        for number in _numbers(tree):
            names.append(f"{path}{number}")
    names = [name for name in names if not _follows(design, name)]
    for plane in design.corrections:
        for axis in ("x", "y", *_POLAR):
            names.append(f"{CORRECTIONS}.{plane}.{axis}")
    return names


def matching(design: Machine, path: str) -> list[str]:
    """Names of the numbers that a path stands for.

    A pattern, in which `*` stands for any part of a name, fits single numbers, the entries of lists,
    or else lists as a whole; any other path stands for itself.

    Raises:
        BadInput: it fits none.
    """
    if not any(sign in path for sign in "*?["):
        variable(design, path)  # raises what is no number
        return [path]
    matches = []
    for name in variable_names(design):
        fitting = []
        for number in range(list_length(design, name)):
            entry = f"{name}.{number}"
            if fnmatchcase(entry, path):
                fitting.append(entry)
        if not fitting and fnmatchcase(name, path):
            fitting = [name]
        matches += fitting
    if not matches:
        meant = hint(path, variable_names(design))
        raise BadInput(path, path, f"a pattern that fits a number of this machine{meant}")
    return matches


def by_name(design: Machine, entries: Mapping[str, _Entry]) -> dict[str, _Entry]:
    """Entries given by path or pattern, by name of the number; where several fit, the last counts.

    Raises:
        BadInput: see `matching`.
    """
    by_number = {}
    for path, value in entries.items():
        by_number |= dict.fromkeys(matching(design, path), value)
    return by_number


def list_length(design: Machine, name: str) -> int:
    """Entries of a list of numbers; 0 for a number."""
    if name in design_rules or name.startswith(f"{CORRECTIONS}.") or is_fraction(design, name):
        return 0
    value = walk(design, name.split("."))
    if jnp.ndim(value) == 0:
        return 0
    return len(value)


_FRACTIONS = ("mass_fractions", "mole_fractions")


class _Fraction(NamedTuple):
    """Fraction of a component of a mixture.

    Attributes:
        fluid: the mixture.
        place: path of the mixture.
        kind: "mass_fractions" or "mole_fractions".
        component: as it is named in the mixture.
    """

    fluid: Mixture
    place: tuple[str, ...]
    kind: str
    component: str


def _fraction(design: Machine, name: str) -> _Fraction | None:
    """The fraction that a name stands for; `None` if it is of something else.

    Raises:
        LookupError: a component that the mixture is without.
    """
    *place, kind, component = ["", *_steps(name)]
    if kind not in _FRACTIONS:
        return None
    place = place[1:]
    fluid = walk(design, place)
    if not isinstance(fluid, Mixture):
        return None
    components = fluid.components or ()
    return _Fraction(
        fluid=fluid,
        place=tuple(place),
        kind=kind,
        component=components[fluid.place_of(component)],
    )


def is_fraction(design: Machine, name: str) -> bool:
    """Whether a name stands for the fraction of a component of a mixture."""
    try:
        return _fraction(design, name) is not None
    except LookupError:
        return False


def _follows(design: Machine, name: str) -> bool:
    section, *path = name.split(".")
    fields = path[:1]
    # of a throw what stands behind "throws" and its number
    if fields == ["throws"]:
        fields = path[2:]
    if section != "crankshaft" or {*OF_ROTOR, "position"}.isdisjoint(fields):
        return False
    return follows_rotor(design)


def _polar(name: str) -> tuple[str, str]:
    """Plane and polar coordinate of a correction that is named by one; twice `""` otherwise."""
    root, _, path = name.partition(".")
    plane, _, polar = path.rpartition(".")
    if root == CORRECTIONS and polar in _POLAR:
        return (plane, polar)
    return ("", "")


def _polar_of(xy: Float[Array, "2"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Magnitude and angle; at zero, where neither has a derivative, that of the x axis."""
    some = jnp.any(xy != 0)
    # Double where: neither `hypot` nor `arctan2` has a derivative at zero.
    safe = jnp.where(some, xy, jnp.array([1.0, 0.0]))
    magnitude = jnp.hypot(safe[0], safe[1])
    angle = jnp.arctan2(safe[1], safe[0])
    return jnp.where(some, magnitude, xy[0]), jnp.where(some, angle, 0.0)


def _numbers(tree: Part | tuple) -> Iterator[str]:
    """Paths of all numbers in a part, in the order of its fields."""
    if isinstance(tree, Mixture):
        for component in tree.components or ():
            yield f"{_FRACTIONS[0]}.{component}"
        return
    if isinstance(tree, tuple):
        children = enumerate(tree)
    else:
        children = [(field.name, getattr(tree, field.name)) for field in dataclasses.fields(tree)]
    for name, child in children:
        if eqx.is_array(child):
            yield str(name)
            continue
        parts = child
        if not isinstance(child, tuple):
            parts = (child,)
        if any(isinstance(part, Part) for part in parts):
            for path in _numbers(child):
                yield f"{name}.{path}"


def _roots(design):
    out = {}
    if design.compressor is not None:
        out = {"": design.compressor}
    for section in _NAMED:
        for name, part in getattr(design, section).items():
            out[f"{section}.{name}."] = part
    for name, part in design.parts.items():
        out[f"{name}."] = part
    return out


def _steps(name: str) -> list[str]:
    steps = name.split(".")
    if steps[0] == CORRECTIONS and len(steps) == 3 and steps[2] in ("x", "y"):
        steps[2] = str("xy".index(steps[2]))
    return steps


def walk(design: Machine, steps: Sequence[str]) -> Any:
    """The object at the end of a path; raises `LookupError` at a step that leads nowhere."""
    if not steps:
        return design.compressor
    sections = {name: getattr(design, name) for name in SECTIONS} | design.parts
    section, *path = steps
    if section in sections:
        return at(sections[section], path)
    return at(design.compressor, steps)


def _declared(design: Machine, name: str) -> tuple[str, Bound]:
    """Unit and bound of the number at the end of a path."""
    plane, polar = _polar(name)
    if polar and plane in design.corrections:
        return _POLAR[polar]
    steps = _steps(name)
    try:
        if _fraction(design, name) is not None:
            return "", _SHARE
        value = walk(design, steps)
        if steps[0] == CORRECTIONS:
            if jnp.ndim(value) > 0:
                raise LookupError(name)
            return "kg m", ANY
        if not eqx.is_array(value):
            raise LookupError(name)
        field = _field(design, steps)
    except LookupError:
        meant = hint(name, variable_names(design))
        bound = f"a design rule or the dotted path of a number{meant}"
        raise BadInput(name, name, bound) from None
    if jnp.ndim(value) > 0:
        return "", ANY
    return field.metadata["unit"], field.metadata["bound"]


def _usual(design: Machine, steps: list[str]) -> tuple[float, float] | None:
    """[SI] Usual range of a number, if its field declares one."""
    try:
        return _field(design, steps).metadata["usual"]
    except (LookupError, TypeError):  # corrections, and rules that no field stands for
        return None


def _field(design: Machine, steps: list[str]) -> dataclasses.Field:
    """The declaration of the number, or of the list that it is an entry of."""
    holder = steps[:-1]
    while eqx.is_array(owner := walk(design, holder)):
        holder = holder[:-1]
    return dict(quantities(owner))[steps[len(holder)]]


def _given_fraction(name: str, fraction: _Fraction) -> "GivenNumber":
    """A fraction as a number: its rise by one moves the others down in proportion."""
    fluid = fraction.fluid
    value = float(fluid.fraction(fraction.kind, fraction.component))
    w = np.asarray(fluid.mass_fractions)
    up = np.eye(w.size)[fluid.place_of(fraction.component)]
    weight = (up - w) / (1 - value)
    return GivenNumber(
        name=name,
        unit="",
        bound=_SHARE,
        value=value,
        weight=weight,
        place=(*fraction.place, fraction.kind),
    )


class GivenNumber(NamedTuple):
    """One number of a machine file, with what it is in the machine.

    Attributes:
        name: as in `Variable`.
        unit: SI unit; "" for a common factor.
        bound: what the number must keep.
        value: [SI] in the design.
        weight: what a change of it by one changes in the entries of the array that holds it.
        place: of that array, for `at`.
        factor: whether it is a common factor on the entries of a list.
    """

    name: str
    unit: str
    bound: Bound
    value: float
    weight: np.ndarray
    place: tuple[str, ...]
    factor: bool = False

    def at(self, design: Machine) -> Array:
        """The array in a design, or in a tree of derivatives of the same build."""
        return walk(design, list(self.place))

    def moved(self, design: Machine, value: float) -> Machine:
        """The design with another value [SI] of this number; unchecked.

        Args:
            design: of the build that the number was taken from, with other numbers perhaps.
            value: [SI]
        """
        if is_fraction(design, self.name):
            return changed(design, [variable(design, self.name)], [value])
        old = np.asarray(self.at(design))
        new = np.where(self.weight != 0, value, old)
        if self.factor:
            new = self.weight * value
        steps = list(self.place)
        return eqx.tree_at(lambda d: walk(d, steps), design, jnp.asarray(new, float))


# A longer list of numbers, such as an indicator diagram, counts as one number: a factor on all.
_LIST = 24


def given_numbers(design: Machine) -> Iterator[GivenNumber]:
    """Every number of a design by itself, without design rules and polar coordinates.

    A column of a table in which all rows have one value is one number, a long list a factor.
    """
    for plane, value in design.corrections.items():
        for axis, weight in zip("xy", np.eye(2), strict=True):
            name = f"{CORRECTIONS}.{plane}.{axis}"
            yield GivenNumber(
                name=name,
                unit="kg m",
                bound=ANY,
                value=float(weight @ value),
                weight=weight,
                place=(CORRECTIONS, plane),
            )
    for name in variable_names(design):
        if name in design_rules or name.startswith(f"{CORRECTIONS}."):
            continue
        if (fraction := _fraction(design, name)) is not None:
            yield _given_fraction(name, fraction)
            continue
        place = tuple(_steps(name))
        values = np.asarray(walk(design, list(place)))
        field = _field(design, list(place))
        by_itself = partial(
            GivenNumber, unit=field.metadata["unit"], bound=field.metadata["bound"], place=place
        )
        same = values.size and np.all(values == values.flat[0])
        if values.ndim == 0 or (field.metadata["spread"] and same):
            weight = np.ones(values.shape)
            yield by_itself(name=name, value=float(values.flat[0]), weight=weight)
        elif values.ndim == 1 and len(values) <= _LIST:
            for number, weight in enumerate(np.eye(len(values))):
                value = float(values[number])
                yield by_itself(name=f"{name}.{number}", value=value, weight=weight)
        else:
            yield GivenNumber(
                name=name, unit="", bound=ANY, value=1.0, weight=values, place=place, factor=True
            )
