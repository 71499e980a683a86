"""Files of users, from which reading ends, and which are written as a whole."""

import errno
from pathlib import Path

from .interrupts import removed_when_stopped


def regular(path) -> Path:
    """A path, unless it leads to a pipe or a device, of which reading may never end.

    Raises:
        OSError: it does.
    """
    path = Path(path)
    # folders pass: to open one raises with a message of its own
    if path.exists() and not path.is_file() and not path.is_dir():
        why = "It is a pipe or a device; write what comes out into a file and name that"
        raise OSError(errno.EINVAL, why, str(path))
    return path


def write_whole(file: str | Path, content: bytes) -> None:
    """Write a file as a whole or not at all: aside, and then renamed.

    What stood under its name stays until then, also where the disk is full or the process is ended.

    Raises:
        OSError: it cannot be written. It names the file.
    """
    file = Path(file)
    # in the same folder, because a file is not renamed from one file system to another
    aside = file.with_name(f".{file.name}.part")
    try:
        with removed_when_stopped(aside):
            aside.write_bytes(content)
            aside.replace(file)
    except OSError as error:
        aside.unlink(missing_ok=True)
        why = f"{error.strerror}; the file is not written"
        raise OSError(error.errno, why, str(file)) from None
