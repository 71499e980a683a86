r"""Lean scenes: cost of each part of a machine, from the barest scene to the fullest.

A part that is left out is not traced, so that the rest costs what it costs alone. Operations are
those of the compiled program, in which the body of a loop counts once.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx

from .._fields import BadInput
from ..compressor import Compressor
from ..coupling import loaded_rotor
from ..design import AnalysisOptions
from ..film import JournalBearing
from ..friction import CoulombJournal, RegularisedJournal, SliderCrankFriction
from ..machine import Machine, assembled, machine_of
from ..motor import ConstantSpeed
from ..rotor import BalancingPlanes, Link, LoadCase, RotorModel, TargetPlane
from ._measure import Program
from ._study import answer

# The film journals that stand in for the scene's own where it has none: usual proportions.
_LENGTH_RATIO, _CLEARANCE_RATIO, _VISCOSITY = 0.5, 1e-3, 5e-3  # [-], [-], [Pa s]
_CRANK = "mean_force.main_journal"


class SceneCost(NamedTuple):
    """One scene of the ladder.

    Attributes:
        name: what it has.
        quantity: that is computed.
        value: [SI]
        flops: [-] operations of the compiled program, loop bodies counted once.
        loops: loops in the compiled program.
        compile_seconds: [s]
        seconds: [s] median of several warm calls.
        memory: [bytes] of intermediate results, `None` where the backend does not report it.
    """

    name: str
    quantity: str
    value: float
    flops: float
    loops: int
    compile_seconds: float
    seconds: float
    memory: int | None


class LeanScene(NamedTuple):
    """A scene whose cost is measured: a design, its solvers, and a quantity.

    Attributes:
        name: what it has.
        design: the machine.
        options: of the analysis.
        quantity: that is computed.
    """

    name: str
    design: Machine
    options: AnalysisOptions
    quantity: str


def scene_costs(
    ladder: Sequence[LeanScene], progress: Callable[[str, int, int], None] | None = None
) -> tuple[SceneCost, ...]:
    """Compile and run scenes.

    Args:
        ladder: of `lean_scenes`, or some of them.
        progress: called before each scene with its name, its number and how many there are.
    """
    progress = progress or (lambda label, number, total: None)
    costs = []
    for number, one in enumerate(ladder):
        progress(one.name, number, len(ladder))
        costs.append(_cost(one))
    return tuple(costs)


def lean_scenes(scene: Any) -> tuple[LeanScene, ...]:
    """The scenes from the barest to the fullest that can be made of one by leaving out parts.

    Raises:
        BadInput: a scene with neither a crank nor a rotor with planes.
    """
    design = machine_of(scene)
    found = [*_crank_scenes(design), *_rotor_scenes(design)]
    if not found:
        raise BadInput("scene", "without", "one with a compressor, or a rotor with its planes")
    return tuple(found)


def lean_program(one: LeanScene) -> Program:
    """The compiled program of a scene."""

    def value(design):
        solved = answer(design, one.options, one.quantity)
        return solved.value, solved.ok

    return Program(value, one.design)


def _cost(one: LeanScene) -> SceneCost:
    program = lean_program(one)
    value, _ = program(one.design)
    return SceneCost(
        one.name,
        one.quantity,
        float(value),
        program.flops,
        program.text.count(" while("),
        program.seconds,
        program.timed(one.design),
        program.memory,
    )


def _crank_scenes(design: Machine):
    machine = assembled(design).compressor
    if machine is None:
        return
    given = ConstantSpeed(machine.motor.speed_guess)
    ladder = {
        "given speed, no friction": _changed(machine, motor=given, friction=None),
        "given speed": _changed(machine, motor=given),
        "fluctuating speed, no friction": _changed(machine, friction=None),
        "fluctuating speed": machine,
    }
    if isinstance(machine.friction, SliderCrankFriction):
        ladder["fluctuating speed, film journals"] = _filmed_machine(machine)
    for name, made in ladder.items():
        alone = Machine(made)
        yield LeanScene(f"crank: {name}", alone, AnalysisOptions(), _CRANK)


def _rotor_scenes(design: Machine):
    made = assembled(design)
    model, case, places = made.rotor, made.loads, made.balancing
    if not (
        isinstance(model, RotorModel)
        and isinstance(case, LoadCase)
        and isinstance(places, BalancingPlanes)
        and places.planes
    ):
        return
    excitation = "file" if case.forces else "crank"
    model, whole_model = loaded_rotor(made, places.speeds), model
    # one target that every scene has: the first plane of the rotor
    first = places.planes[0]
    places = dataclasses.replace(places, targets=(TargetPlane(first.name, first.node),))
    for kept in range(len(model.bodies) + 1):
        lean, loads = _grounded(model, case, kept)
        parts = {"rotor": dataclasses.replace(lean, dof=4), "loads": loads, "balancing": places}
        name = (
            "rotor: alone, its bearings on the ground" if not kept else f"rotor: {kept + 1} subsets"
        )
        if excitation == "file":
            alone = Machine(None, parts, design.corrections)
            yield LeanScene(name, alone, AnalysisOptions(excitation="file"), "vibration")
    full = {"rotor": dataclasses.replace(model, dof=6), "loads": case, "balancing": places}
    whole = f"{len(model.bodies) + 1} subsets, six degrees of freedom"
    if excitation == "file":
        alone = Machine(None, full, design.corrections)
        yield LeanScene(f"rotor: {whole}", alone, AnalysisOptions(excitation="file"), "vibration")
    if case.crank is not None and design.compressor is not None:
        full["rotor"] = dataclasses.replace(whole_model, dof=6)
        made = Machine(
            _filmed_machine(design.compressor),
            full,
            design.corrections,
            design.bearings,
            design.oils,
        )
        name = f"all: {whole}, excited by the crank"
        yield LeanScene(name, made, AnalysisOptions(excitation="crank"), "vibration")


def _changed(machine: Compressor, **parts) -> Compressor:
    return dataclasses.replace(machine, **parts)


def _filmed_machine(machine: Compressor) -> Compressor:
    """The same joints with films on crank pin and main journal."""
    friction = machine.friction
    if not isinstance(friction, SliderCrankFriction):
        return machine

    def film(law):
        if not isinstance(law, CoulombJournal | RegularisedJournal):
            return law
        d = law.diameter
        return JournalBearing(d, _LENGTH_RATIO * d, _CLEARANCE_RATIO * d / 2, _VISCOSITY)

    names = ("crank_pin", "main_journal")
    laws = {name: film(getattr(friction, name)) for name in names}
    return _changed(machine, friction=dataclasses.replace(friction, **laws))


def _grounded(model: RotorModel, case: LoadCase, kept: int) -> tuple[RotorModel, LoadCase]:
    """The model with its first bodies alone, and the ground in the place of the others."""
    gone = {node for body in model.bodies[kept:] for node in (body.centre, *body.nodes)}
    if not gone:
        return model, case
    links = []
    for link in model.links:
        nodes = tuple(None if node in gone else node for node in link.nodes)
        if any(node is not None for node in nodes):
            links.append(_relinked(link, nodes))
    pulls = tuple(
        pull for pull in model.magnetic_pulls if not gone & {n for pair in pull.nodes for n in pair}
    )
    lean = dataclasses.replace(
        model, links=tuple(links), magnetic_pulls=pulls, bodies=model.bodies[:kept], nodes=None
    )
    forces = tuple(
        dataclasses.replace(force, reaction=None) if force.reaction in gone else force
        for force in case.forces
        if force.node not in gone
    )
    return lean, eqx.tree_at(lambda c: c.forces, case, forces)


def _relinked(link: Link, nodes) -> Link:
    """A link to the ground has it as its second node."""
    first, second = nodes
    if first is None:
        first, second = second, first
    return dataclasses.replace(link, nodes=(first, second))
