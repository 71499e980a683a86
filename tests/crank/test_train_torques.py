"""Peak torques of a crank train against the periodic solution of the chain in time."""

import equinox as eqx
import numpy as np
import pytest
from scipy.linalg import expm

from jaxcomp import Collocation, load, solve_orbit
from jaxcomp._core.polynomials import gauss
from jaxcomp.compressor import compressor_of
from jaxcomp.crank import CrankTrain, train_torques
from jaxcomp.crank._torsion import _own_losses, throw_torques

STEPS = 32768  # in time, with torques that are straight lines between them: 1e-7 of the peaks


@pytest.fixture(scope="module")
def twin():
    """A machine of two cylinders, and its orbit on fine nodes."""
    made = compressor_of(load("refrigeration-twin"))
    return made, solve_orbit(made, Collocation(nodes=16, reversals=2))


# One program: outside of one every operation is compiled by itself.
@eqx.filter_jit
def torques_of_throws(made, orbit):
    return throw_torques(made, orbit), _own_losses(made, orbit)


def torques_in_time(made, orbit, motors):
    """[N m] On motor inertias and throws at even instants, and the step [s]."""
    own, losses = map(np.asarray, torques_of_throws(made, orbit))
    of_shaft = np.asarray(orbit.loads.total_loss_torque) - np.sum(losses, axis=0)
    before = np.zeros((motors, orbit.time.size))
    before[0] = orbit.motor_torque
    rows = np.concatenate([before, own - of_shaft / own.shape[0]])
    x = np.linspace(0.0, 1.0, 2001)[:-1]
    through = gauss(orbit.panel_nodes).through(x).T
    wide = np.asarray(orbit.panel_width) > 1e-6

    def fine(row):
        panels = np.asarray(row).reshape(-1, orbit.panel_nodes)
        return (panels[wide] @ through).ravel()

    period = float(orbit.period)
    at = np.arange(STEPS) * period / STEPS
    time = fine(orbit.time)
    order = np.argsort(time, kind="stable")
    return [np.interp(at, time[order], fine(row)[order], period=period) for row in rows], at[1]


def peaks_in_time(chain, torques, step):
    """[N m] Largest torque of every spring, of the twists over their periodic course."""
    count = chain.stiffness.size
    turn = np.diff(np.eye(count + 1), axis=0)
    over = turn @ np.diag(1 / np.asarray(chain.inertia))
    stiff, damp = np.diag(np.asarray(chain.stiffness)), np.diag(np.asarray(chain.damping))
    none, one = np.zeros((count, count)), np.eye(count)
    system = np.block([[none, one], [-over @ turn.T @ stiff, -over @ turn.T @ damp]])
    drive = np.concatenate([np.zeros((count, len(torques[0]))), over @ np.array(torques)])
    # exact over a step for torques that are straight lines
    size = 2 * count
    whole = np.zeros((3 * size, 3 * size))
    whole[:size, :size] = system
    whole[:size, size : 2 * size] = np.eye(size)
    whole[size : 2 * size, 2 * size :] = np.eye(size)
    moved = expm(whole * step)
    pass_, first, second = (moved[:size, k * size : (k + 1) * size] for k in range(3))
    rate = (np.roll(drive, -1, axis=1) - drive) / step
    added = first @ drive + second @ rate

    def turned(state):
        states = np.empty((size, STEPS))
        for k in range(STEPS):
            states[:, k] = state
            state = pass_ @ state + added[:, k]
        return state, states

    rest, _ = turned(np.zeros(size))
    start = np.linalg.solve(np.eye(size) - np.linalg.matrix_power(pass_, STEPS), rest)
    end, states = turned(start)
    np.testing.assert_allclose(end, start, rtol=1e-8, atol=1e-12 * np.abs(states).max())
    return np.max(np.abs(stiff @ states[:count] + damp @ states[count:]), axis=1)


def random_train(seed):
    rng = np.random.default_rng(seed)
    motors = int(rng.integers(1, 3))
    inertia = rng.uniform(0.002, 0.0055, motors)  # of 0.012 in all
    return CrankTrain(inertia, 10 ** rng.uniform(4, 5.3, motors + 1), rng.uniform(0.5, 3.0))


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(n, marks=pytest.mark.slow) for n in range(2, 20))]
)
def test_peaks_are_those_in_time_within_the_stated_error(twin, seed):
    made, orbit = twin
    train = random_train(seed)
    chain = train.chain(made)
    exact = peaks_in_time(chain, *torques_in_time(made, orbit, train.inertia.size))
    found = train_torques(made, orbit, train)
    off = np.abs(np.asarray(found.peak) - exact)
    # 1e-6 for the straight lines of the reference, and tops between its instants
    assert np.all(off <= np.asarray(found.peak_error) + 1e-6 * exact)
    assert np.all(off < 1e-4 * exact)
    # sixteen harmonics miss percents, and say so
    few = train_torques(made, orbit, train, 16)
    assert np.all(np.abs(np.asarray(few.peak) - exact) <= np.asarray(few.peak_error))


def test_the_bundled_twin_passes_its_first_mode_at_order_24(twin):
    """Sixteen harmonics gave 43.46 and 49.88 N m."""
    train = load("refrigeration-twin").machine.parts["torsion"]
    found = train_torques(*twin, train)
    # the periodic solution in time
    np.testing.assert_allclose(found.peak, [46.72, 52.60], rtol=2e-4)
    assert found.amplitude.shape[1] * float(found.frequency[0]) > 2 * float(
        found.natural_frequencies[-1]
    )
