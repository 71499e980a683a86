"""The examples in the docstrings of the public verbs, run as they are printed."""

import doctest
from importlib import import_module

import pytest

# By the verb that a user looks up; `slow` where the example compiles a solver and its gradient.
EXAMPLES = {
    "load": "jaxcomp.scene._scene",
    "with_bore": "jaxcomp.study._rules",
    "problem": "jaxcomp.study._problem",
    "JournalBearing": "jaxcomp.film._bearing",
    "trial_influence": "jaxcomp.balancing._influence",
}
SLOW = {
    "solve_orbit": "jaxcomp.crank._solve_orbit",
    "respond": "jaxcomp.rotor._response",
    "simulate": "jaxcomp.crank._transient",
    "optimise": "jaxcomp.study._optimise",
    "sweep": "jaxcomp.study.sweep._run",
    "sensitivity": "jaxcomp.study._sensitivity",
    "steady_state": "jaxcomp.study._steady_state",
}


@pytest.mark.parametrize(
    ("name", "module"),
    [*EXAMPLES.items(), *(pytest.param(*one, marks=pytest.mark.slow) for one in SLOW.items())],
)
def test_examples_of_the_docstring(name, module):
    room = import_module(module)
    finder = doctest.DocTestFinder(recurse=False)
    cases = finder.find(getattr(room, name), name, module=room, globs=vars(room).copy())
    assert sum(len(case.examples) for case in cases) >= 2
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    told: list[str] = []
    for case in cases:
        runner.run(case, out=told.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(told)


def test_a_wrong_example_is_noticed():
    case = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, 0)
    runner = doctest.DocTestRunner()
    runner.run(case, out=lambda text: None)
    assert runner.summarize(verbose=False).failed == 1
