"""`sweep`: the same numbers whatever the blocks, devices and processes, and after a kill."""

import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import threading
import time

import dask
import jax
import numpy as np
import pytest
import sweep_runs
import xarray
from distributed import Client, LocalCluster
from scipy.stats import qmc

import jaxcomp as jc
from jaxcomp import BadInput, Collocation, load, open_sweep, sweep
from jaxcomp._core.display import shown
from jaxcomp.study import AnalysisOptions, problem
from jaxcomp.study.sweep import (
    best_curve,
    best_design,
    grid,
    log_grid,
    log_uniform,
    normal,
    uniform,
)
from jaxcomp.study.sweep._points import (
    Blocks,
    GridPoints,
    SamplePoints,
    neighbours_together,
)
from jaxcomp.study.sweep._store import status_words, stored_header
from jaxcomp.study.sweep._summary import columns, summary

RPM = np.pi / 30
# of the sweeps over friction, which share a program
SOLVED = ["mechanical_efficiency", "motor_power"]


@pytest.fixture(scope="module")
def machine():
    return sweep_runs.machine()


@pytest.fixture(scope="module")
def small():
    return sweep_runs.small()


@pytest.fixture(scope="module")
def many():
    """Uninterrupted, in memory."""
    return sweep_runs.many(None)


def blocks(path):
    """Files that say that a block is whole."""
    return sorted(
        file for file in (path / "ok" / "c").rglob("*") if file.is_file() and file.name.isdigit()
    )


# ---------------------------------------------------------------- what comes out


def test_every_design_is_the_problem_at_its_coordinates(machine, small):
    asked = problem(
        machine, list(small.coords), ["mechanical_efficiency"], sweep_runs.fast_options()
    )
    one = jax.jit(lambda values: asked(values))
    for place in ((0, 0), (20, 9), (7, 3)):
        there = small.isel(bore_at_displacement=place[0], **{"motor.mean_speed": place[1]})
        answer = one(np.array([there.bore_at_displacement, there["motor.mean_speed"]]))
        # one design and a group of them round differently
        assert float(answer.values[0]) == pytest.approx(
            float(there.mechanical_efficiency), rel=1e-12
        )
    assert small.mechanical_efficiency.shape == (21, 10)
    assert small.ok.values.all()


def test_published_optimum_bores_are_found(machine):
    """Tsuji et al. (2012), Figs 5c and 6: 120, 130, 140 mm at 800, 1000, 1200 rpm."""
    over = {
        "bore_at_displacement": grid(0.1, 0.18, 9),
        "motor.mean_speed": np.array([800, 1000, 1200]) * RPM,
    }
    found = sweep(machine, over, options=sweep_runs.fast_options())
    top = best_curve(found, "mechanical_efficiency")
    np.testing.assert_allclose(top.along, [0.12, 0.13, 0.14], rtol=1e-12)
    # printed to three digits; the machine was fitted to them to 0.05 per cent points
    np.testing.assert_allclose(top.value, [0.921, 0.911, 0.903], atol=3e-3)


def test_coordinates_carry_units(small):
    assert dict(small.sizes) == {"bore_at_displacement": 21, "motor.mean_speed": 10}
    assert small.bore_at_displacement.attrs["units"] == "m"
    assert small["motor.mean_speed"].attrs["units"] == "rad/s"
    assert small.mechanical_efficiency.attrs["better"] == "more"


def test_failed_designs_are_marked_and_spoil_no_other(machine):
    over = {"friction.wall.coefficient": [0.083, 0.1, 40.0]}
    found = sweep(machine, over, SOLVED, options=sweep_runs.fast_options())
    assert found.ok.values.tolist() == [True, True, False]
    assert status_words(found).tolist() == ["converged", "converged", "self_locking"]
    assert summary(found).failed_by_status == {"self_locking": 1}
    assert columns(found)["status"].tolist() == status_words(found).tolist()
    assert np.isnan(found.mechanical_efficiency.values).tolist() == [False, False, True]
    assert np.isnan(found.motor_power.values[2])
    good = {"friction.wall.coefficient": [0.083, 0.1]}
    alone = sweep(machine, good, SOLVED, options=sweep_runs.fast_options())
    for name in alone.data_vars:
        np.testing.assert_array_equal(found[name][:2], alone[name])


