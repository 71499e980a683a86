"""The registry of quantities: what a design is judged by, and how each is computed and shown.

Every command, study, table, picture and the completion of the shell take from here what they list.
The module imports no JAX, so that a key press in the shell need not wait, unless another package has
quantities (see `jaxcomp.parts`): a quantity reads attributes of the results of a design, where the
physics stands.
"""

import re
import sys
from collections.abc import Callable, Iterable, Mapping
from itertools import chain, product
from typing import Any, NamedTuple

from .errors import QuantityFailed
from .extensions import import_extensions

# Sections of a scene that a computed result needs, and sections in words.
_RESULTS = {
    "orbit": ("compressor",),
    "cycle": ("valves",),
    "vibration": ("rotor", "balancing"),
}
_WORDS = {
    "compressor": "a compressor",
    "rotor": "a rotor",
    "balancing": "balancing planes",
    "journals": "a journal with an oil film",
    "valves": "valves (gas of type cylinder)",
    "refrigerant": "a real gas that can be liquid behind the machine (with a condensing temperature)",
    "motor.losses": "a motor with losses",
    "gas.walls": "a cylinder with walls",
    "piping": "pipes ([gas.suction.piping] or [gas.discharge.piping])",
    "piping.runs": "runs of pipe or vessels ([[gas.suction.piping.runs]] or [[...vessels]])",
    "simple_cycle": "a gas of type polytropic, double_acting or staged",
    "gas.inlet_temperature": "a simple cycle with an inlet_temperature",
    "gas.stages": "a gas of type staged",
    "gas.later_stages": "a gas of type cylinder with later_stages",
}
# Sections of a machine file that a quantity may need as well.
_PARTS = ("rotor", "loads", "balancing", "suspension", "torsion")
# The words of `needs`.
NEEDS = tuple(dict.fromkeys((*_RESULTS, *_WORDS, *_PARTS)))
_FAMILY = re.compile(r"(.*\.)<(\w+)>")


class Quantity(NamedTuple):
    """A named quantity of a design.

    Attributes:
        name: as it is typed; "peak_force.<joint>" stands for one quantity for each joint.
        unit: SI unit, "" for a pure number.
        better: "more" or "less", the direction in which a design improves; "" where neither.
        doc: one sentence.
        value: from the results of a design (`jaxcomp.DesignResult`), in the SI unit; for a family all
            values by name.
        needs: results that `value` uses, "orbit" (the periodic state of the crank), "cycle" (that of
            the gas in a cylinder with valves) or "vibration" (the response of the rotor), and sections
            of a scene, as "compressor" or "rotor", a "refrigerant" or "motor.losses".
        percent: whether a pure number is shown in per cent.
        members: names of a family's members in a machine; found by tracing `value` if absent.
        words: its name in tables and pictures, where the name itself does not say it well.
    """

    name: str
    unit: str
    better: str
    doc: str
    value: Callable[[Any], Any]
    needs: tuple[str, ...] = ("orbit",)
    percent: bool = False
    members: Callable[[Any], list[str]] | None = None
    words: str = ""

    @property
    def family(self) -> str:
        """Part of the name in front of a member, as `peak_force`; "" for a single quantity."""
        match = _FAMILY.fullmatch(self.name)
        return match[1][:-1] if match else ""

    @property
    def sections(self) -> tuple[str, ...]:
        """Sections of a scene that this quantity needs."""
        sections = chain.from_iterable(_RESULTS.get(need, (need,)) for need in self.needs)
        return tuple(dict.fromkeys(sections))

    def missing(self, machine: Any) -> str:
        """Parts that this quantity needs and a machine has not, in words; "" if none.

        Args:
            machine: of the type `jaxcomp.Machine`.
        """
        compressor = machine.compressor
        gas = getattr(compressor, "gas", None)
        # By attributes and not by classes: this module must not import those, as they import JAX.
        has = {
            "compressor": compressor is not None,
            "valves": hasattr(gas, "suction_valve"),
            "refrigerant": getattr(gas, "refrigerates", False),
            "journals": _has_journals(compressor),
            "gas.walls": getattr(gas, "walls", None) is not None,
            "piping": bool(_pipings(gas)),
            "piping.runs": any(piping.shaken for piping in _pipings(gas)),
            "simple_cycle": getattr(gas, "kind", "") in _KINDS_OF_SIMPLE,
            "gas.inlet_temperature": _inlet(gas) is not None,
            "gas.stages": hasattr(gas, "stages"),
            "gas.later_stages": bool(getattr(gas, "later_stages", ())),
            "motor.losses": getattr(getattr(compressor, "motor", None), "losses", None) is not None,
        }
        for section in self.sections:
            # what is no attribute of the compressor is a section of the machine file
            if not has.get(section, section in machine.parts):
                return _WORDS.get(section, f"a section [{section}]")
        return ""


