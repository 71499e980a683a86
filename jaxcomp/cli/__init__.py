"""The command line, the program `jaxcomp`."""

from ._app import app as app
from ._app import main as main
