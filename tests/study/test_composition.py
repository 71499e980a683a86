"""The composition of a mixture in studies: one fraction up, the others down in proportion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import load, optimise, problem, sensitivity, sweep, tolerance, within
from jaxcomp._core.errors import BadInput
from jaxcomp.fluid import Mixture
from jaxcomp.scene import dump, loads, with_values
from jaxcomp.study._variables import changed, given_numbers, variable, variable_names

R32 = "gas.fluid.mass_fractions.R32"
# [-] Lines that were solved beside others stop at the same residual, and differ by rounding there.
LINES = 1e-11


def design_of(name: str):
    return with_values(load("r290-6cc"), {"gas.fluid.name": name})


def dew_pressure(found):
    return found.design.compressor.gas.fluid.dew_pressure(jnp.asarray(280.0))


def bubble_temperature(found):
    return found.design.compressor.gas.fluid.bubble_temperature(jnp.asarray(1.2e6))


@pytest.fixture(scope="module")
def pressure_and_temperature():
    """Dew pressure and bubble temperature over the share of R32, as one program for all shares."""
    study = problem(design_of("R454C"), {R32: (0.05, 0.7)}, [dew_pressure, bubble_temperature])
    return jax.jit(lambda x: study(x).values)


def blend_of(share: float) -> Mixture:
    return Mixture(mass_fractions={"R32": share, "R1234yf": 1 - share})


def test_fractions_are_numbers_of_a_machine_by_their_components():
    design = design_of("R448A").machine
    names = [name for name in variable_names(design) if "fractions" in name]
    components = ("R32", "R125", "R1234yf", "R134a", "R1234ze(E)")
    assert names == [f"gas.fluid.mass_fractions.{component}" for component in components]
    moved = variable(design, R32).apply(design, 0.5).compressor.gas.fluid
    w = np.asarray(moved.mass_fractions)
    assert w[0] == 0.5
    np.testing.assert_allclose(w[1:] / w[2], np.array([0.26, 0.20, 0.21, 0.07]) / 0.20, rtol=1e-14)
    assert moved.name == "R32/R125/R1234yf/R134a/R1234ze(E)"


def test_fractions_of_one_mixture_are_set_together():
    design = design_of("R404A").machine
    names = [f"gas.fluid.mass_fractions.{component}" for component in ("R125", "R134a")]
    moved = changed(design, [variable(design, name) for name in names], [0.40, 0.10])
    np.testing.assert_allclose(moved.compressor.gas.fluid.mass_fractions, [0.40, 0.50, 0.10])


def test_mole_fractions_move_as_well():
    design = design_of("R454C").machine
    moved = variable(design, "gas.fluid.mole_fractions.R32").apply(design, 0.5)
    fluid = moved.compressor.gas.fluid
    np.testing.assert_allclose(fluid.fraction("mole_fractions", "R32"), 0.5, rtol=1e-14)


@pytest.mark.parametrize("share", [0.10, 0.2, 0.23, 0.6])
def test_a_program_solves_the_lines_of_each_composition(pressure_and_temperature, share):
    """Lines of first order are off by 3e-3 in pressure at 5 %."""
    values = pressure_and_temperature(jnp.array([share]))
    fluid = blend_of(share)
    expected = [fluid.dew_pressure(280.0), fluid.bubble_temperature(1.2e6)]
    np.testing.assert_allclose(values, expected, rtol=LINES)


def test_slopes_to_a_fraction_agree_with_differences_of_blends_made_anew(pressure_and_temperature):
    at = jnp.array([0.3])
    step = 1e-3
    rows = [blend_of(0.3 + n * step) for n in (-2, -1, 1, 2)]
    weights = np.array([1, -8, 8, -1]) / (12 * step)
    expected = [
        weights @ np.array([float(fluid.dew_pressure(280.0)) for fluid in rows]),
        weights @ np.array([float(fluid.bubble_temperature(1.2e6)) for fluid in rows]),
    ]
    for slope in (jax.jacfwd, jax.jacrev):
        found = jax.jit(slope(pressure_and_temperature))(at)[:, 0]
        # of differences of fourth order with steps of 0.1 %
        np.testing.assert_allclose(found, expected, rtol=1e-7)


def test_sensitivity_to_a_fraction_is_that_of_the_moved_composition():
    scene = design_of("R448A")
    found = sensitivity(scene, [dew_pressure])
    place = found.numbers.index(R32)
    study = problem(scene, {R32: (0.1, 0.5)}, [dew_pressure])
    slope = jax.jit(jax.jacfwd(lambda x: study(x).values))(study.current)[0, 0]
    # the file of R448A has its slopes with eight digits
    np.testing.assert_allclose(found.derivative[0, place], slope, rtol=1e-7)
    assert {one.name for one in given_numbers(scene.machine)} >= {R32}


@pytest.mark.slow  # two studies, each design of which has its lines solved
def test_sweep_and_tolerance_are_those_of_files():
    scene = design_of("R454C")
    shares = [0.18, 0.215, 0.25]
    found = sweep(scene, {R32: shares}, [dew_pressure], progress=False)
    expected = [float(blend_of(share).dew_pressure(280.0)) for share in shares]
    np.testing.assert_allclose(np.asarray(found["dew_pressure"]), expected, rtol=LINES)
    scattered = tolerance(scene, {R32: within(0.02)}, [dew_pressure], samples=64, progress=False)
    drawn = scattered.scatter.at(scattered.nominal, scattered.sampled.normals)[:4, 0]
    expected = [float(blend_of(float(share)).dew_pressure(280.0)) for share in drawn]
    np.testing.assert_allclose(scattered.sampled.values[:4, 0], expected, rtol=LINES)
    with pytest.raises(BadInput, match='"differences" with a composition'):
        tolerance(scene, {R32: within(0.02)}, [dew_pressure], samples=64, curvature="exact")


@pytest.mark.slow  # three hundred compositions are solved
def test_optimum_over_the_composition_meets_a_pressure():
    """The blend of R32 and R1234yf with a dew pressure of 0.6 MPa at 280 K."""
    study = problem(design_of("R454C"), {R32: (0.05, 0.9)}, [dew_pressure])
    found = optimise(study, {dew_pressure: 6e5})
    share = float(found.values[R32])
    np.testing.assert_allclose(float(blend_of(share).dew_pressure(280.0)), 6e5, rtol=1e-6)


def test_a_file_takes_the_moved_composition():
    scene = with_values(load("r290-6cc"), {"gas.fluid.name": "R454C", R32: "25 %"})
    written = loads(dump(scene))
    fluid = written.machine.compressor.gas.fluid
    np.testing.assert_allclose(fluid.mass_fractions, [0.25, 0.75], rtol=1e-14)
    np.testing.assert_allclose(
        fluid.dew_pressure(280.0), blend_of(0.25).dew_pressure(280.0), rtol=LINES
    )
    assert "others in proportion" in dump(scene)


def test_impossible_fractions_are_refused():
    scene = design_of("R454C")
    with pytest.raises(BadInput, match="< 1"):
        variable(scene.machine, R32, 0.1, 1.0)
    with pytest.raises(BadInput, match="mass_fractions"):
        variable(scene.machine, "gas.fluid.mass_fractions.R134a", 0.1, 0.3)
    both = {R32: 0.2, "gas.fluid.mass_fractions.R1234yf": 0.8}
    with pytest.raises(BadInput, match="the last one follows"):
        with_values(scene, both)
    mixed = design_of("R404A").machine
    names = ("gas.fluid.mass_fractions.R125", "gas.fluid.mole_fractions.R134a")
    with pytest.raises(BadInput, match="as the other fractions"):
        changed(mixed, [variable(mixed, name) for name in names], [0.4, 0.1])


def test_fractions_that_leave_nothing_have_no_answer():
    scene = design_of("R404A")
    names = [f"gas.fluid.mass_fractions.{component}" for component in ("R125", "R134a")]
    study = problem(scene, dict.fromkeys(names, (0.0, 0.9)), [dew_pressure])
    assert not bool(study(jnp.array([0.7, 0.6])).ok)


@pytest.mark.slow  # the program of a machine with valves, compiled twice
def test_a_sweep_through_valves_is_that_of_files():
    scene = design_of("R454C")
    shares = [0.15, 0.25]
    asked = ["cop", "capacity", "discharge_temperature"]
    found = sweep(scene, {R32: shares}, asked, progress=False)
    for row, share in enumerate(shares):
        fluid = {"type": "mixture", "mass_fractions": {"R32": share, "R1234yf": 1 - share}}
        file = with_values(load("r290-6cc"), {"gas.fluid": fluid})
        single = problem(file, ["gas.clearance_ratio"], asked)
        expected = single(single.current)
        assert bool(expected.ok)
        assert bool(found["ok"][row])
        values = [float(found[name][row]) for name in asked]
        # as far as solvers of one program and of another agree
        np.testing.assert_allclose(values, expected.values, rtol=1e-8)


@pytest.mark.slow  # three minutes: the derivatives of a machine with valves are compiled
def test_the_best_blend_below_a_discharge_temperature():
    """COP and discharge temperature rise with the share of R32 through valves, port inertia and walls."""
    scene = with_values(
        load("r290-6cc"),
        {
            "gas.fluid.name": "R454C",
            "gas.suction": {"evaporating": "-10 degC", "superheat": "10 K"},
            "gas.discharge": {"condensing": "45 degC", "subcooling": "0 K"},
        },
    )
    study = problem(scene, {R32: (0.1, 0.7)}, ["cop", "discharge_temperature"])
    limits = {"discharge_temperature": (None, 365.0)}
    best = optimise(study, "cop", constraints=limits, samples=8, starts=2)
    # as the page of blends prints it
    assert abs(float(best.values[R32]) - 0.376) < 5e-4
    assert abs(best.objective - 2.326) < 5e-4
    answer = study(jnp.array([float(best.values[R32])]))
    # the limit holds, to the tolerance of the search
    np.testing.assert_allclose(answer.values[1], 365.0, rtol=1e-5)
