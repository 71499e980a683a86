r"""Shaft elements: Timoshenko beams of circular section, uniform or conical.

Two-node elements with the exact static deflection as shape functions. With the bending moment
M(s) = M_c - Q (s - L/2) and the constant shear force Q, the deformations of the element
e = (phi_2 - phi_1, u_2 - u_1 - L (phi_1 + phi_2)/2) = J d are F (M_c, Q) with the flexibility

    F = [ int 1/EI          -int z/EI                ]     z = s - L/2,
        [ -int z/EI    int z^2/EI + int 1/(kappa GA) ]

so that k = J^T F^{-1} J for any section law; mass and polar inertia follow from the same shape
functions by quadrature. For a uniform element this is the element of H. D. Nelson (1980), A finite
rotating shaft element using Timoshenko beam theory, J. Mech. Design 102, and all integrals are
exact. Its shear force is constant in an element, so that frequencies converge with the square of
the length where shear counts, and with the fourth power without. Without shear and with rotary
inertia it is the Rayleigh beam, without both the Euler-Bernoulli beam.
"""

from itertools import pairwise
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import NONNEGATIVE, POSITIVE, Bound, Part, quantity, spread_columns

ShearLaw = Literal["cowper", "hutchinson", "constant"]
SHEAR_LAWS = ("cowper", "hutchinson", "constant")


