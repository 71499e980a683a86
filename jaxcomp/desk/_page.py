r"""The page in the browser: sliders, fields and pictures around one `Desk`."""

import io
import logging
import re
import threading
from typing import Any

import numpy as np
import pandas as pd
import panel as pn
from bokeh.models import ColumnDataSource, FactorRange, HTMLTemplateFormatter, Title
from bokeh.plotting import figure
from panel.io import hold
from tornado.websocket import WebSocketClosedError

from .._core.display import SYSTEMS
from .._core.errors import BadInput
from .._core.status import SolveFailed
from ..plot.interface import INK, colour, line_look, words
from ..scene import Scene, SceneError, loads
from ._state import HEADLINES, Desk, View

# Sliders that a fresh page has: those of the numbers that the chosen quantity gains most by.
_SLIDERS = 6
_STEPS = 200
# How long what is compiled for the first time takes.
_WHILE = "some ten seconds, of a machine with valves a minute or two"
_WAITING = f"Computing the gains. The first time of a quantity takes {_WHILE}."
# Tabs compile one after another, and so the same program once.
_ONE_AT_A_TIME = threading.Lock()
# Columns of the gain: as a number, and as its text, which is shown.
_GAIN = ("Gain", "gain")
# Punctuation; Markdown takes each as it is behind a backslash.
_SIGN = re.compile(r"([!-/:-@\[-`{-~])")
_PINNED = "#AAAAAA"
# [s] What a tab waits for gains before it is shown without them.
_PATIENCE = 3.0
# [s] The same before the browser is opened.
_AT_FIRST = 15.0
# Units of the pictures, which stay while numbers are dragged.
_AXES = {
    "m^3": (1e6, "cm³"), "Pa": (1e-6, "MPa"), "lift": (1e3, "mm"), "N": (1.0, "N"),
    "film": (1e6, "µm"), "W": (1.0, "W"),
}  # fmt: skip
_AXES_US = _AXES | {
    "m^3": (0.0254**-3, "in³"), "Pa": (1 / 6894.757, "psi"), "lift": (1 / 0.0254, "in"),
    "N": (1 / 4.448222, "lbf"), "film": (1e6 / 0.0254, "µin"),
}  # fmt: skip
# A dark page shows every colour, also of the pictures, with its lightness turned round.
_LIGHT = {"background": "white", "box-shadow": "0 0 0 24px white", "min-height": "100vh"}
_DARK = _LIGHT | {"filter": "invert(0.9) hue-rotate(180deg)"}
_WIDE = {"sizing_mode": "stretch_width"}
_TABLE = {"show_index": False} | _WIDE
# Side by side where there is room; on a phone the first picture stands before the numbers.
_SIDES = """
:host { display: grid !important; gap: 14px; grid-template: "head head" auto "numbers first" auto
  "numbers rest" 1fr / minmax(330px, 470px) minmax(0, 1fr); }
@media (max-width: 860px) { :host { gap: 8px; grid-template: "head" auto "first" auto "numbers" auto
  "rest" auto / minmax(0, 1fr); } }
"""
_CARD = """
:host { background: white; border: 1px solid #e3e6ea; border-radius: 8px; padding: 10px;
  box-sizing: border-box; min-width: 0; }
"""
_GRID = """
:host { display: grid !important; gap: 8px;
  grid-template-columns: repeat(auto-fit, minmax(min(310px, 100%), 1fr)); }
"""


def serve(scene: Scene, *, port: int = 0, show: bool = True, threaded: bool = False) -> Any:
    """Serve the desk of a machine on this computer alone, a fresh one for every tab.

    Args:
        scene: of `jaxcomp.load`.
        port: of the loopback address; a free one if 0.
        show: open a browser.
        threaded: return at once, with the server; otherwise when it is interrupted.
    """
    pn.extension("tabulator")
    logging.getLogger("asyncio").addFilter(_is_fault)
    # compiles what all pages share; of large machines the gains follow later
    _Page(scene, _AT_FIRST)
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
    return _Page(scene).body


