import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import GAS, machine
from scipy.integrate import quad

from jaxcomp import BadInput
from jaxcomp._core.fields import admissible, clipped
from jaxcomp.compressor import cylinder_pressure, kink_angles, stroke_at
from jaxcomp.gas import (
    CallableDiagram,
    CrankAngleTable,
    DoubleActing,
    FourierDiagram,
    PolytropicCycle,
    Stroke,
    VolumeTable,
)

SWEPT = 1.327e-3

pressure_at = eqx.filter_jit(lambda gas, stroke: gas.pressure(stroke))
pressure_in = eqx.filter_jit(lambda *given: cylinder_pressure(*given)[0])


def cycle(**changes):
    return PolytropicCycle(**(GAS | changes))


def closed_form_work(p_s, p_d, n, clearance, swept):
    """Work [J] that an ideal-valve polytropic cycle takes in a turn (any textbook)."""
    largest = (1 + clearance) * swept
    ratio = p_d / p_s
    if largest <= clearance * swept * ratio ** (1 / n):
        return 0.0
    if n == 1:
        branch = lambda p, v: p * v * np.log(ratio)  # noqa: E731
    else:
        branch = lambda p, v: n / (n - 1) * p * v * (ratio ** ((n - 1) / n) - 1)  # noqa: E731
    # compression, discharge and suction, less what the clearance gas gives back
    return branch(p_s, largest) - branch(p_s, clearance * swept * ratio ** (1 / n))


def indicated_work(gas, swept=SWEPT):
    """The same by quadrature over volume, piece by piece between the valve events."""
    (discharge, _), (suction, _) = gas.valve_events(jnp.asarray(swept))

    def pressure(v, inward):
        zero = jnp.asarray(0.0)
        return float(pressure_at(gas, Stroke(zero, jnp.asarray(v), jnp.asarray(swept), inward)))

    total = 0.0
    for event, inward in ((discharge, 1.0), (suction, -1.0)):
        for low, high in ((0.0, float(event)), (float(event), swept)):
            if high > low:
                part, _ = quad(pressure, low, high, args=(inward,), epsrel=1e-11, epsabs=0)
                total += inward * part
    return total


@pytest.mark.parametrize("n", [1.0, 1.05, 1.4])
@pytest.mark.parametrize("clearance", [0.0, 0.006, 0.08])
def test_indicated_work_is_the_closed_form(n, clearance):
    gas = cycle(exponent=n, clearance_ratio=clearance)
    expected = closed_form_work(
        GAS["suction_pressure"], GAS["discharge_pressure"], n, clearance, SWEPT
    )
    # ten digits are what `quad` was asked for
    assert indicated_work(gas) == pytest.approx(expected, rel=1e-9)


def test_every_pressure_on_a_double_acting_piston_has_its_own_area():
    ends = cycle(), cycle(suction_pressure=2e5, clearance_ratio=0.1)
    gas = DoubleActing(*ends, rod_diameter=0.04, ambient_pressure=0.9e5)
    area, rod = np.pi / 4 * 0.1**2, np.pi / 4 * 0.04**2
    displaced, inward = SWEPT * np.array([0.0, 0.3, 0.8, 0.4]), np.array([1.0, 1.0, -1.0, -1.0])
    near, far = (
        Stroke(jnp.zeros(4), jnp.asarray(d), jnp.asarray(SWEPT), jnp.asarray(way))
        for d, way in ((displaced, inward), (SWEPT - displaced, -inward))
    )
    head, net = gas.on_piston(near, area)
    np.testing.assert_array_equal(head, ends[0].pressure(near))
    force = area * head - (area - rod) * ends[1].pressure(far) - rod * 0.9e5
    np.testing.assert_allclose(area * net, force, rtol=1e-13)  # rounding


@pytest.mark.parametrize("n", [1.0, 1.3])
def test_no_work_without_flow(n):
    """With a clearance this large the compression ends below the discharge pressure."""
    gas = cycle(exponent=n, clearance_ratio=0.3)
    top = Stroke(jnp.zeros(2), jnp.zeros(2), jnp.asarray(SWEPT), jnp.asarray([1.0, -1.0]))
    pressure = np.asarray(pressure_at(gas, top))
    assert pressure[0] == pytest.approx(pressure[1], rel=1e-14)
    assert pressure[0] < GAS["discharge_pressure"]
    size = GAS["discharge_pressure"] * SWEPT
    assert abs(indicated_work(gas)) < 1e-10 * size


