"""Keys and types of scene files of version 0.1 that are spelt otherwise now."""

from typing import Any

_BEARING = '"bearing", the name of a bearing that a section [bearings.NAME] describes'
_KEYS: dict[tuple[str, str], str] = {
    ("SliderLink", "eccentricity"): '"offset", with the opposite sign, as for the slider_crank',
    ("SliderCrankFriction", "wall_film"): '"piston_film"',
    ("PistonFilm", "viscosity"): '"dynamic_viscosity"',
    ("PistonFilm", "clearance"): '"radial_clearance"',
    ("JournalBearing", "radius"): '"diameter"',
    (
        "CrankNodes",
        "bearings",
    ): "found by itself: every link of type film takes part in the statics",
    ("RotorModel", "side_pulls"): '"magnetic_pulls"',
    ("CrankNodes", "bearing_share"): "found by itself, by the statics of the shaft",
} | {
    ("LoadedFilm", key): _BEARING
    for key in ("diameter", "length", "radial_clearance", "dynamic_viscosity", "ring")
}
_TYPES = {
    "petroff": 'type = "film" with film = "petroff"',
    "loaded_petroff": 'type = "film" with film = "loaded_petroff"',
    "overhung": 'type = "main_bearings" with bearings = ["...", "..."] and their position',
    "grooved_film": 'type = "film" with the name of a bearing of film = "grooved"',
}


def renamed_key(part: type, key: str) -> str:
    """What an old key of a part is called now, "" if it never was one."""
    return _KEYS.get((part.__name__, key), "")


def renamed_type(word: Any) -> str:
    """What an old type is called now, "" if it never was one."""
    return _TYPES.get(word, "") if isinstance(word, str) else ""
