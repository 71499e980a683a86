"""README and the pages beside notebooks and benchmarks: examples run, links lead to something.

A line of Python that ends with a comment behind `print(...)`, or has it on the next line, shows what it
prints. A command line in a block is parsed by the program itself, which knows its options; cheap ones
are run here, all of them in the longer checks.
"""

import dataclasses
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from contextlib import redirect_stdout
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import without_drawing
from typer.main import get_command
from typer.testing import CliRunner

from jaxcomp import load
from jaxcomp.cli import app
from jaxcomp.mechanism import SliderCrank, SliderLink
from jaxcomp.scene import machines
from jaxcomp.scene._explain import explained, part_places

ROOT = Path(__file__).parents[2]
public_names = runpy.run_path(str(ROOT / "notebooks" / "public_names.py"))["public_names"]
broken = runpy.run_path(str(ROOT / "notebooks" / "check_links.py"))["broken"]
# Pages of the site that are made when it is built.
MADE = {"index", "entries", "machines", "quantities"}
PAGES = (
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "tests/benchmarks/README.md",
    *(f"notebooks/{path.name}" for path in sorted((ROOT / "notebooks").glob("*.md"))),
)
# These need a package of their own; see `test_own_parts.py`.
OWN = tuple(page for page in PAGES if page.startswith("notebooks/own"))
RUN = tuple(page for page in PAGES if page not in OWN)
# Commands that compile no solver.
CHEAP = {"new", "check", "list", "bearing", "schema"}


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str, language: str) -> list[str]:
    found = re.findall(r"^```(\w*)(?: title=[^\n]*)?\n(.*?)^```$", text_of(page), re.M | re.S)
    return [code for given, code in found if given == language]


def titled(page: str) -> dict[str, str]:
    """The files that a page shows, by name."""
    found = re.findall(r'^```\w+ title="([^"\n]*)"\n(.*?)^```$', text_of(page), re.M | re.S)
    return {name: code for name, code in found if not name.endswith("(excerpt)")}


def write_files(page: str, folder: Path) -> None:
    for name, code in titled(page).items():
        file = folder / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(code, encoding="utf-8")


def commands(page: str) -> list[list[str]]:
    """The arguments of every line `jaxcomp ...` in the blocks of a page."""
    lines = "".join(blocks(page, "bash")).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("jaxcomp ")]


def promised(code: str) -> list[str]:
    """What the comments behind, or on the line under, `print(...)` say is printed."""
    return [m.strip() for m in re.findall(r"^print\(.*\)\s+# (.*)$", code, re.M)]


def printed_by(code: str) -> list[str]:
    shown = io.StringIO()
    with redirect_stdout(shown):
        exec(compile(code, "<example>", "exec"), {"__name__": "example"})
    return shown.getvalue().splitlines()


