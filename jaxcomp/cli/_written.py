"""Folders of results: what a command wrote there it may replace, and nothing else.

A record in the folder has the checksum of every file that a command wrote. A file that is not in it, or
that was changed since, belongs to the user.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from .._core.files import write_whole
from ._start import CommandError

RECORD = ".jaxcomp.json"
# Names that commands write whatever they are asked, for which a folder is looked through before the work.
FIXED_NAMES = (
    "report.html",
    "result.json",
    "interactive.html",
    "results.xlsx",
    "partial.csv",
    "identified.json",
)
_FEW = 4  # files that a message names


def refuse_files_of_user(folder: Path, names: Iterable[str], force: bool) -> None:
    """End the command before it replaces a file that no command wrote.

    Args:
        folder: of the results.
        names: of files that will be written.
        force: whether such files are replaced all the same.

    Raises:
        CommandError: a file that no command wrote, or that was changed since.
    """
    if force:
        return
    written = _record(folder)
    foreign = []
    for name in names:
        file = folder / name
        if file.exists() and written.get(name) != _checksum_of(file):
            foreign.append(name)
    if foreign:
        file_names = ", ".join(foreign[:_FEW])
        if len(foreign) > _FEW:
            file_names += ", ..."
        raise CommandError(
            f"--out {folder}: has {file_names}, which no command wrote, or which was changed since; name "
            "another folder, or add --force to write over it"
        )


def write_results_of_command(folder: Path, contents: Mapping[str, bytes], force: bool) -> None:
    """Write files and record them.

    Args:
        folder: is made if it is missing.
        contents: of the files by their names.
        force: as in `refuse_files_of_user`.

    Raises:
        CommandError: as `refuse_files_of_user`; then nothing is written.
        OSError: a disk that is full, or a folder in which nothing may be written.
    """
    refuse_files_of_user(folder, contents, force)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_whole(folder / name, content)
        # after each file, as the next one may find the disk full
        record = _record(folder) | {name: _checksum(content)}
        write_whole(folder / RECORD, json.dumps(record, indent=1, sort_keys=True).encode())


def _record(folder: Path) -> dict[str, str]:
    """Checksums of the files that commands wrote, by name; none if there is no record to be read."""
    try:
        record = json.loads((folder / RECORD).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(record, dict):
        return {}
    return record


def _checksum_of(file: Path) -> str:
    if not file.is_file():
        return ""
    return _checksum(file.read_bytes())


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
