"""Pictures with hover and zoom: a figure of matplotlib as one of plotly.

All that the pictures of this package are made of is carried over: curves, marks, bars, filled shapes,
lines across the axes, texts, polar and logarithmic axes. Plotly is an optional extra of the package.
"""

import functools
import inspect
from collections.abc import Callable, Mapping
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
from matplotlib.transforms import Transform

from .._fields import BadInput
from ._style import INK

# Plotly's pixels in a point of matplotlib, and in an inch.
_POINT, _INCH = 100 / 72, 100
_DASHES = {"-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
_MARKERS = {"o": "circle", ".": "circle", "s": "square", "D": "diamond", "x": "x-thin", "*": "star",
            "^": "triangle-up", "v": "triangle-down", "+": "cross-thin"}  # fmt: skip
# Axes with marks at given places, whose texts are carried over.
_FIXED = (FixedLocator, StrCategoryLocator)
_FONT = {"family": "DejaVu Sans, Verdana, sans-serif", "color": INK}
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
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes)]
    wanted = {text.get_text() for legend in legends if legend for text in legend.get_texts()}
    heading = next(
        (text for legend in legends if legend and (text := legend.get_title().get_text())), ""
    )
    made = _Made(go.Figure(), wanted)
    made.figure.update_layout(
        width=width + (_LEGEND if wanted else 0), height=height, template="none", font=_FONT,
        margin={"l": 0, "r": _LEGEND if wanted else 0, "t": 0, "b": 0}, hovermode="closest",
        barmode="overlay", legend={"x": 1.01, "y": 0.95, "font": {"size": 12}, "title": heading},
    )  # fmt: skip
    for text in (figure.get_suptitle(), figure.get_supxlabel()):
        top = text == figure.get_suptitle()
        if text:
            made.write(text, 0.01, 0.995 if top else 0.003, "paper", "paper",
                       15 if top else 11, yanchor="top" if top else "bottom")  # fmt: skip
    for number, ax in enumerate((ax for ax in figure.axes if ax.get_visible()), 1):
        made.draw(ax, number)
    return made.figure


def interactive_page(figures: Mapping[str, Any], title: str) -> str:
    """All figures of matplotlib among these on one page of HTML that needs nothing from the network."""
    pieces = []
    for figure in figures.values():
        if isinstance(figure, Figure):
            first = not pieces
            pieces.append(interactive(figure).to_html(full_html=False, include_plotlyjs=first))
    head = f"<!doctype html><meta charset='utf-8'><title>{escape(title)}</title>"
    return "\n".join([head, *pieces])


def offering_interactive(function: Callable) -> Callable:
    """A function that draws, with the option `interactive`."""
    signature = inspect.signature(function)
    option = inspect.Parameter(
        "interactive", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=bool
    )

    @functools.wraps(function)
    def _draw(*given, **options):
        wanted = options.pop("interactive", False)
        made = function(*given, **options)
        if not wanted:
            return made
        if isinstance(made, dict):
            return {name: interactive(figure) for name, figure in made.items()}
        return interactive(made)

    _draw.__doc__ = (
        f"{function.__doc__}\n    With `interactive=True`: figures of plotly, see `interactive`.\n"
    )
    _draw.__signature__ = signature.replace(  # pyright: ignore[reportAttributeAccessIssue]
        parameters=[*signature.parameters.values(), option]
    )
    return _draw


