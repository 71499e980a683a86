"""The desk: a machine whose numbers move, headless, as a page of Panel, and in a real browser."""

import dataclasses
import html
import re
import shutil
import socket
from types import SimpleNamespace

import numpy as np
import pytest

from jaxcomp import load, solve_orbit
from jaxcomp.desk import Desk, serve
from jaxcomp.desk._page import _Page
from jaxcomp.scene import SceneError, loads

BORE, PIN = "mechanism.bore", "friction.crank_pin.coefficient"


@pytest.fixture(scope="module")
def scene():
    return load("mayekawa-wbhe")


@pytest.fixture(scope="module")
def page(scene):
    return _Page(scene)


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
        desk.move(BORE, value)
    desk.drop_changes_since(0)
    assert desk.changes == 1
    assert desk.undo()
    assert desk.values[BORE] == 0.13
    assert efficiency(desk) == start
    assert not desk.undo()


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
    assert desk.changes == 0
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


# ---------------------------------------------------------------- the page


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


def test_gains_can_be_sorted_and_numbers_get_sliders(page):
    page._sort(None)
    first = page.table.value["name"].iloc[0]
    assert first in page.sliders
    page.remove_slider(first)
    assert first not in page.sliders
    page.add_slider(first)
    assert page.ranges.objects[-1] is page.sliders[first].row


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
    shown = _Page(named)
    shown._say(text)
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
    other = _Page(scene)
    value = page.desk.values[BORE]
    other.sliders[BORE].slider.value = 120.0
    assert page.desk.values[BORE] == value


@pytest.mark.slow  # a browser
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs Debian's chromium")
def test_in_a_browser(scene, tmp_path):
    """Drag a slider, see the figure change, save, reload; nothing leaves the computer."""
    playwright = pytest.importorskip("playwright.sync_api")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server, saved = serve(scene, show=False, threaded=True, port=port), tmp_path / "saved.toml"
    try:
        with playwright.sync_playwright() as started:
            browser = started.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox"]
            )
            check_page(browser, f"http://127.0.0.1:{port}/", saved)
            browser.close()
    finally:
        server.stop()
    assert load(saved).compressor.motor.mean_speed != scene.compressor.motor.mean_speed


def check_page(browser, address, saved):
    """Drag the first slider; see value, picture, undo and a second tab; save and open again."""
    asked = []

    def opened():
        tab = browser.new_page(viewport={"width": 1280, "height": 1000})
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(address)
        tab.wait_for_selector(".tabulator-row", timeout=60_000)
        return tab

    def value(tab):
        return tab.locator("strong", has_text="Mechanical efficiency").inner_text()

    def forces(tab):
        return tab.locator(".bk-Figure").nth(1).screenshot()

    def changed(tab, before):
        for _ in range(200):
            if value(tab) != before:
                return value(tab)
            tab.wait_for_timeout(50)
        raise AssertionError("nothing changed within ten seconds")

    tab, other = opened(), opened()
    start, picture = value(tab), forces(tab)
    handle = tab.locator(".noUi-handle").first.bounding_box()
    tab.mouse.move(handle["x"] + 5, handle["y"] + 5)
    tab.mouse.down()
    tab.mouse.move(handle["x"] + 45, handle["y"] + 5)
    changed(tab, start)
    tab.mouse.up()
    tab.wait_for_timeout(1000)
    dragged = value(tab)
    assert forces(tab) != picture
    assert value(other) == start
    with tab.expect_download() as download:
        tab.get_by_text("Save as machine file").click()
    download.value.save_as(saved)
    tab.get_by_role("button", name="Undo").click()
    assert changed(tab, dragged) == start
    other.set_input_files("input[type=file]", saved)
    assert changed(other, start) == dragged
    tab.reload()  # begins anew
    tab.wait_for_selector(".tabulator-row", timeout=60_000)
    assert value(tab) == start
    assert all(url.startswith((address, "data:", "blob:")) for url in asked)
