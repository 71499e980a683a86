"""What `jaxcomp respond` and `jaxcomp modes` found, as objects of plain numbers in SI units."""

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..rotor import (
    DampedModes,
    Response,
    RotorModel,
    SingularResponse,
    campbell,
    critical_speeds_between,
    damped_modes,
    node_names,
    orbit,
    side_pull_limit,
    subset_names,
    subsets,
)
from ..rotor import respond as solve
from ..rotor import transmitted_forces as transmitted
from ..rotor._conventions import AXES
from ..running import loaded_orders
from ..scene import Scene, did_you_mean
from ._errors import CommandError


class Watched(NamedTuple):
    """A node whose motion is reported.

    Attributes:
        name: of the target, or of the node.
        node: number in the model's list.
        base: number of the node from which the motion is seen, -1 for the ground.
    """

    name: tuple[str, ...]
    node: tuple[int, ...]
    base: tuple[int, ...]


def whole_orders(text: str | None, loads: Sequence) -> tuple[int, ...]:
    """The orders of `--orders`, or all that are loaded but the mean.

    Raises:
        CommandError: no whole numbers above zero.
    """
    if text is None:
        return loaded_orders(tuple(loads))
    words = [word.strip() for word in text.split(",")]
    if not all(word.isdigit() and int(word) > 0 for word in words):
        raise CommandError(f'--orders {text}: must be whole numbers above zero, such as "1,2"')
    return tuple(dict.fromkeys(int(word) for word in words))


def watched_nodes(scene: Scene, model: RotorModel, words: Sequence[str]) -> Watched:
    """The nodes of `--node`, or the target planes, or all nodes.

    Raises:
        CommandError: a node that the model does not have.
    """
    names = node_names(model)
    by_word = {str(name): i for i, name in enumerate(names)}
    for word in words:
        if word not in by_word:
            raise CommandError(f"--node {word}: is no node{did_you_mean(word, by_word)}")
    planes = scene.parts.get("balancing")
    if words or planes is None:
        picked = tuple(dict.fromkeys(words)) or tuple(by_word)
        return Watched(picked, tuple(by_word[w] for w in picked), (-1,) * len(picked))
    targets = planes.targets  # pyright: ignore[reportAttributeAccessIssue]
    base = [t.relative_to for t in targets]
    return Watched(
        tuple(f"{t.name} ({t.node}{f' from {t.relative_to}' if t.relative_to else ''})"
              for t in targets),
        tuple(names.index(t.node) for t in targets),
        tuple(-1 if b is None else names.index(b) for b in base),
    )  # fmt: skip


def respond_result(
    scene: Scene,
    model: RotorModel,
    loads: tuple,
    speeds: np.ndarray,
    orders: tuple[int, ...],
    watched: Watched,
) -> tuple[dict[str, Any], Response]:
    """Motions and mount forces at single speeds; the keys are stable, new ones may join them."""
    try:
        response = solve(model, loads, jnp.asarray(speeds), orders).checked()
    except SingularResponse as error:
        raise CommandError(f"{scene.file}: {error}") from None
    forces = jnp.abs(transmitted(model, response))
    links = {
        _link_name(scene, i, link.nodes): {
            axis: forces[:, :, i, k].tolist()
            for k, axis in enumerate(AXES[model.dof])
            if axis in link.axes
        }
        for i, link in enumerate(model.links)
    }
    result = {
        **_header(scene, model),
        "speeds": speeds.tolist(),
        "orders": list(orders),
        "axes": list(AXES[model.dof]),
        "nodes": _motions(model, response, watched),
        "links": {name: axes for name, axes in links.items() if axes},
        "correction": float(jnp.max(response.correction)),
        "status": "ok",
    }
    return result, response


def curve_result(
    model: RotorModel, loads: tuple, speeds: np.ndarray, orders: tuple[int, ...], watched: Watched
) -> dict[str, Any]:
    """Major axes of the orbits over a range of speeds; `null` where there is no response."""
    response = solve(model, loads, jnp.asarray(speeds), orders)
    motion = _seen(response, watched)
    major = np.asarray(orbit(motion[..., 0], motion[..., 1]).major)
    major = np.where(np.asarray(response.ok)[..., None], major, np.nan)
    return {
        "speeds": speeds.tolist(),
        "major_axis": {
            name: [_numbers(major[n, :, i]) for n in range(len(orders))]
            for i, name in enumerate(watched.name)
        },
    }


def response_columns(result: dict[str, Any]) -> dict[str, Any]:
    """Amplitudes, phases and axes of the orbits of the watched nodes, a row for each order and speed."""
    orders, speeds = np.array(result["orders"]), np.array(result["speeds"])
    shape = (orders.size, speeds.size)
    columns: dict[str, Any] = {
        "order": np.broadcast_to(orders[:, None], shape).ravel(),
        "speed [rad/s]": np.broadcast_to(speeds, shape).ravel(),
    }
    for name, motion in result["nodes"].items():
        for axis, amplitude in motion["amplitude"].items():
            unit = "rad" if axis.startswith("th") else "m"
            columns[f"{name}.{axis}.amplitude [{unit}]"] = np.ravel(amplitude)
            columns[f"{name}.{axis}.phase [rad]"] = np.ravel(motion["phase"][axis])
        for key in ("major_axis", "minor_axis"):
            columns[f"{name}.{key} [m]"] = np.ravel(motion[key])
    return columns


def curve_columns(result: dict[str, Any]) -> dict[str, Any]:
    """Major axes of the orbits over the range of speeds, a column for each node and order."""
    curves = result["curves"]
    columns = {"speed [rad/s]": curves["speeds"]}
    for name, orders in curves["major_axis"].items():
        for order, values in zip(result["orders"], orders, strict=True):
            columns[f"{name}.order_{order}.major_axis [m]"] = values
    return columns


