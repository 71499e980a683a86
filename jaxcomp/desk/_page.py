r"""The page in the browser: sliders, fields and pictures around one `Desk`."""

import io
import re
import threading
from typing import Any

import pandas as pd
import panel as pn
from bokeh.models import HTMLTemplateFormatter
from panel.io import hold

from .._core.display import SYSTEMS
from .._core.errors import BadInput
from .._core.registry import HEADLINES
from .._core.status import SolveFailed
from ..scene import Scene, SceneError, loads
from ._page_layout import DARK, LIGHT, TABLE, WIDE, as_it_is, grid, sides
from ._pictures import Pictures
from ._slider import Slider
from ._state import Desk, Improvement

# Sliders that a fresh page has: those of the numbers that the chosen quantity gains most by.
_SLIDERS = 6
# How long what is compiled for the first time takes.
_WHILE = "some ten seconds, of a machine with valves a minute or two"
_WAITING = f"Computing the gains. The first time of a quantity takes {_WHILE}."
# Tabs compile one after another, and so the same program once.
_ONE_AT_A_TIME = threading.Lock()
# Columns of the gain: as a number, and as its text, which is shown.
_GAIN = ("Gain", "gain")
# Label of the button behind which a search goes on.
_STOP = "Stop searching"
# [s] What a tab waits for gains before it is shown without them.
_PATIENCE = 3.0


class SearchStopped(Exception):
    """A search that somebody stopped."""


