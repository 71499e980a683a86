"""Shaft elements against exact beams: closed matrices, transfer matrices, closed integrals."""

from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize

from jaxcomp import BadInput
from jaxcomp.rotor import (
    Disks,
    Link,
    PointMasses,
    RotorModel,
    ShaftElements,
    _shaft,
    isotropic,
    matrices,
    shaft_line,
    stepped_shaft,
    undamped_modes,
)
from jaxcomp.rotor._shaft import deformation, shaft_mass, shear_coefficient

# one program, where every operation outside of one is compiled by itself
element_matrices = eqx.filter_jit(_shaft.element_matrices)

LENGTH, OUTER, INNER, YOUNG, DENSITY, POISSON = 0.9, 0.09, 0.03, 2.1e11, 7800.0, 0.3
STEEL = {"young_modulus": YOUNG, "density": DENSITY, "poisson": POISSON}
ENDS = {  # coordinates (u, phi) held at the left and at the right end
    "free-free": ((), ()),
    "pinned-pinned": ((0,), (0,)),
    "clamped-free": ((0, 1), ()),
    "clamped-pinned": ((0, 1), (0,)),
    "clamped-clamped": ((0, 1), (0, 1)),
}


# The shear force is constant in an element: second order where shear counts, fourth without it.
ORDER = {"timoshenko": 2, "rayleigh": 4, "euler-bernoulli": 4}


def beam(n, theory="timoshenko", **more):
    shaft = shaft_line(
        tuple(range(n + 1)),
        length=LENGTH / n,
        outer_diameter=OUTER,
        inner_diameter=INNER,
        theory=theory,
        **STEEL,
        **more,
    )
    return RotorModel((shaft,))


@cache
def beam_matrices(n, theory):
    return matrices(beam(n, theory))


def held_frequencies(n, ends, theory, count=3):
    """Natural frequencies in the x plane (u_x, th_y) with some end coordinates removed."""
    full = beam_matrices(n, theory)
    plane = np.arange(4 * (n + 1)).reshape(-1, 4)[:, [0, 3]]
    left, right = ENDS[ends]
    held = [plane[0, i] for i in left] + [plane[-1, i] for i in right]
    keep = np.setdiff1d(plane.reshape(-1), held)
    k, m = (np.asarray(a)[np.ix_(keep, keep)] for a in (full.stiffness, full.mass))
    square = scipy.linalg.eigh(k, m, eigvals_only=True)
    return np.sqrt(square[square > 1.0])[:count]  # without the rigid motions


def exact_determinant(w, ends, theory):
    """Frequency determinant of the continuous beam, from the exponential of its equations.

    State (u, phi, M, Q), M = EI phi', Q = kappa G A (u' - phi), Q' = -w^2 rho A u,
    M' = -Q - w^2 rho I phi; scaled so that the entries are of one size.
    """
    area = np.pi / 4 * (OUTER**2 - INNER**2)
    i = np.pi / 64 * (OUTER**4 - INNER**4)
    kappa = float(shear_coefficient("cowper", OUTER, INNER, POISSON, 1.0))
    shear = 0.0 if theory != "timoshenko" else 1 / (kappa * YOUNG / 2.6 * area)
    rotary = 0.0 if theory == "euler-bernoulli" else DENSITY * i
    a = np.zeros((4, 4))
    a[0, 1], a[0, 3] = 1.0, shear
    a[1, 2] = 1 / (YOUNG * i)
    a[2, 1], a[2, 3] = -(w**2) * rotary, -1.0
    a[3, 0] = -(w**2) * DENSITY * area
    scale = np.array([1.0, 1 / LENGTH, YOUNG * i / LENGTH**2, YOUNG * i / LENGTH**3])
    t = scipy.linalg.expm(a * scale[None, :] / scale[:, None] * LENGTH)
    left, right = ENDS[ends]
    # A free coordinate u goes with Q = 0 (number 3), a free phi with M = 0 (number 2).
    zero_left = [*left, *((3 if j == 0 else 2) for j in {0, 1} - set(left))]
    zero_right = [*right, *((3 if j == 0 else 2) for j in {0, 1} - set(right))]
    open_left = [j for j in range(4) if j not in zero_left]
    return np.linalg.det(t[np.ix_(zero_right, open_left)])


