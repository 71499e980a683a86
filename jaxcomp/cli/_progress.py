"""A sign of life on standard error while something takes its time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress(text: str) -> Iterator[None]:
    """Show a spinner with a text, if standard error is a terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(text):
        yield


@contextmanager
def pieces_bar(text: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar over pieces of work, if standard error is a terminal.

    Args:
        text: what is worked on.

    Yields:
        A function to call before each piece, of its name, its number from 0 and how many there are.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda words, number, total: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[piece]}"),
    )
    with Progress(*columns, console=console) as shown:
        task = shown.add_task(text, total=None, piece="")

        def tell(words, number, total):
            shown.update(task, completed=number, total=total, piece=words)

        yield tell
