"""The work of a given indicator diagram is that of its curve, however dense the points."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import machine, status_of
from scipy.interpolate import CubicHermiteSpline

from jaxcomp import CrankAngleTable, PolytropicCycle, VolumeTable, solve_orbit
from jaxcomp.compressor import kink_angles, stroke_at
from jaxcomp.crank._collocation import default_collocation
from jaxcomp.gas import FourierDiagram
from jaxcomp.gas._gas_law import EachGas
from jaxcomp.scene import loads, start

# [Pa] A cycle like that of the golden machine; its points alone reach the solver.
CYCLE = PolytropicCycle(98e3, 980e3, 1.2, 0.03, 98e3)


@jax.jit
def pressure_over_angle(compressor, gas, angle):
    """[Pa] In the cylinder of a machine with another cycle."""
    return gas.pressure(stroke_at(compressor, angle))[0]


kinks_of = jax.jit(kink_angles)


@jax.jit
def displacement_slope(mechanism, angle):
    """[m] Slope of the piston's displacement over the crank angle."""
    return mechanism.kinematics(angle).position_1


def table_over_angle(points, gas=CYCLE):
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    pressure = pressure_over_angle(machine(), gas, jnp.asarray(angle))
    return CrankAngleTable(angle, np.asarray(pressure), 98e3)


def curve_slopes(x, y):
    """Slopes of the parabola through three neighbours, at all but the ends."""
    step, secant = np.diff(x), np.diff(y) / np.diff(x)
    return (step[1:] * secant[:-1] + step[:-1] * secant[1:]) / (step[1:] + step[:-1])


def work_over_angle(table):
    """[J] Of a revolution, by Gauss's rule between neighbouring points."""
    angle, pressure = np.asarray(table.angle), np.asarray(table.cylinder_pressure)
    turn = 2 * np.pi
    x = np.concatenate([angle[-2:] - turn, angle, angle[:2] + turn])
    y = np.concatenate([pressure[-2:], pressure, pressure[:2]])
    curve = CubicHermiteSpline(x[1:-1], y[1:-1], curve_slopes(x, y))
    edges = np.append(angle, angle[0] + turn)
    # dead centres are no edges: the pressure is smooth there and the volume as well
    node, weight = np.polynomial.legendre.leggauss(12)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    at = (middle[:, None] + half[:, None] * node).ravel()
    around = (half[:, None] * weight).ravel()
    mechanism = machine().mechanism
    slope = np.asarray(displacement_slope(mechanism, jnp.asarray(at)))
    # the torque of the gas on the crank is p A dx/dtheta, x towards the head; its work on the gas
    force = curve(at) * float(mechanism.piston_area)
    return float(np.sum(around * force * slope))


def solver_of(made):
    """The default without edges at load reversals, which the gas does not see: smaller programs."""
    return dataclasses.replace(default_collocation(made), reversals=0)


# 181 by default as the closed table below, whose program serves here as well
@pytest.mark.parametrize("points", [24, 97, 181])
def test_a_diagram_over_the_angle_keeps_its_work(points):
    table = table_over_angle(points)
    made = machine(gas=table)
    orbit = solve_orbit(made, None if points == 181 else solver_of(made))
    exact = work_over_angle(table)
    # seen: 1e-9 with 4 nodes between neighbours, 1e-12 with 8
    assert float(orbit.energy.gas_work) == pytest.approx(exact, rel=1e-8)
    assert float(orbit.gas_work_error) >= abs(float(orbit.energy.gas_work) - exact)
    assert float(orbit.gas_work_error) < 1e-6 * exact


def of_instruments(points):
    """The template's machine with its cycle every 2 degrees, to 1e-4 bar."""
    template = loads(start("slider-crank", "my-machine")).compressor
    degrees = np.arange(0, 2 * points, 2)
    angle = jnp.asarray(np.deg2rad(degrees % 360))
    bar = np.round(np.asarray(pressure_over_angle(template, template.gas, angle)) / 1e5, 4)
    table = CrankAngleTable(np.deg2rad(degrees), 1e5 * bar, 98e3)
    # the joints of the machine above, of which the work of the gas knows nothing
    return dataclasses.replace(machine(gas=table), mechanism=template.mechanism)


