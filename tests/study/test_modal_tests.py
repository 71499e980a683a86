"""Numbers of a rotor like that of a hermetic compressor from modal tests: pin and arms are fitted."""

import importlib
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, load, loads
from jaxcomp.machine import Machine
from jaxcomp.rotor import Disks, RotorModel, shaft_line, undamped_modes
from jaxcomp.scene import SceneError
from jaxcomp.scene._universal import modes_of_responses
from jaxcomp.scene.measured import read_measurement
from jaxcomp.study import ModalTest, identify

PIN = np.array([11, 12, 13, 14])  # elements of crank arm, pin, pin, arm; stiff and massless
MODES = (4, 6, 8, 10)  # one of each pair of the free rotor


def crankshaft(pin=(0.030, 0.018, 0.018, 0.030), stiffer=1.0):
    """Electrical rotor (8 elements) on a crank shaft; disks carry the mass of pin and arms."""
    d = np.array([0.05] * 8 + [0.02] * 3 + list(pin) + [0.022] * 5)
    density = np.array([7000.0] * 8 + [7800.0] * 3 + [0.0] * 4 + [7800.0] * 5)
    shaft = shaft_line(
        tuple(range(1, 22)),
        length=0.012,
        outer_diameter=d,
        young_modulus=2.06e11 * stiffer,
        density=density,
        poisson=0.3,
    )
    disks = Disks((12, 13, 14, 15, 16), [0.05, 0.1, 0.12, 0.1, 0.05], [2e-5] * 5, [4e-5] * 5)
    return RotorModel((shaft,), (disks,))


def machine(model):
    return Machine(None, {"rotor": model})


def insert(model, diameters):
    place = lambda m: m.shafts[0].outer_diameter  # noqa: E731
    return eqx.tree_at(place, model, place(model).at[PIN].set(diameters))


def frequencies(model):
    return np.asarray(undamped_modes(model, 11, free=True).frequency[np.array(MODES)])


def bounds(low, high):
    start = np.asarray(crankshaft().shafts[0].outer_diameter[PIN])
    return {
        f"rotor.shafts.0.outer_diameter.{n}": (low * d, high * d)
        for n, d in zip(PIN, start, strict=True)
    }


def test_four_frequencies_give_back_four_diameters():
    truth = np.array([0.026, 0.016, 0.0195, 0.034])
    measured = frequencies(insert(crankshaft(), truth))
    assert (
        np.abs(frequencies(crankshaft()) / measured - 1).max() > 0.02
    )  # there is something to fit
    test = ModalTest("made", measured, (1, 2, 3, 4))
    found = identify(machine(crankshaft()), test, bounds(0.6, 1.6), starts=1)
    assert found.fit.converged
    assert not found.fit.at_bound.any()
    # the fit stops where chi-square falls by 1e-9 of itself; frequencies weigh 0.5 %
    np.testing.assert_allclose(found.error("frequency"), 0.0, atol=1e-5)
    # Frequencies determine the diameters to some ten times their own error.
    np.testing.assert_allclose(found.estimate, truth, rtol=2e-4)
    fitted = found.machine.parts["rotor"].shafts[0].outer_diameter[PIN]
    np.testing.assert_allclose(fitted, found.estimate, rtol=1e-12)


def test_bounds_hold_and_are_told():
    # Two measured frequencies 10 % above what the bounds allow.
    test = ModalTest("made", 1.1 * frequencies(crankshaft()), (1, 2, 3, 4))
    found = identify(machine(crankshaft()), test, bounds(0.97, 1.03), starts=1)
    # The pin rules the frequencies and is driven to its bound; the arms hardly count.
    np.testing.assert_array_equal(found.fit.at_bound[1:3], True)
    assert any("shafts.0.outer_diameter.12 is held by its bound" in note for note in found.notes)
    assert "4 readings for 4 parameters: the priors decide" in found.notes


