r"""Campbell diagram and critical speeds."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.declared import reading
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import is_any_traced
from .._core.progress import progress_of, watched
from .._core.results import Result
from ._blocks import lu_factor, lu_solve
from ._conventions import add, from_planes, take, to_planes
from ._damped import DampedModes, _damped, check_request, damped_modes, system_matrices
from ._layout import layout_of
from ._model import RotorModel
from ._operator import apply, operator_at
from ._pencil import definite_pencil
from ._prepare import prepare
from ._system import System, marked, undamped


def campbell(
    model: RotorModel | System,
    spin_speeds: Float[Array, " speeds"],
    count: int = 12,
    *,
    damping: bool = True,
) -> DampedModes:
    """Damped modes over the spin speed, each with its whirl; (speeds, count) in all fields.

    Modes are in the order of their undamped frequency |lambda| at each speed.

    Args:
        model: the model, or the `System` prepared from it.
        spin_speeds: [rad/s] (speeds,)
        count: number of modes.
        damping: false leaves out all damping.

    Raises:
        BadInput: a number of modes that the model does not have, or a speed that is not finite.
    """
    check_request(model, count, spin_speeds=spin_speeds)
    spin_speeds = jnp.asarray(spin_speeds, float)
    if is_any_traced(model, spin_speeds) or not spin_speeds.size:
        return _campbell(model, spin_speeds, count, damping)
    # By the program of a single speed, so that the time that is left can be told; a loop within a
    # program takes as long.
    each = []
    with progress_of("Modes", spin_speeds.size, unit="speeds", show=watched()) as progress:
        for speed in spin_speeds:
            each.append(jax.block_until_ready(damped_modes(model, speed, count, damping=damping)))
            progress.at(len(each))
    return jax.tree.map(lambda *fields: jnp.stack(fields), *each)


@kept_jit
def _campbell(model, spin_speeds, count, damping):
    system = prepare(model)
    return jax.lax.map(lambda spin: _damped(system, spin, count, False, damping), spin_speeds)


class CriticalSpeeds(Result, eqx.Module):
    """Speeds W at which a mode's frequency is n W.

    Attributes:
        speed: [rad/s] (m,) ascending; not a number where the search found none, or all of them for a
            model with a number out of bounds, which only traced values can be.
        growth: [rad/s] (m,) real part of the eigenvalue there; -growth/(n W) is about the damping
            ratio with which the response peaks.
        residual: [-] (m,) relative change in the last step.
    """

    speed: Float[Array, " m"] = reading("rad/s", "critical_speed")
    growth: Float[Array, " m"] = reading("rad/s", "critical_speed")
    residual: Float[Array, " m"] = reading("", "critical_speed")

    table_dims: ClassVar[tuple[str, ...]] = ("critical_speed",)


def critical_speeds(
    model: RotorModel | System,
    count: int = 4,
    *,
    order: int = 1,
    damping: bool = True,
    near: Float[Array, ""] = 0.0,
) -> CriticalSpeeds:
    r"""Speeds W with an eigenvalue a + i n W, forward and backward ones.

    Start: the undamped synchronous problem K x = W^2 (n^2 M - i n G) x with the links at the speed
    `near`. Then Newton steps on the complex equation det P(a + i n W; W) = 0 for the two real
    unknowns a and W, with left and right vectors by inverse iteration; links that depend on the
    speed are followed. Differentiable: the last step carries the implicit derivative.

    Args:
        model: the model, or the `System` prepared from it.
        count: how many starts, lowest first.
        order: n, at least 1.
        damping: false leaves out all damping.
        near: [rad/s] where tables of the links are read for the start.

    Raises:
        BadInput: an order below one, more starts than degrees of freedom, or a `near` that is not
            finite.
    """
    if order < 1:
        raise BadInput("order", order, "at least 1")
    check_request(model, count, near=near)
    return _critical(model, count, order, damping, jnp.asarray(near, float))


def critical_speeds_between(
    model: RotorModel | System,
    spin_speeds: Float[Array, " speeds"],
    count: int = 12,
    *,
    order: int = 1,
    damping: bool = True,
    diagram: DampedModes | None = None,
) -> CriticalSpeeds:
    """All critical speeds within a range: where the Campbell diagram crosses the line n W.

    The crossings between neighbouring speeds of the diagram start the Newton steps of
    `critical_speeds`, so that heavily damped modes are found as well; those with a damping ratio of
    0.707 or more are left out, because no response peaks there. Not to be traced, because the number of
    crossings depends on the numbers.

    Args:
        model: the model, or the `System` prepared from it.
        spin_speeds: [rad/s] (speeds,) rising; two crossings of one mode between two of them are
            missed.
        count: number of modes of the diagram.
        order: n, at least 1.
        damping: false leaves out all damping.
        diagram: the modes at these speeds, as `campbell` gives them; computed if absent.

    Raises:
        BadInput: an order below one, or speeds that do not rise.
    """
    spin_speeds = jnp.asarray(spin_speeds, float)
    if order < 1:
        raise BadInput("order", order, "at least 1")
    if spin_speeds.size < 2 or not bool(jnp.all(jnp.diff(spin_speeds) > 0)):
        raise BadInput("spin_speeds", spin_speeds, "at least two rising speeds")
    model = prepare(model)
    if diagram is None:
        diagram = campbell(model, spin_speeds, count, damping=damping)
    modes = _by_frequency(diagram)
    speed = np.asarray(spin_speeds)
    gap = np.asarray(modes.frequency) - order * speed[:, None]
    # A gap of zero counts where the interval ends, so once, and at the very first speed, unless the
    # rotor does not spin there. Modes that the model lacks at a speed are NaN, which compares as
    # false: they cross nothing.
    crosses = (gap[:-1] > 0) & (gap[1:] <= 0) | (gap[:-1] < 0) & (gap[1:] >= 0)
    crosses[0] |= (gap[0] == 0) & (gap[1] != 0) & (speed[0] > 0)
    interval, mode = np.nonzero(crosses)
    if not interval.size:
        return CriticalSpeeds(*(jnp.zeros(0),) * 3)

    def modes_at(spin):
        return _by_frequency(damped_modes(model, spin, count, damping=damping))

    start, growth, shapes = _by_regula_falsi(modes_at, speed, gap, interval, mode, order)
    shape = shapes[:, layout_of(model).active]
    roots = _from_starts(model, jnp.asarray(start), jnp.asarray(growth), shape, order, damping)
    # Where a mode begins to oscillate the numbers shift, which looks like a crossing: its start
    # leads to another crossing, or nowhere.
    w = np.asarray(roots.speed)
    growth = np.asarray(roots.growth)
    close = np.abs(w - start) <= np.max(np.diff(speed))
    # |a| = n W is the damping ratio of 0.707.
    peaks = -growth < order * w
    value = w + 1j * growth
    distinct = []
    for i in np.flatnonzero(np.isfinite(w) & close & peaks):
        # Two starts on one root agree to the 1e-8 at which Newton's method counts as converged.
        if np.all(np.abs(value[i] - value[distinct]) > 1e-7 * w[i]):
            distinct.append(i)
    distinct.sort(key=lambda i: w[i])
    return jax.tree.map(lambda a: a[np.array(distinct, int)], roots)


def _by_regula_falsi(modes_at, speed, gap, interval, mode, order):
    """Speeds of crossings, closer than the diagram has them, with growths and shapes of the modes there.

    A step or two of it tell close neighbours apart, on which Newton's method would meet one root.

    Args:
        modes_at: modes in the order of their frequency at a spin speed.
        speed: [rad/s] (speeds,) of the diagram.
        gap: [rad/s] (speeds, modes) frequencies less those of the line.
        interval, mode: (m,) number of the lower speed and of the mode of each crossing.
        order: of the line.
    """
    low = speed[interval]
    high = speed[interval + 1]
    below = gap[interval, mode]
    above = gap[interval + 1, mode]
    start = low
    value = np.zeros(low.shape, complex)
    crossing = []
    for _ in range(3):
        start = low + below / (below - above) * (high - low)
        crossing = list(zip(map(modes_at, start), mode, strict=True))
        value = np.array([complex(modes.eigenvalue[number]) for modes, number in crossing])
        gap_there = np.imag(value) - order * start
        # the end of the interval moves whose gap has the same sign
        same = gap_there * below > 0
        low = np.where(same, start, low)
        below = np.where(same, gap_there, below)
        high = np.where(same, high, start)
        above = np.where(same, above, gap_there)
        above = np.where(below == above, below - 1.0, above)  # both zero: it is found
    shapes = [np.asarray(modes.shape)[number] for modes, number in crossing]
    return start, np.real(value), np.stack(shapes)


def _by_frequency(modes: DampedModes) -> DampedModes:
    """The modes in the order of Im lambda, in which they are continuous over the speed."""
    order = jnp.argsort(modes.frequency, -1)

    def pick(a):
        at = order.reshape(*order.shape, *(1,) * (a.ndim - order.ndim))
        return jnp.take_along_axis(a, at, order.ndim - 1)

    return DampedModes(*map(pick, (modes.eigenvalue, modes.shape, modes.whirl)), modes.growth)


@kept_jit
def _critical(model, count, order, damping, near):
    system = prepare(model)
    # A root does not depend on where the steps to it begin: only the last one carries derivatives.
    start = jax.lax.stop_gradient(_synchronous(system, count, order, near))
    no_growth = jnp.zeros_like(start[0])
    roots = _from_starts(system, start[0], no_growth, start[1].T, order, damping)
    first = jnp.argsort(roots.speed)
    roots = jax.tree.map(lambda a: a[first], roots)
    speed = marked(system, roots.speed)
    growth = marked(system, roots.growth)
    return CriticalSpeeds(speed, growth, roots.residual)


@kept_jit
def _from_starts(system, begin, begin_growth, shapes, order, damping):
    """Newton steps from speeds, growths and vectors (m, active)."""
    numbers, constants = eqx.partition(system, eqx.is_inexact_array)
    frozen = jax.lax.stop_gradient(numbers)
    b = jnp.asarray(np.random.default_rng(1).normal(size=shapes.shape[1])) + 0j

    def product(numbers, growth, spin, x, transpose=False):
        system = eqx.combine(numbers, constants)
        return _stiffness_times(system, growth, spin, x, order, damping, transpose)

    def vectors(growth, spin, x, y):
        # A trace off the root, so that P can be factorised even where the speed is exact.
        spin = spin * (1 + 1e-13)
        full, d = system_matrices(eqx.combine(frozen, constants), spin, damping=damping)
        lam = growth + 1j * order * spin
        lu = lu_factor(lam**2 * full.mass + lam * d + full.stiffness)

        def solved(b, transpose):
            # The product has digits of soft springs that the matrix has lost beside stiff shafts.
            x = lu_solve(lu, b[:, None], transpose)[:, 0]
            residual = b - product(frozen, growth, spin, x, transpose)
            x = x + lu_solve(lu, residual[:, None], transpose)[:, 0]
            return x / jnp.linalg.norm(x)

        return solved(x, False), solved(y, True)

    def newton(numbers, growth, spin, x, y):
        # y^T P x without a conjugate: y is the null vector of P^T, so that errors of x and of y count
        # in the value by their product only.
        bilinear = lambda n, a, w: y @ product(n, a, w, x)  # noqa: E731
        value = bilinear(numbers, growth, spin)
        slope = jax.jacfwd(bilinear, (1, 2))(frozen, growth, spin)
        # At the root the residual is zero and the slope's own derivative drops out: a frozen slope
        # is enough for that of the answer.
        a, w = jax.lax.stop_gradient(slope)
        # value + a da + w dw = 0 in the complex plane, da and dw real
        det = a.real * w.imag - a.imag * w.real
        da = -(value.real * w.imag - value.imag * w.real) / det
        dw = -(a.real * value.imag - a.imag * value.real) / det
        return growth + da, spin + dw

    def root(spin, growth, x):
        def step(state, _):
            growth, spin, x, y = state
            x, y = vectors(growth, spin, x, y)
            a, w = newton(frozen, growth, spin, x, y)
            return (a, w, x, y), jnp.abs(w - spin) / jnp.abs(w)

        # Without damping P is Hermitian and conj(x) its left vector; b makes sure that the start is
        # not orthogonal to that of a damped one.
        state = (growth, spin, x, b + jnp.conj(x))
        (growth, spin, x, y), change = jax.lax.scan(step, state, None, length=8)
        state = jax.lax.stop_gradient((growth, spin, x, y))
        growth, spin = newton(numbers, *state)
        # Newton's method doubles the digits: after a change of 1e-8 only rounding is left.
        converged = (change[-1] < 1e-8) & (spin > 0)
        spin = jnp.where(converged, spin, jnp.nan)
        growth = jnp.where(converged, growth, jnp.nan)
        return spin, growth, change[-1]

    starts = (begin, begin_growth, jnp.asarray(shapes) / jnp.linalg.norm(shapes, axis=1)[:, None])
    return CriticalSpeeds(*jax.lax.map(lambda a: root(*a), starts))


def _stiffness_times(system, growth, spin, x, order, damping, transpose):
    """P x element by element: P is the dynamic stiffness at the frequency n W - i a."""
    if not damping:
        system = undamped(system)
    # i (n W - i a) = a + i n W: with this complex frequency the operator is P at an eigenvalue.
    z = operator_at(system, spin, order * spin - 1j * growth)
    if not damping:
        z = z._replace(damping=jnp.zeros_like(z.damping))
    return on_active(system, x, lambda x: apply(z, x, transpose=transpose))


def _synchronous(system, count, order, near):
    """Starting values: speeds (count,) and vectors (a, count) of the undamped problem."""
    full, _ = system_matrices(system, near, damping=False)
    k = (full.stiffness + full.stiffness.T) / 2
    inertia = full.mass
    # lambda = i n W makes the gyroscopic term i n W^2 G grow like the inertia; G is skew, h Hermitian.
    h = order**2 * inertia - 1j * order * full.gyroscopic
    # A grain of inertia keeps a model with rigid motions positive definite; it is only the start.
    # By the median, because one stiff spring would make a grain that outweighs the shaft.
    moving = jnp.diagonal(inertia) > 0
    ratio = jnp.abs(jnp.diagonal(k)) / jnp.select([moving], [jnp.diagonal(inertia)], jnp.nan)
    mu, x = definite_pencil(k + 1e-11 * jnp.nanmedian(ratio) * inertia, h)
    # mu = 1/W^2, so that the largest are the lowest speeds. It is negative for the forward modes of
    # flat disks, which the gyroscopic moment keeps above the line n W at any speed.
    mu, x = mu[::-1][:count], x[:, ::-1][:, :count]
    x = x / jnp.linalg.norm(x, axis=0)
    # Again within their span, with the strain energy element by element: motions on soft springs,
    # which the assembled matrix mixes, come apart.
    static = operator_at(system, near, jnp.zeros(()))
    energy = jax.vmap(lambda x: on_active(system, x, lambda x: apply(static, x)), -1, -1)(x)
    energy = x.conj().T @ energy
    inner, v = definite_pencil((energy + energy.conj().T) / 2, x.conj().T @ h @ x)
    # where that energy is not positive definite, the vectors of before have to do
    good = jnp.all(jnp.isfinite(v)) & jnp.all(jnp.isfinite(inner))
    mu = jnp.select([good], [inner[::-1]], mu)
    x = jnp.select([good], [x @ v[:, ::-1]], x)
    speed = 1 / jnp.sqrt(jnp.where(mu > 0, mu, jnp.nan))
    return speed, x / jnp.linalg.norm(x, axis=0)


def on_active(system, x, function):
    """A function of motions (n, planes, 2), applied to active degrees of freedom."""
    layout = system.layout
    places = np.flatnonzero(system.layout.active)
    full = add(jnp.zeros(layout.n * layout.dof, complex), places, x).reshape(-1, layout.dof)
    out = from_planes(function(to_planes(full, layout.dof)), layout.dof)
    return take(out.reshape(-1), places)
