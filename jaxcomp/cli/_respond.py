"""`jaxcomp respond`: harmonic response of rotor, crankcase and housing to unbalances and forces."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jaxcomp as jc

from .._core.display import RPM
from .._core.nested import plain
from . import _options as opt
from ._output import Output
from ._rotor import chosen_excitation, header, points_and_range, pull_row, rotor_of, whirl
from ._start import CommandError, refuse_unknown, waiting
from ._tables import row_table

if TYPE_CHECKING:
    import numpy as np

# Orders of the crank's forces that are shown if none are named; those above are small.
_OF_CRANK = (1, 2, 3, 4)
# By name of the target or node: its number in the model's list, and that of the node relative to which
# the motion is, -1 for the ground.
Watched = dict[str, tuple[int, int]]
_EXCITED = {
    "file": "unbalances and forces of the scene",
    "crank": "unbalances and the crank's periodic state at each speed",
}


def respond(
    *,
    case: opt.Case,
    speed: opt.Speed = None,
    speeds: opt.Speeds = None,
    orders: str | None = None,
    node: list[str] | None = None,
    excitation: opt.ExcitationOption = None,
    solver: opt.Solver = "collocation",
    output: Output,
) -> None:
    """Find the vibration of a rotor with its crankcase and housing.

    Example: [bold]jaxcomp respond hermetic-68cc --speed 3000rpm --speeds 300rpm:6000rpm:200 --out
    result[/bold]

    Args:
        orders (N,N,...): Orders of the speed; all that are loaded if absent.
        node: Node to report; the target planes (or all) if absent. Repeatable.
    """
    scene = case.scene(once=True)
    watched = watched_nodes(scene, rotor_of(scene), node or ())
    loads = scene.parts.get("loads")
    shaken_by = chosen_excitation(scene, excitation)
    by_crank = shaken_by == "crank"
    if not isinstance(loads, jc.rotor.LoadCase) or not (loads.loads or by_crank):
        raise CommandError(f"{scene.file}: loads: is missing; nothing excites this rotor")
    wanted = whole_orders(orders, None if by_crank else loads.loads)
    points, range_ = points_and_range(scene, speed, speeds)
    crank_solver = opt.chosen_solver(solver, scene)
    model = rotor_of(scene, points, range_)

    def answer(machine, speeds):
        return jc.respond(
            machine,
            spin_speeds=speeds,
            orders=wanted,
            excitation=shaken_by,
            crank_solver=crank_solver,
        )

    with waiting():
        response = answer(scene, points)
        result = respond_result(scene, model, response, points, wanted, watched)
        if range_ is not None:
            result["curves"] = curve_result(answer(scene, range_), range_, watched)
        if moving_films(scene):
            result["linearised"] = linearised_result(scene, answer, points, wanted, watched)
    result = plain(result | {"excitation": shaken_by} | case.changes)

    def figures():
        drawn = {
            "rotor": jc.plot.interface.rotor_drawing(model),
            "shape": jc.plot.interface.deflection_shape(model, response),
            "orbits": jc.plot.interface.response_orbits(result),
        }
        return drawn | (
            {"curves": jc.plot.interface.response_curves(result)} if "curves" in result else {}
        )

    curves = {"response": lambda: response_columns(result)}
    if "curves" in result:
        curves["curves"] = lambda: curve_columns(result)
    output.emit(result, response_tables, figures, scene, curves)


def whole_orders(text: str | None, loads: Sequence | None) -> tuple[int, ...]:
    """The orders of `--orders`, all that are loaded but the mean, or without loads those of the crank."""
    if text is None:
        from ..vibration.interface import excited_orders

        return _OF_CRANK if loads is None else excited_orders(tuple(loads))
    numbers = [word.strip() for word in text.split(",")]
    if not all(word.isdigit() and int(word) > 0 for word in numbers):
        raise CommandError(f'--orders {text}: must be whole numbers above zero, such as "1,2"')
    return tuple(dict.fromkeys(int(word) for word in numbers))


def watched_nodes(
    scene: jc.scene.Scene, model: jc.rotor.RotorModel, given: Sequence[str]
) -> Watched:
    """The nodes of `--node`, or the target planes, or all nodes."""
    names = jc.rotor.interface.node_names(model)
    places = {str(name): i for i, name in enumerate(names)}
    for name in given:
        refuse_unknown(f"--node {name}", name, places, "node")
    planes = scene.parts.get("balancing")
    if given or planes is None:
        return {name: (places[name], -1) for name in given or places}
    watched = {}
    for one in planes.targets:  # pyright: ignore[reportAttributeAccessIssue]
        base, apart = -1, ""
        if one.relative_to is not None:
            base, apart = names.index(one.relative_to), f" from {one.relative_to}"
        watched[f"{one.name} ({one.node}{apart})"] = names.index(one.node), base
    return watched


def respond_result(
    scene: jc.scene.Scene,
    model: jc.rotor.RotorModel,
    response: jc.rotor.Response,
    speeds: np.ndarray,
    orders: tuple[int, ...],
    watched: Watched,
) -> dict[str, Any]:
    """Motions and mount forces at single speeds; the keys are stable, new ones may join them."""
    import numpy as np

    try:
        response.checked()
    except jc.rotor.interface.SingularResponse as error:
        raise CommandError(f"{scene.file}: {error}") from None
    forces = np.abs(jc.rotor.transmitted_forces(model, response))
    axes = jc.rotor.AXES[model.dof]
    links = {
        _link_name(scene, i, link.nodes): {
            axis: forces[:, :, i, k] for k, axis in enumerate(axes) if axis in link.axes
        }
        for i, link in enumerate(model.links)
    }
    motion = _relative(response, watched)
    ellipse = jc.rotor.orbit(motion[..., 0], motion[..., 1])
    motion = np.asarray(motion)

    def node(i):
        return {
            "amplitude": {a: np.abs(motion[:, :, i, k]) for k, a in enumerate(axes)},
            "phase": {a: np.angle(motion[:, :, i, k]) for k, a in enumerate(axes)},
            "major_axis": ellipse.major[..., i],
            "minor_axis": ellipse.minor[..., i],
            "inclination": ellipse.inclination[..., i],
        }

    return {
        **header(scene, model),
        "speeds": speeds,
        "orders": orders,
        "axes": axes,
        "nodes": {name: node(i) for i, name in enumerate(watched)},
        "links": {name: forces for name, forces in links.items() if forces},
        "correction": np.max(response.correction),
        "status": "ok",
    }


def moving_films(scene: jc.scene.Scene) -> dict[int, str]:
    """Names of the rotor's bearings whose journals move in their films, by number of the link."""
    from ..film import JournalBearing

    found = {}
    for number in jc.vibration.interface.open_films(scene.parts.get("rotor")):  # pyright: ignore
        law = scene.parts["rotor"].links[number].law  # pyright: ignore[reportAttributeAccessIssue]
        name = getattr(law.bearing, "name", "")
        bearing = scene.machine.bearings.get(name)
        if isinstance(bearing, JournalBearing) and bearing.moves:
            found[number] = name
    return found


