"""One factor on several numbers of a machine, where its readings tell their product alone."""

from typing import NamedTuple

from ..._core.errors import BadInput
from ...machine import Machine
from .._variables import Variable, matching
from .._variables import variable as find_variable


class CommonFactor(NamedTuple):
    """One factor on several numbers of a machine, of which only the product is told.

    Attributes:
        name: pattern that the numbers fit.
        each: the numbers.
        low, high: [-] range of the factor.
    """

    name: str
    each: tuple[Variable, ...]
    low: float
    high: float
    unit: str = ""

    @property
    def without_range(self) -> "CommonFactor":
        """The factor without its range."""
        each = tuple(number.without_range for number in self.each)
        return self._replace(each=each, low=0.0, high=0.0)

    def current(self, design: Machine) -> float:
        """1, as the machine stands."""
        del design
        return 1.0

    def apply(self, design: Machine, value) -> Machine:
        """The machine with all numbers times a factor; unchecked."""
        for number in self.each:
            # the current value of a list is already the factor 1 on it
            design = number.apply(design, number.current(design) * value)
        return design


def varied(
    design: Machine, name: str, low: float | None = None, high: float | None = None
) -> Variable | CommonFactor:
    """Numbers that a path varies: one, or for a pattern a common factor on all that fit it.

    Args:
        design: the machine.
        name: as `jaxcomp.study.variable` and `matching` take it.
        low, high: [SI] the range, of the factor for a pattern.

    Raises:
        BadInput: no such number, or a range outside its bounds.
    """
    names = matching(design, name)
    if names == [name]:
        return find_variable(design, name, low, high)
    each = tuple(find_variable(design, path) for path in names)
    for number in each:
        present = float(number.current(design))
        for factor in (low, high):
            if factor is not None and not bool(number.bound.holds(present * factor)):
                raise BadInput(f"{name}: {number.name}", present * factor, str(number.bound))
    if low is None:
        low = 0.5
    if high is None:  # as far as all of them may go
        high = 2.0
        for number in each:
            present = float(number.current(design))
            if present > 0:
                high = min(high, number.bound.high / present)
    return CommonFactor(name=name, each=each, low=low, high=high)