def test_modulus_and_density_of_a_free_rotor_cannot_be_told_apart():
    # frequencies go with the root of modulus over density, where all masses are the shaft's
    shaft = crankshaft().shafts[0]
    bare = RotorModel((eqx.tree_at(lambda s: s.density, shaft, 7800.0 + 0 * shaft.density),))
    test = ModalTest("made", frequencies(bare), (1, 2, 3, 4))
    vary = {"rotor.shafts.0.young_modulus": (0.5, 2.0), "rotor.shafts.0.density": (0.5, 2.0)}
    found = identify(machine(bare), test, vary, starts=1)
    weakest = found.fit.directions[-1]
    assert weakest.weak
    assert weakest.words in (
        "rotor.shafts.0.young_modulus up 10 % with rotor.shafts.0.density up 10 %",
        "rotor.shafts.0.density up 10 % with rotor.shafts.0.young_modulus up 10 %",
    )
    assert weakest.effect < 1e-3
    assert weakest.words in found.weak


def shapes(model, numbers, places):
    found = undamped_modes(model, 11, free=True)
    rows = [node - 1 for node, _ in places]
    columns = [("ux", "uy").index(axis) for _, axis in places]
    return np.asarray(found.shape)[np.array(numbers)][:, rows, columns]


def test_modes_with_shapes_are_found_by_mac_whatever_their_order():
    model, numbers = crankshaft(), (6, 4)  # the second before the first
    places = [(node, axis) for node in (1, 6, 12, 18, 21) for axis in ("ux", "uy")]
    measured = np.asarray(undamped_modes(model, 11, free=True).frequency)[np.array(numbers)]
    nodes, axes = zip(*places, strict=True)
    # of pairs of equal frequencies any mixture, of any size
    shape = -3.0 * shapes(model, numbers, places) + shapes(model, (7, 5), places)
    test = ModalTest("made", measured, (1, 2), True, nodes, axes, shape)
    vary = {"rotor.shafts.0.young_modulus": (0.5, 2.0)}
    result = identify(machine(crankshaft(stiffer=0.9)), test, vary, starts=1)
    assert result.estimate[0] == pytest.approx(1 / 0.9, rel=1e-4)
    np.testing.assert_allclose(result.error("frequency"), 0.0, atol=1e-5)
    # a shape in the same plane, to the rounding of the eigenvectors of pairs
    assert np.abs(result.error("mode_shape")).max() < 1e-3


def test_files_of_modal_tests(tmp_path):
    file = tmp_path / "modes.csv"
    head = "# support = held\nmode,frequency [Hz],sd(frequency) [%],3.ux,12.uy"
    file.write_text(f"{head}\n2,100,1,0.5,-1\n1,40,,1,2\n")
    test = read_measurement(file, machine(crankshaft()))
    assert isinstance(test, ModalTest)
    assert (test.modes, test.free, test.nodes, test.axes) == ((2, 1), False, (3, 12), ("ux", "uy"))
    np.testing.assert_allclose(test.frequency, 2 * np.pi * np.array([100, 40]))
    entries = test.entries({})
    np.testing.assert_allclose(entries.sd[:2], 2 * np.pi * np.array([1.0, 0.2]))
    np.testing.assert_allclose(entries.measured[2:], [0.5, -1, 0.5, 1])
    assert entries.names[3] == "mode 2 at 12 uy"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frequency [Hz]\nx", "must be a number"),
        ("frequency\n3", "needs its unit"),
        ("frequency [Hz],mode\n3,1\n4,1", "mode = 1: is there twice"),
        ("frequency [Hz],mode\n3,0", "from 1"),
        ("frequency [Hz],moed\n3,1", "unknown column.*mode"),
        ("# support = hung\nfrequency [Hz]\n3", "free.*held"),
        ("frequency [Hz]\n-3", "above 0"),
    ],
)
def test_files_that_cannot_be_read(tmp_path, text, message):
    file = tmp_path / "modes.csv"
    file.write_text(text)
    with pytest.raises(SceneError, match=message):
        read_measurement(file, machine(crankshaft()))