def _inlet(gas: Any) -> Any:
    """The inlet temperature of a simple cycle, of the head end of a double-acting one."""
    return getattr(getattr(gas, "head_end", gas), "inlet_temperature", None)


def _pipings(gas: Any) -> list[Any]:
    """Networks of pipes of a gas with valves."""
    networks = []
    for name in ("suction", "discharge"):
        piping = getattr(getattr(gas, name, None), "piping", None)
        if piping is not None:
            networks.append(piping)
    return networks


def _resonances(machine: Any) -> list[str]:
    """Names of the resonances of pipes that are quantities."""
    return machine.compressor.gas.resonance_names


def _between_stages(machine: Any) -> list[str]:
    """Stages that have another one behind them."""
    return [str(stage) for stage in range(1, max(machine.compressor.gas.stages))]


def _has_journals(compressor: Any) -> bool:
    """Whether a joint has an oil film that may give a position; the laws know which does."""
    friction = getattr(compressor, "friction", None)
    if friction is None:
        return False
    laws = list(vars(friction).values())
    for law in vars(friction).values():
        laws += getattr(law, "bearings", ())
    return any(getattr(law, "kind", "") in ("film", "bearing") for law in laws)


_CYCLE = ("orbit", "cycle")
_VALVES = ("suction", "discharge")
_STOPS = ("seat", "stop")
_SIMPLE = ("orbit", "compressor", "simple_cycle")
_KINDS_OF_SIMPLE = ("polytropic", "double_acting", "staged")
_JOURNALS = ("orbit", "compressor", "journals")
_BUILT_IN = (
    Quantity("mechanical_efficiency", "", "more", "Gas work over motor work.",
             lambda r: r.orbit.mechanical_efficiency, percent=True),
    Quantity("motor_power", "W", "less", "Mean power at the shaft.",
             lambda r: r.orbit.motor_power, words="Shaft power"),
    # Neither more nor less is better: it is what the machine is for.
    Quantity("gas_power", "W", "", "Indicated power: mean power that the piston gives to the gas.",
             lambda r: r.orbit.gas_power),
    Quantity("friction_power", "W", "less", "Mean friction power of all joints together.",
             lambda r: r.orbit.friction_power),
    Quantity("loss_power.<joint>", "W", "less", "Mean friction power of a joint.",
             lambda r: r.orbit.loss_power),
    Quantity("mean_speed", "rad/s", "", "Mean speed of the crank.", lambda r: r.orbit.mean_speed),
    Quantity("speed_fluctuation", "", "less", "Highest less lowest speed of the crank over the mean.",
             lambda r: r.orbit.speed_fluctuation, percent=True),
    Quantity("torque_fluctuation", "", "less",
             "Highest less lowest torque of gas, weights and friction on the crank over its mean.",
             lambda r: r.orbit.torque_fluctuation, percent=True),
    Quantity("peak_force.<joint>", "N", "less", "Largest force of a joint over the revolution.",
             lambda r: r.orbit.peak_forces),
    Quantity("mean_force.<joint>", "N", "less", "Magnitude of a joint's force, mean over crank angle.",
             lambda r: r.orbit.mean_forces),
    Quantity("joint_margin", "", "more", "Margin against self-locking: 1 without friction, locks at 0.",
             lambda r: r.orbit.margin),
    Quantity("swept_volume", "m^3", "",
             "Volume that a piston displaces in one stroke; of a double-acting one on both sides.",
             lambda r: r.assembly.compressor.swept_volume, ("compressor",)),
    Quantity("free_air", "m^3/s", "more", "Volume drawn by ideal valves, at the state of the inlet.",
             lambda r: r.delivered.free_air, _SIMPLE),
    Quantity("ideal_volumetric_efficiency", "", "more",
             "Volume drawn by ideal valves over the swept volume of the first stage.",
             lambda r: r.delivered.volumetric_efficiency, _SIMPLE, percent=True),
    Quantity("delivered_mass", "kg/s", "more", "Mass that ideal valves deliver.",
             lambda r: r.delivered.mass_flow, (*_SIMPLE, "gas.inlet_temperature")),
    Quantity("delivery_temperature", "K", "less", "Of the gas after polytropic compression.",
             lambda r: r.delivered.temperature, (*_SIMPLE, "gas.inlet_temperature")),
    # Names of members by the machine alone spare a trace of its solution.
    Quantity("stage_pressure.<stage>", "Pa", "", "Behind a stage, before the next one.",
             lambda r: r.delivered.stage_pressures, (*_SIMPLE, "gas.stages"),
             members=_between_stages),
    Quantity("interstage_pressure.<stage>", "Pa", "",
             "In the line behind the cooler of a stage, as the flows decide it.",
             lambda r: r.orbit.cycle.pressure_behind_stages, (*_CYCLE, "gas.later_stages"),
             members=_between_stages),
    Quantity("peak_shaking_force", "N", "less", "Largest shaking force over the revolution.",
             lambda r: r.peak_shaking_force, ("orbit", "compressor")),
    Quantity("peak_shaking_moment", "N m", "less", "Largest shaking moment over the revolution.",
             lambda r: r.peak_shaking_moment, ("orbit", "compressor")),
    Quantity("shaking_force.<order>", "N", "less",
             "Amplitude of the shaking force at an order of the revolution, along its long axis.",
             lambda r: r.shaking_force, ("orbit", "compressor")),
    Quantity("shaking_couple.<order>", "N m", "less",
             "Amplitude of the shaking moment across the shaft at an order, along its long axis.",
             lambda r: r.shaking_couple, ("orbit", "compressor")),
    # Of journals whose film gives a position; a law by a coefficient of friction has none.
    Quantity("film_thickness.<journal>", "m", "more", "Smallest oil film of a journal.",
             lambda r: {name: film.minimum_film for name, film in r.journals.items()}, _JOURNALS),
    Quantity("least_film", "m", "more", "Smallest oil film of all journals.",
             lambda r: r.least_film, _JOURNALS),
    Quantity("film_pressure.<journal>", "Pa", "less", "Largest pressure in a journal's film.",
             lambda r: {name: film.largest_pressure for name, film in r.journals.items()}, _JOURNALS),
    Quantity("film_flow.<journal>", "m^3/s", "", "Mean oil flow out of the ends of a journal's film.",
             lambda r: {name: film.mean_flow for name, film in r.journals.items()}, _JOURNALS),
    Quantity("film_temperature_rise.<journal>", "K", "less",
             "Of the oil that leaves a journal's film, if it carries the whole loss away.",
             lambda r: {name: film.temperature_rise for name, film in r.journals.items()}, _JOURNALS),
    Quantity("thin_film_share.<journal>", "", "less",
             "Share of the time with a film below `thin_film` of the bearing, or 5 µm.",
             lambda r: {name: film.thin_share for name, film in r.journals.items()}, _JOURNALS,
             percent=True),
    Quantity("steady_film_thickness.<journal>", "m", "more",
             "Smallest oil film of a journal if the load of every instant stood still.",
             lambda r: {name: film.steady_film for name, film in r.journals.items()}, _JOURNALS),
    Quantity("steady_film_loss.<journal>", "W", "less",
             "Loss of a journal if the load of every instant stood still.",
             lambda r: {name: film.steady_loss for name, film in r.journals.items()}, _JOURNALS),
    Quantity("squeeze_loss.<journal>", "W", "less", "Part of a journal's loss that pressure makes.",
             lambda r: {name: film.mean_squeeze_loss for name, film in r.journals.items()}, _JOURNALS),
    Quantity("contact_loss.<journal>", "W", "less",
             "Part of a journal's loss that surfaces in contact make.",
             lambda r: {name: film.mean_contact_loss for name, film in r.journals.items()}, _JOURNALS),
    Quantity("vibration", "m", "less",
             "Weighted root mean square amplitude of all targets, with the correction masses.",
             lambda r: r.vibration_of_all, ("vibration",)),
    Quantity("vibration.<target>", "m", "less", "Root mean square amplitude of a target.",
             lambda r: r.vibration_of_targets, ("vibration",),
             members=lambda machine: [t.name for t in machine.parts["balancing"].targets]),
    Quantity("balanced_vibration", "m", "less",
             "Vibration at order 1 after the least-squares correction of this design.",
             lambda r: r.balanced_vibration, ("rotor", "balancing")),
    Quantity("mount_force", "N", "less",
             "Root mean square, over the speeds, of the lateral force into the ground.",
             lambda r: r.mount_force, ("vibration",)),
    Quantity("mass_flow", "kg/s", "more", "Mass delivered.",
             lambda r: r.orbit.cycle.mass_flow, _CYCLE),
    Quantity("capacity", "W", "more",
             "Cooling capacity: mass flow times enthalpy from the liquid to the gas that comes.",
             lambda r: r.orbit.cycle.capacity, (*_CYCLE, "refrigerant")),
    Quantity("cop", "", "more",
             "Capacity over electric power; over shaft power where the motor has no losses.",
             lambda r: r.performance.cop, (*_CYCLE, "refrigerant", "compressor"), words="COP"),
    Quantity("electric_power", "W", "less", "Shaft power over the motor's efficiency.",
             lambda r: r.performance.electric_power, (*_CYCLE, "motor.losses", "compressor")),
    Quantity("motor_efficiency", "", "more", "Shaft power over electric power.",
             lambda r: r.performance.motor_efficiency, (*_CYCLE, "motor.losses", "compressor"),
             percent=True),
    Quantity("overall_efficiency", "", "more",
             "Isentropic power from the gas that comes, over electric (or shaft) power.",
             lambda r: r.performance.overall_efficiency, (*_CYCLE, "compressor"), percent=True),
    Quantity("volumetric_efficiency", "", "more",
             "Mass delivered over swept volume times density at the suction valve.",
             lambda r: r.orbit.cycle.volumetric_efficiency, _CYCLE, percent=True),
    Quantity("isentropic_efficiency", "", "more",
             "Isentropic work of the mass delivered over indicated work.",
             lambda r: r.orbit.cycle.isentropic_efficiency, _CYCLE, percent=True),
    Quantity("discharge_temperature", "K", "less", "Mean temperature of the gas delivered.",
             lambda r: r.orbit.cycle.discharge_temperature, _CYCLE),
    Quantity("wall_temperature", "K", "less", "Of the cylinder's wall, by its steady balance of heat.",
             lambda r: r.orbit.cycle.wall_temperature, (*_CYCLE, "gas.walls")),
    Quantity("peak_pressure", "Pa", "less", "Highest pressure in the cylinder.",
             lambda r: r.orbit.cycle.peak_pressure, _CYCLE),
    Quantity("impact_speed.<contact>", "m/s", "less",
             "Highest speed at which a valve meets its seat or stop.",
             lambda r: r.orbit.cycle.impact_speeds, _CYCLE,
             members=lambda machine: [f"{valve}_{end}" for valve, end in product(_VALVES, _STOPS)]),
    Quantity("closing_angle.<valve>", "rad", "",
             "Crank angle from the top dead centre at which a valve shuts for the last time.",
             lambda r: r.orbit.cycle.closing_angles, _CYCLE, members=lambda machine: [*_VALVES]),
    Quantity("power_use.<cause>", "W", "less",
             "What the electric (or shaft) power is spent on; the values add up to it.",
             lambda r: r.performance.power, (*_CYCLE, "compressor")),
    Quantity("heat_to.<place>", "W", "",
             "Heat that the electric (or shaft) power becomes; the values add up to it.",
             lambda r: r.performance.heat, (*_CYCLE, "compressor")),
    Quantity("pulsation.<place>", "Pa", "less",
             "Peak to peak, mean and orders of the pressure at a node of pipes, beyond its line.",
             lambda r: r.orbit.cycle.pulsation.pressures, (*_CYCLE, "piping")),
    Quantity("pulsation_margin", "", "more",
             "Least of the limits of API 618 over the pulsation that it limits.",
             lambda r: r.orbit.cycle.pulsation.margin, (*_CYCLE, "piping")),
    Quantity("pressure_drop.<flange>", "Pa", "less",
             "Mean loss of pressure in the pipes between a flange and its line.",
             lambda r: r.orbit.cycle.pulsation.mean_drops, (*_CYCLE, "piping")),
    Quantity("shaking.<run>", "N", "less",
             "Amplitude of the force along a straight run of pipe or a vessel, by order.",
             lambda r: r.orbit.cycle.pulsation.shaking_forces, (*_CYCLE, "piping.runs")),
    # Without the cycle: with shut flanges the pipes have natural frequencies of their own.
    Quantity("resonance.<number>", "Hz", "",
             "Natural frequency of the pipes, flanges shut: the lowest of a line, from 1.",
             lambda r: {f"{name}.frequency": of.frequency for name, of in r.resonances.items()},
             ("compressor", "valves", "piping"),
             members=lambda machine: [f"{name}.frequency" for name in _resonances(machine)]),
    Quantity("resonance_quality.<number>", "", "less",
             "Q of such a resonance: its frequency over the width of its peak.",
             lambda r: {name: of.quality for name, of in r.resonances.items()},
             ("compressor", "valves", "piping"), members=_resonances),
    Quantity("volume_use.<cause>", "", "less",
             "What the swept volume is used for, delivered or lost; the values add up to 1.",
             lambda r: {k.replace(" ", "_"): v for k, v in r.orbit.cycle.volume_losses.items()},
             _CYCLE, percent=True),
)  # fmt: skip
# Quantities that stand before the others, as far as a machine has them.
HEADLINES = (
    "cop", "capacity", "electric_power", "overall_efficiency", "mechanical_efficiency", "motor_power",
    "least_film", "vibration",
)  # fmt: skip
_registered: dict[str, Quantity] = {quantity.name: quantity for quantity in _BUILT_IN}

