"""Motion of a machine's rotor, crankcase and housing at some speeds: nodes, targets, links, films."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.declared import (
    Record,
    computed,
    computed_part,
    computed_word,
    held,
    part,
    reading,
)
from .._core.errors import BadInput
from .._core.evidence import Check, is_small
from .._core.results import Data, Result
from .._core.words import one_of
from ..film import JournalBearing
from ..machine import HasMachine, Machine, machine_of
from ..rotor import AXES, Response, RotorModel, orbit, transmitted_forces
from ..rotor._modes_at_speeds import ModelSize, size_of
from ..rotor._nodes import node_names
from ..rotor._response import WhirlOrbit
from ._coupling import open_films, with_film_linearisation
from ._machine import respond, rotor_at

if TYPE_CHECKING:
    from ..crank import Collocation, Shooting

# By name of the target or node: its number in the model's list, and that of the node relative to which
# the motion is, -1 for the ground.
_Watched = dict[str, tuple[int, int]]

# Dimensions of what every order has at every speed.
_AT = ("order", "speed")
# Along a degree of freedom that not every model and not every link has.
_Amplitude = Complex[np.ndarray, "o s"] | None
_Phase = Float[np.ndarray, "o s"] | None


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MotionOverSpeed(Result):
    """Major axes of orbits over a range of speeds; not a number where there is no response.

    Attributes:
        orders: of the speed (o,).
        speeds: [rad/s] (s,)
        major_axis: [m] (o, s) by node or target.
    """

    orders: tuple[int, ...]
    speeds: Float[np.ndarray, " s"] = reading("rad/s", "speed")
    major_axis: dict[str, Float[np.ndarray, "o s"]] = reading("m", *_AT)

    table_dims: ClassVar[tuple[str, ...]] = ("speed",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield from self.data_of(speed="speeds")
        for curves in self.data_of("major_axis", dims=self.table_dims):
            for name, of_orders in self.major_axis.items():
                for order, values in zip(self.orders, of_orders, strict=True):
                    full_name = f"{name}.order_{order}.{curves.name}"
                    yield curves._replace(name=full_name, values=values)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class NodeAmplitudes(Result):
    """Complex amplitudes of a node, as the degrees of freedom of the model have them.

    Attributes:
        ux, uy, uz: [m] (o, s) of the displacements.
        thx, thy, thz: [rad] (o, s) of the rotations.
    """

    ux: _Amplitude = reading("m", *_AT, optional=True, default=None)
    uy: _Amplitude = reading("m", *_AT, optional=True, default=None)
    uz: _Amplitude = reading("m", *_AT, optional=True, default=None)
    thx: _Amplitude = reading("rad", *_AT, optional=True, default=None)
    thy: _Amplitude = reading("rad", *_AT, optional=True, default=None)
    thz: _Amplitude = reading("rad", *_AT, optional=True, default=None)

    table_dims: ClassVar[tuple[str, ...]] = _AT


@dataclasses.dataclass(frozen=True)
class NodePhases(Record):
    """Phases of a node.

    Attributes:
        ux, uy, uz, thx, thy, thz: [rad] (o, s) of the complex amplitudes.
    """

    ux: _Phase = reading("rad", *_AT, optional=True, default=None)
    uy: _Phase = reading("rad", *_AT, optional=True, default=None)
    uz: _Phase = reading("rad", *_AT, optional=True, default=None)
    thx: _Phase = reading("rad", *_AT, optional=True, default=None)
    thy: _Phase = reading("rad", *_AT, optional=True, default=None)
    thz: _Phase = reading("rad", *_AT, optional=True, default=None)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class NodeMotion(Result):
    """Motion of a node or target.

    Attributes:
        amplitude: by degree of freedom.
        phase: of the amplitudes.
        major_axis: [m] (o, s) half of the larger axis of the orbit.
        minor_axis: [m] (o, s) half of the smaller one, negative in backward whirl.
        inclination: [rad] (o, s) of the major axis from x.
    """

    amplitude: NodeAmplitudes = part(NodeAmplitudes)
    phase: NodePhases = part(NodePhases)
    major_axis: Float[np.ndarray, "o s"] = reading("m", *_AT)
    minor_axis: Float[np.ndarray, "o s"] = reading("m", *_AT)
    inclination: Float[np.ndarray, "o s"] = reading("rad", *_AT)

    table_dims: ClassVar[tuple[str, ...]] = _AT


@dataclasses.dataclass(frozen=True)
class LinkForces(Record):
    """Complex amplitudes of the force of a link along its axes, on its second node or the ground.

    Attributes:
        ux, uy, uz: [N] (o, s)
        thx, thy, thz: [N m] (o, s)
    """

    ux: _Amplitude = reading("N", *_AT, optional=True, default=None)
    uy: _Amplitude = reading("N", *_AT, optional=True, default=None)
    uz: _Amplitude = reading("N", *_AT, optional=True, default=None)
    thx: _Amplitude = reading("N m", *_AT, optional=True, default=None)
    thy: _Amplitude = reading("N m", *_AT, optional=True, default=None)
    thz: _Amplitude = reading("N m", *_AT, optional=True, default=None)


@dataclasses.dataclass(frozen=True)
class FilmCoefficients(Record):
    """Stiffness and damping of a film.

    Attributes:
        stiffness: [N/m] (2, 2) at each speed.
        damping: [N s/m] (2, 2) likewise.
    """

    stiffness: list[Float[Array, "2 2"]] = reading("N/m", "speed", "force", "motion")
    damping: list[Float[Array, "2 2"]] = reading("N s/m", "speed", "force", "motion")


@dataclasses.dataclass(frozen=True)
class LinearisedMotion(Record):
    """Orbits with the films of the journals that move linearised, and these films.

    Attributes:
        major_axis: [m] (o, s) by node or target.
        films: by bearing.
    """

    major_axis: dict[str, Float[np.ndarray, "o s"]] = reading("m", *_AT)
    films: dict[str, FilmCoefficients] = part(FilmCoefficients, by_name=True)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RotorMotion(Result):
    """Motion of watched nodes and forces of the links at some speeds and orders.

    Attributes:
        model: the rotor.
        response: of all its nodes.
        orders: of the speed (o,).
        speeds: [rad/s] (s,)
        motion: [m], [rad] (o, s, dof) complex amplitudes by node or target; of a target that is judged
            relative to a node, relative to it.
        forces: by link.
        curves: over a range of speeds, where one was asked for.
        linearised: with the films of the journals that move linearised at their "mean_load" and along
            their "orbit"; `None` of a rotor without such journals.
    """

    model: RotorModel
    response: Response
    orders: tuple[int, ...] = reading("", "order")
    speeds: Float[np.ndarray, " s"] = reading("rad/s", "speed")
    motion: dict[str, Complex[np.ndarray, "o s dof"]] = held()
    forces: dict[str, LinkForces] = part(LinkForces, by_name=True, key="links")
    curves: MotionOverSpeed | None = part(MotionOverSpeed, optional=True, default=None)
    linearised: dict[str, LinearisedMotion] | None = part(
        LinearisedMotion, by_name=True, optional=True, default=None
    )

    table_dims: ClassVar[tuple[str, ...]] = _AT

    @computed_part(ModelSize, inline=True)
    def size(self) -> ModelSize:
        """Degrees of freedom and subsets of the rotor."""
        return size_of(self.model)

    @computed_word()
    def axes(self) -> tuple[str, ...]:
        """The degrees of freedom of a node, as "ux"."""
        return AXES[self.model.dof]

    def orbits(self) -> dict[str, WhirlOrbit]:
        """The orbit of every watched node, (o, s) in all fields."""
        # all nodes in one call, which gives a record of arrays; unpacked again into one for each node
        motions = np.stack([*self.motion.values()])
        all_orbits = jax.device_get(orbit(motions[..., 0], motions[..., 1]))
        rows = map(WhirlOrbit, *all_orbits)
        return dict(zip(self.motion, rows, strict=True))

    @computed_part(NodeMotion, by_name=True)
    def nodes(self) -> dict[str, NodeMotion]:
        """Motion of every watched node or target."""
        nodes = {}
        for name, node_orbit in self.orbits().items():
            of_axes = dict(zip(self.axes, np.moveaxis(self.motion[name], -1, 0), strict=True))
            phases = {axis: np.angle(amplitude) for axis, amplitude in of_axes.items()}
            nodes[name] = NodeMotion(
                amplitude=NodeAmplitudes(**of_axes),
                phase=NodePhases(**phases),
                major_axis=np.asarray(node_orbit.major),
                minor_axis=np.asarray(node_orbit.minor),
                inclination=np.asarray(node_orbit.inclination),
            )
        return nodes

    @computed("")
    def correction(self) -> Any:
        """[-] Largest relative error of the response before the last refinement."""
        return np.max(self.response.correction)

    @computed_word(key="status")
    def response_status(self) -> str:
        """Status of the response in words."""
        # a response that is not raises before there is a result, see `rotor_motion`
        return "ok"

    def evidence(self, tolerance: float = 0.0) -> tuple[Check, ...]:
        """Whether the linear systems are solved."""
        del tolerance
        return (is_small("Last correction of the linear solution", float(self.correction)),)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the table has a row for each order and speed."""
        yield from self.data_of(order="orders", speed="speeds")
        for name, node in self.nodes.items():
            axes = node.data_of("major_axis", "minor_axis")
            for data in (*node.amplitude.described(), *axes):
                yield data._replace(name=f"{name}.{data.name}")


