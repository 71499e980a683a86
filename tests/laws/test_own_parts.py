"""Parts and quantities of another package: that of the pages "write your own", and what goes wrong.

The pages are taken at their word: their files are written to a folder, their entry points installed
beside them as pip would, and their commands run in a fresh process.
"""

import importlib
import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint

import pytest
from package.test_readme import (
    OWN,
    ROOT,
    blocks,
    commands,
    promised,
    public_names,
    titled,
    write_files,
)
from typer.testing import CliRunner

from jaxcomp import load, loads, register_quantity
from jaxcomp._core import extensions as _extensions
from jaxcomp._core import registry
from jaxcomp._core.errors import BadInput
from jaxcomp.cli import app
from jaxcomp.cli._options import complete_quantity
from jaxcomp.parts import ExtensionError
from jaxcomp.study import DesignResult, available_quantities, steady_state

CHEAP = {"explain", "check", "list"}

# Runs lines of arguments in one process, whose classes no other test sees.
DRIVER = """
import json, sys
from typer.testing import CliRunner
from jaxcomp.cli import app

done = []
for line in json.loads(sys.stdin.read()):
    found = CliRunner().invoke(app, line)
    done.append([found.exit_code, found.output + (repr(found.exception) if found.exception else "")])
print("DONE" + json.dumps(done))
"""

# A class with a kind that is taken, in a process of its own for the same reason.
THIEF = """
from jaxcomp.friction import AbstractSlide
from jaxcomp import load

class Coulomb(AbstractSlide):
    kind = "coulomb"

    def force(self, load, speed):
        return 0 * load

try:
    load("mayekawa-wbhe")
except ImportError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The folder with the files of all pages, installed as pip would."""
    folder = tmp_path_factory.mktemp("own")
    for page in OWN:
        write_files(page, folder)
    (folder / "mylaws" / "__init__.py").touch()
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    installed = folder / f"{project['name']}-{project['version']}.dist-info"
    installed.mkdir()
    head = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (installed / "METADATA").write_text(head)
    points = project["entry-points"]["jaxcomp"].items()
    lines = ["[jaxcomp]", *(f"{name} = {module}" for name, module in points)]
    (installed / "entry_points.txt").write_text("\n".join(lines))
    return folder


def python(folder, code, given=""):
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=given,
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}",
            "COLUMNS": "200",
            # plugins that are installed beside pytest take as long to import as the tests to run
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        },
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_lines(folder, lines, before="", after=""):
    out = python(folder, before + DRIVER + after, json.dumps(lines)).rpartition("DONE")[2]
    answers = json.loads(out)
    for line, (code, text) in zip(lines, answers, strict=True):
        assert code == 0, f"{line}\n{text}"
    return [text for _, text in answers]


def test_every_own_page_has_a_module_of_the_package(package):
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    modules = {path.stem for path in (package / "mylaws").glob("[a-z]*.py")}
    assert set(project["entry-points"]["jaxcomp"].values()) == {f"mylaws.{m}" for m in modules}


def test_the_test_of_the_example_repository_passes(package):
    code = "import pytest; raise SystemExit(pytest.main(['-q', '-p', 'no:cacheprovider', 'tests']))"
    assert "5 passed" in python(package, code)


def sections_of_pages():
    """Excerpts of machine files on the pages, as changes of a bundled machine."""
    for page in OWN:
        for code in set(blocks(page, "toml")) - set(titled(page).values()):
            for section, table in tomllib.loads(code).items():
                if section in ("motor", "gas"):
                    yield section, table


def excerpts_read():
    """Lines of Python that put every excerpt into a machine."""
    code = "from jaxcomp import load\nfrom jaxcomp.scene import with_value\n"
    found = list(sections_of_pages())
    assert {section for section, _ in found} == {"motor", "gas"}
    for section, table in found:
        machine = "mayekawa-wbhe" if "type" in table else "r134a-7cc"  # a valve of it
        for name, part in table.items() if section == "gas" and "type" not in table else ():
            code += f"with_value(load({machine!r}), 'gas.{name}', {part!r})\n"
        if "type" in table:
            code += f"with_value(load({machine!r}), {section!r}, {table!r})\n"
    return code


