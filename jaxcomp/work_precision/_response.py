r"""Response of the rotor: by number of speeds and solver, by number of elements, and by harmonics kept.

Speeds: block elimination along the shaft and a dense solver of the library, each for many speeds in
one call, beside NumPy on the full matrices, one speed after the other, with refinement in extended
precision. Elements: each shaft element is cut into several; the error falls with the square of the
length where shear counts (see `jaxcomp.rotor._shaft`), so that two meshes extrapolate to the limit
(Richardson). Harmonics: orders of the spin speed that are kept, beside many more of them by another
solver of the crank.
"""

import dataclasses
from functools import cache, partial
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from ..coupling import loaded_rotor
from ..rotor import RotorModel, ShaftElements, load_vector, matrices, respond
from ._measure import compile_program
from ._orbit import ROTOR_QUANTITIES, shooting
from ._report import Reference
from ._study import (
    TIGHT_TOLERANCE,
    Call,
    Question,
    Setting,
    SolverProgram,
    Study,
    needs_crank,
    needs_rotor,
)

_LOWEST = 0.2  # [-] first of the speeds, over the highest of the balancing planes'
_COUNTS = (1, 10, 100, 1000)
_JUDGED = 10  # speeds that are judged, the same of every number of them
_ORDER = 2
_CUTS = (1, 2, 3, 4)
_HARMONICS = (1, 2, 4, 8)
_MANY = (16, 20)


def response_study(question: Question, thorough: bool) -> Study:
    """Solvers of the response by number of speeds; the error is that of all displacements."""
    made = needs_rotor(question, "response")
    assert made.balancing is not None
    top = float(jnp.max(made.balancing.speeds))
    judged = np.linspace(_LOWEST, 1.0, _JUDGED) * top
    model, loads = loaded_rotor(made, jnp.asarray(judged)), made.given_loads or made.unbalances

    def by_numpy(refined: bool):
        return np.stack([_direct(model, loads, speed, refined) for speed in judged])

    def solve(solver, model, loads, speeds):
        return respond(model, loads, speeds, solver=solver).displacement[0]

    def make(solver, count):
        # the judged ones again and again, so that the number of speeds alone is what differs
        speeds = jnp.asarray(np.resize(judged, count))
        program = compile_program(partial(solve, solver), model, loads, speeds)
        run = program.on(model, loads, speeds)

        def first():
            found = run()
            return found if count < _JUDGED else found[:_JUDGED]

        return Call(first, program)

    def reference(count=_JUDGED):
        value, other = exact()[:count], np.asarray(make("dense", _JUDGED).run())[:count]
        return Reference(value, other, ("NumPy in extended precision", "the dense solver"))

    exact = cache(lambda: by_numpy(True))
    single = cache(partial(reference, 1))
    whole = cache(reference)
    settings = [
        Setting(solver, f"{count} speeds", partial(make, solver, count), share=count,
                reference=single if count == 1 else whole)
        for solver in ("structured", "dense")
        for count in (_COUNTS if thorough else _COUNTS[:3])
        if solver == "structured" or count <= 100
    ]  # fmt: skip
    settings.append(
        Setting("NumPy", f"{_JUDGED} speeds", lambda: Call(partial(by_numpy, False)),
                share=_JUDGED, reference=whole)
    )  # fmt: skip
    words = "response at many speeds in one call, times are of one speed"
    return Study(whole, tuple(settings), words)


def _direct(model, loads, speed: float, refined: bool):
    """[m], [rad] (nodes, dof) displacement at one speed by the full matrices."""
    force = np.asarray(load_vector(model, loads, 1, jnp.asarray(speed)))
    m, c, g, k, expand = (np.asarray(a) for a in matrices(model, speed))
    z = k - speed**2 * m + 1j * speed * (c + speed * g)
    f = expand.T @ force.reshape(-1)
    x = np.linalg.solve(z, f)
    for _ in range(2 * refined):
        rest = f.astype(np.clongdouble) - z.astype(np.clongdouble) @ x.astype(np.clongdouble)
        x = x + np.linalg.solve(z, rest.astype(complex))
    return (expand @ x).reshape(force.shape)


