"""The cylinder as a part of the machine: gas, valves, heat and leakage, between its lines."""

from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.display import ZERO_CELSIUS
from .._core.errors import BadInput
from .._core.extremes import clip
from .._core.fields import POSITIVE, Bound, is_traced, known_values, quantity, rebuilt, replaced
from .._core.lookup import interval_of
from .._core.polynomials import gauss, legendre_columns
from ..fluid import AbstractFluid, AbstractRealGas, GasState, Mixture
from ..fluid._real import FAR, has_dew_line
from ..gas import AbstractGas
from ..mechanism import AbstractMechanism
from ..piping import Piping
from ..piping._resonances import NAMED_RESONANCES
from ..piping.run import unit_direction
from ..valve import AbstractValve
from ..valve._flow import Side, critical_ratio
from ._lines import DischargeLine, SuctionLine, by_dew_points
from ._piston_end import PistonEnd
from ._plenum import Plenum
from .crank_end import CrankEnd
from .heat._heat_transfer import AbstractHeat
from .laminar_gap import LaminarGap
from .load_step import ClearancePocket, LoadStep
from .stage import Stage
from .wall_network import WallNetwork

# [K] by which a temperature may pass saturation: pressures of saturated gas are given with few digits.
_NEAR = 0.5
# [K] Temperature at which a machine can have gas condensed without another one.
_ROOM = 293.15


