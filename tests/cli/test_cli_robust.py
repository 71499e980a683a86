"""What the command line does with names made of markup, narrow encodings, interrupts and full disks."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from helpers import COMMANDS, read_json
from typer.testing import CliRunner

import jaxcomp.__main__ as program
from jaxcomp.cli import app
from jaxcomp.cli._output import result_files
from jaxcomp.cli._written import RECORD, write_results_of_command
from jaxcomp.scene import load
from jaxcomp.scene.measurements import read_measurements


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def started(*command, **environment):
    """The result of a command in a process of its own."""
    return subprocess.run(
        [sys.executable, *map(str, command)],
        capture_output=True,
        env=os.environ | environment,
        timeout=120,
    )


def renamed(path: Path, name: str) -> Path:
    """The bundled rotor with another name and description."""
    text = load("hermetic-68cc").text
    text = f"name = {json.dumps(name)}\n{text[text.index('description') :]}"
    path.write_text(text.replace('description = "', f"description = {json.dumps(name)[:-1]} ", 1))
    return path


@pytest.mark.parametrize("name", ["[/x]", "[bold]x", "[red", "\\[/x]"])
def test_names_are_no_markup(tmp_path, name):
    scene = renamed(tmp_path / "m.toml", name)
    for command in ("list", "check"):
        shown = run(command, scene)
        assert shown.exit_code == 0
        assert f"{name}: {name}" in shown.stdout


def test_escape_sequences_do_not_reach_the_terminal(tmp_path):
    scene = renamed(tmp_path / "m.toml", "\x1b[2J")
    csv = tmp_path / "m.csv"
    csv.write_text("run,target,speed [rpm],amplitude [um],phase [deg],trial [g mm],\x1b[2J\n")
    for words in (
        ("list", scene),
        ("check", scene),
        ("run", "no\x1b[2Jmachine"),
        ("run", "mayekawa-wbhe", "--set", "motor.\x1b[2J=\x1b[2J"),
        ("balance", "--measured", csv),
    ):
        shown = run(*words)
        assert shown.exit_code == 2
        assert "\x1b" not in shown.output
        assert "\\x1b[2J" in shown.output


@pytest.mark.parametrize("encoding", ["ascii", pytest.param("latin-1", marks=pytest.mark.slow)])
def test_a_terminal_need_not_be_utf_8(tmp_path, encoding):
    scene = str(renamed(tmp_path / "m.toml", "Verdichter Ω µ"))
    lines = [({}, ["check", scene, "--json"]), ({}, ["list", scene]), ({}, ["list", "Ωmega"])]
    shown = started("-c", COMMANDS, json.dumps(lines), PYTHONIOENCODING=encoding)
    assert (shown.returncode, b"Traceback" in shown.stderr) == (0, False), shown.stderr
    checked = shown.stdout.partition(b"ended with")[0]
    # every letter survives in JSON
    assert read_json(checked.decode(encoding))["machine"] == "Verdichter Ω µ"
    assert re.findall(rb"ended with (\d)", shown.stdout) == [b"0", b"0", b"2"]


def test_importing_the_package_switches_to_64_bits_at_once():
    code = "import jaxcomp, jax.numpy as jnp; print(jnp.ones(1).dtype)"
    assert started("-c", code, JAX_ENABLE_X64="0").stdout == b"float64\n"
    assert started("-c", f"import jax; {code}", JAX_ENABLE_X64="0").stdout == b"float64\n"
    kept = started("-c", code, JAX_ENABLE_X64="0", JAXCOMP_X64="0")
    assert kept.stdout == b"float32\n"


def test_a_failure_in_single_precision_says_so():
    code = "from jaxcomp import SolveFailed, Status; print(SolveFailed(Status.not_converged, 'r'))"
    told = started("-c", code, JAXCOMP_X64="0", JAX_ENABLE_X64="0").stdout
    assert b"in single precision: see JAXCOMP_X64; " in told
    assert b"single" not in started("-c", code).stdout


@pytest.fixture
def _interrupts_of_pytest():
    """Signals are heard by pytest again, after the program has run in its process."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    hook = sys.unraisablehook
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)
    signal.set_wakeup_fd(-1)
    sys.unraisablehook = hook


@pytest.mark.usefixtures("_interrupts_of_pytest")
@pytest.mark.parametrize("handler", [signal.default_int_handler, signal.SIG_IGN])
def test_an_interrupt_ends_without_a_traceback(monkeypatch, capfd, handler):
    signal.signal(signal.SIGINT, handler)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxcomp.cli.main", interrupted)
    monkeypatch.setattr("os._exit", sys.exit)
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 130
    assert capfd.readouterr().err == "stopped\n"
    monkeypatch.setattr("jaxcomp.scene.load", interrupted)
    shown = run("run", "mayekawa-wbhe")
    assert (shown.exit_code, shown.stderr) == (130, "stopped\n")


