r"""Generate the table of `ReynoldsSqueeze` in `jaxcomp/film`: films of a moving journal, edges free.

Run `python tests/tools/squeeze_tables.py` to write the data file anew (some ten minutes on one core with
OMP_NUM_THREADS=1). With theta from the line of minimum film, h = 1 - eps cos(theta), zeta from the
mid-plane, q = L/D and a velocity V of unit size at the angle gamma,

    (h^3 p_theta)_theta + (1/q^2) (h^3 p_zeta)_zeta = -12 cos(theta - gamma),  p >= 0,

is solved as a complementarity problem by finite volumes and the primal-dual active set method. The nodes
are drawn towards the thinnest film and the bearing's end; forces are extrapolated from two grids.
"""

import json
import sys
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from scipy.linalg import solveh_banded

from jaxcomp import film as films
from jaxcomp.film._squeeze_table import TABLE, TABLE_RANGE, film_corner, peak_unit, resistance_unit

GRIDS = ((120, 8), (240, 16), (480, 32))  # cells round the ring, cells over half the length
LENGTH_RATIOS = 12  # Chebyshev points in ln q
PLACES = (22, 24, 13)  # eccentricities, directions of load, directions of velocity
LAST = 0.9995  # eccentricity ratio
TERMS = {"mobility": (11, 12, 9), "peak": (10, 11, 7), "flow": (8, 8, 6)}  # in u, v and ln q
# Decimals of the logarithms: a hundredth of what the series leave open.
DECIMALS = {"mobility": 7, "peak": 5, "flow": 5}


class Film(NamedTuple):
    """A film under a unit velocity.

    Attributes:
        force: W_r and W_t, over eta L D/psi^2 and the velocity over c.
        flow: through both ends, over R L c and the velocity.
        peak: [-] largest pressure over eta/psi^2 and the velocity.
    """

    force: np.ndarray
    flow: float
    peak: float


