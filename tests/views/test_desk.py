"""The desk: a machine whose numbers move, headless, as a page of Panel, and in a real browser."""

import dataclasses
import html
import json
import logging
import re
import shutil
import socket
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from jaxcomp import load, solve_orbit
from jaxcomp.cli import app
from jaxcomp.desk import _state as state
from jaxcomp.desk import serve
from jaxcomp.desk._page import Page
from jaxcomp.desk._serve import _is_fault
from jaxcomp.desk._state import Desk
from jaxcomp.scene import SceneError, loads, start

BORE, PIN = "mechanism.bore", "friction.crank_pin.coefficient"
PRESSURE, MOVED = "suction pressure", "0.1078 MPa"
# How a search ends.
FOUND = re.compile("converged|no better step|step limit")
# Without what a browser looks for on the network by itself.
CHROMIUM = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync")


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


@pytest.fixture(scope="module")
def page(scene):
    return Page(scene)


@pytest.fixture
def desk(scene, page):  # after the page, which compiled what both use
    del page
    return Desk(scene)


def efficiency(desk):
    return float(desk.view.quantities["mechanical_efficiency"])


# ---------------------------------------------------------------- without a page


def test_results_are_those_of_the_library(desk):
    desk.move(BORE, 0.125)
    orbit = solve_orbit(desk.changed_scene().compressor)
    assert efficiency(desk) == pytest.approx(float(orbit.mechanical_efficiency), rel=1e-12)
    for name, power in orbit.loss_power.items():
        assert float(desk.view.losses[name]) == pytest.approx(float(power), rel=1e-12)
    assert not desk.view.status
    # pictures look between the nodes, where a peak may be a little higher
    for name, peak in orbit.peak_forces.items():
        assert desk.view.forces[name].max() == pytest.approx(float(peak), rel=1e-3)


def test_gains_are_differences(desk):
    found = desk.gains()
    place = list(found.numbers).index(PIN)
    before, value, step = efficiency(desk), desk.values[PIN], 1e-4
    desk.move(PIN, value * (1 + step))
    after = efficiency(desk)
    desk.move(PIN, value * (1 - step))
    # central differences with a step of 1e-4: 1e-8 of the third derivative, and rounding 1e-12 / 1e-4
    slope = (after - efficiency(desk)) / (2 * step * before)
    assert found.elasticity[0, place] == pytest.approx(slope, rel=1e-5)


def test_every_number_moves_itself_alone(desk):
    for name in desk.numbers:
        moved = desk.numbers[name].moved(desk.machine, desk.values[name] * 1.001 + 1e-9)
        changed = {
            other
            for other, one in desk.numbers.items()
            if np.any(np.asarray(one.at(moved)) != np.asarray(one.at(desk.machine)))
        }
        assert changed == {name}


def test_undo_and_dragging(desk):
    start = efficiency(desk)
    for value in (0.131, 0.132, 0.133):
        desk.move(BORE, value, dragging=True)
    assert desk.changes == (1, 0)
    dragged = efficiency(desk)
    assert desk.undo()
    assert desk.values[BORE] == 0.13
    assert efficiency(desk) == start
    assert not desk.undo()
    assert desk.redo()
    assert desk.values[BORE] == 0.133
    assert efficiency(desk) == dragged
    assert not desk.redo()


def test_a_value_typed_between_two_drags_is_a_change_of_its_own(desk):
    desk.move(BORE, 0.131, dragging=True)  # and let go where nobody sees it
    desk.enter(BORE, "140 mm")
    desk.move(BORE, 0.132, dragging=True)
    desk.move(BORE, 0.133, dragging=True)
    seen = []
    while desk.undo():
        seen.append(desk.values[BORE])
    assert seen == [0.14, 0.131, 0.13]
    desk.redo()
    desk.enter(PIN, "0.02")  # what was undone before is gone
    assert not desk.redo()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("13 kg", "m"),
        ("13", "lacks its unit"),
        ("0 mm", "must be > 0 m"),
        ("wide", "is no number"),
        ("30 m", "mechanism"),  # a rule between the dimensions
    ],
)
def test_wrong_input_has_the_message_of_a_machine_file(desk, text, words):
    before = desk.values["mechanism.crank_radius"]
    with pytest.raises(SceneError, match=words) as error:
        desk.enter("mechanism.crank_radius", text)
    assert "mechanism" in str(error.value)
    assert desk.values["mechanism.crank_radius"] == before
    assert desk.changes == (0, 0)
    assert not desk.view.status


