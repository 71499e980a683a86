"""Limiting cases, identities and gradients of the slider-link machine at given instants."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from mechanism.test_slider_link import (
    OFFSET,
    Printed,
    bearings,
    compressor,
    coulomb_friction,
    crankshaft,
    eager_joint_loads,
    eager_loads_at,
    instants,
    joint_loads,
    kinematic_signs,
    loads_at,
    machine,
    random_states,
    sides,
    substitute,
)

from jaxcomp.film import JournalBearing
from jaxcomp.friction import (
    CoulombJournal,
    RegularisedJournal,
    RegularisedSlide,
    SliderLinkFriction,
)
from jaxcomp.mechanism import CrankState
from jaxcomp.mechanism._slider_link import contact_arms

READINGS = ["paper", "balanced"]


def film_journal(diameter, length, film="fit"):
    return JournalBearing(diameter, length, 9e-6, 4e-3, film=film)


def film_friction(**changes):
    return coulomb_friction(crank_pin=film_journal(0.012, 0.016), **changes)


def film_bearings(**changes):
    films = film_journal(0.016, 0.022), film_journal(0.016, 0.016)
    return bearings(bearings=films, **changes)


def on_films(linkage, friction):
    return compressor(linkage, friction, crankshaft(main_journal=film_bearings()))


def test_frictionless_contacts():
    """N = Q and F_1 = -F_2 = (N h - X e_cl)/L_e."""
    m = machine(**OFFSET)
    state, gas = random_states(200, 20)
    loads = joint_loads(m, None, state, gas)
    xdd = -m.crank_radius * (
        state.speed**2 * np.cos(state.angle) + state.acceleration * np.sin(state.angle)
    )
    q, arms = gas + m.piston_mass * xdd, contact_arms(m, state.angle)
    f = loads.forces
    np.testing.assert_allclose(f["link_slider"][0], q, rtol=1e-12)
    f1 = (q * arms.slider - m.piston_mass * xdd * m.piston_centre_offset) / arms.engaged
    np.testing.assert_allclose(f["wall_crown"][1], f1, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(f["wall_edge"][1], -f1, rtol=1e-11, atol=1e-11)
    assert not loads.loss_torque
    assert np.all(loads.total_loss_torque == 0)
    assert np.all(loads.margin == 1)


@pytest.mark.parametrize("reading", READINGS)
def test_frictionless_power_is_the_rate_of_kinetic_energy(reading):
    """No losses at all: gas and motor power equal d/dt of the kinetic energy of the parts."""
    m = machine(offset=-2e-3)
    state, gas = random_states(200, 21)
    shaft = crankshaft(main_journal=None)
    made = compressor(m, SliderLinkFriction(slider_moment=reading), shaft)
    (a,), _ = substitute(made, state, gas, 0.25, 1)

    def kinetic(angle, speed):
        R = m.crank_radius
        pin = shaft.inertia + m.slider_mass * R**2 + m.piston_mass * (R * jnp.sin(angle)) ** 2
        return 0.5 * pin * speed**2

    rate = jax.jvp(kinetic, (state.angle, state.speed), (state.speed, a))[1]
    power = 0.25 * state.speed - gas * m.piston(state.angle)[1] * state.speed
    np.testing.assert_allclose(rate, power, rtol=1e-11, atol=1e-10)


def test_symmetry_about_the_dead_centres():
    """e = e_cl = 0 without friction at constant speed: N even, F_1 and F_2 odd."""
    angle = jnp.linspace(0.1, 3.0, 30)
    gas, still = jnp.full(30, 120.0), jnp.zeros(30)
    there, back = (
        joint_loads(machine(), None, CrankState(a, jnp.full(30, 300.0), still), gas).forces
        for a in (angle, -angle)
    )
    np.testing.assert_allclose(there["link_slider"][0], back["link_slider"][0], rtol=1e-14)
    for name in ("wall_crown", "wall_edge"):
        np.testing.assert_allclose(there[name][1], -back[name][1], rtol=1e-13)


def test_massless_slider():
    """The pin carries what the slider gives to the link."""
    state, gas = random_states(200, 22)
    loads = joint_loads(machine(slider_mass=0.0, **OFFSET), coulomb_friction(), state, gas)
    np.testing.assert_array_equal(loads.forces["crank_pin"], loads.forces["link_slider"])
    _, d2 = kinematic_signs(state)
    n, across = loads.forces["link_slider"]
    np.testing.assert_allclose(across, d2 * 0.1 * np.abs(n), rtol=1e-14)


def test_massless_piston_leaves_n_to_the_gas():
    state, gas = random_states(200, 23)
    m = machine(piston_mass=0.0, **OFFSET)
    n = [
        joint_loads(m, coulomb_friction(), state._replace(acceleration=a + 0 * gas), gas).forces[
            "link_slider"
        ][0]
        for a in (-3000.0, 3000.0)
    ]
    np.testing.assert_array_equal(*n)
    # g_4 of (34) is then m_s R^2, which is what (35) adds to J_z
    signs = (*kinematic_signs(state), *sides(joint_loads(m, coulomb_friction(), state, gas)))
    printed = Printed(compressor(m), 0.1, 0.1, 0.0, state, gas, signs)
    np.testing.assert_allclose(printed.g4, m.slider_mass * m.crank_radius**2, rtol=1e-14)


def test_sides_without_offset_of_the_piston():
    """e_cl = 0: d5 = sgn Q, d3 = sgn(alpha_1 Q), d4 = -sgn(alpha_2 Q)."""
    m, friction = machine(offset=-1e-3), coulomb_friction(0.1, 0.15, piston_film=None)
    state, gas = random_states(200, 24)
    loads = joint_loads(m, friction, state, gas)
    xdd = m.crank_radius * -(
        state.speed**2 * np.cos(state.angle) + state.acceleration * np.sin(state.angle)
    )
    q = gas + m.piston_mass * xdd
    d1, d2 = kinematic_signs(state)
    d5 = np.sign(q)
    arms = contact_arms(m, state.angle)

    def alpha(arm):
        across = d5 * (arm + d1 * 0.1 * m.bore / 2) - m.slider_diameter / 2
        return (arms.slider + d2 * 0.15 * across) / arms.engaged

    expected = np.sign(alpha(arms.edge) * q), -np.sign(alpha(arms.crown) * q), d5
    np.testing.assert_array_equal(np.stack(sides(loads)), np.stack(expected))


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize(
    ("friction", "support"), [(coulomb_friction, bearings), (film_friction, film_bearings)]
)
def test_power_identity(friction, support, reading):
    """Motor and gas power less losses, written with magnitudes, change the kinetic energy."""
    m = machine(offset=-2e-3, piston_centre_offset=-1e-3)
    law = friction(mu_c=0.2, mu_s=0.15, slider_moment=reading)
    made = compressor(m, law, crankshaft(main_journal=support()))
    state, gas = random_states(200, 25)
    loads = loads_at(made, state, gas)
    f, loss = loads.forces, loads.loss_torque
    w, R = state.speed, m.crank_radius
    # The torque of the motor from the shaft's own balance (29), not from the reduced inertia
    drag = sum(v for k, v in loss.items() if k not in ("wall", "piston_film", "link_slider"))
    on_shaft = R * (
        f["crank_pin"][0] * np.sin(state.angle) - f["crank_pin"][1] * np.cos(state.angle)
    )
    motor = made.crankshaft.inertia * state.acceleration + drag - on_shaft

    xd, yd = m.piston(state.angle)[1] * w, R * np.cos(state.angle) * w
    length = contact_arms(m, state.angle).engaged
    film = 4e-3 * np.pi * m.bore * length * xd**2 / 6e-6
    wall = 0.2 * (abs(f["wall_crown"][1]) + abs(f["wall_edge"][1])) * abs(xd)
    link = 0.15 * abs(f["link_slider"][0]) * abs(yd)
    whole = instants(made, state.angle)
    kinetic = (whole.inertia * state.acceleration + 0.5 * whole.inertia_1 * w**2) * w
    terms = np.stack([motor * w, -gas * xd, -film, -wall, -link, -drag * w, -kinetic])
    # rounding: 1e-15 of the largest term
    assert np.abs(terms.sum(axis=0) / np.abs(terms).max(axis=0)).max() < 2e-14
    for name, value in (("piston_film", film), ("wall", wall), ("link_slider", link)):
        np.testing.assert_allclose(loss[name] * w, value, rtol=1e-12, atol=1e-12)
        assert np.all(value >= 0)
    assert np.all(np.stack(list(loss.values())) >= 0)


def test_balanced_slider_carries_the_moment_of_the_pin():
    """Without link friction and pin moment both readings agree; with them the walls differ."""
    state, gas = random_states(200, 26)
    m = machine(**OFFSET)

    def crown(reading, **laws):
        friction = coulomb_friction(0.1, slider_moment=reading, **laws)
        return np.asarray(joint_loads(m, friction, state, gas).forces["wall_crown"][1])

    bare = dict(link_slider=None, crank_pin=None)
    np.testing.assert_array_equal(crown("paper", **bare), crown("balanced", **bare))
    with_pin = dict(link_slider=None, crank_pin=CoulombJournal(0.05, 0.012))
    pin = joint_loads(m, coulomb_friction(0.1, **with_pin), state, gas).loss_torque["crank_pin"]
    shift = np.abs(crown("balanced", **with_pin) - crown("paper", **with_pin))
    # -M_k/L_e at the crown, a little changed by the friction that follows
    np.testing.assert_allclose(shift, pin / contact_arms(m, state.angle).engaged, rtol=0.2)


def test_losses_reverse_with_the_rotation():
    """Turned backwards with mirrored acceleration the same power is lost."""
    state, gas = random_states(200, 27)
    friction = film_friction(slider_moment="balanced")
    # mirror the machine about its cylinder axis: phi -> -phi, e -> -e, e_cl -> -e_cl
    mirrored = machine(**{k: -v for k, v in OFFSET.items()})
    back = CrankState(-state.angle, -state.speed, -state.acceleration)
    forward = loads_at(on_films(machine(**OFFSET), friction), state, gas)
    backward = loads_at(on_films(mirrored, friction), back, gas)
    for name in forward.loss_torque:
        np.testing.assert_allclose(
            backward.loss_torque[name], -forward.loss_torque[name], rtol=1e-9, atol=1e-12
        )


def test_regularised_friction_goes_over_to_coulomb():
    state, gas = random_states(200, 28)
    m = machine(**OFFSET)
    sharp = loads_at(compressor(m, coulomb_friction()), state, gas)

    def gap(v0):
        smooth = coulomb_friction(
            wall=RegularisedSlide(0.1, v0),
            link_slider=RegularisedSlide(0.1, v0),
            crank_pin=RegularisedJournal(0.01, 0.012, v0),
        )
        loads = loads_at(compressor(m, smooth), state, gas)
        assert loads.residual.max() < 1e-14
        return np.abs(loads.total_loss_torque - sharp.total_loss_torque).max()

    assert gap(1e-1) > gap(1e-2) > gap(1e-3)
    assert gap(1e-4) < 1e-12  # tanh is one beyond 20 transition speeds
    # at rest, where Coulomb's law has no answer, it is smooth
    smooth = coulomb_friction(
        wall=RegularisedSlide(0.1, 0.01), link_slider=RegularisedSlide(0.1, 0.01)
    )

    def loss(w):
        at_rest = CrankState(jnp.array([0.8]), w[None], jnp.zeros(1))
        loads = joint_loads(m, smooth, at_rest, jnp.array([100.0]))
        return loads.loss_torque["wall"][0] + loads.loss_torque["link_slider"][0]

    value, slope = jax.jit(jax.value_and_grad(loss))(jnp.asarray(0.0))
    assert value == 0
    assert slope > 0


def test_weights_enter_every_balance():
    """The bearings carry the sum of weight and inertia, and the energy balance stays closed."""
    m, shaft = machine(piston_centre_lead=0.02, offset=-1e-3), crankshaft(mass_centre=0.03)
    state, gas = random_states(200, 29)
    field = np.array([4.0, -9.0])
    friction = coulomb_friction(0.15, 0.1)
    made = compressor(m, friction, shaft, gravity=field)
    loads = loads_at(made, state, gas)
    plain = loads_at(compressor(m, friction, shaft), state, gas)
    assert loads.residual.max() < 1e-14
    f = loads.forces
    on_shaft = f["upper_bearing"] + f["lower_bearing"] - f["crank_pin"]
    still = (
        plain.forces["upper_bearing"] + plain.forces["lower_bearing"] - plain.forces["crank_pin"]
    )
    np.testing.assert_allclose(on_shaft, still - 1.2 * field[:, None], rtol=1e-11, atol=1e-10)
    # about the piston plane, where the pin has no moment
    tilt, tilt_still = (
        0.024 * each.forces["upper_bearing"] + 0.066 * each.forces["lower_bearing"]
        for each in (loads, plain)
    )
    weight = np.broadcast_to(-0.03 * 1.2 * field[:, None], tilt.shape)
    np.testing.assert_allclose(tilt - tilt_still, weight, rtol=1e-11, atol=1e-11)

    # torque of all weights = slope of their potential
    def potential(angle):
        R = m.crank_radius
        pin = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        carried = (m.slider_mass * R + shaft.unbalance) * pin
        return field @ carried + field[0] * m.piston_mass * R * jnp.cos(angle)

    torque = np.asarray(jax.jit(jax.vmap(jax.grad(potential)))(state.angle))
    whole = instants(made, state.angle)
    np.testing.assert_allclose(whole.conservative, torque, rtol=1e-12, atol=1e-14)
    # the power identity with weights: (29) from the pin force against the reduced form
    drag = sum(
        v for k, v in loads.loss_torque.items() if k not in ("wall", "piston_film", "link_slider")
    )
    R = m.crank_radius
    crank_weight = jax.jit(jax.vmap(jax.grad(
        lambda a: shaft.unbalance * (field[0] * jnp.cos(a) + field[1] * jnp.sin(a))
    )))(state.angle)  # fmt: skip
    pin = R * (f["crank_pin"][0] * np.sin(state.angle) - f["crank_pin"][1] * np.cos(state.angle))
    motor = shaft.inertia * state.acceleration + drag - pin - crank_weight
    reduced = whole.inertia * state.acceleration + 0.5 * whole.inertia_1 * state.speed**2
    reduced = reduced + loads.total_loss_torque + gas * m.piston(state.angle)[1] - torque
    np.testing.assert_allclose(motor, reduced, rtol=1e-11, atol=1e-12)


def edge_states():
    """Dead centres, reversals, angles beside them, no gas force, no acceleration."""
    quarter = jnp.arange(5) * jnp.pi / 2
    angle = jnp.concatenate([quarter, quarter + 1e-9, quarter - 1e-9, jnp.array([0.7, 4.0])])
    n = angle.size
    return CrankState(angle, jnp.full(n, 300.0), jnp.zeros(n)), jnp.zeros(n)


@pytest.mark.parametrize(
    ("friction", "support"),
    [
        (coulomb_friction(), bearings()),
        (film_friction(slider_moment="balanced"), film_bearings()),
    ],
    ids=["coulomb", "film balanced"],
)
def test_no_nan_at_dead_centres_and_contact_switches(friction, support):
    state, gas = edge_states()

    @eqx.filter_jit
    @eqx.filter_value_and_grad
    def total(tree):
        made, state = tree
        loads = eager_loads_at(made, state, gas[None])
        forces = sum(jnp.sum(f) for f in loads.forces.values())
        return jnp.sum(loads.total_loss_torque) + 1e-3 * forces + jnp.sum(loads.margin)

    massless = machine(piston_mass=0.0, slider_mass=0.0)
    for linkage, changes in ((machine(), {}), (massless, {"unbalance": 0.0})):
        shaft = crankshaft(main_journal=support, **changes)
        value, gradient = total((compressor(linkage, friction, shaft), state))
        assert np.isfinite(value)
        for leaf in jax.tree.leaves(gradient):
            assert np.all(np.isfinite(leaf))


@pytest.mark.parametrize("reading", [pytest.param("paper", marks=pytest.mark.slow), "balanced"])
def test_gradients_equal_differences(reading):
    """Losses, loads and margin by every parameter, at a state beside the dead centre as well."""
    made = on_films(machine(**OFFSET), film_friction(slider_moment=reading))
    state = CrankState(
        jnp.array([0.02, 1.2, 2.0, 4.0, 5.6]), jnp.full(5, 300.0), jnp.full(5, -200.0)
    )
    gas = jnp.array([200.0, -5.0, 3.0, 10.0, 290.0])
    flat, rebuild = ravel_pytree((made, state, gas))
    weights = jnp.asarray(np.random.default_rng(30).normal(size=40))

    def scalar(x):
        *now, force = rebuild(x)
        loads = eager_loads_at(*now, force[None])
        # torques of 0.01 N m beside forces of 100 N
        torques = [1e4 * t for t in loads.loss_torque.values()]
        parts = [*torques, *loads.forces.values(), loads.margin]
        parts = jnp.concatenate([jnp.ravel(p) for p in parts])
        return jnp.sum(jnp.resize(weights, parts.shape) * parts)

    # one program for values and slopes
    both = jax.jit(jax.vmap(jax.value_and_grad(scalar)))
    size = np.abs(np.asarray(flat))
    h = 1e-6 * np.where(size > 0, size, 1e-3)
    steps = np.diag(h)
    rows = np.asarray(flat) + np.concatenate([steps, -steps, np.zeros_like(steps[:1])])
    values, slopes = map(np.asarray, both(jnp.asarray(rows)))
    measured = (values[: h.size] - values[h.size : -1]) / 2
    gradient = slopes[-1] * h
    # h^2 = 1e-12 relative and rounding of a sum of some 1e3: 1e-13 over changes of 1e-3 and less
    np.testing.assert_allclose(gradient, measured, atol=3e-12 * 1e3, rtol=1e-6)
    assert np.sum(np.abs(gradient) > 1e-6) > 40


def test_second_derivatives_of_the_coupled_reading():
    m, friction = machine(**OFFSET), coulomb_friction(mu=0.05, slider_moment="balanced")

    def wall(angle):
        state = CrankState(angle, jnp.asarray(300.0), jnp.asarray(-200.0))
        return eager_joint_loads(m, friction, state, jnp.asarray(90.0)).loss_torque["wall"]

    # slope and second derivative of one program
    both = jax.jit(jax.vmap(jax.value_and_grad(jax.grad(wall))))
    angle = np.array([1.0, 2.3, 4.2, 5.6])
    (fall, _), (_, second), (rise, _) = (both(angle + step) for step in (-1e-5, 0.0, 1e-5))
    # 1e-10 of the fourth derivative, rounding 1e-16/1e-5 of the slope
    np.testing.assert_allclose(second, (rise - fall) / 2e-5, rtol=1e-7)


def test_batches_equal_single_instants():
    state, gas = random_states(200, 31)
    made = compressor(machine(**OFFSET), coulomb_friction(slider_moment="balanced"))
    whole = loads_at(made, state, gas)
    one_by_one = jax.jit(jax.vmap(lambda s, g: eager_loads_at(made, s, g[None])))(state, gas)
    np.testing.assert_allclose(whole.total_loss_torque, one_by_one.total_loss_torque, rtol=1e-14)
    single = loads_at(made, jax.tree.map(lambda x: x[3], state), gas[3])
    np.testing.assert_allclose(single.total_loss_torque, whole.total_loss_torque[3], rtol=1e-14)


def test_kinks_are_where_the_sides_change():
    state, gas = random_states(200, 32)
    loads = joint_loads(machine(**OFFSET), coulomb_friction(), state, gas)
    np.testing.assert_array_equal(np.sign(loads.kinks), np.stack(sides(loads)))
    np.testing.assert_array_equal(loads.minima[0], loads.forces["crank_pin"][0])
    # of the whole machine the same: its bearings have no places of their own
    whole = loads_at(compressor(machine(**OFFSET), coulomb_friction()), state, gas)
    np.testing.assert_array_equal(whole.kinks, loads.kinks)
    np.testing.assert_array_equal(whole.minima, loads.minima)
