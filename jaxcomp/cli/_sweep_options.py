"""What `jaxcomp sweep` reads from its options."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..crank import Collocation
from ..design import AnalysisOptions, by_name, variable
from ..machine import machine_of
from ..scene import Scene, to_si
from ..sweeping import grid, log_grid, log_uniform, normal, uniform
from ._arguments import assignments, with_one_unit
from ._errors import CommandError


def start_devices(wanted: int | None) -> None:
    """Let JAX see as many devices as this process may use cores; before its first operation.

    Raises:
        CommandError: fewer than one.
    """
    import jax

    if wanted is not None and wanted < 1:
        raise CommandError(f"--devices {wanted}: must be >= 1")
    if "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", wanted or len(os.sched_getaffinity(0)))
    except RuntimeError:  # JAX runs already, with the devices it has
        return


def default_quantities(scene: Scene) -> list[str]:
    """What is asked if nothing else is."""
    return ["mechanical_efficiency"] if scene.compressor is not None else ["vibration"]


def analysis_options(scene: Scene, nodes, reversals, tolerance) -> AnalysisOptions:
    """How designs are worked out, with the options of the solver that were given."""
    given = {"nodes": nodes, "reversals": reversals, "tolerance": tolerance}
    given = {name: value for name, value in given.items() if value is not None}
    if not given or scene.compressor is None:
        return AnalysisOptions()
    return AnalysisOptions(
        Collocation(**{"reversals": scene.compressor.mechanism.load_reversals} | given)
    )


def axes_of(scene: Scene, texts: Sequence[str], sampled: bool) -> dict[str, Any]:
    """Values or distributions of the variables, in SI units.

    Raises:
        CommandError, SceneError, BadInput: an unknown variable, or values that cannot be read.
    """
    design, axes = machine_of(scene), {}
    for name, text in by_name(design, assignments(texts, "--over")).items():
        option, one = f"--over {name}={text}", variable(design, name)
        axes[name] = _axis(text, one.unit, option, sampled)
        ends = axes[name].ends if sampled else (float(min(axes[name])), float(max(axes[name])))
        for end in ends:
            if not bool(one.bound.holds(end)):
                raise CommandError(f"{option}: must be {one.bound} {one.unit}".rstrip())
    return axes


def _axis(text: str, unit: str, option: str, sampled: bool):
    kind, colon, rest = text.partition(":")
    kind = kind.strip()
    if colon and kind in ("log", "normal"):
        text = rest
    else:
        kind = ""
    parts = text.split(":")
    read = [part.strip() for part in parts]
    if sampled:
        if len(parts) != 2:
            raise CommandError(
                f"{option}: must have the form from:to, log:from:to or normal:mean:deviation with "
                "--samples"
            )
        made = {"": uniform, "log": log_uniform, "normal": normal}[kind]
        return _made(made, option, *(_number(part, unit, option) for part in with_one_unit(read)))
    if kind == "normal":
        raise CommandError(f"{option}: needs --samples")
    if len(parts) == 1 and not kind:
        values = [_number(part, unit, option) for part in with_one_unit(text.split(","))]
        if len(set(values)) < len(values):
            raise CommandError(f"{option}: must not repeat a value")
        return np.array(values)
    if len(parts) != 3 or not read[2].isdigit():
        raise CommandError(
            f"{option}: must have the form from:to:count, log:from:to:count or a,b,c"
        )
    ends = (_number(part, unit, option) for part in with_one_unit(read[:2]))
    return _made(log_grid if kind else grid, option, *ends, int(read[2]))


def _made(kind, option, *numbers):
    try:
        return kind(*numbers)
    except ValueError as error:
        raise CommandError(f"{option}: {error}") from None


def _number(text: str, unit: str, option: str) -> float:
    try:
        return float(to_si(float(text), unit, option))
    except ValueError:
        return float(to_si(text, unit, option))
