r"""Loads: unbalances, and periodic forces that act between two parts of the machine."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._fields import NONNEGATIVE, BadInput, Part, quantity
from ._assembly import collect, structure_of
from ._conventions import AXES, SPACE_AXES
from ._layout import layout_of
from ._model import RotorModel, node_index
from ._shaft import Node


class Unbalances(Part):
    """A table of unbalances; they load the model at order 1.

    Args:
        nodes: node of each unbalance.
        magnitude: [kg m] (n,), mass times eccentricity.
        phase: [rad] (n,), angle from x in the direction of the spin, at time zero.
    """

    nodes: tuple[Node, ...] = eqx.field(static=True)
    magnitude: Array = quantity("kg m", NONNEGATIVE, shape=(None,))
    phase: Array = quantity("rad", shape=(None,))

    def __check_init__(self):
        for name in ("magnitude", "phase"):
            value, n = getattr(self, name), len(self.nodes)
            if value.shape != (n,):
                raise BadInput(name, value, f"one value for each of {n} unbalances")


class PeriodicForce(Part):
    """A force and moment on a node with its Fourier coefficients, and its reaction elsewhere.

    f(t) = sum over the orders of a_n cos(n W t) + b_n sin(n W t). The six components are those of
    (F_x, F_y, F_z, M_x, M_y, M_z); a model of 4 degrees of freedom takes the lateral ones.

    Args:
        node: where the force acts.
        reaction: node that takes the opposite force; `None` for an outer force.
        orders: the orders n.
        cosine: [N], [N m] (orders, 6) coefficients a_n.
        sine: [N], [N m] (orders, 6) coefficients b_n.
        arm: [m] (3,) from the reaction node to the point of action; the reaction includes the
            moment of the force about its node. Absent: the two nodes coincide in space.
    """

    node: Node = eqx.field(static=True)
    reaction: Node | None = eqx.field(static=True)
    orders: tuple[int, ...] = eqx.field(static=True)
    cosine: Array = quantity("N", shape=(None, 6))
    sine: Array = quantity("N", shape=(None, 6))
    arm: Array | None = quantity("m", shape=(3,), default=None)

    def __check_init__(self):
        for name in ("cosine", "sine"):
            value, n = getattr(self, name), len(self.orders)
            if value.shape != (n, 6):
                raise BadInput(name, value, f"six components for each of {n} orders")
        if self.node == self.reaction:
            raise BadInput("reaction", str(self.reaction), "another node than the force's own")


Loads = tuple[Unbalances | PeriodicForce, ...]


def load_vector(
    model: RotorModel, loads: Loads, order: int, spin_speed: Float[Array, ""]
) -> Complex[Array, "n dof"]:
    r"""[N], [N m] Complex load of one order at the nodes, f(t) = Re[F e^{i n W t}].

    An unbalance gives F = U W^2 (1, -i) e^{i d} on (u_x, u_y).

    Args:
        model: the model.
        loads: unbalances and forces.
        order: n; at 0 the cosine coefficient is the mean force.
        spin_speed: [rad/s] W.

    Raises:
        BadInput: a load on a node that the model does not have.
    """
    f = jnp.zeros((layout_of(model).n, model.dof), complex)
    for load in loads:
        if isinstance(load, Unbalances):
            if order == 1:
                f = f + _unbalance(model, load, spin_speed)
        elif order in load.orders:
            f = f + _periodic(model, load, order)
    return f


def nodal_load(
    model: RotorModel, node: Node, axis: str, value: complex = 1.0
) -> Complex[Array, "n dof"]:
    """[N], [N m] A load on one axis of one node."""
    at = (node_index(model, node), AXES[model.dof].index(axis))
    return jnp.zeros((layout_of(model).n, model.dof), complex).at[at].set(value)


def _unbalance(model, load, spin_speed):
    at = np.array([node_index(model, node) for node in load.nodes], int)
    x = load.magnitude * spin_speed**2 * jnp.exp(1j * load.phase)
    f = jnp.zeros((layout_of(model).n, model.dof), complex)
    return f.at[at, 0].add(x).at[at, 1].add(-1j * x)


def _periodic(model, load, order):
    row = load.orders.index(order)
    wrench = load.cosine[row] - 1j * load.sine[row]
    own = np.array([SPACE_AXES.index(a) for a in AXES[model.dof]])
    f = jnp.zeros((layout_of(model).n, model.dof), complex)
    f = f.at[node_index(model, load.node)].add(wrench[own])
    if load.reaction is None:
        return f
    if load.arm is not None:
        wrench = wrench.at[3:].add(jnp.cross(load.arm.astype(complex), wrench[:3]))
    return f.at[node_index(model, load.reaction)].add(-wrench[own])


def total_load(model: RotorModel, force: Complex[Array, "n dof"]) -> Complex[Array, " dof"]:
    """[N] Sum over all nodes of the force components (moments refer to each node's own place)."""
    return _total(model, force)


@eqx.filter_jit
def _total(model, force):
    layout = layout_of(model)
    moved = collect(structure_of(model), layout, force)
    return jnp.sum(jnp.where(jnp.asarray(layout.active), moved, 0.0), 0)
