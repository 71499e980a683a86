r"""Full matrices of a model, and its undamped modes.

Undamped modes without spin, their derivatives, also of repeated eigenvalues, and the static limit of
the magnetic pull.
"""

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.declared import computed
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.extremes import max_of
from .._core.fields import admissible
from .._core.results import Data, Result
from ._conventions import AXES, add, from_planes, to_planes
from ._layout import layout_of
from ._model import RotorModel
from ._operator import Operator, add_links, elastic_force, operator_at
from ._pencil import CLUSTER, definite_pencil, pencil
from ._system import System, bare, follow, link_matrices, marked, released


class Matrices(NamedTuple):
    """Full matrices over the active degrees of freedom, and their motion from those.

    Attributes:
        mass: [kg, kg m, kg m2] (a, a)
        damping: [N s/m] (a, a), [N s] and [N m s] where rotations enter; without the gyroscopic part.
        gyroscopic: [kg m2] (a, a), to be multiplied by the spin speed.
        stiffness: [N/m] (a, a), [N] and [N m] where rotations enter; links included.
        expand: [-, m] (n * dof, a) motion of all nodes from the active degrees of freedom.
    """

    mass: Array
    damping: Array
    gyroscopic: Array
    stiffness: Array
    expand: Array


def matrices(
    model: RotorModel | System, spin_speed: Float[Array, ""] = 0.0, *, with_links: bool = True
) -> Matrices:
    """Full matrices of a model at a spin speed [rad/s], without modal damping.

    Args:
        model: the model, or the `System` prepared from it.
        spin_speed: [rad/s] at which the links are evaluated.
        with_links: false leaves out bearings, mounts, pins and magnetic pull (free-free).
    """
    if not with_links:
        model = released(model)
    return _matrices(model, jnp.asarray(spin_speed, float), with_links)