class Cylinder(AbstractGas):
    """Cylinder of a compressor: its gas, valves, lines and losses, besides the piston's motion.

    Its pressure is a state, not a function of the stroke: `solve_orbit` solves it with the crank's
    motion, `solve_cycle` at a given speed.

    Args:
        fluid: the gas.
        suction: the line before the suction valve.
        discharge: the line behind the discharge valve.
        suction_valve: into the cylinder.
        discharge_valve: out of the cylinder.
        clearance_ratio: [-] clearance volume over swept volume.
        wall_temperature: [K] of cylinder, head and piston; needed for heat transfer. With `walls` the
            guess of the periodic state, and what a run in time holds.
        heat: correlation of the heat transfer; adiabatic if absent.
        leakage: past the piston, to the gas of the suction line, or to the crank end where there is one;
            tight if absent.
        walls: conductances that decide the wall's temperature; `wall_temperature` holds if absent.
        crank_end: compression on the rod's side of the piston as well; single-acting if absent. The
            entries of the cylinder are then those of its head end.
        later_stages: behind the first one, whose cylinders are these. `discharge` is the line behind
            the last; the pressures between follow from the flows.
        stage_of_cylinder: number of the stage, from 1, of every cylinder; in their order if absent.
        pocket: of the head end; none if absent.
        unloaded: [-] (e,) share of the force with which the unloader of every end's suction valve acts,
            cylinder after cylinder, head before crank end; none if absent.
        pockets: [-] (e,) share of every end's pocket that is open; none if absent.
        load_steps: settings of `unloaded` and `pockets` by name, for `study.load_steps`.
        interstage_pressure: [Pa] in the suction line of every later stage, where it is held by
            something else; found if absent.

        reference: what evaporating and condensing temperatures are of a blend with glide: those of the
            "dew" points, or "mean" ones of evaporator (behind the expansion valve and dew point) and
            condenser (dew and bubble point). Superheat counts from the dew point and subcooling from the
            bubble point with either.

    Raises:
        BadInput: a line outside the range of its fluid: the condensing temperature must lie between the
            evaporating and the critical one, gas above its dew temperature and liquid below it; walls of
            a double-acting or staged cylinder; piping with more than one flange behind plenums, with
            quasi-steady ports or with stages; lines of a rating point between stages.
        ValueError: heat transfer without a wall temperature, walls without heat transfer, or a
            conductance to a plenum that is not there.
    """

    kind: ClassVar[str] = "cylinder"
    of_whole_machine: ClassVar[bool] = True

    fluid: AbstractFluid
    suction: SuctionLine
    discharge: DischargeLine
    suction_valve: AbstractValve
    discharge_valve: AbstractValve
    clearance_ratio: Float[Array, ""] = quantity(
        "", POSITIVE, doc="clearance over swept volume", usual=(1e-3, 0.3)
    )
    wall_temperature: Float[Array, ""] | None = quantity(
        "K", POSITIVE, default=None, usual=(150.0, 700.0)
    )
    heat: AbstractHeat | None = None
    leakage: LaminarGap | None = None
    walls: WallNetwork | None = None
    crank_end: CrankEnd | None = None
    later_stages: tuple[Stage, ...] = ()
    stage_of_cylinder: tuple[int, ...] = eqx.field(static=True, default=())
    pocket: ClearancePocket | None = None
    unloaded: Float[Array, " e"] | None = quantity(
        "",
        Bound(0.0, 1.0),
        shape=(None,),
        default=None,
        doc="share of the unloader's force, of every end: head before crank end",
    )
    pockets: Float[Array, " e"] | None = quantity(
        "",
        Bound(0.0, 1.0),
        shape=(None,),
        default=None,
        doc="open share of the pocket, of every end: head before crank end",
    )
    load_steps: tuple[LoadStep, ...] = ()
    interstage_pressure: Float[Array, " s"] | None = quantity(
        "Pa",
        POSITIVE,
        shape=(None,),
        default=None,
        doc="in the suction line of every later stage, where something holds it; found if absent",
    )

    reference: Literal["dew", "mean"] = eqx.field(static=True, default="dew")

    def __check_init__(self):
        self._check_reference()
        if self.walls is not None and (self.crank_end is not None or self.later_stages):
            bound = "absent with a crank_end or later_stages: give wall_temperature"
            raise BadInput("walls", "given", bound)
        _check_stages(self)
        _check_capacity_control(self)
        if self.walls is not None:
            if self.heat is None:
                raise ValueError("`walls` need a `heat`, by which the gas reaches them.")
            for name, line in (("suction", self.suction), ("discharge", self.discharge)):
                conductance = getattr(self.walls, f"{name}_conductance")
                if not line.plenums and not is_traced(conductance) and bool(conductance != 0):
                    raise ValueError(f"`walls.{name}_conductance` needs `{name}.plenums`.")
        if self.heat is not None and self.wall_temperature is None:
            raise ValueError("heat transfer needs a `wall_temperature`.")
        self._check_piping()
        # limits are those of dew temperatures, of numbers that are compared without compiling
        plain_values = known_values(self).by_dew_points()
        for limit in (*_limits(plain_values), *_dry_limits(plain_values)):
            if not is_traced(holds := limit.holds()) and not np.all(holds):
                raise BadInput(limit.field, limit.value, f"{limit.range}, {limit.why}")
        if self.later_stages:
            _check_pressures_between(self)

    @property
    def refrigerates(self) -> bool:
        """Whether liquid of the gas may stand behind the machine, so that its capacity means something.

        It does at a rating point, and where the gas can be condensed by what surrounds a machine or cools
        it as far as it comes: methane of 30 degC between two pressures is compressed, and no refrigerant.
        """
        if not has_dew_line(self.fluid):
            return False
        suction = self.suction
        discharge = self.discharge
        rating = (suction.evaporating, suction.superheat, discharge.condensing)
        rating += (discharge.subcooling, discharge.liquid_temperature)
        critical = self.fluid.critical_temperature
        if any(number is not None for number in rating) or suction.temperature is None:
            return True
        # a comparison of traced numbers decides nothing here: the capacity is there then,
        # meaningful or not
        if any(map(is_traced, (critical, suction.temperature))):
            return True
        return bool(min(_ROOM, np.min(suction.temperature)) < critical)

    def _check_reference(self) -> None:
        """Refuse dew points of a gas that has none, and mean temperatures without heat exchangers."""
        if isinstance(self.fluid, AbstractRealGas) and not self.fluid.condenses:
            self._check_lines_without_dew_points()
        if self.reference == "dew":
            return
        bound = (
            '"dew", or given with evaporating or condensing temperatures of a fluid that condenses'
        )
        line_temperatures = self.suction.evaporating, self.discharge.condensing
        no_exchanger = all(temperature is None for temperature in line_temperatures)
        if no_exchanger or not has_dew_line(self.fluid):
            raise BadInput("reference", '"mean"', bound)

    def _check_lines_without_dew_points(self) -> None:
        """Refuse temperatures of dew or bubble points of a gas that has none here."""
        names = (("suction", "evaporating"), ("suction", "superheat"), ("discharge", "condensing"))
        names += (("discharge", "subcooling"), ("discharge", "liquid_temperature"))
        for line, name in names:
            value = getattr(getattr(self, line), name)
            if value is not None:
                bound = (
                    f"absent: {_name(self.fluid)} has no dew line; give pressures and temperatures"
                )
                raise BadInput(f"{line}.{name}", value, f"{bound} of the gas")

    def by_dew_points(self) -> "Cylinder":
        """The cylinder with evaporating and condensing temperatures of dew points, as solvers take it."""
        if self.reference == "dew":
            return self
        suction, discharge = by_dew_points(self.fluid, self.suction, self.discharge)
        return rebuilt(self, suction=suction, discharge=discharge, reference="dew")

    def _check_piping(self) -> None:
        """Refuse what lines with pipes do not go with."""
        for name, line in (("suction", self.suction), ("discharge", self.discharge)):
            if line.piping is None:
                continue
            if self.later_stages:
                bound = "absent with later_stages: pipes are solved for the cylinders of one stage"
                raise BadInput(f"{name}.piping", "given", bound)
            # all cylinders share the plenums of a line, and these have one neck towards the pipes
            if line.plenums and len(line.piping.flanges) > 1:
                bound = '"flange" of all cylinders where `plenums` stand between valves and pipes'
                flanges = ", ".join(line.piping.flanges)
                raise BadInput(f"{name}.piping.pipes", flanges, bound)
            for which, valve in (
                ("suction", self.suction_valve),
                ("discharge", self.discharge_valve),
            ):
                if valve.port_length is None:
                    bound = (
                        "given where lines have `piping`: quasi-steady ports can only be marched, and "
                        "pipes are solved by collocation"
                    )
                    raise BadInput(f"{which}_valve.port_length", "none", bound)

    def conditions(self):
        limits = _limits(self.by_dew_points())
        return {f"{limit.field}: {limit.why}": limit.holds() for limit in limits}

    def repaired(self):
        if self.reference == "mean":  # whose limits are those of other temperatures
            return self
        repaired = self
        for rule in _RULES:  # one after the other, as the later ones follow from the earlier
            for limit in rule(repaired):
                line, _, name = limit.field.partition(".")
                moved = replaced(getattr(repaired, line), **{name: limit.clipped()})
                repaired = replaced(repaired, **{line: moved})
        return repaired

    def pressure(self, stroke):
        raise TypeError(
            "The pressure of a cylinder with valves depends on the whole revolution: solve the orbit "
            "and take `orbit.pressure` or `orbit.cycle`."
        )

    @property
    def behind_piston(self):
        gas = self.by_dew_points()
        return gas.suction.state(gas.fluid).p

    @property
    def valves(self) -> tuple[AbstractValve, AbstractValve]:
        """Suction and discharge valve."""
        return self.suction_valve, self.discharge_valve

    @property
    def rod_diameter(self) -> Float[Array, ""] | None:
        """[m] of the piston rod, of stages those of all cylinders; `None` of single-acting ones."""
        if self.crank_end is None:
            return None
        if not self.later_stages:
            return self.crank_end.rod_diameter
        diameters = []
        for number in self.stages:
            end = self.stage(number).crank_end
            if end is None:
                # a cylinder without a crank end has a rod of no area
                diameters.append(jnp.zeros(()))
            else:
                diameters.append(end.rod_diameter)
        return jnp.stack(diameters)

    def entries_of_ends(self) -> Iterator[str]:
        """Names of the entries by which ends are solved, and not the cylinders alike."""
        for name in ("crank_end", "later_stages", "pocket", "load_steps"):
            if getattr(self, name):
                yield name
        for name in ("unloaded", "pockets"):
            if getattr(self, name) is not None:
                yield name
        if _unloader_of(self) is not None:
            yield "suction_valve.unloader"

    @property
    def _piped(self) -> dict[str, Piping]:
        """Networks of the lines that have any, by name of the line."""
        networks = {}
        for name, line in (("suction", self.suction), ("discharge", self.discharge)):
            if line.piping is not None:
                networks[name] = line.piping
        return networks

    @property
    def resonance_names(self) -> list[str]:
        """Names of the lowest resonances of pipes: numbers, behind their line's where both have pipes."""
        piped = list(self._piped)
        numbers = range(1, NAMED_RESONANCES + 1)
        if len(piped) == 1:
            return [str(number) for number in numbers]
        names = []
        for line in piped:
            names += [f"{line}.{number}" for number in numbers]
        return names

    @property
    def run_directions(self) -> dict[str, Float[Array, "3"]]:
        """Directions of runs of pipe and vessels, by their names among the quantities."""
        piped = self._piped
        directions = {}
        for line, piping in piped.items():
            for name, element in zip(piping.run_names, piping.shaken, strict=True):
                name_of_line = f"{line}.{name}" if len(piped) > 1 else name
                directions[name_of_line] = unit_direction(element.direction)
        return directions

    @property
    def stages(self) -> tuple[int, ...]:
        """Number of the stage, from 1, of every cylinder."""
        return self.stage_of_cylinder or tuple(range(1, len(self.later_stages) + 2))

    def stage(self, number: int) -> "Cylinder | Stage":
        """Part with the valves and ends of a stage, from 1."""
        if number == 1:
            return self
        return self.later_stages[number - 2]

    @property
    def plenums(self) -> tuple[Plenum, ...]:
        """Those before the suction valve, then those behind the discharge valve."""
        return (*self.suction.plenums, *self.discharge.plenums)

    @property
    def inert(self) -> bool:
        """Whether the gas in all ports has inertia, so that reversals are events."""
        valves = []
        for stage in (self, *self.later_stages):
            for end in (stage, stage.crank_end):
                if end is not None:
                    valves += [end.suction_valve, end.discharge_valve]
        return all(valve.port_length is not None for valve in valves if valve is not None)


