"""How the code reads: one assignment a line, docstrings with a subject, no expression in its like."""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "jaxcomp"
# A docstring that opens so says that there is something, and not what it is.
NO_SUBJECT = re.compile(r"(What|How|Whether it |The same|Of |As |With |Without |So |[a-z]\.)")
# Names of coordinates and counts may share a line: `x, y = 1.0, 2.0`.
SHORT = re.compile(r"[a-z]_?\w?")
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
# Upper limits as reached. Assignments share a line where a later one must not see the earlier, or where
# their function would grow beyond sixty lines.
LIMITS = {"packed": 1, "conditional": 0, "comprehension": 3}
# Lines of comments, each a reason, in a thousand lines of the packages of numerics, as reached.
LEAST_COMMENTS = 45
NUMERICS = ("_core", "balancing", "crank", "cylinder", "film", "friction", "rotor", "vibration")
# Names that say only that there is something: what it is stands nowhere.
EMPTY = frozenset(
    re.findall(
        r"\w+",
        """one found given made told asked kept known own seen wanted said rest here there both others
        nothing beside now most way whole last chosen taken done left such ours theirs mine it thing
        things stuff data_ tmp res val these those more less again still directly across""",
    )
)
# Of a package, as reached: empty names (parameters and fields that users type), conditional expressions
# and comprehensions in a thousand statements.
OF_PACKAGES = {
    "": (1, 13, 15),
    "_core": (0, 10, 29),
    "balancing": (3, 7, 23),
    "cli": (0, 10, 23),
    "crank": (0, 9, 15),
    "crankshaft": (0, 3, 22),
    "cylinder": (1, 8, 19),
    "desk": (1, 7, 21),
    "film": (0, 8, 17),
    "fluid": (0, 5, 21),
    "friction": (0, 5, 12),
    "gas": (0, 7, 19),
    "mechanism": (0, 6, 3),
    "motor": (0, 8, 0),
    "piping": (0, 3, 18),
    "plot": (7, 9, 22),
    "report": (0, 12, 25),
    "rotor": (0, 8, 23),
    "scene": (5, 10, 25),
    "study": (8, 4, 24),
    "valve": (0, 7, 4),
    "vibration": (0, 5, 21),
}


def packed(node: ast.AST) -> bool:
    """Whether several assignments share a statement."""
    if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
        return False
    target = node.targets[0]
    if not isinstance(target, ast.Tuple):
        return False
    names = [element.id for element in target.elts if isinstance(element, ast.Name)]
    return len(names) < len(target.elts) or not all(SHORT.fullmatch(name) for name in names)


def within_itself(node: ast.AST, kinds) -> bool:
    """Whether an expression holds another one of its kind."""
    if not isinstance(node, kinds):
        return False
    return any(isinstance(child, kinds) for child in ast.walk(node) if child is not node)


@cache
def nodes_of(text: str) -> list[ast.AST]:
    """All nodes of a source, which several tests look at."""
    return list(ast.walk(ast.parse(text)))


@cache
def counted(text: str) -> Counter:
    """How often each of `LIMITS` occurs in a source."""
    count = Counter()
    for node in nodes_of(text):
        count["packed"] += packed(node)
        count["conditional"] += within_itself(node, ast.IfExp)
        count["comprehension"] += within_itself(node, COMPREHENSIONS)
    return count


def is_empty_name(node: ast.AST) -> bool:
    """Whether a variable, argument or definition has a name that says nothing."""
    match node:
        case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
            return name in EMPTY
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return name.lstrip("_") in EMPTY
    return False


def figures_of(package: str) -> tuple[int, float, float]:
    """Empty names of a package; conditional expressions and comprehensions in a thousand statements."""
    count = Counter()
    folder = PACKAGE / package if package else PACKAGE
    for path in folder.rglob("*.py") if package else folder.glob("*.py"):
        for node in nodes_of(path.read_text("utf-8")):
            count["statements"] += isinstance(node, ast.stmt)
            count["names"] += is_empty_name(node)
            count["conditional"] += isinstance(node, ast.IfExp)
            count["comprehension"] += isinstance(node, COMPREHENSIONS)
    per_thousand = 1000 / count["statements"]
    shares = count["conditional"] * per_thousand, count["comprehension"] * per_thousand
    return count["names"], *shares


def without_subject(text: str) -> list[str]:
    """First lines of docstrings that name no subject."""
    kinds = ast.FunctionDef | ast.ClassDef
    nodes = [node for node in nodes_of(text) if isinstance(node, kinds)]
    openings = [(ast.get_docstring(node) or "").partition("\n")[0] for node in nodes]
    return [opening for opening in openings if NO_SUBJECT.match(opening)]


def sources() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def test_docstrings_name_their_subject():
    found = {path.name: without_subject(path.read_text("utf-8")) for path in sources()}
    assert {name: openings for name, openings in found.items() if openings} == {}


@pytest.mark.parametrize("kind", LIMITS)
def test_statements_hold_one_thought(kind):
    whole = sum((counted(path.read_text("utf-8")) for path in sources()), Counter())
    assert whole[kind] <= LIMITS[kind]


@pytest.mark.parametrize("package", OF_PACKAGES)
def test_a_package_reads_no_worse_than_it_did(package):
    names, conditional, comprehension = figures_of(package)
    most_names, most_conditional, most_comprehension = OF_PACKAGES[package]
    assert names <= most_names
    # a statement less among the others moves the share by a tenth of a thousandth at most
    assert conditional <= most_conditional + 0.5
    assert comprehension <= most_comprehension + 0.5


@pytest.mark.parametrize("package", NUMERICS)
def test_numerics_have_their_reasons_beside_them(package):
    lines = []
    for path in (PACKAGE / package).rglob("*.py"):
        lines += path.read_text("utf-8").splitlines()
    comments = [line for line in lines if line.lstrip().startswith("#")]
    assert len(comments) >= LEAST_COMMENTS / 1000 * len(lines)


def test_every_package_is_counted():
    packages = {path.parent.relative_to(PACKAGE).parts[:1] for path in sources()}
    assert {name for parts in packages for name in parts} | {""} == set(OF_PACKAGES)


def test_what_is_counted_is_seen():
    code = "def made(found):\n    one = found\n    return one\n"
    assert sum(map(is_empty_name, nodes_of(code))) == 3
    assert counted("a, length = f(), g()\nx, y = 1, 2\n")["packed"] == 1
    assert counted("x = 1 if a else 2 if b else 3\n")["conditional"] == 1
    assert counted("x = [[i for i in j] for j in k]\n")["comprehension"] == 1
    assert without_subject('def f():\n    """What it is."""\n') == ["What it is."]
    assert without_subject('def f():\n    """Name of it."""\n') == []