def exact_frequencies(ends, theory, near):
    return [
        scipy.optimize.brentq(exact_determinant, 0.97 * w, 1.02 * w, (ends, theory), rtol=1e-14)
        for w in near
    ]


@pytest.mark.parametrize("theory", ["timoshenko", "rayleigh", "euler-bernoulli"])
@pytest.mark.parametrize("ends", ENDS)
def test_uniform_beam_meets_exact_frequencies(ends, theory):
    coarse, fine = (held_frequencies(n, ends, theory) for n in (20, 40))
    limit = (2 ** ORDER[theory] * fine - coarse) / (2 ** ORDER[theory] - 1)
    # The next power of the element length, (beta h)^4/720 with shear and less without, beta h <= 0.3.
    np.testing.assert_allclose(limit, exact_frequencies(ends, theory, fine), rtol=1.5e-5)


def test_pinned_timoshenko_beam_meets_its_closed_form():
    area = np.pi / 4 * (OUTER**2 - INNER**2)
    i = np.pi / 64 * (OUTER**4 - INNER**4)
    kappa = float(shear_coefficient("cowper", OUTER, INNER, POISSON, 1.0))
    g = YOUNG / 2.6
    coarse, fine = (held_frequencies(n, "pinned-pinned", "timoshenko") for n in (24, 48))
    for mode, found in enumerate((4 * fine - coarse) / 3, 1):
        b2 = (mode * np.pi / LENGTH) ** 2
        # rho^2 I/(kappa G) w^4 - (rho A + rho I b^2 (1 + E/(kappa G))) w^2 + E I b^4 = 0
        poly = [
            DENSITY**2 * i / (kappa * g),
            -(DENSITY * area + DENSITY * i * b2 * (1 + YOUNG / (kappa * g))),
            YOUNG * i * b2**2,
        ]
        # What the extrapolation leaves is of the order (b h)^4/720, 2e-6 for mode 3 and h = L/48.
        assert found == pytest.approx(np.sqrt(np.roots(poly).min()), rel=5e-6)


