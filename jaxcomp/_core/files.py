"""Files of users, from which reading ends."""

import errno
from pathlib import Path


def regular(path) -> Path:
    """A path, unless it leads to a pipe or a device, of which reading may never end.

    Raises:
        OSError: it does.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "It is a pipe or a device, not a file", str(path))
    return path
