"""No test ends the run of the others, whatever it does to its process."""

import os
import shlex
import subprocess
import sys
from collections import OrderedDict
from pathlib import Path

import pytest

CONFTEST = """
import pytest
from interrupts import Interrupts

def pytest_configure(config):
    config.pluginmanager.register(Interrupts())

def pytest_xdist_make_scheduler(config, log):
    from distribution import SchedulingPastCrashes
    return SchedulingPastCrashes(config, log)
"""
GOOD = "import pytest\n@pytest.mark.parametrize('n', range(3))\ndef test_good(n): pass\n"
FILES = {
    "test_interrupt.py": GOOD + "def test_bad(): raise KeyboardInterrupt\ndef test_after(): pass\n",
    "test_killed.py": GOOD
    + "import os\ndef test_bad(): os.kill(os.getpid(), 9)\ndef test_after(): pass\n",
    # the last of its file, which leaves a worker with nothing but files that are done
    "test_left.py": GOOD + "import os\ndef test_bad(): os._exit(0)\n",
    "test_only.py": "import os\ndef test_bad(): os._exit(1)\n",
    "test_good.py": GOOD,
    "test_single.py": "def test_single(): pass\n",
}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_workers_that_die_do_not_end_the_others_run(tmp_path, workers):
    pytest.importorskip("xdist")
    (tmp_path / "conftest.py").write_text(CONFTEST)
    # quoted, as the folder may have a blank in its name
    tests = shlex.quote(str(Path(__file__).parents[1]))
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {tests}\n")
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    words = ["-m", "pytest", "-q", "-n", workers, "--dist", "loadfile", "-p", "no:cacheprovider"]
    # the only plugin that is needed: every worker that dies is replaced by one that imports them all
    words += ["-p", "xdist.plugin"]
    told = subprocess.run(
        [sys.executable, *words],
        cwd=tmp_path,
        env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert told.returncode == 1
    assert "4 failed, 15 passed" in told.stdout


class Worker:
    """A worker that remembers what it was told."""

    shutting_down = dead = False

    def __init__(self):
        self.told = []

    def send_runtest_some(self, places):
        if self.dead:
            raise OSError("cannot send (already closed?)")
        self.told += places

    def shutdown(self):
        self.shutting_down = True


def test_a_worker_that_dies_while_another_takes_the_place_of_one_loses_nothing():
    """The one in the place of the first is still collecting when the second dies."""
    distribution = pytest.importorskip("distribution")
    files = {name: {f"{name}::{test}": False for test in "abc"} for name in ("one.py", "two.py")}
    tests = [test for file in files.values() for test in file]
    scheduler = distribution.SchedulingPastCrashes.__new__(distribution.SchedulingPastCrashes)
    dying, collecting = Worker(), Worker()
    scheduler.workqueue = OrderedDict({"two.py": files["two.py"]})
    scheduler.assigned_work = {dying: {"one.py": files["one.py"]}, collecting: {}}
    scheduler.registered_collections = {dying: tests}
    assert scheduler.remove_node(dying) == "one.py::a"
    assert collecting.told == []
    assert not collecting.shutting_down
    assert list(scheduler.workqueue) == ["two.py", "one.py"]
    scheduler.registered_collections[collecting] = tests
    collecting.dead = True  # and nobody knows yet
    scheduler._reschedule(collecting)
    assert list(scheduler.workqueue) == ["two.py", "one.py"]
    assert scheduler.assigned_work[collecting] == {}
    collecting.dead = False
    scheduler._reschedule(collecting)
    assert [tests[place] for place in collecting.told] == tests[3:]
