r"""Generate the tables of `Reynolds` and `GroovedReynolds` in `jaxcomp/film`.

Run `python tests/tools/film_tables.py` to write both data files anew (some five minutes on one core),
or with the name of one of them. Reynolds' equation is solved by `jaxcomp.film._reference` on
Chebyshev points.
"""

import json
import math
import sys
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from jaxcomp import film as films
from jaxcomp.film import GroovedReynolds, Reynolds
from jaxcomp.film import _finite_volumes as volumes
from jaxcomp.film import _reference as reference
from jaxcomp.film._film import film_ratio, friction_at
from jaxcomp.film._reference import GRIDS
from jaxcomp.film._tabulated import AbstractTabulatedFilm, place_of

DATA = Path(films.__file__).parent

S_RANGE = (0.07, 1.0)  # s = sqrt(1 - eps), so eps up to 0.9951
Q_RANGE = (0.1, 2.0)  # q = L/D
NODES = (18, 11)  # in s and in ln q
GROOVED_NODES = (44, 16)
GROOVED_TERMS = (36, 14)  # the terms beyond hold little but the noise of the film's edge
CORNER_NODES = 8  # in ln q
FRICTION_NODES = 32  # in u = (1 + Phi_p/Phi_p(eps = 1/2))^(-1/4)
FAMILIES = (Reynolds, GroovedReynolds)


class Forces(NamedTuple):
    """Film at one position; forces over eps, all over eta omega L D/psi^2.

    Attributes:
        radial: F_r/eps.
        tangential: F_t/eps.
        radial_damping: C_rr.
        radial_stiffness: K_rr and K_tr of a film that moves with the journal.
        attitude_angle: [rad] phi.
    """

    radial: float
    tangential: float
    radial_damping: float
    radial_stiffness: tuple[float, float]
    attitude_angle: float


def solve_forces(eps: float, q: float, grids=GRIDS, *, grooved: bool = False) -> Forces:
    """Forces, radial stiffness and damping at one position, extrapolated from two grids."""
    phi = reference.groove_attitude(eps, q, grids[:-1]) if grooved else None
    fields = reference._fields(eps, q, reference.pads(phi), grids, False)[-2:]
    radial, tangential = reference._extrapolated(
        np.array([reference._total(field) for field in fields])
    ).tolist()
    slopes = reference._extrapolated(
        np.array([reference._response(eps, field) for field in fields])
    )
    return Forces(
        radial,
        tangential,
        radial_damping=float(-2 * slopes[1, 0]),  # F_r = eps G(2 v/eps), so dF_r/dv = 2 G'
        radial_stiffness=(float(-slopes[0, 0]), float(-slopes[0, 1])),
        attitude_angle=math.atan2(tangential, -radial),
    )


def groove_contact(q: float, grids=((120, 8), (240, 16))) -> float:
    """Eccentricity ratio up to which the film of the mid-plane fills the loaded pad to its end."""
    low, high = 0.0, 0.7
    for _ in range(14):
        eps = 0.5 * (low + high)
        phi = reference.groove_attitude(eps, q, grids)
        (grid, p, film), _ = reference._fields(eps, q, reference.pads(phi), grids, False)[-1]
        if volumes.film_end(grid, p, film)[0] > grid.shape[0] + 1 - 1e-9:
            low = eps
        else:
            high = eps
    return 0.5 * (low + high)


def chebyshev_nodes(interval: tuple[float, float], n: int) -> np.ndarray:
    """Chebyshev points of the first kind on an interval."""
    points = np.polynomial.chebyshev.chebpts1(n)
    return 0.5 * (interval[0] + interval[1]) + 0.5 * (interval[1] - interval[0]) * points


def chebyshev_coefficients(values: np.ndarray) -> np.ndarray:
    """Coefficients of the tensor polynomial through values on the nodes of both axes."""
    for axis in range(2):
        n = values.shape[axis]
        points = np.polynomial.chebyshev.chebpts1(n)
        matrix = np.linalg.inv(np.polynomial.chebyshev.chebvander(points, n - 1))
        values = np.moveaxis(np.tensordot(matrix, values, axes=(1, axis)), 0, axis)
    return values


