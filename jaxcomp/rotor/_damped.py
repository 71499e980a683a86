r"""Damped modes of the spinning model: eigenvalues, whirl, stability.

lambda^2 M x + lambda (C + W G) x + K x = 0 with M possibly singular. The linearised problem is
inverted about a real shift s, so that massless coordinates give 1/(lambda - s) = 0 instead of
infinity. Every wanted eigenvalue then takes one Newton step with the left vector y,

    lambda <- lambda - y^T P(lambda) x / (y^T P'(lambda) x),      P = lambda^2 M + lambda D + K,

with lambda, x and y held fixed: it removes the rounding of the large eigenproblem, and its
derivative -y^T dP x / (y^T P' x) is that of the eigenvalue, so that `eig` needs none. The
eigenvectors are differentiated by a bordered system in the same way.
"""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.arguments import single_number
from .._core.declared import computed, reading
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.extremes import max_of
from .._core.fields import is_any_traced, is_traced
from .._core.results import Data, Result
from ._conventions import from_planes
from ._layout import layout_of
from ._model import RotorModel
from ._modes import Matrices, matrices, shapes
from ._prepare import prepare
from ._system import System, marked, released

# Lateral share of a shape below which it is rounding, which leaves 1e-13 or so.
_ROUNDING = 1e-10


