"""Preparation of a model for its solvers."""

import equinox as eqx

from .._core.fields import admissible, replaced
from ._bodies import ModalDamping
from ._model import RotorModel
from ._modes import modal_damping_vectors
from ._places import sort_places
from ._system import System, bare


def prepare(model: RotorModel | System) -> System:
    """Prepare a model; a `System` passes as it is."""
    return model if isinstance(model, System) else _prepare(model)


@eqx.filter_jit
def _prepare(model) -> System:
    system = bare(model)
    modal = None
    if isinstance(model.damping, ModalDamping):
        modal = modal_damping_vectors(system)
    places = sort_places(system.layout, system.elements, system.inertia)
    return replaced(system, places=places, modal=modal, admissible=admissible(model))