def test_block_of_failures_alone_is_kept_as_a_result(machine, tmp_path):
    over = {"friction.wall.coefficient": [40.0, 50.0]}
    options = {"options": sweep_runs.fast_options(), "out": tmp_path / "out", "batch": 1}
    found = sweep(machine, over, SOLVED, **options)
    assert not found.ok.values.any()
    assert len(blocks(tmp_path / "out")) == 2
    again = open_sweep(tmp_path / "out")
    assert status_words(again).tolist() == ["self_locking", "self_locking"]


def test_a_store_that_knows_no_status_goes_on(machine, tmp_path):
    """Those of versions before had none."""
    over = {"friction.wall.coefficient": [0.083, 40.0, 0.09]}
    given = machine, over, SOLVED
    options = {"options": sweep_runs.fast_options(), "batch": 1, "progress": False}
    new = sweep(*given, **options, out=tmp_path / "out")
    shutil.rmtree(tmp_path / "out" / "status")
    there = tmp_path / "out" / "zarr.json"
    there.write_text(there.read_text().replace('\\"status\\", ', ""))
    (tmp_path / "out" / "ok" / "c" / "1").unlink()
    old = sweep(*given, **options, out=tmp_path / "out")
    assert status_words(old) is None
    assert summary(old).failed_by_status == {}
    assert "status" not in columns(old)
    np.testing.assert_array_equal(old.mechanical_efficiency, new.mechanical_efficiency)


def test_functions_and_problems_are_swept_as_well(machine):
    def stroke(found):
        return 2 * found.design.compressor.mechanism.crank_radius

    asked = problem(machine, ["bore_at_displacement"], [stroke, "swept_volume"])
    found = sweep(asked, {"bore_at_displacement": [0.13, 0.26]})
    assert found.stroke.values == pytest.approx([0.0999757, 0.0999757 / 4], rel=1e-6)
    # the rule keeps the displacement
    assert found.swept_volume.values[1] == pytest.approx(found.swept_volume.values[0], rel=1e-12)


# ---------------------------------------------------------------- the same to the last bit


@pytest.mark.parametrize("batch", [1, 17, 64])
def test_blocks_change_nothing(small, batch, tmp_path):
    found = sweep_runs.small(batch=batch, out=tmp_path / "out" if batch == 17 else None)
    assert found.load().identical(small)


@pytest.mark.slow
def test_devices_change_nothing(small, tmp_path):
    run, environment = sweep_runs.command("devices", out=tmp_path / "both.npy", devices=2)
    environment["XLA_FLAGS"] += " --xla_force_host_platform_device_count=2"
    subprocess.run(run, env=environment, check=True, timeout=120)
    one, two = np.load(tmp_path / "both.npy")
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, small.mechanical_efficiency)


@pytest.mark.slow  # two processes that import JAX and compile
def test_options_of_a_solver_are_swept_in_processes_that_end():
    """As the docstring of `sweep` says: what a process compiled goes with it."""
    pool = multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1)
    with pool:
        coarse, fine = pool.map(sweep_runs.with_nodes, [8, 16], chunksize=1)
    assert coarse[0] != fine[0]
    # both are converged to 1e-8 of the losses or better, a tenth of which is lost
    np.testing.assert_allclose(coarse[1], fine[1], rtol=1e-8)


def test_killed_sweep_resumes_and_loses_nothing(many, tmp_path):
    """SIGKILL at a random moment, then to the end: bit for bit the uninterrupted one."""
    check_kills(many, tmp_path / "out", 1)


@pytest.mark.slow
def test_sweep_killed_again_and_again_loses_nothing(many, tmp_path):
    check_kills(many, tmp_path / "out", 4)