@pytest.mark.parametrize(
    ("test", "message"),
    [
        (ModalTest("made", np.array([100.0]), (400,)), "the distinct frequencies"),
        (ModalTest("made", np.array([100.0]), (1,), True, (99,), ("ux",), np.ones((1, 1))), "node"),
        (ModalTest("made", np.array([100.0]), (1,), True, (3,), ("uw",), np.ones((1, 1))), "axis"),
        (
            ModalTest("made", np.array([100.0]), (1,), True, (3,), ("ux",), np.zeros((1, 1))),
            "shape",
        ),
    ],
)
def test_tests_that_do_not_suit(test, message):
    with pytest.raises(BadInput, match=message):
        identify(machine(crankshaft()), test, {"rotor.shafts.0.young_modulus": None})


def test_a_machine_without_a_rotor():
    test = ModalTest("made", np.array([100.0]), (1,))
    with pytest.raises(BadInput, match="for a modal test"):
        identify(load("mayekawa-wbhe"), test, {"mechanism.bore": None})


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_universal_files(tmp_path):
    import pyuff

    file = tmp_path / "modes.uff"
    writer = pyuff.UFF(str(file))
    for mode, (hertz, shape) in enumerate([(120.0, [1.0, 0.5]), (80.0, [0.2, -1.0])], 1):
        writer.write_sets(
            pyuff.prepare_55(
                model_type=1, id1="made", id2="", id3="", id4="", id5="", analysis_type=2,
                data_ch=2, spec_data_type=8, data_type=2, n_data_per_node=3, r1=np.array(shape),
                r2=np.zeros(2), r3=np.zeros(2), node_nums=np.array([3, 12]), mode_n=mode,
                modal_m=1.0, freq=hertz, modal_damp_vis=0.0, modal_damp_his=0.0, load_case=1,
            ),
            mode="add",
        )  # fmt: skip
    test = read_measurement(file, machine(crankshaft()))
    np.testing.assert_allclose(test.frequency, 2 * np.pi * np.array([80, 120]))
    assert (test.nodes, test.axes, test.modes) == ((3, 12), ("ux", "ux"), (1, 2))
    np.testing.assert_allclose(test.shape, [[0.2, -1.0], [1.0, 0.5]])


def write_modes(file, modes):
    """Real modes of two nodes: number, load case and frequency [Hz] of each."""
    import pyuff

    file.unlink(missing_ok=True)
    writer = pyuff.UFF(str(file))
    for number, load_case, hertz in modes:
        writer.write_sets(
            pyuff.prepare_55(
                model_type=1, id1="made", id2="", id3="", id4="", id5="", analysis_type=2,
                data_ch=2, spec_data_type=8, data_type=2, n_data_per_node=3,
                r1=np.array([1.0, -1.0]), r2=np.zeros(2), r3=np.zeros(2),
                node_nums=np.array([3, 12]), mode_n=number, modal_m=1.0, freq=hertz,
                modal_damp_vis=0.0, modal_damp_his=0.0, load_case=load_case,
            ),
            mode="add",
        )  # fmt: skip


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_several_runs_in_one_universal_file_are_refused(tmp_path):
    """Modes that were measured twice counted as twice as many modes."""
    file = tmp_path / "modes.uff"
    write_modes(file, [(1, 1, 80.0), (2, 1, 120.0), (1, 2, 80.4), (2, 2, 120.3)])
    message = r"mode 1 2 times, at 80, 80.4 Hz: it holds several runs; keep those of one run"
    with pytest.raises(SceneError, match=message):
        read_measurement(file, machine(crankshaft()))
    write_modes(file, [(1, 1, 80.0), (1, 2, 80.4)])
    with pytest.raises(SceneError, match="it holds several runs"):
        read_measurement(file, machine(crankshaft()))
    # a program that numbers none
    write_modes(file, [(1, 1, 80.0), (1, 1, 120.0)])
    test = read_measurement(file, machine(crankshaft()))
    np.testing.assert_allclose(test.frequency, 2 * np.pi * np.array([80, 120]))


