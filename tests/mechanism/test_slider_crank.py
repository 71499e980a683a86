import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import MECHANISM, Laws, coulomb, mechanism, pick, random_crankshafts, random_mechanisms
from scipy.optimize import minimize_scalar

from jaxcomp import BadInput, Compressor
from jaxcomp.compressor import instants, loads_at
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.mechanism import CrankState, SliderCrank, rod_motion
from jaxcomp.motor import ConstantTorque

COUNT = 200

# Rounding of a double, with room for the few hundred operations of one balance and for terms that
# cancel, whose size is the yardstick.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def rng():
    return np.random.default_rng(20127)


@pytest.fixture(scope="module", params=["centred", "offset"])
def batch(request, rng):
    """Machines of all proportions, each in a random state under a random gas force."""
    machines = random_mechanisms(rng, COUNT, offset=request.param == "offset")
    state = CrankState(
        jnp.asarray(rng.uniform(-np.pi, 3 * np.pi, COUNT)),
        jnp.asarray(rng.uniform(-200, 200, COUNT)),
        jnp.asarray(rng.uniform(-2e3, 2e3, COUNT)),
    )
    gas = jnp.asarray(rng.uniform(-5e3, 2e4, COUNT))
    gravity = jnp.asarray(rng.uniform(-10, 10, (COUNT, 2)))
    return machines, state, gas, gravity, random_crankshafts(rng, COUNT)


def along_time(function, state):
    """Value, rate and second rate of a function of the angle, along the motion of the state."""
    angle, speed, acceleration = state
    motion = lambda t: function(angle + speed * t + 0.5 * acceleration * t**2)  # noqa: E731
    rate = lambda t: jax.jvp(motion, (t,), (1.0,))[1]  # noqa: E731
    return motion(0.0), *jax.jvp(rate, (0.0,), (1.0,))


# ---------------------------------------------------------------- kinematics
def test_derivatives_equal_automatic_ones(batch):
    machines, state, *_ = batch

    def both(machine, angle):
        rod = rod_motion(machine, angle)
        one = lambda a: jax.jvp(lambda b: machine.piston(b)[0], (a,), (1.0,))[1]  # noqa: E731
        tilt = lambda a: jnp.arcsin(rod_motion(machine, a).sin_tilt)  # noqa: E731
        tilt_1 = lambda a: jax.jvp(tilt, (a,), (1.0,))[1]  # noqa: E731
        inertia_1 = jax.jvp(lambda a: machine.inertia(a)[0], (angle,), (1.0,))[1]
        exact = [*machine.piston(angle)[1:], rod.tilt_1, rod.tilt_2, machine.inertia(angle)[1]]
        second = jax.jvp(one, (angle,), (1.0,))[1]
        automatic = [one(angle), second, tilt_1(angle)]
        automatic += [jax.jvp(tilt_1, (angle,), (1.0,))[1], inertia_1]
        return jnp.stack(exact), jnp.stack(automatic)

    exact, automatic = jax.jit(jax.vmap(both))(machines, state.angle)
    # arcsin' of a slanted rod loses a digit or two
    np.testing.assert_allclose(exact, automatic, rtol=1e-10, atol=1e-13)


def test_closed_chain(batch):
    """Crank pin and piston pin stay a rod's length apart, the piston on its line."""
    machines, state, *_ = batch
    x = jax.vmap(lambda m, a: m.piston(a)[0])(machines, state.angle)
    dx = x - machines.crank_radius * jnp.cos(state.angle)
    dy = machines.offset - machines.crank_radius * jnp.sin(state.angle)
    np.testing.assert_allclose(jnp.hypot(dx, dy), machines.conrod_length, rtol=1e-14)


