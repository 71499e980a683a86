"""Declarations of results: JSON, schema and tables say the same, and nothing is stated twice."""

import ast
import dataclasses
import importlib
import inspect
import json
import pkgutil
import textwrap
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import jaxcomp
from jaxcomp._core.declared import (
    BESIDE,
    IN_KEY,
    NAMED,
    SCHEMAS,
    Measured,
    Record,
    computed,
    computed_part,
    computed_word,
    declarations,
    forwarded,
    held,
    part,
    reading,
    records_of,
    schema_of,
    tree_of,
    with_units,
    word,
)
from jaxcomp._core.results import Data, Result, columns_of


@dataclasses.dataclass(frozen=True)
class Plane(Record):
    name: str = word()
    mass: float = reading("kg")
    spread: float | None = reading("kg", optional=True, default=None)


@dataclasses.dataclass(frozen=True)
class Size(Record):
    length: float = reading("m", doc="between the ends")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sample(Result):
    size: Size = part(Size, inline=True)
    planes: tuple[Plane, ...] = part(Plane)
    by_name: dict[str, Plane] = part(Plane, by_name=True)
    forces: dict[str, float] = reading("N", by_name=True)
    losses: dict[str, float] = reading("J")
    trial: Measured = reading(IN_KEY)
    best: dict[str, Measured] = reading(NAMED)
    limit: float = reading(BESIDE)
    curve: np.ndarray = reading("Pa", "angle", table_only=True)
    inner: Any = held(default=3.0)
    missing: float | None = reading("s", default=None)

    length_of_size = forwarded(Size, "size.length")

    @computed("W", doc="lost")
    def power(self) -> float:
        """[W]"""
        return 2.0 * self.inner

    @computed_word(key="status")
    def status_word(self) -> str:
        """Status."""
        return "converged"

    @computed_part(Plane)
    def heaviest(self) -> Plane:
        """The plane with the largest mass."""
        return max(self.planes, key=lambda plane: plane.mass)


@pytest.fixture
def sample():
    planes = records_of(Plane, name=["A", "B"], mass=np.array([0.1, np.nan]))
    return Sample(
        size=Size(0.5),
        planes=planes,
        by_name={"A": planes[0]},
        forces={"x": 1.0},
        losses={"wall": 2.0},
        trial=Measured(0.25, "kg m"),
        best={"bore": Measured(0.1, "m"), "ratio": Measured(2.0, "")},
        limit=7.0,
        curve=np.array([1e5, 2e5]),
    )


PLANE_A = {"name": "A", "mass [kg]": 0.1}
KEYED = {
    "length [m]": 0.5,
    "planes": [PLANE_A, {"name": "B", "mass [kg]": None}],
    "by_name": {"A": PLANE_A},
    "forces": {"x [N]": 1.0},
    "losses [J]": {"wall": 2.0},
    "trial [kg m]": 0.25,
    "best": {"bore [m]": 0.1, "ratio": 2.0},
    "limit": 7.0,
    "missing [s]": None,
    "length_of_size [m]": 0.5,
    "power [W]": 6.0,
    "status": "converged",
    "heaviest": PLANE_A,
}


def test_json_has_every_entry_with_its_unit(sample):
    assert with_units(tree_of(sample)) == KEYED
    assert json.loads(sample.to_json()) == KEYED
    entries = sample.entries()
    assert entries["forces"] == {"x": 1.0}
    assert entries["trial"] == 0.25
    assert entries["planes"][1] == {"name": "B", "mass": None}


def wrong_keys(document):
    schema = schema_of(Sample) | {"$defs": SCHEMAS}
    Draft202012Validator.check_schema(schema)
    errors = Draft202012Validator(schema).iter_errors(document)
    return sorted(str(error.absolute_path[0]) for error in errors if error.absolute_path)


def test_the_schema_of_a_class_takes_its_json_and_no_number_without_unit(sample):
    assert wrong_keys(KEYED) == []
    assert wrong_keys(KEYED | {"forces": {"x": 1.0}}) == ["forces"]
    assert wrong_keys(KEYED | {"planes": [{"name": "A", "mass": 0.1}]}) == ["planes"]
    assert wrong_keys(KEYED | {"by_name": {"A": {"mass": 0.1}}}) == ["by_name"]
    assert wrong_keys(KEYED | {"power": 6.0}) == ["power"]
    # a curve stands in tables alone
    assert wrong_keys(KEYED | {"curve [Pa]": [1.0]}) == ["curve [Pa]"]


def test_tables_have_unit_dimensions_and_sentence_of_the_declaration(sample):
    found = {data.name: data for data in sample.data_of("curve", "power", pressure="curve")}
    assert found["curve"][1::2] == ("Pa", ("angle",))
    assert found["pressure"].unit == "Pa"
    assert found["power"].doc == "lost"
    (again,) = sample.data_of("length_of_size")
    assert (again.unit, again.doc) == ("m", "between the ends")
    # nothing that is `None` or without a unit of its own
    assert list(sample.data_of("missing", "limit", "status_word")) == []
    rows = {data.name: data for data in columns_of(sample.planes, "plane")}
    assert rows["mass"].unit == "kg"
    np.testing.assert_array_equal(rows["mass"].values, [0.1, np.nan])
    assert rows["name"].values.tolist() == ["A", "B"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Numbers(Result):
    power: float = reading("W")
    force: np.ndarray = reading("N", "angle")


def test_a_result_without_curves_is_one_row_of_its_numbers():
    table = Numbers(5.0, np.array([1.0, 2.0])).to_pandas()
    assert table.to_dict("list") == {"power [W]": [5.0]}


def results_of_package():
    for module in pkgutil.walk_packages(jaxcomp.__path__, "jaxcomp."):
        if "desk" not in module.name and "__main__" not in module.name:
            importlib.import_module(module.name)
    kinds = [Result]
    for kind in kinds:
        kinds += kind.__subclasses__()
    return {kind for kind in kinds if kind.__module__.startswith("jaxcomp.")} - {Result}


def stated_again(kind):
    """Names of numbers that `described` of a class states although the class declares them."""
    method = vars(kind).get("described")
    if method is None:
        return []
    declared = set()
    for name, declaration in declarations(kind).items():
        if declaration.unit is not None:
            declared.add(declaration.key or name)
    again = []
    for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(method)))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Data":
            name = node.args[0]
            if isinstance(name, ast.Constant) and name.value in declared:
                again.append(name.value)
    return again


def test_no_table_states_a_unit_that_its_class_declares():
    kinds = results_of_package()
    # the walk has found them
    assert len(kinds) > 30
    assert {kind.__name__: again for kind in kinds if (again := stated_again(kind))} == {}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Twice(Result):
    power: float = reading("W")

    def described(self):
        yield Data("power", "W", self.power)


def test_a_unit_that_is_stated_twice_is_seen():
    assert stated_again(Twice) == ["power"]
