"""Error against run time: what the reports say, observed orders, and the solvers side by side."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from benchmarks import layouts
from benchmarks.march import observed_order
from benchmarks.march import orders as orders_of
from benchmarks.studies import STUDIES as DEVELOPER_STUDIES
from benchmarks.studies import refined
from helpers import briefly_timed

from jaxcomp import BadInput, Collocation, accuracy, load, solve_orbit
from jaxcomp.crank._collocation import default_collocation
from jaxcomp.film._running import eccentricity_ratio
from jaxcomp.machine import machine_of
from jaxcomp.study import AnalysisOptions
from jaxcomp.study.accuracy import Report
from jaxcomp.study.accuracy._accuracy import STUDIES
from jaxcomp.study.accuracy._gradient import gradient_study
from jaxcomp.study.accuracy._orbit_study import by_scipy, known_quantities
from jaxcomp.study.accuracy._report import Measurement, Reference
from jaxcomp.study.accuracy._rotor_study import film_places
from jaxcomp.study.accuracy._study import (
    ROTOR_QUANTITIES,
    Call,
    Question,
    Setting,
    Solved,
    answer,
    digits,
    measured,
    series,
)

MACHINES = ("mayekawa-wbhe", "slider-link-8cc", "hermetic-68cc")


def report(*rows, value=2.0, other=2.0 + 2e-9):
    """A report of rows (method, error, seconds)."""
    made = tuple(Measurement(m, f"setting {n}", e, s, 1.0) for n, (m, e, s) in enumerate(rows))
    return Report("orbit", "a", "b", "", Reference(value, other, ("x", "y")), made, "")


ROWS = (("a", 1e-3, 1.0), ("a", 1e-5, 2.0), ("a", 1e-4, 3.0), ("b", 1e-12, 4.0), ("b", np.inf, 0.1))


def test_nothing_is_claimed_below_the_disagreement_of_the_references():
    made = report(*ROWS)
    assert made.reference.floor == pytest.approx(1e-9, rel=1e-6)
    assert made.claimed(made.rows[3]) == made.reference.floor
    assert made.cheapest(1e-8).method == "b"
    assert made.cheapest(1e-10) is None


def test_the_cheapest_setting_for_an_error_is_the_fastest_of_those_that_reach_it():
    made = report(*ROWS)
    assert made.cheapest(1e-3).seconds == 1.0
    assert made.cheapest(1e-4).seconds == 2.0
    assert made.cheapest(1e-3, "b").seconds == 4.0
    # the row that did not converge is the fastest of all, and reaches nothing
    assert made.cheapest(1e300).seconds == 1.0


def settings(*errors, method="a", family="", **options):
    """Rows of one family from loose to tight, each slower than the one before."""
    return tuple(
        Measurement(
            method,
            f"{family}{n}",
            error,
            1.0 + n,
            1.0,
            family=family,
            tightness=(float(n),),
            **options,
        )
        for n, error in enumerate(errors)
    )


def test_a_lucky_loose_setting_is_not_recommended():
    lucky = Report("orbit", "a", "b", "", Reference(2.0, 2.0, ("x", "y")),
                   settings(1e-7, 1e-4, 1e-6, 1e-9), "")  # fmt: skip
    assert lucky.cheapest(1e-3).setting == "0"
    assert lucky.cheapest(1e-5).setting == "2"
    assert lucky.cheapest(1e-5, "a").setting == "2"
    assert lucky.cheapest(1e-8).setting == "3"
    # a tighter one that failed says so itself
    failed = replace(lucky, rows=settings(1e-7, np.inf))
    assert failed.cheapest(1e-6).setting == "0"
    # another family of the same method does not count against it
    mixed = replace(lucky, rows=settings(1e-7) + settings(1e-2, 1e-2, family="c"))
    assert mixed.cheapest(1e-6).setting == "0"


def test_two_kinds_of_tightness_are_compared_together():
    first, second = settings(1e-6, 1e-6)
    coarse = replace(first, tightness=(5.0, 8.0))
    # more nodes at a looser tolerance are not tighter
    assert not replace(second, tightness=(4.0, 12.0)).at_least_as_tight(coarse)
    assert replace(second, tightness=(5.0, 12.0)).at_least_as_tight(coarse)


def test_what_is_no_candidate_is_measured_and_not_recommended():
    rows = settings(1e-9, method="friction times 2", candidate=False) + settings(1e-4)
    made = Report("friction", "a", "b", "", Reference(2.0, 2.0, ("x", "y")), rows, "")
    assert made.cheapest(1e-6) is None
    assert made.cheapest(1e-6, "friction times 2").error == 1e-9


def test_failed_settings_are_listed_by_their_reason():
    rows = settings(np.inf, np.inf, 1e-3, why="the joints lock")
    made = Report("orbit", "a", "b", "", Reference(2.0, 2.0, ("x", "y")), rows, "")
    assert made.failures == {"the joints lock": ["a, 0", "a, 1"]}


@pytest.mark.parametrize(
    ("name", "asked", "excitation"),
    [
        ("mayekawa-wbhe", "swept_volume", None),
        ("slider-link-8cc", "swept_volume", None),
    ],
)
def test_what_no_setting_changes_is_refused(name, asked, excitation):
    with pytest.raises(BadInput, match="solver of the periodic state has a part in") as caught:
        accuracy(load(name), asked, excitation=excitation)
    assert caught.value.field == "quantity"


def test_derivative_that_vanishes_is_refused():
    with pytest.raises(BadInput, match="mean_speed changes") as caught:
        accuracy(load("mayekawa-wbhe"), "swept_volume", "gradient", variable="motor.mean_speed")
    assert caught.value.field == "quantity"


def test_default_excitation_is_the_crank_where_it_is_joined_to_the_rotor():
    from jaxcomp.study.accuracy._accuracy import _excitation

    hermetic = machine_of(load("hermetic-68cc"))
    assert _excitation(hermetic, "vibration.housing") == "crank"
    assert _excitation(hermetic, "motor_power") is None
    assert _excitation(hermetic, "displacement", STUDIES["response"]) == "crank"


def test_studies_take_the_default_solver_of_the_machine():
    for name in MACHINES:
        scene = load(name)
        question = Question(machine_of(scene), "mechanical_efficiency")
        assert question.load_reversals == scene.as_compressor().mechanism.load_reversals > 0
        assert question.default_solver == default_collocation(scene.as_compressor())


def scipy_program(machine):
    """Gas power and losses [W] of the periodic state by `solve_ivp` over time and `brentq`.

    A program of its own: it takes from the library the law of motion at an instant and nothing of its
    solvers. No kink is told to it; steps are kept short instead.
    """
    import jax
    import jax.numpy as jnp
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    from jaxcomp.crank._crank_motion import acceleration

    @jax.jit
    def law(angle, speed):
        rise, conservative, loads = acceleration(machine, angle, speed, machine.motor.torque(speed))
        powers = [-conservative * speed, *(loss * speed for loss in loads.loss_torque.values())]
        return jnp.stack([speed, rise, *powers])

    _, _, loads = acceleration(machine, jnp.asarray(1.0), jnp.asarray(300.0), jnp.zeros(()))
    names = list(loads.loss_torque)

    def passed(time, y):
        return y[0] - 2 * np.pi

    passed.terminal = True

    def turn(first):
        start = np.zeros(3 + len(names))
        start[1] = first
        return solve_ivp(lambda t, y: np.asarray(law(y[0], y[1])), (0, 4 * np.pi / first), start,
                         method="DOP853", rtol=1e-9, atol=1e-9, max_step=0.01 / first,
                         events=passed)  # fmt: skip

    guess = 0.98 * float(machine.motor.speed_guess)
    first = brentq(lambda w: turn(w).y[1, -1] - w, 0.9 * guess, 1.05 * guess, xtol=1e-8)
    done = turn(first)
    gas, *losses = done.y[2:, -1] / done.t[-1]
    return gas, dict(zip(names, losses, strict=True))


@pytest.mark.slow
def test_slider_link_machine_beside_a_scipy_program_of_its_own():
    from jaxcomp.study.accuracy._orbit_study import orbit_reference

    scene = load("slider-link-8cc")
    gas, losses = scipy_program(scene.compressor)
    question = Question(machine_of(scene), "mechanical_efficiency")
    reference = orbit_reference(question)
    # load reversals are met unprepared, within steps of a hundredth of a radian at most
    assert gas / (gas + sum(losses.values())) == pytest.approx(reference.value, abs=1e-6)
    # two methods that share the laws only, and a floor below what the default solver is off by
    assert reference.floor < 1e-7


@pytest.mark.slow
def test_mayekawa_machine_beside_the_program_of_rigid_bodies():
    import reference as bodies

    from jaxcomp.study.accuracy._orbit_study import orbit_reference

    scene = load("mayekawa-wbhe")
    own = bodies.from_compressor(scene.compressor)
    question = Question(machine_of(scene), "mechanical_efficiency")
    found = orbit_reference(question)
    mean = float(scene.compressor.motor.mean_speed)
    turn = bodies.orbit(own, lambda speed, level: level * speed / mean, mean_speed=mean)
    assert turn.efficiency == pytest.approx(found.value, rel=1e-8)


@pytest.mark.slow
def test_hermetic_machine_beside_a_program_of_its_own_in_numpy_and_scipy():
    import reference_hermetic as own

    scene = load("hermetic-68cc")
    made = own.machine(scene)
    moved, turns = own.vibration(scene, made)
    names = ("mechanical_efficiency", "vibration", "loss_power.crank_pin", "loss_power.wall")
    design = machine_of(scene)
    at = [float(v) for v in answer(design, AnalysisOptions(excitation="crank"), names).value]
    speed = float(scene.compressor.motor.mean_speed)
    turn, each = turns[speed], speed / (2 * np.pi)
    # films by tables of 1e-5 in the losses of the shaft, a fiftieth of the work: 3e-8 seen
    assert turn.efficiency == pytest.approx(at[0], abs=1e-6)
    # and 2e-5 in the stiffness of the films, which are much stiffer than the mounts: 4e-8 seen
    assert moved == pytest.approx(at[1], rel=1e-5)
    # load reversals of the pins are met unprepared
    assert turn.work["crank_pin"] * each == pytest.approx(at[2], rel=1e-6)
    assert turn.work["wall"] * each == pytest.approx(at[3], rel=1e-6)


def test_derivatives_carry_the_name_of_a_derivative():
    question = Question(
        machine_of(load("hermetic-68cc")), "vibration", "mechanism.conrod_length", "crank"
    )
    plan = gradient_study(question, False)
    assert plan.name == "d vibration / d mechanism.conrod_length"
    assert plan.unit == "m/m"
    assert "excitation 'crank'" in plan.note


@pytest.mark.slow
def test_gradient_of_the_vibration_through_orbit_and_rotor():
    found = accuracy(
        load("hermetic-68cc"), "vibration", "gradient", variable="mechanism.conrod_length"
    )
    assert found.reference.value != 0.0
    # differences of shooting at both speeds, through films and finite elements
    assert found.reference.floor < 1e-6
    modes = [row for row in found.rows if "mode" in row.method]
    assert len(modes) == 2
    assert all(row.error < 1e-5 for row in modes)
    assert found.march["speed"] < 1e-6
    value, gradient = found.calls.values()
    assert value.second < value.first
    assert value.lines < gradient.lines
    assert gradient.second < gradient.first


def test_a_curve_has_the_settings_that_no_other_beats():
    assert [row.seconds for row in report(*ROWS).curve("a")] == [1.0, 2.0]


def test_reference_never_claims_more_than_rounding():
    assert Reference(3.0, 3.0, ("x", "y")).floor == np.finfo(float).eps


def test_order_is_read_where_errors_are_no_rounding():
    steps = np.array([1, 2, 4, 8, 16, 32])
    errors = np.maximum(steps**-4.0, 3e-5)
    assert observed_order(steps, errors, 1e-4) == pytest.approx(4.0, rel=1e-12)
    assert np.isnan(observed_order(steps, errors, 0.5))


def test_impossible_questions_are_refused_by_name():
    crank, rotor = load("mayekawa-wbhe"), load("hermetic-68cc")
    for scene, asked, study, options, field in (
        (crank, "mechanical_efficiency", "orbits", {}, "study"),
        (crank, "efficiency", "orbit", {}, "quantity"),
        (crank, "mechanical_efficiency", "gradient", {}, "variable"),
        (crank, "mechanical_efficiency", DEVELOPER_STUDIES["order"], {}, "quantity"),
        (crank, None, "response", {}, "study"),
        *(
            (crank, None, DEVELOPER_STUDIES[n], {}, "study")
            for n in ("mesh", "harmonics", "balancing")
        ),
        (crank, "mean_speed", DEVELOPER_STUDIES["simulate"], {}, "quantity"),
        (crank, None, "cycle", {}, "gas"),
        (rotor, None, "cycle", {}, "gas"),
        (crank, "indicated_power", "cycle", {}, "quantity"),
        (crank, "mechanical_efficiency", "film", {}, "quantity"),
        (crank, "mechanical_efficiency", "orbit", {"variable": "bore_at_displacement"}, "variable"),
        (
            crank,
            "mechanical_efficiency",
            DEVELOPER_STUDIES["tolerance"],
            {"variable": "bolts.*"},
            "variable",
        ),
        (rotor, "motor_power", DEVELOPER_STUDIES["mesh"], {}, "quantity"),
    ):
        with pytest.raises(BadInput) as caught:
            accuracy(scene, asked, study, **options)
        assert caught.value.field == field


@pytest.mark.slow
def test_films_are_studied_at_every_bearing_of_the_machine():
    scene = load("slider-link-8cc")
    places = film_places(machine_of(scene))
    orbit = solve_orbit(scene.compressor)
    journals = scene.compressor.crankshaft.main_journal
    bearings = dict(zip(journals.names, journals.bearings, strict=True))
    bearings["crank_pin"] = scene.compressor.friction.crank_pin
    assert {place.label for place in places} == set(bearings)
    assert len(places) == 3
    for place in places:
        bearing = bearings[place.label]
        own = eccentricity_ratio(bearing, orbit.mean_forces[place.label], orbit.mean_speed)
        # the quick orbit of the study has no edges at the load reversals: 1.1e-3 seen
        assert place.eccentricity == pytest.approx(float(own), rel=5e-3)
        ratio = float(bearing.length / bearing.radius / 2)
        assert place.length_ratio == pytest.approx(ratio, rel=1e-12)
    # the most eccentric first
    assert places[0].eccentricity == max(place.eccentricity for place in places)
    assert film_places(machine_of(load("mayekawa-wbhe"))) == ()


@pytest.mark.slow
def test_grooved_bearings_of_the_rotor_agree_with_reynolds_equation():
    found = accuracy(load("hermetic-68cc"), "stiffness", "film")
    rows = [row for row in found.rows if row.method.startswith("GroovedReynolds, rotor")]
    assert len(rows) == 3
    for row in rows:
        # tables of 1e-5; stiffness by finite volumes on 960 x 64 cells has some 5e-6 itself
        assert row.error < 2e-5, row
        assert row.floor < 1e-5


def test_derivative_of_a_film_is_that_of_finite_volumes(monkeypatch):
    briefly_timed(monkeypatch)
    found = accuracy(load("mayekawa-wbhe"), "friction_number", "gradient")
    assert found.quantity == "d friction_number / d load_number"
    for mode in ("forward", "reverse"):
        row = next(row for row in found.rows if row.method == f"{mode} mode, Reynolds")
        # a table of 1e-5 in the value, and differences of finite volumes
        assert row.error < 1e-4
    # the closed formula is off by the error of its model, beyond what the reference is worth
    fit = next(row for row in found.rows if row.method == "forward mode, ExplicitFit")
    assert fit.error > 1e-3


def test_setting_is_measured_beside_its_reference():
    def slow():
        return np.array([1.0, 2.0 + 2e-3])

    whole = Reference(np.array([1.0, 2.0]), np.array([1.0, 2.0 + 1e-6]), ("x", "y"))
    assert whole.floor == pytest.approx(5e-7)
    row = measured(Setting("a", "b", lambda: Call(slow), (1.0,), share=10), whole)
    assert row.error == pytest.approx(1e-3)  # over the largest value
    assert 0 < row.seconds < 1e-3
    assert row.floor is None
    own = Reference(np.array([1.0, 2.002]), np.array([1.0, 2.004]), ("x", "y"))
    judged = measured(Setting("a", "b", lambda: Call(slow), reference=lambda: own), whole)
    assert judged.error < 1e-15
    assert judged.floor == pytest.approx(1e-3, rel=1e-3)
    made = Report("film", "a", "b", "", whole, (judged,), "")
    assert made.claimed(judged) == judged.floor
    assert made.cheapest(1e-4) is None


def test_a_time_that_is_known_is_not_measured_again():
    calls = []
    call = Call(lambda: calls.append(0) or 2.0, seconds=0.25)
    row = measured(Setting("a", "b", lambda: call), Reference(2.0, 2.0, ("a", "b")))
    assert (row.seconds, row.error, len(calls)) == (0.25, 0.0, 1)


def test_setting_that_gives_nothing_says_why():
    whole = Reference(1.0, 1.0, ("x", "y"))

    def halts():
        raise RuntimeError("the step is too small")

    def refused():
        raise BadInput("quantity", "x", "one with a value")

    for make, words in (
        (lambda: Call(halts), "the step is too small"),
        (refused, "one with a value"),
        (lambda: Call(lambda: np.nan), "not finite"),
        (lambda: Call(lambda: Solved(1.0, ok=False)), "not converged"),
    ):
        row = measured(Setting("a", "b", make), whole)
        assert row.error == np.inf
        assert words in row.why


def test_only_settings_of_one_task_compete():
    rows = (
        Measurement("min-max", "1", 1e-9, 2.0, 0.0, task="min-max"),
        Measurement("least squares", "exact", 0.0, 1.0, 0.0, task="least squares"),
    )
    made = Report("balancing", "a", "b", "", Reference(1.0, 1.0, ("x", "y")), rows, "")
    assert made.tasks == {"min-max": ("min-max",), "least squares": ("least squares",)}
    assert made.cheapest(1e-6, task="min-max").method == "min-max"
    assert made.cheapest(1e-6).method == "least squares"


@pytest.mark.parametrize(
    "name", [MACHINES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in MACHINES[1:])]
)
def test_every_quantity_of_a_problem_is_known_by_its_full_name(name):
    from jaxcomp import problem
    from jaxcomp.study import available_quantities

    design = machine_of(load(name))
    names = known_quantities(design)
    assert {n.partition(".")[0] for n in names} == {
        n.partition(".")[0] for n in available_quantities(design)
    }
    assert not [n for n in names if "<" in n]
    problem(design, ["mechanism.crank_radius"], names)  # all are quantities


@pytest.mark.slow
def test_scipy_on_the_same_law_comes_to_the_same_efficiency():
    scene = load("mayekawa-wbhe")
    machine = scene.compressor
    exact = float(solve_orbit(machine, Collocation()).mechanical_efficiency)
    reference = Reference(exact, exact, ("collocation", "the same"))
    question = Question(machine_of(scene), "mechanical_efficiency")
    call = partial(by_scipy, question, "DOP853")
    settings = series("SciPy", "DOP853 rtol={:g}", call, (1e-5, 1e-9), digits)
    loose, tight = (measured(setting, reference) for setting in settings)
    # load reversals are met unprepared: a hundred times the tolerance of a step, at worst
    assert tight.error < 1e-7
    assert tight.error < loose.error < 1e-3
    assert tight.iterations > loose.iterations


def test_cut_elements_make_the_same_shaft():
    model = load("hermetic-68cc").parts["rotor"]
    fine = refined(model, 3)
    for whole, cut in zip(model.shafts, fine.shafts, strict=True):
        assert len(cut.nodes) == 3 * len(whole.nodes)
        # sums in another order
        assert float(cut.length.sum()) == pytest.approx(float(whole.length.sum()), rel=1e-14)
        assert cut.nodes[0][0] == whole.nodes[0][0]
        assert cut.nodes[2][1] == whole.nodes[0][1]
        assert all(a[1] == b[0] for a, b in zip(cut.nodes[:3], cut.nodes[1:3], strict=False))
    # sleeves on the same nodes stay in parallel
    assert fine.shafts[1].nodes == fine.shafts[2].nodes


@pytest.fixture(scope="module")
def orders():
    return accuracy(load("mayekawa-wbhe"), "mean_speed", DEVELOPER_STUDIES["order"])


@pytest.mark.slow
def test_fixed_steps_show_the_orders_of_their_methods(orders):
    found = {name: order.observed for name, order in orders_of(orders).items()}
    # of the four finest settings above rounding; the eighth order has them at 2 to 5 steps a stretch
    for name, expected, room in (
        ("Heun", 2, 0.05),
        ("Bosh3", 3, 0.1),
        ("Tsit5", 5, 0.15),
        ("Dopri8", 8, 1),
    ):
        assert found[name] == pytest.approx(expected, abs=room), found


@pytest.mark.slow
def test_collocation_and_an_eighth_order_method_end_at_the_same_speed(orders):
    # rounding of a few hundred steps
    assert orders.reference.floor < 1e-12


@pytest.fixture(scope="module")
def orbit():
    # first calls and march are those of the study of friction of the same machine
    return accuracy(load("mayekawa-wbhe"), None, STUDIES["orbit"]._replace(verified=False))


@pytest.mark.slow
def test_references_of_the_orbit_agree(orbit):
    assert orbit.reference.floor < 1e-9


@pytest.mark.slow
def test_collocation_is_ten_times_faster_than_shooting_at_equal_error(orbit):
    error = 1e-6
    collocation = min(
        orbit.cheapest(error, m).seconds for m in ("collocation", "collocation, reversals=0")
    )
    shooting = orbit.cheapest(error, "shooting, Tsit5").seconds
    scipy = orbit.cheapest(error, "SciPy").seconds
    assert 10 * collocation < shooting  # as the page of the solvers says
    assert shooting < scipy


@pytest.mark.slow
def test_collocation_converges_exponentially(orbit):
    errors = {5: [], 8: [], 12: []}
    for row in orbit.rows:
        for count, found in errors.items():
            if row.method == "collocation" and f"nodes={count} " in row.setting:
                found.append(orbit.claimed(row))
    five, eight, twelve = (min(found) for found in errors.values())  # an absent row is an error
    assert 1e-9 < five < 1e-6
    # measured 1.4e-7, 1.3e-9 and 4e-10, the last of which is near what the reference itself is worth
    assert eight < 0.05 * five
    assert twelve < 0.5 * eight


@pytest.mark.slow
def test_both_modes_give_the_derivative_and_differences_lose_half_the_digits():
    found = accuracy(
        load("mayekawa-wbhe"),
        "mechanical_efficiency",
        "gradient",
        variable="mechanism.conrod_length",
    )
    modes = [row for row in found.rows if row.method.endswith("mode, collocation")]
    assert len(modes) == 2
    differences = [row for row in found.rows if row.method == "central differences"]
    # collocation of eight nodes: its values err by 5e-9
    assert all(found.claimed(row) < 1e-5 for row in modes)
    assert max(row.error for row in differences) > 1e-4
    # steps in the middle find what the derivative of the same solution is worth (measured 4.8e-9 to
    # 1.02e-8 for 1.01e-8), and the smallest loses digits again to the rounding of the values (8.5e-8)
    derivative = max(row.error for row in modes)
    *_, middle, fine, finest = differences
    assert max(middle.error, fine.error) < 2 * derivative < finest.error


@pytest.mark.slow
def test_iterations_of_the_friction_gain_digits_and_more_with_less_friction():
    found = accuracy(load("mayekawa-wbhe"), "mechanical_efficiency", DEVELOPER_STUDIES["friction"])
    once, twice = (
        {row.setting: row for row in found.rows if row.method == f"friction times {n}"}
        for n in (1, 2)
    )
    # an iteration gains two to three digits: measured 1.1e-7 after two iterations, 1.8e-11 after five
    assert once["tolerance=1e-08"].error < 1e-12 < once["tolerance=0.01"].error < 1e-5
    assert once["tolerance=0.1"].iterations < once["tolerance=1e-06"].iterations < 10
    assert once["tolerance=1e-06"].error < twice["tolerance=1e-06"].error


@pytest.mark.slow
def test_elements_converge_with_the_square_of_their_length():
    found = accuracy(load("hermetic-68cc"), "vibration", DEVELOPER_STUDIES["mesh"])
    errors = [row.error for row in found.rows]
    assert found.reference.floor < 1e-2 * errors[-1]
    # second order, once the elements are small
    assert errors[1] / errors[3] == pytest.approx(4.0, rel=0.2)


@pytest.mark.slow
def test_harmonics_left_out_are_what_is_missing():
    found = accuracy(load("hermetic-68cc"), None, DEVELOPER_STUDIES["harmonics"])
    errors = [row.error for row in found.rows]
    assert errors == sorted(errors, reverse=True)
    assert found.reference.floor < errors[-1] < errors[0]


@pytest.mark.slow
def test_response_by_elimination_is_that_of_full_matrices_in_extended_precision():
    found = accuracy(load("hermetic-68cc"), None, "response")
    assert all(row.error < 1e-8 for row in found.rows)  # condition times rounding: 1e-10 seen
    at = {(row.method, row.setting): row for row in found.rows}
    assert at["structured", "100 speeds"].seconds < at["dense", "100 speeds"].seconds


@pytest.mark.slow
def test_balances_keep_the_gap_that_they_are_asked_for():
    found = accuracy(load("hermetic-68cc"), None, DEVELOPER_STUDIES["balancing"])
    assert len(found.tasks) == 3
    for row in found.rows:
        assert row.floor < 1e-9  # what SciPy's search and the tightest tolerance differ by
        if "tolerance" in row.setting:
            assert row.error < float(row.setting.partition("=")[2]) + row.floor


@pytest.mark.slow
def test_methods_in_time_converge_to_scipy():
    found = accuracy(load("mayekawa-wbhe"), None, DEVELOPER_STUDIES["simulate"])
    assert found.reference.floor < 1e-7
    for name in ("Tsit5", "Dopri8", "Kvaerno5"):
        errors = [row.error for row in found.rows if row.method == name]
        # jumps of the friction at the dead centres are met unprepared
        assert errors[-1] < 1e-4
        assert errors[-1] < 0.1 * errors[0]


@pytest.mark.slow
def test_samples_and_derivatives_agree_on_what_varies():
    found = accuracy(
        load("mayekawa-wbhe"),
        None,
        DEVELOPER_STUDIES["tolerance"],
        variable="friction.*.coefficient",
    )
    assert set(found.tasks) == {"mean", "deviation", "rejects"}
    at = {(row.method, row.setting): row.error for row in found.rows}
    for name in found.tasks:
        # low-discrepancy points converge; the standard error of 64 of 4 numbers is some 0.1
        assert at[f"sobol: {name}", "4096 samples"] < 0.03
    # efficiency is all but linear in the coefficients
    assert at["second order: mean", "at the mean machine"] < 1e-3
    assert at["first order: deviation", "at the mean machine"] < 1e-2


# [-] Errors of the default solver that its own march may tell, by quantity: a peak of the crank pin of
# slider-link-8cc is known to 3e-4, the largest pressure of its film to 1.2e-4, its torque from valley to
# peak to 6e-5, its least films to 9e-5, other peaks to 4e-5 (notebooks/solvers.md), all else to 1e-6.
# The margin is the least of the nodes.
PEAKS, MARGIN, REST = 1e-3, 1e-4, 1e-5
# The share of a revolution in which a film is thin is counted by the nodes: 8e-3 of it.
COUNTED = 3e-2
# Of a harmonic relative to itself: the sixth force of hermetic-68cc, a small part of all, to 1.2e-5.
HARMONICS = 1e-4
ALLOWED = {
    "joint_margin": MARGIN,
    "torque_fluctuation": PEAKS,
    "peak": PEAKS,
    "film_pressure": PEAKS,
    "film_thickness": PEAKS,
    "steady_film_thickness": PEAKS,
    "least_film": PEAKS,
    "thin_film_share": COUNTED,
    "shaking": HARMONICS,
}


@pytest.mark.slow  # a minute of compilation each
@pytest.mark.parametrize(
    ("name", "part"),
    # of the balanced twin most harmonics of the force are rounding
    [*((name, "crank") for name in (*MACHINES, "refrigeration-twin")), (MACHINES[2], "rotor")],
)
def test_every_quantity_has_a_true_error_or_a_refusal_in_words(monkeypatch, name, part):
    every = known_quantities(machine_of(load(name)))
    # in two, as all of them in one program compile for four minutes
    some = tuple(
        one for one in every if (one.partition(".")[0] in ROTOR_QUANTITIES) == (part == "rotor")
    )
    monkeypatch.setattr("jaxcomp.study.accuracy._orbit_study.known_quantities", lambda design: some)
    found = accuracy(load(name), None, "quantities")
    assert [row.method for row in found.rows] == list(some)
    unlike = {}
    for row in found.rows:
        if np.isfinite(row.error):
            bounds = (b for start, b in ALLOWED.items() if row.method.startswith(start))
            if not found.claimed(row) < next(bounds, REST):
                unlike[row.method] = found.claimed(row)
        else:
            unlike[row.method] = row.why
    assert not unlike, str(unlike)


ALL_STUDIES = STUDIES | DEVELOPER_STUDIES
# Numbers of cylinders of a case: together they take minutes. A single one is in each of them, since the
# reference of the whole study is that of the first number, and several have none of their own: balanced
# ones have the same efficiency at every tolerance, and eight do not reach that of references.
COUNTS = {"cylinders": (1, 2, 8), "four cylinders": (1, 4)}
KINDS = (
    *(one for one in ALL_STUDIES if one not in ("orbit", "quantities", *COUNTS)),
    *COUNTS,
)


def forward_mode(question, thorough):
    """Beside the references of the study."""
    plan = gradient_study(question, thorough)
    forward, *_ = plan.settings
    assert forward.method.startswith("forward")
    return plan._replace(settings=(forward,))


def reverse_mode_and_differences(question, thorough):
    """Beside the forward mode of the same solver."""
    plan = gradient_study(question, thorough)
    forward, *others = plan.settings
    assert others[0].method.startswith("reverse")

    def reference():
        value = float(forward.prepare().run().value)
        return Reference(value, value, ("forward", "forward"))

    return plan._replace(reference=reference, settings=tuple(others))


# The study whose programs take the longest, in two.
PARTS = {"forward": forward_mode, "reverse": reverse_mode_and_differences}


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_gradients_of_the_slider_link_end_in_a_report(part):
    # first calls and march are those of the study of friction of the same machine
    kind = STUDIES["gradient"]._replace(make=PARTS[part], verified=False)
    found = accuracy(load("slider-link-8cc"), None, kind, variable="mechanism.crank_radius")
    assert np.isfinite(found.reference.floor)
    assert any(np.isfinite(row.error) for row in found.rows)
    assert all(row.why for row in found.rows if not np.isfinite(row.error))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "study"),
    [pair for pair in product(MACHINES, KINDS) if pair != ("slider-link-8cc", "gradient")],
)
def test_every_study_of_every_machine_ends_in_a_report_or_in_words(name, study, monkeypatch):
    if counts := COUNTS.get(study):
        some = {count: layouts.LAYOUTS[count] for count in counts}
        monkeypatch.setattr(layouts, "LAYOUTS", some)
        study = "cylinders"
    kind, variable = ALL_STUDIES[study], "mechanism.crank_radius" if study == "gradient" else None
    if study == "gradient":
        # its first calls and its march are those of the study of friction of the same machine
        kind = kind._replace(verified=False)
    without = kind.needs == "rotor" and name != "hermetic-68cc"
    if without or study == "cycle" or (study, name) == ("cylinders", "slider-link-8cc"):
        with pytest.raises(BadInput):
            accuracy(load(name), None, kind, variable=variable)
        return
    found = accuracy(load(name), None, kind, variable=variable)
    assert np.isfinite(found.reference.floor)
    assert any(np.isfinite(row.error) for row in found.rows)
    assert all(row.why for row in found.rows if not np.isfinite(row.error))
