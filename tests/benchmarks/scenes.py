"""Cost of each part of a machine: `python tests/benchmarks/scenes.py [MACHINE]`.

A table of the scenes that can be made of one machine by leaving out parts, from the barest to the
fullest. A part that is left out is not traced, so that the rest costs what it costs alone. Operations are
those of the compiled program, in which the body of a loop counts once.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx

from jaxcomp import BadInput, load
from jaxcomp.compressor import Compressor
from jaxcomp.crankshaft._bearings import bearing_names
from jaxcomp.film import JournalBearing
from jaxcomp.friction import CoulombJournal, RegularisedJournal, SliderCrankFriction
from jaxcomp.machine import Machine, assembled, machine_of
from jaxcomp.motor import ConstantSpeed
from jaxcomp.rotor import BalancingPlanes, LoadCase, RotorModel, TargetPlane
from jaxcomp.study import AnalysisOptions
from jaxcomp.study.accuracy._study import Program, answer
from jaxcomp.vibration import loaded_rotor
from jaxcomp.vibration._coupling import without

# The film journals that stand in for the scene's own where it has none: usual proportions.
_LENGTH_RATIO, _CLEARANCE_RATIO, _VISCOSITY = 0.5, 1e-3, 5e-3  # [-], [-], [Pa s]


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


def _crank_scenes(design: Machine) -> Iterator[LeanScene]:
    machine = assembled(design).compressor
    if machine is None:
        return
    given = ConstantSpeed(machine.motor.speed_guess)
    ideal = without(machine, ("friction",))
    ladder = {
        "given speed, no friction": replace(ideal, motor=given),
        "given speed": replace(machine, motor=given),
        "fluctuating speed, no friction": ideal,
        "fluctuating speed": machine,
    }
    if isinstance(machine.friction, SliderCrankFriction):
        ladder["fluctuating speed, film journals"] = _filmed_machine(machine)
    for name, made in ladder.items():
        asked = f"mean_force.{bearing_names(made.crankshaft)[0]}"  # of the shaft on its bearing
        yield LeanScene(f"crank: {name}", Machine(made), AnalysisOptions(), asked)


def _rotor_scenes(design: Machine) -> Iterator[LeanScene]:
    made = assembled(design)
    model, case, places = made.rotor, made.loads, made.balancing
    if not (
        isinstance(model, RotorModel)
        and isinstance(case, LoadCase)
        and isinstance(places, BalancingPlanes)
        and places.planes
    ):
        return
    loaded = loaded_rotor(made, places.speeds)
    # one target that every scene has: the first plane of the rotor
    first = places.planes[0]
    places = replace(places, targets=(TargetPlane(first.name, first.node),))

    def scene(name, rotor, loads, excitation, *machine):
        parts = {"rotor": rotor, "loads": loads, "balancing": places}
        compressor, *named = machine or (None,)
        whole = Machine(compressor, parts, design.corrections, *named)
        return LeanScene(name, whole, AnalysisOptions(excitation=excitation), "vibration")

    subsets = f"{len(loaded.bodies) + 1} subsets, six degrees of freedom"
    if case.forces:
        for kept in range(len(loaded.bodies) + 1):
            lean, loads = _grounded(loaded, case, kept)
            name = f"{kept + 1} subsets" if kept else "alone, its bearings on the ground"
            yield scene(f"rotor: {name}", replace(lean, dof=4), loads, "file")
        yield scene(f"rotor: {subsets}", replace(loaded, dof=6), case, "file")
    if case.crank is not None and design.compressor is not None:
        machine = _filmed_machine(design.compressor), design.bearings, design.oils
        name = f"all: {subsets}, excited by the crank"
        yield scene(name, replace(design.parts["rotor"], dof=6), case, "crank", *machine)


def _filmed_machine(machine: Compressor) -> Compressor:
    """The same joints with films on crank pin and main journal."""
    friction, crankshaft = machine.friction, machine.crankshaft
    if not isinstance(friction, SliderCrankFriction):
        return machine

    def film(law):
        if not isinstance(law, CoulombJournal | RegularisedJournal):
            return law
        d = law.diameter
        return JournalBearing(d, _LENGTH_RATIO * d, _CLEARANCE_RATIO * d / 2, _VISCOSITY)

    return replace(
        machine,
        friction=replace(friction, crank_pin=film(friction.crank_pin)),
        crankshaft=replace(crankshaft, main_journal=film(crankshaft.main_journal)),
    )


def _grounded(model: RotorModel, case: LoadCase, kept: int) -> tuple[RotorModel, LoadCase]:
    """The model with its first bodies alone, and the ground in the place of the others."""
    gone = {node for body in model.bodies[kept:] for node in (body.centre, *body.nodes)}
    if not gone:
        return model, case
    links = []
    for link in model.links:
        nodes = [None if node in gone else node for node in link.nodes]
        if any(node is not None for node in nodes):
            nodes.sort(key=lambda node: node is None)  # the ground is the second node of a link
            links.append(replace(link, nodes=tuple(nodes)))
    pulls = tuple(
        pull for pull in model.magnetic_pulls if not gone & {n for pair in pull.nodes for n in pair}
    )
    bodies = model.bodies[:kept]
    lean = replace(model, links=tuple(links), magnetic_pulls=pulls, bodies=bodies, nodes=None)
    forces = tuple(
        replace(force, reaction=None) if force.reaction in gone else force
        for force in case.forces
        if force.node not in gone
    )
    return lean, eqx.tree_at(lambda c: c.forces, case, forces)


def main() -> None:
    scene = load((sys.argv[1:] or ["hermetic-68cc"])[0])
    print("| scene | operations | loops | compiling | time | memory |")
    print("|---|---|---|---|---|---|")
    for one in lean_scenes(scene):
        program = lean_program(one)
        memory = "" if program.memory is None else f"{program.memory / 1e3:,.1f} kB"
        cells = (
            one.name,
            f"{program.flops:,.0f}",
            f"{program.text.count(' while(')}",
            f"{program.seconds:.1f} s",
            f"{1e3 * program.timed(one.design):.3g} ms",
            memory,
        )
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
