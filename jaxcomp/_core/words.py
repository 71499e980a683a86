"""The nearest known word to one that is unknown, for messages."""

import difflib
from collections.abc import Collection, Iterable

# What designers also say, the key that holds it, and how the two are related.
_ALSO_SAID = {
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


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The most similar of some words, `None` if none is similar.

    Without regard to case: "COP" is "cop". The first words of a dotted name stand for it if only one name
    begins so: "impact_speed" for "impact_speed.<contact>".
    """
    names = {name.lower(): name for name in sorted(known, reverse=True)}
    lowered = word.lower()
    if lowered in names:
        return names[lowered]
    members = [name for name in names if name.startswith(f"{lowered}.")]
    if len(members) == 1:
        return names[members[0]]
    similar = difflib.get_close_matches(lowered, sorted(names), n=1, cutoff=0.6)
    return names[similar[0]] if similar else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean "..."?` if something similar is known, and what is known otherwise.

    Args:
        word: the unknown one.
        known: those that would be understood.
    """
    known = sorted(known)
    near = _meant(word, known)
    key, relation = _also_said(word, known)
    # another word for the same thing is nearer than one that looks alike
    if key and (near is None or word in _ALSO_SAID):
        return f'; did you mean "{key}", {relation}?'
    if near is not None:
        return f"; did you mean {near}?"
    return f"; known here: {', '.join(known)}" if known else ""


def hint(word: object, known: Iterable[object]) -> str:
    """` (did you mean "..."?)` if something similar is known."""
    names = [str(name) for name in known]
    near = _meant(str(word), names)
    if near is not None:
        return f" (did you mean {near}?)"
    key, relation = _also_said(str(word), names)
    return f' (did you mean "{key}", {relation}?)' if key else ""


def _also_said(word: str, known: Collection[str]) -> tuple[str, str]:
    """The known word for what designers also say, and how they are related; empty if there is none.

    A slip in what is also said is seen through: "ocvrik" is "ocvirk".
    """
    said = nearest(word, [name for name, (key, _) in _ALSO_SAID.items() if key in known])
    return ("", "") if said is None else _ALSO_SAID[said]


def _meant(word: str, known: Collection[str]) -> str | None:
    """The nearest word in quotes, or both readings of an ambiguous one; `None` if none is near."""
    ambiguous = [
        one for one, readings in AMBIGUOUS.items() if not readings.keys().isdisjoint(known)
    ]
    near = nearest(word, [*known, *ambiguous])
    if near in ambiguous:
        return ", or ".join(f'"{name}", {what}' for name, what in AMBIGUOUS[near].items())
    return None if near is None else f'"{near}"'


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
    "save": "dump(machine) for a machine file, `save` of a result for a result",
    "read": "load",
    "open": "load",
}


def elsewhere(name: str, known: Iterable[str]) -> str:
    """Advice for a name that a module does not have; "" if nothing is near.

    Args:
        name: that was asked for.
        known: names that the module has.
    """
    if name in _ELSEWHERE and name not in known:
        return f"; use {_ELSEWHERE[name]}"
    return hint(name, known)


def one_of(word: object, known: Iterable[object]) -> str:
    """`one of ...` as the bound of a `BadInput`, with the nearest word where one is near."""
    known = [str(name) for name in known]
    near = hint(word, known)
    few = known[:_FEW] if near else known  # the near one is what is wanted
    more = f", and {len(known) - len(few)} more" if len(few) < len(known) else ""
    return f"one of {', '.join(few)}{more}{near}"
