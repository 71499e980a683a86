"""Pictures with hover and zoom: a figure of matplotlib as one of plotly.

All that the pictures of this package are made of is carried over: curves, marks, bars, filled shapes,
lines across the axes, texts, polar and logarithmic axes. Plotly is an optional extra of the package.
"""

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.category import StrCategoryLocator
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from .._core.errors import BadInput
from ._style import GREY, GRID, INK

# Plotly's pixels in a point of matplotlib, and in an inch.
_POINT = 100 / 72
_INCH = 100
_DASHES = {"-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
_NOTHING = ("None", "none", None, "", " ")
_MARKERS = {"o": "circle", ".": "circle", "s": "square", "D": "diamond", "x": "x-thin", "*": "star",
            "^": "triangle-up", "v": "triangle-down", "+": "cross-thin"}  # fmt: skip
# Axes with marks at given places, whose texts are carried over.
_FIXED = (FixedLocator, StrCategoryLocator)
_FONT = {"family": "DejaVu Sans, Verdana, sans-serif", "color": INK}
_PAPER = {"xref": "paper", "yref": "paper"}
# [px] room for the legend
_LEGEND = 230


def interactive(figure: Figure) -> Any:
    """The figure of plotly, with hover and zoom, that shows what a figure of matplotlib shows.

    Args:
        figure: any picture of this package.

    Returns:
        A `plotly.graph_objects.Figure`; `.write_html(path)` keeps it as a page.

    Raises:
        BadInput: plotly is not installed.
    """
    try:
        import plotly.graph_objects as go
    except ImportError:
        raise BadInput(
            "interactive", "without plotly", 'used with it; pip install "jaxcomp[interactive]"'
        ) from None
    FigureCanvasAgg(figure).draw()  # lays the axes out
    width, height = figure.get_size_inches() * _INCH
    listed, heading = _legend_texts(figure)
    room = _LEGEND if listed else 0
    conversion = _Conversion(go.Figure(), listed)
    conversion.figure.update_layout(
        width=width + room, height=height, template="none", font=_FONT, hovermode="closest",
        margin={"l": 0, "r": room, "t": 0, "b": 0}, barmode="overlay",
        legend={"x": 1.01, "y": 0.95, "font": {"size": 12}, "title": heading},
    )  # fmt: skip
    if title := figure.get_suptitle():
        conversion.write(title, 0.01, 0.995, _PAPER, 15, yanchor="top")
    if note := figure.get_supxlabel():
        conversion.write(note, 0.01, 0.003, _PAPER, 11, yanchor="bottom")
    visible = filter(Axes.get_visible, figure.axes)
    for number, ax in enumerate(visible, 1):
        conversion.draw(ax, number)
    return conversion.figure


def interactive_page(figures: Mapping[str, Any], title: str) -> str:
    """All figures of matplotlib among these on one page of HTML that needs nothing from the network."""
    pieces = []
    for figure in figures.values():
        if isinstance(figure, Figure):
            first = not pieces
            pieces.append(interactive(figure).to_html(full_html=False, include_plotlyjs=first))
    head = f"<!doctype html><meta charset='utf-8'><title>{escape(title)}</title>"
    return "\n".join([head, *pieces])


def _legend_texts(figure: Figure) -> tuple[set[str], str]:
    """Labels in all legends of a figure, and the first heading of one."""
    legends: list[Any] = list(figure.legends)
    for ax in figure.axes:
        legends.append(ax.get_legend())
    labels: set[str] = set()
    heading = ""
    for legend in legends:
        if legend:
            for text in legend.get_texts():
                labels.add(text.get_text())
            heading = heading or legend.get_title().get_text()
    return labels, heading


class _Conversion:
    """The figure of plotly under construction."""

    def __init__(self, figure: Any, listed: set[str]):
        self.figure = figure
        self.listed = listed  # labels that the legend has, and no trace yet
        self.axes: dict[Axes, str] = {}

    def draw(self, ax: Axes, number: int) -> None:
        """One pair of axes with all that is in it."""
        place = self._new_axes(ax, number)
        if title := ax.get_title(loc="left"):
            box = ax.get_position()
            self.write(title, box.x0, box.y1, _PAPER, 12, yanchor="bottom")
        in_bars = set()
        for container in ax.containers:
            if isinstance(container, BarContainer):
                self._bars(ax, container, place)
                in_bars.update(container)
        for patch in ax.patches:
            if patch not in in_bars:
                path = patch.get_path()
                face = patch.get_facecolor()
                polygons = path.transformed(patch.get_patch_transform()).to_polygons()
                inside = patch.get_transform().contains_branch_seperately(ax.transData)
                self._shape(ax, polygons, face, patch.get_edgecolor(), place, inside)
                self._listed(ax, patch, face, place)
        for collection in ax.collections:
            self._collection(ax, collection, place)
        for line in ax.lines:
            self._line(ax, line, place)
        for text in ax.texts:
            self._text(ax, text, place)

    def write(self, text, x, y, references, size, **options) -> None:
        """A text at a place."""
        self.figure.add_annotation(
            text=_html(text), x=x, y=y, showarrow=False, **references,
            **{"xanchor": "left", "yanchor": "middle", "font": {"size": size}} | options,
        )  # fmt: skip

    def _new_axes(self, ax: Axes, number: int) -> dict[str, str]:
        """Lay out a pair of axes; how its traces refer to it."""
        key = "" if number == 1 else str(number)
        if ax.name == "polar":
            return self._polar_axes(ax, key)
        return self._plane_axes(ax, key)

    def _plane_axes(self, ax: Axes, key: str) -> dict[str, str]:
        box = ax.get_position()
        right = ax.yaxis.get_ticks_position() == "right"
        # axes at the place of others have an ordinate of their own over the common abscissa
        below = None
        for other, other_key in self.axes.items():
            if np.allclose(other.get_position(), box):
                below = other_key
                break
        x = self.axes[ax] = below or f"x{key}"
        look: dict[str, Any] = {"domain": (box.y0, box.y1), "anchor": x}
        look["side"] = "right" if right else "left"
        if ax.get_aspect() == 1.0:
            look |= {"scaleanchor": x, "constrain": "domain"}
        if below is not None:
            look["overlaying"] = below.replace("x", "y")
        else:
            bottom = {"domain": (box.x0, box.x1), "anchor": f"y{key}"}
            self._axis(ax, ax.xaxis, f"xaxis{key}", bottom)
        self._axis(ax, ax.yaxis, f"yaxis{key}", look)
        return {"xaxis": x, "yaxis": f"y{key}"}

    def _axis(self, ax: Axes, axis, name: str, look: dict[str, Any]) -> None:
        """An abscissa or ordinate."""
        limits = axis.get_view_interval()
        if axis.get_inverted():
            limits = limits[::-1]
        kind = "linear"
        if axis.get_scale() == "log":  # of which plotly has the exponents
            kind = "log"
            limits = np.log10(limits)
        spine = "bottom"
        group = ax.get_shared_x_axes()
        if name[0] == "y":
            spine = "left"
            group = ax.get_shared_y_axes()
        lines = axis.get_gridlines()
        labels = axis.get_ticklabels()
        look |= {
            "range": limits, "type": kind,
            "title": {"text": axis.get_label_text(), "font": {"size": 12}, "standoff": 4},
            "showgrid": bool(lines) and lines[0].get_visible(), "gridcolor": GRID, "zeroline": False,
            "ticks": "outside", "ticklen": 4, "tickfont": {"size": 11}, "linecolor": GREY,
            "showline": ax.spines[spine].get_visible(),
            "showticklabels": any(t.get_visible() and t.get_text() for t in labels),
        }  # fmt: skip
        if isinstance(axis.get_major_locator(), _FIXED):
            places, texts = _ticks(axis)
            look |= {"tickvals": places, "ticktext": list(map(_html, texts))}
        axis_key = self.axes[ax]
        for other, key in self.axes.items():
            if key != axis_key and group.joined(ax, other):
                look["matches"] = key.replace("x", name[0])
                break
        self.figure.update_layout({name: look})

    def _polar_axes(self, ax: Axes, key: str) -> dict[str, str]:
        box = ax.get_position()
        texts = [_html(label.get_text()) for label in ax.get_xticklabels()]
        radial = {"range": ax.get_ylim(), "angle": 67.5, "gridcolor": GRID, "nticks": 5}
        ticks = {"tickvals": np.rad2deg(ax.get_xticks()), "ticktext": texts, "gridcolor": GRID}
        domain = {"x": (box.x0, box.x1), "y": (box.y0, box.y1)}
        look = {"domain": domain, "radialaxis": radial, "angularaxis": ticks}
        self.figure.update_layout({f"polar{key}": look})
        return {"subplot": f"polar{key}"}

    def _trace(self, ax: Axes, kind: str, label: str, place, x, y, **look) -> None:
        """A trace, in the legend where the picture has it there."""
        if label.startswith("_"):
            label = ""
        in_legend = label in self.listed
        self.listed.discard(label)
        words = []
        if label:
            words.append(label)
        if ax.name == "polar":
            kind = f"{kind}polar"
            data = {"theta": np.rad2deg(np.asarray(x)), "r": y}
            words.append("%{r:.5g} at %{theta:.4g}°")
        else:
            data = {"x": x, "y": y}
            words.append(f"{ax.get_xlabel() or 'x'}: %{{x:.5g}}")
            words.append(f"{ax.get_ylabel() or 'y'}: %{{y:.5g}}")
        self.figure.add_trace(
            {"type": kind, "name": label, "showlegend": in_legend, "legendgroup": label or None,
             "hovertemplate": "<br>".join(words) + "<extra></extra>", **data, **place, **look}
        )  # fmt: skip

    def _line(self, ax: Axes, line, place) -> None:
        inside = line.get_transform().contains_branch_seperately(ax.transData)
        tint = _colour(line.get_color(), line.get_alpha())
        style = line.get_linestyle()
        look = {"color": tint, "width": line.get_linewidth() * _POINT,
                "dash": _DASHES.get(style, "solid")}  # fmt: skip
        abscissas, ordinates = line.get_data()
        x = np.asarray(abscissas, float)
        y = np.asarray(ordinates, float)
        if not all(inside):
            self.figure.add_shape(type="line", x0=x[0], x1=x[-1], y0=y[0], y1=y[-1], line=look,
                                  **_references(inside, place))  # fmt: skip
        if not all(inside) or not len(x):
            # for the legend
            x = [None]
            y = [None]
        sign = line.get_marker()
        hollow = line.get_fillstyle() == "none"
        symbol = _MARKERS.get(sign, "circle")
        if hollow:
            symbol += "-open"
        size = line.get_markersize() * _POINT
        if sign == ".":
            size *= 0.5
        marker = {"color": tint, "size": size, "symbol": symbol,
                  "line": {"color": tint, "width": 1.2 * (hollow or "thin" in symbol)}}  # fmt: skip
        drawn = []
        if style not in _NOTHING:
            drawn.append("lines")
        if sign not in _NOTHING:
            drawn.append("markers")
        self._trace(ax, "scatter", str(line.get_label()), place, x, y, line=look, marker=marker,
                    mode="+".join(drawn) or "lines")  # fmt: skip

    def _bars(self, ax: Axes, bars: BarContainer, place) -> None:
        flat = bars.orientation == "horizontal"
        boxes = [(b.get_x(), b.get_y(), b.get_width(), b.get_height()) for b in bars]
        x0, y0, width, height = np.array(boxes, float).reshape(-1, 4).T
        if flat:
            base = x0
            length = width
            middle = y0 + height / 2
            thickness = height
            axis = ax.yaxis
            label = ax.get_xlabel() or "value"
            data = {"x": length, "y": middle, "orientation": "h"}
        else:
            base = y0
            length = height
            middle = x0 + width / 2
            thickness = width
            axis = ax.xaxis
            label = ax.get_ylabel() or "value"
            data = {"x": middle, "y": length, "orientation": "v"}
        names = [f"{m:.5g}" for m in middle]
        if isinstance(axis.get_major_locator(), _FIXED):
            places, texts = _ticks(axis)
            names = []
            for m in middle:
                nearest = np.argmin(np.abs(places - m))
                names.append(texts[nearest])
        tints = [_colour(b.get_facecolor()) for b in bars]
        self._trace(
            ax, "bar", str(bars.get_label()), place, base=base, width=thickness, **data,
            hovertemplate=f"%{{customdata[0]}}<br>{label}: %{{customdata[1]:.5g}}<extra></extra>",
            customdata=list(zip(names, (base + length).tolist(), strict=True)),
            marker={"color": tints},
        )  # fmt: skip

    def _collection(self, ax: Axes, collection, place) -> None:
        faces: Any = collection.get_facecolor()
        edges: Any = faces
        if not isinstance(collection, QuadMesh):
            edges = collection.get_edgecolor()
        label = str(collection.get_label())
        if isinstance(collection, PathCollection):
            x, y = np.asarray(collection.get_offsets(), float).T
            size = float(np.sqrt(collection.get_sizes()[0])) * _POINT
            tints = [_colour(face) for face in faces]
            paint = tints if len(tints) > 1 else tints[0]
            marker = {"color": paint, "size": size}
            self._trace(ax, "scatter", label, place, x, y, mode="markers", marker=marker)
            return
        segments = isinstance(collection, LineCollection) or not len(faces)
        for number, path in enumerate(collection.get_paths()):
            pieces: list[Any] = list(path.to_polygons(closed_only=False))
            edge = (0, 0, 0, 0)
            if len(edges):
                edge = edges[number % len(edges)]
            if pieces and segments:
                # not a number parts one piece from the next
                gaps = [np.append(piece, np.full((1, 2), np.nan), axis=0) for piece in pieces]
                x, y = np.concatenate(gaps).T
                look = {"color": _colour(edge), "width": 1.2}
                self._trace(ax, "scatter", label, place, x, y, mode="lines", line=look)
            elif pieces:
                self._shape(ax, pieces, faces[number % len(faces)], edge, place)
                self._listed(ax, collection, faces[0], place)
        if hasattr(collection, "hover"):
            x, y, z, words = collection.hover  # pyright: ignore[reportAttributeAccessIssue]
            hover = (
                f"{ax.get_xlabel()}: %{{x:.5g}}",
                f"{ax.get_ylabel()}: %{{y:.5g}}",
                f"{words}: %{{z:.5g}}",
            )
            self.figure.add_trace(
                {"type": "heatmap", "x": x, "y": y, "z": z, "opacity": 0, "showscale": False,
                 "hovertemplate": f"{'<br>'.join(hover)}<extra></extra>", **place}
            )  # fmt: skip

    def _shape(self, ax: Axes, polygons, face, edge, place, inside=(True, True)) -> None:
        """A filled shape below the curves, with holes where polygons lie in each other."""
        if ax.name == "polar":
            return
        paths = []
        for polygon in polygons:
            if len(polygon) and np.all(np.isfinite(polygon)):
                corners = [f"{x:.9g},{y:.9g}" for x, y in np.asarray(polygon, float)]
                paths.append(f"M{'L'.join(corners)}Z")
        if paths:
            self.figure.add_shape(type="path", path=" ".join(paths), layer="below",
                                  fillcolor=_colour(face), fillrule="evenodd",
                                  line={"color": _colour(edge), "width": 0.7},
                                  **_references(inside, place))  # fmt: skip

    def _listed(self, ax: Axes, artist, face, place) -> None:
        """A filled shape in the legend."""
        if artist.get_label() in self.listed:
            marker = {"color": _colour(face), "symbol": "square", "size": 12}
            self._trace(ax, "scatter", artist.get_label(), place, [None], [None], mode="markers",
                        marker=marker)  # fmt: skip

    def _text(self, ax: Axes, text, place) -> None:
        words = text.get_text()
        size = text.get_fontsize() * 1.35
        if not words.strip() or not text.get_visible():
            return
        x, y = getattr(text, "xy", text.get_position())
        if ax.name == "polar":
            self._trace(
                ax, "scatter", "", place, [float(x)], [float(y)], mode="text", text=[words],
                textposition="top right", textfont={"size": size}, hovertemplate=None,
            )  # fmt: skip
            return
        inside = _in_data(ax, text)
        right = 0.0
        up = 0.0
        if getattr(text, "anncoords", None) == "offset points":
            shift_right, shift_up = text.xyann
            right = _POINT * float(shift_right)
            up = _POINT * float(shift_up)
        # plotly has the exponents of logarithmic axes as coordinates of its texts
        if inside[0] and ax.get_xscale() == "log":
            x = np.log10(x)
        if inside[1] and ax.get_yscale() == "log":
            y = np.log10(y)
        x = float(x)
        y = float(y)
        anchors = {"center": "middle", "center_baseline": "middle", "baseline": "bottom"}
        self.write(
            words, x, y, _references(inside, place), size, xanchor=text.get_ha(),
            yanchor=anchors.get(text.get_va(), text.get_va()), xshift=right, yshift=up,
            textangle=-text.get_rotation(),
            font={"size": size, "color": _colour(text.get_color())},
        )  # fmt: skip


def _in_data(ax: Axes, text) -> tuple[bool, ...]:
    """Whether the coordinates of a text are data, x and y; otherwise they are shares of the axes."""
    coordinates = getattr(text, "xycoords", None)
    if coordinates is None:
        return text.get_transform().contains_branch_seperately(ax.transData)
    if not isinstance(coordinates, tuple):
        coordinates = (coordinates, coordinates)
    return tuple(system == "data" or not isinstance(system, str) for system in coordinates)


def _ticks(axis) -> tuple[np.ndarray, list[str]]:
    """Places and texts of marks, also where other axes show the texts."""
    places = axis.get_ticklocs()
    return places, axis.get_major_formatter().format_ticks(places)


def _html(text: str) -> str:
    return text.replace("\n", "<br>")


def _references(inside, place) -> dict[str, str]:
    """References of the two coordinates of a shape or text: data, or the share of the axes."""
    references = {}
    for axis, in_data in zip("xy", inside, strict=True):
        name = place[f"{axis}axis"]
        if not in_data:
            name = f"{name} domain"
        references[f"{axis}ref"] = name
    return references


def _colour(paint, alpha=None) -> str:
    red, green, blue, opaque = to_rgba(paint, alpha)
    return f"rgba({255 * red:.0f},{255 * green:.0f},{255 * blue:.0f},{opaque:.3g})"