@pytest.mark.parametrize("index", range(5))
def test_dead_centres_are_the_extremes_of_a_scan(rng, index):
    machine = pick(random_mechanisms(np.random.default_rng(index), 1), 0)
    x = jax.jit(lambda a: machine.piston(a)[0])
    angles = np.linspace(-np.pi / 2, 3 * np.pi / 2, 2001)
    values = np.asarray(x(angles))
    centres, extremes = machine.dead_centres(), machine.piston_extremes()
    for sign, i, centre, extreme in zip(
        (-1, 1), (values.argmax(), values.argmin()), centres, extremes, strict=True
    ):
        best = minimize_scalar(
            lambda a, sign=sign: sign * float(x(a)),
            bounds=(angles[i - 1], angles[i + 1]),
            method="bounded",
            options={"xatol": 1e-12},
        )
        np.testing.assert_allclose(extreme, sign * best.fun, rtol=1e-13)
        # a minimum is found to the root of rounding only
        np.testing.assert_allclose(centre, best.x, atol=1e-6)
        assert abs(machine.piston(centre)[1]) < 1e-15
    np.testing.assert_allclose(machine.stroke, values.max() - values.min(), rtol=1e-5)


def test_offset_makes_the_stroke_longer_and_the_strokes_unequal():
    centred, offset = mechanism(), mechanism(offset=0.08)
    assert offset.stroke > centred.stroke == pytest.approx(2 * MECHANISM["crank_radius"])
    top, bottom = offset.dead_centres()
    assert bottom - top > np.pi + 0.05  # the outstroke takes more than half a turn
    mirrored = mechanism(offset=-0.08)
    top_m, bottom_m = mirrored.dead_centres()
    np.testing.assert_allclose([top_m, bottom_m - np.pi], [-top, np.pi - bottom], rtol=1e-13)


def test_angle_at_inverts_the_position(batch):
    machines, state, *_ = batch

    def back(machine, angle):
        x, x_1, _ = machine.piston(angle)
        return x_1, jnp.stack([machine.angle_at(x, inward) - angle for inward in (True, False)])

    x_1, error = jax.jit(jax.vmap(back))(machines, state.angle)
    error = np.where(x_1 > 0, error[:, 0], error[:, 1]) / (2 * np.pi)
    # close to a dead centre the angle is worth only the root of the position's digits
    np.testing.assert_allclose(error, np.round(error), atol=1e-9)


@pytest.mark.parametrize("inward", [True, False])
def test_angle_at_the_ends_of_the_stroke_is_finite_with_its_slope(inward):
    machine = mechanism(offset=0.02)
    for position, centre in zip(machine.piston_extremes(), machine.dead_centres(), strict=True):
        for beyond in (0.0, 1e-3, -1e-3):
            angle, slope = jax.value_and_grad(machine.angle_at)(position + beyond, inward)
            assert np.isfinite(angle)
            assert np.isfinite(slope)
            if beyond == 0:
                turn = (angle - centre) / (2 * np.pi)
                # the root of rounding, as for any inverse of a square
                np.testing.assert_allclose(turn, np.round(turn), atol=1e-8)


# ---------------------------------------------------------------- balances
def assembled(machine, shaft, gravity, friction):
    given = friction or Laws(None)
    shaft = dataclasses.replace(shaft, main_journal=given.main_journal)
    return Compressor(machine, shaft, ConstantTorque(0.0), None, given.friction, gravity)


def crank_balance_and_energy_form(machine, shaft, state, gas, gravity, friction):
    """Motor torque by the crank's own balance, by the energy form, and a size."""
    compressor = assembled(machine, shaft, gravity, friction)
    loads = loads_at(compressor, state, gas[None])
    rod = rod_motion(machine, state.angle)
    pin = machine.crank_radius * jnp.stack([jnp.cos(state.angle), jnp.sin(state.angle)])
    on_rod = loads.forces["crank_pin"]
    terms = [
        shaft.inertia * state.acceleration,
        pin[0] * on_rod[1],
        -pin[1] * on_rod[0],
        loads.loss_torque["crank_pin"] / (1 + rod.tilt_1) if friction is not None else 0.0,
        loads.loss_torque["main_journal"] if friction is not None else 0.0,
    ]
    weight = shaft.unbalance / machine.crank_radius
    if gravity is not None:
        terms += [-weight * pin[0] * gravity[1], weight * pin[1] * gravity[0]]
    at = instants(compressor, state.angle)
    _, position_1, _ = machine.piston(state.angle)
    energy = (
        at.inertia * state.acceleration
        + 0.5 * at.inertia_1 * state.speed**2
        - at.conservative
        + gas * position_1
        + loads.total_loss_torque
    )
    forces = jnp.stack([jnp.hypot(*f) for f in loads.forces.values()])
    size = sum(map(jnp.abs, terms)) + machine.crank_radius * jnp.max(forces)
    return sum(terms), energy, size


