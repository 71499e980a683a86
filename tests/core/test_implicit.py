"""The fixed point with implicit derivatives, on problems with known answers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp._core.roots import AbstractFixedPoint, AbstractRoot, fixed_point, root, settle


class Kepler(AbstractFixedPoint):
    """E = M + e sin E, a contraction for e < 1."""

    tolerance: float
    max_iterations: int = eqx.field(static=True)

    def step(self, parameters, data, unknowns):
        eccentricity, anomaly = parameters
        return {"angle": anomaly + eccentricity * jnp.sin(unknowns["angle"])}

    def solve(self, parameters):
        start = {"angle": parameters[1]}
        step = lambda y, _: (self.step(parameters, None, y), None)  # noqa: E731
        value, _, report = settle(step, start, None, self.tolerance, self.max_iterations)
        return value, report


def kepler(eccentricity, anomaly, tolerance=1e-14, steps=200):
    value, report = fixed_point(Kepler(tolerance, steps), (eccentricity, anomaly))
    return value["angle"], report


class Cubes(AbstractRoot):
    """x^3 = a, entry by entry."""

    a: jax.Array

    def solve(self):
        return jnp.cbrt(self.a)

    def residual(self, unknowns):
        return unknowns**3 - self.a


def test_a_root_has_the_derivatives_of_its_equations():
    a = np.array([0.5, 8.0])
    cube_root = lambda a: root(Cubes(a))  # noqa: E731
    twice = jax.grad(jax.grad(lambda a: cube_root(a[None])[0]))
    # one program: outside of one every operation is compiled by itself
    modes = jax.jit(lambda a: (jax.jacfwd(cube_root)(a), jax.jacrev(cube_root)(a), twice(a[1])))
    forward, backward, second = modes(a)
    np.testing.assert_allclose(forward, np.diag(a ** (-2 / 3) / 3), rtol=1e-14)
    np.testing.assert_allclose(backward, np.diag(a ** (-2 / 3) / 3), rtol=1e-14)
    np.testing.assert_allclose(second, -2 / 9 * 8 ** (-5 / 3), rtol=1e-14)


def test_root_is_found_and_reported():
    value, report = kepler(jnp.asarray(0.4), jnp.asarray(1.0))
    assert float(value - 0.4 * jnp.sin(value)) == pytest.approx(1.0, abs=1e-14)
    assert bool(report.settled)
    assert 5 < int(report.steps) < 60
    assert float(report.change) <= 1e-14


def test_derivatives_of_three_orders_in_either_mode():
    """Against the implicit function theorem: with D = 1 - e cos E, dE/de = sin E/D."""
    root = lambda e: kepler(e, jnp.asarray(1.0))[0]  # noqa: E731
    e = jnp.asarray(0.4)

    @jax.jit
    def exact(e, angle):
        # differentiate E' = sin E/(1 - e cos E) along e
        slope = lambda e, a: jnp.sin(a) / (1 - e * jnp.cos(a))  # noqa: E731
        first = slope(e, angle)
        return first, jax.jvp(slope, (e, angle), (jnp.ones(()), first))[1]

    forward, backward = jax.jacfwd, jax.jacrev
    once = jax.grad(root), forward(root)
    twice = jax.grad(jax.grad(root)), forward(backward(root)), forward(forward(root))
    # one program for all modes
    angle, *slopes = jax.jit(lambda e: [f(e) for f in (root, *once, *twice)])(e)
    first, second = exact(e, angle)
    np.testing.assert_allclose(slopes[:2], first, rtol=1e-12)
    np.testing.assert_allclose(slopes[2:], second, rtol=1e-10)


def test_members_of_a_batch_end_on_their_own():
    eccentricity = jnp.asarray([0.1, 0.8])
    value, report = jax.vmap(lambda e: kepler(e, jnp.asarray(1.0)))(eccentricity)
    alone = [kepler(e, jnp.asarray(1.0)) for e in eccentricity]
    np.testing.assert_allclose(value, [v for v, _ in alone], rtol=1e-15)
    np.testing.assert_array_equal(report.steps, [r.steps for _, r in alone])


def test_running_out_of_steps_is_reported():
    _, report = kepler(jnp.asarray(0.9), jnp.asarray(1.0), steps=3)
    assert not bool(report.settled)
    assert int(report.steps) == 3


@pytest.mark.parametrize(
    "step", [lambda y: 3 * y + 1, lambda y: jnp.full_like(y, jnp.nan), lambda y: 1e300 * (y + 1)]
)
def test_a_step_that_runs_away_ends_soon_and_finite(step):
    value, _, report = settle(lambda y, _: (step(y), None), jnp.ones(3), None, 1e-12, 50)
    assert np.all(np.isfinite(value))
    assert np.isfinite(report.change)
    assert not bool(report.settled)
    assert int(report.steps) <= 50


def test_derivatives_are_traced_only_where_they_are_wanted():
    traced = []

    class Counted(Kepler):
        def step(self, parameters, data, unknowns):
            traced.append(unknowns)
            return super().step(parameters, data, unknowns)

    root = lambda e: fixed_point(Counted(1e-14, 200), (e, jnp.ones(())))[0]["angle"]  # noqa: E731
    jax.jit(root).lower(jnp.asarray(0.4))
    assert len(traced) == 1
    jax.jit(jax.grad(root)).lower(jnp.asarray(0.4))
    assert (
        len(traced) == 1 + 2
    )  # the value; its slopes over the parameters and the unknowns are one
