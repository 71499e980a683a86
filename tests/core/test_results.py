"""Results print themselves with units, become tables, and come back from files with the same bits."""

import gc
import json
import os
import tracemalloc
import zipfile
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas
import pytest
import xarray
from cylinder.test_cylinder import golden, mechanism
from helpers import machine

from jaxcomp import (
    BadInput,
    Kloss,
    load,
    load_result,
    optimise,
    pareto,
    problem,
    sensitivity,
    simulate,
    solve_orbit,
    tolerance,
    within,
)
from jaxcomp._core import results as _results
from jaxcomp._core.saved import class_address, class_at
from jaxcomp.balancing import least_squares, trial_influence
from jaxcomp.balancing._influence import InfluenceRow
from jaxcomp.crank import Orbit, TrainTorques
from jaxcomp.crank._journal_orbit import journal_orbit
from jaxcomp.cylinder import CycleOptions, solve_cycle
from jaxcomp.film import JournalBearing, operating_point, pressure_field, steady_bearing
from jaxcomp.friction._slider_crank_joints import SliderCrankLoop
from jaxcomp.parts import Part, quantity
from jaxcomp.rotor import (
    Disks,
    Link,
    Mount,
    RotorModel,
    ShaftElements,
    Unbalances,
    campbell,
    damped_modes,
    respond,
    undamped_modes,
)
from jaxcomp.study import Comparison, ParetoFront, steady_state
from jaxcomp.study._compared import ComparedQuantity
from jaxcomp.study.accuracy import Extreme, Extremes, Report
from jaxcomp.study.accuracy._report import Measurement, Reference
from jaxcomp.vibration import Harmonics, rotor_modes


def made_up(solve):
    """A result as `solve` returns it, of numbers that nobody solved for: to keep or print it takes none.

    To trace a solver tells what its result is made of in a fraction of the time that compiling it takes.
    """
    rng = np.random.default_rng(0)

    def filled(leaf):
        if not isinstance(leaf, jax.ShapeDtypeStruct):
            return leaf
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            # in order, as angles and times are
            return jnp.sort(jnp.asarray(rng.uniform(0.1, 0.9, leaf.shape)), axis=None).reshape(
                leaf.shape
            )
        return jnp.zeros(leaf.shape, leaf.dtype)

    return jax.tree.map(filled, eqx.filter_eval_shape(solve))


def rotor():
    shaft = ShaftElements((1, 2, 3), 0.2, 0.02, 2.06e11, 7850.0, 0.3)
    bearing = Mount([1e7, 1e7], [100.0, 100.0])
    links = (Link((1, None), bearing), Link((3, None), bearing))
    return RotorModel((shaft,), (Disks((2,), 5.0, 6e-3, 12e-3),), links=links)


def response():
    return respond(rotor(), (Unbalances((2,), 1e-4, 0.0),), [100.0, 300.0, 500.0], (1, 2))


def balance():
    rows = [InfluenceRow("front", "ux", 314.0), InfluenceRow("rear", "ux", 314.0)]
    trials = [[30e-6 + 10e-6j, 20e-6], [10e-6j, 60e-6]]
    system = trial_influence([10e-6j, 20e-6], trials, [1e-4, 1e-4], rows, ["top", "weight"])
    return least_squares(system)


def volume():
    ranges = {"mechanism.bore": (0.12, 0.14), "mechanism.crank_radius": (0.04, 0.06)}
    return problem(machine_of_tsuji(), ranges, ["swept_volume"])


def machine_of_tsuji():
    return load("mayekawa-wbhe")


def optimum():
    return optimise(volume(), "swept_volume", maximise=False, starts=2, samples=16, max_steps=20)


def tolerances():
    spread = {"mechanism.bore": within(1e-4), "mechanism.crank_radius": within(1e-4)}
    limits = {"swept_volume": (None, 1.34e-3)}
    return tolerance(
        machine_of_tsuji(), spread, ["swept_volume"], limits=limits, samples=256, progress=False
    )