def write_responses(file, responses, hertz, places, kind=4, **options):
    """Data set 58 of several places to one force at node 3."""
    import pyuff

    writer = pyuff.UFF(str(file))
    for (node, direction), values in zip(places, responses, strict=True):
        writer.write_sets(
            pyuff.prepare_58(
                func_type=kind, rsp_node=node, rsp_dir=direction, ref_node=3, ref_dir=1,
                data=values, x=hertz, binary=0, id1="made", rsp_ent_name="r", ref_ent_name="f",
                abscissa_spacing=1,
                **{"ordinate_spec_data_type": 12, "orddenom_spec_data_type": 13, **options},
            ),
            mode="add",
        )  # fmt: skip


HERTZ = np.linspace(50.0, 150.0, 801)
POLES, SHAPES = np.array([80.0, 120.0]), np.array([[0.2, -1.0], [1.0, 0.5]])


def accelerations(damping=0.005, noise=0.0):
    """(places, frequencies) of two modes to a force at the first place, with noise."""
    s, own = 2j * np.pi * HERTZ, 2 * np.pi * POLES[:, None]
    gain = s**2 / (own**2 + 2 * damping * own * s + s**2)
    out = np.einsum("mn,mk->kn", gain * SHAPES[:, :1], SHAPES)
    rng = np.random.default_rng(0)
    return out + noise * (rng.standard_normal(out.shape) + 1j * rng.standard_normal(out.shape))


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_responses_in_universal_files(tmp_path):
    file = tmp_path / "responses.uff"
    # the second sensor looks along -x
    write_responses(file, accelerations() * [[1], [-1]], HERTZ, [(3, 1), (12, -1)])
    test = read_measurement(file, machine(crankshaft()))
    assert isinstance(test, ModalTest)
    assert (test.nodes, test.axes, test.modes) == ((3, 12), ("ux", "ux"), (1, 2))
    # one mode near its peak leaves 1e-5 of the frequency and 1 % of the shape to the other one
    np.testing.assert_allclose(test.frequency, 2 * np.pi * POLES, rtol=2e-5)
    np.testing.assert_allclose(test.shape[0] / test.shape[0, 1], [-0.2, 1], atol=0.01)
    np.testing.assert_allclose(test.shape[1] / test.shape[1, 0], [1, 0.5], atol=0.01)


def test_noise_makes_no_modes():
    """Noise of 5 % of the lower peak: the same two modes, to a hundredth of the width of a peak."""
    frequency, _ = modes_of_responses(HERTZ, accelerations(noise=0.2))
    np.testing.assert_allclose(frequency, POLES, atol=0.01 * 2 * 0.005 * 120)


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
@pytest.mark.parametrize(
    ("places", "kind", "change", "message"),
    [
        ([(3, 1), (12, 1)], 1, 1.0, "functions of type 1, where 4"),
        ([(3, 1), (3, 1)], 4, 1.0, "node 3, direction 1 twice: it holds several runs"),
        ([(3, 1), (12, 4)], 4, 1.0, "direction 4, where 1, 2 and 3"),
        ([(3, 1), (12, 1)], 4, 0.0, "without a peak"),
    ],
)
def test_universal_files_that_cannot_be_read(tmp_path, places, kind, change, message):
    file = tmp_path / "responses.uff"
    write_responses(file, change * accelerations(), HERTZ, places, kind)
    with pytest.raises(SceneError, match=message):
        read_measurement(file, machine(crankshaft()))


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_a_file_that_is_no_universal_one(tmp_path):
    file = tmp_path / "other.uff"
    file.write_text("no set at all\n")
    with pytest.raises(SceneError, match=r"universal file|has no normal modes"):
        read_measurement(file, machine(crankshaft()))