def mesh_study(question: Question, thorough: bool) -> Study:
    """Elements that each shaft element is cut into, for a quantity of the rotor.

    Raises:
        BadInput: no rotor with planes, or another quantity.
    """
    needs_rotor(question, "mesh")
    _needs_rotor_quantity(question)
    model = question.design.parts["rotor"]
    assert isinstance(model, RotorModel)

    @cache
    def program(cuts):
        design = eqx.tree_at(lambda d: d.parts["rotor"], question.design, refined(model, cuts))
        return SolverProgram(question._replace(design=design), None)

    def limit(coarse, fine):
        low, high = (program(cuts).value(1e-13) for cuts in (coarse, fine))
        return high + (high - low) / ((fine / coarse) ** _ORDER - 1)

    def reference():
        methods = tuple(f"{a} and {b} cuts extrapolated" for a, b in ((2, 4), (3, 4)))
        return Reference(limit(2, 4), limit(3, 4), methods)  # pyright: ignore

    elements = sum(len(s.nodes) for s in model.shafts)
    settings = tuple(
        Setting("finite elements", f"{cuts * elements} elements", lambda cuts=cuts: program(cuts).call(),
                (float(cuts),))
        for cuts in (*_CUTS, *((6,) if thorough else ()))
    )  # fmt: skip
    return Study(reference, settings, "finite elements, response at the speeds of the planes")


def harmonics_study(question: Question, thorough: bool) -> Study:
    """Orders of the crank's forces that are kept in a quantity of the rotor."""
    needs_rotor(question, "harmonics")
    needs_crank(question, "harmonics")
    _needs_rotor_quantity(question)
    if question.quantity == "balanced_vibration":
        raise BadInput("quantity", question.quantity, "one of more orders than the first")

    def kept(count, solver=None):
        return SolverProgram(question._replace(orders=tuple(range(1, count + 1))), solver)

    def reference():
        fewer, more = _MANY
        value = kept(more, question.fine_solver).value(1e-13)
        other = kept(fewer, shooting(question)).value(TIGHT_TOLERANCE)
        return Reference(value, other, (f"{more} orders, collocation", f"{fewer} orders, shooting"))

    settings = tuple(
        Setting(
            "orders kept", f"1 to {count}", lambda count=count: kept(count).call(), (float(count),)
        )
        for count in (*_HARMONICS, *((12, 16) if thorough else ()))
    )
    return Study(reference, settings, f"harmonics, excitation '{question.excitation}'")


def _needs_rotor_quantity(question: Question) -> None:
    if question.quantity.partition(".")[0] not in ROTOR_QUANTITIES:
        bound = f"one of the rotor: {', '.join(ROTOR_QUANTITIES)}"
        raise BadInput("quantity", question.quantity, bound)


def refined(model: RotorModel, cuts: int) -> RotorModel:
    """The model with every shaft element cut into equal ones.

    Args:
        model: any; its own nodes stay, those in between are named after their element.
        cuts: how many.
    """
    if cuts == 1:
        return model
    return dataclasses.replace(model, shafts=tuple(_cut(s, cuts) for s in model.shafts), nodes=None)


def _cut(shaft: ShaftElements, cuts: int) -> ShaftElements:
    share = np.tile(np.arange(cuts) / cuts, len(shaft.nodes))
    columns = {
        field.name: jnp.repeat(getattr(shaft, field.name), cuts)
        for field in dataclasses.fields(shaft)
        if "unit" in field.metadata and getattr(shaft, field.name) is not None
    }
    columns["length"] = columns["length"] / cuts
    for name in ("outer_diameter", "inner_diameter"):
        end = columns.get(f"{name}_end")
        if end is not None:
            start = columns.get(name, jnp.zeros_like(end))
            columns[name] = start + (end - start) * share
            columns[f"{name}_end"] = start + (end - start) * (share + 1 / cuts)
    pairs = []
    for left, right in shaft.nodes:  # pyright: ignore[reportGeneralTypeIssues]
        inner = [f"{left}~{right}~{n}" for n in range(1, cuts)]
        pairs += pairwise([left, *inner, right])
    return dataclasses.replace(shaft, nodes=tuple(pairs), **columns)
