"""How the code reads: one assignment a line, docstrings with a subject, no expression in its like."""

import ast
import re
from collections import Counter
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
LIMITS = {"packed": 141, "conditional": 0, "comprehension": 64}


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
    inside = (child for child in ast.walk(node) if child is not node)
    return isinstance(node, kinds) and any(isinstance(child, kinds) for child in inside)


def counted(text: str) -> Counter:
    """How often each of `LIMITS` occurs in a source."""
    count = Counter()
    for node in ast.walk(ast.parse(text)):
        count["packed"] += packed(node)
        count["conditional"] += within_itself(node, ast.IfExp)
        count["comprehension"] += within_itself(node, COMPREHENSIONS)
    return count


def without_subject(text: str) -> list[str]:
    """First lines of docstrings that name no subject."""
    kinds = ast.FunctionDef | ast.ClassDef
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
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


def test_what_is_counted_is_seen():
    assert counted("a, length = f(), g()\nx, y = 1, 2\n")["packed"] == 1
    assert counted("x = 1 if a else 2 if b else 3\n")["conditional"] == 1
    assert counted("x = [[i for i in j] for j in k]\n")["comprehension"] == 1
    assert without_subject('def f():\n    """What it is."""\n') == ["What it is."]
    assert without_subject('def f():\n    """Name of it."""\n') == []
