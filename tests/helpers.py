"""Machines, finite differences and tree tools for the tests of the crank."""

import dataclasses
import json
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxcomp import Compressor, Status, solve_orbit
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.film import JournalBearing
from jaxcomp.friction import (
    CoulombJournal,
    CoulombSlide,
    PistonFilm,
    RegularisedJournal,
    RegularisedSlide,
    SliderCrankFriction,
)
from jaxcomp.gas import PolytropicCycle
from jaxcomp.mechanism import SliderCrank
from jaxcomp.motor import MeanSpeed
from jaxcomp.valve import PlateValve

RPM = np.pi / 30


def read_json(text):
    """A result of a command with the units taken off its keys: `{"period": 0.02}` for "period [s]"."""
    return json.loads(
        text, object_hook=lambda made: {k.partition(" [")[0]: v for k, v in made.items()}
    )


def results_validator(command):
    """What tells whether a result fits the JSON schema of a command's results."""
    from jaxcomp._core.registry import registered

    return _validator(command, tuple(one.name for one in registered()))


@cache
def _validator(command, quantities):
    from jsonschema import Draft202012Validator

    from jaxcomp.cli._answers import results_schema

    return Draft202012Validator(results_schema() | {"$ref": f"#/$defs/{command}"})


# Tsuji et al. (2012) Table 1 at a bore of 130 mm, with round values for what is not printed. The
# rod's mass centre and inertia are those of an ordinary rod, so that every parameter matters.
MECHANISM = {
    "bore": 0.130,
    "crank_radius": 0.050,
    "conrod_length": 0.294,
    "piston_mass": 2.65,
    "conrod_mass": 3.79,
    "conrod_centre": 0.084,
    "conrod_inertia": 0.07,
    "offset": 0.0,
}
CRANKSHAFT = {"inertia": 0.156, "mass": 20.0, "unbalance": -0.0757}
GAS = {
    "suction_pressure": 0.098e6,
    "discharge_pressure": 0.98e6,
    "exponent": 1.05,
    "clearance_ratio": 0.006,
    "back_pressure": 0.098e6,
}
WALL = 0.083
PINS = {"piston_pin": (0.013, 0.040), "crank_pin": (0.013, 0.090), "main_journal": (0.013, 0.092)}


class Laws(NamedTuple):
    """Friction of a slider-crank and of the shaft in its main journal."""

    friction: Any
    main_journal: Any = None


def laws(**joints) -> Laws:
    """Laws by joint, the main journal among them."""
    journal = joints.pop("main_journal", None)
    return Laws(SliderCrankFriction(**joints), journal)


def coulomb(scale=1.0, **parts):
    """The four Coulomb joints of the paper; `scale` multiplies all coefficients."""
    joints = {"wall": CoulombSlide(scale * WALL)}
    joints |= {name: CoulombJournal(scale * mu, d) for name, (mu, d) in PINS.items()}
    return laws(**(joints | parts))


def regularised(transition_speed, scale=1.0):
    journals = {
        name: RegularisedJournal(scale * mu, d, transition_speed) for name, (mu, d) in PINS.items()
    }
    return laws(wall=RegularisedSlide(scale * WALL, transition_speed), **journals)


# Every friction law of the slider-crank by name; a new law joins the tests by joining this list.
FRICTION = {
    "coulomb": coulomb(),
    "regularised": regularised(0.05),
    "film": coulomb(wall=None, piston_film=PistonFilm(5e-5, 0.05, 0.1)),
    "wall only": laws(wall=CoulombSlide(WALL)),
    "pins only": coulomb(wall=None),
    "none": laws(),
}


def mechanism(**changes) -> SliderCrank:
    return SliderCrank(**(MECHANISM | changes))