@kept_jit
def _matrices(model, spin_speed, with_links) -> Matrices:
    system = bare(model)
    layout = system.layout
    n = layout.n
    dof = layout.dof
    i, j = layout.pairs.T
    terms = system.inertia.shape[-1]
    # each element as blocks between its ends, (u, phi) by (u, phi)
    ends = system.elements.reshape(-1, 2, 2, 2, 2, terms)
    blocks = jnp.moveaxis(ends, 3, 2).reshape(-1, 2, 2, terms)  # four an element
    diagonal = np.arange(n) * (n + 1)
    at = np.stack([i * n + i, i * n + j, j * n + i, j * n + j], -1).reshape(-1)
    # Added up, because elements between the same nodes act in parallel.
    blocks = add(jnp.zeros((n * n, 2, 2, terms)), at, blocks)
    blocks = add(blocks, diagonal, system.inertia).reshape(n, n, 2, 2, terms)
    planes = _PLANES[:terms, : dof // 2, : dof // 2]

    # A term stands in the planes that `_PLANES` gives it: for its block B and the planes a and b the
    # entries (node n, plane a, i), (node m, plane b, j) are B_ij times the number for a, b.
    def in_planes(q):
        return jnp.einsum("nmijq,qab->nmaibj", blocks[..., q], planes[q]).reshape(n, n, dof, dof)

    k = in_planes(_STIFFNESS[: terms // 2])
    m = in_planes(_INERTIA[: terms // 2])
    g = in_planes(_POLAR)
    bodies = layout.centres
    m = m.at[bodies, bodies].add(system.bodies[:, 0])
    g = g.at[bodies, bodies].add(system.bodies[:, 1])
    alpha, beta = (0.0, 0.0) if system.damping is None else system.damping
    # Before the links join k, whose damping is their own.
    c = alpha * m + beta * k
    if with_links:
        a, b = layout.links.T
        links = jnp.stack(link_matrices(system, spin_speed))
        rows = np.concatenate([a, b, a, b])
        columns = np.concatenate([a, b, b, a])
        links = jnp.concatenate([links, links, -links, -links], 1)
        k, c = (x.at[rows, columns].add(y, mode="drop") for x, y in zip((k, c), links, strict=True))
    units = np.eye(n * dof)[layout.active.reshape(-1)].reshape(-1, n, dof)
    # Motion of all nodes for a unit of each active degree of freedom: what follows has its columns in it,
    # and a product with it from both sides joins stiffness and inertia of what follows to what leads.
    motion = jax.vmap(lambda x: follow(system, to_planes(x, dof)))(jnp.asarray(units))
    expand = motion.reshape(len(units), -1).T
    square = lambda x: x.swapaxes(1, 2).reshape(n * dof, n * dof)  # noqa: E731
    reduced = (expand.T @ square(matrix) @ expand for matrix in (m, c, g, k))
    full = jax.vmap(lambda x: from_planes(x, dof))(motion).reshape(len(units), -1).T
    return Matrices(*reduced, full)


# Which planes the terms of a `System` belong to; the polar inertia couples x and y.
_PLANES = np.zeros((5, 3, 3))
_PLANES[:2, :2, :2] = np.eye(2)
_PLANES[2, 0, 1] = 1.0
_PLANES[2, 1, 0] = -1.0
_PLANES[3:, 2, 2] = 1.0
_STIFFNESS = np.array([0, 3])
_INERTIA = np.array([1, 4])
_POLAR = np.array([2])


class Modes(Result, eqx.Module):
    """Undamped modes, lowest first.

    Attributes:
        square: [rad2/s2] (m,) eigenvalues w^2; negative where magnetic pull exceeds the stiffness, not a
            number if a number of the model is out of bounds, which only traced values can be.
        shape: [1/sqrt(kg)], of rotations [1/(sqrt(kg) m)] (m, nodes, dof) with unit modal mass.
    """

    square: Array
    shape: Array

    table_dims: ClassVar[tuple[str, ...]] = ("mode",)
    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield Data("mode", "", jnp.arange(1, self.square.shape[-1] + 1), ("mode",))
        yield from self.data_of("frequency")
        yield from shapes(self.shape, "1/kg^0.5", "1/(kg^0.5 m)")

    @computed("rad/s", "mode", key="natural_frequency")
    def frequency(self) -> Float[Array, " m"]:
        """[rad/s] (m,) Natural frequencies; not a number where `square` is negative.

        Rounding leaves a rigid motion with a square of either sign, far below the first elastic
        one; it is shown as zero.
        """
        rigid = self.square**2 <= (_RIGID * max_of(jnp.abs(self.square))) ** 2
        # Double where: the slope of sqrt at zero is infinite.
        return jnp.where(rigid, 0.0, jnp.sqrt(jnp.where(rigid, 1.0, self.square)))


def shapes(shape: Array, displacement_unit: str, rotation_unit: str) -> Iterator[Data]:
    """The coordinates of mode shapes (modes, nodes, dof), for tables and files."""
    dims = ("mode", "node_number")
    for number, axis in enumerate(AXES[shape.shape[-1]]):
        unit = rotation_unit
        if axis.startswith("u"):
            unit = displacement_unit
        yield Data(f"shape.{axis}", unit, shape[..., number], dims)


# Rigid motions, computed with their strain energy, stay below 1e-13 of the highest of a handful of
# modes; an elastic mode of a machine would need a period 3e5 times longer to be taken for one.
_RIGID = 1e-11


def undamped_modes(
    model: RotorModel | System,
    count: int = 12,
    *,
    spin_speed: Float[Array, ""] = 0.0,
    free: bool = False,
) -> Modes:
    """The lowest undamped modes: symmetric part of K(W), and M; no gyroscopic terms, no damping.

    Differentiable in both modes, with repeated eigenvalues treated as `eigh` says.

    Args:
        model: the model, or the `System` prepared from it.
        count: number of modes.
        spin_speed: [rad/s] at which the links are evaluated.
        free: leave out all links and magnetic pulls (free-free).

    Raises:
        BadInput: more modes than the model has degrees of freedom.
    """
    if free:
        model = released(model)
    size = layout_of(model).size
    if not 0 < count <= size:
        raise BadInput("count", count, f"between 1 and the {size} degrees of freedom")
    return _undamped(model, count, jnp.asarray(spin_speed, float), free)


@kept_jit
def _undamped(model, count, spin_speed, free) -> Modes:
    system = bare(model)
    full = matrices(system, spin_speed, with_links=not free)
    modes = _undamped_modes(system, full, count, spin_speed, free)
    return Modes(marked(system, modes.square), modes.shape)


def _undamped_modes(system, full, count, spin_speed, free) -> Modes:
    mu, x = pencil((full.stiffness + full.stiffness.T) / 2, full.mass)
    # From x^T M x = mu to unit modal mass.
    x = x[:, :count] / jnp.sqrt(mu[:count])
    shape = (full.expand @ x).T.reshape(-1, system.layout.n, system.dof)
    no_links = jnp.zeros((0, system.dof, system.dof))
    zero = jnp.zeros(())
    if free:
        z = Operator(system, no_links, no_links, zero, spin_speed)
    else:
        z = operator_at(system, spin_speed, zero)

    def energy(u):
        force = elastic_force(z, u, False)
        if len(z.stiffness):
            force = add_links(system.layout, force, z.links, u)
        return jnp.sum(u * force.real)

    # The strain energy summed over elements has the digits that w^2 = 1/mu - s lost near zero.
    twice = jax.vmap(lambda u: energy(to_planes(u, system.dof)))(shape)
    return Modes(twice / jnp.einsum("im,ij,jm->m", x, full.mass, x), shape)


def modal_damping_vectors(system: System) -> Float[Array, "m nodes planes 2"]:
    """M phi sqrt(2 zeta w) of the damped modes on the active degrees of freedom, else zero."""
    layout = system.layout
    ratio = system.model.damping.ratio  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
    if ratio.shape[0] > layout.size:
        raise BadInput("damping.ratio", ratio, f"at most one value for each of {layout.size} modes")
    full = matrices(system)
    active = np.flatnonzero(layout.active)
    modes = _undamped_modes(system, full, ratio.shape[0], jnp.zeros(()), False)
    motion = modes.shape.reshape(ratio.shape[0], -1)[:, active]
    # phi^T M phi = 1, so that v = M phi sqrt(2 zeta w) gives phi^T (v v^T) phi = 2 zeta w.
    vectors = jnp.sqrt(2 * ratio * modes.frequency)[:, None] * (motion @ full.mass)
    out = jnp.zeros((ratio.shape[0], layout.n * layout.dof)).at[:, active].set(vectors)
    return jax.vmap(lambda v: to_planes(v, layout.dof))(out.reshape(-1, layout.n, layout.dof))


class ModeDerivatives(NamedTuple):
    """Derivatives of modes along one direction of the parameters.

    Attributes:
        modes: the modes, in the basis of each cluster that the direction selects.
        square: [rad2/s2] (m,) derivative of w^2, for one unit of the parameters.
        shape: [-] (m, nodes, dof) the same of the shapes.
    """

    modes: Modes
    square: Array
    shape: Array


def mode_derivatives(
    model: RotorModel, direction: RotorModel, count: int = 12, *, free: bool = False
) -> ModeDerivatives:
    r"""Derivatives of eigenvalues and eigenvectors along a direction, pairs that split included.

    Inside a cluster of equal eigenvalues the derivatives are the eigenvalues of
    Phi^T (K' - lambda M') Phi, whose eigenvectors give the basis Z in which the modes are
    differentiable; the part of the eigenvector derivative inside the cluster needs second
    derivatives: R. L. Dailey (1989), Eigenvector derivatives with repeated eigenvalues, AIAA J. 27.
    A pair that stays together keeps its basis but for the normalisation.

    Args:
        model: the model.
        direction: a model of the same construction whose numbers are the direction's components;
            zero where nothing changes.
        count: number of modes; the last cluster must be complete.
        free: leave out all links and magnetic pulls.
    """
    if free:
        model = released(model)  # pyright: ignore[reportAssignmentType]
        direction = released(direction)  # pyright: ignore[reportAssignmentType]
    return _mode_derivatives(model, direction, count, free)


@kept_jit
def _mode_derivatives(model, direction, count, free) -> ModeDerivatives:
    numbers, constants = eqx.partition(model, eqx.is_inexact_array)
    tangent = eqx.filter(direction, eqx.is_inexact_array)

    def system(t):
        moved = jax.tree.map(lambda a, b: a + t * b, numbers, tangent)
        full = matrices(eqx.combine(moved, constants), 0.0, with_links=not free)
        return (full.stiffness + full.stiffness.T) / 2, full.mass, full.expand

    first = lambda t: jax.jvp(system, (t,), (jnp.ones_like(t),))[1]  # noqa: E731
    zero = jnp.asarray(0.0)
    (k, m, expand), (dk, dm, dexpand) = jax.jvp(system, (zero,), (jnp.ones(()),))
    # forward mode twice along one direction: the part of x' inside a cluster needs K'' and M''
    ddk, ddm, _ = jax.jvp(first, (zero,), (jnp.ones(()),))[1]
    mu, x = pencil(k, m)
    x = x[:, :count] / jnp.sqrt(mu[:count])
    value = jnp.einsum("im,ij,jm->m", x, k, x)
    top = max_of(jnp.abs(value))
    same = jnp.abs(value[:, None] - value[None, :]) <= 1e3 * CLUSTER * top
    # One value for a cluster, so that k - value m is singular along all of its vectors.
    value = same @ value / jnp.sum(same, 1)

    # Rotate every cluster so that the first-order change is diagonal in it. Adding a spread far
    # beyond all derivatives keeps the clusters apart in one `eigh`.
    change = x.T @ dk @ x - 0.5 * (value[:, None] + value[None, :]) * (x.T @ dm @ x)
    change = jnp.where(same, change, 0.0)
    spread = 4 * count * (max_of(jnp.abs(change)) + 1e-300)
    group = jnp.argmax(same, 1)  # number of the first member of the cluster
    _, turn = jnp.linalg.eigh(change + spread * jnp.diag(group.astype(float)))
    x = x @ turn
    rate = jnp.einsum("im,ij,jm->m", x, dk, x) - value * jnp.einsum("im,ij,jm->m", x, dm, x)

    def outside(v, lam, dlam, members):
        """The part of x' that is M-orthogonal to the cluster, from a bordered system."""
        span = x * members
        # Singular along the cluster; the product fills these directions and no others.
        matrix = k - lam * m + (m @ span) @ (m @ span).T * (1 + jnp.abs(lam))
        rhs = -(dk - lam * dm - dlam * m) @ v
        rhs = rhs - (m @ span) @ (span.T @ rhs)
        y = jnp.linalg.solve(matrix, rhs)
        return y - span @ (span.T @ (m @ y))

    out = jax.vmap(outside, (1, 0, 0, 0), 1)(x, value, rate, same.astype(float))
    gap = rate[None, :] - rate[:, None]  # lambda'_j - lambda'_i for column j
    # Of a pair that stays together the two rates differ by rounding only.
    apart = same & (jnp.abs(gap) > 1e-9 * (max_of(jnp.abs(rate)) + 1e-300))
    # Second-order balance inside the cluster: x_i^T (P'' x_j + 2 P' x_j') = 2 lambda'_j-terms.
    second = x.T @ ddk @ x - value * (x.T @ ddm @ x) - 2 * rate * (x.T @ dm @ x)
    second += 2 * (x.T @ dk @ out - value * (x.T @ dm @ out))
    norm = jnp.where(same, -0.5 * (x.T @ dm @ x), 0.0)
    dx = out + x @ jnp.where(apart, second / jnp.where(apart, 2 * gap, 1.0), norm)

    layout = layout_of(model)
    as_shape = lambda v: v.T.reshape(count, layout.n, model.dof)  # noqa: E731
    good = admissible(model)
    value = jnp.where(good, value, jnp.nan)
    rate = jnp.where(good, rate, jnp.nan)
    modes = Modes(value, as_shape(expand @ x))
    return ModeDerivatives(modes, rate, as_shape(expand @ dx + dexpand @ x))


def magnetic_pull_limit(model: RotorModel, spin_speed: Float[Array, ""] = 0.0) -> Float[Array, ""]:
    r"""[-] Factor on the magnetic pull at which the model becomes statically unstable.

    The smallest s with K_0 - s K_pull singular, K_0 the symmetric stiffness without the pull: one
    over the largest eigenvalue of K_pull in the metric of K_0. Below one the model as it stands is
    unstable. Not a number if the model without magnetic pull is not held.

    Args:
        model: the model, with magnetic pull.
        spin_speed: [rad/s] at which the links are evaluated.

    Raises:
        BadInput: there is no magnetic pull.
    """
    if not model.magnetic_pulls:
        raise BadInput("magnetic_pulls", "()", "at least one magnetic pull")
    return _limit(model, jnp.asarray(spin_speed, float))


@kept_jit
def _limit(model, spin_speed):
    pulls = lambda m: [pull.stiffness for pull in m.magnetic_pulls]  # noqa: E731
    without = eqx.tree_at(pulls, model, [jnp.zeros_like(v) for v in pulls(model)])
    # By difference, so that the pull has gone through bodies and held links as the stiffness has.
    k0 = matrices(without, spin_speed).stiffness
    k = matrices(model, spin_speed).stiffness
    pull = (k0 - k + (k0 - k).T) / 2
    return 1 / definite_pencil((k0 + k0.T) / 2, pull)[0][-1]
