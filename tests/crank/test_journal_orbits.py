"""Orbits of journals in their films: golden values, an independent march, limits, failures, the crank."""

import itertools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tools import squeeze_tables

from jaxcomp import ConstantSpeed, SolveFailed, Status, load, loads, simulate, solve_orbit
from jaxcomp._core.polynomials import gauss
from jaxcomp.compressor import instants, kink_angles, loop_of
from jaxcomp.crank import Collocation, Shooting, TimeIntegration, journal_films
from jaxcomp.crank._journal_orbit import journal_orbit, moved_films
from jaxcomp.film import JournalBearing
from jaxcomp.film._bearing import film_unit, squeeze_of
from jaxcomp.film._running import stiffness_damping
from jaxcomp.mechanism import CrankState, rod_motion
from jaxcomp.scene import with_value
from jaxcomp.study import available_quantities

SPEED = 1000 * np.pi / 30
PIN = {"type": "film", "motion": "orbit", "diameter": "90 mm", "length": "45 mm",
       "radial_clearance": "45 um", "dynamic_viscosity": "10 mPa s"}  # fmt: skip
# The fitted constants that the golden orbit was computed with, before they were fitted anew.
OLDER = {"mechanism.conrod_inertia": "0.005380 kg m^2", "crankshaft.inertia": "0.1566 kg m^2",
         "crankshaft.unbalance": "-0.336325 kg m", "gas.clearance_ratio": "0.76 %"}  # fmt: skip
# Where the load comes close to zero there, and its kinks: panels are graded towards these.
NEAR_ZERO = np.radians([11.268, 80.316, 284.328])
# Of them and of the kinks of that load, at quarters of a revolution and where gas begins to flow.
KINKS = 9


@pytest.fixture(scope="module")
def frictionless():
    scene = load("mayekawa-wbhe")
    for name, value in OLDER.items():
        scene = with_value(scene, name, value)
    return eqx.tree_at(lambda c: c.friction, scene.as_compressor(), None)


def pin_load(compressor):
    """[N] Load on the crank pin, and the rate of the rod over the crank's, over the crank angle."""

    @jax.jit
    def at(angle):
        now = instants(compressor, angle)
        state = CrankState(angle, jnp.full_like(angle, SPEED), jnp.zeros_like(angle))
        loop = loop_of(compressor, state, now.gas_force, now.kinematics)
        return -loop.loads(loop.loops.start(), False).forces["crank_pin"]

    return at, jax.jit(lambda angle: -rod_motion(compressor.mechanism, angle).tilt_1)


def fine_edges(compressor, widest=0.15):
    edges = np.append(np.asarray(jax.jit(kink_angles)(compressor)), 0.0)
    edges[-1] = edges[0] + 2 * np.pi
    graded = [p + s * 0.1 * 0.15**k for p in NEAR_ZERO for k in range(5) for s in (-1, 1)]
    edges = np.sort(np.concatenate([edges, NEAR_ZERO, graded]))
    edges = edges[np.append(True, np.diff(edges) > 1e-9)]
    parts = [np.linspace(a, b, int(np.ceil((b - a) / widest)) + 1)[:-1]
             for a, b in itertools.pairwise(edges)]  # fmt: skip
    return np.append(np.concatenate(parts), edges[-1])


def golden_orbit(compressor, film, **changes):
    force, bush = pin_load(compressor)
    bearing = JournalBearing(**{"diameter": 0.09, "length": 0.045, "radial_clearance": 45e-6,
                              "dynamic_viscosity": 0.01, "film": film} | changes)  # fmt: skip
    edges = fine_edges(compressor)

    @jax.jit  # as one program: outside of one every operation of the preparation is compiled by itself
    def solved():
        return journal_orbit(bearing, force, SPEED, bush=bush, edges=edges, nodes=10)

    return bearing, solved()


