"""Derivatives of efficiency and speed fluctuation with respect to every number of the machine."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import STENCIL, machine, named_leaves, nudged, solve_many

from jaxcomp import Collocation, Shooting, solve_orbit
from jaxcomp.crank import _solve_orbit

FINE = Collocation(nodes=16)
FINEST = Collocation(nodes=40)
TIGHT = Shooting(solver=diffrax.Dopri8(), tolerance=1e-9)


def measures(orbit):
    return np.array([float(orbit.mechanical_efficiency), float(orbit.speed_fluctuation)])


def every_number(tree):
    """(name, index, step) of every float in the tree, with a step that suits its size."""
    for name, leaf in named_leaves(tree).items():
        for index in np.ndindex(leaf.shape):
            # Fourth order leaves (1e-3)^4 = 1e-12; the orbit's own 1e-13 over h leaves 1e-10.
            yield name, index, 1e-3 * (abs(float(leaf[index])) or SIZE_AT_ZERO[name])


# Parameters that are zero in this machine have no size of their own.
SIZE_AT_ZERO = {"mechanism.offset": 0.05, "gravity": 10.0}
# Places along the shaft, of which a single journal in the plane of the rod knows nothing.
ALONG = {f"crankshaft.{name}" for name in ("throw_pitch", "rod_pitch", "mass_centre", "origin")}
SIZE_AT_ZERO |= dict.fromkeys(ALONG, 0.1)


def differences(compressor, solver):
    """Central differences of fourth order of both measures to every number."""
    numbers = list(every_number(compressor))
    moved = [
        nudged(
            compressor,
            name,
            jnp.zeros_like(named_leaves(compressor)[name]).at[index].set(offset * step),
        )
        for name, index, step in numbers
        for offset, _ in STENCIL
    ]
    values = np.array([measures(o) for o in solve_many(moved, solver)])
    weights = np.array([w for _, w in STENCIL])
    slopes = np.einsum("w,nwm->nm", weights, values.reshape(len(numbers), len(STENCIL), 2))
    return {(n, i): slope / step for (n, i, step), slope in zip(numbers, slopes, strict=True)}


@pytest.fixture(scope="module")
def point():
    # Weights, offset and all masses at work; a counterweight that does not cancel anything.
    return machine(offset=0.01, gravity=(-9.0, 3.0), back_pressure=0.12e6)


def compare(gradient, estimates, compressor, relative):
    """Elasticities (slope times size of the parameter), so that one tolerance serves all."""
    leaves = named_leaves(compressor)
    for (name, index), slope in estimates.items():
        size = abs(float(leaves[name][index])) or SIZE_AT_ZERO[name]
        for measure in range(2):
            got = float(gradient[name][(measure, *index)]) * size
            expected = slope[measure] * size
            # A parameter of little influence is held to the same share of an elasticity of 1e-3.
            assert got == pytest.approx(expected, rel=relative, abs=relative * 1e-3), (
                name,
                measure,
            )


@pytest.fixture(scope="module")
def estimates(point):
    return differences(point, FINE)


@pytest.mark.slow
def test_reverse_mode_through_collocation(point, estimates):
    gradient, _ = solve_many([point], FINE, derivatives=True)[0]
    # measured: 2e-8
    compare(named_leaves(gradient), estimates, point, 1e-6)


def test_no_parameter_is_without_influence_by_mistake(point, estimates):
    idle = {name for (name, _), slope in estimates.items() if np.all(np.abs(slope) < 1e-12)}
    # what is delivered is no measure here
    assert idle == ALONG | {"gas.gas_constant"}


@pytest.mark.slow
def test_forward_mode_through_collocation(point):
    gradient, _ = solve_many([point], FINE, derivatives=True)[0]
    exact = named_leaves(gradient)

    def along(compressor, tangent):
        def both(c):
            orbit = solve_orbit(c, FINE, throw=False)
            return jnp.stack([orbit.mechanical_efficiency, orbit.speed_fluctuation])

        return jax.jvp(both, (compressor,), (tangent,))[1]

    forward = jax.jit(along)
    zero = jax.tree.map(jnp.zeros_like, point)
    for name, index, _ in every_number(point):
        leaf = named_leaves(point)[name]
        slope = forward(point, nudged(zero, name, jnp.zeros_like(leaf).at[index].set(1.0)))
        expected = exact[name][(slice(None), *index)]
        np.testing.assert_allclose(slope, expected, rtol=1e-8, atol=1e-12 + 1e-9 * abs(expected[0]))


@pytest.mark.slow
def test_hessian_through_collocation_equals_differences_of_the_gradient(point):
    names = ["mechanism.conrod_length", "mechanism.piston_mass", "friction.crank_pin.coefficient"]
    names += ["gas.discharge_pressure", "motor.mean_speed"]
    sizes = jnp.asarray([float(named_leaves(point)[name]) for name in names])

    def efficiency(shares):
        compressor = point
        for name, change in zip(names, shares * sizes, strict=True):
            compressor = nudged(compressor, name, change)
        return solve_orbit(compressor, FINE, throw=False).mechanical_efficiency

    direction = jnp.asarray([0.3, -1.0, 0.7, 0.4, 0.8])
    gradient = jax.grad(efficiency)
    along = jax.jit(lambda x, d: (gradient(x), jax.jvp(gradient, (x,), (d,))[1]))
    zero = jnp.zeros(5)
    _, exact = along(zero, direction)
    step = 1e-3
    estimate = sum(w * along(o * step * direction, direction)[0] for o, w in STENCIL) / step
    np.testing.assert_allclose(exact, estimate, rtol=1e-6, atol=1e-7)


@pytest.mark.slow
def test_reverse_mode_through_shooting(point):
    def both(compressor):
        orbit = solve_orbit(compressor, TIGHT, throw=False)
        return jnp.stack([orbit.mechanical_efficiency, orbit.speed_fluctuation])

    gradient = jax.jit(jax.jacrev(both))(point)
    # Differences through the other solver. With 40 nodes its own elasticities are good to 1e-7 (with
    # 16 nodes only to 4e-5, though its values are good to 4e-9); measured here: 1e-7.
    compare(named_leaves(gradient), differences(point, FINEST), point, 1e-6)


def test_a_derivative_of_shooting_steps_where_the_solution_did(point):
    """To the last bit, whatever the error of its steps is: pieces integrated again have to meet."""

    @jax.jit
    def step_ends(tolerance, followed=None):
        solver = Shooting(tolerance=tolerance, reversals=0)
        unknowns = jnp.ones(2)  # the speed at the beginning, and the level of the motor's torque
        fixed = solver._prepared(point)
        return solver.march(point, unknowns, fixed, solver.adjoint, step_ends=followed)[1]

    chosen = step_ends(1e-6)
    assert np.isfinite(chosen).sum() > 20
    # with a tolerance that would ask for a third of the steps
    assert np.isfinite(step_ends(1e-3)).sum() < np.isfinite(chosen).sum()
    np.testing.assert_array_equal(step_ends(1e-3, chosen), chosen)


def test_a_further_gradient_is_no_program_of_its_own(monkeypatch, point):
    """An optimiser that steps outside of `jit` waits for compilers once."""
    solved = []

    def counted(*arguments):
        solved.append(arguments)
        return checked_orbit(*arguments)

    def efficiency(factor):
        radius = point.mechanism.crank_radius * factor
        changed = eqx.tree_at(lambda machine: machine.mechanism.crank_radius, point, radius)
        # how many programs there are has nothing to do with the load reversals
        return solve_orbit(changed, Collocation(nodes=6, reversals=0)).mechanical_efficiency

    checked_orbit = _solve_orbit._checked_orbit
    monkeypatch.setattr(_solve_orbit, "_checked_orbit", counted)
    jax.grad(efficiency)(1.0)
    first = len(solved)
    assert first > 0
    jax.grad(efficiency)(1.01)
    assert len(solved) == first
