"""The slider-link machine at given instants, against printed formulas and golden values.

Machine: a consistent household machine of 8 cm3 (bore 23 mm, stroke 19.2 mm). The oracles repeat
Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I). Mathematical model*, in NumPy with
the letters of the print; misprints are corrected where a comment says so.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, Compressor
from jaxcomp._core.fields import known_values
from jaxcomp.compressor import instants as eager_instants
from jaxcomp.compressor import loads_at as eager_loads_at
from jaxcomp.crankshaft import Crankshaft, MainBearings
from jaxcomp.friction import (
    CoulombJournal,
    CoulombSlide,
    OilPump,
    PistonFilm,
    SliderCrankFriction,
    SliderLinkFriction,
    ThrustBearing,
)
from jaxcomp.friction._joint_loads import joint_loads as eager_joint_loads
from jaxcomp.mechanism import CrankState, SliderLink, contact
from jaxcomp.mechanism._slider_link import ContactArms, PistonLoads, contact_arms
from jaxcomp.motor import MeanSpeed

_joint_loads = eqx.filter_jit(eager_joint_loads)


def joint_loads(*arguments):
    """Loads as numbers of NumPy, with which tests calculate without compiling anything."""
    return known_values(_joint_loads(*arguments))


GEOMETRY = dict(
    bore=0.023,
    crank_radius=0.0096,
    cylinder_length=0.034,
    crown_to_link=0.048,
    slider_diameter=0.018,
    piston_mass=0.110,
    slider_mass=0.022,
)
SHAFT = dict(
    inertia=4.5e-4,
    mass=1.2,
    unbalance=-1.2 * 0.62e-3,  # e_cr = 0.62 mm
    shaft_couple=[2.6e-5 - 0.035 * 1.2 * 0.62e-3, 0.0],  # J_xz = 2.6e-5 kg m^2
    origin=0.035,
)
SIGNS = np.array(np.meshgrid([1, -1], [1, -1], [1, -1], indexing="ij")).reshape(3, 8)


def machine(**changes) -> SliderLink:
    return known_values(SliderLink(**(GEOMETRY | changes)))


def coulomb_friction(mu_c=0.1, mu_s=0.1, mu=0.01, **changes) -> SliderLinkFriction:
    laws = dict(
        wall=CoulombSlide(mu_c),
        link_slider=CoulombSlide(mu_s),
        piston_film=PistonFilm(6e-6, 4e-3),
        crank_pin=CoulombJournal(mu, 0.012),
    )
    return SliderLinkFriction(**(laws | changes))


def bearings(mu=0.01, **changes) -> MainBearings:
    laws = dict(
        bearings=(CoulombJournal(mu, 0.016), CoulombJournal(mu, 0.016)),
        position=[0.024, 0.066],
        # The golden values were made with g = 9.81 m/s^2.
        thrust_bearing=ThrustBearing(0.095 * 9.81 / 9.80665, 0.011, 0.008),
        pump=OilPump(2.5 / 305),
        names=("upper_bearing", "lower_bearing"),
    )
    return MainBearings(**(laws | changes))


def crankshaft(**changes) -> Crankshaft:
    return Crankshaft(**(SHAFT | {"main_journal": bearings()} | changes))


def compressor(linkage=None, friction=None, shaft=None, **parts) -> Compressor:
    """The linkage on its shaft; what is not given is that of this file, without friction."""
    return Compressor(
        machine() if linkage is None else linkage,
        crankshaft() if shaft is None else shaft,
        **({"motor": MeanSpeed(300.0)} | parts),
        friction=friction,
    )


def loads_at(compressor, state, gas):
    """Of one cylinder, under its gas force (n,), as numbers of NumPy."""
    return known_values(_loads_at(compressor, state, gas))


@eqx.filter_jit
def _loads_at(compressor, state, gas):
    return eager_loads_at(compressor, state, gas[None])


instants = eqx.filter_jit(eager_instants)


class Substitution(NamedTuple):
    """One substitution of Eq. (35): G(a) [rad/s^2] and |G'(a)|, by which it shrinks the error."""

    acceleration: jax.Array
    contraction: jax.Array