def test_the_golden_orbit_of_the_short_film(frictionless):
    """Two independent solvers agreed on these digits (collocation, and time steps by DOP853)."""
    _, orbit = golden_orbit(frictionless, "short")
    film = orbit.film
    assert orbit.status == Status.converged
    assert float(film.minimum_film) == pytest.approx(13.228810054e-6, abs=1e-15)
    assert float(film.mean_shear_loss) == pytest.approx(78.4701353103, abs=2e-10)
    assert float(film.mean_squeeze_loss) == pytest.approx(5.4730533012, abs=2e-10)
    assert float(film.mean_flow) == pytest.approx(7127.98379912e-9, rel=2e-11)
    assert float(film.largest_pressure) == pytest.approx(8.43974915e6, rel=1e-9)
    first = gauss(10).through(np.zeros(1)) @ np.asarray(film.position)[:, :10].T
    np.testing.assert_allclose(first[0], [-0.52220916754, -0.44577693471], atol=2e-10)
    # the same loads carried steadily
    assert float(film.steady_film) == pytest.approx(11.03e-6, abs=5e-9)
    assert float(film.steady_loss) == pytest.approx(86.46, abs=5e-3)


def test_the_finite_film_gives_the_load_back_and_differs_from_the_short_one(frictionless):
    bearing, orbit = golden_orbit(frictionless, "reynolds")
    film = orbit.film
    # the bound of a bearing that has none of its own
    assert bearing.thin_film is None
    assert float(film.thin_share) == float(film.share_below(5e-6))
    # 4 digits from another table of the same film
    assert float(film.minimum_film) == pytest.approx(11.213e-6, rel=3e-4)
    assert float(film.mean_shear_loss + film.mean_squeeze_loss) == pytest.approx(87.73, rel=1e-4)
    assert float(film.steady_film) == pytest.approx(8.62e-6, rel=1e-3)
    assert float(film.steady_loss) == pytest.approx(91.78, rel=1e-3)
    # the full Reynolds equation along the orbit
    unit = float(film_unit(bearing))
    velocity = np.asarray(squeeze_of(bearing).mobility(film.position, film.load / unit))
    errors, largest = [], np.hypot(*film.load).max()
    for i in range(5, orbit.angle.size, orbit.angle.size // 16):
        e, v = np.asarray(film.position)[:, i], velocity[:, i]
        eps, line = np.hypot(*e), np.arctan2(e[1], e[0])
        solved = squeeze_tables.solve_film(eps, 0.5, np.arctan2(v[1], v[0]) - line)
        turn = np.array([[np.cos(line), -np.sin(line)], [np.sin(line), np.cos(line)]])
        force = unit * np.hypot(*v) * turn @ solved.force
        errors.append(np.hypot(*(force - np.asarray(film.load)[:, i])) / largest)
    assert np.max(errors) < 1e-4, errors


@pytest.mark.slow
def test_a_time_march_by_scipy_agrees_for_five_bearings(frictionless):
    """Clearances for largest eccentricity ratios of 0.1 to 0.98; DOP853 between the kinks."""
    force, bush = pin_load(frictionless)
    viscosities = np.array([0.27, 0.05, 0.01, 1.5e-3, 1.3e-4])
    edges, ends = fine_edges(frictionless), []
    for viscosity in viscosities:
        _, orbit = golden_orbit(frictionless, "short", dynamic_viscosity=viscosity)
        assert orbit.status == Status.converged
        ends.append(orbit)
    largest = [float(one.film.largest_eccentricity) for one in ends]
    assert largest[0] < 0.11, largest
    assert largest[-1] > 0.97, largest
    bearing = JournalBearing(0.09, 0.045, 45e-6, 1.0, "short")
    film, unit = squeeze_of(bearing), np.asarray(film_unit(bearing)) * viscosities

    @jax.jit
    def rate(angle, y):
        e, load = y.reshape(2, 5), force(angle[None])
        v = film.mobility(e, load / (unit * SPEED))
        return (v + 0.5 * (1 + bush(angle)) * jnp.stack([-e[1], e[0]])).ravel()

    e0 = np.stack([np.asarray(one.film.position)[:, 0] for one in ends], axis=1)
    y, first = e0.ravel(), float(ends[0].angle[0])
    for begin, end in itertools.pairwise([first, *edges[1:], first + 2 * np.pi]):

        def within(t, y, begin=begin, end=end):
            return np.asarray(rate(jnp.clip(t, begin + 1e-12, end - 1e-12), y))

        inner = solve_ivp(within, (begin, end), y, method="DOP853", rtol=1e-12, atol=1e-13)
        y = inner.y[:, -1]
    np.testing.assert_allclose(y.reshape(2, 5), e0, atol=1e-8)


def rotating(size, share):
    return lambda a: size * jnp.stack([jnp.cos(share * a), jnp.sin(share * a)])


# With a bound for what counts as thin, so that one program serves any bound.
BEARING = JournalBearing(0.04, 0.02, 30e-6, 0.02, thin_film=5e-6)


@pytest.mark.slow
def test_a_constant_load_is_carried_where_a_steady_film_carries_it():
    bearing = JournalBearing(0.04, 0.02, 30e-6, 0.02, "short")
    film = journal_orbit(bearing, lambda a: jnp.stack([0 * a + 2000.0, 0 * a]), 300.0).film
    np.testing.assert_allclose(np.ptp(np.asarray(film.position), axis=1), 0, atol=1e-10)
    assert float(film.minimum_film) == pytest.approx(float(film.steady_film), rel=1e-9)
    loss = film.mean_shear_loss + film.mean_squeeze_loss
    assert float(loss) == pytest.approx(float(film.steady_loss), rel=1e-9)
    # stiffness and damping are those of the steady film (Ocvirk's, of another program)
    steady = stiffness_damping(bearing, jnp.array([2000.0, 0.0]), 300.0, rest_speed=0.0)
    np.testing.assert_allclose(film.stiffness, steady.stiffness, rtol=1e-8)
    np.testing.assert_allclose(film.damping, steady.damping, rtol=1e-8)


@pytest.mark.parametrize("share", [-1, 1, 2])
def test_a_turning_load_sees_the_speed_less_twice_its_own(share):
    turning = journal_orbit(BEARING, rotating(1000.0, share), 300.0).film
    speed = 300.0 * abs(1 - 2 * share)
    still = journal_orbit(BEARING, rotating(1000.0, 0), speed).film
    assert float(turning.minimum_film) == pytest.approx(float(still.minimum_film), rel=1e-9)


def test_a_load_at_half_speed_collapses_the_film_by_name():
    # over two revolutions, so that the load is periodic
    orbit = journal_orbit(BEARING, rotating(1000.0, 1), 150.0, journal=2.0)
    assert orbit.status == Status.film_collapse
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(orbit.film))


