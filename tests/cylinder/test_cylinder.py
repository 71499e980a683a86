"""The cycle of a cylinder against two independent integrators and their differences.

The machines and figures are of an assumed refrigerator compressor (R134a, about ASHRAE LBP) and the same
with air: DOP853 at 1e-12 and Radau at 1e-9 of SciPy with located events, ten digits in agreement; the
elasticities are central differences of re-converged cycles, which agree at two step sizes to 5e-7.
"""

import operator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxcomp import SliderCrank, SolveFailed, Status
from jaxcomp.cylinder import (
    Annand,
    CycleOptions,
    Cylinder,
    DischargeLine,
    LaminarGap,
    SuctionLine,
    _cylinder,
    _events,
    _gas_balance,
    solve_cycle,
)
from jaxcomp.fluid import PerfectGas, RealGas
from jaxcomp.plot._cylinder import cylinder_figures
from jaxcomp.valve import CheckValve, PlateValve, ReedBeam

# parts of larger programs, each compiled once for machines of one structure
prepare = eqx.filter_jit(_cylinder.prepare)
initial = eqx.filter_jit(_gas_balance.initial)
rates = eqx.filter_jit(_gas_balance.rates)
after_event = eqx.filter_jit(_events.after_event)

SPEED = 2950 * 2 * np.pi / 60
COLLOCATION = CycleOptions(nodes=10, panels=40)
# of the golden machines, and of the same with bounces and touches
GOLDEN_OPTIONS = CycleOptions(nodes=10, panels=96)
# the size that these need, so that no smaller one is tried before
IDEAL_VALVES = CycleOptions(value_tolerance=1e-7, capacity=6000, max_passes=30000, size=3)
# of golden machines whose ports have no length: they are marched whatever the method
QUASI_STEADY = CycleOptions(value_tolerance=1e-9, panels=48, capacity=1600, max_passes=4000)


def test_a_reed_is_a_cantilever_that_its_port_loads():
    """Its tip by the integral of M m/(E I) along the beam, m the moment of a unit load there."""
    long, place, wide, thick, elastic = 15e-3, 11e-3, 6e-3, 0.15e-3, 200e9
    reed = ReedBeam(
        port_diameter=4e-3, stop=1e-3, thickness=thick, width=wide, length=long,
        port_distance=place, elastic_modulus=elastic, density=7800,
    )  # fmt: skip
    bending = elastic * wide * thick**3 / 12
    tip, _ = quad(lambda x: (place - x) * (long - x) / bending, 0, place)
    np.testing.assert_allclose(reed.oscillator.stiffness, 1 / tip, rtol=1e-12)
    np.testing.assert_allclose(reed.oscillator.mass, 7800 * wide * thick * long / 3, rtol=1e-12)


def mechanism():
    return SliderCrank(
        bore=22e-3,
        crank_radius=9.5e-3,
        conrod_length=44e-3,
        piston_mass=0.05,
        conrod_mass=0.02,
    )


def golden(name: str) -> Cylinder:
    """A, D: air quasi-steady and with port inertia; B, C: R134a; E: C with a restitution of 0.3."""
    more = {
        "port_length": None if name in "AB" else 5e-3,
        "restitution": 0.3 if name == "E" else 0.0,
        "sticking_speed": 1e-4,
    }
    suction = PlateValve(
        mass=1.5e-4, damping=0.02, stiffness=250, stop=1.5e-3, port_diameter=7e-3, **more
    )
    discharge = PlateValve(
        mass=1.2e-4,
        damping=0.03,
        stiffness=700,
        preload=1e-4,
        stop=9e-4,
        port_diameter=5e-3,
        **more,
    )
    if name in "AD":
        fluid = PerfectGas(287.0, 1.4)
        lines = SuctionLine(1e5, 300.0), DischargeLine(5e5, temperature=430.0)
        wall, viscosity, conductivity = 350.0, 1.9e-5, 0.027
    else:
        fluid = RealGas("R134a")
        lines = SuctionLine(114.8e3, 328.15), DischargeLine(1.47e6, temperature=390.0)
        wall, viscosity, conductivity = 370.0, 1.3e-5, 0.015
    heat = Annand(viscosity=viscosity, conductivity=conductivity)
    leak = LaminarGap(5e-6, 12e-3, viscosity)
    return Cylinder(fluid, *lines, suction, discharge, 0.025, wall, heat, leak)