def tabulated(eps: float, q: float, forces: Forces) -> list[float]:
    """The smooth quantities of the tables: load, attitude angle, radial damping and stiffness.

    The logarithms of Phi_p (1 - eps)/(eps q^2) and of C_rr (1 - eps)^1.5/q^2, the angle in rad, and
    K_rr and K_tr, times (1 - eps)/(Phi_p/eps).
    """
    size = np.hypot(forces.radial, forces.tangential)
    load = np.log(size * (1 - eps) / q**2)
    damping = np.log(forces.radial_damping * (1 - eps) ** 1.5 / q**2)
    stiffness = np.array(forces.radial_stiffness) * (1 - eps) / size
    return [float(load), forces.attitude_angle, float(damping), *stiffness.tolist()]


def solve_table(family: type[AbstractTabulatedFilm], progress=print) -> dict:
    """Solve the film on the nodes of the table and fit it."""
    ln_q = np.log(np.array(Q_RANGE))
    grooved = family is GroovedReynolds
    nodes = GROOVED_NODES if grooved else NODES
    table = {"s_range": list(S_RANGE), "ln_q_range": [float(v) for v in ln_q]}
    if grooved:
        at = chebyshev_nodes(tuple(ln_q), CORNER_NODES)
        corners = [[np.log(groove_contact(float(q))) for q in np.exp(at)]]
        table["corner"] = chebyshev_coefficients(np.array(corners))
    values = np.empty((5, *nodes))
    for j, at in enumerate(chebyshev_nodes(tuple(ln_q), nodes[1])):
        q = float(np.exp(at))
        s = np.asarray(place_of(table, at).back(chebyshev_nodes((-1, 1), nodes[0])))
        for i, eps in enumerate((1 - s**2).tolist()):
            values[:, i, j] = tabulated(eps, q, solve_forces(eps, q, GRIDS, grooved=grooved))
        progress(f"{family.__name__}: L/D = {q:.4f} ({j + 1} of {nodes[1]})")
    kept = GROOVED_TERMS if grooved else nodes
    fits = [chebyshev_coefficients(v)[: kept[0], : kept[1]] for v in values]
    names = ("load", "attitude", "damping") + ("stiffness_r", "stiffness_t") * grooved
    return {**table, **dict(zip(names, fits[: len(names)], strict=True))}


def fit_friction(
    family: type[AbstractTabulatedFilm], table: dict, nodes: int = FRICTION_NODES
) -> np.ndarray:
    """The series P(u, ln q) of `friction_number`, from the solved part of the table."""
    u = chebyshev_nodes((0.0, 1.0), nodes)
    q = np.exp(chebyshev_nodes(tuple(table["ln_q_range"]), NODES[1]))
    empty = {**table, "friction": np.zeros((1, 1))}

    def column(q):
        film = family(q, table=empty)
        loads = film.friction_scale * (1 / u**4 - 1)
        return jax.vmap(lambda load: friction_at(film, film_ratio(film, load)))(loads)

    friction = np.array(jax.vmap(column)(q)).T
    u = u[:, None]
    return chebyshev_coefficients((np.log(friction * u**2 / np.pi) + 2 * (1 - u)) / (1 - u) ** 2)


def main(names: list[str]) -> None:
    """Solve, fit and write the tables into the package."""
    for family in FAMILIES:
        if not names or family.__name__ in names:
            write_table(family, solve_table(family))


def write_table(family: type[AbstractTabulatedFilm], table: dict) -> None:
    """Add the friction series to a solved table and write it."""
    table = {**table, "friction": fit_friction(family, table)}
    parts = []
    for name, value in table.items():
        rows = [value] if name.endswith("range") else value
        lines = ["[" + ", ".join(f"{c:.10g}" for c in row) + "]" for row in rows]
        body = lines[0] if name.endswith("range") else "[\n" + ",\n".join(lines) + "\n]"
        parts.append(f'"{name}": {body}')
    text = "{\n" + ",\n".join(parts) + "\n}\n"
    json.loads(text)  # what cannot be read back is not written
    (DATA / family.table_name).write_text(text)


if __name__ == "__main__":
    main(sys.argv[1:])
