r"""A machine at its extremes: values with their errors, or the reason why there is none.

Each family moves numbers of the machine, step by step, towards a place where the equations become
stiff, singular or impossible. The default solver gives value and status, an independent march of one
revolution its error; of a cycle with valves the march with located events to its periodic state; of the
rotor, two linear solvers are compared.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._core.declared import Record, computed_word, part, reading, word
from ..._core.errors import BadInput
from ..._core.extremes import max_of
from ..._core.fields import replaced
from ..._core.results import Data, Result, columns_of
from ..._core.status import SolveFailed, Status
from ...compressor import Compressor
from ...crank import Collocation, TimeIntegration, solve_orbit
from ...crankshaft._bearings import film_journals
from ...cylinder import CycleOptions, Cylinder, solve_cycle
from ...machine import Assembly, HasMachine, Machine, assembled, machine_of
from ...mechanism import SliderCrank
from ...motor import ConstantSpeed, SlipLine
from ...rotor import respond
from ...vibration import loaded_rotor
from ._cycle_study import one_cylinder
from ._report import Computer, this_computer
from ._study import median_time

# Fewer steps than of a single verification: near a stall a march would take all it is given.
_MARCH = TimeIntegration(diffrax.Dopri8(), 1e-11, max_steps=8192, samples=2000)
# [-] Speeds of the rotor that are searched for its largest response, over the highest of its planes.
_SPEEDS = (0.05, 2.0)
_COUNT = 400
_LEAST_DAMPING = 1e-6  # [-] of the links' own
# Of cycles with valves: the march that no buffer limits.
_CYCLE_MARCH = CycleOptions(
    method="march", panels=1024, capacity=65_536, max_passes=2_000_000, value_tolerance=1e-9
)


@dataclasses.dataclass(frozen=True)
class Extreme(Record):
    """One machine at an extreme.

    Attributes:
        family: what is extreme about it.
        setting: what was moved, and how far.
        status: of the solver, as a sentence.
        value: [-] mechanical efficiency; of a cycle volumetric efficiency; of a response [m] its largest
            displacement.
        error: [-] of the value: by the march, of a cycle the larger one of value and indicated work; or
            the difference of the two linear solvers.
        speed_error: [-] of the speed by the march, relative to the mean; `None` for a cycle or response.
        margin: [-] against self-locking; `None` for a cycle or response.
        iterations: of the solver; `None` for a response.
        seconds: [s] median of several warm calls, without the march.
    """

    family: str = word()
    setting: str = word()
    status: str = word()
    value: float = reading("", doc="efficiency, or of a response a displacement in m")
    error: float = reading("")
    speed_error: float | None = reading("")
    margin: float | None = reading("")
    iterations: int | None = reading("")
    seconds: float = reading("s")

    @property
    def good(self) -> bool:
        """Whether there is a value."""
        return self.status == Status[Status.converged]

    @property
    def answered(self) -> bool:
        """Whether there is a value, or what the machine does is known to have none: no delivery, wet."""
        return self.good or self.status in (Status[Status.no_delivery], Status[Status.wet])


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Extremes(Result):
    """A machine at its extremes.

    Attributes:
        scene: name of the machine.
        cases: by family, from mild to extreme. One without a solution has a status that says so, and
            an error that is not finite.
        measured_on: cores, load and versions of the computer that measured.
    """

    scene: str = word()
    cases: tuple[Extreme, ...] = part(Extreme, key="rows")
    measured_on: Computer = part(Computer, default_factory=this_computer)

    table_dims: ClassVar[tuple[str, ...]] = ("case",)

    @computed_word()
    def study(self) -> str:
        """Name of the study, as in a `Report`."""
        return "extremes"

    @property
    def share_with_valves(self) -> tuple[int, int] | None:
        """Cycles with valves that have an answer, and of how many; `None` for a machine without."""
        cycles = [case for case in self.cases if case.family in WITH_VALVES]
        if not cycles:
            return None
        return sum(case.answered for case in cycles), len(cycles)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each case."""
        return columns_of(self.cases, *self.table_dims)