# Design variables that change a machine as a whole, with what they keep; see `jaxcomp.design_rules`.
DESIGN_RULES = {
    "bore_at_displacement": "Piston diameter at fixed displacement and crank ratio (Tsuji et al. 2012).",
    "stroke_bore_ratio": "Twice the crank radius over the bore, at fixed displacement.",
    "offset": "Cylinder axis at y = offset from the crank axis.",
    "piston_clearance": "Radial clearance of the piston's oil film (no leakage).",
    "similar_swept_volume": "Swept volume of a similar machine: lengths, areas, masses follow.",
}


def registered() -> tuple[Quantity, ...]:
    """All quantities, families as one, with those of other packages.

    Raises:
        ExtensionError: a module of another package that cannot be imported.
    """
    import_extensions()
    return tuple(_registered.values())


def registered_quantity(name: str) -> Quantity | None:
    """A quantity by its name, of a family by that of a member; `None` if there is none."""
    import_extensions()
    if name in _registered:
        return _registered[name]
    # a member is found by its family; whether the machine has it shows with the values
    family, _, member = name.partition(".")
    if not member:
        return None
    for quantity in registered():
        if quantity.family == family:
            return quantity._replace(name=name, value=_Member(quantity, member))
    return None


class _Member(NamedTuple):
    """One value of a family."""

    quantity: Quantity
    member: str

    def __call__(self, result: Any) -> Any:
        values = self.quantity.value(result)
        if self.member not in values:
            from .errors import BadInput
            from .words import one_of

            raise BadInput(self.quantity.family, self.member, one_of(self.member, values))
        return values[self.member]


