"""What follows from the entries of a machine file: sizes, ratios, natural frequencies, freedoms."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from .._core.display import RPM, ZERO_CELSIUS, axes_words
from .._core.each import AbstractEach, listed, of_cylinder
from .._core.fields import subparts
from ..compressor import Compressor
from ..cylinder import Cylinder
from ..fluid import AbstractRealGas, GasState, Mixture
from ..fluid._real import has_dew_line
from ..gas import PolytropicCycle
from ..machine import machine_of
from ..rotor import AXES, RotorModel, undamped_modes
from ..rotor._model import subset_names, subsets
from ..rotor._nodes import node_names
from ..study import design_rules
from ..study._variables import variable_names
from ..vibration import Suspension
from ._scene import Scene
from ._text import cut


def follows(scene: Scene) -> Iterator[tuple[str, Any, str]]:
    """(name, value, unit) of what follows from the entries of a machine file, in shown units.

    Args:
        scene: of `jaxcomp.load`.
    """
    names = variable_names(machine_of(scene))
    rules = [name for name in names if name in design_rules]
    note = ""
    if rules:
        note = f"by rule: {', '.join(rules)}"
    yield "Variables for optimise and sweep", len(names), note
    if scene.compressor is not None:
        written = machine_of(scene).compressor
        assert written is not None
        yield from _of_compressor(scene.compressor, written.gas)
    model = scene.parts.get("rotor")
    if isinstance(model, RotorModel):
        yield from _of_rotor(model)
    block = scene.parts.get("suspension")
    if isinstance(block, Suspension):
        hertz = undamped_modes(block.rotor, 6).frequency / (2 * math.pi)
        text = ", ".join(f"{f:.3g}" for f in hertz)
        yield "Block on its springs, 6 degrees of freedom", text, "Hz"


def _of_compressor(compressor: Compressor, gas_as_written: Any):
    """Sizes and ratios of the first cylinder, and speeds of the crank.

    Args:
        compressor: as it was put together, by dew points.
        gas_as_written: its gas side as the file has it.
    """
    mechanism: Any = of_cylinder(compressor.mechanism)
    gas = of_cylinder(compressor.gas)
    yield "Stroke", 1e3 * float(mechanism.stroke), "mm"
    yield "Swept volume", 1e6 * float(compressor.swept_volume), "cm3"
    if compressor.crankshaft.count > 1:
        yield from _of_cylinders(compressor)
    bore = getattr(mechanism, "bore", None)
    if bore is not None:
        yield "Stroke over bore", float(mechanism.stroke / bore), ""
    ratio = getattr(mechanism, "conrod_ratio", None)
    if ratio is not None:
        yield "Crank radius over rod length", float(ratio), ""
    if isinstance(gas, PolytropicCycle):
        yield "Pressure ratio", float(gas.discharge_pressure / gas.suction_pressure), ""
    # nothing is solved here: the speed is where a solver would begin
    speed = float(compressor.motor.speed_guess)
    if isinstance(gas, Cylinder):
        yield from gas_follows(of_cylinder(gas_as_written))
        yield from _of_valves(gas, speed)
    yield "Speed, about", speed * RPM, "rpm"
    yield "Mean piston speed, about", float(mechanism.stroke) * speed / math.pi, "m/s"
    yield "Degrees of freedom of the crank", 1, ""


def _of_rotor(model: RotorModel):
    """Numbers of nodes and of degrees of freedom, and the nodes of each subset."""
    count = len(node_names(model))
    slaved = sum(len(body.nodes) for body in model.bodies)
    yield "Nodes of the rotor model", count, f"{slaved} of them fixed to rigid bodies"
    held = 0
    for link in model.links:
        if link.held:  # axes that the model does not have hold nothing
            held += sum(axis in AXES[model.dof] for axis in link.axes)
    reduction = ""
    if held:
        reduction = f", less {held} of pinned and clamped links"
    free = (count - slaved) * model.dof - held
    yield "Degrees of freedom", free, f"{model.dof} a free node{reduction}"
    for name, group in zip(subset_names(model), subsets(model), strict=True):
        nodes = ", ".join(map(str, group))
        yield f"Subset {name}", cut(nodes, 60), "nodes"


def _of_cylinders(compressor: Compressor):
    """Quantities that follow from how cylinders stand about the crankshaft."""
    crankshaft = compressor.crankshaft
    intervals = np.rad2deg(np.asarray(crankshaft.firing_intervals))
    even = np.ptp(intervals) < 0.01
    if even:
        intervals = intervals[:1]
    shown = ", ".join(f"{interval:.4g}" for interval in intervals)
    differing = list(listed((compressor.mechanism, compressor.gas)))
    for section, tree in (("gas", compressor.gas), ("friction", compressor.friction)):
        for path, part in subparts(tree):
            if isinstance(part, AbstractEach):
                differing.append(f"the kind of {section}.{path}".rstrip("."))
    note = ""
    if differing:
        note = f"different in {', '.join(differing)}"
    yield "Cylinders", crankshaft.count, note
    yield "Axes", axes_words(crankshaft.bank_angle), ""
    gas = getattr(compressor.gas, "head_end", compressor.gas)
    suction = np.unique(np.atleast_1d(getattr(gas, "suction_pressure", 0.0)))
    if suction.size > 1:
        between = ", ".join(f"{1e-5 * p:.5g}" for p in suction[1:])
        yield "Pressure between stages", f"{between} bar", ""
    spacing = "even" if even else "uneven"
    yield "Between top dead centres", f"{shown} deg", spacing
    places = getattr(crankshaft.main_journal, "position", None)
    if places is not None:
        rods = np.asarray(crankshaft.position)
        outside = int(np.sum((rods < np.min(places)) | (rods > np.max(places))))
        note = "overhung" if outside else ""
        yield "Rods outside the main bearings", outside, note


def gas_follows(gas: Cylinder) -> Iterator[tuple[str, Any, str]]:
    """(name, value, unit) of the gas between the lines of a cylinder, in shown units.

    Composition and kind of the temperatures of a mixture, pressure ratio, compressibility, head, glide.

    Args:
        gas: cylinder with valves.
    """
    fluid = gas.fluid
    if isinstance(fluid, Mixture):
        shares = []
        fractions = np.asarray(fluid.mass_fractions)
        for name, fraction in zip(fluid.components or (), fractions, strict=True):
            shares.append(f"{name} {100 * fraction:.4g} %")
        yield "Composition by mass", ", ".join(shares), fluid.name
    if has_dew_line(fluid) and fluid.has_glide:
        words = {"dew": "of dew points", "mean": "means of the heat exchangers"}[gas.reference]
        yield "Evaporating and condensing temperatures", words, ""
    gas = gas.by_dew_points()
    suction = gas.suction.state(fluid)
    behind = gas.discharge.states(fluid, suction)[0]
    yield "Pressure ratio", float(behind.p / suction.p), ""
    yield from _of_compression(gas, suction)
    if has_dew_line(fluid) and fluid.has_glide:
        yield from _of_glide(fluid, float(suction.p), float(behind.p))


def _of_compression(gas: Cylinder, suction: GasState):
    """Compressibility at both ends of the isentropic compression between the lines, and its work."""
    _, isentropic = gas.discharge.states(gas.fluid, suction)
    for name, state in (("suction valve", suction), ("end of isentropic compression", isentropic)):
        perfect = state.rho * gas.fluid.specific_gas_constant * state.T
        yield f"Compressibility at the {name}", float(state.p / perfect), ""
    head = 1e-3 * float(isentropic.h - suction.h)
    yield "Isentropic head", head, "kJ/kg, from the suction valve to the discharge pressure"


def _of_glide(fluid: AbstractRealGas, low: float, high: float):
    """Glide of a blend at the pressures [Pa] of the lines, as far as it condenses there."""
    for name, pressure in (("suction", low), ("discharge", high)):
        if pressure < float(fluid.critical_pressure):
            dew = float(fluid.dew_temperature(pressure))
            bubble = float(fluid.bubble_temperature(pressure))
            note = f"K, dew {dew - ZERO_CELSIUS:.4g}, bubble {bubble - ZERO_CELSIUS:.4g} degC"
            yield f"Glide at {name} pressure", dew - bubble, note


def _of_valves(gas: Cylinder, speed: float):
    """Quantities that follow from the lines and valves of a cylinder, and what it leaves out."""
    suction = gas.suction.state(gas.fluid)
    behind = gas.discharge.states(gas.fluid, suction)[0]
    for name, valve in zip(("suction", "discharge"), gas.valves, strict=True):
        if valve.oscillator is not None:
            natural_frequency = math.sqrt(float(valve.oscillator.stiffness / valve.oscillator.mass))
            note = f"{natural_frequency / speed:.3g} times the crank's speed"
            yield (
                f"Natural frequency of the {name} valve",
                natural_frequency / (2 * math.pi),
                f"Hz, {note}",
            )
    lines = ("suction", suction, gas.suction.plenums), ("discharge", behind, gas.discharge.plenums)
    for name, state, plenums in lines:
        for number, plenum in enumerate(plenums, 1):
            stiffness = plenum.neck_area / (plenum.volume * plenum.neck_length)
            natural_frequency = float(state.speed_of_sound) * math.sqrt(float(stiffness))
            note = f"Hz, {natural_frequency / speed:.3g} times the crank's speed"
            yield f"Resonance of {name} plenum {number}", natural_frequency / (2 * math.pi), note
    if gas.walls is not None:
        total = float(gas.walls.conductance)
        yield "Conductance of the wall", total, "W/K in all; its temperature is an unknown"
    if not gas.inert:
        yield "Flow through the ports", "quasi-steady", "values only: derivatives need port_length"
    networks = [getattr(line, "piping", None) for line in (gas.suction, gas.discharge)]
    pulsation = "pulsation in the lines beyond their plenums"
    if any(networks):
        pulsation = "waves that are not small, mean flow that carries them"
    yield "Not modelled", f"stratified gas, {pulsation}", "oil in the gas, wet compression"
