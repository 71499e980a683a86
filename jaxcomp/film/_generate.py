r"""Offline solution of the Reynolds equation behind the shipped table of `Reynolds`.

Run `python -m jaxcomp.film._generate` to write `reynolds_table.json` anew (needs SciPy; some ten
minutes on one core). Nothing else in the library imports this module.

The steady film of a full, aligned, isoviscous journal bearing obeys (Butenschoen 1976; Raimondi and
Boyd 1958), with h = 1 + eps cos(theta), theta from the line of maximum film with rotation, zeta
from the mid-plane, q = L/D and p in units of eta omega/psi^2,

    (h^3 p_theta)_theta + (1/q^2) (h^3 p_zeta)_zeta = 6 h_theta + 12 v cos(theta),

where v is the radial velocity of the journal in units of c omega. The film starts with p = 0 on the
line of maximum film and ends where p = dp/dn = 0 (Swift-Stieber), which is the complementarity
problem p >= 0, equation >= 0, one of them an equality.

Discretisation: second-order finite volumes on nodes that are uniform in Sommerfeld's angle gamma,
tan(theta/2) = sqrt((1+eps)/(1-eps)) tan(gamma/2), in which p is smooth however thin the film, and
are drawn towards the bearing's end as the end layer gets thin. The complementarity problem is
solved by the primal-dual active set method (Hintermueller, Ito and Kunisch 2003), each step one
banded Cholesky factorisation, grid after grid; two grids are extrapolated by Richardson's rule.
The pressure is divided by eps, so that the concentric bearing is a regular case.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

TABLE = "reynolds_table.json"

S_RANGE = (0.07, 1.0)  # s = sqrt(1 - eps), so eps up to 0.9951
Q_RANGE = (0.1, 2.0)  # q = L/D
NODES = (18, 11)  # in s and in ln q
FRICTION_NODES = 32  # in u = (1 + Phi_p/Phi_p(eps = 1/2))^(-1/4)
GRIDS = ((60, 8), (120, 16), (240, 32), (480, 64))  # cells in gamma, cells in half the length


class Forces(NamedTuple):
    """Film forces over eps and the radial damping, all over eta omega L D/psi^2."""

    radial: float
    tangential: float
    radial_damping: float


class Grid(NamedTuple):
    """Nodes of the film, without the line of maximum film and the bearing's end (p = 0 there)."""

    theta: np.ndarray
    theta_slope: np.ndarray  # d theta/d gamma at the nodes
    weights: np.ndarray  # of the integral over theta and zeta in [0, 1]
    coupling_theta: np.ndarray  # finite-volume coefficients between neighbours in theta ...
    coupling_zeta: np.ndarray  # ... and in zeta
    cells: np.ndarray  # area of the control volumes

    @property
    def shape(self) -> tuple[int, int]:
        return self.weights.shape


def film_grid(eps: float, q: float, n_theta: int, n_zeta: int) -> Grid:
    """Finite-volume coefficients on `n_theta` cells round the ring, `n_zeta` over half a length."""
    stretch = np.sqrt((1 + eps) / (1 - eps))

    def angle(gamma):  # theta(gamma), from 0 to 2 pi without a jump at pi
        return 2 * np.arctan2(stretch * np.sin(gamma / 2), np.cos(gamma / 2))

    def slope(gamma):
        return np.sqrt(1 - eps**2) / (1 - eps * np.cos(gamma))

    # The end layer is sqrt(1 - eps)/q of the half-length thick once that is below one.
    pull = 1.3 * np.arcsinh(0.4 * q / np.sqrt(1 - eps))

    def place(t):
        return np.tanh(pull * t) / np.tanh(pull)

    def place_slope(t):
        return pull / np.cosh(pull * t) ** 2 / np.tanh(pull)

    dg, dt = 2 * np.pi / n_theta, 1 / n_zeta
    gamma = dg * np.arange(1, n_theta)
    t = dt * np.arange(n_zeta)
    half = np.where(t == 0, 0.5, 1.0)  # the control volume on the mid-plane is cut in half
    faces_g = dg * (np.arange(n_theta) + 0.5)
    faces_t = dt * (np.arange(n_zeta) + 0.5)

    h, h_face = 1 + eps * np.cos(angle(gamma)), 1 + eps * np.cos(angle(faces_g))
    width_z = place_slope(t) * half * dt
    cells = np.outer(slope(gamma) * dg, width_z)
    return Grid(
        theta=angle(gamma),
        theta_slope=slope(gamma),
        weights=cells,
        coupling_theta=np.outer(h_face**3 / (slope(faces_g) * dg), width_z),
        coupling_zeta=np.outer(h**3 * slope(gamma) * dg, 1 / (place_slope(faces_t) * dt)) / q**2,
        cells=cells,
    )