def modes_columns(result: dict[str, Any], campbell: bool) -> dict[str, Any]:
    """Modes at the single speeds, or along the range of a Campbell diagram, a row for each mode."""
    rows: list[tuple] = []
    if campbell:
        found = result["campbell"]
        rows = [
            (speed, number + 1, *values)
            for speed, *lists in zip(
                *(found[key] for key in ("speeds", "frequency", "damping_ratio", "whirl")),
                strict=True,
            )
            for number, values in enumerate(zip(*lists, strict=True))
        ]
    else:
        for speed, modes in zip(result["speeds"], result["modes"], strict=True):
            for number, mode in enumerate(modes):
                values = (mode[key] for key in ("frequency", "damping_ratio", "whirl"))
                rows.append((speed, number + 1, *values))
    names = ("speed [rad/s]", "mode", "frequency [rad/s]", "damping_ratio", "whirl")
    columns = zip(*rows, strict=True) if rows else ((),) * len(names)
    return dict(zip(names, columns, strict=True))


def modes_result(
    scene: Scene, model: RotorModel, speeds: np.ndarray, count: int, free: bool, damping: bool
) -> tuple[dict[str, Any], list[DampedModes]]:
    """Modes at single speeds."""
    found = [damped_modes(model, s, count, free=free, damping=damping) for s in speeds]
    tables = []
    for modes in found:
        real = np.isfinite(np.asarray(modes.eigenvalue))
        names = _leading_subset(model, modes)
        tables.append(
            [
                {
                    "frequency": float(modes.frequency[i]),
                    "damping_ratio": float(modes.damping_ratio[i]),
                    "growth": float(modes.eigenvalue[i].real),
                    "whirl": float(modes.whirl[i]),
                    "subset": names[i],
                }
                for i in np.flatnonzero(real)
            ]
        )
    result = {
        **_header(scene, model, free),
        "speeds": speeds.tolist(),
        "free": free,
        "damping": damping,
        "modes": tables,
        "stable": [bool(modes.stable) for modes in found],
        "growth": [float(modes.growth) for modes in found],
    }
    return result, found


def campbell_result(
    model: RotorModel, speeds: np.ndarray, count: int, damping: bool
) -> dict[str, Any]:
    """Frequencies over the spin speed, and where they meet the speed itself."""
    modes = campbell(model, jnp.asarray(speeds), count, damping=damping)
    critical = critical_speeds_between(model, jnp.asarray(speeds), count, damping=damping)
    return {
        "speeds": speeds.tolist(),
        "frequency": [_numbers(row) for row in modes.frequency],
        "damping_ratio": [_numbers(row) for row in modes.damping_ratio],
        "whirl": [_numbers(row) for row in modes.whirl],
        "critical_speeds": [
            {"speed": float(w), "growth": float(g), "damping_ratio": float(-g / np.hypot(g, w))}
            for w, g in zip(critical.speed, critical.growth, strict=True)
        ],
    }


def _header(scene: Scene, model: RotorModel, free: bool = False) -> dict[str, Any]:
    # hanging free a rotor has no bearings that could hold it against the side pull
    limit = float(side_pull_limit(model)) if model.side_pulls and not free else None
    return {
        "machine": scene.name,
        "file": scene.file,
        "version": version("jaxcomp"),
        "degrees_of_freedom": model.dof,
        "subsets": {
            name: [str(node) for node in group]
            for name, group in zip(subset_names(model), subsets(model), strict=True)
        },
        "side_pull_limit": limit if limit is not None and np.isfinite(limit) else None,
    }


def _seen(response: Response, watched: Watched) -> jax.Array:
    """(orders, speeds, watched, dof) motion from the base."""
    x = response.displacement
    ground = jnp.concatenate([x, jnp.zeros_like(x[..., :1, :])], -2)
    return ground[..., np.array(watched.node), :] - ground[..., np.array(watched.base), :]


def _motions(model, response, watched):
    motion = _seen(response, watched)
    ellipse = orbit(motion[..., 0], motion[..., 1])
    out = {}
    for i, name in enumerate(watched.name):
        x = np.asarray(motion[:, :, i])
        out[name] = {
            "amplitude": {
                a: np.abs(x[..., k]).tolist() for k, a in enumerate(AXES[model.dof])
            },
            "phase": {a: np.angle(x[..., k]).tolist() for k, a in enumerate(AXES[model.dof])},
            "major_axis": ellipse.major[..., i].tolist(),
            "minor_axis": ellipse.minor[..., i].tolist(),
            "inclination": ellipse.inclination[..., i].tolist(),
        }  # fmt: skip
    return out


def _leading_subset(model, modes):
    """Name of the subset that moves most."""
    names, words = node_names(model), subset_names(model)
    groups = [np.array([names.index(n) for n in group]) for group in subsets(model)]
    size = np.abs(np.asarray(modes.shape))[..., :2].max(-1)
    return [
        words[int(np.argmax([mode[g].max() for g in groups]))] if np.all(np.isfinite(mode)) else ""
        for mode in size
    ]


def _link_name(scene: Scene, number: int, nodes) -> str:
    """A link by its number in the file and its nodes; a film by the name of its bearing as well."""
    law = scene.parts["rotor"].links[number].law  # pyright: ignore[reportAttributeAccessIssue]
    bearing = getattr(getattr(law, "bearing", None), "name", "")
    name = f"{number}: {nodes[0]} to {'ground' if nodes[1] is None else nodes[1]}"
    return f"{name}, {bearing}" if bearing else name


def _numbers(values) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in np.asarray(values)]
