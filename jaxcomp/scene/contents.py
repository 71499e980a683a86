"""What a machine file holds: its parts with their values, and the numbers that studies can change."""

from dataclasses import dataclass

from .._core.declared import BESIDE, Record, part, reading, word
from .._core.registry import DESIGN_RULES
from ..study import variable
from ..study._variables import list_length, variable_names
from ._describe import describe
from ._scene import Scene

# How the source of a value begins that a file to start from has, see `starts`.
EXAMPLE = "example value"
# Coordinates of correction masses, which no file has.
_CORRECTIONS = {
    "x": "Correction mass times radius along x.",
    "y": "Correction mass times radius along y.",
    "magnitude": "Correction mass times radius.",
    "angle": "Angle of the correction mass from x.",
}


@dataclass(frozen=True)
class PartContent(Record):
    """A part of a machine file.

    Attributes:
        type: word of the section.
        values: how many it has.
        defaults: of them by default.
        without_source: of those in the file without a source.
    """

    type: str = word()
    values: int = reading("")
    defaults: int = reading("")
    without_source: int = reading("")


@dataclass(frozen=True)
class ListedVariable(Record):
    """A number of a machine that studies can change."""

    unit: str = word()
    value: float = reading(BESIDE)
    bound: str = word()
    doc: str = word()


@dataclass(frozen=True)
class ListedVariables(Record):
    """The numbers of a machine that studies can change, by name."""

    variables: dict[str, ListedVariable] = part(ListedVariable, by_name=True)


def part_contents(scene: Scene) -> dict[str, PartContent]:
    """Type of each part of a machine, and how many values it has, by default and without a source."""
    contents = {}
    words = {}
    values = []
    for row in describe(scene):
        if row.path.endswith(".type"):
            words[row.path] = row.value
        else:
            values.append(row)
    for name, entry in scene.document.items():
        of_part = [row for row in values if row.path.startswith(f"{name}.")]
        in_file = [row for row in of_part if row.given is not None]
        without_source = sum(not row.source for row in in_file)
        if of_part and isinstance(entry, dict | list):
            contents[name] = PartContent(
                type=words.get(f"{name}.type", ""),
                values=len(of_part),
                defaults=len(of_part) - len(in_file),
                without_source=without_source,
            )
    return contents


def example_values(scene: Scene) -> int:
    """Number of the values of a scene that are still those of a file to start from."""
    count = 0
    for row in describe(scene):
        if row.given is not None and str(row.source).startswith(EXAMPLE):
            count += 1
    return count


def describe_variables(scene: Scene) -> dict[str, ListedVariable]:
    """Unit, value [SI], bound and meaning of each number of a scene that studies can change.

    The value of the factor on a list is 1.
    """
    machine = scene.machine
    docs = {row.path: row.doc for row in describe(scene)} | DESIGN_RULES

    def meaning(name: str) -> str:
        if name.startswith("corrections."):
            return _CORRECTIONS[name.rpartition(".")[2]]
        count = list_length(machine, name)
        doc = docs.get(name, "")
        if not count:
            return doc
        return f"{doc} (factor on all {count})".strip()

    described = {}
    for name in variable_names(machine):
        number = variable(machine, name)
        described[name] = ListedVariable(
            unit=number.unit,
            value=float(number.current(machine)),
            bound=str(number.bound),
            doc=meaning(name),
        )
    return described
