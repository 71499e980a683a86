"""Derivatives of responses, modes and critical speeds against central differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rotor_machine import SPEED, loads, machine, random_force

from jaxcomp.rotor import (
    Disks,
    Link,
    RotorModel,
    critical_speeds,
    damped_modes,
    harmonic_response,
    isotropic,
    mode_derivatives,
    orbit,
    respond,
    shaft_line,
    undamped_modes,
)
from jaxcomp.rotor._modes import magnetic_pull_limit
from jaxcomp.rotor._nodes import node_names

# Places of the design variables in (model, loads), with a size for directions.
GROUPS = {
    "outer diameters": lambda p: p[0].shafts[0].outer_diameter,
    "inner diameters": lambda p: p[0].shafts[0].inner_diameter,
    "lengths": lambda p: p[0].shafts[0].length,
    "densities": lambda p: p[0].shafts[0].density,
    "moduli": lambda p: p[0].shafts[0].young_modulus,
    "housing diameter": lambda p: p[0].shafts[1].outer_diameter,
    "disk inertia": lambda p: p[0].disks[0].polar_inertia,
    "disk offset": lambda p: p[0].disks[0].offset,
    "point masses": lambda p: p[0].masses[0].mass,
    "bearing table K": lambda p: p[0].links[0].law.stiffness,
    "bearing table C": lambda p: p[0].links[0].law.damping,
    "table speeds": lambda p: p[0].links[0].law.speed,
    "bearing K": lambda p: p[0].links[1].law.stiffness,
    "mount K": lambda p: p[0].links[4].law.stiffness,
    "mount C": lambda p: p[0].links[4].law.damping,
    "magnetic pull": lambda p: p[0].magnetic_pulls[0].stiffness,
    "body mass": lambda p: p[0].bodies[0].mass,
    "body inertia": lambda p: p[0].bodies[0].inertia,
    "body arms": lambda p: p[0].bodies[0].arm,
    "damping": lambda p: p[0].damping.stiffness_factor,
    "unbalances": lambda p: p[1][0].magnitude,
    "unbalance angles": lambda p: p[1][0].phase,
    "gas force": lambda p: p[1][1].cosine,
}


def target(design, speeds, floor):
    """Logarithms of the amplitudes at target nodes over two speeds and two orders."""
    model, forces = design
    r = respond(model, forces, speeds, (1, 2), nodes=(3, "h2", "case"), batch_size=2)
    o = orbit(r.displacement[..., 0], r.displacement[..., 1])
    return jnp.sum(jnp.log(o.major + floor))


# values are those of the program for slopes: to compile another takes longer
with_gradient = eqx.filter_jit(eqx.filter_value_and_grad(target))
SPEEDS, NO_FLOOR = jnp.array([180.0, SPEED]), jnp.asarray(0.0)


@pytest.fixture(scope="module")
def sensitivities():
    return with_gradient((machine(), loads()), SPEEDS, NO_FLOOR)[1]


@pytest.mark.parametrize("group", GROUPS)
def test_target_amplitudes(group, sensitivities):
    design, where = (machine(), loads()), GROUPS[group]
    value = where(design)
    rng = np.random.default_rng(len(group))
    direction = value * jnp.asarray(rng.uniform(0.5, 1.5, value.shape))
    if group in ("disk offset", "body arms", "unbalance angles"):
        direction = direction + 0.01
    if group == "housing diameter":
        direction = 0.03 * direction  # of a wall of 5 mm
    slope = float(jnp.sum(where(sensitivities) * direction))
    # Fourth-order central difference: truncation h^4 = 1e-12, rounding 1e-13/h = 1e-10.
    h = 1e-3

    def at(t):
        moved = eqx.tree_at(where, design, value + t * direction)
        return float(with_gradient(moved, SPEEDS, NO_FLOOR)[0])

    difference = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
    # Required: 1e-6 of the slope, or of a slope that doubles the amplitudes where it is smaller.
    assert slope == pytest.approx(difference, rel=1e-6, abs=1e-8)


@pytest.mark.slow
def test_forward_and_reverse_mode_agree(sensitivities):
    design = machine(), loads()
    numbers, rest = eqx.partition(design, eqx.is_inexact_array)
    tangent = jax.tree.map(lambda a: 0.01 * a, numbers)
    forward = eqx.filter_jit(
        lambda n, t: jax.jvp(lambda n: target(eqx.combine(n, rest), SPEEDS, NO_FLOOR), (n,), (t,))[
            1
        ]
    )(numbers, tangent)
    reverse = sum(
        jnp.sum(g * t)
        for g, t in zip(jax.tree.leaves(sensitivities), jax.tree.leaves(tangent), strict=True)
    )
    # Two orders of summation of the same products.
    assert float(forward) == pytest.approx(float(reverse), rel=1e-9)


@pytest.mark.slow
def test_gradient_near_a_resonance():
    model = machine(symmetric=True)
    w = float(damped_modes(model, SPEED, 8).frequency[7])
    force = random_force((len(node_names(model)), 4))

    @jax.jit
    def amplitude(w):
        x = harmonic_response(model, force, jnp.asarray(SPEED), w).displacement
        return jnp.sum(jnp.log(jnp.abs(x[jnp.array([2, 5])])))

    slope, h = jax.grad(amplitude)(w), 1e-4 * w
    difference = 8 * (amplitude(w + h) - amplitude(w - h))
    difference = (difference - (amplitude(w + 2 * h) - amplitude(w - 2 * h))) / (12 * h)
    # Damping ratio 1e-2: truncation (h/(zeta w))^4 = 1e-8.
    assert float(slope) == pytest.approx(float(difference), rel=1e-6)


def pair_rotor(kx=1e6, ky=1e6):
    shaft = shaft_line(
        tuple(range(5)),
        length=0.1,
        outer_diameter=jnp.array([0.02, 0.025, 0.03, 0.02]),
        young_modulus=2e11,
        density=7800.0,
        poisson=0.3,
    )
    spring = lambda n: Link((n, None), isotropic(1.0))  # noqa: E731
    links = tuple(
        eqx.tree_at(lambda s: s.law.stiffness, spring(n), jnp.diag(jnp.array([kx, ky]) * f))
        for n, f in ((0, 1.0), (4, 0.7))
    )
    return RotorModel((shaft,), (Disks((2,), [1.0], [1e-3], [2e-3]),), links=links)


diameter = lambda m: m.shafts[0].outer_diameter  # noqa: E731


def test_repeated_eigenvalues_have_their_derivative():
    # Free-free and axisymmetric: every elastic frequency is a pair that stays one.
    model = pair_rotor()
    value = diameter(model)

    def frequencies(d):
        elastic = undamped_modes(eqx.tree_at(diameter, model, d), 8, free=True).frequency[4:]
        return elastic, elastic

    @jax.jit
    def slopes_and_values(d):
        forward, values = jax.jacfwd(frequencies, has_aux=True)(d)
        reverse, _ = jax.jacrev(frequencies, has_aux=True)(d)
        return forward, reverse, values

    forward, reverse, _ = slopes_and_values(value)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    np.testing.assert_allclose(forward[0::2], forward[1::2], rtol=1e-9)
    h = 1e-5 * value[1]
    step = h * jnp.eye(4)[1]
    up, down = (slopes_and_values(value + change)[2] for change in (step, -step))
    difference = (up - down) / (2 * h)
    # Truncation h^2 of a power law of order about one: 1e-10; rounding of eigenvalues 1e-12/h: 1e-7.
    np.testing.assert_allclose(forward[:, 1], difference, rtol=1e-6)


@pytest.mark.slow
def test_a_pair_that_splits():
    # Anisotropy added to isotropic bearings: the pair parts with two different slopes, the shapes
    # fall into the x and y planes, and change with the second derivative of the matrices.
    model = pair_rotor()
    zero = jax.tree.map(lambda a: 0.0 * a, eqx.filter(model, eqx.is_inexact_array))
    stiffness = lambda m: [link.law.stiffness for link in m.links]  # noqa: E731
    turn = jnp.array([[0.6, 0.2], [0.2, -0.3]]) * 1e6  # principal axes off x and y
    direction = eqx.tree_at(stiffness, zero, [turn, turn])
    direction = eqx.tree_at(diameter, direction, 0.1 * diameter(model))
    d = mode_derivatives(model, direction, 4)

    def moved(t):
        where = lambda m: [*stiffness(m), diameter(m)]  # noqa: E731
        base, along = where(model), where(direction)
        return eqx.tree_at(where, model, [a + t * b for a, b in zip(base, along, strict=True)])

    def at(t):
        modes = undamped_modes(moved(t), 4)
        # Sign of the modes as in the adapted basis.
        sign = jnp.sign(jnp.sum(modes.shape * d.modes.shape, (1, 2)))
        return modes.square, modes.shape * sign[:, None, None]

    h = 1e-3
    (up, shape_up), (down, shape_down) = at(h), at(-h)
    # At -h the two members of a pair have changed places.
    swap = jnp.array([1, 0, 3, 2])
    down, shape_down = down[swap], undamped_modes(moved(-h), 4).shape[swap]
    shape_down *= jnp.sign(jnp.sum(shape_down * d.modes.shape, (1, 2)))[:, None, None]
    slopes = (up - down) / (2 * h)
    order = np.argsort(np.asarray(d.square[:2])), 2 + np.argsort(np.asarray(d.square[2:]))
    order = np.concatenate(order)
    # Second-order differences with h = 1e-3 of a smooth branch.
    np.testing.assert_allclose(d.square[order], slopes, rtol=1e-5)
    assert d.square[order][1] > 1.5 * d.square[order][0]
    turned = (shape_up - shape_down) / (2 * h)
    size = float(jnp.abs(turned).max())
    np.testing.assert_allclose(d.shape[order], turned, atol=2e-5 * size)


def test_eigenvector_derivatives():
    model = machine(symmetric=True)
    value = diameter(model)

    @jax.jit
    @jax.value_and_grad
    def shape(d):
        modes = undamped_modes(eqx.tree_at(diameter, model, d), 8)
        picked = modes.shape[5]
        return jnp.sum(jnp.square(picked[3])) / jnp.sum(jnp.square(picked[7]))

    _, g = shape(value)
    h = 1e-3
    at = lambda t: shape(value.at[2].mul(1 + t))[0]  # noqa: E731
    difference = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h * value[2])
    # Eigenvectors carry 1e-9 of rounding (the ratio of the highest to this eigenvalue), 1e-6 after
    # division by the step.
    assert float(g[2]) == pytest.approx(float(difference), rel=3e-6)


@pytest.mark.slow
def test_damped_eigenvalues_and_vectors():
    model = machine()
    value = diameter(model)

    @jax.jit
    def figures(d):
        modes = damped_modes(eqx.tree_at(diameter, model, d), jnp.asarray(SPEED), 8)
        form = jnp.sum(jnp.abs(modes.shape[3, :9, :2]) ** 2)
        return jnp.stack(
            [modes.eigenvalue[6].real, modes.eigenvalue[7].imag, modes.growth, form, modes.whirl[5]]
        )

    slopes, h = jax.jacrev(figures)(value), 1e-4
    direction = value * jnp.array([1.0, -0.5, 0.7, 1.0, 0.3, -1.0, 0.4, 0.6])
    at = lambda t: figures(value + t * direction)  # noqa: E731
    difference = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
    # Truncation h^4; the eigenvalues carry 1e-11 of rounding, 1e-7 after division by the step.
    np.testing.assert_allclose(slopes @ direction, difference, rtol=3e-6, atol=1e-7)


def test_magnetic_pull_limit_is_where_the_stiffness_becomes_singular():
    model = machine()
    limit = magnetic_pull_limit(model)
    pull = lambda m: m.magnetic_pulls[0].stiffness  # noqa: E731
    for factor, held in ((0.999, True), (1.001, False)):
        square = undamped_modes(eqx.tree_at(pull, model, pull(model) * limit * factor), 2).square
        assert bool(square[0] > 0) == held
    slope = jax.grad(lambda k: magnetic_pull_limit(eqx.tree_at(pull, model, k)))(pull(model))
    # The limit on the whole pull is fixed, so that the factor goes with its inverse.
    assert float(slope) == pytest.approx(-float(limit / pull(model)), rel=1e-9)


@pytest.mark.slow
def test_critical_speeds():
    model = pair_rotor(1e6, 1.5e6)
    stiffness = lambda m: m.links[0].law.stiffness  # noqa: E731
    at = lambda k: critical_speeds(eqx.tree_at(stiffness, model, k), 3).speed  # noqa: E731
    value = stiffness(model)
    slope, h = jax.jacrev(at)(value)[:, 0, 0], 1e-4 * value[0, 0]
    step = jnp.zeros((2, 2)).at[0, 0].set(h)
    difference = (at(value + step) - at(value - step)) / (2 * h)
    # Truncation (1e-4)^2, rounding 1e-12/1e-4.
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-12)
    for speed in at(value):  # they are what they are called
        modes = damped_modes(model, speed, 6)
        assert float(jnp.min(jnp.abs(modes.frequency / speed - 1))) < 1e-10


def test_gradient_at_rest_is_finite():
    # No load, no motion: amplitudes at their kink.
    still = jax.tree.map(lambda a: 0.0 * a, eqx.filter(loads(), eqx.is_inexact_array))
    still = eqx.combine(still, loads())
    _, g = with_gradient((machine(), still), SPEEDS, jnp.asarray(1e-9))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(g))