@pytest.mark.parametrize("theory", ["timoshenko", "euler-bernoulli"])
def test_frequencies_converge_at_the_order_of_the_element(theory):
    exact = exact_frequencies("clamped-free", theory, held_frequencies(24, "clamped-free", theory))
    errors = [held_frequencies(n, "clamped-free", theory)[1] / exact[1] - 1 for n in (6, 12, 24)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # The next term of the expansion moves the observed order by some (beta h)^2/10.
    np.testing.assert_allclose(orders, ORDER[theory], atol=0.15)
    assert min(errors) > 0  # the elements are compatible, so that frequencies come from above


def test_uniform_element_is_that_of_nelson_1980():
    e = element_matrices(beam(1).shafts)
    area = np.pi / 4 * (OUTER**2 - INNER**2)
    i = np.pi / 64 * (OUTER**4 - INNER**4)
    kappa = float(shear_coefficient("cowper", OUTER, INNER, POISSON, 1.0))
    l, f = LENGTH, 12 * YOUNG * i / (kappa * YOUNG / 2.6 * area * LENGTH**2)
    k = np.array(
        [
            [12, 6 * l, -12, 6 * l],
            [6 * l, (4 + f) * l**2, -6 * l, (2 - f) * l**2],
            [-12, -6 * l, 12, -6 * l],
            [6 * l, (2 - f) * l**2, -6 * l, (4 + f) * l**2],
        ]
    )
    k = k * YOUNG * i / ((1 + f) * l**3)
    a, b = 312 + 588 * f + 280 * f**2, (44 + 77 * f + 35 * f**2) * l
    c, d = 108 + 252 * f + 140 * f**2, -(26 + 63 * f + 35 * f**2) * l
    p, q = (8 + 14 * f + 7 * f**2) * l**2, -(6 + 14 * f + 7 * f**2) * l**2
    m = np.array([[a, b, c, d], [b, p, -d, q], [c, -d, a, -b], [d, q, -b, p]])
    m = m * DENSITY * area * l / (840 * (1 + f) ** 2)
    r, s, t = (3 - 15 * f) * l, (4 + 5 * f + 10 * f**2) * l**2, (-1 - 5 * f + 5 * f**2) * l**2
    rotary = np.array([[36, r, -36, r], [r, s, -r, t], [-36, -r, 36, -r], [r, t, -r, s]])
    rotary = rotary * DENSITY * i / (30 * (1 + f) ** 2 * l)
    shape = np.asarray(deformation(e.length[0]))
    stiffness = shape.T @ e.lateral[0] @ shape
    # Closed forms on both sides: rounding only.
    np.testing.assert_allclose(stiffness, k, rtol=1e-12, atol=1e-12 * k.max())
    np.testing.assert_allclose(e.mass[0], m + rotary, rtol=1e-12, atol=1e-13 * m.max())
    np.testing.assert_allclose(e.polar[0], 2 * rotary, rtol=1e-12, atol=1e-12 * rotary.max())


def test_one_cone_has_the_exact_static_deflection_and_mass():
    cone = ShaftElements(
        ((0, 1),), [0.4], [0.08], [YOUNG], [DENSITY], [POISSON], [0.02], [0.04], [0.01]
    )
    e = element_matrices((cone,))
    shape = np.asarray(deformation(e.length[0]))
    k = (shape.T @ e.lateral[0] @ shape)[2:, 2:]
    tip = np.linalg.solve(k, [1.0, 0.0])

    def section(z):
        do, di = 0.08 - 0.04 * z / 0.4, 0.02 - 0.01 * z / 0.4
        kappa = float(shear_coefficient("cowper", do, di, POISSON, 1.0))
        area, i = np.pi / 4 * (do**2 - di**2), np.pi / 64 * (do**4 - di**4)
        return (0.4 - z) ** 2 / (YOUNG * i) + 1 / (kappa * YOUNG / 2.6 * area)

    exact = scipy.integrate.quad(section, 0, 0.4, epsabs=0, epsrel=1e-12)[0]
    # Eight Gauss points on a 2:1 taper, see `_shaft`.
    assert tip[0] == pytest.approx(exact, rel=1e-8)
    mass = np.array([1.0, 0, 1, 0]) @ np.asarray(e.mass[0]) @ [1.0, 0, 1, 0]
    assert mass == pytest.approx(float(shaft_mass(cone)[0]), rel=1e-12)


def test_a_step_of_cones_equals_its_elements():
    whole = stepped_shaft([0.4], [0.08], elements=1, outer_diameter_end=[0.04], **STEEL)
    parts = stepped_shaft([0.4], [0.08], elements=4, outer_diameter_end=[0.04], **STEEL)
    k = [np.asarray(matrices(RotorModel((s,))).stiffness) for s in (whole, parts)]
    tip = [np.linalg.inv(a[4:, 4:])[-4, -4] for a in k]
    # Statically exact elements: cutting changes only the quadrature.
    assert tip[0] == pytest.approx(tip[1], rel=1e-8)


def test_shear_coefficients_of_the_limits():
    one = lambda law, ratio: float(shear_coefficient(law, 1.0, ratio, 0.3, 0.85))  # noqa: E731
    # Cowper (1966): solid circle 6(1+nu)/(7+6nu), thin tube 2(1+nu)/(4+3nu).
    assert one("cowper", 0.0) == pytest.approx(6 * 1.3 / 8.8, rel=1e-14)
    assert one("cowper", 1.0) == pytest.approx(2 * 1.3 / 4.9, rel=1e-14)
    # Hutchinson (2001): solid circle 6(1+nu)^2/(7+12nu+4nu^2), thin tube (1+nu)/(2+nu).
    assert one("hutchinson", 0.0) == pytest.approx(6 * 1.69 / (7 + 3.6 + 0.36), rel=1e-14)
    assert one("hutchinson", 1.0) == pytest.approx(1.3 / 2.3, rel=1e-14)
    assert one("constant", 0.3) == 0.85


@pytest.mark.parametrize("dof", [4, 6])
def test_free_model_has_exactly_its_rigid_motions(dof):
    shaft = shaft_line(
        tuple(range(10)),
        length=0.05,
        outer_diameter=jnp.array([0.02, 0.03, 0.2, 0.02, 0.03, 0.03, 0.02, 0.04, 0.02]),
        young_modulus=2.1e11,
        density=jnp.array([7800.0] * 4 + [0.0] * 2 + [7800.0] * 3),  # massless piece
        poisson=0.3,
    )
    disks = Disks((2,), [2.0], [0.01], [0.02], offset=[0.01])
    links = (Link((1, None), isotropic(1e7)),)  # left out by `free`
    model = RotorModel((shaft,), (disks,), links=links, dof=dof)
    modes = undamped_modes(model, dof + 4, free=True)
    assert int(np.sum(np.asarray(modes.frequency) == 0)) == dof
    # Not a matter of the threshold: 16 orders of magnitude lie between.
    assert np.abs(modes.square[:dof]).max() < 1e-14 * modes.square[dof]
    held = undamped_modes(model, dof + 4)
    assert int(np.sum(np.asarray(held.frequency) == 0)) == dof - 2  # both displacements are held


def test_axial_and_torsional_frequencies_of_a_free_bar():
    modes = undamped_modes(RotorModel(beam(24).shafts, dof=6), 24, free=True)
    shape, frequency = np.abs(np.asarray(modes.shape)), np.asarray(modes.frequency)
    bar = np.sqrt(YOUNG / DENSITY) * np.pi / LENGTH
    rod = np.sqrt(YOUNG / 2.6 / DENSITY) * np.pi / LENGTH
    # Linear shape functions: (pi/24)^2/24 = 7e-4 for the first mode.
    for axis, exact in ((2, bar), (5, rod)):
        own = [w for w, s in zip(frequency, shape, strict=True) if s[:, axis].max() > 0.9 * s.max()]
        assert next(w for w in own if w > 0) == pytest.approx(exact, rel=8e-4)


def test_bad_input_is_named():
    with pytest.raises(BadInput, match="length"):
        shaft_line((1, 2), length=-0.1, outer_diameter=0.1, **STEEL)
    with pytest.raises(BadInput, match="inner diameters below"):
        shaft_line((1, 2), length=0.1, outer_diameter=0.1, inner_diameter=0.2, **STEEL)
    with pytest.raises(BadInput, match="density"):
        shaft_line(
            (1, 2),
            length=0.1,
            outer_diameter=0.1,
            young_modulus=1e11,
            poisson=0.3,
            density=float("nan"),
        )
    with pytest.raises(BadInput, match="theory"):
        shaft_line((1, 2), length=0.1, outer_diameter=0.1, theory="timo", **STEEL)
    with pytest.raises(BadInput, match="dof"):
        RotorModel(beam(1).shafts, dof=5)
    with pytest.raises(BadInput, match="mass"):
        PointMasses((1, 2), [1.0])
    with pytest.raises(BadInput, match="axes"):
        Link((1, None), isotropic(1.0), axes=("ux", "uw"))
    with pytest.raises(BadInput, match="law"):
        Link((1, None), isotropic(1.0, size=3))