def test_work_vanishes_continuously_as_the_clearance_grows():
    limit = 1 / (10 ** (1 / 1.05) - 1)  # clearance at which p_d is just reached
    works = [indicated_work(cycle(clearance_ratio=limit * (1 - gap))) for gap in (1e-2, 1e-4)]
    assert 0 < works[1] < 2e-2 * works[0]


@pytest.mark.parametrize("offset", [0.0, 0.03, -0.03])
@pytest.mark.parametrize("clearance", [0.0, 0.006, 0.3])
@pytest.mark.parametrize("n", [1.0, 1.2])
def test_pressure_is_continuous_at_valve_events_and_dead_centres(offset, clearance, n):
    compressor = machine(offset=offset, clearance_ratio=clearance, exponent=n)
    kinks = np.asarray(kink_angles(compressor))
    top = float(compressor.mechanism.dead_centres()[0])
    gap = 1e-7
    p = np.asarray(pressure_in(compressor, np.stack([kinks - gap, kinks, kinks + gap])))
    jump = np.abs(p[2] - p[0]) / GAS["discharge_pressure"]
    if clearance == 0:  # without clearance gas the pressure falls at once at the top dead centre
        at_top = np.abs(kinks - top) < 1e-6
        assert np.all(jump[at_top] > 0.5)
        jump = jump[~at_top]
    # dp/dtheta is about 3 p_d at most here
    np.testing.assert_allclose(jump, 0.0, atol=10 * gap)
    assert np.all(np.isfinite(p))


def test_kinks_are_where_the_slope_of_pressure_jumps():
    """No kink of the pressure is missed, and every valve event is one."""
    compressor = machine(offset=0.02)
    angles = np.linspace(0, 2 * np.pi, 40001)[:-1]
    p = np.asarray(pressure_in(compressor, angles))
    step = angles[1]
    bend = np.abs(np.roll(p, -1) - 2 * p + np.roll(p, 1)) / step
    rough = angles[bend > 0.05 * bend.max()]
    kinks = np.mod(np.asarray(kink_angles(compressor)), 2 * np.pi)
    distance = np.abs(rough[:, None] - kinks)
    distance = np.minimum(distance, 2 * np.pi - distance)
    # at the two dead centres p is smooth at suction and discharge; two valve events remain
    near = distance.min(axis=1) < 2 * step
    assert near.all()
    assert len(set(distance.argmin(axis=1))) == 2


def test_stroke_counts_from_the_true_dead_centres():
    compressor = machine(offset=0.08)
    top, bottom = compressor.mechanism.dead_centres()
    at = stroke_at(compressor, jnp.stack([top, bottom]))
    stroke = jax.tree.map(lambda x: x[0] if jnp.ndim(x) > 1 else x, at)
    np.testing.assert_allclose(stroke.displaced / stroke.swept, [0.0, 1.0], atol=1e-14)


def test_turning_backward_exchanges_the_strokes():
    compressor = machine()
    angle = jnp.linspace(0.1, 3.0, 20)
    forward = pressure_in(compressor, -angle)
    backward = pressure_in(compressor, angle, jnp.asarray(-1.0))
    np.testing.assert_allclose(forward, backward, rtol=1e-14)


@pytest.mark.parametrize("clearance", [0.0, 0.006])
def test_pressure_and_its_derivatives_are_finite_everywhere(clearance):
    gas = cycle(clearance_ratio=clearance)

    def pressures(gas, fraction, inward):
        return pressure_at(gas, Stroke(fraction, fraction * SWEPT, jnp.asarray(SWEPT), inward))

    fraction = jnp.asarray([0.0, 1e-12, 0.05, 0.5, 1.0])
    both = jax.jit(jax.jacfwd(pressures, argnums=(0, 1)))
    for inward in (1.0, -1.0, 0.0):
        slopes = both(gas, fraction, jnp.full(5, inward))
        assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(slopes))


# ---------------------------------------------------------------- prescribed diagrams
def table(points=60):
    angle = np.sort(np.random.default_rng(3).uniform(0.1, 6.2, points))
    pressure = 3e5 + 1e5 * np.cos(angle) + 5e4 * np.sin(2 * angle)
    return angle, pressure


def at_angle(angle):
    angle = jnp.asarray(angle)
    return Stroke(angle, jnp.zeros_like(angle), jnp.asarray(SWEPT), jnp.ones_like(angle))


def test_angle_table_is_exact_at_its_points_in_any_turn():
    angle, pressure = table()
    gas = CrankAngleTable(angle, pressure, 1e5)
    for turns in (0, 1, -3):
        got = pressure_at(gas, at_angle(angle + 2 * np.pi * turns))
        # the angle of another turn is known to rounding only
        np.testing.assert_allclose(got, pressure, rtol=1e-12)


