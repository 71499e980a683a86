"""Tables of designs beside each other, as `jaxcomp compare` and `jaxcomp optimise` show them."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from .._shown import Shown, shown
from ._tables import _table


def beside_table(
    rows: Sequence[Mapping[str, Any]], labels: Sequence[str], title: str | None = None
) -> Table:
    """Losses, forces and dimensions of designs, and the change of each against the first.

    Args:
        rows: with `name`, `unit` and the `values` of all designs, `None` where one has none.
        labels: of the designs.
        title: above the table.
    """
    first, *others = map(escape, labels)
    heads = [head for label in others for head in (label, "Change")]
    table = _table(title, "Losses, forces, dimensions", first, *heads, numbers=True)
    for one in rows:
        before, *after = one["values"]
        given = [value for value in one["values"] if value is not None]
        look = shown(one["name"], one["unit"], given)
        cells = [text for x in after for text in (_text(look, x), _change(look, before, x))]
        table.add_row(escape(look.words), _text(look, before), *cells)
    return table


def _text(look: Shown, value: float | None) -> str:
    return "" if value is None else look.text(value)


def _change(look: Shown, before: float | None, after: float | None) -> str:
    if before is None or after is None:
        return ""
    if look.unit == "%":
        return f"{100 * (after - before):+.2f} points"
    return f"{100 * (after / before - 1):+.2f} %" if before else ""