def _check_stages(cylinder: Cylinder) -> None:
    """That later stages go with the lines and ends of the first."""
    if not cylinder.later_stages:
        for name in ("stage_of_cylinder", "interstage_pressure"):
            value = getattr(cylinder, name)
            if value is not None and value != ():
                raise BadInput(name, str(value), "absent without later_stages")
        return
    count = len(cylinder.later_stages) + 1
    if set(cylinder.stages) != set(range(1, count + 1)):
        bound = f"numbers from 1 to {count}, each of them at least once"
        raise BadInput("stage_of_cylinder", str(cylinder.stage_of_cylinder), bound)
    pressures = cylinder.interstage_pressure
    if pressures is not None and pressures.shape != (count - 1,):
        raise BadInput("interstage_pressure", pressures, f"{count - 1}, one for each later stage")
    _check_staged_lines(cylinder)
    for number, stage in enumerate(cylinder.later_stages):
        if (stage.crank_end is None) != (cylinder.crank_end is None):
            bound = "given in every stage or in none"
            raise BadInput(f"later_stages.{number}.crank_end", "given or absent", bound)
        if stage.heat is not None and stage.wall_temperature is None:
            where = f"later_stages.{number}.wall_temperature"
            raise BadInput(where, "absent", "given where there is heat transfer")