@jax.jit
def slopes_at(gas, angles):
    return jax.vmap(jax.grad(lambda angle: gas.pressure(at_angle(angle))))(angles)


def test_angle_table_is_smooth_across_the_seam_and_converges():
    errors = []
    for points in (40, 80):
        angle = 0.2 + np.linspace(0, 2 * np.pi, points, endpoint=False)
        curve = lambda a: 3e5 + 1e5 * np.cos(a) + 5e4 * np.sin(2 * a)  # noqa: E731
        gas = CrankAngleTable(angle, curve(angle), 1e5)
        fine = np.linspace(-1, 8, 5001)
        errors.append(np.max(np.abs(pressure_at(gas, at_angle(fine)) - curve(fine))))
        seam = 0.2 + np.array([-1e-6, 1e-6])
        slopes = slopes_at(gas, jnp.asarray(seam))
        np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-3)
    assert errors[0] / errors[1] > 6.5  # third order


def test_fourier_diagram_equals_its_table():
    """A table of the series, so fine that the cubic adds less than the tolerance."""
    rng = np.random.default_rng(1)
    cosine, sine = rng.normal(0, 3e4, (2, 5))
    fourier = FourierDiagram(4e5, cosine, sine, 1e5)
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    by_hand = 4e5 + sum(
        cosine[k] * np.cos((k + 1) * angle) + sine[k] * np.sin((k + 1) * angle) for k in range(5)
    )
    np.testing.assert_allclose(pressure_at(fourier, at_angle(angle)), by_hand, rtol=1e-13)
    between = angle + 0.3 * angle[1]
    gas = CrankAngleTable(angle, by_hand, 1e5)
    # (k h)^3 = (5 x 3e-3)^3 of the highest harmonic
    np.testing.assert_allclose(
        pressure_at(gas, at_angle(between)), pressure_at(fourier, at_angle(between)), rtol=1e-6
    )


def test_fourier_diagram_takes_one_angle_and_no_harmonics():
    assert FourierDiagram(4e5, [1e4], [0.0], 1e5).pressure(at_angle(0.0)) == pytest.approx(4.1e5)
    flat = FourierDiagram(4e5, np.zeros(0), np.zeros(0), 1e5)
    np.testing.assert_allclose(flat.pressure(at_angle(np.ones(3))), 4e5)


def test_volume_table_is_exact_at_its_points_on_both_strokes():
    fraction = np.array([0.0, 0.05, 0.3, 0.7, 1.0])
    inward, outward = (
        np.array([9.0, 9.0, 4.0, 2.0, 1.0]) * 1e5,
        np.array([9.0, 3.0, 1.0, 1.0, 1.0]) * 1e5,
    )
    gas = VolumeTable(fraction, inward, outward, 1e5)
    for sign, expected in ((1.0, inward), (-1.0, outward)):
        stroke = Stroke(
            jnp.zeros(5), jnp.asarray(fraction * SWEPT), jnp.asarray(SWEPT), jnp.full(5, sign)
        )
        np.testing.assert_allclose(pressure_at(gas, stroke), expected, rtol=1e-13)


class Spring(eqx.Module):
    stiffness: jax.Array

    def __call__(self, stroke):
        return 1e5 + self.stiffness * (stroke.swept - stroke.displaced)


def test_callable_diagram_keeps_its_own_parameters():
    gas = CallableDiagram(Spring(jnp.asarray(2e8)), 1e5)
    stroke = Stroke(jnp.zeros(2), jnp.asarray([0.0, SWEPT]), jnp.asarray(SWEPT), jnp.ones(2))
    np.testing.assert_allclose(pressure_at(gas, stroke), [1e5 + 2e8 * SWEPT, 1e5])
    slope = jax.grad(lambda g: jnp.sum(g.pressure(stroke)))(gas).function.stiffness
    assert slope == pytest.approx(SWEPT)


# ---------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"discharge_pressure": 0.097e6}, "discharge_pressure > suction_pressure"),
        ({"discharge_pressure": 0.098e6}, "discharge_pressure > suction_pressure"),
        ({"suction_pressure": 0.0}, "`suction_pressure` must be > 0"),
        ({"exponent": 0.9}, "`exponent` must be >= 1 and <= 3, but is 0.9"),
        ({"clearance_ratio": -0.01}, "`clearance_ratio` must be >= 0"),
        ({"back_pressure": np.nan}, "`back_pressure` must be >= 0 Pa, but is nan"),
    ],
)
def test_bad_cycle_is_refused_by_name(changes, words):
    with pytest.raises(BadInput) as caught:
        cycle(**changes)
    assert words in str(caught.value)


