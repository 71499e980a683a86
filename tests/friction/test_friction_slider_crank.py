import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from helpers import (
    FRICTION,
    PINS,
    WALL,
    coulomb,
    difference,
    every_leaf_finite,
    laws,
    machine,
    named_leaves,
    nudged,
    random_crankshafts,
    random_mechanisms,
    regularised,
)

from jaxcomp import BadInput, Compressor
from jaxcomp.compressor import loads_at
from jaxcomp.friction import CoulombJournal, CoulombSlide, PistonFilm, SliderCrankFriction
from jaxcomp.friction._joint_loads import relative
from jaxcomp.mechanism import CrankState, SliderCrank, rod_motion
from jaxcomp.motor import ConstantTorque

COUNT = 300
JOINTS = ("wall", "piston_pin", "crank_pin", "main_journal")


def random_states(rng, count=COUNT):
    state = CrankState(
        jnp.asarray(rng.uniform(0, 2 * np.pi, count)),
        jnp.asarray(rng.uniform(20, 200, count) * rng.choice([-1, 1], count)),
        jnp.asarray(rng.uniform(-2e3, 2e3, count)),
    )
    return state, jnp.asarray(rng.uniform(-5e3, 2e4, count))


def joints(friction, mechanism=None):
    """Loads of one mechanism with that friction, as a compiled function of state and gas force."""
    compressor = machine(friction=friction)
    if mechanism is not None:
        compressor = dataclasses.replace(compressor, mechanism=mechanism, gas=None)
    return lambda state, gas: run(compressor, state, gas)


def loads_of(compressor, state, gas=None):
    """Loads of a machine with one cylinder under a gas force [N] (n,), its margin as (n,)."""
    loads = loads_at(compressor, state, None if gas is None else jnp.asarray(gas)[None])
    return dataclasses.replace(loads, margin=loads.margin[0])


run = jax.jit(loads_of)


# ---------------------------------------------------------------- the loop is solved
@pytest.fixture(scope="module")
def random_loads():
    rng = np.random.default_rng(4)
    machines = random_mechanisms(rng, COUNT)
    state, gas = random_states(rng)
    gravity = jnp.asarray(rng.uniform(-10, 10, (COUNT, 2)))
    # all coefficients of lubricated and of dry joints
    scale = jnp.asarray(rng.uniform(0, 3, COUNT))

    def loads(mechanism, crankshaft, state, gas, gravity, scale):
        given = coulomb(scale)
        shaft = dataclasses.replace(crankshaft, main_journal=given.main_journal)
        parts = ConstantTorque(0.0), None, given.friction, gravity
        compressor = Compressor(mechanism, shaft, *parts)
        return loads_of(compressor, state, gas)

    shafts = random_crankshafts(rng, COUNT)
    answer = jax.jit(jax.vmap(loads))(machines, shafts, state, gas, gravity, scale)
    numbers = {f.name: getattr(machines, f.name) for f in dataclasses.fields(SliderCrank)}
    numbers |= {f"crank_{n}": getattr(shafts, n) for n in ("inertia", "mass", "unbalance")}
    return numbers, state, gas, gravity, scale, answer


def test_loop_is_closed_to_rounding_at_random_states(random_loads):
    loads = random_loads[-1]
    free = np.asarray(loads.margin) > 0.3
    assert free.sum() > 0.9 * COUNT
    # a double carries 16 digits, and the terms of the loop may exceed the yardstick a few times
    np.testing.assert_allclose(loads.residual[free], 0.0, atol=1e-13)


def test_side_force_equals_bracketed_root_of_an_independent_equation(random_loads):
    numbers, state, gas, gravity, scale, loads = random_loads
    seen = 0
    for i in range(0, COUNT, 5):
        if loads.margin[i] < 0.3:
            continue
        values = {name: float(value[i]) for name, value in numbers.items()}
        s = float(scale[i])
        pins = {name: (s * mu, d) for name, (mu, d) in PINS.items()}
        twin = reference.Machine(**values, gravity=tuple(gravity[i]), wall=s * WALL, pins=pins)
        motion = (float(x[i]) for x in state)
        n, _ = twin.side_force(*motion, float(gas[i]))
        size = max(abs(n), float(jnp.hypot(*loads.forces["piston_pin"][i])))
        # the bracket ends at 1e-13 of its width, the reference's own rounding comes on top
        assert abs(float(loads.forces["wall"][i, 1]) - n) < 1e-10 * size
        seen += 1
    assert seen > 50


