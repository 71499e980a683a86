r"""Journal bearings: table and closed formulas beside finite volumes for Reynolds' equation.

At every film of the machine: the journals of its joints under their mean force, and the bearings of its
rotor under their static load at the highest of the balancing speeds; without any, at a plain bearing
and one with two axial grooves of L/D = 0.5 at eps = 0.65. Each is compared with its own finite-volume
solution on 960 x 64 cells; the Richardson extrapolation of that shares the two finest grids with it, so
that the second method is the solution that stops one grid earlier.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import film as films
from .._fields import BadInput
from ..coupling import loaded_rotor
from ..crank import Collocation, solve_orbit
from ..friction import film_journals
from ..machine import Machine, assembled
from ..rotor import LoadedFilm, RotorModel
from ._measure import Program
from ._report import Reference
from ._study import Call, Question, Setting, Study

_GRIDS = ((120, 8), (240, 16), (480, 32), (960, 64))
FILM_QUANTITIES = ("friction_number", "stiffness", "damping")
_PLAIN = (films.Reynolds, films.Guembel, films.Ocvirk, films.ExplicitFit)
_GROOVED = (films.GroovedReynolds,)
# Points of a batch: times are per point.
_BATCH = 256
# [-] Of eps, in the differences of finite volumes, and of the load, in those of a film model.
_STEP, _STEPS = 1e-2, (1e-1, 1e-3, 1e-5)


class Place(NamedTuple):
    """Where the film is studied.

    Attributes:
        label: which bearing.
        length_ratio: [-] L/D.
        eccentricity: [-] eps.
        grooved: whether it has two axial grooves.
    """

    label: str
    length_ratio: float
    eccentricity: float
    grooved: bool = False

    @property
    def models(self) -> tuple[type[films.AbstractFilm], ...]:
        """Film models for it."""
        made = _GROOVED if self.grooved else _PLAIN
        return tuple(
            m
            for m in made
            if m.length_ratio_range[0] <= self.length_ratio <= m.length_ratio_range[1]
        )


def film_study(question: Question, thorough: bool) -> Study:
    """Models of the film and grids of the solver, for a number of the film."""
    name, places = question.quantity, _places(question, thorough)
    settings: list[Setting] = []
    for place in places:
        solved = cache(partial(_solved, place))

        def reference(solved=solved):
            fine, coarse = (np.asarray(getattr(solved(n), name)) for n in (4, 3))
            return Reference(fine, coarse, ("finite volumes, 960 x 64 cells", "480 x 32 cells"))

        own = cache(reference)
        settings += [
            Setting(f"finite volumes, {place.label}", "{} x {} cells".format(*_GRIDS[count - 1]),
                    partial(_grid_call, place, name, count), (float(count),), reference=own,
                    task=place.label)
            for count in ((2, 3, 4) if thorough else (2, 3))
            if count > 2 or not place.grooved  # the grooves are found one grid earlier
        ]  # fmt: skip
        settings += [
            Setting(f"{model.__name__}, {place.label}", f"eps={place.eccentricity:.3g}",
                    partial(_model_call, solved, _of_load(model, place, name)), share=_BATCH,
                    reference=own, task=place.label)
            for model in place.models
            if name == "friction_number" or issubclass(model, films.AbstractSolvedFilm)
        ]  # fmt: skip
    first = settings[0].reference
    assert first is not None
    return Study(first, tuple(settings), f"films, {_BATCH} points at a time", unit="")


def film_gradient_study(question: Question, thorough: bool) -> Study:
    """Derivatives of a number of the film with respect to its load, beside those of finite volumes."""
    name, place = question.quantity, _places(question, thorough)[0]
    solved = cache(partial(_solved, place))

    def slope(step):
        low, high = (
            _solved(place._replace(eccentricity=place.eccentricity + s * step), 4) for s in (-1, 1)
        )
        rise = np.asarray(getattr(high, name)) - np.asarray(getattr(low, name))
        return rise / (high.load_number - low.load_number)

    def reference():
        # two steps, each with its half: differences of fourth order
        one, two, half = (slope(_STEP * share) for share in (1.0, 0.5, 0.25))
        return Reference((4 * half - two) / 3, (4 * two - one) / 3,
                         ("differences of finite volumes", "twice the step"))  # fmt: skip

    settings: list[Setting] = []
    for model in place.models:
        if name != "friction_number" and not issubclass(model, films.AbstractSolvedFilm):
            continue
        if model is films.Guembel and not thorough:
            continue  # whose reverse mode compiles for 20 s
        value = _of_load(model, place, name)
        for mode, derive in (("forward", jax.jacfwd), ("reverse", jax.jacrev)):
            make = partial(_model_call, solved, derive(value))
            settings.append(
                Setting(f"{mode} mode, {model.__name__}", "at the load", make, share=_BATCH)
            )
    value = _of_load(place.models[0], place, name)
    for share in _STEPS:

        def difference(x, share=share):
            return (value(x * (1 + share)) - value(x * (1 - share))) / (2 * share * x)

        method = f"central differences, {place.models[0].__name__}"
        settings.append(Setting(method, f"step={share:g}", partial(_model_call, solved, difference),
                                share=_BATCH, candidate=False))  # fmt: skip
    note = f"derivative with respect to the load number, {place.label}"
    return Study(reference, tuple(settings), note, name=f"d {name} / d load_number", unit="")


def film_places(design: Machine) -> tuple[Place, ...]:
    """The films of a machine: of its joints, the most eccentric first, and of its rotor."""
    made, found = assembled(design), {}
    journals = {} if made.compressor is None else film_journals(made.compressor.friction)
    if made.compressor is not None and journals:
        orbit = solve_orbit(made.compressor, Collocation(reversals=0, tolerance=1e-6), throw=False)
        for name, bearing in journals.items():
            place = _place(name, bearing, orbit.mean_forces[name], orbit.mean_speed)
            if place is not None:
                found[name] = place
    if isinstance(made.rotor, RotorModel) and made.balancing is not None:
        speed = jnp.max(made.balancing.speeds)
        for link in loaded_rotor(made, speed[None]).links:
            if isinstance(link.law, LoadedFilm):
                assert isinstance(link.law.bearing, films.JournalBearing)
                load = jnp.linalg.norm(jnp.atleast_2d(link.law.load)[-1])
                name = f"rotor {'-'.join(map(str, link.nodes))}"
                found[name] = _place(name, link.law.bearing, load, speed)
    places = [place for place in found.values() if place is not None]
    return tuple(sorted(places, key=lambda p: (p.label.startswith("rotor "), -p.eccentricity)))


def _place(name: str, bearing: films.JournalBearing, load, speed) -> Place | None:
    if not issubclass(bearing.model, films.AbstractCarryingFilm):
        return None
    eccentricity = float(films.eccentricity_ratio(bearing, load, speed))
    grooved = bearing.model is films.GroovedReynolds
    return Place(name, float(bearing.length_ratio), eccentricity, grooved)


def _places(question: Question, thorough: bool) -> tuple[Place, ...]:
    if question.quantity not in FILM_QUANTITIES:
        raise BadInput("quantity", question.quantity, f"one of {FILM_QUANTITIES}")
    usual = Place("a plain bearing", 0.5, 0.65), Place("grooves", 0.5, 0.65, True)
    found = film_places(question.design) or usual
    return (*found, *(one for one in usual if thorough and one not in found))


def _solved(place: Place, count: int) -> films.FilmSolution:
    return films.reference_solution(
        place.eccentricity, place.length_ratio, grooved=place.grooved, grids=_GRIDS[:count]
    )


def _grid_call(place: Place, name: str, count: int) -> Call:
    return Call(lambda: np.asarray(getattr(_solved(place, count), name)))


def _of_load(model, place: Place, name: str) -> Callable[[Any], Any]:
    """A number of the film as a function of the load number."""

    def value(load):
        film = model(jnp.asarray(place.length_ratio))
        if name == "friction_number":
            return film.friction_number(load)
        return getattr(films.dynamic_coefficients(film, load), name)

    return value


def _model_call(solved: Callable[[int], films.FilmSolution], value) -> Call:
    """A function of the load number, over a batch of points at the same place."""
    load = jnp.full(_BATCH, solved(4).load_number)
    program = Program(jax.vmap(value), load)
    over = program.on(load)
    return Call(lambda: over()[0], program)
