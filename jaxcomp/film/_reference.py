r"""Reference solution of the Reynolds equation by finite volumes (NumPy and SciPy).

The steady film of an aligned, isoviscous journal bearing obeys (Butenschoen 1976; Raimondi and
Boyd 1958), with h = 1 + eps cos(theta), theta from the line of maximum film with rotation, zeta
from the mid-plane, q = L/D and p in units of eta omega/psi^2,

    (h^3 p_theta)_theta + (1/q^2) (h^3 p_zeta)_zeta = 6 h_theta + 12 v cos(theta),

where v is the radial velocity of the journal in units of c omega, zero in steady running. Two rules
for the end of the film:

- `reynolds` (Swift-Stieber): p = dp/dn = 0, which is the complementarity problem p >= 0,
  equation >= 0, one of them an equality. The film of the plain ring starts with p = 0 on the line
  of maximum film, which travels with the journal.
- `guembel` (half-Sommerfeld): the linear problem is solved everywhere, negative pressure dropped.

Two axial grooves cut the ring into two pads with p = 0 at their edges. They lie at right angles to
the load, so that the attitude angle is found together with the pressure. In each pad that takes oil
in ahead of the thinnest film the film starts at the groove; in the other one it starts freely.

Discretisation: second-order finite volumes on nodes that are uniform in Sommerfeld's angle gamma,
tan(theta/2) = sqrt((1+eps)/(1-eps)) tan(gamma/2), in which p is smooth however thin the film, and
are drawn towards the bearing's end as the end layer gets thin. The complementarity problem is
solved by the primal-dual active set method (Hintermueller, Ito and Kunisch 2003), each step one
banded Cholesky factorisation, grid after grid; two grids are extrapolated by Richardson's rule.
The pressure is divided by eps, so that the concentric bearing is a regular case.

Stiffness and damping of the Swift-Stieber film follow from the linear response of the pressure,
which vanishes on the steady edge of the film (Lund 1966): the edge moves by second order only. The
active set shows the edge as a staircase; where it lies within a cell follows from the share of the
wedge's flow that the cell takes up. Links cut by the edge are shortened (Gibou, Fedkiw, Cheng and
Kang 2002), which keeps the matrix symmetric and the error of second order.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._core.errors import BadInput

GRIDS = ((120, 8), (240, 16), (480, 32), (960, 64))  # cells in gamma, cells in half the length
SOMEYA_GROOVE = math.radians(10.0)  # width of each groove that gives back Someya's load numbers
RING = (0.0, 2 * math.pi, 1.0)  # first and last theta of a pad, share of the cells
CAVITATIONS = ("reynolds", "guembel")


class FilmSolution(NamedTuple):
    """The film at one eccentricity ratio, in the units of `jaxcomp.film`.

    Attributes:
        theta: [rad] (n,) nodes round the bearing, from the line of maximum film with rotation; two
            pads with grooves follow one another.
        zeta: [-] (m,) nodes from the mid-plane (0) to the end (1) of the bearing.
        pressure: [-] (n, m) over eta omega/psi^2, on the finest grid.
        load_number: [-] Phi_p.
        attitude_angle: [rad] phi.
        friction_number: [-] Phi_T of the journal. Couette shear is taken over the whole ring,
            cavity and grooves included.
        side_flow: [-] Oil that leaves through both ends, over c R omega L.
        minimum_film_ratio: [-] h_min/c.
        peak_pressure: [-] over eta omega/psi^2.
        stiffness: [-] (2, 2) in the units and axes of `dynamic_coefficients`; None if not wanted.
        damping: [-] (2, 2), likewise.
    """

    theta: np.ndarray
    zeta: np.ndarray
    pressure: np.ndarray
    load_number: float
    attitude_angle: float
    friction_number: float
    side_flow: float
    minimum_film_ratio: float
    peak_pressure: float
    stiffness: np.ndarray | None
    damping: np.ndarray | None


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


def reference_solution(
    eccentricity_ratio: float,
    length_ratio: float,
    *,
    cavitation: str = "reynolds",
    grooved: bool = False,
    coefficients: bool = True,
    grids: Sequence[tuple[int, int]] = GRIDS,
) -> FilmSolution:
    """Solve the film at a position: pressure, load, friction, side flow, coefficients.

    Numbers are extrapolated from the last two grids. On the default grids forces are good to 1e-5
    and stiffness and damping to some 5e-5, in 0.1 to 0.3 s on one BLAS thread (OMP_NUM_THREADS=1; on
    busy cores more of them are ten times slower); not differentiable.

    Args:
        eccentricity_ratio: [-] eps in [0, 1).
        length_ratio: [-] q = L/D.
        cavitation: "reynolds" (Swift-Stieber) or "guembel" (half-Sommerfeld).
        grooved: Two axial grooves of 10 degrees at right angles to the load instead of a plain
            ring. In the coefficients the film moves with the journal, as in Someya's tables; with
            "reynolds" only.
        coefficients: Whether to find stiffness and damping.
        grids: Cells round the ring and over half the length, each grid twice as fine as the last.

    Raises:
        BadInput: for an eccentricity ratio outside [0, 1), a length ratio that is not positive, or
            an unknown way of cavitation.
    """
    eps, q = float(eccentricity_ratio), float(length_ratio)
    if not 0 <= eps < 1:
        raise BadInput("eccentricity_ratio", eps, ">= 0 and < 1")
    if not (q > 0 and math.isfinite(q)):
        raise BadInput("length_ratio", q, "> 0")
    if cavitation not in CAVITATIONS:
        raise BadInput("cavitation", cavitation, "one of " + ", ".join(CAVITATIONS))
    if grooved and cavitation != "reynolds":
        raise BadInput("cavitation", cavitation, '"reynolds" for a bearing with grooves')
    linear = cavitation == "guembel"
    phi = groove_attitude(eps, q, grids[:-1]) if grooved else None
    ring = pads(phi)
    fields = _fields(eps, q, ring, grids, linear)[-2:]
    numbers = np.array([_measures(eps, field) for field in fields])
    radial, tangential, flow, peak = _extrapolated(numbers)
    couette = math.pi / math.sqrt(1 - eps**2)
    stiffness = damping = None
    attitude = math.atan2(tangential, -radial)
    if coefficients:
        axes = _linear_coefficients(eps, q, grids) if linear else _coefficients(eps, fields)
        turn = np.array(
            [[math.cos(attitude), -math.sin(attitude)], [math.sin(attitude), math.cos(attitude)]]
        )
        stiffness, damping = turn @ axes[0] @ turn.T, turn @ axes[1] @ turn.T
    return FilmSolution(
        **_field_with_edges(eps, ring, fields[-1]),
        load_number=eps * math.hypot(radial, tangential),
        attitude_angle=attitude,
        friction_number=couette + eps**2 * tangential / 2,
        side_flow=eps * flow,
        minimum_film_ratio=1 - eps,
        peak_pressure=eps * peak,
        stiffness=stiffness,
        damping=damping,
    )


def pads(phi: float | None, groove: float = SOMEYA_GROOVE) -> tuple:
    """The plain ring, or the pads between two grooves at right angles to the load."""
    if phi is None:
        return (RING,)
    middle, half = math.pi - phi, (math.pi - groove) / 2
    loaded = (middle - half, middle + half, 2 / 3)
    return loaded, (middle + math.pi - half, middle + math.pi + half, 1 / 3)


def film_grid(
    eps: float, q: float, n_theta: int, n_zeta: int, pad=RING, *, closed: bool = False
) -> Grid:
    """Finite-volume coefficients on `n_theta` cells round the ring, `n_zeta` over half a length.

    A closed ring has the line of maximum film among its nodes.
    """
    first, last, share = pad
    n_theta = round(share * n_theta)
    stretch = np.sqrt((1 + eps) / (1 - eps))

    def angle(gamma, stretch=stretch):  # theta(gamma), without a jump at pi and beyond 2 pi
        s, c = np.sin(gamma / 2), np.cos(gamma / 2)
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
    dg, dt = (angle(last, 1 / stretch) - start) / n_theta, 1 / n_zeta
    gamma = start + dg * np.arange(0 if closed else 1, n_theta)
    t = dt * np.arange(n_zeta)
    half = np.where(t == 0, 0.5, 1.0)  # the control volume on the mid-plane is cut in half
    faces_g = start + dg * (np.arange(n_theta) + 0.5)
    faces_t = dt * (np.arange(n_zeta) + 0.5)

    theta, between = angle(gamma), angle(faces_g)
    h, h_face = 1 + eps * np.cos(theta), 1 + eps * np.cos(between)
    width_z = place_slope(t) * half * dt
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
    source, diagonal = _wedge(grid), _diagonal(grid)
    for _ in range(300):
        p = _within(grid, film, diagonal, source[..., None])[..., 0]
        # A node leaves the film where its pressure is negative, and joins it where more oil comes
        # in by the wedge than flows off.
        new = np.where(film, p > 0, _residual(grid, diagonal, p) < source)
        if np.array_equal(new, film):
            return p, film
        film = new
    raise RuntimeError("The active set did not settle.")


def _within(grid: Grid, film: np.ndarray, diagonal: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Pressures (n, m, k) for k sources on the nodes of a film, whose links with each other are whole."""
    from scipy.linalg import solveh_banded

    found, m = np.zeros(source.shape), grid.shape[1]
    if not film.any():
        return found
    rows = int(np.flatnonzero(film.any(axis=1))[-1]) + 1
    inside = film[:rows]
    bands = np.zeros((m + 1, rows, m))
    # Nodes outside of the film have rows of the unit matrix, so that the band holds any film.
    bands[m] = np.where(inside, diagonal[:rows], 1.0)
    both = inside[:, :-1] & inside[:, 1:]
    bands[m - 1, :, 1:] = -np.where(both, grid.coupling_zeta[:rows, :-1], 0.0)
    both = inside[:-1] & inside[1:]
    bands[0, 1:] = -np.where(both, grid.coupling_theta[1:rows], 0.0)
    right = np.where(inside[..., None], source[:rows], 0.0).reshape(rows * m, -1)
    solved = solveh_banded(bands.reshape(m + 1, -1), right, overwrite_ab=True, check_finite=False)
    found[:rows] = solved.reshape(rows, m, -1)
    return found


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
    last = grid.shape[0] + 0.5 + grid.coupling_theta[-1] * p[-1] / np.abs(source[-1])
    return np.where(film[-1], np.minimum(last, grid.shape[0] + 1), end)


