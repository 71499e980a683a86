"""The solvers of `optimise`, each as an ask and a tell.

A machine is solved outside of the solver, by one compiled program that all solvers share: a solver
says where to look (`trial`) and is told what was found there, as a function that is right in value and
slope at that place and is looked at nowhere else. So a step of any solver compiles in a moment.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar, NamedTuple, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
import optimistix as optx
from jaxtyping import Array, Float

from .._fields import BadInput

Free = Float[Array, " variables"]

METHODS = ("bfgs", "least-squares", "adam")
# [rad] of Adam in the unbounded numbers, whose range is pi wide
_ADAM_STEP = 0.05


class Method(Protocol):
    """How a start moves.

    Attributes:
        squares: whether it wants residuals rather than a sum.
    """

    squares: ClassVar[bool]

    def begin(self, free: Free, residuals: int) -> Any:
        """The state at a start, whose trial is the start itself."""
        ...

    def again(self, free: Free, state: Any) -> Any:
        """The state to go on from an accepted place after the goal has changed a little."""
        ...

    def trial(self, state: Any) -> Free:
        """Where to look next."""
        ...

    def tell(self, free: Free, state: Any, goal: Callable) -> tuple[Free, Any]:
        """The accepted place and the state after the trial; infinite goals are never accepted."""
        ...


class Searching(eqx.Module):
    """A minimiser of Optimistix; it rejects a trial that is no better and looks nearer.

    Attributes:
        solver: the minimiser, whose state names its next place `y_eval`.
    """

    solver: Any
    squares: ClassVar[bool] = False

    def begin(self, free, residuals):
        del residuals
        value = jax.ShapeDtypeStruct((), free.dtype)
        return self.solver.init(lambda y, _: None, free, None, {}, value, None, frozenset())

    def again(self, free, state):
        # Without what it has learnt of the curvature every correction of the multipliers would begin
        # with steepest descent, which the penalty makes a very slow one.
        curvature = lambda s: s.f_info.hessian_inv  # noqa: E731
        return eqx.tree_at(curvature, self.begin(free, 0), curvature(state))

    def trial(self, state):
        return state.y_eval

    def tell(self, free, state, goal):
        fn = lambda y, _: (goal(y), None)  # noqa: E731
        free, state, _ = self.solver.step(fn, free, None, {}, state, frozenset())
        return free, state


class _Model(NamedTuple):
    """Residuals and slopes where the last trial was accepted, with the damping of the next."""

    trial: Free
    residual: Float[Array, " n"]
    slope: Float[Array, "n variables"]
    damping: Float[Array, ""]


class Damped(eqx.Module):
    """Levenberg-Marquardt: Gauss-Newton steps, damped until they keep what they promise.

    Written out, because Optimistix keeps the traced function of the residuals in its state, which
    cannot leave the program that made it.
    """

    squares: ClassVar[bool] = True

    def begin(self, free, residuals):
        inf = jnp.full(residuals, jnp.inf)
        return _Model(free, inf, jnp.zeros((residuals, free.size)), jnp.asarray(1e-3))

    def again(self, free, state):
        return self.begin(free, state.residual.size)

    def trial(self, state):
        return state.trial

    def tell(self, free, state, goal):
        residual, slope = goal(state.trial), jax.jacfwd(goal)(state.trial)
        move = state.trial - free
        gained = jnp.sum(state.residual**2) - jnp.sum(residual**2)
        promised = jnp.sum(state.residual**2) - jnp.sum((state.residual + state.slope @ move) ** 2)
        first = jnp.isinf(state.residual[0])
        ratio = jnp.where(promised > 0, gained / jnp.where(promised > 0, promised, 1.0), -1.0)
        accepted = jnp.all(jnp.isfinite(residual)) & (first | (ratio > 1e-4))
        # less damping after a step that kept three quarters of its promise, more after a bad one
        factor = jnp.where(first, 1.0, jnp.where(accepted, jnp.where(ratio > 0.75, 0.2, 1.0), 5.0))
        damping = jnp.clip(factor * state.damping, 1e-12, 1e12)
        here = jnp.where(accepted, state.trial, free)
        residual = jnp.where(accepted, residual, state.residual)
        slope = jnp.where(accepted, slope, state.slope)
        normal = slope.T @ slope
        normal = normal + damping * jnp.diag(jnp.maximum(jnp.diag(normal), 1e-8))
        step = jnp.linalg.solve(normal, slope.T @ jnp.where(jnp.isfinite(residual), residual, 0.0))
        return here, _Model(here - step, residual, slope, damping)


class Following(eqx.Module):
    """A transformation of Optax; every trial that can be solved is accepted.

    Attributes:
        transformation: of gradients into steps.
    """

    transformation: optax.GradientTransformation = eqx.field(static=True)
    squares: ClassVar[bool] = False

    def begin(self, free, residuals):
        del residuals
        return free, self.transformation.init(free)

    def again(self, free, state):
        return free, state[1]

    def trial(self, state):
        return state[0]

    def tell(self, free, state, goal):
        trial, inner = state
        value, slope = jax.value_and_grad(goal)(trial)
        good = jnp.isfinite(value)
        step, moved = self.transformation.update(slope, inner, trial)
        # back half of the way from where nothing can be solved
        following = jnp.where(good, trial + step, (free + trial) / 2)
        inner = jax.tree.map(lambda a, b: jnp.where(good, a, b), moved, inner)
        return jnp.where(good, trial, free), (following, inner)


def method_of(method: str | optax.GradientTransformation) -> Method:
    """A method by name, or any transformation of Optax.

    Raises:
        BadInput: no such method.
    """
    if isinstance(method, optax.GradientTransformation):
        return Following(method)
    if method not in METHODS:
        raise BadInput("method", str(method), f"one of {', '.join(METHODS)}, or of optax")
    return _named(method)


@cache  # one object each, so that a second search finds the compiled step of the first
def _named(method: str) -> Method:
    if method == "bfgs":
        # Its own test of convergence is not used; the search has one that knows the bounds.
        return Searching(optx.BFGS(0.0, 0.0))
    return Damped() if method == "least-squares" else Following(optax.adam(_ADAM_STEP))
