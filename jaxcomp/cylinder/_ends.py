"""The ends of the cylinders of a machine, each a cylinder of its own, and which of them touch."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.each import stacked
from .._core.errors import BadInput
from .._core.extremes import clip
from .._core.fields import is_traced, rebuilt, replaced
from ..mechanism import AbstractMechanism
from ._cycle_options import CycleOptions
from ._cylinder import Cylinder
from ._piston_end import PistonEnd
from ._waves import is_piped
from .laminar_gap import LaminarGap
from .stage import Stage


class Grouping(NamedTuple):
    """Which ends are solved together.

    Attributes:
        ends: of all cylinders.
        sides: of every cylinder, 1 or 2.
        groups: of ends that touch each other, by plenums or past the rings; all are alike in number.
    """

    ends: int
    sides: int
    groups: int

    @property
    def together(self) -> int:
        """Ends of a group."""
        return self.ends // self.groups


def has_ends(cylinder: Cylinder) -> bool:
    """Whether the gas is solved by the ends of the cylinders."""
    return any(cylinder.entries_of_ends())


def one_end(cylinder: Cylinder) -> Cylinder:
    """The cylinder, of which one end is solved alone.

    Raises:
        BadInput: entries that more ends have, or that are set for every end.
    """
    for name in cylinder.entries_of_ends():
        bound = (
            "absent here, where one end is solved, as in runs in time: `solve_orbit` and `jaxcomp run` "
            "solve all ends and stages, at any speed"
        )
        raise BadInput(f"gas.{name}", "given", bound)
    return cylinder


def grouping(cylinder: Cylinder, count: int) -> Grouping:
    """Which ends of so many cylinders are solved together."""
    sides = 1 if cylinder.crank_end is None else 2
    ends = sides * count
    if cylinder.later_stages:
        # Every cylinder has plenums of its own.
        touching = bool(cylinder.plenums) or cylinder.leakage is not None
        if touching:
            return Grouping(ends, sides, count)
        return Grouping(ends, sides, ends)
    if cylinder.plenums or is_piped(cylinder):
        return Grouping(ends, sides, 1)
    # between constant lines ends touch past the rings alone: head and crank end of one cylinder
    if cylinder.leakage is None or sides == 1:
        return Grouping(ends, sides, ends)
    return Grouping(ends, sides, count)


def options_of(cylinder: Cylinder, count: int, options: CycleOptions) -> CycleOptions:
    """Options in which the cycles of so many cylinders are solved.

    Panels, steps and events are those of all that are solved together, be it ends of a cylinder past its
    rings or cylinders with the same plenums or pipes. A choice of the size that counts the events of all
    and the panels of one leaves out sizes that have room.
    """
    piped = is_piped(cylinder)
    if piped:
        options = options.behind_pipes()
    if has_ends(cylinder):
        return options.of_several(grouping(cylinder, count).together)
    if piped or cylinder.plenums:
        return options.of_several(count)
    return options.of_several(1)


def phase_of_ends(cylinder: Cylinder, phase: Float[Array, " k"]) -> Float[Array, " e"]:
    """[rad] Own crank angle of every end less that of the crank.

    Args:
        cylinder: gas side.
        phase: [rad] of every cylinder.
    """
    if cylinder.crank_end is None:
        return phase
    # the crank end compresses half a revolution after the head end, and counts from there
    return (phase[:, None] + jnp.asarray([0.0, np.pi])).ravel()


class Ends(eqx.Module):
    """The ends of all cylinders, head before crank end, cylinder after cylinder.

    Attributes:
        cylinders: the gas side of every end, with an axis of k.
        pistons: the motion in every end, likewise.
        phase: [rad] (k,) own crank angle of each less that of the crank.
        grouping: which are solved together.
        stages: number of the stage of each, from 1; empty where there is one.
    """

    cylinders: Cylinder
    pistons: PistonEnd
    phase: Float[Array, " k"]
    grouping: Grouping = eqx.field(static=True)
    stages: tuple[int, ...] = eqx.field(static=True, default=())

    def grouped(self) -> "Ends":
        """Ends with axes of groups and of the ends of each."""
        shape = self.grouping.groups, self.grouping.together

        def split(leaf):
            return leaf.reshape(*shape, *leaf.shape[1:])

        return jax.tree.map(split, self)


def ends_of(cylinder: Cylinder, mechanisms: Sequence[AbstractMechanism], phase) -> Ends:
    """The ends of the cylinders of a machine.

    Args:
        cylinder: gas side of every cylinder, with or without crank ends.
        mechanisms: the linkage of every cylinder.
        phase: [rad] own crank angle of every cylinder less that of the crank.
    """
    stages = _stages_of_cylinders(cylinder, len(mechanisms))
    of_stages = between_lines(cylinder)
    cylinders = []
    pistons = []
    for mechanism, stage in zip(mechanisms, stages, strict=True):
        for gas_side, piston in _ends_of_cylinder(of_stages[stage - 1], mechanism):
            cylinders.append(gas_side)
            pistons.append(piston)
    # settings are numbered over all ends, so that these must stand in their order first
    cylinders = _controlled(cylinder, cylinders, pistons)
    _check_kinds(cylinders)
    kinds = grouping(cylinder, len(mechanisms))
    of_ends = []
    if cylinder.later_stages:
        for stage in stages:
            of_ends += [stage] * kinds.sides
    return Ends(
        stacked(cylinders),
        stacked(pistons),
        phase_of_ends(cylinder, phase),
        kinds,
        tuple(of_ends),
    )


def _controlled(
    settings: Cylinder, cylinders: list[Cylinder], pistons: list[PistonEnd]
) -> list[Cylinder]:
    """The ends with the unloaders and pockets that act on each, by settings of all ends."""
    unloaders = [getattr(end.suction_valve, "unloader", None) for end in cylinders]
    like = next((unloader for unloader in unloaders if unloader is not None), None)
    controlled = []
    for number, (end, piston, unloader) in enumerate(
        zip(cylinders, pistons, unloaders, strict=True)
    ):
        valve = end.suction_valve
        if like is not None:
            force = jnp.zeros(())
            if unloader is not None and settings.unloaded is not None:
                force = settings.unloaded[number] * unloader.force
            # Ends without one have one without a force, so that all are of one kind.
            valve = rebuilt(valve, unloader=replaced(unloader or like, force=force))
        clearance = end.clearance_ratio
        if end.pocket is not None and settings.pockets is not None:
            # an open pocket is more clearance, in parts of this end's own swept volume
            clearance += settings.pockets[number] * end.pocket.volume / piston.swept_volume
        controlled.append(
            rebuilt(
                end,
                suction_valve=valve,
                clearance_ratio=clearance,
                pocket=None,
                unloaded=None,
                pockets=None,
                load_steps=(),
            )
        )
    return controlled


def with_settings(cylinder: Cylinder, count: int) -> Cylinder:
    """The gas side with numbers for its unloaders and pockets, so that one program serves all load steps.

    Args:
        cylinder: gas side, with load steps or without.
        count: of cylinders.
    """
    if not cylinder.load_steps:
        return cylinder
    none = jnp.zeros(grouping(cylinder, count).ends)
    unloaded = none if cylinder.unloaded is None else cylinder.unloaded
    pockets = none if cylinder.pockets is None else cylinder.pockets
    return replaced(cylinder, unloaded=unloaded, pockets=pockets)


def check_settings(cylinder: Cylinder, count: int) -> None:
    """Refuse settings of unloaders and pockets that are not one for each end.

    Args:
        cylinder: gas side.
        count: of cylinders.
    """
    ends = grouping(cylinder, count).ends
    steps = {f"load_steps.{n}.": step for n, step in enumerate(cylinder.load_steps)}
    for where, settings in {"": cylinder, **steps}.items():
        for name in ("unloaded", "pockets"):
            values = getattr(settings, name)
            if values is None:
                continue
            path = f"gas.{where}{name}"
            if values.shape != (ends,):
                bound = f"one for each of {ends} ends, head before crank end"
                raise BadInput(path, f"{values.size} values", bound)
            if is_traced(values):
                continue
            parts = _parts_of_ends(cylinder, count)
            _check_acting(parts, name, path, values)
            if name == "unloaded":
                _check_delivering(parts, path, values)


# What an end must have for each of the settings.
_ENTRIES = {"unloaded": "suction_valve.unloader", "pockets": "pocket"}


class _EndParts(NamedTuple):
    """Parts by which the capacity of an end is controlled."""

    stage: int  # number, from 1
    unloader: Any
    pocket: Any


def _stages_of_cylinders(cylinder: Cylinder, count: int) -> tuple[int, ...]:
    """Number of the stage, from 1, of each of so many cylinders."""
    if cylinder.later_stages:
        return cylinder.stages
    return (1,) * count


def _parts_of_ends(cylinder: Cylinder, count: int) -> list[_EndParts]:
    """Unloader and pocket of each end, in the order of settings."""
    parts = []
    for number in _stages_of_cylinders(cylinder, count):
        stage = cylinder.stage(number)
        valve = stage.suction_valve
        parts.append(_EndParts(number, getattr(valve, "unloader", None), stage.pocket))
        end = stage.crank_end
        if end is not None:
            valve = end.suction_valve or valve
            parts.append(_EndParts(number, getattr(valve, "unloader", None), end.pocket))
    return parts


def _check_acting(parts: list[_EndParts], name: str, path: str, values: Float[Array, " e"]) -> None:
    """Refuse settings of what an end does not have.

    Args:
        parts: of every end.
        name: of the settings, "unloaded" or "pockets".
        path: of the settings in a file.
        values: [-] the settings.
    """
    for number, (part, value) in enumerate(zip(parts, np.asarray(values), strict=True), 1):
        acting = part.unloader if name == "unloaded" else part.pocket
        if value > 0 and acting is None:
            bound = f"0 for end {number}, which has no {_ENTRIES[name]} (head before crank end)"
            raise BadInput(path, values, bound)


def _check_delivering(parts: list[_EndParts], path: str, values: Float[Array, " e"]) -> None:
    """Refuse a stage of which every end is held open over the whole revolution."""
    delivering = set()
    for part, value in zip(parts, np.asarray(values), strict=True):
        # an unloader that lets go within the revolution leaves a delivery; an end that is set to 1
        # has one, as has been checked before
        if value != 1 or part.unloader.release is not None:
            delivering.add(part.stage)
    for part in parts:
        if part.stage not in delivering:
            bound = f"0 for an end of stage {part.stage} at least, which delivers nothing otherwise"
            raise BadInput(path, values, bound)


def between_lines(cylinder: Cylinder) -> list[Cylinder]:
    """The gas side of every stage between its own lines, at the pressures that stand between them."""
    if not cylinder.later_stages:
        return [cylinder]
    assert cylinder.interstage_pressure is not None
    cylinder = cylinder.by_dew_points()
    coolers = [stage.cooler for stage in cylinder.later_stages]
    first = cylinder.suction.state(cylinder.fluid)
    delivery = cylinder.discharge.states(cylinder.fluid, first)[0]
    suctions = [(first.p, first.T, cylinder.suction.plenums)]
    discharges = []
    for cooler, pressure in zip(coolers, cylinder.interstage_pressure, strict=True):
        suctions.append((pressure, cooler.outlet_temperature, cooler.behind))
        # the stage before has to raise what its cooler takes
        discharges.append((pressure + cooler.pressure_drop, cooler.before))
    discharges.append((delivery.p, cylinder.discharge.plenums))
    stages = [cylinder, *cylinder.later_stages]
    return [
        _between(cylinder, *entries) for entries in zip(stages, suctions, discharges, strict=True)
    ]


def _between(cylinder: Cylinder, stage: Cylinder | Stage, suction, discharge) -> Cylinder:
    """A stage as a cylinder between its lines."""
    pressure, temperature, plenums = suction
    line_before = rebuilt(
        cylinder.suction,
        pressure=pressure,
        temperature=temperature,
        evaporating=None,
        superheat=None,
        plenums=plenums,
    )
    pressure, plenums = discharge
    line_behind = rebuilt(cylinder.discharge, pressure=pressure, condensing=None, plenums=plenums)
    return rebuilt(
        cylinder,
        suction=line_before,
        discharge=line_behind,
        suction_valve=stage.suction_valve,
        discharge_valve=stage.discharge_valve,
        clearance_ratio=stage.clearance_ratio,
        wall_temperature=stage.wall_temperature,
        heat=stage.heat,
        leakage=stage.leakage,
        crank_end=stage.crank_end,
        pocket=stage.pocket,
        later_stages=(),
        stage_of_cylinder=(),
        interstage_pressure=None,
    )


def _ends_of_cylinder(
    cylinder: Cylinder, mechanism: AbstractMechanism
) -> list[tuple[Cylinder, PistonEnd]]:
    """Gas side and motion of each end."""
    crank_end = cylinder.crank_end
    if crank_end is None:
        none = jnp.zeros(())
        return [(cylinder, _piston_end(mechanism, 1.0, none, none, None))]
    # The gap past the piston lies between the ends; what leaves them is past the packing.
    rings = cylinder.leakage
    packing = crank_end.packing
    # no rod passes the head end; a packing without a gap keeps the parts of both ends of one kind
    closed = None
    if packing is not None:
        closed = replaced(packing, gap=jnp.zeros(()))
    clearance = crank_end.clearance_ratio
    if clearance is None:
        clearance = cylinder.clearance_ratio
    head = rebuilt(cylinder, crank_end=None, leakage=closed)
    crank = rebuilt(
        head,
        leakage=packing,
        clearance_ratio=clearance,
        suction_valve=crank_end.suction_valve or cylinder.suction_valve,
        discharge_valve=crank_end.discharge_valve or cylinder.discharge_valve,
        pocket=crank_end.pocket,
    )
    rod = crank_end.rod_diameter
    ambient = crank_end.ambient_pressure
    return [
        (head, _piston_end(mechanism, 1.0, jnp.zeros_like(rod), ambient, rings)),
        (crank, _piston_end(mechanism, -1.0, rod, ambient, rings)),
    ]


def _piston_end(mechanism, sense: float, rod, ambient, rings: LaminarGap | None) -> PistonEnd:
    return PistonEnd(mechanism, jnp.asarray(sense), rod, ambient, rings)


def _check_kinds(cylinders: list[Cylinder]) -> None:
    """That the ends have parts of the same kinds, of which one program solves all."""
    for field in dataclasses.fields(Cylinder):
        parts = [getattr(end, field.name) for end in cylinders]
        if len({jax.tree.structure(part) for part in parts}) > 1:
            words = ", ".join(dict.fromkeys(getattr(part, "kind", "none") for part in parts))
            bound = "the same kind, with the same optional entries, at all ends and in all stages"
            raise BadInput(f"gas.{field.name}", words, bound)


def guessed_pressures(cylinder: Cylinder, mechanisms) -> Float[Array, " s"]:
    """[Pa] In the suction lines of the later stages, by the swept volumes alone.

    Args:
        cylinder: with later stages.
        mechanisms: the linkage of every cylinder.
    """
    cylinder = cylinder.by_dew_points()
    swept = [jnp.zeros(()) for _ in range(len(cylinder.later_stages) + 1)]
    for mechanism, stage in zip(mechanisms, cylinder.stages, strict=True):
        area = mechanism.piston_area
        end = cylinder.stage(stage).crank_end
        if end is not None:
            # both ends draw, the crank end around its rod
            area = 2 * area - jnp.pi / 4 * end.rod_diameter**2
        swept[stage - 1] = swept[stage - 1] + area * mechanism.stroke
    first = cylinder.suction.state(cylinder.fluid)
    delivery = cylinder.discharge.states(cylinder.fluid, first)[0]
    pressures = []
    for number, stage in enumerate(cylinder.later_stages, 1):
        # the same mass a revolution fills both stages: p V/T is the same, in a perfect gas without
        # losses
        ratio = swept[0] / swept[number] * stage.cooler.outlet_temperature / first.T
        # Between the lines, with something left for every stage.
        share = clip(jnp.log(ratio) / jnp.log(delivery.p / first.p), 0.0, 1.0)
        even = number / len(swept)
        share = clip(share, 0.5 * even, 0.5 * (1 + even))
        pressures.append(first.p * (delivery.p / first.p) ** share)
    return jnp.stack(pressures)