def rotor_motion(
    machine: Machine | HasMachine,
    spin_speeds: Float[Array, " s"],
    orders: tuple[int, ...],
    *,
    nodes: Sequence[str] = (),
    over: Float[Array, " r"] | None = None,
    excitation: str | None = None,
    crank_solver: "Collocation | Shooting | None" = None,
) -> RotorMotion:
    """Motion of a machine's rotor, crankcase and housing: nodes, targets, links, films.

    Args:
        machine: a scene or a machine with a rotor.
        spin_speeds: [rad/s] (s,)
        orders: orders of the speed.
        nodes: to watch; the target planes, or all nodes, if absent.
        over: [rad/s] (r,) speeds of curves.
        excitation: as in `respond`.
        crank_solver: as in `respond`.

    Raises:
        BadInput: a node that is not there, or as `respond`.
        SingularResponse: naming the frequencies without a response.
    """
    design = machine_of(machine)
    speeds = np.asarray(spin_speeds, float)
    # films have the loads of all speeds in one table, of the curves as well
    film_speeds = speeds
    if over is not None:
        film_speeds = np.union1d(speeds, over)
    model = _model(design, film_speeds)
    watched = _watched(design, model, nodes)

    def answer(design: Machine, speeds: np.ndarray) -> Response:
        how = {"excitation": excitation, "crank_solver": crank_solver}
        return respond(design, spin_speeds=jnp.asarray(speeds), orders=orders, **how)

    response = answer(design, speeds).checked()
    forces = np.asarray(transmitted_forces(model, response))
    links = {}
    for number, link in enumerate(model.links):
        of_axes = {}
        for k, axis in enumerate(AXES[model.dof]):
            if axis in link.axes:
                of_axes[axis] = forces[:, :, number, k]
        # A model of 4 degrees of freedom moves in no axial direction: a link along z transmits nothing
        # in it.
        if of_axes:
            links[_link_name(design, number)] = LinkForces(**of_axes)
    curves = linearised = None
    if over is not None:
        # unchecked: a speed without a response is a gap in the curve, and no error
        over_range = answer(design, np.asarray(over))
        major = np.where(np.asarray(over_range.ok), _major(_relative(over_range, watched)), np.nan)
        curves = MotionOverSpeed(orders, np.asarray(over), dict(zip(watched, major, strict=True)))
    if moving := _moving_films(design):
        # Twice the response, so that the difference shows whether the choice matters for this machine.
        linearised = {}
        for place in ("mean_load", "orbit"):
            other = with_film_linearisation(design, place)
            linearised[place] = _linearised(other, speeds, answer, watched, moving)
    return RotorMotion(
        model=model,
        response=response,
        orders=orders,
        speeds=speeds,
        motion=dict(zip(watched, _relative(response, watched), strict=True)),
        forces=links,
        curves=curves,
        linearised=linearised,
    )