def solve_pressure(grid: Grid, turn: float, film: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pressure over eps, and where the film is, starting from the guess `film`.

    `turn` is 2 v/eps, by which a radial velocity turns the wedge. Ahead of theta = pi/2 the film is
    taken as given, so that the response to a velocity keeps the steady start of the film.
    """
    from scipy.linalg import solveh_banded

    n, m = grid.shape
    source = (6 * np.sin(grid.theta) - 6 * turn * np.cos(grid.theta))[:, None] * grid.cells
    diagonal = grid.coupling_theta[:-1] + grid.coupling_theta[1:] + grid.coupling_zeta
    diagonal[:, 1:] += grid.coupling_zeta[:, :-1]
    always = (grid.theta < np.pi / 2)[:, None] & np.ones(m, bool)
    film = film | always
    for _ in range(300):
        rows = int(np.flatnonzero(film.any(axis=1))[-1]) + 1
        inside = film[:rows]
        bands = np.zeros((m + 1, rows, m))
        bands[m] = np.where(inside, diagonal[:rows], 1.0)
        if m > 1:
            both = inside[:, :-1] & inside[:, 1:]
            bands[m - 1, :, 1:] = -np.where(both, grid.coupling_zeta[:rows, :-1], 0.0)
        both = inside[:-1] & inside[1:]
        bands[0, 1:] = -np.where(both, grid.coupling_theta[1:rows], 0.0)
        right = np.where(inside, source[:rows], 0.0)
        p = np.zeros((n, m))
        p[:rows] = solveh_banded(
            bands.reshape(m + 1, -1), right.ravel(), overwrite_ab=True, check_finite=False
        ).reshape(rows, m)
        new = always | np.where(film, p > 0, _residual(grid, diagonal, p) < source)
        if np.array_equal(new, film):
            return p, film
        film = new
    raise RuntimeError("The active set did not settle.")


def _residual(grid: Grid, diagonal: np.ndarray, p: np.ndarray) -> np.ndarray:
    r = diagonal * p
    r[1:] -= grid.coupling_theta[1:-1] * p[:-1]
    r[:-1] -= grid.coupling_theta[1:-1] * p[1:]
    r[:, 1:] -= grid.coupling_zeta[:, :-1] * p[:, :-1]
    r[:, :-1] -= grid.coupling_zeta[:, :-1] * p[:, 1:]
    return r


def pressure_forces(grid: Grid, p: np.ndarray) -> np.ndarray:
    """F_r/eps and F_t/eps of a pressure over eps."""
    trig = np.stack([np.cos(grid.theta), np.sin(grid.theta)])
    return 0.5 * trig @ (grid.weights * p).sum(axis=1)


def solve_forces(eps: float, q: float, grids=GRIDS) -> Forces:
    """Forces and radial damping at one position, extrapolated from the last two grids."""
    # Steps of the radial velocity, in the natural unit of the thin zone. Central differences with
    # two steps are extrapolated as well. Much smaller steps would show the staircase of the film's
    # edge, which follows the grid.
    step = 0.05 * np.sqrt(1 - eps)
    film, values = None, []
    for n_theta, n_zeta in grids:
        grid = film_grid(eps, q, n_theta, n_zeta)
        if film is None:
            film = np.broadcast_to((grid.theta < np.pi)[:, None], grid.shape)
        else:
            film = _refined(film, grid.shape)
        p, film = solve_pressure(grid, 0.0, film)
        values.append([*pressure_forces(grid, p), np.nan])
        if (n_theta, n_zeta) not in grids[-2:]:
            continue
        slopes = []
        for turn in (step, 2 * step):
            ahead = pressure_forces(grid, solve_pressure(grid, turn, film)[0])[0]
            behind = pressure_forces(grid, solve_pressure(grid, -turn, film)[0])[0]
            # F_r = eps G(2 v/eps), so dF_r/dv = 2 G'
            slopes.append((ahead - behind) / turn)
        values[-1][2] = -(4 * slopes[0] - slopes[1]) / 3
    coarse, fine = np.array(values[-2]), np.array(values[-1])
    return Forces(*(float(v) for v in (4 * fine - coarse) / 3))


def _refined(film: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The film of a grid carried over to the grid of half the spacing."""
    rows = np.minimum(np.maximum((np.arange(shape[0]) + 1) // 2 - 1, 0), film.shape[0] - 1)
    return film[np.ix_(rows, np.arange(shape[1]) // 2)]


def chebyshev_nodes(interval: tuple[float, float], n: int) -> np.ndarray:
    """Chebyshev's points of the first kind on an interval."""
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


def tabulated(eps: float, q: float, forces: Forces) -> tuple[float, float, float]:
    """The three smooth quantities of the table: load, attitude angle and radial damping.

    The logarithms of Phi_p (1 - eps)/(eps q^2) and of C_rr (1 - eps)^1.5/q^2, and the angle in rad.
    """
    load = np.log(np.hypot(forces.radial, forces.tangential) * (1 - eps) / q**2)
    attitude = np.arctan2(forces.tangential, -forces.radial)
    damping = np.log(forces.radial_damping * (1 - eps) ** 1.5 / q**2)
    return float(load), float(attitude), float(damping)


def solve_table(progress=print) -> dict:
    """Solve the film on the nodes of the table and fit it."""
    ln_q = np.log(np.array(Q_RANGE))
    s_nodes = chebyshev_nodes(S_RANGE, NODES[0])
    q_nodes = np.exp(chebyshev_nodes(tuple(ln_q), NODES[1]))
    values = np.empty((3, *NODES))
    for i, s in enumerate(s_nodes):
        for j, q in enumerate(q_nodes):
            values[:, i, j] = tabulated(1 - s**2, q, solve_forces(1 - s**2, q))
        progress(f"s = {s:.4f} ({i + 1} of {NODES[0]})")
    fits = [chebyshev_coefficients(v) for v in values]
    return {
        "s_range": list(S_RANGE),
        "ln_q_range": [float(v) for v in ln_q],
        **dict(zip(("load", "attitude", "damping"), fits, strict=True)),
    }


def fit_friction(table: dict, nodes: int = FRICTION_NODES) -> np.ndarray:
    """The series P(u, ln q) of `Reynolds.friction_number`, from the solved part of the table."""
    import jax

    from ._film import film_ratio, friction_at
    from ._reynolds import Reynolds

    u = chebyshev_nodes((0.0, 1.0), nodes)
    q = np.exp(chebyshev_nodes(tuple(table["ln_q_range"]), NODES[1]))
    empty = {**table, "friction": np.zeros((1, 1))}

    def column(q):
        film = Reynolds(q, table=empty)
        loads = film.friction_scale * (1 / u**4 - 1)
        return jax.vmap(lambda load: friction_at(film, film_ratio(film, load)))(loads)

    friction = np.array(jax.vmap(column)(q)).T
    u = u[:, None]
    return chebyshev_coefficients((np.log(friction * u**2 / np.pi) + 2 * (1 - u)) / (1 - u) ** 2)


def main() -> None:
    """Solve, fit and write the table next to this module."""
    write_table(solve_table())


def write_table(table: dict) -> None:
    """Add the friction series to a solved table and write it."""
    table = {**table, "friction": fit_friction(table)}
    parts = []
    for name, value in table.items():
        rows = [value] if name.endswith("range") else value
        lines = ["[" + ", ".join(f"{c:.10g}" for c in row) + "]" for row in rows]
        body = lines[0] if name.endswith("range") else "[\n" + ",\n".join(lines) + "\n]"
        parts.append(f'"{name}": {body}')
    text = "{\n" + ",\n".join(parts) + "\n}\n"
    json.loads(text)  # what cannot be read back is not written
    Path(__file__).with_name(TABLE).write_text(text)


if __name__ == "__main__":
    main()