def test_a_diagram_as_instruments_write_it_has_the_work_of_its_curve():
    """Closed by the first point once more, and open: 17.6447 J by the periodic cubic."""
    closed = of_instruments(181)
    orbit = solve_orbit(closed)
    assert float(orbit.energy.gas_work) == pytest.approx(17.6447, abs=5e-5)
    # one curve with the same kinks, which the same default solver takes at the nodes of that orbit
    made = of_instruments(180)
    pressures = [
        np.asarray(pressure_over_angle(one, one.gas, orbit.state.angle)) for one in (made, closed)
    ]
    np.testing.assert_allclose(*pressures, rtol=1e-12)
    edges = [np.unique(np.asarray(kinks_of(one)).round(12)) for one in (made, closed)]
    np.testing.assert_array_equal(*edges)
    assert default_collocation(made) == default_collocation(closed)


def test_a_diagram_over_the_volume_keeps_its_work():
    """Polygons of the cubics' integrals: the volume is the abscissa, so that no mechanism matters."""
    share = np.linspace(0, 1, 41)
    inward, outward = 98e3 + 4e5 * (1 - share) ** 2, 98e3 + 3e5 * np.exp(-20 * share)
    made = machine(gas=VolumeTable(share, inward, outward, 98e3))
    orbit = solve_orbit(made, solver_of(made))

    def mean(pressure):
        secant, inner = np.diff(pressure) / np.diff(share), curve_slopes(share, pressure)
        ends = 2 * secant[0] - inner[0], 2 * secant[-1] - inner[-1]
        slopes = np.concatenate([[ends[0]], inner, [ends[1]]])
        return CubicHermiteSpline(share, pressure, slopes).integrate(0, 1)

    exact = float(machine().mechanism.swept_volume) * (mean(inward) - mean(outward))
    assert float(orbit.energy.gas_work) == pytest.approx(exact, rel=1e-8)


def test_a_table_among_other_laws_keeps_its_points():
    table = table_over_angle(24)
    each = EachGas((table, CYCLE))
    assert each.event_angles().shape == (2, 24)
    assert each.event_shares() is None


def test_dense_tables_are_cut_to_so_many_panels():
    dense = machine(gas=table_over_angle(3600))
    assert default_collocation(dense).panel_count == 720
    assert default_collocation(machine(gas=CYCLE)).panel_count is None


def test_work_that_the_nodes_do_not_resolve_is_told():
    """A harmonic of order 40, of which 6 panels of 8 nodes see nothing."""
    cosine = np.zeros(80)
    cosine[79] = 2e6
    made = machine(gas=FourierDiagram(3e5, cosine, -2e4 * np.ones(80), 98e3))
    orbit = solve_orbit(made, solver_of(made), throw=False)
    assert status_of(orbit) == "unresolved"
    assert float(orbit.gas_work_error) > 0.01 * abs(float(orbit.energy.gas_work))


def test_the_march_compares_the_work():
    made = machine(gas=table_over_angle(97))
    orbit = solve_orbit(made, solver_of(made), verify=True)
    error = float(orbit.verification.gas_work_error)
    assert abs(error) < 1e-7 * float(orbit.energy.gas_work)


# compiles a derivative in all points of a table, for 25 s
@pytest.mark.slow
def test_the_work_is_linear_in_the_points():
    """Derivatives to the pressures are those of the quadrature of the curve."""
    table = table_over_angle(24)

    def work(scale):
        gas = CrankAngleTable(table.angle, scale * table.cylinder_pressure, 98e3)
        return solve_orbit(machine(gas=gas), throw=False).energy.gas_work

    value, slope = jax.value_and_grad(work)(1.0)
    assert float(slope) == pytest.approx(float(value), rel=1e-7)