def test_saved_file_is_the_machine(desk):
    desk.enter(BORE, "127.5 mm")
    again = Desk(loads(desk.toml()))
    assert again.values[BORE] == pytest.approx(0.1275, rel=1e-15)
    assert efficiency(again) == pytest.approx(efficiency(desk), rel=1e-14)
    assert "set at the desk" in desk.toml()


def test_a_machine_that_locks_says_so(desk):
    desk.move("friction.wall.coefficient", 40.0)
    assert "locks" in desk.view.status


@pytest.mark.slow
def test_improve_stays_inside_its_ranges_and_is_better(desk):
    before = efficiency(desk)
    words = desk.improve({BORE: (0.12, 0.14)})
    assert 0.12 <= desk.values[BORE] <= 0.14
    assert efficiency(desk) > before
    assert "converged" in words
    desk.undo()
    assert efficiency(desk) == before


def check_is_what_is_shown(desk):
    """Machine, saved file and results are those of the values that the desk shows."""
    for name, one in desk.numbers.items():
        again = one.moved(desk.machine, desk.values[name])
        assert np.array_equal(np.asarray(one.at(again)), np.asarray(one.at(desk.machine)))
    saved = Desk(loads(desk.toml()))
    assert saved.values == pytest.approx(desk.values, rel=1e-14)
    assert efficiency(saved) == pytest.approx(efficiency(desk), rel=1e-13)


@pytest.fixture
def search(monkeypatch):
    """A search that ends at 125 mm, and whatever it is told to do before it does."""
    meanwhile = []

    def found(asked, callback=None, **_):
        for call in meanwhile:
            call()
        values = {one.name: 0.125 for one in asked.variables}
        return SimpleNamespace(values=values, objective=0.92, status="converged")

    monkeypatch.setattr("jaxcomp.desk._state.optimise", found)
    return meanwhile


def test_what_is_moved_while_a_search_goes_on_is_kept(desk, search):
    pressure = next(name for name in desk.numbers if name.endswith("suction_pressure"))
    moved = desk.values[pressure] * 1.1
    search.append(lambda: desk.move(pressure, moved))
    search.append(lambda: desk.enter(BORE, "140 mm"))
    words = desk.improve({BORE: (0.12, 0.14)})
    assert desk.values[pressure] == moved
    assert desk.values[BORE] == 0.125
    assert f"{desk.label(pressure)}: as moved since" in words
    assert f"{desk.label(BORE)}: as found" in words
    check_is_what_is_shown(desk)
    desk.undo()
    assert desk.values[BORE] == 0.14
    check_is_what_is_shown(desk)


def test_what_is_undone_while_a_search_goes_on_stays_undone(desk, search):
    desk.enter(PIN, "0.02")
    before = efficiency(desk)
    search.append(desk.undo)
    desk.improve({BORE: (0.12, 0.14)})
    assert desk.values[PIN] == desk.numbers[PIN].value
    check_is_what_is_shown(desk)
    desk.undo()
    desk.undo()
    assert efficiency(desk) != before


# ---------------------------------------------------------------- the page


def test_a_search_for_a_machine_that_was_put_away_changes_nothing(scene, search):
    page = Page(scene)
    text = page.desk.toml().encode()
    search.append(lambda: page._load(SimpleNamespace(new=text, obj=SimpleNamespace(filename="m"))))
    page._improve(None)
    assert page.desk.values[BORE] == 0.13
    assert page.buttons["Improve"].label == "Improve"


def test_a_search_that_is_stopped_changes_nothing_and_another_one_may_begin(scene, search):
    page = Page(scene)
    stopped = []

    def stop():
        stopped.append(page.buttons["Improve"].label)
        page._improve(None)  # the same button
        stopped.append(page.buttons["Improve"].label)

    search.append(stop)
    page._improve(None)
    assert stopped == ["Stop searching", "Improve"]
    assert page.desk.values[BORE] == 0.13
    assert "stopped" in said(page)
    search.clear()
    page._improve(None)
    assert page.desk.values[BORE] == 0.125
    assert "converged" in said(page)