@pytest.mark.slow
def test_two_lands_carry_half_the_load_each():
    one = journal_orbit(JournalBearing(0.04, 0.01, 30e-6, 0.02), rotating(500.0, 0.0), 300.0).film
    two = journal_orbit(
        JournalBearing(0.04, 0.02, 30e-6, 0.02, lands=2), rotating(1000.0, 0.0), 300.0
    ).film
    assert float(two.minimum_film) == pytest.approx(float(one.minimum_film), rel=1e-12)
    assert float(two.mean_shear_loss) == pytest.approx(2 * float(one.mean_shear_loss), rel=1e-12)
    assert float(two.mean_flow) == pytest.approx(2 * float(one.mean_flow), rel=1e-12)
    assert float(two.steady_loss) == pytest.approx(2 * float(one.steady_loss), rel=1e-12)


@jax.jit
def pulsing(a):
    return jnp.stack([1500.0 + 1000 * jnp.cos(a), 800 * jnp.sin(2 * a)])


def test_the_share_of_the_time_below_a_film():
    """Against the panel polynomials at 400 places on each panel, 48 panels of one width."""
    film = journal_orbit(BEARING, pulsing, 300.0, bush=0.3).film
    thickness = np.asarray(film.thickness).reshape(48, 8)
    fine = thickness @ gauss(8).through((np.arange(400) + 0.5) / 400).T
    for share in (0.2, 0.5, 0.9):
        bound = np.quantile(fine, share)
        # straight lines between 8 nodes a panel
        assert float(film.share_below(bound)) == pytest.approx(share, abs=2e-3)
    # the bound of a bearing; the default one stands with the golden orbit
    own = eqx.tree_at(lambda b: b.thin_film, BEARING, jnp.asarray(bound, float))
    assert float(journal_orbit(own, pulsing, 300.0, bush=0.3).film.thin_share) == pytest.approx(
        float(film.share_below(bound)), rel=1e-12
    )
    slope = jax.grad(lambda b: film.share_below(b))(bound)
    ends = [float(film.share_below(bound * (1 + s))) for s in (-1e-6, 1e-6)]
    assert float(slope) == pytest.approx((ends[1] - ends[0]) / (2e-6 * bound), rel=1e-5)


