"""Shaking wrench against momentum, vibration against closed forms and against the ODE.

Slider-link machine and formulas: Dagilis, Vaitkus, Kirejchick, *Slider-link driven compressor (I).
Mathematical model*, Eqs. (36)-(43).
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from mechanism.test_slider_link import (
    OFFSET,
    SHAFT,
    compressor,
    coulomb_friction,
    crankshaft,
    loads_at,
    machine,
    product_of_inertia,
    random_states,
)

from jaxcomp import BadInput
from jaxcomp.compressor import instants
from jaxcomp.crankshaft import Crankshaft, counterweights
from jaxcomp.mechanism import CrankState, SliderCrank
from jaxcomp.rotor import matrices, undamped_modes
from jaxcomp.scene import SceneError, describe, dump, load, loads, with_value
from jaxcomp.vibration import (
    Harmonics,
    Spring,
    Suspension,
    Wrench,
    block_response,
    harmonics,
    shaking_wrench,
    time_response,
)
from jaxcomp.vibration._block import BlockMotion, free_body_error, free_body_response, point_motion
from jaxcomp.vibration._suspension import viscous_damping, with_scaled_frequencies
from jaxcomp.vibration._wrench import wrench_about


def slider_crank(**changes):
    values = dict(
        bore=0.023,
        crank_radius=0.0096,
        conrod_length=0.045,
        piston_mass=0.05,
        conrod_mass=0.04,
        conrod_centre=0.017,
        conrod_inertia=1.1e-5,
        offset=1.5e-3,
    )
    return SliderCrank(**(values | changes))


def rod_shaft(unbalance=-4e-4):
    """A crankshaft in the plane of the rod."""
    return Crankshaft(inertia=4.5e-4, mass=1.2, unbalance=unbalance)


def suspension(stiffness=1.0, damping_ratio=0.03, **changes):
    """Four upright springs below a block of 7.5 kg, 2.5 N/mm lateral and 6 N/mm axial."""
    mass = 7.5
    lateral, axial = 2500.0 * stiffness, 6000.0 * stiffness
    springs = [
        Spring(
            position=(x, y, 0.06),
            axial_stiffness=axial,
            lateral_stiffness=lateral,
            axial_damping=viscous_damping(axial, damping_ratio, mass / 4),
            lateral_damping=viscous_damping(lateral, damping_ratio, mass / 4),
        )
        for x in (-0.06, 0.06)
        for y in (-0.05, 0.05)
    ]
    values = dict(
        mass=mass, inertia_x=0.030, inertia_y=0.035, inertia_z=0.025, springs=springs,
        mass_centre=(0.010, 0.0, 0.0),
    )  # fmt: skip
    return Suspension(**(values | changes))


def momentum_link(made, angle, speed):
    """Momentum and angular momentum about the origin from positions alone."""
    m, shaft = made.mechanism, made.crankshaft

    def velocity(position):
        return jax.jvp(position, (angle,), (speed,))[1]

    def body(mass, position, spin):
        p = mass * velocity(position)
        return p, jnp.cross(position(angle), p) + spin

    def place(x, y, z):
        return jnp.stack([x, y, jnp.broadcast_to(z, x.shape)])

    R, e, zs = m.crank_radius, (-m.offset), -shaft.origin
    piston = body(
        m.piston_mass,
        # any x fixed to the piston will do
        lambda a: place(m.piston(a)[0], -e + m.piston_centre_offset + 0 * a, zs),
        0.0,
    )
    slider = body(m.slider_mass, lambda a: place(R * jnp.cos(a), R * jnp.sin(a), zs), 0.0)
    # The crank as point masses: one with its unbalance at z = 0 and a pair without unbalance that
    # supplies the product of inertia. The rest of J_z turns in place.
    mr, jxz = shaft.mass, product_of_inertia(shaft)
    ecr = -shaft.unbalance / mr

    def turning(a, radius, z):
        return place(radius * jnp.cos(a), radius * jnp.sin(a), z)

    arm, height = 0.01, 0.02
    pair = jxz / (2 * arm * height)
    parts = [
        body(mr, lambda a: turning(a, -ecr, 0.0), 0.0),
        body(pair, lambda a: turning(a, arm, height), 0.0),
        body(pair, lambda a: turning(a, -arm, -height), 0.0),
    ]
    rest = shaft.inertia - mr * ecr**2 - 2 * pair * arm**2
    parts.append((jnp.zeros(3), jnp.array([0.0, 0.0, 1.0]) * rest * speed))
    return tuple(sum(x) for x in zip(piston, slider, *parts, strict=True))


def momentum_crank(made, angle, speed):
    m, shaft = made.mechanism, made.crankshaft

    def velocity(position):
        return jax.jvp(position, (angle,), (speed,))[1]

    def pin(a):
        return m.crank_radius * jnp.stack([jnp.cos(a), jnp.sin(a), 0 * a])

    def piston(a):
        return jnp.stack([m.piston(a)[0], m.offset + 0 * a, 0 * a])

    def centre(a):
        t = m.conrod_centre / m.conrod_length
        return (1 - t) * pin(a) + t * piston(a)

    def rod_angle(a):
        rod = piston(a) - pin(a)
        return jnp.arctan2(rod[1], rod[0])

    z = jnp.array([0.0, 0.0, 1.0])
    linear = m.piston_mass * velocity(piston) + m.conrod_mass * velocity(centre)
    linear = linear + shaft.unbalance / m.crank_radius * velocity(pin)
    angular = jnp.cross(piston(angle), m.piston_mass * velocity(piston))
    angular = angular + jnp.cross(centre(angle), m.conrod_mass * velocity(centre))
    spin = m.conrod_inertia * velocity(rod_angle) + shaft.inertia * speed
    return linear, angular + spin * z


@pytest.mark.parametrize(
    ("made", "momentum"),
    [
        (compressor(machine(offset=-2e-3, piston_centre_offset=-1.5e-3)), momentum_link),
        (compressor(slider_crank(), shaft=rod_shaft()), momentum_crank),
    ],
    ids=["slider-link", "slider-crank"],
)
def test_wrench_is_the_rate_of_change_of_all_momentum(made, momentum):
    state, _ = random_states(200, 10)

    def rate(angle, speed, acceleration):
        motion = (angle, speed), (speed, acceleration)
        return jax.jvp(lambda a, w: momentum(made, a, w), *motion)[1]

    force, moment = jax.jit(jax.vmap(rate))(*state)
    wrench = shaking_wrench(made, state)
    # rounding: the crank and the piston cancel by up to a factor of ten
    np.testing.assert_allclose(wrench.force.T, -force, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(wrench.moment.T, -moment, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("reading", ["balanced", "paper"])
def test_wrench_equals_the_sum_of_all_reactions_on_the_block(reading):
    """Bearings, cylinder contacts, gas on the head, film, friction moments and the stator.

    As printed the slider has no couple, so that M_z is short of it; balanced, nothing is missing.
    """
    m = machine(offset=-2e-3, piston_centre_offset=-1.5e-3)
    made = compressor(m, coulomb_friction(0.15, 0.12, slider_moment=reading))
    state, gas = random_states(200, 11)
    loads = loads_at(made, state, gas)
    f, loss = loads.forces, loads.loss_torque
    # the motor torque that goes with this acceleration, from the energy of the machine
    whole = instants(made, state.angle)
    motor = whole.inertia * state.acceleration + 0.5 * whole.inertia_1 * state.speed**2
    motor = motor + gas * m.piston(state.angle)[1] + loads.total_loss_torque

    crown = m.piston(state.angle)[0]
    mouth = m.crown_to_link + m.crank_radius - m.cylinder_length  # edge of the cylinder
    e, half = (-m.offset), m.bore / 2
    plane = -made.crankshaft.origin

    def on_block(force, x, y, z):
        fx, fy = -force[0], -force[1]  # reaction
        return jnp.stack([fx, fy, 0 * fx, -z * fy, z * fx, x * fy - y * fx])

    def rim(force):  # contacts lie on the -y side of the piston if the force points to +y
        return -e - half * jnp.sign(force[1])

    upper, lower = plane + made.crankshaft.main_journal.position
    total = on_block(f["wall_crown"], crown, rim(f["wall_crown"]), plane)
    total += on_block(f["wall_edge"], mouth, rim(f["wall_edge"]), plane)
    total += on_block(f["piston_film"], 0.0, -e, plane)
    total += on_block(jnp.stack([-gas, 0 * gas]), 0.0, -e, plane)
    total += on_block(f["upper_bearing"], 0.0, 0.0, upper)
    total += on_block(f["lower_bearing"], 0.0, 0.0, lower)
    drag = sum(loss[k] for k in ("upper_bearing", "lower_bearing", "thrust_bearing", "pump"))
    total = total.at[5].add(drag - motor)

    wrench = jnp.concatenate(shaking_wrench(made, state))
    # rounding of forces up to 2 kN and of arms of 0.05 m
    np.testing.assert_allclose(total[:5], wrench[:5], rtol=1e-11, atol=1e-9)
    missing = 0.0
    if reading == "paper":
        missing = f["link_slider"][1] * jnp.sign(f["link_slider"][0]) * m.slider_diameter / 2
        missing = missing - loss["crank_pin"]
        assert np.abs(missing).max() > 0.05
    difference = total[5] - wrench[5]
    np.testing.assert_allclose(difference, missing, rtol=1e-9, atol=1e-11)


def test_errata_of_the_z_moment():
    """Eq. (40) prints m_s R for m_s R^2: a hundred times too much at R = 9.6 mm."""
    m, state = machine(), CrankState(jnp.zeros(1), jnp.zeros(1), jnp.ones(1))
    moment = shaking_wrench(compressor(m), state).moment[2, 0]
    R, ms, inertia = m.crank_radius, m.slider_mass, SHAFT["inertia"]
    np.testing.assert_allclose(moment, -(inertia + ms * R**2), rtol=1e-15)
    printed = -(inertia + ms * R)
    np.testing.assert_allclose(printed - moment, -ms * R * (1 - R), rtol=1e-12)


def test_wrench_about_another_point():
    wrench = Wrench(jnp.array([3.0, 5.0, 0.0]), jnp.array([0.1, 0.2, 0.3]))
    x_c, y_c = 0.01, 0.004
    moved = wrench_about(wrench, (x_c, y_c, 0.0))
    # (41) with y_c, which is zero in the source
    np.testing.assert_allclose(moved.moment, [0.1, 0.2, 0.3 - x_c * 5.0 + y_c * 3.0], rtol=1e-14)
    # a crank 35 mm above the point
    raised = wrench_about(wrench, (0.0, 0.0, 0.035))
    np.testing.assert_allclose(raised.moment, [0.1 + 0.035 * 5, 0.2 - 0.035 * 3, 0.3], rtol=1e-14)


def test_slider_link_is_the_slider_crank_with_an_endless_rod():
    """Error of order R/l, so that it falls by ten from l to 10 l."""
    state, _ = random_states(200, 12)
    shaft = rod_shaft(SHAFT["unbalance"])
    link = shaking_wrench(compressor(machine(slider_mass=0.0), shaft=shaft), state)

    def error(length):
        rod = slider_crank(
            conrod_length=length, piston_mass=0.110, conrod_mass=0.0, conrod_inertia=0.0, offset=0.0
        )
        crank = shaking_wrench(compressor(rod, shaft=shaft), state)
        return np.abs(np.concatenate(crank) - np.concatenate(link)).max()

    assert 9.5 < error(1.0) / error(10.0) < 10.5


def test_half_balance_gives_equal_forces_and_moments():
    m = machine()
    # 0.62 mm and 2.6e-5 kg m^2 for this machine, to the digits given
    assert round(1e3 * float(m.half_balance) / SHAFT["mass"], 2) == 0.62
    told = crankshaft(shaft_couple=None, unbalance=0.0, balanced=True)
    typed = counterweights(m, told)
    np.testing.assert_allclose(typed.origin * m.half_balance, 2.6e-5, rtol=5e-3)  # two digits given
    angle = jnp.array([0.0, np.pi / 2])
    state = CrankState(angle, jnp.full(2, 300.0), jnp.zeros(2))
    wrench, same = (shaking_wrench(compressor(m, shaft=shaft), state) for shaft in (typed, told))
    np.testing.assert_allclose(np.concatenate(wrench), np.concatenate(same), rtol=1e-14)
    np.testing.assert_allclose(wrench.force[0, 0], -wrench.force[1, 1], rtol=1e-13)
    np.testing.assert_allclose(wrench.moment[1, 0], wrench.moment[0, 1], rtol=1e-13)
    # "first-harmonic shaking force 48 N" at 2907 rpm
    speed = 2907 * np.pi / 30
    np.testing.assert_allclose(wrench.force[0, 0] * (speed / 300) ** 2, 48.0, rtol=0.02)


def test_bearing_loads_do_not_depend_on_the_mass_centre_of_the_machine():
    state, gas = random_states(200, 13)
    near, far = (
        compressor(machine(**OFFSET), coulomb_friction(), crankshaft(origin=origin))
        for origin in (0.035, 0.1)
    )
    here, there = (loads_at(made, state, gas).forces for made in (near, far))
    for name in ("upper_bearing", "lower_bearing"):
        np.testing.assert_allclose(here[name], there[name], atol=1e-12)
    # the shaking moment does: it is that of the same forces about another point
    moved = wrench_about(shaking_wrench(near, state), (0.0, 0.0, 0.1 - 0.035))
    moment = shaking_wrench(far, state).moment
    np.testing.assert_allclose(moment, moved.moment, rtol=1e-11, atol=1e-13)


def first_harmonic(speed=304.4, **changes):
    angle = jnp.arange(64) * 2 * np.pi / 64
    state = CrankState(angle, jnp.full(64, speed), jnp.zeros(64))
    wrench = shaking_wrench(compressor(), state)
    # equal steps are exact for 64 points and few harmonics
    load = harmonics(
        suspension(**changes), wrench, angle / speed, jnp.full(64, 2 * np.pi / 64 / speed), 3
    )
    return state, wrench, load


def test_harmonics_rebuild_the_wrench():
    state, wrench, load = first_harmonic()
    about_centre = wrench_about(wrench, (0.010, 0.0, 0.0))
    rebuilt = load.at(state.angle / state.speed)
    np.testing.assert_allclose(rebuilt, np.concatenate(about_centre), atol=1e-11)
    np.testing.assert_allclose(load.speed, 304.4, rtol=1e-14)
    np.testing.assert_allclose(
        load.rms, np.sqrt(np.mean(np.concatenate(about_centre) ** 2, axis=1)), atol=1e-11
    )


def natural_frequencies(suspension):
    """[rad/s] (6,)"""
    return undamped_modes(suspension.rotor, 6).frequency


def test_natural_frequencies_of_the_household_machine():
    # 5.8 Hz lateral and 9 Hz vertical if nothing tilts: sqrt(4 k/M), to the digits given
    upright = [
        Spring((0.0, 0.0, 0.0), axial_stiffness=24000.0, lateral_stiffness=10000.0),
    ]
    held = suspension(springs=upright, mass_centre=(0.0, 0.0, 0.0))
    found = natural_frequencies(held) / (2 * np.pi)
    np.testing.assert_allclose(found, [0, 0, 0, 5.81, 5.81, 9.00], atol=5e-3)
    # with the springs at their corners every mode stays far below 48 Hz
    assert natural_frequencies(suspension())[-1] / (2 * np.pi) < 20
    # eigenvalues of M^-1 S, computed without symmetry
    s = suspension()
    full = matrices(s.rotor)
    squares = np.linalg.eigvals(np.linalg.solve(full.mass, full.stiffness))
    np.testing.assert_allclose(natural_frequencies(s), np.sqrt(np.sort(squares.real)), rtol=1e-10)


def test_stiffness_is_the_slope_of_the_strain_energy():
    """A slanted spring and an upright one against the energy of their stretch."""
    springs = [
        Spring((0.05, -0.02, 0.03), axial_stiffness=4000.0, axis=(1.0, 2.0, -0.5)),
        Spring((-0.04, 0.03, 0.05), axial_stiffness=100.0, lateral_stiffness=900.0),
    ]
    s = suspension(springs=springs)

    def energy(q):
        total = 0.0
        for spring in springs:
            u = q[:3] + jnp.cross(q[3:], spring.position - s.mass_centre)
            n = spring.axis / jnp.linalg.norm(spring.axis)
            along = u @ n
            total += 0.5 * spring.axial_stiffness * along**2
            total += 0.5 * spring.lateral_stiffness * (u @ u - along**2)
        return total

    found = matrices(s.rotor).stiffness
    np.testing.assert_allclose(found, jax.jit(jax.hessian(energy))(jnp.zeros(6)), atol=1e-9)


def test_harmonic_response_of_one_mass_on_one_spring():
    spring = Spring((0.0, 0.0, 0.0), axial_stiffness=8000.0, axial_damping=20.0, axis=(2.0, 0, 0))
    # weak springs hold the other directions
    hold = Spring((0.01, 0.02, 0.03), axial_stiffness=1e-9, lateral_stiffness=1e-9)
    s = suspension(springs=[spring, hold], mass_centre=(0.0, 0.0, 0.0))
    load = Harmonics(
        jnp.zeros((6, 2), complex).at[0].set(jnp.array([3.0, 1.0j])), jnp.asarray(40.0)
    )
    w = np.array([40.0, 80.0])
    expected = np.array([3.0, 1.0j]) / (8000.0 - 7.5 * w**2 + 1j * w * 20.0)
    np.testing.assert_allclose(block_response(s, load).amplitude[0], expected, rtol=1e-10)


def simulate_block(block, force, time, start):
    """Motion of the block in time, M x'' = F - C x' - S x, to 1e-8 a step."""
    full = matrices(block.rotor)
    inverse, stiffness, damping = 1 / jnp.diag(full.mass), full.stiffness, full.damping

    def rate(t, motion, args):
        inner = stiffness @ motion.displacement + damping @ motion.velocity
        return BlockMotion(motion.velocity, inverse * (force(t) - inner))

    steps = diffrax.PIDController(rtol=1e-8, atol=1e-11)
    return diffrax.diffeqsolve(
        diffrax.ODETerm(rate), diffrax.Dopri8(), time[0], time[-1], None, start,
        saveat=diffrax.SaveAt(ts=time), stepsize_controller=steps, max_steps=100_000,
    ).ys  # fmt: skip


