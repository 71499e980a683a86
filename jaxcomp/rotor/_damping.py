r"""Damping of the structure itself; that of bearings and mounts belongs to their links."""

from typing import ClassVar

from jaxtyping import Array

from .._fields import NONNEGATIVE, Part, quantity


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