def test_commands_know_the_package(package):
    """Explanation, check and listing, and that sections of the pages can be read."""
    lines = [line for page in OWN for line in commands(page) if line[0] in CHEAP]
    assert len(lines) >= 7
    # the sections in the same process, which ends with an error where one cannot be read
    answers = run_lines(package, lines, after=excerpts_read())
    texts = dict(zip(map(tuple, lines), answers, strict=True))
    assert "[friction.wall]" in texts[("explain", "stribeck")]
    assert "m/s" in texts[("explain", "stribeck")]
    assert "[gas.suction_valve]" in texts[("explain", "ring")]
    assert "share_of_loss.<joint>" in texts[("list", "--quantities")]
    assert "stribeck" in texts[("check", "stribeck.toml")]


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in OWN if commands(page)])
def test_all_commands_of_own_pages_run(package, page):
    run_lines(package, [line for line in commands(page) if line[0] not in CHEAP])


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be held here")
def test_a_machine_on_a_torque_curve_runs_on_one_processor(package):
    """Where jaxlib leaves calls of LAPACK in this program that it cannot compile."""
    one = min(os.sched_getaffinity(0))
    run_lines(package, [["run", "yoke.toml"]], f"import os\nos.sched_setaffinity(0, [{one}])\n")


EXAMPLES = [
    (page, i)
    for page in OWN
    for i, code in enumerate(blocks(page, "python"))
    if code not in titled(page).values()  # these are the modules of the package
]


def is_quick(page, number):
    """Whether an example solves no machine."""
    return "RingValve" in blocks(page, "python")[number]


@pytest.mark.parametrize(
    ("page", "number"),
    [pytest.param(*one, marks=() if is_quick(*one) else pytest.mark.slow) for one in EXAMPLES],
)
def test_examples_of_own_pages_run(package, page, number):
    code = blocks(page, "python")[number]
    shown = python(package, code)
    assert shown
    for line in promised(code):
        assert line in shown


def test_a_kind_of_the_library_cannot_be_taken(tmp_path):
    said = python(tmp_path, THIEF)
    assert 'Coulomb has the kind "coulomb" of jaxcomp.friction.coulomb.CoulombSlide' in said


@pytest.fixture
def own_quantities(monkeypatch):
    """Quantities of this module, which are forgotten again."""
    monkeypatch.setattr(registry, "_registered", dict(registry._registered))
    monkeypatch.setattr(registry, "_reported", set())
    return register_quantity


FAULTS = {
    "missing": (lambda r: r.orbit.no_such, "AttributeError: "),
    "python_if": (lambda r: 1.0 if r.orbit.motor_power > 0 else 0.0, "TracerBoolConversionError"),
    "nothing": (lambda r: None, "a NoneType comes back where a number is wanted"),
    "curve": (lambda r: r.orbit.motor_torque, "an array of shape"),
    "by_joint.<joint>": (lambda r: r.orbit.motor_power, "comes back where numbers by name"),
}


def test_own_quantities_that_fail_are_left_out_with_a_line_each(own_quantities, capsys):
    for name, (value, _) in FAULTS.items():
        own_quantities(name, value)
    own_quantities("double", lambda r: 2 * r.orbit.motor_power, unit="W")
    machine = load("mayekawa-wbhe")
    found = steady_state(machine)
    told = capsys.readouterr().err.splitlines()
    for name, (_, why) in FAULTS.items():
        (line,) = (line for line in told if f"'{name}'" in line)
        assert f"Quantity '{name}' of package" in line
        assert "test_own_parts" in line
        assert why in line
        assert "left out" in line
        assert name.partition(".")[0] not in found.quantities
    assert found.quantities["double"] == 2 * found.quantities["motor_power"]
    assert "double [W]" in found.orbit.to_dict()
    assert not any("missing" in key for key in found.orbit.to_dict())
    known = available_quantities(machine.machine, members=True)
    assert "double" in known
    assert not set(FAULTS) & set(known)
    assert capsys.readouterr().err == ""  # one line a process