def area(outer: Float[Array, "*n"], inner: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """[m2] Area between two diameters [m]."""
    return jnp.pi / 4 * (outer**2 - inner**2)


def second_moment(outer: Float[Array, "*n"], inner: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """[m4] Second moment about a diameter; the polar one is twice that."""
    return jnp.pi / 64 * (outer**4 - inner**4)


def shear_coefficient(
    law: ShearLaw,
    outer: Float[Array, "*#n"],
    inner: Float[Array, "*#n"],
    poisson: Float[Array, "*#n"],
    constant: Float[Array, "*#n"],
) -> Float[Array, "*#n"]:
    r"""Shear coefficient of a hollow circle; the effective shear area is this times the area.

    `"cowper"`: G. R. Cowper (1966), The shear coefficient in Timoshenko's beam theory, J. Appl.
    Mech. 33, hollow circle, with m = inner/outer,
    $6(1+\nu)(1+m^2)^2 / [(7+6\nu)(1+m^2)^2 + (20+12\nu)m^2]$.

    `"hutchinson"`: J. R. Hutchinson (2001), Shear coefficients for Timoshenko beam theory, J. Appl.
    Mech. 68, hollow circle, in units of the outer radius,
    $6(1+\nu)^2(1+m^2)^2 / [7+34m^2+7m^4 + \nu(12+48m^2+12m^4) + \nu^2(4+16m^2+4m^4)]$.

    `"constant"`: the given number. Diameters in [m].
    """
    if law == "constant":
        return jnp.broadcast_to(constant, jnp.shape(outer))
    m2 = (inner / outer) ** 2
    s = (1 + m2) ** 2
    if law == "cowper":
        return 6 * (1 + poisson) * s / ((7 + 6 * poisson) * s + (20 + 12 * poisson) * m2)
    ring = 1 + 4 * m2 + m2**2
    lead = 7 + 34 * m2 + 7 * m2**2
    return 6 * (1 + poisson) ** 2 * s / (lead + 12 * poisson * ring + 4 * poisson**2 * ring)


Node = int | str
Theory = Literal["timoshenko", "rayleigh", "euler-bernoulli"]
THEORIES = ("timoshenko", "rayleigh", "euler-bernoulli")

# Gauss points on (0, 1). Four are exact for the mass of a uniform element (degree six); the rest is
# for cones: with eight a 2:1 taper is integrated to 1e-9.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_POINTS = (_POINTS + 1) / 2
_WEIGHTS = _WEIGHTS / 2


class ShaftElements(Part):
    """A table of circular beam elements; one entry along the axis of each array is one element.

    A single value stands for all elements, and a list of nodes for the line through them. Elements
    between the same two nodes act in parallel (a sleeve on a shaft). A density of zero makes an
    element that is stiff but massless.

    Args:
        nodes: pairs of node names, left (smaller z) and right; or the n + 1 nodes of a line.
        length: [m] (n,)
        outer_diameter: [m] (n,), at the left end.
        young_modulus: [Pa] (n,)
        density: [kg/m3] (n,), zero for a stiffness-only element.
        poisson: [-] (n,)
        inner_diameter: [m] (n,), at the left end; absent for a solid shaft.
        outer_diameter_end: [m] (n,), at the right end; absent for cylinders.
        inner_diameter_end: [m] (n,), at the right end; absent: as at the left end.
        shear_constant: [-] (n,), used by `shear_law="constant"` only.
        theory: "timoshenko", "rayleigh" (no shear) or "euler-bernoulli" (no shear, no rotary
            inertia and so no gyroscopic effect).
        shear_law: "cowper", "hutchinson" or "constant".
        spins: whether these elements turn with the shaft (gyroscopic terms).

    Raises:
        BadInput: a value outside its bound, or an inner diameter not below the outer one.
    """

    nodes: tuple[tuple[Node, Node], ...] | tuple[Node, ...] = eqx.field(static=True)
    length: Array = quantity("m", POSITIVE, shape=(None,), spread=True, usual=(1e-4, 10.0))
    outer_diameter: Array = quantity("m", POSITIVE, shape=(None,), spread=True, usual=(1e-3, 2.0))
    young_modulus: Array = quantity("Pa", POSITIVE, shape=(None,), spread=True, usual=(1e9, 1e12))
    density: Array = quantity(
        "kg/m^3", NONNEGATIVE, shape=(None,), spread=True, usual=(500.0, 25e3)
    )
    poisson: Array = quantity("", Bound(-1.0, 0.5, low_open=True), shape=(None,), spread=True)
    inner_diameter: Array | None = quantity(
        "m", NONNEGATIVE, shape=(None,), spread=True, default=None
    )
    outer_diameter_end: Array | None = quantity(
        "m", POSITIVE, shape=(None,), spread=True, default=None
    )
    inner_diameter_end: Array | None = quantity(
        "m", NONNEGATIVE, shape=(None,), spread=True, default=None
    )
    shear_constant: Array | None = quantity("", POSITIVE, shape=(None,), spread=True, default=None)
    theory: Theory = eqx.field(static=True, default="timoshenko")
    shear_law: ShearLaw = eqx.field(static=True, default="cowper")
    spins: bool = eqx.field(static=True, default=True)

    def __post_init__(self):
        if not any(isinstance(node, tuple) for node in self.nodes):
            self.nodes = tuple(pairwise(self.nodes))  # pyright: ignore[reportAttributeAccessIssue]
        if not self.nodes:
            raise BadInput("nodes", "()", "at least two nodes")
        spread_columns(self, len(self.nodes), "elements")

    def __check_init__(self):
        if self.theory not in THEORIES:
            raise BadInput("theory", self.theory, f"one of {THEORIES}")
        if self.shear_law not in SHEAR_LAWS:
            raise BadInput("shear_law", self.shear_law, f"one of {SHEAR_LAWS}")
        if self.shear_law == "constant" and self.shear_constant is None:
            raise BadInput("shear_constant", "absent", "given with shear_law = 'constant'")
        for first, second in self.pairs:
            if first == second:
                raise BadInput("nodes", str((first, second)), "two different nodes an element")

    @property
    def pairs(self) -> tuple[tuple[Node, Node], ...]:
        """The two nodes of each element."""
        return self.nodes  # pyright: ignore[reportReturnType]

    def conditions(self):
        (outer, inner), (outer_end, inner_end) = end_diameters(self)
        hollow = (inner < outer) & (inner_end < outer_end)
        return {"a table with inner diameters below the outer ones": hollow.all()}


class ElementMatrices(NamedTuple):
    """Elements in plane coordinates (u_1, phi_1, u_2, phi_2), one entry an element.

    The lateral stiffness is kept as J^T S J, because a product with J first subtracts nearly equal
    displacements exactly and so keeps the digits that an assembled matrix has lost.

    Attributes:
        length: [m] (n,)
        shape: [-], [m] (n, 2, 4) J, see `deformation`.
        lateral: [N m, N, N/m] S = F^{-1}, (n, 2, 2).
        mass: lateral inertia (n, 4, 4).
        polar: gyroscopic inertia (n, 4, 4), zero where nothing spins.
        axial: [N/m], [N m] stiffness of axial and torsional springs (n, 2).
        axial_mass: [kg], [kg m2] (n, 4, 4) on (u_z1, th_z1, u_z2, th_z2).
    """

    length: Array
    shape: Array
    lateral: Array
    mass: Array
    polar: Array
    axial: Array
    axial_mass: Array


def end_diameters(
    shaft: ShaftElements,
) -> tuple[tuple[Float[Array, " n"], Float[Array, " n"]], ...]:
    """[m] Outer and inner diameters at the first ends and at the second ones."""
    outer = shaft.outer_diameter
    inner = shaft.inner_diameter
    if inner is None:
        inner = 0.0 * outer
    outer_end = outer if shaft.outer_diameter_end is None else shaft.outer_diameter_end
    inner_end = inner if shaft.inner_diameter_end is None else shaft.inner_diameter_end
    return (outer, inner), (outer_end, inner_end)


def shaft_mass(shaft: ShaftElements) -> Float[Array, " n"]:
    """[kg] Mass of each element."""
    (d1, b1), (d2, b2) = end_diameters(shaft)
    square = (d1**2 + d1 * d2 + d2**2 - b1**2 - b1 * b2 - b2**2) / 3
    return shaft.density * jnp.pi / 4 * square * shaft.length


def shaft_polar_inertia(shaft: ShaftElements) -> Float[Array, " n"]:
    """[kg m^2] Inertia of each element about the axis, exact for cones as well."""
    (outer, inner), (outer_end, inner_end) = end_diameters(shaft)

    # Over a linear taper; as a sum, because (a^5 - b^5)/(a - b) is 0/0 for a cylinder.
    def mean_fourth_power(a, b):
        return sum(a ** (4 - k) * b**k for k in range(5)) / 5

    fourth = mean_fourth_power(outer, outer_end) - mean_fourth_power(inner, inner_end)
    return shaft.density * jnp.pi / 32 * fourth * shaft.length


def element_matrices(shafts: tuple[ShaftElements, ...]) -> ElementMatrices:
    """Stiffness and inertia of every element of all tables, from the exact static deflection.

    Tables of one kind go through together, because each of them would be a program of its own.
    """
    first = np.cumsum([0, *(len(shaft.nodes) for shaft in shafts)])
    kinds: dict[tuple, list[int]] = {}
    for number, shaft in enumerate(shafts):
        kinds.setdefault((shaft.theory, shaft.shear_law, shaft.spins), []).append(number)
    of_kinds = []
    places = []
    for kind, numbers in kinds.items():
        tables = [_columns(shafts[number]) for number in numbers]
        columns = [jnp.concatenate(column) for column in zip(*tables, strict=True)]
        of_kind = lambda *args, kind=kind: _element(*kind, *args)  # noqa: E731
        of_kinds.append(jax.vmap(of_kind)(*columns))
        for number in numbers:
            places.append(np.arange(first[number], first[number + 1]))
    joined = jax.tree.map(lambda *x: jnp.concatenate(x), *of_kinds)
    if len(kinds) == 1:
        return joined
    # back from kinds to the order of the tables, in which `Layout` numbers the elements
    order = np.argsort(np.concatenate(places))
    return jax.tree.map(lambda x: x[order], joined)


def deformation(length: Float[Array, ""]) -> Float[Array, "2 4"]:
    """J: relative rotation and transverse deformation from (u_1, phi_1, u_2, phi_2)."""
    return jnp.asarray(_RIGID_SHAPE) + length * _LENGTH_SHAPE


_RIGID_SHAPE = np.array([[0.0, -1.0, 0.0, 1.0], [-1.0, 0.0, 1.0, 0.0]])
_LENGTH_SHAPE = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, -0.5, 0.0, -0.5]])


