"""What long work has so far stays there when it is interrupted."""

import csv
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import jaxcomp as jc
from jaxcomp._core import interrupts as _interrupts
from jaxcomp._core import registry
from jaxcomp.cli import _output
from jaxcomp.study.tolerance import within


def read(file):
    with open(file) as lines:
        return list(csv.DictReader(lines))


def test_pieces_are_in_a_file_until_the_work_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(_output, "_EVERY", 0.0)
    partial = _output.Partial(tmp_path / "out", "designs")
    partial.keep({"bore [m]": [0.12]})
    partial.keep({"bore [m]": [0.12, 0.13], "solved": [True, False]})
    file = tmp_path / "out" / "partial.csv"
    assert read(file)[1] == {"bore [m]": "0.13", "solved": "False"}
    assert _interrupts.say_stopped() == f"stopped after 2 designs; they are in {file}"
    partial.finish()
    assert not file.exists()
    assert _interrupts.say_stopped() == "stopped"


def test_without_a_folder_the_word_says_how_to_keep_them():
    partial = _output.Partial(None, "machines")
    partial.keep({"bore": np.arange(2000)})
    words = "stopped after 2,000 machines; with --out FOLDER they are kept"
    assert _interrupts.say_stopped() == words


def test_studies_hand_out_what_they_have(monkeypatch):
    # both quantities follow from sizes alone: what is handed out is the same, and no orbit is compiled
    monkeypatch.setattr(registry, "_registered", dict(registry._registered))
    jc.register_quantity(
        "piston_area", lambda r: r.assembly.compressor.mechanism.piston_area, needs=("compressor",)
    )
    scene, designs, machines = jc.load("mayekawa-wbhe"), [], []
    made = jc.problem(scene, {"bore_at_displacement": (0.12, 0.14)}, ["swept_volume"])

    def keep(problem, points, found):
        designs.append(dict.fromkeys(one.name for one in problem.columns(points, found.values)))
        assert len(points) == len(found.values)

    bounds = {"piston_area": (0.0, 1e6)}
    options = {"samples": 4, "starts": 1, "max_steps": 3, "keep": keep}
    jc.optimise(made, maximise=True, constraints=bounds, **options)
    assert len(designs) >= 2
    # a quantity that only a constraint asks for is a column like the others
    assert all(list(one) == ["bore_at_displacement", "swept_volume", *bounds] for one in designs)
    jc.tolerance(
        made, {"bore_at_displacement": within(1e-5)}, samples=32, progress=False,
        keep=lambda *rows: machines.append([len(one) for one in rows]),
    )  # fmt: skip
    assert machines[-1] == [32, 32, 32]


@pytest.mark.slow  # a search that runs until it is stopped
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for children")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_search_leaves_its_designs(tmp_path, number):
    out = tmp_path / "out"
    words = [
        "optimise",
        "mayekawa-wbhe",
        "--variable",
        "bore_at_displacement=100mm:160mm",
        "--samples",
        "100000",
    ]
    # started to hear interrupts, also where the tests ignore them
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    program = subprocess.Popen(
        [sys.executable, "-m", "jaxcomp", *words, "--out", str(out)],
        stderr=subprocess.PIPE, text=True, env=os.environ | {"JAXCOMP_WAITS": "off"},
    )  # fmt: skip
    signal.signal(signal.SIGINT, handler)
    until = time.monotonic() + 120
    while not (out / "partial.csv").exists() and time.monotonic() < until:
        time.sleep(0.1)
    program.send_signal(number)
    _, said = program.communicate(timeout=20)
    assert program.returncode == 128 + number
    assert f"they are in {out / 'partial.csv'}" in said
    assert "Traceback" not in said
    rows = read(out / "partial.csv")
    assert rows
    assert all(0.1 <= float(row["bore [m]"]) <= 0.16 for row in rows)
