"""Rotors of hair-thin, stubby, hard, soft and very many elements; poles and what lies beyond them.

A frequency met exactly, unheld parts and NaN stand in `test_rotor_response`, beams of the ordinary
kind in `test_rotor_beams`.
"""

import time
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.rotor import (
    Disks,
    Link,
    MagneticPull,
    PointMasses,
    RotorModel,
    Unbalances,
    damped_modes,
    harmonic_response,
    isotropic,
    matrices,
    respond,
    shaft_line,
    undamped_modes,
)
from jaxcomp.rotor._loads import nodal_load
from jaxcomp.rotor._modes import magnetic_pull_limit

YOUNG, DENSITY = 2.06e11, 7850.0


def line(elements, length=0.5, diameter=0.02, *, support=1e6, damping=10.0, young=YOUNG):
    """A uniform shaft on a spring at each end."""
    shaft = shaft_line(
        tuple(range(elements + 1)),
        length=length / elements,
        outer_diameter=diameter,
        young_modulus=young,
        density=DENSITY,
        poisson=0.3,
    )
    links = tuple(
        Link((node, None), isotropic(k, damping))
        for node, k in zip((0, elements), np.broadcast_to(support, 2), strict=True)
    )
    return RotorModel((shaft,), links=links)


def middle_response(model, node, frequency=0.0, solver="structured"):
    force = nodal_load(model, node, "ux")
    r = harmonic_response(model, force, 0.0, frequency, solver=solver)
    return r, r.displacement[node, 0]


def sag(length, diameter, support, young=YOUNG):
    """[m/N] of a force in the middle: two springs, bending, and shear of a round section."""
    area, second = np.pi / 4 * diameter**2, np.pi / 64 * diameter**4
    kappa = 6 * 1.3 / (7 + 6 * 0.3)  # Cowper (1966), solid circle
    shear = young / 2.6
    stiff = 0.25 * np.sum(1 / np.broadcast_to(support, 2))
    return stiff + length**3 / (48 * young * second) + length / (4 * kappa * shear * area)


@eqx.filter_jit
@partial(eqx.filter_grad, has_aux=True)
def slope_of_sag(diameter, model):
    """Slope of the sag by the diameters, and the response: one program for all proportions."""
    changed = eqx.tree_at(lambda m: m.shafts[0].outer_diameter, model, diameter)
    response, moved = middle_response(changed, 4)
    return moved.real, (response, moved)


# ---------------------------------------------------------------- elements of all proportions
@pytest.mark.parametrize(
    ("length", "diameter"),
    [
        pytest.param(0.5, 0.02, marks=pytest.mark.slow),
        pytest.param(1e-3, 0.5, marks=pytest.mark.slow),
        (1e-5, 0.5),
        pytest.param(50.0, 1e-3, marks=pytest.mark.slow),
        (1.0, 1e-6),
    ],
    ids=["shaft", "disc", "foil", "wire", "hair"],
)
def test_static_sag_from_stubby_to_hair_thin(length, diameter):
    """Length over diameter from 2e-5 to 1e6: elements of the exact deflection have it exactly."""
    stiffest = 1 / sag(length, diameter, np.inf)
    model = line(8, length, diameter, support=stiffest)
    slope, (response, moved) = slope_of_sag(model.shafts[0].outer_diameter, model)
    assert response.words == "ok"
    # 8 elements; rounding times a condition that the scaled factorisation keeps below 1e6
    assert float(moved.real) == pytest.approx(sag(length, diameter, stiffest), rel=1e-9)

    # compliance of bending goes with d^-4, of shear with d^-2: the slope lies between the two
    free = float(moved.real) - 0.5 / stiffest
    share = -float(jnp.sum(slope)) * diameter / free
    assert 2 - 1e-6 < share < 4 + 1e-6


@pytest.mark.parametrize("ratio", [pytest.param(1e6, marks=pytest.mark.slow), 1e12])
def test_supports_of_a_million_million_to_one(ratio):
    """The soft spring carries its half of the load: its own compliance is all that counts."""
    model = line(8, support=np.array([1.0, ratio]), damping=0.0)
    response, moved = middle_response(model, 4)
    assert response.words == "ok"
    # 1/4 of 1/k_soft; the condition number is the ratio of the stiffnesses of shaft and spring, 1e7
    assert float(moved.real) == pytest.approx(sag(0.5, 0.02, [1.0, ratio]), rel=1e-8)
    dense, other = middle_response(model, 4, solver="dense")
    assert dense.words == "ok"
    assert complex(other) == pytest.approx(complex(moved), rel=1e-8)


