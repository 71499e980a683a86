"""Classical rotors with a closed solution, and rotors with published numbers."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp.rotor import (
    ConstantLaw,
    Disks,
    Link,
    PointMasses,
    RigidBody,
    RotorModel,
    Unbalances,
    critical_speeds,
    damped_modes,
    diagonal,
    harmonic_response,
    isotropic,
    orbit,
    respond,
    shaft_line,
    solid_disk,
    stepped_shaft,
    transmitted_forces,
)
from jaxcomp.rotor._loads import load_vector

RPM = np.pi / 30


def test_jeffcott_rotor_with_damping():
    # Point mass on a massless shaft in rigid bearings, external damping at the mass:
    # x = m e W^2 / (k - m W^2 + i c W), u_y = -i u_x.
    length, d, young, mass, c = 0.8, 0.02, 2e11, 5.0, 40.0
    shaft = shaft_line(
        (1, 2, 3),
        length=length / 2,
        outer_diameter=d,
        young_modulus=young,
        density=0.0,
        poisson=0.3,
        theory="euler-bernoulli",
    )
    bearing = 1e13  # 7 decades above the shaft
    links = (
        Link((1, None), isotropic(bearing)),
        Link((3, None), isotropic(bearing)),
        Link((2, None), isotropic(0.0, c)),
    )
    model = RotorModel((shaft,), (), (PointMasses((2,), [mass]),), links)
    speeds = jnp.linspace(20.0, 400.0, 7)
    r = respond(model, (Unbalances((2,), [1e-3], [0.7]),), speeds).checked()
    k = 48 * young * np.pi * d**4 / 64 / length**3
    exact = 1e-3 * speeds**2 * np.exp(0.7j) / (k - mass * speeds**2 + 1j * c * speeds)
    x = r.displacement[0, :, 1]
    # The bearings add k/(2 * 1e13), some 1e-8, of flexibility.
    np.testing.assert_allclose(x[:, 0], exact, rtol=3e-7)
    np.testing.assert_allclose(x[:, 1], -1j * exact, rtol=3e-7)
    o = orbit(x[:, 0], x[:, 1])
    np.testing.assert_allclose(o.minor, o.major, rtol=1e-12)  # a forward circle
    # Bearings and damper together carry what the mass does not: m e W^2 + m W^2 x.
    carried = jnp.sum(transmitted_forces(model, r)[0], 1)[:, 0]
    given = 1e-3 * speeds**2 * np.exp(0.7j) + mass * speeds**2 * x[:, 0]
    np.testing.assert_allclose(carried, given, rtol=1e-9)


def test_rigid_rotor_on_springs_splits_by_its_gyroscopic_moment():
    # Translation sqrt(2k/m); conical modes Id w^2 -+ Ip W w - 2 k l^2 = 0.
    m, i_d, i_p, half, k, w = 12.0, 0.4, 0.25, 0.3, 2e6, 900.0
    body = RigidBody(
        "g", ("a", "b"), [[0, 0, -half], [0, 0, half]], m, np.diag([i_d, i_d, i_p]), i_p
    )
    model = RotorModel(links=tuple(Link((n, None), isotropic(k)) for n in "ab"), bodies=(body,))
    modes = damped_modes(model, w, 4)
    cone = 2 * k * half**2
    conical = [
        (s * i_p * w + np.sqrt((i_p * w) ** 2 + 4 * i_d * cone)) / (2 * i_d) for s in (-1, 1)
    ]
    exact = np.sort([np.sqrt(2 * k / m)] * 2 + conical)
    # Closed form of a model of four coordinates: rounding of the eigenproblem.
    np.testing.assert_allclose(modes.frequency, exact, rtol=1e-10)
    whirl = np.asarray(modes.whirl)[np.argsort(np.abs(np.asarray(modes.frequency) - conical[0]))[0]]
    assert whirl == pytest.approx(-1.0, abs=1e-9)


def test_overhung_disk_of_stodola_and_green():
    # Disk at the end of a massless clamped shaft (Stodola 1924; R. Green 1948, J. Appl. Mech. 15):
    # det [k11 - m w^2, -k12; -k12, k22 - Id w^2 + Ip W w] = 0 in the whirl coordinates, with w < 0
    # for backward whirl.
    length, d, young, m, i_d, i_p, w = 0.5, 0.03, 2e11, 20.0, 0.3, 0.55, 260.0
    ei = young * np.pi * d**4 / 64
    shaft = shaft_line(
        (0, 1, 2),
        length=length / 2,
        outer_diameter=d,
        young_modulus=young,
        density=0.0,
        poisson=0.3,
        theory="euler-bernoulli",
    )
    clamp = Link((0, None), diagonal([1e14, 1e14, 1e12, 1e12], [0.0] * 4),
                 axes=("ux", "uy", "thx", "thy"))  # fmt: skip
    model = RotorModel((shaft,), (Disks((2,), [m], [i_d], [i_p]),), links=(clamp,))
    k11, k12, k22 = 12 * ei / length**3, 6 * ei / length**2, 4 * ei / length
    poly = np.polysub(np.polymul([-m, 0, k11], [-i_d, i_p * w, k22]), [k12**2])
    exact = np.sort(np.abs(np.roots(poly)))
    # The clamp is 1e6 to 1e8 times stiffer than the shaft.
    np.testing.assert_allclose(damped_modes(model, w, 4).frequency, exact, rtol=1e-6)
    # Synchronous forward whirl of a disk with Ip > Id has one critical speed only.
    quartic = np.polysub(np.polymul([-m, 0, k11], [-(i_d - i_p), 0, k22]), [k12**2])
    forward = [r.real for r in np.roots(quartic) if abs(r.imag) < 1e-9 and r.real > 0]
    backward = np.polysub(np.polymul([-m, 0, k11], [-(i_d + i_p), 0, k22]), [k12**2])
    both = np.sort(forward + [r.real for r in np.roots(backward) if r.real > 0])
    assert len(forward) == 1
    np.testing.assert_allclose(critical_speeds(model, 3).speed, both, rtol=1e-6)


# H. D. Nelson and J. M. McVaugh (1976), The dynamics of rotor-bearing systems using finite elements,
# J. Eng. Industry 98, 593-600: stations and radii in cm, undamped isotropic bearings; synchronous
# (whirl ratio 1) and half-synchronous critical speeds in rev/min, the latter given as whirl speeds.
# Column as reprinted in the Altair OptiStruct verification manual, OS-V: 1000.
NELSON_STATIONS = [0, 1.27, 5.08, 7.62, 8.89, 10.16, 10.67, 11.43, 12.70, 13.46, 16.51, 19.05, 22.86,
                   26.67, 28.70, 30.48, 31.50, 34.54, 35.50]  # fmt: skip
NELSON_OUTER = [0.51, 1.02, 0.76, 2.03, 2.03, 3.30, 3.30, 2.54, 2.54, 1.27, 1.27, 1.52, 1.52, 1.27,
                1.27, 3.81, 2.03, 2.03]  # fmt: skip
NELSON_INNER = [0, 0, 0, 0, 0, 0, 1.52, 1.78, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1.52]
NELSON_CRITICAL = {1: [15470, 17159, 46612, 49983, 64752], 2: [15858, 16700, 47520, 49204, 69640]}


@cache
def nelson_rotor():
    shaft = shaft_line(
        tuple(range(1, 20)),
        length=np.diff(NELSON_STATIONS) * 1e-2,
        outer_diameter=2e-2 * np.array(NELSON_OUTER),
        inner_diameter=2e-2 * np.array(NELSON_INNER),
        young_modulus=2.078e11,
        density=7806.0,
        poisson=0.3,
        theory="rayleigh",  # the elements of 1976 have rotary inertia and no shear
    )
    links = tuple(Link((n, None), isotropic(4.378e7)) for n in (11, 15))
    return RotorModel((shaft,), (Disks((5,), [1.401], [0.00136], [0.00203]),), links=links)


@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_rotor_of_nelson_and_mcvaugh(order):
    model = nelson_rotor()
    published = np.array(NELSON_CRITICAL[order])
    # The radii are printed to 0.1 mm on shafts of 5 to 38 mm, the lengths likewise: the tolerance is
    # the worst that half of the last digit of all of them can do to each speed.
    place = lambda m: [m.shafts[0].outer_diameter, m.shafts[0].inner_diameter, m.shafts[0].length]  # noqa: E731

    def speeds(leaves):
        critical = critical_speeds(eqx.tree_at(place, model, leaves), 5, order=order).speed
        return critical, critical

    slopes, critical = jax.jit(jax.jacrev(speeds, has_aux=True))(place(model))
    found = critical / RPM * order
    halves = (1e-4, 1e-4, 1e-4)  # diameters 2 * 0.05 mm, differences of stations 2 * 0.05 mm
    allowed = sum(
        h * np.sum(np.abs(s), 1) for h, s in zip(halves, slopes, strict=True)
    ) / RPM * order  # fmt: skip
    assert np.all(np.abs(found - published) < allowed)
    # And not a vacuous bound: within 0.5 %.
    np.testing.assert_allclose(found, published, rtol=5e-3)


# M. Lalanne and G. Ferraris (1998), Rotordynamics Prediction in Engineering, 2nd ed., example of the
# rotor with three disks (13 elements, bearings at the ends): frequencies at 25,000 rev/min in Hz, and
# speeds of the largest response to 200 g mm on the middle disk, in rev/min.
LALANNE_FREQUENCIES = [55.41, 67.21, 157.90, 193.71, 249.90, 407.62, 446.62]
LALANNE_CRITICAL = [3620.4, 3798.1, 10018.0, 11279.0, 16785.0, 24409.0, 26611.0]


@cache
def lalanne_rotor():
    shaft = stepped_shaft(
        [0.2, 0.3, 0.5, 0.3],
        0.1,
        elements=(2, 3, 5, 3),
        young_modulus=2e11,
        density=7800.0,
        poisson=0.3,
    )
    sizes = ((3, 0.24, 0.05), (6, 0.40, 0.05), (11, 0.40, 0.06))
    disks = tuple(solid_disk(n, d, 0.1, width, 7800.0) for n, d, width in sizes)
    law = diagonal([5e7, 7e7], [5e2, 7e2])
    return RotorModel((shaft,), disks, links=(Link((1, None), law), Link((14, None), law)))


def test_rotor_of_lalanne_and_ferraris():
    model = lalanne_rotor()
    modes = damped_modes(model, 25000 * RPM, 7)
    # The book's element has another shear coefficient (1 for the circle); that is what is seen.
    np.testing.assert_allclose(modes.frequency / (2 * np.pi), LALANNE_FREQUENCIES, rtol=5e-4)
    found = critical_speeds(model, 7).speed / RPM
    np.testing.assert_allclose(found, LALANNE_CRITICAL, rtol=1.1e-3)
    assert bool(modes.stable)


# M. I. Friswell, J. E. T. Penny, S. D. Garvey and A. W. Lees (2010), Dynamics of Rotating Machines,
# example 5.9.1: shaft of 1.5 m, two disks, isotropic bearings, six Timoshenko elements. Eigenvalues in
# rad/s at 0 and 4000 rev/min as computed for that example by ROSS (its documentation and test suite).
FRISWELL_591 = {
    0.0: [86.65811435, 86.65811435, 274.31285391, 274.31285391, 716.78631221, 716.78631221],
    4000.0: [85.389467, 87.7958637, 251.78460413, 294.71333087, 600.17936195, 827.07536193],
}


@cache
def friswell_rotor():
    shaft = stepped_shaft(
        [0.25] * 6, 0.05, young_modulus=211e9, density=7810.0, poisson=211 / 2 / 81.2 - 1
    )
    disks = (solid_disk(3, 0.28, 0.05, 0.07, 7810.0), solid_disk(5, 0.35, 0.05, 0.07, 7810.0))
    return RotorModel((shaft,), disks, links=tuple(Link((n, None), isotropic(1e6)) for n in (1, 7)))


@pytest.mark.parametrize("rpm", FRISWELL_591)
def test_rotor_of_friswell_example_5_9_1(rpm):
    modes = damped_modes(friswell_rotor(), rpm * RPM, 6)
    # Two programs with the same element: the digits that were printed.
    np.testing.assert_allclose(modes.frequency, FRISWELL_591[rpm], rtol=2e-8)
    if rpm:
        # Backward and forward in turn.
        np.testing.assert_array_equal(np.sign(np.round(modes.whirl, 6)), [-1, 1] * 3)


# The same rotor on anisotropic, coupled and damped bearings, with 1e-3 kg m on the first disk and
# 5e-4 kg m at 1.2 rad on the second: amplitudes u_x and u_y in m at 50, 150, 300 and 420 rad/s as
# computed by ROSS 2.3.0 (`run_unbalance_response`; kxx = 1e6, kyy = 8e5, kxy = 5e4, kyx = -3e4 N/m,
# cxx = 600, cyy = 400 N s/m).
ROSS_RESPONSE = {
    1: [
        [2.48994005669e-06 + 7.64969349415e-07j, 8.93156113970e-07 - 3.27605132520e-06j],
        [-7.60175648657e-07 - 4.76152889525e-06j, -6.05821968967e-06 - 5.57602195644e-07j],
        [-1.49536753786e-04 - 3.21827844680e-05j, -1.38654078909e-05 + 1.25491982344e-04j],
        [-4.40982468955e-05 + 1.02665049253e-05j, 1.01139600091e-05 + 4.76265972709e-05j],
    ],
    5: [
        [5.48866008209e-06 + 2.54599868599e-06j, 2.81511720607e-06 - 6.37751067563e-06j],
        [-2.02411793023e-05 - 6.25770359490e-06j, -5.63544617363e-06 + 2.00308599755e-05j],
        [4.79247875170e-05 + 1.26648048213e-05j, 1.28648869611e-06 - 3.21058922541e-05j],
        [2.25897128965e-06 - 7.83369362238e-06j, -7.79583096094e-06 - 8.44108193405e-07j],
    ],
}


def test_response_of_friswells_rotor_as_by_another_program():
    law = ConstantLaw([[1e6, 5e4], [-3e4, 8e5]], [[600.0, 0.0], [0.0, 400.0]])
    base = friswell_rotor()
    model = RotorModel(base.shafts, base.disks, links=tuple(Link((n, None), law) for n in (1, 7)))
    loads = (Unbalances((3, 5), [1e-3, 5e-4], [0.0, 1.2]),)
    r = respond(model, loads, jnp.array([50.0, 150.0, 300.0, 420.0]), nodes=(1, 5)).checked()
    for place, node in enumerate((1, 5)):
        # The same element in both; Poisson's ratio from E and G, condition 1e5: seven digits.
        found, other = r.displacement[0, :, place, :2], np.array(ROSS_RESPONSE[node])
        np.testing.assert_allclose(found, other, atol=1e-7 * np.abs(other).max())


def test_unbalance_response_peaks_at_the_critical_speeds():
    # Lalanne's anisotropic rotor: the speed of the peak is the critical speed but for damping.
    model = lalanne_rotor()
    critical = float(critical_speeds(model, 7).speed[1])
    speeds = critical * jnp.linspace(0.99, 1.01, 64)
    r = respond(model, (Unbalances((6,), [200e-6], [0.0]),), speeds, nodes=(6,)).checked()
    major = orbit(r.displacement[0, :, 0, 0], r.displacement[0, :, 0, 1]).major
    # Damping ratio 4e-4 moves the peak by its square; the other mode, 5 % away, by 2e-4; grid 3e-4.
    assert float(speeds[jnp.argmax(major)]) == pytest.approx(critical, rel=1e-3)


def test_cross_coupled_bearing_goes_unstable_where_it_should():
    # Rigid rotor, k_xy = -k_yx = q: unstable when q > c w, with w = sqrt(k/m).
    m, k, c = 10.0, 1e6, 200.0
    w = np.sqrt(k / m)
    for factor in (0.999, 1.001):
        q = factor * c * w
        law = ConstantLaw([[k, q], [-q, k]], [[c, 0.0], [0.0, c]])
        model = RotorModel(masses=(PointMasses((1,), [m]),), links=(Link((1, None), law),))
        modes = damped_modes(model, 100.0, 2)
        assert bool(modes.stable) == (factor < 1)
        assert float(modes.growth) == pytest.approx(float(jnp.max(modes.eigenvalue.real)), rel=1e-6)


def test_load_of_an_unbalance_turns_forward():
    model = friswell_rotor()
    f = load_vector(model, (Unbalances((3,), [2e-4], [0.3]),), 1, jnp.asarray(50.0))
    expected = 2e-4 * 50.0**2 * np.exp(0.3j)
    np.testing.assert_allclose(f[2, :2], [expected, -1j * expected], rtol=1e-14)
    r = harmonic_response(model, f, 50.0, 50.0).checked()
    o = orbit(r.displacement[2, 0], r.displacement[2, 1])
    assert abs(o.backward) < 1e-12 * abs(o.forward)  # isotropic: rounding only
