"""The periodic orbit by both solvers against SciPy, closed forms and each other."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from helpers import RPM, coulomb, machine, solve_many, status_of

from jaxcomp import Collocation, Compressor, Shooting, solve_orbit
from jaxcomp.compressor import instants
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.gas import FourierDiagram
from jaxcomp.motor import ConstantTorque, Kloss, MeanSpeed, SlipLine

FINE = Collocation(nodes=16)
# A step is allowed a thousandth of the tolerance: 1e-12.
TIGHT = Shooting(solver=diffrax.Dopri8(), tolerance=1e-9)

CASES = {
    "base": {},
    "offset": {"offset": 0.03},
    "offset the other way": {"offset": -0.03},
    "no clearance": {"clearance_ratio": 0.0},
    "isothermal": {"exponent": 1.0},
    "gravity": {"gravity": (-9.8, 3.0)},
    "back pressure": {"back_pressure": 3e5},
    "no flow": {"clearance_ratio": 0.3},
    "frictionless": {"friction": coulomb(0.0)},
    "slow": {"motor": MeanSpeed(500 * RPM)},
    "fast": {"motor": MeanSpeed(3000 * RPM)},
    "everything": {"offset": 0.02, "exponent": 1.0, "gravity": (5.0, -9.0), "clearance_ratio": 0.0},
}


@pytest.fixture(scope="module")
def base_reference():
    compressor = machine()
    twin = reference.from_compressor(compressor)
    mean = float(compressor.motor.mean_speed)
    return reference.orbit(twin, lambda speed, level: level, mean)


@pytest.fixture(scope="module")
def fine():
    machines = {name: machine(**changes) for name, changes in CASES.items()}
    orbits = solve_many(list(machines.values()), FINE)
    return {name: (machines[name], o) for name, o in zip(machines, orbits, strict=True)}


def check_by_one_turn(compressor, orbit, motor, tolerance):
    """The plain integration comes back to the first node with the same accounts."""
    twin = reference.from_compressor(compressor)
    gap, mean, work = reference.one_turn(
        twin, motor, float(orbit.state.angle[0]), float(orbit.state.speed[0])
    )
    assert abs(gap) < tolerance
    assert mean == pytest.approx(float(orbit.mean_speed), rel=tolerance)
    size = max(abs(work["motor"]), abs(work["gas"]))
    assert float(orbit.energy.motor_work) == pytest.approx(work["motor"], abs=tolerance * size)
    assert float(orbit.energy.gas_work) == pytest.approx(work["gas"], abs=tolerance * size)
    for name, loss in orbit.energy.losses.items():
        assert float(loss) == pytest.approx(work[name], abs=tolerance * size), name


# ---------------------------------------------------------------- against the reference
def test_collocation_agrees_with_the_reference(fine, base_reference):
    _, orbit = fine["base"]
    # 16 nodes on every panel are worth 1e-8
    assert float(orbit.mechanical_efficiency) == pytest.approx(base_reference.efficiency, abs=1e-8)
    assert float(orbit.speed_fluctuation) == pytest.approx(base_reference.fluctuation, abs=1e-8)


@pytest.mark.parametrize("case", ["no clearance", "gravity", "everything"])
def test_collocation_closes_the_turn_of_the_reference(fine, case):
    compressor, orbit = fine[case]
    level = float(orbit.motor_torque[0])
    check_by_one_turn(compressor, orbit, lambda speed: level, 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("case", list(CASES))
def test_collocation_closes_every_turn_of_the_reference(fine, case):
    compressor, orbit = fine[case]
    level = float(orbit.motor_torque[0])
    check_by_one_turn(compressor, orbit, lambda speed: level, 1e-7)


@pytest.fixture(scope="module")
def shot():
    return solve_orbit(machine(), TIGHT)


def test_shooting_agrees_with_the_reference_and_with_collocation(shot, fine, base_reference):
    orbit = fine["base"][1]
    assert float(shot.mechanical_efficiency) == pytest.approx(base_reference.efficiency, abs=1e-8)
    assert float(shot.speed_fluctuation) == pytest.approx(base_reference.fluctuation, abs=1e-8)
    assert float(shot.mechanical_efficiency) == pytest.approx(
        float(orbit.mechanical_efficiency), abs=1e-8
    )
    for name, loss in shot.energy.losses.items():
        assert float(loss) == pytest.approx(
            float(orbit.energy.losses[name]), abs=1e-8 * float(shot.energy.motor_work)
        )


def test_shooting_closes_energy_at_the_tolerance_asked(shot):
    assert abs(float(shot.energy.residual)) < 1e-9
    assert float(shot.residual) < 1e-9
    assert float(shot.mean_speed) == pytest.approx(1000 * RPM, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["offset", "everything", "fast"])
def test_shooting_agrees_with_collocation_on_other_machines(fine, case):
    compressor, orbit = fine[case]
    other = solve_orbit(compressor, TIGHT)
    assert float(other.mechanical_efficiency) == pytest.approx(
        float(orbit.mechanical_efficiency), abs=1e-8
    )
    assert float(other.speed_fluctuation) == pytest.approx(float(orbit.speed_fluctuation), abs=1e-8)


# ---------------------------------------------------------------- conservation
@pytest.mark.parametrize("case", list(CASES))
def test_collocation_closes_energy_and_holds_the_mean_speed(fine, case):
    compressor, orbit = fine[case]
    assert status_of(orbit) == "converged"
    work = abs(float(orbit.energy.gas_work)) + float(orbit.energy.total_loss)
    account = orbit.energy.motor_work - orbit.energy.gas_work - orbit.energy.total_loss
    assert abs(float(account)) < 1e-10 * max(work, 1.0)
    assert float(orbit.mean_speed) == pytest.approx(float(compressor.motor.mean_speed), rel=1e-11)


def test_no_flow_takes_no_gas_work_and_ideal_joints_have_full_efficiency(fine):
    idle = fine["no flow"][1].energy
    size = 0.98e6 * 1.327e-3  # p_d V_s
    assert abs(float(idle.gas_work)) < 1e-10 * size
    assert float(fine["frictionless"][1].mechanical_efficiency) == pytest.approx(1.0, abs=1e-13)


def test_weights_and_back_pressure_do_no_net_work(fine):
    """They are conservative: the indicated work is that of the gas alone."""
    work = float(fine["base"][1].energy.gas_work)
    for case in ("gravity", "back pressure", "slow", "fast", "frictionless"):
        assert float(fine[case][1].energy.gas_work) == pytest.approx(work, rel=1e-11)


def test_orbit_repeats_after_a_turn(fine):
    """Speed is smooth across the seam: the acceleration agrees with the slope of the speed."""
    orbit = fine["base"][1]
    angle, speed = orbit.state.angle, orbit.state.speed
    step = np.diff(np.concatenate([angle[-1:] - 2 * np.pi, angle[:1]]))
    slope = float((speed[0] - speed[-1]) / step[0])
    mean = 0.5 * (orbit.state.acceleration[0] / speed[0] + orbit.state.acceleration[-1] / speed[-1])
    assert slope == pytest.approx(mean, rel=1e-2)


def test_without_gas_and_friction_kinetic_energy_is_constant():
    base = machine(offset=0.03)
    compressor = Compressor(base.mechanism, Crankshaft(0.156), base.motor)
    # nothing rubs whose load reverses
    orbit = solve_orbit(compressor, Collocation(nodes=16, reversals=0))
    inertia_at = jax.jit(lambda angle: instants(compressor, angle).inertia)
    inertia = inertia_at(orbit.state.angle)
    energy = inertia * orbit.state.speed**2
    np.testing.assert_allclose(energy / energy[0], 1.0, rtol=1e-12)
    assert abs(float(orbit.energy.motor_work)) < 1e-9 * float(energy[0])
    scan = inertia_at(jnp.linspace(0, 2 * jnp.pi, 20001))
    root = np.sqrt(np.asarray(scan))
    # mean speed: 2 pi over the integral of sqrt(J)
    expected = (1 / root.min() - 1 / root.max()) * np.mean(root[:-1])
    # the scan meets the extremes to the square of its step; those of the orbit's twelve panels are taken
    # from their polynomials: 1.4e-6 measured
    assert float(orbit.speed_fluctuation) == pytest.approx(expected, rel=3e-6)


# ---------------------------------------------------------------- motors
@pytest.fixture(scope="module")
def kloss():
    motors = {
        "strong": Kloss(150.0, 0.1, 105.0),
    }
    machines = {name: machine(motor=motor) for name, motor in motors.items()}
    machines["offset"] = machine(motor=motors["strong"], offset=0.02)
    orbits = solve_many(list(machines.values()), FINE)
    return {name: (machines[name], o) for name, o in zip(machines, orbits, strict=True)}


@pytest.mark.slow
@pytest.mark.parametrize("case", ["strong", "offset"])
def test_kloss_motor_closes_the_turn_of_the_reference(kloss, case):
    compressor, orbit = kloss[case]
    assert status_of(orbit) == "converged"
    assert abs(float(orbit.energy.residual)) < 1e-10
    m, s_b, w_s = 150.0, 0.1, 105.0

    def motor(speed):
        slip = 1 - speed / w_s
        return 2 * m * slip * s_b / (slip**2 + s_b**2)

    check_by_one_turn(compressor, orbit, motor, 1e-7)


@pytest.mark.slow
def test_slip_line_closes_the_turn_of_the_reference():
    compressor = machine(motor=SlipLine(20.0, 105.0))
    orbit = solve_orbit(compressor, FINE)
    assert abs(float(orbit.energy.residual)) < 1e-10
    check_by_one_turn(compressor, orbit, lambda speed: 20.0 * (105.0 - speed), 1e-7)


@pytest.mark.slow
def test_constant_torque_of_the_held_speed_gives_the_same_orbit(fine):
    held = fine["base"][1]
    level = float(held.motor_torque[0])
    orbit = solve_orbit(machine(motor=ConstantTorque(level, 90.0)), FINE)
    # the running speed follows the torque by d ln w/d ln M, of the order of 100
    assert float(orbit.mean_speed) == pytest.approx(float(held.mean_speed), rel=1e-8)
    assert float(orbit.mechanical_efficiency) == pytest.approx(
        float(held.mechanical_efficiency), abs=1e-9
    )


@pytest.mark.slow
def test_proportional_torque_closes_the_turn_of_the_reference():
    compressor = machine(motor=MeanSpeed(1000 * RPM, shape="proportional"))
    orbit = solve_orbit(compressor, FINE)
    ratio = orbit.motor_torque / orbit.state.speed
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-13)
    level = float(ratio[0])
    check_by_one_turn(compressor, orbit, lambda speed: level * speed, 1e-7)


@pytest.mark.slow
def test_prescribed_diagram_closes_the_turn_of_the_reference():
    gas = FourierDiagram(4e5, [2e5, 5e4], [-1e5, 2e4], 1e5)
    compressor = machine(gas=gas)
    orbit = solve_orbit(compressor, FINE)
    twin = reference.from_compressor(compressor)
    twin.pressure_over_angle = lambda a: float(
        4e5 + 2e5 * np.cos(a) + 5e4 * np.cos(2 * a) - 1e5 * np.sin(a) + 2e4 * np.sin(2 * a)
    )
    twin.back_pressure = 1e5
    twin.prepare()
    level = float(orbit.motor_torque[0])
    gap, mean, work = reference.one_turn(
        twin, lambda speed: level, float(orbit.state.angle[0]), float(orbit.state.speed[0])
    )
    assert abs(gap) < 1e-8
    assert mean == pytest.approx(float(orbit.mean_speed), rel=1e-8)
    assert work["gas"] == pytest.approx(float(orbit.energy.gas_work), rel=1e-8)


# ---------------------------------------------------------------- convergence
@pytest.mark.slow
def test_collocation_error_falls_with_the_nodes(base_reference):
    error = {}
    for nodes in (4, 8, 16):
        orbit = solve_orbit(machine(), Collocation(nodes=nodes), throw=False)
        error[nodes] = abs(float(orbit.mechanical_efficiency) - base_reference.efficiency)
    assert error[4] < 1e-4
    assert error[8] < 1e-6
    assert error[16] < 1e-8


@pytest.mark.slow
def test_collocation_without_kinks_converges_algebraically(base_reference):
    error = {}
    for nodes in (8, 32):
        orbit = solve_orbit(machine(), Collocation(nodes=nodes, reversals=0))
        error[nodes] = abs(float(orbit.mechanical_efficiency) - base_reference.efficiency)
    # |N| has kinks inside panels: second order, with luck
    assert 1e-7 < error[8] < 2e-5
    assert error[32] < 2e-6


# ---------------------------------------------------------------- evidence
def test_forces_at_the_nodes_satisfy_the_motion(fine):
    """The reported acceleration is that of the reference at the reported state."""
    compressor, orbit = fine["gravity"]
    twin = reference.from_compressor(compressor)
    level = float(orbit.motor_torque[0])
    # unused places for a load reversal are panels without width, right on the dead centre
    for i in np.flatnonzero(orbit.weight > 1e-9)[::17]:
        angle, speed, acceleration = (float(x[i]) for x in orbit.state)
        answer, losses, _ = twin.solve(angle, speed, level)
        # accelerations reach 3e3; the slope of the solution is worth less than its end values
        assert acceleration == pytest.approx(answer[0], abs=3e-3)
        q = np.hypot(*orbit.loads.forces["main_journal"][:, i])
        assert float(q) == pytest.approx(np.hypot(answer[9], answer[10]), rel=1e-6)
        assert float(orbit.loads.loss_torque["crank_pin"][i]) == pytest.approx(
            losses["crank_pin"], rel=1e-6, abs=1e-6
        )


def test_time_runs_with_the_speed(fine):
    orbit = fine["base"][1]
    assert np.all(np.diff(orbit.time) >= 0)
    assert float(orbit.period) == pytest.approx(2 * np.pi / (1000 * RPM), rel=1e-11)
    assert float(np.sum(orbit.weight / orbit.state.speed)) == pytest.approx(
        float(orbit.period), rel=1e-12
    )
    assert float(np.sum(orbit.weight)) == pytest.approx(2 * np.pi, rel=1e-14)


def test_extremes_of_speed_bound_the_nodes(fine):
    for _, orbit in fine.values():
        assert orbit.lowest_speed <= orbit.state.speed.min() * (1 + 1e-12)
        assert orbit.highest_speed >= orbit.state.speed.max() * (1 - 1e-12)
        assert orbit.highest_speed <= orbit.state.speed.max() * 1.001
