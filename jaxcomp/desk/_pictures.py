"""Pictures of the desk: curves and bars that follow its machine, and the mechanism."""

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, FactorRange, Title
from bokeh.plotting import figure

from ..plot._mechanism import line_look
from ..plot._style import INK, colour, words
from ._page_layout import WIDE
from ._state import Desk, View

_PINNED = "#AAAAAA"
# Curves that grow or shrink by such a factor leave the part of a picture that was chosen for them.
_OTHER_SIZE = 1.25
# Units of the pictures, which stay while numbers are dragged.
_AXES = {
    "m^3": (1e6, "cm³"), "Pa": (1e-6, "MPa"), "lift": (1e3, "mm"), "N": (1.0, "N"),
    "film": (1e6, "µm"), "W": (1.0, "W"),
}  # fmt: skip
_AXES_US = _AXES | {
    "m^3": (0.0254**-3, "in³"), "Pa": (1 / 6894.757, "psi"), "lift": (1 / 0.0254, "in"),
    "N": (1 / 4.448222, "lbf"), "film": (1e6 / 0.0254, "µin"),
}  # fmt: skip


class Pictures:
    """Pictures whose curves and bars follow, each with the pinned state in grey behind it."""

    def __init__(self, desk: Desk):
        self.desk = desk
        self.angle = np.deg2rad(60.0)
        self.sources: dict[str, ColumnDataSource] = {}
        self._plots: dict[str, Any] = {}
        for title, (x, y, parts) in _drawn(desk.view, desk.system).items():
            self._plots[title] = self._figure(title, x, y, parts)
        self._sizes: dict[str, np.ndarray] = {}
        self.figures = list(self._plots.values())
        self.outlines: dict[str, ColumnDataSource] = {}
        for name in desk.front_view(self.angle):
            self.outlines[name] = ColumnDataSource({"x": [], "y": []})
        if self.outlines:
            self.figures.append(self._mechanism())

    def _figure(self, title: str, x: str, y: str, parts: dict[str, dict[str, Any]]) -> Any:
        """A picture with the labels of its axes, of curves or of the bars of the name ""."""
        bars = parts.get("")
        rows = {}
        if bars is not None:
            rows["y_range"] = FactorRange(*reversed(bars["y"]))
        plot: Any = figure(
            title=Title(text=title, text_color=INK), x_axis_label=x, y_axis_label=y, height=260,
            tools="pan,wheel_zoom,reset", toolbar_location="above", **rows, **WIDE,
        )  # fmt: skip
        plot.toolbar.logo = None
        plot.tags = [0]  # how often its ranges were renewed
        plot.js_on_change("tags", CustomJS(args={"plot": plot}, code="plot.reset.emit()"))
        for name, columns in parts.items():
            for pinned in (True, False):
                source = ColumnDataSource({column: [] for column in columns})
                source.name = f"{title}.{name}.{pinned}"
                self.sources[source.name] = source
                self._draw(plot, name, source, pinned, len(parts) > 1)
        if bars is not None:
            plot.x_range.start = 0
        elif len(parts) > 1:
            _legend_above(plot, [words(name) for name in parts])
        return plot

    def _draw(self, plot: Any, name: str, source, pinned: bool, among_others: bool) -> None:
        """A curve, or the bars of the name ""; what is pinned is grey."""
        # a joint has one colour in all pictures
        forces = list(self.desk.view.forces)
        place = 0
        if name in forces:
            place = forces.index(name)
        paint = _PINNED
        if not pinned:
            paint = colour(name or "crank_pin", place)
        if name:
            label = {}
            if among_others and not pinned:
                label["legend_label"] = words(name)
            plot.line("x", "y", source=source, color=paint, line_width=2, **label)
        else:
            height = 0.8 if pinned else 0.5
            plot.hbar(y="y", right="right", height=height, source=source, color=paint)

    def _mechanism(self) -> Any:
        plot: Any = figure(
            title=Title(text="Mechanism", text_color=INK), height=260, match_aspect=True, tools="",
            toolbar_location=None, **WIDE,
        )  # fmt: skip
        plot.axis.visible = plot.grid.visible = False
        for name, source in self.outlines.items():
            look = line_look(name)
            if look["linestyle"]:
                dash = "dotted" if look["linestyle"] == ":" else "solid"
                plot.line("x", "y", source=source, color=look["color"], line_dash=dash,
                          line_width=look["linewidth"], line_cap="round")  # fmt: skip
            else:
                plot.scatter("x", "y", source=source, color=look["color"], size=look["markersize"])
        return plot

    def turn(self, degrees: float) -> None:
        """Draw the mechanism at another angle of the crank."""
        self.angle = np.deg2rad(degrees)
        self._outline()

    def _outline(self) -> None:
        for name, line in self.desk.front_view(self.angle).items():
            data = self.outlines[name].data
            if not np.array_equal([data["x"], data["y"]], line, equal_nan=True):
                self.outlines[name].data = {"x": line[0], "y": line[1]}

    def show(self, view: View, pinned: View | None) -> None:
        """Draw a state, and the pinned one behind it."""
        self._outline()
        for behind, state in ((True, pinned), (False, view)):
            if state is None:
                continue
            for title, (_, _, parts) in _drawn(state, self.desk.system).items():
                for name, columns in parts.items():
                    self.sources[f"{title}.{name}.{behind}"].data = columns
                if not behind:
                    self._renew_range(title, parts)

    def _renew_range(self, title: str, parts: dict[str, dict[str, Any]]) -> None:
        """Let a picture that was panned or zoomed show curves of another size as a whole again.

        It follows its curves by itself until then, and keeps the part that was chosen afterwards.
        """
        sizes = []
        for columns in parts.values():
            for key, column in columns.items():
                if key == "y" and "x" not in columns:
                    continue  # the names of bars
                sizes.append(max(float(np.nanmax(np.abs(column))), 1e-300))
        sizes = np.array(sizes)
        before = self._sizes.setdefault(title, sizes)
        change = np.max(np.abs(np.log(sizes / before)))
        if change > np.log(_OTHER_SIZE):
            self._sizes[title] = sizes
            self._plots[title].tags = [self._plots[title].tags[0] + 1]


