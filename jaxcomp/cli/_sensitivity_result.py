"""What `jaxcomp sensitivity` found, as numbers in SI units and as tables."""

from typing import Any

from rich.markup import escape
from rich.table import Table

from .._shown import shown
from ..design import Sensitivity
from ._tables import _table


def sensitivity_result(found: Sensitivity, machine: str) -> dict[str, Any]:
    """The answer in SI units, the largest influence first. The keys are stable."""
    return {
        "machine": machine,
        "quantities": [
            {
                "name": name,
                "unit": unit,
                "value": float(value),
                "numbers": [
                    {
                        "name": one.number,
                        "words": one.part,
                        "unit": one.unit,
                        "value": one.present,
                        "elasticity": one.elasticity if one.relative else None,
                        "derivative": one.derivative,
                    }
                    for one in found.ranking(name)
                ],
            }
            for name, unit, value in zip(
                found.quantities, found.quantity_units, found.value, strict=True
            )
        ],
    }


def sensitivity_tables(found: Sensitivity, rows: int) -> list[Table]:
    """For each quantity the numbers with the largest influence."""
    tables = []
    for name, unit, value in zip(found.quantities, found.quantity_units, found.value, strict=True):
        look, ranked = shown(name, unit, value), found.ranking(name)
        title = f"{look.words} {look.text(float(value))}: its change with every number"
        table = _table(title, "Number", "Value", "Change", numbers=True)
        for part in (True, False):
            kind = [one for one in ranked if one.relative is part]
            for one in kind[:rows]:
                table.add_row(escape(one.part), one.value, one.change)
            if len(kind) > rows:
                table.add_row(f"and {len(kind) - rows} more with less", "", "")
            table.add_section()
        idle = len(found.numbers) - len(ranked)
        if idle:
            what = "number of the machine has" if idle == 1 else "numbers of the machine have"
            table.caption = f"{idle} other {what} no influence."
            table.caption_justify = "left"
        tables.append(table)
    return tables