# flows [g/s], leakage [mg/s], work and heat [J], efficiencies, mean enthalpy delivered [J/kg]
NAMES = ("suction", "discharge", "leakage", "work", "heat", "eta_v", "eta_is", "enthalpy")
GOLDEN = {
    name: [float(number) for number in row.split()]
    for name, row in {
        "A": "0.3469454525 0.3461590601 0.7863924817 1.476594617 -0.130258319 0.8393039071 "
        "0.8388678107 295392.688",
        "B": "1.086488633 1.061882632 24.60600051 1.831749404 0.0363781152 0.6851715656 "
        "0.8658845368 535181.395",
        "C": "1.125392776 1.101037478 24.35529885 1.888945294 0.0329454406 0.7104359269 "
        "0.8706272306 534681.632",
        "D": "0.349905221 0.349109706 0.7955150556 1.484482765 -0.131322622 0.8464580998 "
        "0.8415227691 294791.660",
        "E": "1.121168 1.096806 24.3623 1.88523 0.032524 0.707706 0.868991 534793",
    }.items()
}


def figures(cycle):
    t, f = cycle.totals, cycle.frequency
    return np.array(
        [
            t.suction * f * 1e3,
            t.discharge * f * 1e3,
            t.leakage * f * 1e6,
            cycle.indicated_work,
            t.heat,
            cycle.volumetric_efficiency,
            cycle.isentropic_efficiency,
            cycle.discharge_enthalpy,
        ]
    )


def check_figures(cycle, name, tolerance):
    got, wanted = figures(cycle), np.array(GOLDEN[name])
    # heat is a small difference of large amounts to and fro: its error is measured by the work
    scale = np.where(np.array(NAMES) == "heat", wanted[3], wanted)
    np.testing.assert_allclose(got / scale, wanted / scale, rtol=0, atol=tolerance)


def check_events(cycle, name):
    """Impact speeds [m/s] and angles of the last closing [degrees], where all digits are printed."""
    events = cycle.events
    speeds = [float(events.impact_speed(v, stop)) for v in (0, 1) for stop in (True, False)]
    angles = [float(np.degrees(events.closing_angle(v))) for v in (0, 1)]
    wanted = {
        "C": ([3.901420, 1.103135, 8.971194, 2.284247], [204.82416, 0.49054]),
        "D": ([2.070291, 1.537580, 4.916023, 0.786478], [207.83198, 4.76324]),
    }[name]
    np.testing.assert_allclose(speeds, wanted[0], atol=1.5e-6)  # six decimals are printed
    np.testing.assert_allclose(angles, wanted[1], atol=1.5e-5)


@pytest.fixture(scope="module")
def golden_cycle(cycles_and_slopes):
    """The cycle of the air machine, out of the batch."""
    return jax.tree.map(operator.itemgetter(0), cycles_and_slopes[1])


@pytest.mark.parametrize("name", ["D", pytest.param("C", marks=pytest.mark.slow)])
def test_collocation_meets_the_golden_machines(name, golden_cycle):
    cycle = golden_cycle
    if name != "D":
        cycle = solve_cycle(golden(name), mechanism(), SPEED, GOLDEN_OPTIONS)
    assert bool(cycle.converged)
    check_figures(cycle, name, 1e-7)
    check_events(cycle, name)
    assert abs(cycle.mass_closure) < 1e-13
    assert abs(cycle.energy_closure) < 1e-7  # of order 1e-10 with R134a, which needs fewer panels
    shares = cycle.work_losses
    np.testing.assert_allclose(sum(shares.values()), cycle.indicated_work, rtol=1e-12)
    lost = cycle.volume_losses
    np.testing.assert_allclose(sum(lost.values()), 1.0, rtol=1e-12)
    # the share of the suction valve is that of the pressure at the bottom dead centre (here at pi), which
    # is no node: by a cubic through the nodes beside it, to the fourth power of their distance of 0.01
    around = np.argsort(np.abs(np.asarray(cycle.angle) - np.pi))[:4]
    angle, pressure = (np.asarray(a)[around] for a in (cycle.angle, cycle.pressure))
    full = np.polyval(np.polyfit(angle - np.pi, pressure / pressure[0], 3), 0.0) * pressure[0]
    wanted = (1 + cycle.case.cylinder.clearance_ratio) * (1 - full / cycle.case.suction.p)
    np.testing.assert_allclose(lost["suction valve"], wanted, atol=1e-7)


