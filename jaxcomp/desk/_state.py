r"""What stands on the desk: a machine whose numbers move, its results, gains and earlier states."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.display import Shown, shown
from .._core.errors import BadInput
from .._core.exported import kept_optimised_jit
from .._core.registry import Quantity, offered_values
from .._core.status import Status
from ..balancing import least_squares
from ..crank._films import film_thickness
from ..cylinder import Cylinder
from ..cylinder._several import SeveralCycles
from ..machine import Machine
from ..plot._fine import fine_turn, first_diagram
from ..plot._mechanism import front_view
from ..scene import Scene, SceneError, dump, implausible_values
from ..scene._change import with_machine
from ..scene._units import to_si
from ..scene.follows import gas_follows
from ..study import (
    AnalysisOptions,
    DesignResult,
    Sensitivity,
    available_quantities,
    optimise,
    problem,
    sensitivity,
)
from ..study._labels import variable_label
from ..study._variables import GivenNumber, given_numbers, list_length

_SOURCE = "set at the desk"
_FIRST = ("cop", "mechanical_efficiency")
# Designs between which a search begins, beside the machine as it stands.
_SAMPLES = 16


class View(NamedTuple):
    """Results of one state of the machine, as the pictures show them.

    Attributes:
        quantities: [SI] by name, without families.
        status: "" if all of it can be relied on, otherwise the reason why not.
        angle: [rad] (n,) crank angle from top dead centre of the first cylinder.
        volume, pressure: [m^3], [Pa] (n,) displaced volume and cylinder pressure; `None` without gas.
        forces: [N] (n,) magnitude by joint.
        losses: [W] friction power by joint.
        lift_angle: [rad] (k,) crank angle of the lifts.
        lifts: [m] (k,) of the valves of the first cylinder, by valve; empty without.
        power_use: [W] what the power of a machine with valves is spent on, by cause.
        films: [m] (m,) smallest film thickness by journal, at `film_angle` [rad].
        vibration: [m] (2,) root mean square amplitude by target, now and after the balancing by least
            squares.
    """

    quantities: dict[str, Any]
    status: str = ""
    angle: Any = None
    volume: Any = None
    pressure: Any = None
    forces: Mapping[str, Any] = {}
    losses: Mapping[str, Any] = {}
    lift_angle: Any = None
    lifts: Mapping[str, Any] = {}
    power_use: Mapping[str, Any] = {}
    film_angle: Any = None
    films: Mapping[str, Any] = {}
    vibration: Mapping[str, Any] = {}


class Improvement(NamedTuple):
    """Machine that a search found from the one that it began with, which may have been moved since.

    Attributes:
        quantity: that was made as good as it can be.
        began: [SI] of every number when the search began.
        values: [SI] of the numbers that were searched.
        objective: [SI] of the quantity, with the other numbers as in `began`.
        status: of the search, see `Optimum`.
    """

    quantity: str
    began: dict[str, float]
    values: dict[str, float]
    objective: float
    status: str


class Desk:
    """A machine and what is done with it at the desk. Every page has its own.

    Args:
        scene: of `jaxcomp.load`.
        options: of the analysis of a design.
        quantity: whose gains are shown; the first that the machine has if absent.

    Attributes:
        scene: as it was loaded.
        machine: as it stands.
        view: its results.
        pinned: the results that are compared with; `None` if none are.
        numbers: every number of the machine by name, as it was loaded.
        values: [SI] of every number, as it stands.
        quantities: that gains can be asked for, by name.
        quantity: the one whose gains are shown; may be set.
        system: of the units that texts have, one of `SYSTEMS`; may be set.
    """

    system = "SI"

    def __init__(
        self, scene: Scene, options: AnalysisOptions | None = None, quantity: str | None = None
    ):
        self.scene = scene
        self.machine = scene.machine
        self.options = options or AnalysisOptions()
        self.quantities = available_quantities(self.machine, members=True)
        self.quantity = quantity or _usual_quantity(self.quantities)
        if self.quantity not in self.quantities:
            raise BadInput("quantity", self.quantity, f"one of {', '.join(self.quantities)}")
        available = available_quantities(self.machine).values()
        self._single = tuple(single for single in available if not single.family)
        self.numbers = {number.name: number for number in given_numbers(self.machine)}
        self.values = {name: number.value for name, number in self.numbers.items()}
        self._earlier: list[tuple[Machine, dict[str, float]]] = []
        self._later: list[tuple[Machine, dict[str, float]]] = []
        self._dragged = ""
        self.pinned: View | None = None
        self.view = self._solved()

    def label(self, name: str) -> str:
        """Name of a number, in words."""
        words = variable_label(self.machine, name)
        if self.numbers[name].factor:
            return f"{words}, factor on all values"
        return words

    def text(self, name: str) -> str:
        """A number with the unit that suits it."""
        value = self.values[name]
        return self.look(name, value).text(value, 6)

    def look(self, name: str, values) -> Shown:
        """Format of a number or quantity with some values [SI]."""
        item = self.numbers.get(name) or self.quantities[name]
        return shown(name, item.unit, values, self.system)

    def front_view(self, angle: float) -> dict[str, Float[np.ndarray, "2 n"]]:
        """The mechanisms as they stand, [m] lines by part; empty if nobody has drawn them."""
        if self.machine.compressor is None:
            return {}
        try:
            return front_view(self.machine.compressor, angle)
        except TypeError:
            return {}

    def range_of(self, name: str) -> tuple[float, float]:
        """[SI] Where the slider of a number begins and ends: a fifth to either side, inside its bound."""
        value = self.values[name]
        number = self.numbers[name]
        reach = 0.2 * abs(value) or {"rad": 0.2, "kg m": 1e-4, "m": 1e-3}.get(number.unit, 1.0)
        return max(value - reach, number.bound.low), min(value + reach, number.bound.high)

    def move(self, name: str, value: float, dragging: bool = False) -> None:
        """Give a number another value [SI] and solve.

        Args:
            name: of the number.
            value: [SI]
            dragging: whether it moves on; all its moves until `let_go` are one change.

        Raises:
            SceneError: the value lies outside its bound.
        """
        number = self.numbers[name]
        self._check(number, value, self.look(name, value).text(value))
        if not (dragging and self._dragged == name):
            self._keep()
        self._dragged = name if dragging else ""
        self.machine = number.moved(self.machine, value)
        self.values[name] = value
        self.view = self._solved()

    def let_go(self) -> None:
        """Let the next drag be a change of its own."""
        self._dragged = ""

    def enter(self, name: str, text: str) -> None:
        """Give a number the value that was typed, checked as in a machine file.

        Raises:
            SceneError: as `jaxcomp.load`.
        """
        number = self.numbers[name]
        try:
            typed = float(text)
        except ValueError:
            typed = text
        value = float(to_si(typed, number.unit, name))
        self._check(number, value, text)
        if value == self.values[name]:
            return
        with_machine(self.scene, number.moved(self.machine, value), _SOURCE)
        self.move(name, value)

    def undo(self) -> bool:
        """Go back to the state before the last change; whether there was one."""
        return self._step(self._earlier, self._later)

    def redo(self) -> bool:
        """Go on to the state that the last `undo` left; whether there was one."""
        return self._step(self._later, self._earlier)

    def _step(self, source: list, target: list) -> bool:
        self.let_go()
        if not source:
            return False
        target.append((self.machine, self.values))
        self.machine, self.values = source.pop()
        self.view = self._solved()
        return True

    @property
    def changes(self) -> tuple[int, int]:
        """Numbers of changes that can be undone, and done again."""
        return len(self._earlier), len(self._later)

    def pin(self) -> None:
        """Keep the present results to compare with."""
        self.pinned = self.view

    def gains(self) -> Sensitivity:
        """Sensitivity of the chosen quantity to every number, by one reverse pass."""
        return sensitivity(self.machine, [self.quantity], options=self.options)

    def changed_scene(self) -> Scene:
        """The machine as it stands, as a scene.

        Raises:
            SceneError: it cannot be: a value outside its bound, or values that do not go together.
        """
        return with_machine(self.scene, self.machine, _SOURCE)

    def toml(self) -> str:
        """The text of its machine file, with the comments of the file that it was loaded from."""
        return dump(self.changed_scene())

    def gas_lines(self) -> list[str]:
        """Composition, glide, compressibility and head of the gas of a machine with valves, in words."""
        gas = getattr(self.machine.compressor, "gas", None)
        if not isinstance(gas, Cylinder):
            return []
        lines = []
        for name, value, unit in gas_follows(gas):
            if isinstance(value, float):
                value = f"{value:.4g}"
            lines.append(f"{name}: {value} {unit}".rstrip())
        return lines

    def warnings(self) -> list[str]:
        """Unusual values of the machine as it stands, as `jaxcomp check` says them."""
        try:
            unusual = implausible_values(self.changed_scene())
        except SceneError:  # which the status names
            return []
        warnings = []
        for value in unusual:
            warnings.append(f"{value.path}: {value.what}, usual is {value.usual}")
        return warnings

    def improve(self, ranges: Mapping[str, tuple[float, float]], callback=None) -> str:
        """Make the chosen quantity as good as it can be within ranges, from the present state on.

        Args:
            ranges: [SI] of the numbers that may change.
            callback: see `jaxcomp.optimise`.

        Returns:
            What was found, in words.

        Raises:
            BadInput, SolveFailed: see `search`.
        """
        return self.take(self.search(ranges, callback))

    def search(self, ranges: Mapping[str, tuple[float, float]], callback=None) -> Improvement:
        """Find what makes the chosen quantity as good as it can be, and change nothing on the desk.

        Meanwhile another thread may move numbers: the search is that of the machine as it stands now.

        Args:
            ranges, callback: as for `improve`.

        Raises:
            BadInput, SolveFailed: as `jaxcomp.optimise`; or a quantity that is neither better when
                larger nor when smaller.
        """
        name = self.quantity
        machine = self.machine
        began = dict(self.values)
        if not self.quantities[name].better:
            raise BadInput("quantity", name, "one that is better when larger or smaller")
        # a list of which all values move together is a factor for those who optimise
        scale = {}
        scaled = {}
        for number, ends in ranges.items():
            scale[number] = 1.0
            if list_length(machine, number):
                scale[number] = began[number]
            scaled[number] = tuple(sorted(end / scale[number] for end in ends))
        design_problem = problem(machine, scaled, [name], self.options)
        best = optimise(design_problem, starts=2, samples=_SAMPLES, callback=callback)
        values = {number: float(value) * scale[number] for number, value in best.values.items()}
        return Improvement(
            quantity=name,
            began=began,
            values=values,
            objective=best.objective,
            status=best.status,
        )

    def take(self, found: Improvement) -> str:
        """Give the machine as it stands the numbers that a search found.

        Numbers that were moved since it began, and that it did not search, stay as they are.

        Returns:
            What was found, in words.
        """
        moved = [name for name, value in self.values.items() if value != found.began[name]]
        machine = self.machine
        for name, value in found.values.items():
            machine = self.numbers[name].moved(machine, value)
        self._keep()
        self.machine = machine
        self.values |= found.values
        self.view = self._solved()
        look = self.look(found.quantity, found.objective)
        words = f"{look.text(found.objective)} ({found.status})"
        if not moved:
            return words
        stayed = []
        changed = []
        for name in moved:
            if name in found.values:
                changed.append(self.label(name))
            else:
                stayed.append(self.label(name))
        words += " for the machine as it was when the search began"
        if stayed:
            words += f"; {', '.join(stayed)}: as moved since, so search again"
        if changed:
            words += f"; {', '.join(changed)}: as found, no longer as moved since (Undo goes back)"
        return words

    def _check(self, number: GivenNumber, value: float, text: str) -> None:
        if not (np.isfinite(value) and bool(number.bound.holds(value))):
            raise SceneError(number.name, f"must be {number.bound} {number.unit}".rstrip(), text)

    def _keep(self) -> None:
        self.let_go()
        self._later.clear()
        self._earlier.append((self.machine, dict(self.values)))

    def _solved(self) -> View:
        view, status, ok = _solve(self.machine, self._single, self.options)
        view = jax.device_get(view)
        if bool(ok):
            return view
        try:
            self.changed_scene()
        except SceneError as error:  # which names the value and its bound
            return view._replace(status=str(error))
        if status is None:
            return view._replace(status="not solved")
        return view._replace(status=Status[status])


def _usual_quantity(quantities: Mapping[str, Quantity]) -> str:
    """The quantity whose gains a fresh desk shows."""
    for name in _FIRST:
        if name in quantities:
            return name
    return next(iter(quantities))


@kept_optimised_jit
def _solve(machine: Machine, quantities: tuple[Quantity, ...], options: AnalysisOptions):
    """The view of a machine, without its status in words, and what that is."""
    result = DesignResult(machine, options)
    values = offered_values(quantities, result)
    crank = {}
    status = None
    if machine.compressor is not None:
        crank = _of_crank(result)
        status = result.orbit.status
    vibration = {}
    if "balanced_vibration" in values:
        vibration = _of_rotor(result)
    return View(values, "", vibration=vibration, **crank), status, result.ok


def _of_crank(result: DesignResult) -> dict[str, Any]:
    compressor = result.assembly.compressor
    orbit = result.orbit
    assert compressor is not None
    turn = fine_turn(compressor, orbit)
    cycle = orbit.cycle
    volume = None
    pressure = None
    if turn.pressure is not None:
        volume, pressure = first_diagram(compressor, turn)
    forces = {}
    for name, force in turn.loads.forces.items():
        # a moment is a single row, a force has two components
        if force.ndim == 1:
            forces[name] = jnp.abs(force)
        else:
            forces[name] = jnp.hypot(*force)
    lift_angle = None
    lifts = {}
    uses = {}
    if cycle is not None:
        first: Any = cycle
        if isinstance(cycle, SeveralCycles):
            first = jax.tree.map(lambda x: x[0], cycle.each)
        lift_angle = first.angle
        lifts = dict(zip(("suction", "discharge"), first.lift, strict=True))
        for name, power in result.performance.power.items():
            if jnp.ndim(power) == 0:
                uses[name] = power
    return {
        "angle": turn.state.angle,
        "volume": volume,
        "pressure": pressure,
        "forces": forces,
        "losses": orbit.loss_power,
        "lift_angle": lift_angle,
        "lifts": lifts,
        "power_use": uses,
        "film_angle": orbit.state.angle,
        "films": film_thickness(compressor, orbit),
    }


def _of_rotor(result: DesignResult) -> dict[str, Float[Array, "2"]]:
    """[m] Amplitudes of the targets at order 1, as the corrections stand and after the balancing."""
    influence = result.influence
    after = influence.vibration(least_squares(influence).correction)
    square = jnp.abs(jnp.stack([influence.initial, after])) ** 2
    targets = np.array([row.target for row in influence.rows])
    amplitudes = {}
    for target in dict.fromkeys(targets.tolist()):
        # several rows of a target are its axes
        amplitudes[target] = jnp.sqrt(square[:, targets == target].mean(-1))
    return amplitudes