def _model(design: Machine, speeds: np.ndarray) -> RotorModel:
    model = rotor_at(design, np.unique(speeds))
    assert isinstance(model, RotorModel)
    return model


def _watched(design: Machine, model: RotorModel, nodes: Sequence[str]) -> _Watched:
    """The nodes that were named, or the target planes, or all nodes."""
    names = node_names(model)
    places = {str(name): i for i, name in enumerate(names)}
    for name in nodes:
        if name not in places:
            raise BadInput("nodes", name, one_of(name, places))
    planes: Any = design.parts.get("balancing")
    if nodes or planes is None:
        return {name: (places[name], -1) for name in nodes or places}
    watched = {}
    for target in planes.targets:
        base = -1
        apart = ""
        if target.relative_to is not None:
            base = names.index(target.relative_to)
            apart = f" from {target.relative_to}"
        watched[f"{target.name} ({target.node}{apart})"] = names.index(target.node), base
    return watched


def _relative(response: Response, watched: _Watched) -> Complex[np.ndarray, "w o s dof"]:
    """Motion of the watched nodes relative to their bases."""
    motion = np.asarray(response.displacement)
    # the ground, which rests, as the last node: -1 is the base of what is relative to nothing
    motion = np.concatenate([motion, np.zeros_like(motion[..., :1, :])], -2)
    nodes, bases = np.array(list(watched.values())).T
    return np.moveaxis(motion[..., nodes, :] - motion[..., bases, :], -2, 0)


