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

The numbers are extrapolated by Richardson's rule from the two finest grids of `_finite_volumes`, and the
pressure is divided by eps, so that the concentric bearing is a regular case.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._core.errors import BadInput
from ._finite_volumes import (
    RING,
    film_grid,
    linear_response,
    pressure_forces,
    solve_pressure,
    solve_ring,
)

GRIDS = ((120, 8), (240, 16), (480, 32), (960, 64))  # cells in gamma, cells in half the length
SOMEYA_GROOVE = math.radians(10.0)  # width of each groove that gives back Someya's load numbers
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
    eps = float(eccentricity_ratio)
    q = float(length_ratio)
    if not 0 <= eps < 1:
        raise BadInput("eccentricity_ratio", eps, ">= 0 and < 1")
    if not (q > 0 and math.isfinite(q)):
        raise BadInput("length_ratio", q, "> 0")
    if cavitation not in CAVITATIONS:
        raise BadInput("cavitation", cavitation, "one of " + ", ".join(CAVITATIONS))
    if grooved and cavitation != "reynolds":
        raise BadInput("cavitation", cavitation, '"reynolds" for a bearing with grooves')
    linear = cavitation == "guembel"
    # Without the finest grid, which each step of the secant would have to solve.
    phi = groove_attitude(eps, q, grids[:-1]) if grooved else None
    ring = pads(phi)
    fields = _fields(eps, q, ring, grids, linear)[-2:]
    numbers = np.array([_measures(eps, field) for field in fields])
    radial, tangential, flow, peak = _extrapolated(numbers)
    couette = math.pi / math.sqrt(1 - eps**2)
    stiffness = damping = None
    # The load is (-F_r, -F_t) along (e_r, e_t), against the film; phi leads from it to e_r.
    attitude = math.atan2(tangential, -radial)
    if coefficients:
        if linear:
            stiffness, damping = _linear_coefficients(eps, q, grids)
        else:
            stiffness, damping = _coefficients(eps, fields)
        # from the axes of the film to those of the load
        cos = math.cos(attitude)
        sin = math.sin(attitude)
        turn = np.array([[cos, -sin], [sin, cos]])
        stiffness = turn @ stiffness @ turn.T
        damping = turn @ damping @ turn.T
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
    middle = math.pi - phi
    half = (math.pi - groove) / 2
    loaded = (middle - half, middle + half, 2 / 3)
    return loaded, (middle + math.pi - half, middle + math.pi + half, 1 / 3)


def groove_attitude(eps: float, q: float, grids) -> float:
    """[rad] Attitude angle at which the film between the grooves pushes against the load."""

    def excess(phi):
        radial, tangential = _steady(eps, q, phi, grids)
        return math.atan2(tangential, -radial) - phi

    # secant; the angle of the force hardly depends on where the grooves are
    ahead = 1.4 * math.sqrt(1 - eps)
    behind = ahead + excess(ahead)
    excess_ahead = excess(ahead)
    excess_behind = excess(behind)
    for _ in range(20):
        # two equal values, which rounding leaves at last, would divide the step by zero
        if abs(excess_behind) < 1e-9 or excess_behind == excess_ahead:
            break
        step = excess_behind * (behind - ahead) / (excess_behind - excess_ahead)
        ahead = behind
        behind = behind - step
        excess_ahead = excess_behind
        excess_behind = excess(behind)
    return behind


def _fields(eps, q, ring, grids, linear) -> list:
    """On every grid the pads, each with its grid, the pressure over eps and the film."""
    films = None
    out = []
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
        # the guess of the first grid is where the wedge closes; each finer one has that of the last
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
    # F/eps and dF/deps
    chord = sextic[0]
    slope = sextic[0] + eps * sextic[1] / step
    fields = _fields(eps, q, pads(None), grids, True)[-2:]
    c_rr, c_tr = _extrapolated(np.array([_linear_damping(f) for f in fields]))
    stiffness = np.array([[-slope[0], chord[1]], [-slope[1], -chord[0]]])
    return stiffness, np.array([[c_rr, 2 * chord[0]], [c_tr, 2 * chord[1]]])


def _field_with_edges(eps, ring, field) -> dict:
    """Nodes and pressure with the edges of the pads and the end of the bearing, where p = 0."""
    theta = []
    pressure = []
    for (start, end, _), (grid, p, _) in zip(ring, field, strict=True):
        at_edge = grid.theta[0] - start < 1e-9  # a closed ring
        theta += [[] if at_edge else [start], grid.theta, [end]]
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
    if bend >= 0:
        return float(top)
    return float(top - (above - below) ** 2 / (8 * bend))