@pytest.fixture(scope="module")
def orbit():
    return solve_orbit(machine_of_tsuji().as_compressor())


def front():
    ends = (optimum(), optimum())
    values = jnp.linspace(0.12, 0.14, 6).reshape(3, 2)
    return ParetoFront(
        ("swept_volume", "mechanical_efficiency"), ("m^3", ""), (True, False), tuple(ends[0].values),
        np.asarray(values), np.asarray(values) ** 2, np.array([np.nan, 1 / 3, np.nan]),
        ("converged",) * 3, np.array([False, False, True]), np.array([1e-3, 0.9]),
        np.full((4, 2), np.pi), 1, ends, 7,
    )  # fmt: skip


def cycle():
    options = CycleOptions(nodes=4)
    return made_up(lambda: solve_cycle(golden("A"), mechanism(), 300.0, options, throw=False))


@cache
def transient():
    return made_up(lambda: simulate(machine(motor=Kloss(250.0, 0.3, 105.0)), 0.02, throw=False))


def torsion():
    torque = jnp.asarray([[1.0 + 2j, 0.5], [3.0, 1j]])
    speeds = jnp.asarray([90.0, 180.0])
    return TrainTorques(jnp.asarray([-2.0, -1.0]), torque, speeds, jnp.ones(2), 5 * speeds)


def harmonics():
    return Harmonics(jnp.asarray([[1e-5j, 2e-6], [3e-6, 0.0]]), jnp.asarray(100.0))


def bearing():
    return JournalBearing(0.04, 0.02, 3e-5, 0.02, "short", motion="orbit")


def journal():
    def load(angle):
        return jnp.stack([2000 + 500 * jnp.cos(angle), 300 * jnp.sin(angle)])

    return made_up(lambda: journal_orbit(bearing(), load, 300.0))


def comparison():
    rows = ComparedQuantity("motor_power", "W", (1.0, 2.0)), ComparedQuantity("x", "m", (None, 2.0))
    return Comparison(("one", "other"), rows)


def report():
    rows = Measurement("a", "coarse", 1e-3, 0.1, 2.0), Measurement("a", "fine", 1e-6, 0.2, 2.0)
    reference = Reference(1.0, 1.0 + 1e-9, ("one", "other"))
    return Report("orbit", "m", "motor_power", "W", reference, rows, "")


def extremes():
    one = Extreme("near stall", "x 0.1", "converged", 0.9, 1e-6, 1e-7, 0.4, 5, 1e-3)
    other = Extreme("near-singular response", "x 1", "lost", 1e-5, np.inf, None, None, None, 2e-3)
    return Extremes("m", (one, other))


SMALL = {
    "operating point": lambda: operating_point(bearing(), 2000.0, 300.0),
    "pressure field": lambda: pressure_field(
        bearing(), operating_point(bearing(), 2000.0, 300.0), 300.0
    ),
    "extremes": extremes,
    "journal": journal,
    "comparison": comparison,
    "report": report,
    "torsion": torsion,
    "harmonics": harmonics,
    "response": response,
    "modes": lambda: undamped_modes(rotor(), 4),
    "damped modes": lambda: damped_modes(rotor(), 100.0, 4),
    "balance": balance,
    "optimum": optimum,
    "tolerances": tolerances,
    "front": front,
    "cycle": cycle,
    "transient": transient,
    "sensitivity": lambda: sensitivity(machine_of_tsuji(), ["swept_volume"]),
    "steady state": lambda: steady_state(machine_of_tsuji()),
    "steady bearing": lambda: steady_bearing(bearing(), 2000.0, -300.0),
    "modes at speeds": lambda: rotor_modes(rotor(), [100.0], 4, over=jnp.linspace(50, 150, 3)),
}


def same_bits(one, other):
    leaves, others = jax.tree.leaves(one), jax.tree.leaves(other)
    assert len(leaves) == len(others)
    for a, b in zip(leaves, others, strict=True):
        if isinstance(a, jax.Array | np.ndarray | float | int):
            assert type(a) is type(b)
            np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
            assert np.asarray(a).dtype == np.asarray(b).dtype
    for a, b in zip(one.described(), other.described(), strict=True):
        assert a.header == b.header
        np.testing.assert_array_equal(np.asarray(a.values), np.asarray(b.values))