@pytest.mark.parametrize("gravity_on", [False, True], ids=["no gravity", "gravity"])
@pytest.mark.parametrize("friction", [None, coulomb()], ids=["frictionless", "coulomb"])
def test_newton_euler_equals_energy_form(batch, friction, gravity_on):
    machines, state, gas, gravity, shafts = batch

    def both(machine, shaft, state, gas, gravity):
        field = gravity if gravity_on else None
        return crank_balance_and_energy_form(machine, shaft, state, gas, field, friction)

    newton, energy, size = jax.jit(jax.vmap(both))(machines, shafts, state, gas, gravity)
    np.testing.assert_allclose((newton - energy) / size, 0.0, atol=ROUNDING)


def test_forces_on_every_body_balance_its_inertia(batch):
    """Accelerations by differentiating the positions of the mass centres twice."""
    machines, state, gas, gravity, shafts = batch

    def sums(machine, shaft, state, gas, gravity):
        compressor = assembled(machine, shaft, gravity, coulomb())
        forces = loads_at(compressor, state, gas[None]).forces
        r, l, b = machine.crank_radius, machine.conrod_length, machine.conrod_centre

        def pins(angle):
            crank = r * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
            return crank, jnp.stack([machine.piston(angle)[0], machine.offset])

        def centre(angle):
            crank, piston = pins(angle)
            return crank + b / l * (piston - crank)

        unbalance = lambda angle: shaft.unbalance / r * pins(angle)[0]  # noqa: E731
        piston_acc = along_time(lambda a: pins(a)[1], state)[2]
        rod_acc = along_time(centre, state)[2]
        crank_acc = along_time(unbalance, state)[2]
        t, s, q = (forces[k] for k in ("piston_pin", "crank_pin", "main_journal"))
        on_piston = jnp.stack([-gas, 0.0]) + forces["wall"] - t + machine.piston_mass * gravity
        on_rod = t + s + machine.conrod_mass * gravity
        on_crank = q - s + shaft.mass * gravity
        left = [
            on_piston - machine.piston_mass * piston_acc,
            on_rod - machine.conrod_mass * rod_acc,
            on_crank - crank_acc,
        ]
        size = sum(jnp.hypot(*f) for f in forces.values())
        return jnp.stack(left) / size

    np.testing.assert_allclose(
        jax.jit(jax.vmap(sums))(machines, shafts, state, gas, gravity), 0.0, atol=ROUNDING
    )


def test_kinetic_energy_is_half_inertia_times_square_of_speed(batch):
    machines, state, *_ = batch

    def both(machine, state):
        r, l, b = machine.crank_radius, machine.conrod_length, machine.conrod_centre

        def places(angle):
            x = machine.piston(angle)[0]
            crank = r * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
            centre = crank + b / l * (jnp.stack([x, machine.offset]) - crank)
            return x, centre, jnp.arcsin((crank[1] - machine.offset) / l)

        _, (v, vc, turn), _ = along_time(places, state)
        summed = (
            machine.piston_mass * v**2
            + machine.conrod_mass * jnp.sum(vc**2)
            + machine.conrod_inertia * turn**2
        )
        return summed, machine.inertia(state.angle)[0] * state.speed**2

    summed, reduced = jax.jit(jax.vmap(both))(machines, state)
    np.testing.assert_allclose(summed, reduced, rtol=ROUNDING)


def test_gravity_torque_is_the_slope_of_potential_energy(batch):
    machines, state, _, gravity, shafts = batch

    def both(machine, shaft, angle, g):
        r, l, b = machine.crank_radius, machine.conrod_length, machine.conrod_centre

        def potential(angle):
            crank = r * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
            piston = jnp.stack([machine.piston(angle)[0], machine.offset])
            centre = crank + b / l * (piston - crank)
            return -(
                machine.piston_mass * piston @ g
                + machine.conrod_mass * centre @ g
                + shaft.unbalance / r * crank @ g
            )

        whole = instants(assembled(machine, shaft, g, None), angle).conservative
        return -jax.grad(potential)(angle), whole

    slope, torque = jax.jit(jax.vmap(both))(machines, shafts, state.angle, gravity)
    np.testing.assert_allclose(torque, slope, rtol=1e-10, atol=1e-11)


