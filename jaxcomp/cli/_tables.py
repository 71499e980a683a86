"""Tables on the terminal."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from .._registry import registered
from .._shown import RPM, behind, shown
from ..scene import Bundled, Row, Scene

# Quantities that the other tables of a run have.
_IN_OTHER_TABLES = ("swept_volume", "joint_margin", "peak_shaking_force", "peak_shaking_moment")
# Characters of a value as it was given; JSON has all of it.
_LONGEST = 120


def machine_table(machines: Iterable[Bundled]) -> Table:
    """The bundled machines."""
    table = _table("Bundled machines", "Name", "Description")
    table.columns[0].no_wrap = True
    for machine in machines:
        table.add_row(f"[bold]{escape(machine.name)}[/bold]", escape(machine.description))
    return table


def fluid_table(fluids: Iterable[dict[str, Any]]) -> Table:
    """The real gases of the library with the publications of their equations of state."""
    table = _table("Fluids", "Name", "What it is", "Equation of state")
    table.columns[0].no_wrap = True
    for fluid in fluids:
        texts = (fluid["description"], fluid["source"])
        table.add_row(f"[bold]{fluid['name']}[/bold]", *map(escape, texts))
    return table


def value_table(scene: Scene, rows: Sequence[Row]) -> Table:
    """Every value of a scene with its source."""
    title = escape(f"{scene.name}: {scene.description}")
    table = _table(title, "Value", "Given", "Source", "Meaning")
    table.columns[0].no_wrap = True
    for row in rows:
        given = row.given if row.given is not None else f"{row.value} {row.unit}".strip()
        given = str(given)
        if len(given) > _LONGEST:
            given = f"{given[: _LONGEST // 2]} ... {given[-_LONGEST // 2 :]}"
        table.add_row(*(escape(str(text)) for text in (row.path, given, row.source, row.doc)))
    return table


def result_tables(scene: Scene, result: dict[str, Any]) -> list[Table | str]:
    """Efficiency and power, losses, joint forces, evidence."""
    return [
        _summary(scene, result),
        *(f"[yellow]Note:[/yellow] {escape(remark)}" for remark in result["remarks"]),
        _losses(result),
        _forces(result),
        _evidence(result),
        *([_verification(result)] if "verification" in result else []),
    ]


def _summary(scene: Scene, result: dict[str, Any]) -> Table:
    changes = [f"{k} = {v}" for k, v in {**result["set"], **result["design"]}.items()]
    title = f"{scene.name}" + (f" with {', '.join(changes)}" if changes else "")
    table = _table(escape(title), "Periodic state", "", "")
    bore = getattr(scene.as_compressor().mechanism, "bore", None)
    if bore is not None:
        size = f"{float(bore) * 1e3:.4g} x {result['stroke'] * 1e3:.4g} mm"
        volume = shown("", "m^3", result["swept_volume"]).text(result["swept_volume"])
        table.add_row("Bore x stroke", size, f"{volume} swept")
    low, high = (f"{RPM * result[f'{end}_speed']:.5g}" for end in ("lowest", "highest"))
    notes = {
        "mean_speed": f"{result['mean_speed']:.5g} rad/s",
        "speed_fluctuation": f"{low} to {high} rpm",
    }
    meaningless = any("no efficiency" in remark for remark in result["remarks"])
    for one in registered():
        if one.name not in result or one.name in _IN_OTHER_TABLES:
            continue
        value, note = result[one.name], notes.get(one.name, one.doc.rstrip("."))
        look = shown(
            one.name, one.unit, [value, result["motor_power"]] if one.unit == "W" else value
        )
        text = f"{100 * value:.2f} %" if look.unit == "%" else look.text(value)
        if one.unit == "W":
            text, note = look.text(value, 4), f"{value * result['period']:.5g} J per revolution"
        if one.name == "mechanical_efficiency":
            text = "[bold]none" if meaningless else f"[bold]{text}"
        table.add_row(
            f"[bold]{look.words}" if "[bold]" in text else escape(look.words), text, escape(note)
        )
    return table


def _losses(result: dict[str, Any]) -> Table:
    names = ("Friction loss", "J per revolution", "W", "Share of losses", "Of motor work")
    table = _table(None, *names, numbers=True)
    motor = result["motor_work"]
    for name, loss in sorted(result["losses"].items(), key=lambda item: -item[1]):
        table.add_row(
            _words(name),
            f"{loss:.4g}",
            f"{result['loss_power'][name]:.4g}",
            f"{100 * result['loss_share'][name]:.1f} %",
            f"{100 * loss / motor:.2f} %" if motor else "",
        )
    total = sum(result["losses"].values())
    table.add_section()
    table.add_row(
        "Total",
        f"{total:.4g}",
        f"{result['friction_power']:.4g}",
        "100.0 %" if total else "",
        f"{100 * total / motor:.2f} %" if motor else "",
    )
    return table


def _forces(result: dict[str, Any]) -> Table:
    large = max(result["peak_forces"].values(), default=0.0) >= 1e3
    unit, scale = ("kN", 1e3) if large else ("N", 1.0)
    table = _table(None, "Joint force", f"Mean, {unit}", f"Peak, {unit}", numbers=True)
    for name, peak in result["peak_forces"].items():
        mean = result["mean_forces"][name]
        table.add_row(_words(name), f"{mean / scale:.4g}", f"{peak / scale:.4g}")
    table.add_section()
    table.add_row("Shaking force", "", f"{result['peak_shaking_force'] / scale:.4g}")
    return table


def _evidence(result: dict[str, Any]) -> Table:
    table = _table(None, "Evidence", "", "")
    table.add_row("Solver", result["solver"], f"tolerance {result['tolerance']:.2g}")
    table.add_row("Iterations", str(result["iterations"]), result["status"])
    table.add_row("Residual", f"{result['residual']:.1e}", "periodicity or collocation equations")
    resolution = "of the speed; the error of the fluctuation is smaller"
    table.add_row("Resolution", f"{result['resolution']:.1e}", resolution)
    closure = f"{result['energy_residual']:.1e}"
    table.add_row("Energy closure", closure, "motor work that is neither gas work nor loss")
    table.add_row("Joint margin", f"{result['joint_margin']:.4f}", "1 without friction, locks at 0")
    return table


def _verification(result: dict[str, Any]) -> Table:
    """Errors that the independent march of a revolution found, each beside its value."""
    march = result["verification"]
    names = ("Independent march of a revolution", "Value", "Error", "Relative")
    table = _table(None, *names, numbers=True)

    def add(name, value, error, unit):
        share = f"{abs(error / value):.1e}" if value else ""
        table.add_row(name, f"{value:.6g} {unit}".strip(), f"{error:.1e} {unit}".strip(), share)

    speed = result["mean_speed"]
    table.add_row(
        "Speed, largest", "", f"{march['speed'] * speed:.1e} rad/s", f"{march['speed']:.1e}"
    )
    add(
        "Mechanical efficiency", result["mechanical_efficiency"], march["mechanical_efficiency"], ""
    )
    for name, error in march["losses"].items():
        add(f"{_words(name)}, loss", result["losses"][name], error, "J")
    for name, error in march["peak_forces"].items():
        add(f"{_words(name)}, peak", result["peak_forces"][name], error, "N")
    return table


def _table(title: str | None, *columns: str, numbers: bool = False) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, title_style="bold", title_justify="left")
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if numbers and place else "left")
    return table


def row_table(
    title: str | None, heads: Sequence[str], rows: Iterable[Sequence[Any]], texts: int = 1
) -> Table:
    """A table from its rows.

    Args:
        title: plain text above it.
        heads: of the columns.
        rows: cells in the markup of rich; `None` and `False` are empty ones. An empty row separates.
        texts: how many columns from the left hold texts; the others are set to the right.
    """
    table = _table(title and escape(title), *heads, numbers=True)
    for column in table.columns[1:texts]:
        column.justify = "left"
    for row in rows:
        if row:
            table.add_row(*("" if cell is None or cell is False else str(cell) for cell in row))
        else:
            table.add_section()
    return table


def column_table(
    title: str | None, columns: Mapping[str, Iterable[Any]], texts: int = 1, keep: bool = False
) -> Table:
    """A table from its columns; columns without any entry are left out.

    Args:
        title, texts: as in `row_table`.
        columns: cells by header.
        keep: whether columns without any entry are kept.
    """
    cells = {head: list(column) for head, column in columns.items()}
    cells = {head: column for head, column in cells.items() if keep or any(column)}
    return row_table(title, tuple(cells), zip(*cells.values(), strict=True), texts)


# A header that is repeated before every row, where rows become lines.
_SHORT = 12


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def fitted(table: Table, width: int) -> Table | str:
    """A table that no terminal of this width cuts: columns wrap between words and never in a number.

    Points of numbers stand below each other. Where even that leaves no room, every row becomes lines
    of their own, one for each column.

    Args:
        table: made by `_table`.
        width: of the terminal, in characters.
    """
    headers = [Text.from_markup(str(column.header)).plain for column in table.columns]
    wide, least = [], []
    for column, header in zip(table.columns, headers, strict=True):
        texts = _pointed(column)
        whole = column.justify == "right"
        pieces = [w for t in texts for w in ([t] if whole else t.split())] + header.split()
        least.append(max(map(cell_len, pieces), default=1))
        wide.append(max(map(cell_len, [*texts, header]), default=1))
    room = width - 2 - 2 * len(wide) - (len(wide) - 1)
    if sum(least) > room:
        return _stacked(table, headers)
    over = sum(wide) - room
    narrow = over > 0
    while over > 0:  # the widest column that can give way does
        place = max((i for i in range(len(wide)) if wide[i] > least[i]), key=lambda i: wide[i])
        wide[place] -= 1
        over -= 1
    for column, size in zip(table.columns, wide, strict=True):
        if narrow:
            column.min_width = column.max_width = size
            column.no_wrap = False
        for cell in column._cells if column.justify == "right" else ():
            if isinstance(cell, Text):  # rich takes spaces off the end of what it sets to the right
                cell.pad_left(size - cell_len(cell.plain))
                cell.justify = "left"
    return table


def _pointed(column: Column) -> list[str]:
    """The texts of a column; numbers with spaces behind them that put their points in line."""
    plain = [Text.from_markup(str(cell)).plain for cell in column.cells]
    missing = behind(plain) if column.justify == "right" else [0]
    if any(missing):
        column._cells = [
            Text.from_markup(str(cell) + count * " ")
            for cell, count in zip(column.cells, missing, strict=True)
        ]
        return [Text.from_markup(str(cell)).plain for cell in column._cells]
    return plain


def _stacked(table: Table, headers: list[str]) -> str:
    lines = [f"[bold]{table.title}[/bold]"] if table.title else []
    short = len(headers[0]) <= _SHORT
    if not short:
        lines.append(f"[bold]{escape(headers[0])}[/bold]")
    above = ""
    for row in zip(*(column.cells for column in table.columns), strict=True):
        if any(str(cell) for cell in row):
            first, *others = (escape(c.plain) if isinstance(c, Text) else str(c) for c in row)
            first = above = first or above  # an empty cell stands for the one above
            lines.append(
                f"[bold]{headers[0]}[/bold] {first}".strip() if short and headers[0] else first
            )
            lines += [
                f"  {escape(header)} {cell.strip()}".rstrip()
                for header, cell in zip(headers[1:], others, strict=True)
                if cell
            ]
    return "\n".join([*lines, *([str(table.caption)] if table.caption else []), ""])
