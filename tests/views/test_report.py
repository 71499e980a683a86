"""Reports: self-contained, truthful about their evidence, and the same numbers as the terminal."""

import dataclasses
import re
from html.parser import HTMLParser
from importlib import resources

import pytest
from helpers import read_json, without_drawing
from matplotlib.figure import Figure
from rich.table import Table
from typer.testing import CliRunner

from jaxcomp import load
from jaxcomp._core.evidence import all_solved, ended, is_small
from jaxcomp.cli import app
from jaxcomp.cli._tables import row_table
from jaxcomp.report import report
from jaxcomp.report._page import Provenance, numbers_html, picture_html, rich_html, tables_html
from jaxcomp.scene import describe, loads, start
from jaxcomp.study import Sensitivity, steady_state

MADE = Provenance(
    "jaxcomp run m.toml --set 'a b=<1>'", {"jaxcomp": "1", "jax": "2"}, "2000-01-01 00:00"
)
VOID = {"meta", "img", "wbr", "br", "hr", "link", "input"}


class Reader(HTMLParser):
    """Text, tags and outside addresses of a page; fails where tags are not nested."""

    def __init__(self, page: str):
        super().__init__()
        self.open, self.tags, self.words, self.images = [], [], [], []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def scene():
    return loads(start("slider-crank", "pump"), "pump.toml")


def figure():
    one = Figure()
    one.subplots().plot([1, 2, 4])
    one.suptitle("A < B")
    return one


def table():
    one = Table(title="Loss of [bold]all[/bold]")
    one.add_column("Joint")
    one.add_column("Loss, W", justify="right")
    one.add_row("Wall & pin", "[bold red]3.14[/bold red]")
    one.add_row("Share", "[bold]62 %[/bold]")
    one.caption = "of [bold]one[/bold] turn"
    return one


GOOD = {"status": "converged", "converged": True, "energy_residual": -3e-9, "joint_margin": 0.9}


def test_page_is_well_formed_and_loads_nothing(scene):
    page = report(GOOD, [table()], {"losses": figure()}, scene, MADE)
    found = Reader(page)
    assert found.open == []
    assert not {"script", "link", "iframe"} & set(found.tags)
    outside = [url for url in re.findall(r"(?:src|href)=\"([^\"]*)", page)]
    assert outside
    assert all(url.startswith(("data:image/", "#")) for url in outside)
    # contents lead to every section, results first, and wide tables scroll by themselves
    places = [url[1:] for url in outside if url.startswith("#")]
    assert places[:2] == ["results", "pictures"]
    assert places == re.findall(r"<h2 id=\"([^\"]*)\"", page)
    assert page.count('<div class="wide"><table') == page.count("<table")
    assert "url(" not in page
    # no line ends between a number and its unit
    assert '<span class="strong">62&nbsp;%</span>' in page
    assert "@import" not in page


def test_page_says_what_was_asked_found_and_of_what(scene):
    found = Reader(report(GOOD, [table()], {"losses": figure()}, scene, MADE))
    for text in (
        "pump",
        scene.description,
        MADE.command,
        "jaxcomp 1, jax 2",
        "Wall & pin",
        "3.14",
        "of one turn",
    ):
        assert text in found.text, text
    assert found.images[0]["alt"] == "A < B"
    for row in describe(scene):  # the break marks inside long paths leave their letters alone
        assert row.path in "".join(found.words), row.path
    assert "Sources" in found.text or "sources" in found.text
    assert "example value, to be replaced" in found.text


def test_page_without_scene_or_tables_shows_the_numbers():
    page = report({"machine": "runs.csv", "loss": {"wall": 0.25}, "ok": True}, [], {}, None, MADE)
    text = Reader(page).text
    assert "runs.csv" in text
    assert "loss, wall 0.25" in text
    assert "ok yes" in text
    assert "Pictures" not in text


NAN = float("nan")


@pytest.mark.parametrize(
    ("check", "word"),
    [
        (ended("Solution", "converged", True), "good"),
        (ended("Solution", "locked", False), "bad"),
        (is_small("Energy closure", -3e-9), "good"),
        (is_small("Energy closure", 2e-5), "bad"),
        (is_small("Energy closure", 2e-5, 1e-5), "good"),  # as good as it was asked to be
        (is_small("Residual", NAN), "bad"),
        (all_solved("Designs", 1, 10), "bad"),
        (all_solved("Machines", 0, 9), "good"),
    ],
    ids=lambda value: str(value),
)
def test_checks_tell_good_from_bad(check, word):
    assert check.good == (word == "good")
    page = report(GOOD, [], {}, None, MADE, [check])
    assert ('class="bad"' in page) == (word == "bad")


def test_a_result_without_evidence_has_no_checks():
    assert "Checks" not in Reader(report(GOOD, [], {}, None, MADE)).text
    assert Sensitivity.evidence(None) == ()


def changed(state, **numbers):
    """A periodic state with other numbers."""
    return dataclasses.replace(state, numbers=state.numbers | numbers)