def printed_as_script(code: str) -> list[str]:
    """For code that starts other processes, which import it."""
    Path("script.py").write_text(code, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


# The others compile a solver with its gradient, for more than ten seconds.
QUICK_EXAMPLES = [
    ("README.md", 0),
    ("notebooks/examples.md", 3),
    ("notebooks/balance-measured.md", 0),
]
EXAMPLES = [(page, i) for page in RUN for i, _ in enumerate(blocks(page, "python"))]


@pytest.mark.parametrize(
    ("page", "number"),
    [
        pytest.param(*one, marks=() if one in QUICK_EXAMPLES else pytest.mark.slow)
        for one in EXAMPLES
    ],
)
def test_examples_of_python_print_what_they_promise(page, number, tmp_path, monkeypatch):
    write_files(page, tmp_path)
    monkeypatch.chdir(tmp_path)
    code = blocks(page, "python")[number]
    if "samples=4096" in code:
        # what is printed of them is promised nowhere
        code = code.replace("samples=4096", "samples=256")
    shown = printed_as_script(code) if "__main__" in code else printed_by(code)
    assert shown
    for line in promised(code):
        assert line in shown


def test_every_quick_example_is_there_and_one_promises_a_value():
    assert set(QUICK_EXAMPLES) <= set(EXAMPLES)
    assert promised(blocks("README.md", "python")[0]) == ["0.9091, 0.5250 per metre"]


def test_a_wrong_promise_is_noticed():
    code = "print(1 + 1)  # 3\n"
    assert promised(code) == ["3"]
    assert "3" not in printed_by(code)


LINES = [line for page in PAGES for line in commands(page)]


@pytest.mark.parametrize("line", LINES, ids=shlex.join)
def test_commands_have_the_options_that_they_use(line):
    group = get_command(app)
    command = group.get_command(None, line[0])
    assert command is not None, line[0]
    # parses and converts every argument, and runs nothing
    command.make_context(line[0], line[1:])


def test_every_bundled_machine_stands_on_the_first_page_with_its_bore_and_gas():
    rows = {}
    for line in text_of("notebooks/start.md").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        names = re.findall(r"`([\w-]+)`", cells[0])
        if line.startswith("| `") and len(cells) == 4:
            rows |= {
                name if not name.startswith("-") else f"mayekawa{name}": cells for name in names
            }
    assert set(rows) == {machine.name for machine in machines()}
    for name, (_, bores, gas, purpose) in rows.items():
        compressor = load(name).compressor
        bore = np.atleast_1d(compressor.mechanism.bore)
        assert [round(1e3 * float(size)) for size in bore] == [int(b) for b in bores.split(",")], (
            name
        )
        fluid = getattr(getattr(compressor.gas, "fluid", None), "name", "polytropic")
        assert gas == fluid, name
        assert purpose


def test_every_command_has_an_example():
    assert {line[0] for line in LINES} == {one.name for one in app.registered_commands}


def write_tables(folder: Path) -> None:
    """The tables of measurements that the page shows, by the names its commands use."""
    names = {"run,target": "runs.csv", "mode,frequency": "modes.csv", "# fluid": "map.csv"}
    for begin, name in names.items():
        pages = ("notebooks/examples.md", "notebooks/identify.md")
        (table,) = [b for page in pages for b in blocks(page, "") if b.startswith(begin)]
        (folder / name).write_text(table)


def is_cheap(line: list[str]) -> bool:
    # orbits of journals: tests/cli/test_bearing_loads.py
    return (line[0] in CHEAP and "--loads" not in line) or "--measured" in line


def run_all(page: str, lines: list[list[str]], folder: Path, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    write_tables(folder)
    write_files(page, folder)
    for line in lines:
        done = CliRunner().invoke(app, line)
        assert done.exit_code == 0, f"{shlex.join(line)}\n{done.output}"
        if "--out" in line:
            assert any((folder / line[line.index("--out") + 1]).iterdir())


WITH_COMMANDS = [page for page in RUN if commands(page)]


@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_cheap_commands_run(page, tmp_path, monkeypatch):
    cheap = [line for line in commands(page) if is_cheap(line)]
    longer = ("notebooks/desk.md", "notebooks/identify.md")
    assert cheap or page in longer
    without_drawing(monkeypatch)  # tests of each command look at its pictures
    run_all(page, cheap, tmp_path, monkeypatch)


# What is measured over a revolution, and of a modal test, is too long for a page.
NOT_SHOWN = {"diagram.csv", "modes.uff"}
# The cluster of `--dask` is not there; tests of sweeps start one. `desk` serves until it is interrupted;
# see `test_desk.py`.
LONGER = {
    f"{Path(page).stem}-{i}-{line[0]}": (page, line)
    for page in WITH_COMMANDS
    for i, line in enumerate(commands(page))
    if not is_cheap(line) and not {"--dask", *NOT_SHOWN} & set(line) and line[0] != "desk"
}


@pytest.mark.slow
@pytest.mark.parametrize(("page", "line"), LONGER.values(), ids=LONGER)
def test_longer_commands_run(page, line, tmp_path, monkeypatch):
    files = [one for one in commands(page) if one[0] == "new"]
    if line[0] == "tolerance":
        # the last one counts; of thousands nothing more is seen here
        line = [*line, "--samples", "256"]
    run_all(page, [*files, line], tmp_path, monkeypatch)


TABLES = [(page, code) for page in RUN for code in blocks(page, "toml")]


@pytest.mark.parametrize(("page", "code"), TABLES, ids=lambda x: x.partition("\n")[0])
def test_sections_of_machine_files_have_entries_that_exist(page, code):
    """Each key of an excerpt belongs to a part that may stand in its section."""
    for section, table in tomllib.loads(code).items():
        known = {
            entry.name
            for place in explained(section)
            for entry in place.entries
            if place.kind == table.get("type", place.kind)
        }
        assert set(table) <= known | {"type", "source", "csv"}, (section, known)


def test_the_two_commands_install_what_is_offered(monkeypatch):
    """`.ci/run` takes the second from the README; the first ends with a command that is run here."""
    run, test = [b.strip() for b in blocks("README.md", "bash")[:2]]
    assert [line for line in text_of("README.md").splitlines() if "/pytest" in line] == [test]
    for line in (run, test):
        assert line.startswith("python3 -m venv .venv && .venv/bin/pip install -q ")
    extras = tomllib.loads(text_of("pyproject.toml"))["project"]["optional-dependencies"]
    (extra,) = re.findall(r'"\.\[(\w+)\]"', test)
    assert extra in extras
    command = shlex.split(run.rsplit("&&", 1)[1])
    assert command[0].endswith("jaxcomp")
    monkeypatch.chdir(ROOT)
    done = CliRunner().invoke(app, command[1:])
    assert done.exit_code == 0, done.output
    assert "91.17 %" in done.stdout  # 1000 rpm and 130 mm, as the page of validation says


# ------------------------------------------------------------------- links and names
def anchors(path: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_and_headings(page):
    targets = re.findall(r"\]\(([^)]+)\)", text_of(page)) + re.findall(
        r'src="([^"]+)"', text_of(page)
    )
    for target in targets:
        if target.startswith("https://"):
            continue
        file, _, anchor = target.partition("#")
        path = (ROOT / page).parent / file if file else ROOT / page
        if file.startswith("reference/"):  # pages that only the site has
            names = public_names()
            assert path.stem in {*names, *MADE}, target
            name = anchor.rpartition(".")[2]
            assert not anchor or name in names[path.stem], target
            continue
        assert path.exists(), target
        if anchor:
            assert anchor in anchors(path), target


def test_wrong_links_of_built_pages_are_found(tmp_path):
    """By what the build of the site calls at its end."""
    good = '<a href="b.html#here">b</a><img src="c.png"><a href="https://example.org">away</a>'
    (tmp_path / "a.html").write_text(good)
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1><a href="#here">up</a>')
    (tmp_path / "c.png").touch()
    assert list(broken(tmp_path)) == []
    bad = '<a href="d.html">d</a><a href="b.html#there">b</a><script src="//example.org/x.js"></script>'
    (tmp_path / "a.html").write_text(bad)
    (tmp_path / "a.css").write_text("a { background: url(https://example.org/x.png) }")
    assert list(broken(tmp_path)) == [
        "a.html loads //example.org/x.js",
        "a.html: d.html leads to no file",
        "a.html: b.html#there leads to no heading",
        "a.css loads https://example.org/x.png",
    ]


def test_pages_of_the_site_are_markdown_before_it_is_built(tmp_path, monkeypatch):
    """Without hooks of a builder; the navigation names them all, parts and machines have pages."""
    monkeypatch.syspath_prepend(ROOT / "notebooks")
    build = runpy.run_path(str(ROOT / "notebooks" / "build_site.py"))
    assert build["write_pages"](tmp_path) == []
    settings = yaml.safe_load((tmp_path / "mkdocs.yml").read_text("utf-8"))
    assert "hooks" not in settings

    def listed(entry):
        if isinstance(entry, str):
            return [entry]
        values = entry.values() if isinstance(entry, dict) else entry
        return [page for value in values for page in listed(value)]

    pages = tmp_path / settings["docs_dir"]
    there = {path.relative_to(pages).as_posix() for path in pages.rglob("*.md")}
    assert sorted(listed(settings["nav"])) == sorted(there)
    parts = (pages / "reference" / "entries.md").read_text("utf-8")
    kinds = {place.kind for place in part_places().values()}
    assert set(re.findall(r"^## (\w+) in", parts, re.M)) == kinds
    assert "| `clearance_ratio` |" in parts
    quantities = (pages / "reference" / "quantities.md").read_text("utf-8")
    assert "| `cop` |  | more | Capacity over electric power;" in quantities
    assert "\n## r290-6cc\n" in (pages / "reference" / "machines.md").read_text("utf-8")
    index = (pages / "llms.txt").read_text("utf-8")
    of_machines = {page for page in listed(settings["nav"]) if page.startswith("reference/jaxcomp")}
    for page in set(listed(settings["nav"])) - of_machines:
        assert f"]({page[:-3]}.html): " in index, page
    problems = []
    build["_with_site_links"]("start.md", "[a](gone.md), [b](../setup.cfg)", problems)
    assert problems == ["notebooks/start.md: the site has no page for ../setup.cfg"]


@pytest.mark.parametrize("page", PAGES)
def test_tests_and_files_that_a_page_names_exist(page):
    text = text_of(page)
    for file, function in re.findall(r"`(?:tests/\w+/)?(test_\w+\.py)(?:::(\w+))?`", text):
        [path] = (ROOT / "tests").glob(f"**/{file}")
        assert not function or f"\ndef {function}(" in path.read_text(encoding="utf-8"), function
    for file in re.findall(r"`((?:tests|notebooks|jaxcomp)/[\w./-]+\.\w+)`", text):
        assert (ROOT / file).exists(), file


def test_every_row_of_the_page_of_validation_names_its_test():
    tables = re.findall(r"(?:^\|.*\n)+", text_of("notebooks/validation.md"), re.M)
    rows = 0
    for table in tables:
        head, _, *lines = table.splitlines()
        assert head.endswith("| test |"), head
        for line in lines:
            cells = line.split("|")
            assert len(cells) == len(head.split("|")), line
            named = re.fullmatch(r".*`test_\w+\.py::test_\w+`", cells[-2].strip())
            # what the page compares with nothing
            assert named or "not compared" in line or "a limit" in line, line
            rows += 1
    assert rows > 80


def test_figures_in_short_stand_in_the_tables_below():
    page = text_of("notebooks/validation.md").split("## In short")[1]
    table, below = page.split("\n## ", 1)
    figures = re.findall(r"[\d.,]+ %|[\d.,]+ g mm|[\d.]+ W\b", table)
    assert len(figures) >= 6
    for figure in figures:
        assert figure in below, figure


def _printed(code, **settings):
    """What a process prints that has none of the tests' settings of JAX and XLA."""
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_ENABLE_X64")}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=environment | settings | {"PYTHONPATH": str(ROOT)},
    )
    return done.stdout.strip()


def _precision_and_flags(**settings):
    """What a process has after the import: whether it computes in double precision, and XLA's flags."""
    code = "import jaxcomp; jaxcomp.load; import jax, os; "
    code += "print(jax.config.jax_enable_x64, os.environ.get('XLA_FLAGS'))"
    return _printed(code, **settings).split(" ", 1)


def test_quick_programs_are_compiled_as_those_of_commands():
    """Level 0 and fewer passes, as the page says; a command finds the same flags, hence programs."""
    _, flags = _precision_and_flags(JAXCOMP_XLA_FLAGS="quick")
    assert "--xla_backend_optimization_level=0" in flags
    assert "--xla_backend_optimization_level=1" not in flags
    code = "from jaxcomp.cli._start import start_jax; start_jax(once=True); import os; "
    code += "print(os.environ['XLA_FLAGS'])"
    assert _printed(code).split() == flags.split()


# Whether single programs have options of their own, and whether those of commands have the same flags.
OPTIONS = """
import jaxcomp
jaxcomp.load
from jaxcomp._core.precision import flags_with, quick_options, unoptimised_compiles
options = quick_options()
print(bool(options))
of_solution = flags_with(options)
unoptimised_compiles()
print(of_solution == flags_with(quick_options()))
"""


@pytest.mark.parametrize(
    ("settings", "quick", "as_commands"),
    [
        ({}, True, True),
        ({"JAXCOMP_XLA_FLAGS": "quick"}, False, True),
        ({"JAXCOMP_XLA_FLAGS": "optimised"}, False, False),
        ({"JAXCOMP_XLA_FLAGS": "0"}, False, False),
        ({"XLA_FLAGS": "--xla_backend_optimization_level=3"}, False, False),
    ],
    ids=str,
)
def test_a_solution_in_a_script_is_compiled_as_those_of_commands(settings, quick, as_commands):
    """So that it finds theirs, unless the user has settings of his own."""
    assert _printed(OPTIONS, **settings).split() == [str(quick), str(as_commands)]


def test_an_unknown_setting_of_xla_is_refused():
    environment = os.environ | {"JAXCOMP_XLA_FLAGS": "fast", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "jaxcomp", "list"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 2
    words = "error: `JAXCOMP_XLA_FLAGS` must be 0, 1, quick or optimised, but is fast.\n"
    assert done.stderr == words
    imported = subprocess.run(
        [sys.executable, "-c", "import jaxcomp; jaxcomp.load"],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert words.removeprefix("error: ") in imported.stderr


@pytest.mark.parametrize(("word", "kept"), [(None, False), ("0", True)])
def test_environment_variables_do_what_the_page_says(word, kept):
    """Whether the import leaves the precision and the flags of XLA as they are."""
    settings = {}
    if word is not None:
        settings = {"JAXCOMP_X64": word, "JAXCOMP_XLA_FLAGS": word}
    precision, flags = _precision_and_flags(**settings)
    assert (precision == "False") is kept
    row = next(line for line in text_of("notebooks/conventions.md").splitlines() if "XLA's" in line)
    named = re.findall(r"`(--xla\w+=[\w=]+)`", row)
    assert len(named) == 4
    of_jaxlib = tuple(map(int, version("jaxlib").split(".")[:2]))
    # what 0.11 and 0.12 take of them; whether a later one does is not known
    taken = named if of_jaxlib < (0, 10) else named[1:3] if of_jaxlib < (0, 13) else ["None"]
    assert flags.split() == (["None"] if kept else taken)


@pytest.mark.parametrize(
    ("title", "part"), [("Slider-crank", SliderCrank), ("Slider-link", SliderLink)]
)
def test_symbols_of_a_sketch_name_entries_of_the_mechanism(title, part):
    section = text_of("notebooks/conventions.md").split(f"### {title}\n")[1].split("\n### ")[0]
    named = re.findall(r"^\| \$[^|]*\$ \| `(\w+)`", section, re.M)
    assert len(named) >= 5
    assert set(named) <= {field.name for field in dataclasses.fields(part)}
    (sketch,) = re.findall(r"\]\((\w+\.svg)\)", section)
    drawn = (ROOT / "notebooks" / "sketches.py").read_text("utf-8")
    assert f"def {sketch.removesuffix('.svg')}()" in drawn
