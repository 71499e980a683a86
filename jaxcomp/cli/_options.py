"""Options that several commands share, and what the shell completes behind them.

Completion reads files and the registry itself, so that no key press waits for JAX.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import jaxcomp as jc

from .._core.extensions import ExtensionError
from .._core.files import regular
from .._core.registry import DESIGN_RULES, registered
from ._arguments import assignments, changed_scene, split_at
from ._start import CommandError, refuse, show_error, start_jax

_MACHINES = Path(__file__).parents[1] / "machines"


# ------------------------------------------------------------------- completion
def complete_machine(incomplete: str) -> list[tuple[str, str]]:
    """Bundled machines with their descriptions, then machine files and folders."""
    candidates = []
    for file in sorted(_MACHINES.glob("*.toml")):
        if file.stem.startswith(incomplete):
            candidates.append((file.stem, _tables(file).get("description", "")))
    folder = Path(incomplete)
    if not incomplete.endswith("/"):
        folder = folder.parent
    for file in sorted(folder.glob("*")):
        name = f"{file}/" if file.is_dir() else str(file)
        kind = "machine file" if file.suffix == ".toml" else "folder"
        if name.startswith(incomplete) and (file.is_dir() or file.suffix == ".toml"):
            candidates.append((name, kind))
    return candidates


def complete_variable(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """`NAME=` of the design rules, and of the values in the machine on the command line."""
    return [*complete_rule(incomplete), *((path, "") for path in _complete_path(ctx, incomplete))]


def complete_rule(incomplete: str) -> list[tuple[str, str]]:
    """`NAME=` of the design rules."""
    return [(f"{name}=", doc) for name, doc in DESIGN_RULES.items() if name.startswith(incomplete)]


def complete_quantity(incomplete: str) -> list[tuple[str, str]]:
    """The quantities of the registry; those ending in a point want a joint or a target."""
    try:
        quantities = registered()
    except ExtensionError:  # the command itself tells; a key press in the shell has nowhere to
        return []
    candidates = []
    for quantity in quantities:
        name = quantity.name.partition("<")[0]
        if name.startswith(incomplete):
            candidates.append((name, quantity.doc))
    return candidates


def _complete_path(ctx: typer.Context, incomplete: str) -> list[str]:
    # behind an option that still lacks its value the words before it are not told apart yet
    words = (word for word in ctx.args if not word.startswith("-"))
    machine = ctx.params.get("machine") or next(words, None)
    if not machine or "=" in incomplete:
        return []
    file = _MACHINES / f"{machine}.toml"
    if not file.exists():
        file = Path(machine)
    tables = _tables(file)
    paths = list(_paths(tables))
    for plane in tables.get("balancing", {}).get("planes", ()):
        name = plane.get("name")
        paths += [f"corrections.{name}.{part}" for part in ("x", "y", "magnitude", "angle")]
    return [f"{path}=" for path in paths if path.startswith(incomplete)]


def _tables(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(regular(file).read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {}


def _paths(table: Mapping[str, Any], above: str = "") -> Iterator[str]:
    for key, value in table.items():
        path = f"{above}{key}"
        if isinstance(value, Mapping) and "value" not in value:
            yield from _paths(value, f"{path}.")
        elif isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
            for index, row in enumerate(value):
                yield from _paths(row, f"{path}.{index}.")
        elif above and key != "source":
            yield path


# ------------------------------------------------------------------- options
# How the periodic state is solved, of many designs.
Accuracy = Literal["fine", "fast", "coarse"]
# Forces on the rotor.
Excitation = Literal["file", "crank"]
# Numbers of the cycle's options, at most: more only take memory.
_MOST_OF_CYCLE = {"nodes": 24, "panels": 1000}
# How samples are drawn.
Sampling = Literal["sobol", "latin-hypercube", "random"]


def analysis_options(
    scene: jc.scene.Scene,
    accuracy: Accuracy,
    solver: str = "collocation",
    cycle: list[str] | None = None,
    excitation: Excitation | None = None,
) -> jc.AnalysisOptions:
    """Options for the designs of a study; of the finest accuracy each design chooses its solver."""
    plain = solver == "collocation"
    if plain and accuracy == "fine" and cycle is None:
        return jc.AnalysisOptions(None, excitation)
    method = jc.Collocation(8, reversals=0, tolerance=1e-5)
    if accuracy == "fast":
        method = jc.Collocation(12, reversals=0, tolerance=1e-10)
    if not plain or accuracy == "fine":
        if scene.machine.compressor is None:
            return jc.AnalysisOptions(None, excitation)
        method = solver_of(solver, scene.as_compressor())
    return jc.AnalysisOptions(with_cycle(method, cycle), excitation)


def solver_of(text: str, compressor: jc.Compressor) -> Any:
    """The solver of the periodic state that `--solver` names."""
    from ..crank._collocation import default_collocation

    name, _, tolerance = text.partition(":")
    if name == "collocation":
        plain = default_collocation(compressor)
        if not tolerance:
            return plain
        if tolerance.isdigit() and 3 <= int(tolerance) <= 64:
            return replace(plain, nodes=int(tolerance))
        raise CommandError(f"--solver {text}: must have 3 to 64 nodes on a panel after the colon")
    import diffrax  # a third of a second, for those who march

    if name == "shooting":
        name = "Tsit5"
    method_type = getattr(diffrax, name, None)
    keywords = {}
    try:
        if not isinstance(method_type, type):
            raise TypeError
        if not issubclass(method_type, diffrax.AbstractAdaptiveSolver):
            raise TypeError
        if tolerance:
            keywords["tolerance"] = float(tolerance)
            if not 0 < keywords["tolerance"] < 1:
                raise ValueError
        return jc.crank.Shooting(method_type(), reversals=compressor.load_reversals, **keywords)
    except (TypeError, ValueError):  # some have arguments of their own
        raise CommandError(
            f"--solver {text}: must be collocation, collocation:16, shooting or an adaptive solver of "
            "diffrax (Tsit5, Dopri8, Kvaerno5), with a tolerance after a colon if wanted: Dopri8:1e-9"
        ) from None


def chosen_solver(text: str, scene: jc.scene.Scene) -> Any:
    """The solver of `--solver` for a scene; `None` for the default, or where nothing is solved by it."""
    if text == "collocation" or scene.machine.compressor is None:
        return None
    return solver_of(text, scene.as_compressor())


def with_cycle(method: Any, texts: list[str] | None) -> Any:
    """A solver of the crank with the options of the cycle that `--cycle` gives."""
    if not texts:
        return method
    return replace(method, cycle=cycle_of(method.cycle, texts))


# Entries of `CycleOptions` that solvers set.
_NOT_OF_USERS = ("size", "cylinders")


def cycle_of(cycle: jc.cylinder.CycleOptions, texts: list[str]) -> jc.cylinder.CycleOptions:
    """Options of the cycle, changed by any number of `NAME=VALUE,NAME=VALUE`."""
    defaults = {}
    for field in fields(cycle):
        if field.name not in _NOT_OF_USERS:
            defaults[field.name] = getattr(cycle, field.name)
    changes: dict[str, Any] = {}
    for pair in ",".join(texts).split(","):
        name, _, text = split_at("=", pair)
        names = f"must be NAME=VALUE with one of {', '.join(defaults)}"
        refuse(name not in defaults, f"--cycle {pair}: {names}")
        refuse(name in changes, f"--cycle {pair}: {name} is set twice")
        kind = type(defaults[name])
        if defaults[name] is None:
            kind = int  # a number that follows from the machine is a count
        try:
            value = kind(text)
        except ValueError:
            raise CommandError(f"--cycle {pair}: {names}") from None
        if kind is int:
            largest = _MOST_OF_CYCLE.get(name, 10**6)
            bound = f"must be a whole number from 2 to {largest}"
            good = 2 <= value <= largest
        elif kind is float:
            bound = "must be > 0 and < 1"
            good = 0 < value < 1
        else:
            bound = "must be collocation or march"
            good = value in ("collocation", "march")
        refuse(not good, f"--cycle {pair}: {bound}")
        changes[name] = value
    return replace(cycle, **changes)


Machine = Annotated[
    str,
    typer.Argument(
        help="Bundled machine (see `jaxcomp list`) or machine file.",
        autocompletion=complete_machine,
    ),
]
AccuracyOption = Annotated[
    Accuracy,
    typer.Option(
        "--accuracy",
        help="Of the periodic state. fine: to 1e-9 of the work; fast: to 1e-5, compiles three times as "
        "fast; coarse: to 3e-5, for the most designs a second.",
    ),
]
Solver = Annotated[
    str,
    typer.Option(
        "--solver",
        metavar="SOLVER",
        help="Of the periodic state: collocation, with nodes on a panel if wanted (collocation:16); "
        "shooting, which integrates the crank with Tsit5 of diffrax; or any adaptive solver of diffrax, "
        "with its tolerance if wanted (Dopri8, Kvaerno5:1e-8).",
    ),
]
CycleOption = Annotated[
    list[str] | None,
    typer.Option(
        "--cycle",
        metavar="NAME=VALUE,...",
        help="How the cycle of a machine with valves is solved: nodes, tolerance, method (collocation "
        "or march) and the other entries of jaxcomp.cylinder.CycleOptions. Panels and steps follow from "
        "the machine if they are not given. Repeatable.",
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Set a value of the machine (motor.mean_speed=800rpm, or a pattern such as "
        "friction.*.coefficient=0.1; `none` takes an optional one away), a design rule "
        "(bore_at_displacement=120mm: the stroke follows) or a correction mass (corrections.PLANE.x). "
        "Repeatable.",
        autocompletion=complete_variable,
    ),
]
Designs = Annotated[
    list[str] | None,
    typer.Option(
        "--design",
        metavar="NAME=VALUE",
        help="The same as --set, for design rules. Repeatable.",
        autocompletion=complete_rule,
    ),
]
Quantity = Annotated[str | None, typer.Option(autocompletion=complete_quantity)]
Quantities = Annotated[list[str] | None, typer.Option(autocompletion=complete_quantity)]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in SI units instead of tables.")
]


def folder(out: Path | None) -> Path | None:
    """A folder for results, which is made if it is not there; a file is none."""
    if out is not None and out.exists() and not out.is_dir():
        show_error(CommandError(f"--out {out}: is a file; name a folder, which is made if absent"))
        raise typer.Exit(2)
    return out


Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for report.html, pictures, result.json and machine.toml as it was run.",
        callback=folder,
    ),
]
OutWithoutScene = Annotated[
    Path | None,
    typer.Option(help="Folder for report.html, pictures and result.json.", callback=folder),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Write over files in the folder of --out that no command wrote there."
    ),
]
ExcitationOption = Annotated[
    Excitation | None,
    typer.Option(
        help="Forces on the rotor: those of the file, or of the crank's periodic state. If absent, the "
        "crank where the machine joins it to the rotor."
    ),
]
Speed = Annotated[
    list[str] | None,
    typer.Option(
        "--speed",
        metavar="SPEED",
        help="Speed to solve, e.g. 3000rpm; those of the machine if absent. Repeatable.",
    ),
]
Speeds = Annotated[
    str | None,
    typer.Option(
        metavar="SPEEDS",
        help="Speeds to solve, e.g. 3000rpm,3600rpm, or a range from:to or from:to:count, e.g. "
        "300rpm:6000rpm:200, for curves, Campbell diagram and critical speeds.",
    ),
]
Dask = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Scheduler of a Dask cluster whose workers solve the designs, e.g. tcp://host:8786, or its "
        "scheduler file (.json); this process if absent. Needs `pip install jaxcomp\\[dask]`.",
    ),
]


# ------------------------------------------------------------------- groups of options
@dataclass(frozen=True)
class Case:
    """A machine, and what the command line changes in it."""

    machine: Machine
    sets: Sets = None

    def scene(self, *, once: bool = False, varied: Sequence[str] | None = None) -> jc.scene.Scene:
        """The changed scene, with JAX made ready; arguments of `start_jax` and `changed_scene`."""
        start_jax(once=once)
        return changed_scene(self.machine, self.sets, getattr(self, "designs", None), varied)

    @property
    def changes(self) -> dict[str, dict[str, str]]:
        """Changes by options, for the result."""
        return {"set": assignments(self.sets, "--set")}


@dataclass(frozen=True)
class DesignCase(Case):
    """Case of a command with design rules as an option of their own."""

    designs: Designs = None

    @property
    def changes(self) -> dict[str, dict[str, str]]:
        """Changes by options, for the result."""
        return {**super().changes, "design": assignments(self.designs, "--design")}


@dataclass(frozen=True)
class Analysis:
    """Options on how the designs of a study are solved."""

    accuracy: AccuracyOption = "fine"
    solver: Solver = "collocation"
    cycle: CycleOption = None

    def options(
        self, scene: jc.scene.Scene, excitation: Excitation | None = None
    ) -> jc.AnalysisOptions:
        """The options of the library for a scene."""
        return analysis_options(scene, self.accuracy, self.solver, self.cycle, excitation)


@dataclass(frozen=True)
class FastAnalysis(Analysis):
    """Options on how the designs of a study are solved, fast if nothing else is said."""

    accuracy: AccuracyOption = "fast"
