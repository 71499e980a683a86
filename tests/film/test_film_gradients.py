"""Derivatives of the film against finite differences, and finite at every edge."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.film import (
    ExplicitFit,
    GroovedReynolds,
    Guembel,
    JournalBearing,
    Ocvirk,
    Reynolds,
    dynamic_coefficients,
    minimum_film,
)
from jaxcomp.film._bearing import friction_moment, prepare
from jaxcomp.film._film import film_ratio, friction_at
from jaxcomp.film._half_sommerfeld import _harmonics
from jaxcomp.film._running import bush_moment, eccentricity_ratio, stiffness_damping

SIZES = jnp.array([16e-3, 22e-3, 9e-6, 4e-3])
# The derivatives of the series model take longest to compile.
MODELS = [Reynolds, Ocvirk, pytest.param(Guembel, marks=pytest.mark.slow)]
EDGE = 1 / 0.07**2 - 1  # film ratio where the table of `Reynolds` ends


def central(function, x, step):
    """Fourth-order central difference."""
    x = np.asarray(x)
    return (
        8 * (function(x + step) - function(x - step))
        - function(x + 2 * step)
        + function(x - 2 * step)
    ) / (12 * step)


@pytest.mark.parametrize("model", [*MODELS, ExplicitFit])
def test_position_has_exact_first_and_second_derivatives(model):
    def ratio(point):
        return jnp.log(film_ratio(model(point[1]), jnp.exp(point[0])))

    first = jax.jit(jax.grad(ratio))

    @jax.jit
    def compare(point):
        values, slopes = [], []
        for direction in jnp.eye(2):
            stencil = 1e-3 * jnp.array([-2.0, -1.0, 1.0, 2.0])
            around = point + stencil[:, None] * direction
            weights = jnp.array([1.0, -8.0, 8.0, -1.0]) / 12e-3
            values.append(weights @ jax.lax.map(ratio, around))
            slopes.append(weights @ jax.lax.map(first, around))
        return first(point), jnp.stack(values), jax.jacfwd(first)(point), jnp.stack(slopes, axis=1)

    for load in (1e-3, 0.9, 40.0, 3e3):
        gradient, differences, hessian, slopes = compare(jnp.array([jnp.log(load), 0.6]))
        # steps of 1e-3 leave their fourth power, 1e-12 of higher derivatives of order ten, and
        # rounding over the step, 1e-12
        np.testing.assert_allclose(gradient, differences, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(hessian, slopes, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(hessian, hessian.T, rtol=1e-9, atol=1e-11)


@pytest.mark.slow
def test_position_has_an_exact_third_derivative():
    film = Reynolds(0.6)

    def ratio(load):
        return film_ratio(film, load)

    second = jax.jit(jax.jacfwd(jax.grad(ratio)))
    third = jax.jit(jax.jacfwd(second))(0.9)
    np.testing.assert_allclose(third, central(second, 0.9, 1e-3), rtol=1e-7)


def test_forward_and_reverse_mode_agree_with_differences_over_all_inputs():
    def moment(point):  # logarithms of the sizes and the load, speed over 300 rad/s
        bearing = JournalBearing(*(SIZES * jnp.exp(point[:4])))
        return friction_moment(bearing, jnp.exp(point[4]), 300.0 * point[5])

    reverse, forward = jax.jit(jax.value_and_grad(moment)), jax.jit(jax.jacfwd(moment))

    def value(point):
        # of the program for slopes: to compile another takes longer
        return np.asarray(reverse(point)[0])

    for load in (1e-2, 30.0, 400.0, 1e5):
        point = np.array([0.0, 0.0, 0.0, 0.0, np.log(load), 1.0])
        slopes = np.asarray(reverse(point)[1])
        np.testing.assert_allclose(slopes, forward(point), rtol=1e-11, atol=1e-16)
        expected = np.array(
            [central(lambda t, p=point, e=e: value(p + t * e), 0.0, 1e-3) for e in np.eye(6)]
        )
        # relative to the moment: the truncation, 1e-12, and rounding over the step, 1e-13
        np.testing.assert_allclose(slopes / value(point), expected / value(point), atol=1e-8)


BATCH = 14  # of bearings in one program


@cache
def stiffness_and_slopes(model):
    """Stiffness and damping of a batch of bearings, with slopes by sizes and load."""

    def both(sizes, load):
        bearing = JournalBearing(*sizes, film=model)
        coefficients = jnp.stack(stiffness_damping(bearing, load, 300.0))
        return coefficients, coefficients

    program = jax.jit(jax.vmap(jax.jacrev(both, (0, 1), has_aux=True)))

    def arrays(sizes, load):
        (by_size, by_load), values = program(sizes, load)
        return np.asarray(values), np.asarray(by_size), np.asarray(by_load)

    return arrays


def test_stiffness_is_differentiable():
    angle = 0.4
    places = [(0.0, 0.0)]
    for step in 1e-3 * np.array([-2.0, -1.0, 1.0, 2.0]):
        places += [(step, 0.0), (0.0, step)]
    # the batch of the program is filled up with the first place
    log_clearance, turn = np.array(places + places[:1] * (BATCH - len(places))).T
    sizes = np.tile(SIZES, (BATCH, 1))
    sizes[:, 2] *= np.exp(log_clearance)
    direction = np.column_stack([np.cos(angle + turn), np.sin(angle + turn)])
    for load in (5.0, 300.0, 2e4):
        values, by_size, by_load = stiffness_and_slopes(Reynolds)(sizes, load * direction)
        scale = np.abs(values[0]).max((1, 2), keepdims=True)
        across = load * np.array([-np.sin(angle), np.cos(angle)])
        slopes = by_size[0, ..., 2] * SIZES[2], by_load[0] @ across
        for number, slope in enumerate(slopes, 1):
            far_below, below, above, far_above = values[number:9:2]
            expected = (8 * (above - below) - far_above + far_below) / 12e-3
            # relative to the largest entry, see above; the stiff film at high load has a
            # condition of a hundred
            np.testing.assert_allclose(slope / scale, expected / scale, atol=1e-8)


QUANTITIES = [(m, n) for m in (Reynolds, GroovedReynolds) for n in ("load", "attitude", "damping")]
QUANTITIES += [(Reynolds, "friction"), (GroovedReynolds, "stiffness")]


@pytest.mark.parametrize(("model", "quantity"), QUANTITIES)
def test_slopes_are_continuous_where_the_table_ends(model, quantity):
    film = model(0.25)
    function = {
        "load": film.load_gain,
        "attitude": film.attitude_angle,
        "damping": lambda x: film.damping(x)[0],
        "friction": lambda x: friction_at(film, x),
        "stiffness": lambda x: film.radial_stiffness(x)[0],
    }[quantity]
    both = jax.jit(jax.value_and_grad(function))
    below, at, above = (float(both(EDGE * (1 + d))[1]) for d in (-1e-9, 0.0, 1e-9))
    # curvature over 1e-9 of the argument, and rounding
    np.testing.assert_allclose([below, above], at, rtol=1e-6)
    difference = central(lambda x: float(both(float(x))[0]), EDGE, 1e-3 * EDGE)
    np.testing.assert_allclose(at, difference, rtol=1e-3)


def test_length_ratio_goes_on_smoothly_beyond_the_table():
    gain = jax.jit(jax.grad(lambda q: Reynolds(q).load_gain(jnp.asarray(1.0))))
    for q in (0.1, 2.0):
        np.testing.assert_allclose(gain(q * (1 - 1e-9)), gain(q * (1 + 1e-9)), rtol=1e-6)
        assert bool(jnp.isfinite(gain(q)))


@pytest.mark.parametrize("model", MODELS)
def test_finite_from_no_load_and_rest_over_twelve_decades(model):
    def values(point):
        *sizes, load, speed = point
        bearing = prepare(JournalBearing(*sizes, film=model))
        functions = friction_moment, bush_moment, eccentricity_ratio, minimum_film
        outputs = jnp.stack([f(bearing, load, speed) for f in functions])
        return outputs, outputs

    def with_slopes(point):
        # along one list of all inputs: each mode is compiled once
        return [mode(values, has_aux=True)(point) for mode in (jax.jacfwd, jax.jacrev)]

    loads = np.append(0.0, np.logspace(-5, 7, 13))
    speeds = np.array([-300.0, -1e-9, 0.0, 1e-6, 300.0])
    w, v = (a.ravel() for a in np.meshgrid(loads, speeds))
    points = np.column_stack([np.tile(SIZES, (w.size, 1)), w, v])
    for leaf in jax.tree.leaves(jax.jit(jax.vmap(with_slopes))(points)):
        assert np.all(np.isfinite(leaf))


@pytest.mark.parametrize("model", MODELS)
def test_stiffness_is_finite_from_no_load_over_twelve_decades(model):
    loads = np.append(0.0, np.logspace(-5, 7, BATCH - 1))
    vectors = loads[:, None] * np.array([0.6, -0.8])
    for leaf in stiffness_and_slopes(model)(np.tile(SIZES, (BATCH, 1)), vectors):
        assert np.all(np.isfinite(leaf))


def test_harmonics_have_second_derivatives_at_no_eccentricity():
    # of which the slopes of the stiffness are made: those of (-1)^(n+1) (eps/2)^n/eps, near no load
    harmonics = partial(_harmonics, terms=5)
    np.testing.assert_array_equal(jax.jit(jax.jacfwd(harmonics))(0.0), [0.0, -0.25, 0.0, 0.0, 0.0])
    second = jax.jit(jax.jacfwd(jax.jacfwd(harmonics)))(0.0)
    np.testing.assert_allclose(second, [0.25, 0.0, 0.25, 0.0, 0.0], atol=1e-15)


def test_stiffness_at_no_load_is_the_limit_of_light_load():
    bearing = JournalBearing(*SIZES)
    compiled = jax.jit(stiffness_damping)
    none = compiled(bearing, jnp.zeros(2), 300.0)
    light = compiled(bearing, jnp.array([1e-6, 0.0]), 300.0)
    # eps is 1e-9 there
    np.testing.assert_allclose(none.stiffness, light.stiffness, rtol=1e-6)
    np.testing.assert_allclose(none.damping, light.damping, rtol=1e-6)
    # the concentric film has no direction: its stiffness commutes with every rotation
    k = none.stiffness
    np.testing.assert_allclose([k[0, 0], k[0, 1]], [k[1, 1], -k[1, 0]], rtol=1e-12)


def test_moment_is_smooth_through_rest():
    bearing = JournalBearing(*SIZES)
    both = jax.value_and_grad(lambda w: friction_moment(bearing, 200.0, w, rest_speed=0.1))

    @jax.jit
    def slopes(w):
        (value, slope), (_, bend) = jax.jvp(both, (w,), (1.0,))
        return value, slope, bend

    # odd in speed: an even slope, with its own slope zero at rest
    np.testing.assert_allclose(slopes(-0.05)[1], slopes(0.05)[1], rtol=1e-13)
    np.testing.assert_allclose(slopes(0.0)[2], 0.0, atol=1e-12)
    difference = central(lambda w: float(slopes(float(w))[0]), 0.02, 1e-4)
    np.testing.assert_allclose(slopes(0.02)[1], difference, rtol=1e-8)


def test_dynamic_coefficients_are_smooth_at_no_load():
    film = Reynolds(1.0)
    slope = jax.jit(jax.jacfwd(lambda p: jnp.stack(dynamic_coefficients(film, p))))
    at_zero = slope(0.0)
    assert bool(jnp.all(jnp.isfinite(at_zero)))
    # curvature of order one over 1e-6
    np.testing.assert_allclose(slope(1e-6), at_zero, atol=1e-4)
