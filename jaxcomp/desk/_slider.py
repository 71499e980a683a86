"""The slider of one number of the desk."""

from typing import Any

import panel as pn

_STEPS = 200
# On a phone a slider has a line of its own, on which its name has room.
_PLACE = """
:host { flex: 1 1 110px; min-width: 100px; }
.bk-slider-title { white-space: normal; }
@media (max-width: 480px) { :host { flex-basis: 95%; } }
"""


class _QuickSlider(pn.widgets.FloatSlider):
    """A slider that is heard at once: Panel gathers changes for 50 ms, which is most of an answer."""

    _debounce = 5


class Slider:
    """The slider of one number between two ends that can be typed."""

    def __init__(self, page: Any, name: str):
        self.page = page
        self.name = name
        desk = page.desk
        low, high = desk.range_of(name)
        self.look = look = desk.look(name, [low, high])
        self.ends = [self._end("from", low), self._end("to", high)]
        label = desk.label(name)
        if look.unit:
            label = f"{label} [{look.unit}]"
        value = self._value
        low = min(value, self.ends[0].value)
        high = max(value, self.ends[1].value)
        self.slider = _QuickSlider(
            label=label, start=low, end=high, step=(high - low) / _STEPS, value=value, format="0[.]00000",
            stylesheets=[_PLACE], margin=(5, 4),
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

    def _end(self, word: str, value: float) -> Any:
        """The field of an end [SI]."""
        shown = _short(self._shown(value))
        return pn.widgets.FloatInput(label=word, value=shown, width=96, margin=(5, 4))

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
        value = self._value
        low = self.slider.start
        high = self.slider.end
        if not low <= value <= high:
            lowest, highest = self.page.desk.range_of(self.name)
            low = min(low, _short(self._shown(lowest)), value)
            high = max(high, _short(self._shown(highest)), value)
        self._set(low, high)

    @property
    def _value(self) -> float:
        return self._shown(self.page.desk.values[self.name])

    def _moved(self, event) -> None:
        if not self._following:
            self.page.drag(self.name, self._si(event.new))

    def _let_go(self, event) -> None:
        if self._following:
            return
        # where it was let go may come before the last place that it was dragged to
        if event.new != self._value:
            self.page.drag(self.name, self._si(event.new))
        self.page.let_go()

    def _other_ends(self, _) -> None:
        if self._following:
            return
        low = self.ends[0].value
        high = self.ends[1].value
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


def _short(value: float) -> float:
    return float(f"{value:.6g}")
