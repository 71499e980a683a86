r"""Rigid bodies: nodes that follow a centre of inertia exactly, instead of stiff beams.

A node slaved to a body with the arm r (from the centre of inertia to the node) moves by
u = u_c + th x r, th = th_c; the forces on it act on the centre with their moment r x F.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, BadInput, Part, is_traced, quantity
from ._conventions import AXES, SPACE_AXES
from ._shaft import Node


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
    mass: Array = quantity("kg", NONNEGATIVE)
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
            if np.linalg.eigvalsh(tensor).min() < -1e-9 * scale:
                raise BadInput("inertia", tensor, "without negative principal values")


def arm_matrix(arm: Float[Array, "n 3"], dof: int) -> Float[Array, "n dof dof"]:
    """Motion of slaved nodes from that of the centre, in the model's degrees of freedom."""
    rows = _rows(dof)
    cross = (arm @ _CROSS.reshape(3, 36)).reshape(-1, 6, 6)
    return (np.eye(6) + cross)[:, rows[:, None], rows]  # pyright: ignore[reportReturnType]


def body_matrices(
    body: RigidBody, dof: int
) -> tuple[Float[Array, "dof dof"], Float[Array, "dof dof"]]:
    """Inertia and gyroscopic matrix (per unit spin speed) at the centre."""
    move, turn = np.diag([1.0, 1, 1, 0, 0, 0]), np.eye(6)[:, 3:]
    mass = body.mass * move + turn @ body.inertia @ turn.T
    spin = 0.0 if body.spin_inertia is None else body.spin_inertia
    gyro = spin * (np.outer(turn[:, 0], turn[:, 1]) - np.outer(turn[:, 1], turn[:, 0]))
    rows = _rows(dof)
    return mass[rows[:, None], rows], gyro[rows[:, None], rows]  # pyright: ignore[reportReturnType]


def _rows(dof: int) -> np.ndarray:
    return np.array([SPACE_AXES.index(a) for a in AXES[dof]])


# th x r for each component of r, as a matrix acting on (u, th)
_CROSS = np.zeros((3, 6, 6))
_CROSS[:, :3, 3:] = np.cross(np.eye(3)[None, :, :], np.eye(3)[:, None, :]).transpose(0, 2, 1)
