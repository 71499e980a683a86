"""Numbers of a rotor fitted to a modal test, each by a factor."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray

from ..._core.declared import (
    NUMBER,
    Record,
    computed_part,
    held,
    reading,
    records_of,
    word,
)
from ..._core.errors import BadInput
from ..._core.results import Data, Result, columns_of
from ...machine import HasMachine, Machine, machine_of
from ._common_factor import varied
from ._identify import identify
from ._result import Identification
from ._rotor_tests import ModalTest


@dataclasses.dataclass(frozen=True)
class UpdatedNumber(Record):
    """A number of a rotor before and after a modal test.

    Attributes:
        path: of the number.
        factor: [-] after over before.
        before, after, standard_error: [SI]
        at_bound: whether it lies on a bound.
    """

    path: str = word()
    factor: float = reading("")
    before: float = reading(NUMBER)
    after: float = reading(NUMBER)
    standard_error: float = reading(NUMBER)
    at_bound: bool = word()


@dataclasses.dataclass(frozen=True)
class UpdatedMode(Record):
    """A natural frequency before and after.

    Attributes:
        mode: number from 1.
        measured, before, after: [rad/s]
        error: [-] frequency after over that measured, less one.
    """

    mode: int = reading("")
    measured: float = reading("rad/s")
    before: float = reading("rad/s")
    after: float = reading("rad/s")
    error: float = reading("")


class RotorUpdate(Result, eqx.Module):
    """Numbers of a rotor after a modal test.

    Attributes:
        paths: (variables,) of the numbers.
        units: (variables,) their SI units.
        start, estimate: [SI] (variables,) before and after.
        standard_error: [SI] (variables,)
        at_bound: (variables,) whether an estimate lies on a bound.
        free: whether the rotor hung free.
        converged: whether the fit is.
        steps: of the fit.
        notes: what is not to be trusted, in words.
        mode: (modes,) number from 1.
        measured, before, after: [rad/s] (modes,) natural frequencies.
        identification: that it is; has the machine with the estimates.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    start: Float[np.ndarray, " variables"]
    estimate: Float[np.ndarray, " variables"]
    standard_error: Float[np.ndarray, " variables"]
    at_bound: Bool[np.ndarray, " variables"]
    free: bool = word(static=True)
    converged: bool = word(static=True)
    steps: int = reading("", static=True)
    notes: tuple[str, ...] = word(static=True)
    mode: Int[np.ndarray, " modes"] = held()
    measured: Float[np.ndarray, " modes"] = held()
    before: Float[np.ndarray, " modes"] = held()
    after: Float[np.ndarray, " modes"] = held()
    identification: Identification | None = held(default=None)

    table_dims: ClassVar[tuple[str, ...]] = ("mode",)
    not_saved: ClassVar[tuple[str, ...]] = ("identification",)

    @property
    def error(self) -> NDArray:
        """(modes,) frequency after over that measured, less one."""
        return self.after / self.measured - 1

    @property
    def status(self) -> str:
        """End of the fit in words."""
        if self.converged:
            return "converged"
        return "not converged"

    @computed_part(UpdatedNumber)
    def variables(self) -> tuple[UpdatedNumber, ...]:
        """(variables,) Every number before and after."""
        return records_of(
            UpdatedNumber,
            path=self.paths,
            factor=self.estimate / self.start,
            before=self.start,
            after=self.estimate,
            standard_error=self.standard_error,
            at_bound=self.at_bound,
        )

    @computed_part(UpdatedMode)
    def modes(self) -> tuple[UpdatedMode, ...]:
        """(modes,) Every frequency before and after."""
        return records_of(
            UpdatedMode,
            mode=self.mode,
            measured=self.measured,
            before=self.before,
            after=self.after,
            error=self.error,
        )

    def described(self) -> Iterator[Data]:
        """The numbers with their factors, and the frequencies."""
        for variable, unit in zip(self.variables, self.units, strict=True):
            yield Data(variable.path, unit, variable.after)
            yield Data(f"factor.{variable.path}", "", variable.factor)
        for data in columns_of(self.modes, *self.table_dims):
            if data.name == "mode":
                data = data._replace(values=self.mode)  # which counts
            yield data


def update_rotor(
    machine: Machine | HasMachine,
    test: ModalTest,
    paths: Sequence[str],
    within: tuple[float, float] = (0.5, 2.0),
    regularisation: float = 0.0,
) -> RotorUpdate:
    """Fit numbers of a rotor to the natural frequencies of a modal test.

    It is `identify` with one start, a factor for each number, and a penalty in the place of priors.

    Args:
        machine: a scene or a machine with a rotor.
        test: what was measured.
        paths: of the numbers, such as "rotor.shafts.0.young_modulus", which get one common factor where
            a path holds several.
        within: [-] bounds of every factor.
        regularisation: [-] penalty on the distance from the numbers of the machine; 0 for none. At 1 a
            usual error of all frequencies weighs as much as the whole range of a factor.

    Raises:
        BadInput: a number that is none of a rotor; or as `identify`.
    """
    design = machine_of(machine)
    vary = {}
    prior = {}
    for path in paths:
        if not path.startswith("rotor."):
            raise BadInput("paths", path, "a number of the rotor, as rotor.shafts.0.length")
        present = float(varied(design, path).current(design))
        vary[path] = (within[0] * present, within[1] * present)
        if regularisation:
            # a relative error of the frequencies weighs as much as a range of the factor over it
            prior[path] = (present, test.USUAL * (vary[path][1] - vary[path][0]) / regularisation)
    identification = identify(machine, test, vary, prior, starts=1)
    before, _ = identification.study(np.asarray(identification.start), [0])
    rows = identification.of("frequency")
    fit = identification.fit
    return RotorUpdate(
        paths=identification.parameters,
        units=identification.units,
        start=np.asarray(identification.start),
        estimate=np.asarray(identification.estimate),
        standard_error=np.asarray(identification.standard_error),
        at_bound=np.array(fit.at_bound, bool),
        free=test.free,
        converged=bool(fit.converged),
        steps=int(fit.steps),
        notes=tuple(identification.notes),
        mode=np.array(test.modes),
        measured=np.asarray(identification.measured)[rows],
        before=np.asarray(before)[rows],
        after=np.asarray(identification.computed)[rows],
        identification=identification,
    )
