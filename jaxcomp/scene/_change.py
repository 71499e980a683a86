"""A scene with other values: set in the tables of its file, or taken from a changed machine."""

import contextlib
import copy
from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core.errors import BadInput
from .._core.fields import Part, at
from .._core.registry import DESIGN_RULES
from .._core.words import AMBIGUOUS, did_you_mean
from ..compressor import Compressor, single_numbers
from ..film import NamedBearing
from ..machine import Machine
from ._read import unwrapped
from ._scene import HEADER, Scene, places_of, scene_of, with_springs_counted
from ._schema import NAMED, SECTIONS, Number, Option, Section, choices, entries, kind_of
from ._text import SceneError, is_section, reading
from ._units import as_text, to_si

if TYPE_CHECKING:
    from ..study import Optimum

# Keys that are plain texts and carry no source.
_PLAIN = ("type", *HEADER)


def with_values(scene: Scene, changes: Mapping[str, Any], source: str = "set by the user") -> Scene:
    """A copy of a scene with other values, checked as a file is.

    Args:
        scene: the scene.
        changes: value by dotted path, all set before anything is checked. A value is a number, a
            text with a unit, a list, a table (a whole section) or `None`, which takes an optional
            value or part away. A new `type` keeps those keys of its section that the new class
            knows as well. A path may be a pattern (see `matching`). Design rules and
            correction masses are set after the others, in their order.
        source: what the scene records as the source of these values.

    Raises:
        SceneError: an unknown path, or as `load`.
        BadInput: a pattern that fits no number, or a design rule that is not made for the machine.
    """
    from ..study import variable
    from ..study._variables import by_name, is_fraction

    entry_changes = {}
    rule_changes = {}
    fraction_changes = {}
    for path, value in changes.items():
        if path in DESIGN_RULES or path.startswith("corrections."):
            rule_changes[path] = value
        elif path.rpartition(".")[0].endswith("_fractions"):
            fraction_changes[path] = value
        else:
            entry_changes[path] = value
    if entry_changes:
        scene = _with_entries(scene, entry_changes, source)
    # of the fluid that is set now
    entries_of_file = {}
    fractions = {}
    for path, value in fraction_changes.items():
        if is_fraction(scene.machine, path):
            fractions[path] = value
        else:
            entries_of_file[path] = value
    if entries_of_file:
        scene = _with_entries(scene, entries_of_file, source)

    if fractions:
        scene = _with_fractions(scene, fractions)
    for name, value in by_name(scene.machine, rule_changes).items():
        number = variable(scene.machine, name)
        machine = number.apply(scene.machine, to_si(value, number.unit, name))
        scene = with_machine(scene, machine, f"design rule, {name} = {value}")
    return scene


def _with_fractions(scene: Scene, fractions: Mapping[str, Any]) -> Scene:
    """A scene with other fractions of components of a mixture; those not named go in proportion."""
    from ..study import variable
    from ..study._variables import changed

    values = {path: float(to_si(value, "", path)) for path, value in fractions.items()}
    # an end of its range, so that a value beyond its bound is refused
    variables = [variable(scene.machine, path, low=value) for path, value in values.items()]
    machine = changed(scene.machine, variables, [*values.values()])
    listed = ", ".join(f"{path} = {value}" for path, value in fractions.items())
    return with_machine(scene, machine, f"{listed}, others in proportion")


def with_lists(scene: Scene, paths: Iterable[str]) -> Scene:
    """A scene in which numbers that are named for single cylinders are lists over the cylinders.

    Args:
        scene: with several cylinders; any other stays as it is.
        paths: such as "mechanism.bore.2", of the third cylinder, or "mechanism.bore.*"; those that
            name something else change nothing.
    """
    if scene.compressor is None or scene.compressor.crankshaft.count == 1:
        return scene
    from ..study import variable
    from ..study._variables import matching

    count = scene.compressor.crankshaft.count
    single = single_numbers(scene.compressor)
    changes = {}
    for path in paths:
        stem, _, cylinder = path.rpartition(".")
        if not (cylinder.isdigit() or "*" in cylinder):
            continue
        with contextlib.suppress(BadInput):
            matching(scene.machine, path)
            continue
        for name in single:
            if not fnmatchcase(name, stem):
                continue
            table = _entry(scene.document, name)
            if "value" not in table:
                value = float(variable(scene.machine, name).current(scene.machine))
                table = {"value": f"{value} {single[name]}".strip(), "source": "default"}
            changes[name] = {**table, "value": [table["value"]] * count}
    if not changes:
        return scene
    return _with_entries(scene, changes, "")


