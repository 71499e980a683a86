r"""Finite volumes for Reynolds' equation, as it stands at the head of `_reference` (NumPy and SciPy).

Second order, on nodes that are uniform in Sommerfeld's angle gamma,
tan(theta/2) = sqrt((1+eps)/(1-eps)) tan(gamma/2), in which p is smooth however thin the film, and
are drawn towards the bearing's end as the end layer gets thin. The complementarity problem is
solved by the primal-dual active set method (Hintermueller, Ito and Kunisch 2003), each step one
banded Cholesky factorisation, grid after grid.

Stiffness and damping of the Swift-Stieber film follow from the linear response of the pressure,
which vanishes on the steady edge of the film (Lund 1966): the edge moves by second order only. The
active set shows the edge as a staircase; where it lies within a cell follows from the share of the
wedge's flow that the cell takes up. Links cut by the edge are shortened (Gibou, Fedkiw, Cheng and
Kang 2002), which keeps the matrix symmetric and the error of second order.
"""

import math
from typing import NamedTuple

import numpy as np

RING = (0.0, 2 * math.pi, 1.0)  # first and last theta of a pad, share of the cells


class Grid(NamedTuple):
    """Nodes of one pad, without its edges and the bearing's end (p = 0 there)."""

    theta: np.ndarray
    theta_faces: np.ndarray  # between the nodes
    theta_slope: np.ndarray  # d theta/d gamma at the nodes
    zeta: np.ndarray
    weights: np.ndarray  # of the integral over theta and zeta in [0, 1]
    coupling_theta: np.ndarray  # finite-volume coefficients between neighbours in theta ...
    coupling_zeta: np.ndarray  # ... and in zeta
    end: np.ndarray  # area of the half cells at the bearing's end
    starts_freely: bool  # the film reaches the last edge of the pad instead of the first

    @property
    def shape(self) -> tuple[int, int]:
        return self.weights.shape


def film_grid(
    eps: float, q: float, n_theta: int, n_zeta: int, pad=RING, *, closed: bool = False
) -> Grid:
    """Finite-volume coefficients on `n_theta` cells round the ring, `n_zeta` over half a length.

    A closed ring has the line of maximum film among its nodes.
    """
    first, end, share = pad
    n_theta = round(share * n_theta)
    stretch = np.sqrt((1 + eps) / (1 - eps))

    # Even in Sommerfeld's angle, which puts nodes where a thin film's pressure is.
    def angle(gamma, stretch=stretch):  # theta(gamma), without a jump at pi and beyond 2 pi
        s = np.sin(gamma / 2)
        c = np.cos(gamma / 2)
        return gamma + 2 * np.arctan2((stretch - 1) * s * c, c * c + stretch * s * s)

    def slope(gamma):
        return np.sqrt(1 - eps**2) / (1 - eps * np.cos(gamma))

    # The end layer is sqrt(1 - eps)/q of the half-length thick once that is below one.
    pull = 1.3 * np.arcsinh(0.4 * q / np.sqrt(1 - eps))

    def place(t):
        return np.tanh(pull * t) / np.tanh(pull)

    def place_slope(t):
        return pull / np.cosh(pull * t) ** 2 / np.tanh(pull)

    # The inverse of Sommerfeld's angle is the same formula with the inverse stretch.
    start = angle(first, 1 / stretch)
    dg = (angle(end, 1 / stretch) - start) / n_theta
    dt = 1 / n_zeta
    gamma = start + dg * np.arange(0 if closed else 1, n_theta)
    t = dt * np.arange(n_zeta)
    half = np.where(t == 0, 0.5, 1.0)  # the control volume on the mid-plane is cut in half
    faces_g = start + dg * (np.arange(n_theta) + 0.5)
    faces_t = dt * (np.arange(n_zeta) + 0.5)

    theta = angle(gamma)
    between = angle(faces_g)
    h = 1 + eps * np.cos(theta)
    h_face = 1 + eps * np.cos(between)
    width_z = place_slope(t) * half * dt
    # Flows take h at the faces between the cells: what leaves one cell enters the next, so that oil is
    # conserved on any grid.
    return Grid(
        theta=theta,
        theta_faces=between,
        theta_slope=slope(gamma),
        zeta=place(t),
        weights=np.outer(slope(gamma) * dg, width_z),
        coupling_theta=np.outer(h_face**3 / (slope(faces_g) * dg), width_z),
        coupling_zeta=np.outer(h**3 * slope(gamma) * dg, 1 / (place_slope(faces_t) * dt)) / q**2,
        end=slope(gamma) * dg * (1 - place(faces_t[-1])),
        starts_freely=first > np.pi,
    )