# Uniform steel bar of 400 mm and 20 mm diameter, hung free.
BAR = """name = "bar"

[rotor]
dof = 4

[[rotor.shafts]]
nodes = [1, 2, 3, 4, 5, 6, 7, 8, 9]
length = "50 mm"
outer_diameter = "20 mm"
young_modulus = "206 GPa"
density = "7850 kg/m^3"
poisson = 0.3
theory = "euler-bernoulli"
"""
# Of a bar with 196 GPa, by the closed form of the free bar, as one hammer direction shows it.
ALONG_X = """mode,frequency [Hz],1.ux,2.ux,3.ux,4.ux,5.ux,6.ux,7.ux,8.ux,9.ux
1,556.023,1.00000,0.42359,-0.09920,-0.47207,-0.60782,-0.47207,-0.09920,0.42359,1.00000
2,1532.700,1.00000,0.04869,-0.58475,-0.56551,0.00000,0.56551,0.58475,-0.04869,-1.00000
3,3004.705,1.00000,-0.26631,-0.62114,0.14656,0.71119,0.14656,-0.62114,-0.26631,1.00000
"""
MODULUS = {"rotor.shafts.0.young_modulus": (0.5, 2.0)}
# Eight elements with distributed masses: the modulus is 0.2 % too small by the frequencies alone as well.
CLOSE = 0.004
# A mode as universal files have it: a complex one has an eigenvalue and complex components.
COMPLEX_MODE = """    -1
    55
modal test
NONE
NONE
NONE
NONE
         1         {kind}         2         8         5         3
         2         6         1         {mode}
 {eigenvalue}  1.00000e+00  0.00000e+00  1.00000e+00  0.00000e+00
{nodes}    -1
"""


def bar():
    return loads(BAR).machine


def along_x():
    """Frequencies [Hz] and shapes of the bar."""
    rows = [line.split(",") for line in ALONG_X.splitlines()[1:]]
    return [float(row[1]) for row in rows], [[float(x) for x in row[2:]] for row in rows]


def test_shapes_along_one_axis_count_once(tmp_path):
    """Both modes of a pair are the same shape there; the modulus is that of the frequencies alone."""
    file = tmp_path / "ux-only.csv"
    file.write_text(ALONG_X)
    test = read_measurement(file, bar())
    found = identify(bar(), test, MODULUS, starts=1)
    assert found.estimate[0] == pytest.approx(196 / 206, abs=CLOSE)
    assert float(found.chi_square) < 0.2
    assert np.abs(found.error("mode_shape")).max() < 5e-3
    alone = identify(bar(), replace(test, nodes=(), axes=(), shape=None), MODULUS, starts=1)
    # shapes move it by what the elements leave of them
    assert found.estimate[0] == pytest.approx(float(alone.estimate[0]), abs=1e-3)


@pytest.mark.parametrize("angle", [0.0, np.pi / 6, np.pi / 2])
def test_shapes_of_a_pair_in_any_plane_are_found(angle):
    hertz, shapes = along_x()
    turned = np.concatenate([np.cos(angle) * np.array(shapes), np.sin(angle) * np.array(shapes)], 1)
    nodes, axes = (*range(1, 10), *range(1, 10)), ("ux",) * 9 + ("uy",) * 9
    test = ModalTest("made", 2 * np.pi * np.array(hertz), (1, 2, 3), True, nodes, axes, turned)
    found = identify(bar(), test, MODULUS, starts=1)
    assert found.estimate[0] == pytest.approx(196 / 206, abs=CLOSE)
    assert np.abs(found.error("mode_shape")).max() < 5e-3