class _Page:
    """The widgets of one tab."""

    def __init__(self, scene: Scene, patience: float | None = None):
        self.body = pn.Column(styles=_LIGHT, **_WIDE)
        self.units = pn.widgets.Select(label="Units", options=list(SYSTEMS), width=110)
        self.units.param.watch(self._other_units, "value")
        self.dark = pn.widgets.Toggle(label="Dark", width=64, margin=(24, 10, 5, 5))
        self.dark.param.watch(
            lambda event: self.body.param.update(styles=_DARK if event.new else _LIGHT), "value"
        )
        self._asked = 0
        self.open(scene, patience)

    def open(self, scene: Scene, patience: float | None = None) -> None:
        """Put a machine on the desk, in the place of the one that is there."""
        self.desk = Desk(scene)
        self.desk.system = self.units.value
        self._influences: dict[str, Any] = {}
        self._ask_gains(patience)
        self._lay_out(self._by_gain()[:_SLIDERS])
        if not self._influences:
            self.say(_WAITING, "info")

    def _lay_out(self, with_sliders: list[str]) -> None:
        """Lay the page out anew around the machine as it stands."""
        desk, scene = self.desk, self.desk.scene
        self.sliders: dict[str, _Slider] = {}
        self._wanted: tuple[str, float] | None = None
        self.pictures = _Pictures(desk)
        self.message = pn.pane.Alert("", alert_type="warning", visible=False)
        self.state = pn.pane.Markdown("", styles={"font-size": "16px"}, margin=(0, 10), **_WIDE)
        names = {desk.look(name, 1.0).words: name for name in desk.quantities}
        self.quantity = pn.widgets.Select(
            label="Quantity", options=names, value=desk.quantity, width=170
        )
        self.quantity.param.watch(self._other_quantity, "value")
        self.table = self._numbers_table()
        self.ranges = pn.Column(css_classes=["ranges"], **_WIDE)
        self.results = pn.widgets.Tabulator(
            self._result_rows(), disabled=True, layout="fit_columns", **_TABLE
        )
        calls = {
            "Undo": self._undo,
            "Redo": self._redo,
            "Pin this state": self._pin,
            "Sort by gain": self._sort,
            "Improve": self._improve,
        }
        self.buttons = {
            name: pn.widgets.Button(label=name, on_click=call) for name, call in calls.items()
        }
        self.buttons["Improve"].button_type = "primary"
        file = re.sub(r"[^\w.-]+", "-", scene.name) or "machine"
        save = pn.widgets.FileDownload(
            callback=self._toml, filename=f"{file}.toml", label="Save as machine file"
        )
        load = pn.widgets.FileInput(accept=".toml", label="Open a machine file")
        load.param.watch(self._load, "value")
        self.warnings = pn.pane.Markdown("", **_WIDE)

        def area(name, *parts):
            return pn.Column(*parts, styles={"grid-area": name}, stylesheets=[_CARD], **_WIDE)

        title = f"## {_as_it_is(scene.name)}\n{_as_it_is(scene.description)}"
        first, *rest = [pn.pane.Bokeh(one, **_WIDE) for one in self.pictures.figures]
        drawing = []
        if self.pictures.outlines:
            angle = pn.widgets.IntSlider(label="Crank angle [°]", start=-180, end=180, value=60)
            angle.param.watch(lambda event: self.pictures.turn(event.new), "value")
            drawing = [pn.Column(rest.pop(), angle, **_WIDE)]
        front = pn.Column(first, *drawing, stylesheets=[_GRID], **_WIDE)
        self.body[:] = [
            pn.Column(
                area("head", pn.pane.Markdown(title, **_WIDE), self.state, self.message),
                area("first", front),
                area(
                    "numbers",
                    pn.FlexBox(self.quantity, self.units, self.dark),
                    pn.FlexBox(*self.buttons.values(), save, load),
                    self.warnings,
                    self.ranges,
                    self.table,
                ),
                area("rest", pn.Column(*rest, stylesheets=[_GRID], **_WIDE), self.results),
                stylesheets=[_SIDES],
                **_WIDE,
            )
        ]
        for name in with_sliders:
            self.add_slider(name)
        self._show()
        self._show_warnings()

    # ------------------------------------------------------------ what the user does

    def add_slider(self, name: str) -> None:
        """Give a number a slider, if it has none."""
        if name not in self.sliders:
            self.sliders[name] = _Slider(self, name)
            self.ranges.append(self.sliders[name].row)

    def remove_slider(self, name: str) -> None:
        """Take the slider of a number away; its value stays."""
        self.ranges.remove(self.sliders.pop(name).row)

    def drag(self, name: str, value: float) -> None:
        """A slider stands at another value [SI]; if it moves on meanwhile, only the last one counts."""
        waits, self._wanted = self._wanted is not None, (name, value)
        if pn.state.curdoc is None:
            self._drag()
        elif not waits:
            pn.state.curdoc.add_next_tick_callback(self._drag)

    def _drag(self) -> None:
        wanted, self._wanted = self._wanted, None
        if wanted is None or wanted[1] == self.desk.values[wanted[0]]:
            return
        self._tried(lambda: self.desk.move(*wanted, dragging=True))
        self._show()

    def let_go(self) -> None:
        """A slider was let go: its way is one change, and what is slow to follow it follows now."""
        self._drag()
        self.desk.let_go()
        self._show_all()

    def _entered(self, event) -> None:
        if event.column == "Value":
            self._drag()
            name = self.table.value["name"].iloc[event.row]
            self._tried(lambda: self.desk.enter(name, str(event.value)))
            self._show_all()

    def _clicked(self, event) -> None:
        if event.column != "Value":
            self.add_slider(self.table.value["name"].iloc[event.row])

    def _other_quantity(self, event) -> None:
        self.desk.quantity = event.new
        self._influences = {}
        self._show_gains()
        self._show()
        if not self._influences:
            self.say(_WAITING, "info")

    def _other_units(self, event) -> None:
        self.desk.system = event.new
        self._lay_out(list(self.sliders))

    def _ask_gains(self, patience: float | None = None) -> None:
        """Compute the gains aside and wait so long [s] for them; those that come later are shown then."""
        self._asked += 1
        number, document, desk = self._asked, pn.state.curdoc, self.desk
        if patience is None and document is not None:
            patience = _PATIENCE
        found = []

        def work():
            with _ONE_AT_A_TIME:
                if number == self._asked:
                    found.append(desk.gains().ranking(desk.quantity))
            if document is not None:
                _in_time(document, late)

        def late():
            if not take():
                return
            self._fill_gains()
            for name in () if self.sliders else self._by_gain()[:_SLIDERS]:
                self.add_slider(name)
            if self.message.object == _as_it_is(_WAITING):
                self.say("")

        def take():
            ours = number == self._asked and bool(found)
            if ours:
                self._influences = {one.number: one for one in found.pop()}
            return ours

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        thread.join(patience)
        take()

    def _undo(self, _) -> None:
        self._drag()
        self.say("" if self.desk.undo() else "There is nothing to undo.")
        self._show_all()

    def _redo(self, _) -> None:
        self._drag()
        self.say("" if self.desk.redo() else "There is nothing to do again.")
        self._show_all()

    def _pin(self, _) -> None:
        self.desk.pin()
        self.results.value = self._result_rows()
        self._show()

    def _sort(self, _) -> None:
        # another order of the rows, which a header that sorts would hide; patches go by the index
        rows = self.table.value
        place = {name: number for number, name in enumerate(self._by_gain())}
        self.table.sorters = []
        self.table.value = rows.sort_values(
            "name", key=lambda names: names.map(place), ignore_index=True
        )

    def _improve(self, _) -> None:
        ranges = {name: one.range for name, one in self.sliders.items()}
        button, document = self.buttons["Improve"], pn.state.curdoc
        button.loading = True
        self.say(
            f"Searching between the ends of the sliders; the first search takes {_WHILE}.", "info"
        )

        def told(stage, done, most):
            later(lambda: setattr(button, "label", f"Improve: {stage}, {done} of {most}"))

        def later(call):
            call() if document is None else _in_time(document, call)

        def done(words):
            button.loading, button.label = False, "Improve"
            self.say(words)
            self._show_all()

        def work():
            try:
                words = f"{self.desk.quantity}: {self.desk.improve(ranges, told)}"
            except (BadInput, SolveFailed) as error:
                words = str(error)
            later(lambda: done(words))

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        if document is None:
            thread.join()

    def _load(self, event) -> None:
        if not event.new:
            return
        try:
            scene = loads(event.new, event.obj.filename or "", beside=False)
        except SceneError as error:
            self.say("\n\n".join(map(str, (error, *error.others))))
            return
        self.open(scene)

    def _toml(self) -> io.BytesIO | None:
        try:
            return io.BytesIO(self.desk.toml().encode())
        except SceneError as error:
            self.say(str(error))

    # ------------------------------------------------------------ what the user sees

    def _tried(self, change) -> None:
        try:
            change()
        except SceneError as error:
            self.say(str(error))
        else:
            self.say("")

    def say(self, text: str, kind: str = "warning") -> None:
        self.message.param.update(object=_as_it_is(text), visible=bool(text), alert_type=kind)

    def _show_all(self) -> None:
        for slider in self.sliders.values():
            slider.follow()
        self.table.patch({"Value": list(enumerate(map(self.desk.text, self.table.value["name"])))})
        self._show_gains()
        self._show()
        self._show_warnings()

    def _show_warnings(self) -> None:
        found = self.desk.warnings()
        self.warnings.object = "\n".join(f"- Unusual: {_as_it_is(one)}" for one in found)
        self.warnings.visible = bool(found)

    def _show(self) -> None:
        """Pictures and results of the present state, in one message to the browser."""
        desk, view, named = self.desk, self.desk.view, ""
        value = view.quantities.get(desk.quantity)
        if value is not None:
            look = desk.look(desk.quantity, value)
            named = f"**{_as_it_is(look.words)}: {look.text(float(value))}**"
        for name in HEADLINES:
            if name in view.quantities and name != desk.quantity:
                size = view.quantities[name]
                look = desk.look(name, size)
                named += f" · {_as_it_is(look.words)}: {look.text(float(size))}"
        with hold():
            self.pictures.show(view, desk.pinned)
            rows = self._result_rows()
            moving = [column for column in rows if column in ("Now", "Difference")]
            self.results.patch({column: list(enumerate(rows[column])) for column in moving})
            self.state.object = f"{named} {view.status and f'⚠ {_as_it_is(view.status)}'}"

    def _show_gains(self) -> None:
        self._ask_gains()
        self._fill_gains()

    def _fill_gains(self) -> None:
        gains = self._gains()
        columns = zip(*(gains[name] for name in self.table.value["name"]), strict=True)
        self.table.patch(
            {key: list(enumerate(column)) for key, column in zip(_GAIN, columns, strict=True)}
        )

    def _gains(self) -> dict[str, tuple[float, str]]:
        """Gain of every number as a number, which sorts, and in words."""
        none = 0.0, "none" if self._influences else "..."
        gains = {name: (one.rise, one.change) for name, one in self._influences.items()}
        return {name: gains.get(name, none) for name in self.desk.numbers}

    def _by_gain(self) -> list[str]:
        """The numbers, that with the largest gain first; empty while gains are computed."""
        return (
            list(dict.fromkeys([*self._influences, *self.desk.numbers])) if self._influences else []
        )

    def _numbers_table(self) -> Any:
        desk, gains = self.desk, self._gains()
        rows = {
            "name": list(desk.numbers),
            "Number": [desk.label(name) for name in desk.numbers],
            "Value": [desk.text(name) for name in desk.numbers],
        }
        rows |= dict(zip(_GAIN, zip(*gains.values(), strict=True), strict=True))
        table = pn.widgets.Tabulator(
            pd.DataFrame(rows),
            hidden_columns=["name", _GAIN[1]],
            editors={"Number": None, _GAIN[0]: None, "Value": {"type": "input"}},
            formatters={_GAIN[0]: HTMLTemplateFormatter(template=f"<%- {_GAIN[1]} %>")},
            header_filters={"Number": {"type": "input", "placeholder": "filter"}},
            widths={"Number": "40%", "Value": "29%", "Gain": "31%"},
            height=420,
            css_classes=["numbers"],
            **_TABLE,
        )
        table.on_edit(self._entered)
        table.on_click(self._clicked)
        return table

    def _result_rows(self) -> Any:
        desk, pinned = self.desk, self.desk.pinned
        rows = []
        first = [name for name in HEADLINES if name in desk.view.quantities]
        for name in dict.fromkeys([*first, *desk.view.quantities]):
            value = desk.view.quantities[name]
            look = desk.look(name, value)
            row = {"Result": look.words, "Now": look.text(float(value))}
            if pinned is not None:
                before = float(pinned.quantities[name])
                row["Pinned"] = look.text(before)
                row["Difference"] = look.difference(float(value) - before, 3)
            rows.append(row)
        return pd.DataFrame(rows)