def _entry(document: Mapping[str, Any], path: str) -> dict[str, Any]:
    """The table of a value with its source as it was read; empty where none is given."""
    try:
        node = at(document, path)
    except LookupError:
        return {}
    if isinstance(node, Mapping):
        return dict(node)
    return {"value": node}


def _with_entries(scene: Scene, changes: Mapping[str, Any], source: str) -> Scene:
    """A copy of a scene with other entries of its file."""
    from ..study._variables import matching, variable_names

    scene = with_lists(scene, changes)
    top_keys = {*entries(Compressor), *HEADER, *SECTIONS, *NAMED}
    for path in changes:
        # a key of the file without its section is told with the section, unless it may mean more
        placed = path not in AMBIGUOUS and any(places_of(scene.document, path))
        if "." not in path and path not in top_keys and not placed:
            variables = {*variable_names(scene.machine)}
            if path not in AMBIGUOUS:
                variables &= {*DESIGN_RULES}
            near = did_you_mean(path, top_keys | variables)
            raise SceneError(path, f"is no section and no design rule{near}", file=scene.file)
    single_changes = {}
    for path, value in changes.items():
        names = [path]
        if "*" in path:
            names = matching(scene.machine, path)
        single_changes |= dict.fromkeys(names, value)
    changes = single_changes
    document = copy.deepcopy(dict(scene.document))
    stale: set[str] = set()
    with reading(scene.file):
        # a new type first: it decides which keys of its section stay
        for path in sorted(changes, key=lambda p: p.split(".")[-1] != "type"):
            stale |= _set_value(document, path, changes[path], source)
    changed_scene = scene_of(
        document, scene.file, stale - set(changes), scene.text, scene.machine.corrections
    )
    if any(path.startswith("torsion") for path in changes):
        return with_springs_counted(changed_scene)
    return changed_scene


def with_value(scene: Scene, path: str, value: Any, source: str = "set by the user") -> Scene:
    """`with_values` for a single value.

    Args:
        scene: the scene, which stays as it is.
        path: dotted path of the entry.
        value: number in SI units, text with a unit, or list; `None` takes an optional one away.
        source: where it comes from, for the tables.
    """
    return with_values(scene, {path: value}, source)


def with_machine(scene: Scene, machine: Machine, source: str) -> Scene:
    """A copy of a scene with another machine; its document says so with every digit.

    Args:
        scene: the scene.
        machine: with the same sections; a file does not hold its corrections.
        source: what the scene records as the source of the values that differ.

    Raises:
        SceneError: a value outside its bound, or a part that a file cannot describe.
    """
    old = scene.machine
    document = dict(scene.document)

    def renewed(tables, olds, news):
        sections = {}
        for name, new in news.items():
            sections[name] = _updated(tables[name], olds[name], new, source)
        return sections

    if machine.compressor is not None:
        document = _updated(document, old.compressor, machine.compressor, source)
    document |= renewed(document, old.parts, machine.parts)
    for name in NAMED:
        if news := getattr(machine, name):
            document[name] = document[name] | renewed(document[name], getattr(old, name), news)
    return scene_of(document, scene.file, text=scene.text, corrections=machine.corrections)


def optimised_scene(scene: Scene, optimum: "Optimum") -> tuple[Scene, list[str]]:
    """A copy of a scene with the best design, and the variables that a file does not hold.

    Args:
        scene: that was optimised.
        optimum: of `optimise`.

    Returns:
        The scene, and the names of those variables: correction masses.

    Raises:
        SceneError: as `with_machine`.
    """
    source = f"optimised for {optimum.objective_name}"
    if not optimum.feasible:
        source = f"nearest to the limits, {source}: {optimum.verdict}"
    best_scene = with_machine(scene, optimum.design, source)
    masses = [name for name in optimum.values if name.startswith("corrections.")]
    return best_scene, masses


def _set_value(document: dict[str, Any], path: str, value: Any, source: str) -> set[str]:
    """Set one entry of nested tables, in place.

    Args:
        document: the tables.
        path: dotted path; numbers are places in a list. Sections that lack are made.
        value: the entry, `None` to take it away.
        source: its source.

    Returns:
        Paths of the other entries of its section, if the entry is a new `type`.

    Raises:
        SceneError: the path leads through a value or past the end of a list.
    """
    keys = path.split(".")
    if not all(keys):
        raise SceneError(path, "is no path; it must be names joined by dots")
    node: Any = document
    for place, key in enumerate(keys[:-1]):
        node = _opened(node, path, keys[:place], key)
        node = _inner(node, key)
    *above, key = keys
    node = _opened(node, path, above, key)
    if isinstance(node, list):
        if value is None:
            raise SceneError(path, "is one of a list and cannot be taken away alone")
        node[int(key)] = copy.deepcopy(value)
    elif value is None:
        node.pop(key, None)
    elif isinstance(value, Mapping) or key in _PLAIN or _are_sections(value):
        node[key] = copy.deepcopy(value)
        if key == "type":
            return _paths_beside_type(node, above)
    else:
        node[key] = {"value": value, "source": source}
    return set()