def machine(*, motor=None, friction="coulomb", gravity=(0.0, 0.0), gas=None, **changes):
    """The machine with changes to any number of mechanism, crankshaft or gas, by name."""
    unknown = set(changes) - set(MECHANISM) - set(CRANKSHAFT) - set(GAS)
    assert not unknown, unknown
    pick = lambda table: table | {k: v for k, v in changes.items() if k in table}  # noqa: E731
    given = coulomb() if friction == "coulomb" else friction
    given = given if isinstance(given, Laws) else Laws(given)
    return Compressor(
        SliderCrank(**pick(MECHANISM)),
        Crankshaft(**pick(CRANKSHAFT), main_journal=given.main_journal),
        MeanSpeed(1000 * RPM) if motor is None else motor,
        PolytropicCycle(**pick(GAS)) if gas is None else gas,
        given.friction,
        gravity,
    )


def unchecked(compressor, **changes):
    """A machine with values that its constructors would refuse, as a traced one may have them.

    Names are dotted paths, with `__` for the dot.
    """
    for path, value in changes.items():
        at = attrgetter(path.replace("__", "."))
        compressor = eqx.tree_at(at, compressor, jnp.asarray(value, float))
    return compressor


def random_mechanisms(rng, count, *, offset=True):
    """Machines of all proportions, as one mechanism with a leading axis on every leaf."""
    u = lambda low, high: rng.uniform(low, high, count)  # noqa: E731
    r = u(0.01, 0.1)
    l = r * u(2.0, 6.0)
    values = {
        "bore": u(0.03, 0.2),
        "crank_radius": r,
        "conrod_length": l,
        "piston_mass": u(0.1, 5),
        "conrod_mass": u(0.1, 5),
        "conrod_centre": l * u(-0.2, 1.1),
        "conrod_inertia": u(0, 0.1),
        "offset": (l - r) * u(-0.5, 0.5) if offset else np.zeros(count),
    }
    return jax.vmap(lambda v: SliderCrank(**v))({k: jnp.asarray(v) for k, v in values.items()})


def random_crankshafts(rng, count):
    """Crankshafts of all proportions, with a leading axis on every leaf."""
    u = lambda low, high: rng.uniform(low, high, count)  # noqa: E731
    values = {"inertia": u(0.01, 1), "mass": u(0, 30), "unbalance": u(-0.1, 0.1)}
    return jax.vmap(lambda v: Crankshaft(**v))({k: jnp.asarray(v) for k, v in values.items()})


def pick(tree, index):
    """One member of a batch."""
    return jax.tree.map(lambda x: x[index], tree)


def stack(trees):
    """A batch of machines of the same structure."""
    return jax.tree.map(lambda *xs: jnp.stack(xs), *trees)


def named_leaves(tree) -> dict[str, jax.Array]:
    pairs = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {jax.tree_util.keystr(path).lstrip("."): leaf for path, leaf in pairs}


def nudged(tree, name: str, change):
    """The tree with `change` added to the leaf of that name."""
    pairs, shape = jax.tree_util.tree_flatten_with_path(tree)
    leaves = [
        leaf + change if jax.tree_util.keystr(path).lstrip(".") == name else leaf
        for path, leaf in pairs
    ]
    return jax.tree.unflatten(shape, leaves)


# Central difference of fourth order: f' = sum(weight f(x + offset h))/h.
STENCIL = ((-2.0, 1 / 12), (-1.0, -2 / 3), (1.0, 2 / 3), (2.0, -1 / 12))


def difference(function, x, step):
    """Central difference of fourth order in a scalar."""
    return sum(w * function(x + o * step) for o, w in STENCIL) / step


def every_leaf_finite(tree) -> bool:
    leaves = [np.asarray(x) for x in jax.tree.leaves(tree)]
    return all(np.all(np.isfinite(x)) for x in leaves if np.issubdtype(x.dtype, np.floating))


def as_dict(module) -> dict[str, float]:
    """The numbers of a flat part."""
    return {
        f.name: float(getattr(module, f.name))
        for f in dataclasses.fields(module)
        if "unit" in f.metadata and getattr(module, f.name) is not None
    }


def status_of(result) -> str:
    """The name of the status, also of a result taken from a batch."""
    number = int(result.status._value)
    names = [n for n in Status._name_to_item if int(getattr(Status, n)._value) == number]
    return names[0]


# One compiled program per solver and structure of machine serves batches of this many.
CHUNK = 16


