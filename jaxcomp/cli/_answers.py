"""Classes of the results that commands print with --json, and the JSON schema of them all."""

from typing import Any

import jaxcomp as jc

from .._core.declared import SCHEMAS, Declared, schema_of


def answers() -> dict[str, tuple[type[Declared], ...]]:
    """Classes of what a command prints, by its name; of a command without them all is words."""
    from ..scene.contents import ListedVariables
    from ..study.sweep._summary import SweepSummary
    from ..study.tolerance._answer import PermittedTolerances
    from . import (
        _check_content,
        _fluids,
        _identify,
        _listed,
        _optimise,
        _pictures,
        _pulsation,
        _run,
        _simulate,
        _sweep,
    )

    study = jc.study
    return {
        "accuracy": (study.accuracy.Report, study.accuracy.Extremes),
        "animate": (_pictures.Animation,),
        "balance": (jc.balancing.Balance,),
        "bearing": (jc.film.SteadyBearing, jc.film.StribeckCurve, jc.crank.LoadedJournal),
        "cache": (_listed.StoredPrograms,),
        "check": (_check_content.FileContent, _check_content.FileErrors),
        "compare": (study.Comparison,),
        "explain": (),
        "identify": (study.Identification, _identify.PredictedReadings),
        "list": (_listed.ListedValues, ListedVariables, _fluids.ListedFluids),
        "map": (study.rating.RatingMap,),
        "modes": (jc.rotor.RotorModes,),
        "optimise": (study.Optimum, study.ParetoFront, _optimise.SearchNumbers),
        "pulsation": (_pulsation.PulsationMap,),
        "respond": (jc.vibration.RotorMotion,),
        "run": (study.SteadyState, _run.RunSettings),
        "sensitivity": (study.Sensitivity,),
        "simulate": (jc.crank.Transient, _simulate.SimulationSettings),
        "sweep": (SweepSummary, _sweep.LayoutSweep),
        "tolerance": (study.tolerance.Tolerances, PermittedTolerances),
    }


def results_schema() -> dict[str, Any]:
    """JSON schema of the results of all commands, each under its name in `$defs`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Results of jaxcomp",
        "description": "What commands print with --json and write to result.json, each under its name. "
        "Numbers are in SI units; a key has the unit behind it, in brackets.",
        "$defs": {name: schema_of(*kinds) for name, kinds in answers().items()} | SCHEMAS,
    }