def test_mirror_scaling_and_the_power_of_the_moments():
    base = journal_orbit(BEARING, pulsing, 300.0, bush=0.3)
    film = base.film
    # the mirror image turns the other way
    mirror = journal_orbit(BEARING, lambda a: pulsing(a) * jnp.array([[1.0], [-1.0]]), 300.0,
                           journal=-1.0, bush=-0.3).film  # fmt: skip
    np.testing.assert_allclose(
        mirror.position, film.position * np.array([[1.0], [-1.0]]), atol=1e-10
    )
    # load, viscosity and speed enter as F psi^2/(eta w L D) only
    scaled = JournalBearing(0.08, 0.04, 30e-6, 0.01, thin_film=5e-6)
    alike = journal_orbit(scaled, lambda a: 16 * pulsing(a), 600.0 / 1.0, bush=0.3).film
    ratio = 16 * (0.5**2) / (0.5 * 2 * 4)
    other = journal_orbit(BEARING, lambda a: ratio * pulsing(a), 300.0, bush=0.3).film
    np.testing.assert_allclose(alike.position, other.position, atol=1e-10)
    assert np.min(film.squeeze_loss) >= 0
    # P = M_j w_j + M_b w_b + c F.de/dt: its mean with de/dt from the nodes' own polynomials
    e, force, c = film.position, film.load, 30e-6
    cross = e[0] * force[1] - e[1] * force[0]
    shear = film.shear_loss / (0.7 * 300.0)
    moments = (shear - c / 2 * cross) * 300.0 + (-shear - c / 2 * cross) * 90.0
    panels = np.asarray(e).reshape(2, 48, 8) @ gauss(8).derivative.T / (2 * np.pi / 48)
    work = c * 300.0 * np.sum(np.asarray(force) * panels.reshape(2, -1), axis=0)
    weight = np.asarray(film.duration / film.duration.sum())
    total = float(film.mean_shear_loss + film.mean_squeeze_loss)
    # derivatives of degree-8 interpolants lose some digits
    assert weight @ (np.asarray(moments) + work) == pytest.approx(total, rel=1e-8)
    assert abs(weight @ work) > 1e-4 * total