class _ExternalFunction:
    """The function of a quantity that another package or a script registers.

    Args:
        name: of the quantity.
        function: from the results of a design.
    """

    def __init__(self, name: str, function: Callable[[Any], Any]):
        self.name = name
        self.function = function

    def __call__(self, result: Any) -> Any:
        from .errors import BadInput
        from .status import SolveFailed

        try:
            value = self.function(result)
        except (BadInput, SolveFailed):  # of the machine
            raise
        except Exception as error:
            # the first line alone: messages of JAX go on for pages
            first, *_ = str(error).strip().splitlines() or [""]
            raise QuantityFailed(
                self.name, self.place, f"{type(error).__name__}: {first}"
            ) from error
        members = [value]
        if "<" in self.name:
            if not isinstance(value, Mapping):
                kind = f"a {type(value).__name__} comes back where numbers by name are wanted"
                raise QuantityFailed(self.name, self.place, kind)
            members = [*value.values()]
        for member in members:
            if problem := _no_number(member):
                raise QuantityFailed(self.name, self.place, problem)
        return value

    @property
    def place(self) -> str:
        """The module that it comes from, in words."""
        module = getattr(self.function, "__module__", None) or "__main__"
        if module == "__main__":
            return "this script"
        return f"package {module.partition('.')[0]} (module {module})"


