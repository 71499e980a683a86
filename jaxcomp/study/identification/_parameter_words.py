"""Names of identified constants in words of compressor engineers."""

import re

_WORDS = {
    "similar_swept_volume": "swept volume",
    "gas.clearance_ratio": "clearance",
    "gas.leakage.gap": "leakage gap",
    "gas.suction.heating": "suction heating",
    "gas.suction.warming.loss_share": "warming by losses",
    "gas.suction.warming.discharge_conductance": "warming by the discharge side",
    "gas.wall_temperature": "wall temperature",
    "motor.losses.efficiency": "motor efficiency",
    "motor.losses.fixed_power": "fixed power",
    "friction.*.coefficient": "friction",
}
_OF_VALVE = re.compile(r"gas\.(suction|discharge|\*)_valve\.(\w+)")


def in_words(path: str) -> str:
    """Name of a constant; its path where that says more than any word, as of one of many joints."""
    of_valve = _OF_VALVE.fullmatch(path)
    if of_valve is None:
        return _WORDS.get(path, path)
    side, entry = of_valve.groups()
    valve = "both valves" if side == "*" else f"the {side} valve"
    return f"{entry.replace('_', ' ')} of {valve}"


def with_path(path: str) -> str:
    """Words with the path behind them, by which the constant is varied or fixed."""
    words = in_words(path)
    return path if words == path else f"{words} ({path})"
