"""Model updating on a rotor like that of a hermetic compressor: crank pin and arms are fitted."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, load
from jaxcomp.rotor import Disks, RotorModel, fit_frequencies, shaft_line, undamped_modes

PIN = np.array([11, 12, 13, 14])  # elements of crank arm, pin, pin, arm; stiff and massless


def crankshaft(pin=(0.030, 0.018, 0.018, 0.030)):
    """Electrical rotor (8 elements) on a crank shaft; disks carry the mass of pin and arms."""
    d = np.array([0.05] * 8 + [0.02] * 3 + list(pin) + [0.022] * 5)
    density = np.array([7000.0] * 8 + [7800.0] * 3 + [0.0] * 4 + [7800.0] * 5)
    shaft = shaft_line(
        tuple(range(1, 22)),
        length=0.012,
        outer_diameter=d,
        young_modulus=2.06e11,
        density=density,
        poisson=0.3,
    )
    disks = Disks((12, 13, 14, 15, 16), [0.05, 0.1, 0.12, 0.1, 0.05], [2e-5] * 5, [4e-5] * 5)
    return RotorModel((shaft,), (disks,))


def insert(model, diameters):
    place = lambda m: m.shafts[0].outer_diameter  # noqa: E731
    return eqx.tree_at(place, model, place(model).at[PIN].set(diameters))


MODES = (4, 6, 8, 10)  # one of each pair of the free rotor


def test_four_frequencies_give_back_four_diameters():
    truth = jnp.array([0.026, 0.016, 0.0195, 0.034])
    measured = undamped_modes(insert(crankshaft(), truth), 11, free=True).frequency[np.array(MODES)]
    start = crankshaft().shafts[0].outer_diameter[PIN]
    first = undamped_modes(crankshaft(), 11, free=True).frequency[np.array(MODES)]
    assert np.abs(first / measured - 1).max() > 0.02  # there is something to fit
    fit = fit_frequencies(crankshaft(), insert, start, 0.6 * start, 1.6 * start, measured, MODES)
    assert bool(fit.converged)
    assert not np.any(fit.at_bound)
    # The solver stops at 1e-10 in the squared relative errors.
    np.testing.assert_allclose(fit.error, 0.0, atol=1e-7)
    np.testing.assert_allclose(fit.frequency, measured, rtol=1e-7)
    # Frequencies determine the diameters to some ten times their own error.
    np.testing.assert_allclose(fit.parameters, truth, rtol=1e-4)


@pytest.mark.slow
def test_elements_32_to_35_of_the_hermetic_machine():
    # The paper's procedure on the bundled rotor: crank pin and arms were measured to be softer, and
    # their diameters are reduced until the free frequencies fit. The mass stays, for it is in disks.
    scene = load("hermetic-68cc").parts["rotor"]
    rotor = RotorModel(scene.shafts, scene.disks)
    place = lambda m: m.shafts[5].outer_diameter  # noqa: E731
    put = lambda m, d: eqx.tree_at(place, m, d)  # noqa: E731
    start = place(rotor)
    truth = start * jnp.array([0.85, 0.9, 0.8, 0.92])
    measured = undamped_modes(put(rotor, truth), 11, free=True).frequency[np.array(MODES)]
    first = undamped_modes(rotor, 11, free=True).frequency[np.array(MODES)]
    assert np.all(first > measured)
    assert float(jnp.max(first / measured)) > 1.05
    fit = fit_frequencies(rotor, put, start, 0.5 * start, 1.2 * start, measured, MODES)
    assert bool(fit.converged)
    np.testing.assert_allclose(fit.error, 0.0, atol=1e-7)  # the solver's 1e-10 is on its square
    assert np.all(fit.parameters < start)
    # Four frequencies for four short neighbours: some combinations are known to a per cent only.
    np.testing.assert_allclose(fit.parameters, truth, rtol=0.01)


def test_bounds_hold_and_are_reported():
    # Two measured frequencies 10 % above what the bounds allow.
    start = crankshaft().shafts[0].outer_diameter[PIN]
    first = undamped_modes(crankshaft(), 11, free=True).frequency[np.array(MODES)]
    fit = fit_frequencies(
        crankshaft(), insert, start, 0.97 * start, 1.03 * start, 1.1 * first, MODES
    )
    assert np.all((fit.parameters >= 0.97 * start) & (fit.parameters <= 1.03 * start))
    # The pin rules the frequencies and is driven to its bound; the arms hardly count.
    np.testing.assert_array_equal(fit.at_bound[1:3], True)
    assert np.all(np.abs(fit.error) < 0.1)


def test_regularisation_holds_the_parameters_back():
    start = crankshaft().shafts[0].outer_diameter[PIN]
    measured = undamped_modes(crankshaft(), 11, free=True).frequency[np.array(MODES)]
    measured = measured * jnp.array([1.01, 0.99, 1.01, 1.0])
    moves, errors = [], []
    for weight in (0.0, 0.03, 3.0):
        fit = fit_frequencies(
            crankshaft(), insert, start, 0.6 * start, 1.6 * start, measured, MODES,
            regularisation=weight,
        )  # fmt: skip
        moves.append(float(jnp.linalg.norm(fit.parameters / start - 1)))
        errors.append(float(jnp.linalg.norm(fit.error)))
    assert moves[0] > 2 * moves[1] > 100 * moves[2]
    assert 2 * errors[0] < 1.2 * errors[1] < errors[2]
    assert errors[2] == pytest.approx(
        np.linalg.norm([0.01, 0.01, 0.01]), rel=0.05
    )  # no move at all


def test_bad_fits_are_named():
    start = jnp.array([0.03, 0.018, 0.018, 0.03])
    with pytest.raises(BadInput, match="start"):
        fit_frequencies(crankshaft(), insert, start, start, 2 * start, jnp.ones(4), MODES)
    with pytest.raises(BadInput, match="measured"):
        fit_frequencies(crankshaft(), insert, start, 0.5 * start, 2 * start, jnp.ones(3), MODES)