def linear_response(eps: float, grid: Grid, p: np.ndarray, film: np.ndarray) -> np.ndarray:
    """Slopes of the forces over eps (first row) and over the revolution 2 v/eps of the wedge (second).

    Columns F_r and F_t; of the pressure and of the pressure over eps. The pad stays where it is
    against the line of centres.
    """
    if not film.any():
        return np.zeros((2, 2))
    # Turned round, this film too begins at the first edge and has its free end behind.
    if grid.starts_freely:
        grid, p, film = _reversed(grid), p[::-1], film[::-1]
    n, m = grid.shape
    along, across = grid.coupling_theta, grid.coupling_zeta
    gap = film_end(grid, p, film) - np.arange(1.0, n + 1)[:, None]  # in spacings in theta
    inside = gap > 1e-9
    short = 1e-6  # a node so near to the edge has no pressure

    # the matrix: whole links within the film, shortened ones over its edge
    link = np.where(inside[1:] & inside[:-1], along[1:-1], 0.0)
    link_out = np.where(inside[:, 1:] & inside[:, :-1], across[:, :-1], 0.0)
    diagonal = np.zeros((n, m))
    diagonal[0] = along[0]
    diagonal[1:] += link
    diagonal[:-1] += link
    diagonal[:, 1:] += link_out
    diagonal[:, :-1] += link_out
    diagonal[:, -1] += across[:, -1]
    ends = inside & ~np.vstack([inside[1:], np.zeros((1, m), bool)])
    to_edge = np.where(ends, np.clip(gap, short, 1.0), 1.0)
    diagonal += np.where(ends, along[1:] / to_edge, 0.0)
    # in zeta the edge lies where the line between the ends of two columns crosses the row
    fall = gap[:, :-1] - gap[:, 1:]
    fall = np.where(fall == 0, 1.0, fall)
    cut = inside[:, :-1] & ~inside[:, 1:]
    way = np.where(cut, np.clip(gap[:, :-1] / fall, short, 1.0), 1.0)
    diagonal[:, :-1] += np.where(cut, across[:, :-1] / way, 0.0)
    cut = inside[:, 1:] & ~inside[:, :-1]
    way = np.where(cut, np.clip(-gap[:, 1:] / fall, short, 1.0), 1.0)
    diagonal[:, 1:] += np.where(cut, across[:, :-1] / way, 0.0)

    # what the film's change of thickness adds to the flow of the steady pressure
    cos, cos_faces = np.cos(grid.theta), np.cos(grid.theta_faces)
    steady = np.pad(eps * p, 1)
    flow = along * (3 * cos_faces / (1 + eps * cos_faces))[:, None]
    flow = flow * (steady[:-1, 1:-1] - steady[1:, 1:-1])
    flow_out = across * (3 * cos / (1 + eps * cos))[:, None]
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