class Page:
    """The widgets of one tab."""

    def __init__(self, scene: Scene, patience: float | None = None):
        self.body = pn.Column(styles=LIGHT, **WIDE)
        self.units = pn.widgets.Select(label="Units", options=list(SYSTEMS), width=110)
        self.units.param.watch(self._other_units, "value")
        self.dark = pn.widgets.Toggle(label="Dark", width=64, margin=(24, 10, 5, 5))
        self.dark.param.watch(self._other_shade, "value")
        self._request = 0
        self.open(scene, patience)

    def open(self, scene: Scene, patience: float | None = None) -> None:
        """Put a machine on the desk, in the place of the one that is there."""
        self.desk = Desk(scene)
        self.desk.system = self.units.value
        self._searched: Desk | None = None  # whose search goes on
        self._stop = threading.Event()  # of that search
        self._influences: dict[str, Any] = {}
        self._ask_gains(patience)
        self._lay_out(self._by_gain()[:_SLIDERS])
        if not self._influences:
            self.say(_WAITING, "info")

    def _lay_out(self, with_sliders: list[str]) -> None:
        """Lay the page out anew around the machine as it stands."""
        desk = self.desk
        scene = self.desk.scene
        self.sliders: dict[str, Slider] = {}
        self._target: tuple[str, float] | None = None
        self.pictures = Pictures(desk)
        self.message = pn.pane.Alert("", alert_type="warning", visible=False)
        self.state = pn.pane.Markdown("", styles={"font-size": "16px"}, margin=(0, 10), **WIDE)
        names = {desk.look(name, 1.0).words: name for name in desk.quantities}
        self.quantity = pn.widgets.Select(
            label="Quantity", options=names, value=desk.quantity, width=170
        )
        self.quantity.param.watch(self._other_quantity, "value")
        self.table = self._numbers_table()
        self.ranges = pn.Column(css_classes=["ranges"], **WIDE)
        self.results = pn.widgets.Tabulator(
            self._result_rows(), disabled=True, layout="fit_columns", **TABLE
        )
        self.buttons = self._new_buttons()
        self.warnings = pn.pane.Markdown("", **WIDE)
        self.gas = pn.pane.Markdown("", **WIDE)

        title = f"## {as_it_is(scene.name)}\n{as_it_is(scene.description)}"
        first, *panes = self._panes()
        controls = (
            pn.FlexBox(self.quantity, self.units, self.dark),
            pn.FlexBox(*self.buttons.values(), *self._files()),
        )
        self.body[:] = [
            sides(
                head=(pn.pane.Markdown(title, **WIDE), self.state, self.message),
                first=(first,),
                numbers=(*controls, self.warnings, self.ranges, self.table),
                rest=(grid(*panes), self.gas, self.results),
            )
        ]
        for name in with_sliders:
            self.add_slider(name)
        self._show()
        self._show_warnings()
        self._show_gas()

    def _new_buttons(self) -> dict[str, Any]:
        calls = {"Undo": self._undo, "Redo": self._redo, "Pin this state": self._pin}
        calls |= {"Sort by gain": self._sort, "Improve": self._improve}
        buttons = {}
        for name, call in calls.items():
            buttons[name] = pn.widgets.Button(label=name, on_click=call)
        buttons["Improve"].button_type = "primary"
        if self._searched is self.desk:
            buttons["Improve"].param.update(label=_STOP, button_type="danger")
        return buttons

    def _files(self) -> tuple[Any, Any]:
        """Controls that save the machine in a file, and open another one."""
        file = re.sub(r"[^\w.-]+", "-", self.desk.scene.name) or "machine"
        save = pn.widgets.FileDownload(
            callback=self._toml, filename=f"{file}.toml", label="Save as machine file"
        )
        load = pn.widgets.FileInput(accept=".toml", label="Open a machine file")
        load.param.watch(self._load, "value")
        return save, load

    def _panes(self) -> list[Any]:
        """The pictures, the first two together; the mechanism, if it can be drawn, has an angle."""
        first, *panes = [pn.pane.Bokeh(figure, **WIDE) for figure in self.pictures.figures]
        if self.pictures.outlines:
            angle = pn.widgets.IntSlider(label="Crank angle [°]", start=-180, end=180, value=60)
            angle.param.watch(lambda event: self.pictures.turn(event.new), "value")
            mechanism = pn.Column(panes.pop(), angle, **WIDE)
            # of a machine with valves their lift stands beside the indicator diagram
            place = 1 if self.desk.view.lifts else 0
            panes.insert(place, mechanism)
        return [grid(first, *panes[:1]), *panes[1:]]

    # ------------------------------------------------------------ what the user does

    def add_slider(self, name: str) -> None:
        """Give a number a slider, if it has none."""
        if name not in self.sliders:
            self.sliders[name] = Slider(self, name)
            self.ranges.append(self.sliders[name].row)

    def remove_slider(self, name: str) -> None:
        """Take the slider of a number away; its value stays."""
        self.ranges.remove(self.sliders.pop(name).row)

    def drag(self, name: str, value: float) -> None:
        """A slider stands at another value [SI]; if it moves on meanwhile, only the last one counts."""
        waits = self._target is not None
        self._target = (name, value)
        if pn.state.curdoc is None:
            self._drag()
        elif not waits:
            pn.state.curdoc.add_next_tick_callback(self._drag)

    def _drag(self) -> None:
        target = self._target
        self._target = None
        if target is None or target[1] == self.desk.values[target[0]]:
            return
        name, value = target
        self._tried(lambda: self.desk.move(name, value, dragging=True))
        self._show_row(name)
        if self.desk.values[name] != value and name in self.sliders:
            self.sliders[name].follow()  # the place was refused
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

    def _other_shade(self, event) -> None:
        styles = DARK if event.new else LIGHT
        self.body.param.update(styles=styles)

    def _other_units(self, event) -> None:
        self.desk.system = event.new
        self._lay_out(list(self.sliders))

    def _ask_gains(self, patience: float | None = None) -> None:
        """Compute the gains aside and wait so long [s] for them; those that come later are shown then."""
        self._request += 1
        number = self._request
        document = pn.state.curdoc
        desk = self.desk
        if patience is None and document is not None:
            patience = _PATIENCE
        rankings = []

        def work():
            with _ONE_AT_A_TIME:
                if number == self._request:
                    rankings.append(desk.gains().ranking(desk.quantity))
            if document is not None:
                _in_time(document, late)

        def late():
            if take():
                self._show_late_gains()

        def take():
            is_current = number == self._request and bool(rankings)
            if is_current:
                self._influences = {influence.number: influence for influence in rankings.pop()}
            return is_current

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        thread.join(patience)
        take()

    def _show_late_gains(self) -> None:
        self._fill_gains()
        if not self.sliders:
            for name in self._by_gain()[:_SLIDERS]:
                self.add_slider(name)
        if self.message.object == as_it_is(_WAITING):
            self.say("")

    def _undo(self, _) -> None:
        self._drag()
        if self.desk.undo():
            self.say("")
        else:
            self.say("There is nothing to undo.")
        self._show_all()

    def _redo(self, _) -> None:
        self._drag()
        if self.desk.redo():
            self.say("")
        else:
            self.say("There is nothing to do again.")
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
        desk = self.desk
        document = pn.state.curdoc
        if self._searched is desk:
            self._stop_search()
            return
        self._drag()
        ranges = {name: slider.range for name, slider in self.sliders.items()}
        if not ranges:
            self.say("Improve: click on numbers first, which then have a slider each to vary them.")
            return
        self._searched = desk
        stop = threading.Event()
        self._stop = stop
        self.buttons["Improve"].param.update(label=_STOP, button_type="danger")
        self.say(
            f"Searching between the ends of the sliders; the first search takes {_WHILE}.", "info"
        )

        def show_progress(stage, count, total):
            if stop.is_set():
                raise SearchStopped
            progress = f"{stage} {count} of {total}"
            _in_time(document, lambda: self._search_goes_on(desk, stop, progress))

        def work():
            try:
                outcome = desk.search(ranges, show_progress)
            except SearchStopped:
                return  # whoever stopped it has been answered
            except (BadInput, SolveFailed) as error:
                outcome = error
            _in_time(document, lambda: self._search_ended(desk, stop, outcome))

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        if document is None:
            thread.join()

    def _stop_search(self) -> None:
        """Answer at once; the search ends behind the design, or the program, at which it is."""
        self._stop.set()
        self._end_of_search("The search was stopped, and the machine stays as it stands.")

    def _end_of_search(self, text: str) -> None:
        self._searched = None
        self.buttons["Improve"].param.update(label="Improve", button_type="primary")
        self.say(text)

    def _search_goes_on(self, desk: Desk, stop: threading.Event, stage: str) -> None:
        if desk is self.desk and not stop.is_set():
            self.buttons["Improve"].label = f"{_STOP}: {stage}"

    def _search_ended(
        self, desk: Desk, stop: threading.Event, outcome: Improvement | Exception
    ) -> None:
        """Give the machine the improvement; nothing if it was stopped, or another machine opened."""
        if desk is not self.desk or stop.is_set():
            return
        self._drag()  # what was moved before the answer came counts as moved meanwhile
        if isinstance(outcome, Improvement):
            self._end_of_search(f"{outcome.quantity}: {desk.take(outcome)}")
        else:
            self._end_of_search(str(outcome))
        self._show_all()

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
        self._drag()
        try:
            return io.BytesIO(self.desk.toml().encode())
        except SceneError as error:
            self.say(str(error))

    # ------------------------------------------------------------ what the user sees

    def _show_row(self, name: str) -> None:
        """A number as it stands, in its row."""
        row = list(self.table.value["name"]).index(name)
        self.table.patch({"Value": [(row, self.desk.text(name))]})

    def _tried(self, change) -> None:
        try:
            change()
        except SceneError as error:
            self.say(str(error))
        else:
            self.say("")

    def say(self, text: str, kind: str = "warning") -> None:
        self.message.param.update(object=as_it_is(text), visible=bool(text), alert_type=kind)

    def _show_all(self) -> None:
        for slider in self.sliders.values():
            slider.follow()
        self.table.patch({"Value": list(enumerate(map(self.desk.text, self.table.value["name"])))})
        self._show_gains()
        self._show()
        self._show_warnings()
        self._show_gas()

    def _show_gas(self) -> None:
        lines = self.desk.gas_lines()
        self.gas.object = _bullets(lines)
        self.gas.visible = bool(lines)

    def _show_warnings(self) -> None:
        warnings = self.desk.warnings()
        self.warnings.object = _bullets(warnings, "Unusual: ")
        self.warnings.visible = bool(warnings)

    def _show(self) -> None:
        """Pictures and results of the present state, in one message to the browser."""
        desk = self.desk
        view = self.desk.view
        named = ""
        value = view.quantities.get(desk.quantity)
        if value is not None:
            look = desk.look(desk.quantity, value)
            named = f"**{as_it_is(look.words)}: {look.text(float(value))}**"
        for name in HEADLINES:
            if name in view.quantities and name != desk.quantity:
                size = view.quantities[name]
                look = desk.look(name, size)
                named += f" · {as_it_is(look.words)}: {look.text(float(size))}"
        with hold():
            self.pictures.show(view, desk.pinned)
            rows = self._result_rows()
            moving = {}
            for column in rows:
                if column in ("Now", "Difference"):
                    moving[column] = list(enumerate(rows[column]))
            self.results.patch(moving)
            self.state.object = f"{named} {view.status and f'⚠ {as_it_is(view.status)}'}"

    def _show_gains(self) -> None:
        self._ask_gains()
        self._fill_gains()

    def _fill_gains(self) -> None:
        gains = self._gains()
        rises = []
        changes = []
        for row, name in enumerate(self.table.value["name"]):
            rise, change = gains[name]
            rises.append((row, rise))
            changes.append((row, change))
        self.table.patch({_GAIN[0]: rises, _GAIN[1]: changes})

    def _gains(self) -> dict[str, tuple[float, str]]:
        """Gain of every number as a number, which sorts, and in words."""
        influences = self._influences
        without = "none" if influences else "..."
        gains = {}
        for name in self.desk.numbers:
            influence = influences.get(name)
            if influence is None:
                gains[name] = (0.0, without)
            else:
                gains[name] = (influence.rise, influence.change)
        return gains

    def _by_gain(self) -> list[str]:
        """The numbers, that with the largest gain first; empty while gains are computed."""
        influences = self._influences
        if not influences:
            return []
        return list(dict.fromkeys([*influences, *self.desk.numbers]))

    def _numbers_table(self) -> Any:
        desk = self.desk
        gains = self._gains()
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
            **TABLE,
        )
        table.on_edit(self._entered)
        table.on_click(self._clicked)
        return table

    def _result_rows(self) -> Any:
        desk = self.desk
        pinned = self.desk.pinned
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


def _bullets(texts: list[str], opening: str = "") -> str:
    """A list in Markdown, each text as it is behind an opening."""
    return "\n".join(f"- {opening}{as_it_is(text)}" for text in texts)


def _in_time(document: Any, call) -> None:
    """Call when the page of a document has time, if it is still open; at once without a document."""
    if document is None:
        call()
    elif document.session_context is not None and not document.session_context.destroyed:
        document.add_next_tick_callback(call)