def solve_film(eps: float, q: float, gamma: float, grids=GRIDS) -> Film:
    """The film at an eccentricity ratio, L/D and angle of the velocity [rad]."""
    film, found = None, []
    for n, m in grids:
        theta, areas, along, across, end = _cells(eps, q, gamma, n, m)
        source = 12 * np.cos(theta - gamma)[:, None] * areas
        if film is None:
            film = source > 0
        else:
            rows = np.clip(np.arange(1, n) // 2 - 1 + np.arange(1, n) % 2, 0, film.shape[0] - 1)
            film = film[np.ix_(rows, np.arange(m) // 2)]
        p, film = _solve(along, across, source, film)
        force = 0.5 * np.stack([np.cos(theta), np.sin(theta)]) @ (areas * p).sum(axis=1)
        beyond = np.where(film[:, -1], 12 * np.cos(theta - gamma) * end, 0.0)
        flow = np.sum(across[:, -1] * p[:, -1] + beyond) / 12
        i = int(np.clip(np.argmax(p[:, 0]), 1, n - 3))
        below, top, above = p[i - 1 : i + 2, 0]
        peak = top - (above - below) ** 2 / (8 * (below - 2 * top + above))
        found.append(np.array([*force, flow, peak]))
    *force, flow, peak = (4 * found[-1] - found[-2]) / 3
    return Film(np.array(force), flow, peak)


def _cells(eps: float, q: float, gamma: float, n: int, m: int):
    """Nodes, areas and couplings; the ring is cut opposite to the velocity, where there is no film."""
    draw = ((1 + eps) / (1 - eps)) ** -0.25  # half of Sommerfeld's: the wide side has films as well

    def angle(g, a):
        s, c = np.sin(g / 2), np.cos(g / 2)
        return g + 2 * np.arctan2((a - 1) * s * c, c * c + a * s * s)

    def slope(g):
        return draw / (np.cos(g / 2) ** 2 + (draw * np.sin(g / 2)) ** 2)

    pull = 1.3 * np.arcsinh(0.4 * q / np.sqrt(1 - eps))

    def place(t):
        return np.tanh(pull * t) / np.tanh(pull)

    def place_slope(t):
        return pull / np.cosh(pull * t) ** 2 / np.tanh(pull)

    dg, t, between = 2 * np.pi / n, np.arange(m) / m, (np.arange(m) + 0.5) / m
    g = angle(gamma - np.pi, 1 / draw) + dg * np.arange(1, n)
    faces = g[0] + dg * (np.arange(n) - 0.5)
    theta, h_face = angle(g, draw), 1 - eps * np.cos(angle(faces, draw))
    width = place_slope(t) * np.where(t == 0, 0.5, 1.0) / m
    along = np.outer(h_face**3 / (slope(faces) * dg), width)
    h = 1 - eps * np.cos(theta)
    across = np.outer(h**3 * slope(g) * dg, m / place_slope(between)) / q**2
    end = slope(g) * dg * (1 - place(between[-1]))
    return theta, np.outer(slope(g) * dg, width), along, across, end


def _solve(along, across, source, film) -> tuple[np.ndarray, np.ndarray]:
    """Pressure, and where the film is, starting from the guess `film`."""
    n, m = source.shape
    diagonal = along[:-1] + along[1:] + across
    diagonal[:, 1:] += across[:, :-1]
    for _ in range(200):
        rows = np.flatnonzero(film.any(axis=1))
        part = slice(rows[0], rows[-1] + 1)
        inside = film[part]
        bands = np.zeros((m + 1, *inside.shape))
        bands[m] = np.where(inside, diagonal[part], 1.0)
        bands[m - 1, :, 1:] = -np.where(inside[:, :-1] & inside[:, 1:], across[part, :-1], 0.0)
        links = along[rows[0] + 1 : rows[-1] + 1]
        bands[0, 1:] = -np.where(inside[:-1] & inside[1:], links, 0.0)
        right = np.where(inside, source[part], 0.0).ravel()
        p = np.zeros((n, m))
        p[part] = solveh_banded(bands.reshape(m + 1, -1), right, check_finite=False).reshape(-1, m)
        rest = diagonal * p
        rest[1:] -= along[1:-1] * p[:-1]
        rest[:-1] -= along[1:-1] * p[1:]
        rest[:, 1:] -= across[:, :-1] * p[:, :-1]
        rest[:, :-1] -= across[:, :-1] * p[:, 1:]
        new = np.where(film, p > 0, rest < source)
        if np.array_equal(new, film):
            return p, film
        film = new
    raise RuntimeError("The active set did not settle.")


def directions(eps: float, count: int) -> np.ndarray:
    """[rad] Angles of the load, over the half circle and about the corner of the closing film."""
    share = np.polynomial.chebyshev.chebpts2(count // 2) / 2 + 0.5
    tangent = np.tan(share[1:-1] * np.arctan(eps / np.sqrt(1 - eps**2)))
    near = np.arcsin(np.clip(tangent * np.sqrt(1 - eps**2) / eps, 0, 1))
    return np.sort(np.concatenate([np.pi * share, near, np.pi - near[: count % 2 + 2]]))


def sampled(q: float) -> np.ndarray:
    """Rows (eps, phi, ln of H, peak and flow over their units, d ln H/d phi) of films of one L/D."""
    ends = np.sqrt(1 - LAST), 1.0
    s = ends[0] + (ends[1] - ends[0]) * (np.polynomial.chebyshev.chebpts2(PLACES[0]) + 1) / 2
    places = np.array([
        (eps, phi)
        for eps in np.maximum(1 - s**2, 1e-6).tolist()
        for phi in directions(eps, PLACES[1])
    ])  # fmt: skip
    # directions of velocity that give about these directions of load, from the short film
    way = np.stack([np.cos(places[:, 1]), np.sin(places[:, 1])])
    position = np.stack([places[:, 0], 0 * places[:, 0]])
    velocities = np.asarray(eqx.filter_jit(films.OcvirkSqueeze(q).mobility)(position, way))
    # and directions of velocity of their own, for the side flow
    gammas = np.linspace(0, np.pi, PLACES[2])
    even = np.stack([np.cos(gammas), np.sin(gammas)])
    among = np.maximum(1 - s**2, 1e-6)
    eccentricities = [*places[:, 0].tolist(), *np.repeat(among, PLACES[2]).tolist()]
    rows = []
    for eps, velocity in zip(
        eccentricities, (*velocities.T, *np.tile(even, PLACES[0]).T), strict=True
    ):
        v = velocity / np.linalg.norm(velocity)
        film = solve_film(eps, q, float(np.arctan2(v[1], v[0])))
        size = np.linalg.norm(film.force)
        f = film.force / size
        h, across = v @ f / size, 2 * (f[0] * v[1] - f[1] * v[0]) / size
        rows.append([eps, *f, h, across / h, film.peak / size, film.flow])
    return np.array(rows)


def fitted(q: float, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Coefficients in u and v of the three logarithms at one L/D."""
    eps, fx, fy, h, slope, peak, flow = rows.T
    x = eps * fx
    u, v = film_corner(x, eps**2)
    unit, turn = resistance_unit(x, q), -eps * fy  # dx/dphi
    terms = TERMS["mobility"][:2]

    along_v = np.hypot(1, slope / 2)
    flow_place = film_corner(eps * (fx - slope / 2 * fy) / along_v, eps**2)  # of the velocity

    def basis(u, v, order=(0, 0), terms=terms):
        cheb = np.polynomial.chebyshev
        both = []
        for t, d, n in zip((2 * u - 1, 2 * v - 1), order, terms, strict=True):
            c = np.eye(n) if not d else cheb.chebder(np.eye(n)) * 2
            both.append(cheb.chebval(t, c).T)
        return (both[0][:, :, None] * both[1][:, None, :]).reshape(u.size, -1)

    # Fit ln H and its slope, whose error turns the mobility by half as much.
    step = 1e-6
    slope_unit = (np.log(resistance_unit(x + step, q)) - np.log(resistance_unit(x - step, q))) / (
        2 * step
    )
    u_x, v_x = -u / (4 * (1 - x)), v * x / (1 - x**2)
    along = (basis(u, v, (1, 0)) * u_x[:, None] + basis(u, v, (0, 1)) * v_x[:, None]) * turn[
        :, None
    ]
    share = np.tile(1 / np.sqrt(1 + (slope / 2) ** 2), 2)  # of the mobility's size
    matrix = np.concatenate([basis(u, v), 0.5 * along]) * share[:, None]
    right = np.concatenate([np.log(h / unit), 0.5 * (slope - slope_unit * turn)]) * share
    fit = {"mobility": np.linalg.lstsq(matrix, right, rcond=None)[0].reshape(terms)}
    left = matrix @ fit["mobility"].ravel() - right
    worst = np.hypot(*left.reshape(2, -1))
    print(f"L/D {q:.4f}: mobility {worst.max():.1e} ({np.sqrt(np.mean(worst**2)):.1e})", end="")
    places = {"peak": ((u, v), peak / peak_unit(x)), "flow": (flow_place, flow)}
    for name, (place, value) in places.items():
        matrix, right = basis(*place, terms=TERMS[name][:2]), np.log(value)
        fit[name] = np.linalg.lstsq(matrix, right, rcond=None)[0].reshape(TERMS[name][:2])
        left = matrix @ fit[name].ravel() - right
        print(f", {name} {np.abs(left).max():.1e} ({np.sqrt(np.mean(left**2)):.1e})", end="")
    print(flush=True)
    return fit


def main() -> None:
    """Solve, fit and write the table into the package."""
    ends, points = np.log(np.array(TABLE_RANGE)), np.polynomial.chebyshev.chebpts1(LENGTH_RATIOS)
    q = np.exp(ends.mean() + (ends[1] - ends[0]) / 2 * points)
    cache = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    if cache is not None and cache.exists():
        rows = np.load(cache)
    else:
        rows = np.stack([sampled(float(one)) for one in q])
        if cache is not None:
            np.save(cache, rows)
    fits = [fitted(float(one), each) for one, each in zip(q, rows, strict=True)]
    table: dict = {"ln_q_range": ends.tolist()}
    back = np.linalg.inv(np.polynomial.chebyshev.chebvander(points, LENGTH_RATIOS - 1))
    for name, terms in TERMS.items():
        values = np.stack([fit[name] for fit in fits], axis=-1)
        table[name] = (values @ back.T)[..., : terms[2]]
    Path(films.__file__).parent.joinpath(TABLE).write_text(written(table))


def written(table: dict) -> str:
    """The text of the data file: a row for each place of the first axis."""
    parts = [f'"ln_q_range": {json.dumps(table["ln_q_range"])}']
    for name in TERMS:
        rows = (json.dumps(np.round(row, DECIMALS[name]).tolist()) for row in table[name])
        parts.append(f'"{name}": [\n' + ",\n".join(rows) + "\n]")
    return "{\n" + ",\n".join(parts) + "\n}\n"


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
