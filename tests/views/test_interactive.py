"""Interactive pictures show what the pictures of matplotlib show."""

import importlib.util
import inspect

import numpy as np
import pytest
from core.test_results import balance, orbit, tolerances
from matplotlib.figure import Figure

from jaxcomp import BadInput, load, plot, sensitivity
from jaxcomp.plot import interactive
from jaxcomp.plot._interactive import interactive_page
from jaxcomp.plot._style import crank_axis, legend, new_figure, new_polar_figure

__all__ = ["orbit"]  # a fixture
pytest.importorskip("plotly")


def one(made, kind, **wanted):
    (found,) = (
        t for t in made.data if t.type == kind and all(t[k] == v for k, v in wanted.items())
    )
    return found


def test_every_function_that_draws_has_the_option():
    drawings = plot.drawings().values()
    assert len(drawings) > 35
    for function in drawings:
        assert inspect.signature(function).return_annotation in (Figure, dict[str, Figure])
        option = inspect.signature(function).parameters["interactive"]
        assert (option.kind, option.default) == (option.KEYWORD_ONLY, False)
        assert "interactive" in function.__doc__


def test_curves_keep_their_numbers_names_and_looks(orbit):
    machine = load("mayekawa-wbhe").compressor
    drawn, made = (orbit.plot.crank_torques(machine, interactive=on) for on in (False, True))
    lines = [line for line in drawn.axes[0].lines if not line.get_label().startswith("_")]
    assert len(lines) == 5
    for line in lines:
        trace = one(made, "scatter", name=line.get_label())
        np.testing.assert_array_equal(trace.x, line.get_xdata())
        np.testing.assert_array_equal(trace.y, line.get_ydata())
        assert trace.showlegend
    assert "Crank angle from top dead centre, degrees: %{x" in trace.hovertemplate
    assert "Torque in the sense of rotation, N m: %{y" in trace.hovertemplate
    assert made.layout.xaxis.title.text == drawn.axes[0].get_xlabel()
    assert tuple(made.layout.xaxis.range) == (-180, 180)
    assert {a.text for a in made.layout.annotations} >= {drawn.get_suptitle()}
    # the zero lines reach across the axes, whatever is zoomed
    assert [s.xref for s in made.layout.shapes if s.type == "line"].count("x domain") == 1


def test_bars_are_told_by_their_names(orbit):
    drawn, made = (orbit.plot.loss_shares(interactive=on) for on in (False, True))
    (bars,) = (t for t in made.data if t.type == "bar")
    losses = {name: float(loss) for name, loss in orbit.energy.losses.items()}
    assert {name.lower().replace(" ", "_"): value for name, value in bars.customdata} == losses
    assert bars.orientation == "h"
    assert list(made.layout.yaxis.ticktext) == [
        t.get_text() for t in drawn.axes[0].get_yticklabels()
    ]


def test_results_take_the_option_under_plot():
    found = sensitivity(load("mayekawa-wbhe"), ["swept_volume"])
    made = found.plot.sensitivity_bars(interactive=True)
    assert sorted(made.data[0].x) == pytest.approx([1.0, 2.0])
    pictures = balance().plot.balance_figures(interactive=True)
    assert set(pictures) == {"vibration", "corrections"}
    assert [t.type for t in pictures["corrections"].data] == ["scatterpolar"] * 2
    bars = tolerances().plot.tolerance_figures("title", interactive=True)
    assert sum(t.type == "bar" for t in bars["tornado-swept_volume"].data) == 2


def test_shapes_marks_and_axes_of_every_kind():
    figure, ((left, right), (low, other)) = new_figure(2, 2, (8, 6), "all", False)
    left.fill_between([0, 1, 2], [0, 0, 0], [1, 2, 1], color="red", alpha=0.5, label="band")
    left.axhspan(0.2, 0.4, color="#00ff00", label="span")
    left.text(0.5, 0.5, "in the middle", transform=left.transAxes)
    legend(left)
    right.loglog([1, 10, 100], [1e-3, 1e-2, 1e-1], "s--", label="slope", color="#123456")
    right.annotate("here", (10, 1e-2), (4, 8), textcoords="offset points")
    low.scatter([1, 2, 3], [4, 5, 6], c=["red", "green", "blue"])
    shades = other.contourf([0, 1, 2], [0, 1], [[0, 1, 2], [1, 2, 3]], levels=[0, 1, 2, 3])
    shades.hover = [0, 1, 2], [0, 1], [[0, 1, 2], [1, 2, 3]], "height"
    figure.colorbar(shades, ax=other)
    twin = left.twinx()
    twin.plot([0, 2], [100, 200], label="twin")
    made = interactive(figure)
    fills = {shape.fillcolor for shape in made.layout.shapes if shape.type == "path"}
    assert {"rgba(255,0,0,0.5)", "rgba(0,255,0,1)"} <= fills
    assert {t.name for t in made.data if t.showlegend} == {"band", "span"}
    assert made.layout.xaxis2.type == made.layout.yaxis2.type == "log"
    np.testing.assert_allclose(made.layout.xaxis2.range, np.log10(right.get_xlim()))
    slope = one(made, "scatter", name="slope")
    assert (slope.line.dash, slope.marker.symbol) == ("dash", "square")
    texts = {a.text: a for a in made.layout.annotations}
    assert texts["in the middle"].xref == "x domain"
    assert (texts["here"].x, texts["here"].y) == (1.0, -2.0)  # exponents, on such axes
    assert one(made, "scatter", xaxis="x3").marker.color[1] == "rgba(0,128,0,1)"
    assert one(made, "heatmap").z[1][2] == 3
    over = one(made, "scatter", name="twin")
    assert made.layout[over.yaxis.replace("y", "yaxis")].overlaying == "y"
    assert over.xaxis == "x"


def test_polar_axes_and_shared_axes():
    figure, ((ax,),) = new_polar_figure(1, 1, "polar")
    ax.plot([0, np.pi / 2], [1, 2])
    (trace,) = interactive(figure).data
    np.testing.assert_allclose(trace.theta, [0, 90])
    figure, axes = new_figure(2, 1, (6, 5), "shared")
    for ax in axes[:, 0]:
        crank_axis(ax)
    assert interactive(figure).layout.xaxis2.matches == "x"


def test_bars_are_told_by_the_names_that_the_axes_below_show():
    figure, axes = new_figure(2, 1, (6, 5), "shared")
    for ax in axes[:, 0]:
        ax.bar([0, 1], [2, 3])
        ax.set_xticks([0, 1], ["left", "right"])
    made = interactive(figure)
    assert [[name for name, _ in bars.customdata] for bars in made.data] == [["left", "right"]] * 2
    assert made.layout.xaxis.showticklabels is False
    assert tuple(made.layout.xaxis2.ticktext) == ("left", "right")


def test_the_page_holds_every_picture_and_needs_no_network():
    figures = {name: new_figure(1, 1, (4, 3), name)[0] for name in ("first", "second")}
    page = interactive_page({**figures, "motion": b"GIF"}, "a & b")
    assert "<title>a &amp; b</title>" in page
    assert page.count("Plotly.newPlot(") == 2
    assert 'src="http' not in page


def test_without_plotly_the_option_says_what_to_install(monkeypatch):
    assert importlib.util.find_spec("plotly")
    monkeypatch.setitem(__import__("sys").modules, "plotly.graph_objects", None)
    with pytest.raises(BadInput, match=r"pip install \"jaxcomp\[interactive\]\""):
        interactive(new_figure(1, 1, (4, 3), "one")[0])