def _columns(shaft):
    (outer, inner), (outer_end, inner_end) = end_diameters(shaft)
    outer = jnp.stack((outer, outer_end), -1)
    inner = jnp.stack((inner, inner_end), -1)
    constant = shaft.shear_constant
    if constant is None:
        # No law but "constant" reads it; it gives the tables of a kind the same columns.
        constant = jnp.ones_like(shaft.length)
    return (
        shaft.length,
        outer,
        inner,
        shaft.young_modulus,
        shaft.density,
        shaft.poisson,
        constant,
    )


def _element(theory, shear_law, spins, length, outer, inner, young, density, poisson, constant):
    shear = young / (2 * (1 + poisson))

    def section(s):  # s: position over length
        do, di = outer[0] + (outer[1] - outer[0]) * s, inner[0] + (inner[1] - inner[0]) * s
        a, i = area(do, di), second_moment(do, di)
        kappa = shear_coefficient(shear_law, do, di, poisson, constant)
        slack = 1 / (kappa * shear * a) if theory == "timoshenko" else jnp.zeros_like(a)
        return a, i, 1 / (young * i), slack

    # Flexibilities from the middle of the element, where bending and shear of a uniform one uncouple.
    s, w = jnp.asarray(_POINTS), length * jnp.asarray(_WEIGHTS)
    a, i, bend, slack = section(s)
    z = length * (s - 0.5)
    f11 = jnp.sum(w * bend)
    f12 = -jnp.sum(w * z * bend)
    f22 = jnp.sum(w * (z**2 * bend + slack))
    lateral = jnp.array([[f22, -f12], [-f12, f11]]) / (f11 * f22 - f12**2)

    # Shape functions at the Gauss points, from the integrals of the curvature up to each of them.
    shape = deformation(length)
    moment, force = lateral @ shape  # rows: M_c and Q per unit of each coordinate
    start = moment + force * length / 2  # bending moment at the left node
    r, v = s[:, None] * s[None, :], s[:, None] * w[None, :]  # points and weights of (0, s)
    _, _, bend_r, slack_r = section(r)
    # From the left node phi' = (M_1 - Q x)/EI. The lever s - x makes of the two integrations of the
    # curvature that lead to u a single one.
    x = length * r
    beyond = length * (s[:, None] - r)
    turn = jnp.sum(v * bend_r, 1)[:, None] * start - jnp.sum(v * bend_r * x, 1)[:, None] * force
    sag = jnp.sum(v * beyond * bend_r, 1)[:, None] * start
    # Shear adds Q/(kappa G A) to the slope of the axis and nothing to the rotation phi.
    sag += jnp.sum(v * (slack_r - beyond * x * bend_r), 1)[:, None] * force
    phi = jnp.array([0.0, 1.0, 0.0, 0.0]) + turn
    u = jnp.array([1.0, 0.0, 0.0, 0.0]) + length * s[:, None] * jnp.array([0.0, 1, 0, 0]) + sag
    rotary = jnp.einsum("q,qi,qj->ij", w * density * i, phi, phi)
    if theory == "euler-bernoulli":
        rotary = jnp.zeros_like(rotary)
    mass = jnp.einsum("q,qi,qj->ij", w * density * a, u, u) + rotary
    # of a circle the polar second moment is twice that about a diameter
    polar = 2 * rotary if spins else jnp.zeros_like(rotary)

    stretch = 1 / (young * a)
    twist = 1 / (2 * shear * i)
    total = jnp.stack([jnp.sum(w * stretch), jnp.sum(w * twist)])
    part = jnp.stack(
        [jnp.sum(v / (young * section(r)[0]), 1), jnp.sum(v / (2 * shear * section(r)[1]), 1)]
    )
    # Exact statics of a bar of varying section: flexibility so far over that of the whole.
    right = part / total[:, None]  # (2, q): shape function of the right node
    inertia = w * density * jnp.stack([a, 2 * i])
    end = jnp.stack([1 - right, right])  # (end, axis, q)
    bars = jnp.einsum("aq,eaq,faq->eaf", inertia, end, end)  # (end, axis, end)
    axial_mass = jnp.einsum("eaf,ab->eafb", bars, jnp.eye(2)).reshape(4, 4)
    return ElementMatrices(length, shape, lateral, mass, polar, 1 / total, axial_mass)