@pytest.mark.parametrize("case", ["no load", "no viscosity", "standing", "wide", "narrow", "heavy"])
def test_extreme_bearings_are_converged_or_flagged(case):
    changes = {"no viscosity": {"dynamic_viscosity": 1e-12}, "wide": {"radial_clearance": 1e-3},
               "narrow": {"radial_clearance": 1e-7}}.get(case, {})  # fmt: skip
    numbers = {
        "diameter": 0.04,
        "length": 0.02,
        "radial_clearance": 30e-6,
        "dynamic_viscosity": 0.02,
        "thin_film": 5e-6,
    }
    bearing = JournalBearing(**numbers | changes)
    size = {"no load": 0.0, "heavy": 1e5}.get(case, 1.0)
    rates = {"journal": 0.0, "bush": 0.0} if case == "standing" else {}
    # a constant load sinks a standing journal; a pulsing one may hold it in an orbit
    load_of = rotating(1000.0, 0) if case == "standing" else lambda a: size * pulsing(a)
    orbit = journal_orbit(bearing, load_of, 300.0, **rates)
    assert not any(np.any(np.isnan(leaf)) for leaf in jax.tree.leaves(orbit.film)), case
    known = {"no viscosity": "film_collapse", "standing": "film_collapse", "wide": "film_collapse",
             "heavy": "film_collapse"}  # fmt: skip
    assert orbit.status == getattr(Status, known.get(case, "converged")), Status[orbit.status]


def test_derivatives_of_the_orbit_are_those_of_differences():
    def read(numbers):
        bearing = JournalBearing(*numbers)
        film = journal_orbit(bearing, pulsing, 300.0, bush=0.3).film
        return jnp.stack([film.minimum_film * 1e6, film.mean_shear_loss + film.mean_squeeze_loss,
                          film.largest_pressure / 1e6])  # fmt: skip

    # Way and weights have every number and result in them, each by about its own size.
    numbers = np.array([0.04, 0.02, 30e-6, 0.02])
    way = numbers * np.array([0.7, -0.4, 0.5, 1.1])
    weights = np.array([0.5, -1.2, 0.8])

    @jax.jit  # values and both modes in one program, which solves once
    def along(share):
        value, push = jax.linearize(read, jnp.asarray(numbers) + share * way)
        (reverse,) = jax.linear_transpose(push, jnp.asarray(numbers))(jnp.asarray(weights))
        return value, push(jnp.asarray(way)), reverse

    step = 1e-5
    (fall, *_), (_, forward, reverse), (rise, *_) = (along(s) for s in (-step, 0.0, step))
    np.testing.assert_allclose(forward, (rise - fall) / (2 * step), rtol=1e-6)
    assert reverse @ way == pytest.approx(float(weights @ forward), rel=1e-8)
    # no number is without its share of it
    assert np.all(np.abs(reverse * way) > 1e-2 * np.abs(weights @ forward))


@pytest.fixture(scope="module")
def coupled():
    scene = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN)
    return scene.as_compressor()


@eqx.filter_jit  # which computes no more of the film than this
def film_of_pin(compressor, orbit):
    """Losses [W], least films [m] with the error of the first, shares of time below two thicknesses."""
    film = journal_films(compressor, orbit)["crank_pin"]
    loss = film.mean_shear_loss + film.mean_squeeze_loss
    least = film.minimum_film, film.film_error, film.steady_film
    shares = film.share_below(film.minimum_film), film.share_below(45e-6)
    return (loss, film.steady_loss), least, shares


def test_the_crank_finds_the_orbit_of_its_pin(coupled):
    orbit = solve_orbit(coupled)
    assert abs(orbit.energy.residual) < 1e-13
    (loss, steady_loss), (least, _, steady_film), shares = film_of_pin(coupled, orbit)
    # the loss is what shear and squeeze dissipate, and all of it is in the account
    assert float(orbit.loss_power["crank_pin"]) == pytest.approx(float(loss), rel=1e-9)
    # thicker films and less friction than a steady film has, as the golden orbit
    assert 1.2 < float(least / steady_film) < 1.4
    assert 0.94 < float(loss / steady_loss) < 0.98
    # below the least film and below the clearance
    assert shares == (0, 1)