def _check_pressures_between(cylinder: Cylinder) -> None:
    """That pressures between stages lie between those of the lines, as far as numbers are known."""
    plain_values = known_values(cylinder).by_dew_points()
    low = plain_values.suction.state(plain_values.fluid)
    high = plain_values.discharge.states(plain_values.fluid, low)[0].p
    low = low.p
    if is_traced(low) or is_traced(high) or not bool(high > low):
        return  # a discharge pressure below that of suction has a bound of its own
    for number, stage in enumerate(plain_values.later_stages):
        drop = stage.cooler.pressure_drop
        if not is_traced(drop) and bool(drop >= high - low):
            where = f"later_stages.{number}.cooler.pressure_drop"
            raise BadInput(where, drop, f"< {high - low:.5g} Pa, all that the stages raise")
    between = plain_values.interstage_pressure
    if between is None or is_traced(between):
        return
    _check_dry_coolers(plain_values)
    # every stage compresses, so that pressures rise from line to line
    rises = jnp.diff(jnp.concatenate([low[None], between, high[None]]))
    if bool(jnp.any(rises <= 0)):
        bound = f"rising, > {low:.5g} Pa of the suction and < {high:.5g} Pa of the discharge line"
        raise BadInput("interstage_pressure", between, bound)


def _check_dry_coolers(cylinder: Cylinder) -> None:
    """That nothing condenses in the coolers: the gas behind would have another composition."""
    fluid = cylinder.fluid
    if not isinstance(fluid, AbstractRealGas) or cylinder.interstage_pressure is None:
        return
    for number, stage in enumerate(cylinder.later_stages):
        outlet = stage.cooler.outlet_temperature
        p = cylinder.interstage_pressure[number]
        dew = fluid.condensation_temperature(p)
        if any(map(is_traced, (outlet, dew))) or bool(outlet >= dew - _NEAR):
            continue
        where = f"later_stages.{number}.cooler.outlet_temperature"
        degrees = f"{float(dew):.5g} K ({float(dew) - ZERO_CELSIUS:.4g} degC)"
        bound = f"> {degrees}, at which {_name(fluid)} begins to condense at {float(p):.5g} Pa"
        raise BadInput(where, outlet, bound)