def check_kills(many, out, times):
    run, environment = sweep_runs.command("many", out=out)
    seen = 0
    for wanted in sorted(random.sample(range(1, 60), times)):
        with subprocess.Popen(run, env=environment) as process:
            while len(blocks(out)) < wanted and process.poll() is None:
                time.sleep(0.002)
            process.send_signal(signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL
        stamps = {file: file.stat().st_mtime_ns for file in blocks(out)}
        assert seen < len(stamps) < 79
        seen = len(stamps)
    half = open_sweep(out)
    assert 0 < half.ok.values.sum() < half.ok.size
    found = sweep_runs.many(out)
    assert all(file.stat().st_mtime_ns == stamp for file, stamp in stamps.items())
    assert found.load().identical(many)
    assert len(blocks(out)) == 79


def test_half_written_block_is_done_again(small, tmp_path):
    out = tmp_path / "out"
    sweep_runs.small(out=out, batch=50)
    last = blocks(out)[-1]
    last.unlink()
    other = out / "mechanical_efficiency" / last.relative_to(out / "ok")
    other.write_bytes(b"")
    assert sweep_runs.small(out=out).load().identical(small)


# ---------------------------------------------------------------- on a Dask cluster


@pytest.fixture(scope="module")
def cluster():
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as made:
        yield made


def kill_after(client, out, wanted):
    """End a worker by SIGKILL as soon as so many blocks are written."""
    victim = next(iter(client.run(os.getpid).values()))

    def kill():
        while len(blocks(out)) < wanted:
            time.sleep(0.002)
        os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    return killer, victim


def check_cluster(cluster, out, run, wanted):
    with Client(cluster) as client:
        before = set(client.run(os.getpid).values())
        killer, victim = kill_after(client, out, wanted)
        found = run(out, client=client).load()
        killer.join(60)
        client.wait_for_workers(2, timeout=60)
        after = set(client.run(os.getpid).values())
    assert victim in before - after  # and the nanny started another
    return found


def test_a_killed_worker_of_a_cluster_loses_nothing(cluster, tmp_path):
    """The blocks that it had go to the other, or to the one that takes its place."""
    found = check_cluster(cluster, tmp_path / "out", sweep_runs.volumes, 5)
    assert found.identical(sweep_runs.volumes(None))


@pytest.mark.slow  # a cluster that loses a worker, and a sweep that goes on, are in the ordinary run
def test_a_cluster_goes_on_where_a_sweep_stopped(cluster, small, tmp_path):
    out = tmp_path / "out"
    sweep_runs.small(out=out, batch=50)
    for file in blocks(out)[1::2]:
        file.unlink()
    stamps = {file: file.stat().st_mtime_ns for file in blocks(out)}
    with Client(cluster) as client:
        found = sweep_runs.small(out=out, client=client).load()
        assert sweep_runs.small(batch=50, client=client).identical(small)  # without a store as well
    assert found.identical(small)
    assert all(file.stat().st_mtime_ns == stamp for file, stamp in stamps.items())


@pytest.mark.slow  # the time it takes to give a scheduler up
def test_a_lost_scheduler_is_named_and_what_is_done_is_kept(tmp_path):
    out = tmp_path / "out"
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as cluster,
        Client(cluster) as client,
    ):

        def stop():
            while len(blocks(out)) < 3:
                time.sleep(0.002)
            cluster.close(timeout=5)

        threading.Thread(target=stop, daemon=True).start()
        with pytest.raises(ConnectionError, match="same `out` to go on"):
            sweep_runs.cheap(out, 200_000, batch=256, client=client)
    kept = len(blocks(out))
    assert 3 <= kept < 782
    found = sweep_runs.cheap(out, 200_000)
    assert found.load().identical(sweep_runs.cheap(None, 200_000))