@pytest.mark.slow
def test_a_march_of_the_crank_with_its_journal_agrees(coupled):
    # implicit: the fastest rate of the film is 1/(1 - eps) a radian
    march = TimeIntegration(diffrax.Kvaerno5(), tolerance=1e-9)
    fine = Collocation(nodes=14, reversals=coupled.load_reversals, grading=4)
    orbit = solve_orbit(coupled, fine, verify=march)
    seen = orbit.verification
    assert seen.position_error < 1e-6
    assert abs(seen.loss_error["crank_pin"]) < 1e-6 * orbit.energy.losses["crank_pin"]


@pytest.mark.slow  # half a minute of compilation each
@pytest.mark.parametrize("held", [False, True])
def test_shooting_finds_the_orbit_of_a_journal(held):
    """Crank and journal integrated from angle to angle; at a given speed as well as with a motor."""
    scene = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN | {"film": "short"})
    crank = scene.as_compressor()
    if held:
        speed = crank.motor.speed_guess
        crank = eqx.tree_at(lambda c: c.motor, crank, ConstantSpeed(speed))
    found, shot = (
        solve_orbit(crank, solver(reversals=crank.load_reversals))
        for solver in (Collocation, Shooting)
    )
    assert shot.solver == "shooting"
    # seen: 3e-10 of the work; 2e-10 of the journal's loss
    np.testing.assert_allclose(shot.mechanical_efficiency, found.mechanical_efficiency, atol=3e-9)
    losses = (one.energy.losses["crank_pin"] for one in (shot, found))
    np.testing.assert_allclose(*losses, rtol=1e-8)
    # at their nodes, which are not the same
    sizes = [float(jnp.max(jnp.hypot(*one.positions["crank_pin"]))) for one in (shot, found)]
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-3)


def test_a_film_that_closes_is_a_named_failure(coupled):
    viscosity = jnp.asarray(1e-8)  # an array, as it was: the program is that of the other orbits
    thin = eqx.tree_at(lambda c: c.friction.crank_pin.dynamic_viscosity, coupled, viscosity)
    with pytest.raises(SolveFailed, match="film of a journal closes"):
        solve_orbit(thin)
    orbit = solve_orbit(thin, throw=False)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(orbit.loads))


@pytest.mark.slow
def test_derivatives_of_the_coupled_orbit_are_those_of_differences(coupled):
    solver = Collocation(reversals=coupled.load_reversals)

    def read(numbers):
        viscosity, clearance, bore = numbers
        made = eqx.tree_at(
            lambda c: (c.friction.crank_pin.dynamic_viscosity,
                       c.friction.crank_pin.radial_clearance, c.mechanism.bore),
            coupled, (viscosity, clearance, bore))  # fmt: skip
        orbit = solve_orbit(made, solver, throw=False)
        film = journal_films(made, orbit)["crank_pin"]
        return jnp.stack([film.minimum_film * 1e6, orbit.loss_power["crank_pin"]])

    numbers = jnp.array([0.01, 45e-6, 0.13])
    read = jax.jit(read)
    slopes = jax.jit(jax.jacfwd(read))(numbers)
    for i in range(3):
        step = 1e-5 * numbers[i] * jnp.eye(3)[i]
        difference = (read(numbers + step) - read(numbers - step)) / (2 * step[i])
        np.testing.assert_allclose(slopes[:, i], difference, rtol=1e-5)


@pytest.mark.slow
def test_a_run_in_time_settles_on_the_orbit():
    """From the running speed, with a stiff motor, three revolutions end on the periodic orbit."""
    motor = {"type": "slip_line", "slope": "200 N m s", "synchronous_speed": "1000 rpm"}
    scene = with_value(with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN), "motor", motor)
    orbit = solve_orbit(scene)
    options = TimeIntegration(diffrax.Kvaerno3(), tolerance=1e-5, samples=721)
    speed, period = float(orbit.mean_speed), float(orbit.period)
    run = simulate(scene, 3 * period, speed=speed, options=options)
    assert np.max(np.abs(run.residual)) < 1e-4
    last = np.asarray(run.time) >= 2 * period
    path = np.asarray(run.positions["crank_pin"])
    eps = np.hypot(*path[:, last])
    largest = float(orbit.largest(jnp.hypot(*orbit.positions["crank_pin"])))
    assert eps.max() == pytest.approx(largest, abs=2e-3)
    # journals start in the centre
    np.testing.assert_array_equal(path[:, 0], 0)