def test_whole_balance_equals_the_matrix_form():
    """Forces, losses and acceleration against a 12 x 12 system solved by fixed point."""
    rng = np.random.default_rng(7)
    compressor = machine(offset=0.02, gravity=(3.0, -9.0))
    twin = reference.from_compressor(compressor)
    for _ in range(20):
        angle, speed, torque = rng.uniform(0, 6.28), rng.uniform(50, 200), rng.uniform(-100, 100)
        answer, losses, _ = twin.solve(angle, speed, torque)
        loads = run(compressor, CrankState(*map(jnp.asarray, (angle, speed, answer[0]))))
        got = np.concatenate([loads.forces[k] for k in JOINTS[1:]] + [loads.forces["wall"][1:]])
        size = np.max(np.abs(answer[5:]))
        np.testing.assert_allclose(got / size, answer[5:] / size, atol=1e-11)
        for name in JOINTS:
            assert float(loads.loss_torque[name]) == pytest.approx(
                losses[name], rel=1e-9, abs=1e-9 * size * 0.05
            )


def test_friction_takes_energy_at_every_joint(random_loads):
    """The power lost is never negative, whichever way the crank turns."""
    *_, loads = random_loads
    speed = random_loads[1].speed
    free = np.asarray(loads.margin) > 0
    for name, torque in loads.loss_torque.items():
        assert np.all(np.asarray(torque * speed)[free] >= 0), name


def test_laws_are_those_of_the_paper():
    """Tsuji et al. (2012) Eq. (4): mu times load, times the radius of the pin."""
    loads = joints(coulomb())(state := CrankState(*map(jnp.asarray, (1.0, 100.0, 50.0))), 5e3)
    rod = rod_motion(machine().mechanism, state.angle)
    side = abs(float(loads.forces["wall"][1]))
    assert abs(float(loads.forces["wall"][0])) == pytest.approx(WALL * side, rel=1e-14)
    rates = {"piston_pin": abs(rod.tilt_1), "crank_pin": 1 + rod.tilt_1, "main_journal": 1.0}
    for name, rate in rates.items():
        mu, diameter = PINS[name]
        load = float(jnp.hypot(*loads.forces[name]))
        assert float(loads.loss_torque[name]) == pytest.approx(
            mu * load * diameter / 2 * float(rate), rel=1e-14
        )


def test_losses_scale_with_the_coefficients_and_vanish_with_them():
    state, gas = random_states(np.random.default_rng(5), 20)
    losses = [joints(coulomb(scale))(state, gas).total_loss_torque for scale in (0.0, 1e-6, 2e-6)]
    np.testing.assert_array_equal(losses[0], 0.0)
    # the coupling adds a share of the order of the coefficients
    np.testing.assert_allclose(losses[2], 2 * losses[1], rtol=1e-5)


# ---------------------------------------------------------------- other laws
def test_regularised_law_tends_to_coulomb():
    state, gas = random_states(np.random.default_rng(6), 40)
    sharp = joints(coulomb())(state, gas).total_loss_torque
    errors = []
    for v0 in (0.3, 0.1, 1e-4):
        smooth = joints(regularised(v0))(state, gas).total_loss_torque
        errors.append(float(jnp.max(jnp.abs(smooth - sharp)) / jnp.max(sharp)))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-3  # only a state right at a dead centre still feels 1e-4 m/s


