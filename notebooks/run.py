"""Execute the notebooks in place: `python notebooks/run.py [NAME ...]` (all of them by default).

With `--check` nothing is written; an error in any cell, or a notebook of 300 kB or more, fails.
"""

import os
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from jaxcomp.cli._start import quick_compiles

HERE = Path(__file__).parent
LIMIT = 300_000  # bytes; pictures stay small so that the repository does


def main(arguments: list[str]) -> int:
    os.environ["JAXCOMP_WAITS"] = "off"  # how long compiling takes differs between machines
    quick_compiles()  # the kernels inherit both
    check = "--check" in arguments
    names = [a for a in arguments if not a.startswith("--")]
    paths = [HERE / f"{n.removesuffix('.ipynb')}.ipynb" for n in names] or sorted(
        HERE.glob("*.ipynb")
    )
    too_large = []
    for path in paths:
        started = time.perf_counter()
        notebook = nbformat.read(path, as_version=4)
        NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": HERE}}).execute()
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)  # time stamps change at every run
        text = nbformat.writes(notebook)
        if not check:
            path.write_text(text)
        if len(text.encode()) >= LIMIT:
            too_large.append(path.name)
        print(
            f"{path.name}: ran in {time.perf_counter() - started:.0f} s, {len(text) / 1e3:.0f} kB"
        )
    if too_large:
        print("300 kB or more:", ", ".join(too_large))
    return bool(too_large)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