class DampedModes(Result, eqx.Module):
    """Oscillating modes x(t) = Re[X e^{lambda t}], lowest undamped frequency |lambda| first.

    In that order overdamped motions of a stiff part, whose small imaginary part is no frequency,
    stand behind the modes of the machine.

    Attributes:
        eigenvalue: [rad/s] (m,) lambda with a positive imaginary part; not a number where the model
            has fewer such modes, or throughout if a number of the model is out of bounds, which only
            traced values can be.
        shape: [-] (m, nodes, dof) X, its largest entry one.
        whirl: [-] (m,) from 1 (forward) to -1 (backward), 0 for a motion in a plane; the share of
            the spinning sense in the squared lateral displacements.
        growth: [rad/s] largest real part of all eigenvalues but rigid motions: negative if stable.
    """

    eigenvalue: Array
    shape: Array
    whirl: Array = reading("", "mode", doc="from 1, forward, to -1, backward")
    growth: Array = reading("rad/s", doc="largest real part of all eigenvalues")

    table_dims: ClassVar[tuple[str, ...]] = ("mode",)
    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; of a Campbell diagram with a batch of speeds."""
        yield Data("stable", "", self.stable)
        yield from self.data_of("growth")
        yield Data("mode", "", jnp.arange(1, self.eigenvalue.shape[-1] + 1), ("mode",))
        yield from self.data_of(natural_frequency="frequency")
        yield from self.data_of("damping_ratio", "whirl")
        yield from shapes(self.shape, "", "")

    @computed("rad/s", "mode")
    def frequency(self) -> Float[Array, " m"]:
        """[rad/s] Damped natural frequencies, Im lambda."""
        return self.eigenvalue.imag

    @computed("", "mode")
    def damping_ratio(self) -> Float[Array, " m"]:
        """[-] -Re lambda / |lambda|."""
        return -self.eigenvalue.real / jnp.abs(self.eigenvalue)

    @property
    def stable(self) -> Bool[Array, ""]:
        """Whether every motion but a rigid one decays or at least does not grow."""
        # An undamped mode has a growth of zero but for rounding.
        return self.growth <= 1e-9 * jnp.nanmax(jnp.abs(self.eigenvalue))


def damped_modes(
    model: RotorModel | System,
    spin_speed: Float[Array, ""],
    count: int = 12,
    *,
    free: bool = False,
    damping: bool = True,
) -> DampedModes:
    """The lowest oscillating modes at a spin speed, with gyroscopic effect and damping.

    Differentiable; computed on the CPU, where JAX has the unsymmetric eigenproblem. Two eigenvalues
    that coincide share their derivative as in `undamped_modes`.

    Args:
        model: the model, or the `System` prepared from it.
        spin_speed: [rad/s] W.
        count: number of modes.
        free: leave out all links and magnetic pulls.
        damping: false leaves out all damping, so that Im lambda are the whirl frequencies.

    Raises:
        BadInput: more modes than degrees of freedom, several speeds, or one that is not finite.
    """
    if free:
        model = released(model)
    spin_speed = single_number("spin_speed", spin_speed)
    check_request(model, count, spin_speed=spin_speed)
    return on_cpu(_damped)(model, spin_speed, count, free, damping)


def check_request(model: RotorModel | System, count: int, **speeds) -> None:
    """Raise for a number of modes that the model does not have, or a speed that is not finite.

    Raises:
        BadInput: naming the argument.
    """
    size = layout_of(model).size
    if not 0 < count <= size:
        raise BadInput("count", count, f"between 1 and the {size} degrees of freedom")
    for name, value in speeds.items():
        if not is_traced(value) and not np.all(np.isfinite(value)):
            raise BadInput(name, value, "finite")


def on_cpu(function):
    """Run a function on the CPU whatever the default device, with its concrete arguments there.

    For the unsymmetric eigenproblem, which accelerators do not have, or had late.
    """

    def run(*args):
        # traced values lie on no device yet: where they will is up to the program that traces them
        if is_any_traced(args):
            return function(*args)
        cpu = jax.local_devices(backend="cpu")[0]
        move = lambda leaf: jax.device_put(leaf, cpu) if eqx.is_array(leaf) else leaf  # noqa: E731
        with jax.default_device(cpu):
            return function(*jax.tree.map(move, args))

    return run


def system_matrices(
    system: System, spin_speed: Float[Array, ""], *, free: bool = False, damping: bool = True
) -> tuple[Matrices, Array]:
    """Matrices at a spin speed, and the whole velocity matrix C + W G with modal damping."""
    full = matrices(system, spin_speed, with_links=not free)
    velocity = spin_speed * full.gyroscopic
    if damping:
        velocity = velocity + full.damping
        if system.modal is not None:
            modal = jax.vmap(lambda v: from_planes(v, system.dof))(system.modal)
            modal = modal[:, system.layout.active]
            # The sum of v v^T with v = M phi sqrt(2 zeta w), see `ModalDamping`.
            velocity = velocity + modal.T @ modal
    return full, velocity


@kept_jit
def _damped(model, spin_speed, count, free, damping) -> DampedModes:
    system = prepare(model)
    full, velocity = system_matrices(system, spin_speed, free=free, damping=damping)
    p = full.mass, velocity, full.stiffness
    frozen = jax.lax.stop_gradient(p)
    values, vectors, worst = jax.lax.stop_gradient(_spectrum(*frozen))
    lam = values[:count]
    x = vectors[:, :count]
    lam_new = _newton(p, frozen, lam, x)
    x_new = _refined_vectors(*p, lam_new, lam, x)
    # The least stable one gets its step as well: the sign of its real part decides on stability.
    (growth,) = _newton(p, frozen, *worst).real
    layout = system.layout
    shape = (full.expand @ x_new).T.reshape(count, layout.n, layout.dof)
    ux = shape[..., 0]
    uy = shape[..., 1]
    # u_x + i u_y is forward whirl, u_x - i u_y backward whirl, see `_conventions`.
    forward = jnp.sum(jnp.abs(ux + 1j * uy) ** 2, -1)
    back = jnp.sum(jnp.abs(ux - 1j * uy) ** 2, -1)
    # An axial or torsional motion has no lateral part but rounding, and no whirl.
    lateral = forward + back
    all_coordinates = jnp.sum(jnp.abs(shape) ** 2, (-2, -1))
    # not `>`: a mode that is missing is not a number, and its whirl is none either
    moves = ~(lateral <= _ROUNDING**2 * all_coordinates)
    whirl = jnp.where(moves, (forward - back) / jnp.where(moves, lateral, 1.0), 0.0)
    return DampedModes(marked(system, lam_new), shape, whirl, marked(system, growth))


def _spectrum(m, d, k):
    """Oscillating eigenvalues by frequency, right vectors, and the least stable pair of these."""
    n = m.shape[0]
    # Coordinates of one size, and the shift as the unit of frequency.
    diag = jnp.abs(jnp.diagonal(k))
    moving = jnp.diagonal(m)
    inertia = jnp.select([moving > 0], [moving], jnp.nan)
    # Positive, where stable motions have no eigenvalue, and low, so that low modes have the
    # largest nu; by the median, because of single stiff springs.
    s = jnp.sqrt(jnp.nanmedian(jnp.where(diag > 0, diag, jnp.nan) / inertia)) * 1e-3
    s = jnp.where(s > 0, s, 1.0)
    size = diag + s**2 * jnp.nan_to_num(inertia)
    weight = 1 / jnp.sqrt(jnp.where(size > 0, size, 1.0))
    m, d, k = (weight[:, None] * a * weight for a in (s**2 * m, s * d, k))
    p = jax.scipy.linalg.lu_factor(m + d + k)  # P at the shift, now 1
    pd = jax.scipy.linalg.lu_solve(p, d + m)
    pm = jax.scipy.linalg.lu_solve(p, m)
    # (A - B)^{-1} B by blocks, of A z = lambda B z with z = (x, lambda x): its eigenvalues are
    # nu = 1/(lambda - 1).
    nu, v = jnp.linalg.eig(jnp.block([[-pd, -pm], [jnp.eye(n) - pd, -pm]]))
    # Massless coordinates have nu = 0 but for rounding.
    finite = jnp.abs(nu) > 1e-13 * max_of(jnp.abs(nu))
    lam = 1 + 1 / jnp.where(finite, nu, 1.0)
    # A rigid motion is a double zero with one vector, which rounding splits by its square root.
    rigid = jnp.abs(lam) < 1e-5
    oscillating = finite & ~rigid & (lam.imag > 1e-9 * (1 + jnp.abs(lam)))
    order = jnp.argsort(jnp.where(oscillating, jnp.abs(lam), jnp.inf))
    eigenvalues = jnp.where(oscillating, lam, jnp.nan)[order]
    # Less what rounding makes of the real part, which is much where a spring is very stiff.
    growing = lam.real - 1e-9 * jnp.abs(lam)
    worst = jnp.argmax(jnp.where(finite & ~rigid, growing, -jnp.inf))
    vectors = weight[:, None] * v[:n]
    right = vectors[:, order]
    right = right / jnp.take_along_axis(right, jnp.argmax(jnp.abs(right), 0)[None], 0)
    return s * eigenvalues, right, (s * lam[worst][None], vectors[:, worst, None])


def _newton(p, frozen, lam, x):
    """Eigenvalues after one step of Newton's method, which carries their derivatives."""
    m, d, k = p
    y = jax.lax.stop_gradient(_left_vectors(*frozen, lam, x))
    residual = (m @ x) * lam**2 + (d @ x) * lam + k @ x
    return lam - jnp.einsum("im,im->m", y, residual)  # y^T P' x = 1