@pytest.fixture(params=SMALL, scope="module")
def result(request):
    return SMALL[request.param]()


def test_a_saved_result_loads_to_the_same_bits(result, tmp_path):
    result.save(tmp_path / "result.npz")
    again = load_result(tmp_path / "result.npz")
    assert type(again) is type(result)
    for name in result.not_saved:  # what a solver kept for itself
        assert getattr(again, name) is None
        if isinstance(result, eqx.Module):
            result = eqx.tree_at(lambda r, name=name: getattr(r, name), result, None)
    same_bits(result, again)


def test_a_dictionary_has_every_quantity_with_its_unit_as_json_takes_it(result):
    found = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert found.pop("kind") == type(result).__name__
    for one in result.described():
        values = np.asarray(one.values)
        if np.iscomplexobj(values):
            unit = f" [{one.unit}]" if one.unit else ""
            size, phase = (
                found.pop(f"{one.name}.{k}") for k in (f"amplitude{unit}", "phase [rad]")
            )
            np.testing.assert_allclose(np.asarray(size) * np.exp(1j * np.asarray(phase)), values)
        elif values.dtype.kind == "f":
            again = np.asarray(found.pop(one.header), float)
            np.testing.assert_array_equal(again, np.where(np.isfinite(values), values, np.nan))
        else:
            assert found.pop(one.header) == values.tolist()
    assert set(found) <= {"status", "solver", "method"}


def test_a_transient_from_a_file_says_what_it_lacks():
    kept = eqx.tree_at(lambda r: r._dense, transient(), None)
    with pytest.raises(BadInput, match="as `simulate` returned it"):
        kept.at(0.01)


def test_a_table_has_every_row_with_its_units(result, tmp_path):
    table = result.to_pandas()
    data = result.to_xarray()
    sizes = [data.sizes[dim] for dim in result.table_dims if dim in data.sizes]
    assert len(table) == np.prod(sizes) > 1
    for name, unit in ((n, data[n].attrs["units"]) for n in data.variables):
        columns = [column for column in table.columns if column.partition(" [")[0] == name]
        for column in columns:
            assert column == (f"{name} [{unit}]" if unit else name)
    result.to_csv(tmp_path / "table.csv")
    words = {name: str for name in ("node", "target", "axis") if name in table}
    read = pandas.read_csv(tmp_path / "table.csv", dtype=words)
    pandas.testing.assert_frame_equal(read, table, check_exact=True, check_dtype=False)


def test_a_result_prints_its_numbers_with_units(result):
    text = repr(result)
    assert "f64[" not in text
    assert len(text.splitlines()) > 3
    assert text.splitlines()[1].split("  ")[1].strip() in result._repr_html_()


def test_the_curves_read_back_by_pandas_equal_the_orbit(orbit, tmp_path):
    orbit.to_csv(tmp_path / "curves.csv")
    read = pandas.read_csv(tmp_path / "curves.csv")
    pairs = {
        "crank_angle [rad]": orbit.state.angle,
        "pressure [Pa]": orbit.pressure[0],
        "speed [rad/s]": orbit.state.speed,
        "motor_torque [N m]": orbit.motor_torque,
        "joint_force.crank_pin.y [N]": orbit.loads.forces["crank_pin"][1],
    }
    for name, values in pairs.items():
        np.testing.assert_array_equal(read[name], values)
    size = np.hypot(read["joint_force.wall.x [N]"], read["joint_force.wall.y [N]"])
    np.testing.assert_allclose(read["joint_force.wall [N]"], size, rtol=1e-15)


def test_an_orbit_comes_back_from_its_file(orbit, tmp_path):
    orbit.save(tmp_path / "orbit.npz")
    again = load_result(tmp_path / "orbit.npz")
    same_bits(orbit, again)
    assert eqx.tree_equal(orbit, again)
    assert again.converged


