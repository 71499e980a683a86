"""Options of the analysis of a design."""

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Complex

from .._core.errors import BadInput
from ..crank import Collocation

if TYPE_CHECKING:
    from ..crank import Shooting


class Reading(NamedTuple):
    """Reading of a response, linear in it.

    Attributes:
        targets: [m], [rad] (*batch, rows)
        mounts: [N] (*batch, links, 2) lateral forces of the links to the ground.
    """

    targets: Complex[Array, "*batch rows"]
    mounts: Complex[Array, "*batch links 2"]


class KnownResponse(eqx.Module):
    """Response of a rotor that itself does not change to loads.

    Attributes:
        unit: `Reading` with the batch (speeds, orders, nodes, dof), of one newton (newton metre) each.
        fixed: `Reading` with the batch (speeds, orders), of the forces that do not change either.
        ok: (speeds,)
        nodes: numbers of the nodes that are loaded; static.
    """

    unit: Reading
    fixed: Reading
    ok: Bool[Array, " speeds"]
    nodes: tuple[int, ...] = eqx.field(static=True)


class AnalysisOptions(eqx.Module):
    """Options of the analysis of a design; they are fixed while numbers change.

    Attributes:
        solver: of the periodic state. Absent: collocation, with a panel edge for each load reversal
            (`default_collocation`) but where only the forces on the rotor are wanted, see
            `jaxcomp.vibration.crank_loads`.
        excitation: what shakes the rotor: "crank" (the periodic state at each speed, whose mean
            force loads the films as well) or "file" (the forces of the scene). Absent: the forces of
            the scene if it has any, otherwise the crank.
        orders: orders of the spin speed that count in vibrations and mount forces.
        left_out: what the crank's forces on the rotor do without, see `jaxcomp.balancing.without`.
        known: response of a rotor that does not change to unit loads; see `prepared`.

    Raises:
        BadInput: another excitation, or an order below one.
    """

    solver: "Collocation | Shooting | None" = None
    excitation: Literal["crank", "file"] | None = eqx.field(static=True, default=None)
    orders: tuple[int, ...] = eqx.field(static=True, default=(1,))
    left_out: tuple[str, ...] = eqx.field(static=True, default=())
    known: "KnownResponse | None" = None

    def __check_init__(self):
        if self.excitation not in ("crank", "file", None):
            raise BadInput("excitation", str(self.excitation), "'crank' or 'file'")
        if not self.orders or min(self.orders) < 1:
            raise BadInput("orders", str(self.orders), "whole numbers from 1")


def checked_options(options: Any) -> AnalysisOptions:
    """The options of an analysis, the usual ones if absent.

    Raises:
        BadInput: something else.
    """
    if isinstance(options, AnalysisOptions | None):
        return options or AnalysisOptions()
    raise BadInput("options", f"a {type(options).__name__}", "`AnalysisOptions(...)`")