def _legend_above(plot: Any, names: list[str]) -> None:
    legend = plot.legend[0]
    # so many columns as the narrowest picture has room for
    columns = max(1, 52 // (6 + max(map(len, names))))
    legend.update(orientation="horizontal", label_text_font_size="8pt", ncols=columns)
    plot.height += 20 * (-(-len(names) // columns) - 1)
    legend.update(click_policy="hide", border_line_color=None, padding=0)
    plot.add_layout(legend, "above")


def _drawn(view: View, system: str) -> dict[str, tuple[str, str, dict[str, dict[str, Any]]]]:
    """Labels of both axes, and columns of data by curve, of every picture that this machine has.

    Bars are the columns of the name "".
    """
    out = {}
    axes = _AXES_US if system == "US" else _AXES
    if view.pressure is not None:
        by_x, x_unit = axes["m^3"]
        by_y, y_unit = axes["Pa"]
        # the first point once more, which closes the diagram
        volume = by_x * np.append(view.volume, view.volume[0])
        pressure = by_y * np.append(view.pressure, view.pressure[0])
        curves = {"gas": {"x": volume, "y": pressure}}
        out["Indicator diagram"] = f"Displaced volume, {x_unit}", f"Pressure, {y_unit}", curves
    for title, what, angle, values, kind in (
        ("Valve lift", "", view.lift_angle, view.lifts, "lift"),
        ("Joint forces", "Magnitude, ", view.angle, view.forces, "N"),
        ("Smallest film thickness", "", view.film_angle, view.films, "film"),
    ):
        factor, unit = axes[kind]
        label = f"{what}{unit}"
        if values:
            degrees = np.rad2deg((angle + np.pi) % (2 * np.pi) - np.pi)
            order = np.argsort(degrees)
            curves = {}
            for name, curve in values.items():
                curves[name] = {"x": degrees[order], "y": factor * curve[order]}
            out[title] = "Crank angle, degrees", label, curves
    losses = dict(zip(map(words, view.losses), view.losses.values(), strict=True))
    uses = dict(zip(map(words, view.power_use), view.power_use.values(), strict=True))
    vibration = {}
    for name, (present, after) in view.vibration.items():
        vibration |= {name: present, f"{name}, balanced": after}
    for title, kind, sizes in (
        ("Power use", "W", uses),
        ("Friction losses", "W", losses),
        ("Vibration of the targets", "film", vibration),
    ):
        if sizes:
            factor, unit = axes[kind]
            lengths = [factor * float(size) for size in sizes.values()]
            bars = {"y": list(sizes), "right": lengths}
            out[title] = unit, "", {"": bars}
    return out