def test_another_speed_or_number_is_no_other_program(monkeypatch):
    solve_cycle(golden("A"), mechanism(), SPEED, QUASI_STEADY)

    def traced_again(*_):
        raise AssertionError("traced again")

    monkeypatch.setattr("jaxcomp.cylinder._solve_cycle.prepare", traced_again)
    other = with_values(golden("A"), clearance_ratio=0.0251)
    assert bool(solve_cycle(other, mechanism(), 0.99 * SPEED, QUASI_STEADY).converged)


def test_pictures_show_the_cycle(golden_cycle):
    cycle = golden_cycle
    figures = cylinder_figures(cycle)
    assert set(figures) == {"valve_losses", "valve_motion"}  # log p-h only of a real gas
    volume, pressure = figures["valve_losses"].axes[0].lines[0].get_data()
    area = np.sum((volume[1:] - volume[:-1]) * (pressure[1:] + pressure[:-1]) / 2)  # cm^3 MPa
    # chords of half a degree and less; those between the nodes of the solver were 2e-3 off
    np.testing.assert_allclose(-area, cycle.indicated_work, rtol=5e-5)
    assert figures["valve_losses"].axes[0].get_ylabel() == "Pressure, MPa"
    for number, line in enumerate(figures["valve_motion"].axes[0].lines[:2]):
        np.testing.assert_allclose(line.get_ydata().max(), 1e3 * cycle.lift[number].max())


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("A", 1e-7),
        *(
            pytest.param(*pair, marks=pytest.mark.slow)
            for pair in (("B", 1e-7), ("C", 1e-7), ("D", 1e-7))
        ),
        pytest.param("E", 2e-6, marks=pytest.mark.slow),  # six digits are printed
    ],
)
def test_the_march_meets_the_golden_machines(name, tolerance):
    marched = CycleOptions(method="march", value_tolerance=1e-9, panels=48, capacity=1600)
    options = QUASI_STEADY if name in "AB" else marched
    cycle = solve_cycle(golden(name), mechanism(), SPEED, options)
    assert cycle.solver == "march"
    check_figures(cycle, name, tolerance)


# field of (cylinder, mechanism); d ln of work, eta_v, delivered mass over work and speed of impact on
# the discharge seat, and the angle [degrees] at which the suction valve shuts, over d ln of the field
ELASTICITIES = """
1.bore                              +1.709135 -0.459053 -0.168188 +3.117178 +261.8251
1.crank_radius                      +0.873363 -0.226709 -0.100072 +1.790853 +129.9593
0.clearance_ratio                   -0.335691 -0.349598 -0.013907 +0.033719   +7.5708
speed                               -0.195245 -0.305955 -0.110710 +2.678300 +189.1071
0.wall_temperature                  +0.150229 -0.182824 -0.333052 -0.313945  -14.0332
0.leakage.gap                       +0.006458 -0.051017 -0.057474 -0.005788   -0.2994
0.suction_valve.mass                -0.048056 -0.058621 -0.010565 -0.009375  +31.0058
0.suction_valve.damping             +0.001462 +0.001468 +0.000006 +0.000197   -0.7505
0.suction_valve.stiffness           +0.135204 +0.139154 +0.003950 +0.020943  -72.4654
0.suction_valve.stop                +0.196923 +0.230113 +0.033190 +0.036433 -114.3364
0.suction_valve.port_diameter       +0.118124 +0.221701 +0.103577 +0.039745 -104.0860
0.suction_valve.flow_coefficient    +0.201829 +0.266908 +0.065079 +0.043972 -130.3162
0.suction_valve.force_coefficient   -0.088610 -0.082001 +0.006609 -0.011767  +42.2101
0.discharge_valve.mass              +0.014943 +0.009166 -0.005778 +0.205094   -0.1697
0.discharge_valve.stiffness         -0.010870 -0.014231 -0.003361 -0.775020   +0.2529
0.discharge_valve.preload           -0.001266 -0.001875 -0.000610 -0.056773   +0.0332
0.discharge_valve.stop              -0.037891 -0.017616 +0.020275 -0.615871   +0.3366
0.discharge_valve.port_diameter     -0.088901 -0.016545 +0.072356 -0.936847   +0.3638
0.discharge_valve.flow_coefficient  -0.061588 -0.020132 +0.041456 -1.597099   +0.4008
*.port_length                       +0.014092 +0.013694 -0.000398 -0.255172   -2.5363
""".strip().splitlines()
FIELDS = [row.split()[0] for row in ELASTICITIES]


