r"""What a sweep is to find, and how its results are laid out."""

from typing import Any, NamedTuple

from ._points import SAMPLE, GridPoints, Layout, SamplePoints


class Column(NamedTuple):
    """A variable or a quantity as a table heads it.

    Attributes:
        name: of the data variable or coordinate.
        unit: SI unit.
        better: "more", "less" or "", for quantities.
        doc: one line.
    """

    name: str
    unit: str
    better: str = ""
    doc: str = ""

    @property
    def attributes(self) -> dict[str, str]:
        """As `xarray` keeps them."""
        return {"units": self.unit, "better": self.better, "long_name": self.doc or self.name}


class Plan(NamedTuple):
    """What a store is laid out for.

    Attributes:
        points: the designs.
        layout: how they are cut into blocks.
        width: designs that are computed in step.
        variables, quantities: their headings, in the order of their columns.
        fingerprint: see `fingerprint`.
        about: versions and the like, which are kept and not compared.
    """

    points: GridPoints | SamplePoints
    layout: Layout
    width: int
    variables: tuple[Column, ...]
    quantities: tuple[Column, ...]
    fingerprint: dict[str, Any]
    about: dict[str, str]

    @property
    def sampled(self) -> bool:
        """Whether every design has values of its own, and not those of a grid."""
        return self.points.dims == (SAMPLE,)
