"""Python inputs of the wrong kind: each is answered with a sentence that says what to write."""

import re

import numpy as np
import pytest

import jaxcomp as jc
from jaxcomp import BadInput
from jaxcomp.scene import SceneError
from jaxcomp.study.tolerance import within

CRANK = {"crank_radius": 0.05, "conrod_length": 0.29, "piston_mass": 2.6, "conrod_mass": 3.8}
EFFICIENCY = ["mechanical_efficiency"]


@pytest.fixture(scope="module")
def scene():
    return jc.load("mayekawa-wbhe")


def mechanism(bore):
    return jc.SliderCrank(bore=bore, **CRANK)


def ranged(scene):
    return jc.problem(scene, {"mechanism.bore": (0.12, 0.14)}, EFFICIENCY)


MISTAKES = {
    "name of a file": (lambda s: jc.solve_orbit("my.toml"), '`jaxcomp.load("my.toml")`'),
    "no machine": (lambda s: jc.solve_orbit(None), "`jaxcomp.load("),
    "name for a study": (lambda s: jc.sensitivity("my.toml"), '`jaxcomp.load("my.toml")`'),
    "text with a unit": (lambda s: jc.with_bore(s.machine, "50 mm"), "0.05 for 50 mm"),
    "scene for its machine": (lambda s: jc.with_bore(s, 0.12), '`jaxcomp.load("my.toml").machine`'),
    "array": (lambda s: jc.with_bore(s.machine, np.array([0.12, 0.13])), "`jax.vmap`"),
    "text in a part": (lambda s: mechanism("130 mm"), "a number in SI units"),
    "bore in mm": (lambda s: mechanism(130.0), r"130 mm are 0.13"),
    "rule in mm": (lambda s: jc.with_bore(s.machine, 130.0), "<= 10 m"),
    "range in mm": (lambda s: jc.problem(s, {"bore": (100, 150)}, EFFICIENCY), "<= 10 m"),
    "sweep in mm": (lambda s: jc.sweep(s, {"mechanism.bore": [130.0]}), "<= 10 m"),
    "range with units": (
        lambda s: jc.problem(s, {"mechanism.bore": ("100 mm", "150 mm")}, EFFICIENCY),
        "a range of numbers in m",
    ),
    "number for a range": (lambda s: jc.problem(s, {"bore": 0.2}, EFFICIENCY), "(low, high)"),
    "notation of the command line": (
        lambda s: jc.sweep(s, {"mechanism.bore": "0.1:0.2:3"}),
        "`sweeping.grid(",
    ),
    "number for a tolerance": (lambda s: jc.tolerance(s, {"bore": 0.2}), "within(2e-5)"),
    "text for a tolerance": (
        lambda s: jc.tolerance(s, {"mechanism.bore": "+-0.2 mm"}),
        "within(2e-5)",
    ),
    "list of tolerances": (lambda s: jc.tolerance(s, ["mechanism.bore"]), "tolerances by name"),
    "text for a list": (
        lambda s: jc.sensitivity(s, "mechanical_efficiency"),
        'a list, ["mechanical_efficiency"]',
    ),
    "text for variables": (lambda s: jc.problem(s, "bore", EFFICIENCY), 'a list, ["bore"]'),
    "problem of nothing": (lambda s: jc.problem(s), '{"bore": (0.12, 0.14)}'),
    "problem without quantities": (
        lambda s: jc.problem(s, ["bore"]),
        'a list such as ["mechanical_efficiency"]',
    ),
    "number for quantities": (lambda s: jc.problem(s, ["bore"], 5), "a list of names"),
    "range beside its name": (
        lambda s: jc.problem(s, [("bore", 0.1, 0.2)], EFFICIENCY),
        "{name: value}",
    ),
    "dictionary for options": (
        lambda s: jc.problem(s, ["bore"], EFFICIENCY, {"orders": 2}),
        "`AnalysisOptions(...)`",
    ),
    "options of sensitivity": (
        lambda s: jc.sensitivity(s, EFFICIENCY, options="fine"),
        "`AnalysisOptions(...)`",
    ),
    "front of nothing": (lambda s: jc.pareto(ranged(s)), "such as ("),
    "front of one": (lambda s: jc.pareto(ranged(s), "motor_power"), "such as ("),
    "one direction for two": (
        lambda s: jc.pareto(ranged(s), (*EFFICIENCY, "motor_power"), maximise=True),
        "(True, False)",
    ),
    "text for points": (
        lambda s: jc.pareto(ranged(s), (*EFFICIENCY, "motor_power"), points="12"),
        "a number >= 3",
    ),
    "optimum of nothing": (lambda s: jc.optimise(), "problem(scene, {"),
    "list of objectives": (lambda s: jc.optimise(ranged(s), EFFICIENCY), "one quantity by name"),
    "constraint as text": (
        lambda s: jc.optimise(ranged(s), constraints={"motor_power": "<=5 kW"}),
        "(low, high) in SI units",
    ),
    "constraint as a number": (
        lambda s: jc.optimise(ranged(s), constraints={"motor_power": 5e3}),
        "(low, high) in SI units",
    ),
    "list of constraints": (
        lambda s: jc.optimise(ranged(s), constraints=["motor_power"]),
        '{"motor_power": (None, 5000.0)}',
    ),
    "number for a method": (lambda s: jc.optimise(ranged(s), method=3), "slsqp"),
    "tolerance of nothing": (lambda s: jc.tolerance(s), "within(2e-5)"),
    "number for a limit": (
        lambda s: jc.tolerance(s, {"bore": within(1e-5)}, limits={"motor_power": 0.9}),
        "(low, high) in SI units",
    ),
    "sweep of nothing": (lambda s: jc.sweep(s), '{"mechanism.bore": [0.12, 0.13]}'),
    "list for a sweep": (lambda s: jc.sweep(s, ["bore"]), '{"mechanism.bore": [0.12, 0.13]}'),
    "sweep with units": (
        lambda s: jc.sweep(s, {"mechanism.bore": ["120 mm", "130 mm"]}),
        "numbers in SI units",
    ),
    "scene for a problem": (lambda s: jc.optimise(s, "motor_power"), "problem(scene, {"),
}


@pytest.mark.parametrize(("mistake", "advice"), MISTAKES.values(), ids=MISTAKES)
def test_the_answer_says_what_to_write(scene, mistake, advice):
    with pytest.raises(BadInput, match=re.escape(advice)):
        mistake(scene)


def test_something_else_is_no_file(scene):
    with pytest.raises(SceneError, match="name of a bundled machine or of a file"):
        jc.load(scene)