def outputs(cylinder, machine, speed, options):
    """ln W, ln eta_v, ln(m_del/W), ln v of the discharge seat, and the suction's closing [degrees]."""
    cycle = solve_cycle(cylinder, machine, speed, options, throw=False)
    work, mass = cycle.indicated_work, cycle.delivered
    impact = cycle.events.impact_speed(1, False)
    logs = [jnp.log(x) for x in (work, cycle.volumetric_efficiency, mass / work, impact)]
    return jnp.stack([*logs, jnp.degrees(cycle.events.closing_angle(0))])


def scaled(field, cylinder, machine, speed, log_factor):
    """The machine with one field times exp(log_factor)."""
    factor = jnp.exp(log_factor)
    if field == "speed":
        return cylinder, machine, speed * factor
    part, path = field.split(".", 1)
    if part == "*":
        both = ("suction_valve.port_length", "discharge_valve.port_length")
        get = operator.attrgetter(*both)
    else:
        get = operator.attrgetter(path)
    parts = [cylinder, machine]
    which = int(part == "1")
    new = jax.tree.map(lambda x: x * factor, get(parts[which]))
    parts[which] = eqx.tree_at(get, parts[which], new)
    return *parts, speed


@pytest.mark.slow  # half a minute of compilation
def test_derivatives_are_the_twenty_elasticities():
    cylinder, machine = golden("C"), mechanism()

    @jax.jit
    def elasticities():
        def shifted(logs):
            parts = cylinder, machine, SPEED
            for name, log in zip(FIELDS, logs, strict=True):
                parts = scaled(name, *parts, log)
            return outputs(*parts, COLLOCATION)

        return jax.jacfwd(shifted)(jnp.zeros(len(FIELDS)))

    got = np.array(elasticities()).T
    wanted = np.array([row.split()[1:] for row in ELASTICITIES], float)
    # six decimals are printed and the differences are good to 5e-7 of an entry
    np.testing.assert_allclose(got[:, :4], wanted[:, :4], rtol=1e-5, atol=2e-6)
    np.testing.assert_allclose(got[:, 4], wanted[:, 4], rtol=1e-5, atol=2e-4)


# changes of the logarithms of bore and suction stop in the differences
STEP = 1e-4
# [-] clearance ratios of the air machine in one batch, by how their cycles end
CLEARANCES = {"converged": 0.025, "no_delivery": 0.8, "bad_input": np.nan}
RESTITUTION = 0.2  # of valves that bounce
SMALL_BOUNCE = 4e-4  # [m/s] below the speed at which these valves rest by default


@pytest.fixture(scope="module")
def cycles_and_slopes():
    """Cycles of the air machine and slopes of the logarithm of their work, in one program.

    Those of `CLEARANCES`, then the first one with `STEP` more and less of bore and stop, and at last
    with valves that bounce and rest below their default speed and below `SMALL_BOUNCE`.
    """
    clearances = [*CLEARANCES.values()] + [CLEARANCES["converged"]] * 6
    changes = STEP * np.array([[0, 0]] * 3 + [[1, 0], [-1, 0], [0, 1], [0, -1]] + [[0, 0]] * 2)
    case = prepare(inertial(), mechanism(), SPEED)
    default = [
        valve.rest_speed(_gas_balance.valve_scales(case, which)[1])
        for which, valve in enumerate(inertial().valves)
    ]
    bounces = [0.0] * 7 + [RESTITUTION] * 2
    rest = [sticking_speeds(golden("D"))] * 7 + [default, [SMALL_BOUNCE] * 2]

    def work(logs, clearance_ratio, restitution, rest_speeds):
        cylinder = with_values(golden("D"), clearance_ratio=clearance_ratio)
        cylinder = eqx.tree_at(restitutions, cylinder, [restitution] * 2)
        cylinder = eqx.tree_at(sticking_speeds, cylinder, [*rest_speeds])
        parts = scaled("1.bore", cylinder, mechanism(), SPEED, logs[0])
        parts = scaled("0.suction_valve.stop", *parts, logs[1])
        cycle = solve_cycle(*parts, GOLDEN_OPTIONS, throw=False)
        return jnp.log(cycle.indicated_work), cycle

    # to compile another program takes longer than its answers
    program = jax.jit(jax.vmap(jax.value_and_grad(work, has_aux=True)))
    numbers = (np.array(rows, float) for rows in (changes, clearances, bounces, rest))
    (works, cycles), slopes = program(*numbers)
    return np.asarray(works), cycles, np.asarray(slopes)