def test_settled_simulation_equals_the_harmonic_response():
    s = suspension(damping_ratio=0.1)
    _, _, load = first_harmonic(damping_ratio=0.1)
    response = block_response(s, load)
    time = jnp.linspace(0.0, 0.25, 60)
    begin = time_response(response, time[:1])
    start = BlockMotion(begin.displacement[0], begin.velocity[0])

    def force(t):
        return load.at(t[None])[:, 0]

    run = jax.jit(lambda time, start: simulate_block(s, force, time, start))
    settled = time_response(response, time)
    # tolerance of the integrator, 1e-8 of 70 um over some twenty periods
    np.testing.assert_allclose(run(time, start).displacement, settled.displacement, atol=1e-10)
    # from rest the difference is a free vibration, which damping takes away: the slowest decay
    # of this suspension is 1.5/s, e^-9 after six seconds
    late = jnp.linspace(0.0, 6.0, 60)
    from_rest = run(late, BlockMotion(jnp.zeros(6), jnp.zeros(6)))
    gap = np.abs(from_rest.displacement - time_response(response, late).displacement)
    assert gap[0, 0] > 5e-5
    assert gap[-1].max() < 1e-3 * gap[0].max()


def test_free_body_error_falls_with_the_square_of_the_suspension_frequency():
    """(42) goes over to (43); its error is given by stiffness alone when there is no damping."""
    _, _, load = first_harmonic()
    point = (0.0, 0.0, -0.035)
    errors = [float(free_body_error(suspension(k, 0.0), load, point)[0]) for k in (1.0, 0.1, 0.01)]
    assert 0.005 < errors[0] < 0.02  # (4.2 to 5.8 Hz over 48 Hz)^2
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 10, rtol=0.1)
    one = suspension(
        springs=[Spring((0.0, 0.0, 0.0), axial_stiffness=8000.0, lateral_stiffness=8000.0)],
        mass_centre=(0.0, 0.0, 0.0),
    )
    only_x = Harmonics(jnp.zeros((6, 1), complex).at[0].set(1.0), jnp.asarray(100.0))
    ratio = 8000.0 / 7.5 / 100.0**2
    np.testing.assert_allclose(free_body_error(one, only_x, (0.0, 0, 0)), ratio, rtol=1e-10)