def test_a_stopped_search_ends_at_its_next_design(scene, monkeypatch):
    page = Page(scene)
    solved = []

    def endless(asked, callback=None, **_):
        while True:
            solved.append(1)
            assert len(solved) < 100
            callback("sample", len(solved), 100)
            if len(solved) == 3:
                page._improve(None)

    monkeypatch.setattr("jaxcomp.desk._state.optimise", endless)
    page._improve(None)
    assert len(solved) == 4
    assert page.buttons["Improve"].label == "Improve"


def test_improve_without_sliders_says_what_to_do(scene):
    page = Page(scene)
    for name in list(page.sliders):
        page.remove_slider(name)
    page._improve(None)
    assert "click on numbers first" in said(page)


def test_where_a_slider_is_let_go_counts(scene):
    page = Page(scene)
    page.sliders[BORE]._let_go(
        SimpleNamespace(new=136.0)
    )  # before the browser tells of its last place
    assert page.desk.values[BORE] == pytest.approx(0.136, rel=1e-15)
    assert rows_of(page).loc[BORE, "Value"] == "136 mm"
    page.drag(BORE, 0.137)
    assert rows_of(page).loc[BORE, "Value"] == "137 mm"


def test_a_slider_moves_pictures_and_table(page):
    curve = page.pictures.sources["Indicator diagram.gas.False"]
    before, said = np.array(curve.data["x"]), page.state.object
    slider = page.sliders[BORE]
    slider.slider.value = 140.0
    assert page.desk.values[BORE] == pytest.approx(0.14, rel=1e-12)
    assert np.max(curve.data["x"]) == pytest.approx(np.max(before) * (140 / 130) ** 2, rel=1e-9)
    assert page.state.object != said
    page.let_go()
    rows = page.table.value.set_index("name")
    assert rows.loc[BORE, "Value"] == "140 mm"
    page._pin(None)
    page._undo(None)
    assert slider.slider.value == pytest.approx(130)
    assert {"Now", "Pinned", "Difference"} <= {*page.results.value}
    pinned = page.pictures.sources["Indicator diagram.gas.True"].data["x"]
    assert np.max(pinned) > np.max(curve.data["x"])


def test_the_mechanism_moves_with_a_slider_and_with_the_angle_of_the_crank(scene):
    page = Page(scene)
    pins, rod = page.pictures.outlines["pins"], page.pictures.outlines["rod"]
    radius = page.desk.values["mechanism.crank_radius"]
    page.pictures.turn(90.0)  # the crank points to the right
    assert [pins.data[axis][1] for axis in "xy"] == pytest.approx([radius, 0.0], abs=1e-15)
    before, stays = dict(page.pictures.outlines["piston"].data), rod.data
    page.drag(BORE, 0.14)
    wide = np.ptp(page.pictures.outlines["piston"].data["x"])
    assert wide == pytest.approx(np.ptp(before["x"]) * 0.14 / 0.13, rel=1e-12)
    assert rod.data is stays  # only what moved is sent


def test_units_are_chosen_on_the_page(scene):
    page = Page(scene)
    page.units.value = "US"
    assert rows_of(page).loc[BORE, "Value"] == "5.11811 in"
    assert page.sliders[BORE].slider.value == pytest.approx(130 / 25.4)
    page.sliders[BORE].slider.value = 5.5
    assert page.desk.values[BORE] == pytest.approx(5.5 * 0.0254, rel=1e-15)
    titles = {one.title.text: one for one in page.pictures.figures}
    assert titles["Indicator diagram"].yaxis[0].axis_label == "Pressure, psi"
    row = list(page.table.value["name"]).index(BORE)
    page._entered(SimpleNamespace(column="Value", row=row, value="5 in"))
    assert page.desk.values[BORE] == pytest.approx(0.127, rel=1e-15)