def test_rigid_motion_on_soft_springs_has_its_frequency():
    """Springs 1e12 times softer than the shaft: the modes of a rigid bar, apart from 1e-10."""
    mass = DENSITY * np.pi / 4 * 0.02**2 * 0.5
    model = line(8, support=1e-4, damping=0.0)
    modes = undamped_modes(model, 4)
    square = 2e-4 / mass
    found = np.asarray(modes.square)
    # both planes, up and down and then turning about the middle, where a thin bar has three times the
    # square; the largest square of this model is 1e18 times larger, of which rounding takes 1e-16
    np.testing.assert_allclose(found[:2], square, rtol=1e-7)
    np.testing.assert_allclose(found[2:], 3 * square, rtol=2e-3)


# ---------------------------------------------------------------- many elements
@pytest.mark.slow
def test_many_elements_equal_few_and_the_dense_solver():
    """Elements of exact deflection: 200 of them say at rest what 2 say, by either solver."""
    many = line(200)
    fast, moved = middle_response(many, 100, 300.0)
    slow, other = middle_response(many, 100, 300.0, solver="dense")
    assert fast.words == slow.words == "ok"
    assert complex(moved) == pytest.approx(complex(other), rel=1e-7)
    _, still = middle_response(many, 100)
    assert float(still.real) == pytest.approx(sag(0.5, 0.02, 1e6), rel=1e-6)


@pytest.mark.slow
def test_a_thousand_elements_take_a_bounded_time():
    """Compiled or not, within minutes on a busy machine; the work goes with the number."""
    start = time.perf_counter()
    model = line(1000)
    speeds = jnp.linspace(50.0, 500.0, 10)
    r = respond(model, (Unbalances((500,), [1e-4], [0.0]),), speeds)
    assert np.all(np.asarray(r.ok))
    few = respond(line(20), (Unbalances((10,), [1e-4], [0.0]),), speeds)
    # elements of 25 mm have the mass of the shape to (25 mm/wavelength)^4
    np.testing.assert_allclose(
        r.displacement[:, :, 500], few.displacement[:, :, 10], rtol=1e-5, atol=1e-12
    )
    assert time.perf_counter() - start < 240.0


# ---------------------------------------------------------------- poles
def test_response_grows_to_the_pole_by_its_law_and_is_flagged_on_it():
    """Without damping: |X| = F/(m |w0^2 - w^2|) up to 1e-12 of the pole, then a word."""
    mass, pole = 2.0, 50.0
    model = RotorModel(
        masses=(PointMasses(("m",), [mass]),),
        links=(Link(("m", None), isotropic(mass * pole**2, 0.0)),),
    )
    away = np.array([1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-15, 0.0])
    w = pole * (1 + away)
    force = jnp.array([[1.0, 0, 0, 0]], complex)
    r = jax.jit(jax.vmap(lambda w: harmonic_response(model, force, 0.0, w)))(jnp.asarray(w))
    good = np.asarray(r.ok)
    assert np.all(good[:5])
    assert not np.any(good[-2:])
    inverse = mass * (pole - w[good]) * (pole + w[good])
    error = np.abs(np.asarray(r.displacement[good, 0, 0]) * inverse - 1)
    # a rounding of w of 1e-16 over its distance from the pole
    assert np.all(error < 4e-16 / away[good] + 1e-13)


@pytest.mark.slow
def test_beyond_the_limit_of_the_magnetic_pull_nothing_looks_stable():
    shaft = line(8)
    pulled = lambda k: RotorModel(  # noqa: E731
        shaft.shafts, (Disks((4,), [3.0], [1e-3], [2e-3]),), links=shaft.links,
        magnetic_pulls=(MagneticPull(((4, None),), k),),
    )  # fmt: skip
    stiffness = 1 / sag(0.5, 0.02, 1e6)
    assert float(magnetic_pull_limit(pulled(1e5))) * 1e5 == pytest.approx(stiffness, rel=1e-9)
    for share in (0.5, 0.999, 1.001, 2.0, 100.0):
        model = pulled(share * stiffness)
        limit, stable = float(magnetic_pull_limit(model)), share < 1
        assert limit == pytest.approx(1 / share, rel=1e-9)
        assert (float(damped_modes(model, 10.0, 4).growth) < 0) == stable, share
        # static response pulls the other way beyond the limit: finite, and with the sign that says so
        response, moved = middle_response(model, 4)
        assert response.words == "ok"
        exact = 1 / (stiffness * (1 - share))
        # 1e-3 from the limit the stiffness that is left has lost three digits
        assert float(moved.real) == pytest.approx(exact, rel=1e-7)
    at = harmonic_response(pulled(stiffness), nodal_load(pulled(stiffness), 4, "ux"), 0.0, 0.0)
    assert at.words != "ok" or float(jnp.max(jnp.abs(at.displacement))) > 1e9 / stiffness


def test_matrices_of_extreme_tables_are_finite_and_symmetric():
    for length, diameter in ((1e-6, 1.0), (10.0, 1e-7)):
        found = matrices(line(4, length, diameter), 0.0)
        for m in (found.stiffness, found.mass):
            m = np.asarray(m)
            assert np.all(np.isfinite(m))
            np.testing.assert_allclose(m, m.T, atol=1e-12 * np.abs(m).max())
