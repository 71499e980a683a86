"""No test ends the run of the others, whatever it does to its process."""

import shlex
import subprocess
import sys
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
# with two, xdist itself may stumble over the second worker that dies in the same moment
@pytest.mark.parametrize("workers", ["1"])
def test_workers_that_die_do_not_end_the_others_run(tmp_path, workers):
    pytest.importorskip("xdist")
    (tmp_path / "conftest.py").write_text(CONFTEST)
    # quoted, as the folder may have a blank in its name
    tests = shlex.quote(str(Path(__file__).parents[1]))
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {tests}\n")
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    words = ["-m", "pytest", "-q", "-n", workers, "--dist", "loadfile", "-p", "no:cacheprovider"]
    told = subprocess.run(
        [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert told.returncode == 1
    assert "4 failed, 15 passed" in told.stdout