def _check_capacity_control(cylinder: Cylinder) -> None:
    """That settings of ends go with the unloaders and pockets that there are."""
    ends = []
    for stage in (cylinder, *cylinder.later_stages):
        ends += [stage, stage.crank_end]
    valves = [getattr(end, "discharge_valve", None) for end in ends]
    if any(getattr(valve, "unloader", None) is not None for valve in valves):
        raise BadInput(
            "discharge_valve.unloader", "given", "absent: unloaders act on suction valves"
        )
    steps = {f"load_steps.{n}.": step for n, step in enumerate(cylinder.load_steps)}
    for where, settings in {"": cylinder, **steps}.items():
        unloads = settings.unloaded is not None
        if unloads and not any(_unloader_of(end) is not None for end in ends):
            bound = "absent without a suction_valve.unloader"
            raise BadInput(f"{where}unloaded", settings.unloaded, bound)
        opens = settings.pockets is not None
        if opens and all(getattr(end, "pocket", None) is None for end in ends):
            raise BadInput(f"{where}pockets", settings.pockets, "absent without a pocket")
    names = [step.name for step in cylinder.load_steps]
    for name in names:
        if names.count(name) > 1:
            raise BadInput("load_steps.name", name, "another name for every step")


def _unloader_of(end: Any) -> Any:
    """The unloader of the suction valve of an end."""
    return getattr(getattr(end, "suction_valve", None), "unloader", None)


def _check_staged_lines(cylinder: Cylinder) -> None:
    """That the lines of a staged machine say nothing of a refrigerating cycle."""
    for line, names in (
        ("suction", ("heating", "warming")),
        ("discharge", ("temperature", "subcooling", "liquid_temperature")),
    ):
        for name in names:
            if getattr(getattr(cylinder, line), name) is not None:
                raise BadInput(f"{line}.{name}", "given", "absent with later_stages")


class _Limit(NamedTuple):
    """Bound of a number of a line, beside its own."""

    field: str
    value: Any
    bound: Bound
    unit: str
    why: str

    @property
    def range(self) -> str:
        """The bound with its unit, of a temperature in degrees as well."""
        text = f"{self.bound} {self.unit}"
        if self.unit != "K" or self.field.endswith(("superheat", "subcooling")):
            return text
        low = self.bound.low - ZERO_CELSIUS
        high = self.bound.high - ZERO_CELSIUS
        return f"{text} ({self.bound._replace(low=low, high=high)} degC)"

    def holds(self):
        """Whether the number does."""
        return self.bound.inside(self.value)

    def clipped(self) -> Float[Array, ""]:
        """The number moved inside."""
        low, high, low_open, high_open = self.bound
        # a number on an open bound is outside: the bound is taken a millionth further in
        low = low * (1 + 1e-6 * low_open)
        high = high * (1 - 1e-6 * high_open)
        value = jnp.asarray(self.value)
        # `clip` would pass on what is no number; a value inside stays the same to the last bit
        moved = clip(jnp.nan_to_num(value), low, high)
        return jnp.where(jnp.asarray(self.holds()), value, moved)


def _limits(cylinder: Cylinder) -> Iterator[_Limit]:
    for rule in _RULES:
        yield from rule(cylinder)


def _dew(fluid: AbstractFluid, pressure, saturated):
    """[K] Dew temperature of a line; that of a perfect gas is far below all its temperatures."""
    if saturated is not None:
        return saturated
    if isinstance(fluid, AbstractRealGas):
        return fluid.condensation_temperature(pressure)
    return 0.0


def _bubble(fluid: AbstractRealGas, pressure, saturated):
    """[K] Bubble temperature at the pressure of a line, or at that of its dew temperature."""
    if not fluid.has_glide:
        return _dew(fluid, pressure, saturated)
    if pressure is None:
        pressure = fluid.dew_pressure(saturated)
    return fluid.bubble_temperature(pressure)