@pytest.mark.slow
def test_a_machine_with_a_moving_journal_starts_from_rest():
    """A journal at rest in the middle, no wedge and no squeeze at first; the film then carries."""
    motor = {"type": "slip_line", "slope": "200 N m s", "synchronous_speed": "1000 rpm"}
    scene = with_value(with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN), "motor", motor)
    options = TimeIntegration(diffrax.Kvaerno3(), tolerance=1e-4, samples=401)
    run = simulate(scene, 0.1, options=options)
    assert run.status == Status.converged
    assert np.max(np.abs(run.residual)) < 1e-3  # the tolerance, over hundreds of steps
    eps = np.hypot(*np.asarray(run.positions["crank_pin"]))
    assert eps[0] == 0
    assert 0.5 < eps.max() < 0.95
    assert float(run.state.speed[-1]) > 100


def test_films_are_quantities_of_machines_that_have_them():
    scene = with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN)
    known = available_quantities(scene.machine, members=True)
    for family in ("film_thickness", "film_pressure", "film_flow", "film_temperature_rise",
                   "thin_film_share", "steady_film_thickness", "steady_film_loss"):  # fmt: skip
        assert f"{family}.crank_pin" in known
    assert not any("film" in name for name in available_quantities(load("mayekawa-wbhe").machine))


@pytest.mark.slow
def test_every_pin_of_several_cylinders_has_its_orbit(coupled):
    scene = with_value(load("mayekawa-4wbhe"), "friction.crank_pin", PIN)
    orbit = solve_orbit(scene)
    films = journal_films(scene.as_compressor(), orbit)
    alone = journal_films(coupled, solve_orbit(coupled))["crank_pin"].minimum_film
    assert set(films) == {f"crank_pin_{k}" for k in (1, 2, 3, 4)}
    for name, film in films.items():
        # the cylinders see the same gas and almost the same speed
        assert float(film.minimum_film) == pytest.approx(float(alone), rel=0.02)
        loss = float(film.mean_shear_loss + film.mean_squeeze_loss)
        assert float(orbit.loss_power[name]) == pytest.approx(loss, rel=1e-6)


@pytest.mark.slow
def test_the_three_journals_of_a_slider_link_machine_move():
    text = load("slider-link-8cc").text
    for name in ("crank-pin", "upper-bearing", "lower-bearing"):
        text = text.replace(
            f'[bearings.{name}]\ntype = "film"',
            f'[bearings.{name}]\ntype = "film"\nmotion = "orbit"',
        )
    # what the films that carry a steady load say that they would do, and which is right to 4 digits
    still = load("slider-link-8cc")
    said = moved_films(still.as_compressor(), solve_orbit(still))["crank_pin"]
    assert float(said.minimum_film) == pytest.approx(5.25e-6, rel=1e-3)
    assert float(said.mean_shear_loss + said.mean_squeeze_loss) == pytest.approx(0.985, rel=1e-3)
    scene = loads(text)
    orbit = solve_orbit(scene)
    assert abs(orbit.energy.residual) < 1e-12
    film = journal_films(scene.as_compressor(), orbit)["crank_pin"]
    # four digits, by another program: quasi-static 3.43 um and 1.010 W, orbit 5.25 um and 0.985 W
    assert float(film.minimum_film) == pytest.approx(5.25e-6, rel=1e-3)
    assert float(film.mean_shear_loss + film.mean_squeeze_loss) == pytest.approx(0.985, rel=1e-3)
    assert float(film.steady_film) == pytest.approx(3.43e-6, rel=3e-3)
    assert float(film.steady_loss) == pytest.approx(1.010, rel=1e-3)