def test_regularised_law_is_smooth_through_rest():
    law = regularised(0.05).friction
    assert law.wall.force(100.0, jnp.asarray(0.0)) == 0
    slope = jax.grad(law.wall.force, argnums=1)(100.0, 0.0)
    assert slope == pytest.approx(WALL * 100 / 0.05)
    slope = jax.grad(law.crank_pin.moment, argnums=1)(100.0, 0.0)
    assert slope == pytest.approx(0.013 * 100 * 0.045 * 0.045 / 0.05)


def test_film_loss_is_couette_flow_in_the_gap():
    """Dagilis et al. (I) Eq. (7): shear stress times wetted area, whatever the load."""
    film = PistonFilm(5e-5, 0.05, 0.1)
    state, gas = random_states(np.random.default_rng(8), 30)
    compressor = machine(friction=SliderCrankFriction(piston_film=film))
    loads = run(compressor, state, gas)
    _, x_1, _ = compressor.mechanism.piston(state.angle)
    area = np.pi * 0.130 * 0.1
    expected = 0.05 * area * (x_1 * state.speed) / 5e-5 * x_1
    np.testing.assert_allclose(loads.loss_torque["piston_film"], expected, rtol=1e-13)
    np.testing.assert_array_equal(loads.margin, 1.0)


def test_film_without_length_is_refused():
    with pytest.raises(ValueError, match=r"piston_film\.length"):
        SliderCrankFriction(piston_film=PistonFilm(5e-5, 0.05))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: CoulombSlide(-0.1), "`coefficient` must be >= 0"),
        (lambda: CoulombSlide(np.nan), "`coefficient` must be >= 0, but is nan"),
        (lambda: CoulombJournal(0.1, 0.0), "`diameter` must be > 0"),
        (lambda: PistonFilm(0.0, 0.05, 0.1), "`radial_clearance` must be > 0"),
    ],
)
def test_bad_law_is_refused_by_name(build, words):
    with pytest.raises(BadInput) as caught:
        build()
    assert words in str(caught.value)


# ---------------------------------------------------------------- margin
def roots_by_branches(coefficient, tangent, sliding, load):
    """Side forces N with N + tan(phi)(load - sliding mu |N|) = 0, found side by side."""
    found = []
    for side in (1.0, -1.0):
        slope = 1 - tangent * sliding * coefficient * side
        if slope != 0:
            n = -tangent * load / slope
            if n * side > 0:
                found.append(n)
    return found


def test_margin_is_positive_exactly_where_the_side_force_is_unique():
    """Wall friction up to a coefficient of 10, all branches enumerated for both signs of load."""
    rng = np.random.default_rng(9)
    slender = SliderCrank(0.1, 0.05, 0.11, 0.0, 0.0)
    locked = free = 0
    for coefficient in (0.1, 1.0, 2.0, 5.0, 10.0):
        solve = joints(SliderCrankFriction(wall=CoulombSlide(coefficient)), slender)
        angle = jnp.asarray(rng.uniform(0, 2 * np.pi, 60))
        state = CrankState(angle, jnp.full(60, 10.0), jnp.zeros(60))
        loads = {sign: solve(state, jnp.full(60, sign * 1e3)) for sign in (1.0, -1.0)}
        rod = rod_motion(slender, angle)
        tangent = np.asarray(rod.sin_tilt / rod.cos_tilt)
        for i in range(60):
            sliding = np.sign(float(rod.position_1[i]))
            # the loop for T_x = -gas - sliding mu |N|
            roots = {
                s: roots_by_branches(coefficient, tangent[i], sliding, -s * 1e3) for s in loads
            }
            unique = all(len(r) == 1 for r in roots.values())
            assert (float(loads[1.0].margin[i]) > 0) == unique, (coefficient, float(angle[i]))
            free, locked = free + unique, locked + (not unique)
            if unique:
                for s, found in loads.items():
                    got = float(found.forces["wall"][1, i])
                    assert got == pytest.approx(roots[s][0], rel=1e-12)
    assert min(free, locked) > 30  # both happened