@eqx.filter_jit
def substitution(compressor, state, gas, motor_torque) -> Substitution:
    """The crank acceleration that Eq. (35) gives for an assumed one, a -> G(a).

    The contacts are piecewise linear in a and enter the denominator J_z + g_4; only the moments of the
    journals are taken at the assumed a. The print drops the pump from (35); it is in.
    """
    whole = instants(compressor, state.angle)
    _, piston_1, _ = compressor.mechanism.piston(state.angle)
    drive = (
        motor_torque + whole.conservative - gas * piston_1 - 0.5 * whole.inertia_1 * state.speed**2
    )

    def split(value):
        loads = loads_at(compressor, state._replace(acceleration=value), gas)
        zero = jnp.zeros_like(value)
        contacts = sum((loads.loss_torque.get(k, zero) for k in ("wall", "link_slider")), zero)
        return whole.inertia * value + contacts, loads.total_loss_torque - contacts + zero

    value = state.acceleration
    (contacts, journals), (slope, journal_slope) = jax.jvp(split, (value,), (jnp.ones_like(value),))
    return Substitution(
        value - (contacts + journals - drive) / slope, jnp.abs(journal_slope / slope)
    )


def random_states(n, seed=0):
    rng = np.random.default_rng(seed)
    state = CrankState(
        rng.uniform(0, 2 * np.pi, n),
        rng.uniform(50, 400, n),
        rng.uniform(-4000, 4000, n),
    )
    return state, rng.uniform(-50, 700, n)


def product_of_inertia(shaft: Crankshaft):
    """[kg m^2] J_xz, the sum of m x z over the crank with z from the mass centre of the machine."""
    return shaft.shaft_couple[0] - shaft.origin * shaft.unbalance


class Printed:
    """Eqs. (1)-(35) as printed, for given signs d1..d5; (13) with its bracket completed."""

    def __init__(self, machine: Compressor, mu_c, mu_s, eta_over_c, state, gas_force, signs):
        m, shaft = machine.mechanism, machine.crankshaft
        phi, w, a = (np.asarray(x) for x in state)
        v = {f.name: np.asarray(getattr(m, f.name)) for f in dataclasses.fields(m)}
        D, R, Ds = v["bore"], v["crank_radius"], v["slider_diameter"]
        Lc, Lp = v["cylinder_length"], v["crown_to_link"]
        mp, ms, mr = v["piston_mass"], v["slider_mass"], np.asarray(shaft.mass)
        e, ecl, ecr = -v["offset"], v["piston_centre_offset"], -np.asarray(shaft.unbalance) / mr
        zs, (zp, zq) = np.asarray(shaft.origin), np.asarray(shaft.main_journal.position)
        zb, Jxz, Jz = zq - zp, np.asarray(product_of_inertia(shaft)), np.asarray(shaft.inertia)
        d1, d2, d3, d4, d5 = signs
        sin, cos = np.sin(phi), np.cos(phi)
        xd, xdd = -R * w * sin, -R * (w**2 * cos + a * sin)
        ydd = -R * (w**2 * sin - a * cos)
        Le = Lc - R * (1 - cos)
        self.film = -eta_over_c * np.pi * D * Le * xd
        X, G = mp * xdd, np.asarray(gas_force) - self.film
        edge = R * (1 - cos) + Lp - Lc
        h = R * sin + e
        self.A = (
            (((edge * d5 - Ds / 2) * d3 + (Ds / 2 - Lp * d5) * d4) * d2 * mu_s + (d3 - d4) * h)
            * d1 * mu_c
            + d2 * d5 * mu_c**2 * mu_s * (d3 - d4) * D / 2
            + R * (cos - 1) + Lc
        )  # fmt: skip
        A1 = (
            ((((D / 2 + ecl * d4) * d1 * mu_c + edge) * d5 - Ds / 2) * d2 * mu_s + h - ecl) * X
            + (((d1 * mu_c * D / 2 + edge) * d5 - Ds / 2) * d2 * mu_s + h) * G
        )  # fmt: skip
        A2 = (
            ((Ds / 2 - ((d3 * ecl + D / 2) * d1 * mu_c + Lp) * d5) * d2 * mu_s + ecl - h) * X
            + ((Ds / 2 - (d1 * mu_c * D / 2 + Lp) * d5) * d2 * mu_s - h) * G
        )  # fmt: skip
        g2 = d1 * mu_c * ecl * (d3 - d4) + Lc + R * (cos - 1)
        g3 = Lc + R * (cos - 1)
        A3 = g2 * X + g3 * G
        g1 = 1 / self.A
        self.F1, self.F2, self.N = A1 * g1, A2 * g1, A3 * g1
        # Table 2
        U, V = a * sin + w**2 * cos, a * cos - w**2 * sin
        s = d2 * d5 * mu_s
        self.upper = np.stack([
            (U * (Jxz + mr * ecr * (zp - zs + zb) - R * (zp + zb) * (g1 * g2 * mp + ms))
             + g1 * g3 * G * (zp + zb)) / zb,
            -(V * (Jxz + mr * ecr * (zp - zs + zb) - R * (zp + zb) * ms)
              + U * s * g1 * g2 * R * (zp + zb) * mp - s * g1 * g3 * (zp + zb) * G) / zb,
        ])  # fmt: skip
        self.lower = np.stack([
            -(U * (Jxz + mr * ecr * (zp - zs) - R * zp * (g1 * g2 * mp + ms))
              + g1 * g3 * zp * G) / zb,
            -(V * (-Jxz - mr * ecr * (zp - zs) + R * zp * ms)
              - U * s * g1 * g2 * R * zp * mp + s * g1 * g3 * zp * G) / zb,
        ])  # fmt: skip
        self.pin = np.stack([self.N + ms * xdd, s * self.N + ms * ydd])
        self.g4 = -(R**2) * (g1 * g2 * mp * (0.5 * s * np.sin(2 * phi) - sin**2) - ms)
        self.g5 = R**2 * g1 * g2 * mp * (0.5 * np.sin(2 * phi) - cos**2 * s)
        self.g6 = -R * g1 * g3 * (sin - cos * s)
        self.G, self.Jz = G, Jz