@pytest.mark.slow  # 300,000 designs twice, in a minute; a million took four
def test_many_designs_on_a_cluster_with_a_killed_worker(cluster, tmp_path):
    count = 300_000

    def run(out, **options):
        return sweep_runs.many(out, count, None, **options)

    started = time.perf_counter()
    alone = run(tmp_path / "alone").load()
    between = time.perf_counter()
    found = check_cluster(cluster, tmp_path / "out", run, 10)
    print(
        f"{count / (between - started):.0f} designs/s in one process, "
        f"{count / (time.perf_counter() - between):.0f} on two workers, one of which was killed"
    )
    assert found.identical(alone)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_sweep(tmp_path):
    run, environment = sweep_runs.command("memory", out=tmp_path / "out", count=10_000_000)
    done = subprocess.run(run, env=environment, check=True, capture_output=True, text=True)
    # 10^7 designs of three numbers and a mark are 250 MB; blocks, threads and their buffers 60 MB
    assert int(done.stdout) < 60_000


# ---------------------------------------------------------------- what is refused


OTHERS = {
    "machine": ({"scene": "rod"}, "other numbers of the machine"),
    "values": ({"over": {"bore_at_displacement": [0.12, 0.14]}}, "other values of the variables"),
    "variable": (
        {"over": {"mechanism.bore": [0.12, 0.13]}},
        "variables bore_at_displacement where this one has",
    ),
    "quantity": ({"quantities": ["motor_power"]}, "quantities swept_volume"),
    "options": ({"options": AnalysisOptions(Collocation(nodes=6))}, "options "),
}


@pytest.mark.parametrize("case", OTHERS)
def test_store_of_another_sweep_is_refused(machine, tmp_path, case):
    out = tmp_path / "out"
    first = {
        "over": {"bore_at_displacement": [0.12, 0.13]},
        "quantities": ["swept_volume"],
        "scene": machine,
    }
    first["options"] = sweep_runs.fast_options()
    sweep(**first, out=out)
    changed, words = OTHERS[case]
    if "scene" in changed:
        from jaxcomp.scene import with_value

        changed = {"scene": with_value(machine, "mechanism.conrod_mass", "3 kg", source="test")}
    with pytest.raises(BadInput, match=words):
        sweep(**first | changed, out=out)
    sweep(**first, out=out)


def cut(file):
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def header_of(value):
    def change(out):
        file = out / "zarr.json"
        whole = json.loads(file.read_text())
        whole["attributes"]["jaxcomp_sweep"] = json.dumps(value)
        file.write_text(json.dumps(whole))

    return change


def without(key):
    return lambda out: header_of(
        {k: v for k, v in stored_header(out).items() if k != key} if key else []
    )(out)


DAMAGES = {
    "header of []": (without(""), "no sweep"),
    "header without columns": (without("columns"), "no sweep"),
    "header without blocks": (without("block"), "no sweep"),
    "an array gone": (lambda out: shutil.rmtree(out / "swept_volume"), "damaged"),
    "header of an array cut": (lambda out: cut(out / "swept_volume" / "zarr.json"), "damaged"),
    "value gone": (lambda out: (out / "swept_volume" / "c" / "0").unlink(), None),
    "value cut": (lambda out: cut(out / "swept_volume" / "c" / "0"), None),
    "ok cut": (lambda out: cut(out / "ok" / "c" / "0"), None),
    "ok gone": (lambda out: (out / "ok" / "c" / "0").unlink(), None),
}


@pytest.mark.parametrize("case", DAMAGES)
def test_a_damaged_store_is_refused_or_mended(machine, tmp_path, case):
    damage, words = DAMAGES[case]
    out = tmp_path / "out"
    asked = {
        "over": {"bore_at_displacement": [0.12, 0.13]},
        "quantities": ["swept_volume"],
        "scene": machine,
    }
    asked["options"] = sweep_runs.fast_options()
    whole = sweep(**asked, out=out).load()
    damage(out)
    if case == "value gone":
        assert not open_sweep(out)["ok"].any()
    if words is None:
        assert sweep(**asked, out=out).load().identical(whole)
    else:
        with pytest.raises(BadInput, match=words):
            sweep(**asked, out=out)
        with pytest.raises(BadInput, match=r"the store of a sweep|damaged"):
            open_sweep(out)