def linearised_result(
    scene: jc.scene.Scene,
    answer: Callable[..., jc.rotor.Response],
    speeds: np.ndarray,
    orders: tuple[int, ...],
    watched: Watched,
) -> dict[str, Any]:
    """The vibration and the films of the journals that move, with the films linearised either way."""
    import jax.numpy as jnp

    result = {}
    for place in ("mean_load", "orbit"):
        machine = jc.with_film_linearisation(scene.machine, place)
        model: Any = jc.rotor_at(machine, speeds)
        found = respond_result(scene, model, answer(machine, speeds), speeds, orders, watched)
        films = {}
        for number, name in moving_films(scene).items():
            law = model.links[number].law
            pairs = [law.coefficients(jnp.asarray(speed)) for speed in speeds]
            films[name] = {"stiffness": [k for k, _ in pairs], "damping": [c for _, c in pairs]}
        motion = {name: node["major_axis"] for name, node in found["nodes"].items()}
        result[place] = {"major_axis": motion, "films": films}
    return result


def curve_result(
    response: jc.rotor.Response, speeds: np.ndarray, watched: Watched
) -> dict[str, Any]:
    """Major axes of the orbits over a range of speeds; `null` where there is no response."""
    import numpy as np

    motion = _relative(response, watched)
    major = np.asarray(jc.rotor.orbit(motion[..., 0], motion[..., 1]).major)
    major = np.where(np.asarray(response.ok)[..., None], major, np.nan)
    curves = {name: major[..., i] for i, name in enumerate(watched)}
    return {"speeds": speeds, "major_axis": curves}


def response_columns(result: dict[str, Any]) -> dict[str, Any]:
    """Amplitudes, phases and axes of the orbits of the watched nodes, a row for each order and speed."""
    import numpy as np

    order, speed = (
        x.ravel() for x in np.meshgrid(result["orders"], result["speeds"], indexing="ij")
    )
    columns: dict[str, Any] = {"order": order, "speed [rad/s]": speed}
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
    return {"speed [rad/s]": curves["speeds"]} | {
        f"{name}.order_{order}.major_axis [m]": values
        for name, orders in curves["major_axis"].items()
        for order, values in zip(result["orders"], orders, strict=True)
    }


def response_tables(result: dict[str, Any]) -> Iterator[Any]:
    """Orbits of the watched nodes, mount forces, peaks of the curves, convergence."""
    for place in range(len(result["speeds"])):
        yield _orbits(result, place)
    rows = [
        (*begin, *(axes[a][n][s] if a in axes else None for a in result["axes"]))
        for begin, axes, n, s in _each(result, result["links"])
    ]
    heads = ("Link, N and N m", "n", "rpm", *((axis, ".4g") for axis in result["axes"]))
    yield row_table(None, heads, rows, whole=(0,))
    if "linearised" in result:
        yield from _linearised(result, result["linearised"])
    if "curves" in result:
        yield _peaks(result)
    solver = ("Solver", result["status"], f"last correction {result['correction']:.1e}")
    shaken = ("Excitation", result["excitation"], _EXCITED[result["excitation"]])
    yield row_table(None, ("Convergence", "", ""), [shaken, solver, *pull_row(result)], texts=3)