def _evaporating_limits(cylinder: Cylinder) -> Iterator[_Limit]:
    fluid = cylinder.fluid
    line = cylinder.suction
    if has_dew_line(fluid) and line.evaporating is not None:
        inside = Bound(fluid.temperature_range[0], fluid.critical_temperature, high_open=True)
        yield _Limit("suction.evaporating", line.evaporating, inside, "K", _critical(fluid))
    if has_dew_line(fluid) and line.superheat is not None and line.pressure is not None:
        critical_pressure = fluid.critical_pressure
        why = f"the critical pressure of {fluid.name}, as gas has no superheat above it"
        yield _Limit(
            "suction.pressure", line.pressure, Bound(0.0, critical_pressure, True, True), "Pa", why
        )


def _suction_limits(cylinder: Cylinder) -> Iterator[_Limit]:
    fluid = cylinder.fluid
    line = cylinder.suction
    low, high = fluid.temperature_range
    dew = _dew(fluid, line.pressure, line.evaporating)
    heated = 0.0 if line.heating is None else line.heating
    why = f"the range of {_name(fluid)}"
    if isinstance(fluid, Mixture):
        why = f"{why}, which {fluid.range_ends_with} ends"
    if line.temperature is not None:
        # heating comes on top: the gas at the valve has to be within the range as well
        inside = Bound(low, high - heated)
        yield _Limit("suction.temperature", line.temperature, inside, "K", why)
    if line.superheat is not None:
        yield _Limit("suction.superheat", line.superheat, Bound(0.0, high - dew - heated), "K", why)


def _condensing_limits(cylinder: Cylinder) -> Iterator[_Limit]:
    fluid = cylinder.fluid
    suction = cylinder.suction
    discharge = cylinder.discharge
    dew = _dew(fluid, suction.pressure, suction.evaporating)
    if has_dew_line(fluid) and discharge.condensing is not None:
        inside = Bound(dew, fluid.critical_temperature, True, True)
        why = f"between the evaporating temperature and {_critical(fluid)}"
        yield _Limit("discharge.condensing", discharge.condensing, inside, "K", why)
    if discharge.pressure is not None:
        pressure = suction.pressure
        if pressure is None and has_dew_line(fluid):
            pressure = fluid.dew_pressure(suction.evaporating)
        if pressure is not None:
            inside = Bound(pressure, np.inf, low_open=True)
            why = "above the suction pressure"
            if isinstance(fluid, AbstractRealGas):
                inside = inside._replace(high=FAR * fluid.highest_pressure)
                end = f"{FAR:g} times the range of the equation of state of {fluid.pressure_ends_with}"
                why = f"{why}, up to {end}"
            yield _Limit("discharge.pressure", discharge.pressure, inside, "Pa", why)


def _discharge_limits(cylinder: Cylinder) -> Iterator[_Limit]:
    fluid = cylinder.fluid
    line = cylinder.discharge
    low, high = fluid.temperature_range
    dew = _dew(fluid, line.pressure, line.condensing)
    if line.temperature is not None:
        least = dew - _NEAR
        # by NumPy outside of a trace, so that checks compile nothing
        tools = jnp if is_traced(least) else np
        inside = Bound(tools.maximum(low, least), high)
        why = f"dew temperature and range of {_name(fluid)}"
        yield _Limit("discharge.temperature", line.temperature, inside, "K", why)
    if not has_dew_line(fluid):
        return
    boiling = _bubble(fluid, line.pressure, line.condensing)
    if line.liquid_temperature is not None:
        highest = boiling + _NEAR  # traced within `jit`, even where the bubble temperature is known
        tools = jnp if is_traced(highest) else np
        # saturation ends at the critical point, where liquid and gas are one
        highest = tools.minimum(highest, 0.9999 * fluid.critical_temperature)
        why = f"triple point of {fluid.name} and saturation at the discharge pressure"
        inside = Bound(low, highest)
        yield _Limit("discharge.liquid_temperature", line.liquid_temperature, inside, "K", why)
    if line.subcooling is not None:
        why = f"above the triple point of {fluid.name}, {low:g} K"
        yield _Limit("discharge.subcooling", line.subcooling, Bound(0.0, boiling - low), "K", why)