# ---------------------------------------------------------------- thin films
# [rad] As many edges without kinks, where panels end anyway: one program serves with and without.
EVEN = np.asarray(jnp.linspace(0, 2 * np.pi, 49))[:KINKS]


@pytest.mark.parametrize("viscosity", [1e-3, pytest.param(1e-4, marks=pytest.mark.slow)])
def test_thin_films_are_those_of_a_march_by_scipy(viscosity):
    """Least films of 1 and of 0.1 µm; Radau from the place that the orbit has at its first node."""
    bearing = JournalBearing(0.04, 0.02, 30e-6, viscosity, "short")
    orbit = journal_orbit(bearing, pulsing, 300.0, bush=0.3, edges=EVEN)
    assert orbit.status == Status.converged
    film, unit = squeeze_of(bearing), float(film_unit(bearing)) * 300.0

    def rate(e, angle):
        v = film.mobility(e[:, None], pulsing(angle)[:, None] / unit)[:, 0]
        rates = v + 0.65 * jnp.stack([-e[1], e[0]])
        return rates, rates

    # values are those beside the slopes: to compile another program takes longer
    both, first = jax.jit(jax.jacfwd(rate, has_aux=True)), float(orbit.angle[0])
    turn = np.linspace(first, first + 2 * np.pi, 4001)
    found = solve_ivp(
        lambda t, e: np.asarray(both(e, np.asarray(t))[1]), (turn[0], turn[-1]),
        np.asarray(orbit.film.position)[:, 0], method="Radau",
        jac=lambda t, e: np.asarray(both(e, np.asarray(t))[0]), t_eval=turn, rtol=1e-9, atol=1e-11,
    )  # fmt: skip
    np.testing.assert_allclose(found.y[:, -1], found.y[:, 0], atol=1e-8)
    least = 30e-6 * (1 - np.hypot(*found.y).max())
    true = abs(float(orbit.film.minimum_film) / least - 1)
    # 4,001 instants miss the least film by the square of their distance, 1e-6 of it
    assert true < 1e-4
    assert true * least < float(orbit.film.film_error) + 1e-5 * least


# [m] least films by viscosity [Pa s], of Collocation(panel_count=96, nodes=12)
THIN = {1e-3: 1.6778699684e-6, 3e-4: 4.944612783e-7, 1e-4: 1.531090126e-7}


def test_the_crank_resolves_thin_films_by_default(coupled):
    """The default's 24 panels beside four times as many with 12 nodes each."""

    def least(viscosity):
        at = jnp.asarray(viscosity, float)
        made = eqx.tree_at(lambda c: c.friction.crank_pin.dynamic_viscosity, coupled, at)
        orbit = solve_orbit(made, throw=False)
        _, (thickness, error, _), _ = film_of_pin(made, orbit)
        return thickness, error, orbit.converged

    for viscosity, wanted in THIN.items():
        found, error, converged = least(viscosity)
        assert bool(converged)
        assert float(found) == pytest.approx(wanted, rel=1e-3)
        assert abs(float(found) - wanted) < float(error) < 0.01 * wanted


def test_a_coarse_orbit_is_no_collapse(frictionless):
    """A film of 0.02 µm needs panels that end at the kinks of its load; one without oil has none."""
    force, bush = pin_load(frictionless)
    kinks = np.sort(np.append(np.asarray(jax.jit(kink_angles)(frictionless)), NEAR_ZERO))

    assert kinks.size == KINKS

    def status(viscosity, edges=EVEN):
        bearing = JournalBearing(0.09, 0.045, 45e-6, viscosity, "short")
        orbit = journal_orbit(bearing, force, SPEED, bush=bush, edges=edges)
        assert float(orbit.film.minimum_film) >= 0
        return orbit.status

    assert status(2e-5) == Status.unresolved
    assert status(2e-5, kinks) == Status.converged
    assert status(1e-9) == status(1e-9, kinks) == Status.film_collapse