@cache
def _batch_program(solver, derivatives):
    def solve(compressor):
        return solve_orbit(compressor, solver, throw=False)

    def measures(compressor):
        orbit = solve(compressor)
        return jnp.stack([orbit.mechanical_efficiency, orbit.speed_fluctuation]), orbit

    def with_gradient(compressor):
        return jax.jacrev(measures, has_aux=True)(compressor)

    return jax.jit(jax.vmap(with_gradient if derivatives else solve))


def solve_many(machines, solver, *, derivatives=False):
    """Orbits of machines of one structure, in batches; with derivatives, (gradients, orbit) each.

    The gradients are those of efficiency and speed fluctuation, stacked.
    """
    program, results = _batch_program(solver, derivatives), []
    for start in range(0, len(machines), CHUNK):
        chunk = machines[start : start + CHUNK]
        batch = program(stack(chunk + [chunk[0]] * (CHUNK - len(chunk))))
        batch = jax.tree.map(np.asarray, batch)
        results += [pick(batch, i) for i in range(len(chunk))]
    return results


# What no constructor lets pass, as a traced machine may have it.
BAD = {
    "rod too short": {"mechanism__conrod_length": 0.04},
    "rod as long as crank": {"mechanism__conrod_length": 0.05},
    "offset too large": {"mechanism__offset": 0.25},
    "negative mass": {"mechanism__piston_mass": -1.0},
    "no inertia": {"crankshaft__inertia": 0.0},
    "pressures exchanged": {"gas__discharge_pressure": 0.05e6},
    "zero pressure": {"gas__suction_pressure": 0.0},
    "nan bore": {"mechanism__bore": np.nan},
    "infinite pressure": {"gas__discharge_pressure": np.inf},
    "nan gravity": {"gravity": [np.nan, 0.0]},
    "negative friction": {"friction__wall__coefficient": -0.1},
}


def with_films(design):
    """A slider-crank with films at the crank pin and the main journal."""

    def journal(diameter):
        return JournalBearing(
            diameter=diameter,
            length=0.8 * diameter,
            radial_clearance=5e-4 * diameter,
            dynamic_viscosity=0.02,
        )

    at = lambda c: (c.friction.crank_pin, c.crankshaft.main_journal)  # noqa: E731
    return eqx.tree_at(at, design, (journal(0.05), journal(0.06)))


def plate_valve(valve, unloader=None):
    """Valve of the package with the numbers of one of `reference_ends`."""
    return PlateValve(
        mass=valve.mass,
        damping=valve.damping,
        stiffness=valve.stiffness,
        preload=valve.preload,
        stop=valve.stop,
        port_diameter=valve.diameter,
        port_length=valve.length,
        unloader=unloader,
    )


def without_drawing(patch):
    """Let commands write empty pictures, for tests of everything else that they write.

    To lay out and draw the pictures of a result takes longer than to compute and print it.
    """

    def save_nothing(figure, file, **options):
        del figure, options
        file.write(b"no picture")

    patch.setattr("matplotlib.figure.Figure.savefig", save_nothing)
    patch.setattr("jaxcomp.plot._interactive.interactive_page", lambda figures, title: title)


# Several commands in one process, since imports take two seconds: pairs of changes of the environment and
# words, as JSON. Behind what each prints stands its exit code.
COMMANDS = """
import json, os, sys
from jaxcomp.__main__ import main

for environment, words in json.loads(sys.argv[1]):
    os.environ.update(environment)
    sys.argv = ["jaxcomp", *words]
    try:
        code = main()
    except SystemExit as end:
        code = end.code
    print("ended with", code or 0)
"""


def drawn_once(patch):
    """Let commands draw each picture as its own file alone, and not in reports and interactive pages."""
    patch.setattr("jaxcomp.report._page.picture_html", lambda name, picture: name)
    patch.setattr("jaxcomp.plot._interactive.interactive_page", lambda figures, title: title)


def briefly_timed(patch):
    """Let studies of accuracy take each time from one call, for tests of all else that they tell."""
    patch.setattr("jaxcomp.study.accuracy._study._WATCHED", 0.0)
    patch.setattr("jaxcomp.study.accuracy._study._LEAST", 1)