def _major(motion: Complex[np.ndarray, "w o s dof"]) -> Float[np.ndarray, "w o s"]:
    return np.asarray(orbit(motion[..., 0], motion[..., 1]).major)


def _moving_films(design: Machine) -> dict[int, str]:
    """Names of the rotor's bearings whose journals move in their films, by number of the link."""
    moving = {}
    for number in open_films(design.parts["rotor"]):
        name = _bearing_name(design, number)
        bearing = design.bearings.get(name)
        if isinstance(bearing, JournalBearing) and bearing.moves:
            moving[number] = name
    return moving


def _linearised(design, speeds, answer, watched, moving) -> LinearisedMotion:
    """Major axes, and stiffness and damping of the moving journals' films at the speeds."""
    major = _major(_relative(answer(design, speeds).checked(), watched))
    films = {}
    links = _model(design, speeds).links
    for number, name in moving.items():
        stiffness = []
        damping = []
        for speed in speeds:
            k, c = links[number].law.coefficients(jnp.asarray(speed))
            stiffness.append(k)
            damping.append(c)
        films[name] = FilmCoefficients(stiffness, damping)
    return LinearisedMotion(dict(zip(watched, major, strict=True)), films)


def _bearing_name(design: Machine, number: int) -> str:
    """Name of the bearing of a link; "" where it names none."""
    rotor: Any = design.parts["rotor"]
    return getattr(getattr(rotor.links[number].law, "bearing", None), "name", "")


def _link_name(design: Machine, number: int) -> str:
    """A link by its number in the file and its nodes; a film by the name of its bearing as well."""
    rotor: Any = design.parts["rotor"]
    first, second = rotor.links[number].nodes
    bearing = _bearing_name(design, number)
    if second is None:
        second = "ground"
    name = f"{number}: {first} to {second}"
    if bearing:
        name += f", {bearing}"
    return name