def test_a_page_does_not_wait_for_gains_that_are_still_compiled(scene, monkeypatch):
    real, go = Desk.gains, threading.Event()
    monkeypatch.setattr(Desk, "gains", lambda desk: go.wait(30) and real(desk))
    page = Page(scene, 0.01)
    assert "Computing the gains" in said(page)
    assert set(page.table.value["gain"]) == {"..."}
    row = list(page.table.value["name"]).index(BORE)
    threading.Timer(0.05, go.set).start()
    page._entered(SimpleNamespace(column="Value", row=row, value="125 mm"))
    check_rows(page)


def rows_of(page):
    return page.table.value.set_index("name")


def check_rows(page):
    """Every row has the label, value and gain of its own number."""
    for name, row in rows_of(page).iterrows():
        assert row["Number"] == page.desk.label(name)
        assert row["Value"] == page.desk.text(name)
    gains = page.desk.gains().ranking(page.desk.quantity)
    shown = rows_of(page)
    assert all(shown.loc[one.number, "gain"] == one.change for one in gains)
    assert all(shown.loc[one.number, "Gain"] == one.rise for one in gains)


def test_rows_stay_together_when_sorted_by_gain(scene):
    page = Page(scene)
    check_rows(page)  # gains from the first moment
    before = list(page.table.value["name"])
    page._sort(None)
    after = list(page.table.value["name"])
    assert after != before
    assert after[0] in page.sliders
    check_rows(page)
    row = after.index(BORE)
    page.table.value.loc[row, "Value"] = "125 mm"  # as the browser does before it tells
    page._entered(SimpleNamespace(column="Value", row=row, value="125 mm"))
    assert page.desk.values[BORE] == 0.125
    check_rows(page)
    for step in (page._undo, page._redo, page._sort, page._undo):
        step(None)
        check_rows(page)
    assert page.desk.values[BORE] == 0.13


def test_numbers_get_sliders_and_lose_them(page):
    first = page._by_gain()[0]
    assert first in page.sliders
    page.remove_slider(first)
    assert first not in page.sliders
    page.add_slider(first)
    assert page.ranges.objects[-1] is page.sliders[first].row


@pytest.mark.parametrize("moves_with_its_ends", [False, True])  # as in Panel 1.10
def test_a_value_typed_beyond_a_slider_is_what_is_computed_and_saved(scene, moves_with_its_ends):
    page = Page(scene)
    slider = page.sliders[BORE].slider
    if moves_with_its_ends:
        slider.param.watch(
            lambda _: slider.param.update(value=min(max(slider.value, slider.start), slider.end)),
            ["start", "end"],
        )
    row = list(page.table.value["name"]).index(BORE)
    seen = []
    for text, value in (("170 mm", 0.17), ("60 mm", 0.06), ("200 mm", 0.2)):
        page._entered(SimpleNamespace(column="Value", row=row, value=text))
        assert page.desk.values[BORE] == value
        assert float(np.asarray(page.desk.machine.compressor.mechanism.bore)) == value
        assert rows_of(page).loc[BORE, "Value"] == text
        assert slider.value == pytest.approx(value * 1e3, rel=1e-15)
        low, high = page.sliders[BORE].range
        assert low <= value <= high
        assert loads(page.desk.toml()).compressor.mechanism.bore == value
        seen.append(value)
    assert page.desk.changes == (3, 0)
    for value in (*seen[1::-1], 0.13):
        page._undo(None)
        assert page.desk.values[BORE] == value
        assert slider.value == pytest.approx(value * 1e3, rel=1e-15)
    page._redo(None)
    assert page.desk.values[BORE] == 0.17
    low, high = (end.value for end in page.sliders[BORE].ends)
    page.sliders[BORE].ends[0].value = 171.0  # the range would leave the value out
    assert "must hold the present value, 170 mm" in said(page)
    assert [end.value for end in page.sliders[BORE].ends] == [low, high]
    assert page.desk.values[BORE] == 0.17


def test_what_check_finds_unusual_stands_on_the_page(page):
    assert "conrod\\_centre" in page.warnings.object  # as Table 1 has it
    row = list(page.table.value["name"]).index("mechanism.piston_mass")
    page._entered(SimpleNamespace(column="Value", row=row, value="60 kg"))
    assert "piston\\_mass over bore cubed" in page.warnings.object
    page._undo(None)
    assert "piston" not in page.warnings.object


