r"""Where unbalance can be added, and where vibration is judged: the named planes of a machine."""

import equinox as eqx
from jaxtyping import Array

from .._fields import NONNEGATIVE, POSITIVE, BadInput, Part, quantity
from ._conventions import AXES, check_axes
from ._model import check_node, rotor_among
from ._shaft import Node


class CorrectionPlane(Part):
    """A plane of the rotor that takes correction masses.

    Args:
        name: of the plane.
        node: of the rotor.
        radius: [m] at which a mass is fixed; absent where only mass times radius is asked for.
    """

    name: str = eqx.field(static=True)
    node: Node = eqx.field(static=True)
    radius: Array | None = quantity("m", POSITIVE, default=None)


class TargetPlane(Part):
    """A node whose vibration counts.

    Args:
        name: of the plane.
        node: of any subset.
        axes: directions in which its motion is judged.
        relative_to: node from which the motion is seen, for example across an air gap; absent for
            the absolute motion.
        weight: [-] of this target among the others.
    """

    name: str = eqx.field(static=True)
    node: Node = eqx.field(static=True)
    axes: tuple[str, ...] = eqx.field(static=True, default=("ux", "uy"))
    relative_to: Node | None = eqx.field(static=True, default=None)
    weight: Array = quantity("", NONNEGATIVE, default=1.0)

    def __check_init__(self):
        check_axes(self.axes)


class BalancingPlanes(Part):
    """Correction and target planes of a machine.

    Args:
        planes: where masses can be added.
        targets: where vibration is judged.
        speeds: [rad/s] (m,) at which the machine runs.

    Raises:
        BadInput: no plane or no target, or two of one name.
    """

    planes: tuple[CorrectionPlane, ...]
    targets: tuple[TargetPlane, ...]
    speeds: Array = quantity("rad/s", POSITIVE, shape=(None,))

    def __check_init__(self):
        for what in ("planes", "targets"):
            names = [one.name for one in getattr(self, what)]
            if not names:
                raise BadInput(what, "empty", f"at least one of the {what}")
            if len(set(names)) != len(names):
                raise BadInput(what, str(names), "of different names")

    def check_beside(self, parts) -> None:
        """Whether the rotor of the same file has the nodes and axes.

        Raises:
            BadInput: naming the plane, and the nodes or axes that exist.
        """
        model = rotor_among(parts)
        for number, plane in enumerate(self.planes):
            check_node(model, plane.node, f"planes.{number}.node")
        for number, target in enumerate(self.targets):
            check_node(model, target.node, f"targets.{number}.node")
            if target.relative_to is not None:
                check_node(model, target.relative_to, f"targets.{number}.relative_to")
            if not set(target.axes) <= set(AXES[model.dof]):
                bound = f"out of {AXES[model.dof]} with {model.dof} degrees of freedom"
                raise BadInput(f"targets.{number}.axes", str(target.axes), bound)