def test_evidence_of_a_periodic_state():
    state = steady_state(load("mayekawa-wbhe"))
    assert all(check.good for check in state.evidence())
    assert [check.name for check in state.evidence()] == [
        "Solution",
        "Energy closure",
        "Residual",
        "Resolution of the speed",
        "Margin against self-locking",
    ]
    for wrong in ({"energy_residual": 2e-5}, {"residual": NAN}, {"resolution": 0.02}):
        verdicts = [check.good for check in changed(state, **wrong).evidence()]
        assert verdicts.count(False) == 1, wrong
    assert all(check.good for check in changed(state, energy_residual=2e-5).evidence(1e-5))
    locked = dataclasses.replace(state, quantities=state.quantities | {"joint_margin": -0.01})
    assert not locked.evidence()[-1].good


def test_markup_of_the_terminal_becomes_classes():
    assert rich_html("a [bold]b[/bold] <c>") == 'a <span class="strong">b</span> &lt;c&gt;'
    found = tables_html([table(), "[green]fine[/green]"])
    assert '<td class="right"><span class="strong bad">3.14</span></td>' in found.replace(
        "bad strong", "strong bad"
    )
    assert '<p><span class="good">fine</span></p>' in found
    assert '<h3>Loss of <span class="strong">all</span></h3><table>' in found
    assert "&lt;x&gt;" in numbers_html({"a": "<x>"})


def test_tables_without_a_title_are_headed_by_what_they_list():
    losses = row_table(None, ("Friction loss", ("W", ".4g")), [("Main journal", 1.313)])
    found = tables_html([losses])
    assert found.startswith("<h3>Friction loss</h3><table><thead><tr><th")
    assert found.count("Friction loss") == 1
    # of numbers in the first column the head is that of the column
    orders = row_table(None, ("Order", ("Force, N", ".4g")), [(1, 63.51)])
    assert "<h3>" not in tables_html([orders])
    assert '<th class="left">Order</th>' in tables_html([orders])


def test_points_of_a_column_stand_below_each_other_in_any_font():
    """As wide as the digits that are lacking, and neither to be read nor to be copied."""
    rows = [("a", 74.8), ("b", 6.079), ("c", 0)]
    found = tables_html([row_table(None, ("Use", ("W", ".4g")), rows)])
    rooms = re.findall(
        r'<td class="right">([\d.]+)(?:<i class="room" data-room="([\d.]+)"></i>)?', found
    )
    assert rooms == [("74.8", "00"), ("6.079", ""), ("0", ".000")]
    assert Reader(found).text == "Use W a 74.8 b 6.079 c 0"
    style = (resources.files("jaxcomp.report") / "style.css").read_text("utf-8")
    assert ".room::after { content: attr(data-room); visibility: hidden;" in style


def test_large_drawings_become_pixels():
    many = Figure()
    axes = many.subplots()
    for shift in range(300):
        axes.plot([i % 7 + shift for i in range(300)])
    assert "data:image/png" in picture_html("many", many)
    assert "data:image/svg+xml" in picture_html("one", figure())
    assert "data:image/gif" in picture_html("moves", b"GIF89a")


BORE = ("mayekawa-wbhe", "--variable", "mechanism.bore=120mm:140mm")
VOLUME = ("--quantity", "swept_volume")


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (
            ("sweep", "mayekawa-wbhe", "--over", "mechanism.bore=120mm:130mm:3", *VOLUME),
            ["Designs without a result 0 of 3 none"],
        ),
        (
            ("tolerance", "mayekawa-wbhe", *VOLUME, "--vary", "mechanism.bore=+-1%"),
            ["Machines of the sample without a result 0 of"],
        ),
        (
            ("optimise", *BORE, "--objective", "swept_volume", "--minimise", "--starts", "1"),
            ["Search converged converged", "Constraints kept kept"],
        ),
        pytest.param(
            ("modes", "hermetic-68cc", "--speeds", "3000rpm"),
            ["Stability stable no mode grows"],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("balance", "hermetic-68cc"),
            ["Condition of the balancing planes", "Gap to the proven optimum"],
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda value: value[0],
)
def test_a_report_has_the_evidence_of_its_result(arguments, names, tmp_path, monkeypatch):
    without_drawing(monkeypatch)
    done = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    text = Reader((tmp_path / "report.html").read_text("utf-8")).text
    for name in names:
        assert name in text, text[-600:]


@pytest.mark.slow
def test_run_writes_a_report_of_what_it_prints(tmp_path):
    arguments = ["run", "mayekawa-wbhe", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.stderr
    page = (tmp_path / "report.html").read_text("utf-8")
    found = Reader(page)
    result = read_json((tmp_path / "result.json").read_text())
    assert f"{100 * result['mechanical_efficiency']:.2f} %" in found.text
    assert f"jaxcomp {' '.join(arguments)}" in found.text
    assert len(found.images) == len(list(tmp_path.glob("*.png")))
    assert "printed, Table 1" in found.text
    assert 'class="bad"' not in page
    # seven vector pictures; pixels at 150 dpi would be as large, and a megabyte goes by mail
    assert len(page) < 1_000_000
