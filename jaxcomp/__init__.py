"""Reciprocating compressors in JAX: from geometry to efficiency and to vibration.

Importing the package turns on JAX's 64-bit mode at once, because the balances it solves lose too many
digits in single precision. Set the environment variable `JAXCOMP_X64=0` before the import to leave
JAX's setting alone. Where JAX is not imported yet, the import sets `JAX_ENABLE_X64=1` in the
environment, which programs started from here inherit.

The public names are listed below by the room they live in. A room is imported when a name of it is
first used, so that the command line can answer a question without starting JAX.
"""

import os
import sys
from importlib import import_module

if os.environ.get("JAXCOMP_X64", "1") != "0":
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_enable_x64", True)
    else:  # without the second that importing JAX takes
        os.environ["JAX_ENABLE_X64"] = "1"

_ROOMS = {
    "_fields": ("BadInput",),
    "_status": ("SolveFailed", "Status"),
    "compressor": ("Compressor",),
    "crank": (
        "Collocation",
        "Energy",
        "Orbit",
        "Shooting",
        "TimeIntegration",
        "Transient",
        "simulate",
        "solve_orbit",
    ),
    "design": ("design_rules", "optimise", "pareto", "problem", "with_bore"),
    "friction": (
        "CoulombJournal",
        "CoulombSlide",
        "FilmJournal",
        "LoadedPetroffJournal",
        "OilPump",
        "PetroffJournal",
        "PistonFilm",
        "RegularisedJournal",
        "RegularisedSlide",
        "SliderCrankFriction",
        "SliderLinkFriction",
        "ThrustBearing",
    ),
    "gas": (
        "CallableDiagram",
        "CrankAngleTable",
        "FourierDiagram",
        "PolytropicCycle",
        "VolumeTable",
    ),
    "mechanism": ("CrankState", "SliderCrank", "SliderLink"),
    "motor": ("ConstantSpeed", "ConstantTorque", "Kloss", "MeanSpeed", "SlipLine"),
    "film": ("JournalBearing",),
    "rotor": ("RotorModel", "crank_forces", "damped_modes", "respond", "undamped_modes"),
    "scene": ("Scene", "SceneError", "describe", "dump", "load", "machines"),
    "sweeping": ("open_sweep", "sweep"),
    "work_precision": ("accuracy",),
    "tolerancing": ("robust", "tolerance", "within"),
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = sorted(_HOME)


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'jaxcomp' has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