def test_margin_is_that_of_the_wall_and_falls_with_friction():
    angle = jnp.linspace(0, 2 * jnp.pi, 50)
    state = CrankState(angle, jnp.full(50, 100.0), jnp.zeros(50))
    rod = rod_motion(machine().mechanism, angle)
    loads = joints(SliderCrankFriction(wall=CoulombSlide(0.5)))(state, jnp.full(50, 1e3))
    moving = jnp.abs(rod.position_1) > 1e-9
    expected = 1 - 0.5 * jnp.abs(rod.sin_tilt / rod.cos_tilt) * moving
    np.testing.assert_allclose(loads.margin, expected, rtol=1e-12)


def test_margin_with_heavy_pins_is_off_by_their_share_at_most():
    """The margin is the smaller slope at large loads; between, where a pin load turns, it may dip.

    The dip is at most twice the share of the pins, mu d/(2 l cos(phi)) each: 1e-2 at ordinary
    coefficients. The pins here are absurdly heavy, to see it.
    """
    heavy = SliderCrankFriction(
        wall=CoulombSlide(0.3),
        piston_pin=CoulombJournal(1.0, 0.10),
        crank_pin=CoulombJournal(1.0, 0.15),
    )
    compressor = machine(friction=heavy)
    twin = reference.from_compressor(compressor)
    state, gas = random_states(np.random.default_rng(10), 40)
    margin = run(compressor, state, gas).margin
    dips = []
    for i in range(40):
        motion = [float(x[i]) for x in state]
        n, excess = twin.side_force(*motion, float(gas[i]))
        x = n + np.linspace(-5e4, 5e4, 801)
        arm = compressor.mechanism.conrod_length * np.cos(twin.rod_angle(motion[0]))
        slopes = np.diff([excess(v) for v in x]) / np.diff(x) / float(arm)
        share = (0.5 * 0.10 + 0.5 * 0.15) / float(arm) * np.hypot(1.0, 0.3)
        dips.append((float(margin[i]) - np.min(slopes)) / share)
    assert max(dips) < 2.0
    assert max(dips) > 0.1  # there is something to see


# ---------------------------------------------------------------- cost
def operations(friction, **parts):
    compressor = machine(friction=friction, **parts)
    angle = jnp.linspace(0, 6, 64)
    state = CrankState(angle, jnp.full(64, 100.0), jnp.zeros(64))
    # the force is given, so that the count is that of the joints
    lowered = jax.jit(loads_of).lower(compressor, state, jnp.ones(64))
    # with all passes: other tests compile without those over loops, which take work out of them
    program = lowered.compile(compiler_options={"xla_disable_hlo_passes": ""})
    return program.cost_analysis()["flops"]


def test_absent_laws_cost_nothing():
    nothing = operations(None)
    assert operations(SliderCrankFriction()) == nothing
    full = operations(coulomb())
    lean = operations(laws(main_journal=CoulombJournal(0.013, 0.092)))
    # the main journal is outside the loop: 50 operations at each of 64 states, most of them twice,
    # for the loss and for the mark of a load that comes close to zero
    assert lean - nothing < 64 * 100
    wall = operations(SliderCrankFriction(wall=CoulombSlide(0.083)))
    assert nothing < lean < wall < full


# ---------------------------------------------------------------- derivatives
def total(compressor, state, gas):
    """Something that depends on everything: the losses and the pin forces."""
    loads = loads_of(compressor, state, gas)
    forces = sum(jnp.sum(f**2) for f in loads.forces.values())
    return jnp.sum(loads.total_loss_torque) + 1e-7 * forces


STATE = CrankState(*map(jnp.asarray, (0.9, 100.0, 40.0)))
# one program for values and slopes: to compile another takes longer than its answers
value_and_gradient = jax.jit(jax.value_and_grad(total, argnums=(0, 1, 2)))