def test_reverse_mode_agrees_with_differences_of_the_cycle(cycles_and_slopes):
    """On the air machine, whose suction valve meets its stop three times."""
    works, _, slopes = cycles_and_slopes
    by_bore, by_stop = slopes[0]
    # 1e-6: the differences' own error, of step^2 and of 1e-11 over the step
    np.testing.assert_allclose(by_bore, (works[3] - works[4]) / (2 * STEP), rtol=1e-6)
    np.testing.assert_allclose(by_stop, (works[5] - works[6]) / (2 * STEP), rtol=1e-5)


def test_the_quasi_steady_law_refuses_derivatives():
    def work(speed):
        cycle = solve_cycle(golden("A"), mechanism(), speed, QUASI_STEADY, throw=False)
        return cycle.indicated_work

    with pytest.raises(NotImplementedError, match="Give both ports a length"):
        jax.grad(work)(SPEED)


def test_a_failure_names_events_and_panels():
    words = (
        r"events of the valves in a revolution, \d+ of suction and \d+ of discharge, on 48 panels"
    )
    with pytest.raises(SolveFailed, match=words):
        # at a tenth of the speed valves flutter all the way
        solve_cycle(golden("A"), mechanism(), 0.1 * SPEED, QUASI_STEADY)


def test_ideal_valves_approach_the_ideal_cycle_at_second_order():
    """Adiabatic, tight, with check valves: the polytropic cycle of the perfect gas."""
    errors = []
    options = IDEAL_VALVES
    for factor in (1.0, 2.0):
        valves = [CheckValve(port_diameter=d, flow_coefficient=0.65 * factor) for d in (7e-3, 5e-3)]
        ideal = Cylinder(
            PerfectGas(287.0, 1.4), SuctionLine(1e5, 300.0), DischargeLine(5e5), *valves, 0.025
        )
        cycle = solve_cycle(ideal, mechanism(), SPEED, options)
        wanted = 0.9460768706, 1.396246158, 1.0
        got = cycle.volumetric_efficiency, cycle.indicated_work, cycle.isentropic_efficiency
        errors.append([abs(float(a) / b - 1) for a, b in zip(got, wanted, strict=True)])
    ratio = np.array(errors[0]) / np.array(errors[1])
    np.testing.assert_allclose(ratio, 4, rtol=0.15)  # and higher orders


def test_ideal_valves_of_a_real_gas_approach_its_isentropes_at_second_order():
    """The clearance expands along the isentrope; the work is mass times the isentropic rise."""
    errors = []
    options = IDEAL_VALVES
    lines = SuctionLine(114.8e3, 328.15), DischargeLine(1.47e6, temperature=390.0)
    for factor in (1.0, 2.0):
        valves = [CheckValve(port_diameter=d, flow_coefficient=0.65 * factor) for d in (7e-3, 5e-3)]
        ideal = Cylinder(RealGas("R134a"), *lines, *valves, 0.025)
        cycle = solve_cycle(ideal, mechanism(), SPEED, options)
        case = cycle.case
        limit = 1 + 0.025 - 0.025 * case.isentropic.rho / case.suction.rho
        np.testing.assert_allclose(limit, 0.75106795, rtol=1e-8)  # the digits that are known of it
        work = limit * case.mass_scale * cycle.isentropic_rise
        wanted = limit, work, 1.0
        got = cycle.volumetric_efficiency, cycle.indicated_work, cycle.isentropic_efficiency
        errors.append([abs(float(a) / b - 1) for a, b in zip(got, wanted, strict=True)])
    ratio = np.array(errors[0]) / np.array(errors[1])
    np.testing.assert_allclose(ratio, 4, rtol=0.15)  # and higher orders


