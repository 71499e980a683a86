"""A design problem: variables and quantities by name, and derivatives through the whole chain."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import (
    BadInput,
    Collocation,
    Compressor,
    Machine,
    crank_forces,
    load,
    solve_orbit,
)
from jaxcomp._core.fields import replaced
from jaxcomp.balancing import least_squares, machine_influence
from jaxcomp.compressor import at_speed
from jaxcomp.crank._collocation import default_collocation
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.cylinder import Cylinder, DischargeLine, SuctionLine
from jaxcomp.fluid import PerfectGas
from jaxcomp.machine import assembled, machine_of
from jaxcomp.motor import ConstantSpeed
from jaxcomp.scene import with_value, with_values
from jaxcomp.study import AnalysisOptions, available_quantities, problem, variable, with_bore
from jaxcomp.study._problem import _answers, solved
from jaxcomp.study._variables import variable_names
from jaxcomp.vibration import crank_loads, running_rotor

# without estimated errors, which nothing here looks at and which make a program larger
FAST = Collocation(nodes=8, reversals=0, tolerance=1e-11, estimate=False)


@pytest.fixture(scope="module")
def scene():
    return load("hermetic-68cc")


@pytest.fixture(scope="module")
def mayekawa():
    return load("mayekawa-wbhe")


# ---------------------------------------------------------------- variables
@pytest.mark.parametrize("machine", ["mayekawa-wbhe", "slider-link-8cc", "hermetic-68cc"])
def test_every_name_leads_to_a_number_and_back(machine):
    design = machine_of(load(machine))
    some = {plane: jnp.array([3e-4, -4e-4]) for plane in design.corrections}  # nothing has no angle
    design = eqx.tree_at(lambda d: d.corrections, design, some)
    names = variable_names(design)
    assert "mechanism.bore" in names
    for name in names:
        one = variable(design, name)
        now = one.current(design)
        same = one.apply(design, now)
        for a, b in zip(jax.tree.leaves(design), jax.tree.leaves(same), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-14, err_msg=name)
        # 7 % on, or off zero: what was set is what is read, unless it is a factor on a list
        other = one.apply(design, now * 1.07 + 1e-3)
        if one.unit or jnp.ndim(_leaf(design, name)) == 0:
            assert float(one.current(other)) == pytest.approx(float(now * 1.07 + 1e-3), rel=1e-12)


def _leaf(design, name):
    if "." not in name:
        return jnp.zeros(())
    head, rest = name.split(".", 1)
    node = design.parts.get(head)
    if head == "corrections":
        return jnp.zeros(())
    node, rest = (design.compressor, name) if node is None else (node, rest)
    for step in rest.split("."):
        node = node[int(step)] if step.isdigit() else getattr(node, step)
    return node


def test_entries_of_lists_and_factors_on_them(scene):
    design = machine_of(scene)
    entry = variable(design, "rotor.links.4.law.stiffness.1")
    assert (entry.unit, float(entry.current(design))) == ("N/m", 4e4)
    changed = entry.apply(design, 5e4).parts["rotor"].links[4].law.stiffness
    np.testing.assert_array_equal(changed, [4e4, 5e4, 6e4])
    factor = variable(design, "rotor.links.4.law.stiffness", 0.5, 2.0)
    assert (factor.unit, float(factor.current(design))) == ("", 1.0)
    scaled = factor.apply(design, 2.0).parts["rotor"].links[4].law.stiffness
    np.testing.assert_array_equal(scaled, [8e4, 8e4, 12e4])


def test_a_rule_moves_the_whole_machine(mayekawa):
    design = machine_of(mayekawa)
    one = variable(design, "bore_at_displacement", 0.1, 0.15)
    ruled = with_bore(design, 0.12)
    for a, b in zip(jax.tree.leaves(one.apply(design, 0.12)), jax.tree.leaves(ruled), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("ranges", "quantities", "words"),
    [
        ({"mechanism.bor": (None, None)}, ["motor_power"], "mechanism.bor.*dotted path"),
        ({"mechanism.bore.0": (None, None)}, ["motor_power"], "dotted path"),
        ({"mechanism": (None, None)}, ["motor_power"], "dotted path"),
        ({"bore_at_displacement": (-0.1, 0.2)}, ["motor_power"], "bore.*> 0.*-0.1"),
        ({"bore_at_displacement": (0.2, 0.1)}, ["motor_power"], r"bore.*a range \(low, high\)"),
        ({"bore_at_displacement": (0.1, 0.2)}, ["power"], "quantity.*one of.*motor_power"),
        ({"bore_at_displacement": (0.1, 0.2)}, ["loss_power.knee"], "loss_power.*crank_pin.*knee"),
        (
            {"bore_at_displacement": (0.1, 0.2)},
            ["vibration"],
            "'vibration' needs a rotor; this machine has none",
        ),
        ({"bore_at_displacement": (0.1, 0.2)}, [], "quantities.*at least one"),
    ],
)
def test_refusals_name_what_is_wrong(mayekawa, ranges, quantities, words):
    with pytest.raises(BadInput, match=words):
        problem(mayekawa, ranges, quantities)


# ---------------------------------------------------------------- quantities
def test_quantities_are_those_of_the_solvers(mayekawa):
    names = [
        "mechanical_efficiency", "motor_power", "friction_power", "speed_fluctuation",
        "loss_power.wall", "peak_force.crank_pin", "swept_volume",
    ]  # fmt: skip
    assert {n for n in names if "." not in n} <= set(available_quantities(machine_of(mayekawa)))
    one = problem(mayekawa, ["bore_at_displacement"], names, AnalysisOptions(solver=FAST))
    answer = one(jnp.array([0.12]))
    orbit = solve_orbit(with_bore(mayekawa.compressor, 0.12), FAST)
    expected = [
        orbit.mechanical_efficiency,
        orbit.motor_power,
        orbit.motor_power - orbit.energy.gas_work / orbit.period,
        orbit.speed_fluctuation,
        orbit.energy.losses["wall"] / orbit.period,
        orbit.peak_forces["crank_pin"],
        mayekawa.compressor.mechanism.swept_volume,
    ]
    # The friction power is the difference of two that are ten times larger.
    np.testing.assert_allclose(answer.values, np.array(expected), rtol=1e-11)
    assert bool(answer.ok)
    assert one.names == tuple(names)
    assert one.units[:2] == ("", "W")


def test_designs_out_of_bounds_are_marked_finite_and_slope_as_the_nearest_one(mayekawa):
    """One program of values and slopes for designs within the bounds and beyond them."""
    ranges = {"friction.wall.coefficient": (0.01, 0.2)}
    made = problem(mayekawa, ranges, ["motor_power"], AnalysisOptions(solver=FAST))

    @jax.jit
    @jax.vmap
    def slopes_and_answers(x):
        def values_and_answer(x):
            answer = made(x)
            return answer.values, answer

        return jax.jacfwd(values_and_answer, has_aux=True)(x)

    slopes, answers = slopes_and_answers(jnp.array([[0.083], [-0.1], [40.0]]))
    assert answers.ok.tolist() == [True, False, False]  # the last one locks
    assert np.all(np.isfinite(answers.values))
    assert np.isfinite(slopes[:2]).all()


@pytest.mark.slow  # a minute: the derivative of a machine with valves is compiled
def test_a_design_that_was_not_solved_has_no_slope(mayekawa):
    quantities = ["mechanical_efficiency"]
    ranges = {"mechanism.bore": (0.1, 0.14)}
    hasty = AnalysisOptions(Collocation(max_iterations=1))
    unsolved = problem(mayekawa, ranges, quantities, hasty)
    answer = unsolved(unsolved.current)
    assert not bool(answer.ok)
    assert np.isfinite(answer.values).all()
    for derivative in (jax.jacfwd, jax.jacrev):
        assert np.isnan(derivative(lambda x: unsolved(x).values)(unsolved.current)).all()
    assert not solved(unsolved, unsolved.current[None]).ok.any()


def test_functions_serve_as_quantities(mayekawa):
    def twice_the_power(found):
        return 2 * found.orbit.motor_power

    one = problem(
        mayekawa,
        ["bore_at_displacement"],
        ["motor_power", twice_the_power],
        AnalysisOptions(solver=FAST),
    )
    power, twice = one(one.current).values
    assert float(twice) == pytest.approx(2 * float(power), rel=1e-14)
    assert one.names[1] == "twice_the_power"


def equations(jaxpr) -> int:
    """Number of the operations of a traced program, those within its loops and calls among them."""
    holds_more = lambda entry: hasattr(entry, "eqns")  # noqa: E731
    total = len(jaxpr.eqns)
    for equation in jaxpr.eqns:
        entries = jax.tree.leaves(equation.params, is_leaf=holds_more)
        total += sum(map(equations, filter(holds_more, entries)))
    return total


def test_only_what_is_asked_for_is_computed(scene, monkeypatch):
    """The size of the traced program: the crank alone has no trace of the rotor, nor the reverse."""
    # it would trace each once more, and what it refuses is looked at by other tests
    monkeypatch.setattr("jaxcomp.study._problem.check_traced", lambda *_: None)

    def count(names, **how):
        made = problem(scene, ["mechanism.bore"], names, AnalysisOptions(solver=FAST, **how))
        return equations(jax.make_jaxpr(made)(jnp.array([0.05])))

    crank = count(["motor_power"])
    bare = equations(jax.make_jaxpr(lambda c: solve_orbit(c, FAST).motor_power)(scene.compressor))
    # with static loads that are given, the rotor needs no crank
    given = {f"rotor.links.{n}.law.load": ["400 N", "40 N"] for n in (0, 1, 2)}
    scene = with_values(scene, given)
    rotor = count(["vibration"], excitation="file")
    both = count(["motor_power", "vibration"], excitation="file")
    # The bounds of the rotor's numbers are checked, a few operations each; nothing is solved.
    assert crank < 1.5 * bare
    assert both > 0.9 * (crank + rotor - bare)
    assert rotor < both - 0.5 * bare


# ---------------------------------------------------------------- the whole chain
@pytest.mark.slow
def test_vibration_is_that_of_the_influence_coefficients(scene):
    places = scene.parts["balancing"]
    corrections = np.array([[3e-4, -2e-4], [-5e-4, 1e-4]])
    ranges = [f"corrections.{p.name}.{axis}" for p in places.planes for axis in "xy"]
    one = problem(scene, ranges, ["vibration", "balanced_vibration", "vibration.TP4"])
    found = eqx.filter_jit(one)(jnp.array(corrections.reshape(-1)))
    influence = machine_influence(scene, crank=False)
    added = corrections[:, 0] + 1j * corrections[:, 1]
    rms = lambda v: np.sqrt(np.mean(np.abs(np.asarray(v)) ** 2))  # noqa: E731  (all weights are 1)
    left = np.asarray(influence.vibration(added))
    own = [row.target == "TP4" for row in influence.rows]
    balanced = influence.vibration(least_squares(influence).correction)
    # Masses turn with the crank and move the mean forces that load its films, by 1e-8; influence
    # coefficients know nothing of that.
    np.testing.assert_allclose(found.values, [rms(left), rms(balanced), rms(left[own])], rtol=1e-7)


@pytest.mark.slow
def test_films_carry_the_mean_force_of_their_speed(scene):
    """Eq. (6): the mean rod force, shared by the statics of the shaft; it changes with the speed."""
    machine = scene.assembly
    z = {0: -0.075, 1: -0.053, 2: 0.046}  # from the plane of the rod: nodes 10, 11, 27 and 21
    loads = []
    for speed in (250.0, 377.0):
        crank = crank_loads(machine, jnp.asarray(speed), solver=FAST)
        assert bool(crank.ok)
        model, _ = running_rotor(machine, crank)
        held = at_speed(machine.compressor, speed)
        rod = crank_forces(held, solve_orbit(held, FAST), machine.loads.crank, orders=(0,)).forces[
            0
        ]
        shares = np.stack([model.links[number].law.load for number in z])
        # force and moment of the rod, which has no arm
        np.testing.assert_allclose(shares.sum(0), rod.cosine[0, :2], rtol=1e-12)
        moments = np.array(list(z.values()))[:, None] * shares
        np.testing.assert_allclose(moments.sum(0), 0, atol=1e-12 * np.abs(moments).max())
        loads.append(shares)
    assert np.linalg.norm(loads[1] - loads[0]) > 0.01 * np.linalg.norm(loads[0])


@pytest.mark.slow
def test_one_clearance_acts_on_friction_and_film_alike(scene):
    """Efficiency and vibration follow the clearance of one bearing, as differences say."""
    asked = ["mechanical_efficiency", "vibration", "loss_power.upper"]
    one = problem(
        scene,
        ["bearings.upper.radial_clearance"],
        asked,
        AnalysisOptions(solver=FAST, excitation="crank"),
    )
    here, h = one.current, 3e-4 * one.current
    values = eqx.filter_jit(lambda x: one(x).values)
    slope = eqx.filter_jit(jax.jacfwd(lambda x: one(x).values))(here)[:, 0]
    differences = (values(here + h) - values(here - h)) / (2 * h)
    # the step squared, 1e-7, and rounding of values over it
    np.testing.assert_allclose(slope, differences, rtol=1e-6)
    stiffness = [
        with_value(scene, "bearings.upper.radial_clearance", gap).assembly
        for gap in ("13 um", "15 um")
    ]
    loads = jnp.array([300.0, 0.0])
    a, b = (
        replaced(made.rotor.links[1].law, load=loads).coefficients(jnp.asarray(314.0))
        for made in stiffness
    )
    assert float(b[0][0, 0]) < 0.9 * float(a[0][0, 0])  # K goes down faster than 1/c
    assert abs(float(slope[0])) > 1.0  # [1/m] efficiency


@pytest.mark.slow
def test_a_correction_mass_reaches_the_crank(scene):
    """Corrections load the main bearings: their loss and the efficiency follow, as differences say."""
    names = ["corrections.rotor-top.x", "corrections.counterweight.y"]
    asked = ["mechanical_efficiency", "loss_power.upper", "peak_shaking_force"]
    one = problem(scene, names, asked, AnalysisOptions(solver=FAST))
    here, h = jnp.array([2e-4, -1e-4]), 1e-7
    values = eqx.filter_jit(lambda x: one(x).values)
    slope = eqx.filter_jit(jax.jacfwd(lambda x: one(x).values))(here)
    steps = np.eye(2) * h
    differences = np.stack([(values(here + s) - values(here - s)) / (2 * h) for s in steps], -1)
    size = np.abs(np.asarray(slope)).max(1, keepdims=True)
    # rounding of values over the step: 1e-12/1e-7 of the value, far below the slopes in a kg m
    np.testing.assert_allclose(slope / size, differences / size, atol=1e-6)
    assert np.all(np.abs(slope[:, 0]) > 0)


def test_the_counterweight_is_one_for_crank_and_rotor(scene):
    """At every bore the crank's balance is the sum of the rotor's unbalances."""
    for bore in (0.046, 0.0505, 0.055):
        machine = with_bore(scene.machine, bore)
        made = assembled(machine)
        vectors = [u.magnitude * jnp.exp(1j * u.phase) for u in machine.parts["loads"].unbalances]
        total = complex(sum(jnp.sum(v) for v in vectors))
        mechanism = made.compressor.mechanism
        crank = complex(*made.compressor.crankshaft.shaft_unbalance)
        assert crank == pytest.approx(total, rel=1e-14)
        share = total.real / float(
            mechanism.conrod_mass
            * (1 - mechanism.conrod_centre / mechanism.conrod_length)
            * mechanism.crank_radius
        )
        assert share == pytest.approx(-4.75e-4 / (0.18 * 56 / 78 * 16.975e-3), rel=1e-12)


CHAIN = {
    "bore_at_displacement": 1e-5,
    "mechanism.conrod_length": 1e-5,
    "loads.unbalances.0.magnitude": 1e-4,
    "gas.suction_pressure": 1e-5,
    "bearings.upper.radial_clearance": 1e-5,
    "oils.sump.dynamic_viscosity": 1e-5,
    "rotor.links.4.law.stiffness": 1e-5,
    "rotor.shafts.4.outer_diameter": 1e-5,
    "corrections.rotor-top.x": None,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vibration", "balanced_vibration", "mount_force"])
def test_gradient_from_geometry_to_the_housing_equals_differences(scene, name):
    """Through orbit, Fourier coefficients, bearing films and finite elements, in reverse mode."""
    one = problem(scene, list(CHAIN), [name], AnalysisOptions(solver=FAST, excitation="crank"))
    value = eqx.filter_jit(lambda x: one(x).values[0])
    here = np.array(one.current)
    slope = np.asarray(eqx.filter_jit(jax.grad(lambda x: one(x).values[0]))(jnp.array(here)))
    for number, (path, step) in enumerate(CHAIN.items()):
        h = 1e-7 if step is None else step * abs(here[number])
        ends = [here.copy(), here.copy()]
        ends[0][number] += h
        ends[1][number] -= h
        up, down = (float(value(jnp.array(end))) for end in ends)
        size = float(value(jnp.array(here))) / max(abs(here[number]), 1e-4)
        # Differences of values to 1e-12 over steps of 1e-5 are good to 1e-7 of value over variable.
        assert slope[number] == pytest.approx((up - down) / (2 * h), rel=1e-5, abs=1e-7 * size), (
            path
        )


# compiles crank, rotor and balance with their derivative, for half a minute
@pytest.mark.slow
def test_derivative_through_the_whole_chain_along_one_direction(scene):
    """As the slow test, in forward mode along one mixed direction."""
    one = problem(
        scene, list(CHAIN), ["vibration"], AnalysisOptions(solver=FAST, excitation="crank")
    )
    here = one.current
    along = np.abs(np.array(here)) * np.array([1.0, -2, 1, 0.5, 1, -1, 2, -1, 0])
    along[-1] = 1e-3

    @eqx.filter_jit
    def both(x):
        return jax.jvp(lambda x: one(x).values[0], (x,), (jnp.array(along),))

    h = 1e-5
    up, down = (float(both(here + sign * h * along)[0]) for sign in (1, -1))
    assert float(both(here)[1]) == pytest.approx((up - down) / (2 * h), rel=1e-6)


@pytest.mark.slow
def test_crank_influence_at_each_speed_is_its_own(scene):
    """A speed does not see the other speeds of the same call."""
    together = machine_influence(scene, jnp.array([314.0, 377.0]), FAST)
    alone = machine_influence(scene, jnp.array([377.0]), FAST)
    rows = len(alone.rows)
    np.testing.assert_allclose(together.matrix[rows:], alone.matrix, rtol=1e-9)
    np.testing.assert_allclose(together.initial[rows:], alone.initial, rtol=1e-9)


def valves_on_a_perfect_gas():
    """Cylinder and valves of `r134a-7cc` on a perfect gas at a held speed, for small programs."""
    bundled = load("r134a-7cc").compressor
    gas = Cylinder(
        PerfectGas(81.5, 1.12),
        SuctionLine(bundled.gas.suction.pressure, 328.0),
        DischargeLine(bundled.gas.discharge.pressure),
        *bundled.gas.valves,
        bundled.gas.clearance_ratio,
    )
    shaft = Crankshaft(bundled.crankshaft.inertia)
    return Compressor(bundled.mechanism, shaft, ConstantSpeed(bundled.motor.mean_speed), gas)


@pytest.mark.slow  # three programs of a machine with valves and its derivatives
def test_designs_with_derivatives_take_the_panels_that_their_events_need():
    """Eight panels hold fewer events than the valves have, 53 of the third size enough.

    Panels follow the steps of the march before them, so both are marched as the third size is. Fewer are
    refused: eight are off by 3e-3, 21 of the second size by 3e-5.
    """
    compressor = valves_on_a_perfect_gas()
    quantity, ranges = ["volumetric_efficiency"], {"gas.clearance_ratio": (0.01, 0.05)}

    solver = default_collocation(compressor)
    first = solver.cycle.march_tolerance_of(jnp.asarray(0))
    third = dataclasses.replace(solver.cycle, size=2).march_tolerance_of(jnp.asarray(0))

    def made(panels, march_tolerance):
        own = {"least_panels": panels, "nodes": 8, "march_tolerance": march_tolerance}
        options = AnalysisOptions(
            dataclasses.replace(solver, cycle=dataclasses.replace(solver.cycle, **own))
        )
        return problem(Machine(compressor), ranges, quantity, options=options)

    few, many = made(8, float(first)), made(53, float(third))
    assert _answers(few, few.current[None])[-1] > 0  # events for which there is no room
    own, wanted = (solved(one, one.current[None]) for one in (few, many))
    assert own.ok.all()
    np.testing.assert_allclose(own.values, wanted.values, rtol=1e-12)
    np.testing.assert_allclose(own.slope, wanted.slope, rtol=1e-9)


def test_problems_of_one_structure_are_traced_once(mayekawa):
    """Whatever their ranges: to trace a machine takes half a second."""
    traced = []

    def bore(result):
        traced.append(result)
        return result.design.compressor.mechanism.bore

    for high in (0.13, 0.14):
        made = problem(mayekawa, {"bore_at_displacement": (0.12, high)}, [bore])
        assert made.variables[0].high == high
    assert len(traced) == 1