def test_folder_of_something_else_is_refused_and_kept(machine, tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(BadInput, match="no sweep"):
        sweep(machine, {"bore_at_displacement": [0.12]}, ["swept_volume"], out=tmp_path)
    assert os.listdir(tmp_path) == ["letter.txt"]
    with pytest.raises(BadInput, match="store of a sweep"):
        open_sweep(tmp_path)


def test_another_function_of_the_same_name_is_another_sweep(machine, tmp_path):
    def made(factor):
        space = {}
        exec(f"def one(found): return {factor} * found.design.compressor.mechanism.bore", space)
        return space["one"]

    sweep(machine, {"bore_at_displacement": [0.12]}, [made(2.0)], out=tmp_path / "out")
    sweep(machine, {"bore_at_displacement": [0.12]}, [made(2.0)], out=tmp_path / "out")
    with pytest.raises(BadInput, match="quantities one"):
        sweep(machine, {"bore_at_displacement": [0.12]}, [made(3.0)], out=tmp_path / "out")


BAD = {
    "no variable": ({"over": {}}, "over"),
    "unknown variable": ({"over": {"boar": [1.0]}}, "boar"),
    "out of bounds": (
        {"over": {"bore_at_displacement": [-0.1, 0.1]}},
        "`bore_at_displacement` must be > 0 and <= 10 m, but is -0.1",
    ),
    "repeated": ({"over": {"bore_at_displacement": [0.1, 0.1]}}, "without repeated"),
    "not finite": ({"over": {"bore_at_displacement": [0.1, np.nan]}}, "finite"),
    "distribution": ({"over": {"bore_at_displacement": uniform(0.1, 0.2)}}, "samples"),
    "list": (
        {"over": {"bore_at_displacement": [0.1]}, "samples": 4},
        "uniform.*is a list of values",
    ),
    "samples": ({"over": {"bore_at_displacement": uniform(0.1, 0.2)}, "samples": 0}, "samples"),
    "sampling": (
        {"over": {"bore_at_displacement": uniform(0.1, 0.2)}, "samples": 4, "sampling": "halton"},
        "sobol, latin_hypercube, random",
    ),
    "unknown quantity": ({"quantities": ["speed"]}, "speed"),
    "twice": ({"quantities": ["motor_power", "motor_power"]}, "motor_power"),
    "batch": ({"batch": 0}, "batch"),
    "width": ({"width": 0}, "width"),
    "devices": ({"devices": 99}, "devices"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_by_name(machine, case):
    changed, words = BAD[case]
    with pytest.raises(BadInput, match=words):
        sweep(
            **{
                "scene": machine,
                "over": {"bore_at_displacement": [0.12]},
                "quantities": ["swept_volume"],
            }
            | changed
        )


@pytest.mark.parametrize(
    "call",
    [
        lambda: grid(1.0, 1.0, 3),
        lambda: grid(1.0, 2.0, 1),
        lambda: log_grid(0.0, 1.0, 3),
        lambda: uniform(2.0, 1.0),
        lambda: log_uniform(-1.0, 1.0),
        lambda: normal(1.0, 0.0),
        lambda: normal(np.nan, 1.0),
    ],
)
def test_impossible_ranges_are_refused(call):
    with pytest.raises(BadInput):
        call()


def test_layout_of_a_store_is_kept(tmp_path):
    out = tmp_path / "out"
    sweep_runs.cheap(out, 1000, batch=64)
    with pytest.raises(BadInput, match="batch"):
        sweep_runs.cheap(out, 1000, batch=128)
    with pytest.raises(BadInput, match="width"):
        sweep_runs.cheap(out, 1000, width=8)
    sweep_runs.cheap(out, 1000)


# ---------------------------------------------------------------- designs and blocks


@pytest.mark.parametrize(
    "shape", [(1,), (7,), (1000,), (3, 5), (51, 33), (2, 3, 1001), (100, 1, 9)]
)
@pytest.mark.parametrize("batch", [1, 8, 512])
def test_blocks_cover_every_design_once(shape, batch):
    layout = Blocks.of(shape, batch)
    assert np.prod(layout.block) <= batch
    seen = np.zeros(shape, int)
    for number in range(layout.number):
        seen[layout.place(number)] += 1
    assert (seen == 1).all()
    # no more than half of the batch is left idle where there are designs to fill it
    assert np.prod(layout.block) >= min(batch, np.prod(shape)) / 2 - 1 or batch < max(shape)


def test_neighbours_come_together_and_all_are_there():
    rows = np.random.default_rng(0).random((1000, 2)) * [1.0, 1e6]
    order = neighbours_together(rows, 32)
    assert sorted(order) == list(range(1000))
    spread = [np.ptp(rows[part], axis=0) for part in np.split(order, range(32, 1000, 32))]
    # 32 groups in a square of side 1 have sides of about 1/sqrt(32), whatever the units
    assert (np.mean(spread, axis=0) < [0.25, 0.25e6]).all()
    alike = neighbours_together(np.ones((40, 2)), 32)
    assert sorted(alike) == list(range(40))


def test_rows_of_a_grid_are_in_the_order_of_its_arrays():
    points = GridPoints({"a": np.array([1.0, 2.0]), "b": np.array([3.0, 4.0, 5.0])})
    rows = points.rows((slice(0, 2), slice(1, 3)))
    assert rows.tolist() == [[1, 4], [1, 5], [2, 4], [2, 5]]


AXES = {"a": uniform(0.0, 1.0), "b": uniform(0.0, 1.0), "c": log_uniform(1e-3, 1.0)}


@pytest.mark.parametrize("sampling", ["sobol", "latin_hypercube", "random"])
def test_samples_do_not_depend_on_who_draws_them(sampling):
    whole = SamplePoints(AXES, 9000, sampling, 5).rows((slice(0, 9000),))
    parts = SamplePoints(AXES, 9000, sampling, 5)
    for start, stop in ((8000, 9000), (0, 10), (10, 5000)):
        np.testing.assert_array_equal(parts.rows((slice(start, stop),)), whole[start:stop])
    assert not np.array_equal(whole, SamplePoints(AXES, 9000, sampling, 6).rows((slice(0, 9000),)))


def test_sobol_points_are_those_of_scipy():
    rows = SamplePoints(AXES, 64, "sobol", 5).rows((slice(0, 64),))
    # half a step of its 30 bits off zero
    expected = qmc.Sobol(3, rng=5).random(64) + 2.0**-31
    np.testing.assert_array_equal(rows[:, :2], expected[:, :2])
    np.testing.assert_allclose(rows[:, 2], 1e-3 ** (1 - expected[:, 2]), rtol=1e-14)


def test_latin_hypercube_has_one_design_in_every_layer():
    rows = SamplePoints(AXES, 100, "latin_hypercube", 0).rows((slice(0, 100),))
    assert sorted((rows[:, 0] * 100).astype(int)) == list(range(100))


def test_moments_of_a_normal_distribution():
    rows = SamplePoints({"a": normal(2.0, 0.5)}, 4096, "sobol", 0).rows((slice(0, 4096),))
    # quasi-random points miss the moments by about 1/n
    assert rows.mean() == pytest.approx(2.0, abs=1e-3)
    assert rows.std() == pytest.approx(0.5, abs=1e-3)
    assert np.isfinite(rows).all()


# ---------------------------------------------------------------- the best design


def hill(better="more", sign=1.0):
    x, y = np.array([0.0, 1.0, 2.5, 4.0]), np.array([1.0, 2.0, 3.9])
    values = sign * (y - (x[:, None] - y) ** 2)
    return xarray.Dataset(
        {"q": (("x", "y"), values, {"better": better}), "ok": (("x", "y"), np.isfinite(values))},
        {"x": x, "y": y},
    )


@pytest.mark.parametrize(("better", "sign"), [("more", 1.0), ("less", -1.0)])
def test_ridge_of_a_parabola_is_exact_between_the_values(better, sign):
    found = hill(better, sign)
    top = best_curve(found, "q")
    assert top.along.tolist() == [1.0, 2.5, 4.0]
    # the last is at the end of the values, where there is no parabola
    np.testing.assert_allclose(top.between, [1.0, 2.0, 4.0], rtol=1e-12)
    np.testing.assert_allclose(top.value, sign * np.array([1.0, 1.75, 3.89]), rtol=1e-12)
    assert best_design(found, "q") == {"x": 4.0, "y": 3.9, "q": pytest.approx(sign * 3.89)}


def test_ridge_passes_over_failed_designs():
    found = hill()
    found.q[2, 1] = np.nan
    found.q[:, 0] = np.nan
    top = best_curve(found, "q")
    assert np.isnan(top.along[0])
    assert np.isnan(top.value[0])
    assert top.along[1] == 1.0
    found.q[:] = np.nan
    assert best_design(found, "q") is None


def test_quantity_without_a_better_side_has_no_ridge():
    with pytest.raises(BadInput, match="better"):
        best_curve(hill(better=""), "q")
    with pytest.raises(BadInput, match="over two"):
        best_curve(hill().isel(y=0), "q")


@pytest.mark.parametrize(
    ("name", "unit", "value", "text"),
    [
        ("bore_at_displacement", "m", 0.13, "130 mm"),
        ("film.clearance", "m", 12e-6, "12 µm"),
        ("motor.mean_speed", "rad/s", 1000 * RPM, "1000 rpm"),
        ("mechanical_efficiency", "", 0.911, "91.1 %"),
        ("joint_margin", "", 0.5, "0.5"),
        ("gas.suction_pressure", "Pa", 98e3, "98 kPa"),
        ("gas.discharge_pressure", "Pa", 0.98e6, "0.98 MPa"),
        ("motor_power", "W", 12345.0, "12.345 kW"),
        ("corrections.top.x", "kg m", 8e-4, "800 g mm"),
        ("law.stiffness", "N/m", 2e8, "200 MN/m"),
        ("inertia", "kg m^2", 0.5, "0.5 kg m^2"),
    ],
)
def test_numbers_are_shown_in_the_units_people_use(name, unit, value, text):
    assert shown(name, unit, [value, np.nan]).text(value) == text


def test_a_copied_store_opens_elsewhere(small, tmp_path):
    out = tmp_path / "out"
    sweep_runs.small(out=out)
    shutil.move(out, tmp_path / "moved")
    plain = xarray.open_zarr(tmp_path / "moved", consolidated=False, chunks=None)
    np.testing.assert_array_equal(plain.mechanical_efficiency, small.mechanical_efficiency)
    np.testing.assert_array_equal(plain.bore_at_displacement, small.bore_at_displacement)


def test_samples_of_a_problem_lie_within_its_ranges():
    made = problem(load("mayekawa-wbhe"), {"mechanism.bore": (0.1, 0.16)}, ["swept_volume"])
    found = sweep(made, samples=64, progress=False)
    bores = found["mechanism.bore"].values
    assert found.sizes == {"sample": 64}
    assert 0.1 <= bores.min() < 0.102
    assert 0.158 < bores.max() <= 0.16
    same = sweep(made, {"mechanism.bore": jc.uniform(0.1, 0.16)}, samples=64, progress=False)
    assert np.array_equal(same["mechanism.bore"].values, bores)
    open_ended = problem(load("mayekawa-wbhe"), ["mechanism.bore"], ["swept_volume"])
    with pytest.raises(BadInput, match="given one, "):
        sweep(open_ended, samples=4)
    with pytest.raises(BadInput, match=r"jaxcomp\.uniform\(0\.1, 0\.16\)"):
        sweep(load("mayekawa-wbhe"), {"mechanism.bore": (0.1, 0.16)}, samples=4)


def test_a_problem_shows_its_variables_ranges_and_quantities():
    made = problem(load("mayekawa-wbhe"), {"bore_at_displacement": (0.1, 0.16)}, ["motor_power"])
    lines = [
        "Problem",
        "  variable  bore_at_displacement, 100 mm to 160 mm",
        "  quantity  motor_power [W]",
    ]
    assert repr(made).splitlines() == lines