def complex_modes(kind, phase):
    """Universal file of the bar's modes as complex ones, with 1 % of damping and turned by a phase."""
    hertz, shapes = along_x()
    text = ""
    for mode, (frequency, shape) in enumerate(zip(hertz, shapes, strict=True), 1):
        size = 2 * np.pi * frequency
        pole = size * (-0.01 + 1j * np.sqrt(1 - 0.01**2))
        nodes = ""
        for node, value in enumerate(shape, 1):
            turned = value * np.exp(1j * phase)
            cells = (turned.real, turned.imag, 0, 0, 0, 0)
            nodes += f"{node:10d}\n" + "".join(f"{cell:13.5e}" for cell in cells) + "\n"
        eigenvalue = f"{pole.real:12.5e}{pole.imag:13.5e}"
        text += COMPLEX_MODE.format(kind=kind, mode=mode, eigenvalue=eigenvalue, nodes=nodes)
    return text


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
@pytest.mark.parametrize("kind", [3, 7])
def test_complex_modes_in_universal_files(tmp_path, kind):
    file = tmp_path / "modes.uff"
    file.write_text(complex_modes(kind, 0.7))
    test = read_measurement(file, bar())
    hertz, shapes = along_x()
    # six digits of the file
    np.testing.assert_allclose(test.frequency, 2 * np.pi * np.array(hertz), rtol=1e-5)
    sign = np.sign(test.shape[:, :1])
    np.testing.assert_allclose(sign * test.shape, shapes, atol=2e-5)
    assert set(test.axes) == {"ux"}
    # the fifth node, which the second mode leaves at rest, was measured
    assert test.nodes == tuple(range(1, 10))


GROUPS = """    -1
  2467
         1         0         0         0         0         0         0         4
left
         8       110         0         0         8       117         0         0
         8       122         0         0         8       135         0         0
    -1
"""


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_groups_beside_modes_are_left_alone(tmp_path, capfd):
    file = tmp_path / "modes.uff"
    file.write_text(GROUPS + complex_modes(3, 0.0))
    assert read_measurement(file, bar()).frequency.size == 3
    assert capfd.readouterr().out == ""  # in front of the JSON of a command


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_a_universal_file_that_is_cut_is_refused(tmp_path):
    file = tmp_path / "modes.uff"
    text = complex_modes(3, 0.0)
    lines = text.splitlines(keepends=True)
    for cut in (len(lines) - 1, len(lines) - 3, 40):
        file.write_text("".join(lines[:cut]))
        with pytest.raises(SceneError, match="ends within a data set: the file is cut"):
            read_measurement(file, bar())


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_a_set_with_fewer_points_than_it_announces_is_refused(tmp_path):
    file = tmp_path / "responses.uff"
    write_responses(file, accelerations(), HERTZ, [(3, 1), (12, 1)])
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[:-40] + lines[-1:]))
    with pytest.raises(SceneError, match=r"data set 2.*must have 801 points, as its head says"):
        read_measurement(file, machine(crankshaft()))


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_coherences_beside_responses_are_left_out_with_a_note(tmp_path):
    file = tmp_path / "responses.uff"
    write_responses(file, accelerations(), HERTZ, [(3, 1), (12, 1)])
    alone = read_measurement(file, machine(crankshaft()))
    coherence = np.ones((2, HERTZ.size), complex)
    write_responses(file, coherence, HERTZ, [(3, 1), (12, 1)], 6)
    test = read_measurement(file, machine(crankshaft()))
    np.testing.assert_array_equal(test.frequency, alone.frequency)
    assert test.warnings([], []) == ["responses.uff: 2 coherences (type 6) are not read"]
    assert alone.warnings([], []) == []


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
@pytest.mark.parametrize("order", [0, 1, 2])
def test_displacements_velocities_and_accelerations_give_the_same_modes(tmp_path, order):
    """Each alone, and the second place by another motion than the first."""
    kinds = {0: 8, 1: 11, 2: 12}
    motion = accelerations() / (2j * np.pi * HERTZ) ** (2 - order)
    for second in (order, (order + 1) % 3):
        file = tmp_path / f"{second}.uff"
        other = accelerations() / (2j * np.pi * HERTZ) ** (2 - second)
        write_responses(file, motion[:1], HERTZ, [(3, 1)], ordinate_spec_data_type=kinds[order])
        write_responses(file, other[1:], HERTZ, [(12, 1)], ordinate_spec_data_type=kinds[second])
        test = read_measurement(file, machine(crankshaft()))
        # one mode near its peak leaves 1e-5 of the frequency and 1 % of the shape to the other one
        np.testing.assert_allclose(test.frequency, 2 * np.pi * POLES, rtol=2e-5)
        np.testing.assert_allclose(test.shape[0] / test.shape[0, 1], [-0.2, 1], atol=0.01)
        np.testing.assert_allclose(test.shape[1] / test.shape[1, 0], [1, 0.5], atol=0.01)


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
@pytest.mark.parametrize(
    ("unit", "size"), [("Hz", 1), ("NONE", 1), ("rad/s", 2 * np.pi), ("RPM", 60)]
)
def test_frequencies_of_a_universal_file_have_their_unit(tmp_path, unit, size):
    file = tmp_path / "responses.uff"
    options = {"abscissa_axis_units_lab": unit}
    write_responses(file, accelerations(), size * HERTZ, [(3, 1), (12, 1)], **options)
    test = read_measurement(file, machine(crankshaft()))
    np.testing.assert_allclose(test.frequency, 2 * np.pi * POLES, rtol=2e-5)


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        # peaks of a transmissibility lie where the reference is at rest, those of an impedance at none
        ({"orddenom_spec_data_type": 12}, "type 12 over 12 at node 3.*motion"),
        ({"ordinate_spec_data_type": 13, "orddenom_spec_data_type": 12}, "type 13 over 12"),
        ({"abscissa_axis_units_lab": "s"}, 'frequencies in "s", where Hz'),
    ],
)
def test_functions_whose_peaks_are_no_modes_are_refused(tmp_path, options, message):
    file = tmp_path / "responses.uff"
    write_responses(file, accelerations(), HERTZ, [(3, 1), (12, 1)], **options)
    with pytest.raises(SceneError, match=message):
        read_measurement(file, machine(crankshaft()))


