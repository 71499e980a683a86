"""Stress of kept programs: many starts of a command, killed, two at once, with cut and foreign entries.

    python tests/benchmarks/starts.py --starts 200 --machine r600a-8cc
    python tests/benchmarks/starts.py --starts 100 --machine r600a-8cc --only interrupted
    python tests/benchmarks/starts.py --interrupts 100

Every start that ends must print the numbers of the first one, to the last bit. What is done to it is
drawn at random: nothing, a kill or an interrupt at any time, a second start at the same moment, entries
that are cut or overwritten before, a disk on which nothing can be written, a folder that cannot be read.

`--interrupts` sends one to each of several commands in turn, between 0.02 s after its start and its
end, with and without kept programs. It must end within three seconds with status 130 and one line; only
what comes in Python's own start, before the first line of the program, or in the last of its end, where
it hears no more signals, ends as Python has it. A sweep that was interrupted must go on to the numbers
of one that was not.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

# Shares of what is done to a start.
TRIALS = {"nothing": 5, "killed": 4, "interrupted": 2, "two": 3, "cut": 3, "foreign": 2,
          "full disk": 2, "locked": 1}  # fmt: skip
_SLOWEST = 300.0  # [s] a start that takes longer hangs
_LONGEST = 3.0  # [s] from an interrupt to the end
_SWEEP = (
    "sweep",
    "mayekawa-wbhe",
    "--over",
    "bore_at_displacement=100mm:150mm:20000",
    "--out",
    "results",
    "--json",
)
# What is interrupted.
COMMANDS = [
    ("run", "mayekawa-wbhe", "--out", "results"),
    ("sensitivity", "mayekawa-wbhe", "--out", "results"),
    _SWEEP,
    ("respond", "hermetic-68cc", "--json"),
]


def begun(
    *words: str, programs: Path, least_file: int | None = None, within: Path | None = None
) -> subprocess.Popen:
    """A start of a command that keeps its programs in a folder."""

    def limited():
        # a shell lets what it starts in the background ignore interrupts
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if least_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (least_file, least_file))

    environment = {**os.environ, "JAXCOMP_CACHE": str(programs), "JAXCOMP_WAITS": "off"}
    command = [sys.executable, "-m", "jaxcomp", *words]
    return subprocess.Popen(command, env=environment, preexec_fn=limited, cwd=within,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip


def ended(process: subprocess.Popen) -> tuple[int, str, str]:
    """Exit code, what it printed, and the end of its errors."""
    try:
        out, error = process.communicate(timeout=_SLOWEST)
    except subprocess.TimeoutExpired:
        process.kill()
        return 124, "", "hangs"
    return process.returncode, out, error[-400:]


def spoilt(folder: Path, chance: random.Random, how: str) -> None:
    """Cut or overwrite some of the entries."""
    for path in folder.rglob("*.program"):
        if chance.random() < 0.5:
            content = path.read_bytes()
            cut = chance.randrange(len(content) + 1)
            other = chance.randbytes(len(content) - cut) if how == "foreign" else b""
            path.write_bytes(content[:cut] + other)


def interrupts(count: int, chance: random.Random) -> bool:
    """Interrupt the commands in turn, print how they ended, and whether all ended as they must."""
    found: Counter[tuple[str, str]] = Counter()
    slowest = 0.0
    with tempfile.TemporaryDirectory() as place:
        within, programs = Path(place), Path(place) / "programs"
        whole, results, swept = {}, within / "results", ""
        for words in COMMANDS:
            for start in ("first", "second"):
                shutil.rmtree(results, ignore_errors=True)
                begin = time.perf_counter()
                code, out, error = ended(begun(*words, programs=programs, within=within))
                assert code == 0, error
                whole[words, start] = time.perf_counter() - begin
                swept = out if words == _SWEEP else swept
        kept = within / "kept"
        programs.rename(kept)
        for number in range(count):
            words = COMMANDS[number % len(COMMANDS)]
            start = ("first", "second")[number // len(COMMANDS) % 2]
            shutil.rmtree(programs, ignore_errors=True)
            shutil.rmtree(results, ignore_errors=True)
            if start == "second":
                shutil.copytree(kept, programs)
            process = begun(*words, programs=programs, within=within)
            time.sleep(chance.uniform(0.02, whole[words, start]))
            tasks = Path(f"/proc/{process.pid}/task")
            early = tasks.exists() and len([*tasks.iterdir()]) < 2
            process.send_signal(signal.SIGINT)
            begin = time.perf_counter()
            code, _, error = ended(process)
            took = time.perf_counter() - begin
            if code == 0:
                outcome = "had ended before"
            elif code == 130 and error.startswith("stopped") and error.count("\n") == 1:
                outcome = "stopped" if took < _LONGEST else "STOPPED LATE"
                slowest = max(slowest, took)
            elif early and code in (130, -signal.SIGINT):
                outcome = "in Python's own start"
            elif code == -signal.SIGINT and not error:
                outcome = "ended silently while Python put itself away"
            else:
                outcome = f"EXIT CODE {code}: {error}"
            found[words[0], outcome] += 1
            if words == _SWEEP and outcome == "stopped" and not number % 3:
                code, out, error = ended(begun(*words, programs=kept, within=within))
                same = code == 0 and out == swept
                found["sweep", "went on" if same else f"WENT ON WRONG: {error}"] += 1
    for (command, outcome), times in sorted(found.items()):
        print(f"{times:4d}  {command:12s}  {outcome}")
    print(f"longest from the interrupt to the end {slowest:.2f} s")
    return not any(outcome[:3].isupper() for _, outcome in found)


def main() -> None:
    """Print what happened, and end with status 1 if any start was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--machine", default="mayekawa-wbhe")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TRIALS, help="this alone, with programs compiled anew")
    parser.add_argument("--interrupts", type=int, default=0, help="interrupts of several commands")
    asked = parser.parse_args()
    chance = random.Random(asked.seed)
    if asked.interrupts:
        sys.exit(not interrupts(asked.interrupts, chance))
    command = ("run", asked.machine, "--json")
    found: Counter[tuple[str, str]] = Counter()
    seconds: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "programs"
        start = time.perf_counter()
        code, right, error = ended(begun(*command, programs=folder))
        assert code == 0, error
        whole = time.perf_counter() - start
        wanted = json.loads(right)
        for number in range(asked.starts):
            (trial,) = chance.choices([*TRIALS], [*TRIALS.values()])
            if asked.only:
                trial = asked.only
                shutil.rmtree(folder, ignore_errors=True)
            if trial in ("cut", "foreign"):
                spoilt(folder, chance, trial)
            if trial == "locked":
                folder.chmod(0o000)
            start = time.perf_counter()
            size = 0 if trial == "full disk" else None
            processes = [
                begun(*command, programs=folder, least_file=size)
                for _ in range(1 + (trial == "two"))
            ]
            if trial in ("killed", "interrupted"):
                time.sleep(chance.uniform(0.1, whole))
                processes[0].send_signal(signal.SIGKILL if trial == "killed" else signal.SIGINT)
                start = time.perf_counter()
            for process in processes:
                code, out, error = ended(process)
                if trial == "killed" and code == -signal.SIGKILL:
                    outcome = "ended"
                elif trial == "interrupted" and code in (130, -signal.SIGINT):
                    late = time.perf_counter() - start > _LONGEST
                    outcome = "ENDED LATE" if late else "ended"
                elif code:
                    outcome = f"exit code {code}: {error}"
                else:
                    outcome = "right" if json.loads(out) == wanted else "WRONG NUMBERS"
                found[trial, outcome] += 1
            seconds[trial].append(time.perf_counter() - start)
            if folder.exists():
                folder.chmod(0o700)
            if number % 20 == 19:
                print(f"{number + 1} starts", file=sys.stderr)
    for (trial, outcome), count in sorted(found.items()):
        print(f"{count:4d}  {trial:12s}  {outcome}")
    for trial, times in sorted(seconds.items()):
        ordered = sorted(times)
        print(f"{trial:12s}  median {ordered[len(times) // 2]:.1f} s, longest {ordered[-1]:.1f} s")
    sys.exit(any(outcome not in ("right", "ended") for _, outcome in found))


if __name__ == "__main__":
    main()