def test_a_blend_has_composition_and_glide_on_the_desk_as_in_check(page, tmp_path):
    assert not page.gas.visible  # of a machine without valves
    text = start("blend", "machine")
    for other in (text, text.replace('reference = "dew"', 'reference = "mean"')):
        path = tmp_path / "machine.toml"
        path.write_text(other)
        lines = Desk.gas_lines(SimpleNamespace(machine=load(str(path)).machine))
        assert lines[0] == "Composition by mass: R32 21.5 %, R1234yf 78.5 % R32/R1234yf"
        checked = CliRunner().invoke(app, ["check", str(path), "--json"])
        rows = json.loads(checked.output)["follows"]
        follows = {row["what"]: row["value"] for row in rows}
        names = ["Evaporating and condensing temperatures", "Compressibility at the suction valve"]
        names += ["Isentropic head", "Glide at suction pressure", "Glide at discharge pressure"]
        for name in names:
            (line,) = (line for line in lines if line.startswith(f"{name}: "))
            value = follows[name]
            assert (value if isinstance(value, str) else f"{value:.4g}") in line


def test_what_matters_most_stands_first(page):
    assert list(page.results.value["Result"])[:2] == ["Mechanical efficiency", "Shaft power"]
    assert "Shaft power" in re.sub(r"\\(.)", r"\1", page.state.object)


@pytest.mark.slow  # compiles the cycle and its derivatives
def test_a_machine_with_valves_has_its_pictures():
    desk = Desk(load("r290-6cc"))
    assert desk.quantity == "cop"
    view = desk.view
    assert not view.status
    assert any(line.startswith("Pressure ratio: 8.688") for line in desk.gas_lines())
    assert set(view.lifts) == {"suction", "discharge"}
    stop = float(desk.machine.compressor.gas.suction_valve.stop)
    # a plate may bounce into its stop by a tenth
    assert 0 < max(view.lifts["suction"]) < 1.1 * stop
    # a sum of ten powers, to rounding and to the closure of the cycle's balance
    assert sum(map(float, view.power_use.values())) == pytest.approx(
        float(view.quantities["electric_power"]), rel=1e-6
    )


def said(page):
    """The message without the backslashes that keep Markdown out of it."""
    return re.sub(r"\\(.)", r"\1", page.message.object)


def test_wrong_input_is_answered_on_the_page(page):
    row = list(page.table.value["name"]).index(BORE)
    page._entered(SimpleNamespace(column="Value", row=row, value="-1 mm"))
    assert page.message.visible
    assert said(page) == 'mechanism.bore = "-1 mm": must be > 0 m'
    file = SimpleNamespace(filename="mine.toml")
    page._load(SimpleNamespace(new=b"mechanism = 3", obj=file))
    assert "mechanism" in page.message.object


def test_texts_of_a_machine_are_neither_html_nor_markdown(scene):
    import panel as pn
    from markdown_it import MarkdownIt

    text = '<img src=x onerror="alert(1)"> ![a](http://example.org/a.png) *b* `c` 50 %'
    named = dataclasses.replace(scene, name=text, description=text)
    shown = Page(named)
    shown.say(text)
    render = MarkdownIt("gfm-like").render
    assert "<img" in render(text)
    panes = [one.object for one in shown.body.select(pn.pane.Markdown) if "example" in one.object]
    assert len(panes) == 2
    for made in map(render, panes):
        assert "<img" not in made
        assert "<em>" not in made
        assert 'onerror="alert' in html.unescape(made)  # as it was written


def test_a_machine_that_is_opened_reads_no_files_beside_it(page, tmp_path):
    (tmp_path / "secret.csv").write_text("of the user")
    for name in (tmp_path / "secret.csv", "/etc/passwd"):
        sent = f'[gas]\ntype = "crank_angle_table"\ncsv = "{name}"\nback_pressure = "1 bar"'
        page._load(SimpleNamespace(new=sent.encode(), obj=SimpleNamespace(filename="m.toml")))
        assert "names a file" in said(page)
        assert "of the user" not in page.message.object
        assert "root" not in page.message.object


def test_pages_do_not_disturb_each_other(scene, page):
    other = Page(scene)
    value = page.desk.values[BORE]
    other.sliders[BORE].slider.value = 120.0
    assert page.desk.values[BORE] == value