def test_files_outlive_the_private_modules_of_the_package():
    # as a version wrote it whose modules had other names
    for old, kind in (
        ("jaxcomp.crank._before:Orbit", Orbit),
        ("jaxcomp.friction._before:SliderCrankLoop", SliderCrankLoop),
    ):
        assert class_at(old) is kind
        assert class_at(class_address(kind)) is kind
    with pytest.raises(ValueError, match="NeverThere"):
        class_at("jaxcomp.crank._before:NeverThere")


def test_an_orbit_prints_power_speed_and_forces(orbit):
    text = repr(orbit)
    assert text.splitlines()[0] == "Orbit: converged, collocation"
    for words in ("Mechanical efficiency", " %", "Shaft power", " kW", "1000 rpm", " MPa", " kN"):
        assert words in text


def test_printing_inside_jit_does_not_fail(orbit):
    @jax.jit
    def size(orbit):
        assert "Orbit(" in repr(orbit)
        return orbit.period

    assert size(orbit) == orbit.period


def test_orbits_of_many_designs_are_one_data_set(orbit):
    many = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), orbit)
    data = many.to_xarray()
    assert data["joint_force.wall.x"].shape == (2, orbit.time.size)
    assert data["mean_speed"].dims == ("design_0",)
    assert "2 of 2 designs converged" in repr(many)
    with pytest.raises(BadInput, match="of many designs"):
        many.columns()
    with pytest.raises(BadInput, match="of one; take them apart first"):
        many.plot.loss_shares()
    assert jax.tree.map(lambda leaf: leaf[0], many).plot.loss_shares().axes


def test_rotations_of_mode_shapes_have_another_unit_than_displacements():
    data = undamped_modes(rotor(), 4).to_xarray()
    assert data["shape.uy"].attrs["units"] == "1/kg^0.5"
    assert data["shape.thy"].attrs["units"] == "1/(kg^0.5 m)"


def test_complex_numbers_go_into_a_netcdf_file_as_amplitude_and_phase(tmp_path):
    modes = damped_modes(rotor(), 4)
    whole = modes.to_xarray()
    path = tmp_path / "modes.nc"
    modes.to_xarray(amplitudes=True).to_netcdf(path)
    read = xarray.load_dataset(path)
    value = whole["shape.ux"]
    phase = read["shape.ux.phase"]
    assert phase.attrs["units"] == "rad"
    assert read["shape.ux.amplitude"].attrs["units"] == value.attrs["units"]
    # to rounding: amplitude and phase of a number are the number
    polar = read["shape.ux.amplitude"] * np.exp(1j * phase)
    np.testing.assert_allclose(polar, value, rtol=1e-12, atol=1e-14)


def test_pictures_of_a_result_are_found_by_name(orbit):
    assert {"pv_diagram", "joint_forces", "loss_shares"} <= set(dir(orbit.plot))
    assert "by_number_of_cylinders" not in dir(orbit.plot)  # of several orbits
    assert orbit.plot.loss_shares().axes
    assert orbit.plot.pv_diagram(machine_of_tsuji().as_compressor()).axes
    assert balance().plot.balance_bars().axes
    with pytest.raises(AttributeError, match=r"did you mean \"pv_diagram\""):
        orbit.plot.pv_digram  # noqa: B018


