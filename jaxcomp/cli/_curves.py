"""The curves of a periodic state over the crank angle, as `curves.csv` has them."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import jax
import numpy as np

import jaxcomp as jc

from .._core.each import of_cylinder
from ..cylinder._several import SeveralCycles

_TURN = 2 * np.pi
# Words behind the names of the columns of a head end and of a crank end.
_OF_SIDE = ("", ".crank_end")
# Columns of a cycle that are not those of the orbit, by the name that they have beside those.
_OF_GAS = {
    "volume [m^3]": "volume{} [m^3]",
    "temperature [K]": "gas_temperature{} [K]",
    "mass [kg]": "gas_mass{} [kg]",
}


def curves(state: jc.study.SteadyState, step: float | None = None) -> dict[str, Any]:
    """The columns of a periodic state with the crank angle in degrees in front.

    Args:
        state: the periodic state.
        step: [deg] of an even grid from -180 to 180; at the nodes of the solver if absent.
    """
    columns = state.columns()
    nodes = np.asarray(columns.pop("crank_angle [rad]"))
    angle = nodes
    if step is not None:
        count = round(360 / step)
        angle = np.deg2rad(np.linspace(-180.0, 180.0, count + 1))
        columns = _on_grid(state, columns, nodes, angle)
    columns |= _of_gas(state, angle)
    degrees = np.rad2deg(angle)
    if step is not None:
        degrees = np.round(degrees, 9)
        # both ends are one place, which may be a kink of which each would see another side
        for name, values in columns.items():
            if name != "time [s]":
                columns[name] = np.append(values[:-1], values[0])
    named = {"crank_angle [deg]": degrees, "crank_angle [rad]": angle}
    for name, values in columns.items():
        if name.startswith("eccentricity."):
            name = f"{name} []"
        named[name] = values
    return named


def _on_grid(
    state: jc.study.SteadyState, columns: dict[str, Any], nodes: np.ndarray, angle: np.ndarray
) -> dict[str, Any]:
    """Columns at other angles: what the laws of the machine give there, the rest from node to node."""
    from ..plot._fine import fine_turn

    orbit = state.orbit
    turn = fine_turn(state.compressor, orbit, angle)
    laws = {
        "speed [rad/s]": turn.state.speed,
        "acceleration [rad/s^2]": turn.state.acceleration,
        "motor_torque [N m]": turn.motor_torque,
        "gas_torque [N m]": turn.gas_torque,
    }
    for name, torque in turn.loads.loss_torque.items():
        laws[f"friction_torque.{name} [N m]"] = torque
    for name, force in turn.loads.forces.items():
        laws[f"joint_force.{name}.x [N]"] = force[0]
        laws[f"joint_force.{name}.y [N]"] = force[1]
        laws[f"joint_force.{name} [N]"] = np.hypot(*force)
    if turn.pressure is not None:
        for number, pressure in enumerate(turn.pressure, 1):
            suffix = f".{number}" if len(turn.pressure) > 1 else ""
            laws[f"pressure{suffix} [Pa]"] = pressure
    period = float(orbit.period)
    out = {}
    for name, values in columns.items():
        if name in laws:
            out[name] = np.asarray(laws[name])
        elif name == "time [s]":
            late = np.interp(angle, nodes, values - period * nodes / _TURN, period=_TURN)
            time = late + period * angle / _TURN
            out[name] = time - time[0]
        else:
            out[name] = np.interp(angle, nodes, values, period=_TURN)
    return out


def _of_gas(state: jc.study.SteadyState, angle: np.ndarray) -> dict[str, Any]:
    """Volume of every cylinder; with valves their lift and flow, temperature and mass of the gas too."""
    compressor = state.compressor
    cycle = state.orbit.cycle
    if compressor.gas is None:
        return {}
    out = {}
    phases = np.asarray(compressor.crankshaft.phase)
    for number, phase in enumerate(phases):
        suffix = f".{number + 1}" if len(phases) > 1 else ""
        cylinder_angle = angle + phase
        if cycle is None:
            mechanism = of_cylinder(compressor.mechanism, number + 1)
            top = mechanism.piston_extremes()[0]
            stroke = top - mechanism.piston(cylinder_angle)[0]
            out[f"displaced_volume{suffix} [m^3]"] = np.asarray(mechanism.piston_area * stroke)
            continue
        if not isinstance(cycle, SeveralCycles):
            out |= _of_cycle(cycle, cylinder_angle, suffix)
            continue
        for side in range(cycle.sides):
            end: Any = jax.tree.map(itemgetter(cycle.sides * number + side), cycle.each)
            # The crank end counts its own angle from half a revolution later.
            out |= _of_cycle(end, cylinder_angle + side * np.pi, _OF_SIDE[side] + suffix)
    return out


def _of_cycle(cycle: Any, angle: np.ndarray, suffix: str) -> dict[str, Any]:
    """Volume, temperature and mass of the gas, lifts and flows of a cycle at its own crank angles."""
    out = {}
    at = np.asarray(cycle.angle)
    for name, values in cycle.columns().items():
        shown = _OF_GAS.get(name)
        if name.startswith(("lift.", "flow.", "plenum_pressure.")):
            head, bracket, unit = name.partition(" [")
            shown = f"{head}{{}}{bracket}{unit}"
        if shown is not None:
            out[shown.format(suffix)] = np.interp(angle, at, values, period=_TURN)
    return out
