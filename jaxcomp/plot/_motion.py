"""Moving pictures: a figure, what changes in it from frame to frame, and how it becomes a GIF."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from matplotlib.animation import PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


class Motion(NamedTuple):
    """A picture that moves, and comes back to its beginning.

    Attributes:
        figure: the figure, which shows the first frame.
        show: brings the figure to a frame.
        frames: how many there are.
        rate: [1/s] frames a second.
    """

    figure: Figure
    show: Callable[[int], None]
    frames: int
    rate: int = 20


def gif(motion: Motion, dpi: int = 80) -> bytes:
    """The frames as an endless GIF."""
    FigureCanvasAgg(motion.figure)
    writer = PillowWriter(fps=motion.rate)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "motion.gif"
        with writer.saving(motion.figure, str(file), dpi):
            for frame in range(motion.frames):
                motion.show(frame)
                writer.grab_frame()
        return file.read_bytes()
