r"""Solve a machine at its extremes: values with their errors, or the reason why there is none.

Each family moves numbers of the machine, step by step, towards a place where the equations become
stiff, singular or impossible. The default solver gives value and status, an independent march of one
revolution its error; of the rotor, two linear solvers are compared.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from .._status import SolveFailed, Status
from ..compressor import Compressor
from ..coupling import loaded_rotor
from ..crank import Collocation, TimeIntegration, solve_orbit
from ..friction import film_journals
from ..machine import Assembly, assembled, machine_of
from ..mechanism import SliderCrank
from ..motor import SlipLine
from ..rotor import respond
from ._measure import median_time

# Fewer steps than of a single verification: near a stall a march would take all it is given.
_MARCH = TimeIntegration(diffrax.Dopri8(), 1e-11, max_steps=8192, samples=2000)
# [-] Speeds of the rotor that are searched for its largest response, over the highest of its planes.
_SPEEDS, _COUNT = (0.05, 2.0), 400
_LEAST_DAMPING = 1e-6  # [-] of the links' own


class Extreme(NamedTuple):
    """One machine of the study.

    Attributes:
        family: what is extreme about it.
        setting: what was moved, and how far.
        status: of the solver, as a sentence.
        value: [-] mechanical efficiency; of a response [m] its largest displacement.
        error: [-] of the value: by the march, or the difference of the two linear solvers.
        speed_error: [-] of the speed by the march, relative to the mean; `None` for a response.
        margin: [-] against self-locking; `None` for a response.
        iterations: of the solver; `None` for a response.
        seconds: [s] median of several warm calls, without the march.
    """

    family: str
    setting: str
    status: str
    value: float
    error: float
    speed_error: float | None
    margin: float | None
    iterations: int | None
    seconds: float

    @property
    def good(self) -> bool:
        """Whether there is a value."""
        return self.status == Status[Status.converged]


def extremes(
    scene: Any,
    families: Iterable[str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Extreme, ...]:
    """Solve a machine at its extremes.

    Args:
        scene: of `jaxcomp.load`, or a `Machine`.
        families: names in `FAMILIES`; absent: all that the machine has.
        progress: called before each family with its name, its number and how many there are.

    Returns:
        Every case, by family, from mild to extreme. A case without a solution has a status that says
        so, and an error that is not finite.

    Raises:
        BadInput: a family that does not exist.
    """
    names = tuple(FAMILIES) if families is None else tuple(families)
    for name in names:
        if name not in FAMILIES:
            raise BadInput("family", name, f"one of {', '.join(FAMILIES)}")
    assembly = assembled(machine_of(scene))
    progress = progress or (lambda label, number, total: None)
    found: list[Extreme] = []
    for number, name in enumerate(names):
        progress(name, number, len(names))
        found += FAMILIES[name](name, assembly)
    return tuple(found)


def _of_the_crank(change: Callable[[Compressor], Iterator[tuple[str, Compressor]]]):
    """A family of machines with a crank, from what changes in the compressor."""

    def family(name: str, assembly: Assembly) -> Iterator[Extreme]:
        compressor = assembly.compressor
        if compressor is None:
            return
        for setting, changed in change(compressor):
            yield _solved(name, setting, changed)

    return family


def _solved(family: str, setting: str, compressor: Compressor) -> Extreme:
    solver = Collocation(reversals=compressor.load_reversals)
    orbit = solve_orbit(compressor, solver, verify=_MARCH, throw=False)
    march = orbit.verification
    assert march is not None
    good = bool(orbit.converged)
    status = Status[orbit.status]
    if good and bool(march.status != Status.converged):
        status = "converged, but the march that verifies it did not end"
    known = good and status == Status[Status.converged]
    seconds = median_time(lambda: solve_orbit(compressor, solver, throw=False))
    return Extreme(
        family,
        setting,
        status,
        float(orbit.mechanical_efficiency),
        abs(float(march.efficiency_error)) if known else float("inf"),
        float(march.speed_error) if known else float("inf"),
        float(orbit.margin),
        int(orbit.iterations),
        seconds,
    )


def _steep_rods(compressor: Compressor):
    """Connecting rods hardly longer than the crank; mass and relative centre of mass stay."""
    mechanism = compressor.mechanism
    if not isinstance(mechanism, SliderCrank):
        return
    for ratio in (0.3, 0.5, 0.7, 0.85, 0.95):
        length = mechanism.crank_radius / ratio
        share = length / mechanism.conrod_length
        numbers = (length, mechanism.conrod_centre * share, mechanism.conrod_inertia * share**2)
        where = lambda m: (m.conrod_length, m.conrod_centre, m.conrod_inertia)  # noqa: E731
        changed = eqx.tree_at(where, mechanism, numbers)
        yield f"r/l = {ratio:g}", eqx.tree_at(lambda c: c.mechanism, compressor, changed)


def _near_locking(compressor: Compressor):
    """Coefficients of friction that grow until the joints lock."""
    if not scaled(compressor.friction, ".coefficient", 1.0)[1]:
        return
    for times in (2.0, 4.0, 8.0, 16.0, 32.0, 40.0, 64.0):
        yield f"coefficients x {times:g}", scaled(compressor, ".coefficient", times)[0]


def _near_stall(compressor: Compressor):
    """Crank inertias so small that the crank all but stalls at the end of the compression."""
    for times in (0.3, 0.1, 0.03, 0.01, 3e-3):
        changed = eqx.tree_at(
            lambda c: c.mechanism.crank_inertia,
            compressor,
            compressor.mechanism.crank_inertia * times,
        )
        yield f"crank inertia x {times:g}", changed


def _thin_films(compressor: Compressor):
    """Oil of ever lower viscosity: journals that run at ever higher eccentricity."""
    if not film_journals(compressor.friction):
        return
    for times in (0.5, 0.2, 0.1, 0.03, 0.01):
        changed = scaled(compressor, ".dynamic_viscosity", times)[0]
        yield f"viscosity x {times:g}", changed


def _stiff_motors(compressor: Compressor):
    """Motors of ever smaller slip, through the same mean torque at the same mean speed."""
    for slip in (0.1, 0.01, 1e-3, 1e-4):
        driven = with_slip(compressor, slip)
        if driven is not None:
            yield f"slip {slip:g}", driven


def with_slip(compressor: Compressor, slip: float) -> Compressor | None:
    """The machine with a motor of a slip through its mean torque at its mean speed; `None` where it has
    no periodic state."""
    orbit = solve_orbit(compressor, throw=False)
    if not bool(orbit.converged):
        return None
    speed, torque = orbit.mean_speed, orbit.energy.motor_work / (2 * jnp.pi)
    motor = SlipLine(float(torque / (slip * speed)), float(speed * (1 + slip)))
    return eqx.tree_at(lambda c: c.motor, compressor, motor)


def _near_singular(name: str, assembly: Assembly) -> Iterator[Extreme]:
    """The rotor at a resonance, with ever less damping in its links."""
    case, planes = assembly.loads, assembly.balancing
    if assembly.rotor is None or case is None or planes is None or not assembly.given_loads:
        return
    top = float(jnp.max(planes.speeds))
    speeds = np.linspace(*_SPEEDS, _COUNT) * top
    whole = loaded_rotor(assembly, jnp.asarray(speeds))
    loads = assembly.given_loads
    bare = scaled(whole, "damping", _LEAST_DAMPING)[0]
    # a resonance: the highest of the peaks within the range, not an end of it
    sizes = _sizes(bare, loads, speeds)
    inner = sizes[1:-1]
    peaks = np.flatnonzero((inner > sizes[:-2]) & (inner > sizes[2:])) + 1
    highest = peaks[np.argmax(sizes[peaks])] if peaks.size else np.nanargmax(sizes)
    worst, width = speeds[highest], speeds[1] - speeds[0]
    for _ in range(3):
        near = worst + np.linspace(-1, 1, 41) * width
        worst, width = near[np.nanargmax(_sizes(bare, loads, near))], width / 20
    at = jnp.asarray([worst])
    for times in (1.0, 0.1, 1e-3, _LEAST_DAMPING):
        model = scaled(whole, "damping", times)[0]
        try:
            one, other = (respond(model, loads, at, solver=s) for s in ("structured", "dense"))
        except SolveFailed as failed:
            yield Extreme(name, f"damping x {times:g}", str(failed), *[float("nan")] * 2, None, None,
                          None, float("nan"))  # fmt: skip
            continue
        value = float(jnp.max(jnp.abs(one.displacement)))
        gap = float(jnp.max(jnp.abs(one.displacement - other.displacement))) / value
        good = bool(jnp.all(one.ok))
        status = Status[Status.converged] if good else "the response is not to be relied on"
        seconds = median_time(lambda model=model, at=at: respond(model, loads, at))
        setting = f"damping x {times:g}, {worst * 30 / np.pi:.1f} rpm"
        yield Extreme(name, setting, status, value, gap if good else float("inf"), None, None, None,
                      seconds)  # fmt: skip


def _sizes(model, loads, speeds) -> np.ndarray:
    """[m] Largest displacement at each speed [rad/s]."""
    found = respond(model, loads, jnp.asarray(speeds))
    return np.asarray(jnp.max(jnp.abs(found.displacement[0]), axis=(-2, -1)))  # of order 1


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


FAMILIES: dict[str, Callable[[str, Assembly], Iterator[Extreme]]] = {
    "steep rod": _of_the_crank(_steep_rods),
    "near locking": _of_the_crank(_near_locking),
    "near stall": _of_the_crank(_near_stall),
    "thin film": _of_the_crank(_thin_films),
    "stiff motor": _of_the_crank(_stiff_motors),
    "near-singular response": _near_singular,
}
