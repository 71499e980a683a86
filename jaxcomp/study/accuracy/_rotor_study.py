r"""Films and rotor: film models beside Reynolds' equation, solvers of the response beside NumPy.

Films are studied at every bearing of the machine: the journals of its joints under their mean force, and
the bearings of its rotor under their static load at the highest of the balancing speeds; without any, at
a plain bearing and one with two axial grooves of L/D = 0.5 at eps = 0.65. Tables and closed formulas are
compared with finite volumes on 960 x 64 cells for the same bearing; the Richardson extrapolation of
these shares the two finest grids with them, so that the second method is the solution that stops one
grid earlier.

The response by block elimination along the shaft and by a dense solver of the library, each for many
speeds in one call, is compared with NumPy on the full matrices with refinement in extended precision.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ... import film as films
from ..._core.errors import BadInput
from ..._core.extremes import max_of
from ...crank import Collocation, solve_orbit
from ...crankshaft._bearings import film_journals
from ...film._reference import FilmSolution
from ...machine import Machine, assembled
from ...rotor import LoadedFilm, RotorModel, matrices, respond
from ...rotor._loads import load_vector
from ...vibration import loaded_rotor
from ._report import Reference
from ._study import Call, Compiled, Question, Setting, Study, series

FILM_QUANTITIES = ("friction_number", "stiffness", "damping")
_GRIDS = ((120, 8), (240, 16), (480, 32), (960, 64))
_PLAIN = (films.Reynolds, films.Guembel, films.Ocvirk, films.ExplicitFit)
_GROOVED = (films.GroovedReynolds,)
# Points of a batch: times are per point.
_BATCH = 256
# [-] Of eps, in the differences of finite volumes, and of the load, in those of a film model.
_STEP = 1e-2
_STEPS = (1e-1, 1e-3, 1e-5)

_LOWEST = 0.2  # [-] first of the speeds, over the highest of the balancing planes'
_COUNTS = (1, 10, 100, 1000)
_COMPARED = 10  # speeds at which errors are taken, the same of every number of them


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

    def models(self, name: str) -> list[type[films.AbstractFilm]]:
        """Film models for the bearing that give a number of `FILM_QUANTITIES`."""
        models = []
        candidates = _PLAIN
        if self.grooved:
            candidates = _GROOVED
        for model in candidates:
            shortest, longest = model.length_ratio_range
            # Stiffness and damping are those of a film that solves for its pressure.
            has_number = name == "friction_number" or issubclass(model, films.AbstractSolvedFilm)
            if has_number and shortest <= self.length_ratio <= longest:
                models.append(model)
        return models

    def solved(self, count: int) -> FilmSolution:
        """By finite volumes on the coarsest grids, as many as are told."""
        return films.reference_solution(
            self.eccentricity, self.length_ratio, grooved=self.grooved, grids=_GRIDS[:count]
        )


def film_study(question: Question, thorough: bool) -> Study:
    """Models of the film and grids of the solver, for a number of the film."""
    name = question.quantity
    settings = []
    counts = (2, 3)
    if thorough:
        counts = (2, 3, 4)
    for place in _places(question, thorough):
        solved = cache(place.solved)

        @cache
        def reference(solved=solved):
            fine = np.asarray(getattr(solved(4), name))
            coarse = np.asarray(getattr(solved(3), name))
            return Reference(fine, coarse, ("finite volumes, 960 x 64 cells", "480 x 32 cells"))

        options: Any = {"reference": reference, "task": place.label}
        for count in counts:
            if count == 2 and place.grooved:
                continue  # the grooves are found one grid earlier
            setting = Setting(
                method=f"finite volumes, {place.label}",
                label="{} x {} cells".format(*_GRIDS[count - 1]),
                prepare=partial(_grid_call, place, name, count),
                tightness=(float(count),),
                **options,
            )
            settings.append(setting)
        for model in place.models(name):
            setting = Setting(
                method=f"{model.__name__}, {place.label}",
                label=f"eps={place.eccentricity:.3g}",
                prepare=partial(_model_call, solved, _of_load(model, place, name)),
                share=_BATCH,
                **options,
            )
            settings.append(setting)
    note = f"films, {_BATCH} points at a time"
    return Study(settings[0].reference, tuple(settings), note, unit="")


def film_gradient_study(question: Question, thorough: bool) -> Study:
    """Derivatives of a number of the film with respect to its load, beside those of finite volumes."""
    name = question.quantity
    place = _places(question, thorough)[0]
    solved = cache(place.solved)

    def slope(step):
        low = place._replace(eccentricity=place.eccentricity - step).solved(4)
        high = place._replace(eccentricity=place.eccentricity + step).solved(4)
        # Finite volumes solve at an eccentricity, and the load follows: one slope over the other.
        rise = np.asarray(getattr(high, name)) - np.asarray(getattr(low, name))
        return rise / (high.load_number - low.load_number)

    def reference():
        # two steps, each with its half: differences of fourth order
        coarse = slope(_STEP)
        middle = slope(_STEP * 0.5)
        fine = slope(_STEP * 0.25)
        return Reference(
            value=(4 * fine - middle) / 3,
            other=(4 * middle - coarse) / 3,
            methods=("differences of finite volumes", "twice the step"),
        )

    settings = []
    for model in place.models(name):
        if model is films.Guembel and not thorough:
            continue  # its reverse mode compiles for 20 s
        for mode, derive in (("forward", jax.jacfwd), ("reverse", jax.jacrev)):
            setting = Setting(
                method=f"{mode} mode, {model.__name__}",
                label="at the load",
                prepare=partial(_model_call, solved, derive(_of_load(model, place, name))),
                share=_BATCH,
            )
            settings.append(setting)
    first = place.models("friction_number")[0]
    value = _of_load(first, place, name)

    def difference(share):
        def central(x):
            return (value(x * (1 + share)) - value(x * (1 - share))) / (2 * share * x)

        return _model_call(solved, central)

    settings += series(
        f"central differences, {first.__name__}",
        "step={:g}",
        difference,
        _STEPS,
        share=_BATCH,
        candidate=False,
    )
    return Study(
        reference=reference,
        settings=tuple(settings),
        note=f"derivative with respect to the load number, {place.label}",
        name=f"d {name} / d load_number",
        unit="",
    )


def film_places(design: Machine) -> tuple[Place, ...]:
    """The films of a machine: of its joints, the most eccentric first, and of its rotor."""
    assembly = assembled(design)
    places = []
    journals = {}
    if assembly.compressor is not None:
        shaft = assembly.compressor.crankshaft
        journals = film_journals(assembly.compressor.friction, shaft.main_journal)
    if assembly.compressor is not None and journals:
        orbit = solve_orbit(
            assembly.compressor, Collocation(reversals=0, tolerance=1e-6), throw=False
        )
        for name, bearing in journals.items():
            places += _place(name, bearing, orbit.mean_forces[name], orbit.mean_speed)
    if isinstance(assembly.rotor, RotorModel) and assembly.balancing is not None:
        speed = max_of(assembly.balancing.speeds)
        for link in loaded_rotor(assembly, speed[None]).links:
            if isinstance(link.law, LoadedFilm):
                assert isinstance(link.law.bearing, films.JournalBearing)
                load = jnp.linalg.norm(jnp.atleast_2d(link.law.load)[-1])
                name = f"rotor {'-'.join(map(str, link.nodes))}"
                places += _place(name, link.law.bearing, load, speed)
    unique = {place.label: place for place in places}.values()
    return tuple(sorted(unique, key=lambda p: (p.label.startswith("rotor "), -p.eccentricity)))


def _place(name: str, bearing: films.JournalBearing, load, speed) -> list[Place]:
    """The place of a bearing; none where its film carries nothing."""
    from ...film._film import AbstractCarryingFilm
    from ...film._running import eccentricity_ratio

    if not issubclass(bearing.model, AbstractCarryingFilm):
        return []
    eccentricity = float(eccentricity_ratio(bearing, load, speed))
    grooved = bearing.model is films.GroovedReynolds
    place = Place(
        label=name,
        length_ratio=float(bearing.length_ratio),
        eccentricity=eccentricity,
        grooved=grooved,
    )
    return [place]


def _places(question: Question, thorough: bool) -> tuple[Place, ...]:
    if question.quantity not in FILM_QUANTITIES:
        raise BadInput("quantity", question.quantity, f"one of {FILM_QUANTITIES}")
    plain = Place("a plain bearing", length_ratio=0.5, eccentricity=0.65)
    usual = plain, plain._replace(label="grooves", grooved=True)
    places = film_places(question.design) or usual
    if not thorough:
        return places
    further = [place for place in usual if place not in places]
    return (*places, *further)


def _grid_call(place: Place, name: str, count: int) -> Call:
    return Call(lambda: np.asarray(getattr(place.solved(count), name)))


def _of_load(model, place: Place, name: str) -> Callable[[Any], Any]:
    """A number of the film as a function of the load number."""

    def value(load):
        film = model(jnp.asarray(place.length_ratio))
        if name == "friction_number":
            return film.friction_number(load)
        return getattr(films.dynamic_coefficients(film, load), name)

    return value


def _model_call(solved: Callable[[int], FilmSolution], value) -> Call:
    """A function of the load number, over a batch of points at the same place."""
    over, program, _ = Compiled(jax.vmap(value)).call(jnp.full(_BATCH, solved(4).load_number))
    return Call(lambda: over()[0], program)


def response_study(question: Question, thorough: bool) -> Study:
    """Solvers of the response by number of speeds; the error is that of all displacements."""
    assembly = question.assembly
    assert assembly.balancing is not None
    compared = np.linspace(_LOWEST, 1.0, _COMPARED) * float(max_of(assembly.balancing.speeds))
    model = loaded_rotor(assembly, jnp.asarray(compared))
    loads = assembly.given_loads or assembly.unbalances

    def by_numpy(refined: bool):
        return np.stack([_direct(model, loads, speed, refined) for speed in compared])

    def solve(solver, model, loads, speeds):
        return respond(model, loads, speeds, solver=solver).displacement[0]

    def prepare(solver, count):
        # the same speeds again and again, so that their number alone is what differs
        speeds = jnp.asarray(np.resize(compared, count))
        run, program, _ = Compiled(partial(solve, solver)).call(model, loads, speeds)
        return Call(partial(_at_compared_speeds, run, count), program)

    def reference(count):
        value = exact()[:count]
        other = np.asarray(prepare("dense", _COMPARED).run())[:count]
        return Reference(value, other, ("NumPy in extended precision", "the dense solver"))

    exact = cache(lambda: by_numpy(True))
    of_one_speed = cache(partial(reference, 1))
    of_all_speeds = cache(partial(reference, _COMPARED))
    settings = []
    counts = _COUNTS if thorough else _COUNTS[:3]
    for solver in ("structured", "dense"):
        for count in counts:
            if solver == "dense" and count > 100:
                continue
            of_count = of_all_speeds
            if count == 1:
                of_count = of_one_speed
            setting = Setting(
                method=solver,
                label=f"{count} speeds",
                prepare=partial(prepare, solver, count),
                share=count,
                reference=of_count,
            )
            settings.append(setting)
    plain = Setting(
        method="NumPy",
        label=f"{_COMPARED} speeds",
        prepare=lambda: Call(partial(by_numpy, False)),
        share=_COMPARED,
        reference=of_all_speeds,
    )
    note = "response at many speeds in one call, times are of one speed"
    return Study(of_all_speeds, (*settings, plain), note)


def _at_compared_speeds(run: Callable[[], Any], count: int):
    """Displacements at the compared speeds, of a call whose speeds are these again and again."""
    displacement = run()
    if count > _COMPARED:
        return displacement[:_COMPARED]
    return displacement


def _direct(model, loads, speed: float, refined: bool):
    """[m], [rad] (nodes, dof) displacement at one speed by the full matrices."""
    force = np.asarray(load_vector(model, loads, 1, jnp.asarray(speed)))
    m, c, g, k, expand = (np.asarray(a) for a in matrices(model, speed))
    # Dynamic stiffness at order 1, where the excitation turns with the shaft.
    z = k - speed**2 * m + 1j * speed * (c + speed * g)
    f = expand.T @ force.reshape(-1)
    x = np.linalg.solve(z, f)
    # The residual in extended precision: two corrections reach the rounding of the solution.
    for _ in range(2 * refined):
        residual = f.astype(np.clongdouble) - z.astype(np.clongdouble) @ x.astype(np.clongdouble)
        x = x + np.linalg.solve(z, residual.astype(complex))
    return (expand @ x).reshape(force.shape)
