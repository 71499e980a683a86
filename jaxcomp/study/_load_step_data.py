"""Numbers of a load step: what it delivers, and what it costs rods and crank."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._core.declared import Record, reading, word
from ._api_618 import ProcessSheet, ThrowData


@dataclasses.dataclass(frozen=True)
class LoadStepData(Record):
    """Flow, power, torque, rod loads and temperatures at a load step.

    Rod loads are the largest of all rods, gas and inertia together; reversals the least. What a machine
    without connecting rods has none of is NaN.

    Attributes:
        name: of the step.
        mass_flow: [kg/s]
        flow_share: [-] of the flow at full load.
        gas_power, shaft_power: [W]
        mean_torque: [N m] of the motor.
        torque_fluctuation: [-]
        rod_compression, rod_tension: [N]
        reversal_angle: [rad]
        reversal_share: [-]
        discharge_temperature: [K] of the hottest end that delivers.
        stage_pressures: [Pa] behind each stage but the last, by its number.
    """

    name: str = word()
    mass_flow: float = reading("kg/s")
    flow_share: float = reading("")
    gas_power: float = reading("W")
    shaft_power: float = reading("W")
    mean_torque: float = reading("N m")
    torque_fluctuation: float = reading("")
    rod_compression: float = reading("N")
    rod_tension: float = reading("N")
    reversal_angle: float = reading("rad")
    reversal_share: float = reading("")
    discharge_temperature: float = reading("K")
    stage_pressures: dict[str, float] = reading("Pa")


def _of_throws(throws: Sequence[ThrowData], name: str) -> list[float]:
    return [getattr(throw, name) for throw in throws]


def load_step_data(
    name: str, quantities: dict[str, Any], sheet: ProcessSheet | None, full: float
) -> LoadStepData:
    """Numbers of a load step.

    Args:
        name: of the step.
        quantities: [SI] of its periodic state, by name.
        sheet: of its periodic state.
        full: [kg/s] flow at full load.
    """
    throws = ()
    ends = ()
    if sheet is not None:
        throws = sheet.throws
        ends = sheet.ends
    # An end whose valves are held open has no discharge, and so no temperature of it.
    warm = []
    for end in ends:
        if end.volumetric_efficiency > 1e-6:
            warm.append(end.discharge_temperature)
    flow = float(quantities["mass_flow"])
    return LoadStepData(
        name=name,
        mass_flow=flow,
        flow_share=flow / full,
        gas_power=float(quantities["gas_power"]),
        shaft_power=float(quantities["motor_power"]),
        mean_torque=float(quantities["motor_power"]) / float(quantities["mean_speed"]),
        torque_fluctuation=float(quantities["torque_fluctuation"]),
        rod_compression=max(_of_throws(throws, "combined_compression"), default=np.nan),
        rod_tension=max(_of_throws(throws, "combined_tension"), default=np.nan),
        reversal_angle=min(_of_throws(throws, "reversal_angle"), default=np.nan),
        reversal_share=min(_of_throws(throws, "reversal_share"), default=np.nan),
        discharge_temperature=max(warm, default=np.nan),
        stage_pressures=dict(quantities.get("interstage_pressure", {})),
    )