def kinematic_signs(state):
    phi = np.asarray(state.angle)
    return np.where(np.sin(phi) >= 0, 1.0, -1.0), np.where(np.cos(phi) >= 0, 1.0, -1.0)


def sides(loads):
    forces = loads.forces
    values = forces["wall_crown"][1], forces["wall_edge"][1], forces["link_slider"][0]
    return tuple(np.where(np.asarray(v) >= 0, 1.0, -1.0) for v in values)


# phi, F_g, det A, F1, F2, N, F_kx, F_ky, F_ax, F_ay, F_bx, F_by at w = 300, a = -200, and a of (35)
# at w = 300; e = e_cl = 1 mm. Made by three independent routes that agree to 5e-13.
GOLDEN = np.array([
    [0.3, 200, 0.034805916789, 16.566023350, -26.920247611, 103.542242618, 85.395689406,
     4.696622760, 234.56553036, 38.67376038, -85.24448305, -14.04695051, 881.039685131],
    [1.2, -5, 0.026773333053, -9.783326726, 5.347373480, -44.359532453, -51.207859319,
     -13.295551692, -42.58999405, 77.18357730, 15.50692256, -28.01587297, -424.517434234],
    [2.0, 0, 0.021751891332, 11.442125269, -7.918878973, 35.232462963, 43.180990755,
     -20.789593743, 23.89090669, 62.83434411, -8.71041157, -22.79930481, 1115.945036855],
    [3.1, 0, 0.015183384660, -13.409785728, 22.538420006, 91.286342787, 110.279660090,
     -9.876796041, 68.24067886, -11.38244348, -24.86929563, 4.14121729, 366.793533828],
    [4.0, 10, 0.016296210661, -41.103533275, 49.395065101, 82.915318261, 95.307808869,
     6.121379911, 81.22400909, -70.10145683, -29.57156486, 25.45007948, -962.976283797],
    [4.75, 60, 0.023551728706, -18.286200249, 12.018357684, 62.678425648, 61.921473799,
     25.260811583, 101.49202890, -65.35844236, -36.90402017, 23.71220399, -846.361626967],
    [5.6, 290, 0.031271946165, -28.839006190, 6.590131432, 222.488747579, 207.720126657,
     34.215231108, 408.10561039, -12.42157721, -148.35966003, 4.48259845, -2935.718626309],
    [6.25, 250, 0.033441365655, 7.762949313, -23.592685560, 158.297362473, 139.298426441,
     16.418190052, 323.98453546, 22.54515437, -117.75803890, -8.19992658, -33.317270928],
])  # fmt: skip
GOLDEN_STATE = CrankState(jnp.asarray(GOLDEN[:, 0]), jnp.full(8, 300.0), jnp.full(8, -200.0))
GOLDEN_GAS = jnp.asarray(GOLDEN[:, 1])
OFFSET = dict(offset=-1e-3, piston_centre_offset=1e-3)