class _QuickSlider(pn.widgets.FloatSlider):
    """A slider that is heard at once: Panel gathers changes for 50 ms, which is most of an answer."""

    _debounce = 5


class _Slider:
    """The slider of one number between two ends that can be typed."""

    def __init__(self, page: _Page, name: str):
        self.page, self.name, desk = page, name, page.desk
        low, high = desk.range_of(name)
        self.look = look = desk.look(name, [low, high])
        self.ends = [
            pn.widgets.FloatInput(
                label=word, value=_short(self._shown(end)), width=82, margin=(5, 4)
            )
            for word, end in (("from", low), ("to", high))
        ]
        label = f"{desk.label(name)}{f' [{look.unit}]' if look.unit else ''}"
        value = self._value
        low, high = min(value, self.ends[0].value), max(value, self.ends[1].value)
        self.slider = _QuickSlider(
            label=label, start=low, end=high, step=(high - low) / _STEPS, value=value, format="0[.]00000",
            styles={"flex": "1 1 110px", "min-width": "100px"}, margin=(5, 4),
        )  # fmt: skip
        # what the desk sets is no drag; some versions of Panel move a slider when its ends move
        self._following = False
        self.slider.param.watch(self._moved, "value")
        self.slider.param.watch(self._let_go, "value_throttled")
        for end in self.ends:
            end.param.watch(self._other_ends, "value")
        remove = pn.widgets.Button(label="×", width=30, margin=(5, 0))
        remove.on_click(lambda _: page.remove_slider(name))
        self.row = pn.FlexBox(self.slider, *self.ends, remove, align_items="end")

    @property
    def range(self) -> tuple[float, float]:
        """[SI] The ends."""
        return self._si(self.slider.start), self._si(self.slider.end)

    def _shown(self, value: float) -> float:
        return self.look.of(value)

    def _si(self, value: float) -> float:
        return (value - self.look.zero) / self.look.factor

    def follow(self) -> None:
        """Stand where the number stands, between ends that hold it."""
        value, low, high = self._value, self.slider.start, self.slider.end
        if not low <= value <= high:
            wide = [self._shown(end) for end in self.page.desk.range_of(self.name)]
            low, high = min(low, _short(wide[0]), value), max(high, _short(wide[1]), value)
        self._set(low, high)

    @property
    def _value(self) -> float:
        return self._shown(self.page.desk.values[self.name])

    def _moved(self, event) -> None:
        if not self._following:
            self.page.drag(self.name, self._si(event.new))

    def _let_go(self, _) -> None:
        if not self._following:
            self.page.let_go()

    def _other_ends(self, _) -> None:
        if self._following:
            return
        low, high = (end.value for end in self.ends)
        bound = self.page.desk.numbers[self.name].bound
        numbers = None not in (low, high)
        if not numbers or not (
            low < high and all(bound.holds(self._si(end)) for end in (low, high))
        ):
            self.page.say(f"{self.name}: the ends of the range must rise and be {bound}")
        elif not low <= self._value <= high:
            text = self.page.desk.text(self.name)
            self.page.say(f"{self.name}: the range must hold the present value, {text}")
        else:
            self._set(low, high)
            return
        self._set(self.slider.start, self.slider.end)

    def _set(self, low: float, high: float) -> None:
        """Ends and value in one change."""
        self._following = True
        try:
            step = (high - low) / _STEPS
            self.slider.param.update(start=low, end=high, step=step, value=self._value)
            for field, end in zip(self.ends, (low, high), strict=True):
                field.value = end
        finally:
            self._following = False


