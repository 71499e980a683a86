r"""Finite elements: density of the mesh, and the structured solver beside a dense one.

Each shaft element is cut into several. The error falls with the square of the length where shear
counts (see `jaxcomp.rotor._shaft`), so that two meshes extrapolate to the limit (Richardson); the
reference does so with the structured solver, beside the dense solver on two other meshes.
"""

import dataclasses
from functools import cache, partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np

from .._fields import BadInput
from ..rotor import AXES, BalancingPlanes, LoadCase, RotorModel, ShaftElements, node_index, respond
from ._measure import compile_program
from ._report import Reference, Row
from ._study import Piece, Question, Study

_ORDER = 2
_CUTS = {"structured": (1, 2, 4), "dense": (1, 2, 3)}
_THOROUGH = {"structured": (1, 2, 3, 4, 6), "dense": (1, 2, 3, 4)}


def mesh_study(question: Question, thorough: bool) -> Study:
    """Elements a shaft element is cut into, by either solver.

    Raises:
        BadInput: no rotor with planes, or another quantity than the vibration of its targets.
    """
    parts = question.design.parts
    model, case, places = (parts.get(name) for name in ("rotor", "loads", "balancing"))
    if not (
        isinstance(model, RotorModel)
        and isinstance(case, LoadCase)
        and isinstance(places, BalancingPlanes)
        and model.shafts
    ):
        raise BadInput("study", "mesh", "one that the scene has: it needs a rotor with its planes")
    if question.quantity != "vibration":
        raise BadInput("quantity", question.quantity, "'vibration' for the study of meshes")
    programs = cache(partial(_program, model, case, places))

    def limit(solver):
        coarse, fine = _CUTS[solver][-2:]
        values = [
            float(programs(solver, cuts)[0](programs(solver, cuts)[1])) for cuts in (coarse, fine)
        ]
        return values[1] + (values[1] - values[0]) / ((fine / coarse) ** _ORDER - 1)

    def reference():
        methods = tuple(
            f"{solver} solver, {' and '.join(map(str, cuts[-2:]))} cuts extrapolated"
            for solver, cuts in _CUTS.items()
        )
        return Reference(limit("structured"), limit("dense"), methods)  # pyright: ignore

    pieces = tuple(
        Piece(f"{solver}, {cuts} cuts", partial(_rows, programs, solver, cuts))
        for solver, counts in (_THOROUGH if thorough else _CUTS).items()
        for cuts in counts
    )
    return Study(reference, pieces, "finite elements, response at the speeds of the planes")


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


def _program(model, case: LoadCase, places: BalancingPlanes, solver, cuts):
    fine = refined(model, cuts)
    loads = (*case.unbalances, *case.forces)

    def vibration(model):
        response = respond(model, loads, places.speeds, (1,), solver=solver)
        rows = []
        for target in places.targets:
            x = response.displacement[..., node_index(model, target.node), :]
            if target.relative_to is not None:
                x = x - response.displacement[..., node_index(model, target.relative_to), :]
            rows += [target.weight * x[..., AXES[model.dof].index(axis)] for axis in target.axes]
        weight = sum(len(t.axes) * t.weight**2 for t in places.targets)
        square = sum(jnp.sum(jnp.abs(row) ** 2) for row in rows)
        return jnp.sqrt(square / (places.speeds.size * weight))

    return compile_program(vibration, fine), fine


def _rows(programs, solver, cuts, reference: Reference):
    program, model = programs(solver, cuts)
    value = float(jax.device_get(program(model)))
    elements = sum(len(s.nodes) for s in model.shafts)
    yield Row(
        solver,
        f"{elements} elements",
        reference.error(value),
        program.timed(model),
        program.seconds,
        None,
        program.flops,
        tightness=(float(elements),),
    )