def _dry_limits(cylinder: Cylinder) -> Iterator[_Limit]:
    """Superheat, where temperatures give it; solvers call wet gas `Status.wet`."""
    fluid = cylinder.fluid
    line = cylinder.suction
    if line.temperature is not None:
        dew = _dew(fluid, line.pressure, line.evaporating)
        why = f"the dew temperature of {_name(fluid)}"
        yield _Limit("suction.temperature", line.temperature, Bound(dew - _NEAR), "K", why)


_RULES: tuple[Callable[[Cylinder], Iterator[_Limit]], ...] = (
    _evaporating_limits,
    _suction_limits,
    _condensing_limits,
    _discharge_limits,
)


def _name(fluid: AbstractFluid) -> str:
    if isinstance(fluid, AbstractRealGas):
        return fluid.name
    return "the perfect gas"


def _critical(fluid: AbstractRealGas) -> str:
    if isinstance(fluid, Mixture):
        end = f"the end of the dew line of {fluid.name}, 0.985 of its critical temperature"
        return f"{end}; give pressures above"
    return f"the critical temperature of {fluid.name}"


def ports_fit(cylinder: Cylinder, mechanism: AbstractMechanism) -> tuple[Bool[Array, "*k"], ...]:
    """Whether the ports of suction and discharge valve are narrower than the piston, less its rod."""
    if not cylinder.later_stages:
        return _ports_of_stage(cylinder, mechanism.piston_area)
    areas = jnp.broadcast_to(mechanism.piston_area, (len(cylinder.stages),))
    pairs = [
        _ports_of_stage(cylinder.stage(stage), area)
        for stage, area in zip(cylinder.stages, areas, strict=True)
    ]
    return tuple(jnp.stack(fits) for fits in zip(*pairs, strict=True))


def _ports_of_stage(stage: Cylinder | Stage, area) -> tuple[Bool[Array, "*k"], ...]:
    valves = stage.suction_valve, stage.discharge_valve
    if stage.crank_end is None:
        return tuple(valve.port_area < area for valve in valves)
    # ports of the crank end lie in the ring around the rod
    around = area - jnp.pi / 4 * stage.crank_end.rod_diameter**2
    at_crank = stage.crank_end.suction_valve, stage.crank_end.discharge_valve
    return tuple(
        (valve.port_area < area) & ((other or valve).port_area < around)
        for valve, other in zip(valves, at_crank, strict=True)
    )


class Pace(eqx.Module):
    """Unevenness of a revolution: polynomials on p panels through s Gauss nodes on each.

    Attributes:
        edges: [rad] (p + 1,) rising crank angles, the last a revolution after the first.
        excess: [-] (p, s) time that an angle takes at the nodes, over its mean and less one.
    """

    edges: Float[Array, " p_plus_1"]
    excess: Float[Array, "p s"]

    def at(self, angle: Float[Array, ""]) -> Float[Array, ""]:
        """The excess [-] at a crank angle [rad] of any revolution, with all derivatives."""
        first = self.edges[0]
        revolution = 2 * np.pi
        # edges are those of one revolution, an angle may be of any
        turned = first + jnp.mod(angle - first, revolution)
        panel = interval_of(self.edges, turned)
        start = self.edges[panel]
        width = self.edges[panel + 1] - self.edges[panel]
        wide = width > 0
        # double where: a panel of no width has no inside, and the slope of its quotient is no
        # number
        x = jnp.where(wide, (turned - start) / jnp.where(wide, width, 1.0), 0.5)
        count = self.excess.shape[-1]
        terms = gauss(count).to_legendre @ self.excess[panel]
        return legendre_columns(2 * x - 1, count) @ terms

    def lag(self, angle: Float[Array, ""]) -> Float[Array, ""]:
        """The excess [rad] that has come together since the first edge, at a crank angle [rad]."""
        first = self.edges[0]
        turned = first + jnp.mod(angle - first, 2 * np.pi)
        panel = interval_of(self.edges, turned)
        widths = jnp.diff(self.edges)
        count = self.excess.shape[-1]
        rule = gauss(count)
        # panels before the one of the angle by Gauss's rule, the beginning of that one by its
        # polynomials
        panel_lags = widths * (self.excess @ rule.weights)
        before = jnp.concatenate([jnp.zeros(1), jnp.cumsum(panel_lags)])
        wide = widths[panel] > 0
        x = (turned - self.edges[panel]) / jnp.where(wide, widths[panel], 1.0)
        terms = rule.to_legendre @ self.excess[panel]
        columns = legendre_columns(jnp.where(wide, 2 * x - 1, -1.0), count + 1)
        # of Legendre's polynomials the integral from -1 to y is (P_(k+1) - P_(k-1))/(2 k + 1)
        odd = 2 * np.arange(1, count) + 1
        integrals = jnp.concatenate([(columns[1] + 1)[None], (columns[2:] - columns[:-2]) / odd])
        return before[panel] + widths[panel] / 2 * (integrals @ terms)


