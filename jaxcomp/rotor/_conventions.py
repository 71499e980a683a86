r"""Frame, order of the degrees of freedom and time factor. Everything else refers to this page.

**Frame.** Right-handed; z along the shaft, x and y lateral (x along the cylinder of a compressor).
The shaft spins about +z with the spin speed W [rad/s].

**Degrees of freedom of a node.** Displacements [m] and small right-handed rotations [rad]:

- 4: (u_x, u_y, th_x, th_y);
- 6: (u_x, u_y, u_z, th_x, th_y, th_z).

A vector over the model is an array (n_nodes, dof) in the order of `RotorModel.nodes`. Forces have
the same layout, [N] and [N m].

**Planes.** The slope of the axis is (du_x/dz, du_y/dz) = (th_y, -th_x). So the x plane has the
coordinates (u_x, th_y) and the y plane (u_y, -th_x), and an axisymmetric part has the same
matrices in both. The third "plane" is (u_z, th_z), axial and torsion.

**Time factor.** x(t) = Re[X e^{i w t}] with w = n W for the harmonic of order n. With
p = (x + i y)/sqrt(2) and q = (x - i y)/sqrt(2), p is the forward whirl and q the backward one.
The dynamic stiffness of an axisymmetric spinning part is then uncoupled,

    Z_p = k - w^2 m + w W g,        Z_q = k - w^2 m - w W g,

with k, m, g symmetric in one plane and g built from the polar inertia: the equations of motion
M x'' + (C + W G) x' + K x = F have G_xy = +g, G_yx = -g.

**Unbalance.** U = m e [kg m] at the angle d from x gives F = U W^2 (1, -i) e^{i d} on (u_x, u_y).
A real periodic force f(t) = sum a_n cos(n W t) + b_n sin(n W t) has F_n = a_n - i b_n.
"""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._core.errors import BadInput

AXES = {
    4: ("ux", "uy", "thx", "thy"),
    6: ("ux", "uy", "uz", "thx", "thy", "thz"),
}
SPACE_AXES = AXES[6]  # three displacements, three rotations


def axis_numbers(dof: int, axes: tuple[str, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Which of `axes` a model with `dof` per node has, and their numbers in a node.

    Returns:
        Positions in `axes`, and the numbers of these degrees of freedom within a node.
    """
    positions = []
    numbers = []
    for position, axis in enumerate(axes):
        if axis in AXES[dof]:
            positions.append(position)
            numbers.append(AXES[dof].index(axis))
    return tuple(positions), tuple(numbers)


def check_axes(axes: tuple[str, ...]) -> None:
    """Refuse unknown or repeated names.

    Raises:
        BadInput: naming the axes that exist.
    """
    if len(set(axes)) != len(axes) or not set(axes) <= set(SPACE_AXES) or not axes:
        raise BadInput("axes", str(axes), f"different names out of {SPACE_AXES}")


def plane_numbers(dof: int) -> tuple[np.ndarray, np.ndarray]:
    """The degrees of freedom of a node in plane order, and their signs.

    Returns:
        Numbers and signs, both (planes, 2); planes is 2 or 3.
    """
    planes = [("ux", "thy"), ("uy", "thx")]
    if dof == 6:
        planes.append(("uz", "thz"))
    numbers = np.array([list(map(AXES[dof].index, plane)) for plane in planes])
    signs = np.ones(numbers.shape)
    # du_y/dz is -th_x: only with this sign the y plane has the matrices of the x plane
    signs[1, 1] = -1.0
    return numbers, signs


def trailing(a, axes: int):
    """An array with axes of length one behind its own, along which it is the same at all speeds.

    Responses at many speeds have the speeds along a last axis, which every function of a motion here
    takes: XLA makes vector instructions of the last axis, and the others are two to six long.
    """
    return a.reshape(a.shape + (1,) * axes)


def to_planes(x: Array, dof: int) -> Array:
    """(n, dof, ...) -> (n, planes, 2, ...)."""
    numbers, signs = plane_numbers(dof)
    return x[:, numbers] * trailing(signs, x.ndim - 2)


def from_planes(x: Array, dof: int) -> Array:
    """(n, planes, 2, ...) -> (n, dof, ...)."""
    numbers, signs = plane_numbers(dof)
    order = np.argsort(numbers.reshape(-1))
    signed = x * trailing(signs, x.ndim - 3)
    return signed.reshape(x.shape[0], -1, *x.shape[3:])[:, order]


def coordinates(dof: int) -> tuple[np.ndarray, np.ndarray]:
    """The degrees of freedom of a node in the order of the planes, (dof,), and their signs."""
    numbers, signs = plane_numbers(dof)
    return numbers.reshape(-1), signs.reshape(-1)


def to_components(x: Array, transpose: bool) -> Array:
    """(n, planes, ...) -> (n, components, ...) by a unitary matrix, whose conjugate exchanges p and q.

    Z^T has them exchanged, because its gyroscopic part changes sign.
    """
    # Written out, because a product with a small matrix would be a call of a library with copies around.
    turned = (-1j if transpose else 1j) * x[:, 1]
    lateral = jnp.stack([x[:, 0] + turned, x[:, 0] - turned], 1) * math.sqrt(0.5)
    # axial and torsional motion has no sense of whirl and is the same in planes and components
    return jnp.concatenate([lateral, x[:, 2:].astype(lateral.dtype)], 1)


def to_planes_of_components(x: Array, transpose: bool) -> Array:
    """(n, components, ...) -> (n, planes, ...), the way back of `to_components`."""
    # the way back of a unitary matrix is its conjugate transpose
    turn = 1j if transpose else -1j
    lateral = jnp.stack([x[:, 0] + x[:, 1], turn * (x[:, 0] - x[:, 1])], 1) * math.sqrt(0.5)
    return jnp.concatenate([lateral, x[:, 2:]], 1)


def add(x: Array, rows: np.ndarray, values: Array) -> Array:
    """`x` with values added to rows of known numbers; rows beyond the last one are left out.

    Without the checks of a negative number that an ordinary index brings into the program.
    """
    return x.at[rows].add(values, mode="drop", wrap_negative_indices=False)


def take(x: Array, rows: np.ndarray) -> Array:
    """Rows of `x` of known numbers, all of which exist; see `add`."""
    return x.at[rows].get(mode="promise_in_bounds", wrap_negative_indices=False)