def shaft_line(nodes: tuple[Node, ...], *, length, outer_diameter, **columns) -> ShaftElements:
    """A line of elements through the nodes, every field by its name.

    Args:
        nodes: n + 1 node names in the direction of z.
        length: [m] one value or (n,)
        outer_diameter: [m] one value or (n,)
        **columns: the other fields of `ShaftElements`, arrays by one value or (n,).
    """
    return ShaftElements(nodes, length, outer_diameter, **columns)


def stepped_shaft(
    length, outer_diameter, *, elements: int | tuple[int, ...] = 1, first: int = 1, **columns
) -> ShaftElements:
    """A shaft of cylindrical or conical steps, each cut into elements; nodes are numbered.

    Args:
        length: [m] (steps,)
        outer_diameter: [m] (steps,)
        elements: number of elements of each step.
        first: number of the first node.
        **columns: the other fields, one value or (steps,); end diameters make cones.

    Raises:
        BadInput: numbers of elements that are not one a step, or below one.
    """
    length = jnp.asarray(length, float)
    steps = length.shape[0]
    counts = (elements,) * steps if isinstance(elements, int) else tuple(elements)
    if len(counts) != steps or min(counts) < 1:
        raise BadInput("elements", str(counts), f"a number of at least 1 for each of {steps} steps")
    which = np.repeat(np.arange(steps), counts)
    within = np.concatenate([np.arange(c) for c in counts])
    share = np.repeat(1 / np.array(counts), counts)
    columns |= {"outer_diameter": outer_diameter}
    plain = {"theory", "shear_law", "spins"}
    table: dict[str, Any] = {"length": length[which] * share}
    for name, value in columns.items():
        if value is None:
            continue
        table[name] = value
        if name not in plain:
            table[name] = jnp.broadcast_to(jnp.asarray(value, float), steps)[which]
    for name in ("outer_diameter", "inner_diameter"):
        if f"{name}_end" in table:
            a = table.get(name, jnp.zeros(len(which)))
            b = table[f"{name}_end"]
            # a cone is cut into shorter ones whose ends lie on its line
            table[name] = a + (b - a) * within * share
            table[f"{name}_end"] = a + (b - a) * (within + 1) * share
    # every element ends at the node at which the next one begins
    nodes = tuple(pairwise(range(first, first + len(which) + 1)))
    return ShaftElements(nodes, **table)