@pytest.fixture(scope="module")
def golden():
    made = compressor(machine(**OFFSET), coulomb_friction())
    loads = loads_at(made, GOLDEN_STATE, GOLDEN_GAS)
    signs = (*kinematic_signs(GOLDEN_STATE), *sides(loads))
    return loads, Printed(made, 0.1, 0.1, 4e-3 / 6e-6, GOLDEN_STATE, GOLDEN_GAS, signs)


def test_golden_forces(golden):
    loads, _ = golden
    f = loads.forces
    got = [f["wall_crown"][1], f["wall_edge"][1], f["link_slider"][0]]
    got += [*f["crank_pin"], *f["upper_bearing"], *f["lower_bearing"]]
    # the table has eight or nine decimals
    np.testing.assert_allclose(np.stack(got), GOLDEN[:, 3:12].T, atol=6e-9, rtol=0)


def test_golden_determinant(golden):
    np.testing.assert_allclose(golden[1].A, GOLDEN[:, 2], atol=6e-13)  # twelve decimals


def substitute(made, state, gas, motor_torque, times):
    value = jnp.zeros_like(state.angle)
    steps = []
    for _ in range(times):
        now = state._replace(acceleration=value)
        value, contraction = substitution(made, now, gas, motor_torque)
        steps.append(value)
    return steps, contraction


def test_golden_acceleration():
    made = compressor(machine(**OFFSET), coulomb_friction())
    steps, _ = substitute(made, GOLDEN_STATE, GOLDEN_GAS, 0.25, 5)
    np.testing.assert_allclose(steps[-1], GOLDEN[:, 12], atol=6e-10, rtol=1e-13)  # nine decimals


def test_five_substitutions_reach_rounding(golden):
    made = compressor(machine(**OFFSET), coulomb_friction())
    steps, contraction = substitute(made, GOLDEN_STATE, GOLDEN_GAS, 0.25, 9)
    change = np.abs(steps[4] - steps[8]) / np.abs(steps[8])
    assert change.max() < 1e-12
    # 3.3e-4 with a coefficient of 0.01: five substitutions leave (3.3e-4)^5
    assert 1e-4 < contraction.max() < 5e-4


def test_contraction_is_the_slope_of_the_substitution():
    state, gas = random_states(200, 1)
    made = compressor(machine(**OFFSET), coulomb_friction())

    def image(a):
        return substitution(made, state._replace(acceleration=a), gas, 0.25).acceleration

    # Differences: G is linear in a up to the curvature of the load magnitudes, 1e-6 of a step of 1.
    a = state.acceleration
    measured = np.abs(image(a + 1.0) - image(a - 1.0)) / 2
    given = substitution(made, state, gas, 0.25).contraction
    np.testing.assert_allclose(measured, given, atol=2e-5)
    assert given.max() < 2e-3  # the estimate mu R [...]/J_z gives 9e-4 for one margin of 0.9