def test_a_message_that_a_closed_tab_no_longer_takes_is_no_fault(caplog):
    """The server's own log of it has a traceback."""
    from tornado.websocket import WebSocketClosedError

    log = logging.getLogger("asyncio")
    log.addFilter(_is_fault)
    for error in (WebSocketClosedError(), ValueError("another")):
        log.error("Task exception was never retrieved", exc_info=error)
    log.removeFilter(_is_fault)
    assert [type(one.exc_info[1]) for one in caplog.records] == [ValueError]


@pytest.fixture(scope="module")
def browser():
    """Debian's Chromium, driven by Playwright."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright")
    where = shutil.which("chromium")
    if where is None:
        pytest.skip("needs the system's chromium")
    with playwright.sync_playwright() as started:
        made = started.chromium.launch(executable_path=where, args=CHROMIUM)
        yield made
        made.close()


@pytest.fixture(scope="module")
def address(scene):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = serve(scene, show=False, threaded=True, port=port)
    yield f"http://127.0.0.1:{port}/"
    server.stop()


class Tab:
    """A tab with the desk."""

    def __init__(self, browser, address, width=1280, height=1000):
        self.asked = []
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(address)
        self.page.wait_for_selector(".tabulator-row", timeout=60_000)

    def result(self):
        return self.page.locator("strong", has_text="Mechanical efficiency").inner_text()

    def rows(self):
        """Value and gain by number, as they stand one below the other."""
        texts = self.page.locator(".numbers .tabulator-row").evaluate_all(
            "rows => rows.map(row => ['Number', 'Value', 'Gain'].map(field =>"
            " row.querySelector(`[tabulator-field=${field}]`)?.innerText ?? ''))"
        )
        return {number: (value, gain) for number, value, gain in texts}

    def value(self, number):
        return self.rows().get(number, ("", ""))[0]

    def press(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()

    def type(self, number, text):
        row = self.page.locator(".numbers .tabulator-row", has_text=number).first
        row.locator("[tabulator-field=Value]").dblclick()
        row.locator("input").fill(text)
        row.locator("input").press("Enter")

    def wait(self, holds, what, seconds=30):  # beside other work
        for _ in range(20 * seconds):
            if holds():
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"not within {seconds} seconds: {what}")

    def saved(self, path):
        with self.page.expect_download() as download:
            self.page.get_by_text("Save as machine file").click()
        download.value.save_as(path)
        return load(path)


def in_order(tab, falling):
    gains = [gain for _, gain in tab.rows().values() if "per %" in gain]
    numbers = [float(gain.split()[0]) for gain in gains]
    return numbers == sorted(numbers, reverse=falling)


@pytest.mark.slow  # a browser
def test_sorting_typing_undo_and_saving_in_a_browser(browser, address, tmp_path):
    tab = Tab(browser, address)
    # beside other work they may need longer than the page waits for them
    tab.wait(lambda: "..." not in {gain for _, gain in tab.rows().values()}, "gains")
    start = tab.rows()
    assert all(gain for _, gain in start.values())
    tab.press("Sort by gain")
    tab.wait(lambda: list(tab.rows()) != list(start), "another order")
    ranked = tab.rows()
    assert all(start[number] == texts for number, texts in ranked.items() if number in start)
    tab.type("bore", "170 mm")  # beyond the end of its slider
    tab.wait(lambda: tab.value("bore") == "170 mm", "what was typed")
    tab.wait(lambda: tab.page.get_by_text("bore [mm]: 170").count() == 1, "the slider follows")
    before = {number: texts[0] for number, texts in (start | ranked).items()}

    def others_are_as_before():  # once the rows are drawn anew
        others = {number: texts[0] for number, texts in tab.rows().items() if number != "bore"}
        return len(others) > 5 and others.items() <= before.items()

    tab.wait(others_are_as_before, "the other numbers")
    assert float(tab.saved(tmp_path / "a.toml").compressor.mechanism.bore) == 0.17
    tab.press("Undo")
    tab.wait(lambda: tab.value("bore") == "130 mm", "the value before, in one step")
    tab.press("Redo")
    tab.wait(lambda: tab.value("bore") == "170 mm", "the value again")
    assert float(tab.saved(tmp_path / "b.toml").compressor.mechanism.bore) == 0.17
    tab.press("Undo")
    tab.wait(lambda: tab.value("bore") == "130 mm", "the value before")
    head = tab.page.locator(".numbers .tabulator-col[tabulator-field=Gain] .tabulator-col-sorter")
    for falling in (False, True):
        head.click()
        tab.wait(lambda falling=falling: in_order(tab, falling), f"rows in order, {falling}")
    tab.type("bore", "140 mm")  # while a header sorts
    tab.wait(lambda: "140 mm" in tab.page.get_by_text("140 mm").all_inner_texts(), "the value")
    assert float(tab.saved(tmp_path / "c.toml").compressor.mechanism.bore) == 0.14
    tab.page.close()


@pytest.mark.slow  # a browser
def test_a_phone_shows_a_picture_first_and_nothing_is_cut(browser, address):
    tab = Tab(browser, address, 390, 844)
    tab.page.wait_for_timeout(500)
    picture = tab.page.locator(".bk-Figure").first.bounding_box()
    assert picture["y"] + picture["height"] < 844
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= 390
    tab.wait(lambda: "..." not in {gain for _, gain in tab.rows().values()}, "gains")
    tab.press("Pin this state")
    tab.wait(lambda: tab.page.get_by_text("Pinned").count() == 1, "the pinned state")
    tab.page.wait_for_timeout(500)
    # a cell whose text is wider than itself shows a part of it, or writes over its neighbour
    cut = tab.page.locator(".tabulator-cell, .tabulator-col-title").evaluate_all(
        "cells => cells.filter(x => x.scrollWidth > x.clientWidth + 1).map(x => x.innerText.trim())"
    )
    assert [text for text in cut if text] == []
    names = boxes(tab.page.locator(".bk-slider-title"))
    fields = boxes(tab.page.locator("input:visible, button:visible"))
    assert len(names) >= 7
    assert [(a, b) for a in names for b in fields if overlap(a, b)] == []
    tab.page.close()


def boxes(locator):
    """Left, top, right and lower end of elements [px]."""
    return locator.evaluate_all(
        "all => all.map(x => x.getBoundingClientRect()).map(r => [r.left, r.top, r.right, r.bottom])"
    )


def overlap(a, b):
    return min(a[2], b[2]) > max(a[0], b[0]) + 1 and min(a[3], b[3]) > max(a[1], b[1]) + 1


# Ends of the ordinate of a picture by its title.
ORDINATE = """title => { for (const page of Bokeh.documents) for (const one of page._all_models.values())
  if (one.type == "Figure" && one.title.text == title) return [one.y_range.start, one.y_range.end] }"""


@pytest.mark.slow  # a browser
def test_a_picture_that_was_panned_shows_other_forces_as_a_whole(browser, address):
    """The forces of a bore of 260 mm are four times those of 130 mm."""
    tab = Tab(browser, address)
    force = tab.page.evaluate(ORDINATE, "Joint forces")
    picture = tab.page.locator(".bk-Figure").nth(2).bounding_box()
    middle = picture["x"] + 200, picture["y"] + 150
    tab.page.mouse.move(*middle)
    tab.page.mouse.down()
    tab.page.mouse.move(middle[0], middle[1] + 30, steps=5)
    tab.page.mouse.up()
    panned = tab.page.evaluate(ORDINATE, "Joint forces")
    assert panned[0] > force[0] + 0.05 * (force[1] - force[0])
    tab.type("bore", "131 mm")  # about as large: the part that was chosen stays
    tab.wait(lambda: "91.173 %" not in tab.result(), "the next state")
    tab.page.wait_for_timeout(500)
    assert tab.page.evaluate(ORDINATE, "Joint forces") == panned
    tab.type("bore", "260 mm")
    tab.wait(lambda: tab.page.evaluate(ORDINATE, "Joint forces")[1] > 3.5 * force[1], "all forces")
    assert tab.page.evaluate(ORDINATE, "Joint forces")[0] < 0
    tab.page.close()


@pytest.mark.slow  # a browser
def test_a_tab_that_is_closed_at_work_leaves_no_traceback(browser, address, capfd, caplog):
    tab = Tab(browser, address)
    tab.press("Improve")
    tab.page.wait_for_timeout(300)
    tab.page.close()
    other = Tab(browser, address)
    other.press("Improve")
    other.wait(lambda: other.page.get_by_text(FOUND).count() > 0, "an answer", seconds=180)
    other.page.close()
    assert "Traceback" not in capfd.readouterr().err + caplog.text
    assert not [one for one in caplog.records if one.levelname == "ERROR"]


@pytest.mark.slow  # a browser
def test_numbers_typed_and_undone_while_a_search_goes_on_in_a_browser(
    browser, address, tmp_path, monkeypatch
):
    """Whatever the page shows is what it saves: two tabs, a search in both, a change in one."""
    searching, go = threading.Semaphore(0), threading.Event()
    real = state.optimise

    def waiting(*asked, **options):
        searching.release()
        assert go.wait(120)
        return real(*asked, **options)

    monkeypatch.setattr(state, "optimise", waiting)
    tabs = Tab(browser, address), Tab(browser, address)
    tab, other = tabs
    for one in tabs:
        one.wait(lambda one=one: one.page.locator(".ranges .noUi-handle").count() > 3, "sliders")
        one.page.get_by_placeholder("filter").press_sequentially(PRESSURE)
        one.wait(lambda one=one: len(one.rows()) == 1, "the pressure alone")
        one.press("Improve")
        assert searching.acquire(timeout=60)
    tab.type(PRESSURE, "107.8 kPa")
    tab.wait(lambda: tab.value(PRESSURE) == MOVED, "what was typed")
    go.set()
    for one in tabs:
        one.wait(lambda one=one: one.page.get_by_text(FOUND).count() > 0, "an answer", seconds=180)
    for one, text, shown in ((tab, MOVED, 107_800.0), (other, "98 kPa", 98_000.0)):
        assert one.value(PRESSURE) == text
        machine = one.saved(tmp_path / "saved.toml").compressor
        assert float(machine.gas.suction_pressure) == pytest.approx(shown, rel=1e-12)
        shown = float(re.search(r"([\d.]+) %", one.result())[1]) / 100
        # to the five digits that the page shows
        assert float(solve_orbit(machine).mechanical_efficiency) == pytest.approx(shown, abs=6e-6)
    assert tab.page.get_by_text("as moved since").count() == 1
    assert other.page.get_by_text("as moved since").count() == 0
    tab.press("Undo")
    tab.wait(lambda: tab.page.get_by_text("as moved since").count() == 0, "the state before")
    assert tab.value(PRESSURE) == MOVED
    assert float(tab.saved(tmp_path / "saved.toml").compressor.mechanism.bore) == 0.13
    for one in tabs:
        one.page.close()


@pytest.mark.slow  # a browser
def test_dragging_two_tabs_and_opening_in_a_browser(browser, address, scene, tmp_path):
    """Drag a slider, see the figure change, save, reload; nothing leaves the computer."""
    tab, other = Tab(browser, address), Tab(browser, address)

    def picture():
        return tab.page.locator(".bk-Figure").nth(2).screenshot()  # joint forces

    start, before = tab.result(), picture()
    handle = tab.page.locator(".ranges .noUi-handle").first.bounding_box()
    tab.page.mouse.move(handle["x"] + 5, handle["y"] + 5)
    tab.page.mouse.down()
    tab.page.mouse.move(handle["x"] + 45, handle["y"] + 5)
    tab.wait(lambda: tab.result() != start, "another result")
    tab.page.mouse.up()
    tab.page.wait_for_timeout(1000)
    dragged = tab.result()
    assert picture() != before
    assert other.result() == start
    speed = tab.saved(tmp_path / "saved.toml").compressor.motor.mean_speed
    assert speed != scene.compressor.motor.mean_speed
    tab.press("Undo")
    tab.wait(lambda: tab.result() == start, "the start")
    other.page.set_input_files("input[type=file]", tmp_path / "saved.toml")
    other.wait(lambda: other.result() == dragged, "the machine that was opened")
    tab.page.reload()  # begins anew
    tab.page.wait_for_selector(".tabulator-row", timeout=60_000)
    assert tab.result() == start
    assert all(url.startswith((address, "data:", "blob:")) for url in tab.asked + other.asked)
    tab.page.close()
    other.page.close()