def test_response_curves_and_campbell_diagram_are_pictures_of_results():
    found = response()
    axes = found.plot.response_curves().axes
    assert len(axes) == 2  # orders
    (line,) = (line for line in axes[0].lines if line.get_label() == "2")
    np.testing.assert_allclose(line.get_xdata(), np.array([100, 300, 500]) * 30 / np.pi)
    # a circular orbit about an isotropic rotor
    sizes = 1e6 * np.abs(found.displacement[0, :, 1, 0])
    np.testing.assert_allclose(line.get_ydata(), sizes, rtol=1e-9)
    shown = found.plot.response_curves(nodes=[3]).axes[0].lines
    assert [line.get_label() for line in shown] == ["3"]
    with pytest.raises(BadInput, match="nodes"):
        found.plot.response_curves(nodes=["third"])
    speeds = [100.0, 200.0, 300.0]
    modes = campbell(rotor(), jnp.array(speeds), 4)
    ax = modes.plot.campbell_diagram(speeds).axes[0]
    drawn = np.sort(
        np.concatenate([line.get_ydata() for line in ax.lines if line.get_marker() != "None"])
    )
    np.testing.assert_allclose(drawn, np.sort(np.ravel(modes.frequency)) / (2 * np.pi))
    with pytest.raises(BadInput, match="that `campbell` was given"):
        modes.plot.campbell_diagram(speeds[:2])


def test_a_machine_prints_values_with_units():
    text = repr(machine_of_tsuji().machine)
    for line in ("bore: 130 mm", "mean_speed: 1000 rpm", "discharge_pressure: 0.98 MPa"):
        assert line in text
    assert "f64[" not in text


def test_a_front_lists_its_points(tmp_path):
    front = pareto(
        problem(machine_of_tsuji(), {"mechanism.bore": (0.12, 0.14)}, ["swept_volume", stiff]),
        ("swept_volume", stiff), maximise=(False, False), points=3, starts=1, samples=8, max_steps=10,
    )  # fmt: skip
    table = front.to_pandas()
    assert list(table.columns)[:2] == ["mechanism.bore [m]", "swept_volume [m^3]"]
    assert len(table) == len(front.values)
    with pytest.raises(BadInput, match="functions of the user"):
        front.save(tmp_path / "front.npz")


def stiff(found):
    return 1 / found.design.compressor.mechanism.bore


def test_a_file_of_something_else_is_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.ones(3))
    with pytest.raises(BadInput, match="that `save` of a result wrote"):
        load_result(tmp_path / "other.npz")
    head = '{"format": "jaxcomp result", "version": "0", "result": {"name": "os:getcwd"}}'
    np.savez(tmp_path / "evil.npz", head=np.array(head))
    with pytest.raises(BadInput, match="cannot read"):
        load_result(tmp_path / "evil.npz")


def class_of(address, **fields):
    return {"class": address, "fields": fields}


def written(path, result, **arrays):
    """A file as `save` writes it, with something else in the place of the result."""
    head = json.dumps({"format": "jaxcomp result", "version": "0", "result": result})
    np.savez(path, head=np.array(head), **arrays)
    return path


def test_a_hostile_file_deletes_nothing(tmp_path):
    kept = tmp_path / "kept.txt"
    kept.write_text("of the user")
    fields = {"name": str(kept), "close_called": False, "delete": True}
    closer = "jaxcomp.report:matplotlib.tempfile._TemporaryFileCloser"
    with pytest.raises(BadInput, match="cannot read"):
        load_result(written(tmp_path / "evil.npz", class_of(closer, **fields)))
    # whatever it made is young; all objects of the tests before would take seconds
    gc.collect(1)
    assert kept.read_text() == "of the user"


@pytest.mark.parametrize(
    "result",
    [
        {"name": "jaxcomp.scene:os.system"},
        {"name": "jaxcomp.scene:load"},
        class_of("jaxcomp.scene:os.system"),
        class_of("jaxcomp.scene:load"),  # a function
        class_of("jaxcomp.scene:SceneError"),  # neither part nor result
        class_of("jaxcomp:jax.numpy.ndarray"),
        class_of("jaxcomp._core.results:NamedTuple"),  # of another module
        class_of("jaxcomp:__main__"),
        class_of("jaxcomp.nowhere:Orbit"),
        class_of("collections:OrderedDict"),
        class_of("jaxcomp.mechanism:CrankState"),  # lacks its fields
        class_of("jaxcomp.mechanism:CrankState", angle=0.0, speed=0.0, more=0.0),
        class_of("jaxcomp.mechanism:CrankState", angle=0.0, speed=0.0),  # a part, but no result
        {},
        {"dict": [[{"list": []}, 1]]},  # a list as key
        {"jax": "array_7"},
        {"status": {"numpy": "array_0"}},
        {"tuple": 3},
        {"list": [[1, 2], {"x": 1, "y": 2}]},
        "text",
        None,
    ],
)
def test_only_results_and_parts_are_made_from_a_file(result, tmp_path):
    path = written(tmp_path / "evil.npz", result, array_0=np.array(10**6))
    with pytest.raises(BadInput, match=r"evil\.npz"):
        load_result(path)