class _Made:
    """The figure of plotly under construction."""

    def __init__(self, figure: Any, wanted: set[str]):
        self.figure, self.wanted = figure, wanted
        self.axes: dict[Axes, str] = {}

    def draw(self, ax: Axes, number: int) -> None:
        """One pair of axes with all that is in it."""
        key = "" if number == 1 else str(number)
        if ax.name == "polar":
            self._polar_axes(ax, f"polar{key}")
            place: dict[str, str] = {"subplot": f"polar{key}"}
        else:
            place = {"xaxis": self._plane_axes(ax, key), "yaxis": f"y{key}"}
        if title := ax.get_title(loc="left"):
            box = ax.get_position()
            self.write(title, box.x0, box.y1, "paper", "paper", 12, yanchor="bottom")
        bars = [c for c in ax.containers if isinstance(c, BarContainer)]
        for container in bars:
            self._bars(ax, container, place)
        drawn = {id(patch) for container in bars for patch in container}
        for patch in ax.patches:
            if id(patch) not in drawn:
                path = patch.get_path().transformed(patch.get_patch_transform())
                self._shape(ax, path.to_polygons(), patch.get_facecolor(), patch.get_edgecolor(),
                            place, patch.get_transform())  # fmt: skip
                self._listed(ax, patch, patch.get_facecolor(), place)
        for collection in ax.collections:
            self._collection(ax, collection, place)
        for line in ax.lines:
            self._line(ax, line, place)
        for text in ax.texts:
            self._text(ax, text, place)

    def write(self, text, x, y, xref, yref, size, **options) -> None:
        """A text at a place."""
        self.figure.add_annotation(
            text=text.replace("\n", "<br>"), x=x, y=y, xref=xref, yref=yref, showarrow=False,
            **{"xanchor": "left", "yanchor": "middle", "font": {"size": size}} | options,
        )  # fmt: skip

    def _plane_axes(self, ax: Axes, key: str) -> str:
        box, x = ax.get_position(), f"x{key}"
        below = next((k for a, k in self.axes.items() if np.allclose(a.get_position(), box)), None)
        options: dict[str, Any] = {}
        if below is not None:
            x, options = below, {"overlaying": below.replace("x", "y")}
        self.axes.setdefault(ax, x)
        shown: dict[str, tuple[Any, Any]] = {"y": (ax.yaxis, (box.y0, box.y1))}
        if below is None:
            shown["x"] = ax.xaxis, (box.x0, box.x1)
        for name, (axis, domain) in shown.items():
            log = axis.get_scale() == "log"
            limits = (
                axis.get_view_interval()
                if not axis.get_inverted()
                else axis.get_view_interval()[::-1]
            )
            look: dict[str, Any] = {
                "domain": domain, "range": np.log10(limits) if log else limits,
                "type": "log" if log else "linear", "anchor": x if name == "y" else f"y{key}",
                "title": {"text": axis.get_label_text(), "font": {"size": 12}, "standoff": 4},
                "showgrid": axis.get_gridlines()[0].get_visible() if axis.get_gridlines() else False,
                "gridcolor": "#E3E3E3", "zeroline": False, "ticks": "outside", "ticklen": 4,
                "showline": axis.axes.spines["left" if name == "y" else "bottom"].get_visible(),
                "linecolor": "#888888", "tickfont": {"size": 11},
            }  # fmt: skip
            if isinstance(axis.get_major_locator(), _FIXED):
                texts = [t.get_text().replace("\n", "<br>") for t in axis.get_ticklabels()]
                look |= {"tickvals": axis.get_ticklocs(), "ticktext": texts}
            if not any(t.get_visible() and t.get_text() for t in axis.get_ticklabels()):
                look["showticklabels"] = False
            if name == "y":
                look |= {
                    "side": "right" if axis.get_ticks_position() == "right" else "left",
                    **options,
                }
                if ax.get_aspect() == 1.0:
                    look |= {"scaleanchor": x, "constrain": "domain"}
            for other, theirs in self.axes.items():
                group = ax.get_shared_x_axes() if name == "x" else ax.get_shared_y_axes()
                if other is not ax and theirs != x and group.joined(ax, other):
                    look["matches"] = theirs.replace("x", name)
                    break
            self.figure.update_layout({f"{name}axis{x[1:] if name == 'x' else key}": look})
        return x

    def _polar_axes(self, ax: Axes, key: str) -> None:
        box = ax.get_position()
        texts = [label.get_text().replace("\n", "<br>") for label in ax.get_xticklabels()]
        radial = {"range": ax.get_ylim(), "angle": 67.5, "gridcolor": "#E3E3E3", "nticks": 5}
        around = {
            "tickvals": np.rad2deg(ax.get_xticks()),
            "ticktext": texts,
            "gridcolor": "#E3E3E3",
        }
        domain = {"x": (box.x0, box.x1), "y": (box.y0, box.y1)}
        self.figure.update_layout(
            {key: {"domain": domain, "radialaxis": radial, "angularaxis": around}}
        )

    def _trace(self, ax: Axes, kind: str, label: str, place, x, y, **look) -> None:
        """A trace, in the legend where the picture has it there."""
        label = "" if label.startswith("_") else label
        listed = label in self.wanted
        self.wanted.discard(label)
        words = [label] if label else []
        if ax.name == "polar":
            kind, data = f"{kind}polar", {"theta": np.rad2deg(np.asarray(x)), "r": y}
            words.append("%{r:.5g} at %{theta:.4g}°")
        else:
            data = {"x": x, "y": y}
            words += [
                f"{ax.get_xlabel() or 'x'}: %{{x:.5g}}",
                f"{ax.get_ylabel() or 'y'}: %{{y:.5g}}",
            ]
        hover = look.pop("hovertemplate", "<br>".join(words) + "<extra></extra>")
        place = {"subplot": place["subplot"]} if ax.name == "polar" else place
        self.figure.add_trace(
            {"type": kind, "name": label, "showlegend": listed, "legendgroup": label or None,
             "hovertemplate": hover, **data, **place, **look}
        )  # fmt: skip

    def _line(self, ax: Axes, line, place) -> None:
        inside = line.get_transform().contains_branch_seperately(ax.transData)
        tint = _colour(line.get_color(), line.get_alpha())
        look = {"color": tint,
                "width": line.get_linewidth() * _POINT,
                "dash": _DASHES.get(line.get_linestyle(), "solid")}  # fmt: skip
        if not all(inside):
            (x0, x1), (y0, y1) = (np.asarray(v, float)[[0, -1]] for v in line.get_data())
            self.figure.add_shape(type="line", x0=x0, x1=x1, y0=y0, y1=y1, line=look,
                                  **_references(inside, place))  # fmt: skip
            x, y = [None], [None]  # for the legend
        else:
            x, y = (np.asarray(v, float) for v in line.get_data())
            if not len(x):
                x, y = [None], [None]
        marks = line.get_marker() not in ("None", "none", None, "")
        drawn = line.get_linestyle() not in ("None", "none", "")
        hollow = line.get_fillstyle() == "none"
        symbol = _MARKERS.get(line.get_marker(), "circle") + ("-open" if hollow else "")
        size = line.get_markersize() * _POINT * (0.5 if line.get_marker() == "." else 1.0)
        marker = {"color": tint, "size": size, "symbol": symbol,
                  "line": {"color": tint, "width": 1.2 * (hollow or "thin" in symbol)}}  # fmt: skip
        mode = "+".join(word for word, on in (("lines", drawn), ("markers", marks)) if on)
        self._trace(ax, "scatter", str(line.get_label()), place, x, y, mode=mode or "lines",
                    line=look, marker=marker)  # fmt: skip

    def _bars(self, ax: Axes, bars: BarContainer, place) -> None:
        flat = bars.orientation == "horizontal"
        boxes = [(b.get_x(), b.get_y(), b.get_width(), b.get_height()) for b in bars]
        x0, y0, width, height = np.array(boxes, float).reshape(-1, 4).T
        base, length, middle, across = (
            (x0, width, y0 + height / 2, height) if flat else (y0, height, x0 + width / 2, width)
        )
        ticks = (ax.yaxis if flat else ax.xaxis).get_ticklabels()
        fixed = isinstance((ax.yaxis if flat else ax.xaxis).get_major_locator(), _FIXED)
        places = (ax.yaxis if flat else ax.xaxis).get_ticklocs() if fixed else []
        names = [
            ticks[int(np.argmin(np.abs(places - m)))].get_text() if len(places) else f"{m:.5g}"
            for m in middle
        ]
        axis = ax.get_xlabel() if flat else ax.get_ylabel()
        end = (base + length).tolist()
        hover = f"%{{customdata[0]}}<br>{axis or 'value'}: %{{customdata[1]:.5g}}<extra></extra>"
        self._trace(
            ax, "bar", str(bars.get_label()), place, *((length, middle) if flat else (middle, length)),
            base=base, width=across, orientation="h" if flat else "v", hovertemplate=hover,
            customdata=list(zip(names, end, strict=True)),
            marker={"color": [_colour(b.get_facecolor()) for b in bars]},
        )  # fmt: skip

    def _collection(self, ax: Axes, collection, place) -> None:
        faces: Any = collection.get_facecolor()
        edges: Any = collection.get_edgecolor()
        if isinstance(collection, PathCollection):
            x, y = np.asarray(collection.get_offsets(), float).T
            size = float(np.sqrt(collection.get_sizes()[0])) * _POINT
            marker = {"color": [_colour(c) for c in faces] if len(faces) > 1 else _colour(faces[0]),
                      "size": size}  # fmt: skip
            self._trace(ax, "scatter", str(collection.get_label()), place, x, y, mode="markers",
                        marker=marker)  # fmt: skip
            return
        if isinstance(collection, QuadMesh):
            corners: Any = collection.get_coordinates()
            cells = [
                [corners[i, j], corners[i, j + 1], corners[i + 1, j + 1], corners[i + 1, j]]
                for i in range(corners.shape[0] - 1)
                for j in range(corners.shape[1] - 1)
            ]
            for cell, face in zip(cells, faces, strict=True):
                self._shape(ax, [np.array(cell)], face, face, place)
            return
        segments = isinstance(collection, LineCollection) or not len(faces)
        for number, path in enumerate(collection.get_paths()):
            pieces: list[Any] = list(path.to_polygons(closed_only=False))
            if not pieces:
                continue
            if segments:
                x, y = (
                    np.concatenate([np.append(p[:, i], np.nan) for p in pieces]) for i in (0, 1)
                )
                line = {"color": _colour(edges[number % len(edges)]), "width": 1.2}
                self._trace(ax, "scatter", str(collection.get_label()), place, x, y, mode="lines",
                            line=line)  # fmt: skip
            else:
                edge = edges[number % len(edges)] if len(edges) else (0, 0, 0, 0)
                self._shape(ax, pieces, faces[number % len(faces)], edge, place)
                self._listed(ax, collection, faces[0], place)
        if hasattr(collection, "hover"):
            x, y, z, words = collection.hover  # pyright: ignore[reportAttributeAccessIssue]
            rows = ((ax.get_xlabel(), "x"), (ax.get_ylabel(), "y"), (words, "z"))
            hover = "<br>".join(f"{word}: %{{{name}:.5g}}" for word, name in rows)
            self.figure.add_trace(
                {"type": "heatmap", "x": x, "y": y, "z": z, "opacity": 0, "showscale": False,
                 "hovertemplate": f"{hover}<extra></extra>", **place}
            )  # fmt: skip

    def _shape(self, ax: Axes, polygons, face, edge, place, transform: Transform | None = None):
        """A filled shape below the curves, with holes where polygons lie in each other."""
        if ax.name == "polar":
            return
        inside = (True, True)
        if transform is not None:
            inside = transform.contains_branch_seperately(ax.transData)
        path = " ".join(
            "M" + "L".join(f"{x:.9g},{y:.9g}" for x, y in np.asarray(p, float)) + "Z"
            for p in polygons
            if len(p) and np.all(np.isfinite(p))
        )
        if path:
            self.figure.add_shape(type="path", path=path, fillcolor=_colour(face), layer="below",
                                  fillrule="evenodd", line={"color": _colour(edge), "width": 0.7},
                                  **_references(inside, place))  # fmt: skip

    def _listed(self, ax: Axes, artist, face, place) -> None:
        """A filled shape in the legend."""
        if artist.get_label() in self.wanted:
            marker = {"color": _colour(face), "symbol": "square", "size": 12}
            self._trace(ax, "scatter", artist.get_label(), place, [None], [None], mode="markers",
                        marker=marker)  # fmt: skip

    def _text(self, ax: Axes, text, place) -> None:
        words, size = text.get_text(), text.get_fontsize() * 1.35
        if not words.strip() or not text.get_visible():
            return
        x, y = getattr(text, "xy", text.get_position())
        if ax.name == "polar":
            self._trace(
                ax, "scatter", "", place, [float(x)], [float(y)], mode="text", text=[words],
                textposition="top right", textfont={"size": size}, hovertemplate=None,
            )  # fmt: skip
            return
        given = getattr(text, "xycoords", None)
        if given is None:
            inside = text.get_transform().contains_branch_seperately(ax.transData)
        else:
            pair = given if isinstance(given, tuple) else (given, given)
            inside = tuple(one == "data" or not isinstance(one, str) for one in pair)
        shift = (0.0, 0.0)
        if getattr(text, "anncoords", None) == "offset points":
            shift = tuple(_POINT * np.asarray(text.xyann, float))
        values = [
            np.log10(v) if here and axis.get_scale() == "log" else v
            for v, here, axis in zip((x, y), inside, (ax.xaxis, ax.yaxis), strict=True)
        ]
        across = {"center": "middle", "center_baseline": "middle", "baseline": "bottom"}
        self.write(
            words, *map(float, values), *_references(inside, place).values(), size,
            xanchor=text.get_ha(), yanchor=across.get(text.get_va(), text.get_va()),
            xshift=shift[0], yshift=shift[1], textangle=-text.get_rotation(),
            font={"size": size, "color": _colour(text.get_color())},
        )  # fmt: skip


def _references(inside, place) -> dict[str, str]:
    """What the two coordinates of a shape or text count in: data, or the share of the axes."""
    x, y = place["xaxis"], place["yaxis"]
    return {"xref": x if inside[0] else f"{x} domain", "yref": y if inside[1] else f"{y} domain"}


def _colour(given, alpha=None) -> str:
    red, green, blue, opaque = to_rgba(given, alpha)
    return f"rgba({255 * red:.0f},{255 * green:.0f},{255 * blue:.0f},{opaque:.3g})"
