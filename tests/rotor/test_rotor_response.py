"""Harmonic response: laws that hold for every model, and the two solvers against each other."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rotor_machine import FREQUENCY, SPEED, loads, machine, random_force

from jaxcomp import BadInput
from jaxcomp.rotor import (
    Disks,
    Link,
    ModalDamping,
    PeriodicForce,
    PointMasses,
    RotorModel,
    SpeedTable,
    damped_modes,
    diagonal,
    harmonic_response,
    isotropic,
    matrices,
    node_index,
    orbit,
    receptance,
    relative_displacement,
    respond,
    shaft_line,
    transmitted_forces,
    undamped_modes,
)
from jaxcomp.rotor._layout import layout_of
from jaxcomp.rotor._loads import load_vector, nodal_load
from jaxcomp.rotor._modes import magnetic_pull_limit
from jaxcomp.rotor._nodes import node_names
from jaxcomp.rotor._response import SingularResponse

NODES = len(node_names(machine()))


def both(model, force, spin=SPEED, w=FREQUENCY):
    return [harmonic_response(model, force, spin, w, solver=s) for s in ("structured", "dense")]


def assert_same(model, force, spin=SPEED, w=FREQUENCY, tolerance=1e-10):
    a, b = (r.checked().displacement for r in both(model, force, spin, w))
    # Each axis of the nodes on its own scale: metres and radians, rotor and housing.
    for axis in range(model.dof):
        np.testing.assert_allclose(
            a[:, axis], b[:, axis], atol=tolerance * float(jnp.abs(b[:, axis]).max())
        )


def scaled(where, factor, model=None):
    model = machine() if model is None else model
    return eqx.tree_at(where, model, where(model) * factor)


def with_damping(factor):
    """The machine with symmetric bearings and all its damping scaled."""
    where = lambda m: [  # noqa: E731
        *(link.law.damping for link in m.links),
        m.damping.mass_factor,
        m.damping.stiffness_factor,
    ]
    model = machine(symmetric=True)
    return eqx.tree_at(where, model, [factor * a for a in where(model)])


# Stiffness of the model as it is: mounts 2e4, shaft 1e9, bearings 3e7 N/m.
HARD = {
    "plain": lambda: machine(),
    "stiff piece of shaft": lambda: scaled(
        lambda m: m.shafts[0].young_modulus, jnp.array([1, 1, 1, 1e5, 1, 1, 1, 1])
    ),
    "soft piece of shaft": lambda: scaled(
        lambda m: m.shafts[0].young_modulus, jnp.array([1, 1, 1, 1, 1, 1, 1e-6, 1])
    ),
    "stiff bearing": lambda: scaled(lambda m: m.links[1].law.stiffness, 1e7),
    "soft mounts": lambda: scaled(lambda m: m.links[4].law.stiffness, 1e-6),
    "all massless": lambda: scaled(lambda m: m.shafts[0].density, 0.0),
    "magnetic pull near its limit": lambda: scaled(
        lambda m: m.magnetic_pulls[0].stiffness, 0.9999 * float(magnetic_pull_limit(machine()))
    ),
}


@pytest.mark.parametrize("case", HARD)
def test_structured_and_dense_solver_agree(case):
    w = 1e-3 if "limit" in case else FREQUENCY  # the static limit is met at low frequency
    # Required: ten digits whatever the stiffness ratio.
    assert_same(HARD[case](), random_force((NODES, 4)), w=w)


def test_solvers_agree_at_a_resonance_with_small_damping():
    model = with_damping(1e-5)
    for lam in damped_modes(model, SPEED, 8).eigenvalue[jnp.array([0, 4, 7])]:
        assert -lam.real / lam.imag < 1e-5
        assert_same(model, random_force((NODES, 4)), w=float(lam.imag))


def test_solvers_agree_with_six_degrees_of_freedom():
    assert_same(machine(6), random_force((NODES, 6)))


def test_product_and_matrices_are_one_model():
    model, w = machine(), FREQUENCY
    full, active = matrices(model, SPEED), layout_of(model).active
    x = random_force((full.mass.shape[0],), 3)
    c = full.damping + SPEED * full.gyroscopic
    f = full.stiffness @ x - w**2 * (full.mass @ x) + 1j * w * (c @ x)
    load = jnp.zeros((NODES, 4), complex).at[active].set(f)
    found = harmonic_response(model, load, SPEED, w).checked().displacement
    # Both are assembled from the same elements; the solution has a condition of 1e6.
    np.testing.assert_allclose(found[active], x, atol=1e-9 * float(jnp.abs(x).max()))
    # Slaved nodes follow by the full matrices' own rows.
    np.testing.assert_allclose(found.reshape(-1), full.expand @ found[active], rtol=1e-12)


def test_reciprocity_static_and_dynamic():
    # Symmetric K and C: the receptance of the model spinning one way is the transpose of that
    # spinning the other way; at rest it is symmetric.
    model = machine(symmetric=True)
    table = model.links[0].law  # the same at both senses of rotation
    model = eqx.tree_at(lambda m: m.links[0].law.stiffness, model, table.stiffness[:1].repeat(4, 0))
    model = eqx.tree_at(lambda m: m.links[0].law.damping, model, table.damping[:1].repeat(4, 0))
    a = jnp.stack([nodal_load(model, n, axis) for n, axis in ((3, "ux"), ("h3", "uy"), (9, "thy"))])
    for spin, w in ((0.0, 0.0), (0.0, FREQUENCY), (SPEED, FREQUENCY)):
        there = receptance(model, a, a.real, spin, w)
        back = receptance(model, a, a.real, -spin, w)
        own = np.sqrt(np.abs(np.diag(there)))
        # Rounding times the condition of the model, 1e6, on the scale of both coordinates.
        np.testing.assert_allclose(
            there / np.outer(own, own), back.T / np.outer(own, own), atol=1e-10
        )
    # The gyroscopic effect is there to be seen.
    assert np.abs(there - there.T).max() > 1e-6 * np.abs(there).max()


@pytest.mark.parametrize("dof", [4, 6])
def test_power_put_in_is_dissipated(dof):
    model = machine(dof)
    force = random_force((NODES, dof), 1)
    x = harmonic_response(model, force, SPEED, FREQUENCY).checked().displacement
    full, active = matrices(model, SPEED), layout_of(model).active
    own, skew = x[active], full.stiffness - full.stiffness.T
    # Work of the forces in a cycle is pi Im(conj(X) . F); the damping takes pi w X* C X, and the
    # cross-coupled stiffness of the bearings, which is no spring, pi Im(X* K X).
    given = np.pi * jnp.sum(jnp.conj(x) * force).imag
    lost = np.pi * FREQUENCY * (jnp.conj(own) @ full.damping @ own).real
    circulated = np.pi * (jnp.conj(own) @ skew @ own / 2).imag
    assert float(given) == pytest.approx(float(lost + circulated), rel=1e-10)
    assert abs(circulated) > 1e-4 * lost


def turned_by_a_right_angle(model):
    """The machine seen from a frame turned by +90 degrees about z, for isotropic links."""
    turn = jnp.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    where = lambda m: [m.bodies[0].arm, m.bodies[0].inertia]  # noqa: E731
    arm, inertia = where(model)
    return eqx.tree_at(where, model, [arm @ turn.T, turn @ inertia @ turn.T])


def test_isotropic_model_does_not_know_its_frame():
    # Bearings with k_xx = k_yy and k_xy = -k_yx, mounts alike in x and y: turning bodies and loads
    # turns the response.
    k = jnp.array([[3e7, 4e6], [-4e6, 3e7]])
    c = jnp.array([[4e3, 300.0], [-300.0, 4e3]])
    six = lambda a, b: jnp.diag(jnp.array([a, a, a, b, b, b]))  # noqa: E731
    model = machine()
    laws = lambda m: [  # noqa: E731
        *(a for n in (0, 1) for a in (m.links[n].law.stiffness, m.links[n].law.damping)),
        *(a for n in (2, 3, 4) for a in (m.links[n].law.stiffness, m.links[n].law.damping)),
        *(a for n in (6,) for a in (m.links[n].law.stiffness, m.links[n].law.damping)),
    ]
    zero = jnp.zeros((3, 3))
    model = eqx.tree_at(
        laws, model,
        [jnp.stack([k] * 4), jnp.stack([c] * 4), k, c] + [six(3e5, 200.0), six(30.0, 0.1)] * 3
        + [zero, zero],
    )  # fmt: skip
    force = random_force((NODES, 4), 5)
    turn = jnp.array([[0.0, 1.0], [-1.0, 0.0]])
    by = lambda v: jnp.concatenate([v[:, :2] @ turn.T, v[:, 2:] @ turn.T], 1)  # noqa: E731
    x = harmonic_response(model, force, SPEED, FREQUENCY).checked().displacement
    y = harmonic_response(turned_by_a_right_angle(model), by(force), SPEED, FREQUENCY)
    # Rounding times the condition of the model, 1e6, at most.
    np.testing.assert_allclose(y.displacement, by(x), atol=1e-10 * float(jnp.abs(x).max()))
    other = harmonic_response(model, by(force), SPEED, FREQUENCY).displacement
    assert np.abs(other - by(x)).max() > 1e-3 * np.abs(x).max()  # the bodies do have directions


def test_softly_hung_machine_moves_like_a_free_mass():
    # The mass times acceleration of everything together balances the load as the mounts soften.
    gaps = []
    for softness in (1e-2, 1e-4):
        model = machine(symmetric=True, tilt=False)
        mounts = lambda m: [  # noqa: E731
            a for n in (4, 5) for a in (m.links[n].law.stiffness, m.links[n].law.damping)
        ]
        model = eqx.tree_at(mounts, model, [softness * a for a in mounts(model)])
        model = scaled(lambda m: m.damping.mass_factor, 0.0, model)
        force = nodal_load(model, "head", "ux", 10.0)
        w = 60.0
        x = harmonic_response(model, force, 0.0, w).checked().displacement
        full, active = matrices(model, 0.0), layout_of(model).active
        along = np.zeros((NODES, 4))
        along[:, 0] = 1.0  # a rigid shift in x
        momentum = along[active] @ np.asarray(full.mass) @ np.asarray(x[active])
        gaps.append(abs(-(w**2) * momentum / 10.0 - 1))
    # Momentum theorem: what is missing is the mount force, proportional to its stiffness.
    assert gaps[1] < 3e-4
    assert gaps[1] == pytest.approx(gaps[0] / 100, rel=0.2)


def test_force_pairs_leave_no_net_load():
    model = machine()
    _, gas = loads()
    for order in gas.orders:
        f = load_vector(model, (gas,), order, jnp.asarray(SPEED))
        np.testing.assert_allclose(jnp.sum(f, 0)[:2], 0.0, atol=1e-9)  # of 2000 N
        assert float(jnp.abs(f).max()) > 500
    assert not np.any(load_vector(model, (gas,), 3, jnp.asarray(SPEED)))


def test_reaction_carries_the_moment_of_its_arm():
    model = machine(6)
    pair = PeriodicForce("h1", "h3", (1,), [[0, 0, 7.0]], [[0.0] * 3], arm=[0.2, 0, 0])
    f = load_vector(model, (pair,), 1, jnp.asarray(1.0))
    # r x F = (0.2, 0, 0) x (0, 0, 7) = (0, -1.4, 0), with the opposite sign on the reaction.
    np.testing.assert_allclose(f[node_index(model, "h3")], [0, 0, -7, 0, 1.4, 0], atol=1e-15)


def test_lateral_response_is_the_same_with_four_and_six_degrees():
    # Bodies on the axis and links without axial-lateral coupling.
    four, six = (machine(d, symmetric=True, tilt=False) for d in (4, 6))
    arm = four.bodies[0].arm.at[:, :2].set(0.0)
    four, six = (eqx.tree_at(lambda m: m.bodies[0].arm, m, arm) for m in (four, six))
    force = random_force((NODES, 4), 2)
    lateral = np.array([0, 1, 3, 4])
    wide = jnp.zeros((NODES, 6), complex).at[:, lateral].set(force)
    a = harmonic_response(four, force, SPEED, FREQUENCY).checked().displacement
    b = harmonic_response(six, wide, SPEED, FREQUENCY).checked().displacement
    np.testing.assert_allclose(b[:, lateral], a, atol=1e-11 * float(jnp.abs(a).max()))
    assert not np.any(b[:, [2, 5]])


def test_spin_and_excitation_are_independent():
    model, force = machine(), random_force((NODES, 4))
    at = lambda spin, w: harmonic_response(model, force, spin, w).displacement  # noqa: E731
    base = at(SPEED, FREQUENCY)
    for other in (at(SPEED * 1.3, FREQUENCY), at(SPEED, FREQUENCY * 1.3)):
        assert np.abs(other - base)[2].max() > 1e-3 * np.abs(base)[2].max()  # the disk at node 3
    # Order 2 of `respond` takes the bearings and gyroscopic terms at W and the inertia at 2 W.
    r = respond(model, loads(), jnp.array([SPEED]), (1, 2))
    f = load_vector(model, loads(), 2, jnp.asarray(SPEED))
    one = harmonic_response(model, f, SPEED, 2 * SPEED).displacement
    np.testing.assert_allclose(r.displacement[1, 0], one, atol=1e-12 * float(jnp.abs(one).max()))


@pytest.mark.parametrize("kind", ["linear", "monotone"])
def test_tables_hold_at_their_own_points(kind):
    rng = np.random.default_rng(2)
    speeds = np.sort(rng.uniform(10, 900, 9))
    table = SpeedTable(speeds, rng.normal(size=(9, 2, 2)), rng.normal(size=(9, 2, 2)), kind)
    for i, speed in enumerate(speeds):
        k, c = table.coefficients(jnp.asarray(speed))
        # To the last bit.
        np.testing.assert_array_equal(k, table.stiffness[i])
        np.testing.assert_array_equal(c, table.damping[i])
    # The end values hold outside, and nothing overshoots between two points.
    np.testing.assert_array_equal(table.coefficients(1e4)[0], table.stiffness[-1])
    fine = jax.vmap(table.coefficients)(jnp.linspace(speeds[3], speeds[4], 50))[0]
    low, high = np.sort(np.asarray(table.stiffness[3:5]), 0)
    assert np.all((fine >= low - 1e-15) & (fine <= high + 1e-15))


@pytest.mark.slow
def test_batches_equal_single_speeds():
    model, speeds = machine(), jnp.linspace(50.0, 700.0, 7)
    many = respond(model, loads(), speeds, (1, 2), batch_size=3).checked()
    assert many.displacement.shape == (2, 7, NODES, 4)
    f = load_vector(model, loads(), 1, speeds[4])
    one = harmonic_response(model, f, speeds[4], speeds[4]).displacement
    np.testing.assert_allclose(many.displacement[0, 4], one, atol=1e-12 * float(jnp.abs(one).max()))
    np.testing.assert_allclose(many.velocity[1, 2], 2j * speeds[2] * many.displacement[1, 2])
    np.testing.assert_allclose(
        many.acceleration[1, 2], -4 * speeds[2] ** 2 * many.displacement[1, 2]
    )
    relative = relative_displacement(model, many, 8, "c8")
    assert relative.shape == (2, 7, 4)
    pushed = transmitted_forces(model, many)[:, :, 1]
    k, c = model.links[1].law.stiffness, model.links[1].law.damping
    w = many.frequency[..., None, None]
    law = jnp.einsum("osij,osj->osi", k + 1j * w * c, relative[..., :2])
    np.testing.assert_allclose(pushed[..., :2], law, rtol=1e-9)


def jeffcott(frequency=50.0, damping=0.0):
    return RotorModel(
        masses=(PointMasses(("m",), [2.0]),),
        links=(Link(("m", None), isotropic(2.0 * frequency**2, damping)),),
    )


@pytest.mark.slow
def test_modal_damping_is_that_of_its_modes():
    # Three lowest modes with their own ratios, the others without; at rest, on springs.
    shaft = shaft_line(
        (1, 2, 3), length=0.2, outer_diameter=0.02, young_modulus=2e11, density=7800.0, poisson=0.3
    )
    links = (Link((1, None), isotropic(1e5)), Link((3, None), diagonal([2e5, 3e5], [0.0, 0.0])))
    ratio = jnp.array([0.02, 0.05, 0.01])
    model = RotorModel(
        (shaft,), (Disks((2,), [1.0], [1e-3], [0.0]),), links=links, damping=ModalDamping(ratio)
    )
    modes = undamped_modes(model, 6)
    damped = damped_modes(model, 0.0, 6)
    order = jnp.argsort(jnp.abs(damped.eigenvalue))
    # lambda = w (-zeta + i sqrt(1 - zeta^2)), exact for orthogonal modes.
    np.testing.assert_allclose(jnp.abs(damped.eigenvalue)[order], modes.frequency, rtol=1e-9)
    expected = jnp.concatenate([ratio, jnp.zeros(3)])
    np.testing.assert_allclose(damped.damping_ratio[order], expected, atol=1e-9)
    # Response by superposition of the modes, at the second resonance.
    w, force = float(modes.frequency[1]), random_force((3, 4))
    every = undamped_modes(model, 12)
    size = jnp.sum(every.shape * force[None], (1, 2))
    zeta = jnp.concatenate([ratio, jnp.zeros(9)])
    gain = size / (every.square - w**2 + 2j * zeta * every.frequency * w)
    x = harmonic_response(model, force, 0.0, w).checked().displacement
    exact = jnp.einsum("m,mnd->nd", gain, every.shape)
    # Rounding times the condition of the eigenvectors, 1e5.
    np.testing.assert_allclose(x, exact, atol=1e-9 * float(jnp.abs(exact).max()))


def test_singular_response_is_a_word():
    model = jeffcott()
    force = jnp.array([[1.0, 0, 0, 0]], complex)
    w = jnp.array([30.0, 50.0, 60.0])
    for solver in ("structured", "dense"):
        r = jax.vmap(
            lambda w, s=solver: harmonic_response(model, force, 0.0, w, solver=s)
        )(w)  # fmt: skip
        assert r.words[0] == r.words[2] == "ok"
        assert r.words[1] in ("singular", "not finite")
        # One bad frequency does not spoil its neighbours: F/(k - m w^2).
        np.testing.assert_allclose(
            r.displacement[np.array([0, 2]), 0, 0], [1 / 3200, -1 / 2200], rtol=1e-13
        )
        with pytest.raises(SingularResponse, match="1 of 3 frequencies, first at 50"):
            r.checked()


def test_nearly_singular_response_is_flagged_and_a_damped_one_is_not():
    undamped, force = with_damping(0.0), random_force((NODES, 4))
    w = float(damped_modes(undamped, SPEED, 8).frequency[1])
    assert harmonic_response(undamped, force, SPEED, w).words != "ok"
    assert harmonic_response(machine(), force, SPEED, w).words == "ok"


def test_nan_is_a_word_and_unheld_parts_are_singular():
    bad = scaled(lambda m: m.shafts[0].length, jnp.nan)
    r = harmonic_response(bad, random_force((NODES, 4)), SPEED, FREQUENCY)
    assert r.words == "not finite"
    assert not np.any(np.nan_to_num(r.displacement, nan=1.0) == 0)
    # Static load on a model that nothing holds.
    loose = eqx.tree_at(
        lambda m: [m.links[4].law.stiffness, m.links[5].law.stiffness],
        machine(),
        [jnp.zeros((6, 6)), jnp.zeros((3, 3))],
    )
    assert harmonic_response(loose, random_force((NODES, 4)), SPEED, 0.0).words != "ok"


def test_bad_calls_are_named():
    model = machine()
    with pytest.raises(BadInput, match="frequency"):
        harmonic_response(model, random_force((NODES, 4)), SPEED, np.nan)
    with pytest.raises(BadInput, match="force"):
        harmonic_response(model, random_force((3, 4)), SPEED, FREQUENCY)
    with pytest.raises(BadInput, match="spin_speeds"):
        respond(model, loads(), jnp.array([1.0, np.inf]))
    with pytest.raises(BadInput, match="solver"):
        harmonic_response(model, random_force((NODES, 4)), SPEED, FREQUENCY, solver="fast")
    with pytest.raises(BadInput, match="node"):
        respond(model, loads(), jnp.array([1.0]), nodes=("nowhere",))
    with pytest.raises(BadInput, match="increasing"):
        SpeedTable([2.0, 1.0], np.zeros((2, 2, 2)), np.zeros((2, 2, 2)))


@pytest.mark.parametrize(
    ("x", "y", "major", "minor", "angle"),
    [
        (1.0, -1j, 1.0, 1.0, None),  # forward circle
        (1.0, 1j, 1.0, -1.0, None),  # backward circle
        (2.0, -1j, 2.0, 1.0, 0.0),
        (1j, 2.0 * 1j, np.sqrt(5), 0.0, np.arctan2(2, 1)),  # a line
    ],
)
def test_orbits(x, y, major, minor, angle):
    o = orbit(jnp.asarray(x + 0j), jnp.asarray(y + 0j))
    assert float(o.major) == pytest.approx(major, rel=1e-14)
    assert float(o.minor) == pytest.approx(minor, abs=1e-14)
    if angle is not None:
        assert float(o.inclination) == pytest.approx(angle, abs=1e-14)


@pytest.mark.slow
def test_rings_branches_and_loops_are_solved():
    # A ring of elements, a branch, two parallel elements, and a run that returns to its own node.
    from jaxcomp.rotor import ShaftElements

    pairs = ((0, 1), (1, 2), (2, 3), (3, 0), (1, 4), (4, 5), (4, 5), (6, 7), (7, 8), (8, 6))
    n = len(pairs)
    length = np.linspace(0.1, 0.2, n)
    length[6] = length[5]  # the parallel elements join the same nodes
    shaft = ShaftElements(pairs, length, [0.03] * n, [2e11] * n, [7800.0] * n, [0.3] * n)
    links = (Link((5, 6), isotropic(1e6, 10.0)), Link((8, None), isotropic(1e6, 5.0)))
    model = RotorModel((shaft,), (Disks((2,), [1.0], [1e-3], [2e-3]),), links=links)
    assert_same(model, random_force((9, 4)))
