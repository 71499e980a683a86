"""The result of `jaxcomp bearing` as tables."""

import math
from typing import Any

from rich.table import Table

from ._tables import _table


def bearing_tables(result: dict[str, Any]) -> list[Table]:
    """Position and friction, then stiffness and damping; what a model does not give is left out."""
    tables = [_state(result)]
    if result["stiffness"] is not None:
        tables.append(_coefficients(result))
    return tables


def _state(result: dict[str, Any]) -> Table:
    size = f"{result['length'] * 1e3:.4g} x {result['diameter'] * 1e3:.4g} mm"
    title = f"Journal bearing {size}, L/D = {result['length_ratio']:.4g}, {result['model']}"
    table = _table(title, "Running state", "", "")
    rows = [
        ("Viscosity", result["viscosity"] * 1e3, "mPa s", "in the film"),
        ("Speed", result["speed"] * 30 / math.pi, "rpm", f"{result['speed']:.5g} rad/s"),
        ("Load", result["load"], "N", ""),
        ("Eccentricity ratio", result["eccentricity_ratio"], "", "e/c"),
        ("Attitude angle", _scaled(result["attitude_angle"], 180 / math.pi), "°", "load to e_r"),
        ("Load number Phi_p", result["phi_p"], "", "W psi^2/(eta omega L D), rad/s"),
        ("Sommerfeld number S", result["sommerfeld_number"], "", "1/(2 pi Phi_p), rev/s"),
        ("Friction number Phi_T", result["phi_t"], "", "pi at no load"),
        ("Friction torque", result["friction_torque"], "N m", f"{result['friction_power']:.5g} W"),
        ("Minimum film", _scaled(result["minimum_film"], 1e6), "µm", "compare with the roughness"),
        ("Peak pressure", _scaled(result["peak_pressure"], 1e-6), "MPa", ""),
        ("Side flow", _scaled(result["side_flow"], 6e7), "cm3/min", "out of both ends"),
        ("Largest stable mass", result["critical_mass"], "kg", "rigid rotor, of one bearing"),
    ]
    for name, value, unit, remark in rows:
        if value is not None:
            table.add_row(name, f"{value:.5g} {unit}".strip(), remark)
    return table


def _coefficients(result: dict[str, Any]) -> Table:
    title = "Stiffness and damping: x along the load, y 90 degrees ahead with rotation"
    table = _table(title, "", "xx", "xy", "yx", "yy", numbers=True)
    for name, key in (
        ("K, N/m", "stiffness"),
        ("C, N s/m", "damping"),
        ("c K/W", "dimensionless_stiffness"),
        ("c omega C/W", "dimensionless_damping"),
    ):
        if result[key] is not None:
            table.add_row(name, *(f"{entry:.4g}" for row in result[key] for entry in row))
    return table


def _scaled(value: float | None, scale: float) -> float | None:
    return None if value is None else value * scale