def _each(result: dict[str, Any], by_name: Mapping[str, Any]) -> Iterator[Any]:
    """((name, order, rpm) as cells, value, place of the order, of the speed) of every row."""
    for name, value in by_name.items():
        for n, order in enumerate(result["orders"]):
            for s, speed in enumerate(result["speeds"]):
                first = name if n == s == 0 else ""
                yield (first, order, f"{speed * RPM:.5g}"), value, n, s


def _orbits(result, s):
    speed, rows = result["speeds"][s], []
    for name, motion in result["nodes"].items():
        for n, order in enumerate(result["orders"]):
            x, y = (motion["amplitude"][a][n][s] for a in ("ux", "uy"))
            major, minor = motion["major_axis"][n][s], motion["minor_axis"][n][s]
            velocity = order * speed * math.hypot(x, y) / math.sqrt(2)
            micrometres = (_short(v * 1e6) for v in (x, y, major, abs(minor)))
            way = whirl(minor / major if major else 0.0)
            first = name if n == 0 else ""
            rows.append((first, order, *micrometres, way, _short(1e3 * velocity)))
    title = (
        f"{result['machine']} at {speed * RPM:.5g} rpm: amplitudes and half axes in µm, velocity in "
        "mm/s rms"
    )
    heads = ("Node", "n", "x", "y", "Major", "Minor", "Whirl", "mm/s")
    table = row_table(title, heads, rows, whole=(0, 6))
    table.columns[6].min_width = len("backward")
    return table


def _short(value: float) -> str:
    """Three digits in five characters, so that the table fits a narrow terminal; JSON has all."""
    if not value >= 0.01:
        return "<0.01" if value > 0 else "0"
    return f"{value:.3g}" if value >= 0.1 else f"{value:.3f}"


def _linearised(result, both):
    """Vibration and films with the films linearised at their mean load and along the orbits."""
    rows = []
    for begin, name, n, s in _each(result, {name: name for name in result["nodes"]}):
        still, along = (both[place]["major_axis"][name][n][s] for place in ("mean_load", "orbit"))
        change = f"{100 * (along / still - 1):+.2g}" if still else ""
        rows.append((*begin, _short(1e6 * still), _short(1e6 * along), change))
    title = "Major axis in µm with the films linearised at their mean load, or along their orbits"
    heads = ("Node", "n", "rpm", "Mean load", "Orbit", "Change, %")
    yield row_table(title, heads, rows, whole=(0,))
    rows = []
    for name in both["orbit"]["films"]:
        for place, words in (("mean_load", "mean load"), ("orbit", "orbit")):
            film = both[place]["films"][name]
            (kxx, kxy), (kyx, kyy) = film["stiffness"][0]
            (cxx, _), (_, cyy) = film["damping"][0]
            values = [*(1e-6 * k for k in (kxx, kxy, kyx, kyy)), 1e-3 * cxx, 1e-3 * cyy]
            rows.append((name if place == "mean_load" else "", words, *values))
    numbers = ((name, ".3g") for name in ("kxx", "kxy", "kyx", "kyy", "cxx", "cyy"))
    yield row_table(None, ("Film, MN/m, kN s/m", "At", *numbers), rows, texts=2)


def _peaks(result):
    speeds, rows = result["curves"]["speeds"], []
    for name, orders in result["curves"]["major_axis"].items():
        for n, order in enumerate(result["orders"]):
            known = [one for one in zip(orders[n], speeds, strict=True) if one[0] is not None]
            if known:
                value, at = max(known)
                rows.append((name if n == 0 else "", order, value * 1e6, at * RPM))
    title = f"Largest major axis from {speeds[0] * RPM:.5g} to {speeds[-1] * RPM:.5g} rpm"
    return row_table(title, ("Node", "n", ("µm", ".4g"), ("at rpm", ".5g")), rows, whole=(0,))


def _relative(response: jc.rotor.Response, watched: Watched):
    """(orders, speeds, watched, dof) motion relative to the bases."""
    import numpy as np

    x = np.asarray(response.displacement)
    ground = np.concatenate([x, np.zeros_like(x[..., :1, :])], -2)
    nodes, bases = (np.array(places) for places in zip(*watched.values(), strict=True))
    return ground[..., nodes, :] - ground[..., bases, :]


def _link_name(scene: jc.scene.Scene, number: int, nodes) -> str:
    """A link by its number in the file and its nodes; a film by the name of its bearing as well."""
    law = scene.parts["rotor"].links[number].law  # pyright: ignore[reportAttributeAccessIssue]
    bearing = getattr(getattr(law, "bearing", None), "name", "")
    name = f"{number}: {nodes[0]} to {'ground' if nodes[1] is None else nodes[1]}"
    return f"{name}, {bearing}" if bearing else name
