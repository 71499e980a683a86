"""An eighth of the slow tests, which a commit chooses: `python .ci/slow.py COMMIT`.

Every test has a process of its own, two at a time: one that dies or stands still is told and does not
keep the others from running. What eight minutes have no room for is told as well, and is no failure.
"""

import os
import subprocess
import sys
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

PARTS = 8
# derivatives of several cycles that depend on each other compile for three minutes, on slow machines for
# six
TOGETHER, ALONE = 8 * 60, 7 * 60  # [s]
PYTEST = (sys.executable, "-m", "pytest", "-q", "-m", "slow")
# what takes longer than a test may is named, and where a test stands still
OPTIONS = ("--durations=0", "--durations-min=120", "-o", "faulthandler_timeout=300")


def chosen(commit: str) -> list[str]:
    """Slow tests of the commit's part, in an order that changes with the commit."""
    listed = subprocess.run([*PYTEST, "--collect-only"], capture_output=True, text=True)
    if listed.returncode:
        sys.exit(listed.stdout + listed.stderr)
    part, lines = int(commit, 16) % PARTS, listed.stdout.splitlines()
    tests = [one for one in lines if "::" in one and zlib.crc32(one.encode()) % PARTS == part]
    print(f"part {part + 1} of {PARTS}: {len(tests)} tests", flush=True)
    return sorted(tests, key=lambda one: zlib.crc32((commit + one).encode()))


def main(commit: str) -> int:
    """Run them; the exit code."""
    end, wrong, left = time.monotonic() + TOGETHER, [], []
    processors: SimpleQueue = SimpleQueue()
    for one in sorted(os.sched_getaffinity(0))[:2]:
        processors.put(one)
    workers = processors.qsize()

    def run(test: str) -> None:
        seconds = min(ALONE, end - time.monotonic())
        if seconds < 10:
            left.append(test)
            return
        processor = processors.get()
        command = ("taskset", "-c", str(processor), *PYTEST, *OPTIONS)
        running = subprocess.Popen(
            [*command, test], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            told, _ = running.communicate(timeout=seconds)
            code = running.returncode
            ended = f"died by signal {-code}" if code < 0 else told.splitlines()[-1]
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, 9)
            told, _ = running.communicate()
            code = 0 if seconds < ALONE else 1
            ended = f"stopped after {seconds:.0f} s"
            if not code:
                left.append(test)
        processors.put(processor)
        if code:
            wrong.append(test)
        print(
            f"{'FAILED ' if code else ''}{test}: {ended}\n{told if code else ''}",
            end="",
            flush=True,
        )

    tests = chosen(commit)
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, tests))
    if left:
        print(f"no time was left for {len(left)}:", ", ".join(left))
    if wrong:
        print("failed:", ", ".join(wrong))
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
