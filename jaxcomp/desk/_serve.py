"""The server of the desk: a fresh page for every tab of the browser."""

import logging
from typing import Any

import panel as pn
from tornado.websocket import WebSocketClosedError

from .._core.programs import keep_programs
from ..scene import Scene
from ._page import Page

# [s] The same before the browser is opened.
_AT_FIRST = 15.0


def serve(scene: Scene, *, port: int = 0, show: bool = True, threaded: bool = False) -> Any:
    """Serve the desk of a machine on this computer alone, a fresh one for every tab.

    A process that does nothing else, not `threaded`, keeps all programs (`jaxcomp.keep_programs`).

    Args:
        scene: of `jaxcomp.load`.
        port: of the loopback address; a free one if 0.
        show: open a browser.
        threaded: return at once, with the server; otherwise when it is interrupted.
    """
    if not threaded:
        keep_programs()
    pn.extension("tabulator")
    logging.getLogger("asyncio").addFilter(_is_fault)
    # compiles what all pages share; of large machines the gains follow later
    Page(scene, _AT_FIRST)
    return pn.serve(
        {"/": lambda: page(scene)},
        address="127.0.0.1",
        port=port,
        show=show,
        threaded=threaded,
        title=f"jaxcomp desk: {scene.name}",
    )


def _is_fault(record: logging.LogRecord) -> bool:
    """Whether a log record is more than a message that a closed tab no longer took."""
    return not isinstance((record.exc_info or (None, None))[1], WebSocketClosedError)


def page(scene: Scene) -> Any:
    """The desk of a machine, for a server of Panel or the cell of a notebook.

    Args:
        scene: of `jaxcomp.load`.
    """
    return Page(scene).body