class Case(eqx.Module):
    """A cylinder on its mechanism at a speed, with everything that is constant over a revolution."""

    cylinder: Cylinder  # the gas side
    mechanism: AbstractMechanism | PistonEnd  # the piston's motion
    speed: Float[Array, ""]  # [rad/s] mean speed of the crank
    pace: Pace | None  # of the crank; `None` at constant speed
    # the gas at the two valves
    suction: GasState
    discharge: GasState
    isentropic: GasState  # end of the isentropic compression between the lines
    comes: GasState  # the gas as it comes to the compressor, before it is heated
    lines: tuple[Side, Side]  # the gas at the two valves, as it flows through them
    top: Float[Array, ""]  # [m] piston position at the top dead centre
    swept: Float[Array, ""]  # [m^3] swept volume

    @property
    def mass_scale(self) -> Float[Array, ""]:
        """[kg] of the full cylinder at suction."""
        return self.suction.rho * self.swept

    @property
    def energy_scale(self) -> Float[Array, ""]:
        """[J] p_s V_s."""
        return self.suction.p * self.swept

    @property
    def bore(self) -> Float[Array, ""]:
        """[m] of a round piston of that area."""
        if isinstance(self.mechanism, PistonEnd):
            return self.mechanism.bore
        return jnp.sqrt(4 / jnp.pi * self.mechanism.piston_area)

    @property
    def gap_between_walls(self) -> Float[Array, ""]:
        """[m] Four volumes over the area of the walls along the stroke: the bore, less a rod in it."""
        if isinstance(self.mechanism, PistonEnd):
            return self.mechanism.bore - self.mechanism.rod_diameter
        return self.bore

    @property
    def sealed_diameter(self) -> Float[Array, ""]:
        """[m] of the gap through which gas leaks to that of the suction line."""
        if isinstance(self.mechanism, PistonEnd):
            return self.mechanism.sealed_diameter
        return self.bore

    def speed_at(self, angle: Float[Array, ""]) -> Float[Array, ""]:
        """[rad/s]"""
        if self.pace is None:
            return self.speed / (1 + 0 * angle)
        # excess is that of the time, so the speed has it in the denominator
        return self.speed / (1 + self.pace.at(angle))

    def volume(self, angle: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Volume [m^3] and its rate over the crank angle [m^3/rad]."""
        position, position_1, _ = self.mechanism.piston(angle)
        area = self.mechanism.piston_area
        clearance = self.cylinder.clearance_ratio * self.swept
        # a position counts towards the cover: while it grows, the volume shrinks
        return area * (self.top - position) + clearance, -area * position_1


def prepare(cylinder: Cylinder, mechanism, speed, pace: Pace | None = None) -> Case:
    """Work out the states of the lines and what else is constant.

    Args:
        cylinder: the gas side.
        mechanism: an `AbstractMechanism`.
        speed: [rad/s] mean speed of the crank.
        pace: how unevenly the revolution passes; constant speed if absent.
    """
    cylinder = cylinder.by_dew_points()
    if cylinder.suction.warming is not None:
        bound = (
            "absent for gas without its crank, whose losses warm it; `heating` is a constant rise"
        )
        raise BadInput("gas.suction.warming", "given", bound)
    suction, comes = cylinder.suction.states(cylinder.fluid)
    discharge, isentropic = cylinder.discharge.states(cylinder.fluid, suction)
    top, _ = mechanism.piston_extremes()
    return Case(
        cylinder,
        mechanism,
        jnp.asarray(speed, float),
        pace,
        suction,
        discharge,
        isentropic,
        comes,
        # with the ratio at which a flow out of them chokes, once for all angles
        (side_of(suction), side_of(discharge)),
        top,
        mechanism.swept_volume,
    )


def side_of(state: GasState | Side) -> Side:
    """A gas as one side of a port."""
    kappa = state.kappa
    return Side(state.p, state.rho, kappa, state.h, critical_ratio(kappa))