def _left_vectors(m, d, k, lam, x):
    """Left vectors y, y_i^T ((lambda_i + lambda_j) M + D) x_j = delta_ij, by inverse iteration."""
    start = jnp.asarray(np.random.default_rng(0).normal(size=x.T.shape)) + 0j

    def left_vector(lam, b):
        lu = jax.scipy.linalg.lu_factor(lam**2 * m + lam * d + k)
        for _ in range(2):
            # P^T without conjugation: y^T P = 0.
            b = jax.scipy.linalg.lu_solve(lu, b, trans=1)
            b = b / jnp.linalg.norm(b)
        return b

    # The factor off the eigenvalue keeps P invertible where lambda is exact to the last bit.
    y = jax.lax.map(lambda a: left_vector(a[0] * (1 + 1e-13), a[1]), (lam, start)).T
    # Diagonal by itself where eigenvalues differ, as y_a^T (P(lambda_a) - P(lambda_b)) x_b = 0; the
    # inverse pairs the vectors inside a repeated one.
    gram = jnp.einsum("ia,ij,jb,ab->ab", y, m, x, lam[:, None] + lam[None, :]) + y.T @ d @ x
    # Modes that the model does not have are NaN; they must not spoil the others.
    bad = ~jnp.isfinite(lam)
    gram = jnp.where(bad[:, None] | bad[None, :], jnp.eye(lam.size), gram)
    return jnp.where(bad, jnp.nan, jnp.where(bad, 0.0, y) @ jnp.linalg.inv(gram).T)


def _refined_vectors(m, d, k, lam_new, lam, x):
    """One differentiable Newton step for the vectors, the largest entry held at one.

    [P(lambda), P'(lambda) x; e^T, 0] [dx; dlambda] = -[P(lambda') x; 0]; inside a cluster the
    matrix is singular and the vector stays as it is.
    """
    frozen = jax.lax.stop_gradient

    def refined_vector(lam_new, lam, x):
        p = frozen(lam**2 * m + lam * d + k)
        e = jnp.zeros_like(x).at[jnp.argmax(jnp.abs(x))].set(1.0)
        slope = frozen((2 * lam * m + d) @ x)
        matrix = jnp.block([[p, slope[:, None]], [e[None, :], jnp.zeros((1, 1))]])
        # Forces, moments and the condition on the vector in rows of one size.
        size = max_of(jnp.abs(matrix), 1)
        residual = (lam_new**2 * m + lam_new * d + k) @ x
        step = jnp.linalg.solve(matrix / size[:, None], -jnp.append(residual, 0.0) / size)[:-1]
        # `eig` leaves only rounding to mend: a long step comes from a matrix all but singular.
        alone = jnp.all(jnp.isfinite(step)) & (jnp.linalg.norm(frozen(step)) < 1e-3)
        return x + jnp.where(alone, step, 0.0)

    return jax.lax.map(lambda a: refined_vector(*a), (lam_new, lam, x.T)).T