def test_failures_are_words_and_leave_the_batch_alone(cycles_and_slopes):
    _, cycles, _ = cycles_and_slopes
    for i, word in enumerate(CLEARANCES):
        ended = jax.tree.map(operator.itemgetter(i), cycles.status)
        assert bool(ended == getattr(Status, word)), word
    for leaf in (cycles.indicated_work, cycles.delivered, cycles.pressure, cycles.peak_pressure):
        assert bool(jnp.all(jnp.isfinite(leaf)))
    np.testing.assert_allclose(cycles.indicated_work[0], GOLDEN["D"][3], rtol=1e-7)
    # shut off: what is put in goes to the wall and past the piston
    t = jax.tree.map(lambda x: x[1], cycles.totals)
    np.testing.assert_allclose(t.discharge, 0.0, atol=1e-20)
    into = t.suction_heat - t.leakage_heat + t.heat
    np.testing.assert_allclose(into, t.work, rtol=1e-6)


@pytest.mark.slow
def test_a_failure_is_raised_with_its_reason():
    shut = eqx.tree_at(lambda c: c.clearance_ratio, golden("D"), jnp.asarray(0.8))
    with pytest.raises(SolveFailed, match="does not open the discharge valve"):
        solve_cycle(shut, mechanism(), SPEED, COLLOCATION)


def test_heat_and_leakage_that_are_absent_are_not_traced():
    full = golden("D")
    bare = Cylinder(
        full.fluid, full.suction, full.discharge, full.suction_valve, full.discharge_valve, 0.025
    )

    def operations(cylinder):
        from jaxcomp.cylinder._gas_balance import rates

        case = prepare(cylinder, mechanism(), SPEED)
        state, flags = initial(case, -1.5)
        return len(jax.make_jaxpr(lambda y: rates(case, -1.5, y, flags).state)(state).eqns)

    assert operations(bare) < operations(full) - 20


def test_lines_take_one_of_two_and_heat_needs_a_wall():
    with pytest.raises(ValueError, match="one of `pressure` and `evaporating`"):
        SuctionLine(temperature=300.0)
    full = golden("D")
    with pytest.raises(ValueError, match="needs a `wall_temperature`"):
        Cylinder(
            full.fluid,
            full.suction,
            full.discharge,
            full.suction_valve,
            full.discharge_valve,
            0.025,
            heat=full.heat,
        )


def with_values(cylinder, **values):
    """A cylinder with other numbers, by the path of their fields."""
    for path, value in values.items():
        get = operator.attrgetter(path.replace("__", "."))
        cylinder = eqx.tree_at(get, cylinder, jnp.asarray(value))
    return cylinder


# [rpm], changes of the air machine and the word it may end with
EXTREMES = {
    "crawling": (50, {}, "too_many_events"),  # the suction valve flutters all the way down
    "racing": (20_000, {}, None),
    "light valves": (2950, {"suction_valve__mass": 1e-9, "discharge_valve__mass": 1e-9}, None),
    "heavy valves": (2950, {"suction_valve__mass": 10.0, "discharge_valve__mass": 10.0}, None),
    "no pressure ratio": (2950, {"discharge__pressure": 1e5}, "bad_input"),
    "shut off": (2950, {"clearance_ratio": 0.8}, "no_delivery"),
    "hardly any clearance": (2950, {"clearance_ratio": 1e-4}, "converged"),
    "wide gap": (2950, {"leakage__gap": 1e-4}, None),
}