@pytest.mark.parametrize("head", ["{}", "[]", "1", "", "[" * 10**5, '{"format": "jaxcomp result"}'])
def test_a_damaged_head_is_refused(head, tmp_path):
    np.savez(tmp_path / "damaged.npz", head=np.array(head))
    with pytest.raises(BadInput, match=r"damaged\.npz"):
        load_result(tmp_path / "damaged.npz")


def test_a_cut_file_is_refused_and_a_pipe_is_not_read(tmp_path):
    balance().save(tmp_path / "whole.npz")
    whole = (tmp_path / "whole.npz").read_bytes()
    for kept in (0, 3, 40, len(whole) // 2, len(whole) - 30):
        (tmp_path / "cut.npz").write_bytes(whole[:kept])
        with pytest.raises(BadInput, match=r"cut\.npz"):
            load_result(tmp_path / "cut.npz")
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(OSError, match="pipe or a device"):
        load_result(tmp_path / "pipe.npz")


def bomb(path, size, **arrays):
    """An archive whose one member unpacks to zeros of a size, of a thousandth of it itself."""
    np.savez(path, **arrays)
    block = bytes(10**7)
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=9) as archive,
        archive.open("array_9.npy", "w", force_zip64=True) as member,
    ):
        for _ in range(size // len(block)):
            member.write(block)


@pytest.mark.parametrize("head", ['{"format": "jaxcomp result"}', "{}"])
def test_what_would_fill_the_memory_is_refused_before_it_is_unpacked(head, tmp_path, monkeypatch):
    monkeypatch.setattr(_results, "_LARGEST", 10**8)
    bomb(tmp_path / "bomb.npz", 2 * 10**8, head=np.array(head))
    assert (tmp_path / "bomb.npz").stat().st_size < 10**6
    tracemalloc.start()
    try:
        with pytest.raises(BadInput, match=r"bomb\.npz, which unpacks to 0.2 GB"):
            load_result(tmp_path / "bomb.npz")
        assert tracemalloc.get_traced_memory()[1] < 10**7
    finally:
        tracemalloc.stop()


def test_a_result_that_could_not_be_read_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(_results, "_LARGEST", 10)
    with pytest.raises(BadInput, match="save parts of it"):
        balance().save(tmp_path / "large.npz")
    assert not [*tmp_path.iterdir()]


class LawOfAnExtension(Part):
    """A part of another package."""

    value: jax.Array = quantity("m")


@pytest.mark.parametrize(
    ("address", "module"),
    [
        ("jaxcomp.motor:Kloss", "motor.kloss"),
        ("jaxcomp.fluid:Saturation", "fluid._helmholtz"),
        ("jaxcomp.friction:CoulombJournal", "friction.coulomb"),
        ("jaxcomp.cylinder:Woschni", "cylinder.heat.woschni"),
        ("jaxcomp.film:Guembel", "film.guembel"),
    ],
)
def test_a_law_is_known_by_its_package_and_not_by_its_file(address, module):
    # so that earlier versions, which had several laws in a file, read what this one writes as well
    kind = class_at(address)
    assert kind.__module__ == f"jaxcomp.{module}"
    assert class_address(kind) == address


def test_parts_of_extensions_are_found():
    assert class_at(class_address(LawOfAnExtension)) is LawOfAnExtension
    with pytest.raises(ValueError, match="test_results:Mount"):  # of jaxcomp, not of that module
        class_at("test_results:Mount")