def test_contacts_and_reactions_equal_the_printed_formulas():
    state, gas = random_states(200, 2)
    m = machine(offset=-2e-3, piston_centre_offset=-1.5e-3)
    made = compressor(m, coulomb_friction(0.2, 0.15))
    loads = loads_at(made, state, gas)
    assert loads.margin.min() > 0.1
    signs = (*kinematic_signs(state), *sides(loads))
    p = Printed(made, 0.2, 0.15, 4e-3 / 6e-6, state, gas, signs)
    f = loads.forces
    # rounding: loads up to 3 kN from arms that differ by a factor of four
    tight = dict(rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(f["wall_crown"][1], p.F1, **tight)
    np.testing.assert_allclose(f["wall_edge"][1], p.F2, **tight)
    np.testing.assert_allclose(f["link_slider"][0], p.N, **tight)
    np.testing.assert_allclose(f["piston_film"][0], p.film, **tight)
    np.testing.assert_allclose(f["crank_pin"], p.pin, **tight)
    np.testing.assert_allclose(f["upper_bearing"], p.upper, **tight)
    np.testing.assert_allclose(f["lower_bearing"], p.lower, **tight)
    # (33), (34): the torque of the pin in terms of acceleration, speed and gas force
    R, phi = m.crank_radius, state.angle
    torque = R * (f["crank_pin"][0] * np.sin(phi) - f["crank_pin"][1] * np.cos(phi))
    rest = -p.g4 * state.acceleration - p.g5 * state.speed**2 - p.g6 * p.G
    np.testing.assert_allclose(torque, rest, rtol=1e-10, atol=1e-11)
    # (35), with the pump in it
    moments = sum(
        loads.loss_torque[k]
        for k in ("crank_pin", "upper_bearing", "lower_bearing", "thrust_bearing", "pump")
    )
    expected = -(p.g5 * state.speed**2 - 0.25 + moments + p.g6 * p.G) / (p.g4 + p.Jz)
    got = substitution(made, state, gas, 0.25).acceleration
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-7)
    assert (p.g4 + p.Jz).min() > 0


def random_contacts(n, seed):
    """Contact problems far beyond real machines, both sliding directions each."""
    rng = np.random.default_rng(seed)
    phi = rng.uniform(0, 2 * np.pi, n)
    D, R, Ds = rng.uniform(0.01, 0.06, n), rng.uniform(0.004, 0.03, n), rng.uniform(0, 0.04, n)
    Lc = R * rng.uniform(2.05, 6, n)
    Lp = Lc * rng.uniform(0.9, 1.8, n)
    e, ecl = rng.uniform(-5e-3, 5e-3, n), rng.uniform(-4e-3, 4e-3, n)
    wall = rng.choice([-1, 1], n) * rng.uniform(0, 3, n) ** 2 / 3
    link = rng.choice([-1, 1], n) * rng.uniform(0, 0.3, n)
    Le = Lc - R * (1 - np.cos(phi))
    arms = ContactArms(Le, Lp, Lp - Le, e + R * np.sin(phi))
    inertia = rng.normal(size=n) * 300
    thrust = np.where(rng.random(n) < 0.3, 0.1, 1.0) * rng.normal(size=n) * 300
    weight = np.where(rng.random(n) < 0.5, 0.0, rng.normal(size=n) * 20)
    loads = PistonLoads(thrust, inertia * ecl, weight)
    return jax.tree.map(jnp.asarray, (D, Ds, arms, wall, link, loads))


def enumerate_sides(D, Ds, arms, wall, link, loads):
    """All consistent solutions of Eq. (10) by a linear solve for each of the eight combinations."""
    d3, d4, d5 = SIGNS[:, :, None]
    one = np.ones((8, wall.size))
    matrix = np.stack([
        np.stack([wall * d3, wall * d4, one]),
        np.stack([one, one, link * d5]),
        np.stack([(-arms.crown - wall * D / 2) * one, (-arms.edge - wall * D / 2) * one,
                  (arms.slider - link * Ds / 2) * one]),
    ])  # fmt: skip
    matrix = np.moveaxis(matrix, (0, 1), (-2, -1))
    right = np.stack([loads.thrust, -loads.weight, loads.moment], -1)
    right = np.broadcast_to(right, (8, *right.shape))
    answer = np.linalg.solve(matrix, right[..., None])[..., 0]
    good = np.all(answer * np.moveaxis(SIGNS, 0, -1)[:, None] >= 0, axis=-1)
    return np.linalg.det(matrix), answer, good