def _no_number(value: Any) -> str:
    """Reason why a value is not one real number, in words; "" if it is one."""
    if isinstance(value, bool | int | float):
        return ""
    # no number is looked at, so that traced values pass the check as well
    shape = getattr(value, "shape", None)
    kind = getattr(getattr(value, "dtype", None), "kind", "")
    if shape is None or kind not in "biuf":
        return f"a {type(value).__name__} comes back where a number is wanted"
    if shape:
        return f"an array of shape {shape} comes back where a number is wanted"
    return ""


def is_external(quantity: Quantity) -> bool:
    """Whether another package or a script registered a quantity."""
    return isinstance(quantity.value, _ExternalFunction)


_reported: set[str] = set()


def offered_values(quantities: Iterable[Quantity], result: Any) -> dict[str, Any]:
    """The values of quantities by name, for whoever asked for none of them in particular.

    A quantity of another package that fails is left out, with one line a process on standard error.

    Args:
        quantities: that suit the machine.
        result: of the design.
    """
    values = {}
    for quantity in quantities:
        try:
            values[quantity.name] = quantity.value(result)
        except Exception as error:
            if not is_external(quantity):
                raise
            _tell_left_out(quantity, error)
    return values


def _tell_left_out(quantity: Quantity, error: Exception) -> None:
    from .progress import tell

    if quantity.name not in _reported:
        _reported.add(quantity.name)
        why = str(error)
        if not isinstance(error, QuantityFailed):
            why = f"Quantity '{quantity.name}': {error}"
        tell(f"{why} It is left out; `needs` of register_quantity says which machines have it.")


