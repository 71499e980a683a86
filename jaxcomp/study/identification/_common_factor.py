"""One factor on several numbers of a machine, where its readings tell their product alone."""

from typing import NamedTuple

from ..._core.errors import BadInput
from ...machine import Machine
from .._variables import Variable, matching, variable


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
    def bare(self) -> "CommonFactor":
        """The factor without its range."""
        return self._replace(each=tuple(one.bare for one in self.each), low=0.0, high=0.0)

    def current(self, design: Machine) -> float:
        """1, as the machine stands."""
        del design
        return 1.0

    def apply(self, design: Machine, value) -> Machine:
        """The machine with all numbers times a factor; unchecked."""
        for one in self.each:
            # the current value of a list is already the factor 1 on it
            design = one.apply(design, one.current(design) * value)
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
        return variable(design, name, low, high)
    each = tuple(variable(design, one) for one in names)
    for one in each:
        for end in (low, high):
            size = None if end is None else float(one.current(design)) * end
            if size is not None and not bool(one.bound.holds(size)):
                raise BadInput(f"{name}: {one.name}", size, str(one.bound))
    if high is None:  # as far as all of them may go
        now = ((one.bound.high, float(one.current(design))) for one in each)
        high = min(2.0, *(most / value for most, value in now if value > 0))
    low = 0.5 if low is None else low
    return CommonFactor(name, each, low, high)