def _paths_beside_type(section: Mapping[str, Any], above: list[str]) -> set[str]:
    """Paths of the other entries of a section, whose keys stand below those `above`."""
    paths = set()
    for key in section:
        if key != "type":
            paths.add(".".join([*above, key]))
    return paths


def _opened(node: Any, path: str, above: list[str], key: str) -> dict[str, Any] | list[Any]:
    """The table or list at a node, in which a key names an entry.

    Args:
        node: of the tables; a value with its source stands for the value.
        path, above: whole path and the keys that lead here, for messages.
        key: of the entry.
    """
    place = ".".join(above)
    if isinstance(node, Mapping) and not is_section(node):
        node = node["value"]
    if isinstance(node, list) and not (key.isdigit() and int(key) < len(node)):
        raise SceneError(path, f"must name one of the {len(node)} entries of {place}")
    if not isinstance(node, list | dict):
        raise SceneError(path, f"leads through {place}, which is a single value")
    return node


def _inner(node: dict[str, Any] | list[Any], key: str) -> Any:
    """An entry of a table or list; a section that lacks is added to its table."""
    if isinstance(node, list):
        return node[int(key)]
    return node.setdefault(key, {})


def _updated(table: Mapping[str, Any], old: Part | None, new: Part, source: str) -> dict[str, Any]:
    """A section that describes `new`, given the one that describes `old`.

    Entries that do not differ stay as they were written, others keep their unit if they can.

    Raises:
        SceneError: a part that a file cannot describe.
    """
    return new.rewritten(old, source) or _updated_entries(table, old, new, source)


def _updated_entries(
    table: Mapping[str, Any], old: Part | None, new: Part, source: str
) -> dict[str, Any]:
    """Such a section, entry by entry."""
    same = type(old) is type(new)
    out = {}
    # the top of a document keeps its header and its other sections
    if same or old is None:
        out = copy.deepcopy(dict(table))
    if not same:
        out["type"] = _kind_in_files(type(new))
        old = None
    for name, entry in entries(type(new)).items():
        before = getattr(old, name, None)
        after = getattr(new, name)
        if after is None:
            out.pop(name, None)
        elif isinstance(entry, Section) and entry.rows:
            if after or name in out:
                out[name] = _updated_rows(out.get(name, []), before, after, source)
        elif isinstance(entry, Section):
            out[name] = _updated_inner(out.get(name, {}), before, after, source)
        elif isinstance(entry, Number) and (before is None or not np.array_equal(before, after)):
            texts = _number_text(out.get(name), after, entry.unit, name)
            out[name] = {"value": texts, "source": source}
        elif isinstance(entry, Option) and (not same or before != after):
            out[name] = {"value": _as_written(after), "source": source}
    return out


def _updated_inner(section: Any, old: Part | None, new: Part, source: str) -> Any:
    """A section inside another one, or the name of a bearing in its place."""
    if not isinstance(new, NamedBearing):
        table = {} if old is None else section
        return _updated(table, old, new, source)
    if getattr(old, "name", None) == new.name:
        return section
    return {"value": new.name, "source": source}


def _number_text(written: Any, value: Any, unit: str, name: str) -> Any:
    """A number or list as text, in the unit of the entry that it replaces, if there is one."""
    if written is not None:
        written, _, _ = unwrapped(written, name)
    return as_text(np.asarray(value), unit, written)


def _updated_rows(rows: list, before: Any, after: Any, source: str) -> list:
    """A list of sections that describe some parts; all are new where their number differs."""
    if not before or len(before) != len(after) or not rows:
        rows = [{}] * len(after)
        before = [None] * len(after)
    updated = []
    for row, old, new in zip(rows, before, after, strict=True):
        if isinstance(new, NamedBearing):
            updated.append(new.name)
        else:
            updated.append(_updated(row, old, new, source))
    return updated


def _kind_in_files(kind: type[Part]) -> str:
    """The name of a kind of part in files.

    Raises:
        SceneError: a kind that a file cannot describe.
    """
    if kind_of(kind) not in choices((kind,)):
        raise SceneError("", f"a file cannot describe a part of type {kind.__name__}")
    return kind_of(kind)


def _are_sections(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _as_written(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_as_written(item) for item in value]
    return "none" if value is None else value