def extremes(
    scene: Machine | HasMachine,
    families: Iterable[str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Extremes:
    """Solve a machine at its extremes.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        families: names in `FAMILIES`; absent: all that the machine has.
        progress: called before each family with its name, its number and how many there are.

    Raises:
        BadInput: a family that does not exist.
    """
    if families is None:
        families = FAMILIES
    names = tuple(families)
    for name in names:
        if name not in FAMILIES:
            raise BadInput("family", name, f"one of {', '.join(FAMILIES)}")
    assembly = assembled(machine_of(scene))
    cases = []
    for number, name in enumerate(names):
        if progress is not None:
            progress(name, number, len(names))
        family = FAMILIES[name]
        if family is None:
            cases += _near_singular(name, assembly)
        elif assembly.compressor is not None:
            for setting, machine in family.machines(assembly.compressor):
                cases.append(family.solve(name, setting, machine))
    return Extremes(getattr(scene, "name", "design"), tuple(cases))


class Family(NamedTuple):
    """Machines with a crank that become more extreme by one number.

    Attributes:
        label: with a place for the number.
        numbers: from mild to extreme.
        change: from machine and number to the changed machine; `None` for one that has no solution
            to start from.
        has: whether a machine has what is changed.
        solve: from family, setting and changed machine to the case.
    """

    label: str
    numbers: tuple[float, ...]
    change: Callable[[Compressor, float], Compressor | None]
    has: Callable[[Compressor], Any] = lambda compressor: True
    solve: Callable[[str, str, Compressor], Extreme] = lambda *case: _solved(*case)

    def machines(self, compressor: Compressor) -> Iterator[tuple[str, Compressor]]:
        """Setting and machine of each number."""
        if not self.has(compressor):
            return
        for number in self.numbers:
            changed = self.change(compressor, number)
            if changed is not None:
                yield self.label.format(number), changed


def _with_rod(compressor: Compressor, ratio: float) -> Compressor:
    """A rod of another length; its mass and its relative centre of mass stay."""
    mechanism: Any = compressor.mechanism
    length = mechanism.crank_radius / ratio
    share = length / mechanism.conrod_length
    mechanism = eqx.tree_at(
        lambda m: (m.conrod_length, m.conrod_centre, m.conrod_inertia),
        mechanism,
        (length, mechanism.conrod_centre * share, mechanism.conrod_inertia * share**2),
    )
    return replaced(compressor, mechanism=mechanism)


def with_slip(compressor: Compressor, slip: float) -> Compressor | None:
    """The machine with a motor of a slip through its mean torque at its mean speed.

    `None` where it has no periodic state.
    """
    orbit = solve_orbit(compressor, throw=False)
    if not bool(orbit.converged):
        return None
    speed = orbit.mean_speed
    torque = orbit.energy.motor_work / (2 * jnp.pi)
    # A line through mean torque and mean speed, whose idling speed lies above by the slip.
    motor = SlipLine(float(torque / (slip * speed)), float(speed * (1 + slip)))
    return replaced(compressor, motor=motor)


def scaled(tree: Any, end: str, factor: float) -> tuple[Any, int]:
    """The tree with all numbers multiplied whose path ends so, and how many these are."""
    count = 0

    def scale(path, leaf):
        nonlocal count
        if not jax.tree_util.keystr(path).endswith(end):
            return leaf
        count += 1
        return jnp.asarray(leaf) * factor

    return jax.tree_util.tree_map_with_path(scale, tree), count


def _times(end: str) -> Callable[[Compressor, float], Compressor]:
    """The machine with all numbers multiplied whose path ends so."""
    return lambda compressor, factor: scaled(compressor, end, factor)[0]


def _has_valves(compressor: Compressor) -> bool:
    return isinstance(compressor.gas, Cylinder)


def _scaled_valves(compressor: Compressor, name: str, factor: float) -> tuple[Any, int]:
    """Both valves with a number multiplied, and how many numbers these are."""
    gas: Any = compressor.gas
    return scaled((gas.suction_valve, gas.discharge_valve), f".{name}", factor)


def _times_of_valves(name: str) -> Callable[[Compressor, float], Compressor]:
    """The machine with a number of both valves multiplied."""

    def change(compressor: Compressor, factor: float) -> Compressor:
        (suction, discharge), _ = _scaled_valves(compressor, name, factor)
        gas = replaced(compressor.gas, suction_valve=suction, discharge_valve=discharge)
        return replaced(compressor, gas=gas)

    return change


def _valves_have(name: str) -> Callable[[Compressor], bool]:
    """Whether a machine has valves with such a number."""
    return lambda compressor: (
        _has_valves(compressor) and _scaled_valves(compressor, name, 1.0)[1] > 0
    )


def _at_speed(compressor: Compressor, factor: float) -> Compressor:
    """The machine at a multiple of its speed, which is constant."""
    return replaced(compressor, motor=ConstantSpeed(factor * compressor.motor.speed_guess))


def _cycle_solved(family: str, setting: str, compressor: Compressor) -> Extreme:
    """The cycle of the first cylinder at constant speed, beside the march to its periodic state."""
    machine = one_cylinder(compressor)
    arguments = machine.gas, machine.mechanism, machine.motor.speed_guess
    cycle = solve_cycle(*arguments, throw=False)
    march = solve_cycle(*arguments, _CYCLE_MARCH, throw=False)
    errors = []
    for name in ("indicated_work", "volumetric_efficiency"):
        ratio = float(getattr(cycle, name) / getattr(march, name))
        errors.append(abs(ratio - 1.0))
    status = Status[cycle.status]
    if bool(cycle.converged) and not bool(march.converged):
        status = "converged, but the march that verifies it did not end"
    error = float("inf")
    if status == Status[Status.converged]:
        error = max(errors)
    return Extreme(
        family=family,
        setting=setting,
        status=status,
        value=float(cycle.volumetric_efficiency),
        error=error,
        speed_error=None,
        margin=None,
        iterations=int(cycle.iterations),
        seconds=median_time(lambda: solve_cycle(*arguments, throw=False)),
    )


FAMILIES: dict[str, Family | None] = {
    # connecting rods hardly longer than the crank
    "steep rod": Family(
        label="r/l = {:g}",
        numbers=(0.3, 0.5, 0.7, 0.85, 0.95),
        change=_with_rod,
        has=lambda compressor: isinstance(compressor.mechanism, SliderCrank),
    ),
    # friction that grows until the joints lock
    "near locking": Family(
        label="coefficients x {:g}",
        numbers=(2.0, 4.0, 8.0, 16.0, 32.0, 40.0, 64.0),
        change=_times(".coefficient"),
        has=lambda compressor: scaled(compressor, ".coefficient", 1.0)[1],
    ),
    # crank inertias so small that the crank all but stalls at the end of the compression
    "near stall": Family(
        label="crank inertia x {:g}",
        numbers=(0.3, 0.1, 0.03, 0.01, 3e-3),
        change=_times(".crankshaft.inertia"),
    ),
    # oil of ever lower viscosity: journals that run at ever higher eccentricity
    "thin film": Family(
        label="viscosity x {:g}",
        numbers=(0.5, 0.2, 0.1, 0.03, 0.01),
        change=_times(".dynamic_viscosity"),
        has=lambda compressor: film_journals(
            compressor.friction, compressor.crankshaft.main_journal
        ),
    ),
    # motors of ever smaller slip, through the same mean torque at the same mean speed
    "stiff motor": Family(label="slip {:g}", numbers=(0.1, 0.01, 1e-3, 1e-4), change=with_slip),
    # valves that swing many times in a revolution
    "low speed": Family(
        label="speed x {:g}",
        numbers=(0.5, 0.2, 0.1),
        change=_at_speed,
        has=_has_valves,
        solve=_cycle_solved,
    ),
    "hard springs": Family(
        label="stiffness of valves x {:g}",
        numbers=(4.0, 16.0, 64.0),
        change=_times_of_valves("stiffness"),
        has=_valves_have("stiffness"),
        solve=_cycle_solved,
    ),
    "light plates": Family(
        label="mass of valves x {:g}",
        numbers=(0.3, 0.1, 0.03),
        change=_times_of_valves("mass"),
        has=_valves_have("mass"),
        solve=_cycle_solved,
    ),
    # clearances so small that the pressure falls and rises within a few degrees
    "small clearance": Family(
        label="clearance x {:g}",
        numbers=(0.3, 0.1, 0.03),
        change=_times(".clearance_ratio"),
        has=_has_valves,
        solve=_cycle_solved,
    ),
    # the rotor at a resonance
    "near-singular response": None,
}


def _families_with_valves() -> tuple[str, ...]:
    names = []
    for name, family in FAMILIES.items():
        if family and family.solve is _cycle_solved:
            names.append(name)
    return tuple(names)


# Families of cycles with valves.
WITH_VALVES = _families_with_valves()


def _solved(family: str, setting: str, compressor: Compressor) -> Extreme:
    solver = Collocation(reversals=compressor.load_reversals)
    orbit = solve_orbit(compressor, solver, verify=_MARCH, throw=False)
    march = orbit.verification
    assert march is not None
    good = bool(orbit.converged)
    status = Status[orbit.status]
    if good and bool(march.status != Status.converged):
        status = "converged, but the march that verifies it did not end"
    verified = good and status == Status[Status.converged]
    seconds = median_time(lambda: solve_orbit(compressor, solver, throw=False))
    error = float("inf")
    speed_error = float("inf")
    if verified:
        error = abs(float(march.efficiency_error))
        speed_error = float(march.speed_error)
    return Extreme(
        family=family,
        setting=setting,
        status=status,
        value=float(orbit.mechanical_efficiency),
        error=error,
        speed_error=speed_error,
        margin=float(orbit.margin),
        iterations=int(orbit.iterations),
        seconds=seconds,
    )


def _near_singular(name: str, assembly: Assembly) -> Iterator[Extreme]:
    """The rotor at a resonance, with ever less damping in its links."""
    case = assembly.loads
    planes = assembly.balancing
    if assembly.rotor is None or case is None or planes is None or not assembly.given_loads:
        return
    top = float(max_of(planes.speeds))
    speeds = np.linspace(*_SPEEDS, _COUNT) * top
    damped = loaded_rotor(assembly, jnp.asarray(speeds))
    loads = assembly.given_loads
    undamped = scaled(damped, "damping", _LEAST_DAMPING)[0]
    # a resonance: the highest of the peaks within the range, not an end of it
    sizes = _sizes(undamped, loads, speeds)
    inner = sizes[1:-1]
    peaks = np.flatnonzero((inner > sizes[:-2]) & (inner > sizes[2:])) + 1
    highest = np.nanargmax(sizes)
    if peaks.size:
        highest = peaks[np.argmax(sizes[peaks])]
    worst = speeds[highest]
    width = speeds[1] - speeds[0]
    for _ in range(3):
        near = worst + np.linspace(-1, 1, 41) * width
        # 41 points over two widths: the next search takes one step of this to both sides.
        worst = near[np.nanargmax(_sizes(undamped, loads, near))]
        width = width / 20
    at = jnp.asarray([worst])
    for times in (1.0, 0.1, 1e-3, _LEAST_DAMPING):
        model = scaled(damped, "damping", times)[0]
        try:
            structured = respond(model, loads, at, solver="structured")
            dense = respond(model, loads, at, solver="dense")
        except SolveFailed as failed:
            yield Extreme(
                family=name,
                setting=f"damping x {times:g}",
                status=str(failed),
                value=float("nan"),
                error=float("nan"),
                speed_error=None,
                margin=None,
                iterations=None,
                seconds=float("nan"),
            )
            continue
        value = float(max_of(jnp.abs(structured.displacement)))
        gap = float(max_of(jnp.abs(structured.displacement - dense.displacement))) / value
        status = "the response is not to be relied on"
        error = float("inf")
        if bool(jnp.all(structured.ok)):
            status = Status[Status.converged]
            error = gap
        seconds = median_time(lambda model=model, at=at: respond(model, loads, at))
        setting = f"damping x {times:g}, {worst * 30 / np.pi:.1f} rpm"
        yield Extreme(
            family=name,
            setting=setting,
            status=status,
            value=value,
            error=error,
            speed_error=None,
            margin=None,
            iterations=None,
            seconds=seconds,
        )


def _sizes(model, loads, speeds) -> np.ndarray:
    """[m] Largest displacement at each speed [rad/s]."""
    response = respond(model, loads, jnp.asarray(speeds))
    of_first_order = jnp.abs(response.displacement[0])
    return np.asarray(max_of(max_of(of_first_order, axis=-1), axis=-1))