def test_explicit_sides_equal_enumeration():
    case = random_contacts(40_000, 3)
    got = contact(*case)
    determinant, answer, good = enumerate_sides(*jax.tree.map(np.asarray, case))
    free = np.asarray(got.margin) > 1e-6
    assert 0.3 < free.mean() < 0.95
    assert np.all(good[:, free].sum(axis=0) == 1)
    chosen = np.take_along_axis(answer, np.argmax(good, axis=0)[None, :, None], 0)[0]
    values = np.stack([got.crown, got.edge, got.slider], -1)
    size = np.abs(chosen).max(axis=-1, keepdims=True)
    # rounding of a 3x3 solve, magnified by 1/margin
    error = np.abs(values - chosen)[free] / size[free] * np.asarray(got.margin)[free, None]
    assert error.max() < 1e-11
    # all eight combinations occur
    assert np.all(good[:, free].any(axis=1))
    # the margin is the smallest determinant over L_e, so positive together with all of them
    slope = (determinant / np.asarray(case[2].engaged)).min(axis=0)
    opposite_sides = np.asarray(got.margin) < slope + 1e-12
    assert opposite_sides.all()
    assert np.all(determinant[:, free] > 0)


def test_contact_forces_are_continuous_across_every_switch():
    case = random_contacts(200, 4)
    margin = np.asarray(contact(*case).margin)
    free = margin > 0.1
    D, Ds, arms, wall, link, loads = jax.tree.map(lambda x: x[free], case)
    thrust, step = np.linspace(-1500, 1500, 6001, retstep=True)

    @jax.jit
    def at(q):
        load = loads._replace(thrust=jnp.broadcast_to(q, wall.shape))
        return jnp.stack(contact(D, Ds, arms, wall, link, load)[:3])

    forces = np.asarray(jax.vmap(at)(jnp.asarray(thrust)))
    assert np.unique(np.sign(np.moveaxis(forces, 1, -1)).reshape(-1, 3), axis=0).shape[0] == 8
    # On every piece |dN/dQ| <= 1/margin, |dF/dQ| <= |alpha|/margin with mu_c |alpha| <= 1 - margin;
    # a jump at a switch would not shrink with the step. Rounding of forces up to 1e4 N is 1e-11.
    steepest = np.maximum(1, (1 - margin[free]) / np.abs(wall)) / margin[free]
    assert np.all(np.abs(np.diff(forces, axis=0)).max(axis=(0, 1)) <= step * steepest + 1e-10)


@pytest.mark.parametrize(
    ("mu_c", "gas", "expected"),
    [
        (0.30, 200.0, []),
        (0.30, -50.0, [-47.9, 3322.0]),
        (0.20, 200.0, [642.7]),
        (0.20, -50.0, [-49.0]),
    ],
)
def test_wedging_of_a_short_cylinder_is_reported(mu_c, gas, expected):
    """Self-locking leaves no or two solutions; the margin says so, the enumeration shows it."""
    m = machine(cylinder_length=0.022, crown_to_link=0.036, piston_mass=0.0)
    arms = jax.tree.map(lambda x: x[None], contact_arms(m, jnp.asarray(3.6)))
    wall, link = jnp.array([-mu_c]), jnp.array([-0.1])  # d1 = d2 = -1 at phi = 3.6
    loads = PistonLoads(jnp.array([gas]), jnp.zeros(1), jnp.zeros(1))
    case = (m.bore, m.slider_diameter, arms, wall, link, loads)
    _, answer, good = enumerate_sides(*jax.tree.map(np.asarray, case))
    found = sorted(answer[good][:, 2])
    np.testing.assert_allclose(found, expected, rtol=2e-3)  # four digits given
    got = contact(*case)
    assert (got.margin[0] > 0) == (mu_c < 0.25)
    assert np.all(np.isfinite(np.stack(got)))
    if mu_c < 0.25:
        np.testing.assert_allclose(got.slider, expected, rtol=2e-3)