@pytest.mark.slow  # half a minute, most of it compilation
def test_extreme_machines_converge_or_say_why():
    base, names = golden("D"), [*EXTREMES]
    cylinders = [with_values(base, **EXTREMES[name][1]) for name in names]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *cylinders)
    speeds = jnp.array([EXTREMES[name][0] for name in names]) * 2 * jnp.pi / 60

    @jax.jit
    def run(batch, speeds):
        def one(pair):
            return solve_cycle(pair[0], mechanism(), pair[1], throw=False)

        return jax.lax.map(one, (batch, speeds))

    cycles = run(batch, speeds)
    words = ("converged", "no_delivery", "not_converged", "too_many_events", "bad_input")
    for i, name in enumerate(names):
        cycle = jax.tree.map(operator.itemgetter(i), cycles)
        ended = [word for word in words if bool(cycle.status == getattr(Status, word))]
        assert ended, name
        assert EXTREMES[name][2] in (None, *ended), (name, ended)
        for number in (cycle.indicated_work, cycle.delivered, cycle.peak_pressure):
            assert bool(jnp.isfinite(number)), name
        if ended == ["converged"]:
            assert abs(cycle.mass_closure) < 1e-11, name
            assert abs(cycle.energy_closure) < 1e-3, name


def test_leakage_and_heat_switch_off_exactly():
    """A gap of zero is no leakage, to the last bit of the balance."""
    base = golden("C")
    tight = eqx.tree_at(lambda c: c.leakage, base, None)
    closed = with_values(base, leakage__gap=0.0)
    found = []
    for cylinder in (tight, closed):
        case = prepare(cylinder, mechanism(), SPEED)
        state, flags = initial(case, -1.5)
        found.append(rates(case, -1.2, state, flags).state)
    np.testing.assert_array_equal(*found)


def test_wet_suction_is_seen():
    """The gas of the suction line is denser than on the dew line."""
    wet = eqx.tree_at(
        lambda c: c.suction.temperature, golden("C"), jnp.asarray(240.0)
    )  # below the dew point of 249.85 K at 114.8 kPa
    fluid = wet.fluid
    state = eqx.filter_jit(lambda line: line.state(fluid))(
        wet.suction
    )  # outside of a program it is refused
    assert bool(fluid.is_wet(state.T, state.rho))
    dry = golden("C").suction.state(fluid)
    assert not bool(fluid.is_wet(dry.T, dry.rho))


SCATTERED = [
    "clearance_ratio",
    "leakage.gap",
    "suction_valve.mass",
    "suction_valve.stiffness",
    "suction_valve.stop",
    "suction_valve.port_diameter",
    "suction_valve.damping",
    "suction_valve.port_length",
    "discharge_valve.mass",
    "discharge_valve.stiffness",
    "discharge_valve.stop",
    "discharge_valve.port_diameter",
    "discharge_valve.preload",
    "discharge_valve.port_length",
]


def test_bouncing_valves_rest_by_the_scales_of_their_plates(cycles_and_slopes):
    """The last bounces that count are of 1 mm/s; those down to 0.4 mm/s add 1e-9 of the flow."""
    bouncing = jax.tree.map(operator.itemgetter(slice(-2, None)), cycles_and_slopes[1])
    assert bool(jnp.all(bouncing.converged))
    efficiencies = bouncing.volumetric_efficiency
    assert efficiencies[0] != efficiencies[1]
    np.testing.assert_allclose(*efficiencies, rtol=1e-8)


@pytest.mark.parametrize("which", [0, 1])
def test_a_rebound_below_the_scale_of_a_plate_is_its_last(which):
    """Where no speed is given, and one that is a hundredth faster bounces on."""
    cylinder = eqx.tree_at(restitutions, inertial(), [jnp.asarray(0.2)] * 2)
    case = prepare(cylinder, mechanism(), SPEED)
    state, flags = initial(case, -1.5)
    scale = _gas_balance.valve_scales(case, which)[1]
    rest_speed = cylinder.valves[which].rest_speed(scale)
    # at the seat, pressed on
    flags = flags.at[3 * which].set(_gas_balance.FREE)
    codes = []
    for share in (0.99, 1.01):
        falling = state.at[3 + 3 * which].set(-share * rest_speed / (0.2 * scale))
        code, _ = after_event(case, jnp.asarray(4 * which), falling, flags, jnp.array([-1.0, -1.0]))
        codes.append(int(code))
    assert codes == [1, 3]


def inertial() -> Cylinder:
    """The golden machine D, whose valves rest by their own scales."""
    return eqx.tree_at(sticking_speeds, golden("D"), [None] * 2, is_leaf=_absent)


def restitutions(cylinder):
    return [valve.restitution for valve in cylinder.valves]