def test_forces_of_the_frictionless_machine_of_the_balancing_paper():
    r"""Transmitted forces of the same two-mass rod without friction at constant speed.

    Forces on the crank in Eqs (3) and (4) of the hermetic-compressor balancing paper: with
    $m_{re} = m_c b/l$, $m_{ro} = m_c a/l$, the axes x along the cylinder and z = -y,

    $$Q_x = -(m_{re} + m_p)\ddot x_p + m_{ro} r\dot\vartheta^2\cos\vartheta - P,$$
    $$Q_z = \frac{I - m_c a b}{l\cos\phi}\ddot\phi - [(m_p + m_{re})\ddot x_p + P]\tan\phi
            - m_{ro} r \dot\vartheta^2\sin\vartheta .$$

    The sign of the bracket in (4) depends on that of phi and P, which the print does not fix; the
    one here belongs to the phi of `SliderCrank` and to P pushing the piston to the crank.
    """
    machine = mechanism()
    angle = jnp.linspace(0.1, 6.4, 50)
    speed = jnp.full(50, 300.0)
    gas = 9e3 * jnp.cos(angle) ** 2
    state = CrankState(angle, speed, jnp.zeros(50))
    bare = assembled(machine, Crankshaft(0.1), None, None)
    loads = jax.jit(loads_at)(bare, state, gas[None])
    b, l, r = machine.conrod_centre, machine.conrod_length, machine.crank_radius
    reciprocating = machine.conrod_mass * b / l + machine.piston_mass
    rotating = machine.conrod_mass * (l - b) / l * r * speed**2
    phi = jnp.arcsin(r * jnp.sin(angle) / l)
    tilt = lambda a: jnp.arcsin(r / l * jnp.sin(a))  # noqa: E731
    tilt_acc = jax.vmap(jax.grad(jax.grad(tilt)))(angle) * speed**2
    piston = lambda a: r * jnp.cos(a) + jnp.sqrt(l**2 - (r * jnp.sin(a)) ** 2)  # noqa: E731
    piston_acc = jax.vmap(jax.grad(jax.grad(piston)))(angle) * speed**2
    q_x = -reciprocating * piston_acc + rotating * jnp.cos(angle) - gas
    residue = machine.conrod_inertia - machine.conrod_mass * b * (l - b)
    q_z = (
        residue * tilt_acc / (l * jnp.cos(phi))
        - (reciprocating * piston_acc + gas) * jnp.tan(phi)
        - rotating * jnp.sin(angle)
    )
    size = jnp.max(jnp.abs(q_x))
    np.testing.assert_allclose(-loads.forces["main_journal"][0] / size, q_x / size, atol=ROUNDING)
    np.testing.assert_allclose(loads.forces["main_journal"][1] / size, q_z / size, atol=ROUNDING)


# ---------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"crank_radius": 0.294}, "crank_radius + |offset| < conrod_length"),
        ({"offset": -0.25}, "crank_radius + |offset| < conrod_length"),
        ({"piston_mass": -1e-9}, "`piston_mass` must be >= 0"),
        ({"conrod_mass": -1.0}, "`conrod_mass` must be >= 0"),
        ({"bore": np.nan}, "`bore` must be > 0 and <= 10 m, but is nan"),
        ({"bore": np.inf}, "`bore` must be > 0 and <= 10 m, but is inf"),
        (
            {"piston_mass": np.inf},
            "`piston_mass` must be >= 0 kg, and at most 1e25 in size, but is inf",
        ),
        ({"conrod_length": -0.3}, "`conrod_length` must be > 0"),
    ],
)
def test_bad_geometry_is_refused_by_name(changes, words):
    with pytest.raises(BadInput) as caught:
        mechanism(**changes)
    assert words in str(caught.value)


def test_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"bore.*shape"):
        SliderCrank(**(MECHANISM | {"bore": [[0.1, 0.2]]}))  # a list has a value for each cylinder


def test_a_crankshaft_without_inertia_is_refused():
    with pytest.raises(BadInput, match="`inertia` must be > 0"):
        Crankshaft(0.0)
