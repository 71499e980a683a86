"""Measure what first starts of usual commands compile, for `jaxcomp/_core/usual_waits.json`.

`python tests/tools/usual_waits.py` runs each command with nothing kept (some twenty minutes on two idle
cores) and writes the file anew; with words such as `run map` it replaces the rows of these commands.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from jaxcomp._core.waits import FILE, USUAL

CRANK = "mayekawa-wbhe"
VALVES = "r290-6cc"
ROTOR = "hermetic-68cc"
BORES = "--over bore_at_displacement=110mm:140mm:9"
COMMANDS = (
    f"check {VALVES}",
    f"run {CRANK}",
    f"run {CRANK} --out out",
    f"run {VALVES}",
    f"run {VALVES} --out out",
    f"run {ROTOR} --out out",
    f"sensitivity {CRANK} --quantity mechanical_efficiency",
    f"sweep {CRANK} {BORES}",
    f"sweep {CRANK} {BORES} --out out",
    f"optimise {CRANK} --variable bore_at_displacement=110mm:140mm",
    f"tolerance {CRANK} --vary mechanism.bore=+-0.1mm --samples 256",
    f"modes {ROTOR} --speeds 600rpm:6000rpm:40 --out out",
    f"respond {ROTOR} --speed 3000rpm --speeds 300rpm:6000rpm:200 --out out",
    f"balance {ROTOR} --speeds 3000rpm,3600rpm --out out",
    f"map {VALVES} --evaporating=-30:-10:5 --condensing=35:55:5",
    f"map {VALVES} --evaporating=-30:-10:5 --condensing=35:55:5 --out out",
    f"sensitivity {VALVES} --quantity cop",
    f"sweep {VALVES} --over gas.suction_valve.stop=0.8mm:2.4mm:9 --quantity cop --out out",
)


def measured(command: str) -> list:
    """Rows that a command leaves behind, run in a folder of its own with nothing kept."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {
            "PYTHONPATH": str(Path(__file__).parents[2]),
            "JAXCOMP_CACHE": f"{folder}/programs",
        }
        begun = time.monotonic()
        worked = _worked()
        subprocess.run(
            [sys.executable, "-m", "jaxcomp", *command.split()],
            cwd=folder,
            env=environment,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        # where others are at work on the same cores, the clock goes on while nothing compiles
        share = min((_worked() - worked) / (time.monotonic() - begun), 1.0)
        file = Path(folder, "programs", FILE)
        # a task without a long program leaves none
        rows = json.loads(file.read_text("utf-8")) if file.exists() else []
        return [[*row[:-1], round(share * row[-1], 1)] for row in rows]


def _worked() -> float:
    """[s] Processor time of all commands so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measure and write row by row, so that a run that is stopped keeps what it has."""
    names = sys.argv[1:]
    rows = []
    if names:
        earlier = json.loads(USUAL.read_text("utf-8"))
        rows = [row for row in earlier if row[0].split()[0] not in names]
    for command in COMMANDS:
        if names and command.split()[0] not in names:
            continue
        for row in measured(command):
            rows.append(row)
            print(command, *row[1:], flush=True)
        lines = ",\n".join(json.dumps(row) for row in rows)
        USUAL.write_text(f"[\n{lines}\n]\n", "utf-8")


if __name__ == "__main__":
    main()