def test_free_body_amplitude_of_the_household_machine():
    """|X| = |(m_p + m_s) R - m_r e_cr|/M, 70 um, at any speed."""
    for speed in (200.0, 304.4):
        _, _, load = first_harmonic(speed)
        amplitude = free_body_response(suspension(), load).amplitude[0, 0]
        expected = ((0.110 + 0.022) * 0.0096 - 1.2 * 0.62e-3) / 7.5
        np.testing.assert_allclose(np.abs(amplitude), expected, rtol=1e-10)
    np.testing.assert_allclose(expected, 70e-6, rtol=0.01)  # two digits given


def test_gradient_of_the_vibration_equals_differences():
    """Every number of machine and suspension; also where a mode is degenerate."""

    def amplitude(tree):
        made, block = tree
        speed = 304.4
        angle = jnp.arange(32) * 2 * np.pi / 32
        state = CrankState(angle, jnp.full(32, speed), 300 * jnp.sin(2 * angle))
        step = jnp.full(32, 2 * np.pi / 32 / speed)
        load = harmonics(block, shaking_wrench(made, state), angle / speed, step, 3)
        corner = point_motion(block, block_response(block, load), (0.06, 0.05, 0.06))
        return 1e6 * jnp.sqrt(jnp.sum(corner.rms**2))  # [um]

    tree = (compressor(machine(**OFFSET)), suspension())
    flat, rebuild = ravel_pytree(tree)
    flat = np.asarray(flat)
    # second differences of an analytic function: h^2 relative, against rounding 1e-16/h
    h = 1e-5 * np.maximum(np.abs(flat), 1e-3)
    steps = np.diag(h)
    # one program for values and slopes
    both = jax.jit(jax.vmap(jax.value_and_grad(lambda x: amplitude(rebuild(x)))))
    points = np.concatenate([flat[None], flat + steps, flat - steps])
    values, slopes = jax.tree.map(np.asarray, both(points))
    gradient = slopes[0]
    assert np.all(np.isfinite(gradient))
    up, down = values[1:].reshape(2, -1)
    measured = (up - down) / (2 * h)
    np.testing.assert_allclose(gradient * h, measured * h, atol=2e-9, rtol=1e-6)
    assert np.sum(np.abs(np.asarray(gradient)) > 0) > 40