@pytest.mark.skipif(importlib.util.find_spec("pyuff") is None, reason="needs pyuff")
def test_responses_beside_modes_are_left_out_with_a_note(tmp_path):
    file = tmp_path / "modes.uff"
    write_modes(file, [(1, 1, 80.0), (2, 1, 120.0)])
    write_responses(file, accelerations(), HERTZ, [(3, 1), (12, 1)])
    test = read_measurement(file, machine(crankshaft()))
    assert test.frequency.size == 2
    expected = ["modes.uff: 2 functions (data set 58) beside modes are not read"]
    assert test.warnings([], []) == expected


@pytest.mark.slow
def test_elements_32_to_35_of_the_hermetic_machine():
    # The paper's procedure on the bundled rotor: crank pin and arms were measured to be softer, and
    # their diameters are reduced until the free frequencies fit. The mass stays, for it is in disks.
    scene = load("hermetic-68cc").parts["rotor"]
    rotor = RotorModel(scene.shafts, scene.disks)
    place = lambda m: m.shafts[5].outer_diameter  # noqa: E731
    start = place(rotor)
    truth = start * jnp.array([0.85, 0.9, 0.8, 0.92])
    measured = frequencies(eqx.tree_at(place, rotor, truth))
    first = frequencies(rotor)
    assert np.all(first > measured)
    assert float(np.max(first / measured)) > 1.05
    vary = {
        f"rotor.shafts.5.outer_diameter.{n}": (0.5 * float(d), 1.2 * float(d))
        for n, d in enumerate(start)
    }
    found = identify(machine(rotor), ModalTest("made", measured, (1, 2, 3, 4)), vary, starts=1)
    assert found.fit.converged
    np.testing.assert_allclose(found.error("frequency"), 0.0, atol=1e-5)
    assert np.all(np.asarray(found.estimate) < start)
    # Four frequencies for four short neighbours: some combinations are known to a per cent only.
    np.testing.assert_allclose(found.estimate, truth, rtol=0.01)
