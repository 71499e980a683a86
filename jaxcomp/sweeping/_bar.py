r"""How far a sweep is, on standard error."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Advance = Callable[[int, bool], None]


@contextmanager
def bar(total: int, done: int, show: bool) -> Iterator[Advance]:
    """A progress bar with designs per second, if standard error is a terminal.

    Args:
        total: designs in all.
        done: designs that were there before.
        show: whether to show it at all.

    Yields:
        A function of the number of designs that came to be done, and whether this process did them:
        its own alone make the rate.
    """
    if not show:
        yield lambda number, own: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda number, own: None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[rate]}"),
    )
    began, own_done, left = None, 0, total - done
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("Sweeping", total=total, completed=done, rate="(compiling)")

        def advance(number, own):
            nonlocal began, own_done, left
            left -= number
            text = ""
            if began is None:
                began = time.perf_counter()  # the first block was compiled as well
            elif own:
                own_done += number
            if own_done:
                rate = own_done / max(time.perf_counter() - began, 1e-9)
                text = f"{rate:,.0f} designs/s, {_span(left / rate)} left"
            progress.update(task, advance=number, rate=text)

        yield advance


def _span(seconds: float) -> str:
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d}"
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