class _Pictures:
    """Pictures whose curves and bars follow, each with the pinned state in grey behind it."""

    def __init__(self, desk: Desk):
        self.desk, view = desk, desk.view
        self.sources: dict[str, ColumnDataSource] = {}
        self.figures = []
        for title, (x, y, parts) in _drawn(view, desk.system).items():
            bars = parts.get("")
            rows = {} if bars is None else {"y_range": FactorRange(*reversed(bars["y"]))}
            plot: Any = figure(
                title=Title(text=title, text_color=INK), x_axis_label=x, y_axis_label=y, height=260,
                tools="pan,wheel_zoom,reset", toolbar_location="above", **rows, **_WIDE,
            )  # fmt: skip
            plot.toolbar.logo = None
            for name, columns in parts.items():
                # a joint has one colour in all pictures
                place = list(view.forces).index(name) if name in view.forces else 0
                for pinned in (True, False):
                    key = f"{title}.{name}.{pinned}"
                    source = ColumnDataSource({column: [] for column in columns}, name=key)
                    self.sources[key] = source
                    paint = _PINNED if pinned else colour(name or "crank_pin", place)
                    if bars is None:
                        label = {} if pinned or len(parts) == 1 else {"legend_label": words(name)}
                        plot.line("x", "y", source=source, color=paint, line_width=2, **label)
                    else:
                        height = 0.8 if pinned else 0.5
                        plot.hbar(y="y", right="right", height=height, source=source, color=paint)
            if bars is not None:
                plot.x_range.start = 0
            elif len(parts) > 1:
                legend = plot.legend[0]
                # so many columns as the narrowest picture has room for
                columns = max(1, 52 // (6 + max(len(words(name)) for name in parts)))
                legend.update(orientation="horizontal", label_text_font_size="8pt", ncols=columns)
                plot.height += 20 * (-(-len(parts) // columns) - 1)
                legend.update(click_policy="hide", border_line_color=None, padding=0)
                plot.add_layout(legend, "above")
            self.figures.append(plot)
        self.angle, self.outlines = np.deg2rad(60.0), {}
        for name in desk.front_view(self.angle):
            self.outlines[name] = ColumnDataSource({"x": [], "y": []})
        if self.outlines:
            self.figures.append(self._mechanism())

    def _mechanism(self) -> Any:
        plot: Any = figure(
            title=Title(text="Mechanism", text_color=INK), height=260, match_aspect=True, tools="",
            toolbar_location=None, **_WIDE,
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
        for behind, one in ((True, pinned), (False, view)):
            drawn = {} if one is None else _drawn(one, self.desk.system)
            for title, (_, _, parts) in drawn.items():
                for name, columns in parts.items():
                    self.sources[f"{title}.{name}.{behind}"].data = columns


def _in_time(document: Any, call) -> None:
    """Call when the page of a document has time, if it is still open."""
    if document.session_context is not None and not document.session_context.destroyed:
        document.add_next_tick_callback(call)


def _drawn(view: View, system: str) -> dict[str, tuple[str, str, dict[str, dict[str, Any]]]]:
    """Labels of both axes, and columns of data by curve, of every picture that this machine has.

    Bars are the columns of the name "".
    """
    out, axes = {}, _AXES_US if system == "US" else _AXES
    if view.pressure is not None:
        (by_x, x_unit), (by_y, y_unit) = axes["m^3"], axes["Pa"]
        x, y = (np.append(curve, curve[0]) for curve in (view.volume * by_x, view.pressure * by_y))
        curves = {"gas": {"x": x, "y": y}}
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
            curves = {
                name: {"x": degrees[order], "y": factor * one[order]}
                for name, one in values.items()
            }
            out[title] = "Crank angle, degrees", label, curves
    losses = {words(name): one for name, one in view.losses.items()}
    uses = {words(name): one for name, one in view.power_use.items()}
    vibration = {}
    for name, (now, after) in view.vibration.items():
        vibration |= {name: now, f"{name}, balanced": after}
    for title, kind, sizes in (
        ("Power use", "W", uses),
        ("Friction losses", "W", losses),
        ("Vibration of the targets", "film", vibration),
    ):
        if sizes:
            factor, unit = axes[kind]
            bars = {"y": list(sizes), "right": [factor * float(size) for size in sizes.values()]}
            out[title] = unit, "", {"": bars}
    return out


def _as_it_is(text: str) -> str:
    """A text whose signs mean nothing to Markdown and HTML, such as one from a file."""
    return _SIGN.sub(r"\\\1", text)


def _short(value: float) -> float:
    return float(f"{value:.6g}")