def sticking_speeds(cylinder):
    return [valve.sticking_speed for valve in cylinder.valves]


def _absent(leaf):
    return leaf is None


def test_whether_a_valve_rests_is_decided_without_the_damping_of_its_impact():
    """A force that presses on the seat holds a valve that meets it, however fast it comes."""
    from jaxcomp.cylinder._gas_balance import FREE, SEAT

    case = prepare(with_values(golden("D"), suction_valve__damping=50.0), mechanism(), SPEED)
    state, flags = initial(case, -1.5)  # compressed: the pressure presses the suction valve down
    state, flags = state.at[3].set(-1.0), flags.at[0].set(FREE)
    found = rates(case, -1.5, state, flags)
    assert float(found.state[3]) > 0  # the damping is the larger force
    code, after = after_event(case, jnp.asarray(0), state, flags, found.force)
    assert int(code) == 1
    assert int(after[0]) == SEAT


@pytest.mark.slow  # twenty seconds, most of it compilation
def test_an_implicit_method_of_diffrax_follows_the_collocation():
    """Kvaerno5 between the edges of the panels, with the laws and nothing else in common."""
    import diffrax

    from jaxcomp.cylinder._gas_balance import rates

    cycle = solve_cycle(golden("C"), mechanism(), SPEED, COLLOCATION)
    mesh, z, _ = cycle.raw
    wide = np.flatnonzero(np.diff(z.edges) > 1e-6)

    def law(angle, state, flags):
        return rates(cycle.case, angle, state, flags).state

    def end(panel):
        begin, stop, state, flags = panel
        return diffrax.diffeqsolve(
            diffrax.ODETerm(law),
            diffrax.Kvaerno5(),
            begin,
            stop,
            0.1 * (stop - begin),
            state,
            flags,
            stepsize_controller=diffrax.PIDController(1e-9, 1e-10),
        ).ys[-1]

    panels = (z.edges[:-1][wide], z.edges[1:][wide], z.left[wide], mesh.flags[wide])
    ends = jax.jit(lambda panels: jax.lax.map(end, panels))(panels)
    # ten times the tolerance of a step
    np.testing.assert_allclose(ends, z.points[wide, -1], rtol=1e-8, atol=1e-8)


@pytest.mark.slow  # half a minute
def test_scattered_designs_converge_or_say_why():
    """Fourteen numbers and the speed at half to twice the golden machine's: few sequences are alike."""
    base, count = golden("C"), 1000
    draw = np.random.default_rng(1).uniform(-1, 1, (count, len(SCATTERED) + 1))

    def get(cylinder):
        return operator.attrgetter(*SCATTERED)(cylinder)

    def one(factors, options):
        numbers = tuple(x * f for x, f in zip(get(base), factors, strict=False))
        made, speed = eqx.tree_at(get, base, numbers), SPEED * factors[-1]
        cycle = solve_cycle(made, mechanism(), speed, options, throw=False)
        outputs = jnp.stack([cycle.indicated_work, cycle.delivered, cycle.peak_pressure])
        closures = jnp.stack([cycle.mass_closure, cycle.energy_closure])
        return cycle.converged, outputs, closures, cycle.events.which

    @partial(jax.jit, static_argnums=1)
    def solved(factors, size):
        return jax.lax.map(lambda f: one(f, CycleOptions(size=size)), factors)

    factors = jnp.asarray(2.0**draw)
    found = [np.array(part) for part in solved(factors, 0)]
    # a program that is traced has one size
    for size in (1, 2):
        short = ~found[0]
        for part, larger in zip(found[:3], solved(factors[short], size), strict=False):
            part[short] = larger
    ok, outputs, closures, which = found
    assert np.all(np.isfinite(outputs))
    assert np.mean(ok) > 0.995
    assert np.abs(closures[ok, 0]).max() < 1e-11
    closing = np.abs(closures[ok, 1])
    # 1.7e-4 with the default six nodes, where valves bounce longest (37 events); next to it 5e-5
    assert closing.max() < 3e-4
    assert np.sort(closing)[-2] < 1e-4
    assert np.median(closing) < 1e-7
    assert len({tuple(row[row >= 0].tolist()) for row in np.asarray(which)}) > 300