def solve_pressure(grid: Grid, film: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Swift-Stieber pressure over eps, and where the film is, starting from the guess `film`."""
    source = _wedge(grid)
    diagonal = _diagonal(grid)
    # An active set: each pass solves its film exactly, so that a film that stays is the solution.
    for _ in range(300):
        p = _within(grid, film, diagonal, source[..., None])[..., 0]
        # A node leaves the film where its pressure is negative, and joins it where more oil comes
        # in by the wedge than flows off.
        new = np.where(film, p > 0, _residual(grid, diagonal, p) < source)
        if np.array_equal(new, film):
            return p, film
        film = new
    raise RuntimeError("The active set did not settle.")


def solve_ring(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Pressure of the whole closed ring: the steady one over eps, and that of a unit turn."""
    # A closed ring has no narrow band: its last nodes are neighbours of the first.
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    n, m = grid.shape
    number = np.arange(n * m).reshape(n, m)
    onward = np.roll(number, -1, axis=0)
    outward = number[:, 1:]
    rows = [number, onward, number[:, :-1], outward]
    columns = [onward, number, outward, number[:, :-1]]
    links = [-grid.coupling_theta] * 2 + [-grid.coupling_zeta[:, :-1]] * 2
    diagonal = grid.coupling_theta + np.roll(grid.coupling_theta, 1, axis=0) + grid.coupling_zeta
    diagonal[:, 1:] += grid.coupling_zeta[:, :-1]

    def joined(parts, of_diagonal):
        return np.concatenate([part.ravel() for part in (*parts, of_diagonal)])

    i = joined(rows, number)
    j = joined(columns, number)
    value = joined(links, diagonal)
    waves = np.stack([np.sin(grid.theta), -np.cos(grid.theta)], axis=-1)
    source = 6 * waves[:, None, :] * grid.weights[:, :, None]
    pressures = splu(coo_array((value, (i, j))).tocsc()).solve(source.reshape(-1, 2))
    return pressures[:, 0].reshape(n, m), pressures[:, 1].reshape(n, m)


def film_end(grid: Grid, p: np.ndarray, film: np.ndarray) -> np.ndarray:
    """Where a film that begins at the first edge of its pad ends, column by column.

    In spacings from that edge. In the first cell without pressure the wedge takes up what flows in
    over part of the cell: that part is film. (In one dimension this is exact.)
    """
    source = _wedge(grid)
    took = _residual(grid, _diagonal(grid), p)
    behind = ~film & (source < 0)
    share = np.where(behind, np.clip(took / np.where(behind, source, -1.0), 0.0, 1.0), film)
    end = 0.5 + share.sum(axis=0)
    # the half cell at the last edge: filled, or with the film's end in it
    in_last_cell = grid.shape[0] + 0.5 + grid.coupling_theta[-1] * p[-1] / np.abs(source[-1])
    return np.where(film[-1], np.minimum(in_last_cell, grid.shape[0] + 1), end)


def linear_response(eps: float, grid: Grid, p: np.ndarray, film: np.ndarray) -> np.ndarray:
    """Slopes of the forces over eps (first row) and over the revolution 2 v/eps of the wedge (second).

    Columns F_r and F_t; of the pressure and of the pressure over eps. The pad stays where it is
    against the line of centres.
    """
    if not film.any():
        return np.zeros((2, 2))
    # Turned round, this film too begins at the first edge and has its free end behind.
    if grid.starts_freely:
        grid = _reversed(grid)
        p = p[::-1]
        film = film[::-1]
    n, m = grid.shape
    along = grid.coupling_theta
    outward = grid.coupling_zeta
    gap = film_end(grid, p, film) - np.arange(1.0, n + 1)[:, None]  # in spacings in theta
    inside = gap > 1e-9
    short = 1e-6  # a node so near to the edge has no pressure

    # the matrix: whole links within the film, shortened ones over its edge
    link = np.where(inside[1:] & inside[:-1], along[1:-1], 0.0)
    link_out = np.where(inside[:, 1:] & inside[:, :-1], outward[:, :-1], 0.0)
    diagonal = np.zeros((n, m))
    diagonal[0] = along[0]
    diagonal[1:] += link
    diagonal[:-1] += link
    diagonal[:, 1:] += link_out
    diagonal[:, :-1] += link_out
    diagonal[:, -1] += outward[:, -1]
    ends = inside & ~np.vstack([inside[1:], np.zeros((1, m), bool)])
    to_edge = np.where(ends, np.clip(gap, short, 1.0), 1.0)
    diagonal += np.where(ends, along[1:] / to_edge, 0.0)
    # in zeta the edge lies where the line between the ends of two columns crosses the row
    fall = gap[:, :-1] - gap[:, 1:]
    fall = np.where(fall == 0, 1.0, fall)
    cut = inside[:, :-1] & ~inside[:, 1:]
    distance = np.where(cut, np.clip(gap[:, :-1] / fall, short, 1.0), 1.0)
    diagonal[:, :-1] += np.where(cut, outward[:, :-1] / distance, 0.0)
    cut = inside[:, 1:] & ~inside[:, :-1]
    distance = np.where(cut, np.clip(-gap[:, 1:] / fall, short, 1.0), 1.0)
    diagonal[:, 1:] += np.where(cut, outward[:, :-1] / distance, 0.0)

    # what the film's change of thickness adds to the flow of the steady pressure
    cos = np.cos(grid.theta)
    cos_faces = np.cos(grid.theta_faces)
    steady = np.pad(eps * p, 1)
    flow = along * (3 * cos_faces / (1 + eps * cos_faces))[:, None]
    flow = flow * (steady[:-1, 1:-1] - steady[1:, 1:-1])
    flow_out = outward * (3 * cos / (1 + eps * cos))[:, None]
    flow_out = flow_out * (steady[1:-1, 1:-1] - steady[1:-1, 2:])
    change = flow[:-1] - flow[1:] - flow_out
    change[:, 1:] += flow_out[:, :-1]
    # A radial velocity turns the wedge: the right side is 6 eps (sin - 2 v/eps cos).
    sources = np.stack([_wedge(grid) + change, -6 * cos[:, None] * grid.weights], axis=-1)

    response = _within(grid, inside, diagonal, sources)
    # the trapezoidal rule up to the edge
    weights = grid.weights * (1 + to_edge) / 2
    trig = np.stack([np.cos(grid.theta), np.sin(grid.theta)])
    return 0.5 * np.einsum("ki,ij,ijl->lk", trig, weights, response)


def pressure_forces(grid: Grid, p: np.ndarray) -> np.ndarray:
    """F_r/eps and F_t/eps of a pressure over eps."""
    trig = np.stack([np.cos(grid.theta), np.sin(grid.theta)])
    # p acts on R L d theta d zeta, and the unit of force is over L D: hence the half.
    return 0.5 * trig @ (grid.weights * p).sum(axis=1)


def _within(grid: Grid, film: np.ndarray, diagonal: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Pressures (n, m, k) for k sources on the nodes of a film, whose links with each other are whole."""
    from scipy.linalg import solveh_banded

    pressure = np.zeros(source.shape)
    m = grid.shape[1]
    if not film.any():
        return pressure
    rows = int(np.flatnonzero(film.any(axis=1))[-1]) + 1
    inside = film[:rows]
    # The upper bands of a symmetric matrix, as SciPy wants them: band m is the diagonal, m - 1 the
    # neighbour in zeta, 0 the one in theta, which comes m nodes later.
    bands = np.zeros((m + 1, rows, m))
    # Nodes outside of the film have rows of the unit matrix, so that the band holds any film.
    bands[m] = np.where(inside, diagonal[:rows], 1.0)
    linked = inside[:, :-1] & inside[:, 1:]
    bands[m - 1, :, 1:] = -np.where(linked, grid.coupling_zeta[:rows, :-1], 0.0)
    linked = inside[:-1] & inside[1:]
    bands[0, 1:] = -np.where(linked, grid.coupling_theta[1:rows], 0.0)
    right = np.where(inside[..., None], source[:rows], 0.0).reshape(rows * m, -1)
    # positive definite: Cholesky's method exchanges no rows, which would widen the band
    solved = solveh_banded(bands.reshape(m + 1, -1), right, overwrite_ab=True, check_finite=False)
    pressure[:rows] = solved.reshape(rows, m, -1)
    return pressure


def _reversed(grid: Grid) -> Grid:
    # what `linear_response` and `film_end` read; angles keep their values, so sin and cos stay right
    return grid._replace(
        theta=grid.theta[::-1],
        theta_faces=grid.theta_faces[::-1],
        weights=grid.weights[::-1],
        coupling_theta=grid.coupling_theta[::-1],
        coupling_zeta=grid.coupling_zeta[::-1],
    )


def _wedge(grid: Grid) -> np.ndarray:
    """Right side of the steady film, over eps and integrated over the cells."""
    return 6 * np.sin(grid.theta)[:, None] * grid.weights


def _diagonal(grid: Grid) -> np.ndarray:
    diagonal = grid.coupling_theta[:-1] + grid.coupling_theta[1:] + grid.coupling_zeta
    diagonal[:, 1:] += grid.coupling_zeta[:, :-1]
    return diagonal


def _residual(grid: Grid, diagonal: np.ndarray, p: np.ndarray) -> np.ndarray:
    r = diagonal * p
    r[1:] -= grid.coupling_theta[1:-1] * p[:-1]
    r[:-1] -= grid.coupling_theta[1:-1] * p[1:]
    r[:, 1:] -= grid.coupling_zeta[:, :-1] * p[:, :-1]
    r[:, :-1] -= grid.coupling_zeta[:, :-1] * p[:, 1:]
    return r
