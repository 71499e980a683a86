"""Parts and quantities of other packages, which announce their modules as entry points of `jaxcomp`."""

from importlib.metadata import EntryPoint, entry_points

GROUP = "jaxcomp"
_state = {"imported": False}


class ExtensionError(ImportError):
    """A module of another package that cannot be imported, or that takes a name of this one."""


def import_extensions() -> None:
    """Import the modules of the entry-point group `jaxcomp`, once a process.

    Their classes can be named in machine files, and their quantities in studies, afterwards. Reading a
    machine file, `jaxcomp explain`, `jaxcomp list` and the completion of the shell call this.

    Raises:
        ExtensionError: a module that fails to import, with its entry point and package.
    """
    if _state["imported"]:
        return
    _state["imported"] = True  # a module may read a machine file while it is imported
    for entry in entry_points(group=GROUP):
        try:
            entry.load()
        except Exception as error:
            # the next call raises as well, instead of going on without these parts
            _state["imported"] = False
            raise ExtensionError(_problem(entry, error)) from error


def _problem(entry: EntryPoint, error: Exception) -> str:
    package = entry.dist.name if entry.dist else "unknown"
    return (
        f'entry point {entry.name} = "{entry.value}" of package {package} (group {GROUP}) cannot be '
        f"imported: {type(error).__name__}: {error}. Mend the module, or uninstall {package}."
    )