@pytest.mark.parametrize(
    "law", ["coulomb", pytest.param("regularised", marks=pytest.mark.slow), "film"]
)
def test_gradient_equals_finite_differences(law):
    point = (
        machine(friction=FRICTION[law], offset=0.01, gravity=(2.0, -9.0)),
        STATE,
        jnp.asarray(4e3),
    )
    # numbers of NumPy, whose changes compile nothing
    point = jax.tree.map(np.asarray, point)
    exact = named_leaves(value_and_gradient(*point)[1])
    leaves = named_leaves(point)
    forward = jax.jit(lambda p, t: jax.jvp(total, p, t)[1])
    for name, leaf in leaves.items():
        for index in np.ndindex(leaf.shape):
            unit = np.zeros(leaf.shape)
            unit[index] = 1.0
            step = 1e-3 * (float(np.abs(leaf[index])) or 1e-2)

            def value(t, name=name, unit=unit):
                return float(value_and_gradient(*nudged(point, name, t * unit))[0])

            estimate = difference(value, 0.0, step)
            got = float(exact[name][index])
            # fourth order with h = 1e-3: h^4 = 1e-12 of the size, rounding 1e-16 |f|/h
            assert got == pytest.approx(estimate, rel=1e-7, abs=1e-11 * 300 / step), name
            if name.endswith(("conrod_length", "angle")):  # forward mode gives the same
                tangent = jax.tree.map(np.zeros_like, point)
                assert float(forward(point, nudged(tangent, name, unit))) == pytest.approx(
                    got, rel=1e-12
                )


def test_hessian_equals_differences_of_the_gradient():
    point = (machine(offset=0.01), STATE, jnp.asarray(4e3))
    names = ["[0].mechanism.conrod_length", "[0].friction.wall.coefficient", "[1].acceleration"]
    names += ["[0].friction.crank_pin.diameter", "[2]"]

    def along(values):
        moved = point
        for name, value in zip(names, values, strict=True):
            moved = nudged(moved, name, value)
        return total(*moved)

    sizes = jnp.asarray([0.3, 0.08, 1e3, 0.09, 4e3])
    scaled = lambda u: along(u * sizes)  # noqa: E731
    hessian = jax.jit(jax.hessian(scaled))(jnp.zeros(5))
    gradient = jax.jit(jax.grad(scaled))
    estimate = np.stack(
        [
            difference(lambda t, unit=unit: np.asarray(gradient(t * unit)), 0.0, 1e-3)
            for unit in np.eye(5)
        ]
    )
    # entries are of order one to ten; the differences carry h^4 and rounding over h
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-10)
    np.testing.assert_allclose(hessian, estimate, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize(
    "law",
    [
        # those of one joint are parts of "coulomb"
        law if law in ("none", "coulomb", "film") else pytest.param(law, marks=pytest.mark.slow)
        for law in FRICTION
    ],
)
def test_everything_is_finite_at_dead_centres_and_at_zero_load(law):
    """Also the derivatives, where loads vanish and sliding directions turn."""
    friction = FRICTION[law]
    massless = machine(friction=friction, piston_mass=0.0, conrod_mass=0.0, unbalance=0.0)
    whole = machine(friction=friction)
    both = jax.jit(lambda *args: (loads_of(*args), jax.grad(total, argnums=(0, 1, 2))(*args)))
    top, bottom = whole.mechanism.dead_centres()
    for angle in (top, bottom, np.pi / 2, 1.0):
        for speed in (100.0, 0.0):
            # arrays of NumPy are of one type, and of one program
            state = CrankState(*(np.asarray(number, float) for number in (angle, speed, 0.0)))
            for compressor, gas in ((massless, 0.0), (whole, 0.0), (whole, 1e4)):
                assert every_leaf_finite(both(compressor, state, np.asarray(gas)))


def test_rounding_is_no_residual_where_all_loads_vanish():
    """At an instant without any load 1e-15 N is left of sums of terms of 1e3 N."""
    left, size = jnp.array([1e-13, 1e-6, -2e-13]), jnp.array([0.0, 1.0, 1e3])
    found = relative(left, size)
    assert abs(float(found[0])) < 1e-9
    np.testing.assert_allclose(
        found[1], 1e-6, rtol=2e-3
    )  # counted but for a millionth of the largest
