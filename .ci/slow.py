"""An eighth of the slow tests, which a commit chooses: `python .ci/slow.py COMMIT`.

Two processes share them by files: tests of one file use programs that the ones before them compiled. One
that dies or stands still is told and does not keep the others from running, in a further process. What
eight minutes have no room for is told as well, and is no failure.
"""

import os
import re
import signal
import subprocess
import sys
import threading
import time
import zlib

PARTS = 8
# no test takes a minute on a quiet machine of two processors; slow machines may need some
TOGETHER, ALONE = 8 * 60, 7 * 60  # [s]
PYTEST = (sys.executable, "-m", "pytest", "-m", "slow")
SHARED = ("-n", "2", "--dist", "loadfile", "-v")
# as `[gw0] [ 12%] PASSED tests/package/test_readme.py::test_names[a case]`
RESULT = re.compile(r"\[gw\d+\] \[ *\d+%\] (?P<outcome>\w+) (?P<test>.*\S)")


def chosen_tests(commit: str) -> list[str]:
    """Slow tests of the commit's part, in an order that changes with the commit."""
    listing = subprocess.run([*PYTEST, "-q", "--collect-only"], capture_output=True, text=True)
    if listing.returncode:
        sys.exit(listing.stdout + listing.stderr)
    part = int(commit, 16) % PARTS
    names = [line for line in listing.stdout.splitlines() if "::" in line]
    tests = [name for name in names if zlib.crc32(name.encode()) % PARTS == part]
    print(f"part {part + 1} of {PARTS}: {len(tests)} tests", flush=True)
    return sorted(tests, key=lambda name: zlib.crc32((commit + name).encode()))


def main(commit: str) -> int:
    """Run them; the exit code."""
    end = time.monotonic() + TOGETHER
    tests = chosen_tests(commit)
    options = (
        # Python's own watch ends the process of a test that stands still, and tells where it stood
        *("-o", f"faulthandler_timeout={ALONE}", "-o", "faulthandler_exit_on_timeout=true"),
        # what takes longer than a test may is named
        *("--durations=0", "--durations-min=60"),
    )
    running = subprocess.Popen(
        [*PYTEST, *SHARED, *options, *tests],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    # pytest answers an interrupt with the failures so far
    clock = threading.Timer(end - time.monotonic(), running.send_signal, [signal.SIGINT])
    stop = threading.Timer(end - time.monotonic() + 30, os.killpg, [running.pid, signal.SIGKILL])
    clock.start()
    stop.start()
    outcomes = {}
    for line in running.stdout:
        if line.strip() not in tests:  # which begins
            print(line, end="", flush=True)
        if result := RESULT.match(line):
            outcomes.setdefault(result["test"], set()).add(result["outcome"])
    code = running.wait()
    clock.cancel()
    stop.cancel()

    failed = [test for test in outcomes if outcomes[test] & {"FAILED", "ERROR"}]
    left = [test for test in tests if test not in outcomes]
    if left:
        print(f"no time was left for {len(left)}:", ", ".join(left))
    if failed:
        print("failed:", ", ".join(failed))
    interrupted = time.monotonic() > end
    return int(bool(failed) or (code != 0 and not interrupted))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