def register_quantity(
    name: str,
    value: Callable[[Any], Any],
    *,
    unit: str = "",
    better: str = "",
    doc: str = "",
    needs: tuple[str, ...] = ("orbit",),
    percent: bool = False,
) -> Quantity:
    """Add a quantity, which studies, commands, tables and pictures then know by its name.

    A name of one's own may be given anew; compiled programs are dropped then.

    Args:
        name: letters, digits and underscores; with ".<joint>" or the like behind it, `value` returns
            a dictionary with a value for each joint.
        value: from the results of a design; of JAX operations, for derivatives.
        unit: SI unit, "" for a pure number.
        better: "more", "less" or "".
        doc: one sentence.
        needs: see `Quantity`: "orbit", "cycle", "vibration", "compressor", "valves", "refrigerant",
            "journals", "gas.walls", "motor.losses", or a section such as "rotor".
        percent: whether a pure number is shown in per cent.

    Raises:
        BadInput: a name that is built in or cannot be typed, or another word for `better` or in `needs`.

    Example::

        register_quantity("specific_loss", lambda r: r.orbit.friction_power / r.orbit.gas_power,
                          better="less", doc="Friction power over indicated power.", percent=True)
    """
    from .errors import BadInput

    if any(quantity.name == name for quantity in _BUILT_IN):
        raise BadInput("name", name, "another one: this quantity is built in")
    if not re.fullmatch(r"[A-Za-z]\w*(\.<\w+>)?", name):
        raise BadInput("name", name, "letters, digits and underscores, with .<joint> for a family")
    if better not in ("more", "less", ""):
        raise BadInput("better", better, '"more", "less" or ""')
    if percent and unit:
        raise BadInput("percent", unit, "left out, for a quantity with a unit")
    if not callable(value):
        form = "a function of the results, such as lambda r: r.orbit.mean_speed"
        raise BadInput("value", str(value), form)
    # a single word, which as a tuple would become its letters
    needs = (needs,) if isinstance(needs, str) else tuple(needs)
    for word in needs:
        if word not in NEEDS:
            from .words import one_of

            raise BadInput("needs", str(word), one_of(str(word), NEEDS))
    if name in _registered and "jax" in sys.modules:
        sys.modules["jax"].clear_caches()  # programs with what the name meant before
    _registered[name] = Quantity(
        name, unit, better, doc, _ExternalFunction(name, value), needs, percent
    )
    # the new function may fail as well, which is told again
    _reported.discard(name)
    return _registered[name]
