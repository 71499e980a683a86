r"""Journal bearing: table and closed formulas beside finite volumes for Reynolds' equation.

At one bearing and one load: of the machine's film journals the one that runs most eccentric under its
mean force; without any, L/D = 0.5 and eps = 0.65. The reference is the finite-volume solution on 960 x 64
cells; its Richardson extrapolation shares the two finest grids with it, so that the second method is the
solution that stops one grid earlier.
"""

import time
from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import film as films
from .._fields import BadInput
from ..crank import Collocation, solve_orbit
from ..friction import film_journals
from ..machine import Machine, assembled
from ._measure import compile_program
from ._report import Reference, Row
from ._study import Piece, Question, Study

_GRIDS = ((120, 8), (240, 16), (480, 32), (960, 64))
FILM_QUANTITIES = ("friction_number", "stiffness", "damping")
_MODELS = {
    "Reynolds": films.Reynolds,
    "Guembel": films.Guembel,
    "Ocvirk": films.Ocvirk,
    "ExplicitFit": films.ExplicitFit,
}
# Points of a batch: times are per point.
_BATCH = 256


class Place(NamedTuple):
    """Where the film is studied.

    Attributes:
        words: which bearing.
        length_ratio: [-] L/D.
        eccentricity: [-] eps.
    """

    words: str
    length_ratio: float
    eccentricity: float


def film_study(question: Question, thorough: bool) -> Study:
    """Evaluators of the film and grids of the solver, for a number of the film.

    Raises:
        BadInput: a quantity that is none of `FILM_QUANTITIES`.
    """
    if question.quantity not in FILM_QUANTITIES:
        raise BadInput("quantity", question.quantity, f"one of {FILM_QUANTITIES}")
    name, place = question.quantity, film_place(question.design)
    solved = cache(partial(_solved, place))

    def reference():
        fine, coarse = (_scalar(getattr(solved(n)[0], name)) for n in (4, 3))
        return Reference(fine, coarse, ("finite volumes, 960 x 64 cells", "480 x 32 cells"))

    counts = (2, 3, 4) if thorough else (2, 3)
    pieces = [Piece(f"{_GRIDS[n - 1]} cells", partial(_grid_row, solved, name, n)) for n in counts]
    pieces += [
        Piece(model, partial(_model_row, solved, name, model, place.length_ratio))
        for model, kind in _MODELS.items()
        if (name == "friction_number" or issubclass(kind, films.AbstractSolvedFilm))
        and kind.length_ratio_range[0] <= place.length_ratio <= kind.length_ratio_range[1]
    ]
    where = f"{place.words}, L/D = {place.length_ratio:.3g}, eps = {place.eccentricity:.3g}"
    return Study(reference, tuple(pieces), f"film of {where}; {_BATCH} points at a time")


def film_place(design: Machine) -> Place:
    """The film journal of a machine that runs most eccentric under its mean force and speed."""
    compressor = assembled(design).compressor
    journals = {} if compressor is None else film_journals(compressor.friction)
    if compressor is None or not journals:
        return Place("a bearing", 0.5, 0.65)
    orbit = solve_orbit(compressor, Collocation(reversals=0, tolerance=1e-6), throw=False)
    force, speed = orbit.mean_forces, orbit.mean_speed
    eccentricity = {
        name: float(films.eccentricity_ratio(law, force[name], speed))
        for name, law in journals.items()
    }
    worst = max(eccentricity, key=lambda name: eccentricity[name])
    return Place(worst, float(journals[worst].length_ratio), eccentricity[worst])


def _solved(place: Place, count: int):
    start = time.perf_counter()
    found = films.reference_solution(place.eccentricity, place.length_ratio, grids=_GRIDS[:count])
    return found, time.perf_counter() - start


def _scalar(value) -> float:
    """A number as it is, a matrix by its norm."""
    return float(np.linalg.norm(np.atleast_1d(np.asarray(value))))


def _grid_row(solved, name, count, reference: Reference):
    found, seconds = solved(count)
    cells = "{} x {} cells".format(*_GRIDS[count - 1])
    error = reference.error(_scalar(getattr(found, name)))
    row = Row("finite volumes", cells, error, seconds, float("nan"))
    yield row._replace(tightness=(float(count),))


def _model_row(solved, name, model, length_ratio, reference: Reference):
    load = jnp.full(_BATCH, solved(4)[0].load_number)

    def one(load):
        film = _MODELS[model](jnp.asarray(length_ratio))
        if name == "friction_number":
            return film.friction_number(load)
        found = films.dynamic_coefficients(film, load)
        return jnp.linalg.norm(getattr(found, name))

    program = compile_program(jax.vmap(one), load)
    value = float(program(load)[0])
    yield Row(
        model,
        "at the load",
        reference.error(value),
        program.timed(load) / _BATCH,
        program.seconds,
        None,
        program.flops / _BATCH,
    )