def test_no_nan_where_nothing_moves():
    zero = Harmonics(jnp.zeros((6, 2), complex), jnp.asarray(300.0))

    def rms(stiffness):
        return jnp.sum(block_response(suspension(stiffness), zero).rms)

    value, slope = jax.jit(jax.value_and_grad(rms))(1.0)
    assert value == slope == 0


def test_damping_ratio_of_the_springs():
    """A block that hangs on its springs without tilting has the ratio asked for."""
    s = suspension(mass_centre=(0.0, 0.0, 0.06))
    full = matrices(s.rotor)
    k, c, m = np.asarray(full.stiffness), np.asarray(full.damping), np.asarray(full.mass)
    for i in range(3):
        np.testing.assert_allclose(c[i, i] / (2 * np.sqrt(k[i, i] * m[i, i])), 0.03, rtol=1e-12)


def test_refuses_a_spring_without_direction():
    with pytest.raises(BadInput, match="direction"):
        Spring((0.0, 0.0, 0.0), axial_stiffness=1.0, axis=(0.0, 0.0, 0.0))


def test_suspension_of_the_bundled_machine():
    """Its section describes the block of these tests; every value has a source."""
    scene = load("slider-link-8cc")
    assert eqx.tree_equal(
        scene.parts["suspension"], suspension(), typematch=True, rtol=2e-4
    )  # damping is given with four digits
    rows = [row for row in describe(scene) if row.path.startswith("suspension.")]
    assert len(rows) == 5 + 4 * 6
    assert all(row.source.startswith("assumed") or row.source == "default" for row in rows)
    again = loads(dump(scene))
    assert eqx.tree_equal(again.parts["suspension"], scene.parts["suspension"])


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("suspension.springs.2.axial_stiffness", "-1 N/mm", "must be >= 0 N/m"),
        ("suspension.springs.0.lateral_stiffness", "2 kg", "another dimension"),
        ("suspension.springs.1.position", ["1 mm", "2 mm"], "a list of 3 values"),
        ("suspension.springs.1.axis", [0, 0, 0], "whose axis has a direction"),
        ("suspension.mass", "0 kg", "must be > 0 kg"),
        ("suspension.inertia_z", None, "is missing"),
        ("suspension.spring", 1, "did you mean"),
    ],
)
def test_refuses_a_wrong_suspension(path, value, message):
    with pytest.raises(SceneError, match=message) as caught:
        with_value(load("slider-link-8cc"), path, value)
    assert "suspension" in str(caught.value)


def test_retuned_suspension_keeps_its_damping_ratios():
    s, other = suspension(), with_scaled_frequencies(suspension(), 0.3)
    np.testing.assert_allclose(natural_frequencies(other), 0.3 * natural_frequencies(s), rtol=1e-12)
    damping, before = (matrices(one.rotor).damping for one in (other, s))
    np.testing.assert_allclose(damping, 0.3 * before, atol=1e-12)


def test_refuses_an_unknown_mechanism():
    with pytest.raises(TypeError, match="No shaking forces"):
        shaking_wrench(object(), None)