def test_an_interrupted_sweep_says_how_to_go_on(monkeypatch, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxcomp.study.sweep.sweep", interrupted)
    words = ("sweep", "mayekawa-wbhe", "--over", "bore_at_displacement=100mm:150mm:3")
    shown = run(*words)
    assert (shown.exit_code, shown.stderr) == (
        130,
        "stopped; nothing was kept; with --out FOLDER a stopped sweep goes on\n",
    )
    shown = run(*words, "--out", tmp_path)
    assert shown.exit_code == 130
    assert shown.stderr == (
        f"stopped; {tmp_path / 'sweep.zarr'} is kept; go on with the same command\n"
    )


# Interrupts that Python drops (in a callback of the garbage collector) or does not come to (in a program
# of XLA, here in sleeps that go on); the last word was said and a thread goes on.
STUBBORN = {
    "dropped": """
        class Dropping:
            def __del__(self):
                print("begun", flush=True)
                time.sleep(30)
        Dropping()
        time.sleep(30)
    """,
    "caught": """
        print("begun", flush=True)
        while True:
            try:
                time.sleep(30)
            except BaseException:
                pass
    """,
    "thread": """
        threading.Thread(target=time.sleep, args=(30,)).start()
        print("begun", flush=True)
        time.sleep(30)
    """,
}


@contextmanager
def interruptible(command, **environment):
    """A process that hears interrupts, and ends with the test whatever it does."""
    # A process ignores the interrupts that its parent ignores, as the jobs that a shell has in the
    # background do.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        running = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=os.environ | environment,
        )
    finally:
        signal.signal(signal.SIGINT, before)
    try:
        yield running
    finally:
        running.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("kind", STUBBORN)
def test_an_interrupt_ends_what_does_not_stop(kind, number):
    code = "import threading, time\nfrom jaxcomp._core.interrupts import ends_when_interrupted\n"
    code += "with ends_when_interrupted():" + STUBBORN[kind]
    with interruptible([sys.executable, "-c", code]) as running:
        assert running.stdout is not None
        running.stdout.readline()
        running.send_signal(number)
        _, told = running.communicate(timeout=20)  # of the 30 s that it would take by itself
    assert (running.returncode, told) == (128 + number, b"stopped\n")


# Modules before whose import an interrupt comes; NumPy's C extension imports the third half way through.
IMPORTED = ["numpy", "numpy._core._multiarray_umath", "numpy.dtypes", "jax._src.core", "typer"]
INTERRUPTING = """
import os, signal, sys, threading

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == os.environ["INTERRUPTED_AT"]:
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
"""


@pytest.mark.parametrize("name", IMPORTED)
def test_an_interrupt_ends_an_import(tmp_path, name):
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTING)
    ways = [str(tmp_path), *sys.path]
    environment = {"INTERRUPTED_AT": name, "PYTHONPATH": os.pathsep.join(filter(None, ways))}
    command = [sys.executable, "-m", "jaxcomp", "run", "mayekawa-wbhe"]
    with interruptible(command, **environment) as running:
        told = running.communicate(timeout=60)
    assert (running.returncode, *told) == (130, b"", b"stopped\n")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads cannot be counted here")
@pytest.mark.parametrize("after", [0.0, 0.3, 0.6, 1.0, 2.0, 4.0, 15.0])
def test_a_real_interrupt_at_any_time(tmp_path, after):
    words = (
        "sweep",
        "mayekawa-wbhe",
        "--over",
        "bore_at_displacement=100mm:150mm:100000",
        "--out",
        tmp_path,
    )
    command = [sys.executable, "-m", "jaxcomp", *map(str, words)]
    with interruptible(command) as running:
        # Python itself starts for 50 ms, or a second on a busy machine, in which an interrupt is its
        # own affair; then there is the thread that watches for one
        while len(os.listdir(f"/proc/{running.pid}/task")) < 2:
            time.sleep(0.01)
        time.sleep(after)
        running.send_signal(signal.SIGINT)
        # 1.5 s after which it is ended, and as long again for other work of the processor
        _, told = running.communicate(timeout=3)
    assert running.returncode == 130, told
    assert b"Traceback" not in told
    assert b"stopped" in told


def test_a_full_disk_leaves_no_cut_report(tmp_path):
    figure = plt.figure(figsize=(1, 1))
    result = {"machine": "m", "number": "one"}
    write_results_of_command(tmp_path, result_files("m", {"one": figure}, result), False)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    pictures = {"one.png", "interactive.html"}
    assert set(before) == {*pictures, "result.json", "results.xlsx", "report.html", RECORD}
    longer = result_files("m", {}, result | {"long": "x" * 100})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # no file of more than 2 kB can be written, as little as on a disk with as much left
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(OSError, match=r"results\.xlsx|report\.html|one\.png") as told:
            write_results_of_command(tmp_path, longer, False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        plt.close(figure)
    assert "the file is not written" in str(told.value)
    after = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert after["report.html"] == before["report.html"]
    assert set(after) == set(before)


def test_measured_names_are_no_markup(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text(
        "run,target,speed [rpm],amplitude [um],phase [deg],trial [g mm],angle [deg]\n"
        "initial,[/x],1500,25,8,,\n[/y],[/x],1500,35,-4,100,0\n"
    )
    assert read_measurements(path).planes == ("[/y]",)
    shown = run("balance", "--measured", path)
    assert shown.exit_code == 0
    assert "[/x]" in shown.stdout
    assert "[/y]" in shown.stdout
