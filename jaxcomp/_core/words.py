"""The nearest known word to one that is unknown, for messages."""

import difflib
from collections.abc import Collection, Iterable

# What designers also say, the key that holds it, and how the two are related.
_SYNONYMS = {
    "stroke": ("crank_radius", "half the stroke"),
    "rpm": ("mean_speed", 'e.g. "1450 rpm"'),
    "diameter": ("bore", "of the cylinder"),
    "eccentricity": ("offset", "of the cylinder axis from the crank's"),
    "ocvirk": ("short", "Ocvirk's film"),
    "refrigerant": ("fluid", "by its name, as R22"),
    "dead_volume": ("clearance_ratio", "clearance volume over swept volume"),
}

# Words that could be one number or another: taken for neither, and answered with both.
AMBIGUOUS = {
    "bore": {
        "mechanism.bore": "the bore alone",
        "bore_at_displacement": "with the stroke that keeps the displacement",
    },
}

_FEW = 8  # names that a message lists beside the one that is near


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """The most similar of some words, `None` if none is similar.

    Without regard to case: "COP" is "cop". The first words of a dotted name stand for it if only one name
    begins so: "impact_speed" for "impact_speed.<contact>".
    """
    # of names that differ in their case alone the first in order is written last, and stays
    names = {name.lower(): name for name in sorted(choices, reverse=True)}
    lowered = word.lower()
    if lowered in names:
        return names[lowered]
    members = [name for name in names if name.startswith(f"{lowered}.")]
    if len(members) == 1:
        return names[members[0]]
    for similar in difflib.get_close_matches(lowered, sorted(names), n=1, cutoff=0.6):
        return names[similar]
    return None


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """`; did you mean "..."?` if something similar is known, and what is known otherwise.

    Args:
        word: the unknown one.
        choices: those that would be understood.
    """
    choices = sorted(choices)
    near = _meant(word, choices)
    key, relation = _synonym(word, choices)
    # another word for the same thing is nearer than one that looks alike
    if key and (near is None or word in _SYNONYMS):
        return f'; did you mean "{key}", {relation}?'
    if near is not None:
        return f"; did you mean {near}?"
    if choices:
        return f"; known here: {', '.join(choices)}"
    return ""


def hint(word: object, choices: Iterable[object]) -> str:
    """` (did you mean "..."?)` if something similar is known."""
    names = [str(name) for name in choices]
    near = _meant(str(word), names)
    if near is not None:
        return f" (did you mean {near}?)"
    key, relation = _synonym(str(word), names)
    if key:
        return f' (did you mean "{key}", {relation}?)'
    return ""


def _synonym(word: str, choices: Collection[str]) -> tuple[str, str]:
    """The known word for what designers also say, and how they are related; empty if there is none.

    A slip in what is also said is seen through: "ocvrik" is "ocvirk".
    """
    synonyms = []
    for name, (key, _) in _SYNONYMS.items():
        if key in choices:
            synonyms.append(name)
    synonym = nearest(word, synonyms)
    if synonym is None:
        return "", ""
    return _SYNONYMS[synonym]


def _meant(word: str, choices: Collection[str]) -> str | None:
    """The nearest word in quotes, or both readings of an ambiguous one; `None` if none is near."""
    ambiguous = []
    for doubtful, readings in AMBIGUOUS.items():
        if not readings.keys().isdisjoint(choices):
            ambiguous.append(doubtful)
    near = nearest(word, [*choices, *ambiguous])
    if near is None:
        return None
    if near in ambiguous:
        return ", or ".join(f'"{name}", {sense}' for name, sense in AMBIGUOUS[near].items())
    return f'"{near}"'


# Names that people look for in the package, and what there is instead.
_ELSEWHERE = {
    "run": "study.steady_state(machine), or solve_orbit(machine.compressor) for the crank alone",
    "solve": "study.steady_state(machine), or solve_orbit(machine.compressor) for the crank alone",
    "solve_machine": "study.steady_state(machine)",
    "steady_state": "study.steady_state(machine)",
    "check": "scene.implausible_values(machine), or `jaxcomp check FILE`",
    "compare": "study.compare({label: machine, ...})",
    "map": "study.rating.rating_map(machine, evaporating, condensing)",
    "rating_map": "study.rating.rating_map(machine, evaporating, condensing)",
    "balance": "balancing.least_squares(balancing.direct_influence(...))",
    "modes": "damped_modes, or vibration.rotor_modes(model, speeds)",
    "animate": "plot.gif, or `jaxcomp animate FILE`",
    "desk": "desk.serve(machine), after `import jaxcomp.desk`",
    "optimize": "optimise",
    "minimize": "optimise(problem, maximise=False)",
    "maximize": "optimise(problem, maximise=True)",
    "monte_carlo": "tolerance(problem, tolerances)",
    "bearing": "film.steady_bearing, or film.operating_point",
    "with_value": "scene.with_value(machine, name, value)",
    "set_value": "scene.with_value(machine, name, value)",
    "uniform": "jaxcomp.uniform",
    "log_uniform": "jaxcomp.log_uniform",
    "normal": "jaxcomp.normal",
    "within": "jaxcomp.within",
    "save": "dump(machine) for a machine file, `save` of a result for a result",
    "read": "load",
    "open": "load",
}


def elsewhere(name: str, names: Iterable[str]) -> str:
    """Advice for a name that a module does not have; "" if nothing is near.

    Args:
        name: that was asked for.
        names: names that the module has.
    """
    if name in _ELSEWHERE and name not in names:
        return f"; use {_ELSEWHERE[name]}"
    return hint(name, names)


def one_of(word: object, choices: Iterable[object]) -> str:
    """`one of ...` as the bound of a `BadInput`, with the nearest word where one is near."""
    choices = [str(name) for name in choices]
    near = hint(word, choices)
    names = ", ".join(choices)
    # beside the near one, which is likely what is meant, the others need not all be there
    if near and len(choices) > _FEW:
        names = f"{', '.join(choices[:_FEW])}, and {len(choices) - _FEW} more"
    return f"one of {names}{near}"