@pytest.mark.parametrize(
    ("changes", "mu_s", "limit"),
    [
        ({}, 0.015, 1.06),
        ({}, 0.1, 0.70),
        ({}, 0.3, 0.38),
        (dict(cylinder_length=0.022, crown_to_link=0.036), 0.015, 0.37),
        (dict(cylinder_length=0.022, crown_to_link=0.036), 0.1, 0.21),
    ],
)
def test_friction_at_which_the_piston_locks(changes, mu_s, limit):
    m = machine(**changes)
    angle = jnp.linspace(0, 2 * np.pi, 2001)
    state = CrankState(angle, jnp.full(2001, 300.0), jnp.zeros(2001))

    def margin(mu_c):
        friction = coulomb_friction(mu_c, mu_s)
        return float(joint_loads(m, friction, state, jnp.zeros(2001)).margin.min())

    # the limits are given with two digits
    assert margin(limit - 0.006) > 0 > margin(limit + 0.006)


def test_reports_nothing_left_of_the_balances():
    state, gas = random_states(200, 5)
    for reading in ("paper", "balanced"):
        friction = coulomb_friction(0.2, 0.1, slider_moment=reading)
        loads = joint_loads(machine(**OFFSET), friction, state, gas, jnp.array([3.0, -9.0]))
        assert loads.residual.max() < 1e-14
    # wedged: the forces do not solve the balances, and the residual says that as well
    short = machine(cylinder_length=0.0195, crown_to_link=0.036)
    loads = joint_loads(short, coulomb_friction(0.9, 0.3), state, gas)
    wedged = loads.margin < 0
    assert wedged.any()
    assert loads.residual[wedged].max() > 1e-3
    assert loads.residual[~wedged].max() < 1e-13
    assert np.all(np.isfinite(loads.total_loss_torque))


def test_piston_kinematics_equal_their_derivatives():
    m = machine()
    angle = jnp.linspace(-1, 7, 50)
    x, x_1, x_2 = m.piston(angle)
    one = jnp.ones_like(angle)
    np.testing.assert_allclose(x, m.crown_to_link + m.crank_radius * np.cos(angle), rtol=1e-15)
    np.testing.assert_allclose(x_1, jax.jvp(lambda a: m.piston(a)[0], (angle,), (one,))[1])
    np.testing.assert_allclose(x_2, jax.jvp(lambda a: m.piston(a)[1], (angle,), (one,))[1])
    j, j_1 = m.inertia(angle)
    np.testing.assert_allclose(
        j_1, jax.jvp(lambda a: m.inertia(a)[0], (angle,), (one,))[1], atol=1e-20
    )
    energy = m.slider_mass * m.crank_radius**2 + m.piston_mass * x_1**2
    np.testing.assert_allclose(j, energy, rtol=1e-14)
    whole = instants(compressor(m), angle)
    np.testing.assert_allclose(whole.inertia, 4.5e-4 + energy, rtol=1e-14)
    np.testing.assert_array_equal(whole.inertia_1, j_1)


def test_angle_at_inverts_the_piston_position():
    m = machine()
    position = jnp.linspace(*m.piston_extremes(), 41)
    for inward in (True, False):
        angle = m.angle_at(position, inward)
        np.testing.assert_allclose(m.piston(angle)[0], position, rtol=1e-14)
        assert np.all(np.sin(angle[1:-1]) < 0) == inward
        slope = jax.vmap(jax.grad(lambda p, i=inward: m.angle_at(p, i)))(position)
        assert np.all(np.isfinite(slope))  # also at the dead centres


def test_swept_volume_of_the_eight_cubic_centimetre_machine():
    np.testing.assert_allclose(machine().swept_volume, 7.98e-6, rtol=1e-3)  # three digits given


def test_refuses_a_piston_that_leaves_its_cylinder():
    with pytest.raises(BadInput, match="cylinder_length > 2 crank_radius"):
        machine(cylinder_length=0.019)


def test_refuses_the_friction_of_another_mechanism():
    state, gas = random_states(2)
    with pytest.raises(TypeError, match="SliderLinkFriction"):
        joint_loads(machine(), SliderCrankFriction(), state, gas)


def test_refuses_an_unknown_reading_of_the_slider_moment():
    with pytest.raises(ValueError, match="balanced"):
        SliderLinkFriction(slider_moment="printed")