def _reversed(grid: Grid) -> Grid:
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


def solve_ring(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Pressure of the whole closed ring: the steady one over eps, and that of a unit turn."""
    # A closed ring has no narrow band: its last nodes are neighbours of the first.
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    n, m = grid.shape
    number = np.arange(n * m).reshape(n, m)
    onward, outward = np.roll(number, -1, axis=0), number[:, 1:]
    rows = [number, onward, number[:, :-1], outward]
    columns = [onward, number, outward, number[:, :-1]]
    links = [-grid.coupling_theta] * 2 + [-grid.coupling_zeta[:, :-1]] * 2
    diagonal = grid.coupling_theta + np.roll(grid.coupling_theta, 1, axis=0) + grid.coupling_zeta
    diagonal[:, 1:] += grid.coupling_zeta[:, :-1]
    parts = [*zip(rows, columns, links, strict=True), (number, number, diagonal)]
    i, j, value = (np.concatenate([part[k].ravel() for part in parts]) for k in range(3))
    waves = np.stack([np.sin(grid.theta), -np.cos(grid.theta)], axis=-1)
    source = 6 * waves[:, None, :] * grid.weights[:, :, None]
    pressures = splu(coo_array((value, (i, j))).tocsc()).solve(source.reshape(-1, 2))
    return pressures[:, 0].reshape(n, m), pressures[:, 1].reshape(n, m)


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


def pressure_forces(grid: Grid, p: np.ndarray) -> np.ndarray:
    """F_r/eps and F_t/eps of a pressure over eps."""
    trig = np.stack([np.cos(grid.theta), np.sin(grid.theta)])
    return 0.5 * trig @ (grid.weights * p).sum(axis=1)


def groove_attitude(eps: float, q: float, grids) -> float:
    """[rad] Attitude angle at which the film between the grooves pushes against the load."""

    def excess(phi):
        radial, tangential = _steady(eps, q, phi, grids)
        return math.atan2(tangential, -radial) - phi

    # secant; the angle of the force hardly depends on where the grooves are
    ahead = 1.4 * math.sqrt(1 - eps)
    behind = ahead + excess(ahead)
    last, now = excess(ahead), excess(behind)
    for _ in range(20):
        if abs(now) < 1e-9 or now == last:
            break
        ahead, behind = behind, behind - now * (behind - ahead) / (now - last)
        last, now = now, excess(behind)
    return behind


def _fields(eps, q, ring, grids, linear) -> list:
    """On every grid the pads, each with its grid, the pressure over eps and the film."""
    films, out = None, []
    if linear:
        for cells in grids:
            grid = film_grid(eps, q, *cells, closed=True)
            p, _ = solve_ring(grid)
            # the sign by antisymmetry: on the lines of largest and least film it is rounding
            film = np.broadcast_to((grid.theta < np.pi - 1e-9)[:, None], grid.shape)
            out.append([(grid, np.where(film, np.maximum(p, 0.0), 0.0), film)])
        return out
    for n_theta, n_zeta in grids:
        each = [film_grid(eps, q, n_theta, n_zeta, pad) for pad in ring]
        if films is None:
            films = [np.broadcast_to((np.sin(g.theta) > 0)[:, None], g.shape) for g in each]
        else:
            films = [_refined(film, g.shape) for film, g in zip(films, each, strict=True)]
        solved = [solve_pressure(g, film) for g, film in zip(each, films, strict=True)]
        films = [film for _, film in solved]
        out.append([(grid, p, film) for grid, (p, film) in zip(each, solved, strict=True)])
    return out


def _refined(film: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The film of a grid carried over to the grid of half the spacing."""
    rows = np.minimum(np.maximum((np.arange(shape[0]) + 1) // 2 - 1, 0), film.shape[0] - 1)
    return film[np.ix_(rows, np.arange(shape[1]) // 2)]


def _extrapolated(values: np.ndarray) -> np.ndarray:
    """Richardson's rule for errors of second order, from the last two grids."""
    return (4 * values[-1] - values[-2]) / 3


def _total(field) -> np.ndarray:
    return np.sum([pressure_forces(grid, p) for grid, p, _ in field], axis=0)


def _steady(eps, q, phi, grids, linear=False) -> np.ndarray:
    """F_r/eps and F_t/eps, extrapolated."""
    fields = _fields(eps, q, pads(phi), grids, linear)[-2:]
    return _extrapolated(np.array([_total(field) for field in fields]))


def _response(eps, field) -> np.ndarray:
    return np.sum([linear_response(eps, grid, p, film) for grid, p, film in field], axis=0)


def _linear_damping(field) -> np.ndarray:
    """C_rr and C_tr of a half-Sommerfeld film: the response of the ring over the steady film."""
    ((grid, _, film),) = field
    # the control volumes on the lines of largest and least film belong to it by half
    edge = np.abs(np.sin(grid.theta)) < 1e-9
    share = np.where(edge[:, None], 0.5, film)
    # F = eps G(2 v/eps), so dF/dv = 2 G'
    return -2 * pressure_forces(grid, share * solve_ring(grid)[1])


def _coefficients(eps, fields) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping in the axes of the film, which moves with the journal."""
    radial, tangential = _extrapolated(np.array([_total(field) for field in fields]))
    slopes = _extrapolated(np.array([_response(eps, field) for field in fields]))
    stiffness = np.array([[-slopes[0, 0], tangential], [-slopes[0, 1], -radial]])
    # F = eps G(2 v/eps), so dF/dv = 2 G'; C_tr = C_rt by reciprocity
    damping = np.array([[-2 * slopes[1, 0], 2 * radial], [2 * radial, 2 * tangential]])
    return stiffness, damping


def _linear_coefficients(eps, q, grids) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping of a half-Sommerfeld film in its axes."""
    # Slope of the sextic through seven places, all of them within the bearing.
    step = 0.08 * (1 - eps)
    places = max(eps, 3 * step) + step * np.arange(-3.0, 4.0)
    chords = np.array([_steady(e, q, None, grids, True) for e in places])
    sextic = np.polynomial.polynomial.polyfit((places - eps) / step, chords, 6)
    chord, slope = sextic[0], sextic[0] + eps * sextic[1] / step  # F/eps and dF/deps
    fields = _fields(eps, q, pads(None), grids, True)[-2:]
    c_rr, c_tr = _extrapolated(np.array([_linear_damping(f) for f in fields]))
    stiffness = np.array([[-slope[0], chord[1]], [-slope[1], -chord[0]]])
    return stiffness, np.array([[c_rr, 2 * chord[0]], [c_tr, 2 * chord[1]]])


def _field_with_edges(eps, ring, field) -> dict:
    """Nodes and pressure with the edges of the pads and the end of the bearing, where p = 0."""
    theta, pressure = [], []
    for (first, last, _), (grid, p, _) in zip(ring, field, strict=True):
        at_edge = grid.theta[0] - first < 1e-9  # a closed ring
        theta += [[] if at_edge else [first], grid.theta, [last]]
        pressure.append(np.pad(eps * p, [(0 if at_edge else 1, 1), (0, 1)]))
    zeta = np.append(field[0][0].zeta, 1.0)
    return {"theta": np.concatenate(theta), "zeta": zeta, "pressure": np.concatenate(pressure)}


def _measures(eps, field) -> np.ndarray:
    """F_r, F_t, side flow and peak pressure, all over eps."""
    flow = 0.0
    for grid, p, film in field:
        # what passes the last face within, and what the wedge adds between it and the end
        wedge = np.where(film[:, -1], 6 * np.sin(grid.theta) * grid.end, 0.0)
        # 1/12 is Poiseuille's: two ends, the 2 of zeta and the 1/4 of (R/L)^2 q^2 make one.
        flow += np.sum(grid.coupling_zeta[:, -1] * p[:, -1] + wedge) / 12
    return np.array([*_total(field), flow, max(_peak(p[:, 0]) for _, p, _ in field)])


def _peak(p: np.ndarray) -> float:
    """Top of the parabola through the largest value and its neighbours."""
    p = np.concatenate([[0.0], p, [0.0]])
    i = int(np.clip(np.argmax(p), 1, p.size - 2))
    below, top, above = p[i - 1 : i + 2]
    bend = below - 2 * top + above
    return float(top - (above - below) ** 2 / (8 * bend)) if bend < 0 else float(top)
