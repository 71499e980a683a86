r"""Inertia besides the shafts', disks, point masses and rigid bodies; and damping of the structure.

A rigid body holds nodes that follow its centre of inertia exactly, instead of stiff beams. A node with
the arm r from the centre moves by u = u_c + th x r, th = th_c; the forces on it act on the centre with
their moment r x F. The damping of bearings and mounts belongs to their links.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import NONNEGATIVE, Part, is_traced, quantity, spread_columns
from ._conventions import AXES, SPACE_AXES, coordinates
from ._shaft import Node


class Disks(Part):
    """A table of rigid axisymmetric disks.

    Args:
        nodes: node name of each disk.
        mass: [kg] (n,)
        transverse_inertia: [kg m2] (n,), about a diameter through the disk's own centre.
        polar_inertia: [kg m2] (n,)
        offset: [m] (n,), z of the centre minus z of the node; absent: on the node.
        spins: whether the disks turn with the shaft.

    Raises:
        BadInput: a negative value, a polar inertia above twice the transverse one, which no body
            has, or a table whose columns differ in length.
    """

    nodes: tuple[Node, ...] = eqx.field(static=True)
    mass: Array = quantity("kg", NONNEGATIVE, shape=(None,), spread=True, usual=(1e-4, 1e5))
    transverse_inertia: Array = quantity("kg m^2", NONNEGATIVE, shape=(None,), spread=True)
    polar_inertia: Array = quantity("kg m^2", NONNEGATIVE, shape=(None,), spread=True)
    offset: Array | None = quantity("m", shape=(None,), spread=True, default=None)
    spins: bool = eqx.field(static=True, default=True)

    def __post_init__(self):
        spread_columns(self, len(self.nodes), "disks")

    def conditions(self):
        # I_zz <= I_xx + I_yy for any distribution of mass; tables are rounded to some three digits.
        flat = self.polar_inertia <= 2.01 * self.transverse_inertia
        return {"a table with polar inertias of at most twice the transverse ones": flat.all()}


class PointMasses(Part):
    """A table of masses without extent.

    Args:
        nodes: node name of each mass.
        mass: [kg] (n,)
    """

    nodes: tuple[Node, ...] = eqx.field(static=True)
    mass: Array = quantity("kg", NONNEGATIVE, shape=(None,), spread=True, usual=(1e-4, 1e5))

    def __post_init__(self):
        spread_columns(self, len(self.nodes), "masses")


def solid_disk(
    node: Node, outer_diameter, inner_diameter, width, density, *, spins: bool = True
) -> Disks:
    """One disk of rectangular section, from its dimensions and density.

    Args:
        node: where it sits.
        outer_diameter: [m]
        inner_diameter: [m] 0 without a hole.
        width: [m]
        density: [kg/m3]
        spins: whether it turns with the shaft (gyroscopic terms).
    """
    do, di = jnp.asarray(outer_diameter, float), jnp.asarray(inner_diameter, float)
    mass = density * jnp.pi / 4 * (do**2 - di**2) * width
    polar = mass * (do**2 + di**2) / 8
    # about a diameter through the middle of the width, with radii written as half diameters
    transverse = mass * (3 * (do**2 + di**2) / 4 + width**2) / 12
    return Disks((node,), mass[None], transverse[None], polar[None], spins=spins)


def inertia_matrices(
    table: Disks | PointMasses,
) -> tuple[Float[Array, "n 2 2"], Float[Array, "n 2 2"], Float[Array, "n 2 2"]]:
    """Lateral inertia, polar inertia on (u, phi), and inertia on (u_z, th_z), at the nodes."""
    m = table.mass
    zero = jnp.zeros_like(table.mass)
    if isinstance(table, PointMasses):
        lateral = _two_by_two(m, zero, zero)
        return lateral, jnp.zeros_like(lateral), lateral
    b = zero if table.offset is None else table.offset
    spin = table.polar_inertia if table.spins else zero
    # phi = du/dz: a centre b above its node moves by u + b phi, which couples the two by +m b.
    lateral = _two_by_two(m, m * b, table.transverse_inertia + m * b**2)
    # Torsional inertia counts without spin as well; only the gyroscopic moment depends on it.
    return lateral, _two_by_two(zero, zero, spin), _two_by_two(m, zero, table.polar_inertia)


def _two_by_two(a, b, c):
    return jnp.stack([jnp.stack([a, b], -1), jnp.stack([b, c], -1)], -2)


class RigidBody(Part):
    """A rigid body with the nodes that are fixed to it.

    Args:
        centre: name of the node at the centre of inertia.
        nodes: names of the slaved nodes.
        arm: [m] (n, 3) from the centre of inertia to each slaved node.
        mass: [kg]
        inertia: [kg m2] (3, 3) tensor about the centre of inertia, with +I_xx on the diagonal and
            minus the products of inertia beside it.
        spin_inertia: [kg m2] part of I_zz that turns with the shaft, for a rigid rotor; absent for
            crankcase and housing.

    Raises:
        BadInput: an arm for each node is missing, or the tensor is not symmetric and positive.
    """

    centre: Node = eqx.field(static=True)
    nodes: tuple[Node, ...] = eqx.field(static=True)
    arm: Array = quantity("m", shape=(None, 3))
    mass: Array = quantity("kg", NONNEGATIVE, usual=(1e-4, 1e5))
    inertia: Array = quantity("kg m^2", shape=(3, 3))
    spin_inertia: Array | None = quantity("kg m^2", NONNEGATIVE, default=None)

    def __check_init__(self):
        if self.arm.shape[0] != len(self.nodes):
            raise BadInput("arm", self.arm, f"one arm for each of {len(self.nodes)} nodes")
        if self.centre in self.nodes or len(set(self.nodes)) != len(self.nodes):
            raise BadInput("nodes", str(self.nodes), "different from each other and the centre")
        if not is_traced(self.inertia):
            tensor = np.asarray(self.inertia)
            scale = max(np.abs(tensor).max(), 1e-300)
            if np.abs(tensor - tensor.T).max() > 1e-9 * scale:
                raise BadInput("inertia", tensor, "symmetric")
            # A thin rod has a principal value of zero, which rounding may leave below it.
            if np.linalg.eigvalsh(tensor).min() < -1e-9 * scale:
                raise BadInput("inertia", tensor, "without negative principal values")


def arm_matrices(arm: Float[Array, "n 3"], dof: int) -> Float[Array, "n dof dof"]:
    """Motion of slaved nodes from that of the centre, in coordinates."""
    cross = (arm @ _CROSS.reshape(3, 36)).reshape(-1, 6, 6)
    return _in_coordinates(np.eye(6) + cross, dof)


def body_matrices(body: RigidBody, dof: int) -> Float[Array, "2 dof dof"]:
    """Inertia and gyroscopic matrix (per unit spin speed) at the centre, in coordinates."""
    move = np.diag([1.0, 1, 1, 0, 0, 0])
    turn = np.eye(6)[:, 3:]
    mass = body.mass * move + turn @ body.inertia @ turn.T
    spin = 0.0 if body.spin_inertia is None else body.spin_inertia
    # Spin about +z: M_x = I th_x'' + I_p W th_y' and M_y = I th_y'' - I_p W th_x', for a small
    # rotation tips the spinning axis towards (th_y, -th_x).
    gyro = spin * (np.outer(turn[:, 0], turn[:, 1]) - np.outer(turn[:, 1], turn[:, 0]))
    return _in_coordinates(jnp.stack([mass, gyro]), dof)


def _in_coordinates(matrices, dof) -> Array:
    """From the six axes of space to the coordinates of a node, see `_conventions`."""
    order, signs = coordinates(dof)
    rows = np.array([SPACE_AXES.index(a) for a in AXES[dof]])[order]
    # The coordinate -th_x changes the sign of the moment that works on it, hence rows and columns.
    return signs[:, None] * signs * matrices[..., rows[:, None], rows]


# th x r for each component of r, as a matrix acting on (u, th)
_CROSS = np.zeros((3, 6, 6))
_CROSS[:, :3, 3:] = np.cross(np.eye(3)[None, :, :], np.eye(3)[:, None, :]).transpose(0, 2, 1)


class ProportionalDamping(Part):
    r"""C = alpha M + beta K of the shafts, disks, masses and bodies, not turning with the shaft.

    Args:
        mass_factor: [1/s] alpha, on all inertia.
        stiffness_factor: [s] beta, on the stiffness of the shaft elements.
    """

    kind: ClassVar[str] = "proportional"

    mass_factor: Array = quantity("1/s", NONNEGATIVE, default=0.0)
    stiffness_factor: Array = quantity("s", NONNEGATIVE, default=0.0)


class ModalDamping(Part):
    r"""C = sum_j 2 zeta_j w_j (M phi_j)(M phi_j)^T over the lowest undamped modes of the model.

    The modes are those of the symmetric stiffness at zero spin speed, normalised to unit modal
    mass. The matrix is full, so that the response of such a model takes the dense path.

    Args:
        ratio: [-] (m,) damping ratios zeta of the m lowest modes.
    """

    kind: ClassVar[str] = "modal"

    ratio: Array = quantity("", NONNEGATIVE, shape=(None,))