def test_back_pressure_defaults_to_suction():
    assert cycle(back_pressure=None).behind_piston == GAS["suction_pressure"]


@pytest.mark.parametrize(
    "place",
    [
        pytest.param("repeated", marks=pytest.mark.slow),
        "beyond",
        pytest.param("swapped", marks=pytest.mark.slow),
        pytest.param("none", marks=pytest.mark.slow),
    ],
)
def test_a_traced_table_outside_its_rules_is_marked_and_finite(place):
    bad = {
        "repeated": lambda x: x.at[2].set(x[1]),
        "swapped": lambda x: x.at[2].set(x[1] - 0.1),
        "beyond": lambda x: x.at[-1].set(9.0),
        "none": lambda x: x.at[2].set(jnp.nan),
    }[place]
    volume = VolumeTable(
        jnp.linspace(0, 1, 9), jnp.linspace(9e5, 1e5, 9), jnp.linspace(9e5, 1e5, 9), 1e5
    )
    angle = jnp.linspace(0.0, 6.0, 9)
    crank = CrankAngleTable(angle, 1e5 * (2 + jnp.sin(angle)), 1e5)
    angles = jnp.linspace(0.0, 2 * np.pi, 7)
    strokes = eqx.filter_jit(jax.vmap(stroke_at, (None, 0)))(machine(), angles)

    def seen(table, knots):
        traced = eqx.tree_at(lambda t: getattr(t, knots), table, bad(getattr(table, knots)))
        pressure = jax.vmap(clipped(traced).pressure)(strokes)
        return pressure, (admissible(traced), pressure)

    for table, knots in ((volume, "volume"), (crank, "angle")):
        # one program for values and slopes
        both = jax.jit(jax.jacrev(seen, has_aux=True), static_argnums=1)
        slope, (good, pressure) = both(table, knots)
        assert not good
        assert np.all(np.isfinite(pressure))
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slope))


def test_a_good_table_passes_the_repair_untouched():
    angle = jnp.linspace(0.0, 6.0, 9)
    crank = CrankAngleTable(angle, 1e5 * (2 + jnp.sin(angle)), 1e5)
    assert eqx.tree_equal(clipped(crank), crank)


@pytest.mark.parametrize("clearance", [0.0, 0.02, 0.1, 0.2, 1.0])
def test_a_cycle_delivers_where_it_has_work(clearance):
    gas = cycle(clearance_ratio=clearance)
    work = indicated_work(gas)
    scale = float(gas.suction_pressure) * SWEPT
    # the work of a closed cycle is rounding and the quadrature's 1e-9
    assert bool(gas.delivers) == (abs(work) > 1e-6 * scale)


def test_bad_tables_are_refused():
    with pytest.raises(BadInput, match="rising angles"):
        CrankAngleTable([0.0, 2.0, 1.0], [1e5, 1e5, 1e5], 1e5)
    with pytest.raises(BadInput, match="within one revolution"):
        CrankAngleTable([0.0, 2.0, 2 * np.pi + 0.1], [1e5, 1e5, 1e5], 1e5)
    with pytest.raises(BadInput, match="three points"):  # the last is the first
        CrankAngleTable([0.0, 2.0, 2 * np.pi], [1e5, 1e5, 1e5], 1e5)
    with pytest.raises(BadInput, match="three points"):
        CrankAngleTable([0.0, 2.0], [1e5, 1e5], 1e5)
    with pytest.raises(ValueError, match="same length"):
        CrankAngleTable([0.0, 1.0, 2.0], [1e5, 1e5], 1e5)
    with pytest.raises(BadInput, match="from 0 to 1"):
        VolumeTable([0.0, 0.5, 0.9], [1e5] * 3, [1e5] * 3, 1e5)
    with pytest.raises(ValueError, match="same length"):
        FourierDiagram(1e5, [1.0], [1.0, 2.0], 1e5)


def test_a_table_over_two_revolutions_is_refused_in_one_line():
    angle = np.linspace(0, 4 * np.pi, 72, endpoint=False)
    with pytest.raises(BadInput, match="two, as of four strokes, are not modelled") as told:
        CrankAngleTable(angle, 1e5 + 0 * angle, 1e5)
    assert len(str(told.value)) < 250
