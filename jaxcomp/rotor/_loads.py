r"""Loads: unbalances, and periodic forces that act between two parts of the machine."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .._core.errors import BadInput
from .._core.fields import NONNEGATIVE, Part, quantity, spread_columns
from ._conventions import AXES, SPACE_AXES, trailing
from ._layout import layout_of
from ._model import RotorModel, rotor_among
from ._nodes import check_nodes, node_index
from ._shaft import Node
from ._system import System


class Unbalances(Part):
    """A table of unbalances; they load the model at order 1.

    Args:
        nodes: node of each unbalance.
        magnitude: [kg m] (n,), mass times eccentricity.
        phase: [rad] (n,), angle from x in the direction of the spin, at time zero.
    """

    nodes: tuple[Node, ...] = eqx.field(static=True)
    magnitude: Array = quantity("kg m", NONNEGATIVE, shape=(None,), spread=True, usual=(1e-9, 10.0))
    phase: Array = quantity("rad", shape=(None,), spread=True)

    def __post_init__(self):
        spread_columns(self, len(self.nodes), "unbalances")


class PeriodicForce(Part):
    """A force and moment on a node with its Fourier coefficients, and its reaction elsewhere.

    f(t) = sum over the orders of a_n cos(n W t) + b_n sin(n W t) with f = (F_x, F_y, F_z), and
    likewise the moment. A model of 4 degrees of freedom takes the lateral components.

    Args:
        node: where the force acts.
        reaction: node that takes the opposite force; `None` for an outer force.
        orders: the orders n.
        cosine: [N] (orders, 3) coefficients a_n.
        sine: [N] (orders, 3) coefficients b_n.
        moment_cosine: [N m] (orders, 3); absent for none.
        moment_sine: [N m] (orders, 3)
        arm: [m] (3,) from the reaction node to the point of action; the reaction includes the
            moment of the force about its node. Absent: the two nodes coincide in space.

    Raises:
        BadInput: coefficients that are not three for each order, or a reaction on the same node.
    """

    node: Node = eqx.field(static=True)
    reaction: Node | None = eqx.field(static=True)
    orders: tuple[int, ...] = eqx.field(static=True)
    cosine: Array = quantity("N", shape=(None, 3))
    sine: Array = quantity("N", shape=(None, 3))
    moment_cosine: Array | None = quantity("N m", shape=(None, 3), default=None)
    moment_sine: Array | None = quantity("N m", shape=(None, 3), default=None)
    arm: Array | None = quantity("m", shape=(3,), default=None)

    def __check_init__(self):
        n = len(self.orders)
        for name in ("cosine", "sine", "moment_cosine", "moment_sine"):
            value = getattr(self, name)
            if value is not None and value.shape != (n, 3):
                raise BadInput(name, value, f"three components for each of {n} orders")
        if self.node == self.reaction:
            raise BadInput("reaction", str(self.reaction), "another node than the force's own")


class CrankNodes(Part):
    """Nodes on which the forces of the crank mechanism act, see `jaxcomp.vibration.crank_forces`.

    With several cylinders `pin`, `head` and `wall` are lists with a node for each cylinder, in its
    plane.

    Args:
        pin: node of the shaft in the plane of the rod; it takes the rod's force with its torque.
        head: node of the crankcase on the cylinder axis, which takes the gas force.
        wall: node of the crankcase, which takes the piston's side force and friction.
        wall_position: [m] of that node along the cylinder's axis from the shaft's; the side force acts
            where the piston is and so turns the crankcase as well.
        rotor: node that takes the motor's torque; absent without torsion.
        stator: node that takes its reaction.

    Raises:
        BadInput: one of `rotor` and `stator` alone, or lists of different length.
    """

    pin: Node | tuple[Node, ...] = eqx.field(static=True)
    head: Node | tuple[Node, ...] = eqx.field(static=True)
    wall: Node | tuple[Node, ...] = eqx.field(static=True)
    wall_position: Array = quantity("m", default=0.0)
    rotor: Node | None = eqx.field(static=True, default=None)
    stator: Node | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if (self.rotor is None) != (self.stator is None):
            raise BadInput("stator", str(self.stator), "given with `rotor`, and only with it")
        lengths = set()
        for nodes in self._nodes:
            lengths.add(len(nodes) if isinstance(nodes, tuple) else 0)
        if len(lengths) > 1:
            raise BadInput("pin", str(self.pin), "of as many nodes as `head` and `wall`")

    @property
    def _nodes(self):
        return self.pin, self.head, self.wall

    @property
    def pins(self) -> tuple[Node, ...]:
        """Nodes of the pins of all cylinders."""
        return self.pin if isinstance(self.pin, tuple) else (self.pin,)

    @property
    def of_cylinders(self) -> tuple[tuple[Any, ...], ...]:
        """Nodes of pin, head and wall of every cylinder."""
        if self.pin == self.pins:
            return tuple(zip(*self._nodes, strict=True))
        return (self._nodes,)


class PipeNode(Part):
    """Node on which the waves of pipes push by a run or a vessel, see `jaxcomp.piping`.

    Args:
        run: name of the run or vessel, as `shaking` has it: its ends with a hyphen, such as "tee-line",
            with "suction." or "discharge." before them where both lines have pipes.
        node: of the crankcase or housing that holds it.
    """

    run: str = eqx.field(static=True)
    node: Node = eqx.field(static=True)


class LoadCase(Part):
    """Unbalances, periodic forces, and where the forces of the crank act.

    Args:
        unbalances: tables of unbalances.
        forces: periodic forces.
        crank: where the forces of the compressor of the same file act.
        pipes: where its pipes push, beside those forces.

    Raises:
        BadInput: `pipes` without `crank`.
    """

    unbalances: tuple[Unbalances, ...] = ()
    forces: tuple[PeriodicForce, ...] = ()
    crank: CrankNodes | None = None
    pipes: tuple[PipeNode, ...] = ()

    def __check_init__(self):
        if self.pipes and self.crank is None:
            bound = "absent without `loads.crank`: waves shake with the crank that makes them"
            raise BadInput("pipes", f"{len(self.pipes)} given", bound)

    @property
    def loads(self) -> "Loads":
        """All of them, as `respond` takes them."""
        return (*self.unbalances, *self.forces)

    def check_beside(self, parts) -> None:
        """Whether the rotor of the same file has the nodes.

        Raises:
            BadInput: a node that the rotor does not have.
        """
        model = rotor_among(parts)
        for number, table in enumerate(self.unbalances):
            check_nodes(model, table.nodes, f"unbalances.{number}.nodes")
        for number, force in enumerate(self.forces):
            check_nodes(model, force.node, f"forces.{number}.node")
            check_nodes(model, force.reaction, f"forces.{number}.reaction")
        for number, pipe in enumerate(self.pipes):
            check_nodes(model, pipe.node, f"pipes.{number}.node")
        if self.crank is None:
            return
        for name in ("pin", "head", "wall", "rotor", "stator"):
            check_nodes(model, getattr(self.crank, name), f"crank.{name}")


Loads = tuple[Unbalances | PeriodicForce, ...]


def check_loads(loads: Any) -> None:
    """Refuse what is no list of loads, as speeds are in their place.

    Raises:
        BadInput: something else than a tuple or list of `Unbalances` and `PeriodicForce`.
    """
    is_list = isinstance(loads, tuple | list)
    if not is_list or not all(isinstance(load, Unbalances | PeriodicForce) for load in loads):
        bound = "a tuple of `Unbalances` and `PeriodicForce`; speeds are named, `spin_speeds=...`"
        raise BadInput("loads", f"of the type {type(loads).__name__}", bound)


def load_vector(
    model: RotorModel | System, loads: Loads, order: int, spin_speed: Float[Array, "*speeds"]
) -> Complex[Array, "n dof *speeds"]:
    r"""[N], [N m] Complex load of one order at the nodes, f(t) = Re[F e^{i n W t}].

    An unbalance gives F = U W^2 (1, -i) e^{i d} on (u_x, u_y).

    Args:
        model: the model.
        loads: unbalances and forces.
        order: n; at 0 the cosine coefficient is the mean force.
        spin_speed: [rad/s] W, or a list of speeds, which the last axis then has.

    Raises:
        BadInput: a load on a node that the model does not have.
    """
    f = jnp.zeros((layout_of(model).n, model.dof, *jnp.shape(spin_speed)), complex)
    for load in loads:
        if isinstance(load, Unbalances):
            # at constant speed an unbalance turns evenly and has no other harmonic
            if order == 1:
                f = _with_unbalance(f, model, load, spin_speed)
        elif order in load.orders:
            f = _with_force(f, model, load, order)
    return f


def nodal_load(
    model: RotorModel | System, node: Node, axis: str, value: complex = 1.0
) -> Complex[Array, "n dof"]:
    """[N], [N m] A load on one axis of one node.

    Args:
        model: the model.
        node: where it acts.
        axis: "ux", "thx" and so on, one of `AXES[model.dof]`.
        value: [N] complex amplitude; [N m] on a rotation.
    """
    at = (node_index(model, node), AXES[model.dof].index(axis))
    return jnp.zeros((layout_of(model).n, model.dof), complex).at[at].set(value)


def _with_unbalance(f, model, load, spin_speed):
    at = np.array([node_index(model, node) for node in load.nodes], int)
    # It turns forward with the shaft: u_y follows u_x by 90 degrees, which is the factor -i.
    turned = load.magnitude * jnp.exp(1j * load.phase)
    x = trailing(turned, jnp.ndim(spin_speed)) * spin_speed**2
    return f.at[at, 0].add(x).at[at, 1].add(-1j * x)


def _with_force(f, model, load, order):
    row = load.orders.index(order)

    def amplitude(cosine, sine):
        none = jnp.zeros((len(load.orders), 3))
        if cosine is None:
            cosine = none
        if sine is None:
            sine = none
        # Re[(a - i b) e^{i w t}] = a cos w t + b sin w t.
        return cosine[row] - 1j * sine[row]

    force = amplitude(load.cosine, load.sine)
    wrench = jnp.concatenate([force, amplitude(load.moment_cosine, load.moment_sine)])
    components = np.array([SPACE_AXES.index(a) for a in AXES[model.dof]])
    speeds = f.ndim - 2
    f = f.at[node_index(model, load.node)].add(trailing(wrench[components], speeds))
    if load.reaction is None:
        return f
    if load.arm is not None:
        # -F acts where F does: about the node that takes it, it has the moment -(r x F) as well
        wrench = wrench.at[3:].add(jnp.cross(load.arm.astype(complex), force))
    return f.at[node_index(model, load.reaction)].add(-trailing(wrench[components], speeds))