@pytest.mark.parametrize("name", [name for name in FAULTS if "<" not in name])
def test_an_own_quantity_that_is_asked_for_and_fails_is_one_line(own_quantities, name):
    value, why = FAULTS[name]
    own_quantities(name, value)
    done = CliRunner().invoke(app, ["sensitivity", "mayekawa-wbhe", "--quantity", name])
    assert done.exit_code == 2
    (line,) = (line for line in done.stderr.splitlines() if "error" in line)
    assert f"error: Quantity '{name}' of package" in line
    assert why in line


def test_a_word_in_needs_is_known(own_quantities):
    with pytest.raises(BadInput, match=r"needs.*valves"):
        own_quantities("mine", lambda r: r.orbit.cycle.mass_flow, needs=("orbit", "valve"))
    assert own_quantities("mine", lambda r: 1.0, needs="valves").needs == ("valves",)
    for part in load("hermetic-68cc").parts:
        own_quantities("mine", lambda r: 1.0, needs=(part,))


def test_the_page_lists_what_a_result_has():
    page = (ROOT / "notebooks" / "own.md").read_text()
    for word in registry.NEEDS:
        assert f"`{word}`" in page, word
    attributes = re.findall(r"^\| `(\w+)` \|", page, re.M)
    public = {name for name in vars(DesignResult) if not name.startswith("_")}
    assert set(attributes) <= public | {"design", "options"}
    assert {"orbit", "performance", "assembly", "vibration", "journals"} <= set(attributes)


@pytest.fixture
def broken(monkeypatch):
    """An entry point whose module is not there."""
    point = EntryPoint("laws", "no_such_module", "jaxcomp")
    monkeypatch.setattr(_extensions, "entry_points", lambda group: [point])
    monkeypatch.setitem(_extensions._state, "imported", False)


@pytest.mark.usefixtures("broken")
def test_an_entry_point_that_cannot_be_imported_is_named():
    for _ in range(2):  # and again, not only the first time
        with pytest.raises(ExtensionError, match=r'laws = "no_such_module".*ModuleNotFoundError'):
            loads("[mechanism]")
    done = CliRunner().invoke(app, ["check", "mayekawa-wbhe"])
    assert done.exit_code == 2
    assert 'error: entry point laws = "no_such_module"' in done.output
    assert complete_quantity("mech") == []  # a key press in the shell prints no traceback


def test_modules_are_imported_once(monkeypatch):
    seen = []

    class Point:
        def load(self):
            seen.append(1)
            load("mayekawa-wbhe")  # read while it is imported

    monkeypatch.setattr(_extensions, "entry_points", lambda group: [Point()])
    monkeypatch.setitem(_extensions._state, "imported", False)
    for _ in range(2):
        _extensions.import_extensions()
    assert seen == [1]


def test_the_reference_has_every_public_name():
    """What the site lists, read from the sources, is what can be imported."""
    for module, names in public_names().items():
        there = importlib.import_module(module)
        assert set(names) <= set(dir(there)), module
        if hasattr(there, "__path__") and module != "jaxcomp":
            seen = {name for name in dir(there) if not name.startswith("_")}
            modules = {n for n in seen if inspect.ismodule(getattr(there, n))}
            assert seen - modules == set(names), module
    everything = set(importlib.import_module("jaxcomp").__all__)
    listed = public_names()
    modules = {name.partition(".")[2] for name in listed}
    assert everything == set(listed["jaxcomp"]) | (everything & modules)
    assert len(listed["jaxcomp"]) > 50
