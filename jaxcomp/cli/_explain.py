"""`jaxcomp explain`: one part of a machine file, with all that its section may hold."""

from typing import Annotated

import typer

from ._errors import reports_errors
from ._options import AsJson


@reports_errors
def explain(
    part: Annotated[
        str | None,
        typer.Argument(help="Type of a part, or name of a section; all types if left out."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Explain a part of a machine file: its entries, units, bounds, defaults, and where it may stand.

    Example: [bold]jaxcomp explain slider-crank[/bold], [bold]jaxcomp explain film[/bold]
    """
    from ..scene import explained
    from ._explain_result import explained_lines, parts_table
    from ._output import show_results

    if part is None:
        table, rows = parts_table()
        show_results({"parts": rows}, [table], as_json, None)
        return
    found = explained(part)
    shown = [one._asdict() | {"entries": [e._asdict() for e in one.entries]} for one in found]
    lines = [] if as_json else [line for one in found for line in explained_lines(one)]
    show_results({"word": part, "parts": shown}, lines, as_json, None)
